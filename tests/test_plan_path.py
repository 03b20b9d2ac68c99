"""Laws of chains of lines and arcs, of links, entries, passes and feeds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grassfire.errors import PlanningError
from grassfire.geometry import Arc, Bezier, Line, Loop
from grassfire.plan import entry, link
from grassfire.plan.depth import pass_floors
from grassfire.plan.feeds import LEAST_FACTOR, LEAST_SLOWING, Feeds, entry_feed
from grassfire.plan.path import Path, circle, from_loop, join, segment, tidy
from grassfire.toolpath import Role

FIT = 1e-3


def stadium(length: float, radius: float) -> Path:
    """Two straight sides and two half circles, counter-clockwise from the lower left."""
    points = np.array(
        [[0, -radius], [length, -radius], [length, radius], [0, radius], [0, -radius]], dtype=float
    )
    nan = [np.nan, np.nan]
    centre = np.array([nan, [length, 0.0], nan, [0.0, 0.0]])
    return Path(points, centre, np.array([0.0, np.pi, 0.0, np.pi]))


def test_length_of_a_stadium() -> None:
    assert stadium(10, 3).length == pytest.approx(20 + 6 * np.pi)


@given(st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_slices_add_up_and_stay_on_the_chain(one: float, other: float) -> None:
    path = stadium(10, 3)
    low, high = sorted((one, other))
    if high - low < 1e-6:
        return
    part = path.slice(low * path.length, high * path.length)
    assert part.length == pytest.approx((high - low) * path.length, abs=1e-9)
    middle = part.at(np.array([part.length / 2]))[0]
    assert np.allclose(middle, path.at(np.array([(low + high) / 2 * path.length]))[0], atol=1e-9)


@given(st.floats(0.0, 1.0))
def test_a_closed_chain_may_start_anywhere(where: float) -> None:
    path = stadium(10, 3)
    moved = path.started_at(where * path.length)
    assert moved.closed
    assert moved.length == pytest.approx(path.length)
    assert np.allclose(moved.start, path.at(np.array([where * path.length]))[0], atol=2e-3)


def test_a_full_circle_stays_one_piece_wherever_it_starts() -> None:
    moved = circle(np.zeros(2), np.array([2.0, 0.0]), 1).started_at(np.pi)
    assert len(moved) == 1
    assert np.allclose(moved.start, [0.0, 2.0])
    assert np.array_equal(moved.start, moved.end)


def test_reversal_keeps_places_and_turns_sweeps() -> None:
    path = stadium(10, 3)
    back = path.reversed()
    along = np.linspace(0, path.length, 37)
    assert np.allclose(back.at(path.length - along), path.at(along))
    assert np.allclose(back.sweep, -path.sweep[::-1])


@given(st.floats(-20, 30), st.floats(-20, 20))
def test_nearest_is_no_farther_than_any_sample(x: float, y: float) -> None:
    path = stadium(10, 3)
    point = np.array([x, y])
    found = path.nearest(point)
    samples = path.sample(0.05)[0]
    least = np.hypot(*(samples - point).T).min()
    assert least - 0.05 <= found.distance <= least + 1e-9
    assert np.hypot(*(found.point - point)) == pytest.approx(found.distance, abs=1e-9)
    assert np.allclose(path.at(np.array([found.along]))[0], found.point, atol=1e-9)


@given(st.floats(0.1, 30.0))
def test_the_tangent_is_the_derivative(along: float) -> None:
    path = stadium(10, 3)
    low, high = path.at(np.array([along - 1e-5, along + 1e-5]))
    slope = (high - low) / np.hypot(*(high - low))
    assert np.allclose(slope, path.tangent(along), atol=1e-4)


@given(st.integers(0, 2**32 - 1))
def test_one_point_is_to_the_bit_that_of_many(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 8))
    sweep = np.where(random.random(count) < 0.5, 0.0, random.uniform(-6, 6, count))
    centre = np.where((sweep != 0)[:, None], random.normal(0, 9, (count, 2)), np.nan)
    path = Path(random.normal(0, 9, (count + 1, 2)), centre, sweep)
    places = np.concatenate([path.cumulative, random.uniform(-1, path.length + 1, 9)])
    for along, point in zip(places.tolist(), path.at(places), strict=True):
        np.testing.assert_array_equal(path.point(along), point)


def test_equal_neighbours_become_one() -> None:
    square = np.array([[0, 0], [1, 0], [2, 0], [2, 2], [1, 2], [0, 2], [0, 1], [0, 0]], dtype=float)
    tidied = tidy(Path(square, np.full((7, 2), np.nan), np.zeros(7)))
    assert len(tidied) == 4
    assert tidied.closed
    assert tidied.length == pytest.approx(8)


def test_arcs_of_one_circle_become_one_circle() -> None:
    quarter = np.pi / 2
    curves = [Arc(np.array([1.0, 2.0]), 3.0, index * quarter, quarter) for index in range(4)]
    path = from_loop(Loop(tuple(curves)), FIT)
    assert len(path) == 1
    assert path.sweep[0] == pytest.approx(2 * np.pi)
    assert path.closed


def test_short_pieces_vanish_and_the_chain_hardly_moves() -> None:
    angles = np.linspace(0, 2 * np.pi, 2001)[:-1]
    # 6e-5 mm a side: all of them are too short, none may be lost in effect
    corners = 0.02 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = np.concatenate([corners, corners[:1]])
    tidied = tidy(Path(points, np.full((2000, 2), np.nan), np.zeros(2000)))
    assert tidied.closed
    assert tidied.lengths.min() >= 1e-4
    assert np.abs(np.hypot(*tidied.sample(1e-5)[0].T) - 0.02).max() < 1e-4


def test_a_short_piece_beside_an_arc_leaves_equal_radii() -> None:
    sliver = 5e-5
    points = np.array([[3.0, 0.0], [-3.0, 0.0], [-3.0, -sliver], [3.0, -sliver], [3.0, 0.0]])
    nan = [np.nan, np.nan]
    path = tidy(Path(points, np.array([[0.0, 0.0], nan, nan, nan]), np.array([np.pi, 0, 0, 0])))
    arc = np.flatnonzero(path.is_arc)
    first = np.hypot(*(path.points[arc] - path.centre[arc]).T)
    last = np.hypot(*(path.points[arc + 1] - path.centre[arc]).T)
    assert np.allclose(first, last, atol=1e-12)


def test_curves_are_fitted_within_tolerance() -> None:
    bump = Bezier(np.array([[0.0, 0.0], [10.0, 8.0], [-2.0, 9.0], [12.0, 0.0]]))
    loop = Loop((bump, Line(np.array([12.0, 0.0]), np.array([0.0, 0.0]))))
    path = from_loop(loop, FIT)
    exact = bump.point(np.linspace(0, 1, 500))
    assert max(path.nearest(point).distance for point in exact) <= FIT * 1.01


class Disk:
    """Clearance of a disk about the origin in closed form."""

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def clearance(self, points: np.ndarray) -> np.ndarray:
        """Distance to the circle, negative outside."""
        return self.radius - np.hypot(points[:, 0], points[:, 1])


@settings(max_examples=60)
@given(*(st.floats(-9, 9) for _ in range(4)), st.floats(0.1, 8))
def test_a_way_that_counts_as_clear_is_clear(
    x0: float, y0: float, x1: float, y1: float, distance: float
) -> None:
    way = segment(np.array([x0, y0]), np.array([x1, y1]))
    disk = Disk(10.0)
    clear = bool(link.paths_clear(disk, [way], distance)[0])
    least = float(disk.clearance(way.at(np.linspace(0, way.length, 2001))).min())
    if clear:
        assert least >= distance - 1e-3
    elif way.length > 0:
        assert least < distance + 1e-2


def test_ways_are_judged_one_by_one() -> None:
    ways = [segment(np.array([0.0, 0.0]), np.array([x, 0.0])) for x in (3.0, 8.0, 5.9)]
    assert link.paths_clear(Disk(10.0), ways, 4.0).tolist() == [True, False, True]
    assert link.paths_clear(Disk(10.0), [], 4.0).tolist() == []


@settings(max_examples=200)
@given(*(st.floats(-1, 1) for _ in range(4)))
def test_a_straight_way_crosses_a_ring_where_it_changes_sides(
    x0: float, y0: float, x1: float, y1: float
) -> None:
    start, end = np.array([5 + 12 * x0, 6 * y0]), np.array([5 + 12 * x1, 6 * y1])
    if np.hypot(*(end - start)) < 1e-2:
        return
    way = segment(start, end).sample(1e-2)[0]
    # distance from the core line of the stadium
    depth = 3 - np.hypot(way[:, 0] - np.clip(way[:, 0], 0, 10), way[:, 1])
    hit = bool(link.RingSet([stadium(10, 3)]).crossed(start[None], end[None])[0])
    if np.any(np.abs(depth) < 2e-2) and not (depth.max() > 2e-2 and depth.min() < -2e-2):
        return  # within a sample of touching
    assert hit == bool(depth.max() > 0 > depth.min())


def test_a_chord_between_places_of_a_ring_is_inside_only_where_the_region_is() -> None:
    disk = Disk(10.0)
    ring = circle(np.zeros(2), np.array([6.0, 0.0]), 1)
    inside = link.Interior(disk, [ring], 4.0)
    starts = np.array([[6.0, 0.0], [6.0, 0.0], [6.0, 0.0]])
    ends = np.array([[-6.0, 0.0], [0.0, 6.0], [8.0, 0.0]])
    assert inside.holds(starts, ends).tolist() == [True, True, False]


def test_crossings_are_places_of_both_rings_nearest_first() -> None:
    one, other = stadium(10, 3), circle(np.array([5.0, 8.0]), np.array([7.0, 8.0]), 1)
    pairs = link.crossings(one, other)
    assert pairs.distance[0] == pytest.approx(3.0, abs=0.01)
    assert np.allclose(one.at(pairs.from_along), pairs.starts)
    assert np.allclose(other.at(pairs.to_along), pairs.ends)
    assert np.allclose(np.hypot(*(pairs.ends - pairs.starts).T), pairs.distance)
    assert np.all(link.walked(one, pairs.from_along) <= one.length / 2)


def test_the_nearest_rings_that_are_left_come_first() -> None:
    rings = [circle(np.array([x, 0.0]), np.array([x + 1.0, 0.0]), 1) for x in (0.0, 5.0, 10.0)]
    several = link.RingSet(rings)
    point = np.array([6.5, 0.0])
    assert [place.ring for place in several.nearest_left(point, 3)] == [1, 2, 0]
    several.left[1] = False
    place = several.nearest_left(point)[0]
    assert place.ring == 2
    assert place.nearest.distance == pytest.approx(2.5)
    assert np.allclose(place.nearest.point, [9.0, 0.0])


def test_a_ring_that_is_cut_is_not_found_where_it_was_found_before() -> None:
    rings = link.RingSet([stadium(10, 3), stadium(10, 2)])
    asked = np.array([5.0, -4.0])
    assert [place.ring for place in rings.nearest_left(asked, 2)] == [0, 1]
    rings.left[0] = False
    (place,) = rings.nearest_left(asked, 2)
    assert (place.ring, place.nearest.distance) == (1, pytest.approx(2.0))
    (place,) = rings.nearest_left(np.array([5.0, 0.5]), 2)
    assert place.nearest.distance == pytest.approx(1.5)


def test_the_shorter_way_round_is_walked() -> None:
    ring = stadium(10, 3)
    ahead = link.walk(ring, 5.0)
    back = link.walk(ring, ring.length - 5.0)
    assert ahead is not None and ahead.length == pytest.approx(5.0)
    assert back is not None and back.length == pytest.approx(5.0)
    assert np.allclose(back.start, ring.start)
    assert link.walk(ring, 0.0) is None


@given(st.floats(0.05, 20), st.floats(0.02, 0.7), st.floats(0.5, 30))
def test_a_ramp_is_as_long_as_its_slope_asks(drop: float, slope: float, length: float) -> None:
    ring = stadium(length, 1.0)
    down, along = entry.ramp(ring, drop, slope)
    assert drop / down.length <= math.tan(slope) * (1 + 1e-9)
    assert down.length - drop / math.tan(slope) <= 2e-3 + 1e-9
    assert np.allclose(down.end, ring.at(np.array([along]))[0], atol=1e-9)


@given(st.floats(0.05, 20), st.floats(0.02, 0.7), st.floats(0.1, 5), st.sampled_from([1, -1]))
def test_a_helix_is_no_steeper_than_asked_and_ends_where_it_starts(
    drop: float, slope: float, radius: float, turn: int
) -> None:
    centre = np.array([3.0, -2.0])
    way = entry.helix(centre, centre + np.array([radius, 0.0]), drop, slope, turn)
    assert drop / way.down.length <= math.tan(slope) * (1 + 1e-9)
    assert np.array_equal(way.down.start, way.down.end)
    assert np.array_equal(way.down.end, way.flat.start)
    assert np.all(np.sign(way.down.sweep) == turn)


@given(st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.floats(0.5, 5.0), st.floats(0.1, 50))
def test_a_helix_leaves_no_core_and_keeps_to_the_room(
    inside: float, levels: float, tool: float, length: float
) -> None:
    wall = tool
    ring = wall + levels
    radius = entry.helix_radius(ring + inside, ring, wall, tool, length)
    if radius is not None:
        assert radius < tool
        assert radius <= inside + levels + 1e-12


@given(st.floats(0.1, 50), st.floats(0.1, 20), st.floats(0.0, 0.09), st.floats(-10, 10))
def test_passes_are_equal_and_end_at_the_depth(
    depth: float, stepdown: float, allowance: float, top: float
) -> None:
    floors = pass_floors(top, depth, stepdown, allowance)
    steps = -np.diff(np.concatenate([[top], floors]))
    assert floors[-1] == pytest.approx(top - depth + allowance, abs=1e-9)
    assert np.all(steps <= stepdown * (1 + 1e-6) + 1e-12)
    assert np.ptp(steps) < 1e-9
    assert len(floors) == 1 or (depth - allowance) / (len(floors) - 1) > stepdown * (1 - 1e-6)


@pytest.mark.parametrize(("depth", "stepdown", "allowance"), [(1.0, 1.0, 1.0), (1.0, 0.0, 0.0)])
def test_nothing_to_cut_is_an_error(depth: float, stepdown: float, allowance: float) -> None:
    with pytest.raises(PlanningError, match="nothing to cut"):
        pass_floors(0.0, depth, stepdown, allowance)


def test_more_passes_than_anyone_means_are_refused() -> None:
    with pytest.raises(PlanningError, match=r"1e\+07 passes; make stepdown larger"):
        pass_floors(0.0, 1e4, 1e-3, 0.0)


def test_inside_arcs_are_slowed_to_the_edge_and_outside_ones_are_not() -> None:
    path = join(
        segment(np.zeros(2), np.array([3.0, 0.0])),
        Path(
            np.array([[3.0, 0.0], [4.0, 1.0], [5.0, 2.0]]),
            np.array([[3.0, 1.0], [5.0, 1.0]]),
            np.array([np.pi / 2, -np.pi / 2]),
        ),
    )
    climb = feeds_of(tool_radius=3.0, inside=1)
    for finish in (climb.along(path, Role.FINISH), climb.along(path, Role.CUT, wall=True)):
        assert finish.tolist() == [1000, 250, 1000]
    other = feeds_of(tool_radius=1.0, inside=-1)
    assert other.along(path, Role.FINISH).tolist() == [1000, 1000, 500]
    assert climb.along(path, Role.LINK).tolist() == [1500] * 3
    tiny = feeds_of(tool_radius=30.0, inside=1)
    assert tiny.along(path, Role.FINISH)[1] == 1000 * LEAST_FACTOR


def feeds_of(**changes: float) -> Feeds:
    """Feeds with what a test is about."""
    settings: dict[str, Any] = {
        "cut": 1000.0, "link": 1500.0, "entry": 500.0, "plunge": 200.0, "tool_radius": 3.0,
        "inside": 1, "stepover": 1.2, "stepdown": 2.0, "slope": 0.05,
    }  # fmt: skip
    return Feeds(**(settings | changes))


@given(st.floats(0.2, 200), st.floats(0.05, 1.95), st.floats(0.5, 10))
def test_chips_on_inside_arcs_are_as_thick_as_on_a_straight_cut(
    radius: float, share: float, tool: float
) -> None:
    stepover = share * tool
    ring = circle(np.zeros(2), np.array([radius, 0.0]), 1)
    factor = feeds_of(tool_radius=tool, stepover=stepover).chip_factor(ring)[0]
    before = radius + tool - stepover

    def thickness(cosine: float) -> float:
        return math.sin(min(math.acos(max(min(cosine, 1.0), -1.0)), math.pi / 2))

    arc = thickness((before**2 - radius**2 - tool**2) / (2 * radius * tool))
    straight = thickness(1 - share)
    assert LEAST_FACTOR <= factor <= 1
    exact = max(straight / arc, LEAST_FACTOR)
    kept = exact > 1 - LEAST_SLOWING + 1e-9
    assert kept or exact > 1 - LEAST_SLOWING - 1e-9 or factor == pytest.approx(exact, rel=1e-6)
    assert not kept or factor == 1.0


@given(st.floats(0.1, 12), st.floats(0.1, 6), st.floats(0.5, 6), st.floats(0.01, 0.7))
def test_a_helix_removes_no_more_than_a_cut_and_sinks_no_faster_than_a_plunge(
    radius: float, stepover: float, tool: float, slope: float
) -> None:
    turn = circle(np.zeros(2), np.array([radius, 0.0]), 1)
    feeds = feeds_of(tool_radius=tool, stepover=stepover, slope=slope, entry=20.0)
    feed = feeds.along(turn, Role.ENTRY)[0]
    inner = max(radius - tool, 0.0)
    section = math.pi * ((radius + tool) ** 2 - inner**2)
    pitch = 2 * math.pi * radius * math.tan(slope)
    per_length = section * pitch / (2 * math.pi * radius)
    assert feed == 20.0 or feed * per_length <= 1000 * stepover * 2.0 * (1 + 1e-9)
    assert feed == 20.0 or feed * math.sin(slope) <= 200 * (1 + 1e-9)
    assert 20.0 <= feed <= 1000


@given(st.floats(10, 5000), st.floats(10, 5000), st.floats(0.01, 0.78))
def test_descents_never_outrun_the_plunge_feed(feed: float, plunge: float, slope: float) -> None:
    chosen = entry_feed(feed, plunge, slope)
    assert 0 < chosen <= feed
    assert chosen * math.sin(slope) <= plunge * (1 + 1e-9)
