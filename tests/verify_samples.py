"""Good programs made by hand for the verifier's tests, and a slow judge independent of it.

The slow judge machines vector slices: one polygon of remaining stock per height, from which the
swept polygon of every move is subtracted in turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely.geometry import LineString, MultiPolygon, Point, Polygon, box

from grassfire.toolpath import MoveKind, Program
from grassfire.verify import Target

CLEARANCE = 10.0
MACHINE = {"rapid": 5000.0, "acceleration": 500.0, "junction_deviation": 0.01}


@dataclass(frozen=True)
class Sample:
    """A good program as text, and what it is meant to make."""

    name: str
    text: str
    targets: tuple[Target, ...]


class Writer:
    """Writes blocks that name every axis, so that a block can be changed without its neighbours."""

    def __init__(self) -> None:
        self.lines = ["G21 G90 G17 G94 G54"]
        self.at = (0.0, 0.0, CLEARANCE)

    def tool(self, operation: int, number: int, diameter: float) -> None:
        self.lines.append(f"(operation {operation + 1}: sample, tool {number} D{diameter:g})")
        self.lines += [f"T{number} M6", "S12000 M3"]
        self.lines.append(f"G0 Z{CLEARANCE:.4f}")
        self.at = (self.at[0], self.at[1], CLEARANCE)

    def _words(self, x: float, y: float, z: float) -> str:
        self.at = (x, y, z)
        return f"X{x:.4f} Y{y:.4f} Z{z:.4f}"

    def rapid(self, x: float, y: float, z: float) -> None:
        self.lines.append("G0 " + self._words(x, y, z))

    def line(self, x: float, y: float, z: float, feed: float = 900.0) -> None:
        self.lines.append("G1 " + self._words(x, y, z) + f" F{feed:g}")

    def arc(
        self, x: float, y: float, z: float, centre: tuple[float, float], counter: bool = True
    ) -> None:
        i, j = centre[0] - self.at[0], centre[1] - self.at[1]
        code = "G3" if counter else "G2"
        self.lines.append(f"{code} {self._words(x, y, z)} I{i:.4f} J{j:.4f} F900")

    def retract(self) -> None:
        self.rapid(self.at[0], self.at[1], CLEARANCE)

    def text(self) -> str:
        return "\n".join([*self.lines, "M5", "M30", ""])


def _rings(region: Polygon, first: float, step: float) -> list[np.ndarray]:
    """Closed polylines at distances `first` + k `step` from the walls, innermost first."""
    layers = []
    distance = first
    while not (inner := region.buffer(-distance, quad_segs=24)).is_empty:
        layers.append([np.array(r.coords) for r in shapely.get_rings(shapely.get_parts(inner))])
        distance += step
    return [ring for layer in reversed(layers) for ring in layer]


def _laps(writer: Writer, rings: list[np.ndarray], levels: list[float]) -> None:
    """Each ring at each level: down a ramp of one lap, then a level lap."""
    for above, level in zip([0.0, *levels[:-1]], levels, strict=True):
        for ring in rings:
            x, y = ring[0]
            writer.rapid(x, y, CLEARANCE)
            writer.rapid(x, y, 1.0)
            writer.line(x, y, above + 0.01, 300.0)
            way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))])
            for (x, y), part in zip(ring[1:], way[1:] / way[-1], strict=True):
                writer.line(x, y, above + part * (level - above), 400.0)
            for x, y in ring[1:]:
                writer.line(x, y, level)
            writer.retract()


def island_pocket() -> Sample:
    """A rectangle with a square island, cleared by rings, tool 6 mm, two levels."""
    region = box(0, 0, 44, 30).difference(box(18, 11, 26, 19))
    writer = Writer()
    writer.tool(0, 1, 6.0)
    _laps(writer, _rings(region, 3.001, 2.0), [-2.0, -4.0])
    target = Target(
        operation=0, region=region, depth=4.0, tool_radius=3.0, stepdown=2.0, tool_number=1
    )
    return Sample("island", writer.text(), (target,))


def circle_pocket() -> Sample:
    """A disk cleared by a helix, concentric arcs and radial links, tool 6 mm, three levels."""
    region = Point(5, -3).buffer(14, quad_segs=400)
    cx, cy = 5.0, -3.0
    writer = Writer()
    writer.tool(0, 1, 6.0)
    writer.rapid(cx + 2, cy, CLEARANCE)
    writer.rapid(cx + 2, cy, 1.0)
    height = 0.0
    for level in (-1.5, -3.0, -4.5):
        writer.line(cx + 2, cy, height, 300.0)
        for turn in range(1, 6):
            writer.arc(cx + 2, cy, height + (level - height) * turn / 5, (cx, cy))
        height = level
        writer.arc(cx + 2, cy, level, (cx, cy))
        for radius in (4.0, 6.0, 8.0, 10.0, 10.9985):
            writer.line(cx + radius, cy, level)
            writer.arc(cx - radius, cy, level, (cx, cy))
            writer.arc(cx + radius, cy, level, (cx, cy))
        writer.line(cx + 2, cy, level)
    writer.retract()
    target = Target(
        operation=0, region=region, depth=4.5, tool_radius=3.0, stepdown=1.5, tool_number=1
    )
    return Sample("circle", writer.text(), (target,))


def two_tools() -> Sample:
    """A rectangle cleared by a 6 mm tool; its walls and corners finished by a 3 mm tool."""
    region = box(-15, -10, 15, 10)
    writer = Writer()
    writer.tool(0, 1, 6.0)
    _laps(writer, _rings(region, 3.2, 2.5), [-1.5, -3.0])
    writer.tool(1, 2, 3.0)
    _laps(writer, _rings(region, 1.5, 1.0)[-2:], [-1.5, -3.0])
    targets = (
        Target(
            operation=0,
            region=region,
            depth=3.0,
            tool_radius=3.0,
            radial_allowance=0.2,
            stepdown=1.5,
            tool_number=1,
        ),
        Target(operation=1, region=region, depth=3.0, tool_radius=1.5, stepdown=1.5, tool_number=2),
    )
    return Sample("two tools", writer.text(), targets)


def zigzag_pocket() -> Sample:
    """A rectangle cleared by parallel lines and a lap along the wall; 4 mm tool, may plunge."""
    region = box(0, 0, 30, 20)
    writer = Writer()
    writer.tool(0, 3, 4.0)
    for level in (-1.0, -2.0):
        writer.rapid(2.5, 2.5, CLEARANCE)
        writer.rapid(2.5, 2.5, 1.0)
        writer.line(2.5, 2.5, level, 200.0)
        for row in range(6):
            y = 2.5 + 3.0 * row
            writer.line(*((27.5, y) if row % 2 == 0 else (2.5, y)), level)
            if row < 5:
                writer.line(writer.at[0], y + 3.0, level)
        for x, y in ((2.0, 18.0), (2.0, 2.0), (28.0, 2.0), (28.0, 18.0), (2.0, 18.0)):
            writer.line(x, y, level)
        writer.retract()
    target = Target(
        operation=0,
        region=region,
        depth=2.0,
        tool_radius=2.0,
        entry="plunge",
        stepdown=1.0,
        tool_number=3,
    )
    return Sample("zigzag", writer.text(), (target,))


def samples() -> tuple[Sample, ...]:
    return (island_pocket(), circle_pocket(), two_tools(), zigzag_pocket())


@dataclass(frozen=True)
class Harm:
    """What the slow judge measured; mm and mm2."""

    gouge: float
    floor: float
    uncut_patch: float
    rapid: float
    plunge: float
    overload: float

    @property
    def harmful(self) -> bool:
        return (
            self.gouge > 0.02
            or self.floor > 0.02
            or self.uncut_patch > 0.5
            or self.rapid > 0.5
            or self.plunge > 1.0
            or self.overload > 3.0
        )


def chords_of(program: Program, index: int) -> list[tuple[int, int, np.ndarray]]:
    """Rows (kind, row, (k, 3) points) of one section's moves."""
    path = program.sections[index].toolpath
    rows = []
    begin, sweep = path.begin, path.sweep
    for row, kind in enumerate(path.kind):
        start, end = begin[row], path.end[row]
        if not np.isfinite([*start, *end]).all():
            continue
        if kind < MoveKind.ARC_CW:
            rows.append((int(kind), row, np.array([start, end])))
            continue
        first, last = start[:2] - path.centre[row], end[:2] - path.centre[row]
        # chords within 2e-4 mm of the arc
        step = min(0.05, math.sqrt(1.6e-3 / max(np.hypot(*first), 1e-3)))
        part = np.linspace(0, 1, max(2, math.ceil(abs(sweep[row]) / step)) + 1)
        angle = math.atan2(first[1], first[0]) + sweep[row] * part
        radius = np.hypot(*first) + (np.hypot(*last) - np.hypot(*first)) * part
        x = path.centre[row, 0] + radius * np.cos(angle)
        y = path.centre[row, 1] + radius * np.sin(angle)
        rows.append(
            (int(kind), row, np.column_stack([x, y, start[2] + part * (end[2] - start[2])]))
        )
    return rows


def part_below(points: np.ndarray, height: float) -> np.ndarray:
    """Vertices of the part of a polyline of constant slope that lies at or below a height."""
    z0, z1 = points[0, 2], points[-1, 2]
    if max(z0, z1) <= height + 1e-9:
        return points[:, :2]
    if min(z0, z1) > height + 1e-9:
        return points[:0, :2]
    part = np.linspace(0, 1, len(points))
    cut = (height - z0) / (z1 - z0)
    keep = part >= cut if z1 < z0 else part <= cut
    at = np.array([[np.interp(cut, part, points[:, axis]) for axis in (0, 1)]])
    inside = points[keep, :2]
    return np.concatenate([at, inside] if z1 < z0 else [inside, at])


def shape_of(points: np.ndarray) -> Point | LineString:
    """A polyline, or the point that it stays at."""
    return Point(points[0]) if np.ptp(points, axis=0).max() < 1e-9 else LineString(points)


class SlowJudge:
    """Vector slices of the stock, machined move by move."""

    def __init__(self, targets: tuple[Target, ...], slices: int = 6) -> None:
        self.targets = targets
        self.region = shapely.union_all([item.region for item in targets])
        self.floor = min(item.floor for item in targets)
        depth = max(item.depth for item in targets)
        heights = -depth + 0.03 + (depth - 0.04) * np.arange(slices) / (slices - 1)
        self.heights = [float(value) for value in heights]
        self.stock = [self.region.simplify(5e-4) for _ in self.heights]
        # Samples so close that distances over a millimetre are right to 0.0001 mm.
        self.wall = cKDTree(shapely.get_coordinates(shapely.segmentize(self.region.boundary, 0.03)))
        shapely.prepare(self.region)

    def judge(self, program: Program) -> Harm:
        gouge = floor = rapid = plunge = overload = 0.0
        for index, section in enumerate(program.sections):
            target = next(t for t in self.targets if t.operation == section.operation)
            radius = target.tool_radius
            for kind, _, points in chords_of(program, index):
                low = points[:, 2].min()
                if low >= -1e-6:
                    continue
                floor = max(floor, self.floor - low)
                gouge = max(gouge, radius - self._least_distance(part_below(points, -1e-6)))
                taken = self._take(points, radius - (0.01 if kind == MoveKind.RAPID else 0.0))
                fall = points[0, 2] - points[-1, 2]
                travel = np.hypot(*np.diff(points[:, :2], axis=0).T).sum()
                if kind == MoveKind.RAPID:
                    rapid = max(rapid, *taken)
                elif fall > travel and target.entry != "plunge":
                    plunge = max(plunge, *taken)
                elif fall < 1e-6 and target.stepdown is not None:
                    limit = low + target.stepdown + 0.1
                    thick = [a for h, a in zip(self.heights, taken, strict=True) if h > limit]
                    overload = max([overload, *thick])
        return Harm(gouge, floor, self._left(), rapid, plunge, overload)

    def _least_distance(self, points: np.ndarray) -> float:
        line = shape_of(points)
        dense = shapely.get_coordinates(shapely.segmentize(line, 0.1))
        distance = self.wall.query(dense)[0]
        inside = shapely.covers(self.region, shapely.points(dense))
        return float(np.where(inside, distance, -distance).min())

    def _take(self, points: np.ndarray, radius: float) -> list[float]:
        """Subtract one move from every slice that it reaches; the areas taken."""
        taken = []
        for index, height in enumerate(self.heights):
            part = part_below(points, height)
            if not len(part) or self.stock[index].is_empty:
                taken.append(0.0)
                continue
            centre = shape_of(part)
            before = self.stock[index].area
            self.stock[index] = self.stock[index].difference(centre.buffer(radius, quad_segs=32))
            taken.append(before - self.stock[index].area)
        return taken

    def _left(self) -> float:
        """Largest patch on the floor that the target's tool could have cleared, mm2."""
        largest = 0.0
        for target in self.targets:
            inset = target.tool_radius + target.radial_allowance
            centres = target.region.buffer(-inset - 0.01, quad_segs=32)
            reach = centres.buffer(target.tool_radius, quad_segs=32)
            left = self.stock[0].intersection(reach)
            parts = left.geoms if isinstance(left, MultiPolygon) else [left]
            largest = max([largest, *(part.area for part in parts)])
        return largest
