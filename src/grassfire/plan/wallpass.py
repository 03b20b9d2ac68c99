"""The wall once more: laps of all wall rings, with arcs on to them and off them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from grassfire.medial import MedialAxis
from grassfire.plan import entry, link
from grassfire.plan.link import Interior, RingSet
from grassfire.plan.path import Path
from grassfire.plan.strategy import ClearingSettings
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.toolpath import FloatArray, Role

PROOF = 1e-3
"""Clearance that a lead may lack, mm: below what the rings themselves may deviate."""

LEADS = (0.5, 0.25, 0.1)
"""Radii of leads that are tried, as parts of the tool radius."""

PLACES = 6
"""Middles of the longest pieces of a ring where leads are tried."""

Way = Callable[[FloatArray, FloatArray], Path | None]
"""A way at the floor between two places through what is cleared, if it is worth it."""


def wall_pass(
    axis: MedialAxis,
    rings: Sequence[Path],
    settings: ClearingSettings,
    position: FloatArray,
    way: Way | None = None,
    onward: bool = False,
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
    way : callable, optional
        Ways to the next ring; by default the straight one, where it keeps inside the rings.
    onward : bool
        Whether the only ring is begun without a lead where the tool is on it: it has come along it.
    """
    if onward and len(rings) == 1:
        place = rings[0].nearest(position)
        if place.distance <= PROOF:
            return _once_more(axis, rings[0], settings, position, place.along)
    way = way or _inside(axis, rings, settings)
    strokes: list[Stroke] = []
    left = RingSet(rings)
    while left.left.any():
        place_on = left.nearest_left(position)[0]
        left.left[place_on.ring] = False
        along = place_on.nearest.along
        lap, lead_in, lead_out = _with_leads(axis, left.rings[place_on.ring], along, settings)
        start = lap.start if lead_in is None else lead_in.start
        strokes += _approach(position, start, way)
        strokes += _lap(lead_in, lap, lead_out)
        position = strokes[-1].path.end
    return strokes


def _inside(axis: MedialAxis, rings: Sequence[Path], settings: ClearingSettings) -> Way:
    """Straight ways that keep inside the rings."""
    inside = Interior(axis, rings, settings.wall)

    def way(start: FloatArray, end: FloatArray) -> Path | None:
        return link.straight(start, end) if inside.holds(start[None], end[None])[0] else None

    return way


def _approach(position: FloatArray, target: FloatArray, way: Way) -> list[Stroke]:
    """To a place on the last floor, all of which is cleared."""
    if link.straight(position, target) is None:
        return []
    found = way(position, target)
    if found is None:
        return [Stroke(StrokeKind.HOP, entry.plunge(target), Role.LINK)]
    return [Stroke(StrokeKind.FEED, found, Role.LINK, air=True)]


def _lap(lead_in: Path | None, lap: Path, lead_out: Path | None) -> list[Stroke]:
    """A lap with its leads."""
    parts = ((lead_in, Role.LEAD), (lap, Role.FINISH), (lead_out, Role.LEAD))
    return [Stroke(StrokeKind.FEED, path, role) for path, role in parts if path is not None]


def _once_more(
    axis: MedialAxis, ring: Path, settings: ClearingSettings, position: FloatArray, along: float
) -> list[Stroke]:
    """The only ring, straight on from the lap before it, and a tangential arc off it."""
    lead_out = _with_leads(axis, ring, along, settings, places=0)[2]
    lap = ring.started_at(along, snap=1e-9)
    way = link.straight(position, lap.start)
    # at the feed of cuts: slivers may stand in its way
    strokes = [] if way is None else [Stroke(StrokeKind.FEED, way, Role.LINK)]
    return strokes + _lap(None, lap, lead_out)


def _with_leads(
    axis: MedialAxis, ring: Path, along: float, settings: ClearingSettings, places: int = PLACES
) -> tuple[Path, Path | None, Path | None]:
    """A ring from where a tangential lead fits, and quarter arcs on to it and off it.

    The circle of a lead of radius q that touches the ring at p has its centre q inwards; it keeps
    to the pocket exactly where the clearance of that centre is at least wall + q.
    """
    by_length = np.argsort(-ring.lengths, kind="stable")[:places]
    middles = ring.cumulative[by_length] + ring.lengths[by_length] / 2
    alongs = np.concatenate([[along], middles])
    radii = settings.tool_radius * np.array(LEADS)
    side = 1.0 if settings.climb else -1.0
    tangents = np.array([ring.tangent(place) for place in alongs])
    inwards = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1) * side
    centres = ring.at(alongs)[None] + radii[:, None, None] * inwards[None]
    room = axis.clearance(centres.reshape(-1, 2)).reshape(len(radii), len(alongs))
    fits = np.argwhere(room >= settings.wall + radii[:, None] - PROOF)
    if not len(fits):
        return ring.started_at(along), None, None
    size, which = (int(value) for value in fits[0])
    lap = ring.started_at(float(alongs[which]), snap=1e-9)
    centre, reach = centres[size, which], radii[size] * tangents[which]
    turn = np.array([side * np.pi / 2])
    lead_in = Path(np.stack([centre - reach, lap.start]), centre[None], turn)
    lead_out = Path(np.stack([lap.start, centre + reach]), centre[None], turn)
    return lap, lead_in, lead_out
