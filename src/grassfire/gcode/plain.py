"""Runs of plain blocks, all at once: nothing but G0 to G3, X, Y, Z, I, J, R and F.

Long programs consist of such blocks. What is told here must be what the reader tells block by
block; where a run holds anything out of the ordinary, nothing is told, and the reader looks at each
block by itself.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..toolpath import FloatArray, MoveKind
from .arcs import centres_by_radius
from .words import NUMBER

SHORTEST: Final = 12
"""Runs of fewer lines are read block by block: arrays cost more."""

LONGEST: Final = 20_000
"""Lines of one run at the most: what bounds the memory."""

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

_BLANK = r"[ \t]*"


def _optional(letter: str) -> str:
    return rf"(?:[{letter}{letter.lower()}]{_BLANK}{NUMBER}{_BLANK})?"


_PLACES = "".join(_optional(letter) for letter in "XYZIJR")
_PLAIN = re.compile(
    rf"{_BLANK}(?:[Nn]{_BLANK}[0-9]+{_BLANK})?(?:[Gg]{_BLANK}0*[0-3](?![0-9.]){_BLANK})?"
    rf"(?:{_optional('F')[:-1]}{_PLACES}|{_PLACES}{_optional('F')})\r?"
)
is_plain = _PLAIN.fullmatch

# Letters to blanks, so that only the numbers are left.
_NUMBERS = str.maketrans(dict.fromkeys("GNXYZIJRFgnxyzijrf", " "))


@dataclass(frozen=True)
class Modes:
    """The modal state that a run starts with; it changes `motion` and `feed`."""

    motion: int
    feed: float
    scale: float
    absolute: bool
    centre_absolute: bool
    shift: tuple[float, float, float]
    position: tuple[float, float, float]


@dataclass(frozen=True)
class Run:
    """Moves of a run: columns as in `Toolpath`; `row` is the index of each move's line."""

    kind: NDArray[np.uint8]
    end: FloatArray
    centre: FloatArray
    feed: FloatArray
    row: IntArray
    motion: int
    last_feed: float


def run_length(lines: Sequence[str], first: int) -> int:
    """How many plain lines follow one another from line `first` on, at most `LONGEST`."""
    stop = min(len(lines), first + LONGEST)
    for index in range(first, stop):
        if not is_plain(lines[index]):
            return index - first
    return stop - first


def read_run(lines: Sequence[str], modes: Modes) -> Run | None:
    """Read plain lines, or None where one of them needs a look of its own."""
    words = _columns(lines)
    motion = _held(words["G"], float(modes.motion))
    feed = _held(words["F"] * modes.scale, modes.feed)
    given = ~np.isnan(np.stack([words[letter] for letter in "XYZIJR"]))
    is_arc = motion >= 2
    moves = given[:3].any(axis=0) | (is_arc & given[3:5].any(axis=0))
    end = _positions(words, modes)
    begin = np.concatenate([[modes.position], end[:-1]])
    if np.any(moves & (motion >= 1) & ~(feed > 0)):
        return None
    arcs = np.flatnonzero(moves & is_arc)
    found = _centres(words, given[3:], begin, end, motion, modes, arcs)
    if found is None:
        return None
    centre = np.full((len(lines), 2), np.nan)
    centre[arcs] = found
    kept = np.flatnonzero(moves & (is_arc | np.any(begin != end, axis=1)))
    kind = np.array(
        [MoveKind.RAPID, MoveKind.LINE, MoveKind.ARC_CW, MoveKind.ARC_CCW], dtype=np.uint8
    )[motion[kept].astype(np.int64)]
    return Run(
        kind=kind,
        end=end[kept],
        centre=centre[kept],
        feed=np.where(kind == MoveKind.RAPID, np.nan, feed[kept]),
        row=kept,
        motion=int(motion[-1]),
        last_feed=float(feed[-1]),
    )


def _columns(lines: Sequence[str]) -> dict[str, FloatArray]:
    """(n,) values of each letter, NaN where a line lacks it."""
    text = "\n".join(lines)
    characters = np.frombuffer(text.encode("ascii"), dtype=np.uint8)
    at = np.flatnonzero((characters & 0xC0) == 0x40)
    letter = characters[at] & 0xDF
    line = np.searchsorted(np.flatnonzero(characters == 0x0A), at)
    value = np.fromiter(map(float, text.translate(_NUMBERS).split()), np.float64, len(at))
    columns = {}
    for name in "GXYZIJRF":
        own = letter == ord(name)
        column = np.full(len(lines), np.nan)
        column[line[own]] = value[own]
        columns[name] = column
    return columns


def _held(values: FloatArray, before: float) -> FloatArray:
    """Each value, NaN replaced by the last one before it."""
    padded = np.concatenate([[before], values])
    index = np.where(np.isnan(padded), 0, np.arange(len(padded)))
    return np.asarray(padded[np.maximum.accumulate(index)][1:])


def _positions(words: dict[str, FloatArray], modes: Modes) -> FloatArray:
    """(n, 3) position after each line."""
    columns = []
    for axis, letter in enumerate("XYZ"):
        value = words[letter] * modes.scale
        if modes.absolute:
            columns.append(_held(value + modes.shift[axis], modes.position[axis]))
        else:
            steps = np.concatenate([[modes.position[axis]], np.nan_to_num(value)])
            columns.append(np.cumsum(steps)[1:])
    return np.stack(columns, axis=1)


def _centres(
    words: dict[str, FloatArray],
    given: BoolArray,
    begin: FloatArray,
    end: FloatArray,
    motion: FloatArray,
    modes: Modes,
    arcs: IntArray,
) -> FloatArray | None:
    """(m, 2) centres of the arcs in the given lines; `given` tells which of I, J, R they have."""
    by_radius, either = given[2, arcs], given[:2, arcs].any(axis=0)
    both = given[:2, arcs].all(axis=0)
    if np.any(by_radius == either) or (modes.centre_absolute and np.any(either & ~both)):
        return None
    offset = np.nan_to_num(np.stack([words["I"][arcs], words["J"][arcs]], axis=1)) * modes.scale
    origin = np.array(modes.shift[:2]) if modes.centre_absolute else begin[arcs, :2]
    result = np.asarray(origin + offset)
    rows = arcs[by_radius]
    if len(rows):
        radius = words["R"][rows] * modes.scale
        chord = np.hypot(*(end[rows, :2] - begin[rows, :2]).T)
        if np.any((chord == 0) | (chord / 2 > np.abs(radius))):
            return None
        counter = np.where(motion[rows] == 3, 1.0, -1.0)
        result[by_radius] = centres_by_radius(begin[rows, :2], end[rows, :2], radius, counter)
    return result
