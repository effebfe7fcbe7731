"""Report of the command on a machine, also where libraries are missing."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from experiments.command.cli import app


def test_doctor_names_what_it_tried() -> None:
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    for what in ("Python", "MuJoCo", "egl", "osmesa", "flight", "film"):
        assert what in result.output


HIDDEN = """
import importlib.machinery, sys
from experiments.command.cli import main
from sim.film import graphics

graphics.BACKENDS = ()  # to try what renders is another test's matter
modules, packages = sys.argv[1].split(), sys.argv[2].split()

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

find = importlib.machinery.PathFinder.find_distributions
importlib.machinery.PathFinder.find_distributions = lambda *given: (d for d in find(*given) if d.name not in packages)
sys.meta_path.insert(0, Hidden())
sys.argv = ["laisn", "doctor"]
main()
"""


@pytest.mark.parametrize(
    ("modules", "packages", "expected", "remedy"),
    [
        (
            "numba mujoco",
            "numba mujoco",
            {"numba": "is not installed", "mujoco": "is not installed"},
            r"pip install mujoco==[\d.]+ 'numba[<>=\d.,]+'$",
        ),
        (
            "av OpenGL",
            "",
            {
                "av": "cannot be imported: No module named 'av'",
                "pyopengl": "cannot be imported: No module named 'OpenGL'",
            },
            r"pip install --force-reinstall 'av>=[\d.]+' 'pyopengl>=[\d.]+'$",
        ),
        ("", "laisn-sim", {"laisn-sim": "is not installed"}, r"pip install -e \.$"),
    ],
)
def test_doctor_names_packages_that_are_missing_and_the_remedy(
    modules: str, packages: str, expected: dict[str, str], remedy: str
) -> None:
    command = [sys.executable, "-c", HIDDEN, modules, packages]
    environment = os.environ | {"COLUMNS": "200"}
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert (result.returncode, result.stderr) == (1, "")
    lines = [line.rstrip() for line in result.stdout.splitlines()]
    faults = dict(line.split(maxsplit=2)[1:] for line in lines if line.startswith("no"))
    assert {name: fault for name, fault in faults.items() if name not in ("flight", "film")} == expected
    assert [line for line in lines if re.search(remedy, line)]


@pytest.mark.parametrize("wanted", ["osmesa", "no-such-thing"])
def test_a_missing_graphics_library_stops_no_flight(wanted: str, tmp_path: Path) -> None:
    code = "import sys; sys.argv = ['laisn', 'check', 'T5']; from experiments.command.cli import main; main()"
    environment = os.environ | {"MUJOCO_GL": wanted}
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    assert "T5: valid: " in result.stdout


def test_the_command_works_where_other_packages_have_our_names(tmp_path: Path) -> None:
    for name in ("models", "sim", "experiments"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the wrong package')")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    code = "import sys; sys.argv = ['laisn', 'check', 'T5']; from laisn_sim import main; main()"
    # -P: as for a console script, whose folder stands first instead of the working directory
    command = [sys.executable, "-P", "-c", code]
    result = subprocess.run(
        command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert "T5: valid: " in result.stdout
