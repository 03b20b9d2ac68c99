"""An independent judge of medial axes on random regions of many kinds.

    python benchmarks/judge.py PATH/mat_judge.py --count 200 --jobs 2

The judge is a Python file with `judge(axis, loops, samples=, probes=) -> figures`, where `axis` is
what `MedialAxis.to_dict` gives and a loop is a list of segments. Its figures `disk_error`,
`missing` (mm) and `euler_ok` are held against the bars. What the judge measures with is made finer
than the bars first:

- It judges against chords, and its probes ignore boundary points within three of the longest
  chords. So it gets points on the exact curves, at most `--spacing` apart (h^2 / 8 r is the error
  of its parabola through three of them, r the radius of a disk), and so close that the sagitta is
  at most a tenth of the bar on disks, closer still at reflex corners, where its parabola meets a
  kink.
- A probe close to a convex corner, or far up in a wedge, has its other contact among the points
  left out, or in front of a disk too small for its parabola. So the seed of the probes is the
  first that puts none of them there.
- It draws an edge of the axis with 400 points. So edges are split (exactly, by de Casteljau's
  scheme) until their second differences bound the chords' error by a quarter of the bar on what
  is missing.
- Regions are scaled to a perimeter of `--perimeter` to keep the number of points in bounds.

Where it still objects, brute force on the exact curves (`oracle.py`) says who is to blame.
"""

from __future__ import annotations

import argparse
import importlib
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mat import claimed_axis
from numpy.typing import NDArray
from oracle import Boundary
from region_kinds import KINDS, moved, region

from grassfire.errors import GeometryError
from grassfire.geometry import REFLEX, Region
from grassfire.medial import MedialAxis, medial_axis

FloatArray = NDArray[np.float64]
Judge = Callable[..., dict[str, Any]]
Segment = tuple[str, tuple[float, float], tuple[float, float]]

JUDGED = (
    "spline", "spline-islands", "blob", "quadratics", "flower", "ellipse", "glyph", "convex",
    "star", "tangle", "comb", "holed", "rectilinear", "regular", "pocket", "slot", "bulged",
    "mixed", "gear", "annulus", "needle", "grid-islands",
)  # fmt: skip
"""Kinds that have a size of their own; the others vary these."""


@dataclass(frozen=True)
class Verdict:
    """What the judge says of one region, and the oracle if it was asked."""

    kind: str
    seed: int
    figures: dict[str, Any]
    faults: tuple[str, ...]
    blame: str = ""


# -- what the judge is given ----------------------------------------------------------------------


def points_of(loop_pieces: Sequence[int], boundary: Boundary, steps: FloatArray) -> FloatArray:
    """Points along some pieces at parameters of equal steps, (n, 2)."""
    parts = []
    for piece in loop_pieces:
        count = int(steps[piece])
        t = np.arange(count) / count
        parts.append(boundary.evaluate(np.full(count, piece), t)[0])
    return np.concatenate(parts)


def chords(given: Region, spacing: float, sagitta: float) -> list[list[Segment]]:
    """The region's loops as short chords with their ends on the exact curves."""
    loops = []
    for loop in given.loops:
        junction = loop.junctions(1e-9)
        reflex = junction.point[junction.kind == REFLEX]
        boundary = Boundary.of(Region(loop))
        count = len(boundary.power)
        t = np.linspace(0.0, 1.0, 33)
        piece = np.repeat(np.arange(count), len(t))
        _, first, _ = boundary.evaluate(piece, np.tile(t, count))
        _, _, curvature = boundary.frame(piece, np.tile(t, count))
        speed = np.hypot(*first.T).reshape(count, -1).max(axis=1)
        bend = np.abs(curvature).reshape(count, -1).max(axis=1)
        chord = np.minimum(spacing, np.sqrt(8 * sagitta / np.maximum(bend, 1e-12)))
        steps = np.ceil(speed / chord) + 1
        points = with_graded_corners(points_of(range(count), boundary, steps), reflex, spacing)
        ends = np.roll(points, -1, axis=0)
        pairs = zip(points.tolist(), ends.tolist(), strict=True)
        loops.append([("L", (a[0], a[1]), (b[0], b[1])) for a, b in pairs])
    return loops


def with_graded_corners(points: FloatArray, corners: FloatArray, spacing: float) -> FloatArray:
    """More points on the chords next to reflex corners, ever closer, down to a nanometre."""
    if not len(corners):
        return points
    levels = max(1, int(np.ceil(np.log2(spacing / 1e-8))))
    share = 0.5 ** np.arange(levels, 0, -1)
    where: list[int] = []
    extra: list[FloatArray] = []
    for corner in corners:
        number = int(np.argmin(np.sum((points - corner) ** 2, axis=1)))
        before, after = (number - 1) % len(points), (number + 1) % len(points)
        here = points[number]
        incoming = here + share[::-1, None] * (points[before] - here)
        outgoing = here + share[:, None] * (points[after] - here)
        where += [number] * levels + [number + 1] * levels
        extra += [incoming, outgoing]
    return np.insert(points, where, np.concatenate(extra), axis=0)


def probe_seed(loops: list[list[Segment]], probes: int, error: float) -> int:
    """Seed of the judge's probes that puts none where it measures worse than `error`.

    That is where the other contact of a probe is left out: next to convex corners, and far up in
    wedges of a degree, wherever a point within six of the longest chords (three are left out; the
    parabola takes one more on both sides) makes a smaller disk than those beyond. And where disks
    are so small that a parabola does not follow the radii: through every second point it is off by
    eight times as much.
    """
    begin = np.array([segment[1] for loop in loops for segment in loop])
    step = np.array([segment[2] for loop in loops for segment in loop]) - begin
    length = np.hypot(*step.T)
    share, reach = length / length.sum(), 6 * length.max()
    for seed in range(5, 205):
        draw = np.random.default_rng(seed)
        chosen = draw.choice(len(length), probes, p=share)
        along = step[chosen] / length[chosen, None]
        place = begin[chosen] + step[chosen] * draw.uniform(0.3, 0.7, probes)[:, None]
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
        near, far, index = least_disks(place, normal, begin, reach)
        around = (index[:, None] + np.arange(-2, 3)) % len(begin)
        radius = disk_radius(begin[around] - place[:, None], normal)
        bend = vertex_of(*radius[:, 1:4].T) - vertex_of(*radius[:, ::2].T)
        good = (near >= far * (1 - 1e-6)) & (np.abs(bend) <= 7 * error)
        # Contacts nearer than a fifth of the radius do not count.
        away = np.hypot(*(begin[index] - place).T)
        if np.all(good | (away <= 0.2 * far)):
            return seed
    raise ValueError("every set of probes has one that the judge cannot measure")


def disk_radius(chord: FloatArray, normal: FloatArray) -> FloatArray:
    """Radii (n, m) of the disks with normals (n, 2) through points at chords (n, m, 2)."""
    square = np.einsum("ijk,ijk->ij", chord, chord)
    height = 2 * np.einsum("ijk,ik->ij", chord, normal)
    radius = np.full_like(height, np.inf)
    np.divide(square, height, out=radius, where=height > 1e-12)
    return radius


def least_disks(
    place: FloatArray, normal: FloatArray, points: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Radii (n,) of the least disks at places that touch points within `reach`, and beyond it; and
    the points (n,) that the latter touch."""
    near, far = np.empty((2, len(place)))
    index = np.empty(len(place), dtype=np.int64)
    for start in range(0, len(place), 4):
        part = slice(start, start + 4)
        chord = points - place[part, None]
        close = np.einsum("ijk,ijk->ij", chord, chord) < reach**2
        radius = disk_radius(chord, normal[part])
        near[part] = np.where(close, radius, np.inf).min(axis=1)
        beyond = np.where(close, np.inf, radius)
        far[part], index[part] = beyond.min(axis=1), beyond.argmin(axis=1)
    return near, far, index


def vertex_of(first: FloatArray, middle: FloatArray, last: FloatArray) -> FloatArray:
    """Lowest values (n,) of parabolas through three values at equal steps, as the judge has it."""
    with np.errstate(invalid="ignore"):
        bend = first - 2 * middle + last
    known = np.isfinite(bend) & (bend > 0)
    slope = np.where(known, first, 0.0) - np.where(known, last, 0.0)
    return np.asarray(middle - slope**2 / (8 * np.where(known, bend, 1.0)))


def split_entry(entry: dict[str, Any], error: float) -> dict[str, Any]:
    """The axis with its edges split so that 400 chords of each are off by `error` at most."""
    vertices, edges = list(entry["vertices"]), []
    for edge in entry["edges"]:
        table = np.column_stack([edge["control_points"], edge["radius"]])
        degree = len(table) - 1
        second = np.diff(table[:, :2], 2, axis=0)
        bound = degree * (degree - 1) * np.hypot(*second.T).max(initial=0.0) / (8 * 399**2)
        parts = int(np.ceil(np.sqrt(max(bound / error, 1.0))))
        start = edge["start"]
        for part in range(parts):
            head, table = (table, table) if part == parts - 1 else divided(table, parts - part)
            end = edge["end"]
            if part < parts - 1:
                end = len(vertices)
                x, y, radius = head[-1].tolist()
                vertices.append({"x": x, "y": y, "r": radius, "kind": "joint"})
            edges.append(
                {
                    "start": start,
                    "end": end,
                    "control_points": head[:, :2].tolist(),
                    "radius": head[:, 2].tolist(),
                }
            )
            start = end
    return {**entry, "vertices": vertices, "edges": edges}


def divided(table: FloatArray, parts: int) -> tuple[FloatArray, FloatArray]:
    """Bernstein coefficients of the first of `parts` equal parts, and of the rest."""
    t = 1.0 / parts
    left, right = [table[0]], [table[-1]]
    while len(table) > 1:
        table = (1 - t) * table[:-1] + t * table[1:]
        left.append(table[0])
        right.append(table[-1])
    return np.array(left), np.array(right[::-1])


# -- verdicts -------------------------------------------------------------------------------------


def own_figures(given: Region, axis: MedialAxis, places: int = 600) -> tuple[float, float]:
    """Errors of disks and missing axis by brute force on the exact curves, mm."""
    boundary = Boundary.of(given)
    claimed = claimed_axis(axis)
    flat = claimed.disks
    disk_error = float(np.abs(boundary.distance(flat[:, :2]) - flat[:, 2]).max())
    draw = np.random.default_rng(11)
    piece = draw.integers(0, len(boundary.power), places)
    disks = boundary.disks(piece, draw.uniform(size=places))
    # Contacts that are close together on rational pieces cancel.
    sure = (disks.reach > 0.05 * disks.radius) | ~boundary.rational[piece]
    missing = claimed.distance(disks.table[sure])
    return disk_error, float(missing.max(initial=0.0))


def examine(task: tuple[str, int], options: argparse.Namespace) -> Verdict:
    """One region before the judge."""
    kind, seed = task
    judge = load_judge(options.judge)
    given = region(kind, seed)
    given = moved(given, scale=options.perimeter / given.perimeter)
    try:
        axis = medial_axis(given, options.tol)
    except GeometryError as error:
        return Verdict(kind, seed, {}, (str(error),), "engine: no answer")
    entry = split_entry(axis.to_dict(), options.missing / 4)
    loops = chords(given, options.spacing, options.disk_error / 10)
    seed_of_probes = probe_seed(loops, options.probes, options.missing / 4)
    figures = judge(entry, loops, samples=17, probes=options.probes, seed=seed_of_probes)
    faults = [
        f"{name} {figures[name]:.1e}"
        for name in ("disk_error", "missing")
        if not figures[name] <= getattr(options, name)
    ]
    if not figures["euler_ok"]:
        faults.append("euler")
    if not faults:
        return Verdict(kind, seed, figures, ())
    disk_error, missing = own_figures(given, axis)
    engine = disk_error > options.disk_error or missing > options.missing
    who = "engine" if engine or not figures["euler_ok"] else "judge"
    blame = f"{who}: by brute force disk_error {disk_error:.1e}, missing {missing:.1e}"
    return Verdict(kind, seed, figures, tuple(faults), blame)


def table(verdicts: Sequence[Verdict]) -> Iterator[str]:
    """One line per kind, the faults after it."""
    yield "| kind | regions | within the bars | worst disk_error mm | worst missing mm | euler |"
    yield "|---" + "|---:" * 5 + "|"
    for kind in [*sorted({verdict.kind for verdict in verdicts}), None]:
        rows = [verdict for verdict in verdicts if kind is None or verdict.kind == kind]
        seen = [row.figures for row in rows if row.figures]
        disk, missing = (
            max((float(figures[name]) for figures in seen), default=float("nan"))
            for name in ("disk_error", "missing")
        )
        yield (
            f"| {kind or 'all'} | {len(rows)} | {sum(not row.faults for row in rows)} "
            f"| {disk:.1e} | {missing:.1e} | {sum(bool(f['euler_ok']) for f in seen)} |"
        )
    yield ""
    for row in verdicts:
        if row.faults:
            yield f"- `{row.kind} {row.seed}` {', '.join(row.faults)}; {row.blame}"


def load_judge(path: Path) -> Judge:
    """The function `judge` of a Python file."""
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    module = importlib.import_module(path.stem)
    judge: Judge = module.judge
    return judge


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; the exit code is 1 if the engine is to blame for a fault."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("judge", type=Path, help="Python file with a function judge()")
    parser.add_argument("--count", type=int, default=200, help="regions of all kinds together")
    parser.add_argument("--jobs", type=int, default=1, help="worker processes")
    parser.add_argument("--kind", nargs="+", choices=sorted(KINDS), metavar="KIND")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first of each kind")
    parser.add_argument("--tol", type=float, default=1e-8, help="of the medial axis, mm")
    parser.add_argument("--disk-error", type=float, default=1e-8, help="bar, mm")
    parser.add_argument("--missing", type=float, default=1e-7, help="bar, mm")
    parser.add_argument("--perimeter", type=float, default=60.0, help="of every region, mm")
    parser.add_argument("--spacing", type=float, default=1.5e-4, help="of the judge's points, mm")
    parser.add_argument("--probes", type=int, default=60, help="of the judge, per region")
    parser.add_argument("--out", type=Path, help="write the table here too")
    options = parser.parse_args(arguments)
    if not options.judge.is_file():
        print(f"{options.judge}: no judge there: skipped")
        return 0
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    kinds = options.kind or JUDGED
    tasks = [
        (kinds[number % len(kinds)], options.seed + number // len(kinds))
        for number in range(options.count)
    ]
    verdicts = []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.jobs, mp_context=context) as pool:
        for verdict in pool.map(partial(examine, options=options), tasks):
            verdicts.append(verdict)
            word = ", ".join(verdict.faults) or "good"
            place = f"{len(verdicts)}/{len(tasks)} {verdict.kind} {verdict.seed}"
            print(place, word, verdict.blame, file=sys.stderr, flush=True)
    text = "\n".join(table(verdicts)).rstrip() + "\n"
    print(text, end="")
    if options.out:
        options.out.write_text(text, encoding="utf-8")
    return 1 if any(verdict.blame.startswith("engine") for verdict in verdicts) else 0


if __name__ == "__main__":
    sys.exit(main())
