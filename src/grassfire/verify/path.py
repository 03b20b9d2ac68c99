"""The whole program as one path: columns over all moves, lines and true arcs alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grassfire.errors import InputError
from grassfire.toolpath import MoveKind, Program, Section
from grassfire.verify.model import FloatArray, Target

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

BELOW = 1e-6
"""A position counts as below the stock's top from this depth on, mm."""


@dataclass(frozen=True)
class Path:
    """All moves of a program in order; n rows, lengths in mm.

    `begin` and `end` are (n, 3), NaN where a coordinate is unknown. An arc whose two radii
    differ runs from the one to the other linearly in its angle. `station` (n + 1,) is the path
    length before each move: the clock of the sweep.
    """

    begin: FloatArray
    end: FloatArray
    centre: FloatArray
    rapid: BoolArray
    arc: BoolArray
    feed: FloatArray
    line: IntArray
    section: IntArray
    operation: IntArray
    tool_radius: FloatArray
    spindle_on: BoolArray
    sweep: FloatArray
    start_radius: FloatArray
    end_radius: FloatArray
    start_angle: FloatArray
    planar: FloatArray
    length: FloatArray
    station: FloatArray

    def __len__(self) -> int:
        return len(self.line)

    @property
    def known(self) -> BoolArray:
        """(n,) whether both ends of each move are known in all axes."""
        return np.asarray(np.isfinite(self.begin).all(axis=1) & np.isfinite(self.end).all(axis=1))

    @property
    def low(self) -> FloatArray:
        """(n,) lowest z of each move, mm; NaN where unknown."""
        return np.minimum(self.begin[:, 2], self.end[:, 2])

    def point(self, move: IntArray, fraction: FloatArray) -> FloatArray:
        """Return (m, 3) positions at `fraction` of each of the given moves."""
        begin, end = self.begin[move], self.end[move]
        result = begin + (end - begin) * fraction[:, None]
        arc = np.flatnonzero(self.arc[move])
        if len(arc):
            row, part = move[arc], fraction[arc]
            radius = self.start_radius[row]
            radius = radius + (self.end_radius[row] - radius) * part
            angle = self.start_angle[row] + self.sweep[row] * part
            result[arc, 0] = self.centre[row, 0] + radius * np.cos(angle)
            result[arc, 1] = self.centre[row, 1] + radius * np.sin(angle)
        return np.asarray(result)

    def heading(self, move: IntArray, fraction: FloatArray) -> FloatArray:
        """Return (m, 2) unit directions of travel in XY; 0 for moves without travel there."""
        delta = self.end[move, :2] - self.begin[move, :2]
        arc = np.flatnonzero(self.arc[move])
        if len(arc):
            row = move[arc]
            angle = self.start_angle[row] + self.sweep[row] * fraction[arc]
            side = np.sign(self.sweep[row])
            delta[arc, 0], delta[arc, 1] = -side * np.sin(angle), side * np.cos(angle)
        size = np.hypot(delta[:, 0], delta[:, 1])
        return np.asarray(delta / np.where(size > 0, size, 1.0)[:, None])


def below_top(path: Path, top: float) -> BoolArray:
    """Return (n,) whether each move reaches below the stock's top; unknown z does not count."""
    return np.asarray(np.fmin(path.begin[:, 2], path.end[:, 2]) < top - BELOW)


def assign(program: Program, targets: tuple[Target, ...]) -> list[Target]:
    """Return the target that each section serves.

    A section that names no operation (foreign code) is matched by being the only one, by tool
    number, by the order of sections, or by tool diameter.

    Raises
    ------
    InputError
        If a section cannot be matched.
    """
    by_operation: dict[int, Target] = {}
    for target in targets:
        by_operation.setdefault(target.operation, target)
    distinct = list(by_operation.values())
    cutting = [index for index, item in enumerate(program.sections) if len(item.toolpath)]
    result = []
    for index, section in enumerate(program.sections):
        if section.operation >= 0:
            if section.operation not in by_operation:
                raise InputError(
                    f"the program has a section of operation {section.operation}, "
                    "for which there is no target",
                    place=section.name or f"section {index + 1}",
                    remedy="verify it against the job that it was made from",
                )
            result.append(by_operation[section.operation])
            continue
        result.append(_guess(index, section, cutting, distinct))
    return result


def _guess(index: int, section: Section, cutting: list[int], targets: list[Target]) -> Target:
    """Return the target of a section that names no operation."""
    if len(targets) == 1 or index not in cutting:
        return targets[0]
    numbered = [item for item in targets if item.tool_number == section.tool_number]
    if len(numbered) == 1:
        return numbered[0]
    if len(cutting) == len(targets):
        return targets[cutting.index(index)]
    alike = [item for item in targets if abs(2 * item.tool_radius - section.tool_diameter) < 1e-3]
    if len(alike) == 1:
        return alike[0]
    raise InputError(
        f"cannot tell which operation section {index + 1} (tool {section.tool_number}) serves",
        remedy="give each operation its own tool, or keep the program's operation comments",
    )


def _radius_of(section: Section, target: Target, targets: tuple[Target, ...]) -> float:
    """Return the radius that the machine really has loaded: stated, by number, or as asked."""
    if np.isfinite(section.tool_diameter) and section.tool_diameter > 0:
        return section.tool_diameter / 2
    for item in targets:
        if item.tool_number is not None and item.tool_number == section.tool_number:
            return item.tool_radius
    return target.tool_radius


def flatten_program(program: Program, targets: tuple[Target, ...]) -> Path:
    """Return the program as one `Path`."""
    served = assign(program, targets)
    paths = [section.toolpath for section in program.sections]
    counts = [len(item) for item in paths]
    if not sum(counts):
        paths, counts = [], []

    def column(values: list[float], dtype: type) -> NDArray[np.generic]:
        return np.repeat(np.array(values, dtype=dtype), counts) if counts else np.empty(0, dtype)

    def stack(name: str, width: int) -> FloatArray:
        parts = [np.asarray(getattr(item, name), dtype=np.float64) for item in paths]
        shape = (0, width) if width > 1 else (0,)
        return np.concatenate(parts) if parts else np.empty(shape)

    used = list(zip(program.sections, served, strict=True)) if counts else []
    kind = stack("kind", 1)
    begin, end, centre = stack("begin", 3), stack("end", 3), stack("centre", 2)
    arc = kind >= MoveKind.ARC_CW
    sweep = stack("sweep", 1)
    first, last = begin[:, :2] - centre, end[:, :2] - centre
    start_radius = np.where(arc, np.hypot(first[:, 0], first[:, 1]), 0.0)
    end_radius = np.where(arc, np.hypot(last[:, 0], last[:, 1]), 0.0)
    delta = end - begin
    planar = np.hypot(delta[:, 0], delta[:, 1])
    planar = np.where(arc, np.abs(sweep) * (start_radius + end_radius) / 2, planar)
    length = np.hypot(planar, delta[:, 2])
    known = np.where(np.isfinite(length), length, 0.0)
    return Path(
        begin=begin,
        end=end,
        centre=centre,
        rapid=kind == MoveKind.RAPID,
        arc=arc,
        feed=stack("feed", 1),
        line=stack("line", 1).astype(np.int64),
        section=np.asarray(column(list(range(len(counts))), int), dtype=np.int64),
        operation=np.asarray(column([t.operation for _, t in used], int), dtype=np.int64),
        tool_radius=np.asarray(
            column([_radius_of(s, t, targets) for s, t in used], float), dtype=np.float64
        ),
        spindle_on=np.asarray(column([s.spindle_speed > 0 for s, _ in used], bool), dtype=bool),
        sweep=sweep,
        start_radius=start_radius,
        end_radius=end_radius,
        start_angle=np.where(arc, np.arctan2(first[:, 1], first[:, 0]), 0.0),
        planar=planar,
        length=length,
        station=np.concatenate([[0.0], np.cumsum(known)]),
    )


def spread(counts: IntArray) -> tuple[IntArray, IntArray]:
    """Return for ragged rows (owner, position): `counts[i]` entries i, numbered from 0."""
    owner = np.repeat(np.arange(len(counts)), counts)
    first = np.cumsum(counts) - counts
    return owner, np.arange(len(owner)) - np.repeat(first, counts)
