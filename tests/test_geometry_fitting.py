"""Arc fitting, simplification and the features of curves."""

from __future__ import annotations

import itertools

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
    curvature_extrema,
    cusps,
    deviation_from,
    fit_arcs,
    inflections,
    simplify,
    split_at_corners,
)

ELLIPSE = EllipticalArc([0, 0], [50, 1], [-0.4, 20])
CUBIC = Bezier([[0, 0], [10, 5], [3, 12], [8, 1]])
CUSP = Bezier([[0, 0], [10, 10], [0, 10], [10, 0]])
WAVE = BSpline(
    3,
    [0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4],
    [[0, 0], [5, 8], [9, -6], [15, 4], [20, -9], [28, 6], [30, 0]],
)
CORNER = BSpline(2, [0, 0, 0, 1, 1, 2, 2, 2], [[0, 0], [3, 4], [6, 0], [9, 5], [12, 0]])
CURVES: dict[str, Curve] = {
    "ellipse": ELLIPSE,
    "cubic": CUBIC,
    "rational": Bezier(CUBIC.control_points, [1, 2, 0.5, 1]),
    "wave": WAVE,
    "cusp": CUSP,
    "corner": CORNER,
    "repeated ends": Bezier([[0, 0], [0, 0], [3, 12], [8, 1], [8, 1]]),
    "offset": ParallelCurve(ELLIPSE, -5.0, 0.1, 0.9),
    "offset near the centre of curvature": ParallelCurve(ELLIPSE, 7.5),
    "offset with cusps": ParallelCurve(ELLIPSE, 20.0),
    "flat": Bezier([[0, 0], [100, 0.01], [200, 0.02], [300, 0]]),
    "tiny": Bezier(CUBIC.control_points * 1e-4),
    "far away": CUBIC.transformed([[1, 0, 1e4], [0, 1, -1e4]]),
}


def joint_turns(pieces: tuple[Line | Arc, ...]) -> np.ndarray:
    leave = np.array([piece.tangent(1.0) for piece in pieces[:-1]]).reshape(-1, 2)
    enter = np.array([piece.tangent(0.0) for piece in pieces[1:]]).reshape(-1, 2)
    sine = leave[:, 0] * enter[:, 1] - leave[:, 1] * enter[:, 0]
    return np.abs(np.arctan2(sine, (leave * enter).sum(axis=1)))


@pytest.mark.parametrize("curve", CURVES.values(), ids=CURVES.keys())
@pytest.mark.parametrize("tolerance", [0.05, 2e-3, 1e-4])
def test_fit_stays_within_tolerance_and_connected(curve: Curve, tolerance: float) -> None:
    pieces = fit_arcs(curve, tolerance)
    assert deviation_from(curve, pieces, 4001) <= tolerance
    scale = 1e-12 * (1.0 + float(np.abs(curve.bounds()).max()))
    np.testing.assert_allclose(pieces[0].start, curve.start, atol=scale)
    np.testing.assert_allclose(pieces[-1].end, curve.end, atol=scale)
    for first, second in itertools.pairwise(pieces):
        np.testing.assert_allclose(first.end, second.start, atol=scale)


@pytest.mark.parametrize("name", ["ellipse", "cubic", "wave", "offset"])
def test_fit_is_tangent_continuous(name: str) -> None:
    assert joint_turns(fit_arcs(CURVES[name], 2e-3)).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "most"), [("ellipse", 68), ("cubic", 30), ("wave", 64), ("offset", 54)]
)
def test_fit_is_frugal(name: str, most: int) -> None:
    assert len(fit_arcs(CURVES[name], 2e-3)) <= most


def test_pieces_grow_with_the_cube_root() -> None:
    coarse, fine = (len(fit_arcs(ELLIPSE, tolerance)) for tolerance in (8e-3, 1e-6))
    assert fine / coarse == pytest.approx(20.0, rel=0.2)


def test_lines_and_arcs_pass_through() -> None:
    line, arc = Line([0, 0], [1, 1]), Arc([0, 0], 5, 0, 2)
    assert fit_arcs(line, 1e-3) == (line,)
    assert fit_arcs(arc, 1e-3) == (arc,)
    (piece,) = fit_arcs(arc.to_beziers()[0], 1e-3)
    assert isinstance(piece, Arc)
    assert piece.radius == pytest.approx(5)


def test_arcs_of_large_radius_become_chords() -> None:
    arc = Arc([0, 0], 2e4, 0, 0.01)
    pieces = fit_arcs(arc, 1e-3)
    assert all(isinstance(piece, Line) for piece in pieces)
    assert deviation_from(arc, pieces) <= 1e-3 * (1 + 1e-6)
    assert len(pieces) == pytest.approx(arc.length() / np.sqrt(8 * 2e4 * 1e-3), abs=1)
    assert fit_arcs(arc, 1e-3, 1e5) == (arc,)
    flat = fit_arcs(CURVES["flat"], 2e-3)
    assert all(isinstance(piece, Line) for piece in flat)


def test_fit_is_deterministic() -> None:
    first, second = fit_arcs(WAVE, 1e-3), fit_arcs(WAVE, 1e-3)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.end, other.end)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 100_000), st.sampled_from([1e-2, 2e-3]), st.floats(-2, 2))
def test_fit_of_random_curves_and_offsets(seed: int, tolerance: float, distance: float) -> None:
    random = np.random.default_rng(seed)
    count = int(random.integers(3, 7))
    curve: Curve = Bezier(random.uniform(-10, 10, (count, 2)))
    if abs(distance) > 0.1:
        curve = ParallelCurve(curve, distance)
    pieces = fit_arcs(curve, tolerance)
    assert deviation_from(curve, pieces, 3000) <= tolerance
    for first, second in itertools.pairwise(pieces):
        np.testing.assert_allclose(first.end, second.start, atol=1e-9)


def test_fit_refuses_bad_tolerances() -> None:
    with pytest.raises(GeometryError, match="above zero"):
        fit_arcs(CUBIC, 0.0)
    with pytest.raises(GeometryError, match="above zero"):
        fit_arcs(CUBIC, 1e-3, -1.0)


class TestSimplify:
    def test_straight_curves(self) -> None:
        for points in ([[0, 0], [1, 1], [2, 2], [6, 6]], [[0, 0], [3, 1e-9], [5, 0]]):
            line = simplify(Bezier(points), 1e-6)
            assert isinstance(line, Line)
            np.testing.assert_array_equal(line.end, points[-1])
        spline = BSpline(2, [0, 0, 0, 1, 2, 2, 2], [[0, 0], [1, 2], [2, 4], [4, 8]])
        assert isinstance(simplify(spline, 1e-6), Line)

    def test_overshooting_curve_is_no_line(self) -> None:
        curve = Bezier([[0, 0], [9, 0], [-5, 0], [1, 0]])
        assert simplify(curve, 1e-6) is curve

    @settings(max_examples=40, deadline=None)
    @given(st.floats(0.1, 1.5), st.floats(-3, 3), st.floats(0.1, 100), st.booleans())
    def test_rational_arcs(self, sweep: float, angle: float, radius: float, turn: bool) -> None:
        arc = Arc([1, 2], radius, angle, -sweep if turn else sweep)
        (piece,) = arc.to_beziers()
        found = simplify(piece, 1e-7)
        assert isinstance(found, Arc)
        assert found.radius == pytest.approx(radius, rel=1e-6)
        assert found.sweep == pytest.approx(arc.sweep, rel=1e-6)

    def test_cubic_close_to_an_arc(self) -> None:
        handle = 4 / 3 * np.tan(np.pi / 8)
        quarter = Bezier([[1, 0], [1, handle], [handle, 1], [0, 1]])
        assert isinstance(simplify(quarter, 1e-3), Arc)
        assert simplify(quarter, 1e-6) is quarter

    def test_nurbs_circle_and_round_ellipse(self) -> None:
        half = np.sqrt(0.5)
        points = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]
        weights = [1, half, 1, half, 1, half, 1, half, 1]
        circle = simplify(BSpline(2, [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], points, weights), 1e-7)
        assert isinstance(circle, Arc)
        assert circle.closed
        assert circle.radius == pytest.approx(1)
        backwards = simplify(EllipticalArc([0, 0], [0, 2], [2, 0], 0.3), 1e-7)
        assert isinstance(backwards, Arc)
        assert backwards.sweep == pytest.approx(-2 * np.pi)
        np.testing.assert_allclose(
            backwards.point(0.1), EllipticalArc([0, 0], [0, 2], [2, 0], 0.3).point(0.1), atol=1e-9
        )
        three_quarters = simplify(EllipticalArc([0, 0], [2, 0], [0, 2], 0.3, 4.7), 1e-7)
        assert isinstance(three_quarters, Arc)
        assert three_quarters.sweep == pytest.approx(4.7)

    def test_offsets(self) -> None:
        arc = simplify(ParallelCurve(Arc([0, 0], 3, 0, 2), 1.0, 0.25, 0.75), 1e-6)
        assert isinstance(arc, Arc)
        assert arc.radius == pytest.approx(2)
        assert isinstance(simplify(ParallelCurve(Line([0, 0], [1, 0]), 1.0), 1e-6), Line)
        offset = ParallelCurve(CUBIC, 0.1)
        assert simplify(offset, 1e-6) is offset

    def test_other_curves_stay(self) -> None:
        for curve in (CUBIC, WAVE, ELLIPSE, CUSP):
            assert simplify(curve, 1e-6) is curve
        with pytest.raises(GeometryError, match="above zero"):
            simplify(CUBIC, 0.0)


class TestFeatures:
    def test_inflections(self) -> None:
        np.testing.assert_allclose(inflections(Bezier([[0, 0], [1, 1], [2, -1], [3, 0]])), [0.5])
        found = inflections(WAVE)
        assert len(found) == 4
        np.testing.assert_allclose(WAVE.curvature(found), 0.0, atol=1e-10)
        assert len(inflections(Line([0, 0], [1, 1]))) == 0
        assert len(inflections(Bezier([[0, 0], [1, 1], [2, 2], [3, 3]]))) == 0

    def test_curvature_extrema_of_an_ellipse(self) -> None:
        ellipse = EllipticalArc([0, 0], [5, 0], [0, 3], 0.5)
        expected = (np.arange(1, 5) * np.pi / 2 - 0.5) / (2 * np.pi)
        np.testing.assert_allclose(curvature_extrema(ellipse), expected, atol=1e-12)
        offset = ParallelCurve(ellipse, 1.0, 0.0, 0.5)
        np.testing.assert_allclose(curvature_extrema(offset), 2 * expected[:2], atol=1e-12)
        assert len(curvature_extrema(Arc([0, 0], 2))) == 0
        (quarter,) = Arc([0, 0], 2, 0.2, 1.0).to_beziers()
        assert len(curvature_extrema(quarter)) == 0

    def test_cusps_and_corners(self) -> None:
        np.testing.assert_allclose(cusps(CUSP), [0.5], atol=1e-9)
        assert len(cusps(CUBIC)) == 0
        assert len(cusps(ELLIPSE)) == 0
        first, second = split_at_corners(CUSP, 1e-4)
        np.testing.assert_allclose(first.end, CUSP.point(0.5), atol=1e-12)
        np.testing.assert_allclose(first.tangent(1.0), [0, 1], atol=1e-6)
        np.testing.assert_allclose(second.tangent(0.0), [0, -1], atol=1e-6)
        assert len(split_at_corners(CORNER, 1e-4)) == 2
        assert split_at_corners(WAVE, 1e-4) == (WAVE,)

    def test_repeated_control_points_make_a_corner(self) -> None:
        points = [[0, 0], [2, 0], [4, 0], [4, 0], [4, 0], [4, 2], [4, 4]]
        spline = BSpline(3, [0, 0, 0, 0, 1, 2, 3, 4, 4, 4, 4], points)
        parts = split_at_corners(spline, 1e-4)
        assert len(parts) == 2
        np.testing.assert_allclose(parts[0].tangent(1.0), [1, 0], atol=1e-9)
        np.testing.assert_allclose(parts[1].tangent(0.0), [0, 1], atol=1e-9)

    def test_smooth_full_knot_is_no_corner(self) -> None:
        smooth = BSpline(2, [0, 0, 0, 1, 1, 2, 2, 2], [[0, 0], [1, 1], [2, 1], [3, 1], [4, 0]])
        assert split_at_corners(smooth, 1e-4) == (smooth,)


@pytest.mark.parametrize("distance", [-30.0, -3.0, 4.0, 40.0])
def test_offsets_of_nearly_straight_and_round_curves_keep_their_ends(distance: float) -> None:
    flat = Bezier([[0, 0], [10, 1e-4], [20, -1e-4], [30, 0]])
    kappa = 4 / 3 * np.tan(np.pi / 16)
    arc = Bezier(
        50
        * np.array(
            [
                [1, 0],
                [1, kappa],
                [
                    np.cos(np.pi / 4) + kappa * np.sin(np.pi / 4),
                    np.sin(np.pi / 4) - kappa * np.cos(np.pi / 4),
                ],
                [np.cos(np.pi / 4), np.sin(np.pi / 4)],
            ]
        )
    )
    for base in (flat, arc):
        curve = ParallelCurve(base, distance)
        simple = simplify(curve, 1e-3)
        assert isinstance(simple, (Line, Arc))
        pieces = fit_arcs(curve, 1e-3)
        for start, end in ((simple.start, simple.end), (pieces[0].start, pieces[-1].end)):
            assert np.allclose(start, curve.start, rtol=0, atol=1e-10)
            assert np.allclose(end, curve.end, rtol=0, atol=1e-10)
        assert deviation_from(curve, pieces) <= 1e-3
