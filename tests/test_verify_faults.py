"""Seeded faults: good programs, changed one block at a time, must not pass."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Callable
from functools import cache

import pytest

from grassfire.errors import InputError
from grassfire.gcode import read_program
from grassfire.verify import verify
from verify_samples import MACHINE, Sample, SlowJudge, samples

SAMPLES = {item.name: item for item in samples()}
Mutation = Callable[[list[str], random.Random], list[str]]


def words(line: str) -> dict[str, float]:
    return {letter: float(value) for letter, value in re.findall(r"([A-Z])(-?[\d.]+)", line)}


def with_word(line: str, letter: str, value: float) -> str:
    return re.sub(rf"{letter}-?[\d.]+", f"{letter}{value:.4f}", line)


def pick(lines: list[str], choice: random.Random, pattern: str) -> int:
    """Index of a random block that matches a pattern; the test's own programs have one."""
    return choice.choice([i for i, line in enumerate(lines) if re.match(pattern, line)])


def cutting(lines: list[str], choice: random.Random, pattern: str = r"G[123] ") -> int:
    """Index of a random feed block whose end lies below the stock's top."""
    rows = [i for i, s in enumerate(lines) if re.match(pattern, s) and words(s).get("Z", 1) < 0]
    return choice.choice(rows)


def wide_arc(lines: list[str], choice: random.Random, least_radius: float) -> int:
    """Index of a random arc that begins at the far right and has at least a radius."""
    rows = [i for i, s in enumerate(lines) if s.startswith("G3")]
    return choice.choice([i for i in rows if abs(words(lines[i])["I"]) > least_radius])


def shift_centre(lines: list[str], choice: random.Random) -> list[str]:
    row = wide_arc(lines, choice, 3.0)
    lines[row] = with_word(lines[row], "I", words(lines[row])["I"] + choice.choice([-0.3, 0.3]))
    return lines


def mirror_arc(lines: list[str], choice: random.Random) -> list[str]:
    row = wide_arc(lines, choice, 3.0)
    word = words(lines[row])
    lines[row] = with_word(with_word(lines[row], "I", -word["I"]), "J", -word["J"])
    return lines


def reverse_arc(lines: list[str], choice: random.Random) -> list[str]:
    row = wide_arc(lines, choice, 10.9)
    lines[row] = "G2" + lines[row][2:]
    return lines


def arc_to_line(lines: list[str], choice: random.Random) -> list[str]:
    row = wide_arc(lines, choice, 10.9)
    lines[row] = re.sub(r" [IJ]-?[\d.]+", "", "G1" + lines[row][2:])
    return lines


def drop_retract(lines: list[str], choice: random.Random) -> list[str]:
    rows = [
        i
        for i in range(1, len(lines) - 3)
        if lines[i].startswith("G0 X") and words(lines[i - 1]).get("Z", 1) < 0
    ]
    del lines[choice.choice(rows)]
    return lines


def low_retract(lines: list[str], choice: random.Random) -> list[str]:
    rows = [
        i
        for i in range(1, len(lines) - 3)
        if lines[i].startswith("G0 X") and words(lines[i - 1]).get("Z", 1) < 0
    ]
    row = choice.choice(rows)
    lines[row] = with_word(lines[row], "Z", -0.5)
    return lines


def deeper(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice)
    lines[row] = with_word(lines[row], "Z", words(lines[row])["Z"] - choice.choice([0.5, 1.0, 5.0]))
    return lines


def shallower(lines: list[str], choice: random.Random) -> list[str]:
    """The last level of the program comes out too high."""
    deepest = min(words(s).get("Z", 0.0) for s in lines if s.startswith(("G1", "G3")))
    lift = choice.choice([0.1, 0.4])
    return [with_word(s, "Z", deepest + lift) if words(s).get("Z") == deepest else s for s in lines]


def rapid_for_feed(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice, r"G1 ")
    lines[row] = re.sub(r" F\d+", "", "G0" + lines[row][2:])
    return lines


def rapid_down(lines: list[str], choice: random.Random) -> list[str]:
    """The rapid above the entry goes on into the stock."""
    rows = [i for i, s in enumerate(lines) if s.startswith("G0 X") and words(s)["Z"] == 1.0]
    row = choice.choice(rows)
    lines[row] = with_word(lines[row], "Z", -1.0)
    return lines


def missing_level(lines: list[str], choice: random.Random) -> list[str]:
    """All level moves at one height are left out."""
    counts = Counter(words(s)["Z"] for s in lines if s.startswith(("G1", "G3")))
    level = choice.choice(sorted(z for z, count in counts.items() if z < 0 and count >= 6))
    return [s for s in lines if words(s).get("Z") != level]


def swap_coordinates(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice)
    word = words(lines[row])
    lines[row] = with_word(with_word(lines[row], "X", word["Y"]), "Y", word["X"])
    return lines


def missing_moves(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice)
    del lines[row : row + choice.choice([1, 2])]
    return lines


def flip_sign(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice)
    letter = choice.choice("XY")
    lines[row] = with_word(lines[row], letter, -words(lines[row])[letter])
    return lines


def lose_point(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice)
    letter = choice.choice("XYZ")
    lines[row] = re.sub(rf"({letter}-?\d+)\.(\d+)", r"\1\2", lines[row])
    return lines


def wrong_digit(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice)
    letter = choice.choice("XY")
    shift = choice.choice([-10.0, -1.0, 1.0, 10.0])
    lines[row] = with_word(lines[row], letter, words(lines[row])[letter] + shift)
    return lines


def inches(lines: list[str], choice: random.Random) -> list[str]:
    return [s.replace("G21", "G20") for s in lines]


def incremental(lines: list[str], choice: random.Random) -> list[str]:
    lines.insert(cutting(lines, choice), "G91")
    return lines


def plunge(lines: list[str], choice: random.Random) -> list[str]:
    """The first descending moves of an entry become one vertical move."""
    rows = [
        i
        for i in range(1, len(lines))
        if lines[i].startswith(("G1", "G3"))
        and words(lines[i - 1]).get("Z", -99) - words(lines[i])["Z"] > 1e-3
        and words(lines[i])["Z"] < -0.2
    ]
    row = choice.choice(rows)
    here = words(lines[row - 1])
    down = f"G1 X{here['X']:.4f} Y{here['Y']:.4f} Z{here['Z'] - 1.2:.4f} F300"
    lines.insert(row, down)
    return lines


def shift_all(lines: list[str], choice: random.Random) -> list[str]:
    letter, shift = choice.choice("XY"), choice.choice([-0.5, -0.1, 0.1, 2.0])
    return [with_word(s, letter, words(s)[letter] + shift) if " X" in s else s for s in lines]


def lower_all(lines: list[str], choice: random.Random) -> list[str]:
    """A wrong tool length or work offset."""
    shift = choice.choice([-0.5, -0.05, 0.2, 3.0])
    return [with_word(s, "Z", words(s)["Z"] + shift) if " X" in s else s for s in lines]


def duplicate_shifted(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice)
    block = [
        with_word(s, "X", words(s)["X"] + choice.choice([-0.4, 0.4])) if " X" in s else s
        for s in lines[row : row + 8]
    ]
    return lines[: row + 8] + block + lines[row + 8 :]


def no_feed(lines: list[str], choice: random.Random) -> list[str]:
    return [re.sub(r" F\d+", "", s) for s in lines]


def no_spindle(lines: list[str], choice: random.Random) -> list[str]:
    return [s for s in lines if not s.startswith("S12000")]


def spindle_stops(lines: list[str], choice: random.Random) -> list[str]:
    lines.insert(cutting(lines, choice), "M5")
    return lines


def wrong_tool(lines: list[str], choice: random.Random) -> list[str]:
    row = pick(lines, choice, r"T\d")
    lines[row] = "T9 M6"
    return lines


def exchange_blocks(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines[:-3], choice)
    lines[row], lines[row + 1] = lines[row + 1], lines[row]
    return lines


def cut_short(lines: list[str], choice: random.Random) -> list[str]:
    row = cutting(lines, choice)
    return [*lines[:row], "M5", "M30"]


ANYWHERE: tuple[Mutation, ...] = (
    drop_retract,
    low_retract,
    deeper,
    shallower,
    rapid_for_feed,
    rapid_down,
    missing_level,
    swap_coordinates,
    missing_moves,
    flip_sign,
    lose_point,
    wrong_digit,
    inches,
    incremental,
    plunge,
    shift_all,
    lower_all,
    duplicate_shifted,
    no_feed,
    no_spindle,
    spindle_stops,
    wrong_tool,
    exchange_blocks,
    cut_short,
)
ON_ARCS: tuple[Mutation, ...] = (shift_centre, mirror_arc, reverse_arc, arc_to_line)
STATE = {no_feed, no_spindle, spindle_stops, wrong_tool}
"""Harmful whatever the geometry."""


def cases() -> list[tuple[str, Mutation, int]]:
    result = []
    for name in SAMPLES:
        kinds = ANYWHERE if name != "circle" else (*ANYWHERE, *ON_ARCS)
        for mutation in kinds:
            if mutation is drop_retract and name == "circle":
                continue  # its only retract is the last; `cut_short` covers that
            if mutation is low_retract and name == "circle":
                continue
            repeats = 3 if mutation in ON_ARCS else 1
            result += [(name, mutation, seed) for seed in range(repeats)]
    return result


def mutated(name: str, mutation: Mutation, seed: int) -> str:
    """Text of a sample after one mutation; the same for the same arguments."""
    choice = random.Random(f"{name} {mutation.__name__} {seed}")
    return "\n".join(mutation(SAMPLES[name].text.splitlines(), choice)) + "\n"


@cache
def caught(name: str, mutation: Mutation, seed: int) -> bool:
    """Whether the reader refuses the text or the verifier objects to it."""
    try:
        program = read_program(mutated(name, mutation, seed))
    except InputError:
        return True
    return not verify(program, SAMPLES[name].targets, **MACHINE).ok


def harmful(sample: Sample, text: str) -> bool:
    """Whether the slow judge finds harm, or the reader refuses."""
    try:
        program = read_program(text)
    except InputError:
        return True
    return SlowJudge(sample.targets, slices=4).judge(program).harmful


@pytest.mark.parametrize("name", SAMPLES)
def test_good_programs_pass_both_judges(name: str) -> None:
    sample = SAMPLES[name]
    result = verify(read_program(sample.text), sample.targets, **MACHINE)
    assert result.faults == ()
    assert not harmful(sample, sample.text)


@pytest.mark.parametrize(
    ("name", "mutation", "seed"), cases(), ids=lambda value: getattr(value, "__name__", str(value))
)
def test_seeded_faults_are_caught(name: str, mutation: Mutation, seed: int) -> None:
    text = mutated(name, mutation, seed)
    assert text != SAMPLES[name].text
    if not caught(name, mutation, seed):
        # What passes must be harmless by the judge that shares nothing with the verifier.
        assert mutation not in STATE
        assert not harmful(SAMPLES[name], text)


def test_nearly_all_seeded_faults_are_caught_and_are_of_many_kinds() -> None:
    kinds: dict[str, int] = {}
    for name, mutation, seed in cases():
        if caught(name, mutation, seed):
            kinds[mutation.__name__] = kinds.get(mutation.__name__, 0) + 1
    assert sum(kinds.values()) >= 85
    assert len(kinds) >= 25
