"""The gallery: counts, closed forms and errors of its examples; its figures and its page."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from grassfire.errors import GeometryError
from grassfire.geometry import Arc
from grassfire.geometry.chebyshev import evaluate_bezier
from grassfire.medial import MedialAxis, medial_axis

GALLERY = Path(__file__).resolve().parents[1] / "docs" / "gallery"
sys.path.append(str(GALLERY))
degrees = importlib.import_module("paper_degrees")
drawing = importlib.import_module("paper_drawing")
gallery = importlib.import_module("paper_measure")
paper = importlib.import_module("paper")
shapes = importlib.import_module("paper_shapes")
tables = importlib.import_module("paper_tables")

FloatArray = NDArray[np.float64]
EXAMPLES = {example.name: example for example in gallery.EXAMPLES}


@cache
def measured(name: str) -> Any:
    return gallery.measure(EXAMPLES[name])


def disks_of(axis: MedialAxis) -> FloatArray:
    """(n, 3) disks along all edges."""
    fraction = np.linspace(0, 1, 33)
    tables = [np.column_stack([edge.control_points, edge.radius]) for edge in axis.edges]
    return np.concatenate([evaluate_bezier(table, fraction) for table in tables])


def terminals(axis: MedialAxis) -> FloatArray:
    kinds = np.array(axis.vertex_kind)
    return np.asarray(axis.vertex_point[(kinds == "end") | (kinds == "corner")])


# -- counts and errors of every example -----------------------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_counts(name: str) -> None:
    found, example = measured(name), EXAMPLES[name]
    assert (found.ends, found.corners, found.branches) == (
        example.ends,
        example.corners,
        example.branches,
    )
    assert found.edges == example.edges
    assert found.non_generic == 0


@pytest.mark.parametrize("name", EXAMPLES)
def test_graph_is_that_of_a_region(name: str) -> None:
    axis = measured(name).axis
    holes = len(axis.region.islands)
    assert len(axis.vertex_radius) - len(axis.edges) == 1 - holes
    # With three edges at each branch point, counting the ends of edges gives the branches.
    example = EXAMPLES[name]
    assert example.branches == example.ends + example.corners - 2 + 2 * holes


@pytest.mark.parametrize("name", EXAMPLES)
def test_curvature_finds_the_same_ends(name: str) -> None:
    found = measured(name)
    assert gallery.curvature_ends(found.axis.region, found.axis)[0] == found.ends


@pytest.mark.parametrize("name", EXAMPLES)
def test_errors_of_equations_8_and_9(name: str) -> None:
    found = measured(name)
    # In corners r goes to 0, and the share of r with it; all other radii are 1 mm and more.
    assert found.interpolation_error < (1e-4 if found.corners else 3e-7)
    assert found.boundary_error < 2 * gallery.TOLERANCE
    assert found.recovery_error < 2 * gallery.TOLERANCE


# -- closed forms ---------------------------------------------------------------------------------


def test_ellipse_is_exact() -> None:
    major, minor = 30.0, 18.0
    focal = major**2 - minor**2
    axis = medial_axis(shapes.ellipse(major, minor), 1e-10)
    x, y, r = disks_of(axis).T
    assert np.abs(y).max() <= 1e-10
    assert np.abs(r - minor * np.sqrt(1 - x**2 / focal)).max() <= 1e-10
    assert sorted(terminals(axis)[:, 0]) == pytest.approx(
        [-focal / major, focal / major], abs=1e-10
    )


def test_arcs_of_contact_and_parallel_sides_are_exact() -> None:
    half, straight, radius = 10.0, 30.0, 40.0
    region = shapes.arc_ended(half, straight, radius)
    found = measured("fig09-arcs")
    assert found.degrees == (1, 2)
    assert found.interpolation_error < 1e-14 and found.boundary_error < 1e-13
    x, y, r = disks_of(found.axis).T
    sag = np.maximum(x - straight, 0) ** 2 / (4 * (radius - half))
    assert np.abs(y - (half - sag)).max() < 1e-13
    assert np.abs(r - y).max() < 1e-13
    # The axis ends in the centres of the arcs of contact, with their radii.
    arcs = [region.curves[index] for index in (1, 4)]
    assert all(isinstance(arc, Arc) for arc in arcs)
    order = np.argsort(terminals(found.axis)[:, 0])[::-1]
    for arc, centre in zip(arcs, terminals(found.axis)[order], strict=True):
        assert centre == pytest.approx(arc.centre, abs=1e-12)
        assert found.axis.clearance(centre[None])[0] == pytest.approx(arc.radius, abs=1e-12)
    assert len(drawing.contact_arcs(region, found.axis, 0.1)) == 2


def test_drop_is_exact() -> None:
    radius, reach = 14.0, 50.0
    found = measured("fig11a-drop")
    x, y, r = disks_of(found.axis).T
    assert found.degrees == (1,)
    assert np.abs(y).max() < 1e-13
    assert np.abs(r - (reach - x) * radius / reach).max() < 1e-13
    assert (x.min(), x.max()) == pytest.approx((0.0, reach), abs=1e-12)


# -- equation (6) at a given degree ---------------------------------------------------------------


@pytest.mark.parametrize("name", ["fig07-ellipse", "fig08-bean", "fig10-corners", "fig11b-pod"])
def test_self_intersections_are_maximal_disks(name: str) -> None:
    axis = measured(name).axis
    first, last = terminals(axis)
    side = degrees.whole_edge(axis.region.outer, first, last)
    u = np.linspace(side.start, side.end, 60)
    disks, facing = degrees.self_intersections(side, u)
    assert np.abs(axis.clearance(disks[:, :2]) - disks[:, 2]).max() < 1e-9
    assert np.all(np.diff(facing) < 0)
    ends = disks[[0, -1], :2]
    assert min(np.abs(ends - [first, last]).max(), np.abs(ends - [last, first]).max()) < 1e-9


def test_pieces_cut_at_knots_converge_faster() -> None:
    axis = measured("fig08-bean").axis
    side = degrees.whole_edge(axis.region.outer, *terminals(axis))
    tried = (4, 6, 12)
    whole = [one.interpolation_error for one in degrees.fit_degrees(side, tried)]
    pieces = degrees.fit_degrees(side, tried, degrees.knot_breaks(side))
    cut = [one.interpolation_error for one in pieces]
    assert whole[0] > whole[1] > whole[2] > 1e-3
    assert cut[0] > 4 * cut[1] > 1000 * cut[2]
    assert cut[2] < 1e-6


def test_ellipse_of_one_polynomial() -> None:
    axis = measured("fig07-ellipse").axis
    side = degrees.whole_edge(axis.region.outer, *terminals(axis))
    for one, limit in zip(degrees.fit_degrees(side, (2, 5)), (0.2, 5e-3), strict=True):
        assert np.abs(one.coefficients[0][:, 1]).max() < 1e-10  # the axis itself is exact
        assert 1e-4 < one.interpolation_error < 0.1
        away = np.abs(np.hypot(*(one.recovered / (30.0, 18.0)).transpose(2, 0, 1)) - 1)
        assert away.max() < limit


def test_wrong_sides_are_errors() -> None:
    loop, u = shapes.bean().outer, np.array([0.05])
    with pytest.raises(GeometryError, match="nothing on the other side"):
        degrees.self_intersections(degrees.Side(loop, 0.0, 0.1, 0.15, 0.12), u)


# -- figures, page and command line ---------------------------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_figure(name: str) -> None:
    found = measured(name)
    panel = drawing.region_panel(found.axis.region, found.axis)
    text = drawing.document([panel])
    assert text == drawing.document([drawing.region_panel(found.axis.region, found.axis)])
    assert len(text) < 60_000
    root = ElementTree.fromstring(text)
    classes = [element.get("class") for element in root.iter()]
    for kind, count in (("end", found.ends), ("corner", found.corners), ("branch", found.branches)):
        assert classes.count(kind) == count + (count > 0)  # and one in the legend
    assert "NaN" not in text and "nan" not in text


def test_numbers_of_the_paper_add_up() -> None:
    for row in tables.TABLE_1:
        assert row.total == pytest.approx(row.ends + row.edge, abs=1e-9)
    for row in tables.TABLE_2:
        assert row.total == pytest.approx(row.vertices + row.edges, abs=1e-9)


def test_page_names_every_example() -> None:
    one = measured("fig07-ellipse")
    every = [replace(one, example=example) for example in gallery.EXAMPLES]
    text = tables.page(every, [None, *every[1:]], [paper.degrees_of(one)], 1)
    for example in gallery.EXAMPLES:
        assert f"({example.name}.svg)" in text
        assert f"| {example.figure}: {example.title} |" in text
    assert text.count("not certified") == 1
    assert "35.41" in text


def test_command_line_writes_one_figure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paper.main(["--out", str(tmp_path), "--only", "fig09-arcs", "--repeat", "1"])
    assert [path.name for path in tmp_path.iterdir()] == ["fig09-arcs.svg"]
    assert "fig09-arcs.svg" in capsys.readouterr().out


def test_degree_figure() -> None:
    one = measured("fig07-ellipse")
    root = ElementTree.fromstring(paper.degree_figure(one, paper.degrees_of(one)))
    assert [element.get("class") for element in root.iter()].count("recovered") == 3


def test_wrong_count_is_an_error() -> None:
    example = replace(EXAMPLES["fig09-arcs"], ends=3)
    with pytest.raises(GeometryError, match="fig09-arcs: ends, corners"):
        paper.checked(example, 1e-6, 1)


def test_figures_in_the_repository_are_complete_and_small() -> None:
    page = (GALLERY / "README.md").read_text(encoding="utf-8")
    figures = sorted(path.name for path in GALLERY.glob("*.svg"))
    assert set(figures) == {name.split(")")[0] for name in page.split("](")[1:] if ".svg" in name}
    assert sum((GALLERY / name).stat().st_size for name in figures) < 1_000_000
