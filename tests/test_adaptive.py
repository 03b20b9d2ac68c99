"""Laws of clearing at bounded engagement, measured with polygons and disks alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path as FilePath

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import solveh_banded
from scipy.spatial import cKDTree

from adaptive_measure import Track, engagement, longest_over, swept, track
from grassfire.errors import InputError, PlanningError
from grassfire.geometry import Arc, Bezier, Line, Loop, Region, flatten
from grassfire.job import Job, parse_job
from grassfire.medial import medial_axis
from grassfire.plan import plan_operation
from grassfire.plan.adaptive import CRESCENT, AdaptivePocket, adaptive_pockets
from grassfire.plan.arcs import Curve, fewest_arcs
from grassfire.plan.banded import solved
from grassfire.plan.boundary import Boundary
from grassfire.plan.chains import Writer
from grassfire.plan.fronts import SPIKE as SHARPEST
from grassfire.plan.fronts import (
    Disks,
    Front,
    Fronts,
    densified,
    direction,
    joined,
    leaving,
    length,
    runs,
    swept_edge,
    touching,
    unspiked,
)
from grassfire.plan.path import Path, from_loop
from grassfire.plan.places import BoolArray, Places
from grassfire.plan.pursuit import unit, wrapped
from grassfire.plan.smooth import rounded, tangent_link, two_arcs
from grassfire.plan.stock import Stock
from grassfire.plan.strategy import ClearingSettings
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.plan.tracing import Piece, Start, Surroundings, Tracer
from grassfire.plan.walls import Walls, mirrored, mirrored_path
from grassfire.report import Finding
from grassfire.toolpath import FloatArray, Role

RADIUS = 3.0
RESOLUTION = 1.0
"""Of the rim of the measurement, degrees."""

JOB = """
[input]
file = "pocket.dxf"
[[tools]]
number = 1
diameter = 6.0
spindle_speed = 18000
feed = 1200
plunge_feed = 400
[[operations]]
strategy = "adaptive"
tool = 1
depth = 3.0
"""


def box(x0: float, y0: float, x1: float, y1: float) -> Loop:
    """An upright rectangle."""
    return Loop.from_points([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


ELL = [(0, 0), (32, 0), (32, 14), (14, 14), (14, 30), (0, 30)]
CROSS = [(3.6, 3.6), (24, 3.6), (24, -3.6), (3.6, -3.6), (3.6, -20), (-3.6, -20)]
CROSS += [(-x, -y) for x, y in CROSS]
SPIKE = [(0, 0), (20, 0), (44, 6.5), (20, 13), (0, 13)]
DEAD_END = [(0, 0), (18, 0), (18, 6), (32, 6), (32, 12.3), (18, 12.3), (18, 20), (0, 20)]

REGIONS: dict[str, Callable[[], Region]] = {
    "rectangle": lambda: Region(box(-15, -10, 15, 10), ()),
    "ell": lambda: Region(Loop.from_points(ELL), ()),
    "triangle": lambda: Region(Loop.from_points([(0, 0), (40, 0), (12, 30)]), ()),
    "island": lambda: Region(
        box(0, 0, 36, 26), (Loop((Arc(np.array([20.0, 13.0]), 4.0, 0.0, 2 * np.pi),)),)
    ),
    "corridor": lambda: Region(box(0, 0, 40, 7.2), ()),
    "dead end": lambda: Region(Loop.from_points(DEAD_END), ()),
    "cross": lambda: Region(Loop.from_points(CROSS), ()),
    "spike": lambda: Region(Loop.from_points(SPIKE), ()),
}

LEFT = 0.25
"""Thickness of what passes above the last one may leave at walls and in corners, mm."""

LONGEST_OVER = {
    ("rectangle", 0.4): 0.2,
    ("ell", 0.4): 0.2,
    ("triangle", 0.4): 0.4,
    ("island", 0.4): 0.25,
    ("corridor", 0.4): 0.5,
    ("dead end", 0.4): 0.6,
    ("cross", 0.4): 0.6,
    ("spike", 0.4): 0.3,
    ("rectangle", 0.2): 0.2,
    ("corridor", 0.2): 0.6,
    ("spike", 0.2): 0.4,
}
"""Length for which the engagement may be more than 2 degrees above the limit, mm."""


def settings_of(
    part: float = 0.4,
    climb: bool = True,
    both: bool = False,
    finish: bool = True,
    tightest: float = 0.0,
) -> ClearingSettings:
    """For a 6 mm tool, at a width of cut as a part of the diameter."""
    return ClearingSettings(
        tool_radius=RADIUS,
        wall=RADIUS - 2e-4,
        stepover=2 * RADIUS * part,
        engagement=float(np.arccos(1 - 2 * part)),
        tolerance=7e-4,
        entry="helix",
        slope=float(np.radians(3.0)),
        drop=3.5,
        step=3.0,
        climb=climb,
        both=both,
        finish=finish,
        fast_links=False,
        longest_walk=40.0,
        minimum_radius=tightest,
    )


def plan(region: Region, part: float = 0.4, **others: bool) -> list[Stroke]:
    """All strokes of the last pass over a region, its wall pass included."""
    pockets, _ = adaptive_pockets(medial_axis(region), settings_of(part, **others))
    for pocket in pockets:
        pocket.plan(pocket.peak)
    return [
        stroke
        for pocket in pockets
        for stroke in [*pocket.strokes, *pocket.finish]
        if not stroke.between
    ]


@cache
def planned(name: str, part: float = 0.4, both: bool = False) -> tuple[Stroke, ...]:
    """The same for a region of the list."""
    return tuple(plan(REGIONS[name](), part, both=both))


@cache
def area_of(name: str) -> shapely.Polygon:
    """A region of the list as a polygon."""
    region = REGIONS[name]()
    return shapely.Polygon(
        flatten(region.outer, 1e-4), [flatten(loop, 1e-4) for loop in region.islands]
    )


# -- what the tool meets --------------------------------------------------------------------------


def grazing(angle: FloatArray, way: Track) -> float:
    """Longest stretch of ways through cleared area with more than 28 degrees in stock, mm.

    They may graze it by a hundredth of the tool radius, and films in corners by three.
    """
    return longest_over(np.where(way.air, angle, 0.0), way.gap, 28.0)


@pytest.mark.parametrize(("name", "part"), LONGEST_OVER)
def test_engagement_keeps_to_the_limit(name: str, part: float) -> None:
    start, way = track(planned(name, part))
    angle = np.degrees(engagement(area_of(name), start, way, RADIUS))
    limit = np.degrees(np.arccos(1 - 2 * part)) + RESOLUTION
    assert longest_over(angle, way.gap, limit + 2.0) <= LONGEST_OVER[name, part]
    assert longest_over(angle, way.gap, limit + 6.0) <= 0.2
    # a cut that never came near the limit would waste time; corridors are laid out lower
    near = 12.0 if name in ("corridor", "cross") else 5.0
    assert np.percentile(angle[angle > 0], 90) > limit - near
    assert grazing(angle, way) <= 0.1
    # what is left for the last lap is a light cut, but for the very corners
    finishing = np.where(way.role == Role.FINISH, angle, 0.0)
    assert longest_over(finishing, way.gap, 30.0) <= 0.4


@pytest.mark.parametrize("name", ["rectangle", "ell", "island", "dead end"])
def test_cuts_both_ways_keep_to_the_limit_and_save_ways_back(name: str) -> None:
    start, way = track(planned(name, both=True))
    angle = np.degrees(engagement(area_of(name), start, way, RADIUS))
    limit = np.degrees(np.arccos(1 - 2 * 0.4)) + RESOLUTION
    assert longest_over(angle, way.gap, limit + 6.0) <= 0.2
    assert grazing(angle, way) <= 0.1
    back = [
        sum(
            stroke.path.length
            for stroke in planned(name, both=both)
            # tips are cut bit by bit both ways
            if stroke.air and stroke.path.length > 0.1 * RADIUS
        )
        for both in (False, True)
    ]
    assert back[1] < 0.85 * back[0]


@pytest.mark.parametrize("both", [False, True])
@pytest.mark.parametrize("name", REGIONS)
def test_tool_keeps_to_the_pocket_and_clears_it(name: str, both: bool) -> None:
    strokes, area = planned(name, both=both), area_of(name)
    way = track(strokes)[1]
    assert shapely.distance(shapely.points(way.points), area.boundary).min() >= RADIUS - 0.004
    assert shapely.contains_xy(area, way.points).all()
    reached = area.buffer(-RADIUS + 2e-4, quad_segs=64).buffer(RADIUS - 2e-4, quad_segs=64)
    assert reached.difference(swept(strokes, RADIUS)).area <= 5e-4 * reached.area


@pytest.mark.parametrize("name", REGIONS)
def test_strokes_follow_each_other(name: str) -> None:
    strokes = planned(name)
    assert strokes[0].kind is StrokeKind.DESCEND
    for before, after in pairwise(strokes):
        if after.kind is StrokeKind.FEED:
            assert np.hypot(*(before.path.end - after.path.start)) < 1e-6


@pytest.mark.parametrize("name", REGIONS)
def test_one_region_needs_few_retracts(name: str) -> None:
    assert sum(stroke.kind is StrokeKind.HOP for stroke in planned(name)) <= 1


def test_the_same_twice() -> None:
    for one, two in zip(planned("island"), plan(REGIONS["island"]()), strict=True):
        assert one.kind is two.kind and one.role is two.role
        assert np.array_equal(one.path.points, two.path.points)
        assert np.array_equal(one.path.sweep, two.path.sweep)


def test_conventional_is_the_mirror_image_of_climb() -> None:
    region = REGIONS["ell"]()
    image = region.transformed(np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]))
    climb, conventional = plan(region), plan(image, climb=False)
    for one, two in zip(climb, conventional, strict=True):
        assert one.kind is two.kind and one.role is two.role
        # samples at the edge of rounding move knots of arcs by some nanometres
        assert mirrored(two.path.points) == pytest.approx(one.path.points, abs=1e-5)
        assert two.path.sweep == pytest.approx(-one.path.sweep, abs=1e-5)


def test_without_a_finishing_pass_films_alone_are_cut_along_the_wall() -> None:
    """The last lap of the spiral in a circle is a lap along the wall: there is no other one."""
    circle = Region(Loop((Arc(np.zeros(2), 14.0, 0.0, 2 * np.pi),)), ())
    strokes = plan(circle, finish=False)
    lap = 2 * np.pi * (14.0 - RADIUS)
    assert not any(stroke.role is Role.FINISH for stroke in strokes)
    assert strokes[-1].path.length < 0.2 * lap or strokes[-1].path.length > lap
    area = shapely.Point(0, 0).buffer(14.0, quad_segs=256)
    reached = area.buffer(-RADIUS + 2e-4, quad_segs=64).buffer(RADIUS - 2e-4, quad_segs=64)
    left = reached.difference(swept(strokes, RADIUS))
    assert left.area <= 5e-4 * reached.area


def reached_by_tool(area: shapely.Polygon) -> shapely.Polygon:
    """What the tool can clear of a pocket."""
    return area.buffer(-RADIUS + 2e-4, quad_segs=64).buffer(RADIUS - 2e-4, quad_segs=64)


def polygon(count: int, radius: float) -> FloatArray:
    """Corners of a regular polygon."""
    return radius * unit(np.arange(count) * 2 * np.pi / count)


def test_films_are_thinner_in_small_pockets() -> None:
    """Of a pocket hardly wider than the tool a film all round is no small part."""
    corners = polygon(22, 1.52 * RADIUS)
    strokes = plan(Region(Loop.from_points(corners), ()), 0.2, finish=False)
    reached = reached_by_tool(shapely.Polygon(corners))
    assert reached.difference(swept(strokes, RADIUS)).area <= 1e-3 * reached.area


@pytest.mark.parametrize("radius", [1.6, 2.2, 5.0, 30.0])
def test_the_last_lap_is_light_in_small_round_pockets(radius: float) -> None:
    """It takes what the opening spiral leaves at the full depth, all passes at once."""
    circle = Region(Loop((Arc(np.zeros(2), radius * RADIUS, 0.0, 2 * np.pi),)), ())
    (pocket,) = adaptive_pockets(medial_axis(circle), settings_of())[0]
    assert isinstance(pocket, AdaptivePocket)
    rim = np.array([radius - 1, 0.0]) + unit(np.radians(np.arange(0.0, 90.0, 0.1)))
    stock = np.hypot(*rim.T) > radius - pocket._crescent()
    assert np.degrees(CRESCENT) == pytest.approx(0.1 * np.count_nonzero(stock), abs=0.2)


@pytest.mark.parametrize("climb", [True, False])
def test_the_opening_spiral_turns_as_asked(climb: bool) -> None:
    strokes = plan(REGIONS["rectangle"](), climb=climb)
    spiral = next(stroke for stroke in strokes if stroke.role is Role.CUT)
    first = spiral.path.sweep[spiral.path.sweep != 0][:20]
    assert np.all((first > 0) == climb)


@pytest.mark.parametrize("name", REGIONS)
def test_passes_above_the_last_leave_no_stock_for_it(name: str) -> None:
    """The wall pass may come at the last depth alone: what stays above it is thin."""
    pockets, _ = adaptive_pockets(medial_axis(REGIONS[name]()), settings_of())
    pockets[0].plan(pockets[0].peak)
    area = area_of(name)
    reached = area.buffer(-RADIUS + 2e-4, quad_segs=64).buffer(RADIUS - 2e-4, quad_segs=64)
    left = reached.difference(swept(pockets[0].strokes, RADIUS))
    assert left.buffer(-LEFT / 2).is_empty
    assert left.area <= 8e-3 * reached.area


def test_what_lies_behind_a_neck_for_no_cut_is_cleared() -> None:
    """Two rooms and a neck in which the tool has 0.01 mm to either side."""
    half = RADIUS + 0.01
    corners = [(0, 0), (20, 0), (20, 10 - half), (26, 10 - half), (26, 0), (46, 0)]
    corners += [(x, 20 - y) for x, y in corners[::-1]]
    region = Region(Loop.from_points(corners), ())
    pockets, _ = adaptive_pockets(medial_axis(region), settings_of())
    assert len(pockets) == 1
    pockets[0].plan(pockets[0].peak)
    strokes = [*pockets[0].strokes, *pockets[0].finish]
    area = shapely.Polygon(corners)
    reached = area.buffer(-RADIUS + 2e-4, quad_segs=64).buffer(RADIUS - 2e-4, quad_segs=64)
    assert reached.difference(swept(strokes, RADIUS)).area <= 5e-4 * reached.area


# -- jobs, findings, errors -----------------------------------------------------------------------


def job_of(*lines: str) -> Job:
    """A job with more lines in its operation."""
    return parse_job(JOB + "\n".join(lines), FilePath("job.toml"))


def cut_length(job: Job) -> float:
    """Length of a planned rectangle, mm."""
    axis = medial_axis(REGIONS["rectangle"]())
    found = plan_operation([axis], job.operations[0], job.tools[0], job)
    return float(np.nansum(found.toolpath.length))


def test_limit_by_angle_is_limit_by_width() -> None:
    angle = np.degrees(np.arccos(1 - 2 * 0.3))
    by_width = cut_length(job_of("stepover = 0.3"))
    assert cut_length(job_of(f"engagement_angle = {angle:.12f}")) == pytest.approx(by_width)
    assert cut_length(job_of("engagement_angle = 40.0")) > 1.5 * by_width


def test_cuts_both_ways_are_refused_where_they_are_not_offered() -> None:
    text = JOB.replace('"adaptive"', '"offset"') + 'direction = "both"'
    with pytest.raises(InputError, match="'both' is offered by strategy 'adaptive' alone"):
        parse_job(text, FilePath("job.toml"))


@pytest.mark.parametrize("entry", ["plunge", "ramp"])
def test_entries_that_begin_with_a_slot_are_refused(entry: str) -> None:
    with pytest.raises(InputError, match="enters by helix"):
        job_of(f'entry = "{entry}"')


def findings_of(width: float) -> tuple[int, list[Finding]]:
    """Number of pockets and findings of a straight slot."""
    axis = medial_axis(Region(box(0, 0, 40, width), ()))
    pockets, findings = adaptive_pockets(axis, settings_of())
    return len(pockets), findings


def test_a_slot_hardly_wider_than_the_tool_is_told() -> None:
    count, findings = findings_of(6.2)
    assert count == 1
    assert [finding.code for finding in findings] == ["full-width"]
    assert findings[0].size == pytest.approx(6.2)


def test_a_pocket_that_the_tool_does_not_fit_is_an_error() -> None:
    job = job_of()
    axis = medial_axis(Region(box(0, 0, 40, 5.9), ()))
    with pytest.raises(PlanningError, match="fits nowhere"):
        plan_operation([axis], job.operations[0], job.tools[0], job)


# -- fronts ---------------------------------------------------------------------------------------


def bent(seed: int, count: int = 60) -> FloatArray:
    """A gently bent chain that does not meet itself."""
    random = np.random.default_rng(seed)
    heading = np.cumsum(random.uniform(-0.12, 0.12, count))
    heading = np.clip(heading, -1.0, 1.0)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * unit(heading), axis=0)])


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_swept_edge_is_the_right_side_of_the_swept_area(seed: int) -> None:
    chain = bent(seed)
    edge, piece = swept_edge(chain, RADIUS, 0.1)
    line = shapely.LineString(chain)
    away = shapely.distance(shapely.points(edge), line)
    outer = edge[away >= RADIUS - 1e-6]
    assert away.max() <= RADIUS + 1e-9
    side = line.buffer(-RADIUS, single_sided=True, quad_segs=64)
    assert shapely.distance(shapely.points(outer), side).max() < 2e-3
    # and all of it: what is as far from the chain as the radius, on its right
    rim = shapely.get_coordinates(shapely.segmentize(side.exterior, 0.2))
    rim = rim[shapely.distance(shapely.points(rim), line) > RADIUS - 1e-3]
    assert shapely.distance(shapely.points(rim), shapely.LineString(outer)).max() < 0.01
    assert np.all(np.diff(piece) >= 0) and piece.max() < len(chain) - 1


def within(points: FloatArray, tolerance: float) -> Curve:
    """Samples with the same tolerance on either side."""
    return Curve(points, *np.full((2, len(points)), tolerance))


def test_samples_in_the_wrong_order_make_no_loop() -> None:
    """A turn on the spot may go back by less than a micrometre."""
    points = np.array([[0.0, 0.0], [-1e-4, 0.0], [-2e-4, 1e-5], [0.005, 0.0], [0.012, 0.0]])
    path = fewest_arcs([within(points, 6e-3)])[0]
    assert np.abs(path.sweep).max() <= np.pi / 2
    assert np.abs(path.sample(1e-4)[0]).max(axis=0) == pytest.approx([0.012, 0.0], abs=5e-4)


@pytest.mark.parametrize("turn", [1.0, 2.0, 5.0])
def test_a_right_turn_on_the_spot_leaves_no_fold(turn: float) -> None:
    heading = np.radians(np.where(np.arange(40) < 20, 0.0, -turn))
    chain = np.concatenate([np.zeros((1, 2)), np.cumsum(0.15 * unit(heading), axis=0)])
    edge, piece = swept_edge(chain, RADIUS, 0.15)
    along = unit(heading[np.minimum(piece[1:], 39)])
    assert np.all(np.sum(np.diff(edge, axis=0) * along, axis=1) > 0)
    assert np.hypot(*np.diff(edge, axis=0).T).max() < 0.6


def test_a_chain_without_length_sweeps_no_edge() -> None:
    edge, piece = swept_edge(np.zeros((3, 2)), RADIUS, 0.1)
    assert len(edge) == len(piece) == 0


def test_densified_chains_keep_their_points() -> None:
    chain = bent(5)
    fine = densified(chain, 0.11)
    assert np.hypot(*np.diff(fine, axis=0).T).max() <= 0.11
    assert length(fine) == pytest.approx(length(chain), abs=1e-9)
    assert shapely.distance(shapely.points(chain), shapely.MultiPoint(fine)).max() < 1e-12


def test_runs_are_maximal_and_part_at_gaps() -> None:
    chain = np.stack([np.arange(10.0), np.zeros(10)], axis=1)
    chain[7:, 0] += 5.0
    good = np.array([1, 1, 0, 0, 1, 1, 1, 1, 1, 0], dtype=bool)
    assert [part[:, 0].tolist() for part in runs(chain, good, 2.0)] == [
        [0.0, 1.0],
        [4.0, 5.0, 6.0],
        [12.0, 13.0],
    ]
    assert runs(chain, np.zeros(10, dtype=bool), 2.0) == []


def far_from_walls(points: np.ndarray) -> np.ndarray:
    """Clearance of an open field."""
    return np.full(len(points), 100.0)


def test_fronts_that_continue_each_other_are_one() -> None:
    chain = densified(bent(8), 0.15)
    halves = [Front(chain[100:]), Front(chain[:100])]
    (whole,) = joined(halves, RADIUS, 0.15, far_from_walls)
    assert whole.length == pytest.approx(length(chain), abs=0.05)
    assert whole.points[0] == pytest.approx(chain[0])
    apart = [Front(chain[:100]), Front(chain[100:] + np.array([0.0, 2.0]))]
    assert len(joined(apart, RADIUS, 0.15, far_from_walls)) == 2


def test_a_scrap_at_the_end_of_a_front_leaves_the_front_whole() -> None:
    """A scrap that ends where a front ends does not go on there: all of that would be lost."""
    chain = np.stack([np.arange(60) * 0.15, np.zeros(60)], axis=1)
    scrap = np.stack([np.arange(-4, 1) * 0.15, np.arange(-4, 1) * 0.02], axis=1)
    kept = joined([Front(chain[-4] + scrap), Front(chain)], RADIUS, 0.15, far_from_walls)
    assert sum(front.length for front in kept) > 0.9 * length(chain)


def test_spirals_of_very_many_turns_are_fitted_in_parts() -> None:
    angle = np.sqrt(np.linspace(0.5, 1.2e5, 45000))
    points = 3.0 * angle[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    width = np.full(len(points), 0.0315)
    (path,) = fewest_arcs([Curve(points, width, width)])
    assert len(path) < len(points) / 8
    assert path.start == pytest.approx(points[0]) and path.end == pytest.approx(points[-1])
    places = path.sample(0.5)[0]
    off = cKDTree(places).query(points[::50])[0]
    assert off.max() < 0.3


def scattered(count: int) -> list[Front]:
    """Short fronts all over a field of 60 mm."""
    random = np.random.default_rng(count)
    return [
        Front(random.uniform(0, 60, 2) + np.cumsum(random.normal(0, 0.2, (30, 2)), axis=0))
        for _ in range(count)
    ]


def test_places_near_fronts_are_those_near_any_of_their_points() -> None:
    fronts = scattered(40)
    every = np.concatenate([front.points for front in fronts])
    places = np.random.default_rng(1).uniform(0, 60, (500, 2))
    gap = np.hypot(*(places[:, None] - every[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.array_equal(Fronts(fronts).within(places, 2.5), gap < 2.5)
    assert not Fronts().within(places, 2.5).any()
    assert not Fronts(fronts).within(np.zeros((0, 2)), 2.5).size


def test_disks_cut_fronts_apart_and_leave_others_as_they_are() -> None:
    fronts = scattered(40)
    centres = np.random.default_rng(3).uniform(20, 40, (50, 2))
    parts = Fronts(fronts).outside(Places(centres), 2.0, 5.0)
    whole = []
    for front in fronts:
        gap = np.hypot(*(front.points[:, None] - centres[None]).transpose(2, 0, 1)).min(axis=1)
        whole += [front] if gap.min() > 2.0 else []
        own = [part for part in parts if any(np.isin(part.points[:, 0], front.points[:, 0]))]
        assert sum(len(part) for part in own) == np.count_nonzero(gap > 2.0)
    assert [front for front in parts if front in fronts] == whole
    assert 0 < len(whole) < len(fronts)
    untouched = Fronts(whole)
    assert untouched.outside(Places(centres), 2.0, 5.0) is untouched


def test_fronts_are_added_and_left_out_with_their_boxes() -> None:
    fronts = scattered(12)
    few = Fronts(fronts[:5]).plus(fronts[6:]).without(2)
    kept = [*fronts[:2], *fronts[3:5], *fronts[6:]]
    assert list(few) == kept and few[1] is fronts[1] and few[-2:] == tuple(kept[-2:])
    assert few.plus([]) is few
    places = np.random.default_rng(4).uniform(0, 60, (300, 2))
    assert np.array_equal(few.within(places, 3.0), Fronts(kept).within(places, 3.0))


def test_fronts_that_were_refused_once_are_not_compared_again() -> None:
    chain = densified(bent(8), 0.15)
    apart = [Front(chain[:100]), Front(chain[100:] + np.array([0.0, 2.0]))]
    settled = joined(apart, RADIUS, 0.15, far_from_walls)
    assert all(front.settled for front in settled)
    assert len(joined(settled, RADIUS, 0.15, far_from_walls)) == 2
    # one that continues the first is compared with all
    assert len(joined([*settled, Front(chain[100:])], RADIUS, 0.15, far_from_walls)) == 2


def test_disks_know_what_is_within_reach() -> None:
    random = np.random.default_rng(2)
    parts = [random.uniform(0, 50, (count, 2)) for count in (40, 3, 90, 1, 400)]
    disks, every = Disks(), np.concatenate(parts)
    for part in parts:
        disks.add(part)
    asked = random.uniform(0, 50, (60, 2))
    gap = np.hypot(*(asked[:, None] - every[None]).transpose(2, 0, 1)).min(axis=1)
    for reach in (0.5, 2.0, 100.0):
        assert np.array_equal(disks.within(asked, reach), gap < reach)
    assert disks.within(asked[:0], 2.0).shape == (0,)


@pytest.mark.parametrize("count", [3, 60, 900])
def test_touched_places_are_those_of_all_pairs(count: int) -> None:
    random = np.random.default_rng(count)
    places = random.uniform(0, 40, (count, 2))
    fronts = [(Front(random.uniform(0, 40, (size, 2))), 1.0 + size / 900) for size in (2, 90, 800)]
    around = (0.0, 0.0, 40.0, 40.0)
    expected = np.zeros(count, dtype=bool)
    for front, reach in fronts:
        gap = np.hypot(*(places[:, None] - front.points[None]).transpose(2, 0, 1)).min(axis=1)
        expected |= gap < reach
    assert np.array_equal(touching(places, around, fronts), expected)
    assert not touching(places, around, []).any()


# -- walls ----------------------------------------------------------------------------------------


def test_wall_samples_go_round_and_slices_follow_them() -> None:
    axis = medial_axis(REGIONS["rectangle"]())
    corners = np.array([[-12, -7], [12, -7], [12, 7], [-12, 7], [-12, -7]], dtype=float)
    ring = Path(corners, np.full((4, 2), np.nan), np.zeros(4))
    for reflect in (False, True):
        walls = Walls(axis, [ring], wall=3.0, step=0.15, reflect=reflect)
        count = len(walls.points)
        assert np.array_equal(walls.ahead(5, 4), [5, 6, 7, 8])
        assert np.array_equal(walls.behind(1, 3), [1, 0, count - 1])
        assert len(walls.ahead(0, 10 * count)) == count
        assert walls.clearance(walls.points) == pytest.approx(3.0, abs=1e-9)
        # the pocket stays on the left: the sense of the ring is that of climbing
        x, y = walls.points.T
        assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0
        for start, stop in ((3, 90), (count - 4, 20), (50, 0)):
            part = walls.slice(start, stop)
            assert part is not None
            assert part.start == pytest.approx(walls.points[start], abs=1e-9)
            assert part.end == pytest.approx(walls.points[stop], abs=1e-9)
        assert walls.slice(7, 7) is None
        assert walls.frame(walls.frame(corners)) == pytest.approx(corners)


@pytest.mark.parametrize("bare", [0, 1, 17, 100])
def test_stretches_all_round_begin_at_a_sample_without_a_flag(bare: int) -> None:
    """A way along all of a ring that began in stock could not be reached."""
    _, walls = tracer_in_a_box(0.4)
    flags = np.ones(len(walls.points), dtype=bool)
    flags[bare] = False
    ((low, high),) = walls.stretches(flags, 3)
    assert low == bare and walls.steps(low, high) == len(flags) - 1


@pytest.mark.parametrize("kind", sorted(REGIONS))
def test_prepared_distances_are_those_of_the_axis(kind: str) -> None:
    axis = medial_axis(REGIONS[kind]())
    left, low, right, high = axis.region.bounds()
    places = np.random.default_rng(5).uniform((left - 9, low - 9), (right + 9, high + 9), (9000, 2))
    # joints, where two sites are as near, and places beside them
    joints = np.array([curve.start for loop in axis.region.loops for curve in loop.curves])
    places = np.concatenate([places, joints, *(joints + step for step in (1e-3, -1e-3, 0.3))])
    boundary = Boundary(axis, 3.0)
    exact = axis.clearance(places)
    assert boundary.clearance(places) == pytest.approx(exact, abs=1e-9)
    assert boundary.clearance(places[:0]).shape == (0,)
    # what is enough may be less than it is, but no less than enough
    bound = boundary.clearance(places, 2.0)
    assert np.array_equal(bound >= 2.0, exact >= 2.0)
    assert bound[bound < 2.0] == pytest.approx(exact[exact < 2.0], abs=1e-9)
    assert np.all(bound <= exact + 1e-9)


def test_curves_other_than_lines_and_arcs_are_left_to_the_axis() -> None:
    bend = Bezier(np.array([[0.0, 0], [10, -6], [30, 8], [40, 0]]), None)
    right = Line(np.array([40.0, 0.0]), np.array([20.0, 30.0]))
    left = Line(np.array([20.0, 30.0]), np.array([0.0, 0.0]))
    axis = medial_axis(Region(Loop((bend, right, left)), ()))
    assert not Boundary.suits(axis)
    rings = [
        from_loop(loop, 1e-4) for node in axis.offset_tree(np.array([3.0])) for loop in node.loops
    ]
    walls = Walls(axis, rings, wall=3.0, step=0.15)
    places = np.random.default_rng(2).uniform((0.0, 0.0), (40.0, 30.0), (2000, 2))
    room = axis.clearance(places) - 3.0
    inside = room > 0
    assert np.all(walls.room(places[inside]) <= room[inside] + 1e-3)
    near = np.abs(room) < 0.1
    assert walls.room(places[near]) == pytest.approx(room[near], abs=1e-9)
    assert walls.clearance(places) == pytest.approx(room + 3.0)


BOX = np.array([[-12, -7], [12, -7], [12, 7], [-12, 7], [-12, -7]], dtype=float)
"""Wall ring of a pocket of 30 by 20 mm."""


def tracer_in_a_box(part: float, film: float = 0.1) -> tuple[Tracer, Walls]:
    axis = medial_axis(Region(box(-15, -10, 15, 10), ()))
    walls = Walls(axis, [Path(BOX, np.full((4, 2), np.nan), np.zeros(4))], wall=3.0, step=0.15)
    return Tracer(walls, RADIUS, float(np.arccos(1 - 2 * part)), film), walls


@pytest.mark.parametrize(
    ("begin", "stop", "end"),
    [
        (20.0, 20.0, 8.9),  # no other front
        (5.0, 20.0, 2.8),  # half of the rim is in stock where its front comes 2.2 mm in
        (5.0, 5.1, 8.9),  # a wall of stock as thin as a hair, hardly an angle of the rim
    ],
)
def test_a_cut_along_a_wall_ends_in_stock_of_another_front(
    begin: float, stop: float, end: float
) -> None:
    """A film along the wall leads into stock that fills the pocket between two places."""
    tracer, walls = tracer_in_a_box(0.4)
    along = np.arange(-6.0, 9.0, 0.15)
    film = np.stack([along, np.full(len(along), -9.7)], axis=1)
    other = np.stack([np.full(100, begin), np.linspace(-9.9, 9.9, 100)], axis=1)
    beside = Surroundings(
        lambda places, reach: other,
        lambda places, reach: (places[:, 0] < begin) | (places[:, 0] > stop),
    )
    first = walls.nearest(np.array([-6.0, -7.0]))
    cut = tracer.cut(film, Start(first, walls.points[first], 0.0), beside)
    assert cut[-1].points[-1] == pytest.approx([end, -7.0], abs=0.3)


def test_a_cut_through_the_open_ends_in_stock_of_another_front() -> None:
    tracer, _ = tracer_in_a_box(0.4)
    along = np.arange(-6.0, 9.0, 0.15)
    front = np.stack([along, np.full(len(along), -1.0)], axis=1)
    other = np.stack([np.full(100, 5.0), np.linspace(-9.9, 9.9, 100)], axis=1)
    ends = []
    for stock in (math.inf, 5.0):
        beside = Surroundings(
            lambda places, reach: other,
            lambda places, reach, stock=stock: (places[:, 1] > -1.0) & (places[:, 0] < stock),
        )
        start = Start(-1, np.array([-9.44, -0.4]), 0.0, 0.5)
        ends.append(float(tracer.cut(front, start, beside)[-1].points[-1, 0]))
    assert ends[0] > 7.0 and 1.5 < ends[1] < 2.5


@pytest.mark.parametrize("shift", np.linspace(0.0, 0.15, 8).tolist())
@pytest.mark.parametrize("slant", [0.9, 1.1, 1.3])
def test_a_cut_that_meets_a_wall_does_not_turn_into_the_stock_there(
    slant: float, shift: float
) -> None:
    """It goes on to the wall as it came, wherever the samples of the wall are."""
    tracer, _ = tracer_in_a_box(0.2)
    ahead = np.array([math.cos(slant), math.sin(slant)])
    front = np.array([shift, 9.9]) + np.arange(-13.0, 0.0, 0.15)[:, None] * ahead
    alone = Surroundings(
        lambda places, reach: np.zeros((0, 2)), lambda places, reach: np.ones(len(places), bool)
    )
    start = tracer.start(front, 3.0, lambda places: np.ones(len(places), bool))
    pieces = tracer.cut(front, start, alone)
    points = np.concatenate([piece.points for piece in pieces if piece.free])
    last = points[-1] - points[-2]
    assert points[-1][1] == pytest.approx(7.0, abs=2e-3)
    assert math.hypot(*last) > 0.01
    assert math.atan2(last[1], last[0]) == pytest.approx(slant, abs=0.02)
    assert all(piece.long for piece in pieces[1:])


@pytest.mark.parametrize("shift", np.linspace(0.0, 0.15, 8).tolist())
@pytest.mark.parametrize("slant", [2.2, 2.5, 2.8])
def test_a_cut_goes_on_along_a_wall_from_where_it_meets_it(slant: float, shift: float) -> None:
    """Its front has few points: two samples further on what lies between would be cut short."""
    tracer, _ = tracer_in_a_box(0.4)
    ahead = np.array([math.cos(slant), math.sin(slant)])
    corner = np.array([shift, 9.5])
    rise = corner + np.arange(-8.0, 0.1, 0.3)[:, None] * ahead
    film = corner - np.arange(0.3, 9.0, 0.3)[:, None] * np.array([1.0, 0.0])
    front = np.concatenate([rise, film])
    alone = Surroundings(
        lambda places, reach: np.zeros((0, 2)), lambda places, reach: np.ones(len(places), bool)
    )
    start = tracer.start(front, 3.0, lambda places: np.ones(len(places), bool))
    free, wall, *_ = tracer.cut(front, start, alone)
    assert free.points[-1][1] == pytest.approx(7.0, abs=2e-3)
    gap = wall.points[0] - free.points[-1]
    assert wall.points[-1][0] < -1.0
    assert -0.151 < gap[0] < 1e-9


@given(st.integers(0, 2**32 - 1), st.integers(3, 60))
def test_fronts_have_no_near_points_and_do_not_turn_back(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    step = random.choice([0.15, 0.05, 0.01, 0.001], size=(count, 1))
    chain = np.cumsum(step * unit(random.normal(0, 1.0, count)), axis=0)
    found = unspiked(chain, 0.015)
    chord = found[1:] - found[:-1]
    size = np.hypot(*chord.T)
    assert np.array_equal(found[[0, -1]], chain[[0, -1]])
    assert len(found) == 2 or size.min() > 0.015
    turn = (chord[1:] * chord[:-1]).sum(axis=1) / np.maximum(size[1:] * size[:-1], 1e-300)
    assert np.all(turn >= SHARPEST - 1e-12)


def test_the_first_points_of_a_front_tell_its_direction() -> None:
    """Four of them in a hundredth of a millimetre, as two parts of an edge once met."""
    down = np.stack([np.zeros(40), -0.15 * np.arange(1, 41)], axis=1)
    fold = np.array([[0.0, 0.0], [-0.002, 0.010], [-0.003, 0.013], [-0.0046, 0.0033]])
    front = unspiked(np.concatenate([fold, down]), 0.015)
    assert direction(front[:4]) == pytest.approx(-np.pi / 2, abs=0.01)
    assert leaving(np.concatenate([fold, down]), 0.015) == pytest.approx(-np.pi / 2, abs=0.01)
    tracer, _ = tracer_in_a_box(0.2)
    start = tracer.start(front, 3.0, lambda places: np.ones(len(places), bool))
    assert start.heading == pytest.approx(-np.pi / 2, abs=0.01)


@pytest.mark.parametrize("heading", [2.4, 2.7, 3.0])
def test_a_cut_led_in_across_its_front_ends_at_the_limit(heading: float) -> None:
    """Its front runs down, but is said to begin in another direction."""
    tracer, _ = tracer_in_a_box(0.2)
    down = np.stack([np.zeros(40), -0.15 * np.arange(40)], axis=1)
    beside = Surroundings(
        lambda places, reach: np.zeros((0, 2)), lambda places, reach: places[:, 0] > 0
    )
    limit, lead = float(np.arccos(1 - 0.4)), 4.5
    bearing = heading - np.pi / 2 + limit
    place = -lead * unit(heading) - RADIUS * unit(bearing)
    pieces = tracer.cut(down, Start(-1, place, heading, lead), beside)
    points = np.concatenate([piece.points for piece in pieces])
    headings = np.concatenate([piece.heading for piece in pieces])
    assert not tracer.past(beside.cleared, points, headings, limit + np.radians(8.0)).any()


@pytest.mark.parametrize(("begin", "end", "counted"), [(0, 60, 60), (0, 8, 0), (30, 60, 30)])
def test_stock_that_stands_on_a_wall_counts_down_to_its_foot(
    begin: float, end: float, counted: float
) -> None:
    """Along a wall, stock between two angles of the rim from there on; a film alone is none."""
    tracer, _ = tracer_in_a_box(0.2)
    place, heading = np.array([[0.0, -7.0]]), np.zeros(1)

    def cleared(places: FloatArray, reach: float) -> BoolArray:
        offset = places - place[0]
        turn = np.degrees(np.arctan2(offset[:, 1], offset[:, 0])) + 90
        return np.asarray((turn < begin) | (turn > end))

    past = [
        tracer.past(cleared, place, heading, np.radians(limit + 0.5), 0.005)[0]
        for limit in range(0, 90, 3)
    ]
    assert sum(past) * 3 == counted


def test_fronts_that_are_left_to_the_last_lap_are_told_of() -> None:
    """Where no cleared way leads to a front, what is behind it is cut in full width."""
    pockets, _ = adaptive_pockets(medial_axis(REGIONS["rectangle"]()), settings_of())
    (pocket,) = pockets
    assert isinstance(pocket, AdaptivePocket)
    along = np.arange(0.0, 8.0, 0.15)
    front = Front(np.stack([along, np.zeros(len(along))], axis=1))
    for size, told in ((8, 0), (len(along), 1)):
        pocket._stock.fronts = Fronts([Front(front.points[:size])])
        pocket._give_up(0)
        assert not pocket._stock.fronts and len(pocket._stock.left) == 1 + told
        assert len(pocket._slots) == told
    pocket._tell_slots()
    assert [finding.code for finding in pocket.findings] == ["full-width"]


def test_a_slot_as_wide_as_the_tool_off_a_room_is_told() -> None:
    """A cut along the wall does not run into it: there the rim meets the front beside the tool."""
    corners = [(0, 0), (30, 0), (30, 7), (60, 7), (60, 13), (30, 13), (30, 20), (0, 20)]
    pockets, _ = adaptive_pockets(medial_axis(Region(Loop.from_points(corners), ())), settings_of())
    (pocket,) = pockets
    pocket.plan(pocket.peak)
    cuts = [stroke.path for stroke in pocket.strokes if stroke.role is Role.CUT]
    assert {"full-width"} == {item.code for item in pocket.findings}
    assert max(path.points[:, 0].max() for path in cuts) > 56
    area = shapely.Polygon(corners)
    strokes = [*pocket.strokes, *pocket.finish]
    reached = area.buffer(-RADIUS + 2e-4, join_style="mitre").buffer(RADIUS - 2e-4, quad_segs=64)
    assert reached.difference(swept(strokes, RADIUS)).area <= 5e-4 * reached.area


def test_links_bend_no_tighter_than_asked_and_tight_cuts_are_told_of() -> None:
    axis, least = medial_axis(REGIONS["rectangle"]()), []
    for tightest in (0.0, 1.5):
        (pocket,) = adaptive_pockets(axis, settings_of(tightest=tightest))[0]
        pocket.plan(pocket.peak)
        radii = [stroke.path.radius for stroke in pocket.strokes if stroke.role is Role.LINK]
        least.append(np.concatenate(radii).min())
        found = [finding for finding in pocket.findings if finding.code == "tight-turns"]
        cuts = [stroke.path.radius for stroke in pocket.strokes if stroke.role is Role.CUT]
        tight = np.concatenate(cuts)
        assert [finding.size for finding in found] == [tight.min()] * (tightest > 0)
    assert least[0] < 1.5 - 1e-9 <= least[1]
    assert tight.min() < 1.5


def test_a_pocket_that_the_helix_clears_has_no_cuts() -> None:
    circle = Region(Loop((Arc(np.zeros(2), RADIUS + 0.6, 0.0, 2 * np.pi),)), ())
    (pocket,) = adaptive_pockets(medial_axis(circle), settings_of(tightest=0.6))[0]
    pocket.plan(pocket.peak)
    assert not any(stroke.role is Role.CUT for stroke in pocket.strokes)
    assert not pocket.findings


def test_a_helix_that_enters_again_clears_what_was_left_there() -> None:
    """Edges of what it has cut away would bar all ways to what is left round it."""
    _, walls = tracer_in_a_box(0.4)
    stock = Stock(walls, RADIUS, 0.15)
    along = np.arange(-6.0, 6.0, 0.15)
    stock.left = Fronts([Front(np.stack([along, np.full(len(along), 1.0)], axis=1))])
    stock.entered(2.0 * unit(np.linspace(0.0, 2 * np.pi, 60)))
    assert len(stock.left) == 2
    for front in stock.left:
        gap = np.hypot(*front.points.T)
        assert 4.9 < gap.min() < 5.2 and gap.max() > 5.9
    assert stock.cleared.within(np.array([[4.9, 0.0]]), RADIUS).all()


def test_cuts_shorter_than_they_may_be_off_are_none() -> None:
    speck = np.array([[0.0, 0.0], [0.0004, 0.0], [0.0004, 0.0006]])
    assert not Piece(speck, np.zeros(3), np.ones(3)).long
    assert Piece(10 * speck, np.zeros(3), np.ones(3)).long
    assert not Piece(speck[:1], np.zeros(1), np.ones(1)).long


@pytest.mark.parametrize("hook", [10.0, 13.5, 17.0])
def test_a_cut_does_not_go_back(hook: float) -> None:
    """At a small engagement a kink in a front as tight as the tool moves the way far."""
    tracer, _ = tracer_in_a_box(0.00025)
    turn = np.radians([136.7 - hook, *(136.7 + 2.83 * np.arange(20))])
    size = np.array([0.028, *(20 * [0.148])])
    start = RADIUS * unit(np.radians(45.1))
    front = start + np.cumsum(np.vstack([np.zeros(2), size[:, None] * unit(turn)]), axis=0)
    alone = Surroundings(
        lambda places, reach: np.zeros((0, 2)), lambda places, reach: np.ones(len(places), bool)
    )
    for piece in tracer.cut(front, Start(-1, np.zeros(2), float(turn[0])), alone):
        gone = np.sum(np.diff(piece.points, axis=0) * unit(piece.heading[1:]), axis=1)
        assert np.all(gone > -0.0021 * RADIUS)


def test_tips_are_cut_bit_by_bit() -> None:
    """Where there is no room to swing, each bit is followed by a way back over it."""
    strokes, tip = planned("spike", 0.2), np.array([44.0, 6.5])
    bits = [
        (before.path.length, after.path)
        for before, after in pairwise(strokes)
        if before.role is Role.CUT and after.air and after.path.length < 0.1 * RADIUS
        if np.hypot(*(after.path.start - tip)) < 20.0
    ]
    assert len(bits) >= 4
    for forth, back in bits[1:]:
        assert forth <= 0.12 * RADIUS and back.length <= 0.081 * RADIUS


def test_ways_along_walls_leave_edges_of_the_stock_on_their_left() -> None:
    """What a lap has passed by would else be taken for cleared, and links would go through it."""
    pockets, _ = adaptive_pockets(medial_axis(REGIONS["rectangle"]()), settings_of())
    (pocket,) = pockets
    assert isinstance(pocket, AdaptivePocket)
    place, heading = pocket._walls.points[0], float(pocket._walls.heading[0])
    _, _, whole = pocket._cut_corners([(0, 40)], place, heading, False)
    assert whole and not pocket._steps, "a slot is not for while the tool is on its way"
    pocket._cut_corners([(0, 90)], place, heading, True)
    pocket._tell_slots()
    assert [finding.code for finding in pocket.findings] == ["full-width"]
    (front,) = pocket._stock.fronts
    along, off = pocket._walls.heading[20], pocket._walls.points[20]
    beside = np.min(np.hypot(*(front.points - (off + RADIUS * unit(along + np.pi / 2))).T))
    assert beside < 0.1
    # the stock is on its right: beyond the edge
    middle = len(front) // 2
    ahead = front.points[middle + 1] - front.points[middle]
    right = front.points[middle] + unit(float(np.arctan2(ahead[1], ahead[0])) - np.pi / 2)
    assert pocket._walls.distance(right[None])[0] > RADIUS


@settings(max_examples=100, deadline=None)
@given(
    count=st.integers(3, 11),
    begin=st.tuples(st.floats(-5.5, 0.0), st.floats(-9.95, -8.0)),
    bearing=st.floats(-3.1, 3.1),
    bend=st.floats(-0.5, 0.5),
)
@example(count=4, begin=(-0.18129, -9.85247), bearing=2.51704, bend=-0.09788)
@example(count=3, begin=(-0.33793, -9.47703), bearing=2.18194, bend=0.24178)
def test_a_cut_does_not_leave_a_wall_outwards(
    count: int, begin: tuple[float, float], bearing: float, bend: float
) -> None:
    """The rim meets no end of a front that is inside the disk: a radius back from it is outside."""
    tracer, walls = tracer_in_a_box(0.4)
    first = walls.nearest(np.array([-6.0, -7.0]))
    front = begin + 0.15 * np.cumsum(unit(bearing + bend * np.arange(count)), axis=0)
    nothing = Surroundings(lambda p, r: np.zeros((0, 2)), lambda p, r: np.ones(len(p), dtype=bool))
    for piece in tracer.cut(front, Start(first, walls.points[first], 0.0), nothing):
        assert walls.clearance(piece.points).min() > 3.0 - 1.6e-3


def test_a_cut_that_comes_back_at_once_is_not_written() -> None:
    """From a wall and back to it within less than a micrometre, as in tips of stars."""
    _, walls = tracer_in_a_box(0.2)
    wall = Piece(walls.points[5:6], walls.heading[5:6], np.zeros(1), np.array([5]))
    cuts = []
    for away, count in ((4e-4, 5), (0.5, 30)):
        turn = np.linspace(0.0, 2 * np.pi, count)
        loop = walls.points[5] + away * (unit(turn) - [1.0, 0.0])
        cuts.append([wall, Piece(loop, turn + np.pi / 2, np.full(count, away)), wall])
    none, path = Writer(walls, RADIUS, 0.15).paths(cuts)
    assert none is None
    assert path is not None and path.length == pytest.approx(np.pi, abs=0.2)


@pytest.mark.parametrize("part", [0.03, 0.1, 0.4])
def test_the_opening_spiral_winds_on_at_any_width(part: float) -> None:
    """A chord where the first lap leaves its front would be too sharp a corner for thin cuts."""
    tracer, walls = tracer_in_a_box(part)
    angle = np.linspace(0, 2 * np.pi, 168)
    pieces = tracer.spiral(4.0 * unit(angle), 7.0, lambda front: 0)
    assert walls.clearance(pieces[-1].points).min() == pytest.approx(3.0, abs=0.01)
    turned = sum(float(np.ptp(np.unwrap(piece.heading))) for piece in pieces if len(piece.heading))
    assert turned > 2 * np.pi


def test_mirrored_paths_turn_the_other_way() -> None:
    path = Path(np.array([[2.0, 0], [0, 2.0]]), np.zeros((1, 2)), np.array([np.pi / 2]))
    image = mirrored_path(path)
    assert image.sweep[0] == -path.sweep[0]
    assert mirrored(image.sample(0.1)[0]) == pytest.approx(path.sample(0.1)[0])


# -- smooth ways ----------------------------------------------------------------------------------


def corner_angles(path: Path) -> FloatArray:
    """Turns where pieces meet, radians."""
    chord = np.diff(path.points, axis=0)
    direction = np.arctan2(chord[:, 1], chord[:, 0])
    leave, arrive = direction - path.sweep / 2, direction + path.sweep / 2
    return np.abs(wrapped(leave[1:] - arrive[:-1]))


def turned_right(vector: FloatArray) -> FloatArray:
    return np.array([vector[1], -vector[0]])


def oval(count: int) -> FloatArray:
    """Once and a bit round an ellipse that is drawn along."""
    angle = np.linspace(0.0, 7.0, count)
    return np.stack([30 * np.cos(angle) + angle, 12 * np.sin(angle)], axis=1)


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
def test_fitted_paths_keep_to_samples_without_corners(tolerance: float) -> None:
    points = oval(1500)
    path, finer = fewest_arcs([within(points, tolerance / part) for part in (1, 10)])
    assert max(path.nearest(point).distance for point in points[::11]) <= tolerance * 1.03
    assert max(finer.nearest(point).distance for point in points[::11]) <= tolerance * 0.103
    assert corner_angles(path).max() < 1e-6 and corner_angles(finer).max() < 1e-6
    assert np.array_equal(path.start, points[0]) and np.array_equal(path.end, points[-1])
    assert len(path) < len(finer)


def test_a_path_lies_on_the_side_that_is_free() -> None:
    points = oval(1500)
    free, none = np.full(1500, 0.05), np.full(1500, 1e-4)
    for right, left in ((free, none), (none, free)):
        (path,) = fewest_arcs([Curve(points, right, left)])
        chord = points[2:] - points[:-2]
        sides = [
            float(ahead @ turned_right(path.nearest(place).point - place)) / math.hypot(*ahead)
            for place, ahead in zip(points[1:-1:7], chord[::7], strict=True)
        ]
        assert -right[0] * 1.1 - 1e-3 <= min(sides) and max(sides) <= left[0] * 1.1 + 1e-3
        assert max(np.abs(sides)) > 0.02


def test_few_arcs_are_as_few_as_curvature_asks_for() -> None:
    """An arc of length l differs from a spiral of even change of curvature by change l^3 / 125."""
    along = np.linspace(0.0, 40.0, 800)
    change, tolerance = 4e-3, 0.02
    middle = (along[1:] + along[:-1]) / 2
    points = np.cumsum(0.05 * unit(change * middle**2 / 2), axis=0)
    (path,) = fewest_arcs([within(points, tolerance)])
    assert len(path) <= math.ceil(40.0 / (125 * tolerance / change) ** (1 / 3)) + 1


def test_paths_leave_in_given_directions() -> None:
    """Few samples tell little of how a curve bends beside its ends."""
    angle = np.array([0.0, 0.3, 0.9, 1.6, 2.4, 3.1])
    points = np.concatenate([[[1.0, -1.0]], unit(angle)])
    wide = np.full(len(points), 0.05)
    for leave in (np.pi / 2, np.pi / 2 - 0.1):
        (path,) = fewest_arcs([Curve(points, wide, wide, leave)])
        chord = path.points[1] - path.points[0]
        heading = math.atan2(chord[1], chord[0]) - path.sweep[0] / 2
        assert -np.radians(2.1) <= wrapped(heading - leave) <= np.radians(6.1)


def test_a_straight_way_is_lines() -> None:
    points = np.stack([np.linspace(0, 50, 200), np.zeros(200)], axis=1)
    (path,) = fewest_arcs([within(points, 1e-3)])
    assert np.all(path.sweep == 0.0)
    assert path.length == pytest.approx(50.0)


def test_curves_fitted_together_are_those_fitted_alone() -> None:
    random = np.random.default_rng(7)
    curves = []
    for count in (2, 300, 41, 1000, 3):
        heading = np.cumsum(random.normal(0, 0.05, count))
        curves.append(within(np.cumsum(0.1 * unit(heading), axis=0), 2e-3))
    for path, curve in zip(fewest_arcs(curves), curves, strict=True):
        (alone,) = fewest_arcs([curve])
        assert np.array_equal(path.points, alone.points)
        assert np.array_equal(path.sweep, alone.sweep)
        assert np.array_equal(path.end, curve.points[-1])
    assert fewest_arcs([]) == []


@pytest.mark.parametrize("count", [3, 7, 8, 9, 63, 64, 65, 66, 128, 129, 1000])
def test_banded_systems_are_solved_as_scipy_does_and_as_if_each_were_alone(count: int) -> None:
    random = np.random.default_rng(count)
    band = random.normal(0, 0.5, size=(3, 4, count))
    band[2] = 4 + random.uniform(size=(4, count))
    wanted = random.normal(size=(4, count))
    sizes = np.array([count, 3, max(count // 2, 3), count])
    for row, size in enumerate(sizes.tolist()):
        band[:2, row, size:], band[2, row, size:], wanted[row, size:] = 0.0, 1e-5, 0.0
    found = solved(band, wanted, sizes)
    for row, size in enumerate(sizes.tolist()):
        expected = solveh_banded(band[:, row, :size], wanted[row, :size])
        np.testing.assert_allclose(found[row, :size], expected, rtol=1e-12, atol=1e-14)
        alone = solved(band[:, row : row + 1], wanted[row : row + 1], sizes[row : row + 1])
        assert np.array_equal(found[row, :size], alone[0, :size])


@settings(max_examples=60, deadline=None)
@given(
    end=st.tuples(st.floats(-40, 40), st.floats(-40, 40)),
    leave=st.floats(-3.1, 3.1),
    arrive=st.floats(-3.1, 3.1),
    radius=st.floats(0.3, 3.0),
)
def test_links_leave_and_arrive_as_tangents_and_turn_left(
    end: tuple[float, float], leave: float, arrive: float, radius: float
) -> None:
    start, stop = np.zeros(2), np.array(end)
    link = tangent_link(start, leave, stop, arrive, radius)
    if link is None:
        assert np.hypot(*stop) < 1e-5
        return
    assert link.start == pytest.approx(start, abs=1e-5)
    assert link.end == pytest.approx(stop, abs=1e-5)
    assert np.all(link.sweep >= 0)
    chord = np.diff(link.points, axis=0)
    direction = np.arctan2(chord[:, 1], chord[:, 0])
    slack = 1e-4 / min(1.0, float(np.min(link.lengths)))
    assert abs(wrapped(direction[0] - link.sweep[0] / 2 - leave)) < slack
    assert abs(wrapped(direction[-1] + link.sweep[-1] / 2 - arrive)) < slack


def test_two_arcs_to_a_place_straight_beside() -> None:
    """Equal headings across the way: what is under the root is nothing but rounding."""
    for angle in np.linspace(-3.0, 3.0, 200).tolist():
        beside = 7.0 * unit(angle + np.pi / 2)
        assert two_arcs(np.zeros(2), angle, beside, angle) is None


@settings(max_examples=60, deadline=None)
@given(
    end=st.tuples(st.floats(-40, 40), st.floats(-40, 40)),
    leave=st.floats(-3.1, 3.1),
    arrive=st.floats(-3.1, 3.1),
)
@example(end=(-1.0, 0.0), leave=1.3791201197745982e-296, arrive=0.0)
@example(end=(-1.0, 0.0), leave=1e-5, arrive=0.0)
def test_two_arcs_are_tangent_and_turn_left(
    end: tuple[float, float], leave: float, arrive: float
) -> None:
    stop = np.array(end)
    link = two_arcs(np.zeros(2), leave, stop, arrive)
    if link is None:
        return
    assert np.array_equal(link.end, stop) and len(link) == 2
    assert np.all(link.sweep > 0) and link.sweep.max() < np.radians(201)
    chord = np.diff(link.points, axis=0)
    direction = np.arctan2(chord[:, 1], chord[:, 0])
    assert abs(wrapped(direction[0] - link.sweep[0] / 2 - leave)) < 1e-6
    assert abs(wrapped(direction[1] + link.sweep[1] / 2 - arrive)) < 1e-6
    assert corner_angles(link).max() < 1e-6


def test_no_link_between_a_place_and_itself() -> None:
    assert tangent_link(np.ones(2), 0.5, np.ones(2), 0.5, 1.0) is None
    for end in (np.zeros(2), np.array([0.0, 2e-225]), np.array([5e-10, 0.0])):
        assert two_arcs(np.zeros(2), 0.0, end, 2.0) is None


def test_rounded_chains_have_no_corners_and_stay_near() -> None:
    corners = np.array([[0, 0], [10, 0], [10, 6], [16, 6], [16, 6.5], [30, 6.5]], dtype=float)
    chain = Path(corners, np.full((5, 2), np.nan), np.zeros(5))
    smooth = rounded(chain, 1.5)
    assert corner_angles(smooth).max() < 1e-6
    assert smooth.length < chain.length
    line = shapely.LineString(corners)
    assert shapely.distance(shapely.points(smooth.sample(0.05)[0]), line).max() < 1.5
