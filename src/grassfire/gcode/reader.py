"""The reader of RS274/NGC dialects: blocks into modal state and moves."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ..toolpath import MoveKind, Program
from . import plain
from .arcs import chords, sweep_of
from .codes import (
    COORDINATE_SYSTEMS,
    CYCLES,
    ENDS,
    GROUP,
    MACHINE_WITH_OWN_WORDS,
    MACHINE_WITHOUT_EFFECT,
    MOTIONS,
    PLANES,
    REFUSED_CODES,
    ROTARY,
    SIEMENS_UNITS,
    SIEMENS_WITHOUT_EFFECT,
    SUBPROGRAMS,
    UNITS,
    WITHOUT_EFFECT,
    WORD_LETTERS,
    canonical,
)
from .cycles import hole
from .frame import Frame, Words
from .moves import UNKNOWN, Position
from .track import AXES, Track
from .words import (
    PROGRAM_NUMBER,
    TOKEN,
    is_siemens,
    siemens_words,
    text_command,
    without_comments,
)

PLANE_CHORD: Final = 0.0005
"""How far the chords that arcs outside the XY plane are read as may be from the arc, mm."""

_EXPAND: Final = "expand the program before"

# First and second axis of each plane, seen from the third, and the words of the centre.
_PLANE_AXES: Final = {
    "17": ((0, 1, 2), "IJ"),
    "18": ((2, 0, 1), "KI"),
    "19": ((1, 2, 0), "JK"),
}


@dataclass
class _State:
    """Modal state of the controller."""

    motion: str | None = None  # "0" to "3", or a cycle
    absolute: bool = True
    centre_absolute: bool = False
    plane: str = "17"
    feed_mode: str = "94"
    feed: float = UNKNOWN  # mm/min, mm per turn, or 1/min by the mode
    return_to_initial: bool = True
    cycle: Words = field(default_factory=dict)
    initial_height: float = UNKNOWN  # z before the first hole of a series, mm


class Reader:
    """The state behind the line that is read, and the moves so far."""

    def __init__(self, source: str | None, block_delete: bool) -> None:
        self.block_delete = block_delete
        self.state = _State()
        self.track = Track(source)
        self.frame = Frame(self.track)
        self.ended = False
        self.percent_signs = 0
        self.speaks_siemens = (source or "").lower().endswith((".mpf", ".spf"))
        # Of the block that is read.
        self.siemens = False
        self.own_mode: dict[str, bool] = {}

    def read(self, text: str) -> Program:
        """All lines; see `read_program`."""
        lines = text.removeprefix("\ufeff").split("\n")
        index = 0
        while index < len(lines) and not self.ended:
            run = plain.run_length(lines, index) if self._reads_runs() else 0
            stop = index + max(run, 1)
            if run < plain.SHORTEST or not self._run(lines[index:stop], index + 1):
                for number, raw in enumerate(lines[index:stop], index + 1):
                    self.track.line = number
                    self._line(raw)
            index = stop
        return self.track.program()

    def _reads_runs(self) -> bool:
        """Whether the state is so plain that many blocks can be read at once."""
        state = self.state
        return (
            self.track.feeds_alike
            and state.motion in MOTIONS
            and state.plane == "17"
            and state.feed_mode == "94"
            and not self.frame.blind
            and not self.track.unknown()
        )

    def _run(self, lines: list[str], first_line: int) -> bool:
        """Read plain lines at once; False where they have to be read one by one."""
        state, track = self.state, self.track
        modes = plain.Modes(
            motion=int(state.motion or 0),
            feed=state.feed,
            scale=track.scale,
            absolute=state.absolute,
            centre_absolute=state.centre_absolute,
            shift=self.frame.shift,
            position=track.position,
        )
        run = plain.read_run(lines, modes)
        if run is None:
            return False
        track.moves.extend(run.kind, run.end, run.row + first_line, run.feed, run.centre)
        state.motion, state.feed = str(run.motion), run.last_feed
        return True

    # Lines

    def _line(self, raw: str) -> None:
        self.siemens, self.own_mode = False, {}
        parted = text_command(raw.strip())
        if parted:
            raw = parted[0]
            self.track.comment(parted[1])
        code = self._code(raw)
        if code and (code[0] in "%/O:<" or "#" in code or "[" in code):
            code = self._special(code)
        if code:
            self._block(TOKEN.findall(code))

    def _code(self, raw: str) -> str:
        """Code of a line in upper case; its comments are looked at for markers and tools."""
        if "(" not in raw and ";" not in raw:
            code, comments = raw.strip().upper(), []
        else:
            found = without_comments(raw)
            if found is None:
                raise self.track.error("a comment is not closed", remedy="write ) at its end")
            code, comments = found[0].strip().upper(), found[1]
        if code and code[0] not in "%/O" and is_siemens(code):
            self.siemens = self.speaks_siemens = True
            code, comments, self.own_mode = siemens_words(raw)
        for comment in comments:
            self.track.comment(comment)
        return code

    def _special(self, code: str) -> str:
        """Lines that begin with %, /, O, :, <, and those with variables; returns the code."""
        track = self.track
        if code.startswith("%_N_"):
            self.speaks_siemens = True
            return ""
        if code[0] == "%":
            self.percent_signs += 1
            self.ended = self.percent_signs > 1
            return ""
        if code[0] == "/":
            if self.block_delete:
                track.finding("block delete", "blocks that begin with / are skipped")
                return ""
            code = code[1:].strip()
        if code.startswith(("O", ":", "<")):
            if PROGRAM_NUMBER.match(code) or (code[0] == "<" and code[-1] == ">"):
                return ""
            raise track.error(
                f"subprograms and control flow are not read: {code[:40]}", remedy=_EXPAND
            )
        if "#" in code or "[" in code:
            raise track.error(
                f"variables and expressions are not read: {code[:40]}", remedy=_EXPAND
            )
        return code

    def _block(self, tokens: list[tuple[str, str, str]]) -> None:
        """One block: words into the modal state, then the motion."""
        codes: list[str] = []
        machine: list[str] = []
        words: Words = {}
        for letter, number, junk in tokens:
            if letter == "G":
                codes.append(canonical(number))
            elif letter == "M":
                machine.append(canonical(number))
            elif junk:
                self._junk(tokens, junk, codes)
            elif letter in words:
                raise self.track.error(f"word {letter} is written twice")
            elif letter in WORD_LETTERS:
                words[letter] = float(number)
            else:
                self._strange_word(letter, number, codes)
        if MACHINE_WITH_OWN_WORDS.intersection(machine):
            return
        if "4" in codes and "P" not in words:
            words.pop("F", None)  # the time of a Siemens dwell
        moves = self._codes(codes, words) if codes else True
        if "F" in words:
            perhaps_turns = 1.0 if self.state.feed_mode == "93" else self.track.scale
            self.state.feed = words["F"] * perhaps_turns
        if machine or words.keys() & set("STD"):
            self._machine(machine, words)
        if moves and ("X" in words or "Y" in words or "Z" in words or self._moves_in_place(words)):
            self._motion(words)
        if self.state.feed_mode == "93":
            self.state.feed = UNKNOWN  # holds for its own block
        for code in machine:
            self._stop(code)

    def _junk(self, tokens: list[tuple[str, str, str]], junk: str, codes: list[str]) -> None:
        """What is not part of a word; Marlin's G28 names axes without numbers."""
        if "28" in codes and junk in AXES:
            self.own_mode[junk] = True
            return
        text = "".join(letter + number + other for letter, number, other in tokens)
        remedy = "write numbers" if self.siemens else "take it out, or write it as a comment"
        raise self.track.error(f"{junk!r} is not part of a word in {text[:40]!r}", remedy=remedy)

    def _strange_word(self, letter: str, number: str, codes: list[str]) -> None:
        if letter in ROTARY:
            if float(number) == 0:
                self.track.finding("rotary", f"{letter}0 is taken for an axis that stands still")
                return
            raise self.track.error(
                f"rotary axes are not read: {letter}{number}",
                remedy="write a program for three axes",
            )
        if not (letter == "U" and "4" in codes):
            raise self.track.error(f"unknown word {letter}{number}")

    def _moves_in_place(self, words: Words) -> bool:
        """Full circles by centre alone need no axis word."""
        return self.state.motion in ("2", "3") and any(letter in words for letter in "IJK")

    # Modal codes

    def _codes(self, codes: list[str], words: Words) -> bool:
        """Preparatory codes of one block; returns whether its axis words are a motion."""
        groups = [GROUP[code] for code in codes if code in GROUP]
        if len(groups) != len(set(groups)):
            raise self.track.error(
                "two codes of one modal group: " + " ".join(f"G{c}" for c in codes)
            )
        state = self.state
        if "80" in codes:
            # Beside G0 it cancels the cycle that holds.
            state.motion = None
        for code in codes:
            if code in MOTIONS or code in CYCLES:
                self._choose_motion(code)
            elif code in self._unit_codes:
                self.track.scale = self._unit_codes[code]
            elif code in ("90", "91"):
                state.absolute = code == "90"
            elif code in ("90.1", "91.1"):
                state.centre_absolute = code == "90.1"
            elif code in PLANES:
                state.plane = code
            elif code in ("93", "94", "95"):
                state.feed = state.feed if code == state.feed_mode else UNKNOWN
                state.feed_mode = code
            elif code in ("98", "99"):
                state.return_to_initial = code == "98"
            elif code in COORDINATE_SYSTEMS or code in ("54.1", "154"):
                number = f" P{words['P']:g}" if code in ("54.1", "154") and "P" in words else ""
                self.frame.choose_system(f"G{code}{number}")
            elif code not in _BY_THEMSELVES and code not in WITHOUT_EFFECT:
                self._refuse(code, words)
        moves = True
        for code in codes:
            # These use the words of their block after its modal codes.
            if code in _BY_THEMSELVES:
                moves &= self._by_itself(code, words)
        return moves

    def _choose_motion(self, code: str) -> None:
        state = self.state
        if code in CYCLES and state.motion not in CYCLES:
            state.initial_height = self.track.position[2]
        # Z, R and Q hold as long as the same cycle does.
        state.cycle = state.cycle if code == state.motion else {}
        state.motion = code

    @property
    def _unit_codes(self) -> dict[str, float]:
        """Millimetres of the unit that each code chooses."""
        return SIEMENS_UNITS if self.speaks_siemens else UNITS

    def _refuse(self, code: str, words: Words) -> None:
        if self.speaks_siemens and code in SIEMENS_WITHOUT_EFFECT:
            return
        if code in ("5", "5.1") and not words.keys() & set("XYZIJ"):
            return  # look-ahead of Fanuc controllers
        if code in REFUSED_CODES:
            what, remedy = REFUSED_CODES[code]
            raise self.track.error(f"G{code} is not read: {what}", remedy=remedy)
        raise self.track.error(f"unknown code G{code}", remedy="take it out if it moves nothing")

    def _by_itself(self, code: str, words: Words) -> bool:
        """Codes with a use of their own for words; whether axis words are a motion all the same."""
        frame, scale = self.frame, self.track.scale
        if code in ("28", "30"):
            self._home(words)
        elif code == "53":
            self._machine_coordinates(words)
        elif code == "10":
            frame.store(words)
        elif code == "52":
            frame.set_local(words, scale)
        elif code == "92":
            frame.set_position(words, scale)
        elif code in ("92.1", "92.2"):
            frame.cancel_position()
        elif code == "43.1":
            frame.use_length(code, UNKNOWN)
        elif code == "49" or (code == "43" and words.get("H") == 0):
            frame.cancel_length()
            return True
        elif code == "43":
            frame.use_length(code, words.get("H", self.track.tool))
            return True
        return False

    def _home(self, words: Words) -> None:
        """G28, G30: over the point that the words give, to a place that the text does not tell."""
        track = self.track
        named = "".join(axis for axis in AXES if axis in words)
        if named and (self.state.absolute or not track.unknown(named)):
            track.rapid(self._target(words))
        named += "".join(axis for axis in self.own_mode if axis not in named)
        track.rapid(track.without(named or AXES))

    def _machine_coordinates(self, words: Words) -> None:
        if self.state.motion not in ("0", "1", None):
            raise self.track.error("G53 needs G0 or G1", remedy="write G0 in the same block")
        self.track.rapid(self.track.without("".join(axis for axis in AXES if axis in words)))

    def _machine(self, codes: list[str], words: Words) -> None:
        """Tool, spindle and coolant, which act before the motion of their block."""
        track = self.track
        if "S" in words:
            track.spindle_speed = words["S"]
        if "T" in words:
            track.chosen_tool = int(words["T"])
        for code in codes:
            if code == "6":
                track.change_tool()
            elif code in ("3", "4", "13"):
                track.spindle_on = True
            elif code == "61":
                track.close_section()
                track.tool = int(words.get("Q", track.tool))
            elif code == "25":
                track.rapid(track.without("Z"))
            elif code in SUBPROGRAMS:
                raise track.error(f"subprograms are not read: M{code}", remedy=_EXPAND)
            elif code not in MACHINE_WITHOUT_EFFECT and code not in ENDS:
                raise track.error(
                    f"unknown code M{code}", remedy="take it out if it does not move the tool"
                )
            if code in ("7", "8", "13"):
                track.start_coolant("mist" if code == "7" else "flood")
        if "D" in words and self.speaks_siemens:
            if words["D"] == 0:
                self.frame.cancel_length()
            else:
                self.frame.use_length("D", words["D"])

    def _stop(self, code: str) -> None:
        """What acts after the motion of its block."""
        if code == "5":
            self.track.spindle_on = False
        elif code == "9":
            self.track.coolant = "off"
        elif code in ENDS or (code == "17" and self.speaks_siemens):
            self.ended = True

    # Motions

    def _target(self, words: Words) -> Position:
        """Where the axis words lead from the present position, mm."""
        position, scale, shift = self.track.position, self.track.scale, self.frame.shift
        target = list(position)
        for axis, letter in enumerate(AXES):
            if letter not in words:
                continue
            value = words[letter] * scale
            if self.own_mode.get(letter, self.state.absolute):
                target[axis] = value + shift[axis]
            elif math.isnan(position[axis]):
                raise self.track.error(
                    f"a relative move of {letter} from an unknown position",
                    remedy="write an absolute move (G90) before",
                )
            else:
                target[axis] = position[axis] + value
        if self.frame.blind and "Z" in words:
            self.track.finding("G49", "Z is not known after the tool length is cancelled")
            target[2] = UNKNOWN
        return target[0], target[1], target[2]

    def _motion(self, words: Words) -> None:
        motion = self.state.motion
        if motion == "0":
            self.track.rapid(self._target(words))
        elif motion is None:
            raise self.track.error("axis words without a motion code", remedy="write G0 or G1")
        elif motion in CYCLES:
            self._cycle(words)
        else:
            self._feed_motion(motion, words)

    def _begin_feed(self) -> None:
        if not self.state.feed > 0:
            raise self.track.error(
                f"G{self.state.motion} without a feed",
                remedy="write F in the same block"
                if self.state.feed_mode == "93"
                else "write F before",
            )
        if self.state.feed_mode == "95" and not self.track.turning > 0:
            raise self.track.error("feed per turn while the spindle stands", remedy="write G94")
        self.track.begin_feed()

    def _feed(self, length: float) -> float:
        """Feed of a move of `length` mm, mm/min."""
        state = self.state
        if state.feed_mode == "93":
            return state.feed * length
        return state.feed * self.track.turning if state.feed_mode == "95" else state.feed

    def _feed_motion(self, motion: str, words: Words) -> None:
        track = self.track
        target = self._target(words)
        unknown = track.unknown()
        if unknown and motion == "1" and track.arrives(target):
            return
        self._begin_feed()
        if unknown:
            raise track.error(
                f"G{motion} starts at an unknown position of {unknown}",
                remedy="write a G0 to a position in all axes before",
            )
        if any(math.isnan(value) for value in target):
            raise track.error(f"G{motion} ends at an unknown position", remedy="write G43 before")
        track.placed = True
        if motion == "1":
            track.feed_line(target, self._feed(math.dist(track.position, target)))
        else:
            self._arc(words, motion == "3", target)

    def _arc(self, words: Words, counter: bool, target: Position) -> None:
        """An arc, with as many whole turns before it as P or TURN ask for."""
        track, plane = self.track, self.state.plane
        first, second, third = _PLANE_AXES[plane][0]
        begin = (track.position[first], track.position[second])
        end = (target[first], target[second])
        centre = self._centre(words, counter, begin, end)
        turns = words.get("L", 0.0) + 1 if self.siemens else words.get("P", 1.0)
        if turns != int(turns) or turns < 1:
            raise track.error(f"{turns:g} is no count of turns", remedy="write a whole number")
        sweep = sweep_of(begin, end, centre, counter)
        whole = int(turns) - 1
        total = sweep + math.copysign(2 * math.pi * whole, sweep)
        rise = target[third] - track.position[third]
        feed = self._feed(math.hypot(math.dist(begin, centre) * total, rise))
        if plane == "17":
            track.feed_turns(target, centre, counter, feed, whole, sweep)
            return
        track.check_radii(begin, end, centre)
        track.finding("plane", f"arcs in the plane {PLANES[plane]} are read as chords")
        points, fraction = chords(begin, end, centre, total, PLANE_CHORD)
        ends = np.empty((len(points), 3))
        ends[:, [first, second]] = points
        ends[:, third] = track.position[third] + rise * fraction
        ends[-1] = target
        count = len(points)
        track.moves.extend(
            np.full(count, MoveKind.LINE, dtype=np.uint8),
            ends,
            np.full(count, track.line),
            np.full(count, feed),
            np.full((count, 2), np.nan),
        )

    def _centre(
        self, words: Words, counter: bool, begin: tuple[float, float], end: tuple[float, float]
    ) -> tuple[float, float]:
        """Centre by its words or by R, in the axes of the plane."""
        state, track = self.state, self.track
        axes, letters = _PLANE_AXES[state.plane]
        (other,) = set("IJK") - set(letters)
        if words.get(other, 0.0) != 0 or (other in words and state.centre_absolute):
            raise track.error(
                f"{other} has no meaning for an arc in the {PLANES[state.plane]} plane",
                remedy=f"write G17, G18 or G19, or take {other} out",
            )
        if "R" in words:
            if words.keys() & set(letters):
                raise track.error("an arc with both R and a centre", remedy="take R out")
            return track.centre_by_radius(words["R"] * track.scale, counter, begin, end)
        if not words.keys() & set(letters):
            raise track.error(
                f"an arc without {letters[0]}, {letters[1]} or R", remedy="write the centre"
            )
        centre = []
        for letter, origin, axis in zip(letters, begin, axes, strict=False):
            if not self.own_mode.get(letter, state.centre_absolute):
                centre.append(origin + words.get(letter, 0.0) * track.scale)
            elif letter in words:
                centre.append(words[letter] * track.scale + self.frame.shift[axis])
            else:
                raise track.error(
                    f"an absolute centre (G90.1) needs both {letters[0]} and {letters[1]}"
                )
        return centre[0], centre[1]

    # Drilling cycles

    def _cycle(self, words: Words) -> None:
        """Drilling as the moves that it stands for; Z, R and Q hold until changed."""
        state, track = self.state, self.track
        name = f"G{state.motion}"
        if state.plane != "17" or state.feed_mode == "93":
            raise track.error(
                f"cycles in the plane G{state.plane} are not read"
                if state.plane != "17"
                else "cycles with inverse time feed are not read",
                remedy="write G17 and G94 before",
            )
        state.cycle.update({letter: words[letter] for letter in "ZRQ" if letter in words})
        missing = [letter for letter in "ZR" if letter not in state.cycle]
        if missing:
            raise track.error(f"{name} without {' and '.join(missing)}")
        initial = state.initial_height
        if math.isnan(initial) or self.frame.blind:
            raise track.error(f"{name} starts at an unknown position of Z", remedy="write G0 Z")
        heights = [state.cycle[letter] * track.scale for letter in "RZ"]
        if state.absolute:
            clear, bottom = (height + self.frame.shift[2] for height in heights)
        else:
            clear = initial + heights[0]
            bottom = clear + heights[1]
        if bottom > clear:
            raise track.error(f"{name} ends above R")
        places = {letter: words[letter] for letter in "XY" if letter in words}
        repeats = words.get("L", words.get("K", 1.0))
        if repeats != int(repeats) or repeats < 0:
            raise track.error(f"{repeats:g} is no count of holes")
        for _ in range(int(repeats)):
            self._hole(places, clear, bottom, max(initial, clear))

    def _hole(self, places: Words, clear: float, bottom: float, initial: float) -> None:
        state, track = self.state, self.track
        self._begin_feed()
        x, y, z = track.position
        if z < clear:
            track.rapid((x, y, clear))
        x, y, _ = self._target(places)
        if math.isnan(x) or math.isnan(y):
            raise track.error(f"G{state.motion} at an unknown position of X or Y")
        track.rapid((x, y, track.position[2]))
        track.rapid((x, y, clear))
        cycle = state.motion or ""
        peck = state.cycle.get("Q", 0.0) * track.scale
        if cycle in ("73", "83") and not peck > 0:
            raise track.error(f"G{cycle} without a positive Q", remedy="write Q")
        retract = initial if state.return_to_initial else clear
        for feeds, height in hole(cycle, clear, bottom, peck, retract):
            if feeds:
                track.feed_line((x, y, height), self._feed(abs(height - track.position[2])))
            else:
                track.rapid((x, y, height))


_BY_THEMSELVES: Final = frozenset(
    {"4", "10", "28", "30", "43", "43.1", "49", "52", "53", "92", "92.1", "92.2"}
)
