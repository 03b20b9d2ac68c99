"""Questions to the axis as a set of curves: points on it, nearest points, separation angles.

Edges are numbered as in `MedialAxis.edges`; a place on the axis is an edge and a fraction of its
parameter in [0, 1]. All functions take arrays of places or points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry.chebyshev import bernstein, gauss_rule
from grassfire.medial.edges import evaluate_span
from grassfire.medial.sites import FloatArray, IntArray, dot

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from grassfire.medial.axis import MedialAxis

_CHUNK = 20_000
"""Points that are looked up together: bounds the memory for their candidates."""


class Nearest(NamedTuple):
    """Nearest points of the axis, one row a query point.

    Attributes
    ----------
    edge : (n,) int array
        Edge index; -1 where the axis is a single vertex.
    fraction : (n,) float array
        Place on the edge, 0 to 1.
    point : (n, 2) float array
        mm.
    radius : (n,) float array
        Radius of the axis there, mm.
    """

    edge: IntArray
    fraction: FloatArray
    point: FloatArray
    radius: FloatArray


class AxisTable:
    """Polynomials of the kept edges, their ends at the vertices, relative to the sites' origin.

    Attributes
    ----------
    row : (n,) int array
        Row of the fit for each edge.
    start, end : (n,) int arrays
        Vertices as numbered by the axis.
    degree : (n,) int array
    """

    def __init__(self, axis: MedialAxis) -> None:
        fit, span = axis.fit, axis.fit.span
        used, number = axis._kept
        self.origin, self.size = axis.sites.origin, axis.sites.size
        self.vertex = np.column_stack([fit.vertex_centre, fit.vertex_radius])[used]
        self.row = np.flatnonzero(~axis.pruned)
        self.start, self.end = number[span.first[self.row]], number[span.last[self.row]]
        self.degree = np.asarray(fit.degree[self.row])
        self._first = fit.offset[self.row]
        self._control = fit.control.copy()
        # Nearly parallel contacts leave an end open along the axis; the vertex decides.
        self._control[self._first] = self.vertex[self.start]
        self._control[self._first + self.degree] = self.vertex[self.end]

    def __len__(self) -> int:
        return len(self.row)

    def control(self, edge: IntArray, degree: int) -> FloatArray:
        """(k, degree + 1, 3) Bezier coefficients (x, y, r) of edges of one degree."""
        return np.asarray(self._control[self._first[edge, None] + np.arange(degree + 1)])

    def evaluate(self, edge: IntArray, fraction: FloatArray, order: int = 0) -> FloatArray:
        """(k, 3) disks (x, y, r), or their derivative of the given order by the fraction."""
        result = np.zeros((len(edge), 3))
        degree = self.degree[edge]
        for value in np.unique(degree):
            members = np.flatnonzero(degree == value)
            table = self.control(edge[members], int(value))
            for level in range(order):
                table = max(value - level, 0) * np.diff(table, axis=1)
            if table.shape[1]:
                basis = bernstein(table.shape[1] - 1, fraction[members])
                result[members] = np.einsum("ij,ijk->ik", basis, table)
        return result

    def restricted(self, edge: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """(k, degree + 1, 3) coefficients of the parts from low to high, edges of one degree.

        By de Casteljau's algorithm, twice.
        """
        table = self.control(edge, int(self.degree[edge[0]]))
        count = table.shape[1]
        for step in range(1, count):
            share = high[:, None, None]
            table[:, step:] = (1 - share) * table[:, step - 1 : -1] + share * table[:, step:]
        share = (low / np.where(high > 0, high, 1.0))[:, None, None]
        for step in range(1, count):
            stop = count - step
            table[:, :stop] = (1 - share) * table[:, :stop] + share * table[:, 1 : stop + 1]
        return table

    def lengths(self, edge: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """(k,) arc lengths of parts of edges, mm: Gauss' rule of 16 points on eight panels."""
        node, weight = gauss_rule(16)
        panels = (np.arange(8)[:, None] + 0.5 * (node + 1)).ravel() / 8
        result = np.zeros(len(edge))
        degree = self.degree[edge]
        for value in np.unique(degree):
            rows = np.flatnonzero(degree == value)
            part = self.restricted(edge[rows], low[rows], high[rows])[:, :, :2]
            slope = value * np.diff(part, axis=1)
            if value == 1:
                result[rows] = np.hypot(slope[:, 0, 0], slope[:, 0, 1])
                continue
            velocity = bernstein(int(value) - 1, panels) @ slope
            speed = np.hypot(velocity[:, :, 0], velocity[:, :, 1])
            result[rows] = speed @ np.tile(weight, 8) / 16
        return result


# -- evaluation -----------------------------------------------------------------------------------


def checked_places(
    table: AxisTable, edge: ArrayLike, fraction: ArrayLike
) -> tuple[IntArray, FloatArray]:
    """Edges and fractions as two (n,) arrays.

    Raises
    ------
    GeometryError
        For an edge that is not there, or a fraction outside [0, 1].
    """
    index, place = np.broadcast_arrays(
        np.atleast_1d(np.asarray(edge, dtype=np.int64)),
        np.atleast_1d(np.asarray(fraction, dtype=np.float64)),
    )
    if np.any((index < 0) | (index >= len(table))):
        raise GeometryError(f"edges of this axis are numbered 0 to {len(table) - 1}")
    if not np.all((place >= 0) & (place <= 1)):
        raise GeometryError("a fraction of an edge lies between 0 and 1")
    return index.ravel(), place.ravel()


def checked_points(points: ArrayLike) -> FloatArray:
    """Points as an (n, 2) array.

    Raises
    ------
    GeometryError
        For another shape, or values that are not finite.
    """
    array = np.atleast_2d(np.asarray(points, dtype=np.float64))
    if array.ndim != 2 or array.shape[1] != 2:
        raise GeometryError(f"points must have shape (n, 2), got {np.shape(points)}")
    if not np.isfinite(array).all():
        raise GeometryError("points must be finite numbers")
    return array


def disk(axis: MedialAxis, edge: ArrayLike, fraction: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Centres (n, 2) and radii (n,) of the disks at places on the axis, mm.

    Parameters
    ----------
    edge : (n,) array_like of int
        Numbers in `axis.edges`; one for all is enough.
    fraction : (n,) array_like
        Parameters of the Bezier edges, 0 to 1.

    Raises
    ------
    GeometryError
        For an edge that is not there, or a fraction outside [0, 1].
    """
    table = axis.table
    values = table.evaluate(*checked_places(table, edge, fraction))
    return values[:, :2] + table.origin, values[:, 2]


def tangent(axis: MedialAxis, edge: ArrayLike, fraction: ArrayLike) -> FloatArray:
    """Unit tangents (n, 2) in the direction of growing fraction.

    Where an edge stands still (at a smooth end of the axis it may), the limit from inside.
    Places as for `disk`.
    """
    table = axis.table
    index, place = checked_places(table, edge, fraction)
    slope = table.evaluate(index, place, 1)[:, :2]
    speed = np.hypot(slope[:, 0], slope[:, 1])
    still = np.flatnonzero(speed <= 1e-9 * table.size)
    if len(still):
        # Near the end m' = (t - t0) m'': the direction is that of m'', away from the start.
        bend = table.evaluate(index[still], place[still], 2)[:, :2]
        slope[still] = np.where(place[still, None] > 0.5, -bend, bend)
        speed = np.hypot(slope[:, 0], slope[:, 1])
    return np.asarray(slope / np.where(speed > 0, speed, 1.0)[:, None])


def separation_angle(axis: MedialAxis, edge: ArrayLike, fraction: ArrayLike) -> FloatArray:
    """Angle between the two feet of a disk, seen from its centre, (n,) radians in [0, pi].

    2 acos(|r'| / |m'|) of the exact axis, taken from the feet themselves (the contacts on both
    sides), where it is well conditioned also for small angles: with the unit normals p and q at
    the feet, 2 atan2(|p - q|, |p + q|). At the ends of an edge it is the limit along the edge: near
    a convex corner the turn of the wall there, at a smooth end 0. Places as for `disk`.
    """
    table = axis.table
    index, place = checked_places(table, edge, fraction)
    if not len(index):
        return np.zeros(0)
    sites, span = axis.sites, axis.span.take(table.row[index])
    _, facing = evaluate_span(sites, span, place[:, None])
    parameter = span.parameter(place[:, None])[:, 0]
    near, far = (
        sites.frame(site, value)[1]
        for site, value in ((span.site, parameter), (span.partner, facing[:, 0]))
    )
    return np.asarray(2 * np.arctan2(np.hypot(*(near - far).T), np.hypot(*(near + far).T)))


# -- nearest points -------------------------------------------------------------------------------


class AxisIndex:
    """Parts of edges cut into short pieces that hardly bend, in a k-d tree.

    A Bezier curve of degree d stays within d (d - 1) / 8 times its largest second difference of
    its chord: chords bound distances from both sides, and Newton's method on the polynomial is
    only needed on the few pieces that may be nearest.
    """

    def __init__(self, table: AxisTable, edge: IntArray, low: FloatArray, high: FloatArray) -> None:
        self.table = table
        edge, low, high = self._cut(edge, low, high)
        order = np.lexsort((low, edge, table.degree[edge]))
        self.edge, self.low, self.high = edge[order], low[order], high[order]
        self.degree = table.degree[self.edge]
        self.control: dict[int, FloatArray] = {}
        self.first: dict[int, int] = {}
        count = len(self.edge)
        self.tail, self.head, self.sag = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros(count)
        for value in np.unique(self.degree):
            rows = np.flatnonzero(self.degree == value)
            part = table.restricted(self.edge[rows], self.low[rows], self.high[rows])[:, :, :2]
            self.control[int(value)], self.first[int(value)] = part, int(rows[0])
            self.tail[rows], self.head[rows] = part[:, 0], part[:, -1]
            self.sag[rows] = _sag(part)
        middle = 0.5 * (self.tail + self.head)
        self.reach = float(np.max(np.hypot(*(self.head - self.tail).T) / 2 + self.sag, initial=0.0))
        from scipy.spatial import cKDTree

        self.tree = cKDTree(middle)

    def _cut(
        self, edge: IntArray, low: FloatArray, high: FloatArray
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Parts short against the size of the region, and nearly straight."""
        table = self.table
        pieces = np.ones(len(edge), dtype=np.int64)
        for value in np.unique(table.degree[edge]):
            rows = np.flatnonzero(table.degree[edge] == value)
            part = table.restricted(edge[rows], low[rows], high[rows])[:, :, :2]
            step = np.diff(part, axis=1)
            length = np.hypot(step[:, :, 0], step[:, :, 1]).sum(axis=1)
            by_length = length / (table.size / 256)
            by_sag = np.sqrt(_sag(part) / (1e-4 * table.size))
            pieces[rows] = np.ceil(np.clip(np.maximum(by_length, by_sag), 1, 1024))
        source = np.repeat(np.arange(len(edge)), pieces)
        index = np.arange(len(source)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        count, width = pieces[source], (high - low)[source]
        begin = low[source] + width * (index / count)
        end = np.where(
            index + 1 == count, high[source], low[source] + width * ((index + 1) / count)
        )
        return edge[source], begin, end

    def query(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Edge and fraction of the nearest point for each of (n, 2) local points.

        Of places at the same distance the first in the order of edges is taken.
        """
        edge = np.zeros(len(points), dtype=np.int64)
        fraction = np.zeros(len(points))
        for begin in range(0, len(points), _CHUNK):
            rows = slice(begin, begin + _CHUNK)
            edge[rows], fraction[rows] = self._query(points[rows])
        return edge, fraction

    def _query(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        owner, piece, start = self._candidates(points)
        local, away = self._solve(points[owner], piece, start)
        place = self.low[piece] + (self.high - self.low)[piece] * local
        edge = self.edge[piece]
        least = np.full(len(points), np.inf)
        np.minimum.at(least, owner, away)
        tied = np.flatnonzero(away <= least[owner] * (1 + 1e-14) + 1e-15 * self.table.size)
        order = tied[np.lexsort((place[tied], edge[tied], owner[tied]))]
        _, head = np.unique(owner[order], return_index=True)
        best = order[head]
        return edge[best], np.clip(place[best], 0.0, 1.0)

    def _candidates(self, points: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Pairs of a point and a piece that may be nearest to it, and the place on the chord."""
        count = len(self.edge)
        few = min(4, count)
        _, near = self.tree.query(points, k=few)
        near = near.reshape(len(points), few)
        repeated = np.repeat(points, few, axis=0)
        away, _ = self._chord(repeated, near.ravel())
        bound = np.min((away + self.sag[near.ravel()]).reshape(-1, few), axis=1)
        # Rounding of coordinates must not hide the piece that the bound comes from.
        bound = bound * (1 + 1e-12) + 1e-13 * self.table.size
        lists = self.tree.query_ball_point(points, bound + self.reach)
        sizes = np.array([len(found) for found in lists], dtype=np.int64)
        owner = np.repeat(np.arange(len(points)), sizes)
        piece = np.concatenate([np.asarray(found, dtype=np.int64) for found in lists])
        away, place = self._chord(points[owner], piece)
        keep = np.flatnonzero(away - self.sag[piece] <= bound[owner])
        return owner[keep], piece[keep], place[keep]

    def _chord(self, points: FloatArray, piece: IntArray) -> tuple[FloatArray, FloatArray]:
        """Distance to the chord of a piece, and the fraction of the nearest point on it."""
        along = self.head[piece] - self.tail[piece]
        square = dot(along, along)
        offset = points - self.tail[piece]
        place = np.clip(dot(offset, along) / np.where(square > 0, square, 1.0), 0.0, 1.0)
        return np.hypot(*(offset - place[:, None] * along).T), place

    def _solve(
        self, points: FloatArray, piece: IntArray, start: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Nearest point on each piece: fraction of the piece, and distance."""
        local, away = start.copy(), np.zeros(len(piece))
        for value in np.unique(self.degree[piece]):
            rows = np.flatnonzero(self.degree[piece] == value)
            control = self.control[int(value)][piece[rows] - self.first[int(value)]]
            local[rows], away[rows] = _foot(control - points[rows, None], start[rows])
        return local, away


def _sag(part: FloatArray) -> FloatArray:
    """(k,) bounds on the distance of Bezier curves (k, d + 1, 2) to their chords."""
    degree = part.shape[1] - 1
    if degree < 2:
        return np.zeros(len(part))
    second = np.diff(part, n=2, axis=1)
    largest = np.hypot(second[:, :, 0], second[:, :, 1]).max(axis=1)
    return np.asarray(degree * (degree - 1) / 8 * largest)


def _foot(control: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameter in [0, 1] nearest to the origin, and its distance, for (k, d + 1, 2) curves.

    Newton's method on B . B' = 0, kept in a bracket about the best of nine samples.
    """
    degree = control.shape[1] - 1
    if degree < 2:
        place = control[:, 0] + start[:, None] * (control[:, -1] - control[:, 0])
        return start, np.hypot(place[:, 0], place[:, 1])
    sample = np.linspace(0.0, 1.0, 9)
    values = bernstein(degree, sample) @ control
    square = np.einsum("kni,kni->kn", values, values)
    best = np.argmin(square, axis=1)
    least, nearest = square[np.arange(len(best)), best], sample[best]
    left, right = np.maximum(nearest - 0.125, 0.0), np.minimum(nearest + 0.125, 1.0)
    inner = (best > 0) & (best < 8)
    place = np.where(inner, nearest, 0.5 * (left + right))
    first = degree * np.diff(control, axis=1)
    second = (degree - 1) * np.diff(first, axis=1)
    # Where the distance grows from an end on, the end it is.
    outward = [dot(values[:, index], first[:, index]) * sign for index, sign in ((0, 1), (-1, -1))]
    settled = ((best == 0) & (outward[0] > 0)) | ((best == 8) & (outward[1] > 0))
    place = np.where(settled, nearest, place)
    active = np.flatnonzero(~settled)
    for _ in range(60):
        t = place[active]
        one = np.einsum("ij,ijk->ik", bernstein(degree - 1, t), first[active])
        two = np.einsum("ij,ijk->ik", bernstein(degree - 2, t), second[active])
        zero = np.einsum("ij,ijk->ik", bernstein(degree, t), control[active])
        value, slope = dot(zero, one), dot(one, one) + dot(zero, two)
        right[active] = np.where(value > 0, t, right[active])
        left[active] = np.where(value <= 0, t, left[active])
        step = value / np.where(slope > 0, slope, 1.0)
        new = t - step
        inside = (slope > 0) & (new >= left[active]) & (new <= right[active])
        new = np.where(inside, new, 0.5 * (left[active] + right[active]))
        place[active] = new
        # Rounding of the point moves the foot by so much; it is the most that steps can resolve.
        speed = dot(one, one)
        blur = np.sqrt(dot(zero, zero) / np.where(speed > 0, speed, np.inf))
        active = active[(np.abs(new - t) > 1e-15 + 4e-16 * blur) & (value != 0)]
        if not len(active):
            break
    found = np.einsum("ij,ijk->ik", bernstein(degree, place), control)
    better = dot(found, found) <= least
    place, least = np.where(better, place, nearest), np.where(better, dot(found, found), least)
    # Where a curve stands still at its end the place is ill-determined: the end itself is best.
    for index, end in ((0, 0.0), (-1, 1.0)):
        at_end = square[:, index] <= least * (1 + 4e-16)
        place, least = np.where(at_end, end, place), np.where(at_end, square[:, index], least)
    return place, np.sqrt(least)


def nearest_axis_point(axis: MedialAxis, points: ArrayLike) -> Nearest:
    """Nearest point of the (kept) axis for each point.

    Parameters
    ----------
    points : (n, 2) array_like
        Anywhere in the plane, mm.

    Returns
    -------
    Nearest
        Named tuple (edge, fraction, point, radius) of arrays with n rows.

    Raises
    ------
    GeometryError
        For points of another shape or with values that are not finite.

    Notes
    -----
    Exact to rounding on the Bezier edges: pieces that may be nearest are found by bounds on their
    distance to their chords, then Newton's method solves (m - p) . m' = 0. Of places at the same
    distance the first in the order of edges is taken.

    Examples
    --------
    A rectangle 40 by 20 has its axis on the x-axis from -10 to 10, and four bisectors.

    >>> from grassfire.geometry import Line, Loop, Region
    >>> from grassfire.medial import medial_axis
    >>> corners = [(-20, -10), (20, -10), (20, 10), (-20, 10)]
    >>> sides = zip(corners, corners[1:] + corners[:1])
    >>> axis = medial_axis(Region(Loop(tuple(Line(a, b) for a, b in sides))))
    >>> near = axis.nearest_axis_point([(4.0, 3.0), (5.0, -2.0)])
    >>> near.point.round(9) + 0.0
    array([[4., 0.],
           [5., 0.]])
    >>> near.radius.round(9)
    array([10., 10.])
    """
    given = checked_points(points)
    table = axis.table
    if not len(table):
        return _at_vertex(table, len(given))
    edge, fraction = axis.index.query(given - table.origin)
    values = table.evaluate(edge, fraction)
    return Nearest(edge, fraction, values[:, :2] + table.origin, values[:, 2])


def _at_vertex(table: AxisTable, count: int) -> Nearest:
    """Every point's nearest is the only vertex."""
    return Nearest(
        np.full(count, -1, dtype=np.int64),
        np.zeros(count),
        np.tile(table.vertex[0, :2] + table.origin, (count, 1)),
        np.full(count, table.vertex[0, 2]),
    )


def whole_index(table: AxisTable) -> AxisIndex:
    """Index of all edges."""
    edge = np.arange(len(table))
    return AxisIndex(table, edge, np.zeros(len(table)), np.ones(len(table)))


__all__ = [
    "AxisIndex",
    "AxisTable",
    "Nearest",
    "disk",
    "nearest_axis_point",
    "separation_angle",
    "tangent",
]
