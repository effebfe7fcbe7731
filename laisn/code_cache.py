"""Machine code that is kept from one process to the next, under a hash of all that made it.

Compiled code freezes constants of whatever modules its own module can reach, and holds the code of what it calls. The
key therefore covers every source within reach, beside compiler, processor and argument types; editing any of them
compiles again what can reach it, and nothing else. A file proves that it is whole before any of it is used.
"""

import hashlib
import os
import pickle
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core import serialize
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys

from laisn.sources import PACKAGES, ROOT, Sources
from laisn.whole_files import parts, remove_abandoned, replaced

_KEPT_VERSIONS = 16
"""Most files kept of a function, over versions of its sources, argument types and stages of compilation."""
_DIGEST = hashlib.sha256().digest_size


def _states() -> dict[Path, tuple[int, int]]:
    """When each source was changed, and its size."""
    found = {}
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            state = path.stat()
            found[path] = state.st_mtime_ns, state.st_size
    return found


_SOURCES, _AT_START = Sources(), _states()


def _is_private(folder: Path) -> bool:
    """Whether this user owns a folder and nobody else can write there."""
    state = folder.lstat()
    return stat.S_ISDIR(state.st_mode) and state.st_uid == os.geteuid() and not state.st_mode & 0o022


@cache
def folder() -> Path | None:
    """Folder that holds compiled code; None if there is none that this user, and nobody else, can write to.

    It is `laisn-sim/code` in XDG_CACHE_HOME, or in ~/.cache. What is read there is run: a folder that others can write
    is not used.
    """
    home = os.environ.get("XDG_CACHE_HOME", "")
    try:
        place = (Path(home) if os.path.isabs(home) else Path("~/.cache").expanduser()) / "laisn-sim" / "code"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.mkdir(mode=0o700, exist_ok=True)
        usable = _is_private(place) and os.access(place, os.W_OK | os.X_OK)
    except (OSError, RuntimeError):
        # RuntimeError: this user has no home
        return None
    return place if usable else None


def keeps_nothing() -> bool:
    """Whether code could be kept and none is, so that all that is called must be compiled."""
    place = folder()
    return place is not None and next(place.glob("*.code"), None) is None


@cache
def _stamp(module: str) -> str | None:
    """Hash of compiler and sources of a module's functions; None if code cannot be kept.

    That is where the module is none of this project, or a source was edited since this process began: the edit may
    have come before or after Python read it.
    """
    if _SOURCES.file(module) is None:
        return None
    digest = hashlib.sha256(repr((numba.__version__, llvmlite.__version__, np.__version__, sys.version)).encode())
    for name, path in sorted(_SOURCES.reached([module]).items()):
        text, state = _SOURCES.text(path), path.stat()
        if _AT_START.get(path) != (state.st_mtime_ns, state.st_size):
            return None
        digest.update(repr((name, len(text))).encode())
        digest.update(text)
    return digest.hexdigest()


def _newest_first(paths: Iterator[Path]) -> list[Path]:
    def age(path: Path) -> float:
        try:
            return -path.stat().st_mtime
        except FileNotFoundError:
            return 0.0

    return sorted(paths, key=age)


def _symbols(library: Any) -> list[str]:
    """What compiled code expects the process to have."""
    module = library._final_module
    declared = (item.name for item in (*module.functions, *module.global_variables) if item.is_declaration)
    return sorted(name for name in declared if not name.startswith("llvm."))


def _provide(symbols: list[str], target_context: Any) -> None:
    """Have this process know what compiled code expects of it.

    For most code that is numba's memory management alone. All that numba can compile, which numba itself loads before
    it takes any code from a cache, takes most of a second.
    """
    rtsys.initialize(target_context)
    if any(llvmlite.binding.address_of_symbol(name) is None for name in symbols):
        target_context.refresh()


class CodeCache(NullCache):
    """What numba asks for compiled code of one function, and gives it to."""

    def __init__(self, function: Callable[..., Any]) -> None:
        """Prepare for a function; nothing is kept of one with a closure, whose content no source tells."""
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._stamp = None if function.__closure__ else _stamp(function.__module__)
        self._line = function.__code__.co_firstlineno

    def _path(self, code: str, codegen: Any) -> Path | None:
        """File of code for some types of arguments; None if it cannot be kept."""
        place = folder()
        if self._stamp is None or place is None:
            return None
        made_of = repr((self._stamp, self._name, self._line, code, codegen.magic_tuple()))
        return place / f"{self._name}.{hashlib.sha256(made_of.encode()).hexdigest()[:32]}.code"

    def _load(self, code: str, codegen: Any) -> Any:
        """What was kept; None if nothing was."""
        path = self._path(code, codegen)
        content = None if path is None else _read(path)
        if path is None or content is None:
            return None
        with suppress(OSError):
            # the least recently used goes first
            os.utime(path)
        return pickle.loads(content)

    def _save(self, code: str, codegen: Any, kept: object) -> None:
        """Keep something, if there is room on the disk."""
        path = self._path(code, codegen)
        if path is None:
            return
        pickled: Callable[..., bytes] = serialize.dumps
        content = pickled(kept)
        try:
            with replaced(path) as part:
                part.write_bytes(hashlib.sha256(content).digest() + content)
            for old in _newest_first(path.parent.glob(f"{self._name}.*.code"))[_KEPT_VERSIONS:]:
                old.unlink(missing_ok=True)
            remove_abandoned(parts(path.parent))
        except OSError:
            # it is compiled again next time
            return

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for these argument types; None if it must be compiled."""
        kept = self._load(str(sig), target_context.codegen())
        if kept is None or kept[0] != sig:
            return None
        _, symbols, reduced = kept
        _provide(symbols, target_context)
        rebuild: Callable[..., Any] = CompileResult._rebuild
        return rebuild(target_context, *reduced)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep machine code, if it can be moved to another process."""
        if not data.library.has_dynamic_globals:
            self._save(str(sig), data.codegen, (sig, _symbols(data.library), data._reduce()))

    def load_part(self, args: Any, target_context: Any) -> Any:
        """What `save_part` kept for these argument types; None if it must be compiled."""
        kept = self._load(f"part {args}", target_context.codegen())
        return None if kept is None or kept[0] != args else kept[1]

    def save_part(self, args: Any, target_context: Any, part: object) -> None:
        """Keep what compiled callers need of a function."""
        self._save(f"part {args}", target_context.codegen(), (args, part))


def _read(path: Path) -> bytes | None:
    """What was kept in a file; None if there is none, it is damaged, or another user wrote it."""
    try:
        with path.open("rb") as file:
            content = file.read() if os.fstat(file.fileno()).st_uid == os.geteuid() else b""
    except OSError:
        return None
    whole = hashlib.sha256(content[_DIGEST:]).digest() == content[:_DIGEST]
    return content[_DIGEST:] if whole else None
