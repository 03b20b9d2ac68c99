"""What a tool meets on its way, from polygons and disks alone: nothing of the planner is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from grassfire.plan.path import Path
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.toolpath import FloatArray, Role

STEP = 0.075
"""Between places of the tool, mm: disks so close leave scallops of STEP^2 / (8 R)."""

CHIP = 1e-3
"""Thinner chips count as none, mm."""

RIM = np.radians(np.arange(-95.0, 95.0, 1.0) + 0.5)
"""Angles from the heading of the places on the rim: what lies behind was passed just before."""

CHUNK = 64
"""Places that are looked at one by one before they become part of the polygon."""


@dataclass(frozen=True)
class Track:
    """Places of the tool at the floor in their order.

    Attributes
    ----------
    points : (n, 2) float array
        mm.
    heading : (n,) float array
        radians.
    gap : (n,) float array
        Distance from the place before, mm.
    role : (n,) int array
    air : (n,) bool array
        Whether the planner says that it lies in cleared area.
    """

    points: FloatArray
    heading: FloatArray
    gap: FloatArray
    role: FloatArray
    air: FloatArray


def sampled(path: Path) -> tuple[FloatArray, FloatArray]:
    """Places along a path and the direction of travel there."""
    points = path.sample(STEP)[0]
    chord = np.gradient(points, axis=0)
    return points, np.arctan2(chord[:, 1], chord[:, 0])


def track(strokes: Sequence[Stroke]) -> tuple[FloatArray, Track]:
    """Places of descents, which clear what they pass, and of all that follows at the floor."""
    descents, rows = [], []
    for stroke in strokes:
        if stroke.kind is StrokeKind.FEED:
            points, heading = sampled(stroke.path)
            size = len(points)
            gap = np.concatenate([[0.0], np.hypot(*np.diff(points, axis=0).T)])
            rows.append(
                (points, heading, gap, np.full(size, int(stroke.role)), np.full(size, stroke.air))
            )
        elif stroke.kind is StrokeKind.DESCEND:
            descents.append(stroke.path.sample(STEP)[0])
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)]
    return np.concatenate(descents), Track(*columns)


def engagement(pocket: shapely.Polygon, start: FloatArray, way: Track, radius: float) -> FloatArray:
    """(n,) angle of the rim that lies in stock at each place, radians.

    Stock is the pocket without all disks before. The disks of long ago are taken out of a polygon,
    the last ones are looked at one by one.
    """
    reach = radius + CHIP
    stock = pocket.difference(shapely.LineString(start).buffer(reach, quad_segs=64))
    angle = np.zeros(len(way.points))
    begins = np.flatnonzero(way.gap == 0.0)
    for begin, end in zip(begins, np.append(begins[1:], len(angle)), strict=True):
        for first in range(begin, end, CHUNK):
            rows = slice(first, min(first + CHUNK, end))
            centres = way.points[rows]
            turn = way.heading[rows, None] + RIM
            rim = centres[:, None] + radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
            shapely.prepare(stock)
            hit = shapely.contains_xy(stock, rim[..., 0], rim[..., 1])
            place, where = np.nonzero(hit)
            away = rim[place, where][:, None] - centres[None]
            earlier = np.arange(len(centres))[None] < place[:, None]
            passed = np.sum(away * away, axis=2) < reach * reach
            hit[place, where] = ~(passed & earlier).any(axis=1)
            angle[rows] = hit.sum(axis=1) * (RIM[1] - RIM[0])
            last = centres if len(centres) > 1 else np.repeat(centres, 2, axis=0)
            stock = stock.difference(shapely.LineString(last).buffer(reach, quad_segs=64))
    return angle


def longest_over(angle: FloatArray, gap: FloatArray, limit: float) -> float:
    """Greatest length of way in a row on which an angle is above a limit, mm."""
    over = np.concatenate([[0], (angle > limit).astype(int), [0]])
    begin, end = np.flatnonzero(np.diff(over) == 1), np.flatnonzero(np.diff(over) == -1)
    along = np.cumsum(gap)
    return max((float(along[j - 1] - along[i]) for i, j in zip(begin, end, strict=True)), default=0)


def swept(strokes: Sequence[Stroke], radius: float) -> shapely.Geometry:
    """Area that the tool passes over at the floor, bounded from inside by far less than a chip."""
    parts = []
    for stroke in strokes:
        if stroke.path.length and stroke.kind is StrokeKind.FEED and stroke.role is not Role.RAPID:
            points = stroke.path.sample(STEP)[0]
            parts.append(shapely.LineString(points).buffer(radius, quad_segs=64))
    return shapely.union_all(parts)
