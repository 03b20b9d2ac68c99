"""Medial axes by brute force: dense samples and golden sections, slow and independent.

It shares no code with the medial axis engine. Everything rests on two functions of the boundary:
the distance of a point to it, and the radius of the largest disk that touches it from inside at a
given place p with inward normal n,

    r(p) = min over boundary points q with n.(q - p) > 0 of |q - p|^2 / (2 n.(q - p)).

Close to p the quotient loses all digits. There the divided differences of the polynomials are
taken: with h the step of the parameter, q - p = h D and n.(q - p) = h^2 E, where D and E are
polynomials in h; across a joint both sides are expanded about the joint. So disks are right to
rounding up to the ends of the axis on polynomial pieces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grassfire.geometry import Arc, Curve, Line, Region

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
_FINE = 128
"""Samples about a foot next to a centre of curvature."""
_APART = 1e-3
"""Least separation of feet that can be told apart."""


def minimise(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, steps: int = 60
) -> tuple[FloatArray, FloatArray]:
    """Minima of many functions at once by golden sections: places and values."""
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = function(left), function(right)
    for _ in range(steps):
        down = at_left < at_right
        low, high = np.where(down, low, left), np.where(down, right, high)
        new = np.where(down, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        value = function(new)
        left, right, at_left, at_right = (
            np.where(down, new, right),
            np.where(down, left, new),
            np.where(down, value, at_right),
            np.where(down, at_left, value),
        )
    best = at_left < at_right
    return np.where(best, left, right), np.where(best, at_left, at_right)


@dataclass(frozen=True)
class Disks:
    """Largest disks at places of the boundary.

    Attributes
    ----------
    centre, radius : (n, 2) and (n,) arrays
    reach : (n,) array
        Distance between the two contacts; the smaller, the less is known on rational pieces.
    """

    centre: FloatArray
    radius: FloatArray
    reach: FloatArray

    @property
    def table(self) -> FloatArray:
        """(n, 3) x, y, r."""
        return np.column_stack([self.centre, self.radius])


@dataclass(frozen=True)
class Boundary:
    """Pieces of a region's boundary, the region on the left, as rational polynomials of t.

    Attributes
    ----------
    power : (n, 4, 3) array
        Coefficients of 1, t, t^2, t^3 for (w x, w y, w).
    before, after : (n,) arrays
        Neighbouring pieces.
    bend : (n,) array
        Signed curvature of lines and arcs, NaN for others.
    samples : int
        Per piece.
    """

    power: FloatArray
    before: IntArray
    after: IntArray
    bend: FloatArray
    samples: int

    @classmethod
    def of(cls, region: Region, samples: int = 24) -> Boundary:
        """The boundary of a region whose pieces are at most cubic."""
        rows: list[FloatArray] = []
        before: list[int] = []
        after: list[int] = []
        bend: list[float] = []
        for loop in region.loops:
            first = len(rows)
            for curve in loop.curves:
                for bezier in curve.to_beziers():
                    rows.append(power_form(bezier.control_points, bezier.weights))
                    bend.append(constant_curvature(curve))
            count = len(rows) - first
            before += [first + (k - 1) % count for k in range(count)]
            after += [first + (k + 1) % count for k in range(count)]
        return cls(np.array(rows), np.array(before), np.array(after), np.array(bend), samples)

    @property
    def rational(self) -> BoolArray:
        """(n,) whether a piece has a denominator."""
        return np.asarray(np.any(self.power[:, 1:, 2] != 0, axis=1))

    def evaluate(self, piece: IntArray, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points and first and second derivatives by t, each (..., 2)."""
        table, step = self.power[piece], np.asarray(t)[..., None]
        value = ((table[..., 3, :] * step + table[..., 2, :]) * step + table[..., 1, :]) * step
        value = value + table[..., 0, :]
        slope = (3 * table[..., 3, :] * step + 2 * table[..., 2, :]) * step + table[..., 1, :]
        bend = 6 * table[..., 3, :] * step + 2 * table[..., 2, :]
        weight = value[..., 2:]
        point = value[..., :2] / weight
        first = (slope[..., :2] - slope[..., 2:] * point) / weight
        second = (bend[..., :2] - bend[..., 2:] * point - 2 * slope[..., 2:] * first) / weight
        return point, first, second

    def frame(self, piece: IntArray, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points, inward unit normals and signed curvatures."""
        point, first, second = self.evaluate(piece, t)
        speed = np.hypot(first[..., 0], first[..., 1])
        normal = np.stack([-first[..., 1], first[..., 0]], axis=-1) / speed[..., None]
        curvature = (first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]) / speed**3
        return point, normal, curvature

    def wrap(self, piece: IntArray, t: FloatArray) -> tuple[IntArray, FloatArray]:
        """The same place where t in [-1, 2] has left its piece for a neighbour."""
        moved = np.where(t < 0, self.before[piece], np.where(t >= 1, self.after[piece], piece))
        return moved, np.where(t < 0, t + 1, np.where(t >= 1, t - 1, t))

    @cached_property
    def grid(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Samples in order along the boundary: piece, t, point."""
        piece = np.repeat(np.arange(len(self.power)), self.samples)
        t = np.tile(np.arange(self.samples) / self.samples, len(self.power))
        return piece, t, self.evaluate(piece, t)[0]

    @cached_property
    def neighbours(self) -> tuple[IntArray, IntArray]:
        """Numbers of the samples before and after each."""
        number = np.arange(len(self.power) * self.samples).reshape(-1, self.samples)
        previous, following = np.roll(number, 1, axis=1), np.roll(number, -1, axis=1)
        previous[:, 0], following[:, -1] = number[self.before, -1], number[self.after, 0]
        return previous.ravel(), following.ravel()

    # -- distance ---------------------------------------------------------------------------------

    def feet(
        self, points: FloatArray, slack: float = 0.0
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Local minima of the distance that come within `slack` of the least distance.

        Returns
        -------
        row : (k,) index of the point, foot : (k, 2), distance : (k,)
        """
        piece, t, sample = self.grid
        previous, following = self.neighbours
        spacing = np.hypot(*(sample[following] - sample).T).max()
        rows, columns = [], []
        for start in range(0, len(points), 256):
            block = points[start : start + 256, None]
            away = np.hypot(block[..., 0] - sample[:, 0], block[..., 1] - sample[:, 1])
            low = (away <= away[:, previous]) & (away <= away[:, following])
            low &= away <= away.min(axis=1, keepdims=True) + spacing + slack
            row, column = np.nonzero(low)
            rows.append(row + start)
            columns.append(column)
        row, column = np.concatenate(rows), np.concatenate(columns)
        base, middle, step = piece[column], t[column], 1.0 / self.samples
        place = self._nearest(points[row], base, middle, step)
        foot, distance, twin = self._measured(points[row], base, place)
        # Next to a centre of curvature two feet may lie between three samples.
        row_of, at = self._twins(points[row[twin]], base[twin], place[twin], step)
        owner, fine = twin[row_of], 4.0 * step / _FINE
        again = self._nearest(points[row[owner]], base[owner], at, fine)
        other, away, _ = self._measured(points[row[owner]], base[owner], again)
        row = np.concatenate([row, row[owner]])
        foot, distance = np.concatenate([foot, other]), np.concatenate([distance, away])
        least = np.full(len(points), np.inf)
        np.minimum.at(least, row, distance)
        keep = distance <= least[row] + slack
        return row[keep], foot[keep], distance[keep]

    def _nearest(
        self, points: FloatArray, base: IntArray, middle: FloatArray, step: float
    ) -> FloatArray:
        """Parameters on the pieces `base`, within a step of the middle, nearest to the points."""

        def square(place: FloatArray) -> FloatArray:
            away = self.evaluate(*self.wrap(base, place))[0] - points
            return np.asarray(np.sum(away * away, axis=1))

        place, value = minimise(square, middle - step, middle + step)
        # Corners are samples themselves.
        return np.where(square(middle) <= value, middle, place)

    def _measured(
        self, points: FloatArray, base: IntArray, place: FloatArray
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Feet, their distances, and the rows whose points are near the centre of curvature."""
        foot, _, curvature = self.frame(*self.wrap(base, place))
        distance = np.hypot(*(foot - points).T)
        return foot, distance, np.flatnonzero(np.abs(1 - curvature * distance) < 0.1)

    def _twins(
        self, points: FloatArray, base: IntArray, place: FloatArray, step: float
    ) -> tuple[IntArray, FloatArray]:
        """Row and parameter of the local minima of the distance among fine samples about feet."""
        at = place[:, None] + step * np.linspace(-2.0, 2.0, _FINE + 1)
        wide = np.broadcast_to(base[:, None], at.shape)
        away = self.evaluate(*self.wrap(wide, at))[0] - points[:, None]
        value = np.hypot(away[..., 0], away[..., 1])
        low = (value[:, 1:-1] <= value[:, :-2]) & (value[:, 1:-1] <= value[:, 2:])
        row, column = np.nonzero(low)
        return row, at[row, column + 1]

    def distance(self, points: FloatArray) -> FloatArray:
        """Distance of points (n, 2) to the boundary."""
        row, _, distance = self.feet(points)
        least = np.full(len(points), np.inf)
        np.minimum.at(least, row, distance)
        return least

    # -- largest disks ----------------------------------------------------------------------------

    def quotient(
        self, piece: IntArray, t: FloatArray, other: IntArray, place: FloatArray
    ) -> FloatArray:
        """|q - p|^2 / (2 n.(q - p)) for p at (piece, t) and q at (other, place); inf behind p."""
        point, normal, _ = self.frame(piece, t)
        chord = self.evaluate(other, place)[0] - point
        top, down = np.sum(chord * chord, axis=-1), np.sum(chord * normal, axis=-1)
        plain = ~(self.rational[piece] | self.rational[other])
        for kind, sign in ((piece, 0), (self.after[piece], 1), (self.before[piece], -1)):
            near = np.flatnonzero(plain & (other == kind))
            if len(near):
                top[near], down[near] = self.close(
                    piece[near], t[near], other[near], place[near], normal[near], sign
                )
        with np.errstate(divide="ignore", invalid="ignore"):
            result = np.where(down > 0, top / (2 * down), np.inf)
        bend = np.where(other == piece, self.bend[piece], np.nan)
        known = ~np.isnan(bend)
        with np.errstate(divide="ignore"):
            result[known] = np.where(bend[known] > 0, 1 / bend[known], np.inf)
        return result

    def close(
        self,
        piece: IntArray,
        t: FloatArray,
        other: IntArray,
        place: FloatArray,
        normal: FloatArray,
        sign: int,
    ) -> tuple[FloatArray, FloatArray]:
        """|q - p|^2 and n.(q - p), both divided by the square of a step, without cancellation."""
        own = self.power[piece][..., :2]
        first = (3 * own[:, 3] * t[:, None] + 2 * own[:, 2]) * t[:, None] + own[:, 1]
        second = 3 * own[:, 3] * t[:, None] + own[:, 2]
        third = own[:, 3]
        step = ((1 - t) if sign > 0 else -t) if sign else place - t
        reach = first + (second + third * step[:, None]) * step[:, None]
        rise = np.sum(normal * (second + third * step[:, None]), axis=1)
        if not sign:
            return np.sum(reach * reach, axis=1), rise
        away = self.power[other][..., :2]
        far = place if sign > 0 else place - 1
        if sign < 0:
            away = np.stack(
                [away.sum(axis=1), away[:, 1] + 2 * away[:, 2] + 3 * away[:, 3],
                 away[:, 2] + 3 * away[:, 3], away[:, 3]], axis=1
            )  # fmt: skip
        rest = far[:, None] * (away[:, 1] + (away[:, 2] + away[:, 3] * far[:, None]) * far[:, None])
        chord = step[:, None] * reach + rest
        down = step**2 * rise + np.sum(normal * rest, axis=1)
        return np.sum(chord * chord, axis=1), down

    def disks(self, piece: IntArray, t: FloatArray, best: int = 6) -> Disks:
        """Largest disks that touch at the places (piece, t)."""
        grid_piece, grid_t, _ = self.grid
        previous, following = self.neighbours
        rows, columns = [], []
        for start in range(0, len(piece), 128):
            part = slice(start, start + 128)
            value = self._on_grid(piece[part], t[part])
            low = (value <= value[:, previous]) & (value <= value[:, following])
            low &= np.isfinite(value)
            ranked = np.where(low, value, np.inf)
            column = np.argsort(ranked, axis=1, kind="stable")[:, :best]
            row = np.broadcast_to(np.arange(len(value))[:, None], column.shape)
            good = np.isfinite(np.take_along_axis(ranked, column, axis=1))
            rows.append(row[good] + start)
            columns.append(column[good])
        row, column = np.concatenate(rows), np.concatenate(columns)
        base, middle, step = grid_piece[column], grid_t[column], 1.0 / self.samples
        own, at = piece[row], t[row]

        def value_of(place: FloatArray) -> FloatArray:
            return self.quotient(own, at, *self.wrap(base, place))

        place, value = minimise(value_of, middle - step, middle + step)
        at_sample = value_of(middle)
        place = np.where(at_sample <= value, middle, place)
        value = np.minimum(value, at_sample)
        radius = np.full(len(piece), np.inf)
        np.minimum.at(radius, row, value)
        point, normal, curvature = self.frame(piece, t)
        winner = np.zeros(len(piece), dtype=np.int64)
        hit = np.flatnonzero(value == radius[row])
        winner[row[hit]] = hit
        partner = self.evaluate(*self.wrap(base[winner], place[winner]))[0]
        with np.errstate(divide="ignore"):
            osculating = np.where(curvature > 0, 1 / curvature, np.inf)
        radius = np.minimum(radius, osculating)
        reach = np.hypot(*(partner - point).T)
        return Disks(point + radius[:, None] * normal, radius, reach)

    def _on_grid(self, piece: IntArray, t: FloatArray) -> FloatArray:
        """The quotient for every sample, (places, samples)."""
        grid_piece, grid_t, sample = self.grid
        point, normal, _ = self.frame(piece, t)
        chord = sample[None] - point[:, None]
        top = np.einsum("ijk,ijk->ij", chord, chord)
        down = np.einsum("ijk,ik->ij", chord, normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            result = np.where(down > 0, top / (2 * down), np.inf)
        # Samples on the same piece and its neighbours are those that cancel.
        for near in (piece, self.after[piece], self.before[piece]):
            column = near[:, None] * self.samples + np.arange(self.samples)
            row = np.repeat(np.arange(len(piece)), self.samples)
            flat = column.ravel()
            result[row, flat] = self.quotient(piece[row], t[row], grid_piece[flat], grid_t[flat])
        return np.asarray(result)

    # -- ends -------------------------------------------------------------------------------------

    def smooth_ends(self, accuracy: float) -> tuple[IntArray, FloatArray, FloatArray]:
        """Maxima of curvature whose osculating disks are empty: piece, t, disks (k, 3)."""
        piece, t, _ = self.grid
        previous, following = self.neighbours
        _, _, curvature = self.frame(piece, t)
        rising, falling = curvature >= curvature[previous], curvature > curvature[following]
        high = np.flatnonzero(rising & falling & (curvature > 0))
        base, middle, step = piece[high], t[high], 1.0 / self.samples

        def negative(place: FloatArray) -> FloatArray:
            return -self.frame(*self.wrap(base, place))[2]

        place, value = minimise(negative, middle - step, middle + step)
        better = negative(middle) <= value
        where = self.wrap(base, np.where(better, middle, place))
        point, normal, bend = self.frame(*where)
        centre = point + normal / bend[:, None]
        empty = self.distance(centre) >= 1 / bend - accuracy
        disks = np.column_stack([centre, 1 / bend])[empty]
        return where[0][empty], where[1][empty], disks


def constant_curvature(curve: Curve) -> float:
    """Signed curvature of a line or an arc, NaN of other curves."""
    if isinstance(curve, Arc):
        return float(np.sign(curve.sweep)) / curve.radius
    return 0.0 if isinstance(curve, Line) else float("nan")


def power_form(points: FloatArray, weights: FloatArray | None) -> FloatArray:
    """Power coefficients (4, 3) of a Bezier curve of degree up to 3."""
    degree = len(points) - 1
    if degree > 3:
        raise ValueError("the oracle takes pieces of degree 3 at most")
    weight = np.ones(degree + 1) if weights is None else np.asarray(weights)
    table = np.column_stack([points * weight[:, None], weight])
    basis = {
        1: [[1, 0], [-1, 1]],
        2: [[1, 0, 0], [-2, 2, 0], [1, -2, 1]],
        3: [[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]],
    }[degree]
    result = np.zeros((4, 3))
    result[: degree + 1] = np.array(basis, dtype=np.float64) @ table
    if weights is None:
        result[1:, 2] = 0.0
    return result


class ClaimedAxis:
    """Polynomial edges (x, y, r) that claim to be the axis.

    Parameters
    ----------
    edges : list of (degree + 1, 3) Bernstein coefficients
    vertices : (k, 3) array
    """

    def __init__(self, edges: list[FloatArray], vertices: FloatArray, samples: int = 33) -> None:
        self.vertices = vertices
        self.groups: list[tuple[int, FloatArray]] = []
        for size in sorted({len(edge) for edge in edges}):
            self.groups.append((size - 1, np.stack([e for e in edges if len(e) == size])))
        self.fraction = np.linspace(0.0, 1.0, samples)
        disks, group, row, place = [vertices], [np.full(len(vertices), -1)], [], []
        for number, (degree, table) in enumerate(self.groups):
            values = np.einsum("ti,eik->etk", bernstein_basis(degree, self.fraction), table)
            disks.append(values.reshape(-1, 3))
            group.append(np.full(len(table) * samples, number))
            row.append(np.repeat(np.arange(len(table)), samples))
            place.append(np.tile(self.fraction, len(table)))
        none = np.zeros(len(vertices), dtype=np.int64)
        self.disks, self.group = np.concatenate(disks), np.concatenate(group)
        self.row, self.place = np.concatenate([none, *row]), np.concatenate([0.0 * none, *place])
        self.tree = cKDTree(self.disks)

    def distance(self, disks: FloatArray, near: int = 192) -> FloatArray:
        """Distance in (x, y, r) of disks (n, 3) to the vertices and edges.

        The edges of the `near` nearest samples are looked at: more than meet at a vertex.
        """
        near = min(near, len(self.disks))
        away, index = self.tree.query(disks, k=near)
        away, index = away.reshape(len(disks), near), index.reshape(len(disks), near)
        best = away.min(axis=1)
        step = self.fraction[1]
        for number, (degree, table) in enumerate(self.groups):
            wanted, column = np.nonzero(self.group[index] == number)
            if not len(wanted):
                continue
            sample = index[wanted, column]
            coefficients, target = table[self.row[sample]], disks[wanted]
            middle = self.place[sample]

            def square(
                place: FloatArray,
                degree: int = degree,
                coefficients: FloatArray = coefficients,
                target: FloatArray = target,
            ) -> FloatArray:
                basis = bernstein_basis(degree, place)
                gap = np.einsum("ni,nik->nk", basis, coefficients) - target
                return np.asarray(np.sum(gap * gap, axis=1))

            low, high = np.maximum(middle - step, 0.0), np.minimum(middle + step, 1.0)
            np.minimum.at(best, wanted, np.sqrt(minimise(square, low, high)[1]))
        return np.asarray(best)


def bernstein_basis(degree: int, t: FloatArray) -> FloatArray:
    """Bernstein polynomials (n, degree + 1) at t (n,), by the triangle."""
    values = np.ones((len(t), 1))
    for _ in range(degree):
        raised = np.zeros((len(t), values.shape[1] + 1))
        raised[:, :-1] += (1 - t)[:, None] * values
        raised[:, 1:] += t[:, None] * values
        values = raised
    return values


def bisector_error(boundary: Boundary, disks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far disks (n, 3) are from touching twice: (error, separation).

    With distances d and d' to the two feet most apart, in unit directions a and a', the nearest
    point with two equal distances is |d - d'| / |a - a'| away (to first order). The separation is
    |a - a'|; below a thousandth the feet cannot be told apart and the first is the error of r only.
    """
    row, foot, distance = boundary.feet(disks[:, :2], slack=1e-4)
    direction = (foot - disks[row, :2]) / np.maximum(distance, 1e-300)[:, None]
    least = np.full(len(disks), np.inf)
    np.minimum.at(least, row, distance)
    nearest = np.zeros(len(disks), dtype=np.int64)
    hit = np.flatnonzero(distance == least[row])
    nearest[row[hit]] = hit
    apart = np.hypot(*(direction - direction[nearest][row]).T)
    excess = np.abs(distance - least[row])
    slip = np.where(apart > _APART, excess / np.maximum(apart, 1e-300), np.inf)
    best = np.full(len(disks), np.inf)
    np.minimum.at(best, row, slip)
    separation = np.zeros(len(disks))
    np.maximum.at(separation, row, np.where(np.isfinite(slip), apart, 0.0))
    error = np.abs(least - disks[:, 2]) + np.where(separation > 0, best, 0.0)
    return np.asarray(error), separation
