"""Boundary sites as columns: lines, arcs, spiral pieces of Bezier curves and reflex corners.

A *site* is a piece of the boundary that a maximal disk touches at most once: a line, an arc, a
piece of a (rational) Bezier curve with monotone curvature (a spiral: its osculating circles are
nested, Kneser 1912, so no disk touches it twice), or a reflex corner, whose parameter sweeps the
fan of its normals. All functions take arrays of site indices and parameters, so that thousands of
contacts are solved in one call. Coordinates are relative to the centre of the region's bounding
box.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


ROUNDED_TURN = 1e-12
"""Turn of a junction, radians, that rounding of the coordinates makes."""


class SiteKind:
    """Geometry of a site: plain numbers, as members of an enumeration are slow in inner loops."""

    LINE: Final = 0
    ARC: Final = 1
    SPIRAL: Final = 2
    POINT: Final = 3


class Runs(NamedTuple):
    """Runs of sites that are parts of one curve, (m,) each: the number of the run of each site and
    those of the runs after and before it, the parameters where its own begins and ends, and whether
    the junctions there turn by rounding only."""

    number: IntArray
    after: IntArray
    before: IntArray
    low: FloatArray
    high: FloatArray
    smooth_after: BoolArray
    smooth_before: BoolArray


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

    @cached_property
    def rational(self) -> BoolArray:
        """(b,) whether the weights of the Bezier curves differ."""
        return np.asarray(self.coefficients[:, 1:, 2].any(axis=1))

    @cached_property
    def all_polynomial(self) -> bool:
        """Whether no Bezier curve is rational."""
        return not self.rational.any()

    @cached_property
    def all_spirals(self) -> bool:
        """Whether there are no sites but spirals."""
        return bool((self.kind == SiteKind.SPIRAL).all())

    @cached_property
    def polynomial(self) -> FloatArray:
        """(2, degree + 1, b) power coefficients of x and y of the curves that are not rational."""
        table = np.ascontiguousarray(self.coefficients.T)
        return np.asarray(table[:2] / table[2, 0])

    def spread(self, count: IntArray) -> tuple[IntArray, FloatArray]:
        """Sites and parameters of the middles of `count` (m,) equal parts of every site."""
        site = np.repeat(np.arange(len(self)), count)
        index = np.arange(len(site)) - np.repeat(np.cumsum(count) - count, count)
        fraction = (index + 0.5) / count[site]
        return site, self.low[site] + (self.high[site] - self.low[site]) * fraction

    def derivatives(self, site: IntArray, parameter: FloatArray, order: int) -> list[FloatArray]:
        """Point and derivatives up to `order` (at most 3), each of shape (n, 2)."""
        if not self.curved:
            direction = self.direction.take(site, axis=0)
            place = self.anchor.take(site, axis=0) + parameter[:, None] * direction
            rest = [np.zeros((len(site), 2)) for _ in range(2, order + 1)]
            return [place, direction, *rest][: order + 1]
        if self.all_spirals:
            return self.curves(site).at(parameter, order)
        kind = self.kind[site]
        direction = self.direction[site]
        result = [self.anchor[site] + parameter[:, None] * direction, direction]
        result.extend(np.zeros((len(site), 2)) for _ in range(2, order + 1))
        del result[order + 1 :]
        if SiteKind.ARC in self.curved:
            arc = (kind == SiteKind.ARC).nonzero()[0]
            if len(arc):
                for values, part in zip(result, self._arc(site[arc], parameter[arc]), strict=False):
                    values[arc] = part
        if SiteKind.SPIRAL in self.curved:
            spiral = (kind == SiteKind.SPIRAL).nonzero()[0]
            if len(spiral):
                parts = self.curves(site[spiral]).at(parameter[spiral], order)
                for values, part in zip(result, parts, strict=True):
                    values[spiral] = part
        return result

    @cached_property
    def curved(self) -> set[int]:
        """Which of arcs and spirals there are."""
        return {SiteKind.ARC, SiteKind.SPIRAL} & set(self.kind.tolist())

    @cached_property
    def ends(self) -> tuple[BoolArray, BoolArray, BoolArray, BoolArray]:
        """(m,) whether sites begin and end at convex corners, and whether at reflex ones."""
        point = self.kind == SiteKind.POINT
        convex = self.corner_after
        return convex[self.preceding], convex, point[self.preceding], point[self.following]

    @cached_property
    def runs(self) -> Runs:
        """Runs of sites in a row that are parts of one curve."""
        bezier = self.bezier
        joined = (bezier[1:] == bezier[:-1]) & (bezier[1:] >= 0) & (self.loop[1:] == self.loop[:-1])
        start = np.concatenate([[True], ~joined])
        run = np.cumsum(start) - 1
        first = start.nonzero()[0]
        last = np.append(first[1:], len(run)) - 1
        smooth = (np.abs(self.turn_after) <= ROUNDED_TURN) & ~self.corner_after
        return Runs(
            run,
            run[self.following[last]][run],
            run[self.preceding[first]][run],
            self.low[first][run],
            self.high[last][run],
            smooth[last][run],
            smooth[self.preceding[first]][run],
        )

    @cached_property
    def direction(self) -> FloatArray:
        """(m, 2) direction of lines, 0 for others."""
        return np.where((self.kind == SiteKind.LINE)[:, None], self.extent, 0.0)

    @cached_property
    def _square(self) -> FloatArray:
        """(m,) squared lengths of lines, 1 for others."""
        line = self.kind == SiteKind.LINE
        return np.where(line, dot(self.direction, self.direction), 1.0)

    @cached_property
    def length(self) -> FloatArray:
        """(m,) lengths of lines, 0 for others."""
        return np.hypot(self.direction[:, 0], self.direction[:, 1])

    @cached_property
    def inward(self) -> FloatArray:
        """(m, 2) inward unit normals of lines, 0 for others."""
        length = np.where(self.length > 0, self.length, 1.0)
        x, y = self.direction.T / length
        return np.stack([-y, x], axis=1)

    def _arc(self, site: IntArray, parameter: FloatArray) -> Iterator[FloatArray]:
        """Point and derivatives, as many as are wanted."""
        sweep = self.extent[site, 1]
        angle = self.extent[site, 0] + parameter * sweep
        scale = self.radius[site]
        x, y = scale * np.cos(angle), scale * np.sin(angle)
        result = np.empty((len(site), 2))
        result[:, 0], result[:, 1] = x, y
        yield self.anchor[site] + result
        while True:
            x, y = -sweep * y, sweep * x
            result[:, 0], result[:, 1] = x, y
            yield result

    def curves(self, site: IntArray) -> Curves:
        """The curves of spirals."""
        row = self.bezier.take(site)
        if self.all_polynomial:
            return Curves(self.polynomial.take(row, axis=2), False)
        return Curves(self.coefficients.take(row, axis=0), True)

    @cached_property
    def _spiral_ends(self) -> tuple[FloatArray, FloatArray]:
        """First and last points (m, 2) of spirals, 0 for other sites."""
        spiral = np.flatnonzero(self.kind == SiteKind.SPIRAL)
        result = np.zeros((2, len(self), 2))
        for values, end in zip(result, (self.low, self.high), strict=True):
            values[spiral] = self.curves(spiral).at(end[spiral], 0)[0]
        return result[0], result[1]

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

    def tangents(self, site: IntArray, parameter: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points (n, 2) and inward unit normals (n, 2)."""
        position, first = self.derivatives(site, parameter, 1)
        if not self.curved:
            return position, self._plain_normals(site, parameter)
        return position, self._normals(site, parameter, first, np.hypot(first[:, 0], first[:, 1]))

    def _normals(
        self, site: IntArray, parameter: FloatArray, first: FloatArray, speed: FloatArray
    ) -> FloatArray:
        """Unit normals (n, 2) from derivatives (n, 2) and their lengths (n,)."""
        safe = np.where(speed > 0, speed, 1.0)
        normal = np.empty((len(site), 2))
        np.divide(first[:, 1], -safe, out=normal[:, 0])
        np.divide(first[:, 0], safe, out=normal[:, 1])
        return normal if self.all_spirals else self._fanned(site, parameter, normal)

    def _plain_normals(self, site: IntArray, parameter: FloatArray) -> FloatArray:
        """Unit normals (n, 2) at lines and corners."""
        return self._fanned(site, parameter, self.inward.take(site, axis=0))

    def _fanned(self, site: IntArray, parameter: FloatArray, normal: FloatArray) -> FloatArray:
        """The same with the normals (n, 2) at corners, in place."""
        point = (self.kind.take(site) == SiteKind.POINT).nonzero()[0]
        if len(point):
            start, turn = self.extent.take(site.take(point), axis=0).T
            angle = start + parameter.take(point) * turn
            normal[point, 0], normal[point, 1] = np.cos(angle), np.sin(angle)
        return normal

    def moving_frame(
        self, site: IntArray, parameter: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """As `frame`, and the length along the boundary per unit of parameter (n,), 0 in fans."""
        if not self.curved:
            position = self.point(site, parameter)
            bend = np.where(self.kind == SiteKind.POINT, -np.inf, 0.0).take(site)
            normal = self._plain_normals(site, parameter)
            return position, normal, bend, self.length.take(site)
        position, first, second = self.derivatives(site, parameter, 2)
        dx, dy = first[:, 0], first[:, 1]
        speed = np.hypot(dx, dy)
        normal = self._normals(site, parameter, first, speed)
        safe = np.where(speed > 0, speed, 1.0)
        curvature = (dx * second[:, 1] - dy * second[:, 0]) / (safe * safe * safe)
        if self.all_spirals:
            return position, normal, curvature, speed
        kind = self.kind[site]
        if SiteKind.ARC in self.curved:
            arc = (kind == SiteKind.ARC).nonzero()[0]
            curvature[arc] = np.sign(self.extent[site[arc], 1]) / self.radius[site[arc]]
        curvature[kind == SiteKind.POINT] = -np.inf
        return position, normal, curvature, speed

    def speed(self, site: IntArray, parameter: FloatArray, radius: FloatArray) -> FloatArray:
        """(n,) length along the boundary (or the fan at `radius`) per unit of parameter."""
        if self.curved:
            first = self.derivatives(site, parameter, 1)[1]
            result = np.hypot(first[:, 0], first[:, 1])
            if self.all_spirals:
                return result
        else:
            result = self.length.take(site)
        point = (self.kind.take(site) == SiteKind.POINT).nonzero()[0]
        if len(point):
            turn = self.extent[:, 1].take(site.take(point))
            result[point] = np.abs(turn) * radius.take(point)
        return result

    # -- projection -------------------------------------------------------------------------------

    def project(
        self, target: IntArray, centre: FloatArray, hint: FloatArray, slack: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Nearest point of each target site to each centre: parameter and distance, (n,) each.

        Distances may be too large by `slack`, mm, and parameters are then less exact.
        """
        if self.all_spirals:
            return self._project_spiral(target, centre, hint, slack)
        # Points have no direction, which makes their parameter 0; curves are dealt with below.
        direction, anchor = self.direction.take(target, axis=0), self.anchor.take(target, axis=0)
        along = dot(centre - anchor, direction) / self._square.take(target)
        parameter = np.minimum(np.maximum(along, 0.0), 1.0)
        if not self.curved:
            delta = centre - (anchor + parameter[:, None] * direction)
            return parameter, np.hypot(delta[:, 0], delta[:, 1])
        kind = self.kind.take(target)
        if SiteKind.ARC in self.curved:
            rows = (kind == SiteKind.ARC).nonzero()[0]
            if len(rows):
                parameter[rows] = self._project_arc(target[rows], centre[rows])
        if SiteKind.SPIRAL in self.curved:
            rows = (kind == SiteKind.SPIRAL).nonzero()[0]
            if len(rows):
                parameter[rows], _ = self._project_spiral(
                    target[rows], centre[rows], hint[rows], slack
                )
        delta = centre - self.point(target, parameter)
        return parameter, np.hypot(delta[:, 0], delta[:, 1])

    def _project_arc(self, target: IntArray, centre: FloatArray) -> FloatArray:
        start, sweep = self.extent[target].T
        offset = centre - self.anchor[target]
        angle = np.arctan2(offset[:, 1], offset[:, 0])
        return np.asarray(np.clip(share_of_turn(angle, start, sweep), 0.0, 1.0))

    def _project_spiral(
        self, target: IntArray, centre: FloatArray, hint: FloatArray, slack: float
    ) -> tuple[FloatArray, FloatArray]:
        low, high = self.low.take(target), self.high.take(target)
        parameter = np.minimum(np.maximum(hint, low), high)
        best, distance = parameter.copy(), np.full(len(target), np.inf)
        active, curves = np.arange(len(target)), self.curves(target)
        value, span = parameter, high - low
        least, most, around = low, high, centre
        # Centres of curvature are multiple roots: Newton is linear there and needs its time.
        for _ in range(60):
            point, first, second = curves.at(value, 2)
            offset = point - around
            squared = dot(offset, offset)
            better = (squared < distance.take(active)).nonzero()[0]
            which = active.take(better)
            best[which], distance[which] = value.take(better), squared.take(better)
            slope, flat = dot(offset, first), dot(first, first)
            # Beyond the evolute the second derivative is negative: the slope still tells the way.
            curve = np.maximum(np.abs(flat + dot(offset, second)), 1e-9 * flat)
            step = np.minimum(np.maximum(-slope / curve, -0.5 * span), 0.5 * span)
            new = np.minimum(np.maximum(value + step, least), most)
            # What the step gains, and what the slow ones at such roots may gain after it.
            gain = np.abs(slope * step)
            moving = np.abs(new - value) > 1e-12 * span
            stay = (moving & (gain >= 0.2 * slack * np.sqrt(squared))).nonzero()[0]
            if not len(stay):
                break
            if len(stay) == len(active):
                value = new
                continue
            active, value, span = active.take(stay), new.take(stay), span.take(stay)
            least, most = least.take(stay), most.take(stay)
            around, curves = around.take(stay, axis=0), curves.take(stay)
        for end, place in zip((low, high), self._spiral_ends, strict=True):
            offset = place.take(target, axis=0) - centre
            squared = dot(offset, offset)
            closer = squared < distance
            best = np.where(closer, end, best)
            distance = np.where(closer, squared, distance)
        return best, np.sqrt(distance)


@dataclass(frozen=True)
class Curves:
    """Rows of Bezier curves in power form about 1/2: coefficients as in `Sites.polynomial`, or as
    in `Sites.coefficients` where some are rational."""

    table: FloatArray
    rational: bool

    def take(self, rows: IntArray) -> Curves:
        """Rows."""
        return Curves(self.table.take(rows, axis=0 if self.rational else 2), self.rational)

    def at(self, parameter: FloatArray, order: int) -> list[FloatArray]:
        """Point and derivatives up to `order` <= 3, (n, 2) each."""
        if self.rational:
            return evaluate_rational(self.table, parameter, order)
        return polynomial(self.table, parameter - 0.5, order)


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


def polynomial(table: FloatArray, local: FloatArray, order: int) -> list[FloatArray]:
    """Value and derivatives (n, 2) of polynomials (2, degree + 1, n), by synthetic division."""
    return [value.T for value in taylor(table, local, order)]


def taylor(table: FloatArray, local: FloatArray, order: int) -> list[FloatArray]:
    """Value and derivatives, (k, n) each, of polynomials (k, degree + 1, n) at n places."""
    degree = table.shape[1] - 1
    values = [table[:, degree]]
    for power in range(degree - 1, -1, -1):
        # The remainders of one division after the other are the Taylor coefficients.
        if len(values) <= order:
            values.append(values[-1])
            last = len(values) - 2
        else:
            last = order
        for index in range(last, 0, -1):
            values[index] = values[index] * local
            values[index] += values[index - 1]
        values[0] = values[0] * local
        values[0] += table[:, power]
    for index in range(2, len(values)):
        values[index] = values[index] * factorial(index)
    while len(values) <= order:
        values.append(np.zeros_like(values[0]))
    return values


def share_of_turn(angle: FloatArray, start: FloatArray, turn: FloatArray) -> FloatArray:
    """Parameters of arcs and fans from `start` by `turn` at angles, cut opposite to the middle."""
    delta = np.remainder(angle - (start + turn / 2) + np.pi, 2 * np.pi) - np.pi
    return np.asarray(0.5 + delta / turn)


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
    return np.asarray(first[:, 0] * second[:, 0] + first[:, 1] * second[:, 1])


def largest(rows: FloatArray) -> FloatArray:
    """(...) largest absolute values of the few columns of a (..., k) array."""
    size = np.abs(rows)
    result: FloatArray = size[..., 0]
    for column in range(1, size.shape[-1]):
        result = np.maximum(result, size[..., column])
    return result
