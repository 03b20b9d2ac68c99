"""Drawings to regions: every entity kind exact, every repair found, every refusal clear."""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from grassfire.dxf import Drawing, read_regions
from grassfire.dxf.reading import raw_insunits
from grassfire.errors import GrassfireError, InputError
from grassfire.geometry import Arc, BSpline, EllipticalArc, Line, Region
from grassfire.report import Severity

ezdxf = pytest.importorskip("ezdxf")

Draw = Callable[[Any], None]
SHARED = Path(__file__).resolve().parents[2] / "shared" / "dxf"


def read(
    folder: Path,
    draw: Draw,
    *,
    insunits: int = 4,
    version: str = "R2010",
    binary: bool = False,
    **options: Any,
) -> Drawing:
    """Write a drawing with ezdxf and read it."""
    document = ezdxf.new(version)
    document.header["$INSUNITS"] = insunits
    draw(document)
    path = folder / "drawing.dxf"
    document.saveas(path, fmt="bin" if binary else "asc")
    return read_regions(path, **options)


def model(action: Draw) -> Draw:
    """Adapt an action on the model space to one on the document."""
    return lambda document: action(document.modelspace())


def square(space: Any, low: float, high: float, **attributes: Any) -> None:
    corners = [(low, low), (high, low), (high, high), (low, high)]
    space.add_lwpolyline(corners, close=True, dxfattribs=attributes)


def lines(space: Any, points: Sequence[tuple[float, float]], **attributes: Any) -> None:
    for start, end in itertools.pairwise(points):
        space.add_line(start, end, dxfattribs=attributes)


def codes(drawing: Drawing) -> set[str]:
    return {finding.code for finding in drawing.findings}


def only(drawing: Drawing) -> Region:
    assert len(drawing.regions) == 1
    return drawing.regions[0]


def kinds(region: Region) -> list[str]:
    return sorted(type(curve).__name__ for loop in region.loops for curve in loop.curves)


# Entities ------------------------------------------------------------------------------------


def test_lines_and_arc_in_any_order_and_direction(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_line((0, 0), (10, 0))
        space.add_line((0, 6), (10, 6))
        space.add_arc((10, 3), 3, -90, 90)
        space.add_line((0, 6), (0, 0))

    drawing = read(tmp_path, model(draw))
    region = only(drawing)
    assert kinds(region) == ["Arc", "Line", "Line", "Line"]
    assert region.area == pytest.approx(60 + 4.5 * math.pi, abs=1e-9)
    assert drawing.findings == ()
    assert (drawing.units, drawing.units_source) == ("mm", "header")


def test_circle_and_full_arc_stay_arcs(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_circle((0, 0), 2)
        space.add_arc((10, 0), 2, 30, 390)

    drawing = read(tmp_path, model(draw))
    assert [kinds(region) for region in drawing.regions] == [["Arc"], ["Arc"]]
    for region in drawing.regions:
        assert region.area == pytest.approx(4 * math.pi, rel=1e-12)


def test_ellipse_and_half_ellipse(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_ellipse((0, 0), (4, 3), 0.5)
        space.add_ellipse((20, 0), (5, 0), 0.4, 0, math.pi)
        space.add_line((15, 0), (25, 0))

    drawing = read(tmp_path, model(draw))
    areas = sorted(region.area for region in drawing.regions)
    assert areas == pytest.approx([5 * math.pi, 12.5 * math.pi], rel=1e-9)
    assert "EllipticalArc" in kinds(drawing.regions[0])


def test_circular_ellipse_is_an_arc(tmp_path: Path) -> None:
    drawing = read(tmp_path, model(lambda space: space.add_ellipse((1, 1), (0, 3), 1.0)))
    assert kinds(only(drawing)) == ["Arc"]


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_polyline_bulges(tmp_path: Path, old: bool, side: float) -> None:
    rows = [(0, 0, 0), (10, 0, side), (10, 4, 0), (0, 4, 0)]

    def draw(space: Any) -> None:
        add = space.add_polyline2d if old else space.add_lwpolyline
        add(rows, format="xyb", close=True)

    region = only(read(tmp_path, model(draw)))
    assert kinds(region) == ["Arc", "Line", "Line", "Line"]
    assert region.area == pytest.approx(40 + side * 2 * math.pi, abs=1e-9)


def test_polyline_width_is_ignored_with_a_finding(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        polyline = space.add_lwpolyline([(0, 0), (5, 0), (5, 5)], close=True)
        polyline.dxf.const_width = 0.5

    drawing = read(tmp_path, model(draw))
    assert "polyline-width" in codes(drawing)
    assert only(drawing).area == pytest.approx(12.5)


def test_flat_three_dimensional_polyline(tmp_path: Path) -> None:
    points = [(0, 0, 7), (10, 0, 7), (10, 10, 7), (0, 10, 7)]
    drawing = read(tmp_path, model(lambda space: space.add_polyline3d(points, close=True)))
    assert only(drawing).area == pytest.approx(100)
    assert "projected" in codes(drawing)


def test_repeated_vertices_are_dropped_with_their_bulge(tmp_path: Path) -> None:
    rows = [(0, 0, 0), (10, 0, 0.7), (10, 0, 0), (10, 10, 0), (0, 10, 0), (0, 0, 0)]
    drawing = read(
        tmp_path, model(lambda space: space.add_lwpolyline(rows, format="xyb", close=True))
    )
    assert kinds(only(drawing)) == ["Line"] * 4
    (finding,) = [item for item in drawing.findings if item.code == "repeated-vertex"]
    assert finding.size == 2
    assert finding.severity is Severity.REPAIR


def test_clamped_spline_keeps_its_control_points(tmp_path: Path) -> None:
    control = [(0, 0), (10, -4), (14, 8), (5, 12), (-6, 9), (0, 0)]
    drawing = read(tmp_path, model(lambda space: space.add_open_spline(control)))
    (curve,) = only(drawing).outer.curves
    assert isinstance(curve, BSpline)
    assert sorted(map(tuple, np.round(curve.control_points, 12).tolist())) == sorted(
        (float(x), float(y)) for x, y in control
    )


def test_rational_spline_is_recognised_as_circle_arc(tmp_path: Path) -> None:
    half = math.sqrt(0.5)

    def draw(space: Any) -> None:
        spline = space.add_spline(degree=2)
        spline.control_points = [(5, 0, 0), (5, 5, 0), (0, 5, 0)]
        spline.knots = [0, 0, 0, 1, 1, 1]
        spline.weights = [1, half, 1]
        lines(space, [(0, 5), (0, 0), (5, 0)])

    region = only(read(tmp_path, model(draw)))
    assert kinds(region) == ["Arc", "Line", "Line"]
    assert region.area == pytest.approx(25 * math.pi / 4, abs=1e-8)


def test_unclamped_periodic_spline(tmp_path: Path) -> None:
    angles = np.arange(8) * math.pi / 4
    control = [(10 * math.cos(a), 6 * math.sin(a), 0) for a in angles]

    def draw(space: Any) -> None:
        spline = space.add_spline(degree=3)
        spline.control_points = control + control[:3]
        spline.knots = list(range(15))
        spline.closed = True

    drawing = read(tmp_path, model(draw))
    (curve,) = only(drawing).outer.curves
    expected = ezdxf.math.BSpline(
        [ezdxf.math.Vec3(p) for p in control + control[:3]], 4, list(range(15))
    )
    start = expected.point(3.0)
    ends = np.array([curve.start, curve.end])
    assert np.allclose(ends, [[start.x, start.y]] * 2, atol=1e-9)


def test_spline_corner_becomes_a_junction(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        spline = space.add_spline(degree=2)
        spline.control_points = [(0, 0, 0), (8, -3, 0), (10, 5, 0), (4, 9, 0), (0, 0, 0)]
        spline.knots = [0, 0, 0, 1, 1, 2, 2, 2]

    curves = only(read(tmp_path, model(draw))).outer.curves
    joints = {tuple(np.round(curve.start, 9)) for curve in curves}
    assert joints == {(0.0, 0.0), (10.0, 5.0)}


def test_fit_points_open_and_closed(tmp_path: Path) -> None:
    fit = [(0, 0), (10, 2), (12, 9), (3, 12), (-4, 6)]

    def draw(space: Any) -> None:
        closed = space.add_spline(fit)
        closed.closed = True
        space.add_spline([(x + 40, y) for x, y in fit])
        space.add_line((40, 0), (36, 6))

    drawing = read(tmp_path, model(draw))
    assert len(drawing.regions) == 2
    assert "fit-points" in codes(drawing)
    for region, shift in zip(drawing.regions, (0.0, 40.0), strict=True):
        t = np.linspace(0, 1, 4001)
        samples = np.concatenate([curve.point(t) for curve in region.outer.curves])
        gaps = np.hypot(
            *(samples[:, None] - (np.array(fit) + np.array([shift, 0.0]))).transpose(2, 0, 1)
        )
        assert float(gaps.min(axis=0).max()) < 0.02


@pytest.mark.parametrize(
    ("control", "knots"),
    [
        ([(0, 0, 0), (1, 1, 0), (2, 0, 0), (3, 0, 0)], [0, 0, 0, 0, 1]),
        ([(0, 0, 0), (1, 1, 0), (2, 0, 0), (3, 0, 0)], [0, 0, 0, 2, 1, 1, 1, 1]),
    ],
)
def test_inconsistent_spline_is_ignored_with_a_finding(
    tmp_path: Path, control: list[tuple[float, float, float]], knots: list[float]
) -> None:
    from grassfire.dxf.splines import spline_curves

    with pytest.raises(ValueError, match="knots"):
        spline_curves(
            3,
            np.array(knots, dtype=float),
            np.array(control, dtype=float)[:, :2],
            np.empty(0),
            np.empty((0, 2)),
            None,
            declared_closed=False,
            angular_tolerance=1e-4,
        )


def test_annotation_is_ignored_one_finding_per_type(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_circle((0, 0), 5)
        space.add_text("a")
        space.add_text("b")
        space.add_point((1, 1))
        hatch = space.add_hatch()
        hatch.paths.add_polyline_path([(0, 0), (1, 0), (1, 1)])
        space.add_3dface([(0, 0), (1, 0), (1, 1), (0, 1)])

    drawing = read(tmp_path, model(draw))
    only(drawing)
    ignored = {f.message.split()[1]: f.size for f in drawing.findings if f.code == "ignored-type"}
    assert ignored == {"TEXT": 2, "POINT": 1, "HATCH": 1, "3DFACE": 1}


def test_zero_length_curves_and_radii_are_dropped(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        square(space, 0, 10)
        space.add_line((3, 3), (3, 3))
        space.add_circle((5, 5), 0)

    drawing = read(tmp_path, model(draw))
    only(drawing)
    assert [item.code for item in drawing.findings].count("zero-length") == 2


def test_tilted_curves_are_ignored_level_ones_projected(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_circle((0, 0, 3), 5)
        space.add_line((20, 0, 0), (30, 0, 5))
        space.add_circle((50, 0), 5, dxfattribs={"extrusion": (0, 1, 1)})

    drawing = read(tmp_path, model(draw))
    only(drawing)
    assert [item.code for item in drawing.findings].count("tilted") == 2
    assert [item.size for item in drawing.findings if item.code == "projected"] == [3.0]


# Placement -----------------------------------------------------------------------------------


def test_negative_extrusion_mirrors(tmp_path: Path) -> None:
    down = {"extrusion": (0, 0, -1)}

    def draw(space: Any) -> None:
        space.add_lwpolyline([(10, 0), (14, 0), (14, 3)], close=True, dxfattribs=down)
        space.add_arc((30, 0), 2, 0, 180, dxfattribs=down)
        space.add_line((-32, 0), (-28, 0))

    drawing = read(tmp_path, model(draw))
    triangle, half = (
        drawing.regions if drawing.regions[0].outer.length > 11 else (drawing.regions[::-1])
    )
    assert triangle.bounds() == pytest.approx((-14, 0, -10, 3))
    assert half.bounds() == pytest.approx((-32, 0, -28, 2))


def block_drawing(**insert: Any) -> Draw:
    def draw(document: Any) -> None:
        block = document.blocks.new("PART", base_point=(1, 1))
        block.add_circle((3, 1), 1)
        document.modelspace().add_blockref("PART", (10, 20), dxfattribs=insert)

    return draw


def test_insert_base_point_rotation_and_scale(tmp_path: Path) -> None:
    drawing = read(tmp_path, block_drawing(xscale=2, yscale=2, rotation=90))
    assert only(drawing).bounds() == pytest.approx((8, 22, 12, 26))
    assert kinds(only(drawing)) == ["Arc"]


def test_insert_with_unequal_scale_makes_ellipses(tmp_path: Path) -> None:
    drawing = read(tmp_path, block_drawing(xscale=3, yscale=1))
    (curve,) = only(drawing).outer.curves
    assert isinstance(curve, EllipticalArc)
    assert only(drawing).bounds() == pytest.approx((13, 19, 19, 21))


def test_mirrored_insert(tmp_path: Path) -> None:
    drawing = read(tmp_path, block_drawing(xscale=-1))
    assert only(drawing).bounds() == pytest.approx((7, 19, 9, 21))
    assert only(drawing).area == pytest.approx(math.pi)


def test_insert_array_and_zero_z_scale(tmp_path: Path) -> None:
    drawing = read(
        tmp_path,
        block_drawing(
            row_count=2, column_count=3, row_spacing=5, column_spacing=4, rotation=90, zscale=0
        ),
    )
    assert len(drawing.regions) == 6
    boxes = np.array([region.bounds() for region in drawing.regions])
    assert boxes[:, 0].min() == pytest.approx(4)
    assert boxes[:, 3].max() == pytest.approx(31)


def test_nested_inserts_compose(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        inner = document.blocks.new("INNER")
        inner.add_circle((1, 0), 0.5)
        outer = document.blocks.new("OUTER")
        outer.add_blockref("INNER", (2, 0), dxfattribs={"rotation": 90})
        document.modelspace().add_blockref("OUTER", (0, 0), dxfattribs={"xscale": 2, "yscale": 2})

    assert only(read(tmp_path, draw)).bounds() == pytest.approx((3, 1, 5, 3))


def test_layer_zero_in_a_block_is_the_layer_of_the_reference(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        block = document.blocks.new("PART")
        block.add_circle((0, 0), 1)
        block.add_circle((5, 0), 1, dxfattribs={"layer": "FIXED"})
        space = document.modelspace()
        space.add_blockref("PART", (0, 0), dxfattribs={"layer": "POCKET"})

    drawing = read(tmp_path, draw, layers=["pock*"])
    assert drawing.region_layers == (("POCKET",),)
    assert len(read(tmp_path, draw).regions) == 2


def test_missing_block_and_flat_insert_are_findings(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        document.blocks.new("PART").add_circle((0, 0), 1)
        space = document.modelspace()
        space.add_circle((0, 0), 1)
        space.add_blockref("NOWHERE", (0, 0))
        space.add_blockref("PART", (0, 0), dxfattribs={"xscale": 0})

    found = codes(read(tmp_path, draw))
    # A reading library may take a scale of 0 for 1: then the circle shows as a duplicate.
    assert "missing-block" in found
    assert found & {"degenerate-insert", "duplicate-contour"}


@given(
    angle=st.floats(-360, 360),
    scale=st.floats(0.1, 20),
    shift=st.tuples(st.floats(-100, 100), st.floats(-100, 100)),
    mirror=st.booleans(),
)
@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_area_scales_with_the_square_under_any_placement(
    tmp_path: Path, angle: float, scale: float, shift: tuple[float, float], mirror: bool
) -> None:
    def draw(document: Any) -> None:
        block = document.blocks.new("PART")
        block.add_lwpolyline([(0, 0, 0), (6, 0, 0.5), (6, 4, 0), (0, 4, -0.2)], "xyb", close=True)
        block.add_circle((3, 2), 1)
        document.modelspace().add_blockref(
            "PART",
            shift,
            dxfattribs={
                "xscale": -scale if mirror else scale,
                "yscale": scale,
                "rotation": angle,
            },
        )

    region = only(read(tmp_path, draw))
    plain = only(read(tmp_path, lambda document: (draw(document), reset_insert(document))[0]))
    assert region.area == pytest.approx(plain.area * scale**2, rel=1e-9)
    assert len(region.islands) == 1


def reset_insert(document: Any) -> None:
    (insert,) = document.modelspace().query("INSERT")
    insert.dxf.xscale = insert.dxf.yscale = 1
    insert.dxf.rotation = 0


# Layers and units ----------------------------------------------------------------------------


def test_layers_by_glob_and_the_nearest_names(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        for name in ("POCKET_1", "POCKET_2", "OUTLINE"):
            document.layers.add(name)
        space = document.modelspace()
        space.add_circle((0, 0), 1, dxfattribs={"layer": "POCKET_1"})
        space.add_circle((5, 0), 1, dxfattribs={"layer": "POCKET_2"})
        square(space, -50, 50, layer="OUTLINE")

    drawing = read(tmp_path, draw, layers=["pocket_*"])
    assert drawing.layers == ("POCKET_1", "POCKET_2")
    assert drawing.region_layers == (("POCKET_1",), ("POCKET_2",))
    assert "other-layers" in codes(drawing)
    with pytest.raises(InputError, match=r"no layer matches 'POKET_1'.*'POCKET_1'"):
        read(tmp_path, draw, layers=["POKET_1"])


def test_off_and_frozen_layers_are_ignored_with_findings(tmp_path: Path) -> None:
    def draw(document: Any) -> None:
        document.layers.add("OFF").off()
        document.layers.add("ICE").freeze()
        space = document.modelspace()
        space.add_circle((0, 0), 1)
        space.add_circle((5, 0), 1, dxfattribs={"layer": "OFF"})
        space.add_circle((9, 0), 1, dxfattribs={"layer": "ICE"})
        space.add_circle((13, 0), 1, dxfattribs={"invisible": 1})

    drawing = read(tmp_path, draw)
    only(drawing)
    assert [item.size for item in drawing.findings if item.code == "hidden"] == [1, 1, 1]


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize(
    ("code", "name", "length"), [(1, "in", 25.4), (4, "mm", 1.0), (5, "cm", 10.0), (6, "m", 1000.0)]
)
def test_units_from_the_header(
    tmp_path: Path, code: int, name: str, length: float, binary: bool
) -> None:
    drawing = read(tmp_path, model(lambda space: square(space, 0, 2)), insunits=code, binary=binary)
    assert (drawing.units, drawing.units_source) == (name, "header")
    assert only(drawing).area == pytest.approx(4 * length**2)


def test_unitless_needs_units_and_the_argument_goes_first(tmp_path: Path) -> None:
    draw = model(lambda space: square(space, 0, 2))
    with pytest.raises(InputError, match=r"unitless.*give units"):
        read(tmp_path, draw, insunits=0)
    drawing = read(tmp_path, draw, insunits=0, units="in")
    assert (drawing.units, drawing.units_source) == ("in", "argument")
    assert only(drawing).area == pytest.approx(4 * 25.4**2)
    overridden = read(tmp_path, draw, insunits=1, units="mm")
    assert "units-overridden" in codes(overridden)
    with pytest.raises(InputError, match=r"unknown unit 'milimeter'.*millimeter"):
        read(tmp_path, draw, units="milimeter")


def test_absent_units_are_seen_although_the_library_fills_them_in(tmp_path: Path) -> None:
    document = ezdxf.new("R12")
    document.modelspace().add_circle((0, 0), 1)
    path = tmp_path / "old.dxf"
    document.saveas(path)
    lines_of_file = path.read_text().splitlines()
    if "$INSUNITS" in lines_of_file:
        place = lines_of_file.index("$INSUNITS")
        del lines_of_file[place - 1 : place + 3]
        path.write_text("\n".join(lines_of_file) + "\n")
    assert raw_insunits(path.read_bytes()) is None
    with pytest.raises(InputError, match=r"INSUNITS is absent.*give units"):
        read_regions(path)
    assert read_regions(path, units="mm").units_source == "argument"


def test_extent_out_of_reason_doubts_the_units(tmp_path: Path) -> None:
    drawing = read(tmp_path, model(lambda space: square(space, 0, 200)), insunits=6)
    assert "units-doubtful" in codes(drawing)


# Chaining ------------------------------------------------------------------------------------


def test_gaps_within_the_tolerance_are_closed_and_reported(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        lines(space, [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0.004)])

    drawing = read(tmp_path, model(draw))
    (finding,) = [item for item in drawing.findings if item.code == "gap-closed"]
    assert finding.size == pytest.approx(0.004)
    assert finding.place == pytest.approx((0, 0.002))
    assert finding.handle is not None
    assert only(drawing).area == pytest.approx(100, abs=0.05)


def test_gaps_beyond_the_tolerance_are_named(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        lines(space, [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0.05)])

    with pytest.raises(InputError) as caught:
        read(tmp_path, model(draw))
    text = str(caught.value)
    assert "(0, 0)-(0, 0.05)" in text
    assert "0.05 mm" in text
    assert "chaining_tolerance" in text
    assert only(read(tmp_path, model(draw), chaining_tolerance=0.1)).area > 99


@pytest.mark.parametrize("gap", [1e-6, 1e-5])
def test_closing_a_small_gap_keeps_tangency(tmp_path: Path, gap: float) -> None:
    def draw(space: Any) -> None:
        space.add_line((0, 0), (10, 0))
        space.add_arc((10 + gap, 3 + gap), 3, -90, 90)
        space.add_line((10, 6), (0, 6))
        space.add_arc((0, 3), 3, 90, 270)

    region = only(read(tmp_path, model(draw)))
    assert kinds(region) == ["Arc", "Arc", "Line", "Line"]
    assert np.abs(region.outer.junctions(1e-4).turn).max() < 3 * gap
    for curve in region.outer.curves:
        if isinstance(curve, Arc):
            assert curve.radius == pytest.approx(3, abs=2 * gap)


def test_duplicates_and_overlaps_are_removed(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        lines(space, [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0)])
        space.add_line((10, 0), (0, 0))
        space.add_line((10, 2), (10, 7))

    drawing = read(tmp_path, model(draw))
    assert only(drawing).area == pytest.approx(100)
    assert kinds(only(drawing)) == ["Line"] * 4
    assert {"duplicate", "overlap"} <= codes(drawing)


def test_overlapping_arcs_are_kept_once(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_arc((0, 0), 5, 0, 180)
        space.add_arc((0, 0), 5, 45, 120)
        space.add_line((-5, 0), (5, 0))

    drawing = read(tmp_path, model(draw))
    assert kinds(only(drawing)) == ["Arc", "Line"]
    assert "overlap" in codes(drawing)


def test_contour_drawn_twice_counts_once(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        square(space, 0, 10)
        lines(space, [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0)])
        space.add_circle((5, 5), 2)
        space.add_circle((5, 5), 2)

    drawing = read(tmp_path, model(draw))
    assert len(only(drawing).islands) == 1
    assert [item.code for item in drawing.findings].count("duplicate-contour") == 2


def test_divided_rectangle_gives_the_faces(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        lines(space, [(0, 0), (4, 0), (10, 0), (10, 6), (4, 6), (0, 6), (0, 0)])
        space.add_line((4, 0), (4, 6))

    drawing = read(tmp_path, model(draw))
    assert sorted(region.area for region in drawing.regions) == pytest.approx([24, 36])
    assert [item.code for item in drawing.findings].count("branch") == 2


def test_rectangles_that_share_part_of_an_edge(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        lines(space, [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0)])
        lines(space, [(10, 0), (20, 0), (20, 6), (10, 6), (10, 0)])

    drawing = read(tmp_path, model(draw))
    assert sorted(region.area for region in drawing.regions) == pytest.approx([60, 100])


def test_circles_tangent_inside_at_a_node_nest(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        for centre, radius in ((0, 4), (2, 2)):
            space.add_arc((centre, 0), radius, 0, 180)
            space.add_arc((centre, 0), radius, 180, 360)

    drawing = read(tmp_path, model(draw))
    region = only(drawing)
    assert region.area == pytest.approx(12 * math.pi, rel=1e-9)
    assert len(region.islands) == 1
    assert {"branch", "touching"} <= codes(drawing)


def test_curves_that_leave_a_node_in_one_direction_are_told_apart(tmp_path: Path) -> None:
    # A line and two arcs start at the origin with one tangent; only their bends differ.
    def draw(space: Any) -> None:
        space.add_arc((0, 6), 6, 270, 360)
        space.add_arc((0, 3), 3, 270, 360)
        lines(space, [(0, 0), (6, 0), (6, 6), (6, 8), (3, 8), (3, 3)])

    drawing = read(tmp_path, model(draw))
    low = 36 - 9 * math.pi
    high = 33 - 9 * math.pi / 4 - low
    assert sorted(region.area for region in drawing.regions) == pytest.approx([low, high])
    assert [item.code for item in drawing.findings].count("branch") == 2


def test_nested_contours_that_share_edges_become_faces(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_lwpolyline([(0, 0), (10, 0), (10, 4), (0, 4)], close=True)
        space.add_lwpolyline([(3, 0), (7, 0), (7, 4), (3, 4)], close=True)

    drawing = read(tmp_path, model(draw))
    assert sorted(region.area for region in drawing.regions) == pytest.approx([12, 12, 16])
    assert {"overlap", "branch"} <= codes(drawing)


def test_dangling_line_is_left_out_of_a_closed_contour(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        lines(space, [(0, 0), (10, 0), (10, 10), (0, 10), (0, 0)])
        space.add_line((10, 10), (15, 15))

    drawing = read(tmp_path, model(draw))
    assert only(drawing).area == pytest.approx(100)
    (finding,) = [item for item in drawing.findings if item.code == "open-chain"]
    assert finding.place == pytest.approx((15, 15))


@pytest.mark.parametrize("outer", [True, False])
def test_a_contour_with_a_gap_round_another_or_inside_it_is_refused(
    tmp_path: Path, outer: bool
) -> None:
    """Left out, it would turn an island into a pocket, or let the tool mill an island away."""

    def draw(space: Any) -> None:
        square(space, 0, 8)
        gap, low, high = 0.05, *((-10.0, 18.0) if outer else (2.0, 6.0))
        lines(space, [(low, low + gap), (low, high), (high, high), (high, low), (low, low)])

    with pytest.raises(InputError, match=r"gap of 0\.05 mm.*raise chaining_tolerance") as caught:
        read(tmp_path, model(draw))
    assert caught.value.place == pytest.approx((-10, -10) if outer else (2, 2), abs=0.1)
    assert len(read(tmp_path, model(draw), chaining_tolerance=0.06).regions) == 1


def test_open_marks_and_contours_apart_refuse_nothing(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        square(space, 0, 8)
        space.add_arc((4, 4), 2.0, 0, 270)
        space.add_arc((4, 4), 9.0, 0, 270)
        space.add_line((-3, 4), (11, 4))
        lines(space, [(30, 0.05), (30, 9), (39, 9), (39, 0), (30, 0)])

    drawing = read(tmp_path, model(draw))
    assert only(drawing).area == pytest.approx(64)
    assert [item.code for item in drawing.findings].count("open-chain") == 4


def test_keyhole_polyline_is_taken_apart(tmp_path: Path) -> None:
    points = [(0, 0), (20, 0), (20, 20), (10, 20), (10, 14), (6, 10), (14, 10), (10, 14), (10, 20)]
    points.append((0, 20))
    drawing = read(tmp_path, model(lambda space: space.add_lwpolyline(points, close=True)))
    region = only(drawing)
    assert region.area == pytest.approx(400 - 16)
    assert len(region.islands) == 1
    assert "pinched" in codes(drawing)


@given(st.permutations(range(6)), st.lists(st.booleans(), min_size=6, max_size=6))
@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_order_and_direction_of_lines_do_not_matter(
    tmp_path: Path, order: list[int], backward: list[bool]
) -> None:
    corners = [(0, 0), (10, 0), (12, 5), (7, 4), (5, 9), (-2, 6)]

    def draw(space: Any) -> None:
        for index in order:
            ends = [corners[index], corners[(index + 1) % 6]]
            space.add_line(*(ends[::-1] if backward[index] else ends))

    region = only(read(tmp_path, model(draw)))
    x, y = np.array(corners, dtype=float).T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    assert region.area == pytest.approx(area, rel=1e-12)
    assert all(isinstance(curve, Line) for curve in region.outer.curves)


@pytest.mark.parametrize("missing", [1e-5, 1e-4, 8e-3])
def test_almost_full_turn_becomes_a_circle(tmp_path: Path, missing: float) -> None:
    def draw(space: Any) -> None:
        space.add_arc((0, 0), 10, 0, 360 - math.degrees(missing / 10))
        space.add_ellipse((40, 0), (10, 0), 0.5, 0, 2 * math.pi - missing / 10)

    drawing = read(tmp_path, model(draw))
    assert [kinds(region) for region in drawing.regions] == [["Arc"], ["EllipticalArc"]]
    assert [item.code for item in drawing.findings] == ["gap-closed"] * 2


def test_spline_that_almost_closes_is_shifted(tmp_path: Path) -> None:
    control = [(0, 0), (10, -5), (15, 8), (4, 12), (0, 0.005)]
    region = only(read(tmp_path, model(lambda space: space.add_open_spline(control))))
    (curve,) = region.outer.curves
    assert np.allclose(curve.start, (0, 0.0025), atol=1e-12)


def test_rings_of_one_bulge_each_way(tmp_path: Path) -> None:
    rows = [(0, 0, 1), (10, 0, 1)]
    drawing = read(
        tmp_path, model(lambda space: space.add_lwpolyline(rows, format="xyb", close=True))
    )
    assert only(drawing).area == pytest.approx(25 * math.pi)


def test_crossing_lines_without_a_node_stay_open(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        square(space, 0, 8)
        space.add_line((-1, 4), (9, 4))

    drawing = read(tmp_path, model(draw))
    assert only(drawing).area == pytest.approx(64)
    assert "open-chain" in codes(drawing)


def test_an_empty_file_is_named_so(tmp_path: Path) -> None:
    (tmp_path / "empty.dxf").write_text("\n")
    with pytest.raises(InputError, match="the file is empty"):
        read_regions(tmp_path / "empty.dxf", units="mm")


# Nesting and refusals ------------------------------------------------------------------------


def test_islands_in_islands(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        for half in (50, 40, 30, 20, 10):
            square(space, -half, half)
        space.add_circle((45, 45), 1)

    drawing = read(tmp_path, model(draw))
    assert [len(region.islands) for region in drawing.regions] == [2, 1, 0]
    assert sum(region.area for region in drawing.regions) == pytest.approx(
        (100**2 - 80**2) + (60**2 - 40**2) + 20**2 - math.pi
    )


def test_self_crossing_contour_is_refused_at_its_place(tmp_path: Path) -> None:
    points = [(0, 0), (10, 10), (10, 0), (0, 10)]
    with pytest.raises(InputError, match=r"crosses or touches itself.*\(5, 5\)"):
        read(tmp_path, model(lambda space: space.add_lwpolyline(points, close=True)))


def test_tangent_joint_is_no_crossing(tmp_path: Path) -> None:
    # A horn between two circles that touch from inside: its tip is a cusp.
    def draw(space: Any) -> None:
        space.add_arc((0, 0), 10, 0, 180)
        space.add_arc((1, 0), 9, 0, 180)
        space.add_line((-10, 0), (-8, 0))

    region = only(read(tmp_path, model(draw)))
    assert region.area == pytest.approx(0.5 * math.pi * (100 - 81), rel=1e-9)


def test_overlapping_contours_are_left_out_with_the_place(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        square(space, 0, 10)
        square(space, 5, 15)
        space.add_circle((40, 0), 3)

    drawing = read(tmp_path, model(draw))
    assert only(drawing).area == pytest.approx(9 * math.pi)
    (finding,) = [item for item in drawing.findings if item.severity is Severity.ERROR]
    assert finding.place in [pytest.approx((10, 5)), pytest.approx((5, 10))]
    assert finding.size == pytest.approx(25)


def test_overlapping_islands_take_their_region_with_them(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        square(space, 0, 100)
        space.add_circle((40, 50), 10)
        space.add_circle((50, 50), 10)

    with pytest.raises(InputError, match="overlap"):
        read(tmp_path, model(draw))


def test_touching_neighbours_are_both_kept(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        space.add_circle((0, 0), 5)
        space.add_circle((10, 0), 5)

    assert len(read(tmp_path, model(draw)).regions) == 2


def test_nothing_drawn(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no closed contour"):
        read(tmp_path, model(lambda space: space.add_text("only text")))


def test_line_there_and_back_is_no_contour(tmp_path: Path) -> None:
    points = [(0, 0), (10, 0)]
    with pytest.raises(InputError, match="no closed contour"):
        read(tmp_path, model(lambda space: space.add_lwpolyline(points, close=True)))


def test_missing_file_names_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "bracket.dxf").write_text("")
    with pytest.raises(InputError, match=r"no such file.*bracket\.dxf"):
        read_regions(tmp_path / "braket.dxf")
    with pytest.raises(InputError, match="cannot be read"):
        read_regions(tmp_path)


@pytest.mark.parametrize(
    "content",
    [b"", b"not a drawing", b"\x00\xff" * 500, b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\nabc\n"],
)
def test_rubbish_is_one_clear_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "rubbish.dxf"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_regions(path, units="mm")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.3, 0.6, 0.9])
def test_truncated_file_is_recovered_or_refused(tmp_path: Path, share: float) -> None:
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    for index in range(20):
        document.modelspace().add_circle((3 * index, 0), 1)
    path = tmp_path / "cut.dxf"
    document.saveas(path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    try:
        drawing = read_regions(path)
    except InputError as problem:
        assert "\n" not in str(problem)
    else:
        assert any(item.severity is not Severity.INFO for item in drawing.findings)


def test_missing_subclass_markers_are_restored(tmp_path: Path) -> None:
    document = ezdxf.new("R2000")
    document.header["$INSUNITS"] = 4
    square(document.modelspace(), 0, 10)
    path = tmp_path / "bare.dxf"
    document.saveas(path)
    text = path.read_text()
    head, tail = text.split("LWPOLYLINE", 1)
    for marker in ("AcDbEntity", "AcDbPolyline"):
        before, after = tail.split(marker, 1)
        tail = before.rstrip().removesuffix("100").rstrip(" ").rstrip("\n") + after
    path.write_text(head + "LWPOLYLINE" + tail)
    drawing = read_regions(path)
    assert only(drawing).area == pytest.approx(100)
    assert "subclass-markers" in codes(drawing)


def test_same_file_same_answer(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        for index in range(5):
            lines(space, [(9 * index, 0), (9 * index + 7, 0), (9 * index, 7.001), (9 * index, 0)])

    first = read(tmp_path, model(draw))
    second = read_regions(tmp_path / "drawing.dxf")
    assert first.findings == second.findings
    assert [r.bounds() for r in first.regions] == [r.bounds() for r in second.regions]


# Drawings found in the wild ------------------------------------------------------------------


def found_drawings() -> list[tuple[str, int | None]]:
    index = SHARED / "INDEX.tsv"
    if not index.exists():
        return []
    with index.open(newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t"))
    return [(row["file"], int(row["closed_contours"] or -1)) for row in rows]


@pytest.mark.skipif(not SHARED.exists(), reason="the drawings are not at hand")
@pytest.mark.parametrize(("name", "contours"), found_drawings())
def test_found_drawing_gives_regions_or_one_clear_error(name: str, contours: int) -> None:
    path = SHARED / name
    units = None if raw_insunits(path.read_bytes()) else "mm"
    try:
        drawing = read_regions(path, units=units)
    except GrassfireError as problem:
        assert "\n" not in str(problem)
        assert problem.remedy
        return
    assert drawing.regions
    assert all(region.area > 0 for region in drawing.regions)
    assert len(drawing.region_layers) == len(drawing.regions)
