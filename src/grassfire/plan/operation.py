"""One operation over all its regions: the pockets, their order, and what cannot be reached."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from grassfire.errors import PlanningError
from grassfire.job import Job, Operation, Tool
from grassfire.medial import MedialAxis
from grassfire.plan.depth import pass_floors
from grassfire.plan.feeds import Feeds, entry_feed
from grassfire.plan.order import tour
from grassfire.plan.reach import Reach, reach
from grassfire.plan.strategy import ClearingSettings, PocketPlan
from grassfire.plan.strokes import Emitter, Levels
from grassfire.report import Finding, Severity
from grassfire.tolerance import FITTING
from grassfire.toolpath import FloatArray, Toolpath, ToolpathBuilder

WALL_FIT = 0.35
"""Part of the job's tolerance for the fit of wall rings; the rest is for rounding in the text."""

ABOVE_FLOOR = 0.5
"""How far above the floor of the pass before a descent starts, mm."""

LONGEST_CUT = 2e7
"""Cuts longer than this are taken for a mistake of units, mm: weeks of machining."""


@dataclass(frozen=True)
class PlannedOperation:
    """Moves of one operation and what was noticed.

    Attributes
    ----------
    toolpath : Toolpath
        From an unknown place at clearance height (or from the start that was given) to
        clearance height.
    findings : tuple of Finding
    reachable_area, unreachable_area : float
        Of all regions, mm^2, within 0.01 mm times their perimeter's length and better.
    """

    toolpath: Toolpath
    findings: tuple[Finding, ...]
    reachable_area: float
    unreachable_area: float


Strategy = Callable[[MedialAxis, ClearingSettings], tuple[list[PocketPlan], list[Finding]]]


def _adaptive() -> Strategy:
    from grassfire.plan.adaptive import adaptive_pockets

    return adaptive_pockets


def _offset() -> Strategy:
    from grassfire.plan.offset import offset_pockets

    return offset_pockets


def _spiral() -> Strategy:
    from grassfire.plan.spiral import spiral_pockets

    return spiral_pockets


_STRATEGIES: dict[str, Callable[[], Strategy]] = {
    "adaptive": _adaptive,
    "offset": _offset,
    "spiral": _spiral,
}
"""Strategies by their names; only what an operation asks for is imported."""


def plan_operation(
    axes: Sequence[MedialAxis],
    operation: Operation,
    tool: Tool,
    job: Job,
    start: Sequence[float] | None = None,
) -> PlannedOperation:
    """Plan an operation.

    Parameters
    ----------
    axes : sequence of MedialAxis
        One for each region.
    operation, tool, job : Operation, Tool, Job
    start : (x, y) or (x, y, z), optional
        Where the tool is before, mm; unknown by default.

    Returns
    -------
    PlannedOperation

    Raises
    ------
    PlanningError
        If the tool fits into no region, nothing is left to cut, there would be too many passes, or
        cuts or descents would be longer than `LONGEST_CUT`.
    """
    findings: list[Finding] = []
    wall = tool.radius + operation.radial_allowance - FITTING
    floors = pass_floors(
        job.stock.top, operation.depth, operation.stepdown, operation.axial_allowance
    )
    levels = _levels(job, operation)
    step = job.stock.top - float(floors[0])
    feeds = _feeds(operation, tool, step)
    settings = _settings(operation, tool, job, levels, feeds, step, len(floors))
    _check_length(axes, tool, settings, len(floors))
    builder = ToolpathBuilder(_start(start, levels))
    # polygons are worked on outside the interpreter, meanwhile
    with ThreadPoolExecutor(max_workers=1) as pool:
        opened = [pool.submit(reach, axis.region, wall) for axis in axes]
        pockets = _pockets(axes, operation, tool, settings, findings)
        _machine(pockets, Emitter(builder, levels, feeds), floors)
        findings += [finding for _, pocket in pockets for finding in pocket.findings]
        reached = [item.result() for item in opened]
    findings += _unreached(reached, tool, operation)
    return PlannedOperation(
        builder.build(),
        tuple(findings),
        sum(item.reachable for item in reached),
        sum(item.unreachable for item in reached),
    )


def _check_length(
    axes: Sequence[MedialAxis], tool: Tool, settings: ClearingSettings, passes: int
) -> None:
    """Refuse what would take weeks: area / stepover is the length of a pass, nearly."""
    area = sum(axis.region.area for axis in axes if axis.largest_disk()[1] >= settings.wall)
    length = area / settings.stepover * passes
    sunk = passes * settings.drop / math.tan(settings.slope)
    if sunk > LONGEST_CUT:
        raise PlanningError(
            f"descents of {passes * settings.drop:.6g} mm at {math.degrees(settings.slope):g} "
            f"degrees are {sunk / 1e6:.3g} km long",
            remedy="check depth and ramp_angle",
        )
    if length > LONGEST_CUT:
        raise PlanningError(
            f"clearing {area:.4g} mm2 with tool {tool.number} ({tool.diameter:g} mm) takes about "
            f"{length / 1e6:.3g} km of cuts",
            remedy="check units and layers of the drawing, or take a larger tool",
        )


def _levels(job: Job, operation: Operation) -> Levels:
    return Levels(
        top=job.stock.top,
        retract=job.retract_height,
        clearance=job.clearance_height,
        above_floor=ABOVE_FLOOR,
        rapid=job.machine.rapid,
        lift=operation.link_lift,
    )


def _feeds(operation: Operation, tool: Tool, step: float) -> Feeds:
    return Feeds(
        cut=tool.feed,
        link=operation.link_feed or tool.feed,
        entry=entry_feed(tool.feed, tool.plunge_feed, operation.ramp_angle_radians),
        plunge=tool.plunge_feed,
        tool_radius=tool.radius,
        inside=-1 if operation.direction == "conventional" else 1,
        stepover=operation.stepover_fraction * tool.diameter,
        stepdown=step,
        slope=operation.ramp_angle_radians,
        corrected=operation.arc_feed == "corrected",
        thinning=operation.chip_thinning_factor,
    )


def _settings(
    operation: Operation,
    tool: Tool,
    job: Job,
    levels: Levels,
    feeds: Feeds,
    step: float,
    passes: int,
) -> ClearingSettings:
    # a retract costs its way up and down at rapid speed and about a second of starts and stops
    retract = (2 * (levels.retract - levels.top) + 2 * step) / levels.rapid + 1.0 / 60
    drop = step + levels.entry_height(levels.top) - levels.top
    return ClearingSettings(
        tool_radius=tool.radius,
        wall=tool.radius + operation.radial_allowance - FITTING,
        stepover=operation.stepover_fraction * tool.diameter,
        engagement=operation.engagement_angle_radians,
        tolerance=job.tolerance * WALL_FIT,
        entry=operation.entry,
        slope=operation.ramp_angle_radians,
        drop=drop,
        step=step,
        climb=operation.direction != "conventional",
        both=operation.direction == "both",
        finish=operation.finish_pass,
        fast_links=feeds.link > feeds.cut,
        minimum_radius=operation.minimum_path_radius * tool.diameter,
        longest_walk=retract * feeds.link,
        link_speed=feeds.link / levels.rapid,
        passes=passes,
    )


def _start(start: Sequence[float] | None, levels: Levels) -> tuple[float, float, float]:
    if start is None:
        return (math.nan, math.nan, levels.clearance)
    height = float(start[2]) if len(start) > 2 else levels.clearance
    return (float(start[0]), float(start[1]), height)


def _pockets(
    axes: Sequence[MedialAxis],
    operation: Operation,
    tool: Tool,
    settings: ClearingSettings,
    findings: list[Finding],
) -> list[tuple[int, PocketPlan]]:
    """All pockets of all regions that the tool fits into, each with the number of its region."""
    strategy = _STRATEGIES[operation.strategy]()
    found: list[tuple[int, PocketPlan]] = []
    widest: tuple[float, FloatArray] | None = None
    for number, axis in enumerate(axes):
        centre, radius = axis.largest_disk()
        if widest is None or radius > widest[0]:
            widest = (float(radius), np.asarray(centre))
        if radius < settings.wall:
            findings.append(_misfit(axis, float(radius), np.asarray(centre), operation, tool))
            continue
        pockets, noticed = strategy(axis, settings)
        found += [(number, pocket) for pocket in pockets]
        # what holds for all regions alike is said once
        findings += [item for item in noticed if item.place is not None or item not in findings]
    if not found:
        raise _nothing_fits(widest, findings, operation, tool)
    return found


def _place(point: FloatArray) -> tuple[float, float]:
    return (float(point[0]), float(point[1]))


def _misfit(
    axis: MedialAxis, radius: float, centre: FloatArray, operation: Operation, tool: Tool
) -> Finding:
    largest = 2 * (radius - operation.radial_allowance)
    return Finding(
        Severity.WARNING,
        "tool-too-large",
        f"tool {tool.number} ({tool.diameter:g} mm) does not fit into this region of "
        f"{axis.region.area:.6g} mm2; the largest that does has {max(largest, 0.0):.6g} mm",
        place=_place(centre),
        size=float(axis.region.area),
    )


def _nothing_fits(
    widest: tuple[float, FloatArray] | None,
    findings: Sequence[Finding],
    operation: Operation,
    tool: Tool,
) -> PlanningError:
    if widest is None:
        return PlanningError("the operation has no region", remedy="check layers")
    if any(finding.code == "needs-plunge" for finding in findings):
        return PlanningError(
            f"tool {tool.number} ({tool.diameter:g} mm) can only plunge into the pockets, which "
            "are as wide as it",
            place=_place(widest[1]),
            remedy='set entry = "plunge" or take a smaller tool',
        )
    largest = max(2 * (widest[0] - operation.radial_allowance), 0.0)
    # downwards, but not for what is rounding alone
    rounded = math.floor(largest * 1e4 + 1e-2) / 1e4
    allowance = f" with {operation.radial_allowance:g} mm allowance"
    return PlanningError(
        f"tool {tool.number} ({tool.diameter:g} mm) fits nowhere"
        + (allowance if operation.radial_allowance else ""),
        place=_place(widest[1]),
        remedy=f"the largest tool that fits has {rounded:.6g} mm, there",
    )


def _machine(
    pockets: Sequence[tuple[int, PocketPlan]], emitter: Emitter, floors: FloatArray
) -> None:
    """Each pocket to its full depth, in an order of short travels; ends at clearance height."""
    here = emitter.place
    known = bool(np.all(np.isfinite(here)))
    peaks = np.array([pocket.peak for _, pocket in pockets])
    last = -1
    for index in tour(peaks, here if known else None).tolist():
        region, pocket = pockets[index]
        here = emitter.place
        pocket.plan(here if np.all(np.isfinite(here)) else pocket.peak)
        height = emitter.levels.retract if region == last else emitter.levels.clearance
        emitter.travel(pocket.strokes[0].path.start, height)
        emitter.passes(pocket.strokes, pocket.finish, floors)
        last = region
    emitter.travel(emitter.place, emitter.levels.clearance)


def _unreached(reached: Sequence[Reach], tool: Tool, operation: Operation) -> list[Finding]:
    """One finding for each region with stock that the tool cannot reach."""
    return [
        Finding(
            Severity.INFO,
            "unreachable",
            f"tool {tool.number} cannot reach {item.unreachable:.6g} mm2 of {item.area:.6g} mm2; "
            f"the largest piece, {item.largest:.6g} mm2, is here",
            place=item.place,
            size=item.unreachable,
        )
        for item in reached
        if item.place is not None and item.reachable > 0
    ]
