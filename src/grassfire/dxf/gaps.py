"""Contours with a gap: whether other contours can be machined although these are left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from grassfire.dxf.chain import Gap
from grassfire.errors import InputError
from grassfire.geometry import Region, flatten

NEARLY_CLOSED: Final = 0.1
"""A chain counts as a contour that was meant to be closed where its gap is at most this part of its
length. Marks that are open on purpose, three quarters of a circle for a thread, have wider ones."""


def refuse_doubtful(
    regions: Sequence[Region],
    gaps: Sequence[Gap],
    tolerance: float,
    chaining_tolerance: float,
    source: str,
) -> None:
    """Refuse a drawing in which a nearly closed chain goes round a region, or lies in one.

    What is inside such a contour would be taken for what is outside of it: an island for a pocket,
    or the other way round.

    Parameters
    ----------
    regions : sequence of Region
    gaps : sequence of Gap
    tolerance : float
        Chord error of the polygons that are compared, mm.
    chaining_tolerance : float
        Gap that would have been closed, mm.
    source : str
        File name for messages.

    Raises
    ------
    InputError
        There is such a chain.
    """
    import shapely

    nearly = [
        (gap, gap.outline)
        for gap in sorted(gaps, key=lambda item: item.size)
        if gap.outline is not None
        and gap.size <= NEARLY_CLOSED * shapely.LineString(gap.outline).length
    ]
    if not nearly:
        return
    material = shapely.union_all(
        [
            shapely.Polygon(
                flatten(region.outer, tolerance),
                [flatten(loop, tolerance) for loop in region.islands],
            )
            for region in regions
        ]
    )
    for gap, outline in nearly:
        inside = shapely.make_valid(shapely.Polygon(outline))
        doubt = 4.0 * tolerance * float(shapely.length(inside))
        if shapely.area(shapely.intersection(material, inside)) <= doubt:
            continue
        start, end = gap.start, gap.end
        raise InputError(
            f"a contour with a gap of {gap.size:.3g} mm, between ({start[0]:.6g}, {start[1]:.6g}) "
            f"and ({end[0]:.6g}, {end[1]:.6g}), goes round other contours or lies in one: without "
            "it islands and pockets change places",
            source=source,
            place=start,
            remedy=f"close it, raise chaining_tolerance (now {chaining_tolerance:g} mm), or leave "
            "it out by its layer",
        )
