"""Free curves that are lines or circular arcs in disguise, many curves at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grassfire.geometry import Arc, Bezier, Line, simplify
from grassfire.geometry.chebyshev import bernstein_family, nodes
from grassfire.geometry.curve import cross, dot
from grassfire.geometry.simplify import OVERSAMPLING
from grassfire.medial.sites import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Disguised:
    """What the curves of a group are.

    Attributes
    ----------
    line, arc : (n,) bool arrays
        Curves that run along their chord, and along the arc below.
    centre : (n, 2) float array
    radius, start_angle, sweep : (n,) float arrays
    """

    line: BoolArray
    arc: BoolArray
    centre: FloatArray
    radius: FloatArray
    start_angle: FloatArray
    sweep: FloatArray


def unmask(
    curves: list[Bezier], control: FloatArray, tolerance: float, largest_radius: float
) -> Disguised:
    """Tell lines and arcs among Bezier curves of one degree.

    Parameters
    ----------
    curves : list of n Bezier
    control : (n, degree + 1, 3) float array
        Their homogeneous control points (w x, w y, w), coordinates about any origin.
    tolerance : float
        Largest deviation, mm.
    largest_radius : float
        Of an arc, mm; points of one of a larger radius come out with the rounding of its centre.
    """
    degree = control.shape[1] - 1
    weights = bernstein_family(degree, nodes(max(4 * degree, 16)), 0)[0]
    samples = np.matmul(weights, control)
    points = samples[..., :2] / samples[..., 2:]
    corners = control[..., :2] / control[..., 2:]
    size = np.hypot(*np.ptp(corners, axis=1).T)
    chord = corners[:, -1] - corners[:, 0]
    length = np.hypot(chord[:, 0], chord[:, 1])
    closed = length <= 1e-9 * size
    line = ~closed & _straight(points, corners, chord, np.where(closed, 1.0, length), tolerance)
    centre, radius, start_angle, sweep = _arc_through(points)
    spokes = points - centre[:, None]
    off = np.abs(np.hypot(spokes[..., 0], spokes[..., 1]) - radius[:, None]).max(axis=1)
    arc = ~closed & ~line & (off <= tolerance / OVERSAMPLING) & (radius <= largest_radius)
    near = np.flatnonzero(arc)
    arc[near] = _forward(spokes[near], sweep[near], tolerance / radius[near])
    # A closed curve has no chord to start from; such are few.
    for row in np.flatnonzero(closed):
        simple = simplify(curves[int(row)], tolerance)
        line[row], arc[row] = isinstance(simple, Line), isinstance(simple, Arc)
        if isinstance(simple, Arc):
            shift = curves[int(row)].start - corners[row, 0]
            centre[row], radius[row] = simple.centre - shift, simple.radius
            start_angle[row], sweep[row] = simple.start_angle, simple.sweep
    return Disguised(line, arc, centre, radius, start_angle, sweep)


def _straight(
    points: FloatArray,
    corners: FloatArray,
    chord: FloatArray,
    length: FloatArray,
    tolerance: float,
) -> BoolArray:
    """(n,) whether the control points (so the curve) lie along the chord, between its ends."""
    direction = (chord / length[:, None])[:, None]
    aside = np.abs(cross(direction, corners - corners[:, :1])).max(axis=1)
    along = dot(points - corners[:, :1], direction)
    inside = (along.min(axis=1) >= -tolerance) & (along.max(axis=1) <= length + tolerance)
    return np.asarray((aside <= tolerance / OVERSAMPLING) & inside)


def _arc_through(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Centre, radius, start angle and sweep of the arcs through the ends and a point between.

    The point is the one farthest from both ends. Points on a line give a radius of NaN.
    """
    start, end = points[:, 0], points[:, -1]
    from_start, from_end = points - start[:, None], points - end[:, None]
    reach = np.minimum(dot(from_start, from_start), dot(from_end, from_end))
    middle = points[np.arange(len(points)), np.argmax(reach, axis=1)]
    incoming, outgoing, chord = middle - start, end - middle, end - start
    sine, cosine = cross(incoming, outgoing), dot(incoming, outgoing)
    scale = np.hypot(*incoming.T) * np.hypot(*outgoing.T)
    bent = np.abs(sine) > 1e-14 * scale
    # The inscribed angle at the middle point is pi - sweep / 2.
    half = np.where(bent, np.arctan2(sine, cosine), 1.0)
    radius = np.hypot(chord[:, 0], chord[:, 1]) / (2.0 * np.abs(np.sin(half)))
    normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    centre = 0.5 * (start + end) + 0.5 * normal / np.tan(half)[:, None]
    start_angle = np.arctan2(chord[:, 1], chord[:, 0]) - np.copysign(0.5 * np.pi, half) - half
    return centre, np.where(bent, radius, np.nan), start_angle, 2.0 * half


def _forward(spokes: FloatArray, sweep: FloatArray, slack: FloatArray) -> BoolArray:
    """(n,) whether spokes (n, m, 2) turn through the sweep, never back by more than the slack."""
    before, after = spokes[:, :-1], spokes[:, 1:]
    steps = np.arctan2(cross(before, after), dot(before, after))
    turned = steps.sum(axis=1)
    least = (steps * np.sign(turned)[:, None]).min(axis=1, initial=np.inf)
    return np.asarray((least >= -slack) & (np.abs(turned - sweep) < 1e-3))


def homogeneous_table(curves: list[Bezier], origin: FloatArray) -> FloatArray:
    """(n, degree + 1, 3) homogeneous control points of curves of one degree, about `origin`."""
    table = np.ones((len(curves), curves[0].degree + 1, 3))
    table[..., :2] = np.array([curve.control_points for curve in curves])
    table[..., :2] -= origin
    for row, curve in enumerate(curves):
        if curve.weights is not None:
            table[row, :, 2] = curve.weights
    table[..., :2] *= table[..., 2:]
    return table


def by_degree(curves: list[Bezier]) -> list[IntArray]:
    """Rows of the curves of each degree."""
    degree = np.array([len(curve.control_points) for curve in curves])
    return [np.flatnonzero(degree == value) for value in np.unique(degree)]
