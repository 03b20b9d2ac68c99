"""What is cleared of a pocket, and the edges of the stock: those to be cut, those left to walls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grassfire.plan.fronts import (
    GRAZE,
    NEAR,
    SHORTEST,
    WALL_SKIN,
    Disks,
    Front,
    Fronts,
    densified,
    joined,
    leaving,
    runs,
    swept_edge,
    touched,
    unspiked,
)
from grassfire.plan.places import BoolArray, IntArray, Places
from grassfire.plan.pursuit import unit
from grassfire.plan.sense import Cut, swept_side
from grassfire.plan.tracing import SAMPLING
from grassfire.plan.walls import Walls
from grassfire.toolpath import FloatArray

INSIDE = 1e-6
"""How far the rim at an end of a cut is inside what it swept to be no edge, in tool radii."""

BESIDE = 8
"""Wall samples before and after what is left at a wall that are cut with it."""

ALLOWANCE, CUSP = 0.02, 0.06
"""Thickest stock left to the last lap round the wall, and thickest cusp, as parts of the radius."""

FILM, FILM_SHARE = (1.5e-3, 6e-3), 3e-4
"""Thickest film that stays on walls without a finishing pass: bounds, mm, and as a part of area
over length of walls, since a film all round is a larger part of a small pocket."""

HEAD = 8
"""Points at the start of a front that are left where no cut along it begins there."""

TAIL = 1000
"""Most points at the end of a front that may be left."""


class Stock:
    """Cleared area of one pocket and the edges of the stock, all in the frame of the walls.

    Every edge of stock that the tool can reach is a part of `fronts` or of `left`: links are proven
    by them alone.

    Parameters
    ----------
    walls : Walls
    radius, step : float
        Of the tool; between samples, mm.

    Attributes
    ----------
    cleared : Disks
        Places of the tool.
    fronts, left, tips : Fronts
        Edges to be cut; those left to ways along the walls; those of them with stock behind.
    crescent : (n,) bool array
        Wall samples beside which the last lap takes thicker stock.
    """

    def __init__(self, walls: Walls, radius: float, step: float) -> None:
        self._walls = walls
        self._radius = radius
        self._step = step
        self._spare: dict[Front, bool] = {}
        self.cleared = Disks()
        self.fronts = Fronts()
        self.left = Fronts()
        self.tips = Fronts()
        self.crescent = np.zeros(len(walls.points), dtype=bool)

    def corners(self, pieces: Sequence[Front]) -> list[tuple[int, int]]:
        """Stretches of the walls where more is left than the last lap takes over all depths.

        First and last samples of each, for the given edges of what is left.
        """
        near = np.zeros(len(self._walls.points), dtype=bool)
        for short, allowance in ((False, ALLOWANCE), (True, CUSP)):
            for it in pieces:
                if (it.length <= SHORTEST * self._radius) == short:
                    near[touched(self._walls.points, it, self._radius * (1 - allowance))] = True
        near &= ~self.crescent
        return self._walls.stretches(near, BESIDE) if near.any() else []

    def unswept(self) -> list[tuple[int, int]]:
        """Stretches of the walls where cuts have left a film, first and last samples of each."""
        walls, wall = self._walls, self._walls.wall
        perimeter = sum(ring.length for ring in walls.rings)
        thickest = float(np.clip(FILM_SHARE * (walls.area / perimeter + wall), *FILM))
        reach = walls.points + wall * unit(walls.heading - np.pi / 2)
        film = ~self.cleared.within(reach, wall + thickest)
        return walls.stretches(film, BESIDE) if film.any() else []

    def passed_by(self, centres: FloatArray) -> None:
        """Take note of what a way along the wall has cleared: there may be stock on its left."""
        tree = Places(centres)
        nowhere = np.zeros(len(centres))
        # its left is not along the wall
        way = Cut([], centres[0], centres, nowhere, nowhere + INSIDE)
        kept = self._outside(self.fronts, tree)
        self.note(tree, [*kept, *self._new_fronts(way, True, tree)])

    def entered(self, centres: FloatArray) -> None:
        """Take note of a helix: it may cut edges of what is left away."""
        tree = Places(centres)
        self.cleared.add(centres)
        self.left, self.tips = self._outside(self.left, tree), self._outside(self.tips, tree)

    def note(self, tree: Places, edges: Sequence[Front]) -> None:
        """Bring cleared area and edges of the stock up to date: what is left of fronts, and new."""
        self.cleared.add(tree.points)
        whole: list[Front] = []
        short: list[Front] = []
        for front in edges:
            (short if self.slight(front) else whole).append(front)
        self.left = self._outside(self.left, tree).plus(short)
        self.tips = self._outside(self.tips, tree)
        self.fronts = Fronts(joined(whole, self._radius, self._step, self._walls.clearance))
        spare = self._spare
        self._spare = {front: spare[front] for front in self.fronts if front in spare}

    def spare(self) -> None:
        """Leave all fronts to the last lap, which takes thicker stock beside them."""
        for it in self.fronts:
            self.crescent[touched(self._walls.points, it, self._radius)] = True
        self.left, self.fronts = self.left.plus(self.fronts), Fronts()

    def leave(self, index: int) -> None:
        """Leave a front to the ways along the walls."""
        self.left = self.left.plus([self.fronts[index]])
        self.tips = self.tips.plus([self.fronts[index]])
        self.fronts = self.fronts.without(index)

    def edges(self, cut: Cut, against: bool, fronts: Fronts) -> tuple[Places, list[Front]]:
        """Centres of a cut, and what it leaves of fronts, with the edges that it makes.

        `against` says that its stock is on its left.
        """
        swept = densified(cut.points, self._step)
        tree = Places(swept)
        kept = self._outside(fronts, tree)
        return tree, [*kept, *self._new_fronts(cut, against, tree)]

    def advance(self, front: Front, against: bool) -> None:
        """Where a cut has left its front as it was, its head folds back: go on without it."""
        near, size = self._step / 2, front.length
        for index, other in enumerate(self.fronts):
            if abs(other.length - size) >= 2 * near:
                continue
            if np.hypot(*(other.points[[0, -1]] - front.points[[0, -1]]).T).max() < near:
                self.behead(index, against)
                return

    def behead(self, index: int, against: bool) -> None:
        """Leave the head of a front, where no cut begins, to the wall pass; the rest is a front."""
        points = self.fronts[index].points
        head, rest = points[: HEAD + 2], points[HEAD:]
        if against:
            head, rest = points[-HEAD - 2 :], points[:-HEAD]
        self.left = self.left.plus([Front(head)])
        others = self.fronts.without(index)
        self.fronts = others.plus([Front(rest)]) if len(rest) > 2 else others

    def slight(self, front: Front) -> bool:
        """Whether a front is short or can be left, with what is behind it, to the last lap."""
        known = self._spare.get(front)
        if known is None:
            known = len(front) <= 2 or front.length <= SHORTEST * self._radius
            if not known:
                # a few places tell nearly always
                few = front.points[:: max(1, len(front) // 8)]
                known = bool(
                    self._spared(few, ALLOWANCE).all()
                    and self._spared(front.points, ALLOWANCE).all()
                )
            self._spare[front] = known
        return known

    def tail(self, front: FloatArray, allowance: float) -> int:
        """How many last points of a front are so near to the wall that the last lap takes them."""
        tail = front[-TAIL:]
        # a little less: the end of a cut leaves up to a sample more
        spared = self._spared(tail, 0.9 * allowance)
        return len(tail) if spared.all() else int(np.argmin(spared[::-1]))

    def _outside(self, fronts: Fronts, centres: Places) -> Fronts:
        """What is left of fronts where the tool has been."""
        return fronts.outside(centres, self._radius * (1 - GRAZE), 4 * self._step)

    def _spared(self, places: FloatArray, allowance: float) -> BoolArray:
        """Where the edge of the stock is so near to the wall that the last lap takes what is left.

        There the tool at the wall reaches the edge, and is not far into the stock.
        """
        least, most = self._radius * (1 - allowance), self._radius * (1 + allowance)
        gap = self._walls.distance(places)
        near = (gap >= least) & (gap <= most)
        rows = near.nonzero()[0]
        if len(rows):
            near[rows] = self._walls.clearance(places[rows], 2 * most) <= most
        return np.asarray(near)

    def _new_fronts(self, cut: Cut, against: bool, own: Places) -> list[Front]:
        """Edges of the stock that a cut leaves, the rim about its end included."""
        edge, piece = swept_side(cut.points, self._rimmed, against)
        last = len(cut.room) - 1
        # what lies in the swept area, however little, would go beside the edge, not on along it
        rim = ((piece < 0) | (piece == last)).nonzero()[0]
        inner = rim[own.near(edge.take(rim, axis=0), self._radius * (1 - INSIDE))]
        edge, piece = np.delete(edge, inner, axis=0), np.delete(piece, inner)
        low = cut.room.take(np.maximum(piece, 0))
        high = cut.room.take(np.minimum(piece + 1, last))
        stock = (piece < 0) | (piece == last) | (low > 0) | (high > 0)
        rows = stock.nonzero()[0]
        rows = rows[~own.near(edge.take(rows, axis=0), self._radius * (1 - GRAZE))]
        old = self.cleared.within(edge.take(rows, axis=0), self._radius * (1 + GRAZE / 4))
        stock[:] = False
        stock[rows[~old]] = True
        # where the wall is nearer to the edge than that, it is near the tool as well
        skin = WALL_SKIN * self._radius
        rows = (stock & (np.minimum(low, high) < skin)).nonzero()[0]
        stock[rows] = self._walls.off(edge.take(rows, axis=0), skin)
        least = NEAR * self._radius
        return [Front(unspiked(part, least)) for part in runs(edge, stock, 4 * self._step)]

    def _rimmed(self, points: FloatArray) -> tuple[FloatArray, IntArray]:
        """Right edge of what is swept, with the rim before and after; -1 and the last are these."""
        edge, piece = swept_edge(points, self._radius, self._step)
        # all round the ends: what is cleared there falls out
        least = NEAR * self._radius
        begun, ended = leaving(points, least), leaving(points[::-1], least) + np.pi
        before = begun + np.arange(-np.pi, 0.0, SAMPLING)
        after = ended + np.arange(-0.6, np.pi + 0.6, SAMPLING)
        rims = [
            points[end] + self._radius * unit(angle - np.pi / 2)
            for end, angle in ((0, before), (-1, after))
        ]
        owner = [np.full(len(before), -1), piece, np.full(len(after), len(points) - 1)]
        return np.concatenate([rims[0], edge, rims[1]]), np.concatenate(owner)
