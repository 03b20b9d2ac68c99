"""From regions to boundary sites, and polygons kept as arrays."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import medial_shapes as shapes
from grassfire.errors import GeometryError
from grassfire.geometry import (
    Arc,
    Bezier,
    BSpline,
    Curve,
    Line,
    Loop,
    ParallelCurve,
    Region,
    flatten,
)
from grassfire.medial.build import build_sites
from grassfire.medial.sites import SiteKind, Sites

FloatArray = NDArray[np.float64]
PEERS = Path(__file__).resolve().parents[2] / "shared" / "tools" / "mat_peers" / "shapes"


def sites_of(region: Region) -> Sites:
    return build_sites(region)[0]


def cubic_region(name: str) -> Region:
    path = PEERS / f"{name}.bez.txt"
    if not path.exists():
        pytest.skip("shared shapes are absent")
    rows = np.loadtxt(path).reshape(-1, 4, 2)
    return Region(Loop(tuple(Bezier(row) for row in rows)))


def lengths(sites: Sites) -> FloatArray:
    """Lengths of the sites along the boundary, by chords."""
    index = np.arange(len(sites))
    share = np.linspace(0.0, 1.0, 33)
    total = np.zeros(len(sites))
    before = sites.point(index, sites.low)
    for fraction in share[1:]:
        point = sites.point(index, sites.low + fraction * (sites.high - sites.low))
        total += np.hypot(*(point - before).T)
        before = point
    return total


def assert_joined(sites: Sites, gap: float) -> None:
    """Each site ends where, and in the direction in which, the next one starts."""
    index = np.arange(len(sites))
    end, end_normal, _ = sites.frame(index, sites.high)
    after = sites.following
    start, start_normal, _ = sites.frame(after, sites.low[after])
    assert np.hypot(*(end - start).T).max() <= gap
    np.testing.assert_array_equal(sites.preceding[after], index)
    turn = np.arctan2(
        end_normal[:, 0] * start_normal[:, 1] - end_normal[:, 1] * start_normal[:, 0],
        np.einsum("ij,ij->i", end_normal, start_normal),
    )
    off = np.abs(turn - sites.turn_after)
    assert np.minimum(off, 2 * np.pi - off).max() <= 1e-7


def assert_spirals(sites: Sites) -> None:
    """Curvature is monotone on each spiral but for a sliver, and the turn a quarter at most."""
    rows = np.flatnonzero(sites.kind == SiteKind.SPIRAL)
    share = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 201))
    parameter = sites.low[rows, None] + (sites.high - sites.low)[rows, None] * share
    flat = np.repeat(rows, len(share))
    _, normal, curvature = sites.frame(flat, parameter.ravel())
    curvature = curvature.reshape(parameter.shape)
    change = np.diff(curvature, axis=1)
    wrong = np.minimum(
        np.where(change > 0, change, 0).sum(axis=1), np.where(change < 0, -change, 0).sum(axis=1)
    )
    scale = np.maximum(np.abs(curvature).max(axis=1), 1.0 / sites.size)
    assert np.all(wrong <= 1e-7 * scale)
    normal = normal.reshape(*parameter.shape, 2)
    before, after = normal[:, :-1], normal[:, 1:]
    sine = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    turn = np.arctan2(sine, (before * after).sum(axis=2))
    assert np.abs(turn).sum(axis=1).max(initial=0.0) <= 0.5 * np.pi + 1e-3


# -- laws over many regions -----------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(shapes.EVERY))
def test_sites_join_and_are_spirals(name: str) -> None:
    region = shapes.EVERY[name]()
    sites, beziers = build_sites(region)
    assert_joined(sites, 3e-9 * sites.size)
    assert_spirals(sites)
    assert len(beziers) == len(sites.coefficients)
    kept = sites.kind != SiteKind.POINT
    assert lengths(sites)[kept].sum() == pytest.approx(region.perimeter, rel=1e-3)
    assert np.all(sites.turn_after[sites.corner_after] > 0)
    assert np.all(sites.extent[~kept, 1] < 0)


@pytest.mark.parametrize("name", ["ell", "comma", "rounded-slot", "letter-d", "blob-islands"])
def test_turns_add_to_whole_turns(name: str) -> None:
    sites = sites_of(shapes.EVERY[name]())
    for loop in range(int(sites.loop.max()) + 1):
        rows = np.flatnonzero(sites.loop == loop)
        total = (
            sites.turn_after[rows].sum()
            + sites.extent[rows[sites.kind[rows] == SiteKind.POINT], 1].sum()
        )
        for row in rows[sites.kind[rows] != SiteKind.POINT]:
            parameter = np.linspace(sites.low[row], sites.high[row], 65)
            normal = sites.frame(np.full(65, row), parameter)[1]
            total += np.diff(np.unwrap(np.arctan2(normal[:, 1], normal[:, 0]))).sum()
        assert total == pytest.approx(2 * np.pi if loop == 0 else -2 * np.pi, abs=1e-6)


@pytest.mark.parametrize("name", ["ellipse", "peanut", "flower", "hand"])
def test_cubics_of_shared_shapes(name: str) -> None:
    sites = sites_of(cubic_region(name))
    assert_joined(sites, 1e-9 * sites.size)
    assert_spirals(sites)
    assert lengths(sites).min() > 1e-5 * sites.size


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(2, 5), st.booleans(), st.integers(0, 10**6))
def test_random_curves_are_cut_into_spirals(degree: int, rational: bool, seed: int) -> None:
    draw = np.random.default_rng(seed)
    points = draw.uniform(-10, 10, (degree + 1, 2))
    weights = draw.uniform(0.4, 2.5, degree + 1) if rational and degree < 4 else None
    curve = Bezier(points, weights)
    far = np.array([40.0, -35.0])
    loop = Loop((curve, Line(points[-1], far), Line(far, points[0])))
    assert_spirals(sites_of(Region(loop)))


# -- curves ---------------------------------------------------------------------------------------


def bulge(points: FloatArray) -> Region:
    """Region of a curve over a rectangle."""
    curve = Bezier(points)
    low = np.array([[points[-1, 0], -20.0], [points[0, 0], -20.0]])
    return Region(
        Loop((curve, Line(points[-1], low[0]), Line(low[0], low[1]), Line(low[1], points[0])))
    )


def parabola(start: float, end: float) -> Region:
    """Arc of y = -x^2 / 10 from x = start to end: its one extremum of curvature is at x = 0."""
    handle = (0.5 * (start + end), -start * end / 10)
    return bulge(np.array([(start, -(start**2) / 10), handle, (end, -(end**2) / 10)]))


def spirals_in(region: Region) -> int:
    return int(np.count_nonzero(sites_of(region).kind == SiteKind.SPIRAL))


def test_an_extremum_cuts_unless_it_is_next_to_an_end() -> None:
    assert spirals_in(parabola(-8.0, 8.0)) == 2
    assert spirals_in(parabola(-1e-2, 8.0)) == 2
    for sliver in (1e-6, 1e-9, 1e-12, 0.0):
        assert spirals_in(parabola(-sliver, 8.0)) == 1
        assert spirals_in(parabola(-8.0, sliver)) == 1


def test_two_extrema_next_to_each_other_cancel() -> None:
    # A cubic that is all but a spiral has its extrema in pairs: far apart, or none.
    counts = set()
    for bend in np.linspace(0.0, 3.0, 13):
        region = bulge(np.array([(-8.0, 0.0), (-4.0, bend), (3.0, 5.0), (8.0, 4.0)]))
        sites = sites_of(region)
        assert_spirals(sites)
        spiral = sites.kind == SiteKind.SPIRAL
        assert lengths(sites)[spiral].min() > 1e-6 * sites.size
        counts.add(int(np.count_nonzero(spiral)))
    assert len(counts) > 1


def test_tight_bends_keep_their_cut_however_short() -> None:
    # The bend is as small as the square of the gap between the inner control points.
    for gap in (1e-1, 1e-2, 1e-3, 1e-4):
        # c'(1/2) is 3 gap / 2 along x, where a cusp has none.
        points = np.array([(-5.0, 0.0), (5.0 - gap, 8.0), (gap - 5.0, 8.0), (5.0, 0.0)])
        sites = sites_of(Region(Loop((Bezier(points), Line(points[-1], points[0])))))
        assert_spirals(sites)
        bend = np.abs(sites.frame(np.arange(len(sites)), sites.high)[2]).max()
        assert bend > 1.0 / gap**2


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.floats(-10.0, -1.0), st.integers(0, 10**6))
def test_near_cusps_are_joined_like_any_bend(power: float, seed: int) -> None:
    draw = np.random.default_rng(seed)
    points = np.array([(-5.0, 0.0), (5.0, 8.0), (-5.0, 8.0), (5.0, 0.0)])
    points += 10.0**power * draw.uniform(-1.0, 1.0, (4, 2))
    sites = sites_of(Region(Loop((Bezier(points), Line(points[-1], points[0])))))
    assert_joined(sites, 1e-11 * sites.size)


def test_a_cusp_inside_a_curve_is_a_corner() -> None:
    # c'(1/2) = 0 for these control points: the curve comes up to (0, 6) and turns back.
    points = np.array([(-5.0, 0.0), (5.0, 8.0), (-5.0, 8.0), (5.0, 0.0)])
    convex = sites_of(Region(Loop((Bezier(points), Line(points[-1], points[0])))))
    corner = np.flatnonzero(convex.corner_after & (convex.turn_after > 3.0))
    assert len(corner) == 1
    np.testing.assert_allclose(
        convex.point(corner, convex.high[corner])[0] + convex.origin, (0.0, 6.0), atol=1e-9
    )
    box = [(5.0, 0.0), (20.0, 0.0), (20.0, 20.0), (-20.0, 20.0), (-20.0, 0.0), (-5.0, 0.0)]
    sides = [Line(a, b) for a, b in pairwise(box)]
    reflex = sites_of(Region(Loop((Bezier(points), *sides))))
    fan = np.flatnonzero(reflex.kind == SiteKind.POINT)
    np.testing.assert_allclose(np.sort(reflex.extent[fan, 1])[0], -np.pi, atol=1e-5)
    assert_joined(reflex, 1e-9 * reflex.size)


def test_lines_and_arcs_in_disguise_are_found() -> None:
    straight = Bezier([(0, 0), (1, 0), (5, 0), (12, 0)])
    back = Arc((6.0, 0.0), 6.0, 0.0, np.pi)
    plain = sites_of(Region(Loop((straight, back))))
    assert plain.kind.tolist() == [SiteKind.LINE, SiteKind.ARC]
    rational = tuple(back.to_beziers())
    hidden = sites_of(Region(Loop((straight, *rational))))
    assert set(hidden.kind.tolist()) == {SiteKind.LINE, SiteKind.ARC}
    assert len(hidden.coefficients) == 0
    arcs = hidden.kind == SiteKind.ARC
    np.testing.assert_allclose(hidden.radius[arcs], 6.0, rtol=1e-12)
    np.testing.assert_allclose(hidden.extent[arcs, 1].sum(), np.pi, rtol=1e-12)
    # Off by more than 1e-11 of the size it is what it is.
    bent = Bezier([(0, 0), (1, 0), (5, -1e-8), (12, 0)])
    assert SiteKind.SPIRAL in sites_of(Region(Loop((bent, back)))).kind


def test_degrees_and_kinds_may_be_mixed() -> None:
    corner = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
    curves: list[Curve] = [
        Bezier([corner[0], (10.0, -4.0), corner[1]]),
        Bezier([corner[1], (24.0, 5.0), (23.0, 12.0), (26.0, 18.0), corner[2]]),
        BSpline(3, [0, 0, 0, 0, 1, 2, 2, 2, 2], [corner[2], (15, 24), (9, 18), (4, 22), corner[3]]),
        Bezier([corner[3], (-3.0, 12.0), (-3.0, 8.0), corner[0]], [1.0, 2.0, 1.5, 1.0]),
    ]
    sites, beziers = build_sites(Region(Loop(tuple(curves))))
    assert_joined(sites, 1e-12 * sites.size)
    assert_spirals(sites)
    assert [len(curve.control_points) for curve in beziers] == [3, 5, 4, 4, 4]
    spiral = np.flatnonzero(sites.kind == SiteKind.SPIRAL)
    for row in spiral:
        for parameter in (sites.low[row], sites.high[row]):
            at = sites.point(np.array([row]), np.array([parameter]))[0] + sites.origin
            np.testing.assert_allclose(at, beziers[sites.bezier[row]].point(parameter), atol=1e-12)
    assert sites.curve[spiral].max() == 3


def test_long_arcs_are_halved() -> None:
    sites = sites_of(shapes.circle(10.0))
    assert sites.kind.tolist() == [SiteKind.ARC, SiteKind.ARC]
    np.testing.assert_allclose(sites.extent[:, 1], np.pi)
    assert not sites.corner_after.any()


# -- points that are nearly one -------------------------------------------------------------------


@pytest.mark.parametrize("make", [Loop.from_points, shapes.polygon_loop])
def test_nearly_equal_points_collapse(make: object) -> None:
    square = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
    plain = sites_of(Region(Loop.from_points(square)))
    for gap in (1e-14, 1e-13, 5e-12):
        shift = gap * np.array([(0.0, 1.0), (-1.0, -1.0), (1.0, 0.0)])
        near = [square[:1], square[:1] + shift[:1], square[1:2], square[1:2] + shift, square[2:]]
        loop = make(np.concatenate(near))  # type: ignore[operator]
        sites = sites_of(Region(loop))
        np.testing.assert_array_equal(sites.kind, plain.kind)
        np.testing.assert_allclose(sites.turn_after, plain.turn_after, atol=1e-9)
        np.testing.assert_allclose(sites.anchor, plain.anchor, atol=1e-11)
        assert_joined(sites, 0.0)


def test_points_farther_apart_are_taken_at_their_word() -> None:
    gap = 1e-9
    chamfer = np.array([(0.0, 0.0), (10.0 - gap, 0.0), (10.0, gap), (10.0, 10.0), (0.0, 10.0)])
    sites = sites_of(Region(Loop.from_points(chamfer)))
    assert len(sites) == 5
    np.testing.assert_allclose(sites.turn_after[:2], np.pi / 4, atol=1e-6)
    assert sites.corner_after.all()


def test_a_long_row_of_near_points_still_leads_on() -> None:
    step = 2e-13
    row = np.stack([np.full(400, 10.0), step * np.arange(400)], axis=1)
    points = np.concatenate([[(0.0, 0.0)], row, [(10.0, 10.0), (0.0, 10.0)]])
    sites = sites_of(Region(Loop.from_points(points)))
    assert_joined(sites, 1e-15)
    assert 4 <= len(sites) < 30


def test_a_tiny_arc_becomes_the_corner_it_rounds() -> None:
    tiny = 1e-13
    arc = Arc((10.0 - tiny, tiny), tiny, -np.pi / 2, np.pi / 2)
    curves = (
        Line((0, 0), arc.start), arc, Line(arc.end, (10, 10)), Line((10, 10), (0, 10)),
        Line((0, 10), (0, 0)),
    )  # fmt: skip
    sites = sites_of(Region(Loop(curves)))
    assert set(sites.kind.tolist()) == {SiteKind.LINE}
    np.testing.assert_allclose(sites.turn_after, np.pi / 2, atol=1e-9)


@pytest.mark.parametrize("turn", [1e-12, 1e-8, 1e-5, 1e-2])
def test_turns_are_smooth_corners_or_fans(turn: float) -> None:
    convex, _ = build_sites(shapes.bent_strip(turn), smooth_angle=1e-6, least_fan=1e-9)
    reflex, _ = build_sites(shapes.bent_strip(-turn), smooth_angle=1e-6, least_fan=1e-9)
    # Corners of two lines are exact: they are told from none at 3e-3 of the smooth angle.
    assert np.count_nonzero(convex.corner_after) == 4 + (turn > 3e-9)
    assert np.count_nonzero(reflex.kind == SiteKind.POINT) == (turn > 1e-9)
    for sites, sign in ((convex, 1.0), (reflex, -1.0)):
        assert_joined(sites, 1e-12 * sites.size)
        if turn > 1e-9 or sign > 0:
            turns = np.concatenate([sites.turn_after, sites.extent[sites.kind == 3, 1]])
            assert np.abs(turns - sign * turn).min() <= 1e-14


def test_needles_and_slits_have_the_right_side() -> None:
    needle = sites_of(shapes.polygon([(0, 0), (10, 0), (10, 5), (4, 5), (30, 5 + 1e-9), (0, 6)]))
    assert np.count_nonzero(needle.kind == SiteKind.POINT) == 1
    slit = [(0, 0), (10, 0), (10, 10), (5, 10), (5, 4), (5, 10), (0, 10)]
    fans = sites_of(Region(Loop.from_points(slit)))
    assert fans.extent[fans.kind == SiteKind.POINT, 1].min() == pytest.approx(-np.pi)


# -- polygons as arrays ---------------------------------------------------------------------------


def star(count: int, seed: int = 1) -> FloatArray:
    draw = np.random.default_rng(seed)
    angle = 2 * np.pi * (np.arange(count) + draw.uniform(-0.3, 0.3, count)) / count
    return shapes.polar(draw.uniform(8, 12, count), angle) + np.array([3.0, -7.0])


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.integers(3, 40), st.integers(0, 10**6))
def test_from_points_equals_a_loop_of_lines(count: int, seed: int) -> None:
    points = star(count, seed)
    loop, lines = Loop.from_points(points), shapes.polygon_loop(points)
    draw = np.random.default_rng(seed)
    u = np.concatenate([draw.uniform(0, count, 20), np.arange(count)])
    for one, other in (
        (loop, lines),
        (loop.reversed(), lines.reversed()),
        (loop.start_at(5), lines.start_at(5)),
        (loop.transformed([[0, -2, 1], [2, 0, 1]]), lines.transformed([[0, -2, 1], [2, 0, 1]])),
    ):
        assert len(one) == len(other)
        assert one.area == pytest.approx(other.area, rel=1e-12)
        assert one.length == pytest.approx(other.length, rel=1e-14)
        assert one.bounds() == other.bounds()
        np.testing.assert_array_equal(one.start, other.start)
        for got, want in zip(one.evaluate(u, 3), other.evaluate(u, 3), strict=True):
            np.testing.assert_allclose(got, want, atol=1e-13)
        np.testing.assert_allclose(one.tangent(u), other.tangent(u), atol=1e-14)
        np.testing.assert_allclose(one.normal(u), other.normal(u), atol=1e-14)
        np.testing.assert_array_equal(one.curvature(u), other.curvature(u))
        table, wanted = one.junctions(1e-6), other.junctions(1e-6)
        np.testing.assert_array_equal(table.point, wanted.point)
        np.testing.assert_allclose(table.turn, wanted.turn, atol=1e-13)
        np.testing.assert_array_equal(table.kind, wanted.kind)
        np.testing.assert_array_equal(flatten(one, 0.1), flatten(other, 0.1))
        for mine, theirs in zip(one.curves, other.curves, strict=True):
            np.testing.assert_array_equal(mine.start, theirs.start)
            np.testing.assert_array_equal(mine.end, theirs.end)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(st.integers(7, 30), st.integers(0, 10**6))
def test_regions_of_points_equal_regions_of_lines(count: int, seed: int) -> None:
    outer, inner = star(count, seed), 0.1 * star(5, seed) + np.array([2.7, -6.3])
    one = Region(Loop.from_points(outer[::-1]), (Loop.from_points(inner),))
    other = Region(shapes.polygon_loop(outer[::-1]), (shapes.polygon_loop(inner),))
    assert one.area == pytest.approx(other.area, rel=1e-12)
    assert one.perimeter == pytest.approx(other.perimeter, rel=1e-14)
    draw = np.random.default_rng(seed)
    points = draw.uniform((-10, -20), (16, 6), (300, 2))
    np.testing.assert_array_equal(one.contains(points), other.contains(points))
    u = draw.uniform(0, count + 5, 30)
    np.testing.assert_allclose(one.boundary_point(u), other.boundary_point(u), atol=1e-13)
    got, want = sites_of(one), sites_of(other)
    for name in ("kind", "loop", "curve", "following", "preceding", "corner_after", "bezier"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))
    for name in ("anchor", "extent", "low", "high", "turn_after"):
        np.testing.assert_allclose(getattr(got, name), getattr(want, name), atol=1e-12)


def test_repeated_points_are_dropped() -> None:
    square = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)])
    for repeated in (
        np.concatenate([square, square[:1]]),
        np.repeat(square, 3, axis=0),
        np.concatenate([square[:1], square, square[:1], square[:1]]),
    ):
        loop = Loop.from_points(repeated)
        assert loop.vertices is not None
        np.testing.assert_array_equal(loop.vertices, square)
    assert "4 points" in repr(loop)
    assert shapes.polygon_loop(square).vertices is None


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 2)),
        np.ones((5, 2)),
        [(0.0, 0.0), (1.0, 0.0)],
        [(0.0, 0.0), (1.0, 0.0), (0.0, 0.0), (1.0, 0.0), (1.0, 0.0)],
    ],
)
def test_too_few_points_are_refused(points: object) -> None:
    with pytest.raises(GeometryError, match="three different points"):
        Loop.from_points(points)  # type: ignore[arg-type]


def test_unusable_points_are_refused() -> None:
    with pytest.raises(GeometryError, match="shape"):
        Loop.from_points(np.zeros((4, 3)))
    with pytest.raises(GeometryError, match="finite"):
        Loop.from_points([(0, 0), (1, 0), (np.nan, 1)])
    with pytest.raises(GeometryError, match="no area"):
        Region(Loop.from_points([(0, 0), (1, 0), (2, 0)]))
    with pytest.raises(GeometryError, match="outside"):
        Region(Loop.from_points(star(9)), (Loop.from_points(star(9) + 9.0),))


def test_points_are_not_shared_with_the_caller() -> None:
    points = star(7)
    loop = Loop.from_points(points)
    points[0] = 0.0
    assert loop.vertices is not None
    assert np.all(loop.vertices[0] != 0.0)
    with pytest.raises(ValueError, match="read-only"):
        loop.vertices[0] = 1.0


# -- measures of mixed loops ----------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted({**shapes.SIMPLE, **shapes.FREE}))
def test_measures_are_those_of_the_curves(name: str) -> None:
    for loop in shapes.EVERY[name]().loops:
        boxes = np.array([curve.bounds() for curve in loop.curves])
        assert loop.bounds() == (*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0))
        origin = loop.curves[0].start
        area = sum(curve.area_integral(origin) for curve in loop.curves)
        assert loop.area == pytest.approx(area, rel=1e-11)


def test_offset_curves_have_no_sites() -> None:
    ring = ParallelCurve(Bezier([(0, 0), (4, -6), (9, 5), (12, 0)]), -1.0)
    loop = Loop((ring, Line(ring.end, (6.0, 20.0)), Line((6.0, 20.0), ring.start)))
    with pytest.raises(GeometryError):
        build_sites(Region(loop))


def test_a_loop_of_no_extent_is_refused() -> None:
    speck = Loop.from_points([(0.1, 0.2), (0.1 + 1e-14, 0.2), (0.1, 0.2 + 1e-14)])
    with pytest.raises(GeometryError, match="no extent"):
        build_sites(Region(Loop.from_points(50.0 * star(9)), (speck,)))


# -- time -----------------------------------------------------------------------------------------


def test_large_polygons_take_no_python_loop() -> None:
    def seconds(count: int) -> float:
        points = star(count)
        began = process_time()
        sites = sites_of(Region(Loop.from_points(points)))
        assert len(sites) >= count
        return process_time() - began

    seconds(1000)
    # A loop over edges takes some 20 microseconds each; this takes one or two.
    assert min(seconds(100_000) for _ in range(2)) < 1.0
