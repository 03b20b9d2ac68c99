"""Lines of text into comments and words."""

from __future__ import annotations

import re
from typing import Final

NUMBER: Final = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"

TOKEN: Final = re.compile(rf"([A-Z])[ \t]*({NUMBER})|([^ \t])")
"""A word's letter and number, or what is not part of a word."""

PROGRAM_NUMBER: Final = re.compile(r"[O:][ \t]*[0-9]+[ \t]*$")

# Marlin shows what follows on its display; a stop's text begins with two letters in a row.
_TEXT = re.compile(
    r"((?:N[0-9]+[ \t]*)?M0*(?:(?:117|118)\b|[01](?=[ \t]+[A-Z]{2})))[ \t]*(.*)$", re.IGNORECASE
)

_OPENING = re.compile(r"[(;]")
_SIEMENS = re.compile(
    r"[=\"]|\b(?:MSG|SUPA|STOPRE|FFWON|FFWOF|SOFT|BRISK|COMPON|COMPOF|COMPCAD|COMPCURV|RET"
    r"|CYCLE[0-9]+|MCALL|TRAFOOF|ORIWKS|ORIAXES|WORKPIECE|DEF|PROC|GOTO[BFC]?|REPEAT|ENDFOR)\b",
    re.IGNORECASE,
)
_SIEMENS_MESSAGE = re.compile(r"\bMSG[ \t]*\((?:[ \t]*\"([^\"]*)\")?[ \t]*\)", re.IGNORECASE)
_SIEMENS_SETTING = re.compile(
    r"\b(?:STOPRE|FFWON|FFWOF|SOFT|BRISK|COMPON|COMPOF|COMPCAD|COMPCURV|TRAFOOF|ORIWKS|ORIAXES)\b"
    r"|\b(?:WORKPIECE|CYCLE832|CYCLE800)[ \t]*\([^()]*\)"
)
_SIEMENS_WORD = re.compile(
    rf"\b([A-Z]{{1,4}})[ \t]*=[ \t]*"
    rf"(?:(AC|IC)[ \t]*\([ \t]*({NUMBER})[ \t]*\)|({NUMBER})(?![A-Z(*/+-]))"
)
_SIEMENS_RADIUS: Final = {"CR": "R"}


def without_comments(raw: str) -> tuple[str, list[str]] | None:
    """Code of a line and its comments, `(...)` and `;...`; None where one is not closed."""
    code, comments, rest = "", [], raw
    while rest:
        opening = _OPENING.search(rest)
        if not opening:
            code += rest
            break
        code += rest[: opening.start()]
        if opening.group() == ";":
            comments.append(rest[opening.end() :])
            break
        end = rest.find(")", opening.end())
        if end < 0:
            return None
        comments.append(rest[opening.end() : end])
        code += " "
        rest = rest[end + 1 :]
    return code, comments


def text_command(code: str) -> tuple[str, str] | None:
    """The command and its text where a line's rest is text for people, as with Marlin's M117."""
    found = _TEXT.match(code)
    return (found[1], found[2]) if found else None


def is_siemens(code: str) -> bool:
    """Whether code without comments holds what only Siemens controllers know."""
    return _SIEMENS.search(code) is not None


def siemens_words(raw: str) -> tuple[str, list[str], dict[str, bool]]:
    """A line of a Siemens program in the words of other controllers.

    Returns
    -------
    code : str
        Upper case; `CR=5` is `R5`, `SUPA` is `G53`, `X=AC(1)` is `X1`. What has no such form is
        left as it was.
    comments : list of str
        Texts of the comment and of messages.
    absolute : dict of str to bool
        Letters that are absolute (AC) or relative (IC) whatever G90 and G91 say.
    """
    comments: list[str] = []
    absolute: dict[str, bool] = {}

    def message(found: re.Match[str]) -> str:
        comments.append(found[1] or "")
        return " "

    def word(found: re.Match[str]) -> str:
        letters, coordinate, value, plain = found.groups()
        if letters == "TURN":
            return f" L{plain or value} "
        letter = _SIEMENS_RADIUS.get(letters, letters)
        if len(letter) > 1:
            return found[0]
        if coordinate:
            absolute[letter] = coordinate == "AC"
        return f" {letter}{plain or value} "

    code = _SIEMENS_MESSAGE.sub(message, raw)
    code, separator, comment = code.partition(";")
    if separator:
        comments.append(comment)
    code = _SIEMENS_SETTING.sub(" ", code.upper())
    code = re.sub(r"\b(?:SUPA|G153)\b", "G53", code)
    code = _SIEMENS_WORD.sub(word, code)
    return code.strip(), comments, absolute
