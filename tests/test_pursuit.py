"""Laws of cuts at constant engagement: the closed form is that of its differential equation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from grassfire.plan.pursuit import Pursuit, pursue, unit, wrapped
from grassfire.toolpath import FloatArray

RADIUS = 3.0
LIMIT = 1.2


def chain(seed: int, count: int, bend: float) -> FloatArray:
    """A front of random steps and turns."""
    random = np.random.default_rng(seed)
    heading = np.cumsum(random.uniform(-bend, bend, count))
    step = random.uniform(0.02, 0.4, count)[:, None] * unit(heading)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])


def circle(radius: float, turns: float, sense: int, count: int) -> FloatArray:
    """A front round the origin."""
    return radius * unit(sense * np.linspace(0.0, 2 * np.pi * turns, count))


def integrated(front: FloatArray, bearing: float, engagement: FloatArray) -> FloatArray:
    """Bearings by numerical integration of alpha' = sin(tau - alpha - psi) / (R cos(psi))."""
    bearings = [bearing]
    for begin, end, angle in zip(front[:-1], front[1:], engagement, strict=True):
        chord = end - begin
        tau, psi = float(np.arctan2(chord[1], chord[0])), np.pi / 2 - angle

        def slope(_: float, alpha: FloatArray, tau: float = tau, psi: float = psi) -> FloatArray:
            return np.asarray(np.sin(tau - alpha - psi) / (RADIUS * np.cos(psi)))

        span = (0.0, float(np.hypot(*chord)))
        found = solve_ivp(slope, span, [bearings[-1]], method="DOP853", rtol=1e-12, atol=1e-13)
        bearings.append(float(found.y[0, -1]))
    return np.array(bearings)


def followed(front: FloatArray, bearing: float, engagement: float = LIMIT) -> Pursuit:
    """The way along a front at one engagement."""
    return pursue(front, bearing, RADIUS, np.full(len(front) - 1, engagement))


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    bend=st.floats(0.0, 0.5),
    bearing=st.floats(-2.5, 0.5),
    limits=st.tuples(st.floats(0.3, 2.8), st.floats(0.3, 2.8)),
)
def test_way_solves_the_differential_equation(
    seed: int, bend: float, bearing: float, limits: tuple[float, float]
) -> None:
    front = chain(seed, 40, bend)
    engagement = np.linspace(*limits, 40)
    way = pursue(front, bearing, RADIUS, engagement)
    expected = integrated(front, bearing, engagement)
    assert np.abs(wrapped(way.bearing - expected)).max() < 1e-9
    assert np.abs(way.centre + RADIUS * unit(expected) - front).max() < 1e-8


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), bearing=st.floats(-2.0, 0.5), share=st.floats(0.05, 0.95))
def test_more_points_on_the_same_front_change_nothing(
    seed: int, bearing: float, share: float
) -> None:
    front = chain(seed, 30, 0.3)
    fine = np.stack([front[:-1], front[:-1] + share * np.diff(front, axis=0)], axis=1)
    fine = np.concatenate([fine.reshape(-1, 2), front[-1:]])
    assert followed(fine, bearing).centre[::2] == pytest.approx(
        followed(front, bearing).centre, abs=1e-9
    )


def test_rim_is_on_the_front_and_the_way_goes_where_it_heads() -> None:
    front = circle(20.0, 0.5, 1, 4000)
    way = followed(front, 0.5)
    assert np.hypot(*(way.centre - front).T) == pytest.approx(RADIUS, abs=1e-12)
    chord = np.diff(way.centre, axis=0)
    heading = np.arctan2(chord[:, 1], chord[:, 0])
    middle = (way.heading[1:] + way.heading[:-1]) / 2
    assert np.abs(wrapped(heading - middle)).max() < 1e-3
    assert np.all(way.advance > 0)


def test_angle_from_the_right_of_the_tool_to_the_front_is_the_engagement() -> None:
    front = chain(3, 200, 0.2)
    engagement = np.linspace(0.2, 1.5, 200)
    way = pursue(front, -0.4, RADIUS, engagement)
    angle = wrapped(way.bearing[1:] - (way.heading[1:] - np.pi / 2))
    assert angle == pytest.approx(engagement, abs=1e-9)


@pytest.mark.parametrize("bearing", [-2.6, -1.5, -0.37, 0.8])
def test_a_straight_front_is_cut_with_the_width_of_a_straight_cut(bearing: float) -> None:
    front = np.stack([np.linspace(0.0, 60.0, 601), np.zeros(601)], axis=1)
    way = followed(front, bearing)
    assert way.centre[-1, 1] == pytest.approx(RADIUS * np.cos(LIMIT), abs=1e-6)
    # the error falls as exp(-s / k), k = R sin(engagement)
    theta = np.tan((way.bearing + np.pi / 2 - LIMIT) / 2)
    along = front[:, 0] / (RADIUS * np.sin(LIMIT))
    assert theta == pytest.approx(theta[0] * np.exp(-along), abs=1e-9)


@pytest.mark.parametrize(("rho", "engagement"), [(4.0, 1.0), (9.0, 0.5), (25.0, 1.37), (25.0, 2.4)])
def test_round_a_hole_the_way_tends_to_a_circle(rho: float, engagement: float) -> None:
    front = circle(rho, 5.0, 1, 60_000)
    way = followed(front, -np.pi / 2 + engagement, engagement)
    path = np.hypot(*way.centre[-1])
    # stock outside: p^2 + 2 p R cos(engagement) + R^2 = rho^2
    along = RADIUS * np.cos(engagement)
    assert path == pytest.approx(np.sqrt(along**2 + rho**2 - RADIUS**2) - along, rel=1e-6)
    assert path**2 + 2 * path * along + RADIUS**2 == pytest.approx(rho**2, rel=1e-6)


@pytest.mark.parametrize(("rho", "engagement"), [(9.0, 0.5), (25.0, 1.37)])
def test_round_an_island_the_way_tends_to_a_circle(rho: float, engagement: float) -> None:
    front = circle(rho, 5.0, -1, 60_000)
    way = followed(front, -np.pi, engagement)
    path = np.hypot(*way.centre[-1])
    # stock inside: p^2 - 2 p R cos(engagement) + R^2 = rho^2
    cosine = np.cos(engagement)
    assert path**2 - 2 * path * RADIUS * cosine + RADIUS**2 == pytest.approx(rho**2, rel=1e-6)


def test_thicker_on_straight_fronts_than_in_hollow_ones() -> None:
    straight = RADIUS * (1 - np.cos(LIMIT))
    hollow = []
    for rho in (5.0, 10.0, 40.0):
        way = followed(circle(rho, 5.0, 1, 60_000), -np.pi / 2 + LIMIT)
        hollow.append(float(np.hypot(*way.centre[-1])) + RADIUS - rho)
    assert hollow[0] < hollow[1] < hollow[2] < straight


def test_motion_of_the_front_moves_the_way() -> None:
    front, angle, shift = chain(11, 80, 0.3), 0.7, np.array([300.0, -200.0])
    turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    moved = followed(front @ turned + shift, -0.5 + angle)
    assert moved.centre == pytest.approx(followed(front, -0.5).centre @ turned + shift, abs=1e-9)


def test_scale_of_front_and_tool_scales_the_way() -> None:
    front = chain(12, 80, 0.3)
    big = pursue(25.4 * front, -0.5, 25.4 * RADIUS, np.full(80, LIMIT))
    assert big.centre == pytest.approx(25.4 * followed(front, -0.5).centre, abs=1e-8)


@pytest.mark.parametrize("sense", [1, -1])
def test_long_fronts_neither_overflow_nor_vanish(sense: int) -> None:
    way = followed(circle(400.0, 40.0, sense, 1_000_000), -1.0)
    assert np.all(np.isfinite(way.centre))
    last = np.hypot(*way.centre[-2000:].T)
    assert np.ptp(last) < 1e-6


def test_a_front_that_turns_back_is_told_by_a_negative_advance() -> None:
    front = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 0.1]])
    way = followed(front, -0.5)
    assert way.advance[1] > 0
    assert way.advance[2] < 0


def test_units_and_wrapped_angles() -> None:
    angle = np.linspace(-20.0, 20.0, 401)
    assert unit(wrapped(angle)) == pytest.approx(unit(angle), abs=1e-12)
    assert wrapped(angle).min() >= -np.pi
    assert wrapped(angle).max() < np.pi
    assert unit(0.0) == pytest.approx([1.0, 0.0])
