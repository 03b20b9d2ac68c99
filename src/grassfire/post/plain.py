"""Programs to Heidenhain's plain language: L, CC, C and CP blocks in place of G-code words."""

from __future__ import annotations

import math

from ..toolpath import Program
from .definition import Post
from .render import Renderer
from .rounding import WrittenMoves
from .words import fixed

# What controls take (TNC 640, user's manual: angle of CP, 4 places before and after the point);
# half of the last decimal is 0.0001 mm at a radius of 100 mm.
_ANGLE_DECIMALS = 4
# A centre is written with one decimal more where it would lead this far beside the end, in units of
# the last decimal. A centre on that finer grid leads at most 0.15 units beside.
_BESIDE = 0.1


def render_plain_language(
    program: Program,
    post: Post,
    *,
    clearance_height: float,
    tolerance: float,
    findings: list[str] | None = None,
) -> str:
    """Write a program in plain language; see `grassfire.post.render`."""
    notes = [] if findings is None else findings
    return _PlainLanguage(post, clearance_height, tolerance, notes).program(program)


class _PlainLanguage(Renderer):
    """Blocks with signed numbers; every arc names its centre before.

    A helix is given by its angle (CP IPA), so its end is where the control computes it: on the
    circle through its start. `turned` keeps that point; the next helix has its centre on the
    bisector between it and the planned end, its angle is measured from it, and the next block
    with X and Y is exact again, so that errors do not add up.
    """

    def __init__(
        self, post: Post, clearance_height: float, tolerance: float, findings: list[str]
    ) -> None:
        super().__init__(post, clearance_height, tolerance, findings)
        self.turned: tuple[float, float] | None = None
        self.pole: str | None = None

    def _number(self, value: float, extra: int = 0) -> str:
        text = super()._number(value, extra)
        return text if text.startswith("-") else f"+{text}"

    def _is_numbered(self, line: str) -> bool:
        return True

    def _feed_word(self, feed: float) -> str:
        """F, which counts tenths of an inch a minute in programs in inches."""
        return super()._feed_word(10 * feed if self.post.scale != 1.0 else feed)

    def _forget_position(self) -> None:
        super()._forget_position()
        self.turned = self.pole = None

    def _centre_words(self, moves: WrittenMoves) -> list[str]:
        """The block that sets the centre of every arc."""
        return [words.replace("I", "CC X", 1).replace("J", "Y", 1)
                for words in super()._centre_words(moves)]  # fmt: skip

    def _straight(self, motion: str, end: list[float | None], feed: str = "") -> None:
        rapid = motion == self.post.words.rapid
        across = any(
            value is not None and value != known
            for value, known in zip(end[:2], self.position[:2], strict=True)
        )
        words = []
        for axis, value in enumerate(end):
            # The control is a little beside the end of a helix: say where X and Y are.
            beside = self.turned is not None and axis < 2 and (across or not rapid)
            if value is not None and (value != self.position[axis] or beside):
                words.append(f"{'XYZ'[axis]}{self._number(value)}")
                self.position[axis] = value
        if not words:
            return
        if any(word.startswith("X") for word in words):
            self.turned = None
        if rapid:
            self.lines.append(" ".join([self.post.words.line, *words, "R0", motion]))
        else:
            self._block(motion, words, feed)

    def _arc(self, moves: WrittenMoves, row: int, end: list[float], centre: str, feed: str) -> None:
        sweep = float(moves.sweep[row])
        direction = self.post.words.arc_ccw if sweep > 0 else self.post.words.arc_cw
        if end[2] == self.position[2]:
            self._pole(centre)
            words = [f"X{self._number(end[0])}", f"Y{self._number(end[1])}", direction]
            self.turned = None
            self._block("C", words, feed)
        else:
            begin = self.turned or (float(moves.begin[row, 0]), float(moves.begin[row, 1]))
            centre, around = self._helix_centre(begin, end, moves.centre[row].tolist(), centre)
            self._pole(centre)
            angle = self._turn(begin, end, around, sweep)
            words = [f"IPA{angle}", f"Z{self._number(end[2])}", direction]
            self._block("CP", words, feed)
        self.position = [end[0], end[1], end[2]]

    def _pole(self, centre: str) -> None:
        if centre != self.pole:
            self.lines.append(centre)
            self.pole = centre

    def _helix_centre(
        self, begin: tuple[float, float], end: list[float], centre: list[float], text: str
    ) -> tuple[str, list[float]]:
        """Centre of a helix, as text and mm, whose circle through `begin` passes the end.

        `centre` itself if it does; else it moves along the chord onto the bisector, and of the
        finer grid's four points around that place the one with the least difference of radii is
        taken.
        """
        fine = self.grid.finer(1)
        if abs(math.dist(begin, centre) - math.dist(end[:2], centre)) <= _BESIDE * self.grid.step:
            return text, centre
        chord = (end[0] - begin[0], end[1] - begin[1])
        middle = ((begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2)
        along = (centre[0] - middle[0]) * chord[0] + (centre[1] - middle[1]) * chord[1]
        along /= chord[0] ** 2 + chord[1] ** 2
        ideal = [value - along * side for value, side in zip(centre, chord, strict=True)]
        corner = [math.floor(value / fine.step) for value in ideal]
        candidates = [
            ((corner[0] + right) * fine.step, (corner[1] + up) * fine.step)
            for right in (0, 1)
            for up in (0, 1)
        ]
        best = min(
            candidates,
            key=lambda place: (
                abs(math.dist(begin, place) - math.dist(end[:2], place)) + math.dist(place, ideal)
            ),
        )
        words = f"CC X{self._number(best[0], 1)} Y{self._number(best[1], 1)}"
        return words, list(best)

    def _turn(
        self, begin: tuple[float, float], end: list[float], centre: list[float], sweep: float
    ) -> str:
        """Angle from where the control is towards an end, degrees; notes where that leads."""
        spoke = (begin[0] - centre[0], begin[1] - centre[1])
        start = math.atan2(spoke[1], spoke[0])
        turn = math.atan2(end[1] - centre[1], end[0] - centre[0]) - start
        turn += 2 * math.pi * round((sweep - turn) / (2 * math.pi))
        text = fixed(math.degrees(turn), _ANGLE_DECIMALS)
        angle, radius = start + math.radians(float(text)), math.hypot(*spoke)
        self.turned = (
            centre[0] + radius * math.cos(angle),
            centre[1] + radius * math.sin(angle),
        )
        return text if text.startswith("-") else f"+{text}"

    def _block(self, motion: str, words: list[str], feed: str) -> None:
        """A block of its own word; the feed is modal and outlives rapids."""
        if feed and feed != self.feed:
            words.append(feed)
            self.feed = feed
        self.lines.append(" ".join([motion, *words]))
