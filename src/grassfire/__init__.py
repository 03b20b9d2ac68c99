"""Verified pocket milling from DXF by way of the exact medial axis transform.

The names below are the public interface; each is imported when it is first used, so that
``import grassfire`` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from grassfire.app import RunResult, inspect, mat, run
    from grassfire.dxf import Drawing, read_regions, write_medial_axis
    from grassfire.errors import (
        GeometryError,
        GrassfireError,
        InputError,
        PlanningError,
        VerificationError,
    )
    from grassfire.gcode import read_program
    from grassfire.geometry import Loop, Region
    from grassfire.job import Job, Operation, Tool, load_job
    from grassfire.medial import MedialAxis, medial_axis
    from grassfire.plan import plan_operation
    from grassfire.post import find_posts, load_post, render
    from grassfire.toolpath import MoveKind, Program, Role, Section, Toolpath
    from grassfire.verify import verify as verify_program

__version__: Final = "0.1.0"

_HOME: Final[dict[str, str]] = {
    "Drawing": "dxf",
    "GeometryError": "errors",
    "GrassfireError": "errors",
    "InputError": "errors",
    "Job": "job",
    "Loop": "geometry",
    "MedialAxis": "medial",
    "MoveKind": "toolpath",
    "Operation": "job",
    "PlanningError": "errors",
    "Program": "toolpath",
    "Region": "geometry",
    "Role": "toolpath",
    "RunResult": "app",
    "Section": "toolpath",
    "Tool": "job",
    "Toolpath": "toolpath",
    "VerificationError": "errors",
    "find_posts": "post",
    "inspect": "app",
    "load_job": "job",
    "load_post": "post",
    "mat": "app",
    "medial_axis": "medial",
    "plan_operation": "plan",
    "read_program": "gcode",
    "read_regions": "dxf",
    "render": "post",
    "run": "app",
    "verify_program": "verify",
    "write_medial_axis": "dxf",
}

__all__ = [
    "Drawing",
    "GeometryError",
    "GrassfireError",
    "InputError",
    "Job",
    "Loop",
    "MedialAxis",
    "MoveKind",
    "Operation",
    "PlanningError",
    "Program",
    "Region",
    "Role",
    "RunResult",
    "Section",
    "Tool",
    "Toolpath",
    "VerificationError",
    "find_posts",
    "inspect",
    "load_job",
    "load_post",
    "mat",
    "medial_axis",
    "plan_operation",
    "read_program",
    "read_regions",
    "render",
    "run",
    "verify_program",
    "write_medial_axis",
]


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"{__name__}.{_HOME[name]}")
    # `verify` is the name of a module too; the function needs another one at the top.
    value = getattr(module, "verify" if name == "verify_program" else name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
