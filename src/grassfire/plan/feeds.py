"""Feeds by what a move does, and by which way its path bends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grassfire.plan.path import Path
from grassfire.toolpath import FloatArray, Role

LEAST_FACTOR = 0.25
"""Inside arcs are never slowed below this part of the feed."""

LEAST_SLOWING = 0.025
"""Inside arcs whose chips would be thicker by less than this part keep the feed."""


@dataclass(frozen=True)
class Feeds:
    """Feeds of one operation, mm/min.

    Attributes
    ----------
    cut, link, entry, plunge : float
        In stock; through cleared area; in a slot, down a ramp; straight down.
    tool_radius, stepover, stepdown : float
        Tool; width and depth of a straight cut, mm.
    slope : float
        Steepest descent of a helix, radians.
    inside : int
        Sign of the sweep of arcs that lie inside a corner of the wall: +1 where the wall is on
        the right of the travel (climb), -1 on the left (conventional).
    corrected : bool
        Whether cuts on inside arcs are slowed.
    thinning : float
        By how much cuts are faster whose engagement is known not to exceed that of a straight
        cut.
    """

    cut: float
    link: float
    entry: float
    plunge: float
    tool_radius: float
    inside: int
    stepover: float
    stepdown: float
    slope: float
    corrected: bool = True
    thinning: float = 1.0

    def along(self, path: Path, role: Role, wall: bool = False, steady: bool = False) -> FloatArray:
        """(n,) feed of each piece of a path, mm/min.

        Parameters
        ----------
        path : Path
        role : Role
        wall : bool
            Whether the cut leaves the finished wall, where the marks of the teeth are seen.
        steady : bool
            Whether its engagement is known not to exceed that of a straight cut.
        """
        if role is Role.ENTRY:
            return self._entering(path)
        base = self.link if role is Role.LINK else self.cut
        feed = np.full(len(path), float(base))
        if steady and role is Role.CUT and not wall:
            feed *= self.thinning
        if not self.corrected:
            return feed
        if role is Role.FINISH or (wall and role is Role.CUT):
            feed *= self.edge_factor(path)
        elif role is Role.LEAD or (role is Role.CUT and not steady):
            feed *= self.chip_factor(path)
        return feed

    def edge_factor(self, path: Path) -> FloatArray:
        """(n,) ratio of centre feed to edge feed: r / (r + R) on inside arcs of radius r, else 1.

        The cutting edge on the wall of an inside arc moves on a radius larger by that of the
        tool; at the programmed feed its marks would be as much further apart. Not below
        `LEAST_FACTOR`.
        """
        concave = path.sweep * self.inside > 0
        radius = np.where(concave, path.radius, 1.0)
        factor = np.maximum(radius / (radius + self.tool_radius), LEAST_FACTOR)
        return np.where(concave, factor, 1.0)

    def chip_factor(self, path: Path) -> FloatArray:
        """(n,) factor on inside arcs that leaves chips as thick as those of a straight cut, else 1.

        A chip is thickest where the tool enters or leaves the stock: feed per tooth times
        sin(engagement), up to a right angle. A straight cut of width a engages e with
        cos e = 1 - a / R; on an inside arc of radius r, in stock up to r + R - a from its
        centre, it is cos e = 1 - (a / R) (r + R - a / 2) / r: more. Not below `LEAST_FACTOR`, and 1
        where it would be nearly that.
        """
        concave = path.sweep * self.inside > 0
        radius = np.where(concave, path.radius, 1.0)
        share = self.stepover / self.tool_radius
        wider = share * (radius + self.tool_radius - self.stepover / 2) / radius
        straight, arc = (
            np.sqrt(1 - (1 - np.minimum(value, 1.0)) ** 2) for value in (np.asarray(share), wider)
        )
        slowed = concave & (straight < (1 - LEAST_SLOWING) * arc)
        return np.where(slowed, np.maximum(straight / arc, LEAST_FACTOR), 1.0)

    def _entering(self, path: Path) -> FloatArray:
        """(n,) feed in full width: whole turns of a helix remove no more per minute than a cut.

        Down a slope t, turns of radius r remove pi (r + R)^2 tan t per length of path (r <= R),
        or 4 pi r R tan t (r > R), where a straight cut removes stepover times stepdown. They are
        never slower than ramps, nor sink faster than `plunge`.
        """
        feed = np.full(len(path), float(self.entry))
        turns = np.flatnonzero(np.abs(path.sweep) >= 2 * math.pi * (1 - 1e-9))
        if len(turns):
            radius, tool = path.radius[turns], self.tool_radius
            section = np.where(radius <= tool, (radius + tool) ** 2, 4 * radius * tool)
            removed = math.pi * section * math.tan(self.slope)
            most = min(self.cut, self.plunge / math.sin(self.slope))
            allowed = self.cut * self.stepover * self.stepdown / removed
            feed[turns] = np.clip(allowed, self.entry, max(most, self.entry))
        return feed


def entry_feed(feed: float, plunge_feed: float, ramp_angle: float) -> float:
    """Feed in a slot and down a ramp, mm/min: half the cutting feed, sinking at `plunge_feed`.

    Parameters
    ----------
    feed, plunge_feed : float
        In a side cut and straight down, mm/min.
    ramp_angle : float
        Slope, radians.
    """
    return min(max(feed / 2, min(plunge_feed, feed)), plunge_feed / math.sin(ramp_angle))
