"""For every post: what is read back from the text is what was planned.

`python tests/test_roundtrip.py 2000` runs so many random programs for each post, or for those that
are named after the number, and reports.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings

from grassfire.gcode import read_program
from grassfire.post import Post, find_posts, load_post, render, split_by_tool
from grassfire.toolpath import Program, Toolpath
from roundtrip import CLEARANCE, TOLERANCE, Deviation, check, joined, programs

POSTS = tuple(find_posts())
EXAMPLES = 15


Units = Literal["mm", "inch"]


def units_of(post: Post) -> tuple[float, float]:
    """Units of the last decimals of coordinates and feeds, mm and mm/min."""
    tenths = 10 if post.name == "heidenhain" and post.scale != 1.0 else 1
    return post.scale * 10.0**-post.decimals, post.scale * 10.0**-post.feed_decimals / tenths


def slack_of(path: Toolpath, unit: float) -> float:
    """How far beside its end a helix may lead that is told by centre and angle, mm.

    The centre lies on a grid of a tenth of the unit, at most sqrt(2)/2 of that from where both
    radii are equal, which makes them differ by up to twice as much. Angles have 4 decimals.
    """
    radius = np.hypot(*(path.begin[:, :2] - path.centre).T)
    return float(0.1 * np.sqrt(2) * unit + np.radians(0.5e-4) * np.nanmax(radius, initial=0.0))


def check_post(name: str, program: Program, found: Deviation, units: Units = "mm") -> None:
    """Write a program by a post, read it, compare."""
    post = load_post(name)
    assert isinstance(post, Post)
    post = post.in_units(units)
    unit, feed_unit = units_of(post)
    for part in split_by_tool(program) if post.tool_change.split else (program,):
        text = render(part, post, clearance_height=CLEARANCE, tolerance=TOLERANCE)
        read = read_program(text, source=f"part.{post.extension}")
        for section in part.sections:
            own = [item for item in read.sections if item.operation == section.operation]
            assert {item.tool_number for item in own} == {section.tool_number}
            assert {item.tool_diameter for item in own} == {section.tool_diameter}
            assert own[0].spindle_speed == section.spindle_speed
            assert own[0].coolant == section.coolant
            assert own[0].name.upper() == section.name.upper()
            back = joined(read, section.operation)
            slack = slack_of(section.toolpath, unit) if name == "heidenhain" else 0.0
            check(section.toolpath, back, unit, feed_unit, found, slack)


@pytest.mark.parametrize("units", ["mm", "inch"])
@pytest.mark.parametrize("name", POSTS)
def test_planned_moves_come_back(name: str, units: Units) -> None:
    found = run(name, EXAMPLES, units)
    assert found.moves > 5 * EXAMPLES


def run(name: str, count: int, units: Units = "mm") -> Deviation:
    """So many random programs by one post; the largest differences."""
    found = Deviation()

    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],  # shrinking takes minutes
        suppress_health_check=list(HealthCheck),
    )
    @given(programs())
    def law(program: Program) -> None:
        check_post(name, program, found, units)

    law()
    return found


def main(count: int, posts: Sequence[str] = POSTS) -> None:
    """Report the differences of every post."""
    for name in posts or POSTS:
        begin = time.process_time()
        found = run(name, count)
        seconds = time.process_time() - begin
        print(
            f"{name:14} {count} programs, {found.moves} moves in {found.blocks} blocks: off by at "
            f"most {found.end:.6f} mm at ends, {found.path:.6f} mm on arcs, {found.feed:.4f} "
            f"mm/min in feeds; {seconds:.0f} s CPU",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2000, sys.argv[2:])
