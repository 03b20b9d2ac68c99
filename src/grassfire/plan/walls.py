"""Wall rings as samples: the ways of a tool that touches the wall."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grassfire.geometry.curve import cross
from grassfire.medial import MedialAxis
from grassfire.plan.boundary import Boundary
from grassfire.plan.path import Path, join
from grassfire.plan.places import BoolArray, IntArray, Places
from grassfire.toolpath import FloatArray

CELL = 20.0
"""Largest size of the cells in which distances are prepared, in samples of the rings."""


def mirrored(points: FloatArray) -> FloatArray:
    """Points (n, 2) reflected in the x axis: right and left change places."""
    return np.asarray(points * np.array([1.0, -1.0]))


def mirrored_path(path: Path) -> Path:
    """A path reflected in the x axis."""
    return Path(mirrored(path.points), mirrored(path.centre), -path.sweep)


class Walls:
    """Rings of one component, sampled, in a frame in which cuts keep the stock on their right.

    Parameters
    ----------
    axis : MedialAxis
        Asked for the distance to the boundary.
    rings : sequence of Path
        Closed, component on the left.
    wall : float
        Their distance from the boundary, mm.
    step : float
        Between samples, mm.
    reflect : bool
        Whether the frame is the mirror image of the drawing: for stock on the left.

    Attributes
    ----------
    points : (n, 2) float array
        Samples of all rings, mm.
    heading : (n,) float array
        Direction along the ring from each, radians.
    along : (n,) float array
        Arc length on its ring, mm.
    wall : float
        As given.
    ring, first, count : (n,) int arrays
        Ring of each sample; index of its first sample and how many it has.
    """

    def __init__(
        self,
        axis: MedialAxis,
        rings: Sequence[Path],
        wall: float,
        step: float,
        reflect: bool = False,
    ) -> None:
        self._boundary = Boundary(axis, CELL * step) if Boundary.suits(axis) else None
        self._axis = axis
        self.wall = wall
        self._step = step
        self.reflect = reflect
        self.rings = [mirrored_path(ring.reversed()) for ring in rings] if reflect else list(rings)
        sampled = [ring.sample(step) for ring in self.rings]
        size = np.array([len(along) - 1 for _, along in sampled])
        self.points = np.concatenate([points[:-1] for points, _ in sampled])
        chords = np.concatenate([np.diff(points, axis=0) for points, _ in sampled])
        self.heading = np.arctan2(chords[:, 1], chords[:, 0])
        self.along = np.concatenate([along[:-1] for _, along in sampled])
        self.ring = np.repeat(np.arange(len(size)), size)
        self.first = np.repeat(np.cumsum(size) - size, size)
        self.count = np.repeat(size, size)
        self._tree = Places(self.points)

    @property
    def area(self) -> float:
        """Area inside the rings, mm2, as the samples tell it."""
        rank = np.arange(len(self.points)) - self.first
        after = self.points[self.first + (rank + 1) % self.count]
        return float(cross(self.points, after).sum()) / 2

    def frame(self, points: FloatArray) -> FloatArray:
        """Points of the drawing in the frame, and back."""
        return mirrored(points) if self.reflect else points

    def path(self, path: Path) -> Path:
        """A path of the frame in the drawing, and back."""
        return mirrored_path(path) if self.reflect else path

    def clearance(self, points: FloatArray, enough: float = np.inf) -> FloatArray:
        """(n,) distance of points of the frame to the boundary, mm.

        Where it is at least `enough` a bound of it may stand for it that is at least that as well.
        """
        if self._boundary is not None:
            return self._boundary.clearance(self.frame(points), enough)
        return self._axis.clearance(self.frame(points))

    def off(self, points: FloatArray, skin: float) -> BoolArray:
        """(n,) which points are further from the boundary than `skin` mm."""
        if not len(points):
            return np.zeros(0, dtype=bool)
        return np.asarray(self.clearance(points, 2 * skin) > skin)

    def room(self, chain: FloatArray) -> FloatArray:
        """(n,) clearance beyond `wall` on a way that begins inside; exact near the rings, mm.

        Elsewhere it may be less. Without a boundary that is the distance to the rings: on the way
        from a point to the nearest wall, the ring is met at clearance - wall. Points of the way
        must be no further apart than twice the samples of the rings, so that none passes a ring
        unseen.
        """
        if self._boundary is not None:
            return self.clearance(chain, self.wall + 2 * self._step) - self.wall
        result = self._tree.closest(chain)[0] - self._step / 2
        near = np.flatnonzero(result < 2 * self._step)
        if len(near):
            result[near] = self.clearance(chain[near]) - self.wall
        return np.asarray(result)

    def distance(self, points: FloatArray) -> FloatArray:
        """(n,) distance to the nearest sample, mm."""
        return self._tree.closest(points)[0]

    def nearest(self, point: FloatArray) -> int:
        """Index of the nearest sample."""
        return int(self._tree.closest(point[None])[1][0])

    def beyond(self, sample: int, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, 2) places and (n,) headings on the ring at shares of the way to the next sample."""
        ring = self.rings[int(self.ring[sample])]
        first, size = int(self.first[sample]), int(self.count[sample])
        after = first + (sample - first + 1) % size
        step = float((self.along[after] - self.along[sample]) % ring.length)
        along = self.along[sample] + np.stack([share, share - 0.01, share + 0.01]) * step
        places, before, behind = ring.at(along.ravel() % ring.length).reshape(3, -1, 2)
        way = behind - before
        return places, np.arctan2(way[:, 1], way[:, 0])

    def beside(self, sample: int, along: float) -> FloatArray:
        """(2,) place on the ring so far on from a sample, or back, mm."""
        ring = self.rings[int(self.ring[sample])]
        return ring.point(float((self.along[sample] + along) % ring.length))

    def ahead(self, sample: int, count: int) -> IntArray:
        """(m,) indices of the next samples on the same ring, this one first, at most one lap."""
        first, size = int(self.first[sample]), int(self.count[sample])
        return np.asarray(first + (sample - first + np.arange(min(count, size))) % size)

    def behind(self, sample: int, count: int) -> IntArray:
        """(m,) indices of the samples before it on the same ring, this one first."""
        first, size = int(self.first[sample]), int(self.count[sample])
        return np.asarray(first + (sample - first - np.arange(min(count, size))) % size)

    def stretches(self, flags: BoolArray, beside: int) -> list[tuple[int, int]]:
        """First and last samples of the runs of set flags, lengthened by some on either side."""
        found: list[tuple[int, int]] = []
        for first in np.unique(self.first).tolist():
            size = int(self.count[first])
            own = flags[first : first + size]
            if not own.any():
                continue
            wide = (
                np.convolve(np.tile(own, 3), np.ones(2 * beside + 1), "same")[size : 2 * size] > 0
            )
            if wide.all():
                # all of the ring, from a sample without a flag
                turn = int(np.argmin(own))
                found.append((first + turn, first + (turn - 1) % size))
                continue
            turn = int(np.argmin(wide))
            edges = np.flatnonzero(np.diff(np.roll(wide, -turn).astype(np.int8), append=0))
            for low, high in edges.reshape(-1, 2).tolist():
                found.append((first + (low + 1 + turn) % size, first + (high + turn) % size))
        return found

    def steps(self, start: int, stop: int) -> int:
        """How many samples lead from one forward to another on the same ring."""
        return int((stop - start) % self.count[start])

    def size(self, start: int, stop: int) -> float:
        """Length of the ring from one sample forward to another, mm."""
        ring = self.rings[int(self.ring[start])]
        return float((self.along[stop] - self.along[start]) % ring.length)

    def slice(self, start: int, stop: int, before: float = 0.0, after: float = 0.0) -> Path | None:
        """The ring from one sample forward to another; None where they are the same.

        Beginning and ending so far on from them, mm.
        """
        if start == stop and before >= after:
            return None
        ring = self.rings[int(self.ring[start])]
        low = float(self.along[start] + before) % ring.length
        high = float(self.along[stop] + after) % ring.length
        if low < high:
            return ring.slice(low, high)
        if high == 0.0:
            return ring.slice(low, ring.length)
        return join(ring.slice(low, ring.length), ring.slice(0.0, high))
