"""The stages from a job to a judged program, in the order in which they run."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from grassfire.errors import GeometryError, PlanningError
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
class Emitted:
    """A program as text and as the reader understands that text, with what led to it."""

    job: Job
    post: Post | PostProcessor
    drawings: tuple[Drawing, ...]
    planned: tuple[PlannedOperation, ...]
    text: str
    program: Program
    findings: tuple[Finding, ...]


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


def axis_of(region: Region, source: str, tolerance: float = MEDIAL) -> MedialAxis:
    """The medial axis of a region; an error names the drawing and what to do about it."""
    from grassfire.medial import medial_axis

    try:
        return medial_axis(region, tolerance, ANGULAR)
    except GeometryError as error:
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


def _plan(
    job: Job, axes: Sequence[Sequence[MedialAxis]]
) -> tuple[Program, tuple[PlannedOperation, ...]]:
    """One section per operation, each starting where the one before it ended."""
    from grassfire.plan import plan_operation
    from grassfire.toolpath import Program, Section

    sections: list[Section] = []
    planned: list[PlannedOperation] = []
    source = str(job.path) if job.path is not None else None
    for index, (operation, own_axes) in enumerate(zip(job.operations, axes, strict=True)):
        tool = job.tool(operation.tool)
        try:
            result = plan_operation(own_axes, operation, tool, job)
        except PlanningError as error:
            raise PlanningError(
                f"operations[{index}]: {error.message}",
                source=error.source or source,
                place=error.place,
                remedy=error.remedy,
            ) from error
        planned.append(result)
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
    return Program(job.name, tuple(sections)), tuple(planned)


def emit(job: Job, watch: Stopwatch) -> Emitted:
    """Everything up to the text of the program, read back; nothing is written.

    Raises
    ------
    InputError, GeometryError, PlanningError
        If the post, the drawing, a region or an operation cannot be used.
    """
    from grassfire.post import load_post, render
    from grassfire.report import Finding, Severity

    with watch.stage("post"):
        post = load_post(job.post, base_dir=job.directory)
    with watch.stage("read"):
        drawings = read_drawings(job)
    with watch.stage("medial"):
        axes = _axes(drawings, str(job.input.file))
    with watch.stage("plan"):
        program, planned = _plan(job, axes)
    notes: list[str] = []
    with watch.stage("post"):
        text = render(
            program,
            post,
            clearance_height=job.clearance_height,
            tolerance=job.tolerance,
            findings=notes,
        )
    with watch.stage("read back"):
        from grassfire.gcode import read_program

        program_read = read_program(text, source=f"{job.name}.{post.extension}")
    found = [finding for drawing in drawings for finding in drawing.findings]
    found += [finding for plan in planned for finding in plan.findings]
    found += [Finding(Severity.INFO, "post", note) for note in notes]
    return Emitted(job, post, drawings, planned, text, program_read, _unique(found))


def targets_of(job: Job, drawings: Sequence[Drawing]) -> tuple[Target, ...]:
    """What each operation must leave: the drawn pockets, depths, tools, allowances, limits."""
    from shapely.geometry import MultiPolygon

    from grassfire.verify import Target

    targets = []
    for index, (operation, drawing) in enumerate(zip(job.operations, drawings, strict=True)):
        tool = job.tool(operation.tool)
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
                # The post rounds feeds.
                max_feed=1.001 * max(tool.feed, tool.plunge_feed, operation.link_feed or 0.0),
            )
        )
    return tuple(targets)


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


def judge(job: Job, drawings: Sequence[Drawing], program: Program) -> Verification:
    """Machine a program that was read from text and compare with what the job asks for."""
    from grassfire.verify import verify

    return verify(
        program,
        targets_of(job, drawings),
        rapid=job.machine.rapid,
        acceleration=job.machine.acceleration,
        junction_deviation=job.machine.junction_deviation,
        fitting_tolerance=job.tolerance,
        stock_top=job.stock.top,
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
        rapid=job.machine.rapid,
        acceleration=job.machine.acceleration,
        junction_deviation=job.machine.junction_deviation,
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
