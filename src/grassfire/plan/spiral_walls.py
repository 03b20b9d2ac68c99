"""Laps along the walls of one pocket, in an order, linked where that is possible."""

from __future__ import annotations

import numpy as np

from grassfire.medial import MedialAxis
from grassfire.plan import entry, link
from grassfire.plan.link import Interior, RingSet
from grassfire.plan.path import Path
from grassfire.plan.places import Places
from grassfire.plan.rings import Component
from grassfire.plan.spiral_curve import filleted
from grassfire.plan.strategy import ClearingSettings
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.toolpath import FloatArray, Role

CORNER = 0.05
"""Radius that corners of laps before the finishing one get, as a part of the tool radius."""

CORNER_LEFT = 0.021
"""What these may leave, as a part of the tool radius, a right corner's share: a finishing lap at
full depth meets it at the thickness of all passes."""

LAST_LEFT, MOST_LEFT = 0.004, 0.02
"""What rounded corners of the last laps may leave, as a part of the tool radius, and mm: enough
for a path without corners."""

TRIES = 16
"""Places on a ring from which a straight way to cleared area is looked for."""

CLEARED = 0.5
"""Distance between places where the tool is remembered to have been, mm."""


class WallLaps:
    """The wall rings of a pocket whose inside is cleared.

    Parameters
    ----------
    axis : MedialAxis
    part : Component
        Of the wall level.
    settings : ClearingSettings

    Attributes
    ----------
    rings, last : tuple of Path
        As they are cut before the finishing laps, with round corners; as these cut them.
    """

    def __init__(self, axis: MedialAxis, part: Component, settings: ClearingSettings) -> None:
        self._axis = axis
        self._settings = settings
        radius = CORNER * settings.tool_radius
        least = min(LAST_LEFT * settings.tool_radius, MOST_LEFT)
        self.last = tuple(filleted(ring, radius, least) for ring in part.rings)
        left_over = CORNER_LEFT * settings.tool_radius if settings.finish else least
        self.rings = tuple(filleted(ring, radius, left_over) for ring in part.rings)
        self._inside = Interior(axis, part.rings, part.distance)
        self._first: tuple[int, Path] | None = None
        self._cleared: list[FloatArray] = []

    def nearest(self, point: FloatArray) -> tuple[Path, float]:
        """The ring nearest to a point, and the arc length on it of the nearest place, mm."""
        place = RingSet(self.rings).nearest_left(point)[0]
        return self.rings[place.ring], place.nearest.along

    def holds(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the straight way between two places keeps inside the rings."""
        return bool(self._inside.holds(start[None], end[None])[0])

    def has_cut(self, path: Path) -> None:
        """Remember where the tool has been."""
        self._cleared.append(path.sample(CLEARED)[0])

    def begin(self, ring: int, lap: Path) -> None:
        """Cut a ring first, as this lap, where the tool is."""
        self._first = (ring, lap)

    def begin_at(self, ring: Path, along: float) -> None:
        """Cut a ring first, from a place on it where the tool is."""
        index = next(row for row, other in enumerate(self.rings) if other is ring)
        self.begin(index, ring.started_at(along, snap=1e-9))

    def laps(self, position: FloatArray) -> list[Stroke]:
        """Strokes along all rings, once each, from where the tool is."""
        strokes: list[Stroke] = []
        rings = RingSet(self.rings)
        last: Path | None = None
        if self._first is not None:
            index, last = self._first
            rings.left[index] = False
            strokes.append(Stroke(StrokeKind.FEED, last, Role.CUT))
            self.has_cut(last)
            position = last.end
        while rings.left.any():
            place = rings.nearest_left(position)[0]
            ring = rings.rings[place.ring]
            way, landing, along = self._way(last, ring, position, place.nearest.along)
            strokes += way
            rings.left[place.ring] = False
            last = ring.started_at(along, snap=1e-9)
            strokes += _straight(landing, last.start)
            strokes.append(Stroke(StrokeKind.FEED, last, Role.CUT))
            self.has_cut(last)
            position = last.end
        return strokes

    def _way(
        self, last: Path | None, ring: Path, position: FloatArray, along: float
    ) -> tuple[list[Stroke], FloatArray, float]:
        """From a place on the ring just cut to another ring: strokes, where they end, and where
        on the ring that is."""
        target = ring.at(np.array([along]))[0]
        if self.holds(position, target):
            return [], position, along
        if last is not None:
            pairs = link.crossings(last, ring)
            total = link.walked(last, pairs.from_along) + pairs.distance
            good = total <= self._settings.longest_walk
            if good.any():
                good[good] = self._inside.holds(pairs.starts[good], pairs.ends[good])
            if good.any():
                chosen = int(np.argmin(np.where(good, total, np.inf)))
                walk = link.walk(last, float(pairs.from_along[chosen]))
                start = pairs.starts[chosen]
                strokes = []
                if walk is not None:
                    strokes.append(Stroke(StrokeKind.FEED, walk, Role.LINK, air=True))
                    start = walk.end
                return strokes, start, float(pairs.to_along[chosen])
        return self._landing(ring, position)

    def _landing(self, ring: Path, position: FloatArray) -> tuple[list[Stroke], FloatArray, float]:
        """Come down where the tool has been, from where a straight way leads to a ring; or ramp
        down along the ring."""
        points, along = ring.sampled
        cleared = np.concatenate(self._cleared)
        distance, nearest = Places(cleared).closest(points)
        best = np.argsort(distance, kind="stable")[:TRIES]
        good = np.flatnonzero(self._inside.holds(cleared[nearest[best]], points[best]))
        if len(good):
            chosen = int(best[good[0]])
            landing = entry.plunge(cleared[nearest[chosen]])
            stroke = Stroke(StrokeKind.HOP, landing, Role.LINK)
            return [stroke], landing.end, float(along[chosen])
        settings = self._settings
        own = ring
        ring = ring.started_at(ring.nearest(position).along)
        down, _ = entry.ramp(ring, settings.drop, settings.slope)
        return [Stroke(StrokeKind.DESCEND, down, Role.ENTRY)], down.end, own.nearest(down.end).along

    def way(self, start: FloatArray, end: FloatArray) -> Path | None:
        """The straight way, where it keeps inside the rings."""
        return link.straight(start, end) if self.holds(start, end) else None


def _straight(start: FloatArray, end: FloatArray) -> list[Stroke]:
    """A link over the floor, at the feed of cuts: slivers may stand in its way."""
    way = link.straight(start, end)
    return [] if way is None else [Stroke(StrokeKind.FEED, way, Role.LINK)]
