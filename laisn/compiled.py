"""How this project compiles: numba, with one set of flags and a cache that notices every edit.

Numba keys its cache by the file of the compiled function alone, so that an edited helper in another file would
go unnoticed. Here the cache folder carries a hash of all compiled sources.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

_PACKAGES = ("laisn", "sim", "experiments")
_KEPT_CACHES = 4


def _source_hash(root: Path) -> str:
    digest = hashlib.sha256()
    for package in _PACKAGES:
        for source in sorted((root / package).rglob("*.py")):
            text = source.read_bytes()
            if b"laisn.compiled" in text:
                digest.update(source.relative_to(root).as_posix().encode())
                digest.update(text)
    return digest.hexdigest()[:16]


def _cache_dir() -> Path:
    """Folder of this version's compiled code; the oldest folders of other versions are removed."""
    home = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    base = Path(home) / "laisn-sim"
    own = base / _source_hash(Path(__file__).resolve().parents[1])
    try:
        own.mkdir(parents=True, exist_ok=True)
        own.touch()
    except OSError:
        return Path(tempfile.gettempdir()) / f"laisn-sim-{os.getuid()}" / own.name
    others = sorted((p for p in base.iterdir() if p != own), key=lambda p: p.stat().st_mtime)
    for stale in others[: -_KEPT_CACHES or None]:
        for file in stale.rglob("*"):
            if file.is_file():
                file.unlink(missing_ok=True)
    return own


os.environ.setdefault("NUMBA_CACHE_DIR", str(_cache_dir()))

import numba  # noqa: E402  (its cache folder must be known before it is imported)

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function of arrays and scalars; division by zero gives inf or NaN as in NumPy."""
    return cast(Function, numba.njit(cache=True, error_model="numpy")(function))


def inlined(function: Function) -> Function:
    """Compile a small helper into its callers, so that loops over lanes stay vectorised."""
    return cast(Function, numba.njit(inline="always", error_model="numpy")(function))


def compiled_lanes(function: Function) -> Function:
    """Compile a pass over lanes: fused multiply-adds are allowed, NaN keeps its meaning, threads run side by side."""
    return cast(
        Function, numba.njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"}, nogil=True)(function)
    )
