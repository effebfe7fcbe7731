"""Which graphics libraries render: judged by pixels, in a child process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sim.film import graphics
from tools import import_graph

ROOT = Path(__file__).resolve().parents[3]


def test_probe_examines_every_backend_and_gives_details():
    actual = graphics.probe()
    assert tuple(b.name for b in actual) == graphics.BACKENDS
    assert all(b.detail for b in actual)


def test_working_is_the_first_that_renders():
    rendering = [b for b in graphics.probe() if b.works]
    assert graphics.working() == (rendering[0] if rendering else None)


def test_probing_leaves_the_environment_of_this_process_alone():
    before = dict(os.environ)
    graphics.child("pass", "egl")
    graphics.probe()
    assert dict(os.environ) == before


def test_a_backend_that_does_not_exist_is_reported_not_raised():
    actual = graphics._examine("no-such-backend")
    assert not actual.works
    assert "no-such-backend" in actual.detail


def test_a_library_that_is_not_installed_is_called_so(monkeypatch):
    """PyOpenGL's own message, for which a call of None stands here, does not explain it."""
    program = (sys.executable, "-c", "None.glGetError()")
    monkeypatch.setattr(graphics, "child", lambda *_: (program, dict(os.environ)))
    assert graphics._examine("osmesa") == graphics.Backend(
        "osmesa", False, "its library is not installed"
    )


def test_a_child_imports_the_packages_modules_in_any_working_directory(tmp_path):
    for name in ("models", "sim", "json"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the wrong module')")
    command, environment = graphics.child("import json, sim.film.graphics; print('fine')", "egl")
    child = subprocess.run(
        command,
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert child.stdout.strip() == "fine"


IMPORT_ALL_WITHOUT_GRAPHICS = """
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


@pytest.mark.system
def test_no_module_loads_a_graphics_library_when_it_is_imported():
    """A machine without such libraries flies all the same; what films, loads them in a process
    of its own.
    """
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    command = [sys.executable, "-c", IMPORT_ALL_WITHOUT_GRAPHICS, *import_graph.PACKAGES]
    child = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert child.returncode == 0, child.stderr
    filming = {"sim.film.render", "sim.film.scene", "laisn_sim.cli.main"}
    assert filming <= set(child.stdout.split())


@pytest.mark.skipif(sys.platform != "linux", reason="the message names Debian's packages")
def test_the_advice_names_packages_to_install():
    assert "apt-get install" in graphics.INSTALL
