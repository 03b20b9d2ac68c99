"""What a controller takes, as data: the models of the TOML files in `post/`."""

from __future__ import annotations

import re
from string import Formatter
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

_WORD = re.compile(r"[A-Z][-+]?(?:\d+\.?\d*|\.\d+)|%")

PLACEHOLDERS = {
    "program": frozenset({"name", "wcs", "tolerance", "clearance_height"}),
    "tool_change": frozenset({"tool", "diameter"}),
    "spindle": frozenset({"speed"}),
}
"""Names that may stand in braces in the templates of each table."""

_Decimals = Annotated[int, Field(ge=0, le=8)]
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Words(_Table):
    """The words of the four motions."""

    rapid: str = "G0"
    line: str = "G1"
    arc_cw: str = "G2"
    arc_ccw: str = "G3"


class Numbers(_Table):
    """Decimals of coordinates (mm), feeds (mm/min) and spindle speeds (1/min)."""

    decimals: _Decimals = 3
    feed_decimals: _Decimals = 1
    speed_decimals: _Decimals = 0


class Arcs(_Table):
    """How arcs are written, and how exact both their radii must be as written.

    `form`: centre relative to the start, centre in coordinates, radius, or no arcs at all
    (chords). Angles in degrees, lengths in mm. Arcs outside the radius limits become chords.
    `extra_decimal` lets I, J and R have one decimal more than coordinates where that is needed.
    """

    form: Literal["ij-incremental", "ij-absolute", "r", "none"] = "ij-incremental"
    helical: bool = True
    full_circles: Literal["split", "whole"] = "split"
    largest_sweep: Annotated[float, Field(gt=0, le=360)] = 350.0
    radius_mismatch: _Positive = 0.0015
    smallest_radius: _Positive = 0.01
    largest_radius: _Positive = 1e5
    extra_decimal: bool = True

    @model_validator(mode="after")
    def _radius_form_is_split(self) -> Self:
        # The centre of an arc given by R is ill-conditioned at 180 degrees and undefined at 360.
        if self.form == "r" and self.largest_sweep > 170:
            raise ValueError('form "r" needs largest_sweep <= 170')
        return self


class Modality(_Table):
    """Which words may be left out when they repeat."""

    motion: bool = True
    coordinates: bool = True
    feed: bool = True


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


class ProgramFrame(_Table):
    """Lines that open and close a program."""

    header_comments: tuple[str, ...] = ("{name}",)
    header: tuple[str, ...]
    footer: tuple[str, ...]
    line_length: Annotated[int, Field(ge=40)] = 255


class ToolChange(_Table):
    """Lines for the first tool and for every later one, each after an optional comment."""

    first_comment: str = ""
    first: tuple[str, ...] = ()
    next_comment: str = ""
    next: tuple[str, ...]


class Spindle(_Table):
    """Lines that start and stop the spindle."""

    start: tuple[str, ...] = ("S{speed} M3",)
    stop: tuple[str, ...] = ("M5",)


class Coolant(_Table):
    """Words for the coolant; an empty one is a kind that the controller lacks."""

    off: str = "M9"
    mist: str = ""
    flood: str = "M8"


class Post(_Table):
    """One controller's post definition."""

    name: str
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
            "program": (*frame.header_comments, *frame.header, *frame.footer),
            "tool_change": (change.first_comment, *change.first, change.next_comment, *change.next),
            "spindle": (*spindle.start, *spindle.stop),
        }
        for table, templates in texts.items():
            for template in templates:
                _check_placeholders(table, template)
        code = (*frame.header, *frame.footer, *change.first, *change.next, *texts["spindle"])
        motions = self.words.model_dump().values()
        for line in (*code, *motions, *self.coolant.model_dump().values()):
            word = self.refused_word(line)
            if word:
                raise ValueError(f"{line!r} holds {word}, which `refuses` lists")
        return self

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
