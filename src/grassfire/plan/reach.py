"""How much of a region a round tool reaches: the union of all disks of its size inside."""

from __future__ import annotations

from dataclasses import dataclass

from grassfire.geometry import Region, flatten


@dataclass(frozen=True)
class Reach:
    """Areas in mm^2.

    Attributes
    ----------
    area, reachable, unreachable : float
        Of the region; what disks of the radius cover; the rest.
    largest : float
        Area of the largest connected piece that is not reached.
    place : (x, y) or None
        In that piece, mm; None where it is too small to tell from rounding.
    """

    area: float
    reachable: float
    unreachable: float
    largest: float
    place: tuple[float, float] | None


def reach(region: Region, radius: float, tolerance: float = 1e-3) -> Reach:
    """Opening of a region by a disk.

    Parameters
    ----------
    region : Region
    radius : float
        Of the disk, mm.
    tolerance : float
        Chord error of the polygons that stand for region and disk, mm; areas are good to about
        this times the perimeter, and a neck too narrow by less than four times this counts as
        wide enough.
    """
    import math

    import shapely

    polygon = shapely.Polygon(
        flatten(region.outer, tolerance), [flatten(island, tolerance) for island in region.islands]
    ).buffer(0)
    quarter = max(8, math.ceil(math.pi / 4 / math.acos(max(0.0, 1 - tolerance / radius))))
    # a slot exactly as wide as the disk is narrower as a polygon, by a chord error on each side
    fitting = max(radius - 2 * tolerance, radius / 2)
    opened = polygon.buffer(-fitting, quad_segs=quarter).buffer(fitting, quad_segs=quarter)
    area = float(region.area)
    rest = shapely.get_parts(polygon.difference(opened))
    # what chord errors leave is thinner than four of them, and no piece
    pieces = [piece for piece in rest if not piece.buffer(-2 * tolerance).is_empty]
    unreachable = min(area, float(sum(piece.area for piece in pieces)))
    if not pieces:
        return Reach(area, area, 0.0, 0.0, None)
    largest = max(pieces, key=lambda piece: piece.area)
    point = largest.representative_point()
    return Reach(area, area - unreachable, unreachable, float(largest.area), (point.x, point.y))
