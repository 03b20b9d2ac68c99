"""A reader of machine programs of its own: text to moves in mm, by the controllers' rules.

It shares nothing with the writers of programs, so that what it reads is what a controller would
read. It accepts what milling programs of RS274/NGC dialects (Siemens' among them) and of
Heidenhain's plain language hold, and refuses, with the line, what would make the position of the
tool a guess.
"""

from __future__ import annotations

from ..toolpath import Program
from .cycles import PECK_CLEARANCE
from .heidenhain import PlainLanguageReader, is_heidenhain
from .reader import PLANE_CHORD, Reader
from .track import RADIUS_MISMATCH, RADIUS_MISMATCH_RELATIVE

__all__ = [
    "PECK_CLEARANCE",
    "PLANE_CHORD",
    "RADIUS_MISMATCH",
    "RADIUS_MISMATCH_RELATIVE",
    "read_program",
]


def read_program(text: str, *, source: str | None = None, block_delete: bool = True) -> Program:
    """Read a program.

    Parameters
    ----------
    text : str
        G-code of a milling program, or one in Heidenhain's plain language.
    source : str, optional
        Name of the file, for messages and the program's name.
    block_delete : bool
        Whether blocks that begin with `/` are skipped, as with the machine's switch on.

    Returns
    -------
    Program
        One section for each tool, spindle setting and operation marker comment. Every row has its
        line (from 1). Positions are in the program's coordinates, mm; NaN while an axis is not
        known: before its first word and after G28, G30, G53, M6 or a change of the coordinate
        system or of the tool length. Rapids from unknown positions are rows, too. Moves of no
        length are left out. Arcs outside the XY plane are chords, at most `PLANE_CHORD` mm off.
        Tool diameters come from comments, NaN without; roles are told by geometry and feed, see
        `roles.roles_of`. `findings` tells what was read otherwise than every controller would.

    Raises
    ------
    InputError
        With the line: for words and codes that are not known or would make the path a guess
        (subprograms, variables, compensation, splines, rotary axes), feed moves without a known
        start or without feed, arcs whose radii differ by more than `RADIUS_MISMATCH` and
        `RADIUS_MISMATCH_RELATIVE`.
    """
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    if is_heidenhain(text):
        return PlainLanguageReader(source).read(text)
    return Reader(source, block_delete).read(text)
