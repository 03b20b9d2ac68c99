"""What to do at one depth, and its translation into moves for every depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from grassfire.plan.feeds import Feeds
from grassfire.plan.path import Path
from grassfire.toolpath import FloatArray, Role, ToolpathBuilder


class StrokeKind(Enum):
    """How a stroke moves in z."""

    DESCEND = "descend"
    """Travel to the start at a safe height, then sink evenly along the path to the floor."""
    FEED = "feed"
    """Along the path at the floor."""
    HOP = "hop"
    """Retract, travel to the start of the path, come straight down: it is cleared there."""


@dataclass(frozen=True)
class Stroke:
    """One step of a plan in the plane.

    Attributes
    ----------
    kind : StrokeKind
    path : Path
    role : Role
    air : bool
        FEED: proven to lie in cleared area. DESCEND: the straight way to its start from the stroke
        before is proven to lie where every pass before this one has cleared.
    """

    kind: StrokeKind
    path: Path
    role: Role
    air: bool = False


@dataclass(frozen=True)
class Levels:
    """Heights that moves use, mm.

    Attributes
    ----------
    top, retract, clearance : float
    above_floor : float
        How far above the floor of the pass before a descent starts.
    rapid : float
        Speed of rapids, mm/min.
    """

    top: float
    retract: float
    clearance: float
    above_floor: float
    rapid: float

    def entry_height(self, previous_floor: float) -> float:
        """Where a descent from a floor (or from the top of the stock) starts."""
        return min(previous_floor + self.above_floor, self.retract)


class Emitter:
    """Writes strokes as moves; knows where the tool is and which heights are safe."""

    def __init__(self, builder: ToolpathBuilder, levels: Levels, feeds: Feeds) -> None:
        self.builder = builder
        self.levels = levels
        self.feeds = feeds

    @property
    def place(self) -> FloatArray:
        """(2,) where the tool is; NaN before the first travel."""
        return np.array(self.builder.position[:2])

    def travel(self, target: FloatArray, height: float) -> None:
        """Up to `height`, then across to `target` (2,) by rapids, one axis group at a time."""
        x, y, z = self.builder.position
        if z < height:
            self.builder.rapid(x, y, height)
        if not (x == target[0] and y == target[1]):
            self.builder.rapid(target[0], target[1], max(z, height))

    def lower(self, height: float) -> None:
        """Rapid straight down to `height`, through air or what the passes before have cleared."""
        x, y, z = self.builder.position
        if z > height:
            self.builder.rapid(x, y, height)

    def follow(self, path: Path, role: Role, start: float, stop: float, feed: FloatArray) -> None:
        """Travel a path while z goes evenly with the length from `start` to `stop`."""
        z = start + (stop - start) * path.cumulative / max(path.length, 1e-300)
        z[-1] = stop
        points, centre, sweep = path.points.tolist(), path.centre.tolist(), path.sweep.tolist()
        heights, speeds = z.tolist(), feed.tolist()
        for index, turn in enumerate(sweep):
            x, y = points[index + 1]
            if turn == 0.0:
                self.builder.line(x, y, heights[index + 1], speeds[index], role)
            else:
                middle = (centre[index][0], centre[index][1])
                self.builder.arc(x, y, heights[index + 1], middle, turn > 0, speeds[index], role)

    def descend(self, stroke: Stroke, previous_floor: float, floor: float, stay: bool) -> None:
        """Reach the start of a descent and sink to the floor."""
        entry = self.levels.entry_height(previous_floor)
        start = stroke.path.start
        x, y, z = self.builder.position
        if stay and self._worth_staying(start, entry):
            if z < entry:
                self.builder.line(x, y, entry, self.feeds.link, Role.LINK)
            self.builder.line(start[0], start[1], entry, self.feeds.link, Role.LINK)
        else:
            self.travel(start, self.levels.retract)
            self.lower(entry)
        if stroke.path.length > 0:
            feed = self.feeds.along(stroke.path, Role.ENTRY)
            self.follow(stroke.path, Role.ENTRY, entry, floor, feed)
        else:
            self.builder.line(start[0], start[1], floor, self.feeds.plunge, Role.ENTRY)

    def _worth_staying(self, target: FloatArray, entry: float) -> bool:
        """Whether feeding across at the height of entry is no slower than retracting."""
        x, y, z = self.builder.position
        distance = float(np.hypot(target[0] - x, target[1] - y))
        height = 2 * self.levels.retract - entry - z
        # two stops more, each a few tenths of a second
        retracted = (distance + height) / self.levels.rapid + 0.5 / 60
        return distance / self.feeds.link <= retracted

    def stroke(self, stroke: Stroke, previous_floor: float, floor: float, first_pass: bool) -> None:
        """Write one stroke of the pass from `previous_floor` to `floor`."""
        if stroke.kind is StrokeKind.DESCEND:
            self.descend(stroke, previous_floor, floor, stroke.air and not first_pass)
        elif stroke.kind is StrokeKind.HOP:
            start = stroke.path.start
            self.travel(start, self.levels.retract)
            self.lower(min(floor + self.levels.above_floor, self.levels.retract))
            self.builder.line(start[0], start[1], floor, self.feeds.plunge, Role.LINK)
        else:
            feed = self.feeds.along(stroke.path, stroke.role)
            if stroke.role is Role.LINK and not stroke.air:
                feed = np.minimum(feed, self.feeds.cut)
            self.follow(stroke.path, stroke.role, floor, floor, feed)

    def passes(
        self, strokes: Sequence[Stroke], finish: Sequence[Stroke], floors: FloatArray
    ) -> None:
        """All passes of one pocket, then its finishing strokes on the last floor."""
        previous = self.levels.top
        for index, floor in enumerate(floors.tolist()):
            for stroke in strokes:
                self.stroke(stroke, previous, floor, first_pass=index == 0)
            previous = floor
        for stroke in finish:
            self.stroke(stroke, previous, previous, first_pass=False)
