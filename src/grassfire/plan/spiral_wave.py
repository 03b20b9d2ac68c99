"""A wave from the axis to the wall that arrives everywhere at once, and the spiral between fronts.

After Held & Spielberger (2009): impulses run along the axis, then straight to the wall. Here the
wave starts on a tube about a part of the axis, the trunk, so that laps of long pockets are not
crowded at their sides. With h(x) the longest way from x on to the wall and t(x) the time at x, an
impulse needs the time 1 - t(x) for h(x): on a chain from x_i to x_i+1, d apart,

    1 - t_i+1 = (1 - t_i) h_i+1 / (h_i+1 + d).

Every impulse keeps or loses speed where it turns, so none is faster than the longest one at the
start, H. With K laps each point of a lap has one of the lap before on its own impulse's way at
most H / K behind: that is what bounds the distance between laps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grassfire.plan.places import BoolArray, IntArray
from grassfire.plan.spiral_tree import Branch, Tour, tour
from grassfire.toolpath import FloatArray

TUBE = 0.7
"""Largest radius of the tube about the trunk as a part of the room there."""

NEEDLE = 3.6
"""A dead end longer than so many times its room is left to the wall lap, where that clears it."""

BLUNT = 0.3
"""A dead end is a corridor where its end has more than this part of the room, else a corner."""

EASE = 0.25
"""Half the part of a lap in which the wave starts and stops evenly."""

LEAST = 1e-9
"""What is shorter counts as nothing, mm."""


@dataclass(frozen=True)
class Waves:
    """What the wave knows of a branch.

    Attributes
    ----------
    trunk : float
        Length of its part of the trunk, mm.
    height : (n,) float array
        Longest way from each sample on to the wall, mm.
    remaining : (n,) float array
        1 - t.
    anchor : (n, 2) float array
        Centre of the part of the tube that is nearest.
    tube : (n,) float array
        Its radius, mm.
    """

    trunk: float
    height: FloatArray
    remaining: FloatArray
    anchor: FloatArray
    tube: FloatArray


def heights(branches: Sequence[Branch]) -> list[FloatArray]:
    """(n,) longest way from each sample away from the root to the wall, for each branch."""
    result: list[FloatArray] = [np.zeros(0)] * len(branches)
    beyond = np.zeros(len(branches))
    for index in range(len(branches) - 1, -1, -1):
        branch = branches[index]
        reach = branch.depth + branch.chain.room
        reach[-1] = max(reach[-1], branch.depth[-1] + beyond[index])
        result[index] = np.maximum.accumulate(reach[::-1])[::-1] - branch.depth
        if branch.parent >= 0:
            beyond[branch.parent] = max(beyond[branch.parent], float(result[index][0]))
    return result


def without_needles(
    branches: Sequence[Branch], narrow: float, spacing: float
) -> tuple[list[Branch], list[BoolArray]]:
    """Branches without dead ends that are long, and so narrow that the wall lap clears them.

    Parameters
    ----------
    branches : sequence of Branch
    narrow : float
        Room up to which a wall lap clears all, mm: where corridors are left.
    spacing : float
        Of laps, mm: corners are left where the wall laps on both sides are as near as that.

    Returns
    -------
    branches : list of Branch
    cut : list of (2,) bool arrays
        Whether the wall does not go round the start and the end of each.
    """
    height = heights(branches)
    widest = np.zeros(len(branches))
    stop = [len(branch.depth) for branch in branches]
    for index in range(len(branches) - 1, -1, -1):
        branch = branches[index]
        room = branch.chain.room.copy()
        room[-1] = max(room[-1], widest[index])
        most = np.maximum.accumulate(room[::-1])[::-1]
        blunt = branch.chain.room[-1] > BLUNT * branch.chain.room
        limit = np.where(blunt, narrow, min(narrow, spacing / 2))
        thin = (most <= limit) & (height[index] > NEEDLE * branch.chain.room)
        if thin.any():
            stop[index] = max(int(np.argmax(thin)), 1)
        if branch.parent >= 0:
            widest[branch.parent] = max(widest[branch.parent], float(most[0]))
    number: dict[int, int] = {-1: -1}
    kept: list[Branch] = []
    cut: list[BoolArray] = []
    for index, branch in enumerate(branches):
        whole = branch.parent < 0 or (
            branch.parent in number and stop[branch.parent] == len(branches[branch.parent].depth)
        )
        if not whole:
            continue
        number[index] = len(kept)
        chain, last = branch.chain, stop[index] - 1
        shortened = stop[index] < len(branch.depth)
        if shortened:
            last = max(stop[index], 1)
            chain = chain.part(0, last, chain.start, -1 - len(kept))
        kept.append(Branch(chain, number[branch.parent], branch.depth[: last + 1]))
        cut.append(np.array([chain.closed[0], chain.closed[1] or shortened]))
    return kept, cut


def wave(branches: Sequence[Branch], tube: float, trunk_height: float) -> list[Waves]:
    """Times on all branches.

    Parameters
    ----------
    branches : sequence of Branch
        The first starts at the root.
    tube : float
        Radius of the tube about the trunk, mm; less where there is no room.
    trunk_height : float
        Where the wall is at least so far, the axis belongs to the trunk, mm.
    """
    height = heights(branches)
    result: list[Waves] = []
    exits: list[float] = []
    trunks: list[bool] = []
    for index, branch in enumerate(branches):
        chain, depth = branch.chain, branch.depth
        own_tube = np.minimum(tube, TUBE * chain.room)
        if branch.parent < 0:
            exit_depth, exit_point, exit_tube = 0.0, chain.centre[0], float(own_tube[0])
            remaining_start = 1.0
        else:
            above = result[branch.parent]
            exit_point, exit_tube = above.anchor[-1], float(above.tube[-1])
            remaining_start = float(above.remaining[-1])
            exit_depth = exits[branch.parent]
        inside = height[index] >= trunk_height
        if branch.parent >= 0 and not trunks[branch.parent]:
            inside[:] = False
        count = int(np.argmin(inside)) if not inside.all() else len(inside)
        if count:
            exit_depth, exit_point = float(depth[count - 1]), chain.centre[count - 1]
            exit_tube = float(own_tube[count - 1])
        beyond = np.maximum(depth - exit_depth - exit_tube, 0.0)
        step = np.diff(beyond)
        later = height[index][1:]
        shrink = np.where(step > 0, later / np.maximum(later + step, 1e-300), 1.0)
        remaining = remaining_start * np.concatenate([[1.0], np.cumprod(shrink)])
        anchor = np.tile(exit_point, (len(depth), 1))
        anchor[:count] = chain.centre[:count]
        radius = np.full(len(depth), exit_tube)
        radius[:count] = own_tube[:count]
        length = float(depth[count - 1] - depth[0]) if count else 0.0
        result.append(Waves(length, height[index], remaining, anchor, radius))
        exits.append(exit_depth)
        trunks.append(bool(inside[-1]))
    return result


def most_arms(branches: Sequence[Branch], waves: Sequence[Waves]) -> int:
    """Most parts of the trunk that meet at one place."""
    ends = [
        node
        for branch, item in zip(branches, waves, strict=True)
        if item.trunk > 0
        for node in (branch.chain.start, branch.chain.end)
    ]
    return max((ends.count(node) for node in set(ends)), default=0)


@dataclass(frozen=True)
class Impulses:
    """The ways of the wave to the wall as columns, in the order of the wall.

    At time T >= t an impulse is at centre + unit q with q^2 = first^2 + (room^2 - first^2) u^2,
    u = (T - t) / (1 - t); before, it still runs along the axis. Away from the tube (first = 0) it
    runs evenly; from the tube on it gains speed, so that the fronts forget the shape of the tube.
    About a single disk it runs evenly from the tube on, too.

    Attributes
    ----------
    centre, unit : (n, 2) float arrays
    room, first : (n,) float arrays
        Lengths from the centre to the wall and to the start, mm.
    time : (n,) float array
        t, when the impulse leaves the axis.
    speed : float
        Of the fastest, mm in the time of all.
    root : (2,) float array
        Where the wave starts, mm.
    even : bool
        Whether impulses from the tube run evenly.
    """

    centre: FloatArray
    unit: FloatArray
    room: FloatArray
    first: FloatArray
    time: FloatArray
    speed: float
    root: FloatArray
    even: bool = False

    def rolled(self, shift: int) -> Impulses:
        """The same closed walk from another row on."""
        return self._picked(np.roll(np.arange(len(self.room)), -shift))

    def backwards(self) -> Impulses:
        """The same closed walk the other way, from the same row on."""
        return self._picked(np.roll(np.arange(len(self.room))[::-1], 1))

    def _picked(self, row: IntArray) -> Impulses:
        return Impulses(
            self.centre[row],
            self.unit[row],
            self.room[row],
            self.first[row],
            self.time[row],
            self.speed,
            self.root,
            self.even,
        )

    def at(self, row: IntArray, time: FloatArray) -> FloatArray:
        """(k, 2) places of impulses `row` at times when they have left the axis."""
        left = np.maximum(1.0 - self.time[row], 1e-12)
        share = np.clip((time - self.time[row]) / left, 0.0, 1.0)
        first = self.first[row]
        reach = np.sqrt(first**2 + (self.room[row] ** 2 - first**2) * share**2)
        if self.even:
            reach = first + (self.room[row] - first) * share
        return np.asarray(self.centre[row] + self.unit[row] * reach[:, None])


def impulses(
    branches: Sequence[Branch], cut: Sequence[BoolArray], waves: Sequence[Waves], step: float
) -> Impulses:
    """Impulses to all contacts of a tree with the wall."""
    walk: Tour = tour(branches, cut, step)
    offset = np.cumsum([0] + [len(branch.depth) for branch in branches])
    row = offset[walk.branch] + walk.place

    def column(parts: list[FloatArray]) -> FloatArray:
        return np.asarray(np.concatenate(parts)[row])

    centre = column([branch.chain.centre for branch in branches])
    room = column([branch.chain.room for branch in branches])
    remaining = column([item.remaining for item in waves])
    height = column([item.height for item in waves])
    anchor = column([item.anchor for item in waves])
    radius = column([item.tube for item in waves])
    # from within the tube the start is where the way leaves it
    arm = centre - anchor
    slope = np.sum(arm * walk.unit, axis=1)
    rest = radius**2 - np.sum(arm * arm, axis=1)
    inside = rest > 0
    first = np.where(inside, -slope + np.sqrt(np.maximum(slope**2 + rest, 0.0)), 0.0)
    first = np.minimum(first, room)
    time = np.where(inside, 0.0, 1.0 - remaining)
    sideways = (room - first**2 / np.maximum(room, LEAST)) / np.maximum(1.0 - time, 1e-9)
    forward = np.where(inside, 0.0, height / np.maximum(1.0 - time, 1e-9))
    usable = room > LEAST
    speed = float(np.max(np.where(usable, np.maximum(sideways, forward), 0.0)))
    root = branches[0].chain.centre[0]
    return Impulses(centre, walk.unit, room, first, time, speed, root)


def round_impulses(centre: FloatArray, room: float, tube: float, step: float) -> Impulses:
    """Impulses from a single place with the wall all round it at one distance."""
    count = max(64, int(np.ceil(2 * np.pi * room / step)))
    angle = 2 * np.pi * np.arange(count) / count
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    full = np.ones(count)
    first = min(tube, TUBE * room)
    return Impulses(
        np.tile(centre, (count, 1)),
        unit,
        room * full,
        first * full,
        0 * full,
        room - first,
        centre,
        True,
    )


# -- laps -----------------------------------------------------------------------------------------


def eased(turns: FloatArray, laps: int) -> FloatArray:
    """Time of the wave after some turns of `laps` in all: even but for its start and stop."""
    total = laps - 2 * EASE
    start = turns**2 / (4 * EASE)
    stop = total - (laps - turns) ** 2 / (4 * EASE)
    value = np.where(turns < 2 * EASE, start, turns - EASE)
    value = np.where(turns > laps - 2 * EASE, stop, value)
    return np.asarray(np.clip(value / total, 0.0, 1.0))


def front_shares(ways: Impulses, time: float) -> tuple[FloatArray, float]:
    """(n,) share of a front's length up to each impulse, and that length, mm.

    Impulses that are still on the axis take no part of it.
    """
    count = len(ways.room)
    row = np.arange(count)
    there = ways.time <= time
    points = ways.at(row, np.full(count, time))
    index = np.where(there, row, 0)
    before = np.maximum.accumulate(index)
    place = points[before]
    steps = np.hypot(*np.diff(place, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    total = length[-1] + np.hypot(*(place[-1] - place[0]))
    return length / max(total, LEAST), float(total)


def raw_laps(ways: Impulses, laps: int) -> FloatArray:
    """(m, 2) points of the spiral from the tube to the wall in a number of laps, mm."""
    count = len(ways.room)
    times = eased(np.arange(laps + 1.0), laps)
    shares = np.array([front_shares(ways, float(time))[0] for time in times])
    turns = np.arange(laps)[:, None] + 0.5 * (shares[:-1] + shares[1:])
    turns = np.append(turns.ravel(), float(laps))
    row = np.append(np.tile(np.arange(count), laps), 0)
    time = eased(turns, laps)
    ahead = time - ways.time[row]
    return _crossed(ways, row, time, ahead)


def seam_places(ways: Impulses, laps: int) -> FloatArray:
    """(laps - 1, 2) points where the laps of `raw_laps` follow each other, mm."""
    times = eased(np.arange(1.0, laps), laps)
    return ways.at(np.zeros(laps - 1, dtype=np.int64), times)


def front(ways: Impulses, time: float) -> FloatArray:
    """(m, 2) points of a closed front, the first repeated at the end, mm."""
    row = np.append(np.arange(len(ways.room)), 0)
    moment = np.full(len(row), time)
    return _crossed(ways, row, moment, moment - ways.time[row])


def _crossed(ways: Impulses, row: IntArray, time: FloatArray, ahead: FloatArray) -> FloatArray:
    """Points where impulses have left the axis, and those where the front crosses the axis."""
    there = ahead >= 0
    points = ways.at(row, time)
    change = np.flatnonzero(there[1:] != there[:-1])
    share = ahead[change] / (ahead[change] - ahead[change + 1])
    centre = ways.centre[row]
    on_axis = centre[change] + (centre[change + 1] - centre[change]) * share[:, None]
    kept = np.flatnonzero(there)
    # strictly between the two impulses, even where one of them leaves right now
    between = change + np.clip(share, 1e-6, 1.0 - 1e-6)
    order = np.argsort(np.concatenate([kept, between]), kind="stable")
    return np.asarray(np.concatenate([points[kept], on_axis])[order])
