"""Clearing at bounded engagement: cuts of constant engagement along the edge of the stock.

The cleared area is a union of tool disks; where its edge meets stock it is a *front*. A cut follows
one front at the engagement limit (`pursuit`), or along the wall where that takes less
(`tracing`), and leaves a new front. The opening cut spirals outwards from the helix until the wall
breaks its front; what is left are fronts from wall to wall, each cut again and again in the same
sense until no stock is ahead of it, with return moves through cleared area between. Islands
divide fronts; behind them fronts meet and eat up what is left between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from grassfire.errors import PlanningError
from grassfire.medial import MedialAxis
from grassfire.plan import entry
from grassfire.plan.chains import Writer
from grassfire.plan.fronts import (
    GRAZE,
    WALL_SKIN,
    Front,
    Fronts,
    length,
    runs,
)
from grassfire.plan.link import straight
from grassfire.plan.offset import offset_pockets
from grassfire.plan.path import Path
from grassfire.plan.places import box
from grassfire.plan.pursuit import unit, wrapped
from grassfire.plan.returns import ROOM, Returns
from grassfire.plan.rings import Component, components
from grassfire.plan.sense import Cut, Sense
from grassfire.plan.stock import ALLOWANCE, Stock
from grassfire.plan.strategy import ClearingSettings, PocketPlan
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.plan.tracing import (
    FIRST_BITE,
    SAMPLING,
    Start,
    Surroundings,
    Tracer,
)
from grassfire.plan.wallpass import wall_pass
from grassfire.plan.walls import Walls
from grassfire.report import Finding, Severity
from grassfire.toolpath import FloatArray, Role

LEAST_HELIX = 0.1
"""Smallest helix as a part of the tool radius; places without room for it are slots."""

MOST_LENGTH = 20.0
"""Longest cut of a pocket, as a multiple of area over stepover: more is a fault."""

MARGIN = 0.0085
"""How far below the limit cuts are laid out, radians: for chords, fits and rounding."""

WIDE = 0.95
"""Room where clearing begins, as a part of the most there is."""

LEAST_TURN = 0.33
"""Smallest helix where there is room for a larger one, as a part of the tool radius."""

LIGHT = 0.28
"""Part of a pass that the flat lap at the foot of the helix may take in depth."""

LAP = 0.5
"""Room that the first lap round the helix takes, as a part of the tool radius."""

LANDINGS = 40
"""Cleared places that are tried for coming down near the start of a cut."""

GRAZING = 0.1
"""How deep the way to a cut may bite in narrow places, as a part of the tool radius."""

CRESCENT, SHARE = np.radians(33.5), 0.6
"""Largest engagement of the last lap in what the last turn of the opening spiral leaves to it,
radians; and how thick that may be over all depths, as a part of what a clearing cut takes. Where
the spiral comes to the wall all round, this turn would take ever less."""

FAR = 4.0
"""Fronts further off than that many tool radii are taken after corners near the tool."""

PECK, PECKED_BACK, MOST_PECKED = 0.028, 0.08, (1.0, 3.5)
"""Bits in which the tool cuts along a wall where it is past the limit, how far it goes back after
each, and the longest ways that it takes so while there are fronts and at last, as parts of its
radius."""

PECK_SKIN = 0.005
"""Thickest film that does not count there, as a part of the tool radius."""

GRACE = np.radians(3.0)
"""How far past the limit ways along walls go before they are cut in bits, radians."""

TIPS, TIP_TURN = ((0.2, 0.7), (0.1, 4.0)), np.radians(90.0)
"""Longest cuts across a tip, and longest ways round it along the walls, that are not cut from wall
to wall any more, as parts of the tool radius; least turn of the walls there, radians."""

LINK_TRIES = 3
"""Fronts that are tried before the tool is retracted."""


def adaptive_pockets(
    axis: MedialAxis, settings: ClearingSettings
) -> tuple[list[PocketPlan], list[Finding]]:
    """All pockets of a region, to be cleared at bounded engagement; and what was noticed."""
    parts = components(
        axis,
        np.array([settings.wall]),
        settings.stepover,
        settings.tool_radius,
        settings.tolerance,
        climb=True,
    )
    pockets: list[PocketPlan] = []
    findings: list[Finding] = []
    slots: list[Component] = []
    for part in parts:
        if part.peak_radius - settings.wall >= LEAST_HELIX * settings.tool_radius:
            pockets.append(AdaptivePocket(axis, part, settings))
        else:
            findings.append(_slot(part.peak, part.peak_radius))
            slots.append(part)
    if slots:
        others, noticed = offset_pockets(axis, settings)
        places = np.array([part.peak for part in slots])
        pockets += [
            pocket
            for pocket in others
            if np.min(np.hypot(*(places - pocket.peak).T)) < settings.tolerance
        ]
        findings += noticed
    return pockets, findings


def _slot(place: FloatArray, radius: float) -> Finding:
    message = (
        "a place hardly wider than the tool is cut in full width, past the engagement limit; a "
        "smaller tool keeps to it"
    )
    return _full_width(message, place, 2 * radius)


def _full_width(message: str, place: FloatArray, size: float) -> Finding:
    where = float(place[0]), float(place[1])
    return Finding(Severity.WARNING, "full-width", message, place=where, size=size)


class AdaptivePocket:
    """Strokes of one pocket, the same for every depth, and those that finish it.

    Parameters
    ----------
    axis : MedialAxis
    part : Component
        At the wall level.
    settings : ClearingSettings

    Attributes
    ----------
    peak : (2,) float array
    strokes, finish : list of Stroke
    findings : list of Finding
        What was noticed while planning.
    """

    def __init__(self, axis: MedialAxis, part: Component, settings: ClearingSettings) -> None:
        self._axis = axis
        self._part = part
        self._settings = settings
        self._radius = settings.tool_radius
        self._step = SAMPLING * self._radius
        engagement = max(settings.engagement - MARGIN, settings.engagement / 2)
        walls = [
            Walls(axis, part.rings, settings.wall, self._step, reflect)
            for reflect in (not settings.climb, settings.climb)[: 2 if settings.both else 1]
        ]
        self._walls = walls[0]
        film = 0.9 * ALLOWANCE * self._radius if settings.finish else 0.0
        tracers = [Tracer(own, self._radius, engagement, film) for own in walls]
        self._tracer = tracers[0]
        self._senses = [
            Sense(tracer, Writer(own, self._radius, self._step), own is not self._walls)
            for tracer, own in zip(tracers, walls, strict=True)
        ]
        self._stock = Stock(self._walls, self._radius, self._step)
        self._returns = Returns(
            axis, self._walls, self._stock, self._radius, settings.minimum_radius
        )
        self._thickest = self._crescent() if settings.finish else ALLOWANCE
        self._length = 0.0
        self._slots: list[tuple[FloatArray, float]] = []
        self._starts: dict[Front, list[Start]] = {}
        self._steps: list[Stroke | Sense] = []
        self._cuts: dict[Sense, list[Cut]] = {sense: [] for sense in self._senses}
        self.peak = part.peak
        self.findings: list[Finding] = []
        self.strokes: list[Stroke] = []
        self.finish: list[Stroke] = []

    def plan(self, position: FloatArray) -> FloatArray:
        """Lay out all strokes; returns where the last one ends, mm."""
        entry_place: tuple[FloatArray, float] | None = self._middle()
        while entry_place is not None:
            place, heading = self._enter(*entry_place)
            place, heading = self._cut_fronts(place, heading)
            entry_place = self._beyond()
        settings, stock = self._settings, self._stock
        while True:
            corners = stock.corners(stock.left) if settings.finish else stock.unswept()
            # each is worth its length and a way there; many of them are a lap
            cost = sum(self._walls.size(low, high) + 3 * self._radius for low, high in corners)
            lap = cost > 0.6 * sum(ring.length for ring in self._part.rings)
            if lap:
                corners = [ends for ends in corners if self._past(self._walls.slice(*ends))]
            place, heading, whole = self._cut_corners(corners, place, heading, True)
            lap |= not whole
            if not stock.fronts:
                break
            place, heading = self._cut_fronts(place, heading)
        self.strokes = self._written()
        self._tell_slots()
        self._tell_turns()
        rings = [ring if settings.climb else ring.reversed() for ring in self._part.rings]
        here = self._walls.frame(place[None])[0]
        if lap or settings.finish:
            last = wall_pass(self._axis, rings, settings, here, self._worth_walking)
            here = last[-1].path.end
            if lap:
                self.strokes += [replace(stroke, between=settings.finish) for stroke in last]
            if settings.finish:
                self.finish += last
        # the next pass begins over what this one has cleared
        end, first = self.strokes[-1].path.end, self.strokes[0]
        start = first.path.start
        there = np.array_equal(end, start)
        way = None if there else self._returns.across(end, start)
        self.strokes[0] = replace(first, air=there, approach=way)
        return np.asarray(here)

    def _cut_fronts(self, place: FloatArray, heading: float) -> tuple[FloatArray, float]:
        """Cut along fronts until there is none; returns place and heading."""
        most = MOST_LENGTH * (self._axis.region.area / self._settings.stepover + self._radius)
        while self._stock.fronts:
            place, heading = self._next(place, heading)
            if self._length > most:
                raise PlanningError(
                    f"cuts of {self._length:.6g} mm have not cleared the pocket",
                    place=(float(self.peak[0]), float(self.peak[1])),
                    remedy="take strategy offset, and report the drawing",
                )
        return place, heading

    def _worth_walking(self, start: FloatArray, end: FloatArray) -> Path | None:
        """A way at the floor between places of the drawing, where it is quicker than a retract."""
        settings = self._settings
        way = self._returns.across(start, end)
        most = settings.longest_walk + settings.link_speed * float(np.hypot(*(end - start)))
        return way if way is not None and way.length <= most else None

    def _cut_corners(
        self, corners: list[tuple[int, int]], place: FloatArray, heading: float, hop: bool
    ) -> tuple[FloatArray, float, bool]:
        """Cut along stretches of the walls, the nearest next; place and heading, and if all were
        reached.

        `hop` says whether those that no way leads to are come down on.
        """
        whole, rest = True, list(corners)
        while rest:
            low, high = min(rest, key=lambda ends: math.dist(place, self._walls.points[ends[0]]))
            rest.remove((low, high))
            path = self._walls.slice(low, high)
            if path is None:
                continue
            past = self._past(path)
            longest = MOST_PECKED[hop] * self._radius
            slots = [ends for ends in past if ends[1] - ends[0] > longest]
            if slots and not hop:
                continue
            start = Start(low, self._walls.points[low], float(self._walls.heading[low]))
            link = self._returns.way(place, heading, start)
            if link is not None:
                self._stroke(StrokeKind.FEED, link, Role.LINK, air=True)
            elif np.hypot(*(place - start.point)) > 1e-9:
                landing = self._landing(place, start) if hop else None
                if landing is None:
                    whole = False
                    continue
                self._land(place, landing, start)
            for first, last in slots:
                middle = self._walls.frame(path.point((first + last) / 2)[None])[0]
                self._slots.append((middle, last - first))
            self._peck(path, [ends for ends in past if ends not in slots])
            place, heading = path.end, float(self._walls.heading[high])
            self._stock.passed_by(path.sample(self._step)[0])
        return place, heading, whole

    def _past(self, path: Path | None) -> list[tuple[float, float]]:
        """Lengths between which a way along the wall is past the limit, mm."""
        if path is None:
            return []
        places, along = path.sample(self._step)
        way = places[1:] - places[:-1]
        heading = np.arctan2(way[:, 1], way[:, 0])
        cleared, limit = self._stock.cleared.within, self._settings.engagement + GRACE
        past = self._tracer.past(cleared, places[1:], heading, limit, PECK_SKIN)
        edges = np.diff(past.astype(np.int8), prepend=0, append=0).nonzero()[0].reshape(-1, 2)
        return [(float(along[first]), float(along[last])) for first, last in edges.tolist()]

    def _peck(self, path: Path, past: Sequence[tuple[float, float]]) -> None:
        """Cut along the wall, between some lengths bit by bit and back each time, mm.

        In the tips of sharp corners there is no room to swing from wall to wall.
        """
        here, bit, back = 0.0, PECK * self._radius, PECKED_BACK * self._radius
        for first, last in past:
            bits = max(math.ceil((last - first) / bit), 1)
            for goal in np.linspace(first, last, bits + 1)[1:-1].tolist():
                self._stroke(StrokeKind.FEED, path.slice(here, goal), Role.CUT)
                here = max(goal - back, 0.0)
                retreat = path.slice(here, goal).reversed()
                self._stroke(StrokeKind.FEED, retreat, Role.LINK, air=True)
        self._stroke(StrokeKind.FEED, path.slice(here, path.length), Role.CUT)

    def _tidied(self, place: FloatArray, heading: float) -> tuple[FloatArray, float]:
        """Corners near the tool, before it leaves for fronts far off; returns place and heading."""
        if not self._settings.finish:
            return place, heading
        near = 3 * self._radius
        pieces = self._stock.left.near(box(place[None]), near)
        pieces = [it for it in pieces if np.hypot(*(it.points - place).T).min() <= near]
        if not pieces:
            return place, heading
        alone = []
        for low, high in self._stock.corners(pieces):
            stretch = self._walls.ahead(low, self._walls.steps(low, high) + 1)
            if not self._stock.fronts.within(self._walls.points[stretch], self._radius).any():
                alone.append((low, high))
        place, heading, _ = self._cut_corners(alone, place, heading, False)
        return place, heading

    def _beyond(self) -> tuple[FloatArray, float] | None:
        """Where to enter again, and the room there: behind necks too narrow for a cut at the limit.

        None where no helix fits into what is left; the wall pass cuts that in full width.
        """
        road, wall = self._returns.map, self._settings.wall
        room = np.where(road.component(wall, self.peak), road.radius - wall, -np.inf)
        reach = self._radius * (1 + GRAZE)
        rows = np.flatnonzero(room > -np.inf)
        stock = rows[~self._stock.cleared.within(self._walls.frame(road.points[rows]), reach)]
        if not len(stock):
            return None
        widest = int(stock[np.argmax(room[stock])])
        if room[widest] < LEAST_HELIX * self._radius:
            self.findings.append(_slot(road.points[widest], float(road.radius[widest])))
            return None
        return road.points[widest], float(room[widest])

    def _enter(self, place: FloatArray, room: float) -> tuple[FloatArray, float]:
        """Helix about a place, then the opening spiral; returns place and heading."""
        centre = self._walls.frame(place[None])[0]
        helix = self._helix_radius()
        if room < helix + LAP * self._radius:
            # no whole lap fits round it: out to the walls at once, which break the front
            helix = min(room, entry.NO_CORE * self._radius)
        angle = np.linspace(0.0, 2 * np.pi, int(2 * np.pi * (helix + self._radius) / self._step))
        front = centre + (helix + self._radius) * unit(angle)
        stock = self._walls.off(front, WALL_SKIN * self._radius)
        stock &= ~self._stock.cleared.within(front, self._radius * (1 + GRAZE / 4))
        outwards = front[0] - self._radius * unit(FIRST_BITE[0]) - centre
        start = centre + helix * outwards / np.hypot(*outwards)
        light = math.atan(LIGHT * self._settings.step / (2 * math.pi * helix))
        slope = min(self._settings.slope, light)
        way = entry.helix(centre, start, self._settings.drop, slope, 1)
        self._stroke(StrokeKind.DESCEND, way.down, Role.ENTRY)
        self._stroke(StrokeKind.FEED, way.flat, Role.ENTRY)
        self._stock.entered(centre + helix * unit(angle[:-1]))
        if not stock.all():
            # the walls break the front at once: begun where one does, its parts are whole
            turn = int(np.argmin(stock))
            chain, stock = np.roll(front[:-1], -turn, axis=0), np.roll(stock[:-1], -turn)
            self._stock.fronts = Fronts(Front(part) for part in runs(chain, stock, 4 * self._step))
            return start, float(np.arctan2(outwards[1], outwards[0]) + np.pi / 2)
        return self._spiral(front, room, start)

    def _spiral(
        self, front: FloatArray, room: float, start: FloatArray
    ) -> tuple[FloatArray, float]:
        """The opening cut from a closed front outwards; returns place and heading."""
        sense, fronts, thick = self._senses[0], Fronts([Front(front)]), self._thickest
        cut = sense.spiral(front, room, partial(self._stock.tail, allowance=ALLOWANCE))
        if cut.begin is None:
            raise PlanningError(
                "no cut fits round the helix",
                place=(float(self.peak[0]), float(self.peak[1])),
                remedy="take a smaller tool or strategy offset",
            )
        alone = thick > ALLOWANCE and all(
            map(self._stock.slight, self._stock.edges(cut, sense.against, fronts)[1])
        )
        if alone:
            # it comes to the wall all round and clears everything: its last turn may be cut short
            cut = sense.spiral(front, room, partial(self._stock.tail, allowance=thick))
        found = self._take(cut, sense, fronts, start)
        if alone:
            self._stock.spare()
        return found

    def _crescent(self) -> float:
        """Thickest stock that the opening spiral may leave round the wall, in tool radii."""
        # a lap of radius r engages the tool over an angle a in what is left within a circle of
        # radius sqrt(r^2 + 1 + 2 r cos a), all in tool radii
        lap = (self._part.peak_radius - self._settings.wall) / self._radius
        inner = math.sqrt(lap**2 + 1 + 2 * lap * math.cos(CRESCENT))
        light = SHARE * self._settings.stepover / (self._settings.passes * self._radius)
        return max(ALLOWANCE, min(lap + 1 - inner, light))

    def _middle(self) -> tuple[FloatArray, float]:
        """Where clearing begins, and the room there: the most there is, if it pays amid the pocket.

        In the middle of a wide pocket the stock falls into two parts whose cuts follow each other
        with short ways between, until these are as long as going back: that saves room squared
        over stepover. In narrow ones it costs a way from one part to the other.
        """
        road, wall = self._returns.map, self._settings.wall
        most = self._part.peak_radius - wall
        inside = road.component(wall, self.peak)
        wide = inside & (road.radius - wall >= WIDE * most)
        if wide.any():
            place, far = road.middle(inside, wide)
            room = float(road.radius[place]) - wall
            if room**2 > far * self._settings.stepover:
                return road.points[place], room
        return self.peak, most

    def _helix_radius(self) -> float:
        """Largest that leaves no core and whose turns sink so little that the last lap is light."""
        sink = LIGHT * self._settings.step
        gentle = sink / (2 * np.pi * np.tan(self._settings.slope))
        return float(np.clip(gentle, LEAST_TURN * self._radius, entry.NO_CORE * self._radius))

    def _next(self, place: FloatArray, heading: float) -> tuple[FloatArray, float]:
        """Cut along the front that is best reached; returns place and heading at its end."""
        starts, gaps = self._all_starts(place)
        if min(gaps) > FAR * self._radius:
            place, heading = self._tidied(place, heading)
            starts, gaps = self._all_starts(place)
            if not starts:
                return place, heading
        chosen, link, landing = self._best(place, heading, starts, gaps)
        index, start = chosen // len(self._senses), starts[chosen]
        if link is None and landing is None and gaps[chosen] > self._step:
            # stock on all sides of all: what is there can only be cut in full width
            self._give_up(index)
            return place, heading
        sense = self._senses[chosen % len(self._senses)]
        front, others = self._stock.fronts[index], self._stock.fronts.without(index)
        cut = sense.cut(
            front.points,
            start,
            Surroundings(others.plus(self._stock.tips).about, self._stock.cleared.within),
        )
        if cut.begin is None:
            # nothing to cut there that a sample tells from nothing
            self._stock.behead(index, sense.against)
            return place, heading
        if self._in_tip(cut, sense):
            self._stock.leave(index)
            return place, heading
        if link is not None:
            self._stroke(StrokeKind.FEED, link, Role.LINK, air=True)
            place = link.end
        elif landing is not None:
            place = self._land(place, landing, start)
        return self._take(cut, sense, Fronts([front]).plus(others), place)

    def _all_starts(self, place: FloatArray) -> tuple[list[Start], list[float]]:
        """Where cuts along all fronts begin, and how far that is from a place, mm."""
        starts = [start for front in self._stock.fronts for start in self._starts_of(front)]
        here = place.tolist()
        return starts, [math.dist(start.point.tolist(), here) for start in starts]

    def _give_up(self, index: int) -> None:
        """Leave a front to the wall pass."""
        front = self._stock.fronts[index]
        if front.length > self._radius:
            place = self._walls.frame(front.points[len(front) // 2][None])[0]
            self._slots.append((place, front.length))
        self._stock.leave(index)

    def _in_tip(self, cut: Cut, sense: Sense) -> bool:
        """Whether what is ahead of a cut is the tip of a sharp corner, too narrow for a swing."""
        size, walls = length(cut.points) / self._radius, self._walls
        longest = max((around for across, around in TIPS if size <= across), default=0.0)
        if not longest:
            return False
        # the walls round what is on the right of the cut run with it
        ends = cut.points[[-1, 0] if sense.against else [0, -1]]
        low, high = walls.nearest(ends[0]), walls.nearest(ends[1])
        apart = walls.first[low] != walls.first[high]
        if apart or walls.size(low, high) > longest * self._radius:
            return False
        turn = wrapped(float(walls.heading[high] - walls.heading[low]))
        return bool(abs(turn) > TIP_TURN)

    def _landing(self, place: FloatArray, start: Start) -> FloatArray | None:
        """Where the tool is or can come down, with a straight way to the start of a cut.

        In narrow places the way may graze stock, at a small part of the engagement allowed.
        """
        # only where the tool has been is certain to be cleared
        near = self._stock.cleared.nearest(start.point, LANDINGS)
        at_start = np.hypot(*(near[0] - start.point)) <= GRAZING * self._radius
        if at_start and self._returns.free(start.point[None])[0]:
            return np.asarray(near[0])
        centres = np.concatenate([place[None], near])
        ends = np.repeat(start.point[None], len(centres), axis=0)
        for bite in (ROOM, GRAZING):
            free = self._returns.holds(
                self._walls.frame(centres), self._walls.frame(ends), bite=bite
            )
            if free.any():
                return np.asarray(centres[int(np.argmax(free))])
        return None

    def _land(self, place: FloatArray, landing: FloatArray, start: Start) -> FloatArray:
        """Come down where the tool can, if it is not there, and cut to the start of a cut."""
        if not np.array_equal(place, landing):
            self._stroke(StrokeKind.HOP, entry.plunge(landing), Role.LINK)
        link = straight(landing, start.point)
        if link is not None:
            self._stroke(StrokeKind.FEED, link, Role.CUT)
        return start.point

    def _best(
        self, place: FloatArray, heading: float, starts: list[Start], gaps: list[float]
    ) -> tuple[int, Path | None, FloatArray | None]:
        """The nearest start that a way leads to, and the way; else one to come down at, and where.

        The nearest without either if there is none, or if the tool is there.
        """
        smooth = len(self._senses) == 1
        order = [int(index) for index in np.argsort(gaps, kind="stable")]
        if gaps[order[0]] <= self._step:
            # so short a way is part of the cut
            return order[0], None, None
        tried = []
        for index in order[:LINK_TRIES]:
            if not self._returns.open(starts[index].point):
                continue
            tried.append(index)
            link = self._returns.direct(place, heading, starts[index], smooth)
            if link is not None:
                return index, link, None
        for index in tried:
            link = self._returns.over_map(place, starts[index])
            if link is not None:
                return index, link, None
        for index in order:
            landing = self._landing(place, starts[index])
            if landing is not None:
                return index, None, landing
        return order[0], None, None

    def _starts_of(self, front: Front) -> list[Start]:
        """Where cuts along a front begin, one for each sense."""
        known = self._starts.get(front)
        if known is None:
            wall, free = self._settings.wall, self._returns.free
            known = [sense.start(front.points, wall, free) for sense in self._senses]
            self._starts[front] = known
        return known

    def _stroke(self, kind: StrokeKind, path: Path, role: Role, air: bool = False) -> None:
        steady = role is Role.CUT
        self._steps.append(Stroke(kind, self._walls.path(path), role, air, steady=steady))

    def _written(self) -> list[Stroke]:
        """All steps as strokes: cuts become lines and arcs all at once."""
        paths = {sense: iter(sense.paths(cuts)) for sense, cuts in self._cuts.items()}
        strokes = []
        for step in self._steps:
            if isinstance(step, Stroke):
                strokes.append(step)
                continue
            path = next(paths[step])
            if path is not None:
                path = self._walls.path(path)
                strokes.append(Stroke(StrokeKind.FEED, path, Role.CUT, steady=True))
        return strokes

    def _tell_slots(self) -> None:
        """Note where cuts are in full width: all such places at once, and the longest."""
        if self._slots:
            place, size = max(self._slots, key=lambda slot: slot[1])
            message = (
                f"cut in full width, past the engagement limit, at {len(self._slots)} places where "
                "no way leads through cleared area or the walls leave no room to swing; a smaller "
                "tool may keep to it"
            )
            self.findings.append(_full_width(message, place, size))

    def _tell_turns(self) -> None:
        """Note where cuts turn tighter than asked: corners and narrow places leave no other way."""
        asked = self._settings.minimum_radius
        paths = [stroke.path for stroke in self.strokes if stroke.role is Role.CUT]
        radius = np.concatenate([np.zeros(0), *(path.radius for path in paths)])
        tight = radius < asked * (1 - 1e-6)
        if tight.any():
            tightest = int(np.argmin(radius))
            start = np.concatenate([path.points[:-1] for path in paths])[tightest]
            message = (
                f"{np.count_nonzero(tight)} arcs of cuts, in corners and narrow places, are "
                f"tighter than minimum_path_radius; the tightest has {radius[tightest]:.3g} mm"
            )
            where = float(start[0]), float(start[1])
            self.findings.append(
                Finding(Severity.INFO, "tight-turns", message, place=where, size=radius[tightest])
            )

    def _take(
        self, cut: Cut, sense: Sense, fronts: Fronts, place: FloatArray
    ) -> tuple[FloatArray, float]:
        """Write a cut and bring cleared area and fronts up to date; the first front was cut."""
        self._length += length(cut.points)
        cut = sense.led(cut, place)
        way = None if cut.begin is None else straight(place, cut.begin)
        if way is not None:
            self._stroke(StrokeKind.FEED, way, Role.CUT)
        self._steps.append(sense)
        self._cuts[sense].append(cut)
        tree, edges = self._stock.edges(cut, sense.against, fronts)
        self._stock.note(tree, edges)
        self._stock.advance(fronts[0], sense.against)
        starts = self._starts
        self._starts = {front: starts[front] for front in self._stock.fronts if front in starts}
        return cut.points[-1], float(cut.heading[-1])
