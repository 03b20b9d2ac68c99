"""Planned moves to moves on the controller's decimal grid, arcs checked as they will be written.

Controllers compute an arc's radius at its start and at its end and refuse a block where the two
differ. Rounding the ends by up to half a unit makes them differ, so the centre is found anew from
the *rounded* ends: it moves along the chord onto their bisector (which leaves the arc where it is,
as long as the chord is not short against the radius), is rounded to the neighbouring grid point
that fits best, and then both radii and the deviation from the planned arc are measured. An arc
that fails is halved; one that is flatter than the tolerance becomes a chord.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..toolpath import FloatArray, MoveKind, Toolpath
from .definition import Arcs

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

# What every controller bears, mm and fraction of the radius: more is a fault of the planner.
_PLANNED_MISMATCH = (0.005, 0.001)
_LARGEST_TURN_CHANGE = np.pi / 4
_ROUNDING_OF_ANGLES = 1e-9


@dataclass(frozen=True)
class Grid:
    """The numbers that a text can hold: multiples of the last decimal of its units."""

    decimals: int
    scale: float = 1.0  # mm in one unit

    @property
    def step(self) -> float:
        """Distance of neighbouring numbers, mm."""
        return self.scale * 10.0**-self.decimals

    def finer(self, extra: int) -> Grid:
        """The grid with `extra` decimals more."""
        return Grid(self.decimals + extra, self.scale)

    def nearest(self, values: FloatArray) -> FloatArray:
        """Values, mm, moved to the grid; without negative zeros."""
        return np.asarray(np.round(values / self.scale, self.decimals) * self.scale + 0.0)


@dataclass(frozen=True)
class WrittenMoves:
    """Moves as the text will hold them, one row a block.

    Attributes
    ----------
    kind : (n,) uint8 array of MoveKind
    begin, end : (n, 3) float array
        Positions rounded to the post's decimals, mm; NaN where an axis is not known.
    centre : (n, 2) float array
        Centre as written, mm; NaN for straight moves. For the R form: centre that R gives.
    radius : (n,) float array
        R as written, mm, negative for sweeps over 180 degrees; NaN unless the form is "r".
    sweep : (n,) float array
        Planned signed sweep of the block, radians.
    fine : (n,) bool array
        Whether I, J or R carry one decimal more than coordinates.
    feed : (n,) float array
        mm/min; NaN for rapids.
    source : (n,) int64 array
        Index of the planned move that each block is a part of.
    """

    kind: NDArray[np.uint8]
    begin: FloatArray
    end: FloatArray
    centre: FloatArray
    radius: FloatArray
    sweep: FloatArray
    fine: BoolArray
    feed: FloatArray
    source: IntArray

    def __len__(self) -> int:
        return len(self.kind)


@dataclass(frozen=True)
class _Planned:
    """Exact moves or parts of moves, and the centre chosen for each arc that is settled."""

    kind: NDArray[np.uint8]
    begin: FloatArray
    end: FloatArray
    centre: FloatArray
    sweep: FloatArray
    feed: FloatArray
    source: IntArray
    written_centre: FloatArray
    written_radius: FloatArray
    fine: BoolArray
    settled: BoolArray

    def take(self, index: IntArray | BoolArray) -> _Planned:
        return _Planned(
            **{column.name: getattr(self, column.name)[index] for column in fields(self)}
        )

    @property
    def radius(self) -> FloatArray:
        return np.asarray(np.hypot(*(self.begin[:, :2] - self.centre).T))

    @property
    def height(self) -> FloatArray:
        """(n,) largest distance of an arc from its chord, mm."""
        return np.asarray(self.radius * (1 - np.cos(self.sweep / 2)))


def written_moves(
    toolpath: Toolpath,
    arcs: Arcs,
    decimals: int,
    tolerance: float,
    start: FloatArray | None = None,
    scale: float = 1.0,
) -> WrittenMoves:
    """Round a tool path to a post's decimals.

    Parameters
    ----------
    toolpath : Toolpath
    arcs : Arcs
        The post's arc form and limits.
    decimals : int
        Decimals of the coordinates in the units of the text.
    tolerance : float
        How far an arc or chord as written may lie from the planned arc, mm; at least one unit of
        the last decimal.
    start : (3,) float array, optional
        Position before the first move where it differs from `toolpath.start`, mm.
    scale : float
        mm in one unit of the text.

    Returns
    -------
    WrittenMoves
        Without the moves that vanish in rounding. Ends of planned moves are rounded each for
        itself, so errors do not add up.

    Raises
    ------
    InputError
        For arcs without a known start or with two radii, and values that are not finite.
    """
    grid = Grid(decimals, scale)
    unit = grid.step
    if not tolerance >= unit:
        raise InputError(
            f"tolerance {tolerance:g} mm is below the post's last decimal ({unit:g} mm)",
            remedy="raise the tolerance or use a post with more decimals",
        )
    moves = _settled(_planned(toolpath, start), arcs, grid, tolerance)
    begin, end = grid.nearest(moves.begin), grid.nearest(moves.end)
    # Not a number differs from itself: an axis that becomes known is a move.
    kept = (moves.kind >= MoveKind.ARC_CW) | np.any((begin != end) & ~np.isnan(end), axis=1)
    return WrittenMoves(
        moves.kind[kept],
        begin[kept],
        end[kept],
        moves.written_centre[kept],
        moves.written_radius[kept],
        moves.sweep[kept],
        moves.fine[kept],
        moves.feed[kept],
        moves.source[kept],
    )


def _settled(moves: _Planned, arcs: Arcs, grid: Grid, tolerance: float) -> _Planned:
    """The moves as lines and arcs that the controller takes as they will be written."""
    unit = grid.step
    # Both ends of a chord may be half a grid diagonal off.
    chord_height = max(tolerance - np.sqrt(0.5) * unit, tolerance / 4)
    moves = _cut_to_limits(moves, arcs, unit, chord_height)
    while not moves.settled.all():
        moves = _settle(moves, arcs, grid, tolerance)
        failed = ~moves.settled
        flat = failed & (moves.height <= chord_height)
        moves = _as_lines(moves, flat)
        moves = _subdivide(moves, np.where(failed & ~flat, 2, 1))
    return moves


def _planned(toolpath: Toolpath, start: FloatArray | None) -> _Planned:
    """Columns of the planned moves, checked."""
    count = len(toolpath)
    begin = toolpath.begin.copy()
    if start is not None and count:
        begin[0] = start
    arc = toolpath.is_arc
    _check_moves(toolpath, begin)
    return _Planned(
        kind=toolpath.kind,
        begin=begin,
        end=toolpath.end,
        centre=toolpath.centre,
        sweep=toolpath.sweep,
        feed=toolpath.feed,
        source=np.arange(count),
        written_centre=np.full((count, 2), np.nan),
        written_radius=np.full(count, np.nan),
        fine=np.zeros(count, dtype=np.bool_),
        settled=~arc,
    )


def _check_moves(toolpath: Toolpath, begin: FloatArray) -> None:
    """Refuse moves that no text can hold."""
    arc, feed_move = toolpath.is_arc, toolpath.kind != MoveKind.RAPID
    finite_end = np.isfinite(toolpath.end).all(axis=1)
    start_radius = np.hypot(*(begin[:, :2] - toolpath.centre).T)
    mismatch = np.abs(start_radius - np.hypot(*(toolpath.end[:, :2] - toolpath.centre).T))
    absolute, relative = _PLANNED_MISMATCH
    faults = {
        "its end is not finite": (feed_move & ~finite_end) | np.isinf(toolpath.end).any(axis=1),
        "it starts at an unknown position": feed_move & ~np.isfinite(begin).all(axis=1),
        "it has no feed": feed_move & ~(np.isfinite(toolpath.feed) & (toolpath.feed > 0)),
        "it has no centre": arc & ~np.isfinite(toolpath.centre).all(axis=1),
        "the radii at its ends differ": arc
        & (mismatch > absolute)
        & (mismatch > relative * start_radius),
    }
    for fault, where in faults.items():
        if where.any():
            index = int(np.flatnonzero(where)[0])
            raise InputError(
                f"planned move {index} ({MoveKind(int(toolpath.kind[index])).name.lower()}) "
                f"cannot be written: {fault}",
                place=[float(value) for value in toolpath.end[index]],
            )


def _cut_to_limits(moves: _Planned, arcs: Arcs, unit: float, chord_height: float) -> _Planned:
    """Chords for arcs that the controller does not take; parts of arcs that sweep too far."""
    arc = moves.kind >= MoveKind.ARC_CW
    radius, height = moves.radius, moves.height
    chords = arc & (
        (height <= unit / 4)  # no number would show the bow
        | (radius < arcs.smallest_radius)
        | (radius > arcs.largest_radius)
        | (arcs.form == "none")
        | ((moves.begin[:, 2] != moves.end[:, 2]) & (not arcs.helical))
    )
    sweep = np.abs(moves.sweep)
    largest = np.full(len(sweep), np.radians(arcs.largest_sweep))
    with np.errstate(divide="ignore", invalid="ignore"):
        chord_sweep = 2 * np.arccos(np.clip(1 - chord_height / radius, -1, 1))
    largest[chords] = np.minimum(chord_sweep[chords], 2 * np.pi)
    largest[chords & (height <= chord_height)] = 2 * np.pi
    if arcs.full_circles == "split":
        largest = np.where(
            arc & ~chords & (sweep >= 2 * np.pi), np.minimum(largest, np.pi), largest
        )
    counts = np.where(arc, np.ceil(sweep / largest - 1e-9), 1).astype(np.int64)
    counts = np.maximum(counts, 1)
    return _subdivide(_as_lines(moves, chords, keep_sweep=True), counts)


def _as_lines(moves: _Planned, where: BoolArray, *, keep_sweep: bool = False) -> _Planned:
    """Arcs become chords; the sweep stays where they are still to be subdivided."""
    return replace(
        moves,
        kind=np.where(where, np.uint8(MoveKind.LINE), moves.kind).astype(np.uint8),
        sweep=moves.sweep if keep_sweep else np.where(where, 0.0, moves.sweep),
        settled=moves.settled | where,
    )


def _subdivide(moves: _Planned, counts: IntArray) -> _Planned:
    """Cut each move into `counts` parts of equal sweep; z is linear in the sweep."""
    if np.all(counts == 1):
        return moves
    index = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)
    parts = counts[index]
    whole = moves.take(index)
    from_centre = whole.begin[:, :2] - whole.centre
    angle = np.arctan2(from_centre[:, 1], from_centre[:, 0])
    start_radius = np.hypot(*from_centre.T)
    end_radius = np.hypot(*(whole.end[:, :2] - whole.centre).T)

    def at(fraction: FloatArray) -> FloatArray:
        turned = angle + fraction * whole.sweep
        radius = start_radius + fraction * (end_radius - start_radius)
        planar = whole.centre + radius[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
        z = whole.begin[:, 2] + fraction * (whole.end[:, 2] - whole.begin[:, 2])
        return np.column_stack([planar, z])

    return replace(
        whole,
        begin=np.where((step == 0)[:, None], whole.begin, at(step / parts)),
        end=np.where((step == parts - 1)[:, None], whole.end, at((step + 1) / parts)),
        sweep=whole.sweep / parts,
    )


def _settle(moves: _Planned, arcs: Arcs, grid: Grid, tolerance: float) -> _Planned:
    """Choose the written centres of the arcs that still lack one; failures stay unsettled."""
    result = moves
    for extra in (0, 1) if arcs.extra_decimal else (0,):
        open_index = np.flatnonzero(~result.settled)
        if not len(open_index):
            break
        part = result.take(open_index)
        centre, radius, accepted = _fit_centres(part, arcs, grid, grid.finer(extra), tolerance)
        chosen = open_index[accepted]
        written_centre, written_radius = result.written_centre.copy(), result.written_radius.copy()
        fine, settled = result.fine.copy(), result.settled.copy()
        written_centre[chosen], written_radius[chosen] = centre[accepted], radius[accepted]
        fine[chosen], settled[chosen] = bool(extra), True
        result = replace(
            result,
            written_centre=written_centre,
            written_radius=written_radius,
            fine=fine,
            settled=settled,
        )
    return result


def _fit_centres(
    moves: _Planned, arcs: Arcs, grid: Grid, arc_grid: Grid, tolerance: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Best written centre (and R) of each arc, and whether it is good enough."""
    begin, end = grid.nearest(moves.begin[:, :2]), grid.nearest(moves.end[:, :2])
    chord = end - begin
    chord_length = np.hypot(*chord.T)
    direction = chord / np.where(chord_length > 0, chord_length, 1.0)[:, None]
    # A centre on the chord's bisector has equal radii.
    along = np.sum((moves.centre - (begin + end) / 2) * direction, axis=1)
    ideal = moves.centre - along[:, None] * direction
    if arcs.form == "r":
        candidates, radii = _radius_candidates(moves, begin, end, ideal, arc_grid)
    else:
        candidates, radii = _centre_candidates(ideal, arc_grid)
    mismatch, deviation, turn = _measure(moves, begin, end, candidates)
    best = np.argmin(mismatch + deviation, axis=0)
    row = np.arange(len(best))
    mismatch, deviation, turn = mismatch[best, row], deviation[best, row], turn[best, row]
    centre = candidates[best, row]
    start_radius = np.hypot(*(begin - centre).T)
    whole_circle = (np.abs(moves.sweep) >= 2 * np.pi) & (arcs.full_circles == "whole")
    accepted = (
        ((chord_length > 0) | whole_circle)
        & (mismatch <= min(arcs.radius_mismatch, _PLANNED_MISMATCH[0]))
        & (deviation <= tolerance)
        & (np.abs(turn - moves.sweep) <= _LARGEST_TURN_CHANGE)
        & (np.abs(turn) <= np.radians(arcs.largest_sweep) + _ROUNDING_OF_ANGLES)
        & (start_radius >= arcs.smallest_radius)
    )
    return centre, radii[best, row], accepted


def _centre_candidates(ideal: FloatArray, grid: Grid) -> tuple[FloatArray, FloatArray]:
    """(4, n, 2) grid points around each ideal centre; no radii."""
    corner = np.floor(ideal / grid.step)
    offsets = np.array(list(product((0.0, 1.0), repeat=2)))
    candidates = grid.nearest((corner + offsets[:, None, :]) * grid.step)
    return candidates, np.full(candidates.shape[:2], np.nan)


def _radius_candidates(
    moves: _Planned, begin: FloatArray, end: FloatArray, ideal: FloatArray, grid: Grid
) -> tuple[FloatArray, FloatArray]:
    """(2, n, 2) centres that R rounded down and up would give, and these R with their sign."""
    exact = np.hypot(*(begin - ideal).T)
    size = (np.floor(exact / grid.step) + np.array([[0.0], [1.0]])) * grid.step
    chord = end - begin
    length = np.hypot(*chord.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Too short an R gives not a number here, which fails every later comparison.
        to_centre = np.sqrt(size**2 - length**2 / 4) / length
    small = np.abs(moves.sweep) <= np.pi
    left = np.where((moves.sweep > 0) == small, 1.0, -1.0)
    normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    candidates = (begin + end) / 2 + (left * to_centre)[..., None] * normal
    return candidates, grid.nearest(np.where(small, size, -size))


def _measure(
    moves: _Planned, begin: FloatArray, end: FloatArray, centre: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of arcs as written: difference of radii, distance to the planned arc, signed sweep.

    `centre` is (k, n, 2); the results are (k, n). The distance of a point at angle `a` of the
    planned arc from the written centre is extreme at the ends of the arc and where `a` is along
    or against the line of both centres.
    """
    to_begin, to_end = begin - centre, end - centre
    start_radius = np.hypot(*np.moveaxis(to_begin, -1, 0))
    end_radius = np.hypot(*np.moveaxis(to_end, -1, 0))
    mismatch = np.abs(start_radius - end_radius)
    middle = (start_radius + end_radius) / 2
    planned_radius = moves.radius
    shift = centre - moves.centre
    from_centre = moves.begin[:, :2] - moves.centre
    shift_size = np.hypot(shift[..., 0], shift[..., 1])
    towards = np.arctan2(shift[..., 1], shift[..., 0])
    towards -= np.arctan2(from_centre[:, 1], from_centre[:, 0])
    sign = np.sign(moves.sweep)
    deviation = np.zeros_like(mismatch)
    for point in (moves.begin[:, :2], moves.end[:, :2]):
        distance = np.hypot(*np.moveaxis(point - centre, -1, 0))
        deviation = np.maximum(deviation, np.abs(distance - middle))
    for direction, extreme in ((0.0, -1.0), (np.pi, 1.0)):
        passed = np.mod(sign * (towards + direction), 2 * np.pi) <= np.abs(moves.sweep)
        distance = np.abs(planned_radius + extreme * shift_size)
        deviation = np.maximum(deviation, np.where(passed, np.abs(distance - middle), 0.0))
    deviation = np.where(np.isfinite(mismatch), deviation + mismatch / 2, np.inf)
    turn = np.arctan2(
        to_begin[..., 0] * to_end[..., 1] - to_begin[..., 1] * to_end[..., 0],
        np.sum(to_begin * to_end, axis=-1),
    )
    same = np.all(begin == end, axis=1)
    turn = np.where(sign * turn <= 0, turn + sign * 2 * np.pi, turn)
    turn = np.where(same, sign * 2 * np.pi, turn)
    return np.where(np.isfinite(mismatch), mismatch, np.inf), deviation, turn
