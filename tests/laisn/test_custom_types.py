"""Names of users' classes, under which compiled code is stored: they depend on all the source."""

# mypy: allow-untyped-calls

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numba
import pytest

from laisn.custom_types import name_of_custom

SOURCE = """
import math
from typing import NamedTuple

import numpy as np

from helper import gain
from laisn.compiled import jitable

OFFSET = 0.5
TABLE = np.array([1.0, 2.0])


class Mine(NamedTuple):
    a: float

    @jitable
    def value(self, scale=1.0):
        return gain(self.a) * scale + OFFSET + TABLE[0] + math.pi
"""
HELPER_SOURCE = """
FACTOR = 2.0


def gain(x):
    return FACTOR * x
"""


class Project:
    """A folder with two files of a user's, as a process sees it that imports them now."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.write("mine.py", SOURCE)
        self.write("helper.py", HELPER_SOURCE)

    def write(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text, encoding="utf-8")

    def imported(self) -> ModuleType:
        for name in ("mine", "helper"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module("mine")

    def name(self) -> str | None:
        return name_of_custom((numba.typeof(self.imported().Mine(1.0)), numba.int64))


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield Project(tmp_path)
    for name in ("mine", "helper"):
        sys.modules.pop(name, None)


def test_a_class_has_the_same_name_whenever_it_is_imported(project: Project) -> None:
    first = project.name()
    assert first
    assert project.name() == first


@pytest.mark.parametrize(
    ("file", "before", "after"),
    [
        ("mine.py", "* scale + OFFSET", "* scale - OFFSET"),
        ("mine.py", "OFFSET = 0.5", "OFFSET = 0.6"),
        ("mine.py", "scale=1.0", "scale=1.5"),
        ("mine.py", "[1.0, 2.0]", "[1.0, 3.0]"),
        ("helper.py", "FACTOR * x", "FACTOR + x"),
        ("helper.py", "FACTOR = 2.0", "FACTOR = 3.0"),
    ],
)
def test_an_edit_gives_another_name_and_its_undoing_the_first(
    project: Project, file: str, before: str, after: str
) -> None:
    first = project.name()
    text = {"mine.py": SOURCE, "helper.py": HELPER_SOURCE}[file]
    assert before in text
    project.write(file, text.replace(before, after))
    assert project.name() not in (first, None)
    project.write(file, text)
    assert project.name() == first


def test_a_name_depends_on_the_class_in_memory_and_not_only_on_its_file(project: Project) -> None:
    """An edit that is not imported yet, and constants that are changed from outside."""
    module = project.imported()
    signature = numba.typeof(module.Mine(1.0))
    first = name_of_custom(signature)
    project.write("helper.py", HELPER_SOURCE.replace("FACTOR = 2.0", "FACTOR = 3.0"))
    # the old class is in memory while the file is new already
    stale = name_of_custom(signature)
    assert stale != project.name()
    project.write("helper.py", HELPER_SOURCE)
    module = project.imported()
    module.OFFSET = 7.0  # type: ignore[attr-defined]
    assert name_of_custom(numba.typeof(module.Mine(1.0))) not in (first, None)


def test_a_class_that_no_other_process_can_import_has_no_name(project: Project) -> None:
    class Local(NamedTuple):
        a: float

    assert name_of_custom(numba.typeof(Local(1.0))) is None
    old = project.imported().Mine(1.0)
    project.imported()
    # of a module that was imported again
    assert name_of_custom(numba.typeof(old)) is None


def test_a_constant_that_cannot_be_described_leaves_a_class_without_a_name(
    project: Project,
) -> None:
    project.write("mine.py", SOURCE.replace("OFFSET = 0.5", "OFFSET = object()"))
    assert project.name() is None


def test_signatures_of_the_project_alone_have_an_empty_name() -> None:
    assert name_of_custom((numba.float64, numba.typeof((1.0, 2)))) == ""


def test_classes_of_one_name_in_two_files_have_different_names(project: Project) -> None:
    """Also with the same text, as the modules differ."""
    first = project.name()
    project.write("other.py", SOURCE)
    try:
        other = importlib.import_module("other")
        assert name_of_custom((numba.typeof(other.Mine(1.0)), numba.int64)) not in (first, None)
    finally:
        sys.modules.pop("other", None)


@pytest.mark.parametrize("file", [None, "script.py"])
def test_a_class_of_a_notebooks_cell_or_a_script_has_no_name(
    monkeypatch: pytest.MonkeyPatch, file: str | None
) -> None:
    """Another process has another `__main__`."""
    main = ModuleType("__main__")
    if file is not None:
        main.__file__ = file
    monkeypatch.setitem(sys.modules, "__main__", main)
    text = "from typing import NamedTuple\nclass Cell(NamedTuple):\n    a: float\n"
    exec(compile(text, "<cell 1>", "exec"), vars(main))
    cell = vars(main)["Cell"]
    assert cell.__module__ == "__main__"
    assert name_of_custom(numba.typeof(cell(1.0))) is None


def test_a_class_of_a_module_without_a_file_has_no_name(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("made")
    monkeypatch.setitem(sys.modules, "made", module)
    text = "from typing import NamedTuple\nclass Made(NamedTuple):\n    a: float\n"
    exec(compile(text, "<string>", "exec"), vars(module))
    assert name_of_custom(numba.typeof(vars(module)["Made"](1.0))) is None
