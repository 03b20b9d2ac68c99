"""Other programs that make medial axes, run on the same shapes: adapters.

A folder of peers holds `bin/occt_mat` (OpenCASCADE's bisecting locus of curves),
`bin/cgal_pd_mat` (Delaunay triangulation of boundary samples) and `bin/boost_mat` (segment
Voronoi diagram). They read text: eight numbers a line for a cubic Bezier curve, `1 x0 y0 x1 y1`
for a line, `2 x0 y0 xm ym x1 y1` for an arc, or a point `x y` of a polygon; an empty line
between loops. They answer a line `# {json}` with CPU seconds, then
`E kind x0 y0 r0 x1 y1 r1 site site`, a line for each straight piece of the axis.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry import Arc, Curve, Line, Loop, Region, flatten

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Answer:
    """What a peer made of a shape.

    Attributes
    ----------
    seconds : float
        CPU time of the computation and of reading it out.
    pieces : (n, 2, 3) array
        Ends (x, y, r) of straight pieces; r is NaN where the peer gives none.
    failure : str
        Empty if there is an answer.
    """

    seconds: float
    pieces: FloatArray
    failure: str = ""


def run(command: list[str], timeout: float) -> Answer:
    """Start a peer and read its answer."""
    nothing = np.zeros((0, 2, 3))
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return Answer(timeout, nothing, f"more than {timeout:g} s")
    header: dict[str, Any] = {}
    rows = []
    for line in done.stdout.splitlines():
        if line.startswith("# "):
            header = json.loads(line[2:])
        elif line.startswith("E "):
            rows.append([float(word) for word in line.split()[2:8]])
    if done.returncode or "failed" in header:
        reason = str(header.get("failed", f"exit code {done.returncode}"))
        return Answer(float("nan"), nothing, reason)
    table = np.array(rows, dtype=np.float64).reshape(-1, 2, 3)
    return Answer(float(header["t_build"]) + float(header["t_ma"]), table)


def curve_text(region: Region) -> str:
    """Cubic Bezier pieces, or lines and arcs, of a region."""
    if all(isinstance(curve, Line | Arc) for curve in region.curves):
        return loops_text(region, lambda curve: [sections(curve)])
    return loops_text(region, cubic_lines)


def loops_text(region: Region, lines_of: Callable[[Curve], list[str]]) -> str:
    """Lines of all curves, loops apart."""
    parts = []
    for loop in region.loops:
        lines = [text for curve in loop.curves for text in lines_of(curve)]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def numbers(values: FloatArray) -> str:
    """Seventeen digits each."""
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


def sections(curve: Curve) -> str:
    """A line or an arc by its ends and middle; a full circle in two halves."""
    if isinstance(curve, Line):
        return f"1 {numbers(curve.point([0.0, 1.0]))}"
    if np.hypot(*(curve.end - curve.start)) > 1e-9 * curve.size:
        return f"2 {numbers(curve.point([0.0, 0.5, 1.0]))}"
    first, second = curve.point([0.0, 0.25, 0.5]), curve.point([0.5, 0.75, 1.0])
    return f"2 {numbers(first)}\n2 {numbers(second)}"


def cubic_lines(curve: Curve) -> list[str]:
    """Bezier pieces raised to degree 3."""
    lines = []
    for bezier in curve.to_beziers():
        points = bezier.control_points
        if bezier.weights is not None or len(points) > 4:
            raise ValueError("only polynomial pieces up to cubic go to a peer")
        while len(points) < 4:
            share = np.arange(1, len(points))[:, None] / len(points)
            inner = share * points[:-1] + (1 - share) * points[1:]
            points = np.concatenate([points[:1], inner, points[-1:]])
        lines.append(numbers(points))
    return lines


def sampled(region: Region, count: int) -> list[FloatArray]:
    """About `count` points along the loops, evenly by parameter."""
    total = len(region.curves)
    loops = []
    for loop in region.loops:
        each = max(2, round(count / total))
        loops.append(loop.point(np.arange(each * len(loop)) / each))
    return loops


def points_text(loops: list[FloatArray]) -> str:
    """Corners of polygons."""
    return "\n".join("".join(f"{numbers(point)}\n" for point in loop) for loop in loops)


@dataclass(frozen=True)
class Peers:
    """Peers found in a folder; those that are not there are skipped.

    Parameters
    ----------
    folder : Path or None
    scratch : Path
        Where shapes are written.
    timeout : float
        Seconds for one run.
    """

    folder: Path | None
    scratch: Path
    timeout: float = 120.0

    def find(self, name: str) -> Path | None:
        """The program of a peer."""
        path = self.folder / "bin" / name if self.folder else None
        return path if path is not None and path.is_file() else None

    def opencascade(
        self, region: Region, samples: int = 64, runs: int = 3, more: tuple[str, ...] = ()
    ) -> Answer | None:
        """Bisecting locus of the curves, median time of some runs.

        More options: `-merge` makes one curve of all pieces, `-all` keeps what reaches the walls.
        """
        return self._timed("occt_mat", curve_text(region), ["-k", str(samples), *more], runs)

    def delaunay(self, region: Region, count: int, runs: int = 3) -> Answer | None:
        """Delaunay triangulation of about `count` samples, median time of some runs."""
        return self._timed("cgal_pd_mat", points_text(sampled(region, count)), [], runs)

    def segments(self, region: Region, chord: float, runs: int = 1) -> Answer | None:
        """Segment Voronoi diagram of chords."""
        loops = [flatten(loop, chord) for loop in region.loops]
        return self._timed("boost_mat", points_text(loops), [], runs)

    def _timed(self, name: str, text: str, options: list[str], runs: int) -> Answer | None:
        program = self.find(name)
        if program is None:
            return None
        shape = self.scratch / "shape.txt"
        shape.write_text(text, encoding="utf-8")
        answers = [run([str(program), str(shape), *options], self.timeout) for _ in range(runs)]
        failed = [answer for answer in answers if answer.failure]
        if failed:
            return failed[0]
        middle = float(np.median([answer.seconds for answer in answers]))
        return Answer(middle, answers[0].pieces)


def polygon_region(loops: list[FloatArray]) -> Region:
    """Region of polygons, the outer one first."""
    first, *others = (Loop.from_points(loop) for loop in loops)
    return Region(first, tuple(others))
