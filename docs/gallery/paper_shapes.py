"""Regions of the gallery: the kinds of shape that Dorado 2009 draws in Figs. 7 to 14.

Every function makes one region from a few numbers in mm; nothing is read from files. The outlines
are drawn for this gallery: they are of the same kind and complexity as those of the paper, whose
control points were not published.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import make_interp_spline

from grassfire.geometry import Arc, Bezier, BSpline, EllipticalArc, Line, Loop, Region

FloatArray = NDArray[np.float64]


# -- pieces ---------------------------------------------------------------------------------------


def spline_loop(points: ArrayLike) -> Loop:
    """Periodic cubic B-spline through the points (n, 2), with centripetal knots."""
    given = np.asarray(points, dtype=np.float64)
    closed = np.concatenate([given, given[:1]])
    chord = np.hypot(*np.diff(closed, axis=0).T)
    knots = np.concatenate([[0.0], np.cumsum(np.sqrt(chord))])
    spline = make_interp_spline(knots, closed, k=3, bc_type="periodic")
    return Loop((BSpline(3, spline.t, spline.c),))


def polar(radius: ArrayLike, degrees: ArrayLike, centre: ArrayLike = (0.0, 0.0)) -> FloatArray:
    """Points (n, 2) of polar coordinates about a centre."""
    angle = np.radians(np.asarray(degrees, dtype=np.float64))
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(np.asarray(radius, dtype=np.float64)[..., None] * unit + centre)


# -- fundamental domains: one edge between two terminal points ------------------------------------


def ellipse(major: float = 30.0, minor: float = 18.0) -> Region:
    """Fig. 7. The axis is |x| <= (a^2 - b^2) / a, y = 0, with r = b sqrt(1 - x^2 / (a^2 - b^2))."""
    return Region(Loop((EllipticalArc((0, 0), (major, 0), (0, minor), 0.0, 2 * np.pi),)))


def bean() -> Region:
    """Fig. 8. A bent cubic B-spline with two smooth ends and no branch point."""
    return Region(
        spline_loop(
            [
                (-30, -8), (-16, 4), (1, 8.5), (18, 4.5), (32, -6), (44, -6),
                (40, 8), (24, 22), (1, 27.5), (-24, 23), (-40, 8), (-43, -8),
            ]
        )
    )  # fmt: skip


def arc_ended(half: float = 10.0, straight: float = 30.0, radius: float = 40.0) -> Region:
    """Fig. 9. G1 outline of lines and arcs with parallel sides and an arc of contact at each end.

    From left to right: half a circle, two parallel lines 2 `half` apart, an arc of `radius`
    against the lower line, and an arc tangent to both. The axis is a straight piece at height
    `half` and then the parabola y = half - x^2 / (4 (radius - half)), with r = y throughout,
    x being counted from the end of the upper line.
    """
    reach = 0.8 * straight
    small = half - reach**2 / (4 * (radius - half))
    top = np.array([straight, 2 * half - radius])
    end = np.array([straight + reach, small])
    turn = float(np.arctan2(*(end - top)[::-1]))
    return Region(
        Loop(
            (
                Line((0, 0), (end[0], 0)),
                Arc(end, small, -np.pi / 2, turn + np.pi / 2),
                Arc(top, radius, turn, np.pi / 2 - turn),
                Line((straight, 2 * half), (0, 2 * half)),
                Arc((0, half), half, np.pi / 2, np.pi),
            )
        )
    )


def two_corners() -> Region:
    """Fig. 10. Two cubics that meet in convex corners."""
    lower = Bezier([(0, 0), (20, -22), (44, -6), (70, 4)])
    upper = Bezier([(70, 4), (52, 30), (18, 22), (0, 0)])
    return Region(Loop((lower, upper)))


def corner_and_arc(radius: float = 14.0, reach: float = 50.0) -> Region:
    """Fig. 11a. A drop: a convex corner, and an arc of contact opposite to it.

    The axis is straight from the corner at (reach, 0) to the centre (0, 0) of the arc, and
    r = (reach - x) radius / reach.
    """
    half = float(np.arccos(radius / reach))
    head = Arc((0, 0), radius, half, 2 * (np.pi - half))
    return Region(Loop((head, Line(head.end, (reach, 0)), Line((reach, 0), head.start))))


def corner_and_point() -> Region:
    """Fig. 11b. A cubic B-spline that starts and ends in a convex corner, with one smooth end."""
    points = np.array(
        [(0, 0), (20, -14), (42, -13), (62, 0), (68, 16), (55, 21), (36, 15), (16, 11), (0, 0)]
    )
    chord = np.hypot(*np.diff(points, axis=0).T)
    knots = np.concatenate([[0.0], np.cumsum(np.sqrt(chord))])
    spline = make_interp_spline(knots, points, k=3)
    return Region(Loop((BSpline(3, spline.t, spline.c),)))


# -- general domains ------------------------------------------------------------------------------


def three_lobes() -> Region:
    """Fig. 12. A cubic B-spline with three ends and one bifurcation point."""
    return Region(
        spline_loop(
            [
                (14, 2), (34, -12), (45, -10), (44, 3), (24, 14), (10, 24), (6, 40),
                (-4, 46), (-12, 38), (-11, 20), (-24, 6), (-42, -6), (-45, -18),
                (-34, -23), (-14, -12),
            ]
        )
    )  # fmt: skip


def four_lobes() -> Region:
    """Fig. 13. A cubic B-spline with four ends and two bifurcation points."""
    return Region(
        spline_loop(
            [
                (0, -12), (20, -12), (37, -24), (52, -29), (49, -14), (39, -1), (42, 12),
                (54, 24), (57, 38), (42, 35), (25, 20), (2, 12), (-22, 15), (-39, 29),
                (-55, 33), (-53, 18), (-42, 3), (-43, -9), (-56, -20), (-60, -36),
                (-45, -33), (-27, -17),
            ]
        )
    )  # fmt: skip


def _hand_loop() -> Loop:
    """Hand with its fingers up: wrist, thumb, forefinger to little finger, and back."""
    return spline_loop(
        [
            (-16, -43), (0, -44), (16, -43), (23, -39), (21, -28), (29, -12), (45, -2),
            (59, 13), (63, 24), (51, 24), (40, 14), (31, 9), (28, 15), (31, 34), (36, 56),
            (34, 65), (27, 64), (23, 54), (19, 33), (15, 26), (12, 34), (13, 58), (13, 73),
            (6, 79), (0, 73), (-1, 58), (-1, 34), (-4, 26), (-8, 33), (-12, 55), (-15, 70),
            (-22, 74), (-27, 67), (-24, 51), (-18, 30), (-20, 23), (-25, 28), (-34, 44),
            (-41, 55), (-48, 56), (-50, 49), (-44, 35), (-35, 17), (-29, 0), (-26, -14),
            (-22, -28), (-23, -39),
        ]
    )  # fmt: skip


def hand() -> Region:
    """Fig. 14a. A hand: five fingers and two corners of the wrist, seven ends in all."""
    return Region(_hand_loop())


def hand_with_hole() -> Region:
    """Fig. 14b. The hand with a round hole, a cubic B-spline too, in its palm."""
    radius = np.array([8.0, 7.0, 7.5, 8.0, 6.5, 7.0, 7.5])
    hole = spline_loop(polar(radius, 360 / 7 * np.arange(7), (-1, -4)))
    return Region(_hand_loop(), (hole,))


def oak_leaf() -> Region:
    """Fig. 14c. An oak leaf: a stalk, five lobes on each side and one on top, with two tips each.

    The lobes of the two sides are shifted against each other, as those of leaves are; the leaf
    lies on its side, the stalk to the left.
    """
    stalk = [(-2.4, -24.0), (-3.5, -41.0), (0.0, -45.0), (3.5, -41.0), (2.4, -24.0)]
    top = [(11, 111), (18, 119), (22, 132), (13, 137), (1, 133), (-12, 138), (-22, 135), (-18, 123)]
    left = _leaf_side([21, 30, 38, 41, 31], 6.0) * (-1.0, 1.0)
    right = _leaf_side([25, 33, 41, 39, 28], 0.0)
    upright = np.concatenate([stalk, right, top, [(-11, 117)], left[::-1]])
    return Region(spline_loop(upright[:, ::-1] * (1.0, -1.0)))


def _leaf_side(reach: Sequence[float], shift: float) -> FloatArray:
    """Right side from the stalk up: for each lobe the sinus below it and five points around it.

    The lobes rise outwards; `reach` is how far each goes from the midrib.
    """
    marks = []
    for index, far in enumerate(reach):
        foot, rise = 23.0 * index + shift, 0.16 * far
        marks += [
            (5.5 + 1.1 * index, foot - 6.0),
            (0.56 * far, foot - 3.0 + 0.5 * rise),
            (far - 0.5, foot - 3.0 + rise),
            (far + 1.6, foot + 6.0 + rise),
            (far - 2.0, foot + 14.5 + rise),
            (0.56 * far, foot + 9.5 + 0.5 * rise),
        ]
    return np.array(marks)
