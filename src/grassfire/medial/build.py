"""From a region to its sites: free curves are split where their curvature is extreme."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Bezier, Line, Region, simplify
from grassfire.medial.sites import FloatArray, SiteKind, Sites, evaluate_rational

_GRID = 33
_LARGEST_TURN = 0.5 * np.pi


@dataclass
class _Columns:
    """Rows of sites while they are collected."""

    kind: list[int] = field(default_factory=list)
    anchor: list[tuple[float, float]] = field(default_factory=list)
    extent: list[tuple[float, float]] = field(default_factory=list)
    radius: list[float] = field(default_factory=list)
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    bezier: list[int] = field(default_factory=list)
    corner_after: list[bool] = field(default_factory=list)
    turn_after: list[float] = field(default_factory=list)
    loop: list[int] = field(default_factory=list)
    curve: list[int] = field(default_factory=list)

    def add(
        self,
        kind: SiteKind,
        anchor: FloatArray,
        extent: tuple[float, float],
        place: tuple[int, int],
        *,
        radius: float = 0.0,
        low: float = 0.0,
        high: float = 1.0,
        bezier: int = -1,
    ) -> None:
        self.kind.append(int(kind))
        self.anchor.append((float(anchor[0]), float(anchor[1])))
        self.extent.append((float(extent[0]), float(extent[1])))
        self.radius.append(radius)
        self.low.append(low)
        self.high.append(high)
        self.bezier.append(bezier)
        self.corner_after.append(False)
        self.turn_after.append(0.0)
        self.loop.append(place[0])
        self.curve.append(place[1])


def build_sites(
    region: Region, smooth_angle: float = 1e-6, least_fan: float = 1e-9
) -> tuple[Sites, tuple[Bezier, ...]]:
    """Sites of a region, and the Bezier curves that its spirals are pieces of.

    Parameters
    ----------
    region : Region
    smooth_angle : float
        Convex turn below which a junction counts as smooth, radians. The disks next to it are
        then off by their radius times half the square of the turn.
    least_fan : float
        Reflex turn below which a corner gets no fan of normals, radians: the axis then misses a
        stretch of its radius times the turn.

    Raises
    ------
    GeometryError
        A curve of no extent or with an unusable parametrisation.
    """
    xmin, ymin, xmax, ymax = region.bounds()
    origin = np.array([(xmin + xmax) / 2, (ymin + ymax) / 2])
    size = float(np.hypot(xmax - xmin, ymax - ymin))
    if not (np.isfinite(size) and size > 0):
        raise GeometryError("the region has no extent")
    columns = _Columns()
    coefficients: list[FloatArray] = []
    beziers: list[Bezier] = []
    heads: list[int] = []
    for loop_index, loop in enumerate(region.loops):
        heads.append(len(columns.kind))
        turns = loop.junctions(least_fan).turn
        count = len(loop.curves)
        for index, curve in enumerate(loop.curves):
            place = (loop_index, index)
            for piece in _pieces(curve, size):
                _append_piece(columns, coefficients, beziers, piece, place, origin)
            # junctions row k is the one at the start of curve k
            turn = float(turns[(index + 1) % count])
            _end_curve(
                columns, turn, (smooth_angle, least_fan), place, loop, (index + 1) % count, origin
            )
        if len(columns.kind) == heads[-1]:
            raise GeometryError("a boundary loop has no extent", place=tuple(loop.curves[0].start))
    return _freeze(columns, coefficients, heads, origin, size), tuple(beziers)


def _pieces(curve: object, size: float) -> Iterator[Line | Arc | Bezier]:
    """Lines, arcs of at most half a turn, and Beziers that are neither."""
    if isinstance(curve, Line):
        yield curve
    elif isinstance(curve, Arc):
        count = int(np.ceil(abs(curve.sweep) / (np.pi * (1 + 1e-12))))
        for part in range(count):
            yield curve.subcurve(part / count, (part + 1) / count) if count > 1 else curve
    elif hasattr(curve, "to_beziers"):
        for bezier in curve.to_beziers():
            simple = simplify(bezier, 1e-11 * size)
            if isinstance(simple, Bezier):
                yield simple
            else:
                yield from _pieces(simple, size)
    else:
        raise GeometryError(f"curves of type {type(curve).__name__} are not handled")


def _append_piece(
    columns: _Columns,
    coefficients: list[FloatArray],
    beziers: list[Bezier],
    piece: Line | Arc | Bezier,
    place: tuple[int, int],
    origin: FloatArray,
) -> None:
    if isinstance(piece, Line):
        delta = np.asarray(piece.end) - np.asarray(piece.start)
        if np.hypot(delta[0], delta[1]) > 0:
            columns.add(
                SiteKind.LINE, np.asarray(piece.start) - origin, (delta[0], delta[1]), place
            )
    elif isinstance(piece, Arc):
        columns.add(
            SiteKind.ARC,
            np.asarray(piece.centre) - origin,
            (piece.start_angle, piece.sweep),
            place,
            radius=float(piece.radius),
        )
    else:
        power = _power_coefficients(piece, origin)
        row = len(coefficients)
        coefficients.append(power)
        beziers.append(piece)
        cuts = spiral_cuts(power)
        for low, high in pairwise(cuts):
            columns.add(
                SiteKind.SPIRAL,
                np.zeros(2),
                (0.0, 0.0),
                place,
                low=float(low),
                high=float(high),
                bezier=row,
            )


def _end_curve(
    columns: _Columns,
    turn: float,
    angles: tuple[float, float],
    place: tuple[int, int],
    loop: object,
    following: int,
    origin: FloatArray,
) -> None:
    """Mark a convex corner, or add the fan of a reflex one."""
    if not columns.kind:
        return
    smooth_angle, least_fan = angles
    if turn >= -least_fan:
        columns.corner_after[-1] = turn > smooth_angle
        columns.turn_after[-1] = turn
    else:
        curve = loop.curves[following]  # type: ignore[attr-defined]
        corner = np.asarray(curve.start) - origin
        tangent = np.asarray(curve.tangent(0.0))
        angle = float(np.arctan2(tangent[0], -tangent[1])) - turn
        columns.add(SiteKind.POINT, corner, (angle, turn), place)


def _power_coefficients(curve: Bezier, origin: FloatArray) -> FloatArray:
    """(degree + 1, 3) homogeneous coefficients in powers of t - 1/2."""
    points = np.asarray(curve.control_points, dtype=np.float64) - origin
    count = len(points)
    weights = np.ones(count) if curve.weights is None else np.asarray(curve.weights, dtype=float)
    values = np.concatenate([points * weights[:, None], weights[:, None]], axis=1)
    # Repeated de Casteljau at 1/2 gives all derivatives there without cancellation.
    degree = count - 1
    result = np.zeros((count, 3))
    factor = 1.0
    for power in range(count):
        level = values
        while len(level) > 1:
            level = 0.5 * (level[:-1] + level[1:])
        result[power] = factor * level[0]
        values = np.diff(values, axis=0)
        factor *= (degree - power) / (power + 1)
    return result


def spiral_cuts(coefficients: FloatArray) -> FloatArray:
    """Parameters 0 .. 1 that cut a rational curve into pieces of monotone curvature.

    Each piece also turns by at most a quarter turn. The derivative of the curvature is
    k' ~ N' S - 3/2 N S' with N = c' x c'', S = |c'|^2; its sign changes on a grid of 33 parameters
    are bisected. Two extrema closer than the grid cancel: their curvatures differ by next to
    nothing.
    """
    grid = np.linspace(0.0, 1.0, _GRID)
    slope = _curvature_slope(coefficients, grid)
    rows = np.flatnonzero(slope[:-1] * slope[1:] < 0)
    left, right = grid[rows], grid[rows + 1]
    sign = np.sign(slope[rows])
    for _ in range(52):
        middle = 0.5 * (left + right)
        same = np.sign(_curvature_slope(coefficients, middle)) == sign
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    roots = 0.5 * (left + right)
    zero = grid[1:-1][slope[1:-1] == 0] if np.any(slope != 0) else grid[:0]
    zero = zero[(np.sign(slope[:-2]) * np.sign(slope[2:]) < 0)[slope[1:-1] == 0]]
    cuts = np.unique(np.concatenate([[0.0], roots, zero, [1.0]]))
    cuts = cuts[np.concatenate([[True], np.diff(cuts) > 1e-9])]
    cuts[-1] = 1.0
    return _limit_turn(coefficients, cuts)


def _curvature_slope(coefficients: FloatArray, parameter: FloatArray) -> FloatArray:
    stacked = np.broadcast_to(coefficients, (len(parameter), *coefficients.shape))
    _, first, second, third = evaluate_rational(stacked, parameter, 3)
    cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    cross_slope = first[:, 0] * third[:, 1] - first[:, 1] * third[:, 0]
    square = np.einsum("ij,ij->i", first, first)
    square_slope = 2 * np.einsum("ij,ij->i", first, second)
    return np.asarray(cross_slope * square - 1.5 * cross * square_slope)


def _limit_turn(coefficients: FloatArray, cuts: FloatArray) -> FloatArray:
    fine = np.unique(np.concatenate([np.linspace(0.0, 1.0, 257), cuts]))
    stacked = np.broadcast_to(coefficients, (len(fine), *coefficients.shape))
    first = evaluate_rational(stacked, fine, 1)[1]
    cross = first[:-1, 0] * first[1:, 1] - first[:-1, 1] * first[1:, 0]
    turn = np.concatenate(
        [[0.0], np.cumsum(np.abs(np.arctan2(cross, np.einsum("ij,ij->i", first[:-1], first[1:]))))]
    )
    result = [cuts[0]]
    for low, high in pairwise(cuts):
        start, end = np.interp([low, high], fine, turn)
        parts = max(1, int(np.ceil((end - start) / _LARGEST_TURN)))
        inner = np.interp(np.linspace(start, end, parts + 1)[1:-1], turn, fine)
        result.extend([*inner[(inner > low + 1e-9) & (inner < high - 1e-9)], high])
    return np.array(result)


def _freeze(
    columns: _Columns,
    coefficients: list[FloatArray],
    heads: list[int],
    origin: FloatArray,
    size: float,
) -> Sites:
    count = len(columns.kind)
    following = np.arange(1, count + 1)
    preceding = np.arange(-1, count - 1)
    ends = [*heads[1:], count]
    for head, end in zip(heads, ends, strict=True):
        following[end - 1] = head
        preceding[head] = end - 1
    degree = max((len(row) for row in coefficients), default=1)
    table = np.zeros((len(coefficients), degree, 3))
    for index, row in enumerate(coefficients):
        table[index, : len(row)] = row
    return Sites(
        kind=np.array(columns.kind, dtype=np.int64),
        anchor=np.array(columns.anchor, dtype=np.float64),
        extent=np.array(columns.extent, dtype=np.float64),
        radius=np.array(columns.radius, dtype=np.float64),
        low=np.array(columns.low, dtype=np.float64),
        high=np.array(columns.high, dtype=np.float64),
        coefficients=table,
        bezier=np.array(columns.bezier, dtype=np.int64),
        following=following.astype(np.int64),
        preceding=preceding.astype(np.int64),
        corner_after=np.array(columns.corner_after, dtype=bool),
        turn_after=np.array(columns.turn_after, dtype=np.float64),
        loop=np.array(columns.loop, dtype=np.int64),
        curve=np.array(columns.curve, dtype=np.int64),
        origin=origin,
        size=size,
    )
