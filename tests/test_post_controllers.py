"""What each controller wants and refuses, in the texts that its post writes."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from grassfire.app.stages import Emitted, ProgramText, choose_post
from grassfire.cli import invoke
from grassfire.errors import InputError
from grassfire.gcode import read_program
from grassfire.job import load_job
from grassfire.post import Post, find_posts, load_post, render, split_by_tool
from grassfire.post.definition import ProgramNumber
from grassfire.post.rounding import Grid, written_moves
from grassfire.post.words import identifier, program_number
from grassfire.toolpath import MoveKind, Program, Section, Toolpath, ToolpathBuilder
from grbl_rules import faults
from linuxcnc_motions import DIALECT, MISSING, available, deviation, interpret

CLEARANCE = 15.0
TOLERANCE = 0.002
JOB = Path(__file__).parent / "golden" / "islands.toml"
POSTS = tuple(find_posts())
RETRACTED = ("fanuc", "haas", "siemens840d", "centroid")


def definition(name: str) -> Post:
    post = load_post(name)
    assert isinstance(post, Post)
    return post


def path_of_all_sizes(count: int = 300, seed: int = 5) -> Toolpath:
    """Arcs from tiny to nearly full, helices, full circles, short and long lines."""
    generator = np.random.default_rng(seed)
    builder = ToolpathBuilder()
    x, y = 1.0, 2.0
    builder.rapid(x, y, CLEARANCE)
    builder.rapid(x, y, 2.0)
    builder.line(x, y, -1, 300)
    for _ in range(count):
        radius, begin = 10 ** generator.uniform(-2.5, 2), generator.uniform(-np.pi, np.pi)
        sweep = generator.choice((generator.uniform(0, 6.28), 1e-3, np.pi, 6.28318, 2 * np.pi))
        sweep *= generator.choice((-1, 1))
        centre = (x - radius * np.cos(begin), y - radius * np.sin(begin))
        if abs(sweep) < 2 * np.pi:
            x = centre[0] + radius * np.cos(begin + sweep)
            y = centre[1] + radius * np.sin(begin + sweep)
        builder.arc(x, y, -1 - generator.integers(0, 2) / 3, centre, sweep > 0, 1200)
        if generator.random() < 0.3:
            x, y = generator.uniform(-50, 50, 2)
            builder.line(x, y, -1, 812.5)
    builder.rapid(x, y, CLEARANCE)
    return builder.build()


def section(path: Toolpath, tool: int = 1, **changes: object) -> Section:
    values = {"tool_diameter": 6.0, "spindle_speed": 18000.0, "operation": 0, "name": "offset"}
    return Section(path, tool, **{**values, **changes})  # type: ignore[arg-type]


def two_tools() -> Program:
    path = path_of_all_sizes(20)
    second = section(path, 2, tool_diameter=3.175, operation=1, coolant="flood", name="b; (c)%")
    faster = dataclasses.replace(second, spindle_speed=20000.0, operation=2)
    return Program("two tools", (section(path), second, faster))


def texts_of(program: Program, post: Post) -> list[str]:
    parts = split_by_tool(program) if post.tool_change.split else (program,)
    return [render(part, post, clearance_height=CLEARANCE) for part in parts]


def code_lines(text: str) -> list[str]:
    """Lines without comments and block numbers of plain language."""
    bare = [re.sub(r"\([^()]*\)|;.*", "", line).strip() for line in text.splitlines()]
    return [line for line in bare if line and not line.isdigit()]


def test_every_common_controller_has_a_post() -> None:
    assert (
        *("centroid", "fanuc", "fluidnc", "grbl", "grblhal", "haas", "heidenhain", "linuxcnc"),
        *("mach3", "mach4", "marlin", "masso", "siemens840d", "smoothieware"),
    ) == POSTS
    for name in POSTS:
        post = definition(name)
        assert post.source and post.description
        assert post.arcs.radius_mismatch < 0.001


@pytest.mark.parametrize("units", ["mm", "inch"])
@pytest.mark.parametrize("name", POSTS)
def test_nothing_that_the_controller_refuses(name: str, units: str) -> None:
    post = definition(name).in_units(units)  # type: ignore[arg-type]
    for text in texts_of(two_tools(), post):
        assert text.isascii()
        assert max(map(len, text.splitlines())) <= post.program.line_length
        for line in code_lines(text):
            assert post.refused_word(line) is None, line
            assert not re.search(r"\dE[-+]?\d|-0\.?0*(?![\d.])|[?!~]", line), line
        for comment in re.findall(r"\(([^()]*)\)|; (.*)", text):
            assert not set("".join(comment)) & set(post.comments.forbidden)


@pytest.mark.parametrize("name", POSTS)
def test_same_input_same_text(name: str) -> None:
    assert texts_of(two_tools(), definition(name)) == texts_of(two_tools(), definition(name))


@pytest.mark.parametrize("name", POSTS)
def test_arcs_as_written(name: str) -> None:
    """Radii, sweeps and ends of what the text holds."""
    path = path_of_all_sizes()
    for units in ("mm", "inch"):
        post = definition(name).in_units(units)  # type: ignore[arg-type]
        grid = Grid(post.decimals, post.scale)
        tolerance = max(TOLERANCE, grid.step)
        moves = written_moves(path, post.arcs, post.decimals, tolerance, None, post.scale)
        arc = moves.kind >= MoveKind.ARC_CW
        assert arc.any()
        begin, end, centre = moves.begin[arc, :2], moves.end[arc, :2], moves.centre[arc]
        finest = grid.finer(int(post.arcs.extra_decimal))
        assert np.allclose(finest.nearest(centre), centre, atol=1e-9)
        first, last = begin - centre, end - centre
        assert np.abs(np.hypot(*first.T) - np.hypot(*last.T)).max() <= post.arcs.radius_mismatch
        assert np.all(np.any(begin != end, axis=1)), "an arc whose ends coincide"
        turn = np.arctan2(
            first[:, 0] * last[:, 1] - first[:, 1] * last[:, 0], np.sum(first * last, axis=1)
        )
        turn = np.where(moves.kind[arc] == MoveKind.ARC_CCW, turn, -turn) % (2 * np.pi)
        assert np.degrees(turn).max() <= post.arcs.largest_sweep + 1e-6
        assert np.array_equal(moves.begin[1:], moves.end[:-1])


def test_largest_sweeps_are_the_controllers() -> None:
    for name in ("mach3", "mach4", "fanuc", "centroid", "masso"):
        assert definition(name).arcs.largest_sweep == 180
    assert definition("haas").arcs.largest_sweep == 355


@pytest.mark.parametrize("units", ["mm", "inch"])
def test_grbl_takes_arcs_of_all_sizes(units: str) -> None:
    post = definition("grbl").in_units(units)  # type: ignore[arg-type]
    for seed in range(3):
        program = Program("all sizes", (section(path_of_all_sizes(seed=seed)),))
        text = texts_of(program, post)[0]
        assert faults(text) == []
        assert faults(text.replace("G21", "G20")) or units == "inch"


# Frames


def test_fanuc_and_haas_frames() -> None:
    fanuc, haas = (texts_of(two_tools(), definition(name))[0] for name in ("fanuc", "haas"))
    for text, number in ((fanuc, r"O\d{4} \(TWO TOOLS\)"), (haas, r"O\d{5} \(TWO TOOLS\)")):
        lines = text.splitlines()
        assert lines[0] == lines[-1] == "%"
        assert re.fullmatch(number, lines[1])
        assert lines[-2] == "M30"
        assert text == text.upper()
        assert all("." in word for word in re.findall(r"F(\S+)", "\n".join(code_lines(text))))
        assert not re.search(r"[XYZIJ]-?\d+\.\d{4}", text)
    assert fanuc.count("G91 G28 Z0.\nG90\n") == 3
    assert haas.count("G53 G0 Z0.\n") == 3
    assert "G28" not in haas
    others = set(POSTS) - {"fanuc"}
    assert not any(
        "G28" in text for name in others for text in texts_of(two_tools(), definition(name))
    )


@pytest.mark.parametrize("name", RETRACTED)
def test_across_before_down_where_the_spindle_is_up(name: str) -> None:
    post = definition(name)
    lines = texts_of(two_tools(), post)[0].splitlines()
    changes = [at for at, line in enumerate(lines) if re.search(r"\bM6\b", line)]
    assert len(changes) == 2
    for count, at in enumerate(changes, 1):
        rest = [line for line in lines[at:] if re.search("[XYZ]", line)]
        assert re.fullmatch(r"G0 X\S+ Y\S+", rest[0])
        assert re.fullmatch(rf"({post.tool_change.length.format(tool=count)} )?Z15\.0+", rest[1])


@pytest.mark.parametrize("name", sorted(set(POSTS) - set(RETRACTED) - {"heidenhain"}))
def test_up_before_across_elsewhere(name: str) -> None:
    for text in texts_of(two_tools(), definition(name)):
        first = next(line for line in code_lines(text) if re.search("[XYZ]", line))
        assert re.fullmatch(r"G0 Z15\.0+( F3000)?", first)


def test_marlin_has_the_command_on_every_line_and_a_feed_for_rapids() -> None:
    text = texts_of(two_tools(), definition("marlin"))[0]
    feed = ""
    for line in code_lines(text):
        assert re.match(r"[GM]\d+( |$)", line), line
        assert len(re.findall(r"(?:^| )[GM]\d", line)) == 1, "one command a line"
        feed = (re.findall(r" F(\S+)", line) or [feed])[0]
        if line.startswith("G0 "):
            assert feed == "3000", line
        elif re.match(r"G[123] ", line):
            assert feed != "3000", line
    assert "M0 Insert tool 2 D3.175\n" in text
    assert "(" not in text
    assert "M3 S18000\nG4 P3000\n" in text


def test_dwell_units() -> None:
    for name, dwell in (("linuxcnc", "G4 P2.5"), ("haas", "G4 P2500"), ("siemens840d", "G4 F2.5")):
        post = definition(name)
        waiting = post.model_copy(
            update={"spindle": post.spindle.model_copy(update={"spin_up": 2.5})}
        )
        lines = texts_of(two_tools(), waiting)[0].splitlines()
        assert lines[lines.index("S18000 M3") + 1] == dwell


def test_smoothieware_has_one_program_for_each_tool() -> None:
    post, program = definition("smoothieware"), two_tools()
    with pytest.raises(InputError, match="changes no tools"):
        render(program, post, clearance_height=CLEARANCE)
    parts = split_by_tool(program)
    assert [part.name for part in parts] == ["two tools-1-T1", "two tools-2-T2"]
    assert [len(part.sections) for part in parts] == [1, 2]
    again = Program("x", (*program.sections[:1], *program.sections[1:2], *program.sections[:1]))
    assert [part.name for part in split_by_tool(again)] == ["x-1-T1", "x-2-T2", "x-3-T1"]
    for text in texts_of(program, post):
        assert text.endswith("M5\nM2\n") or text.endswith("M5\nM9\nM2\n")
        assert not re.search("M30|M0|M6", text)
        assert all(re.match(r"G[0123] ", line) for line in text.splitlines() if " X" in line)


def test_siemens_helices_tell_their_turns() -> None:
    text = texts_of(two_tools(), definition("siemens840d"))[0]
    for line in code_lines(text):
        assert ("TURN=0" in line) == bool(re.search(r"Z.* I", line)), line
    assert "G710" in text and "G21" not in text


# Program numbers and names


def test_program_numbers() -> None:
    number = ProgramNumber(digits=4, largest=7999)
    assert program_number("O1234 bracket", number) == "1234"
    assert program_number("0012-bracket", number) == "0012"
    assert program_number("O1234 bracket-1-T4", number) == "1234"
    assert program_number("O1234 bracket-2-T1", number) == "1235"
    named = program_number("bracket", number)
    assert named == program_number("bracket", number) != program_number("bracket-2-T1", number)
    for index in range(2000):
        text = program_number(f"part {index}", number)
        assert len(text) == 4 and 1 <= int(text) <= 7999
    assert 1 <= int(program_number("99999 plate", number)) <= 7999
    assert 1 <= int(program_number("3d plate", number)) <= 7999


def test_identifiers() -> None:
    assert identifier("Größe 12-b") == "GROE_12_B" or identifier("Größe 12-b") == "GROSSE_12_B"
    assert identifier("!?") == "PROGRAM"
    assert len(identifier("x" * 80)) == 24


# Inches


@pytest.mark.parametrize("name", sorted(set(POSTS) - {"heidenhain"}))
def test_inches_are_the_same_moves(name: str) -> None:
    program = Program("part", (section(path_of_all_sizes(40)),))
    findings: list[str] = []
    post = definition(name)
    text = render(program, post.in_units("inch"), clearance_height=CLEARANCE, findings=findings)
    assert any("in inches with 4 decimals" in note for note in findings)
    assert post.words.inches in text and post.words.millimetres not in text
    assert re.search(r"[XY]-?\d+\.\d{4}(?!\d)", text)
    ends = np.concatenate([part.toolpath.end for part in read_program(text).sections])
    known = ends[np.isfinite(ends).all(axis=1)]
    for end in program.sections[0].toolpath.end:
        assert np.abs(known - end).max(axis=1).min() <= 0.0014


def test_inches_need_a_post_that_knows_them(monkeypatch: pytest.MonkeyPatch) -> None:
    class Other:
        name = description = extension = "other"

        def render(self, program, **_) -> str:
            return ""

    monkeypatch.setattr("grassfire.post.load_post", lambda *_, **__: Other())
    assert isinstance(choose_post(load_job(JOB)), Other)
    with pytest.raises(InputError, match="no choice of units"):
        choose_post(load_job(JOB), "inch")


# Plain language


def test_plain_language_frame() -> None:
    text = texts_of(two_tools(), definition("heidenhain"))[0]
    lines = text.splitlines()
    assert [int(line.split()[0]) for line in lines] == list(range(len(lines)))
    assert lines[0] == "0 BEGIN PGM TWO_TOOLS MM"
    assert lines[-1].endswith("END PGM TWO_TOOLS MM") and lines[-2].endswith(" M30")
    assert " TOOL CALL 2 Z S18000\n" in text and " TOOL CALL S20000\n" in text
    for line in lines:
        words = re.findall(r" (?:X|Y|Z|IPA)(\S+)", line)
        assert all(re.fullmatch(r"[-+]\d+\.\d{3,4}", word) for word in words), line
        assert not re.search(r" F\d+\.", line), "feeds are whole numbers"
        if " CC " not in line and re.search(r" (C|CP) ", line):
            assert re.search(r"DR[-+]( F\d+)?$", line)
            assert ("IPA-" in line) <= ("DR-" in line)
    inch = render(two_tools(), definition("heidenhain").in_units("inch"), clearance_height=15)
    assert inch.startswith("0 BEGIN PGM TWO_TOOLS INCH\n")
    # 300 and 1200 mm/min in tenths of an inch a minute
    assert re.findall(r" F(\d\S*)", inch)[:2] == ["118", "472"]


def test_angles_of_helices_do_not_add_up() -> None:
    """A control that computes every end from the angle stays with the plan."""
    builder = ToolpathBuilder()
    generator = np.random.default_rng(3)
    x, y, z = 0.123456, 0.654321, 0.0
    builder.rapid(x, y, CLEARANCE)
    builder.rapid(x, y, 1.0)
    builder.line(x, y, 0, 300)
    for _ in range(400):
        radius, begin = generator.uniform(0.5, 30), generator.uniform(-np.pi, np.pi)
        sweep = generator.uniform(0.2, 4.1) * generator.choice((-1, 1))
        centre = (x - radius * np.cos(begin), y - radius * np.sin(begin))
        x = centre[0] + radius * np.cos(begin + sweep)
        y = centre[1] + radius * np.sin(begin + sweep)
        z -= 0.01
        builder.arc(x, y, z, centre, sweep > 0, 600)
    builder.rapid(x, y, CLEARANCE)
    path = builder.build()
    text = texts_of(Program("coil", (section(path),)), definition("heidenhain"))[0]
    turned = position = pole = np.full(2, np.nan)
    worst, heights = 0.0, dict(zip(np.round(path.end[:, 2], 3).tolist(), path.end, strict=True))
    for line in text.splitlines():
        words = {key: float(value) for key, value in re.findall(r" (X|Y|Z|IPA)([-+][\d.]+)", line)}
        if " CC " in line:
            pole = np.array([words["X"], words["Y"]])
        elif " CP " in line:
            angle = np.radians(words["IPA"])
            rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            position = pole + rotation @ (position - pole)
            off = position - heights[words["Z"]][:2]
            worst = max(worst, float(np.abs(off).max()))
            turned = position
        elif "X" in words:
            position = np.array([words["X"], words["Y"]])
    assert np.isfinite(turned).all()
    # Half a unit of rounded ends, the centre's finer grid, half a unit of the angle's 4 decimals.
    assert worst <= 0.0005 + 0.1 * np.sqrt(2) * 0.001 + np.radians(0.5e-4) * 30


# From the job to the files


def test_split_programs_in_inches_from_the_job(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--post", "haas", "--split-tools", "--inch", "--json"]
    assert invoke(["run", str(JOB), "--out", str(tmp_path), *options]) == 0
    report = json.loads(capsys.readouterr().out)
    names = ["islands-1-T1.nc", "islands-2-T2.nc"]
    assert sorted(path.name for path in tmp_path.glob("*.nc")) == names
    assert [Path(report["files"][f"program {count}"]).name for count in (1, 2)] == names
    assert report["program"] == ", ".join(names)
    assert report["verified"] is True
    assert any("in inches" in finding["message"] for finding in report["findings"])
    for count, name in enumerate(names, 1):
        text = (tmp_path / name).read_text()
        assert "G20" in text and f"T{count} M6" in text
        assert text.startswith("%\nO") and text.endswith("M30\n%\n")


def test_lines_of_split_programs_are_their_own() -> None:
    texts = (ProgramText("a", "1\n2\n3\n", 1), ProgramText("b", "1\n2\n", 4))
    post = definition("grbl")
    emitted = Emitted(load_job(JOB), post, (), (), texts, Program("x", ()), ())
    assert emitted.place(3) == ("a.nc", 3)
    assert emitted.place(4) == ("b.nc", 1)
    assert emitted.place(5) == ("b.nc", 2)
    assert emitted.step == pytest.approx(0.001)


# Definitions


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('next = ["M0"]', ""), "tool_change: .*`next` is empty"),
        (('dwell = ["G4 P{seconds}"]', 'dwell = ["G4 P{hours}"]'), "known are .*{seconds}"),
        (("spin_up = 3.0", "spin_up = -1.0"), "spindle.spin_up"),
        (('header = ["G17', 'opening = ["%"]\nheader = ["G17'), "holds %"),
        (("decimals = 3\n", 'decimals = 3\nunits = "cm"\n'), "numbers.units"),
    ],
)
def test_definitions_are_checked(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = find_posts()["grbl"].read_text()
    assert change[0] in text
    path = tmp_path / "broken.toml"
    path.write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load_post(path)


# Documentation


def test_the_table_of_posts_is_complete() -> None:
    text = (Path(__file__).resolve().parents[1] / "docs" / "posts.md").read_text()
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| `")]
    found = {name: row for row in rows for name in re.findall(r"`(\w+)`", row[1])}
    assert sorted(found) == list(POSTS)
    for name, row in found.items():
        post = definition(name)
        assert row[2].strip() == f".{post.extension}"
        assert re.match(
            rf"{post.arcs.largest_sweep:g}( degrees)?, {post.numbers.decimals}", row[3].strip()
        )
        milliseconds = "milliseconds" in "".join(post.spindle.dwell)
        assert row[5].strip() == ("ms" if milliseconds else "s")


# LinuxCNC's interpreter


@pytest.mark.skipif(not available(), reason=MISSING)
@pytest.mark.parametrize("name", DIALECT)
def test_linuxcnc_takes_arcs_of_all_sizes(name: str, tmp_path: Path) -> None:
    program = Program("all sizes", (section(path_of_all_sizes(200, seed=11)),))
    for units, tolerance in (("mm", TOLERANCE), ("inch", 0.00254)):
        post = definition(name).in_units(units)  # type: ignore[arg-type]
        path = tmp_path / f"program.{post.extension}"
        path.write_text(texts_of(program, post)[0], encoding="ascii")
        answer = interpret(path, 0.001)
        half_step = 0.51 * 10.0**-post.decimals * post.scale
        made = deviation(program, answer, half_step)
        assert made.end <= half_step
        assert made.path <= tolerance
