"""The command line: ``grassfire run``, ``inspect``, ``mat``, ``preview``, ``verify`` and more.

Exit codes: 0 done, 1 verification refused a program, 2 bad input or usage, 3 internal error.
Results go to standard output; errors, one line each, and progress go to standard error.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Annotated, Any, Final, Self

import typer

from grassfire.errors import GrassfireError, InputError

if TYPE_CHECKING:
    from rich.table import Table

    from grassfire.app import Progress, RunResult
    from grassfire.report import Finding, OperationFigures

TRACEBACK_VARIABLE: Final = "GRASSFIRE_TRACEBACK"
INTERRUPTED: Final = 130
MOST_ALIKE: Final = 12
"""Lines about findings of one code that are printed; of more the first ones, and how many."""

command = typer.Typer(
    name="grassfire",
    help="Pockets drawn in DXF to verified G-code, by way of the exact medial axis.",
    add_completion=False,
    pretty_exceptions_enable=False,
    # Plain help: setting it in boxes takes as long as all the rest of the start.
    rich_markup_mode=None,
)

OutFolder = Annotated[
    Path | None, typer.Option("--out", help="Folder for the files; default: the current one.")
]
PostName = Annotated[str | None, typer.Option("--post", help="Post to use in place of the job's.")]
NoVerify = Annotated[bool, typer.Option("--no-verify", help="Write the program unjudged.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for machines.")]
Layers = Annotated[
    list[str] | None, typer.Option("--layer", help="Layer, glob pattern; may be repeated.")
]
Units = Annotated[str | None, typer.Option("--units", help="Units of the drawing, e.g. mm or in.")]
JobFile = Annotated[Path, typer.Argument(metavar="JOB.toml", help="Job file.")]
DrawingFile = Annotated[Path, typer.Argument(metavar="FILE.dxf", help="Drawing.")]


@contextmanager
def _progress(quiet: bool = False) -> Iterator[Progress | None]:
    """Stages as they run, on standard error, if somebody is watching."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("starting") as status:
        yield lambda stage: status.update(f"{stage} ...")


def _print_json(data: object) -> None:
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False))


def _save(path: Path, text: str) -> None:
    """Write one output; "-" is standard output."""
    if str(path) == "-":
        typer.echo(text, nl=False)
        return
    from grassfire.app import write_files

    write_files({path: text})


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def _count(number: int, thing: str) -> str:
    """A number of things in words: 1 region, 2 regions."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _operation_line(index: int, figures: OperationFigures) -> str:
    """One operation in words."""
    text = (
        f"operation {index + 1}  {figures.name or figures.strategy}  T{figures.tool}: "
        f"{_count(figures.moves, 'move')}, {figures.cut_length_mm / 1000:.2f} m cut, "
        f"{_duration(figures.time_s)}, reaches {figures.reachable_area_mm2:.1f} mm2"
    )
    if figures.unreachable_area_mm2 > 0.05:
        text += f" of {figures.reachable_area_mm2 + figures.unreachable_area_mm2:.1f}"
    if figures.max_gouge_mm is not None and figures.uncut_area_mm2 is not None:
        text += (
            f", gouge {figures.max_gouge_mm * 1000:.1f} um, uncut {figures.uncut_area_mm2:.2f} mm2"
        )
    if figures.max_engagement_deg is not None:
        text += f", engagement up to {figures.max_engagement_deg:.0f} deg"
    return text


def _print_faults(faults: Iterable[str], source: str) -> None:
    for fault in faults:
        typer.echo(f"{source}: {fault}", err=True)


def _run_data(result: RunResult) -> dict[str, Any]:
    data = result.report.to_dict()
    data["ok"] = result.ok
    data["files"] = {kind: str(path) for kind, path in result.files.items()}
    return data


@command.command()
def run(
    job: JobFile,
    out: OutFolder = None,
    post: PostName = None,
    split_tools: Annotated[
        bool, typer.Option("--split-tools", help="One program for each tool.")
    ] = False,
    inch: Annotated[
        bool, typer.Option("--inch", help="Program in inches (G20), 4 decimals.")
    ] = False,
    no_verify: NoVerify = False,
    as_json: AsJson = False,
) -> int:
    """DXF to verified G-code, report and preview.

    The program is written only if its text, machined by the verifier, is what the job asks for.
    """
    # CPU time so far is the start of the interpreter and of this module.
    startup = time.process_time()
    from grassfire.app import run as run_job

    with _progress(as_json) as progress:
        result = run_job(
            job, out, post, not no_verify, progress, startup, split_tools, "inch" if inch else None
        )
    if as_json:
        _print_json(_run_data(result))
    else:
        _print_run(result)
    if not result.ok:
        _print_faults(result.faults, result.job.name)
        typer.echo(
            f"{job}: verification refused the program, so none was written; see "
            f"{result.files['report']} and {result.files['preview']}; an older program of the "
            "same name was left as it was",
            err=True,
        )
    return result.exit_code


def _print_run(result: RunResult) -> None:
    _print_findings(
        [item for item in result.report.findings if item.severity.rank > 0], "the report has all"
    )
    for index, figures in enumerate(result.report.operations):
        typer.echo(_operation_line(index, figures))
    seconds = result.report.seconds
    stages = ", ".join(f"{name} {value:.2f}" for name, value in seconds.items())
    typer.echo(f"took {sum(seconds.values()):.2f} s ({stages})")
    if result.ok:
        verdict = "verified" if result.report.verified else "NOT VERIFIED"
        typer.echo(f"{verdict}: " + "  ".join(str(path) for path in result.files.values()))


@command.command()
def inspect(
    drawing: DrawingFile,
    layer: Layers = None,
    units: Units = None,
    tool: Annotated[
        list[float] | None, typer.Option("--tool", help="Diameter to look at, mm; repeatable.")
    ] = None,
    as_json: AsJson = False,
) -> int:
    """Regions, necks, and what each tool reaches."""
    from grassfire.app import inspect as inspect_drawing

    if any(not 0 < size < 1e4 for size in tool or ()):
        raise InputError("--tool is a diameter in mm and must be positive")
    with _progress(as_json) as progress:
        found = inspect_drawing(drawing, layer or (), units, tool or (), progress=progress)
    if as_json:
        _print_json(found)
    else:
        _print_inspection(found)
    return 0


def _table(*heads: str) -> Table:
    """A table whose cells stay on one line."""
    from rich import box
    from rich.table import Column, Table

    columns = [Column(head, no_wrap=True, overflow="ignore") for head in heads]
    return Table(*columns, box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)


def _print_inspection(found: Mapping[str, Any]) -> None:
    from rich.console import Console

    from grassfire.report import Finding, Severity

    width = None if sys.stdout.isatty() else 120
    console = Console(highlight=False, soft_wrap=True, width=width)
    console.print(
        f"{found['file']}: {_count(len(found['regions']), 'region')}, "
        f"{found['area_mm2']:.2f} mm2, "
        f"units {found['units']} (from the {found['units_source']}), "
        f"layers {', '.join(found['layers'])}",
        markup=False,
    )
    table = _table("region", "area mm2", "holes", "largest disk, mm", "narrowest neck, mm")
    for index, region in enumerate(found["regions"]):
        disk, neck = (
            "-" if item is None else f"{item['diameter']:.3f} at ({item['x']:.2f}, {item['y']:.2f})"
            for item in (region["largest_disk"], region["narrowest_neck"])
        )
        table.add_row(str(index + 1), f"{region['area_mm2']:.2f}", str(region["holes"]), disk, neck)
    console.print(table)
    console.print()
    table = _table("tool mm", "reaches mm2", "share")
    for row in found["tools"]:
        share = f"{100 * row['share']:.2f} %" if row["share"] > 0 else "fits nowhere"
        table.add_row(f"{row['diameter_mm']:g}", f"{row['reachable_area_mm2']:.2f}", share)
    console.print(table)
    findings = [
        Finding(**(data | {"severity": Severity(data["severity"])})) for data in found["findings"]
    ]
    _print_findings(findings, "--json gives all")


def _print_findings(findings: Sequence[Finding], rest: str) -> None:
    """Print findings a line each; of many with the same code the first ones."""
    count = Counter(finding.code for finding in findings)
    shown: Counter[str] = Counter()
    for finding in findings:
        code = finding.code
        shown[code] += 1
        if count[code] <= MOST_ALIKE or shown[code] < MOST_ALIKE:
            typer.echo(str(finding))
        elif shown[code] == MOST_ALIKE:
            typer.echo(f"... and {count[code] - MOST_ALIKE + 1} more of {code}; {rest}")


@command.command()
def mat(
    drawing: DrawingFile,
    layer: Layers = None,
    units: Units = None,
    tol: Annotated[float, typer.Option("--tol", help="Accuracy, mm.")] = 1e-6,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write JSON; - prints it.")
    ] = None,
    svg_out: Annotated[
        Path | None, typer.Option("--svg", metavar="OUT", help="Write a picture; - prints it.")
    ] = None,
    dxf_out: Annotated[
        Path | None, typer.Option("--dxf", metavar="OUT", help="Write a drawing; - prints it.")
    ] = None,
) -> int:
    """The medial axis transform, certified."""
    from grassfire.app import mat as transform

    with _progress() as progress:
        result = transform(drawing, layer or (), units, tol, progress)
    if json_out is not None:
        _save(json_out, json.dumps(result.data, allow_nan=False) + "\n")
    if svg_out is not None:
        _save(svg_out, result.svg(f"{drawing.name}: medial axis"))
    if dxf_out is not None:
        _save(dxf_out, result.dxf())
    if "-" in (str(json_out), str(svg_out), str(dxf_out)):
        return 0
    for index, region in enumerate(result.data["regions"]):
        certificate = ", ".join(
            f"{key} {value:.1e}" if isinstance(value, float) else f"{key} {value}"
            for key, value in region["certificate"].items()
        )
        typer.echo(
            f"region {index + 1}: area {region['area']:.4f} mm2, "
            f"{_count(region['holes'], 'hole')}, {len(region['vertices'])} vertices, "
            f"{_count(len(region['edges']), 'edge')}; {certificate}"
        )
    typer.echo(f"took {result.data['seconds']:.3f} s")
    return 0


@command.command()
def preview(
    file: Annotated[Path, typer.Argument(metavar="JOB.toml|FILE.nc", help="Job or program.")],
    svg_out: Annotated[
        Path | None,
        typer.Option("--svg", metavar="OUT", help="Picture; - prints it. Default: FILE's .svg."),
    ] = None,
    job: Annotated[
        Path | None, typer.Option("--job", help="With a program: job whose walls to draw.")
    ] = None,
) -> int:
    """Draw a program from its text.

    A job is planned and written out first, but not judged.
    """
    from grassfire.app import preview as draw

    target = Path(file.with_suffix(".svg").name) if svg_out is None else svg_out
    notes: list[str] = []
    with _progress() as progress:
        picture = draw(file, job, progress, notes)
    _save(target, picture)
    for note in notes:
        typer.echo(f"{file}: note: {note}", err=True)
    if str(target) != "-":
        typer.echo(str(target))
    return 0


@command.command()
def verify(
    program: Annotated[Path, typer.Argument(metavar="FILE.nc", help="Program to judge.")],
    job: Annotated[Path, typer.Option("--job", help="Job that says what it must do.")],
    as_json: AsJson = False,
    svg_out: Annotated[
        Path | None,
        typer.Option("--svg", metavar="OUT", help="Picture of the program with its faults."),
    ] = None,
    png_out: Annotated[
        Path | None,
        typer.Option("--png", metavar="OUT", help="Picture of the stock after machining."),
    ] = None,
    stock_out: Annotated[
        Path | None,
        typer.Option("--stock", metavar="OUT", help="Stock after machining, .glb or .stl."),
    ] = None,
) -> int:
    """Judge the text of a program by a job."""
    from grassfire.app import verify_file, write_files

    with _progress(as_json) as progress:
        judged = verify_file(program, job, progress)
    pictures: dict[Path, str | bytes] = {}
    if svg_out is not None:
        pictures[svg_out] = judged.svg(program.name)
    if png_out is not None:
        pictures[png_out] = judged.png(program.name)
    if stock_out is not None:
        pictures[stock_out] = judged.stock(stock_out.name)
    write_files(pictures)
    passed = not judged.faults
    if as_json:
        _print_json(
            {
                "program": str(program),
                "ok": passed,
                "resolution_mm": judged.verification.resolution,
                "operations": [figures.to_dict() for figures in judged.figures],
                "faults": [fault.to_dict() for fault in judged.verification.faults],
                "notes": list(judged.notes),
            }
        )
    else:
        for note in judged.notes:
            typer.echo(f"{program}: note: {note}")
        for index, figures in enumerate(judged.figures):
            typer.echo(_operation_line(index, figures))
        cell = judged.verification.resolution
        typer.echo(f"{program}: {'verified' if passed else 'REFUSED'} (maps of {cell:.3f} mm)")
    _print_faults(judged.faults, str(program))
    return 0 if passed else 1


@command.command()
def posts(as_json: AsJson = False) -> int:
    """List the posts that a job may name."""
    from grassfire.post import find_posts, load_post, registered_posts

    names = sorted({*find_posts(), *registered_posts()})
    loaded = [(name, load_post(name)) for name in names]
    if as_json:
        _print_json(
            [
                {"name": name, "extension": post.extension, "description": post.description}
                for name, post in loaded
            ]
        )
    else:
        width = max(len(name) for name in names)
        for name, post in loaded:
            typer.echo(f"{name:{width}}  .{post.extension}  {post.description}")
    return 0


@command.command()
def init(
    drawing: Annotated[
        Path | None, typer.Argument(metavar="[FILE.dxf]", help="Drawing to start from.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Job file to write; - prints it.")
    ] = None,
    layer: Layers = None,
    units: Units = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema.")] = False,
) -> int:
    """Write a commented job file for a drawing.

    With --schema, print the JSON Schema of job files instead.
    """
    if schema:
        from grassfire.job import json_schema

        _print_json(json_schema())
        return 0
    if drawing is None:
        raise InputError("init needs a drawing", remedy="give FILE.dxf, or --schema")
    from grassfire.app import starter_job

    target = Path(f"{drawing.stem}.toml") if out is None else out
    if str(target) != "-" and target.exists():
        raise InputError("exists already", source=str(target), remedy="choose another --out")
    folder = Path() if str(target) == "-" else target.parent
    with _progress() as progress:
        name = None if str(target) == "-" else target.stem
        text = starter_job(drawing, folder, layer or (), units, progress, name)
    _save(target, text)
    if str(target) != "-":
        typer.echo(f"{target}: set depth, tool, speeds and feeds, then: grassfire run {target}")
    return 0


@command.command()
def batch(
    jobs: Annotated[list[Path], typer.Argument(metavar="JOBS...", help="Job files.")],
    out: OutFolder = None,
    post: PostName = None,
    no_verify: NoVerify = False,
    as_json: AsJson = False,
) -> int:
    """Run several jobs, one line each.

    The exit code is the worst of theirs.
    """
    rows: list[dict[str, Any]] = []
    for job in jobs:
        boundary = _Boundary(prefix="" if as_json else "refused  ")
        row: dict[str, Any] = {"job": str(job)}
        with boundary:
            row |= _batch_row(job, out, post, not no_verify, as_json)
            boundary.code = int(row["exit_code"])
        row["exit_code"] = boundary.code
        rows.append(row)
    if as_json:
        _print_json(rows)
    return max(int(row["exit_code"]) for row in rows)


def _batch_row(
    job: Path, out: Path | None, post: str | None, judged: bool, quiet: bool
) -> dict[str, Any]:
    """Run one job of a batch and say in one line what became of it."""
    from grassfire.app import run as run_job

    with _progress(quiet) as progress:
        result = run_job(job, out, post, judged, progress)
    if not quiet and result.ok:
        duration = _duration(sum(figures.time_s for figures in result.report.operations))
        typer.echo(f"ok       {job}: {result.files['program']}, {duration}")
    elif not quiet:
        typer.echo(f"FAILED   {job}: {result.faults[0]}", err=True)
    return {"exit_code": result.exit_code, **_run_data(result)}


class _Boundary:
    """Turns whatever leaves its block into one line on standard error and an exit code."""

    def __init__(self, prefix: str = "") -> None:
        self.prefix = prefix
        self.code = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        if error is None or isinstance(error, SystemExit | GeneratorExit):
            return False
        self.code, line = _describe(error)
        if os.environ.get(TRACEBACK_VARIABLE):
            traceback.print_exception(kind, error, trace)
        typer.echo(self.prefix + line, err=True)
        return True


def _describe(error: BaseException) -> tuple[int, str]:
    """Exit code and line for an error."""
    if isinstance(error, GrassfireError):
        return error.exit_code, str(error)
    if isinstance(error, KeyboardInterrupt | typer.Abort):
        return INTERRUPTED, "interrupted; nothing was written"
    # Usage errors of the command line parser say what is wrong themselves.
    message = getattr(error, "format_message", None)
    if message is not None:
        return 2, f"{' '.join(str(message()).split())} (grassfire --help)"
    text = " ".join(str(error).split()) or "no message"
    return 3, (
        f"internal error, {type(error).__name__}: {text}; "
        f"--traceback before the command (or {TRACEBACK_VARIABLE}=1) shows where"
    )


def _version(asked: bool) -> None:
    if asked:
        from grassfire import __version__

        typer.echo(f"grassfire {__version__}")
        raise typer.Exit


@command.callback()
def _options(
    show_traceback: Annotated[
        bool, typer.Option("--traceback", help="Show where an error was raised.")
    ] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    if show_traceback:
        os.environ[TRACEBACK_VARIABLE] = "1"


def invoke(arguments: Sequence[str]) -> int:
    """Run a command line; the exit code."""
    boundary = _Boundary()
    asked_before = os.environ.get(TRACEBACK_VARIABLE)
    with boundary:
        code = command(list(arguments), prog_name="grassfire", standalone_mode=False)
        boundary.code = code if isinstance(code, int) else 0
        # The parser takes an interrupt for itself and returns its exit code.
        if boundary.code == INTERRUPTED:
            raise KeyboardInterrupt
    # --traceback is for this command line only.
    if asked_before is None:
        os.environ.pop(TRACEBACK_VARIABLE, None)
    return boundary.code


def main() -> None:
    """Entry point of the command ``grassfire``; without arguments it shows the help."""
    # A command lives for seconds and most of its objects as long: looking for garbage among them
    # after every few hundred new ones takes a tenth of the start.
    gc.set_threshold(100_000, 20, 100)
    # Standard error holds lines for the user; `python -W` brings the libraries' warnings back.
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    code = invoke(sys.argv[1:] or ["--help"])
    # What is left goes with the process: the interpreter need not look for garbage in it first,
    # which takes as long as planning a simple pocket.
    gc.freeze()
    sys.exit(code)
