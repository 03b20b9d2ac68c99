"""The rules of grbl 1.1, as its firmware applies them to a program that a sender streams."""

from __future__ import annotations

import math
import re

LINE_LENGTH = 79
CODES = {
    *("0", "1", "2", "3", "4", "10", "17", "18", "19", "20", "21", "28", "28.1", "30", "30.1"),
    *("38.2", "38.3", "38.4", "38.5", "40", "43.1", "49", "53", "54", "55", "56", "57", "58"),
    *("59", "61", "80", "90", "91", "91.1", "92", "92.1", "93", "94"),
}
MACHINE_CODES = {"0", "1", "2", "3", "4", "5", "8", "9", "30"}
GROUPS = (
    {"0", "1", "2", "3", "80"},
    {"17", "18", "19"},
    {"90", "91"},
    {"20", "21"},
    {"93", "94"},
    {"54", "55", "56", "57", "58", "59"},
)
WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")


def faults(text: str) -> list[str]:
    """What grbl 1.1 would refuse or misread in a program, one message a fault."""
    found: list[str] = []
    position = [0.0, 0.0, 0.0]
    motion, feed, ended, spindle, scale = "0", 0.0, False, 0.0, 1.0
    for number, line in enumerate(text.split("\n"), 1):

        def fault(message: str, number: int = number) -> None:
            found.append(f"line {number}: {message}")

        if len(line) > LINE_LENGTH:
            fault(f"{len(line)} characters")
        if any(not 32 <= ord(character) < 127 for character in line):
            fault("not plain ASCII")
        if set(line) & set("!?~%$"):
            fault("a character that acts at once, % or $")
        code = re.sub(r"\([^()]*\)", "", line).split(";")[0].replace(" ", "").upper()
        if not code:
            continue
        if ended:
            fault("a block after the end")
        words = WORD.findall(code)
        if "".join(letter + value for letter, value in words) != code:
            fault("not made of words")
        codes = [value for letter, value in words if letter == "G"]
        machine = [value for letter, value in words if letter == "M"]
        letters = [letter for letter, _ in words if letter not in "GM"]
        values = {letter: float(value) for letter, value in words if letter not in "GM"}
        for value in codes:
            if value not in CODES:
                fault(f"G{value} is not supported")
        for value in machine:
            if value not in MACHINE_CODES:
                fault(f"M{value} is not supported")
        if len(letters) != len(set(letters)):
            fault("a word is repeated")
        if set(letters) - set("FIJKLNPRSTXYZ"):
            fault("a letter that is not supported")
        if any(len(group & set(codes)) > 1 for group in GROUPS):
            fault("two codes of one modal group")
        if "90.1" in codes or "91" in codes:
            fault("this checker knows absolute coordinates only")
        # Radii are compared in mm, whatever the units.
        scale = 25.4 if "20" in codes else 1.0 if "21" in codes else scale
        values = {
            letter: value * scale if letter in "XYZIJR" else value
            for letter, value in values.items()
        }
        motion = next((value for value in codes if value in GROUPS[0]), motion)
        feed = values.get("F", feed)
        spindle = values.get("S", spindle)
        if "3" in machine and spindle <= 0:
            fault("the spindle starts without a speed")
        ended = ended or bool({"2", "30"} & set(machine))
        axes = [axis for axis in "XYZ" if axis in values]
        if not axes:
            if {"I", "J", "R"} & set(values):
                fault("an arc without X or Y")
            continue
        if motion == "80":
            fault("axis words without a motion")
        if motion in "123" and feed <= 0:
            fault("no feed")
        target = [values.get(axis, old) for axis, old in zip("XYZ", position, strict=True)]
        if motion in "23":
            _arc(values, position, target, fault)
        elif {"I", "J", "R", "K"} & set(values):
            fault("unused words")
        position = target
    if not ended:
        found.append("no M2 or M30")
    return found


def _arc(values, position, target, fault) -> None:
    if "X" not in values and "Y" not in values:
        fault("an arc without X or Y")
    if "P" in values or "K" in values:
        fault("P or K in an arc")
    if "R" in values:
        if math.dist(position[:2], target[:2]) > 2 * abs(values["R"]) or position[:2] == target[:2]:
            fault("R does not fit")
        return
    if "I" not in values and "J" not in values:
        fault("an arc without I, J or R")
    centre = (position[0] + values.get("I", 0.0), position[1] + values.get("J", 0.0))
    radius = math.dist(position[:2], centre)
    mismatch = abs(radius - math.dist(target[:2], centre))
    if mismatch > 0.5 or (mismatch > 0.005 and mismatch > 0.001 * radius):
        fault(f"radii differ by {mismatch:.4f}")
