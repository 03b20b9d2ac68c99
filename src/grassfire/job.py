"""Job files: TOML in the user's units to validated settings in millimetres.

Angles keep the unit of the file, degrees, under the name of the file; the properties that end in
``_radians`` hold what the kernels take. Everything else is in mm, mm/min and mm/s^2 after loading.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NoReturn

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from grassfire.errors import InputError
from grassfire.tolerance import CHAINING, MACHINING

UNITS: Final[dict[str, float]] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4}
"""Millimetres in one of each unit that a job file may use."""

STRATEGIES: Final[tuple[str, ...]] = ("offset", "spiral", "adaptive")
"""Strategies that the planner has."""

STEADY_STRATEGIES: Final[tuple[str, ...]] = ("adaptive",)
"""Strategies that know the engagement of their cuts."""

PLANNED_STRATEGIES: Final[tuple[str, ...]] = ("rest", "finish", "vcarve")
"""Names that the job format reserves and no planner answers to yet."""

_QUANTITY: Final = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-z]+|\")?\s*(/\s*(?:min|s2|s\^2))?\s*"
)


def _quantity(value: object, info: ValidationInfo, per: str) -> float:
    """Number (in the units of the job) or string with a unit, to millimetres `per`."""
    context = info.context if isinstance(info.context, dict) else {}
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise PydanticCustomError("quantity", 'expected a number or a string such as "0.25in"')
    if isinstance(value, str):
        match = _QUANTITY.fullmatch(value)
        unit = None if match is None else {'"': "in"}.get(match[2] or "", match[2])
        divisor = None if match is None or not match[3] else match[3].replace(" ", "")
        divisors = (None, per, "/s^2") if per == "/s2" else (None, per)
        if match is None or unit not in UNITS or divisor not in divisors:
            raise PydanticCustomError(
                "quantity",
                "{text} is not a quantity; write a number or a string such as {example}",
                {"text": repr(value), "example": f'"0.25in{per}"'},
            )
        number = float(match[1]) * UNITS[unit]
    else:
        number = float(value) * UNITS[context.get("units", "mm")]
    if not math.isfinite(number):
        raise PydanticCustomError("quantity", "expected a finite number")
    return number


def _length(value: object, info: ValidationInfo) -> float:
    return _quantity(value, info, "")


def _speed(value: object, info: ValidationInfo) -> float:
    return _quantity(value, info, "/min")


def _acceleration(value: object, info: ValidationInfo) -> float:
    return _quantity(value, info, "/s2")


def _schema(what: str) -> WithJsonSchema:
    return WithJsonSchema({"type": ["number", "string"], "description": what})


_LENGTH_SCHEMA: Final = _schema('length in the units of the job, or text such as "0.25in"')
_SPEED_SCHEMA: Final = _schema('speed in units per minute, or text such as "40in/min"')
_ACCELERATION_SCHEMA: Final = _schema('acceleration in units per s^2, or text such as "500mm/s2"')

Length = Annotated[float, BeforeValidator(_length), _LENGTH_SCHEMA]
PositiveLength = Annotated[float, Field(gt=0), BeforeValidator(_length), _LENGTH_SCHEMA]
NonNegativeLength = Annotated[float, Field(ge=0), BeforeValidator(_length), _LENGTH_SCHEMA]
Speed = Annotated[float, Field(gt=0), BeforeValidator(_speed), _SPEED_SCHEMA]
Acceleration = Annotated[float, Field(gt=0), BeforeValidator(_acceleration), _ACCELERATION_SCHEMA]
Interval = tuple[Length, Length]
UnitName = Literal["mm", "cm", "m", "in", "inch"]


def _conflict(key: str, message: str) -> NoReturn:
    """Raise a validation error that points at `key` below the model that is being checked."""
    raise PydanticCustomError("conflict", "{text}", {"text": message, "key": key})


def _resolve(value: object, info: ValidationInfo) -> object:
    """Path relative to the job file, if there is one."""
    context = info.context if isinstance(info.context, dict) else {}
    if isinstance(value, str | Path) and str(value):
        return Path(context.get("directory", Path())) / value
    raise PydanticCustomError("path", "expected the name of a file")


class _Settings(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class InputSettings(_Settings):
    """The drawing and how to read it."""

    file: Annotated[Path, BeforeValidator(_resolve)] = Field(
        description="DXF drawing, relative to the job file"
    )
    layers: tuple[str, ...] = Field((), description="glob patterns of layers; empty: all layers")
    units: str | None = Field(None, description="overrides the drawing's units, e.g. mm or in")
    chaining_tolerance: PositiveLength = CHAINING


class Stock(_Settings):
    """The block that the pockets are cut from."""

    top: Length = 0.0
    thickness: PositiveLength | None = None


class Heights(_Settings):
    """Heights above the top of the stock, mm."""

    clearance: PositiveLength = 15.0
    retract: PositiveLength = 3.0

    @model_validator(mode="after")
    def _ordered(self) -> Heights:
        if self.retract > self.clearance:
            _conflict("retract", "is above heights.clearance")
        return self


class Machine(_Settings):
    """What the time estimate needs (mm/min, mm/s^2, mm), and what the machine cannot do."""

    rapid: Speed = 5000.0
    acceleration: Acceleration = 500.0
    junction_deviation: PositiveLength = 0.01
    arc_tolerance: PositiveLength = 0.002
    path_tolerance: NonNegativeLength | None = Field(
        default=None, description="of G64 P; in place of junction_deviation and arc_tolerance"
    )
    travel: tuple[Interval, Interval, Interval] | None = Field(
        default=None,
        description="least and greatest x, y and z of the program, [[x, x], [y, y], [z, z]]",
    )
    rapid_height: NonNegativeLength | None = Field(
        default=None, description="above the stock: rapids do not travel sideways below it"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Machine:
        for axis, (low, high) in zip("xyz", self.travel or (), strict=False):
            if not low < high:
                _conflict("travel", f"has no room in {axis}: {low:g} to {high:g} mm")
        return self


class Tool(_Settings):
    """A cutter with its spindle speed (1/min) and feeds (mm/min)."""

    number: int = Field(ge=1, le=99999, strict=True)
    shape: Literal["flat", "ball", "v"] = "flat"
    diameter: PositiveLength
    flutes: int = Field(2, ge=1, strict=True)
    spindle_speed: float = Field(gt=0)
    feed: Speed
    plunge_feed: Speed
    name: str = ""
    coolant: Literal["off", "mist", "flood"] = "off"
    flute_length: PositiveLength | None = Field(
        default=None, description="from the tip to the shank"
    )
    shank_diameter: PositiveLength | None = Field(default=None, description="default: diameter")
    stickout: PositiveLength | None = Field(default=None, description="from the tip to the holder")
    holder_diameter: PositiveLength | None = Field(default=None, description="at its lower end")

    @model_validator(mode="after")
    def _body(self) -> Tool:
        if self.shank_diameter is not None and self.flute_length is None:
            _conflict("shank_diameter", "needs flute_length: where the shank begins")
        if (self.stickout is None) != (self.holder_diameter is None):
            given, missing = ("stickout", "holder_diameter")
            if self.stickout is None:
                given, missing = missing, given
            _conflict(given, f"needs {missing}")
        return self

    @property
    def radius(self) -> float:
        """Half the diameter, mm."""
        return self.diameter / 2


class Operation(_Settings):
    """One pass over the pockets with one tool; lengths in mm, angles in degrees."""

    strategy: str = Field(json_schema_extra={"enum": list(STRATEGIES)})
    tool: int = Field(ge=1, strict=True)
    depth: PositiveLength
    stepdown: PositiveLength = Field(default=0.0, description="most per pass; default: depth")
    stepover: float | None = Field(None, gt=0, le=1, description="fraction of the diameter")
    engagement_angle: float | None = Field(None, gt=0, le=180, description="degrees")
    direction: Literal["climb", "conventional", "both"] = "climb"
    radial_allowance: NonNegativeLength = 0.0
    axial_allowance: NonNegativeLength = 0.0
    entry: Literal["helix", "ramp", "plunge"] = "helix"
    ramp_angle: float = Field(3.0, gt=0, le=30, description="degrees")
    finish_pass: bool = True
    layers: tuple[str, ...] = Field((), description="glob patterns; empty: those of [input]")
    link_feed: Speed | None = None
    minimum_path_radius: float = Field(
        0.1, ge=0, le=0.5, description="of turns of spirals and links, fraction of the diameter"
    )
    link_lift: NonNegativeLength = Field(
        default=0.0, description="rise of links through cleared area above the floor"
    )
    arc_feed: Literal["corrected", "constant"] = Field(
        "corrected", description="corrected: slower on inside arcs, so that chips stay as thick"
    )
    chip_thinning: bool = Field(
        False, description="faster cuts where the engagement is below 90 degrees throughout"
    )
    name: str = ""

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        filled = dict(data)
        if "engagement_angle" not in filled:
            filled.setdefault("stepover", 0.4)
        return filled

    @model_validator(mode="after")
    def _consistent(self) -> Operation:
        if self.strategy not in STRATEGIES:
            known = ", ".join(STRATEGIES)
            if self.strategy in PLANNED_STRATEGIES:
                _conflict("strategy", f"{self.strategy!r} is not offered yet; offered: {known}")
            _conflict("strategy", f"{self.strategy!r} is unknown; offered: {known}")
        if self.stepover is not None and self.engagement_angle is not None:
            _conflict("engagement_angle", "contradicts stepover; give one of the two")
        if self.stepover is None and self.engagement_angle is None:
            _conflict("stepover", "is missing; give stepover or engagement_angle")
        if self.strategy == "adaptive" and self.entry != "helix":
            _conflict(
                "entry",
                f"{self.entry!r} would begin with a slot; strategy 'adaptive' enters by helix",
            )
        if self.direction == "both" and self.strategy != "adaptive":
            _conflict("direction", "'both' is offered by strategy 'adaptive' alone")
        if self.chip_thinning and self.strategy not in STEADY_STRATEGIES:
            _conflict(
                "chip_thinning",
                f"needs an engagement that is known: strategy {' or '.join(STEADY_STRATEGIES)}",
            )
        if self.axial_allowance >= self.depth:
            _conflict("axial_allowance", "is not less than depth, so nothing would be cut")
        # The model is frozen for its users; its default depends on another field.
        self.__dict__["stepdown"] = min(self.stepdown or self.depth, self.depth)
        return self

    @property
    def stepover_fraction(self) -> float:
        """Stepover as a fraction of the diameter, from either key.

        A straight cut of width a with a tool of radius R engages acos(1 - a / R).
        """
        if self.stepover is not None:
            return self.stepover
        assert self.engagement_angle is not None
        return (1.0 - math.cos(math.radians(self.engagement_angle))) / 2.0

    @property
    def chip_thinning_factor(self) -> float:
        """How much faster cuts of known engagement are: 1 / sin(engagement), at most 2.

        A tooth that leaves the stock at an angle e before the side of the tool cuts chips of
        feed per tooth times sin(e) at most.
        """
        if not self.chip_thinning:
            return 1.0
        angle = min(self.engagement_angle_radians, math.pi / 2)
        return min(1.0 / math.sin(angle), 2.0)

    @property
    def ramp_angle_radians(self) -> float:
        """Slope of helix and ramp entries, rad."""
        return math.radians(self.ramp_angle)

    @property
    def engagement_angle_radians(self) -> float:
        """Engagement of a straight cut, rad, from either key."""
        return math.acos(1.0 - 2.0 * self.stepover_fraction)


class Job(_Settings):
    """A drawing, tools and operations: all that `grassfire run` needs."""

    name: str = Field(min_length=1, max_length=100, pattern=r"^[\w][\w .+-]*$")
    units: UnitName = Field("mm", description="of the numbers in this file")
    post: str = Field("linuxcnc", min_length=1, description="name of a post, or a path to one")
    tolerance: PositiveLength = Field(
        default=MACHINING, description="how far a path may deviate from the exact curve"
    )
    input: InputSettings
    stock: Stock = Stock()
    heights: Heights = Heights()
    machine: Machine = Machine()
    tools: tuple[Tool, ...] = Field(min_length=1)
    operations: tuple[Operation, ...] = Field(min_length=1)
    _path: Path | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _consistent(self) -> Job:
        seen: dict[int, int] = {}
        for index, tool in enumerate(self.tools):
            if tool.number in seen:
                _conflict(
                    f"tools[{index}].number",
                    f"{tool.number} is used by tools[{seen[tool.number]}] already",
                )
            seen[tool.number] = index
        for index, operation in enumerate(self.operations):
            self._check_operation(f"operations[{index}]", operation, seen)
        return self

    def _check_operation(self, key: str, operation: Operation, seen: dict[int, int]) -> None:
        if operation.tool not in seen:
            known = ", ".join(str(number) for number in sorted(seen))
            _conflict(f"{key}.tool", f"no tool has number {operation.tool}; there is {known}")
        shape = self.tools[seen[operation.tool]].shape
        if shape != "flat":
            _conflict(
                f"{key}.tool",
                f"strategy {operation.strategy!r} with entry {operation.entry!r} needs a flat "
                f"tool, and tool {operation.tool} is {shape!r}",
            )
        thickness = self.stock.thickness
        if thickness is not None and operation.depth > thickness:
            _conflict(
                f"{key}.depth",
                f"{operation.depth:g} mm is below the stock, which is {thickness:g} mm thick",
            )
        if self.tolerance > self.tools[seen[operation.tool]].radius / 10:
            _conflict("tolerance", f"is over a tenth of the radius of tool {operation.tool}")

    @property
    def path(self) -> Path | None:
        """The file that the job was loaded from."""
        return self._path

    @property
    def directory(self) -> Path:
        """Folder that relative names in the job start from."""
        return Path() if self._path is None else self._path.parent

    @property
    def clearance_height(self) -> float:
        """Absolute z of moves between pockets, mm."""
        return self.stock.top + self.heights.clearance

    @property
    def retract_height(self) -> float:
        """Absolute z of rapids within a pocket, mm."""
        return self.stock.top + self.heights.retract

    def tool(self, number: int) -> Tool:
        """The tool with this number.

        Raises
        ------
        InputError
            If no tool has the number.
        """
        for tool in self.tools:
            if tool.number == number:
                return tool
        known = ", ".join(str(tool.number) for tool in self.tools)
        raise InputError(f"no tool has number {number}", remedy=f"known: {known}")

    def with_post(self, post: str) -> Job:
        """A copy of the job for another post."""
        copy = self.model_copy(update={"post": post})
        copy._path = self._path
        return copy


def key_path(location: Iterable[int | str]) -> str:
    """A location such as ("tools", 0, "feed") as text, "tools[0].feed"."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def _known_keys(location: tuple[int | str, ...]) -> list[str]:
    """Keys that the model at `location` takes."""
    model: type[BaseModel] = Job
    children: dict[str, type[BaseModel]] = {
        "input": InputSettings,
        "stock": Stock,
        "heights": Heights,
        "machine": Machine,
        "tools": Tool,
        "operations": Operation,
    }
    for part in location:
        if isinstance(part, str):
            model = children.get(part, model)
    return list(model.model_fields)


def _input_error(error: ValidationError, source: str) -> InputError:
    """The first fault of a job as one line, with the count of the others."""
    # A misspelt key is also a missing one: tell the cause, not the effect.
    order = {"extra_forbidden": 0, "missing": 2, "too_short": 3}
    faults = sorted(error.errors(include_url=False), key=lambda item: order.get(item["type"], 1))
    effects = {"missing", "too_short"} if faults[0]["type"] == "extra_forbidden" else {"too_short"}
    faults = faults[:1] + [item for item in faults[1:] if item["type"] not in effects]
    fault = faults[0]
    location = tuple(fault["loc"])
    context = fault.get("ctx", {})
    message, remedy = fault["msg"], None
    place = key_path(location)
    if fault["type"] == "conflict":
        place = ".".join(part for part in (place, str(context["key"])) if part)
        message = str(context["text"])
    elif fault["type"] == "extra_forbidden":
        known = _known_keys(location[:-1])
        close = difflib.get_close_matches(str(location[-1]), known, n=1)
        message = "unknown key"
        remedy = f"did you mean {close[0]!r}?" if close else "known keys: " + ", ".join(known)
    elif fault["type"] == "missing":
        message = "missing key"
    elif "input" in fault and not isinstance(fault["input"], dict | list):
        given = repr(fault["input"])
        message = message[0].lower() + message[1:]
        message = message if given in message else f"{message}, not {given}"
    if len(faults) > 1:
        others = f"{len(faults) - 1} more fault{'s' if len(faults) > 2 else ''} in this file"
        remedy = f"{remedy}; {others}" if remedy else others
    return InputError(f"{place}: {message}" if place else message, source=source, remedy=remedy)


def parse_job(text: str, path: Path) -> Job:
    """Validate the text of a job file; `path` names it and anchors relative names.

    Raises
    ------
    InputError
        With the file, the key's path and what to do.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        remedy = "a drawing is no job: grassfire init makes one from it"
        raise InputError(
            f"not valid TOML: {error}",
            source=str(path),
            remedy=remedy if path.suffix.lower() == ".dxf" else None,
        ) from error
    data.setdefault("name", path.stem)
    units = data.get("units", "mm")
    if not isinstance(units, str) or units not in UNITS:
        known = ", ".join(UNITS)
        raise InputError(f"units: {units!r} is unknown", source=str(path), remedy=f"known: {known}")
    context = {"units": units, "directory": path.parent}
    try:
        job = Job.model_validate(data, context=context)
    except ValidationError as error:
        raise _input_error(error, str(path)) from error
    job._path = path
    return job


def load_job(path: str | Path) -> Job:
    """Read a job file.

    Parameters
    ----------
    path : str or Path
        TOML file; names of files in it are relative to its folder.

    Returns
    -------
    Job
        Settings with lengths in mm.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or holds unknown, missing or contradictory keys.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError("no such job file", source=str(path)) from error
    except OSError as error:
        reason = error.strerror or "cannot be read"
        raise InputError(f"the job file cannot be read: {reason}", source=str(path)) from error
    except UnicodeDecodeError as error:
        raise InputError("the job file is not UTF-8 text", source=str(path)) from error
    return parse_job(text, path)


def json_schema() -> dict[str, Any]:
    """JSON Schema of job files, for editors that check and complete them."""
    schema = Job.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "grassfire job"
    schema["required"] = [key for key in schema.get("required", []) if key != "name"]
    return schema
