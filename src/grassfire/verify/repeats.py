"""Passes that repeat one another at other depths: swept once, taken into the map for each of them.

Level moves that follow the same ways in the plane, in the same order, reach the same cells
after the same ways from their starts. The map of one pass therefore serves for the others: its
times are moved by what the path is longer up to there. What is not the same to the last bit of its
coordinates is swept by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grassfire.verify.model import FloatArray
from grassfire.verify.path import BoolArray, IntArray
from grassfire.verify.raster import Grid
from grassfire.verify.sweep import Pieces, lower

_SAME = 1e-9
"""Differences of path lengths by which runs of pieces count as equally far from one another, mm:
what rounding takes from their sums."""

_FEWEST = 100
"""Pieces that a pass must share with another one for a map of its own."""

_MISSES = 8
"""Bands in a row that have too little in common with one before it is given up."""

_SPREAD, _HALF = np.uint64(0x9E3779B97F4A7C15), np.uint64(32)
"""Odd number and shift that spread the bits of keys."""


@dataclass(frozen=True)
class Shared:
    """Pieces that several bands have in common.

    `rows` holds for each of these bands, deepest first, the (g,) rows of the pieces, in the same
    order and in that of time.
    """

    rows: dict[int, IntArray]

    @property
    def bands(self) -> list[int]:
        """The bands, deepest first."""
        return list(self.rows)


class Lowering:
    """Takes the pieces of one band after the other into the map of first cuts.

    Parameters
    ----------
    pieces : Pieces
    level : (k,) bool array
        Which of them are of level moves: those that passes may have in common.
    grid : Grid

    Attributes
    ----------
    shared : list of Shared
        What bands have in common; of no two is the map needed at the same time.
    """

    def __init__(self, pieces: Pieces, level: BoolArray, grid: Grid) -> None:
        self._pieces, self._grid = pieces, grid
        self.shared = _shared(pieces, level)
        self._map: FloatArray | None = None

    def lower(self, first_cut: FloatArray, rows: IntArray) -> None:
        """Take the pieces `rows`, all of one band, into the running minimum (flat, in place).

        Bands come deepest first.
        """
        band = int(self._pieces.band[rows[0]])
        shared = next((item for item in self.shared if band in item.rows), None)
        if shared is not None:
            own = shared.rows[band]
            np.minimum(first_cut, self._times(shared, band), out=first_cut)
            if band == shared.bands[-1]:
                self._map = None
            rows = np.setdiff1d(rows, own, assume_unique=True)
        lower(first_cut, self._pieces.take(rows), self._grid)

    def _times(self, shared: Shared, band: int) -> FloatArray:
        """Return (cells,) when the shared pieces first reach the cells in a band, else infinity."""
        since, first = self._pieces.since, shared.rows[shared.bands[0]]
        if self._map is None:
            self._map = np.full(self._grid.size, np.inf)
            lower(self._map, self._pieces.take(first), self._grid)
        shift = since[shared.rows[band]] - since[first]
        begins = np.flatnonzero(np.abs(np.diff(shift, prepend=np.inf)) > _SAME)
        if len(begins) == 1:
            return np.asarray(self._map + shift[0])
        # a time belongs to the last run that has begun by then
        run = np.searchsorted(since[first[begins]], self._map, side="right") - 1
        return np.asarray(self._map + shift[begins][run])


def _shared(pieces: Pieces, level: BoolArray) -> list[Shared]:
    """Return what bands have in common; of no two is the map needed at the same time."""
    every = np.flatnonzero(level)
    key = _keys(pieces, every)
    # pieces that no other has the like of are not looked at again
    order = np.argsort(key, kind="stable")
    like = key[order[1:]] == key[order[:-1]]
    twice = np.zeros(len(every), dtype=bool)
    twice[order[1:][like]] = twice[order[:-1][like]] = True
    every, key = every[twice], key[twice]
    band = pieces.band[every]
    parts = {int(number): np.flatnonzero(band == number) for number in np.unique(band)}
    parts = {number: part for number, part in parts.items() if len(part) >= _FEWEST}
    result: list[Shared] = []
    while parts:
        first = min(parts)
        common = parts.pop(first)
        found: dict[int, IntArray] = {}
        missed = 0
        for number in sorted(parts):
            mine, its = _in_common(pieces, every, key, common, parts[number])
            # one that has little in common with the others would leave them little
            most = max(len(parts[number]), len(common) if found else 0)
            if len(mine) >= max(_FEWEST, most / 2):
                found = {other: partner[mine] for other, partner in found.items()}
                common, found[number], missed = common[mine], parts[number][its], 0
                continue
            missed += 1
            if missed == _MISSES:
                break
        if found:
            found = {first: common, **found}
            result.append(Shared({number: every[part] for number, part in found.items()}))
            parts = {number: part for number, part in parts.items() if number > max(found)}
    return result


def _keys(pieces: Pieces, rows: IntArray) -> NDArray[np.uint64]:
    """Return numbers (k,) that are the same for pieces that are the same in the plane, and hardly
    ever for others."""
    columns = [*pieces.start[rows].T, *pieces.stop[rows].T, pieces.radius[rows]]
    key = pieces.fresh[rows].astype(np.uint64)
    for column in columns:
        key = (key ^ (key >> _HALF)) * _SPREAD + np.ascontiguousarray(column).view(np.uint64)
    return key


def _in_common(
    pieces: Pieces, every: IntArray, key: NDArray[np.uint64], one: IntArray, other: IntArray
) -> tuple[IntArray, IntArray]:
    """Return which of two sets of `every` piece are the same in the plane, in the order of both.

    Of pieces that occur several times in a set only the first counts.
    """
    _, mine, its = np.intersect1d(key[one], key[other], return_indices=True)
    order = np.argsort(mine)
    mine, its = mine[order], its[order]
    first, second = every[one[mine]], every[other[its]]
    same = np.all(pieces.start[first] == pieces.start[second], axis=1)
    same &= np.all(pieces.stop[first] == pieces.stop[second], axis=1)
    same &= pieces.radius[first] == pieces.radius[second]
    same &= pieces.fresh[first] == pieces.fresh[second]
    took = pieces.until - pieces.since
    same &= np.abs(took[first] - took[second]) <= _SAME
    mine, its = mine[same], its[same]
    kept = its == np.maximum.accumulate(its) if len(its) else same[:0]
    return mine[kept], its[kept]
