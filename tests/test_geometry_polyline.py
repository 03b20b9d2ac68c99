"""Polylines fitted by lines, arcs and splines: what is recovered, how far off, what is refused."""

from __future__ import annotations

import time
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from grassfire.errors import GeometryError
from grassfire.geometry import (
    SMOOTH,
    Arc,
    Bezier,
    BSpline,
    Curve,
    EllipticalArc,
    Line,
    Loop,
    Region,
    fit_open_polyline,
    fit_polyline,
    fit_region,
    flatten,
)
from grassfire.medial import medial_axis

TOLERANCE = 0.01
QUARTER = 0.5 * np.pi


def ellipse(count: int, a: float = 30.0, b: float = 18.0) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.column_stack([a * np.cos(angle), b * np.sin(angle)])


def star(count: int = 10) -> np.ndarray:
    angle = np.arange(count) * 2.0 * np.pi / count
    reach = np.where(np.arange(count) % 2, 8.0, 20.0)
    return np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])


def rounded_rectangle(w: float = 40.0, h: float = 25.0, r: float = 5.0) -> Loop:
    return Loop(
        (
            Line((r, 0), (w - r, 0)),
            Arc((w - r, r), r, -QUARTER, QUARTER),
            Line((w, r), (w, h - r)),
            Arc((w - r, h - r), r, 0.0, QUARTER),
            Line((w - r, h), (r, h)),
            Arc((r, h - r), r, QUARTER, QUARTER),
            Line((0, h - r), (0, r)),
            Arc((r, r), r, 2 * QUARTER, QUARTER),
        )
    )


def stadium(length: float = 30.0, r: float = 8.0) -> Loop:
    return Loop(
        (
            Line((0, -r), (length, -r)),
            Arc((length, 0), r, -QUARTER, np.pi),
            Line((length, r), (0, r)),
            Arc((0, 0), r, QUARTER, np.pi),
        )
    )


def oval(d: float = 10.0, r: float = 4.0, h: float = 12.0) -> Loop:
    """Four arcs, each tangent to the next."""
    reach, a = r + np.hypot(d, h), np.arctan2(h, d)
    return Loop.chained(
        (
            Arc((d, 0), r, -a, 2 * a),
            Arc((0, -h), reach, a, 2 * (QUARTER - a)),
            Arc((-d, 0), r, np.pi - a, 2 * a),
            Arc((0, h), reach, np.pi + a, 2 * (QUARTER - a)),
        ),
        1e-9,
    )


def gear(teeth: int = 12) -> Loop:
    curves: list[Curve] = []
    pitch = 2.0 * np.pi / teeth
    for tooth in range(teeth):
        tip = Arc((0, 0), 20.0, tooth * pitch, 0.3 * pitch)
        root = Arc((0, 0), 16.0, (tooth + 0.45) * pitch, 0.4 * pitch)
        following = Arc((0, 0), 20.0, (tooth + 1) * pitch, 0.3 * pitch)
        curves += [tip, Line(tip.end, root.start), root, Line(root.end, following.start)]
    return Loop.chained(curves, 1e-9)


def glyph() -> Loop:
    rows = (
        ((0, 0), (10, 0)),
        ((10, 0), (18, 0), (22, 5), (22, 11)),
        ((22, 11), (22, 18), (17, 22), (10, 22)),
        ((10, 22), (4, 22), (2, 19), (3, 15)),
        ((3, 15), (9, 13), (6, 6), (0, 0)),
    )
    return Loop(tuple(Bezier(np.array(row, dtype=float)) for row in rows))


def vertices(loop: Loop, tolerance: float = TOLERANCE) -> np.ndarray:
    return flatten(loop, tolerance)[:-1]


def respaced(points: np.ndarray, step: float) -> np.ndarray:
    ring = np.concatenate([points, points[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(ring, axis=0).T))])
    where = np.arange(0.0, length[-1], step)
    return np.column_stack([np.interp(where, length, ring[:, axis]) for axis in (0, 1)])


def disturbed(points: np.ndarray, amplitude: float, seed: int = 3) -> np.ndarray:
    """Points moved by no more than the amplitude, evenly in both coordinates."""
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, points.shape)
    return points + amplitude / np.sqrt(2.0) * noise


def kinds(loop: Loop) -> Counter[str]:
    return Counter(type(curve).__name__ for curve in loop.curves)


def corner_count(loop: Loop) -> int:
    return int(np.count_nonzero(loop.junctions(1e-4).kind != SMOOTH))


def farthest(points: np.ndarray, ring: np.ndarray) -> float:
    closed = np.concatenate([ring, ring[:1]])
    chords = shapely.linestrings(np.stack([closed[:-1], closed[1:]], axis=1))
    tree = shapely.STRtree(chords)
    _, off = tree.query_nearest(shapely.points(points), return_distance=True, all_matches=False)
    return float(off.max())


def deviations(loop: Loop, points: np.ndarray) -> tuple[float, float]:
    """Largest distance from the vertices to the loop, and from the loop to the polyline."""
    fine = flatten(loop, 1e-5)
    return farthest(points, fine), farthest(fine, points)


def distance_between(first: Loop, second: Loop, accuracy: float = 1e-5) -> float:
    """Hausdorff distance both ways, measured at dense points."""
    one, two = flatten(first, accuracy), flatten(second, accuracy)
    return max(farthest(one, two), farthest(two, one))


# -- what is recovered ---------------------------------------------------------------------------


@pytest.mark.parametrize("count", [20, 24, 64, 1000])
def test_circle(count: int) -> None:
    loop = fit_polyline(np.add(ellipse(count, 10.0, 10.0), [3.0, -2.0]), TOLERANCE)
    (arc,) = loop.curves
    assert isinstance(arc, Arc) and arc.closed and arc.sweep > 0.0
    assert abs(arc.radius - 10.0) < 1e-9 and np.allclose(arc.centre, [3.0, -2.0], atol=1e-9)


@pytest.mark.parametrize(
    ("make", "expected", "sharp"),
    [
        (stadium, {"Line": 2, "Arc": 2}, 0),
        (rounded_rectangle, {"Line": 4, "Arc": 4}, 0),
        (lambda: rounded_rectangle(r=1.0), {"Line": 4, "Arc": 4}, 0),
        (oval, {"Arc": 4}, 0),
        (gear, {"Line": 24, "Arc": 24}, 48),
    ],
    ids=["stadium", "rounded rectangle", "small fillets", "oval", "gear"],
)
def test_lines_and_arcs_come_back(make: object, expected: dict[str, int], sharp: int) -> None:
    true = make()  # type: ignore[operator]
    points = vertices(true)
    loop = fit_polyline(points, TOLERANCE)
    assert kinds(loop) == expected and corner_count(loop) == sharp
    assert distance_between(loop, true, 2e-6) < 2e-5
    radii = {round(curve.radius, 3) for curve in loop.curves if isinstance(curve, Arc)}
    assert radii == {round(curve.radius, 3) for curve in true.curves if isinstance(curve, Arc)}


def test_lines_and_arcs_with_rounded_coordinates() -> None:
    loop = fit_polyline(np.round(vertices(rounded_rectangle()), 3), TOLERANCE)
    assert kinds(loop) == {"Line": 4, "Arc": 4}
    assert distance_between(loop, rounded_rectangle()) < 2e-3


@pytest.mark.parametrize(
    ("true", "expected", "sharp"),
    [
        (rounded_rectangle(), {"Line": 4, "Arc": 4}, 0),
        (oval(), {"Arc": 4}, 0),
        (Loop((Arc((0, 0), 12.0),)), {"Arc": 1}, 0),
    ],
    ids=["rounded rectangle", "oval", "circle"],
)
def test_lines_and_arcs_under_noise(true: Loop, expected: dict[str, int], sharp: int) -> None:
    points = disturbed(respaced(vertices(true, 1e-5), 0.1), 0.4 * TOLERANCE)
    loop = fit_polyline(points, TOLERANCE)
    assert kinds(loop) == expected and corner_count(loop) == sharp
    assert distance_between(loop, true) < 0.5 * TOLERANCE
    assert deviations(loop, points)[0] <= TOLERANCE


def test_polygon_under_noise_keeps_its_corners() -> None:
    points = disturbed(respaced(star(), 0.05), 0.4 * TOLERANCE)
    loop = fit_polyline(points, TOLERANCE)
    assert kinds(loop) == {"Line": 10} and corner_count(loop) == 10
    assert deviations(loop, points)[0] <= TOLERANCE


@pytest.mark.parametrize(
    "points",
    [
        star(),
        star(40),
        ellipse(3),
        ellipse(4, 10.0, 10.0),
        ellipse(8, 10.0, 10.0),
        np.array([[0, 0], [50, 0], [50, 30], [25, 34], [0, 30.0]]),
        np.array([[0, 0], [60, 0], [60, 20], [20, 20], [20, 50], [0, 50.0]]),
    ],
    ids=["star", "fine star", "triangle", "square", "octagon", "house", "bracket"],
)
def test_polygons_stay(points: np.ndarray) -> None:
    loop = fit_polyline(points, TOLERANCE)
    assert kinds(loop) == {"Line": len(points)}
    assert {tuple(curve.start) for curve in loop.curves} == {tuple(row) for row in points}


def test_collinear_runs_become_one_line() -> None:
    corners = np.array([[0, 0], [50, 0], [50, 30], [0, 30.0]])
    loop = fit_polyline(respaced(corners, 0.1), TOLERANCE)
    assert kinds(loop) == {"Line": 4}
    starts = np.array([curve.start for curve in loop.curves])
    nearest = np.abs(starts[:, None] - corners).max(axis=2).min(axis=1)
    assert nearest.max() < 1e-9


def test_teardrop_has_one_corner_and_is_tangent_elsewhere() -> None:
    angle = np.arccos(10 / 25)
    touch = 10.0 * np.array([np.cos(angle), np.sin(angle)])
    true = Loop(
        (
            Arc((0, 0), 10.0, angle, 2 * (np.pi - angle)),
            Line(touch * [1, -1], (25, 0)),
            Line((25, 0), touch),
        )
    )
    loop = fit_polyline(vertices(true), TOLERANCE)
    assert kinds(loop) == {"Line": 2, "Arc": 1} and corner_count(loop) == 1


# -- how far off ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "points",
    [
        ellipse(60),
        ellipse(400),
        disturbed(ellipse(400), 0.4 * TOLERANCE),
        vertices(glyph()),
        vertices(glyph(), 1e-3),
        np.round(vertices(glyph()), 3),
        vertices(gear()),
        vertices(oval()),
    ],
    ids=["60", "400", "noise", "glyph", "fine glyph", "rounded glyph", "gear", "oval"],
)
def test_both_bounds(points: np.ndarray) -> None:
    loop = fit_polyline(points, TOLERANCE)
    there, back = deviations(loop, points)
    assert there <= TOLERANCE
    chord = np.roll(points, -1, axis=0) - points
    before = np.roll(chord, 1, axis=0)
    sine = before[:, 0] * chord[:, 1] - before[:, 1] * chord[:, 0]
    turn = np.abs(np.arctan2(sine, (before * chord).sum(axis=1)))
    turn[turn > np.radians(20.0)] = 0.0
    sagitta = 0.25 * np.hypot(*chord.T) * np.maximum(turn, np.roll(turn, -1))
    assert back <= TOLERANCE + sagitta.max()


def test_exact_data_are_followed_closely() -> None:
    loop = fit_polyline(ellipse(400), TOLERANCE)
    true = Loop((EllipticalArc((0, 0), (30, 0), (0, 18), 0.0, 2 * np.pi),))
    assert kinds(loop) == {"BSpline": 1} and corner_count(loop) == 0
    assert distance_between(loop, true) < 0.1 * TOLERANCE
    assert abs(loop.area / (np.pi * 30 * 18) - 1.0) < 1e-6


def test_noise_is_smoothed() -> None:
    points = disturbed(ellipse(2000), 0.5 * TOLERANCE)
    loop = fit_polyline(points, TOLERANCE)
    true = Loop((EllipticalArc((0, 0), (30, 0), (0, 18), 0.0, 2 * np.pi),))
    assert distance_between(loop, true) < 0.75 * TOLERANCE
    assert sum(len(curve.breaks()) for curve in loop.curves) < 80


def test_uneven_spacing() -> None:
    angle = np.sort(np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, 300))
    circle = 20.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert kinds(fit_polyline(circle, TOLERANCE)) == {"Arc": 1}
    loop = fit_polyline(circle * [1.5, 0.9], TOLERANCE)
    assert kinds(loop) == {"BSpline": 1} and deviations(loop, circle * [1.5, 0.9])[0] <= TOLERANCE


# -- the medial axis -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "points",
    [ellipse(400), ellipse(60), disturbed(ellipse(400), 0.4 * TOLERANCE)],
    ids=["exact", "coarse", "noise"],
)
def test_axis_of_a_fitted_ellipse_has_two_ends(points: np.ndarray) -> None:
    axis = medial_axis(Region(fit_polyline(points, TOLERANCE)))
    found = Counter(axis.vertex_kind)
    assert found["end"] == 2 and found["branch"] == 0 and found["corner"] == 0


@pytest.mark.parametrize(
    "make", [stadium, rounded_rectangle, glyph], ids=lambda make: make.__name__
)
def test_axis_has_the_ends_of_the_true_shape(make: object) -> None:
    true = make()  # type: ignore[operator]
    wanted = Counter(medial_axis(Region(true)).vertex_kind)
    found = Counter(medial_axis(Region(fit_polyline(vertices(true), TOLERANCE))).vertex_kind)
    for kind in ("end", "corner", "branch"):
        assert found[kind] == wanted[kind]


# -- laws ----------------------------------------------------------------------------------------

SHAPES = {
    "ellipse": ellipse(200),
    "rounded rectangle": vertices(rounded_rectangle()),
    "glyph": vertices(glyph()),
    "star": star(),
}


@pytest.mark.parametrize("name", SHAPES)
@settings(max_examples=2, deadline=None)
@given(
    angle=st.floats(-3.0, 3.0),
    shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    start=st.integers(0, 199),
    backwards=st.booleans(),
)
def test_motion_start_and_reversal(
    name: str, angle: float, shift: tuple[float, float], start: int, backwards: bool
) -> None:
    points = SHAPES[name]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = np.roll(points, start % len(points), axis=0)[:: -1 if backwards else 1] @ turn.T + shift
    plain = fit_polyline(points, TOLERANCE)
    image = plain.transformed(np.column_stack([turn, shift]))
    other = fit_polyline(moved, TOLERANCE)
    assert kinds(other) == kinds(plain) and corner_count(other) == corner_count(plain)
    assert distance_between(other, image, 5e-5) < 0.2 * TOLERANCE
    assert (other.area < 0.0) == ((plain.area < 0.0) != backwards)


def test_scale() -> None:
    points = vertices(rounded_rectangle())
    for factor in (1e-3, 1e3):
        loop = fit_polyline(factor * points, factor * TOLERANCE)
        assert kinds(loop) == {"Line": 4, "Arc": 4}


def test_same_input_same_bytes() -> None:
    points = vertices(glyph())
    first, second = (fit_polyline(points, TOLERANCE) for _ in range(2))
    t = np.linspace(0.0, 1.0, 50)
    for one, two in zip(first.curves, second.curves, strict=True):
        assert one.point(t).tobytes() == two.point(t).tobytes()


def test_repeated_points_count_once() -> None:
    points = ellipse(200)
    plain = fit_polyline(points, TOLERANCE)
    closed = np.concatenate([np.repeat(points, 3, axis=0), points[:1]])
    assert distance_between(fit_polyline(closed, TOLERANCE), plain) < 1e-9
    near = np.repeat(points, 2, axis=0)
    near[1::2] += 1e-9
    assert distance_between(fit_polyline(near, TOLERANCE), plain) < 1e-6


@pytest.mark.parametrize("factor", [1.0, 1.5], ids=["circle", "ellipse"])
def test_many_points(factor: float) -> None:
    points = ellipse(20_000, 20.0 * factor, 20.0)
    start = time.process_time()
    loop = fit_polyline(points, TOLERANCE)
    assert time.process_time() - start < 5.0
    assert len(loop.curves) == 1


@pytest.mark.parametrize(("amplitude", "seed"), [(0.1, 17), (0.4, 18)])
def test_vertices_closer_together_than_their_noise(seed: int, amplitude: float) -> None:
    points = disturbed(ellipse(20_000), amplitude * TOLERANCE, seed)
    loop = fit_polyline(points, TOLERANCE)
    assert kinds(loop) == {"BSpline": 1} and farthest(points, flatten(loop, 2e-5)) <= TOLERANCE


@pytest.mark.parametrize("seed", [41, 42])
@pytest.mark.parametrize("make", [rounded_rectangle, stadium, gear, glyph])
def test_vertices_are_near_whatever_the_noise_leaves(make: object, seed: int) -> None:
    true = make()  # type: ignore[operator]
    points = disturbed(respaced(vertices(true, 1e-5), 0.1), 0.5 * TOLERANCE, seed)
    loop = fit_polyline(points, TOLERANCE)
    assert farthest(points, flatten(loop, 2e-5)) <= TOLERANCE
    assert len(loop.curves) < 80


def test_noise_beyond_the_tolerance_is_refused() -> None:
    with pytest.raises(GeometryError, match="crosses itself"):
        fit_polyline(disturbed(ellipse(20_000), 5.0 * TOLERANCE), TOLERANCE)


def test_fine_teeth_stay() -> None:
    points = ellipse(3_000, 20.0, 20.0)
    points[::2] *= 1.0 + TOLERANCE / 4.0
    loop = fit_polyline(points, TOLERANCE)
    assert kinds(loop) == {"Line": 3_000}


# -- open runs and regions -----------------------------------------------------------------------


def test_open_run_keeps_its_ends() -> None:
    angle = np.linspace(0.2, 2.5, 90)
    points = np.column_stack([30 * np.cos(angle), 18 * np.sin(angle)])
    (curve,) = fit_open_polyline(points, TOLERANCE)
    assert isinstance(curve, BSpline)
    assert np.all(curve.start == points[0]) and np.all(curve.end == points[-1])
    tangent = np.array([-30 * np.sin(0.2), 18 * np.cos(0.2)])
    (guided,) = fit_open_polyline(points, TOLERANCE, start_tangent=tangent)
    assert np.allclose(guided.tangent(0.0), tangent / np.hypot(*tangent), atol=1e-9)


def test_two_points_are_a_line() -> None:
    (line,) = fit_open_polyline([[0, 0], [3, 4]], TOLERANCE)
    assert isinstance(line, Line)


def test_region_keeps_true_curves_and_fits_the_rest() -> None:
    angle = np.linspace(-QUARTER, QUARTER, 80)
    half = np.column_stack([30 + 12 * np.cos(angle), 8 * np.sin(angle)])
    chords = [Line(a, b) for a, b in pairwise(half)]
    true = Arc((0, 0), 8.0, QUARTER, np.pi)
    outer = Loop((Line((0, -8), (30, -8)), *chords, Line((30, 8), (0, 8)), true))
    hole = np.add(ellipse(100, 5.0, 5.0), [10.0, 0.0])
    island = Loop(tuple(Line(a, b) for a, b in zip(hole, np.roll(hole, -1, axis=0), strict=True)))
    region = fit_region(Region(outer, (island,)), TOLERANCE)
    assert kinds(region.outer) == {"Line": 2, "BSpline": 1, "Arc": 1}
    assert any(curve is true for curve in region.outer.curves)
    assert corner_count(region.outer) == 0
    assert kinds(region.islands[0]) == {"Arc": 1}
    assert abs(region.area - (0.5 * np.pi * (64 + 96) + 480 - 25 * np.pi)) < 0.05


# -- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf])
def test_tolerance_must_be_positive(tolerance: float) -> None:
    with pytest.raises(GeometryError, match="tolerance"):
        fit_polyline(star(), tolerance)


def test_corner_angle_must_be_positive() -> None:
    with pytest.raises(GeometryError, match="corner angle"):
        fit_polyline(star(), TOLERANCE, corner_angle=0.0)


@pytest.mark.parametrize(
    "points",
    [np.empty((0, 2)), [[0, 0]], [[0, 0], [1, 0]], [[1, 1]] * 5, [[0, 0], [1, 0], [0, 0]]],
    ids=["none", "one", "two", "one often", "there and back"],
)
def test_too_few_points(points: object) -> None:
    with pytest.raises(GeometryError, match="3 different points"):
        fit_polyline(points, TOLERANCE)  # type: ignore[arg-type]


@pytest.mark.parametrize("points", [[[0, 0, 0]] * 4, [[0, np.nan], [1, 0], [0, 1]]])
def test_points_must_be_finite_pairs(points: object) -> None:
    with pytest.raises(GeometryError, match="polyline"):
        fit_polyline(points, TOLERANCE)  # type: ignore[arg-type]


def test_crossings_are_refused_with_their_place() -> None:
    with pytest.raises(GeometryError, match="crosses itself") as caught:
        fit_polyline([[0, 0], [10, 10], [10, 0], [0, 10]], TOLERANCE)
    assert np.allclose(np.array(caught.value.place, dtype=float), [5.0, 5.0])
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    eight = np.column_stack([20 * np.cos(angle), 10 * np.sin(2 * angle)])
    with pytest.raises(GeometryError, match="crosses itself"):
        fit_polyline(eight, TOLERANCE)
