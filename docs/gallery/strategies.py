"""Regenerate the gallery of strategies: a picture of each strategy on six pockets, and its page.

python docs/gallery/strategies.py [--out DIR] [--only POCKET]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from paper_shapes import polar

from grassfire import medial_axis
from grassfire.geometry import Arc, EllipticalArc, Line, Loop, Region, flatten
from grassfire.job import InputSettings, Job, Operation, Tool
from grassfire.plan import plan_operation
from grassfire.toolpath import Program, Role, Section, Toolpath
from grassfire.verify import OperationResult, Target, verify

FloatArray = NDArray[np.float64]

STRATEGIES: dict[str, tuple[str, Literal["climb", "both"]]] = {
    "offset": ("offset", "climb"),
    "spiral": ("spiral", "climb"),
    "adaptive": ("adaptive", "climb"),
    "adaptive-both": ("adaptive", "both"),
}
"""What is pictured: strategy and direction of the cuts, by name."""
DEPTH = 3.0
RADIUS = 3.0
WIDTH, MARGIN, LEGEND = 760.0, 14.0, 26.0
"""Width of a picture, margin round the pocket, height of the legend, pixels."""

STYLE = {
    Role.RAPID: ("up and across", "#d62728", 'stroke-width="1.2" stroke-dasharray="5 4"'),
    Role.ENTRY: ("descent", "#2a9d3a", 'stroke-width="1.6"'),
    Role.CUT: ("cut", "#1f5fbf", 'stroke-width="1"'),
    Role.LINK: ("link", "#e08214", 'stroke-width="1"'),
    Role.LEAD: ("lead", "#8e44ad", 'stroke-width="1.2"'),
    Role.FINISH: ("wall pass", "#222", 'stroke-width="1.2"'),
}


def disk(x: float, y: float, radius: float) -> Loop:
    """A full circle, mm."""
    return Loop((Arc((x, y), radius, 0.0, 2 * np.pi),))


def rectangle() -> Region:
    """80 x 50 mm."""
    return Region(Loop.from_points([(0, 0), (80, 0), (80, 50), (0, 50)]), ())


def ellipse() -> Region:
    """Half axes of 42 and 22 mm."""
    return Region(Loop((EllipticalArc((0, 0), (42, 0), (0, 22), 0.0, 2 * np.pi),)), ())


def star() -> Region:
    """Five points with sharp tips and reflex corners."""
    degrees = 90.0 + 36.0 * np.arange(10)
    return Region(Loop.from_points(polar(np.tile([42.0, 20.0], 5), degrees)), ())


def islands() -> Region:
    """Three islands, one of them square."""
    square = Loop.from_points([(52, 12), (64, 12), (64, 24), (52, 24)])
    outer = Loop.from_points([(0, 0), (84, 0), (84, 54), (0, 54)])
    return Region(outer, (disk(22, 20, 7), disk(42, 39, 5), square))


def gear() -> Region:
    """Inside of a ring gear with ten teeth, 9 mm and more between them."""
    pitch = 2 * np.pi / 10
    curves: list[Arc | Line] = []
    for tooth in range(10):
        space = Arc((0, 0), 38.0, tooth * pitch, 0.42 * pitch)
        tip = Arc((0, 0), 28.0, (tooth + 0.47) * pitch, 0.48 * pitch)
        following = Arc((0, 0), 38.0, (tooth + 1) * pitch, 0.42 * pitch)
        curves += [space, Line(space.end, tip.start), tip, Line(tip.end, following.start)]
    return Region(Loop.chained(curves, 1e-9), ())


def corridor() -> Region:
    """A chamber, a bent corridor of 1.6 tool diameters with a dead end, and a second branch."""
    corners = [
        (0, 0), (30, 0), (30, 10), (80, 10), (80, 46), (70.4, 46), (70.4, 19.6),
        (54, 19.6), (54, 46), (44.4, 46), (44.4, 19.6), (30, 19.6), (30, 34), (0, 34),
    ]  # fmt: skip
    return Region(Loop.from_points(corners), ())


POCKETS: dict[str, Callable[[], Region]] = {
    "rectangle": rectangle,
    "ellipse": ellipse,
    "star": star,
    "islands": islands,
    "gear": gear,
    "corridor": corridor,
}


@dataclass(frozen=True)
class Picture:
    """A strategy on a pocket: its moves and what the verifier says about them."""

    pocket: str
    strategy: str
    region: Region
    toolpath: Toolpath
    result: OperationResult

    @property
    def name(self) -> str:
        """Of the file, without its ending."""
        return f"{self.pocket}-{self.strategy}"


def job_of(name: str) -> Job:
    """The job of all pictures: 6 mm tool, stepover 40 %, one pass 3 mm deep."""
    tool = Tool(number=1, diameter=2 * RADIUS, spindle_speed=18000, feed=1200, plunge_feed=400)
    strategy, direction = STRATEGIES[name]
    operation = Operation(
        strategy=strategy,
        direction=direction,
        tool=1,
        depth=DEPTH,
        stepover=0.4,
        link_feed=3000,
    )
    drawing = InputSettings(file=Path("pocket.dxf"))
    return Job(name="gallery", input=drawing, tools=(tool,), operations=(operation,))


def planned(pocket: str, strategy: str) -> Picture:
    """Plan one pocket and judge the moves."""
    job, region = job_of(strategy), POCKETS[pocket]()
    operation, tool = job.operations[0], job.tools[0]
    moves = plan_operation([medial_axis(region)], operation, tool, job).toolpath
    walls = [flatten(loop, 1e-4) for loop in region.loops]
    target = Target(
        operation=0,
        region=shapely.Polygon(walls[0], walls[1:]),
        depth=DEPTH,
        tool_radius=RADIUS,
    )
    program = Program(pocket, (Section(moves, 1, 2 * RADIUS, tool.spindle_speed, 0),))
    machine = job.machine
    judged = verify(program, [target], rapid=machine.rapid, acceleration=machine.acceleration)
    return Picture(pocket, strategy, region, moves, judged.operations[0])


def svg(picture: Picture) -> str:
    """The way of the tool centre in colours of its roles, on the pocket."""
    xmin, ymin, xmax, ymax = picture.region.bounds()
    scale = (WIDTH - 2 * MARGIN) / (xmax - xmin)
    height = round((ymax - ymin) * scale + 2 * MARGIN + LEGEND)

    def at(points: FloatArray) -> FloatArray:
        return (np.asarray(points) - (xmin, ymax)) * (scale, -scale) + MARGIN

    walls = "".join(
        "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in at(flatten(loop, 0.01))) + "Z"
        for loop in picture.region.loops
    )
    body = [f'<path d="{walls}" fill="#f4f1ea" stroke="#222" fill-rule="evenodd"/>']
    used = []
    for role, (label, colour, extra) in STYLE.items():
        data = _role_data(picture.toolpath, role, at)
        if data:
            body.append(f'<path d="{data}" fill="none" stroke="{colour}" {extra}/>')
            used.append((label, colour))
    for number, (label, colour) in enumerate(used):
        x, y = MARGIN + 124 * number, height - 10
        body.append(f'<path d="M{x:g} {y - 4:g}h22" stroke="{colour}" stroke-width="3"/>')
        body.append(f'<text x="{x + 28:g}" y="{y:g}">{label}</text>')
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {height}">'
    title = f"<title>{picture.strategy} on {picture.pocket}</title>"
    style = "<style>text{font:12px sans-serif;fill:#333}</style>"
    ground = f'<rect width="{WIDTH:g}" height="{height}" fill="#fff"/>'
    return "\n".join([head, title, style, ground, *body, "</svg>", ""])


def _role_data(moves: Toolpath, role: Role, at: Callable[[FloatArray], FloatArray]) -> str:
    """SVG path data of all moves of a role that go sideways."""
    begin, end = at(moves.begin[:, :2]), at(moves.end[:, :2])
    going = (np.hypot(*(end - begin).T) > 0) | moves.is_arc
    rows = np.flatnonzero((moves.role == role) & going & np.isfinite(begin).all(axis=1))
    centre = at(moves.centre)
    parts, last = [], np.full(2, np.nan)
    for row in rows.tolist():
        if not np.array_equal(last, begin[row]):
            parts.append(f"M{_pair(begin[row])}")
        if moves.is_arc[row]:
            parts.append(_arc(begin[row], centre[row], float(moves.sweep[row])))
        else:
            parts.append(f"L{_pair(end[row])}")
        last = end[row]
    return "".join(parts)


def _arc(begin: FloatArray, centre: FloatArray, sweep: float) -> str:
    """An arc in parts of less than half a turn; y points down, so that turns change their sense."""
    count = int(abs(sweep) / 3.0) + 1
    angle = -sweep * np.arange(1, count + 1) / count
    offset = begin - centre
    ends = centre + np.stack(
        [
            np.cos(angle) * offset[0] - np.sin(angle) * offset[1],
            np.sin(angle) * offset[0] + np.cos(angle) * offset[1],
        ],
        axis=-1,
    )
    radius, sense = f"{np.hypot(*offset):.2f}", int(sweep < 0)
    return "".join(f"A{radius} {radius} 0 0 {sense} {_pair(end)}" for end in ends)


def _pair(point: FloatArray) -> str:
    return f"{point[0]:.2f} {point[1]:.2f}"


def page(pictures: Sequence[Picture]) -> str:
    """The page with all pictures and the verifier's figures."""
    lines = [
        "# Gallery: strategies",
        "",
        "Three strategies on six pockets, `adaptive` climbing and to and fro (both): 6 mm tool,",
        "stepover 40 % (78.5 degrees on a straight cut), one pass 3 mm deep, entry by helix, wall",
        "pass, links at 3000 mm/min, cuts at 1200 mm/min. Written by",
        "",
        "    python docs/gallery/strategies.py",
        "",
        "Engagement, uncut area, gouge and time are the verifier's. Its engagement is measured on",
        "a raster, to some three degrees; full turns of an entry count.",
        "",
    ]
    for pocket in dict.fromkeys(picture.pocket for picture in pictures):
        shown = [picture for picture in pictures if picture.pocket == pocket]
        lines += [f"## {pocket.capitalize()}", ""]
        lines += [
            "| strategy | moves | retracts | at feed, mm | seconds | engagement: largest "
            "| 99 % | mean | uncut, mm2 | gouge, mm |",
            "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
        ]
        lines += [_row(picture) for picture in shown]
        lines.append("")
        for picture in shown:
            lines += [f"![{picture.strategy}](strategies/{picture.name}.svg)", ""]
    return "\n".join(lines)


def _row(picture: Picture) -> str:
    found = picture.result
    cells = [
        picture.strategy,
        str(found.moves),
        str(found.retracts),
        f"{found.cut_length_mm:.0f}",
        f"{found.time_s:.1f}",
        f"{found.max_engagement_deg:.0f}",
        f"{found.p99_engagement_deg:.0f}",
        f"{found.mean_engagement_deg:.0f}",
        f"{found.uncut_area_mm2:.2f}",
        f"{found.max_gouge_mm:.4f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write pictures and page."""
    parser = argparse.ArgumentParser(description=__doc__)
    here = Path(__file__).resolve().parent
    parser.add_argument("--out", type=Path, default=here, help="folder of the page")
    parser.add_argument("--only", choices=POCKETS, help="the pictures of one pocket, no page")
    options = parser.parse_args(arguments)
    names = [options.only] if options.only else list(POCKETS)
    folder = options.out / "strategies"
    folder.mkdir(parents=True, exist_ok=True)
    pictures = []
    for pocket in names:
        for strategy in STRATEGIES:
            picture = planned(pocket, strategy)
            text = svg(picture)
            (folder / f"{picture.name}.svg").write_text(text, encoding="utf-8")
            print(picture.name, len(text), "bytes")
            pictures.append(picture)
    if not options.only:
        (options.out / "strategies.md").write_text(page(pictures), encoding="utf-8")


if __name__ == "__main__":
    main()
