"""Laws of the post processors: what is written is what was planned, and controllers take it."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grassfire import post as post_module
from grassfire.errors import InputError
from grassfire.gcode import read_program
from grassfire.post import Post, find_posts, load_post, registered_posts, render
from grassfire.post.render import fixed, trimmed
from grassfire.post.rounding import written_moves
from grassfire.toolpath import MoveKind, Program, Role, Section, Toolpath, ToolpathBuilder
from grbl_rules import faults
from linuxcnc_motions import MISSING, available, interpret

CLEARANCE = 15.0
TOLERANCE = 0.002
POSTS = ("linuxcnc", "grbl")
FORMS = ("r", "none", "ij-absolute", "flat", "coarse", "half", "whole")


def section(toolpath: Toolpath, **changes: object) -> Section:
    values: dict[str, object] = {
        "tool_number": 1,
        "tool_diameter": 6.0,
        "spindle_speed": 18000.0,
        "operation": 0,
        "name": "offset",
    }
    return Section(toolpath, **{**values, **changes})  # type: ignore[arg-type]


def text_of(toolpath: Toolpath, name: str = "grbl") -> str:
    return render(
        Program("part", (section(toolpath),)), load_post(name), clearance_height=CLEARANCE
    )


def variant(name: str, **tables: dict[str, object]) -> Post:
    """A shipped post with some keys changed."""
    post = load_post(name)
    assert isinstance(post, Post)
    data = post.model_dump()
    for table, changes in tables.items():
        data[table] = {**(data[table] or {}), **changes}
    return Post.model_validate(data)


def pocket(radius: float = 5.0) -> Toolpath:
    """Helix entry, full circle, arcs of both senses, lines, links and a retract."""
    builder = ToolpathBuilder()
    builder.rapid(1, 2, CLEARANCE)
    builder.rapid(1, 2, 0.5)
    builder.arc(1, 2, -1, (0, 2), True, 300, Role.ENTRY)
    builder.arc(1, 2, -2, (0, 2), True, 300, Role.ENTRY)
    builder.arc(1, 2, -2, (0, 2), True, 1200)
    builder.line(radius, 2, -2, 1200)
    builder.arc(radius * np.cos(2), 2 + radius * np.sin(2), -2, (0, 2), True, 1200)
    builder.arc(radius * np.cos(1.9), 2 + radius * np.sin(1.9), -2, (0, 2), True, 1200)
    builder.line(1 / 3, -2 / 3, -2, 1200)
    builder.arc(2 / 3, -1, -2, (2 / 3, -2 / 3), False, 812.5)
    builder.line(2 / 3, -1, -1.5, 2400, Role.LINK)
    builder.rapid(2 / 3, -1, 3)
    builder.rapid(-4, 0.1234567, 3)
    builder.rapid(-4, 0.1234567, -1)
    builder.line(-4, 0.1234567, -2, 300, Role.ENTRY)
    builder.line(-4.00004, 0.1234567, -2, 1200)
    builder.line(-4, 7, -2, 1200)
    builder.rapid(-4, 7, CLEARANCE)
    return builder.build()


def two_tools() -> Program:
    return Program(
        "two tools",
        (
            section(pocket()),
            section(
                pocket(4.0),
                tool_number=2,
                tool_diameter=3.175,
                operation=1,
                name="rest",
                coolant="flood",
            ),
            section(
                pocket(3.0), tool_number=2, tool_diameter=3.175, operation=2, name="wall",
                spindle_speed=20000.0,
            ),
        ),
    )  # fmt: skip


# The frame of a program


@pytest.mark.parametrize("name", POSTS)
def test_first_move_is_up_to_the_clearance_height_and_so_is_the_last(name: str) -> None:
    text = render(two_tools(), load_post(name), clearance_height=CLEARANCE)
    for part in read_program(text).sections:
        known = part.toolpath.end[:, 2]
        if part.toolpath.kind[0] == MoveKind.RAPID and np.isnan(part.toolpath.start).any():
            assert np.isnan(part.toolpath.end[0, :2]).all()
            assert known[0] == CLEARANCE
        assert known[-1] == CLEARANCE


def test_linuxcnc_changes_tools_with_length_offset() -> None:
    lines = render(two_tools(), load_post("linuxcnc"), clearance_height=CLEARANCE).splitlines()
    at = lines.index("T2 M6")
    assert lines[at + 1] == "G43 H2"
    assert lines[at - 1] == "(operation 2: rest, tool 2 D3.175)"
    assert lines[at - 2] == "M5"
    assert lines[at - 3] == f"Z{CLEARANCE:.4f}" or lines[at - 3] == f"G0 Z{CLEARANCE:.4f}"
    assert lines[-1] == "M2"
    assert lines.index("M8") < lines.index("M9") < lines.index("S20000 M3")


def test_grbl_stops_for_tools_with_a_message_before() -> None:
    lines = render(two_tools(), load_post("grbl"), clearance_height=CLEARANCE).splitlines()
    assert lines[lines.index("S18000 M3") + 1] == "G4 P3"
    at = lines.index("M0")
    assert lines[at - 1].startswith("(MSG, insert tool 2 D3.175")
    assert "M5" in lines[at - 5 : at]
    assert lines.count("M0") == 1
    assert lines[-1] == "M30"


@pytest.mark.parametrize("name", POSTS)
def test_no_exponent_negative_zero_or_home(name: str) -> None:
    text = render(two_tools(), load_post(name), clearance_height=CLEARANCE)
    assert not re.search(r"-0\.?0*(?![\d.])", text)
    assert not re.search(r"\dE[-+]?\d|G28|%|[^\x20-\x7e\n]", text)


def test_numbers() -> None:
    assert fixed(-0.0004, 3) == "0.000"
    assert fixed(-0.0006, 3) == "-0.001"
    assert fixed(1e-7, 3) == "0.000"
    assert trimmed(1200.0, 1) == "1200"
    assert trimmed(-0.0, 1) == "0"
    assert trimmed(20.05, 2) == "20.05"


def test_long_and_forbidden_comments_are_folded_and_reported() -> None:
    findings: list[str] = []
    program = Program("Größe (a)? " + "x" * 200, (section(pocket(), name="rés~t" * 40),))
    text = render(program, load_post("grbl"), clearance_height=CLEARANCE, findings=findings)
    assert faults(text) == []
    assert text.startswith("(Groe a xxx") or text.startswith("(Gro")
    assert findings
    first = read_program(text).sections[0]
    assert first.operation == 0
    assert first.tool_diameter == 6.0


def test_sections_that_go_on_where_the_tool_is_stay_down() -> None:
    builder = ToolpathBuilder()
    builder.rapid(0, 0, CLEARANCE)
    builder.rapid(0, 0, 1)
    builder.line(0, 0, -1, 300)
    first = builder.build()
    builder = ToolpathBuilder((0, 0, -1))
    builder.line(5, 0, -1, 600)
    builder.rapid(5, 0, CLEARANCE)
    program = Program("part", (section(first), section(builder.build(), operation=1)))
    lines = render(program, load_post("grbl"), clearance_height=CLEARANCE).splitlines()
    at = lines.index("(operation 2: offset, tool 1 D6)")
    assert lines[at + 1] == "X5.000 F600"


def test_line_numbers_and_semicolon_comments() -> None:
    post = variant(
        "linuxcnc", line_numbers={"start": 5, "step": 5}, comments={"style": "semicolon"}
    )
    text = render(two_tools(), post, clearance_height=CLEARANCE)
    lines = [line for line in text.splitlines() if not line.startswith(";")]
    assert lines[0].startswith("N5 G17")
    assert lines[1].startswith("N10 ")
    plain = read_program(render(two_tools(), load_post("linuxcnc"), clearance_height=CLEARANCE))
    numbered = read_program(text)
    for one, other in zip(plain.sections, numbered.sections, strict=True):
        assert np.array_equal(one.toolpath.end, other.toolpath.end, equal_nan=True)
        assert one.name == other.name


def test_words_repeat_where_the_controller_wants_them() -> None:
    modality = {"motion": False, "coordinates": False, "feed": False}
    text = render(two_tools(), variant("grbl", modality=modality), clearance_height=CLEARANCE)
    moves = [line for line in text.splitlines() if "X" in line and not line.startswith("(")]
    assert all(line.startswith(("G0 ", "G1 ", "G2 ", "G3 ")) for line in moves)
    assert all("F" in line for line in moves if not line.startswith("G0"))


# Rounding


def planned_points(toolpath: Toolpath, index: int, fractions: np.ndarray) -> np.ndarray:
    begin, end = toolpath.begin[index], toolpath.end[index]
    centre, sweep = toolpath.centre[index], toolpath.sweep[index]
    points = begin + fractions[:, None] * (end - begin)
    if toolpath.is_arc[index]:
        offset = begin[:2] - centre
        angle = np.arctan2(offset[1], offset[0]) + fractions * sweep
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points[:, :2] = centre + np.hypot(*offset) * circle
    return points


def assert_written_as_planned(toolpath: Toolpath, post: Post) -> None:
    """Text, read back, has the ends, the circles, the sweeps and the heights of the plan."""
    decimals = post.numbers.decimals
    unit = 10.0**-decimals
    text = render(Program("part", (section(toolpath),)), post, clearance_height=CLEARANCE)
    if post.name == "grbl":
        assert faults(text) == []
    read = read_program(text).sections[0].toolpath
    start = np.array([np.nan, np.nan, CLEARANCE])
    written = written_moves(toolpath, post.arcs, decimals, TOLERANCE, start)
    offset = 1  # the rise to the clearance height
    assert len(read) == len(written) + offset
    end, begin = read.end[offset:], read.begin[offset:]
    assert np.array_equal(read.kind[offset:], written.kind)
    assert np.allclose(end, written.end, atol=1e-9)
    radius_start = np.hypot(*(begin[:, :2] - read.centre[offset:]).T)
    radius_end = np.hypot(*(end[:, :2] - read.centre[offset:]).T)
    arc = read.is_arc[offset:]
    if post.arcs.form != "r":
        assert np.all(np.abs(radius_start - radius_end)[arc] <= post.arcs.radius_mismatch + 1e-9)
    sweep = np.where(arc, read.sweep[offset:], 0.0)
    for index in range(len(toolpath)):
        rows = np.flatnonzero(written.source == index)
        here = np.round(toolpath.end[index], decimals)
        if len(rows):
            assert np.allclose(end[rows[-1]], here, atol=1e-9)
        elif toolpath.is_arc[index]:
            points = planned_points(toolpath, index, np.linspace(0, 1, 65))
            assert np.abs(points - here).max() <= TOLERANCE + unit
        if toolpath.is_arc[index] and len(rows):
            assert_arc(toolpath, index, begin[rows], end[rows], read.centre[offset:][rows],
                       sweep[rows], unit)  # fmt: skip


def assert_arc(toolpath, index, begin, end, centre, sweep, unit) -> None:
    fractions = np.linspace(0, 1, 33)
    middle, planned_sweep = toolpath.centre[index], toolpath.sweep[index]
    radius = np.hypot(*(toolpath.begin[index, :2] - middle))
    height = toolpath.end[index, 2] - toolpath.begin[index, 2]
    turned = 0.0
    for row in range(len(begin)):
        points = begin[row] + fractions[:, None] * (end[row] - begin[row])
        if sweep[row]:
            offset = begin[row, :2] - centre[row]
            angle = np.arctan2(offset[1], offset[0]) + fractions * sweep[row]
            circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            points[:, :2] = centre[row] + np.hypot(*offset) * circle
        distance = np.hypot(*(points[:, :2] - middle).T)
        assert np.abs(distance - radius).max() <= TOLERANCE + unit
        if radius > 20 * unit:
            spokes = points[:, :2] - middle
            angle = np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0]))
            along = turned + angle - angle[0]
            turned = along[-1]
            # z goes with the sweep, but for what the path may shift along itself.
            expected = toolpath.begin[index, 2] + height * along / planned_sweep
            steepness = abs(height / (radius * planned_sweep))
            slack = unit + steepness * 2 * (TOLERANCE + unit)
            assert np.abs(points[:, 2] - expected).max() <= slack
    if radius > 20 * unit:
        assert abs(turned - planned_sweep) <= 3 * unit / radius


lengths = st.floats(-80, 80, allow_nan=False).map(lambda value: round(value, 7))
sweeps = st.one_of(
    st.floats(1e-6, 2 * np.pi - 1e-6),
    st.floats(-9, -0.3).map(lambda power: 10.0**power),
    st.floats(-9, -0.3).map(lambda power: 2 * np.pi - 10.0**power),
    st.just(2 * np.pi),
)


@st.composite
def toolpaths(draw: st.DrawFn) -> Toolpath:
    """Lines, arcs from tiny to nearly full, helices and full circles, with rapids between."""
    builder = ToolpathBuilder()
    x, y, z = draw(lengths), draw(lengths), -1.0
    builder.rapid(x, y, CLEARANCE)
    builder.rapid(x, y, 1.0)
    builder.line(x, y, z, 300)
    for _ in range(draw(st.integers(1, 12))):
        choice = draw(st.integers(0, 7))
        if choice == 0:
            x, y = draw(lengths), draw(lengths)
            builder.line(x, y, z, draw(st.floats(1, 5000)))
        elif choice == 1:
            x, y = x + draw(st.floats(-0.002, 0.002)), y + draw(st.floats(-0.002, 0.002))
            builder.line(x, y, z, 600)
        elif choice == 2:
            builder.rapid(x, y, 3.0)
            x, y = draw(lengths), draw(lengths)
            builder.rapid(x, y, 3.0)
            builder.line(x, y, z, 300)
        else:
            radius = 10 ** draw(st.floats(-3, 2.3))
            sweep, begin = draw(sweeps), draw(st.floats(-np.pi, np.pi))
            sign = draw(st.sampled_from((-1.0, 1.0)))
            centre = (x - radius * np.cos(begin), y - radius * np.sin(begin))
            if sweep < 2 * np.pi:
                x = centre[0] + radius * np.cos(begin + sign * sweep)
                y = centre[1] + radius * np.sin(begin + sign * sweep)
            z = z - draw(st.sampled_from((0.0, 0.0, 0.3333333, 1.0)))
            builder.arc(x, y, z, centre, sign > 0, 1200)
    builder.rapid(x, y, CLEARANCE)
    return builder.build()


@settings(max_examples=150, deadline=None)
@given(toolpaths(), st.sampled_from(POSTS))
def test_read_back_is_the_plan(toolpath: Toolpath, name: str) -> None:
    post = load_post(name)
    assert isinstance(post, Post)
    assert_written_as_planned(toolpath, post)


@settings(max_examples=40, deadline=None)
@given(
    toolpaths(), st.sampled_from(("r", "none", "ij-absolute", "flat", "coarse", "half", "whole"))
)
def test_read_back_is_the_plan_in_every_arc_form(toolpath: Toolpath, form: str) -> None:
    changes: dict[str, dict[str, object]] = {
        "r": {"arcs": {"form": "r", "largest_sweep": 120.0}},
        "none": {"arcs": {"form": "none"}},
        "ij-absolute": {"arcs": {"form": "ij-absolute"}},
        "flat": {"arcs": {"helical": False, "largest_sweep": 90.0}},
        "coarse": {"arcs": {"extra_decimal": False}, "numbers": {"decimals": 3}},
        "half": {"arcs": {"extra_decimal": False, "largest_sweep": 180.0}},
        "whole": {"arcs": {"full_circles": "whole", "largest_sweep": 360.0}},
    }
    post = variant("linuxcnc", **changes[form])
    if form == "ij-absolute":
        header = tuple(line.replace("G91.1", "G90.1") for line in post.program.header)
        post = variant("linuxcnc", **changes[form], program={"header": header})
    assert_written_as_planned(toolpath, post)


def test_tiny_arc_does_not_become_a_circle() -> None:
    for sweep in (1e-3, 1e-5, 1e-7):
        for decimals in (3, 4):
            builder = ToolpathBuilder((0, 0, 0))
            builder.arc(1 - np.cos(sweep), np.sin(sweep), 0, (1, 0), False, 600)
            arcs = variant("grbl").arcs
            written = written_moves(builder.build(), arcs, decimals, TOLERANCE)
            length = np.hypot(*(written.end - written.begin)[:, :2].T).sum()
            assert not np.any(written.kind >= MoveKind.ARC_CW) or length > 0
            assert length <= sweep + 10.0**-decimals


def test_short_moves_do_not_move_the_path() -> None:
    builder = ToolpathBuilder((0, 0, CLEARANCE))
    for step in range(1, 1001):
        builder.line(step * 1e-4, 0, CLEARANCE, 600)
    written = written_moves(builder.build(), variant("grbl").arcs, 3, TOLERANCE)
    assert len(written) == 100
    assert written.end[-1, 0] == 0.1


def test_circles_have_an_axis_word_and_half_turns() -> None:
    text = text_of(pocket())
    assert "G3 X-1.000 Y2.000 Z-0.250 I-1.000 J0.000 F300" in text
    whole = {"full_circles": "whole", "largest_sweep": 360.0}
    text = render(
        Program("part", (section(pocket()),)), variant("grbl", arcs=whole), clearance_height=15
    )
    assert "X1.000 Y2.000 I-1.000 J0.000" in text
    assert faults(text) == []


# Refusals


def built(*moves: tuple[str, tuple[object, ...]], start: object = None) -> Toolpath:
    builder = ToolpathBuilder(start)  # type: ignore[arg-type]
    for method, arguments in moves:
        getattr(builder, method)(*arguments)
    return builder.build()


UP = ("rapid", (0, 0, CLEARANCE))


@pytest.mark.parametrize(
    ("toolpath", "message"),
    [
        (built(UP, ("rapid", (0, 0, 1)), ("rapid", (5, 5, 2))), "below the clearance"),
        (built(("line", (1, 1, 1, 100))), "unknown position"),
        (built(("line", (1, 1, 1, 100)), start=(0, 0, 1)), "below the clearance"),
        (built(UP, ("line", (0, 0, 1, float("nan")))), "no feed"),
        (built(UP, ("line", (0, 0, 1, 0.0))), "no feed"),
        (built(UP, ("line", (float("inf"), 0, 1, 100))), "not finite"),
        (built(UP, ("arc", (1, 0, 15, (float("nan"), 0), True, 100))), "no centre"),
        (built(UP, ("arc", (3, 0, 15, (1, 0), True, 100))), "radii"),
        (
            built(("rapid", (float("nan"), 0, CLEARANCE)), ("line", (1, 1, 1, 100))),
            "unknown position",
        ),
    ],
)
def test_moves_that_no_text_can_hold(toolpath: Toolpath, message: str) -> None:
    with pytest.raises(InputError, match=message):
        text_of(toolpath)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"coolant": "mist"}, "no coolant 'mist'.*flood"),
        ({"spindle_speed": float("nan")}, "no spindle speed"),
        ({"spindle_speed": 0.0}, "no spindle speed"),
    ],
)
def test_sections_that_the_controller_cannot_run(changes: dict, message: str) -> None:
    program = Program("part", (section(pocket(), **changes),))
    with pytest.raises(InputError, match=message):
        render(program, load_post("grbl"), clearance_height=CLEARANCE)


def test_programs_that_cannot_be_written() -> None:
    post = load_post("grbl")
    with pytest.raises(InputError, match="no sections"):
        render(Program("part", ()), post, clearance_height=CLEARANCE)
    with pytest.raises(InputError, match=r"G59\.1.*G54"):
        render(Program("part", (section(pocket()),), "G59.1"), post, clearance_height=CLEARANCE)
    with pytest.raises(InputError, match="clearance height"):
        render(two_tools(), post, clearance_height=float("nan"))
    with pytest.raises(InputError, match="last decimal"):
        render(two_tools(), post, clearance_height=CLEARANCE, tolerance=1e-4)
    with pytest.raises(InputError, match="characters"):
        render(
            two_tools(),
            variant("grbl", program={"line_length": 40}),
            clearance_height=CLEARANCE,
        )


# Definitions


def test_find_and_load() -> None:
    posts = find_posts()
    assert set(POSTS) <= set(posts)
    assert list(posts) == sorted(posts)
    for name, path in posts.items():
        assert load_post(name) == load_post(path)
        assert load_post(name).name == name


def test_path_is_relative_to_the_base(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(find_posts()["grbl"].read_text(), encoding="utf-8")
    assert load_post("mine.toml", tmp_path) == load_post("grbl")


def test_unknown_name_has_the_nearest() -> None:
    with pytest.raises(InputError, match=r"unknown post 'linuxnc'.*linuxcnc"):
        load_post("linuxnc")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("[arcs]", "[arcs]\nfrom = 1"), "unknown key 'arcs.from'"),
        (('form = "ij-incremental"', 'form = "r"'), "largest_sweep <= 170"),
        (('footer = ["M30"]', 'footer = ["G28 M6"]'), "M6"),
        (('"{wcs}"', '"{what}"'), "known are .*{wcs}"),
        (("decimals = 3", "decimals = -3"), "numbers.decimals"),
        (("[program]", "[program"), "not valid TOML"),
    ],
)
def test_definitions_are_checked(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = find_posts()["grbl"].read_text()
    assert change[0] in text
    path = tmp_path / "broken.toml"
    path.write_text(text.replace(*change, 1), encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        load_post(path)
    assert "broken.toml" in str(caught.value)


def test_missing_definition(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_post(tmp_path / "none.toml")


class Whisper:
    """A post of another package."""

    name = "whisper"
    description = "writes the count of sections"
    extension = "txt"

    def render(self, program, *, clearance_height, tolerance, findings) -> str:
        return f"{len(program.sections)} at {clearance_height:g}\n"


def test_registered_class_replaces_a_definition(monkeypatch: pytest.MonkeyPatch) -> None:
    from importlib.metadata import EntryPoint

    group = post_module.ENTRY_POINT_GROUP
    points = [
        EntryPoint("grbl", f"{__name__}:Whisper", group),
        EntryPoint("absent", "no_such_module:Post", group),
        EntryPoint("poor", "builtins:object", group),
    ]
    monkeypatch.setitem(sys.modules, __name__, sys.modules[__name__])
    monkeypatch.setattr(post_module, "entry_points", lambda group: points)
    assert list(registered_posts()) == ["absent", "grbl", "poor"]
    assert render(two_tools(), load_post("grbl"), clearance_height=CLEARANCE) == "3 at 15\n"
    with pytest.raises(InputError, match="cannot be loaded"):
        load_post("absent")
    with pytest.raises(InputError, match="lacks"):
        load_post("poor")


# Controllers


def test_grbl_rules_hold_and_can_fail() -> None:
    text = render(two_tools(), load_post("grbl"), clearance_height=CLEARANCE)
    assert faults(text) == []
    wrong = {
        "M0": "M6",
        "G17 G21": "G43 H1",
        "I-1.000 J0.000": "I-1.100 J0.000",
        "S18000 M3": "M3",
        "(two tools)": "(two tools!)",
        "M30": "",
        "F300": "",
        "X-1.000 Y2.000 Z-0.250": "Z-0.250",
        "G54": "G54 (" + "x" * 80 + ")",
        "G0 Z": "%\nG0 Z",
    }
    for old, new in wrong.items():
        assert old in text
        assert faults(text.replace(old, new, 1)), (old, new)


def long_program() -> Toolpath:
    """Arcs of all sizes and sweeps from a fixed seed."""
    generator = np.random.default_rng(7)
    builder = ToolpathBuilder()
    x, y = 0.0, 0.0
    builder.rapid(x, y, CLEARANCE)
    builder.line(x, y, -1, 300)
    for _ in range(600):
        radius = 10 ** generator.uniform(-2.5, 2)
        begin, sign = generator.uniform(-np.pi, np.pi), generator.choice((-1, 1))
        sweep = sign * generator.choice((generator.uniform(0, 6.28), 1e-3, 6.28318, 2 * np.pi))
        centre = (x - radius * np.cos(begin), y - radius * np.sin(begin))
        if abs(sweep) < 2 * np.pi:
            x = centre[0] + radius * np.cos(begin + sweep)
            y = centre[1] + radius * np.sin(begin + sweep)
        builder.arc(x, y, -1 - generator.integers(0, 2) / 3, centre, sign > 0, 1200)
        if generator.random() < 0.2:
            x, y = generator.uniform(-50, 50, 2)
            builder.line(x, y, -1, 900)
    builder.rapid(x, y, CLEARANCE)
    return builder.build()


@pytest.mark.skipif(not available(), reason=MISSING)
@pytest.mark.parametrize("which", ["two_tools", "long"])
@pytest.mark.parametrize("name", ["linuxcnc", "linuxcnc3"])
def test_linuxcnc_interpreter_makes_the_planned_motions(
    which: str, name: str, tmp_path: Path
) -> None:
    program = two_tools() if which == "two_tools" else Program("long", (section(long_program()),))
    post = variant("linuxcnc", numbers={"decimals": int(name[8:] or 4)})
    path = tmp_path / "program.ngc"
    text = render(program, post, clearance_height=CLEARANCE)
    path.write_text(text, encoding="ascii")
    answer = interpret(path, 0.001)
    moves = [move for move in answer["moves"] if "to" in move]
    rows = {
        int(line): end
        for part in read_program(text).sections
        for line, end in zip(part.toolpath.line, part.toolpath.end, strict=True)
    }
    assert {move["line"] for move in moves} >= set(rows)
    for move in moves:
        if move["line"] in rows:
            difference = np.abs(np.array(move["to"]) - rows[move["line"]])
            assert np.nanmax(difference) <= 1e-6
