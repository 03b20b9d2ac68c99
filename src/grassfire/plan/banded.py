"""Many small banded systems at once, without SciPy: loading it takes longer than solving them."""

from __future__ import annotations

import numpy as np

from grassfire.plan.places import IntArray
from grassfire.toolpath import FloatArray

BLOCK = 64
"""Unknowns of a block: up to there dense ones are as quick."""


def solved(band: FloatArray, wanted: FloatArray, sizes: IntArray) -> FloatArray:
    """Solutions of many definite banded systems, each to the last bit what it would be alone.

    Parameters
    ----------
    band : (3, m, w) float array
        Diagonals of symmetric matrices: the second above the main one, the first, the main one;
        each entry in its column, as in `scipy.linalg.solveh_banded`.
    wanted : (m, w) float array
        Right-hand sides.
    sizes : (m,) int array
        How many unknowns each system has; the rest of its row stands alone.

    Returns
    -------
    (m, w) float array
        What is beyond the unknowns of each means nothing.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where one is singular.
    """
    found = np.zeros_like(wanted)
    width = wanted.shape[1]
    # those of about the same size at once, each in as much room as if it were alone
    wide = np.where(sizes > BLOCK, BLOCK, BLOCK // 8)
    rooms = -(-sizes // wide) * wide
    for room in np.unique(rooms).tolist():
        rows = (rooms == room).nonzero()[0]
        size = min(room, width)
        own, right = np.zeros((3, len(rows), room)), np.zeros((len(rows), room))
        own[:, :, :size], right[:, :size] = band[:, rows, :size], wanted[rows, :size]
        # what is added stands alone
        own[2, :, size:] = 1.0
        found[rows, :size] = _solved_alike(own, right)[:, :size]
    return found


def _solved_alike(band: FloatArray, wanted: FloatArray) -> FloatArray:
    """(m, w) solutions of banded systems in dense blocks, each eliminated from the next one.

    There is one block, or w is a multiple of `BLOCK`. Only the last two unknowns of a block and the
    first two of the next one meet, in a corner.
    """
    rows, size = wanted.shape
    blocks = -(-size // BLOCK)
    count = size // blocks
    near = np.arange(count)
    column = band.reshape(3, rows, blocks, count)
    dense = np.zeros((blocks, rows, count, count))
    for away in range(3):
        entry = column[2 - away, :, :, away:].swapaxes(0, 1)
        dense[:, :, near[: count - away], near[away:]] = entry
        dense[:, :, near[away:], near[: count - away]] = entry
    right = np.zeros((blocks, rows, count, 3 if blocks > 1 else 1))
    right[..., 0] = wanted.reshape(rows, blocks, count).swapaxes(0, 1)
    if blocks == 1:
        return np.asarray(np.linalg.solve(dense[0], right[0])[..., 0])
    right[..., -2:, 1:] = np.eye(2)
    corner = np.zeros((blocks, rows, 2, 2))
    corner[1:, :, 0, 0], corner[1:, :, 1, 1] = column[0, :, 1:, :2].T
    corner[1:, :, 1, 0] = column[1, :, 1:, 0].T
    answers = np.empty_like(right)
    for block in range(blocks):
        if block:
            back = corner[block].swapaxes(1, 2)
            before = answers[block - 1][:, -2:]
            dense[block][:, :2, :2] -= back @ before[:, :, 1:] @ corner[block]
            right[block][:, :2, 0] -= (back @ before[:, :, :1])[..., 0]
        answers[block] = np.linalg.solve(dense[block], right[block])
    found = answers[..., 0]
    for block in range(blocks - 2, -1, -1):
        ahead = corner[block + 1] @ found[block + 1][:, :2, None]
        found[block] -= (answers[block][..., 1:] @ ahead)[..., 0]
    return np.asarray(found.swapaxes(0, 1).reshape(rows, -1))
