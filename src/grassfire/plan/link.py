"""Ways from one place to another at one depth, proven to keep clear of the walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from grassfire.plan.path import BoolArray, IntArray, Nearest, Path, nearest_on_pieces, segment
from grassfire.toolpath import FloatArray

MOST_PROBES = 20_000
"""Clearance queries that one proof may take before the way counts as not proven."""


class Clearance(Protocol):
    """What a proof asks of a medial axis."""

    def clearance(self, points: FloatArray) -> FloatArray:
        """(n,) distance to the boundary, negative outside, mm."""


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
        way = ends - starts
        size = np.hypot(way[:, 0], way[:, 1])
        margin = np.minimum(END / np.maximum(size, 1e-300), 0.5)[:, None]
        line, arc = self._sweep == 0.0, self._sweep != 0.0
        hit = np.zeros(len(starts), dtype=bool)
        if line.any():
            hit |= _crosses_lines(starts, way, margin, self._start[line], self._end[line])
        if arc.any():
            hit |= _crosses_arcs(
                starts, way, margin, self._start[arc], self._centre[arc], self._sweep[arc]
            )
        return hit


END = 1e-6
"""Length at both ends of a way where touching a ring is no crossing, mm."""


def _crosses_lines(
    start: FloatArray, way: FloatArray, margin: FloatArray, begin: FloatArray, end: FloatArray
) -> BoolArray:
    side = end - begin
    gap = begin[None] - start[:, None]
    across = way[:, None, 0] * side[None, :, 1] - way[:, None, 1] * side[None, :, 0]
    safe = np.where(across == 0.0, 1.0, across)
    along = (gap[..., 0] * side[None, :, 1] - gap[..., 1] * side[None, :, 0]) / safe
    other = (gap[..., 0] * way[:, None, 1] - gap[..., 1] * way[:, None, 0]) / safe
    inside = (along > margin) & (along < 1 - margin) & (other >= -1e-9) & (other <= 1 + 1e-9)
    return np.asarray(np.any(inside & (across != 0.0), axis=1))


def _crosses_arcs(
    start: FloatArray,
    way: FloatArray,
    margin: FloatArray,
    begin: FloatArray,
    centre: FloatArray,
    sweep: FloatArray,
) -> BoolArray:
    spoke = begin - centre
    gap = start[:, None] - centre[None]
    square = np.maximum(np.sum(way * way, axis=1), 1e-300)[:, None]
    half = np.sum(gap * way[:, None], axis=-1)
    rest = np.sum(gap * gap, axis=-1) - np.sum(spoke * spoke, axis=-1)[None]
    root = half * half - square * rest
    hit = np.zeros(len(start), dtype=bool)
    for sign in (-1.0, 1.0):
        along = (-half + sign * np.sqrt(np.maximum(root, 0.0))) / square
        rows, arcs = np.nonzero((root > 0) & (along > margin) & (along < 1 - margin))
        place = gap[rows, arcs] + along[rows, arcs, None] * way[rows]
        first = spoke[arcs]
        turn = np.arctan2(
            first[:, 0] * place[:, 1] - first[:, 1] * place[:, 0], np.sum(first * place, axis=1)
        )
        swept = np.mod(turn * np.sign(sweep[arcs]) + 1e-9, 2 * np.pi)
        hit[rows[swept <= np.abs(sweep[arcs]) + 2e-9]] = True
    return hit


class Interior:
    """A component, its rings included: which straight ways between its points stay in it.

    A way between two points of it that meets no ring in between lies in it or outside; its
    middle tells which.
    """

    def __init__(self, axis: Clearance, rings: Sequence[Path], distance: float) -> None:
        self._axis = axis
        self._rings = RingSet(rings)
        self._distance = distance

    def holds(self, starts: FloatArray, ends: FloatArray, tolerance: float = 1e-3) -> BoolArray:
        """Whether each straight way stays inside; ends (m, 2) must be points of it, mm."""
        inside = ~self._rings.crossed(starts, ends)
        chosen = np.flatnonzero(inside)
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
