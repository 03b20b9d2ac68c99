"""A ruler of the benchmark's own for programs with three-axis moves of a flat tool, on a raster.

Each pass has a map of the squared distance from the middle of a cell to the path so far; what is
nearer than the tool's radius is cleared. A point of the tool's rim is looked up by interpolation
between cells, so that engagement is good to about a degree however coarse the cells are.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray
from toolpaths_moves import LEVEL, Moves

FloatArray = NDArray[np.float64]

CHORD = 0.003
"""How far chords may be off arcs, mm."""

STEP = 0.05
"""Distance between samples along the path, mm."""

RIM = 360
"""Samples around the tool."""

WEDGE = 0.3
"""Part of the stepdown that a sloped entry may leave: it counts neither as stock nor as cut."""

FAR = 1e6


def chords(moves: Moves) -> FloatArray:
    """Straight pieces (m, 8) x0 y0 z0 x1 y1 z1 rapid feed; arcs within `CHORD`."""
    radius = np.where(moves.arc, np.nan_to_num(moves.radius), 1.0)
    widest = 2.0 * np.arccos(np.clip(1.0 - CHORD / np.maximum(radius, CHORD), -1.0, 1.0))
    count = np.maximum(1, np.ceil(np.abs(moves.sweep) / widest)).astype(np.int64)
    row = np.repeat(np.arange(len(count)), count)
    first = np.repeat(np.cumsum(count) - count, count)
    part = (np.arange(len(row)) - first)[:, None] + np.array([0.0, 1.0])
    share = part / count[row, None]
    start = moves.start[row, :2] - moves.centre[row]
    angle = np.arctan2(start[:, 1], start[:, 0])[:, None] + share * moves.sweep[row, None]
    spoke = moves.radius[row, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    chord = moves.start[row, None] + share[..., None] * (moves.end - moves.start)[row, None]
    curved = moves.arc[row, None, None]
    plane = np.where(curved, moves.centre[row, None] + spoke, chord[..., :2])
    ends = np.concatenate([plane, chord[..., 2:]], axis=-1)
    rapid = moves.rapid[row].astype(np.float64)
    return np.column_stack([ends[:, 0], ends[:, 1], rapid, moves.feed[row]])


@njit(cache=True)
def machining_time(
    pieces: FloatArray, acceleration: float, deviation: float, rapid: float
) -> float:
    """Seconds with trapezoids of speed, the speed at corners bounded by junction deviation.

    At a corner that turns by an angle a the speed is at most sqrt(acceleration * deviation *
    s / (1 - s)) with s = cos(a / 2): the centripetal acceleration on the arc that stays within
    `deviation` of the corner (Jeon's rule, as grbl has it).
    """
    n = len(pieces)
    length, speed, corner = np.zeros(n), np.zeros(n), np.zeros(n + 1)
    way = pieces[:, 3:6] - pieces[:, 0:3]
    for i in range(n):
        length[i] = math.sqrt(way[i, 0] ** 2 + way[i, 1] ** 2 + way[i, 2] ** 2)
        feed = rapid if pieces[i, 6] > 0 else max(pieces[i, 7], 1.0)
        speed[i] = feed / 60.0
    for i in range(1, n):
        both = length[i] * length[i - 1]
        if both <= 0.0:
            continue
        cosine = (
            way[i, 0] * way[i - 1, 0] + way[i, 1] * way[i - 1, 1] + way[i, 2] * way[i - 1, 2]
        ) / both
        half = math.sqrt(max(0.0, 0.5 * (1.0 + cosine)))
        slower = min(speed[i], speed[i - 1])
        if half > 1.0 - 1e-7:
            corner[i] = slower
        else:
            corner[i] = min(slower, math.sqrt(acceleration * deviation * half / (1.0 - half)))
    for i in range(n - 1, -1, -1):
        corner[i] = min(corner[i], math.sqrt(corner[i + 1] ** 2 + 2 * acceleration * length[i]))
    total = 0.0
    for i in range(n):
        if length[i] <= 0.0:
            continue
        corner[i + 1] = min(corner[i + 1], math.sqrt(corner[i] ** 2 + 2 * acceleration * length[i]))
        begin, end = corner[i], corner[i + 1]
        peak = math.sqrt(acceleration * length[i] + 0.5 * (begin * begin + end * end))
        top = min(peak, speed[i])
        ramps = (2 * top * top - begin * begin - end * end) / (2 * acceleration)
        total += (2 * top - begin - end) / acceleration + (length[i] - ramps) / top
    return total


@njit(cache=True)
def _look_up(field: FloatArray, column: float, row: float) -> float:
    """Interpolated value between the middles of cells; `FAR` off the map."""
    i, j = math.floor(column), math.floor(row)
    if i < 0 or j < 0 or i + 1 >= field.shape[1] or j + 1 >= field.shape[0]:
        return FAR
    u, v = column - i, row - j
    low = (1 - u) * field[j, i] + u * field[j, i + 1]
    high = (1 - u) * field[j + 1, i] + u * field[j + 1, i + 1]
    return (1 - v) * low + v * high


@njit(cache=True)
def _stamp(
    field: FloatArray, reach: float, ax: float, ay: float, bx: float, by: float, cell: float
) -> int:
    """Lower the map around a straight piece (in cells); return how many cells it clears."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    wide = (reach + 1.0) / cell
    cleared = 0
    limit = reach * reach
    for j in range(
        max(0, int(min(ay, by) - wide)), min(field.shape[0], int(max(ay, by) + wide) + 2)
    ):
        for i in range(
            max(0, int(min(ax, bx) - wide)), min(field.shape[1], int(max(ax, bx) + wide) + 2)
        ):
            share = 0.0
            if square > 0.0:
                share = min(1.0, max(0.0, ((i - ax) * dx + (j - ay) * dy) / square))
            ex, ey = i - ax - share * dx, j - ay - share * dy
            value = (ex * ex + ey * ey) * cell * cell
            if value < field[j, i]:
                if value < limit and field[j, i] >= limit:
                    cleared += 1
                field[j, i] = value
    return cleared


@njit(cache=True)
def _machine(
    fields: FloatArray,
    floors: FloatArray,
    pieces: FloatArray,
    origin: FloatArray,
    cell: float,
    radius: float,
    wedge: float,
    samples: FloatArray,
) -> tuple[int, int, float]:
    """Run the program through the maps.

    `samples` gets rows x, y, z, degrees, length, follows. Returns their number, the count of
    rapids that remove stock, and the depth of plunges through stock.
    """
    passes = len(floors)
    taken, hits, plunge = 0, 0, 0.0
    last = -2
    steps = 0
    noise = 2.0 + 0.02 * (radius / cell) ** 2
    for m in range(len(pieces)):
        ax, ay, az, bx, by, bz, rapid, _ = pieces[m]
        run, rise = math.hypot(bx - ax, by - ay), abs(bz - az)
        count = max(1, math.ceil(max(run, rise) / STEP))
        hit = False
        for k in range(count):
            steps += 1
            low, high = k / count, (k + 1) / count
            x, y, z = ax + (bx - ax) * high, ay + (by - ay) * high, az + (bz - az) * high
            if z >= 0.0:
                continue
            if rapid == 0.0 and run > 1e-9 and bz >= az - LEVEL:
                angle = 0.0
                for level in range(passes):
                    if z > floors[level] + wedge:
                        continue
                    inside = 0
                    heading = math.atan2(by - ay, bx - ax)
                    for q in range(RIM // 2):
                        turn = heading + math.pi * ((q + 0.5) / (RIM // 2) - 0.5)
                        column = (x + radius * math.cos(turn) - origin[0]) / cell
                        row = (y + radius * math.sin(turn) - origin[1]) / cell
                        if _look_up(fields[level], column, row) > radius * radius:
                            inside += 1
                    angle = max(angle, 360.0 * inside / RIM)
                samples[taken, 0], samples[taken, 1], samples[taken, 2] = x, y, z
                samples[taken, 3], samples[taken, 4] = angle, run / count
                samples[taken, 5] = 1.0 if last == steps - 1 else 0.0
                last = steps
                taken += 1
            cleared = 0
            sx = (ax + (bx - ax) * low - origin[0]) / cell
            sy = (ay + (by - ay) * low - origin[1]) / cell
            ex, ey = (x - origin[0]) / cell, (y - origin[1]) / cell
            for level in range(passes):
                if max(z, az + (bz - az) * low) <= floors[level] + wedge:
                    cleared += _stamp(fields[level], radius, sx, sy, ex, ey, cell)
            if cleared > noise:
                hit = True
                if run <= 1e-9 and rapid == 0.0:
                    plunge += rise / count
        if hit and rapid > 0.0:
            hits += 1
    return taken, hits, plunge


def measure_moves(
    moves: Moves, polygon: shapely.Polygon, depth: float, radius: float, stepdown: float
) -> tuple[dict[str, Any], FloatArray]:
    """Figures of a program in a stock whose top is z = 0, and samples of its engagement.

    Returns
    -------
    figures : dict
        gouge_mm, floor_gouge_mm, uncut_pct, rapid_hits, plunge_mm, eng_max, eng_p99, eng_mean,
        air_pct, cut_mm, rapid_mm, retracts, arcs, time_s, area_mm2, errors.
    samples : (n, 6) array
        x, y, z, engagement in degrees, length in mm, whether it follows the one before.
    """
    pieces = chords(moves)
    figures = {**_counts(moves, pieces), **_gouge(moves, polygon, depth, radius)}
    xmin, ymin, xmax, ymax = polygon.bounds
    pad = radius + 2.0
    cell = max(0.05, radius / 40.0, math.sqrt((xmax - xmin) * (ymax - ymin) / 8e6))
    shape = (int((ymax - ymin + 2 * pad) / cell) + 2, int((xmax - xmin + 2 * pad) / cell) + 2)
    passes = max(1, math.ceil(depth / stepdown - 1e-9))
    floors = -depth / passes * np.arange(1, passes + 1)
    fields = np.full((passes, *shape), FAR, dtype=np.float32)
    run = np.hypot(*(pieces[:, 3:5] - pieces[:, 0:2]).T)
    rise = np.abs(pieces[:, 5] - pieces[:, 2])
    room = int(np.maximum(1, np.ceil(np.maximum(run, rise) / STEP)).sum())
    samples = np.zeros((room, 6))
    origin = np.array([xmin - pad, ymin - pad])
    wedge = max(0.02, WEDGE * depth / passes)
    taken, hits, plunge = _machine(fields, floors, pieces, origin, cell, radius, wedge, samples)
    figures["rapid_hits"], figures["plunge_mm"] = int(hits), float(plunge)
    figures["uncut_pct"] = _uncut(fields[-1], polygon, origin, cell, radius)
    figures.update(_engagement(samples[:taken]))
    return figures, samples[:taken]


def _counts(moves: Moves, pieces: FloatArray) -> dict[str, Any]:
    low = np.minimum(moves.start[:, 2], moves.end[:, 2]) < -LEVEL
    up = moves.rapid & (moves.end[:, 2] > moves.start[:, 2] + LEVEL) & (moves.start[:, 2] < 0.0)
    moving = np.any(pieces[:, 0:3] != pieces[:, 3:6], axis=1)
    return {
        "errors": [] if low.any() else ["nothing is cut"],
        "time_s": float(machining_time(pieces[moving], 500.0, 0.01, 5000.0)),
        "cut_mm": float(moves.length[~moves.rapid & low].sum()),
        "rapid_mm": float(moves.length[moves.rapid].sum()),
        "retracts": int(up.sum()),
        "arcs": int(moves.arc.sum()),
    }


def _gouge(moves: Moves, polygon: shapely.Polygon, depth: float, radius: float) -> dict[str, Any]:
    """How far the tool leaves the pocket, from distances of the path to the wall."""
    low = np.minimum(moves.start[:, 2], moves.end[:, 2]) < -LEVEL
    places = moves.points(low, STEP)
    inside = shapely.contains_xy(polygon, places[:, 0], places[:, 1])
    away = shapely.distance(shapely.points(places), polygon.boundary)
    deepest = float(np.minimum(moves.start[:, 2], moves.end[:, 2]).min(initial=0.0))
    return {
        "gouge_mm": float(np.max(radius - np.where(inside, away, -away), initial=0.0)),
        "floor_gouge_mm": max(0.0, -depth - deepest),
        "area_mm2": float(polygon.area),
    }


def _uncut(
    field: FloatArray, polygon: shapely.Polygon, origin: FloatArray, cell: float, radius: float
) -> float:
    """Part of what the tool can reach that is left on the last floor, per cent."""
    reach = polygon.buffer(-radius + 1e-6, quad_segs=64).buffer(radius - 0.01, quad_segs=64)
    rows, columns = np.indices(field.shape)
    x, y = origin[0] + cell * columns.ravel(), origin[1] + cell * rows.ravel()
    wanted = shapely.contains_xy(reach, x, y)
    if not wanted.any():
        return math.nan
    return float(100.0 * np.mean(field.ravel()[wanted] > (radius + 0.002) ** 2))


def _engagement(samples: FloatArray) -> dict[str, float]:
    angle, length = samples[:, 3], samples[:, 4]
    cuts = angle > 0.0
    if not cuts.any():
        return {}
    order = np.argsort(angle[cuts], kind="stable")
    total = np.cumsum(length[cuts][order])
    at = min(int(np.searchsorted(total, 0.99 * total[-1])), len(total) - 1)
    return {
        "eng_max": float(angle.max()),
        "eng_p99": float(angle[cuts][order][at]),
        "eng_mean": float(np.average(angle[cuts], weights=length[cuts])),
        "air_pct": float(100.0 * length[~cuts].sum() / length.sum()),
    }
