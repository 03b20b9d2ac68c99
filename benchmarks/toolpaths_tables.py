"""Bars and tables of the benchmark of toolpaths."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

Row = Mapping[str, Any]

PEER_POCKETS = {
    "rect": "rectangle",
    "circle": "circle",
    "lshape": "l-shape",
    "ellipse": "ellipse",
    "slot": "slot",
    "star": "star",
    "gear": "gear",
    "spline": "free-form",
    "islands3": "three-islands",
    "plate40": "forty-islands",
}
"""Names of the pockets that other programs were measured on."""

LIMITS = {
    "gouge_mm": 0.005,
    "floor_gouge_mm": 0.001,
    "uncut_pct": 0.05,
    "rapid_hits": 0,
    "plunge_mm": 0.0,
}
"""Largest figures that are good, whatever the strategy."""

RUN_BAR = 0.2
"""Longest stretch above the limit + 6 degrees, mm."""

SLOT = 150.0
"""Engagement that is a full slot in all but name, degrees."""


def faults(row: Row) -> list[str]:
    """Bars that a program misses."""
    if "failure" in row:
        return ["no program"]
    found = [
        f"{key} {row[key]:.4g}"
        for key, limit in LIMITS.items()
        # a NaN is no good figure either
        if not row[key] <= limit
    ]
    found += [str(error) for error in row["errors"]]
    if row["strategy"] == "adaptive":
        if row["longest_above_bar_mm"] > RUN_BAR:
            found.append(f"above limit + 6 for {row['longest_above_bar_mm']:.2f} mm")
        if row["eng_p99"] > row["limit_deg"] + 3.0:
            found.append(f"eng_p99 {row['eng_p99']:.1f}")
        if row["eng_max"] > SLOT:
            found.append(f"eng_max {row['eng_max']:.0f}")
    if row["strategy"] == "spiral":
        if row["turn_deg"] > 1.0:
            found.append(f"turn {row['turn_deg']:.1f} deg, line {row['turn_line']}")
        if not row["lap_mm"] <= 1.001 * row["lap_bar_mm"]:
            found.append(f"lap {row['lap_mm']:.3f} mm")
        if row["one_lobe"] and row["retracts"] > 3:
            found.append(f"{row['retracts']} retracts")
    return found


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Rows of a file of JSON lines; of rows for the same program the last one."""
    rows = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        row = json.loads(line)
        rows[row["strategy"], row["direction"], row["stepover"], row["pocket"]] = row
    return list(rows.values())


def line_of(row: Row) -> str:
    """One line for a terminal."""
    head = f"{row['pocket']:22s} {row['strategy']:8s} {row['stepover']:g}"
    if "failure" in row:
        return f"{head}  NO PROGRAM  {row['failure']}"
    word = "; ".join(faults(row)) or "ok"
    lap = f" lap {row['lap_mm']:.2f}" if "lap_mm" in row else ""
    engagement = "/".join(f"{row.get(key, 0):.0f}" for key in ("eng_max", "eng_p99", "eng_mean"))
    groups = (
        f"gouge {row['gouge_mm']:.4f} uncut {row['uncut_pct']:.3f}%"
        f" hits {row['rapid_hits']} plunge {row['plunge_mm']:.1f}",
        f"eng {engagement} of {row['limit_deg']:.0f}, run"
        f" >lim {row['longest_above_limit_mm']:.2f} >lim+6 {row['longest_above_bar_mm']:.2f}",
        f"{row['time_s']:.1f} s cut {row['cut_mm']:.0f} (link {row['link_mm']:.0f})"
        f" x{row['cut_ratio']:.2f}/{row['slow_ratio']:.2f} rapid {row['rapid_mm']:.0f}"
        f" retr {row['retracts']} lines {row['program_lines']} arcs {row['arcs']}"
        f" descent {row['descent_deg']:.1f} turn {row['turn_deg']:.1f}{lap}",
        f"plan {row.get('planning_s', math.nan):.2f} s",
        word,
    )
    return f"{head}  {' | '.join(groups)}"


INTRODUCTION = """\
# Toolpaths, measured

Made by `benchmarks/toolpaths.py`; do not edit. Pockets milled with the tool that the table tells, 6
mm deep in three passes at 1200 mm/min, links and rapids at 5000 mm/min; machining time by a clock
with 500 mm/s2 and a junction deviation of 0.01 mm. Engagement in degrees, from a raster that is
good to about 3; *run* is the longest stretch above the limit + 6 degrees, and the limit is the
engagement of a straight cut. Helices descend by the angle of the other program's: 5 degrees for
adaptive, 10 for offset. *Ratio* is the cut length over passes x area / stepover, without links
at raised feed. CPU is planning alone, medial axis included.
"""


def markdown(rows: Sequence[Row], peers: Sequence[Row]) -> str:
    """All tables."""
    parts = [INTRODUCTION]
    if peers:
        parts += [*_side_by_side(rows, peers), ""]
    for kind in dict.fromkeys(map(_kind, rows)):
        strategy, direction, stepover = kind
        title = f"## {strategy}, {direction}, stepover {100 * stepover:g} %"
        parts += [title, "", *_table([row for row in rows if _kind(row) == kind]), ""]
    return "\n".join(parts).rstrip() + "\n"


def _kind(row: Row) -> tuple[str, str, float]:
    return row["strategy"], row["direction"], row["stepover"]


def _table(rows: Sequence[Row]) -> Iterator[str]:
    spiral = rows[0]["strategy"] == "spiral"
    more = " turn | lap mm |" if spiral else ""
    yield (
        "| pocket | tool | gouge mm | uncut % | hits | plunge | eng max/p99/mean | run mm "
        "| time s | cut mm | ratio | links mm | retracts | lines | arcs | CPU s |" + more
    )
    yield "|---|" + "---:|" * (17 if spiral else 15)
    for row in rows:
        if "failure" in row:
            yield f"| {row['pocket']} | no program: {row['failure']} |"
            continue
        extra = f" {row['turn_deg']:.1f} | {row['lap_mm']:.2f} |" if spiral else ""
        yield (
            f"| {row['pocket']} | {row['diameter']:g} | {row['gouge_mm']:.4f} "
            f"| {row['uncut_pct']:.3f} | {row['rapid_hits']} | {row['plunge_mm']:.1f} "
            f"| {row['eng_max']:.0f}/{row['eng_p99']:.0f}/{row['eng_mean']:.0f} "
            f"| {row['longest_above_bar_mm']:.2f} | {row['time_s']:.0f} | {row['cut_mm']:.0f} "
            f"| {row['slow_ratio']:.2f} | {row['link_mm']:.0f} | {row['retracts']} "
            f"| {row['program_lines']} | {row['arcs']} "
            f"| {row.get('planning_s', math.nan):.2f} |{extra}"
        )
    missed = {row["pocket"]: faults(row) for row in rows if faults(row)}
    yield ""
    yield f"{len(rows) - len(missed)} of {len(rows)} meet all bars."
    for pocket, found in missed.items():
        yield f"- {pocket}: {'; '.join(found)}"


PAIRS = (("adaptive", "adaptive", 0.9), ("offset", "offset_ktd", 1.0))
"""Own strategy, the peer's, and the bar for the ratio of machining times."""


def _side_by_side(rows: Sequence[Row], peers: Sequence[Row]) -> Iterator[str]:
    yield "## Beside FreeCAD"
    yield ""
    yield (
        "FreeCAD 0.20 (Debian), headless; its adaptive clearing links by rapids at the depth of the"
    )
    yield "cut. Each cell: ours / FreeCAD's; our cut mm hold the links, its rapids are left out."
    for own, other, bar in PAIRS:
        for kind in dict.fromkeys(map(_kind, rows)):
            pairs = list(_pairs(rows, peers, kind, other)) if kind[0] == own else []
            if not pairs:
                continue
            yield ""
            yield f"### {own}, {kind[1]}, against {other}, stepover {100 * kind[2]:g} %"
            yield ""
            yield (
                "| pocket | time s | ratio | cut mm | retracts | lines | arcs | eng max | eng p99 "
                "| uncut % | gouge mm | CPU s |"
            )
            yield "|---|" + "---:|" * 11
            for ours, theirs in pairs:
                yield _pair_line(ours, theirs)
            ratios = [ours["time_s"] / theirs["time_s"] for ours, theirs in pairs]
            met = sum(ratio <= bar for ratio in ratios)
            yield ""
            middle = median(ratios)
            yield f"Time ratio: median {middle:.2f}, {met} of {len(ratios)} at most {bar:g}."


def _pairs(
    rows: Sequence[Row], peers: Sequence[Row], kind: tuple[str, str, float], other: str
) -> Iterator[tuple[Row, Row]]:
    for row in rows:
        if _kind(row) != kind or "failure" in row:
            continue
        key = other, kind[2], row["pocket"]
        for peer in peers:
            if (peer["strategy"], peer["stepover"], peer["pocket"]) == key:
                yield row, peer


def _pair_line(ours: Row, theirs: Row) -> str:
    def cell(key: str, form: str) -> str:
        return f"{ours[key]:{form}} / {theirs[key]:{form}}"

    return (
        f"| {ours['pocket']} | {cell('time_s', '.0f')} | {ours['time_s'] / theirs['time_s']:.2f} "
        f"| {cell('cut_mm', '.0f')} | {cell('retracts', 'd')} | {cell('program_lines', 'd')} "
        f"| {cell('arcs', 'd')} | {cell('eng_max', '.0f')} | {cell('eng_p99', '.0f')} "
        f"| {cell('uncut_pct', '.3f')} | {cell('gouge_mm', '.4f')} "
        f"| {ours.get('planning_s', math.nan):.2f} / {theirs['plan_cpu_s']:.2f} |"
    )
