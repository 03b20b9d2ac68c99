"""Where the disks to two sites have equal radii: branch points by bracketing."""

from __future__ import annotations

import numpy as np

from grassfire.medial.contact import Tangents, contact
from grassfire.medial.nodes import Nodes
from grassfire.medial.sites import FloatArray, IntArray, Sites


def crossing(
    sites: Sites, nodes: Nodes, rows: IntArray, one: IntArray, other: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where the disks to two partners have equal radii between two nodes (Illinois method)."""
    site = nodes.site[rows]
    left, right = nodes.parameter[rows].copy(), nodes.parameter[rows + 1].copy()
    hint_one, hint_other = nodes.facing[rows].copy(), nodes.facing[rows + 1].copy()
    low = _difference(sites, site, left, one, other, hint_one, hint_other, nodes.radius[rows], 1)
    high = _difference(
        sites, site, right, one, other, hint_one, hint_other, nodes.radius[rows + 1], 2
    )
    value_left = np.minimum(low[0], 0.0)
    value_right = np.maximum(high[0], 0.0)
    weight_left, weight_right = value_left.copy(), value_right.copy()
    last = np.zeros(len(rows), dtype=np.int64)
    middle = 0.5 * (left + right)
    radius = np.full(len(rows), np.nan)
    facing = np.full(len(rows), np.nan)
    active = np.arange(len(rows))
    for step in range(80):
        with np.errstate(divide="ignore", invalid="ignore"):
            new = left[active] + (right - left)[active] * (
                weight_left[active] / (weight_left[active] - weight_right[active])
            )
        half = 0.5 * (left[active] + right[active])
        inside = (new > left[active]) & (new < right[active]) & (step % 4 != 3)
        new = np.where(inside, new, half)
        value, rho, where = _difference(
            sites,
            site[active], new, one[active], other[active],
            hint_one[active], hint_other[active], None, 0,
        )  # fmt: skip
        middle[active], radius[active], facing[active] = new, rho, where
        negative = value < 0
        left[active] = np.where(negative, new, left[active])
        right[active] = np.where(negative, right[active], new)
        # Illinois: halve the weight of an end that stays twice.
        stay_right = negative & (last[active] == 1)
        stay_left = ~negative & (last[active] == -1)
        weight_right[active] = np.where(stay_right, 0.5, 1.0) * weight_right[active]
        weight_left[active] = np.where(stay_left, 0.5, 1.0) * weight_left[active]
        weight_left[active] = np.where(negative, value, weight_left[active])
        weight_right[active] = np.where(negative, weight_right[active], value)
        last[active] = np.where(negative, 1, -1)
        width = right[active] - left[active]
        done = (width <= 4e-15 * (1 + np.abs(new))) | (np.abs(value) <= 1e-15)
        active = active[~done]
        if not len(active):
            break
    # Equal radii are not met where both partners vanish: the middle tells most.
    lost = ~np.isfinite(radius)
    start, end = nodes.parameter[rows], nodes.parameter[rows + 1]
    middle[lost] = 0.5 * (start + end)[lost]
    radius[lost] = np.nan
    return middle, radius, facing


def _difference(
    sites: Sites,
    site: IntArray,
    parameter: FloatArray,
    one: IntArray,
    other: IntArray,
    hint_one: FloatArray,
    hint_other: FloatArray,
    known: FloatArray | None,
    side: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(r1 - r2) / (r1 + r2), the smaller radius and the contact on the first partner.

    At a node the radius to its own partner is known (`side` 1 or 2) and used, since at ends
    (A) is 0 / 0.
    """
    position, normal = sites.tangents(site, parameter)
    tangents = Tangents(position, normal, site, parameter)
    where, first = contact(sites, tangents, one, hint_one)
    _, second = contact(sites, tangents, other, hint_other)
    if known is not None:
        first = known if side == 1 else first
        second = known if side == 2 else second
    with np.errstate(invalid="ignore"):
        value = (first - second) / (first + second)
    value = np.where(np.isinf(first) & np.isfinite(second), 1.0, value)
    value = np.where(np.isfinite(first) & np.isinf(second), -1.0, value)
    value = np.where(np.isnan(value), 0.0, value)
    return value, np.minimum(first, second), where
