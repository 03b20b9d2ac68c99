"""Closed outlines that benchmarks are made of: polygons, fillets, splines, glyphs, gears; in mm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import ConvexHull

from grassfire.geometry import Arc, Bezier, BSpline, Curve, Line, Loop

FloatArray = NDArray[np.float64]
Random = np.random.Generator
TURN = 2.0 * np.pi
ORIGIN = np.zeros(2)


def polar(radius: ArrayLike, angle: ArrayLike) -> FloatArray:
    """Points (..., 2) of polar coordinates."""
    distance, direction = np.broadcast_arrays(np.asarray(radius, float), np.asarray(angle, float))
    return np.stack([distance * np.cos(direction), distance * np.sin(direction)], axis=-1)


def uneven_angles(draw: Random, count: int, wobble: float = 0.3) -> FloatArray:
    """Ascending angles of one turn, uneven by a share of their step."""
    return TURN * (np.arange(count) + draw.uniform(-wobble, wobble, count)) / count


def polygon_loop(points: ArrayLike) -> Loop:
    """Closed polygon through the points (n, 2)."""
    corners = np.asarray(points, dtype=np.float64)
    following = np.roll(corners, -1, axis=0)
    return Loop(tuple(Line(a, b) for a, b in zip(corners, following, strict=True)))


def circle_loop(centre: ArrayLike, radius: float, parts: int = 1, phase: float = 0.0) -> Loop:
    """Circle of equal arcs."""
    step, middle = TURN / parts, np.asarray(centre, dtype=np.float64)
    return Loop(tuple(Arc(middle, radius, phase + k * step, step) for k in range(parts)))


# -- points of simple polygons --------------------------------------------------------------------


def convex_points(draw: Random, count: int, size: float) -> FloatArray:
    """Hull of random points."""
    cloud = draw.normal(size=(count, 2)) * size * draw.uniform(0.3, 1.0, 2)
    return np.asarray(cloud[ConvexHull(cloud).vertices])


def star_points(draw: Random, count: int, size: float, least: float = 0.3) -> FloatArray:
    """Star-shaped about the origin, with random radii."""
    return polar(size * draw.uniform(least, 1.0, count), uneven_angles(draw, count))


def untangled_points(draw: Random, count: int, size: float) -> FloatArray:
    """Simple polygon through random points: crossings of a random tour are undone (2-opt)."""
    tour = draw.uniform(-size, size, (count, 2))
    while True:
        pair = first_crossing(tour)
        if pair is None:
            return tour
        first, second = pair
        tour[first + 1 : second + 1] = tour[first + 1 : second + 1][::-1].copy()


def first_crossing(tour: FloatArray) -> tuple[int, int] | None:
    """Numbers of two edges of a closed polygon that cross each other."""
    begin, end = tour, np.roll(tour, -1, axis=0)

    def side(points: FloatArray) -> FloatArray:
        along = end - begin
        away = points[None] - begin[:, None]
        return np.asarray(along[:, None, 0] * away[..., 1] - along[:, None, 1] * away[..., 0])

    apart = side(begin) * side(end) < 0
    rows, columns = np.nonzero(np.triu(apart & apart.T, 1))
    return (int(rows[0]), int(columns[0])) if len(rows) else None


def comb_points(draw: Random, teeth: int, size: float) -> FloatArray:
    """Back with teeth of random widths, gaps and lengths."""
    width, gap = draw.uniform(0.3, 1.0, teeth), draw.uniform(0.2, 1.0, teeth - 1)
    length = draw.uniform(0.5, 3.0, teeth)
    points, place = [(0.0, -draw.uniform(0.3, 2.0))], 0.0
    for tooth in range(teeth):
        points += [(place, length[tooth]), (place + width[tooth], length[tooth])]
        place += width[tooth]
        if tooth < teeth - 1:
            points += [(place, 0.0), (place + gap[tooth], 0.0)]
            place += gap[tooth]
    points.append((place, points[0][1]))
    return np.array(points)[::-1] * size / place


# -- curves along points --------------------------------------------------------------------------


def interpolating_loop(points: ArrayLike) -> Loop:
    """Periodic cubic spline through the points, centripetal, one Bezier curve a span."""
    given = np.asarray(points, dtype=np.float64)
    closed = np.concatenate([given, given[:1]])
    knots = np.concatenate([[0.0], np.cumsum(np.sqrt(np.hypot(*np.diff(closed, axis=0).T)))])
    slope = CubicSpline(knots, closed, bc_type="periodic")(knots, 1)
    pieces = []
    for index, width in enumerate(np.diff(knots)):
        first, last = closed[index], closed[index + 1]
        handles = first + slope[index] * width / 3, last - slope[index + 1] * width / 3
        pieces.append(Bezier(np.array([first, *handles, last])))
    return Loop(tuple(pieces))


def bspline_loop(control: ArrayLike, whole: bool = False) -> Loop:
    """Uniform periodic cubic B-spline: one curve, or one Bezier curve a span."""
    points = np.asarray(control, dtype=np.float64)
    count = len(points)
    curve = BSpline(3, np.arange(count + 7, dtype=np.float64), np.concatenate([points, points[:3]]))
    return Loop((curve,) if whole else curve.to_beziers())


def quadratic_loop(marks: ArrayLike) -> Loop:
    """Quadratic Beziers about a control polygon, joined in the middles of its sides: G1."""
    control = np.asarray(marks, dtype=np.float64)
    before = 0.5 * (np.roll(control, 1, axis=0) + control)
    pieces = zip(before, control, np.roll(before, -1, axis=0), strict=True)
    return Loop(tuple(Bezier(np.array(piece)) for piece in pieces))


def filleted_loop(points: ArrayLike, radii: ArrayLike) -> Loop:
    """Polygon with corners rounded by arcs tangent to its sides; radius 0 leaves a corner.

    A radius is cut down where the sides have no room for it: neighbours share a side by halves.
    """
    corner = np.asarray(points, dtype=np.float64)
    count = len(corner)
    wanted = np.broadcast_to(np.asarray(radii, dtype=np.float64), (count,))
    ahead = np.roll(corner, -1, axis=0) - corner
    side = np.hypot(*ahead.T)
    ahead = ahead / side[:, None]
    behind = np.roll(ahead, 1, axis=0)
    turn = np.arctan2(
        behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0], np.sum(behind * ahead, axis=1)
    )
    slope = np.tan(np.abs(turn) / 2)
    room = 0.49 * np.minimum(side, np.roll(side, 1))
    radius = np.minimum(wanted, room / np.maximum(slope, 1e-12))
    reach = radius * slope
    curves: list[Curve] = []
    for k in range(count):
        if reach[k] > 0:
            sign = np.sign(turn[k])
            left = np.array([-behind[k, 1], behind[k, 0]])
            start = corner[k] - reach[k] * behind[k]
            spoke = -sign * left
            centre = start - radius[k] * spoke
            curves.append(Arc(centre, radius[k], float(np.arctan2(*spoke[::-1])), float(turn[k])))
        after = (k + 1) % count
        curves.append(
            Line(corner[k] + reach[k] * ahead[k], corner[after] - reach[after] * ahead[k])
        )
    return Loop(tuple(curves))


def bulged_loop(points: ArrayLike, bulges: ArrayLike) -> Loop:
    """Polygon whose sides are arcs of given bulge, tan(sweep / 4); 0 is a line."""
    corner = np.asarray(points, dtype=np.float64)
    curves: list[Curve] = []
    for first, last, bulge in zip(
        corner, np.roll(corner, -1, axis=0), np.asarray(bulges, dtype=np.float64), strict=True
    ):
        curves.append(Arc.from_bulge(first, last, float(bulge)) if bulge else Line(first, last))
    return Loop(tuple(curves))


def bent_loop(points: ArrayLike, heights: ArrayLike) -> Loop:
    """Polygon whose sides are cubics that leave the chord by (n, 2) shares of it at its thirds."""
    corner = np.asarray(points, dtype=np.float64)
    curves = []
    for first, last, rise in zip(
        corner, np.roll(corner, -1, axis=0), np.asarray(heights, dtype=np.float64), strict=True
    ):
        chord = last - first
        left = np.array([-chord[1], chord[0]])
        middle = [
            first + share * chord + h * left for share, h in zip((1 / 3, 2 / 3), rise, strict=True)
        ]
        curves.append(Bezier(np.array([first, *middle, last])))
    return Loop(tuple(curves))


def blob_loop(
    draw: Random, points: int, size: float, wobble: float, centre: ArrayLike = (0.0, 0.0)
) -> Loop:
    """Periodic cubic spline through points about a centre, with random radii."""
    radius = size * (1 + draw.uniform(-wobble, wobble, points))
    marks = polar(radius, uneven_angles(draw, points, 0.25))
    return interpolating_loop(marks + np.asarray(centre, dtype=np.float64))


def capsule_loop(first: ArrayLike, last: ArrayLike, radius: float) -> Loop:
    """Slot between two points: lines and half circles."""
    begin, end = np.asarray(first, dtype=np.float64), np.asarray(last, dtype=np.float64)
    along = (end - begin) / np.hypot(*(end - begin))
    angle = float(np.arctan2(along[1], along[0]))
    left = radius * np.array([-along[1], along[0]])
    return Loop(
        (
            Line(begin - left, end - left),
            Arc(end, radius, angle - np.pi / 2, np.pi),
            Line(end + left, begin + left),
            Arc(begin, radius, angle + np.pi / 2, np.pi),
        )
    )


def bent_slot_loop(radius: float, half_width: float, sweep: float) -> Loop:
    """Slot along an arc about the origin, with round ends: walls are concentric arcs."""
    ends = polar(radius, [0.0, sweep])
    return Loop(
        (
            Arc(ORIGIN, radius + half_width, 0.0, sweep),
            Arc(ends[1], half_width, sweep, np.pi),
            Arc(ORIGIN, radius - half_width, sweep, -sweep),
            Arc(ends[0], half_width, np.pi, np.pi),
        )
    )


def gear_loop(teeth: int, root: float, tip: float, share: float, flank: float) -> Loop:
    """Teeth of arcs about the origin joined by straight flanks.

    `share` of the pitch is tooth at the root; a tooth is narrower by `flank` of the pitch at its
    tip on each side.
    """
    pitch = TURN / teeth
    curves: list[Curve] = []
    for tooth in range(teeth):
        begin = tooth * pitch
        low = begin + pitch * (1 - share)
        rise, fall = low + pitch * flank, begin + pitch * (1 - flank)
        marks = polar([root, tip, tip, root], [low, rise, fall, begin + pitch])
        curves.append(Arc(ORIGIN, root, begin, low - begin))
        curves.append(Line(marks[0], marks[1]))
        curves.append(Arc(ORIGIN, tip, rise, fall - rise))
        curves.append(Line(marks[2], marks[3]))
    return Loop(tuple(curves))


def glyph_loops(character: str, bold: bool, height: float) -> list[Loop]:
    """Outlines of a letter of the font that comes with matplotlib."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.path import Path as Outline
    from matplotlib.textpath import TextPath

    font = FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
    outline = TextPath((0.0, 0.0), character, size=height, prop=font)
    loops: list[Loop] = []
    curves: list[Curve] = []
    pen = start = np.zeros(2)
    for marks, code in outline.iter_segments(simplify=False, curves=True):
        mark = np.asarray(marks, dtype=np.float64).reshape(-1, 2)
        if code == Outline.MOVETO:
            pen = start = mark[0]
            curves = []
        elif code == Outline.CLOSEPOLY:
            curves += side_pieces(pen, start[None])
            if curves:
                loops.append(Loop(tuple(curves)))
        else:
            curves += side_pieces(pen, mark)
            pen = mark[-1]
    return loops


def side_pieces(pen: FloatArray, marks: FloatArray) -> Sequence[Curve]:
    """Line or Bezier curve from the pen; nothing where it has no length."""
    points = np.concatenate([pen[None], marks])
    if np.hypot(*np.ptp(points, axis=0)) <= 1e-9:
        return []
    return [Line(pen, marks[0]) if len(marks) == 1 else Bezier(points)]
