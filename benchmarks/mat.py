"""Accuracy and speed of the medial axis, beside other programs, in one run.

    python benchmarks/mat.py --peers DIR --out RESULTS.md
    python benchmarks/mat.py --parts free-form --count 10
    python benchmarks/mat.py --parts polygons --sizes 1000 10000

Free-form: an ellipse, a peanut, a flower, a hand and random splines against an oracle that works
by brute force (`oracle.py`). Pockets: lines and arcs with fillets and islands. Polygons: up to
100,000 edges beside pyvoronoi, each run in a process of its own. Peers are described in
`peers.py`; those that are not found are skipped. Other processes disturb the times: leave the
machine alone.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import outlines as make
from numpy.typing import NDArray
from oracle import Boundary, ClaimedAxis, bisector_error
from peers import Answer, Peers
from polygons import SHAPES
from region_kinds import region

from grassfire.errors import GeometryError
from grassfire.geometry import Loop, Region
from grassfire.medial import MedialAxis, medial_axis

FloatArray = NDArray[np.float64]

HAND = (
    (22, -60), (26, -38), (34, -22), (48, -6), (60, 8), (68, 20), (60, 28), (50, 20), (38, 8),
    (32, 6), (33, 30), (35, 52), (34, 64), (25, 65), (22, 52), (20, 30), (16, 18), (13, 32),
    (12, 56), (11, 74), (1, 76), (-1, 62), (-2, 36), (-4, 20), (-7, 34), (-10, 54), (-13, 70),
    (-22, 70), (-22, 54), (-19, 32), (-19, 16), (-24, 26), (-29, 40), (-35, 54), (-43, 50),
    (-39, 36), (-34, 18), (-33, -4), (-30, -26), (-26, -44), (-22, -60),
)  # fmt: skip
"""Control points of a B-spline hand."""


# -- shapes ---------------------------------------------------------------------------------------


def even_angles(count: int) -> FloatArray:
    """Angles of a turn, evenly spaced."""
    return np.asarray(make.TURN * np.arange(count) / count)


def named_shapes() -> dict[str, tuple[Region, int, int]]:
    """Region, number of ends and number of branch points."""
    few, some, many = even_angles(64), even_angles(100), even_angles(128)
    oval = np.column_stack([60 * np.cos(few), 25 * np.sin(few)])
    waist = make.polar(35 + 15.75 * np.cos(2 * many), many)
    petals = make.polar(40 + 10 * np.cos(5 * some), some)
    return {
        "ellipse": (Region(make.interpolating_loop(oval)), 2, 0),
        "peanut": (Region(make.interpolating_loop(waist)), 2, 0),
        "flower": (Region(make.interpolating_loop(petals)), 5, 1),
        "hand": (Region(make.bspline_loop(np.array(HAND))), 7, 5),
    }


def as_beziers(given: Region) -> Region:
    """The same region with a Bezier curve for each piece."""
    loops = [
        Loop(tuple(piece for curve in loop.curves for piece in curve.to_beziers()))
        for loop in given.loops
    ]
    return Region(loops[0], tuple(loops[1:]))


# -- free-form ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Accuracy:
    """An axis against the oracle, mm.

    Attributes
    ----------
    missing : float
        Largest distance from a true disk (x, y, r) to the claimed axis.
    extra : float
        Largest distance from a claimed disk to the true axis.
    ends : float
        Largest distance from a true end to the nearest claimed one.
    true_ends : int
        Number of curvature maxima with empty osculating disks.
    """

    missing: float
    extra: float
    ends: float
    true_ends: int

    @property
    def hausdorff(self) -> float:
        """Both ways, ends included."""
        return max(self.missing, self.extra, self.ends)


def probes(boundary: Boundary, count: int, seed: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Random places of the boundary, and places ever closer to the smooth ends."""
    draw = np.random.default_rng(seed)
    piece = draw.integers(0, len(boundary.power), count)
    t = draw.uniform(size=count)
    at_piece, at, _ = boundary.smooth_ends(1e-9)
    step = np.concatenate([sign * np.geomspace(1e-4, 0.9, 12) for sign in (-1.0, 1.0)])
    near = boundary.wrap(np.repeat(at_piece, len(step)), (at[:, None] + step).ravel())
    return np.concatenate([piece, near[0]]), np.concatenate([t, near[1]])


def accuracy(boundary: Boundary, claimed: ClaimedAxis, tips: FloatArray, places: int) -> Accuracy:
    """Distances both ways between the oracle's axis and a claimed one with its tips (k, 3)."""
    missing = claimed.distance(boundary.disks(*probes(boundary, places, 7)).table)
    disks = claimed.disks
    if len(disks) > 2 * places:
        disks = disks[np.linspace(0, len(disks) - 1, 2 * places).astype(np.int64)]
    extra, _ = bisector_error(boundary, disks)
    _, _, ends = boundary.smooth_ends(1e-9)
    away = np.full(len(ends), np.inf)
    if len(tips):
        away = np.sqrt(np.sum((ends[:, None] - tips) ** 2, axis=2)).min(axis=1)
    return Accuracy(
        float(missing.max()), float(extra.max()), float(away.max(initial=0.0)), len(ends)
    )


def claimed_axis(axis: MedialAxis) -> ClaimedAxis:
    """Bezier edges and vertices as the oracle wants them."""
    edges = [np.column_stack([edge.control_points, edge.radius]) for edge in axis.edges]
    return ClaimedAxis(edges, np.column_stack([axis.vertex_point, axis.vertex_radius]))


def timed(given: Region, tol: float, runs: int) -> tuple[MedialAxis, float]:
    """The axis with its edges, and the median of the seconds that it takes."""
    seconds = []
    for _ in range(runs):
        begin = time.perf_counter()
        axis = medial_axis(given, tol)
        edges = axis.edges
        seconds.append(time.perf_counter() - begin)
    assert edges or len(axis.vertex_radius) == 1
    return axis, float(np.median(seconds))


def degrees(axis: MedialAxis) -> NDArray[np.int64]:
    """Number of edges at each vertex."""
    ends = [end for edge in axis.edges for end in (edge.start, edge.end)]
    return np.bincount(np.array(ends, dtype=np.int64), minlength=len(axis.vertex_radius))


@dataclass(frozen=True)
class Row:
    """Figures of one free-form shape."""

    name: str
    pieces: int
    seconds: float
    edges: int
    figures: Accuracy | None
    ends: int
    branches: int
    right_graph: bool
    peers: tuple[str, ...]
    failure: str = ""

    def __str__(self) -> str:
        head = f"| {self.name} | {self.pieces} |"
        if self.figures is None:
            return f"{head} {self.failure} |" + " |" * 7
        words = [
            f"{1e3 * self.seconds:.0f}", str(self.edges), f"{self.figures.missing:.1e}",
            f"{self.figures.extra:.1e}", f"{self.figures.ends:.1e}",
            f"{self.ends}/{self.branches}{'' if self.right_graph else ' WRONG'}", *self.peers,
        ]  # fmt: skip
        return f"{head} {' | '.join(words)} |"


def free_form_row(
    name: str,
    given: Region,
    counts: tuple[int, int] | None,
    peers: Peers,
    options: argparse.Namespace,
) -> Row:
    """Ours and the peers' on one shape."""
    pieces = len(given.curves)
    boundary = Boundary.of(given)
    try:
        axis, seconds = timed(given, options.tol, options.runs)
    except GeometryError as error:
        return Row(name, pieces, 0.0, 0, None, 0, 0, False, (), str(error))
    degree = degrees(axis)
    claimed = claimed_axis(axis)
    figures = accuracy(boundary, claimed, claimed.vertices[degree == 1], 1000)
    ends, branches = int(np.sum(degree == 1)), int(np.sum(degree > 2))
    # A branch point where k edges meet stands for k - 2 simple ones; islands add two each.
    simple = figures.true_ends - 2 + 2 * len(given.islands)
    right = ends == figures.true_ends and int(np.sum(np.maximum(degree - 2, 0))) == simple
    if counts is not None:
        right &= counts == (ends, branches)
    return Row(
        name, pieces, seconds, len(axis.edges), figures, ends, branches, right,
        tuple(peer_words(given, boundary, peers, options.samples)),
    )  # fmt: skip


VARIANTS: tuple[tuple[str, ...], ...] = ((), ("-merge",), ("-all",), ("-merge", "-all"))
"""Ways to run OpenCASCADE; the best answer counts."""


def peer_words(given: Region, boundary: Boundary, peers: Peers, samples: int) -> Iterator[str]:
    """Seconds and errors of OpenCASCADE and of the Delaunay triangulation of samples.

    Branches too many are forgiven: the error is that of what misses, ends included.
    """
    if peers.find("occt_mat"):
        answers = []
        for more in VARIANTS:
            # Its time counts few points of the curves; its accuracy is seen with many.
            quick = peers.opencascade(given, 4, 3, more)
            fine = peers.opencascade(given, 512, 1, more)
            if quick is not None and fine is not None:
                answers.append(replace(fine, seconds=quick.seconds))
        yield best_of(boundary, answers)
    if peers.find("cgal_pd_mat"):
        answer = peers.delaunay(given, samples)
        yield best_of(boundary, [answer] if answer else [])


def best_of(boundary: Boundary, answers: list[Answer]) -> str:
    """Milliseconds, error and error away from the ends of the best answer, or why there is none."""
    good = [answer for answer in answers if not answer.failure and len(answer.pieces)]
    if not good:
        return f"{answers[0].failure or 'nothing'} | |"
    errors = [(*peer_errors(boundary, answer), answer.seconds) for answer in good]
    error, wide, seconds = min(errors)
    return f"{1e3 * seconds:.1f} | {error:.0e} | {wide:.0e}"


def peer_errors(boundary: Boundary, answer: Answer) -> tuple[float, float]:
    """What misses in a peer's straight pieces, ends included, and where contacts are far apart.

    Far apart: seen from the centre under more than 60 degrees. Radii that it does not give are
    taken from the oracle.
    """
    flat = answer.pieces.reshape(-1, 3).copy()
    unknown = np.isnan(flat[:, 2])
    if unknown.any():
        flat[unknown, 2] = boundary.distance(flat[unknown, :2])
    claimed = ClaimedAxis(list(flat.reshape(-1, 2, 3)), flat[:0], samples=2)
    disks = boundary.disks(*probes(boundary, 300, 7))
    missing = claimed.distance(disks.table)
    ends = claimed.distance(boundary.smooth_ends(1e-9)[2])
    wide = missing[disks.reach > disks.radius]
    return float(max(missing.max(), ends.max(initial=0.0))), float(wide.max(initial=0.0))


def free_form(options: argparse.Namespace, peers: Peers) -> Iterator[str]:
    """Table of the named shapes and of random splines."""
    yield f"## Free-form shapes, tol {options.tol:g} mm"
    yield ""
    columns = ["shape", "pieces", "ms", "edges", "missing mm", "extra mm", "ends mm", "ends/branch"]
    if peers.find("occt_mat"):
        columns += ["OpenCASCADE ms", "its H mm", "away from ends mm"]
    if peers.find("cgal_pd_mat"):
        columns += ["Delaunay ms", "its H mm", "away from ends mm"]
    yield f"| {' | '.join(columns)} |"
    yield "|---" + "|---:" * (len(columns) - 1) + "|"
    shapes = named_shapes()
    timed(shapes["ellipse"][0], options.tol, 1)
    rows = []
    for name, (given, ends, branches) in shapes.items():
        rows.append(free_form_row(name, given, (ends, branches), peers, options))
        yield str(rows[-1])
    silent = Peers(None, peers.scratch)
    for number in range(options.count):
        given = as_beziers(region("spline", number))
        use = peers if number < options.peer_count else silent
        rows.append(free_form_row(f"spline {number}", given, None, use, options))
        yield str(rows[-1])
    yield ""
    yield from summary(rows)


def summary(rows: Sequence[Row]) -> Iterator[str]:
    """The bars over all shapes."""
    done = [(row, row.figures) for row in rows if row.figures is not None]
    if not done:
        yield f"none of {len(rows)} certified"
        return
    seconds = np.array([row.seconds for row, _ in done])
    error = np.array([figures.hausdorff for _, figures in done])
    yield (
        f"{len(done)} of {len(rows)} certified; H <= 1e-9 mm on {int(np.sum(error <= 1e-9))}, "
        f"worst {error.max():.1e}, median {np.median(error):.1e}; "
        f"right graph on {sum(row.right_graph for row, _ in done)}; "
        f"{1e3 * np.median(seconds):.0f} ms median, {1e3 * seconds.max():.0f} ms worst, "
        f"{int(np.sum(seconds <= 0.1))} within 100 ms"
    )


# -- pockets --------------------------------------------------------------------------------------


def pockets(options: argparse.Namespace, peers: Peers) -> Iterator[str]:
    """Pockets of about 20 lines and arcs with fillets and islands."""
    yield "## Pockets of lines and arcs"
    yield ""
    ours: list[float] = []
    theirs: list[float] = []
    pieces: list[int] = []
    failed: list[str] = []
    peer_failed, error, seed = 0, 0.0, -1
    while len(pieces) < options.pockets:
        seed += 1
        given = region("pocket", seed)
        if not (14 <= len(given.curves) <= 26 and given.islands):
            continue
        pieces.append(len(given.curves))
        if not ours:
            medial_axis(given, options.tol)
        try:
            axis, seconds = timed(given, options.tol, options.runs)
        except GeometryError as reason:
            failed.append(f"pocket {seed}: {reason}")
            continue
        ours.append(seconds)
        disks = claimed_axis(axis).disks
        boundary = Boundary.of(given)
        error = max(error, float(np.abs(boundary.distance(disks[:, :2]) - disks[:, 2]).max()))
        answer = peers.opencascade(given)
        if answer is not None and answer.failure:
            peer_failed += 1
        elif answer is not None:
            theirs.append(answer.seconds)
    yield "| | shapes | pieces | median ms | worst ms | disks within mm |"
    yield "|---" + "|---:" * 5 + "|"
    span = f"{min(pieces)} to {max(pieces)}"
    if ours:
        yield (
            f"| grassfire | {len(ours)} of {len(pieces)} | {span} | {1e3 * np.median(ours):.1f} "
            f"| {1e3 * max(ours):.1f} | {error:.1e} |"
        )
    if theirs:
        yield (
            f"| OpenCASCADE | {len(theirs)} of {len(theirs) + peer_failed} | {span} "
            f"| {1e3 * np.median(theirs):.1f} | {1e3 * max(theirs):.1f} | |"
        )
    yield from failed


# -- polygons -------------------------------------------------------------------------------------


def polygon_run(engine: str, shape: str, edges: int, timeout: float) -> dict[str, Any]:
    """One run in a process of its own."""
    script = Path(__file__).with_name("polygons.py")
    command = [sys.executable, str(script), engine, shape, str(edges)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return {"failure": f"more than {timeout:g} s"}
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        return {"failure": f"exit code {done.returncode}: {last}"}
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def middle_runs(
    engines: Sequence[str], shape: str, edges: int, options: argparse.Namespace
) -> list[dict[str, Any]]:
    """The run of median CPU time of each engine, or one that failed.

    They run in turn: machines change their speed from minute to minute.
    """
    results: list[list[dict[str, Any]]] = [[] for _ in engines]
    for _ in range(options.runs if edges <= 20000 else 1):
        for engine, rows in zip(engines, results, strict=True):
            if not rows or "failure" not in rows[-1]:
                rows.append(polygon_run(engine, shape, edges, options.timeout))
    return [_middle(rows) for rows in results]


def _middle(rows: list[dict[str, Any]]) -> dict[str, Any]:
    if "failure" in rows[-1]:
        return rows[-1]
    return sorted(rows, key=lambda row: float(row["total"][0]))[len(rows) // 2]


def exponent(points: list[tuple[int, float]]) -> str:
    """Slope of log seconds over log edges, by least squares."""
    if len(points) < 2:
        return ""
    edges, seconds = np.log(np.array(points)).T
    return f"{np.polyfit(edges, seconds, 1)[0]:.2f}"


def polygons(options: argparse.Namespace, peers: Peers) -> Iterator[str]:
    """Table of polygons by size; `peers` has no part in it."""
    with_peer = importlib.util.find_spec("pyvoronoi") is not None
    yield "## Polygons: region from points, certified axis, edges read out"
    yield ""
    if not with_peer:
        yield "pyvoronoi is not installed: skipped"
        yield ""
    yield (
        "| polygon | edges | CPU s | wall s | memory MB | disk error mm | pyvoronoi CPU s "
        "| without picking s | wall s | memory MB | ratio of CPU | exponent | its exponent |"
    )
    yield "|---" + "|---:" * 12 + "|"
    for shape in options.shapes:
        ours: list[tuple[int, float]] = []
        theirs: list[tuple[int, float]] = []
        for edges in options.sizes:
            engines = ["grassfire", "pyvoronoi"] if with_peer else ["grassfire"]
            mine, *others = middle_runs(engines, shape, edges, options)
            peer = others[0] if others else {}
            words = [shape, str(edges)]
            if "failure" in mine:
                words += [mine["failure"], "", f"{mine.get('memory', 0):.0f}", ""]
            else:
                ours.append((edges, mine["total"][0]))
                words += [f"{value:.3f}" for value in mine["total"]]
                words += [f"{mine['memory']:.0f}", f"{mine['disk_error']:.0e}"]
            if "total" in peer:
                theirs.append((edges, peer["total"][0]))
                cpu, wall = peer["total"]
                words += [f"{cpu:.3f}", f"{cpu - peer['pick'][0]:.3f}", f"{wall:.3f}"]
                words += [f"{peer['memory']:.0f}"]
            else:
                words += [peer.get("failure", ""), "", "", ""]
            both = "total" in mine and "total" in peer
            words += [f"{mine['total'][0] / peer['total'][0]:.2f}" if both else ""]
            words += [exponent(ours), exponent(theirs)]
            yield f"| {' | '.join(words)} |"


PARTS: dict[str, Callable[[argparse.Namespace, Peers], Iterator[str]]] = {
    "free-form": free_form,
    "pockets": pockets,
    "polygons": polygons,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables as they come."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--peers", type=Path, help="folder with bin/ of the other programs")
    parser.add_argument("--tol", type=float, default=3e-10, help="mm, not of polygons")
    parser.add_argument("--runs", type=int, default=3, help="the median of so many")
    parser.add_argument("--count", type=int, default=100, help="random splines")
    parser.add_argument("--peer-count", type=int, default=20, help="of them, for the peers too")
    parser.add_argument("--samples", type=int, default=50000, help="of the Delaunay triangulation")
    parser.add_argument("--pockets", type=int, default=30)
    parser.add_argument("--sizes", type=int, nargs="+", default=[1000, 10000, 100000])
    parser.add_argument("--shapes", nargs="+", choices=list(SHAPES), default=list(SHAPES))
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds for one run")
    parser.add_argument("--out", type=Path, help="write the tables here too")
    options = parser.parse_args(arguments)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    lines: list[str] = []
    with tempfile.TemporaryDirectory() as scratch:
        peers = Peers(options.peers, Path(scratch))
        for part in options.parts:
            if part != "polygons" and not (peers.find("occt_mat") or peers.find("cgal_pd_mat")):
                print("other programs are not found: skipped (--peers)", file=sys.stderr)
            for line in chain(PARTS[part](options, peers), [""]):
                print(line, flush=True)
                lines.append(line)
    if options.out:
        options.out.write_text("\n".join(lines), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
