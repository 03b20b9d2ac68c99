"""What a controller takes, as data: the models of the TOML files in `post/`."""

from __future__ import annotations

import re
from string import Formatter
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

_WORD = re.compile(r"[A-Z][-+]?(?:\d+\.?\d*|\.\d+)|%")

PLACEHOLDERS = {
    "program": frozenset(
        {
            *("name", "label", "identifier", "number"),
            *("units", "wcs", "tolerance", "clearance_height"),
        }
    ),
    "tool_change": frozenset({"tool", "diameter", "speed"}),
    "spindle": frozenset({"speed"}),
    "dwell": frozenset({"seconds", "milliseconds"}),
}
"""Names that may stand in braces in the templates of each table."""

INCH = 25.4
"""Millimetres in an inch."""

_Decimals = Annotated[int, Field(ge=0, le=8)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Words(_Table):
    """The words of the four motions, and what `{units}` stands for."""

    rapid: str = "G0"
    line: str = "G1"
    arc_cw: str = "G2"
    arc_ccw: str = "G3"
    millimetres: str = "G21"
    inches: str = "G20"


class Numbers(_Table):
    """Units, and decimals of coordinates, feeds (units/min) and spindle speeds (1/min).

    `feed_point` is for controllers that scale a feed without a decimal point: F300 becomes F300.
    """

    units: Literal["mm", "inch"] = "mm"
    decimals: _Decimals = 3
    feed_decimals: _Decimals = 1
    inch_decimals: _Decimals = 4
    inch_feed_decimals: _Decimals = 2
    speed_decimals: _Decimals = 0
    feed_point: bool = False


class Arcs(_Table):
    """How arcs are written, and how exact both their radii must be as written.

    `form`: centre relative to the start, centre in coordinates, radius, or no arcs at all
    (chords). Angles in degrees, lengths in mm. Arcs outside the radius limits become chords.
    `extra_decimal` lets I, J and R have one decimal more than coordinates where that is needed.
    `helix_word` closes the blocks of arcs that change z. No arc as written sweeps more than
    `largest_sweep`.
    """

    form: Literal["ij-incremental", "ij-absolute", "r", "none"] = "ij-incremental"
    helical: bool = True
    full_circles: Literal["split", "whole"] = "split"
    largest_sweep: Annotated[float, Field(gt=0, le=360)] = 350.0
    radius_mismatch: _Positive = 0.0015
    smallest_radius: _Positive = 0.01
    largest_radius: _Positive = 1e5
    extra_decimal: bool = True
    helix_word: str = ""

    @model_validator(mode="after")
    def _radius_form_is_split(self) -> Self:
        # The centre of an arc given by R is ill-conditioned at 180 degrees and undefined at 360.
        if self.form == "r" and self.largest_sweep > 170:
            raise ValueError('form "r" needs largest_sweep <= 170')
        return self


class Modality(_Table):
    """Which words may be left out when they repeat.

    `rapid_feed`, mm/min, is for controllers whose rapids run at a feed that the program gives.
    """

    motion: bool = True
    coordinates: bool = True
    feed: bool = True
    rapid_feed: _Positive | None = None


class LineNumbers(_Table):
    """Numbers before every block."""

    word: str = "N"
    start: Annotated[int, Field(ge=0)] = 10
    step: Annotated[int, Field(ge=1)] = 10


class Comments(_Table):
    """How comments look, how long their text may be and what must not be in it."""

    style: Literal["parentheses", "semicolon", "none"] = "parentheses"
    max_length: Annotated[int, Field(ge=40)] = 70
    forbidden: str = ""
    upper_case: bool = False


class ProgramNumber(_Table):
    """Range of `{number}` and its digits; see `words.program_number`."""

    digits: Annotated[int, Field(ge=1, le=8)] = 4
    largest: Annotated[int, Field(ge=1)] = 7999


class ProgramFrame(_Table):
    """Lines that open and close a program: opening, comments, header, then footer."""

    opening: tuple[str, ...] = ()
    header_comments: tuple[str, ...] = ("{name}",)
    header: tuple[str, ...]
    footer: tuple[str, ...]
    number: ProgramNumber = ProgramNumber()
    line_length: Annotated[int, Field(ge=40)] = 255


class ToolChange(_Table):
    """Lines for the first tool and for every later one, each after an optional comment.

    `length` stands in the first block that moves Z with a tool. With `retracted` these lines leave
    the spindle at the top of its travel, so the way across comes before the way down. With
    `split` there is no change: every tool gets a program of its own.
    """

    first_comment: str = ""
    first: tuple[str, ...] = ()
    next_comment: str = ""
    next: tuple[str, ...] = ()
    length: str = ""
    retracted: bool = False
    split: bool = False

    @model_validator(mode="after")
    def _change_is_a_change(self) -> Self:
        if not self.next and not self.split:
            raise ValueError("`next` is empty: give lines that change the tool, or split = true")
        return self


class Spindle(_Table):
    """Lines that start the spindle, change its speed with the same tool (as `start`, if empty)
    and stop it; a dwell of `spin_up` seconds follows a start."""

    start: tuple[str, ...] = ("S{speed} M3",)
    change: tuple[str, ...] = ()
    stop: tuple[str, ...] = ("M5",)
    spin_up: Annotated[float, Field(ge=0, le=60)] = 0.0
    dwell: tuple[str, ...] = ("G4 P{seconds}",)


class Coolant(_Table):
    """Words for the coolant; an empty one is a kind that the controller lacks."""

    off: str = "M9"
    mist: str = ""
    flood: str = "M8"


class Post(_Table):
    """One controller's post definition.

    `dialect` chooses the renderer: words of G-code, or Heidenhain's plain language.
    """

    name: str
    dialect: Literal["g-code", "plain-language"] = "g-code"
    description: str
    source: tuple[str, ...] = ()
    extension: Annotated[str, Field(pattern=r"^[A-Za-z0-9]+$")]
    wcs: tuple[str, ...] = ("G54", "G55", "G56", "G57", "G58", "G59")
    refuses: tuple[str, ...] = ()
    words: Words = Words()
    numbers: Numbers = Numbers()
    arcs: Arcs = Arcs()
    modality: Modality = Modality()
    line_numbers: LineNumbers | None = None
    comments: Comments = Comments()
    program: ProgramFrame
    tool_change: ToolChange
    spindle: Spindle = Spindle()
    coolant: Coolant = Coolant()

    @model_validator(mode="after")
    def _templates_are_sound(self) -> Self:
        frame, change, spindle = self.program, self.tool_change, self.spindle
        texts = {
            "program": (*frame.opening, *frame.header_comments, *frame.header, *frame.footer),
            "tool_change": (
                *(change.first_comment, *change.first, change.next_comment, *change.next),
                change.length,
            ),
            "spindle": (*spindle.start, *spindle.change, *spindle.stop),
            "dwell": spindle.dwell,
        }
        for table, templates in texts.items():
            for template in templates:
                _check_placeholders(table, template)
        code = (
            *(*frame.opening, *frame.header, *frame.footer, *change.first, *change.next),
            *(change.length, *texts["spindle"], *spindle.dwell, self.arcs.helix_word),
        )
        motions = self.words.model_dump().values()
        for line in (*code, *motions, *self.coolant.model_dump().values()):
            word = self.refused_word(line)
            if word:
                raise ValueError(f"{line!r} holds {word}, which `refuses` lists")
        return self

    def in_units(self, units: Literal["mm", "inch"]) -> Post:
        """The same post with programs in other units."""
        return self.model_copy(update={"numbers": self.numbers.model_copy(update={"units": units})})

    @property
    def scale(self) -> float:
        """Millimetres in one unit of the program."""
        return INCH if self.numbers.units == "inch" else 1.0

    @property
    def decimals(self) -> int:
        """Decimals of coordinates in the units of the program."""
        numbers = self.numbers
        return numbers.inch_decimals if numbers.units == "inch" else numbers.decimals

    @property
    def feed_decimals(self) -> int:
        """Decimals of feeds in the units of the program."""
        numbers = self.numbers
        return numbers.inch_feed_decimals if numbers.units == "inch" else numbers.feed_decimals

    @property
    def units_word(self) -> str:
        """What `{units}` stands for."""
        return self.words.inches if self.numbers.units == "inch" else self.words.millimetres

    def refused_word(self, line: str) -> str | None:
        """First word of a line of code that the controller refuses, or None."""
        # Placeholders stand for numbers.
        digits = re.sub(r"\{[^}]*\}", "1", line)
        return next((word for word in _WORD.findall(digits) if word in self.refuses), None)


def _check_placeholders(table: str, template: str) -> None:
    allowed = PLACEHOLDERS[table]
    for _, name, specification, conversion in Formatter().parse(template):
        if name is None:
            continue
        if name not in allowed or specification or conversion:
            raise ValueError(
                f"{table}: {template!r} has {{{name}}}; known are "
                + ", ".join(f"{{{known}}}" for known in sorted(allowed))
            )
