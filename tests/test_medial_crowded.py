"""Polygons with very many sides: corners all but straight, and centres that see all of them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from grassfire.geometry import Loop, Region
from grassfire.medial import MedialAxis, medial_axis, reach
from grassfire.medial.build import STRAIGHT, build_sites
from grassfire.medial.contact import Tangents
from grassfire.medial.reach import FarSamples, reaches
from grassfire.medial.search import BoundarySearch
from grassfire.medial.sites import SiteKind

FloatArray = NDArray[np.float64]


def polar(radius: FloatArray | float, angle: FloatArray) -> FloatArray:
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def star(count: int, deepest: float = 1.0) -> Region:
    """Valleys of random depth, at most `deepest` of a hundredth of the radius."""
    angle = 0.1 + 2 * np.pi * np.arange(count) / count
    radius = np.full(count, 50.0)
    radius[1::2] -= deepest * np.random.default_rng(count).uniform(0.25, 0.5, count // 2)
    return Region(Loop.from_points(polar(radius, angle)))


def flower(count: int) -> Region:
    """Corners on a curve with points of inflection: the turn passes through zero ten times."""
    angle = 2 * np.pi * np.arange(count) / count
    return Region(Loop.from_points(polar(40 + 10 * np.cos(5 * angle), angle)))


def simple(axis: MedialAxis) -> bool:
    """Whether the axis is a tree that leads into as many corners as it has convex ones."""
    kinds = axis.vertex_kind
    return len(kinds) - len(axis.edges) == 1 and kinds.count("branch") > 0


# -- corners that are all but straight ------------------------------------------------------------


@pytest.mark.parametrize("count", [4000, 10_000])
def test_inflections_and_flat_corners_are_certified(count: int) -> None:
    axis = medial_axis(flower(count), 1e-6)
    assert axis.certificate.max_disk_error <= 1e-6
    assert simple(axis)
    centre, radius = axis.largest_disk()
    assert np.allclose(centre, 0.0, atol=1e-6)
    assert np.isclose(radius, 30.0, rtol=0, atol=1e-5)


def test_points_on_a_straight_side_make_no_sites() -> None:
    along = np.linspace(0, 60, 7)[:-1]
    bottom = np.stack([along, np.zeros(6)], axis=1)
    region = Region(Loop.from_points([*bottom, (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)]))
    assert len(build_sites(region, merged=1e-7)[0]) == 4
    assert len(build_sites(region)[0]) == 9
    assert len(medial_axis(region).edges) == 5


@pytest.mark.parametrize("height", [1e-10, 1e-8])
def test_points_are_dropped_only_next_to_the_line_of_their_neighbours(height: float) -> None:
    corners = [(0.0, 0.0), (30.0, -height), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)]
    region = Region(Loop.from_points(corners))
    sites = build_sites(region, merged=1e-6)[0]
    dropped = height <= STRAIGHT * sites.size
    assert len(sites) == (4 if dropped else 5)
    assert sites.merged == (pytest.approx(height, rel=1e-3) if dropped else 0.0)


def test_what_dropped_points_are_off_by_adds_up_to_no_more_than_the_limit() -> None:
    angle = np.linspace(0, np.pi, 100_001)[:-1]
    sites = build_sites(Region(Loop.from_points(polar(50.0, 2 * angle))), merged=1e-6)[0]
    assert sites.merged <= STRAIGHT * sites.size * (1 + 1e-3)
    assert len(sites) == 100_000  # 2.5e-8 mm from the line between their neighbours


# -- far away -------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [600, 6000])
def test_no_disk_is_larger_than_the_reach_of_its_sites(count: int) -> None:
    axis = medial_axis(star(count))
    bound = reaches(axis.sites)
    span = axis.span
    radius = np.maximum(span.first_disk[:, 2], span.last_disk[:, 2])
    assert np.all(radius <= bound[span.site] + 1e-6)
    assert np.all(radius <= bound[span.partner] + 1e-6)
    assert np.isfinite(bound).mean() > 0.5


def test_few_corners_or_curves_have_no_bounds() -> None:
    sites = build_sites(star(40))[0]
    assert np.all(np.isinf(reaches(sites)))
    search = BoundarySearch(sites, 1.0)
    assert search.seeing_far() is search


def test_far_searches_find_what_full_ones_find(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reach, "_CROWDED", 1000)
    monkeypatch.setattr(reach, "_SHARE", 3)
    region = star(4000)
    sites = build_sites(region)[0]
    search = BoundarySearch(sites, region.area)
    far = search.seeing_far()
    assert far is not search
    kept = FarSamples.among(sites, search.site, search.point)
    assert kept is not None
    assert len(kept.row) < len(search.site) / 2
    corner = np.flatnonzero(sites.kind == SiteKind.POINT)
    middle = np.full(len(corner), 0.5)
    position, normal, curvature = sites.frame(corner, middle)
    own = np.stack([corner, sites.preceding[corner], sites.following[corner]], axis=1)
    tangents = Tangents(position, normal, corner, middle)
    one, two = (each.maximal_disks(tangents, curvature, own) for each in (search, far))
    assert np.allclose(one.radius, two.radius, rtol=1e-12, atol=0)
    place = np.random.default_rng(4).uniform(-30, 30, (500, 2))
    full = search.nearest(place)[0]
    assert np.allclose(far.nearest(place, bound=full)[0], full, rtol=1e-13, atol=0)
