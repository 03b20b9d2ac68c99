"""Programs to text, by the data of a post definition."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..toolpath import FloatArray, MoveKind, Program, Section, Toolpath
from .definition import Post
from .rounding import Grid, WrittenMoves, written_moves
from .words import diameter_word, fixed, fold, identifier, marker, program_number, trimmed

_RAPID, _LINE, _ARC_CW = int(MoveKind.RAPID), int(MoveKind.LINE), int(MoveKind.ARC_CW)


def render_program(
    program: Program,
    post: Post,
    *,
    clearance_height: float,
    tolerance: float,
    findings: list[str] | None = None,
) -> str:
    """Write a program as a `Post` says; see `grassfire.post.render`."""
    renderer = Renderer(post, clearance_height, tolerance, [] if findings is None else findings)
    return renderer.program(program)


class Renderer:
    """The text so far and the controller's state behind it."""

    def __init__(
        self, post: Post, clearance_height: float, tolerance: float, findings: list[str]
    ) -> None:
        if not np.isfinite(clearance_height):
            raise InputError("the clearance height is not a finite number", source=post.name)
        self.post = post
        self._scale, self._decimals = post.scale, post.decimals
        self.grid = Grid(post.decimals, post.scale)
        self.tolerance = tolerance
        self.clearance = float(self.grid.nearest(np.array(clearance_height)))
        self.findings = findings
        rapid_feed = post.modality.rapid_feed
        self.rapid_feed = "" if rapid_feed is None else self._feed_word(rapid_feed)
        self.lines: list[str] = []
        # Last words written; None where the controller's state is not known.
        self.position: list[float | None] = [None, None, None]
        self.motion: str | None = None
        self.feed: str | None = None
        self.section: Section | None = None
        # Word that waits for the first block that moves Z.
        self.length_word = ""
        self._widen_tolerance()

    def program(self, program: Program) -> str:
        """All blocks, one text."""
        if not program.sections:
            raise InputError(f"program {program.name!r} has no sections to write")
        if program.wcs not in self.post.wcs:
            raise InputError(
                f"post {self.post.name!r} has no work coordinate system {program.wcs!r}",
                remedy="use one of " + ", ".join(self.post.wcs),
            )
        if self.post.tool_change.split and len({s.tool_number for s in program.sections}) > 1:
            raise InputError(
                f"post {self.post.name!r} changes no tools",
                remedy="write one program for each tool: split_by_tool",
            )
        frame, values = self.post.program, self._program_values(program)
        self._code(frame.opening, values)
        for template in frame.header_comments:
            self._comment(template.format(**values))
        self._code(frame.header, values)
        for section in program.sections:
            self._section(section)
        self._to_clearance()
        self._stop(coolant_only=False)
        self._code(frame.footer, values)
        return "".join(line + "\n" for line in self._numbered())

    def _widen_tolerance(self) -> None:
        """Programs in inches cannot hold positions closer than their last decimal."""
        if self.post.numbers.units == "inch" and self.tolerance < self.grid.step:
            self.findings.append(
                f"in inches with {self.post.decimals} decimals arcs lie within "
                f"{self.grid.step:g} mm of the plan instead of {self.tolerance:g} mm"
            )
            self.tolerance = self.grid.step

    def _program_values(self, program: Program) -> dict[str, str]:
        """What stands for the placeholders of the frame."""
        post = self.post
        return {
            "name": program.name,
            "label": fold(program.name, post.comments) or identifier(program.name),
            "identifier": identifier(program.name),
            "number": program_number(program.name, post.program.number),
            "units": post.units_word,
            "wcs": program.wcs,
            "tolerance": trimmed(self.tolerance / post.scale, 6),
            "clearance_height": self._number(self.clearance),
        }

    # Blocks that are not motions

    def _number(self, value: float, extra: int = 0) -> str:
        """A length in mm as text in the post's units."""
        return fixed(value / self._scale, self._decimals + extra)

    def _is_numbered(self, line: str) -> bool:
        return line[0] not in "(;%O"

    def _numbered(self) -> list[str]:
        numbers, limit = self.post.line_numbers, self.post.program.line_length
        lines: list[str] = []
        count = 0
        for line in self.lines:
            if numbers is not None and self._is_numbered(line):
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
        """After a tool change the controller may be anywhere."""
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
            self._spindle(section, new_tool)
        if new_coolant and section.coolant != "off":
            self._code((self._coolant_word(section),), {})
        if not stays:
            if new_tool and self.post.tool_change.retracted:
                self._across(section.toolpath)
            self._to_clearance()
        self._moves(section.toolpath)

    def _tool(self, section: Section, *, first: bool) -> None:
        change = self.post.tool_change
        values = {
            "tool": str(section.tool_number),
            "diameter": diameter_word(section.tool_diameter),
            "speed": self._speed(section),
        }
        comment = change.first_comment if first else change.next_comment
        if comment:
            self._comment(" ".join(comment.format(**values).replace(" ,", ",").split()))
        self._code(change.first if first else change.next, values)
        self.length_word = change.length.format(**values)

    def _speed(self, section: Section) -> str:
        speed = section.spindle_speed
        if not (np.isfinite(speed) and speed > 0):
            raise InputError(f"section {section.name!r} has no spindle speed")
        return trimmed(speed, self.post.numbers.speed_decimals)

    def _spindle(self, section: Section, new_tool: bool) -> None:
        spindle = self.post.spindle
        lines = spindle.start if new_tool else spindle.change or spindle.start
        self._code(lines, {"speed": self._speed(section)})
        if spindle.spin_up:
            seconds = {
                "seconds": trimmed(spindle.spin_up, 3),
                "milliseconds": trimmed(1000 * spindle.spin_up, 0),
            }
            self._code(spindle.dwell, seconds)

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
        rounded = self.grid.nearest(position)
        return all(
            known is not None and known == value
            for known, value in zip(self.position, rounded.tolist(), strict=True)
        )

    def _to_clearance(self) -> None:
        """Rise (or, from nowhere, go) to the clearance height; stay where the tool is higher."""
        height = self.position[2]
        if height is None or height < self.clearance:
            self._straight(self.post.words.rapid, [None, None, self.clearance], self.rapid_feed)

    def _across(self, toolpath: Toolpath) -> None:
        """From the top of the spindle's travel: go over the first point before the way down."""
        if len(toolpath) and toolpath.kind[0] == MoveKind.RAPID:
            x, y = self.grid.nearest(toolpath.end[0, :2]).tolist()
            if x == x and y == y:
                self._straight(self.post.words.rapid, [x, y, None], self.rapid_feed)

    def _approach(self, toolpath: Toolpath) -> FloatArray:
        """Go to where a section says it starts; returns the position before its first move."""
        start = self.grid.nearest(toolpath.start)
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
        # Arcs are cut by their planned start, so the exact one is kept where there is one.
        if np.array_equal(self.grid.nearest(toolpath.start), start):
            start = toolpath.start
        post = self.post
        moves = written_moves(toolpath, post.arcs, post.decimals, self.tolerance, start, post.scale)
        self._note_arcs(toolpath, moves)
        centre_words = self._centre_words(moves)
        feeds = self._feed_words(moves)
        for row, (kind, end) in enumerate(
            zip(moves.kind.tolist(), moves.end.tolist(), strict=True)
        ):
            if kind == _RAPID:
                self._rapid([None if value != value else value for value in end])
            elif kind == _LINE:
                self._straight(post.words.line, end, feeds[row])
            else:
                self._arc(moves, row, end, centre_words[row], feeds[row])

    def _note_arcs(self, toolpath: Toolpath, moves: WrittenMoves) -> None:
        planned = int(np.count_nonzero(toolpath.is_arc))
        arc = moves.kind >= MoveKind.ARC_CW
        kept = len(np.unique(moves.source[arc]))
        if kept < planned:
            self.findings.append(f"{planned - kept} of {planned} arcs are written as lines")

    def _centre_words(self, moves: WrittenMoves) -> list[str]:
        """I and J, or R, of every arc; empty for straight moves."""
        number, form = self._number, self.post.arcs.form
        arcs = (moves.kind >= MoveKind.ARC_CW).tolist()
        extra = moves.fine.tolist()
        if form == "r":
            return [
                f"R{number(radius, more)}" if arc else ""
                for arc, radius, more in zip(arcs, moves.radius.tolist(), extra, strict=True)
            ]
        origin = moves.begin[:, :2] if form == "ij-incremental" else 0.0
        return [
            f"I{number(first, more)} J{number(second, more)}" if arc else ""
            for arc, (first, second), more in zip(
                arcs, (moves.centre - origin).tolist(), extra, strict=True
            )
        ]

    def _feed_words(self, moves: WrittenMoves) -> list[str]:
        texts: dict[float, str] = {}
        for feed in np.unique(moves.feed[np.isfinite(moves.feed)]).tolist():
            texts[feed] = self._feed_word(feed)
        return [texts.get(feed, "") for feed in moves.feed.tolist()]

    def _feed_word(self, feed: float) -> str:
        """F in units a minute, never 0."""
        decimals = self.post.feed_decimals
        text = trimmed(max(feed / self.post.scale, 10.0**-decimals), decimals)
        return f"F{text}." if self.post.numbers.feed_point and "." not in text else f"F{text}"

    def _rapid(self, end: list[float | None]) -> None:
        """A rapid, in two blocks where it moves across and up or down: never a diagonal."""
        height, target = self.position[2], end[2]
        across = any(
            value is not None and value != known
            for value, known in zip(end[:2], self.position[:2], strict=True)
        )
        if not across or target is None or height is None or target == height:
            self._straight(self.post.words.rapid, end, self.rapid_feed)
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
            self._straight(self.post.words.rapid, part, self.rapid_feed)

    def _straight(self, motion: str, end: list[float | None], feed: str = "") -> None:
        modal = self.post.modality.coordinates
        words = []
        moved = False
        for axis, value in enumerate(end):
            if value is None:
                continue
            if value != self.position[axis]:
                moved = True
            elif modal:
                continue
            words.append(f"{'XYZ'[axis]}{self._number(value)}")
            self.position[axis] = value
        if not moved:
            return
        if self.length_word and end[2] is not None:
            words.insert(0, self.length_word)
            self.length_word = ""
        self._block(motion, words, feed)

    def _arc(self, moves: WrittenMoves, row: int, end: list[float], centre: str, feed: str) -> None:
        motions, helix_word = self.post.words, self.post.arcs.helix_word
        motion = motions.arc_cw if moves.kind[row] == _ARC_CW else motions.arc_ccw
        words = [f"X{self._number(end[0])}", f"Y{self._number(end[1])}"]
        if end[2] != self.position[2]:
            words += [f"Z{self._number(end[2])}", centre, *([helix_word] if helix_word else [])]
        else:
            words.append(centre)
        self.position = [end[0], end[1], end[2]]
        self._block(motion, words, feed)

    def _block(self, motion: str, words: list[str], feed: str) -> None:
        modality = self.post.modality
        if motion != self.motion or not modality.motion:
            words.insert(0, motion)
            self.motion = motion
        if feed and (feed != self.feed or not modality.feed):
            words.append(feed)
            self.feed = feed
        self.lines.append(" ".join(words))
