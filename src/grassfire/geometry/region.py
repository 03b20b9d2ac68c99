"""Regions of the plane: one outer loop and the islands in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grassfire.errors import GeometryError
from grassfire.geometry.batch import CurveBatch
from grassfire.geometry.curve import Bounds, Curve, FloatArray, affine_parts
from grassfire.geometry.loop import Loop
from grassfire.geometry.measures import polygon_areas
from grassfire.geometry.winding import MonotonePieces


@dataclass(frozen=True, eq=False)
class Region:
    """A bounded region with its boundary run so that the region lies on the left.

    Parameters
    ----------
    outer : Loop
        Either orientation; made counter-clockwise.
    islands : sequence of Loop
        Loops inside `outer`; made clockwise.

    Attributes
    ----------
    area : float
        mm2.

    Raises
    ------
    GeometryError
        For a loop without area, or an island that reaches out of the outer loop's box.

    Notes
    -----
    The global boundary parameter u numbers all curves through: u = `first_curve[loop]` + index of
    the curve in its loop + t. Loops are taken as simple and apart; that is the reader's to check.
    """

    outer: Loop
    islands: tuple[Loop, ...] = field(default=())
    area: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        given = (self.outer, *self.islands)
        area, low, high = _measures(given)
        empty = np.abs(area) <= 1e-14 * np.sum((high - low) ** 2, axis=1)
        if empty.any():
            place = given[int(np.argmax(empty))].start
            raise GeometryError("a loop has no area", place=place.tolist())
        slack = 1e-9 * float(np.hypot(*(high[0] - low[0])))
        out = np.any((low < low[0] - slack) | (high > high[0] + slack), axis=1)
        if out.any():
            place = given[int(np.argmax(out))].start
            raise GeometryError("an island lies outside of its region", place=place.tolist())
        keep = area > 0.0
        keep[1:] = ~keep[1:]
        outer, *islands = (
            loop if kept else loop.reversed()
            for loop, kept in zip(given, keep.tolist(), strict=True)
        )
        area = np.abs(area)
        object.__setattr__(self, "area", float(area[0] - area[1:].sum()))
        object.__setattr__(self, "outer", outer)
        object.__setattr__(self, "islands", tuple(islands))

    @property
    def loops(self) -> tuple[Loop, ...]:
        """All loops, the outer one first."""
        return (self.outer, *self.islands)

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """All boundary curves in the order of the global parameter."""
        return tuple(curve for loop in self.loops for curve in loop.curves)

    @cached_property
    def first_curve(self) -> NDArray[np.int64]:
        """(number of loops + 1,) global index of each loop's first curve, and the total."""
        counts = [len(loop) for loop in self.loops]
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    @cached_property
    def batch(self) -> CurveBatch:
        """All boundary curves, prepared for evaluation of many at once."""
        return CurveBatch(self.curves)

    @cached_property
    def perimeter(self) -> float:
        """Length of all loops in mm."""
        return float(sum(loop.length for loop in self.loops))

    def bounds(self) -> Bounds:
        """Return the exact bounding box (xmin, ymin, xmax, ymax) in mm."""
        return self.outer.bounds()

    @cached_property
    def _pieces(self) -> MonotonePieces:
        return MonotonePieces(self.loops)

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return which of the points (n, 2) lie inside, shape (n,).

        By winding numbers over pieces of the exact curves that are monotone in y: exact to
        rounding. Points on the boundary may fall on either side.
        """
        return self._pieces.winding(np.asarray(points, dtype=np.float64)) > 0

    def transformed(self, matrix: ArrayLike) -> Region:
        """Return the image under a (2, 3) affine matrix; orientation is restored after mirrors."""
        affine_parts(matrix)
        outer = self.outer.transformed(matrix)
        return Region(outer, tuple(island.transformed(matrix) for island in self.islands))

    def locate_boundary(self, u: ArrayLike) -> tuple[NDArray[np.int64], FloatArray]:
        """Return global curve indices and parameters t of u in [0, number of curves]."""
        parameter = np.asarray(u, dtype=np.float64)
        index = np.clip(np.floor(parameter), 0, self.first_curve[-1] - 1).astype(np.int64)
        return index, np.asarray(parameter - index)

    def boundary_point(self, u: ArrayLike) -> FloatArray:
        """Return boundary points (..., 2) at global parameters u."""
        return self.batch.point(*self.locate_boundary(u))

    def boundary_normal(self, u: ArrayLike) -> FloatArray:
        """Return inward unit normals (..., 2) at global parameters u."""
        return self.batch.normal(*self.locate_boundary(u))

    def boundary_curvature(self, u: ArrayLike) -> FloatArray:
        """Return signed curvatures (...) at global parameters u, left turns positive."""
        return self.batch.curvature(*self.locate_boundary(u))


def _measures(loops: tuple[Loop, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(k,) signed areas, mm2, least and largest x and y of loops, (k, 2) each, mm.

    Of polygons all at once.
    """
    corners = [loop.vertices for loop in loops]
    polygons = [each for each in corners if each is not None]
    if len(polygons) < len(loops):
        box = np.array([loop.bounds() for loop in loops])
        return np.array([loop.area for loop in loops]), box[:, :2], box[:, 2:]
    count = np.array([len(each) for each in polygons])
    point, first = np.concatenate(polygons), count.cumsum() - count
    low, high = np.minimum.reduceat(point, first), np.maximum.reduceat(point, first)
    return polygon_areas(point, first), low, high
