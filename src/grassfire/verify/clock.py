"""Machining time under limited acceleration."""

from __future__ import annotations

import numpy as np

from grassfire.verify.model import FloatArray
from grassfire.verify.path import Path

_STRAIGHT = 0.999999
"""Cosine beyond which a junction counts as straight on, or as a reversal (grbl's planner)."""


def move_times(
    path: Path, *, rapid: float, acceleration: float, junction_deviation: float
) -> FloatArray:
    """Return the seconds that each move takes on a controller with a look-ahead planner.

    The model is the one of grbl's planner (Sonny Jeon, "Improving Grbl: cornering algorithm",
    2011): trapezoidal speed along each move; at a junction of unit directions with half angle h
    between them v^2 = a d sin(h) / (1 - sin(h)) for junction deviation d; arcs are further held
    to the centripetal limit v^2 = a r. The backward and forward passes over v^2 are running
    minima of v_k^2 +- 2 a S_k over the path length S, so that no loop over moves is needed.

    Parameters
    ----------
    path : Path
    rapid : float
        Speed of rapids, mm/min.
    acceleration : float
        mm/s2.
    junction_deviation : float
        mm.

    Returns
    -------
    (n,) array
        Seconds; 0 for moves of no length or from an unknown position. The machine stops at tool
        changes (ends of sections).
    """
    result = np.zeros(len(path))
    rows = np.flatnonzero(np.nan_to_num(path.length) > 1e-9)
    if not len(rows):
        return result
    length = path.length[rows]
    speed = np.where(path.rapid[rows], rapid, np.nan_to_num(path.feed[rows])) / 60.0
    speed = np.maximum(speed, 1.0 / 60.0)
    radius = (path.start_radius[rows] + path.end_radius[rows]) / 2
    bent = path.arc[rows] & (radius > 0)
    speed = np.where(bent, np.minimum(speed, np.sqrt(acceleration * radius)), speed)

    junction = np.zeros(len(rows) + 1)
    leave, enter = _direction(path, rows, 1.0)[:-1], _direction(path, rows, 0.0)[1:]
    cosine = np.sum(leave * enter, axis=1)
    sine_half = np.sqrt(np.clip((1 + cosine) / 2, 0, 1))
    corner = acceleration * junction_deviation * sine_half / np.maximum(1 - sine_half, 1e-12)
    corner = np.where(cosine > _STRAIGHT, np.inf, np.where(cosine < -_STRAIGHT, 0.0, corner))
    corner[path.section[rows][1:] != path.section[rows][:-1]] = 0.0
    junction[1:-1] = np.minimum(corner, np.minimum(speed[:-1], speed[1:]) ** 2)

    climb = np.concatenate([[0.0], np.cumsum(2 * acceleration * length)])
    squared = np.minimum.accumulate((junction + climb)[::-1])[::-1] - climb
    squared = np.minimum.accumulate(squared - climb) + climb
    node = np.sqrt(np.maximum(squared, 0.0))
    first, last = node[:-1], node[1:]
    peak = np.sqrt((2 * acceleration * length + first**2 + last**2) / 2)
    top = np.minimum(peak, speed)
    # The running sums cancel to ~1e-7 mm2/s2 on long programs: never let an end exceed the top.
    first, last = np.minimum(first, top), np.minimum(last, top)
    ramps = (2 * top**2 - first**2 - last**2) / (2 * acceleration)
    cruise = np.maximum(length - ramps, 0.0) / top
    result[rows] = (2 * top - first - last) / acceleration + cruise
    return result


def _direction(path: Path, rows: np.ndarray, fraction: float) -> FloatArray:
    """Return (m, 3) unit directions at the start (0) or the end (1) of moves."""
    flat = path.heading(rows, np.full(len(rows), fraction))
    rise = (path.end[rows, 2] - path.begin[rows, 2]) / path.length[rows]
    return np.column_stack([flat * (path.planar[rows] / path.length[rows])[:, None], rise])
