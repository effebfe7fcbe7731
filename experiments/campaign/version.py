"""The version that results carry: of the package, and of every source that may change a number."""

import ast
import hashlib
import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from importlib.util import resolve_name
from pathlib import Path

from laisn.navigators import code_of_navigators

ROOT = Path(__file__).resolve().parents[2]
"""Folder of this project's packages."""
OWN_PACKAGES = ("models", "laisn", "sim", "experiments")
_IN_CHECKOUT = ("tools", "tests")
"""Packages outside the wheel, in which some records of the documents are computed."""
PACKAGES = ("mujoco", "numpy", "scipy", "filterpy", "numba", "mcap", "av", "pyarrow")
"""Dependencies that shape results."""

_COMPUTING = ("experiments.campaign.campaign", "sim.scenario.file", *code_of_navigators())
"""Modules that compute the numbers of cells. Tasks and facts add modules of their own."""
_DATA = {".xml", ".json"}
"""Data files that modules of a package read: vehicles, routes."""
_TABLES = {".toml", ".csv"}
"""Data files that a study reads beside its modules."""


@cache
def imported_names(source: bytes, package: str) -> frozenset[str]:
    """Absolute names of modules, and of what is imported from them, in all import statements of a source.

    Relative imports start from `package`.
    """
    names = set()
    nodes: list[ast.AST] = [ast.parse(source)]
    for node in nodes:
        # expressions hold no statements
        nodes += (inner for inner in ast.iter_child_nodes(node) if not isinstance(inner, ast.expr))
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = resolve_name("." * node.level + (node.module or ""), package)
            names |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return frozenset(names)


def _file(module: str, root: Path) -> Path | None:
    """Source file of a module; None if these packages have no such module."""
    if module.partition(".")[0] not in (*OWN_PACKAGES, *_IN_CHECKOUT):
        return None
    place = root.joinpath(*module.split("."))
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def reachable(modules: Iterable[str], root: Path = ROOT) -> dict[str, Path]:
    """Source files, below `root`, of modules and of all that they import, directly or not, by module name.

    Raises FileNotFoundError if one of `modules` does not exist.
    """
    found: dict[str, Path] = {}
    names = list(modules)
    for name in names:
        if _file(name, root) is None:
            raise FileNotFoundError(f"{root}: module {name} does not exist")
    seen = set(names)
    while names:
        name = names.pop()
        path = _file(name, root)
        if path is not None:
            found[name] = path
            parent = name.rpartition(".")[0]
            package = name if path.name == "__init__.py" else parent
            # Python runs the packages around a module too
            new = {parent, *imported_names(path.read_bytes(), package)} - seen
            seen |= new
            names += new
    return found


def sources(root: Path = ROOT) -> tuple[Path, ...]:
    """Every file that may change a stored number: the modules that compute it, all that they import, and their data.

    Films, logs, pages and commands are not among them, since nothing that computes imports these.
    """
    found = reachable(_COMPUTING, root)
    # of `experiments` the modules alone: its data are published tables and a layout, to compare with and to draw
    packages = {name.partition(".")[0] for name in found} - {"experiments"}
    data = (p for package in packages for p in (root / package).rglob("*") if p.suffix in _DATA)
    return tuple(sorted({*found.values(), *data}))


def _without_docstrings(source: bytes) -> bytes:
    """A source without the lines of statements that are strings alone: these describe code and compute nothing."""
    lines = source.splitlines(keepends=True)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            first, last = node.lineno - 1, node.end_lineno or node.lineno
            if not lines[first][: node.col_offset].strip():
                lines[first:last] = [b""] * (last - first)
    return b"".join(lines)


def _digest(files: Iterable[Path], root: Path) -> str:
    """Hash of names and contents of files, of sources without their docstrings, 12 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in sorted(files):
        content = path.read_bytes()
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(_without_docstrings(content) if path.suffix == ".py" else content)
    return digest.hexdigest()[:12]


def fingerprint(root: Path = ROOT) -> str:
    """Hash of names and contents of `sources`, 12 hexadecimal digits."""
    return _digest(sources(root), root)


def version_of(modules: Iterable[str], root: Path = ROOT) -> str:
    """Hash of every source that may change the numbers that some modules compute, 12 hexadecimal digits.

    All that they import counts, the tables beside them, and all that any campaign computes with.
    """
    named = tuple(modules)
    found = reachable(named, root)
    data = (p for name in named for p in found[name].parent.iterdir() if p.suffix in _TABLES)
    return _digest({*found.values(), *data, *sources(root)}, root)


@cache
def code_version() -> str:
    """Version of the code, such as 0.1.0+3f2a9c81d0e4: results of different versions are never mixed."""
    return f"{version('laisn-sim')}+{fingerprint()}"


def versions() -> dict[str, str]:
    """Versions of this project and of the packages that shape its results, by name."""
    return {name: version(name) for name in ("laisn-sim", *PACKAGES)} | {"python": platform.python_version()}
