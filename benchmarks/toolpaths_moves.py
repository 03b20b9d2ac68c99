"""Moves of a program, read from its text without the project's reader, and what they show alone.

Reads G0 to G3 in the XY plane with X Y Z, I J from the start of the arc, and F, in absolute
millimetres: what the posts of the benchmark write. Anything else about motion is an error.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import Voronoi, cKDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
TURN = 2.0 * np.pi

WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
REFUSED = {"G18", "G19", "G20", "G90.1", "G91", "G81", "G82", "G83", "G73", "G5"}
LEVEL = 1e-6
"""Heights that differ less are one, mm."""


@dataclass(frozen=True)
class Moves:
    """Columns of moves; the first position is unknown and its moves are left out.

    Attributes
    ----------
    motion : (n,) int array
        0 rapid, 1 line, 2 clockwise, 3 counter-clockwise.
    start, end : (n, 3) arrays
    centre : (n, 2) array
        NaN for lines.
    feed : (n,) array
        mm/min; 0 before the first F.
    line : (n,) int array
        Line of the text, from 1.
    """

    motion: IntArray
    start: FloatArray
    end: FloatArray
    centre: FloatArray
    feed: FloatArray
    line: IntArray

    @property
    def arc(self) -> NDArray[np.bool_]:
        """Which moves are arcs or helices."""
        return self.motion >= 2

    @property
    def rapid(self) -> NDArray[np.bool_]:
        """Which moves are rapids."""
        return self.motion == 0

    @cached_property
    def sweep(self) -> FloatArray:
        """Signed angles of arcs, counter-clockwise positive, rad; 0 for lines."""
        first, last = self.start[:, :2] - self.centre, self.end[:, :2] - self.centre
        turn = np.arctan2(last[:, 1], last[:, 0]) - np.arctan2(first[:, 1], first[:, 0])
        sign = np.where(self.motion == 3, 1.0, -1.0)
        # coincident ends are a full circle
        turn = np.mod(sign * turn - 1e-9, TURN) + 1e-9
        return np.where(self.arc, sign * turn, 0.0)

    @cached_property
    def radius(self) -> FloatArray:
        """Radii at the starts of arcs, mm; NaN for lines."""
        return np.asarray(np.hypot(*(self.start[:, :2] - self.centre).T))

    @cached_property
    def run(self) -> FloatArray:
        """Lengths in the plane, mm."""
        straight = np.hypot(*(self.end - self.start)[:, :2].T)
        return np.where(self.arc, np.abs(self.sweep) * np.nan_to_num(self.radius), straight)

    @cached_property
    def length(self) -> FloatArray:
        """Lengths in space, mm."""
        return np.asarray(np.hypot(self.run, self.end[:, 2] - self.start[:, 2]))

    def heading(self, at_end: bool) -> FloatArray:
        """Directions in the plane at one end of each move, rad."""
        chord = (self.end - self.start)[:, :2]
        spoke = (self.end if at_end else self.start)[:, :2] - self.centre
        straight = np.arctan2(chord[:, 1], chord[:, 0])
        side = np.where(self.motion == 3, np.pi / 2, -np.pi / 2)
        return np.where(self.arc, np.arctan2(spoke[:, 1], spoke[:, 0]) + side, straight)

    def points(self, chosen: NDArray[np.bool_], step: float) -> FloatArray:
        """Points (m, 2) along some of the moves, at most `step` mm apart, with both ends."""
        index = np.flatnonzero(chosen)
        count = np.maximum(1, np.ceil(self.run[index] / step)).astype(np.int64)
        row = np.repeat(index, count + 1)
        first = np.repeat(np.cumsum(count + 1) - count - 1, count + 1)
        share = (np.arange(len(row)) - first) / np.repeat(count, count + 1)
        chord = self.start[row, :2] + share[:, None] * (self.end - self.start)[row, :2]
        spoke = self.start[row, :2] - self.centre[row]
        angle = np.arctan2(spoke[:, 1], spoke[:, 0]) + share * self.sweep[row]
        around = np.column_stack([np.cos(angle), np.sin(angle)]) * self.radius[row, None]
        return np.where(self.arc[row, None], self.centre[row] + around, chord)


def read_moves(text: str) -> Moves:
    """Moves of a program's text.

    Raises
    ------
    ValueError
        For a word that is not in the subset above.
    """
    position = [np.nan] * 3
    motion, feed = 0, 0.0
    rows: list[tuple[float, ...]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        block = re.sub(r"\([^)]*\)", "", raw).split(";")[0].strip().upper()
        words = {} if block.startswith(("%", "O")) else WORD.findall(block)
        values: dict[str, float] = {}
        for letter, value in words:
            if letter == "G" and float(value) in (0, 1, 2, 3):
                motion = int(float(value))
            elif letter == "G" and f"G{float(value):g}" in REFUSED:
                raise ValueError(f"line {number}: G{value} is not read")
            elif letter not in "GM":
                values[letter] = float(value)
        feed = values.get("F", feed)
        if "R" in values:
            raise ValueError(f"line {number}: arcs by radius are not read")
        if not values.keys() & set("XYZIJ"):
            continue
        goal = [values.get(axis, place) for axis, place in zip("XYZ", position, strict=True)]
        centre = (np.nan, np.nan)
        if motion >= 2:
            centre = (position[0] + values.get("I", 0.0), position[1] + values.get("J", 0.0))
        rows.append((motion, *position, *goal, *centre, feed, number))
        position = goal
    table = np.array(rows, dtype=np.float64).reshape(-1, 11)
    table = table[np.all(np.isfinite(table[:, 1:7]), axis=1)]
    return Moves(
        table[:, 0].astype(np.int64),
        table[:, 1:4],
        table[:, 4:7],
        table[:, 7:9],
        table[:, 9],
        table[:, 10].astype(np.int64),
    )


def fast_length(moves: Moves, feed: float) -> float:
    """Length of feed moves below z = 0 that are faster than `feed`: links in cleared area, mm."""
    low = np.minimum(moves.start[:, 2], moves.end[:, 2]) < -LEVEL
    return float(moves.length[~moves.rapid & low & (moves.feed > 1.001 * feed)].sum())


def steepest_descent(moves: Moves) -> float:
    """Largest angle of feed moves that descend below z = 0 while they travel, degrees."""
    drop = moves.start[:, 2] - moves.end[:, 2]
    sloped = ~moves.rapid & (drop > LEVEL) & (moves.end[:, 2] < -LEVEL) & (moves.run > 1e-6)
    angles = np.degrees(np.arctan2(drop[sloped], moves.run[sloped]))
    return float(angles.max(initial=0.0))


def largest_turn(moves: Moves, resolution: float, shortest: float = 0.01) -> tuple[float, int]:
    """Largest change of direction between consecutive level feed moves, beyond rounding.

    Parameters
    ----------
    resolution : float
        Last decimal of the text, mm: what a rounded end can turn a move by is subtracted.
    shortest : float
        Moves shorter than this are left out, mm.

    Returns
    -------
    turn : float
        Degrees.
    line : int
        Line of the text where the second move stands; 0 if there is no such pair.
    """
    level = np.abs(moves.end[:, 2] - moves.start[:, 2]) < LEVEL
    kept = ~moves.rapid & level & (moves.end[:, 2] < -LEVEL) & (moves.run >= shortest)
    pair = np.flatnonzero(kept[:-1] & kept[1:])
    if not len(pair):
        return 0.0, 0
    turn = moves.heading(at_end=False)[pair + 1] - moves.heading(at_end=True)[pair]
    turn = np.abs((turn + np.pi) % TURN - np.pi)
    # both ends of a move may be off by half a decimal in x and y; arcs by their centres too
    slack = (
        np.sqrt(2.0)
        * resolution
        * np.where(moves.arc, 2.0, 1.0)
        / np.maximum(
            np.where(moves.arc, np.minimum(moves.run, np.nan_to_num(moves.radius)), moves.run), 1e-9
        )
    )
    excess = turn - slack[pair] - slack[pair + 1]
    worst = int(np.argmax(excess))
    return float(np.degrees(max(excess[worst], 0.0))), int(moves.line[pair[worst] + 1])


def lap_distance(
    moves: Moves, polygon: shapely.Polygon, floor: float, radius: float, step: float = 0.05
) -> tuple[float, tuple[float, float]]:
    """Largest distance between neighbouring laps at the floor.

    Twice the radius of the largest disk among the positions that the tool can take (the pocket
    less its radius) that the path at the floor does not enter: between parallel laps that is their
    distance. Its centre is a vertex of the Voronoi diagram of the path, or on the boundary of those
    positions. What lies within the loop of an entry that leaves no core does not count.

    Parameters
    ----------
    floor : float
        Height of the level to look at, mm.
    radius : float
        Of the tool, mm.
    step : float
        Of the points along the path, mm; the result is off by less than `step`^2 / distance.

    Returns
    -------
    distance : float
        mm.
    place : (x, y)
    """
    at_floor = (np.abs(moves.end[:, 2] - floor) < LEVEL) & (
        np.abs(moves.start[:, 2] - floor) < LEVEL
    )
    path = np.unique(np.round(moves.points(at_floor & ~moves.rapid, step), 6), axis=0)
    # a path that goes astray is a gouge, and no lap
    path = path[shapely.contains_xy(polygon, path[:, 0], path[:, 1])]
    area = polygon.buffer(-radius, quad_segs=64)
    area = area.difference(shapely.union_all(_entry_loops(moves, floor, radius, step)))
    if len(path) < 4 or area.is_empty:
        return float("nan"), (float("nan"), float("nan"))
    corner = Voronoi(path).vertices
    rim = shapely.get_coordinates(shapely.segmentize(area.boundary, step))
    shapely.prepare(area)
    inside = corner[shapely.contains_xy(area, corner[:, 0], corner[:, 1])]
    candidates = np.concatenate([inside, rim])
    distance, _ = cKDTree(path).query(candidates)
    worst = int(np.argmax(distance))
    place = candidates[worst]
    return 2.0 * float(distance[worst]), (float(place[0]), float(place[1]))


def _entry_loops(moves: Moves, floor: float, radius: float, step: float) -> list[shapely.Polygon]:
    """What descents to the floor wind around, each alone and with the lap that closes it.

    Loops with room for the tool inside would leave a core and are none.
    """
    drop = moves.start[:, 2] - moves.end[:, 2]
    descends = (drop > LEVEL) & (moves.run > 1e-6) & ~moves.rapid
    level = (np.abs(drop) <= LEVEL) & ~moves.rapid & (np.abs(moves.end[:, 2] - floor) < LEVEL)
    rows = np.arange(len(drop))
    loops = []
    for last in np.flatnonzero(descends[:-1] & level[1:]):
        before = np.flatnonzero(~descends[:last])
        first = int(before[-1]) + 1 if len(before) else 0
        way = moves.points((rows >= first) & (rows <= last), step)
        after = np.flatnonzero(~level[last + 1 :])
        end = last + 1 + (int(after[0]) if len(after) else len(level) - last - 1)
        lap = moves.points((rows > last) & (rows < end), step)
        away = np.hypot(*(lap - moves.end[last, :2]).T)
        left = np.flatnonzero(away > radius)
        back = (
            np.flatnonzero((away < 0.25 * radius) & (np.arange(len(lap)) > left[0]))
            if len(left)
            else []
        )
        loops.append(shapely.convex_hull(shapely.MultiPoint(way)))
        if len(back):
            loops.append(shapely.Polygon(lap[: back[0] + 1]).buffer(0))
    narrow = [loop for loop in loops if loop.area > 0 and _inner_radius(loop) <= radius]
    return [loop.buffer(step) for loop in narrow]


def _inner_radius(shape: shapely.Polygon) -> float:
    """Radius of the largest disk inside, within 0.01 mm."""
    return float(shapely.maximum_inscribed_circle(shape, tolerance=0.01).length)
