"""Tool paths as columns: one row a move, the same arrays from the planner to the verifier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class MoveKind(IntEnum):
    """Geometry of a move; arcs lie in the XY plane and are helices where z changes."""

    RAPID = 0
    LINE = 1
    ARC_CW = 2
    ARC_CCW = 3


class Role(IntEnum):
    """What a move is for; feeds and colours follow from it."""

    RAPID = 0
    ENTRY = 1
    CUT = 2
    LINK = 3
    LEAD = 4
    FINISH = 5


@dataclass(frozen=True)
class Toolpath:
    """Moves of one tool, in order.

    Attributes
    ----------
    start : (3,) float array
        Position before the first move, mm; NaN where an axis is not known yet.
    kind : (n,) uint8 array of MoveKind
    end : (n, 3) float array
        Position after each move, mm.
    centre : (n, 2) float array
        Centre of each arc, mm; NaN for rapids and lines. An arc whose end equals its start in
        XY is a full turn.
    feed : (n,) float array
        mm/min; NaN for rapids.
    role : (n,) uint8 array of Role
    line : (n,) int64 array
        Line of the program text, counted from 1; 0 for planned moves.
    """

    start: FloatArray
    kind: NDArray[np.uint8]
    end: FloatArray
    centre: FloatArray
    feed: FloatArray
    role: NDArray[np.uint8]
    line: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def begin(self) -> FloatArray:
        """(n, 3) position before each move, mm."""
        return np.concatenate([self.start[None, :], self.end[:-1]])[: len(self)]

    @property
    def is_arc(self) -> NDArray[np.bool_]:
        """(n,) whether each move is an arc."""
        return np.asarray(self.kind >= MoveKind.ARC_CW)

    @property
    def sweep(self) -> FloatArray:
        """(n,) signed arc sweep in radians (counter-clockwise positive), 0 for straight moves."""
        arc = self.is_arc
        result = np.zeros(len(self))
        if arc.any():
            from_centre = self.begin[arc, :2] - self.centre[arc]
            to_centre = self.end[arc, :2] - self.centre[arc]
            turn = np.arctan2(
                from_centre[:, 0] * to_centre[:, 1] - from_centre[:, 1] * to_centre[:, 0],
                np.sum(from_centre * to_centre, axis=1),
            )
            same = np.all(self.begin[arc, :2] == self.end[arc, :2], axis=1)
            counter = self.kind[arc] == MoveKind.ARC_CCW
            turn = np.where(counter & (turn <= 0), turn + 2 * np.pi, turn)
            turn = np.where(~counter & (turn >= 0), turn - 2 * np.pi, turn)
            turn = np.where(same, np.where(counter, 2 * np.pi, -2 * np.pi), turn)
            result[arc] = turn
        return result

    @property
    def length(self) -> FloatArray:
        """(n,) length of each move in space, mm; NaN where it starts at an unknown position."""
        delta = self.end - self.begin
        planar = np.hypot(delta[:, 0], delta[:, 1])
        arc = self.is_arc
        if arc.any():
            radius = np.hypot(*(self.begin[arc, :2] - self.centre[arc]).T)
            planar[arc] = radius * np.abs(self.sweep[arc])
        return np.asarray(np.hypot(planar, delta[:, 2]))


@dataclass(frozen=True)
class Section:
    """Moves made with one tool and one spindle setting, for one operation.

    `operation` is the index in the job, counted from 0; -1 where it is not known (foreign code).
    """

    toolpath: Toolpath
    tool_number: int
    tool_diameter: float
    spindle_speed: float
    operation: int = -1
    name: str = ""
    coolant: str = "off"


@dataclass(frozen=True)
class Program:
    """All sections in the order of machining, in mm."""

    name: str
    sections: tuple[Section, ...]
    wcs: str = "G54"
    findings: tuple[str, ...] = field(default=())


class ToolpathBuilder:
    """Collects moves one at a time; `build` freezes them into columns."""

    def __init__(self, start: tuple[float, float, float] | None = None) -> None:
        unknown = (float("nan"),) * 3
        self.start = tuple(float(value) for value in (start or unknown))
        self.position = self.start
        self._kind: list[int] = []
        self._end: list[tuple[float, float, float]] = []
        self._centre: list[Sequence[float]] = []
        self._feed: list[float] = []
        self._role: list[int] = []
        self._line: list[int] = []

    def __len__(self) -> int:
        return len(self._kind)

    def _append(
        self,
        kind: MoveKind,
        end: tuple[float, float, float],
        centre: tuple[float, float],
        feed: float,
        role: Role,
        line: int,
    ) -> None:
        self._kind.append(int(kind))
        self._end.append(end)
        self._centre.append(centre)
        self._feed.append(feed)
        self._role.append(int(role))
        self._line.append(line)
        self.position = end

    def rapid(self, x: float, y: float, z: float, line: int = 0) -> None:
        """Append a rapid to (x, y, z), mm."""
        nan = float("nan")
        self._append(
            MoveKind.RAPID, (float(x), float(y), float(z)), (nan, nan), nan, Role.RAPID, line
        )

    def line(
        self, x: float, y: float, z: float, feed: float, role: Role = Role.CUT, line: int = 0
    ) -> None:
        """Append a straight feed move to (x, y, z), mm, at `feed` mm/min."""
        nan = float("nan")
        self._append(
            MoveKind.LINE, (float(x), float(y), float(z)), (nan, nan), float(feed), role, line
        )

    def arc(
        self,
        x: float,
        y: float,
        z: float,
        centre: tuple[float, float],
        counter_clockwise: bool,
        feed: float,
        role: Role = Role.CUT,
        line: int = 0,
    ) -> None:
        """Append an arc (a helix where z changes) to (x, y, z) about `centre`, mm."""
        kind = MoveKind.ARC_CCW if counter_clockwise else MoveKind.ARC_CW
        self._append(
            kind,
            (float(x), float(y), float(z)),
            (float(centre[0]), float(centre[1])),
            float(feed),
            role,
            line,
        )

    def extend(
        self,
        kind: Sequence[int],
        end: Sequence[tuple[float, float, float]],
        centre: Sequence[Sequence[float]],
        feed: Sequence[float],
        role: Role,
    ) -> None:
        """Append moves of one role at once, each column as `Toolpath` has it, without lines."""
        if not len(kind):
            return
        self._kind.extend(kind)
        self._end.extend(end)
        self._centre.extend(centre)
        self._feed.extend(feed)
        self._role.extend([int(role)] * len(kind))
        self._line.extend([0] * len(kind))
        self.position = end[-1]

    def build(self) -> Toolpath:
        """Freeze the moves."""
        count = len(self._kind)
        return Toolpath(
            start=np.array(self.start, dtype=np.float64),
            kind=np.array(self._kind, dtype=np.uint8),
            end=np.array(self._end, dtype=np.float64).reshape(count, 3),
            centre=np.array(self._centre, dtype=np.float64).reshape(count, 2),
            feed=np.array(self._feed, dtype=np.float64),
            role=np.array(self._role, dtype=np.uint8),
            line=np.array(self._line, dtype=np.int64),
        )
