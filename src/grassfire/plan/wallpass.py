"""The wall once more: laps of all wall rings, with arcs on to them and off them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grassfire.medial import MedialAxis
from grassfire.plan import entry, link
from grassfire.plan.link import Interior, RingPlace, RingSet
from grassfire.plan.path import Path
from grassfire.plan.strategy import ClearingSettings
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.toolpath import FloatArray, Role

PROOF = 1e-3
"""Clearance that a lead may lack, mm: below what the rings themselves may deviate."""


def wall_pass(
    axis: MedialAxis, rings: Sequence[Path], settings: ClearingSettings, position: FloatArray
) -> list[Stroke]:
    """Every wall ring once, the nearest next, with tangential arcs where there is room.

    Parameters
    ----------
    axis : MedialAxis
    rings : sequence of Path
        Wall rings of one component, in the sense of travel, mm.
    settings : ClearingSettings
    position : (2,) float array
        Where the tool is, mm.
    """
    strokes: list[Stroke] = []
    left = RingSet(rings)
    inside = Interior(axis, rings, settings.wall)
    while left.left.any():
        place = left.nearest_left(position)[0]
        left.left[place.ring] = False
        lap, lead_in, lead_out = _with_leads(axis, left.rings[place.ring], place, settings)
        start = lap.start if lead_in is None else lead_in.start
        way = link.straight(position, start)
        if way is not None and inside.holds(position[None], start[None])[0]:
            strokes.append(Stroke(StrokeKind.FEED, way, Role.LINK, air=True))
        elif way is not None:
            strokes.append(Stroke(StrokeKind.HOP, entry.plunge(start), Role.LINK))
        for path, role in ((lead_in, Role.LEAD), (lap, Role.FINISH), (lead_out, Role.LEAD)):
            if path is not None:
                strokes.append(Stroke(StrokeKind.FEED, path, role))
                position = path.end
    return strokes


def _with_leads(
    axis: MedialAxis, ring: Path, place: RingPlace, settings: ClearingSettings
) -> tuple[Path, Path | None, Path | None]:
    """A ring from where a tangential lead fits, and quarter arcs on to it and off it.

    The circle of a lead of radius q that touches the ring at p has its centre q inwards; it keeps
    to the pocket exactly where the clearance of that centre is at least wall + q.
    """
    by_length = np.argsort(-ring.lengths, kind="stable")[:6]
    middles = ring.cumulative[by_length] + ring.lengths[by_length] / 2
    alongs = np.concatenate([[place.nearest.along], middles])
    radii = settings.tool_radius * np.array([0.5, 0.25, 0.1])
    side = 1.0 if settings.climb else -1.0
    tangents = np.array([ring.tangent(along) for along in alongs])
    inwards = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1) * side
    centres = ring.at(alongs)[None] + radii[:, None, None] * inwards[None]
    room = axis.clearance(centres.reshape(-1, 2)).reshape(len(radii), len(alongs))
    fits = np.argwhere(room >= settings.wall + radii[:, None] - PROOF)
    if not len(fits):
        return ring.started_at(place.nearest.along), None, None
    size, which = (int(value) for value in fits[0])
    lap = ring.started_at(float(alongs[which]), snap=1e-9)
    centre, reach = centres[size, which], radii[size] * tangents[which]
    turn = np.array([side * np.pi / 2])
    lead_in = Path(np.stack([centre - reach, lap.start]), centre[None], turn)
    lead_out = Path(np.stack([lap.start, centre + reach]), centre[None], turn)
    return lap, lead_in, lead_out
