"""The axis as a graph of NetworkX, where that is installed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from grassfire.errors import InputError
from grassfire.geometry import Bezier
from grassfire.geometry.chebyshev import bernstein

if TYPE_CHECKING:
    import networkx

    from grassfire.medial.axis import Edge, MedialAxis


def to_networkx(axis: MedialAxis) -> networkx.MultiGraph[int]:
    """Return vertices and edges as a NetworkX MultiGraph.

    Two vertices can have several edges between them (around an island), and an edge can lead back
    to its vertex.

    Parameters
    ----------
    axis : MedialAxis

    Returns
    -------
    networkx.MultiGraph
        Nodes 0 to n - 1 with `x`, `y`, `r` (mm) and `kind`; edges, keyed by their number in
        `axis.edges`, with `start` and `end` (nodes; the graph has no directions, the control
        points run from one to the other), `control_points` (n + 1, 2), `radius` (n + 1,) and
        `length` (mm, to 1e-9). The graph itself has `tolerance`, in mm.

    Raises
    ------
    InputError
        If NetworkX is not installed.
    """
    try:
        import networkx
    except ImportError as error:
        raise InputError(
            "a graph of the medial axis needs networkx", remedy="pip install networkx"
        ) from error
    graph: networkx.MultiGraph[int] = networkx.MultiGraph(tolerance=axis.tolerance)
    columns = zip(
        axis.vertex_point.tolist(), axis.vertex_radius.tolist(), axis.vertex_kind, strict=True
    )
    for number, ((x, y), radius, kind) in enumerate(columns):
        graph.add_node(number, x=x, y=y, r=radius, kind=kind)
    for number, (edge, length) in enumerate(zip(axis.edges, _lengths(axis.edges), strict=True)):
        graph.add_edge(
            edge.start,
            edge.end,
            key=number,
            start=edge.start,
            end=edge.end,
            control_points=edge.control_points,
            radius=edge.radius,
            length=length,
        )
    return graph


def _lengths(edges: Sequence[Edge]) -> list[float]:
    """Lengths of edges to 1e-9 mm: by two Gauss rules, with care where those differ."""
    result = [0.0] * len(edges)
    degrees = np.array([len(edge.radius) - 1 for edge in edges], dtype=np.int64)
    for degree in np.unique(degrees):
        rows = np.flatnonzero(degrees == degree).tolist()
        control = np.stack([edges[row].control_points for row in rows])
        slope = degree * np.diff(control, axis=1)
        sums = []
        for count in (12, 20):
            node, weight = np.polynomial.legendre.leggauss(count)
            speed = bernstein(int(degree) - 1, 0.5 * (node + 1.0)) @ slope
            sums.append(np.hypot(speed[..., 0], speed[..., 1]) @ (0.5 * weight))
        for row, coarse, fine in zip(rows, *sums, strict=True):
            sure = abs(fine - coarse) <= 1e-10
            result[row] = float(fine) if sure else Bezier(edges[row].control_points).length(1e-9)
    return result
