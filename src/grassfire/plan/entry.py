"""Ways down to a new floor: helix, ramp along a ring, plunge."""

from __future__ import annotations

import math
from dataclasses import dataclass

from grassfire.plan.path import Path, circle, join, repeat, segment
from grassfire.toolpath import FloatArray

NO_CORE = 0.95
"""Largest helix radius as a part of the tool radius: a larger one could leave a core."""

LEAST_HELIX = 0.25
"""Smallest helix radius as a part of the tool radius; below it the ring itself is the ramp."""


@dataclass(frozen=True)
class Descent:
    """A way down and the flat path that cleans its floor.

    Attributes
    ----------
    down : Path
        Travelled while z falls evenly with the length.
    flat : Path
        Travelled at the floor afterwards.
    """

    down: Path
    flat: Path


def helix(centre: FloatArray, start: FloatArray, drop: float, slope: float, turn: int) -> Descent:
    """Whole turns about `centre` from above `start`, then one flat turn.

    Parameters
    ----------
    centre, start : (2,) float arrays
        mm.
    drop : float
        Height to lose, mm.
    slope : float
        Steepest descent, radians; the turns are equal and no steeper.
    turn : int
        +1 counter-clockwise, -1 clockwise.
    """
    radius = math.hypot(*(start - centre))
    pitch = 2 * math.pi * radius * math.tan(slope)
    lap = circle(centre, start, turn)
    return Descent(repeat(lap, max(1, math.ceil(drop / pitch - 1e-9))), lap)


def ramp(ring: Path, drop: float, slope: float, snap: float = 2e-3) -> tuple[Path, float]:
    """Descend along a closed ring from its start, `drop` mm at `slope` radians at most.

    Several laps where one is too short. The ring must be cut once more, flat, from where the
    descent ends.

    Returns
    -------
    down : Path
    along : float
        Arc length on the ring where it ends, mm; lengthened to a joint that is within `snap` mm.
    """
    needed = drop / math.tan(slope)
    laps = int(needed // ring.length)
    rest = needed - laps * ring.length
    ahead = ring.cumulative[ring.cumulative >= rest]
    if ahead[0] - rest <= snap:
        rest = float(ahead[0])
    parts = [ring] * laps
    if rest > 0.0:
        parts.append(ring.slice(0.0, rest))
    return join(*parts), rest


def plunge(point: FloatArray) -> Path:
    """Straight down at `point` (2,): a path without length."""
    return segment(point, point)


def smallest_lap(tool_radius: float) -> float:
    """Length of a turn of the smallest helix that is chosen freely, mm."""
    return 2 * math.pi * LEAST_HELIX * tool_radius


def helix_radius(
    peak_radius: float, ring: float, wall: float, tool_radius: float, ring_length: float
) -> float | None:
    """Radius of a helix about the centre of the largest disk of a component, None for a ramp.

    The tool centre must stay where the clearance is at least `wall`; best it stays inside the
    first ring, so that the way from the helix to the ring is a straight move outwards. Where
    only a tight helix fits, a longer ring is the better ramp.

    Parameters
    ----------
    peak_radius : float
        Clearance at the centre, mm.
    ring, wall : float
        Wall distances of the ring to be cut next and of the wall ring, mm.
    tool_radius : float
        mm.
    ring_length : float
        Of the longest ring, mm.
    """
    least, most = LEAST_HELIX * tool_radius, NO_CORE * tool_radius
    inside_ring, room = peak_radius - ring, peak_radius - wall
    if inside_ring >= least:
        return min(inside_ring, most)
    if room >= least:
        return least
    return room if 2 * math.pi * room > ring_length else None
