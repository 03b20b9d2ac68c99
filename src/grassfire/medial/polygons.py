"""Closed polygons: where they cross or touch, and how they nest, on whole arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from grassfire.errors import GeometryError
from grassfire.medial.sites import FloatArray, IntArray

_BRANCHES: Final = 4
"""Boxes of a level that share one on the level above."""

_CHUNK: Final = 400_000
"""Pairs of boxes looked at in one go."""

_ROUNDING: Final = 3.4e-16
"""Rounding of a 2 x 2 determinant of differences, relative to its terms (Shewchuk 1997)."""


@dataclass(frozen=True)
class Polygons:
    """Closed polygons, one after the other.

    Attributes
    ----------
    point : (n, 2) float array
        Vertices, mm; row i is the start of side i.
    first : (k + 1,) int array
        Row of the first vertex of each polygon, and the total.
    """

    point: FloatArray
    first: IntArray

    @staticmethod
    def join(loops: Sequence[FloatArray]) -> Polygons:
        """From (n, 2) arrays of vertices, each closed by its first."""
        counts = [len(loop) for loop in loops]
        return Polygons(np.concatenate(loops), np.concatenate([[0], np.cumsum(counts)]))

    def __len__(self) -> int:
        return len(self.first) - 1

    @property
    def loop(self) -> IntArray:
        """(n,) polygon of each side."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))

    @property
    def following(self) -> IntArray:
        """(n,) next vertex along the polygon."""
        result = np.arange(1, len(self.point) + 1)
        result[self.first[1:] - 1] = self.first[:-1]
        return result


@dataclass(frozen=True)
class _Boxes:
    """Boxes along an axis of their own: centres (m, 2), unit axes (m, 2), half sizes (m, 2)."""

    centre: FloatArray
    axis: FloatArray
    half: FloatArray

    def __len__(self) -> int:
        return len(self.centre)

    def meeting(self, one: IntArray, two: IntArray) -> tuple[IntArray, IntArray]:
        """The pairs that no side of either box separates (Gottschalk et al. 1996)."""
        for across in (True, False):
            for turned in (False, True):
                first, second = (two, one) if turned else (one, two)
                axis, other = self.axis[first], self.axis[second]
                shift = self.centre[second] - self.centre[first]
                cosine, sine = np.abs(_dot(axis, other)), np.abs(_cross(axis, other))
                if across:
                    along, wide, parts = _cross(axis, shift), 1, (sine, cosine)
                else:
                    along, wide, parts = _dot(axis, shift), 0, (cosine, sine)
                reach = self.half[first, wide]
                reach = reach + parts[0] * self.half[second, 0] + parts[1] * self.half[second, 1]
                near = np.abs(along) <= reach
                one, two = one[near], two[near]
        return one, two


def check_simple(polygons: Polygons) -> None:
    """Refuse polygons that cross or touch themselves or one another.

    Boxes around runs of consecutive sides, turned to their main direction, tell which sides can
    meet; long thin teeth and needles have thin boxes, so that few sides are compared.

    Raises
    ------
    GeometryError
        With the place of one crossing.
    """
    start = polygons.point
    following = polygons.following
    end = start[following]
    _check_turns(polygons, following)
    levels = _levels(start, end)
    one, two = np.triu_indices(len(levels[-1]))
    stack: list[tuple[int, IntArray, IntArray]] = [(len(levels) - 1, one, two)]
    while stack:
        level, one, two = stack.pop()
        if level == 0:
            apart = (one != two) & (following[one] != two) & (following[two] != one)
            one, two = levels[0].meeting(one[apart], two[apart])
            _check_pairs(polygons, end, one, two)
            continue
        one, two = levels[level].meeting(one, two)
        one, two = _children(one, two, len(levels[level - 1]))
        for begin in range(0, len(one), _CHUNK):
            part = slice(begin, begin + _CHUNK)
            stack.append((level - 1, one[part], two[part]))


def _children(one: IntArray, two: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Pairs of boxes below pairs of boxes, each once."""
    branch = np.arange(_BRANCHES)
    first = (_BRANCHES * one[:, None, None] + branch[:, None]).repeat(_BRANCHES, axis=2).ravel()
    second = (_BRANCHES * two[:, None, None] + branch).repeat(_BRANCHES, axis=1).ravel()
    keep = (first <= second) & (second < count)
    return first[keep], second[keep]


def _levels(start: FloatArray, end: FloatArray) -> list[_Boxes]:
    """Boxes of single sides, of runs of four, sixteen and so on."""
    slack = 1e-14 * float(np.abs(start).max())
    along = end - start
    levels: list[_Boxes] = []
    size = 1
    while True:
        heads = np.arange(0, len(start), size)
        if size > 1:
            along = _main_direction(start, heads, size)
        length = np.hypot(along[:, 0], along[:, 1])[:, None]
        axis = np.where(length > 0, along / np.where(length > 0, length, 1.0), [1.0, 0.0])
        levels.append(_fit_boxes(start, end, heads, size, axis, slack))
        if len(heads) <= _BRANCHES:
            return levels
        size *= _BRANCHES


def _main_direction(point: FloatArray, heads: IntArray, size: int) -> FloatArray:
    """Main axis of inertia of each run of points; its length is 0 where there is none."""
    local = point - np.repeat(point[heads], size, axis=0)[: len(point)]
    place = local[:, 0] + 1j * local[:, 1]
    count = np.minimum(size, len(point) - heads)
    # The square of a complex number forgets its sign, so that both directions add up.
    spread = np.add.reduceat(place**2, heads) - np.add.reduceat(place, heads) ** 2 / count
    root = np.sqrt(spread)
    return np.stack([root.real, root.imag], axis=1)


def _fit_boxes(
    start: FloatArray, end: FloatArray, heads: IntArray, size: int, axis: FloatArray, slack: float
) -> _Boxes:
    direction = np.repeat(axis, size, axis=0)[: len(start)]
    low, high = np.empty((len(heads), 2)), np.empty((len(heads), 2))
    for column, project in enumerate((_dot, _cross)):
        one, two = project(direction, start), project(direction, end)
        low[:, column] = np.minimum.reduceat(np.minimum(one, two), heads)
        high[:, column] = np.maximum.reduceat(np.maximum(one, two), heads)
    middle = 0.5 * (low + high)
    across = np.stack([-axis[:, 1], axis[:, 0]], axis=1)
    centre = middle[:, :1] * axis + middle[:, 1:] * across
    return _Boxes(centre, axis, 0.5 * (high - low) + slack)


def _check_turns(polygons: Polygons, following: IntArray) -> None:
    """Refuse sides that run back over the one before."""
    corner = polygons.point[following]
    before, after = corner - polygons.point, polygons.point[following[following]] - corner
    turn = _sign(before, after)
    back = np.flatnonzero((turn == 0) & (_dot(before, after) < 0))
    if len(back):
        raise GeometryError("a loop of points turns back on itself", place=corner[back[0]].tolist())


def _check_pairs(polygons: Polygons, end: FloatArray, one: IntArray, two: IntArray) -> None:
    """Refuse sides without a common vertex that have a common point."""
    start = polygons.point
    a, b, c, d = start[one], end[one], start[two], end[two]
    near = np.all(
        (np.minimum(a, b) <= np.maximum(c, d)) & (np.minimum(c, d) <= np.maximum(a, b)), axis=1
    )
    one, two, a, b, c, d = one[near], two[near], a[near], b[near], c[near], d[near]
    meeting = (_sign(b - a, c - a) * _sign(b - a, d - a) <= 0) & (
        _sign(d - c, a - c) * _sign(d - c, b - c) <= 0
    )
    if not meeting.any():
        return
    row = int(np.flatnonzero(meeting)[0])
    loop = polygons.loop
    same = loop[one[row]] == loop[two[row]]
    raise GeometryError(
        "a loop of points crosses or touches itself"
        if same
        else "two loops of points cross or touch",
        place=_common_point(a[row], b[row], c[row], d[row]).tolist(),
        remedy="loops have to be simple and apart",
    )


def _common_point(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """A point that the segments ab and cd share."""
    before, after = float(_cross(d - c, a - c)), float(_cross(d - c, b - c))
    if before != after:
        share = np.clip(before / (before - after), 0.0, 1.0)
        return np.asarray(a + share * (b - a))
    # On one line: the second of the four in order lies on both.
    every = np.stack([a, b, c, d])
    return np.asarray(every[np.lexsort(every.T[::-1])[1]])


def depths(polygons: Polygons) -> IntArray:
    """(k,) number of other polygons around each; they are simple and apart."""
    result = np.zeros(len(polygons), dtype=np.int64)
    if len(polygons) == 1:
        return result
    start = polygons.point
    end = start[polygons.following]
    upward = (start[:, 1] < end[:, 1])[:, None]
    lower, upper = np.where(upward, start, end), np.where(upward, end, start)
    probe = start[polygons.first[:-1]]
    order = np.argsort(probe[:, 1], kind="stable")
    height = probe[order, 1]
    met = np.searchsorted(height, upper[:, 1]) - np.searchsorted(height, lower[:, 1])
    for part in np.array_split(order, int(met.sum()) // _CHUNK + 1):
        result[part] = _around(polygons, lower, upper, part, probe[part])
    return result


def _around(
    polygons: Polygons, lower: FloatArray, upper: FloatArray, own: IntArray, probe: FloatArray
) -> IntArray:
    """(m,) numbers of polygons around probes on the polygons `own`, ordered by y.

    By the sides that a ray towards positive x crosses: each meets the heights of a run of probes.
    """
    first = np.searchsorted(probe[:, 1], lower[:, 1])
    count = np.searchsorted(probe[:, 1], upper[:, 1]) - first
    side = np.repeat(np.arange(len(count)), count)
    row = np.arange(len(side)) - np.repeat(np.cumsum(count) - count - first, count)
    loop = polygons.loop[side]
    right = _cross(upper[side] - lower[side], probe[row] - lower[side]) > 0
    right &= loop != own[row]
    pair, crossings = np.unique(row[right] * len(polygons) + loop[right], return_counts=True)
    around = pair[crossings % 2 == 1] // len(polygons)
    return np.bincount(around, minlength=len(probe))


def _sign(one: FloatArray, two: FloatArray) -> IntArray:
    """(n,) signs of cross products; 0 where rounding decides."""
    first, second = one[:, 0] * two[:, 1], one[:, 1] * two[:, 0]
    value = first - second
    doubtful = np.abs(value) <= _ROUNDING * (np.abs(first) + np.abs(second))
    return np.where(doubtful, 0, np.sign(value)).astype(np.int64)


def _cross(one: FloatArray, two: FloatArray) -> FloatArray:
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])


def _dot(one: FloatArray, two: FloatArray) -> FloatArray:
    return np.asarray(one[..., 0] * two[..., 0] + one[..., 1] * two[..., 1])
