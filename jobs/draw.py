"""Draws the DXF files of the worked examples: ``python jobs/draw.py`` writes them beside itself.

The drawings are made for the project, the way a user's CAD system would leave them: lines and
arcs, polylines with bulges, circles and splines on named layers, units in the header.
"""

from __future__ import annotations

import math
from pathlib import Path

import ezdxf
from ezdxf import units
from ezdxf.document import Drawing
from ezdxf.layouts import Modelspace

# No time stamps and random identifiers in the files.
ezdxf.options.write_fixed_meta_data_for_testing = True

HERE = Path(__file__).resolve().parent
QUARTER_BULGE = math.tan(math.pi / 8)


def new_drawing() -> tuple[Drawing, Modelspace]:
    """An empty drawing in millimetres."""
    document = ezdxf.new("R2010", units=units.MM)
    return document, document.modelspace()


def save(document: Drawing, name: str) -> None:
    """Write the drawing beside this file."""
    document.saveas(HERE / name)


def rounded_rectangle(
    space: Modelspace, x: float, y: float, width: float, height: float, radius: float, layer: str
) -> None:
    """A polyline with four lines and four quarter arcs, lower left corner at (x, y), mm."""
    right, top = x + width, y + height
    corners = [
        (x + radius, y, 0.0),
        (right - radius, y, QUARTER_BULGE),
        (right, y + radius, 0.0),
        (right, top - radius, QUARTER_BULGE),
        (right - radius, top, 0.0),
        (x + radius, top, QUARTER_BULGE),
        (x, top - radius, 0.0),
        (x, y + radius, QUARTER_BULGE),
    ]
    space.add_lwpolyline(corners, format="xyb", close=True, dxfattribs={"layer": layer})


def slot(space: Modelspace, x: float, y: float, length: float, width: float, layer: str) -> None:
    """A horizontal slot with round ends; (x, y) is its centre, `length` over all, mm."""
    half, radius = length / 2 - width / 2, width / 2
    points = [
        (x - half, y - radius, 0.0),
        (x + half, y - radius, 1.0),
        (x + half, y + radius, 0.0),
        (x - half, y + radius, 1.0),
    ]
    space.add_lwpolyline(points, format="xyb", close=True, dxfattribs={"layer": layer})


def bracket() -> None:
    """A pocket with a notch, around two round bosses and a rib."""
    document, space = new_drawing()
    for layer, colour in (("POCKET", 5), ("OUTLINE", 7)):
        document.layers.add(layer, color=colour)
    rounded_rectangle(space, 0, 0, 120, 80, 8, "OUTLINE")
    bulge = QUARTER_BULGE
    pocket = [
        (16, 8, 0), (74, 8, 0), (74, 20, -bulge), (82, 28, 0), (112, 28, 0), (112, 62, bulge),
        (102, 72, 0), (18, 72, bulge), (8, 62, 0), (8, 16, bulge),
    ]  # fmt: skip
    space.add_lwpolyline(pocket, format="xyb", close=True, dxfattribs={"layer": "POCKET"})
    for centre in ((28, 26), (92, 50)):
        space.add_circle(centre, 7.5, dxfattribs={"layer": "POCKET"})
    rounded_rectangle(space, 42, 44, 30, 12, 4, "POCKET")
    save(document, "bracket.dxf")


def leaf() -> None:
    """A free-form pocket: one closed spline through points."""
    document, space = new_drawing()
    document.layers.add("POCKET", color=5)
    count = 14
    points = []
    for index in range(count):
        angle = 2 * math.pi * index / count
        radius = 30 + 7 * math.cos(2 * angle + 0.4) + 5 * math.sin(3 * angle)
        points.append((50 + 1.35 * radius * math.cos(angle), 42 + radius * math.sin(angle)))
    # A periodic cubic: the first three control points come again at the end.
    control = points + points[:3]
    spline = space.add_open_spline(control, degree=3, dxfattribs={"layer": "POCKET"})
    spline.knots = [float(knot) for knot in range(len(control) + 4)]
    spline.closed = True
    save(document, "leaf.dxf")


def plate() -> None:
    """A wide pocket for a large tool and narrow slots for a small one, on layers of their own."""
    document, space = new_drawing()
    for layer, colour in (("WIDE", 5), ("NARROW", 3)):
        document.layers.add(layer, color=colour)
    corner = [(10, 10), (70, 10), (70, 34), (46, 34), (46, 58), (10, 58)]
    for start, end in zip(corner, corner[1:] + corner[:1], strict=True):
        space.add_line(start, end, dxfattribs={"layer": "WIDE"})
    for y in (44, 52):
        slot(space, 68, y, 28, 4, "NARROW")
    space.add_ellipse((88, 22), major_axis=(0, 12), ratio=0.5, dxfattribs={"layer": "NARROW"})
    save(document, "plate.dxf")


if __name__ == "__main__":
    bracket()
    leaf()
    plate()
