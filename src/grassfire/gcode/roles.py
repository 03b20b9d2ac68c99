"""What moves of a program are for, as far as its text tells.

A program says where the tool goes and how fast, not why. What can be told from that, and nothing
more, becomes a role:

- ENTRY: feed moves that go down.
- LINK: feed moves that go up, and level ones between a rise and a fall that leads at least as far
  down again: the tool is lifted there.
- CUT: all others. Where a program rises and falls along its way at the feed of its cuts (carving),
  only what is steeper than 30 degrees is told to be an entry or a link.

Passes along the wall and leads look like any other cut; they stay CUT.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..toolpath import FloatArray, MoveKind, Role, Toolpath

BoolArray = NDArray[np.bool_]

_STEEP = np.tan(np.radians(30.0))


def roles_of(toolpath: Toolpath) -> NDArray[np.uint8]:
    """(n,) role of each move."""
    count = len(toolpath)
    role = np.full(count, Role.CUT, dtype=np.uint8)
    if not count:
        return role
    rapid = toolpath.kind == MoveKind.RAPID
    rise = np.nan_to_num(toolpath.end[:, 2] - toolpath.begin[:, 2])
    planar = np.sqrt(np.maximum(np.nan_to_num(toolpath.length) ** 2 - rise**2, 0.0))
    down, up = ~rapid & (rise < 0), ~rapid & (rise > 0)
    level = ~rapid & (rise == 0)
    main = _main_feed(toolpath.feed, planar, level)
    # Carving goes up and down along its way at the feed of cuts; only steep moves are told then.
    sloped = (up | down) & (np.abs(rise) < _STEEP * planar) & (toolpath.feed == main)
    carving = _share(planar, sloped & up) > 0.05
    plain = np.abs(rise) >= _STEEP * planar if carving else np.ones(count, dtype=bool)
    entry = down & plain
    link = up & plain
    if not carving:
        link |= _lifted(toolpath, level, up, down)
    role[entry], role[link], role[rapid] = Role.ENTRY, Role.LINK, Role.RAPID
    return role


def _main_feed(feed: FloatArray, planar: FloatArray, level: BoolArray) -> float:
    """Feed at which most of the level way is made, mm/min; NaN without level moves."""
    if not level.any():
        return float("nan")
    values, owner = np.unique(feed[level], return_inverse=True)
    return float(values[int(np.argmax(np.bincount(owner, weights=planar[level])))])


def _share(planar: FloatArray, some: BoolArray) -> float:
    total = float(planar.sum())
    return float(planar[some].sum()) / total if total > 0 else 0.0


def _lifted(toolpath: Toolpath, level: BoolArray, up: BoolArray, down: BoolArray) -> BoolArray:
    """(n,) level moves between a rise and a fall to no more than the height before the rise."""
    index = np.arange(len(level))
    before = np.maximum.accumulate(np.where(level, -1, index))
    after = np.minimum.accumulate(np.where(level, len(level), index)[::-1])[::-1]
    inner = np.flatnonzero(level & (before >= 0) & (after < len(level)))
    rise, fall = before[inner], after[inner]
    height_before, height_after = toolpath.begin[rise, 2], toolpath.end[fall, 2]
    result = np.zeros(len(level), dtype=bool)
    result[inner] = up[rise] & down[fall] & (height_after <= height_before)
    return result
