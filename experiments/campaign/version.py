"""The version that results carry: of the package, and of every source that may change a number."""

import hashlib
import platform
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from pathlib import Path

from laisn.sources import ROOT, Sources

PACKAGES = ("mujoco", "numpy", "scipy", "filterpy", "numba", "mcap", "av", "pyarrow")
"""Packages that shape results."""

_COMPUTING = ("experiments.campaign.campaign", "sim.scenario.file")
"""Where the numbers of cells begin: runs, and settings as a scenario. Tasks and facts add sources of their own."""
_DATA = {".xml", ".json"}
"""Files beside the modules of a package that its modules read: vehicles, routes."""


def sources(root: Path = ROOT) -> tuple[Path, ...]:
    """Every file that may change a stored number: what the computing modules import, directly or not, and its data.

    An import inside a function counts like one at the top. Films, logs, pages and commands are not among them, since
    nothing that computes imports these.

    Args:
        root: folder of the packages.

    Raises:
        FileNotFoundError: a computing module is not there.
    """
    found = Sources(root).reached(_COMPUTING)
    # of `experiments` the modules alone: its data are published tables and a layout, to compare with and to draw
    packages = {name.partition(".")[0] for name in found} - {"experiments"}
    data = (p for package in packages for p in (root / package).rglob("*") if p.suffix in _DATA)
    return tuple(sorted({*found.values(), *data}))


def fingerprint(root: Path = ROOT) -> str:
    """Hash of names and bytes of `sources`, 12 hexadecimal digits."""
    digest = hashlib.sha256()
    for path in sources(root):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def version_of(modules: Iterable[str], root: Path = ROOT) -> str:
    """Hash of every source that may change the numbers of a study.

    Args:
        modules: where its numbers are made; all that these can reach counts, and all that any campaign computes with.
        root: folder of the packages.
    """
    files = {*Sources(root).reached(modules).values(), *sources(root)}
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


@cache
def code_version() -> str:
    """Version of code, such as 0.1.0+3f2a9c81d0e4: results of different versions are never mixed. Takes 10 ms."""
    return f"{version('laisn-sim')}+{fingerprint()}"


def versions() -> dict[str, str]:
    """Versions of this project and of the packages that shape its results, by name."""
    return {name: version(name) for name in ("laisn-sim", *PACKAGES)} | {"python": platform.python_version()}
