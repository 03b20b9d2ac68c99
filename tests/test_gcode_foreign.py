"""Programs of other CAM systems read to the moves that their controllers would make."""

from __future__ import annotations

import math

import numpy as np
import pytest

import foreign
from grassfire.errors import InputError
from grassfire.gcode import read_program
from grassfire.toolpath import MoveKind, Program, Section, Toolpath

NAN = math.nan
R, L, CW, CCW = (MoveKind.RAPID, MoveKind.LINE, MoveKind.ARC_CW, MoveKind.ARC_CCW)
Row = tuple[MoveKind, list[float], list[float], float, int]


def rapid(x: float, y: float, z: float, line: int) -> Row:
    return R, [x, y, z], [NAN, NAN], NAN, line


def feed(x: float, y: float, z: float, rate: float, line: int) -> Row:
    return L, [x, y, z], [NAN, NAN], rate, line


def arc(kind: MoveKind, end: list[float], centre: list[float], rate: float, line: int) -> Row:
    return kind, end, centre, rate, line


def assert_moves(path: Toolpath, rows: list[Row]) -> None:
    assert path.kind.tolist() == [row[0] for row in rows]
    assert np.allclose(path.end, [row[1] for row in rows], atol=1e-4, equal_nan=True)
    assert np.allclose(path.centre, [row[2] for row in rows], atol=1e-4, equal_nan=True)
    assert np.allclose(path.feed, [row[3] for row in rows], equal_nan=True)
    assert path.line.tolist() == [row[4] for row in rows]


def only(program: Program) -> Section:
    (section,) = program.sections
    return section


def test_freecad() -> None:
    section = only(read_program(foreign.FREECAD))
    assert (section.tool_number, section.spindle_speed) == (2, 10000)
    rows = [
        rapid(NAN, NAN, 15, 15), rapid(10, 5, 15, 16), rapid(10, 5, 3, 17),
        feed(10, 5, -1, 120, 18), arc(CW, [20, 5, -1], [15, 5], 600, 19),
        arc(CW, [10, 5, -1], [15, 5], 600, 20), rapid(10, 5, 15, 21),
    ]  # fmt: skip
    assert_moves(section.toolpath, rows)


def test_fusion_with_an_arc_across() -> None:
    program = read_program(foreign.FUSION)
    section = only(program)
    assert (section.tool_number, section.tool_diameter) == (3, 6.0)
    assert program.findings == ("line 18: arcs in the plane XZ are read as chords",)
    path = section.toolpath
    across = path.line == 18
    x, z = path.end[across, 0], path.end[across, 2]
    assert np.allclose(np.hypot(x - 9.4, z - 0.6), 0.6)
    assert np.all(np.diff(x) < 0) and np.all(np.diff(z) < 0)
    assert path.end[across][-1].tolist() == [9.4, 0, 0]
    rest = path.line > 20
    assert path.kind[path.line == 20].tolist() == [CW]
    assert np.allclose(
        path.end[rest][:4], [[5.4, 0, -2], [0, 0, -2], [0, 0, 15], [0, 0, NAN]], equal_nan=True
    )
    assert np.isnan(path.end[-1]).all()


def test_estlcam() -> None:
    section = only(read_program(foreign.ESTLCAM))
    assert section.spindle_speed == 24000
    rows = [
        rapid(NAN, NAN, 5, 6), rapid(1.5, 2.5, 5, 7), rapid(1.5, 2.5, 0.5, 8),
        feed(1.5, 2.5, -1, 300, 9), feed(11.5, 2.5, -1, 900, 10),
        arc(CCW, [11.5, 12.5, -1], [11.5, 7.5], 900, 11), feed(1.5, 12.5, -1, 900, 12),
        rapid(1.5, 12.5, 5, 13),
    ]  # fmt: skip
    assert_moves(section.toolpath, rows)


def test_vectric_in_inches_without_blanks() -> None:
    section = only(read_program(foreign.VECTRIC_INCH))
    assert section.tool_number == 1
    rows = [
        rapid(NAN, NAN, 20.32, 10), rapid(0, 0, 20.32, 15), rapid(25.4, 12.7, 5.08, 16),
        feed(25.4, 12.7, -2.54, 762, 17), arc(CCW, [0, 12.7, -2.54], [12.7, 12.7], 2540, 18),
        feed(0, -12.7, -2.54, 2540, 19), rapid(0, -12.7, 5.08, 20), rapid(0, -12.7, 20.32, 21),
        rapid(0, 0, 20.32, 22),
    ]  # fmt: skip
    assert_moves(section.toolpath, rows)


def test_jscut_begins_with_feed_moves() -> None:
    program = read_program(foreign.JSCUT)
    assert "line 3: feed moves from an unknown position are read as rapids" in program.findings
    rows = [
        rapid(NAN, NAN, 2.54, 3), rapid(9.525, 9.525, 2.54, 19), feed(9.525, 9.525, 0, 2540, 20),
        feed(9.525, 9.525, -3.175, 127, 22), feed(12.7, 9.525, -3.175, 1016, 24),
        feed(12.7, 12.7, -3.175, 1016, 25), feed(12.7, 12.7, 2.54, 2540, 27),
    ]  # fmt: skip
    assert_moves(only(program).toolpath, rows)


def test_feed_moves_from_nowhere_are_read_at_the_greatest_height_only() -> None:
    low = foreign.JSCUT.replace("G1 Z2.54 F2540      ;", "G1 Z1.0 F2540 ;")
    with pytest.raises(InputError, match=r"not the greatest height of the program .* at line 3"):
        read_program(low)
    with pytest.raises(InputError, match="unknown position of Z at line 2"):
        read_program("G0 X1 Y1\nG1 Z-1 F100\nG1 X5\nG0 Z9")


def test_engraver() -> None:
    rows = [
        rapid(NAN, NAN, 6.35, 10), rapid(2.54, 5.08, 6.35, 12), feed(2.54, 5.08, -0.127, 127, 13),
        arc(CW, [7.62, 5.08, -0.127], [5.08, 5.08], 127, 14), feed(12.7, 5.08, -0.127, 127, 15),
        rapid(12.7, 5.08, 6.35, 16), rapid(0, 0, 6.35, 18),
    ]  # fmt: skip
    assert_moves(only(read_program(foreign.F_ENGRAVE)).toolpath, rows)


def test_fanuc() -> None:
    program = read_program(foreign.FANUC)
    section = only(program)
    assert (section.tool_number, section.tool_diameter, section.coolant) == (1, 8.0, "flood")
    centre = 5 - math.sqrt(49 - 25)
    rows = [
        rapid(5, 6, NAN, 7), rapid(5, 6, 25, 8), rapid(5, 6, 2, 9), feed(5, 6, -2, 200, 10),
        feed(15, 6, -2, 400, 11), arc(CCW, [5, 6, -2], [10, 6], 400, 12),
        arc(CW, [5, 16, -2], [centre, 11], 400, 13), rapid(5, 16, 25, 14), rapid(0, 0, 25, 15),
    ]  # fmt: skip
    for x, line in ((0, 15), (10, 16)):
        rows += [rapid(10, 0, 25, 16)] if x else []
        rows += [
            rapid(x, 0, 1, line), feed(x, 0, -3, 100, line), rapid(x, 0, 1, line),
            rapid(x, 0, -2.746, line), feed(x, 0, -6, 100, line), rapid(x, 0, 25, line),
        ]  # fmt: skip
    rows += [rapid(10, 0, NAN, 19), rapid(NAN, NAN, NAN, 20)]
    assert_moves(section.toolpath, rows)


def test_heidenhain() -> None:
    section = only(read_program(foreign.HEIDENHAIN))
    assert (section.tool_number, section.tool_diameter) == (5, 10.0)
    assert (section.spindle_speed, section.coolant) == (3500, "flood")
    rows = [
        rapid(NAN, NAN, 50, 6), rapid(10, 0, 50, 7), rapid(10, 0, 1, 9), feed(10, 0, -1, 120, 10),
        arc(CCW, [10, 0, -2], [0, 0], 500, 12), arc(CCW, [10, 0, -3], [0, 0], 500, 12),
        arc(CW, [-10, 0, -3], [0, 0], 500, 13), feed(-15, 2, -3, 500, 14),
        arc(CCW, [-15, 12, -3], [-15, 7], 500, 15),
        arc(CW, [-15, 2, -3], [-15 + math.sqrt(7.5**2 - 25), 7], 500, 16),
        feed(-11, 6, -3, 300, 18), arc(CCW, [-15, 10, -3], [-15, 6], 300, 19),
        rapid(-15, 10, 50, 20), rapid(-15, 10, NAN, 23),
    ]  # fmt: skip
    assert_moves(section.toolpath, rows)


def test_heidenhain_in_inches() -> None:
    text = "BEGIN PGM A INCH\nTOOL CALL 1 Z S900\nL Z+1 FMAX M3\nL X+0 Y+0 FMAX\nL X+2 F100\n"
    path = only(read_program(text + "END PGM A INCH")).toolpath
    assert path.end[-1].tolist() == [50.8, 0, 25.4]
    assert path.feed[-1] == pytest.approx(254)  # tenths of an inch a minute


def test_siemens() -> None:
    section = only(read_program(foreign.SIEMENS))
    assert (section.tool_number, section.tool_diameter) == (4, 12.0)
    turns = [arc(CW, [10, 0, z], [5, 0], 200, 15) for z in (-2, -3, -4)]
    rows = [
        rapid(10, 0, NAN, 11), rapid(10, 0, 50, 12), rapid(10, 0, 2, 13), feed(10, 0, -1, 200, 14),
        *turns, arc(CCW, [0, 0, -4], [5, 0], 800, 16),
        arc(CCW, [10, 0, -4], [5, -math.sqrt(11)], 800, 17),
        arc(CW, [10, 10, -4], [10, 5], 800, 18), feed(6, 3, -4, 800, 20), rapid(6, 3, 50, 22),
        rapid(6, 3, NAN, 23),
    ]  # fmt: skip
    assert_moves(section.toolpath, rows)


def test_marlin() -> None:
    program = read_program(foreign.MARLIN)
    assert program.findings == ("line 7: G92 sets the origin by where the tool stands then",)
    rows = [
        rapid(0, 0, 5, 10), rapid(1, 1, 5, 11), feed(1, 1, -0.5, 200, 13),
        feed(21, 1, -0.5, 900, 14), arc(CW, [21, -9, -0.5], [21, -4], 900, 15),
        rapid(21, -9, 5, 16),
    ]  # fmt: skip
    assert_moves(only(program).toolpath, rows)


def test_centroid() -> None:
    rows = [
        rapid(25.4, 25.4, NAN, 6), rapid(25.4, 25.4, 12.7, 7), feed(25.4, 25.4, -2.54, 304.8, 8),
        feed(50.8, 25.4, -2.54, 1016, 9), rapid(50.8, 25.4, 12.7, 10), rapid(50.8, 25.4, NAN, 11),
    ]  # fmt: skip
    assert_moves(only(read_program(foreign.CENTROID)).toolpath, rows)


HEIDENHAIN_HEAD = "BEGIN PGM A MM\nTOOL CALL 1 Z S900 F100\nL Z+5 FMAX M3\nL X+0 Y+0 FMAX\n"
SIEMENS_HEAD = 'G17 G90 G710\nMSG("a")\nS900 M3\nG0 X0 Y0\nZ5\nF100\n'


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ("L X+5 RL", "radius compensation"),
        ("CT X+5 Y+5", "tangential arcs"),
        ("RND R5", "not read: RND R5"),
        ("FN 0: Q1 = +5", "not read: FN 0"),
        ("L X+Q1", "not read in a block L: X[+]Q1"),
        ("CALL LBL 1", "not read: CALL LBL 1"),
        ("CYCL DEF 200 DRILLING", "a cycle is not read"),
        ("CYCL DEF 7.1 X+10", "an offset, a rotation or a scale"),
        ("C X+1 Y+1 DR+", "without a known CC"),
        ("CC X+1 Y+0\nC X+2 Y+0", "without DR[+] or DR-"),
        ("CC X+1 Y+0\nC X+2 Y+0 DR+ FMAX", "an arc as a rapid"),
        ("CC X+1 Y+0\nCP IPA-90 DR+", "against the direction"),
        ("CC X+1 Y+0\nCP DR+", "without PA or IPA"),
        ("CR X+1 DR+", "CR without R"),
        ("CR X+9 DR+ R1", "too small for a chord"),
        ("CC X+1 Y+0\nC X+3 Y+0 DR+", "radii of an arc differ"),
        ("TOOL CALL \"MILL\" Z S1", "a tool by its name"),
        ("TOOL CALL 2 X S1", "a tool along X"),
        ("L X+1 X+2", "written twice"),
        ("L X+1 M128", "M128 is not read"),
        ("TOOL CALL 2 Z S1\nL X+1", "unknown position of X, Y, Z"),
        ("TOOL CALL 2 Z S1\nL IX+1 FMAX", "relative move of X"),
    ],
)  # fmt: skip
def test_plain_language_that_is_refused_names_the_line(block: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_program(HEIDENHAIN_HEAD + block, source="part.h")
    assert str(caught.value).startswith("part.h: ")
    assert f"at line {5 + block.count(chr(10))}" in str(caught.value)


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ("R1=5", "not part of a word"),
        ("G1 X=R1", "not part of a word"),
        ("G1 X=5+R2", "not part of a word"),
        ("T=\"MILL\"", "not part of a word"),
        ("G1 AP=30 RP=5", "not part of a word"),
        ("GOTOF END", "not part of a word"),
        ("G2 X1 CR=0.1", "too small for a chord"),
        ("G2 X5 I2.5 J0 TURN=1.5", "no count of turns"),
        ("MCALL CYCLE81(5,0,1,-3)", "not part of a word|not closed"),
    ],
)  # fmt: skip
def test_siemens_words_that_are_refused_name_the_line(block: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_program(SIEMENS_HEAD + block, source="part.mpf")
    assert str(caught.value).startswith("part.mpf: ")
    assert "at line 7" in str(caught.value)
