"""The boundary of a region as a table of lines, arcs and free curves, one row a piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Bezier, Line, Region
from grassfire.geometry.curve import Curve
from grassfire.medial.columns import Columns
from grassfire.medial.disguise import by_degree, homogeneous_table, unmask
from grassfire.medial.sites import (
    FloatArray,
    IntArray,
    SiteKind,
    evaluate_rational,
)
from grassfire.medial.spirals import CUSP, power_coefficients, spirals

STOPPED = 1e-9
"""Speed at an end, relative to the curve's size, below which the curve gives its own tangent."""
GAP = 1e-13
"""Length that is left out at a cusp, relative to the curve's size."""
DISGUISE = 1e-11
"""Deviation from a line or an arc, relative to the region, that a free curve may have as one."""
LARGEST_RADIUS = 1e3
"""Radius of such an arc, relative to the region."""


@dataclass
class Pieces(Columns):
    """Columns of pieces in boundary order; coordinates are about the region's centre.

    Attributes
    ----------
    kind : (p,) int array of SiteKind
    anchor : (p, 2) float array
        Line: start; arc: centre.
    extent : (p, 2) float array
        Line: end - start; arc: (start angle, sweep).
    radius : (p,) float array
        Arc radius, mm.
    start, end : (p, 2) float arrays
    first, last : (p, 2) float arrays
        Directions of travel at start and end, of any length.
    reach : (p,) float array
        No less than the piece's extent, mm.
    low, high : (p,) float arrays
        Parameter range, 0 to 1 but for parts of free curves.
    bezier : (p,) int array
        Row of the free curve, -1 for others.
    loop, curve : (p,) int arrays
        Loop, and index of the curve in it.
    """

    kind: IntArray
    anchor: FloatArray
    extent: FloatArray
    radius: FloatArray
    start: FloatArray
    end: FloatArray
    first: FloatArray
    last: FloatArray
    reach: FloatArray
    low: FloatArray
    high: FloatArray
    bezier: IntArray
    loop: IntArray
    curve: IntArray

    def __len__(self) -> int:
        return len(self.kind)

    @classmethod
    def empty(cls, loop: IntArray, curve: IntArray) -> Pieces:
        """Return rows yet to be filled."""
        count = len(loop)
        kind, bezier = np.zeros(count, dtype=np.int64), np.full(count, -1)
        anchor, extent, start, end, first, last = np.zeros((6, count, 2))
        radius, reach = np.zeros((2, count))
        return cls(
            kind, anchor, extent, radius, start, end, first, last, reach,
            np.zeros(count), np.ones(count), bezier, loop, curve,
        )  # fmt: skip

    def set_lines(self, rows: IntArray, start: FloatArray, end: FloatArray) -> None:
        """Make rows the lines between points (n, 2)."""
        if not len(rows):
            return
        change = end - start
        self.kind[rows] = SiteKind.LINE
        self.anchor[rows] = self.start[rows] = start
        self.extent[rows] = self.first[rows] = self.last[rows] = change
        self.end[rows], self.bezier[rows] = end, -1
        self.low[rows], self.high[rows] = 0.0, 1.0
        self.reach[rows] = np.hypot(change[:, 0], change[:, 1])

    def set_arcs(
        self,
        rows: IntArray,
        centre: FloatArray,
        radius: FloatArray,
        start_angle: FloatArray,
        sweep: FloatArray,
    ) -> None:
        """Make rows arcs."""
        if not len(rows):
            return
        self.kind[rows] = SiteKind.ARC
        self.anchor[rows], self.radius[rows] = centre, radius
        self.extent[rows] = np.stack([start_angle, sweep], axis=1)
        self.reach[rows] = radius * np.abs(sweep)
        ends = ((start_angle, self.start, self.first), (start_angle + sweep, self.end, self.last))
        for angle, point, direction in ends:
            spoke = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            point[rows] = centre + radius[:, None] * spoke
            turned = np.stack([-spoke[:, 1], spoke[:, 0]], axis=1)
            direction[rows] = np.sign(sweep)[:, None] * turned

    def cut_spirals(self, rows: IntArray, table: FloatArray) -> None:
        """Set where the free curves are cut at the start of `rows`, from their coefficients."""
        curve = table[self.bezier[rows]]
        _, first, second = evaluate_rational(curve, self.low[rows], 2)
        speed, change = np.hypot(first[:, 0], first[:, 1]), np.hypot(second[:, 0], second[:, 1])
        # A curve has no direction where it stops: the parts end a little before, and start after.
        width = np.minimum(
            self.high[rows] - self.low[rows], self.high[rows - 1] - self.low[rows - 1]
        )
        step = np.sqrt(2.0 * GAP * self.reach[rows] / np.maximum(change, GAP * self.reach[rows]))
        step = np.where(speed <= CUSP * self.reach[rows], np.minimum(step, 0.01 * width), 0.0)
        self.high[rows - 1] -= step
        self.low[rows] += step
        self.end[rows - 1], self.last[rows - 1] = evaluate_rational(curve, self.high[rows - 1], 1)
        self.start[rows], self.first[rows] = evaluate_rational(curve, self.low[rows], 1)

    def set_beziers(self, rows: IntArray, curves: list[Bezier], corners: FloatArray) -> None:
        """Make rows free curves of one degree, with control points (n, degree + 1, 2)."""
        box = np.ptp(corners, axis=1)
        size = np.hypot(box[:, 0], box[:, 1])
        self.kind[rows] = SiteKind.SPIRAL
        self.start[rows], self.end[rows] = corners[:, 0], corners[:, -1]
        self.reach[rows] = size
        degree = corners.shape[1] - 1
        ends = (
            (0.0, self.first, corners[:, 1] - corners[:, 0]),
            (1.0, self.last, corners[:, -1] - corners[:, -2]),
        )
        for parameter, direction, leg in ends:
            direction[rows] = leg
            slow = degree * np.hypot(leg[:, 0], leg[:, 1]) <= STOPPED * size
            for row in np.flatnonzero(slow):
                direction[rows[row]] = curves[int(row)].tangent(parameter)


def gather(
    region: Region, origin: FloatArray, size: float
) -> tuple[Pieces, FloatArray, tuple[Bezier, ...]]:
    """Rows of a region's boundary, its free curves as power coefficients and as they are.

    Returns
    -------
    Pieces
    (b, degree + 1, 3) float array
        Homogeneous coefficients in powers of t - 1/2, about `origin`.
    tuple of b Bezier

    Raises
    ------
    GeometryError
        A curve that is no line, arc or rational curve.
    """
    parts: list[Curve] = []
    corners: list[FloatArray] = []
    counts: list[int] = []
    curves: list[IntArray] = []
    rows: list[IntArray] = []
    count = 0
    for loop in region.loops:
        if loop.vertices is not None:
            corners.append(loop.vertices)
            number = np.arange(len(loop.vertices))
        else:
            plain, owner = _elementary(loop.curves)
            parts.extend(plain)
            number = np.array(owner, dtype=np.int64)
            rows.append(count + np.arange(len(number)))
        curves.append(number)
        counts.append(len(number))
        count += len(number)
    pieces = Pieces.empty(np.repeat(np.arange(len(counts)), counts), np.concatenate(curves))
    if corners:
        points = np.concatenate(corners) - origin
        sides = np.ones(count, dtype=bool)
        sides[np.concatenate([*rows, np.zeros(0, dtype=np.int64)])] = False
        last = np.cumsum([len(part) for part in corners]) - 1
        after = np.arange(1, len(points) + 1)
        after[last] = np.concatenate([[0], last[:-1] + 1])
        pieces.set_lines(np.flatnonzero(sides), points, points[after])
    if not parts:
        return pieces, np.zeros((0, 2, 3)), ()
    return _fill(pieces, parts, np.concatenate(rows), origin, size)


def _elementary(curves: tuple[Curve, ...]) -> tuple[list[Curve], list[int]]:
    """Lines, arcs and Beziers of curves, and the number of the curve that each comes from."""
    if {type(curve) for curve in curves} <= {Line, Arc, Bezier}:
        return list(curves), list(range(len(curves)))
    parts: list[Curve] = []
    owner: list[int] = []
    for number, curve in enumerate(curves):
        split = (curve,) if isinstance(curve, (Line, Arc)) else curve.to_beziers()
        parts.extend(split)
        owner.extend([number] * len(split))
    return parts, owner


def _fill(
    pieces: Pieces, parts: list[Curve], rows: IntArray, origin: FloatArray, size: float
) -> tuple[Pieces, FloatArray, tuple[Bezier, ...]]:
    """Fill the rows of single curves, each type at once."""
    lines: list[Line] = []
    arcs: list[Arc] = []
    free: list[Bezier] = []
    places: tuple[list[int], list[int], list[int]] = ([], [], [])
    for row, part in zip(rows.tolist(), parts, strict=True):
        if isinstance(part, Bezier):
            free.append(part)
            places[2].append(row)
        elif isinstance(part, Line):
            lines.append(part)
            places[0].append(row)
        elif isinstance(part, Arc):
            arcs.append(part)
            places[1].append(row)
    if lines:
        start = np.array([line.start for line in lines]) - origin
        end = np.array([line.end for line in lines]) - origin
        pieces.set_lines(np.array(places[0]), start, end)
    if arcs:
        figures = np.array([(arc.radius, arc.start_angle, arc.sweep) for arc in arcs])
        centre = np.array([arc.centre for arc in arcs]) - origin
        pieces.set_arcs(np.array(places[1]), centre, *figures.T)
    if not free:
        return pieces, np.zeros((0, 2, 3)), ()
    return _fill_free(pieces, free, np.array(places[2]), origin, size)


def _fill_free(
    pieces: Pieces, curves: list[Bezier], rows: IntArray, origin: FloatArray, size: float
) -> tuple[Pieces, FloatArray, tuple[Bezier, ...]]:
    """Fill the rows of free curves, some of which are lines and arcs in disguise."""
    tables: list[tuple[IntArray, FloatArray]] = []
    for group in by_degree(curves):
        members = [curves[index] for index in group]
        control = homogeneous_table(members, origin)
        found = unmask(members, control, DISGUISE * size, LARGEST_RADIUS * size)
        place, line, arc = rows[group], found.line, found.arc
        corners = control[..., :2] / control[..., 2:]
        pieces.set_lines(place[line], corners[line, 0], corners[line, -1])
        figures = (found.centre, found.radius, found.start_angle, found.sweep)
        pieces.set_arcs(place[arc], *(column[arc] for column in figures))
        rest = np.flatnonzero(~line & ~arc)
        if len(rest):
            pieces.set_beziers(place[rest], [members[index] for index in rest], corners[rest])
            tables.append((group[rest], power_coefficients(control[rest])))
    if not tables:
        return pieces, np.zeros((0, 2, 3)), ()
    kept = np.sort(np.concatenate([group for group, _ in tables]))
    result = np.zeros((len(kept), max(table.shape[1] for _, table in tables), 3))
    for group, table in tables:
        result[np.searchsorted(kept, group), : table.shape[1]] = table
    pieces.bezier[rows[kept]] = np.arange(len(kept))
    return pieces, result, tuple(curves[index] for index in kept)


def divide(pieces: Pieces, table: FloatArray, size: float) -> Pieces:
    """Cut arcs into parts of half a turn at most and free curves into spirals.

    Parameters
    ----------
    table : (b, degree + 1, 3) float array
        Coefficients of the free curves.
    size : float
        Diagonal of the region, mm.
    """
    owner, low, high = spirals(table, size)
    count = np.bincount(owner, minlength=len(table))
    parts = np.ones(len(pieces), dtype=np.int64)
    arc = np.flatnonzero(pieces.kind == SiteKind.ARC)
    sweep = np.abs(pieces.extent[arc, 1])
    parts[arc] = np.maximum(1, np.ceil(sweep / (np.pi * (1 + 1e-12)))).astype(np.int64)
    free = np.flatnonzero(pieces.bezier >= 0)
    parts[free] = count[pieces.bezier[free]]
    source = np.repeat(np.arange(len(pieces)), parts)
    number = np.arange(len(source)) - np.repeat(np.cumsum(parts) - parts, parts)
    result = pieces.take(source)
    divided = parts[source] > 1
    rows = np.flatnonzero(divided & (result.kind == SiteKind.ARC))
    start_angle, whole = result.extent[rows].T
    share = whole / parts[source[rows]]
    result.set_arcs(
        rows, result.anchor[rows], result.radius[rows], start_angle + number[rows] * share, share
    )
    rows = np.flatnonzero(result.kind == SiteKind.SPIRAL)
    place = (np.cumsum(count) - count)[result.bezier[rows]] + number[rows]
    result.low[rows], result.high[rows] = low[place], high[place]
    result.cut_spirals(rows[number[rows] > 0], table)
    rows = rows[divided[rows]]
    # Within a quarter turn a curve is no longer than 1.42 times its chord.
    chord = result.end[rows] - result.start[rows]
    result.reach[rows] = 1.5 * np.hypot(chord[:, 0], chord[:, 1])
    return result


def collapse(pieces: Pieces, least: float) -> Pieces:
    """Drop pieces of no extent to speak of, and join what remains.

    A run of such pieces that leads farther than `least` from where it began keeps lines between
    points that far apart. The next line starts where the last piece ends (or that line ends where
    the next piece starts); between other pieces a gap of at most `least` remains.

    Raises
    ------
    GeometryError
        A loop of which nothing remains.
    """
    tiny = np.flatnonzero(pieces.reach <= least)
    if not len(tiny):
        return pieces
    kept = np.ones(len(pieces), dtype=bool)
    kept[tiny] = False
    standing, loop = np.zeros(2), -1
    for row in tiny:
        if row and kept[row - 1] and pieces.loop[row - 1] == pieces.loop[row]:
            standing = pieces.end[row - 1].copy()
        elif pieces.loop[row] != loop:
            standing = pieces.start[row].copy()
        loop = pieces.loop[row]
        if np.hypot(*(pieces.end[row] - standing)) > least:
            kept[row] = True
            pieces.set_lines(np.array([row]), standing[None], pieces.end[row][None])
    lost = np.setdiff1d(np.unique(pieces.loop), pieces.loop[kept])
    if len(lost):
        place = pieces.start[np.flatnonzero(pieces.loop == lost[0])[0]]
        raise GeometryError("a boundary loop has no extent", place=tuple(place.tolist()))
    broken = np.concatenate([[False], ~kept[:-1]])
    heads = np.flatnonzero(np.diff(pieces.loop, prepend=-1))
    tails = np.append(heads[1:], len(pieces)) - 1
    broken[heads] = ~kept[tails]
    # A piece is cut off from the one before when anything between was dropped.
    result, broken = pieces.take(kept), broken[kept]
    _rejoin(result, np.flatnonzero(broken))
    return collapse(result, least) if np.any(result.reach <= 0.0) else result


def _rejoin(pieces: Pieces, rows: IntArray) -> None:
    """Move ends of lines so that the pieces `rows` start where the ones before them end."""
    before = neighbours(pieces.loop)[1][rows]
    line = pieces.kind[rows] == SiteKind.LINE
    pieces.set_lines(rows[line], pieces.end[before[line]], pieces.end[rows[line]])
    other = ~line & (pieces.kind[before] == SiteKind.LINE)
    pieces.set_lines(before[other], pieces.start[before[other]], pieces.start[rows[other]])


def neighbours(loop: IntArray) -> tuple[IntArray, IntArray]:
    """Rows after and before each row along its loop; rows of a loop are contiguous."""
    count = len(loop)
    following, preceding = np.arange(1, count + 1), np.arange(-1, count - 1)
    heads = np.flatnonzero(np.diff(loop, prepend=-1))
    tails = np.append(heads[1:], count) - 1
    following[tails], preceding[heads] = heads, tails
    return following, preceding
