"""Default tolerances, each with its unit. They are arguments everywhere, never globals."""

from __future__ import annotations

from typing import Final

CHAINING: Final = 0.01
"""Gap between curve ends that the DXF reader closes, in mm."""

MEDIAL: Final = 1e-6
"""Accuracy of the medial axis transform, in mm."""

ANGULAR: Final = 1e-4
"""Turn below which a junction of two curves counts as smooth, in radians."""

MACHINING: Final = 0.002
"""How far a tool path may deviate from the exact curve, in mm."""

FITTING: Final = 2e-4
"""How far a pocket may be too narrow for the tool and still count as just wide enough, in mm."""
