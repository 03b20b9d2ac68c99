"""The reader of Heidenhain's plain language."""

from __future__ import annotations

import math
import re
from typing import Final

from ..toolpath import Program
from .arcs import sweep_of
from .moves import Position
from .track import AXES, Track
from .words import NUMBER

_PROGRAM = re.compile(r"^[ \t]*(?:[0-9]+[ \t]+)?BEGIN[ \t]+PGM\b", re.IGNORECASE | re.MULTILINE)
_BEGIN = re.compile(r"BEGIN PGM (.*?)\s*(MM|INCH)$")
_NUMBERED = re.compile(r"^[ \t]*[0-9]+(?:[ \t]+|$)")
_TOOL_CALL = re.compile(rf"TOOL CALL (?:([0-9]+)|(\".*\"))?((?: ?[A-Z]+ ?(?:{NUMBER}|MAX)?)*)$")
_FEED_WORD: Final = rf"F ?(MAX|AUTO|{NUMBER})"
_WORD = re.compile(
    rf" ?(?:{_FEED_WORD}|(DR[+-]|R[0LR]|M140 MB MAX)|(IPA|IPR|PA|PR|I?[XYZ]|[RM]) ?({NUMBER}))"
    r"(?![0-9.])"
)
_MOTION = re.compile(r"(CTP|CC|CR|CP|CT|LP|L|C)(?=$|[ +-]|I?[XYZ] ?[-+0-9.]|I?P[AR]|DR|R|F|M)")

# Cycles that leave the path as it is: a dwell, the tolerance of blending.
_CYCLES_WITHOUT_EFFECT: Final = frozenset({"9", "32"})
_CYCLES_OF_OFFSETS: Final = frozenset({"7", "8", "10", "11", "26"})
_WITHOUT_EFFECT = re.compile(
    r"(?:BLK FORM|TOOL DEF|PLANE RESET|FUNCTION RESET|FUNCTION MODE MILL|\*|STOP|"
    r"LBL 0$|QDEF|PRESET DISPLAY)"
)
_MACHINE_WITHOUT_EFFECT: Final = frozenset(
    {0, 1, 3, 4, 5, 6, 7, 8, 9, 13, 14, 90, 107, 108, 109, 110, 111, 120, 124, 127, 129, 145}
)
_EXPAND: Final = "let the CAM system write lines and arcs"


def is_heidenhain(text: str) -> bool:
    """Whether a text is in plain language: its first block begins a program."""
    return _PROGRAM.search(text[:4000]) is not None


class PlainLanguageReader:
    """The state behind the block that is read, and the moves so far."""

    def __init__(self, source: str | None) -> None:
        self.track = Track(source)
        self.feed = math.nan
        self.tool_feed = math.nan
        self.pole: list[float] = [math.nan, math.nan]
        self.ended = False

    def read(self, text: str) -> Program:
        """All blocks; see `grassfire.gcode.read_program`."""
        for number, raw in enumerate(text.removeprefix("\ufeff").split("\n"), 1):
            if self.ended:
                break
            self.track.line = number
            code, separator, comment = _NUMBERED.sub("", raw.strip(), count=1).partition(";")
            if separator:
                self.track.comment(comment)
            code = " ".join(code.upper().split())
            if code:
                self._block(code)
        return self.track.program()

    def _block(self, code: str) -> None:
        found = _MOTION.match(code)
        if found:
            self._path(found[1], code[found.end() :])
        elif code.startswith("BEGIN PGM"):
            self._begin(code)
        elif code.startswith("END PGM"):
            self.ended = True
        elif code.startswith("TOOL CALL"):
            self._tool_call(code)
        elif code.startswith("CYCL DEF"):
            self._cycle(code)
        elif re.match(r"M ?[0-9]", code):
            self._machine_block(code)
        elif not _WITHOUT_EFFECT.match(code):
            raise self.track.error(f"not read: {code[:40]}", remedy=_EXPAND)

    def _begin(self, code: str) -> None:
        found = _BEGIN.match(code)
        if not found:
            raise self.track.error("BEGIN PGM without MM or INCH", remedy="write the unit")
        self.track.scale = 25.4 if found[2] == "INCH" else 1.0

    def _cycle(self, code: str) -> None:
        """Definitions of cycles: those that change the path are refused unless they say nothing."""
        found = re.match(r"CYCL DEF ([0-9]+)(?:\.([0-9]+))?(.*)$", code)
        if found and found[1] in _CYCLES_WITHOUT_EFFECT:
            return
        if found and found[1] in _CYCLES_OF_OFFSETS:
            if found[2] == "0" or all(
                float(value) == (1.0 if found[1] in ("11", "26") else 0.0)
                for value in re.findall(NUMBER, found[3])
            ):
                return
            raise self.track.error(
                f"an offset, a rotation or a scale is not read: {code[:40]}",
                remedy="write the path where it is to be",
            )
        if found and found[1] == "247":
            self.track.finding("preset", "CYCL DEF 247 chooses the origin of the program")
            if not self.track.untouched:
                self.track.lose(AXES)
            return
        raise self.track.error(f"a cycle is not read: {code[:40]}", remedy=_EXPAND)

    # Tool, spindle, coolant

    def _tool_call(self, code: str) -> None:
        """A change of the tool, or of its speed where no tool is named."""
        track = self.track
        found = _TOOL_CALL.match(code)
        if not found:
            raise track.error(f"not read: {code[:40]}", remedy="write TOOL CALL n Z S")
        if found[2]:
            raise track.error(f"a tool by its name: {found[2]}", remedy="write its number")
        words = dict(re.findall(rf"\b(S|F|DL|DR|DR2|X|Y|Z) ?({NUMBER}|MAX)?", found[3]))
        if words.keys() & {"X", "Y"}:
            raise track.error("a tool along X or Y is not read", remedy="write a tool along Z")
        if found[1] is not None:
            track.chosen_tool = int(found[1])
            track.change_tool()
        if words.get("S"):
            track.spindle_speed = float(words["S"])
        if words.get("F") and words["F"] != "MAX":
            self.tool_feed = self.feed = self._feed_unit * float(words["F"])

    @property
    def _feed_unit(self) -> float:
        """mm/min of one unit of F: in inch programs it counts tenths of an inch a minute."""
        return 1.0 if self.track.scale == 1.0 else self.track.scale / 10

    def _machine_block(self, code: str) -> None:
        if re.match(r"M ?140 MB", code):
            self.track.rapid(self.track.without("Z"))
            return
        codes = re.findall(r"M ?([0-9]+)", code)
        if re.sub(r"M ?[0-9]+", "", code).strip():
            raise self.track.error(f"not read: {code[:40]}", remedy=_EXPAND)
        self._before([int(number) for number in codes])
        self._after([int(number) for number in codes])

    def _before(self, codes: list[int]) -> None:
        """What acts before the motion of its block."""
        for code in codes:
            if code in (3, 4, 13, 14):
                self.track.spindle_on = True
            if code in (7, 8, 13, 14):
                self.track.start_coolant("mist" if code == 7 else "flood")
            if code not in _MACHINE_WITHOUT_EFFECT and code not in (2, 30, 91, 92):
                raise self.track.error(
                    f"M{code} is not read", remedy="take it out if it does not move the tool"
                )

    def _after(self, codes: list[int]) -> None:
        for code in codes:
            if code == 5:
                self.track.spindle_on = False
            elif code == 9:
                self.track.coolant = "off"
            elif code in (2, 30):
                self.ended = True

    # Path

    def _words(self, motion: str, rest: str) -> tuple[dict[str, float], list[int], set[str]]:
        """Values by letter, machine codes, and the words without numbers."""
        values: dict[str, float] = {}
        machine: list[int] = []
        flags: set[str] = set()
        position = 0
        while position < len(rest):
            found = _WORD.match(rest, position)
            if not found:
                raise self.track.error(
                    f"not read in a block {motion}: {rest[position:].strip()[:40]}", remedy=_EXPAND
                )
            position = found.end()
            feed, flag, letter, number = found.groups()
            if feed == "MAX":
                flags.add("FMAX")
            elif feed:
                self.feed = self.tool_feed if feed == "AUTO" else self._feed_unit * float(feed)
            elif flag:
                flags.add(flag)
            elif letter == "M":
                machine.append(int(number))
            elif letter == "R" and motion != "CR":
                raise self.track.error(f"not read in a block {motion}: R{number}")
            elif letter in values:
                raise self.track.error(f"word {letter} is written twice")
            else:
                values[letter] = float(number)
        return values, machine, flags

    def _path(self, motion: str, rest: str) -> None:
        values, machine, flags = self._words(motion, rest)
        track = self.track
        if flags & {"RL", "RR"}:
            raise track.error(
                "radius compensation is not read: the path of the tool's centre is not in the text",
                remedy="let the CAM system write the path of the tool's centre with R0",
            )
        if motion == "CC":
            self._set_pole(values)
            return
        self._before(machine)
        if "M140 MB MAX" in flags:
            track.rapid(track.without("Z"))
        elif {91, 92} & set(machine):
            track.rapid(track.without("".join(a for a in AXES if a in values or f"I{a}" in values)))
        elif motion == "L":
            self._straight(self._target(values), rapid="FMAX" in flags)
        elif motion == "LP":
            self._straight(self._polar(values), rapid="FMAX" in flags)
        elif motion in ("CT", "CTP"):
            raise track.error(f"tangential arcs ({motion}) are not read", remedy="write C or CR")
        else:
            self._arc(motion, values, flags)
        self._after(machine)

    def _target(self, values: dict[str, float]) -> Position:
        target = list(self.track.position)
        for axis, letter in enumerate(AXES):
            if letter in values:
                target[axis] = values[letter] * self.track.scale
            elif f"I{letter}" in values:
                if math.isnan(target[axis]):
                    raise self.track.error(f"a relative move of {letter} from an unknown position")
                target[axis] += values[f"I{letter}"] * self.track.scale
        return target[0], target[1], target[2]

    def _set_pole(self, values: dict[str, float]) -> None:
        """CC: the centre of arcs and the pole of polar words; alone, it is where the tool is."""
        if not values:
            self.pole = list(self.track.position[:2])
        for axis, letter in enumerate("XY"):
            if letter in values:
                self.pole[axis] = values[letter] * self.track.scale
            elif f"I{letter}" in values:
                # Relative to where the tool is.
                self.pole[axis] = (
                    self.track.position[axis] + values[f"I{letter}"] * self.track.scale
                )

    def _known_pole(self) -> tuple[float, float]:
        if any(math.isnan(value) for value in self.pole):
            raise self.track.error("an arc or polar words without a known CC", remedy="write CC")
        return self.pole[0], self.pole[1]

    def _polar(self, values: dict[str, float]) -> Position:
        """LP: radius and angle about the pole; what is not written stays."""
        pole = self._known_pole()
        x, y, _ = self.track.position
        radius = math.hypot(x - pole[0], y - pole[1])
        angle = math.atan2(y - pole[1], x - pole[0])
        radius = values.get("PR", radius / self.track.scale) * self.track.scale
        radius += values.get("IPR", 0.0) * self.track.scale
        angle = math.radians(values["PA"]) if "PA" in values else angle
        angle += math.radians(values.get("IPA", 0.0))
        z = self._target(values)[2]
        return pole[0] + radius * math.cos(angle), pole[1] + radius * math.sin(angle), z

    def _straight(self, target: Position, *, rapid: bool) -> None:
        if rapid:
            self.track.rapid(target)
        elif target != self.track.position:
            self._begin_feed("L")
            self.track.feed_line(target, self.feed)

    def _begin_feed(self, motion: str) -> None:
        track = self.track
        if not self.feed > 0:
            raise track.error(f"{motion} without a feed", remedy="write F before")
        unknown = track.unknown()
        if unknown:
            raise track.error(
                f"{motion} starts at an unknown position of {unknown}",
                remedy="write L with FMAX to a position in all axes before",
            )
        track.begin_feed()

    def _arc(self, motion: str, values: dict[str, float], flags: set[str]) -> None:
        track = self.track
        if "FMAX" in flags:
            raise track.error("an arc as a rapid", remedy="write F")
        if ("DR+" in flags) == ("DR-" in flags):
            raise track.error(f"{motion} without DR+ or DR-", remedy="write the direction")
        counter = "DR+" in flags
        self._begin_feed(motion)
        if motion == "CP":
            self._polar_arc(values, counter)
            return
        target = self._target(values)
        if motion == "C":
            centre = self._known_pole()
        elif "R" in values:
            centre = track.centre_by_radius(
                values["R"] * track.scale, counter, track.position[:2], target[:2]
            )
        else:
            raise track.error("CR without R", remedy="write the radius")
        track.feed_arc(target, centre, counter, self.feed)

    def _polar_arc(self, values: dict[str, float], counter: bool) -> None:
        """CP: an angle about the pole, more than a turn where it is relative."""
        track, pole = self.track, self._known_pole()
        x, y, _ = track.position
        z = self._target(values)[2]
        if "IPA" in values:
            angle = math.radians(values["IPA"])
            if angle == 0 or (angle > 0) != counter:
                raise track.error(
                    f"IPA{values['IPA']:+g} against the direction of the arc",
                    remedy="give IPA and DR the same sign",
                )
        elif "PA" in values:
            to_end = math.radians(values["PA"])
            radius = math.hypot(x - pole[0], y - pole[1])
            end = (pole[0] + radius * math.cos(to_end), pole[1] + radius * math.sin(to_end))
            angle = sweep_of((x, y), end, pole, counter)
        else:
            raise track.error("CP without PA or IPA", remedy="write the angle")
        turn = 2 * math.pi
        whole = max(0, math.ceil(abs(angle) / turn - 1e-9) - 1)
        sweep = angle - math.copysign(turn * whole, angle)
        if abs(abs(sweep) - turn) < 1e-9:
            end = (x, y)
        else:
            across, up, cosine, sine = x - pole[0], y - pole[1], math.cos(sweep), math.sin(sweep)
            end = (pole[0] + cosine * across - sine * up, pole[1] + sine * across + cosine * up)
        track.feed_turns((end[0], end[1], z), pole, counter, self.feed, whole, sweep)
