"""What is cut when: stock left standing, rapids and plunges through stock, engagement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from grassfire.verify.model import FloatArray, Target
from grassfire.verify.path import BoolArray, IntArray, Path, spread
from grassfire.verify.raster import Grid, cells_inside
from grassfire.verify.repeats import Lowering
from grassfire.verify.sweep import Pieces, build_pieces, expand, joined, removed_cells

_EDGE = 1e-6
"""Depth below the stock's top at which cutting begins, mm."""

_DESCENT = 0.02
"""Height from which on a fall begins another cut, mm."""

_SAMPLES = 1024
"""Samples that are looked at together: their rays fit into the cache."""

_MAX_LEVELS = 200
"""Thresholds that are kept apart; with more (a path that never stays level) they are merged."""

_ENGAGED = 30.0
"""Fast moves are looked at closely where more of the rim is in stock, degrees."""


@dataclass(frozen=True)
class Samples:
    """Positions along level or rising feed moves; m rows. `weight` is the length stood for, mm.

    `begun` is the station at which the tool came down before.
    """

    move: IntArray
    point: FloatArray
    heading: FloatArray
    station: FloatArray
    weight: FloatArray
    begun: FloatArray

    def take(self, rows: IntArray) -> Samples:
        """Return some of the samples."""
        return Samples(
            self.move[rows],
            self.point[rows],
            self.heading[rows],
            self.station[rows],
            self.weight[rows],
            self.begun[rows],
        )


@dataclass(frozen=True)
class Body:
    """A shank or holder: the moves on which it comes below the stock's top, radius and height
    above the tip in mm."""

    kind: str
    moves: IntArray
    radius: float
    length: float


@dataclass(frozen=True)
class Removal:
    """What the sweep found.

    `engagement`, `overload` (degrees of rim that meet stock thicker than the stepdown) are per
    sample; `removed` mm2 that each flagged move (rapid, steep descent or fast) cut first; `left`
    cells above each target's floor; `hits` (one (n,) array for each body) mm2 of standing stock
    that each move runs a shank or holder into.
    """

    samples: Samples
    engagement: FloatArray
    overload: FloatArray
    removed: FloatArray
    left: tuple[BoolArray, ...]
    height: FloatArray
    pieces: Pieces
    hits: tuple[FloatArray, ...]


def sample_moves(path: Path, top: float, spacing: float, cell: float) -> Samples:
    """Return samples at most `spacing` tool radii apart on feed moves that do not descend.

    Each move is sampled at the ends of equal parts and, because engagement jumps where the heading
    does, shortly after its start. Nothing is sampled more finely than the map, whose cells measure
    `cell` mm, can tell apart.
    """
    rising = path.end[:, 2] >= path.begin[:, 2] - 1e-6
    rows = np.flatnonzero(
        ~path.rapid & path.known & rising & (path.low < top - _EDGE) & (path.planar > 1e-9)
    )
    step = np.maximum(spacing * path.tool_radius[rows], cell)
    # A move that runs far off the map by mistake is sampled no more than a long good one.
    parts = np.ceil(path.planar[rows] / step).clip(1, 50_000).astype(np.int64)
    owner, index = spread(parts)
    fraction = (index + 1) / parts[owner]
    early = np.flatnonzero(path.planar[rows] > step / 2)
    move = np.concatenate([rows[owner], rows[early]])
    fraction = np.concatenate([fraction, (step / 6)[early] / path.planar[rows][early]])
    weight = np.concatenate([(path.planar[rows] / parts)[owner], np.zeros(len(early))])
    point = path.point(move, fraction)
    keep = np.flatnonzero(point[:, 2] < top - _EDGE)
    return Samples(
        move[keep],
        point[keep],
        path.heading(move[keep], fraction[keep]),
        path.station[move[keep]] + fraction[keep] * path.length[move[keep]],
        weight[keep],
        _descended(path)[move[keep]],
    )


def _descended(path: Path) -> FloatArray:
    """Return (n,) the station at which the last descent up to each move ended, 0 before the first.

    Moves that fall one after the other are one descent; small ones do not count.
    """
    fall = np.nan_to_num(path.begin[:, 2] - path.end[:, 2])
    total = np.cumsum(np.maximum(fall, 0.0))
    before = np.maximum.accumulate(np.where(fall > 0, 0.0, total))
    down = (fall > 0) & (total - before > _DESCENT)
    return np.asarray(np.maximum.accumulate(np.where(down, path.station[1:], 0.0)))


def rim_in_stock(
    first_cut: FloatArray, samples: Samples, radius: FloatArray, grid: Grid, step: float
) -> FloatArray:
    """Return (m,) degrees of the forward half of the rim that cut stock.

    A point of the rim cuts if there is stock just outside it and the cutter has just taken some
    just inside it. Outside (half a cell): the cell is first cut after the sample's time, less the
    cell size, within which the cut being made moves over the cell. Inside (a cell): it was first
    cut within the last one and a half radii of travel, and since the tool came down; without this a
    cutter that comes back to where it was, such as in the corner of a wall or one pass deeper,
    would count as cutting what it only touches.
    """
    offsets = np.radians(np.arange(-90 + step / 2, 90, step)).astype(np.float32)
    cosine, sine = np.cos(offsets), np.sin(offsets)
    result = np.zeros(len(samples.move))
    # Samples off the map are moved to its empty margin: there is no stock, there or here.
    inset = radius + 2 * grid.cell
    x_high = grid.x0 + grid.columns * grid.cell - inset
    y_high = grid.y0 + grid.rows * grid.cell - inset
    x = ((samples.point[:, 0].clip(grid.x0 + inset, x_high) - grid.x0) / grid.cell).astype("f4")
    y = ((samples.point[:, 1].clip(grid.y0 + inset, y_high) - grid.y0) / grid.cell).astype("f4")
    heading = samples.heading.astype(np.float32)
    outside = (radius / grid.cell + 0.5).astype(np.float32)
    inside = np.maximum(radius / grid.cell - 1.0, 0.0).astype(np.float32)
    now = samples.station - grid.cell
    recent = np.maximum(samples.station - 1.5 * radius - grid.cell, samples.begun)
    columns = np.int32(grid.columns)
    for begin in range(0, len(result), _SAMPLES):
        part = slice(begin, begin + _SAMPLES)
        ux, uy = heading[part, 0, None], heading[part, 1, None]
        across, along = ux * cosine - uy * sine, ux * sine + uy * cosine
        column = (x[part, None] + outside[part, None] * across).astype(np.int32)
        row = (y[part, None] + outside[part, None] * along).astype(np.int32)
        stock = first_cut.take(row * columns + column) > now[part, None]
        ray = stock.ravel().nonzero()[0]
        sample = ray // len(offsets)
        reach = inside[part].take(sample)
        column = (x[part].take(sample) + reach * across.ravel().take(ray)).astype(np.int32)
        row = (y[part].take(sample) + reach * along.ravel().take(ray)).astype(np.int32)
        cutting = first_cut.take(row * columns + column) > recent[part].take(sample)
        result[part] = np.bincount(sample[cutting], minlength=len(stock)) * step
    return result


def level_thickness(path: Path, operation: int, top: float) -> float:
    """Return the least distance between the levels on which an operation mostly cuts, mm."""
    level = (np.abs(path.end[:, 2] - path.begin[:, 2]) < 1e-9) & ~path.rapid
    rows = np.flatnonzero(level & (path.operation == operation) & (path.low < top - _EDGE))
    if not len(rows):
        return 0.0
    heights, index = np.unique(np.round(path.low[rows], 4), return_inverse=True)
    travel = np.bincount(index, weights=path.planar[rows])
    main = heights[travel >= 0.2 * travel.max()]
    return float(np.min(np.diff(np.append(main, top))))


def _choose_thresholds(values: Sequence[FloatArray], floors: FloatArray, top: float) -> FloatArray:
    """Return ascending heights at which the map is taken, the last just below the stock's top."""
    limit = top - _EDGE
    every = np.unique(np.round(np.concatenate([*values, floors]), 6))
    every = every[every < limit]
    if len(every) > _MAX_LEVELS:
        step = (limit - every[0]) / _MAX_LEVELS
        every = np.unique(every[0] + np.ceil((every - every[0]) / step) * step)
        every = np.union1d(every, np.round(floors, 6))
        every = every[every < limit]
    return np.append(every, limit)


@dataclass(frozen=True)
class SweepSettings:
    """How the sweep is judged: heights in mm, angles in degrees, `spacing` in tool radii."""

    top: float
    height_tolerance: float
    uncut_height: float
    rapid_clearance: float = 0.01
    spacing: float = 0.1
    angle_step: float = 2.0
    overload_step: float = 10.0


class Sweep:
    """One pass over the stock, from the deepest threshold upwards."""

    def __init__(
        self,
        path: Path,
        targets: Sequence[Target],
        grid: Grid,
        settings: SweepSettings,
        *,
        flagged: BoolArray,
        fast: BoolArray,
        thickness: FloatArray,
        stepdown: FloatArray,
        bodies: Sequence[Body] = (),
    ) -> None:
        """Prepare; `flagged`, `fast`, `thickness` and `stepdown` are per move."""
        self.path, self.targets, self.grid, self.settings = path, targets, grid, settings
        top, skin = settings.top, settings.height_tolerance
        self.flagged = np.flatnonzero(flagged & path.known & (path.low < top - _EDGE))
        self.samples = sample_moves(path, top, settings.spacing, grid.cell)
        sampled = np.unique(self.samples.move)
        level = sampled[np.abs(path.end[sampled, 2] - path.begin[sampled, 2]) < 1e-9]
        floors = np.array([t.floor + t.axial_allowance for t in targets]) + settings.uncut_height
        self.thresholds = _choose_thresholds(
            [
                path.low[level] + skin,
                path.low[self.flagged] + skin,
                path.low[level] + thickness[level],
                (path.low[level] + stepdown[level] + skin)[np.isfinite(stepdown[level])],
                *(path.low[item.moves] + item.length + skin for item in bodies),
            ],
            floors,
            top,
        )
        height = self.samples.point[:, 2]
        self.sample_band = self._band(height + thickness[self.samples.move])
        above = height + stepdown[self.samples.move] + skin
        self.overload_band = np.where(above < self.thresholds[-1], self._band(above), -1)
        self.flag_band = self._band(path.low[self.flagged] + skin)
        self.fast = np.flatnonzero(fast & path.known & (path.low < top - _EDGE))
        self.fast_band = self._band(path.low[self.fast] + thickness[self.fast])
        self.floor_band = self._band(floors)
        self.bodies = tuple(bodies)
        self.body_band = [self._band(path.low[i.moves] + i.length + skin) for i in bodies]
        self.pieces = build_pieces(
            path,
            self.thresholds,
            chord_error=0.1 * grid.cell,
            rapid_clearance=settings.rapid_clearance,
        )

    def _band(self, heights: FloatArray) -> IntArray:
        """Return the first threshold at or above each height, the top for those above it."""
        found = np.searchsorted(self.thresholds, heights - 2e-6)
        return np.asarray(found.clip(0, len(self.thresholds) - 1), dtype=np.int64)

    def _stock_by_floor(self) -> list[tuple[float, BoolArray]]:
        """Return (floor, cells of the regions that reach it), deepest first."""
        import shapely

        floors = sorted({item.floor for item in self.targets})
        result = []
        for floor in floors:
            own = [item.region for item in self.targets if item.floor == floor]
            result.append((floor, cells_inside(shapely.union_all(own), self.grid).ravel()))
        return result

    def run(self, demanded: Sequence[BoolArray]) -> Removal:
        """Machine the stock; `demanded` are flat masks of what each target's tool has to clear."""
        path, grid = self.path, self.grid
        # -1 marks cells without stock to judge: outside every region that is this deep.
        first_cut = np.full(grid.size, -1.0)
        pending = self._stock_by_floor()
        height = np.full(grid.size, self.settings.top)
        standing = np.zeros(grid.size, dtype=bool)
        engagement = np.zeros(len(self.samples.move))
        overload = np.zeros(len(self.samples.move))
        removed = np.zeros(len(path))
        hits = [np.zeros(len(path)) for _ in self.bodies]
        left: list[BoolArray] = [np.zeros(0, dtype=bool)] * len(self.targets)
        lowering = Lowering(self.pieces, self._level(self.pieces), grid)
        for band, threshold in enumerate(self.thresholds):
            while pending and (band == 0 or pending[0][0] <= threshold):
                _, inside = pending.pop(0)
                inside = inside & (first_cut < 0)
                first_cut[inside] = np.inf
                standing |= inside
                if pending and pending[0][0] > threshold:
                    break
            rows = np.flatnonzero(self.pieces.band == band)
            if len(rows):
                lowering.lower(first_cut, rows)
                fresh = np.flatnonzero(standing & np.isfinite(first_cut))
                self._lower_height(height, fresh, self.pieces.take(rows), first_cut)
                standing[fresh] = False
            self._look(band, first_cut, engagement, overload)
            self._count_removed(band, first_cut, removed, self.flagged[self.flag_band == band])
            engaged = self.samples.move[engagement > _ENGAGED]
            fast = np.intersect1d(self.fast[self.fast_band == band], engaged)
            self._count_removed(band, first_cut, removed, fast)
            self._count_hits(band, first_cut, hits)
            for index in np.flatnonzero(self.floor_band == band).tolist():
                left[index] = demanded[index] & ~np.isfinite(first_cut)
        removed *= grid.cell**2
        return Removal(
            self.samples,
            engagement,
            overload,
            removed,
            tuple(left),
            height,
            self.pieces,
            tuple(item * grid.cell**2 for item in hits),
        )

    def _level(self, pieces: Pieces) -> BoolArray:
        """Return (k,) which pieces are of level moves."""
        begin, end = self.path.begin[pieces.move, 2], self.path.end[pieces.move, 2]
        return np.asarray(np.abs(end - begin) < 1e-9)

    def _lower_height(
        self, height: FloatArray, fresh: IntArray, pieces: Pieces, first_cut: FloatArray
    ) -> None:
        """Set the height of the cells that this band is the deepest to reach.

        Level moves leave their height, sloped ones the height at which they first touch a cell,
        vertical ones that of their lower end.
        """
        path, end, level = self.path, self.path.end[pieces.move, 2], self._level(pieces)
        # Level moves in one band differ by less than the tolerance of heights; their mean serves.
        height[fresh] = end[level].mean() if level.any() else self.thresholds[pieces.band[0]]
        sloped = pieces.take(np.flatnonzero(~level))
        marked = np.zeros(self.grid.size, dtype=bool)
        marked[fresh] = True
        for cells, time, owner in expand(sloped, self.grid):
            own = marked[cells] & (first_cut[cells] == time)
            move = sloped.move[owner[own]]
            when = np.where(path.planar[move] > 0, time[own], sloped.until[owner[own]])
            part = ((when - path.station[move]) / path.length[move]).clip(0, 1)
            height[cells[own]] = path.begin[move, 2] + part * (
                path.end[move, 2] - path.begin[move, 2]
            )

    def _look(
        self, band: int, first_cut: FloatArray, engagement: FloatArray, overload: FloatArray
    ) -> None:
        """Measure the samples that look at this threshold."""
        for which, result, step in (
            (self.sample_band, engagement, self.settings.angle_step),
            (self.overload_band, overload, self.settings.overload_step),
        ):
            rows = np.flatnonzero(which == band)
            if len(rows):
                part = self.samples.take(rows)
                radius = self.path.tool_radius[part.move]
                result[rows] = rim_in_stock(first_cut, part, radius, self.grid, step)

    def _count_removed(
        self, band: int, first_cut: FloatArray, removed: FloatArray, moves: IntArray
    ) -> None:
        """Add the cells that moves judged at this threshold were the first to cut."""
        if not len(moves):
            return
        due = np.zeros(len(self.path), dtype=bool)
        due[moves] = True
        rows = np.flatnonzero(due[self.pieces.move] & (self.pieces.band <= band))
        if len(rows):
            removed += removed_cells(first_cut, self.pieces.take(rows), self.path, self.grid)

    def _count_hits(self, band: int, first_cut: FloatArray, hits: list[FloatArray]) -> None:
        """Add the cells whose stock reaches above a body's lower end when the body comes.

        The body counts as smaller by a cell, so that rounding to cells is not taken for contact.
        """
        for body, own, result in zip(self.bodies, self.body_band, hits, strict=True):
            moves = body.moves[own == band]
            radius = body.radius - self.grid.cell
            if not len(moves) or radius <= self.path.tool_radius[moves].max():
                continue
            due = np.zeros(len(self.path), dtype=bool)
            due[moves] = True
            pieces = self._lowest_pieces(due, radius)
            # Straight down, the body comes when the move ends.
            down = self.path.planar[pieces.move] < 1e-9
            for cells, time, owner in expand(pieces, self.grid):
                when = np.where(down[owner], pieces.until[owner], time)
                standing = first_cut[cells] > when + self.grid.cell
                result += np.bincount(pieces.move[owner[standing]], minlength=len(self.path))

    def _lowest_pieces(self, due: BoolArray, radius: float) -> Pieces:
        """Return the lowest pieces of the moves that are due, of another radius.

        Each move begins with the whole disk and goes on with crescents.
        """
        pieces = self.pieces.take(np.flatnonzero(due[self.pieces.move]))
        lowest = np.full(len(self.path), np.iinfo(np.int64).max)
        np.minimum.at(lowest, pieces.move, pieces.band)
        pieces = pieces.take(np.flatnonzero(pieces.band == lowest[pieces.move]))
        pieces = joined(replace(pieces, radius=np.full(len(pieces), radius)))
        begins = np.append(True, pieces.move[1:] != pieces.move[:-1])[: len(pieces)]
        return replace(pieces, fresh=pieces.fresh | begins)
