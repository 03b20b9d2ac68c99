"""Shank and holder: what of the tool is above its flutes, against walls and standing stock."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from grassfire.verify.checks import Place, lower_end, report_moves
from grassfire.verify.gouge import Walls, stretches_between
from grassfire.verify.model import Fault, FloatArray, Target
from grassfire.verify.path import BELOW, Path
from grassfire.verify.removal import Body

_CLEARANCE = 0.005
"""A shank or holder closer to a wall rubs, mm."""

_WORDS = {"shank": "the shank", "holder": "the holder"}


def find_bodies(path: Path, served: Sequence[Target], top: float) -> tuple[Body, ...]:
    """Return the shanks and holders that come below the stock's top, with their moves.

    A shank thinner than the cutter runs in what the cutter has cleared.
    """
    known = path.known
    bodies = []
    for kind in _WORDS:
        rows: dict[tuple[float, float], list[int]] = {}
        for index, target in enumerate(served):
            length, radius = target.body(kind)
            if length is not None and radius is not None and radius >= target.tool_radius - 1e-6:
                rows.setdefault((length, radius), []).append(index)
        for (length, radius), sections in rows.items():
            own = np.isin(path.section, sections) & known & (path.low + length < top - BELOW)
            if own.any():
                bodies.append(Body(kind, np.flatnonzero(own), radius, length))
    return tuple(bodies)


def check_bodies(
    path: Path,
    bodies: Sequence[Body],
    hits: Sequence[FloatArray],
    targets: Sequence[Target],
    allowance: FloatArray,
    top: float,
) -> list[Fault]:
    """Return faults of shanks and holders at walls (exact) and in stock (from the sweep).

    `hits` are the areas (mm2) of standing stock that each move of each body runs into.
    """
    faults: list[Fault] = []
    for body, area in zip(bodies, hits, strict=True):
        overlap, places = _wall_overlap(path, body, targets, allowance, top)
        name = _WORDS[body.kind]
        moves = np.flatnonzero(overlap > 0)

        def place_of(
            index: int, moves: np.ndarray = moves, places: dict[int, Place] = places
        ) -> Place:
            return places.get(int(moves[index])) or lower_end(path, int(moves[index]))

        faults += report_moves(
            body.kind,
            path,
            moves,
            overlap[moves],
            f"{name} comes {{:.3f}} mm too close to the wall".format,
            place_of,
        )
        limit = 0.02 * path.tool_radius**2
        moves = np.flatnonzero((area > limit) & (overlap <= 0))
        faults += report_moves(
            body.kind,
            path,
            moves,
            area[moves],
            f"{name} runs into {{:.3f}} mm2 of standing stock".format,
        )
    return faults


def _wall_overlap(
    path: Path, body: Body, targets: Sequence[Target], allowance: FloatArray, top: float
) -> tuple[FloatArray, dict[int, Place]]:
    """Return (n,) by how much a body comes too close to the walls, mm, and places of the worst.

    At height h the walls are those of the regions whose floor is no higher.
    """
    overlap = np.zeros(len(path))
    places: dict[int, Place] = {}
    high = top - BELOW
    floors = sorted({round(item.floor, 9) for item in targets}, reverse=True)
    for index, floor in enumerate(floors):
        low = floor if index + 1 < len(floors) else -np.inf
        deep = [item.region for item in targets if round(item.floor, 9) <= floor]
        walls = Walls(shapely.union_all(deep))
        stretch = stretches_between(path, body.moves, low - body.length, high - body.length)
        high = low
        if not len(stretch.move):
            continue
        need = body.radius + allowance[stretch.move] + _CLEARANCE
        over = need - walls.clearance(path, stretch, need).distance
        over = np.where(over > 1e-9, over, 0.0)
        np.maximum.at(overlap, stretch.move, over)
        rows = np.flatnonzero(over)
        for row in (
            rows[[np.argmin(stretch.move[rows]), np.argmax(over[rows])]] if len(rows) else []
        ):
            places.setdefault(int(stretch.move[row]), walls.worst_place(path, stretch, int(row)))
    return overlap, places
