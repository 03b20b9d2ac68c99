"""What to do at one depth, and its translation into moves for every depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from grassfire.plan.feeds import Feeds
from grassfire.plan.path import Path, segment
from grassfire.toolpath import FloatArray, MoveKind, Role, ToolpathBuilder

RETRACT = 1.0
"""What a retract costs besides its length, s: two stops more, and a mark on the floor."""


LIFT_SLOPE = 0.25
"""Height over length of the rise and fall of lifted links."""

SHORTEST_RUN = 0.01
"""Shorter pieces of lifted links are left out, mm."""

_LINE, _ARC_CW, _ARC_CCW = int(MoveKind.LINE), int(MoveKind.ARC_CW), int(MoveKind.ARC_CCW)


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
    approach : Path, optional
        DESCEND: a way to its start from the end of the stroke before that is proven so, where the
        straight one is not.
    wall : bool
        CUT: leaves the finished wall.
    steady : bool
        CUT: its engagement is known not to exceed that of a straight cut.
    between : bool
        Left out at the last depth, where the finishing strokes do the same.
    """

    kind: StrokeKind
    path: Path
    role: Role
    air: bool = False
    wall: bool = False
    approach: Path | None = None
    steady: bool = False
    between: bool = False


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
    lift : float
        How far links through cleared area rise above the floor.
    """

    top: float
    retract: float
    clearance: float
    above_floor: float
    rapid: float
    lift: float = 0.0

    def entry_height(self, previous_floor: float) -> float:
        """Where a descent from a floor (or from the top of the stock) starts."""
        return min(previous_floor + self.above_floor, self.retract)


class Emitter:
    """Writes strokes as moves; knows where the tool is and which heights are safe."""

    def __init__(self, builder: ToolpathBuilder, levels: Levels, feeds: Feeds) -> None:
        self.builder = builder
        self.levels = levels
        self.feeds = feeds
        self._known: dict[int, tuple[Stroke, FloatArray]] = {}

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
        ends, centres, sweeps = path.rows
        if start == stop:
            places = [(x, y, stop) for x, y in ends]
        else:
            z = start + (stop - start) * path.cumulative / max(path.length, 1e-300)
            z[-1] = stop
            heights = z[1:].tolist()
            places = [(x, y, height) for (x, y), height in zip(ends, heights, strict=True)]
        kinds = [
            _LINE if sweep == 0.0 else _ARC_CCW if sweep > 0.0 else _ARC_CW for sweep in sweeps
        ]
        self.builder.extend(kinds, places, centres, feed.tolist(), role)

    def descend(self, stroke: Stroke, previous_floor: float, floor: float, stay: bool) -> None:
        """Reach the start of a descent and sink to the floor."""
        entry = self.levels.entry_height(previous_floor)
        start = stroke.path.start
        approach = stroke.approach
        if approach is None and stroke.air and not np.array_equal(self.place, start):
            approach = segment(self.place, start)
        if stay and (approach is None or self._worth_staying(approach.length, start, entry)):
            x, y, z = self.builder.position
            if z < entry:
                self.builder.line(x, y, entry, self.feeds.link, Role.LINK)
            if approach is not None:
                feed = self.feeds.along(approach, Role.LINK)
                self.follow(approach, Role.LINK, entry, entry, feed)
        else:
            self.travel(start, self.levels.retract)
            self.lower(entry)
        if stroke.path.length > 0:
            feed = self.feeds.along(stroke.path, Role.ENTRY)
            self.follow(stroke.path, Role.ENTRY, entry, floor, feed)
        else:
            self.builder.line(start[0], start[1], floor, self.feeds.plunge, Role.ENTRY)

    def _worth_staying(self, length: float, target: FloatArray, entry: float) -> bool:
        """Whether feeding across at the height of entry is no slower than retracting."""
        x, y, z = self.builder.position
        distance = float(np.hypot(target[0] - x, target[1] - y))
        height = 2 * self.levels.retract - entry - z
        retracted = (distance + height) / self.levels.rapid + RETRACT / 60
        return length / self.feeds.link <= retracted

    def stroke(self, stroke: Stroke, previous_floor: float, floor: float, first_pass: bool) -> None:
        """Write one stroke of the pass from `previous_floor` to `floor`."""
        if stroke.kind is StrokeKind.DESCEND:
            stay = (stroke.air or stroke.approach is not None) and not first_pass
            self.descend(stroke, previous_floor, floor, stay)
        elif stroke.kind is StrokeKind.HOP:
            start = stroke.path.start
            self.travel(start, self.levels.retract)
            # cuts are fitted: beside the place a film of this pass may stand
            self.lower(self.levels.entry_height(previous_floor))
            self.builder.line(start[0], start[1], floor, self.feeds.plunge, Role.LINK)
        else:
            feed = self._speeds(stroke)
            if stroke.role is Role.LINK and stroke.air and self.levels.lift > 0:
                self._lifted(stroke.path, floor, feed)
            else:
                self.follow(stroke.path, stroke.role, floor, floor, feed)

    def _speeds(self, stroke: Stroke) -> FloatArray:
        """(n,) feed of each piece of a stroke at the floor, the same at every depth, mm/min."""
        known = self._known.get(id(stroke))
        if known is not None and known[0] is stroke:
            return known[1]
        feed = self.feeds.along(stroke.path, stroke.role, stroke.wall, stroke.steady)
        if stroke.role is Role.LINK and not stroke.air:
            feed = np.minimum(feed, self.feeds.cut)
        self._known[id(stroke)] = stroke, feed
        return feed

    def _lifted(self, path: Path, floor: float, feed: FloatArray) -> None:
        """A link that rises over its first stretch and sinks over its last one.

        By the lift, no steeper than `LIFT_SLOPE`, and not above clearance height.
        """
        lift = min(self.levels.lift, self.levels.clearance - floor, path.length / 2 * LIFT_SLOPE)
        run = lift / LIFT_SLOPE
        if run <= SHORTEST_RUN:
            self.follow(path, Role.LINK, floor, floor, feed)
            return
        most = float(feed[0])
        high, stop = floor + lift, path.length - run
        parts = [(path.slice(0.0, run), floor, high)]
        if stop - run > SHORTEST_RUN:
            parts.append((path.slice(run, stop), high, high))
        else:
            stop = run
        parts.append((path.slice(stop, path.length), high, floor))
        for part, begin, end in parts:
            self.follow(part, Role.LINK, begin, end, np.full(len(part), most))

    def passes(
        self, strokes: Sequence[Stroke], finish: Sequence[Stroke], floors: FloatArray
    ) -> None:
        """All passes of one pocket, then its finishing strokes on the last floor."""
        previous = self.levels.top
        for index, floor in enumerate(floors.tolist()):
            last = index == len(floors) - 1
            for stroke in strokes:
                if stroke.between and last:
                    continue
                self.stroke(stroke, previous, floor, first_pass=index == 0)
            previous = floor
        for stroke in finish:
            self.stroke(stroke, previous, previous, first_pass=False)
