"""Neighbours of points, and what is connected, without loading SciPy for a few of them.

Loading `scipy.spatial` and `scipy.sparse` takes as long as planning a simple pocket; their trees
answer a hundred places in twice the time of those here, and take four times as long to build.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray


@contextmanager
def _one_thread() -> Iterator[None]:
    """While a library is loaded that takes its number of threads from the environment.

    Most questions are about a hundred places: sharing them out takes longer than answering them,
    and four times as long where the other core is busy.
    """
    name = "OMP_NUM_THREADS"
    before = os.environ.get(name)
    os.environ[name] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


with _one_thread():
    from pykdtree.kdtree import KDTree

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FEW: Final = 4096
"""Pairs that are compared one by one as quickly as a tree is asked for them."""

FEW_LINKS: Final = 400
"""Links that are followed one by one as quickly as a sparse matrix is made, between things of which
there are no more than `FEW`."""

LEAST_GROUP: Final = 128
MOST_GROUPS: Final = 4
"""Places whose neighbours are looked for within distances are asked about in so many groups."""


class Neighbours:
    """A k-d tree of points (n, d), asked for the nearest to others, or for pairs near each other.

    Parameters
    ----------
    points : (n, d) float array
        At least one to be the nearest; not to be changed afterwards.
    """

    def __init__(self, points: FloatArray) -> None:
        self.points = np.ascontiguousarray(points)

    def __len__(self) -> int:
        return len(self.points)

    def __reduce__(self) -> tuple[type[Neighbours], tuple[FloatArray]]:
        # the tree is made again where it is asked
        return type(self), (self.points,)

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.points)

    def nearest(
        self,
        places: FloatArray,
        count: int = 1,
        share: float = 0.0,
        within: FloatArray | None = None,
    ) -> tuple[FloatArray, IntArray]:
        """Distances and rows of the `count` <= n nearest points of each place, nearest first.

        Parameters
        ----------
        places : (m, d) float array
        count : int
        share : float
            By which part of their distance those found may be farther than the nearest.
        within : (m,) float array, optional
            Distances beyond which points do not matter: they may be left out, and what is then
            missing of the `count` is infinitely far and has a row that there is not.

        Returns
        -------
        (m, count) float and int arrays
        """
        if within is None:
            return self._query(places, count, share, np.inf)
        shape = len(places), count
        away, row = np.empty(shape), np.empty(shape, dtype=np.int64)
        # The tree takes one bound for all: places with bounds alike are asked about together.
        groups = min(1 + len(places) // LEAST_GROUP, MOST_GROUPS)
        for rows in np.array_split(within.argsort(), groups):
            if len(rows):
                bound = float(within[rows[-1]])
                rows = np.sort(rows)
                away[rows], row[rows] = self._query(places.take(rows, axis=0), count, share, bound)
        return away, row

    def near(self, places: FloatArray, reach: float) -> BoolArray:
        """(m,) which places have one of the points nearer than `reach`."""
        return np.asarray(self._query(places, 1, 0.0, reach)[0][:, 0] < reach)

    def _query(
        self, places: FloatArray, count: int, share: float, bound: float
    ) -> tuple[FloatArray, IntArray]:
        """The answer of the tree, (m, count)."""
        shape = len(places), count
        if not len(places):
            return np.zeros(shape), np.zeros(shape, dtype=np.int64)
        away, row = self._tree.query(
            np.ascontiguousarray(places), k=count, eps=share, distance_upper_bound=bound
        )
        return away.reshape(shape), row.reshape(shape).astype(np.int64)

    def pairs(self, distance: float) -> IntArray:
        """(k, 2) rows, the lesser first, of points at most `distance` from each other."""
        if len(self.points) ** 2 > FEW:
            rows = self._crowded(distance)
            if len(rows) < len(self.points):
                return np.asarray(rows[Neighbours(self.points[rows]).pairs(distance)])
            from scipy.spatial import cKDTree

            found = cKDTree(self.points).query_pairs(distance, output_type="ndarray")
            return np.asarray(found, dtype=np.int64)
        step = self.points[:, None, :] - self.points[None, :, :]
        near = np.einsum("ijk,ijk->ij", step, step) <= distance * distance
        return np.argwhere(np.triu(near, 1))

    def _crowded(self, distance: float) -> IntArray:
        """Rows that may be within a distance of others: on a line across all their coordinates they
        are."""
        slope = 1.0 / np.sqrt(np.arange(2.0, self.points.shape[1] + 2.0))
        along = self.points @ (slope / np.hypot.reduce(slope))
        order = along.argsort()
        margin = 1e-14 * float(np.abs(self.points).max())
        close = np.diff(along.take(order)) <= distance + margin
        beside = np.zeros(len(order), dtype=bool)
        beside[:-1] |= close
        beside[1:] |= close
        return np.sort(order[beside])


def connected(first: IntArray, second: IntArray, count: int) -> IntArray:
    """(count,) component of each of `count` things, from links (k,) between them.

    Components are numbered from 0 in the order of their first members.
    """
    if len(first) > FEW_LINKS or count > FEW:
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import connected_components

        order = first.argsort(kind="stable")
        start = np.zeros(count + 1, dtype=np.int32)
        np.cumsum(np.bincount(first, minlength=count), out=start[1:])
        column = second.take(order).astype(np.int32)
        matrix = csr_array((np.ones(len(first)), column, start), shape=(count, count))
        return np.asarray(connected_components(matrix, directed=False)[1], dtype=np.int64)
    above = list(range(count))
    for one, other in zip(first.tolist(), second.tolist(), strict=True):
        while above[one] != one:
            above[one] = above[above[one]]
            one = above[one]
        while above[other] != other:
            above[other] = above[above[other]]
            other = above[other]
        # the least member is the root, so that roots come before what hangs on them
        above[max(one, other)] = min(one, other)
    label = [0] * count
    groups = 0
    for index, parent in enumerate(above):
        if parent == index:
            label[index] = groups
            groups += 1
        else:
            label[index] = label[parent]
    return np.array(label, dtype=np.int64)
