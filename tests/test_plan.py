"""Laws that every planned operation keeps, on regions with all that makes pockets hard."""

from __future__ import annotations

import importlib.util
import math
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path as FilePath
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree

from grassfire.errors import PlanningError
from grassfire.geometry import Arc, Bezier, Curve, Line, Loop, Region, flatten
from grassfire.job import Job
from grassfire.medial import MedialAxis, medial_axis
from grassfire.plan import PlannedOperation, plan_operation
from grassfire.toolpath import MoveKind, Role, Toolpath

SHARED = FilePath(__file__).resolve().parents[2] / "shared"
GOUGE = 0.005


def polygon(*points: tuple[float, float]) -> Loop:
    """Straight sides between corners."""
    corners = [np.array(point, dtype=float) for point in points]
    follow = corners[1:] + corners[:1]
    return Loop(tuple(Line(a, b) for a, b in zip(corners, follow, strict=True)))


def box(x0: float, y0: float, x1: float, y1: float) -> Loop:
    """An upright rectangle."""
    return polygon((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def round_(x: float, y: float, radius: float) -> Loop:
    """A circle."""
    return Loop((Arc(np.array([x, y]), radius, 0.0, 2 * math.pi),))


def stadium(length: float, radius: float) -> Loop:
    """A slot with round ends."""
    half = math.pi
    return Loop(
        (
            Line(np.array([0.0, -radius]), np.array([length, -radius])),
            Arc(np.array([length, 0.0]), radius, -half / 2, half),
            Line(np.array([length, radius]), np.array([0.0, radius])),
            Arc(np.array([0.0, 0.0]), radius, half / 2, half),
        )
    )


def ell(size: float, width: float) -> Loop:
    """Two arms at a right angle: one reflex corner."""
    return polygon((0, 0), (size, 0), (size, width), (width, width), (width, size), (0, size))


def dumbbell(neck: float) -> Loop:
    """Two squares of 24 mm joined by a corridor 16 mm long."""
    low, high = 12 - neck / 2, 12 + neck / 2
    left = [(0, 0), (24, 0), (24, low), (40, low), (40, 0), (64, 0)]
    right = [(64, 24), (40, 24), (40, high), (24, high), (24, 24), (0, 24)]
    return polygon(*left, *right)


def wave() -> Loop:
    """A free-form outline."""
    lower = Bezier(np.array([[0.0, 0.0], [15.0, -14.0], [30.0, 14.0], [45.0, 0.0]]))
    upper = Bezier(np.array([[45.0, 22.0], [30.0, 32.0], [15.0, 8.0], [0.0, 22.0]]))
    curves: tuple[Curve, ...] = (
        lower,
        Line(lower.end, upper.start),
        upper,
        Line(upper.end, lower.start),
    )
    return Loop(curves)


REGIONS: dict[str, Callable[[], Region]] = {
    "rectangle": lambda: Region(box(0, 0, 60, 40), ()),
    "circle": lambda: Region(round_(5, 5, 20), ()),
    "tight circle": lambda: Region(round_(0, 0, 3.2), ()),
    "annulus": lambda: Region(round_(0, 0, 25), (round_(0, 0, 9),)),
    "exact slot": lambda: Region(stadium(30, 3), ()),
    "wide slot": lambda: Region(stadium(30, 3.4), ()),
    "ell": lambda: Region(ell(45, 16), ()),
    "closed neck": lambda: Region(dumbbell(5), ()),
    "exact neck": lambda: Region(dumbbell(6), ()),
    "tight neck": lambda: Region(dumbbell(6.4), ()),
    "open neck": lambda: Region(dumbbell(11), ()),
    "islands": lambda: Region(
        box(0, 0, 70, 50), (round_(18, 18, 6), round_(48, 26, 9), box(20, 34, 31, 42))
    ),
    "near islands": lambda: Region(
        box(0, 0, 60, 40), (round_(20, 20, 6), round_(38.2, 20, 6), box(26, 5, 30, 9))
    ),
    "wave": lambda: Region(wave(), ()),
}


@cache
def axis_of(name: str) -> MedialAxis:
    """Medial axis of a region of the list."""
    return medial_axis(REGIONS[name]())


def job_of(diameter: float = 6.0, **operation: Any) -> Job:
    """A job with one tool and one operation."""
    settings = {"strategy": "offset", "tool": 1, "depth": 4.0, "stepdown": 2.0}
    tool = {
        "number": 1,
        "diameter": diameter,
        "spindle_speed": 18000,
        "feed": 1200,
        "plunge_feed": 300,
    }
    data = {
        "name": "test",
        "input": {"file": "test.dxf"},
        "tools": [tool],
        "operations": [settings | operation],
    }
    return Job.model_validate(data, context={"units": "mm"})


def planned(*names: str, diameter: float = 6.0, **operation: Any) -> PlannedOperation:
    """The plan of an operation over regions of the list."""
    job = job_of(diameter, **operation)
    axes = [axis_of(name) for name in names]
    return plan_operation(axes, job.operations[0], job.tool(1), job)


def sampled(path: Toolpath, step: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 3) along all moves and the index of each one's move (m,)."""
    begin, end = path.begin, path.end
    begin = np.where(np.isnan(begin), end, begin)
    delta = end - begin
    size = np.maximum(np.hypot(delta[:, 0], delta[:, 1]), np.abs(delta[:, 2]))
    arc, sweep = path.is_arc, path.sweep
    radius = np.hypot(*(begin[:, :2] - path.centre).T)
    size = np.where(arc, np.maximum(size, radius * np.abs(sweep)), size)
    count = np.maximum(1, np.ceil(size / step)).astype(int)
    move = np.repeat(np.arange(len(path)), count + 1)
    part = np.concatenate([np.linspace(0, 1, each + 1) for each in count])
    points = begin[move] + delta[move] * part[:, None]
    offset = begin[move, :2] - path.centre[move]
    angle = sweep[move] * part
    cos, sin = np.cos(angle), np.sin(angle)
    x = path.centre[move, 0] + cos * offset[:, 0] - sin * offset[:, 1]
    y = path.centre[move, 1] + sin * offset[:, 0] + cos * offset[:, 1]
    points[:, 0] = np.where(arc[move], x, points[:, 0])
    points[:, 1] = np.where(arc[move], y, points[:, 1])
    return points, move


def shape(name: str) -> shapely.Polygon:
    """A region as a polygon."""
    region = REGIONS[name]()
    return shapely.Polygon(
        flatten(region.outer, 1e-4), [flatten(island, 1e-4) for island in region.islands]
    )


VARIANTS: list[dict[str, Any]] = [
    {},
    {"direction": "conventional", "entry": "ramp", "stepover": 0.25},
    {"stepover": 0.5, "radial_allowance": 0.15, "axial_allowance": 0.2, "finish_pass": False},
    {"diameter": 2.0, "engagement_angle": 70.0, "link_feed": 4000.0},
]


def radius_of(variant: dict[str, Any]) -> float:
    """Of the tool of a variant, mm."""
    return float(variant.get("diameter", 6.0)) / 2


def plannable(name: str, variant: dict[str, Any]) -> bool:
    """Whether the tool of a variant fits into a region."""
    room = axis_of(name).largest_disk()[1]
    return bool(room >= radius_of(variant) + variant.get("radial_allowance", 0.0))


@cache
def planned_case(name: str, variant: int) -> PlannedOperation:
    """The plan of one case, made once for all laws."""
    return planned(name, **VARIANTS[variant])


SMALL_TOOL = ("circle", "exact slot", "closed neck", "islands", "wave")
CASES = [
    (name, variant)
    for name in REGIONS
    for variant in VARIANTS
    if "diameter" not in variant or name in SMALL_TOOL
]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}-{VARIANTS.index(case[1])}")
def case(request: pytest.FixtureRequest) -> tuple[str, dict[str, Any], PlannedOperation]:
    """A region, the settings and the plan."""
    name, variant = request.param
    if not plannable(name, variant):
        pytest.skip("the tool does not fit")
    return name, variant, planned_case(name, VARIANTS.index(variant))


Case = tuple[str, dict[str, Any], PlannedOperation]


def test_the_tool_keeps_to_the_region_and_the_floor(case: Case) -> None:
    name, variant, plan = case
    points, _ = sampled(plan.toolpath)
    low = points[points[:, 2] < -1e-9]
    wall = radius_of(variant) + variant.get("radial_allowance", 0.0)
    assert axis_of(name).clearance(low[:, :2]).min() >= wall - GOUGE
    assert points[:, 2].min() == pytest.approx(-4.0 + variant.get("axial_allowance", 0.0))


def test_nothing_that_the_tool_reaches_is_left(case: Case) -> None:
    name, variant, plan = case
    radius, allowance = radius_of(variant), variant.get("radial_allowance", 0.0)
    floor = plan.toolpath.end[:, 2].min()
    points, move = sampled(plan.toolpath)
    here = (points[:, 2] <= floor + 1e-9) & (plan.toolpath.kind[move] != MoveKind.RAPID)
    reachable = (
        shape(name)
        .buffer(-radius - allowance + 1e-4, quad_segs=64)
        .buffer(radius - 0.02, quad_segs=64)
    )
    shapely.prepare(reachable)
    xmin, ymin, xmax, ymax = reachable.bounds
    grid = np.stack(np.meshgrid(np.arange(xmin, xmax, 0.1), np.arange(ymin, ymax, 0.1)), axis=-1)
    inside = grid[shapely.contains_xy(reachable, grid[..., 0], grid[..., 1])]
    distance = cKDTree(points[here, :2]).query(inside)[0]
    assert len(inside) > 1000
    assert np.count_nonzero(distance > radius) <= 1e-3 * len(inside)


def test_rapids_move_in_the_plane_or_in_z_and_never_low_across(case: Case) -> None:
    path = case[2].toolpath
    rapid = path.kind == MoveKind.RAPID
    delta = path.end - path.begin
    across = rapid & (np.hypot(delta[:, 0], delta[:, 1]) != 0)
    assert not np.any(across & (delta[:, 2] != 0))
    assert np.all(path.end[across, 2] >= 3.0)
    assert path.start[2] == 15.0 and np.isnan(path.start[:2]).all()
    assert path.end[0, 2] == 15.0
    assert path.end[-1, 2] == 15.0
    assert path.kind[-1] == MoveKind.RAPID


def test_the_tool_never_plunges_into_stock(case: Case) -> None:
    path = case[2].toolpath
    delta = path.end - path.begin
    sinking = (path.kind != MoveKind.RAPID) & (delta[:, 2] < -1e-12)
    entering = sinking & (path.role == Role.ENTRY)
    planar = np.sqrt(np.maximum(path.length**2 - delta[:, 2] ** 2, 0.0))
    assert np.all(-delta[entering, 2] <= planar[entering] * math.tan(math.radians(3.0)) * 1.000001)
    # other descents are links that come down where this depth was cut before
    floors = np.unique(np.round(path.end[path.role == Role.CUT][:, 2], 9))
    for index in np.flatnonzero(sinking & ~entering):
        assert path.role[index] == Role.LINK
        assert np.any(np.isclose(floors, path.end[index, 2]))
        cut = (path.kind[:index] != MoveKind.RAPID) & (path.end[:index, 2] <= path.end[index, 2])
        assert cut.any()


def test_no_rapid_goes_through_stock(case: Case) -> None:
    """A rapid below the top only ends where the moves before have swept the whole disk."""
    _, variant, plan = case
    path = plan.toolpath
    points, move = sampled(path, 0.1)
    radius = radius_of(variant)
    low = (path.kind == MoveKind.RAPID) & (path.end[:, 2] < 0) & (path.begin[:, 2] > path.end[:, 2])
    for index in np.flatnonzero(low):
        x, y, z = path.end[index]
        before = (move < index) & (points[:, 2] <= z) & (path.kind[move] != MoveKind.RAPID)
        near = before & (np.hypot(points[:, 0] - x, points[:, 1] - y) < 2 * radius)
        swept = shapely.union_all(shapely.buffer(shapely.points(points[near, :2]), radius))
        disk = shapely.Point(x, y).buffer(radius - 0.02)
        assert disk.difference(swept).area <= 2e-3 * disk.area


def test_the_wall_is_on_the_side_of_the_direction(case: Case) -> None:
    name, variant, plan = case
    path = plan.toolpath
    wall = radius_of(variant) + variant.get("radial_allowance", 0.0)
    points, move = sampled(path)
    same = move[1:] == move[:-1]
    middle = (points[1:] + points[:-1])[same, :2] / 2
    ahead = (points[1:] - points[:-1])[same, :2]
    cuts = np.isin(path.role[move[1:][same]], [Role.CUT, Role.FINISH])
    axis = axis_of(name)
    on_wall = cuts & (np.hypot(*ahead.T) > 1e-3)
    middle, ahead = middle[on_wall], ahead[on_wall]
    near = axis.clearance(middle) < wall + 0.01
    unit = ahead[near] / np.hypot(*ahead[near].T)[:, None]
    right = np.stack([unit[:, 1], -unit[:, 0]], axis=1)
    side = 1 if variant.get("direction", "climb") == "climb" else -1
    towards = axis.clearance(middle[near] + 0.5 * wall * side * right)
    beyond = axis.clearance(middle[near] - 0.5 * wall * side * right)
    # in a slot no wider than the tool both sides are walls
    assert np.mean(towards <= beyond + 0.02) > 0.99


def test_arcs_end_on_their_circle(case: Case) -> None:
    path = case[2].toolpath
    arc = path.is_arc
    first = np.hypot(*(path.begin[arc, :2] - path.centre[arc]).T)
    last = np.hypot(*(path.end[arc, :2] - path.centre[arc]).T)
    assert np.all(np.abs(first - last) <= 1e-6)
    assert np.all(np.isfinite(path.feed[path.kind != MoveKind.RAPID]))
    assert np.all(path.feed[path.kind != MoveKind.RAPID] > 0)


def test_areas_add_up(case: Case) -> None:
    name, _, plan = case
    total = plan.reachable_area + plan.unreachable_area
    assert total == pytest.approx(axis_of(name).region.area)


def test_arcs_stay_arcs() -> None:
    plan = planned("annulus", finish_pass=False)
    cuts = plan.toolpath.role == Role.CUT
    assert np.all(plan.toolpath.is_arc[cuts])
    assert len(plan.toolpath) < 120


def test_the_same_plan_twice() -> None:
    one, other = planned("islands").toolpath, planned("islands").toolpath
    for column in ("start", "kind", "end", "centre", "feed", "role"):
        assert getattr(one, column).tobytes() == getattr(other, column).tobytes()


def test_a_closed_neck_makes_two_pockets_each_cut_to_depth_before_the_next() -> None:
    path = planned("closed neck", finish_pass=False).toolpath
    entries = path.role == Role.ENTRY
    side = (path.end[:, 0] > 32)[entries]
    assert np.count_nonzero(np.diff(side.astype(int))) == 1
    assert path.end[entries, 2][side].min() == path.end[entries, 2][~side].min() == -4.0


def test_an_open_neck_is_one_pocket() -> None:
    plan = planned("open neck", diameter=4.0)
    finishes = np.flatnonzero(plan.toolpath.role == Role.FINISH)
    assert np.all(np.diff(finishes) == 1)


def test_between_regions_the_tool_travels_at_clearance_height() -> None:
    path = planned("annulus", "exact slot").toolpath
    delta = path.end - path.begin
    rapid = (path.kind == MoveKind.RAPID) & (np.hypot(delta[:, 0], delta[:, 1]) > 0)
    assert np.count_nonzero(path.end[rapid, 2] == 15.0) >= 1


def test_unreachable_corners_are_told_with_their_area() -> None:
    plan = planned("rectangle")
    corners = (4 - math.pi) * 9
    assert plan.unreachable_area == pytest.approx(corners, rel=5e-3)
    finding = next(item for item in plan.findings if item.code == "unreachable")
    assert finding.size == pytest.approx(corners, rel=5e-3)
    assert finding.place is not None


@pytest.mark.parametrize("name", ["circle", "exact slot", "wide slot", "annulus"])
def test_round_pockets_are_reached_in_full(name: str) -> None:
    plan = planned(name)
    assert plan.unreachable_area == 0.0
    assert not plan.findings


def test_a_wide_stepover_is_bounded_with_a_finding() -> None:
    plan = planned("rectangle", stepover=0.9)
    assert [item.code for item in plan.findings if item.size and item.size < 3] == [
        "stepover-bounded"
    ]


def test_a_tool_that_fits_nowhere_is_an_error_with_the_largest_that_does() -> None:
    with pytest.raises(PlanningError) as caught:
        planned("wide slot", diameter=8.0, radial_allowance=0.1)
    assert "6.6 mm" in str(caught.value)
    assert caught.value.place is not None


def test_a_region_too_narrow_is_told_and_the_others_are_cut() -> None:
    plan = planned("wide slot", "rectangle", diameter=8.0)
    finding = next(item for item in plan.findings if item.code == "tool-too-large")
    assert finding.size == pytest.approx(REGIONS["wide slot"]().area)
    assert plan.unreachable_area > REGIONS["wide slot"]().area
    assert plan.toolpath.end[:, 2].min() == -4.0


def test_a_hole_as_wide_as_the_tool_needs_a_plunge() -> None:
    job = job_of(6.4)
    axis = axis_of("tight circle")
    with pytest.raises(PlanningError, match="plunge"):
        plan_operation([axis], job.operations[0], job.tool(1), job)
    plan = planned("tight circle", diameter=6.4, entry="plunge")
    assert plan.toolpath.end[:, 2].min() == -4.0


def test_plunging_is_done_when_asked_for() -> None:
    path = planned("rectangle", entry="plunge").toolpath
    delta = path.end - path.begin
    straight_down = (path.kind == MoveKind.LINE) & (delta[:, 2] < 0)
    straight_down &= np.hypot(delta[:, 0], delta[:, 1]) == 0
    assert np.all(path.feed[straight_down] == 300.0)
    assert np.count_nonzero(straight_down & (path.role == Role.ENTRY)) == 2


def test_no_region_is_an_error() -> None:
    job = job_of()
    with pytest.raises(PlanningError, match="no region"):
        plan_operation([], job.operations[0], job.tool(1), job)


def test_the_start_is_taken_up() -> None:
    job = job_of()
    plan = plan_operation(
        [axis_of("rectangle")], job.operations[0], job.tool(1), job, start=(1.0, 2.0, 15.0)
    )
    assert plan.toolpath.start.tolist() == [1.0, 2.0, 15.0]


@cache
def judge() -> ModuleType:
    """The independent height-map judge."""
    source = SHARED / "tools" / "gcode_judge.py"
    if not source.exists():
        pytest.skip("the independent judge is not here")
    specification = importlib.util.spec_from_file_location("gcode_judge", source)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    # its compiled functions are looked up by the module's name
    sys.modules["gcode_judge"] = module
    specification.loader.exec_module(module)
    return module


def plain(path: Toolpath) -> str:
    """Program text with full words on every line."""
    lines = ["G21 G90 G17 G91.1"]
    for kind, begin, end, centre, feed in zip(
        path.kind, path.begin, path.end, path.centre, path.feed, strict=True
    ):
        words = f"G{kind} X{end[0]:.4f} Y{end[1]:.4f} Z{end[2]:.4f}"
        if kind >= MoveKind.ARC_CW:
            words += f" I{centre[0] - begin[0]:.4f} J{centre[1] - begin[1]:.4f}"
        lines.append(words + (f" F{feed:.1f}" if kind else ""))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("name", ["annulus", "islands", "tight neck", "exact slot"])
def test_an_independent_judge_finds_no_fault(name: str) -> None:
    figures = judge().measure(plain(planned(name).toolpath), shape(name), 4.0, 3.0, stepdown=2.0)
    assert figures["errors"] == []
    assert figures["gouge_mm"] <= GOUGE
    assert figures["floor_gouge_mm"] <= 1e-3
    assert not figures["uncut_pct"] > 0.1
    assert figures["rapid_hits"] == 0
    assert figures["plunge_mm"] == 0
