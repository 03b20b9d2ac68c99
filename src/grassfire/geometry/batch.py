"""Evaluation of many curves at once: parameters of any mix of curves in few NumPy calls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grassfire.geometry.arc import Arc
from grassfire.geometry.bezier import Bezier, homogeneous, project
from grassfire.geometry.chebyshev import bernstein_family, differentiate_bezier
from grassfire.geometry.curve import SINGULAR_SPEED, Curve, FloatArray, cross, left_normal
from grassfire.geometry.line import Line

IntArray = NDArray[np.int64]


class CurveBatch:
    """Curves grouped by type: all lines, all arcs and all Bezier curves of a degree in one call.

    Parameters
    ----------
    curves : sequence of Curve
        Numbered from 0. Other types (elliptical arcs, B-splines, offsets) are evaluated one by
        one.
    """

    def __init__(self, curves: Sequence[Curve]) -> None:
        self.curves = tuple(curves)
        self._size = _sizes(self.curves)
        groups: dict[str, list[int]] = {}
        for index, curve in enumerate(self.curves):
            groups.setdefault(_group(curve, index), []).append(index)
        self._slot = np.empty(len(self.curves), dtype=np.int64)
        self._group_of = np.empty(len(self.curves), dtype=np.int64)
        self._tables: list[tuple[str, list[FloatArray], Curve]] = []
        for number, (name, members) in enumerate(groups.items()):
            self._slot[members] = np.arange(len(members))
            self._group_of[members] = number
            chosen = [self.curves[index] for index in members]
            self._tables.append((name, _columns(name, chosen), chosen[0]))

    def __len__(self) -> int:
        return len(self.curves)

    def evaluate(self, index: ArrayLike, t: ArrayLike, order: int = 0) -> tuple[FloatArray, ...]:
        """Return the point and the derivatives up to `order` of curve index at t.

        Parameters
        ----------
        index : (...) int array_like
        t : (...) array_like
            Broadcast against `index`.

        Returns
        -------
        tuple of (..., 2) arrays
        """
        which, parameter = np.broadcast_arrays(
            np.asarray(index, dtype=np.int64), np.asarray(t, dtype=np.float64)
        )
        flat, times = which.ravel(), parameter.ravel()
        group = self._group_of[flat]
        result = [np.empty((len(flat), 2)) for _ in range(order + 1)]
        for number, table in enumerate(self._tables):
            rows = np.flatnonzero(group == number)
            if len(rows):
                values = _evaluate(table, self._slot[flat[rows]], times[rows], order)
                for target, value in zip(result, values, strict=True):
                    target[rows] = value
        return tuple(value.reshape(*which.shape, 2) for value in result)

    def point(self, index: ArrayLike, t: ArrayLike) -> FloatArray:
        """Return points (..., 2)."""
        return self.evaluate(index, t)[0]

    def tangent(self, index: ArrayLike, t: ArrayLike) -> FloatArray:
        """Return unit tangents (..., 2); one-sided limits where the speed vanishes."""
        which, parameter = np.broadcast_arrays(np.asarray(index), np.asarray(t, dtype=float))
        first = self.evaluate(which, parameter, 1)[1]
        speed = np.hypot(first[..., 0], first[..., 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            result = first / speed[..., None]
        for place in self._special(which, speed):
            result[place] = self.curves[int(which[place])].tangent(parameter[place])
        return result

    def normal(self, index: ArrayLike, t: ArrayLike) -> FloatArray:
        """Return unit left normals (..., 2)."""
        return left_normal(self.tangent(index, t))

    def curvature(self, index: ArrayLike, t: ArrayLike) -> FloatArray:
        """Return signed curvatures (...); infinite at cusps."""
        which, parameter = np.broadcast_arrays(np.asarray(index), np.asarray(t, dtype=float))
        _, first, second = self.evaluate(which, parameter, 2)
        speed = np.hypot(first[..., 0], first[..., 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            result = np.asarray(cross(first, second) / speed**3)
        for place in self._special(which, speed):
            result[place] = self.curves[int(which[place])].curvature(parameter[place])
        return result

    def _special(self, which: IntArray, speed: FloatArray) -> list[tuple[int, ...]]:
        """Return the positions where the speed vanishes, which each curve handles itself."""
        rows = np.argwhere(speed <= SINGULAR_SPEED * self._size[which])
        return [tuple(int(value) for value in row) for row in rows]


def _sizes(curves: Sequence[Curve]) -> FloatArray:
    """Return the curves' sizes (n,) in mm; the many lines all at once."""
    lines = [(number, curve) for number, curve in enumerate(curves) if isinstance(curve, Line)]
    result = np.array([0.0 if isinstance(curve, Line) else curve.size for curve in curves])
    if lines:
        ends = np.array([(line.start, line.end) for _, line in lines])
        change = ends[:, 1] - ends[:, 0]
        result[[number for number, _ in lines]] = np.hypot(change[:, 0], change[:, 1])
    return result


def _group(curve: Curve, index: int) -> str:
    if isinstance(curve, Line):
        return "line"
    if isinstance(curve, Arc):
        return "arc"
    if isinstance(curve, Bezier):
        return f"bezier {curve.degree} {curve.weights is not None}"
    return f"single {index}"


def _columns(name: str, curves: Sequence[Curve]) -> list[FloatArray]:
    """Return the arrays, a row a curve, that evaluation of a group gathers from."""
    columns: list[list[FloatArray]] = []
    for curve in curves:
        if isinstance(curve, Line):
            columns.append([curve.start, curve.end])
        elif isinstance(curve, Arc):
            row = [curve.radius, curve.start_angle, curve.sweep]
            columns.append([curve.centre, np.array(row)])
        elif isinstance(curve, Bezier):
            columns.append([homogeneous(curve.control_points, curve.weights)])
    return [np.stack(column) for column in zip(*columns, strict=True)]


def _evaluate(
    table: tuple[str, list[FloatArray], Curve], slot: IntArray, t: FloatArray, order: int
) -> tuple[FloatArray, ...]:
    """Return the derivatives of the group's curves `slot` (n,) at t (n,)."""
    name, columns, single = table
    if name == "line":
        start, end = columns[0][slot], columns[1][slot]
        share = t[:, None]
        values = [(1.0 - share) * start + share * end, end - start]
        values.extend(np.zeros_like(start) for _ in range(2, order + 1))
        return tuple(values[: order + 1])
    if name == "arc":
        radius, start_angle, sweep = columns[1][slot].T
        angle = start_angle + sweep * t
        radial = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        turned = (radial, left_normal(radial), -radial, -left_normal(radial))
        values = [columns[0][slot] + radial]
        for level in range(1, order + 1):
            values.append(sweep[:, None] ** level * turned[level % 4])
        return tuple(values)
    if name.startswith("bezier"):
        derivatives = []
        control = columns[0]
        for weights in bernstein_family(control.shape[1] - 1, t, order):
            derivatives.append(np.einsum("ni,nik->nk", weights, control[slot]))
            control = differentiate_bezier(control)
        return project(derivatives) if control.shape[-1] == 3 else tuple(derivatives)
    return single.evaluate(t, order)
