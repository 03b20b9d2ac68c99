"""The clock agrees with controllers' planners, simulated chord by chord and step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import box

from grassfire.errors import InputError
from grassfire.toolpath import Program, Section, ToolpathBuilder
from grassfire.verify import Target
from grassfire.verify.clock import move_times
from grassfire.verify.path import Path, flatten_program

ACCELERATION, RAPID, DEVIATION = 500.0, 5000.0, 0.01
PLANNER = {"rapid": RAPID, "acceleration": ACCELERATION, "junction_deviation": DEVIATION}
coordinate = st.floats(-8.0, 8.0).map(lambda value: round(value, 3))


def path_of(builder: ToolpathBuilder) -> Path:
    section = Section(builder.build(), 1, math.nan, 1000.0, 0)
    target = Target(operation=0, region=box(0, 0, 1, 1), depth=1.0, tool_radius=1.0)
    return flatten_program(Program("time", (section,)), (target,))


@st.composite
def wandering(draw: st.DrawFn) -> ToolpathBuilder:
    """Rapids, lines, arcs and helices of at least a hundredth of a millimetre."""
    builder = ToolpathBuilder((0.0, 0.0, 0.0))
    for _ in range(draw(st.integers(1, 12))):
        x, y, z = draw(coordinate), draw(coordinate), draw(st.sampled_from([0.0, 0.0, -1.0, 2.0]))
        feed = draw(st.sampled_from([60.0, 400.0, 3000.0, 12000.0]))
        here = builder.position
        kind = draw(st.sampled_from(["line", "line", "rapid", "arc"]))
        if math.dist((x, y, z), here) < 0.01:
            continue
        if kind == "rapid":
            builder.rapid(x, y, z)
        elif kind == "line" or math.hypot(x - here[0], y - here[1]) < 0.01:
            builder.line(x, y, z, feed)
        else:
            share = draw(st.floats(-2.0, 2.0))
            dx, dy = x - here[0], y - here[1]
            centre = (here[0] + dx / 2 - share * dy, here[1] + dy / 2 + share * dx)
            builder.arc(x, y, z, centre, draw(st.booleans()), feed)
    return builder


def chords_of(path: Path, tolerance: float) -> tuple[list[np.ndarray], list[float]]:
    """The straight blocks that grbl's planner gets: vectors, and speeds in mm/s."""
    vectors, speeds = [], []
    for i in range(len(path)):
        radius = path.start_radius[i]
        count = 1
        if path.arc[i] and radius > tolerance:
            chord = math.sqrt(tolerance * (2 * radius - tolerance))
            count = max(1, math.floor(abs(0.5 * path.sweep[i] * radius) / chord))
        points = path.point(np.full(count + 1, i), np.arange(count + 1) / count)
        vectors += list(np.diff(points, axis=0))
        speeds += [(RAPID if path.rapid[i] else path.feed[i]) / 60] * count
    return vectors, speeds


def grbl_seconds(path: Path, tolerance: float) -> float:
    """The planner's two passes, one block after the other."""
    vectors, speeds = chords_of(path, tolerance)
    lengths = [float(np.linalg.norm(vector)) for vector in vectors]
    node = [0.0] * (len(vectors) + 1)
    for i in range(1, len(vectors)):
        cosine = float(vectors[i - 1] @ vectors[i]) / lengths[i - 1] / lengths[i]
        half = math.sqrt(max(0.0, (1 + cosine) / 2))
        limit = math.inf if cosine > 0.999999 else ACCELERATION * DEVIATION * half / (1 - half)
        limit = 0.0 if cosine < -0.999999 else limit
        node[i] = min(math.sqrt(limit), speeds[i - 1], speeds[i])
    for i in reversed(range(len(vectors))):
        node[i] = min(node[i], math.sqrt(node[i + 1] ** 2 + 2 * ACCELERATION * lengths[i]))
    total = 0.0
    for i, way in enumerate(lengths):
        node[i + 1] = min(node[i + 1], math.sqrt(node[i] ** 2 + 2 * ACCELERATION * way))
        start, stop = node[i], node[i + 1]
        peak = math.sqrt((2 * ACCELERATION * way + start**2 + stop**2) / 2)
        peak = min(speeds[i], peak)
        ramps = (2 * peak**2 - start**2 - stop**2) / (2 * ACCELERATION)
        total += (2 * peak - start - stop) / ACCELERATION + (way - ramps) / peak
    return total


@settings(max_examples=60, deadline=None)
@given(wandering())
def test_time_is_that_of_grbls_planner(builder: ToolpathBuilder) -> None:
    path = path_of(builder)
    times = move_times(path, **PLANNER)
    # The chords of arcs are shorter than the arcs, by less than a percent from a radius of 0.1 on,
    # and between two of them grbl may speed up.
    assert times.sum() == pytest.approx(grbl_seconds(path, 0.002), rel=0.01, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(wandering())
def test_time_of_straight_moves_is_exactly_that_of_grbls_planner(builder: ToolpathBuilder) -> None:
    path = path_of(builder)
    if path.arc.any():
        return
    assert move_times(path, **PLANNER).sum() == pytest.approx(grbl_seconds(path, 0.002), rel=1e-9)


def stepped_seconds(
    lengths: list[float], speeds: list[float], corners: list[float], rates: list[float]
) -> float:
    """Time along a path on a fine grid: speed held at corners and along moves, two passes."""
    steps = 4000
    width = np.repeat(np.array(lengths) / steps, steps)
    rate = np.repeat(rates, steps)
    limit = np.full(len(width) + 1, np.inf)
    ends = np.arange(len(lengths) + 1) * steps
    limit[:-1] = np.minimum(limit[:-1], np.repeat(speeds, steps))
    limit[1:] = np.minimum(limit[1:], np.repeat(speeds, steps))
    limit[ends] = np.minimum(limit[ends], [0.0, *corners, 0.0])
    squared = limit**2
    for i in range(len(width) - 1, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + 2 * rate[i] * width[i])
    for i in range(len(width)):
        squared[i + 1] = min(squared[i + 1], squared[i] + 2 * rate[i] * width[i])
    speed = np.sqrt(squared)
    return float(np.sum(2 * width / (speed[:-1] + speed[1:])))


@pytest.mark.parametrize("tolerance", [0.0, 0.002, 0.05, 5.0])
def test_time_is_that_of_blended_corners(tolerance: float) -> None:
    """A square corner, a blunt one and an arc, as LinuxCNC takes them after G64 P."""
    builder = ToolpathBuilder((0.0, 0.0, 0.0))
    builder.line(20.0, 0.0, 0.0, 3000.0)
    builder.line(20.0, 6.0, 0.0, 3000.0)
    builder.line(24.0, 10.0, 0.0, 3000.0)
    builder.arc(24.0, 14.0, 0.0, (24.0, 12.0), True, 3000.0)
    times = move_times(path_of(builder), **PLANNER, path_tolerance=tolerance)

    lengths = [20.0, 6.0, math.hypot(4, 4), 2 * math.pi]
    normal = math.sqrt(3) / 2 * ACCELERATION
    on_arc = math.sqrt(normal * 2.0)
    corners = []
    for turn, shorter in ((90.0, 6.0), (45.0, math.hypot(4, 4)), (45.0, math.hypot(4, 4))):
        half = math.radians(180 - turn) / 2
        # The arc that rounds a corner leaves it by r (1 / sin(half) - 1), and begins
        # r / tan(half) before it.
        radius = tolerance / (1 / math.sin(half) - 1)
        radius = min(radius, shorter / 2 * math.tan(half))
        corners.append(math.sqrt(normal * radius))
    expected = stepped_seconds(
        lengths,
        [50.0, 50.0, 50.0, on_arc],
        [corners[0], corners[1], min(corners[2], on_arc)],
        [ACCELERATION, ACCELERATION, ACCELERATION, ACCELERATION / 2],
    )
    assert times.sum() == pytest.approx(expected, rel=1e-3)


def test_tighter_tolerances_take_longer() -> None:
    builder = ToolpathBuilder((0.0, 0.0, 0.0))
    for i in range(1, 40):
        builder.line(float(i), float(i % 3), 0.0, 4000.0)
    path = path_of(builder)
    sums = [move_times(path, **PLANNER, path_tolerance=t).sum() for t in (0.0, 0.001, 0.01, 0.1)]
    assert sums == sorted(sums, reverse=True)
    assert sums[0] > 1.2 * sums[-1]


def test_time_of_one_long_move_is_a_trapezoid() -> None:
    builder = ToolpathBuilder((0.0, 0.0, 0.0))
    builder.line(100.0, 0.0, 0.0, 1200.0)
    times = move_times(path_of(builder), **PLANNER)
    assert times[0] == pytest.approx(100 / 20 + 20 / 500)


@pytest.mark.parametrize("wrong", [{"arc_tolerance": 0.0}, {"path_tolerance": -0.1}])
def test_tolerances_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    builder = ToolpathBuilder((0.0, 0.0, 0.0))
    builder.line(1.0, 0.0, 0.0, 100.0)
    with pytest.raises(InputError, match="tolerance"):
        move_times(path_of(builder), **PLANNER, **wrong)
