"""Smooth ways as lines and arcs: biarcs through samples, links tangent at both ends."""

from __future__ import annotations

import numpy as np

from grassfire.plan.path import Path
from grassfire.plan.pursuit import unit, wrapped
from grassfire.toolpath import FloatArray

LARGEST_RADIUS = 1e4
"""Arcs of a larger radius become lines, mm; their sagitta is far below any tolerance."""


def _biarcs(
    begin: FloatArray, end: FloatArray, leave: FloatArray, arrive: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Joint (m, 2) and turns (m, 2) of the biarcs with given ends and headings.

    Both tangent arms are equally long: with V = end - begin, T = t0 + t1, the arm d solves
    V.V - 2 d V.T - 2 d^2 (1 - t0.t1) = 0 (Bolton 1975, "Biarc curves").
    """
    first, last = unit(leave), unit(arrive)
    chord = end - begin
    along = np.sum(chord * (first + last), axis=1)
    bend = 2 * (1 - np.sum(first * last, axis=1))
    size = np.sum(chord * chord, axis=1)
    # the stable root: also right where the headings agree
    arm = size / np.maximum(along + np.sqrt(along**2 + bend * size), 1e-300)
    joint = (begin + end + arm[:, None] * (first - last)) / 2
    halves = []
    for start, stop, heading, sign in ((begin, joint, leave, 1.0), (joint, end, arrive, -1.0)):
        direction = np.arctan2(stop[:, 1] - start[:, 1], stop[:, 0] - start[:, 0])
        halves.append(sign * 2 * wrapped(direction - heading))
    return joint, np.stack(halves, axis=1)


def _centres(begin: FloatArray, end: FloatArray, turn: FloatArray) -> FloatArray:
    """(m, 2) centres of arcs by their chords and sweeps; far away for straight ones."""
    chord = end - begin
    cot = 1 / np.tan(np.where(np.abs(turn) < 1e-9, 1e-9, turn) / 2)
    normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    return np.asarray((begin + end + normal * cot[:, None]) / 2)


def fit(points: FloatArray, headings: FloatArray, tolerance: FloatArray) -> Path:
    """Lines and arcs through samples of a smooth curve, tangent-continuous.

    Parameters
    ----------
    points : (n, 2) float array
        At least two, mm.
    headings : (n,) float array
        Direction of travel at each, radians.
    tolerance : (n,) float array
        How far samples may lie from the path, mm.
    """
    low, high = np.array([0]), np.array([len(points) - 1])
    done: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
    while len(low):
        joint, turn = _biarcs(points[low], points[high], headings[low], headings[high])
        error = _deviation(points, tolerance, low, high, joint, turn)
        good = (error <= 1.0) | (high - low <= 1)
        done.append((low[good], high[good], joint[good], turn[good]))
        low, high = low[~good], high[~good]
        middle = (low + high) // 2
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    first, last, joints, turns = (np.concatenate(column) for column in zip(*done, strict=True))
    order = np.argsort(first)
    return _as_path(points[first[order]], joints[order], points[last[order]], turns[order])


def _deviation(
    points: FloatArray,
    tolerance: FloatArray,
    low: FloatArray,
    high: FloatArray,
    joint: FloatArray,
    turn: FloatArray,
) -> FloatArray:
    """(m,) largest distance of the samples between low and high from each biarc, in tolerances."""
    count = high - low - 1
    owner = np.repeat(np.arange(len(low)), np.maximum(count, 0))
    result = np.zeros(len(low))
    if not len(owner):
        return result
    start = np.cumsum(np.maximum(count, 0)) - np.maximum(count, 0)
    number = low[owner] + 1 + np.arange(len(owner)) - start[owner]
    sample = points[number]
    begin, end = points[low], points[high]
    across = end - begin
    second = np.sum((sample - joint[owner]) * across[owner], axis=1) > 0
    off = np.empty(len(owner))
    for half, (one, two) in enumerate(((begin, joint), (joint, end))):
        rows = np.flatnonzero(second == bool(half))
        which = owner[rows]
        centre = _centres(one, two, turn[:, half])[which]
        radius = np.hypot(*(one[which] - centre).T)
        off[rows] = np.abs(np.hypot(*(sample[rows] - centre).T) - radius)
    np.maximum.at(result, owner, off / tolerance[number])
    # a biarc that turns back has left its samples
    result[np.any(np.abs(turn) > np.pi, axis=1)] = np.inf
    return result


def _as_path(begin: FloatArray, joint: FloatArray, end: FloatArray, turn: FloatArray) -> Path:
    points = np.concatenate([np.stack([begin, joint], axis=1).reshape(-1, 2), end[-1:]])
    sweep = turn.reshape(-1)
    chord = np.diff(points, axis=0)
    size = np.hypot(chord[:, 0], chord[:, 1])
    keep = size > 1e-9
    points = np.concatenate([points[:-1][keep], points[-1:]])
    sweep, size = sweep[keep], size[keep]
    flat = np.abs(sweep) * LARGEST_RADIUS < size
    sweep = np.where(flat, 0.0, sweep)
    centre = _centres(points[:-1], points[1:], sweep)
    return Path(points, np.where(flat[:, None], np.nan, centre), sweep)


def tangent_link(
    start: FloatArray, leave: float, end: FloatArray, arrive: float, radius: float
) -> Path | None:
    """Left arc, straight way, left arc: from one heading into another, away from stock at right.

    The shortest such way (Dubins 1957, type LSL); None where both places and headings agree.

    Parameters
    ----------
    start, end : (2,) float arrays
        mm.
    leave, arrive : float
        Headings, radians.
    radius : float
        Of both arcs, mm.
    """
    first = start + radius * unit(leave + np.pi / 2)
    last = end + radius * unit(arrive + np.pi / 2)
    way = last - first
    course = float(np.arctan2(way[1], way[0])) if np.hypot(*way) > 1e-9 else arrive
    turns = [(course - leave) % (2 * np.pi), (arrive - course) % (2 * np.pi)]
    # a turn of nearly a full circle is none, but for rounding
    turns = [0.0 if 2 * np.pi - turn < 1e-6 else turn for turn in turns]
    corners = [start, first + radius * unit(course - np.pi / 2)]
    corners += [last + radius * unit(course - np.pi / 2), end]
    nan = np.full(2, np.nan)
    pieces = [(first, turns[0]), (nan, 0.0), (last, turns[1])]
    points, centre, sweep = [corners[0]], [], []
    for corner, (middle, turn) in zip(corners[1:], pieces, strict=True):
        if np.hypot(*(corner - points[-1])) > 1e-6:
            points.append(corner)
            centre.append(middle if turn else nan)
            sweep.append(turn)
    if len(points) < 2:
        return None
    points[-1] = end
    return Path(np.array(points), np.array(centre), np.array(sweep))


def rounded(path: Path, radius: float) -> Path:
    """Straight pieces with arcs for corners, of `radius` mm or less where pieces are short."""
    chord = np.diff(path.points, axis=0)
    size = np.hypot(chord[:, 0], chord[:, 1])
    along = chord / size[:, None]
    heading = np.arctan2(chord[:, 1], chord[:, 0])
    turn = wrapped(np.diff(heading))
    room = np.minimum(size[:-1], size[1:]) / 2
    cut = np.minimum(radius * np.tan(np.abs(turn) / 2), room)
    corner = path.points[1:-1]
    before, after = corner - along[:-1] * cut[:, None], corner + along[1:] * cut[:, None]
    points = np.concatenate(
        [path.points[:1], np.stack([before, after], axis=1).reshape(-1, 2), path.points[-1:]]
    )
    sweep = np.zeros(len(points) - 1)
    sweep[1::2] = turn
    keep = np.hypot(*np.diff(points, axis=0).T) > 1e-6
    begin, stop = points[:-1][keep], points[1:][keep]
    points, sweep = np.concatenate([begin, stop[-1:]]), sweep[keep]
    centre = _centres(points[:-1], points[1:], sweep)
    return Path(points, np.where(sweep[:, None] == 0.0, np.nan, centre), sweep)
