"""Regenerate the gallery: one figure for each example of Dorado 2009, and the page around them.

python docs/gallery/paper.py [--out DIR] [--only NAME] [--repeat N]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import paper_degrees as polynomial
import paper_drawing as drawing
import paper_tables as tables
from paper_measure import EXAMPLES, FINE, TOLERANCE, Example, Measured, measure

from grassfire.errors import GeometryError
from grassfire.geometry.chebyshev import evaluate_bezier

DEGREES = {
    "7": (2, 3, 4, 5, 6, 8, 12, 16),
    "8": (2, 3, 4, 6, 8, 12, 16, 24),
    "10": (5,),
    "11b": (5,),
}
"""Degrees of the single polynomials, by figure; those of the paper are among them."""

SHOWN = {"7": (2, 5), "8": (4, 6)}
"""Degrees whose recovered boundary is drawn, as in the paper's Figs. 7 and 8."""


def degrees_of(measured: Measured) -> tables.Degrees:
    """Single polynomials on a fundamental domain; on Fig. 8 also cut at the knots."""
    axis, figure = measured.axis, measured.example.figure
    kinds = np.array(axis.vertex_kind)
    terminals = axis.vertex_point[(kinds == "end") | (kinds == "corner")]
    side = polynomial.whole_edge(axis.region.outer, terminals[0], terminals[1])
    whole = polynomial.fit_degrees(side, DEGREES[figure])
    if figure != "8":
        return tables.Degrees(figure, whole, ())
    pieces = polynomial.fit_degrees(side, DEGREES[figure], polynomial.knot_breaks(side))
    return tables.Degrees(figure, whole, pieces)


def degree_figure(measured: Measured, degrees: tables.Degrees) -> str:
    """The region, the axis of one polynomial and the boundary recovered from it; errors below."""
    panels = []
    for degree in SHOWN[degrees.figure]:
        one = degrees.at(degree)
        text = f"one polynomial of degree {degree}: s = {one.interpolation_error:.1e}"
        panel = drawing.outlined(measured.axis.region, text)
        fraction = np.linspace(0, 1, 200)
        panel.path("axis", [evaluate_bezier(one.coefficients[0][:, :2], fraction)])
        panel.path("recovered", list(one.recovered))
        panels.append(panel)
    if degrees.pieces:
        series = {"one polynomial": degrees.whole, "cut at the knots": degrees.pieces}
        curves = {
            label: (
                np.array([float(one.degree) for one in values]),
                np.array([one.interpolation_error for one in values]),
            )
            for label, values in series.items()
        }
        panels.append(drawing.error_panel("s of eq. (8) over the degree", curves))
    return drawing.document(panels)


def checked(example: Example, tolerance: float, repeat: int) -> Measured:
    """Measure an example and compare its counts with what it has to have.

    Raises
    ------
    GeometryError
        When a count differs, or the axis cannot be certified.
    """
    found = measure(example, tolerance, repeat)
    counts = (found.ends, found.corners, found.branches, found.edges)
    expected = (example.ends, example.corners, example.branches, example.edges)
    if counts != expected:
        raise GeometryError(
            f"{example.name}: ends, corners, bifurcations and edges are {counts}, not {expected}"
        )
    return found


def fine_run(example: Example) -> Measured | None:
    """The example at the finer tolerance, None where it cannot be certified; the page says so."""
    try:
        return checked(example, FINE, 1)
    except GeometryError:
        return None


def write(out: Path, name: str, text: str) -> None:
    """Write a file and say so."""
    path = out / name
    path.write_text(text, encoding="utf-8")
    print(f"{path}  {len(text.encode()) / 1000:.0f} kB")


def main(arguments: Sequence[str] | None = None) -> None:
    """Write figures, and the page when no single one is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parent)
    parser.add_argument("--only", choices=[example.name for example in EXAMPLES])
    parser.add_argument("--repeat", type=int, default=5, help="runs per example; fastest counts")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    chosen = [example for example in EXAMPLES if options.only in (None, example.name)]
    measured, degrees = [], []
    for example in chosen:
        one = checked(example, TOLERANCE, options.repeat)
        measured.append(one)
        panel = drawing.region_panel(one.axis.region, one.axis)
        write(options.out, f"{example.name}.svg", drawing.document([panel]))
        if example.figure in DEGREES:
            degrees.append(degrees_of(one))
        if example.figure in SHOWN:
            name = f"fig{example.figure.zfill(2)}-degrees.svg"
            write(options.out, name, degree_figure(one, degrees[-1]))
    if options.only is None:
        fine = [fine_run(example) for example in EXAMPLES]
        write(options.out, "README.md", tables.page(measured, fine, degrees, options.repeat))


if __name__ == "__main__":
    main()
