"""Programs from drawings and pockets through LinuxCNC's interpreter and grbl's rules.

    python benchmarks/acceptance.py [COUNT] [--drawings FOLDER] [--seconds 120]

Each drawing of the folder and each pocket of `pockets.py` is planned once, by rings with the first
tool that finds room and by one of the strategies in turn with a smaller one, and written by the
posts whose dialect the interpreter reads, in turn, until COUNT programs (300) are made. A program
is accepted if the interpreter takes it with no arc whose radii differ by more than 0.001 mm, and
right if its motions are the planned ones, every end to the last decimal of the post. Each plan is
also written for grbl and checked by its rules. Needs LCNC_ROOT (see tests/linuxcnc_motions.py).
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from drawings import JOB  # noqa: E402
from pockets import names, pocket, write_dxf  # noqa: E402

from grassfire import GrassfireError  # noqa: E402
from grassfire.app.stages import Stopwatch, plan_job  # noqa: E402
from grassfire.job import load_job  # noqa: E402
from grassfire.post import Post, load_post, render, split_by_tool  # noqa: E402
from grassfire.toolpath import Program  # noqa: E402
from grbl_rules import faults  # noqa: E402
from linuxcnc_motions import DIALECT, MISSING, available, deviation, interpret  # noqa: E402

ARC_TOLERANCE = 0.001  # mm
HALF = 0.51  # of the last decimal: how far a rounded end may be off
POSTS_A_PLAN = 6
WHOLE = ("offset", "spiral", "adaptive")
"""Strategies of the second operation, in turn."""

CLEARANCE = 15.0

AGAIN = """\
[[tools]]
number = 2
diameter = {second}
spindle_speed = 20000
feed = 600
plunge_feed = 150
coolant = "flood"
[[operations]]
name = "again"
strategy = {strategy}
tool = 2
depth = {depth}
stepover = 0.37
"""
"""What follows the job of one operation."""


@dataclass
class Tally:
    """What became of the programs."""

    plans: int = 0
    unplanned: dict[str, str] = field(default_factory=dict)
    programs: dict[str, int] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)
    different: list[str] = field(default_factory=list)
    grbl_programs: int = 0
    grbl_refused: list[str] = field(default_factory=list)
    largest_mismatch: float = 0.0
    largest_end: float = 0.0
    largest_path: float = 0.0

    @property
    def count(self) -> int:
        """Programs that the interpreter was given."""
        return sum(self.programs.values())


def sources(folder: Path, work: Path) -> Iterator[tuple[Path, tuple[float, ...]]]:
    """Drawings with the diameters to try: files and pockets in turn."""
    drawings = sorted(folder.glob("*.dxf"), key=lambda path: (path.stat().st_size, path.name))
    shapes = list(names())
    for index in range(max(len(drawings), len(shapes))):
        if index < len(drawings):
            yield drawings[index], (3.0, 1.0, 0.4)
        if index < len(shapes):
            shape = pocket(shapes[index])
            path = work / f"{shape.name}.dxf"
            write_dxf(shape.region, path)
            yield path, (shape.diameter, shape.diameter / 2)


def plan(drawing: Path, diameters: tuple[float, ...], work: Path, strategy: str) -> Program:
    """Two operations with two tools, the larger one being the first that finds room."""
    failure: GrassfireError | None = None
    texts = {"name": "accepted", "post": "linuxcnc", "file": str(drawing), "strategy": strategy}
    words = {key: json.dumps(text) for key, text in texts.items()}
    for diameter in diameters:
        for units in ("", 'units = "mm"'):
            job = work / "job.toml"
            sizes = {"diameter": diameter, "second": 0.7 * diameter, "depth": 0.5 * diameter}
            job.write_text((JOB + AGAIN).format(units=units, **words, **sizes))
            try:
                return plan_job(load_job(job), Stopwatch()).program
            except GrassfireError as error:
                failure = error
                if "states no units" not in str(error):
                    break
    assert failure is not None
    raise failure


def _plan_into(results: Any, *job: Any) -> None:
    try:
        results.put(plan(*job))
    except GrassfireError as error:
        results.put(str(error))


def plan_in_time(
    drawing: Path, diameters: tuple[float, ...], work: Path, strategy: str, seconds: float
) -> Program | str:
    """A plan, or why there is none."""
    context = multiprocessing.get_context("fork")
    results = context.Queue()
    worker = context.Process(target=_plan_into, args=(results, drawing, diameters, work, strategy))
    worker.start()
    try:
        return results.get(timeout=seconds)  # type: ignore[no-any-return]
    except Empty:
        return f"no plan in {seconds:g} s"
    finally:
        worker.terminate()
        worker.join()


def definition(name: str) -> Post:
    post = load_post(name)
    assert isinstance(post, Post)
    return post


def judge(program: Program, name: str, source: str, work: Path, tally: Tally) -> None:
    """Write one plan for one controller; the interpreter takes it or not."""
    post = definition(name)
    for part in split_by_tool(program) if post.tool_change.split else (program,):
        path = work / f"program.{post.extension}"
        path.write_text(render(part, post, clearance_height=CLEARANCE), encoding="ascii")
        tally.programs[name] = tally.programs.get(name, 0) + 1
        try:
            answer = interpret(path, ARC_TOLERANCE)
        except AssertionError as refusal:
            tally.refused.append(f"{source} for {name}: {refusal}")
            continue
        arcs = [abs(move["r0"] - move["r1"]) for move in answer["moves"] if move["op"] == "arc"]
        tally.largest_mismatch = max([tally.largest_mismatch, *arcs])
        try:
            made = deviation(part, answer, HALF * 10.0**-post.decimals)
        except AssertionError as difference:
            tally.different.append(f"{source} for {name}: {difference}")
            continue
        tally.largest_end = max(tally.largest_end, made.end)
        tally.largest_path = max(tally.largest_path, made.path)


def judge_for_grbl(program: Program, source: str, tally: Tally) -> None:
    """The same plan by grbl's rules."""
    found = faults(render(program, definition("grbl"), clearance_height=CLEARANCE))
    tally.grbl_programs += 1
    if found:
        tally.grbl_refused.append(f"{source}: {found[0]}")


def run(count: int, folder: Path, seconds: float) -> Tally:
    tally = Tally()
    turn = 0
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        for number, (drawing, diameters) in enumerate(sources(folder, work)):
            if tally.count >= count:
                break
            strategy = WHOLE[number // 2 % len(WHOLE)]
            program = plan_in_time(drawing, diameters, work, strategy, seconds)
            if isinstance(program, str):
                tally.unplanned[drawing.stem] = program
                continue
            tally.plans += 1
            judge_for_grbl(program, drawing.stem, tally)
            for offset in range(POSTS_A_PLAN):
                if tally.count < count:
                    judge(
                        program, DIALECT[(turn + offset) % len(DIALECT)], drawing.stem, work, tally
                    )
            turn += POSTS_A_PLAN - 1  # so that drawings and pockets meet all posts
            print(f"{tally.count:4d} {drawing.stem}", file=sys.stderr, flush=True)
    return tally


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("count", type=int, nargs="?", default=300)
    parser.add_argument("--drawings", type=Path, default=ROOT.parent / "shared" / "dxf")
    parser.add_argument("--seconds", type=float, default=120.0, help="most for one plan")
    arguments = parser.parse_args()
    if not available():
        print(MISSING, file=sys.stderr)
        return 2
    begin = time.process_time()
    tally = run(arguments.count, arguments.drawings, arguments.seconds)
    accepted = tally.count - len(tally.refused)
    figures = {
        **vars(tally),
        "accepted": f"{accepted} of {tally.count}",
        "equal": f"{accepted - len(tally.different)} of {tally.count}",
        "grbl": f"{tally.grbl_programs - len(tally.grbl_refused)} of {tally.grbl_programs}",
        "own_cpu_seconds": round(time.process_time() - begin, 1),
    }
    print(json.dumps(figures, indent=1))
    failed = tally.refused or tally.different or tally.grbl_refused or tally.count < arguments.count
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
