"""Laws of ways between cuts, of orders that save travel, and of what moves on them are fed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from grassfire.app.stages import machining_order
from grassfire.dxf import Drawing
from grassfire.job import Job
from grassfire.plan.entry import plunge
from grassfire.plan.link import Interior, RingSet
from grassfire.plan.offset import offset_pockets
from grassfire.plan.operation import _feeds, _levels, _settings
from grassfire.plan.order import by_tool, tour
from grassfire.plan.path import Path, circle, segment
from grassfire.plan.rings import rounded
from grassfire.plan.roadmap import RoadMap, tightened
from grassfire.plan.strategy import PocketPlan
from grassfire.plan.strokes import Emitter, Levels, Stroke, StrokeKind
from grassfire.toolpath import MoveKind, Role, Toolpath, ToolpathBuilder
from test_plan import axis_of, job_of, planned, shape

TOOL = 3.0


def pockets_of(name: str, **operation: Any) -> list[PocketPlan]:
    """Pockets of a region, laid out from its first peak."""
    job = job_of(**operation)
    chosen = job.operations[0]
    tool = job.tool(1)
    levels, feeds = _levels(job, chosen), _feeds(chosen, tool, 2.0)
    found, _ = offset_pockets(axis_of(name), _settings(chosen, tool, job, levels, feeds, 2.0, 3))
    for pocket in found:
        pocket.plan(pocket.peak)
    return found


def retracts(path: Toolpath) -> int:
    """Rapids up from below the top of the stock."""
    up = (path.kind == MoveKind.RAPID) & (path.end[:, 2] > path.begin[:, 2] + 1e-9)
    return int(np.count_nonzero(up & (path.begin[:, 2] < 0)))


@pytest.mark.parametrize("name", ["islands", "near islands", "annulus", "ell", "wave"])
@pytest.mark.parametrize("stepover", [0.4, 0.2])
def test_a_connected_pocket_is_left_for_descents_of_the_first_pass_only(
    name: str, stepover: float
) -> None:
    path = planned(name, stepover=stepover, link_feed=5000.0, finish_pass=False).toolpath
    first = pockets_of(name, stepover=stepover, link_feed=5000.0)[0].strokes
    descents = sum(stroke.kind is StrokeKind.DESCEND for stroke in first)
    assert retracts(path) == descents
    assert descents == 1 or name == "islands"


@pytest.mark.parametrize("name", ["islands", "near islands", "annulus", "tight neck"])
def test_links_in_air_cut_nothing(name: str) -> None:
    """What the strokes before have swept covers the tool wherever a link is said to be in air."""
    for pocket in pockets_of(name, link_feed=5000.0, stepover=0.3):
        swept = shapely.Polygon()
        for stroke in pocket.strokes:
            if stroke.path.length == 0:
                continue
            trace = shapely.LineString(stroke.path.sample(0.1)[0])
            if stroke.air and stroke.kind is StrokeKind.FEED:
                needed = trace.buffer(TOOL - 0.03)
                assert needed.difference(swept).area <= 1e-3 * needed.area
            elif stroke.kind is StrokeKind.FEED:
                swept = swept.union(trace.buffer(TOOL, quad_segs=32))


@pytest.mark.parametrize("name", ["islands", "near islands", "ell", "wave"])
def test_ways_to_descents_keep_to_the_pocket(name: str) -> None:
    axis = axis_of(name)
    for pocket in pockets_of(name, link_feed=5000.0):
        for before, stroke in zip(
            [pocket.strokes[-1], *pocket.strokes[:-1]], pocket.strokes, strict=True
        ):
            if stroke.approach is None:
                continue
            assert np.array_equal(stroke.approach.end, stroke.path.start)
            assert np.array_equal(stroke.approach.start, before.path.end)
            points = stroke.approach.sample(0.05)[0]
            assert axis.clearance(points).min() >= TOOL - 5e-3


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6))
def test_ways_stay_inside(seed: int) -> None:
    axis = axis_of("islands")
    wall = TOOL - 2e-4
    road = RoadMap(axis, wall, 1.5)
    loops = [loop for node in axis.offset_tree(np.array([wall])) for loop in node.loops]
    from grassfire.plan.path import from_loop

    rings = [from_loop(loop, 1e-3) for loop in loops]
    inside = Interior(axis, rings, wall)
    places = road.component(wall + 0.1, axis.largest_disk()[0])
    generator = np.random.default_rng(seed)
    ends = [ring.at(generator.random(1) * ring.length)[0] for ring in generator.choice(rings, 2)]
    way = road.way(ends[0], ends[1], inside, places)
    assert way is not None
    assert np.array_equal(way.start, ends[0]) and np.array_equal(way.end, ends[1])
    assert axis.clearance(way.sample(0.05)[0]).min() >= wall - 2e-3
    tight = tightened(way, inside)
    assert np.array_equal(tight.start, ends[0]) and np.array_equal(tight.end, ends[1])
    assert tight.length <= way.length + 1e-9
    assert axis.clearance(tight.sample(0.05)[0]).min() >= wall - 2e-3


def test_corners_move_inwards_as_far_as_their_sides_stay_clear() -> None:
    """Round a square island: the way over its far side is drawn in to its corner."""

    class Outside:
        """Everything but a square about the origin."""

        def holds(self, starts: Any, ends: Any, certain: Any = None) -> Any:
            square = shapely.box(-1.0, -1.0, 1.0, 1.0)
            ways = shapely.linestrings(np.stack([starts, ends], axis=1))
            return ~shapely.intersects(ways, square)

    corners = np.array([[-3.0, 0.0], [0.0, 9.0], [3.0, 0.0]])
    way = Path(corners, np.full((2, 2), np.nan), np.zeros(2))
    tight = tightened(way, Outside())
    assert 1.5 < tight.points[1][1] < 3.0
    straight = Path(corners + np.array([0.0, 9.0]), way.centre, way.sweep)
    assert len(tightened(straight, Outside())) == 1


def test_no_way_leads_through_a_closed_neck() -> None:
    axis = axis_of("closed neck")
    road = RoadMap(axis, TOOL, 1.5)
    nodes = axis.offset_tree(np.array([TOOL]))
    assert len(nodes) == 2
    left, right = (road.component(TOOL + 0.1, node.peak) for node in nodes)
    assert left.any() and right.any() and not np.any(left & right)


def corner_ring(angle: float) -> Path:
    """A rhombus with a sharp corner at the origin, counter-clockwise."""
    side = 40 * np.array([math.cos(angle / 2), math.sin(angle / 2)])
    points = np.array([[0.0, 0.0], side * [1, -1], [2 * side[0], 0.0], side, [0.0, 0.0]])
    return Path(points, np.full((4, 2), np.nan), np.zeros(4))


@settings(max_examples=40, deadline=None)
@given(st.floats(0.3, 2.8), st.floats(0.1, 3.0), st.floats(0.05, 1.0))
def test_rounded_corners_move_by_no_more_than_allowed(
    angle: float, radius: float, most: float
) -> None:
    ring = corner_ring(angle)
    made = rounded([ring], radius, most)[0]
    assert made.closed
    inner = shapely.Polygon(made.sample(0.1)[0])
    outer = shapely.Polygon(ring.points)
    assert inner.difference(outer).area <= 1e-9
    for corner in ring.points[:-1]:
        assert made.nearest(corner).distance <= most * 1.01
    assert made.length <= ring.length
    tangents = [(made.tangent(at - 1e-7), made.tangent(at + 1e-7)) for at in made.cumulative[1:-1]]
    rounded_ones = made.is_arc[:-1] | made.is_arc[1:]
    for (one, other), smooth in zip(tangents, rounded_ones, strict=True):
        assert not smooth or one @ other > 1 - 1e-6


def test_rings_without_sharp_corners_stay_as_they_are() -> None:
    ring = circle(np.zeros(2), np.array([5.0, 0.0]), 1)
    assert rounded([ring], 1.0, 0.5)[0] is ring
    assert rounded([], 1.0, 0.5) == []


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 40), st.booleans())
def test_tours_visit_all_and_are_no_longer_than_nearest_neighbours(
    seed: int, count: int, known: bool
) -> None:
    points = np.random.default_rng(seed).random((count, 2)) * 100
    start = np.array([-5.0, 3.0]) if known else None
    order = tour(points, start)
    assert sorted(order.tolist()) == list(range(count))
    assert np.array_equal(order, tour(points, start))

    def length(sequence: list[int]) -> float:
        way = points[sequence]
        way = way if start is None else np.concatenate([start[None], way])
        return float(np.sum(np.hypot(*np.diff(way, axis=0).T))) if len(way) > 1 else 0.0

    greedy: list[int] = []
    left = list(range(count))
    here = start if known else (points[0] if count else None)
    while left:
        gaps = [math.dist(points[index], here) for index in left]
        greedy.append(left.pop(int(np.argmin(gaps))))
        here = points[greedy[-1]]
    assert length(order.tolist()) <= length(greedy) * (1 + 1e-9)


@given(st.lists(st.integers(1, 3), max_size=8), st.integers(0, 2**28))
def test_operations_keep_what_must_come_first(tools: list[int], bits: int) -> None:
    earlier = [
        frozenset(one for one in range(index) if bits >> (index * 3 + one) & 1)
        for index in range(len(tools))
    ]
    order = by_tool(tools, earlier)
    assert sorted(order) == list(range(len(tools)))
    for index in order:
        assert all(order.index(one) < order.index(index) for one in earlier[index])


def test_operations_with_one_tool_follow_each_other_where_they_may() -> None:
    free: list[frozenset[int]] = [frozenset()] * 4
    assert by_tool([1, 2, 1, 2], free) == [0, 2, 1, 3]
    assert by_tool([1, 2, 1], [frozenset(), frozenset({0}), frozenset({1})]) == [0, 1, 2]


def test_operations_are_regrouped_by_tool_only_where_their_regions_are_apart() -> None:
    tool = {"spindle_speed": 9000, "feed": 900, "plunge_feed": 300}
    operation = {"strategy": "offset", "depth": 1.0}
    data = {
        "name": "order",
        "input": {"file": "order.dxf"},
        "tools": [{"number": 1, "diameter": 6.0, **tool}, {"number": 2, "diameter": 3.0, **tool}],
        "operations": [{"tool": number, **operation} for number in (1, 2, 1)],
    }
    job = Job.model_validate(data, context={"units": "mm"})
    shift = np.array([[1.0, 0.0, 500.0], [0.0, 1.0, 0.0]])
    near, far = (
        Drawing(
            regions=(region,),
            region_layers=((layer,),),
            units="mm",
            units_source="argument",
            layers=(layer,),
            findings=(),
        )
        for layer, region in (
            ("A", axis_of("rectangle").region),
            ("B", axis_of("rectangle").region.transformed(shift)),
        )
    )
    assert machining_order(job, (near, far, near)) == [0, 2, 1]
    assert machining_order(job, (near, near, near)) == [0, 1, 2]


LINK = Path(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]), np.full((2, 2), np.nan), np.zeros(2))


@settings(deadline=None)
@given(st.floats(0.05, 40.0), st.floats(0.001, 3.0))
def test_lifted_links_rise_and_sink_and_end_on_the_floor(lift: float, scale: float) -> None:
    levels = Levels(0.0, 3.0, 15.0, 0.5, 5000.0, lift)
    feeds = _feeds(job_of().operations[0], job_of().tool(1), 2.0)
    builder = ToolpathBuilder((0.0, 0.0, -2.0))
    path = Path(LINK.points * scale, LINK.centre, LINK.sweep)
    stroke = Stroke(StrokeKind.FEED, path, Role.LINK, air=True)
    Emitter(builder, levels, feeds).stroke(stroke, 0.0, -2.0, first_pass=True)
    moves = builder.build()
    assert moves.end[-1].tolist() == [10.0 * scale, 10.0 * scale, -2.0]
    assert moves.end[:, 2].max() <= min(-2.0 + lift, 15.0) + 1e-12
    assert moves.end[:, 2].min() >= -2.0
    assert np.sum(np.hypot(*np.diff(moves.end[:, :2], axis=0, prepend=[[0, 0]]).T)) == (
        pytest.approx(path.length)
    )


def test_cuts_and_links_in_stock_are_never_lifted() -> None:
    levels = Levels(0.0, 3.0, 15.0, 0.5, 5000.0, 1.0)
    feeds = _feeds(job_of().operations[0], job_of().tool(1), 2.0)
    for role, air in ((Role.CUT, False), (Role.LINK, False)):
        builder = ToolpathBuilder((0.0, 0.0, -2.0))
        way = segment(np.zeros(2), np.array([9.0, 0.0]))
        Emitter(builder, levels, feeds).stroke(
            Stroke(StrokeKind.FEED, way, role, air), 0.0, -2.0, first_pass=True
        )
        assert builder.build().end[:, 2].tolist() == [-2.0]


def test_rapids_down_stay_above_what_the_pass_before_has_cleared() -> None:
    """Cuts are fitted: beside a place of the tool a film of the own pass may stand."""
    levels = Levels(0.0, 3.0, 15.0, 0.5, 5000.0, 0.0)
    feeds = _feeds(job_of().operations[0], job_of().tool(1), 2.0)
    builder = ToolpathBuilder((0.0, 0.0, -4.0))
    hop = Stroke(StrokeKind.HOP, plunge(np.array([9.0, 0.0])), Role.LINK)
    Emitter(builder, levels, feeds).stroke(hop, -2.0, -4.0, first_pass=False)
    moves = builder.build()
    rapid = moves.kind == MoveKind.RAPID
    assert moves.end[rapid, 2].tolist() == [3.0, 3.0, -1.5]
    assert moves.end[~rapid, 2].tolist() == [-4.0]


def test_columns_of_moves_are_the_moves_one_by_one() -> None:
    one, many = ToolpathBuilder((0.0, 0.0, 0.0)), ToolpathBuilder((0.0, 0.0, 0.0))
    one.line(1.0, 0.0, -1.0, 300.0, Role.CUT)
    one.arc(3.0, 0.0, -2.0, (2.0, 0.0), True, 200.0, Role.CUT)
    nan = float("nan")
    many.extend(
        [MoveKind.LINE, MoveKind.ARC_CCW],
        [(1.0, 0.0, -1.0), (3.0, 0.0, -2.0)],
        [(nan, nan), (2.0, 0.0)],
        [300.0, 200.0],
        Role.CUT,
    )
    many.extend([], [], [], [], Role.LINK)
    assert many.position == one.position
    for name, column in vars(one.build()).items():
        np.testing.assert_array_equal(getattr(many.build(), name), column)


def test_every_depth_of_a_stroke_differs_in_z_alone() -> None:
    levels = Levels(0.0, 3.0, 15.0, 0.5, 5000.0)
    feeds = _feeds(job_of().operations[0], job_of().tool(1), 2.0)
    builder = ToolpathBuilder((0.0, 0.0, 0.0))
    ring = circle(np.zeros(2), np.array([2.0, 0.0]), 1)
    strokes = [Stroke(StrokeKind.FEED, path, Role.CUT) for path in (ring, LINK)]
    Emitter(builder, levels, feeds).passes(strokes, [], np.array([-1.0, -2.5]))
    moves = builder.build()
    upper, lower = slice(0, len(moves) // 2), slice(len(moves) // 2, None)
    for column in (moves.kind, moves.centre, moves.feed, moves.role, moves.end[:, :2]):
        np.testing.assert_array_equal(column[upper], column[lower])
    assert set(moves.end[upper, 2].tolist()) == {-1.0}
    assert set(moves.end[lower, 2].tolist()) == {-2.5}


def test_chip_thinning_needs_a_known_engagement_and_speeds_up_by_its_sine() -> None:
    for strategy in ("offset", "spiral"):
        with pytest.raises(ValidationError, match="engagement that is known"):
            job_of(strategy=strategy, chip_thinning=True)
    operation = job_of(strategy="adaptive", chip_thinning=True, engagement_angle=45.0).operations[0]
    assert operation.chip_thinning_factor == pytest.approx(math.sqrt(2))
    thin = job_of(strategy="adaptive", chip_thinning=True, stepover=0.02).operations[0]
    assert thin.chip_thinning_factor == 2.0
    wide = job_of(strategy="adaptive", chip_thinning=True, stepover=0.7).operations[0]
    assert wide.chip_thinning_factor == 1.0
    feeds = _feeds(operation, job_of().tool(1), 2.0)
    way = segment(np.zeros(2), np.array([9.0, 0.0]))
    assert feeds.along(way, Role.CUT, steady=True)[0] == pytest.approx(1200 * math.sqrt(2))
    assert feeds.along(way, Role.CUT)[0] == 1200.0
    assert feeds.along(way, Role.CUT, wall=True, steady=True)[0] == 1200.0


def test_a_constant_feed_is_not_slowed_on_arcs() -> None:
    feeds = _feeds(job_of(arc_feed="constant").operations[0], job_of().tool(1), 2.0)
    ring = circle(np.zeros(2), np.array([2.0, 0.0]), 1)
    for role in (Role.CUT, Role.FINISH):
        assert feeds.along(ring, role).tolist() == [1200.0]


@settings(deadline=None)
@given(st.integers(0, 10**6))
def test_ways_across_rings_are_seen_whatever_the_boxes(seed: int) -> None:
    generator = np.random.default_rng(seed)
    ring = circle(generator.random(2) * 10, generator.random(2) * 10 + 12, 1)
    starts, ends = generator.random((20, 2)) * 40 - 10, generator.random((20, 2)) * 40 - 10
    polygon = shapely.LineString(ring.sample(0.01)[0])
    ways = shapely.linestrings(np.stack([starts, ends], axis=1))
    crossed = RingSet([ring]).crossed(starts, ends)
    clear = shapely.distance(ways, polygon) > 0.01
    assert not np.any(crossed & clear)
    assert np.all(crossed | ~shapely.crosses(ways, polygon))


def test_shape_of_the_samples() -> None:
    assert shape("islands").area == pytest.approx(axis_of("islands").region.area, rel=1e-4)
