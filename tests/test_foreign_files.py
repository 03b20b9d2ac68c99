"""Programs of other systems through the command line: judged and drawn, in any encoding."""

from __future__ import annotations

import codecs
import json
from pathlib import Path

import pytest

import foreign
from grassfire.cli import invoke

ROWS = "\n".join(
    f"G1 X{(17, 3)[row % 2]}. Y{y:.3f}" + (f"\nG1 Y{y + 2.8:.3f}" if row < 5 else "")
    for row, y in enumerate(3 + 2.8 * step for step in range(6))
)
PROGRAM = f"""%
O1001 (Tasche für Ø6, Größe 20 x 20)
N10 G90 G94 G17
N20 G21
N30 G53 G0 Z0.
N40 T1 M6
N50 S9000 M3
N60 G54
N70 G0 X3. Y3.
N80 G43 Z15. H1
G0 Z1.
G1 Z-2. F200.
{ROWS.replace("G1 X17", "F900. G1 X17", 1)}
(Wand)
G1 X3. Y17.
Y3.
X17.
Y17.
X3.
G0 Z15.
M5
G53 G0 Z0.
M30
%
"""

PLAIN = """0 BEGIN PGM TASCHE MM
1 TOOL CALL 1 Z S9000
2 M3
3 L Z+15 R0 FMAX
4 L X+10 Y+10 R0 FMAX
5 L Z+1 R0 FMAX
6 L Z-2 F200
7 L X+16 F900
8 CC X+10 Y+10
9 C X+16 Y+10 DR+
10 L Z+15 R0 FMAX
11 M30
12 END PGM TASCHE MM
"""


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job on a square of 20 mm, 2 mm deep, that allows plunges."""
    import ezdxf

    folder = tmp_path_factory.mktemp("foreign")
    document = ezdxf.new(units=4)
    document.modelspace().add_lwpolyline([(0, 0), (20, 0), (20, 20), (0, 20)], close=True)
    document.saveas(folder / "square.dxf")
    path = folder / "square.toml"
    path.write_text(
        '[input]\nfile = "square.dxf"\n[[tools]]\nnumber = 1\ndiameter = 6\nspindle_speed = 9000\n'
        'feed = 900\nplunge_feed = 200\n[[operations]]\nstrategy = "offset"\ntool = 1\ndepth = 2\n'
        'entry = "plunge"\n'
    )
    return path


ENCODINGS = {
    "utf-8": PROGRAM.encode("utf-8"),
    "utf-8 with a mark": codecs.BOM_UTF8 + PROGRAM.encode("utf-8"),
    "utf-16, little end first": codecs.BOM_UTF16_LE + PROGRAM.encode("utf-16-le"),
    "utf-16, big end first": codecs.BOM_UTF16_BE + PROGRAM.encode("utf-16-be"),
    "latin-1": PROGRAM.encode("latin-1"),
    "latin-1, lines of DOS": PROGRAM.replace("\n", "\r\n").encode("latin-1"),
}


@pytest.mark.parametrize("name", ENCODINGS)
def test_encodings_do_not_change_the_judgement(
    name: str, job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "1001.nc"
    program.write_bytes(ENCODINGS[name])
    assert invoke(["verify", str(program), "--job", str(job), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["ok"] is True and data["faults"] == []
    (figures,) = data["operations"]
    cuts = 6 * 14 + 5 * 2.8 + 4 * 14 + 3  # rows, steps, the lap, and the way down
    assert figures["cut_length_mm"] == pytest.approx(cuts, abs=0.01)
    assert figures["uncut_area_mm2"] == pytest.approx(0, abs=0.05)
    assert invoke(["preview", str(program), "--svg", str(tmp_path / "p.svg")]) == 0
    assert "cut at z -2 mm" in (tmp_path / "p.svg").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "fault", "line"),
    [
        ("X17.\nY17.", "X17.4\nY17.", "gouge", 27),
        ("G1 Z-2. F200.", "G1 Z-2.3 F200.", "floor", 12),
        ("G1 Y5.800\n", "G0 Y5.800\n", "rapid", 14),
        ("S9000 M3", "S9000", "spindle", 12),
    ],
)
def test_faults_of_foreign_programs_are_told_with_their_lines(
    old: str, new: str, fault: str, line: int, job: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    program = tmp_path / "wrong.nc"
    assert PROGRAM.count(old) == 1
    program.write_bytes(PROGRAM.replace(old, new).encode("utf-16"))
    assert invoke(["verify", str(program), "--job", str(job)]) == 1
    told = capsys.readouterr().err
    assert any(fault in row and f"line {line}" in row for row in told.splitlines()), told


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (PROGRAM.encode("utf-16-le"), "not text"),
        (codecs.BOM_UTF16_LE + PROGRAM.encode("utf-16-le")[:-1], "cut off"),
        (PROGRAM.replace("G90 G94 G17", "G90 G94 G41 D1").encode("latin-1"), "line 3"),
        (PROGRAM.replace("(Wand)", "#100=5").encode("latin-1"), "line"),
        (None, "no such program"),
    ],
    ids=["no mark", "cut off", "compensation", "variables", "absent"],
)
@pytest.mark.parametrize("command", ["verify", "preview"])
def test_what_cannot_be_read_is_one_line(
    command: str, data: bytes | None, message: str, job: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    program, picture = tmp_path / "odd.nc", tmp_path / "odd.svg"
    if data is not None:
        program.write_bytes(data)
    assert invoke([command, str(program), "--job", str(job), "--svg", str(picture)]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1 and "odd.nc" in captured.err
    assert message in captured.err
    assert not picture.exists()


def test_plain_language_from_the_command_line(
    job: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "tasche.h"
    program.write_bytes(PLAIN.encode("latin-1"))
    assert invoke(["verify", str(program), "--job", str(job)]) == 1
    told = capsys.readouterr().err
    assert "uncut" in told and "gouge" not in told
    picture = tmp_path / "tasche.svg"
    assert invoke(["preview", str(program), "--job", str(job), "--svg", str(picture)]) == 0
    assert "cut at z -2 mm" in picture.read_text(encoding="utf-8")


def test_notes_of_the_reader_reach_the_user(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], job: Path
) -> None:
    program = tmp_path / "noted.nc"
    program.write_text("G10 L2 P1 X0 Y0\n" + PROGRAM.split("%")[1], encoding="utf-8")
    assert invoke(["preview", str(program), "--svg", "-"]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith("<svg")
    assert "noted.nc: note: line 1: G10" in captured.err
    invoke(["verify", str(program), "--job", str(job), "--json"])
    assert json.loads(capsys.readouterr().out)["notes"][0].startswith("line 1: G10")


@pytest.mark.parametrize(
    "name", [name for name in vars(foreign) if name.isupper() and name[0] != "_"]
)
def test_every_foreign_sample_is_drawn(name: str, tmp_path: Path) -> None:
    text = getattr(foreign, name)
    program = tmp_path / ("part.mpf" if name.startswith("SIEMENS") else "part.nc")
    program.write_text(text, encoding="utf-8")
    assert invoke(["preview", str(program), "--svg", str(tmp_path / "p.svg")]) == 0
    assert (tmp_path / "p.svg").read_text(encoding="utf-8").startswith("<svg")
