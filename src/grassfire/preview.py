"""Pictures of programs and of medial axes, as SVG text with deterministic numbers.

A program is drawn from what was read back from its text, never from the plan, so that the picture
shows what the machine will do. Coordinates in the drawing are millimetres with y pointing up,
turned over while they are written because y points down in SVG.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from grassfire.toolpath import MoveKind, Program, Role, Section, Toolpath

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Value = TypeVar("Value", float, FloatArray)
"""One number or many."""

Traces = dict[tuple[int, int], str]
"""Path data of a section by layer and level."""

_PAPER = "#ffffff"
_INK = "#22262b"
_STOCK = "#f2c9a1"
_FLOOR = "#e9eef2"
_SHALLOW = (127, 190, 235)
_DEEP = (10, 44, 110)
_LEGEND_WIDTH = 190.0
_MARGIN = 24.0
_FONT = 'font-family="DejaVu Sans, Helvetica, Arial, sans-serif"'
_LEVEL_STEP = 1e-3
_LEGEND_LEVELS = 12

_ROLE_COLOUR = {
    Role.RAPID: "#d62728",
    Role.LINK: "#d99a00",
    Role.LEAD: "#0b9a8d",
    Role.ENTRY: "#8e3fb0",
    Role.FINISH: "#17803d",
}
_ROLE_WORDS = {
    Role.FINISH: "wall pass",
    Role.LEAD: "lead in and out",
    Role.ENTRY: "entry",
    Role.LINK: "link in cleared area",
    Role.RAPID: "rapid",
}


def _number(value: float, digits: int = 3) -> str:
    """Fixed decimals without trailing zeros and without a negative zero."""
    text = f"{value:.{digits}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _mix(share: float) -> str:
    """Colour between shallow (0) and deep (1)."""
    mixed = (round(a + (b - a) * share) for a, b in zip(_SHALLOW, _DEEP, strict=True))
    return "#" + "".join(f"{value:02x}" for value in mixed)


@dataclass
class _Canvas:
    """Maps millimetres to pixels and collects elements."""

    bounds: tuple[float, float, float, float]
    width: float
    elements: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        x0, y0, x1, y1 = self.bounds
        room = self.width - _LEGEND_WIDTH - 2 * _MARGIN
        # A tall part gets a narrower picture rather than one that runs off the screen.
        self.scale = min(room / max(x1 - x0, 1e-9), 1.2 * room / max(y1 - y0, 1e-9))
        self.drawing_height = (y1 - y0) * self.scale
        self.top = _MARGIN + 26.0

    def x(self, value: Value) -> Value:
        return _MARGIN + (value - self.bounds[0]) * self.scale

    def y(self, value: Value) -> Value:
        return self.top + (self.bounds[3] - value) * self.scale

    def places(self, points: FloatArray) -> list[str]:
        """Points (n, 2) in mm as SVG coordinates."""
        x, y = self.x(points[:, 0]).tolist(), self.y(points[:, 1]).tolist()
        return [f"{_number(a, 2)} {_number(b, 2)}" for a, b in zip(x, y, strict=True)]

    def polygon(self, points: FloatArray) -> str:
        """Path data of a closed polyline in mm."""
        return "M" + "L".join(self.places(points)) + "Z"

    def path(self, data: str, stroke: str, width: float, extra: str = "") -> None:
        if data:
            self.elements.append(
                f'<path d="{data}" fill="none" stroke="{stroke}" '
                f'stroke-width="{_number(width, 2)}"{" " + extra if extra else ""}/>'
            )

    def text(self, x: float, y: float, words: str, size: float = 12, extra: str = "") -> None:
        self.elements.append(
            f'<text x="{_number(x, 1)}" y="{_number(y, 1)}" font-size="{_number(size)}" '
            f'fill="{_INK}"{" " + extra if extra else ""}>{escape(words, quote=False)}</text>'
        )

    def render(self, title: str, legend_height: float) -> str:
        height = self.top + max(self.drawing_height + 46.0, legend_height) + _MARGIN
        drawn = (self.bounds[2] - self.bounds[0]) * self.scale
        width = drawn + 2 * _MARGIN + _LEGEND_WIDTH
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{_number(width, 0)}" '
            f'height="{_number(height, 0)}" '
            f'viewBox="0 0 {_number(width, 0)} {_number(height, 0)}" {_FONT}>'
        )
        # Rapids from far away must not run across the legend.
        frame = (
            f'<clipPath id="drawing"><rect x="{_number(_MARGIN, 2)}" y="{_number(self.top, 2)}" '
            f'width="{_number(drawn, 2)}" height="{_number(self.drawing_height, 2)}"/></clipPath>'
        )
        back = f'{frame}<rect width="100%" height="100%" fill="{_PAPER}"/>'
        lines = [
            head,
            f"<title>{escape(title, quote=False)}</title>",
            back,
            *self.elements,
            "</svg>",
        ]
        return "\n".join(lines) + "\n"


def _scale_bar(canvas: _Canvas) -> None:
    """A bar of 1, 2 or 5 times a power of ten mm, about a fifth of the drawing wide."""
    target = (canvas.bounds[2] - canvas.bounds[0]) / 5
    power = 10.0 ** math.floor(math.log10(max(target, 1e-6)))
    length = power * max(step for step in (1, 2, 5) if step * power <= target * (1 + 1e-9))
    x, y = _MARGIN, canvas.top + canvas.drawing_height + 26.0
    end = x + length * canvas.scale
    canvas.path(f"M{_number(x, 2)} {_number(y - 4, 2)}v8m0 -4H{_number(end, 2)}m0 -4v8", _INK, 1.2)
    canvas.text(end + 8, y + 4, f"{length:g} mm", 12)


def _bounds(points: Iterable[FloatArray], pad: float) -> tuple[float, float, float, float]:
    stacked = np.concatenate([np.zeros((0, 2)), *points])
    stacked = stacked[np.all(np.isfinite(stacked), axis=1)]
    if len(stacked) == 0:
        stacked = np.zeros((1, 2))
    low, high = stacked.min(axis=0), stacked.max(axis=0)
    pad = max(pad, 0.02 * float(np.max(high - low)), 0.5)
    return (
        float(low[0]) - pad,
        float(low[1]) - pad,
        float(high[0]) + pad,
        float(high[1]) + pad,
    )


def _move_points(path: Toolpath) -> FloatArray:
    """(m, 2) ends of the moves that cut, and the sides of the circles of arcs among them."""
    cutting = path.kind != MoveKind.RAPID
    arcs = path.is_arc
    centre = path.centre[arcs]
    # Only quarter points that the arc really passes would be tight; a sixteenth of the sweep is.
    radius = np.hypot(*(path.begin[arcs, :2] - centre).T)
    first = path.begin[arcs, :2] - centre
    angle = np.arctan2(first[:, 1], first[:, 0])[:, None]
    angles = angle + path.sweep[arcs][:, None] * np.linspace(0.0, 1.0, 17)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * radius[:, None, None]
    on_arcs = (ring + centre[:, None, :]).reshape(-1, 2)
    return np.concatenate([path.begin[cutting, :2], path.end[cutting, :2], on_arcs])


def _words(canvas: _Canvas, path: Toolpath, rows: IntArray) -> list[str]:
    """Path data of some moves (of n rows), from where they begin."""
    begin, end, sweep = path.begin[rows, :2], path.end[rows, :2], path.sweep[rows]
    goals, arcs = canvas.places(end), path.is_arc[rows].tolist()
    spoke = begin - path.centre[rows]
    radius = np.hypot(spoke[:, 0], spoke[:, 1])
    sizes = (radius * canvas.scale).tolist()
    words = [
        _arc_word(size, turn, goal) if arc else "L" + goal
        for arc, size, turn, goal in zip(arcs, sizes, sweep.tolist(), goals, strict=True)
    ]
    # One SVG arc cannot draw a full turn, and near one its centre is badly conditioned.
    parted = np.flatnonzero(path.is_arc[rows] & (np.abs(sweep) >= 0.9 * math.pi))
    start = np.arctan2(spoke[parted, 1], spoke[parted, 0])
    for part in (2, 1):
        angle = start + sweep[parted] * part / 3
        way = radius[parted, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        places = canvas.places(path.centre[rows[parted]] + way)
        for index, place in zip(parted.tolist(), places, strict=True):
            head = words[index].split(" ", 5)[:5]
            words[index] = " ".join([*head, place]) + words[index]
    return words


def _arc_word(radius: float, sweep: float, goal: str) -> str:
    size = _number(radius, 2)
    return f"A{size} {size} 0 0 {0 if sweep > 0 else 1} {goal}"


def _floors(section: Section) -> list[float]:
    """Heights of the floors that a section cuts, highest first.

    Links just above a floor are flat, too: a height counts if a tenth as much is cut there as on
    the busiest one.
    """
    path = section.toolpath
    flat = np.isin(path.role, [Role.CUT, Role.FINISH, Role.LEAD])
    flat &= np.abs(path.end[:, 2] - path.begin[:, 2]) < _LEVEL_STEP
    flat &= np.isfinite(path.length)
    steps, owner = np.unique(
        np.round(path.end[flat, 2] / _LEVEL_STEP).astype(int), return_inverse=True
    )
    if len(steps) == 0:
        return []
    lengths = np.bincount(owner, weights=path.length[flat])
    busy = steps[lengths >= 0.1 * lengths.max()]
    return [value * _LEVEL_STEP for value in busy.tolist()[::-1]]


def _levels(sections: Sequence[Section]) -> list[float]:
    """Heights of all floors, highest first."""
    return sorted({height for section in sections for height in _floors(section)}, reverse=True)


_LAYER = {Role.RAPID: 0, Role.LINK: 1, Role.CUT: 2, Role.FINISH: 3, Role.LEAD: 4, Role.ENTRY: 5}
"""Drawing order of moves: rapids, links, cuts from the top down, wall, leads, entries."""


def _layers(path: Toolpath, rows: IntArray, levels: Sequence[float]) -> IntArray:
    """Layer of some moves and, of cuts, the number of the nearest level: (2, n)."""
    order = np.zeros(max(_LAYER) + 1, dtype=np.int64)
    order[list(_LAYER)] = list(_LAYER.values())
    layer = order[path.role[rows]]
    level = np.zeros(len(rows), dtype=np.int64)
    if levels:
        gap = np.abs(np.array(levels)[:, None] - path.end[rows, 2])
        level = np.where(layer == _LAYER[Role.CUT], gap.argmin(axis=0), 0)
    return np.stack([layer, level])


def _trace(canvas: _Canvas, section: Section, levels: Sequence[float]) -> Traces:
    """Path data of a section by layer; also layer (-1, 0): the sweep of the tool on the floor."""
    path = section.toolpath
    begin, end = path.begin, path.end
    known = np.all(np.isfinite(begin[:, :2]), axis=1) & np.all(np.isfinite(end[:, :2]), axis=1)
    moving = known & (np.any(begin[:, :2] != end[:, :2], axis=1) | path.is_arc)
    rows = np.flatnonzero(moving)
    begin, end = begin[rows], end[rows]
    words, layers = _words(canvas, path, rows), _layers(path, rows, levels)
    chosen = {
        (layer, level): np.flatnonzero((layers[0] == layer) & (layers[1] == level))
        for layer, level in sorted(set(zip(*layers.tolist(), strict=True)))
    }
    if _diameter(section) > 0 and len(rows):
        floor = np.nanmin(path.end[:, 2])
        on_floor = np.abs(end[:, 2] - floor) < _LEVEL_STEP
        chosen[-1, 0] = np.flatnonzero(on_floor & (path.kind[rows] != MoveKind.RAPID))
    return {
        layer: _joined(canvas, begin[own, :2], end[own, :2], [words[row] for row in own.tolist()])
        for layer, own in chosen.items()
        if len(own)
    }


def _joined(canvas: _Canvas, begin: FloatArray, end: FloatArray, words: list[str]) -> str:
    """Path data of moves, joined where they meet."""
    apart = np.flatnonzero(np.append(True, np.any(begin[1:] != end[:-1], axis=1)))
    for index, place in zip(apart.tolist(), canvas.places(begin[apart]), strict=True):
        words[index] = f"M{place}{words[index]}"
    return "".join(words)


def _diameter(section: Section) -> float:
    """Tool diameter, mm; 0 where the program does not tell."""
    return section.tool_diameter if math.isfinite(section.tool_diameter) else 0.0


def _entry_points(section: Section) -> list[tuple[float, float]]:
    """Where the tool starts to go down into the stock."""
    path = section.toolpath
    entering = path.role == Role.ENTRY
    first = entering & ~np.concatenate([[False], entering[:-1]])
    points = path.begin[first, :2]
    return sorted({(float(x), float(y)) for x, y in points.tolist() if math.isfinite(x + y)})


def _draw_traces(
    canvas: _Canvas,
    sections: Sequence[Section],
    traces: Sequence[Traces],
    levels: Sequence[float],
) -> None:
    """Strokes in drawing order; upper floors are wider so that they show beside deeper ones."""
    round_ends = 'stroke-linecap="round" stroke-linejoin="round"'
    for section, layers in zip(sections, traces, strict=True):
        if (-1, 0) in layers:
            canvas.path(layers[(-1, 0)], _FLOOR, _diameter(section) * canvas.scale, round_ends)
    keys = sorted({key for layers in traces for key in layers if key[0] >= 0})
    roles = {0: Role.RAPID, 1: Role.LINK, 3: Role.FINISH, 4: Role.LEAD, 5: Role.ENTRY}
    for key in keys:
        for section, layers in zip(sections, traces, strict=True):
            if key not in layers:
                continue
            thin = min(1.4, max(0.35, 0.06 * _diameter(section) * canvas.scale))
            if key[0] == 2:
                below = sum(1 for other in layers if other[0] == 2 and other[1] > key[1])
                width = thin * (1.0 + 1.6 * min(below, 3))
                canvas.path(layers[key], _level_colour(key[1], levels), width, round_ends)
            elif key[0] == 0:
                canvas.path(layers[key], _ROLE_COLOUR[Role.RAPID], 0.8, 'stroke-dasharray="5 4"')
            else:
                colour = _ROLE_COLOUR[roles[key[0]]]
                canvas.path(layers[key], colour, thin * 1.15, round_ends)


def _level_colour(index: int, levels: Sequence[float]) -> str:
    return _mix(1.0 if len(levels) < 2 else index / (len(levels) - 1))


def _legend(
    canvas: _Canvas,
    rows: Sequence[tuple[str, str]],
    title: str,
    notes: Sequence[str],
) -> float:
    """Swatch and words per row, right of the drawing; the height it takes, px.

    A swatch is a colour, or "dash" / "fill" / "ring" and a colour.
    """
    left = 2 * _MARGIN + (canvas.bounds[2] - canvas.bounds[0]) * canvas.scale
    canvas.text(_MARGIN, _MARGIN + 6, title, 16, 'font-weight="bold"')
    y = canvas.top + 10
    for swatch, words in rows:
        kind, _, colour = swatch.rpartition(" ")
        if kind == "fill":
            canvas.elements.append(
                f'<rect x="{_number(left, 1)}" y="{_number(y - 9, 1)}" width="26" height="10" '
                f'fill="{colour}" stroke="{_INK}" stroke-width="0.5"/>'
            )
        elif kind == "ring":
            canvas.elements.append(
                f'<circle cx="{_number(left + 13, 1)}" cy="{_number(y - 4, 1)}" r="3.5" '
                f'fill="{_PAPER}" stroke="{colour}" stroke-width="1.4"/>'
            )
        else:
            dash = 'stroke-dasharray="5 4"' if kind == "dash" else ""
            canvas.path(
                f"M{_number(left, 1)} {_number(y - 4, 1)}h26", colour, 1.2 if dash else 2.4, dash
            )
        canvas.text(left + 34, y, words)
        y += 19
    y += 8
    for note in notes:
        canvas.text(left, y, note, 11)
        y += 16
    return y - canvas.top


def _program_legend(
    traces: Sequence[Traces],
    levels: Sequence[float],
    walls: bool,
) -> list[tuple[str, str]]:
    """Legend rows of what is in the picture, and of nothing else."""
    present = {key[0] for layers in traces for key in layers}
    rows: list[tuple[str, str]] = []
    if walls:
        rows += [(_INK, "pocket wall"), (f"fill {_STOCK}", "left standing")]
    if -1 in present:
        rows.append((f"fill {_FLOOR}", "cut to the floor"))
    cut = sorted({key[1] for layers in traces for key in layers if key[0] == 2})
    if len(cut) > _LEGEND_LEVELS:
        picks = np.unique(np.linspace(0, len(cut) - 1, _LEGEND_LEVELS).round().astype(int))
        cut = [cut[index] for index in picks.tolist()]
    rows += [
        (_level_colour(index, levels), f"cut at z {_number(levels[index])} mm")
        for index in cut
        if levels
    ]
    order = {Role.FINISH: 3, Role.LEAD: 4, Role.LINK: 1, Role.ENTRY: 5, Role.RAPID: 0}
    for role, layer in order.items():
        if layer in present:
            dash = "dash " if role == Role.RAPID else ""
            rows.append((f"{dash}{_ROLE_COLOUR[role]}", _ROLE_WORDS[role]))
    return rows


def _fill_walls(canvas: _Canvas, walls: Sequence[FloatArray], colour: str) -> None:
    data = "".join(canvas.polygon(wall) for wall in walls)
    if data:
        canvas.elements.append(f'<path d="{data}" fill="{colour}" fill-rule="evenodd"/>')


def svg(
    program: Program,
    walls: Sequence[FloatArray] = (),
    *,
    title: str | None = None,
    width: float = 1000.0,
    marks: Sequence[tuple[float, float, str]] = (),
) -> str:
    """Draw a program from above.

    Parameters
    ----------
    program : Program
        As read back from the text, mm.
    walls : sequence of (n, 2) arrays
        Closed boundaries of the pockets, mm: outer ones and islands in any order.
    title : str, optional
        Heading; the name of the program by default.
    width : float
        Greatest width of the picture in pixels; it is less where a part is tall.
    marks : sequence of (x, y, words)
        Places in mm that get a numbered ring each; their words stand under the legend.

    Returns
    -------
    str
        SVG text; the same for the same input, byte by byte.
    """
    sections = [section for section in program.sections if len(section.toolpath)]
    widest = max((_diameter(section) for section in sections), default=0.0)
    paths = [_move_points(section.toolpath) for section in sections]
    canvas = _Canvas(_bounds([*walls, *paths], 0.0 if walls else widest / 2), width)
    levels = _levels(sections)
    traces = [_trace(canvas, section, levels) for section in sections]
    _fill_walls(canvas, walls, _STOCK)
    canvas.elements.append('<g clip-path="url(#drawing)">')
    _draw_traces(canvas, sections, traces, levels)
    canvas.elements.append("</g>")
    for wall in walls:
        canvas.path(canvas.polygon(wall), _INK, 1.3, 'stroke-linejoin="round"')
    rows = _program_legend(traces, levels, bool(walls))
    points = [point for section in sections for point in _entry_points(section)]
    for x, y in points:
        canvas.elements.append(
            f'<circle cx="{_number(canvas.x(x), 2)}" cy="{_number(canvas.y(y), 2)}" r="3" '
            f'fill="{_PAPER}" stroke="{_ROLE_COLOUR[Role.ENTRY]}" stroke-width="1.4"/>'
        )
    if points:
        rows.append((f"ring {_ROLE_COLOUR[Role.ENTRY]}", "tool goes down here"))
    tools = {section.tool_number: _diameter(section) for section in sections}
    notes = [
        f"T{number}" + (f", {_number(size)} mm" if size > 0 else "")
        for number, size in sorted(tools.items())
    ]
    notes += _draw_marks(canvas, marks)
    name = program.name if title is None else title
    height = _legend(canvas, rows, name, notes)
    _scale_bar(canvas)
    return canvas.render(name, height)


def _draw_marks(canvas: _Canvas, marks: Sequence[tuple[float, float, str]]) -> list[str]:
    """Numbered rings at places, on the edge of the drawing where they lie outside; their words."""
    x0, y0, x1, y1 = canvas.bounds
    colour = _ROLE_COLOUR[Role.RAPID]
    for number, (x, y, _) in enumerate(marks, 1):
        at_x, at_y = canvas.x(min(max(x, x0), x1)), canvas.y(min(max(y, y0), y1))
        canvas.elements.append(
            f'<circle cx="{_number(at_x, 2)}" cy="{_number(at_y, 2)}" r="9" fill="none" '
            f'stroke="{colour}" stroke-width="2"/>'
        )
        canvas.text(at_x + 10, at_y - 8, str(number), 13, 'font-weight="bold"')
    return [f"{number} {words}" for number, (_, _, words) in enumerate(marks, 1)]


def _bezier_points(control: FloatArray, count: int = 33) -> FloatArray:
    """(count, k) points of a polynomial Bezier by de Casteljau's algorithm, all t at once."""
    parameter = np.linspace(0.0, 1.0, count)[:, None, None]
    points = np.broadcast_to(control, (count, *control.shape))
    while points.shape[1] > 1:
        points = (1.0 - parameter) * points[:, :-1] + parameter * points[:, 1:]
    return np.asarray(points[:, 0])


def axis_svg(
    walls: Sequence[FloatArray],
    regions: Sequence[Mapping[str, object]],
    *,
    title: str = "medial axis",
    width: float = 1000.0,
) -> str:
    """Draw medial axes: walls, edges, vertices and the disks at branch points.

    Parameters
    ----------
    walls : sequence of (n, 2) arrays
        Closed boundaries, mm.
    regions : sequence of mappings
        Entries of "regions" as ``grassfire mat --json`` writes them.
    title, width
        As for `svg`.
    """
    canvas = _Canvas(_bounds(walls, 0.0), width)
    _fill_walls(canvas, walls, _FLOOR)
    for wall in walls:
        canvas.path(canvas.polygon(wall), _INK, 1.3, 'stroke-linejoin="round"')
    vertices = [vertex for region in regions for vertex in _mappings(region["vertices"])]
    edges = [edge for region in regions for edge in _mappings(region["edges"])]
    deep, shade = _mix(1.0), _mix(0.35)
    for vertex in vertices:
        if vertex["kind"] == "branch" or not edges:
            canvas.elements.append(_circle(canvas, vertex, None, shade))
    data = "".join(
        "M" + "L".join(canvas.places(_bezier_points(points)))
        for points in (np.asarray(edge["control_points"], dtype=np.float64) for edge in edges)
    )
    canvas.path(data, deep, 1.6, 'stroke-linecap="round" stroke-linejoin="round"')
    colours = {
        "branch": _ROLE_COLOUR[Role.RAPID],
        "end": _ROLE_COLOUR[Role.ENTRY],
        "corner": _ROLE_COLOUR[Role.FINISH],
        "joint": _ROLE_COLOUR[Role.LINK],
    }
    for vertex in vertices:
        canvas.elements.append(_circle(canvas, vertex, 2.6, colours[str(vertex["kind"])]))
    kinds = {str(vertex["kind"]) for vertex in vertices}
    rows = [(_INK, "wall"), (deep, "medial axis")]
    if "branch" in kinds or not edges:
        rows.append((shade, "largest disk there"))
    rows += [(f"ring {colour}", kind) for kind, colour in colours.items() if kind in kinds]
    height = _legend(canvas, rows, title, [f"{len(vertices)} vertices, {len(edges)} edges"])
    _scale_bar(canvas)
    return canvas.render(title, height)


def _mappings(value: object) -> Sequence[Mapping[str, object]]:
    assert isinstance(value, Sequence)
    return value


def _circle(
    canvas: _Canvas, vertex: Mapping[str, object], pixels: float | None, colour: str
) -> str:
    """A marker of `pixels`, or the disk of the vertex where that is None."""
    x, y, radius = (float(str(vertex[key])) for key in ("x", "y", "r"))
    size = radius * canvas.scale if pixels is None else pixels
    return (
        f'<circle cx="{_number(canvas.x(x), 2)}" cy="{_number(canvas.y(y), 2)}" '
        f'r="{_number(size, 2)}" fill="{"none" if pixels is None else _PAPER}" '
        f'stroke="{colour}" stroke-width="{"0.8" if pixels is None else "1.5"}"/>'
    )
