"""Neighbours and components: the same for few as for many, and the same as SciPy's."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from grassfire.geometry.neighbours import FEW, FEW_LINKS, Neighbours, connected

SIZES = [(1, 1), (5, 3), (60, 60), (FEW // 8, 8), (FEW // 8, 9), (3000, 40)]


@pytest.mark.parametrize(("points", "places"), SIZES)
def test_nearest_are_those_of_another_tree(points: int, places: int) -> None:
    random = np.random.default_rng(points + places)
    cloud, asked = random.normal(size=(points, 2)), random.normal(size=(places, 2))
    count = min(points, 8)
    away, row = Neighbours(cloud).nearest(asked, count)
    assert away.shape == row.shape == (places, count)
    expected = np.asarray(cKDTree(cloud).query(asked, k=np.arange(1, count + 1)))
    np.testing.assert_array_equal(row, expected[1])
    np.testing.assert_allclose(away, expected[0], rtol=1e-15)


@pytest.mark.parametrize("count", [1, 3])
def test_of_points_at_one_place_none_is_named_twice(count: int) -> None:
    cloud = np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    away, row = Neighbours(cloud).nearest(np.zeros((2, 2)), count)
    assert not away.any()
    assert all(len(set(rows)) == count and 0 not in rows for rows in row.tolist())


CLOUDS = {
    "anywhere": lambda random, count: random.uniform(0, 50, size=(count, 2)),
    "on a grid": lambda random, count: random.integers(0, 6, size=(count, 2)).astype(float),
    "on a line": lambda random, count: np.stack([random.uniform(size=count), np.ones(count)], 1),
    "at one place": lambda _, count: np.full((count, 2), 3.0),
    "far off": lambda random, count: 1e6 + random.uniform(0, 50, size=(count, 2)),
}


@pytest.mark.parametrize("kind", list(CLOUDS))
@pytest.mark.parametrize("count", [1, 7, 40, 900])
def test_near_are_those_nearer_than_the_reach(kind: str, count: int) -> None:
    random = np.random.default_rng(count)
    cloud = CLOUDS[kind](random, count)
    asked = cloud[random.integers(0, count, 200)] + random.normal(0, 0.3, size=(200, 2))
    away = np.hypot(*(asked[:, None] - cloud).transpose(2, 0, 1)).min(axis=1)
    reach = float(np.median(away)) + 1e-7
    np.testing.assert_array_equal(Neighbours(cloud).near(asked, reach), away < reach)
    assert not len(Neighbours(cloud).near(np.zeros((0, 2)), reach))


def test_neighbours_beyond_a_bound_may_be_left_out() -> None:
    cloud = np.random.default_rng(3).uniform(0, 9, size=(300, 2))
    bound = np.linspace(0.01, 2.0, 300)
    away, row = Neighbours(cloud).nearest(cloud, 4, within=bound)
    expected = np.asarray(cKDTree(cloud).query(cloud, k=4)[0])
    known = expected < bound[:, None]
    np.testing.assert_allclose(away[known], expected[known], rtol=1e-14)
    assert np.all(row[np.isinf(away)] == len(cloud))


def test_the_number_of_threads_of_others_stays_as_it_is() -> None:
    program = (
        "import os; from grassfire.geometry.neighbours import Neighbours; "
        "print(os.environ.get('OMP_NUM_THREADS'))"
    )
    for threads in (None, "7"):
        known = {key: value for key, value in os.environ.items() if key != "OMP_NUM_THREADS"}
        known |= {} if threads is None else {"OMP_NUM_THREADS": threads}
        run = [sys.executable, "-c", program]
        found = subprocess.run(run, env=known, capture_output=True, text=True, check=True)
        assert found.stdout.strip() == str(threads)


def test_no_places_have_no_neighbours() -> None:
    away, row = Neighbours(np.zeros((3, 2))).nearest(np.zeros((0, 2)), 2)
    assert away.shape == row.shape == (0, 2)


@pytest.mark.parametrize("count", [0, 1, 2, 63, 64, 65, 500])
def test_pairs_are_those_of_the_tree(count: int) -> None:
    cloud = np.random.default_rng(count).uniform(size=(count, 3))
    found = Neighbours(cloud).pairs(0.3)
    assert np.all(found[:, 0] < found[:, 1])
    assert set(map(tuple, found.tolist())) == cKDTree(cloud).query_pairs(0.3)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 60), st.integers(0, 2 * FEW_LINKS), st.integers(0, 2**32 - 1))
def test_components_are_those_of_the_matrix(count: int, links: int, seed: int) -> None:
    first, second = np.random.default_rng(seed).integers(0, count, size=(2, links))
    matrix = coo_matrix((np.ones(links), (first, second)), shape=(count, count))
    expected = connected_components(matrix, directed=False)[1]
    np.testing.assert_array_equal(connected(first, second, count), expected)


def test_a_chain_is_one_component_whichever_way_it_is_told() -> None:
    order = np.random.default_rng(7).permutation(FEW_LINKS)
    first, second = np.arange(FEW_LINKS)[order], np.arange(1, FEW_LINKS + 1)[order]
    assert not connected(first, second, FEW_LINKS + 1).any()
    assert not connected(second, first, FEW_LINKS + 1).any()


def test_without_links_each_thing_is_a_component() -> None:
    none = np.zeros(0, dtype=np.int64)
    assert connected(none, none, 4).tolist() == [0, 1, 2, 3]
    assert connected(none, none, 0).tolist() == []
