"""First-cut-time maps: when the tool first covers each cell, per height.

The moves are broken into pieces: straight chords (of arcs: within a tenth of a cell) that lie in
one band between two thresholds of height; runs of short level ones are swept as one chord. At
threshold h the time at which a cell is first cut to h or below is the minimum over all pieces in
bands up to h, so that going upwards one running minimum serves all thresholds and every piece is
expanded into cells once. A piece that continues the one before it adds only the crescent in front
of the disk where it starts, row by row; inside it the time of first contact has a closed form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grassfire.verify.model import FloatArray
from grassfire.verify.path import BoolArray, IntArray, Path, spread
from grassfire.verify.raster import Grid

_CHUNK = 1 << 18
"""Rows or cells that are expanded at once: a few MB of work space, near the size of the cache."""


_VERTICAL = 1e-9
"""Moves that travel no farther across are vertical, mm."""


@dataclass(frozen=True)
class Pieces:
    """Straight pieces of the path below the stock's top, in order of time; k rows.

    `start`, `stop` are (k, 2) in mm; `since`, `until` path lengths; `band` the index of the
    threshold that the piece reaches; `fresh` whether the disk at its start counts as newly cut.
    """

    move: IntArray
    start: FloatArray
    stop: FloatArray
    since: FloatArray
    until: FloatArray
    radius: FloatArray
    band: IntArray
    fresh: BoolArray

    def __len__(self) -> int:
        return len(self.move)

    def take(self, rows: NDArray[np.generic], fresh: bool = False) -> Pieces:
        """Return some of the pieces, on request all as fresh ones."""
        chosen = self.fresh[rows]
        return Pieces(
            move=self.move[rows],
            start=self.start[rows],
            stop=self.stop[rows],
            since=self.since[rows],
            until=self.until[rows],
            radius=self.radius[rows],
            band=self.band[rows],
            fresh=np.ones_like(chosen) if fresh else chosen,
        )


def _breakpoints(
    path: Path, moves: IntArray, thresholds: FloatArray, chord_error: float
) -> tuple[IntArray, FloatArray]:
    """Return (move, fraction) of all ends of pieces, sorted; every move has 0 and 1 among them."""
    radius = np.maximum(path.start_radius[moves], path.end_radius[moves])
    ratio = np.clip(1 - chord_error / np.maximum(radius, chord_error), -1, 1)
    step = np.where(path.arc[moves], 2 * np.arccos(ratio), np.inf)
    chords = np.maximum(1, np.ceil(np.abs(path.sweep[moves]) / step)).astype(np.int64)
    owner, index = spread(chords + 1)
    fraction = index / chords[owner]

    z0, z1 = path.begin[moves, 2], path.end[moves, 2]
    # A vertical move takes the same cells at every height: one piece, of its lower end, will do.
    sloped = (np.abs(z1 - z0) > 1e-9) & (path.planar[moves] > _VERTICAL)
    first = np.searchsorted(thresholds, np.minimum(z0, z1), side="right")
    last = np.searchsorted(thresholds, np.maximum(z0, z1), side="left")
    crossings = np.where(sloped, np.maximum(last - first, 0), 0)
    crossing, index = spread(crossings)
    height = thresholds[first[crossing] + index]
    cut = (height - z0[crossing]) / (z1 - z0)[crossing]

    owner = np.concatenate([owner, crossing])
    fraction = np.concatenate([fraction, cut])
    order = np.lexsort((fraction, owner))
    return owner[order], fraction[order]


def build_pieces(
    path: Path, thresholds: FloatArray, *, chord_error: float, rapid_clearance: float
) -> Pieces:
    """Return the pieces of all moves whose positions are known and reach below the top.

    Parameters
    ----------
    path : Path
    thresholds : (t,) array
        Ascending heights, mm; the last is the stock's top.
    chord_error : float
        Largest distance between the path and the pieces that stand for it, mm: chords of arcs, and
        runs of short level moves that are swept as one.
    rapid_clearance : float
        Rapids sweep a disk smaller than the tool by this much (mm), so that one that follows a
        wall just made does not count as cutting because of rounded coordinates.
    """
    top = thresholds[-1]
    moves = np.flatnonzero(path.known & (path.low <= top) & (path.length > 1e-9))
    owner, fraction = _breakpoints(path, moves, thresholds, chord_error)
    move = moves[owner]
    point = path.point(move, fraction)
    station = path.station[move] + fraction * path.length[move]
    same = (owner[1:] == owner[:-1]) & (fraction[1:] - fraction[:-1] > 1e-12)
    first = np.flatnonzero(same)
    height = _heights(path, move[first], point[first, 2], point[first + 1, 2])
    below = height <= top + 1e-9
    first, height = first[below], height[below]
    last = first + 1
    move = move[first]
    slack = np.where(
        path.rapid[move], np.minimum(rapid_clearance, 0.01 * path.tool_radius[move]), 0
    )
    band = np.searchsorted(thresholds, height - 1e-9).clip(0, len(thresholds) - 1)
    single = Pieces(
        move=move,
        start=point[first, :2],
        stop=point[last, :2],
        since=station[first],
        until=station[last],
        radius=path.tool_radius[move] - slack,
        band=band,
        fresh=np.ones(len(first), dtype=bool),
    )
    level = ~path.rapid[move] & (np.abs(point[first, 2] - point[last, 2]) < 1e-9)
    turn = np.abs(path.sweep[move]) * (fraction[last] - fraction[first])
    sagitta = np.maximum(path.start_radius, path.end_radius)[move] * (1 - np.cos(turn / 2))
    group = np.where(level, np.round(height, 9), np.nan)
    return joined(_merged(single, group, sagitta, chord_error))


def _heights(path: Path, move: IntArray, one: FloatArray, other: FloatArray) -> FloatArray:
    """Return (k,) heights that stand for pieces: of their middles; of vertical ones the lower end.

    `one` and `other` are the heights of their ends, mm.
    """
    vertical = path.planar[move] <= _VERTICAL
    return np.asarray(np.where(vertical, np.minimum(one, other), (one + other) / 2))


def joined(pieces: Pieces) -> Pieces:
    """Return the pieces with `fresh` off where the disk at the start has been swept already."""
    fresh = np.ones(len(pieces), dtype=bool)
    if len(pieces) > 1:
        follows = np.abs(pieces.since[1:] - pieces.until[:-1]) < 1e-9
        follows &= np.abs(pieces.start[1:] - pieces.stop[:-1]).max(axis=1) < 1e-9
        follows &= pieces.radius[:-1] >= pieces.radius[1:]
        fresh[1:] = ~(follows & (pieces.band[:-1] <= pieces.band[1:]))
    return replace(pieces, fresh=fresh)


def _merged(pieces: Pieces, group: FloatArray, error: FloatArray, tolerance: float) -> Pieces:
    """Return pieces that stand for runs of short ones, within `tolerance` mm of the path.

    Neighbours merge in pairs, again and again. With the joint a distance h from the new chord and
    the two chords within e and f of the path, the new chord is within max(e, f) + h of it.

    Parameters
    ----------
    pieces : Pieces
    group : (k,) array
        Only pieces with equal values merge, those with NaN never (height of level feed moves).
    error : (k,) array
        Distance of each piece from the path, mm.
    tolerance : float
    """
    idle = 0
    parity = 0
    while idle < 2 and len(pieces) > 1:
        left = np.arange(parity, len(pieces) - 1, 2)
        right = left + 1
        middle, chord = pieces.stop[left], pieces.stop[right] - pieces.start[left]
        squared = np.sum(chord**2, axis=1)
        some = np.where(squared > 0, squared, 1.0)
        way = middle - pieces.start[left]
        part = np.sum(way * chord, axis=1) / some
        height = np.abs(way[:, 0] * chord[:, 1] - way[:, 1] * chord[:, 0]) / np.sqrt(some)
        total = np.maximum(error[left], error[right]) + height
        good = (squared > 0) & (part >= 0) & (part <= 1) & (total <= tolerance)
        good &= (group[left] == group[right]) & (pieces.radius[left] == pieces.radius[right])
        good &= pieces.band[left] == pieces.band[right]
        good &= np.abs(pieces.since[right] - pieces.until[left]) < 1e-9
        good &= np.abs(pieces.start[right] - middle).max(axis=1) < 1e-9
        idle = 0 if good.any() else idle + 1
        parity = 1 - parity
        stop, until, error = pieces.stop.copy(), pieces.until.copy(), error.copy()
        stop[left[good]], until[left[good]] = stop[right[good]], until[right[good]]
        error[left[good]] = total[good]
        keep = np.ones(len(pieces), dtype=bool)
        keep[right[good]] = False
        rows = np.flatnonzero(keep)
        pieces = replace(pieces, stop=stop, until=until).take(rows)
        group, error = group[rows], error[rows]
    return pieces


def _chunks(pieces: Pieces, cell: float) -> Iterator[slice]:
    """Split pieces so that neither the rows nor the cells of one chunk exceed the work space."""
    travel = np.hypot(*(pieces.stop - pieces.start).T)
    rows = 2 * pieces.radius / cell + np.abs(pieces.stop - pieces.start)[:, 1] / cell + 2
    cells = 2 * pieces.radius * travel / cell**2
    cells = cells + np.where(pieces.fresh, np.pi * (pieces.radius / cell) ** 2, 0)
    total = np.cumsum(np.maximum(rows, cells))
    begin = 0
    while begin < len(pieces):
        base = total[begin - 1] if begin else 0.0
        end = max(begin + 1, int(np.searchsorted(total, base + _CHUNK)))
        yield slice(begin, end)
        begin = end


def expand(pieces: Pieces, grid: Grid) -> Iterator[tuple[IntArray, FloatArray, IntArray]]:
    """Yield (flat cell, path length at first contact, piece) of the cells that pieces reach.

    A cell may appear more than once. Memory is bounded; no cell outside the grid is named.
    """
    for part in _chunks(pieces, grid.cell):
        chosen = pieces.take(np.arange(part.start, part.stop))
        cells, contact, owner = _expand_chunk(chosen, grid)
        yield cells, contact, owner + part.start


def _expand_chunk(pieces: Pieces, grid: Grid) -> tuple[IntArray, FloatArray, IntArray]:
    """Expand a few pieces into cells: rows of capsules first, then the cells of each row."""
    cell, radius = grid.cell, pieces.radius
    delta = pieces.stop - pieces.start
    travel = np.hypot(delta[:, 0], delta[:, 1])
    heading = delta / np.where(travel > 0, travel, 1.0)[:, None]
    low = np.minimum(pieces.start[:, 1], pieces.stop[:, 1]) - radius
    high = np.maximum(pieces.start[:, 1], pieces.stop[:, 1]) + radius
    first = np.ceil((low - grid.y0) / cell - 0.5).clip(0, grid.rows).astype(np.int64)
    stop = (np.floor((high - grid.y0) / cell - 0.5) + 1).clip(0, grid.rows).astype(np.int64)
    owner, step = spread(np.maximum(stop - first, 0))
    row = first[owner] + step
    # From here x and y are relative to the piece's start.
    y = grid.y0 + (row + 0.5) * cell - pieces.start[owner, 1]
    left, right = _capsule_row(y, radius[owner], heading[owner], travel[owner])
    half = radius[owner] ** 2 - y**2
    covered = (half >= 0) & ~pieces.fresh[owner]
    half = np.sqrt(np.maximum(half, 0))
    offset = (pieces.start[owner, 0] - grid.x0) / cell - 0.5
    begin = np.ceil(offset + left / cell)
    end = np.floor(offset + right / cell) + 1
    inner_begin = np.where(covered, np.ceil(offset - half / cell), end)
    inner_end = np.where(covered, np.floor(offset + half / cell) + 1, end)
    spans_begin = np.concatenate([begin, inner_end]).clip(0, grid.columns).astype(np.int64)
    spans_end = np.concatenate([inner_begin, end]).clip(0, grid.columns).astype(np.int64)
    size = spans_end - spans_begin
    some = np.flatnonzero(size > 0)
    span = some % max(len(owner), 1)
    column, size = spans_begin[some], size[some]
    x = grid.x0 + (column + 0.5) * cell - pieces.start[owner[span], 0]
    time = _contact(pieces, owner[span], x, y[span], size, cell)
    base = row[span] * grid.columns + column - (np.cumsum(size) - size)
    cells = np.arange(len(time)) + np.repeat(base, size)
    return cells, time, np.repeat(owner[span], size)


def _contact(
    pieces: Pieces, owner: IntArray, x: FloatArray, y: FloatArray, size: IntArray, cell: float
) -> FloatArray:
    """Return when the disk first touches the cells of spans: `size` cells from (x, y) on.

    The place is relative to the piece's start. In the piece's own axes the cell lies at (along,
    across), and the front of the disk reaches it after along - sqrt(radius^2 - across^2).
    """
    delta = pieces.stop - pieces.start
    travel = np.hypot(delta[:, 0], delta[:, 1])
    some = np.where(travel > 0, travel, 1.0)
    ux, uy = (delta[:, 0] / some)[owner], (delta[:, 1] / some)[owner]
    step = np.arange(int(size.sum())) - np.repeat(np.cumsum(size) - size, size)
    across = step * np.repeat(cell * uy, size)
    across += np.repeat(x * uy - y * ux, size)
    np.square(across, out=across)
    squared = pieces.radius**2
    level = squared[0] if len(squared) and np.ptp(squared) == 0 else np.repeat(squared[owner], size)
    np.subtract(level, across, out=across)
    np.sqrt(np.maximum(across, 0, out=across), out=across)
    contact = np.asarray(step * np.repeat(cell * ux, size), dtype=np.float64)
    contact += np.repeat(x * ux + y * uy, size)
    contact -= across
    np.maximum(contact, 0, out=contact)
    rate = (pieces.until - pieces.since) / np.where(travel > 0, travel, np.inf)
    if np.ptp(rate) > 1e-12 or abs(rate[0] - 1) > 1e-12:
        contact *= np.repeat(rate[owner], size)
    contact += np.repeat(pieces.since[owner], size)
    return contact


def _capsule_row(
    y: FloatArray, radius: FloatArray, heading: FloatArray, travel: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the least and largest x of swept disks on the line at height y.

    The disk starts at the origin. Its extreme x on the line, as a function of the way s, is convex
    and stationary where the disk's normal there is perpendicular to the heading.
    """
    ux, uy = heading[:, 0], heading[:, 1]
    level = np.abs(uy) < 1e-12
    divisor = np.where(level, 1.0, uy)
    tilt = radius * ux * np.sign(uy)
    way_left = np.where(level, np.where(ux > 0, 0.0, travel), (y - tilt) / divisor)
    way_right = np.where(level, np.where(ux > 0, travel, 0.0), (y + tilt) / divisor)
    way_left, way_right = way_left.clip(0, travel), way_right.clip(0, travel)
    squared = radius**2
    left = way_left * ux - np.sqrt(np.maximum(squared - (y - way_left * uy) ** 2, 0))
    right = way_right * ux + np.sqrt(np.maximum(squared - (y - way_right * uy) ** 2, 0))
    return left, right


def lower(first_cut: FloatArray, pieces: Pieces, grid: Grid) -> None:
    """Take the pieces into the running minimum of the first cut's time (flat, in place)."""
    for cells, time, _ in expand(pieces, grid):
        np.minimum.at(first_cut, cells, time)


def removed_cells(first_cut: FloatArray, pieces: Pieces, path: Path, grid: Grid) -> FloatArray:
    """Return (n,) how many cells each move of the path was the first to cut at this threshold."""
    counts = np.zeros(len(path))
    for cells, _, owner in expand(pieces.take(np.arange(len(pieces)), fresh=True), grid):
        move = pieces.move[owner]
        time = first_cut[cells]
        own = (time >= path.station[move]) & (time <= path.station[move + 1])
        counts += np.bincount(move[own], minlength=len(path))
    return counts
