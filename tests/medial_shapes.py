"""Regions to try the medial axis on: generators, each a function of a few numbers in mm."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))

from outlines import interpolating_loop as spline_loop

from grassfire.geometry import Arc, Bezier, Curve, EllipticalArc, Line, Loop, Region

FloatArray = NDArray[np.float64]
TURN = 2.0 * np.pi


# -- pieces ---------------------------------------------------------------------------------------


def polygon_loop(points: ArrayLike) -> Loop:
    """Closed polygon through the points (n, 2)."""
    corners = np.asarray(points, dtype=np.float64)
    following = np.roll(corners, -1, axis=0)
    return Loop(tuple(Line(a, b) for a, b in zip(corners, following, strict=True)))


def circle_loop(centre: ArrayLike, radius: float, parts: int = 1) -> Loop:
    """Circle of equal arcs."""
    step = TURN / parts
    arcs = [Arc(np.asarray(centre, float), radius, k * step, step) for k in range(parts)]
    return Loop(tuple(arcs))


def polar(radius: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Points of polar coordinates."""
    distance, direction = np.broadcast_arrays(np.asarray(radius, float), np.asarray(angle, float))
    return np.stack([distance * np.cos(direction), distance * np.sin(direction)], axis=-1)


# -- lines ----------------------------------------------------------------------------------------


def polygon(points: ArrayLike, islands: Sequence[ArrayLike] = ()) -> Region:
    return Region(polygon_loop(points), tuple(polygon_loop(island) for island in islands))


def rectangle(width: float = 40.0, height: float = 20.0) -> Region:
    x, y = width / 2, height / 2
    return polygon([(-x, -y), (x, -y), (x, y), (-x, y)])


def square(side: float = 20.0) -> Region:
    return rectangle(side, side)


def ell(arm: float = 30.0, width: float = 10.0) -> Region:
    """L with its reflex corner at (width, width)."""
    return polygon([(0, 0), (arm, 0), (arm, width), (width, width), (width, arm), (0, arm)])


def tee() -> Region:
    return polygon([(-30, 0), (30, 0), (30, 12), (6, 12), (6, 40), (-6, 40), (-6, 12), (-30, 12)])


def cross(arm: float = 20.0, width: float = 8.0) -> Region:
    w = width / 2
    quarter = np.array([(arm, -w), (arm, w), (w, w)])
    turned = [quarter @ np.array([[c, s], [-s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    return polygon(np.concatenate(turned))


def comb(teeth: int = 5, pitch: float = 8.0, depth: float = 20.0) -> Region:
    """A back with teeth; the slots between them are half a pitch wide."""
    points = [(0.0, -6.0), ((teeth - 0.5) * pitch, -6.0)]
    for tooth in reversed(range(teeth)):
        left, right = tooth * pitch, (tooth + 0.5) * pitch
        points += [(right, depth), (left, depth)]
        if tooth:
            points += [(left, 0.0), (left - 0.5 * pitch, 0.0)]
    return polygon(points)


def regular_polygon(corners: int, radius: float = 20.0, phase: float = 0.1) -> Region:
    return polygon(polar(radius, phase + TURN * np.arange(corners) / corners))


def irregular_inscribed(corners: int, radius: float = 20.0, seed: int = 1) -> Region:
    """Polygon with its corners on a circle, at uneven angles."""
    draw = np.random.default_rng(seed)
    step = draw.uniform(0.5, 1.5, corners)
    return polygon(polar(radius, TURN * np.cumsum(step) / step.sum()))


def star(points: int, outer: float = 20.0, inner: float = 8.0) -> Region:
    angle = 0.2 + np.pi * np.arange(2 * points) / points
    return polygon(polar(np.where(np.arange(2 * points) % 2, inner, outer), angle))


def needle(degrees: float = 0.5, length: float = 50.0) -> Region:
    half = length * np.tan(np.radians(degrees) / 2)
    return polygon([(0, 0), (length, -half), (length, half)])


def dumbbell(neck: float = 0.06, size: float = 20.0, throat: float = 20.0) -> Region:
    """Two squares joined by a throat of width `neck`."""
    h, w, n, t = size, size / 2, neck / 2, throat / 2
    return polygon(
        [
            (-t - h, -w), (-t, -w), (-t, -n), (t, -n), (t, -w), (t + h, -w),
            (t + h, w), (t, w), (t, n), (-t, n), (-t, w), (-t - h, w),
        ]
    )  # fmt: skip


def islands_grid(columns: int = 3, rows: int = 2, pitch: float = 15.0, side: float = 5.0) -> Region:
    """Rectangle with a grid of square islands, turned a little against each other."""
    corner = polar(side / np.sqrt(2), np.pi / 4 + np.pi / 2 * np.arange(4))
    islands = []
    for index in range(columns * rows):
        angle = 0.13 * index
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        place = (pitch * (index % columns + 0.5), pitch * (index // columns + 0.5))
        islands.append(corner @ turn + place)
    x, y = columns * pitch, rows * pitch
    return polygon([(0, 0), (x, 0), (x, y), (0, y)], islands)


def square_frame(outer: float = 40.0, inner: float = 16.0, turn: float = 0.0) -> Region:
    corner = polar(1 / np.sqrt(2), np.pi / 4 + np.pi / 2 * np.arange(4))
    island = polar(1 / np.sqrt(2), turn + np.pi / 4 + np.pi / 2 * np.arange(4))
    return polygon(outer * corner, [inner * island])


def bent_strip(turn: float, length: float = 20.0, width: float = 10.0) -> Region:
    """Strip whose lower wall turns by `turn` radians in its middle: a nearly tangent junction."""
    far = length * np.array([1 + np.cos(turn), np.sin(turn)])
    return polygon([(0, 0), (length, 0), far, far + np.array([0, width]), (0, width)])


# -- lines and arcs -------------------------------------------------------------------------------


def rounded_rectangle(width: float = 40.0, height: float = 24.0, radius: float = 5.0) -> Region:
    x, y = width / 2, height / 2
    centres = [(x - radius, radius - y), (x - radius, y - radius)]
    centres += [(radius - x, y - radius), (radius - x, radius - y)]
    arcs = [Arc(c, radius, -np.pi / 2 + k * np.pi / 2, np.pi / 2) for k, c in enumerate(centres)]
    curves: list[Curve] = []
    for arc, following in zip(arcs, [*arcs[1:], arcs[0]], strict=True):
        curves.append(arc)
        if np.hypot(*(following.start - arc.end)) > 1e-9:
            curves.append(Line(arc.end, following.start))
    return Region(Loop(tuple(curves)))


def stadium(length: float = 30.0, radius: float = 8.0) -> Region:
    return rounded_rectangle(length + 2 * radius, 2 * radius, radius)


def circle(radius: float = 10.0, parts: int = 1, centre: ArrayLike = (3.0, -2.0)) -> Region:
    return Region(circle_loop(centre, radius, parts))


def annulus(outer: float = 20.0, inner: float = 8.0, shift: float = 0.0) -> Region:
    return Region(circle_loop((0, 0), outer), (circle_loop((shift, 0), inner),))


def teardrop(radius: float = 10.0, reach: float = 25.0, notch: float = 4.0) -> Region:
    """Round head with a pointed tail, and a reflex notch in the head."""
    half = np.arccos(radius / reach)
    left = np.pi - 0.2
    first = Arc((0, 0), radius, half, left - half)
    second = Arc((0, 0), radius, TURN - left, left - half)
    tip, dent = np.array([reach, 0.0]), np.array([notch - radius, 0.0])
    return Region(
        Loop(
            (
                Line(tip, first.start),
                first,
                Line(first.end, dent),
                Line(dent, second.start),
                second,
                Line(second.end, tip),
            )
        )
    )


def rounded_slot(decimals: int = 6) -> Region:
    """Bent slot of lines tangent to arcs, all coordinates rounded as a drawing program does."""
    angle = np.radians(37.0)
    along, across = polar(1.0, angle), polar(1.0, angle + np.pi / 2)
    heel, foot = np.array([0.0, 0.0]), np.array([17.3, 0.0])
    tip, radius = heel + 23.7 * along, 4.1
    up = np.array([0.0, radius])
    mark = [
        heel - up, foot - up, foot + np.array([radius, 0.0]), foot + up,
        tip - radius * across, tip + radius * along, tip + radius * across,
        heel + radius * across, heel - radius * polar(1.0, angle / 2),
    ]  # fmt: skip
    p = [np.round(point, decimals) for point in mark]
    corner = np.round(_meeting(foot + up, (-1, 0), tip - radius * across, -along), decimals)
    return Region(
        Loop(
            (
                Line(p[0], p[1]),
                Arc.from_three_points(p[1], p[2], p[3]),
                Line(p[3], corner),
                Line(corner, p[4]),
                Arc.from_three_points(p[4], p[5], p[6]),
                Line(p[6], p[7]),
                Arc.from_three_points(p[7], p[8], p[0]),
            )
        )
    )


def _meeting(first: ArrayLike, along: ArrayLike, second: ArrayLike, other: ArrayLike) -> FloatArray:
    """Where two lines meet."""
    p, d, q, e = (np.asarray(value, dtype=np.float64) for value in (first, along, second, other))
    share = np.linalg.solve(np.stack([d, -e], axis=1), q - p)[0]
    return np.asarray(p + share * d)


def rounded_polygon(corners: int = 7, seed: int = 3, decimals: int = 6) -> Region:
    """Irregular polygon with filleted corners; ends of lines and arcs rounded to decimals."""
    draw = np.random.default_rng(seed)
    angle = TURN * (np.arange(corners) + draw.uniform(-0.2, 0.2, corners)) / corners
    points = polar(draw.uniform(15, 30, corners), angle)
    curves: list[Curve] = []
    rounded: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for index, point in enumerate(points):
        back = points[index - 1] - point
        ahead = points[(index + 1) % corners] - point
        back, ahead = back / np.hypot(*back), ahead / np.hypot(*ahead)
        half = 0.5 * np.arccos(np.clip(back @ ahead, -1, 1))
        radius = draw.uniform(1.0, 3.0)
        reach = radius / np.tan(half)
        bisector = (back + ahead) / np.hypot(*(back + ahead))
        middle = point + bisector * (radius / np.sin(half) - radius)
        marks = (point + reach * back, middle, point + reach * ahead)
        rounded.append(tuple(np.round(mark, decimals) for mark in marks))  # type: ignore[arg-type]
    for marks, following in zip(rounded, [*rounded[1:], rounded[0]], strict=True):
        curves.append(Arc.from_three_points(*marks))
        curves.append(Line(marks[2], following[0]))
    return Region(Loop(tuple(curves)))


# -- free-form ------------------------------------------------------------------------------------


def ellipse(major: float = 30.0, minor: float = 18.0, parts: int = 1) -> Region:
    step = TURN / parts
    arcs = [EllipticalArc((0, 0), (major, 0), (0, minor), k * step, step) for k in range(parts)]
    return Region(Loop(tuple(arcs)))


def blob(seed: int, points: int = 14, size: float = 45.0, wobble: float = 0.35) -> Region:
    """Random periodic cubic spline about the origin."""
    return Region(_blob_loop(seed, points, size, wobble))


def _blob_loop(
    seed: int, points: int, size: float, wobble: float, centre: ArrayLike = (0.0, 0.0)
) -> Loop:
    draw = np.random.default_rng(seed)
    angle = TURN * (np.arange(points) + draw.uniform(-0.25, 0.25, points)) / points
    radius = size * (1 + draw.uniform(-wobble, wobble, points))
    return spline_loop(polar(radius, angle) + np.asarray(centre, dtype=np.float64))


def blob_with_islands(seed: int, points: int = 18, islands: int = 2, size: float = 45.0) -> Region:
    """Random spline with small spline islands near its middle."""
    outer = _blob_loop(seed, points, size, 0.25)
    inner = [
        _blob_loop(
            1000 * seed + k, 7, 0.13 * size, 0.3, polar(0.36 * size, 0.4 + TURN * k / islands)
        )
        for k in range(islands)
    ]
    return Region(outer, tuple(inner))


def hand(fingers: int = 5) -> Region:
    """Spline hand: long fingers on a palm."""
    marks: list[tuple[float, float]] = [(0.55, -1.2), (0.6, -0.4)]
    points = [polar(30.0 * r, a) for r, a in marks]
    for finger in range(fingers):
        angle = 0.25 + 2.6 * finger / (fingers - 1)
        length = 52.0 + 10.0 * np.sin(np.pi * finger / (fingers - 1))
        for side, reach in ((-0.13, 28.0), (-0.085, 44.0), (0.0, length), (0.085, 44.0)):
            points.append(polar(reach, angle + side))
        points.append(polar(27.0, angle + 0.15))
    points += [polar(22.0, 3.7), polar(26.0, 4.4), polar(24.0, 4.75)]
    return Region(spline_loop(np.array(points)))


def letter_d(height: float = 20.0) -> Region:
    """Stem and bowl: lines and quadratic Beziers, sharp corners, one counter."""
    return Region(_bowl(0.0, 1.0, height), (_bowl(0.18, 0.72, height),))


def _bowl(inset: float, scale: float, height: float) -> Loop:
    top, right = height * (1 - 0.16 * bool(inset)), height * 0.75 * scale + inset * 2
    bottom, left = 0.16 * height * bool(inset), height * inset
    middle, waist = 0.5 * (top + bottom), left + 0.45 * (right - left)
    shoulder = 0.5 * (waist + right)
    upper, lower = middle + 0.55 * (top - middle), middle - 0.55 * (top - middle)
    return Loop(
        (
            Line((left, bottom), (waist, bottom)),
            Bezier([(waist, bottom), (shoulder + 0.7, bottom), (right, lower)]),
            Bezier([(right, lower), (right + 0.5, middle), (right, upper)]),
            Bezier([(right, upper), (shoulder + 0.7, top), (waist, top)]),
            Line((waist, top), (left, top)),
            Line((left, top), (left, bottom)),
        )
    )


def letter_s(height: float = 30.0) -> Region:
    """Double bend of constant-looking width from quadratic Beziers, with square ends."""
    t = np.linspace(0, 1, 7)
    spine = np.stack([0.3 * height * np.sin(TURN * t), height * (t - 0.5)], axis=1)
    slope = np.stack([0.3 * height * TURN * np.cos(TURN * t), np.full(7, height)], axis=1)
    normal = np.stack([-slope[:, 1], slope[:, 0]], axis=1) / np.hypot(*slope.T)[:, None]
    width = 0.06 * height
    sides = []
    for sign in (-1.0, 1.0):
        edge = spine + sign * width * normal
        pieces: list[Curve] = []
        for k in range(6):
            middle = _meeting(edge[k], slope[k], edge[k + 1], slope[k + 1])
            pieces.append(Bezier(np.array([edge[k], middle, edge[k + 1]])))
        sides.append(pieces)
    back: list[Curve] = [piece.reversed() for piece in reversed(sides[1])]
    curves = [*sides[0], Line(sides[0][-1].end, back[0].start), *back]
    curves.append(Line(back[-1].end, sides[0][0].start))
    return Region(Loop(tuple(curves)))


def letter_e(height: float = 24.0) -> Region:
    """Three bars on a stem, their ends cut by quadratic Beziers that bulge and dip."""
    h, bar = height, height / 6
    return Region(
        Loop(
            (
                Line((0, 0), (0.6 * h, 0)),
                Bezier([(0.6 * h, 0), (0.7 * h, bar / 2), (0.6 * h, bar)]),
                Line((0.6 * h, bar), (bar, bar)),
                Line((bar, bar), (bar, 2.5 * bar)),
                Line((bar, 2.5 * bar), (0.5 * h, 2.5 * bar)),
                Bezier([(0.5 * h, 2.5 * bar), (0.42 * h, 3 * bar), (0.5 * h, 3.5 * bar)]),
                Line((0.5 * h, 3.5 * bar), (bar, 3.5 * bar)),
                Line((bar, 3.5 * bar), (bar, 5 * bar)),
                Line((bar, 5 * bar), (0.6 * h, 5 * bar)),
                Bezier([(0.6 * h, 5 * bar), (0.7 * h, 5.5 * bar), (0.6 * h, 6 * bar)]),
                Line((0.6 * h, 6 * bar), (0, 6 * bar)),
                Line((0, 6 * bar), (0, 0)),
            )
        )
    )


def quadratic_loop(marks: ArrayLike) -> Loop:
    """Quadratic Beziers about a control polygon, joined in the middles of its sides.

    Tangent-continuous, with jumps of curvature, as the outlines of glyphs are.
    """
    control = np.asarray(marks, dtype=np.float64)
    before = 0.5 * (np.roll(control, 1, axis=0) + control)
    after = np.roll(before, -1, axis=0)
    pieces = zip(before, control, after, strict=True)
    return Loop(tuple(Bezier(np.array(piece)) for piece in pieces))


def letter_o(height: float = 20.0) -> Region:
    """Slanted ring of varying width."""
    angle = 0.3 + TURN * np.arange(9) / 9
    outer = polar(0.55 * height, angle) * (0.8, 1.0)
    inner = polar(0.36 * height, angle) * (0.62, 0.9) + (0.02 * height, 0.01 * height)
    return Region(quadratic_loop(outer), (quadratic_loop(inner),))


def comma(height: float = 20.0) -> Region:
    """Head and bent tail, quadratic throughout."""
    marks = [(3, 0), (8, 1), (9, 6), (5, 9), (0, 8), (-2, 4), (1, 1), (2, -3), (-2, -8), (0, -9)]
    marks += [(5, -6)]
    return Region(quadratic_loop(0.055 * height * np.array(marks, dtype=np.float64)))


def bent_spline(turn: float) -> Region:
    """Lens of two cubics whose left junction turns by `turn` radians off tangency."""
    first = np.array([(0.0, -1.0), (0.0, -9.0), (25.0, -12.0), (30.0, -1.0)])
    second = np.array([(30.0, -1.0), (33.0, 9.0), (0.0, 13.0), (0.0, -1.0)])
    angle = -np.pi / 2 + turn
    first[1] = first[0] + 8.0 * np.array([np.cos(angle), np.sin(angle)])
    return Region(Loop((Bezier(first), Bezier(second))))


# -- sets -----------------------------------------------------------------------------------------


def moved(
    region: Region, angle: float = 0.0, shift: ArrayLike = (0, 0), scale: float = 1
) -> Region:
    """Image under a similarity: scaled and turned about the origin, then shifted."""
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    x, y = np.asarray(shift, dtype=np.float64)
    return region.transformed(np.array([[c, -s, x], [s, c, y]]))


SIMPLE: dict[str, Callable[[], Region]] = {
    "rectangle": rectangle,
    "square": square,
    "ell": ell,
    "tee": tee,
    "cross": cross,
    "comb": comb,
    "triangle": lambda: regular_polygon(3),
    "hexagon": lambda: regular_polygon(6),
    "inscribed-9": lambda: irregular_inscribed(9),
    "inscribed-24": lambda: irregular_inscribed(24),
    "star-5": lambda: star(5),
    "star-9": lambda: star(9),
    "needle": needle,
    "dumbbell": dumbbell,
    "islands-grid": islands_grid,
    "square-frame": square_frame,
    "square-frame-turned": lambda: square_frame(turn=0.4),
    "rounded-rectangle": rounded_rectangle,
    "stadium": stadium,
    "annulus-eccentric": lambda: annulus(shift=5.0),
    "teardrop": teardrop,
    "rounded-slot": rounded_slot,
    "rounded-polygon": rounded_polygon,
}

FREE: dict[str, Callable[[], Region]] = {
    "ellipse": ellipse,
    "ellipse-flat": lambda: ellipse(30.0, 3.0),
    "blob-1": lambda: blob(1),
    "blob-2": lambda: blob(2, 22),
    "blob-islands": lambda: blob_with_islands(8, 14, 2),
    "hand": hand,
    "letter-d": letter_d,
    "letter-s": letter_s,
    "letter-e": letter_e,
    "letter-o": letter_o,
    "comma": comma,
}

BENT: dict[str, Callable[[], Region]] = {
    f"{name}{turn:+.0e}": lambda make=make, turn=turn: make(turn)  # type: ignore[misc]
    for name, make, sizes in (
        ("strip", bent_strip, (1e-7, 1e-5, 1e-3, 1e-2)),
        ("lens", bent_spline, (1e-5, 1e-2)),
    )
    for size in sizes
    for turn in (size, -size)
}

PLACED: dict[str, Callable[[], Region]] = {
    "comma-at-1e6": lambda: moved(comma(), 0.3, (1e6, -9.3e5)),
    "ell-at-1e6": lambda: moved(ell(), 0.3, (1e6, -9.3e5)),
    "rounded-at-1e6": lambda: moved(rounded_rectangle(), 0.3, (1e6, -9.3e5)),
    "blob-1e-3": lambda: moved(blob(1, 8, 1.0), scale=1e-3),
    "ell-1e-3": lambda: moved(ell(), scale=1e-3 / 30),
    "comma-1e5": lambda: moved(comma(1.0), scale=1e5),
    "star-1e5": lambda: moved(star(5), scale=1e5 / 20),
}

EVERY: dict[str, Callable[[], Region]] = {
    **SIMPLE, **FREE, **BENT, **PLACED, "circle": circle,
    "circle-parts": lambda: circle(parts=3), "annulus": annulus,
}  # fmt: skip
