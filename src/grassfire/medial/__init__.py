"""Medial axis transform of planar regions (Dorado 2009), with a certificate."""

from grassfire.medial.axis import Edge, MedialAxis, medial_axis
from grassfire.medial.certificate import Certificate
from grassfire.medial.offset import OffsetNode
from grassfire.medial.parts import AxisGraph
from grassfire.medial.queries import Nearest
from grassfire.medial.trimmed import TrimmedOffset
from grassfire.medial.ways import AxisPath

__all__ = [
    "AxisGraph",
    "AxisPath",
    "Certificate",
    "Edge",
    "MedialAxis",
    "Nearest",
    "OffsetNode",
    "TrimmedOffset",
    "medial_axis",
]
