"""Tool paths from medial axes: what a pocket needs from the first descent to the last wall pass."""

from __future__ import annotations

from grassfire.plan.operation import PlannedOperation, plan_operation

__all__ = ["PlannedOperation", "plan_operation"]
