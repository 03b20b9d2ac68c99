"""The command line: files, exit codes, and one clear line for whatever goes wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grassfire
from grassfire import app, cli
from grassfire.errors import GeometryError, InputError
from grassfire.toolpath import Program, Section

JOBS = Path(__file__).resolve().parents[1] / "jobs"

Result = tuple[int, str, str]
Invoke = Callable[..., Result]


@pytest.fixture
def invoke(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Invoke:
    monkeypatch.delenv(cli.TRACEBACK_VARIABLE, raising=False)

    def call(*arguments: object) -> Result:
        code = cli.invoke([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def square(tmp_path: Path) -> Path:
    """A job on a drawing of one square pocket, 20 mm wide."""
    import ezdxf

    document = ezdxf.new(units=4)
    document.modelspace().add_lwpolyline(
        [(0, 0), (20, 0), (20, 20), (0, 20)], close=True, dxfattribs={"layer": "POCKET"}
    )
    document.saveas(tmp_path / "square.dxf")
    job = tmp_path / "square.toml"
    job.write_text(
        '[input]\nfile = "square.dxf"\n'
        "[[tools]]\nnumber = 1\ndiameter = 6\nspindle_speed = 9000\nfeed = 900\nplunge_feed = 200\n"
        '[[operations]]\nstrategy = "offset"\ntool = 1\ndepth = 2\n'
    )
    return job


def one_line(text: str) -> str:
    assert text.endswith("\n")
    assert text.count("\n") == 1
    assert "Traceback" not in text
    return text


def edit(job: Path, old: str, new: str) -> None:
    text = job.read_text()
    assert old in text
    job.write_text(text.replace(old, new))


def gouging(program: Program) -> Program:
    """The program with its first cut moved 1 mm outwards."""
    section = program.sections[0]
    path = section.toolpath
    end = path.end.copy()
    end[len(end) // 2 :, 0] += 1.0
    centre = path.centre.copy()
    centre[len(end) // 2 :, 0] += 1.0
    moved: Section = replace(section, toolpath=replace(path, end=end, centre=centre))
    return replace(program, sections=(moved, *program.sections[1:]))


def test_run_writes_program_report_and_picture(
    square: Path, tmp_path: Path, invoke: Invoke
) -> None:
    out = tmp_path / "new" / "out"
    code, stdout, stderr = invoke("run", square, "--out", out)
    assert (code, stderr) == (0, "")
    names = ["square.ngc", "square.report.json", "square.svg"]
    assert sorted(path.name for path in out.iterdir()) == names
    assert "verified" in stdout
    report = json.loads((out / "square.report.json").read_text())
    assert report["verified"] is True
    assert report["program"] == "square.ngc"
    (figures,) = report["operations"]
    assert figures["rapids_in_stock"] == 0
    assert figures["max_gouge_mm"] <= 0.005
    # A square's corners keep (4 - pi) R^2.
    assert figures["unreachable_area_mm2"] == pytest.approx((4 - 3.14159) * 9, rel=0.02)


def test_the_same_job_makes_the_same_files(square: Path, tmp_path: Path, invoke: Invoke) -> None:
    texts: list[dict[str, Any]] = []
    for name in ("a", "b"):
        assert invoke("run", square, "--out", tmp_path / name)[0] == 0
        files = {path.name: path.read_text() for path in sorted((tmp_path / name).iterdir())}
        report = json.loads(files.pop("square.report.json"))
        del report["seconds"]
        texts.append({**files, "report": report})
    assert texts[0] == texts[1]


def test_run_in_json(square: Path, tmp_path: Path, invoke: Invoke) -> None:
    code, stdout, stderr = invoke("run", square, "--out", tmp_path, "--json", "--post", "grbl")
    assert (code, stderr) == (0, "")
    data = json.loads(stdout)
    assert data["ok"] is True
    assert Path(data["files"]["program"]) == tmp_path / "square.nc"
    assert {"read", "medial", "plan", "post", "verify", "preview"} <= set(data["seconds"])


def test_an_unjudged_run_says_so(square: Path, tmp_path: Path, invoke: Invoke) -> None:
    assert invoke("run", square, "--out", tmp_path / "judged")[0] == 0
    code, stdout, _ = invoke("run", square, "--out", tmp_path / "not", "--no-verify")
    assert code == 0
    assert "NOT VERIFIED" in stdout
    judged, unjudged = (
        json.loads((tmp_path / name / "square.report.json").read_text())
        for name in ("judged", "not")
    )
    assert unjudged["verified"] is None
    for key in ("moves", "lines", "arcs", "retracts"):
        assert unjudged["operations"][0][key] == judged["operations"][0][key]
    for key in ("cut_length_mm", "rapid_length_mm", "time_s"):
        expected = judged["operations"][0][key]
        assert unjudged["operations"][0][key] == pytest.approx(expected)


def test_a_refused_program_is_not_written(
    square: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    import grassfire.gcode

    read = grassfire.gcode.read_program
    monkeypatch.setattr(
        grassfire.gcode, "read_program", lambda text, **options: gouging(read(text, **options))
    )
    out = tmp_path / "out"
    out.mkdir()
    (out / "square.ngc").write_text("older")
    code, stdout, stderr = invoke("run", square, "--out", out)
    assert code == 1
    assert "gouge" in stderr
    assert "line " in stderr
    assert "none was written" in stderr
    assert "verified:" not in stdout
    assert (out / "square.ngc").read_text() == "older"
    report = json.loads((out / "square.report.json").read_text())
    assert report["verified"] is False
    assert report["program"] is None
    assert any(fault["kind"] == "gouge" for fault in report["faults"])
    assert "REFUSED" in (out / "square.svg").read_text()
    assert len(list(out.iterdir())) == 3


def test_bad_input_is_one_line_and_no_file(square: Path, tmp_path: Path, invoke: Invoke) -> None:
    original = square.read_text()
    out = tmp_path / "out"
    for old, new, expected in (
        ("square.dxf", "circle.dxf", "circle.dxf"),
        ("depth = 2", "depth = 0", "operations[0].depth"),
        ("depth = 2", "dept = 2", "did you mean 'depth'?"),
        ("diameter = 6", "diameter = 30", "20"),
        ('file = "square.dxf"', 'file = "square.dxf"\nlayers = ["POCKETS"]', "POCKET"),
        ("[input]", 'post = "grb"\n[input]', "grbl"),
        ('file = "square.dxf"', 'file = "square.toml"', "square.toml"),
    ):
        square.write_text(original)
        edit(square, old, new)
        code, _, stderr = invoke("run", square, "--out", out)
        assert code == 2, (new, stderr)
        assert expected in one_line(stderr)
        assert not out.exists()


def test_an_unknown_post_names_the_job(square: Path, invoke: Invoke) -> None:
    square.write_text('post = "linux"\n' + square.read_text())
    code, _, err = invoke("run", square)
    assert code == 2
    assert one_line(err).startswith(f"{square}: unknown post 'linux'")


def test_a_drawing_for_a_job_and_a_job_for_a_drawing(square: Path, invoke: Invoke) -> None:
    drawing = square.with_suffix(".dxf")
    code, _, err = invoke("run", drawing)
    assert code == 2
    assert one_line(err).endswith("; a drawing is no job: grassfire init makes one from it\n")
    code, _, err = invoke("inspect", square)
    assert code == 2
    assert one_line(err).endswith("; give the drawing that this job names\n")


def test_rows_of_tables_keep_to_one_line(square: Path, invoke: Invoke) -> None:
    code, out, _ = invoke("inspect", square.with_suffix(".dxf"))
    assert code == 0
    assert "1 region, 400.00 mm2" in out
    rows = [line for line in out.splitlines() if "20.000 at (10.00, 10.00)" in line]
    assert len(rows) == 1
    assert all(len(line) <= 80 for line in out.splitlines()[1:])


def test_a_tool_that_fits_nowhere_names_one_that_does(square: Path, invoke: Invoke) -> None:
    edit(square, "diameter = 6", "diameter = 30")
    code, _, stderr = invoke("run", square)
    assert code == 2
    assert "operations[0]" in stderr
    assert "20" in stderr


def test_an_uncertain_axis_names_drawing_place_and_remedy(
    square: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    import grassfire.medial

    def uncertain(*_: object) -> None:
        raise GeometryError("no convergence", place=(1.0, 2.0))

    monkeypatch.setattr(grassfire.medial, "medial_axis", uncertain)
    code, _, stderr = invoke("run", square, "--out", tmp_path / "out")
    assert code == 2
    line = one_line(stderr)
    assert line.startswith(str(square.with_suffix(".dxf")))
    assert "no convergence at (1, 2); redraw" in line
    # A survey goes on and lists it.
    code, stdout, _ = invoke("inspect", square.with_suffix(".dxf"), "--json")
    assert code == 0
    assert [finding["code"] for finding in json.loads(stdout)["findings"]] == ["medial-axis"]


def test_an_output_folder_that_is_a_file(square: Path, invoke: Invoke) -> None:
    code, _, stderr = invoke("run", square, "--out", square / "deeper")
    assert code == 2
    assert "is not a folder" in one_line(stderr)


def test_files_are_written_all_or_none(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    (tmp_path / "b").mkdir()
    with pytest.raises(InputError, match="b: cannot be written"):
        app.write_files({tmp_path / "a": "new", tmp_path / "b": "new"})
    assert (tmp_path / "a").read_text() == "old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run"], "JOB.toml"),
        (["run", "a.toml", "--oops"], "--oops"),
        (["burn"], "burn"),
        (["verify", "a.nc"], "--job"),
        (["run", "missing.toml"], "missing.toml: no such job file"),
        (["init"], "needs a drawing"),
        (["mat", "a.dxf", "--tol", "0"], "tolerance 0 mm"),
        (["inspect", "a.dxf", "--tool", "-1"], "must be positive"),
        (["preview", "missing.nc"], "missing.nc: no such program"),
    ],
)
def test_usage_errors(arguments: list[str], expected: str, invoke: Invoke) -> None:
    code, _, stderr = invoke(*arguments)
    assert code == 2
    assert expected in one_line(stderr)


def test_internal_errors_are_one_line_unless_asked(
    invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr(app, "run", broken)
    code, _, stderr = invoke("run", "a.toml")
    assert code == 3
    assert "ZeroDivisionError: division by zero" in one_line(stderr)
    code, _, stderr = invoke("--traceback", "run", "a.toml")
    assert code == 3
    assert "Traceback" in stderr
    one_line(invoke("run", "a.toml")[2])  # it was asked for once


def test_an_interrupt_is_told_apart(invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(app, "run", interrupted)
    code, _, stderr = invoke("run", "a.toml")
    assert code == 130
    assert "interrupted" in one_line(stderr)


def test_verify_judges_the_text(square: Path, tmp_path: Path, invoke: Invoke) -> None:
    assert invoke("run", square, "--out", tmp_path)[0] == 0
    program = tmp_path / "square.ngc"
    code, stdout, stderr = invoke("verify", program, "--job", square)
    assert (code, stderr) == (0, "")
    assert "verified" in stdout
    program.write_text(program.read_text().replace("Z-2.0000", "Z-2.1000"))
    code, stdout, stderr = invoke("verify", program, "--job", square)
    assert code == 1
    assert "floor" in stderr
    code, stdout, _ = invoke("verify", program, "--job", square, "--json")
    data = json.loads(stdout)
    assert code == 1
    assert data["ok"] is False
    assert data["faults"]


def test_inspect(square: Path, invoke: Invoke) -> None:
    drawing = square.with_suffix(".dxf")
    code, stdout, _ = invoke("inspect", drawing, "--json", "--tool", "5", "--tool", "30")
    assert code == 0
    data = json.loads(stdout)
    assert data["units"] == "mm"
    assert data["area_mm2"] == pytest.approx(400)
    (region,) = data["regions"]
    assert region["largest_disk"]["diameter"] == pytest.approx(20)
    shares = {row["diameter_mm"]: row["share"] for row in data["tools"]}
    assert shares[5.0] == pytest.approx(1 - (4 - 3.14159) * 2.5**2 / 400, abs=1e-4)
    assert shares[30.0] == 0
    assert list(shares) == sorted(shares)
    code, stdout, _ = invoke("inspect", drawing)
    assert code == 0
    assert "20.000" in stdout


def test_mat(square: Path, tmp_path: Path, invoke: Invoke) -> None:
    drawing = square.with_suffix(".dxf")
    code, _, _ = invoke("mat", drawing, "--json", tmp_path / "m.json", "--svg", tmp_path / "m.svg")
    assert code == 0
    data = json.loads((tmp_path / "m.json").read_text())
    assert (data["units"], data["tolerance"]) == ("mm", 1e-6)
    (region,) = data["regions"]
    assert region["area"] == pytest.approx(400)
    assert region["certificate"]["euler"] is True
    assert len(region["vertices"]) == len(region["edges"]) + 1
    assert (tmp_path / "m.svg").read_text().startswith("<svg")
    code, stdout, _ = invoke("mat", drawing, "--json", "-")
    assert json.loads(stdout)["regions"][0]["vertices"] == region["vertices"]


def test_preview_of_jobs_and_programs(square: Path, tmp_path: Path, invoke: Invoke) -> None:
    assert invoke("run", square, "--out", tmp_path)[0] == 0
    code, stdout, _ = invoke("preview", square, "--svg", "-")
    assert code == 0
    assert stdout == (tmp_path / "square.svg").read_text()
    code, _, _ = invoke("preview", tmp_path / "square.ngc", "--svg", tmp_path / "p.svg")
    assert code == 0
    assert "cut at z -2 mm" in (tmp_path / "p.svg").read_text()


def test_init_makes_a_job_that_runs(
    square: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    square.unlink()
    assert invoke("init", "square.dxf")[0] == 0
    code, _, stderr = invoke("init", "square.dxf")
    assert code == 2
    assert "exists already" in one_line(stderr)
    assert invoke("run", "square.toml", "--out", "out")[0] == 0


@pytest.mark.parametrize(
    ("file", "name"),
    [("plate.toml", "plate"), ("(2) a+b @x.toml", "_2_ a+b _x"), ("+.toml", "job")],
)
def test_a_starter_job_is_called_like_its_file(
    file: str, name: str, square: Path, invoke: Invoke
) -> None:
    job = square.with_name(file)
    assert invoke("init", square.with_suffix(".dxf"), "--out", job)[0] == 0
    assert grassfire.load_job(job).name == name


def test_schema_is_json(invoke: Invoke) -> None:
    code, stdout, _ = invoke("init", "--schema")
    assert code == 0
    assert json.loads(stdout)["title"] == "grassfire job"


def test_posts(invoke: Invoke) -> None:
    code, stdout, _ = invoke("posts", "--json")
    assert code == 0
    posts = {post["name"]: post["extension"] for post in json.loads(stdout)}
    assert {"linuxcnc", "grbl"} <= set(posts)
    code, stdout, _ = invoke("posts")
    assert len(stdout.splitlines()) == len(posts)


def test_batch_ends_with_the_worst(square: Path, tmp_path: Path, invoke: Invoke) -> None:
    code, stdout, stderr = invoke("batch", square, tmp_path / "no.toml", "--out", tmp_path)
    assert code == 2
    assert stdout.startswith("ok ")
    assert len(stdout.splitlines()) == 1
    assert "no.toml: no such job file" in one_line(stderr)
    code, stdout, _ = invoke("batch", square, square, "--out", tmp_path, "--json")
    assert code == 0
    assert [row["exit_code"] for row in json.loads(stdout)] == [0, 0]


@pytest.mark.parametrize("path", sorted(JOBS.glob("*.toml")), ids=lambda path: path.stem)
def test_worked_examples_run(path: Path, tmp_path: Path, invoke: Invoke) -> None:
    code, _, stderr = invoke("run", path, "--out", tmp_path)
    assert (code, stderr) == (0, "")


def test_the_installed_command_starts_without_heavy_modules() -> None:
    script = (
        "import sys; from grassfire.cli import invoke; code = invoke(['--help']); "
        "heavy = {'numpy', 'scipy', 'shapely', 'ezdxf', 'pydantic', 'rich'} & set(sys.modules); "
        "sys.exit(code or len(heavy))"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0
    for name in ("run", "inspect", "mat", "preview", "verify", "posts", "init", "batch"):
        assert f"\n  {name} " in result.stdout


def test_module_and_version() -> None:
    result = subprocess.run(
        [sys.executable, "-m", "grassfire", "--version"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stdout) == (0, f"grassfire {grassfire.__version__}\n")


def test_public_names_resolve() -> None:
    for name in grassfire.__all__:
        assert getattr(grassfire, name) is not None
    assert set(grassfire.__all__) <= set(dir(grassfire))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = grassfire.nothing


def test_of_many_findings_alike_the_first_are_printed(tmp_path: Path, invoke: Invoke) -> None:
    import ezdxf

    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    angle = np.linspace(0.0, 2.0 * np.pi, 41)
    corners = 30.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    for start, end in pairwise(corners):
        document.modelspace().add_line(start + np.array([1e-4, 0.0]), end)
    document.saveas(tmp_path / "gaps.dxf")
    code, out, _ = invoke("inspect", tmp_path / "gaps.dxf")
    assert code == 0
    assert out.count("repair: gap of") == cli.MOST_ALIKE - 1
    assert f"... and {40 - cli.MOST_ALIKE + 1} more of gap-closed; --json gives all" in out
    assert len(json.loads(invoke("inspect", tmp_path / "gaps.dxf", "--json")[1])["findings"]) == 40


def test_a_slot_as_wide_as_the_tool_is_reached(tmp_path: Path, invoke: Invoke) -> None:
    import ezdxf

    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    corners = [(0, 0), (40, 0), (40, 6), (0, 6)]
    document.modelspace().add_lwpolyline(corners, close=True)
    document.saveas(tmp_path / "slot.dxf")
    _, out, _ = invoke("inspect", tmp_path / "slot.dxf", "--json", "--tool", "6.01")
    area = {row["diameter_mm"]: row["reachable_area_mm2"] for row in json.loads(out)["tools"]}
    assert area[6.0] == pytest.approx(34 * 6 + 9 * np.pi, rel=1e-3)
    assert area[6.01] == 0
