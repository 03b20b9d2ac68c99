"""What every strategy is asked and what it answers: settings, and pockets as lists of strokes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from grassfire.plan.strokes import Stroke
from grassfire.report import Finding, Severity
from grassfire.toolpath import FloatArray

SMALLEST_RING = 0.02
"""Rings of a smaller extent are points to a controller: only a plunge can enter there, mm."""


@dataclass(frozen=True)
class ClearingSettings:
    """What the clearing of a pocket depends on; lengths in mm, angles in radians.

    Attributes
    ----------
    tool_radius, wall, stepover : float
        `wall` is the least distance of the tool centre from the boundary.
    engagement : float
        Largest engagement angle: that of a straight cut of width `stepover`.
    tolerance : float
        How far paths may deviate from exact curves.
    entry : str
        "helix", "ramp" or "plunge".
    slope, drop, step : float
        Steepest descent of helix and ramp, the height that each descent loses, and that of a pass.
    climb : bool
        Whether the stock is on the right of the travel.
    both : bool
        Whether cuts may run the other way, too, to save ways back.
    finish : bool
        Whether each wall is cut once more at the end.
    fast_links : bool
        Whether links through cleared area run faster than cuts.
    longest_walk : float
        How far a link may go before a retract is quicker, mm.
    minimum_radius : float
        Smallest radius of turns where the shape leaves the choice, mm.
    link_speed : float
        Speed of links as a part of that of rapids.
    passes : int
        How many there are to the depth, which the wall pass takes at once.
    """

    tool_radius: float
    wall: float
    stepover: float
    engagement: float
    tolerance: float
    entry: str
    slope: float
    drop: float
    step: float
    climb: bool
    finish: bool
    fast_links: bool
    longest_walk: float
    minimum_radius: float
    link_speed: float = 0.25
    both: bool = False
    passes: int = 1


class PocketPlan(Protocol):
    """One connected set of tool positions, and how a strategy clears it.

    Attributes
    ----------
    peak : (2,) float array
        Where it is widest, mm.
    strokes, finish : list of Stroke
        For every pass; after the last one. Empty until `plan` was called.
    findings : list of Finding
        What `plan` noticed.
    """

    peak: FloatArray
    strokes: list[Stroke]
    finish: list[Stroke]
    findings: list[Finding]

    def plan(self, position: FloatArray) -> FloatArray:
        """Lay out all strokes from where the tool is; returns where the last one ends, mm."""


def needs_plunge(peak: FloatArray, peak_radius: float) -> Finding:
    """Finding for a place that has no room for the entry that was asked for."""
    return Finding(
        Severity.WARNING,
        "needs-plunge",
        "a place as wide as the tool has no room for a helix or ramp and is left; "
        'entry = "plunge" machines it',
        place=(float(peak[0]), float(peak[1])),
        size=2 * peak_radius,
    )
