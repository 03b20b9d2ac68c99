"""The stock after machining: as a mesh, and as a picture with the faults marked."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grassfire.errors import InputError
from grassfire.verify.model import Fault, FloatArray, HeightMap, Verification
from grassfire.verify.path import IntArray

_MESH_CELLS = 160_000
"""Corners of a mesh's upper side: finer maps are thinned out to about so many."""

_PNG_DOTS = 150


def stock_mesh(
    heights: HeightMap, bottom: float, *, max_corners: int = _MESH_CELLS
) -> tuple[FloatArray, IntArray]:
    """Return a closed mesh of the stock after machining.

    The upper side joins the heights at the centres of cells (of every k-th cell, where there are
    more than `max_corners`), so that walls lean by the distance of two corners.

    Parameters
    ----------
    heights : HeightMap
    bottom : float
        z of the stock's flat lower side, mm.
    max_corners : int

    Returns
    -------
    (n, 3) array
        Corners, mm.
    (m, 3) array
        Triangles, counter-clockwise seen from outside.

    Raises
    ------
    InputError
        If the stock would have no thickness somewhere.
    """
    lowest = float(heights.height.min())
    if not bottom < lowest:
        raise InputError(
            f"the stock's lower side at z {bottom:g} mm is not below what was cut, {lowest:g} mm",
            remedy="give [stock] the right thickness",
        )
    step = max(1, int(np.ceil(np.sqrt(heights.height.size / max_corners))))
    field = heights.height[step // 2 :: step, step // 2 :: step]
    rows, columns = field.shape
    width = heights.resolution
    x = heights.origin[0] + (np.arange(columns) * step + step // 2 + 0.5) * width
    y = heights.origin[1] + (np.arange(rows) * step + step // 2 + 0.5) * width
    across, along = np.meshgrid(x, y)
    upper = np.column_stack([across.ravel(), along.ravel(), field.ravel()])
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    c, d = number[1:, 1:].ravel(), number[1:, :-1].ravel()
    rim = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    following = np.roll(rim, -1)
    below = len(upper) + np.arange(len(rim))
    below_following = np.roll(below, -1)
    middle = len(upper) + len(rim)
    floor = upper[rim].copy()
    floor[:, 2] = bottom
    centre = [[(x[0] + x[-1]) / 2, (y[0] + y[-1]) / 2, bottom]]
    triangles = [
        np.column_stack([a, b, c]),
        np.column_stack([a, c, d]),
        np.column_stack([rim, below, below_following]),
        np.column_stack([rim, below_following, following]),
        np.column_stack([np.full(len(rim), middle), below_following, below]),
    ]
    return np.concatenate([upper, floor, centre]), np.concatenate(triangles).astype(np.int64)


def mesh_file(corners: FloatArray, triangles: IntArray, name: str) -> bytes:
    """Return a mesh as the bytes of a file: GLB (in metres, y up, as glTF wants it) or STL (in mm).

    Raises
    ------
    InputError
        If the name ends otherwise, or trimesh is not installed.
    """
    kind = Path(name).suffix.lower().lstrip(".")
    if kind not in ("glb", "stl"):
        raise InputError("a mesh is written as .glb or .stl", source=name)
    try:
        import trimesh
    except ImportError as error:
        raise InputError(
            "writing a mesh needs trimesh",
            source=name,
            remedy="pip install 'grassfire[mesh]' (or trimesh itself)",
        ) from error
    if kind == "glb":
        corners = np.column_stack([corners[:, 0], corners[:, 2], -corners[:, 1]]) / 1000.0
    mesh = trimesh.Trimesh(corners, triangles, process=False)
    data = mesh.export(file_type=kind)
    assert isinstance(data, bytes)
    return data


def stock_png(
    verification: Verification, walls: Sequence[FloatArray], *, title: str = "", marks: int = 12
) -> bytes:
    """Return a PNG of the stock from above, coloured by height, with walls and faults.

    Parameters
    ----------
    verification : Verification
    walls : sequence of (n, 2) arrays
        Closed boundaries of the pockets, mm.
    title : str
    marks : int
        Faults that are named; the others are marked only.

    Raises
    ------
    InputError
        If matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError(
            "a PNG needs matplotlib",
            remedy="pip install 'grassfire[picture]' (or matplotlib itself), or ask for an SVG",
        ) from error
    heights = verification.height_map
    rows, columns = heights.height.shape
    x, y = heights.origin
    extent = (x, x + columns * heights.resolution, y, y + rows * heights.resolution)
    figure = Figure(figsize=(9, 7), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    image = axes.imshow(
        heights.height, origin="lower", extent=extent, cmap="YlGnBu_r", interpolation="nearest"
    )
    figure.colorbar(image, ax=axes, label="z after machining, mm")
    for wall in walls:
        closed = np.concatenate([wall, wall[:1]])
        axes.plot(closed[:, 0], closed[:, 1], color="#22262b", linewidth=0.9)
    placed = [fault for fault in verification.faults if np.isfinite(fault.place[:2]).all()]
    for number, fault in enumerate(placed, 1):
        axes.plot(*fault.place[:2], "o", color="#d62728", fillstyle="none", markersize=11)
        if number <= marks:
            label = f"{number} {_label(fault)}"
            axes.annotate(
                label, fault.place[:2], (9, 9), textcoords="offset points", color="#d62728"
            )
    axes.set(xlabel="x, mm", ylabel="y, mm", title=title, aspect="equal")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_PNG_DOTS, metadata={"Software": None})
    return buffer.getvalue()


def _label(fault: Fault) -> str:
    """A fault in two words."""
    return f"{fault.kind}, line {fault.line}" if fault.line else fault.kind
