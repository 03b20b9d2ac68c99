"""A reader of G-code of its own: text to moves in mm, by the controllers' rules.

It shares nothing with the writers of G-code, so that what it reads is what a controller would
read. It accepts what milling programs of RS274/NGC dialects hold, and refuses, with the line, what
would make the position of the tool a guess.
"""

from __future__ import annotations

from ..toolpath import Program
from .reader import PECK_CLEARANCE, RADIUS_MISMATCH, RADIUS_MISMATCH_RELATIVE, Reader

__all__ = ["PECK_CLEARANCE", "RADIUS_MISMATCH", "RADIUS_MISMATCH_RELATIVE", "read_program"]


def read_program(text: str, *, source: str | None = None, block_delete: bool = True) -> Program:
    """Read a program.

    Parameters
    ----------
    text : str
        G-code of a milling program.
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
        system. Rapids from unknown positions are rows, too. Moves of no length are left out.
        Tool diameters come from comments, NaN without; roles are told by geometry: descending
        feed moves are ENTRY, rising ones LINK, the others CUT.

    Raises
    ------
    InputError
        With the line: for words and codes that are not known or would make the path a guess
        (subprograms, variables, compensation, arcs outside the XY plane), feed moves without a
        known start or without feed, arcs whose radii differ by more than `RADIUS_MISMATCH` and
        `RADIUS_MISMATCH_RELATIVE`.
    """
    return Reader(source, block_delete).read(text)
