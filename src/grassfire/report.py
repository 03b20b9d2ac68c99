"""Findings and figures: what a run reports, in a form that people and machines read."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum


class Severity(StrEnum):
    """How much a finding matters, from least to most."""

    INFO = "info"
    REPAIR = "repair"
    WARNING = "warning"
    ERROR = "error"

    @property
    def rank(self) -> int:
        """Position in the order info < repair < warning < error."""
        return list(Severity).index(self)


@dataclass(frozen=True)
class Finding:
    """Something that was noticed, mended, ignored or refused.

    Attributes
    ----------
    severity : Severity
        INFO: harmless; REPAIR: the input was changed to be usable; WARNING: something was left
        out; ERROR: a part of the input could not be used.
    code : str
        Stable short name, words joined by hyphens, for machines to select on.
    message : str
        One sentence for people.
    handle : str, optional
        DXF handle of the entity that it concerns.
    place : tuple of float, optional
        (x, y) in mm.
    size : float, optional
        What was measured there, in mm (gap width, length dropped, ...) or a count; the message
        says which.
    """

    severity: Severity
    code: str
    message: str
    handle: str | None = None
    place: tuple[float, float] | None = None
    size: float | None = None

    def to_dict(self) -> dict[str, object]:
        """Return the finding as JSON-ready data with a fixed key order."""
        return {
            "severity": self.severity.value,
            "code": self.code,
            "message": self.message,
            "handle": self.handle,
            "place": None if self.place is None else [_finite(value) for value in self.place],
            "size": _finite(self.size),
        }

    def __str__(self) -> str:
        text = f"{self.severity.value}: {self.message}"
        if self.handle is not None:
            text += f" [#{self.handle}]"
        if self.place is not None:
            text += f" at ({self.place[0]:.6g}, {self.place[1]:.6g})"
        return text


@dataclass(frozen=True, kw_only=True)
class OperationFigures:
    """Figures of one operation; those that only verification can measure are None without it.

    Attributes
    ----------
    strategy, name : str
    tool : int
        Tool number.
    moves, lines, arcs, retracts : int
        Counts over the emitted program.
    cut_length_mm, rapid_length_mm, time_s : float
    reachable_area_mm2, unreachable_area_mm2 : float
        Area of the regions that the tool can and cannot reach.
    uncut_area_mm2 : float, optional
        Of the reachable area, what the program leaves standing.
    max_gouge_mm : float, optional
        Deepest cut beyond the region's wall.
    max_engagement_deg, mean_engagement_deg : float, optional
    rapids_in_stock : int, optional
    """

    strategy: str
    tool: int
    moves: int
    lines: int
    arcs: int
    cut_length_mm: float
    rapid_length_mm: float
    time_s: float
    reachable_area_mm2: float
    unreachable_area_mm2: float
    uncut_area_mm2: float | None = None
    max_gouge_mm: float | None = None
    max_engagement_deg: float | None = None
    mean_engagement_deg: float | None = None
    rapids_in_stock: int | None = None
    retracts: int = 0
    name: str = ""

    def to_dict(self) -> dict[str, object]:
        """Return the figures as JSON-ready data, keys in the order of the report's contract."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        ordered = {key: values[key] for key in _OPERATION_KEYS}
        return {key: _finite(value) for key, value in ordered.items()}


_OPERATION_KEYS = (
    "name",
    "strategy",
    "tool",
    "moves",
    "lines",
    "arcs",
    "cut_length_mm",
    "rapid_length_mm",
    "time_s",
    "reachable_area_mm2",
    "uncut_area_mm2",
    "unreachable_area_mm2",
    "max_gouge_mm",
    "max_engagement_deg",
    "mean_engagement_deg",
    "rapids_in_stock",
    "retracts",
)


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a run found, made and measured.

    Attributes
    ----------
    job : str
        Name of the job.
    findings : tuple of Finding
    operations : tuple of OperationFigures
        In the order of the job.
    seconds : mapping of str to float
        Time spent per stage, in the order in which the stages ran.
    verified : bool, optional
        Whether the emitted program passed verification; None when it was not asked for.
    faults : tuple of mapping
        What verification objected to, JSON-ready.
    post : str, optional
        Name of the post that wrote the program.
    program : str, optional
        File name of the program.
    resolution : float, optional
        Cell of the maps behind uncut area, rapids, plunges and engagement, mm; gouge and floor are
        measured without one. None without verification.
    """

    job: str
    findings: tuple[Finding, ...] = ()
    operations: tuple[OperationFigures, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    verified: bool | None = None
    faults: tuple[Mapping[str, object], ...] = ()
    post: str | None = None
    program: str | None = None
    resolution: float | None = None

    def worst(self) -> Severity | None:
        """Return the gravest severity among the findings, None without findings."""
        return max((item.severity for item in self.findings), key=lambda s: s.rank, default=None)

    def to_dict(self, *, include_seconds: bool = True) -> dict[str, object]:
        """Return the report as JSON-ready data with a fixed key order.

        Parameters
        ----------
        include_seconds : bool
            False leaves out the timings, the only part that differs between equal runs.
        """
        data: dict[str, object] = {
            "job": self.job,
            "post": self.post,
            "program": self.program,
            "units": "mm",
            "verified": self.verified,
            "resolution_mm": _finite(self.resolution),
            "findings": [item.to_dict() for item in self.findings],
            "operations": [item.to_dict() for item in self.operations],
            "faults": [dict(item) for item in self.faults],
        }
        if include_seconds:
            data["seconds"] = {stage: round(value, 6) for stage, value in self.seconds.items()}
        return data

    def to_json(self, *, include_seconds: bool = True) -> str:
        """Return the report as JSON text: fixed key order, one trailing newline, strict JSON."""
        data = self.to_dict(include_seconds=include_seconds)
        return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: object) -> object:
    """Map what JSON cannot hold (NaN, infinities) to None; a finite float or other value stays."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
