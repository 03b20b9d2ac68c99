"""From a job file to files, and from a program file to a judgement or a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

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
    from grassfire.job import Job
    from grassfire.report import OperationFigures, Report
    from grassfire.toolpath import Program
    from grassfire.verify import Verification


@dataclass(frozen=True)
class RunResult:
    """What a run left behind.

    Attributes
    ----------
    job : Job
    report : Report
    files : mapping of str to Path
        "program" (absent if verification failed), "report" and "preview".
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
    emitted = emit(job, watch)
    with watch.stage("verify"):
        verification = judge(job, emitted.drawings, emitted.program) if verify else None
    return _deliver(emitted, verification, folder, watch)


def _deliver(
    emitted: Emitted, verification: Verification | None, folder: Path, watch: Stopwatch
) -> RunResult:
    """Write what a run may leave: no program if verification found faults."""
    from grassfire.preview import svg
    from grassfire.report import Report

    job = emitted.job
    faults = () if verification is None else verification.faults
    if verification is None:
        figures = unjudged_figures(emitted)
    else:
        figures = judged_figures(job, verification)
    with watch.stage("preview"):
        title = f"{job.name} (REFUSED, not written)" if faults else job.name
        picture = svg(emitted.program, drawing_walls(emitted.drawings), title=title)
    files = {
        "program": folder / f"{job.name}.{emitted.post.extension}",
        "report": folder / f"{job.name}.report.json",
        "preview": folder / f"{job.name}.svg",
    }
    if faults:
        del files["program"]
    report = Report(
        job=job.name,
        findings=emitted.findings,
        operations=figures,
        seconds=watch.seconds,
        verified=None if verification is None else not faults,
        faults=tuple(fault.to_dict() for fault in faults),
        post=emitted.post.name,
        program=files["program"].name if "program" in files else None,
    )
    texts = {"program": emitted.text, "report": report.to_json(), "preview": picture}
    write_files({path: texts[kind] for kind, path in files.items()})
    return RunResult(job, report, files, tuple(str(fault) for fault in faults))


@dataclass(frozen=True)
class Judged:
    """A program that was read from a file, and the judgement on it."""

    job: Job
    verification: Verification
    figures: tuple[OperationFigures, ...]

    @property
    def faults(self) -> tuple[str, ...]:
        """One line for each thing that verification objected to."""
        return tuple(str(fault) for fault in self.verification.faults)


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
    return Judged(job, verification, judged_figures(job, verification))


def _read_program_file(path: Path) -> Program:
    from grassfire.gcode import read_program

    try:
        text = path.read_text(encoding="utf-8", errors="strict")
    except FileNotFoundError as error:
        raise InputError("no such program", source=str(path)) from error
    except OSError as error:
        reason = error.strerror or "unknown reason"
        raise InputError(f"the program cannot be read: {reason}", source=str(path)) from error
    except UnicodeDecodeError as error:
        raise InputError("the program is not UTF-8 text", source=str(path)) from error
    return read_program(text, source=str(path))


def preview(
    path: str | Path, job_path: str | Path | None = None, progress: Progress | None = None
) -> str:
    """SVG of a job (planned, written and read back, not judged) or of a program.

    Parameters
    ----------
    path : str or Path
        A job file, known by its ending ``.toml``, or a program.
    job_path : str or Path, optional
        With a program: the job whose pocket walls are drawn with it.
    """
    from grassfire.job import load_job
    from grassfire.preview import svg

    watch = Stopwatch(progress)
    path = Path(path)
    if path.suffix.lower() == ".toml":
        emitted = emit(load_job(path), watch)
        return svg(emitted.program, drawing_walls(emitted.drawings), title=emitted.job.name)
    drawings = () if job_path is None else read_drawings(load_job(job_path))
    return svg(_read_program_file(path), drawing_walls(drawings), title=path.name)
