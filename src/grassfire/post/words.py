"""Pieces of program text: numbers, names and comments in the characters that controllers bear."""

from __future__ import annotations

import re
import unicodedata
import zlib

import numpy as np

from ..toolpath import Section
from .definition import Comments, ProgramNumber

_LEADING_NUMBER = re.compile(r"O?0*(\d{1,9})(?![\w.])", re.IGNORECASE)
_PART = re.compile(r"-(\d+)-T\d+$")
_IDENTIFIER_LENGTH = 24


def fixed(value: float, decimals: int) -> str:
    """A number with a fixed count of decimals: no exponent, no negative zero."""
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def trimmed(value: float, decimals: int) -> str:
    """A number with at most so many decimals, without trailing zeros."""
    text = fixed(value, decimals)
    return text.rstrip("0").rstrip(".") if "." in text else text


def fold(text: str, comments: Comments) -> str:
    """Comment text in the characters that a controller bears, cut to its length."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode("ascii")
    forbidden = set(comments.forbidden) | set("()")
    kept = "".join(
        " " if character in forbidden or not character.isprintable() else character
        for character in plain
    )
    kept = " ".join(kept.split())[: comments.max_length].rstrip()
    return kept.upper() if comments.upper_case else kept


def identifier(name: str) -> str:
    """A program's name in capitals, digits and underscores, beginning with a letter or digit."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode("ascii")
    kept = re.sub(r"[^A-Z0-9]+", "_", plain.upper()).strip("_")
    return kept[:_IDENTIFIER_LENGTH].rstrip("_") or "PROGRAM"


def program_number(name: str, number: ProgramNumber) -> str:
    """Number of a program for controllers that know programs by number, with leading zeros.

    A name that begins with a number (`O1234 bracket`, `1234-bracket`) gives it, plus one for every
    part of a program that is split by tools; any other name gives a checksum of its characters
    (CRC-32), so that the same name always has the same number and others seldom share it.
    """
    leading, part = _LEADING_NUMBER.match(name), _PART.search(name)
    if leading:
        value = int(leading[1]) + (int(part[1]) - 1 if part else 0)
    else:
        value = zlib.crc32(name.encode())
    if not leading or not 1 <= value <= number.largest:
        value = 1 + value % number.largest
    return f"{value:0{number.digits}d}"


def diameter_word(diameter: float) -> str:
    """`D6`, or nothing where the diameter is not known."""
    return f"D{trimmed(diameter, 4)}" if np.isfinite(diameter) else ""


def marker(section: Section, comments: Comments) -> str:
    """Text of the comment that opens a section: `operation 1: offset, tool 1 D6`.

    Operations are counted from 1 in text; 0 stands for one that is not known. A long name is cut
    so that the tool stays readable. The diameter is in mm in programs of all units.
    """
    head = f"operation {section.operation + 1}"
    tail = f", tool {section.tool_number} {diameter_word(section.tool_diameter)}".rstrip()
    name = fold(section.name, comments)[: max(0, comments.max_length - len(head) - len(tail) - 2)]
    return head + (f": {name.rstrip()}" if name else "") + tail
