"""Medial axes to DXF: boundary, axis and radius as curves that CAD programs read."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from grassfire.errors import InputError
from grassfire.geometry import Arc, Bezier, BSpline, Curve, EllipticalArc, Line
from grassfire.geometry.chebyshev import evaluate_bezier, interpolate_to_bezier, nodes

if TYPE_CHECKING:
    from grassfire.medial import MedialAxis

FloatArray = NDArray[np.float64]

BOUNDARY: Final = "BOUNDARY"
"""Layer of the boundary of the region."""

AXIS: Final = "MEDIAL_AXIS"
"""Layer of the axis: one SPLINE an edge, one POINT a vertex, in the plane z = 0."""

RADIUS: Final = "MEDIAL_RADIUS"
"""Layer of the same edges and vertices with the radius as their height; switched off."""

LARGEST_DEGREE: Final = 10
"""Degree of splines above which common readers of DXF give up."""

_COLOURS: Final = {BOUNDARY: 7, AXIS: 1, RADIUS: 5}
"""AutoCAD colour indices of the layers."""


def write_medial_axis(axes: MedialAxis | Sequence[MedialAxis], path: str | Path) -> None:
    """Write medial axes to a DXF file (R2010, millimetres), or nothing at all.

    Layer BOUNDARY holds the curves of the regions: LINE, ARC, CIRCLE, ELLIPSE and SPLINE, exact.
    Layer MEDIAL_AXIS holds a SPLINE for each edge, the Bezier curve with the edge's degree and
    control points, and a POINT for each vertex. Layer MEDIAL_RADIUS, switched off, holds them once
    more with z = radius: the medial axis transform as curves in space, whose (x, y, z) at a
    parameter is the disk there. Curves of a degree above 10, which common readers refuse, are
    B-splines of degree 10 with the same parameter, within 1e-13 of their coordinates.

    Parameters
    ----------
    axes : MedialAxis or sequence of MedialAxis
    path : path
        A file that is there is replaced once the new one is complete.

    Raises
    ------
    InputError
        If the file cannot be written.
    GeometryError
        A boundary with offsets of free curves, which DXF has no entity for.
    """
    target = Path(path)
    text = medial_axis_text(axes)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        temporary.write_text(text, encoding="utf-8", newline="\n")
        temporary.replace(target)
    except OSError as error:
        raise InputError(
            f"cannot be written: {error.strerror or 'unknown reason'}",
            source=str(target),
            remedy="choose another place for the output",
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def medial_axis_text(axes: MedialAxis | Sequence[MedialAxis]) -> str:
    """Return what `write_medial_axis` writes: the same for the same axes, byte by byte."""
    from ezdxf.filemanagement import new
    from ezdxf.units import MM

    with _fixed_dates():
        document = new("R2010", units=MM)
        for name, colour in _COLOURS.items():
            document.layers.add(name, color=colour)
        document.layers.get(RADIUS).off()
        space = document.modelspace()
        for axis in axes if isinstance(axes, Sequence) else (axes,):
            for curve in axis.region.curves:
                _add_curve(space, curve)
            _add_axis(space, axis)
        stream = io.StringIO()
        document.write(stream)
    return stream.getvalue()


@contextmanager
def _fixed_dates() -> Iterator[None]:
    """ezdxf writes the hour and a random number into each drawing, but not in here."""
    from ezdxf import options  # type: ignore[attr-defined]

    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def _add_axis(space: Any, axis: MedialAxis) -> None:
    for edge in axis.edges:
        degree, knots, control = _spline(np.column_stack([edge.control_points, edge.radius]))
        _add_spline(space, AXIS, degree, knots, control * [1.0, 1.0, 0.0])
        _add_spline(space, RADIUS, degree, knots, control)
    for (x, y), radius in zip(axis.vertex_point.tolist(), axis.vertex_radius.tolist(), strict=True):
        space.add_point((x, y, 0.0), dxfattribs={"layer": AXIS})
        space.add_point((x, y, radius), dxfattribs={"layer": RADIUS})


def _spline(control: FloatArray) -> tuple[int, FloatArray, FloatArray]:
    """Degree, knots and control points of a Bezier curve (n + 1, k) as a B-spline.

    The same one up to the greatest degree that is read everywhere; above it as many equal spans
    of that degree as it takes to keep the curve and its parameter within 1e-13 of its size.
    """
    degree = len(control) - 1
    if degree <= LARGEST_DEGREE:
        return degree, np.repeat([0.0, 1.0], degree + 1), control
    slack = 1e-13 * float(np.abs(control).max())
    low, probes = nodes(LARGEST_DEGREE), nodes(4 * LARGEST_DEGREE)
    for spans in 2 ** np.arange(8):
        start = np.arange(spans)[:, None]
        pieces = interpolate_to_bezier(evaluate_bezier(control, (start + low) / spans))
        drawn = evaluate_bezier(pieces, probes)
        if np.abs(drawn - evaluate_bezier(control, (start + probes) / spans)).max() <= slack:
            break
    inner = np.repeat(np.arange(1, spans) / spans, LARGEST_DEGREE)
    ends = np.repeat([0.0, 1.0], LARGEST_DEGREE + 1)
    knots = np.concatenate([ends[: LARGEST_DEGREE + 1], inner, ends[LARGEST_DEGREE + 1 :]])
    joined = np.concatenate([control[:1], *(piece[1:] for piece in pieces)])
    return LARGEST_DEGREE, knots, joined


def _add_spline(
    space: Any,
    layer: str,
    degree: int,
    knots: FloatArray,
    control: FloatArray,
    weights: FloatArray | None = None,
) -> None:
    spline = space.add_spline(degree=degree, dxfattribs={"layer": layer})
    spline.knots = knots.tolist()
    spline.control_points = control.tolist()
    if weights is not None:
        spline.weights = weights.tolist()


def _add_curve(space: Any, curve: Curve) -> None:
    """A boundary curve as the entity that it is."""
    attributes = {"layer": BOUNDARY}
    if isinstance(curve, Line):
        space.add_line(curve.start.tolist(), curve.end.tolist(), attributes)
    elif isinstance(curve, Arc) and curve.closed:
        space.add_circle(curve.centre.tolist(), curve.radius, attributes)
    elif isinstance(curve, Arc):
        first, last = curve.start_angle, curve.start_angle + curve.sweep
        low, high = degrees(min(first, last)), degrees(max(first, last))
        space.add_arc(curve.centre.tolist(), curve.radius, low, high, dxfattribs=attributes)
    elif isinstance(curve, EllipticalArc):
        _add_ellipse(space, curve)
    elif isinstance(curve, BSpline) and curve.degree <= LARGEST_DEGREE:
        whole = curve.clamped()
        knots, control = whole.knots, whole.control_points
        _add_spline(space, BOUNDARY, whole.degree, knots, control, whole.weights)
    else:
        for bezier in curve.to_beziers():
            _add_bezier(space, bezier)


def _add_bezier(space: Any, curve: Bezier) -> None:
    weights = curve.weights
    if weights is None:
        _add_spline(space, BOUNDARY, *_spline(curve.control_points))
        return
    weighted = np.column_stack([curve.control_points * weights[:, None], weights])
    degree, knots, control = _spline(weighted)
    points = control[:, :2] / control[:, 2:]
    _add_spline(space, BOUNDARY, degree, knots, points, control[:, 2])


def _add_ellipse(space: Any, curve: EllipticalArc) -> None:
    """By its half-axes, which DXF wants at right angles, counter-clockwise, the longer one first.

    With [major minor] = U S V', V' a turn by an angle, centre + U S (cos, sin) of the eccentric
    angle turned by it is the same curve.
    """
    axes, lengths, turn = np.linalg.svd(np.column_stack([curve.major, curve.minor]))
    if np.linalg.det(turn) < 0.0:
        axes, turn = axes * [1.0, -1.0], turn * [[1.0], [-1.0]]
    angle = float(np.arctan2(turn[1, 0], turn[0, 0]))
    first, last = curve.start_angle + angle, curve.start_angle + curve.sweep + angle
    if np.linalg.det(axes) < 0.0:
        first, last = -first, -last
    major = (axes[:, 0] * lengths[0]).tolist()
    ratio = float(lengths[1] / lengths[0])
    low, high = min(first, last), max(first, last)
    space.add_ellipse(curve.centre.tolist(), major, ratio, low, high, {"layer": BOUNDARY})
