"""Orders that save travel: of pockets by short open tours, of operations by tool."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from grassfire.plan.places import IntArray
from grassfire.toolpath import FloatArray

LARGEST_SEARCH = 400
"""Up to so many points tours are improved; beyond, they are those of nearest neighbours."""

LONGEST_MOVED = 3
"""Points in a row that are moved to another place of a tour at once, at most."""

LEAST_GAIN = 1e-9
"""Part of the length of a tour that a change must save."""


def tour(points: FloatArray, start: FloatArray | None = None) -> IntArray:
    """An order of points whose straight ways are short together.

    Nearest neighbours first, improved by turning round stretches (2-opt) and by moving up to
    `LONGEST_MOVED` points in a row elsewhere (Or-opt), the best change first, until none
    saves length. Croes, "A method for solving traveling-salesman problems", Operations Research
    6 (1958); Or, thesis, Northwestern University (1976).

    Parameters
    ----------
    points : (n, 2) float array
        mm.
    start : (2,) float array, optional
        Where the way comes from; default: the first point, which stays first.

    Returns
    -------
    (n,) int array
        The same for the same input. The way ends at the last point.
    """
    count = len(points)
    places = np.asarray(points if start is None else np.concatenate([start[None], points]))
    gap = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    order = _nearest(gap)
    if 2 < len(order) <= LARGEST_SEARCH:
        order = _improved(order, gap)
    return order if start is None else order[1:] - 1 if count else order[:0]


def _nearest(gap: FloatArray) -> IntArray:
    """Always on to the nearest place that is left, from the first."""
    count = len(gap)
    order = np.zeros(count, dtype=np.int64)
    left = np.ones(count, dtype=bool)
    for step in range(1, count):
        left[order[step - 1]] = False
        order[step] = int(np.argmin(np.where(left, gap[order[step - 1]], np.inf)))
    return order


def _improved(order: IntArray, gap: FloatArray) -> IntArray:
    """Changes that save length, best first, until there is none; the first place stays."""
    least = LEAST_GAIN * max(float(np.sum(gap[order[:-1], order[1:]])), 1e-300)
    while True:
        turned = _best_turn(order, gap)
        moved = _best_move(order, gap)
        gain, change = min(turned, moved, key=lambda option: option[0])
        if gain > -least:
            return order
        order = change()


Change = tuple[float, Callable[[], IntArray]]


def _best_turn(order: IntArray, gap: FloatArray) -> Change:
    """Largest saving by turning round the places i + 1 .. j."""
    here = order[:-1]
    step = gap[here, order[1:]]
    # the way from the last place leads nowhere: turning round a tail only changes one step
    ends = np.concatenate([step, [0.0]])
    across = gap[here][:, order]
    beyond = np.zeros_like(across)
    beyond[:, :-1] = gap[order[1:]][:, order[1:]]
    change = across + beyond - step[:, None] - ends[None]
    row, column = np.indices(change.shape)
    change = np.where(column > row + 1, change, np.inf)
    best = int(np.argmin(change))
    first, last = divmod(best, change.shape[1])

    def apply() -> IntArray:
        return np.concatenate(
            [order[: first + 1], order[first + 1 : last + 1][::-1], order[last + 1 :]]
        )

    return float(change.flat[best]), apply


def _best_move(order: IntArray, gap: FloatArray) -> Change:
    """Largest saving by moving a few places in a row to between two others, either way round."""
    best: Change = (np.inf, order.copy)
    count = len(order)
    for size in range(1, min(LONGEST_MOVED, count - 2) + 1):
        head = np.arange(1, count - size + 1)
        before, first, last = order[head - 1], order[head], order[head + size - 1]
        inner = head + size < count
        after = order[np.minimum(head + size, count - 1)]
        saved = gap[before, first] + np.where(inner, gap[last, after] - gap[before, after], 0.0)
        tails, heads = order[:-1], order[1:]
        split = gap[tails, heads]
        for way, (one, two) in enumerate(((first, last), (last, first))):
            cost = gap[one][:, tails] + gap[two][:, heads] - split[None] - saved[:, None]
            place = np.arange(count - 1)[None]
            outside = (place < head[:, None] - 1) | (place >= head[:, None] + size)
            cost = np.where(outside, cost, np.inf)
            chosen = int(np.argmin(cost))
            if cost.flat[chosen] < best[0]:
                row, after_place = divmod(chosen, count - 1)
                begin = int(head[row])
                best = (
                    float(cost.flat[chosen]),
                    _mover(order, begin, begin + size, after_place, bool(way)),
                )
    return best


def _mover(
    order: IntArray, begin: int, end: int, place: int, reverse: bool
) -> Callable[[], IntArray]:
    """The order with places begin .. end - 1 put after the place numbered `place`."""

    def apply() -> IntArray:
        part = order[begin:end][::-1] if reverse else order[begin:end]
        rest = np.concatenate([order[:begin], order[end:]])
        at = place + 1 if place < begin else place + 1 - (end - begin)
        return np.concatenate([rest[:at], part, rest[at:]])

    return apply


def by_tool(tools: Sequence[int], earlier: Sequence[frozenset[int]]) -> list[int]:
    """Order of operations with few changes of tool.

    Parameters
    ----------
    tools : sequence of int
        Of each operation.
    earlier : sequence of frozenset of int
        Operations that must come before each one.

    Returns
    -------
    list of int
        Always the first operation with the tool that is in the spindle, else the first one, of
        those that may come next.
    """
    order: list[int] = []
    left = list(range(len(tools)))
    while left:
        ready = [index for index in left if earlier[index] <= set(order)]
        same = [index for index in ready if order and tools[index] == tools[order[-1]]]
        order.append((same or ready)[0])
        left.remove(order[-1])
    return order
