"""What the medial axis takes in and hands out: polygons, points, pictures, JSON, DXF, graphs."""

from __future__ import annotations

import builtins
import json
import pickle
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from shapely.geometry import LinearRing, LineString, MultiPolygon, Point, Polygon

import grassfire
import medial_shapes as shapes
from grassfire.cli import invoke
from grassfire.dxf import medial_axis_text
from grassfire.errors import GeometryError, InputError
from grassfire.geometry import Bezier, BSpline, EllipticalArc, Line, Loop, ParallelCurve, Region
from grassfire.geometry.chebyshev import bernstein, interpolate_to_bezier, nodes
from grassfire.medial import MedialAxis, medial_axis
from grassfire.medial.exchange import as_region
from grassfire.medial.polygons import Polygons, check_simple, depths

FloatArray = NDArray[np.float64]

OUTER = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)]
HOLE = [(8.0, 8.0), (20.0, 9.0), (15.0, 20.0)]
OTHER = [(26.0, 10.0), (34.0, 10.0), (34.0, 20.0), (26.0, 20.0)]
RING = [(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0)]

KINDS = (
    "ell",
    "islands-grid",
    "stadium",
    "annulus",
    "annulus-eccentric",
    "ellipse",
    "blob-islands",
    "letter-d",
    "circle",
    "star-9",
    "comma-at-1e6",
)


def spline_region() -> Region:
    """One closed rational B-spline, with an ellipse in it whose half-diameters are oblique."""
    angle = 2 * np.pi * np.arange(9) / 9
    points = shapes.polar(20 + 4 * np.cos(2 * angle), angle)
    control = np.concatenate([points, points[:3]])
    weights = 1 + 0.3 * np.cos(np.arange(9))
    weights = np.concatenate([weights, weights[:3]])
    spline = BSpline(3, np.arange(16.0), control, weights)
    island = EllipticalArc(np.array([1.0, -2.0]), np.array([5.0, 1.0]), np.array([1.0, -3.0]), 0.4)
    return Region(Loop((spline,)), (Loop((island,)),))


def offset_region() -> Region:
    """Bounded by what is parallel to a line and to an arc."""
    arc = shapes.stadium().outer.curves
    return Region(Loop(tuple(ParallelCurve(curve, 1.5) for curve in arc)))


@cache
def axis_of(name: str) -> MedialAxis:
    if name == "spline":
        return medial_axis(spline_region())
    return medial_axis(shapes.EVERY[name]())


def same_transform(one: MedialAxis, two: MedialAxis, slack: float = 1e-7) -> None:
    assert one.region.area == pytest.approx(two.region.area, rel=1e-12)
    assert len(one.region.islands) == len(two.region.islands)
    first = np.column_stack([one.vertex_point, one.vertex_radius])
    second = np.column_stack([two.vertex_point, two.vertex_radius])
    assert first.shape == second.shape
    away = np.linalg.norm(first[:, None] - second, axis=2)
    assert away.min(axis=0).max() <= slack
    assert away.min(axis=1).max() <= slack
    assert sorted(one.vertex_kind) == sorted(two.vertex_kind)


# -- in -------------------------------------------------------------------------------------------


def test_polygon_with_holes_is_the_region_of_its_rings() -> None:
    expected = medial_axis(shapes.polygon(OUTER, [HOLE, OTHER]))
    same_transform(medial_axis(Polygon(OUTER, [HOLE, OTHER])), expected)
    same_transform(medial_axis([OUTER, HOLE, OTHER]), expected)
    same_transform(medial_axis([np.array(OUTER), np.array(HOLE), np.array(OTHER)]), expected)


@given(
    order=st.permutations([OUTER, HOLE, OTHER]),
    flips=st.tuples(st.booleans(), st.booleans(), st.booleans()),
    turns=st.tuples(*[st.integers(0, 3)] * 3),
    closed=st.booleans(),
)
def test_order_direction_and_start_of_loops_do_not_matter(
    order: list[list[tuple[float, float]]],
    flips: tuple[bool, ...],
    turns: tuple[int, ...],
    closed: bool,
) -> None:
    loops = []
    for loop, flip, turn in zip(order, flips, turns, strict=True):
        points = loop[turn:] + loop[:turn]
        points = points[::-1] if flip else points
        loops.append(points + points[:1] if closed else points)
    region = as_region(loops)
    assert isinstance(region, Region)
    assert region.area == pytest.approx(1200 - 68.5 - 80, rel=1e-12)
    assert len(region.outer) == 4
    assert sorted(len(part) for part in region.islands) == [3, 4]
    assert region.outer.area > 0 > max(part.area for part in region.islands)


def test_one_array_is_one_loop_and_a_stack_is_several() -> None:
    assert as_region(np.array(OUTER)).area == 1200  # type: ignore[union-attr]
    assert as_region(OUTER).area == 1200  # type: ignore[union-attr]
    assert as_region(np.array([OUTER, OTHER])).area == 1120  # type: ignore[union-attr]
    assert as_region(iter([OUTER, HOLE])).area == 1131.5  # type: ignore[arg-type, union-attr]


def test_points_that_repeat_are_one() -> None:
    doubled = np.repeat(np.array([*OUTER, OUTER[0]]), 3, axis=0)
    region = as_region(doubled)
    assert isinstance(region, Region)
    assert len(region.outer) == 4
    assert region.area == 1200


def test_regions_and_loops_pass() -> None:
    region = shapes.stadium()
    assert as_region(region) is region
    given_loop = as_region(region.outer)
    assert isinstance(given_loop, Region)
    assert given_loop.area == pytest.approx(region.area)


def test_heights_of_polygons_are_dropped() -> None:
    region = as_region(Polygon([(x, y, 7.0) for x, y in OUTER]))
    assert isinstance(region, Region)
    assert region.area == 1200


def test_multipolygon_has_an_axis_for_each_polygon_in_its_order() -> None:
    far = [(x + 100, y) for x, y in RING]
    several = MultiPolygon([Polygon(far), Polygon(OUTER, [HOLE])])
    axes = medial_axis(several, tol=1e-7)
    assert isinstance(axes, tuple)
    same_transform(axes[0], medial_axis(far, 1e-7))
    same_transform(axes[1], medial_axis([OUTER, HOLE], 1e-7))
    assert [axis.tolerance for axis in axes] == [1e-7, 1e-7]
    assert len(medial_axis(MultiPolygon([Polygon(RING)]))) == 1


def test_polygons_need_no_shapely_of_ours() -> None:
    """A stand-in with the same attributes does; the package itself does not load Shapely."""
    script = (
        "import sys, grassfire\n"
        "class Ring: coords = [(0, 0), (4, 0), (4, 3), (0, 3), (0, 0)]\n"
        "class Shape: exterior, interiors = Ring(), ()\n"
        "axis = grassfire.medial_axis(Shape(), tol=1e-7)\n"
        "axis._repr_svg_(), axis.to_json()\n"
        "assert len(axis.edges) == 5\n"
        "print(sorted({'shapely', 'ezdxf', 'networkx', 'pydantic'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


def test_many_points_take_no_loop_over_them() -> None:
    angle = 2 * np.pi * np.arange(100_000) / 100_000
    points = shapes.polar(40 + 10 * np.cos(9 * angle), angle)
    calls = 0

    def count(_frame: object, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    region = as_region(points)
    sys.setprofile(None)
    assert calls < 10_000
    assert isinstance(region, Region)
    assert len(region.outer) == len(points)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (Point(1, 2), "a Point bounds no region"),
        (LineString([(0, 0), (1, 1)]), "a LineString bounds no region"),
        (shapely.GeometryCollection([Polygon(RING)]), "a GeometryCollection bounds no region"),
        (Polygon(), "an empty Polygon"),
        (MultiPolygon(), "an empty MultiPolygon"),
        (7.0, "float is no region"),
        ("polygon", "str is no region"),
        ([], r"must have shape \(n, 2\)"),
        (np.zeros((4, 3)), r"must have shape \(n, 2\)"),
        ([OUTER, [(1.0, 2.0, 3.0)]], r"must have shape \(n, 2\)"),
        ([OUTER, "hole"], r"must have shape \(n, 2\)"),
        (np.zeros((2, 3, 4, 2)), r"must have shape \(n, 2\)"),
    ],
)
def test_what_is_no_region_is_refused(source: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        medial_axis(source)


BOW = [(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 2.0)]


@pytest.mark.parametrize(
    ("loops", "message", "place"),
    [
        ([BOW], "crosses or touches itself", (1, 1)),
        ([[(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)]], "crosses or touches itself", (2, 0)),
        ([[(0, 0), (4, 0), (4, 4), (4, 8), (4, 3), (0, 4)]], "turns back on itself", (4, 8)),
        ([OUTER, [(-5, 5), (5, 5), (5, 9)]], "two loops of points cross or touch", (0, 5)),
        ([OUTER, [(0, 5), (5, 5), (5, 9)]], "two loops of points cross or touch", (0, 5)),
        ([OUTER, OTHER, OTHER], "two loops of points cross or touch", None),
        ([OUTER, HOLE, [(10, 9), (30, 9), (30, 25)]], "two loops of points cross or touch", None),
        ([OUTER, [(x + 100, y) for x, y in OUTER]], "more than one region", (100, 0)),
        ([OUTER, OTHER, [(28, 12), (30, 12), (30, 14)]], "more than one region", (28, 12)),
        ([[(0, 0), (1, 1), (0, 0)]], "at least three different points", (0, 0)),
        ([[(0, 0), (1, 1), (2, 2)]], "turns back on itself", (2, 2)),
        ([np.zeros((0, 2))], "at least three different points", None),
        ([[(0, 0), (1, np.nan), (2, 2)]], "point 1 of a loop is not finite", None),
        ([[(0, 0), (np.inf, 1), (2, 2)]], "point 1 of a loop is not finite", None),
    ],
)
def test_loops_that_bound_no_region_are_refused_with_the_place(
    loops: Any, message: str, place: tuple[float, float] | None
) -> None:
    with pytest.raises(GeometryError, match=message) as caught:
        medial_axis(loops)
    if place is not None:
        assert caught.value.place == pytest.approx(place)


def test_invalid_polygons_are_refused_with_the_place() -> None:
    with pytest.raises(GeometryError, match="crosses or touches itself") as caught:
        medial_axis(Polygon(BOW))
    assert caught.value.place == pytest.approx((1, 1))
    with pytest.raises(GeometryError, match="more than one region"):
        medial_axis(Polygon(RING, [OTHER]))


@settings(max_examples=300)
@given(
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=3, max_size=9),
)
def test_crossings_are_those_that_shapely_finds(points: list[tuple[int, int]]) -> None:
    corners = np.array([p for p, q in zip(points, points[1:] + points[:1], strict=True) if p != q])
    if len(corners) < 3:
        return
    simple = bool(LinearRing(corners).is_simple)
    try:
        check_simple(Polygons.join([corners.astype(float)]))
    except GeometryError as error:
        assert not simple
        ring = shapely.LinearRing(corners)
        assert ring.distance(Point(error.place)) <= 1e-9  # type: ignore[arg-type]
    else:
        assert simple


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_thin_teeth_and_spikes_are_simple_until_two_points_swap(turn: float) -> None:
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    comb = shapes.comb(200, 0.05, 20.0).outer
    corners = np.array([curve.start for curve in comb.curves]) @ rotation
    spikes = np.where(np.arange(900) % 2, 20.0, 2.0)
    star = shapes.polar(spikes, 2 * np.pi * np.arange(900) / 900) @ rotation
    for points in (corners, star):
        check_simple(Polygons.join([points]))
        for row in (3, len(points) // 2, len(points) - 8):
            swapped = points.copy()
            swapped[[row, row + 4]] = swapped[[row + 4, row]]
            with pytest.raises(GeometryError, match="crosses or touches itself"):
                check_simple(Polygons.join([swapped]))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_depths_are_those_that_shapely_counts(seed: int) -> None:
    """Squares cut from squares, at random: nested, apart, never touching."""
    draw = np.random.default_rng(seed)
    loops: list[FloatArray] = []

    def fill(low: FloatArray, size: float, level: int) -> None:
        loops.append(low + size * np.array([(0, 0), (1, 0), (1, 1), (0, 1)]))
        if level:
            for cell in draw.permutation(9)[: draw.integers(0, 5)]:
                step = np.array([cell % 3, cell // 3])
                fill(low + size * (0.05 + 0.3 * step + 0.02), 0.25 * size, level - 1)

    fill(np.zeros(2), 1.0, 3)
    order = draw.permutation(len(loops))
    given_loops = [np.roll(loops[k], draw.integers(4), axis=0) for k in order]
    polygons = [Polygon(loop) for loop in given_loops]
    expected = [
        sum(other is not own and other.contains(own) for other in polygons) for own in polygons
    ]
    joined = Polygons.join(given_loops)
    check_simple(joined)
    assert depths(joined).tolist() == expected


# -- picture --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_picture_is_small_well_formed_and_repeats(name: str) -> None:
    axis = axis_of(name)
    text = axis._repr_svg_()
    assert text == medial_axis(shapes.EVERY[name]())._repr_svg_()
    assert len(text) < 15_000
    root = ET.fromstring(text)
    space = "{http://www.w3.org/2000/svg}"
    _, _, width, height = (float(value) for value in root.attrib["viewBox"].split())
    xmin, ymin, xmax, ymax = axis.region.bounds()
    scale = (width - 240) / (xmax - xmin)
    assert scale * (ymax - ymin) == pytest.approx(height - 240, abs=1.5)
    disk = root.find(f"{space}circle")
    assert disk is not None
    centre, radius = axis.largest_disk()
    assert float(disk.attrib["r"]) == pytest.approx(scale * radius, abs=1.5)
    assert float(disk.attrib["cx"]) == pytest.approx(scale * (centre[0] - xmin) + 120, abs=1.5)
    assert float(disk.attrib["cy"]) == pytest.approx(scale * (ymax - centre[1]) + 120, abs=1.5)
    kinds = {title.text for title in root.iterfind(f"{space}path/{space}title")}
    assert kinds == set(axis.vertex_kind)


# -- JSON -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*KINDS, "spline"])
def test_json_comes_back_as_the_same_axis_and_the_same_bytes(name: str) -> None:
    axis = axis_of(name)
    text = axis.to_json()
    again = MedialAxis.from_json(text)
    assert again.to_json() == text
    assert again.to_dict() == axis.to_dict()
    assert again.certificate == axis.certificate
    for one, two in zip(again.region.curves, axis.region.curves, strict=True):
        assert type(one) is type(two)
        t = np.linspace(0, 1, 7)
        assert np.array_equal(one.point(t), two.point(t))


def test_json_holds_the_entry_of_the_command_line() -> None:
    axis = medial_axis(shapes.ell(), tol=1e-7, angular_tolerance=1e-3)
    document = json.loads(axis.to_json())
    assert (document["units"], document["tolerance"]) == ("mm", 1e-7)
    assert document["angular_tolerance"] == 1e-3
    (entry,) = document["regions"]
    assert {key: entry[key] for key in axis.to_dict()} == axis.to_dict()


def test_json_of_points_is_points() -> None:
    axis = medial_axis([OUTER, HOLE])
    (entry,) = json.loads(axis.to_json())["regions"]
    assert entry["boundary"][0] == {"points": [list(point) for point in OUTER]}
    assert MedialAxis.from_json(axis.to_json()).to_json() == axis.to_json()


def test_json_keeps_offset_curves() -> None:
    axis = medial_axis(offset_region())
    again = MedialAxis.from_json(axis.to_json())
    assert {type(curve) for curve in again.region.curves} == {ParallelCurve}
    assert again.to_json() == axis.to_json()


def bend_edge(entry: dict[str, Any]) -> None:
    entry["edges"][2]["control_points"][0][1] += 1e-3


def blow_disk(entry: dict[str, Any]) -> None:
    entry["vertices"][0]["r"] += 1e-5


def drop_edge(entry: dict[str, Any]) -> None:
    entry["edges"].pop()


def swap_kind(entry: dict[str, Any]) -> None:
    entry["vertices"][0]["kind"] = "branch"


def move_wall(entry: dict[str, Any]) -> None:
    entry["boundary"][0]["curves"][0]["end"][1] += 0.01
    entry["boundary"][0]["curves"][1]["start"][1] += 0.01


def claim_area(entry: dict[str, Any]) -> None:
    entry["area"] *= 1.01


def claim_error(entry: dict[str, Any]) -> None:
    entry["certificate"]["max_disk_error"] = 1.0


def claim_not_a_number(entry: dict[str, Any]) -> None:
    entry["vertices"][1]["x"] = float("nan")


def claim_text(entry: dict[str, Any]) -> None:
    entry["vertices"][1]["x"] = "0"


@pytest.mark.parametrize(
    "tamper",
    [
        bend_edge,
        blow_disk,
        drop_edge,
        swap_kind,
        move_wall,
        claim_area,
        claim_error,
        claim_not_a_number,
        claim_text,
    ],
)
def test_json_that_was_tampered_with_is_refused(tamper: Callable[[dict[str, Any]], None]) -> None:
    document = json.loads(axis_of("ell").to_json())
    tamper(document["regions"][0])
    with pytest.raises(GeometryError, match="not the one of its boundary"):
        MedialAxis.from_json(json.dumps(document))


def test_json_with_a_boundary_that_is_open_is_refused() -> None:
    document = json.loads(axis_of("ell").to_json())
    document["regions"][0]["boundary"][0]["curves"].pop()
    with pytest.raises(GeometryError, match="gap"):
        MedialAxis.from_json(json.dumps(document))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "no JSON"),
        ("[]", "no medial axis in the format"),
        ('{"format": "grassfire.medial-axis/0"}', "no medial axis in the format"),
        ('{"format": "grassfire.medial-axis/1"}', "not complete"),
        (
            '{"format": "grassfire.medial-axis/1", "regions": [7], "tolerance": 1, '
            '"angular_tolerance": 1}',
            "not complete",
        ),
    ],
)
def test_json_that_is_something_else_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        MedialAxis.from_json(text)


@pytest.mark.parametrize("key", ["boundary", "area", "vertices", "edges", "certificate", "holes"])
def test_json_with_a_part_missing_is_refused(key: str) -> None:
    document = json.loads(axis_of("ell").to_json())
    del document["regions"][0][key]
    with pytest.raises(InputError, match=f"not complete: '{key}'"):
        MedialAxis.from_json(json.dumps(document))


def test_json_with_an_unknown_curve_is_refused() -> None:
    document = json.loads(axis_of("ell").to_json())
    document["regions"][0]["boundary"][0]["curves"][0]["type"] = "spiral"
    with pytest.raises(InputError, match="not complete: 'spiral'"):
        MedialAxis.from_json(json.dumps(document))


# -- DXF ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*KINDS, "spline"])
def test_dxf_splines_are_the_edges(name: str, tmp_path: Path) -> None:
    axis = axis_of(name)
    path = tmp_path / "axis.dxf"
    grassfire.write_medial_axis(axis, path)
    document = ezdxf.readfile(path)
    assert document.units == ezdxf.units.MM
    assert not document.audit().errors
    assert not document.layers.get("MEDIAL_RADIUS").is_on()
    space = document.modelspace()
    flat = list(space.query('SPLINE[layer=="MEDIAL_AXIS"]'))
    high = list(space.query('SPLINE[layer=="MEDIAL_RADIUS"]'))
    assert len(flat) == len(high) == len(axis.edges)
    t = np.linspace(0.0, 1.0, 11)
    size = np.abs(axis.region.bounds()).max()
    for edge, plane, solid in zip(axis.edges, flat, high, strict=True):
        table = np.column_stack([edge.control_points, edge.radius])
        assert plane.dxf.degree == solid.dxf.degree == min(len(table) - 1, 10)
        if len(table) <= 11:
            assert np.array_equal(np.array(solid.control_points), table)
        expected = bernstein(len(table) - 1, t) @ table
        drawn = np.array([tuple(point) for point in plane.construction_tool().points(t)])
        assert np.abs(drawn[:, :2] - expected[:, :2]).max() <= 1e-12 * size
        assert np.all(drawn[:, 2] == 0)
        drawn = np.array([tuple(point) for point in solid.construction_tool().points(t)])
        assert np.abs(drawn - expected).max() <= 1e-12 * size
    points = [tuple(point.dxf.location) for point in space.query('POINT[layer=="MEDIAL_RADIUS"]')]
    expected = np.column_stack([axis.vertex_point, axis.vertex_radius])
    assert np.array_equal(np.array(points), expected)
    assert len(space.query('POINT[layer=="MEDIAL_AXIS"]')) == len(points)


@pytest.mark.parametrize("name", [*KINDS, "spline"])
def test_dxf_boundary_reads_back_as_the_region(name: str, tmp_path: Path) -> None:
    axis = axis_of(name)
    path = tmp_path / "axis.dxf"
    grassfire.write_medial_axis(axis, path)
    (region,) = grassfire.read_regions(path, layers=["BOUNDARY"]).regions
    size = float(np.abs(axis.region.bounds()).max())
    assert region.area == pytest.approx(axis.region.area, abs=1e-12 * size * size)
    assert region.perimeter == pytest.approx(axis.region.perimeter, rel=1e-9)
    assert len(region.islands) == len(axis.region.islands)
    assert np.allclose(region.bounds(), axis.region.bounds(), rtol=0, atol=1e-9 * size)


def test_dxf_repeats_byte_for_byte_and_takes_several_axes(tmp_path: Path) -> None:
    axes = [axis_of("ell"), axis_of("annulus")]
    assert medial_axis_text(axes) == medial_axis_text(tuple(axes))
    path = tmp_path / "axis.dxf"
    grassfire.write_medial_axis(axes, path)
    assert path.read_text() == medial_axis_text(axes)
    splines = ezdxf.readfile(path).modelspace().query('SPLINE[layer=="MEDIAL_AXIS"]')
    assert len(splines) == sum(len(axis.edges) for axis in axes)


def test_dxf_takes_offsets_of_lines_and_arcs(tmp_path: Path) -> None:
    axis = medial_axis(offset_region())
    grassfire.write_medial_axis(axis, tmp_path / "axis.dxf")
    (region,) = grassfire.read_regions(tmp_path / "axis.dxf", layers=["BOUNDARY"]).regions
    assert region.area == pytest.approx(axis.region.area, rel=1e-12)


@pytest.mark.parametrize("rational", [False, True])
def test_dxf_lowers_the_degree_of_curves_that_readers_refuse(
    rational: bool, tmp_path: Path
) -> None:
    """Boundary curves of degree 12."""

    weights = 1.0 + 0.02 * np.arange(13.0) if rational else None
    curves = [
        Bezier(interpolate_to_bezier(curve.point(nodes(12))), weights)
        for curve in shapes.blob(1).curves
    ]
    axis = medial_axis(Region(Loop(tuple(curves))))
    grassfire.write_medial_axis(axis, tmp_path / "axis.dxf")
    drawing = ezdxf.readfile(tmp_path / "axis.dxf")
    assert max(spline.dxf.degree for spline in drawing.modelspace().query("SPLINE")) == 10
    (region,) = grassfire.read_regions(tmp_path / "axis.dxf", layers=["BOUNDARY"]).regions
    assert region.area == pytest.approx(axis.region.area, rel=1e-12)


def test_dxf_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "axis.dxf"
    path.write_text("before")
    write = Path.write_text

    def interrupted(self: Path, data: str, *args: Any, **options: Any) -> int:
        write(self, data[:100])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", interrupted)
    with pytest.raises(InputError, match="cannot be written: No space left"):
        grassfire.write_medial_axis(axis_of("ell"), path)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_dxf_into_a_folder_that_is_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        grassfire.write_medial_axis(axis_of("ell"), tmp_path / "nowhere" / "axis.dxf")


def test_command_line_writes_the_drawing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = tmp_path / "in.dxf", tmp_path / "out.dxf"
    grassfire.write_medial_axis(axis_of("letter-d"), source)
    arguments = ["mat", str(source), "--layer", "BOUNDARY", "--tol", "1e-7"]
    files = [f"{option}={tmp_path / name}" for option, name in (("--json", "a"), ("--svg", "b"))]
    assert invoke([*arguments, *files, "--dxf", str(out)]) == 0
    (entry,) = json.loads((tmp_path / "a").read_text())["regions"]
    splines = ezdxf.readfile(out).modelspace().query('SPLINE[layer=="MEDIAL_AXIS"]')
    assert len(splines) == len(entry["edges"])
    capsys.readouterr()
    assert invoke([*arguments, "--dxf", "-"]) == 0
    assert capsys.readouterr().out == out.read_text()


# -- graphs and pickles ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", KINDS)
def test_networkx_graph_is_the_axis(name: str) -> None:
    networkx = pytest.importorskip("networkx")
    axis = axis_of(name)
    graph = axis.to_networkx()
    assert isinstance(graph, networkx.MultiGraph)
    assert graph.number_of_nodes() == len(axis.vertex_radius)
    assert graph.number_of_edges() == len(axis.edges)
    assert networkx.is_connected(graph)
    independent = graph.number_of_edges() - graph.number_of_nodes() + 1
    assert independent == len(axis.region.islands)
    for _, _, key, data in graph.edges(keys=True, data=True):
        edge = axis.edges[key]
        assert (data["start"], data["end"]) == (edge.start, edge.end)
        chord = np.hypot(*(edge.control_points[-1] - edge.control_points[0]))
        polygon = np.hypot(*np.diff(edge.control_points, axis=0).T).sum()
        assert chord * (1 - 1e-9) <= data["length"] <= polygon * (1 + 1e-9)
        assert np.array_equal(data["radius"], edge.radius)
        for node, end in ((edge.start, 0), (edge.end, -1)):
            place = (graph.nodes[node]["x"], graph.nodes[node]["y"], graph.nodes[node]["r"])
            here = (*edge.control_points[end], edge.radius[end])
            assert place == pytest.approx(here, abs=1e-9 * np.abs(axis.region.bounds()).max())
    assert [data["kind"] for _, data in graph.nodes(data=True)] == axis.vertex_kind


def test_graph_without_networkx_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = builtins.__import__

    def missing(name: str, *args: Any, **options: Any) -> Any:
        if name == "networkx":
            raise ImportError(name)
        return plain(name, *args, **options)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match="needs networkx; pip install networkx"):
        axis_of("ell").to_networkx()


@pytest.mark.parametrize("name", [*KINDS, "spline"])
def test_pickles_come_back_equal(name: str) -> None:
    axis = axis_of(name)
    axis.largest_disk()
    text = pickle.dumps(axis)
    again = pickle.loads(text)
    assert json.dumps(again.to_dict()) == json.dumps(axis.to_dict())
    assert again.to_json() == axis.to_json()
    points = np.concatenate([axis.vertex_point, axis.region.boundary_point([0.3])])
    assert np.array_equal(again.clearance(points), axis.clearance(points))
    radius = 0.4 * axis.largest_disk()[1]
    one, two = axis.offset_tree([radius]), again.offset_tree([radius])
    assert [node.area for node in one] == [node.area for node in two]


def test_pickles_hold_no_derived_tables() -> None:
    axis = medial_axis(shapes.hand())
    fresh = len(pickle.dumps(axis))
    axis._repr_svg_()
    axis.narrowest_neck()
    axis.offset_tree(np.array([0.5]))
    assert len(pickle.dumps(axis)) <= 1.2 * fresh


def test_lines_of_points_are_lines() -> None:
    axis = medial_axis(OUTER)
    assert all(isinstance(curve, Line) for curve in axis.region.curves)
