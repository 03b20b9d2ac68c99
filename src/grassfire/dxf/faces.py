"""Faces of a plane graph of curves: how chains go on where more than two ends meet."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from grassfire.geometry import Curve

Walk = list[tuple[int, bool]]
"""Edges in order, each with whether it is walked backwards."""


@dataclass(frozen=True)
class Edge:
    """A curve between two numbered nodes."""

    start: int
    end: int
    curve: Curve


def split_at_repeats(walk: Walk, edges: list[Edge]) -> list[Walk]:
    """Cut a closed walk into closed walks that visit every node once.

    An edge walked there and back right after (a spur) disappears.
    """
    cycles: list[Walk] = []
    path: Walk = []
    position: dict[int, int] = {}
    for index, backward in walk:
        edge = edges[index]
        start, end = (edge.end, edge.start) if backward else (edge.start, edge.end)
        position.setdefault(start, len(path))
        path.append((index, backward))
        if end in position:
            cut = position[end]
            cycle, path = path[cut:], path[:cut]
            for number, reverse in cycle:
                position.pop(edges[number].end if reverse else edges[number].start, None)
            position[end] = cut
            spur = len(cycle) == 2 and cycle[0][0] == cycle[1][0]
            if not spur:
                cycles.append(cycle)
    return cycles


def bounded_faces(component: list[int], edges: list[Edge]) -> tuple[list[Walk], list[int]]:
    """Return the outlines of the bounded faces of a connected plane graph.

    Parameters
    ----------
    component : list of int
        Edges of the graph; no node has fewer than two.
    edges : list of Edge

    Returns
    -------
    list of closed walks, list of int
        Each walk is counter-clockwise and visits a node once; the edges that bound no face.
    """
    around: dict[int, list[tuple[int, bool]]] = defaultdict(list)
    for index in component:
        around[edges[index].start].append((index, False))
        around[edges[index].end].append((index, True))
    following: dict[tuple[int, bool], tuple[int, bool]] = {}
    for leaving in around.values():
        ordered = sorted(leaving, key=lambda half: _direction(edges[half[0]].curve, half[1]))
        for place, half in enumerate(ordered):
            # Arriving against `half`, the face on the left goes on with the next one clockwise.
            following[half[0], not half[1]] = ordered[place - 1]
    seen: set[tuple[int, bool]] = set()
    faces: dict[frozenset[int], Walk] = {}
    for index in component:
        for backward in (False, True):
            half = (index, backward)
            walk: Walk = []
            while half not in seen:
                seen.add(half)
                walk.append(half)
                half = following[half]
            for cycle in split_at_repeats(walk, edges):
                if _area(cycle, edges) > 0.0:
                    faces.setdefault(frozenset(number for number, _ in cycle), cycle)
    used = {index for face in faces for index in face}
    return list(faces.values()), sorted(set(component) - used)


def _direction(curve: Curve, backward: bool) -> tuple[float, float]:
    """Return a sort key, counter-clockwise: direction in which the curve leaves, then its bend."""
    t = 1.0 if backward else 0.0
    tangent = curve.tangent(t) * (-1.0 if backward else 1.0)
    bend = float(curve.curvature(t)) * (-1.0 if backward else 1.0)
    # Tangent curves differ by rounding only; their curvature tells which one is on the left.
    angle = round(math.atan2(tangent[1], tangent[0]), 6)
    return (-round(math.pi, 6) if angle >= round(math.pi, 6) else angle, bend)


def _area(cycle: Walk, edges: list[Edge]) -> float:
    """Return the signed area that a closed walk encloses, by chords fine enough for its sign."""
    t = np.linspace(0.0, 1.0, 33)
    parts = [edges[index].curve.point(t[::-1] if backward else t)[:-1] for index, backward in cycle]
    points = np.concatenate(parts)
    points = points - points[0]
    after = np.roll(points, -1, axis=0)
    return 0.5 * float(np.sum(points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]))
