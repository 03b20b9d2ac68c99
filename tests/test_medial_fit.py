"""Laws of the Bezier form of the axis, the boundary recovered from it, and the certificate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import medial_shapes as shapes
from grassfire.errors import GeometryError
from grassfire.geometry import Bezier, EllipticalArc, Loop, Region
from grassfire.geometry.chebyshev import bernstein, evaluate_bezier
from grassfire.medial import MedialAxis, medial_axis
from grassfire.medial.certificate import certify
from grassfire.medial.edges import Fit, evaluate_span, graph_spans
from grassfire.medial.fitting import fit_edges

FloatArray = NDArray[np.float64]

LISTED = [
    "rectangle", "ell", "comb", "needle", "dumbbell", "islands-grid", "rounded-rectangle",
    "stadium", "annulus-eccentric", "teardrop", "rounded-slot", "ellipse", "ellipse-flat",
    "blob-1", "blob-islands", "letter-d", "letter-s", "comma", "annulus",
]  # fmt: skip


@cache
def axis_of(name: str, tol: float = 1e-6) -> MedialAxis:
    return medial_axis(shapes.EVERY[name](), tol)


def values(fit: Fit, fraction: FloatArray) -> FloatArray:
    """(k, n, 3) disks of all pieces at fractions (n,)."""
    result = np.zeros((len(fit.degree), len(fraction), 3))
    for _, rows, table in fit.tables():
        result[rows] = evaluate_bezier(table, fraction)
    return result


def certify_again(axis: MedialAxis, fit: Fit) -> None:
    certify(axis.region, axis.sites, axis.search, axis.graph, fit, axis.tolerance)


# -- tables ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LISTED)
def test_tables_hold_every_piece_once(name: str) -> None:
    fit = axis_of(name).fit
    tables = fit.tables()
    rows = np.concatenate([rows for _, rows, _ in tables])
    assert np.array_equal(np.sort(rows), np.arange(len(fit.degree)))
    assert sum(table.shape[0] * table.shape[1] for _, _, table in tables) == len(fit.control)
    for degree, members, table in tables:
        assert np.all(fit.degree[members] == degree)
        first = fit.offset[members[0]]
        assert np.array_equal(table[0], fit.control[first : first + degree + 1])


@pytest.mark.parametrize("name", LISTED)
def test_pieces_are_the_exact_disks_within_tolerance(name: str) -> None:
    axis = axis_of(name)
    fraction = np.array([0.03, 0.17, 0.42, 0.58, 0.77, 0.96])
    exact, _ = evaluate_span(axis.sites, axis.span, fraction)
    assert np.abs(values(axis.fit, fraction) - exact).max() <= axis.tolerance


@pytest.mark.parametrize("name", LISTED)
def test_pieces_meet_at_their_vertices(name: str) -> None:
    axis = axis_of(name)
    fit = axis.fit
    ends = values(fit, np.array([0.0, 1.0]))
    known = np.concatenate([fit.vertex_centre, fit.vertex_radius[:, None]], axis=1)
    assert np.abs(ends[:, 0] - known[fit.span.first]).max() <= 2 * axis.tolerance
    assert np.abs(ends[:, 1] - known[fit.span.last]).max() <= 2 * axis.tolerance


@pytest.mark.parametrize("name", LISTED)
def test_both_sides_run_on_from_piece_to_piece(name: str) -> None:
    span = axis_of(name).span
    same = np.flatnonzero(span.edge[1:] == span.edge[:-1])
    assert np.array_equal(span.end[same], span.start[same + 1])
    assert np.array_equal(span.facing_end[same], span.facing_start[same + 1])
    assert np.array_equal(span.last[same], span.first[same + 1])
    assert np.all(span.end > span.start)
    assert np.all(span.facing_end <= span.facing_start)


@pytest.mark.parametrize("name", ["blob-1", "letter-s", "letter-o"])
def test_contacts_are_kept_at_the_chebyshev_points(name: str) -> None:
    axis = axis_of(name)
    fit = axis.fit
    nodes = np.sin(0.5 * np.pi * np.arange(13) / 12) ** 2
    _, facing = evaluate_span(axis.sites, axis.span, nodes)
    swing = np.abs(axis.span.facing_end - axis.span.facing_start)[:, None]
    assert np.all(np.abs(fit.facing - facing) <= 1e-3 * swing + 1e-9)


# -- degrees and counts ---------------------------------------------------------------------------


@pytest.mark.parametrize("corners", [5, 24])
def test_edges_between_lines_are_lines(corners: int) -> None:
    fit = medial_axis(shapes.irregular_inscribed(corners)).fit
    assert np.all(fit.degree == 1)
    assert np.all(fit.exact)


def test_edges_between_lines_and_points_are_parabolas() -> None:
    axis = axis_of("islands-grid")
    kinds = np.sort(
        np.stack([axis.sites.kind[axis.span.site], axis.sites.kind[axis.span.partner]]), axis=0
    )
    assert np.all(axis.fit.degree[(kinds[0] == 0) & (kinds[1] == 3)] <= 2)


def test_graph_edges_are_met_once() -> None:
    axis = axis_of("blob-islands")
    spans = graph_spans(axis.graph, axis.sites)
    mate = axis.graph.mate[spans.edge]
    every = np.concatenate([spans.edge, mate])
    assert np.array_equal(np.sort(every), np.flatnonzero(axis.graph.mate >= 0))


def test_chords_draw_the_pieces_within_the_drawing_tolerance() -> None:
    axis = axis_of("annulus")
    fit = fit_edges(axis.sites, axis.graph, 1e-8, 1e-7)
    coarse = np.linspace(0, 1, 400)
    middle = 0.5 * (coarse[1:] + coarse[:-1])
    drawn = values(fit, coarse)[..., :2]
    away = values(fit, middle)[..., :2] - 0.5 * (drawn[:, 1:] + drawn[:, :-1])
    assert np.hypot(away[..., 0], away[..., 1]).max() <= 1.01e-7
    # A circle of radius R in n equal pieces has the sagitta R (2 pi / 399 n)^2 / 8.
    radius = np.hypot(*axis.fit.vertex_centre[0])
    needed = 2 * np.pi / 399 * np.sqrt(radius / 8e-7)
    assert len(fit.degree) <= needed + 3


def test_edges_that_cannot_converge_are_named_with_their_place() -> None:
    axis = axis_of("blob-1")
    with pytest.raises(GeometryError, match="converge") as caught:
        fit_edges(axis.sites, axis.graph, 1e-18, 1.0)
    assert caught.value.place is not None


# -- closed forms ---------------------------------------------------------------------------------


def test_ellipse_to_a_ten_billionth() -> None:
    a, b = 60.0, 25.0
    axis = medial_axis(
        Region(Loop((EllipticalArc((0, 0), (a, 0), (0, b), 0.3, 2 * np.pi),))), 1e-10
    )
    fraction = np.linspace(0.0, 1.0, 33)
    disks = values(axis.fit, fraction).reshape(-1, 3)
    disks[:, :2] += axis.sites.origin
    assert np.abs(disks[:, 1]).max() <= 1e-10
    x = disks[:, 0]
    assert np.abs(x).max() == pytest.approx((a**2 - b**2) / a, abs=1e-10)
    exact = b * np.sqrt(1 - x**2 / (a**2 - b**2))
    assert np.abs(disks[:, 2] - exact).max() <= 1e-10


@pytest.mark.parametrize("tol", [1e-6, 1e-8])
def test_ellipse_is_recovered(tol: float) -> None:
    axis = medial_axis(shapes.ellipse(30.0, 18.0), tol)
    _, _, left, right = axis.recovered_boundary(41)
    for points in (left, right):
        level = np.hypot(points[:, 0] / 30.0, points[:, 1] / 18.0) - 1
        assert np.abs(level).max() * 18.0 <= 4 * tol


def test_circles_are_recovered() -> None:
    axis = axis_of("annulus-eccentric")
    _, _, left, right = axis.recovered_boundary(9)
    rims = [
        np.abs(np.hypot(*(points - arc.centre).T) - arc.radius)
        for points in (left, right)
        for arc in (loop.curves[0] for loop in axis.region.loops)
    ]
    assert np.minimum(rims[0], rims[1]).max() <= 2e-6
    assert np.minimum(rims[2], rims[3]).max() <= 2e-6


def test_line_and_corner_of_a_parabola_are_recovered() -> None:
    axis = axis_of("ell")
    edge, _, left, right = axis.recovered_boundary(5)
    degree = np.array([len(e.radius) - 1 for e in axis.edges])
    parabola = degree[edge] == 2
    corner = np.array([10.0, 10.0])
    to_corner = [np.hypot(*(points[parabola] - corner).T) for points in (left, right)]
    assert np.minimum(*to_corner).max() <= 1e-9
    walls = [np.abs(points[parabola]).min(axis=1) for points in (left, right)]
    assert np.minimum(*walls).max() <= 1e-9


@pytest.mark.parametrize("name", LISTED)
def test_recovered_points_lie_on_the_boundary(name: str) -> None:
    axis = axis_of(name)
    edge, fraction, left, right = axis.recovered_boundary(samples_per_edge=7)
    assert len(edge) == len(fraction) == len(left) == len(right) == 7 * len(axis.edges)
    assert set(fraction) == set(np.linspace(0, 1, 7))
    inner = (fraction > 0) & (fraction < 1)
    for points in (left[inner], right[inner]):
        assert np.abs(axis.clearance(points)).max() <= 10 * axis.tolerance


def test_recovered_points_lie_on_their_own_side() -> None:
    axis = axis_of("letter-s")
    edge, fraction, left, right = axis.recovered_boundary(5)
    tables = [e.control_points for e in axis.edges]
    for index in np.flatnonzero(fraction == 0.5):
        table = tables[edge[index]]
        degree = len(table) - 1
        slope = bernstein(degree - 1, 0.5) @ np.diff(table, axis=0)
        centre = bernstein(degree, 0.5) @ table
        for point, sign in ((left[index], 1), (right[index], -1)):
            away = point - centre
            assert sign * (slope[0] * away[1] - slope[1] * away[0]) > 0


def test_a_recovered_edge_has_two_samples() -> None:
    with pytest.raises(GeometryError, match="2 samples"):
        axis_of("ell").recovered_boundary(1)


# -- certificate ----------------------------------------------------------------------------------


@pytest.mark.parametrize("tol", [1e-6, 1e-8])
@pytest.mark.parametrize("name", ["blob-1", "letter-s", "comma", "ellipse", "islands-grid"])
def test_errors_of_the_certificate_are_within_their_limits(name: str, tol: float) -> None:
    certificate = axis_of(name, tol).certificate
    assert certificate.interpolation_error <= 2 * tol
    assert certificate.recovery_error <= 10 * tol
    assert certificate.max_disk_error <= tol


def test_certifying_calls_for_no_new_contacts(monkeypatch: pytest.MonkeyPatch) -> None:
    axis = axis_of("letter-e")

    def fail(*_: object) -> None:
        raise AssertionError("a contact was computed")

    monkeypatch.setattr("grassfire.medial.edges.contact", fail)
    certify_again(axis, axis.fit)


@pytest.mark.parametrize("name", ["rectangle", "ell", "blob-1", "rounded-slot", "letter-s"])
@pytest.mark.parametrize("column", [0, 1, 2])
def test_a_wrong_coefficient_is_found(name: str, column: int) -> None:
    axis = axis_of(name)
    row = int(np.argmax(axis.fit.degree))
    control = axis.fit.control.copy()
    inner = axis.fit.offset[row] + (1 if axis.fit.degree[row] > 1 else 0)
    # Off along the axis is no error: the disks stay. Ten thousand tolerances are not along it.
    control[inner, column] += 1e-2
    with pytest.raises(GeometryError) as caught:
        certify_again(axis, replace(axis.fit, control=control))
    assert caught.value.place is not None


def test_no_number_is_no_certificate() -> None:
    axis = axis_of("ell")
    control = axis.fit.control.copy()
    control[axis.fit.offset[3]] = np.nan
    with pytest.raises(GeometryError):
        certify_again(axis, replace(axis.fit, control=control))


def test_a_wrong_vertex_is_found() -> None:
    axis = axis_of("letter-d")
    radius = axis.fit.vertex_radius.copy()
    radius[np.argmax(radius)] += 3e-6
    with pytest.raises(GeometryError, match="off by 3e-06"):
        certify_again(axis, replace(axis.fit, vertex_radius=radius))


def test_cells_that_overlap_are_found() -> None:
    axis = axis_of("blob-1")
    span = axis.span
    row = int(np.argmax(span.end - span.start))
    start = span.start.copy()
    start[row] += 0.01 * (span.end - span.start)[row]
    with pytest.raises(GeometryError):
        certify_again(axis, replace(axis.fit, span=replace(span, start=start)))


@pytest.mark.parametrize("remove", [True, False])
def test_a_missing_or_doubled_piece_is_found(remove: bool) -> None:
    axis = axis_of("ell")
    rows = np.arange(len(axis.fit.degree))
    rows = rows[1:] if remove else np.append(rows, 0)
    fit = axis.fit
    parts = [fit.control[fit.offset[k] : fit.offset[k + 1]] for k in rows]
    changed = replace(
        fit,
        span=fit.span.take(rows),
        control=np.concatenate(parts),
        offset=np.concatenate([[0], np.cumsum([len(part) for part in parts])]),
        error=fit.error[rows],
        facing=fit.facing[rows],
        exact=fit.exact[rows],
    )
    with pytest.raises(GeometryError, match="connected"):
        certify_again(axis, changed)


# -- invariance -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["blob-1", "letter-s", "rounded-slot"])
def test_reversal_gives_the_same_pieces(name: str) -> None:
    region = shapes.EVERY[name]()
    loops = [loop.reversed() for loop in region.loops]
    one, two = axis_of(name).fit, medial_axis(Region(loops[0], tuple(loops[1:]))).fit
    assert np.array_equal(np.sort(one.degree), np.sort(two.degree))


@pytest.mark.parametrize("make", [shapes.letter_e, lambda: shapes.blob(7, 10)])
def test_same_graph_gives_the_same_bytes(make: Callable[[], Region]) -> None:
    one, two = medial_axis(make()).fit, medial_axis(make()).fit
    assert one.control.tobytes() == two.control.tobytes()
    assert one.facing.tobytes() == two.facing.tobytes()


@settings(max_examples=6, deadline=None)
@given(st.floats(0.2, 3.0), st.floats(-1.0, 1.0))
def test_lens_of_two_parabolas_is_certified(bulge: float, lean: float) -> None:
    curves = (
        Bezier(np.array([(0.0, 0.0), (10 + 8 * lean, -10 * bulge), (20.0, 0.0)])),
        Bezier(np.array([(20.0, 0.0), (10 - 8 * lean, 6 * bulge + 2), (0.0, 0.0)])),
    )
    certificate = medial_axis(Region(Loop(curves)), 1e-8).certificate
    assert certificate.recovery_error <= 1e-7
