"""Feeds by what a move does, and by which way its path bends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grassfire.plan.path import Path
from grassfire.toolpath import FloatArray, Role

LEAST_FACTOR = 0.25
"""Inside arcs are never slowed below this part of the feed."""


@dataclass(frozen=True)
class Feeds:
    """Feeds of one operation, mm/min.

    Attributes
    ----------
    cut, link, entry, plunge : float
        In stock; through cleared area; down a helix or ramp; straight down.
    tool_radius : float
        mm.
    inside : int
        Sign of the sweep of arcs that lie inside a corner of the wall: +1 where the wall is on
        the right of the travel (climb), -1 on the left (conventional).
    """

    cut: float
    link: float
    entry: float
    plunge: float
    tool_radius: float
    inside: int

    def along(self, path: Path, role: Role) -> FloatArray:
        """(n,) feed of each piece of a path, mm/min."""
        base = {
            Role.ENTRY: self.entry,
            Role.LINK: self.link,
            Role.LEAD: self.cut,
            Role.CUT: self.cut,
            Role.FINISH: self.cut,
        }[role]
        feed = np.full(len(path), float(base))
        if role in (Role.CUT, Role.FINISH, Role.LEAD):
            feed *= self.inside_factor(path)
        return feed

    def inside_factor(self, path: Path) -> FloatArray:
        """(n,) ratio of centre feed to edge feed: r / (r + R) on inside arcs of radius r, else 1.

        The cutting edge on the wall of an inside arc moves on a radius larger by that of the
        tool; at the programmed feed its chips would be thicker by as much. Not below
        `LEAST_FACTOR`.
        """
        concave = path.sweep * self.inside > 0
        radius = np.where(concave, path.radius, 1.0)
        factor = np.maximum(radius / (radius + self.tool_radius), LEAST_FACTOR)
        return np.where(concave, factor, 1.0)


def entry_feed(feed: float, plunge_feed: float, ramp_angle: float) -> float:
    """Feed down a slope, mm/min: half the cutting feed, sinking no faster than `plunge_feed`.

    Parameters
    ----------
    feed, plunge_feed : float
        In a side cut and straight down, mm/min.
    ramp_angle : float
        Slope, radians.
    """
    return min(max(feed / 2, min(plunge_feed, feed)), plunge_feed / math.sin(ramp_angle))
