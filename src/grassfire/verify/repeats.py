"""Passes that repeat one another at other depths: swept once, taken into the map for each of them.

Level moves that follow the same ways in the plane, in the same order, reach the same cells
after the same ways from their starts. The map of one pass therefore serves for the others: its
times are moved by what the path is longer up to there. What is not the same to the last bit of its
coordinates is swept by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grassfire.verify.model import FloatArray
from grassfire.verify.path import BoolArray, IntArray
from grassfire.verify.raster import Grid
from grassfire.verify.sweep import Pieces, lower

_SAME = 1e-9
"""Differences of path lengths by which runs of pieces count as equally far from one another, mm:
what rounding takes from their sums."""

_FEWEST = 100
"""Pieces that a pass must share with another one for a map of its own."""


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
    rows = {
        int(band): np.flatnonzero(level & (pieces.band == band))
        for band in np.unique(pieces.band[level])
    }
    result: list[Shared] = []
    while rows:
        first = min(rows)
        common = rows.pop(first)
        found: dict[int, IntArray] = {}
        for band in sorted(rows):
            mine, its = _in_common(pieces, common, rows[band])
            # one that has little in common with the others would leave them little
            most = max(len(rows[band]), len(common) if found else 0)
            if len(mine) < max(_FEWEST, most / 2):
                continue
            found = {other: partner[mine] for other, partner in found.items()}
            common, found[band] = common[mine], rows[band][its]
        if not found:
            continue
        result.append(Shared({first: common, **found}))
        rows = {band: value for band, value in rows.items() if band > max(found)}
    return result


def _in_common(pieces: Pieces, one: IntArray, other: IntArray) -> tuple[IntArray, IntArray]:
    """Return which of two sets of rows are the same pieces in the plane, in the order of both.

    Of pieces that occur several times in a set only the first counts.
    """
    rows = np.concatenate([one, other])
    table = np.column_stack(
        [pieces.start[rows], pieces.stop[rows], pieces.radius[rows], pieces.fresh[rows]]
    )
    order = np.lexsort(table.T)
    new = np.any(table[order[1:]] != table[order[:-1]], axis=1)
    label = np.empty(len(rows), dtype=np.int64)
    label[order] = np.cumsum(np.append(True, new)) - 1
    first = np.full((2, len(rows)), -1)
    for place, part in zip(first, (label[: len(one)], label[len(one) :]), strict=True):
        place[part[::-1]] = np.arange(len(part))[::-1]
    mine, its = first[:, np.all(first >= 0, axis=0)]
    order = np.argsort(mine)
    mine, its = mine[order], its[order]
    took = pieces.until - pieces.since
    kept = np.abs(took[one[mine]] - took[other[its]]) <= _SAME
    kept &= its == np.maximum.accumulate(its)
    return mine[kept], its[kept]
