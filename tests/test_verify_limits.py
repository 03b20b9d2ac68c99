"""Machine limits, shanks and holders."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely.geometry import Polygon, box

from grassfire.errors import InputError
from grassfire.toolpath import Program, Section, ToolpathBuilder
from grassfire.verify import Fault, MachineLimits, Target, Verification, verify
from grassfire.verify.limits import extents
from grassfire.verify.path import flatten_program
from verify_samples import MACHINE

ROOM = box(0, 0, 40, 40)


def target(**changes: object) -> Target:
    values: dict[str, object] = {
        "operation": 0,
        "region": ROOM,
        "depth": 12.0,
        "tool_radius": 3.0,
        "entry": "plunge",
    }
    return Target(**(values | changes))  # type: ignore[arg-type]


def program(builder: ToolpathBuilder) -> Program:
    return Program("test", (Section(builder.build(), 1, math.nan, 1000.0, 0),))


def judge(builder: ToolpathBuilder, *targets: Target, **limits: object) -> Verification:
    return verify(
        program(builder),
        targets or (target(),),
        **MACHINE,
        limits=MachineLimits(**limits),  # type: ignore[arg-type]
    )


def found(result: Verification, kind: str) -> list[Fault]:
    return [fault for fault in result.faults if fault.kind == kind]


def laps(levels: list[float], low: float = 3.001, high: float = 36.999) -> ToolpathBuilder:
    """Square rings from the middle outwards at each level, in the 40 mm room."""
    builder = ToolpathBuilder((20.0, 20.0, 10.0))
    line = 0
    for level in levels:
        builder.rapid(20.0, 20.0, 10.0, line=(line := line + 1))
        builder.line(20.0, 20.0, level, 100.0, line=(line := line + 1))
        for share in (0.25, 0.5, 0.75, 1.0):
            a, b = 20 + share * (low - 20), 20 + share * (high - 20)
            for x, y in ((a, a), (b, a), (b, b), (a, b), (a, a)):
                builder.line(x, y, level, 600.0, line=(line := line + 1))
        builder.rapid(a, a, 10.0, line=(line := line + 1))
    return builder


LEVELS = [-3.0, -6.0, -9.0, -12.0]


def test_a_program_within_the_limits_passes() -> None:
    travel = ((0.0, 40.0), (0.0, 40.0), (-12.0, 10.0))
    assert not judge(laps(LEVELS), travel=travel, rapid_height=5.0).faults


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [0, 1])
def test_each_end_of_each_axis_is_watched(axis: int, side: int) -> None:
    bounds = [[3.0, 37.0], [3.0, 37.0], [-12.0, 10.0]]
    inward = 0.25 if side == 0 else -0.25
    bounds[axis][side] += inward
    faults = found(judge(laps(LEVELS), travel=tuple(map(tuple, bounds))), "travel")
    edge = [3.001, 36.999] if axis < 2 else [-12.0, 10.0]
    assert faults[0].size == pytest.approx(abs(bounds[axis][side] - edge[side]), abs=1e-9)
    assert faults[0].place[axis] == pytest.approx(edge[side])
    assert faults[0].line > 0


def test_the_bulge_of_an_arc_counts_as_travel() -> None:
    builder = ToolpathBuilder((10.0, 20.0, -1.0))
    builder.arc(30.0, 20.0, -1.0, (20.0, 20.0), False, 600.0, line=7)
    builder.arc(30.0, 20.0, -1.0, (20.0, 20.0), True, 600.0)
    low, high = extents(flatten_program(program(builder), (target(),)))
    assert np.allclose(low, [[10, 20, -1], [10, 10, -1]])
    assert np.allclose(high, [[30, 30, -1], [30, 30, -1]])
    travel = ((0.0, 40.0), (0.0, 29.5), (-2.0, 10.0))
    (fault, *_) = found(judge(builder, travel=travel), "travel")
    assert fault.line == 7
    assert fault.size == pytest.approx(0.5)
    assert fault.place[:2] == pytest.approx((20.0, 30.0))


def test_rapids_cross_no_lower_than_they_may() -> None:
    result = judge(laps(LEVELS), rapid_height=11.0)
    assert found(result, "rapid-height")[0].size == pytest.approx(1.0)
    assert not found(judge(laps(LEVELS), rapid_height=10.0), "rapid-height")


@pytest.mark.parametrize(
    "travel", [((0.0, 1.0),), ((0.0, 1.0), (0.0, 1.0), (2.0, 1.0)), ((0.0, 0.0),) * 3]
)
def test_travel_is_three_pairs_in_order(travel: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(InputError, match="travel"):
        MachineLimits(travel=travel)


@pytest.mark.parametrize(
    ("changes", "rubs"),
    [
        ({"flute_length": 12.5}, False),
        ({"flute_length": 8.0}, True),
        ({"flute_length": 8.0, "shank_radius": 2.5}, False),
        ({"flute_length": 8.0, "shank_radius": 4.0}, True),
        ({"flute_length": 12.5, "shank_radius": 4.0}, False),
    ],
)
def test_a_shank_needs_flutes_as_long_as_the_wall_is_deep(
    changes: dict[str, float], rubs: bool
) -> None:
    faults = found(judge(laps(LEVELS), target(**changes)), "shank")
    assert bool(faults) == rubs
    if rubs:
        radius = changes.get("shank_radius", 3.0)
        # The walls are 3.001 mm away; closer than 5 um counts as rubbing.
        worst = max(fault.size for fault in faults)
        assert worst == pytest.approx(radius - 3.001 + 0.005, abs=1e-6)
        assert faults[0].place[2] == pytest.approx(-9.0)


def test_a_holder_is_held_off_walls_and_the_first_place_is_told() -> None:
    wide = {"stickout": 10.0, "holder_radius": 15.0}
    faults = found(judge(laps(LEVELS), target(**wide)), "holder")
    assert faults[0].place[2] == pytest.approx(-12.0)
    assert not found(judge(laps(LEVELS[:3]), target(depth=9.0, **wide)), "holder")


def test_a_holder_runs_into_stock_that_is_still_standing() -> None:
    """Deep at once in the middle of a room whose walls are far away."""
    room = box(0, 0, 80, 80)
    builder = ToolpathBuilder((40.0, 40.0, 5.0))
    builder.line(40.0, 40.0, -12.0, 100.0, line=1)
    deep = target(region=room, stickout=10.0, holder_radius=8.0)
    (fault,) = found(judge(builder, deep), "holder")
    assert fault.line == 1
    # The ring between the cutter and the holder, less the cell that rounding may take.
    assert fault.size == pytest.approx(math.pi * (64 - 9), rel=0.05)


def test_a_holder_may_come_down_where_the_stock_is_gone() -> None:
    room = box(0, 0, 80, 80)
    builder = ToolpathBuilder((40.0, 40.0, 5.0))
    for level in (-3.0, -12.0):
        builder.line(40.0, 40.0, level, 100.0)
        for radius in (2.5, 5.0, 7.5) if level == -3.0 else (2.5, 5.0):
            builder.line(40.0 + radius, 40.0, level, 600.0)
            builder.arc(40.0 + radius, 40.0, level, (40.0, 40.0), True, 600.0)
        builder.line(40.0, 40.0, level, 600.0)
    held = target(region=room, stickout=10.0, holder_radius=3.5, tool_radius=3.0)
    # At -12 the holder's end is at -2, and everything within 10.5 mm is gone down to -3.
    assert not found(judge(builder, held), "holder")


def test_a_shallower_pocket_beside_gives_room() -> None:
    """A step: the holder may hang over the part of the pocket that is cut less deep."""
    deep, ledge = box(0, 0, 40, 40), box(40, 0, 60, 40)
    builder = ToolpathBuilder((36.9, 20.0, -4.0))
    builder.line(36.9, 20.0, -12.0, 100.0)
    held = {"stickout": 8.5, "holder_radius": 6.0}
    both = (target(region=deep, **held), target(region=ledge, depth=4.0, **held))
    alone = verify(program(builder), both[:1], **MACHINE)
    assert "wall" in found(alone, "holder")[0].message
    beside = found(verify(program(builder), both, **MACHINE), "holder")
    assert all("wall" not in fault.message for fault in beside)


@pytest.mark.parametrize(
    "changes", [{"flute_length": 0.0}, {"shank_radius": -1.0}, {"stickout": 5.0}]
)
def test_tools_of_no_size_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(InputError):
        target(**changes)


def test_stock_thicker_than_the_flutes_is_too_thick() -> None:
    room = Polygon([(0, 0), (40, 0), (40, 40), (0, 40)])
    builder = laps([-12.0])
    assert found(judge(builder, target(region=room, flute_length=6.0)), "stepdown")
    assert not found(judge(builder, target(region=room, flute_length=12.5)), "stepdown")
