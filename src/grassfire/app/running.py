"""From a job file to files, and from a program file to a judgement or a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from grassfire.app.files import check_folder, write_files
from grassfire.app.stages import (
    Emitted,
    Progress,
    Stopwatch,
    drawing_walls,
    emit,
    judge,
    judged_figures,
    read_drawings,
    unjudged_figures,
)
from grassfire.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grassfire.job import Job
    from grassfire.report import OperationFigures, Report
    from grassfire.toolpath import Program
    from grassfire.verify import Fault, Verification

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RunResult:
    """What a run left behind.

    Attributes
    ----------
    job : Job
    report : Report
    files : mapping of str to Path
        "program" (absent if verification failed; "program 1", "program 2"... where every tool
        has its own), "report" and "preview".
    faults : tuple of str
        One line for each thing that verification objected to; empty if it passed.
    """

    job: Job
    report: Report
    files: Mapping[str, Path]
    faults: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether a program was written."""
        return not self.faults

    @property
    def exit_code(self) -> int:
        """0 for a program, 1 for one that verification refused."""
        return 0 if self.ok else 1


def run(
    job_path: str | Path,
    out: str | Path | None = None,
    post: str | None = None,
    verify: bool = True,
    progress: Progress | None = None,
    startup_seconds: float | None = None,
    split_tools: bool = False,
    units: Literal["mm", "inch"] | None = None,
) -> RunResult:
    """Make a program from a job file, judge it, and write it with its report and picture.

    Parameters
    ----------
    job_path : str or Path
        Job file.
    out : str or Path, optional
        Folder for the files; made if missing. Default: the current folder.
    post : str, optional
        Overrides the job's post.
    verify : bool
        False writes the program unjudged; the report then says so.
    progress : callable, optional
        Called with the name of each stage when it begins.
    startup_seconds : float, optional
        Time spent before the call, for the report.
    split_tools : bool
        Write one program for each run of a tool: `bracket-1-T1.nc`, `bracket-2-T4.nc`. Posts of
        controllers without any stop do so always.
    units : str, optional
        Of the program, "mm" or "inch"; default: those of the post.

    Returns
    -------
    RunResult
        With `ok` False if verification refused the program. Then the report (marked) and the
        picture are written, the program is not, and an older program is left as it was.

    Raises
    ------
    InputError, GeometryError, PlanningError
        If anything in the input cannot be used; nothing is written then.
    """
    from grassfire.job import load_job

    watch = Stopwatch(progress)
    if startup_seconds is not None:
        watch.seconds["start-up"] = startup_seconds
    folder = Path(out) if out is not None else Path()
    with watch.stage("job"):
        job = load_job(job_path)
        job = job.with_post(post) if post is not None else job
        check_folder(folder)
    emitted = emit(job, watch, split_tools=split_tools, units=units)
    with watch.stage("verify"):
        verification = None
        if verify:
            verification = judge(job, emitted.drawings, emitted.program, emitted.step)
    return _deliver(emitted, verification, folder, watch)


def _deliver(
    emitted: Emitted, verification: Verification | None, folder: Path, watch: Stopwatch
) -> RunResult:
    """Write what a run may leave: no program if verification found faults."""
    from grassfire.preview import svg
    from grassfire.report import Report

    job = emitted.job
    faults = () if verification is None else _in_their_files(emitted, verification.faults)
    if verification is None:
        figures = unjudged_figures(emitted)
    else:
        figures = judged_figures(job, verification)
    with watch.stage("preview"):
        title = f"{job.name} (REFUSED, not written)" if faults else job.name
        picture = svg(emitted.program, drawing_walls(emitted.drawings), title=title)
    programs = {} if faults else _program_files(emitted, folder)
    files = {
        **programs,
        "report": folder / f"{job.name}.report.json",
        "preview": folder / f"{job.name}.svg",
    }
    report = Report(
        job=job.name,
        findings=emitted.findings,
        operations=figures,
        seconds=watch.seconds,
        verified=None if verification is None else not faults,
        faults=tuple(fault.to_dict() for fault in faults),
        post=emitted.post.name,
        resolution=None if verification is None else verification.resolution,
        program=", ".join(path.name for path in programs.values()) or None,
    )
    texts = {kind: item.text for kind, item in zip(programs, emitted.texts, strict=False)}
    texts |= {"report": report.to_json(), "preview": picture}
    write_files({path: texts[kind] for kind, path in files.items()})
    return RunResult(job, report, files, tuple(str(fault) for fault in faults))


def _program_files(emitted: Emitted, folder: Path) -> dict[str, Path]:
    """A file for every program: "program", or "program 1" and so on where there are several."""
    paths = [folder / f"{item.name}.{emitted.post.extension}" for item in emitted.texts]
    if len(paths) == 1:
        return {"program": paths[0]}
    return {f"program {count}": path for count, path in enumerate(paths, 1)}


def _in_their_files(emitted: Emitted, faults: tuple[Fault, ...]) -> tuple[Fault, ...]:
    """Faults with the lines of their own program where there are several."""
    if len(emitted.texts) == 1:
        return faults
    found = []
    for fault in faults:
        name, line = emitted.place(fault.line)
        message = f"{fault.message} ({name})"
        found.append(replace(fault, line=line, message=message) if fault.line else fault)
    return tuple(found)


@dataclass(frozen=True)
class Judged:
    """A program that was read from a file, and the judgement on it."""

    job: Job
    program: Program
    walls: Sequence[FloatArray]
    verification: Verification
    figures: tuple[OperationFigures, ...]

    @property
    def faults(self) -> tuple[str, ...]:
        """One line for each thing that verification objected to."""
        return tuple(str(fault) for fault in self.verification.faults)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was read otherwise than every controller would, each with its line."""
        return self.program.findings

    def svg(self, title: str) -> str:
        """The program from above, each fault in a numbered ring."""
        from math import isfinite

        from grassfire.preview import svg

        marks = [
            (fault.place[0], fault.place[1], f"{fault.kind}, line {fault.line}")
            for fault in self.verification.faults
            if isfinite(fault.place[0] + fault.place[1])
        ]
        return svg(self.program, self.walls, title=title, marks=marks)

    def png(self, title: str) -> bytes:
        """The stock from above, coloured by height, with the faults."""
        from grassfire.verify import stock_png

        return stock_png(self.verification, self.walls, title=title)

    def stock(self, name: str) -> bytes:
        """The stock after machining as the bytes of a mesh file: .glb or .stl by its name.

        Without a thickness in the job, the stock goes a fifth of the depth below the deepest cut.
        """
        from grassfire.verify import mesh_file, stock_mesh

        heights = self.verification.height_map
        top, thickness = self.job.stock.top, self.job.stock.thickness
        if thickness is None:
            lowest = min(float(heights.height.min()), top - 0.1)
            thickness = 1.2 * (top - lowest)
        return mesh_file(*stock_mesh(heights, top - thickness), name)


def verify_file(
    program_path: str | Path, job_path: str | Path, progress: Progress | None = None
) -> Judged:
    """Machine the text of a program and judge it by a job.

    Raises
    ------
    InputError
        If the program, the job or its drawing cannot be read.
    """
    from grassfire.job import load_job

    watch = Stopwatch(progress)
    with watch.stage("job"):
        job = load_job(job_path)
    with watch.stage("read"):
        program = _read_program_file(Path(program_path))
        drawings = read_drawings(job)
    with watch.stage("verify"):
        verification = judge(job, drawings, program)
    walls = drawing_walls(drawings)
    return Judged(job, program, walls, verification, judged_figures(job, verification))


def _read_program_file(path: Path) -> Program:
    from grassfire.gcode import read_program

    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError("no such program", source=str(path)) from error
    except OSError as error:
        reason = error.strerror or "unknown reason"
        raise InputError(f"the program cannot be read: {reason}", source=str(path)) from error
    return read_program(_decoded(data, str(path)), source=str(path))


def _decoded(data: bytes, source: str) -> str:
    """Text of a program: UTF-8 (marked or not), UTF-16 by its mark, else one character a byte.

    Only comments may hold anything but ASCII, so the last choice cannot change a word of code.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return data.decode("utf-16")
        except UnicodeDecodeError as error:
            raise InputError(
                "the program is cut off in the middle of a character",
                source=source,
                remedy="save it again as plain text",
            ) from error
    if b"\0" in data:
        raise InputError(
            "the program is not text", source=source, remedy="save it as plain text (UTF-8)"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def preview(
    path: str | Path,
    job_path: str | Path | None = None,
    progress: Progress | None = None,
    notes: list[str] | None = None,
) -> str:
    """SVG of a job (planned, written and read back, not judged) or of a program.

    Parameters
    ----------
    path : str or Path
        A job file, known by its ending ``.toml``, or a program.
    job_path : str or Path, optional
        With a program: the job whose pocket walls are drawn with it.
    progress : callable, optional
        Called with the name of each stage when it begins.
    notes : list of str, optional
        Gets what was read otherwise than every controller would, each with its line.
    """
    from grassfire.job import load_job
    from grassfire.preview import svg

    watch = Stopwatch(progress)
    path = Path(path)
    if path.suffix.lower() == ".toml":
        emitted = emit(load_job(path), watch)
        return svg(emitted.program, drawing_walls(emitted.drawings), title=emitted.job.name)
    drawings = () if job_path is None else read_drawings(load_job(job_path))
    program = _read_program_file(path)
    if notes is not None:
        notes.extend(program.findings)
    return svg(program, drawing_walls(drawings), title=path.name)
