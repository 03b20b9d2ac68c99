"""The examples of the gallery, and what is measured on each of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import paper_shapes as shapes
from numpy.typing import NDArray

from grassfire.geometry import Arc, Region, curvature_extrema
from grassfire.geometry.chebyshev import evaluate_bezier
from grassfire.medial import MedialAxis, medial_axis
from grassfire.medial.recover import recover_boundary

FloatArray = NDArray[np.float64]

TOLERANCE = 2e-7
"""Tolerance of the axes, mm: with radii of 1 mm and more, s of eq. (8) stays below 3e-7."""

FINE = 1e-10
"""Tolerance of the second run of each example, mm."""

PLACES = 23
"""Places inside each piece at which eqs. (8) and (9) are looked at; its ends are interpolated."""

_INNER = np.linspace(0.0, 1.0, PLACES + 2)[1:-1]


@dataclass(frozen=True)
class Example:
    """A region after a figure of the paper, and what its axis has to have."""

    name: str
    figure: str
    title: str
    make: Callable[[], Region]
    ends: int
    corners: int
    branches: int

    @property
    def edges(self) -> int:
        """Edges between terminal and branch points: vertices - edges = 1 - holes."""
        return self.ends + self.corners + self.branches - 1 + len(self.make().islands)


EXAMPLES = (
    Example("fig07-ellipse", "7", "Ellipse", shapes.ellipse, 2, 0, 0),
    Example("fig08-bean", "8", "Fundamental domain, cubic B-spline", shapes.bean, 2, 0, 0),
    Example("fig09-arcs", "9", "Arcs of contact, parallel sides", shapes.arc_ended, 2, 0, 0),
    Example("fig10-corners", "10", "Two convex corners", shapes.two_corners, 0, 2, 0),
    Example("fig11a-drop", "11a", "Corner and arc of contact", shapes.corner_and_arc, 1, 1, 0),
    Example("fig11b-pod", "11b", "Corner and smooth end", shapes.corner_and_point, 1, 1, 0),
    Example("fig12-three", "12", "One bifurcation", shapes.three_lobes, 3, 0, 1),
    Example("fig13-four", "13", "Two bifurcations", shapes.four_lobes, 4, 0, 2),
    Example("fig14a-hand", "14a", "Hand", shapes.hand, 7, 0, 5),
    Example("fig14b-hand", "14b", "Hand with a hole", shapes.hand_with_hole, 7, 0, 7),
    Example("fig14c-leaf", "14c", "Oak leaf", shapes.oak_leaf, 23, 0, 21),
)


@dataclass(frozen=True)
class Measured:
    """An axis and its figures.

    Attributes
    ----------
    edges, pieces : int
        Edges between terminal and branch points, and polynomials that they are made of.
    non_generic : int
        Disks of curvature at greatest curvature that are maximal but no ends.
    degrees : tuple of int
        Degrees that occur, ascending.
    interpolation_error : float
        Largest s of eq. (8); no unit.
    boundary_error : float
        Largest distance of eq. (9), mm.
    recovery_error : float
        Largest distance from the boundary of points recovered by eq. (1) from the edges alone, mm.
    seconds : dict
        Per stage, "total" last.
    """

    example: Example
    tolerance: float
    axis: MedialAxis
    ends: int
    corners: int
    branches: int
    non_generic: int
    edges: int
    pieces: int
    degrees: tuple[int, ...]
    interpolation_error: float
    boundary_error: float
    recovery_error: float
    seconds: dict[str, float]


def measure(example: Example, tolerance: float = TOLERANCE, repeat: int = 1) -> Measured:
    """Compute the axis `repeat` times, keep the fastest run, and count and check.

    Raises
    ------
    GeometryError
        When the axis cannot be certified.
    """
    region = example.make()
    axis, seconds = fastest(region, tolerance, repeat)
    kinds = np.array(axis.vertex_kind)
    count = {name: int(np.count_nonzero(kinds == name)) for name in ("end", "corner", "branch")}
    joints = int(np.count_nonzero(kinds == "joint"))
    share, boundary = errors(axis)
    return Measured(
        example=example,
        tolerance=tolerance,
        axis=axis,
        ends=count["end"],
        corners=count["corner"],
        branches=count["branch"],
        non_generic=curvature_ends(region, axis)[1],
        edges=len(axis.edges) - joints,
        pieces=len(axis.edges),
        degrees=tuple(sorted({len(edge.radius) - 1 for edge in axis.edges})),
        interpolation_error=share,
        boundary_error=boundary,
        recovery_error=recovery(axis),
        seconds=seconds,
    )


def fastest(region: Region, tolerance: float, repeat: int) -> tuple[MedialAxis, dict[str, float]]:
    """The fastest of `repeat` runs and its seconds per stage, "total" last."""
    runs = []
    for _ in range(repeat):
        # A region keeps what was computed on it: a copy makes each run the first one.
        fresh = Region(region.outer, region.islands)
        start = time.perf_counter()
        axis = medial_axis(fresh, tolerance)
        total = time.perf_counter() - start
        runs.append((axis, {**getattr(axis, "seconds", {}), "total": total}))
    return min(runs, key=lambda run: run[1]["total"])


def errors(axis: MedialAxis) -> tuple[float, float]:
    """Largest s of eq. (8) and largest distance of eq. (9), mm, over all pieces.

    With the boundary point c and its normal n at the parameter of the piece, and the
    interpolated centre m and radius r, s = |1 - n.(m - c) / r|, and eq. (1) recovers m - r n.
    """
    span = axis.span.take(np.flatnonzero(~axis.pruned))
    degree = np.array([len(edge.radius) - 1 for edge in axis.edges])
    share, away = 0.0, 0.0
    for value in np.unique(degree):
        rows = np.flatnonzero(degree == value)
        table = np.stack(
            [np.column_stack([axis.edges[k].control_points, axis.edges[k].radius]) for k in rows]
        )
        disks = evaluate_bezier(table, _INNER)
        centre, radius = disks[:, :, :2] - axis.sites.origin, disks[:, :, 2]
        start, end = span.start[rows, None], span.end[rows, None]
        site = np.repeat(span.site[rows], len(_INNER))
        point, normal, _ = axis.sites.frame(site, (start + (end - start) * _INNER).ravel())
        point, normal = point.reshape(centre.shape), normal.reshape(centre.shape)
        along = np.sum(normal * (centre - point), axis=2)
        share = max(share, float(np.abs(1 - along / radius).max()))
        recovered = centre - radius[:, :, None] * normal
        away = max(away, float(np.linalg.norm(recovered - point, axis=2).max()))
    return share, away


def recovery(axis: MedialAxis) -> float:
    """Largest distance from the boundary of what `recover_boundary` finds, mm."""
    _, _, left, right = recover_boundary(axis, PLACES)
    return float(np.abs(axis.clearance(np.concatenate([left, right]))).max())


def curvature_ends(region: Region, axis: MedialAxis) -> tuple[int, int]:
    """Ends found by curvature alone, as in section 4.1, and the non-generic points.

    Where the curvature is greatest the disk of curvature is maximal if it is inside. If it meets
    the boundary nowhere else its centre is an end, otherwise a non-generic point.
    """
    candidates = [osculating_disks(region), _arc_disks(region)]
    disks = np.concatenate(candidates)
    size = float(np.ptp(np.reshape(region.bounds(), (2, 2)), axis=0).max())
    inside = axis.clearance(disks[:, :2]) >= disks[:, 2] - 1e-9 * size
    centre = np.unique(np.round(disks[inside, :2] / (1e-6 * size)), axis=0) * (1e-6 * size)
    ends = axis.vertex_point[np.array(axis.vertex_kind) == "end"]
    away = np.linalg.norm(centre[:, None] - ends, axis=2).min(axis=1, initial=np.inf)
    found = int(np.count_nonzero(away <= 1e-5 * size))
    return found, len(centre) - found


def osculating_disks(region: Region) -> FloatArray:
    """(n, 3) disks of curvature where it is stationary or jumps, on the inner side."""
    disks = []
    for curve in region.curves:
        t = np.concatenate([[0.0], curvature_extrema(curve), [1.0]])
        tangent, curvature = curve.derivative(t), curve.curvature(t)
        normal = tangent[:, ::-1] * (-1.0, 1.0) / np.hypot(*tangent.T)[:, None]
        bent = curvature > 1e-9
        radius = 1 / curvature[bent]
        centre = curve.point(t)[bent] + radius[:, None] * normal[bent]
        disks.append(np.column_stack([centre, radius]))
    return np.concatenate(disks)


def _arc_disks(region: Region) -> FloatArray:
    """(n, 3) disks of the arcs that turn left."""
    arcs = [arc for arc in region.curves if isinstance(arc, Arc) and arc.sweep > 0]
    return np.array([(*arc.centre, arc.radius) for arc in arcs]).reshape(-1, 3)
