"""Contacts of disks with single sites: stationary, least, and exact where they run together."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from grassfire.geometry import Arc, Bezier, EllipticalArc, Line, Loop, Region
from grassfire.medial import medial_axis
from grassfire.medial.build import build_sites
from grassfire.medial.contact import Tangents, contact
from grassfire.medial.sites import SiteKind, Sites
from grassfire.medial.triple import triple_disks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def bean() -> Region:
    """Two cubic Beziers with corners between them."""
    below = Bezier(np.array([(0.0, 0.0), (10.0, -14.0), (30.0, -9.0), (40.0, 0.0)]))
    above = Bezier(np.array([(40.0, 0.0), (34.0, 12.0), (8.0, 16.0), (0.0, 0.0)]))
    return Region(Loop((below, above)))


def ellipse() -> Region:
    """Rational pieces."""
    return Region(Loop((EllipticalArc((1, 2), (30, 0), (0, 18), 0.0, 2 * np.pi),)))


REGIONS = {"polynomial": bean, "rational": ellipse}


def tangents_of(sites: Sites, site: IntArray, parameter: FloatArray) -> Tangents:
    position, normal = sites.tangents(site, parameter)
    return Tangents(position, normal, site, parameter)


def pairs(sites: Sites, seed: int) -> tuple[Tangents, IntArray]:
    """Points on all sites, each with each other site as the target."""
    draw = np.random.default_rng(seed)
    count = len(sites)
    site, target = (part.ravel() for part in np.meshgrid(np.arange(count), np.arange(count)))
    keep = np.repeat(np.flatnonzero(site != target), 12)
    site, target = site[keep], target[keep]
    share = draw.uniform(0.02, 0.98, len(site))
    return tangents_of(
        sites, site, sites.low[site] + share * (sites.high - sites.low)[site]
    ), target


ARCH = Bezier(np.array([(10.0, 0.0), (0.0, 20.0), (-10.0, 0.0)]))
"""A parabola: its curvature is largest in the middle."""


def arch(cuts: list[float], kink: float = 0.0) -> Sites:
    """Sites of the arch over a line, as several curves that meet in kinks of so many radians."""
    bounds = [0.0, *cuts, 1.0]
    parts = []
    for low, high in itertools.pairwise(bounds):
        points = ARCH.subcurve(low, high).control_points.copy()
        if low > 0:
            leg = points[1] - points[0]
            points[1] += kink * np.array([-leg[1], leg[0]])
        parts.append(Bezier(points))
    return build_sites(Region(Loop((Line((-10.0, 0.0), (10.0, 0.0)), *parts))))[0]


@pytest.mark.parametrize(
    ("cut", "kink", "least"),
    [(0.5, 0.0, 1e-5), (0.5, 5e-13, 1e-4), (0.5, -5e-13, 1e-4), (0.500002, 0.0, 1e-4)],
)
def test_contacts_across_a_cut_are_those_of_the_whole_curve(
    cut: float, kink: float, least: float
) -> None:
    """Even where rounding gives it a kink, or leaves a sliver between it and an extremum."""
    whole, parts = arch([]), arch([cut], kink)
    assert len(whole) == 3
    assert len(parts) == (3 if cut == 0.5 else 4)
    away = np.geomspace(least, 0.4, 60)
    first, last = np.ones(60, dtype=np.int64), np.full(60, len(parts) - 1)
    none = np.full(60, np.nan)
    _, radius = contact(whole, tangents_of(whole, first, 0.5 - away), first + 1, none)
    _, same = contact(parts, tangents_of(parts, first, (0.5 - away) / cut), last, none)
    np.testing.assert_allclose(same, radius, rtol=2e-11)
    ahead = (0.5 + away - cut) / (1 - cut)
    _, back = contact(parts, tangents_of(parts, last, ahead), first, none)
    np.testing.assert_allclose(back, radius, rtol=2e-11)


def test_disks_of_three_sites_are_found_again_from_nearby() -> None:
    axis = medial_axis(Region(Loop(bean().outer.curves), (circle(),)), 1e-9)
    sites, graph = axis.sites, axis.graph
    branch = np.flatnonzero(np.bincount(graph.first) == 3)
    assert len(branch) == 2
    for vertex in branch:
        rows = np.flatnonzero(graph.first == vertex)
        triple, at = graph.site[rows][None], graph.start[rows][None]
        span = (sites.high - sites.low)[triple]
        guess = np.clip(at + 0.05 * span, sites.low[triple], sites.high[triple])
        centre, radius = graph.vertex_centre[[vertex]], graph.vertex_radius[[vertex]]
        disks = triple_disks(sites, triple, centre + 0.3, 1.1 * radius, guess)
        assert disks.good.all()
        np.testing.assert_allclose(disks.centre, centre, atol=1e-10)
        np.testing.assert_allclose(disks.radius, radius, atol=1e-10)
        np.testing.assert_allclose(disks.parameter, at, atol=1e-9)


def circle() -> Loop:
    """An island of the bean."""
    return Loop((Arc((18.0, -1.0), 2.5),))


@pytest.mark.parametrize("name", sorted(REGIONS))
@pytest.mark.parametrize("hinted", [False, True])
def test_disks_touch_where_they_say_and_hold_nothing_beside(name: str, hinted: bool) -> None:
    sites, _ = build_sites(REGIONS[name]())
    tangents, target = pairs(sites, 3)
    span = (sites.high - sites.low)[target]
    hint = 0.5 * (sites.low + sites.high)[target] if hinted else np.full(len(target), np.nan)
    where, radius = contact(sites, tangents, target, hint)
    rows = np.flatnonzero(np.isfinite(radius))
    assert len(rows) > 0.5 * len(target)
    target, where, radius, span = target[rows], where[rows], radius[rows], span[rows]
    centre = tangents.position[rows] + radius[:, None] * tangents.normal[rows]
    foot = sites.point(target, where) - centre
    np.testing.assert_allclose(np.hypot(*foot.T), radius, rtol=1e-12)
    for shift in (-1e-2, -1e-3, -1e-4, 1e-4, 1e-3, 1e-2):
        near = np.clip(where + shift * span, sites.low[target], sites.high[target])
        away = sites.point(target, near) - centre
        assert np.all(np.hypot(*away.T) >= radius * (1 - 1e-12))


@pytest.mark.parametrize("name", sorted(REGIONS))
def test_hints_beside_a_contact_lead_to_it(name: str) -> None:
    sites, _ = build_sites(REGIONS[name]())
    tangents, target = pairs(sites, 5)
    where, radius = contact(sites, tangents, target, np.full(len(target), np.nan))
    low, span = sites.low[target], (sites.high - sites.low)[target]
    inside = np.abs((where - low) / span - 0.5) < 0.45
    rows = np.flatnonzero(np.isfinite(radius) & inside)
    assert len(rows) > 20
    for shift in (-1e-3, 1e-6, 1e-3):
        hint = where[rows] + shift * span[rows]
        again, same = contact(sites, tangents.take(rows), target[rows], hint)
        np.testing.assert_allclose(same, radius[rows], rtol=1e-12)
        np.testing.assert_allclose(again, where[rows], rtol=0, atol=1e-8)


def test_contacts_beside_a_vertex_of_an_ellipse_are_mirrored() -> None:
    """The disk at the angle a has the radius b sqrt(1 - x^2 / (a^2 - b^2)), however near."""
    major, minor = 30.0, 18.0
    sites, _ = build_sites(ellipse())
    spirals = np.flatnonzero(sites.kind == SiteKind.SPIRAL)
    ends = sites.point(spirals, sites.high[spirals]) + sites.origin
    vertex = np.flatnonzero(np.abs(ends[:, 1] - 2.0) < 1e-9)
    assert len(vertex) == 2
    for step in (1e-1, 1e-2, 1e-3, 1e-4):
        site = spirals[vertex]
        near = sites.high[site] - step * (sites.high - sites.low)[site]
        tangents = tangents_of(sites, site, near)
        _, radius = contact(sites, tangents, sites.following[site], np.full(len(site), np.nan))
        x = (tangents.position + sites.origin)[:, 0] - 1.0
        exact = minor * np.sqrt(1 - (1 - (minor / major) ** 2) * (x / major) ** 2)
        np.testing.assert_allclose(radius, exact, rtol=1e-11)


def test_disks_between_arcs_that_all_but_continue_each_other_are_smooth() -> None:
    """Next to a turn of 1e-4 the radius grows evenly with the distance from the corner."""
    turn = 1e-4
    first = Arc((0.0, 0.0), 50.0, -0.5 * np.pi, 0.5 * np.pi)
    corner = np.array([50.0, 0.0])
    # From the corner on along a circle of radius 40 whose tangent is turned to the left.
    normal = np.array([-np.cos(turn), -np.sin(turn)])
    centre = corner + 40.0 * normal
    second = Arc(centre, 40.0, turn, np.pi - turn)
    back = Bezier(np.array([second.end, (-40.0, -10.0), (-20.0, -60.0), first.start]))
    sites, _ = build_sites(Region(Loop((first, second, back))), 1e-6)
    site = np.zeros(400, dtype=np.int64)
    tangents = tangents_of(sites, site, 1.0 - 1e-5 * np.linspace(0.2, 1.0, len(site)))
    _, radius = contact(sites, tangents, site + 1, np.full(len(site), np.nan))
    assert np.all(np.diff(radius) > 0)
    bend = np.diff(radius, 3)
    assert np.abs(bend).max() <= 1e-8 * radius.max()
