"""A picture of the axis for notebooks: compact SVG text, nothing but the standard library."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from grassfire.geometry import flatten
from grassfire.geometry.chebyshev import bernstein
from grassfire.medial.sites import FloatArray, IntArray

if TYPE_CHECKING:
    from grassfire.medial.axis import MedialAxis

_GRID: Final = 10
"""Coordinates are whole numbers of this part of a pixel."""

_MARGIN: Final = 12 * _GRID
_RADIUS_COLOURS: Final = ("#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#90c931")
"""Edges by radius, from zero to that of the largest disk, in equal steps."""

_KINDS: Final = (
    ("joint", "#999", 3),
    ("corner", "#999", 4),
    ("end", "#c0392b", 5),
    ("branch", "#000", 5),
)
"""Kind of a vertex, colour and diameter of its dot in pixels."""


class _Sheet:
    """Maps millimetres to the grid of the picture, y upwards."""

    def __init__(self, axis: MedialAxis, pixels: float) -> None:
        xmin, ymin, xmax, ymax = axis.region.bounds()
        self.scale = (pixels * _GRID - 2 * _MARGIN) / max(xmax - xmin, ymax - ymin)
        self.corner = np.array([xmin, ymax])
        self.width = round((xmax - xmin) * self.scale) + 2 * _MARGIN
        self.height = round((ymax - ymin) * self.scale) + 2 * _MARGIN

    def place(self, points: FloatArray) -> IntArray:
        """(..., 2) whole numbers."""
        moved = (points - self.corner) * (self.scale, -self.scale) + _MARGIN
        return np.asarray(np.rint(moved), dtype=np.int64)


def svg(axis: MedialAxis, pixels: float = 480.0) -> str:
    """Draw the region, the edges coloured by radius, the vertices by kind, the largest disk.

    Parameters
    ----------
    axis : MedialAxis
    pixels : float
        Longer side of the picture.

    Returns
    -------
    str
        SVG text: the same for the same axis, byte by byte. Curves are drawn to a tenth of a pixel.
    """
    sheet = _Sheet(axis, pixels)
    centre, radius = axis.largest_disk()
    (x, y), size = sheet.place(centre).tolist(), radius * sheet.scale
    edges = len(axis.edges)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {sheet.width} {sheet.height}" '
        f'width="{sheet.width // _GRID}" height="{sheet.height // _GRID}" fill="none" '
        'stroke-linecap="round" stroke-linejoin="round">',
        f"<title>Medial axis: {len(axis.vertex_radius)} vertices, {edges} edges, "
        f"largest radius {radius:.6g} mm</title>",
        f'<path d="M0 0H{sheet.width}V{sheet.height}H0z" fill="#fff"/>',
        f'<path d="{_outline(axis, sheet)}" fill="#f3f0e8" fill-rule="evenodd" '
        f'stroke="#333" stroke-width="{1.4 * _GRID:g}"/>',
        f'<circle cx="{x}" cy="{y}" r="{round(size)}" stroke="#c9c3b4" stroke-width="{_GRID}"/>',
    ]
    for colour, data in sorted(_edges(axis, sheet, radius).items()):
        parts.append(
            f'<path d="{data}" stroke="{_RADIUS_COLOURS[colour]}" stroke-width="{2 * _GRID}"/>'
        )
    places = sheet.place(axis.vertex_point)
    kinds = np.array(axis.vertex_kind)
    for kind, paint, diameter in _KINDS:
        chosen = np.unique(places[kinds == kind], axis=0).tolist()
        if chosen:
            dots = "".join(f"M{column} {row}h0" for column, row in chosen)
            parts.append(
                f'<path d="{dots}" stroke="{paint}" stroke-width="{diameter * _GRID}">'
                f"<title>{kind}</title></path>"
            )
    return "".join([*parts, "</svg>"])


def _outline(axis: MedialAxis, sheet: _Sheet) -> str:
    loops = (flatten(loop, 0.5 / sheet.scale) for loop in axis.region.loops)
    return "".join(_chain(sheet.place(points[:-1])) + "z" for points in loops)


def _chain(points: IntArray) -> str:
    """A path through points, repeated ones left out; steps are relative."""
    steps = np.diff(points, axis=0)
    steps = steps[np.any(steps != 0, axis=1)]
    (x, y), rest = points[0].tolist(), " ".join(f"{dx} {dy}" for dx, dy in steps.tolist())
    return f"M{x} {y}l{rest}" if rest else f"M{x} {y}"


def _edges(axis: MedialAxis, sheet: _Sheet, largest: float) -> dict[int, str]:
    """Paths of the edges by colour."""
    data: dict[int, list[str]] = defaultdict(list)
    for disks in _samples(axis, sheet, largest):
        points = sheet.place(disks[:, :, :2])
        middle = 0.5 * (disks[:, 1:, 2] + disks[:, :-1, 2])
        share = middle / largest * len(_RADIUS_COLOURS)
        colours = np.clip(share, 0, len(_RADIUS_COLOURS) - 1).astype(np.int64)
        # What is a single point on the grid is covered by its neighbours.
        seen = np.any(points != points[:, :1], axis=(1, 2))
        for chain, colour in zip(points[seen], colours[seen], strict=True):
            cuts = np.flatnonzero(np.diff(colour)) + 1
            for first, last in zip([0, *cuts], [*cuts, len(colour)], strict=True):
                data[int(colour[first])].append(_chain(chain[first : last + 1]))
    return {colour: "".join(paths) for colour, paths in data.items()}


def _samples(axis: MedialAxis, sheet: _Sheet, largest: float) -> Iterator[FloatArray]:
    """Disks (k, n, 3) along edges of one degree, close enough for smooth lines and colours."""
    groups: dict[int, list[FloatArray]] = defaultdict(list)
    for edge in axis.edges:
        table = np.concatenate([edge.control_points, edge.radius[:, None]], axis=1)
        groups[len(table) - 1].append(table)
    for degree, members in sorted(groups.items()):
        table = np.stack(members)
        span = np.abs(np.diff(table[:, :, 2], axis=1)).sum(axis=1)
        pieces = np.ceil(2 * len(_RADIUS_COLOURS) * span / largest)
        if degree > 1:
            # A chord over a share h of the parameter is off by |x''| h^2 / 8 at most.
            bend = degree * (degree - 1) * np.abs(np.diff(table[:, :, :2], 2, axis=1)).max((1, 2))
            pieces = np.maximum(pieces, np.ceil(np.sqrt(bend * sheet.scale / 4)))
        # Powers of two: few sizes, so that many edges are evaluated at once.
        level = np.ceil(np.log2(np.clip(pieces, 1, 256))).astype(np.int64)
        for value in np.unique(level):
            basis = bernstein(degree, np.linspace(0.0, 1.0, 2 ** int(value) + 1))
            yield np.asarray(basis @ table[level == value])
