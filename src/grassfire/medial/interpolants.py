"""Polynomial pieces of the axis before they are put in order."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from grassfire.medial.columns import Columns
from grassfire.medial.edges import Span
from grassfire.medial.sites import FloatArray, IntArray, largest


@dataclass(frozen=True)
class Interpolants(Columns):
    """Spans with their polynomials: degree, coefficients (k, 13, 3), or fewer columns, of which the
    first degree + 1 count, what the polynomials are off by, and contacts (k, 13) at the Chebyshev
    points."""

    span: Span
    degree: IntArray
    table: FloatArray
    error: FloatArray
    facing: FloatArray


def deviation_limit(
    first: FloatArray, last: FloatArray, goal: FloatArray, sharpness: FloatArray, degrees: IntArray
) -> FloatArray:
    """Deviations (n, d) up to which degrees are good enough.

    That is the goal, and what still lets the derivatives of a piece tell where its disks touch. A
    deviation d of a polynomial of length l turns its derivative by some 2 degree d / l
    (Bernstein). A turn a moves the recovered boundary by r (1 - k r) a^2 / 2, and by no more than
    r a: either within ten tolerances gives a.

    Parameters
    ----------
    first, last : (n, 3) float arrays
        Disks at the ends of pieces.
    goal, sharpness : (n,) float arrays
        What to aim at, mm, and the largest 1 - k r at the ends: 0 where derivatives do not matter.
    degrees : (d,) int array
    """
    length = largest(last - first)
    radius = np.maximum(np.maximum(first[:, 2], last[:, 2]), 1e-300)
    size = largest(first) + radius
    share = 10 * goal / radius
    with np.errstate(divide="ignore"):
        turn = np.maximum(np.sqrt(share / sharpness), share)
    steady = np.maximum((length * turn)[:, None] / (2 * degrees), 1e-13 * size[:, None])
    return np.asarray(np.minimum(goal[:, None], steady))


def cut_span(
    span: Span,
    low: FloatArray,
    high: FloatArray,
    inner: IntArray,
    disk: FloatArray,
    facing: FloatArray,
    count: int,
) -> Span:
    """Rows of the spans restricted to fractions [low, high]; the joints are the starts of `inner`.

    `count` is the number of the first joint.
    """
    before = inner - 1
    start, end = span.parameter(low[:, None])[:, 0], span.end.copy()
    end[before] = start[inner]
    width = span.angle_end - span.angle_start
    columns = {item.name: getattr(span, item.name).copy() for item in fields(span)}
    columns["start"], columns["end"] = start, end
    columns["angle_start"] = span.angle_start + width * low
    columns["angle_end"] = span.angle_start + width * high
    columns["facing_start"][inner] = columns["facing_end"][before] = facing
    columns["first"][inner] = columns["last"][before] = np.arange(count, count + len(inner))
    for name in ("first_disk", "far_first"):
        columns[name][inner] = disk
    for name in ("last_disk", "far_last"):
        columns[name][before] = disk
    return Span(**columns)
