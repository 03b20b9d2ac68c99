"""Places in the plane and boxes round them, asked for what is near thousands of times."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry.neighbours import Neighbours
from grassfire.toolpath import FloatArray

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

Box = tuple[float, float, float, float]
"""Least x and y, largest x and y, mm."""


def box(points: FloatArray) -> Box:
    """Least x and y, largest x and y of points (n, 2), mm."""
    x, y = points[:, 0], points[:, 1]
    return float(x.min()), float(y.min()), float(x.max()), float(y.max())


class Places(Neighbours):
    """A tree of places (n, 2), mm, and the box round them."""

    @cached_property
    def box(self) -> Box:
        """Box of the places."""
        return box(self.points)

    def closest(self, others: FloatArray) -> tuple[FloatArray, IntArray]:
        """(n,) distances of other places (n, 2) from the nearest of these, mm, and its rows."""
        away, row = self.nearest(others)
        return away[:, 0], row[:, 0]


def few_nearest(points: FloatArray, place: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """Distances and rows of the few of points (n, 2) nearest to a place, nearest first."""
    offset = points - place
    away = np.hypot(offset[:, 0], offset[:, 1])
    rows = np.arange(len(away))
    if len(away) > count:
        rows = (away <= np.partition(away, count - 1)[count - 1]).nonzero()[0]
    rows = rows[away[rows].argsort(kind="stable")[:count]]
    return away[rows], rows
