"""Programs through LinuxCNC's interpreter, and the motions it makes against the planned moves."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grassfire.toolpath import FloatArray, MoveKind, Program, Toolpath

CHECKER = Path(__file__).resolve().parents[2] / "shared" / "tools" / "rs274_check.py"
PYTHON = Path("/usr/bin/python3")
MISSING = "needs LinuxCNC's interpreter: bash shared/tools/install_linuxcnc.sh DIR, LCNC_ROOT=DIR"
DIALECT = ("linuxcnc", "mach3", "mach4", "fanuc", "haas", "centroid", "masso", "smoothieware")
"""Posts whose programs are of the dialect that it reads."""

SAMPLES = np.linspace(0, 1, 17)


def available() -> bool:
    """Whether the checker, the interpreter and the Python that it was built for are there."""
    root = os.environ.get("LCNC_ROOT", "")
    interpreter = Path(root) / "usr" / "bin" / "rs274"
    return bool(root) and CHECKER.is_file() and PYTHON.is_file() and interpreter.is_file()


def interpret(path: Path, arc_tolerance: float) -> dict[str, Any]:
    """What the interpreter says of a program; an AssertionError if it refuses.

    `arc_tolerance` is the largest difference of an arc's two radii, mm.
    """
    done = subprocess.run(
        [str(PYTHON), str(CHECKER), str(path), "--arc-tol", str(arc_tolerance)],
        capture_output=True,
        text=True,
        check=False,
    )
    answer: dict[str, Any] = json.loads(done.stdout)
    refused = answer.get("error") or answer.get("strict") or answer.get("module_error")
    assert done.returncode == 0 and not refused, f"{path.name}: {refused}: {answer.get('text')}"
    return answer


@dataclass
class Deviation:
    """Largest distances between made and planned moves, mm: of ends per axis, and of paths."""

    end: float = 0.0
    path: float = 0.0


class _Stream:
    """Motions of the interpreter, one after another."""

    def __init__(self, moves: list[dict[str, Any]]) -> None:
        self.moves = [move for move in moves if "to" in move]
        self.next = 0
        self.position = np.zeros(3)

    def take(self) -> tuple[dict[str, Any], FloatArray]:
        """The next motion and where it begins."""
        assert self.next < len(self.moves), "the program ends before the plan does"
        move, begin = self.moves[self.next], self.position
        self.next += 1
        self.position = np.array(move["to"])
        return move, begin

    def left(self) -> list[dict[str, Any]]:
        """Motions that were not taken."""
        return self.moves[self.next :]


def _made_points(move: dict[str, Any], begin: FloatArray) -> tuple[FloatArray, float]:
    """Points along a motion, and how far it turns."""
    end = np.array(move["to"])
    points = begin + SAMPLES[:, None] * (end - begin)
    if move["op"] != "arc":
        return points, 0.0
    assert move["plane"] == "G17" and abs(move["turns"]) == 1
    centre = np.array(move["c"])
    first, last = begin[:2] - centre, end[:2] - centre
    turn = np.arctan2(last[1], last[0]) - np.arctan2(first[1], first[0])
    turn = turn % (2 * np.pi) if move["turns"] > 0 else -(-turn % (2 * np.pi))
    turn = turn or 2 * np.pi * np.sign(move["turns"])
    angle = np.arctan2(first[1], first[0]) + SAMPLES * turn
    radius = np.hypot(*first) + SAMPLES * (np.hypot(*last) - np.hypot(*first))
    points[:, :2] = centre + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points, float(turn)


def _off_line(points: FloatArray, begin: FloatArray, end: FloatArray) -> float:
    """Largest distance of points from a segment."""
    along = end - begin
    fraction = np.clip((points - begin) @ along / max(float(along @ along), 1e-30), 0, 1)
    return float(np.linalg.norm(points - begin - fraction[:, None] * along, axis=1).max())


def _turned(points: FloatArray, centre: FloatArray) -> float:
    """Angle that points go around a centre."""
    spokes = points[:, :2] - centre
    angle = np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0]))
    return float(angle[-1] - angle[0])


def deviation(program: Program, answer: dict[str, Any], tolerance: float) -> Deviation:
    """Walk along the plan and the motions; an AssertionError where one leaves the other.

    Before a section (tool change, way to its first point) the motions may be other rapids.
    Inside, each planned move is made by one motion or more of its kind, up to its end within
    `tolerance`, mm, per axis; moves shorter than that may be left out. No motion may be left over
    but rapids.
    """
    stream, found = _Stream(answer["moves"]), Deviation()
    for section in program.sections:
        _approach(stream, section.toolpath, tolerance)
        moves = _planned_moves(section.toolpath)
        for move in moves[1:]:
            _follow(stream, move, tolerance, found)
    assert all(move["op"] == "rapid" for move in stream.left()), "feeds after the plan's end"
    return found


def _approach(stream: _Stream, path: Toolpath, tolerance: float) -> None:
    """Rapids up to the first point of a section."""
    assert path.kind[0] == MoveKind.RAPID
    while np.abs(stream.position - path.end[0]).max() > tolerance:
        move, _ = stream.take()
        assert move["op"] == "rapid", f"a feed before the first point of a section: {move}"


@dataclass(frozen=True)
class _Planned:
    """One planned move."""

    index: int
    arc: bool
    rapid: bool
    begin: FloatArray
    end: FloatArray
    centre: FloatArray
    sweep: float


def _planned_moves(path: Toolpath) -> list[_Planned]:
    columns = (path.is_arc.tolist(), (path.kind == MoveKind.RAPID).tolist(), path.begin, path.end)
    rows = zip(*columns, path.centre, path.sweep.tolist(), strict=True)
    return [_Planned(index, *row) for index, row in enumerate(rows)]


def _follow(stream: _Stream, plan: _Planned, tolerance: float, found: Deviation) -> None:
    """The motions of one planned move."""
    end, centre, sweep, index = plan.end, plan.centre, plan.sweep, plan.index
    radius = float(np.hypot(*(plan.begin[:2] - centre))) if plan.arc else 0.0
    turned, made = 0.0, 0

    def arrived() -> bool:
        if np.abs(stream.position - end).max() > tolerance:
            return False
        # The end of a full turn is its start: the angle tells.
        return not plan.arc or radius * abs(sweep - turned) <= 4 * tolerance

    while not arrived():
        move, here = stream.take()
        made += 1
        assert (move["op"] == "rapid") == plan.rapid, f"{move} for planned move {index}"
        if plan.rapid:
            continue
        points, turn = _made_points(move, here)
        if not plan.arc:
            assert turn == 0, f"an arc for planned line {index}"
            found.path = max(found.path, _off_line(points, plan.begin, end))
            continue
        off = np.abs(np.hypot(*(points[:, :2] - centre).T) - radius)
        found.path = max(found.path, float(off.max()))
        turned += _turned(points, centre)
        assert abs(turned) <= abs(sweep) + 4 * tolerance / radius, f"too far round, move {index}"
    if made:
        found.end = max(found.end, float(np.abs(stream.position - end).max()))
