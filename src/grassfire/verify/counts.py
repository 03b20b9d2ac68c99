"""What can be counted without machining: moves, lengths, retracts, time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from grassfire.toolpath import Program
from grassfire.verify.clock import Clock, move_times
from grassfire.verify.model import FloatArray, Target
from grassfire.verify.path import Path, below_top, flatten_program

_RISE = 1e-6
"""A rapid retracts where it rises by more, mm."""


@dataclass(frozen=True, kw_only=True)
class MoveCounts:
    """The moves of one operation.

    Attributes
    ----------
    moves, lines, arcs : int
        All moves; feed moves by kind.
    cut_length_mm, rapid_length_mm : float
        Of feed moves that reach below the stock's top; of rapids.
    time_s : float
    retracts : int
        Rapids that rise from below the stock's top.
    """

    moves: int
    lines: int
    arcs: int
    cut_length_mm: float
    rapid_length_mm: float
    time_s: float
    retracts: int


def count_moves(path: Path, seconds: FloatArray, operation: int, top: float) -> MoveCounts:
    """Count the moves of one operation on a path with (n,) seconds per move."""
    own = path.operation == operation
    length = np.nan_to_num(path.length)
    feeding = own & ~path.rapid
    rising = path.end[:, 2] > path.begin[:, 2] + _RISE
    low_start = path.begin[:, 2] < top - _RISE
    return MoveCounts(
        moves=int(np.count_nonzero(own)),
        lines=int(np.count_nonzero(feeding & ~path.arc)),
        arcs=int(np.count_nonzero(feeding & path.arc)),
        cut_length_mm=float(length[feeding & below_top(path, top)].sum()),
        rapid_length_mm=float(length[own & path.rapid].sum()),
        time_s=float(seconds[own].sum()),
        retracts=int(np.count_nonzero(own & path.rapid & rising & low_start)),
    )


def count_program(
    program: Program,
    targets: Sequence[Target],
    *,
    stock_top: float,
    **clock: Unpack[Clock],
) -> dict[int, MoveCounts]:
    """Count the moves of every operation that has a target, without judging them.

    Parameters
    ----------
    program : Program
    targets : sequence of Target
    stock_top : float
        z, mm.
    **clock
        rapid, acceleration, and what else `move_times` takes.

    Raises
    ------
    InputError
        If a section of the program belongs to no target, or a speed is not positive.
    """
    path = flatten_program(program, tuple(targets))
    seconds = move_times(path, **clock)
    operations = sorted({target.operation for target in targets})
    return {index: count_moves(path, seconds, index, stock_top) for index in operations}
