"""Drilling cycles as the moves that they stand for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

PECK_CLEARANCE: Final = 0.254
"""Distance above the last depth at which a peck starts to feed again, mm (LinuxCNC's G73, G83)."""


def hole(
    cycle: str, clear: float, bottom: float, peck: float, retract: float
) -> Iterator[tuple[bool, float]]:
    """Heights of the moves in one hole from the height `clear` on: (whether it feeds, z) each.

    Parameters
    ----------
    cycle : str
        "73" (chips are broken), "81" and "82" (one stroke), "83" (each peck retracts), "85" and
        "89" (feeds out again), "86" (as "81", the spindle stops at the bottom).
    clear, bottom, retract : float
        Heights where feeding begins, of the bottom and of the end, mm.
    peck : float
        Depth of each peck, mm; used by "73" and "83".
    """
    depth = clear
    while cycle in ("73", "83") and depth - peck > bottom:
        if depth < clear:
            yield False, depth + PECK_CLEARANCE
        depth -= peck
        yield True, depth
        if cycle == "83":
            yield False, clear
    if depth < clear:
        yield False, min(clear, depth + PECK_CLEARANCE)
    yield True, bottom
    if cycle in ("85", "89"):
        yield True, clear
    yield False, retract
