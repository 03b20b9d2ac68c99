"""Loops, junctions, regions and evaluation in batches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grassfire.errors import GeometryError
from grassfire.geometry import (
    CONVEX,
    REFLEX,
    SMOOTH,
    Arc,
    Bezier,
    BSpline,
    CurveBatch,
    EllipticalArc,
    Line,
    Loop,
    ParallelCurve,
    Region,
    flatten,
    parallel,
)


def polygon(points: list[list[float]]) -> Loop:
    array = np.array(points, dtype=float)
    pairs = zip(array, np.roll(array, -1, axis=0), strict=True)
    return Loop(tuple(Line(start, end) for start, end in pairs))


SQUARE = polygon([[0, 0], [4, 0], [4, 4], [0, 4]])
CAPSULE = Loop(
    (
        Line([0, 0], [4, 0]),
        Arc([4, 1], 1, -np.pi / 2, np.pi),
        Line([4, 2], [0, 2]),
        Arc([0, 1], 1, np.pi / 2, np.pi),
    )
)
SPLINE_POINTS = np.array([[5, 0], [4, 4], [0, 3], [-4, 4], [-5, 0], [-2, -5], [3, -2]], dtype=float)


def periodic_spline() -> BSpline:
    points = np.concatenate([SPLINE_POINTS, SPLINE_POINTS[:3]])
    return BSpline(3, np.arange(len(points) + 4.0), points)


class TestLoop:
    def test_known_areas_and_lengths(self) -> None:
        assert SQUARE.area == pytest.approx(16.0)
        assert SQUARE.length == pytest.approx(16.0)
        assert CAPSULE.area == pytest.approx(8 + np.pi)
        assert CAPSULE.length == pytest.approx(8 + 2 * np.pi)
        assert CAPSULE.reversed().area == pytest.approx(-8 - np.pi)
        np.testing.assert_allclose(CAPSULE.bounds(), [-1, 0, 5, 2], atol=1e-15)

    def test_single_curve_loops(self) -> None:
        circle = Loop((Arc([1, 1], 2),))
        assert circle.area == pytest.approx(4 * np.pi)
        assert circle.junctions(1e-4).kind.tolist() == [SMOOTH]
        spline = Loop((periodic_spline(),))
        assert spline.junctions(1e-4).kind.tolist() == [SMOOTH]
        outline = flatten(spline, 1e-5)
        x, y = outline.T
        exact = 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])
        assert spline.area == pytest.approx(exact, abs=1e-3)

    def test_parameter(self) -> None:
        np.testing.assert_allclose(
            CAPSULE.point([0.5, 1.5, 2.5, 3.5]), [[2, 0], [5, 1], [2, 2], [-1, 1]]
        )
        np.testing.assert_allclose(CAPSULE.point(4.5), CAPSULE.point(0.5))
        np.testing.assert_allclose(CAPSULE.normal([0.5, 1.5]), [[0, 1], [-1, 0]], atol=1e-15)
        np.testing.assert_allclose(CAPSULE.curvature([0.5, 1.5]), [0, 1], atol=1e-15)
        np.testing.assert_allclose(CAPSULE.tangent(2.5), [-1, 0], atol=1e-15)
        assert CAPSULE.derivative(np.full((2, 3), 0.5)).shape == (2, 3, 2)

    def test_start_at_and_reversal(self) -> None:
        moved = CAPSULE.start_at(2)
        np.testing.assert_allclose(moved.point(0.25), CAPSULE.point(2.25))
        np.testing.assert_allclose(CAPSULE.reversed().point(0.25), CAPSULE.point(3.75), atol=1e-15)
        assert moved.area == pytest.approx(CAPSULE.area)

    def test_transformed(self) -> None:
        image = CAPSULE.transformed([[0, -2, 1], [2, 0, 1]])
        assert image.area == pytest.approx(4 * CAPSULE.area)

    def test_gap_is_refused_with_its_place(self) -> None:
        with pytest.raises(GeometryError, match=r"gap of 0\.1 mm at \(1, 1\)"):
            Loop((Line([0, 0], [1, 0]), Line([1, 0], [1, 1]), Line([1, 1.1], [0, 0])))
        with pytest.raises(GeometryError, match="at least one"):
            Loop(())

    def test_tiny_gaps_are_snapped(self) -> None:
        curves = (
            Line([0, 0], [10, 0]),
            Bezier([[10, 3e-10], [12, 5], [10, 10]]),
            Arc([5, 10 + 1e-10], 5, 0, np.pi),
            Line([0, 10], [0, -2e-10]),
        )
        loop = Loop(curves)
        for first, second in zip(loop.curves, np.roll(np.array(loop.curves), -1), strict=True):
            np.testing.assert_array_equal(first.end, second.start)

    def test_chained_closes_wider_gaps(self) -> None:
        curves = [
            Line([0, 0], [10, 0.004]),
            Arc([10, 5], 5, -np.pi / 2, np.pi),
            Bezier([[10, 10.003], [6, 9], [4, 9], [0, 10]]),
            EllipticalArc([0, 5.001], [0, 5], [-3, 0], 0, np.pi),
        ]
        loop = Loop.chained(curves, 0.01)
        for old, new in zip(curves, loop.curves, strict=True):
            assert type(old) is type(new)
            np.testing.assert_allclose(new.point(0.5), old.point(0.5), atol=0.01)
        with pytest.raises(GeometryError, match="gaps up to"):
            Loop.chained(curves, 0.001)

    def test_chained_keeps_what_is_closed(self) -> None:
        loop = Loop.chained(SQUARE.curves, 0.01)
        assert all(new is old for new, old in zip(loop.curves, SQUARE.curves, strict=True))


class TestJunctions:
    def test_convex_and_reflex(self) -> None:
        ell = polygon([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]])
        table = ell.junctions(1e-4)
        assert table.kind.tolist() == [CONVEX, CONVEX, CONVEX, REFLEX, CONVEX, CONVEX]
        np.testing.assert_allclose(np.abs(table.turn), np.pi / 2)
        np.testing.assert_allclose(table.point[3], [1, 1])
        assert table.turn.sum() == pytest.approx(2 * np.pi)
        assert len(table) == 6

    def test_smooth(self) -> None:
        assert np.all(CAPSULE.junctions(1e-6).kind == SMOOTH)

    def test_tolerance_decides(self) -> None:
        bent = polygon([[0, 0], [2, -1e-3], [4, 0], [4, 4], [0, 4]])
        assert bent.junctions(1e-4).kind[1] == CONVEX
        assert bent.junctions(1e-2).kind[1] == SMOOTH

    def test_repeated_control_points_at_a_corner(self) -> None:
        curved = Bezier([[4, 0], [4, 0], [5, 4], [4, 4], [4, 4]])
        loop = Loop((Line([0, 0], [4, 0]), curved, Line([4, 4], [0, 4]), Line([0, 4], [0, 0])))
        table = loop.junctions(1e-4)
        assert table.turn[1] == pytest.approx(np.arctan2(4, 1))
        assert table.kind[2] == SMOOTH

    @staticmethod
    def crescent(inner: float) -> Loop:
        """Return the region between two circles that touch at the origin from the same side."""
        return Loop(
            (
                Arc([inner, 0], inner, np.pi, -2 * np.pi),
                Arc([3, 0], 3, np.pi, 2 * np.pi),
            )
        )

    def test_cusps_of_touching_circles(self) -> None:
        # Between the circles the region tapers to a needle on both sides of the origin.
        table = self.crescent(1.0).junctions(1e-4)
        assert table.kind.tolist() == [CONVEX, CONVEX]
        np.testing.assert_allclose(table.turn, np.pi, atol=1e-9)

    @pytest.mark.parametrize(("sign", "kind"), [(1, REFLEX), (-1, CONVEX)])
    def test_needle_and_slit(self, sign: int, kind: int) -> None:
        # Two parabolas leave the origin along +x, one above and one below.
        above = Bezier([[0, 0], [1, 0], [2, 1]])
        below = Bezier([[0, 0], [1, 0], [2, -1]])
        needle = Loop((below, Line([2, -1], [2, 1]), above.reversed()))
        assert needle.junctions(1e-4).kind[0] == CONVEX
        slit = Loop(
            (
                above,
                Line([2, 1], [2, 5]),
                Line([2, 5], [-5, 5]),
                Line([-5, 5], [-5, -5]),
                Line([-5, -5], [2, -5]),
                Line([2, -5], [2, -1]),
                below.reversed(),
            )
        )
        table = (slit if sign > 0 else needle).junctions(1e-4)
        assert table.kind[0] == kind
        assert table.turn[0] == pytest.approx(-sign * np.pi, abs=1e-9)

    def test_doubling_back_is_a_slit(self) -> None:
        loop = polygon([[0, 0], [2, 0], [4, 0], [4, 4], [2, 4], [2, 2], [2, 4], [0, 4]])
        assert loop.junctions(1e-4).kind[5] == REFLEX

    @settings(max_examples=30, deadline=None)
    @given(st.integers(3, 9), st.integers(0, 999))
    def test_turns_of_simple_polygons_add_to_a_turn(self, count: int, seed: int) -> None:
        random = np.random.default_rng(seed)
        angle = (np.arange(count) + random.uniform(0, 0.8, count)) * 2 * np.pi / count
        radius = random.uniform(0.5, 3, count)
        loop = polygon((radius * np.array([np.cos(angle), np.sin(angle)])).T.tolist())
        if loop.area <= 0:
            return
        assert loop.junctions(0.0).turn.sum() == pytest.approx(2 * np.pi)


class TestRegion:
    REGION = Region(SQUARE.reversed(), (Loop((Arc([2, 2], 1),)),))

    def test_orientation_and_measures(self) -> None:
        assert self.REGION.outer.area > 0
        assert self.REGION.islands[0].area < 0
        assert self.REGION.area == pytest.approx(16 - np.pi)
        assert self.REGION.perimeter == pytest.approx(16 + 2 * np.pi)
        assert self.REGION.bounds() == (0, 0, 4, 4)
        assert [len(loop) for loop in self.REGION.loops] == [4, 1]
        assert self.REGION.first_curve.tolist() == [0, 4, 5]

    def test_boundary_parameter(self) -> None:
        u = np.array([0.5, 3.25, 4.0, 4.5, 5.0])
        points = self.REGION.boundary_point(u)
        normals = self.REGION.boundary_normal(u)
        assert points.shape == (5, 2)
        assert np.all(self.REGION.contains(points + 1e-6 * normals))
        assert not np.any(self.REGION.contains(points - 1e-6 * normals))
        np.testing.assert_allclose(self.REGION.boundary_curvature(u), [0, 0, -1, -1, -1])

    def test_contains_with_heights_of_vertices(self) -> None:
        x, y = np.meshgrid(np.linspace(-1, 5, 25), np.linspace(-1, 5, 25))
        points = np.stack([x.ravel(), y.ravel()], axis=-1)
        distance = np.hypot(*(points - 2).T)
        inside = np.all((points > 0) & (points < 4), axis=1) & (distance > 1)
        edge = np.any((points == 0) | (points == 4), axis=1) | (np.abs(distance - 1) < 1e-9)
        got = self.REGION.contains(points)
        np.testing.assert_array_equal(got[~edge], inside[~edge])

    def test_contains_agrees_with_the_exact_curve(self) -> None:
        region = Region(Loop((periodic_spline(),)))
        t = np.linspace(0, 1, 2000, endpoint=False)
        loop = region.outer
        points, normals = loop.point(t), loop.normal(t)
        for gap in (1e-3, 1e-7, 1e-11):
            assert np.all(region.contains(points + gap * normals))
            assert not np.any(region.contains(points - gap * normals))

    def test_contains_with_offset_curves(self) -> None:
        ellipse = EllipticalArc([0, 0], [5, 0], [0, 3])
        region = Region(Loop((ParallelCurve(ellipse, 1.0),)))
        t = np.linspace(0, 1, 500, endpoint=False)
        inner = ellipse.point(t) + (1 + 1e-8) * ellipse.normal(t)
        outer = ellipse.point(t) + (1 - 1e-8) * ellipse.normal(t)
        assert np.all(region.contains(inner))
        assert not np.any(region.contains(outer))
        assert region.area == pytest.approx(15 * np.pi - ellipse.length() + np.pi, abs=1e-6)

    def test_contains_checks_shapes_and_takes_none(self) -> None:
        assert self.REGION.contains(np.empty((0, 2))).shape == (0,)
        with pytest.raises(GeometryError, match="shape"):
            self.REGION.contains([1.0, 2.0])

    def test_mirror_keeps_the_region_on_the_left(self) -> None:
        image = self.REGION.transformed([[-1, 0, 0], [0, 1, 0]])
        assert image.area == pytest.approx(self.REGION.area)
        assert image.contains([[-0.5, 0.5], [0.5, 0.5]]).tolist() == [True, False]

    def test_refusals(self) -> None:
        with pytest.raises(GeometryError, match="outside"):
            Region(SQUARE, (Loop((Arc([4, 4], 1),)),))
        with pytest.raises(GeometryError, match="no area"):
            Region(polygon([[0, 0], [1, 0], [2, 0]]))


def test_batch_equals_its_curves() -> None:
    curves = [
        Line([0, 0], [1, 2]),
        Arc([1, 1], 2, 0.5, -2),
        Bezier([[0, 0], [1, 2], [3, 1]]),
        Bezier([[0, 0], [1, 2], [3, 5]], [1, 2, 1]),
        Bezier([[0, 0], [0, 0], [3, 5], [4, 4]]),
        Line([5, 5], [1, 2]),
        periodic_spline(),
        parallel(Bezier([[0, 0], [1, 2], [3, 1]]), -0.2),
    ]
    batch = CurveBatch(curves)
    random = np.random.default_rng(4)
    index = random.integers(0, len(curves), (7, 30))
    t = random.uniform(0, 1, (7, 30))
    t[0], t[1] = 0.0, 1.0
    point, first, second = batch.evaluate(index, t, 2)
    tangent, normal, bend = (
        batch.tangent(index, t),
        batch.normal(index, t),
        batch.curvature(index, t),
    )
    for row, column in np.ndindex(7, 30):
        curve, at = curves[index[row, column]], t[row, column]
        place = (row, column)
        for got, want in zip((point, first, second), curve.evaluate(at, 2), strict=True):
            np.testing.assert_allclose(got[place], want, atol=1e-11)
        np.testing.assert_allclose(tangent[place], curve.tangent(at), atol=1e-12)
        np.testing.assert_allclose(normal[place], curve.normal(at), atol=1e-12)
        np.testing.assert_allclose(bend[place], curve.curvature(at), rtol=1e-9, atol=1e-12)
    assert len(batch) == len(curves)
    assert batch.point(0, [0.0, 1.0]).shape == (2, 2)
