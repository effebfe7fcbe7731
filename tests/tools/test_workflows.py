"""Workflows and issue templates of the repository's host agree with the project."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from laisn_sim.cli.main import app

WORKFLOWS = sorted(Path(".github/workflows").glob("*.yml"))
TEMPLATES = sorted(Path(".github/ISSUE_TEMPLATE").glob("*.yml"))
PROJECT_FILE = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
OLDEST_PYTHON = PROJECT_FILE["project"]["requires-python"].removeprefix(">=")


def run_lines() -> list[str]:
    """All lines that the jobs run."""
    jobs = [
        job
        for path in WORKFLOWS
        for job in yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].values()
    ]
    return [
        line.strip()
        for job in jobs
        for step in job["steps"]
        for line in step.get("run", "").splitlines()
    ]


def python_versions() -> list[str]:
    """Versions of Python on which the tests run."""
    (path,) = WORKFLOWS
    jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    return list(jobs["tests"]["strategy"]["matrix"]["python"])


def test_tests_lint_documents_and_a_wheel_are_made_by_targets_of_the_makefile() -> None:
    makefile = Path("Makefile").read_text(encoding="utf-8").replace("$(VENV)", ".venv")
    names = re.findall(r"^([\w./ -]+):", makefile, flags=re.MULTILINE)
    targets = {name for line in names for name in line.split()}
    targets_run = [line.split()[1] for line in run_lines() if line.startswith("make ")]
    assert set(targets_run) <= targets
    assert {"test-all", "check", "docs"} <= set(targets_run)
    assert any("-m build --wheel" in line for line in run_lines())


def test_the_oldest_python_that_is_allowed_is_tested_and_newer_ones() -> None:
    assert python_versions()[0] == OLDEST_PYTHON
    assert len(python_versions()) >= 3


def test_the_wheel_is_flown_by_options_that_exist() -> None:
    (line,) = (line for line in run_lines() if "bin/laisn fly" in line)
    help_text = CliRunner().invoke(app, ["fly", "--help"], env={"COLUMNS": "200"}).output
    for option in re.findall(r"--[a-z-]+", line):
        assert option in help_text


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_issue_templates_name_commands_and_files_that_exist(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    yaml.safe_load(text)
    for command in re.findall(r"`laisn (\w+)`", text):
        assert CliRunner().invoke(app, [command, "--help"]).exit_code == 0
    for file in re.findall(r"`([\w/]+\.md)`", text):
        assert Path(file).is_file()
