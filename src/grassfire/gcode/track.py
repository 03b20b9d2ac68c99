"""What every dialect leaves behind: the tool's moves, cut into sections, and what was noticed."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import PurePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..toolpath import MoveKind, Program, Section, Toolpath
from .arcs import centres_by_radius
from .moves import UNKNOWN, Moves, Position
from .roles import roles_of

AXES: Final = "XYZ"

RADIUS_MISMATCH: Final = 0.005
"""Difference of an arc's radii at its ends that is always accepted, mm (grbl's rule)."""

RADIUS_MISMATCH_RELATIVE: Final = 0.001
"""Difference that is accepted as a fraction of the radius (grbl's rule)."""

_WRITE_CENTRE: Final = "write the centre of the arc"
_DECIMALS: Final = "write arcs with more decimals, their centres from the rounded start"

_MARKER = re.compile(
    r"operation\s+([0-9]+)(?::\s*(.*?))?,\s*tool\s+([0-9]+)(?:\s+D([0-9]+\.?[0-9]*))?\s*$",
    re.IGNORECASE,
)
_TOOL_NOTE = re.compile(
    r"\b(?:T|Tool\s*)([0-9]+)\s+D\s*=?\s*([0-9]+\.?[0-9]*|\.[0-9]+)", re.IGNORECASE
)


class Track:
    """The tool and the spindle as the text has set them so far, and the moves behind them."""

    def __init__(self, source: str | None) -> None:
        self.source = source
        self.line = 0
        self.moves = Moves()
        self.sections: list[Section] = []
        self.wcs = "G54"
        self.tool = 0
        self.chosen_tool: int | None = None
        self.operation = -1
        self.name = ""
        self.scale = 1.0
        self.spindle_speed = 0.0
        self.spindle_on = False
        self.coolant = "off"
        self.placed = False  # whether there was a feed move from a known position
        self._arrivals: list[tuple[int, float]] = []  # line and z of feed moves from nowhere
        self._diameters: dict[int, float] = {}  # mm, of markers
        self._noted: dict[int, float] = {}  # in the program's unit, of other comments
        self._findings: dict[str, str] = {}
        # Of the section that is read: coolant that was on at any time, and the speed at which the
        # spindle turns where it feeds, None as long as it does not; then that of its rapids counts.
        self._section_coolant = "off"
        self._section_spindle: float | None = None
        self._idle = 0.0

    @property
    def position(self) -> Position:
        """(x, y, z), mm; NaN where an axis is not known."""
        return self.moves.position

    @property
    def turning(self) -> float:
        """Speed at which the spindle turns, 1/min: 0 without M3 or M4, after M5, without S."""
        return self.spindle_speed if self.spindle_on else 0.0

    @property
    def feeds_alike(self) -> bool:
        """Whether feed moves are being made, and the next one is made with the same spindle."""
        return self._section_spindle == self.turning

    @property
    def untouched(self) -> bool:
        """Whether there is no move yet."""
        return not len(self.moves) and not self.sections

    # What is told

    def error(self, message: str, *, line: int = 0, remedy: str | None = None) -> InputError:
        """An error that names the file and the line."""
        return InputError(
            message, source=self.source, place=f"line {line or self.line}", remedy=remedy
        )

    def finding(self, kind: str, message: str) -> None:
        """Note the first of each kind."""
        self._findings.setdefault(kind, f"line {self.line}: {message}")

    def comment(self, text: str) -> None:
        """Look for a tool's diameter and for the marker that begins an operation."""
        found = _MARKER.match(text.strip())
        if not found:
            for number, diameter in _TOOL_NOTE.findall(text):
                self._noted[int(number)] = float(diameter)
            return
        self.close_section()
        self.operation = int(found[1]) - 1
        self.name = (found[2] or "").strip()
        # Where there is no M6, the marker is what tells the tool.
        self.tool = int(found[3])
        if found[4]:
            self._diameters[self.tool] = float(found[4])

    # Tool, spindle, coolant

    def change_tool(self) -> None:
        """The tool that was chosen comes into the spindle, somewhere."""
        self.lose(AXES)
        self.tool = self.chosen_tool if self.chosen_tool is not None else self.tool

    def start_coolant(self, kind: str) -> None:
        """Mist or flood."""
        self.coolant = self._section_coolant = kind

    def begin_feed(self) -> None:
        """Before a feed move: where the spindle turns otherwise than before, a section begins."""
        turning = self.turning
        if self._section_spindle is not None and turning != self._section_spindle:
            self.close_section()
        self._section_spindle = turning
        if not turning > 0:
            self.finding("spindle", "the tool feeds while the spindle stands")

    # Moves

    def unknown(self, axes: str = AXES) -> str:
        """Names of those of the axes whose position is not known."""
        return ", ".join(
            axis
            for axis, value in zip(AXES, self.position, strict=True)
            if axis in axes and math.isnan(value)
        )

    def without(self, axes: str) -> Position:
        """The position with NaN for the named axes."""
        x, y, z = (
            UNKNOWN if axis in axes else value
            for axis, value in zip(AXES, self.position, strict=True)
        )
        return x, y, z

    def lose(self, axes: str) -> None:
        """Without a move, the named axes are not known any more: a new section starts."""
        self.stand_at(self.without(axes))

    def stand_at(self, position: Position) -> None:
        """Without a move, the tool stands at `position`: a new section starts."""
        if _same(self.position, position):
            return
        if self.sections and len(self.moves) and self._section_spindle is None:
            self._retract()
        self.close_section()
        self.moves = Moves(position)

    def _retract(self) -> None:
        """Nothing but rapids so far: they are how the section before ended."""
        last = self.sections[-1]
        if not np.array_equal(last.toolpath.end[-1], self.moves.start, equal_nan=True):
            return
        retract = self.moves.build()
        columns = {
            name: np.concatenate([getattr(last.toolpath, name), getattr(retract, name)])
            for name in ("kind", "end", "centre", "feed", "role", "line")
        }
        self.sections[-1] = replace(last, toolpath=replace(last.toolpath, **columns))
        self.moves = Moves(self.position)

    def rapid(self, target: Position) -> None:
        """A rapid, unless the tool is there."""
        self._idle = self.turning
        if not _same(self.position, target):
            self.moves.add(MoveKind.RAPID, target, self.line)

    def arrives(self, target: Position) -> bool:
        """Read a first feed move, from nowhere, as a rapid: first Z alone, then X and Y.

        Its way is not known, so it must lie at the greatest height of the program.
        """
        in_place = math.isnan(target[0]) and math.isnan(target[1])
        if self.placed or math.isnan(target[2]) or (math.isnan(self.position[2]) and not in_place):
            return False
        self.finding("arrival", "feed moves from an unknown position are read as rapids")
        self._arrivals.append((self.line, target[2]))
        self.rapid(target)
        return True

    def _check_arrivals(self) -> None:
        if not self._arrivals:
            return
        highest = max(float(np.nanmax(part.toolpath.end[:, 2])) for part in self.sections)
        for line, height in self._arrivals:
            if height < highest:
                raise self.error(
                    f"G1 starts at an unknown position and ends at z {height:g}, which is not the "
                    f"greatest height of the program ({highest:g})",
                    line=line,
                    remedy="write a G0 to a position in all axes before",
                )

    def feed_line(self, target: Position, feed: float) -> None:
        """A straight feed move, unless the tool is there."""
        if target != self.position:
            self.moves.add(MoveKind.LINE, target, self.line, feed)

    def feed_arc(
        self, target: Position, centre: tuple[float, float], counter: bool, feed: float
    ) -> None:
        """An arc in the XY plane; a full turn where it ends above or below its start."""
        kind = MoveKind.ARC_CCW if counter else MoveKind.ARC_CW
        self.moves.add(kind, target, self.line, feed, centre)

    def feed_turns(
        self,
        target: Position,
        centre: tuple[float, float],
        counter: bool,
        feed: float,
        whole: int,
        sweep: float,
    ) -> None:
        """As many whole turns, then an arc of `sweep` radians: z changes evenly along them."""
        x, y, z = self.position
        pitch = (target[2] - z) * 2 * math.pi / (abs(sweep) + 2 * math.pi * whole)
        for index in range(whole):
            self.feed_arc((x, y, z + (index + 1) * pitch), centre, counter, feed)
        self.feed_arc(target, centre, counter, feed)

    def centre_by_radius(
        self, radius: float, counter: bool, begin: tuple[float, float], end: tuple[float, float]
    ) -> tuple[float, float]:
        """Centre of an arc that is given by its radius, mm, negative beyond half a turn."""
        chord = math.dist(begin, end)
        if chord == 0:
            raise self.error("a full circle cannot be given by its radius", remedy=_WRITE_CENTRE)
        short = chord / 2 - abs(radius)
        if short > max(RADIUS_MISMATCH, RADIUS_MISMATCH_RELATIVE * abs(radius)):
            raise self.error(
                f"a radius of {abs(radius):g} mm is too small for a chord of {chord:.4f} mm",
                remedy=_WRITE_CENTRE,
            )
        counter_sign = np.array([1.0 if counter else -1.0])
        centre = centres_by_radius(
            np.array([begin]), np.array([end]), np.array([radius]), counter_sign
        )
        x, y = centre[0].tolist()
        return x, y

    def check_radii(
        self, begin: tuple[float, float], end: tuple[float, float], centre: tuple[float, float]
    ) -> None:
        """Refuse an arc whose radii at both ends are too different."""
        radius = math.dist(begin, centre)
        mismatch = abs(radius - math.dist(end, centre))
        if radius == 0:
            raise self.error("an arc of radius 0", remedy=_WRITE_CENTRE)
        if mismatch > max(RADIUS_MISMATCH, RADIUS_MISMATCH_RELATIVE * radius):
            raise self.error(f"the radii of an arc differ by {mismatch:.4f} mm", remedy=_DECIMALS)

    # Sections

    def close_section(self) -> None:
        """Freeze the moves so far; the next section starts where they end."""
        spindle = self._idle if self._section_spindle is None else self._section_spindle
        self._section_spindle = None
        if not len(self.moves):
            self._section_coolant = self.coolant
            return
        # Without any M6, T alone tells the tool.
        tool = self.tool or self.chosen_tool or 0
        self.sections.append(
            Section(
                toolpath=self._checked(self.moves.build()),
                tool_number=tool,
                tool_diameter=self._diameter(tool),
                spindle_speed=spindle,
                operation=self.operation,
                name=self.name,
                coolant=self._section_coolant,
            )
        )
        self._section_coolant = self.coolant
        self.moves = Moves(self.position)

    def program(self) -> Program:
        """All sections; diameters that were told late hold for sections that lack one."""
        self.close_section()
        self._check_arrivals()
        sections = tuple(
            replace(section, tool_diameter=self._diameter(section.tool_number))
            if math.isnan(section.tool_diameter)
            else section
            for section in self.sections
        )
        name = PurePath(self.source).stem if self.source else ""
        return Program(name, sections, self.wcs, tuple(self._findings.values()))

    def _diameter(self, tool: int) -> float:
        """In mm. Foreign comments tell it in the program's unit, often before the code for that."""
        return self._diameters.get(tool, self._noted.get(tool, math.nan) * self.scale)

    def _checked(self, toolpath: Toolpath) -> Toolpath:
        """Both radii of every arc compared, roles told by geometry."""
        begin, arc = toolpath.begin, toolpath.is_arc
        start_radius = np.hypot(*(begin[:, :2] - toolpath.centre).T)
        mismatch = np.abs(start_radius - np.hypot(*(toolpath.end[:, :2] - toolpath.centre).T))
        self._first_arc(toolpath, arc & (start_radius == 0), lambda _: "an arc of radius 0")
        self._first_arc(
            toolpath,
            arc
            & (mismatch > RADIUS_MISMATCH)
            & (mismatch > RADIUS_MISMATCH_RELATIVE * start_radius),
            lambda index: f"the radii of an arc differ by {mismatch[index]:.4f} mm",
        )
        return replace(toolpath, role=roles_of(toolpath))

    def _first_arc(
        self, toolpath: Toolpath, wrong: NDArray[np.bool_], message: Callable[[int], str]
    ) -> None:
        if wrong.any():
            index = int(np.flatnonzero(wrong)[0])
            raise self.error(
                message(index),
                line=int(toolpath.line[index]),
                remedy=_DECIMALS,
            )


def _same(first: Position, second: Position) -> bool:
    """Whether two positions are the same, unknown axes included."""
    return all(a == b or (a != a and b != b) for a, b in zip(first, second, strict=True))
