"""Time and memory of reading and verifying programs of 10,000 to 1,000,000 lines.

    python benchmarks/verify.py --lines 10000 100000 1000000
    python benchmarks/verify.py --lines 100000 --kind arcs --profile

Each size runs in a process of its own: CPU seconds are those of the process, memory its peak. The
programs clear a wavy pocket by rings at as many levels as the lines allow: `lines` by chords of a
fraction of a millimetre, as free-form programs have them; `arcs` by rings of short arcs; `steps`
holds a level for a hundred moves only, as programs of sloped floors do. The exit code is 1 if a
good program is refused, or if 100,000 lines take more than the limits.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

DIAMETER, DEPTH, SPACING = 4.0, 8.0, 1.4
MACHINE = {"rapid": 5000.0, "acceleration": 500.0, "junction_deviation": 0.01}
LIMIT_LINES, LIMIT_SECONDS, LIMIT_MEGABYTES = 100_000, 5.0, 1024.0


def pocket(size: float) -> shapely.Polygon:
    """A wavy pocket about the origin, `size` mm wide."""
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    reach = size / 2 * (0.85 + 0.1 * np.cos(5 * angle) + 0.05 * np.sin(9 * angle))
    return shapely.Polygon(np.column_stack([reach * np.cos(angle), 0.75 * reach * np.sin(angle)]))


def rings(region: shapely.Polygon, chord: float) -> list[FloatArray]:
    """Rings from the middle outwards as points at most about `chord` mm apart."""
    found = []
    distance = DIAMETER / 2 + 0.002
    while not (inner := region.buffer(-distance, quad_segs=32)).is_empty:
        for ring in shapely.get_rings(shapely.get_parts(inner)):
            count = max(8, math.ceil(ring.length / chord))
            line = shapely.line_interpolate_point(ring, np.arange(count + 1) / count, True)
            found.append(shapely.get_coordinates(line))
        distance += SPACING
    # The last ring may leave a core: a point in the middle of it is one more ring.
    core = shapely.get_coordinates(shapely.centroid(region.buffer(-distance + SPACING)))
    return [*found, np.repeat(core, 2, axis=0)][::-1]


def line_blocks(points: FloatArray, z: FloatArray) -> list[str]:
    """A polyline as G1 blocks."""
    rows = zip(points.tolist(), z.tolist(), strict=True)
    return [f"G1 X{x:.4f} Y{y:.4f} Z{height:.4f}" for (x, y), height in rows]


def arc_blocks(points: FloatArray, level: float) -> list[str]:
    """A polyline as G2 and G3 blocks of large radius within a hundredth of its chords' sagitta."""
    rows = []
    for (x0, y0), (x1, y1) in zip(points[:-1].tolist(), points[1:].tolist(), strict=True):
        half = math.hypot(x1 - x0, y1 - y0) / 2
        if half < 1e-3:
            continue
        radius = 400.0 * half
        rise = math.sqrt(radius**2 - half**2) / (2 * half)
        i, j = (x1 - x0) / 2 - rise * (y1 - y0), (y1 - y0) / 2 + rise * (x1 - x0)
        rows.append(f"G3 X{x1:.4f} Y{y1:.4f} Z{level:.4f} I{i:.4f} J{j:.4f}")
    return rows


def program_text(region: shapely.Polygon, kind: str, lines: int, levels: int, chord: float) -> str:
    """A good program of about so many lines."""
    path = rings(region, chord)
    text = ["G21 G90 G17 G94 G54", "T1 M6", "S12000 M3", "G0 Z10"]
    above = 0.0
    for number in range(1, levels + 1):
        level = -DEPTH * number / levels
        for ring in path:
            x, y = ring[0]
            text += [f"G0 X{x:.4f} Y{y:.4f}", f"G0 Z{above + 0.5:.4f}", f"G1 Z{level:.4f} F300"]
            text.append("F900")
            if kind == "arcs":
                text += arc_blocks(ring, level)
            else:
                height = np.full(len(ring), level)
                if kind == "steps":
                    height = level + 1e-4 * (np.arange(len(ring)) // 100 % 7)
                text += line_blocks(ring[1:], height[1:])
            text.append("G0 Z10")
        above = level
    return "\n".join([*text, "M5", "M30", ""])


def make(kind: str, lines: int) -> tuple[shapely.Polygon, str]:
    """A pocket and a program of nearly `lines` lines for it."""
    size = min(120.0, 0.4 * math.sqrt(lines) + 20)
    region = pocket(size)
    chord = 0.3
    whole = sum(len(ring) for ring in rings(region, chord))
    levels = max(1, round(lines / whole))
    chord *= levels * whole / lines
    return region, program_text(region, kind, lines, levels, chord)


def measure(kind: str, lines: int, profile: bool) -> dict[str, Any]:
    """Read and verify one program; CPU seconds of each, peak memory of the process in MB."""
    from grassfire.gcode import read_program
    from grassfire.verify import Target, verify

    region, text = make(kind, lines)
    target = Target(
        operation=0, region=region, depth=DEPTH, tool_radius=DIAMETER / 2, entry="plunge"
    )
    # Modules that load late are not the program's size.
    small_region, small = make(kind, 1000)
    verify(read_program(small), [target], **MACHINE)
    del small_region
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    begin = time.process_time()
    program = read_program(text)
    middle = time.process_time()
    if profile:
        import cProfile
        import pstats

        with cProfile.Profile() as record:
            result = verify(program, [target], **MACHINE)
        pstats.Stats(record).sort_stats("cumulative").print_stats(28)
    else:
        result = verify(program, [target], **MACHINE)
    end = time.process_time()
    return {
        "kind": kind,
        "lines": text.count("\n"),
        "read_s": middle - begin,
        "verify_s": end - middle,
        "before_mb": before,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "resolution": result.resolution,
        "faults": [str(fault) for fault in result.faults],
    }


def separate(kind: str, lines: int) -> dict[str, Any]:
    """`measure` in a process of its own."""
    command = [sys.executable, __file__, "--one", "--kind", kind, "--lines", str(lines)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found: dict[str, Any] = json.loads(output)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--lines", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--kind", nargs="+", default=["lines", "arcs", "steps"])
    parser.add_argument("--one", action="store_true", help="in this process; JSON")
    parser.add_argument("--profile", action="store_true", help="in this process, with a profile")
    options = parser.parse_args(arguments)
    if options.one or options.profile:
        print(json.dumps(measure(options.kind[0], options.lines[0], options.profile), indent=1))
        return 0
    good = True
    print("| program | lines | read s | verify s | us a line | peak MB | cell mm | refused |")
    print("|---|---:|---:|---:|---:|---:|---:|---|")
    for kind in options.kind:
        for lines in options.lines:
            row = separate(kind, lines)
            seconds = row["read_s"] + row["verify_s"]
            if lines == LIMIT_LINES:
                good &= seconds < LIMIT_SECONDS and row["peak_mb"] < LIMIT_MEGABYTES
            good &= not row["faults"]
            print(
                f"| {kind} | {row['lines']} | {row['read_s']:.2f} | {row['verify_s']:.2f} "
                f"| {1e6 * seconds / row['lines']:.1f} | {row['peak_mb']:.0f} "
                f"| {row['resolution']:.3f} | {'; '.join(row['faults'][:1]) or 'no'} |",
                flush=True,
            )
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
