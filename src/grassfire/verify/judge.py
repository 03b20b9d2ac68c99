"""Machines a program as it was written and judges what comes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Unpack

import numpy as np

from grassfire.errors import InputError
from grassfire.toolpath import Program
from grassfire.verify.body import check_bodies, find_bodies
from grassfire.verify.checks import (
    Place,
    check_floor,
    check_moves,
    check_sections,
    check_walls,
    report_moves,
)
from grassfire.verify.clock import Clock, move_times
from grassfire.verify.counts import count_moves
from grassfire.verify.limits import check_limits
from grassfire.verify.model import (
    Fault,
    FloatArray,
    HeightMap,
    MachineLimits,
    OperationResult,
    Target,
    Tolerances,
    Verification,
)
from grassfire.verify.path import BoolArray, IntArray, Path, assign, flatten_program
from grassfire.verify.raster import Grid, cells_inside, choose_grid
from grassfire.verify.removal import Removal, Sweep, SweepSettings, level_thickness

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

_QUADRANT_SEGMENTS = 64
"""Chords in a quarter turn of the reachable region's rounded corners."""

_SLIVER = 0.5
"""Stock thicker than the stepdown may be met over so much area in an operation, mm2."""


_SLIVER_WIDTH = 0.05
"""Widest sliver that moves at raised feed may take on their way, as a part of the tool radius."""

_NARROWER, _OUTLINE, _SEEN = 1.5e-4, 5e-5, 1e-3
"""How much narrower than the tool, on either side, places may be that it has to clear, mm: rounding
of a slot that is drawn as wide as the tool; how far outlines may be simplified for that; and by how
much narrower a tool slots and holes are seen that have no area for it."""

_POINT = 0.02
"""Positions of the tool within so much of each other are one place, mm: only a plunge enters it."""


@dataclass(frozen=True)
class _Reach:
    """What the tool of one target can reach: areas in mm2, cells that it has to clear."""

    area: float
    unreachable: float
    demanded: BoolArray


def verify(
    program: Program,
    targets: Sequence[Target],
    *,
    limits: MachineLimits = MachineLimits(),  # noqa: B008  (frozen)
    fitting_tolerance: float = 0.002,
    floor_tolerance: float = 0.0015,
    tolerances: Tolerances = Tolerances(),  # noqa: B008  (frozen)
    stock_top: float | None = None,
    **clock: Unpack[Clock],
) -> Verification:
    """Machine a program that was read back from its text, and judge it.

    Walls, floor and lengths are exact; uncut area, rapids and plunges through stock and engagement
    come from first-cut-time maps whose cell is stated in the result. Tools are flat cutters.

    Parameters
    ----------
    program : Program
    targets : sequence of Target
        At least one for each operation of the program.
    limits : MachineLimits
        Travel and height of rapids.
    fitting_tolerance : float
        How far curves were allowed to deviate when they were fitted, mm: added to the gouge
        tolerance where a radial allowance is cut into, and not demanded of the reachable area.
    floor_tolerance : float
        How far below the floor, mm; by default what rounding to four decimals of an inch takes.
    tolerances : Tolerances
    stock_top : float, optional
        z of the stock's top, mm; by default the highest of the targets.
    **clock
        rapid, acceleration, and what else `move_times` takes.

    Raises
    ------
    InputError
        If there is no target, a section of the program belongs to none, or a speed is not positive.
    """
    wanted = tuple(targets)
    if not wanted:
        raise InputError("nothing to verify against: no target was given")
    path, served = flatten_program(program, wanted), assign(program, wanted)
    top = max(item.stock_top for item in wanted) if stock_top is None else stock_top
    per_move = _PerMove(path, wanted, served)
    faults = check_moves(path, top, per_move.max_feed)
    faults += check_limits(path, limits, top)
    faults += check_sections(program, path, served, wanted, top)
    faults += check_floor(path, per_move.floor, per_move.axial_allowance, floor_tolerance)
    gouge, found = check_walls(
        path,
        wanted,
        per_move.radial_allowance,
        top=top,
        gouge_tolerance=tolerances.gouge,
        floor_tolerance=floor_tolerance,
        fitting_tolerance=fitting_tolerance,
    )
    machining = _Machining(path, wanted, served, per_move, top, tolerances, fitting_tolerance)
    return machining.judged(move_times(path, **clock), gouge, faults + found)


class _Machining:
    """What the maps tell of a program: stock left, rapids and plunges through stock, engagement."""

    def __init__(
        self,
        path: Path,
        targets: tuple[Target, ...],
        served: Sequence[Target],
        per_move: _PerMove,
        top: float,
        tolerances: Tolerances,
        fitting_tolerance: float,
    ) -> None:
        """Machine the stock; the arguments are as in `verify`."""
        self._path, self._targets, self._per_move = path, targets, per_move
        self._top, self._tolerances = top, tolerances
        self._grid = _grid_for(path, targets, tolerances.resolution, tolerances.max_cells)
        descent = path.begin[:, 2] - path.end[:, 2]
        self._steep = ~path.rapid & (np.arctan2(descent, path.planar) > tolerances.ramp_angle)
        self._fast = ~path.rapid & (path.feed > per_move.cutting_feed)
        self._bodies = find_bodies(path, served, top)
        thickness = _thickness(
            path, targets, per_move.stepdown, top, tolerances.engagement_thickness
        )
        sweep = Sweep(
            path,
            targets,
            self._grid,
            SweepSettings(top, tolerances.height, tolerances.uncut_height),
            flagged=path.rapid | self._steep,
            fast=self._fast & ~self._steep,
            thickness=np.maximum(thickness, tolerances.height),
            stepdown=per_move.stepdown,
            bodies=self._bodies,
        )
        self._reach = [_reach_of(item, self._grid, fitting_tolerance) for item in targets]
        self._removal = sweep.run([item.demanded for item in self._reach])

    def judged(self, seconds: FloatArray, gouge: FloatArray, faults: list[Fault]) -> Verification:
        """Return the verdict, with the (n,) time and gouge of moves and the faults found so far."""
        path, targets, asked, reach = self._path, self._targets, self._per_move, self._reach
        removal, top, grid, tolerances = self._removal, self._top, self._grid, self._tolerances
        cuts = removal.removed > _let_pass(path, self._steep, grid)
        hit = path.rapid & cuts
        plunging = self._steep & cuts & ~asked.may_plunge
        found = _check_descents(path, hit, plunging, top)
        found += _fast_cuts(path, removal, self._fast & cuts & ~plunging)
        allowance = asked.radial_allowance
        found += check_bodies(path, self._bodies, removal.hits, targets, allowance, top)
        found += _check_load(path, removal, asked.engagement_limit + tolerances.engagement)
        uncut, left = _check_uncut(path, targets, reach, removal, grid, tolerances)
        operations = tuple(
            _figures(index, path, targets, reach, uncut, gouge, hit, removal, seconds, top)
            for index in sorted({item.operation for item in targets})
        )
        height = removal.height.reshape(grid.rows, grid.columns)
        return Verification(
            operations=operations,
            faults=tuple(faults + found + left),
            resolution=grid.cell,
            height_map=HeightMap((grid.x0, grid.y0), grid.cell, height),
            time_s=float(seconds.sum()),
        )


class _PerMove:
    """What the targets ask for, spread over the moves: (n,) arrays."""

    def __init__(self, path: Path, targets: Sequence[Target], served: Sequence[Target]) -> None:
        section = path.section

        def spread_over(values: list[float]) -> FloatArray:
            return np.asarray(np.array(values, dtype=np.float64)[section], dtype=np.float64)

        def limit(value: float | None) -> float:
            return math.inf if value is None else value

        def same(target: Target) -> list[Target]:
            return [item for item in targets if item.operation == target.operation]

        self.floor = spread_over([min(i.floor for i in same(t)) for t in served])
        self.axial_allowance = spread_over([t.axial_allowance for t in served])
        self.radial_allowance = spread_over([t.radial_allowance for t in served])
        # What is thicker than the flutes are long meets the shank.
        self.stepdown = spread_over([min(limit(t.stepdown), limit(t.flute_length)) for t in served])
        self.engagement_limit = spread_over([limit(t.engagement_limit) for t in served])
        self.max_feed = spread_over([limit(t.max_feed) for t in served])
        self.cutting_feed = spread_over([limit(t.cutting_feed) for t in served])
        self.may_plunge = spread_over([float(t.entry == "plunge") for t in served]) > 0


def _grid_for(
    path: Path, targets: Sequence[Target], resolution: float | None, max_cells: int
) -> Grid:
    """Return the cells for these regions and tools."""
    import shapely

    x0, y0, x1, y1 = shapely.total_bounds([item.region for item in targets])
    radii = [item.tool_radius for item in targets]
    largest = max([*radii, float(path.tool_radius.max(initial=0.0))])
    bounds = (float(x0), float(y0), float(x1), float(y1))
    return choose_grid(bounds, min(radii), largest, resolution, max_cells)


def _thickness(
    path: Path,
    targets: Sequence[Target],
    stepdown: FloatArray,
    top: float,
    given: float | None,
) -> FloatArray:
    """Return for each move the thickness below which stock does not count as engaged, mm."""
    if given is not None:
        return np.full(len(path), given)
    result = np.zeros(len(path))
    for operation in {item.operation for item in targets}:
        rows = path.operation == operation
        level = level_thickness(path, operation, top)
        result[rows] = 0.3 * np.where(np.isfinite(stepdown[rows]), stepdown[rows], level)
    return result


def _reach_of(target: Target, grid: Grid, fitting_tolerance: float) -> _Reach:
    """Return what the tool can reach: the region opened by its disk.

    Unless the operation may plunge, places where it can do nothing else are not demanded. The cells
    demanded keep clear of the edge by what fitting and the sweep's chords may take, so that no
    sliver is blamed on the program that is theirs.
    """
    import shapely

    radius, segments = target.tool_radius, _QUADRANT_SEGMENTS
    region = shapely.simplify(target.region, _OUTLINE)
    fitting = radius - _NARROWER

    def opened(centres: BaseGeometry) -> float:
        return float(centres.buffer(fitting, quad_segs=segments).area)

    bare = centres = _eroded(region, fitting)
    if target.radial_allowance > 0:
        centres = _eroded(region, fitting + target.radial_allowance)
    margin = 2 * fitting_tolerance + 0.2 * grid.cell
    sure = _entered(centres, target.entry)
    sure = sure.buffer(max(fitting - margin, 0.5 * radius), quad_segs=segments)
    unreachable = max(target.region.area - opened(bare), 0.0)
    return _Reach(opened(centres), unreachable, cells_inside(sure, grid).ravel())


def _eroded(region: BaseGeometry, distance: float) -> BaseGeometry:
    """Return the places in a region that are at least so far from its boundary, mm."""
    import shapely

    parts = shapely.get_parts(region)
    eroded = shapely.buffer(parts, -distance, quad_segs=_QUADRANT_SEGMENTS)
    # points and lines, and what is hardly more, are lost in that
    lost = np.flatnonzero(shapely.is_empty(eroded))
    widest = shapely.maximum_inscribed_circle(parts[lost], tolerance=_NARROWER / 4)
    lost = lost[shapely.length(widest) >= distance]
    eroded[lost] = shapely.buffer(parts[lost], _SEEN - distance, quad_segs=_QUADRANT_SEGMENTS)
    return shapely.union_all(eroded)


def _entered(centres: BaseGeometry, entry: str) -> BaseGeometry:
    """Return the positions of the tool without the places that the entry cannot enter."""
    import shapely

    if entry == "plunge":
        return centres
    parts = shapely.get_parts(centres)
    low_x, low_y, high_x, high_y = shapely.bounds(parts).reshape(-1, 4).T
    wide = np.maximum(high_x - low_x, high_y - low_y) >= _POINT
    return shapely.MultiPolygon(parts[wide].tolist())


def _let_pass(path: Path, steep: BoolArray, grid: Grid) -> FloatArray:
    """Return (n,) what area in mm2 a move may cut by the way: a rapid, a descent, a fast move."""
    squared = path.tool_radius**2
    sliver = _SLIVER_WIDTH * path.tool_radius * (path.planar + path.tool_radius)
    area = np.where(steep, np.maximum(0.02 * squared, 0.05), sliver)
    return np.where(path.rapid, 0.005 * squared, area) + 2 * grid.cell**2


def _check_descents(path: Path, hit: BoolArray, plunging: BoolArray, top: float) -> list[Fault]:
    """Return the faults of rapids and plunges through stock."""
    depth = top - np.nan_to_num(path.low, nan=np.inf)
    moves = np.flatnonzero(hit)
    faults = report_moves(
        "rapid-in-stock",
        path,
        moves,
        depth[moves],
        lambda size: f"a rapid runs through stock, down to {size:.3f} mm below its top",
    )
    moves = np.flatnonzero(plunging)
    fall = np.minimum(path.begin[:, 2], top) - path.end[:, 2]
    faults += report_moves(
        "plunge",
        path,
        moves,
        fall[moves],
        lambda size: f"a descent of {size:.3f} mm through stock, too steep for a ramp",
    )
    return faults


def _fast_cuts(path: Path, removal: Removal, fast: BoolArray) -> list[Fault]:
    """Return the faults of moves at raised feed that cut."""
    moves = np.flatnonzero(fast)
    return report_moves(
        "fast-cut",
        path,
        moves,
        removal.removed[moves],
        lambda size: f"a move faster than the feed of cuts takes {size:.3f} mm2 of stock",
    )


def _check_load(path: Path, removal: Removal, limits: FloatArray) -> list[Fault]:
    """Return faults of engagement beyond the limit and of cuts thicker than the stepdown."""
    samples, faults = removal.samples, []
    for kind, angle, limit, describe in (
        (
            "engagement",
            removal.engagement,
            limits[samples.move],
            "the cutter is engaged over {:.0f} degrees",
        ),
        (
            "stepdown",
            removal.overload,
            np.full(len(samples.move), 25.0),
            "stock thicker than the stepdown meets {:.0f} degrees of the cutter",
        ),
    ):
        rows = np.flatnonzero(angle > limit)
        if kind == "stepdown":
            rows = _of_some_area(path, removal, rows)
        points = samples.point[rows]

        def place_of(index: int, points: FloatArray = points) -> Place:
            x, y, z = (float(value) for value in points[index])
            return (x, y, z)

        moves = samples.move[rows]
        faults += report_moves(kind, path, moves, angle[rows], describe.format, place_of)
    return faults


def _of_some_area(path: Path, removal: Removal, rows: IntArray) -> IntArray:
    """Return the overloaded samples of operations whose overload takes more than a sliver.

    Over a way s, an engagement of angle e takes s R (1 - cos e).
    """
    samples = removal.samples
    move, angle = samples.move[rows], np.radians(removal.overload[rows])
    area = samples.weight[rows] * path.tool_radius[move] * (1 - np.cos(angle))
    operation, index = np.unique(path.operation[move], return_inverse=True)
    total = np.bincount(index, weights=area, minlength=len(operation))
    return np.asarray(rows[total[index] > _SLIVER])


def _check_uncut(
    path: Path,
    targets: Sequence[Target],
    reach: Sequence[_Reach],
    removal: Removal,
    grid: Grid,
    tolerances: Tolerances,
) -> tuple[list[float], list[Fault]]:
    """Return the uncut area of each target in mm2, and the faults."""
    areas, faults = [], []
    for target, reached, left in zip(targets, reach, removal.left, strict=True):
        area = float(np.count_nonzero(left)) * grid.cell**2
        areas.append(area)
        if not area:
            continue
        largest, x, y = _largest_patch(left, grid)
        if area <= tolerances.uncut_fraction * reached.area and largest <= tolerances.uncut_patch:
            continue
        message = (
            f"{area:.3f} mm2 of what the tool can reach ({100 * area / reached.area:.2f} %) is "
            f"left above the floor; the largest patch has {largest:.3f} mm2"
        )
        line = _nearest_line(path, target, removal, x, y)
        place = (x, y, target.floor + target.axial_allowance)
        faults.append(Fault("uncut", line, place, area, message, target.operation))
    return areas, faults


def _largest_patch(left: BoolArray, grid: Grid) -> tuple[float, float, float]:
    """Return area (mm2) and place (x, y) of the largest connected patch of marked cells."""
    # Late: good programs leave nothing, and need not wait for this import.
    from scipy import ndimage

    label, _ = ndimage.label(left.reshape(grid.rows, grid.columns), structure=np.ones((3, 3)))
    size = np.bincount(label.ravel())
    size[0] = 0
    largest = int(np.argmax(size))
    rows, columns = np.nonzero(label == largest)
    # The cell of the patch next to its centroid: the centroid itself may lie in the open.
    row, column = rows.mean(), columns.mean()
    best = int(np.argmin((rows - row) ** 2 + (columns - column) ** 2))
    x = grid.x0 + (float(columns[best]) + 0.5) * grid.cell
    y = grid.y0 + (float(rows[best]) + 0.5) * grid.cell
    return float(size[largest]) * grid.cell**2, x, y


def _nearest_line(path: Path, target: Target, removal: Removal, x: float, y: float) -> int:
    """Return the line of the operation's lowest moves that passes next to a place."""
    pieces = removal.pieces
    own = path.operation[pieces.move] == target.operation
    if not own.any():
        return 0
    own &= pieces.band <= pieces.band[own].min()
    rows = np.flatnonzero(own)
    distance = np.hypot(pieces.stop[rows, 0] - x, pieces.stop[rows, 1] - y)
    return int(path.line[pieces.move[rows[int(np.argmin(distance))]]])


def _figures(
    operation: int,
    path: Path,
    targets: Sequence[Target],
    reach: Sequence[_Reach],
    uncut: Sequence[float],
    gouge: FloatArray,
    rapid_hit: BoolArray,
    removal: Removal,
    seconds: FloatArray,
    top: float,
) -> OperationResult:
    """Return the figures of one operation."""
    own = path.operation == operation
    counts = count_moves(path, seconds, operation, top)
    mine = own[removal.samples.move]
    peak, mean, high = _engagement(removal.engagement[mine], removal.samples.weight[mine])
    index = [i for i, item in enumerate(targets) if item.operation == operation]
    return OperationResult(
        operation=operation,
        **vars(counts),
        reachable_area_mm2=sum(reach[i].area for i in index),
        uncut_area_mm2=sum(uncut[i] for i in index),
        unreachable_area_mm2=sum(reach[i].unreachable for i in index),
        max_gouge_mm=float(gouge[own].max(initial=0.0)),
        max_engagement_deg=peak,
        mean_engagement_deg=mean,
        p99_engagement_deg=high,
        rapids_in_stock=int(np.count_nonzero(rapid_hit & own)),
    )


def _engagement(angle: FloatArray, weight: FloatArray) -> tuple[float, float, float]:
    """Return largest, mean and 99th percentile engagement over the length that cuts, degrees."""
    cutting = angle > 0
    if not cutting.any():
        return 0.0, 0.0, 0.0
    peak = float(angle.max())
    angle, weight = angle[cutting], weight[cutting]
    total = float(weight.sum())
    if total <= 0:
        return peak, peak, peak
    order = np.argsort(angle, kind="stable")
    share = np.cumsum(weight[order]) / total
    row = min(int(np.searchsorted(share, 0.99)), len(order) - 1)
    return peak, float(np.sum(angle * weight) / total), float(angle[order][row])
