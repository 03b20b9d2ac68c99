"""The stock after machining as a mesh, pictures of faults, and what the commands write."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import box

from grassfire.cli import invoke
from grassfire.errors import InputError
from grassfire.gcode import read_program
from grassfire.job import load_job
from grassfire.preview import svg
from grassfire.verify import HeightMap, mesh_file, stock_mesh, stock_png, verify
from verify_samples import MACHINE, circle_pocket

trimesh = pytest.importorskip("trimesh")

ROOT = Path(__file__).resolve().parents[1]


def heights() -> HeightMap:
    """A square of 2 mm depth in a plate of 12 by 8 mm."""
    field = np.zeros((80, 120))
    field[20:60, 30:90] = -2.0
    return HeightMap((5.0, -3.0), 0.1, field)


def test_a_mesh_is_closed_and_holds_what_was_left() -> None:
    corners, triangles = stock_mesh(heights(), -5.0)
    mesh = trimesh.Trimesh(corners, triangles, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    # Corners are centres of cells; a wall between two of them leans and halves the difference.
    block = 11.9 * 7.9 * 5.0
    assert mesh.volume == pytest.approx(block - 6.0 * 4.0 * 2.0, rel=0.002)
    assert np.allclose(mesh.bounds, [[5.05, -2.95, -5.0], [16.95, 4.95, 0.0]])


def test_a_thinned_mesh_is_closed_and_nearly_as_large() -> None:
    corners, triangles = stock_mesh(heights(), -5.0, max_corners=600)
    assert len(corners) < 900
    mesh = trimesh.Trimesh(corners, triangles, process=False)
    assert mesh.is_watertight
    fine = trimesh.Trimesh(*stock_mesh(heights(), -5.0), process=False)
    assert mesh.volume == pytest.approx(fine.volume, rel=0.1)


def test_a_machined_disk_leaves_its_volume() -> None:
    sample = circle_pocket()
    result = verify(read_program(sample.text), sample.targets, **MACHINE)
    corners, triangles = stock_mesh(result.height_map, -10.0, max_corners=10**7)
    mesh = trimesh.Trimesh(corners, triangles, process=False)
    width, height, _ = mesh.bounds[1] - mesh.bounds[0]
    gone = width * height * 10.0 - mesh.volume
    assert gone == pytest.approx(math.pi * 14**2 * 4.5, rel=0.005)


def test_a_mesh_file_is_read_back_the_same() -> None:
    import io

    corners, triangles = stock_mesh(heights(), -5.0, max_corners=600)
    stl = trimesh.load(io.BytesIO(mesh_file(corners, triangles, "a.stl")), file_type="stl")
    assert np.allclose(stl.bounds, [corners.min(axis=0), corners.max(axis=0)])
    glb = trimesh.load(io.BytesIO(mesh_file(corners, triangles, "a.GLB")), file_type="glb")
    size = np.ptp(corners, axis=0)[[0, 2, 1]] / 1000
    assert np.allclose(glb.bounds[1] - glb.bounds[0], size, rtol=1e-5)


def test_meshes_that_cannot_be_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="not below what was cut"):
        stock_mesh(heights(), -2.0)
    corners, triangles = stock_mesh(heights(), -5.0, max_corners=600)
    with pytest.raises(InputError, match=r"\.glb or \.stl"):
        mesh_file(corners, triangles, "a.obj")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(InputError, match=r"needs trimesh.*grassfire\[mesh\]"):
        mesh_file(corners, triangles, "a.stl")


def faulty() -> str:
    return circle_pocket().text.replace("M5\n", "G1 X22 Y-3 Z-4.5 F300\nG0 Z10\nM5\n")


def test_pictures_show_the_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = circle_pocket()
    program = read_program(faulty())
    result = verify(program, sample.targets, **MACHINE)
    assert not result.ok
    walls = [np.array(box(-9, -17, 19, 11).exterior.coords)]
    marks = [(fault.place[0], fault.place[1], fault.kind) for fault in result.faults]
    picture = svg(program, walls, marks=marks)
    assert picture.count('r="9"') == len(marks)
    assert "gouge, line" not in picture
    assert "gouge" in picture
    assert 'r="9"' not in svg(program, walls)
    pytest.importorskip("matplotlib")
    image = stock_png(result, walls, title="faulty")
    assert image.startswith(b"\x89PNG")
    assert image == stock_png(result, walls, title="faulty")
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(InputError, match=r"needs matplotlib.*grassfire\[picture\]"):
        stock_png(result, walls)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small job and its program."""
    import ezdxf

    folder = tmp_path_factory.mktemp("made")
    document = ezdxf.new(units=4)
    points = [(0, 0), (24, 0), (24, 16), (0, 16)]
    document.modelspace().add_lwpolyline(points, close=True)
    document.saveas(folder / "room.dxf")
    (folder / "room.toml").write_text(
        """
post = "linuxcnc"
[input]
file = "room.dxf"
[machine]
path_tolerance = 0.002
travel = [[0, 24], [0, 16], [-10, 20]]
rapid_height = 1.0
[[tools]]
number = 1
diameter = 6.0
flute_length = 8.0
shank_diameter = 6.0
stickout = 20.0
holder_diameter = 32.0
spindle_speed = 12000
feed = 900
plunge_feed = 300
[[operations]]
strategy = "offset"
tool = 1
depth = 4.0
stepdown = 2.0
""",
        encoding="utf-8",
    )
    assert invoke(["run", str(folder / "room.toml"), "--out", str(folder)]) == 0
    return folder


def test_the_command_writes_pictures_and_the_stock(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, job = str(made / "room.ngc"), str(made / "room.toml")
    outputs = ["--svg", str(made / "v.svg"), "--stock", str(made / "v.stl")]
    assert invoke(["verify", program, "--job", job, "--json", *outputs]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["resolution_mm"] == pytest.approx(3.0 / 40)
    assert (made / "v.svg").read_text(encoding="utf-8").startswith("<svg")
    assert trimesh.load(made / "v.stl").is_watertight
    report = json.loads((made / "room.report.json").read_text(encoding="utf-8"))
    assert report["resolution_mm"] == data["resolution_mm"]
    assert invoke(["verify", program, "--job", job, "--stock", str(made / "v.obj")]) == 2
    assert not (made / "v.obj").exists()


@pytest.mark.parametrize(
    ("old", "new", "kind"),
    [
        ("[0, 24]", "[5, 24]", "travel"),
        ("[-10, 20]", "[-3, 20]", "travel"),
        ("rapid_height = 1.0", "rapid_height = 20.0", "rapid-height"),
        ("flute_length = 8.0", "flute_length = 3.0", "shank"),
        ("stickout = 20.0", "stickout = 3.5", "holder"),
    ],
)
def test_the_job_says_what_machine_and_tool_bear(
    made: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, kind: str
) -> None:
    text = (made / "room.toml").read_text(encoding="utf-8")
    assert old in text
    (made / "other.toml").write_text(text.replace(old, new), encoding="utf-8")
    assert invoke(["verify", str(made / "room.ngc"), "--job", str(made / "other.toml")]) == 1
    assert f": {kind}: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("[0, 24]", "[24, 0]", "machine.travel"),
        ("flute_length = 8.0", "", "tools[0].shank_diameter"),
        ("stickout = 20.0", "", "tools[0].holder_diameter"),
        ("holder_diameter = 32.0", "", "tools[0].stickout"),
    ],
)
def test_what_does_not_go_together_is_refused(made: Path, old: str, new: str, place: str) -> None:
    text = (made / "room.toml").read_text(encoding="utf-8")
    (made / "wrong.toml").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_job(made / "wrong.toml")
    assert place in str(caught.value)
