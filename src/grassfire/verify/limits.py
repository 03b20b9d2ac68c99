"""What the machine allows: travel of the axes, height of rapids."""

from __future__ import annotations

import numpy as np

from grassfire.verify.checks import Place, report_moves
from grassfire.verify.model import Fault, FloatArray, MachineLimits
from grassfire.verify.path import BELOW, IntArray, Path

_QUARTERS = np.radians([0.0, 90.0, 180.0, 270.0])
_SLACK = 1e-6
"""Coordinates this far outside the travel still count as on its edge, mm."""


def check_limits(path: Path, limits: MachineLimits, top: float) -> list[Fault]:
    """Return faults of moves outside the travel and of rapids that cross too low."""
    faults: list[Fault] = []
    if limits.travel is not None:
        faults += _check_travel(path, np.array(limits.travel, dtype=np.float64))
    if limits.rapid_height is not None:
        height = top + limits.rapid_height
        under = height - np.nan_to_num(np.fmin(path.begin[:, 2], path.end[:, 2]), nan=np.inf)
        # From an unknown place to a known one counts as travel.
        travel = np.where(np.isfinite(path.end[:, :2]).all(axis=1), path.planar, 0.0)
        moves = np.flatnonzero(path.rapid & ~(travel <= BELOW) & (under > BELOW))
        faults += report_moves(
            "rapid-height",
            path,
            moves,
            under[moves],
            lambda size: f"a rapid travels sideways {size:.3f} mm below the height for rapids",
        )
    return faults


def extents(path: Path) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest coordinates (n, 3) of each move; NaN where unknown."""
    low, high = np.fmin(path.begin, path.end), np.fmax(path.begin, path.end)
    radius = np.maximum(path.start_radius, path.end_radius)
    for quarter in _QUARTERS:
        # The arc passes the quarter point if that lies within its sweep.
        turn = (quarter - path.start_angle) * np.sign(path.sweep) % (2 * np.pi)
        rows = np.flatnonzero(path.arc & (turn <= np.abs(path.sweep)))
        for axis, share in enumerate((np.cos(quarter), np.sin(quarter))):
            value = path.centre[rows, axis] + radius[rows] * share
            low[rows, axis] = np.fmin(low[rows, axis], value)
            high[rows, axis] = np.fmax(high[rows, axis], value)
    return low, high


def _check_travel(path: Path, travel: FloatArray) -> list[Fault]:
    """Return faults of moves that leave the travel, (3, 2) in mm."""
    low, high = extents(path)
    over = np.concatenate([travel[:, 0] - low, high - travel[:, 1]], axis=1)
    over = np.nan_to_num(over, nan=-np.inf)
    worst = over.max(axis=1, initial=-np.inf)
    moves = np.flatnonzero(worst > _SLACK)

    def place_of(index: int) -> Place:
        return _farthest(path, moves[index : index + 1], int(np.argmax(over[moves[index]])))

    return report_moves(
        "travel",
        path,
        moves,
        worst[moves],
        lambda size: f"the move leaves the machine's travel by {size:.3f} mm",
        place_of,
    )


def _farthest(path: Path, move: IntArray, side: int) -> Place:
    """Return the place of a move that lies farthest to a side: low x, y, z, high x, y, z."""
    fraction = np.linspace(0, 1, 721)
    points = path.point(np.repeat(move, len(fraction)), fraction)
    points[-1] = path.end[move[0]]
    value = np.nan_to_num(points[:, side % 3] * (1 if side >= 3 else -1), nan=-np.inf)
    x, y, z = (float(item) for item in points[int(np.argmax(value))])
    return (x, y, z)
