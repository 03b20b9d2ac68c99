"""DXF drawings to regions: every curve exact, every repair a finding; medial axes to DXF.

The stages are modules: `reading` (file, recovery, units), `entities` (curves of the model space,
blocks included), `splines`, `overlaps`, `chain` and `faces` (closed chains), `nest` (regions) and
`gaps` (contours that were meant to be closed); and `write` (medial axes).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grassfire import tolerance
from grassfire.dxf.chain import Gap, chain_pieces
from grassfire.dxf.entities import Extraction, extract
from grassfire.dxf.gaps import refuse_doubtful
from grassfire.dxf.nest import nest_chains
from grassfire.dxf.reading import load_document, resolve_units
from grassfire.dxf.write import medial_axis_text, write_medial_axis
from grassfire.errors import InputError
from grassfire.geometry import Region
from grassfire.report import Finding, Severity

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document

__all__ = ["Drawing", "medial_axis_text", "read_regions", "write_medial_axis"]

_LARGEST = 20_000.0
"""Extent in mm beyond which the units are probably not what was meant."""

_SMALLEST = 0.1
"""Extent in mm below which the units are probably not what was meant."""


@dataclass(frozen=True)
class Drawing:
    """The regions of a DXF file.

    Attributes
    ----------
    regions : tuple of Region
        In mm, in the order in which their outer loops were found.
    region_layers : tuple of tuple of str
        For each region the layers of the entities of its outer loop.
    units : str
        Unit of the drawing's numbers.
    units_source : str
        "header" or "argument".
    layers : tuple of str
        Layers that were read, sorted.
    findings : tuple of Finding
        Every repair and everything ignored.
    """

    regions: tuple[Region, ...]
    region_layers: tuple[tuple[str, ...], ...]
    units: str
    units_source: str
    layers: tuple[str, ...]
    findings: tuple[Finding, ...]


def read_regions(
    path: str | Path,
    layers: Sequence[str] = (),
    units: str | None = None,
    chaining_tolerance: float = tolerance.CHAINING,
    angular_tolerance: float = tolerance.ANGULAR,
    flattening_tolerance: float = 1e-4,
) -> Drawing:
    """Read the closed contours of a drawing's model space as regions.

    Parameters
    ----------
    path : path
        ASCII or binary DXF.
    layers : sequence of str
        Glob patterns, case ignored; none means all layers.
    units : str, optional
        Unit of the drawing's numbers ("mm", "cm", "m", "in", "ft", "um", "mil", ...); goes before
        the header and is needed when the header's ``$INSUNITS`` is absent or 0.
    chaining_tolerance : float
        Gap between curve ends that is closed, mm. Heights may differ by as much in a curve that
        counts as level.
    angular_tolerance : float
        Turn in radians above which a spline is cut at a corner or cusp inside it.
    flattening_tolerance : float
        Chord error in mm of the polygons that judge crossings and containment; the curves of
        the regions themselves are exact.

    Returns
    -------
    Drawing

    Raises
    ------
    InputError
        Missing or unreadable file, unknown unit or layer, no units, no closed contour, a contour
        that crosses itself, nothing but overlapping contours, a contour with a gap round others or
        in one.
    """
    file = Path(path)
    source = str(path)
    if not chaining_tolerance > 0.0 or not flattening_tolerance > 0.0:
        raise InputError("tolerances must be positive lengths in mm", source=source)
    data = _read_bytes(file, source)
    document, findings = load_document(file, data)
    name, scale, units_source, unit_findings = resolve_units(data, units, source)
    findings += unit_findings
    known = _layer_names(document)
    chosen = _chosen_layers(known, layers, source)
    wanted = {layer.casefold() for layer in chosen}
    extraction = extract(
        document,
        lambda layer: layer.casefold() in wanted,
        scale,
        chaining_tolerance,
        angular_tolerance,
    )
    findings += extraction.findings
    findings += _size_findings(extraction, name)
    chaining = chain_pieces(extraction.pieces, extraction.rings, chaining_tolerance)
    findings += chaining.findings
    if not chaining.chains:
        raise _no_contour(extraction, chaining.gaps, source, chaining_tolerance)
    nesting = nest_chains(chaining.chains, flattening_tolerance, chaining_tolerance, source)
    findings += nesting.findings
    refuse_doubtful(
        nesting.regions, chaining.gaps, flattening_tolerance, chaining_tolerance, source
    )
    return Drawing(nesting.regions, nesting.layers, name, units_source, chosen, tuple(findings))


def _read_bytes(file: Path, source: str) -> bytes:
    try:
        data = file.read_bytes()
        if not data.strip():
            raise InputError("the file is empty", source=source, remedy="export the drawing again")
        return data
    except FileNotFoundError:
        near: list[str] = []
        if file.parent.is_dir():
            names = sorted(item.name for item in file.parent.iterdir() if item.is_file())
            near = get_close_matches(file.name, names, n=3)
        remedy = "did you mean " + ", ".join(near) + "?" if near else "check the path"
        raise InputError("no such file", source=source, remedy=remedy) from None
    except OSError as problem:
        raise InputError(
            f"cannot be read ({problem.strerror})", source=source, remedy="check the file"
        ) from problem


def _layer_names(document: Document) -> tuple[str, ...]:
    """Return the layers of the table and those that entities name without one, sorted."""
    names: dict[str, str] = {}
    for layer in document.layers:
        names.setdefault(str(layer.dxf.name).casefold(), str(layer.dxf.name))
    for entity in document.entitydb.values():
        if entity.dxf.is_supported("layer") and entity.dxf.hasattr("layer"):
            name = str(entity.dxf.layer)
            names.setdefault(name.casefold(), name)
    return tuple(sorted(names.values()))


def _chosen_layers(known: tuple[str, ...], patterns: Sequence[str], source: str) -> tuple[str, ...]:
    if not patterns:
        return known
    chosen: set[str] = set()
    for pattern in patterns:
        hits = {layer for layer in known if fnmatchcase(layer.casefold(), pattern.casefold())}
        if not hits:
            by_fold = {layer.casefold(): layer for layer in known}
            folded = get_close_matches(pattern.casefold(), list(by_fold), n=3, cutoff=0.4)
            near = [by_fold[name] for name in folded] or list(known[:8])
            raise InputError(
                f"no layer matches {pattern!r}",
                source=source,
                remedy="the nearest are " + ", ".join(repr(layer) for layer in near),
            )
        chosen |= hits
    return tuple(sorted(chosen))


def _size_findings(extraction: Extraction, units: str) -> list[Finding]:
    """Doubt the units when the drawing is larger than a hall or smaller than a hair."""
    pieces = [*extraction.pieces, *(piece for ring in extraction.rings for piece in ring)]
    if not pieces:
        return []
    boxes = np.array([piece.curve.bounds() for piece in pieces])
    extent = float(np.max(boxes[:, 2:].max(axis=0) - boxes[:, :2].min(axis=0)))
    if _SMALLEST <= extent <= _LARGEST:
        return []
    text = f"the drawing is {extent:.4g} mm across: are its units really {units}?"
    return [Finding(Severity.WARNING, "units-doubtful", text, size=extent)]


def _no_contour(
    extraction: Extraction, gaps: tuple[Gap, ...], source: str, chaining_tolerance: float
) -> InputError:
    """Say why there is no closed contour: nothing drawn, or where the chains are open."""
    if not gaps:
        ignored = [item.message for item in extraction.findings][:3]
        what = "no closed contour: no usable curves on the layers read"
        if ignored:
            what += " (" + "; ".join(ignored) + ")"
        return InputError(what, source=source, remedy="check the layers and the entities")
    nearest = sorted(gaps, key=lambda gap: gap.size)
    shown = [
        f"({gap.start[0]:.6g}, {gap.start[1]:.6g})-({gap.end[0]:.6g}, {gap.end[1]:.6g})"
        f" {gap.size:.3g} mm"
        for gap in nearest[:5]
    ]
    more = f" and {len(gaps) - 5} more" if len(gaps) > 5 else ""
    return InputError(
        "no closed contour; open between " + ", ".join(shown) + more,
        source=source,
        place=nearest[0].start,
        remedy=f"close the gaps or raise chaining_tolerance (now {chaining_tolerance:g} mm)",
    )
