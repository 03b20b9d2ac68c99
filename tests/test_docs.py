"""The documents hold what the code does: examples run, links lead somewhere, keys are listed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from grassfire.cli import invoke
from grassfire.job import Heights, InputSettings, Job, Machine, Operation, Stock, Tool, parse_job

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_to_files(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)", path.read_text()):
        if "://" not in target:
            assert (path.parent / target).exists(), target


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_job_files_in_documents_are_valid(path: Path) -> None:
    for text in blocks(path, "toml"):
        assert parse_job(text, path).operations


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_python_in_documents_runs(
    path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "jobs").symlink_to(ROOT / "jobs")
    monkeypatch.chdir(tmp_path)
    for text in blocks(path, "python"):
        exec(compile(text, str(path), "exec"), {"__name__": "__main__"})


def test_every_key_of_job_files_is_documented() -> None:
    text = (ROOT / "docs" / "job-file.md").read_text()
    rows = set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))
    keys: set[str] = set()
    for model in (InputSettings, Stock, Heights, Machine, Tool, Operation):
        keys |= set(model.model_fields)
    keys |= set(Job.model_fields) - {"input", "stock", "heights", "machine", "tools", "operations"}
    assert keys == rows


def test_commands_in_the_readme_exist(capsys: pytest.CaptureFixture[str]) -> None:
    invoke(["--help"])
    known = re.findall(r"^  (\w+) ", capsys.readouterr().out, re.MULTILINE)
    used = re.findall(r"^\s*grassfire (\w+)", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert used
    assert set(used) <= set(known)


def test_every_module_has_its_row_in_the_architecture() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    for path in (ROOT / "src" / "grassfire").iterdir():
        if path.stem.startswith("_") or path.suffix not in (".py", "") or path.name == "py.typed":
            continue
        assert f"| `{path.stem}` |" in text, path.name


def test_every_dependency_has_its_line() -> None:
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    text = (ROOT / "docs" / "dependencies.md").read_text()
    for requirement in project["dependencies"] + project["optional-dependencies"]["dev"]:
        assert re.match(r"[\w-]+", requirement)[0] in text  # type: ignore[index]
