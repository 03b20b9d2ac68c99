"""What `medial_axis` accepts: regions, polygons of other libraries, loops of points."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from grassfire.errors import GeometryError, InputError
from grassfire.geometry import Loop, Region
from grassfire.medial.polygons import Polygons, check_simple, depths
from grassfire.medial.sites import FloatArray


class PolygonLike(Protocol):
    """A polygon as Shapely has it: one ring around others, each with its `coords`."""

    @property
    def exterior(self) -> Any:
        """Ring with `coords`, (n, 2) or (n, 3)."""

    @property
    def interiors(self) -> Any:
        """Rings of the holes."""


class MultiPolygonLike(Protocol):
    """Several polygons as Shapely has them."""

    @property
    def geoms(self) -> Any:
        """The polygons."""


Points: TypeAlias = FloatArray | Sequence[Sequence[float]]
Source: TypeAlias = Region | Loop | PolygonLike | Points | Sequence[Points]

_REMEDY = "pass a Region, a Polygon or MultiPolygon, or loops of points (n, 2)"


def as_region(source: Source | MultiPolygonLike) -> Region | tuple[Region, ...]:
    """Return the region that an object stands for; a tuple of them for a MultiPolygon.

    Parameters
    ----------
    source
        A `Region`, or a `Loop` without islands; an object with `exterior` and `interiors`, such as
        a Shapely Polygon (heights are dropped); one with `geoms`, such as a MultiPolygon; an (n, 2)
        array of the vertices of one loop, mm; a sequence of such arrays: an outer loop and its
        islands, in any order and direction, which their containment tells apart. A last point
        that repeats the first, and points that repeat the one before, are dropped.

    Raises
    ------
    InputError
        An object of another kind, arrays of another shape.
    GeometryError
        Loops with fewer than three different points, with values that are not finite, that cross
        or touch themselves or one another (with the place), or that bound more than one region.
    """
    if isinstance(source, Region):
        return source
    if isinstance(source, Loop):
        return Region(source)
    kind = getattr(source, "geom_type", None)
    if hasattr(source, "geoms") and kind in (None, "MultiPolygon"):
        members = tuple(_from_polygon(member) for member in source.geoms)
        if not members:
            raise InputError("an empty MultiPolygon has no medial axis")
        return members
    if hasattr(source, "exterior"):
        return _from_polygon(source)
    if kind is not None:
        raise InputError(f"a {kind} bounds no region", remedy=_REMEDY)
    return _from_loops(_loops_of_points(source))


def _from_polygon(polygon: Any) -> Region:
    if not hasattr(polygon, "exterior"):
        raise InputError(f"{type(polygon).__name__} is no polygon", remedy=_REMEDY)
    if getattr(polygon, "is_empty", False):
        raise InputError("an empty Polygon has no medial axis")
    rings = [polygon.exterior, *polygon.interiors]
    return _from_loops([np.asarray(ring.coords, dtype=np.float64)[:, :2] for ring in rings])


def _loops_of_points(source: Any) -> list[FloatArray]:
    """Arrays of points, (n, 2) each, from one of them or a sequence of them."""
    if isinstance(source, str | bytes) or not isinstance(source, Iterable):
        raise InputError(f"{type(source).__name__} is no region", remedy=_REMEDY)
    given = source if isinstance(source, np.ndarray) else list(source)
    single = _array(given)
    if single is not None and single.ndim == 2:
        loops: list[FloatArray | None] = [single]
    elif single is not None and single.ndim == 3:
        loops = list(single)
    else:
        loops = [_array(part) for part in given]
    result = [loop for loop in loops if loop is not None and loop.ndim == 2 and loop.shape[1] == 2]
    if not result or len(result) < len(loops):
        raise InputError("loops of points must have shape (n, 2)", remedy=_REMEDY)
    return result


def _array(values: ArrayLike) -> FloatArray | None:
    """As an array of numbers, None where that cannot be."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (ValueError, TypeError):
        return None


def _from_loops(loops: Sequence[FloatArray]) -> Region:
    """Region of the outer loop and the islands."""
    cleaned = [_without_repetition(loop) for loop in loops]
    polygons = Polygons.join(cleaned)
    check_simple(polygons)
    depth = depths(polygons)
    outer = np.flatnonzero(depth == 0)
    beyond = np.flatnonzero(depth > 1)
    if len(outer) > 1 or len(beyond):
        stray = int(outer[1] if len(outer) > 1 else beyond[0])
        raise GeometryError(
            "loops of points bound more than one region",
            place=cleaned[stray][0].tolist(),
            remedy="pass one region at a time, or a MultiPolygon",
        )
    islands = (Loop.from_points(cleaned[index]) for index in np.flatnonzero(depth == 1))
    return Region(Loop.from_points(cleaned[int(outer[0])]), tuple(islands))


def _without_repetition(points: FloatArray) -> FloatArray:
    """Drop points that are the one before; the first follows the last."""
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise GeometryError(f"point {row} of a loop is not finite")
    kept: FloatArray = points[
        np.append(True, np.any(points[1:] != points[:-1], axis=1))[: len(points)]
    ]
    if len(kept) > 1 and np.all(kept[-1] == kept[0]):
        kept = kept[:-1]
    if len(kept) < 3:
        place = points[0].tolist() if len(points) else None
        raise GeometryError("a loop needs at least three different points", place=place)
    return kept
