"""Polygons of any size: loops of lines that are kept as one array of points."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from grassfire.errors import GeometryError
from grassfire.geometry.curve import (
    Bounds,
    Curve,
    FloatArray,
    affine_parts,
    box,
    frozen_array,
)
from grassfire.geometry.line import Line
from grassfire.geometry.loop import JunctionTable, Loop
from grassfire.geometry.measures import polygon_areas


class Polygon(Loop):
    """The loop of lines between consecutive points; see `Loop.from_points`, which makes it."""

    _vertices: FloatArray

    def __init__(self, points: ArrayLike) -> None:
        given = frozen_array(points, (None, 2), "the points of a polygon")
        same = given[1:] == given[:-1]
        if same.any():
            given = given[np.append(True, ~same.all(axis=1))]
        if len(given) > 1 and given[-1].tolist() == given[0].tolist():
            given = given[:-1]
        # Neighbours differ: so do the first three, if the third is not the first again.
        if len(given) < 3 or given[2].tolist() == given[0].tolist():
            _demand_three(given)
        given.setflags(write=False)
        object.__setattr__(self, "_vertices", given)

    def __repr__(self) -> str:
        return f"Loop.from_points(<{len(self)} points>)"

    def __len__(self) -> int:
        return len(self._vertices)

    @cached_property
    def curves(self) -> tuple[Curve, ...]:
        """The lines, made now."""
        ends = np.roll(self._vertices, -1, axis=0)
        return tuple(Line(start, end) for start, end in zip(self._vertices, ends, strict=True))

    @property
    def vertices(self) -> FloatArray:
        """(n, 2) corners in mm; line i runs from row i to the next."""
        return self._vertices

    @property
    def start(self) -> FloatArray:
        """(2,) point at u = 0."""
        return np.asarray(self._vertices[0])

    @cached_property
    def _change(self) -> FloatArray:
        return np.asarray(np.roll(self._vertices, -1, axis=0) - self._vertices)

    def evaluate(self, u: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives by u up to `order`, each (..., 2)."""
        index, parameter = self.locate(u)
        share = parameter[..., None]
        start, end = self._vertices[index], self._vertices[(index + 1) % len(self)]
        values = [np.asarray((1.0 - share) * start + share * end)]
        if order >= 1:
            values.append(self._change[index])
        values.extend(np.zeros_like(values[0]) for _ in range(2, order + 1))
        return tuple(values)

    def tangent(self, u: ArrayLike) -> FloatArray:
        """Return unit tangents (..., 2); from the right at junctions."""
        change = self._change[self.locate(u)[0]]
        return np.asarray(change / np.hypot(change[..., 0], change[..., 1])[..., None])

    def curvature(self, u: ArrayLike) -> FloatArray:
        """Return zeros (...)."""
        return np.zeros(np.shape(u))

    @cached_property
    def area(self) -> float:
        """Signed area in mm^2, counter-clockwise positive."""
        return float(polygon_areas(self._vertices, np.zeros(1, dtype=np.int64))[0])

    @cached_property
    def length(self) -> float:
        """Length of the whole loop in mm."""
        return float(np.hypot(self._change[:, 0], self._change[:, 1]).sum())

    @cached_property
    def _box(self) -> Bounds:
        return box(self._vertices)

    def reversed(self) -> Polygon:
        """Return the loop run the other way; the first line becomes the last."""
        return Polygon(np.concatenate([self._vertices[:1], self._vertices[:0:-1]]))

    def start_at(self, index: int) -> Polygon:
        """Return the loop that starts with line `index`."""
        return Polygon(np.roll(self._vertices, -(index % len(self)), axis=0))

    def transformed(self, matrix: ArrayLike) -> Polygon:
        """Return the image under a (2, 3) affine matrix."""
        linear, shift = affine_parts(matrix)
        return Polygon(self._vertices @ linear.T + shift)

    def junctions(self, angular_tolerance: float) -> JunctionTable:
        """Classify the junctions between consecutive lines, as for any loop."""
        incoming = np.roll(self._change, 1, axis=0)
        return self._classified(self._vertices, incoming, self._change, angular_tolerance)

    def _curve(self, index: int) -> Curve:
        return Line(self._vertices[index], self._vertices[(index + 1) % len(self)])


def _demand_three(points: FloatArray) -> None:
    """Raise where there are no three different points."""
    other = points[np.any(points != points[:1], axis=1)]
    if not np.any(other != other[:1]):
        raise GeometryError(
            "a polygon needs three different points",
            place=points[0].tolist() if len(points) else None,
        )
