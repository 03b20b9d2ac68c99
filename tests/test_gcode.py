"""Laws of the G-code reader: what controllers would do, or a refusal that names the line."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grassfire.errors import InputError
from grassfire.gcode import read_program
from grassfire.toolpath import MoveKind, Program, Role, Toolpath

HEAD = "G21 G90 G17\nS9000 M3\nG0 Z5\nG0 X0 Y0\n"
AT_START = HEAD + "F600\n"


def path_of(text: str) -> Toolpath:
    sections = read_program(text).sections
    assert len(sections) == 1
    return sections[0].toolpath


def ends(text: str) -> list[list[float]]:
    """Ends after the two rapids of the head."""
    return np.round(path_of(text).end[2:], 9).tolist()


def test_positions_are_unknown_until_written() -> None:
    path = path_of("G0 Z5\nX1\nY2\nG1 X3 F100")
    assert np.isnan(path.start).all()
    expected = [[math.nan, math.nan, 5], [1, math.nan, 5], [1, 2, 5], [3, 2, 5]]
    assert np.array_equal(path.end, expected, equal_nan=True)
    assert path.line.tolist() == [1, 2, 3, 4]
    assert path.kind.tolist() == [0, 0, 0, 1]


def test_modal_motion_feed_and_spaces() -> None:
    path = path_of(AT_START + "g1 x1 (over) y 2 ; there\nN30 Z-1 F50\n\nX+.5Y-2.\n")
    assert ends(AT_START + "g1 x1 (over) y 2 ; there\nN30 Z-1 F50\n\nX+.5Y-2.\n") == [
        [1, 2, 5], [1, 2, -1], [0.5, -2, -1],
    ]  # fmt: skip
    assert path.feed[2:].tolist() == [600, 50, 50]
    assert np.isnan(path.feed[:2]).all()
    assert path.role[2:].tolist() == [Role.CUT, Role.ENTRY, Role.CUT]


def test_inches_and_relative() -> None:
    assert ends(AT_START + "G20 G1 X1 F10\nG21 X26.4") == [[25.4, 0, 5], [26.4, 0, 5]]
    assert path_of(AT_START + "G20 G1 X1 F10").feed[2] == pytest.approx(254)
    assert ends(AT_START + "G91 G1 X1 Y1\nX1 Z-2\nG90 X0") == [[1, 1, 5], [2, 1, 3], [0, 1, 3]]


def test_moves_of_no_length_are_left_out() -> None:
    assert ends(AT_START + "G1 X0 Y0\nG0 Z5\nG1 X1\nX1") == [[1, 0, 5]]


@pytest.mark.parametrize(
    "block",
    [
        "G3 X0 Y2 I0 J1",
        "G91.1 G3 X0 Y2 J1",
        "G90.1 G3 X0 Y2 I0 J1",
        "G3 X0 Y2 R1",
        "G03 X0 Y2 R-1",
        "G91 G3 Y2 J1",
        "G20 G3 X0 Y0.0787401574803 J0.03937007874",
    ],
)
def test_forms_of_a_half_turn(block: str) -> None:
    path = path_of(AT_START + block)
    assert path.kind[-1] == MoveKind.ARC_CCW
    assert path.centre[-1] == pytest.approx([0, 1], abs=1e-6)
    assert path.sweep[-1] == pytest.approx(math.pi, abs=1e-6)


@settings(max_examples=100, deadline=None)
@given(
    st.floats(0.5, 100), st.floats(-math.pi, math.pi), st.floats(0.01, 6.2), st.booleans()
)  # fmt: skip
def test_radius_and_centre_give_the_same_arc(
    radius: float, begin: float, sweep: float, counter: bool
) -> None:
    sign = 1 if counter else -1
    centre = (-radius * math.cos(begin), -radius * math.sin(begin))
    end = (
        centre[0] + radius * math.cos(begin + sign * sweep),
        centre[1] + radius * math.sin(begin + sign * sweep),
    )
    code = f"G{3 if counter else 2} X{end[0]:.12f} Y{end[1]:.12f} "
    by_radius = path_of(AT_START + code + f"R{radius if sweep < math.pi else -radius:.12f}")
    by_centre = path_of(AT_START + code + f"I{centre[0]:.12f} J{centre[1]:.12f}")
    assert by_centre.sweep[-1] == pytest.approx(sign * sweep, abs=1e-6)
    # Near a half turn R leaves the centre to the last decimals.
    if abs(sweep - math.pi) > 0.01:
        assert by_radius.centre[-1] == pytest.approx(by_centre.centre[-1], abs=1e-5)


def test_full_circles_helices_and_turns() -> None:
    circle = path_of(AT_START + "G2 I3")
    assert circle.sweep[-1] == -2 * math.pi
    helix = path_of(AT_START + "G3 X0 Y0 Z4 I3")
    assert helix.sweep[-1] == 2 * math.pi
    assert helix.end[-1].tolist() == [0, 0, 4]
    turns = path_of(AT_START + "G3 X6 Y0 Z0 I3 P3")
    assert turns.sweep[2:] == pytest.approx([2 * math.pi, 2 * math.pi, math.pi])
    assert turns.end[2:, 2] == pytest.approx([3, 1, 0])
    whole = path_of(AT_START + "G2 X0 Y0 Z1 I3 P2")
    assert whole.sweep[2:] == pytest.approx([-2 * math.pi] * 2)
    assert whole.end[2:, 2] == pytest.approx([3, 1])


def test_radius_mismatch_follows_the_rule_of_controllers() -> None:
    assert len(path_of(AT_START + "G2 X2.004 Y0 I1")) == 3
    assert len(path_of(AT_START + "G2 X40.018 Y0 I20")) == 3
    with pytest.raises(InputError, match=r"job\.nc: the radii .* 0\.0100 mm at line 6"):
        read_program(AT_START + "G2 X2.01 Y0 I1", source="job.nc")


# Cycles


def test_drilling() -> None:
    hole = AT_START + "G81 X1 Y2 Z-3 R1\nX4\nG80\nG0 X0"
    assert ends(hole) == [
        [1, 2, 5], [1, 2, 1], [1, 2, -3], [1, 2, 5],
        [4, 2, 5], [4, 2, 1], [4, 2, -3], [4, 2, 5], [0, 2, 5],
    ]  # fmt: skip
    path = path_of(hole)
    assert path.kind[2:6].tolist() == [0, 0, 1, 0]
    assert path.line[2:6].tolist() == [6, 6, 6, 6]
    assert ends(AT_START + "G99 G82 X1 Z-3 R1 P0.5")[-1] == [1, 0, 1]


def test_drilling_below_the_retract_plane_rises_first() -> None:
    assert ends(AT_START + "G0 Z0\nG98 G81 X1 Z-3 R1")[1:] == [
        [0, 0, 1], [1, 0, 1], [1, 0, -3], [1, 0, 1],
    ]  # fmt: skip


def test_pecks() -> None:
    deep = ends(AT_START + "G83 X0 Y0 Z-3 R1 Q2")
    assert deep == [
        [0, 0, 1], [0, 0, -1], [0, 0, 1], [0, 0, -0.746], [0, 0, -3], [0, 0, 5],
    ]  # fmt: skip
    short = ends(AT_START + "G73 X0 Y0 Z-3 R1 Q2")
    assert short == [[0, 0, 1], [0, 0, -1], [0, 0, -0.746], [0, 0, -3], [0, 0, 5]]


def test_relative_drilling_repeats() -> None:
    holes = ends(AT_START + "G91 G81 X2 Z-3 R-4 L3")
    assert [end[0] for end in holes if end[2] == -2] == [2, 4, 6]


# Sections


def test_sections_by_tool_and_marker() -> None:
    program = read_program(
        "(part)\n(operation 1: offset, tool 1 D6)\nT1 M6\nG43 H1\nS9000 M3\nM8\nG0 Z5\nX0 Y0\n"
        "G1 Z-1 F100\nG0 Z5\nM9\n(operation 2: wall, fine, tool 1 D6)\nG1 X1\nM5\n"
        "(operation 3: rest, tool 12 D3.175)\nT12 M6\nS4000 M3\nG0 Z5\nX1 Y1\nM5\nM2\nrubbish",
        source="folder/part.ngc",
    )
    assert program.name == "part"
    first, second, third = program.sections
    assert [part.operation for part in program.sections] == [0, 1, 2]
    assert [part.name for part in program.sections] == ["offset", "wall, fine", "rest"]
    assert [part.tool_number for part in program.sections] == [1, 1, 12]
    assert [part.tool_diameter for part in program.sections] == [6, 6, 3.175]
    assert [part.coolant for part in program.sections] == ["flood", "off", "off"]
    assert third.spindle_speed == 4000
    assert second.toolpath.start.tolist() == first.toolpath.end[-1].tolist() == [0, 0, 5]
    assert np.isnan(third.toolpath.start).all()


def test_foreign_code_has_no_operation_and_no_diameter() -> None:
    part = read_program("%\nO1234 (PART)\n" + AT_START + "T3 M6\nG0 X1 Y1 Z5\nM30\n%\n").sections[
        -1
    ]
    assert part.operation == -1
    assert part.tool_number == 3
    assert math.isnan(part.tool_diameter)
    noted = read_program("(T3 D=12.5 CR=0 - flat end mill)\nT3 M6\n" + AT_START).sections[-1]
    assert noted.tool_diameter == 12.5


def test_stops_dwells_and_harmless_codes() -> None:
    text = "G40 G49 G80 G94 G64 P0.01\nG61\nG97\n" + AT_START + "G4 P2\nM0\nM1\nG1 X1\nM9 M5\nM30"
    assert ends(text) == [[1, 0, 5]]


def test_block_delete() -> None:
    text = AT_START + "/G1 X1\nG1 X2"
    assert ends(text) == [[2, 0, 5]]
    assert "line 6" in read_program(text).findings[0]
    path = read_program(text, block_delete=False).sections[0].toolpath
    assert path.end[2:, 0].tolist() == [1, 2]


def test_cutting_with_a_standing_spindle_is_a_finding() -> None:
    program = read_program("G0 X0 Y0 Z5\nG1 X1 F100\nX2")
    assert program.findings == ("line 2: the tool feeds while the spindle stands",)


def test_a_spindle_that_stops_midway_begins_a_section() -> None:
    text = "(operation 1: a, tool 2 D6)\nS900 M3\nG0 X0 Y0 Z5\nG1 X1 F100\nM5\nX2\nM3\nX3\nS800\nX4"
    sections = read_program(text).sections
    assert [part.spindle_speed for part in sections] == [900, 0, 900, 800]
    assert [len(part.toolpath) for part in sections] == [2, 1, 1, 1]
    assert {(part.tool_number, part.tool_diameter, part.operation) for part in sections} == {
        (2, 6.0, 0)
    }
    assert np.array_equal(sections[1].toolpath.start, [1, 0, 5])


@pytest.mark.parametrize(
    ("start", "speed"), [("S900", 0), ("M3", 0), ("S900 M3", 900), ("S900 M3\nM5", 0)]
)
def test_a_spindle_turns_with_both_a_speed_and_a_start(start: str, speed: float) -> None:
    sections = read_program(f"{start}\nG0 X0 Y0 Z5\nG1 X1 F100").sections
    assert [part.spindle_speed for part in sections] == [speed]


def test_a_stop_after_the_last_cut_leaves_the_section_whole() -> None:
    sections = read_program("S900 M3\nG0 X0 Y0 Z5\nG1 X1 F100\nM5\nG0 Z9").sections
    assert [part.spindle_speed for part in sections] == [900]


@pytest.mark.parametrize(
    "block", ["G28", "G30", "G53 G0 X0 Y0 Z0", "M6", "G28 X1 Y1 Z9", "G91 G28 X0 Y0 Z0\nG90"]
)
def test_position_is_unknown_after_machine_moves(block: str) -> None:
    with pytest.raises(InputError, match="unknown position of X, Y, Z"):
        read_program(AT_START + block + "\nG1 X5")
    program = read_program(AT_START + block + "\nG0 Z5\nX1 Y1\nG1 X5")
    assert program.sections[-1].toolpath.end[-1].tolist() == [5, 1, 5]


def test_home_goes_over_the_point_that_is_written() -> None:
    path = path_of(AT_START + "G91 G28 Z2")
    assert path.end[2].tolist() == [0, 0, 7]
    assert np.array_equal(path.end[3], [0, 0, math.nan], equal_nan=True)
    assert not len(read_program("G91 G28 Z0").sections)


def test_other_coordinate_system_is_another_place() -> None:
    program = read_program(AT_START + "G55\nG0 X1 Y1 Z1")
    assert program.wcs == "G55"
    assert np.isnan(program.sections[-1].toolpath.start).all()
    assert "G55" in program.findings[0]


# Refusals


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ("G2 X1", "without I, J or R"),
        ("G2 X1 R5 I2", "both R and a centre"),
        ("G2 X10 R1", "too small"),
        ("G2 X0 Y0 R1", "full circle"),
        ("G2 X1 Y1 I0 J1 K1", "K has no meaning"),
        ("G2 X0 Y0 I0 J0", "radius 0"),
        ("G2 X2 I1 P0", "count of turns"),
        ("G90.1 G2 X2 I1", "needs both I and J"),
        ("G18 G2 X2 I1 J1", "J has no meaning for an arc in the XZ plane"),
        ("G19 G3 Y2 Z5", "without J, K or R"),
        ("G18 G2 X2 I1.5", "radii of an arc differ"),
        ("G18 G2 X2 I0", "radius 0"),
        ("G18 G81 X0 Z-1 R1", "G18 are not read"),
        ("G41 D1", "compensation"),
        ("G10 L2 P1 X0", "coordinate systems"),
        ("G10 P1 X0", "not known"),
        ("G28\nG92 X0", "G92 at an unknown position of X"),
        ("G92 X3\nG52 X1", "differs between controllers"),
        ("G92.3", "restoring"),
        ("G93\nG1 X1", "G1 without a feed at line 7; write F in the same block"),
        ("G93\nG1 X1 F2\nX2", "without a feed"),
        ("G93\nG81 X1 Z-1 R1 F1", "inverse time"),
        ("M5\nG95 F0.1\nG1 X1", "per turn while the spindle stands"),
        ("G95\nG94\nG1 X1", "without a feed"),
        ("G43 H1\nG1 X1", "unknown position of Z"),
        ("G43 H1\nG0 Z5\nG49\nG0 Z9\nG1 X1", "unknown position of Z"),
        ("G5 X1 Y1", "splines"),
        ("G16", "polar"),
        ("G68 X0 Y0 R30", "rotation"),
        ("G51 X0 Y0 P2", "scaling"),
        ("G84 X1 Z-1 R1", "not a plain drilling cycle"),
        ("G38.2 Z-5", "probing"),
        ("G12 I5", "circular pocket"),
        ("G70", "inch on some controllers"),
        ("G96", "constant surface speed"),
        ("G65 P9810", "macro"),
        ("M97 P5", "subprograms"),
        ("G81 X1 Z-1 R1 L1.5", "no count of holes"),
        ("G83 X1 Z-1 R1 Q0", "positive Q"),
        ("G1 U1", "unknown word U1"),
        ("G123", "unknown code G123"),
        ("M123", "unknown code M123"),
        ("M98 P100", "subprograms"),
        ("O100 sub", "subprograms"),
        ("o<drill> call [1]", "subprograms"),
        ("#1=5", "variables"),
        ("G1 X[1+2]", "variables"),
        ("G1 X#3", "variables"),
        ("G1 A90", "rotary axes are not read: A90"),
        ("G1 X1e-5", "unknown word E-5"),
        ("G1 X", "'X' is not part"),
        ("G1 X1 X2", "written twice"),
        ("G0 G1 X1", "one modal group"),
        ("(open", "not closed"),
        ("G1 X1 F0", "without a feed"),
        ("G80\nX1", "without a motion code"),
        ("G53 X1 G2", "needs G0 or G1"),
        ("G81 X1 Z-1", "without R"),
        ("G81 X1 Z3 R1", "above R"),
        ("G83 X1 Z-1 R1", "positive Q"),
        ("G28\nG91 X1", "relative move of X"),
        ("G28\nG81 X1 Z-1 R1", "unknown position of Z"),
        ("G28 X0\nG0 Z5\nG81 Y1 Z-1 R1", "unknown position of X or Y"),
    ],
)
def test_refusals_name_the_line(block: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_program(AT_START + block, source="part.nc")
    assert str(caught.value).startswith("part.nc: ")
    line = 5 + len(block.split("\n"))
    assert f"at line {line}" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("G0 Z5\nG1 X1 F100\nG0 Z6", "not the greatest height"),
        ("G0 Z5\nG2 X1 I1 F100", "unknown position of X, Y"),
        ("G0 X0 Y0\nG1 Z-1 F100", "unknown position of Z"),
        (HEAD + "G1 X1", "without a feed"),
        ("X1", "without a motion code"),
        (HEAD + "G81 X1 Z-1 R1", "without a feed"),
    ],
)
def test_what_must_come_before_a_feed_move(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_program(text)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.one_of(
            st.text(max_size=30),
            st.from_regex(r"[GMXYZIJFRTS%/(;NO][-+]?\d{0,3}\.?\d{0,2}", fullmatch=True),
        ),
        max_size=20,
    ),
    st.sampled_from(("\n", " ")),
)
def test_any_text_is_read_or_refused_in_one_line(parts: list[str], separator: str) -> None:
    try:
        program = read_program(AT_START + separator.join(parts))
    except InputError as error:
        assert "\n" not in str(error)
        assert "line " in str(error)
    else:
        assert isinstance(program, Program)


def test_nothing_is_an_empty_program() -> None:
    assert read_program("").sections == ()
    assert read_program("%\n%\n").sections == ()


def test_long_programs_are_read_fast() -> None:
    lines = [
        f"G1 X{index % 97}.123 Y{index % 89}.5" if index % 2 else f"G3 X{index % 97} Y1 R90"
        for index in range(100_000)
    ]
    text = AT_START + "\n".join(lines)
    begin = time.perf_counter()
    path = path_of(text)
    assert time.perf_counter() - begin < 6  # about 1 s on an idle core
    assert len(path) == 100_002


# Runs of plain blocks


PLAIN_WORDS = st.lists(
    st.tuples(
        st.sampled_from(("", "G0 ", "G1 ", "g01", "G2 ", "G3 ", "N7 G1 ")),
        st.sampled_from(("X", "Y", "Z", "XY", "XYZ", "XYR", "XYIJ", "XYZIJ", "IJ", "", "F")),
        st.tuples(*(st.integers(-9, 9) for _ in range(6))),
        st.sampled_from(("", " F250", "F.5")),
    ),
    min_size=12,
    max_size=40,
)


@settings(max_examples=150, deadline=None)
@given(PLAIN_WORDS, st.sampled_from(("G90", "G91", "G20", "G90.1", "G92 X3 Y-2", "G52 Z1")))
def test_many_blocks_at_once_are_read_as_one_by_one(
    blocks: list[tuple[str, str, tuple[int, ...], str]], mode: str
) -> None:
    lines = [
        motion
        + "".join(
            f"{letter}{value}" + (".25" if letter in "IJR" else "")
            for letter, value in zip("XYZIJR", values, strict=True)
            if letter in letters
        )
        + (feed if letters != "F" else "F77")
        for motion, letters, values, feed in blocks
    ]
    head = AT_START + f"G1 X0.5\n{mode}\n"
    # A comment makes a block one that is looked at by itself.
    apart = head + "\n".join(line + " (apart)" for line in lines)
    try:
        expected = path_of(apart)
    except InputError as error:
        with pytest.raises(InputError) as caught:
            path_of(head + "\n".join(lines))
        assert str(caught.value) == str(error)
        return
    together = path_of(head + "\n".join(lines))
    for name in ("start", "kind", "end", "feed", "role", "line"):
        assert np.array_equal(
            getattr(together, name),
            getattr(expected, name),
            equal_nan=name in ("start", "end", "feed"),
        ), name
    assert np.allclose(together.centre, expected.centre, atol=1e-12, equal_nan=True)


# Offsets, lengths, feeds by time and by turn


def test_offsets_are_tracked() -> None:
    assert ends(AT_START + "G92 X10 Y0\nG1 X11 Y1\nG92.1\nX5") == [[1, 1, 5], [5, 1, 5]]
    assert ends(AT_START + "G52 X2 Z1\nG1 X1 Z1\nG52 X0 Z0\nX1") == [[3, 0, 2], [1, 0, 2]]
    assert ends(AT_START + "G92 X10\nG91 G1 X1\nG90 X12") == [[1, 0, 5], [2, 0, 5]]
    program = read_program("G10 L2 P1 X5 Y5\n" + AT_START + "G1 X1")
    assert "G10 sets" in program.findings[0]


def test_z_is_unknown_after_a_change_of_tool_length() -> None:
    path = read_program(AT_START + "G43 H1\nG0 Z9\nG1 X1\nG43 H1\nX2").sections[-1].toolpath
    assert np.isnan(path.start[2])
    assert path.end[:, 0].tolist() == [0, 1, 2]
    blind = read_program(AT_START + "G43 H1 Z9\nG1 X1\nG49\nG0 Z20").findings
    assert blind == ("line 9: Z is not known after the tool length is cancelled",)


def test_feeds_by_time_and_by_turn() -> None:
    path = path_of(AT_START + "G93 G1 X3 F4\nG2 X5 I1 F2\nG95 F0.1\nG1 X7\nG94 F50\nX8")
    assert path.feed[2:] == pytest.approx([12, 2 * math.pi, 900, 50])


def test_cycle_beside_its_cancelling() -> None:
    assert ends(AT_START + "G0 G80 G90 X1") == [[1, 0, 5]]


def test_line_ends_of_all_systems() -> None:
    for line_end in ("\r\n", "\r"):
        path = path_of((AT_START + "G1 X1\nX2").replace("\n", line_end))
        assert path.line.tolist() == [3, 4, 6, 7]


# Roles


def test_lifted_moves_are_links_and_carving_is_cutting() -> None:
    lifted = path_of(AT_START + "G1 Z-1\nX5\nZ-0.5\nX9\nZ-1\nY5").role[2:].tolist()
    cut, entry, link = Role.CUT, Role.ENTRY, Role.LINK
    assert lifted == [entry, cut, link, link, entry, cut]
    carved = path_of(AT_START + "G1 Z-1\nX5 Z-2\nX9 Z-1\nX12\nX15 Z-2").role[2:].tolist()
    assert carved == [entry, cut, cut, cut, cut]
    step = path_of(AT_START + "G1 Z-2\nX5\nZ-1\nX9\nZ-1.5\nY5").role[2:].tolist()
    assert step == [entry, cut, link, cut, entry, cut]
