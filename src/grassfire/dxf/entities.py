"""From DXF entities to exact plane curves in millimetres."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from grassfire.dxf.splines import spline_curves
from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Curve, EllipticalArc, Line
from grassfire.report import Finding, Severity

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document

FloatArray = NDArray[np.float64]

SHORTEST: Final = 1e-7
"""Curves shorter than this, in mm, are no curves."""

_ANNOTATION: Final = frozenset(
    {
        "TEXT",
        "MTEXT",
        "DIMENSION",
        "ARC_DIMENSION",
        "LARGE_RADIAL_DIMENSION",
        "LEADER",
        "MULTILEADER",
        "POINT",
        "VIEWPORT",
        "ATTDEF",
        "ATTRIB",
        "TOLERANCE",
        "ACAD_TABLE",
        "RAY",
        "XLINE",
        "IMAGE",
        "WIPEOUT",
        "SEQEND",
    }
)


@dataclass(frozen=True)
class Piece:
    """One curve of the drawing, in mm.

    Attributes
    ----------
    curve : Curve
    handle : str, optional
        Handle of its entity.
    layer : str
        Layer of its entity, after block inheritance.
    part_of : int, optional
        Number of the curve that it was cut from, where overlapping curves were taken apart.
    """

    curve: Curve
    handle: str | None
    layer: str
    part_of: int | None = None


@dataclass(frozen=True)
class Extraction:
    """What the drawing's model space holds.

    Attributes
    ----------
    pieces : tuple of Piece
        Curves yet to be chained.
    rings : tuple of tuple of Piece
        Contours that are closed as drawn, in order.
    findings : tuple of Finding
    """

    pieces: tuple[Piece, ...]
    rings: tuple[tuple[Piece, ...], ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class _Context:
    """Where an entity stands: the map to world mm, the layer of the INSERT, the blocks around."""

    matrix: FloatArray
    layer: str | None = None
    blocks: tuple[str, ...] = ()


@dataclass
class _Collector:
    """Gathers curves and findings while the entities are walked."""

    document: Document
    selected: Callable[[str], bool]
    flatness: float
    angular_tolerance: float
    pieces: list[Piece] = field(default_factory=list)
    rings: list[tuple[Piece, ...]] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    ignored: Counter[str] = field(default_factory=Counter)
    first_ignored: dict[str, str | None] = field(default_factory=dict)
    hidden: Counter[tuple[str, str]] = field(default_factory=Counter)
    unselected: int = 0
    raised: Counter[float] = field(default_factory=Counter)

    def note(
        self,
        severity: Severity,
        code: str,
        message: str,
        handle: str | None,
        place: Sequence[float] | FloatArray | None = None,
        size: float | None = None,
    ) -> None:
        """Add a finding."""
        where = None if place is None else (float(place[0]), float(place[1]))
        self.findings.append(Finding(severity, code, message, handle, where, size))

    def hidden_by(self, layer: str) -> str | None:
        """Return "off" or "frozen" when the layer is not shown."""
        if not self.document.layers.has_entry(layer):
            return None
        entry = self.document.layers.get(layer)
        if entry.is_frozen():
            return "frozen"
        return "off" if entry.is_off() else None

    def add(self, curves: Iterable[Curve], handle: str | None, layer: str, closed: bool) -> None:
        """Take over the curves of one entity, without those of no length."""
        kept: list[Piece] = []
        for curve in curves:
            xmin, ymin, xmax, ymax = curve.bounds()
            if math.hypot(xmax - xmin, ymax - ymin) < SHORTEST:
                text = "curve of no length dropped"
                self.note(Severity.REPAIR, "zero-length", text, handle, (xmin, ymin), 0.0)
                closed = closed and len(kept) > 0
            else:
                kept.append(Piece(curve, handle, layer))
        if closed and kept:
            self.rings.append(tuple(kept))
        else:
            self.pieces.extend(kept)

    def is_flat(
        self, heights: FloatArray, handle: str | None, kind: str, place: FloatArray
    ) -> bool:
        """Accept curves at constant height (noting a height other than 0), refuse the others."""
        spread = float(np.ptp(heights))
        if spread > self.flatness:
            text = f"{kind} ignored: it is tilted against the XY plane by {spread:.6g} mm"
            self.note(Severity.WARNING, "tilted", text, handle, place, spread)
            return False
        height = float(np.mean(heights))
        if abs(height) > self.flatness:
            self.raised[round(height, 6)] += 1
        return True


def extract(
    document: Document,
    selected: Callable[[str], bool],
    scale: float,
    flatness: float,
    angular_tolerance: float,
) -> Extraction:
    """Turn the model space into curves.

    Parameters
    ----------
    document : ezdxf document
    selected : callable
        Whether a layer, by its name, takes part.
    scale : float
        Length of a drawing unit in mm.
    flatness : float
        Height differences, in mm, up to which a curve counts as level.
    angular_tolerance : float
        Turn in radians above which a spline is cut at a corner inside it.

    Returns
    -------
    Extraction
        Everything that was dropped, mended or ignored is among its findings.
    """
    collector = _Collector(document, selected, flatness, angular_tolerance)
    root = _Context(np.diag([scale, scale, scale, 1.0]))
    for entity in document.modelspace():
        _visit(entity, root, collector)
    _summarise(collector)
    return Extraction(tuple(collector.pieces), tuple(collector.rings), tuple(collector.findings))


def _summarise(collector: _Collector) -> None:
    """Add the findings that are counts."""
    for kind, count in sorted(collector.ignored.items()):
        severity = Severity.INFO if kind in _ANNOTATION else Severity.WARNING
        text = f"{count} {kind} ignored: not a contour"
        handle = collector.first_ignored[kind]
        collector.note(severity, "ignored-type", text, handle, size=float(count))
    for (layer, state), count in sorted(collector.hidden.items()):
        what = "invisible entities" if state == "invisible" else f"entities on {state} layer"
        text = f"{count} {what} {layer!r} ignored".replace("entities '", "entities of layer '")
        collector.note(Severity.WARNING, "hidden", text, None, size=float(count))
    for height, count in sorted(collector.raised.items()):
        text = f"{count} entities at z = {height:g} mm projected to z = 0"
        collector.note(Severity.REPAIR, "projected", text, None, size=height)
    if collector.unselected:
        text = f"{collector.unselected} entities on layers that were not asked for"
        size = float(collector.unselected)
        collector.note(Severity.INFO, "other-layers", text, None, size=size)
    paper = sum(
        len(layout.query("*[layer!='']").filter(lambda e: e.dxftype() != "VIEWPORT"))
        for layout in collector.document.layouts
        if not layout.is_modelspace
    )
    if paper:
        text = f"{paper} entities in paper space ignored"
        collector.note(Severity.INFO, "paper-space", text, None, size=float(paper))


def _visit(entity: Any, context: _Context, collector: _Collector) -> None:
    """Sort one entity: hidden, not selected, a block reference, a curve, or ignored."""
    kind = entity.dxftype()
    layer = str(entity.dxf.get("layer", "0")) if entity.dxf.is_supported("layer") else "0"
    # Layer 0 inside a block means the layer of the reference.
    if layer == "0" and context.layer is not None:
        layer = context.layer
    state = collector.hidden_by(layer)
    if state is None and entity.dxf.is_supported("invisible") and entity.dxf.get("invisible"):
        state = "invisible"
    if kind == "INSERT":
        # A frozen reference hides its contents; an off one leaves them to their own layers.
        if state in ("frozen", "invisible"):
            collector.hidden[layer, state] += 1
        else:
            _visit_insert(entity, layer, context, collector)
        return
    if not collector.selected(layer):
        collector.unselected += 1
        return
    if state is not None:
        collector.hidden[layer, state] += 1
        return
    reader = _READERS.get(kind)
    if reader is None:
        collector.ignored[kind] += 1
        collector.first_ignored.setdefault(kind, entity.dxf.get("handle"))
        return
    handle = entity.dxf.get("handle")
    from ezdxf.lldxf.const import DXFError

    try:
        reader(entity, handle, layer, context.matrix, collector)
    except (GeometryError, DXFError, ValueError) as problem:
        text = f"{kind} ignored: {' '.join(str(problem).split())}"
        collector.note(Severity.WARNING, "invalid-entity", text, handle)


def _visit_insert(entity: Any, layer: str, context: _Context, collector: _Collector) -> None:
    """Walk the block of a reference once per place of its array."""
    handle = entity.dxf.get("handle")
    name = str(entity.dxf.get("name", ""))
    block = entity.block()
    if block is None or block.block is None or block.block.is_xref:
        text = f"INSERT ignored: block {name!r} is missing or external"
        collector.note(Severity.WARNING, "missing-block", text, handle)
        return
    if name.lower() in context.blocks:
        text = f"INSERT ignored: block {name!r} contains itself"
        collector.note(Severity.WARNING, "block-cycle", text, handle)
        return
    dxf = entity.dxf
    scales = [float(dxf.get(key, 1.0)) for key in ("xscale", "yscale", "zscale")]
    angle = math.radians(float(dxf.get("rotation", 0.0)))
    cosine, sine = math.cos(angle), math.sin(angle)
    placed = _ocs_matrix(entity) @ _translation(dxf.get("insert", (0.0, 0.0, 0.0)))
    placed[:, :2] = placed[:, :2] @ np.array([[cosine, -sine], [sine, cosine]])
    base = np.array(tuple(block.block.dxf.get("base_point", (0.0, 0.0, 0.0))), dtype=np.float64)
    local = np.diag([*scales, 1.0]) @ _translation(-base)
    if not (np.all(np.isfinite(placed)) and np.all(np.isfinite(local))):
        text = f"INSERT of {name!r} ignored: placed by what is no number"
        collector.note(Severity.WARNING, "degenerate-insert", text, handle)
        return
    if abs(scales[0] * scales[1]) < 1e-12:
        text = f"INSERT of {name!r} ignored: scaled to nothing ({scales[0]:g} x {scales[1]:g})"
        place = (context.matrix @ placed)[:2, 3]
        collector.note(Severity.WARNING, "degenerate-insert", text, handle, place)
        return
    columns = max(1, int(dxf.get("column_count", 1)))
    rows = max(1, int(dxf.get("row_count", 1)))
    step_x = float(dxf.get("column_spacing", 0.0))
    step_y = float(dxf.get("row_spacing", 0.0))
    # Places of an array that coincide are one place drawn several times.
    places = {
        (column * step_x, row * step_y): None for row in range(rows) for column in range(columns)
    }
    for x, y in places:
        matrix = context.matrix @ placed @ _translation((x, y, 0.0)) @ local
        inner = _Context(matrix, layer, (*context.blocks, name.lower()))
        for child in block:
            _visit(child, inner, collector)


def _translation(vector: Iterable[float]) -> FloatArray:
    matrix = np.eye(4)
    values = [float(value) for value in vector]
    matrix[: len(values), 3] = values
    return matrix


def _ocs_matrix(entity: Any) -> FloatArray:
    """Return the 4 x 4 map from the entity's own coordinates to those around it."""
    from ezdxf.math import OCS

    ocs = OCS(entity.dxf.get("extrusion", (0.0, 0.0, 1.0)))
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = tuple(ocs.ux), tuple(ocs.uy), tuple(ocs.uz)
    return matrix


def _add_plane_curves(
    curves: Sequence[Curve],
    elevation: float,
    matrix: FloatArray,
    entity: Any,
    handle: str | None,
    layer: str,
    collector: _Collector,
    *,
    closed: bool,
) -> None:
    """Map curves that lie in the entity's own plane to the world and take them over."""
    plane = matrix @ _ocs_matrix(entity)
    offset = plane[:3, 2] * elevation + plane[:3, 3]
    boxes = np.array([curve.bounds() for curve in curves])
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    world = corners @ plane[:3, :2].T + offset
    if not collector.is_flat(world[:, 2], handle, entity.dxftype(), world.mean(axis=0)):
        return
    affine = np.column_stack([plane[:2, :2], offset[:2]])
    if np.array_equal(affine, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]):
        mapped: list[Curve] = list(curves)
    else:
        mapped = [curve.transformed(affine) for curve in curves]
    collector.add(mapped, handle, layer, closed)


def _world_points(points: Any, matrix: FloatArray) -> FloatArray:
    array = np.array([tuple(point) for point in points], dtype=np.float64).reshape(-1, 3)
    return array @ matrix[:3, :3].T + matrix[:3, 3]


def _read_line(
    entity: Any, handle: str | None, layer: str, matrix: FloatArray, collector: _Collector
) -> None:
    points = _world_points([entity.dxf.start, entity.dxf.end], matrix)
    if not np.all(np.isfinite(points)):
        raise ValueError("coordinates that are no numbers")
    if not collector.is_flat(points[:, 2], handle, "LINE", points.mean(axis=0)):
        return
    if float(np.hypot(*(points[1, :2] - points[0, :2]))) < SHORTEST:
        text = "LINE of no length dropped"
        collector.note(Severity.REPAIR, "zero-length", text, handle, points[0], 0.0)
        return
    collector.add([Line(points[0, :2], points[1, :2])], handle, layer, closed=False)


def _read_circular(
    entity: Any, handle: str | None, layer: str, matrix: FloatArray, collector: _Collector
) -> None:
    """Read CIRCLE and ARC."""
    kind = entity.dxftype()
    centre = np.array(tuple(entity.dxf.center), dtype=np.float64)
    radius = float(entity.dxf.radius)
    if not math.isfinite(radius) or abs(radius) * float(np.abs(matrix[:2, :3]).max()) < SHORTEST:
        text = f"{kind} of no radius dropped"
        place = _world_points([centre], matrix @ _ocs_matrix(entity))[0]
        collector.note(Severity.REPAIR, "zero-length", text, handle, place, 0.0)
        return
    if radius < 0.0:
        # The equation of the circle does not see the sign.
        text = f"{kind} with the negative radius {radius:g} taken as {-radius:g}"
        place = _world_points([centre], matrix @ _ocs_matrix(entity))[0]
        collector.note(Severity.REPAIR, "negative-radius", text, handle, place, radius)
        radius = -radius
    start, sweep = 0.0, 2.0 * math.pi
    if kind == "ARC":
        first, last = float(entity.dxf.start_angle), float(entity.dxf.end_angle)
        start, sweep = math.radians(first), math.radians(_turn(last - first, 360.0))
    closed = sweep == 2.0 * math.pi
    arc = Arc(centre[:2], radius, start, sweep)
    _add_plane_curves(
        [arc], float(centre[2]), matrix, entity, handle, layer, collector, closed=closed
    )


def _turn(difference: float, full: float) -> float:
    """Return a counter-clockwise turn in (0, full]; equal angles mean a full turn."""
    turn = difference % full
    return full if turn < 1e-9 or full - turn < 1e-9 else turn


def _read_ellipse(
    entity: Any, handle: str | None, layer: str, matrix: FloatArray, collector: _Collector
) -> None:
    centre = _world_points([entity.dxf.center], matrix)[0]
    axis = np.array(tuple(entity.dxf.major_axis), dtype=np.float64)
    normal = np.array(tuple(entity.dxf.get("extrusion", (0.0, 0.0, 1.0))), dtype=np.float64)
    normal /= np.linalg.norm(normal)
    major = matrix[:3, :3] @ axis
    minor = matrix[:3, :3] @ (np.cross(normal, axis) * float(entity.dxf.ratio))
    rise = math.hypot(major[2], minor[2])
    heights = np.array([centre[2] - rise, centre[2] + rise])
    if not collector.is_flat(heights, handle, "ELLIPSE", centre):
        return
    if abs(major[0] * minor[1] - major[1] * minor[0]) < SHORTEST * float(np.hypot(*major[:2])):
        text = "ELLIPSE without width dropped"
        collector.note(Severity.REPAIR, "zero-length", text, handle, centre, 0.0)
        return
    start = float(entity.dxf.start_param)
    sweep = _turn(float(entity.dxf.end_param) - start, 2.0 * math.pi)
    curve = ellipse_or_circle(centre[:2], major[:2], minor[:2], start, sweep)
    collector.add([curve], handle, layer, closed=sweep == 2.0 * math.pi)


def ellipse_or_circle(
    centre: FloatArray, major: FloatArray, minor: FloatArray, start: float, sweep: float
) -> Curve:
    """Return the elliptical arc, as an Arc where its conjugate half-axes make a circle."""
    length, width = float(np.hypot(*major)), float(np.hypot(*minor))
    if abs(length - width) <= 1e-12 * length and abs(float(major @ minor)) <= 1e-12 * length**2:
        side = math.copysign(1.0, major[0] * minor[1] - major[1] * minor[0])
        zero = math.atan2(major[1], major[0])
        return Arc(centre, length, zero + side * start, side * sweep)
    return EllipticalArc(centre, major, minor, start, sweep)


def _read_lwpolyline(
    entity: Any, handle: str | None, layer: str, matrix: FloatArray, collector: _Collector
) -> None:
    rows = np.array(entity.get_points("xyseb"), dtype=np.float64).reshape(-1, 5)
    width = np.any(rows[:, 2:4] != 0.0) or float(entity.dxf.get("const_width", 0.0)) != 0.0
    if width:
        text = "width of LWPOLYLINE ignored: its centre line is the contour"
        collector.note(Severity.INFO, "polyline-width", text, handle)
    elevation = float(entity.dxf.get("elevation", 0.0))
    closed = bool(entity.closed)
    curves = _bulged(rows[:, :2], rows[:, 4], closed, handle, matrix, entity, collector)
    if curves:
        _add_plane_curves(
            curves, elevation, matrix, entity, handle, layer, collector, closed=closed
        )


def _read_polyline(
    entity: Any, handle: str | None, layer: str, matrix: FloatArray, collector: _Collector
) -> None:
    """Read the old POLYLINE: 2D with bulges, 3D when level; meshes are ignored."""
    mode = entity.get_mode()
    if mode not in ("AcDb2dPolyline", "AcDb3dPolyline"):
        name = f"POLYLINE ({mode})"
        collector.ignored[name] += 1
        collector.first_ignored.setdefault(name, handle)
        return
    # Vertices with flag 16 only frame a fitted spline; the curve itself has its own vertices.
    vertices = [vertex for vertex in entity.vertices if not int(vertex.dxf.get("flags", 0)) & 16]
    if not all(vertex.dxf.hasattr("location") for vertex in vertices):
        raise ValueError("a vertex has no location")
    closed = bool(entity.is_closed)
    located = np.array([tuple(v.dxf.location) for v in vertices], dtype=np.float64).reshape(-1, 3)
    if mode == "AcDb3dPolyline":
        points = _world_points(located, matrix)
        if len(points) and not collector.is_flat(
            points[:, 2], handle, "POLYLINE", points.mean(axis=0)
        ):
            return
        none = np.zeros(len(points))
        flat = _bulged(points[:, :2], none, closed, handle, np.eye(4), None, collector)
        collector.add(flat, handle, layer, closed)
        return
    widths = [
        float(item.dxf.get(name, 0.0))
        for item, prefix in [(entity, "default_"), *((vertex, "") for vertex in vertices)]
        for name in (prefix + "start_width", prefix + "end_width")
    ]
    if any(widths):
        text = "width of POLYLINE ignored: its centre line is the contour"
        collector.note(Severity.INFO, "polyline-width", text, handle)
    bulges = np.array([float(vertex.dxf.get("bulge", 0.0)) for vertex in vertices])
    elevation = float(tuple(entity.dxf.get("elevation", (0.0, 0.0, 0.0)))[2])
    curves = _bulged(located[:, :2], bulges, closed, handle, matrix, entity, collector)
    if curves:
        _add_plane_curves(
            curves, elevation, matrix, entity, handle, layer, collector, closed=closed
        )


def _bulged(
    points: FloatArray,
    bulges: FloatArray,
    closed: bool,
    handle: str | None,
    matrix: FloatArray,
    entity: Any | None,
    collector: _Collector,
) -> list[Curve]:
    """Return the lines and arcs of a polyline in its own coordinates.

    A vertex on top of the next one is dropped together with its bulge.
    """
    if not (np.all(np.isfinite(points)) and np.all(np.isfinite(bulges))):
        raise ValueError("coordinates that are no numbers")
    plane = matrix if entity is None else matrix @ _ocs_matrix(entity)
    steps = (np.roll(points, -1, axis=0) - points) @ plane[:3, :2].T
    double = np.hypot(np.hypot(steps[:, 0], steps[:, 1]), steps[:, 2]) < SHORTEST
    if not closed and len(points):
        double[-1] = False
    if np.any(double):
        where = points[double][0] @ plane[:2, :2].T + plane[:2, 3]
        text = f"{int(double.sum())} repeated vertices dropped"
        size = float(double.sum())
        collector.note(Severity.REPAIR, "repeated-vertex", text, handle, where, size)
        points, bulges = points[~double], bulges[~double]
    if len(points) < 2:
        text = "polyline with fewer than two different vertices dropped"
        collector.note(Severity.REPAIR, "zero-length", text, handle, size=0.0)
        return []
    ends = np.roll(points, -1, axis=0)
    count = len(points) if closed else len(points) - 1
    chords = np.hypot(*(ends - points).T)
    # A sagitta below rounding makes a straight line.
    straight = np.abs(bulges) * chords <= 1e-12 * (1.0 + float(np.abs(points).max()))
    return [
        Line(points[index], ends[index])
        if straight[index]
        else Arc.from_bulge(points[index], ends[index], float(bulges[index]))
        for index in range(count)
    ]


def _read_spline(
    entity: Any, handle: str | None, layer: str, matrix: FloatArray, collector: _Collector
) -> None:
    control = _world_points(entity.control_points, matrix)
    fit = _world_points(entity.fit_points, matrix)
    heights = np.concatenate([control[:, 2], fit[:, 2]]) if len(control) == 0 else control[:, 2]
    if len(heights) == 0:
        raise ValueError("it has neither control points nor fit points")
    place = (control if len(control) else fit).mean(axis=0)
    if not collector.is_flat(heights, handle, "SPLINE", place):
        return
    tangents = None
    if entity.dxf.hasattr("start_tangent") and entity.dxf.hasattr("end_tangent"):
        pair = (tuple(entity.dxf.start_tangent), tuple(entity.dxf.end_tangent))
        tangents = (np.array(pair) @ matrix[:3, :3].T)[:, :2]
    if len(control) == 0:
        text = f"SPLINE given by {len(fit)} fit points only: cubic interpolated through them"
        collector.note(Severity.INFO, "fit-points", text, handle, fit[0], float(len(fit)))
    curves, closed = spline_curves(
        int(entity.dxf.get("degree", 3)),
        np.array(entity.knots, dtype=np.float64),
        control[:, :2],
        np.array(entity.weights, dtype=np.float64),
        fit[:, :2],
        tangents,
        declared_closed=bool(entity.closed),
        angular_tolerance=collector.angular_tolerance,
    )
    collector.add(curves, handle, layer, closed)


_READERS: Final[dict[str, Callable[[Any, str | None, str, FloatArray, _Collector], None]]] = {
    "LINE": _read_line,
    "ARC": _read_circular,
    "CIRCLE": _read_circular,
    "ELLIPSE": _read_ellipse,
    "LWPOLYLINE": _read_lwpolyline,
    "POLYLINE": _read_polyline,
    "SPLINE": _read_spline,
}
