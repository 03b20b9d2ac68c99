"""The reader and LinuxCNC's interpreter make the same moves of random legal programs."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grassfire.gcode import PLANE_CHORD, read_program
from grassfire.toolpath import MoveKind, Toolpath
from interpreter import HOW_TO_GET, SPEED, Writer, judged_moves, present

CLOSE = 1e-5  # mm; the interpreter counts in inches


def rows_by_line(text: str) -> dict[int, tuple[Toolpath, np.ndarray]]:
    """For each line: the tool path that holds its rows, and their indices."""
    found = {}
    for section in read_program(text).sections:
        for line in np.unique(section.toolpath.line).tolist():
            found[line] = (section.toolpath, np.flatnonzero(section.toolpath.line == line))
    return found


def compare_arc(path: Toolpath, rows: np.ndarray, theirs: dict[str, Any]) -> None:
    """One arc of theirs and our rows of its line."""
    turns = theirs["turns"]
    assert path.end[rows[-1]] == pytest.approx(theirs["to"], abs=CLOSE)
    assert path.feed[rows] == pytest.approx(theirs["f"], rel=1e-6)
    if theirs["plane"] == "G17":
        assert len(rows) == abs(turns)
        kind = MoveKind.ARC_CCW if turns > 0 else MoveKind.ARC_CW
        assert (path.kind[rows] == kind).all()
        assert path.centre[rows] == pytest.approx(np.tile(theirs["c"], (len(rows), 1)), abs=1e-4)
        return
    first, second, third = (2, 0, 1) if theirs["plane"] == "G18" else (1, 2, 0)
    assert (path.kind[rows] == MoveKind.LINE).all()
    points = np.concatenate([path.begin[rows[:1]], path.end[rows]])
    spokes = points[:, [first, second]] - theirs["c"]
    middles = (spokes[1:] + spokes[:-1]) / 2
    radius = np.hypot(*spokes.T)
    assert radius == pytest.approx(theirs["r0"], abs=1e-3)
    assert np.abs(np.hypot(*middles.T) - radius[1:]).max() < PLANE_CHORD + 1e-3
    angle = np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0]))
    sweep = angle[-1] - angle[0]
    assert math.copysign(1, sweep) == math.copysign(1, turns)
    assert abs(turns) - 1 - 1e-6 <= abs(sweep) / (2 * math.pi) <= abs(turns) + 1e-6
    heights = points[0, third] + (points[-1, third] - points[0, third]) * (angle - angle[0]) / sweep
    assert points[:, third] == pytest.approx(heights, abs=1e-6)


def compare(writer: Writer, text: str, theirs: list[dict[str, Any]]) -> int:
    """Every move of both, line by line; returns how many were compared."""
    ours = rows_by_line(text)
    position = [0.0, 0.0, 0.0]
    by_line: dict[int, list[dict[str, Any]]] = {}
    for move in theirs:
        if "to" not in move:
            continue
        if move["op"] == "arc" or math.dist(position, move["to"]) > 1e-9:
            by_line.setdefault(move["line"], []).append(move)
        position = move["to"]
    assert sorted(by_line) == sorted(ours)
    for line, moves in by_line.items():
        path, rows = ours[line]
        if moves[0]["op"] == "arc":
            assert len(moves) == 1
            compare_arc(path, rows, moves[0])
            continue
        assert len(moves) == len(rows)
        assert path.end[rows] == pytest.approx(np.array([m["to"] for m in moves]), abs=CLOSE)
        per_turn = SPEED if line in writer.lines_per_turn else 1
        feeds = [move.get("f", math.nan) * per_turn for move in moves]
        assert path.feed[rows] == pytest.approx(feeds, rel=1e-6, nan_ok=True)
        assert [kind == MoveKind.RAPID for kind in path.kind[rows]] == [
            move["op"] == "rapid" for move in moves
        ]
    return len(theirs)


@pytest.mark.skipif(not present(), reason=HOW_TO_GET)
@pytest.mark.parametrize("seed", range(10))
def test_same_moves_as_the_interpreter(seed: int, tmp_path: Path) -> None:
    writer = Writer(random.Random(seed))
    text = writer.program(60)
    assert compare(writer, text, judged_moves(text, tmp_path)) > 40


@pytest.mark.skipif(not present(), reason=HOW_TO_GET)
def test_the_comparison_can_fail(tmp_path: Path) -> None:
    writer = Writer(random.Random(1))
    text = writer.program(10)
    theirs = judged_moves(text, tmp_path)
    index = next(i for i, move in enumerate(theirs) if move["op"] == "feed")
    moved = [dict(move) for move in theirs]
    moved[index]["to"] = [moved[index]["to"][0] + 0.001, *moved[index]["to"][1:]]
    with pytest.raises(AssertionError):
        compare(writer, text, moved)
