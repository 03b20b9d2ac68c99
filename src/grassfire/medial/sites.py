"""Boundary sites as columns: lines, arcs, spiral pieces of Bezier curves and reflex corners.

A *site* is a piece of the boundary that a maximal disk touches at most once: a line, an arc, a
piece of a (rational) Bezier curve with monotone curvature (a spiral: its osculating circles are
nested, Kneser 1912, so no disk touches it twice), or a reflex corner, whose parameter sweeps the
fan of its normals. All functions take arrays of site indices and parameters, so that thousands of
contacts are solved in one call. Coordinates are relative to the centre of the region's bounding
box.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class SiteKind(IntEnum):
    """Geometry of a site."""

    LINE = 0
    ARC = 1
    SPIRAL = 2
    POINT = 3


# Looked up in inner loops, where members of an enumeration cost as much as the work.
_LINE, _ARC, _SPIRAL, _POINT = (int(kind) for kind in SiteKind)


@dataclass(frozen=True)
class Sites:
    """Columns of boundary sites, in boundary order, one row a site.

    Attributes
    ----------
    kind : (m,) int array of SiteKind
    anchor : (m, 2) float array
        Line: start; arc: centre; point: the corner.
    extent : (m, 2) float array
        Line: end - start; arc: (start angle, sweep); point: (angle of the first normal, turn).
    radius : (m,) float array
        Arc radius, mm.
    low, high : (m,) float arrays
        Parameter range. 0 to 1 but for spirals, whose parameter is that of their Bezier curve.
    coefficients : (b, degree + 1, 3) float array
        Homogeneous power coefficients of the Bezier curves about parameter 1/2.
    bezier : (m,) int array
        Row of `coefficients`, -1 where the site is no spiral.
    following, preceding : (m,) int arrays
        Neighbours along the loop.
    corner_after : (m,) bool array
        Whether a convex corner ends the site.
    turn_after : (m,) float array
        Turn of that corner, or of a junction too flat to be one, radians.
    loop, curve : (m,) int arrays
        Loop index and index of the curve in its loop.
    origin : (2,) float array
        What was subtracted from all coordinates, mm.
    size : float
        Diagonal of the bounding box, mm.
    merged : float
        How far points of the boundary were moved at most to become one, mm.
    """

    kind: IntArray
    anchor: FloatArray
    extent: FloatArray
    radius: FloatArray
    low: FloatArray
    high: FloatArray
    coefficients: FloatArray
    bezier: IntArray
    following: IntArray
    preceding: IntArray
    corner_after: BoolArray
    turn_after: FloatArray
    loop: IntArray
    curve: IntArray
    origin: FloatArray
    size: float
    merged: float = 0.0

    def __len__(self) -> int:
        return len(self.kind)

    def spread(self, count: IntArray) -> tuple[IntArray, FloatArray]:
        """Sites and parameters of the middles of `count` (m,) equal parts of every site."""
        site = np.repeat(np.arange(len(self)), count)
        index = np.arange(len(site)) - np.repeat(np.cumsum(count) - count, count)
        fraction = (index + 0.5) / count[site]
        return site, self.low[site] + (self.high[site] - self.low[site]) * fraction

    def derivatives(self, site: IntArray, parameter: FloatArray, order: int) -> list[FloatArray]:
        """Point and derivatives up to `order` (at most 3), each of shape (n, 2)."""
        kind = self.kind[site]
        spiral = np.flatnonzero(kind == _SPIRAL)
        if len(spiral) == len(site) > 0:
            return self._spiral(self.bezier[site], parameter, order)
        result = [np.zeros((len(site), 2)) for _ in range(order + 1)]
        result[0] += self.anchor[site]
        line = np.flatnonzero(kind == _LINE)
        if len(line):
            direction = self.extent[site[line]]
            result[0][line] += parameter[line, None] * direction
            if order:
                result[1][line] = direction
        arc = np.flatnonzero(kind == _ARC)
        if len(arc):
            start, sweep = self.extent[site[arc]].T
            angle = start + parameter[arc] * sweep
            unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            scale = self.radius[site[arc]]
            for power in range(order + 1):
                result[power][arc] += scale[:, None] * unit
                unit = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
                scale = scale * sweep
        if len(spiral):
            values = self._spiral(self.bezier[site[spiral]], parameter[spiral], order)
            for power in range(order + 1):
                result[power][spiral] = values[power]
        return result

    def _spiral(self, row: IntArray, parameter: FloatArray, order: int) -> list[FloatArray]:
        return evaluate_rational(self.coefficients[row], parameter, order)

    def point(self, site: IntArray, parameter: FloatArray) -> FloatArray:
        """(n, 2) boundary points."""
        return self.derivatives(site, parameter, 0)[0]

    def frame(
        self, site: IntArray, parameter: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points (n, 2), inward unit normals (n, 2) and signed curvatures (n,).

        The curvature of a reflex corner is minus infinity.
        """
        return self.moving_frame(site, parameter)[:3]

    def moving_frame(
        self, site: IntArray, parameter: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """As `frame`, and the length along the boundary per unit of parameter (n,), 0 in fans."""
        position, first, second = self.derivatives(site, parameter, 2)
        speed = np.hypot(first[:, 0], first[:, 1])
        is_point = self.kind[site] == _POINT
        safe = np.where(speed > 0, speed, 1.0)
        normal = np.stack([-first[:, 1], first[:, 0]], axis=1) / safe[:, None]
        curvature = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / safe**3
        arc = self.kind[site] == _ARC
        if arc.any():
            curvature[arc] = np.sign(self.extent[site[arc], 1]) / self.radius[site[arc]]
        if is_point.any():
            start, turn = self.extent[site[is_point]].T
            angle = start + parameter[is_point] * turn
            normal[is_point] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            curvature[is_point] = -np.inf
        return position, normal, curvature, speed

    def speed(self, site: IntArray, parameter: FloatArray, radius: FloatArray) -> FloatArray:
        """(n,) length along the boundary (or the fan at `radius`) per unit of parameter."""
        first = self.derivatives(site, parameter, 1)[1]
        result = np.hypot(first[:, 0], first[:, 1])
        is_point = self.kind[site] == _POINT
        result[is_point] = np.abs(self.extent[site[is_point], 1]) * radius[is_point]
        return result

    # -- projection -------------------------------------------------------------------------------

    def project(
        self, target: IntArray, centre: FloatArray, hint: FloatArray, slack: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Nearest point of each target site to each centre: parameter and distance, (n,) each.

        Distances may be too large by `slack`, mm, and parameters are then less exact.
        """
        kind = self.kind[target]
        parameter = np.zeros(len(target))
        rows = np.flatnonzero(kind == _LINE)
        if len(rows):
            direction = self.extent[target[rows]]
            along = dot(centre[rows] - self.anchor[target[rows]], direction)
            parameter[rows] = np.clip(along / dot(direction, direction), 0.0, 1.0)
        rows = np.flatnonzero(kind == _ARC)
        if len(rows):
            parameter[rows] = self._project_arc(target[rows], centre[rows])
        rows = np.flatnonzero(kind == _SPIRAL)
        if len(rows):
            parameter[rows] = self._project_spiral(target[rows], centre[rows], hint[rows], slack)
        delta = centre - self.point(target, parameter)
        return parameter, np.hypot(delta[:, 0], delta[:, 1])

    def _project_arc(self, target: IntArray, centre: FloatArray) -> FloatArray:
        start, sweep = self.extent[target].T
        offset = centre - self.anchor[target]
        angle = np.arctan2(offset[:, 1], offset[:, 0])
        delta = np.remainder(angle - (start + sweep / 2) + np.pi, 2 * np.pi) - np.pi
        return np.asarray(np.clip(0.5 + delta / sweep, 0.0, 1.0))

    def _project_spiral(
        self, target: IntArray, centre: FloatArray, hint: FloatArray, slack: float
    ) -> FloatArray:
        low, high = self.low[target], self.high[target]
        parameter = np.clip(hint, low, high)
        best = parameter.copy()
        distance = np.full(len(target), np.inf)
        active = np.arange(len(target))
        # Centres of curvature are multiple roots: Newton is linear there and needs its time.
        for _ in range(60):
            value, span = parameter[active], (high - low)[active]
            point, first, second = self._spiral(self.bezier[target[active]], value, 2)
            offset = point - centre[active]
            squared = dot(offset, offset)
            better = squared < distance[active]
            best[active] = np.where(better, value, best[active])
            distance[active] = np.where(better, squared, distance[active])
            slope, flat = dot(offset, first), dot(first, first)
            # Beyond the evolute the second derivative is negative: the slope still tells the way.
            curve = np.maximum(np.abs(flat + dot(offset, second)), 1e-9 * flat)
            step = np.clip(-slope / curve, -0.5 * span, 0.5 * span)
            new = np.clip(value + step, low[active], high[active])
            parameter[active] = new
            # What the step gains, and what the slow ones at such roots may gain after it.
            gain = np.abs(slope * step)
            moving = np.abs(new - value) > 1e-12 * span
            active = active[moving & (gain >= 0.2 * slack * np.sqrt(squared))]
            if not len(active):
                break
        for end in (low, high):
            offset = self._spiral(self.bezier[target], end, 0)[0] - centre
            squared = dot(offset, offset)
            better = squared < distance
            best = np.where(better, end, best)
            distance = np.where(better, squared, distance)
        return best


def evaluate_rational(
    coefficients: FloatArray, parameter: FloatArray, order: int
) -> list[FloatArray]:
    """Point and derivatives up to `order` <= 3 of rational curves, power form about 1/2.

    Parameters
    ----------
    coefficients : (n, degree + 1, 3) float array
        Homogeneous coefficients (w x, w y, w), lowest power first, in powers of t - 1/2.
    parameter : (n,) float array

    Returns
    -------
    list of (n, 2) float arrays
    """
    if not coefficients[:, 1:, 2].any():
        return _polynomial(coefficients, parameter - 0.5, order)
    local = (parameter - 0.5)[:, None]
    degree = coefficients.shape[1] - 1
    values = [np.zeros((len(parameter), 3)) for _ in range(order + 1)]
    for power in range(degree, -1, -1):
        for index in range(order, 0, -1):
            values[index] = values[index] * local + index * values[index - 1]
        values[0] = values[0] * local + coefficients[:, power]
    weight = values[0][:, 2:]
    result = [values[0][:, :2] / weight]
    if order >= 1:
        result.append((values[1][:, :2] - values[1][:, 2:] * result[0]) / weight)
    if order >= 2:
        result.append(
            (values[2][:, :2] - 2 * values[1][:, 2:] * result[1] - values[2][:, 2:] * result[0])
            / weight
        )
    if order >= 3:
        result.append(
            (
                values[3][:, :2]
                - 3 * values[1][:, 2:] * result[2]
                - 3 * values[2][:, 2:] * result[1]
                - values[3][:, 2:] * result[0]
            )
            / weight
        )
    return result


def _polynomial(coefficients: FloatArray, local: FloatArray, order: int) -> list[FloatArray]:
    """Horner's rule for value and derivatives, (n, degree + 1, 3) coefficients of one weight each.

    Rows are taken as columns: short inner axes are slow.
    """
    table = np.ascontiguousarray(coefficients.T)
    weight, table = table[2, 0], table[:2]
    if not (weight == 1).all():
        table = table / weight
    degree = table.shape[1] - 1
    values = [table[:, degree]]
    for power in range(degree - 1, -1, -1):
        step = degree - power
        if step <= order:
            values.append(step * values[-1])
        for index in range(min(order, step - 1), 0, -1):
            values[index] = values[index] * local + index * values[index - 1]
        values[0] = values[0] * local + table[:, power]
    while len(values) <= order:
        values.append(np.zeros_like(values[0]))
    return [np.ascontiguousarray(value.T) for value in values]


def disk_through(chord: FloatArray, normal: FloatArray) -> FloatArray:
    """(A): radius of the disk tangent at p with normal n through q, `chord` being q - p.

    Infinite where q lies behind the tangent.
    """
    height = dot(chord, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = dot(chord, chord) / (2 * height)
    return np.where((height > 0) & np.isfinite(radius), radius, np.inf)


def dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """(n,) products of the rows of two (n, 2) arrays."""
    return np.asarray(np.einsum("ij,ij->i", first, second))
