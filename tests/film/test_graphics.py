"""Which graphics libraries render: judged by pixels, in a child process."""

import os
import subprocess
import sys

import pytest

from sim.film import graphics


def test_probe_examines_every_backend_and_gives_reasons():
    found = graphics.probe()
    assert tuple(b.name for b in found) == graphics.BACKENDS
    assert all(b.detail for b in found)


def test_working_is_the_first_that_renders():
    able = [b for b in graphics.probe() if b.works]
    assert graphics.working() == (able[0] if able else None)


def test_this_process_keeps_its_environment():
    before = dict(os.environ)
    graphics.child("pass", (), "egl")
    graphics.probe()
    assert dict(os.environ) == before


def test_a_backend_that_does_not_exist_is_reported_not_raised():
    found = graphics._examine("no-such-backend")
    assert not found.works
    assert "no-such-backend" in found.detail


def test_a_library_that_is_not_installed_is_called_so(monkeypatch):
    """PyOpenGL's own words for it say nothing to a newcomer."""
    program = (sys.executable, "-c", "None.glGetError()")
    monkeypatch.setattr(graphics, "child", lambda *_: (program, dict(os.environ)))
    assert graphics._examine("osmesa") == graphics.Backend("osmesa", False, "its library is not installed")


def test_a_child_imports_our_modules_whatever_the_working_directory_holds(tmp_path):
    for name in ("models", "sim", "json"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the wrong module')")
    command, environment = graphics.child("import json, sim.film.graphics; print(sys.argv[1])", ("fine",), "egl")
    answer = subprocess.run(
        command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60
    )
    assert answer.stdout.strip() == "fine"


@pytest.mark.skipif(sys.platform != "linux", reason="the message names Debian's packages")
def test_the_remedy_names_packages():
    assert "apt-get install" in graphics.INSTALL
