"""Trimmed offsets as regions, their lengths and areas in closed form."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry import Curve, Loop, ParallelCurve, Region
from grassfire.medial.sites import FloatArray, dot

if TYPE_CHECKING:
    from grassfire.medial.axis import MedialAxis


@dataclass(frozen=True)
class TrimmedOffset:
    """All points with a clearance of `distance` or more, as regions.

    Attributes
    ----------
    distance : float
        mm.
    regions : tuple of Region
        Connected pieces; their curves are lines, arcs and `ParallelCurve`s.
    """

    distance: float
    regions: tuple[Region, ...]

    def __len__(self) -> int:
        return len(self.regions)

    def __iter__(self) -> Iterator[Region]:
        return iter(self.regions)

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Boundary loops of all pieces, region on the left."""
        return tuple(loop for region in self.regions for loop in region.loops)

    @cached_property
    def length(self) -> float:
        """Length of all loops in mm, offset curves by L - distance * turn of their base."""
        return float(sum(curve_length(curve) for loop in self.loops for curve in loop.curves))

    @cached_property
    def area(self) -> float:
        """Area of all pieces in mm^2, by Green's formula, offset curves in closed form."""
        total = 0.0
        for loop in self.loops:
            origin = np.asarray(loop.curves[0].start)
            total += sum(curve_area(curve, origin) for curve in loop.curves)
        return float(total)


def curve_length(curve: Curve) -> float:
    """Length in mm; of an offset c + d n without cusps, L - d * turn of its base."""
    if not isinstance(curve, ParallelCurve):
        return curve.length(1e-11)
    base = curve.base.subcurve(curve.t0, curve.t1)
    return base.length(1e-11) - curve.distance * _turn(base)


def curve_area(curve: Curve, origin: FloatArray) -> float:
    """Half the integral of (c - origin) x dc, mm^2.

    For an offset c + d n it is that of the base - d L + d / 2 [(c - origin) x n] + d^2 / 2 turn,
    as n x n' is the rate of turning and n x c' minus the speed; the bracket is taken at the ends.
    """
    if not isinstance(curve, ParallelCurve):
        return curve.area_integral(origin, 1e-11)
    base, distance = curve.base.subcurve(curve.t0, curve.t1), curve.distance
    ends = np.array([0.0, 1.0])
    arm, normal = base.point(ends) - origin, base.normal(ends)
    moment = arm[:, 0] * normal[:, 1] - arm[:, 1] * normal[:, 0]
    return float(
        base.area_integral(origin, 1e-11)
        - distance * base.length(1e-11)
        + 0.5 * distance * (moment[1] - moment[0])
        + 0.5 * distance**2 * _turn(base)
    )


def _turn(curve: Curve) -> float:
    """Angle that the tangent turns through, radians, left positive."""
    tangent = curve.tangent(np.linspace(0.0, 1.0, 33))
    across = tangent[:-1, 0] * tangent[1:, 1] - tangent[:-1, 1] * tangent[1:, 0]
    return float(np.sum(np.arctan2(across, dot(tangent[:-1], tangent[1:]))))


def trimmed_offset(axis: MedialAxis, distance: float) -> TrimmedOffset:
    """All points with a clearance of `distance` or more: the region eroded by a disk.

    Parameters
    ----------
    distance : float
        mm. 0 gives the region itself; nothing is left beyond the radius of the largest disk.

    Returns
    -------
    TrimmedOffset
        Regions of lines, arcs and `ParallelCurve`s, with exact length and area. Parts without
        area (between parallel walls exactly twice the distance apart, a largest disk of exactly
        this radius) are left out, and a neck of exactly this radius parts what it joins.

    Raises
    ------
    GeometryError
        For a distance that is negative or not finite.

    Examples
    --------
    >>> from grassfire.geometry import Line, Loop, Region
    >>> from grassfire.medial import medial_axis
    >>> corners = [(0, 0), (30, 0), (30, 10), (10, 10), (10, 30), (0, 30)]
    >>> sides = zip(corners, corners[1:] + corners[:1])
    >>> axis = medial_axis(Region(Loop(tuple(Line(a, b) for a, b in sides))))
    >>> inner = axis.trimmed_offset(2.0)
    >>> len(inner), round(inner.length, 9), round(inner.area, 9)
    (1, 103.141592654, 276.858407346)
    """
    if not (np.isfinite(distance) and distance >= 0):
        raise GeometryError("an offset distance must be a number of 0 or more")
    if distance == 0:
        return TrimmedOffset(0.0, (axis.region,))
    nodes = axis.offset_tree(np.array([distance]))
    size = axis.sites.size
    solid = [node.loops for node in nodes if has_area(node.loops[0], size)]
    return TrimmedOffset(
        float(distance), tuple(Region(loops[0], tuple(loops[1:])) for loops in solid)
    )


def has_area(loop: Loop, size: float) -> bool:
    """Whether a loop is more than a line run to and fro."""
    width = 1e-11 * size * loop.length
    return abs(loop.area) > width


__all__ = ["TrimmedOffset", "curve_area", "curve_length", "has_area", "trimmed_offset"]
