"""Job files: what is taken, what is refused, and that every refusal says where."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grassfire.errors import InputError
from grassfire.job import UNITS, Job, json_schema, load_job, parse_job

PATH = Path("folder") / "part.toml"

GOOD = """\
units = "mm"
[input]
file = "part.dxf"
[[tools]]
number = 1
diameter = 6.0
spindle_speed = 18000
feed = 1200
plunge_feed = 300
[[operations]]
strategy = "offset"
tool = 1
depth = 5.0
"""


def changed(old: str, new: str) -> str:
    assert GOOD.count(old) >= 1
    return GOOD.replace(old, new, 1)


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        parse_job(text, PATH)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(f"{PATH}: ")
    return line.removeprefix(f"{PATH}: ")


def test_defaults_are_filled_in() -> None:
    job = parse_job(GOOD, PATH)
    assert job.name == "part"
    assert job.post == "linuxcnc"
    assert job.tolerance == 0.002
    assert job.input.file == Path("folder/part.dxf")
    assert (job.clearance_height, job.retract_height) == (15.0, 3.0)
    operation = job.operations[0]
    assert operation.stepdown == operation.depth == 5.0
    assert (operation.stepover, operation.direction, operation.entry) == (0.4, "climb", "helix")
    assert operation.finish_pass
    assert job.tool(1).radius == 3.0


def test_heights_are_above_the_stock() -> None:
    job = parse_job(GOOD + "[stock]\ntop = 10\n", PATH)
    assert (job.clearance_height, job.retract_height) == (25.0, 13.0)


@given(
    value=st.floats(0.01, 100, allow_nan=False),
    unit=st.sampled_from(sorted(UNITS)),
    space=st.booleans(),
)
def test_a_length_is_the_same_in_every_spelling(value: float, unit: str, space: bool) -> None:
    text = f'"{value!r}{" " if space else ""}{unit}"'
    as_text = parse_job(changed("depth = 5.0", f"depth = {text}"), PATH)
    as_number = parse_job(
        changed('units = "mm"', f'units = "{unit}"')
        .replace("depth = 5.0", f"depth = {value!r}")
        .replace("diameter = 6.0", 'diameter = "6mm"'),
        PATH,
    )
    expected = value * UNITS[unit]
    assert as_text.operations[0].depth == pytest.approx(expected, rel=1e-15)
    assert as_number.operations[0].depth == pytest.approx(expected, rel=1e-15)


def test_speeds_follow_the_units_of_the_job() -> None:
    job = parse_job(
        changed('units = "mm"', 'units = "in"')
        .replace("feed = 1200", "feed = 40", 1)
        .replace("plunge_feed = 300", 'plunge_feed = "300 mm/min"')
        .replace("diameter = 6.0", "diameter = 0.25")
        .replace("depth = 5.0", "depth = 0.2")
        + '[machine]\nrapid = 200\nacceleration = "500 mm/s^2"\n',
        PATH,
    )
    assert job.tools[0].feed == pytest.approx(1016.0)
    assert job.tools[0].plunge_feed == 300.0
    assert job.machine.rapid == pytest.approx(5080.0)
    assert job.machine.acceleration == 500.0
    # What is not given is not converted.
    assert job.tolerance == 0.002
    assert job.heights.clearance == 15.0


@given(angle=st.floats(1.0, 180.0))
def test_engagement_angle_and_stepover_are_two_names_of_one_width(angle: float) -> None:
    job = parse_job(GOOD + f"engagement_angle = {angle!r}\n", PATH)
    operation = job.operations[0]
    assert operation.stepover is None
    width = operation.stepover_fraction * 2  # in tool radii
    assert math.acos(1 - width) == pytest.approx(math.radians(angle), abs=1e-7)
    assert operation.engagement_angle_radians == pytest.approx(math.radians(angle), abs=1e-7)


def test_a_stepdown_over_the_depth_is_one_pass() -> None:
    assert parse_job(GOOD + "stepdown = 50\n", PATH).operations[0].stepdown == 5.0


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        (changed("diameter", "diametre"), "tools[0].diametre", "did you mean 'diameter'?"),
        (changed("[input]", "[inputs]"), "inputs", "did you mean 'input'?"),
        (GOOD + "zzz = 1\n", "operations[0].zzz", "known keys: strategy, tool"),
        (changed("diameter = 6.0\n", ""), "tools[0].diameter", "missing key"),
        (changed("depth = 5.0", "depth = 0"), "operations[0].depth", "greater than 0"),
        (changed("depth = 5.0", "depth = -2"), "operations[0].depth", "greater than 0"),
        (changed("depth = 5.0", "depth = inf"), "operations[0].depth", "finite"),
        (changed("depth = 5.0", "depth = true"), "operations[0].depth", "expected a number"),
        (changed("depth = 5.0", 'depth = "5 furlong"'), "operations[0].depth", "not a quantity"),
        (changed("depth = 5.0", 'depth = "5mm/min"'), "operations[0].depth", "not a quantity"),
        (changed("feed = 1200", 'feed = "9mm/s2"'), "tools[0].feed", "not a quantity"),
        (changed("tool = 1", "tool = 7"), "operations[0].tool", "no tool has number 7"),
        (changed("number = 1", "number = 1.5"), "tools[0].number", "1.5"),
        (changed('"offset"', '"offst"'), "operations[0].strategy", "offered: offset"),
        (changed('"offset"', '"vcarve"'), "operations[0].strategy", "not offered yet"),
        (
            GOOD + "stepover = 0.3\nengagement_angle = 60\n",
            "operations[0].engagement_angle",
            "contradicts stepover",
        ),
        (GOOD + "stepover = 1.5\n", "operations[0].stepover", "less than or equal to 1"),
        (GOOD + "axial_allowance = 5\n", "operations[0].axial_allowance", "nothing would be cut"),
        (GOOD + "radial_allowance = -0.1\n", "operations[0].radial_allowance", "0"),
        (GOOD + 'entry = "drill"\n', "operations[0].entry", "'helix', 'ramp' or 'plunge'"),
        (GOOD + "ramp_angle = 90\n", "operations[0].ramp_angle", "30"),
        (GOOD + "[stock]\nthickness = 4\n", "operations[0].depth", "below the stock"),
        (GOOD + "[heights]\nretract = 20\n", "heights.retract", "above heights.clearance"),
        (changed("number = 1", 'number = 1\nshape = "v"'), "operations[0].tool", "'v'"),
        ('name = "a/b"\n' + GOOD, "name", "pattern"),
        ("tolerance = 1\n" + GOOD, "tolerance", "tenth of the radius"),
        (changed("[[operations]]", "[operations]"), "operations", "tuple"),
        (changed('"part.dxf"', "3"), "input.file", "name of a file"),
        (changed('units = "mm"', 'units = "ell"'), "units", "known: mm, cm, m, in, inch"),
    ],
)
def test_each_fault_names_its_key(text: str, place: str, words: str) -> None:
    line = refusal(text)
    assert line.startswith(f"{place}: ")
    assert words in line


def test_tool_numbers_are_unique() -> None:
    tool = GOOD[GOOD.index("[[tools]]") : GOOD.index("[[operations]]")]
    line = refusal(GOOD + tool)
    assert line.startswith("tools[1].number: 1 is used by tools[0]")


def test_other_faults_are_counted() -> None:
    text = changed("depth = 5.0", "depth = -1").replace("feed = 1200", "feed = -1", 1)
    assert "1 more fault in this file" in refusal(text)


def test_broken_toml_is_located() -> None:
    assert "line 2" in refusal("units = 'mm'\n[input\n")


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing\.toml: no such job file"):
        load_job(tmp_path / "missing.toml")
    with pytest.raises(InputError, match="cannot be read"):
        load_job(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b'name = "\xe4"')
    with pytest.raises(InputError, match="not UTF-8"):
        load_job(tmp_path / "latin.toml")


def test_names_are_relative_to_the_job_file(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(GOOD)
    job = load_job(tmp_path / "a.toml")
    assert job.name == "a"
    assert job.input.file == tmp_path / "part.dxf"
    assert job.directory == tmp_path
    assert job.with_post("grbl").post == "grbl"
    assert job.with_post("grbl").directory == tmp_path


def test_an_unknown_tool_is_asked_for() -> None:
    with pytest.raises(InputError, match="no tool has number 3"):
        parse_job(GOOD, PATH).tool(3)


def test_schema_covers_every_key() -> None:
    schema = json_schema()
    assert json.loads(json.dumps(schema)) == schema
    assert set(schema["properties"]) == set(Job.model_fields)
    assert schema["additionalProperties"] is False
    assert schema["$defs"]["Tool"]["properties"]["diameter"]["type"] == ["number", "string"]
    assert schema["$defs"]["Operation"]["properties"]["strategy"]["enum"][:2] == [
        "offset",
        "spiral",
    ]
    assert "name" not in schema["required"]


def test_worked_examples_load() -> None:
    jobs = sorted((Path(__file__).resolve().parents[1] / "jobs").glob("*.toml"))
    assert len(jobs) >= 3
    for path in jobs:
        job = load_job(path)
        assert job.name == path.stem
        assert job.input.file.is_file()
