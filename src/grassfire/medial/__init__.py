"""Medial axis transform of planar regions (Dorado 2009), with a certificate."""

from grassfire.medial.axis import Edge, MedialAxis, medial_axis
from grassfire.medial.certificate import Certificate
from grassfire.medial.offset import OffsetNode

__all__ = ["Certificate", "Edge", "MedialAxis", "OffsetNode", "medial_axis"]
