"""Laws of the verifier's measurements."""

from __future__ import annotations

import importlib.util
import math
import sys
import time
from pathlib import Path as FilePath
from types import ModuleType

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, box

from grassfire.errors import InputError
from grassfire.gcode import read_program
from grassfire.toolpath import Program, Section, ToolpathBuilder
from grassfire.verify import Target, Verification, count_program, verify
from grassfire.verify.gouge import Walls, stretches_between
from grassfire.verify.path import Path, flatten_program
from grassfire.verify.raster import Grid, cells_inside
from grassfire.verify.repeats import Lowering
from grassfire.verify.sweep import build_pieces, lower
from verify_samples import MACHINE, Sample, samples

SAMPLES = {item.name: item for item in samples()}
SQUARE = box(0, 0, 40, 40)


def target(**changes: object) -> Target:
    values: dict[str, object] = {
        "operation": 0,
        "region": SQUARE,
        "depth": 2.0,
        "tool_radius": 3.0,
    }
    return Target(**(values | changes))  # type: ignore[arg-type]


def program(builder: ToolpathBuilder, **changes: object) -> Program:
    values: dict[str, object] = {
        "tool_number": 1,
        "tool_diameter": math.nan,
        "spindle_speed": 1000.0,
        "operation": 0,
    }
    return Program("test", (Section(builder.build(), **(values | changes)),))  # type: ignore[arg-type]


def path_of(builder: ToolpathBuilder) -> Path:
    return flatten_program(program(builder), (target(),))


def judge(builder: ToolpathBuilder, *targets: Target, **changes: object) -> Verification:
    return verify(program(builder, **changes), targets or (target(),), **MACHINE)


def kinds(result: Verification) -> set[str]:
    return {fault.kind for fault in result.faults}


coordinate = st.floats(-8, 8).map(lambda value: round(value, 3))


@st.composite
def wandering(draw: st.DrawFn) -> ToolpathBuilder:
    """A path of level lines and arcs at z = -1, as a cutter follows it."""
    builder = ToolpathBuilder((draw(coordinate), draw(coordinate), -1.0))
    for _ in range(draw(st.integers(1, 6))):
        x, y = draw(coordinate), draw(coordinate)
        if draw(st.booleans()):
            builder.line(x, y, -1.0, 600.0)
            continue
        cx, cy = draw(coordinate), draw(coordinate)
        radius = math.hypot(builder.position[0] - cx, builder.position[1] - cy)
        angle = draw(st.floats(0, 2 * math.pi))
        builder.arc(
            cx + radius * math.cos(angle),
            cy + radius * math.sin(angle),
            -1.0,
            (cx, cy),
            draw(st.booleans()),
            600.0,
        )
    return builder


@settings(max_examples=40, deadline=None)
@given(wandering())
def test_first_cut_times_agree_with_dense_sampling(builder: ToolpathBuilder) -> None:
    """A cell's first cut is where the path first comes within the tool's radius of its centre."""
    path = path_of(builder)
    if path.length.max() < 1e-6:
        return
    grid = Grid(-30.0, -30.0, 0.5, 120, 120)
    pieces = build_pieces(path, np.array([-1e-6]), chord_error=1e-4, rapid_clearance=0.0)
    first_cut = np.full(grid.size, np.inf)
    lower(first_cut, pieces, grid)

    move = np.repeat(np.arange(len(path)), 400)
    fraction = np.tile(np.linspace(0, 1, 400), len(path))
    points = path.point(move, fraction)[:, :2]
    station = path.station[move] + fraction * path.length[move]
    centres = -30.0 + (np.arange(120) + 0.5) * 0.5
    x, y = np.meshgrid(centres, centres)
    cells = np.column_stack([x.ravel(), y.ravel()])
    near = np.flatnonzero(np.abs(cells).max(axis=1) < 25)[::7]
    distance = np.hypot(*(cells[near, None] - points[None]).transpose(2, 0, 1))
    step = float(path.length.max()) / 399 if len(path) else 0.0
    inside = distance <= 3.0
    sampled = np.where(inside.any(axis=1), station[inside.argmax(axis=1)], np.inf)
    exact = first_cut[near]
    # Sampling is late by a step at most, and misses what it grazes by less than a step's sagitta.
    settled = np.isfinite(sampled) & np.isfinite(exact)
    late = np.zeros(len(near))
    late[settled] = sampled[settled] - exact[settled]
    missed = np.isfinite(exact) & ~np.isfinite(sampled)
    assert np.all(distance[missed].min(axis=1) < 3.0 + step)
    assert not np.any(np.isfinite(sampled) & ~np.isfinite(exact) & (distance.min(axis=1) < 2.999))
    grazing = np.abs(distance.min(axis=1) - 3.0) < step
    # The entry itself may be a graze of an earlier part of the path.
    clear = settled & ~grazing
    bad = clear & ((late < -1e-3 - step) | (late > step + 1e-3))
    for row in np.flatnonzero(bad):
        at = np.interp(exact[row], path.station, np.arange(len(path) + 1.0))
        index = min(int(at), len(path) - 1)
        place = path.point(np.array([index]), np.array([at - index]))[0, :2]
        assert abs(np.hypot(*(cells[near[row]] - place)) - 3.0) < 2e-3


@settings(max_examples=60, deadline=None)
@given(wandering())
def test_clearance_is_exact(builder: ToolpathBuilder) -> None:
    """The distance to the walls agrees with dense sampling of the true curves."""
    region = box(-20, -20, 20, 20).difference(box(9, -3, 12, 15)).difference(Point(0, 14).buffer(3))
    path = path_of(builder)
    walls = Walls(region)
    stretch = stretches_between(path, np.arange(len(path)), -np.inf, 0.0)
    found = walls.clearance(path, stretch, np.full(len(stretch.move), 50.0))
    for row in range(len(stretch.move)):
        fraction = np.linspace(stretch.since[row], stretch.until[row], 2001)
        points = path.point(np.full(2001, stretch.move[row]), fraction)[:, :2]
        step = np.hypot(*np.diff(points, axis=0).T).max(initial=0.0)
        sampled = walls.signed_distance(points).min()
        if sampled > step:
            assert found.distance[row] <= sampled + 1e-9
            assert found.distance[row] >= sampled - step**2 / max(sampled, 0.1) - 1e-6
        elif sampled < 0:
            assert found.distance[row] == pytest.approx(sampled, abs=0.01)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=12))
def test_cells_inside_agree_with_shapely(points: list[tuple[float, float]]) -> None:
    shape = shapely.convex_hull(shapely.multipoints(points))
    if shape.area < 1e-3:
        return
    shape = shape.difference(Point(shape.centroid).buffer(0.7))
    grid = Grid(-9.0, -9.05, 0.11, 165, 160)
    x = grid.x0 + (np.arange(165) + 0.5) * 0.11
    y = grid.y0 + (np.arange(160) + 0.5) * 0.11
    columns, rows = np.meshgrid(x, y)
    # a centre right on the edge may count either way
    edge = shapely.distance(shape.boundary, shapely.points(columns, rows)) < 1e-9
    expected = shapely.contains_xy(shape, columns, rows)
    assert np.array_equal(cells_inside(shape, grid) | edge, expected | edge)


def test_passes_that_repeat_are_mapped_as_if_each_were_swept() -> None:
    builder = ToolpathBuilder((0.0, 0.0, 5.0))
    angle = np.linspace(0.0, 12 * math.pi, 400)
    spiral = (3 + angle[:, None] / 4) * np.column_stack([np.cos(angle), np.sin(angle)])
    for depth in (-1.0, -2.0, -3.0):
        builder.line(*spiral[0], depth, 300.0)
        for index, (x, y) in enumerate(spiral.tolist()):
            if index == 200 and depth == -2.0:
                builder.line(x, y - 1.0, depth, 800.0)
            builder.line(x, y, depth, 800.0)
        builder.line(3.0, 4.0, depth, 800.0)
        if depth == -3.0:
            builder.arc(3.0, 4.0, depth, (0.0, 0.0), True, 800.0)
    path = path_of(builder)
    thresholds = np.array([-3.0, -2.0, -1.0, -1e-6])
    pieces = build_pieces(path, thresholds, chord_error=1e-9, rapid_clearance=0.0)
    level = path.begin[pieces.move, 2] == path.end[pieces.move, 2]
    grid = Grid(-20.0, -20.0, 0.2, 200, 200)
    swept, repeated = np.full((2, grid.size), np.inf)
    lowering = Lowering(pieces, level, grid)
    for band in range(len(thresholds)):
        rows = np.flatnonzero(pieces.band == band)
        if len(rows):
            lower(swept, pieces.take(rows), grid)
            lowering.lower(repeated, rows)
        cut = np.isfinite(swept)
        np.testing.assert_array_equal(np.isfinite(repeated), cut)
        np.testing.assert_allclose(repeated[cut], swept[cut], rtol=0, atol=1e-8)
    assert [len(item.bands) for item in lowering.shared] == [3]


def test_engagement_of_a_slot_and_of_a_stepover() -> None:
    """A slot engages half the cutter; a straight cut of width a engages acos(1 - a / R)."""
    builder = ToolpathBuilder((5.0, 20.0, 5.0))
    builder.line(5.0, 20.0, -2.0, 100.0)
    builder.line(35.0, 20.0, -2.0, 600.0)
    builder.line(35.0, 21.8, -2.0, 600.0)
    builder.line(5.0, 21.8, -2.0, 600.0)
    result = judge(builder, target(entry="plunge", region=box(0, 0, 40, 30)))
    assert result.operations[0].max_engagement_deg == pytest.approx(180, abs=3)
    slot = 30.0
    side = math.degrees(math.acos(1 - 1.8 / 3))
    expected = (slot * 180 + 30 * side) / 60
    assert result.operations[0].mean_engagement_deg == pytest.approx(expected, abs=4)


def test_a_lap_that_only_touches_is_not_engaged() -> None:
    """A second lap on the same square path meets stock in the corners, but cuts none."""
    results = []
    for laps in (1, 2):
        builder = ToolpathBuilder((3.0, 3.0, 5.0))
        builder.line(3.0, 3.0, -2.0, 100.0)
        for _ in range(laps):
            for x, y in ((37.0, 3.0), (37.0, 37.0), (3.0, 37.0), (3.0, 3.0)):
                builder.line(x, y, -2.0, 600.0)
        results.append(judge(builder, target(entry="plunge")).operations[0])
    once, twice = results
    assert once.mean_engagement_deg == pytest.approx(170, abs=8)
    assert twice.mean_engagement_deg == pytest.approx(once.mean_engagement_deg, abs=0.5)


def test_a_lap_one_pass_deeper_does_not_cut_what_the_pass_above_left() -> None:
    # so short a lap that the one above it is less than a radius of travel ago
    walls = Point(20, 20).buffer(3.2, quad_segs=16).union(box(20, 17.6, 24, 22.4))
    path = ToolpathBuilder((20.1, 20.0, 5.0))
    for level in (-1.0, -2.0):
        path.line(20.1, 20.0, level, 300.0)
        path.arc(20.1, 20.0, level, (20.0, 20.0), True, 600.0)
    path.rapid(20.1, 20.0, 5.0)
    result = judge(path, target(region=walls, stepdown=1.0, entry="plunge"))
    assert "stepdown" not in kinds(result)
    assert "uncut" in kinds(result)


def test_a_cut_at_two_passes_depth_exceeds_the_stepdown() -> None:
    path = ToolpathBuilder((10.0, 20.0, 5.0))
    path.line(10.0, 20.0, -2.0, 300.0)
    path.line(30.0, 20.0, -2.0, 600.0)
    path.rapid(30.0, 20.0, 5.0)
    result = judge(path, target(stepdown=1.0, entry="plunge"))
    (fault,) = (item for item in result.faults if item.kind == "stepdown")
    assert fault.size > 120


@pytest.mark.parametrize("depth_below", [0.0, 0.5])
def test_gouge_and_floor_are_exact(depth_below: float) -> None:
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    builder.line(20.0, 20.0, -2.0 - depth_below, 100.0)
    builder.line(37.25, 20.0, -2.0 - depth_below, 600.0)
    result = judge(builder, target(entry="plunge"))
    assert result.operations[0].max_gouge_mm == pytest.approx(0.25, abs=1e-9)
    gouge = next(fault for fault in result.faults if fault.kind == "gouge")
    assert gouge.place[0] == pytest.approx(37.25)
    assert ("floor" in kinds(result)) == (depth_below > 0)


def test_an_arc_that_bulges_through_the_wall_is_a_gouge() -> None:
    builder = ToolpathBuilder((37.0, 15.0, -1.0))
    builder.arc(37.0, 25.0, -1.0, (32.0, 20.0), True, 600.0)
    radius = math.hypot(5, 5)
    result = judge(builder, target(entry="plunge"))
    assert result.operations[0].max_gouge_mm == pytest.approx(32 + radius - 37, abs=1e-9)


def test_depth_of_the_walls_counts() -> None:
    """Below the floor of the wide pocket the tool has to stay inside the deep one."""
    deep = target(operation=1, region=box(10, 10, 30, 30), depth=5.0)
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    builder.line(20.0, 20.0, -5.0, 100.0)
    builder.line(28.0, 20.0, -5.0, 600.0)
    result = verify(program(builder, operation=1), (target(), deep), **MACHINE)
    assert result.operations[1].max_gouge_mm == pytest.approx(1.0, abs=1e-9)
    shallow = ToolpathBuilder((20.0, 20.0, 5.0))
    shallow.line(20.0, 20.0, -2.0, 100.0)
    shallow.line(28.0, 20.0, -2.0, 600.0)
    result = verify(program(shallow, operation=1), (target(), deep), **MACHINE)
    assert result.operations[1].max_gouge_mm == 0.0


def test_allowances_are_left() -> None:
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    builder.line(20.0, 20.0, -1.9, 100.0)
    builder.line(36.9, 20.0, -1.9, 600.0)
    asked = target(entry="plunge", radial_allowance=0.3, axial_allowance=0.2)
    result = judge(builder, asked)
    sizes = {fault.kind: fault.size for fault in result.faults}
    assert sizes["allowance"] == pytest.approx(0.2)
    assert sizes["axial-allowance"] == pytest.approx(0.1)
    assert "gouge" not in sizes


def test_rapids_below_the_top_and_through_stock() -> None:
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    builder.rapid(20.0, 20.0, -1.0)
    builder.rapid(25.0, 20.0, -1.0)
    builder.rapid(25.0, 20.0, 5.0)
    result = judge(builder)
    assert {"rapid-in-stock", "rapid-low"} <= kinds(result)
    assert result.operations[0].rapids_in_stock == 2
    assert result.operations[0].retracts == 1


def test_rapid_into_a_cleared_hole_is_no_hit() -> None:
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    for _ in range(2):
        builder.line(20.0, 20.0, -2.0, 100.0)
        builder.rapid(20.0, 20.0, 5.0)
        builder.rapid(20.0, 20.0, -1.99)
    builder.rapid(20.0, 20.0, 5.0)
    result = judge(builder, target(entry="plunge"))
    assert result.operations[0].rapids_in_stock == 0
    assert kinds(result) == {"uncut"}


@pytest.mark.parametrize("narrower", [0.0, 1e-4])
def test_slots_and_holes_as_wide_as_the_tool_have_to_be_cut(narrower: float) -> None:
    """The tool centre has no area there, but a way, or a place where it may plunge."""
    radius = target().tool_radius
    wide = 2 * radius - narrower
    slot = shapely.box(10.0, 10.0, 40.0, 10.0 + wide)
    hole = shapely.box(10.0, 30.0, 10.0 + wide, 30.0 + wide)
    region = shapely.MultiPolygon([slot, hole])
    for ways, uncut in ((2, False), (1, True), (0, True)):
        builder = ToolpathBuilder((10.0 + radius, 10.0 + wide / 2, 5.0))
        if ways > 0:
            builder.line(10.0 + radius, 10.0 + wide / 2, -2.0, 100.0)
            builder.line(40.0 - radius, 10.0 + wide / 2, -2.0, 600.0)
            builder.rapid(40.0 - radius, 10.0 + wide / 2, 5.0)
        if ways > 1:
            builder.rapid(10.0 + wide / 2, 30.0 + wide / 2, 5.0)
            builder.line(10.0 + wide / 2, 30.0 + wide / 2, -2.0, 100.0)
            builder.rapid(10.0 + wide / 2, 30.0 + wide / 2, 5.0)
        result = judge(builder, target(region=region, entry="plunge"))
        assert ("uncut" in kinds(result)) == uncut
        assert result.operations[0].reachable_area_mm2 == pytest.approx(
            (30 - wide) * wide + 2 * math.pi * radius**2, rel=1e-3
        )


def test_fast_moves_keep_to_what_is_cleared() -> None:
    """A link through stock at its own feed breaks a tool; back over what was cut it is right."""
    for first, fault in ((3000.0, True), (600.0, False)):
        builder = ToolpathBuilder((20.0, 20.0, 5.0))
        builder.line(20.0, 20.0, -2.0, 100.0)
        builder.line(28.0, 20.0, -2.0, first)
        builder.line(20.0, 20.0, -2.0, 3000.0)
        result = judge(builder, target(entry="plunge", cutting_feed=600.0, max_feed=3000.0))
        assert ("fast-cut" in kinds(result)) == fault
    grazing = ToolpathBuilder((20.0, 20.0, 5.0))
    grazing.line(20.0, 20.0, -2.0, 100.0)
    grazing.line(28.0, 20.0, -2.0, 600.0)
    grazing.line(28.0, 20.05, -2.0, 600.0)
    grazing.line(20.0, 20.05, -2.0, 3000.0)
    assert "fast-cut" not in kinds(judge(grazing, target(entry="plunge", cutting_feed=600.0)))


@pytest.mark.parametrize(("feed", "fault"), [(3000.0, True), (600.0, False)])
def test_plunges_are_not_faster_than_cuts(feed: float, fault: bool) -> None:
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    builder.line(20.0, 20.0, -2.0, feed)
    builder.line(20.0, 20.0, 1.0, 3000.0)
    builder.line(20.0, 20.0, -2.0, 3000.0)
    builder.rapid(20.0, 20.0, 5.0)
    result = judge(builder, target(entry="plunge", cutting_feed=600.0))
    assert [item.kind for item in result.faults].count("fast-cut") == fault


@pytest.mark.parametrize(("entry", "fault"), [("helix", True), ("plunge", False)])
def test_plunges(entry: str, fault: bool) -> None:
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    builder.line(20.0, 20.0, -2.0, 100.0)
    builder.rapid(20.0, 20.0, 5.0)
    assert ("plunge" in kinds(judge(builder, target(entry=entry)))) == fault


def test_state_faults() -> None:
    nan = math.nan
    builder = ToolpathBuilder()
    builder.line(20.0, 20.0, -2.0, nan)
    result = judge(builder, target(tool_number=2, max_feed=100.0), spindle_speed=0.0)
    assert {"unknown-start", "spindle-off", "no-feed", "wrong-tool", "ends-in-stock"} <= kinds(
        result
    )
    quick = ToolpathBuilder((20.0, 20.0, 5.0))
    quick.line(20.0, 20.0, -2.0, 500.0)
    assert "feed" in kinds(judge(quick, target(max_feed=100.0)))
    assert "wrong-tool" in kinds(judge(quick, tool_diameter=4.0))


def test_a_program_that_chooses_no_tool_is_told_so() -> None:
    text = "G21 G90 G17 G94\nS1000 M3\nG0 X10 Y10 Z5\nG1 Z-2 F100\nG0 Z5\nM5\nM30\n"
    result = verify(read_program(text), (target(tool_number=1, entry="plunge"),), **MACHINE)
    (fault,) = (item for item in result.faults if item.kind == "wrong-tool")
    assert fault.message == (
        "the program chooses no tool; the operation asks for diameter 6 mm (tool 1)"
    )


def test_arc_whose_radii_differ_is_a_fault() -> None:
    builder = ToolpathBuilder((20.0, 20.0, -1.0))
    builder.arc(25.0, 20.0, -1.0, (22.0, 20.0), True, 500.0)
    assert "arc-radius" in kinds(judge(builder))


def test_empty_program_cuts_nothing() -> None:
    result = verify(Program("empty", ()), (target(),), **MACHINE)
    assert {"nothing-cut", "uncut"} <= kinds(result)
    assert result.time_s == 0.0


@pytest.mark.parametrize(("entry", "fault"), [("helix", False), ("plunge", True)])
def test_a_place_that_only_a_plunge_enters_is_asked_for_where_plunges_are(
    entry: str, fault: bool
) -> None:
    lap = ToolpathBuilder((3.0, 3.0, 5.0))
    lap.line(3.0, 3.0, -2.0, 300.0)
    for x, y in ((4.0, 3.0), (4.0, 4.0), (3.0, 4.0), (3.0, 3.0)):
        lap.line(x, y, -2.0, 600.0)
    lap.rapid(3.0, 3.0, 5.0)
    hole = Point(20, 3).buffer(3.005, quad_segs=256)
    both = shapely.MultiPolygon([box(0, 0, 7, 7), hole])
    assert ("uncut" in kinds(judge(lap, target(region=both, entry=entry)))) == fault


def test_uncut_names_the_place_of_the_largest_patch() -> None:
    sample = SAMPLES["zigzag"]
    lines = sample.text.splitlines()
    row = max(i for i, s in enumerate(lines) if s.startswith("G1 X28.0000 Y2.0000"))
    del lines[row]
    result = verify(read_program("\n".join(lines)), sample.targets, **MACHINE)
    uncut = next(fault for fault in result.faults if fault.kind == "uncut")
    assert uncut.place[0] > 14
    assert uncut.place[2] == -2.0
    assert uncut.line > 0


def test_uncut_area_agrees_with_vectors() -> None:
    """One slot in a square: what is left is the opened square less the slot."""
    builder = ToolpathBuilder((5.0, 20.0, 5.0))
    builder.line(5.0, 20.0, -2.0, 100.0)
    builder.line(35.0, 20.0, -2.0, 600.0)
    result = judge(builder, target(entry="plunge"))
    reach = SQUARE.buffer(-3).buffer(3, quad_segs=64)
    left = reach.difference(LineString([(5, 20), (35, 20)]).buffer(3, quad_segs=64))
    figures = result.operations[0]
    assert figures.reachable_area_mm2 == pytest.approx(reach.area, rel=1e-4)
    assert figures.uncut_area_mm2 == pytest.approx(left.area, rel=1e-2)
    assert figures.unreachable_area_mm2 == pytest.approx(SQUARE.area - reach.area, rel=1e-2)


def test_height_map_holds_levels_and_ramps() -> None:
    builder = ToolpathBuilder((10.0, 20.0, 0.0))
    builder.line(30.0, 20.0, -2.0, 100.0)
    builder.line(30.0, 30.0, -2.0, 100.0)
    result = judge(builder)
    map_ = result.height_map

    def height(x: float, y: float) -> float:
        column = int((x - map_.origin[0]) / map_.resolution)
        row = int((y - map_.origin[1]) / map_.resolution)
        return float(map_.height[row, column])

    assert height(30.0, 30.0) == -2.0
    assert height(5.0, 5.0) == 0.0
    assert -2.0 < height(20.0, 20.0) < -0.5


def test_result_feeds_the_report_and_is_deterministic() -> None:
    sample = SAMPLES["circle"]
    first = verify(read_program(sample.text), sample.targets, **MACHINE)
    second = verify(read_program(sample.text), sample.targets, **MACHINE)
    assert first.operations == second.operations
    assert np.array_equal(first.height_map.height, second.height_map.height)
    figures = first.operations[0].figures("offset", 1, "pocket").to_dict()
    assert figures["arcs"] == 48
    assert figures["rapids_in_stock"] == 0
    assert first.resolution == pytest.approx(3.0 / 40)


def test_faults_are_json_ready() -> None:
    result = verify(Program("empty", ()), (target(),), **MACHINE)
    data = [fault.to_dict() for fault in result.faults]
    assert data[0]["place"] == [None, None, None]
    assert "uncut" in str(result.faults[-1])


@pytest.mark.parametrize(
    "changes", [{"depth": 0.0}, {"tool_radius": -1.0}, {"region": shapely.Polygon()}]
)
def test_bad_targets_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(InputError):
        target(**changes)


def test_bad_arguments_are_refused() -> None:
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    builder.line(20.0, 20.0, -2.0, 100.0)
    with pytest.raises(InputError, match="no target"):
        verify(program(builder), (), **MACHINE)
    with pytest.raises(InputError, match="acceleration"):
        verify(program(builder), (target(),), **(MACHINE | {"acceleration": 0.0}))
    with pytest.raises(InputError, match="operation 7"):
        verify(program(builder, operation=7), (target(),), **MACHINE)


def test_foreign_code_is_matched_by_tool() -> None:
    builder = ToolpathBuilder((20.0, 20.0, 5.0))
    builder.line(20.0, 20.0, -2.0, 100.0)
    two = (target(tool_number=1), target(operation=1, tool_radius=1.5, tool_number=2))
    result = verify(program(builder, operation=-1, tool_number=2), two, **MACHINE)
    assert result.operations[1].moves == 1
    unknown = (target(), target(operation=1))
    with pytest.raises(InputError, match="cannot tell"):
        verify(program(builder, operation=-1), unknown, **MACHINE)


def other_judge() -> ModuleType:
    """The independent judge, where it and its compiler are at hand."""
    pytest.importorskip("numba")
    file = FilePath(__file__).resolve().parents[2] / "shared" / "tools" / "gcode_judge.py"
    if not file.exists():
        pytest.skip(f"{file.name} is not at hand")
    spec = importlib.util.spec_from_file_location("gcode_judge", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its compiled code, when cached, is found by this name
    spec.loader.exec_module(module)
    return module


def test_figures_agree_with_the_independent_judge() -> None:
    other = other_judge()
    for sample in (SAMPLES["circle"], SAMPLES["zigzag"], SAMPLES["island"]):
        compare(other, sample)


def compare(other: ModuleType, sample: Sample) -> None:
    asked = sample.targets[0]
    text = sample.text
    shifted = "\n".join(
        line.replace("X28.0000", "X28.0700") if sample.name == "zigzag" else line
        for line in text.splitlines()
    )
    expected = other.measure(
        shifted,
        asked.region,
        asked.depth,
        asked.tool_radius,
        stepdown=asked.stepdown,
    )
    result = verify(read_program(shifted), sample.targets, **MACHINE)
    figures = result.operations[0]
    assert figures.max_gouge_mm == pytest.approx(expected["gouge_mm"], abs=1e-3)
    assert figures.rapids_in_stock == expected["rapid_hits"] == 0
    share = 100 * figures.uncut_area_mm2 / figures.reachable_area_mm2
    assert share == pytest.approx(expected["uncut_pct"], abs=0.05)
    # The other judge also counts stock that the rim touches without cutting: it may report more.
    assert figures.p99_engagement_deg == pytest.approx(expected["eng_p99"], abs=8)
    assert figures.max_engagement_deg <= expected["eng_max"] + 6
    assert figures.cut_length_mm == pytest.approx(expected["cut_mm"], rel=1e-3)
    assert figures.time_s == pytest.approx(expected["time_s"], rel=0.1)
    assert figures.retracts == expected["retracts"]


def test_a_long_program_is_judged_in_seconds() -> None:
    """50,000 short moves; the bar is 5 s for 100,000, checked loosely here for slow machines."""
    builder = ToolpathBuilder((3.0, 3.0, 5.0))
    builder.line(3.0, 3.0, -1.0, 100.0)
    for row in range(50):
        y = 3.0 + row * 0.5
        for column in np.linspace(3, 37, 1000)[:: 1 if row % 2 == 0 else -1]:
            builder.line(float(column), y, -1.0, 900.0)
    start = time.process_time()
    result = judge(builder, target(entry="plunge", depth=1.0))
    assert time.process_time() - start < 10.0
    assert result.operations[0].moves == 50_001


def test_counts_without_judgement_are_those_of_the_judgement() -> None:
    sample = SAMPLES["two tools"]
    read = read_program(sample.text)
    counts = count_program(read, sample.targets, **MACHINE, stock_top=0.0)
    for result in verify(read, sample.targets, **MACHINE).operations:
        for name, value in vars(counts[result.operation]).items():
            assert getattr(result, name) == value
