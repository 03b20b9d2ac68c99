"""Heights of the passes."""

from __future__ import annotations

import math

import numpy as np

from grassfire.errors import PlanningError
from grassfire.toolpath import FloatArray

MOST_PASSES = 10_000
"""More are taken for a mistake of units."""


def pass_floors(top: float, depth: float, stepdown: float, axial_allowance: float) -> FloatArray:
    """Heights of the floors of all passes, equally spaced, the last at the full depth.

    Parameters
    ----------
    top : float
        Height of the top of the stock, mm.
    depth : float
        Depth of the pocket below it, mm.
    stepdown : float
        Most that one pass may take, mm.
    axial_allowance : float
        What stays on the floor, mm.

    Returns
    -------
    (n,) float array
        Descending heights, mm; n = ceil((depth - axial_allowance) / stepdown).

    Raises
    ------
    PlanningError
        If nothing is left to cut, or that takes more than `MOST_PASSES`.
    """
    cut = depth - axial_allowance
    if cut <= 0 or stepdown <= 0:
        raise PlanningError(
            f"a depth of {depth:g} mm less {axial_allowance:g} mm allowance in steps of "
            f"{stepdown:g} mm leaves nothing to cut",
            remedy="make depth larger than axial_allowance and stepdown positive",
        )
    # a stepdown that divides the depth but for rounding must not give one pass more
    count = max(1, math.ceil(cut / stepdown - 1e-9))
    if count > MOST_PASSES:
        raise PlanningError(
            f"a depth of {cut:g} mm in steps of {stepdown:g} mm takes {count:.4g} passes",
            remedy=f"make stepdown larger: at most {MOST_PASSES} passes are planned",
        )
    return np.asarray(top - cut * np.arange(1, count + 1) / count)
