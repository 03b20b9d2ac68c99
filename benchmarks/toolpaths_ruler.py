"""Rulers for programs: a judge in a file of its own where there is one, else `toolpaths_raster`.

A judge is a Python file with ``measure(text, polygon, depth, radius, stepdown=...) -> dict`` that
machines the text on a raster in a function ``_sim``. The figures that it sums up are taken as they
are; how long the engagement stays above a limit, and where it is worst, comes from the very samples
that it took.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from toolpaths_moves import read_moves
from toolpaths_raster import measure_moves

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Engagement along the feed moves below the top that do not descend.

    Attributes
    ----------
    place : (n, 3) array
    angle : (n,) array
        Degrees.
    length : (n,) array
        Of path that a sample stands for, mm.
    follows : (n,) bool array
        Whether nothing lies between a sample and the one before it.
    """

    place: FloatArray
    angle: FloatArray
    length: FloatArray
    follows: NDArray[np.bool_]

    def longest(self, limit: float) -> float:
        """Longest stretch of path whose engagement is above `limit` degrees throughout, mm."""
        above = self.angle > limit
        if not above.any():
            return 0.0
        begins = above & ~(np.concatenate([[False], above[:-1]]) & self.follows)
        group = np.cumsum(begins)[above]
        return float(np.bincount(group, self.length[above]).max())

    def length_above(self, limit: float) -> float:
        """Length of all path whose engagement is above `limit` degrees, mm."""
        return float(self.length[self.angle > limit].sum())

    def worst(self) -> tuple[float, float, float]:
        """Place of the largest engagement."""
        x, y, z = self.place[int(np.argmax(self.angle))]
        return (float(x), float(y), float(z))


@dataclass(frozen=True)
class Ruling:
    """What a ruler says about a program."""

    figures: Mapping[str, Any]
    samples: Samples


def load_judge(path: Path) -> ModuleType:
    """The module of a judge; by its name, as compiled code is kept under it."""
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    return importlib.import_module(path.stem)


def rule_by_raster(
    text: str, polygon: shapely.Polygon, depth: float, radius: float, stepdown: float
) -> Ruling:
    """The ruler that comes with the benchmark."""
    figures, rows = measure_moves(read_moves(text), polygon, depth, radius, stepdown)
    return Ruling(figures, Samples(rows[:, 0:3], rows[:, 3], rows[:, 4], rows[:, 5] > 0.0))


def rule(
    judge: ModuleType,
    text: str,
    polygon: shapely.Polygon,
    depth: float,
    radius: float,
    stepdown: float,
) -> Ruling:
    """Let the judge measure, and keep the samples of its simulation."""
    simulate = judge._sim
    kept: list[tuple[tuple[Any, ...], tuple[Any, ...]]] = []

    def simulate_and_keep(*arguments: Any) -> Any:
        answer = simulate(*arguments)
        kept.append((arguments, answer))
        return answer

    judge._sim = simulate_and_keep
    try:
        figures = judge.measure(text, polygon, depth, radius, stepdown=stepdown)
    finally:
        judge._sim = simulate
    (_, _, _, _, moves, _, step, _, top, _), (angle, length, _, _) = kept[0]
    place, follows = _places(np.asarray(moves), step, top)
    if len(place) != len(angle):
        raise RuntimeError("the judge samples moves in another way than this ruler knows")
    return Ruling(figures, Samples(place, np.asarray(angle), np.asarray(length), follows))


def _places(moves: FloatArray, step: float, top: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Where the judge samples engagement: rows x0 y0 z0 x1 y1 z1 rapid feed, in equal steps."""
    delta = moves[:, 3:6] - moves[:, 0:3]
    run, rise = np.hypot(delta[:, 0], delta[:, 1]), np.abs(delta[:, 2])
    count = np.maximum(1, np.ceil(np.maximum(run, rise) / step)).astype(np.int64)
    row = np.repeat(np.arange(len(moves)), count)
    first = np.cumsum(count) - count
    share = (np.arange(len(row)) - first[row] + 1) / count[row]
    place = moves[row, 0:3] + delta[row] * share[:, None]
    taken = (moves[row, 6] == 0.0) & (run[row] > 1e-9) & (delta[row, 2] >= -1e-6)
    taken &= place[:, 2] < top
    follows = np.concatenate([[False], taken[:-1]])
    return place[taken], follows[taken]
