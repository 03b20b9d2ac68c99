"""Looking at drawings: what they hold, what tools reach, their medial axes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from grassfire.app.stages import PICTURE_TOLERANCE, Progress, Stopwatch, axis_of, walls_of
from grassfire.errors import GeometryError, InputError
from grassfire.tolerance import CHAINING, FITTING, MEDIAL

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grassfire.geometry import Region
    from grassfire.medial import MedialAxis

    FloatArray = NDArray[np.float64]

STANDARD_DIAMETERS: Final = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0)
"""Diameters that `inspect` looks at, mm."""


def _reach(axes: Sequence[MedialAxis], diameters: Sequence[float]) -> list[float]:
    """Area that a tool of each diameter (ascending) can clear in all regions, mm^2."""
    import numpy as np
    import shapely
    from shapely.geometry import Polygon

    from grassfire.geometry import flatten

    areas = [0.0] * len(diameters)
    # as planned: a slot as wide as the tool is wide enough
    distances = np.asarray(diameters, dtype=np.float64) / 2 - FITTING
    for axis in axes:
        parts: list[list[Any]] = [[] for _ in diameters]
        for node in axis.offset_tree(distances):
            outer, *islands = (flatten(loop, PICTURE_TOLERANCE / 10) for loop in node.loops)
            centres = Polygon(outer, islands)
            parts[node.level].append(centres.buffer(distances[node.level], quad_segs=32))
        for index, polygons in enumerate(parts):
            area = float(shapely.union_all(polygons).area) if polygons else 0.0
            areas[index] += min(area, axis.region.area)
    return areas


def inspect(
    path: str | Path,
    layers: Sequence[str] = (),
    units: str | None = None,
    diameters: Sequence[float] = (),
    chaining_tolerance: float = CHAINING,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """What a drawing holds and what tools reach in it, JSON-ready, in mm.

    Parameters
    ----------
    path, layers, units
        DXF file; glob patterns, all layers by default; units in place of the drawing's.
    diameters : sequence of float
        Tools to look at beside the standard ones, mm.
    chaining_tolerance : float
        Gap between curve ends that is closed, mm.

    Raises
    ------
    InputError, GeometryError
        If the drawing cannot be read or holds no closed contour.
    """
    from grassfire.dxf import read_regions
    from grassfire.report import Finding, Severity

    watch = Stopwatch(progress)
    with watch.stage("read"):
        drawing = read_regions(
            path, layers=layers, units=units, chaining_tolerance=chaining_tolerance
        )
    findings = list(drawing.findings)
    regions, axes = [], []
    with watch.stage("medial"):
        for region in drawing.regions:
            try:
                axes.append(axis_of(region, str(path)))
                regions.append(_region_entry(region, axes[-1]))
            except GeometryError as error:
                findings.append(Finding(Severity.ERROR, "medial-axis", str(error)))
                regions.append(_region_entry(region, None))
    sizes = sorted({*STANDARD_DIAMETERS, *diameters})
    area = sum(region.area for region in drawing.regions)
    with watch.stage("reach"):
        reach = _reach(axes, sizes)
    return {
        "file": str(path),
        "units": drawing.units,
        "units_source": drawing.units_source,
        "layers": list(drawing.layers),
        "area_mm2": area,
        "regions": regions,
        "tools": [
            {"diameter_mm": size, "reachable_area_mm2": value, "share": value / area}
            for size, value in zip(sizes, reach, strict=True)
        ],
        "findings": [finding.to_dict() for finding in findings],
    }


def _region_entry(region: Region, axis: MedialAxis | None) -> dict[str, Any]:
    """A region in a survey; without an axis its disk and neck are not known."""
    disk = None if axis is None else axis.largest_disk()
    neck = None if axis is None else axis.narrowest_neck()
    return {
        "area_mm2": region.area,
        "perimeter_mm": region.perimeter,
        "holes": len(region.islands),
        "bounds": [float(value) for value in region.bounds()],
        "largest_disk": None if disk is None else _disk(disk),
        "narrowest_neck": None if neck is None else _disk(neck),
    }


def _disk(disk: tuple[FloatArray, float]) -> dict[str, float]:
    point, radius = disk
    return {"x": float(point[0]), "y": float(point[1]), "diameter": 2 * float(radius)}


@dataclass(frozen=True)
class AxisResult:
    """Medial axes of a drawing: `data` as ``mat --json`` writes it, and the walls for pictures."""

    data: dict[str, Any]
    walls: list[FloatArray]
    axes: tuple[MedialAxis, ...]

    def svg(self, title: str) -> str:
        """Picture of the axes."""
        from grassfire.preview import axis_svg

        return axis_svg(self.walls, self.data["regions"], title=title)

    def dxf(self) -> str:
        """Drawing of the axes, as `grassfire.write_medial_axis` writes it."""
        from grassfire.dxf import medial_axis_text

        return medial_axis_text(self.axes)


def mat(
    path: str | Path,
    layers: Sequence[str] = (),
    units: str | None = None,
    tolerance: float = MEDIAL,
    progress: Progress | None = None,
) -> AxisResult:
    """The medial axis transform of all regions of a drawing.

    Parameters
    ----------
    path, layers, units
        As for `inspect`.
    tolerance : float
        Accuracy, mm.

    Raises
    ------
    InputError, GeometryError
        If the drawing cannot be used or an axis cannot be certified.
    """
    from grassfire.dxf import read_regions

    if not 0 < tolerance < 1:
        raise InputError(f"tolerance {tolerance:g} mm is not between 0 and 1", remedy="try 1e-6")
    watch = Stopwatch(progress)
    with watch.stage("read"):
        drawing = read_regions(path, layers=layers, units=units)
    begin = time.perf_counter()
    with watch.stage("medial"):
        axes = tuple(axis_of(region, str(path), tolerance) for region in drawing.regions)
    seconds = time.perf_counter() - begin
    data = {
        "units": "mm",
        "tolerance": tolerance,
        "seconds": round(seconds, 6),
        "regions": [axis.to_dict() for axis in axes],
    }
    return AxisResult(data, walls_of(drawing.regions), axes)
