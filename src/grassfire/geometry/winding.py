"""Winding numbers of exact curves, by pieces that are monotone in y."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from grassfire.errors import GeometryError
from grassfire.geometry.curve import Curve, FloatArray
from grassfire.geometry.loop import Loop

CHUNK = 4_000_000
"""Point-piece pairs looked at in one go."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A piece of a curve that is monotone in y, from t0 to t1."""

    curve: Curve
    t0: float
    t1: float


def _pairs(values: FloatArray) -> FloatArray:
    """Return (n, 2) rows of each value and the next around a loop.

    Neighbours share their vertex to the last bit, so no ray slips between them.
    """
    return np.stack([values, np.roll(values, -1)], axis=-1)


class MonotonePieces:
    """The loops' curves cut where y is stationary, with boxes that settle most queries.

    Parameters
    ----------
    loops : sequence of Loop
    """

    def __init__(self, loops: Sequence[Loop]) -> None:
        self._parts: list[_Part | None] = []
        corners: list[FloatArray] = []
        boxes: list[FloatArray] = []
        for loop in loops:
            if loop.vertices is None:
                chain, box = self._cut(loop)
            else:
                chain, box = _pairs(loop.vertices[:, 1]), _pairs(loop.vertices[:, 0])
                self._parts.extend([None] * len(chain))
            corners.append(chain)
            boxes.append(box)
        self._y = np.concatenate(corners)
        # Of a line, one without a part, x belongs to the heights; of others it is the range.
        self._line = np.array([part is None for part in self._parts])
        ends = np.concatenate(boxes)
        self._x, self._ends = np.sort(ends, axis=1), ends

    def _cut(self, loop: Loop) -> tuple[FloatArray, FloatArray]:
        """Add the parts of a loop; return their heights at both ends, and ranges of x."""
        vertices, boxes = [], []
        for curve in loop.curves:
            edges = np.unique(np.concatenate([curve.breaks(), curve.extrema(1)]))
            sides = np.unique(np.concatenate([edges, curve.extrema(0)]))
            places = curve.point(sides)
            for t0, t1 in pairwise(edges):
                self._parts.append(_Part(curve, float(t0), float(t1)))
                x = places[(sides >= t0) & (sides <= t1), 0]
                boxes.append([x.min(), x.max()])
            vertices.append(places[np.isin(sides, edges)][:-1])
        return _pairs(np.concatenate(vertices)[:, 1]), np.array(boxes)

    def winding(self, points: FloatArray) -> NDArray[np.int64]:
        """Return the winding number of the loops around each of the (n, 2) points."""
        if points.ndim != 2 or points.shape[1] != 2:
            raise GeometryError(f"points must have shape (n, 2), got {points.shape}")
        result = np.zeros(len(points), dtype=np.int64)
        step = max(1, CHUNK // len(self._parts))
        for start in range(0, len(points), step):
            result[start : start + step] = self._chunk(points[start : start + step])
        return result

    def _chunk(self, points: FloatArray) -> NDArray[np.int64]:
        x, y = points[:, :1], points[:, 1:]
        low, high = self._y.T
        upward = (low <= y) & (y < high)
        crossing = upward | ((high <= y) & (y < low))
        # A ray towards positive x meets the piece surely, or perhaps.
        sure = crossing & (x < self._x[:, 0])
        perhaps = crossing & ~sure & (x <= self._x[:, 1])
        rows, lines = np.nonzero(perhaps & self._line)
        start, end = self._ends[lines].T
        share = (y[rows, 0] - low[lines]) / (high[lines] - low[lines])
        sure[rows, lines] = (1.0 - share) * start + share * end > x[rows, 0]
        for number in np.flatnonzero((perhaps & ~self._line).any(axis=0)):
            rows = np.flatnonzero(perhaps[:, number])
            sure[rows, number] = self._crossing_x(int(number), y[rows, 0]) > x[rows, 0]
        return np.asarray((sure & upward).sum(axis=1) - (sure & ~upward).sum(axis=1))

    def _crossing_x(self, number: int, y: FloatArray) -> FloatArray:
        """Return x where piece `number` passes the heights y (n,).

        Regula falsi of the Illinois kind (Dowell & Jarratt 1971), halving every fourth step.
        """
        part = self._parts[number]
        assert part is not None
        rising = self._y[number, 1] > self._y[number, 0]
        low, high = np.full(len(y), part.t0), np.full(len(y), part.t1)
        below, above = self._y[number, 0] - y, self._y[number, 1] - y
        kept_low = np.zeros(len(y), dtype=np.int64)
        guess = 0.5 * (low + high)
        for turn in range(80):
            if turn % 4 != 3:
                slope = above - below
                share = np.where(slope != 0.0, -below / np.where(slope != 0.0, slope, 1.0), 0.5)
                trial = low + np.clip(share, 0.0, 1.0) * (high - low)
            else:
                trial = 0.5 * (low + high)
            if turn and np.all((trial == guess) | (high - low <= 1e-15)):
                break
            guess = trial
            value = part.curve.point(guess)[:, 1] - y
            beyond = (value > 0.0) == rising
            # An end that stays twice in a row has its value halved, so that it is let go.
            below = np.where(beyond & (kept_low > 0), 0.5 * below, below)
            above = np.where(~beyond & (kept_low < 0), 0.5 * above, above)
            kept_low = np.where(beyond, 1, -1)
            high, above = np.where(beyond, guess, high), np.where(beyond, value, above)
            low, below = np.where(beyond, low, guess), np.where(beyond, below, value)
        return np.asarray(part.curve.point(guess)[:, 0])
