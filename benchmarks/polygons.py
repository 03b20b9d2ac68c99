"""Large polygons, and one medial axis of one of them in a process of its own.

    python benchmarks/polygons.py grassfire star 10000
    python benchmarks/polygons.py pyvoronoi star 10000

The answer is one line of JSON: CPU and wall seconds by stage, peak memory in MB, and what was
found. `benchmarks/mat.py` starts these side by side. Either side has made one small diagram, with
which its libraries are loaded, before its clock starts.
"""

from __future__ import annotations

import argparse
import importlib
import json
import resource
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
TURN = 2.0 * np.pi


def polar(radius: FloatArray | float, angle: FloatArray) -> FloatArray:
    """Points of polar coordinates."""
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def star(edges: int) -> list[FloatArray]:
    """Tips on a circle, valleys of random depth: up to forty times as deep as wide."""
    draw = np.random.default_rng(edges)
    angle = 0.1 + TURN * np.arange(edges) / edges
    depth = min(20.0, 40 * TURN * 50 / edges)
    radius = np.full(edges, 50.0)
    radius[1::2] -= depth * draw.uniform(0.5, 1.0, len(radius[1::2]))
    return [polar(radius, angle)]


def holes(edges: int) -> list[FloatArray]:
    """Square with four-sided islands on a grid, each turned at random."""
    draw = np.random.default_rng(edges)
    count = edges // 4 - 1
    columns = int(np.ceil(np.sqrt(count)))
    pitch = 100.0 / columns
    number = np.arange(count)
    centre = pitch * (np.stack([number % columns, number // columns], axis=1) + 0.5)
    turn = draw.uniform(0, TURN, count)[:, None] - TURN * np.arange(4) / 4
    size = pitch * draw.uniform(0.2, 0.4, count)[:, None]
    corner = np.stack([size * np.cos(turn), size * np.sin(turn)], axis=2) + centre[:, None]
    frame = np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)])
    return [frame, *corner]


def comb(edges: int) -> list[FloatArray]:
    """Equal teeth with parallel walls on a back, 100 mm wide, up to ten times as long as wide."""
    teeth = edges // 4
    pitch = 100.0 / (teeth - 0.5)
    length = min(30.0, 10 * pitch)
    tooth = pitch * np.array([(0.5, 0.0), (0.5, 1.0), (0.0, 1.0), (0.0, 0.0)])
    tooth[:, 1] *= length / pitch
    points = tooth + pitch * np.stack([np.arange(teeth)[::-1], np.zeros(teeth)], axis=1)[:, None]
    corner = points.reshape(-1, 2)
    corner[0, 1] = corner[-1, 1] = -10.0
    return [corner]


def regular(edges: int) -> list[FloatArray]:
    """Regular polygon of radius 50 mm."""
    return [polar(50.0, 0.1 + TURN * np.arange(edges) / edges)]


def flower(edges: int) -> list[FloatArray]:
    """Corners on a curve of five petals."""
    angle = TURN * np.arange(edges) / edges
    return [polar(40 + 10 * np.cos(5 * angle), angle)]


SHAPES = {"star": star, "holes": holes, "comb": comb, "regular": regular, "flower": flower}
"""Polygons by name: each a function of the number of edges."""


class Clock:
    """CPU and wall seconds since the last reading."""

    def __init__(self) -> None:
        self.cpu, self.wall = time.process_time(), time.perf_counter()

    def read(self) -> tuple[float, float]:
        """Seconds, and begin anew."""
        cpu, wall = self.cpu, self.wall
        self.cpu, self.wall = time.process_time(), time.perf_counter()
        return self.cpu - cpu, self.wall - wall


def with_grassfire(loops: list[FloatArray], tol: float) -> dict[str, Any]:
    """Region from points, certified axis, and its edges read out."""
    from grassfire.errors import GeometryError
    from grassfire.geometry import Loop, Region
    from grassfire.medial import medial_axis

    # What is loaded on first use is no part of the work; few points do not load SciPy.
    importlib.import_module("scipy.spatial")
    importlib.import_module("scipy.sparse.csgraph")
    medial_axis(Region(Loop.from_points([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0)])), tol)
    clock = Clock()
    outer, *islands = (Loop.from_points(loop) for loop in loops)
    region = Region(outer, tuple(islands))
    build = clock.read()
    try:
        axis = medial_axis(region, tol)
    except GeometryError as error:
        return {"failure": str(error), "construct": clock.read()}
    construct = clock.read()
    edges, vertices, radii = axis.edges, axis.vertex_point, axis.vertex_radius
    read = clock.read()
    total = (build[0] + construct[0] + read[0], build[1] + construct[1] + read[1])
    return {
        "input": build,
        "construct": construct,
        "read": read,
        "total": total,
        "edges": len(edges),
        "vertices": len(vertices),
        "largest": float(radii.max()),
        "disk_error": axis.certificate.max_disk_error,
    }


def with_pyvoronoi(loops: list[FloatArray], tol: float) -> dict[str, Any]:
    """Segment Voronoi diagram on the grid of integers, read out, edges inside picked."""
    pyvoronoi = importlib.import_module("pyvoronoi")

    points = np.concatenate(loops)
    count = np.array([len(loop) for loop in loops])
    last = np.cumsum(count) - 1
    following = np.arange(len(points)) + 1
    following[last] = last + 1 - count
    small = pyvoronoi.Pyvoronoi(1)
    small.AddSegment([[0, 0], [2, 0]])
    small.Construct()
    small.GetVertices(), small.GetEdges(), small.GetCells()
    clock = Clock()
    diagram = pyvoronoi.Pyvoronoi(int(2**30 / np.abs(points).max()))
    ends = np.stack([points, points[following]], axis=1).tolist()
    for segment in ends:
        diagram.AddSegment(segment)
    build = clock.read()
    diagram.Construct()
    construct = clock.read()
    vertices, edges, cells = diagram.GetVertices(), diagram.GetEdges(), diagram.GetCells()
    read = clock.read()
    inside = inner_edges(points, following, vertices, edges, cells)
    pick = clock.read()
    stages = (build, construct, read, pick)
    return {
        "input": build,
        "construct": construct,
        "read": read,
        "pick": pick,
        "total": (sum(stage[0] for stage in stages), sum(stage[1] for stage in stages)),
        "edges": inside,
        "vertices": len(vertices),
    }


def inner_edges(
    points: FloatArray, following: NDArray[np.int64], vertices: Any, edges: Any, cells: Any
) -> int:
    """Number of the finite primary edges inside the polygon."""
    before = np.empty_like(following)
    before[following] = np.arange(len(following))
    along = points[following] - points
    back = along[before]
    convex = back[:, 0] * along[:, 1] - back[:, 1] * along[:, 0] >= 0
    start, step = points.tolist(), along.tolist()
    found = 0
    for number, edge in enumerate(edges):
        if edge.twin < number or not edge.is_primary or edge.start < 0 or edge.end < 0:
            continue
        one, other = cells[edge.cell], cells[edges[edge.twin].cell]
        cell = one if one.contains_segment else other
        site = cell.site
        if cell.contains_segment:
            first, last = vertices[edge.start], vertices[edge.end]
            x, y = 0.5 * (first.X + last.X), 0.5 * (first.Y + last.Y)
            (px, py), (dx, dy) = start[site], step[site]
            found += dx * (y - py) - dy * (x - px) > 0
        else:
            found += not convex[site if cell.source_category == 1 else following[site]]
    return int(found)


def peak_memory() -> float:
    """Largest memory of this process in MB."""
    status = Path("/proc/self/status")
    if status.exists():
        # Unlike what getrusage gives, this forgets the process that started this one.
        for line in status.read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the figures of one run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("engine", choices=["grassfire", "pyvoronoi"])
    parser.add_argument("shape", choices=sorted(SHAPES))
    parser.add_argument("edges", type=int)
    parser.add_argument("--tol", type=float, default=1e-6, help="mm")
    options = parser.parse_args(arguments)
    engine = {"grassfire": with_grassfire, "pyvoronoi": with_pyvoronoi}[options.engine]
    figures = engine(SHAPES[options.shape](options.edges), options.tol)
    figures["memory"] = peak_memory()
    print(json.dumps(figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
