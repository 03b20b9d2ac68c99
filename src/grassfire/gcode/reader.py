"""The reader: blocks into modal state and moves."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..toolpath import FloatArray, MoveKind, Program, Role, Section, Toolpath, ToolpathBuilder
from .codes import (
    AXES,
    CYCLES,
    GROUP,
    MACHINE_WITHOUT_EFFECT,
    MOTIONS,
    REFUSED_CODES,
    SUBPROGRAMS,
    WCS,
    WITHOUT_EFFECT,
    WORD_LETTERS,
    canonical,
)

RADIUS_MISMATCH: Final = 0.005
"""Difference of an arc's radii at its ends that is always accepted, mm (grbl's rule)."""

RADIUS_MISMATCH_RELATIVE: Final = 0.001
"""Difference that is accepted as a fraction of the radius (grbl's rule)."""

PECK_CLEARANCE: Final = 0.254
"""Distance above the last depth at which a peck starts to feed again, mm (LinuxCNC's G73, G83)."""

_TOKEN = re.compile(r"([A-Z])[ \t]*([-+]?(?:\d+\.?\d*|\.\d+))|([^ \t])")
_MARKER = re.compile(
    r"operation\s+(\d+)(?::\s*(.*?))?,\s*tool\s+(\d+)(?:\s+D([\d.]+))?\s*$", re.IGNORECASE
)
_TOOL_NOTE = re.compile(r"\bT(?:ool\s*)?(\d+)\s+D\s*=?\s*(\d+\.?\d*|\.\d+)", re.IGNORECASE)
_PROGRAM_NUMBER = re.compile(r"O\s*\d+\s*$")

Words = dict[str, float]


@dataclass
class _State:
    """Modal state of the controller."""

    motion: str | None = None  # "0" to "3", or a cycle
    scale: float = 1.0
    absolute: bool = True
    centre_absolute: bool = False
    plane: str = "17"
    feed: float = math.nan
    return_to_initial: bool = True
    wcs: str = "G54"
    spindle_speed: float = 0.0
    spindle_on: bool = False
    tool: int = 0
    chosen_tool: int | None = None
    coolant: str = "off"
    operation: int = -1
    name: str = ""
    cycle: Words = field(default_factory=dict)

    @property
    def turning(self) -> float:
        """Speed at which the spindle turns, 1/min: 0 without M3 or M4, after M5, without S."""
        return self.spindle_speed if self.spindle_on else 0.0


class Reader:
    """The state behind the line that is read, and the moves so far."""

    def __init__(self, source: str | None, block_delete: bool) -> None:
        self.source = source
        self.block_delete = block_delete
        self.line = 0
        self.state = _State()
        self.builder = ToolpathBuilder()
        self.sections: list[Section] = []
        self.diameters: dict[int, float] = {}
        self.findings: dict[str, str] = {}
        # Of the section that is read: coolant that was on at any time, and the speed at which the
        # spindle turns where it feeds, None as long as it does not; then that of its rapids counts.
        self.coolant = "off"
        self.spindle: float | None = None
        self.idle = 0.0
        self.ended = False
        self.percent_signs = 0

    def read(self, text: str) -> Program:
        """All lines; see `read_program`."""
        tokens_of = _TOKEN.findall
        for self.line, raw in enumerate(text.removeprefix("\ufeff").split("\n"), 1):
            if self.ended:
                break
            code = raw.strip().upper()
            if "(" in code or ";" in code:
                code = self._without_comments(raw)
            if not code:
                continue
            if code[0] in "%/O" or "#" in code or "[" in code:
                code = self._special(code)
            self._block(tokens_of(code))
        self._close_section()
        sections = tuple(
            section
            if section.tool_diameter == section.tool_diameter
            else replace(section, tool_diameter=self.diameters.get(section.tool_number, math.nan))
            for section in self.sections
        )
        name = PurePath(self.source).stem if self.source else ""
        return Program(name, sections, self.state.wcs, tuple(self.findings.values()))

    # Lines

    def _error(self, message: str, *, line: int = 0, remedy: str | None = None) -> InputError:
        return InputError(
            message, source=self.source, place=f"line {line or self.line}", remedy=remedy
        )

    def _finding(self, kind: str, message: str) -> None:
        """Note the first of each kind."""
        self.findings.setdefault(kind, f"line {self.line}: {message}")

    def _without_comments(self, raw: str) -> str:
        """Code of a line; its comments are looked at for markers and tools."""
        code, rest = "", raw
        while rest:
            opening = re.search(r"[(;]", rest)
            if not opening:
                code += rest
                break
            code += rest[: opening.start()]
            if opening.group() == ";":
                self._comment(rest[opening.end() :])
                break
            end = rest.find(")", opening.end())
            if end < 0:
                raise self._error("a comment is not closed")
            self._comment(rest[opening.end() : end])
            code += " "
            rest = rest[end + 1 :]
        return code.strip().upper()

    def _comment(self, text: str) -> None:
        for number, diameter in _TOOL_NOTE.findall(text):
            self.diameters[int(number)] = float(diameter)
        found = _MARKER.match(text.strip())
        if found:
            self._close_section()
            self.state.operation = int(found[1]) - 1
            self.state.name = (found[2] or "").strip()
            # Where there is no M6, the marker is what tells the tool.
            self.state.tool = int(found[3])

    def _special(self, code: str) -> str:
        """Lines that begin with %, / or O, and those with variables; returns the code to read."""
        if code[0] == "%":
            self.percent_signs += 1
            self.ended = self.percent_signs > 1
            return ""
        if code[0] == "/":
            if self.block_delete:
                self._finding("block delete", "blocks that begin with / are skipped")
                return ""
            code = code[1:].strip()
        if code.startswith("O"):
            if _PROGRAM_NUMBER.match(code):
                return ""
            raise self._error(
                f"subprograms and control flow are not read: {code[:40]}",
                remedy="expand the program before",
            )
        if "#" in code or "[" in code:
            raise self._error(
                f"variables and expressions are not read: {code[:40]}",
                remedy="expand the program before",
            )
        return code

    def _block(self, tokens: list[tuple[str, str, str]]) -> None:
        """One block: words into the modal state, then the motion."""
        codes: list[str] = []
        machine: list[str] = []
        words: Words = {}
        for letter, number, junk in tokens:
            if letter == "G":
                codes.append(number)
            elif letter == "M":
                machine.append(number)
            elif junk:
                raise self._error(f"{junk!r} is not part of a word")
            elif letter in words:
                raise self._error(f"word {letter} is written twice")
            elif letter not in WORD_LETTERS:
                raise self._error(f"unknown word {letter}{number}")
            else:
                words[letter] = float(number)
        state = self.state
        moves = True
        if codes:
            if len(codes) == 1 and codes[0] in MOTIONS:
                state.motion = codes[0][-1]
            else:
                moves = self._codes([canonical(code) for code in codes], words)
        if "F" in words:
            state.feed = words["F"] * state.scale
        if machine or "S" in words or "T" in words:
            self._machine([canonical(code) for code in machine], words)
        if moves and ("X" in words or "Y" in words or "Z" in words or self._moves_in_place(words)):
            self._motion(words)
        if machine:
            self._stops([canonical(code) for code in machine])

    def _moves_in_place(self, words: Words) -> bool:
        """Full circles by centre alone need no axis word."""
        return self.state.motion in ("2", "3") and ("I" in words or "J" in words)

    # Modal codes

    def _codes(self, codes: list[str], words: Words) -> bool:
        """Preparatory codes of one block; returns whether its axis words are a motion."""
        groups = [GROUP[code] for code in codes if code in GROUP]
        if len(groups) != len(set(groups)):
            raise self._error("two codes of one modal group: " + " ".join(f"G{c}" for c in codes))
        state = self.state
        moves = True
        for code in codes:
            if code in MOTIONS or code in CYCLES:
                state.motion = code
                state.cycle = {}
            elif code in ("20", "21"):
                state.scale = 25.4 if code == "20" else 1.0
            elif code in ("90", "91"):
                state.absolute = code == "90"
            elif code in ("90.1", "91.1"):
                state.centre_absolute = code == "90.1"
            elif code in ("17", "18", "19"):
                state.plane = code
            elif code in ("98", "99"):
                state.return_to_initial = code == "98"
            elif code == "80":
                state.motion = None
            elif code in WCS:
                self._coordinate_system(f"G{code}")
            elif code not in WITHOUT_EFFECT and code not in ("4", "28", "30", "43.1", "53"):
                self._refuse(code)
        # These use the axis words for themselves, after the modal codes of the block.
        if "4" in codes:
            moves = False
        if "43.1" in codes:
            self._lose("Z")
            moves = False
        if "28" in codes or "30" in codes:
            self._home(words)
            moves = False
        if "53" in codes:
            self._machine_coordinates(words)
            moves = False
        return moves

    def _refuse(self, code: str) -> None:
        if code in REFUSED_CODES:
            raise self._error(f"G{code} is not read: {REFUSED_CODES[code]}")
        raise self._error(f"unknown code G{code}")

    def _coordinate_system(self, wcs: str) -> None:
        if wcs != self.state.wcs and (len(self.builder) or self.sections):
            self._finding("wcs", f"{wcs} follows moves in {self.state.wcs}; both are read alike")
            self._lose(AXES)
        self.state.wcs = wcs

    def _without(self, axes: str) -> tuple[float, float, float]:
        x, y, z = (
            math.nan if axis in axes else value
            for axis, value in zip(AXES, self.builder.position, strict=True)
        )
        return x, y, z

    def _lose(self, axes: str) -> None:
        """Without a move, the named axes are not known any more: a new section starts."""
        position = self._without(axes)
        self._close_section()
        self.builder = ToolpathBuilder(position)

    def _home(self, words: Words) -> None:
        """G28, G30: over the point that the words give, to a place that the text does not tell."""
        named = "".join(axis for axis in AXES if axis in words)
        known = not any(
            math.isnan(value)
            for axis, value in zip(AXES, self.builder.position, strict=True)
            if axis in named
        )
        if named and (self.state.absolute or known):
            self._rapid(self._target(words))
        self._rapid(self._without(named or AXES))

    def _machine_coordinates(self, words: Words) -> None:
        if self.state.motion not in ("0", "1"):
            raise self._error("G53 needs G0 or G1")
        self._rapid(self._without("".join(axis for axis in AXES if axis in words)))

    def _machine(self, codes: list[str], words: Words) -> None:
        """Tool, spindle and coolant, which act before the motion of their block."""
        state = self.state
        if "S" in words:
            state.spindle_speed = words["S"]
        if "T" in words:
            state.chosen_tool = int(words["T"])
        for code in codes:
            if code == "6":
                self._lose(AXES)
                state.tool = state.chosen_tool if state.chosen_tool is not None else state.tool
            elif code in ("3", "4"):
                state.spindle_on = True
            elif code == "61":
                self._close_section()
                state.tool = int(words.get("Q", state.tool))
            elif code in SUBPROGRAMS:
                raise self._error(
                    f"subprograms are not read: M{code}", remedy="expand the program before"
                )
            elif code not in MACHINE_WITHOUT_EFFECT and code not in ("2", "30", "99"):
                raise self._error(f"unknown code M{code}")
            if code in ("7", "8"):
                state.coolant = self.coolant = "mist" if code == "7" else "flood"

    def _stops(self, codes: list[str]) -> None:
        """What acts after the motion of its block."""
        for code in codes:
            if code == "5":
                self.state.spindle_on = False
            elif code == "9":
                self.state.coolant = "off"
            elif code in ("2", "30", "99"):
                self.ended = True

    # Motions

    def _target(self, words: Words) -> tuple[float, float, float]:
        """Where the axis words lead from the present position, mm."""
        state, position = self.state, self.builder.position
        scale, base = state.scale, (0.0, 0.0, 0.0) if state.absolute else position
        x = base[0] + words["X"] * scale if "X" in words else position[0]
        y = base[1] + words["Y"] * scale if "Y" in words else position[1]
        z = base[2] + words["Z"] * scale if "Z" in words else position[2]
        if not state.absolute:
            for axis, value in zip(AXES, (x, y, z), strict=True):
                if axis in words and math.isnan(value):
                    raise self._error(f"a relative move of {axis} from an unknown position")
        return x, y, z

    def _rapid(self, target: tuple[float, float, float]) -> None:
        self.idle = self.state.turning
        # repr-equal positions, NaN included, are no move.
        for old, new in zip(self.builder.position, target, strict=True):
            if old != new and not (math.isnan(old) and math.isnan(new)):
                self.builder.rapid(*target, line=self.line)
                return

    def _motion(self, words: Words) -> None:
        motion = self.state.motion
        if motion == "0":
            self._rapid(self._target(words))
        elif motion is None:
            raise self._error("axis words without a motion code")
        elif motion in CYCLES:
            self._cycle(words)
        else:
            self._feed_motion(motion, words)

    def _begin_feed(self) -> None:
        """Before a feed move: where the spindle turns otherwise than before, a section begins."""
        turning = self.state.turning
        if self.spindle is not None and turning != self.spindle:
            self._close_section()
        self.spindle = turning
        if not turning > 0:
            self._finding("spindle", "the tool feeds while the spindle stands")

    def _feed_motion(self, motion: str, words: Words) -> None:
        state = self.state
        if not state.feed > 0:
            raise self._error(f"G{motion} without a feed", remedy="write F before")
        self._begin_feed()
        x, y, z = self.builder.position
        target = self._target(words)
        if x != x or y != y or z != z:
            unknown = [
                axis
                for axis, value in zip(AXES, self.builder.position, strict=True)
                if math.isnan(value)
            ]
            raise self._error(
                f"G{motion} starts at an unknown position of {', '.join(unknown)}",
                remedy="write a G0 to a position in all axes before",
            )
        if motion == "1":
            if target != (x, y, z):
                self.builder.line(*target, state.feed, Role.CUT, self.line)
        else:
            self._arc(words, motion == "3", target)

    def _arc(self, words: Words, counter: bool, target: tuple[float, float, float]) -> None:
        """An arc, or as many whole turns before it as P asks for."""
        if self.state.plane != "17":
            raise self._error(
                f"arcs in the plane G{self.state.plane} are not read",
                remedy="write arcs in the XY plane (G17)",
            )
        centre = self._centre(words, counter, target)
        turns = words.get("P", 1.0)
        if turns != int(turns) or turns < 1:
            raise self._error(f"P{turns:g} is no count of turns")
        if turns > 1:
            self._whole_turns(int(turns) - 1, centre, counter, target)
        self.builder.arc(*target, centre, counter, self.state.feed, Role.CUT, self.line)

    def _centre(
        self, words: Words, counter: bool, target: tuple[float, float, float]
    ) -> tuple[float, float]:
        """Centre by I and J or by R."""
        state = self.state
        x, y, _ = self.builder.position
        if "K" in words:
            raise self._error("K has no meaning for an arc in the XY plane")
        if "R" not in words:
            if "I" not in words and "J" not in words:
                raise self._error("an arc without I, J or R")
            if state.centre_absolute:
                if "I" not in words or "J" not in words:
                    raise self._error("an absolute centre (G90.1) needs both I and J")
                return words["I"] * state.scale, words["J"] * state.scale
            return x + words.get("I", 0.0) * state.scale, y + words.get("J", 0.0) * state.scale
        if "I" in words or "J" in words:
            raise self._error("an arc with both R and a centre")
        radius = words["R"] * state.scale
        across, up = target[0] - x, target[1] - y
        chord = math.hypot(across, up)
        if chord == 0:
            raise self._error("a full circle cannot be given by R")
        short = chord / 2 - abs(radius)
        if short > max(RADIUS_MISMATCH, RADIUS_MISMATCH_RELATIVE * abs(radius)):
            raise self._error(f"R{words['R']:g} is too small for a chord of {chord:.4f} mm")
        height = math.sqrt(max(radius * radius - chord * chord / 4, 0.0))
        side = (1.0 if counter else -1.0) * math.copysign(1.0, radius) * height / chord
        return (x + target[0]) / 2 - side * up, (y + target[1]) / 2 + side * across

    def _whole_turns(
        self,
        count: int,
        centre: tuple[float, float],
        counter: bool,
        target: tuple[float, float, float],
    ) -> None:
        x, y, z = self.builder.position
        begin = math.atan2(y - centre[1], x - centre[0])
        end = math.atan2(target[1] - centre[1], target[0] - centre[0])
        turn = math.fmod((end - begin) * (1 if counter else -1) + 4 * math.pi, 2 * math.pi)
        if turn == 0 or (x, y) == target[:2]:
            turn = 2 * math.pi
        pitch = (target[2] - z) * 2 * math.pi / (turn + 2 * math.pi * count)
        for index in range(count):
            self.builder.arc(
                x, y, z + (index + 1) * pitch, centre, counter, self.state.feed, Role.CUT, self.line
            )

    # Drilling cycles

    def _cycle(self, words: Words) -> None:
        """G73, G81, G82, G83 as the moves that they stand for; Z, R and Q hold until changed."""
        state = self.state
        if state.plane != "17":
            raise self._error(f"cycles in the plane G{state.plane} are not read")
        if not state.feed > 0:
            raise self._error(f"G{state.motion} without a feed", remedy="write F before")
        state.cycle.update({letter: words[letter] for letter in "ZRQ" if letter in words})
        missing = [letter for letter in "ZR" if letter not in state.cycle]
        if missing:
            raise self._error(f"G{state.motion} without {' and '.join(missing)}")
        initial = self.builder.position[2]
        if math.isnan(initial):
            raise self._error(f"G{state.motion} starts at an unknown position of Z")
        clear = state.cycle["R"] * state.scale + (0.0 if state.absolute else initial)
        bottom = state.cycle["Z"] * state.scale + (0.0 if state.absolute else clear)
        if bottom > clear:
            raise self._error(f"G{state.motion} ends above R")
        places = {letter: words[letter] for letter in "XY" if letter in words}
        # Repeating a hole in place cuts nothing; relative words step on.
        repeats = max(0, int(words.get("L", 1))) if not state.absolute else 1
        for _ in range(repeats):
            self._hole(places, clear, bottom, max(initial, clear))

    def _hole(self, places: Words, clear: float, bottom: float, initial: float) -> None:
        state = self.state
        self._begin_feed()
        x, y, z = self.builder.position
        if z < clear:
            self._rapid((x, y, clear))
        x, y, _ = self._target(places)
        if math.isnan(x) or math.isnan(y):
            raise self._error(f"G{state.motion} at an unknown position of X or Y")
        self._rapid((x, y, self.builder.position[2]))
        self._rapid((x, y, clear))
        peck = math.inf
        if state.motion in ("73", "83"):
            peck = state.cycle.get("Q", 0.0) * state.scale
            if not peck > 0:
                raise self._error(f"G{state.motion} without a positive Q")
        depth = clear
        while depth > bottom:
            if depth < clear and state.motion == "83":
                self._rapid((x, y, clear))
            if depth < clear:
                self._rapid((x, y, min(clear, depth + PECK_CLEARANCE)))
            depth = max(bottom, depth - peck)
            self.builder.line(x, y, depth, state.feed, Role.ENTRY, self.line)
        self._rapid((x, y, initial if state.return_to_initial else clear))

    # Sections

    def _close_section(self) -> None:
        """Freeze the moves so far; the next section starts where they end."""
        builder, state = self.builder, self.state
        spindle = self.idle if self.spindle is None else self.spindle
        self.spindle = None
        if not len(builder):
            self.coolant = state.coolant
            return
        toolpath = self._checked(builder.build())
        self.sections.append(
            Section(
                toolpath=toolpath,
                # Without any M6, T alone tells the tool.
                tool_number=state.tool or state.chosen_tool or 0,
                tool_diameter=self.diameters.get(state.tool, math.nan),
                spindle_speed=spindle,
                operation=state.operation,
                name=state.name,
                coolant=self.coolant,
            )
        )
        self.coolant = state.coolant
        x, y, z = builder.position
        self.builder = ToolpathBuilder((x, y, z))

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
        return replace(toolpath, role=_roles(toolpath, begin))

    def _first_arc(
        self, toolpath: Toolpath, wrong: NDArray[np.bool_], message: Callable[[int], str]
    ) -> None:
        if wrong.any():
            index = int(np.flatnonzero(wrong)[0])
            raise self._error(message(index), line=int(toolpath.line[index]))


def _roles(toolpath: Toolpath, begin: FloatArray) -> NDArray[np.uint8]:
    """Role of each move, as far as geometry tells it."""
    rise = toolpath.end[:, 2] - begin[:, 2]
    role = np.where(rise < 0, Role.ENTRY, np.where(rise > 0, Role.LINK, Role.CUT))
    return np.where(toolpath.kind == MoveKind.RAPID, Role.RAPID, role).astype(np.uint8)
