"""What stands in for exhaustive searches in the certificate: cells cover the region once."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import medial_shapes as shapes
from grassfire.errors import GeometryError
from grassfire.medial import MedialAxis, certificate, medial_axis
from grassfire.medial.certificate import Certificate
from grassfire.medial.edges import Fit
from grassfire.medial.graph import Graph

NAMES = ["comb", "rounded-rectangle", "blob-islands", "ellipse", "annulus-eccentric", "letter-s"]


@cache
def axis_of(name: str) -> MedialAxis:
    return medial_axis(shapes.EVERY[name](), 1e-6)


@pytest.fixture(autouse=True)
def few_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certificate, "_EXHAUSTIVE", 5)
    monkeypatch.setattr(certificate, "_STRAIGHT", 5)


def certify(axis: MedialAxis, graph: Graph | None = None, fit: Fit | None = None) -> Certificate:
    return certificate.certify(
        axis.region, axis.sites, axis.search, graph or axis.graph, fit or axis.fit, axis.tolerance
    )


@pytest.mark.parametrize("name", NAMES)
def test_cells_prove_what_searches_prove(name: str) -> None:
    axis = axis_of(name)
    found = certify(axis)
    assert found.max_disk_error <= axis.tolerance
    assert found.area_error == axis.certificate.area_error


@pytest.mark.parametrize("name", NAMES)
def test_a_vertex_off_its_sites_is_found(name: str) -> None:
    axis = axis_of(name)
    radius = axis.fit.vertex_radius.copy()
    radius[len(radius) // 2] += 1e-4
    with pytest.raises(GeometryError, match="at its vertex"):
        certify(axis, fit=replace(axis.fit, vertex_radius=radius))


@pytest.mark.parametrize("name", NAMES)
def test_boundary_left_out_is_found(name: str) -> None:
    axis = axis_of(name)
    end = axis.graph.end.copy()
    row = int(np.argmax(end - axis.graph.start))
    end[row] = 0.5 * (axis.graph.start[row] + end[row])
    with pytest.raises(GeometryError, match="leave boundary out"):
        certify(axis, replace(axis.graph, end=end))


def test_a_jump_to_another_vertex_is_found() -> None:
    axis = axis_of("comb")
    last = axis.graph.last.copy()
    last[7] = (last[7] + 1) % len(axis.graph.vertex_radius)
    with pytest.raises(GeometryError, match="leave boundary out"):
        certify(axis, replace(axis.graph, last=last))


def test_a_loop_left_out_is_found() -> None:
    axis = axis_of("blob-islands")
    keep = axis.sites.loop[axis.graph.site] == 0
    columns = {
        name: getattr(axis.graph, name)[keep]
        for name in ("site", "start", "end", "first", "last", "first_radius", "last_radius")
    }
    centres = {name: getattr(axis.graph, name)[keep] for name in ("first_centre", "last_centre")}
    with pytest.raises(GeometryError, match="no medial axis"):
        certify(axis, replace(axis.graph, **columns, **centres))


@pytest.mark.parametrize(
    ("name", "message"),
    [("blob-islands", "passes the centre of curvature"), ("comb", "turned over")],
)
def test_a_cell_that_is_turned_over_is_found(name: str, message: str) -> None:
    axis = axis_of(name)
    span = axis.fit.span
    backwards = replace(axis.fit, span=replace(span, start=span.end, end=span.start))
    none, row = np.zeros(0), np.zeros(0, dtype=np.int64)
    nowhere = certificate._Places(row, span.take(row), none, none, none), np.zeros((0, 3))
    certificate._demand_orientation(axis.sites, axis.fit, *nowhere, 1e-6)
    with pytest.raises(GeometryError, match=message):
        certificate._demand_orientation(axis.sites, backwards, *nowhere, 1e-6)
    still = replace(axis.fit, span=replace(span, facing_start=span.facing_end - 1e-12))
    with pytest.raises(GeometryError, match="turned over"):
        certificate._demand_orientation(axis.sites, still, *nowhere, 1e-6)
