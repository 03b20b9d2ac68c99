"""From loops to regions: simple, disjoint or nested, islands by containment."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from grassfire.dxf.chain import Chain, chain_pieces
from grassfire.dxf.overlaps import split_overlaps
from grassfire.errors import GeometryError, InputError
from grassfire.geometry import Loop, Region, flatten
from grassfire.report import Finding, Severity

if TYPE_CHECKING:
    from shapely import Polygon

FloatArray = NDArray[np.float64]

_REFINEMENTS: Final = (1.0, 1.0 / 16.0, 1.0 / 256.0)
"""Flattening tolerances, relative to the first one, at which a crossing must persist."""


@dataclass(frozen=True)
class _Contour:
    """A simple loop with its polygon."""

    loop: Loop
    polygon: Polygon
    chain: Chain


@dataclass(frozen=True)
class Nesting:
    """Regions, the layers of their outer loops, findings."""

    regions: tuple[Region, ...]
    layers: tuple[tuple[str, ...], ...]
    findings: tuple[Finding, ...]


def nest_chains(
    chains: tuple[Chain, ...], tolerance: float, chaining_tolerance: float, source: str
) -> Nesting:
    """Sort closed chains into regions with islands.

    Parameters
    ----------
    chains : tuple of Chain
    tolerance : float
        Chord error, in mm, of the polygons by which containment is judged.
    chaining_tolerance : float
        Gap between curve ends that is closed, mm, where contours are taken apart again.
    source : str
        File name for messages.

    Returns
    -------
    Nesting
        Loops at even depth are outer loops, those at odd depth islands. Loops that overlap are
        left out, and with them every region whose material they make doubtful.

    Raises
    ------
    InputError
        A loop crosses itself; nothing is left.
    """
    findings: list[Finding] = []
    contours = _contours(chains, tolerance, source, findings)
    contours, notes = _without_shared_edges(contours, tolerance, chaining_tolerance, source)
    findings += notes
    contours, parents, doubtful = _relations(contours, tolerance, findings)
    depth = [len(parents[index]) for index in range(len(contours))]
    islands: dict[int, list[int]] = defaultdict(list)
    for index in range(len(contours)):
        if depth[index] % 2 == 1:
            islands[_direct_parent(parents[index], depth)].append(index)
    regions: list[Region] = []
    layers: list[tuple[str, ...]] = []
    for index, contour in enumerate(contours):
        if depth[index] % 2 == 1:
            continue
        family = [index, *islands[index]]
        if any(member in doubtful for member in family):
            if index not in doubtful:
                _note_doubtful_region(contour, findings)
            continue
        inner = tuple(contours[member].loop for member in islands[index])
        try:
            regions.append(Region(contour.loop, inner))
        except GeometryError as problem:
            raise InputError(problem.message, source=source, place=problem.place) from problem
        layers.append(contour.chain.layers)
    if not regions:
        errors = [item for item in findings if item.severity is Severity.ERROR]
        raise InputError(
            errors[0].message if errors else "no closed contour encloses an area",
            source=source,
            place=errors[0].place if errors else None,
            remedy="mend the drawing there, or choose layers" if errors else "choose other layers",
        )
    return Nesting(tuple(regions), tuple(layers), tuple(findings))


def _direct_parent(parents: set[int], depth: list[int]) -> int:
    return max(parents, key=lambda parent: (depth[parent], -parent))


def _note_doubtful_region(contour: _Contour, findings: list[Finding]) -> None:
    place = contour.loop.curves[0].start
    findings.append(
        Finding(
            Severity.ERROR,
            "doubtful-region",
            "region left out: its islands overlap",
            contour.chain.handle,
            (float(place[0]), float(place[1])),
            abs(float(contour.loop.area)),
        )
    )


def _contours(
    chains: tuple[Chain, ...], tolerance: float, source: str, findings: list[Finding]
) -> list[_Contour]:
    """Build the loops and their polygons; drop those without area, refuse those that cross."""
    contours = []
    for chain in chains:
        try:
            loop = Loop(chain.curves)
        except GeometryError as problem:
            raise InputError(problem.message, source=source, place=problem.place) from problem
        start = chain.curves[0].start
        bounds = loop.bounds()
        size = math.hypot(bounds[2] - bounds[0], bounds[3] - bounds[1])
        area = _hull_area(loop, min(tolerance, 1e-4 * size))
        if area <= 1e-9 * size * size or area < 1e-9:
            findings.append(
                Finding(
                    Severity.WARNING,
                    "no-area",
                    "closed contour without area dropped",
                    chain.handle,
                    (float(start[0]), float(start[1])),
                    area,
                )
            )
            continue
        chord = min(tolerance, 1e-4 * size)
        contours.append(_Contour(loop, _simple_polygon(loop, chain, chord, source), chain))
    return contours


def _hull_area(loop: Loop, tolerance: float) -> float:
    """Return the area of the loop's convex hull, which crossings do not cancel."""
    import shapely

    return float(shapely.area(shapely.convex_hull(shapely.MultiPoint(flatten(loop, tolerance)))))


def _simple_polygon(loop: Loop, chain: Chain, tolerance: float, source: str) -> Polygon:
    """Return the loop's polygon.

    Chords can cross where the curves do not: at a cusp, where two curves leave a point in the
    same direction. Such a crossing moves towards the cusp as the chords get finer; a true one
    stays.

    Raises
    ------
    InputError
        The loop crosses or touches itself.
    """
    import shapely

    corners = np.array([curve.start for curve in loop.curves])
    distances = []
    place: FloatArray | None = None
    for factor in _REFINEMENTS:
        polygon = shapely.Polygon(flatten(loop, tolerance * factor))
        if polygon.is_valid:
            return polygon
        place = _invalid_place(shapely.is_valid_reason(polygon))
        if place is None:
            break
        distances.append(float(np.hypot(*(corners - place).T).min()))
    receding = len(distances) == len(_REFINEMENTS) and all(
        later <= max(0.6 * earlier, 1e-9) for earlier, later in itertools.pairwise(distances)
    )
    if receding and distances[-1] < 100.0 * tolerance:
        mended = shapely.make_valid(polygon)
        parts = [part for part in shapely.get_parts(mended) if part.geom_type == "Polygon"]
        largest = max(parts, key=lambda part: float(part.area))
        if abs(largest.area - abs(loop.area)) <= 1e-3 * abs(loop.area):
            return shapely.Polygon(largest.exterior)
    where = corners[0] if place is None else place
    name = "" if chain.handle is None else f" (entity {chain.handle})"
    raise InputError(
        f"a contour{name} crosses or touches itself",
        source=source,
        place=[float(value) for value in where],
        remedy="mend the drawing there, or choose layers",
    )


def _invalid_place(reason: str) -> FloatArray | None:
    """Return the coordinates in GEOS's explanation, e.g. ``Self-intersection[1 2]``."""
    inside = reason.partition("[")[2].partition("]")[0].split()
    if len(inside) < 2:
        return None
    return np.array([float(inside[0]), float(inside[1])])


def _without_shared_edges(
    contours: list[_Contour], tolerance: float, chaining_tolerance: float, source: str
) -> tuple[list[_Contour], list[Finding]]:
    """Take contours apart that lie in each other and share an edge: into the faces between.

    Nested loops with a common edge bound no region in the sense of the rest of the package.
    """
    relations = _compare(contours, tolerance)
    affected: set[int] = set()
    for one, other in relations.nested_touching:
        together = contours[one].chain.pieces + contours[other].chain.pieces
        overlaps: list[Finding] = []
        split_overlaps(together, min(chaining_tolerance, tolerance), overlaps)
        if overlaps:
            affected |= {one, other}
    if not affected:
        return contours, []
    pieces = tuple(piece for index in sorted(affected) for piece in contours[index].chain.pieces)
    again = chain_pieces(pieces, (), chaining_tolerance)
    findings = list(again.findings)
    fresh = _contours(again.chains, tolerance, source, findings)
    kept = [contour for index, contour in enumerate(contours) if index not in affected]
    return kept + fresh, findings


@dataclass(frozen=True)
class _Relations:
    """How contours lie to each other; pairs of indices.

    Attributes
    ----------
    around : for each contour the set of those that contain it
    duplicates : later contour to the earlier one that it repeats
    overlaps : (one, other, common area in mm2)
    nested_touching, outside_touching : pairs whose outlines meet
    """

    around: tuple[set[int], ...]
    duplicates: dict[int, int]
    overlaps: tuple[tuple[int, int, float], ...]
    nested_touching: tuple[tuple[int, int], ...]
    outside_touching: tuple[tuple[int, int], ...]


def _compare(contours: list[_Contour], tolerance: float) -> _Relations:
    """Compare all pairs of contours that meet."""
    import shapely

    around: list[set[int]] = [set() for _ in contours]
    duplicates: dict[int, int] = {}
    overlaps: list[tuple[int, int, float]] = []
    nested: list[tuple[int, int]] = []
    outside: list[tuple[int, int]] = []
    polygons = _polygons(contours)
    shapely.prepare(polygons)
    first, second = shapely.STRtree(polygons).query(polygons, predicate="intersects")
    pairs = sorted({(int(a), int(b)) for a, b in zip(first, second, strict=True) if a < b})
    areas, lengths = shapely.area(polygons), shapely.length(polygons)
    for one, other in pairs:
        small, large = (one, other) if areas[one] < areas[other] else (other, one)
        if shapely.contains_properly(polygons[large], polygons[small]):
            around[small].add(large)
            continue
        common = float(shapely.area(shapely.intersection(polygons[one], polygons[other])))
        # A band as wide as both chord errors along the shorter outline is no evidence.
        doubt = 4.0 * tolerance * float(min(lengths[one], lengths[other]))
        if common <= min(doubt, 0.5 * float(areas[small])):
            outside.append((one, other))
        elif common < float(areas[small]) - doubt:
            overlaps.append((one, other, common))
        elif areas[large] - areas[small] <= doubt:
            duplicates.setdefault(other, one)
        else:
            around[small].add(large)
            nested.append((one, other))
    return _Relations(tuple(around), duplicates, tuple(overlaps), tuple(nested), tuple(outside))


def _polygons(contours: list[_Contour]) -> NDArray[np.object_]:
    polygons = np.empty(len(contours), dtype=object)
    polygons[:] = [contour.polygon for contour in contours]
    return polygons


def _relations(
    contours: list[_Contour], tolerance: float, findings: list[Finding]
) -> tuple[list[_Contour], list[set[int]], set[int]]:
    """Report how the contours lie to each other.

    Returns
    -------
    contours without duplicates, for each the set of those around it, the set of overlapping ones
    """
    relations = _compare(contours, tolerance)
    polygons = _polygons(contours)
    duplicates = relations.duplicates
    for one, other in relations.nested_touching + relations.outside_touching:
        if one not in duplicates and other not in duplicates:
            _note_touch(contours, polygons, one, other, findings)
    _note_overlaps(contours, polygons, relations, findings)
    for index, original in duplicates.items():
        place = contours[index].loop.curves[0].start
        text = f"contour drawn again (as entity {contours[original].chain.handle}): dropped"
        findings.append(
            Finding(
                Severity.REPAIR,
                "duplicate-contour",
                text,
                contours[index].chain.handle,
                (float(place[0]), float(place[1])),
                float(polygons[index].area),
            )
        )
    kept = [index for index in range(len(contours)) if index not in duplicates]
    number = {index: place for place, index in enumerate(kept)}
    parents = [{number[p] for p in relations.around[index] if p in number} for index in kept]
    doubtful = {
        number[index]
        for one, other, _ in relations.overlaps
        for index in (one, other)
        if index in number
    }
    return [contours[index] for index in kept], parents, doubtful


def _meeting_place(polygons: NDArray[np.object_], one: int, other: int) -> tuple[float, float]:
    """Return a point where two outlines meet (or come nearest)."""
    import shapely

    lines = [shapely.boundary(polygons[index]) for index in (one, other)]
    common = shapely.intersection(lines[0], lines[1])
    if shapely.is_empty(common):
        common = shapely.shortest_line(lines[0], lines[1])
    x, y = shapely.get_coordinates(common)[0]
    return float(x), float(y)


def _note_touch(
    contours: list[_Contour],
    polygons: NDArray[np.object_],
    one: int,
    other: int,
    findings: list[Finding],
) -> None:
    handles = (contours[one].chain.handle, contours[other].chain.handle)
    text = f"contours touch (entities {handles[0]} and {handles[1]})"
    place = _meeting_place(polygons, one, other)
    findings.append(Finding(Severity.WARNING, "touching", text, handles[1], place, 0.0))


def _note_overlaps(
    contours: list[_Contour],
    polygons: NDArray[np.object_],
    relations: _Relations,
    findings: list[Finding],
) -> None:
    for one, other, common in relations.overlaps:
        if one in relations.duplicates or other in relations.duplicates:
            continue
        handles = (contours[one].chain.handle, contours[other].chain.handle)
        text = (
            f"contours overlap by {common:.4g} mm2 "
            f"(entities {handles[0]} and {handles[1]}): both left out"
        )
        place = _meeting_place(polygons, one, other)
        findings.append(Finding(Severity.ERROR, "overlap-area", text, handles[1], place, common))
