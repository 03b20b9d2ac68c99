"""Seeded faults and good programs: what the verifier catches, misses, and blames for nothing.

    python benchmarks/faults.py seeded --count 500
    python benchmarks/faults.py good --count 300
    python benchmarks/faults.py one seeded 137

Programs are planned for random pockets, tools and settings, written by a post and read back.
Mutation number i is of kind i modulo the number of kinds, in a program of its own draw. What the
verifier lets pass goes to a judge that shares nothing with it: distances to the walls, and slices
of stock as polygons, from which swept polygons are taken: that tells harmful faults, harmless ones,
and mutations that leave the part as it was, which are no faults. The exit code is 1 if a harmful
fault passes, if fewer than `--least` of the faults are caught, or if a good program is refused.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from region_kinds import KINDS, moved, region

from grassfire.errors import GeometryError, InputError, PlanningError
from grassfire.gcode import read_program
from grassfire.job import STRATEGIES, Job
from grassfire.toolpath import MoveKind, Program
from grassfire.verify import Fault, Target, verify
from verify_samples import chords_of, part_below, shape_of

MACHINE = {"rapid": 5000.0, "acceleration": 500.0, "junction_deviation": 0.01}
UNFIT = {"scaled", "far-away", "needle", "circle", "near-duplicate"}
"""Kinds of region that no usual tool enters, or that are too large for a benchmark."""

POCKETS = tuple(kind for kind in KINDS if kind not in UNFIT)
WHOLE = tuple(name for name in STRATEGIES if name in ("offset", "spiral", "adaptive"))
"""Strategies that clear a whole pocket with one tool."""


@dataclass(frozen=True)
class Good:
    """A planned program as its post wrote it, and what it has to make."""

    name: str
    text: str
    targets: tuple[Target, ...]


def settings(draw: random.Random, kind: str) -> dict[str, Any]:
    """A random job for a pocket."""
    diameter = draw.choice([2.0, 3.0, 4.0, 5.0, 6.0])
    depth = draw.choice([1.0, 2.0, 3.5])
    operation: dict[str, Any] = {
        "strategy": draw.choice(WHOLE),
        "tool": 1,
        "depth": depth,
        "stepdown": depth / draw.choice([1, 2, 3]),
        "direction": draw.choice(["climb", "conventional"]),
        "entry": draw.choice(["helix", "helix", "ramp", "plunge"]),
        "ramp_angle": draw.choice([2.0, 3.0, 8.0]),
        "radial_allowance": draw.choice([0.0, 0.0, 0.2]),
        "axial_allowance": draw.choice([0.0, 0.0, 0.15]),
    }
    if operation["strategy"] == "adaptive":
        operation["engagement_angle"] = draw.choice([60.0, 75.0, 90.0])
        operation["direction"] = draw.choice([operation["direction"], "both"])
        operation["entry"] = "helix"
    else:
        operation["stepover"] = draw.choice([0.25, 0.4, 0.5])
    tool = {
        "number": 1,
        "diameter": diameter,
        "flutes": 2,
        "spindle_speed": 12000,
        "feed": 900,
        "plunge_feed": 300,
    }
    return {
        "name": kind,
        "post": draw.choice(["linuxcnc", "grbl"]),
        "input": {"file": f"{kind}.dxf"},
        "tools": [tool],
        "operations": [operation],
    }


def draw_good(number: int) -> Good:
    """The good program of a number: a pocket that the drawn tool can enter."""
    draw = random.Random(f"good {number}")
    for _ in range(60):
        kind = POCKETS[(number + draw.randrange(2) * draw.randrange(len(POCKETS))) % len(POCKETS)]
        seed = draw.randrange(10_000)
        job = Job.model_validate(settings(draw, kind))
        try:
            return planned(job, kind, seed)
        except (PlanningError, GeometryError):
            continue
    raise ValueError(f"no job for program {number}")


def planned(job: Job, kind: str, seed: int) -> Good:
    """The program of a job for one random pocket."""
    from grassfire.geometry import flatten
    from grassfire.medial import medial_axis
    from grassfire.plan import plan_operation
    from grassfire.post import load_post, render
    from grassfire.toolpath import Section

    shape = moved(region(kind, seed), scale=0.5)
    tool, operation = job.tools[0], job.operations[0]
    plan = plan_operation([medial_axis(shape)], operation, tool, job)
    section = Section(plan.toolpath, 1, tool.diameter, tool.spindle_speed, 0, operation.strategy)
    text = render(
        Program(job.name, (section,)),
        load_post(job.post),
        clearance_height=job.clearance_height,
        tolerance=job.tolerance,
        findings=[],
    )
    rings = [flatten(loop, 1e-4) for loop in shape.loops]
    target = Target(
        operation=0,
        region=shapely.Polygon(rings[0], rings[1:]),
        depth=operation.depth,
        tool_radius=tool.radius,
        radial_allowance=operation.radial_allowance,
        axial_allowance=operation.axial_allowance,
        entry=operation.entry,
        stepdown=operation.stepdown,
        tool_number=1,
        max_feed=1.001 * tool.feed,
    )
    words = f"{operation.strategy} {operation.entry} D{tool.diameter:g} {job.post}"
    return Good(f"{kind} {seed} {words}", text, (target,))


def plain_text(program: Program) -> str:
    """The program with every word on every block, so that one block can be changed alone."""
    lines = ["G21 G90 G17 G94 G54"]
    for section in program.sections:
        number, diameter = section.tool_number, section.tool_diameter
        lines.append(f"(operation {section.operation + 1}: plain, tool {number} D{diameter:g})")
        lines += [f"T{number} M6", f"S{section.spindle_speed:.0f} M3"]
        path = section.toolpath
        for kind, begin, end, centre, feed in zip(
            path.kind, path.begin, path.end, path.centre, path.feed, strict=True
        ):
            words = [f"{a}{v:.4f}" for a, v in zip("XYZ", end, strict=True) if np.isfinite(v)]
            if kind >= MoveKind.ARC_CW:
                words += [f"I{centre[0] - begin[0]:.4f}", f"J{centre[1] - begin[1]:.4f}"]
            if kind != MoveKind.RAPID:
                words.append(f"F{feed:.0f}")
            lines.append(" ".join([f"G{int(kind)}", *words]))
    return "\n".join([*lines, "M5", "M30", ""])


Lines = list[str]
Mutation = Callable[[Lines, random.Random], Lines]


class NotHereError(Exception):
    """The program has no place for this mutation."""


def words(line: str) -> dict[str, float]:
    """The words of a block."""
    return {letter: float(value) for letter, value in re.findall(r"([A-Z])(-?[\d.]+)", line)}


def changed(line: str, **values: float) -> str:
    """A block with other values of words that it has."""
    for letter, value in values.items():
        line = re.sub(rf"{letter}-?[\d.]+", f"{letter}{value:.4f}", line)
    return line


def is_cut(line: str) -> bool:
    """Whether a block is a feed move that ends below the stock's top."""
    return line.startswith(("G1 ", "G2 ", "G3 ")) and words(line).get("Z", 1.0) < -1e-3


def travel(lines: Lines, row: int) -> float:
    """Distance in XY from the block before to this one, mm."""
    old, new = words(lines[row - 1]), words(lines[row])
    if not {"X", "Y"} <= old.keys() & new.keys():
        return 0.0
    return float(np.hypot(new["X"] - old["X"], new["Y"] - old["Y"]))


def choose(rows: Sequence[int], draw: random.Random) -> int:
    """One of the rows."""
    if not rows:
        raise NotHereError
    return draw.choice(rows)


def cuts(lines: Lines, least: float = 1.0) -> list[int]:
    """Rows of level feed moves in stock, at least so long."""
    return [
        row
        for row in range(1, len(lines))
        if is_cut(lines[row])
        and words(lines[row - 1]).get("Z") == words(lines[row])["Z"]
        and travel(lines, row) >= least
    ]


def deepest(lines: Lines) -> float:
    """The lowest level, z in mm."""
    return min(words(line)["Z"] for line in lines if is_cut(line))


def arcs(lines: Lines, least_radius: float, least_chord: float) -> list[int]:
    """Rows of arcs in stock with at least this radius and chord."""
    rows = [row for row in cuts(lines, least_chord) if "I" in words(lines[row])]
    return [
        row
        for row in rows
        if np.hypot(words(lines[row])["I"], words(lines[row])["J"]) >= least_radius
    ]


def sign(draw: random.Random) -> int:
    return draw.choice([-1, 1])


def shift_all(lines: Lines, draw: random.Random) -> Lines:
    """A wrong work offset."""
    letter, shift = draw.choice("XY"), sign(draw) * draw.uniform(0.05, 1.0)
    return [changed(s, **{letter: words(s)[letter] + shift}) if " X" in s else s for s in lines]


def scale_all(lines: Lines, draw: random.Random) -> Lines:
    """A wrong scale: every length by a few percent."""
    factor = 1 + sign(draw) * draw.uniform(0.02, 0.1)
    result = []
    for line in lines:
        found = {key: value for key, value in words(line).items() if key in "XYIJ"}
        moves = line.startswith(("G0 ", "G1 ", "G2 ", "G3 "))
        result.append(changed(line, **{k: factor * v for k, v in found.items()}) if moves else line)
    return result


def lower_all(lines: Lines, draw: random.Random) -> Lines:
    """A wrong tool length."""
    shift = draw.choice([-1.0, -0.3, -0.03, 0.05, 0.4])
    return [
        changed(s, Z=words(s)["Z"] + shift) if s[:3] in MOVES and "Z" in s else s for s in lines
    ]


MOVES = ("G0 ", "G1 ", "G2 ", "G3 ")


def wrong_digit(lines: Lines, draw: random.Random) -> Lines:
    """One digit of a coordinate."""
    row, letter = choose(cuts(lines), draw), draw.choice("XY")
    shift = sign(draw) * draw.choice([1.0, 2.0, 10.0])
    lines[row] = changed(lines[row], **{letter: words(lines[row])[letter] + shift})
    return lines


def lose_point(lines: Lines, draw: random.Random) -> Lines:
    """The decimal point of a coordinate."""
    row, letter = choose(cuts(lines), draw), draw.choice("XY")
    lines[row] = re.sub(rf"({letter}-?\d+)\.(\d+)", r"\1\2", lines[row])
    return lines


def flip_sign(lines: Lines, draw: random.Random) -> Lines:
    """The sign of a coordinate that is not near 0."""
    letter = draw.choice("XY")
    row = choose([i for i in cuts(lines) if abs(words(lines[i])[letter]) > 1.0], draw)
    lines[row] = changed(lines[row], **{letter: -words(lines[row])[letter]})
    return lines


def swap_axes(lines: Lines, draw: random.Random) -> Lines:
    """X and Y exchanged in a block."""
    rows = [i for i in cuts(lines) if abs(words(lines[i])["X"] - words(lines[i])["Y"]) > 1.0]
    row = choose(rows, draw)
    word = words(lines[row])
    lines[row] = changed(lines[row], X=word["Y"], Y=word["X"])
    return lines


def reverse_arc(lines: Lines, draw: random.Random) -> Lines:
    """G2 for G3: the other way round."""
    row = choose(arcs(lines, 1.0, 0.5), draw)
    lines[row] = ("G2" if lines[row].startswith("G3") else "G3") + lines[row][2:]
    return lines


def shift_centre(lines: Lines, draw: random.Random) -> Lines:
    """A wrong I or J."""
    row, letter = choose(arcs(lines, 1.0, 0.5), draw), draw.choice("IJ")
    shift = sign(draw) * draw.uniform(0.2, 2.0)
    lines[row] = changed(lines[row], **{letter: words(lines[row])[letter] + shift})
    return lines


def arcs_to_lines(lines: Lines, draw: random.Random) -> Lines:
    """G1 for G2 and G3 from some block on, with arcs of some sagitta to come."""
    low, rows = deepest(lines), []
    for row in arcs(lines, 1.0, 1.0):
        radius = np.hypot(words(lines[row])["I"], words(lines[row])["J"])
        if words(lines[row])["Z"] == low and travel(lines, row) ** 2 / (8 * radius) > 0.2:
            rows.append(row)
    first = choose(rows[: len(rows) // 2], draw)
    after = [re.sub(r" [IJ]-?[\d.]+", "", re.sub("^G[23] ", "G1 ", s)) for s in lines[first:]]
    return [*lines[:first], *after]


def lose_moves(lines: Lines, draw: random.Random) -> Lines:
    """Three to eight cutting blocks in a row at the lowest level."""
    low, count = deepest(lines), draw.randint(3, 8)
    rows = [
        row
        for row in cuts(lines, 0.0)
        if all(
            row + k < len(lines) and is_cut(lines[row + k]) and words(lines[row + k])["Z"] == low
            for k in range(count)
        )
        and sum(travel(lines, row + k) for k in range(count)) > 6.0
    ]
    row = choose(rows, draw)
    del lines[row : row + count]
    return lines


def cut_short(lines: Lines, draw: random.Random) -> Lines:
    """The end of the program is missing."""
    low = deepest(lines)
    rows = [row for row in cuts(lines) if words(lines[row])["Z"] == low]
    row = choose(rows[: max(1, len(rows) * 3 // 4)], draw)
    return [*lines[:row], "G0 Z15", "M5", "M30"]


def missing_level(lines: Lines, draw: random.Random) -> Lines:
    """All level moves at one height."""
    counts = Counter(words(lines[row])["Z"] for row in cuts(lines, 0.0))
    level = choose([z for z, count in sorted(counts.items()) if count >= 6], draw)
    return [s for s in lines if not is_cut(s) or words(s)["Z"] != level]


def deeper(lines: Lines, draw: random.Random) -> Lines:
    """One block at the lowest level goes deeper."""
    low = deepest(lines)
    row = choose([row for row in cuts(lines) if words(lines[row])["Z"] == low], draw)
    lines[row] = changed(lines[row], Z=low - draw.choice([0.2, 0.5, 2.0]))
    return lines


def shallower(lines: Lines, draw: random.Random) -> Lines:
    """The lowest level comes out too high."""
    low = deepest(lines)
    lift = draw.uniform(0.03, 0.6)
    return [changed(s, Z=low + lift) if is_cut(s) and words(s)["Z"] == low else s for s in lines]


def retracts(lines: Lines) -> list[int]:
    """Rows of rapids that leave the stock upwards, with another move to come."""
    return [
        row
        for row in range(1, len(lines) - 3)
        if lines[row].startswith("G0 ") and is_cut(lines[row - 1]) and travel(lines, row + 1) > 0.5
    ]


def drop_retract(lines: Lines, draw: random.Random) -> Lines:
    """No retract before the next rapid."""
    del lines[choose(retracts(lines), draw)]
    return lines


def low_retract(lines: Lines, draw: random.Random) -> Lines:
    """A retract, and the rapids after it, that stay below the stock's top."""
    row = choose(retracts(lines), draw)
    height = -draw.uniform(0.05, 0.9)
    while lines[row].startswith("G0 "):
        lines[row] = changed(lines[row], Z=height)
        row += 1
    return lines


def rapid_for_feed(lines: Lines, draw: random.Random) -> Lines:
    """G0 for G1 on a cut."""
    row = choose([row for row in cuts(lines) if lines[row].startswith("G1 ")], draw)
    lines[row] = re.sub(r" F\d+", "", "G0" + lines[row][2:])
    return lines


def rapid_down(lines: Lines, draw: random.Random) -> Lines:
    """The rapid above the first entry goes on into the stock."""
    rows = [
        i for i in range(1, len(lines) - 1) if lines[i].startswith("G0 ") and is_entry(lines, i)
    ]
    row = choose(rows[:1], draw)
    lines[row] = changed(lines[row], Z=-draw.uniform(0.06, 0.9))
    return lines


def is_entry(lines: Lines, row: int) -> bool:
    """Whether a rapid comes down and a feed move follows."""
    here, after = words(lines[row]), lines[row + 1]
    return "Z" in here and words(lines[row - 1]).get("Z", -1) > here["Z"] and after[:2] != "G0"


def plunge(lines: Lines, draw: random.Random) -> Lines:
    """The first descent is made at once."""
    for row in range(1, len(lines)):
        if is_cut(lines[row]) and "X" in lines[row - 1]:
            here = words(lines[row - 1])
            down = f"G1 X{here['X']:.4f} Y{here['Y']:.4f} Z{deepest(lines):.4f} F300"
            return [*lines[:row], down, *lines[row:]]
    raise NotHereError


def inches(lines: Lines, draw: random.Random) -> Lines:
    """G20 for G21."""
    return [s.replace("G21", "G20") for s in lines]


def incremental(lines: Lines, draw: random.Random) -> Lines:
    """G91 in the middle of the program."""
    lines.insert(choose(cuts(lines), draw), "G91")
    return lines


def repeat_shifted(lines: Lines, draw: random.Random) -> Lines:
    """A run of blocks comes again, beside itself."""
    row = choose(cuts(lines), draw)
    shift, letter = sign(draw) * draw.uniform(0.3, 3.0), draw.choice("XY")
    block = [s for s in lines[row : row + 12] if " X" in s]
    block = [changed(s, **{letter: words(s)[letter] + shift}) for s in block]
    return [*lines[: row + 12], *block, *lines[row + 12 :]]


def no_feed(lines: Lines, draw: random.Random) -> Lines:
    """No F anywhere, or a feed of 0 on one block."""
    if draw.random() < 0.5:
        return [re.sub(r" F\d+", "", s) for s in lines]
    row = choose(cuts(lines), draw)
    lines[row] = re.sub(r" F\d+", " F0", lines[row])
    return lines


def fast_feed(lines: Lines, draw: random.Random) -> Lines:
    """Ten times the feed on one block."""
    row = choose(cuts(lines), draw)
    lines[row] = re.sub(r" F(\d+)", r" F\g<1>0", lines[row])
    return lines


def no_spindle(lines: Lines, draw: random.Random) -> Lines:
    """The spindle never starts, or stops on the way."""
    if draw.random() < 0.5:
        return [s for s in lines if " M3" not in s]
    lines.insert(choose(cuts(lines), draw), "M5")
    return lines


def wrong_tool(lines: Lines, draw: random.Random) -> Lines:
    """Another tool: by its number, or by its diameter."""
    if draw.random() < 0.5:
        return [s.replace("T1 M6", "T7 M6") for s in lines]
    factor = draw.choice([0.5, 0.9, 1.1, 2.0])
    return [re.sub(r" D([\d.]+)\)", lambda m: f" D{factor * float(m[1]):g})", s) for s in lines]


MUTATIONS: tuple[Mutation, ...] = (
    shift_all,
    scale_all,
    lower_all,
    wrong_digit,
    lose_point,
    flip_sign,
    swap_axes,
    reverse_arc,
    shift_centre,
    arcs_to_lines,
    lose_moves,
    cut_short,
    missing_level,
    deeper,
    shallower,
    drop_retract,
    low_retract,
    rapid_for_feed,
    rapid_down,
    plunge,
    inches,
    incremental,
    repeat_shifted,
    no_feed,
    wrong_tool,
    fast_feed,
    no_spindle,
)
STATE = {no_feed, no_spindle, wrong_tool, fast_feed}
"""Harmful whatever the geometry."""


@lru_cache(maxsize=16)
def plain(number: int) -> tuple[Good, str]:
    """A good program and its plain text, which has to pass as well."""
    good = draw_good(number)
    text = plain_text(read_program(good.text))
    return good, text


def judged(text: str, targets: tuple[Target, ...]) -> tuple[Fault, ...] | str:
    """The faults of a program, or why the reader refuses it."""
    try:
        program = read_program(text)
    except InputError as error:
        return str(error)
    return verify(program, targets, **MACHINE).faults


@dataclass(frozen=True)
class Harm:
    """What the independent judge measured: mm, and mm2 of the largest uncut patch."""

    gouge: float
    floor: float
    uncut: float
    rapid: float
    plunge: float

    @property
    def harmful(self) -> bool:
        """Whether a figure is over what may never pass."""
        return (
            self.gouge > 0.02
            or self.floor > 0.02
            or self.uncut > 0.5
            or self.rapid > 0.05
            or self.plunge > 0.3
        )

    @property
    def felt(self) -> bool:
        """Whether a figure is over what chords and rounding make of a good program."""
        return (
            self.gouge > 0.003
            or self.floor > 0.003
            or self.uncut > 0.02
            or self.rapid > 0.003
            or self.plunge > 0.003
        )


class Judge:
    """Judges by polygons: the stock at a height is the region less all that moves swept there."""

    def __init__(self, program: Program, target: Target) -> None:
        self.target = target
        self.rows = [row for i in range(len(program.sections)) for row in chords_of(program, i)]
        whole = [shape_of(points[:, :2]) for _, _, points in self.rows]
        self.bounds = shapely.bounds(whole).reshape(-1, 4)
        shapely.prepare(target.region)

    def swept(self, rows: Sequence[int], height: float) -> shapely.Geometry:
        """What some moves of the program take at a height, as polygons."""
        parts = [part_below(self.rows[row][2], height) for row in rows]
        lines = [shape_of(points) for points in parts if len(points)]
        return shapely.union_all(shapely.buffer(lines, self.target.tool_radius, quad_segs=32))

    def uncut(self) -> float:
        """Area of the largest patch on the floor that the tool could have cleared, mm2."""
        target = self.target
        inset = target.tool_radius + target.radial_allowance + 0.01
        reach = target.region.buffer(-inset, quad_segs=32).buffer(target.tool_radius, quad_segs=32)
        floor = target.floor + target.axial_allowance
        left = reach.difference(self.swept(range(len(self.rows)), floor + 0.03))
        return max((part.area for part in shapely.get_parts(left)), default=0.0)

    def gouge(self) -> float:
        """How far the tool reaches beyond the wall, mm."""
        region = self.target.region
        parts = [part_below(points, -1e-6) for _, _, points in self.rows]
        lines = shapely.segmentize([shape_of(points) for points in parts if len(points)], 0.1)
        dense = shapely.get_coordinates(lines)
        boundary = region.boundary
        shapely.prepare(boundary)
        away = shapely.distance(boundary, shapely.points(dense))
        away = np.where(shapely.contains_xy(region, dense), away, -away)
        return self.target.tool_radius - float(away.min())

    def depth_taken(self, index: int) -> float:
        """How deep a move goes into standing stock, mm: the highest of 12 slices it takes from."""
        points, radius = self.rows[index][2], self.target.tool_radius
        low, top = float(points[:, 2].min()), self.target.stock_top
        sweep = shape_of(part_below(points, top)).buffer(radius - 0.01, quad_segs=32)
        stock = self.target.region.intersection(sweep)
        x0, y0, x1, y1 = sweep.buffer(radius).bounds
        box = self.bounds[:index]
        near = (box[:, 0] < x1) & (box[:, 2] > x0) & (box[:, 1] < y1) & (box[:, 3] > y0)
        rows = np.flatnonzero(near).tolist()
        for height in np.linspace(top - 1e-3, low + 0.01, 12).tolist():
            if stock.difference(self.swept(rows, height)).area > 0.05:
                return height - low
        return 0.0

    def harm(self) -> Harm:
        """Judge the whole program."""
        rapid = plunge = low = 0.0
        for index, (kind, _, points) in enumerate(self.rows):
            low = min(low, float(points[:, 2].min()))
            if points[:, 2].min() > self.target.stock_top - 0.02:
                continue
            fall = points[0, 2] - points[-1, 2]
            travel = np.hypot(*np.diff(points[:, :2], axis=0).T).sum()
            if kind == MoveKind.RAPID:
                rapid = max(rapid, self.depth_taken(index))
            elif fall > travel and self.target.entry != "plunge":
                plunge = max(plunge, self.depth_taken(index))
        return Harm(self.gouge(), self.target.floor - low, self.uncut(), rapid, plunge)


@dataclass(frozen=True)
class Seeded:
    """What became of one mutation."""

    number: int
    kind: str
    program: str
    verdict: str
    caught: bool
    harmful: bool
    felt: bool


def mutate(number: int) -> tuple[Mutation, Good, str, str]:
    """Mutation number i: (mutation, good program, its plain text, the text with the fault)."""
    mutation = MUTATIONS[number % len(MUTATIONS)]
    base = number // len(MUTATIONS)
    for attempt in range(40):
        good, text = plain(base + 1000 * attempt)
        draw = random.Random(f"{mutation.__name__} {number} {attempt}")
        if mutation is plunge and good.targets[0].entry == "plunge":
            continue
        try:
            lines = mutation(text.splitlines(), draw)
        except NotHereError:
            continue
        faulty = "\n".join(lines) + "\n"
        if faulty != text:
            return mutation, good, text, faulty
    raise ValueError(f"no program for {mutation.__name__}")


def seed_fault(number: int) -> Seeded:
    """Make and judge one mutation; what passes goes to the independent judge."""
    mutation, good, _, faulty = mutate(number)
    found = judged(faulty, good.targets)
    verdict = found if isinstance(found, str) else "; ".join(item.kind for item in found)
    harmful = felt = bool(found) or mutation in STATE
    if not found and not harmful:
        harm = Judge(read_program(faulty), good.targets[0]).harm()
        harmful, felt, verdict = harm.harmful, harm.felt, str(harm)
    return Seeded(number, mutation.__name__, good.name, verdict, bool(found), harmful, felt)


def seeded(first: int, count: int, least: float) -> int:
    """Make, judge and count so many faults: mutations after which the part is another one.

    Mutations that leave the part as it was, like a lost move through air, are no faults; they are
    counted apart and others made in their place.
    """
    begin, results, idle = time.process_time(), list[Seeded](), list[Seeded]()
    while len(results) < count:
        result = seed_fault(first + len(results) + len(idle))
        (results if result.felt else idle).append(result)
        if (len(results) + len(idle)) % 25 == 0:
            caught = sum(row.caught for row in results)
            seconds = time.process_time() - begin
            print(f"{len(results)} faults, {caught} caught, {seconds:.0f} s CPU", flush=True)
        if not result.caught:
            word = "HARMFUL" if result.harmful else "harmless" if result.felt else "no fault"
            print(f"passed {result.number}, {word}: {result.kind} in {result.program}: ", end="")
            print(result.verdict, flush=True)
    print(
        f"\n| {'mutation':15s} | no fault | faults | caught | passed, harmless | passed, harmful |"
    )
    print("|---|---:|---:|---:|---:|---:|")
    for kind in [*(mutation.__name__ for mutation in MUTATIONS), "all"]:
        rows = [row for row in results if kind in (row.kind, "all")]
        without = sum(kind in (row.kind, "all") for row in idle)
        caught = sum(row.caught for row in rows)
        harmful = sum(row.harmful for row in rows if not row.caught)
        print(
            f"| {kind:15s} | {without} | {len(rows)} | {caught} "
            f"| {len(rows) - caught - harmful} | {harmful} |"
        )
    caught = sum(row.caught for row in results)
    missed = sum(row.harmful for row in results if not row.caught)
    print(
        f"\n{caught} of {count} faults caught ({100 * caught / count:.2f} %), {missed} harmful "
        f"ones missed; {len(idle)} mutations left the part as it was; "
        f"{time.process_time() - begin:.0f} s CPU"
    )
    return 0 if caught >= least * count and not missed else 1


def good_programs(first: int, count: int) -> int:
    """Judge good programs, and tell for each alarm what the independent judge finds."""
    begin, alarms = time.process_time(), 0
    used: Counter[str] = Counter()
    for number in range(first, first + count):
        good = draw_good(number)
        used[good.name.split()[2]] += 1
        found = judged(good.text, good.targets)
        if number % 25 == 24:
            print(f"{number + 1} judged, {time.process_time() - begin:.0f} s CPU", flush=True)
        if found:
            alarms += 1
            verdict = found if isinstance(found, str) else "; ".join(str(item) for item in found)
            harm = Judge(read_program(good.text), good.targets[0]).harm()
            print(f"refused {number}: {good.name}: {verdict}; {harm}", flush=True)
    seconds = time.process_time() - begin
    print(f"{alarms} of {count} good programs refused; {dict(used)}; {seconds:.0f} s CPU")
    return 0 if not alarms else 1


def show(what: str, number: int) -> int:
    """One program or mutation in full."""
    if what == "good":
        good = draw_good(number)
        print(good.name, judged(good.text, good.targets), sep="\n")
        return 0
    import difflib

    _, good, text, faulty = mutate(number)
    print(good.name)
    print(*difflib.unified_diff(text.splitlines(), faulty.splitlines(), n=1), sep="\n")
    print(judged(faulty, good.targets))
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what passes, and the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=["seeded", "good", "one"])
    parser.add_argument("which", nargs="*", help="with one: seeded or good, and a number")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--least", type=float, default=0.99, help="share to be caught")
    options = parser.parse_args(arguments)
    if options.what == "one":
        return show(options.which[0], int(options.which[1]))
    if options.what == "good":
        return good_programs(options.first, options.count)
    return seeded(options.first, options.count, options.least)


if __name__ == "__main__":
    sys.exit(main())
