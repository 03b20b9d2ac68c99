"""Laws of the finishing laps that all strategies share."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from grassfire.geometry import Line, Loop, Region
from grassfire.medial import MedialAxis, medial_axis
from grassfire.plan import link
from grassfire.plan.path import Path
from grassfire.plan.rings import components
from grassfire.plan.strategy import ClearingSettings
from grassfire.plan.strokes import Stroke, StrokeKind
from grassfire.plan.wallpass import wall_pass
from grassfire.toolpath import FloatArray, Role

RADIUS, WALL = 3.0, 3.0 - 2e-4


def box(x0: float, y0: float, x1: float, y1: float) -> Loop:
    """An upright rectangle."""
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    ends = np.roll(corners, -1, axis=0)
    return Loop(tuple(Line(one, other) for one, other in zip(corners, ends, strict=True)))


def settings(climb: bool = True) -> ClearingSettings:
    """As for a 6 mm tool."""
    return ClearingSettings(
        RADIUS, WALL, 2.4, 1.37, 7e-4, "helix", 0.05, 2.5, 2.0, climb, True, False, 40.0, 0.0
    )  # fmt: skip


@cache
def room() -> MedialAxis:
    """A room with two islands."""
    return medial_axis(Region(box(0, 0, 80, 50), (box(20, 20, 30, 30), box(50, 18, 62, 32))))


def rings(climb: bool = True) -> tuple[Path, ...]:
    """Its three wall rings."""
    (part,) = components(room(), np.array([WALL]), 2.4, RADIUS, 7e-4, climb)
    return part.rings


def laps(strokes: list[Stroke]) -> list[Path]:
    return [stroke.path for stroke in strokes if stroke.role is Role.FINISH]


@pytest.mark.parametrize("climb", [True, False])
def test_every_ring_is_cut_once_in_its_sense(climb: bool) -> None:
    found = laps(wall_pass(room(), rings(climb), settings(climb), np.array([10.0, 10.0])))
    assert sorted(lap.length for lap in found) == pytest.approx(
        sorted(ring.length for ring in rings(climb))
    )
    assert all(lap.closed for lap in found)


@pytest.mark.parametrize("climb", [True, False])
def test_leads_are_tangents_that_keep_off_the_walls(climb: bool) -> None:
    strokes = wall_pass(room(), rings(climb), settings(climb), np.array([10.0, 10.0]))
    for before, after in pairwise(strokes):
        if Role.LEAD in (before.role, after.role) and Role.LINK not in (before.role, after.role):
            turn = np.dot(before.path.tangent(before.path.length), after.path.tangent(0.0))
            assert turn == pytest.approx(1.0, abs=1e-6)
    leads = [stroke.path for stroke in strokes if stroke.role is Role.LEAD]
    assert len(leads) == 6
    for lead in leads:
        assert room().clearance(lead.sample(0.05)[0]).min() >= WALL - 1e-3


def test_the_tool_goes_up_only_where_no_way_leads() -> None:
    def nowhere(start: FloatArray, end: FloatArray) -> None:
        return None

    place = np.array([10.0, 10.0])
    linked = wall_pass(room(), rings(), settings(), place, link.straight)
    lifted = wall_pass(room(), rings(), settings(), place, nowhere)
    assert [stroke.kind for stroke in linked] == [StrokeKind.FEED] * len(linked)
    assert sum(stroke.kind is StrokeKind.HOP for stroke in lifted) == 3
    assert len(laps(linked)) == len(laps(lifted)) == 3


def test_straight_ways_through_an_island_are_not_taken() -> None:
    inside = wall_pass(room(), rings(), settings(), np.array([10.0, 10.0]))
    for stroke in inside:
        if stroke.kind is StrokeKind.FEED:
            assert room().clearance(stroke.path.sample(0.1)[0]).min() >= WALL - 1e-3


def test_the_only_ring_goes_on_from_the_lap_before() -> None:
    axis = medial_axis(Region(box(0, 0, 40, 30), ()))
    (part,) = components(axis, np.array([WALL]), 2.4, RADIUS, 7e-4, True)
    start = part.rings[0].at(np.array([7.0]))[0]
    roles = [item.role for item in wall_pass(axis, part.rings, settings(), start, onward=True)]
    assert roles == [Role.FINISH, Role.LEAD]
    roles = [item.role for item in wall_pass(axis, part.rings, settings(), start)]
    assert roles == [Role.LINK, Role.LEAD, Role.FINISH, Role.LEAD]
