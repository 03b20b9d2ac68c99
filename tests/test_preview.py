"""Pictures: well-formed, deterministic, true to the moves, and legends that match."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grassfire.preview import axis_svg, svg
from grassfire.toolpath import Program, Role, Section, ToolpathBuilder

SQUARE = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 30.0], [0.0, 30.0]])
NAMESPACE = "{http://www.w3.org/2000/svg}"


def program(*, diameter: float = 6.0, sweep: float = 2 * math.pi) -> Program:
    """A rapid, a plunge, an arc on each of two floors, a link, and a retract."""
    builder = ToolpathBuilder()
    builder.rapid(20.0, 15.0, 10.0)
    builder.line(20.0, 15.0, -1.0, 100.0, Role.ENTRY)
    for z in (-1.0, -2.0):
        builder.line(25.0, 15.0, z, 100.0, Role.LINK)
        end = (20.0 + 5.0 * math.cos(sweep), 15.0 + 5.0 * math.sin(sweep))
        end = (25.0, 15.0) if sweep == 2 * math.pi else end
        builder.arc(*end, z, (20.0, 15.0), True, 500.0, Role.CUT)
    builder.rapid(20.0, 15.0, 10.0)
    return Program("part <1>", (Section(builder.build(), 3, diameter, 10_000.0),))


def paths(text: str, colour: str) -> list[str]:
    root = ElementTree.fromstring(text)
    return [
        item.attrib["d"] for item in root.iter(f"{NAMESPACE}path") if item.get("stroke") == colour
    ]


def words(text: str) -> list[str]:
    return [item.text or "" for item in ElementTree.fromstring(text).iter(f"{NAMESPACE}text")]


def test_the_same_program_is_the_same_picture() -> None:
    assert svg(program(), [SQUARE]) == svg(program(), [SQUARE])


def test_a_picture_is_xml_and_has_a_title_scale_and_tools() -> None:
    text = svg(program(), [SQUARE])
    found = words(text)
    assert "part <1>" in found
    assert "T3, 6 mm" in found
    assert any(re.fullmatch(r"[125]0* mm", word) for word in found)


def test_the_legend_names_what_is_there_and_nothing_else() -> None:
    found = words(svg(program(), [SQUARE]))
    for expected in ("pocket wall", "cut at z -1 mm", "cut at z -2 mm", "entry", "rapid"):
        # A plunge has no length from above: it shows as a ring.
        assert (expected in found) == (expected != "entry")
    assert "tool goes down here" in found
    assert "wall pass" not in found
    assert "pocket wall" not in words(svg(program()))


def test_arcs_stay_arcs_and_turn_the_right_way() -> None:
    text = svg(program(sweep=math.pi / 2), [SQUARE])
    (deepest,) = {data for data in paths(text, "#0a2c6e") if "A" in data}
    # Counter-clockwise with y up is sweep flag 0 with y down.
    radius, other, flags = re.search(r"A(\S+) (\S+) 0 (\d \d)", deepest).groups()  # type: ignore[union-attr]
    assert radius == other
    assert flags == "0 0"


@given(sweep=st.floats(0.01, 2 * math.pi))
def test_arcs_end_where_the_move_ends(sweep: float) -> None:
    text = svg(program(sweep=sweep), [SQUARE])
    (deepest,) = {data for data in paths(text, "#0a2c6e") if "A" in data}
    start = [float(value) for value in re.match(r"M(\S+) ([\d.]+)", deepest).groups()]  # type: ignore[union-attr]
    radius = float(re.search(r"A(\S+) ", deepest).group(1))  # type: ignore[union-attr]
    end = [float(value) for value in re.findall(r" ([\d.]+) ([\d.]+)(?=A|L|M|$)", deepest)[-1]]
    turn = 0.0 if sweep == 2 * math.pi else sweep
    assert end[0] - start[0] == pytest.approx(radius * (math.cos(turn) - 1), abs=0.03)
    assert end[1] - start[1] == pytest.approx(-radius * math.sin(turn), abs=0.03)
    # No piece is so long that its centre is in doubt.
    assert len(re.findall("A", deepest)) == (1 if sweep < 0.9 * math.pi else 3)


def test_numbers_have_no_exponent_and_no_negative_zero() -> None:
    text = svg(program(), [SQUARE - 1e-9, SQUARE * 1e-7])
    coordinates = " ".join(
        item.attrib["d"] for item in ElementTree.fromstring(text).iter(f"{NAMESPACE}path")
    )
    assert not re.search(r"\de[-+]?\d", coordinates)
    assert not re.search(r"-0(?![.\d])", coordinates)
    assert "nan" not in coordinates


def test_unknown_positions_and_tools_are_left_out() -> None:
    text = svg(program(diameter=float("nan")))
    assert "nan" not in text
    assert "T3" in words(text)
    assert "cut to the floor" not in words(text)


def test_an_empty_program_is_a_picture_of_the_walls() -> None:
    assert "pocket wall" in words(svg(Program("empty", ()), [SQUARE]))
    ElementTree.fromstring(svg(Program("empty", ())))


def test_a_tall_part_stays_on_the_screen() -> None:
    root = ElementTree.fromstring(svg(Program("tall", ()), [SQUARE * [0.01, 10.0]]))
    assert float(root.attrib["height"]) < 1.5 * 1000


def test_axis_picture_shows_edges_vertices_and_disks() -> None:
    region = {
        "vertices": [
            {"x": 15.0, "y": 15.0, "r": 15.0, "kind": "branch"},
            {"x": 25.0, "y": 15.0, "r": 15.0, "kind": "branch"},
            {"x": 0.0, "y": 0.0, "r": 0.0, "kind": "corner"},
        ],
        "edges": [
            {
                "start": 0,
                "end": 1,
                "control_points": [[15.0, 15.0], [25.0, 15.0]],
                "radius": [15, 15],
            },
            {
                "start": 0,
                "end": 2,
                "control_points": [[15.0, 15.0], [7, 7], [0.0, 0.0]],
                "radius": [],
            },
        ],
    }
    text = axis_svg([SQUARE], [region])
    assert text == axis_svg([SQUARE], [region])
    circles = list(ElementTree.fromstring(text).iter(f"{NAMESPACE}circle"))
    # Three vertices, two disks, two swatches of the legend.
    assert len(circles) == 3 + 2 + 2
    assert {"branch", "corner", "3 vertices, 2 edges"} <= set(words(text))
    assert "end" not in words(text)


def test_axis_of_a_disk_is_a_point() -> None:
    region = {"vertices": [{"x": 20.0, "y": 15.0, "r": 15.0, "kind": "end"}], "edges": []}
    assert "largest disk there" in words(axis_svg([SQUARE], [region]))
