"""The words and codes of RS274/NGC milling dialects, and what each means for the tool's path."""

from __future__ import annotations

AXES = "XYZ"
WORD_LETTERS = frozenset("FHIJKLNPQRSTXYZD")
MOTIONS = {"0": 0, "00": 0, "1": 1, "01": 1, "2": 2, "02": 2, "3": 3, "03": 3}
CYCLES = frozenset({"73", "81", "82", "83"})

MODAL_GROUPS: tuple[tuple[str, ...], ...] = (
    ("0", "1", "2", "3", "33", "38.2", "73", "76", "80", "81", "82", "83", "84", "85", "86", "89"),
    ("17", "18", "19"),
    ("90", "91"),
    ("90.1", "91.1"),
    ("93", "94", "95"),
    ("20", "21"),
    ("40", "41", "42"),
    ("43", "43.1", "49"),
    ("98", "99"),
    ("54", "55", "56", "57", "58", "59", "59.1", "59.2", "59.3"),
    ("61", "61.1", "64"),
    ("4", "10", "28", "30", "53", "92"),
)
GROUP = {code: index for index, group in enumerate(MODAL_GROUPS) for code in group}
WCS = frozenset(MODAL_GROUPS[9])

# Codes that change nothing in the tool's path.
WITHOUT_EFFECT = frozenset(
    {
        "8",
        "28.1",
        "30.1",
        "40",
        "43",
        "49",
        "50",
        "61",
        "61.1",
        "64",
        "69",
        "92.1",
        "94",
        "97",
        "103",
        "187",
    }
)
REFUSED_CODES = {
    "41": "cutter compensation (the path of the tool's centre is not in the text)",
    "42": "cutter compensation (the path of the tool's centre is not in the text)",
    "10": "setting of coordinate systems",
    "92": "setting of coordinate systems",
    "52": "setting of coordinate systems",
    "7": "diameter mode",
    "93": "inverse time feed",
    "95": "feed per turn",
    "51": "scaling",
    "68": "rotation of coordinates",
    "65": "a subprogram (macro) call",
    "66": "a subprogram (macro) call",
}
MACHINE_WITHOUT_EFFECT = frozenset(
    {"0", "1", "5", "7", "8", "9", "10", "11", "19", "48", "49", "50", "52", "53", "60"}
)
SUBPROGRAMS = frozenset({"97", "98"})


def canonical(number: str) -> str:
    """`01` and `1.0` are `1`."""
    whole, _, fraction = number.lstrip("+").partition(".")
    fraction = fraction.rstrip("0")
    return (whole.lstrip("0") or "0") + (f".{fraction}" if fraction else "")
