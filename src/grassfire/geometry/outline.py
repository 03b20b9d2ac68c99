"""The vertices of a polyline in runs, and the joined curves that stand for them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry.arc import Arc
from grassfire.geometry.bspline import BSpline
from grassfire.geometry.curve import Curve, FloatArray, cross, dot
from grassfire.geometry.fairing import Spline, fit_spline
from grassfire.geometry.line import Line
from grassfire.geometry.runs import (
    ARC,
    CLEAN,
    FREE,
    LINE,
    PLAIN,
    RAGGED,
    Run,
    chord_turns,
)
from grassfire.geometry.tangency import (
    Shape,
    crossing_point,
    fit_circle,
    fit_line,
    fit_together,
    touching_point,
)

FEWEST_OF_SPLINE = 5
"""Vertices of a free run below which it stays a polyline."""
ROUNDS = 100
"""How often runs are freed or moved before the polyline stays as it is."""
REASSIGNMENTS = 6
"""How often the vertices beside a junction may change sides."""
CROSSING_TURN = 0.35
"""Turn, in radians, from which two fitted shapes meet where they cross."""
SPARE = 0.998
"""Share of the tolerance that is used: vertices that are as good as one have the rest."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A chain of vertices (closed: the first repeated at the end) and its runs.

    Runs follow each other; where a run's last vertex is not the next one's first, the curves meet
    between the two. A closed chain starts at a corner or where a run starts.

    Attributes
    ----------
    tolerance, threshold, target : float
        In mm: bound for all; expected of lines and arcs; wanted of splines.
    anchored : frozenset of int
        Corners that stay at their vertex.
    tangents : pair of (2,) array or None
        Given directions at the ends of an open chain.
    """

    chain: FloatArray
    corner: NDArray[np.bool_]
    runs: tuple[Run, ...]
    closed: bool
    tolerance: float
    threshold: float
    target: float
    anchored: frozenset[int] = frozenset()
    tangents: tuple[FloatArray | None, FloatArray | None] = (None, None)

    def after(self, place: int) -> int | None:
        """Return the run after `place`, None at the end of an open chain."""
        if place + 1 < len(self.runs):
            return place + 1
        return 0 if self.closed else None

    def solid(self, place: int | None) -> bool:
        """Return whether a run is to be one line or arc."""
        return place is not None and self.runs[place].kind in (LINE, ARC)

    def linked(self, place: int) -> bool:
        """Return whether a run touches the next one: no corner, and one of both is an arc."""
        other = self.after(place)
        if other is None or other == place or not (self.solid(place) and self.solid(other)):
            return False
        arcs = ARC in (self.runs[place].kind, self.runs[other].kind)
        return arcs and not bool(self.corner[self.runs[place].last])

    def vertices(self, place: int) -> FloatArray:
        """Return the vertices (m, 2) of a run."""
        run = self.runs[place]
        return self.chain[run.first : run.last + 1]

    def freed(self, places: set[int]) -> Outline:
        """Return the outline with some runs free."""
        runs = tuple(
            Run(FREE, run.first, run.last) if place in places else run
            for place, run in enumerate(self.runs)
        )
        return replace(self, runs=runs)


def curves_of(outline: Outline) -> list[Curve]:
    """Return the curves of an outline in order, each starting where the last ends.

    Runs that no line or arc explains within the tolerance, joined as they have to be, become free,
    and free runs that no spline explains stay polylines.
    """
    if all(run.kind == PLAIN for run in outline.runs):
        return [Line(first, last) for first, last in pairwise(outline.chain)]
    current = _tidy(outline, first=True)
    moves, known = REASSIGNMENTS, dict[bytes, list[Shape] | None]()
    for _ in range(ROUNDS):
        if len(current.runs) == 1 and current.closed and not current.corner[0]:
            return _whole(current)
        solved = _solved(current, known)
        if isinstance(solved, Outline):
            current = _tidy(solved)
            continue
        if moves and (moved := _reassigned(current, solved)) is not None:
            current, moves = moved, moves - 1
            continue
        curves = _assembled(current, solved)
        if isinstance(curves, Outline):
            current = _tidy(curves)
            continue
        return curves
    return [Line(first, last) for first, last in pairwise(outline.chain)]


def _whole(outline: Outline) -> list[Curve]:
    """Return the one curve of a closed chain without corners."""
    if outline.runs[0].kind == ARC:
        circle = fit_circle(outline.chain[:-1])
        if circle is not None and len(outline.chain) > 3:
            spoke = outline.chain[0] - circle[:2]
            sweep = float(np.copysign(2.0 * np.pi, circle[2]))
            arc = Arc(circle[:2], abs(circle[2]), float(np.arctan2(spoke[1], spoke[0])), sweep)
            parameter = np.linspace(0.0, 1.0, len(outline.chain))
            off = outline.chain - circle[:2]
            turned = np.arctan2(cross(off[:-1], off[1:]), dot(off[:-1], off[1:]))
            parameter[1:] = np.cumsum(turned) / sweep
            far = np.hypot(*(arc.point(parameter) - outline.chain).T).max()
            near = far <= SPARE * outline.tolerance
            if near and _near_chords(outline, 0, arc, parameter):
                return [arc]
    if len(outline.chain) > FEWEST_OF_SPLINE:
        limit = SPARE * outline.tolerance
        spline = fit_spline(outline.chain, outline.target, limit, closed=True)
        if spline is not None and _near_chords(outline, 0, spline.curve, spline.feet):
            return [spline.curve]
    return [Line(first, last) for first, last in pairwise(outline.chain)]


# -- runs ----------------------------------------------------------------------------------------


def _tidy(outline: Outline, first: bool = False) -> Outline:
    """Return the outline with free runs joined, and closed chains started anew if need be."""
    runs = list(outline.runs)
    if first:
        runs = [run for place, run in enumerate(runs) if not _negligible(outline, place)]
        outline, runs = _without_ragged(outline, runs)
    count = len(outline.chain) - 1
    if outline.closed and not outline.corner[0] and any(run.kind != FREE for run in runs):
        place = next(
            place
            for place in range(len(runs))
            if runs[place].kind != FREE or outline.corner[runs[place].first]
        )
        if place:
            start = runs[place].first
            chain = np.roll(outline.chain[:-1], -start, axis=0)
            corner = np.roll(outline.corner[:-1], -start)
            runs = [
                Run(
                    run.kind,
                    (run.first - start) % count,
                    (run.first - start) % count + run.last - run.first,
                )
                for run in runs[place:] + runs[:place]
            ]
            outline = replace(
                outline,
                chain=np.concatenate([chain, chain[:1]]),
                corner=np.append(corner, corner[0]),
                anchored=frozenset((vertex - start) % count for vertex in outline.anchored),
            )
    joined: list[Run] = []
    for run in runs:
        if joined:
            before = joined[-1]
            both = before.kind == FREE and run.kind == FREE
            if both and not outline.corner[run.first]:
                joined[-1] = Run(FREE, before.first, run.last)
                continue
            # A free run reaches to its neighbours.
            if run.kind == FREE:
                run = Run(FREE, before.last, run.last)
            elif before.kind == FREE:
                joined[-1] = Run(FREE, before.first, run.first)
        joined.append(run)
    if outline.closed and joined[-1].kind == FREE and joined[0].first == 0:
        joined[-1] = Run(FREE, joined[-1].first, count)
    if outline.closed and joined[0].kind == FREE:
        joined[0] = Run(FREE, 0, joined[0].last)
    if all(run.kind == FREE for run in joined) and not outline.corner.any():
        joined = [Run(FREE, 0, count)]
    return replace(outline, runs=tuple(joined))


def _negligible(outline: Outline, place: int) -> bool:
    """Return whether a free run is only where two shapes meet: a chord, or a little noise."""
    runs, run = outline.runs, outline.runs[place]
    other = outline.after(place)
    before = place - 1 if place else (len(runs) - 1 if outline.closed else None)
    if run.kind != FREE or len(runs) < 3 or before is None or other is None:
        return False
    beside = (runs[before], runs[other])
    if FREE in (beside[0].kind, beside[1].kind) or ARC not in (beside[0].kind, beside[1].kind):
        return False
    if outline.corner[[run.first, run.last]].any():
        return False
    most = 1.0
    if outline.threshold > CLEAN * outline.tolerance:
        most = 0.25 * min(one.last - one.first for one in beside)
    return run.last - run.first <= max(1.0, most)


def _without_ragged(outline: Outline, runs: list[Run]) -> tuple[Outline, list[Run]]:
    """Return the outline and its runs without the vertices that noise leaves beside corners.

    Both ends of what is left out are corners then: the shapes cross between them.
    """
    if outline.threshold <= CLEAN * outline.tolerance or len(runs) < 4:
        return outline, runs
    corner = outline.corner.copy()
    kept: list[Run] = []
    for place, run in enumerate(runs):
        after = (place + 1) % len(runs)
        inner = outline.closed or 0 < place < len(runs) - 1
        solid = all(runs[other].kind in (LINE, ARC) for other in (place - 1, after))
        ends = bool(corner[run.first]) != bool(corner[run.last])
        small = run.kind == FREE and run.last - run.first <= RAGGED
        if inner and solid and ends and small:
            corner[[run.first, run.last]] = True
            continue
        kept.append(run)
    if outline.closed:
        corner[[0, -1]] = corner[0] or corner[-1]
    return replace(outline, corner=corner), kept


# -- lines and arcs ------------------------------------------------------------------------------


def _solved(outline: Outline, known: dict[bytes, list[Shape] | None]) -> dict[int, Shape] | Outline:
    """Return the shape of each solid run, or the outline with runs freed that cannot be fitted.

    Groups fitted before are taken from `known`.
    """
    shapes: dict[int, Shape] = {}
    freed: set[int] = set()
    for group in _groups(outline):
        anchors = [
            (index, point)
            for index, place in enumerate(group)
            for point in _anchors(outline, place)
        ]
        linked = [outline.linked(place) for place in group]
        key = np.array([outline.runs[place].kind for place in group] + linked).tobytes()
        key += b"".join(outline.vertices(place)[[0, -1]].tobytes() for place in group)
        key += b"".join(np.append(point, index).tobytes() for index, point in anchors)
        if key not in known:
            known[key] = _fitted(outline, group, linked, anchors)
        found = known[key]
        if found is None:
            arcs = [place for place in group if outline.runs[place].kind == ARC]
            few = sorted(arcs, key=lambda place: len(outline.vertices(place)))
            freed |= {few[0]} if few else set(group)
            continue
        shapes |= dict(zip(group, found, strict=True))
    return outline.freed(freed) if freed else shapes


def _fitted(
    outline: Outline, group: list[int], linked: list[bool], anchors: list[tuple[int, FloatArray]]
) -> list[Shape] | None:
    """Return the shapes of runs that touch, None if there are none."""
    data = [outline.vertices(place) for place in group]
    start = []
    for place, points in zip(group, data, strict=True):
        found = (fit_line if outline.runs[place].kind == LINE else fit_circle)(points)
        if found is None:
            return None
        start.append(Shape(found))
    links = [(index, (index + 1) % len(group)) for index, touches in enumerate(linked) if touches]
    return fit_together(start, data, links, anchors) if links or anchors else start


def _reassigned(outline: Outline, shapes: dict[int, Shape]) -> Outline | None:
    """Return the outline with vertices given to the shape on their side of each junction.

    None if all are already.
    """
    runs, count = list(outline.runs), len(outline.chain) - 1
    ring = np.concatenate([outline.chain, outline.chain[1:]]) if outline.closed else outline.chain
    turned = 0
    for place in range(len(runs)):
        other = outline.after(place)
        if not outline.linked(place) or other is None:
            continue
        wrap = count if other == 0 else 0
        before, after = runs[place], runs[other].shifted(wrap)
        low = max((before.first + before.last) // 2, before.first + 2)
        high = min((after.first + after.last + 1) // 2, after.last - 2)
        if low > high:
            continue
        point = touching_point(shapes[place], shapes[other])
        ahead = (ring[low : high + 1] - point) @ shapes[place].tangent(point)
        split = low + int(np.count_nonzero(ahead < 0.0))
        if before.last <= split <= after.first + 1 or not low < split <= high:
            continue
        runs[place] = Run(before.kind, before.first, split - 1)
        runs[other] = Run(after.kind, split, after.last).shifted(-wrap)
        turned = split - wrap if wrap else turned
    if tuple(runs) == outline.runs:
        return None
    if not turned:
        return replace(outline, runs=tuple(runs))
    # The chain starts where its first run does.
    chain, corner = (
        np.roll(outline.chain[:-1], -turned, axis=0),
        np.roll(outline.corner[:-1], -turned),
    )
    return replace(
        outline,
        chain=np.concatenate([chain, chain[:1]]),
        corner=np.append(corner, corner[0]),
        runs=tuple(run.shifted(-turned) for run in runs),
        anchored=frozenset((vertex - turned) % count for vertex in outline.anchored),
    )


def _groups(outline: Outline) -> list[list[int]]:
    """Return the solid runs in groups that touch, each in order."""
    groups: list[list[int]] = []
    open_group = False
    for place in range(len(outline.runs)):
        if not outline.solid(place):
            open_group = False
            continue
        if open_group:
            groups[-1].append(place)
        else:
            groups.append([place])
        open_group = outline.linked(place)
    if open_group and outline.closed and len(groups) > 1 and groups[0][0] == 0:
        groups[0] = groups.pop() + groups[0]
    return groups


def _corner_kind(outline: Outline, place: int) -> str:
    """Return how a run meets the next one: "touch", "cross", "foot" or "vertex"."""
    other = outline.after(place)
    if outline.linked(place):
        return "touch"
    if other is None:
        return "vertex"
    vertex = outline.runs[place].last
    kinds = (outline.runs[place].kind, outline.runs[other].kind)
    if not outline.corner[vertex] and FREE in kinds and kinds != (FREE, FREE):
        return "foot"
    if outline.solid(place) and outline.solid(other) and vertex not in outline.anchored:
        before = outline.vertices(place)
        after = outline.vertices(other)
        first, second = before[-1] - before[-2], after[1] - after[0]
        if abs(np.arctan2(cross(first, second), dot(first, second))) >= CROSSING_TURN:
            return "cross"
    return "vertex"


def _anchors(outline: Outline, place: int) -> list[FloatArray]:
    """Return the vertices that a solid run has to pass through."""
    points = []
    before = place - 1 if place > 0 else (len(outline.runs) - 1 if outline.closed else None)
    if before is None or _corner_kind(outline, before) == "vertex":
        points.append(outline.chain[outline.runs[place].first])
    if _corner_kind(outline, place) == "vertex":
        points.append(outline.chain[outline.runs[place].last])
    return points


# -- curves --------------------------------------------------------------------------------------


def _assembled(outline: Outline, shapes: dict[int, Shape]) -> list[Curve] | Outline:
    """Return the curves, or the outline changed where they are not within the tolerance."""
    ends = _ends(outline, shapes)
    if isinstance(ends, Outline):
        return ends
    made: dict[int, Curve] = {}
    for place, run in enumerate(outline.runs):
        if run.kind == FREE:
            continue
        start, end = ends[place - 1 if place else len(ends) - 1], ends[place]
        if place == 0 and not outline.closed:
            start = outline.chain[0]
        curve = _solid_curve(outline, place, shapes.get(place), start, end)
        if curve is None:
            return outline.freed({place})
        made[place] = curve
    failed = {place for place in shapes if not _explains(outline, place, made)}
    if failed:
        return outline.freed(failed)
    curves: list[Curve] = []
    for place in range(len(outline.runs)):
        if place in made:
            curves.append(made[place])
        else:
            start = ends[place - 1 if place else len(ends) - 1]
            if place == 0 and not outline.closed:
                start = outline.chain[0]
            curves += _free_curves(outline, place, shapes, start, ends[place])
    return curves


def _ends(outline: Outline, shapes: dict[int, Shape]) -> list[FloatArray] | Outline:
    """Return where each run ends, or the outline with corners anchored that wander off."""
    ends: list[FloatArray] = []
    anchored: set[int] = set()
    for place, run in enumerate(outline.runs):
        vertex, other = outline.chain[run.last], outline.after(place)
        how = _corner_kind(outline, place)
        point: FloatArray | None = vertex
        if how == "touch":
            assert other is not None
            point = touching_point(shapes[place], shapes[other])
        elif how == "cross":
            assert other is not None
            point = crossing_point(shapes[place], shapes[other], vertex)
            room = _corner_room(outline, place, other)
            if point is None or np.hypot(*(point - vertex)) > room:
                if (outline.runs[other].first - run.last) % (len(outline.chain) - 1):
                    return outline.freed({place, other})
                anchored.add(run.last)
        elif how == "foot":
            assert other is not None
            solid = place if place in shapes else other
            point = shapes[solid].foot(vertex)
        ends.append(vertex if point is None else point)
    if anchored:
        count = len(outline.chain) - 1
        both = anchored | ({0, count} if outline.closed and anchored & {0, count} else set())
        return replace(outline, anchored=outline.anchored | both)
    return ends


def _corner_room(outline: Outline, place: int, other: int) -> float:
    """Return how far from its vertex a corner may be: the tolerance, and what a chord cuts off."""
    before, after = outline.vertices(place), outline.vertices(other)
    first, second = before[-1] - before[-2], after[1] - after[0]
    turn = abs(float(np.arctan2(cross(first, second), dot(first, second))))
    chord = min(float(np.hypot(*first)), float(np.hypot(*second)))
    gap = float(np.hypot(*(after[0] - before[-1])))
    return SPARE * outline.tolerance + 0.25 * chord * min(turn, 1.0) + gap


def _solid_curve(
    outline: Outline, place: int, shape: Shape | None, start: FloatArray, end: FloatArray
) -> Curve | None:
    """Return the line or arc between two points of its shape, None if it runs backwards."""
    if np.all(start == end):
        return None
    vertices = outline.vertices(place)
    if shape is None or not shape.circular:
        forward = float((end - start) @ (vertices[-1] - vertices[0])) > 0.0
        return Line(start, end) if forward else None
    centre, radius = shape.parameters[:2], float(shape.parameters[2])
    first, last = start - centre, end - centre
    spoke = vertices - centre
    swept = float(np.arctan2(cross(spoke[:-1], spoke[1:]), dot(spoke[:-1], spoke[1:])).sum())
    angle = float(np.arctan2(cross(first, last), dot(first, last)))
    sweep = angle + 2.0 * np.pi * round((swept - angle) / (2.0 * np.pi))
    if not 0.0 < sweep * np.sign(radius) <= 2.0 * np.pi:
        return None
    return Arc(centre, abs(radius), float(np.arctan2(first[1], first[0])), sweep)


def _explains(outline: Outline, place: int, made: dict[int, Curve]) -> bool:
    """Return whether a line or arc is within the tolerance of its vertices, and of their chords."""
    vertices, curve = outline.vertices(place), made[place]
    parameter = _distances(curve, vertices)[1]
    after = outline.after(place)
    if after is not None:
        # What lies between two runs has to lie on either.
        run, count = outline.runs[place], len(outline.chain) - 1
        gap = np.arange(run.last + 1, run.last + (outline.runs[after].first - run.last) % count)
        vertices = np.concatenate([vertices, outline.chain[gap % count]])
    off = _distances(curve, vertices)[0]
    for other in (place - 1 if place else len(outline.runs) - 1, after):
        if other in made and other != place:
            off = np.minimum(off, _distances(made[other], vertices)[0])
    if float(off.max()) > SPARE * outline.tolerance:
        return False
    return isinstance(curve, Line) or _near_chords(outline, place, curve, parameter)


def _distances(curve: Curve, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the distances (m,) of points from a line or an arc, and the parameters of the feet."""
    if isinstance(curve, Arc):
        spoke = points - curve.centre
        middle = curve.point(0.5) - curve.centre
        turned = np.arctan2(cross(middle[None], spoke), dot(middle[None], spoke))
        parameter = np.clip(0.5 + turned / curve.sweep, 0.0, 1.0)
    else:
        change = curve.end - curve.start
        parameter = np.clip((points - curve.start) @ change / (change @ change), 0.0, 1.0)
    return np.hypot(*(curve.point(parameter) - points).T), np.asarray(parameter)


def _near_chords(outline: Outline, place: int, curve: Curve, parameter: FloatArray) -> bool:
    """Return whether a curve stays near the chords of its run.

    Looked at are the quarters between the feet of consecutive vertices; allowed is the tolerance
    and a quarter of the chord times the larger turn at those of its ends that are no corners.
    """
    run = outline.runs[place]
    chain = outline.chain[run.first : run.last + 1]
    low = max(run.first - 1, 0)
    around = outline.chain[low : run.last + 2]
    turn = np.abs(chord_turns(around))[run.first - low :][: len(chain)]
    if outline.closed and run.last == len(outline.chain) - 1 and run.first == 0:
        seam = chord_turns(np.stack([outline.chain[-2], outline.chain[0], outline.chain[1]]))
        turn[[0, -1]] = abs(float(seam[1]))
    turn[outline.corner[run.first : run.last + 1]] = 0.0
    chord = np.diff(chain, axis=0)
    length = np.hypot(*chord.T)
    allowed = outline.tolerance + 0.25 * length * np.maximum(turn[:-1], turn[1:])
    share = np.array([0.0, 0.25, 0.5, 0.75])
    t = parameter[:-1, None] + np.diff(parameter)[:, None] * share
    off = curve.point(t) - chain[:-1, None]
    along = np.clip(dot(off, chord[:, None]) / dot(chord, chord)[:, None], 0.0, 1.0)
    gap = off - along[..., None] * chord[:, None]
    return bool(np.all(np.hypot(gap[..., 0], gap[..., 1]) <= allowed[:, None]))


def _free_curves(
    outline: Outline, place: int, shapes: dict[int, Shape], start: FloatArray, end: FloatArray
) -> list[Curve]:
    """Return a spline for a free run, or its chords."""
    points = outline.vertices(place).copy()
    points[0], points[-1] = start, end
    if len(points) >= FEWEST_OF_SPLINE:
        before = place - 1 if place else (len(outline.runs) - 1 if outline.closed else None)
        first, last = outline.tangents[0] if place == 0 else None, None
        if place == len(outline.runs) - 1:
            last = outline.tangents[1]
        if before in shapes and not outline.corner[outline.runs[place].first]:
            first = shapes[before].tangent(start)
        after = outline.after(place)
        if after in shapes and not outline.corner[outline.runs[place].last]:
            last = shapes[after].tangent(end)
        limit = SPARE * outline.tolerance
        spline: Spline | None = fit_spline(points, outline.target, limit, False, (first, last))
        if spline is not None and _near_chords(outline, place, spline.curve, spline.feet):
            curve: BSpline = spline.curve
            return [curve]
    return [Line(one, two) for one, two in pairwise(points) if np.any(one != two)]
