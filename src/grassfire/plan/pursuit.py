"""Cuts of constant engagement along a front: the way of the tool centre in closed form.

A tool of radius R moves with stock on its right. The stock's edge (the *front*) is a curve with
the stock on its right as well. The tool's rim meets the front ahead at the point f; the rim from
the right of the tool round to f is in the stock, and the angle of that arc is the engagement. With
bearing alpha of f seen from the centre c and heading h of the travel

    c = f - R e(alpha),     h = alpha + psi,     psi = pi / 2 - engagement,

where e is the unit vector of an angle. Let f run along the front with arc length s and direction
tau(s). That c moves in direction h means, resolved along e(alpha) and across it,

    v cos(psi) = cos(tau - alpha),     R alpha' = sin(tau - alpha) - tan(psi) cos(tau - alpha),

    alpha' = sin(tau - alpha - psi) / (R cos(psi)).                                          (1)

Along a straight piece of the front theta = alpha - tau + psi obeys theta' = -sin(theta) / k with
k = R cos(psi), so tan(theta / 2) falls as exp(-s / k). At a vertex that turns by delta, theta falls
by delta. Both are linear in (sin(theta / 2), cos(theta / 2)), so the way along a front of n pieces
is a product of n matrices of 2 x 2, and all partial products come from log2(n) array operations.
The way tends to the equilibrium exponentially with length k: wherever the tool starts, it soon cuts
with the thickness R (1 - cos(engagement)) on a straight front, less on a hollow one.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from grassfire.toolpath import FloatArray

Angle = TypeVar("Angle", float, FloatArray)


class Pursuit(NamedTuple):
    """Way of the tool centre while its rim follows a front; one row a front point.

    Attributes
    ----------
    centre : (n, 2) float array
        mm.
    bearing : (n,) float array
        Direction from the centre to the front point, radians.
    heading : (n,) float array
        Direction of travel, radians.
    advance : (n,) float array
        cos(tau - alpha): negative where the tool would have to go back.
    """

    centre: FloatArray
    bearing: FloatArray
    heading: FloatArray
    advance: FloatArray


def unit(angle: FloatArray | float) -> FloatArray:
    """(..., 2) unit vectors of angles in radians."""
    result = np.empty((*np.shape(angle), 2))
    result[..., 0], result[..., 1] = np.cos(angle), np.sin(angle)
    return result


def wrapped(angle: Angle) -> Angle:
    """Angles, or one, brought to [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def pursue(front: FloatArray, bearing: float, radius: float, engagement: FloatArray) -> Pursuit:
    """Follow a front with given engagement: the exact solution of (1) for a polygonal front.

    Parameters
    ----------
    front : (n, 2) float array
        Stock on the right of its direction, mm; no two neighbours equal.
    bearing : float
        Direction from the tool centre to the first point, radians.
    radius : float
        Of the tool, mm.
    engagement : (n - 1,) float array
        On each piece of the front, radians, in (0, pi).
    """
    step = front[1:] - front[:-1]
    tau = np.arctan2(step[:, 1], step[:, 0])
    bend = tau[1:] - tau[:-1]
    if (np.abs(bend) >= np.pi).any():
        tau = np.unwrap(tau)
        bend = tau[1:] - tau[:-1]
    psi = np.pi / 2 - engagement
    decay = np.exp(-np.hypot(step[:, 0], step[:, 1]) / (radius * np.sin(engagement)))
    turn = np.zeros(len(tau))
    turn[:-1] = bend - (psi[1:] - psi[:-1])
    one, two, three, four = _partial_products(decay, turn / 2)
    half = (bearing - tau[0] + psi[0]) / 2
    sine, cosine = np.sin(half), np.cos(half)
    end = np.arctan2(one * sine + two * cosine, three * sine + four * cosine)
    alpha, heading, advance = np.full((3, len(front)), bearing)
    alpha[1:] = wrapped(2 * end + turn) + tau - psi
    heading[0] += psi[0]
    heading[1:] = alpha[1:] + psi
    advance[0] -= tau[0]
    advance[1:] = alpha[1:] - tau
    return Pursuit(front - radius * unit(alpha), alpha, heading, np.cos(advance))


def _partial_products(
    decay: FloatArray, half_turn: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Entries a, b, c, d of M_i ... M_0 for all i, up to a factor; M = rotation * diag(decay, 1).

    By doubling: after k rounds row i holds the product of the last 2^k factors.
    """
    cos, sin = np.cos(half_turn), np.sin(half_turn)
    entries = np.empty((2, 2, len(decay)))
    entries[0, 0], entries[0, 1] = cos * decay, -sin
    entries[1, 0], entries[1, 1] = sin * decay, cos
    reach = 1
    while reach < len(decay):
        first, last = entries[:, :, :-reach], entries[:, :, reach:]
        product = last[:, :1] * first[0]
        product += last[:, 1:] * first[1]
        # only ratios count; without this they vanish on long fronts
        product /= np.abs(product).reshape(4, -1).max(axis=0)
        last[...] = product
        reach *= 2
    return entries[0, 0], entries[0, 1], entries[1, 0], entries[1, 1]
