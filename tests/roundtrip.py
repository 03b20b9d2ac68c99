"""Planned moves against the moves that were read back from text: the law, and random paths."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from grassfire.toolpath import MoveKind, Program, Section, Toolpath, ToolpathBuilder

CLEARANCE = 15.0
TOLERANCE = 0.002

FloatArray = NDArray[np.float64]


@dataclass
class Deviation:
    """The largest differences between planned and read moves so far, mm and mm/min."""

    end: float = 0.0
    path: float = 0.0
    feed: float = 0.0
    moves: int = 0
    blocks: int = 0


def _points(path: Toolpath, row: int, count: int = 9) -> FloatArray:
    """(count, 3) points along a move, its end last, its start left out."""
    fraction = np.arange(1, count + 1)[:, None] / count
    begin, end = path.begin[row], path.end[row]
    points = begin + (end - begin) * fraction
    if path.kind[row] >= MoveKind.ARC_CW:
        spoke = begin[:2] - path.centre[row]
        angle = math.atan2(spoke[1], spoke[0]) + float(path.sweep[row]) * fraction[:, 0]
        radius = math.hypot(*spoke)
        points[:, 0] = path.centre[row, 0] + radius * np.cos(angle)
        points[:, 1] = path.centre[row, 1] + radius * np.sin(angle)
    points[-1] = end
    return points


def _check_arc(planned: Toolpath, row: int, read: Toolpath, rows: list[int], unit: float) -> float:
    """Largest distance of the read rows from one planned arc, after checks of turn and height."""
    begin, centre = planned.begin[row], planned.centre[row]
    sweep, rise = float(planned.sweep[row]), planned.end[row, 2] - begin[2]
    radius = math.hypot(*(begin[:2] - centre))
    points = np.concatenate([read.begin[rows[:1]], *[_points(read, index) for index in rows]])
    spokes = points[:, :2] - centre
    off = np.abs(np.hypot(*spokes.T) - radius)
    # Steps of at most a ninth of a turn each. Circles within the tolerance may be chords.
    angle = np.concatenate([[0.0], np.cumsum(_turns(spokes))])
    coarse = 2 * unit / radius
    if coarse < 0.5 and radius > 2 * TOLERANCE:
        assert abs(angle[-1] - sweep) < 2 * coarse + 1e-6, (row, angle[-1], sweep)
        along = np.clip(angle / sweep, 0, 1)
        slack = 2 * unit + abs(rise) * 2 * coarse / abs(sweep)
        assert np.abs(points[:, 2] - begin[2] - rise * along).max() <= slack
    return float(off.max())


def _turns(spokes: FloatArray) -> FloatArray:
    first, last = spokes[:-1], spokes[1:]
    cross = first[:, 0] * last[:, 1] - first[:, 1] * last[:, 0]
    return np.asarray(np.arctan2(cross, np.sum(first * last, axis=1)))


def _rows_of(
    planned: Toolpath,
    row: int,
    small: list[int],
    read: Toolpath,
    place: int,
    reach: tuple[float, float],
    feed_unit: float,
) -> list[int]:
    """Rows from `place` on that make one planned move.

    They begin and end within `reach` of its ends, have its feed, and about its length. Rows before
    them make the small moves that came before it, which rounding may have dropped. None if there
    are none.
    """
    ends = (
        np.flatnonzero((np.abs(read.end[place:] - planned.end[row]) <= reach[1]).all(axis=1))
        + place
    )
    own, feeds = planned.feed[row], planned.feed[small]
    length = read.length
    for last in ends.tolist():
        for first in range(last, place - 1, -1):
            before, rows = read.feed[place:first], list(range(first, last + 1))
            made = float(length[rows].sum())
            if first > place and not small:
                continue
            if small and (np.abs(read.begin[first] - planned.end[small[-1]]) > reach[0]).any():
                continue
            if small and (np.abs(before[:, None] - feeds).min(axis=1) > feed_unit).any():
                continue
            if np.isfinite(own) and not (np.abs(read.feed[rows] - own) <= feed_unit).all():
                continue
            if np.isnan(own) and (read.kind[rows] != MoveKind.RAPID).any():
                continue
            off = abs(made - float(planned.length[row]))
            if np.isfinite(own) and off > 0.2 * planned.length[row] + 4 * TOLERANCE:
                continue
            return rows
    return []


def check(
    planned: Toolpath,
    read: Toolpath,
    unit: float,
    feed_unit: float,
    found: Deviation,
    slack: float = 0.0,
) -> None:
    """Assert that `read` makes the planned moves, each end within half a unit, in order.

    Moves that vanish in rounding may be missing, arcs may be parts or chords, rapids may be one
    axis after another; before the first and after the last planned move there may be rapids. Ends
    of helices may be off by `slack` mm more, and so may the tool be until X and Y are told again.
    """
    exact = 0.5 * unit * (1 + 1e-6) + 1e-9
    diameter = 2 * np.hypot(*(planned.begin[:, :2] - planned.centre).T)
    size = np.fmin(planned.length, diameter)  # a circle is nowhere farther than its diameter
    place, off_helix = 0, False
    small: list[int] = []
    for row in range(len(planned)):
        end = planned.end[row]
        helix = planned.is_arc[row] and planned.begin[row, 2] != end[2]
        upright = bool((planned.begin[row, :2] == end[:2]).all())
        reach = (exact + slack * off_helix, exact + slack * (helix or (off_helix and upright)))
        if row == 0 and (np.abs(read.start - end) <= exact).all():
            continue  # the operation before ended there
        if size[row] <= 3 * unit + TOLERANCE + slack:
            small.append(row)  # perhaps dropped in rounding
            off_helix = off_helix or helix
            continue
        rows = _rows_of(planned, row, small, read, place, reach, feed_unit)
        assert rows, (row, end, read.line[place : place + 1], small)
        small = []
        off_helix = helix or (off_helix and upright)
        found.end = max(found.end, float(np.abs(read.end[rows[-1]] - end).max()))
        found.moves += 1
        found.blocks += len(rows)
        place = rows[-1] + 1
        kinds = read.kind[rows]
        if planned.kind[row] == MoveKind.RAPID:
            assert (kinds == MoveKind.RAPID).all()
            continue
        assert (np.abs(read.feed[rows] - planned.feed[row]) <= feed_unit).all(), row
        found.feed = max(found.feed, float(np.abs(read.feed[rows] - planned.feed[row]).max()))
        if planned.kind[row] == MoveKind.LINE:
            assert kinds.tolist() == [MoveKind.LINE]
            continue
        assert np.isin(kinds, [MoveKind.LINE, planned.kind[row]]).all()
        aside = _check_arc(planned, row, read, rows, unit)
        assert aside <= TOLERANCE + unit, (row, aside)
        found.path = max(found.path, aside)
    assert (read.kind[place:] == MoveKind.RAPID).all()


def joined(program: Program, operation: int) -> Toolpath:
    """All moves of one operation, its sections one after another."""
    paths = [part.toolpath for part in program.sections if part.operation == operation]
    columns = ("kind", "end", "centre", "feed", "role", "line")
    return Toolpath(
        start=paths[0].start,
        **{name: np.concatenate([getattr(path, name) for path in paths]) for name in columns},
    )


# Random paths

SWEEPS = (
    st.floats(1e-5, 2 * math.pi),
    st.floats(2 * math.pi - 0.01, 2 * math.pi),
    st.floats(1e-5, 0.01),
    st.sampled_from((math.pi / 2, math.pi, 2 * math.pi)),
)
MOVES = st.one_of(
    st.tuples(
        st.just("line"), st.floats(-60, 60), st.floats(-60, 60), st.floats(-3, 0), st.booleans()
    ),
    st.tuples(
        st.just("step"),
        st.floats(-0.01, 0.01),
        st.floats(-0.01, 0.01),
        st.floats(-0.001, 0.001),
        st.booleans(),
    ),
    *(
        st.tuples(
            st.just("arc"), st.floats(-3.5, 2.3), st.floats(-math.pi, math.pi), sweep, st.booleans()
        )
        for sweep in SWEEPS
    ),
    *(
        st.tuples(
            st.just("helix"), st.floats(-2, 2), st.floats(-math.pi, math.pi), sweep, st.booleans()
        )
        for sweep in SWEEPS
    ),
    st.tuples(
        st.just("hop"), st.floats(-60, 60), st.floats(-60, 60), st.floats(-3, 0), st.booleans()
    ),
)
FEEDS = st.sampled_from((120.0, 333.3333, 600.0, 812.5, 1200.0))


def _grow(
    builder: ToolpathBuilder, move: tuple[str, float, float, float, bool], feed: float
) -> None:
    """One random move, or a retract, a way across and a descent."""
    kind, first, second, third, flag = move
    x, y, z = builder.position
    if kind == "line":
        builder.line(first, second, third if flag else z, feed)
    elif kind == "step":
        builder.line(x + first, y + second, z + third if flag else z, feed)
    elif kind == "hop":
        builder.rapid(x, y, CLEARANCE)
        builder.rapid(first, second, CLEARANCE)
        builder.rapid(first, second, 0.5)
        builder.line(first, second, third, feed)
    else:
        radius, sign = 10.0**first, 1 if flag else -1
        centre = (x - radius * math.cos(second), y - radius * math.sin(second))
        end = (x, y)
        if third < 2 * math.pi:
            angle = second + sign * third
            end = (centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle))
        fall = 0.2 * radius * third if kind == "helix" else 0.0
        builder.arc(*end, z - min(fall, 2.0), centre, flag, feed)


@st.composite
def toolpaths(draw: st.DrawFn) -> Toolpath:
    """Paths that begin at the clearance height: lines, steps, arcs and helices of all sizes."""
    builder = ToolpathBuilder()
    builder.rapid(draw(st.floats(-50, 50)), draw(st.floats(-50, 50)), CLEARANCE)
    builder.rapid(*builder.position[:2], 0.5)
    builder.line(*builder.position[:2], -1.0, 300.0)
    for move in draw(st.lists(MOVES, min_size=1, max_size=14)):
        _grow(builder, move, draw(FEEDS))
    builder.rapid(*builder.position[:2], CLEARANCE)
    return builder.build()


@st.composite
def programs(draw: st.DrawFn) -> Program:
    """One or two tools."""
    count = draw(st.sampled_from((1, 1, 2)))
    sections = tuple(
        Section(
            toolpath=draw(toolpaths()),
            tool_number=index + 1,
            tool_diameter=(6.0, 3.175)[index],
            spindle_speed=(18000.0, 12000.0)[index],
            operation=index,
            name=("pocket", "rest, fine")[index],
            coolant=("off", "flood")[index],
        )
        for index in range(count)
    )
    return Program("random", sections)
