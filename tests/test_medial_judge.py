"""The medial axis against an independent judge that works by brute force."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import medial_shapes as shapes
from grassfire.geometry import Bezier, Line, Region
from grassfire.medial import medial_axis

TOOLS = Path(__file__).resolve().parents[2] / "shared" / "tools"

pytestmark = pytest.mark.skipif(
    not (TOOLS / "mat_judge.py").exists(), reason="the judge is not at hand"
)

# Curves only: the judge's brute force needs fine chords everywhere, and leaves lines whole.
FREE_FORM: dict[str, Callable[[], Region]] = {
    "blob-14": lambda: shapes.blob(12, 14, 30.0),
    "blob-18": lambda: shapes.blob(9, 18, 30.0),
    "blob-22": lambda: shapes.blob(10, 22, 20.0),
    "blob-30": lambda: shapes.blob(15, 30, 20.0),
    "blob-one-island": lambda: shapes.blob_with_islands(12, 14, 1, 20.0),
    "blob-two-islands": lambda: shapes.blob_with_islands(4, 14, 2, 20.0),
    "blob-three-islands": lambda: shapes.blob_with_islands(8, 14, 3, 20.0),
    "hand": lambda: shapes.moved(shapes.hand(), scale=0.5),
    "letter-o": shapes.letter_o,
    "comma": shapes.comma,
}


@pytest.fixture
def judge(monkeypatch: pytest.MonkeyPatch) -> Callable[..., dict[str, Any]]:
    monkeypatch.syspath_prepend(str(TOOLS))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    module = importlib.import_module("mat_judge")
    return module.judge  # type: ignore[no-any-return]


def segments(region: Region) -> list[list[tuple[Any, ...]]]:
    """Loops in the judge's form."""
    result = []
    for loop in region.loops:
        pieces: list[tuple[Any, ...]] = []
        for curve in loop.curves:
            if isinstance(curve, Line):
                pieces.append(("L", tuple(curve.start), tuple(curve.end)))
            else:
                assert isinstance(curve, Bezier)
                pieces.append(("B", [tuple(point) for point in curve.control_points]))
        result.append(pieces)
    return result


@pytest.mark.parametrize("name", list(FREE_FORM))
def test_the_judge_finds_nothing(name: str, judge: Callable[..., dict[str, Any]]) -> None:
    region = FREE_FORM[name]()
    entry = medial_axis(region, 1e-6).to_dict()
    figures = judge(entry, segments(region), samples=9, probes=24)
    assert figures["euler_ok"]
    assert figures["disk_error"] <= 1e-6
    assert figures["missing_pct"] == 0.0
    # The judge draws each edge with 400 points: edges must be short enough for that, too.
    assert figures["missing"] <= 1e-6
