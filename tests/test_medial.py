"""Laws of the medial axis transform: closed forms, empty disks, areas, invariance, offsets."""

from __future__ import annotations

import json
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
from grassfire.geometry import Arc, Line, Loop, ParallelCurve, Region, flatten
from grassfire.geometry.chebyshev import evaluate_bezier
from grassfire.medial import MedialAxis, OffsetNode, medial_axis

FloatArray = NDArray[np.float64]

LISTED = list(shapes.EVERY)
OFFSET = [
    "rectangle", "ell", "comb", "dumbbell", "islands-grid", "rounded-rectangle",
    "annulus-eccentric", "teardrop", "rounded-slot", "ellipse", "blob-islands", "letter-s",
]  # fmt: skip


# -- helpers --------------------------------------------------------------------------------------


@cache
def region_of(name: str) -> Region:
    return shapes.EVERY[name]()


@cache
def axis_of(name: str) -> MedialAxis:
    return medial_axis(region_of(name))


def size_of(region: Region) -> float:
    xmin, ymin, xmax, ymax = region.bounds()
    return float(np.hypot(xmax - xmin, ymax - ymin))


def figure(region: Region, accuracy: float) -> shapely.Polygon:
    """The region as a polygon, chords within `accuracy` of the curves."""
    rings = [flatten(loop, accuracy) for loop in region.loops]
    return shapely.Polygon(rings[0], rings[1:])


@cache
def figure_of(name: str) -> shapely.Polygon:
    """The region within 1e-8 of its size, prepared."""
    region = region_of(name)
    drawn = figure(region, 1e-8 * size_of(region))
    shapely.prepare(drawn)
    return drawn


@cache
def _chords(name: str) -> shapely.STRtree:
    region = region_of(name)
    rings = [flatten(loop, 1e-8 * size_of(region)) for loop in region.loops]
    return shapely.STRtree(
        np.concatenate([shapely.linestrings(np.stack([r[:-1], r[1:]], axis=1)) for r in rings])
    )


def distance_to_boundary(name: str, points: FloatArray) -> FloatArray:
    """Distance by brute force, within 1e-8 of the region's size."""
    places = shapely.points(points)
    return np.asarray(
        _chords(name).query_nearest(places, return_distance=True, all_matches=False)[1]
    )


def disks_of(axis: MedialAxis, samples: int = 15) -> FloatArray:
    """(n, 3) disks along all edges, and the vertices."""
    parts = [np.column_stack([axis.vertex_point, axis.vertex_radius])]
    fraction = np.linspace(0, 1, samples)
    for edge in axis.edges:
        table = np.column_stack([edge.control_points, edge.radius])
        parts.append(evaluate_bezier(table, fraction))
    return np.concatenate(parts)


def distance_to_axis(points: FloatArray, axis: MedialAxis, samples: int = 400) -> FloatArray:
    """Distance of points to the axis, its edges drawn with chords."""
    lines = []
    for edge in axis.edges:
        count = 2 if edge.control_points.shape[0] == 2 else samples
        lines.append(evaluate_bezier(edge.control_points, np.linspace(0, 1, count)))
    drawn = shapely.STRtree([shapely.LineString(line) for line in lines])
    return np.asarray(
        drawn.query_nearest(shapely.points(points), return_distance=True, all_matches=False)[1]
    )


def degrees(axis: MedialAxis) -> NDArray[np.int64]:
    ends = np.array([(edge.start, edge.end) for edge in axis.edges], dtype=np.int64)
    return np.bincount(ends.ravel(), minlength=len(axis.vertex_radius))


def census(axis: MedialAxis) -> tuple[int, int]:
    """Number of ends and of branch points."""
    count = degrees(axis)
    return int(np.sum(count == 1)), int(np.sum(count >= 3))


def components(axis: MedialAxis) -> int:
    owner = np.arange(len(axis.vertex_radius))
    for _ in range(len(owner)):
        before = owner.copy()
        for edge in axis.edges:
            owner[[edge.start, edge.end]] = min(owner[edge.start], owner[edge.end])
        if np.array_equal(before, owner):
            break
    return len(np.unique(owner))


# -- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("major", "minor"), [(30.0, 18.0), (30.0, 29.0), (30.0, 3.0)])
def test_axis_of_an_ellipse_is_its_segment(major: float, minor: float) -> None:
    axis = medial_axis(shapes.ellipse(major, minor))
    disks = disks_of(axis, 60)
    reach = (major**2 - minor**2) / major
    assert np.abs(disks[:, 1]).max() <= 2e-6
    assert np.abs(disks[:, 0]).max() == pytest.approx(reach, abs=2e-6)
    x = np.clip(disks[:, 0], -reach, reach)
    expected = minor * np.sqrt(1 - x**2 / (major**2 - minor**2))
    assert np.abs(disks[:, 2] - expected).max() <= 2e-6
    ends = np.flatnonzero(degrees(axis) == 1)
    np.testing.assert_allclose(np.sort(axis.vertex_point[ends, 0]), [-reach, reach], atol=1e-9)
    np.testing.assert_allclose(axis.vertex_radius[ends], minor**2 / major, atol=1e-9)
    assert census(axis) == (2, 0)


def test_rectangle_has_five_edges() -> None:
    axis = medial_axis(shapes.rectangle(40.0, 20.0))
    order = np.lexsort(np.round(axis.vertex_point, 6).T)
    np.testing.assert_allclose(
        axis.vertex_point[order],
        [(-20, -10), (20, -10), (-10, 0), (10, 0), (-20, 10), (20, 10)],
        atol=1e-12,
    )
    np.testing.assert_allclose(axis.vertex_radius[order], [0, 0, 10, 10, 0, 0], atol=1e-12)
    assert sorted(axis.vertex_kind) == ["branch"] * 2 + ["corner"] * 4
    assert len(axis.edges) == 5
    assert {len(edge.radius) for edge in axis.edges} == {2}


def test_square_has_one_branch_point_of_four_edges() -> None:
    axis = medial_axis(shapes.square(20.0))
    assert census(axis) == (4, 1)
    assert degrees(axis).max() == 4
    assert axis.vertex_radius.max() == pytest.approx(10.0, abs=1e-12)


@pytest.mark.parametrize("corners", [3, 5, 6, 11])
def test_regular_polygon_has_one_branch_point(corners: int) -> None:
    axis = medial_axis(shapes.regular_polygon(corners, 20.0))
    assert census(axis) == (corners, 1)
    centre, radius = axis.largest_disk()
    np.testing.assert_allclose(centre, 0.0, atol=1e-11)
    assert radius == pytest.approx(20.0 * np.cos(np.pi / corners), abs=1e-11)


def test_reflex_corner_of_an_ell_gives_parabolas() -> None:
    """Between corner (w, w) and the lines x = 0 and y = 0: distance to the corner equals x or y."""
    width = 10.0
    axis = medial_axis(shapes.ell(30.0, width))
    disks = disks_of(axis, 40)
    x, y, r = disks.T
    far = np.hypot(x - width, y - width)
    facing = (np.abs(far - r) < 1e-6) & (r > 0.5 * width + 1e-6)
    assert facing.sum() > 60
    wall = np.minimum(x, y)[facing]
    assert np.abs(wall - r[facing]).max() <= 1e-6
    # The diagonal meets both parabolas where t = sqrt(2) (w - t).
    centre, radius = axis.largest_disk()
    expected = width * np.sqrt(2) / (1 + np.sqrt(2))
    np.testing.assert_allclose([*centre, radius], [expected] * 3, atol=1e-9)


@pytest.mark.parametrize("parts", [1, 2, 3, 8])
def test_axis_of_a_disk_is_one_vertex(parts: int) -> None:
    axis = medial_axis(shapes.circle(10.0, parts, (3.0, -2.0)))
    assert axis.edges == ()
    np.testing.assert_allclose(axis.vertex_point, [(3.0, -2.0)], atol=1e-12)
    np.testing.assert_allclose(axis.vertex_radius, [10.0], atol=1e-12)


def test_concentric_annulus_has_the_circle_between() -> None:
    axis = medial_axis(shapes.annulus(20.0, 8.0))
    disks = disks_of(axis, 50)
    np.testing.assert_allclose(np.hypot(disks[:, 0], disks[:, 1]), 14.0, atol=1e-6)
    np.testing.assert_allclose(disks[:, 2], 6.0, atol=1e-6)
    assert len(axis.vertex_radius) == len(axis.edges)
    assert set(axis.vertex_kind) == {"joint"}


def test_eccentric_annulus_has_an_ellipse() -> None:
    """Sum of the distances to both centres is the sum of the radii."""
    axis = medial_axis(shapes.annulus(20.0, 8.0, 5.0))
    disks = disks_of(axis, 50)
    total = np.hypot(disks[:, 0], disks[:, 1]) + np.hypot(disks[:, 0] - 5.0, disks[:, 1])
    np.testing.assert_allclose(total, 28.0, atol=2e-6)
    neck = axis.narrowest_neck()
    assert neck is not None
    np.testing.assert_allclose(neck[0], (16.5, 0.0), atol=1e-4)
    assert neck[1] == pytest.approx(3.5, abs=1e-6)


def test_stadium_ends_in_the_centres_of_its_arcs() -> None:
    axis = medial_axis(shapes.stadium(30.0, 8.0))
    order = np.argsort(axis.vertex_point[:, 0])
    np.testing.assert_allclose(axis.vertex_point[order], [(-15, 0), (15, 0)], atol=1e-10)
    np.testing.assert_allclose(axis.vertex_radius, 8.0, atol=1e-10)
    assert len(axis.edges) == 1


def test_needle_reaches_its_tip() -> None:
    axis = medial_axis(shapes.needle(0.5, 50.0))
    half = np.radians(0.25)
    disks = disks_of(axis, 30)
    along = disks[np.abs(disks[:, 1]) < 1e-9]
    wedge = along[along[:, 0] < 49.0]
    assert len(wedge) > 10
    np.testing.assert_allclose(wedge[:, 2], wedge[:, 0] * np.sin(half), atol=1e-9)
    assert "corner" in axis.vertex_kind


# -- every region ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LISTED)
def test_certificate_holds(name: str) -> None:
    region, certificate = region_of(name), axis_of(name).certificate
    assert certificate.euler
    assert certificate.max_disk_error <= 1e-6
    assert certificate.interpolation_error <= 1e-6
    assert certificate.area_error <= 1e-5 * region.perimeter + 1e-12 * size_of(region) ** 2


@pytest.mark.parametrize("name", LISTED)
def test_disks_are_empty_and_touch(name: str) -> None:
    """Against points and chords of a fine flattening, not the engine's own search."""
    region, axis = region_of(name), axis_of(name)
    size = size_of(region)
    accuracy = 1e-8 * size
    disks = disks_of(axis)
    away = distance_to_boundary(name, disks[:, :2])
    rounding = 1e-13 * np.abs(region.bounds()).max()
    assert np.abs(away - disks[:, 2]).max() <= 1.01e-6 + accuracy + rounding
    inner = disks[disks[:, 2] > 2e-6 + accuracy]
    assert region.contains(inner[:, :2]).all()


@pytest.mark.parametrize("name", LISTED)
def test_graph_is_connected_as_the_region_is(name: str) -> None:
    region, axis = region_of(name), axis_of(name)
    assert len(axis.vertex_radius) - len(axis.edges) == 1 - len(region.islands)
    assert components(axis) == 1
    if axis.edges:
        names = np.array(["", "end", "joint", "branch"])[np.minimum(degrees(axis), 3)]
        sharp = (axis.vertex_radius <= 1e-9 * size_of(region)) & (degrees(axis) == 1)
        assert axis.vertex_kind == list(np.where(sharp, "corner", names))


@pytest.mark.parametrize("name", LISTED)
def test_edges_end_at_their_vertices(name: str) -> None:
    axis = axis_of(name)
    slack = 1e-6 + 1e-13 * np.abs(axis.vertex_point).max()
    for edge in axis.edges:
        for vertex, place in ((edge.start, 0), (edge.end, -1)):
            gap = edge.control_points[place] - axis.vertex_point[vertex]
            assert np.hypot(*gap) <= slack
            assert abs(edge.radius[place] - axis.vertex_radius[vertex]) <= slack


@pytest.mark.parametrize("name", ["ell", "star-5", "comb", "islands-grid", "ellipse", "letter-e"])
def test_every_convex_corner_has_its_end(name: str) -> None:
    region, axis = region_of(name), axis_of(name)
    tables = [loop.junctions(1e-4) for loop in region.loops]
    convex = np.concatenate([table.point[table.kind == 1] for table in tables])
    corner = axis.vertex_point[np.array(axis.vertex_kind) == "corner"]
    assert len(corner) == len(convex)
    if len(convex):
        assert cKDTree(corner).query(convex)[0].max() <= 1e-9


@pytest.mark.parametrize(
    "name", ["ell", "star-9", "islands-grid", "teardrop", "blob-1", "letter-d"]
)
def test_disks_fill_the_region(name: str) -> None:
    """Area of the union of the disks, by sampling: every point is in a disk of the axis."""
    region, axis = region_of(name), axis_of(name)
    draw = np.random.default_rng(2)
    xmin, ymin, xmax, ymax = region.bounds()
    points = draw.uniform((xmin, ymin), (xmax, ymax), (600, 2))
    points = points[region.contains(points)]
    disks = disks_of(axis, 200)
    chord = points[:, None] - disks[None, :, :2]
    depth = np.hypot(chord[..., 0], chord[..., 1]) - disks[None, :, 2]
    # Neighbouring samples of an edge leave slivers of second order between their disks.
    assert depth.min(axis=1).max() <= 2e-3 * size_of(region)


# -- invariance -----------------------------------------------------------------------------------


def same_axis(one: MedialAxis, other: MedialAxis, accuracy: float) -> None:
    """Same census, same set of points."""
    assert census(one) == census(other)
    for first, second in ((one, other), (other, one)):
        if first.edges:
            points = disks_of(first, 7)[:, :2]
            assert distance_to_axis(points, second).max() <= accuracy


def reversed_region(region: Region) -> Region:
    return Region(region.outer.reversed(), tuple(loop.reversed() for loop in region.islands))


def restarted_region(region: Region, shift: int) -> Region:
    return Region(
        region.outer.start_at(shift), tuple(loop.start_at(shift) for loop in region.islands)
    )


INVARIANT = ["ell", "star-5", "islands-grid", "teardrop", "annulus-eccentric", "letter-o", "comma"]


@pytest.mark.parametrize("name", INVARIANT)
def test_direction_of_definition_does_not_matter(name: str) -> None:
    same_axis(axis_of(name), medial_axis(reversed_region(region_of(name))), 5e-5)


@pytest.mark.parametrize("name", [name for name in INVARIANT if name != "annulus-eccentric"])
def test_first_curve_does_not_matter(name: str) -> None:
    same_axis(axis_of(name), medial_axis(restarted_region(region_of(name), 2)), 5e-5)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(
    name=st.sampled_from(["ell", "star-5", "teardrop", "rounded-rectangle", "letter-e"]),
    angle=st.floats(0, 6.28),
    shift=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    scale=st.floats(0.05, 20.0),
)
def test_axis_moves_with_its_region(
    name: str, angle: float, shift: tuple[float, float], scale: float
) -> None:
    axis = axis_of(name)
    other = medial_axis(shapes.moved(region_of(name), angle, shift, scale))
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    matrix = np.array([[c, -s], [s, c]])
    assert census(other) == census(axis)
    disks = disks_of(axis, 7)
    moved = disks[:, :2] @ matrix.T + shift
    away = distance_to_axis(moved, other)
    assert away.max() <= 2e-5 * max(scale, 1.0)
    assert other.largest_disk()[1] == pytest.approx(scale * axis.largest_disk()[1], rel=1e-6)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(corners=st.integers(3, 14), seed=st.integers(0, 10**6))
def test_random_inscribed_polygons(corners: int, seed: int) -> None:
    """A convex polygon of n corners has n ends, and every bisector is a straight edge."""
    axis = medial_axis(shapes.irregular_inscribed(corners, 20.0, seed))
    assert axis.vertex_kind.count("corner") == corners
    assert {len(edge.radius) for edge in axis.edges} == {2}


@settings(max_examples=3, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), points=st.integers(8, 12))
def test_random_splines(seed: int, points: int) -> None:
    region = shapes.blob(seed, points, 40.0, 0.3)
    axis = medial_axis(region)
    assert axis.certificate.max_disk_error <= 1e-6
    centre, radius = axis.largest_disk()
    drawn = figure(region, 1e-5)
    circle = shapely.maximum_inscribed_circle(drawn, tolerance=1e-3)
    assert circle.length - 2e-3 <= radius
    assert abs(drawn.boundary.distance(shapely.Point(centre)) - radius) <= 2e-5


@pytest.mark.parametrize("name", ["comb", "islands-grid", "rounded-slot", "comma"])
def test_same_input_gives_the_same_bytes(name: str) -> None:
    first = json.dumps(medial_axis(shapes.EVERY[name]()).to_dict())
    second = json.dumps(medial_axis(shapes.EVERY[name]()).to_dict())
    assert first == second


def test_output_has_the_agreed_keys() -> None:
    entry = axis_of("islands-grid").to_dict()
    assert set(entry) == {"area", "holes", "vertices", "edges", "certificate"}
    assert entry["holes"] == 6
    assert set(entry["vertices"][0]) == {"x", "y", "r", "kind"}
    assert set(entry["edges"][0]) == {"start", "end", "control_points", "radius"}
    assert {
        "interpolation_error",
        "recovery_error",
        "area_error",
        "max_disk_error",
        "euler",
    } <= set(entry["certificate"])
    for edge in entry["edges"]:
        assert len(edge["control_points"]) == len(edge["radius"])


# -- queries --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", OFFSET)
def test_clearance_is_the_signed_distance(name: str) -> None:
    region, axis = region_of(name), axis_of(name)
    draw = np.random.default_rng(7)
    xmin, ymin, xmax, ymax = region.bounds()
    margin = 0.1 * np.array([xmax - xmin, ymax - ymin])
    points = draw.uniform(
        np.array([xmin, ymin]) - margin, np.array([xmax, ymax]) + margin, (400, 2)
    )
    away = distance_to_boundary(name, points)
    inside = shapely.contains(figure_of(name), shapely.points(points))
    expected = np.where(inside, away, -away)
    found = axis.clearance(points)
    assert found.shape == (400,)
    np.testing.assert_allclose(found, expected, atol=1.1e-8 * size_of(region))


def test_clearance_on_the_boundary_and_at_corners() -> None:
    axis = axis_of("ell")
    points = np.array([(0, 0), (10, 10), (15, 0), (9, 9), (11, 11), (-1, -1), (5, 5)], dtype=float)
    root = np.sqrt(2)
    np.testing.assert_allclose(axis.clearance(points), [0, 0, 0, root, -1, -root, 5], atol=1e-12)


def test_largest_disk() -> None:
    centre, radius = axis_of("rectangle").largest_disk()
    assert radius == pytest.approx(10.0, abs=1e-12)
    assert abs(centre[1]) <= 1e-12
    centre, radius = axis_of("ellipse").largest_disk()
    np.testing.assert_allclose(centre, (0.0, 0.0), atol=1e-4)
    assert radius == pytest.approx(18.0, abs=1e-6)


def test_narrowest_neck() -> None:
    neck = axis_of("dumbbell").narrowest_neck()
    assert neck is not None
    assert abs(neck[0][0]) <= 10.0 + 1e-6
    assert abs(neck[0][1]) <= 1e-9
    assert neck[1] == pytest.approx(0.03, abs=1e-9)
    for name in ("square", "star-5", "circle", "ellipse", "needle"):
        assert axis_of(name).narrowest_neck() is None, name


def test_waist_of_a_spline() -> None:
    waist = np.array(
        [(0, -3), (12, -10), (24, 0), (12, 10), (0, 3), (-12, 10), (-24, 0), (-12, -10)]
    )
    neck = medial_axis(Region(shapes.spline_loop(waist))).narrowest_neck()
    assert neck is not None
    np.testing.assert_allclose(neck[0], (0.0, 0.0), atol=1e-3)
    assert neck[1] == pytest.approx(3.0, abs=1e-5)


# -- offsets --------------------------------------------------------------------------------------


def drawn_node(node: OffsetNode, accuracy: float) -> shapely.Polygon:
    rings = [flatten(loop, accuracy) for loop in node.loops]
    return shapely.Polygon(rings[0], rings[1:])


@pytest.mark.parametrize("share", [0.06, 0.47, 0.93])
@pytest.mark.parametrize("name", OFFSET)
def test_offsets_hold_the_points_of_that_clearance(name: str, share: float) -> None:
    """Random points are in exactly one component if their clearance is above the distance.

    Clearance by distances to a fine flattening. (Erosion of fine polygons is no measure: GEOS
    simplifies what it erodes by a hundredth of the distance.)
    """
    region, axis = region_of(name), axis_of(name)
    distance = share * axis.largest_disk()[1]
    nodes = axis.offset_tree(np.array([distance]))
    parts = [drawn_node(node, 3e-8 * size_of(region)) for node in nodes]
    for node, part in zip(nodes, parts, strict=True):
        # Walls that the drawing rounds off tangency shift by the offset times their turn.
        assert shapely.simplify(part, 1e-6).is_valid
        assert node.area == pytest.approx(part.area, rel=1e-6, abs=1e-6 * region.area)
    draw = np.random.default_rng(11)
    xmin, ymin, xmax, ymax = region.bounds()
    points = draw.uniform((xmin, ymin), (xmax, ymax), (800, 2))
    points = points[region.contains(points)]
    places, away = shapely.points(points), distance_to_boundary(name, points)
    shapely.prepare(parts)
    clear = np.abs(away - distance) > 1e-6 + 5e-8 * size_of(region)
    count = np.sum([shapely.contains(part, places) for part in parts], axis=0)
    np.testing.assert_array_equal(count[clear], (away >= distance)[clear].astype(int))


@pytest.mark.parametrize("share", [0.06, 0.31, 0.71, 0.93])
@pytest.mark.parametrize("name", ["rectangle", "ell", "tee", "cross", "comb", "star-9", "dumbbell",
                                  "islands-grid", "square-frame-turned"])  # fmt: skip
def test_offsets_of_polygons_agree_with_erosion(name: str, share: float) -> None:
    region, axis = region_of(name), axis_of(name)
    distance = share * axis.largest_disk()[1]
    nodes = axis.offset_tree(np.array([distance]))
    eroded = figure(region, 1e-6).buffer(-distance, quad_segs=720)
    parts = [part for part in getattr(eroded, "geoms", [eroded]) if part.area > 0]
    assert len(nodes) == len(parts)
    by_area = sorted(nodes, key=lambda node: -node.area)
    for node, part in zip(by_area, sorted(parts, key=lambda part: -part.area), strict=True):
        assert node.area == pytest.approx(part.area, abs=1e-6 * region.area)
        assert len(node.loops) == 1 + len(part.interiors)


@pytest.mark.parametrize(
    ("name", "distance"),
    [("ellipse", 5.0), ("rounded-rectangle", 4.0), ("stadium", 5.0), ("blob-1", 0.3)],
)
def test_offsets_of_smooth_regions_obey_steiner(name: str, distance: float) -> None:
    """Up to the least radius of curvature the area is A - P d + pi d^2."""
    region = region_of(name)
    (node,) = axis_of(name).offset_tree(np.array([distance]))
    expected = region.area - region.perimeter * distance + np.pi * distance**2
    assert node.area == pytest.approx(expected, rel=1e-8)
    assert node.loops[0].length == pytest.approx(region.perimeter - 2 * np.pi * distance, rel=1e-8)


@pytest.mark.parametrize("name", OFFSET)
def test_offset_loops_are_closed_and_keep_their_distance(name: str) -> None:
    region, axis = region_of(name), axis_of(name)
    size, peak = size_of(region), axis.largest_disk()[1]
    distances = peak * np.array([0.13, 0.37, 0.64, 0.88])
    for node in axis.offset_tree(distances):
        assert node.loops[0].area > 0
        assert all(loop.area < 0 for loop in node.loops[1:])
        assert node.area == pytest.approx(sum(loop.area for loop in node.loops), rel=1e-12)
        for loop in node.loops:
            assert all(isinstance(curve, Line | Arc | ParallelCurve) for curve in loop.curves)
            ends = np.array([curve.end for curve in loop.curves])
            starts = np.array([curve.start for curve in loop.curves])
            assert np.hypot(*(np.roll(starts, -1, axis=0) - ends).T).max() <= 1e-9 * size
            points = loop.point(np.linspace(0, len(loop), 5 * len(loop), endpoint=False))
            np.testing.assert_allclose(axis.clearance(points), node.distance, atol=1e-6)
            inward = points + 1e-4 * size * loop.normal(
                np.linspace(0, len(loop), 5 * len(loop), endpoint=False)
            )
            assert np.median(axis.clearance(inward)) >= node.distance


@pytest.mark.parametrize("name", OFFSET)
def test_parents_hold_their_children(name: str) -> None:
    region, axis = region_of(name), axis_of(name)
    distances = axis.largest_disk()[1] * np.linspace(0.1, 0.9, 5)
    nodes = axis.offset_tree(distances)
    assert [node.level for node in nodes] == sorted(node.level for node in nodes)
    for node in nodes:
        assert node.distance == distances[node.level]
        assert node.peak_radius >= node.distance
        np.testing.assert_allclose(axis.clearance(node.peak[None]), node.peak_radius, atol=2e-6)
        if node.level == 0:
            assert node.parent == -1
            continue
        parent = nodes[node.parent]
        assert parent.level == node.level - 1
        assert parent.area > node.area
        assert parent.peak_radius >= node.peak_radius - 1e-9
        outline = shapely.Polygon(
            flatten(parent.loops[0], 1e-4 * size_of(region)),
            [flatten(loop, 1e-4 * size_of(region)) for loop in parent.loops[1:]],
        )
        inside = node.loops[0].point(np.arange(len(node.loops[0])) + 0.5)
        shapely.prepare(outline)
        assert shapely.distance(outline, shapely.points(inside)).max() <= 1e-3 * size_of(region)


def test_offsets_of_a_dumbbell_part_at_its_neck() -> None:
    nodes = axis_of("dumbbell").offset_tree(np.array([0.02, 0.5, 4.0]))
    assert [node.level for node in nodes] == [0, 1, 1, 2, 2]
    assert [node.parent for node in nodes] == [-1, 0, 0, 1, 2]
    np.testing.assert_allclose([node.peak_radius for node in nodes], 10.0, atol=1e-9)


def test_offsets_of_an_annulus_keep_their_hole() -> None:
    (node,) = axis_of("annulus-eccentric").offset_tree(np.array([2.0]))
    assert len(node.loops) == 2
    assert node.area == pytest.approx(np.pi * (18.0**2 - 10.0**2), rel=1e-8)


def test_offset_of_a_disk() -> None:
    nodes = axis_of("circle").offset_tree(np.array([3.0, 9.0, 11.0]))
    np.testing.assert_allclose([node.area for node in nodes], np.pi * np.array([49.0, 1.0]))
    assert all(isinstance(curve, Arc) for node in nodes for curve in node.loops[0].curves)


def test_lines_stay_lines_and_corners_become_arcs() -> None:
    (node,) = axis_of("ell").offset_tree(np.array([2.0]))
    kinds = [type(curve) for curve in node.loops[0].curves]
    assert kinds.count(Arc) == 1
    assert kinds.count(Line) == 6
    assert node.area == pytest.approx(26 * 6 + 20 * 6 + _ell_corner(2.0), rel=1e-8)


def _ell_corner(distance: float) -> float:
    """What the round of the reflex corner leaves of the square beside it."""
    return distance**2 * (1 - np.pi / 4)


def test_no_distances_give_no_nodes() -> None:
    assert axis_of("square").offset_tree(np.zeros(0)) == ()
    assert axis_of("square").offset_tree(np.array([11.0])) == ()


# -- errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [0.0, -1e-6, float("nan")])
def test_tolerance_must_be_above_zero(tolerance: float) -> None:
    with pytest.raises(GeometryError, match="tolerance"):
        medial_axis(shapes.square(), tolerance)


@pytest.mark.parametrize("distances", [[2.0, 1.0], [1.0, 1.0], [0.0, 1.0], [-1.0]])
def test_distances_must_ascend(distances: list[float]) -> None:
    with pytest.raises(GeometryError, match="ascending"):
        axis_of("square").offset_tree(np.array(distances))


def test_tighter_tolerance_gives_a_tighter_axis() -> None:
    region = shapes.ellipse()
    loose, tight = medial_axis(region, 1e-3), medial_axis(region, 1e-8)
    assert loose.certificate.max_disk_error <= 1e-3
    assert tight.certificate.max_disk_error <= 1e-8
    assert len(loose.edges) <= len(tight.edges)


def test_flat_corners_have_no_branch_unless_asked_for() -> None:
    region = shapes.bent_strip(-1e-3 + 2e-3)
    assert census(medial_axis(region, angular_tolerance=1e-4))[0] == 5
    assert census(medial_axis(region, angular_tolerance=1e-2))[0] == 4


def test_a_loop_that_crosses_itself_is_refused() -> None:
    bow = Loop(
        tuple(
            Line(a, b)
            for a, b in (
                ((0, 0), (30, 0)),
                ((30, 0), (5, 20)),
                ((5, 20), (20, 25)),
                ((20, 25), (0, 0)),
            )
        )
    )
    with pytest.raises(GeometryError):
        medial_axis(Region(bow))


@pytest.mark.parametrize("turn", [3e-6, 1e-5, 3e-5])
def test_ends_too_flat_to_count_leave_the_branch_between_them(turn: float) -> None:
    """Two flat corners at either end of a stadium: four branches go, the axis stays."""
    half, radius = 10.0, 5.0
    angle = np.pi / 2 - turn
    right, left = np.array([half, 0.0]), np.array([-half, 0.0])
    high = right + radius * np.array([np.cos(angle), np.sin(angle)])
    low = high * [1, -1]
    loop = Loop(
        (
            Arc(right, radius, -angle, 2 * angle),
            Line(high, high * [-1, 1]),
            Arc(left, radius, np.pi - angle, 2 * angle),
            Line(low * [-1, 1], low),
        )
    )
    axis = medial_axis(Region(loop))
    assert len(axis.edges) == 1
    assert np.ptp(axis.vertex_point[:, 0]) == pytest.approx(2 * half, abs=1e-3)
