"""Machines a program as it was written and judges what comes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

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
from grassfire.verify.clock import move_times
from grassfire.verify.counts import count_moves
from grassfire.verify.limits import check_limits
from grassfire.verify.model import (
    Fault,
    FloatArray,
    HeightMap,
    MachineLimits,
    OperationResult,
    Target,
    Verification,
)
from grassfire.verify.path import BoolArray, IntArray, Path, assign, flatten_program
from grassfire.verify.raster import Grid, cells_inside, choose_grid
from grassfire.verify.removal import Removal, Sweep, SweepSettings, level_thickness

_QUADRANT_SEGMENTS = 64
"""Chords in a quarter turn of the reachable region's rounded corners."""

_SLIVER = 0.5
"""Stock thicker than the stepdown may be met over so much area in an operation, mm2."""


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
    rapid: float,
    acceleration: float,
    junction_deviation: float = 0.01,
    arc_tolerance: float = 0.002,
    path_tolerance: float | None = None,
    limits: MachineLimits = MachineLimits(),  # noqa: B008  (frozen)
    gouge_tolerance: float = 0.005,
    floor_tolerance: float = 0.0015,
    fitting_tolerance: float = 0.002,
    height_tolerance: float = 0.02,
    uncut_height: float = 0.02,
    uncut_fraction: float = 0.001,
    uncut_patch: float = 0.5,
    max_ramp_angle: float = math.radians(30.0),
    engagement_thickness: float | None = None,
    engagement_tolerance: float = 6.0,
    resolution: float | None = None,
    max_cells: int = 16_000_000,
    stock_top: float | None = None,
) -> Verification:
    """Machine a program that was read back from its text, and judge it.

    Walls, floor, time and lengths are exact (no raster); uncut area, rapids and plunges through
    stock and engagement come from first-cut-time maps whose cell is stated in the result. The tool
    is a flat cutter. One stock serves the whole program, in the order of its sections.

    Parameters
    ----------
    program : Program
    targets : sequence of Target
        At least one for each operation of the program.
    rapid, acceleration, junction_deviation, arc_tolerance, path_tolerance : float
        mm/min, mm/s2, mm: for the time, see `move_times`.
    limits : MachineLimits
        Travel and height of rapids.
    gouge_tolerance : float
        How far the tool may reach beyond a wall, mm.
    floor_tolerance : float
        How far below the floor, mm; by default what rounding to four decimals of an inch takes.
    fitting_tolerance : float
        How far curves were allowed to deviate when they were fitted, mm: added to the gouge
        tolerance where a radial allowance is cut into, and not demanded of the reachable area.
    height_tolerance : float
        Thinner stock under a rapid or plunge does not count, mm.
    uncut_height : float
        Stock standing higher above the floor counts as uncut, mm.
    uncut_fraction, uncut_patch : float
        Uncut part of the reachable area, and largest connected patch in mm2, that are let pass.
    max_ramp_angle : float
        Feed moves that descend through stock more steeply are plunges, radians.
    engagement_thickness : float, optional
        Thinner stock does not count as engaged, mm; by default 0.3 of the stepdown (of the target,
        or as the levels show it), which leaves out the wedge under a helix or ramp.
    engagement_tolerance : float
        By how much a target's engagement limit may be exceeded, degrees.
    resolution : float, optional
        Cell size, mm; by default a fortieth of the smallest tool's radius, up to a twenty-fourth on
        large pockets.
    max_cells : int
        The cell is enlarged where the map would have more.
    stock_top : float, optional
        z of the stock's top, mm; by default the highest of the targets.

    Raises
    ------
    InputError
        If there is no target, or a section of the program belongs to none.
    """
    wanted = tuple(targets)
    if not wanted:
        raise InputError("nothing to verify against: no target was given")
    for name, value in (("rapid", rapid), ("acceleration", acceleration)):
        if not value > 0:
            raise InputError(f"{name} {value:g} is not positive")
    top = max(item.stock_top for item in wanted) if stock_top is None else stock_top
    path = flatten_program(program, wanted)
    served = assign(program, wanted)
    grid = _grid_for(path, wanted, resolution, max_cells)
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
        gouge_tolerance=gouge_tolerance,
        floor_tolerance=floor_tolerance,
        fitting_tolerance=fitting_tolerance,
    )
    faults += found

    descent = path.begin[:, 2] - path.end[:, 2]
    steep = ~path.rapid & (np.arctan2(descent, path.planar) > max_ramp_angle)
    thickness = _thickness(path, wanted, per_move.stepdown, top, engagement_thickness)
    bodies = find_bodies(path, served, top)
    sweep = Sweep(
        path,
        wanted,
        grid,
        SweepSettings(top, height_tolerance, uncut_height),
        flagged=path.rapid | steep,
        thickness=np.maximum(thickness, height_tolerance),
        stepdown=per_move.stepdown,
        bodies=bodies,
    )
    reach = [_reach_of(item, grid, fitting_tolerance) for item in wanted]
    removal = sweep.run([item.demanded for item in reach])
    rapid_hit, found = _check_descents(path, removal, steep & ~per_move.may_plunge, top, grid)
    faults += found
    faults += check_bodies(path, bodies, removal.hits, wanted, per_move.radial_allowance, top)
    faults += _check_load(path, removal, per_move.engagement_limit + engagement_tolerance)
    uncut, found = _check_uncut(
        path, wanted, reach, removal, grid, fraction=uncut_fraction, patch=uncut_patch
    )
    faults += found

    seconds = move_times(
        path,
        rapid=rapid,
        acceleration=acceleration,
        junction_deviation=junction_deviation,
        arc_tolerance=arc_tolerance,
        path_tolerance=path_tolerance,
    )
    operations = tuple(
        _figures(operation, path, wanted, reach, uncut, gouge, rapid_hit, removal, seconds, top)
        for operation in sorted({item.operation for item in wanted})
    )
    height = removal.height.reshape(grid.rows, grid.columns)
    return Verification(
        operations=operations,
        faults=tuple(faults),
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

    The cells demanded keep clear of the edge by what fitting and the sweep's chords may take, so
    that no sliver is blamed on the program that is theirs.
    """
    import shapely

    radius, segments = target.tool_radius, _QUADRANT_SEGMENTS
    region = shapely.simplify(target.region, 2e-4)
    inset = radius + target.radial_allowance
    centres = region.buffer(-inset, quad_segs=segments)
    area = centres.buffer(radius, quad_segs=segments).area if not centres.is_empty else 0.0
    opened = area
    if target.radial_allowance > 0:
        bare = region.buffer(-radius, quad_segs=segments)
        opened = bare.buffer(radius, quad_segs=segments).area if not bare.is_empty else 0.0
    sure = region.buffer(-inset - fitting_tolerance, quad_segs=segments)
    margin = fitting_tolerance + 0.2 * grid.cell
    sure = sure.buffer(max(radius - margin, 0.5 * radius), quad_segs=segments)
    unreachable = max(target.region.area - opened, 0.0)
    return _Reach(float(area), float(unreachable), cells_inside(sure, grid).ravel())


def _check_descents(
    path: Path, removal: Removal, plunging: BoolArray, top: float, grid: Grid
) -> tuple[BoolArray, list[Fault]]:
    """Return (n,) which rapids removed stock, and the faults of rapids and plunges."""
    noise = 2 * grid.cell**2
    squared = path.tool_radius**2
    hit = path.rapid & (removal.removed > 0.005 * squared + noise)
    depth = top - np.nan_to_num(path.low, nan=np.inf)
    moves = np.flatnonzero(hit)
    faults = report_moves(
        "rapid-in-stock",
        path,
        moves,
        depth[moves],
        lambda size: f"a rapid runs through stock, down to {size:.3f} mm below its top",
    )
    through = plunging & (removal.removed > np.maximum(0.02 * squared, 0.05) + noise)
    moves = np.flatnonzero(through)
    fall = np.minimum(path.begin[:, 2], top) - path.end[:, 2]
    faults += report_moves(
        "plunge",
        path,
        moves,
        fall[moves],
        lambda size: f"a descent of {size:.3f} mm through stock, too steep for a ramp",
    )
    return hit, faults


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
    *,
    fraction: float,
    patch: float,
) -> tuple[list[float], list[Fault]]:
    """Return the uncut area of each target in mm2, and the faults."""
    areas, faults = [], []
    for target, reached, left in zip(targets, reach, removal.left, strict=True):
        area = float(np.count_nonzero(left)) * grid.cell**2
        areas.append(area)
        if not area:
            continue
        # Late: good programs leave nothing, and need not wait for this import.
        from scipy import ndimage

        field = left.reshape(grid.rows, grid.columns)
        label, _ = ndimage.label(field, structure=np.ones((3, 3)))
        size = np.bincount(label.ravel())
        size[0] = 0
        largest = int(np.argmax(size))
        largest_area = float(size[largest]) * grid.cell**2
        if area <= fraction * reached.area and largest_area <= patch:
            continue
        rows, columns = np.nonzero(label == largest)
        # The cell of the patch next to its centroid: the centroid itself may lie in the open.
        row, column = rows.mean(), columns.mean()
        best = int(np.argmin((rows - row) ** 2 + (columns - column) ** 2))
        x = grid.x0 + (float(columns[best]) + 0.5) * grid.cell
        y = grid.y0 + (float(rows[best]) + 0.5) * grid.cell
        floor = target.floor + target.axial_allowance
        message = (
            f"{area:.3f} mm2 of what the tool can reach ({100 * area / reached.area:.2f} %) is "
            f"left above the floor; the largest patch has {largest_area:.3f} mm2"
        )
        line = _nearest_line(path, target, removal, x, y)
        faults.append(Fault("uncut", line, (x, y, floor), area, message, target.operation))
    return areas, faults


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
