"""Judges a program by machining its text: gouge, floor, rest, rapids, engagement, time.

Shares nothing with the planner. Walls and floor are measured exactly, removal on first-cut-time
maps.
"""

from grassfire.verify.counts import MoveCounts, count_program
from grassfire.verify.judge import verify
from grassfire.verify.model import Fault, HeightMap, OperationResult, Target, Verification

__all__ = [
    "Fault",
    "HeightMap",
    "MoveCounts",
    "OperationResult",
    "Target",
    "Verification",
    "count_program",
    "verify",
]
