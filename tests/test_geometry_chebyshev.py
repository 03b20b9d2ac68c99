"""Chebyshev interpolation, Bezier conversion, quadrature and roots."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grassfire.errors import GeometryError
from grassfire.geometry import chebyshev

T = np.linspace(0, 1, 101)


def test_nodes_are_projected_circle_points() -> None:
    got = chebyshev.nodes(6, 2.0, 5.0)
    expected = 0.5 * (1 - np.cos(np.arange(7) * np.pi / 6)) * 3.0 + 2.0
    np.testing.assert_allclose(got, expected, atol=1e-15)
    assert (got[0], got[-1]) == (2.0, 5.0)
    np.testing.assert_array_equal(chebyshev.nodes(0, 0.0, 4.0), [2.0])
    with pytest.raises(GeometryError, match="negative"):
        chebyshev.nodes(-1)


@given(st.integers(1, 24), st.integers(0, 999))
def test_polynomials_are_reproduced(degree: int, seed: int) -> None:
    control = np.random.default_rng(seed).uniform(-1, 1, (3, degree + 1, 2))
    values = chebyshev.evaluate_bezier(control, chebyshev.nodes(degree))
    again = chebyshev.interpolate_to_bezier(values)
    np.testing.assert_allclose(
        chebyshev.evaluate_bezier(again, T), chebyshev.evaluate_bezier(control, T), atol=1e-11
    )
    np.testing.assert_array_equal(again[:, [0, -1]], values[:, [0, -1]])


@pytest.mark.parametrize("degree", [16, 24, 32])
def test_conversion_of_smooth_functions_is_stable(degree: int) -> None:
    def function(t: np.ndarray) -> np.ndarray:
        return np.stack([np.exp(t), np.cos(5 * t), 1 / (2 + t)], axis=-1)

    control = chebyshev.interpolate_to_bezier(function(chebyshev.nodes(degree)))
    np.testing.assert_allclose(chebyshev.evaluate_bezier(control, T), function(T), atol=1e-13)


def test_scalar_parameter_drops_the_axis() -> None:
    control = np.array([[0.0, 0.0], [2.0, 4.0]])
    np.testing.assert_allclose(chebyshev.evaluate_bezier(control, 0.25), [0.5, 1.0])


def test_derivatives() -> None:
    control = np.random.default_rng(2).normal(size=(8, 2))
    exact = chebyshev.evaluate_bezier(chebyshev.differentiate_bezier(control), T)
    step = 1e-6
    change = chebyshev.evaluate_bezier(control, T + step) - chebyshev.evaluate_bezier(
        control, T - step
    )
    np.testing.assert_allclose(change / (2 * step), exact, atol=1e-7)
    at_nodes = chebyshev.evaluate_bezier(control, chebyshev.nodes(7))
    slopes = chebyshev.evaluate_bezier(chebyshev.differentiate_bezier(control), chebyshev.nodes(7))
    np.testing.assert_allclose(
        chebyshev.differentiate_values(at_nodes, 1.0, 3.0), slopes / 2, atol=1e-11
    )
    assert np.all(chebyshev.differentiate_bezier(control, 9) == 0.0)


def test_integrals() -> None:
    assert chebyshev.integrate(np.exp, [0, 1], 1e-13) == pytest.approx(np.e - 1, abs=1e-14)
    assert chebyshev.integrate(np.abs, [-1, 2], 1e-12) == pytest.approx(2.5, abs=1e-12)
    root = chebyshev.integrate(np.sqrt, [0, 1], 1e-12)
    assert root == pytest.approx(2 / 3, abs=1e-11)


@settings(max_examples=60)
@given(st.lists(st.floats(0.01, 0.99), min_size=1, max_size=6))
def test_roots_of_products(places: list[float]) -> None:
    roots = np.unique(places)
    if len(roots) > 1 and np.diff(roots).min() < 1e-2:
        return
    found = chebyshev.real_roots(
        lambda t: np.prod(np.asarray(t)[..., None] - roots, axis=-1), [0, 1]
    )
    np.testing.assert_allclose(found, roots, atol=1e-11)


def test_roots_of_other_functions() -> None:
    found = chebyshev.real_roots(lambda t: np.sin(40 * np.pi * t + 0.3), [0, 1])
    np.testing.assert_allclose(found, (np.arange(1, 41) * np.pi - 0.3) / (40 * np.pi), atol=1e-12)
    narrow = chebyshev.real_roots(lambda t: np.tanh(1e4 * (t - 0.5012345)), [0, 1])
    np.testing.assert_allclose(narrow, [0.5012345], atol=1e-12)
    assert len(chebyshev.real_roots(lambda t: 1.0 + t, [0, 1])) == 0
    assert len(chebyshev.real_roots(lambda t: 1e-15 * np.sin(9 * t - 1), [0, 1], floor=1e-12)) == 0
    jump = chebyshev.real_roots(lambda t: np.where(t < 0.5, -1.0 - t, 1.0 + t), [0, 0.5, 1])
    np.testing.assert_array_equal(jump, [0.5])


def test_piecewise_fit() -> None:
    def function(t: np.ndarray) -> np.ndarray:
        return np.stack([np.cos(20 * t), 1 / (1 + 400 * (t - 0.3) ** 2)], axis=-1)

    intervals, control = chebyshev.fit_piecewise(function, [0, 0.5, 1], 1e-9)
    np.testing.assert_array_equal(intervals[1:, 0], intervals[:-1, 1])
    assert 0.5 in intervals[:, 0]
    for (low, high), piece in zip(intervals, control, strict=True):
        expected = function(low + (high - low) * T)
        np.testing.assert_allclose(chebyshev.evaluate_bezier(piece, T), expected, atol=3e-9)


def test_values_need_a_dimension() -> None:
    with pytest.raises(GeometryError, match="shape"):
        chebyshev.coefficients(np.ones(3))
