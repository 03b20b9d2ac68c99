"""Laws of the queries: closed forms, additivity, monotony, brute force, invariance."""

from __future__ import annotations

import doctest
import importlib
import pickle
from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import medial_shapes as shapes
from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Bezier, Line, Loop, Region, flatten
from grassfire.medial import MedialAxis, medial_axis
from grassfire.medial.extrema import necks

FloatArray = NDArray[np.float64]

FEW = [
    "rectangle", "ell", "comb", "star-5", "dumbbell", "islands-grid", "square-frame-turned",
    "rounded-rectangle", "stadium", "annulus-eccentric", "teardrop", "rounded-slot",
    "ellipse", "blob-1", "blob-islands", "letter-s", "letter-e", "letter-o", "comma",
    "comma-at-1e6", "star-1e5", "blob-1e-3",
]  # fmt: skip
SHARES = (0.17, 0.55, 0.9)


# -- helpers --------------------------------------------------------------------------------------


@cache
def region_of(name: str) -> Region:
    return shapes.EVERY[name]()


@cache
def axis_of(name: str) -> MedialAxis:
    return medial_axis(region_of(name))


@cache
def reversed_axis_of(name: str) -> MedialAxis:
    region = region_of(name)
    return medial_axis(
        Region(region.outer.reversed(), tuple(loop.reversed() for loop in region.islands))
    )


def size_of(axis: MedialAxis) -> float:
    xmin, ymin, xmax, ymax = axis.region.bounds()
    return float(np.hypot(xmax - xmin, ymax - ymin))


def points_about(axis: MedialAxis, count: int, seed: int = 0) -> FloatArray:
    """Points in the bounding box of the region, and a little around it."""
    low_high = np.array(axis.region.bounds())
    margin = 0.1 * (low_high[2:] - low_high[:2])
    draw = np.random.default_rng(seed)
    return draw.uniform(low_high[:2] - margin, low_high[2:] + margin, (count, 2))


def points_inside(axis: MedialAxis, count: int, seed: int = 0) -> FloatArray:
    points = points_about(axis, 20 * count, seed)
    return points[axis.region.contains(points)][:count]


def drawn(regions: tuple[Region, ...], accuracy: float) -> shapely.Geometry:
    """Regions as polygons, chords within `accuracy` of the curves."""
    polygons = [
        shapely.Polygon(
            flatten(region.outer, accuracy), [flatten(loop, accuracy) for loop in region.islands]
        )
        for region in regions
    ]
    return shapely.union_all([polygon.buffer(0) for polygon in polygons])


def total_area(regions: tuple[Region, ...]) -> float:
    return float(sum(region.area for region in regions))


def places_of(axis: MedialAxis, samples: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Edges and fractions of even samples of all edges."""
    count = len(axis.edges)
    return np.repeat(np.arange(count), samples), np.tile(np.linspace(0, 1, samples), count)


def hourglass(waist: float = 3.0) -> Region:
    return shapes.polygon([(-20, -10), (0, -waist), (20, -10), (20, 10), (0, waist), (-20, 10)])


def three_rooms(reflex: float = 4.0, far: float = 40.0) -> Region:
    """Three wide rooms about a junction between three reflex corners."""
    points = []
    for turn in 2 * np.pi * np.arange(3) / 3:
        points.append(shapes.polar(reflex, turn))
        points.extend(shapes.polar(far, turn + np.pi / 3 + side) for side in (-0.9, 0.9))
    return shapes.polygon(points)


# -- places on the axis ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", FEW)
def test_places_at_the_ends_of_edges_are_vertices(name: str) -> None:
    axis = axis_of(name)
    edges = np.arange(len(axis.edges))
    for fraction, which in ((0.0, "start"), (1.0, "end")):
        vertex = np.array([getattr(edge, which) for edge in axis.edges])
        away = axis.point(edges, fraction) - axis.vertex_point[vertex]
        assert np.abs(away).max() <= 1e-15 * np.abs(axis.vertex_point).max()
        assert np.array_equal(axis.radius(edges, fraction), axis.vertex_radius[vertex])


@pytest.mark.parametrize("name", ["ell", "annulus-eccentric", "blob-1", "comma"])
def test_tangents_are_directions_of_the_curve(name: str) -> None:
    axis = axis_of(name)
    edge, fraction = places_of(axis, 9)
    inner = (fraction > 0) & (fraction < 1)
    edge, fraction, step = edge[inner], fraction[inner], 1e-6
    chord = axis.point(edge, fraction + step) - axis.point(edge, fraction - step)
    length = np.hypot(*chord.T)
    seen = length > 1e-9 * size_of(axis)
    tangent = axis.tangent(edge, fraction)
    np.testing.assert_allclose(np.hypot(*tangent.T), 1.0, atol=1e-12)
    np.testing.assert_allclose(tangent[seen], chord[seen] / length[seen, None], atol=1e-5)


def test_tangent_at_a_smooth_end_is_the_limit() -> None:
    axis = axis_of("ellipse")
    for index, edge in enumerate(axis.edges):
        for fraction in (0.0, 1.0):
            x, y = axis.tangent(index, fraction)[0]
            assert abs(y) < 1e-6
            ahead = edge.control_points[-1, 0] - edge.control_points[0, 0]
            assert x == pytest.approx(np.sign(ahead), abs=1e-9)


@pytest.mark.parametrize(("edge", "fraction"), [(-1, 0.5), (5, 0.5), (0, -0.1), (0, np.nan)])
def test_places_off_the_axis_are_refused(edge: int, fraction: float) -> None:
    axis = axis_of("rectangle")
    for query in (axis.point, axis.radius, axis.tangent, axis.separation_angle):
        with pytest.raises(GeometryError):
            query(edge, fraction)


# -- nearest points -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(shapes.EVERY))
def test_nearest_point_is_nearer_than_any_sample(name: str) -> None:
    axis = axis_of(name)
    size = size_of(axis)
    points = points_about(axis, 150)
    near = axis.nearest_axis_point(points)
    distance = np.hypot(*(points - near.point).T)
    rounding = 1e-13 * size + 4e-16 * np.abs(axis.region.bounds()).max()
    if not len(axis.edges):
        assert np.all(near.edge == -1)
        np.testing.assert_allclose(distance, np.hypot(*(points - axis.vertex_point[0]).T))
        return
    edge, fraction = places_of(axis, 300)
    samples = axis.point(edge, fraction)
    sampled, _ = cKDTree(samples).query(points)
    gap = np.hypot(*np.diff(samples.reshape(-1, 300, 2), axis=1).reshape(-1, 2).T).max()
    assert np.all(distance <= sampled + rounding)
    assert np.all(distance >= sampled - gap)
    assert np.array_equal(near.point, axis.point(near.edge, near.fraction))
    assert np.array_equal(near.radius, axis.radius(near.edge, near.fraction))
    # The way to it is normal to the axis, but at vertices.
    away = cKDTree(axis.vertex_point).query(near.point)[0]
    inner = away > 10 * axis.tolerance + 1e-9 * size
    along = np.einsum(
        "ij,ij->i", (points - near.point)[inner], axis.tangent(near.edge, near.fraction)[inner]
    )
    assert np.all(np.abs(along) <= 1e-7 * size)


def test_nearest_point_of_an_annulus_is_on_the_circle_between() -> None:
    points = points_about(axis_of("annulus"), 500)
    near = axis_of("annulus").nearest_axis_point(points)
    expected = 14.0 * points / np.hypot(*points.T)[:, None]
    np.testing.assert_allclose(near.point, expected, atol=2e-6)
    np.testing.assert_allclose(near.radius, 6.0, atol=1e-6)


def test_nearest_point_of_an_ellipse_is_on_its_segment() -> None:
    major, minor = 30.0, 18.0
    points = points_about(axis_of("ellipse"), 500)
    near = axis_of("ellipse").nearest_axis_point(points)
    half = (major**2 - minor**2) / major
    x = np.clip(points[:, 0], -half, half)
    np.testing.assert_allclose(near.point, np.stack([x, 0 * x], axis=1), atol=2e-6)
    radius = minor * np.sqrt(1 - x**2 / (major**2 - minor**2))
    np.testing.assert_allclose(near.radius, radius, atol=2e-6)


@pytest.mark.parametrize("name", ["ell", "islands-grid", "comma", "letter-o"])
def test_nearest_distance_is_the_same_for_the_reversed_region(name: str) -> None:
    points = points_about(axis_of(name), 200)
    one = axis_of(name).nearest_axis_point(points).point
    two = reversed_axis_of(name).nearest_axis_point(points).point
    distance = [np.hypot(*(points - found).T) for found in (one, two)]
    np.testing.assert_allclose(distance[0], distance[1], atol=3e-6)


def test_nearest_of_no_points() -> None:
    near = axis_of("ell").nearest_axis_point(np.zeros((0, 2)))
    assert near.point.shape == (0, 2)


@pytest.mark.parametrize("points", [[1.0, 2.0, 3.0], [[np.nan, 0.0]], [[[0.0, 0.0]]]])
def test_points_must_be_points(points: object) -> None:
    with pytest.raises(GeometryError):
        axis_of("square").nearest_axis_point(points)  # type: ignore[arg-type]


# -- separation angle and pruning -----------------------------------------------------------------


def test_separation_angles_of_a_rectangle() -> None:
    axis = axis_of("rectangle")
    for index, edge in enumerate(axis.edges):
        corner = min(edge.radius) == 0
        expected = np.pi / 2 if corner else np.pi
        angle = axis.separation_angle(index, np.linspace(0, 1, 7))
        np.testing.assert_allclose(angle, expected, atol=1e-12)


def test_separation_angle_of_a_needle() -> None:
    axis = axis_of("needle")
    tip = int(np.argmin(axis.vertex_point[:, 0]))
    (index,) = (k for k, edge in enumerate(axis.edges) if tip in (edge.start, edge.end))
    angle = axis.separation_angle(index, [0.0, 0.3, 1.0])
    np.testing.assert_allclose(angle, np.pi - np.radians(0.5), atol=1e-12)


def test_separation_angles_of_an_ellipse() -> None:
    major, minor = 30.0, 18.0
    axis = axis_of("ellipse")
    edge, fraction = places_of(axis, 21)
    x = axis.point(edge, fraction)[:, 0]
    cosine = np.clip(x * major / (major**2 - minor**2), -1, 1)
    # tan(angle / 2) = major / minor tan t for feet at the parameters t and -t
    half = np.arctan2(major * np.sqrt(1 - cosine**2), minor * np.abs(cosine))
    inner = np.abs(cosine) < 0.999
    angle = axis.separation_angle(edge, fraction)
    np.testing.assert_allclose(angle[inner], 2 * half[inner], atol=1e-5)


@pytest.mark.parametrize("name", ["ell", "star-5", "teardrop", "letter-o", "comma"])
def test_separation_angle_follows_from_the_growth_of_the_radius(name: str) -> None:
    axis = axis_of(name)
    edge, fraction = places_of(axis, 12)
    inner = (fraction > 0.05) & (fraction < 0.95)
    edge, fraction, step = edge[inner], fraction[inner], 1e-5
    way = axis.point(edge, fraction + step) - axis.point(edge, fraction - step)
    growth = axis.radius(edge, fraction + step) - axis.radius(edge, fraction - step)
    length = np.hypot(*way.T)
    seen = length > 1e-7 * size_of(axis)
    share = np.clip(np.abs(growth[seen]) / length[seen], 0, 1)
    expected = np.abs(growth[seen]) / length[seen]
    cosine = np.cos(0.5 * axis.separation_angle(edge[seen], fraction[seen]))
    np.testing.assert_allclose(cosine, expected, atol=2e-3)
    assert np.all(share <= 1)


def test_pruning_a_rectangle_beyond_a_right_angle_leaves_its_middle() -> None:
    axis = axis_of("rectangle")
    whole = axis.prune(0.49 * np.pi)
    assert len(whole.edge) == 5
    middle = axis.prune(0.51 * np.pi)
    assert middle.length == pytest.approx(20.0, abs=1e-9)
    assert middle.vertex_kind == ["end", "end"]


def test_pruning_a_polygon_to_its_centre() -> None:
    pruned = axis_of("hexagon").prune(0.9 * np.pi)
    assert len(pruned.edge) == 0
    assert pruned.component_count == 1
    np.testing.assert_allclose(pruned.vertex_point, [[0.0, 0.0]], atol=1e-9)
    assert pruned.edges == ()


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.0, 3.0])
def test_pruning_an_ellipse_cuts_both_ends_at_the_angle(angle: float) -> None:
    major, minor = 30.0, 18.0
    pruned = axis_of("ellipse").prune(angle)
    half = (major**2 - minor**2) / major * np.cos(np.arctan(minor / major * np.tan(angle / 2)))
    ends = pruned.vertex_point[[kind == "cut" for kind in pruned.vertex_kind]]
    np.testing.assert_allclose(np.sort(ends[:, 0]), [-half, half], atol=1e-4)
    assert pruned.length == pytest.approx(2 * half, abs=2e-4)


@pytest.mark.parametrize("name", ["star-5", "comb", "islands-grid", "hand", "letter-e", "comma"])
def test_pruned_axes_are_connected_and_shrink_as_the_angle_grows(name: str) -> None:
    axis = axis_of(name)
    lengths = []
    for angle in (0.0, 0.4, 1.2, 1.7, 2.4, 3.0):
        pruned = axis.prune(angle)
        assert pruned.component_count == 1
        loops = len(pruned.edge) - len(pruned.vertex_radius) + 1
        assert loops == len(axis.region.islands)
        lengths.append(pruned.length)
        at_cut = np.flatnonzero(pruned.vertex_cut)
        for vertex in at_cut:
            for place, end in ((pruned.low, pruned.start), (pruned.high, pruned.end)):
                for row in np.flatnonzero(end == vertex):
                    seen = axis.separation_angle(pruned.edge[row], place[row])[0]
                    assert seen >= angle * (1 - 1e-9)
    assert np.all(np.diff(lengths) <= 1e-9 * lengths[0])
    whole = axis.subgraph(0.0)
    assert lengths[0] == pytest.approx(whole.length, rel=1e-12)


@pytest.mark.parametrize("angle", [-0.1, 3.2, np.nan])
def test_angles_must_be_angles(angle: float) -> None:
    with pytest.raises(GeometryError):
        axis_of("square").prune(angle)


# -- wide parts -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FEW)
def test_wide_parts_are_as_many_as_pieces_of_the_offset(name: str) -> None:
    axis = axis_of(name)
    largest = axis.largest_disk()[1]
    neck = axis.narrowest_neck()
    radii = [share * largest for share in (*SHARES, 1.0, 1.01)]
    if neck is not None:
        radii += [neck[1], (1 - 1e-6) * neck[1], (1 + 1e-6) * neck[1]]
    whole = axis.subgraph(0.0)
    for radius in radii:
        part = axis.subgraph(radius)
        assert part.component_count == len(axis.trimmed_offset(radius))
        least = radius * (1 - 1e-9) - axis.tolerance
        assert np.all(part.vertex_radius >= least)
        assert part.length <= whole.length * (1 + 1e-12)
        for index, edge in enumerate(part.edges):
            assert (edge.start, edge.end) == (part.start[index], part.end[index])
            fraction = np.linspace(part.low[index], part.high[index], 9)
            assert np.all(axis.radius(part.edge[index], fraction) >= least)
            for control, vertex in ((0, edge.start), (-1, edge.end)):
                away = edge.control_points[control] - part.vertex_point[vertex]
                assert np.hypot(*away) <= 1e-12 * size_of(axis) + 1e-9 * (np.abs(away).max() > 0)


def test_wide_part_of_a_rectangle() -> None:
    part = axis_of("rectangle").subgraph(4.0)
    assert part.component_count == 1
    assert sorted(part.vertex_kind) == ["branch"] * 2 + ["cut"] * 4
    assert part.length == pytest.approx(20 + 4 * 6 * np.sqrt(2), abs=1e-9)
    np.testing.assert_allclose(part.vertex_radius[part.vertex_cut], 4.0, atol=1e-9)
    assert list(part.edge_component) == [0] * 5


def test_wide_part_of_a_disk_is_its_centre_or_nothing() -> None:
    axis = axis_of("circle")
    assert axis.subgraph(3.0).component_count == 1
    assert axis.subgraph(0.0).component_count == 1
    assert axis.subgraph(11.0).component_count == 0
    assert axis.subgraph(11.0).vertex_kind == []


@pytest.mark.parametrize("radius", [-1.0, np.nan])
def test_radii_must_not_be_negative(radius: float) -> None:
    axis = axis_of("square")
    for query in (axis.subgraph, axis.trimmed_offset, axis.reachable, axis.unreachable):
        with pytest.raises(GeometryError):
            query(radius)


# -- extremal disks -------------------------------------------------------------------------------


def test_of_equal_largest_disks_the_leftmost_counts() -> None:
    centre, radius = axis_of("rectangle").largest_disk()
    np.testing.assert_allclose(centre, [-10, 0], atol=1e-9)
    assert radius == pytest.approx(10)
    for name in ("square-frame", "dumbbell", "stadium"):
        one, two = axis_of(name).largest_disk(), reversed_axis_of(name).largest_disk()
        np.testing.assert_allclose(one[0], two[0], atol=1e-6)


@pytest.mark.parametrize(
    "name",
    ["rectangle", "square", "ell", "tee", "cross", "triangle", "star-5", "stadium", "annulus",
     "circle", "ellipse", "ellipse-flat", "needle", "teardrop", "rounded-rectangle"],
)  # fmt: skip
def test_regions_without_a_neck(name: str) -> None:
    assert axis_of(name).narrowest_neck() is None


def test_neck_between_two_corners() -> None:
    place, radius = medial_axis(hourglass()).narrowest_neck() or (np.zeros(2), 0.0)
    np.testing.assert_allclose(place, [0, 0], atol=1e-7)
    assert radius == pytest.approx(3.0, abs=1e-9)


def test_neck_with_parallel_walls_and_equal_necks() -> None:
    place, radius = axis_of("dumbbell").narrowest_neck() or (np.zeros(2), 0.0)
    assert radius == pytest.approx(0.03)
    assert place[0] == pytest.approx(-10, abs=1e-6)
    # a square island leaves four equal necks, and there is a way from each to the next
    assert len(necks(axis_of("square-frame-turned"))) >= 4
    place, radius = axis_of("square-frame-turned").narrowest_neck() or (np.zeros(2), 0.0)
    assert place[0] < -14


def test_smooth_ends_are_no_necks() -> None:
    for name in ("blob-1", "blob-2", "hand"):
        axis = axis_of(name)
        ends = axis.vertex_point[[kind == "end" for kind in axis.vertex_kind]]
        for place in necks(axis)[:, :2] + axis.sites.origin:
            assert np.hypot(*(ends - place).T).min() > 1e-3 * size_of(axis)


# -- trimmed offsets ------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [0.5, 3.0, 9.9])
def test_offset_of_a_rectangle(distance: float) -> None:
    inner = axis_of("rectangle").trimmed_offset(distance)
    width, height = 40 - 2 * distance, 20 - 2 * distance
    assert len(inner) == 1
    assert inner.area == pytest.approx(width * height, rel=1e-12)
    assert inner.length == pytest.approx(2 * (width + height), rel=1e-12)


def test_offset_by_nothing_is_the_region_and_beyond_the_largest_disk_empty() -> None:
    axis = axis_of("ell")
    assert axis.trimmed_offset(0.0).regions == (axis.region,)
    radius = axis.largest_disk()[1]
    for distance in (radius, 1.001 * radius, 100.0):
        inner = axis.trimmed_offset(distance)
        assert (len(inner), inner.area, inner.length) == (0, 0.0, 0.0)


def test_offset_of_an_annulus() -> None:
    inner = axis_of("annulus").trimmed_offset(2.5)
    assert inner.area == pytest.approx(np.pi * (17.5**2 - 10.5**2), rel=1e-12)
    assert inner.length == pytest.approx(2 * np.pi * 28, rel=1e-12)
    assert [len(region.islands) for region in inner] == [1]


@pytest.mark.parametrize("name", ["ellipse", "letter-o"])
def test_offsets_of_smooth_walls_obey_steiner(name: str) -> None:
    """A(d) = A - d L + pi d^2 chi and L(d) = L - 2 pi d chi while nothing is trimmed."""
    region, distance = region_of(name), 0.3
    inner = axis_of(name).trimmed_offset(distance)
    chi = 1 - len(region.islands)
    area = region.area - distance * region.perimeter + np.pi * distance**2 * chi
    assert inner.area == pytest.approx(area, rel=1e-11)
    assert inner.length == pytest.approx(region.perimeter - 2 * np.pi * distance * chi, rel=1e-11)


@pytest.mark.parametrize("name", FEW)
@pytest.mark.parametrize("share", SHARES)
def test_offsets_agree_with_erosion(name: str, share: float) -> None:
    axis = axis_of(name)
    size, distance = size_of(axis), share * axis.largest_disk()[1]
    inner = axis.trimmed_offset(distance)
    eroded = drawn((axis.region,), 1e-6 * size).buffer(-distance, quad_segs=256)
    # Walls that the drawing rounds off tangency shift by the offset times their turn.
    assert abs(inner.area - eroded.area) <= 1e-4 * size**2
    assert inner.length == pytest.approx(eroded.length, abs=1e-2 * size)
    # The closed forms are those of the curves.
    assert inner.area == pytest.approx(total_area(inner.regions), abs=1e-10 * size**2)
    perimeter = sum(region.perimeter for region in inner)
    assert inner.length == pytest.approx(perimeter, abs=1e-9 * size)


@pytest.mark.parametrize("name", ["ell", "islands-grid", "comma", "letter-o", "rounded-slot"])
def test_offsets_do_not_depend_on_direction(name: str) -> None:
    distance = 0.5 * axis_of(name).largest_disk()[1]
    one, two = (
        axis_of(name).trimmed_offset(distance),
        reversed_axis_of(name).trimmed_offset(distance),
    )
    assert one.area == pytest.approx(two.area, rel=1e-8)
    assert one.length == pytest.approx(two.length, rel=1e-7)
    assert len(one) == len(two)


def test_offset_parts_at_a_neck_of_exactly_that_radius() -> None:
    axis = medial_axis(hourglass())
    assert len(axis.trimmed_offset(3.0)) == 2
    assert len(axis.trimmed_offset(3.0 - 1e-6)) == 1
    assert len(axis.trimmed_offset(3.0 + 1e-6)) == 2
    near, at = axis.trimmed_offset(3.0 - 1e-6), axis.trimmed_offset(3.0)
    assert at.area == pytest.approx(near.area, abs=1e-3)


@pytest.mark.parametrize("name", ["comb", "islands-grid", "star-9", "letter-e"])
def test_offsets_at_branch_points_are_between_their_neighbours(name: str) -> None:
    axis = axis_of(name)
    branch = [kind == "branch" for kind in axis.vertex_kind]
    for radius in np.unique(np.round(axis.vertex_radius[branch], 9))[:6]:
        areas = [axis.trimmed_offset(r).area for r in (radius - 1e-5, radius, radius + 1e-5)]
        assert areas[0] > areas[1] > areas[2] or areas[1] == areas[2] == 0


# -- openings -------------------------------------------------------------------------------------


def corner_sliver(angle: float, radius: float) -> float:
    """Area that a disk leaves in a corner of the given inner angle."""
    return radius**2 * (1 / np.tan(angle / 2) - (np.pi - angle) / 2)


@pytest.mark.parametrize("corners", [3, 6])
@pytest.mark.parametrize("radius", [0.5, 4.0])
def test_corners_of_polygons_are_left(corners: int, radius: float) -> None:
    axis = axis_of({3: "triangle", 6: "hexagon"}[corners])
    rest = axis.unreachable(radius)
    assert len(rest) == corners
    sliver = corner_sliver(np.pi - 2 * np.pi / corners, radius)
    np.testing.assert_allclose([region.area for region in rest], sliver, rtol=1e-9)


def test_reflex_corners_are_reached() -> None:
    axis = axis_of("ell")
    rest = axis.unreachable(2.0)
    assert len(rest) == 5
    assert total_area(rest) == pytest.approx(5 * (4 - np.pi), rel=1e-11)
    (covered,) = axis.reachable(2.0)
    kinds = [type(curve).__name__ for curve in covered.outer.curves]
    assert (kinds.count("Line"), kinds.count("Arc")) == (6, 5)


def test_slot_as_wide_as_the_tool_is_reached() -> None:
    axis = axis_of("stadium")
    assert axis.reachable(8.0) == (axis.region,)
    assert axis.unreachable(8.0) == ()
    slot = axis_of("rectangle")
    assert total_area(slot.unreachable(10.0)) == pytest.approx((4 - np.pi) * 100, rel=1e-7)


def test_fillets_of_the_tool_radius_are_reached() -> None:
    axis = axis_of("rounded-rectangle")
    assert axis.unreachable(5.0) == ()
    assert axis.unreachable(4.0) == ()
    assert len(axis.unreachable(5.001)) == 4


def test_everything_and_nothing() -> None:
    axis = axis_of("ellipse")
    assert axis.reachable(0.0) == (axis.region,)
    assert axis.unreachable(0.0) == ()
    # the least radius of curvature is 18^2 / 30
    assert axis.reachable(10.7) == (axis.region,)
    assert len(axis.unreachable(10.9)) == 2
    assert axis.reachable(18.1) == ()
    assert axis.unreachable(18.1) == (axis.region,)
    circle = axis_of("circle")
    assert circle.reachable(10.0) == (circle.region,)
    assert circle.unreachable(10.1) == (circle.region,)


def test_neck_narrower_than_the_tool() -> None:
    axis, radius = axis_of("dumbbell"), 5.0
    covered, rest = axis.reachable(radius), axis.unreachable(radius)
    half = np.arcsin(0.03 / radius)
    cap = radius**2 / 2 * (2 * half - np.sin(2 * half))
    assert len(covered) == 2
    for region in covered:
        expected = 400 - 4 * corner_sliver(np.pi / 2, radius) + cap
        assert region.area == pytest.approx(expected, rel=1e-9)
    assert len(rest) == 9
    neck = max(region.area for region in rest if region.bounds()[2] - region.bounds()[0] > 15)
    assert neck == pytest.approx(20 * 0.06 - 2 * cap, rel=1e-7)


def test_disks_that_overlap_in_a_neck_leave_slivers_at_its_walls() -> None:
    axis = medial_axis(shapes.dumbbell(neck=6.0, throat=1.0))
    (covered,) = axis.reachable(5.0)
    rest = axis.unreachable(5.0)
    assert covered.area + total_area(rest) == pytest.approx(axis.region.area, rel=1e-12)
    slivers = [region for region in rest if region.bounds()[2] - region.bounds()[0] < 1.01]
    # between the wall and circles about (4.5, 0) and (-4.5, 0), which touch it at its ends

    def under(x: float) -> float:
        return float(0.5 * (x * np.sqrt(25 - x**2) + 25 * np.arcsin(x / 5)))

    expected = 2 * (1.5 - (under(4.5) - under(4.0)))
    np.testing.assert_allclose([region.area for region in slivers], [expected] * 2, rtol=1e-9)


def test_neck_between_two_corners_is_crossed_by_overlapping_disks() -> None:
    """Both disks touch both corners: nothing is left between them."""
    axis = medial_axis(hourglass())
    (covered,) = axis.reachable(3.1)
    rest = axis.unreachable(3.1)
    assert len(rest) == 4
    for region in rest:
        assert abs(region.bounds()[0]) > 5
    assert covered.area + total_area(rest) == pytest.approx(axis.region.area, rel=1e-12)


def test_three_disks_leave_a_triangle_of_arcs() -> None:
    axis, radius = medial_axis(three_rooms()), 4.2
    rest = axis.unreachable(radius)
    (hole,) = [r for r in rest if np.abs(np.array(r.bounds())).max() < 4]
    assert [type(curve) for curve in hole.outer.curves] == [Arc] * 3
    # arcs about three centres at 120 degrees, `away` from the middle: a triangle less 3 segments
    away = 2.0 + np.sqrt(radius**2 - 12.0)
    inner = away / 2 - np.sqrt(radius**2 - 3 * away**2 / 4)
    side = np.sqrt(3) * inner
    half = np.arcsin(side / 2 / radius)
    segment = radius**2 / 2 * (2 * half - np.sin(2 * half))
    assert hole.area == pytest.approx(np.sqrt(3) / 4 * side**2 - 3 * segment, rel=1e-6)
    covered = axis.reachable(radius)
    assert len(covered) == 1
    assert total_area(covered) + total_area(rest) == pytest.approx(axis.region.area, rel=1e-12)


@pytest.mark.parametrize("name", FEW)
def test_reached_and_left_make_up_the_region(name: str) -> None:
    axis = axis_of(name)
    size = size_of(axis)
    drawing = drawn((axis.region,), 1e-6 * size)
    areas = []
    for share in SHARES:
        radius = share * axis.largest_disk()[1]
        covered, rest = axis.reachable(radius), axis.unreachable(radius)
        at_origin = 1e-12 + 1e-17 * np.abs(axis.region.bounds()).max() ** 2 / size**2
        defect = total_area(covered) + total_area(rest) - axis.region.area
        assert abs(defect) <= (1e-9 if name == "comb" else 10 * at_origin) * size**2
        fitting = radius * (1 - 1e-6)
        opened = drawing.buffer(-fitting, quad_segs=256).buffer(fitting, quad_segs=256)
        assert abs(total_area(covered) - opened.area) <= 2e-4 * size**2
        areas.append(total_area(covered))
    slack = 1e-10 * size**2
    assert areas[0] >= areas[1] - slack and areas[1] >= areas[2] - slack


@pytest.mark.parametrize("name", ["comb", "star-5", "islands-grid", "letter-e", "blob-islands"])
def test_a_point_is_reached_if_a_disk_that_fits_holds_it(name: str) -> None:
    axis = axis_of(name)
    size, radius = size_of(axis), 0.57 * axis.largest_disk()[1]
    points = points_inside(axis, 400)
    covered = np.any([region.contains(points) for region in axis.reachable(radius)], axis=0)
    rest = np.any([region.contains(points) for region in axis.unreachable(radius)], axis=0)
    inner = drawn(axis.trimmed_offset(radius).regions, 1e-7 * size)
    distance = shapely.distance(shapely.points(points), inner)
    clear = np.abs(distance - radius) > 1e-5 * size
    assert np.array_equal(covered[clear], (distance < radius)[clear])
    assert np.array_equal(covered, ~rest)


@pytest.mark.parametrize("name", ["ell", "islands-grid", "comma", "letter-o"])
def test_openings_do_not_depend_on_direction(name: str) -> None:
    radius = 0.6 * axis_of(name).largest_disk()[1]
    one, two = axis_of(name).unreachable(radius), reversed_axis_of(name).unreachable(radius)
    assert len(one) == len(two)
    assert total_area(one) == pytest.approx(total_area(two), rel=1e-6, abs=1e-9)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6),
    corners=st.integers(4, 12),
    shares=st.lists(st.floats(0.01, 1.0), min_size=2, max_size=2),
)
def test_random_polygons(seed: int, corners: int, shares: list[float]) -> None:
    draw = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(corners) + draw.uniform(-0.3, 0.3, corners)) / corners
    axis = medial_axis(shapes.polygon(shapes.polar(draw.uniform(5, 30, corners), angle)))
    largest = axis.largest_disk()[1]
    radii = [share * largest for share in shares] + [float(axis.vertex_radius.max() / 2)]
    for radius in radii:
        covered, rest = axis.reachable(radius), axis.unreachable(radius)
        assert total_area(covered) + total_area(rest) == pytest.approx(axis.region.area, abs=1e-6)
        assert axis.subgraph(radius).component_count == len(axis.trimmed_offset(radius))


# -- ways -----------------------------------------------------------------------------------------


def test_way_through_a_throat() -> None:
    axis = axis_of("dumbbell")
    way = axis.path((-20, 0), (20, 0))
    assert way.length == pytest.approx(40, abs=1e-9)
    assert way.clearance == pytest.approx(0.03, abs=1e-12)
    line = way.points(1e-3)
    np.testing.assert_allclose(line[[0, -1]], [(-20, 0), (20, 0)], atol=1e-9)
    np.testing.assert_allclose(line[:, 1], 0, atol=1e-9)
    assert np.all(np.diff(line[:, 0]) > 0)
    assert axis.path((-20, 0), (20, 0), 0.03).length == pytest.approx(40, abs=1e-9)


def test_a_neck_bars_the_way_and_is_named() -> None:
    with pytest.raises(GeometryError, match=r"a neck has 0\.03 mm") as caught:
        axis_of("dumbbell").path((-20, 0), (20, 0), 1.0)
    assert caught.value.place is not None
    x, y = caught.value.place
    assert abs(float(x)) <= 10 + 1e-6
    assert abs(float(y)) < 1e-9
    with pytest.raises(GeometryError, match=r"a neck has 3 mm only") as caught:
        medial_axis(hourglass()).path((-18, 0), (18, 0), 3.5)
    np.testing.assert_allclose(np.array(caught.value.place, dtype=float), [0, 0], atol=1e-6)


def test_no_place_is_wide_enough() -> None:
    with pytest.raises(GeometryError, match="no place on the axis"):
        axis_of("ell").path((1, 1), (2, 2), 50.0)


def test_way_around_an_annulus_is_the_shorter_one() -> None:
    axis = axis_of("annulus")
    for angle in (0.3, 1.5, 3.0, 4.0, 6.0):
        way = axis.path(shapes.polar(14.0, 0.2), shapes.polar(10.0, 0.2 + angle))
        assert way.length == pytest.approx(14 * min(angle, 2 * np.pi - angle), abs=1e-5)
        line = way.points(1e-4)
        np.testing.assert_allclose(np.hypot(*line.T), 14.0, atol=2e-4)


def test_way_to_the_same_place_has_no_length() -> None:
    axis = axis_of("comma")
    way = axis.path((1.0, 1.0), (1.0, 1.0))
    assert way.length == 0
    assert len(way.legs) == 1
    assert len(way.points(0.1)) == 2
    circle = axis_of("circle").path((0, 0), (9, 9))
    assert (circle.length, circle.legs) == (0.0, [])
    np.testing.assert_allclose(circle.points(0.1), [(3, -2)], atol=1e-9)


WAYS = ["ell", "comb", "islands-grid", "annulus-eccentric", "hand", "letter-e", "letter-o", "comma"]


@pytest.mark.parametrize("name", WAYS)
def test_ways_are_symmetric_additive_and_keep_their_clearance(name: str) -> None:
    axis = axis_of(name)
    size = size_of(axis)
    points = points_inside(axis, 12, seed=3)
    for one, two in zip(points[::2], points[1::2], strict=True):
        way, back = axis.path(one, two), axis.path(two, one)
        assert way.length == pytest.approx(back.length, rel=1e-12)
        line = way.points(1e-7 * size)
        assert np.hypot(*np.diff(line, axis=0).T).sum() == pytest.approx(
            way.length, abs=1e-5 * size
        )
        assert axis.clearance(line).min() >= way.clearance - 1e-6
        assert axis.clearance(line).min() <= way.clearance + 1e-3 * size
        middle = line[len(line) // 2]
        first, second = axis.path(one, middle), axis.path(middle, two)
        assert first.length + second.length == pytest.approx(way.length, abs=1e-9 * size)
        for (_, _, end), (_, start, _) in zip(way.legs, way.legs[1:], strict=False):
            assert {end, start} <= {0.0, 1.0}


@pytest.mark.parametrize("name", ["comb", "islands-grid", "letter-e", "comma"])
def test_wider_ways_are_longer_or_barred(name: str) -> None:
    axis = axis_of(name)
    one, two = points_inside(axis, 40, seed=5)[[0, -1]]
    ends = axis.nearest_axis_point([one, two])
    least = float(ends.radius.min())
    last = 0.0
    for share in (0.0, 0.3, 0.6, 0.9):
        try:
            way = axis.path(*ends.point, minimum_clearance=share * least)
        except GeometryError as error:
            assert error.place is not None
            assert axis.clearance(np.array([error.place], dtype=float))[0] < share * least
            break
        assert way.clearance >= share * least * (1 - 1e-6)
        assert way.length >= last * (1 - 1e-9)
        last = way.length


def test_malformed_ways_are_refused() -> None:
    axis = axis_of("ell")
    with pytest.raises(GeometryError, match="one point to one other"):
        axis.path([(0, 0), (1, 1)], (2, 2))
    with pytest.raises(GeometryError, match="minimum radius"):
        axis.path((0, 0), (1, 1), -1.0)
    with pytest.raises(GeometryError, match="chord tolerance"):
        axis.path((1, 1), (2, 2)).points(0.0)


@pytest.mark.parametrize("name", ["letter-d", "teardrop"])
def test_answers_are_the_same_after_pickling(name: str) -> None:
    axis = axis_of(name)
    again: MedialAxis = pickle.loads(pickle.dumps(axis))
    radius = 0.5 * axis.largest_disk()[1]
    assert total_area(axis.reachable(radius)) == total_area(again.reachable(radius))
    assert axis.trimmed_offset(radius).length == again.trimmed_offset(radius).length
    assert axis.subgraph(radius).length == again.subgraph(radius).length
    assert axis.path((1, 1), (9, 9)).legs == again.path((1, 1), (9, 9)).legs


def test_curves_of_openings_are_walls_and_arcs() -> None:
    axis = axis_of("letter-s")
    radius = 0.9 * axis.largest_disk()[1]
    for region in (*axis.reachable(radius), *axis.unreachable(radius)):
        arcs = [curve for curve in region.curves if isinstance(curve, Arc)]
        assert all(curve.radius == radius for curve in arcs)
        assert all(isinstance(curve, Arc | Bezier | Line) for curve in region.curves)
        for curve in region.curves:
            if not isinstance(curve, Arc):
                away = axis.clearance(curve.point(np.linspace(0, 1, 5)))
                np.testing.assert_allclose(away, 0, atol=1e-9)


# -- examples -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["queries", "parts", "ways", "trimmed", "opening"])
def test_examples_hold(name: str) -> None:
    module = importlib.import_module(f"grassfire.medial.{name}")
    result = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
    assert result.failed == 0
    assert result.attempted > 0


def test_loops_of_an_offset_are_those_of_its_regions() -> None:
    inner = axis_of("annulus").trimmed_offset(1.0)
    assert [type(loop) for loop in inner.loops] == [Loop, Loop]
    assert inner.distance == 1.0
