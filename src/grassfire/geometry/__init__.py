"""Exact planar curves, loops and regions: NumPy, SciPy and pykdtree only.

Every curve runs over t in [0, 1], is vectorised over t, immutable, in millimetres and radians.
"""

from grassfire.geometry.arc import Arc
from grassfire.geometry.arcfit import deviation_from, fit_arcs
from grassfire.geometry.batch import CurveBatch
from grassfire.geometry.bezier import Bezier
from grassfire.geometry.bspline import BSpline
from grassfire.geometry.curve import Bounds, Curve
from grassfire.geometry.elliptical_arc import EllipticalArc
from grassfire.geometry.features import (
    curvature_extrema,
    cusps,
    inflections,
    split_at_corners,
)
from grassfire.geometry.flatten import flatten, flatten_parameters
from grassfire.geometry.line import Line
from grassfire.geometry.loop import CONVEX, REFLEX, SMOOTH, JunctionTable, Loop
from grassfire.geometry.parallel import ParallelCurve, parallel
from grassfire.geometry.polyline import fit_open_polyline, fit_polyline, fit_region
from grassfire.geometry.region import Region
from grassfire.geometry.simplify import simplify

__all__ = [
    "CONVEX",
    "REFLEX",
    "SMOOTH",
    "Arc",
    "BSpline",
    "Bezier",
    "Bounds",
    "Curve",
    "CurveBatch",
    "EllipticalArc",
    "JunctionTable",
    "Line",
    "Loop",
    "ParallelCurve",
    "Region",
    "curvature_extrema",
    "cusps",
    "deviation_from",
    "fit_arcs",
    "fit_open_polyline",
    "fit_polyline",
    "fit_region",
    "flatten",
    "flatten_parameters",
    "inflections",
    "parallel",
    "simplify",
    "split_at_corners",
]
