"""Drawings of regions and their axes as small SVG files, the same bytes every time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grassfire.geometry import Arc, Region, flatten
from grassfire.geometry.chebyshev import evaluate_bezier
from grassfire.medial import MedialAxis

FloatArray = NDArray[np.float64]

WIDTH, HIGHEST, LEGEND, MARGIN = 640.0, 420.0, 30.0, 16.0
"""Width and greatest height of a panel, height of the legend, margin around the region, pixels."""

STYLE = (
    "text{font:12px sans-serif;fill:#333}"
    ".region{fill:#f4f1ea;stroke:#222;stroke-width:1.4}"
    ".contact{fill:none;stroke:#e08214;stroke-width:4}"
    ".axis{fill:none;stroke:#1f5fbf;stroke-width:1.6}"
    ".disk{fill:none;stroke:#9a9a9a;stroke-width:.8}"
    ".end{fill:#2a9d3a;stroke:#fff;stroke-width:.8}"
    ".corner{fill:#8e44ad;stroke:#fff;stroke-width:.8}"
    ".branch{fill:#d62728;stroke:#fff;stroke-width:.8}"
    ".recovered{fill:none;stroke:#d62728;stroke-width:1.1}"
    ".grid{stroke:#ddd;stroke-width:.8}"
)

LABELS = {
    "axis": "medial axis",
    "recovered": "boundary by eq. (1)",
    "contact": "arc of contact",
    "end": "end-point",
    "corner": "corner",
    "branch": "bifurcation",
    "disk": "maximal disk of a vertex",
}


@dataclass
class Panel:
    """A picture that is filled step by step; coordinates in mm are turned into pixels.

    Parameters
    ----------
    bounds : (xmin, ymin, xmax, ymax), mm
    """

    bounds: tuple[float, float, float, float]
    body: list[str] = field(default_factory=list)
    legend: list[str] = field(default_factory=list)
    caption: str = ""
    roomy: bool = True

    @property
    def scale(self) -> float:
        """Pixels in a millimetre."""
        xmin, ymin, xmax, ymax = self.bounds
        return min((WIDTH - 2 * MARGIN) / (xmax - xmin), (HIGHEST - 2 * MARGIN) / (ymax - ymin))

    @property
    def height(self) -> float:
        """Height of the panel, pixels."""
        return round((self.bounds[3] - self.bounds[1]) * self.scale + 2 * MARGIN)

    def pixels(self, points: ArrayLike) -> FloatArray:
        """(n, 2) pixels of points, y downwards, the bounds centred in the panel."""
        middle = 0.5 * (np.array(self.bounds[:2]) + self.bounds[2:])
        away = (np.asarray(points, dtype=np.float64).reshape(-1, 2) - middle) * self.scale
        return np.asarray(away * (1.0, -1.0) + (WIDTH / 2, self.height / 2))

    def path(self, name: str, lines: Sequence[FloatArray], closed: bool = False) -> None:
        """One path of a style made of polylines (n, 2)."""
        parts = ["M" + _pairs(self.pixels(line)) + ("Z" if closed else "") for line in lines]
        if parts:
            self.body.append(f'<path class="{name}" fill-rule="evenodd" d="{"".join(parts)}"/>')
            self.note(name)

    def circles(self, name: str, centres: FloatArray, radii: FloatArray) -> None:
        """Circles of a style, mm."""
        for (x, y), radius in zip(self.pixels(centres), radii * self.scale, strict=True):
            self.body.append(f'<circle class="{name}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"/>')
        if len(centres):
            self.note(name)

    def marks(self, name: str, points: FloatArray) -> None:
        """The symbol of a kind of vertex at points."""
        size = 1.0 if self.roomy else 0.75
        self.body.extend(symbol(name, x, y, size) for x, y in self.pixels(points))
        if len(points):
            self.note(name)

    def note(self, name: str) -> None:
        """Put a style into the legend, once."""
        if name in LABELS and name not in self.legend:
            self.legend.append(name)


def symbol(name: str, x: float, y: float, size: float = 1.0) -> str:
    """Circle, square or triangle, in pixels."""
    if name == "end":
        return f'<circle class="end" cx="{x:.1f}" cy="{y:.1f}" r="{4.5 * size:.1f}"/>'
    if name == "corner":
        half, side = 4.0 * size, 8.0 * size
        place = f'x="{x - half:.1f}" y="{y - half:.1f}" width="{side:.1f}" height="{side:.1f}"'
        return f'<rect class="corner" {place}/>'
    corners = size * np.array([(0.0, -5.5), (5.0, 3.8), (-5.0, 3.8)]) + (x, y)
    return f'<path class="{name}" d="M{_pairs(corners)}Z"/>'


def _pairs(points: FloatArray) -> str:
    """Coordinates of a path with one decimal, a tenth of a pixel."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


# -- pictures -------------------------------------------------------------------------------------


def region_panel(region: Region, axis: MedialAxis, caption: str = "") -> Panel:
    """The region, its axis, the vertices by kind and their disks."""
    panel = outlined(region, caption)
    kind, point, radius = np.array(axis.vertex_kind), axis.vertex_point, axis.vertex_radius
    crowded = np.count_nonzero(kind == "branch") > 0
    shown = kind == ("branch" if crowded else "end")
    panel.circles("disk", point[shown], radius[shown])
    panel.path("contact", contact_arcs(region, axis, 0.05 / panel.scale))
    panel.path("axis", axis_lines(axis, panel.scale))
    panel.roomy = bool(np.count_nonzero(kind != "joint") <= 20)
    for name in ("branch", "corner", "end"):
        panel.marks(name, point[kind == name])
    return panel


def outlined(region: Region, caption: str) -> Panel:
    """A panel with nothing but the region."""
    panel = Panel(region.bounds(), caption=caption)
    accuracy = 0.05 / panel.scale
    panel.path("region", [flatten(loop, accuracy)[:-1] for loop in region.loops], closed=True)
    return panel


def contact_arcs(region: Region, axis: MedialAxis, accuracy: float) -> list[FloatArray]:
    """Boundary arcs that a disk of the axis touches along their whole length, flattened."""
    arcs = [curve for curve in region.curves if isinstance(curve, Arc)]
    ends = axis.vertex_point[np.array(axis.vertex_kind) == "end"]
    size = float(np.ptp(np.reshape(region.bounds(), (2, 2)), axis=0).max())
    return [
        flatten(arc, accuracy)
        for arc in arcs
        if np.min(np.linalg.norm(ends - arc.centre, axis=1), initial=np.inf) < 1e-9 * size
    ]


def axis_lines(axis: MedialAxis, scale: float) -> list[FloatArray]:
    """Polylines of the edges, a few pixels to a chord."""
    lines = []
    for edge in axis.edges:
        length = float(np.linalg.norm(np.diff(edge.control_points, axis=0), axis=1).sum())
        straight = len(edge.control_points) == 2
        count = 2 if straight else 2 + int(length * scale / 3)
        lines.append(evaluate_bezier(edge.control_points, np.linspace(0, 1, count)))
    return _joined(lines)


def _joined(lines: list[FloatArray]) -> list[FloatArray]:
    """Polylines that follow each other become one."""
    result: list[FloatArray] = []
    for line in lines:
        if result and np.array_equal(result[-1][-1], line[0]):
            result[-1] = np.concatenate([result[-1], line[1:]])
        else:
            result.append(line)
    return result


def error_panel(title: str, curves: dict[str, tuple[FloatArray, FloatArray]]) -> Panel:
    """Errors over degrees, logarithmic; `curves` maps a label to degrees and errors."""
    panel = Panel((0.0, 0.0, 1.0, 1.0), caption=title)
    left, right, top, bottom = 70.0, WIDTH - 20, 20.0, HIGHEST - 40
    highest = max(float(degree.max()) for degree, _ in curves.values())
    powers = np.concatenate([np.log10(error) for _, error in curves.values()])
    low, high = float(np.floor(powers.min())), float(np.ceil(powers.max()))

    def place(degree: FloatArray, error: FloatArray) -> FloatArray:
        x = left + (right - left) * degree / highest
        y = top + (bottom - top) * (high - np.log10(error)) / (high - low)
        return np.column_stack([x, y])

    for power in range(int(low), int(high) + 1):
        y = place(np.zeros(1), np.array([10.0**power]))[0, 1]
        panel.body.append(f'<path class="grid" d="M{left},{y:.1f}H{right}"/>')
        panel.body.append(
            f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">1e{power}</text>'
        )
    for degree in range(0, int(highest) + 1, 4):
        x = place(np.array([float(degree)]), np.ones(1))[0, 0]
        panel.body.append(
            f'<text x="{x:.1f}" y="{bottom + 18}" text-anchor="middle">{degree}</text>'
        )
    for (label, (degrees, errors)), name in zip(curves.items(), ("recovered", "axis"), strict=True):
        points = place(degrees, errors)
        panel.body.append(f'<path class="{name}" d="M{_pairs(points)}"/>')
        x, y = points[-3] + (8.0, -8.0)
        panel.body.append(f'<text x="{x:.1f}" y="{y:.1f}">{label}</text>')
    middle = 0.5 * (left + right)
    panel.body.append(f'<text x="{middle}" y="{bottom + 34}" text-anchor="middle">degree</text>')
    return panel


def document(panels: Sequence[Panel]) -> str:
    """Panels above each other, with a legend of what they show."""
    names: list[str] = []
    for panel in panels:
        names += [name for name in panel.legend if name not in names]
    heights = [panel.height + (20.0 if panel.caption else 0.0) for panel in panels]
    total = sum(heights) + LEGEND
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {total:g}" '
        f'width="{WIDTH:g}" height="{total:g}">',
        f"<style>{STYLE}</style>",
        f'<rect width="{WIDTH:g}" height="{total:g}" fill="#fff"/>',
    ]
    top = 0.0
    for panel, height in zip(panels, heights, strict=True):
        parts.append(f'<g transform="translate(0 {top:g})">')
        parts += panel.body
        if panel.caption:
            text = f'<text x="{WIDTH / 2:g}" y="{panel.height + 14:g}" text-anchor="middle">'
            parts.append(f"{text}{panel.caption}</text>")
        parts.append("</g>")
        top += height
    parts.append(_legend(names, total - LEGEND / 2))
    return "\n".join([*parts, "</svg>", ""])


def _legend(names: list[str], y: float) -> str:
    """Symbols and labels in one row, centred."""
    widths = [34.0 + 6.4 * len(LABELS[name]) for name in names]
    x = (WIDTH - sum(widths)) / 2
    parts = []
    for name, width in zip(names, widths, strict=True):
        if name in ("end", "corner", "branch"):
            parts.append(symbol(name, x + 10, y))
        elif name == "disk":
            parts.append(f'<circle class="disk" cx="{x + 10:.1f}" cy="{y:.1f}" r="6"/>')
        else:
            parts.append(f'<path class="{name}" d="M{x:.1f},{y:.1f}h20"/>')
        parts.append(f'<text x="{x + 25:.1f}" y="{y + 4:.1f}">{LABELS[name]}</text>')
        x += width
    return "\n".join(parts)
