"""Closed chains of curves, and how their junctions turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grassfire.errors import GeometryError
from grassfire.geometry.batch import CurveBatch
from grassfire.geometry.bezier import Bezier
from grassfire.geometry.bspline import BSpline
from grassfire.geometry.curve import Bounds, Curve, FloatArray, cross, dot
from grassfire.geometry.line import Line
from grassfire.geometry.measures import joint_box, swept_area

SMOOTH: Final = 0
"""A junction whose turn is within the angular tolerance."""
CONVEX: Final = 1
"""A junction that turns left: a corner of the region to the left of the loop."""
REFLEX: Final = 2
"""A junction that turns right: the region lies around it."""

SNAP: Final = 1e-9
"""Gap, relative to the loop's size, that the constructor closes."""


@dataclass(frozen=True, eq=False)
class JunctionTable:
    """Junctions of a loop; row i lies at the start of curve i, at parameter u = i.

    Attributes
    ----------
    point : (n, 2) array
        In mm.
    turn : (n,) array
        Signed angle from the tangent of curve i - 1 to that of curve i in (-pi, pi], radians.
    kind : (n,) int array
        SMOOTH, CONVEX or REFLEX.
    """

    point: FloatArray
    turn: FloatArray
    kind: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.turn)


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed chain of curves with the global parameter u = index of the curve + its t.

    Parameters
    ----------
    curves : sequence of Curve
        Each ends where the next starts; a single closed curve is a loop too.

    Raises
    ------
    GeometryError
        If a gap exceeds 1e-9 of the loop's size. Smaller gaps are closed by moving the end
        points of lines, Bezier curves and B-splines; `Loop.chained` closes larger ones.

    Notes
    -----
    `Loop.from_points` makes large polygons without an object for each line.
    """

    curves: tuple[Curve, ...]

    def __post_init__(self) -> None:
        curves = list(self.curves)
        if not curves:
            raise GeometryError("a loop needs at least one curve")
        starts = np.array([curve.start for curve in curves])
        ends = np.array([curve.end for curve in curves])
        gaps = np.hypot(*(np.roll(starts, -1, axis=0) - ends).T)
        extent = np.concatenate([starts, ends])
        size = max(float(np.hypot(*np.ptp(extent, axis=0))), 1e-3 * float(np.abs(extent).max()))
        worst = int(np.argmax(gaps))
        if gaps[worst] > SNAP * size and gaps[worst] > SNAP * max(curve.size for curve in curves):
            raise GeometryError(
                f"a loop has a gap of {gaps[worst]:.3g} mm",
                place=ends[worst].tolist(),
                remedy="close it, or chain with a larger tolerance",
            )
        for index in np.flatnonzero(gaps > 0.0):
            _snap(curves, int(index))
        object.__setattr__(self, "curves", tuple(curves))

    @classmethod
    def chained(cls, curves: Sequence[Curve], tolerance: float) -> Loop:
        """Return the loop of curves whose gaps of up to `tolerance` mm are closed in the middle.

        Raises
        ------
        GeometryError
            If a gap is wider, or its curves cannot be moved.
        """
        count = len(curves)
        ends = np.array([curve.end for curve in curves])
        starts = np.roll(np.array([curve.start for curve in curves]), -1, axis=0)
        gaps = np.hypot(*(starts - ends).T)
        if np.any(gaps > tolerance):
            worst = int(np.argmax(gaps))
            raise GeometryError(
                f"a loop has a gap of {gaps[worst]:.3g} mm",
                place=ends[worst].tolist(),
                remedy=f"gaps up to {tolerance:.3g} mm can be closed",
            )
        # Where there is no gap the end stays to the last bit; else meet half-way.
        corners = np.where((gaps > 0.0)[:, None], 0.5 * (starts + ends), ends)
        closed = []
        for index, curve in enumerate(curves):
            if gaps[index - 1] > 0.0 or gaps[index] > 0.0:
                curve = curve.with_ends(corners[(index - 1) % count], corners[index])
            closed.append(curve)
        return cls(tuple(closed))

    @classmethod
    def from_points(cls, points: ArrayLike) -> Loop:
        """Return the closed polygon through points, kept as an array: its lines are made when
        `curves` is asked for, everything else works on the points.

        Parameters
        ----------
        points : (n, 2) array_like
            In mm, in order. The last may repeat the first; a point equal to the one before it is
            dropped.

        Raises
        ------
        GeometryError
            For another shape, values that are not finite, or fewer than three different points
            in a row.
        """
        from grassfire.geometry.polygon import Polygon

        return Polygon(points)

    @property
    def vertices(self) -> FloatArray | None:
        """(n, 2) corners of a loop made by `from_points`, in mm; None of other loops."""
        return None

    @property
    def start(self) -> FloatArray:
        """(2,) point at u = 0."""
        return self.curves[0].start

    def __len__(self) -> int:
        return len(self.curves)

    @cached_property
    def batch(self) -> CurveBatch:
        """The loop's curves, prepared for evaluation of many at once."""
        return CurveBatch(self.curves)

    def locate(self, u: ArrayLike) -> tuple[NDArray[np.int64], FloatArray]:
        """Return curve indices and parameters t of u, which wraps around the loop."""
        parameter = np.mod(np.asarray(u, dtype=np.float64), len(self))
        index = np.minimum(parameter.astype(np.int64), len(self) - 1)
        return index, np.asarray(parameter - index)

    def evaluate(self, u: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives by u up to `order`, each (..., 2)."""
        return self.batch.evaluate(*self.locate(u), order)

    def point(self, u: ArrayLike) -> FloatArray:
        """Return points (..., 2) in mm at u in [0, number of curves)."""
        return self.evaluate(u)[0]

    def derivative(self, u: ArrayLike, order: int = 1) -> FloatArray:
        """Return derivatives by u, (..., 2); from the right at junctions."""
        return self.evaluate(u, order)[order]

    def tangent(self, u: ArrayLike) -> FloatArray:
        """Return unit tangents (..., 2); from the right at junctions."""
        return self.batch.tangent(*self.locate(u))

    def normal(self, u: ArrayLike) -> FloatArray:
        """Return unit left normals (..., 2): inward for the region to the left."""
        tangent = self.tangent(u)
        return np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)

    def curvature(self, u: ArrayLike) -> FloatArray:
        """Return signed curvatures (...) in 1/mm; from the right at junctions."""
        return self.batch.curvature(*self.locate(u))

    @cached_property
    def area(self) -> float:
        """Signed area in mm^2, counter-clockwise positive."""
        return swept_area(self.curves, self._ends)

    @cached_property
    def length(self) -> float:
        """Length of the whole loop in mm."""
        return float(sum(curve.length() for curve in self.curves))

    def bounds(self) -> Bounds:
        """Return the exact bounding box (xmin, ymin, xmax, ymax) in mm."""
        return self._box

    @cached_property
    def _box(self) -> Bounds:
        return joint_box(self.curves, self._ends)

    @cached_property
    def _ends(self) -> FloatArray:
        """(n, 2, 2) start and end of each curve."""
        return np.array([(curve.start, curve.end) for curve in self.curves])

    def reversed(self) -> Loop:
        """Return the loop run the other way; the first curve becomes the last."""
        return Loop(tuple(curve.reversed() for curve in reversed(self.curves)))

    def start_at(self, index: int) -> Loop:
        """Return the loop that starts with curve `index`."""
        shift = index % len(self.curves)
        return Loop(self.curves[shift:] + self.curves[:shift])

    def transformed(self, matrix: ArrayLike) -> Loop:
        """Return the image under a (2, 3) affine matrix; a mirrored loop keeps its curve order,
        so its orientation flips."""
        return Loop(tuple(curve.transformed(matrix) for curve in self.curves))

    def junctions(self, angular_tolerance: float) -> JunctionTable:
        """Classify the junctions between consecutive curves.

        Parameters
        ----------
        angular_tolerance : float
            Largest turn that counts as smooth, in radians.

        Notes
        -----
        At a cusp, a turn within the tolerance (at least 1e-9) of half a turn, the rounding of the
        tangents cannot tell a needle of region from a slit: the side on which the outgoing curve
        leaves the incoming one, a little away, decides the sign. Where they coincide the
        junction is a slit, reflex.
        """
        index = np.arange(len(self))
        incoming = np.roll(self.batch.tangent(index, 1.0), 1, axis=0)
        outgoing = self.batch.tangent(index, 0.0)
        point = np.array([curve.start for curve in self.curves])
        return self._classified(point, incoming, outgoing, angular_tolerance)

    def _classified(
        self,
        point: FloatArray,
        incoming: FloatArray,
        outgoing: FloatArray,
        angular_tolerance: float,
    ) -> JunctionTable:
        """Return the junctions between tangents (n, 2) of any length."""
        turn = np.arctan2(cross(incoming, outgoing), dot(incoming, outgoing))
        for cusp in np.flatnonzero(np.abs(turn) > np.pi - max(angular_tolerance, 1e-9)):
            side = cusp_side(self._curve(int(cusp) - 1), self._curve(int(cusp)))
            turn[cusp] = np.copysign(turn[cusp], side)
        kind = np.where(turn > 0.0, CONVEX, REFLEX)
        kind[np.abs(turn) <= angular_tolerance] = SMOOTH
        return JunctionTable(point, turn, kind.astype(np.int64))

    def _curve(self, index: int) -> Curve:
        return self.curves[index]


def cusp_side(incoming: Curve, outgoing: Curve) -> float:
    """Return +1 where the region is inside the cusp between two curves, else -1.

    The side on which the outgoing curve leaves the incoming one, a little away, decides; where
    they coincide the region is outside.
    """
    back_along = incoming.reversed()
    corner, back = outgoing.start, outgoing.tangent(0.0)
    size = min(outgoing.size, back_along.size)
    for share in (1e-4, 1e-3, 1e-2, 1e-1):
        ahead = [_at_distance(curve, corner, share * size) for curve in (back_along, outgoing)]
        side = float(cross(back, ahead[0] - ahead[1]))
        if abs(side) > 1e-11 * size:
            return float(np.sign(side))
    return -1.0


def _at_distance(curve: Curve, corner: FloatArray, distance: float) -> FloatArray:
    """Return the first point of a curve at a distance from its start, by bisection."""
    samples = np.linspace(0.0, 1.0, 1025)
    reach = np.hypot(*(curve.point(samples) - corner).T)
    beyond = np.flatnonzero(reach >= distance)
    if not len(beyond):
        return curve.point(samples[int(np.argmax(reach))])
    low, high = samples[max(beyond[0] - 1, 0)], samples[beyond[0]]
    for _ in range(50):
        middle = 0.5 * (low + high)
        if np.hypot(*(curve.point(middle) - corner)) < distance:
            low = middle
        else:
            high = middle
    return curve.point(high)


def _snap(curves: list[Curve], index: int) -> None:
    """Close the tiny gap after curve `index` in place, where a curve has a free end point."""
    following = (index + 1) % len(curves)
    first, second = curves[index], curves[following]
    movable = (Line, Bezier, BSpline)
    if isinstance(first, movable) and not (len(curves) == 1 and isinstance(first, Line)):
        curves[index] = first.with_ends(first.start, second.start)
    elif isinstance(second, movable):
        curves[following] = second.with_ends(first.end, second.end)
