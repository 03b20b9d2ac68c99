"""The gallery of strategies: complete, small, drawn where the tool goes, rewritten by a script."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

GALLERY = Path(__file__).resolve().parents[1] / "docs" / "gallery"
sys.path.append(str(GALLERY))
gallery = importlib.import_module("strategies")

NAMES = {f"{pocket}-{strategy}" for pocket in gallery.POCKETS for strategy in gallery.STRATEGIES}


def test_page_shows_every_picture() -> None:
    page = (GALLERY / "strategies.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(strategies/([\w-]+)\.svg\)", page)) == NAMES
    assert {path.stem for path in (GALLERY / "strategies").glob("*.svg")} == NAMES
    rows = re.findall(r"^\| (?:offset|spiral|adaptive|adaptive-both) \|", page, re.MULTILINE)
    assert len(rows) == len(NAMES)


@pytest.mark.parametrize("name", sorted(NAMES))
def test_pictures_are_small_and_well_formed(name: str) -> None:
    path = GALLERY / "strategies" / f"{name}.svg"
    assert path.stat().st_size < 150_000
    text = path.read_text(encoding="utf-8")
    assert "nan" not in text
    assert ElementTree.fromstring(text).tag.endswith("svg")


@pytest.mark.parametrize("sweep", [0.4, -2.9, 3.2, -6.0, 2 * np.pi, -2 * np.pi])
def test_arcs_are_drawn_in_parts_that_keep_radius_and_sense(sweep: float) -> None:
    centre, begin = np.array([5.0, 7.0]), np.array([9.0, 7.0])
    parts = re.findall(r"A(\S+) \S+ 0 0 (\d) (\S+) ([-\d.]+)", gallery._arc(begin, centre, sweep))
    points = np.array([begin, *[(float(x), float(y)) for *_, x, y in parts]])
    assert np.hypot(*(points - centre).T) == pytest.approx(4.0, abs=0.01)
    angle = np.unwrap(np.arctan2(*(points - centre).T[::-1]))
    # y points down: what turns left in the drawing turns right in pixels
    assert angle[-1] - angle[0] == pytest.approx(-sweep, abs=0.01)
    assert np.abs(np.diff(angle)).max() < np.pi
    assert {sense for _, sense, *_ in parts} == {"0" if sweep > 0 else "1"}


def test_script_writes_a_pocket_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gallery.main(["--only", "rectangle", "--out", str(tmp_path)])
    written = {path.stem for path in (tmp_path / "strategies").iterdir()}
    assert written == {name for name in NAMES if name.startswith("rectangle")}
    assert capsys.readouterr().out.count("bytes") == len(gallery.STRATEGIES)


def test_rows_hold_the_figures_of_the_verifier() -> None:
    picture = gallery.planned("ellipse", "offset")
    found = picture.result
    page = gallery.page([picture])
    assert f"| offset | {found.moves} | {found.retracts} | {found.cut_length_mm:.0f} |" in page
    assert found.max_gouge_mm < 0.005
    assert found.uncut_area_mm2 < 5e-4 * found.reachable_area_mm2
