"""Judges a program by machining its text: gouge, floor, rest, rapids, engagement, time.

Shares nothing with the planner. Walls and floor are measured exactly, removal on first-cut-time
maps.
"""

from grassfire.verify.clock import Clock
from grassfire.verify.counts import MoveCounts, count_program
from grassfire.verify.judge import verify
from grassfire.verify.model import (
    Fault,
    HeightMap,
    MachineLimits,
    OperationResult,
    Target,
    Tolerances,
    Verification,
)
from grassfire.verify.stock import mesh_file, stock_mesh, stock_png

__all__ = [
    "Clock",
    "Fault",
    "HeightMap",
    "MachineLimits",
    "MoveCounts",
    "OperationResult",
    "Target",
    "Tolerances",
    "Verification",
    "count_program",
    "mesh_file",
    "stock_mesh",
    "stock_png",
    "verify",
]
