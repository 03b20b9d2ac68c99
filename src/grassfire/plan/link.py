"""Ways from one place to another at one depth, proven to keep clear of the walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from grassfire.plan.path import BoolArray, IntArray, Nearest, Path, nearest_on_pieces, segment
from grassfire.toolpath import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

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
        count = np.array([len(ring) for ring in self.rings])
        self._owner: IntArray = np.repeat(np.arange(len(self.rings)), count)
        self._first: IntArray = np.cumsum(count) - count
        self._start = np.concatenate([ring.points[:-1] for ring in self.rings])
        self._end = np.concatenate([ring.points[1:] for ring in self.rings])
        self._centre = np.concatenate([ring.centre for ring in self.rings])
        self._sweep = np.concatenate([ring.sweep for ring in self.rings])
        self._low, self._high = _boxes(self._start, self._end, self._centre, self._sweep)

    def nearest_left(self, point: FloatArray, count: int = 1) -> list[RingPlace]:
        """Nearest places on the `count` nearest rings that are left, nearest first."""
        use = self.left[self._owner]
        fraction, distance = nearest_on_pieces(
            self._start[use], self._end[use], self._centre[use], self._sweep[use], point
        )
        owner, index = self._owner[use], np.flatnonzero(use)
        best = np.full(len(self.rings), np.inf)
        np.minimum.at(best, owner, distance)
        order = [
            int(ring) for ring in np.argsort(best, kind="stable")[:count] if np.isfinite(best[ring])
        ]
        places = []
        for ring in order:
            mine = np.flatnonzero(owner == ring)
            chosen = int(mine[np.argmin(distance[mine])])
            path = self.rings[ring]
            local = int(index[chosen] - self._first[ring])
            along = float(path.cumulative[local] + fraction[chosen] * path.lengths[local])
            place = Nearest(along, path.at(np.array([along]))[0], float(distance[chosen]))
            places.append(RingPlace(ring, place))
        return places

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
        hit = np.zeros(len(starts), dtype=bool)
        if not len(starts):
            return hit
        low, high = np.minimum(starts, ends), np.maximum(starts, ends)
        near = np.flatnonzero(
            np.all((self._low <= high.max(axis=0)) & (self._high >= low.min(axis=0)), axis=1)
        )
        meet = self._low[near, 0] <= high[:, :1]
        meet &= self._high[near, 0] >= low[:, :1]
        meet &= self._low[near, 1] <= high[:, 1:]
        meet &= self._high[near, 1] >= low[:, 1:]
        row, piece = np.nonzero(meet)
        piece = near[piece]
        way = ends - starts
        margin = np.minimum(END / np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-300), 0.5)
        arc = self._sweep[piece] != 0.0
        for chosen, test in ((~arc, self._lines), (arc, self._arcs)):
            rows, pieces = row[chosen], piece[chosen]
            hit[rows[test(starts[rows], way[rows], margin[rows], pieces)]] = True
        return hit

    def _lines(
        self, start: FloatArray, way: FloatArray, margin: FloatArray, piece: IntArray
    ) -> BoolArray:
        """(k,) whether each way crosses its line."""
        side = self._end[piece] - self._start[piece]
        gap = self._start[piece] - start
        across = way[:, 0] * side[:, 1] - way[:, 1] * side[:, 0]
        safe = np.where(across == 0.0, 1.0, across)
        along = (gap[:, 0] * side[:, 1] - gap[:, 1] * side[:, 0]) / safe
        other = (gap[:, 0] * way[:, 1] - gap[:, 1] * way[:, 0]) / safe
        inside = (along > margin) & (along < 1 - margin) & (other >= -1e-9) & (other <= 1 + 1e-9)
        return np.asarray(inside & (across != 0.0))

    def _arcs(
        self, start: FloatArray, way: FloatArray, margin: FloatArray, piece: IntArray
    ) -> BoolArray:
        """(k,) whether each way crosses its arc."""
        centre, sweep = self._centre[piece], self._sweep[piece]
        spoke, gap = self._start[piece] - centre, start - centre
        square = np.maximum(np.sum(way * way, axis=1), 1e-300)
        half = np.sum(gap * way, axis=1)
        rest = np.sum(gap * gap, axis=1) - np.sum(spoke * spoke, axis=1)
        root = half * half - square * rest
        hit = np.zeros(len(start), dtype=bool)
        for sign in (-1.0, 1.0):
            along = (-half + sign * np.sqrt(np.maximum(root, 0.0))) / square
            chosen = np.flatnonzero((root > 0) & (along > margin) & (along < 1 - margin))
            place = gap[chosen] + along[chosen, None] * way[chosen]
            first = spoke[chosen]
            turn = np.arctan2(
                first[:, 0] * place[:, 1] - first[:, 1] * place[:, 0],
                np.sum(first * place, axis=1),
            )
            swept = np.mod(turn * np.sign(sweep[chosen]) + 1e-9, 2 * np.pi)
            hit[chosen[swept <= np.abs(sweep[chosen]) + 2e-9]] = True
        return hit


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
    distance, nearest = to_ring.tree.query(points)
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
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree

        return cKDTree(self._points)

    def near(
        self, point: FloatArray, inside: Interior, count: int = 8
    ) -> list[tuple[int, FloatArray, float]]:
        """Component, place and distance of the nearest places that a straight way leads to."""
        count = min(count, len(self._points))
        distance, index = self._tree.query(point, k=np.arange(1, count + 1))
        good = inside.holds(np.repeat(point[None], count, axis=0), self._points[index])
        _, first = np.unique(self._owner[index[good]], return_index=True)
        chosen = np.flatnonzero(good)[np.sort(first)]
        return [
            (int(self._owner[index[row]]), self._points[index[row]], float(distance[row]))
            for row in chosen
        ]

    def facing(self, ring: Path, inside: Interior, count: int = 8) -> Facing:
        """Places of a ring near the front, the nearest and some spread over it, held by straight
        ways."""
        points, along = ring.sampled
        distance, index = self._tree.query(points)
        order = np.argsort(distance, kind="stable")
        spread = order[np.linspace(0, len(order) - 1, count).astype(np.int64)]
        picked = np.unique(np.concatenate([order[:count], spread]))
        starts, ends = self._points[index[picked]], points[picked]
        good = inside.holds(starts, ends)
        kept = picked[good]
        return Facing(
            self._owner[index[kept]], starts[good], ends[good], along[kept], distance[kept]
        )


def walked(ring: Path, along: FloatArray) -> FloatArray:
    """(m,) length of the shorter way along a closed ring from its start, mm."""
    return np.minimum(along, ring.length - along)


def walk(ring: Path, along: float) -> Path | None:
    """The shorter way along a closed ring from its start to arc length `along`."""
    if along <= 1e-9 or along >= ring.length - 1e-9:
        return None
    if along <= ring.length / 2:
        return ring.slice(0.0, along)
    return ring.slice(along, ring.length).reversed()


def straight(start: FloatArray, end: FloatArray) -> Path | None:
    """Straight way, None where the places are the same to 1e-9 mm."""
    if np.hypot(*(end - start)) <= 1e-9:
        return None
    return segment(start, end)
