"""Imports run one way: experiments → sim → the vocabulary of laisn; laisn knows neither."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
VOCABULARY = {"laisn", "laisn.messages", "laisn.estimates", "laisn.settings", "laisn.geometry", "laisn.compiled",
              "laisn.elementary", "laisn.failure"}  # fmt: skip
ALLOWED_SIM_IN_LAISN: set[str] = set()


def imported(path: Path) -> set[str]:
    """Modules that a file imports anywhere, lazily too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {
                f"{node.module}.{alias.name}" if node.module in {"laisn", "sim", "experiments"} else node.module
                for alias in node.names
            }
    return found


def ours(modules: set[str], package: str) -> set[str]:
    return {m for m in modules if m.split(".")[0] == package}


@pytest.mark.parametrize("path", sorted((ROOT / "laisn").rglob("*.py")), ids=lambda p: p.name)
def test_laisn_knows_no_simulator(path: Path) -> None:
    modules = imported(path)
    assert not ours(modules, "sim") | ours(modules, "experiments") | ours(modules, "mujoco") | ours(modules, "models")


@pytest.mark.parametrize("path", sorted((ROOT / "sim").rglob("*.py")), ids=lambda p: p.name)
def test_the_world_speaks_only_the_vocabulary_of_navigation(path: Path) -> None:
    modules = imported(path)
    assert not ours(modules, "experiments")
    constants = {"laisn.REAR", "laisn.FRONT", "laisn.MIDDLE", "laisn.POSITION", "laisn.VELOCITY"}
    assert ours(modules, "laisn") <= VOCABULARY | constants


@pytest.mark.parametrize("path", sorted((ROOT / "laisn").rglob("*.py")), ids=lambda p: p.name)
def test_one_module_knows_filterpy(path: Path) -> None:
    assert ("filterpy" in {m.split(".")[0] for m in imported(path)}) == (path.name == "filter.py")


BLOCKED = """
import pkgutil, sys
from importlib import import_module

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"OpenGL", "EGL", "av"}:
            raise AssertionError(f"{name} is imported")

sys.meta_path.insert(0, Blocked())
for package in map(import_module, sys.argv[1:]):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        import_module(module.name)
        print(module.name)
"""


def test_no_module_loads_a_graphics_library_when_it_is_imported() -> None:
    """A machine without such libraries flies all the same; what films, loads them in a process of its own."""
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    command = [sys.executable, "-c", BLOCKED, "models", "laisn", "sim", "experiments"]
    child = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr
    assert {"sim.film.render", "sim.film.scene", "sim.film.studio", "experiments.command.cli"} <= set(
        child.stdout.split()
    )
