"""What a round tool reaches of a region, and what it does not, as regions.

The disks of radius R inside a region are those centred in E, where the clearance is R or more.
Their union, the opening, is bounded by the wall where the axis above it has r >= R, and by arcs of
radius R about the places where r = R (the corners of the trimmed offset), from foot to foot. A
point that is not in the opening belongs to a connected part of the axis with r < R, and the only
disks that can come near it are those at the ends of that part: arcs are trimmed against the
disks of the same part only. Each part that lies between such arcs and the wall is not reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Curve, Loop, Region
from grassfire.geometry.neighbours import Neighbours, connected
from grassfire.medial.offset import Stretches, Walker, closed_loop, joined_runs, settled
from grassfire.medial.sites import BoolArray, FloatArray, IntArray, dot
from grassfire.medial.trimmed import has_area

if TYPE_CHECKING:
    from grassfire.medial.axis import MedialAxis


# -- openings -------------------------------------------------------------------------------------


def reachable(axis: MedialAxis, tool_radius: float) -> tuple[Region, ...]:
    """What the disks of a radius that lie in the region cover (its opening), as regions.

    Parameters
    ----------
    tool_radius : float
        mm. A slot exactly as wide as the tool is reached.

    Returns
    -------
    tuple of Region
        Their curves are parts of the wall where the tool touches it, and arcs of the tool's radius
        where it does not. Empty when the tool is too large for the region, and the region
        itself when everything is reached.

    Raises
    ------
    GeometryError
        For a radius that is negative or not finite.

    Notes
    -----
    The areas of `reachable` and `unreachable` add up to that of the region within 1e-9 times the
    square of its size (within 1e-12 where no neck, slot or largest disk has that very radius).

    Examples
    --------
    A tool of radius 2 leaves (4 - pi) of its square in the corners of a rectangle.

    >>> from grassfire.geometry import Line, Loop, Region
    >>> from grassfire.medial import medial_axis
    >>> corners = [(0, 0), (40, 0), (40, 20), (0, 20)]
    >>> sides = zip(corners, corners[1:] + corners[:1])
    >>> axis = medial_axis(Region(Loop(tuple(Line(a, b) for a, b in sides))))
    >>> round(800 - sum(region.area for region in axis.reachable(2.0)), 9)
    3.433629386
    >>> len(axis.unreachable(2.0))
    4
    """
    return opening(axis, tool_radius)[0]


def unreachable(axis: MedialAxis, tool_radius: float) -> tuple[Region, ...]:
    """What `reachable` leaves: slivers in corners, necks and slots that are too narrow.

    Parameters
    ----------
    tool_radius : float
        mm.

    Returns
    -------
    tuple of Region
        In the order of the boundary; they may touch each other and `reachable`.

    Raises
    ------
    GeometryError
        For a radius that is negative or not finite.
    """
    return opening(axis, tool_radius)[1]


def opening(axis: MedialAxis, tool_radius: float) -> tuple[tuple[Region, ...], tuple[Region, ...]]:
    """What disks of a radius inside the region cover, and what they leave.

    Places with r equal to the radius are reached: a slot as wide as the tool is.
    """
    if not (np.isfinite(tool_radius) and tool_radius >= 0):
        raise GeometryError("a tool radius must be a number of 0 or more")
    if tool_radius == 0:
        return (axis.region,), ()
    radius = settled(axis, float(tool_radius), -1)
    walker = axis.walker
    stretches = walker.stretches(radius)
    cuts = _cuts(walker, stretches, radius)
    items = _items(walker, stretches, cuts, radius)
    if items.kept.all():
        return (axis.region,), ()
    if not items.kept.any():
        return (), (axis.region,)
    arcs = _visible(cuts, radius, axis.sites.size)
    tracer = _Tracer(walker, items, cuts, arcs, radius)
    size = axis.sites.size
    return _nested(tracer.covered(), size), _nested(tracer.left(), size)


@dataclass(frozen=True)
class _Cuts:
    """Places with r = R, one row each: the arc about it from foot to foot, and its neighbours.

    `at_start` and `at_end` number the cuts of the stretches (-1 for none); `part` is the connected
    part of the axis with r < R that the cut bounds. Gaps are the stretches of that part.
    """

    centre: FloatArray
    start_angle: FloatArray
    sweep: FloatArray
    part: IntArray
    at_start: IntArray
    at_end: IntArray
    gaps: _Gaps


@dataclass(frozen=True)
class _Gaps:
    """Stretches of pieces with r < R: row, fractions, and cuts at both ends (-1: a vertex)."""

    row: IntArray
    low: FloatArray
    high: FloatArray
    low_cut: IntArray
    high_cut: IntArray


def _cuts(walker: Walker, stretches: Stretches, radius: float) -> _Cuts:
    span, sites = walker.axis.span, walker.sites
    count = len(stretches.row)
    starts, ends = np.flatnonzero(stretches.cut_start), np.flatnonzero(stretches.cut_end)
    at_start, at_end = np.full(count, -1), np.full(count, -1)
    at_start[starts] = np.arange(len(starts))
    at_end[ends] = len(starts) + np.arange(len(ends))
    row = np.concatenate([stretches.row[starts], stretches.row[ends]])
    fraction = np.concatenate([stretches.start[starts], stretches.end[ends]])
    total = len(row)
    gaps = _gaps(walker, stretches, at_start, at_end)
    part = _parts(walker, gaps, total, radius)
    if not total:
        none = np.zeros(0)
        return _Cuts(np.zeros((0, 2)), none, none, part, at_start, at_end, gaps)
    disks, facing = walker.exact(row, fraction)
    own = span.at(row, fraction)
    own_spoke = -sites.frame(span.site[row], own)[1]
    far_spoke = -sites.frame(span.partner[row], facing)[1]
    forward = (np.arange(total) >= len(starts))[:, None]
    first = np.where(forward, own_spoke, far_spoke)
    last = np.where(forward, far_spoke, own_spoke)
    across = first[:, 0] * last[:, 1] - first[:, 1] * last[:, 0]
    sweep = np.arctan2(across, dot(first, last))
    # Half a turn at most: what rounding makes of it is half a turn, or nothing.
    sweep = np.where(sweep < -0.5 * np.pi, np.pi, np.maximum(sweep, 0.0))
    angle = np.arctan2(first[:, 1], first[:, 0])
    return _Cuts(disks[:, :2], angle, sweep, part, at_start, at_end, gaps)


def _gaps(walker: Walker, stretches: Stretches, at_start: IntArray, at_end: IntArray) -> _Gaps:
    """What the stretches leave of all pieces."""
    row, count = stretches.row, len(walker.axis.span)
    bare = np.setdiff1d(np.arange(count), row)
    leads = np.flatnonzero(
        np.concatenate([[True], row[1:] != row[:-1]])[: len(row)] & stretches.cut_start
    )
    tails = np.flatnonzero(stretches.cut_end)
    following = np.minimum(tails + 1, len(row) - 1)
    same = (tails + 1 < len(row)) & (row[following] == row[tails])
    return _Gaps(
        row=np.concatenate([bare, row[leads], row[tails]]),
        low=np.concatenate([np.zeros(len(bare) + len(leads)), stretches.end[tails]]),
        high=np.concatenate(
            [
                np.ones(len(bare)),
                stretches.start[leads],
                np.where(same, stretches.start[following], 1.0),
            ]
        ),
        low_cut=np.concatenate([np.full(len(bare) + len(leads), -1), at_end[tails]]),
        high_cut=np.concatenate(
            [np.full(len(bare), -1), at_start[leads], np.where(same, at_start[following], -1)]
        ),
    )


def _parts(walker: Walker, gaps: _Gaps, cuts: int, radius: float) -> IntArray:
    """(cuts,) connected part with r < R that each cut bounds."""
    span = walker.axis.span
    vertices = len(walker.axis.fit.vertex_radius)
    first = np.where(gaps.low_cut >= 0, vertices + gaps.low_cut, span.first[gaps.row])
    last = np.where(gaps.high_cut >= 0, vertices + gaps.high_cut, span.last[gaps.row])
    total = vertices + cuts
    return connected(first, last, total)[vertices:]


@dataclass(frozen=True)
class _Items:
    """Stretches of the wall in boundary order: reached or not, and the cuts between them."""

    site: IntArray
    start: FloatArray
    end: FloatArray
    kept: BoolArray
    begin_cut: IntArray
    end_cut: IntArray
    following: IntArray


def _items(walker: Walker, stretches: Stretches, cuts: _Cuts, radius: float) -> _Items:
    gaps = cuts.gaps
    count, bare = len(stretches.row), len(gaps.row)
    row = np.concatenate([stretches.row, gaps.row])
    low = np.concatenate([stretches.start, gaps.low])
    high = np.concatenate([stretches.end, gaps.high])
    low_cut = np.concatenate([cuts.at_start, gaps.low_cut])
    high_cut = np.concatenate([cuts.at_end, gaps.high_cut])
    kept = np.arange(count + bare) < count
    own_low, far_low = _sides(walker, row, low)
    own_high, far_high = _sides(walker, row, high)
    whole = np.flatnonzero(walker.interval_piece < 0)
    wide = walker.axis.fit.vertex_radius[walker.interval_vertex[whole]] >= radius
    none = np.full(len(whole), -1)
    nought = np.zeros(len(whole))
    interval = np.concatenate([walker.position[0, row], walker.position[1, row], whole])
    # Cuts of no length keep their order by the fraction of the piece.
    order = np.lexsort(
        (
            np.concatenate([high, -low, nought]),
            np.concatenate([low, -high, nought]),
            interval,
        )
    )
    interval = interval[order]
    first = np.full(len(walker.interval_site), -1, dtype=np.int64)
    first[interval[::-1]] = np.arange(len(order))[::-1]
    following = np.arange(1, len(order) + 1)
    last = np.flatnonzero(np.concatenate([interval[1:] != interval[:-1], [True]]))
    following[last] = first[walker.following[interval[last]]]
    return _Items(
        site=walker.interval_site[interval],
        start=np.concatenate([own_low, far_high, walker.interval_start[whole]])[order],
        end=np.concatenate([own_high, far_low, walker.interval_end[whole]])[order],
        kept=np.concatenate([kept, kept, wide])[order],
        begin_cut=np.concatenate([low_cut, high_cut, none])[order],
        end_cut=np.concatenate([high_cut, low_cut, none])[order],
        following=following,
    )


def _sides(walker: Walker, row: IntArray, fraction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters of the feet at fractions of pieces, on both sides."""
    span = walker.axis.span
    own = span.at(row, fraction)
    own = np.where(fraction == 1, span.end[row], own)
    far = np.where(fraction == 0, span.facing_start[row], span.facing_end[row])
    inner = np.flatnonzero((fraction > 0) & (fraction < 1))
    if len(inner):
        far[inner] = walker.exact(row[inner], fraction[inner])[1]
    return own, far


# -- arcs -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Arcs:
    """Parts of the arcs that no other disk covers: cut, angles from its start."""

    cut: IntArray
    low: FloatArray
    high: FloatArray


def _visible(cuts: _Cuts, radius: float, size: float) -> _Arcs:
    """What the disks of the same part leave of the arcs, in the order of the cuts."""
    least = 1e-9 * size / radius
    covered: list[list[tuple[float, float]]] = [[] for _ in cuts.sweep]
    pairs = Neighbours(cuts.centre).pairs(2 * radius)
    pairs = pairs[cuts.part[pairs[:, 0]] == cuts.part[pairs[:, 1]]]
    one, two = np.concatenate([pairs, pairs[:, ::-1]]).T
    away = cuts.centre[two] - cuts.centre[one]
    distance = np.hypot(away[:, 0], away[:, 1])
    half = np.arccos(np.clip(distance / (2 * radius), -1.0, 1.0))
    toward = np.arctan2(away[:, 1], away[:, 0]) - cuts.start_angle[one]
    # Disks on the same place cover each other's arcs.
    same = distance <= 1e-13 * size
    toward = np.where(same, 0.5 * cuts.sweep[one], toward)
    half = np.where(same, np.pi, half)
    toward = np.remainder(toward - 0.5 * cuts.sweep[one] + np.pi, 2 * np.pi)
    toward += 0.5 * cuts.sweep[one] - np.pi
    for index, low, high in zip(one, toward - half, toward + half, strict=True):
        covered[index].append((float(low), float(high)))
    cut: list[int] = []
    parts: list[tuple[float, float]] = []
    for index, sweep in enumerate(cuts.sweep):
        for low, high in _uncovered(float(sweep), sorted(covered[index]), least):
            cut.append(index)
            parts.append((low, high))
    table = np.array(parts).reshape(-1, 2)
    return _Arcs(np.array(cut, dtype=np.int64), table[:, 0], table[:, 1])


def _uncovered(
    sweep: float, covered: list[tuple[float, float]], least: float
) -> list[tuple[float, float]]:
    """Parts of [0, sweep] outside of intervals that ascend; none shorter than `least`."""
    result = []
    begin = 0.0
    for low, high in [*covered, (sweep, sweep)]:
        stop = min(low, sweep)
        if stop - begin > least:
            result.append((begin, sweep if sweep - stop <= least else stop))
        if high > begin + (least if begin == 0 else 0):
            begin = max(begin, high)
    return result


# -- loops ----------------------------------------------------------------------------------------


class _Tracer:
    """Loops of wall and arcs; elements are items of the wall, then arcs."""

    def __init__(
        self, walker: Walker, items: _Items, cuts: _Cuts, arcs: _Arcs, radius: float
    ) -> None:
        self.walker, self.items, self.cuts, self.arcs = walker, items, cuts, arcs
        self.radius = radius
        self.count = len(items.site)
        kept = items.kept
        cut_ends = np.flatnonzero(kept & (items.end_cut >= 0))
        cut_begins = np.flatnonzero(kept & (items.begin_cut >= 0))
        self.before = np.full(len(cuts.sweep), -1, dtype=np.int64)
        self.after = self.before.copy()
        self.before[items.end_cut[cut_ends]] = cut_ends
        self.after[items.begin_cut[cut_begins]] = cut_begins
        self.link = self._links()
        self.back = {head: tail for tail, head in self.link.items()}

    def _links(self) -> dict[int, int]:
        """Successor of the covered wall's ends and of arcs, the opening on the left."""
        from scipy.optimize import linear_sum_assignment

        arcs, cuts = self.arcs, self.cuts
        number = self.count + np.arange(len(arcs.cut))
        begins = arcs.low == 0
        ends = arcs.high == cuts.sweep[arcs.cut]
        link = dict(zip(self.before[arcs.cut[begins]], number[begins], strict=True))
        link.update(zip(number[ends], self.after[arcs.cut[ends]], strict=True))
        every = np.arange(len(cuts.sweep))
        hidden_start = np.setdiff1d(every, arcs.cut[begins])
        hidden_end = np.setdiff1d(every, arcs.cut[ends])
        tails = np.concatenate([self.before[hidden_start], number[~ends]])
        heads = np.concatenate([self.after[hidden_end], number[~begins]])
        tail_cut = np.concatenate([hidden_start, arcs.cut[~ends]])
        head_cut = np.concatenate([hidden_end, arcs.cut[~begins]])
        tail_angle = np.concatenate([np.zeros(len(hidden_start)), arcs.high[~ends]])
        head_angle = np.concatenate([cuts.sweep[hidden_end], arcs.low[~begins]])
        tail_place = self._place(tail_cut, tail_angle)
        head_place = self._place(head_cut, head_angle)
        for part in np.unique(cuts.part[tail_cut]):
            one = np.flatnonzero(cuts.part[tail_cut] == part)
            two = np.flatnonzero(cuts.part[head_cut] == part)
            apart = tail_place[one][:, None] - head_place[two]
            away = np.hypot(apart[:, :, 0], apart[:, :, 1])
            first, second = linear_sum_assignment(away)
            self._check(away[first, second], tail_place[one])
            link.update(zip(tails[one[first]], heads[two[second]], strict=True))
        return {int(tail): int(head) for tail, head in link.items()}

    def _place(self, cut: IntArray, angle: FloatArray) -> FloatArray:
        """Points of the arcs at angles from their starts."""
        direction = self.cuts.start_angle[cut] + angle
        unit = np.stack([np.cos(direction), np.sin(direction)], axis=1)
        return self.cuts.centre[cut] + self.radius * unit

    def _check(self, away: FloatArray, place: FloatArray) -> None:
        worst = int(np.argmax(away))
        if away[worst] > 1e-6 * self.walker.sites.size:
            x, y = place[worst] + self.walker.sites.origin
            raise GeometryError("the reach of a disk does not close", place=(float(x), float(y)))

    def covered(self) -> list[Loop]:
        """Boundary of the opening."""
        items = self.items
        successor = {
            int(item): int(items.following[item])
            for item in np.flatnonzero(items.kept & (items.end_cut < 0))
        }
        return self._loops({**successor, **self.link}, forward=True)

    def left(self) -> list[Loop]:
        """Boundary of what the opening leaves: arcs run the other way."""
        items = self.items
        successor = {}
        for item in np.flatnonzero(~items.kept):
            following = int(items.following[item])
            cut = items.end_cut[item]
            successor[int(item)] = following if cut < 0 else self._behind(following)
        for arc in range(self.count, self.count + len(self.arcs.cut)):
            successor[arc] = self._behind(arc)
        return self._loops(successor, forward=False)

    def _behind(self, element: int) -> int:
        """What comes before an element of the opening's boundary, seen from outside."""
        tail = self.back[element]
        return tail if tail >= self.count else int(self.items.following[tail])

    def _loops(self, successor: dict[int, int], forward: bool) -> list[Loop]:
        visited: set[int] = set()
        loops = []
        for begin in successor:
            if begin in visited:
                continue
            walk = []
            element = begin
            while element not in visited:
                visited.add(element)
                walk.append(element)
                element = successor[element]
            curves = self._curves(walk, forward)
            if curves:
                loop = closed_loop(curves, self.walker.sites.size)
                if has_area(loop, self.walker.sites.size):
                    loops.append(loop)
        return loops

    def _curves(self, walk: list[int], forward: bool) -> list[Curve]:
        """Curves of a closed walk, which starts anew behind an arc if it has one."""
        arcs = [index for index, element in enumerate(walk) if element >= self.count]
        if arcs:
            walk = walk[arcs[0] :] + walk[: arcs[0]]
        curves: list[Curve | None] = []
        rows: list[int] = []
        items = self.items
        for element in [*walk, -1]:
            if 0 <= element < self.count:
                rows.append(element)
                continue
            run = np.array(rows, dtype=np.int64)
            joined = joined_runs(
                items.site[run], items.start[run], items.end[run], np.zeros_like(run), not arcs
            )
            curves.extend(self.walker.curves(*joined[:3], 0.0))
            rows = []
            if element >= 0:
                curves.append(self._arc(element - self.count, forward))
        return [curve for curve in curves if curve is not None]

    def _arc(self, index: int, forward: bool) -> Arc | None:
        arcs, cut = self.arcs, int(self.arcs.cut[index])
        low, high = float(arcs.low[index]), float(arcs.high[index])
        if self.radius * (high - low) <= 1e-9 * self.walker.sites.size:
            return None
        centre = self.cuts.centre[cut] + self.walker.sites.origin
        start = float(self.cuts.start_angle[cut])
        if forward:
            return Arc(centre, self.radius, start + low, high - low)
        return Arc(centre, self.radius, start + high, low - high)


def _nested(loops: list[Loop], size: float) -> tuple[Region, ...]:
    """Regions of loops: those around islands belong to the smallest outer loop about them."""
    outer = [loop for loop in loops if loop.area > 0]
    islands: list[list[Loop]] = [[] for _ in outer]
    boxes = np.array([loop.bounds() for loop in outer]).reshape(-1, 4)
    bodies: dict[int, Region] = {}
    for loop in loops:
        if loop.area > 0:
            continue
        box = np.array(loop.bounds())
        slack = 1e-7 * size
        around = (boxes[:, :2] <= box[:2] + slack) & (boxes[:, 2:] >= box[2:] - slack)
        rows = np.flatnonzero(around.all(axis=1))
        if len(rows) > 1:
            # Loops may touch: most of the points decide.
            inside = np.array(
                [
                    np.mean(bodies.setdefault(int(k), Region(outer[k])).contains(_probes(loop)))
                    for k in rows
                ]
            )
            rows = rows[inside > 0.5]
        if not len(rows):
            raise GeometryError(
                "an island of the reach has no region about it", place=loop.curves[0].start.tolist()
            )
        smallest = min(rows, key=lambda k: outer[k].area)
        islands[int(smallest)].append(loop)
    return tuple(Region(loop, tuple(found)) for loop, found in zip(outer, islands, strict=True))


def _probes(loop: Loop) -> FloatArray:
    """Points between the ends of a loop's curves."""
    index = np.arange(len(loop))
    return np.concatenate([loop.point(index + share) for share in (0.21, 0.5, 0.83)])


__all__ = ["opening", "reachable", "unreachable"]
