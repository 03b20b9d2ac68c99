"""Drawings to programs and back: every stage as a user runs it, judged by what shares nothing."""

from __future__ import annotations

import importlib
import json
import math
import os
import random
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely

from grassfire import (
    GeometryError,
    GrassfireError,
    PlanningError,
    Program,
    load_job,
    read_program,
    read_regions,
    run,
)
from grassfire.app import judge, verify_file
from grassfire.app.stages import read_drawings, targets_of
from grassfire.geometry import flatten
from grbl_rules import faults as grbl_faults
from verify_samples import SlowJudge

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
GOUGE = 0.005
FLOOR = 0.001


# Drawings


def _rounded(space: object, x: float, y: float, width: float, height: float, radius: float) -> None:
    """A rounded rectangle as one polyline with bulges."""
    bulge = math.tan(math.pi / 8)
    space.add_lwpolyline(  # type: ignore[attr-defined]
        [
            (x + radius, y, 0),
            (x + width - radius, y, bulge),
            (x + width, y + radius, 0),
            (x + width, y + height - radius, bulge),
            (x + width - radius, y + height, 0),
            (x + radius, y + height, bulge),
            (x, y + height - radius, 0),
            (x, y + radius, bulge),
        ],
        format="xyb",
        close=True,
    )


def islands(space: object) -> None:
    """A rounded rectangle with a round and a rounded island."""
    _rounded(space, 0, 0, 52, 34, 6)
    space.add_circle((14, 18), 4.5)  # type: ignore[attr-defined]
    _rounded(space, 28, 10, 14, 12, 2)


def touching_bosses(space: Any) -> None:
    """A rounded rectangle with two round islands that touch."""
    _rounded(space, 0, 0, 60, 40, 6)
    space.add_circle((20, 20), 8)
    space.add_circle((36, 20), 8)


def free_form(space: object) -> None:
    """A closed cubic spline with lobes."""
    angle = np.linspace(0, 2 * np.pi, 15)
    reach = 15 + 4 * np.cos(3 * angle) + 2 * np.sin(2 * angle)
    points = np.column_stack([1.3 * reach * np.cos(angle), reach * np.sin(angle)])
    space.add_spline([(*point, 0) for point in points], degree=3)  # type: ignore[attr-defined]


def corners(space: object) -> None:
    """Sharp and reflex corners, a slanted arm."""
    points = [(0, 0), (40, 0), (40, 11), (20, 11), (34, 30), (22, 34), (11, 14), (11, 30), (0, 30)]
    for start, end in zip(points, points[1:] + points[:1], strict=True):
        space.add_line(start, end)  # type: ignore[attr-defined]


def ellipse_in_ellipse(space: object) -> None:
    space.add_ellipse((0, 0), (26, 6), 0.62)  # type: ignore[attr-defined]
    space.add_ellipse((4, 1), (-2, 6), 0.5)  # type: ignore[attr-defined]


def ring_of_holes(space: object) -> None:
    """Symmetric: necks right in the middle of arcs, duplicates by rotation."""
    space.add_circle((0, 0), 20)  # type: ignore[attr-defined]
    for index in range(6):
        angle = math.radians(30 + 60 * index)
        centre = (13 * math.cos(angle), 13 * math.sin(angle))
        space.add_circle(centre, 2.5)  # type: ignore[attr-defined]


def dumbbell(space: object) -> None:
    """Two squares and a neck of 5 mm."""
    points = [(0, 0), (18, 0), (18, 6.5), (30, 6.5), (30, 0), (48, 0)]
    points += [(x, 18 - y) for x, y in reversed(points)]
    space.add_lwpolyline(points, close=True)  # type: ignore[attr-defined]


def wide_and_narrow(space: object) -> None:
    """A pocket with room for a tool of 4 mm and a slot without."""
    _rounded(space, 0, 0, 30, 20, 4)
    _rounded(space, 40, 0, 30, 3, 1)


@dataclass(frozen=True)
class Case:
    """A drawing and how it is machined."""

    draw: Callable[[object], None]
    diameter: float
    post: str
    keys: str = ""
    depth: float = 3.0

    @property
    def name(self) -> str:
        return f"{self.draw.__name__}-{self.diameter:g}-{self.post}"


CASES = (
    Case(islands, 4.0, "linuxcnc", 'entry = "helix"'),
    Case(islands, 7.6, "grbl", 'entry = "ramp"'),
    Case(free_form, 5.0, "grbl", 'direction = "conventional"'),
    Case(corners, 6.0, "linuxcnc", 'entry = "ramp"'),
    Case(ellipse_in_ellipse, 3.0, "linuxcnc", "stepover = 0.3"),
    Case(ring_of_holes, 3.0, "grbl"),
    Case(dumbbell, 4.9, "linuxcnc"),
    Case(dumbbell, 6.0, "linuxcnc"),
    Case(wide_and_narrow, 4.0, "linuxcnc", 'entry = "plunge"'),
)


def write_job(folder: Path, case: Case) -> Path:
    """Drawing and job file of a case."""
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    case.draw(document.modelspace())
    document.saveas(folder / "drawing.dxf")
    path = folder / "job.toml"
    path.write_text(
        f"""name = "{case.name}"
post = "{case.post}"
[input]
file = "drawing.dxf"
[[tools]]
number = 1
diameter = {case.diameter}
spindle_speed = 10000
feed = 900
plunge_feed = 200
[[operations]]
strategy = "offset"
tool = 1
depth = {case.depth}
stepdown = 1.5
{case.keys}
""",
        encoding="utf-8",
    )
    return path


def polygon_of(drawing: Path, units: str | None = None) -> shapely.Geometry:
    regions = read_regions(drawing, units=units).regions
    return shapely.union_all(
        [
            shapely.Polygon(
                flatten(region.outer, 1e-4), [flatten(island, 1e-4) for island in region.islands]
            )
            for region in regions
        ]
    )


# A plain reader and measure, for nothing but what the posts write


WORD = re.compile(r"([GMXYZIJF])(-?[\d.]+)")


def positions(text: str, step: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) along all moves with ends in all axes, and whether each is on a rapid."""
    here, motion = np.full(3, np.nan), 0
    points, rapid = [], []
    for line in text.splitlines():
        words = dict(WORD.findall(re.sub(r"\(.*?\)", "", line)))
        if "G" in words and words["G"] in ("0", "1", "2", "3"):
            motion = int(words["G"])
        if not set(words) & set("XYZIJ") or words.get("G") == "43":
            continue
        end = np.array([float(words.get(axis, here[k])) for k, axis in enumerate("XYZ")])
        if np.isfinite([*here, *end]).all():
            part = _points(here, end, motion, words, step)
            points.append(part)
            rapid.append(np.full(len(part), motion == 0))
        here = end
    return np.concatenate(points), np.concatenate(rapid)


def _points(
    begin: np.ndarray, end: np.ndarray, motion: int, words: dict[str, str], step: float
) -> np.ndarray:
    if motion < 2:
        count = max(2, math.ceil(np.linalg.norm(end - begin) / step) + 1)
        return begin + (end - begin) * np.linspace(0, 1, count)[:, None]
    centre = begin[:2] + np.array([float(words.get("I", 0)), float(words.get("J", 0))])
    first, last = begin[:2] - centre, end[:2] - centre
    turn = math.atan2(last[1], last[0]) - math.atan2(first[1], first[0])
    turn = turn % (2 * math.pi) if motion == 3 else -(-turn % (2 * math.pi))
    radius = np.linalg.norm(first)
    count = max(2, math.ceil(abs(turn) * radius / step) + 1)
    angle = math.atan2(first[1], first[0]) + turn * np.linspace(0, 1, count)
    return np.column_stack(
        [
            centre[0] + radius * np.cos(angle),
            centre[1] + radius * np.sin(angle),
            np.linspace(begin[2], end[2], count),
        ]
    )


def clearances(points: np.ndarray, polygon: shapely.Geometry) -> np.ndarray:
    """Distance of points (n, 2) from the walls, negative outside."""
    where = shapely.points(points[:, :2])
    shapely.prepare(polygon)
    inside = shapely.contains(polygon, where)
    distance = shapely.distance(polygon.boundary, where)
    return np.where(inside, distance, -distance)


def uncovered(points: np.ndarray, polygon: shapely.Geometry, radius: float) -> float:
    """Area within the tool's reach that no position at these points covers, mm2."""
    line = shapely.union_all(shapely.buffer(shapely.points(points), radius, quad_segs=32))
    reach = polygon.buffer(-radius - 0.003, quad_segs=32).buffer(radius - 0.01, quad_segs=32)
    return float(reach.difference(line.buffer(1e-3)).area)


# Tests


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_drawing_becomes_a_program_that_clears_its_pocket(case: Case, tmp_path: Path) -> None:
    result = run(write_job(tmp_path, case), out=tmp_path / "out")
    assert result.faults == ()
    text = result.files["program"].read_text(encoding="utf-8")
    polygon = polygon_of(tmp_path / "drawing.dxf")
    radius = case.diameter / 2
    points, rapid = positions(text)
    below = points[:, 2] < -1e-6
    assert (radius - clearances(points[below], polygon)).max() <= GOUGE
    assert points[:, 2].min() == pytest.approx(-case.depth, abs=FLOOR)
    floor = points[points[:, 2] < FLOOR - case.depth]
    assert uncovered(floor, polygon, radius) <= 0.001 * polygon.area
    # across only above the stock
    across = np.hypot(*np.diff(points[:, :2], axis=0).T) > 1e-6
    assert not np.any(across & rapid[:-1] & rapid[1:] & below[:-1])
    if case.post == "grbl":
        assert grbl_faults(text) == []


def test_the_same_job_gives_the_same_bytes(tmp_path: Path) -> None:
    job = write_job(tmp_path, CASES[0])
    texts = [run(job, out=tmp_path / name).files["program"].read_bytes() for name in ("one", "two")]
    assert texts[0] == texts[1]


def test_a_contour_without_room_is_a_finding_beside_others_with(tmp_path: Path) -> None:
    result = run(write_job(tmp_path, CASES[-1]), out=tmp_path)
    found = [finding for finding in result.report.findings if finding.code == "tool-too-large"]
    assert result.ok
    assert len(found) == 1
    assert "the largest that does has 3 mm" in found[0].message
    assert json.loads(result.files["report"].read_text())["verified"] is True


def test_no_room_anywhere_is_one_error_with_the_largest_tool(tmp_path: Path) -> None:
    with pytest.raises(PlanningError, match=r"fits nowhere.*the largest tool that fits has 20 mm"):
        run(write_job(tmp_path, Case(wide_and_narrow, 25.0, "grbl")), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_drawing_in_the_wrong_units_is_refused(tmp_path: Path) -> None:
    job = write_job(tmp_path, Case(islands, 4.0, "grbl"))
    job.write_text(job.read_text().replace("[input]", '[input]\nunits = "m"'))
    with pytest.raises(PlanningError, match=r"km of cuts.*check units"):
        run(job, out=tmp_path / "out")


def test_contours_that_touch_are_named_with_the_place(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=r"contours touch at \(28, 20\); draw what touches"):
        run(write_job(tmp_path, Case(touching_bosses, 4.0, "grbl")), out=tmp_path / "out")


def test_a_descent_from_here_to_the_moon_is_refused(tmp_path: Path) -> None:
    job = write_job(tmp_path, Case(islands, 4.0, "grbl"))
    text, count = re.subn(r"(?m)^depth = .*$", "depth = 1e9", job.read_text())
    assert count == 1
    job.write_text(re.sub(r"(?m)^stepdown = .*$", "", text))
    with pytest.raises(PlanningError, match=r"km long.*check depth"):
        run(job, out=tmp_path / "out")


# Seeded faults in the text of real programs


JOBS = {"bracket": range(19), "leaf": range(0, 19, 4), "plate": range(2, 19, 4)}
"""Demo jobs, and the seeds that each gets: all kinds of changes, and half of them twice."""


@cache
def demo(name: str, folder: Path) -> str:
    """Text of the program of a demo job."""
    result = run(ROOT / "jobs" / f"{name}.toml", out=folder)
    assert result.ok
    return result.files["program"].read_text(encoding="utf-8")


def _value(line: str, letter: str) -> float | None:
    found = re.search(rf"{letter}(-?[\d.]+)", line)
    return float(found[1]) if found else None


def _changed(line: str, letter: str, change: Callable[[float], float]) -> str:
    value = _value(line, letter)
    assert value is not None
    return re.sub(rf"{letter}-?[\d.]+", f"{letter}{change(value):.3f}", line, count=1)


def _rows(lines: list[str], pattern: str) -> list[int]:
    return [row for row, line in enumerate(lines) if re.search(pattern, line) and "(" not in line]


def shift_centre(lines: list[str], choice: random.Random) -> None:
    row = choice.choice(_rows(lines, r"I-?[\d.]+.*J"))
    lines[row] = _changed(lines[row], choice.choice("IJ"), lambda value: value + 0.4)


def mirror_arc(lines: list[str], choice: random.Random) -> None:
    row = choice.choice(_rows(lines, r"^G[23] "))
    lines[row] = ("G3" if lines[row][1] == "2" else "G2") + lines[row][2:]


def rapid_for_feed(lines: list[str], choice: random.Random) -> None:
    row = choice.choice(_rows(lines, r"^G1 [XY]"))
    lines[row] = "G0" + re.sub(r" F[\d.]+", "", lines[row][2:])


def drop_retract(lines: list[str], choice: random.Random) -> None:
    """A retract before a travel, wherever there is one; else the last, before the end."""
    rows = _rows(lines, r"^G0 Z")
    del lines[choice.choice(rows[1:])]


def wrong_depth(lines: list[str], choice: random.Random) -> None:
    row = choice.choice(_rows(lines, r"Z-"))
    lines[row] = _changed(lines[row], "Z", lambda value: value - 9)


def lower_all(lines: list[str], choice: random.Random) -> None:
    for row in _rows(lines, r"Z-"):
        lines[row] = _changed(lines[row], "Z", lambda value: value - 0.05)


def raise_all(lines: list[str], choice: random.Random) -> None:
    for row in _rows(lines, r"Z-"):
        lines[row] = _changed(lines[row], "Z", lambda value: value + 0.06)


def shift_all(lines: list[str], choice: random.Random) -> None:
    letter = choice.choice("XY")
    for row in _rows(lines, rf"{letter}-?\d"):
        lines[row] = _changed(lines[row], letter, lambda value: value + 0.05)


def shift_end(lines: list[str], choice: random.Random) -> None:
    row = choice.choice(_rows(lines, r"^(G1 )?X-?[\d.]+ Y-?[\d.]+( F[\d.]+)?$|^G1 X"))
    lines[row] = _changed(lines[row], "X", lambda value: value + choice.choice([-7.0, 7.0]))


def missing_pass(lines: list[str], choice: random.Random) -> None:
    """A tenth of the program is lost; the modal state goes on from there."""
    count = len(lines) // 10
    begin = choice.randrange(12, len(lines) - count - 6)
    del lines[begin : begin + count]


def lost_line(lines: list[str], choice: random.Random) -> None:
    del lines[choice.choice(_rows(lines, r"^G[123] |I-?[\d.]+"))]


def exchanged(lines: list[str], choice: random.Random) -> None:
    row = choice.choice(_rows(lines, r"^G[123] |I-?[\d.]+")[:-8])
    lines[row], lines[row + 1] = lines[row + 1], lines[row]


def cut_short(lines: list[str], choice: random.Random) -> None:
    row = choice.choice(_rows(lines, r"^G[123] "))
    lines[row:] = ["M5", "M2"]


def spindle_stops(lines: list[str], choice: random.Random) -> None:
    lines.insert(choice.choice(_rows(lines, r"^G[123] ")), "M5")


def no_spindle(lines: list[str], choice: random.Random) -> None:
    lines[:] = [line.replace(" M3", "") for line in lines]


def inches(lines: list[str], choice: random.Random) -> None:
    lines[:] = [line.replace("G21", "G20") for line in lines]


def relative(lines: list[str], choice: random.Random) -> None:
    lines.insert(choice.choice(_rows(lines, r"^G[123] ")), "G91")


def plunge(lines: list[str], choice: random.Random) -> None:
    """The entry's ramp becomes a straight descent: its first moves are lost."""
    first = _rows(lines, r"Z-")[0]
    last = next(row for row in range(first, len(lines)) if "Z-" not in lines[row])
    floor = _value(lines[last - 1], "Z")
    lines[first - 2 : last] = [f"G1 Z{floor} F200"]


def sign(lines: list[str], choice: random.Random) -> None:
    row = choice.choice(_rows(lines, r"X\d.* Y\d"))
    lines[row] = lines[row].replace("X", "X-", 1)


MUTATIONS = (
    shift_centre,
    mirror_arc,
    rapid_for_feed,
    drop_retract,
    wrong_depth,
    lower_all,
    raise_all,
    shift_all,
    shift_end,
    missing_pass,
    lost_line,
    exchanged,
    cut_short,
    spindle_stops,
    no_spindle,
    inches,
    relative,
    plunge,
    sign,
)
ALWAYS = {wrong_depth, lower_all, raise_all, shift_all, spindle_stops, no_spindle, inches}
"""Harmful wherever they strike; the others may strike air or area that is cleared already."""


def mutated(text: str, name: str, seed: int) -> tuple[str, Callable[..., None]]:
    """The text after one mutation; the same for the same arguments."""
    choice = random.Random(f"{name} {seed}")
    mutation = MUTATIONS[seed % len(MUTATIONS)]
    lines = text.splitlines()
    mutation(lines, choice)
    return "\n".join(lines) + "\n", mutation


def _harmful(name: str, text: str) -> bool:
    """Whether the slow judge finds harm in what any operation does to its own pockets."""
    job = load_job(ROOT / "jobs" / f"{name}.toml")
    program = read_program(text)
    return any(
        SlowJudge((target,), slices=3)
        .judge(
            Program(
                program.name,
                tuple(item for item in program.sections if item.operation == target.operation),
            )
        )
        .harmful
        for target in targets_of(job, read_drawings(job))
    )


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("programs")


@pytest.mark.parametrize("name", JOBS)
def test_harmful_changes_to_demo_programs_are_caught(name: str, programs: Path) -> None:
    text = demo(name, programs)
    job = load_job(ROOT / "jobs" / f"{name}.toml")
    drawings = read_drawings(job)
    assert judge(job, drawings, read_program(text)).ok
    caught = 0
    for seed in JOBS[name]:
        changed, mutation = mutated(text, name, seed)
        assert changed != text
        try:
            good = judge(job, drawings, read_program(changed)).ok
        except GrassfireError:
            good = False
        caught += not good
        if good:
            assert mutation not in ALWAYS
            assert not _harmful(name, changed), (mutation.__name__, seed)
    assert caught > len(JOBS[name]) / 2


def test_a_changed_program_is_refused_by_its_file_too(tmp_path: Path, programs: Path) -> None:
    text, _ = mutated(demo("bracket", programs), "bracket", MUTATIONS.index(wrong_depth))
    (tmp_path / "changed.ngc").write_text(text, encoding="utf-8")
    judged = verify_file(tmp_path / "changed.ngc", ROOT / "jobs" / "bracket.toml")
    assert any("below the floor" in fault for fault in judged.faults)


# Judges outside the project, where present


@pytest.mark.skipif("LCNC_ROOT" not in os.environ, reason="needs LinuxCNC's interpreter")
@pytest.mark.parametrize("name", JOBS)
def test_the_linuxcnc_interpreter_accepts_the_demo_programs(name: str, tmp_path: Path) -> None:
    checker = SHARED / "tools" / "rs274_check.py"
    if not checker.exists():
        pytest.skip("needs the interpreter's checker")
    result = run(ROOT / "jobs" / f"{name}.toml", out=tmp_path, post="linuxcnc")
    command = ["/usr/bin/python3", str(checker), str(result.files["program"])]
    done = subprocess.run(
        [*command, "--arc-tol", "0.002", "--quiet"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("drawing", "units"),
    [
        ("mikedh+trimesh__models_2D_single_arc.dxf", "mm"),
        ("mikedh+trimesh__models_2D_angle_test.dxf", None),
    ],
)
def test_drawings_of_others(drawing: str, units: str | None, tmp_path: Path) -> None:
    path = SHARED / "dxf" / drawing
    if not path.exists():
        pytest.skip("needs the drawings")
    pytest.importorskip("numba")
    job = write_job(tmp_path, Case(islands, 2.0, "linuxcnc", depth=2.0))
    given = f'units = "{units}"' if units else ""
    job.write_text(job.read_text().replace('"drawing.dxf"', json.dumps(str(path)) + f"\n{given}"))
    result = run(job, out=tmp_path)
    assert result.faults == ()
    sys.path.insert(0, str(SHARED / "tools"))
    measure = importlib.import_module("gcode_judge").measure
    sys.path.pop(0)
    text = result.files["program"].read_text(encoding="utf-8")
    figures = measure(text, polygon_of(path, units), 2.0, 1.0)
    assert figures["gouge_mm"] <= GOUGE
    assert figures["floor_gouge_mm"] <= FLOOR
    assert figures["uncut_pct"] <= 0.1
    assert figures["rapid_hits"] == 0
    assert figures["plunge_mm"] == 0
    assert figures["errors"] == []
