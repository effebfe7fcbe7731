"""The version that results carry: of the package, and of every source that may change a number."""

import ast
import hashlib
import platform
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from modulefinder import ModuleFinder
from pathlib import Path

from laisn.navigators import code_of_navigators
from sim.system import atomic_write

ROOT = Path(__file__).resolve().parents[1]
OWN_PACKAGES = ("models", "laisn", "sim", "reports", "experiments", "laisn_sim")
# outside the wheel: some records of the documents are computed there
_CHECKOUT_ONLY = ("tools", "tests")
# dependencies that shape results
PACKAGES = ("mujoco", "numpy", "scipy", "numba", "mcap", "av", "pyarrow")

_COMPUTING = ("experiments.campaign.campaign", "sim.scenario.file", *code_of_navigators())
"""Modules that compute the numbers of a study's cells. Tasks and facts (`experiments.campaign`) add
modules of their own.
"""
_DATA = {".xml", ".json"}  # data files that modules of a package read: vehicles, routes
_TABLES = {".toml", ".csv"}  # data files that a study reads beside its modules
_MAX_STORED = 200  # versions on disk, of the same compiled sources


def reachable(modules: Iterable[str], root: Path = ROOT) -> dict[str, Path]:
    """Source files, below `root`, of modules and of all that they import, directly or not, by
    module name.

    Raises ImportError if one of `modules` does not exist.
    """
    # an installed wheel has other packages beside it
    others = {path.name.partition(".")[0] for path in root.iterdir()} - {
        *OWN_PACKAGES,
        *_CHECKOUT_ONLY,
    }
    finder = ModuleFinder([str(root)], excludes=others)
    # `ModuleFinder` finds no folders without `__init__.py`
    for folder in (root / "tests", *(root / "tests").rglob("*/")):
        if folder.is_dir() and not (folder / "__init__.py").exists():
            vars(finder.add_module(".".join(folder.relative_to(root).parts)))["__path__"] = [
                str(folder)
            ]
    for name in modules:
        finder.import_hook(name)
    return {
        name: Path(file)
        for name, module in finder.modules.items()
        if (file := vars(module)["__file__"])
    }


def sources(modules: Iterable[str] = (), root: Path = ROOT) -> list[Path]:
    """Every file that may change a stored number: modules that compute, all that they import, and
    their data.

    Films, logs, pages and commands are not among them, since nothing that computes imports these.

    Args:
        modules: that compute beside those of all campaigns; the tables beside them count too.
        root: folder of the packages.
    """
    module_names = tuple(modules)
    files = reachable((*_COMPUTING, *module_names), root)
    # of `experiments` the modules alone: its data are published tables and a layout, to compare
    # with and to draw
    data = {
        p
        for package in ("models", "laisn", "sim")
        for p in (root / package).rglob("*")
        if p.suffix in _DATA
    }
    tables = {
        p for name in module_names for p in files[name].parent.iterdir() if p.suffix in _TABLES
    }
    return sorted({*files.values(), *data, *tables})


@cache
def _without_docstrings(source: bytes) -> bytes:
    """A source without the lines of statements that are strings alone: these describe code and
    compute nothing.
    """
    lines = source.splitlines(keepends=True)
    for node in ast.walk(ast.parse(source)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            first = node.lineno - 1
            last = node.end_lineno or node.lineno
            if not lines[first][: node.col_offset].strip():
                lines[first:last] = [b""] * (last - first)
    return b"".join(lines)


def version_of(modules: Iterable[str] = (), root: Path = ROOT) -> str:
    """Hash of names and contents of `sources`, without docstrings, 12 hexadecimal digits.

    That of the sources that are here is looked up once in a process, which has loaded them once.
    """
    names = tuple(modules)
    return _version_here(names) if root == ROOT else _version(names, root)


@cache
def _version_here(modules: tuple[str, ...]) -> str:
    """The version from disk, under a hash of every file that may decide it: who imports whom, and
    where the docstrings are, takes a second to find out.
    """
    folder = _folder()
    if folder is None:
        return _version(modules, ROOT)
    file = folder / _digest_of_packages(modules)
    with suppress(OSError, UnicodeDecodeError):
        stored = file.read_text(encoding="ascii")
        if re.fullmatch("[0-9a-f]{12}", stored):
            return stored
    computed = _version(modules, ROOT)
    # that it is not stored costs the next process a second, and nothing else
    with suppress(OSError):
        file.parent.mkdir(exist_ok=True)
        with atomic_write(file, durable=False) as unfinished:
            unfinished.write_text(computed, encoding="ascii")
        by_age = sorted(file.parent.iterdir(), key=lambda path: path.stat().st_mtime)
        for old in by_age[:-_MAX_STORED]:
            old.unlink(missing_ok=True)
    return computed


def _folder() -> Path | None:
    """Where versions are stored; None: nowhere."""
    # the compiler takes half a second to import, and pages need none of it
    from laisn.compiled import FOLDER

    return None if FOLDER is None else FOLDER / "versions"


def _digest_of_packages(modules: tuple[str, ...]) -> str:
    """Hash of the modules' names, of Python's version, and of names and contents of all files that
    `sources` can reach from them.
    """
    folders = {*OWN_PACKAGES, *(name.partition(".")[0] for name in modules)}
    if not folders.isdisjoint(_CHECKOUT_ONLY):
        folders |= {*_CHECKOUT_ONLY}
    suffixes = {".py", *_DATA, *_TABLES}
    digest = hashlib.sha256(repr((sys.version, modules)).encode())
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*")):
        if path.suffix in suffixes:
            content = hashlib.sha256(path.read_bytes()).hexdigest()
            digest.update(f"{path.relative_to(ROOT).as_posix()} {content} ".encode())
    return digest.hexdigest()[:32]


def _version(modules: tuple[str, ...], root: Path) -> str:
    digest = hashlib.sha256()
    for path in sources(modules, root):
        content = path.read_bytes()
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(_without_docstrings(content) if path.suffix == ".py" else content)
    return digest.hexdigest()[:12]


@cache
def code_version() -> str:
    """Version of the code, such as 0.1.0+3f2a9c81d0e4: results of different versions are never
    mixed.
    """
    return f"{version('laisn-sim')}+{version_of()}"


def versions() -> dict[str, str]:
    """Versions of this project and of the packages that shape its results, by name."""
    return {name: version(name) for name in ("laisn-sim", *PACKAGES)} | {
        "python": platform.python_version()
    }
