"""Faults that follow from the moves alone, without a picture of the stock."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from grassfire.toolpath import Program
from grassfire.verify.gouge import Walls, stretches_between
from grassfire.verify.model import Fault, FloatArray, Target
from grassfire.verify.path import BELOW, BoolArray, IntArray, Path, below_top

Place = tuple[float, float, float]


def report_moves(
    kind: str,
    path: Path,
    moves: IntArray,
    sizes: FloatArray,
    describe: Callable[[float], str],
    places: Callable[[int], Place] | None = None,
) -> list[Fault]:
    """Return for each operation the first fault of a kind, and the worst where it is elsewhere.

    Parameters
    ----------
    kind : str
    path : Path
    moves, sizes : (k,) arrays
        Moves at fault and how gravely, parallel; a move may appear twice.
    describe : callable
        The sentence for a size.
    places : callable, optional
        The place for an index into `moves`; default: the lower end of the move.
    """
    faults = []
    for operation in np.unique(path.operation[moves]):
        rows = np.flatnonzero(path.operation[moves] == operation)
        count = len(np.unique(moves[rows]))
        first = int(rows[np.argmin(moves[rows])])
        worst = int(rows[np.argmax(sizes[rows])])
        tail = f" (first of {count} moves)" if count > 1 else ""
        picks = [(first, tail)]
        if moves[worst] != moves[first]:
            picks.append((worst, " (the worst)"))
        for index, suffix in picks:
            move = int(moves[index])
            place = places(index) if places is not None else lower_end(path, move)
            faults.append(
                Fault(
                    kind=kind,
                    line=int(path.line[move]),
                    place=place,
                    size=float(sizes[index]),
                    message=describe(float(sizes[index])) + suffix,
                    operation=int(operation),
                )
            )
    return faults


def lower_end(path: Path, move: int) -> Place:
    """Return the lower end of a move; the end where that is unknown."""
    begin, end = path.begin[move], path.end[move]
    point = begin if begin[2] < end[2] else end
    return (float(point[0]), float(point[1]), float(point[2]))


def check_moves(path: Path, top: float, max_feed: FloatArray) -> list[Fault]:
    """Return faults of position, spindle, feed, arcs and low rapids.

    Parameters
    ----------
    path : Path
    top : float
        Top of the stock, mm.
    max_feed : (n,) array
        Largest feed of each move below the top, mm/min; infinite where not judged.
    """
    feeding, below = ~path.rapid, below_top(path, top)
    unknown = ~path.known & (feeding | (below & ~np.isfinite(path.end).all(axis=1)))
    depth = np.maximum(top - np.fmin(path.begin[:, 2], path.end[:, 2]), 0)
    travel = np.nan_to_num(path.planar, nan=np.inf)
    mismatch = np.abs(path.start_radius - path.end_radius)
    allowed = np.maximum(0.005, 0.001 * path.start_radius)
    no_feed = feeding & ~(path.feed > 0)
    cases: list[tuple[str, BoolArray, FloatArray, Callable[[float], str]]] = [
        (
            "unknown-start",
            unknown,
            np.zeros(len(path)),
            lambda _: "the move starts where the position is not known in every axis",
        ),
        (
            "spindle-off",
            feeding & ~path.spindle_on,
            depth,
            lambda _: "a feed move with the spindle at rest",
        ),
        (
            "no-feed",
            no_feed,
            np.zeros(len(path)),
            lambda _: "a feed move without a feed above 0",
        ),
        (
            "feed",
            feeding & below & (path.feed > max_feed * (1 + 1e-6) + 1e-3),
            np.nan_to_num(path.feed),
            lambda size: f"a feed of {size:g} mm/min, more than the tool bears",
        ),
        (
            "arc-radius",
            path.arc & path.known & (mismatch > allowed),
            np.nan_to_num(mismatch),
            lambda size: f"the arc's two radii differ by {size:.4f} mm",
        ),
        (
            "rapid-low",
            path.rapid & below & (travel > BELOW),
            depth,
            lambda size: f"a rapid travels sideways {size:.3f} mm below the stock's top",
        ),
    ]
    faults: list[Fault] = []
    for kind, rows, sizes, describe in cases:
        faults += report_moves(kind, path, rows.nonzero()[0], sizes[rows], describe)
    return faults


def check_sections(
    program: Program, path: Path, served: Sequence[Target], targets: Sequence[Target], top: float
) -> list[Fault]:
    """Return faults of tools, of operations that cut nothing and of ends left in the stock."""
    faults = []
    for index, (section, target) in enumerate(zip(program.sections, served, strict=True)):
        rows = np.flatnonzero(path.section == index)
        if not len(rows):
            continue
        last = rows[-1]
        number_differs = target.tool_number not in (None, section.tool_number)
        radius = path.tool_radius[rows[0]]
        if number_differs or abs(radius - target.tool_radius) > 1e-3:
            message = _wrong_tool(section.tool_number, radius, target)
            size = float(abs(radius - target.tool_radius))
            faults.append(_at_end(path, int(rows[0]), "wrong-tool", size, message))
        following = index + 1 < len(program.sections)
        changes = not following or (program.sections[index + 1].tool_number != section.tool_number)
        height = path.end[last, 2]
        if changes and height < top - BELOW:
            event = "the tool change comes" if following else "the program ends"
            size = float(top - height)
            message = f"{event} with the tool {size:.3f} mm below the stock's top"
            faults.append(_at_end(path, int(last), "ends-in-stock", size, message))
    cutting = ~path.rapid & below_top(path, top)
    for operation in sorted({item.operation for item in targets}):
        if not np.any(cutting & (path.operation == operation)):
            nowhere = (float("nan"),) * 3
            message = f"operation {operation + 1} cuts nothing"
            faults.append(Fault("nothing-cut", 0, nowhere, 0.0, message, operation))
    return faults


def _wrong_tool(number: int, radius: float, target: Target) -> str:
    """Return the sentence for a tool other than the one that an operation asks for."""
    wanted = f"diameter {2 * target.tool_radius:g} mm"
    if target.tool_number is not None:
        wanted += f" (tool {target.tool_number})"
    if number == 0:
        return f"the program chooses no tool; the operation asks for {wanted}"
    return f"tool {number} of diameter {2 * radius:g} mm where the operation asks for {wanted}"


def _at_end(path: Path, move: int, kind: str, size: float, message: str) -> Fault:
    """Return a fault at the end of a move."""
    x, y, z = (float(value) for value in path.end[move])
    return Fault(kind, int(path.line[move]), (x, y, z), size, message, int(path.operation[move]))


def check_floor(
    path: Path, floor: FloatArray, axial_allowance: FloatArray, tolerance: float
) -> list[Fault]:
    """Return faults of moves below the floor of their operation, or in its axial allowance.

    `floor` (drawn) and `axial_allowance` are per move, mm.
    """
    low = np.nan_to_num(path.low, nan=np.inf)
    over = floor - low
    moves = np.flatnonzero(over > tolerance)
    faults = report_moves(
        "floor", path, moves, over[moves], lambda size: f"{size:.4f} mm below the floor"
    )
    into = np.where(over > tolerance, 0.0, over + axial_allowance)
    moves = np.flatnonzero((axial_allowance > 0) & (into > tolerance))
    return faults + report_moves(
        "axial-allowance",
        path,
        moves,
        into[moves],
        lambda size: f"{size:.4f} mm into the stock to be left on the floor",
    )


def check_walls(
    path: Path,
    targets: Sequence[Target],
    allowance: FloatArray,
    *,
    top: float,
    gouge_tolerance: float,
    floor_tolerance: float,
    fitting_tolerance: float,
) -> tuple[FloatArray, list[Fault]]:
    """Measure how far the tool reaches beyond the walls, exactly.

    A position at height z has to keep the tool inside the union of the regions whose floor is no
    higher than z; below the deepest floor the deepest regions count.

    Returns
    -------
    (n,) array
        Gouge of each move, mm, 0 where there is none.
    list of Fault
    """
    import shapely

    candidates = np.flatnonzero(path.known & below_top(path, top))
    floors = sorted({round(item.floor, 9) for item in targets}, reverse=True)
    gouge = np.zeros(len(path))
    into_allowance = np.zeros(len(path))
    gouge_places: dict[int, Place] = {}
    allowance_places: dict[int, Place] = {}
    high = top - BELOW
    for index, floor in enumerate(floors):
        low = floor - floor_tolerance if index + 1 < len(floors) else -np.inf
        deep = [item.region for item in targets if round(item.floor, 9) <= floor]
        walls = Walls(shapely.union_all(deep))
        stretch = stretches_between(path, candidates, low, high)
        high = low
        if not len(stretch.move):
            continue
        radius, leave = path.tool_radius[stretch.move], allowance[stretch.move]
        distance = walls.clearance(path, stretch, radius + leave).distance
        for excess, limit, total, places in (
            (radius - distance, gouge_tolerance, gouge, gouge_places),
            (
                np.where(leave > 0, radius + leave - distance, 0.0),
                gouge_tolerance + fitting_tolerance,
                into_allowance,
                allowance_places,
            ),
        ):
            np.maximum.at(total, stretch.move, excess)
            for row in _marked(path, stretch.move, excess, limit):
                move = int(stretch.move[row])
                places.setdefault(move, walls.worst_place(path, stretch, row))
    faults = _wall_faults("gouge", path, gouge, gouge_tolerance, gouge_places)
    clean = np.where(gouge > gouge_tolerance, 0.0, into_allowance)
    limit = gouge_tolerance + fitting_tolerance
    return gouge, faults + _wall_faults("allowance", path, clean, limit, allowance_places)


def _marked(path: Path, moves: IntArray, excess: FloatArray, limit: float) -> list[int]:
    """Return the rows whose place a report may need: first and worst of each operation."""
    rows = np.flatnonzero(excess > limit)
    marked: list[int] = []
    for operation in np.unique(path.operation[moves[rows]]):
        own = rows[path.operation[moves[rows]] == operation]
        marked += [int(own[np.argmax(excess[own])]), int(own[np.argmin(moves[own])])]
    return marked


def _wall_faults(
    kind: str, path: Path, size: FloatArray, limit: float, places: dict[int, Place]
) -> list[Fault]:
    """Return the faults of moves that exceed a limit at the walls."""
    what = {
        "gouge": "the tool reaches {:.4f} mm beyond the wall",
        "allowance": "the tool reaches {:.4f} mm into the stock to be left on the wall",
    }[kind]
    moves = np.flatnonzero(size > limit)

    def place_of(index: int) -> Place:
        move = int(moves[index])
        return places.get(move) or lower_end(path, move)

    return report_moves(kind, path, moves, size[moves], what.format, place_of)
