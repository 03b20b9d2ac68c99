"""Queries asked one by one, few at a time and all at once give the same answers."""

import numpy as np
import pytest

from grassfire.geometry import Arc, Line, Loop, Region
from grassfire.medial import MedialAxis, medial_axis

DISTANCES = (0.4, 1.1, 1.8, 2.5, 3.2)


def polygon(*points: tuple[float, float]) -> Loop:
    return Loop.from_points(np.array(points))


@pytest.fixture(scope="module")
def axis() -> MedialAxis:
    """An L with a rounded end, a flat corner, and a round island."""
    outer = Loop(
        (
            Line((0, 0), (20, 0)),
            Line((20, 0), (40, 1e-3)),
            Arc((40, 5.0015), 5.0005, -np.pi / 2, np.pi),
            Line((40, 10.002), (12, 10.002)),
            Line((12, 10.002), (12, 30)),
            Line((12, 30), (0, 30)),
            Line((0, 30), (0, 0)),
        )
    )
    return medial_axis(Region(outer, (Loop((Arc((6.3, 20), 2.0, 0.0, -2 * np.pi),)),)))


def test_clearance_does_not_depend_on_how_many_points_are_asked_for(axis: MedialAxis) -> None:
    points = np.random.default_rng(3).uniform((-12, -12), (58, 42), (6000, 2))
    together = axis.clearance(points)
    assert np.abs(together).max() > 10
    for count in (1, 7, 400):
        parts = np.split(points[: 40 * count], 40)[: 6000 // count]
        apart = np.concatenate([axis.clearance(part) for part in parts if len(part)])
        np.testing.assert_allclose(apart, together[: len(apart)], rtol=0, atol=1e-12)


def test_clearance_outside_is_the_distance_to_corners(axis: MedialAxis) -> None:
    ahead = np.array([(-3.0, -4.0), (-5.0, 42.0), (20.0, -9.0), (15.0, 35.0)])
    corner = np.array([(0.0, 0.0), (0.0, 30.0), (20.0, 0.0), (12.0, 30.0)])
    expected = -np.hypot(*(ahead - corner).T)
    np.testing.assert_allclose(axis.clearance(ahead), expected, rtol=0, atol=1e-6)


def test_stretches_of_many_distances_are_those_of_each(axis: MedialAxis) -> None:
    for distance, found in zip(DISTANCES, axis.walker.stretches_at(DISTANCES), strict=True):
        alone = axis.walker.stretches(distance)
        np.testing.assert_array_equal(found.row, alone.row)
        np.testing.assert_allclose(found.start, alone.start, rtol=0, atol=1e-14)
        np.testing.assert_allclose(found.end, alone.end, rtol=0, atol=1e-14)


def test_stretches_end_where_the_disks_have_the_radius(axis: MedialAxis) -> None:
    for distance, found in zip(DISTANCES, axis.walker.stretches_at(DISTANCES), strict=True):
        for cut, place in ((found.cut_start, found.start), (found.cut_end, found.end)):
            radius = axis.walker.exact(found.row[cut], place[cut])[0][:, 2]
            assert len(radius)
            np.testing.assert_allclose(radius, distance, rtol=0, atol=1e-10)


def test_no_distance_has_no_stretches_and_no_rings(axis: MedialAxis) -> None:
    assert axis.walker.stretches_at(()) == []
    assert axis.offset_tree(np.zeros(0)) == ()


def test_beyond_the_largest_disk_nothing_is_left(axis: MedialAxis) -> None:
    most = axis.largest_disk()[1]
    assert len(axis.offset_tree(np.array([0.9 * most, 1.1 * most, 1.2 * most]))) > 0
    assert axis.offset_tree(np.array([1.1 * most])) == ()
