"""Toolpaths for the pockets of `pockets.py`, judged from their text, beside other programs'.

    python benchmarks/toolpaths.py --only star --strategy adaptive --stepover 0.4
    python benchmarks/toolpaths.py --jobs 2 --out rows.jsonl --table docs/toolpaths.md
    python benchmarks/toolpaths.py --read rows.jsonl --peers DIR --table docs/toolpaths.md

Each pocket is drawn, written as DXF, and milled 6 mm deep in three passes by a job like those of
the peers: 1200 mm/min, plunges at 400, rapids and links at 5000 mm/min, retracts to 5 mm. The
program is then judged by a ruler that knows its text alone. The exit code is 1 if a bar is missed.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

Row = dict[str, Any]
DEPTH, PASSES = 6.0, 3
STEPDOWN = DEPTH / PASSES
FEED = 1200.0
RESOLUTION = 1e-4
"""Last decimal of the programs, mm."""

JUDGE = Path(__file__).resolve().parents[2] / "shared" / "tools" / "gcode_judge.py"
"""The judge that is used, if it is there, unless another one is named."""

STRATEGIES = ("offset", "spiral", "adaptive")
STEPOVERS = (0.4, 0.2)

JOB = """\
name = "{name}"
post = "linuxcnc"
[input]
file = "{name}.dxf"
[heights]
clearance = 5.0
retract = 5.0
[machine]
rapid = 5000
acceleration = 500
[[tools]]
number = 1
diameter = {diameter}
spindle_speed = 18000
feed = {feed}
plunge_feed = 400
[[operations]]
strategy = "{strategy}"
tool = 1
depth = {depth}
stepdown = {stepdown}
stepover = {stepover}
direction = "{direction}"
entry = "helix"
ramp_angle = {ramp_angle}
finish_pass = {finish_pass}
link_feed = 5000
"""


@dataclass(frozen=True)
class Task:
    """One program to make and to judge."""

    pocket: str
    strategy: str
    stepover: float
    ramp_angle: float
    judge: Path | None
    keep: Path | None
    program: Path | None
    finish_pass: bool
    direction: str = "climb"


def engagement_limit(stepover: float) -> float:
    """Engagement of a straight cut of a stepover (fraction of the diameter), degrees."""
    return math.degrees(math.acos(1.0 - 2.0 * stepover))


def make_program(task: Task, folder: Path) -> tuple[str, dict[str, float]]:
    """Draw, plan and write a program.

    Returns
    -------
    text : str
    seconds : dict
        Processor time by stage.
    """
    from pockets import pocket, write_dxf

    from grassfire.app.stages import Stopwatch, axis_of
    from grassfire.dxf import read_regions
    from grassfire.job import load_job
    from grassfire.plan import plan_operation
    from grassfire.post import load_post, render
    from grassfire.toolpath import Program, Section

    class ProcessorStopwatch(Stopwatch):
        """Processor time instead of the wall clock's."""

        @contextmanager
        def stage(self, name: str) -> Iterator[None]:
            begin = time.process_time()
            try:
                yield
            finally:
                passed = time.process_time() - begin
                self.seconds[name] = self.seconds.get(name, 0.0) + passed

    shape = pocket(task.pocket)
    name = f"{task.strategy}-{task.pocket}-{round(100 * task.stepover)}"
    write_dxf(shape.region, folder / f"{name}.dxf")
    (folder / f"{name}.toml").write_text(job_text(task, name, shape.diameter), encoding="utf-8")
    watch = ProcessorStopwatch()
    job = load_job(folder / f"{name}.toml")
    operation, tool = job.operations[0], job.tools[0]
    with watch.stage("read"):
        regions = read_regions(job.input.file).regions
    with watch.stage("medial"):
        axes = [axis_of(region, name) for region in regions]
    with watch.stage("plan"):
        planned = plan_operation(axes, operation, tool, job)
    with watch.stage("post"):
        section = Section(
            toolpath=planned.toolpath,
            tool_number=tool.number,
            tool_diameter=tool.diameter,
            spindle_speed=tool.spindle_speed,
            operation=0,
            name=task.strategy,
            coolant=tool.coolant,
        )
        text = render(
            Program(job.name, (section,)),
            load_post(job.post),
            clearance_height=job.clearance_height,
            tolerance=job.tolerance,
        )
    (folder / f"{name}.ngc").write_text(text, encoding="utf-8")
    return text, watch.seconds


def job_text(task: Task, name: str, diameter: float) -> str:
    """The job file of a task."""
    return JOB.format(
        name=name,
        diameter=diameter,
        feed=FEED,
        strategy=task.strategy,
        depth=DEPTH,
        stepdown=STEPDOWN,
        stepover=task.stepover,
        ramp_angle=task.ramp_angle,
        finish_pass=json.dumps(task.finish_pass),
        direction=task.direction,
    )


def attempt(task: Task) -> Row:
    """One row: a program with its figures, or why there is none."""
    import grassfire.medial
    import grassfire.plan  # noqa: F401  (loading is no planning)
    from grassfire.errors import GrassfireError

    row: Row = {
        "pocket": task.pocket,
        "strategy": task.strategy,
        "direction": task.direction,
        "stepover": task.stepover,
    }
    if task.program is not None:
        return {**row, **figures_of(task.program.read_text(encoding="utf-8"), task)}
    with tempfile.TemporaryDirectory() as scratch:
        folder = task.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        try:
            text, seconds = make_program(task, folder)
        except GrassfireError as error:
            return {**row, "failure": str(error)}
    row["seconds"] = {stage: round(value, 4) for stage, value in seconds.items()}
    row["planning_s"] = round(seconds["medial"] + seconds["plan"], 4)
    return {**row, **figures_of(text, task)}


def figures_of(text: str, task: Task) -> Row:
    """Figures of a program's text."""
    from pockets import pocket
    from toolpaths_moves import (
        fast_length,
        lap_distance,
        largest_turn,
        read_moves,
        steepest_descent,
    )
    from toolpaths_ruler import load_judge, rule, rule_by_raster

    shape = pocket(task.pocket)
    polygon = shape.polygon()
    asked = (text, polygon, DEPTH, shape.diameter / 2, STEPDOWN)
    ruling = rule(load_judge(task.judge), *asked) if task.judge else rule_by_raster(*asked)
    figures, samples = dict(ruling.figures), ruling.samples
    limit = engagement_limit(task.stepover)
    moves = read_moves(text)
    step = task.stepover * shape.diameter
    fast = fast_length(moves, FEED)
    row: Row = {
        "diameter": shape.diameter,
        "limit_deg": limit,
        **{key: value for key, value in figures.items() if key != "lines"},
        "errors": list(figures["errors"])[:3],
        "program_lines": sum(1 for line in text.splitlines() if line.strip()),
        "above_limit_mm": samples.length_above(limit),
        "longest_above_limit_mm": samples.longest(limit),
        "longest_above_bar_mm": samples.longest(limit + 6.0),
        "longest_slot_mm": samples.longest(150.0),
        "worst_place": samples.worst() if len(samples.angle) else None,
        "link_mm": fast,
        "cut_ratio": figures["cut_mm"] / (PASSES * polygon.area / step),
        "slow_ratio": (figures["cut_mm"] - fast) / (PASSES * polygon.area / step),
        "descent_deg": steepest_descent(moves),
    }
    row["turn_deg"], row["turn_line"] = largest_turn(moves, RESOLUTION)
    if task.strategy == "spiral":
        lap, place = lap_distance(moves, polygon, -DEPTH, shape.diameter / 2)
        row["lap_mm"], row["lap_bar_mm"], row["lap_place"] = lap, step, place
        row["one_lobe"] = shape.one_lobe
    return row


def main(arguments: Sequence[str] | None = None) -> int:
    """Make, judge, print, save."""
    from pockets import names
    from toolpaths_tables import faults, line_of, markdown, read_rows

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=names(), metavar="NAME", help="pockets")
    parser.add_argument("--first", type=int, help="only so many pockets; 10: the known ones")
    parser.add_argument("--strategy", nargs="+", choices=STRATEGIES, default=list(STRATEGIES))
    parser.add_argument("--stepover", nargs="+", type=float, default=list(STEPOVERS))
    parser.add_argument("--ramp-angle", type=float, default=3.0, help="of entries, degrees")
    parser.add_argument(
        "--finish-pass",
        choices=("yes", "no"),
        help="wall pass at the end; default: no for offset, yes for others, like the peers",
    )
    parser.add_argument(
        "--direction", choices=("climb", "conventional", "both"), default="climb", help="of cuts"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--judge",
        default=str(JUDGE) if JUDGE.is_file() else "",
        help="Python file with measure(); empty: the ruler that comes with the benchmark",
    )
    parser.add_argument("--keep", type=Path, help="leave drawings, jobs and programs here")
    parser.add_argument("--program", type=Path, help="judge this instead of making one")
    parser.add_argument("--out", type=Path, help="add rows to this file of JSON lines")
    parser.add_argument("--read", type=Path, help="tabulate these rows instead of making any")
    parser.add_argument("--peers", type=Path, help="folder with results of other programs")
    parser.add_argument("--table", type=Path, help="write Markdown tables here")
    options = parser.parse_args(arguments)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    rows: list[Row] = read_rows(options.read) if options.read else []
    if not options.read:
        chosen = options.only or list(names())[: options.first]
        tasks = [
            Task(
                name,
                strategy,
                step,
                options.ramp_angle,
                Path(options.judge) if options.judge else None,
                options.keep,
                options.program,
                options.finish_pass == "yes" if options.finish_pass else strategy != "offset",
                options.direction,
            )
            for strategy in options.strategy
            for step in options.stepover
            for name in chosen
        ]
        for row in run(tasks, options.jobs):
            rows.append(row)
            print(line_of(row), flush=True)
            if options.out:
                with options.out.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(row) + "\n")
    peers = read_peers(options.peers) if options.peers else []
    if options.table:
        options.table.write_text(markdown(rows, peers), encoding="utf-8")
    missed = [row for row in rows if faults(row)]
    print(f"{len(rows) - len(missed)} of {len(rows)} programs meet all bars")
    return 1 if missed else 0


def run(tasks: Sequence[Task], jobs: int) -> Iterator[Row]:
    """Rows in the order of the tasks."""
    if jobs == 1:
        yield from map(attempt, tasks)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(attempt, tasks)


def read_peers(folder: Path) -> list[Mapping[str, Any]]:
    """Rows of other programs, one JSON file each, under their names of the pockets."""
    from toolpaths_tables import PEER_POCKETS

    rows = []
    for path in sorted(folder.glob("*.json")):
        row = json.loads(path.read_text(encoding="utf-8"))
        rows.append({**row, "pocket": PEER_POCKETS[row["pocket"]]})
    return rows


if __name__ == "__main__":
    sys.exit(main())
