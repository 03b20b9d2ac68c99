"""Medial axes as JSON: the boundary exactly, and the transform that it has."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from grassfire.errors import GeometryError, InputError
from grassfire.geometry import (
    Arc,
    Bezier,
    BSpline,
    Curve,
    EllipticalArc,
    Line,
    Loop,
    ParallelCurve,
    Region,
)

if TYPE_CHECKING:
    from grassfire.medial.axis import MedialAxis

FORMAT: Final = "grassfire.medial-axis/1"
"""Name and version of the document."""

_CURVES: Final[dict[str, type[Curve]]] = {
    "line": Line,
    "arc": Arc,
    "elliptical_arc": EllipticalArc,
    "bezier": Bezier,
    "b_spline": BSpline,
    "parallel": ParallelCurve,
}


def to_json(axis: MedialAxis) -> str:
    """Return an axis as a JSON document.

    It is what ``grassfire mat --json`` writes for one region, with the boundary itself and the
    angular tolerance added, and without the seconds: the same axis gives the same bytes. Numbers
    have as many digits as it takes to get the same float64 back. Boundary loops that are polygons
    are lists of points, others lists of curves.

    Parameters
    ----------
    axis : MedialAxis

    Returns
    -------
    str
        One line.
    """
    document = {
        "format": FORMAT,
        "units": "mm",
        "tolerance": float(axis.tolerance),
        "angular_tolerance": float(axis.angular_tolerance),
        "regions": [
            {**axis.to_dict(), "boundary": [_loop_entry(loop) for loop in axis.region.loops]}
        ],
    }
    return json.dumps(document, allow_nan=False) + "\n"


def from_json(text: str) -> MedialAxis:
    """Return the axis of a document that `to_json` wrote.

    Nothing that the document says of the axis is taken on trust: the transform is computed from
    the boundary and certified anew, and has to be the one in the document.

    Parameters
    ----------
    text : str

    Returns
    -------
    MedialAxis

    Raises
    ------
    InputError
        Text that is no such document, or one of another version.
    GeometryError
        A boundary that bounds no region or has no certified axis; an axis in the document that
        is not the one of its boundary, by more than the tolerance.
    """
    from grassfire.medial.axis import medial_axis

    try:
        document = json.loads(text)
    except ValueError as error:
        raise InputError(f"no JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(
            f"no medial axis in the format {FORMAT}", remedy="write it with MedialAxis.to_json"
        )
    try:
        (entry,) = document["regions"]
        tolerance = float(document["tolerance"])
        angular_tolerance = float(document["angular_tolerance"])
        outer, *islands = (_loop(part) for part in entry["boundary"])
        claim = {key: entry[key] for key in ("area", "holes", "vertices", "edges", "certificate")}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"a medial axis that is not complete: {error}") from error
    axis = medial_axis(Region(outer, tuple(islands)), tolerance, angular_tolerance)
    _compare(claim, axis)
    return axis


def _loop_entry(loop: Loop) -> dict[str, Any]:
    if loop.vertices is not None:
        return {"points": loop.vertices.tolist()}
    return {"curves": [_curve_entry(curve) for curve in loop.curves]}


def _curve_entry(curve: Curve) -> dict[str, Any]:
    """The fields of a curve under their names; weights only where there are any."""
    name = next((name for name, kind in _CURVES.items() if type(curve) is kind), None)
    if name is None:
        raise GeometryError(f"curves of type {type(curve).__name__} have no form in JSON")
    entry: dict[str, Any] = {"type": name}
    for item in fields(curve):  # type: ignore[arg-type]
        value = getattr(curve, item.name)
        if isinstance(value, Curve):
            entry[item.name] = _curve_entry(value)
        elif value is not None:
            entry[item.name] = value.tolist() if isinstance(value, np.ndarray) else value
    return entry


def _loop(entry: Mapping[str, Any]) -> Loop:
    if "points" in entry:
        return Loop.from_points(entry["points"])
    return Loop(tuple(_curve(part) for part in entry["curves"]))


def _curve(entry: Mapping[str, Any]) -> Curve:
    values = dict(entry)
    kind = _CURVES[values.pop("type")]
    if "base" in values:
        values["base"] = _curve(values["base"])
    return kind(**values)


def _compare(claim: Mapping[str, Any], axis: MedialAxis) -> None:
    """Refuse a claim that is not, within the tolerance, what its boundary has."""
    truth = axis.to_dict()
    # Lengths are claimed within the tolerance, areas within as much all along the boundary.
    areas = {"area", "area_error"}
    pending: list[tuple[str, Any, Any]] = [("", claim, truth)]
    while pending:
        path, told, found = pending.pop()
        if isinstance(found, dict) and isinstance(told, dict) and told.keys() == found.keys():
            pending.extend((f"{path}.{key}", told[key], found[key]) for key in found)
        elif isinstance(found, list) and isinstance(told, list) and len(told) == len(found):
            pending.extend(
                (f"{path}[{row}]", *pair) for row, pair in enumerate(zip(told, found, strict=True))
            )
        elif isinstance(found, float) and isinstance(told, float | int):
            slack = axis.tolerance
            if path.rpartition(".")[2] in areas:
                slack *= 10 * axis.region.perimeter
            if not abs(told - found) <= slack:
                _refuse(path, told, found)
        elif told != found:
            _refuse(path, told, found)


def _refuse(path: str, told: Any, found: Any) -> None:
    raise GeometryError(
        "the axis in the document is not the one of its boundary",
        place=path.lstrip("."),
        remedy="compute it from the boundary with medial_axis",
    )
