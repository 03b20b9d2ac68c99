"""Parts of the axis as graphs: wide parts and pruned axes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from grassfire.errors import GeometryError
from grassfire.geometry.neighbours import connected
from grassfire.medial.offset import settled
from grassfire.medial.queries import AxisTable, separation_angle
from grassfire.medial.sites import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from grassfire.medial.axis import Edge, MedialAxis

_SAMPLES = 33
"""Places on each edge where separation angles are looked at first."""


@dataclass(frozen=True)
class AxisGraph:
    """A part of a medial axis: stretches of its edges and the vertices between them.

    Attributes
    ----------
    axis : MedialAxis
        The whole; `edge` counts in `axis.edges`.
    edge : (k,) int array
    low, high : (k,) float arrays
        Stretch i is edge[i] from fraction low[i] to high[i].
    start, end : (k,) int arrays
        Vertices of this graph at low and high.
    vertex_point, vertex_radius : (v, 2) and (v,) float arrays
        mm.
    vertex_cut : (v,) bool array
        Vertices that are no vertices of the axis: an edge was cut there.
    component : (v,) int array
        Connected component of each vertex, numbered from 0.
    """

    axis: MedialAxis
    edge: IntArray
    low: FloatArray
    high: FloatArray
    start: IntArray
    end: IntArray
    vertex_point: FloatArray
    vertex_radius: FloatArray
    vertex_cut: BoolArray
    component: IntArray

    @property
    def component_count(self) -> int:
        """Number of connected components."""
        return int(self.component.max(initial=-1)) + 1

    @property
    def edge_component(self) -> IntArray:
        """(k,) connected component of each stretch."""
        return self.component[self.start]

    @property
    def vertex_kind(self) -> list[str]:
        """ "cut", "corner", "end", "joint" or "branch" for each vertex, by its edges here."""
        degree = np.bincount(
            np.concatenate([self.start, self.end]), minlength=len(self.vertex_radius)
        )
        names = np.array(["end", "end", "joint", "branch"])[np.minimum(degree, 3)]
        corner = (self.vertex_radius <= 1e-9 * self.axis.sites.size) & (degree <= 1)
        names = np.where(corner, "corner", names)
        return [str(name) for name in np.where(self.vertex_cut, "cut", names)]

    @cached_property
    def edges(self) -> tuple[Edge, ...]:
        """Stretches as Bezier edges between the vertices of this graph."""
        from grassfire.medial.axis import Edge

        table = self.axis.table
        control: list[FloatArray] = [np.zeros((0, 3))] * len(self.edge)
        degree = table.degree[self.edge]
        for value in np.unique(degree):
            rows = np.flatnonzero(degree == value)
            parts = table.restricted(self.edge[rows], self.low[rows], self.high[rows])
            for row, part in zip(rows, parts, strict=True):
                control[row] = part
        return tuple(
            Edge(int(start), int(end), part[:, :2] + table.origin, part[:, 2])
            for start, end, part in zip(self.start, self.end, control, strict=True)
        )

    @cached_property
    def length(self) -> float:
        """Length of all stretches, mm."""
        return float(np.sum(self.axis.table.lengths(self.edge, self.low, self.high)))


def _graph(
    axis: MedialAxis,
    edge: IntArray,
    interval: tuple[FloatArray, FloatArray],
    cut: tuple[BoolArray, BoolArray],
    lone: IntArray,
) -> AxisGraph:
    """Graph of stretches; `cut` says which ends are no vertices, `lone` are vertices to keep."""
    table = axis.table
    count = len(table.vertex)
    number = count + np.cumsum(np.concatenate(cut)) - 1
    start = np.where(cut[0], number[: len(edge)], table.start[edge])
    end = np.where(cut[1], number[len(edge) :], table.end[edge])
    used, numbers = np.unique(np.concatenate([start, end, lone]), return_inverse=True)
    ends = [
        table.evaluate(edge[flag], place[flag]) for place, flag in zip(interval, cut, strict=True)
    ]
    disks = np.concatenate([table.vertex, *ends])[used]
    start, end = numbers[: len(edge)], numbers[len(edge) : 2 * len(edge)]
    component = connected(start, end, len(used))
    return AxisGraph(
        axis, edge, *interval, start, end, disks[:, :2] + table.origin, disks[:, 2],
        used >= count, component,
    )  # fmt: skip


# -- wide parts -----------------------------------------------------------------------------------


def subgraph(axis: MedialAxis, minimum_radius: float, ties: int = 1) -> AxisGraph:
    """The part of the axis with r >= `minimum_radius`, as a graph.

    Parameters
    ----------
    minimum_radius : float
        mm; 0 gives the whole axis.
    ties : {1, -1}
        Whether places where r is stationary at `minimum_radius` (parallel walls, necks, largest
        disks of that very size, within 1e-10 of the size of the region) are left out (1) or belong
        to it (-1).

    Returns
    -------
    AxisGraph
        With vertices where edges were cut. It has as many components as the trimmed offset at
        `minimum_radius` has pieces.

    Raises
    ------
    GeometryError
        For a radius that is negative or no number.

    Examples
    --------
    Two squares of side 20, joined by a throat 2 wide, part above a radius of 1.

    >>> from grassfire.geometry import Line, Loop, Region
    >>> from grassfire.medial import medial_axis
    >>> half = [(-20, -10), (0, -10), (0, -1), (10, -1), (10, -10), (30, -10)]
    >>> corners = half + [(x, -y) for x, y in reversed(half)]
    >>> sides = zip(corners, corners[1:] + corners[:1])
    >>> axis = medial_axis(Region(Loop(tuple(Line(a, b) for a, b in sides))))
    >>> axis.subgraph(0.9).component_count, axis.subgraph(1.1).component_count
    (1, 2)
    """
    if not minimum_radius >= 0:
        raise GeometryError("a minimum radius must be 0 or more")
    table = axis.table
    if minimum_radius == 0:
        everything = np.arange(len(table))
        none = np.zeros(len(table), dtype=bool)
        ends = np.zeros(len(table)), np.ones(len(table))
        return _graph(axis, everything, ends, (none, none), _lone(axis, everything, 0.0))
    radius = settled(axis, minimum_radius, ties)
    found = axis.walker.stretches(radius)
    number = np.full(len(axis.pruned), -1, dtype=np.int64)
    number[table.row] = np.arange(len(table))
    kept = np.flatnonzero(number[found.row] >= 0)
    edge = number[found.row[kept]]
    lone = _lone(axis, edge, radius)
    ends, cut = (found.start[kept], found.end[kept]), (found.cut_start[kept], found.cut_end[kept])
    return _graph(axis, edge, ends, cut, lone)


def _lone(axis: MedialAxis, edge: IntArray, radius: float) -> IntArray:
    """Vertices that are wide enough though no edge at them is kept."""
    table = axis.table
    wide = table.vertex[:, 2] >= radius
    wide[table.start[edge]] = False
    wide[table.end[edge]] = False
    return np.flatnonzero(wide)


# -- pruning --------------------------------------------------------------------------------------


def prune(axis: MedialAxis, angle: float) -> AxisGraph:
    """Branches cut back to where their separation angle reaches `angle`.

    Parameters
    ----------
    angle : float
        Radians, 0 to pi. Small angles belong to detail: a smooth end has 0 at its tip, a square
        corner pi / 2 all along.

    Returns
    -------
    AxisGraph
        From every end inwards, the axis is left out while the angle between the feet
        (`separation_angle`, sampled 33 times an edge, then bisected) is below `angle`; what
        becomes an end that way is treated alike. What remains is connected, and never empty:
        the vertex with the largest disk stays.

    Raises
    ------
    GeometryError
        For an angle outside [0, pi].
    """
    if not 0 <= angle <= np.pi:
        raise GeometryError("a separation angle lies between 0 and pi")
    table = axis.table
    count = len(table)
    steps = np.linspace(0.0, 1.0, _SAMPLES)
    seen = separation_angle(axis, np.repeat(np.arange(count), _SAMPLES), np.tile(steps, count))
    # The angle at the ends of an edge is a limit: it is only good to rounding.
    wide = seen.reshape(count, _SAMPLES) >= angle * (1 - 1e-12)
    alive, at_start, at_end = _peeled(table, np.asarray(wide.any(axis=1)))
    first, last = np.argmax(wide, axis=1), _SAMPLES - 1 - np.argmax(wide[:, ::-1], axis=1)
    cut_low, cut_high = at_start & (first > 0), at_end & (last < _SAMPLES - 1)
    low, high = np.zeros(count), np.ones(count)
    rows = np.flatnonzero(cut_low)
    low[rows] = _reaching(axis, rows, steps[first[rows]], steps[first[rows] - 1], angle)
    rows = np.flatnonzero(cut_high)
    high[rows] = _reaching(axis, rows, steps[last[rows]], steps[last[rows] + 1], angle)
    kept = np.flatnonzero(alive)
    lone = np.zeros(0, dtype=np.int64) if len(kept) else np.array([np.argmax(table.vertex[:, 2])])
    return _graph(axis, kept, (low[kept], high[kept]), (cut_low[kept], cut_high[kept]), lone)


def _peeled(table: AxisTable, stays: BoolArray) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Edges that are left when those that do not stay are taken off, ends first.

    Also, of the edges that are left, which have an end of the axis at their start, at their end.
    """
    alive = np.ones(len(table), dtype=bool)
    while True:
        ends = np.concatenate([table.start[alive], table.end[alive]])
        tip = np.bincount(ends, minlength=len(table.vertex)) == 1
        gone = alive & ~stays & (tip[table.start] | tip[table.end])
        if not gone.any():
            return alive, alive & tip[table.start], alive & tip[table.end]
        alive &= ~gone


def _reaching(
    axis: MedialAxis, edge: IntArray, inside: FloatArray, outside: FloatArray, angle: float
) -> FloatArray:
    """Fractions between where the separation angle reaches `angle`, and is below, by bisection."""
    for _ in range(46):
        middle = 0.5 * (inside + outside)
        good = separation_angle(axis, edge, middle) >= angle
        inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
    return inside


__all__ = ["AxisGraph", "prune", "subgraph"]
