"""Ways from one place to another at one depth, proven to keep clear of the walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from grassfire.plan.path import SAME, Nearest, Path, Pieces, segment
from grassfire.plan.places import BoolArray, IntArray, Places, few_nearest
from grassfire.toolpath import FloatArray

MOST_PROBES = 20_000
"""Clearance queries that one proof may take before the way counts as not proven."""


class Clearance(Protocol):
    """What a proof asks of a medial axis."""

    def clearance(self, points: FloatArray) -> FloatArray:
        """(n,) distance to the boundary, negative outside, mm."""


class Holding(Protocol):
    """What a road map asks of the area that a way must stay in."""

    def holds(
        self, starts: FloatArray, ends: FloatArray, *, certain: BoolArray | None = None
    ) -> BoolArray:
        """Whether each straight way between two points of the area stays in it.

        `certain` (m,) says which ways have an end strictly inside.
        """


def paths_clear(
    axis: Clearance, paths: Sequence[Path], distance: float, tolerance: float = 1e-3
) -> BoolArray:
    """Whether each path keeps at least `distance - tolerance` mm from the boundary.

    Clearance is 1-Lipschitz: on a stretch of half-length w about a place of clearance c it is at
    least c - w. A stretch with c - w >= distance - tolerance is done; one whose c is too small is
    a failure; others are halved. The answer "clear" is therefore a proof.

    Parameters
    ----------
    axis : MedialAxis
        Asked for `clearance` only, for all paths at once.
    paths : sequence of Path
    distance, tolerance : float
        mm.

    Returns
    -------
    (n,) bool array
    """
    clear = np.ones(len(paths), dtype=bool)
    owner = np.arange(len(paths))
    low = np.zeros(len(paths))
    high = np.array([path.length for path in paths])
    floor = distance - tolerance
    spent = 0
    while len(owner):
        middle, half = (low + high) / 2, (high - low) / 2
        points = np.empty((len(owner), 2))
        for index in np.unique(owner):
            chosen = owner == index
            points[chosen] = paths[index].at(middle[chosen])
        spent += len(owner)
        clearance = axis.clearance(points)
        clear[owner[clearance < floor]] = False
        if spent > MOST_PROBES:
            clear[owner[clearance - half < floor]] = False
            break
        split = (clearance - half < floor) & clear[owner]
        owner, low, middle, high = owner[split], low[split], middle[split], high[split]
        owner = np.repeat(owner, 2)
        low = np.stack([low, middle], axis=1).ravel()
        high = np.stack([middle, high], axis=1).ravel()
    return clear


END = 1e-6
"""Length at both ends of a way where touching a ring is no crossing, mm."""


@dataclass(frozen=True)
class RingPlace:
    """A place on one of several rings."""

    ring: int
    nearest: Nearest


class RingSet:
    """Rings of one component as stacked columns, for nearest-place queries on those not yet cut."""

    def __init__(self, rings: Sequence[Path]) -> None:
        self.rings = tuple(rings)
        self.left = np.ones(len(self.rings), dtype=bool)
        self._asked: tuple[tuple[float, float], tuple[FloatArray, FloatArray]] | None = None
        count = np.array([len(ring) for ring in self.rings])
        self._first: IntArray = np.cumsum(count) - count
        self._columns = (
            np.concatenate([ring.points[:-1] for ring in self.rings]),
            np.concatenate([ring.points[1:] for ring in self.rings]),
            np.concatenate([ring.centre for ring in self.rings]),
            np.concatenate([ring.sweep for ring in self.rings]),
        )

    @cached_property
    def _pieces(self) -> Pieces:
        """The pieces of all rings, prepared for nearest places."""
        return Pieces(*self._columns)

    @cached_property
    def _barriers(self) -> _Barriers:
        """The pieces of all rings, prepared for crossings."""
        return _Barriers(*self._columns)

    def nearest_left(self, point: FloatArray, count: int = 1) -> list[RingPlace]:
        """Nearest places on the `count` nearest rings that are left, nearest first."""
        fraction, distance = self._nearest(point)
        best = np.where(self.left, np.minimum.reduceat(distance, self._first), np.inf)
        order = [
            int(ring) for ring in np.argsort(best, kind="stable")[:count] if np.isfinite(best[ring])
        ]
        places = []
        for ring in order:
            first = int(self._first[ring])
            local = int(np.argmin(distance[first : first + len(self.rings[ring])]))
            chosen = first + local
            path = self.rings[ring]
            along = float(path.cumulative[local] + fraction[chosen] * path.lengths[local])
            place = Nearest(along, path.point(along), float(distance[chosen]))
            places.append(RingPlace(ring, place))
        return places

    def _nearest(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nearest places of all pieces; a place is often asked about twice in a row."""
        place = (float(point[0]), float(point[1]))
        if self._asked is None or self._asked[0] != place:
            self._asked = place, self._pieces.nearest(point)
        return self._asked[1]

    def crossed(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """Whether any ring, cut or not, crosses the inside of each straight way.

        Parameters
        ----------
        starts, ends : (m, 2) float arrays
            mm; what happens within `END` mm of them does not count, so that they may lie on rings.

        Returns
        -------
        (m,) bool array
        """
        return self._barriers.crossed(starts, ends)


class _Barriers:
    """Lines and arcs as columns, for crossings with straight ways."""

    def __init__(
        self, start: FloatArray, end: FloatArray, centre: FloatArray, sweep: FloatArray
    ) -> None:
        low, high = _boxes(start, end, centre, sweep)
        # a box is met where none of its four sides is beyond the opposite one of the other
        self._sides = np.concatenate([low.T, -high.T])
        spoke = start - centre
        square = np.sum(spoke * spoke, axis=1)
        self._line_columns = np.concatenate([start.T, (end - start).T])
        self._arc_columns = np.concatenate([centre.T, spoke.T, square[None], sweep[None]])
        self._arc = sweep != 0.0

    def crossed(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        """(m,) whether any piece crosses the inside of each straight way; see `RingSet.crossed`."""
        hit = np.zeros(len(starts), dtype=bool)
        opposite = np.concatenate([np.maximum(starts, ends).T, -np.minimum(starts, ends).T])
        # few pieces are near any of the ways: those first
        near = _all(self._sides <= opposite.max(axis=1)[:, None]).nonzero()[0]
        sides = self._sides.take(near, axis=1)
        row, column = _all(sides[:, None, :] <= opposite[:, :, None]).nonzero()
        if not len(row):
            return hit
        piece = near[column]
        way = ends - starts
        margin = np.minimum(END / np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-300), 0.5)
        columns = np.concatenate([starts.T, way.T, margin[None]])
        arc = self._arc[piece]
        for chosen, test in ((~arc, self._lines), (arc, self._arcs)):
            pairs = chosen.nonzero()[0]
            if len(pairs):
                rows = row[pairs]
                hit[rows[test(columns.take(rows, axis=1), piece[pairs])]] = True
        return hit

    def _lines(self, ways: FloatArray, piece: IntArray) -> BoolArray:
        """(k,) whether each way crosses its line; ways are columns x, y, their extents, margin."""
        x, y, way_x, way_y, margin = ways
        line_x, line_y, side_x, side_y = self._line_columns.take(piece, axis=1)
        gap_x, gap_y = line_x - x, line_y - y
        across = way_x * side_y - way_y * side_x
        safe = np.where(across == 0.0, 1.0, across)
        along = (gap_x * side_y - gap_y * side_x) / safe
        other = (gap_x * way_y - gap_y * way_x) / safe
        inside = (along > margin) & (along < 1 - margin) & (other >= -1e-9) & (other <= 1 + 1e-9)
        return np.asarray(inside & (across != 0.0))

    def _arcs(self, ways: FloatArray, piece: IntArray) -> BoolArray:
        """(k,) whether each way crosses its arc; ways as in `_lines`."""
        x, y, way_x, way_y, margin = ways
        centre_x, centre_y, spoke_x, spoke_y, radius_square, sweep = self._arc_columns.take(
            piece, axis=1
        )
        gap_x, gap_y = x - centre_x, y - centre_y
        square = np.maximum(way_x * way_x + way_y * way_y, 1e-300)
        half = gap_x * way_x + gap_y * way_y
        rest = gap_x * gap_x + gap_y * gap_y - radius_square
        root = half * half - square * rest
        step = np.sqrt(np.maximum(root, 0.0))
        # where the way meets the circle, coming and going
        along = np.stack([-half - step, -half + step]) / square
        found = (root > 0) & (along > margin) & (along < 1 - margin)
        _, pair = found.nonzero()
        hit = np.zeros(len(x), dtype=bool)
        if not len(pair):
            return hit
        along = along[found]
        place_x, place_y = gap_x[pair] + along * way_x[pair], gap_y[pair] + along * way_y[pair]
        spoke_x, spoke_y, sweep = spoke_x[pair], spoke_y[pair], sweep[pair]
        turn = np.arctan2(
            spoke_x * place_y - spoke_y * place_x, spoke_x * place_x + spoke_y * place_y
        )
        swept = np.mod(turn * np.sign(sweep) + 1e-9, 2 * np.pi)
        hit[pair[swept <= np.abs(sweep) + 2e-9]] = True
        return hit


def _all(sides: BoolArray) -> BoolArray:
    """Where all four tables (4, ...) hold."""
    both = sides[:2] & sides[2:]
    return np.asarray(both[0] & both[1])


def _boxes(
    start: FloatArray, end: FloatArray, centre: FloatArray, sweep: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(n, 2) corners of upright boxes that hold lines and arcs, 1e-6 mm to spare."""
    spoke = start - centre
    radius = np.where(sweep != 0.0, np.hypot(spoke[:, 0], spoke[:, 1]), 0.0)
    # an arc of up to half a turn is within its sagitta of the chord
    bulge = np.where(np.abs(sweep) <= np.pi, radius * (1 - np.cos(np.abs(sweep) / 2)), 2 * radius)
    spare = (bulge + 1e-6)[:, None]
    return np.minimum(start, end) - spare, np.maximum(start, end) + spare


class Interior:
    """A component, its rings included: which straight ways between its points stay in it.

    A way between two points of it that meets no ring in between lies in it or outside; its
    middle tells which.
    """

    def __init__(self, axis: Clearance, rings: Sequence[Path], distance: float) -> None:
        self._axis = axis
        self._rings = RingSet(rings)
        self._distance = distance

    def holds(
        self,
        starts: FloatArray,
        ends: FloatArray,
        tolerance: float = 1e-3,
        certain: BoolArray | None = None,
    ) -> BoolArray:
        """Whether each straight way stays inside; ends (m, 2) must be points of it, mm.

        `certain` (m,) says which ways have an end that is no point of a ring: these cannot lie
        outside if they cross none.
        """
        inside = ~self._rings.crossed(starts, ends)
        open_ = inside if certain is None else inside & ~certain
        chosen = np.flatnonzero(open_)
        if len(chosen):
            middle = (starts[chosen] + ends[chosen]) / 2
            inside[chosen] = self._axis.clearance(middle) >= self._distance - tolerance
        return inside


@dataclass(frozen=True)
class Crossings:
    """Pairs of places where two rings are near each other, as columns.

    Attributes
    ----------
    from_along, to_along : (m,) float arrays
        Arc lengths on either ring, mm.
    starts, ends : (m, 2) float arrays
        The places.
    distance : (m,) float array
        Between them, mm.
    """

    from_along: FloatArray
    to_along: FloatArray
    starts: FloatArray
    ends: FloatArray
    distance: FloatArray

    def target(self, row: int) -> Nearest:
        """The place on the second ring of one pair."""
        return Nearest(float(self.to_along[row]), self.ends[row], float(self.distance[row]))


def crossings(from_ring: Path, to_ring: Path, count: int = 8) -> Crossings:
    """The `count` nearest pairs of places of two rings, and as many spread over the first.

    Found on samples: good enough to choose where to cross, since the crossing is proven
    afterwards.
    """
    points, along = from_ring.sampled
    targets, other = to_ring.sampled
    distance, nearest = to_ring.tree.closest(points)
    order = np.argsort(distance, kind="stable")
    spread = order[np.linspace(0, len(order) - 1, count).astype(np.int64)]
    picked = np.concatenate([order[:count], spread])
    chosen = nearest[picked]
    return Crossings(
        along[picked], other[chosen], points[picked], targets[chosen], distance[picked]
    )


@dataclass(frozen=True)
class Facing:
    """Pairs of a place on a front and a place on a ring, as columns.

    Attributes
    ----------
    from_owner : (m,) int array
        Of the ring of the front.
    starts, ends : (m, 2) float arrays
        The places.
    to_along, distance : (m,) float arrays
        Arc length on the ring; between the places, mm.
    """

    from_owner: IntArray
    starts: FloatArray
    ends: FloatArray
    to_along: FloatArray
    distance: FloatArray

    def take(self, rows: BoolArray) -> Facing:
        """Some of the pairs."""
        return Facing(
            self.from_owner[rows], self.starts[rows], self.ends[rows], self.to_along[rows],
            self.distance[rows],
        )  # fmt: skip

    def target(self, row: int) -> Nearest:
        """The place on the ring of one pair."""
        return Nearest(float(self.to_along[row]), self.ends[row], float(self.distance[row]))


class Front:
    """Rings that are cut, each with the number of its component, on samples."""

    def __init__(self, rings: Sequence[tuple[int, Path]]) -> None:
        samples = [ring.sampled[0] for _, ring in rings]
        self._points = np.concatenate(samples)
        self._owner: IntArray = np.repeat(
            np.array([owner for owner, _ in rings], dtype=np.int64), [len(it) for it in samples]
        )

    @cached_property
    def _tree(self) -> Places:
        return Places(self._points)

    def near(
        self, point: FloatArray, inside: Interior, count: int = 8
    ) -> list[tuple[int, FloatArray, float]]:
        """Component, place and distance of the nearest places that a straight way leads to."""
        count = min(count, len(self._points))
        distance, index = few_nearest(self._points, point, count)
        good = inside.holds(np.repeat(point[None], count, axis=0), self._points[index])
        _, first = np.unique(self._owner[index[good]], return_index=True)
        chosen = np.flatnonzero(good)[np.sort(first)]
        return [
            (int(self._owner[index[row]]), self._points[index[row]], float(distance[row]))
            for row in chosen
        ]

    def facing(self, rings: Sequence[Path], inside: Interior, count: int = 8) -> list[Facing]:
        """Places of each ring near the front, the nearest and some spread over it, held by
        straight ways."""
        pairs = [self._pairs(ring, count) for ring in rings]
        if not pairs:
            return []
        good = inside.holds(
            np.concatenate([pair.starts for pair in pairs]),
            np.concatenate([pair.ends for pair in pairs]),
        )
        shares = np.split(good, np.cumsum([len(pair.distance) for pair in pairs])[:-1])
        return [pair.take(share) for pair, share in zip(pairs, shares, strict=True)]

    def _pairs(self, ring: Path, count: int) -> Facing:
        """Places of a ring, the `count` nearest to the front and as many spread over it."""
        points, along = ring.sampled
        distance, index = self._tree.closest(points)
        order = np.argsort(distance, kind="stable")
        spread = order[np.linspace(0, len(order) - 1, count).astype(np.int64)]
        picked = np.unique(np.concatenate([order[:count], spread]))
        chosen = index[picked]
        return Facing(
            self._owner[chosen], self._points[chosen], points[picked], along[picked],
            distance[picked],
        )  # fmt: skip


def walked(ring: Path, along: FloatArray) -> FloatArray:
    """(m,) length of the shorter way along a closed ring from its start, mm."""
    return np.minimum(along, ring.length - along)


def walk(ring: Path, along: float) -> Path | None:
    """The shorter way along a closed ring from its start to arc length `along`."""
    if along <= SAME or along >= ring.length - SAME:
        return None
    if along <= ring.length / 2:
        return ring.slice(0.0, along)
    return ring.slice(along, ring.length).reversed()


def straight(start: FloatArray, end: FloatArray) -> Path | None:
    """Straight way, None where the places are the same to 1e-9 mm."""
    return None if math.dist(start, end) <= SAME else segment(start, end)
