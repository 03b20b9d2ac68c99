"""Spirals: one smooth way from the first descent to the wall, laps at most a stepover apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grassfire.medial import MedialAxis
from grassfire.plan import entry, spiral_tree, spiral_wave
from grassfire.plan.path import Path, circle, repeat
from grassfire.plan.places import IntArray, Places
from grassfire.plan.rings import INNER_FIT, MOST_INNER_FIT, MOST_SPACING, Component, components
from grassfire.plan.spiral_curve import blunted, directions, evened, fitted, smoothed
from grassfire.plan.spiral_lobes import Sizes, lobes
from grassfire.plan.spiral_tree import Chain
from grassfire.plan.spiral_walls import WallLaps
from grassfire.plan.spiral_wave import Impulses
from grassfire.plan.strategy import SMALLEST_RING, ClearingSettings, PocketPlan, needs_plunge
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.plan.wallpass import wall_pass
from grassfire.report import Finding, Severity
from grassfire.toolpath import FloatArray, Role

SAMPLE = 0.1
"""Distance between samples of axis and wall as a part of the stepover."""

MOST_SAMPLE = 0.25
"""The same, mm."""

ROUNDING = 0.25
"""Width of the Gaussian that rounds the laps next to the wall as a part of the stepover."""

EVENING = 2.4
"""The same for the laps inside, as a multiple of it."""

MARGIN = 0.995
"""Part of the stepover that laps are apart at most before they are rounded."""

ROUNDS = 4
"""How often laps are counted anew where rounding has parted them too far."""

HELPS = 0.7
"""More laps must leave less than this part of what laps are too far apart."""

STUB = 0.05
"""Part of the spacing of laps by which corners between short lines may be nearer to the wall."""

SLACK = 5e-4
"""Part of the stepover by which measured laps may miss it."""

FINE = 6.0
"""Points of laps within one such width."""

NARROW = 0.95
"""Part of the tool radius up to which the wall lap counts as clearing what is inside it."""

SOFT = 0.02
"""Laps rounded towards the wall keep off it by about as much, mm."""

HOLD = 18
"""So many points at both ends of all laps are not moved."""

WINDOWS = np.array([1.0, 0.5, 0.25])
"""Parts of the reach in which turns are added up for the place of the seam."""

SPARSE = 8
"""Every so many points of laps the clearance is looked up."""

LONGEST = 64
"""Most points under one biarc."""


@dataclass(frozen=True)
class Pitch:
    """Lengths that follow from the stepover, mm.

    Attributes
    ----------
    spacing : float
        Most between laps.
    step : float
        Between samples of axis and wall.
    width : float
        Of the Gaussian that rounds laps.
    tube : float
        Radius of the helix, and of the tube about the trunk.
    """

    spacing: float
    step: float
    width: float
    tube: float

    @property
    def fine(self) -> float:
        """Between points of laps, mm."""
        return self.width / FINE


def _pitch(settings: ClearingSettings) -> Pitch:
    spacing = min(settings.stepover, MOST_SPACING * settings.tool_radius)
    # a right corner gets the radius 1.25 widths
    width = max(ROUNDING * spacing, 0.8 * min(settings.minimum_radius, spacing))
    step = min(SAMPLE * spacing, MOST_SAMPLE)
    return Pitch(spacing, step, width, entry.NO_CORE * settings.tool_radius)


def spiral_pockets(
    axis: MedialAxis, settings: ClearingSettings
) -> tuple[list[PocketPlan], list[Finding]]:
    """All pockets of a region, to be cleared by spirals; and what was noticed."""
    findings: list[Finding] = []
    pitch = _pitch(settings)
    if settings.stepover > pitch.spacing + 1e-12:
        findings.append(
            Finding(
                Severity.WARNING,
                "stepover-bounded",
                f"a stepover of {settings.stepover:.6g} mm could leave stock between laps; they "
                f"are at most {pitch.spacing:.6g} mm apart",
                size=pitch.spacing,
            )
        )
    parts = components(
        axis,
        np.array([settings.wall]),
        pitch.spacing,
        settings.tool_radius,
        settings.tolerance,
        settings.climb,
    )
    graph = axis.subgraph(settings.wall)
    chains = spiral_tree.sampled_chains(axis, graph, settings.wall, pitch.step)
    label = graph.edge_component
    pockets: list[PocketPlan] = []
    for part in parts:
        if max(ring.extent for ring in part.rings) < SMALLEST_RING and settings.entry != "plunge":
            findings.append(needs_plunge(part.peak, part.peak_radius))
            continue
        number = _component_at(part.peak, graph.vertex_point, graph.component, chains, label)
        mine = [chains[index] for index in np.flatnonzero(label == number)]
        pockets.append(SpiralPocket(axis, part, mine, len(graph.component), settings, pitch))
    return pockets, findings


def _component_at(
    place: FloatArray,
    vertices: FloatArray,
    component: IntArray,
    chains: Sequence[Chain],
    label: IntArray,
) -> int:
    """Component of the axis that a place on it belongs to."""
    points = np.concatenate([vertices, *(chain.centre for chain in chains)])
    counts = [len(chain.room) for chain in chains]
    owner = np.concatenate([component, np.repeat(label, counts)])
    return int(owner[np.argmin(np.hypot(*(points - place).T))])


class SpiralPocket:
    """One pocket cleared by spirals; `peak`, `strokes` and `finish` as in `PocketPlan`.

    Parameters
    ----------
    axis : MedialAxis
    part : Component
        Of the wall level.
    chains : sequence of Chain
        Its axis; none where that is a single place.
    nodes : int
        More than all numbers of their nodes.
    settings : ClearingSettings
    pitch : Pitch
    """

    def __init__(
        self,
        axis: MedialAxis,
        part: Component,
        chains: Sequence[Chain],
        nodes: int,
        settings: ClearingSettings,
        pitch: Pitch,
    ) -> None:
        self._axis = axis
        self._part = part
        self._chains = chains
        self._nodes = nodes
        self._settings = settings
        self._pitch = pitch
        self._walls = WallLaps(axis, part, settings)
        self.peak = part.peak
        self.strokes: list[Stroke] = []
        self.finish: list[Stroke] = []
        self.findings: list[Finding] = []

    def plan(self, position: FloatArray) -> FloatArray:
        """Lobe by lobe, then the walls; returns where the last stroke ends, mm."""
        settings = self._settings
        pending = self._ways()
        if not pending:
            self._along_wall(position)
        while pending:
            gaps = [np.hypot(*(ways.root - position)) for ways in pending]
            ways = pending.pop(int(np.argmin(gaps)))
            self._spiral(ways if settings.climb else ways.backwards(), not pending)
            position = self.strokes[-1].path.end
        self.strokes += self._walls.laps(self.strokes[-1].path.end)
        self._mark_travels()
        if settings.finish:
            here, walls = self.strokes[-1].path.end, self._walls
            self.finish = wall_pass(self._axis, walls.last, settings, here, walls.way, onward=True)
        last = self.finish or self.strokes
        return last[-1].path.end

    def _ways(self) -> list[Impulses]:
        """Impulses to the wall for each lobe; none where a wall lap clears all."""
        settings, pitch = self._settings, self._pitch
        narrow = NARROW * settings.tool_radius
        chains = spiral_tree.without_stubs(spiral_tree.joined(self._chains), STUB * pitch.spacing)
        if not chains:
            room = self._part.peak_radius - settings.wall
            if room <= narrow:
                return []
            return [spiral_wave.round_impulses(self._part.peak, room, pitch.tube, pitch.step)]
        # another descent takes its own way at half the feed, and a retract
        another = 2 * settings.drop / np.tan(settings.slope) + settings.longest_walk
        sizes = Sizes(pitch.spacing, pitch.tube, narrow, float(another))
        chains, nodes = spiral_tree.opened(chains, self._nodes)
        result = []
        for lobe in lobes(chains, nodes, sizes):
            waves = spiral_wave.wave(lobe.branches, pitch.tube, lobe.trunk)
            arms = spiral_wave.most_arms(lobe.branches, waves)
            if arms > 2:
                # where arms meet the tube is wider: no core may stand there
                tube = pitch.tube * np.sin(np.pi / arms)
                waves = spiral_wave.wave(lobe.branches, tube, lobe.trunk)
            result.append(spiral_wave.impulses(lobe.branches, lobe.cut, waves, pitch.step))
        return result

    def _mark_travels(self) -> None:
        """Note which ways to a descent lie where the pass before has cleared."""
        for index, stroke in enumerate(self.strokes):
            if stroke.kind is StrokeKind.DESCEND:
                clear = self._walls.holds(self.strokes[index - 1].path.end, stroke.path.start)
                self.strokes[index] = Stroke(stroke.kind, stroke.path, stroke.role, clear)

    def _along_wall(self, position: FloatArray) -> None:
        """Down along the longest wall ring, which clears all that is inside it."""
        settings = self._settings
        rings = self._walls.rings
        longest = int(np.argmax([ring.length for ring in rings]))
        ring = rings[longest]
        ring = ring.started_at(ring.nearest(position).along)
        if settings.entry == "plunge":
            self._descend(entry.plunge(ring.start))
        else:
            down, along = entry.ramp(ring, settings.drop, settings.slope)
            self._descend(down)
            ring = ring.started_at(along, snap=1e-9)
        self._walls.begin(longest, ring)

    def _descend(self, down: Path) -> None:
        self.strokes.append(Stroke(StrokeKind.DESCEND, down, Role.ENTRY))

    def _spiral(self, ways: Impulses, last: bool) -> None:
        """Down, once flat round the tube, and out to the wall; the wall lap follows the last."""
        settings, pitch = self._settings, self._pitch
        ways = ways.rolled(seam(ways, 8 * pitch.width))
        first = self._first_lap(ways)
        self._enter(first)
        points = self._near_enough(ways, first)
        ring, along = self._walls.nearest(points[-1])
        points[-1] = ring.at(np.array([along]))[0]
        points, room = self._off_wall(points)
        points = blunted(points, 1.0 if settings.climb else -1.0)
        tangents = directions(points, closed=False)
        tangents[0], tangents[-1] = first.tangent(first.length), ring.tangent(along)
        inner = max(settings.tolerance, min(INNER_FIT * pitch.spacing, MOST_INNER_FIT))
        way = fitted(points, tangents, np.clip(0.5 * room, settings.tolerance, inner), LONGEST)
        self.strokes.append(Stroke(StrokeKind.FEED, way, Role.CUT))
        self._walls.has_cut(way)
        if last:
            self._walls.begin_at(ring, along)

    def _first_lap(self, ways: Impulses) -> Path:
        """The closed lap round the tube, from the seam on."""
        settings, pitch = self._settings, self._pitch
        raw = spiral_wave.front(ways, 0.0)
        centre = ways.centre[0]
        arms = np.hypot(*(raw - centre).T)
        turn = 1.0 if settings.climb else -1.0
        if np.ptp(arms) <= 1e-6:
            return circle(centre, raw[0], turn)
        points = evened(raw, pitch.fine)
        even = smoothed(points, FINE, closed=True)
        # less and less towards the seam, where the laps begin
        weight = _fading(len(points), int(3 * FINE))[:, None]
        points = points + weight * (even - points)
        points[-1] = points[0]
        tangents = directions(points, closed=True)
        fit = max(settings.tolerance, min(INNER_FIT * pitch.spacing, MOST_INNER_FIT))
        return fitted(points, tangents, np.full(len(points), fit), LONGEST)

    def _enter(self, lap: Path) -> None:
        """Descend so that it ends where a closed lap starts, then that lap."""
        settings = self._settings
        if settings.entry == "plunge":
            self._descend(entry.plunge(lap.start))
        elif len(lap) == 1:
            way = entry.helix(
                lap.centre[0], lap.start, settings.drop, settings.slope, int(np.sign(lap.sweep[0]))
            )
            self._descend(way.down)
        else:
            length = settings.drop / np.tan(settings.slope)
            down = repeat(lap, max(1, int(np.ceil(length / lap.length - 1e-9))))
            self._descend(down)
        self.strokes.append(Stroke(StrokeKind.FEED, lap, Role.ENTRY))

    def _near_enough(self, ways: Impulses, first: Path) -> FloatArray:
        """Even points of laps without corners, as many as keep them within the spacing."""
        spacing = self._pitch.spacing
        laps = max(1, int(np.ceil(ways.speed / (MARGIN * spacing) + 2 * spiral_wave.EASE)))
        tried: list[tuple[float, FloatArray]] = []
        while len(tried) < ROUNDS:
            points = evened(spiral_wave.raw_laps(ways, laps), self._pitch.fine)
            points[0] = first.end
            seams = spiral_wave.seam_places(ways, laps)
            rounded = _rounded(points, 1.0 if ways.even else EVENING)
            gap = widest_step(points, rounded, seams)
            if gap <= spacing * (1.0 + SLACK):
                return rounded
            if tried and gap - spacing > HELPS * (tried[-1][0] - spacing):
                # a place that more laps do not bring nearer: the fewest will do
                return tried[0][1]
            tried.append((gap, rounded))
            laps = max(laps + 1, int(np.ceil(laps * gap / spacing)))
        return tried[-1][1]

    def _off_wall(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Laps brought back from where rounding moved them towards the wall, and how far each
        point is from the wall lap, mm."""
        room, away = room_at(self._axis, points, self._settings.wall)
        # room becomes SOFT log(1 + exp(room / SOFT)), but at the very ends
        kept = SOFT * np.logaddexp(0.0, room / SOFT)
        push = _fading(len(points), HOLD) * (kept - room)
        return points + push[:, None] * away, np.maximum(room + push, 0.0)


def _rounded(points: FloatArray, evening: float) -> FloatArray:
    """Even points of laps without corners.

    Parameters
    ----------
    points : (m, 2) float array
    evening : float
        How many times wider the Gaussian is at the first lap than at the last; evenly less from
        one to the next, so that every lap gives a little.
    """
    even = smoothed(points, FINE, closed=False)
    inner = smoothed(points, evening * FINE, closed=False)
    even = even + np.linspace(1.0, 0.0, len(points))[:, None] * (inner - even)
    weight = _fading(len(points), int(6 * FINE), HOLD)[:, None]
    return np.asarray(points + weight * (even - points))


def widest_step(points: FloatArray, rounded: FloatArray, seams: FloatArray) -> float:
    """Largest distance of a lap from the lap before it, mm: one side of their Hausdorff distance.

    Parameters
    ----------
    points, rounded : (m, 2) float arrays
        Even points of all laps before and after they are rounded.
    seams : (k, 2) float array
        Where laps follow each other, before they are rounded.
    """
    if not len(seams):
        return 0.0
    marks = np.sort(Places(points).closest(seams)[1])
    laps = np.split(rounded, marks)
    steps = (
        float(Places(inner).closest(outer[::SPARSE])[0].max())
        for inner, outer in pairwise(laps)
        if len(inner) and len(outer)
    )
    return max(steps, default=0.0)


def _fading(count: int, length: int, hold: int = 0) -> FloatArray:
    """(count,) weights of 1 that fall to 0 over `length` points, `hold` points from both ends."""
    index = np.arange(count)
    ends = np.minimum(index, index[::-1])
    share = np.clip((ends - min(hold, count // 8)) / max(1, min(length, count // 3)), 0.0, 1.0)
    return np.asarray(share**3 * (10 - 15 * share + 6 * share**2))


def room_at(axis: MedialAxis, points: FloatArray, wall: float) -> tuple[FloatArray, FloatArray]:
    """Clearance less `wall` (m,), and unit vectors (m, 2) away from the nearest boundary.

    Exact near the wall. Clearance is 1-Lipschitz: about places that have much of it there is
    enough, which is all that is told of the points between them.
    """
    last = len(points) - 1
    marks = np.unique(np.append(np.arange(0, last, SPARSE), last))
    room = np.interp(np.arange(last + 1), marks, axis.clearance(points[marks]) - wall)
    gaps = np.append(np.hypot(*np.diff(points, axis=0).T), 0.0)
    reach = np.add.reduceat(gaps, marks).max()
    near = np.flatnonzero(room < 2 * reach + 8 * SOFT)
    away = np.zeros_like(points)
    local = points[near] - axis.sites.origin
    distance, site, parameter = axis.search.nearest(local, outside=True)
    arm = local - axis.sites.point(site, parameter)
    room[near] = distance - wall
    away[near] = arm / np.maximum(distance, 1e-300)[:, None]
    return room, away


def seam(ways: Impulses, reach: float) -> int:
    """Impulse along which the laps begin: where tube and wall turn least.

    Parameters
    ----------
    ways : Impulses
    reach : float
        How far about it they are looked at, mm.
    """
    row = np.arange(len(ways.room))
    own = np.flatnonzero((ways.time <= 0) & (ways.first > 0))
    wall, tube = ways.at(row, np.ones(len(row))), ways.at(own, np.zeros(len(own)))
    # what is near counts more: it is in the reach of every window
    total = sum(_turning(wall, part)[own] + _turning(tube, part) for part in reach * WINDOWS)
    return int(own[np.argmin(total)])


def _turning(points: FloatArray, reach: float) -> FloatArray:
    """(n,) how much a closed polyline turns within `reach` of each of its points, radians."""
    count = len(points)
    step = np.roll(points, -1, axis=0) - points
    size = np.hypot(*step.T)
    moving = np.flatnonzero(size > 1e-9)
    angle = np.arctan2(step[moving, 1], step[moving, 0])
    change = np.abs(np.mod(np.diff(angle, prepend=angle[-1]) + np.pi, 2 * np.pi) - np.pi)
    turn = np.zeros(count)
    turn[moving] = change
    along = np.concatenate([[0.0], np.cumsum(np.tile(size, 3))])[:-1]
    total = np.concatenate([[0.0], np.cumsum(np.tile(turn, 3))])
    here = along[count : 2 * count]
    low = np.searchsorted(along, here - min(reach, here[0] / 2))
    high = np.searchsorted(along, here + min(reach, here[0] / 2), side="right")
    return np.asarray(total[high] - total[low])
