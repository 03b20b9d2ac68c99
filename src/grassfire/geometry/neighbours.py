"""Neighbours of points, and what is connected, without loading SciPy for a few of them.

Loading `scipy.spatial` and `scipy.sparse` takes as long as planning a simple pocket.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FEW: Final = 4096
"""Pairs that are compared one by one as quickly as a tree answers."""

FEW_LINKS: Final = 400
"""Links that are followed one by one as quickly as a sparse matrix is made, between things of which
there are no more than `FEW`."""

LEAST_GROUP: Final = 128
MOST_GROUPS: Final = 4
"""Places whose neighbours are looked for within distances are asked about in so many groups."""


class Neighbours:
    """Points (n, d), asked for the nearest to others, or for pairs near each other.

    The tree is built when more than `FEW` pairs would have to be compared.

    Parameters
    ----------
    points : (n, d) float array
    on_curves : bool
        Whether they lie along curves: then another form of the tree makes far queries quicker.
    """

    def __init__(self, points: FloatArray, on_curves: bool = False) -> None:
        self.points = points
        self._on_curves = on_curves

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def tree(self) -> cKDTree:
        """The tree of all points."""
        from scipy.spatial import cKDTree

        if self._on_curves:
            return cKDTree(self.points, leafsize=32, compact_nodes=False, balanced_tree=False)
        return cKDTree(self.points)

    def nearest(
        self,
        places: FloatArray,
        count: int = 1,
        share: float = 0.0,
        workers: int = 1,
        within: FloatArray | None = None,
    ) -> tuple[FloatArray, IntArray]:
        """Distances and rows of the `count` <= n nearest points of each place, nearest first.

        Parameters
        ----------
        places : (m, d) float array
        count : int
        share : float
            By which part of their distance those found may be farther than the nearest.
        workers : int
            Threads; -1 for all cores.
        within : (m,) float array, optional
            Distances beyond which points do not matter: they may be left out, and what is then
            missing of the `count` is infinitely far and has a row that there is not.

        Returns
        -------
        (m, count) float and int arrays
        """
        if len(places) * len(self.points) > FEW:
            if within is None:
                return self._query(places, count, share, workers, np.inf)
            shape = len(places), count
            away, row = np.empty(shape), np.empty(shape, dtype=np.int64)
            # The tree takes one bound for all: places with bounds alike are asked about together.
            groups = min(1 + len(places) // LEAST_GROUP, MOST_GROUPS)
            for rows in np.array_split(within.argsort(), groups):
                bound = float(within[rows[-1]])
                rows = np.sort(rows)
                found = self._query(places.take(rows, axis=0), count, share, workers, bound)
                away[rows], row[rows] = found
            return away, row
        step = places[:, None, :] - self.points[None, :, :]
        square = np.einsum("ijk,ijk->ij", step, step)
        if count == 1:
            row = square.argmin(axis=1)[:, None]
        else:
            row = square.argsort(axis=1, kind="stable")[:, :count]
        return np.sqrt(np.take_along_axis(square, row, axis=1)), row

    def _query(
        self, places: FloatArray, count: int, share: float, workers: int, bound: float
    ) -> tuple[FloatArray, IntArray]:
        """The answer of the tree, (m, count)."""
        away, row = self.tree.query(
            places, k=count, eps=share, distance_upper_bound=bound, workers=workers
        )
        shape = len(places), count
        return np.asarray(away).reshape(shape), np.asarray(row, dtype=np.int64).reshape(shape)

    def pairs(self, distance: float) -> IntArray:
        """(k, 2) rows, the lesser first, of points at most `distance` from each other."""
        if len(self.points) ** 2 > FEW:
            rows = self._crowded(distance)
            if len(rows) < len(self.points):
                return np.asarray(rows[Neighbours(self.points[rows]).pairs(distance)])
            found = self.tree.query_pairs(distance, output_type="ndarray")
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
