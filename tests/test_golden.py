"""Golden programs: one job in the words of every controller, to the letter.

`golden/islands.moves.json` holds the moves that `golden/islands.toml` was planned to, so that the
texts change with the posts only. `--update-golden` plans the job and writes everything anew.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from grassfire.gcode import read_program
from grassfire.post import Post, find_posts, load_post, render, split_by_tool
from grassfire.toolpath import MoveKind, Program, Role, Section, Toolpath
from grbl_rules import faults
from linuxcnc_motions import DIALECT, MISSING, available, deviation, interpret

GOLDEN = Path(__file__).parent / "golden"
MOVES = GOLDEN / "islands.moves.json"
CLEARANCE = 15.0
TOLERANCE = 0.002
POSTS = tuple(find_posts())
COLUMNS = {"kind": np.uint8, "end": float, "centre": float, "feed": float, "role": np.uint8}


def to_json(program: Program) -> str:
    """Moves to text: all digits, one column a line."""
    sections = []
    for section in program.sections:
        path = section.toolpath
        columns = {name: getattr(path, name).tolist() for name in COLUMNS}
        about = {**vars(section), "toolpath": None, "start": path.start.tolist(), **columns}
        sections.append({key: value for key, value in about.items() if key != "toolpath"})
    texts = [
        "{\n" + ",\n".join(f"{json.dumps(key)}: {json.dumps(row[key])}" for key in row) + "\n}"
        for row in sections
    ]
    return "[\n" + ",\n".join(texts) + "\n]\n"


def from_json(text: str) -> Program:
    sections = []
    for row in json.loads(text):
        count = len(row["kind"])
        columns = {
            name: np.array(row.pop(name), dtype=kind).reshape(
                (count, {"end": 3, "centre": 2}.get(name, 1))
            )
            for name, kind in COLUMNS.items()
        }
        for name in ("kind", "feed", "role"):
            columns[name] = columns[name][:, 0]
        start = np.array(row.pop("start"), dtype=float)
        line = np.zeros(count, dtype=np.int64)
        sections.append(Section(toolpath=Toolpath(start=start, line=line, **columns), **row))
    return Program("islands", tuple(sections))


@pytest.fixture(scope="module")
def planned(request: pytest.FixtureRequest) -> Program:
    """The planned moves; with `--update-golden` planned anew."""
    if request.config.getoption("--update-golden"):
        from grassfire.app.stages import Stopwatch, plan_job
        from grassfire.job import load_job

        program = plan_job(load_job(GOLDEN / "islands.toml"), Stopwatch()).program
        MOVES.write_text(to_json(program), encoding="ascii", newline="\n")
    return from_json(MOVES.read_text(encoding="ascii"))


def definition(name: str) -> Post:
    post = load_post(name)
    assert isinstance(post, Post)
    return post


def parts(program: Program, post: Post) -> tuple[Program, ...]:
    """One program, or one for each tool where the controller changes none."""
    return split_by_tool(program) if post.tool_change.split else (program,)


def text_of(program: Program, post: Post) -> str:
    return render(program, post, clearance_height=CLEARANCE, tolerance=TOLERANCE)


def golden_path(program: Program, post: Post) -> Path:
    return GOLDEN / f"{program.name}.{post.name}.{post.extension}"


def assert_same_text(text: str, golden: str) -> None:
    for number, (line, expected) in enumerate(
        zip(text.split("\n"), golden.split("\n"), strict=False), 1
    ):
        assert line == expected, f"line {number}: {line!r} instead of {expected!r}"
    assert len(text) == len(golden)


def test_the_job_is_what_goldens_must_show(planned: Program) -> None:
    assert len(planned.sections) == 2
    assert len({section.tool_number for section in planned.sections}) == 2
    for section in planned.sections:
        path = section.toolpath
        entry = path.role == Role.ENTRY
        assert np.any(entry & path.is_arc & (path.begin[:, 2] > path.end[:, 2])), "no helix"
        kinds = set(path.kind[path.role != Role.RAPID].tolist())
        assert {int(MoveKind.LINE), int(MoveKind.ARC_CW), int(MoveKind.ARC_CCW)} & kinds
    kinds = set(np.concatenate([part.toolpath.kind for part in planned.sections]).tolist())
    assert kinds == {int(kind) for kind in MoveKind}


def test_moves_survive_their_file(planned: Program) -> None:
    assert to_json(from_json(to_json(planned))) == MOVES.read_text(encoding="ascii")


@pytest.mark.parametrize("name", POSTS)
def test_golden_program(name: str, planned: Program, request: pytest.FixtureRequest) -> None:
    post = definition(name)
    for program in parts(planned, post):
        text, path = text_of(program, post), golden_path(program, post)
        if request.config.getoption("--update-golden"):
            path.write_text(text, encoding="ascii", newline="\n")
        assert_same_text(text, path.read_text(encoding="ascii"))


def test_no_golden_program_is_left_over(planned: Program) -> None:
    expected = {
        golden_path(program, definition(name)).name
        for name in POSTS
        for program in parts(planned, definition(name))
    }
    found = {path.name for path in GOLDEN.iterdir()}
    assert found == expected | {"islands.toml", "islands.dxf", MOVES.name}


@pytest.mark.parametrize("name", POSTS)
def test_golden_comparison_can_fail(name: str, planned: Program) -> None:
    post = definition(name)
    for number, part in enumerate(parts(planned, post)):
        golden = golden_path(part, post).read_text(encoding="ascii")
        last = part.sections[-1]
        row = int(np.flatnonzero(last.toolpath.kind == MoveKind.LINE)[1])
        moved = last.toolpath.end.copy()
        moved[row, 0] += 2 * 10.0**-post.decimals
        shifted = dataclasses.replace(last.toolpath, end=moved)
        changed = dataclasses.replace(
            part, sections=(*part.sections[:-1], dataclasses.replace(last, toolpath=shifted))
        )
        with pytest.raises(AssertionError, match="instead of"):
            assert_same_text(text_of(changed, post), golden)
        with pytest.raises(AssertionError):
            assert_same_text(golden + "M2\n", golden)
        assert number < 2


@pytest.mark.parametrize("name", POSTS)
def test_golden_program_reads_back_as_the_plan(name: str, planned: Program) -> None:
    post = definition(name)
    for part in parts(planned, post):
        path = golden_path(part, post)
        read = read_program(path.read_text(encoding="ascii"), source=path.name)
        # The way up after the last tool may be a section of its own.
        cutting = [one for one in read.sections if np.any(one.toolpath.kind != MoveKind.RAPID)]
        for one, other in zip(cutting, part.sections, strict=True):
            assert one.tool_number == other.tool_number
            assert one.operation == other.operation
            assert one.tool_diameter == pytest.approx(other.tool_diameter, abs=1e-4)
            assert one.coolant == other.coolant
            assert one.spindle_speed == other.spindle_speed
            low = other.toolpath.end[:, 2].min()
            assert np.nanmin(one.toolpath.end[:, 2]) == pytest.approx(low, abs=1e-3)
            feeds = other.toolpath.kind != MoveKind.RAPID
            planned_length = other.toolpath.length[feeds].sum()
            length = one.toolpath.length[one.toolpath.kind != MoveKind.RAPID].sum()
            # Every end and every centre is rounded.
            slack = np.sum(1 + np.abs(other.toolpath.sweep[feeds])) * 10.0**-post.decimals
            assert length == pytest.approx(planned_length, abs=slack)


def test_grbl_takes_its_golden_program(planned: Program) -> None:
    path = golden_path(planned, definition("grbl"))
    assert faults(path.read_text(encoding="ascii")) == []


@pytest.mark.skipif(not available(), reason=MISSING)
@pytest.mark.parametrize("units", ["mm", "inch"])
@pytest.mark.parametrize("name", DIALECT)
def test_linuxcnc_makes_the_planned_motions(
    name: str, units: Literal["mm", "inch"], planned: Program, tmp_path: Path
) -> None:
    post = definition(name).in_units(units)
    for part in parts(planned, post):
        path = golden_path(part, post)
        if units == "inch":
            path = tmp_path / f"program.{post.extension}"
            path.write_text(text_of(part, post), encoding="ascii")
        half_step = 0.51 * 10.0**-post.decimals * post.scale
        made = deviation(part, interpret(path, 0.001), half_step)
        assert made.end <= half_step
        assert made.path <= (0.001 if units == "mm" else 0.00254)


@pytest.mark.skipif(not available(), reason=MISSING)
def test_comparison_with_linuxcnc_can_fail(planned: Program, tmp_path: Path) -> None:
    post = definition("linuxcnc")
    golden = golden_path(planned, post).read_text(encoding="ascii")
    lines = golden.splitlines()
    arc = next(number for number, line in enumerate(lines) if line.startswith("G2"))
    for wrong in ("", lines[arc].replace("G2", "G3"), lines[arc].replace("Y", "Z-1.9 Y")):
        path = tmp_path / "wrong.ngc"
        changed = [*lines[:arc], wrong, *lines[arc + 1 :]]
        path.write_text("\n".join(changed) + "\n", encoding="ascii")
        with pytest.raises(AssertionError):
            deviation(planned, interpret(path, 10.0), 0.001)
    with pytest.raises(AssertionError):
        path.write_text(golden.replace("G91.1", "G90.1"), encoding="ascii")
        interpret(path, 0.001)
