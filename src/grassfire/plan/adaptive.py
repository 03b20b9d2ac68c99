"""Clearing at bounded engagement: cuts of constant engagement along the edge of the stock.

The cleared area is a union of tool disks; where its edge meets stock it is a *front*. A cut follows
one front at the engagement limit (`pursuit`), or along the wall where that takes less
(`tracing`), and leaves a new front. The opening cut spirals outwards from the helix until the wall
breaks its front; what is left are fronts from wall to wall, each cut again and again in the same
sense until no stock is ahead of it, with return moves through cleared area between. Islands
divide fronts; behind them fronts meet and eat up what is left between them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from grassfire.errors import PlanningError
from grassfire.medial import MedialAxis
from grassfire.plan import entry
from grassfire.plan.fronts import (
    GRAZE,
    SHORTEST,
    WALL_SKIN,
    Disks,
    densified,
    joined,
    length,
    runs,
    swept_edge,
)
from grassfire.plan.link import straight
from grassfire.plan.offset import offset_pockets
from grassfire.plan.path import Path
from grassfire.plan.pursuit import unit
from grassfire.plan.returns import ROOM, Returns
from grassfire.plan.rings import Component, components
from grassfire.plan.strategy import ClearingSettings, PocketPlan
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.plan.tracing import (
    FIRST_BITE,
    SAMPLING,
    Piece,
    Start,
    Tracer,
    direction,
    start_of,
)
from grassfire.plan.wallpass import wall_pass
from grassfire.plan.walls import Walls
from grassfire.report import Finding, Severity
from grassfire.toolpath import FloatArray, Role

LEAST_HELIX = 0.1
"""Smallest helix as a part of the tool radius; places without room for it are slots."""

MOST_LENGTH = 20.0
"""Longest cut of a pocket, as a multiple of area over stepover: more is a fault."""

MARGIN = 0.01
"""How far below the limit cuts are laid out, radians: for chords, fits and rounding."""

LIGHT = 0.28
"""Part of a pass that the flat lap at the foot of the helix may take in depth."""

LAP = 0.5
"""Room that the first lap round the helix takes, as a part of the tool radius."""

LANDINGS = 40
"""Cleared places that are tried for coming down near the start of a cut."""

BESIDE = 4
"""Wall samples before and after what is left at a wall that are cut with it."""

GRAZING = 0.1
"""How deep the way to a cut may bite in narrow places, as a part of the tool radius."""

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
            findings.append(_slot(part))
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


def _slot(part: Component) -> Finding:
    return Finding(
        Severity.WARNING,
        "full-width",
        "a place hardly wider than the tool is cut in full width, past the engagement limit; a "
        "smaller tool keeps to it",
        place=(float(part.peak[0]), float(part.peak[1])),
        size=2 * part.peak_radius,
    )


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
    """

    def __init__(self, axis: MedialAxis, part: Component, settings: ClearingSettings) -> None:
        self._axis = axis
        self._part = part
        self._settings = settings
        self._radius = settings.tool_radius
        self._step = SAMPLING * self._radius
        self._walls = Walls(axis, part.rings, settings.wall, self._step, reflect=not settings.climb)
        engagement = max(settings.engagement - MARGIN, settings.engagement / 2)
        self._tracer = Tracer(self._walls, self._radius, engagement)
        self._returns = Returns(axis, self._walls, settings.wall, self._radius)
        self._cleared = Disks()
        self._fronts: list[FloatArray] = []
        self._left: list[FloatArray] = []
        self._length = 0.0
        self._starts: dict[int, tuple[FloatArray, Start]] = {}
        self.peak = part.peak
        self.strokes: list[Stroke] = []
        self.finish: list[Stroke] = []

    def plan(self, position: FloatArray) -> FloatArray:
        """Lay out all strokes; returns where the last one ends, mm."""
        place, heading = self._enter()
        most = MOST_LENGTH * (self._axis.region.area / self._settings.stepover + self._radius)
        while self._fronts:
            place, heading = self._next(place, heading)
            if self._length > most:
                raise PlanningError(
                    f"cuts of {self._length:.6g} mm have not cleared the pocket",
                    place=(float(self.peak[0]), float(self.peak[1])),
                    remedy="take strategy offset, and report the drawing",
                )
        settings = self._settings
        corners = self._corners() if settings.finish else []
        # each is worth its length and a way there; many of them are a lap
        cost = sum(self._walls.size(low, high) + 3 * self._radius for low, high in corners)
        lap = not settings.finish or cost > 0.6 * sum(ring.length for ring in self._part.rings)
        if not lap:
            place = self._cut_corners(corners, place, heading)
        rings = [ring if settings.climb else ring.reversed() for ring in self._part.rings]
        last = wall_pass(self._axis, rings, settings, self._walls.frame(place[None])[0])
        if lap:
            self.strokes += [replace(stroke, between=settings.finish) for stroke in last]
        self.finish += last if settings.finish else []
        return np.asarray(last[-1].path.end)

    def _corners(self) -> list[tuple[int, int]]:
        """Stretches of the walls where more than cusps are left: first and last samples."""
        if not self._left:
            return []
        left = cKDTree(np.concatenate(self._left))
        least = self._radius * (1 - ROOM)
        near = np.isfinite(left.query(self._walls.points, distance_upper_bound=least)[0])
        return self._walls.stretches(near, BESIDE)

    def _cut_corners(
        self, corners: list[tuple[int, int]], place: FloatArray, heading: float
    ) -> FloatArray:
        """Cut along stretches of the walls; returns where the tool is."""
        for low, high in corners:
            start = Start(low, self._walls.points[low], float(self._walls.heading[low]))
            link = self._returns.way(place, heading, start, True)
            if link is not None:
                self._stroke(StrokeKind.FEED, link, Role.LINK, air=True)
            elif np.hypot(*(place - start.point)) > 1e-9:
                if self._landing(place, start) is not start.point:
                    continue
                self._stroke(StrokeKind.HOP, entry.plunge(start.point), Role.LINK)
            path = self._walls.slice(low, high)
            if path is not None:
                self._stroke(StrokeKind.FEED, path, Role.CUT)
                place, heading = path.end, float(self._walls.heading[high])
        return place

    def _enter(self) -> tuple[FloatArray, float]:
        """Helix in the largest disk, then the opening spiral; returns place and heading."""
        centre = self._walls.frame(self.peak[None])[0]
        room = self._part.peak_radius - self._settings.wall
        helix = self._helix_radius()
        if room < helix + LAP * self._radius:
            # no whole lap fits round it: out to the walls at once, which break the front
            helix = min(room, entry.NO_CORE * self._radius)
        angle = np.linspace(0.0, 2 * np.pi, int(2 * np.pi * (helix + self._radius) / self._step))
        front = centre + (helix + self._radius) * unit(angle)
        stock = self._walls.clearance(front) > WALL_SKIN * self._radius
        outwards = front[0] - self._radius * unit(FIRST_BITE[0]) - centre
        start = centre + helix * outwards / np.hypot(*outwards)
        way = entry.helix(centre, start, self._settings.drop, self._settings.slope, 1)
        self._stroke(StrokeKind.DESCEND, way.down, Role.ENTRY)
        self._stroke(StrokeKind.FEED, way.flat, Role.ENTRY)
        self._cleared.add(centre + helix * unit(angle[:-1]))
        if not stock.all():
            # the walls break the front at once: begun where one does, its parts are whole
            turn = int(np.argmin(stock))
            chain, stock = np.roll(front[:-1], -turn, axis=0), np.roll(stock[:-1], -turn)
            self._fronts = runs(chain, stock, 4 * self._step)
            self._returns.update(self._fronts)
            return start, float(np.arctan2(outwards[1], outwards[0]) + np.pi / 2)
        pieces = self._tracer.spiral(front)
        if not pieces:
            raise PlanningError(
                "no cut fits round the helix",
                place=(float(self.peak[0]), float(self.peak[1])),
                remedy="take a smaller tool or strategy offset",
            )
        return self._take(pieces, [front], start)

    def _helix_radius(self) -> float:
        """Largest that leaves no core and whose turns sink so little that the last lap is light."""
        sink = LIGHT * self._settings.step
        gentle = sink / (2 * np.pi * np.tan(self._settings.slope))
        return float(np.clip(gentle, 0.4 * self._radius, entry.NO_CORE * self._radius))

    def _next(self, place: FloatArray, heading: float) -> tuple[FloatArray, float]:
        """Cut along the front that is best reached; returns place and heading at its end."""
        starts = [self._start(front) for front in self._fronts]
        gaps = [float(np.hypot(*(start.point - place))) for start in starts]
        index, link = self._best(place, heading, starts, gaps)
        front, start = self._fronts[index], starts[index]
        remaining = self._fronts[:index] + self._fronts[index + 1 :]
        pieces = self._tracer.cut(front, start, remaining)
        if sum(len(piece.points) for piece in pieces) < 2:
            # nothing to cut that a sample tells from nothing: the wall pass takes it
            self._left.append(self._fronts.pop(index))
            return place, heading
        if link is not None:
            self._stroke(StrokeKind.FEED, link, Role.LINK, air=True)
            place = link.end
        elif gaps[index] > 1e-9:
            landing = self._landing(place, start)
            if landing is None:
                # stock on all sides: what is there can only be cut in full width
                self._left.append(self._fronts.pop(index))
                return place, heading
            if not np.array_equal(place, landing):
                place = landing
                self._stroke(StrokeKind.HOP, entry.plunge(place), Role.LINK)
            link = straight(place, start.point)
            if link is not None:
                self._stroke(StrokeKind.FEED, link, Role.CUT)
                place = link.end
        return self._take(pieces, [front, *remaining], place)

    def _landing(self, place: FloatArray, start: Start) -> FloatArray | None:
        """Where the tool is or can come down, with a straight way to the start of a cut.

        In narrow places the way may graze stock, at a small part of the engagement allowed.
        """
        # only where the tool has been is certain to be cleared
        been = self._cleared.distance(start.point[None], GRAZING * self._radius)[0]
        if np.isfinite(been) and self._returns.free(start.point[None])[0]:
            return start.point
        near = self._cleared.nearest(start.point, LANDINGS)
        centres = np.concatenate([place[None], near])
        ends = np.repeat(start.point[None], len(centres), axis=0)
        for bite in (ROOM, GRAZING):
            free = self._returns.holds(
                self._walls.frame(centres), self._walls.frame(ends), bite=bite
            )
            if free.any():
                return np.asarray(centres[int(np.argmax(free))])
        return None

    def _best(
        self, place: FloatArray, heading: float, starts: list[Start], gaps: list[float]
    ) -> tuple[int, Path | None]:
        """The nearest start that a way leads to, and the way; the nearest if none does."""
        order = [int(index) for index in np.argsort(gaps, kind="stable")]
        if gaps[order[0]] <= 1e-9:
            return order[0], None
        for far in (False, True):
            for index in order[:LINK_TRIES]:
                link = self._returns.way(place, heading, starts[index], far)
                if link is not None:
                    return index, link
        return order[0], None

    def _start(self, front: FloatArray) -> Start:
        known = self._starts.get(id(front))
        if known is None or known[0] is not front:
            known = (front, start_of(front, self._walls, self._settings.wall, self._radius))
            self._starts[id(front)] = known
        return known[1]

    def _stroke(self, kind: StrokeKind, path: Path, role: Role, air: bool = False) -> None:
        steady = role is Role.CUT
        self.strokes.append(Stroke(kind, self._walls.path(path), role, air, steady=steady))

    def _take(
        self, pieces: list[Piece], fronts: list[FloatArray], place: FloatArray
    ) -> tuple[FloatArray, float]:
        """Write a cut and bring cleared area and fronts up to date; the first front was cut."""
        path = self._tracer.path(pieces)
        self._length += path.length
        way = straight(place, path.start)
        if way is not None:
            self._stroke(StrokeKind.FEED, way, Role.CUT)
        self._stroke(StrokeKind.FEED, path, Role.CUT)
        centres = np.concatenate([piece.points for piece in pieces])
        headings = np.concatenate([piece.heading for piece in pieces])
        room = np.concatenate([piece.room for piece in pieces])
        swept = densified(centres, self._step)
        tree = cKDTree(swept)
        new = self._new_fronts(centres, room, tree)
        low, high = swept.min(axis=0) - self._radius, swept.max(axis=0) + self._radius
        kept: list[FloatArray] = []
        for number, front in enumerate(fronts):
            if number > 0 and not _overlap(front, low, high):
                kept.append(front)
                continue
            gone = tree.query(front, distance_upper_bound=self._radius * (1 - GRAZE))[0]
            left = np.isinf(gone)
            if not left.all():
                kept += runs(front, left, 4 * self._step)
            elif number > 0:
                # a front that its own cut leaves as it is has no stock behind it
                kept.append(front)
        self._cleared.add(swept)
        whole: list[FloatArray] = []
        short: list[FloatArray] = []
        for front in kept + new:
            long = len(front) > 2 and length(front) > SHORTEST * self._radius
            (whole if long else short).append(front)
        self._left += short
        self._fronts = joined(whole, self._radius, self._step, self._walls.clearance)
        self._returns.update(self._fronts)
        known = {id(front) for front in self._fronts}
        self._starts = {key: value for key, value in self._starts.items() if key in known}
        return centres[-1], float(headings[-1])

    def _new_fronts(self, centres: FloatArray, room: FloatArray, own: cKDTree) -> list[FloatArray]:
        """Edges of the stock that a cut leaves, the rim about its end included."""
        edge, piece = swept_edge(centres, self._radius, self._step)
        last = len(room) - 1
        open_ = np.maximum(room[piece], room[np.minimum(piece + 1, last)]) > 0
        # the rim before and after, from well behind the right: what is cleared there falls out
        before = direction(centres[:2]) + np.arange(-0.6, 0.0, SAMPLING)
        after = direction(centres[-2:]) + np.arange(-0.6, np.pi + 0.6, SAMPLING)
        rims = [
            centres[end] + self._radius * unit(angle - np.pi / 2)
            for end, angle in ((0, before), (-1, after))
        ]
        edge = np.concatenate([rims[0], edge, rims[1]])
        open_ = np.pad(open_, (len(before), len(after)), constant_values=True)
        piece = np.concatenate([np.zeros_like(before, int), piece, np.full(len(after), last)])
        stock = open_ & (own.query(edge)[0] > self._radius * (1 - GRAZE))
        rows = np.flatnonzero(stock)
        old = self._cleared.distance(edge[rows], 1.01 * self._radius)
        stock[rows] = old > self._radius * (1 + GRAZE / 4)
        # where the wall is nearer to the edge than that, it is near the tool as well
        skin = WALL_SKIN * self._radius
        rows = np.flatnonzero(stock)
        near = np.minimum(room[piece[rows]], room[np.minimum(piece[rows] + 1, last)])
        rows = rows[near < skin]
        if len(rows):
            stock[rows] = self._walls.clearance(edge[rows]) > skin
        return runs(edge, stock, 4 * self._step)


def _overlap(chain: FloatArray, low: FloatArray, high: FloatArray) -> bool:
    """Whether the box of a chain meets another."""
    return bool(np.all(chain.max(axis=0) >= low) and np.all(chain.min(axis=0) <= high))
