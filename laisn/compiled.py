"""How this project compiles: numba with one set of flags, and machine code that the next process takes from a folder.

Compiled code contains constants and code of other modules, and numba compares only the file of the function itself with
the one that was compiled. The folder is therefore named by a hash of the versions and of `REACHED`, the sources that
compiled code can reach.
"""

import hashlib
import os
import pickle
import re
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib.metadata import requires, version
from pathlib import Path
from typing import Any, TypeVar, cast
from warnings import catch_warnings, simplefilter

import numba
from numba import errors
from numba.extending import register_jitable

from laisn.arrays import Floats

Function = TypeVar("Function", bound=Callable[..., Any])
Listener = Callable[[int], None]

REACHED = ("laisn", "sim", "experiments/campaign")
"""Folders of sources that compiled code reads: a compiled module imports from them alone."""
_APART = ("sim/datasets", "sim/film", "sim/log")
"""Folders within them that no compiled module imports."""
_ROOT = Path(__file__).resolve().parents[1]
_PROJECT = ("laisn", "sim", "experiments")
_KEPT_VERSIONS = 8
_UNREADABLE = (OSError, EOFError, pickle.UnpicklingError)


def _states() -> dict[Path, int]:
    """When each source was changed [ns]."""
    found = (path for name in REACHED for path in sorted((_ROOT / name).rglob("*.py")))
    apart = tuple(str(_ROOT / name) + os.sep for name in _APART)
    return {path: path.stat().st_mtime_ns for path in found if not str(path).startswith(apart)}


def _version() -> str:
    """Hash of the compiler, of what it requires, and of the sources."""
    required = (re.split(r"[^\w.-]", entry)[0] for entry in requires("numba") or () if "extra ==" not in entry)
    digest = hashlib.sha256(repr((sys.version, [(name, version(name)) for name in ("numba", *required)])).encode())
    for path in _AT_START:
        content = path.read_bytes()
        digest.update(f"{path.relative_to(_ROOT)} {len(content)} ".encode() + content)
    return digest.hexdigest()[:16]


def _last_used(folder: Path) -> float:
    return folder.stat().st_mtime


def _find_folder() -> Path | None:
    """Folder for the code of these sources, below one that nobody but this user can enter; None if there is none."""
    home = os.environ.get("XDG_CACHE_HOME", "")
    try:
        place = (Path(home) if os.path.isabs(home) else Path.home() / ".cache") / "laisn-sim" / "compiled"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.mkdir(mode=0o700, exist_ok=True)
        state, own = place.lstat(), place / _version()
        if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.geteuid() or state.st_mode & 0o077:
            return None
        own.mkdir(exist_ok=True)
        os.utime(own)
        for old in sorted(place.iterdir(), key=_last_used)[:-_KEPT_VERSIONS]:
            shutil.rmtree(old, ignore_errors=True)
    except (OSError, RuntimeError):
        # RuntimeError: this user has no home
        return None
    return own


_AT_START = _states()
FOLDER = _find_folder()
"""Where machine code is stored; None: nowhere, and each process compiles what it calls."""

_listeners: list[Listener] = []
_active = _compiled_so_far = 0


@contextmanager
def compiling(listener: Listener) -> Iterator[None]:
    """Call a listener with the number of functions compiled so far, after each of them, and with 0 after the last."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def _dispatcher(function: Function, folder: str, **flags: Any) -> Any:
    """What chooses the code of a function by the types of its arguments, stored in its own part of the folder."""
    # a closure's content is in no source, and numba finds no file for what a user types
    stored = FOLDER is not None and not function.__closure__ and function.__module__.partition(".")[0] in _PROJECT
    config: Any = numba.config
    njit: Any = numba.njit
    before, config.CACHE_DIR = config.CACHE_DIR, str(FOLDER and FOLDER / folder)
    dispatcher: Any = njit(error_model="numpy", cache=stored, no_cfunc_wrapper=True, **flags)(function)
    config.CACHE_DIR = before
    build = dispatcher.compile

    def compile_types(signature: tuple[Any, ...]) -> Any:
        """Compile for types of arguments; numba would compile again for each constant that is passed."""
        global _active, _compiled_so_far
        types = tuple(map(numba.types.unliteral, signature))
        if types in dispatcher.overloads:
            return dispatcher.overloads[types].entry_point
        before = _compiled_so_far
        _active += 1
        try:
            with catch_warnings():
                # numba warns of a name of its own where a formula with branches is inlined into another one
                simplefilter("ignore", errors.NumbaIRAssumptionWarning)
                with suppress(*_UNREADABLE):
                    build(types)
                if types not in dispatcher.overloads:
                    # a file is damaged, or two processes stored two signatures under one name at the same time
                    dispatcher.recompile()
                    build(types)
        finally:
            _active -= 1
        if types not in dispatcher.stats.cache_hits:
            _compiled_so_far += 1
            for listener in _listeners:
                listener(_compiled_so_far)
            if stored and _states() != _AT_START:
                # the code may be of sources that were edited after they were hashed
                shutil.rmtree(cast(Path, FOLDER), ignore_errors=True)
        if not _active and _compiled_so_far > before:
            for listener in _listeners:
                listener(0)
        return dispatcher.overloads[types].entry_point

    dispatcher.compile = compile_types
    return dispatcher


def _jit(function: Function, **flags: Any) -> Function:
    """Compile for Python and, without the conversion of Python's objects, for compiled callers.

    That conversion takes half of the time to compile a small function of records.
    """
    dispatcher = _dispatcher(function, "called", **flags)
    inner = cache(partial(_dispatcher, function, "linked", no_cpython_wrapper=True, **flags))
    dispatcher.get_call_template = lambda args, kws: inner().get_call_template(args, kws)
    dispatcher.get_overload = lambda signature: inner().get_overload(signature)
    return cast(Function, dispatcher)


def compiled(function: Function) -> Function:
    """Compile a function of arrays and scalars; division by zero gives inf or NaN as in NumPy."""
    return _jit(function)


def compiled_run(function: Function) -> Function:
    """Compile a long loop over one run, with the arithmetic of `compiled`; threads run side by side."""
    return _jit(function, nogil=True)


def compiled_lanes(function: Function) -> Function:
    """Compile a pass over lanes: fused multiply-adds are allowed, NaN keeps its meaning, threads run side by side."""
    return _jit(function, fastmath={"contract", "nsz"}, nogil=True)


def inlined(function: Function) -> Function:
    """Compile a small helper into its callers, so that loops over lanes stay vectorised."""
    return cast(Function, numba.njit(inline="always", error_model="numpy")(function))


@inlined
def copy_values(source: Floats, target: Floats) -> None:
    """`target[:] = source` of one-dimensional arrays, for which numba compiles the text of an error for seconds."""
    for i in range(target.shape[0]):
        target[i] = source[i]


def formula(function: Function) -> Function:
    """A formula of numbers: Python runs it as it is written, and compiled code has it inlined.

    Records are NamedTuples, and no branch may divide by zero, which Python refuses.
    """
    return register_jitable(inline="always")(function)
