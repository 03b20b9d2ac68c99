"""From bytes to an ezdxf document: strict read, recovery, raw units."""

from __future__ import annotations

import io
import itertools
import struct
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Final

from grassfire.errors import InputError
from grassfire.report import Finding, Severity

if TYPE_CHECKING:
    from ezdxf.audit import Auditor
    from ezdxf.document import Drawing as Document

UNIT_LENGTHS: Final[dict[str, float]] = {
    "mm": 1.0,
    "cm": 10.0,
    "dm": 100.0,
    "m": 1000.0,
    "km": 1e6,
    "um": 1e-3,
    "nm": 1e-6,
    "in": 25.4,
    "ft": 304.8,
    "yd": 914.4,
    "mi": 1609344.0,
    "mil": 0.0254,
    "uin": 25.4e-6,
    "us-ft": 1200e3 / 3937.0,
    "us-in": 100e3 / 3937.0,
}
"""Length of each unit in mm."""

_ALIASES: Final[dict[str, str]] = {
    "millimeter": "mm",
    "millimetre": "mm",
    "millimeters": "mm",
    "millimetres": "mm",
    "centimeter": "cm",
    "centimetre": "cm",
    "meter": "m",
    "metre": "m",
    "meters": "m",
    "metres": "m",
    "micron": "um",
    "microns": "um",
    "µm": "um",
    "inch": "in",
    "inches": "in",
    '"': "in",
    "foot": "ft",
    "feet": "ft",
    "yard": "yd",
    "yards": "yd",
    "mile": "mi",
    "miles": "mi",
    "thou": "mil",
    "mils": "mil",
}

_INSUNITS: Final[dict[int, str]] = {
    1: "in",
    2: "ft",
    3: "mi",
    4: "mm",
    5: "cm",
    6: "m",
    7: "km",
    8: "uin",
    9: "mil",
    10: "yd",
    12: "nm",
    13: "um",
    14: "dm",
    21: "us-ft",
    22: "us-in",
}

_BINARY_SENTINEL: Final = b"AutoCAD Binary DXF\r\n\x1a\x00"

_SUBCLASS: Final[dict[str, str]] = {
    "LINE": "AcDbLine",
    "CIRCLE": "AcDbCircle",
    "ELLIPSE": "AcDbEllipse",
    "LWPOLYLINE": "AcDbPolyline",
    "SPLINE": "AcDbSpline",
    "INSERT": "AcDbBlockReference",
    "POINT": "AcDbPoint",
}
_COMMON_TAGS: Final = frozenset({b"5", b"330", b"8", b"6", b"62", b"370", b"48", b"60", b"67"})


def resolve_units(
    data: bytes, override: str | None, source: str
) -> tuple[str, float, str, list[Finding]]:
    """Decide the drawing's unit from the argument or the raw ``$INSUNITS`` tag.

    Parameters
    ----------
    data : bytes
        The file.
    override : str, optional
        Unit name that goes before the header.
    source : str
        File name for messages.

    Returns
    -------
    name, length in mm, "header" or "argument", findings

    Raises
    ------
    InputError
        Unknown unit name; no usable ``$INSUNITS`` and no override.
    """
    code = raw_insunits(data)
    header = _INSUNITS.get(code) if code is not None else None
    if override is not None:
        name = _unit_name(override, source)
        findings = []
        if header is not None and header != name:
            findings.append(
                Finding(
                    Severity.INFO,
                    "units-overridden",
                    f"the drawing's header says {header}; read in {name} as asked",
                )
            )
        return name, UNIT_LENGTHS[name], "argument", findings
    if header is None:
        if code is None:
            what = "the drawing states no units ($INSUNITS is absent)"
        elif code == 0:
            what = "the drawing is unitless ($INSUNITS = 0)"
        else:
            what = f"the drawing's units are not usable ($INSUNITS = {code})"
        raise InputError(
            what,
            source=source,
            remedy='give units: --units mm, or units = "mm" under [input] of the job',
        )
    return header, UNIT_LENGTHS[header], "header", []


def _unit_name(text: str, source: str) -> str:
    name = text.strip().lower()
    name = _ALIASES.get(name, name)
    if name not in UNIT_LENGTHS:
        known = [*UNIT_LENGTHS, *_ALIASES]
        near = get_close_matches(name, known, n=3) or list(UNIT_LENGTHS)
        raise InputError(f"unknown unit {text!r}", source=source, remedy="use " + ", ".join(near))
    return name


def raw_insunits(data: bytes) -> int | None:
    """Return the value of the ``$INSUNITS`` tag as it stands in the file, None when absent.

    ASCII and binary DXF alike. ezdxf fills an absent variable with a default of its own, which
    is no evidence, hence the raw bytes.
    """
    if data.startswith(_BINARY_SENTINEL):
        return _raw_insunits_binary(data)
    position = data.find(b"$INSUNITS")
    header_end = data.find(b"ENDSEC")
    if position < 0 or (0 <= header_end < position):
        return None
    lines = data[position : position + 200].splitlines()
    if len(lines) < 3 or lines[1].strip() != b"70":
        return None
    try:
        return int(float(lines[2].strip()))
    except ValueError:
        return None


def _raw_insunits_binary(data: bytes) -> int | None:
    name = b"$INSUNITS\x00"
    position = data.find(name)
    if position < 0:
        return None
    position += len(name)
    # Group codes take two bytes since R13, one byte before: the first tag of the file tells.
    start = len(_BINARY_SENTINEL)
    width = 2 if data[start : start + 2] == b"\x00\x00" else 1
    if int.from_bytes(data[position : position + width], "little") != 70:
        return None
    value = data[position + width : position + width + 2]
    return int(struct.unpack("<h", value)[0]) if len(value) == 2 else None


def load_document(path: Path, data: bytes) -> tuple[Document, list[Finding]]:
    """Read a DXF file: strictly, else by recovery, else with subclass markers restored.

    Parameters
    ----------
    path : Path
        For messages and the strict read.
    data : bytes
        Content of the file.

    Returns
    -------
    document, findings
        Repairs of the recovery are REPAIR findings, what it could not mend ERROR findings.

    Raises
    ------
    InputError
        The bytes are no DXF document.
    """
    from ezdxf import recover
    from ezdxf.filemanagement import readfile
    from ezdxf.lldxf.const import DXFError

    # The exceptions by which ezdxf's parser reacts to malformed input, as far as known.
    failures = (
        DXFError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        ArithmeticError,
        AssertionError,
        OSError,
        EOFError,
        StopIteration,
        struct.error,
    )
    try:
        return readfile(str(path)), []
    except failures as problem:
        reason = _one_line(problem)
    findings = [
        Finding(Severity.REPAIR, "recovered", f"strict reading failed ({reason}); recovered")
    ]
    attempts = [data]
    if not data.startswith(_BINARY_SENTINEL):
        restored, count = restore_subclass_markers(data)
        if count:
            attempts.append(restored)
    for content in attempts:
        try:
            document, auditor = recover.read(io.BytesIO(content))
        except failures as problem:
            reason = _one_line(problem)
            continue
        if content is not data:
            text = f"{count} entities lacked their subclass markers; restored"
            findings.append(Finding(Severity.REPAIR, "subclass-markers", text, size=float(count)))
        return document, findings + _auditor_findings(auditor)
    raise InputError(
        f"not a readable DXF drawing ({reason})",
        source=str(path),
        remedy=(
            "give the drawing that this job names"
            if path.suffix.lower() == ".toml"
            else "export it again, as DXF R2000 or newer"
        ),
    )


def _one_line(problem: BaseException) -> str:
    text = " ".join(str(problem).split())
    return text or type(problem).__name__


def _auditor_findings(auditor: Auditor) -> list[Finding]:
    findings = []
    kinds = (
        (Severity.REPAIR, "audit-fix", auditor.fixes),
        (Severity.ERROR, "audit-error", auditor.errors),
    )
    for severity, code, entries in kinds:
        for entry in entries:
            handle = entry.entity.dxf.handle if entry.entity is not None else None
            findings.append(Finding(severity, code, _one_line(ValueError(entry.message)), handle))
    return findings


def restore_subclass_markers(data: bytes) -> tuple[bytes, int]:
    """Insert the ``100`` tags that a careless writer left out of its entities.

    Parameters
    ----------
    data : bytes
        ASCII DXF.

    Returns
    -------
    bytes, int
        The mended text and the number of entities that were mended.
    """
    lines = data.split(b"\n")
    codes = [line.strip() for line in lines[0::2]]
    values = lines[1::2]
    starts = [index for index, code in enumerate(codes) if code == b"0"]
    starts.append(min(len(codes), len(values)))
    output: list[bytes] = []
    count = 0
    for first, last in itertools.pairwise(starts):
        kind = values[first].strip().decode("ascii", "replace")
        tags = list(zip(codes[first:last], values[first:last], strict=False))
        marker = _SUBCLASS.get(kind)
        if marker is not None and all(code != b"100" for code, _ in tags):
            common = [tag for tag in tags[1:] if tag[0] in _COMMON_TAGS]
            special = [tag for tag in tags[1:] if tag[0] not in _COMMON_TAGS]
            if kind == "LWPOLYLINE" and all(code != b"90" for code, _ in special):
                vertices = sum(code == b"10" for code, _ in special)
                special.insert(0, (b"90", str(vertices).encode()))
            tags = [
                tags[0],
                *common[:1],
                (b"100", b"AcDbEntity"),
                *common[1:],
                (b"100", marker.encode()),
                *special,
            ]
            count += 1
        for code, value in tags:
            output += (code, value.rstrip(b"\r"))
    # Files older than R13 have no subclasses: what carries them is of R2000 at least.
    head = output.index(b"$ACADVER") if b"$ACADVER" in output[:200] else -3
    if head >= 0 and output[head + 2].strip() < b"AC1012":
        output[head + 2] = b"AC1015"
    return b"\n".join(output) + b"\n", count
