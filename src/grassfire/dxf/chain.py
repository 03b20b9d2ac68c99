"""Curves to closed chains: duplicates out, ends joined, branch points resolved."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from grassfire.dxf.entities import SHORTEST, Piece
from grassfire.dxf.faces import Edge, bounded_faces, split_at_repeats
from grassfire.dxf.overlaps import split_overlaps
from grassfire.errors import GeometryError
from grassfire.geometry import Arc, Curve, EllipticalArc, Line
from grassfire.geometry.neighbours import Neighbours, connected
from grassfire.report import Finding, Severity

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

EXACT: Final = 1e-6
"""Gaps up to this, in mm, are rounding of the file: closed without a finding each."""

OUTLINED: Final = 33
"""Places at which the shape of a curve of an open chain is looked at."""

DUPLICATE: Final = 1e-4
"""Curves that agree within this, in mm (or the chaining tolerance, if less), are duplicates."""


@dataclass(frozen=True)
class Chain:
    """A closed chain: its pieces in order, each end the start of the next."""

    pieces: tuple[Piece, ...]

    @property
    def curves(self) -> tuple[Curve, ...]:
        """Its curves, in order."""
        return tuple(piece.curve for piece in self.pieces)

    @property
    def layers(self) -> tuple[str, ...]:
        """Layers of its entities, in order of appearance."""
        return tuple(dict.fromkeys(piece.layer for piece in self.pieces))

    @property
    def handle(self) -> str | None:
        """Handle of its first entity."""
        return self.pieces[0].handle


@dataclass(frozen=True)
class Gap:
    """Two loose ends of a chain that is not closed, in mm.

    Attributes
    ----------
    start, end : tuple of float
    size : float
        Their distance.
    outline : (n, 2) float array or None
        From one to the other along the chain; None where it has branches or further ends, and for
        a single line.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    size: float
    outline: FloatArray | None = None


@dataclass(frozen=True)
class Chaining:
    """Closed chains, the gaps of what stayed open, findings."""

    chains: tuple[Chain, ...]
    gaps: tuple[Gap, ...]
    findings: tuple[Finding, ...]


def chain_pieces(
    pieces: tuple[Piece, ...], rings: tuple[tuple[Piece, ...], ...], tolerance: float
) -> Chaining:
    """Join curves to closed chains.

    Parameters
    ----------
    pieces : tuple of Piece
        Curves in any order and direction.
    rings : tuple of tuple of Piece
        Contours that are closed as drawn.
    tolerance : float
        Gap between ends that is closed, mm.

    Returns
    -------
    Chaining
    """
    findings: list[Finding] = []
    chains: list[Chain] = []
    for ring in rings:
        chains += _close_ring(ring, findings)
    kept = _without_duplicates(pieces, min(tolerance, DUPLICATE), findings)
    cut = split_overlaps(kept, min(tolerance, DUPLICATE), findings)
    if len(cut) != len(kept):
        cut = _without_duplicates(cut, min(tolerance, DUPLICATE), None)
    if not cut:
        return Chaining(tuple(chains), (), tuple(findings))
    nodes, places = _join_ends(cut, tolerance, findings)
    edges = [Edge(int(a), int(b), piece.curve) for (a, b), piece in zip(nodes, cut, strict=True)]
    cycles, open_edges = _cycles(edges, cut, places, findings)
    for cycle in cycles:
        chains += _build(cycle, edges, cut, places, findings)
    gaps = _open_chains(open_edges, edges, cut, places, findings)
    return Chaining(tuple(chains), tuple(gaps), tuple(findings))


def _close_ring(ring: tuple[Piece, ...], findings: list[Finding]) -> list[Chain]:
    """Return the chains of a contour that is closed as drawn: one, or more if it is pinched."""
    if len(ring) == 1:
        return [Chain(ring)]
    starts = np.array([piece.curve.start for piece in ring])
    pairs = Neighbours(starts).pairs(SHORTEST)
    label = np.arange(len(ring))
    for first, second in sorted(map(tuple, pairs.tolist())):
        label[second] = label[first]
    count = len(ring)
    edges = [
        Edge(int(label[index]), int(label[(index + 1) % count]), piece.curve)
        for index, piece in enumerate(ring)
    ]
    walk = [(index, False) for index in range(count)]
    cycles = [walk] if len(pairs) == 0 else split_at_repeats(walk, edges)
    if len(cycles) > 1:
        where = ring[int(np.flatnonzero(label != np.arange(count))[0])].curve.start
        text = f"contour touches itself at a vertex: taken apart into {len(cycles)}"
        findings.append(_finding(Severity.REPAIR, "pinched", text, ring[0].handle, where))
    chains: list[Chain] = []
    for cycle in cycles:
        chains += _build(cycle, edges, ring, starts, findings)
    return chains


def _finding(
    severity: Severity,
    code: str,
    message: str,
    handle: str | None,
    place: FloatArray,
    size: float | None = None,
) -> Finding:
    return Finding(severity, code, message, handle, (float(place[0]), float(place[1])), size)


def _samples(pieces: tuple[Piece, ...]) -> FloatArray:
    """Return the points at the quarters of each curve, shape (n, 5, 2)."""
    return np.array([piece.curve.point(np.linspace(0.0, 1.0, 5)) for piece in pieces])


def _without_duplicates(
    pieces: tuple[Piece, ...], tolerance: float, findings: list[Finding] | None
) -> tuple[Piece, ...]:
    """Drop each curve that runs along an earlier one, in either direction."""
    if len(pieces) < 2:
        return pieces
    samples = _samples(pieces)
    pairs = Neighbours(samples[:, 2]).pairs(tolerance)
    if len(pairs) == 0:
        return pieces
    pairs = np.sort(pairs, axis=1)
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    one, other = samples[pairs[:, 0]], samples[pairs[:, 1]]
    same = np.abs(one - other).max(axis=(1, 2))
    opposite = np.abs(one - other[:, ::-1]).max(axis=(1, 2))
    # Short curves differ by little in any case: compare with their own extent too.
    extent = np.ptp(one, axis=1).max(axis=1)
    equal = np.minimum(same, opposite) <= np.minimum(tolerance, 1e-2 * extent)
    dropped: set[int] = set()
    for first, second in pairs[equal].tolist():
        if first in dropped or second in dropped:
            continue
        dropped.add(second)
        if findings is not None:
            piece = pieces[second]
            text = f"duplicate of entity {pieces[first].handle} dropped"
            place = samples[second, 2]
            length = piece.curve.length(1e-6)
            findings.append(
                _finding(Severity.REPAIR, "duplicate", text, piece.handle, place, length)
            )
    return tuple(piece for index, piece in enumerate(pieces) if index not in dropped)


def _join_ends(
    pieces: tuple[Piece, ...], tolerance: float, findings: list[Finding]
) -> tuple[IntArray, FloatArray]:
    """Number the places where ends meet.

    First the ends that agree up to rounding; then loose ends within the tolerance, nearest pairs
    first; then loose ends to any other node within the tolerance.

    Returns
    -------
    (n, 2) int array, (m, 2) array
        Node of the start and end of each piece; place of each node.
    """
    ends = np.array([(piece.curve.start, piece.curve.end) for piece in pieces]).reshape(-1, 2)
    pairs = Neighbours(ends).pairs(min(EXACT, tolerance))
    label = connected(pairs[:, 0], pairs[:, 1], len(ends))
    count = int(label.max(initial=-1)) + 1
    degree = np.bincount(label, minlength=count)
    places = _means(ends, label, count)
    spread = np.hypot(*(ends - places[label]).T)
    if float(spread.max()) > SHORTEST:
        worst = int(np.argmax(spread))
        joints = len(np.unique(label[spread > SHORTEST]))
        text = f"{joints} joints closed over at most {2 * float(spread.max()):.3g} mm of rounding"
        findings.append(
            _finding(
                Severity.INFO,
                "rounding",
                text,
                pieces[worst // 2].handle,
                ends[worst],
                2 * float(spread.max()),
            )
        )
    merged = _merge_loose(places, degree, tolerance, _own_lengths(pieces, label, count))
    for first, second, size in merged:
        owner = int(np.flatnonzero(label == second)[0])
        text = f"gap of {size:.3g} mm closed"
        place = 0.5 * (places[first] + places[second])
        findings.append(
            _finding(Severity.REPAIR, "gap-closed", text, pieces[owner // 2].handle, place, size)
        )
    if merged:
        links = np.array([(first, second) for first, second, _ in merged])
        group = connected(links[:, 0], links[:, 1], count)
        count = int(group.max(initial=-1)) + 1
        # An established node stays where it is; loose ends meet half-way.
        firm = degree > 1
        anchored = np.bincount(group[firm], minlength=count) > 0
        use = firm | ~anchored[group]
        places = _means(places[use], group[use], count)
        label = group[label]
    return label.reshape(-1, 2).astype(np.int64), places


def _means(points: FloatArray, label: IntArray, count: int) -> FloatArray:
    """Return the mean of the points with each label, exact where they agree; (count, 2)."""
    total = np.bincount(label, minlength=count)
    first = np.zeros((count, 2))
    first[label[::-1]] = points[::-1]
    offset = points - first[label]
    shift = np.column_stack([np.bincount(label, offset[:, axis], count) for axis in (0, 1)])
    return np.asarray(first + shift / np.maximum(total, 1)[:, None])


def _own_lengths(pieces: tuple[Piece, ...], label: IntArray, count: int) -> dict[int, float]:
    """Return, by pair of nodes (as first * count + second), the shortest curve between them."""
    lengths: dict[int, float] = {}
    for piece, (first, second) in zip(pieces, label.reshape(-1, 2).tolist(), strict=True):
        key = min(first, second) * count + max(first, second)
        box = piece.curve.bounds()
        size = math.hypot(box[2] - box[0], box[3] - box[1])
        lengths[key] = min(size, lengths.get(key, math.inf))
    return lengths


def _merge_loose(
    places: FloatArray, degree: IntArray, tolerance: float, own: dict[int, float]
) -> list[tuple[int, int, float]]:
    """Return the pairs of nodes (first, second, distance) that are to become one."""
    loose = np.flatnonzero(degree == 1)
    if len(loose) == 0:
        return []
    count = len(places)
    pairs = Neighbours(places).pairs(tolerance)
    if len(pairs) == 0:
        return []
    pairs = np.sort(pairs, axis=1)
    distance = np.hypot(*(places[pairs[:, 0]] - places[pairs[:, 1]]).T)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], distance))
    free = set(loose.tolist())
    merged: list[tuple[int, int, float]] = []
    for both in (True, False):
        for index in order.tolist():
            first, second = (int(value) for value in pairs[index])
            size = float(distance[index])
            # The two ends of one short curve are not a gap.
            if own.get(first * count + second, math.inf) < 4.0 * size:
                continue
            here = (first in free) + (second in free)
            if here == 2 or (not both and here == 1):
                free -= {first, second}
                merged.append((first, second, size))
    return merged


def _cycles(
    edges: list[Edge],
    pieces: tuple[Piece, ...],
    places: FloatArray,
    findings: list[Finding],
) -> tuple[list[list[tuple[int, bool]]], list[int]]:
    """Return the closed walks of the graph and the edges that belong to none."""
    at: dict[int, list[int]] = defaultdict(list)
    for index, edge in enumerate(edges):
        at[edge.start].append(index)
        at[edge.end].append(index)
    alive = set(range(len(edges)))
    stack = sorted(node for node, around in at.items() if len(around) == 1)
    degree = {node: len(around) for node, around in at.items()}
    while stack:
        node = stack.pop()
        for index in at[node]:
            if index in alive:
                alive.discard(index)
                for end in (edges[index].start, edges[index].end):
                    degree[end] -= 1
                    if degree[end] == 1:
                        stack.append(end)
    open_edges = sorted(set(range(len(edges))) - alive)
    cycles: list[list[tuple[int, bool]]] = []
    for component in _components(edges, at, alive):
        nodes = sorted(
            {edges[index].start for index in component} | {edges[index].end for index in component}
        )
        branches = [node for node in nodes if degree[node] > 2]
        if not branches:
            cycles.append(_walk((component[0], False), edges, at, alive))
            continue
        for node in branches:
            text = f"{degree[node]} curves meet: split into the faces between them"
            handle = pieces[min(i for i in at[node] if i in alive)].handle
            findings.append(
                _finding(
                    Severity.WARNING, "branch", text, handle, places[node], float(degree[node])
                )
            )
        faces, unused = bounded_faces(component, edges)
        cycles += faces
        for index in unused:
            text = "curve bounds no face: ignored"
            place = edges[index].curve.point(0.5)
            findings.append(_finding(Severity.WARNING, "bridge", text, pieces[index].handle, place))
    return cycles, open_edges


def _components(edges: list[Edge], at: dict[int, list[int]], alive: set[int]) -> list[list[int]]:
    """Return the connected sets of edges, in order of their first edge."""
    seen: set[int] = set()
    result = []
    for seed in sorted(alive):
        if seed in seen:
            continue
        seen.add(seed)
        stack, component = [seed], []
        while stack:
            index = stack.pop()
            component.append(index)
            for node in (edges[index].start, edges[index].end):
                for other in at[node]:
                    if other in alive and other not in seen:
                        seen.add(other)
                        stack.append(other)
        result.append(sorted(component))
    return result


def _walk(
    first: tuple[int, bool], edges: list[Edge], at: dict[int, list[int]], alive: set[int]
) -> list[tuple[int, bool]]:
    """Return the walk from an edge on, backwards or not, where two curves meet at every node.

    It ends where it would begin again, or where nothing goes on.
    """
    walk = []
    index, backward = first
    while True:
        walk.append((index, backward))
        node = edges[index].start if backward else edges[index].end
        others = [other for other in at[node] if other != index and other in alive]
        if not others or others[0] == first[0]:
            return walk
        index = others[0]
        backward = edges[index].start != node


def _build(
    cycle: list[tuple[int, bool]],
    edges: list[Edge],
    pieces: tuple[Piece, ...],
    places: FloatArray,
    findings: list[Finding],
) -> list[Chain]:
    """Make the curves of a closed walk meet exactly in their nodes."""
    parts: list[Piece] = []
    for index, backward in cycle:
        edge, owner = edges[index], pieces[index]
        moved = _moved(edge.curve, places[edge.start], places[edge.end])
        if backward:
            moved = [curve.reversed() for curve in reversed(moved)]
        parts += [replace(owner, curve=curve) for curve in moved]
    if not parts:
        return []
    parts = _rejoined(parts)
    if all(isinstance(part.curve, Line) for part in parts) and len(parts) < 3:
        text = "lines there and back enclose nothing: dropped"
        place = parts[0].curve.start
        findings.append(_finding(Severity.WARNING, "no-area", text, parts[0].handle, place, 0.0))
        return []
    return [Chain(tuple(parts))]


def _moved(curve: Curve, start: FloatArray, end: FloatArray) -> list[Curve]:
    """Return the curve between two new ends, or with short lines to them where it cannot yield.

    The curve keeps its shape (the bulge of an arc, the inner control points of a spline), so a
    gap of some 1e-6 mm turns its tangents by no more than that over its chord.
    """
    shift = max(float(np.hypot(*(curve.start - start))), float(np.hypot(*(curve.end - end))))
    if shift == 0.0:
        return [curve]
    if isinstance(curve, Line):
        return [Line(start, end)] if np.hypot(*(end - start)) >= SHORTEST else []
    if np.array_equal(start, end) and isinstance(curve, Arc | EllipticalArc):
        # An arc that comes back to within a gap of its start leaves out a stretch of itself.
        return [_full_turn(curve)]
    try:
        moved = curve.with_ends(start, end)
    except GeometryError:
        return _bridged(curve, start, end)
    t = np.linspace(0.0, 1.0, 9)
    # The chord of an almost full turn is too short to hold its shape by.
    if float(np.hypot(*(moved.point(t) - curve.point(t)).T).max()) > 4.0 * shift + 1e-12:
        return _bridged(curve, start, end)
    return [moved]


def _full_turn(curve: Arc | EllipticalArc) -> Curve:
    sweep = math.copysign(2.0 * math.pi, curve.sweep)
    if isinstance(curve, Arc):
        return Arc(curve.centre, curve.radius, curve.start_angle, sweep)
    return EllipticalArc(curve.centre, curve.major, curve.minor, curve.start_angle, sweep)


def _bridged(curve: Curve, start: FloatArray, end: FloatArray) -> list[Curve]:
    """Return the curve as drawn, with lines from the new start and to the new end."""
    parts: list[Curve] = [curve]
    if np.hypot(*(curve.start - start)) > 0.0:
        parts.insert(0, Line(start, curve.start))
    if np.hypot(*(end - curve.end)) > 0.0:
        parts.append(Line(curve.end, end))
    return parts


def _rejoined(parts: list[Piece]) -> list[Piece]:
    """Undo the cuts by which overlapping curves were taken apart, where nothing branches."""
    result: list[Piece] = []
    for part in parts:
        before = result[-1] if result else None
        if before is None or part.part_of is None or before.part_of != part.part_of:
            result.append(part)
            continue
        one, two = before.curve, part.curve
        if isinstance(one, Line) and isinstance(two, Line):
            result[-1] = replace(before, curve=Line(one.start, two.end))
        elif isinstance(one, Arc) and isinstance(two, Arc):
            joined = Arc(one.centre, one.radius, one.start_angle, one.sweep + two.sweep)
            result[-1] = replace(before, curve=joined)
        else:
            result.append(part)
    return [replace(part, part_of=None) for part in result]


def _open_chains(
    open_edges: list[int],
    edges: list[Edge],
    pieces: tuple[Piece, ...],
    places: FloatArray,
    findings: list[Finding],
) -> list[Gap]:
    """Report what stayed open: one finding per connected set of curves, with its loose ends."""
    if not open_edges:
        return []
    at: dict[int, list[int]] = defaultdict(list)
    for index in open_edges:
        at[edges[index].start].append(index)
        at[edges[index].end].append(index)
    used = np.zeros(len(places), dtype=np.int64)
    for edge in edges:
        used[edge.start] += 1
        used[edge.end] += 1
    loose_places = places[used == 1]
    others = Neighbours(loose_places)
    gaps = []
    for component in _components(edges, at, set(open_edges)):
        touched = {edges[index].start for index in component}
        touched |= {edges[index].end for index in component}
        loose = sorted(node for node in touched if used[node] == 1)
        if not loose:
            continue
        first, last = places[loose[0]], places[loose[-1]]
        size = float(np.hypot(*(last - first)))
        near = math.inf
        if len(loose_places) > 1:
            near = float(others.nearest(places[loose], 2)[0][:, 1].min())
        text = (
            f"open chain of {len(component)} curves ignored: loose ends at "
            f"({first[0]:.6g}, {first[1]:.6g}) and ({last[0]:.6g}, {last[1]:.6g})"
        )
        if math.isfinite(near):
            text += f", nearest loose end {near:.3g} mm away"
        handle = pieces[component[0]].handle
        measure = min(size, near) if len(loose) > 1 else near
        findings.append(_finding(Severity.WARNING, "open-chain", text, handle, first, measure))
        outline = _outline(component, edges, at, loose[0]) if len(loose) == 2 else None
        ends = (float(first[0]), float(first[1])), (float(last[0]), float(last[1]))
        gaps.append(Gap(*ends, size, outline))
    return gaps


def _outline(
    component: list[int], edges: list[Edge], at: dict[int, list[int]], loose: int
) -> FloatArray | None:
    """Places along an open chain from a loose end to the other.

    None where it has branches, and for a single line, which goes round nothing.
    """
    if len(component) == 1 and isinstance(edges[component[0]].curve, Line):
        return None
    ends = [node for index in component for node in (edges[index].start, edges[index].end)]
    if any(len(at[node]) > 2 for node in ends):
        return None
    (first,) = at[loose]
    walk = _walk((first, edges[first].start != loose), edges, at, set(component))
    share = np.linspace(0.0, 1.0, OUTLINED)
    parts = [edges[index].curve.point(share[::-1] if back else share) for index, back in walk]
    return np.concatenate(parts)
