"""Machining time under limited acceleration, as the planners of controllers spend it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Required, TypedDict

import numpy as np

from grassfire.errors import InputError
from grassfire.verify.model import FloatArray
from grassfire.verify.path import IntArray, Path

_STRAIGHT = 0.999999
"""Cosine beyond which a junction counts as straight on, or as a reversal (grbl's planner)."""

_TANGENTIAL = 0.5
_NORMAL = math.sqrt(1 - _TANGENTIAL**2)
"""Shares of the acceleration along and across an arc (LinuxCNC, blendmath.h)."""


@dataclass(frozen=True)
class _Limits:
    """What holds the speed of the moves: squares of speeds, mm2/s2, and accelerations, mm/s2.

    `junction` (n + 1,) at the ends of moves, `along` (n,) on them, `acceleration` (n,) that is
    left for speeding up and slowing down.
    """

    junction: FloatArray
    along: FloatArray
    acceleration: FloatArray


class Clock(TypedDict, total=False):
    """Arguments of `move_times` besides the path."""

    rapid: Required[float]
    acceleration: Required[float]
    junction_deviation: float
    arc_tolerance: float
    path_tolerance: float | None


def move_times(
    path: Path,
    *,
    rapid: float,
    acceleration: float,
    junction_deviation: float = 0.01,
    arc_tolerance: float = 0.002,
    path_tolerance: float | None = None,
) -> FloatArray:
    """Return the seconds that each move takes on a controller with a look-ahead planner.

    Speed is trapezoidal along each move and held at junctions and on arcs: as grbl does it, or
    with `path_tolerance` as LinuxCNC does after G64 P, or G61 where that is 0. Not modelled: limits
    of single axes, the finite number of blocks looked ahead, jerk.

    Parameters
    ----------
    path : Path
    rapid : float
        Speed of rapids, mm/min.
    acceleration : float
        mm/s2.
    junction_deviation : float
        mm.
    arc_tolerance : float
        Distance of grbl's chords from arcs, mm.
    path_tolerance : float, optional
        mm, >= 0.

    Returns
    -------
    (n,) array
        Seconds; 0 for moves of no length or from an unknown position. The machine stops at tool
        changes (ends of sections).

    Raises
    ------
    InputError
        If a speed or tolerance is not in its range.
    """
    _check(rapid, acceleration, arc_tolerance, path_tolerance)
    result = np.zeros(len(path))
    rows = np.flatnonzero(np.nan_to_num(path.length) > 1e-9)
    if not len(rows):
        return result
    speed = np.where(path.rapid[rows], rapid, np.nan_to_num(path.feed[rows])) / 60.0
    speed = np.maximum(speed, 1.0 / 60.0)
    if path_tolerance is None:
        limits = _grbl_limits(path, rows, acceleration, junction_deviation, arc_tolerance)
    else:
        limits = _blend_limits(path, rows, speed, acceleration, path_tolerance)
    speed = np.minimum(speed, np.sqrt(limits.along))
    junction = np.zeros(len(rows) + 1)
    junction[1:-1] = np.minimum(limits.junction, np.minimum(speed[:-1], speed[1:]) ** 2)
    junction[1:-1][path.section[rows][1:] != path.section[rows][:-1]] = 0.0
    result[rows] = _trapezoids(path.length[rows], speed, junction, limits.acceleration)
    return result


def _check(rapid: float, acceleration: float, arc: float, blend: float | None) -> None:
    """Refuse speeds and tolerances that no machine has."""
    for name, value in (("rapid", rapid), ("acceleration", acceleration)):
        if not value > 0:
            raise InputError(f"{name} {value:g} is not positive")
    if not arc > 0:
        raise InputError(f"arc tolerance {arc:g} mm is not positive")
    if blend is not None and not blend >= 0:
        raise InputError(f"path tolerance {blend:g} mm is negative")


def _trapezoids(
    length: FloatArray, speed: FloatArray, junction: FloatArray, rate: FloatArray
) -> FloatArray:
    """Return the seconds of moves.

    The backward and forward passes over v^2 are running minima of v_k^2 +- the sum of 2 a_k L_k
    over the moves' lengths L, so that no loop over moves is needed.

    Parameters
    ----------
    length, speed, rate : (m,) arrays
        mm, largest speed in mm/s, acceleration in mm/s2.
    junction : (m + 1,) array
        Squares of the largest speeds at the ends of moves, mm2/s2.
    """
    climb = np.concatenate([[0.0], np.cumsum(2 * rate * length)])
    squared = np.minimum.accumulate((junction + climb)[::-1])[::-1] - climb
    squared = np.minimum.accumulate(squared - climb) + climb
    node = np.sqrt(np.maximum(squared, 0.0))
    first, last = node[:-1], node[1:]
    peak = np.sqrt((2 * rate * length + first**2 + last**2) / 2)
    top = np.minimum(peak, speed)
    # The running sums cancel to ~1e-7 mm2/s2 on long programs: never let an end exceed the top.
    first, last = np.minimum(first, top), np.minimum(last, top)
    ramps = (2 * top**2 - first**2 - last**2) / (2 * rate)
    cruise = np.maximum(length - ramps, 0.0) / top
    return np.asarray((2 * top - first - last) / rate + cruise)


def _grbl_limits(
    path: Path, rows: IntArray, acceleration: float, deviation: float, tolerance: float
) -> _Limits:
    """Return the limits of junction deviation.

    At a junction of unit directions with half angle h between them v^2 = a d sin(h) / (1 - sin(h))
    for junction deviation d; arcs are drawn as chords, whose junctions hold the speed on them
    (S. K. Jeon, "Improving Grbl: cornering algorithm", 2011; grbl 1.1, planner.c and
    motion_control.c).
    """
    radius = np.maximum((path.start_radius[rows] + path.end_radius[rows]) / 2, tolerance)
    turn = np.abs(path.sweep[rows])
    chords = np.floor(0.5 * turn * radius / np.sqrt(tolerance * (2 * radius - tolerance)))
    chords = np.where(path.arc[rows], np.maximum(chords, 1), 1)
    half = np.where(path.arc[rows], 0.5 / chords, 0.0)
    cosine = _junction_cosine(path, rows, half)
    level = (path.planar[rows] / path.length[rows]) ** 2
    within = 1 - level * (1 - np.cos(turn / chords))
    along = _deviation_limit(within, acceleration, deviation)
    return _Limits(
        junction=_deviation_limit(cosine, acceleration, deviation),
        along=np.where(chords > 1, along, np.inf),
        acceleration=np.full(len(rows), acceleration),
    )


def _deviation_limit(cosine: FloatArray, acceleration: float, deviation: float) -> FloatArray:
    """Return the squares of the speeds at junctions with these cosines between directions."""
    sine_half = np.sqrt(np.clip((1 + cosine) / 2, 0, 1))
    limit = acceleration * deviation * sine_half / np.maximum(1 - sine_half, 1e-12)
    limit = np.where(cosine > _STRAIGHT, np.inf, limit)
    return np.asarray(np.where(cosine < -_STRAIGHT, 0.0, limit))


def _blend_limits(
    path: Path, rows: IntArray, speed: FloatArray, acceleration: float, tolerance: float
) -> _Limits:
    """Return the limits of corners rounded within a path tolerance.

    By the arc that leaves them by the tolerance and takes no more than half of either move; arcs
    have the share sqrt(3)/2 of the acceleration across, which leaves a half along at full speed. At
    tolerance 0 the machine stops at every corner (LinuxCNC, blendmath.c).
    """
    length = path.length[rows]
    radius = (path.start_radius[rows] + path.end_radius[rows]) / 2
    bent = path.arc[rows] & (radius > 0)
    level = (path.planar[rows] / length) ** 2
    curvature = np.where(bent, level / np.where(bent, radius, 1.0), 0.0)
    along = np.where(bent, _NORMAL * acceleration / np.where(bent, curvature, 1.0), np.inf)
    across = np.minimum(speed**2, along) * curvature / acceleration
    cosine = _junction_cosine(path, rows, np.zeros(len(rows)))
    sine_half = np.sqrt(np.clip((1 + cosine) / 2, 0, 1))
    tangent_half = sine_half / np.sqrt(np.maximum(1 - sine_half**2, 1e-12))
    room = np.minimum(length[:-1], length[1:]) / 2 * tangent_half
    blend = np.minimum(tolerance * sine_half / np.maximum(1 - sine_half, 1e-12), room)
    return _Limits(
        junction=np.where(cosine > _STRAIGHT, np.inf, _NORMAL * acceleration * blend),
        along=along,
        acceleration=acceleration * np.sqrt(np.maximum(1 - across**2, _TANGENTIAL**2)),
    )


def _junction_cosine(path: Path, rows: IntArray, inset: FloatArray) -> FloatArray:
    """Return the cosines between directions at junctions, taken at fractions inside the moves."""
    leave = _direction(path, rows, 1 - inset)[:-1]
    enter = _direction(path, rows, inset)[1:]
    return np.asarray(np.sum(leave * enter, axis=1))


def _direction(path: Path, rows: IntArray, fraction: FloatArray) -> FloatArray:
    """Return (m, 3) unit directions at fractions of moves."""
    flat = path.heading(rows, fraction)
    rise = (path.end[rows, 2] - path.begin[rows, 2]) / path.length[rows]
    return np.column_stack([flat * (path.planar[rows] / path.length[rows])[:, None], rise])
