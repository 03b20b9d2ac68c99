"""Medial axes of random regions of every kind that the benchmarks draw, against brute force."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))

from oracle import Boundary, ClaimedAxis
from region_kinds import KINDS, region, simple

from grassfire.geometry import EllipticalArc, Loop, Region
from grassfire.medial import medial_axis

TOL = 1e-6


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_random_region_is_certified_and_right(kind: str, seed: int) -> None:
    given = region(kind, seed)
    axis = medial_axis(given, TOL)
    assert axis.certificate.euler
    assert axis.certificate.max_disk_error <= TOL
    boundary = Boundary.of(given, samples=12)
    # Coordinates near 1e6 are themselves rounded to 1e-10, and far more is lost in squares.
    slack = TOL + 1e-12 * np.abs(given.bounds()).max()
    some = np.linspace(0, len(axis.vertex_radius) - 1, 40).astype(int)
    distance = boundary.distance(axis.vertex_point[some])
    np.testing.assert_allclose(distance, axis.vertex_radius[some], rtol=0, atol=slack)


@pytest.mark.parametrize("kind", ["spline", "spline-islands", "blob", "quadratics"])
def test_nothing_is_missing(kind: str) -> None:
    given = region(kind, 3)
    axis = medial_axis(given, TOL)
    edges = [np.column_stack([edge.control_points, edge.radius]) for edge in axis.edges]
    claimed = ClaimedAxis(edges, np.column_stack([axis.vertex_point, axis.vertex_radius]))
    boundary = Boundary.of(given)
    draw = np.random.default_rng(5)
    places = draw.integers(0, len(boundary.power), 60), draw.uniform(size=60)
    # Contacts at a small angle see an error of a disk several times as large along the axis.
    assert claimed.distance(boundary.disks(*places).table).max() <= 10 * TOL


@pytest.mark.parametrize(
    ("kind", "seed", "tol"),
    # Arcs that meet all but tangentially; an axis as far from both its sides as its centre is.
    [("bulged", 2026, 1e-6), ("spline", 31, 3e-10)],
)
def test_a_region_that_used_to_be_refused(kind: str, seed: int, tol: float) -> None:
    given = region(kind, seed)
    axis = medial_axis(given, tol)
    assert axis.certificate.max_disk_error <= tol
    distance = Boundary.of(given, samples=12).distance(axis.vertex_point)
    np.testing.assert_allclose(distance, axis.vertex_radius, rtol=0, atol=tol + 1e-10)


@pytest.mark.parametrize("kind", ["tangle", "pocket", "many-islands", "near-duplicate"])
def test_a_seed_repeats_its_region(kind: str) -> None:
    first, second = region(kind, 4), region(kind, 4)
    assert simple(first)
    assert len(first.curves) == len(second.curves)
    for one, other in zip(first.curves, second.curves, strict=True):
        np.testing.assert_array_equal(one.point([0.0, 0.3, 1.0]), other.point([0.0, 0.3, 1.0]))


def test_brute_force_knows_the_ellipse() -> None:
    """Half-axes a > b: |x| <= (a^2 - b^2) / a with r = b sqrt(1 - x^2 / (a^2 - b^2))."""
    major, minor = 30.0, 18.0
    arc = EllipticalArc(np.zeros(2), np.array([major, 0.0]), np.array([0.0, minor]), 0.0, 2 * np.pi)
    boundary = Boundary.of(Region(Loop((arc,))))
    piece = np.repeat(np.arange(len(boundary.power)), 10)
    disks = boundary.disks(piece, np.tile(np.linspace(0.05, 0.95, 10), len(boundary.power)))
    far = disks.reach > 0.1 * disks.radius
    x, y = disks.centre[far].T
    focal = major**2 - minor**2
    np.testing.assert_allclose(y, 0.0, atol=1e-9)
    np.testing.assert_allclose(disks.radius[far], minor * np.sqrt(1 - x**2 / focal), atol=1e-9)
