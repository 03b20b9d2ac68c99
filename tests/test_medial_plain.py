"""Polygons: what lines and reflex corners have in closed form."""

from __future__ import annotations

from collections import Counter

import numpy as np

from grassfire.geometry import Loop, Region
from grassfire.medial import medial_axis
from grassfire.medial.edges import NODES
from grassfire.medial.sites import SiteKind
from grassfire.medial.triple import triple_disks


def ring(seed: int, corners: int) -> Region:
    """A polygon with needles, and a star in it."""
    draw = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(corners) / corners
    spoke = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outer = draw.uniform(20.0, 40.0, corners)[:, None] * spoke
    inner = draw.uniform(4.0, 15.0, corners)[::-1, None] * spoke[::-1]
    return Region(Loop.from_points(outer), (Loop.from_points(inner),))


def test_disks_of_three_lines_and_corners_are_found_from_afar() -> None:
    met: Counter[tuple[int, ...]] = Counter()
    for seed in range(4):
        axis = medial_axis(ring(seed, 40), 1e-8)
        sites, graph = axis.sites, axis.graph
        branch = np.flatnonzero(np.bincount(graph.first) == 3)
        rows = np.stack([np.flatnonzero(graph.first == vertex) for vertex in branch])
        triple = graph.site[rows]
        centre, radius = graph.vertex_centre[branch], graph.vertex_radius[branch]
        guess = centre + 0.2 * radius[:, None] * np.array([0.6, -0.8])
        disks = triple_disks(sites, triple, guess, radius, np.full(triple.shape, 0.5))
        assert disks.good.all()
        np.testing.assert_allclose(disks.centre, centre, atol=1e-9)
        np.testing.assert_allclose(disks.radius, radius, atol=1e-9)
        met.update(tuple(sorted(kinds)) for kinds in sites.kind[triple].tolist())
    line, point = SiteKind.LINE, SiteKind.POINT
    every = [(line,) * 3, (line, line, point), (line, point, point), (point,) * 3]
    assert min(met[kinds] for kinds in every) > 5


def test_pieces_before_lines_are_lines_and_parabolas() -> None:
    axis = medial_axis(ring(7, 60), 1e-8)
    sites, fit, span = axis.sites, axis.fit, axis.span
    one, other = sites.kind[span.site], sites.kind[span.partner]
    rows = np.flatnonzero(one == SiteKind.LINE)
    assert np.array_equal(fit.exact, one == SiteKind.LINE)
    assert np.array_equal(fit.degree[rows], np.where(other[rows] == SiteKind.LINE, 1, 2))
    for fraction in (0.2, 0.55, 0.9):
        disks = axis.disks(rows, np.full(len(rows), fraction))
        for site in (span.site[rows], span.partner[rows]):
            away = sites.project(site, disks[:, :2], np.full(len(rows), np.nan))[1]
            np.testing.assert_allclose(away, disks[:, 2], atol=1e-11)
    # The contacts that are kept are those of the disks.
    for column, fraction in enumerate(NODES):
        disks = axis.disks(rows, np.full(len(rows), fraction))
        foot = sites.point(span.partner[rows], fit.facing[rows, column])
        away = np.hypot(*(foot - disks[:, :2]).T)
        np.testing.assert_allclose(away, disks[:, 2], atol=1e-9)


def test_contacts_on_corners_follow_their_disks() -> None:
    axis = medial_axis(ring(3, 60), 1e-8)
    sites, fit, span = axis.sites, axis.fit, axis.span
    rows = np.flatnonzero(fit.exact & (sites.kind[span.partner] == SiteKind.POINT))
    assert len(rows) > 10
    for column, fraction in enumerate(NODES):
        disks = axis.disks(rows, np.full(len(rows), fraction))
        normal = sites.tangents(span.partner[rows], fit.facing[rows, column])[1]
        toward = disks[:, :2] - sites.anchor[span.partner[rows]]
        sine = normal[:, 0] * toward[:, 1] - normal[:, 1] * toward[:, 0]
        np.testing.assert_allclose(sine, 0.0, atol=1e-6)
