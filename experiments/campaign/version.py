"""The version that results carry: of the package, and of every source that may change a number."""

import ast
import hashlib
import platform
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from importlib.util import resolve_name
from pathlib import Path

PACKAGES = ("mujoco", "numpy", "scipy", "filterpy", "numba", "mcap", "av", "pyarrow")
"""Packages that shape results."""

_ROOT = Path(__file__).resolve().parents[2]
_PACKAGES = ("models", "laisn", "sim", "experiments")
_COMPUTING = ("experiments.campaign.campaign", "sim.scenario.file", "sim.tilt")
"""Where numbers begin: cells of runs, settings as a scenario, and what the pitch study flies besides."""
_DATA = {".xml", ".json"}
"""Files beside the modules of a package that its modules read: vehicles, routes."""


def _imports(module: str, path: Path) -> Iterator[str]:
    """Names that a module imports anywhere in its text; a name may be a module or something within one."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = resolve_name("." * node.level + (node.module or ""), package) if node.level else node.module or ""
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _file(root: Path, module: str) -> Path | None:
    """Source of one of our modules; None if the name is none."""
    place = root.joinpath(*module.split("."))
    return next((p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file()), None)


def sources(root: Path = _ROOT) -> tuple[Path, ...]:
    """Every file that may change a stored number: what the computing modules import, directly or not, and its data.

    An import inside a function counts like one at the top. Films, logs, pages and commands are not among them, since
    nothing that computes imports these.

    Args:
        root: folder of the packages.

    Raises:
        FileNotFoundError: a computing module is not there.
    """
    found: dict[str, Path] = {}
    names = list(_COMPUTING)
    while names:
        name = names.pop()
        if name in found or name.partition(".")[0] not in _PACKAGES:
            continue
        path = _file(root, name)
        if path is None:
            if name in _COMPUTING:
                raise FileNotFoundError(f"{root}: module {name} is not there")
            continue
        found[name] = path
        # with a module, Python runs the packages around it
        names += [name.rpartition(".")[0], *_imports(name, path)]
    # of `experiments` the modules alone: its data are published tables and a layout, to compare with and to draw
    packages = {name.partition(".")[0] for name in found} - {"experiments"}
    data = (p for package in packages for p in (root / package).rglob("*") if p.suffix in _DATA)
    return tuple(sorted({*found.values(), *data}))


def fingerprint(root: Path = _ROOT) -> str:
    """Hash of names and bytes of `sources`, 12 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in sources(root):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


@cache
def code_version() -> str:
    """Such as 0.1.0+3f2a9c81d0e4: results of different versions are never mixed. Reading the sources takes 0.1 s."""
    return f"{version('laisn-sim')}+{fingerprint()}"


def versions() -> dict[str, str]:
    """Versions of this project and of the packages that shape its results, by name."""
    return {name: version(name) for name in ("laisn-sim", *PACKAGES)} | {"python": platform.python_version()}
