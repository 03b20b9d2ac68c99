"""A commented job file to start from, fitted to a drawing."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from grassfire.app.stages import Progress
from grassfire.app.survey import STANDARD_DIAMETERS, inspect

_TEMPLATE: Final = """\
# {count} in {file}.
# Every key, its default and its unit: docs/job-file.md; `grassfire init --schema` for editors.
name = {name}
units = "mm"                  # of the numbers in this file; "0.25in" works anywhere
post = "linuxcnc"             # `grassfire posts` lists what there is

[input]
file = {path}
layers = {layers}
{units}

[stock]
top = 0.0                     # z of the top of the stock
# thickness = 12.0            # refuses operations that are deeper

[heights]                     # above the top of the stock
clearance = 15.0
retract = 3.0

[machine]                     # for the time estimate
rapid = 5000                  # mm/min
acceleration = 500            # mm/s^2

[[tools]]
number = 1
shape = "flat"
diameter = {diameter}                # {reason}
flutes = 2
spindle_speed = 18000
feed = 800                    # CHECK: speeds and feeds depend on the material
plunge_feed = 200

[[operations]]
strategy = "offset"           # or "spiral", "adaptive"
tool = 1
depth = 2.0                   # CHECK: below the top of the stock
stepdown = {stepdown}
stepover = 0.4                # of the diameter; or engagement_angle = 75 (degrees)
direction = "climb"           # or "conventional"; adaptive: or "both"
radial_allowance = 0.0        # left on the walls
axial_allowance = 0.0         # left on the floor
entry = "helix"               # or "ramp", "plunge"
ramp_angle = 3.0              # degrees
finish_pass = true            # one more pass along the walls
"""


def _diameter(found: dict[str, object]) -> tuple[float, str]:
    """The largest standard tool that reaches nearly all, else the smallest one."""
    tools = found["tools"]
    assert isinstance(tools, list)
    shares = {row["diameter_mm"]: float(row["share"]) for row in tools}
    best = shares[STANDARD_DIAMETERS[0]]
    fitting = [size for size in STANDARD_DIAMETERS if shares[size] >= 0.97 * best > 0]
    size = fitting[-1] if fitting else STANDARD_DIAMETERS[0]
    return size, f"reaches {100 * shares[size]:.1f} % of the area"


def _job_name(text: str) -> str:
    """Of a file's name, what the name of a job may hold."""
    return re.sub(r"[^\w .+-]", "_", text).lstrip(" .+-")[:100] or "job"


def starter_job(
    drawing: str | Path,
    folder: str | Path,
    layers: Sequence[str] = (),
    units: str | None = None,
    progress: Progress | None = None,
    name: str | None = None,
) -> str:
    """Text of a job file for `drawing`, to be written into `folder`.

    The job is called `name`, or else like the drawing; so are the files that it makes.

    Raises
    ------
    InputError, GeometryError
        If the drawing cannot be read or holds no closed contour.
    """
    drawing = Path(drawing)
    found = inspect(drawing, layers=layers, units=units, progress=progress)
    size, reason = _diameter(found)
    count = len(found["regions"])
    if units is not None:
        units_line = f"units = {json.dumps(units)}"
    else:
        units_line = f'# units = "mm"               # the drawing says {found["units"]}'
    return _TEMPLATE.format(
        count=f"{count} pocket{'s' if count != 1 else ''}",
        file=drawing.name,
        name=json.dumps(_job_name(name or drawing.stem)),
        path=json.dumps(Path(os.path.relpath(drawing, folder)).as_posix()),
        layers=json.dumps(list(layers or found["layers"])),
        units=units_line,
        diameter=size,
        reason=reason,
        stepdown=min(2.0, size / 2),
    )
