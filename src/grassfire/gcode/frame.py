"""Where the program's coordinates lie: offsets that the text sets, and what becomes unknown."""

from __future__ import annotations

import math
from typing import Final

from .track import AXES, Track

Words = dict[str, float]

_NEW_ORIGIN: Final = "write the program about one origin"


class Frame:
    """Offsets of the coordinates on the machine's side of the coordinate system.

    All positions that are told lie in the coordinates that the program begins with. `shift` is what
    G92 and G52 add to the program's words, mm. `blind` is set while words of Z have no known
    meaning: after the cancelling of a tool length that was in force.
    """

    def __init__(self, track: Track) -> None:
        self.track = track
        self.blind = False
        self._set = [0.0, 0.0, 0.0]  # G92
        self._local = [0.0, 0.0, 0.0]  # G52
        self._origin_here = ""  # axes that G92 made known
        self._length: tuple[str, float] | None = None

    @property
    def shift(self) -> tuple[float, float, float]:
        """What to add to words, mm."""
        x, y, z = (first + second for first, second in zip(self._set, self._local, strict=True))
        return x, y, z

    def choose_system(self, system: str) -> None:
        """G54 and the like: another place, after the first move."""
        track = self.track
        if system != track.wcs and not track.untouched:
            track.finding("wcs", f"{system} follows moves in {track.wcs}; both are read alike")
            track.lose(AXES)
        track.wcs = system

    def set_position(self, words: Words, scale: float) -> None:
        """G92: the tool does not move, its coordinates become those of the words."""
        track = self.track
        position = list(track.position)
        for axis, letter in enumerate(AXES):
            if letter not in words:
                continue
            value = words[letter] * scale
            if not math.isnan(position[axis]):
                self._set[axis] = position[axis] - value - self._local[axis]
            elif track.untouched:
                position[axis] = value + self.shift[axis]
                self._origin_here += letter
                track.finding("G92", "G92 sets the origin by where the tool stands then")
            else:
                raise track.error(f"G92 at an unknown position of {letter}", remedy=_NEW_ORIGIN)
        track.stand_at((position[0], position[1], position[2]))

    def cancel_position(self) -> None:
        """G92.1, G92.2: the coordinates of before G92."""
        self._set = [0.0, 0.0, 0.0]
        if self._origin_here:
            self.track.lose(self._origin_here)
        self._origin_here = ""

    def set_local(self, words: Words, scale: float) -> None:
        """G52: an origin inside the coordinate system."""
        if any(self._set) or self._origin_here:
            raise self.track.error("G52 after G92 differs between controllers", remedy=_NEW_ORIGIN)
        for axis, letter in enumerate(AXES):
            if letter in words:
                self._local[axis] = words[letter] * scale

    def store(self, words: Words) -> None:
        """G10: harmless before the first move, or in the table of tools."""
        track = self.track
        number = words.get("L", -1.0)
        if number in (1.0, 10.0, 11.0, 12.0, 13.0):
            track.finding("G10 L1", "G10 sets a tool's offset, which does not change its path")
        elif number in (2.0, 20.0) and track.untouched:
            track.finding("G10", "G10 sets the coordinate system in which the program runs")
            track.lose(AXES)
        else:
            raise track.error(
                "G10 is not read after moves: setting of coordinate systems"
                if number in (2.0, 20.0)
                else "G10 is not read: setting of what is not known",
                remedy=_NEW_ORIGIN,
            )

    # Tool length

    def use_length(self, code: str, value: float) -> None:
        """G43, G43.1, D: Z is not known until it is written, unless this is in force already."""
        if code != "43.1" and self._length == (code, value):
            return
        self._length = (code, value)
        self.blind = False
        self.track.lose("Z")

    def cancel_length(self) -> None:
        """G49, D0: what Z means from then on depends on the length of the tool."""
        if self._length is None:
            return
        self._length = None
        self.blind = True
        self.track.lose("Z")
