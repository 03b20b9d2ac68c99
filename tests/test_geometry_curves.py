"""Laws that every curve keeps, and what each curve promises beyond them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grassfire.errors import GeometryError
from grassfire.geometry import (
    Arc,
    Bezier,
    BSpline,
    Curve,
    EllipticalArc,
    Line,
    ParallelCurve,
    flatten,
    parallel,
)

RANDOM = np.random.default_rng(7)
CUBIC = Bezier([[0, 0], [10, 5], [3, 12], [8, 1]])
GENTLE = Bezier([[0, 0], [10, 5], [3, 12], [-4, 1]])
CLAMPED = [0, 0, 0, 0, 1, 2, 2, 3, 3, 3, 3]
CURVES: dict[str, Curve] = {
    "line": Line([1, 2], [4, -3]),
    "arc": Arc([1, 2], 3, 0.3, 2.1),
    "clockwise arc": Arc([1, 2], 3, 0.3, -4.0),
    "circle": Arc([0, 1], 2),
    "ellipse": EllipticalArc([0, 0], [5, 1], [-0.4, 2], 0.2, -4),
    "skew ellipse": EllipticalArc([0, 0], [5, 1], [2, 3], 0.2, 6),
    "cubic": CUBIC,
    "rational cubic": Bezier(CUBIC.control_points, [1, 2, 0.5, 1]),
    "degree 9": Bezier(np.cumsum(RANDOM.normal([1, 0], 1, (10, 2)), axis=0)),
    "spline": BSpline(3, CLAMPED, np.cumsum(RANDOM.normal([2, 0], 1, (7, 2)), axis=0)),
    "nurbs": BSpline(
        3,
        CLAMPED,
        np.cumsum(RANDOM.normal([2, 0], 1, (7, 2)), axis=0),
        RANDOM.uniform(0.5, 2, 7),
    ),
    "unclamped": BSpline(2, np.arange(9.0), RANDOM.normal(size=(6, 2)) * 10),
    "parallel of a cubic": ParallelCurve(GENTLE, -0.8, 0.1, 0.9),
    "parallel of an ellipse": ParallelCurve(EllipticalArc([0, 0], [5, 0], [0, 3], 0, 4), 1.2),
}
EACH = pytest.mark.parametrize("curve", CURVES.values(), ids=CURVES.keys())
INNER = np.linspace(0.013, 0.987, 29)


def away_from_breaks(curve: Curve, step: float) -> np.ndarray:
    gap = np.abs(INNER[:, None] - curve.breaks()).min(axis=1)
    return INNER[gap > 2 * step]


@EACH
@pytest.mark.parametrize("order", [1, 2])
def test_derivatives_match_differences(curve: Curve, order: int) -> None:
    step = 1e-5
    t = away_from_breaks(curve, step)
    ahead, behind = curve.derivative(t + step, order - 1), curve.derivative(t - step, order - 1)
    exact = curve.derivative(t, order)
    scale = 1.0 + np.abs(exact).max()
    np.testing.assert_allclose((ahead - behind) / (2 * step), exact, atol=2e-6 * scale)


@EACH
def test_shapes_follow_the_parameter(curve: Curve) -> None:
    assert curve.point(0.5).shape == (2,)
    assert curve.point(np.full((2, 3), 0.5)).shape == (2, 3, 2)
    assert curve.derivative(np.full((4,), 0.5), 2).shape == (4, 2)
    assert curve.curvature(0.5).shape == ()
    assert curve.curvature(np.full((2, 3), 0.5)).shape == (2, 3)
    assert curve.normal(np.full((2, 3), 0.5)).shape == (2, 3, 2)
    np.testing.assert_allclose(curve.point([[0.25]])[0, 0], curve.point(0.25), atol=1e-14)


@EACH
def test_ends(curve: Curve) -> None:
    np.testing.assert_allclose(curve.start, curve.point(0.0), atol=1e-14)
    np.testing.assert_allclose(curve.end, curve.point(1.0), atol=1e-14)


@pytest.mark.parametrize("sweep", [2 * np.pi, -2 * np.pi, 1.3, -4.0])
def test_ends_of_arcs_are_their_points_to_the_bit(sweep: float) -> None:
    arc = Arc(np.array([1e5, -0.3]), 7.7, 2.1, sweep)
    np.testing.assert_array_equal(arc.start, arc.point(0.0))
    np.testing.assert_array_equal(arc.end, arc.point(0.0 if arc.closed else 1.0))


@EACH
def test_tangent_normal_and_curvature(curve: Curve) -> None:
    first, second = curve.derivative(INNER), curve.derivative(INNER, 2)
    speed = np.hypot(*first.T)
    tangent = curve.tangent(INNER)
    np.testing.assert_allclose(tangent * speed[:, None], first, atol=1e-9)
    np.testing.assert_allclose(
        curve.normal(INNER), np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)
    )
    bend = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    np.testing.assert_allclose(curve.curvature(INNER), bend, rtol=1e-8, atol=1e-12)


@EACH
def test_reversal(curve: Curve) -> None:
    backwards = curve.reversed()
    np.testing.assert_allclose(backwards.point(1 - INNER), curve.point(INNER), atol=1e-12)
    np.testing.assert_allclose(backwards.tangent(1 - INNER), -curve.tangent(INNER), atol=1e-9)
    t = away_from_breaks(curve, 1e-6)
    np.testing.assert_allclose(
        backwards.curvature(1 - t), -curve.curvature(t), rtol=1e-7, atol=1e-11
    )


@EACH
@pytest.mark.parametrize(("t0", "t1"), [(0.0, 0.4), (0.2, 0.7), (0.55, 1.0), (0.9, 0.3)])
def test_subcurve(curve: Curve, t0: float, t1: float) -> None:
    part = curve.subcurve(t0, t1)
    assert type(part) is type(curve)
    t = t0 + (t1 - t0) * INNER
    np.testing.assert_allclose(part.point(INNER), curve.point(t), atol=1e-12)


@EACH
@pytest.mark.parametrize(("t0", "t1"), [(0.5, 0.5), (-0.1, 0.5), (0.2, 1.1)])
def test_subcurve_refuses(curve: Curve, t0: float, t1: float) -> None:
    with pytest.raises(GeometryError, match="two different parameters"):
        curve.subcurve(t0, t1)


@pytest.mark.parametrize("curve", [*CURVES.values(), ParallelCurve(CUBIC, -0.8, 0.1, 0.9)])
def test_bounds_are_exact(curve: Curve) -> None:
    points = curve.point(np.linspace(0, 1, 20001))
    sampled = np.concatenate([points.min(axis=0), points.max(axis=0)])
    bounds = np.array(curve.bounds())
    assert np.all(bounds[:2] <= sampled[:2] + 1e-12)
    assert np.all(bounds[2:] >= sampled[2:] - 1e-12)
    np.testing.assert_allclose(bounds, sampled, atol=2e-4)


@EACH
def test_length_of_parts_adds_up(curve: Curve) -> None:
    parts = curve.subcurve(0, 0.37).length() + curve.subcurve(0.37, 1).length()
    assert curve.length() == pytest.approx(parts, abs=1e-8)
    chords = np.hypot(*np.diff(curve.point(np.linspace(0, 1, 20001)), axis=0).T).sum()
    assert curve.length() == pytest.approx(chords, rel=1e-6)


@EACH
def test_motion_commutes_with_evaluation(curve: Curve) -> None:
    cosine, sine = np.cos(0.7), np.sin(0.7)
    for mirror in (1.0, -1.0):
        matrix = np.array([[2 * cosine, -2 * mirror * sine, 3], [2 * sine, 2 * mirror * cosine, 1]])
        image = curve.transformed(matrix)
        assert type(image) is type(curve)
        expected = curve.point(INNER) @ matrix[:, :2].T + matrix[:, 2]
        np.testing.assert_allclose(image.point(INNER), expected, atol=1e-11)
        np.testing.assert_allclose(
            image.curvature(INNER), mirror * curve.curvature(INNER) / 2, rtol=1e-6, atol=1e-11
        )
        assert image.length() == pytest.approx(2 * curve.length(), abs=1e-7)


@EACH
def test_affine_image(curve: Curve) -> None:
    matrix = np.array([[2, 0.5, 1], [0, 1, -1.0]])
    if isinstance(curve, ParallelCurve):
        with pytest.raises(GeometryError, match="offset curve"):
            curve.transformed(matrix)
        return
    expected = curve.point(INNER) @ matrix[:, :2].T + matrix[:, 2]
    np.testing.assert_allclose(curve.transformed(matrix).point(INNER), expected, atol=1e-11)


@EACH
def test_singular_matrix_is_refused(curve: Curve) -> None:
    with pytest.raises(GeometryError, match="invertible"):
        curve.transformed([[1, 1, 0], [1, 1, 0]])


@EACH
def test_beziers_trace_the_same_points(curve: Curve) -> None:
    if isinstance(curve, ParallelCurve):
        with pytest.raises(GeometryError, match="no exact Bezier form"):
            curve.to_beziers()
        return
    pieces = curve.to_beziers()
    np.testing.assert_allclose(pieces[0].start, curve.start, atol=1e-13)
    np.testing.assert_allclose(pieces[-1].end, curve.end, atol=1e-12)
    assert sum(piece.length() for piece in pieces) == pytest.approx(curve.length(), abs=1e-8)
    if isinstance(curve, (Bezier, BSpline, Line)):
        edges = curve.breaks()
        for piece, low, high in zip(pieces, edges[:-1], edges[1:], strict=True):
            expected = curve.point(low + (high - low) * INNER)
            np.testing.assert_allclose(piece.point(INNER), expected, atol=1e-12)
    else:
        area = sum(piece.area_integral([9, 9]) for piece in pieces)
        assert area == pytest.approx(curve.area_integral([9, 9]), abs=1e-8)


@EACH
def test_area_integral_is_greens(curve: Curve) -> None:
    t = np.linspace(0, 1, 40001)
    points = curve.point(t) - [2.0, 1.0]
    exact = 0.5 * np.sum(points[:-1, 0] * points[1:, 1] - points[:-1, 1] * points[1:, 0])
    assert curve.area_integral([2.0, 1.0]) == pytest.approx(exact, rel=1e-6, abs=1e-6)


@EACH
@pytest.mark.parametrize("tolerance", [0.5, 1e-2, 1e-4])
def test_flattening_keeps_its_tolerance(curve: Curve, tolerance: float) -> None:
    points = flatten(curve, tolerance)
    np.testing.assert_allclose(points[[0, -1]], [curve.start, curve.end], atol=1e-12)
    samples = curve.point(np.linspace(0, 1, 3001))
    assert distance_to_polyline(samples, points) <= tolerance * (1 + 1e-9)
    assert len(points) <= 60 + 12 * curve.length() / np.sqrt(tolerance)


def distance_to_polyline(samples: np.ndarray, points: np.ndarray) -> float:
    worst = 0.0
    start, step = points[:-1], np.diff(points, axis=0)
    squared = np.maximum((step**2).sum(axis=1), 1e-300)
    for part in np.array_split(samples, 30):
        offset = part[:, None] - start
        share = np.clip((offset * step).sum(axis=-1) / squared, 0, 1)
        gap = offset - share[..., None] * step
        worst = max(worst, float(np.hypot(gap[..., 0], gap[..., 1]).min(axis=1).max()))
    return worst


@EACH
def test_ends_can_be_moved(curve: Curve) -> None:
    shift_start, shift_end = np.array([1e-3, -2e-3]), np.array([-1e-3, 0.5e-3])
    if isinstance(curve, Arc) and curve.closed:
        shift_end = shift_start
    if isinstance(curve, ParallelCurve):
        with pytest.raises(GeometryError, match="cannot be moved"):
            curve.with_ends(curve.start, curve.end)
        return
    moved = curve.with_ends(curve.start + shift_start, curve.end + shift_end)
    np.testing.assert_allclose(moved.start, curve.start + shift_start, atol=1e-12)
    np.testing.assert_allclose(moved.end, curve.end + shift_end, atol=1e-12)
    np.testing.assert_allclose(moved.point(INNER), curve.point(INNER), atol=2e-2)


@EACH
def test_curves_are_immutable(curve: Curve) -> None:
    field = next(iter(type(curve).__dataclass_fields__))
    with pytest.raises(AttributeError):
        setattr(curve, field, 1.0)


@pytest.mark.parametrize("order", range(1, 6))
def test_higher_derivatives_of_rational_curves(order: int) -> None:
    for name in ("rational cubic", "degree 9", "spline", "nurbs", "ellipse", "arc"):
        curve = CURVES[name]
        step = 1e-4
        t = away_from_breaks(curve, step)
        change = curve.derivative(t + step, order - 1) - curve.derivative(t - step, order - 1)
        exact = curve.derivative(t, order)
        assert np.abs(change / (2 * step) - exact).max() <= 1e-3 * (1 + np.abs(exact).max()), name


class TestArc:
    def test_known_length_and_bounds(self) -> None:
        arc = Arc([1, 1], 2, 0, np.pi)
        assert arc.length() == pytest.approx(2 * np.pi)
        np.testing.assert_allclose(arc.bounds(), [-1, 1, 3, 3], atol=1e-15)

    @given(st.floats(-50, 50), st.tuples(*[st.floats(-100, 100)] * 4))
    def test_bulge_round_trip(self, bulge: float, ends: tuple[float, ...]) -> None:
        start, end = np.array(ends[:2]), np.array(ends[2:])
        chord = np.hypot(*(end - start))
        if chord < 1e-3 or abs(bulge) < 1e-4:
            return
        arc = Arc.from_bulge(start, end, bulge)
        slack = 1e-13 * (arc.radius + 200)
        np.testing.assert_allclose(arc.start, start, atol=slack)
        np.testing.assert_allclose(arc.end, end, atol=slack)
        assert arc.bulge == pytest.approx(bulge, rel=1e-9)
        middle = arc.point(0.5)
        left = np.array([start[1] - end[1], end[0] - start[0]]) / chord
        sagitta = (0.5 * (start + end) - middle) @ left
        assert sagitta == pytest.approx(0.5 * chord * bulge, abs=slack)

    def test_three_points(self) -> None:
        for sweep in (0.1, 3.0, 6.0, -2.0, -6.2):
            arc = Arc([3, 4], 5, 1.0, sweep)
            again = Arc.from_three_points(arc.start, arc.point(0.3), arc.end)
            np.testing.assert_allclose(again.centre, arc.centre, atol=1e-9)
            assert again.sweep == pytest.approx(sweep, abs=1e-9)

    def test_three_points_closed(self) -> None:
        circle = Arc.from_three_points([0, 0], [2, 0], [0, 0])
        assert circle.closed
        assert circle.radius == 1.0
        np.testing.assert_array_equal(circle.start, circle.end)

    def test_image_under_uneven_scaling_is_elliptical(self) -> None:
        image = Arc([1, 2], 3, 0.3, 2).transformed([[2, 0, 0], [0, 1, 0]])
        assert isinstance(image, EllipticalArc)

    def test_same_as_elliptical_arc(self) -> None:
        arc = Arc([1, 2], 3, 0.3, -2)
        np.testing.assert_allclose(arc.to_elliptical_arc().point(INNER), arc.point(INNER))

    @pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, np.inf])
    def test_bad_radius(self, radius: float) -> None:
        with pytest.raises(GeometryError, match="radius above zero"):
            Arc([0, 0], radius)

    @pytest.mark.parametrize("sweep", [0.0, 7.0, np.nan])
    def test_bad_sweep(self, sweep: float) -> None:
        with pytest.raises(GeometryError, match=r"sweep|finite"):
            Arc([0, 0], 1, 0, sweep)

    def test_almost_closed_arcs_close_but_do_not_open(self) -> None:
        for curve in (Arc([0, 0], 2, 0, -6.28), EllipticalArc([0, 0], [2, 0], [0, 1], 0, -6.28)):
            whole = curve.with_ends(curve.start, curve.start)
            np.testing.assert_allclose(whole.start, whole.end, atol=1e-14)
            np.testing.assert_allclose(whole.point(0.5), curve.point(0.5), atol=0.01)
            assert whole.area_integral() < 0.0
            with pytest.raises(GeometryError, match="cannot be moved"):
                curve.with_ends(curve.start, curve.end + np.array([0.05, 0]))

    def test_bad_bulges_and_points(self) -> None:
        with pytest.raises(GeometryError, match="two different ends"):
            Arc.from_bulge([1, 1], [1, 1], 1)
        with pytest.raises(GeometryError, match="bulge"):
            Arc.from_bulge([0, 0], [1, 1], 0)
        with pytest.raises(GeometryError, match="on one line"):
            Arc.from_three_points([0, 0], [1, 1], [2, 2])


class TestEllipticalArc:
    def test_area_and_curvature_of_an_ellipse(self) -> None:
        ellipse = EllipticalArc([7, 7], [5, 0], [0, 3])
        assert ellipse.area_integral() == pytest.approx(15 * np.pi)
        assert ellipse.curvature(0.0) == pytest.approx(5 / 9)
        assert ellipse.curvature(0.25) == pytest.approx(3 / 25)

    def test_closed_ellipse_is_not_opened(self) -> None:
        with pytest.raises(GeometryError, match="cannot be opened"):
            EllipticalArc([7, 7], [5, 0], [0, 3]).with_ends([12, 7], [12.001, 7])

    def test_dependent_axes(self) -> None:
        with pytest.raises(GeometryError, match="span an area"):
            EllipticalArc([0, 0], [1, 2], [2, 4])


class TestBezier:
    def test_rational_quarter_is_a_circle(self) -> None:
        piece = Bezier([[1, 0], [1, 1], [0, 1]], [1, np.sqrt(0.5), 1])
        np.testing.assert_allclose(np.hypot(*piece.point(INNER).T), 1.0, atol=1e-15)
        np.testing.assert_allclose(piece.curvature(INNER), 1.0, atol=1e-13)
        assert piece.length() == pytest.approx(np.pi / 2, abs=1e-12)

    def test_parabola_length(self) -> None:
        parabola = Bezier([[0, 0], [0.5, 0], [1, 1]])
        exact = 0.5 * np.sqrt(5) + 0.25 * np.arcsinh(2)
        assert parabola.length(1e-13) == pytest.approx(exact, abs=1e-13)

    @settings(max_examples=40, deadline=None)
    @given(st.integers(1, 12), st.integers(0, 1000), st.floats(0.01, 0.99))
    def test_split_is_exact(self, degree: int, seed: int, t: float) -> None:
        random = np.random.default_rng(seed)
        weights = random.uniform(0.3, 3, degree + 1)
        curve = Bezier(random.uniform(-10, 10, (degree + 1, 2)), weights)
        first, second = curve.split(t)
        np.testing.assert_allclose(first.point(INNER), curve.point(t * INNER), atol=1e-12)
        np.testing.assert_allclose(
            second.point(INNER), curve.point(t + (1 - t) * INNER), atol=1e-12
        )

    def test_elevation_keeps_the_curve(self) -> None:
        for name in ("cubic", "rational cubic"):
            curve = CURVES[name]
            assert isinstance(curve, Bezier)
            higher = curve.elevated(8)
            assert higher.degree == 8
            np.testing.assert_allclose(higher.point(INNER), curve.point(INNER), atol=1e-13)
            with pytest.raises(GeometryError, match="elevate"):
                curve.elevated(2)

    @given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=2, max_size=4))
    def test_extrema_of_low_degrees(self, points: list[tuple[int, int]]) -> None:
        if len(set(points)) == 1:
            return
        curve = Bezier(points)
        bounds = np.array(curve.bounds())
        samples = curve.point(np.linspace(0, 1, 2001))
        sampled = np.concatenate([samples.min(axis=0), samples.max(axis=0)])
        np.testing.assert_allclose(bounds, sampled, atol=1e-4)
        for axis in (0, 1):
            slopes = curve.derivative(curve.extrema(axis))[..., axis]
            np.testing.assert_allclose(slopes, 0.0, atol=1e-6)

    def test_equal_weights_are_dropped(self) -> None:
        assert Bezier([[0, 0], [1, 0]], [2, 2]).weights is None

    def test_high_degree_is_stable(self) -> None:
        x = np.linspace(0, 1, 41)
        straight = Bezier(np.stack([x, 2 * x], axis=-1))
        t = np.linspace(0, 1, 101)
        np.testing.assert_allclose(straight.point(t), np.stack([t, 2 * t], axis=-1), atol=1e-14)

    @pytest.mark.parametrize(
        ("points", "weights", "message"),
        [
            ([[0, 0]], None, "two control points"),
            ([[0, 0], [0, 0], [0, 0]], None, "one point"),
            ([[0, 0], [np.nan, 0]], None, "finite"),
            ([[0, 0, 0], [1, 1, 1]], None, "shape"),
            ([[0, 0], [1, 0]], [1, 0], "above zero"),
            ([[0, 0], [1, 0]], [1, 1, 1], "shape"),
        ],
    )
    def test_bad_input(self, points: list, weights: list | None, message: str) -> None:
        with pytest.raises(GeometryError, match=message):
            Bezier(points, weights)


class TestDegenerateEnds:
    def test_repeated_first_control_points(self) -> None:
        curve = Bezier([[0, 0], [0, 0], [3, 4], [8, 1]])
        np.testing.assert_allclose(curve.tangent(0.0), [0.6, 0.8], atol=1e-12)
        assert np.isneginf(curve.curvature(0.0))
        assert np.isfinite(curve.curvature(1.0))

    def test_repeated_last_control_points(self) -> None:
        curve = Bezier([[8, 1], [3, 4], [0, 0], [0, 0]])
        np.testing.assert_allclose(curve.tangent(1.0), [-0.6, -0.8], atol=1e-12)
        triple = Bezier([[3, 4], [0, 0], [0, 0], [0, 0]])
        np.testing.assert_allclose(triple.tangent([0.0, 1.0]), [[-0.6, -0.8]] * 2, atol=1e-12)
        np.testing.assert_allclose(triple.curvature([0.0, 1.0]), [0.0, 0.0], atol=1e-9)

    def test_rational_and_spline_ends(self) -> None:
        points = [[0, 0], [0, 0], [3, 4], [8, 1]]
        np.testing.assert_allclose(Bezier(points, [1, 2, 3, 1]).tangent(0.0), [0.6, 0.8], atol=1e-9)
        spline = BSpline(3, [0, 0, 0, 0, 1, 1, 1, 1], points)
        np.testing.assert_allclose(spline.tangent(0.0), [0.6, 0.8], atol=1e-12)

    def test_slow_start_of_a_smooth_curve_has_its_curvature(self) -> None:
        # The parabola y = x^2 run as x = t^2: curvature 2 at the start although c' vanishes.
        curve = Bezier([[0, 0], [0, 0], [1 / 6, 0], [0.5, 0], [1, 1]])
        assert curve.curvature(0.0) == pytest.approx(2.0, rel=1e-6)

    def test_parallel_of_a_slow_start(self) -> None:
        offset = ParallelCurve(Bezier([[0, 0], [0, 0], [3, 4], [8, 1]]), 0.5)
        np.testing.assert_allclose(offset.start, [-0.4, 0.3], atol=1e-12)
        for values in (offset.evaluate([0.0, 0.5, 1.0], 2), (offset.tangent([0.0, 1.0]),)):
            for value in values:
                assert np.all(np.isfinite(value))
        assert not np.any(np.isnan(offset.curvature([0.0, 1.0])))

    def test_inner_cusp_has_a_tangent(self) -> None:
        curve = Bezier([[0, 0], [10, 10], [0, 10], [10, 0]])
        np.testing.assert_allclose(curve.tangent(0.5), [0, -1], atol=1e-9)
        assert np.isinf(curve.curvature(0.5))


class TestBSpline:
    def test_matches_scipy(self) -> None:
        from scipy.interpolate import BSpline as Reference

        for degree in range(1, 6):
            count = degree + 6
            knots = np.sort(RANDOM.uniform(0, 10, count + degree + 1))
            points = RANDOM.normal(size=(count, 2))
            curve, reference = BSpline(degree, knots, points), Reference(knots, points, degree)
            u = knots[degree] + (knots[count] - knots[degree]) * INNER
            np.testing.assert_allclose(curve.point(INNER), reference(u), atol=1e-11)

    def test_nurbs_circle(self) -> None:
        half = np.sqrt(0.5)
        points = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]
        knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
        circle = BSpline(2, knots, points, [1, half, 1, half, 1, half, 1, half, 1])
        np.testing.assert_allclose(np.hypot(*circle.point(INNER).T), 1.0, atol=1e-14)
        assert circle.length() == pytest.approx(2 * np.pi, abs=1e-9)
        assert circle.area_integral() == pytest.approx(np.pi, abs=1e-9)
        np.testing.assert_allclose(circle.bounds(), [-1, -1, 1, 1], atol=1e-14)
        assert len(circle.to_beziers()) == 4

    def test_clamping_keeps_the_curve(self) -> None:
        curve = CURVES["unclamped"]
        assert isinstance(curve, BSpline)
        clamped = curve.clamped()
        np.testing.assert_allclose(clamped.start, clamped.control_points[0], atol=1e-13)
        np.testing.assert_allclose(clamped.point(INNER), curve.point(INNER), atol=1e-12)

    @settings(max_examples=30, deadline=None)
    @given(st.integers(0, 10_000), st.floats(0, 0.9), st.floats(0.02, 0.5))
    def test_parts_are_exact(self, seed: int, t0: float, width: float) -> None:
        random = np.random.default_rng(seed)
        degree = int(random.integers(1, 5))
        # Spans of comparable widths: rounding of t is amplified by the speed in a tiny span.
        places = np.cumsum(random.uniform(0.5, 1, 5))
        inner = np.repeat(places[:4] / places[4], random.integers(1, degree + 1, 4))
        knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
        count = len(knots) - degree - 1
        curve = BSpline(
            degree, knots, random.normal(size=(count, 2)), random.uniform(0.5, 2, count)
        )
        t1 = min(1.0, t0 + width)
        part = curve.subcurve(t0, t1)
        expected = curve.point(t0 + (t1 - t0) * INNER)
        np.testing.assert_allclose(part.point(INNER), expected, atol=1e-11)

    @pytest.mark.parametrize(
        ("degree", "knots", "count", "message"),
        [
            (0, [0, 1], 1, "degree of at least 1"),
            (3, [0, 0, 0, 1, 1, 1], 2, "needs 4 control points"),
            (2, [0, 0, 0, 1, 1], 3, "needs 6 knots"),
            (2, [0, 0, 0, 1, 0.5, 1], 3, "must not decrease"),
            (1, [0, 0, 0, 0], 2, "range must not be empty"),
            (2, [0, 0, 0, 0, 1, 1, 1], 4, "repeated 4 times"),
            (1, [0, 0, 0.5, 0.5, 1, 1], 4, "repeated 2 times"),
            (1, [0, 0, np.inf, 1], 2, "finite"),
        ],
    )
    def test_bad_knots(self, degree: int, knots: list, count: int, message: str) -> None:
        with pytest.raises(GeometryError, match=message):
            BSpline(degree, knots, np.arange(2 * count).reshape(count, 2))

    def test_one_point(self) -> None:
        with pytest.raises(GeometryError, match="one point"):
            BSpline(1, [0, 0, 1, 1], [[1, 1], [1, 1]])


class TestParallel:
    def test_stays_at_its_distance(self) -> None:
        offset = ParallelCurve(CUBIC, -0.5, 0.2, 0.8)
        base = CUBIC.point(0.2 + 0.6 * INNER)
        np.testing.assert_allclose(np.hypot(*(offset.point(INNER) - base).T), 0.5, atol=1e-14)

    def test_lines_and_arcs_stay_what_they_are(self) -> None:
        line = parallel(Line([0, 0], [2, 0]), 1.0)
        assert isinstance(line, Line)
        np.testing.assert_allclose(line.point(0.5), [1, 1])
        for sweep, distance, radius in ((1, 1, 2), (-1, 1, 4), (1, -1, 4), (-1, -1, 2)):
            arc = parallel(Arc([0, 0], 3, 0.2, sweep), distance)
            assert isinstance(arc, Arc)
            assert arc.radius == pytest.approx(radius)
            general = ParallelCurve(Arc([0, 0], 3, 0.2, sweep), distance)
            np.testing.assert_allclose(general.point(INNER), arc.point(INNER), atol=1e-14)
        assert isinstance(parallel(CUBIC, 0.1), ParallelCurve)
        again = parallel(parallel(CUBIC, 0.1), 0.2)
        assert isinstance(again, ParallelCurve)
        assert again.distance == pytest.approx(0.3)
        with pytest.raises(GeometryError, match="no offset"):
            parallel(Arc([0, 0], 1), 1.0)

    def test_curvature_of_an_offset(self) -> None:
        offset = ParallelCurve(Arc([0, 0], 3), 1.0)
        np.testing.assert_allclose(offset.curvature(INNER), 0.5)

    def test_cusps(self) -> None:
        ellipse = EllipticalArc([0, 0], [5, 0], [0, 3])
        assert len(ParallelCurve(ellipse, 1.0).cusps()) == 0
        offset = ParallelCurve(ellipse, 4.0)
        cusps = offset.cusps()
        assert len(cusps) == 4
        np.testing.assert_allclose(offset.speed_factor(cusps), 0.0, atol=1e-10)
        assert not np.any(np.isnan(offset.curvature(cusps)))
        np.testing.assert_allclose(np.hypot(*offset.tangent(cusps).T), 1.0)

    def test_refusals(self) -> None:
        offset = ParallelCurve(CUBIC, 1.0)
        with pytest.raises(GeometryError, match="plain base"):
            ParallelCurve(offset, 1.0)
        with pytest.raises(GeometryError, match="t0 < t1"):
            ParallelCurve(CUBIC, 1.0, 0.8, 0.2)
        with pytest.raises(GeometryError, match="finite"):
            ParallelCurve(CUBIC, np.nan)
        with pytest.raises(GeometryError, match="up to the second"):
            offset.evaluate(0.5, 3)
        corner = BSpline(1, [0, 0, 1, 2, 2], [[0, 0], [1, 0], [1, 1]])
        with pytest.raises(GeometryError, match="has a corner"):
            ParallelCurve(corner, 0.1)
        assert ParallelCurve(corner, 0.1, 0.0, 0.5).length() == pytest.approx(1.0)

    def test_bezier_form_of_exact_offsets(self) -> None:
        pieces = ParallelCurve(Arc([0, 0], 3, 0, 2), 1.0, 0.25, 0.75).to_beziers()
        for piece in pieces:
            np.testing.assert_allclose(np.hypot(*piece.point(INNER).T), 2.0, atol=1e-13)


def test_line_refuses_zero_length() -> None:
    with pytest.raises(GeometryError, match="zero length"):
        Line([1, 1], [1, 1])


def test_flatten_refuses_zero_tolerance() -> None:
    with pytest.raises(GeometryError, match="above zero"):
        flatten(CUBIC, 0.0)
