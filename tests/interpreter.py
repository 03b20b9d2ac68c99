"""LinuxCNC's interpreter as a second reader: how to run it, and programs that it takes."""

from __future__ import annotations

import json
import math
import os
import random
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

CHECKER = Path(__file__).resolve().parents[2] / "shared" / "tools" / "rs274_check.py"
HOW_TO_GET = (
    "LinuxCNC's interpreter is not here: apt-get install --no-install-recommends linuxcnc-uspace, "
    "or unpack that package and set LCNC_ROOT to the folder"
)


def present() -> bool:
    """Whether the interpreter and the script that runs it are there."""
    root = os.environ.get("LCNC_ROOT", "")
    found = Path(root, "usr/bin/rs274").exists() if root else shutil.which("rs274") is not None
    return found and CHECKER.exists()


def judged_moves(text: str, folder: Path) -> list[dict[str, Any]]:
    """Moves that the interpreter makes of a program, in mm; an assertion if it refuses it."""
    path = folder / "program.ngc"
    path.write_text(text)
    done = subprocess.run([str(CHECKER), str(path)], capture_output=True, text=True, check=False)
    answer = json.loads(done.stdout)
    assert answer["ok"] and "moves" in answer, (answer, text)
    return list(answer["moves"])


SPEED = 1200  # 1/min, where the feed is per turn


@dataclass
class Writer:
    """Writes random legal blocks; knows where the tool is, so that arcs are arcs."""

    chance: random.Random
    lines: list[str] = field(default_factory=list)
    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    unit: float = 1.0
    absolute: bool = True
    centre_absolute: bool = False
    plane: str = "G17"
    motion: str = "G0"
    lines_per_turn: list[int] = field(default_factory=list)  # their feeds are told per turn

    def program(self, blocks: int) -> str:
        """A program of about so many blocks."""
        self.lines += ["%", "(random)", "G21 G90 G91.1 G17 G94 G54 G40 G49 G80", "S1000 M3"]
        self.lines += ["G0 X0 Y0 Z20", "G1 X1 F500"]
        self.position, self.motion = [1.0, 0.0, 20.0], "G1"
        kinds = (
            (self.straight, 8), (self.arc, 8), (self.by_radius, 4), (self.modes, 4),
            (self.drill, 2), (self.feeds, 2), (self.talk, 1), (self.inverse, 1), (self.per_turn, 1),
        )  # fmt: skip
        for _ in range(blocks):
            self.chance.choices([kind for kind, _ in kinds], [weight for _, weight in kinds])[0]()
        return "\n".join([*self.lines, "M2", "%", ""])

    def number(self, value: float) -> str:
        text = self.chance.choice((f"{value:.6f}", f"{value:+.6f}", f"{value:.7f}"))
        return self.chance.choice((text, text.rstrip("0")))

    def word(self, axis: int, target: float) -> str:
        """The word that leads to `target` mm on an axis; the position becomes what it says."""
        value = (target - (0.0 if self.absolute else self.position[axis])) / self.unit
        text = self.number(value)
        base = 0.0 if self.absolute else self.position[axis]
        self.position[axis] = base + float(text) * self.unit
        return f"{'XYZ'[axis]}{text}"

    def block(self, motion: str, words: list[str]) -> None:
        if motion != self.motion or self.chance.random() < 0.5:
            words.insert(self.chance.randint(0, len(words)), motion.replace("G", "G0"))
        self.motion = motion
        self.chance.shuffle(words)
        text = self.chance.choice(("", " ")).join(words)
        text = self.chance.choice((text, text.lower(), f"N{len(self.lines)} {text}"))
        self.lines.append(text + self.chance.choice(("", "", " (why)", " ; so", "\t")))

    def somewhere(self) -> float:
        return self.chance.uniform(-50, 50)

    def straight(self) -> None:
        axes = self.chance.sample(range(3), self.chance.randint(1, 3))
        words = [self.word(axis, self.somewhere()) for axis in axes]
        self.block(self.chance.choice(("G0", "G1", "G1")), words)

    def arc(self) -> None:
        first, second, third = {"G17": (0, 1, 2), "G18": (2, 0, 1), "G19": (1, 2, 0)}[self.plane]
        start = (self.position[first], self.position[second])
        radius = math.exp(self.chance.uniform(math.log(0.05), math.log(200)))
        angle = self.chance.uniform(-math.pi, math.pi)
        counter = self.chance.random() < 0.5
        sweep = self.chance.choice(
            (math.pi / 2, 2 * math.pi, self.chance.uniform(0.1, 6.2), self.chance.uniform(6, 6.28))
        ) * (1 if counter else -1)  # fmt: skip
        centre = (start[0] - radius * math.cos(angle), start[1] - radius * math.sin(angle))
        origin = (0.0, 0.0) if self.centre_absolute else start
        letters = {"G17": "IJ", "G18": "KI", "G19": "JK"}[self.plane]
        words = [
            f"{letter}{self.number((value - base) / self.unit)}"
            for letter, value, base in zip(letters, centre, origin, strict=True)
        ]
        if abs(sweep) < 6.283:
            words.append(self.word(first, centre[0] + radius * math.cos(angle + sweep)))
            words.append(self.word(second, centre[1] + radius * math.sin(angle + sweep)))
        if self.chance.random() < 0.4:
            words.append(self.word(third, self.somewhere()))
        if self.chance.random() < 0.2:
            words.append(f"P{self.chance.randint(1, 4)}")
        self.block("G3" if counter else "G2", words)

    def by_radius(self) -> None:
        first, second, third = {"G17": (0, 1, 2), "G18": (2, 0, 1), "G19": (1, 2, 0)}[self.plane]
        start = (self.position[first], self.position[second])
        words = [self.word(first, self.somewhere()), self.word(second, self.somewhere())]
        chord = math.dist(start, (self.position[first], self.position[second]))
        radius = chord * self.chance.uniform(0.51, 3) * self.chance.choice((1, -1))
        words.append(f"R{self.number(radius / self.unit)}")
        if self.chance.random() < 0.3:
            words.append(self.word(third, self.somewhere()))
        self.block(self.chance.choice(("G2", "G3")), words)

    def modes(self) -> None:
        code = self.chance.choice(
            ("G20", "G21", "G90", "G91", "G90.1", "G91.1", "G17", "G17", "G18", "G19", "G64 P0.01")
        )
        self.unit = {"G20": 25.4, "G21": 1.0}.get(code, self.unit)
        self.absolute = {"G90": True, "G91": False}.get(code, self.absolute)
        self.centre_absolute = {"G90.1": True, "G91.1": False}.get(code, self.centre_absolute)
        self.plane = code if code in ("G17", "G18", "G19") else self.plane
        self.lines.append(code)

    def feeds(self) -> None:
        self.lines.append(f"F{self.number(self.chance.uniform(10, 900))}")

    def talk(self) -> None:
        self.lines.append(
            self.chance.choice(("G4 P0.1", "(note)", "; G1 X5", "", "M8", "M9", "S500", "/", "G61"))
        )

    def inverse(self) -> None:
        """A few moves by inverse time; the interpreter feeds with at least 0.1 units a minute."""
        self.lines.append("G93")
        for _ in range(self.chance.randint(1, 3)):
            axis = self.chance.randrange(3)
            words = [self.word(axis, self.somewhere()), f"F{self.number(3000)}"]
            self.motion = ""
            self.block("G1", words)
        self.lines.append("G94")
        self.lines.append("F400")

    def per_turn(self) -> None:
        self.lines += [f"S{SPEED}", "G95", "F0.1"]
        self.block("G1", [self.word(0, self.somewhere())])
        self.lines_per_turn.append(len(self.lines))
        self.lines += ["G94", "F300"]

    def drill(self) -> None:
        """A series of holes; R counts from where the tool was before the first."""
        if self.plane != "G17":
            self.lines.append("G17")
            self.plane = "G17"
        start = self.position[2]
        rise, drop = self.chance.uniform(-3, 10), self.chance.uniform(0.5, 9)
        heights = [start - rise, start - rise - drop] if self.absolute else [-rise, -drop]
        words = [f"{value / self.unit:.6f}" for value in heights]
        clear = float(words[0]) * self.unit + (0.0 if self.absolute else start)
        cycle = self.chance.choice(("G73", "G81", "G82", "G83", "G85", "G89"))
        # How G85 and G89 leave R for the initial height differs between controllers.
        back = "G99" if cycle in ("G85", "G89") else self.chance.choice(("G98", "G99"))
        peck = f"Q{1.5 / self.unit:.6f}"
        more = {"G73": peck, "G83": peck, "G82": "P0.1", "G89": "P0.1"}.get(cycle, "")
        self.lines.append(f"{back} {cycle} R{words[0]} Z{words[1]} {more}")
        for index in range(self.chance.randint(1, 3)):
            repeats = self.chance.choice((1, 1, 3))
            before = list(self.position)
            places = [self.word(axis, self.somewhere()) for axis in (0, 1)]
            if not self.absolute:
                for axis in (0, 1):
                    step = self.position[axis] - before[axis]
                    self.position[axis] = before[axis] + step * repeats
            text = " ".join([*places, *([f"L{repeats}"] if repeats > 1 else [])])
            if index == 0:
                self.lines[-1] += " " + text
            else:
                self.lines.append(text)
        self.lines.append("G80")
        self.position[2] = max(start, clear) if back == "G98" else clear
        self.motion = ""
