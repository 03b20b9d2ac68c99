"""The stages from a job to a judged program, in the order in which they run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Literal

from grassfire.errors import GeometryError, InputError, PlanningError
from grassfire.tolerance import ANGULAR, MEDIAL

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grassfire.dxf import Drawing
    from grassfire.geometry import Region
    from grassfire.job import Job, Operation
    from grassfire.medial import MedialAxis
    from grassfire.plan import PlannedOperation
    from grassfire.post import Post, PostProcessor
    from grassfire.report import Finding, OperationFigures
    from grassfire.toolpath import Program
    from grassfire.verify import Target, Verification

    FloatArray = NDArray[np.float64]

Progress = Callable[[str], None]
"""Called with the name of each stage when it begins."""


TARGET_TOLERANCE: Final = 1e-4
"""How far the polygons that programs are judged by may be off the drawn curves, mm."""


FLOOR_TOLERANCE: Final = 1e-3
"""How far below the floor a program may cut where its numbers allow that precision, mm."""


PICTURE_TOLERANCE: Final = 0.01
"""How far the walls in pictures may be off the drawn curves, mm."""


@dataclass
class Stopwatch:
    """Seconds per stage, in the order in which the stages ran."""

    progress: Progress | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the block as part of stage `name`."""
        if self.progress is not None:
            self.progress(name)
        begin = time.perf_counter()
        try:
            yield
        finally:
            passed = time.perf_counter() - begin
            self.seconds[name] = self.seconds.get(name, 0.0) + passed


@dataclass(frozen=True)
class PlannedJob:
    """The drawing and the plan of each operation, and the moves of all."""

    drawings: tuple[Drawing, ...]
    planned: tuple[PlannedOperation, ...]
    program: Program


@dataclass(frozen=True)
class ProgramText:
    """One text for the controller; `first_line` is its first line in the numbering of all."""

    name: str
    text: str
    first_line: int = 1


@dataclass(frozen=True)
class Emitted:
    """Programs as text and as the reader understands that text, with what led to it.

    There is one text, or one for each run of a tool; `program` is all of them in one.
    """

    job: Job
    post: Post | PostProcessor
    drawings: tuple[Drawing, ...]
    planned: tuple[PlannedOperation, ...]
    texts: tuple[ProgramText, ...]
    program: Program
    findings: tuple[Finding, ...]

    @property
    def step(self) -> float:
        """Distance of neighbouring numbers of the text, mm; 0 where the post does not tell."""
        from grassfire.post import Post

        return self.post.scale * 10.0**-self.post.decimals if isinstance(self.post, Post) else 0.0

    def place(self, line: int) -> tuple[str, int]:
        """File name and line in it, for a line in the numbering of all texts."""
        own = [text for text in self.texts if text.first_line <= line][-1:] or self.texts[:1]
        return f"{own[0].name}.{self.post.extension}", line - own[0].first_line + 1


def _unique(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings without repetition: operations may read the same drawing more than once."""
    return tuple(dict.fromkeys(findings))


def _operation_layers(job: Job, operation: Operation) -> tuple[str, ...]:
    return tuple(operation.layers) or tuple(job.input.layers)


def read_drawings(job: Job) -> tuple[Drawing, ...]:
    """The drawing of each operation; operations on the same layers share one."""
    from grassfire.dxf import read_regions

    known: dict[tuple[str, ...], Drawing] = {}
    for operation in job.operations:
        layers = _operation_layers(job, operation)
        if layers not in known:
            known[layers] = read_regions(
                job.input.file,
                layers=layers,
                units=job.input.units,
                chaining_tolerance=job.input.chaining_tolerance,
            )
    return tuple(known[_operation_layers(job, operation)] for operation in job.operations)


def _contact(region: Region) -> tuple[float, float] | None:
    """Where two contours of a region touch, mm; None where all are apart."""
    import shapely

    from grassfire.geometry import flatten

    lines = [shapely.LineString(flatten(loop, TARGET_TOLERANCE)) for loop in region.loops]
    first, second = shapely.STRtree(lines).query(
        lines, predicate="dwithin", distance=4 * TARGET_TOLERANCE
    )
    for one, other in sorted(zip(first.tolist(), second.tolist(), strict=True)):
        if one < other:
            x, y = shapely.get_coordinates(shapely.shortest_line(lines[one], lines[other]))[0]
            # rounding alone shows as 1e-15
            return round(float(x), 9) + 0.0, round(float(y), 9) + 0.0
    return None


def axis_of(region: Region, source: str, tolerance: float = MEDIAL) -> MedialAxis:
    """The medial axis of a region; an error names the drawing and what to do about it."""
    from grassfire.medial import medial_axis

    try:
        return medial_axis(region, tolerance, ANGULAR)
    except GeometryError as error:
        contact = _contact(region)
        if contact is not None:
            raise GeometryError(
                "no certain medial axis: contours touch",
                source=error.source or source,
                place=contact,
                remedy="draw what touches as one contour, or move it apart",
            ) from error
        raise GeometryError(
            f"no certain medial axis: {error.message}",
            source=error.source or source,
            place=error.place,
            remedy=error.remedy or "redraw the contour there, or leave it out by its layer",
        ) from error


def _axes(drawings: Sequence[Drawing], source: str) -> tuple[tuple[MedialAxis, ...], ...]:
    """The medial axes of the regions of each drawing; shared where the drawing is."""
    known: dict[int, tuple[MedialAxis, ...]] = {}
    for drawing in drawings:
        if id(drawing) not in known:
            known[id(drawing)] = tuple(axis_of(region, source) for region in drawing.regions)
    return tuple(known[id(drawing)] for drawing in drawings)


def machining_order(job: Job, drawings: Sequence[Drawing]) -> list[int]:
    """Numbers of the operations in an order that saves tool changes.

    An operation stays behind every earlier one whose regions it may touch, so that a pocket is
    always machined in the order of the job.
    """
    from grassfire.plan.order import by_tool

    boxes = [[region.bounds() for region in drawing.regions] for drawing in drawings]
    earlier = [
        frozenset(before for before in range(index) if _overlap(boxes[before], boxes[index]))
        for index in range(len(boxes))
    ]
    return by_tool([operation.tool for operation in job.operations], earlier)


def _overlap(
    one: Sequence[tuple[float, float, float, float]],
    other: Sequence[tuple[float, float, float, float]],
) -> bool:
    """Whether any two upright boxes of two lists have a point in common."""
    return any(
        first[0] <= second[2]
        and second[0] <= first[2]
        and first[1] <= second[3]
        and second[1] <= first[3]
        for first in one
        for second in other
    )


def _plan(
    job: Job, axes: Sequence[Sequence[MedialAxis]], order: Sequence[int]
) -> tuple[Program, tuple[PlannedOperation, ...]]:
    """One section per operation, in the given order; the plans in that of the job."""
    from grassfire.plan import plan_operation
    from grassfire.toolpath import Program, Section

    sections: list[Section] = []
    planned: dict[int, PlannedOperation] = {}
    source = str(job.path) if job.path is not None else None
    for index in order:
        operation = job.operations[index]
        tool = job.tool(operation.tool)
        try:
            result = plan_operation(axes[index], operation, tool, job)
        except PlanningError as error:
            raise PlanningError(
                f"operations[{index}]: {error.message}",
                source=error.source or source,
                place=error.place,
                remedy=error.remedy,
            ) from error
        planned[index] = result
        sections.append(
            Section(
                toolpath=result.toolpath,
                tool_number=tool.number,
                tool_diameter=tool.diameter,
                spindle_speed=tool.spindle_speed,
                operation=index,
                name=operation.name or operation.strategy,
                coolant=tool.coolant,
            )
        )
    results = tuple(planned[index] for index in range(len(job.operations)))
    return Program(job.name, tuple(sections)), results


def plan_job(job: Job, watch: Stopwatch) -> PlannedJob:
    """Read the drawings and plan all operations.

    Raises
    ------
    InputError, GeometryError, PlanningError
        If the drawing, a region or an operation cannot be used.
    """
    with watch.stage("read"):
        drawings = read_drawings(job)
    with watch.stage("medial"):
        axes = _axes(drawings, str(job.input.file))
    with watch.stage("plan"):
        program, planned = _plan(job, axes, machining_order(job, drawings))
    return PlannedJob(drawings, planned, program)


def choose_post(job: Job, units: Literal["mm", "inch"] | None = None) -> Post | PostProcessor:
    """The post of a job, in other units than its own if asked for.

    Raises
    ------
    InputError
        If there is no such post, or it is a class that offers no choice of units.
    """
    from grassfire.post import Post, load_post

    try:
        post = load_post(job.post, base_dir=job.directory)
    except InputError as error:
        if error.source is not None or job.path is None:
            raise
        raise InputError(error.message, source=str(job.path), remedy=error.remedy) from error
    if units is None:
        return post
    if not isinstance(post, Post):
        raise InputError(f"post {job.post!r} offers no choice of units", remedy="leave it out")
    return post.in_units(units)


def emit(
    job: Job,
    watch: Stopwatch,
    *,
    split_tools: bool = False,
    units: Literal["mm", "inch"] | None = None,
) -> Emitted:
    """Everything up to the text of the program, read back; nothing is written.

    `split_tools` makes one program for each run of a tool, `units` overrides those of the post.

    Raises
    ------
    InputError, GeometryError, PlanningError
        If the post, the drawing, a region or an operation cannot be used.
    """
    from grassfire.post import Post, split_by_tool
    from grassfire.report import Finding, Severity

    with watch.stage("post"):
        post = choose_post(job, units)
    plan = plan_job(job, watch)
    notes: list[str] = []
    split = split_tools or (isinstance(post, Post) and post.tool_change.split)
    programs = split_by_tool(plan.program) if split else (plan.program,)
    with watch.stage("post"):
        texts = _texts(job, post, programs, notes)
    with watch.stage("read back"):
        program_read = _read_back(texts, job.name, post.extension)
    found = [finding for drawing in plan.drawings for finding in drawing.findings]
    found += [finding for planned in plan.planned for finding in planned.findings]
    found += [Finding(Severity.INFO, "post", note) for note in notes]
    return Emitted(job, post, plan.drawings, plan.planned, texts, program_read, _unique(found))


def _texts(
    job: Job, post: Post | PostProcessor, programs: Sequence[Program], notes: list[str]
) -> tuple[ProgramText, ...]:
    """Every program in the words of the post."""
    from grassfire.post import render

    texts: list[ProgramText] = []
    line = 1
    for program in programs:
        text = render(
            program,
            post,
            clearance_height=job.clearance_height,
            tolerance=job.tolerance,
            findings=notes,
        )
        texts.append(ProgramText(program.name, text, line))
        line += text.count("\n")
    return tuple(texts)


def _read_back(texts: Sequence[ProgramText], name: str, extension: str) -> Program:
    """All texts as the reader understands them, in one program with lines counted through."""
    from grassfire.gcode import read_program

    programs = [read_program(item.text, source=f"{item.name}.{extension}") for item in texts]
    sections = tuple(
        replace(
            section,
            toolpath=replace(section.toolpath, line=section.toolpath.line + (item.first_line - 1)),
        )
        for item, program in zip(texts, programs, strict=True)
        for section in program.sections
    )
    findings = tuple(note for program in programs for note in program.findings)
    return replace(programs[0], name=name, sections=sections, findings=findings)


def targets_of(job: Job, drawings: Sequence[Drawing]) -> tuple[Target, ...]:
    """What each operation must leave: the drawn pockets, depths, tools, allowances, limits."""
    from shapely.geometry import MultiPolygon

    from grassfire.verify import Target

    targets = []
    for index, (operation, drawing) in enumerate(zip(job.operations, drawings, strict=True)):
        tool = job.tool(operation.tool)
        cutting = max(tool.feed * operation.chip_thinning_factor, tool.plunge_feed)
        targets.append(
            Target(
                operation=index,
                region=MultiPolygon(
                    [_polygon(region, TARGET_TOLERANCE) for region in drawing.regions]
                ),
                depth=operation.depth,
                tool_radius=tool.radius,
                radial_allowance=operation.radial_allowance,
                axial_allowance=operation.axial_allowance,
                stock_top=job.stock.top,
                entry=operation.entry,
                stepdown=operation.stepdown,
                tool_number=tool.number,
                flute_length=tool.flute_length,
                shank_radius=_half(tool.shank_diameter),
                stickout=tool.stickout,
                holder_radius=_half(tool.holder_diameter),
                # The post rounds feeds.
                cutting_feed=1.001 * cutting,
                max_feed=1.001 * max(cutting, operation.link_feed or 0.0),
            )
        )
    return tuple(targets)


def _half(diameter: float | None) -> float | None:
    return None if diameter is None else diameter / 2


def _clock(job: Job) -> dict[str, Any]:
    """The settings of the time estimate."""
    machine = job.machine
    return {
        "rapid": machine.rapid,
        "acceleration": machine.acceleration,
        "junction_deviation": machine.junction_deviation,
        "arc_tolerance": machine.arc_tolerance,
        "path_tolerance": machine.path_tolerance,
    }


def _polygon(region: Region, tolerance: float) -> Any:
    """A region as a shapely polygon, within `tolerance` mm of its curves."""
    from shapely.geometry import Polygon

    from grassfire.geometry import flatten

    return Polygon(
        flatten(region.outer, tolerance),
        [flatten(island, tolerance) for island in region.islands],
    )


def drawing_walls(drawings: Iterable[Drawing]) -> list[FloatArray]:
    """Walls of drawings that operations may share, each once."""
    unique = {id(drawing): drawing for drawing in drawings}
    return walls_of(region for drawing in unique.values() for region in drawing.regions)


def walls_of(regions: Iterable[Region]) -> list[FloatArray]:
    """Closed polylines of all boundaries, for pictures."""
    from grassfire.geometry import flatten

    return [flatten(loop, PICTURE_TOLERANCE) for region in regions for loop in region.loops]


def judge(
    job: Job, drawings: Sequence[Drawing], program: Program, step: float = 0.0
) -> Verification:
    """Machine a program that was read from text and compare with what the job asks for.

    `step` is the distance of neighbouring numbers of the text, mm: heights may be half of it off.
    """
    from grassfire.verify import MachineLimits, verify

    return verify(
        program,
        targets_of(job, drawings),
        **_clock(job),
        limits=MachineLimits(job.machine.travel, job.machine.rapid_height),
        fitting_tolerance=job.tolerance,
        stock_top=job.stock.top,
        floor_tolerance=max(FLOOR_TOLERANCE, 0.55 * step),
    )


def judged_figures(job: Job, verification: Verification) -> tuple[OperationFigures, ...]:
    operations = job.operations
    return tuple(
        result.figures(
            operations[result.operation].strategy,
            operations[result.operation].tool,
            operations[result.operation].name,
        )
        for result in verification.operations
    )


def unjudged_figures(emitted: Emitted) -> tuple[OperationFigures, ...]:
    """What can be counted without machining: moves, lengths, time, and the plan's areas."""
    from grassfire.report import OperationFigures
    from grassfire.verify import count_program

    job = emitted.job
    counts = count_program(
        emitted.program,
        targets_of(job, emitted.drawings),
        **_clock(job),
        stock_top=job.stock.top,
    )
    return tuple(
        OperationFigures(
            strategy=operation.strategy,
            tool=operation.tool,
            name=operation.name,
            reachable_area_mm2=plan.reachable_area,
            unreachable_area_mm2=plan.unreachable_area,
            **vars(counts[index]),
        )
        for index, (operation, plan) in enumerate(zip(job.operations, emitted.planned, strict=True))
    )
