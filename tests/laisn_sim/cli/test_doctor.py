"""Report of the command on a machine, also where libraries are missing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from laisn_sim.cli.main import app

pytestmark = pytest.mark.system


def test_doctor_reports_libraries_graphics_flight_and_film() -> None:
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    for name in ("Python", "mujoco", "egl", "osmesa", "flight", "film"):
        assert name in result.output


@pytest.mark.parametrize("backend", ["osmesa", "no-such-thing"])
def test_a_missing_graphics_library_stops_no_check_of_a_scenario(backend: str) -> None:
    code = (
        "import sys; sys.argv = ['laisn', 'check', 'T5']; from laisn_sim.cli.main import "
        "main; main()"
    )
    environment = os.environ | {"MUJOCO_GL": backend}
    command = [sys.executable, "-c", code]
    result = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert "T5: valid: " in result.stdout


def test_the_command_works_where_other_packages_have_our_names(tmp_path: Path) -> None:
    for name in ("models", "sim", "reports", "experiments"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the wrong package')")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    code = "import sys; sys.argv = ['laisn', 'check', 'T5']; from laisn_sim import main; main()"
    # -P: as for a console script, whose folder stands first instead of the working directory
    command = [sys.executable, "-P", "-c", code]
    result = subprocess.run(
        command,
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert "T5: valid: " in result.stdout
