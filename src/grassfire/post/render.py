"""Programs to text, by the data of a post definition."""

from __future__ import annotations

import unicodedata

import numpy as np

from ..errors import InputError
from ..toolpath import FloatArray, MoveKind, Program, Section, Toolpath
from .definition import Comments, Post
from .rounding import WrittenMoves, written_moves

_ARC_KINDS = (int(MoveKind.ARC_CW), int(MoveKind.ARC_CCW))


def fixed(value: float, decimals: int) -> str:
    """A number with a fixed count of decimals: no exponent, no negative zero."""
    text = f"{value:.{decimals}f}"
    return text[1:] if text.startswith("-") and not text.strip("-0.") else text


def trimmed(value: float, decimals: int) -> str:
    """A number with at most so many decimals, without trailing zeros."""
    text = fixed(value, decimals)
    return text.rstrip("0").rstrip(".") if "." in text else text


def fold(text: str, comments: Comments) -> str:
    """Comment text in the characters that a controller bears, cut to its length."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode("ascii")
    forbidden = set(comments.forbidden) | set("()")
    kept = "".join(
        " " if character in forbidden or not character.isprintable() else character
        for character in plain
    )
    kept = " ".join(kept.split())[: comments.max_length].rstrip()
    return kept.upper() if comments.upper_case else kept


def diameter_word(diameter: float) -> str:
    """`D6`, or nothing where the diameter is not known."""
    return f"D{trimmed(diameter, 4)}" if np.isfinite(diameter) else ""


def marker(section: Section, comments: Comments) -> str:
    """Text of the comment that opens a section: `operation 1: offset, tool 1 D6`.

    Operations are counted from 1 in text; 0 stands for one that is not known. A long name is cut
    so that the tool stays readable.
    """
    head = f"operation {section.operation + 1}"
    tail = f", tool {section.tool_number} {diameter_word(section.tool_diameter)}".rstrip()
    name = fold(section.name, comments)[: max(0, comments.max_length - len(head) - len(tail) - 2)]
    return head + (f": {name.rstrip()}" if name else "") + tail


def render_program(
    program: Program,
    post: Post,
    *,
    clearance_height: float,
    tolerance: float,
    findings: list[str] | None = None,
) -> str:
    """Write a program as a `Post` says; see `grassfire.post.render`."""
    renderer = _Renderer(post, clearance_height, tolerance, [] if findings is None else findings)
    return renderer.program(program)


class _Renderer:
    """The text so far and the controller's state behind it."""

    def __init__(
        self, post: Post, clearance_height: float, tolerance: float, findings: list[str]
    ) -> None:
        if not np.isfinite(clearance_height):
            raise InputError("the clearance height is not a finite number", source=post.name)
        self.post = post
        self.tolerance = tolerance
        self.clearance = round(float(clearance_height), post.numbers.decimals) + 0.0
        self.findings = findings
        self.lines: list[str] = []
        # Last words written; None where the controller's state is not known.
        self.position: list[float | None] = [None, None, None]
        self.motion: str | None = None
        self.feed: str | None = None
        self.section: Section | None = None

    def program(self, program: Program) -> str:
        """All blocks, one text."""
        if not program.sections:
            raise InputError(f"program {program.name!r} has no sections to write")
        if program.wcs not in self.post.wcs:
            raise InputError(
                f"post {self.post.name!r} has no work coordinate system {program.wcs!r}",
                remedy="use one of " + ", ".join(self.post.wcs),
            )
        frame = self.post.program
        values = {
            "name": program.name,
            "wcs": program.wcs,
            "tolerance": trimmed(self.tolerance, 6),
            "clearance_height": fixed(self.clearance, self.post.numbers.decimals),
        }
        for template in frame.header_comments:
            self._comment(template.format(**values))
        self._code(frame.header, values)
        for section in program.sections:
            self._section(section)
        self._to_clearance()
        self._stop(coolant_only=False)
        self._code(frame.footer, values)
        return "".join(line + "\n" for line in self._numbered())

    # Blocks that are not motions

    def _numbered(self) -> list[str]:
        numbers, limit = self.post.line_numbers, self.post.program.line_length
        lines: list[str] = []
        count = 0
        for line in self.lines:
            if numbers is not None and line[0] not in "(;%":
                line = f"{numbers.word}{numbers.start + numbers.step * count} {line}"
                count += 1
            if len(line) > limit:
                raise InputError(
                    f"line {len(lines) + 1} has {len(line)} characters, {self.post.name!r} takes "
                    f"{limit}: {line[:40]}..."
                )
            lines.append(line)
        return lines

    def _comment(self, text: str) -> None:
        comments = self.post.comments
        folded = fold(text, comments)
        plain = " ".join(text.upper().split())
        if folded.upper() != plain and comments.style != "none":
            self.findings.append(f"comment {text!r} is written as {folded!r}")
        if not folded or comments.style == "none":
            return
        self.lines.append(f"({folded})" if comments.style == "parentheses" else f"; {folded}")

    def _code(self, templates: tuple[str, ...], values: dict[str, str]) -> None:
        for template in templates:
            line = " ".join(template.format(**values).split())
            word = self.post.refused_word(line)
            if word:
                raise InputError(f"post {self.post.name!r} refuses {word}: {line}")
            if line:
                self.lines.append(line)

    def _stop(self, *, coolant_only: bool) -> None:
        if self.section is None:
            return
        if not coolant_only:
            self._code(self.post.spindle.stop, {})
        if self.section.coolant != "off":
            self._code((self.post.coolant.off,), {})

    def _forget_position(self) -> None:
        self.position = [None, None, None]
        self.motion = self.feed = None

    # Sections

    def _section(self, section: Section) -> None:
        """Marker, tool, spindle, coolant, safe start and moves of one section."""
        last = self.section
        new_tool = last is None or section.tool_number != last.tool_number
        new_speed = new_tool or last is None or section.spindle_speed != last.spindle_speed
        new_coolant = new_tool or last is None or section.coolant != last.coolant
        stays = not (new_tool or new_speed or new_coolant) and self._is_at(section.toolpath.start)
        if last is not None and not stays:
            self._to_clearance()
        if new_tool:
            self._stop(coolant_only=False)
        elif new_coolant:
            self._stop(coolant_only=True)
        self._comment(marker(section, self.post.comments))
        if new_tool:
            self._tool(section, first=last is None)
            self._forget_position()
        self.section = section
        if new_speed:
            self._spindle(section)
        if new_coolant and section.coolant != "off":
            self._code((self._coolant_word(section),), {})
        if not stays:
            self._to_clearance()
        self._moves(section.toolpath)

    def _tool(self, section: Section, *, first: bool) -> None:
        change = self.post.tool_change
        values = {
            "tool": str(section.tool_number),
            "diameter": diameter_word(section.tool_diameter),
        }
        comment = change.first_comment if first else change.next_comment
        if comment:
            self._comment(" ".join(comment.format(**values).replace(" ,", ",").split()))
        self._code(change.first if first else change.next, values)

    def _spindle(self, section: Section) -> None:
        speed = section.spindle_speed
        if not (np.isfinite(speed) and speed > 0):
            raise InputError(f"section {section.name!r} has no spindle speed")
        words = {"speed": trimmed(speed, self.post.numbers.speed_decimals)}
        self._code(self.post.spindle.start, words)

    def _coolant_word(self, section: Section) -> str:
        words = self.post.coolant.model_dump()
        word = str(words.get(section.coolant, ""))
        if not word:
            known = ", ".join(kind for kind, text in words.items() if text)
            raise InputError(
                f"post {self.post.name!r} has no coolant {section.coolant!r}",
                remedy=f"use one of {known}",
            )
        return word

    # Motions

    def _is_at(self, position: FloatArray) -> bool:
        rounded = np.round(position, self.post.numbers.decimals)
        return all(
            known is not None and known == value
            for known, value in zip(self.position, rounded.tolist(), strict=True)
        )

    def _to_clearance(self) -> None:
        """Rise (or, from nowhere, go) to the clearance height; stay where the tool is higher."""
        height = self.position[2]
        if height is None or height < self.clearance:
            self._straight(self.post.words.rapid, [None, None, self.clearance])

    def _approach(self, toolpath: Toolpath) -> FloatArray:
        """Go to where a section says it starts; returns the position before its first move."""
        decimals = self.post.numbers.decimals
        start = np.round(toolpath.start, decimals) + 0.0
        here = np.array([np.nan if value is None else value for value in self.position])
        if toolpath.kind[0] == MoveKind.RAPID or self._is_at(start):
            return here
        if not np.isfinite(start).all():
            raise InputError("a section begins with a cutting move from an unknown position")
        if start[2] < self.clearance and not (start[2] == here[2]):
            raise InputError(
                "a section begins with a cutting move below the clearance height, where the tool "
                "is not",
                place=start.tolist(),
            )
        self._rapid(start.tolist())
        return start

    def _moves(self, toolpath: Toolpath) -> None:
        if not len(toolpath):
            return
        start = self._approach(toolpath)
        numbers = self.post.numbers
        # Arcs are cut by their planned start, so the exact one is kept where there is one.
        if np.array_equal(np.round(toolpath.start, numbers.decimals) + 0.0, start):
            start = toolpath.start
        moves = written_moves(toolpath, self.post.arcs, numbers.decimals, self.tolerance, start)
        self._note_arcs(toolpath, moves)
        words = self.post.words
        arc_words = {_ARC_KINDS[0]: words.arc_cw, _ARC_KINDS[1]: words.arc_ccw}
        centre_words = self._centre_words(moves)
        feeds = self._feed_words(moves)
        rapid = int(MoveKind.RAPID)
        for kind, end, feed, centre in zip(
            moves.kind.tolist(), moves.end.tolist(), feeds, centre_words, strict=True
        ):
            if kind == rapid:
                self._rapid([None if value != value else value for value in end])
            elif kind in arc_words:
                self._arc(arc_words[kind], end, centre, feed)
            else:
                self._straight(words.line, end, feed)

    def _note_arcs(self, toolpath: Toolpath, moves: WrittenMoves) -> None:
        planned = int(np.count_nonzero(toolpath.is_arc))
        arc = moves.kind >= MoveKind.ARC_CW
        kept = len(np.unique(moves.source[arc]))
        if kept < planned:
            self.findings.append(f"{planned - kept} of {planned} arcs are written as lines")

    def _centre_words(self, moves: WrittenMoves) -> list[str]:
        """I and J, or R, of every arc; empty for straight moves."""
        decimals, form = self.post.numbers.decimals, self.post.arcs.form
        arcs = (moves.kind >= MoveKind.ARC_CW).tolist()
        places = (decimals + moves.fine).tolist()
        if form == "r":
            return [
                f"R{fixed(radius, place)}" if arc else ""
                for arc, radius, place in zip(arcs, moves.radius.tolist(), places, strict=True)
            ]
        origin = moves.begin[:, :2] if form == "ij-incremental" else 0.0
        return [
            f"I{fixed(first, place)} J{fixed(second, place)}" if arc else ""
            for arc, (first, second), place in zip(
                arcs, (moves.centre - origin).tolist(), places, strict=True
            )
        ]

    def _feed_words(self, moves: WrittenMoves) -> list[str]:
        decimals = self.post.numbers.feed_decimals
        texts: dict[float, str] = {}
        for feed in np.unique(moves.feed[np.isfinite(moves.feed)]).tolist():
            texts[feed] = f"F{trimmed(max(feed, 10.0**-decimals), decimals)}"
        return [texts.get(feed, "") for feed in moves.feed.tolist()]

    def _rapid(self, end: list[float | None]) -> None:
        """A rapid, in two blocks where it moves across and up or down: never a diagonal."""
        height, target = self.position[2], end[2]
        across = any(
            value is not None and value != known
            for value, known in zip(end[:2], self.position[:2], strict=True)
        )
        if not across or target is None or height is None or target == height:
            self._straight(self.post.words.rapid, end)
            return
        if max(height, target) < self.clearance:
            raise InputError(
                f"a rapid moves across and from z {height:g} to {target:g} at once below the "
                f"clearance height {self.clearance:g}",
                place=[float("nan") if value is None else value for value in end],
                remedy="plan the rise, the way across and the descent as moves of their own",
            )
        upright: list[float | None] = [None, None, target]
        level: list[float | None] = [end[0], end[1], None]
        for part in (upright, level) if target > height else (level, upright):
            self._straight(self.post.words.rapid, part)

    def _straight(self, motion: str, end: list[float | None], feed: str = "") -> None:
        decimals, modal = self.post.numbers.decimals, self.post.modality.coordinates
        words = []
        moved = False
        for axis, value in enumerate(end):
            if value is None:
                continue
            if value != self.position[axis]:
                moved = True
            elif modal:
                continue
            words.append(f"{'XYZ'[axis]}{fixed(value, decimals)}")
            self.position[axis] = value
        if moved:
            self._block(motion, words, feed)

    def _arc(self, motion: str, end: list[float], centre: str, feed: str) -> None:
        decimals = self.post.numbers.decimals
        words = [f"X{fixed(end[0], decimals)}", f"Y{fixed(end[1], decimals)}"]
        if end[2] != self.position[2]:
            words.append(f"Z{fixed(end[2], decimals)}")
        self.position = [end[0], end[1], end[2]]
        self._block(motion, [*words, centre], feed)

    def _block(self, motion: str, words: list[str], feed: str) -> None:
        modality = self.post.modality
        if motion != self.motion or not modality.motion:
            words.insert(0, motion)
            self.motion = motion
        if feed and (feed != self.feed or not modality.feed):
            words.append(feed)
            self.feed = feed
        self.lines.append(" ".join(words))
