"""Exact distance of the tool's centre to the walls, for lines and true arcs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grassfire.verify.model import FloatArray
from grassfire.verify.path import BoolArray, IntArray, Path, spread
from grassfire.verify.raster import edges_of

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

_PAIRS = 400_000
"""Pairs of path piece and wall edge that are measured at once."""

_REFINED = 64
"""Stretches outside the walls that are measured closely at a time."""

_RADIUS_STEP = 2e-4
"""An arc whose radii differ is measured as circles whose radii differ by no more, mm."""


@dataclass(frozen=True)
class Stretch:
    """Parts of moves: rows of (move, from fraction, to fraction)."""

    move: IntArray
    since: FloatArray
    until: FloatArray


def stretches_between(path: Path, moves: IntArray, low: float, high: float) -> Stretch:
    """Return the parts of the given moves with low <= z < high, arcs cut to quarter turns."""
    z0, z1 = path.begin[moves, 2], path.end[moves, 2]
    rise = z1 - z0
    flat = np.abs(rise) < 1e-12
    divisor = np.where(flat, 1.0, rise)
    at_low, at_high = (low - z0) / divisor, (high - z0) / divisor
    within = (z0 >= low) & (z0 < high)
    since = np.where(flat, np.where(within, 0.0, 1.0), np.minimum(at_low, at_high)).clip(0, 1)
    until = np.where(flat, np.where(within, 1.0, 0.0), np.maximum(at_low, at_high)).clip(0, 1)
    # A vertical move counts where its lower end lies, even if that end is all that is inside.
    keep = until > since
    moves, since, until = moves[keep], since[keep], until[keep]
    turn = np.abs(path.sweep[moves]) * (until - since)
    change = np.abs(path.end_radius[moves] - path.start_radius[moves]) * (until - since)
    change = np.where(path.arc[moves], change, 0.0)
    parts = np.maximum(np.ceil(turn / (np.pi / 2) - 1e-9), np.ceil(change / _RADIUS_STEP - 1e-9))
    count = np.maximum(parts, 1).astype(np.int64)
    owner, step = spread(count)
    width = ((until - since) / count)[owner]
    begin = since[owner] + step * width
    return Stretch(moves[owner], begin, begin + width)


@dataclass(frozen=True)
class Clearance:
    """Signed distance of stretches to the walls: negative outside the region, mm.

    Exact where it is less than the reach that was asked for; `reach` elsewhere.
    """

    stretch: Stretch
    distance: FloatArray


class Walls:
    """The boundary of a region, indexed for distance queries."""

    def __init__(self, region: BaseGeometry) -> None:
        import shapely

        self.region = region
        shapely.prepare(region)
        self.boundary = region.boundary
        shapely.prepare(self.boundary)
        self.edges = edges_of(region)
        self._tree = shapely.STRtree(shapely.linestrings(self.edges.reshape(-1, 2, 2)))

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Return (m,) distances of (m, 2) points to the walls, negative outside, mm."""
        import shapely

        distance = shapely.distance(self.boundary, shapely.points(points))
        inside = shapely.contains_xy(self.region, points[:, 0], points[:, 1])
        return np.asarray(np.where(inside, distance, -distance), dtype=np.float64)

    def clearance(self, path: Path, stretch: Stretch, reach: FloatArray) -> Clearance:
        """Return the least signed distance of each stretch to the walls.

        Parameters
        ----------
        path : Path
        stretch : Stretch
        reach : (k,) array
            Distances beyond this are not told apart, mm.
        """
        import shapely

        start = path.point(stretch.move, stretch.since)
        stop = path.point(stretch.move, stretch.until)
        distance = np.array(reach, dtype=np.float64)
        half_turn = np.abs(path.sweep[stretch.move]) * (stretch.until - stretch.since) / 2
        radius = np.maximum(path.start_radius[stretch.move], path.end_radius[stretch.move])
        margin = reach + radius * (1 - np.cos(half_turn)) + 1e-9
        low = np.minimum(start[:, :2], stop[:, :2]) - margin[:, None]
        high = np.maximum(start[:, :2], stop[:, :2]) + margin[:, None]
        # Long slanted moves have boxes that cover everything; a query per thousands keeps memory
        # bounded all the same.
        for begin in range(0, len(stretch.move), 1024):
            part = slice(begin, begin + 1024)
            boxes = shapely.box(low[part, 0], low[part, 1], high[part, 0], high[part, 1])
            which, edge = self._tree.query(boxes)
            which = which + begin
            for first in range(0, len(which), _PAIRS):
                pair = slice(first, first + _PAIRS)
                found = self._pair_distance(path, stretch, start, stop, which[pair], edge[pair])
                np.minimum.at(distance, which[pair], found)
        inside = shapely.contains_xy(self.region, start[:, 0], start[:, 1])
        inside &= shapely.contains_xy(self.region, stop[:, 0], stop[:, 1])
        outside = np.flatnonzero(~inside | (distance < 1e-9))
        if len(outside):
            distance[outside] = self._deepest(path, stretch, outside)
        return Clearance(stretch, distance)

    def _pair_distance(
        self,
        path: Path,
        stretch: Stretch,
        start: FloatArray,
        stop: FloatArray,
        which: IntArray,
        edge: IntArray,
    ) -> FloatArray:
        """Return the distance of each pair of stretch and wall edge."""
        result = np.empty(len(which))
        a, b = start[which, :2], stop[which, :2]
        p, q = self.edges[edge, :2], self.edges[edge, 2:]
        arc = path.arc[stretch.move[which]]
        line = ~arc
        result[line] = _segment_to_segment(a[line], b[line], p[line], q[line])
        if arc.any():
            row = which[arc]
            move = stretch.move[row]
            middle = (stretch.since[row] + stretch.until[row]) / 2
            half = np.abs(path.sweep[move]) * (stretch.until[row] - stretch.since[row]) / 2
            angle = path.start_angle[move] + path.sweep[move] * middle
            radius = path.start_radius[move]
            radius = radius + (path.end_radius[move] - radius) * middle
            centre = path.centre[move]
            result[arc] = _arc_to_segment(
                centre, radius, angle, half, a[arc], b[arc], p[arc], q[arc]
            )
        return result

    def _deepest(self, path: Path, stretch: Stretch, rows: IntArray) -> FloatArray:
        """Return the least signed distance of stretches that leave the region, 0 at most.

        A program that is wrong all over has a great many. Those that may hold the least of all, and
        the first of each operation, are measured; the others get the lesser of their ends.
        """
        ends = np.minimum(
            self._distance_at(path, stretch, rows, np.zeros(len(rows))),
            self._distance_at(path, stretch, rows, np.ones(len(rows))),
        )
        result = np.minimum(ends, 0.0)
        span = path.planar[stretch.move[rows]] * (stretch.until[rows] - stretch.since[rows])
        # The distance changes no faster than the place.
        bound = ends - span / 2
        _, first = np.unique(path.operation[stretch.move[rows]], return_index=True)
        order = np.argsort(bound, kind="stable")
        order = np.concatenate([first, order[~np.isin(order, first)]])
        done = 0
        while done < len(order):
            batch = order[done : done + _REFINED]
            if done and not np.any(bound[batch] < result.min()):
                break
            result[batch] = np.minimum(self._refined(path, stretch, rows[batch]), 0.0)
            done += _REFINED
        return result

    def _refined(self, path: Path, stretch: Stretch, rows: IntArray) -> FloatArray:
        """Return the least signed distance of stretches by sampling.

        At most 100 samples find the place, 32 around the least one refine it: with slope at most 1
        the error is below a three-thousandth of the part's length.
        """
        span = path.planar[stretch.move[rows]] * (stretch.until[rows] - stretch.since[rows])
        number = np.clip(np.ceil(span / 0.1), 1, 100).astype(np.int64)
        owner, step = spread(number + 1)
        found = self._distance_at(path, stretch, rows[owner], step / number[owner])
        least = np.full(len(rows), np.inf)
        np.minimum.at(least, owner, found)
        order = np.flatnonzero(found == least[owner])
        best = np.zeros(len(rows))
        best[owner[order]] = (step / number[owner])[order]
        around = np.linspace(-1, 1, 33)[None, :] / number[:, None]
        around = (best[:, None] + around).clip(0, 1)
        finer = self._distance_at(path, stretch, np.repeat(rows, 33), around.ravel())
        return np.asarray(np.minimum(least, finer.reshape(-1, 33).min(axis=1)))

    def _distance_at(
        self, path: Path, stretch: Stretch, rows: IntArray, part: FloatArray
    ) -> FloatArray:
        """Return signed distances at the given parts of stretches."""
        fraction = stretch.since[rows] + part * (stretch.until[rows] - stretch.since[rows])
        return self.signed_distance(path.point(stretch.move[rows], fraction)[:, :2])

    def worst_place(self, path: Path, stretch: Stretch, row: int) -> tuple[float, float, float]:
        """Return where on one stretch the signed distance is least."""
        fraction = np.linspace(stretch.since[row], stretch.until[row], 513)
        points = path.point(np.full(len(fraction), stretch.move[row]), fraction)
        best = points[int(np.argmin(self.signed_distance(points[:, :2])))]
        return (float(best[0]), float(best[1]), float(best[2]))


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the cross product of (m, 2) vectors."""
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _point_to_segment(point: FloatArray, start: FloatArray, stop: FloatArray) -> FloatArray:
    """Return the distances of (m, 2) points to segments."""
    delta = stop - start
    squared = np.sum(delta**2, axis=1)
    part = np.sum((point - start) * delta, axis=1) / np.where(squared > 0, squared, 1.0)
    foot = start + delta * part.clip(0, 1)[:, None]
    gap = point - foot
    return np.asarray(np.hypot(gap[:, 0], gap[:, 1]))


def _segment_to_segment(a: FloatArray, b: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """Return the distances of segments ab to segments pq, 0 where they cross."""
    result = np.minimum(_point_to_segment(a, p, q), _point_to_segment(b, p, q))
    result = np.minimum(result, _point_to_segment(p, a, b))
    result = np.minimum(result, _point_to_segment(q, a, b))
    first = _cross(b - a, p - a) * _cross(b - a, q - a) < 0
    second = _cross(q - p, a - p) * _cross(q - p, b - p) < 0
    return np.where(first & second, 0.0, result)


def _on_arc(direction: FloatArray, angle: FloatArray, half: FloatArray) -> BoolArray:
    """Return whether directions from the centre point at the arc angle +- half."""
    turn = np.arctan2(direction[:, 1], direction[:, 0]) - angle
    turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
    return np.asarray(turn <= half)


def _arc_to_segment(
    centre: FloatArray,
    radius: FloatArray,
    angle: FloatArray,
    half: FloatArray,
    a: FloatArray,
    b: FloatArray,
    p: FloatArray,
    q: FloatArray,
) -> FloatArray:
    """Return the distances of arcs to segments pq, 0 where they cross.

    The arc (ends a, b) is centre + radius at angle +- half. Candidates: ends of the arc to the
    segment, ends of the segment to the arc along its normal, the foot of the centre on the segment,
    and crossings.
    """
    result = np.minimum(_point_to_segment(a, p, q), _point_to_segment(b, p, q))
    delta = q - p
    squared = np.sum(delta**2, axis=1)
    foot_part = np.sum((centre - p) * delta, axis=1) / squared
    foot = p + delta * foot_part[:, None]
    between = (foot_part >= 0) & (foot_part <= 1)
    for point, valid in ((p, True), (q, True), (foot, between)):
        ray = point - centre
        facing = _on_arc(ray, angle, half) & valid
        gap = np.abs(np.hypot(ray[:, 0], ray[:, 1]) - radius)
        result = np.where(facing, np.minimum(result, gap), result)
    height = np.hypot(*(foot - centre).T)
    reach = np.sqrt(np.maximum(radius**2 - height**2, 0) / squared)
    for side in (-1.0, 1.0):
        part = foot_part + side * reach
        hit = (height <= radius) & (part >= 0) & (part <= 1)
        ray = p + delta * part[:, None] - centre
        result = np.where(hit & _on_arc(ray, angle, half), 0.0, result)
    return result
