"""Moves as they are read: rows one by one or many at once, frozen into a tool path."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..toolpath import FloatArray, MoveKind, Role, Toolpath

Position = tuple[float, float, float]

UNKNOWN: Final = float("nan")

_COLUMNS: Final = 8  # kind, x, y, z, centre x, centre y, feed, line


class Moves:
    """Moves from one position on; roles are told later.

    Parameters
    ----------
    start : tuple of float, optional
        (x, y, z) before the first move, mm; NaN where an axis is not known, as by default.
    """

    def __init__(self, start: Position = (UNKNOWN, UNKNOWN, UNKNOWN)) -> None:
        self.start = start
        self.position = start
        self._rows: list[tuple[float, ...]] = []
        self._blocks: list[FloatArray] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count + len(self._rows)

    def add(
        self,
        kind: MoveKind,
        end: Position,
        line: int,
        feed: float = UNKNOWN,
        centre: tuple[float, float] = (UNKNOWN, UNKNOWN),
    ) -> None:
        """Append one move to `end`, mm, at `feed` mm/min."""
        self._rows.append((kind, *end, *centre, feed, line))
        self.position = end

    def extend(
        self,
        kind: NDArray[np.uint8],
        end: FloatArray,
        line: NDArray[np.int64],
        feed: FloatArray,
        centre: FloatArray,
    ) -> None:
        """Append n moves: (n,) kinds, (n, 3) ends, (n,) lines, (n,) feeds, (n, 2) centres."""
        if not len(kind):
            return
        self._settle()
        block = np.empty((len(kind), _COLUMNS))
        block[:, 0], block[:, 1:4], block[:, 4:6] = kind, end, centre
        block[:, 6], block[:, 7] = feed, line
        self._blocks.append(block)
        self._count += len(block)
        x, y, z = end[-1].tolist()
        self.position = (x, y, z)

    def _settle(self) -> None:
        """Rows into a block of their own."""
        if self._rows:
            self._blocks.append(np.array(self._rows, dtype=np.float64).reshape(-1, _COLUMNS))
            self._count += len(self._rows)
            self._rows = []

    def build(self) -> Toolpath:
        """Freeze the moves; rapids have the role of rapids, all others that of cuts."""
        self._settle()
        table = np.concatenate(self._blocks) if self._blocks else np.empty((0, _COLUMNS))
        self._blocks = [table]
        kind = table[:, 0].astype(np.uint8)
        return Toolpath(
            start=np.array(self.start, dtype=np.float64),
            kind=kind,
            end=np.ascontiguousarray(table[:, 1:4]),
            centre=np.ascontiguousarray(table[:, 4:6]),
            feed=np.ascontiguousarray(table[:, 6]),
            role=np.where(kind == MoveKind.RAPID, Role.RAPID, Role.CUT).astype(np.uint8),
            line=table[:, 7].astype(np.int64),
        )
