"""What a polyline stands for: its noise, its corners, and its runs along lines and circles.

A vertex is judged by the turn between its two arms, each long against the noise. Runs are the
longest stretches that one line or one circle explains to well below the tolerance; they count when
a curve that bends like what lies beside them would have been told apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry.curve import FloatArray, cross, dot
from grassfire.geometry.tangency import fit_circle, fit_line, off_circle, off_line

ARM = 12.0
"""Least length of the arms that measure a turn, in standard deviations of the noise."""
SPACING = 8.0
"""Least distance of the vertices that are looked at, in standard deviations of the noise."""
FEWEST_SPACED = 200
"""Vertices of which none are left out."""
WINDOWS = 5000
"""Groups of neighbours that the noise is measured at."""
WEAK_CORNER = 0.1
"""Least turn, in radians, that can be a corner because nothing beside it turns as much."""
ROUNDING = 12.0
"""An arm times the turn, in tolerances, above which rounding the corner would be too far off (by
an eighth of the product)."""
WIDER = (3.0, 10.0, 40.0)
"""Longer arms that are tried, in shortest arms."""
STANDS_OUT = 2.5
"""How many times the turn that its neighbours foretell a corner turns."""
SAMPLES = 100
"""Vertices that determine whether a run lies on one circle."""
DISTINCT_ARC = 1000.0
"""The same for an arc that ends in a free curve, which might be that curve's vertex."""
CLEAN = 0.03
"""Share of the tolerance up to which a threshold is that of exact data."""
TIGHT = 0.02
"""Share of the tolerance within which exact data lie on their line or circle."""
DISTINCT = 80.0
"""How many times the threshold a run would be off if it bent like its neighbour."""
RAGGED = 3
"""Chords beside a corner that may belong to neither of its sides."""
FEWEST_OF_ARC = 5
"""Vertices on one circle that are no coincidence."""

FREE, LINE, ARC, PLAIN = range(4)
"""Kinds of runs: to be splines, lines, arcs, and single chords that stay."""


@dataclass(frozen=True)
class Run:
    """Vertices first..last (inclusive) of a stretch, and what they lie on."""

    kind: int
    first: int
    last: int

    def shifted(self, by: int) -> Run:
        """Return the run with other numbers for its vertices."""
        return Run(self.kind, self.first + by, self.last + by)


def noise_level(points: FloatArray, closed: bool) -> float:
    """Return the standard deviation across the polyline of its vertices (n, 2), in mm.

    From divided differences of five, seven and nine neighbours, which vanish for polynomials in
    the chord length; the least of their medians, so that neither corners nor wide steps along a
    curve count. Neighbours with a chord much longer than the others are left out.
    """
    return min(_differences(points, closed, width) for width in (5, 7, 9))


def stride_over_noise(points: FloatArray, closed: bool, most: float) -> tuple[int, float]:
    """Return every how manieth vertex to take so that noise does not hide the direction, and the
    standard deviation of the noise.

    Vertices closer together than their noise go to and fro: neither their turns nor lengths
    along them mean anything. Noise above `most` counts as that much.
    """
    stride = 1
    while True:
        some = points[::stride]
        noise = noise_level(some, closed)
        step = float(np.median(np.hypot(*np.diff(some, axis=0).T)))
        if step >= SPACING * min(noise, most) or len(some) < FEWEST_SPACED:
            return stride, noise
        stride *= 2


def _differences(points: FloatArray, closed: bool, width: int) -> float:
    """Return the noise by divided differences of `width` neighbours, zero if there are none."""
    chain = np.concatenate([points, points[: width - 1]]) if closed else points
    if len(points) < width:
        return 0.0
    step = np.hypot(*np.diff(chain, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(step)])
    window = np.lib.stride_tricks.sliding_window_view(length, width)
    steps = np.diff(window, axis=1)
    # Windows spread evenly will do for a median.
    some = slice(None, None, max(1, len(window) // WINDOWS))
    window, steps = window[some], steps[some]
    alike = steps.max(axis=1) <= 8.0 * np.median(steps, axis=1)
    if not np.any(alike):
        return 0.0
    window = (window / (window[:, -1:] - window[:, :1]))[alike]
    weight = np.ones_like(window)
    for column in range(width):
        for other in range(width):
            if other != column:
                weight[:, column] /= width * (window[:, column] - window[:, other])
    weight /= np.sqrt((weight**2).sum(axis=1))[:, None]
    rows = np.lib.stride_tricks.sliding_window_view(chain, width, axis=0)[some][alike]
    off = np.einsum("nki,ni->nk", rows - rows[:, :, :1], weight)
    along = rows[:, :, -1] - rows[:, :, 0]
    across = cross(along, off) / np.maximum(np.hypot(*along.T), 1e-300)
    return float(np.median(np.abs(across)) / 0.6745)


def turns(points: FloatArray, reach: float, closed: bool) -> tuple[FloatArray, FloatArray]:
    """Return the turns (n,) in radians between arms of at least `reach` mm, and the arms (n, 2).

    An arm is the principal direction of the vertices from the one in question to the first at
    least `reach` away along the polyline. Ends of an open polyline turn by nothing.
    """
    count = len(points)
    pad = 0
    chain = points - points.mean(axis=0)
    if closed:
        steps = np.hypot(*(np.roll(chain, -1, axis=0) - chain).T)
        # Enough of the loop on each side for the longest arm, at most all of it.
        pad = count
        if reach < 0.5 * steps.min() * count:
            pad = min(count, int(np.ceil(reach / steps.min())) + 2)
        chain = np.concatenate([chain[count - pad :], chain, chain[:pad]])
    step = np.hypot(*np.diff(chain, axis=0).T)
    length = np.concatenate([[0.0], np.cumsum(step)])
    index = np.arange(pad, pad + count)
    slack = 1e-9 * reach
    low = np.searchsorted(length, length[index] - reach + slack, side="right") - 1
    high = np.searchsorted(length, length[index] + reach - slack, side="left")
    low = np.clip(np.minimum(low, index - 1), 0, None)
    high = np.clip(np.maximum(high, index + 1), None, len(chain) - 1)
    x, y = chain.T
    sums = np.zeros((len(chain) + 1, 5))
    np.cumsum(np.stack([x, y, x * x, x * y, y * y], axis=1), axis=0, out=sums[1:])
    before = _direction(chain, sums, low, index)
    after = _direction(chain, sums, index, high)
    arms = np.stack([length[index] - length[low], length[high] - length[index]], axis=1)
    turn = np.arctan2(cross(before, after), dot(before, after))
    if not closed:
        turn[[0, -1]] = 0.0
    return np.asarray(turn), arms


def _direction(
    chain: FloatArray, sums: FloatArray, low: NDArray[np.int64], high: NDArray[np.int64]
) -> FloatArray:
    """Return principal directions (m, 2), from low to high, of the vertices low..high.

    `sums` has the sums of x, y, xx, xy, yy of the vertices before each.
    """
    chord = chain[high] - chain[low]
    many = high - low > 1
    if np.any(many):
        size = np.maximum(high - low + 1, 1)
        x, y, xx, xy, yy = (sums[high + 1] - sums[low]).T / size
        angle = 0.5 * np.arctan2(2.0 * (xy - x * y), (xx - x * x) - (yy - y * y))
        axis = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        axis *= np.where(dot(axis, chord) < 0.0, -1.0, 1.0)[:, None]
        chord = np.where(many[:, None], axis, chord)
    return np.asarray(chord)


def corners(
    points: FloatArray, closed: bool, tolerance: float, corner_angle: float, noise: float
) -> NDArray[np.bool_]:
    """Return which vertices (n,) are corners; the ends of an open polyline are.

    With longer arms the turn at a corner stays what it is, along an arc it grows with the arms.
    """
    reach = max(ARM * noise, tolerance)
    turn, arms = turns(points, reach, closed)
    size, short = np.abs(turn), arms.min(axis=1)
    strong = (size >= corner_angle) & (short * size > ROUNDING * tolerance)
    # What the vertices beside one foretell: half of each arm bends as its far side does.
    rate = np.where(strong, 0.0, size / (0.5 * arms.sum(axis=1)))
    unsure = 4.0 * noise * (1.0 / np.maximum(arms, 1e-300)).sum(axis=1)
    foretold = 0.5 * arms[:, 0] * np.maximum(np.roll(rate, 1), np.roll(rate, 2))
    foretold += 0.5 * arms[:, 1] * np.maximum(np.roll(rate, -1), np.roll(rate, -2))
    weak = (size > WEAK_CORNER) & (size > STANDS_OUT * foretold + unsure)
    weak &= short * size > 2.0 * tolerance
    found = _largest_nearby(points, strong | weak, size, reach, closed)
    step = np.hypot(*np.diff(points, axis=0).T)
    before = size
    for factor in WIDER:
        if factor * reach <= step.min():
            continue
        wide_turn, wide_arms = turns(points, factor * reach, closed)
        wide = np.abs(wide_turn)
        sharp = (wide >= corner_angle) & (before >= 0.6 * wide)
        sharp &= wide_arms.min(axis=1) * wide > ROUNDING * tolerance
        sharp = _largest_nearby(points, sharp, before + wide, factor * reach, closed)
        found |= _apart(points, sharp, found, factor * reach, closed)
        before = wide
    if not closed:
        found[[0, -1]] = True
    return found


def _apart(
    points: FloatArray,
    candidate: NDArray[np.bool_],
    found: NDArray[np.bool_],
    reach: float,
    closed: bool,
) -> NDArray[np.bool_]:
    """Return the candidates (n,) that are farther than `reach` along the line from those found."""
    known = np.flatnonzero(found)
    if not len(known) or not np.any(candidate):
        return candidate
    step = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    length = np.concatenate([[0.0], np.cumsum(step)])
    places = length[known]
    if closed:
        places = np.concatenate([places - length[-1], places, places + length[-1]])
    at = np.searchsorted(places, length[:-1])
    below = np.abs(length[:-1] - places[np.clip(at - 1, 0, len(places) - 1)])
    above = np.abs(length[:-1] - places[np.clip(at, 0, len(places) - 1)])
    return np.asarray(candidate & (np.minimum(below, above) > reach))


def _largest_nearby(
    points: FloatArray, candidate: NDArray[np.bool_], size: FloatArray, reach: float, closed: bool
) -> NDArray[np.bool_]:
    """Return the candidates (n,) that turn most among those nearer than `reach` along the line."""
    found, index = candidate.copy(), np.flatnonzero(candidate)
    if len(index) < 2:
        return found
    step = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    length = np.concatenate([[0.0], np.cumsum(step)])
    gap = np.diff(np.append(length[index], length[index[0]] + length[-1]))
    if not closed:
        gap[-1] = np.inf
    near = gap < reach
    if not np.any(near):
        return found
    start = int(np.argmax(~near)) + 1 if not np.all(near) else 0
    order = np.roll(np.arange(len(index)), -start)
    group: list[int] = []
    for place in order:
        group.append(int(index[place]))
        if not near[place]:
            _keep_largest(found, group, size)
            group = []
    if group:
        _keep_largest(found, group, size)
    return found


def _keep_largest(found: NDArray[np.bool_], group: list[int], size: FloatArray) -> None:
    if len(group) > 1:
        found[group] = False
        found[group[int(np.argmax(np.round(size[group], 9)))]] = True


def _on_line(points: FloatArray, threshold: float) -> bool:
    if len(points) == 2:
        return True
    line = fit_line(points)
    along = points @ np.array([np.cos(line[0]), np.sin(line[0])])
    ordered = bool(np.all(np.diff(along) > -2.0 * threshold))
    return ordered and float(np.abs(off_line(line, points)).max()) <= threshold


def _on_circle(points: FloatArray, threshold: float) -> bool:
    # Samples will do to find the circle; all are measured.
    stride = max(1, len(points) // SAMPLES)
    circle = fit_circle(np.concatenate([points[:-1:stride], points[-1:]]), steps=1)
    if circle is None or np.abs(off_circle(circle, points)).max() > threshold:
        return False
    spoke = points - circle[:2]
    step = np.arctan2(cross(spoke[:-1], spoke[1:]), dot(spoke[:-1], spoke[1:]))
    step = step * np.sign(circle[2])
    forward = bool(np.all(step > -2.0 * threshold / abs(circle[2])))
    # Round once at most; one step beyond where the loop closes is its first vertex again.
    return forward and float(step.max()) < 0.5 * np.pi and float(step.sum()) < 2.0 * np.pi + 1e-6


def _on_flat_circle(points: FloatArray, threshold: float) -> bool:
    """Return whether points lie on a circle, be it one too flat to be fitted."""
    return _on_circle(points, threshold) or _on_line(points, threshold)


def longest_run(
    points: FloatArray,
    first: int,
    smallest: int,
    fits: Callable[[FloatArray, float], bool],
    threshold: float,
    guess: int = 0,
) -> int:
    """Return the last vertex of a long run from `first`, or `first` if `smallest` do not fit.

    By steps that double, from `guess` chords on, and bisection: as if longer runs never fit where
    a shorter one does not.
    """
    last = len(points) - 1
    good = first + smallest - 1
    if good > last or not fits(points[first : good + 1], threshold):
        return first
    bad, trial = last + 1, min(max(first + guess, good + 1), last)
    step = max(1, (trial - first) // 16)
    while bad - good > 1:
        if fits(points[first : trial + 1], threshold):
            good, trial = trial, trial + step
        else:
            bad, trial = trial, trial - step
        step *= 2
        if not good < trial < bad:
            # Between the two, unless nothing is known yet of what lies beyond.
            trial = (good + bad) // 2 if bad <= last else last
    return good


def next_run(points: FloatArray, first: int, threshold: float, guess: int = 0) -> Run:
    """Return the line or arc that starts at vertex `first` and runs furthest.

    The search for an arc starts at `guess` chords.
    """
    last_on_arc = longest_run(points, first, FEWEST_OF_ARC, _on_flat_circle, threshold, guess)
    # Lines are flat arcs too: an arc has to reach further than chance would let it.
    chords = last_on_arc - first
    enough = max(chords - max(1, chords // 9) - 1, 1)
    while enough + max(1, enough // 8) < chords:
        enough += 1
    if chords > 0 and not _on_line(points[first : first + enough + 1], threshold):
        return Run(ARC, first, last_on_arc)
    return Run(LINE, first, longest_run(points, first, 2, _on_line, threshold, enough))


def recognise(
    points: FloatArray, threshold: float, tolerance: float, closed: bool = False
) -> list[Run]:
    """Return the runs of a stretch (m, 2) in order: lines, arcs, and what is between.

    Parameters
    ----------
    threshold : float
        How far vertices may lie from their line or circle, in mm.
    tolerance : float
        Shorter lines count for nothing, in mm.
    closed : bool
        The last point is the first again, and a run ends there.
    """
    last = len(points) - 1
    greedy: list[Run] = []
    first = guess = 0
    while first < last:
        greedy.append(next_run(points, first, threshold, guess))
        guess, first = greedy[-1].last - first, greedy[-1].last
    greedy = _merged(points, greedy, min(1.25 * threshold, 0.95 * tolerance))
    if not closed:
        greedy = _from_ragged_start(points, greedy, min(1.25 * threshold, 0.95 * tolerance))
    if not closed or len(greedy) < 3:
        data = _stretch(points, threshold, tolerance)
        kept = data.kept(greedy, range(len(greedy)))
    else:
        # Three times around, so that every run has neighbours.
        data = _stretch(np.concatenate([points[:-1]] * 3 + [points[:1]]), threshold, tolerance)
        around = [
            Run(run.kind, run.first + shift, run.last + shift)
            for shift in (0, last, 2 * last)
            for run in greedy
        ]
        count = len(greedy)
        kept = [run.shifted(-last) for run in data.kept(around, range(count, 2 * count))]
    return _with_fillets(points, _with_gaps(kept, last), threshold, closed)


def _merged(points: FloatArray, greedy: list[Run], limit: float) -> list[Run]:
    """Return the runs with neighbours joined that one line or circle explains as well."""
    result: list[Run] = []
    for run in greedy:
        before = result[-1] if result else None
        if before is not None and before.kind == run.kind:
            both = points[before.first : run.last + 1]
            fits = _on_line if run.kind == LINE else _on_circle
            if len(both) > 3 and fits(both, limit):
                result[-1] = Run(run.kind, before.first, run.last)
                continue
        result.append(run)
    return result


def _from_ragged_start(points: FloatArray, greedy: list[Run], limit: float) -> list[Run]:
    """Return the runs with the second begun next to the first vertex, if it fits but for a few.

    The vertex taken for a corner may lie on the far side of it.
    """
    if len(greedy) < 2:
        return greedy
    first, second = greedy[:2]
    fits = _on_line if second.kind == LINE else _on_circle
    for skipped in range(1, min(RAGGED + 1, first.last)):
        if fits(points[skipped : second.last + 1], limit):
            return [Run(LINE, 0, skipped), Run(second.kind, skipped, second.last), *greedy[2:]]
    return greedy


def _stretch(points: FloatArray, threshold: float, tolerance: float) -> _Stretch:
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return _Stretch(points, length, chord_turns(points), threshold, tolerance)


def chord_turns(points: FloatArray) -> FloatArray:
    """Return the turns (m,) from chord to chord of an open polyline, none at its ends."""
    turn = np.zeros(len(points))
    before, after = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    turn[1:-1] = np.arctan2(cross(before, after), dot(before, after))
    return turn


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A stretch with its length up to each vertex and the turn there."""

    points: FloatArray
    length: FloatArray
    turn: FloatArray
    threshold: float
    tolerance: float

    @property
    def noisy(self) -> bool:
        """Whether the threshold is that of noise."""
        return self.threshold > CLEAN * self.tolerance

    def kept(self, greedy: list[Run], places: range) -> list[Run]:
        """Return the runs that count, and arcs that do beside free curves, too."""
        count = len(places)
        good = [self.counts(greedy, place, DISTINCT) for place in places]
        closed = count < len(greedy)
        result = []
        for index, place in enumerate(places):
            if not good[index]:
                continue
            beside = [index - 1, index + 1]
            if closed:
                beside = [other % count for other in beside]
            least = 0.25 * (greedy[place].last - greedy[place].first)
            free = False
            for other in beside:
                # A few vertices of noise between two runs are nothing.
                if 0 <= other < count and not good[other]:
                    run = greedy[places[other]]
                    free |= not self.noisy or run.last - run.first > max(1.0, least)
            short = greedy[place].kind == ARC and free
            if short and not self.counts(greedy, place, DISTINCT_ARC):
                continue
            result.append(greedy[place])
        return result

    def counts(self, greedy: list[Run], place: int, distinct: float) -> bool:
        """Return whether a run would be told apart from a curve that bends like its neighbours."""
        run = greedy[place]
        size = float(self.length[run.last] - self.length[run.first])
        inner = self.turn[run.first + 1 : run.last].sum()
        if run.kind == ARC:
            chords = self.length[run.last - 1] - self.length[run.first]
            chords = 0.5 * (chords + self.length[run.last] - self.length[run.first + 1])
            bend = float(inner / chords)
        else:
            bend = 0.0
            if size < 4.0 * self.tolerance:
                return False
        sides = []
        if place > 0:
            sides.append(self._beside(run, greedy[place - 1], -1))
        if place + 1 < len(greedy):
            sides.append(self._beside(run, greedy[place + 1], 1))
        for rate, chord, turned in sides:
            if rate is None:
                if run.kind == LINE and run.last - run.first == 1:
                    return False
                continue
            least = distinct * self.threshold
            if run.kind == LINE and run.last - run.first == 1:
                # Of one chord only: twice as long as those beside it, and they do the turning.
                least = max(least, 0.5 * abs(rate) * chord**2)
                if abs(turned) > abs(rate) * (0.5 * chord + 0.2 * size) + 1e-9:
                    return False
            if abs(rate - bend) * size**2 / 8.0 < least:
                return False
        return True

    def _beside(self, run: Run, other: Run, side: int) -> tuple[float | None, float, float]:
        """Return the bend beside a run in 1/mm (None at an end of the stretch), the chord next to
        it in mm and the turn between."""
        last = len(self.points) - 1
        if side > 0:
            far = min(max(other.last, run.last + 2), last)
            inside = np.arange(run.last + 1, far + (far < last and other.last - run.last == 1))
            edge, chord = run.last, self.length[run.last + 1] - self.length[run.last]
        else:
            far = max(min(other.first, run.first - 2), 0)
            inside = np.arange(far + (far == 0 or run.first - other.first > 1), run.first)
            edge, chord = run.first, self.length[run.first] - self.length[run.first - 1]
        reach = 0.0
        if len(inside):
            reach = 0.5 * float(
                self.length[min(inside[-1] + 1, last)]
                + self.length[inside[-1]]
                - self.length[inside[0]]
                - self.length[max(inside[0] - 1, 0)]
            )
        bend = float(self.turn[inside].sum()) / reach if reach > 0.0 else None
        return bend, float(chord), float(self.turn[edge])


def _with_gaps(kept: list[Run], last: int) -> list[Run]:
    runs: list[Run] = []
    cursor = 0
    for run in kept:
        if run.first > cursor:
            runs.append(Run(FREE, cursor, run.first))
        runs.append(run)
        cursor = run.last
    if cursor < last:
        runs.append(Run(FREE, cursor, last))
    return runs


def _with_fillets(points: FloatArray, runs: list[Run], threshold: float, closed: bool) -> list[Run]:
    """Return the runs with few chords as arcs, where they turn evenly.

    Two chords between lines that the arc touches will do: their ends turn too. Three do elsewhere.
    """
    result = list(runs)
    turns_here = chord_turns(points)
    for place, run in enumerate(runs):
        chords = run.last - run.first
        if run.kind != FREE or not 2 <= chords <= 6:
            continue
        inner = closed or 0 < place < len(runs) - 1
        beside = (runs[place - 1].kind, runs[(place + 1) % len(runs)].kind)
        fillet = inner and len(runs) > 2 and beside == (LINE, LINE)
        ends = slice(run.first, run.last + 1) if fillet else slice(run.first + 1, run.last)
        step = np.hypot(*np.diff(points[run.first : run.last + 1], axis=0).T)
        half = np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])
        if not fillet:
            half = half[1:-1]
            alone = chords >= 3 and (not inner or ARC not in beside)
            if not alone or not _on_circle(points[run.first : run.last + 1], threshold):
                continue
        turn = turns_here[ends]
        if fillet and closed and run.last == len(points) - 1:
            turn = turn.copy()
            turn[-1] = chord_turns(np.stack([points[-2], points[0], points[1]]))[1]
        even = turn.sum() * half / half.sum()
        if np.all(np.abs(turn - even) <= 0.1 * np.abs(turn.sum()) / len(step) + 1e-6):
            result[place] = Run(ARC, run.first, run.last)
    return result
