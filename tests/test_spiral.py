"""Laws of spirals: near enough laps, smooth, off the wall, nothing left, the right way round."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import Voronoi, cKDTree

from grassfire.geometry import Arc, EllipticalArc, Line, Loop, Region, flatten
from grassfire.medial import MedialAxis, medial_axis
from grassfire.plan.path import Path
from grassfire.plan.spiral import spiral_pockets
from grassfire.plan.spiral_curve import (
    blunted,
    end_tangents,
    evened,
    filleted,
    fitted,
    smoothed,
)
from grassfire.plan.spiral_tree import joined, opened, rooted, sampled_chains
from grassfire.plan.spiral_wave import eased
from grassfire.plan.strategy import ClearingSettings, PocketPlan
from grassfire.plan.strokes import StrokeKind
from grassfire.toolpath import FloatArray, Role

RADIUS = 3.0
WALL = RADIUS - 2e-4
STEPOVER = 2.4


def polygon(*points: tuple[float, float]) -> Loop:
    """Straight sides between corners."""
    corners = [np.array(point, dtype=float) for point in points]
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    return Loop(tuple(Line(start, end) for start, end in sides))


def box(x0: float, y0: float, x1: float, y1: float) -> Loop:
    """An upright rectangle."""
    return polygon((x0, y0), (x1, y0), (x1, y1), (x0, y1))


def disk(x: float, y: float, radius: float) -> Loop:
    """A circle."""
    return Loop((Arc(np.array([x, y]), radius, 0.0, 2 * np.pi),))


def dumbbell(neck: float) -> Loop:
    """Two squares of 40 mm joined by a corridor 16 mm long."""
    low, high = 20 - neck / 2, 20 + neck / 2
    left = [(0.0, 0.0), (40.0, 0.0), (40.0, low), (56.0, low), (56.0, 0.0), (96.0, 0.0)]
    right = [(96.0, 40.0), (56.0, 40.0), (56.0, high), (40.0, high), (40.0, 40.0), (0.0, 40.0)]
    return polygon(*left, *right)


def ellipse() -> Loop:
    """Half axes of 60 and 25 mm."""
    major, minor = np.array([60.0, 0.0]), np.array([0.0, 25.0])
    return Loop((EllipticalArc(np.zeros(2), major, minor, 0.0, 2 * np.pi),))


def chords(loop: Loop, count: int) -> Loop:
    """A closed curve as so many short lines."""
    (curve,) = loop.curves
    return Loop.from_points(curve.point(np.arange(count) / count))


REGIONS: dict[str, Callable[[], Region]] = {
    "circle": lambda: Region(disk(0, 0, 40), ()),
    "ellipse": lambda: Region(ellipse(), ()),
    "circle of lines": lambda: Region(chords(disk(0, 0, 40), 200), ()),
    "ellipse of lines": lambda: Region(chords(ellipse(), 300), ()),
    "rectangle": lambda: Region(box(0, 0, 100, 60), ()),
    "triangle": lambda: Region(polygon((0, 0), (60, 0), (20, 50)), ()),
    "ell": lambda: Region(polygon((0, 0), (60, 0), (60, 24), (24, 24), (24, 60), (0, 60)), ()),
    "dumbbell": lambda: Region(dumbbell(9), ()),
    "corridor": lambda: Region(box(0, 0, 60, 7.2), ()),
    "islands": lambda: Region(box(0, 0, 70, 50), (disk(20, 18, 6), disk(48, 28, 8))),
    "near islands": lambda: Region(box(0, 0, 60, 40), (disk(20, 20, 6), disk(38.2, 20, 6))),
}
ONE_LOBE = (
    "circle",
    "ellipse",
    "circle of lines",
    "ellipse of lines",
    "rectangle",
    "triangle",
    "ell",
)


def settings_of(**changes: float | bool | str) -> ClearingSettings:
    """As for a 6 mm tool at a stepover of 40 %."""
    values: dict[str, float | bool | str] = {
        "tool_radius": RADIUS,
        "wall": WALL,
        "stepover": STEPOVER,
        "engagement": 1.37,
        "tolerance": 7e-4,
        "entry": "helix",
        "slope": np.radians(3.0),
        "drop": 2.5,
        "climb": True,
        "finish": True,
        "fast_links": False,
        "longest_walk": 40.0,
        "minimum_radius": 0.0,
        "link_speed": 20.0,
        "step": 2.0,
    }
    known = ClearingSettings.__dataclass_fields__
    chosen = {name: value for name, value in (values | changes).items() if name in known}
    return ClearingSettings(**chosen)  # type: ignore[arg-type]


@cache
def axis_of(name: str) -> MedialAxis:
    """Medial axis of a region of the list."""
    return medial_axis(REGIONS[name]())


def plans(name: str, **changes: float | bool | str) -> list[PocketPlan]:
    """The pockets of a region of the list, laid out."""
    pockets, _ = spiral_pockets(axis_of(name), settings_of(**changes))
    for pocket in pockets:
        pocket.plan(pocket.peak)
    return pockets


@cache
def planned(name: str) -> tuple[PocketPlan, ...]:
    """The same with the settings of always."""
    return tuple(plans(name))


def flat(pockets: tuple[PocketPlan, ...] | list[PocketPlan]) -> list[Path]:
    """All that is travelled at the floor before the finishing laps."""
    return [
        stroke.path
        for pocket in pockets
        for stroke in pocket.strokes
        if stroke.kind is StrokeKind.FEED
    ]


def polygon_of(name: str) -> shapely.Polygon:
    """A region of the list with straight sides."""
    region = REGIONS[name]()
    return shapely.Polygon(
        flatten(region.outer, 1e-3), [flatten(loop, 1e-3) for loop in region.islands]
    )


def turns(path: Path) -> FloatArray:
    """Angles between the pieces of a chain, radians."""
    leave, arrive = end_tangents(path)
    cross = arrive[:-1, 0] * leave[1:, 1] - arrive[:-1, 1] * leave[1:, 0]
    return np.abs(np.arctan2(cross, np.sum(arrive[:-1] * leave[1:], axis=1)))


def widest_gap(points: FloatArray, area: shapely.Polygon) -> float:
    """Diameter of the largest disk centred in an area that holds no point, mm."""
    corners = Voronoi(points).vertices
    inside = corners[shapely.contains_xy(area, corners[:, 0], corners[:, 1])]
    rim = shapely.get_coordinates(shapely.segmentize(area.boundary, 0.1))
    return 2 * float(cKDTree(points).query(np.concatenate([inside, rim]))[0].max())


@pytest.mark.parametrize("name", REGIONS)
def test_no_stroke_comes_nearer_to_the_wall_than_the_tool(name: str) -> None:
    axis = axis_of(name)
    for pocket in planned(name):
        for stroke in [*pocket.strokes, *pocket.finish]:
            points = stroke.path.sample(0.1)[0] if stroke.path.length else stroke.path.points
            assert axis.clearance(points).min() >= RADIUS - 0.003


@pytest.mark.parametrize("name", REGIONS)
def test_strokes_follow_each_other(name: str) -> None:
    for pocket in planned(name):
        strokes = [*pocket.strokes, *pocket.finish]
        for before, after in pairwise(strokes):
            if after.kind is StrokeKind.FEED:
                assert np.hypot(*(before.path.end - after.path.start)) < 1e-6


@pytest.mark.parametrize("name", REGIONS)
def test_nothing_is_left_of_what_the_tool_reaches(name: str) -> None:
    region = polygon_of(name)
    reached = region.buffer(-RADIUS + 1e-3, quad_segs=32).buffer(RADIUS - 1e-3, quad_segs=32)
    laps = [stroke.path for pocket in planned(name) for stroke in pocket.finish]
    paths = [path for path in flat(planned(name)) + laps if path.length]
    points = np.concatenate([path.sample(0.1)[0] for path in paths])
    grid = np.arange(0.1, 200.0, 0.2)
    xmin, ymin, xmax, ymax = reached.bounds
    x, y = np.meshgrid(
        xmin + grid[grid < xmax - xmin], ymin + grid[grid < ymax - ymin], indexing="ij"
    )
    inside = shapely.contains_xy(reached.buffer(-0.05), x, y)
    away = cKDTree(points).query(np.stack([x[inside], y[inside]], axis=1))[0]
    assert np.mean(away > RADIUS + 0.01) <= 5e-4


@pytest.mark.parametrize("name", ONE_LOBE)
def test_one_lobe_is_one_smooth_path(name: str) -> None:
    (pocket,) = planned(name)
    kinds = [stroke.kind for stroke in pocket.strokes]
    assert kinds == [StrokeKind.DESCEND] + [StrokeKind.FEED] * 3
    spiral = pocket.strokes[2].path
    assert np.degrees(turns(spiral).max()) < 0.1
    for before, after in pairwise(pocket.strokes):
        cosine = np.dot(before.path.tangent(before.path.length), after.path.tangent(0.0))
        assert np.degrees(np.arccos(min(cosine, 1.0))) < 1.0


@pytest.mark.parametrize("name", ONE_LOBE)
def test_neighbouring_laps_are_at_most_a_stepover_apart(name: str) -> None:
    (pocket,) = planned(name)
    descent, lap = pocket.strokes[0].path, pocket.strokes[1].path
    area = polygon_of(name).buffer(-RADIUS, quad_segs=32)
    area = area.difference(shapely.Polygon(lap.sample(0.1)[0]).buffer(0.01))
    assert descent.length >= settings_of().drop / np.tan(settings_of().slope) - 1e-9
    points = np.concatenate([path.sample(0.1)[0] for path in flat(planned(name))])
    assert widest_gap(np.unique(np.round(points, 5), axis=0), area) <= 1.002 * STEPOVER


@pytest.mark.parametrize(("name", "most"), [("circle", 1.1), ("ellipse", 1.6)])
def test_length_of_compact_pockets(name: str, most: float) -> None:
    (pocket,) = planned(name)
    length = sum(stroke.path.length for stroke in pocket.strokes)
    assert length <= most * polygon_of(name).area / STEPOVER


@pytest.mark.parametrize("name", ["circle", "ellipse"])
def test_short_lines_are_cleared_as_the_curve_that_they_stand_for(name: str) -> None:
    """Each corner between them has a branch of its own: laps do not swing out into these."""
    curve, lines = (
        sum(path.length for path in flat(planned(which))) for which in (name, f"{name} of lines")
    )
    assert lines == pytest.approx(curve, rel=0.02)


@pytest.mark.parametrize("climb", [True, False])
def test_direction_keeps_the_stock_on_the_side_that_was_asked_for(climb: bool) -> None:
    (pocket,) = plans("rectangle", climb=climb)
    for stroke in pocket.strokes[1:]:
        points = stroke.path.sample(0.5)[0] - pocket.peak
        area = np.sum(points[:-1, 0] * points[1:, 1] - points[:-1, 1] * points[1:, 0])
        assert (area > 0) == climb


def test_a_neck_parts_a_pocket_into_spirals_of_their_own() -> None:
    (pocket,) = planned("dumbbell")
    descents = [stroke for stroke in pocket.strokes if stroke.kind is StrokeKind.DESCEND]
    assert len(descents) == 2


def test_a_neck_that_the_tool_cannot_pass_makes_two_pockets() -> None:
    axis = medial_axis(Region(dumbbell(5), ()))
    pockets, _ = spiral_pockets(axis, settings_of())
    assert len(pockets) == 2


def test_a_corridor_as_wide_as_the_tool_is_cleared_by_its_wall_lap() -> None:
    (pocket,) = planned("corridor")
    kinds = [stroke.kind for stroke in pocket.strokes]
    assert kinds == [StrokeKind.DESCEND, StrokeKind.FEED]


def test_a_place_for_a_plunge_alone_is_left_and_told() -> None:
    axis = medial_axis(Region(disk(0, 0, 3.0), ()))
    pockets, findings = spiral_pockets(axis, settings_of())
    assert not pockets
    assert [finding.code for finding in findings] == ["needs-plunge"]
    pockets, findings = spiral_pockets(axis, settings_of(entry="plunge"))
    assert len(pockets) == 1
    assert not findings


def test_a_stepover_that_could_leave_stock_is_bounded_and_told() -> None:
    pockets, findings = spiral_pockets(axis_of("circle"), settings_of(stepover=4.5))
    assert [finding.code for finding in findings] == ["stepover-bounded"]
    pockets[0].plan(pockets[0].peak)
    points = np.concatenate([path.sample(0.1)[0] for path in flat(pockets)])
    hole = shapely.Point(0, 0).buffer(0.95 * RADIUS)
    area = polygon_of("circle").buffer(-RADIUS).difference(hole)
    assert widest_gap(np.unique(np.round(points, 5), axis=0), area) <= RADIUS


@pytest.mark.parametrize("entry", ["plunge", "ramp"])
def test_entries_without_a_helix(entry: str) -> None:
    (pocket,) = plans("circle", entry=entry)
    assert pocket.strokes[0].kind is StrokeKind.DESCEND
    assert (pocket.strokes[0].path.length == 0) == (entry == "plunge")


def test_islands_are_lapped_and_finished() -> None:
    (pocket,) = planned("islands")
    finishing = [stroke for stroke in pocket.finish if stroke.role is Role.FINISH]
    assert len(finishing) == 3


def test_opened_chains_are_a_tree() -> None:
    axis = axis_of("islands")
    graph = axis.subgraph(WALL)
    chains = joined(sampled_chains(axis, graph, WALL, 0.25))
    tree, nodes = opened(chains, len(graph.vertex_radius))
    used = {node for chain in tree for node in (chain.start, chain.end)}
    assert len(used) == len(tree) + 1
    assert max(used) < nodes
    assert len(rooted(tree, tree[0].start)) == len(tree)
    whole = sum(chain.along[-1] for chain in chains)
    assert sum(chain.along[-1] for chain in tree) == pytest.approx(whole)


def test_time_runs_from_0_to_1_and_starts_and_stops_evenly() -> None:
    time = eased(np.linspace(0.0, 7.0, 701), 7)
    speed = np.diff(time) / 0.01
    assert time[0] == 0.0
    assert time[-1] == 1.0
    assert speed.min() >= 0.0
    assert speed.max() <= 1.0 / 6.5 + 1e-9
    assert speed[0] < 0.05 * speed.max()
    assert speed[-1] < 0.05 * speed.max()


def test_biarcs_keep_to_points_and_tangents() -> None:
    angle = np.linspace(0.0, 5.0, 400)
    points = np.stack([20 * np.cos(angle), 9 * np.sin(angle)], axis=1)
    tangents = np.stack([-20 * np.sin(angle), 9 * np.cos(angle)], axis=1)
    tangents /= np.hypot(*tangents.T)[:, None]
    path = fitted(points, tangents, np.full(400, 1e-3), 64)
    assert max(path.nearest(point).distance for point in points[::7]) <= 1e-3
    assert turns(path).max() < 1e-6
    assert len(path) < 100


def test_fillets_round_corners_and_stay_inside() -> None:
    ring = Path(
        np.array([[0, 0], [10, 0], [10, 6], [0, 6], [0, 0]], dtype=float),
        np.full((4, 2), np.nan),
        np.zeros(4),
    )
    rounded = filleted(ring, 0.5, np.inf)
    assert rounded.closed
    assert np.degrees(turns(rounded).max()) < 1e-6
    assert rounded.length == pytest.approx(32 - 8 * 0.5 + 2 * np.pi * 0.5)
    assert filleted(ring, 0.5, 0.01).length > rounded.length
    points = rounded.sample(0.05)[0]
    assert points.min() >= -1e-9
    assert np.all(points <= np.array([10, 6]) + 1e-9)


@pytest.mark.parametrize("angle", [0.6, 1.5, 2.2])
def test_what_is_blunted_moves_to_the_inside_of_the_turn(angle: float) -> None:
    way = np.array([np.cos(angle), np.sin(angle)])
    points = evened(np.array([[-3.0, 0.0], [0.0, 0.0], 3.0 * way]), 0.1)
    soft = blunted(points, 1.0)
    chain = Path(soft, np.full((len(soft) - 1, 2), np.nan), np.zeros(len(soft) - 1))
    assert turns(chain).max() <= 0.4
    assert np.array_equal(soft[[0, -1]], points[[0, -1]])
    assert np.all(soft[:, 1] >= -1e-12)
    assert np.all(way[0] * soft[:, 1] - way[1] * soft[:, 0] >= -1e-12)
    assert np.array_equal(blunted(points, -1.0), points)


def test_laps_leave_little_in_sharp_corners_for_the_finishing_lap() -> None:
    needle = Region(polygon((0, 0), (60, 0), (60, 14), (20, 14)), ())
    axis = medial_axis(needle)
    ((pocket,), _) = spiral_pockets(axis, settings_of())
    pocket.plan(pocket.peak)
    (lap,) = (item.path for item in pocket.finish if item.role is Role.FINISH)
    before = pocket.strokes[-1].path
    assert max(before.nearest(point).distance for point in lap.sample(0.05)[0]) <= 0.021 * RADIUS


@pytest.mark.parametrize("count", [9, 300])
def test_smoothing_is_by_a_gaussian(count: int) -> None:
    points = np.cumsum(np.random.default_rng(count).normal(size=(count, 2)), axis=0)
    for width in (0.4, 3.0, 11.0):
        expected = gaussian_filter1d(points, width, axis=0, mode="nearest", truncate=4.0)
        np.testing.assert_allclose(smoothed(points, width, closed=False), expected, atol=1e-12)
        ring = np.concatenate([points, points[:1]])
        expected = gaussian_filter1d(points, width, axis=0, mode="wrap", truncate=4.0)
        np.testing.assert_allclose(smoothed(ring, width, closed=True)[:-1], expected, atol=1e-12)
