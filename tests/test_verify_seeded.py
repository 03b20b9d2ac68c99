"""A sample of the seeded faults and of the good programs; benchmarks/faults.py has them all."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture(scope="module")
def faults() -> Iterator[ModuleType]:
    pytest.importorskip("matplotlib")
    path = list(sys.path)
    sys.path.insert(0, str(FOLDER))
    spec = importlib.util.spec_from_file_location("seeded_faults", FOLDER / "faults.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["seeded_faults"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["seeded_faults"]
    sys.path[:] = path


def test_there_are_twenty_kinds_and_more(faults: ModuleType) -> None:
    names = {mutation.__name__ for mutation in faults.MUTATIONS}
    assert len(names) == len(faults.MUTATIONS) >= 20


def test_what_passes_is_harmless(faults: ModuleType) -> None:
    results = [faults.seed_fault(number) for number in range(0, len(faults.MUTATIONS), 3)]
    assert not [item for item in results if item.harmful and not item.caught]
    assert sum(item.caught for item in results) >= len(results) - 2


@pytest.mark.parametrize("number", [4])
def test_good_programs_are_not_blamed(faults: ModuleType, number: int) -> None:
    good = faults.draw_good(number)
    assert faults.judged(good.text, good.targets) == ()


def test_the_independent_judge_sees_harm(faults: ModuleType) -> None:
    good, text = faults.plain(0)
    target = good.targets[0]
    whole = faults.Judge(faults.read_program(text), target).harm()
    assert not whole.harmful
    lines = text.splitlines()
    short = "\n".join([*lines[: len(lines) // 2], "M5", "M30", ""])
    assert faults.Judge(faults.read_program(short), target).harm().uncut > 0.5
