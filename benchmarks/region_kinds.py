"""Seeded random regions of many kinds: `region(kind, seed)`; lengths in mm.

Each generator draws from one random stream; a draw whose outline crosses itself is drawn again, so
that the same kind and seed always give the same simple region.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence

import numpy as np
import outlines as make
import shapely
from numpy.typing import ArrayLike
from outlines import TURN, FloatArray, Random, polar
from pockets import round_rooms

from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Bezier, Curve, EllipticalArc, Line, Loop, Region, flatten

Generator = Callable[[Random], Region]
LETTERS = "ABCDEFGHKLMNOPQRSTUVWXYZabcdefghkmnopqrstuvwxyz0123456789&@%$#?"


def region(kind: str, seed: int) -> Region:
    """The region of a kind and a seed, simple by construction or by trial."""
    draw = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    for _ in range(200):
        try:
            candidate = KINDS[kind](draw)
        except GeometryError:
            continue
        if simple(candidate):
            return candidate
    raise ValueError(f"no simple region of kind {kind} with seed {seed}")


def simple(candidate: Region) -> bool:
    """Whether the outlines neither cross nor touch, judged on chords so fine that they show what
    crosses next to corners of half a degree."""
    xmin, ymin, xmax, ymax = candidate.bounds()
    size = float(np.hypot(xmax - xmin, ymax - ymin))
    chord, gap = 1e-7 * size, 8e-6 * size
    rings = []
    for loop in candidate.loops:
        if all(isinstance(curve, Line) for curve in loop.curves):
            ring = np.array([curve.start for curve in loop.curves])
        else:
            ring = flatten(loop, chord)
        rings.append(ring)
    outline = shapely.Polygon(rings[0], rings[1:])
    if not outline.is_valid:
        return False
    ring = outline.exterior
    return all(ring.distance(hole) > gap for hole in outline.interiors) and apart(
        outline.interiors, gap
    )


def apart(holes: Sequence[shapely.LinearRing], gap: float) -> bool:
    """Whether no two holes come closer than the gap."""
    if len(holes) < 2:
        return True
    first, second = shapely.STRtree(holes).query(holes, predicate="dwithin", distance=gap)
    return bool(np.all(first == second))


def moved(given: Region, angle: float = 0.0, shift: ArrayLike = (0, 0), scale: float = 1) -> Region:
    """Image under a similarity: scaled and turned about the origin, then shifted."""
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    x, y = np.asarray(shift, dtype=np.float64)
    return given.transformed(np.array([[c, -s, x], [s, c, y]]))


def scattered(
    draw: Random, count: int, radius: float, least: float, most: float
) -> list[tuple[FloatArray, float]]:
    """Up to `count` disks (centre, radius) apart from each other inside a disk at the origin."""
    places: list[tuple[FloatArray, float]] = []
    for _ in range(60 * count):
        if len(places) == count:
            break
        size = draw.uniform(least, most)
        centre = polar((radius - 1.1 * size) * np.sqrt(draw.uniform()), draw.uniform(0, TURN))
        if all(np.hypot(*(centre - c)) > 1.1 * (size + s) for c, s in places):
            places.append((centre, size))
    return places


def small_loop(draw: Random, centre: FloatArray, size: float) -> Loop:
    """Square, triangle, circle, slot, blob or star inside the disk of a radius."""
    choice, phase = int(draw.integers(6)), draw.uniform(0, TURN)
    if choice == 0:
        count = int(draw.integers(3, 7))
        return make.polygon_loop(centre + polar(size, phase + TURN * np.arange(count) / count))
    if choice == 1:
        return make.circle_loop(centre, size, int(draw.integers(1, 4)), phase)
    if choice == 2:
        along = polar(0.6 * size, phase)
        return make.capsule_loop(centre - along, centre + along, 0.35 * size)
    if choice == 3:
        return make.blob_loop(draw, int(draw.integers(6, 10)), 0.7 * size, 0.2, centre)
    if choice == 4:
        count = 2 * int(draw.integers(3, 7))
        radius = np.where(np.arange(count) % 2, 0.5 * size, size)
        return make.polygon_loop(centre + polar(radius, phase + TURN * np.arange(count) / count))
    corner = centre + polar(size, phase + np.array([0.0, 1.2, np.pi, np.pi + 1.2]))
    return make.filleted_loop(corner, 0.2 * size)


# -- free-form ------------------------------------------------------------------------------------


def spline(draw: Random) -> Region:
    """Smooth periodic cubic B-spline of 12 to 100 pieces, as one curve or as Beziers."""
    count = int(draw.integers(12, 101))
    angle = make.uneven_angles(draw, count, 0.2)
    radius = np.ones(count)
    for wave in range(2, int(draw.integers(4, 8))):
        radius += draw.uniform(0, 0.9) / wave * np.cos(wave * angle + draw.uniform(0, TURN))
    radius = np.maximum(radius, 0.3) * (1 + draw.uniform(-0.5, 0.5, count) / np.sqrt(count))
    return Region(make.bspline_loop(polar(40 * radius, angle), bool(draw.integers(2))))


def spline_islands(draw: Random) -> Region:
    """Spline with one to three spline islands."""
    outer = make.blob_loop(draw, int(draw.integers(12, 40)), 45.0, 0.2)
    places = scattered(draw, int(draw.integers(1, 4)), 30.0, 4.0, 12.0)
    islands = [make.blob_loop(draw, int(draw.integers(6, 14)), 0.75 * s, 0.3, c) for c, s in places]
    return Region(outer, tuple(islands))


def blob(draw: Random) -> Region:
    """Star-shaped interpolating spline with deep bays."""
    return Region(
        make.blob_loop(draw, int(draw.integers(10, 36)), 40.0, float(draw.uniform(0.1, 0.6)))
    )


def flower(draw: Random) -> Region:
    """Spline with the symmetry of a regular polygon: a branch point of high degree."""
    petals = int(draw.integers(3, 10))
    count = petals * 2 * int(draw.integers(2, 6))
    angle = TURN * np.arange(count) / count
    radius = 30 * (1 + draw.uniform(0.05, 0.35) * np.cos(petals * angle))
    return Region(make.bspline_loop(polar(radius, angle + draw.uniform(0, 1))))


def ellipse(draw: Random) -> Region:
    """Ellipse of one to four pieces, at times with an elliptical or round island."""
    minor, parts = float(np.exp(draw.uniform(np.log(1.0), np.log(29.9)))), int(draw.integers(1, 5))
    loop = ellipse_loop(make.ORIGIN, 30.0, minor, draw.uniform(0, TURN), parts)
    if draw.uniform() < 0.7:
        return Region(loop)
    size = 0.5 * minor
    island = ellipse_loop(
        polar(0.2 * minor, draw.uniform(0, TURN)), size, size * draw.uniform(0.2, 1), 0.4, 1
    )
    return Region(loop, (island,))


def ellipse_loop(centre: FloatArray, major: float, minor: float, angle: float, parts: int) -> Loop:
    """Ellipse turned by an angle, of equal pieces."""
    first, second, step = polar(major, angle), polar(minor, angle + np.pi / 2), TURN / parts
    return Loop(tuple(EllipticalArc(centre, first, second, k * step, step) for k in range(parts)))


def quadratics(draw: Random) -> Region:
    """Quadratic Beziers joined G1, with jumps of curvature, and a counter in some."""
    count = int(draw.integers(6, 24))
    angle = make.uneven_angles(draw, count)
    radius = draw.uniform(0.5, 1.0, count)
    outer = make.quadratic_loop(polar(30 * radius, angle))
    if draw.uniform() < 0.5:
        return Region(outer)
    return Region(outer, (make.quadratic_loop(polar(9 * draw.uniform(0.5, 1, count), angle)),))


def glyph(draw: Random) -> Region:
    """Letter of a font: lines and quadratic Beziers, with corners and counters."""
    character = LETTERS[int(draw.integers(len(LETTERS)))]
    loops = make.glyph_loops(character, bool(draw.integers(2)), float(draw.uniform(5, 60)))
    areas = [abs(loop.area) for loop in loops]
    outer = loops[int(np.argmax(areas))]
    body = Region(outer)
    inside = [
        loop for loop in loops if loop is not outer and body.contains(loop.point([0.5])).all()
    ]
    return Region(outer, tuple(inside))


# -- polygons -------------------------------------------------------------------------------------


def convex(draw: Random) -> Region:
    """Convex polygon."""
    return Region(make.polygon_loop(make.convex_points(draw, int(draw.integers(5, 200)), 20.0)))


def star(draw: Random) -> Region:
    """Star-shaped polygon of random radii."""
    count = int(draw.integers(5, 80))
    return Region(make.polygon_loop(make.star_points(draw, count, 40.0, draw.uniform(0.05, 0.8))))


def tangle(draw: Random) -> Region:
    """Simple polygon through random points, with acute corners and thin arms."""
    return Region(make.polygon_loop(make.untangled_points(draw, int(draw.integers(5, 45)), 40.0)))


def comb(draw: Random) -> Region:
    """Comb of random teeth, turned; its walls are parallel."""
    loop = make.polygon_loop(make.comb_points(draw, int(draw.integers(3, 20)), 60.0))
    return moved(Region(loop), draw.uniform(0, TURN) * draw.integers(2))


def holed(draw: Random) -> Region:
    """Polygon with polygonal islands."""
    outer = make.polygon_loop(make.star_points(draw, int(draw.integers(8, 40)), 50.0, 0.7))
    islands = []
    for centre, size in scattered(draw, int(draw.integers(1, 9)), 32.0, 2.0, 9.0):
        points = make.star_points(draw, int(draw.integers(4, 12)), size)
        islands.append(make.polygon_loop(points + centre))
    return Region(outer, tuple(islands))


def rectilinear(draw: Random) -> Region:
    """Rectangle, L, T, cross, frame or staircase on a grid: co-circular contacts."""
    width, height, arm = (int(value) for value in draw.integers(2, 9, 3))
    shapes: list[ArrayLike] = [
        [(0, 0), (width, 0), (width, height), (0, height)],
        [(0, 0), (width + arm, 0), (width + arm, arm), (arm, arm), (arm, height + arm),
         (0, height + arm)],
        [(-width - 1, 0), (width + 1, 0), (width + 1, arm), (1, arm), (1, arm + height),
         (-1, arm + height), (-1, arm), (-width - 1, arm)],
        [(arm, -1), (arm, 1), (1, 1), (1, arm), (-1, arm), (-1, 1), (-arm, 1), (-arm, -1),
         (-1, -1), (-1, -arm), (1, -arm), (1, -1)],
        [(0, 0), (6, 0), (6, 1), (5, 1), (5, 2), (4, 2), (4, 3), (3, 3), (3, 4), (0, 4)],
        [(0, 0), (width + 2, 0), (width + 2, height), (width + 1, height), (width + 1, 1),
         (1, 1), (1, height), (0, height)],
    ]  # fmt: skip
    choice = int(draw.integers(len(shapes) + 1))
    turn, scale = draw.choice([0.0, np.pi / 4, draw.uniform(0, TURN)]), draw.uniform(1, 10)
    if choice == len(shapes):
        hole = make.polygon_loop(np.array([(1, 1), (width + 1, 1), (width + 1, 3), (1, 3)]))
        frame = [(0, 0), (width + 2, 0), (width + 2, 4), (0, 4)]
        return moved(Region(make.polygon_loop(frame), (hole,)), turn, scale=scale)
    return moved(Region(make.polygon_loop(shapes[choice])), turn, scale=scale)


def regular(draw: Random) -> Region:
    """Regular polygon or star, plain or with a like island about its centre."""
    count, phase = int(draw.integers(3, 41)), draw.uniform(0, TURN)
    if draw.uniform() < 0.5:
        points = polar(30.0, phase + TURN * np.arange(count) / count)
    else:
        radius = np.where(np.arange(2 * count) % 2, draw.uniform(8, 26), 30.0)
        points = polar(radius, phase + np.pi * np.arange(2 * count) / count)
    outer = make.polygon_loop(points)
    if draw.uniform() < 0.7:
        return Region(outer)
    return Region(outer, (make.polygon_loop(0.2 * points),))


# -- lines and arcs -------------------------------------------------------------------------------


def pocket(draw: Random) -> Region:
    """Polygon with filleted corners (some left sharp) and filleted or round islands."""
    count = int(draw.integers(3, 14))
    corner = make.star_points(draw, count, 50.0, 0.6)
    radius = draw.uniform(1.0, 8.0, count) * (draw.uniform(size=count) < 0.8)
    islands = []
    for centre, size in scattered(draw, int(draw.integers(0, 4)), 24.0, 2.0, 8.0):
        if draw.uniform() < 0.4:
            islands.append(make.circle_loop(centre, size))
        else:
            points = centre + make.star_points(draw, int(draw.integers(3, 7)), size, 0.6)
            islands.append(make.filleted_loop(points, draw.uniform(0.1, 0.4) * size))
    return Region(make.filleted_loop(corner, radius), tuple(islands))


def slot(draw: Random) -> Region:
    """Stadium, bent slot or rounded rectangle: arcs that the largest disks touch all along."""
    choice, phase = int(draw.integers(4)), draw.uniform(0, TURN)
    if choice == 0:
        along = polar(draw.uniform(1, 40), phase)
        return Region(make.capsule_loop(-along, along, draw.uniform(1, 10)))
    if choice == 1:
        radius = draw.uniform(5, 40)
        loop = make.bent_slot_loop(radius, radius * draw.uniform(0.05, 0.8), draw.uniform(0.3, 4))
        return moved(Region(loop), phase)
    x, y = draw.uniform(5, 40), draw.uniform(5, 20)
    corner = [(-x, -y), (x, -y), (x, y), (-x, y)]
    share = draw.choice([0.2, 0.5, 0.999999]) if choice == 2 else draw.uniform(0.1, 0.9, 4)
    return moved(Region(make.filleted_loop(corner, min(x, y) * share)), phase)


def annulus(draw: Random) -> Region:
    """Ring between circles, concentric or not: the axis is a loop."""
    inner = draw.uniform(0.5, 15.0)
    shift = 0.0 if draw.uniform() < 0.3 else 10.0 ** draw.uniform(-9, 0) * (20 - inner) * 0.9
    parts, phase = (int(value) for value in draw.integers(1, 5, 2)), draw.uniform(0, TURN)
    first, second = parts
    island = make.circle_loop(polar(shift, phase), inner, second, phase)
    return moved(Region(make.circle_loop((0, 0), 20.0, first), (island,)), 0.0, polar(5, phase))


def circle(draw: Random) -> Region:
    """Full circle of one to five arcs: the axis is a point."""
    radius = 10.0 ** draw.uniform(-2, 3)
    parts = int(draw.integers(1, 6))
    return Region(make.circle_loop(draw.normal(size=2) * radius, radius, parts, draw.uniform(0, 7)))


def bulged(draw: Random) -> Region:
    """Polygon whose sides are arcs of both signs, some of them lines."""
    count = int(draw.integers(3, 30))
    corner = make.star_points(draw, count, 40.0, 0.5)
    bulge = draw.uniform(-0.4, 0.4, count) * (draw.uniform(size=count) < 0.7)
    return Region(make.bulged_loop(corner, bulge))


def mixed(draw: Random) -> Region:
    """Lines, arcs and cubics joined at corners, with small islands."""
    count = int(draw.integers(4, 24))
    corner = make.star_points(draw, count, 50.0, 0.6)
    arcs = make.bulged_loop(corner, draw.uniform(-0.3, 0.3, count) * draw.integers(0, 2, count))
    cubics = make.bent_loop(corner, draw.uniform(-0.3, 0.3, (count, 2)))
    pick = draw.integers(0, 2, count)
    pairs = zip(arcs.curves, cubics.curves, pick, strict=True)
    outer = Loop(tuple(cubic if choice else arc for arc, cubic, choice in pairs))
    places = scattered(draw, int(draw.integers(0, 4)), 22.0, 2.0, 7.0)
    return Region(outer, tuple(small_loop(draw, c, s) for c, s in places))


def gear(draw: Random) -> Region:
    """Gear of arcs and straight flanks, with a round bore or without."""
    teeth, root = int(draw.integers(5, 30)), draw.uniform(15, 25)
    loop = make.gear_loop(teeth, root, 30.0, draw.uniform(0.4, 0.7), draw.uniform(0.02, 0.15))
    if draw.uniform() < 0.5:
        return Region(loop)
    return Region(loop, (make.circle_loop((0, 0), draw.uniform(2, 0.8 * root)),))


# -- trying places --------------------------------------------------------------------------------


def needle(draw: Random) -> Region:
    """Corners of half a degree to two degrees: wedges, rhombi, stars with thin arms, slits."""
    choice, phase = int(draw.integers(4)), draw.uniform(0, TURN)
    half = np.radians(draw.uniform(0.5, 2.0)) / 2
    length = draw.uniform(10, 100)
    if choice == 0:
        points = np.array(
            [(0, 0), polar(length, -half), polar(length * draw.uniform(0.5, 1), half)]
        )
    elif choice == 1:
        points = length * np.array([(1, 0), (0, np.tan(half)), (-1, 0), (0, -np.tan(half))])
    elif choice == 2:
        count = int(draw.integers(3, 9))
        narrow = length * np.sin(half) / np.sin(half + np.pi / count)
        radius = np.where(np.arange(2 * count) % 2, narrow, length)
        points = polar(radius, np.pi * np.arange(2 * count) / count)
    else:
        deep, mouth = 0.7 * length, 0.7 * length * np.tan(half)
        points = np.array(
            [(0, -20), (length, -20), (length, 20), (0, 20), (0, mouth), (deep, 0), (0, -mouth)]
        )
    return moved(Region(make.polygon_loop(points)), phase)


def neck(draw: Random) -> Region:
    """Rooms joined by channels a thousand times narrower."""
    width = 1e-3 * draw.uniform(10, 30)
    if draw.uniform() < 0.4:
        return moved(two_round_rooms(draw, width), draw.uniform(0, TURN))
    rooms = int(draw.integers(2, 5))
    lower: list[tuple[float, float]] = []
    upper: list[tuple[float, float]] = []
    place = 0.0
    for room in range(rooms):
        below, above, wide = draw.uniform(5, 15, 3)
        lower += [(place, -below), (place + wide, -below)]
        upper += [(place, above), (place + wide, above)]
        place += wide
        if room < rooms - 1:
            length = draw.uniform(0.5, 10)
            lower += [(place, -width / 2), (place + length, -width / 2)]
            upper += [(place, width / 2), (place + length, width / 2)]
            place += length
    corner = np.array(lower + upper[::-1])
    loop = make.polygon_loop(corner)
    if draw.uniform() < 0.5:
        loop = make.filleted_loop(corner, draw.uniform(0.2, 2.0))
    return moved(Region(loop), draw.uniform(0, TURN))


def two_round_rooms(draw: Random, width: float) -> Region:
    """Two circles joined by a straight channel."""
    first, second, gap = draw.uniform(5, 15), draw.uniform(5, 15), draw.uniform(0.5, 10)
    return round_rooms(first, second, width, gap)


def near_tangent(draw: Random) -> Region:
    """Junctions that turn by 1e-12 to 1e-3 radians, either way."""
    turn = 10.0 ** draw.uniform(-12, -3) * draw.choice([-1.0, 1.0])
    choice = int(draw.integers(4))
    if choice == 0:
        far = 20.0 * np.array([1 + np.cos(turn), np.sin(turn)])
        tip = far + np.array([0, 10.0])
        return Region(make.polygon_loop([(0, 0), (20, 0), far, tip, (0, 10.0)]))
    if choice == 1:
        first = np.array([(0.0, -1.0), (0.0, -9.0), (25.0, -12.0), (30.0, -1.0)])
        first[1] = first[0] + polar(8.0, -np.pi / 2 + turn)
        second = Bezier(np.array([(30.0, -1.0), (33.0, 9.0), (0.0, 13.0), (0.0, -1.0)]))
        return Region(Loop((Bezier(first), second)))
    if choice == 2:
        half, radius = draw.uniform(5, 30), draw.uniform(3, 10)
        right, left = np.array([(half, -radius), (half, radius)]), np.array([-half, 0.0])
        rise = np.array([0.0, radius])
        lean = np.tan((np.pi + turn) / 4)
        curves: list[Curve] = [
            Line(left - rise, right[0]),
            Arc.from_bulge(right[0], right[1], float(lean)),
            Line(right[1], left + rise),
            Arc(left, radius, np.pi / 2, np.pi),
        ]
        return Region(Loop(tuple(curves)))
    corner = make.star_points(draw, int(draw.integers(4, 9)), 30.0, 0.6)
    count = len(corner)
    along = np.roll(corner, -1, axis=0) - corner
    left_of = np.stack([-along[:, 1], along[:, 0]], axis=1)
    turns = 10.0 ** draw.uniform(-12, -3, count) * draw.choice([-1.0, 1.0], count)
    middle = corner + 0.5 * along - 0.25 * turns[:, None] * left_of
    return Region(make.polygon_loop(np.stack([corner, middle], axis=1).reshape(-1, 2)))


def near_duplicate(draw: Random) -> Region:
    """Outlines with clusters of vertices 1e-13 to 1e-6 mm apart."""
    if draw.uniform() < 0.5:
        return duplicates_on_polygon(draw)
    base = BASES[int(draw.integers(len(BASES)))](draw)
    loops = []
    for loop in base.loops:
        curves: list[Curve] = []
        for curve in loop.curves:
            if draw.uniform() < 0.7 or curve.size < 1e-3:
                curves.append(curve)
                continue
            share = 10.0 ** draw.uniform(-13, -6) / curve.size
            cut = share if draw.uniform() < 0.5 else 1.0 - share
            curves += [curve.subcurve(0.0, cut), curve.subcurve(cut, 1.0)]
        loops.append(Loop(tuple(curves)))
    return Region(loops[0], tuple(loops[1:]))


def duplicates_on_polygon(draw: Random) -> Region:
    """Polygon some of whose vertices are clusters."""
    corner = make.star_points(draw, int(draw.integers(4, 16)), 40.0, 0.4)
    points: list[FloatArray] = []
    for point, following in zip(corner, np.roll(corner, -1, axis=0), strict=True):
        points.append(point)
        if draw.uniform() < 0.5:
            continue
        along = np.arctan2(*(following - point)[::-1])
        for _ in range(int(draw.integers(1, 4))):
            step = polar(10.0 ** draw.uniform(-13, -6), along + draw.uniform(-0.3, 0.3))
            if np.any(points[-1] + step != points[-1]):
                points.append(points[-1] + step)
    return Region(make.polygon_loop(np.array(points)))


def far_away(draw: Random) -> Region:
    """Region of another kind near coordinates of 1e6 mm."""
    base = BASES[int(draw.integers(len(BASES)))](draw)
    return moved(base, draw.uniform(0, TURN), draw.uniform(-1e6, 1e6, 2))


def scaled(draw: Random) -> Region:
    """Region of another kind with a size of 1e-3 to 1e5 mm."""
    base = BASES[int(draw.integers(len(BASES)))](draw)
    xmin, ymin, xmax, ymax = base.bounds()
    size = np.hypot(xmax - xmin, ymax - ymin)
    return moved(base, draw.uniform(0, TURN), scale=10.0 ** draw.uniform(-3, 5) / size)


def many_islands(draw: Random) -> Region:
    """Up to sixty islands of several shapes."""
    places = scattered(draw, int(draw.integers(10, 61)), 48.0, 1.5, 4.0)
    outer = [
        make.circle_loop((0, 0), 50.0),
        make.polygon_loop([(-50, -50), (50, -50), (50, 50), (-50, 50)]),
        make.blob_loop(draw, 20, 56.0, 0.08),
    ][int(draw.integers(3))]
    return Region(outer, tuple(small_loop(draw, c, s) for c, s in places))


def grid_islands(draw: Random) -> Region:
    """Rectangle with a grid of like islands, in line: co-circular contacts."""
    columns, rows = (int(value) for value in draw.integers(1, 6, 2))
    turn, half = draw.choice([0.0, 0.3]), draw.uniform(1.0, 3.0)
    square = polar(half * np.sqrt(2), np.pi / 4 + turn + np.pi / 2 * np.arange(4))
    islands = []
    for index in range(columns * rows):
        centre = 10.0 * np.array([index % columns + 0.5, index // columns + 0.5])
        if draw.uniform() < 0.5:
            islands.append(make.polygon_loop(square + centre))
        else:
            islands.append(make.circle_loop(centre, half))
    width, height = 10.0 * columns, 10.0 * rows
    frame = make.polygon_loop([(0, 0), (width, 0), (width, height), (0, height)])
    return Region(frame, tuple(islands))


def polyline(draw: Random) -> Region:
    """Polygon that samples a smooth curve finely."""
    choice, count = int(draw.integers(3)), int(draw.integers(60, 600))
    if choice == 0:
        return Region(make.polygon_loop(polar(30.0, TURN * np.arange(count) / count)))
    base = spline(draw) if choice == 1 else pocket(draw)
    loops = []
    for loop in base.loops:
        if choice == 1:
            u = len(loop) * np.arange(count) / count
            points = loop.point(u)
        else:
            points = flatten(loop, 10.0 ** draw.uniform(-4, -2))
        loops.append(make.polygon_loop(np.round(points, 6)))
    return Region(loops[0], tuple(loops[1:]))


BASES: tuple[Generator, ...] = (
    spline, spline_islands, blob, quadratics, convex, star, tangle, comb, holed, rectilinear,
    regular, pocket, slot, bulged, mixed, gear,
)  # fmt: skip
"""Kinds that others change."""

KINDS: dict[str, Generator] = {
    generator.__name__.replace("_", "-"): generator
    for generator in (
        *BASES, flower, ellipse, glyph, annulus, circle, needle, neck, near_tangent,
        near_duplicate, far_away, scaled, many_islands, grid_islands, polyline,
    )
}  # fmt: skip
"""All kinds by name."""
