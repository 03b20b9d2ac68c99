"""Pockets from every drawing of a folder: which become programs, how long that takes, why not.

    python benchmarks/drawings.py [FOLDER] [--diameters 3 1] [--judge FILE] [--out DIR]

Each drawing goes through ``grassfire run`` in a process of its own, with the first tool that finds
room. A judge is a Python file with ``measure(text, polygon, depth, radius) -> dict``; its figures
are added to the table.
"""

from __future__ import annotations

import argparse
import importlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grassfire import GrassfireError, read_regions
from grassfire.geometry import flatten

Judge = Callable[[str, Any, float, float], Mapping[str, Any]]

JOB = """\
name = {name}
post = {post}
[input]
file = {file}
{units}
[[tools]]
number = 1
diameter = {diameter}
spindle_speed = 18000
feed = 800
plunge_feed = 200
[[operations]]
strategy = "offset"
tool = 1
depth = {depth}
stepdown = {depth}
entry = "helix"
"""

LIMITS = {
    "gouge_mm": 0.005,
    "floor_gouge_mm": 0.001,
    "uncut_pct": 0.1,
    "rapid_hits": 0,
    "plunge_mm": 0,
}
"""Largest figures of a judge that are good."""


@dataclass(frozen=True)
class Outcome:
    """What became of one drawing."""

    drawing: Path
    code: int
    diameter: float
    seconds: float
    units: str | None
    message: str
    program: Path | None
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def faults(self) -> list[str]:
        """What the judge objects to."""
        over = [
            f"{key} {self.figures[key]:.4g}"
            for key, limit in LIMITS.items()
            # a NaN is no good figure either
            if key in self.figures and not self.figures[key] <= limit
        ]
        return over + [str(error) for error in self.figures.get("errors", ())][:1]


def attempt(
    drawing: Path, out: Path, post: str, diameter: float, depth: float, timeout: float
) -> Outcome:
    """Run one job; units are given where the drawing has none."""
    name = f"{drawing.stem}-{diameter:g}"
    job = out / f"{name}.toml"
    units = None
    while True:
        job.write_text(
            JOB.format(
                name=json.dumps(name),
                post=json.dumps(post),
                file=json.dumps(str(drawing.resolve())),
                units=f'units = "{units}"' if units else "",
                diameter=diameter,
                depth=depth,
            ),
            encoding="utf-8",
        )
        command = [sys.executable, "-m", "grassfire", "run", str(job), "--out", str(out), "--json"]
        begin = time.perf_counter()
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=timeout, check=False
            )
        except subprocess.TimeoutExpired:
            return Outcome(drawing, -1, diameter, timeout, units, "took too long", None)
        seconds = time.perf_counter() - begin
        message = done.stderr.strip().replace(str(drawing.resolve().parent) + "/", "")
        if done.returncode == 2 and units is None and "states no units" in message:
            units = "mm"
            continue
        programs = [path for path in out.glob(f"{glob_literal(name)}.*") if path.suffix in PROGRAMS]
        program = programs[0] if done.returncode == 0 else None
        return Outcome(drawing, done.returncode, diameter, seconds, units, message, program)


PROGRAMS = (".ngc", ".nc")


def glob_literal(name: str) -> str:
    """A name without meaning for glob."""
    return "".join(f"[{mark}]" if mark in "*?[" else mark for mark in name)


def try_drawing(drawing: Path, arguments: argparse.Namespace, out: Path) -> Outcome:
    """The first tool that makes a program; the last outcome if none does."""
    for diameter in arguments.diameters:
        outcome = attempt(
            drawing, out, arguments.post, diameter, arguments.depth, arguments.timeout
        )
        if outcome.program is not None:
            break
    return outcome


def judged(outcome: Outcome, judge: Judge, depth: float) -> Outcome:
    """The outcome with a judge's figures on its program."""
    import shapely

    if outcome.program is None:
        return outcome
    drawing = read_regions(outcome.drawing, units=outcome.units)
    polygons = [
        shapely.Polygon(
            flatten(region.outer, 1e-4), [flatten(island, 1e-4) for island in region.islands]
        )
        for region in drawing.regions
    ]
    text = outcome.program.read_text(encoding="utf-8")
    figures = judge(text, shapely.union_all(polygons), depth, outcome.diameter / 2)
    return Outcome(**{**outcome.__dict__, "figures": figures})


def load_judge(path: Path) -> Judge:
    """The function `measure` of a Python file."""
    sys.path.insert(0, str(path.resolve().parent))
    module = importlib.import_module(path.stem)
    measure: Judge = module.measure
    return measure


def line_of(outcome: Outcome) -> str:
    """One row of the table."""
    name = outcome.drawing.name[:52]
    if outcome.program is None:
        word = {1: "REFUSED", 2: "no", -1: "TIMEOUT"}.get(outcome.code, f"EXIT {outcome.code}")
        return f"{name:52s} {word:8s} {outcome.diameter:4g} {outcome.seconds:6.1f}  " + (
            " | ".join(outcome.message.splitlines())
        )
    word = "BAD" if outcome.faults else "ok"
    figures = "  ".join(
        f"{key} {outcome.figures[key]:.4g}" for key in LIMITS if key in outcome.figures
    )
    faults = "; ".join(outcome.faults)
    return (
        f"{name:52s} {word:8s} {outcome.diameter:4g} {outcome.seconds:6.1f}  {figures}  {faults}"
    ).rstrip()


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; the exit code is 1 if a run crashed or the judge objects."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("../shared/dxf"))
    parser.add_argument("--diameters", nargs="+", type=float, default=[3.0, 1.0], help="mm")
    parser.add_argument("--depth", type=float, default=2.0, help="mm")
    parser.add_argument("--post", default="linuxcnc")
    parser.add_argument("--judge", type=Path, help="Python file with a function measure()")
    parser.add_argument("--out", type=Path, help="keep the files here")
    parser.add_argument("--only", default="", help="part of a drawing's name")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds per run")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args(arguments)
    drawings = [
        path
        for path in sorted(options.folder.iterdir())
        if path.suffix.lower() == ".dxf" and options.only in path.name
    ]
    if not drawings:
        parser.error(f"{options.folder}: no drawings")
    judge = load_judge(options.judge) if options.judge else None
    with tempfile.TemporaryDirectory() as scratch:
        out = options.out or Path(scratch)
        out.mkdir(parents=True, exist_ok=True)
        outcomes = []
        with ThreadPoolExecutor(options.workers) as pool:
            for outcome in pool.map(lambda path: try_drawing(path, options, out), drawings):
                try:
                    checked = judged(outcome, judge, options.depth) if judge else outcome
                except GrassfireError as error:
                    parser.exit(3, f"{outcome.drawing}: read twice, but not alike: {error}\n")
                print(line_of(checked), flush=True)
                outcomes.append(checked)
    good = sum(item.program is not None and not item.faults for item in outcomes)
    broken = [item for item in outcomes if item.code not in (0, 1, 2) or item.faults]
    print(f"{good} of {len(outcomes)} drawings became good programs; {len(broken)} broken")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
