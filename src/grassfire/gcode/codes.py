"""The words and codes of RS274/NGC milling dialects, and what each means for the tool's path."""

from __future__ import annotations


def _codes(text: str) -> frozenset[str]:
    return frozenset(text.split())


WORD_LETTERS = frozenset("DFHIJKLNPQRSTXYZ")
ROTARY = frozenset("ABC")
MOTIONS = frozenset({"0", "1", "2", "3"})
CYCLES = frozenset({"73", "81", "82", "83", "85", "86", "89"})
PLANES = {"17": "XY", "18": "XZ", "19": "YZ"}

UNITS = {"20": 25.4, "21": 1.0, "700": 25.4, "710": 1.0}
SIEMENS_UNITS = UNITS | {"70": 25.4, "71": 1.0}

COORDINATE_SYSTEMS = frozenset({"54", "55", "56", "57", "58", "59", "59.1", "59.2", "59.3"})
MODAL_GROUPS: tuple[frozenset[str], ...] = (
    MOTIONS | CYCLES | {"33", "38.2", "76", "84"},
    frozenset({"17", "18", "19"}),
    frozenset({"90", "91"}),
    frozenset({"90.1", "91.1"}),
    frozenset({"93", "94", "95"}),
    frozenset(SIEMENS_UNITS),
    frozenset({"40", "41", "42"}),
    frozenset({"43", "43.1", "49"}),
    frozenset({"98", "99"}),
    COORDINATE_SYSTEMS,
    frozenset({"61", "61.1", "64"}),
    frozenset({"4", "10", "28", "30", "53", "92"}),
)
GROUP = {code: index for index, group in enumerate(MODAL_GROUPS) for code in group}

WITHOUT_EFFECT = _codes(
    # Exact stop and blending, look-ahead, homes that are stored, spindle speed mode, cancelling of
    # cycles, compensation, polar words, scaling, mirroring and rotation.
    "8 9 15 28.1 30.1 40 50 50.1 61 61.1 62 64 69 69.1 80 97 103 187"
)
# Of Siemens controllers: exact stop, blending, transformations off, soft and brisk acceleration.
SIEMENS_WITHOUT_EFFECT = _codes("60 601 602 603 641 642 643 644 645 450 451")

_COMPENSATION = "cutter compensation (the path of the tool's centre is not in the text)"
_POST_CENTRE = "let the CAM system write the path of the tool's centre"
_SPLINES = "splines"
_POST_ARCS = "let the CAM system write lines and arcs"
_EXPAND = "expand the program before"
_CYCLE = "a cycle that is not a plain drilling cycle"
REFUSED_CODES: dict[str, tuple[str, str]] = {
    "5": (_SPLINES, _POST_ARCS),
    "5.1": (_SPLINES, _POST_ARCS),
    "5.2": (_SPLINES, _POST_ARCS),
    "5.3": (_SPLINES, _POST_ARCS),
    "6.2": (_SPLINES, _POST_ARCS),
    "7": ("diameter mode", "write radii"),
    "12": ("a circular pocket cycle", _POST_ARCS),
    "13": ("a circular pocket cycle", _POST_ARCS),
    "16": ("polar coordinates", "write X and Y"),
    "31": ("a probing move", "take it out"),
    "33": ("spindle-synchronised motion", "take it out"),
    "33.1": ("spindle-synchronised motion", "take it out"),
    "38.2": ("a probing move", "take it out"),
    "38.3": ("a probing move", "take it out"),
    "38.4": ("a probing move", "take it out"),
    "38.5": ("a probing move", "take it out"),
    "41": (_COMPENSATION, _POST_CENTRE),
    "41.1": (_COMPENSATION, _POST_CENTRE),
    "42": (_COMPENSATION, _POST_CENTRE),
    "42.1": (_COMPENSATION, _POST_CENTRE),
    "43.2": ("added tool offsets", "use one offset for each tool"),
    "43.4": ("control of the tool's centre on five axes", "write a program for three axes"),
    "44": ("negative tool length compensation", "use G43"),
    "51": ("scaling", "write the scaled path"),
    "51.1": ("mirroring", "write the mirrored path"),
    "65": ("a subprogram (macro) call", _EXPAND),
    "66": ("a subprogram (macro) call", _EXPAND),
    "68": ("rotation of coordinates", "write the rotated path"),
    "68.1": ("rotation of coordinates", "write the rotated path"),
    "68.2": ("a tilted plane", "write a program for three axes"),
    "70": ("inch on some controllers, a bolt circle on others", "write G20"),
    "71": ("mm on some controllers, a bolt line on others", "write G21"),
    "72": ("a bolt pattern", "write the holes"),
    "74": (_CYCLE, "take it out"),
    "76": (_CYCLE, "take it out"),
    "84": (_CYCLE, "take it out"),
    "87": (_CYCLE, "take it out"),
    "88": (_CYCLE, "take it out"),
    "92.3": ("restoring of an offset that the text does not hold", "write G92 with its words"),
    "96": ("constant surface speed", "write G97 and a speed"),
}

MACHINE_WITHOUT_EFFECT = _codes(
    # Stops, spindle, coolant, clamps, gears, conveyors, air, overrides, outputs, pallets.
    "0 1 3 4 5 7 8 9 10 11 12 13 16 19 21 22 23 29 31 33 34 35 36 41 42 43 44 48 49 50 51 52 53 60 "
    "62 63 64 65 66 67 68 83 84 88 89 138 139 "
    # Of Marlin: fans, heaters, steppers, waits, reports, limits of the planner.
    "17 18 42 82 104 105 106 107 108 109 110 111 112 114 115 117 118 119 120 121 140 190 201 203 "
    "204 205 220 221 300 400 420 500 501"
)
# Of Marlin: settings and outputs whose words are neither places nor speeds of the spindle.
MACHINE_WITH_OWN_WORDS = _codes(
    "42 92 104 106 109 112 140 190 200 201 202 203 204 205 207 208 209 220 221 250 280 300 301 304 "
    "400 412 413 420 500 501 502 503 569 900 906 907 913 914"
)
SUBPROGRAMS = frozenset({"97", "98"})
ENDS = frozenset({"2", "30", "99"})


def canonical(number: str) -> str:
    """`01` and `1.0` are `1`."""
    whole, _, fraction = number.lstrip("+").partition(".")
    fraction = fraction.rstrip("0")
    return (whole.lstrip("0") or "0") + (f".{fraction}" if fraction else "")
