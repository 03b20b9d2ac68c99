"""What verification is asked and what it answers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grassfire.errors import InputError
from grassfire.report import OperationFigures

if TYPE_CHECKING:
    from shapely.geometry import MultiPolygon, Polygon

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Target:
    """What one operation has to make: the pocket, its floor, and how the tool may get there.

    Attributes
    ----------
    operation : int
        Index of the operation in the job, from 0; several targets may share one.
    region : shapely Polygon or MultiPolygon
        Drawn walls, mm; curves flattened to well below the gouge tolerance.
    depth : float
        Floor below `stock_top`, mm, > 0.
    tool_radius : float
        Radius of the (flat) tool, mm, > 0.
    radial_allowance, axial_allowance : float
        Stock to leave on walls and floor, mm.
    stock_top : float
        z of the stock's top, mm.
    entry : str
        "helix", "ramp" or "plunge"; only the last allows vertical feed moves through stock.
    stepdown : float, optional
        Largest thickness that a horizontal cutting move may take, mm; not judged when None.
    engagement_limit : float, optional
        Largest engagement angle, degrees; not judged when None.
    max_feed : float, optional
        Largest feed of a move below the stock's top, mm/min; not judged when None.
    cutting_feed : float, optional
        Largest feed of a move through stock, mm/min; not judged when None.
    tool_number : int, optional
        The tool that the program has to have loaded; not judged when None.
    flute_length : float, optional
        From the tip to the shank, mm; the shank is not judged when None.
    shank_radius : float, optional
        mm; as the cutter when None.
    stickout : float, optional
        From the tip to the holder, mm; the holder is not judged when None.
    holder_radius : float, optional
        mm; has to be given with `stickout`.
    """

    operation: int
    region: Polygon | MultiPolygon
    depth: float
    tool_radius: float
    radial_allowance: float = 0.0
    axial_allowance: float = 0.0
    stock_top: float = 0.0
    entry: str = "helix"
    stepdown: float | None = None
    engagement_limit: float | None = None
    max_feed: float | None = None
    cutting_feed: float | None = None
    tool_number: int | None = None
    flute_length: float | None = None
    shank_radius: float | None = None
    stickout: float | None = None
    holder_radius: float | None = None

    def __post_init__(self) -> None:
        place = f"target of operation {self.operation}"
        if not self.depth > 0:
            raise InputError(f"depth {self.depth:g} mm is not positive", place=place)
        if not self.tool_radius > 0:
            raise InputError(f"tool radius {self.tool_radius:g} mm is not positive", place=place)
        if self.region.is_empty:
            raise InputError("the region is empty", place=place)
        for name in ("flute_length", "shank_radius", "stickout", "holder_radius"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(f"{name} {value:g} mm is not positive", place=place)
        if (self.stickout is None) != (self.holder_radius is None):
            raise InputError("stickout and holder_radius go together", place=place)

    @property
    def floor(self) -> float:
        """z of the drawn floor, mm."""
        return self.stock_top - self.depth

    def body(self, kind: str) -> tuple[float | None, float | None]:
        """Return (height above the tip, radius) of the "shank" or the "holder", mm."""
        if kind == "holder":
            return self.stickout, self.holder_radius
        radius = self.tool_radius if self.shank_radius is None else self.shank_radius
        return self.flute_length, radius


@dataclass(frozen=True)
class MachineLimits:
    """What the machine allows; nothing is judged that is None.

    Attributes
    ----------
    travel : three pairs of float, optional
        Least and greatest x, y and z in the coordinates of the program, mm.
    rapid_height : float, optional
        Height above the stock's top below which rapids do not travel sideways, mm.
    """

    travel: tuple[tuple[float, float], ...] | None = None
    rapid_height: float | None = None

    def __post_init__(self) -> None:
        if self.travel is not None and (
            len(self.travel) != 3 or any(not low < high for low, high in self.travel)
        ):
            raise InputError(
                f"travel {self.travel} is not three pairs of a lower and a higher coordinate"
            )


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """How far a good program may be off, and how finely that is looked at.

    Attributes
    ----------
    gouge : float
        How far the tool may reach beyond a wall, mm.
    height : float
        Thinner stock under a rapid or plunge does not count, mm.
    uncut_height : float
        Stock standing higher above the floor counts as uncut, mm.
    uncut_fraction, uncut_patch : float
        Uncut part of the reachable area, and largest connected patch in mm2, that are let pass.
    ramp_angle : float
        Feed moves that descend through stock more steeply are plunges, radians: what jobs may
        ask for, and a little for the chords of helices.
    engagement : float
        By how much a target's engagement limit may be exceeded, degrees.
    engagement_thickness : float, optional
        Thinner stock does not count as engaged, mm; by default 0.3 of the stepdown (of the target,
        or as the levels show it), which leaves out the wedge under a helix or ramp.
    resolution : float, optional
        Cell size, mm; by default a fortieth of the smallest tool's radius, up to a twenty-fourth on
        large pockets.
    max_cells : int
        The cell is enlarged where the map would have more.
    """

    gouge: float = 0.005
    height: float = 0.02
    uncut_height: float = 0.02
    uncut_fraction: float = 0.001
    uncut_patch: float = 0.5
    ramp_angle: float = math.radians(31.0)
    engagement: float = 6.0
    engagement_thickness: float | None = None
    resolution: float | None = None
    max_cells: int = 16_000_000


@dataclass(frozen=True)
class Fault:
    """One way in which the program does harm or falls short, with its place.

    Attributes
    ----------
    kind : str
        Stable name: "gouge", "allowance", "floor", "axial-allowance", "uncut", "rapid-in-stock",
        "rapid-low", "fast-cut", "plunge", "stepdown", "engagement", "unknown-start", "spindle-off",
        "no-feed", "feed", "wrong-tool", "nothing-cut", "arc-radius", "ends-in-stock", "travel",
        "rapid-height", "shank", "holder".
    line : int
        Line of the program text, from 1; 0 where no line is to blame.
    place : tuple of float
        (x, y, z) in mm; NaN where a coordinate is unknown.
    size : float
        What was measured there, in the unit that the message names.
    message : str
        One sentence for people.
    operation : int
        Index of the operation, -1 for the whole program.
    """

    kind: str
    line: int
    place: tuple[float, float, float]
    size: float
    message: str
    operation: int = -1

    def to_dict(self) -> dict[str, object]:
        """Return the fault as JSON-ready data with a fixed key order."""
        return {
            "kind": self.kind,
            "operation": self.operation,
            "line": self.line,
            "place": [value if np.isfinite(value) else None for value in self.place],
            "size": self.size if np.isfinite(self.size) else None,
            "message": self.message,
        }

    def __str__(self) -> str:
        known = ", ".join("?" if np.isnan(value) else f"{value:.3f}" for value in self.place)
        where = f"line {self.line} " if self.line else ""
        return f"{where}at ({known}): {self.kind}: {self.message}"


@dataclass(frozen=True, kw_only=True)
class OperationResult:
    """Figures of one operation as the program text makes it; lengths mm, areas mm2.

    `max_engagement_deg`, `mean_engagement_deg` and `p99_engagement_deg` are over the length of
    feed moves that do not descend and touch stock. `reachable_area_mm2` is what the tool can clear
    with the radial allowance left standing, `unreachable_area_mm2` what it cannot clear even
    without one.
    """

    operation: int
    moves: int
    lines: int
    arcs: int
    cut_length_mm: float
    rapid_length_mm: float
    time_s: float
    reachable_area_mm2: float
    uncut_area_mm2: float
    unreachable_area_mm2: float
    max_gouge_mm: float
    max_engagement_deg: float
    mean_engagement_deg: float
    p99_engagement_deg: float
    rapids_in_stock: int
    retracts: int

    def figures(self, strategy: str, tool: int, name: str = "") -> OperationFigures:
        """Return the report's figures of this operation."""
        return OperationFigures(
            strategy=strategy,
            tool=tool,
            name=name,
            moves=self.moves,
            lines=self.lines,
            arcs=self.arcs,
            cut_length_mm=self.cut_length_mm,
            rapid_length_mm=self.rapid_length_mm,
            time_s=self.time_s,
            reachable_area_mm2=self.reachable_area_mm2,
            unreachable_area_mm2=self.unreachable_area_mm2,
            uncut_area_mm2=self.uncut_area_mm2,
            max_gouge_mm=self.max_gouge_mm,
            max_engagement_deg=self.max_engagement_deg,
            mean_engagement_deg=self.mean_engagement_deg,
            rapids_in_stock=self.rapids_in_stock,
            retracts=self.retracts,
        )


@dataclass(frozen=True)
class HeightMap:
    """Stock after machining: `height[row, column]` (mm) at the centres of square cells.

    The centre of cell (0, 0) is at `origin` + `resolution` / 2 in x and y. Cells outside the drawn
    regions keep the stock's top: what is cut there is a gouge, which is measured exactly instead.
    """

    origin: tuple[float, float]
    resolution: float
    height: FloatArray


@dataclass(frozen=True)
class Verification:
    """The judgement on a program.

    Attributes
    ----------
    operations : tuple of OperationResult
        One for each operation that has a target, ascending.
    faults : tuple of Fault
        For each kind and operation the first place, then the worst where it is another one.
    resolution : float
        Cell size of the maps behind uncut area, rapids and engagement, mm. Gouge and floor are
        exact.
    height_map : HeightMap
    time_s : float
        Machining time of the whole program, s.
    """

    operations: tuple[OperationResult, ...]
    faults: tuple[Fault, ...]
    resolution: float
    height_map: HeightMap
    time_s: float

    @property
    def ok(self) -> bool:
        """Whether nothing was found against the program."""
        return not self.faults
