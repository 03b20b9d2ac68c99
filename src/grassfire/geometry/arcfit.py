"""Free curves as few lines and circular arcs within a tolerance.

Biarcs (Bolton 1975) join points of the curve with its tangents there, so that the result is G1
where the curve is. The deviation of a biarc of length h is near |dk/ds| h^3 / 324, hence break
points at equal steps of the integral of |dk/ds|^(1/3) make the deviations equal and the pieces
few (Meek & Walton 1995); the number of steps is then tried on the curve itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil

import numpy as np
from numpy.typing import NDArray

from grassfire.errors import GeometryError
from grassfire.geometry.arc import Arc
from grassfire.geometry.curve import Curve, FloatArray, cross, dot
from grassfire.geometry.features import split_at_corners
from grassfire.geometry.line import Line
from grassfire.geometry.simplify import simplify

BIARC_CONSTANT = 324.0
LARGEST_TURN = 0.6 * np.pi
"""Turn of the tangent over one biarc, in radians, beyond which it is halved."""
SAMPLES = 24
ATTEMPTS = 6
MARGIN = 0.96
"""Share of the tolerance that samples may use: the rest covers what lies between them."""


def fit_arcs(
    curve: Curve, tolerance: float, maximum_arc_radius: float = 1e4
) -> tuple[Line | Arc, ...]:
    """Approximate a curve by few lines and circular arcs.

    Parameters
    ----------
    curve : Curve
        Lines and arcs pass through (arcs above the largest radius become chords).
    tolerance : float
        Largest distance between the curve and the result in mm, above zero.
    maximum_arc_radius : float
        In mm; flatter arcs are written as lines.

    Returns
    -------
    tuple of Line and Arc
        Same ends as the curve; each piece starts at the point where the last ends, up to the
        rounding of an arc's own evaluation. Tangents agree where the curve's do, except at lines
        that stand for arcs of too large a radius and at features below the tolerance.

    Raises
    ------
    GeometryError
        If the tolerance or the largest radius is not above zero.
    """
    if not (tolerance > 0.0 and maximum_arc_radius > 0.0):
        raise GeometryError("arc fitting needs a tolerance and a largest radius above zero")
    # A small share of the tolerance, so that arcs in disguise do not use up the whole.
    simple = simplify(curve, tolerance * (1.0 if curve.size <= 10.0 * tolerance else 0.1))
    if isinstance(simple, Line):
        return (simple,)
    if isinstance(simple, Arc):
        if simple.radius <= maximum_arc_radius:
            return (simple,)
        return _chords(simple, tolerance if simple is curve else 0.9 * tolerance)
    pieces: list[Line | Arc] = []
    for part in split_at_corners(curve, 1e-6):
        pieces.extend(_fit_smooth(part, tolerance, maximum_arc_radius))
    return tuple(pieces)


@dataclass(frozen=True, eq=False)
class _Biarcs:
    """Biarcs between consecutive parameters: points, tangents, and how far off each is.

    The sweep of the arc from start to middle is twice `first`, of the other twice `second`.
    """

    t: FloatArray
    start: FloatArray
    middle: FloatArray
    end: FloatArray
    first: FloatArray
    second: FloatArray
    deviation: FloatArray


def _fit_smooth(curve: Curve, tolerance: float, maximum_arc_radius: float) -> list[Line | Arc]:
    """Fit a curve without corners."""
    t, turned, density = _density(curve, tolerance)
    budget = MARGIN * tolerance
    density = density / (BIARC_CONSTANT * budget) ** (1.0 / 3.0)
    best: _Biarcs | None = None
    retried = False
    for _ in range(ATTEMPTS):
        count = max(1, ceil(density[-1] - 0.02))
        if best is not None and count >= len(best.deviation):
            # Equal deviations often save one more biarc than they promise: one try.
            if retried or len(best.deviation) == 1 or density[-1] > len(best.deviation) - 0.4:
                break
            retried, count = True, len(best.deviation) - 1
        trial = _attempt(curve, t, turned, density, count)
        good = bool(np.all(trial.deviation <= budget))
        if good and (best is None or len(trial.deviation) < len(best.deviation)):
            best = trial
        density = _measured(trial, t, density, budget)
        if not good and density[-1] <= count:
            density *= (count + 0.5) / density[-1]
    if best is None:
        best = _halve_failing(curve, trial, budget)
    return _pieces(best, tolerance, maximum_arc_radius)


def _measured(trial: _Biarcs, t: FloatArray, density: FloatArray, budget: float) -> FloatArray:
    """Return the density (m,) at t that would have made the measured deviations equal.

    Its total is the count of biarcs that is needed: deviations go with the cube of the length.
    """
    share = np.cbrt(np.clip(trial.deviation / budget, 1e-6, 8.0))
    turned = 2.0 * np.abs(trial.first + trial.second) / LARGEST_TURN
    reached = np.concatenate([[0.0], np.cumsum(np.maximum(share, 0.9 * turned))])
    return np.asarray(np.interp(density, np.interp(trial.t, t, density), reached))


def _density(curve: Curve, tolerance: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return parameters (m,), the turn of the tangent and the integral of |dk/ds|^(1/3) ds up to
    each."""
    edges = curve.breaks()
    per_span = max(4, ceil(96 / (len(edges) - 1)))
    unit = np.arange(per_span) / per_span
    t = np.append((edges[:-1, None] + np.diff(edges)[:, None] * unit).ravel(), 1.0)
    for turn_of_refinement in range(13):
        tangent = curve.tangent(t)
        turn = np.arctan2(cross(tangent[:-1], tangent[1:]), dot(tangent[:-1], tangent[1:]))
        length = np.hypot(*np.diff(curve.point(t), axis=0).T)
        coarse = (np.abs(turn) > 0.15) & (length > 0.05 * tolerance)
        if not np.any(coarse) or turn_of_refinement == 12:
            break
        t = np.sort(np.concatenate([t, 0.5 * (t[:-1] + t[1:])[coarse]]))
    # Curvature of features below the tolerance carries no weight.
    bend = np.clip(curve.curvature(t), -1.0 / tolerance, 1.0 / tolerance)
    weight = np.cbrt(np.abs(np.diff(bend)) * length**2)
    weight += 0.02 * weight.sum() * length / length.sum() + 1e-12 * length
    turned = np.concatenate([[0.0], np.cumsum(np.abs(turn))])
    return t, turned, np.concatenate([[0.0], np.cumsum(weight)])


def _attempt(
    curve: Curve, t: FloatArray, turned: FloatArray, density: FloatArray, count: int
) -> _Biarcs:
    """Return `count` biarcs at equal steps of the density, more where they would turn far."""
    steps = np.interp(np.linspace(0.0, density[-1], count + 1), density, t)
    steps[0], steps[-1] = 0.0, 1.0
    at_steps = np.interp(steps, t, turned)
    extra = [steps]
    for index in np.flatnonzero(np.diff(at_steps) > LARGEST_TURN):
        low, high = at_steps[index], at_steps[index + 1]
        inner = np.linspace(low, high, ceil((high - low) / LARGEST_TURN) + 1)[1:-1]
        extra.append(np.interp(inner, turned, t))
    return _biarcs(curve, np.unique(np.concatenate(extra)))


def _biarcs(curve: Curve, t: FloatArray) -> _Biarcs:
    """Return the biarcs between consecutive parameters t (m + 1,), measured on the curve.

    Equal tangent lengths d: v^2 = 2 d v.(a + b) + 2 d^2 (1 - a.b) for the chord v and the unit
    tangents a, b; solved in the form that does not cancel.
    """
    point, tangent = curve.point(t), curve.tangent(t)
    start, end, leave, arrive = point[:-1], point[1:], tangent[:-1], tangent[1:]
    chord = end - start
    half_slope = dot(chord, leave + arrive)
    openness = 2.0 * (1.0 - dot(leave, arrive))
    root = np.sqrt(half_slope**2 + openness * dot(chord, chord))
    with np.errstate(divide="ignore", invalid="ignore"):
        arm = dot(chord, chord) / (half_slope + root)
    arm = np.where(np.isfinite(arm), arm, 0.0)
    middle = 0.5 * (start + end + arm[:, None] * (leave - arrive))
    first, second = middle - start, end - middle
    half_first = np.arctan2(cross(leave, first), dot(leave, first))
    half_second = np.arctan2(cross(second, arrive), dot(second, arrive))
    inner = (np.arange(SAMPLES) + 0.5) / SAMPLES
    samples = curve.point(t[:-1, None] + np.diff(t)[:, None] * inner)
    joint = _turned(first, half_first)
    near_first = _distance(samples, start, leave, middle, joint, half_first)
    near_second = _distance(samples, middle, joint, end, arrive, half_second)
    deviation = np.minimum(near_first, near_second).max(axis=1)
    wild = (np.abs(half_first) > 0.45 * np.pi) | (np.abs(half_second) > 0.45 * np.pi)
    deviation[wild | (arm <= 0.0)] = np.inf
    return _Biarcs(t, start, middle, end, half_first, half_second, deviation)


def _turned(vector: FloatArray, angle: FloatArray) -> FloatArray:
    """Return unit vectors along (m, 2) vectors turned by (m,) angles."""
    length = np.maximum(np.hypot(vector[:, 0], vector[:, 1]), 1e-300)[:, None]
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    unit = vector / length
    return np.asarray(cosine * unit + sine * np.stack([-unit[:, 1], unit[:, 0]], axis=-1))


def _distance(
    samples: FloatArray,
    start: FloatArray,
    leave: FloatArray,
    end: FloatArray,
    arrive: FloatArray,
    half_sweep: FloatArray,
) -> FloatArray:
    """Return the distances of samples (m, s, 2) from m arcs given by ends and end tangents.

    With curvature k and offset w from the start, 2 f / (1 + sqrt(1 - 2 k f)) for
    f = n.w - k w^2 / 2 is the distance from the circle, and from the line when k is zero.
    """
    from_start, from_end = samples - start[:, None], samples - end[:, None]
    chord = np.maximum(np.hypot(*(end - start).T), 1e-300)
    bend = (2.0 * np.sin(half_sweep) / chord)[:, None]
    offset = cross(leave[:, None], from_start) - 0.5 * bend * dot(from_start, from_start)
    to_circle = np.abs(2.0 * offset / (1.0 + np.sqrt(np.maximum(1.0 - 2.0 * bend * offset, 0.0))))
    to_ends = np.minimum(
        np.hypot(*np.moveaxis(from_start, -1, 0)), np.hypot(*np.moveaxis(from_end, -1, 0))
    )
    between = (dot(leave[:, None], from_start) >= 0.0) & (dot(arrive[:, None], from_end) <= 0.0)
    return np.asarray(np.where(between, to_circle, to_ends))


def _halve_failing(curve: Curve, best: _Biarcs, budget: float) -> _Biarcs:
    """Halve the biarcs that are too far off until none is, or what is left is below tolerance."""
    for _ in range(40):
        chord = np.hypot(*(best.end - best.start).T)
        span = np.diff(best.t)
        failing = (best.deviation > budget) & (span > 1e-12) & (chord > 0.0)
        if not np.any(failing):
            return best
        extra = best.t[:-1][failing] + 0.5 * span[failing]
        best = _biarcs(curve, np.sort(np.concatenate([best.t, extra])))
    return best


def _pieces(best: _Biarcs, tolerance: float, maximum_arc_radius: float) -> list[Line | Arc]:
    """Return lines and arcs along the biarcs, each from the last one's end."""
    pieces: list[Line | Arc] = []
    tiny = 0.01 * tolerance
    chord = np.hypot(*(best.end - best.start).T)
    turn = 2.0 * (best.first + best.second)
    # One arc will do for two of almost the same curvature.
    uneven = np.abs(best.first - best.second) * chord / 8.0
    single = (uneven <= 0.02 * tolerance) & (np.abs(best.first - best.second) < 1e-3)
    single &= np.abs(turn) < 0.9 * np.pi
    cursor = best.start[0]
    for index in range(len(chord)):
        spare = max(tolerance - float(best.deviation[index]), 0.04 * tolerance)
        if not np.isfinite(best.deviation[index]):
            ends = [(best.end[index], 0.0)]
        elif single[index]:
            ends = [(best.end[index], float(turn[index]))]
        else:
            ends = [
                (best.middle[index], 2.0 * float(best.first[index])),
                (best.end[index], 2.0 * float(best.second[index])),
            ]
        for place, sweep in ends:
            last = index == len(chord) - 1 and place is ends[-1][0]
            if np.hypot(*(place - cursor)) <= tiny and not last:
                continue
            if np.all(place == cursor):
                continue
            pieces.extend(_piece(cursor, place, sweep, spare, maximum_arc_radius))
            cursor = place
    return pieces


def _piece(
    start: FloatArray, end: FloatArray, sweep: float, spare: float, maximum_arc_radius: float
) -> list[Line | Arc]:
    """Return the arc, or the chords that replace one that is flat beyond use."""
    chord = float(np.hypot(*(end - start)))
    sagitta = 0.5 * chord * abs(float(np.tan(0.25 * sweep)))
    if sagitta <= 1e-9 * chord or sagitta <= 1e-6 * spare:
        return [Line(start, end)]
    arc = Arc.from_bulge(start, end, float(np.tan(0.25 * sweep)))
    return [arc] if arc.radius <= maximum_arc_radius else _joined(arc, start, end, spare)


def _joined(arc: Arc, start: FloatArray, end: FloatArray, tolerance: float) -> list[Line | Arc]:
    step = 4.0 * np.arcsin(np.sqrt(0.5 * min(1.0, tolerance / arc.radius)))
    count = max(1, ceil(abs(arc.sweep) / step - 1e-9))
    points = arc.point(np.linspace(0.0, 1.0, count + 1))
    points[0], points[-1] = start, end
    return [Line(first, last) for first, last in pairwise(points)]


def _chords(arc: Arc, tolerance: float) -> tuple[Line | Arc, ...]:
    """Return chords for an arc of too large a radius."""
    return tuple(_joined(arc, arc.start, arc.end, tolerance))


def deviation_from(curve: Curve, pieces: tuple[Line | Arc, ...], samples: int = 2000) -> float:
    """Return the largest distance in mm from uniform samples of a curve to the pieces."""
    points = curve.point(np.linspace(0.0, 1.0, samples))
    nearest: NDArray[np.float64] = np.full(samples, np.inf)
    for piece in pieces:
        half = 0.5 * piece.sweep if isinstance(piece, Arc) else 0.0
        # Arcs beyond half a turn are measured in halves: the wedge test needs it.
        parts = (
            [piece]
            if abs(half) <= 0.49 * np.pi
            else [piece.subcurve(i / 4, (i + 1) / 4) for i in range(4)]
        )
        for part in parts:
            angle = 0.5 * part.sweep if isinstance(part, Arc) else 0.0
            distance = _distance(
                points[None],
                part.start[None],
                part.tangent(0.0)[None],
                part.end[None],
                part.tangent(1.0)[None],
                np.array([angle]),
            )
            nearest = np.minimum(nearest, distance[0])
    return float(nearest.max())
