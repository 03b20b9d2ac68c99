"""Sixty pockets for toolpaths: `pocket(name)` as a region, `write_dxf` as a drawing; in mm.

Ten are of the sizes that other programs were measured on (a rectangle to a plate with forty
islands). The others are what pockets are hard for: corridors of 1.2 tool diameters, dead ends,
combs, necks, glyphs, free forms, needles. Each has the tool that it is milled with.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import outlines as make
import shapely
from numpy.typing import ArrayLike
from outlines import TURN, FloatArray, polar
from plate_islands import CIRCLES, HEXAGONS, RECTANGLES

from grassfire.geometry import (
    Arc,
    Bezier,
    BSpline,
    Curve,
    EllipticalArc,
    Line,
    Loop,
    Region,
    flatten,
)

ORIGIN = np.array([20.0, 20.0])
"""Corner that the first ten pockets are drawn from."""

CORRIDOR = 7.2
"""Width of corridors: 1.2 diameters of the 6 mm tool."""

LAYER = "POCKET"


@dataclass(frozen=True)
class Pocket:
    """A region and the tool for it.

    Attributes
    ----------
    name : str
    region : Region
    diameter : float
        Of the tool, mm.
    one_lobe : bool
        Simply connected, and every trimmed offset of it is one loop: a single spiral clears it.
    """

    name: str
    region: Region
    diameter: float = 6.0
    one_lobe: bool = False

    def polygon(self, tolerance: float = 1e-4) -> shapely.Polygon:
        """The region with chords within `tolerance` mm of its curves."""
        rings = [flatten(loop, tolerance) for loop in self.region.loops]
        return shapely.Polygon(rings[0], rings[1:])


Draft = tuple[Region, float, bool]
Draw = Callable[[], Draft]
_DRAWN: dict[str, Draw] = {}


def names() -> tuple[str, ...]:
    """All pockets, the ten known ones first."""
    return tuple(_DRAWN)


@cache
def pocket(name: str) -> Pocket:
    """The pocket of a name."""
    region, diameter, one_lobe = _DRAWN[name]()
    return Pocket(name, region, diameter, one_lobe)


def _draw(
    name: str, make_region: Callable[[], Region], diameter: float = 6.0, one_lobe: bool = False
) -> None:
    """Enter a pocket into the list."""
    _DRAWN[name] = lambda: (make_region(), diameter, one_lobe)


# -- shapes ---------------------------------------------------------------------------------------


def polygon(points: ArrayLike, shift: ArrayLike = (0.0, 0.0)) -> Region:
    """Polygon through points, shifted."""
    return Region(make.polygon_loop(np.asarray(points, float) + np.asarray(shift, float)))


def box(width: float, height: float, shift: ArrayLike = (0.0, 0.0)) -> Loop:
    """Rectangle with its lower left corner at a place."""
    corner = np.array([(0, 0), (width, 0), (width, height), (0, height)], float)
    return make.polygon_loop(corner + np.asarray(shift, float))


def turned_box(centre: ArrayLike, width: float, height: float, angle: float) -> Loop:
    """Rectangle about its centre; the angle is in degrees."""
    corner = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (width / 2, height / 2)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return make.polygon_loop(corner @ np.array([(c, s), (-s, c)]) + np.asarray(centre, float))


def regular(centre: ArrayLike, radius: float, count: int, angle: float = 0.0) -> Loop:
    """Regular polygon with a corner at an angle in degrees."""
    spokes = np.radians(angle) + TURN * np.arange(count) / count
    return make.polygon_loop(np.asarray(centre, float) + polar(radius, spokes))


def ellipse_loop(centre: ArrayLike, major: ArrayLike, minor: ArrayLike) -> Loop:
    """Whole ellipse."""
    place, first, second = (np.asarray(item, float) for item in (centre, major, minor))
    return Loop((EllipticalArc(place, first, second, 0.0, TURN),))


def corridors(lines: Sequence[ArrayLike], width: float = CORRIDOR) -> Region:
    """Corridors of one width along polylines, with square ends and sharp corners.

    What lies between corridors that close a ring is an island.
    """
    strips = [
        shapely.LineString(np.asarray(line, float)).buffer(
            width / 2, cap_style="square", join_style="mitre", mitre_limit=10
        )
        for line in lines
    ]
    return shapely_region(shapely.union_all(strips))


def shapely_region(shape: shapely.Polygon) -> Region:
    """Region of a polygon, without corners that do not turn."""
    rings = [np.asarray(ring.coords)[:-1] for ring in (shape.exterior, *shape.interiors)]
    loops = []
    for ring in rings:
        behind, ahead = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
        cross = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
        loops.append(make.polygon_loop(ring[np.abs(cross) > 1e-9]))
    return Region(loops[0], tuple(loops[1:]))


def rooms(*boxes: tuple[float, float, float, float]) -> Region:
    """Union of rectangles (xmin, ymin, xmax, ymax)."""
    return shapely_region(shapely.union_all([shapely.box(*corner) for corner in boxes]))


def glyph(character: str, bold: bool, height: float) -> Region:
    """Largest outline of a letter, and the outlines inside it."""
    loops = make.glyph_loops(character, bold, height)
    outer = max(loops, key=lambda loop: abs(loop.area))
    body = Region(outer)
    inside = [
        loop for loop in loops if loop is not outer and body.contains(loop.point([0.5])).all()
    ]
    return Region(outer, tuple(inside))


def keyhole(radius: float, width: float, length: float) -> Region:
    """Disk with a corridor that leaves it to the right and ends round."""
    half = np.arcsin(width / 2 / radius)
    mouth = polar(radius, [half, -half])
    far = np.array([[length, width / 2], [length, -width / 2]])
    return Region(
        Loop(
            (
                Arc(make.ORIGIN, radius, half, TURN - 2 * half),
                Line(mouth[1], far[1]),
                Arc(np.array([length, 0.0]), width / 2, -np.pi / 2, np.pi),
                Line(far[0], mouth[0]),
            )
        )
    )


def round_rooms(first: float, second: float, width: float, gap: float) -> Region:
    """Two disks joined by a straight corridor."""
    half, other = np.arcsin(width / 2 / first), np.arcsin(width / 2 / second)
    away = np.array([first * np.cos(half) + gap + second * np.cos(other), 0.0])
    left, right = polar(first, [half, -half]), away + polar(second, [np.pi - other, np.pi + other])
    return Region(
        Loop(
            (
                Arc(make.ORIGIN, first, half, TURN - 2 * half),
                Line(left[1], right[1]),
                Arc(away, second, other - np.pi, TURN - 2 * other),
                Line(right[0], left[0]),
            )
        )
    )


def dog_bone(width: float, height: float, radius: float) -> Region:
    """Rectangle whose corners are relieved by arcs through them, centred on the diagonals."""
    corner = np.array([(0, 0), (width, 0), (width, height), (0, height)], float)
    inward = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) / np.sqrt(2.0)
    chord = radius * np.sqrt(2.0)
    along = (np.roll(corner, -1, axis=0) - corner) / np.array([[width], [height]] * 2)
    behind = np.roll(along, 1, axis=0)
    curves: list[Curve] = []
    for k in range(4):
        after = (k + 1) % 4
        centre = corner[k] + radius * inward[k]
        spoke = corner[k] - chord * behind[k] - centre
        # from wall to wall through the corner: half a turn, counter-clockwise
        curves.append(Arc(centre, radius, float(np.arctan2(spoke[1], spoke[0])), np.pi))
        curves.append(Line(corner[k] + chord * along[k], corner[after] - chord * along[k]))
    return Region(Loop(tuple(curves)))


def comb(teeth: int, tooth: float, gap: float, depth: float, back: float) -> Region:
    """Equal teeth on a back."""
    points = [(0.0, -back)]
    for k in range(teeth):
        left = k * (tooth + gap)
        points += [(left, 0.0)] if k else []
        points += [(left, depth), (left + tooth, depth)]
        points += [(left + tooth, 0.0)] if k < teeth - 1 else []
    points.append((teeth * (tooth + gap) - gap, -back))
    return polygon(np.array(points)[::-1])


def blob(seed: int, points: int, size: float, wobble: float) -> Region:
    """Random interpolating spline about the origin."""
    return Region(make.blob_loop(np.random.default_rng(seed), points, size, wobble))


# -- the ten known ones ---------------------------------------------------------------------------


def star_points(count: int, tip: float, root: float) -> FloatArray:
    """Star with its first tip upwards, clockwise."""
    radius = np.where(np.arange(2 * count) % 2, root, tip)
    return polar(radius, np.pi / 2 - np.pi * np.arange(2 * count) / count)


def gear() -> Region:
    """24 trapezoidal teeth between radius 66 and 80; the gaps are 8 to 10 mm wide."""
    share = np.tile([-0.28, -0.20, 0.20, 0.28], 24)
    radius = np.tile([66.0, 80.0, 80.0, 66.0], 24)
    return polygon(polar(radius, TURN / 24 * (np.repeat(np.arange(24), 4) + share)), ORIGIN + 80)


FREE_FORM = np.array(
    [(30, 14), (58, 24), (78, 10), (104, 18), (100, 40), (120, 56),
     (96, 78), (76, 62), (58, 88), (34, 76), (36, 52), (12, 40)], dtype=np.float64,
)  # fmt: skip
"""Control points of a closed uniform cubic B-spline."""


def three_islands() -> Region:
    """Plate of 120 by 80 with round islands."""
    islands = [((30, 28), 8.0), ((72, 50), 12.0), ((98, 22), 6.0)]
    return Region(
        box(120, 80, ORIGIN),
        tuple(make.circle_loop(ORIGIN + np.array(place), radius) for place, radius in islands),
    )


def forty_islands() -> Region:
    """Plate of 300 by 200 with forty islands at least 4 mm apart."""
    islands = [make.circle_loop((x, y), radius) for x, y, radius in CIRCLES]
    islands += [turned_box((x, y), w, h, angle) for x, y, w, h, angle in RECTANGLES]
    islands += [regular((x, y), radius, 6, angle) for x, y, radius, angle in HEXAGONS]
    return Region(box(300, 200, ORIGIN), tuple(islands))


L_SHAPE = [(0, 0), (100, 0), (100, 35), (40, 35), (40, 90), (0, 90)]

_draw("rectangle", lambda: Region(box(100, 60, ORIGIN)), one_lobe=True)
_draw("circle", lambda: Region(make.circle_loop(ORIGIN + 40, 40.0)), one_lobe=True)
_draw("l-shape", lambda: polygon(L_SHAPE, ORIGIN))
_draw(
    "ellipse",
    lambda: Region(ellipse_loop(ORIGIN + np.array([60, 25]), (60, 0), (0, 25))),
    one_lobe=True,
)
_draw(
    "slot",
    lambda: Region(make.capsule_loop(ORIGIN + 10, ORIGIN + np.array([90, 10]), 10.0)),
    one_lobe=True,
)
_draw("star", lambda: polygon(star_points(7, 60.0, 28.0), ORIGIN + 60))
_draw("gear", gear)
_draw("free-form", lambda: Region(make.bspline_loop(FREE_FORM + ORIGIN - 10, whole=True)))
_draw("three-islands", three_islands)
_draw("forty-islands", forty_islands)

# -- glyphs ---------------------------------------------------------------------------------------

for _name, _character, _bold, _height, _diameter in (
    ("glyph-r-bold", "R", True, 60.0, 6.0),
    ("glyph-b-bold", "B", True, 70.0, 6.0),
    ("glyph-m-bold", "M", True, 60.0, 6.0),
    ("glyph-ampersand-bold", "&", True, 80.0, 6.0),
    ("glyph-s", "S", False, 60.0, 4.0),
    ("glyph-g", "g", False, 80.0, 6.0),
    ("glyph-a", "a", False, 60.0, 3.0),
    ("glyph-at", "@", False, 80.0, 4.0),
    ("glyph-k", "k", False, 60.0, 5.0),
):
    _draw(
        _name,
        lambda character=_character, bold=_bold, height=_height: glyph(character, bold, height),
        _diameter,
    )

# -- corridors of 1.2 diameters, dead ends --------------------------------------------------------

Y_ARMS = polar(45.0, np.pi / 2 + TURN * np.arange(3) / 3)

_draw("corridor-straight", lambda: corridors([[(0, 0), (90, 0)]]))
_draw("corridor-bent", lambda: corridors([[(0, 0), (60, 0), (60, 50)]]))
_draw(
    "corridor-zigzag",
    lambda: corridors([[(0, 0), (30, 30), (60, 0), (90, 30), (120, 0)]]),
)
_draw("corridor-arc", lambda: Region(make.bent_slot_loop(40.0, CORRIDOR / 2, 2.5)))
_draw("corridor-t", lambda: corridors([[(-40, 0), (40, 0)], [(0, 0), (0, -45)]]))
_draw("corridor-y", lambda: corridors([[(0, 0), arm] for arm in Y_ARMS]))
_draw("corridor-cross", lambda: corridors([[(-40, 0), (40, 0)], [(0, -40), (0, 40)]]))
_draw(
    "corridor-tree",
    lambda: corridors([[(0, 0), (100, 0)], [(25, 0), (25, 40)], [(60, 0), (60, -35)],
                       [(80, 0), (80, 40)], [(25, 25), (5, 25)], [(80, 20), (100, 20)]]),
)  # fmt: skip
_draw("corridor-ring", lambda: corridors([[(0, 0), (70, 0), (70, 50), (0, 50), (0, 0)]]))
_draw(
    "corridor-ladder",
    lambda: corridors([[(0, 0), (80, 0)], [(0, 40), (80, 40)],
                       *([(x, 0), (x, 40)] for x in (0, 20, 40, 60, 80))]),
)  # fmt: skip
_draw(
    "dead-ends",
    lambda: rooms((0, 0, 50, 50), (50, 20, 95, 27.2), (-45, 30, 0, 40), (20, 50, 28, 90)),
)
_draw(
    "dead-ends-round",
    lambda: keyhole(25.0, CORRIDOR, 75.0),
)
_draw(
    "dead-end-taper",
    lambda: polygon([(0, 0), (40, 0), (40, 16), (110, 19), (110, 21), (40, 24), (40, 40), (0, 40)]),
)

# -- combs ----------------------------------------------------------------------------------------

_draw("comb-narrow", lambda: comb(6, CORRIDOR, 6.0, 40.0, 20.0))
_draw("comb-wide", lambda: comb(4, 16.0, 4.0, 45.0, 12.0))
_draw("comb-thin-back", lambda: comb(5, 10.0, 8.0, 30.0, 7.0))
_draw(
    "comb-random",
    lambda: Region(make.polygon_loop(make.comb_points(np.random.default_rng(4), 7, 140.0))),
    4.0,
)

# -- necks ----------------------------------------------------------------------------------------

_draw("neck-passable", lambda: rooms((0, 0, 45, 50), (45, 21, 60, 29), (60, 5, 110, 45)))
_draw("neck-tight", lambda: round_rooms(25.0, 18.0, 6.4, 12.0))
_draw("neck-closed", lambda: rooms((0, 0, 45, 50), (45, 23, 60, 28), (60, 5, 110, 45)))
_draw(
    "neck-three-rooms",
    lambda: rooms((0, 0, 30, 30), (30, 12, 36, 20), (36, -8, 70, 40), (70, 10, 80, 15),
                  (80, 0, 110, 30)),
)  # fmt: skip
_draw("neck-hourglass", lambda: polygon([(0, 0), (60, 0), (34, 35), (60, 70), (0, 70), (26, 35)]))

# -- triangles and needles ------------------------------------------------------------------------

_draw("triangle", lambda: Region(regular((0, 0), 45.0, 3, 90.0)), one_lobe=True)
_draw("triangle-acute", lambda: polygon([(0, 0), (110, 15), (110, -15)]), one_lobe=True)
_draw("rhombus-needle", lambda: polygon([(-90, 0), (0, -14), (90, 0), (0, 14)]), one_lobe=True)

# -- keyholes, annuli, dog bones ------------------------------------------------------------------

_draw("keyhole-wide", lambda: keyhole(30.0, 20.0, 80.0))
_draw(
    "annulus",
    lambda: Region(make.circle_loop((0, 0), 40.0), (make.circle_loop((0, 0), 18.0),)),
)
_draw(
    "annulus-eccentric",
    lambda: Region(make.circle_loop((0, 0), 40.0), (make.circle_loop((10, 4), 18.0),)),
)
_draw(
    "annulus-corridor",
    lambda: Region(make.circle_loop((0, 0), 35.0), (make.circle_loop((0, 0), 35.0 - CORRIDOR),)),
)
_draw("dog-bone", lambda: dog_bone(80.0, 50.0, 3.5))

# -- free forms -----------------------------------------------------------------------------------

_draw("blob-mild", lambda: blob(1, 12, 38.0, 0.15))
_draw("blob-wild", lambda: blob(2, 14, 45.0, 0.35))
_draw("blob-tiny", lambda: blob(5, 9, 12.0, 0.2))
_draw(
    "flower",
    lambda: Region(
        make.bspline_loop(polar(36 * (1 + 0.3 * np.cos(5 * TURN * np.arange(30) / 30)),
                                TURN * np.arange(30) / 30))
    ),
)  # fmt: skip
_draw(
    "blob-island",
    lambda: Region(
        make.blob_loop(np.random.default_rng(6), 14, 45.0, 0.15),
        (make.blob_loop(np.random.default_rng(7), 9, 14.0, 0.25),),
    ),
)

# -- compact ones, and islands --------------------------------------------------------------------

_draw(
    "rounded-rectangle",
    lambda: Region(make.filleted_loop([(0, 0), (90, 0), (90, 55), (0, 55)], 8.0)),
    one_lobe=True,
)
_draw("barely-fits", lambda: Region(make.circle_loop((0, 0), CORRIDOR / 2)), one_lobe=True)
_draw("small-square", lambda: Region(box(9, 9)), one_lobe=True)
_draw("stairs", lambda: rooms(*((0, 16.0 * k, 96 - 16.0 * k, 16.0 * (k + 1)) for k in range(5))))
_draw(
    "ellipse-island",
    lambda: Region(box(110, 70), (ellipse_loop((55, 35), (30, 8), (-4, 15)),)),
)
_draw(
    "grid-islands",
    lambda: Region(
        box(96, 72),
        tuple(
            turned_box((12 + 24 * i, 12 + 24 * j), 8, 8, 15 * (i + j))
            for i in range(4)
            for j in range(3)
        ),
    ),
)


# -- drawings -------------------------------------------------------------------------------------


def write_dxf(region: Region, path: Path) -> None:
    """Write a region as DXF R2010 in millimetres: loops of lines and arcs as polylines."""
    import ezdxf
    from ezdxf import units

    document = ezdxf.new("R2010", units=units.MM)
    document.layers.add(LAYER)
    space = document.modelspace()
    for loop in region.loops:
        if all(isinstance(curve, Line | Arc) for curve in loop.curves) and len(loop.curves) > 1:
            rows = [
                (*curve.start, np.tan(curve.sweep / 4) if isinstance(curve, Arc) else 0.0)
                for curve in loop.curves
            ]
            space.add_lwpolyline(rows, format="xyb", close=True, dxfattribs={"layer": LAYER})
        else:
            for curve in loop.curves:
                _add_curve(space, curve)
    document.saveas(path)


def _add_curve(space: Any, curve: Curve) -> None:
    """One curve as an entity of its own."""
    attributes = {"layer": LAYER}
    if isinstance(curve, Line):
        space.add_line(curve.start.tolist(), curve.end.tolist(), dxfattribs=attributes)
    elif isinstance(curve, Arc) and curve.closed:
        space.add_circle(curve.centre.tolist(), curve.radius, dxfattribs=attributes)
    elif isinstance(curve, EllipticalArc) and abs(curve.sweep) == TURN:
        _add_ellipse(space, curve)
    elif isinstance(curve, BSpline) and curve.weights is None:
        whole = curve.clamped()
        spline = space.add_spline(degree=whole.degree, dxfattribs=attributes)
        spline.knots = whole.knots.tolist()
        spline.control_points = _raised(whole.control_points)
    elif isinstance(curve, Bezier) and curve.weights is None:
        degree = len(curve.control_points) - 1
        spline = space.add_spline(degree=degree, dxfattribs=attributes)
        spline.knots = [0.0] * (degree + 1) + [1.0] * (degree + 1)
        spline.control_points = _raised(curve.control_points)
    else:
        raise TypeError(f"no entity for {type(curve).__name__}")


def _raised(points: FloatArray) -> list[tuple[float, float, float]]:
    return [(float(x), float(y), 0.0) for x, y in points]


def _add_ellipse(space: Any, curve: EllipticalArc) -> None:
    """Whole ellipse: DXF wants half-axes at right angles, the longer one first."""
    axes, lengths, _ = np.linalg.svd(np.column_stack([curve.major, curve.minor]))
    space.add_ellipse(
        curve.centre.tolist(),
        major_axis=(axes[:, 0] * lengths[0]).tolist(),
        ratio=float(lengths[1] / lengths[0]),
        dxfattribs={"layer": LAYER},
    )
