"""The cells that the sweep counts on, and the drawn regions in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grassfire.verify.model import FloatArray
from grassfire.verify.path import BoolArray, spread

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry


_FINE, _COARSE = 40, 24
"""Cells in the smallest tool's radius, on small pockets and on large ones."""

_FINE_CELLS = 2_000_000
"""Cells up to which a map is fine."""


@dataclass(frozen=True)
class Grid:
    """Square cells: centre of cell (row, column) at (x0 + (column + 1/2) c, y0 + (row + 1/2) c)."""

    x0: float
    y0: float
    cell: float
    columns: int
    rows: int

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.columns * self.rows


def choose_grid(
    bounds: tuple[float, float, float, float],
    smallest_radius: float,
    largest_radius: float,
    resolution: float | None,
    max_cells: int,
) -> Grid:
    """Return a grid over `bounds` with a margin that any tool touching the regions stays within.

    Unless `resolution` (mm) is given, the cell is a fortieth of the smallest tool's radius on small
    pockets and grows to a twenty-fourth where the map would have over 2 million cells. It is
    larger still where it would exceed `max_cells`.
    """
    pad = 2 * largest_radius + 1.0
    width = bounds[2] - bounds[0] + 2 * pad
    height = bounds[3] - bounds[1] + 2 * pad
    if resolution is None:
        even = math.sqrt(width * height / _FINE_CELLS)
        cell = min(max(smallest_radius / _FINE, even), smallest_radius / _COARSE)
    else:
        cell = resolution
    cell = max(cell, math.sqrt(width * height / max_cells))
    return Grid(
        x0=bounds[0] - pad,
        y0=bounds[1] - pad,
        cell=cell,
        columns=math.ceil(width / cell),
        rows=math.ceil(height / cell),
    )


def edges_of(shape: BaseGeometry) -> FloatArray:
    """Return the edges of polygons as (m, 4) rows x0, y0, x1, y1."""
    import shapely

    rings = shapely.get_rings(shapely.get_parts(shape))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    joined = ring[1:] == ring[:-1]
    edges = np.column_stack([points[:-1], points[1:]])[joined]
    moved = np.any(edges[:, :2] != edges[:, 2:], axis=1)
    return np.asarray(edges[moved], dtype=np.float64)


def cells_inside(shape: BaseGeometry, grid: Grid) -> BoolArray:
    """Return (rows, columns) whether the centre of each cell lies inside polygons.

    Even-odd scan conversion: every edge toggles the cells to the right of where it crosses the
    line through the centres of a row.
    """
    edges = edges_of(shape)
    if not len(edges):
        return np.zeros((grid.rows, grid.columns), dtype=bool)
    low = np.minimum(edges[:, 1], edges[:, 3])
    high = np.maximum(edges[:, 1], edges[:, 3])
    first = np.ceil((low - grid.y0) / grid.cell - 0.5).astype(np.int64).clip(0, grid.rows)
    stop = np.ceil((high - grid.y0) / grid.cell - 0.5).astype(np.int64).clip(0, grid.rows)
    edge, step = spread(stop - first)
    row = first[edge] + step
    part = (grid.y0 + (row + 0.5) * grid.cell - edges[edge, 1]) / (edges[edge, 3] - edges[edge, 1])
    x = edges[edge, 0] + part * (edges[edge, 2] - edges[edge, 0])
    column = np.ceil((x - grid.x0) / grid.cell - 0.5).astype(np.int64).clip(0, grid.columns)
    width = grid.columns + 1
    toggles = np.bincount(row * width + column, minlength=grid.rows * width)
    parity = np.cumsum(toggles.reshape(grid.rows, width).astype(np.uint8), axis=1, dtype=np.uint8)
    return np.asarray((parity[:, :-1] & 1).astype(bool))
