"""Edges between two reflex corners: their closed form, their feet, and what is proved of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grassfire.geometry import Loop, Region
from grassfire.medial import MedialAxis, medial_axis
from grassfire.medial.build import build_sites
from grassfire.medial.hyperbolas import between_corners
from grassfire.medial.search import BoundarySearch
from grassfire.medial.triple import common_disk

TOL = 1e-6


@cache
def hourglass(half: float, shift: float = 0.0) -> MedialAxis:
    """Axis of a box, 40 mm wide, with a waist of 2 `half` between two reflex corners."""
    lower = [(-20, -12), (0, -half), (20, -12)]
    upper = [(20, 12), (shift, half), (-20, 12)]
    return medial_axis(Region(Loop.from_points([*lower, *upper])), TOL)


def hyperbola(axis: MedialAxis) -> np.ndarray:
    """Rows of the edge between the two corners."""
    rows = axis.span.hyperbolic
    assert len(rows)
    return rows


@pytest.mark.parametrize("half", [3.0, 0.1, 1e-3, 1e-6])
def test_disks_are_those_of_the_closed_form(half: float) -> None:
    axis = hourglass(half)
    rows = np.repeat(hyperbola(axis), 33)
    fraction = np.tile(np.linspace(0, 1, 33), len(rows) // 33)
    disks = axis.disks(rows, fraction) + np.append(axis.sites.origin, 0.0)
    error = np.stack([disks[:, 1], disks[:, 2] - np.hypot(disks[:, 0], half)], axis=1)
    assert np.abs(error).max() <= 0.1 * TOL


@pytest.mark.parametrize("half", [3.0, 0.1, 1e-3, 1e-6])
def test_deviations_stay_within_their_bounds(half: float) -> None:
    axis = hourglass(half)
    span, fit = axis.span, axis.fit
    fraction = np.linspace(0, 1, 41)
    for row in hyperbola(axis):
        first, last = span.angle_start[row], span.angle_end[row]
        angle = first + (last - first) * fraction
        disks = axis.disks(np.full(41, row), fraction) + np.append(axis.sites.origin, 0.0)
        way = np.sign(span.last_disk[row, 0] - span.first_disk[row, 0]) * np.sign(last - first)
        exact = np.stack([way * half * np.sinh(angle), half * np.cosh(angle)], axis=1)
        off = np.abs(disks[:, [0, 2]] - exact).max()
        # Ends are those of the graph, which are off by rounding.
        assert off <= fit.error[row] + 1e-12 * axis.sites.size


def test_pieces_grow_in_number_like_the_logarithm_of_the_ratio() -> None:
    counts = [len(hyperbola(hourglass(half))) for half in (1.0, 1e-2, 1e-4, 1e-6)]
    assert counts == sorted(counts)
    assert counts[-1] <= 12


@pytest.mark.parametrize(("half", "shift"), [(0.1, 0.0), (1e-3, 0.0), (0.5, 0.2)])
def test_both_feet_see_the_disk_along_their_normals(half: float, shift: float) -> None:
    axis = hourglass(half, shift)
    sites, span = axis.sites, axis.span
    rows = np.repeat(hyperbola(axis), 9)
    fraction = np.tile(np.linspace(0, 1, 9), len(rows) // 9)
    disks = axis.disks(rows, fraction)
    for site, parameter in (
        (span.site[rows], span.at(rows, fraction)),
        (span.partner[rows], axis.fit.contacts(rows, fraction, np.linspace(0, 1, 9))),
    ):
        position, normal = sites.tangents(site, parameter)
        centre = position + disks[:, 2:] * normal
        # The normal is known to rounding, the more of it counts the longer the disk's radius.
        assert np.abs(centre - disks[:, :2]).max() <= 10 * TOL


def test_shares_run_from_end_to_end_alike_on_both_sides() -> None:
    span = hourglass(1e-3).span
    rows = span.take(span.hyperbolic)
    fraction = np.linspace(0, 1, 50)
    share = rows.share(fraction)
    assert np.all(np.diff(share, axis=1) > 0)
    assert np.abs(share[:, [0, -1]] - [0.0, 1.0]).max() <= 1e-15
    back = rows.swapped().share(1 - fraction)
    assert np.abs(back - (1 - share)).max() <= 1e-12


@settings(max_examples=25, deadline=None)
@given(st.floats(-4, 0.7), st.floats(-3, 3))
def test_cells_between_corners_are_part_of_the_area(exponent: float, shift: float) -> None:
    axis = hourglass(10.0**exponent, shift)
    assert axis.certificate.area_error <= 1e-6 * axis.region.area
    assert axis.certificate.max_disk_error <= TOL


def test_feet_are_seen_under_the_angle_of_the_corners() -> None:
    axis = hourglass(0.1)
    edges = np.flatnonzero(np.isin(axis.table.row, hyperbola(axis)))
    place = np.full(len(edges), 0.4)
    radius = axis.radius(edges, place)
    assert np.allclose(axis.separation_angle(edges, place), 2 * np.arcsin(0.1 / radius), atol=1e-6)


def test_offsets_at_the_waist_end_in_the_corners_alone() -> None:
    axis = hourglass(0.1)
    offset = axis.trimmed_offset(2.0)
    assert len(offset.regions) == 2
    wide = sum(region.area for region in axis.reachable(2.0))
    rest = sum(region.area for region in axis.unreachable(2.0))
    assert np.isclose(wide + rest, axis.region.area, rtol=0, atol=1e-9)


def test_edges_that_do_not_end_between_their_corners_are_left() -> None:
    axis = hourglass(0.1)
    moved = axis.span.take(axis.span.hyperbolic)
    moved.first_disk[:, 1] += 1e-3
    none = np.zeros(len(moved))
    moved = type(moved)(
        **{
            **{name: getattr(moved, name) for name in moved.__dataclass_fields__},
            "angle_start": none,
            "angle_end": none,
        }
    )
    made, joints, rest = between_corners(axis.sites, moved, TOL, 0)
    assert len(made.span) == len(joints) == 0
    assert len(rest) == len(moved)


def test_a_disk_common_to_very_many_lines_is_exact() -> None:
    count = 20_000
    angle = 2 * np.pi * np.arange(count) / count
    region = Region(Loop.from_points(50 * np.stack([np.cos(angle), np.sin(angle)], axis=1)))
    sites, _ = build_sites(region, 1e-6, 1e-9, 1e-7)
    triple = np.stack([np.arange(count), sites.preceding, sites.following], axis=1)
    found = common_disk(sites, triple, 1e-10)
    assert found is not None
    assert np.abs(found.residual).max() <= 1e-13
    assert np.hypot(*(found.centre + sites.origin)) <= 1e-13


def test_nothing_is_found_beyond_the_bound_of_a_search() -> None:
    corners = [(0, 0), (20, 0), (20, 10), (0, 10)]
    sites, _ = build_sites(Region(Loop.from_points(corners)))
    search = BoundarySearch(sites, 200.0)
    centre = np.array([(5.0, 4.0), (12.0, 5.5), (18.0, 3.0)]) - sites.origin
    away, site, _ = search.nearest(centre)
    near = search.nearest(centre, bound=away + 1e-9)
    assert np.array_equal(near[0], away)
    assert np.array_equal(near[1], site)
    far = search.nearest(centre, bound=0.5 * away)
    assert np.all((far[0] == np.inf) | (far[0] == away))
    assert np.all((far[1] == -1) == (far[0] == np.inf))
