"""The gallery's page: figures, and tables beside those of Dorado 2009."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from paper_degrees import Polynomial
from paper_measure import FINE, PLACES, TOLERANCE, Measured


@dataclass(frozen=True)
class Fundamental:
    """A row of the paper's Table 1, CPU seconds, and the degree of its figure."""

    figure: str
    degree: int
    ends: float
    edge: float
    total: float


@dataclass(frozen=True)
class General:
    """A row of the paper's Table 2, CPU seconds; s of eq. (8) was below `share`."""

    figure: str
    degree: str
    share: str
    vertices: float
    edges: float
    total: float


TABLE_1 = (
    Fundamental("7a", 2, 0.018, 0.008, 0.026),
    Fundamental("7b", 5, 0.018, 0.020, 0.038),
    Fundamental("8a", 4, 0.030, 0.025, 0.055),
    Fundamental("8b", 6, 0.030, 0.061, 0.091),
    Fundamental("9", 2, 0.210, 0.010, 0.220),
    Fundamental("10", 5, 0.260, 0.030, 0.290),
    Fundamental("11a", 5, 0.020, 0.010, 0.030),
    Fundamental("11b", 5, 0.200, 0.070, 0.270),
)

TABLE_2 = (
    General("12", "5", "11e-3", 1.00, 0.05, 1.05),
    General("13", "20", "8e-7", 1.90, 0.81, 2.71),
    General("14a", "", "4e-2", 3.71, 0.17, 3.88),
    General("14a", "", "6e-4", 3.71, 0.41, 4.12),
    General("14a", "", "2e-7", 3.71, 2.52, 6.23),
    General("14b", "", "1e-2", 4.41, 0.22, 4.63),
    General("14b", "", "2e-4", 4.41, 0.51, 4.92),
    General("14b", "", "5e-7", 4.41, 3.83, 8.24),
    General("14c", "", "1e-2", 20.80, 0.84, 21.64),
    General("14c", "", "1e-4", 20.80, 1.99, 22.79),
    General("14c", "", "3e-7", 20.80, 14.61, 35.41),
)


@dataclass(frozen=True)
class Degrees:
    """Errors of polynomials of several degrees on the example of one figure.

    `whole` are single polynomials, `pieces` are cut where the boundary is less smooth.
    """

    figure: str
    whole: tuple[Polynomial, ...]
    pieces: tuple[Polynomial, ...]

    def at(self, degree: int) -> Polynomial:
        """The single polynomial of a degree."""
        return next(one for one in self.whole if one.degree == degree)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table, its first column to the left and the others to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def page(
    measured: Sequence[Measured],
    fine: Sequence[Measured | None],
    degrees: Sequence[Degrees],
    repeat: int,
) -> str:
    """README.md of the gallery."""
    parts = [
        _introduction(repeat),
        "## Counts and errors",
        _COUNTS,
        _counts(measured, fine),
        "## Seconds per stage",
        f"Fastest of {repeat} runs at {TOLERANCE:g} mm, regions built before.",
        _seconds(measured),
        "## Beside Table 1 of the paper",
        _TABLE_1,
        _fundamental(measured, degrees),
        "## Beside Table 2 of the paper",
        _TABLE_2,
        _general(measured),
        "## What a degree is worth",
        _DEGREES,
        *(_convergence(each) for each in degrees if len(each.whole) > 1),
        "## Figures",
        *(_figure(each) for each in measured),
    ]
    return "\n\n".join(parts) + "\n"


def _introduction(repeat: int) -> str:
    versions = f"wall clock, Python {platform.python_version()}, NumPy {np.__version__}, SciPy "
    versions += f"{scipy.__version__}, {os.cpu_count()} cores"
    return f"""# Gallery: the examples of the paper

R. Dorado, *Medial axis of a planar region by offset self-intersections*, Computer-Aided Design 41
(2009) 1050-1059, [doi:10.1016/j.cad.2009.08.005](https://doi.org/10.1016/j.cad.2009.08.005), shows
its method on the regions of Figs. 7 to 14. Here are regions of the same kinds, each with its axis,
what was counted and how exact it is. The outlines are drawn anew (`paper_shapes.py`): the paper
does not give its control points, so figures beside each other compare kinds of shape, not the same
shape. What the strategies make of pockets is shown in [Gallery: strategies](strategies.md).

    python docs/gallery/paper.py                      # all figures and this page
    python docs/gallery/paper.py --only fig14c-leaf   # one figure
    python docs/gallery/paper.py --out DIR            # elsewhere

Written by `paper.py` ({versions}; fastest of {repeat} runs)."""


_COUNTS = f"""Ends and corners are the paper's terminal points, bifurcations its branch points
with three contacts or more. Non-generic points have a disk of greatest curvature that touches
elsewhere too; they are looked for at every maximum of curvature, which also finds the ends a
second time. Edges run between terminal and branch points, vertices - edges = 1 - holes; pieces
are the polynomials that they consist of. With c and n the boundary point and its normal at the
parameter of a piece, m and r the interpolated centre and radius: s = |1 - n.(m - c) / r| is eq.
(8), and the distance from c to m - r n, the boundary recovered by eq. (1), is eq. (9). "Recovered"
is stricter: eq. (1) with the normals that the edges themselves imply (`recover_boundary`), and
the distance of those points from the boundary. All are largest values over {PLACES} places on
each piece, at a tolerance of {TOLERANCE:g} mm and, fine, at {FINE:g} mm."""

_TABLE_1 = """Paper: degree of the figure and CPU seconds, on an Intel Core 2 Duo of 2.8 GHz.
"One polynomial" is the paper's construction, repeated here for Figs. 7, 8, 10 and 11b: eq. (6)
solved at the points of eq. (7), one polynomial of that degree from terminal to terminal. In
Figs. 9 and 11a the pieces of lowest degree are exact. "Here" is the certified axis: graph,
Bezier form and certificate included. The ratio of times is one of machines of different years too,
and of shapes that are alike but not the same."""

_TABLE_2 = """Paper: degree where its caption gives one, bound on s, and CPU seconds for
vertices and edges on the same machine; the vertices do not depend on the bound. "Here" is the
certified axis, all of it, and the same run in each row of a figure."""

_DEGREES = """A periodic cubic B-spline has a jump of its third derivative at every knot, and an
edge of its axis one of lower order at the images of the knots of both sides. One polynomial
from end to end, as in the paper, therefore converges like a power of the degree; pieces cut at
the knots of both sides converge geometrically. The engine cuts there, which keeps its degrees
low. The ellipse is analytic and has nothing to cut; its axis is exact at every degree, the
radius and the recovered boundary are not."""


def _degree_text(values: Sequence[int]) -> str:
    return f"{values[0]}" if len(values) == 1 else f"{values[0]} to {values[-1]}"


def _error(value: float) -> str:
    return f"{value:.0e}"


def _errors(one: Measured) -> list[str]:
    return [
        _error(value) for value in (one.interpolation_error, one.boundary_error, one.recovery_error)
    ]


def _time(value: float) -> str:
    return f"{value:.4f}" if value < 0.01 else f"{value:.3f}"


def _counts(measured: Sequence[Measured], fine: Sequence[Measured | None]) -> str:
    head = [
        "figure", "ends", "corners", "bifurcations", "non-generic", "edges", "pieces", "degrees",
        "s (8)", "(9) mm", "recovered mm", "fine: pieces", "s (8)", "(9) mm", "recovered mm",
    ]  # fmt: skip
    rows = []
    for one, other in zip(measured, fine, strict=True):
        numbers = (one.ends, one.corners, one.branches, one.non_generic, one.edges, one.pieces)
        close = ["not certified", "", "", ""]
        if other is not None:
            close = [str(other.pieces), *_errors(other)]
        rows.append(
            [
                f"{one.example.figure}: {one.example.title}",
                *(str(number) for number in numbers),
                _degree_text(one.degrees),
                *_errors(one),
                *close,
            ]
        )
    return table(head, rows)


def _seconds(measured: Sequence[Measured]) -> str:
    stages = list(dict.fromkeys(key for one in measured for key in one.seconds))
    stages = [*(key for key in stages if key != "total"), "total"]
    rows = [
        [one.example.figure, *(_time(one.seconds.get(key, 0.0)) for key in stages)]
        for one in measured
    ]
    return table(["figure", *stages], rows)


def _fundamental(measured: Sequence[Measured], degrees: Sequence[Degrees]) -> str:
    head = [
        "figure", "paper: degree", "end-points s", "edge s", "total s",
        "one polynomial: s (8)", "(9) mm", "here: degrees", "s (8)", "(9) mm", "seconds",
        "paper / here",
    ]  # fmt: skip
    rows = []
    for row in TABLE_1:
        one = _of_figure(measured, row.figure)
        single = [each.at(row.degree) for each in degrees if each.figure == one.example.figure]
        polynomial = ["exact" if max(one.degrees) <= 2 else "", ""]
        if single:
            shown = (single[0].interpolation_error, single[0].boundary_error)
            polynomial = [_error(value) for value in shown]
        rows.append(
            [
                row.figure, str(row.degree), f"{row.ends:.3f}", f"{row.edge:.3f}",
                f"{row.total:.3f}", *polynomial, _degree_text(one.degrees),
                _error(one.interpolation_error), _error(one.boundary_error),
                _time(one.seconds["total"]), f"{row.total / one.seconds['total']:.1f}",
            ]
        )  # fmt: skip
    return table(head, rows)


def _general(measured: Sequence[Measured]) -> str:
    head = [
        "figure", "paper: degree", "s <", "vertices s", "edges s", "total s",
        "here: s (8)", "(9) mm", "seconds", "paper / here",
    ]  # fmt: skip
    rows = []
    for row in TABLE_2:
        one = _of_figure(measured, row.figure)
        rows.append(
            [
                row.figure, row.degree, row.share, f"{row.vertices:.2f}", f"{row.edges:.2f}",
                f"{row.total:.2f}", _error(one.interpolation_error), _error(one.boundary_error),
                _time(one.seconds["total"]), f"{row.total / one.seconds['total']:.0f}",
            ]
        )  # fmt: skip
    return table(head, rows)


def _of_figure(measured: Sequence[Measured], figure: str) -> Measured:
    """The example of a figure; both parts of Figs. 7 and 8 show one region."""
    names = (figure, figure.rstrip("ab"))
    return next(one for name in names for one in measured if one.example.figure == name)


def _convergence(degrees: Degrees) -> str:
    pieces = bool(degrees.pieces)
    head = [f"Fig. {degrees.figure}, degree", "s (8)", "(9) mm"]
    if pieces:
        head += [f"s (8), {len(degrees.pieces[0].coefficients)} pieces", "(9) mm"]
    rows = []
    for index, one in enumerate(degrees.whole):
        row = [str(one.degree), _error(one.interpolation_error), _error(one.boundary_error)]
        if pieces:
            cut = degrees.pieces[index]
            row += [_error(cut.interpolation_error), _error(cut.boundary_error)]
        rows.append(row)
    name = f"fig{degrees.figure.zfill(2)}-degrees.svg"
    picture = f"![Fig. {degrees.figure} with one polynomial]({name})"
    return "\n\n".join([table(head, rows), _rate(degrees), picture])


def _rate(degrees: Degrees) -> str:
    """Observed orders, by least squares over the degrees shown."""
    degree = np.array([one.degree for one in degrees.whole], dtype=np.float64)
    whole = np.log([one.interpolation_error for one in degrees.whole])
    if not degrees.pieces:
        slope = np.polyfit(degree, whole, 1)[0]
        return f"s falls by a factor of {np.exp(-slope):.1f} with each degree."
    power = np.polyfit(np.log(degree), whole, 1)[0]
    cut = np.log([one.interpolation_error for one in degrees.pieces])
    slope = np.polyfit(degree, cut, 1)[0]
    return (
        f"One polynomial: s falls like the degree to the power {power:.1f}. Cut at the knots: by a "
        f"factor of {np.exp(-slope):.1f} with each degree."
    )


def _figure(one: Measured) -> str:
    example = one.example
    title = f"Fig. {example.figure}: {example.title}"
    return f"### {title}\n\n![{title}]({example.name}.svg)"
