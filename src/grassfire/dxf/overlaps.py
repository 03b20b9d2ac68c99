"""Lines along lines and arcs along arcs: cut where they overlap, so that duplicates show."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from grassfire.dxf.entities import Piece
from grassfire.geometry import Arc, Line
from grassfire.geometry.neighbours import Neighbours
from grassfire.report import Finding, Severity

FloatArray = NDArray[np.float64]


def split_overlaps(
    pieces: tuple[Piece, ...], tolerance: float, findings: list[Finding]
) -> tuple[Piece, ...]:
    """Cut lines and arcs that run along each other at each other's ends.

    Parameters
    ----------
    pieces : tuple of Piece
    tolerance : float
        How far apart, in mm, curves may be to run along each other.
    findings : list of Finding
        Receives one finding per overlapping pair.

    Returns
    -------
    tuple of Piece
        In the same order; overlapped stretches are there once per curve that had them.
    """
    cuts: dict[int, set[float]] = {}
    _line_overlaps(pieces, tolerance, cuts, findings)
    _arc_overlaps(pieces, tolerance, cuts, findings)
    if not cuts:
        return pieces
    result: list[Piece] = []
    for index, piece in enumerate(pieces):
        if index not in cuts:
            result.append(piece)
            continue
        parameters = [0.0, *sorted(cuts[index]), 1.0]
        for first, last in itertools.pairwise(parameters):
            part = piece.curve.subcurve(first, last)
            result.append(Piece(part, piece.handle, piece.layer, index))
    return tuple(result)


def _note(one: Piece, other: Piece, place: FloatArray, size: float) -> Finding:
    return Finding(
        Severity.REPAIR,
        "overlap",
        f"runs along entity {other.handle} for {size:.6g} mm: kept once",
        one.handle,
        (float(place[0]), float(place[1])),
        size,
    )


def _line_overlaps(
    pieces: tuple[Piece, ...],
    tolerance: float,
    cuts: dict[int, set[float]],
    findings: list[Finding],
) -> None:
    """Find pairs of collinear overlapping lines by an R-tree of the ends against the lines."""
    import shapely

    lines = [i for i, piece in enumerate(pieces) if isinstance(piece.curve, Line)]
    if len(lines) < 2:
        return
    ends = np.array([(pieces[i].curve.start, pieces[i].curve.end) for i in lines])
    tree = shapely.STRtree(shapely.linestrings(ends))
    points = shapely.points(ends.reshape(-1, 2))
    hits = tree.query(points, predicate="dwithin", distance=tolerance)
    owner, target = hits[0] // 2, hits[1]
    pairs = np.unique(np.sort(np.column_stack([owner, target])[owner != target], axis=1), axis=0)
    if len(pairs) == 0:
        return
    # One shared point is no overlap: both ends of the common stretch must lie on both lines.
    base, head = ends[pairs[:, 0], 0], ends[pairs[:, 0], 1]
    along = head - base
    length = np.hypot(*along.T)
    unit = along / length[:, None]
    offset = ends[pairs[:, 1]] - base[:, None]
    position = np.einsum("nij,nj->ni", offset, unit)
    beside = offset[..., 1] * unit[:, None, 0] - offset[..., 0] * unit[:, None, 1]
    low = np.maximum(position.min(axis=1), 0.0)
    high = np.minimum(position.max(axis=1), length)
    common = high - low
    span = np.diff(position, axis=1)[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (beside[:, 1] - beside[:, 0]) / span
        at_low = beside[:, 0] + slope * (low - position[:, 0])
        at_high = beside[:, 0] + slope * (high - position[:, 0])
        close = (np.abs(at_low) <= tolerance) & (np.abs(at_high) <= tolerance)
    overlapping = close & (common > 10.0 * tolerance)
    for row in np.flatnonzero(overlapping).tolist():
        first, second = (lines[int(value)] for value in pairs[row])
        reach = float(length[row])
        _add_cuts(cuts, first, position[row] / reach, reach, tolerance)
        extent = float(span[row])
        inverse = (np.array([0.0, reach]) - position[row, 0]) / extent
        _add_cuts(cuts, second, inverse, abs(extent), tolerance)
        place = base[row] + unit[row] * 0.5 * float(low[row] + high[row])
        findings.append(_note(pieces[second], pieces[first], place, float(common[row])))


def _add_cuts(
    cuts: dict[int, set[float]], index: int, parameters: FloatArray, length: float, tolerance: float
) -> None:
    margin = tolerance / length
    inner = [float(t) for t in parameters if margin < t < 1.0 - margin]
    known = cuts.setdefault(index, set())
    for t in inner:
        if all(abs(t - other) > margin for other in known):
            known.add(t)


def _arc_overlaps(
    pieces: tuple[Piece, ...],
    tolerance: float,
    cuts: dict[int, set[float]],
    findings: list[Finding],
) -> None:
    """Find pairs of arcs of one circle that overlap, by a k-d tree over centre and radius."""
    arcs = [
        (index, piece.curve) for index, piece in enumerate(pieces) if isinstance(piece.curve, Arc)
    ]
    if len(arcs) < 2:
        return
    circles = np.array([(*arc.centre, arc.radius) for _, arc in arcs])
    pairs = Neighbours(circles).pairs(tolerance)
    for low, high in sorted(map(tuple, np.sort(pairs, axis=1).tolist())):
        (first, one), (second, other) = arcs[low], arcs[high]
        if _shared_turn(one, other) * one.radius <= 10.0 * tolerance:
            continue
        for index, arc, by in ((first, one, other), (second, other, one)):
            angles = np.array([by.start_angle, by.start_angle + by.sweep])
            inside = _parameter(arc, angles)
            _add_cuts(cuts, index, inside, abs(arc.sweep) * arc.radius, tolerance)
        place = other.point(0.5)
        size = _shared_turn(one, other) * one.radius
        findings.append(_note(pieces[second], pieces[first], place, size))


def _parameter(arc: Arc, angles: FloatArray) -> FloatArray:
    """Return the arc's parameters (0 to 1 inside, more outside) at the given polar angles."""
    turn = (angles - arc.start_angle) * math.copysign(1.0, arc.sweep)
    return np.asarray(np.mod(turn, 2.0 * math.pi) / abs(arc.sweep))


def _shared_turn(one: Arc, other: Arc) -> float:
    """Return the angle of the stretches common to two arcs of one circle, in radians."""
    start = _ccw_start(other) - _ccw_start(one)
    first = start % (2.0 * math.pi)
    total = 0.0
    for shift in (0.0, -2.0 * math.pi):
        low = max(0.0, first + shift)
        high = min(abs(one.sweep), first + shift + abs(other.sweep))
        total += max(0.0, high - low)
    return total


def _ccw_start(arc: Arc) -> float:
    return float(arc.start_angle + min(arc.sweep, 0.0))
