"""Medial axes of random regions of every kind that the benchmarks draw, against brute force."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))

from judge import probe_seed
from oracle import Boundary, ClaimedAxis, bisector_error
from region_kinds import KINDS, region, simple

from grassfire.geometry import Bezier, EllipticalArc, Line, Loop, Region
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


def test_a_curve_cut_beside_its_extremum_is_certified() -> None:
    """Of the Beziers of this spline one has an extremum 0.2 micrometres from its end."""
    given = region("spline", 47)
    beziers = tuple(part for curve in given.curves for part in curve.to_beziers())
    axis = medial_axis(Region(Loop(beziers)), 5e-10)
    assert axis.certificate.max_disk_error <= 5e-10


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


@pytest.mark.parametrize("short", [1e-2, 1e-3, 1e-4])
def test_brute_force_tells_feet_that_are_close_together(short: float) -> None:
    """On an ellipse the feet of disks close to an end are mirrored, closer than its samples."""
    major, minor = 30.0, 18.0
    arc = EllipticalArc(np.zeros(2), np.array([major, 0.0]), np.array([0.0, minor]), 0.0, 2 * np.pi)
    focal = major**2 - minor**2
    x = focal / major * (1 - short)
    disk = np.array([[x, 0.0, minor * np.sqrt(1 - x**2 / focal)]])
    error, separation = bisector_error(Boundary.of(Region(Loop((arc,)))), disk)
    # The foot of the disk about (x, 0) lies at a^2 x / (a^2 - b^2).
    foot = major**2 * x / focal
    apart = 2 * minor * np.sqrt(1 - (foot / major) ** 2) / disk[0, 2]
    assert error[0] <= 1e-10
    np.testing.assert_allclose(separation, apart, rtol=1e-3)


def test_an_outline_that_crosses_itself_beside_a_narrow_corner_is_not_simple() -> None:
    """The side of a wedge of 0.4 degrees bulges over the other, by 30 nanometres."""
    half = np.radians(0.2)
    far = 50.0 * np.array([(np.cos(half), -np.sin(half)), (np.cos(half), np.sin(half))])
    tip = np.zeros(2)
    sides = (Line(tip, far[0]), Line(far[0], far[1]))
    legs = (0.5 * far[1], np.array([0.02, -0.02 * np.tan(half) - 1e-4]))
    assert simple(Region(Loop((*sides, Line(far[1], tip)))))
    assert not simple(Region(Loop((*sides, Bezier(np.array([far[1], *legs, tip]))))))


def test_probes_of_the_judge_stay_where_it_can_measure() -> None:
    """In a wedge of two degrees, of chords of 0.01: the other wall is among what the judge leaves
    out, three chords about a probe, less than 0.9 from the tip."""
    half, chord = np.radians(1.0), 0.01
    corners = 3.0 * np.array([(0, 0), (np.cos(half), -np.sin(half)), (np.cos(half), np.sin(half))])
    points = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        share = np.arange(np.ceil(np.hypot(*(end - start)) / chord))[:, None]
        points.append(start + (end - start) * share / len(share))
    ring = np.concatenate(points)
    pairs = zip(ring.tolist(), np.roll(ring, -1, axis=0).tolist(), strict=True)
    loop = [("L", (a[0], a[1]), (b[0], b[1])) for a, b in pairs]
    seed = probe_seed([loop], 3, 1e-6)
    draw = np.random.default_rng(seed)
    length = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    chosen = draw.choice(len(ring), 3, p=length / length.sum())
    assert np.hypot(*ring[chosen].T).min() > 3 * chord / np.tan(2 * half)
    with pytest.raises(ValueError, match="cannot measure"):
        probe_seed([loop], 60, 1e-6)
