"""Lines and circles fitted alone or together, tangent to neighbours and through given points.

Gauss-Newton steps on the distances of the vertices, under equality constraints:

    minimise |r + J d|^2  subject to  g + G d = 0,      [J'J  G'] [d]   [-J'r]
                                                         [G    0 ] [l] = [-g  ]

A line is (angle, offset), a circle (x, y, signed radius), positive for left turns. With f the
distance to the left of either, tangency of a line and a circle is f_line(centre) = radius, of two
circles |c1 - c2| = |radius1 - radius2|: both run the same way through the point they share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grassfire.geometry.curve import FloatArray, cross, dot

if TYPE_CHECKING:
    from scipy import sparse

STEPS = 25
DENSE = 150
"""Unknowns up to which full matrices are faster than sparse ones."""
DAMPING = 1e-12
"""Share of the largest entry of J'J added to its diagonal."""
REGULARITY = 1e-14
"""Subtracted from the diagonal of the constraints."""


def fit_line(points: FloatArray) -> FloatArray:
    """Return (angle, offset) of the least-squares line, run from first to last point.

    The line is n.x = offset with n = (-sin angle, cos angle), to its left.
    """
    middle = points.mean(axis=0)
    off = points - middle
    chord = points[-1] - points[0]
    if len(points) == 2:
        angle = np.arctan2(chord[1], chord[0])
    else:
        (xx, xy), (_, yy) = off.T @ off
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        if np.cos(angle) * chord[0] + np.sin(angle) * chord[1] < 0.0:
            angle += np.pi
    normal = np.array([-np.sin(angle), np.cos(angle)])
    return np.array([angle, float(normal @ middle)])


def fit_circle(points: FloatArray, steps: int = 3) -> FloatArray | None:
    """Return (x, y, radius) of the least-squares circle, radius > 0 for left turns; None for lines.

    The algebraic fit (Kasa) starts Gauss-Newton steps on the distances.
    """
    middle = points.mean(axis=0)
    off = points - middle
    size = float(np.abs(off).max())
    off = off / size
    square = dot(off, off)
    x, y = off.T
    one = np.ones(len(off))
    table = np.stack([x, y, one], axis=1)
    normal, right = table.T @ table, table.T @ square
    if abs(np.linalg.det(normal)) < 1e-12 * len(off) ** 3:
        return None
    first, second, constant = np.linalg.solve(normal, right)
    centre = 0.5 * np.array([first, second])
    radius = float(np.sqrt(max(constant + centre @ centre, 0.0)))
    for _ in range(steps):
        spoke = off - centre
        reach = np.hypot(*spoke.T)
        if radius > 1e4 or not reach.min() > 0.0:
            return None
        slope = np.stack([-spoke[:, 0] / reach, -spoke[:, 1] / reach, -one], axis=1)
        gram = slope.T @ slope
        if abs(np.linalg.det(gram)) < 1e-14 * len(off) ** 3 * min(1.0, radius**-4):
            break
        step = np.linalg.solve(gram, slope.T @ (radius - reach))
        centre, radius = centre + step[:2], radius + float(step[2])
    spoke = off - centre
    sweep = np.arctan2(cross(spoke[:-1], spoke[1:]), dot(spoke[:-1], spoke[1:])).sum()
    place = centre * size + middle
    return np.array([place[0], place[1], np.copysign(radius * size, sweep)])


def off_line(line: FloatArray, points: FloatArray) -> FloatArray:
    """Return the signed distances (m,) to the left of a line (angle, offset)."""
    return np.asarray(points @ np.array([-np.sin(line[0]), np.cos(line[0])]) - line[1])


def off_circle(circle: FloatArray, points: FloatArray) -> FloatArray:
    """Return the signed distances (m,) to the left of a circle (x, y, signed radius)."""
    reach = np.hypot(points[:, 0] - circle[0], points[:, 1] - circle[1])
    return np.asarray(circle[2] - np.copysign(reach, circle[2]))


@dataclass(frozen=True)
class Shape:
    """A line (2 numbers) or a circle (3 numbers); see the module."""

    parameters: FloatArray

    @property
    def circular(self) -> bool:
        """Whether this is a circle."""
        return len(self.parameters) == 3

    def off(self, points: FloatArray) -> FloatArray:
        """Return signed distances (m,) in mm to the left of the shape."""
        off = off_circle if self.circular else off_line
        return off(self.parameters, points)

    def normal(self, points: FloatArray) -> FloatArray:
        """Return the unit left normals (m, 2) at the feet of points."""
        if self.circular:
            spoke = points - self.parameters[:2]
            reach = np.maximum(np.hypot(*spoke.T), 1e-300)
            return np.asarray(-np.sign(self.parameters[2]) * spoke / reach[:, None])
        angle = self.parameters[0]
        return np.broadcast_to([-np.sin(angle), np.cos(angle)], points.shape)

    def foot(self, point: FloatArray) -> FloatArray:
        """Return the nearest point (2,) of the unbounded shape."""
        rows = point[None]
        return np.asarray((rows - self.off(rows)[:, None] * self.normal(rows))[0])

    def tangent(self, point: FloatArray) -> FloatArray:
        """Return the unit tangent (2,) at the foot of a point."""
        normal = self.normal(point[None])[0]
        return np.array([normal[1], -normal[0]])

    def slope(self, points: FloatArray) -> FloatArray:
        """Return the derivatives (m, 2 or 3) of the distances by the parameters."""
        minus = -np.ones(len(points))
        if self.circular:
            return np.column_stack([-self.normal(points), -minus])
        angle = self.parameters[0]
        return np.column_stack([-points @ np.array([np.cos(angle), np.sin(angle)]), minus])

    def moved(self, shift: FloatArray) -> Shape:
        """Return the shape translated."""
        if self.circular:
            return Shape(self.parameters + np.append(shift, 0.0))
        angle = self.parameters[0]
        offset = float(np.array([-np.sin(angle), np.cos(angle)]) @ shift)
        return Shape(self.parameters + np.array([0.0, offset]))


@dataclass(frozen=True)
class _Rows:
    """Constraints: values, and the entries of their derivatives."""

    value: list[float]
    row: list[NDArray[np.int64]]
    column: list[NDArray[np.int64]]
    entry: list[FloatArray]

    def add(self, value: float, parts: list[tuple[int, FloatArray]]) -> None:
        for start, entry in parts:
            self.row.append(np.full(len(entry), len(self.value)))
            self.column.append(start + np.arange(len(entry)))
            self.entry.append(entry)
        self.value.append(value)


def fit_together(
    shapes: list[Shape],
    data: list[FloatArray],
    tangent: list[tuple[int, int]],
    anchors: list[tuple[int, FloatArray]],
) -> list[Shape] | None:
    """Return the shapes nearest to their data under the constraints; None where there are none.

    Parameters
    ----------
    shapes : list of Shape
        Where to start.
    data : list of (m, 2) array
        Vertices of each shape.
    tangent : list of pair of int
        Shapes that touch, running the same way.
    anchors : list of (int, (2,) array)
        Points that a shape passes through.
    """
    middle = np.concatenate(data).mean(axis=0)
    local = [shape.moved(-middle) for shape in shapes]
    rows = [points - middle for points in data]
    fixed = [(place, point - middle) for place, point in anchors]
    starts = np.concatenate([[0], np.cumsum([len(shape.parameters) for shape in local])])
    size = max(float(np.abs(np.concatenate(rows)).max()), 1e-300)
    for _ in range(STEPS):
        constraints = _constraints(local, starts, tangent, fixed)
        if constraints is None:
            return None
        step = _step(local, starts, rows, constraints, size)
        if step is None:
            return None
        local = [
            Shape(shape.parameters + step[starts[place] : starts[place + 1]])
            for place, shape in enumerate(local)
        ]
        if not all(np.all(np.isfinite(shape.parameters)) for shape in local):
            return None
        if float(np.abs(step).max()) <= 1e-12 * size:
            break
    final = _constraints(local, starts, tangent, fixed)
    if final is None or any(abs(value) > 1e-10 * size for value in final.value):
        return None
    return [shape.moved(middle) for shape in local]


def _constraints(
    shapes: list[Shape],
    starts: NDArray[np.int64],
    tangent: list[tuple[int, int]],
    anchors: list[tuple[int, FloatArray]],
) -> _Rows | None:
    """Return the constraints, None where two touching circles have one centre."""
    rows = _Rows([], [], [], [])
    for first, second in tangent:
        one, two = shapes[first], shapes[second]
        if one.circular and two.circular:
            apart = one.parameters[:2] - two.parameters[:2]
            reach, change = float(np.hypot(*apart)), one.parameters[2] - two.parameters[2]
            if reach == 0.0 or change == 0.0:
                return None
            slope = np.append(apart / reach, -np.sign(change))
            parts = [(int(starts[first]), slope), (int(starts[second]), -slope)]
            rows.add(reach - abs(float(change)), parts)
            continue
        line, circle = (second, first) if one.circular else (first, second)
        centre = shapes[circle].parameters[None, :2]
        value = float(shapes[line].off(centre)[0] - shapes[circle].parameters[2])
        slope = np.append(shapes[line].normal(centre)[0], -1.0)
        by_line = shapes[line].slope(centre)[0]
        rows.add(value, [(int(starts[line]), by_line), (int(starts[circle]), slope)])
    for place, point in anchors:
        value = float(shapes[place].off(point[None])[0])
        rows.add(value, [(int(starts[place]), shapes[place].slope(point[None])[0])])
    return rows


def _step(
    shapes: list[Shape],
    starts: NDArray[np.int64],
    data: list[FloatArray],
    constraints: _Rows,
    size: float,
) -> FloatArray | None:
    """Return the Gauss-Newton step of all parameters, lengths in mm, None where undetermined."""
    total, count = int(starts[-1]), len(constraints.value)
    blocks, right = [], np.zeros(total + count)
    for place, (shape, points) in enumerate(zip(shapes, data, strict=True)):
        slope = shape.slope(points)
        blocks.append(slope.T @ slope)
        right[starts[place] : starts[place + 1]] = -slope.T @ shape.off(points)
    right[total:] = -np.array(constraints.value)
    trace = DAMPING * max(float(block.diagonal().max()) for block in blocks)
    try:
        if len(right) <= DENSE:
            system = _dense_system(starts, blocks, trace, constraints)
            step = np.linalg.solve(system, right)[:total]
        else:
            from scipy.sparse.linalg import splu

            sparse_system = _sparse_system(total, blocks, trace, constraints)
            step = splu(sparse_system).solve(right)[:total]
    except (RuntimeError, np.linalg.LinAlgError):
        return None
    return np.asarray(step) if np.abs(step).max() < 1e3 * max(size, 1.0) else None


def _dense_system(
    starts: NDArray[np.int64], blocks: list[FloatArray], trace: float, constraints: _Rows
) -> FloatArray:
    total, count = int(starts[-1]), len(constraints.value)
    system = np.zeros((total + count, total + count))
    for first, last, block in zip(starts[:-1], starts[1:], blocks, strict=True):
        system[first:last, first:last] = block
    diagonal = np.arange(total + count)
    # Two constraints that say the same would be singular: a trace of regularity.
    system[diagonal, diagonal] += np.where(diagonal < total, trace, -REGULARITY)
    if count:
        row, column = np.concatenate(constraints.row) + total, np.concatenate(constraints.column)
        system[row, column] = system[column, row] = np.concatenate(constraints.entry)
    return system


def _sparse_system(
    total: int, blocks: list[FloatArray], trace: float, constraints: _Rows
) -> sparse.csc_matrix:
    from scipy import sparse

    count = len(constraints.value)
    square = sparse.block_diag(blocks) + trace * sparse.eye(total)
    if not count:
        return sparse.csc_matrix(square)
    where = (np.concatenate(constraints.row), np.concatenate(constraints.column))
    bound = sparse.coo_matrix((np.concatenate(constraints.entry), where), (count, total))
    corner = -REGULARITY * sparse.eye(count)
    return sparse.csc_matrix(sparse.bmat([[square, bound.T], [bound, corner]]))


def touching_point(first: Shape, second: Shape) -> FloatArray:
    """Return the point (2,) that two tangent shapes share."""
    if first.circular and second.circular:
        apart = first.parameters[:2] - second.parameters[:2]
        normal = apart / (first.parameters[2] - second.parameters[2])
        normal /= np.hypot(*normal)
        return np.asarray(first.parameters[:2] - first.parameters[2] * normal)
    line, circle = (second, first) if first.circular else (first, second)
    return line.foot(circle.parameters[:2])


def crossing_point(first: Shape, second: Shape, near: FloatArray) -> FloatArray | None:
    """Return the crossing (2,) of two shapes next to a point, None if Newton's method fails."""
    point = near.copy()
    for _ in range(20):
        rows = point[None]
        value = np.array([first.off(rows)[0], second.off(rows)[0]])
        slope = np.stack([first.normal(rows)[0], second.normal(rows)[0]])
        if abs(np.linalg.det(slope)) < 0.05:
            return None
        step = np.linalg.solve(slope, -value)
        point = point + step
        if float(np.abs(step).max()) <= 1e-15 * (1.0 + float(np.abs(point).max())):
            break
    return point
