"""Cuts with the stock on the right of the travel, or on its left: the same traced in a mirror."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from grassfire.plan.chains import Writer
from grassfire.plan.path import Path
from grassfire.plan.places import BoolArray, IntArray
from grassfire.plan.tracing import Piece, Start, Surroundings, Tracer
from grassfire.plan.walls import mirrored, mirrored_path
from grassfire.toolpath import FloatArray


class Cut(NamedTuple):
    """A cut in the frame of fronts whose stock is on their right.

    Attributes
    ----------
    pieces : list of Piece
        In the frame of its tracer.
    begin : (2,) float array or None
        Where it begins, mm; None without length.
    points : (n, 2) float array
        Samples of it, mm.
    heading : (n,) float array
        Direction of travel there, radians.
    room : (n,) float array
        Clearance beyond that of the wall, mm.
    """

    pieces: list[Piece]
    begin: FloatArray | None
    points: FloatArray
    heading: FloatArray
    room: FloatArray


class Sense:
    """Traces cuts along fronts in one sense.

    Fronts have their stock on the right. A cut against their direction is one along their image in
    the x axis, where right and left have changed places.

    Parameters
    ----------
    tracer : Tracer
        With the walls of the frame, or of its image.
    writer : Writer
        With the same.
    against : bool
        Whether cuts run against the direction of their fronts, with the stock on their left.
    """

    def __init__(self, tracer: Tracer, writer: Writer, against: bool) -> None:
        self._tracer = tracer
        self._writer = writer
        self.against = against

    def start(
        self, front: FloatArray, wall: float, free: Callable[[FloatArray], BoolArray]
    ) -> Start:
        """Where to begin a cut along a front; the sample is one of the tracer's walls."""
        if not self.against:
            return self._tracer.start(front, wall, free)
        found = self._tracer.start(_image(front), wall, lambda places: free(mirrored(places)))
        return _reflected(found)

    def spiral(self, front: FloatArray, room: float, tail: Callable[[FloatArray], int]) -> Cut:
        """From a closed front outwards: see `Tracer.spiral`; only in the direction of fronts."""
        return self._cut(self._tracer.spiral(front, room, tail))

    def cut(self, front: FloatArray, start: Start, beside: Surroundings) -> Cut:
        """Along an open front from its start, or from its end backwards, among others."""
        if not self.against:
            return self._cut(self._tracer.cut(front, start, beside))
        return self._cut(self._tracer.cut(_image(front), _reflected(start), beside.mirrored()))

    def led(self, cut: Cut, place: FloatArray) -> Cut:
        """A cut that begins where the tool is, if that is hardly a step before it."""
        own = mirrored(place) if self.against else place
        first = next((row for row, piece in enumerate(cut.pieces) if piece.long), None)
        if first is None or not self._writer.leads(cut.pieces[first], own):
            return cut
        pieces = list(cut.pieces[first:])
        pieces[0] = replace(pieces[0], origin=own)
        return cut._replace(
            pieces=pieces,
            begin=place,
            points=np.concatenate([place[None], cut.points]),
            heading=np.concatenate([cut.heading[:1], cut.heading]),
            room=np.concatenate([cut.room[:1], cut.room]),
        )

    def paths(self, cuts: Sequence[Cut]) -> list[Path | None]:
        """Cuts that have a length, as they are machined: see `Writer.paths`."""
        paths = self._writer.paths([cut.pieces for cut in cuts])
        if not self.against:
            return paths
        return [None if path is None else mirrored_path(path) for path in paths]

    def _cut(self, pieces: list[Piece]) -> Cut:
        begin = self._tracer.begin(pieces)
        if not pieces:
            return Cut(pieces, begin, np.zeros((0, 2)), np.zeros(0), np.zeros(0))
        points = np.concatenate([piece.points for piece in pieces])
        heading = np.concatenate([piece.heading for piece in pieces])
        room = np.concatenate([piece.room for piece in pieces])
        if not self.against:
            return Cut(pieces, begin, points, heading, room)
        image = None if begin is None else mirrored(begin)
        return Cut(pieces, image, mirrored(points), -heading, room)


def swept_side(
    points: FloatArray,
    swept: Callable[[FloatArray], tuple[FloatArray, IntArray]],
    against: bool,
) -> tuple[FloatArray, IntArray]:
    """Edge of what was swept along a way of the frame, stock on its right, and its pieces.

    `swept` makes it of a way with the stock on the right; `against` says that it is on the left.
    """
    if not against:
        return swept(points)
    found, piece = swept(mirrored(points))
    return _image(found), piece[::-1]


def _image(chain: FloatArray) -> FloatArray:
    """A chain with its stock on the right in the mirror, where it runs the other way."""
    return mirrored(chain)[::-1]


def _reflected(start: Start) -> Start:
    return start._replace(point=mirrored(start.point), heading=-start.heading)
