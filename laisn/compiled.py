"""How this project compiles: numba with one set of flags, and a folder in which later processes
find the machine code.

Compiled code contains constants of other modules, and numba compares only the function's own file.
The folder is therefore named by a hash of the versions and of `REACHED`, the sources that compiled
code can reach.
"""

import fcntl
import hashlib
import itertools
import os
import shutil
import stat
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import errors
from numba.extending import overload, register_jitable, typeof_impl

from laisn.arrays import Floats

Function = TypeVar("Function", bound=Callable[..., Any])

REACHED = ("laisn/**/*.py", "sim/**/*.py", "experiments/campaign/lane_*.py")
"""Sources that compiled code reads: a compiled module imports from them alone."""
_APART = ("sim/datasets", "sim/film", "sim/gazebo", "sim/log")
_ROOT = Path(__file__).resolve().parents[1]
_KEPT_S = 7 * 86_400.0
"""Code of other versions is removed when it has not been used for so long."""


def reached_sources() -> list[Path]:
    found = [path for pattern in REACHED for path in sorted(_ROOT.glob(pattern))]
    return [path for path in found if not path.relative_to(_ROOT).as_posix().startswith(_APART)]


def _own_folder(version: Path) -> Path:
    """The first numbered folder that no running process uses, with links to the code in the others.

    Two processes that store different signatures of a function in one folder would give both files
    one name.
    """
    for own in (version / str(n) for n in itertools.count()):
        own.mkdir(parents=True, exist_ok=True)
        lock = os.open(own / "lock", os.O_RDWR | os.O_CREAT, 0o600)
        try:
            # held until this process ends
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except BlockingIOError:
            os.close(lock)
    for index in version.glob("*/*/*.nbi"):
        folder = own / index.parent.name
        if not (folder / index.name).exists():
            folder.mkdir(exist_ok=True)
            # the index first: what it names and is missing is compiled, and no code is there
            # without its index
            for file in (index, *index.parent.glob(f"{index.stem}.*.nbc")):
                os.link(file, folder / file.name)
    return own


def find_folder() -> Path | None:
    """Folder for the code of these sources, below one that only this user can enter; None if
    there is none.
    """
    home = os.environ.get("XDG_CACHE_HOME", "")
    digest = hashlib.sha256(f"{sys.version} {numba.__version__} {np.__version__}".encode())
    for path in reached_sources():
        digest.update(f"{path.relative_to(_ROOT)} ".encode() + path.read_bytes())
    try:
        place = (
            (Path(home) if os.path.isabs(home) else Path.home() / ".cache")
            / "laisn-sim"
            / "compiled"
        )
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = place.lstat()
        version = place / digest.hexdigest()[:16]
        if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.geteuid() or state.st_mode & 0o077:
            return None
        own = _own_folder(version)
        os.utime(version)
        for other in place.iterdir():
            if other.stat().st_mtime < time.time() - _KEPT_S:
                shutil.rmtree(other, ignore_errors=True)
    except (OSError, RuntimeError):
        # the latter: this user has no home
        return None
    return own


FOLDER = find_folder()
"""Where this process stores machine code; None: nowhere."""


def count_stored() -> int:
    """Number of compiled functions that this process and those beside it have stored."""
    return len({path.stat().st_ino for path in FOLDER.parent.rglob("*.nbc")}) if FOLDER else 0


def remove_if_damaged(error: BaseException) -> bool:
    """Whether an error came from reading or writing stored code, as after a power failure;
    removes that code.
    """
    frames = traceback.extract_tb(error.__traceback__)
    if FOLDER is None or not any(
        Path(frame.filename).match("numba/core/caching.py") for frame in frames
    ):
        return False
    shutil.rmtree(FOLDER.parent, ignore_errors=True)
    return True


# numba warns of names of its own where formulas with branches are inlined into one another
warnings.filterwarnings("ignore", category=errors.NumbaIRAssumptionWarning)


def compiled(function: Function, **flags: Any) -> Function:
    """Compile a function, which releases the interpreter's lock; division by zero gives inf or
    NaN as in NumPy.
    """
    # what other projects and closures refer to is not in the name of the folder
    own = not function.__closure__ and function.__module__.startswith(
        ("laisn.", "sim.", "experiments.")
    )
    config: Any = numba.config
    config.CACHE_DIR = str(FOLDER or "")
    jit = numba.njit(error_model="numpy", nogil=True, cache=own and FOLDER is not None, **flags)
    return cast(Function, jit(function))


def compiled_lanes(function: Function) -> Function:
    """Compile a pass over lanes: fused multiply-adds are allowed, and NaN keeps its meaning."""
    return compiled(function, fastmath={"contract", "nsz"})


def inlined(function: Function) -> Function:
    """Compile a small helper into its callers, so that loops over lanes stay vectorised."""
    return cast(Function, numba.njit(inline="always", error_model="numpy")(function))


@inlined
def copy_values(source: Floats, target: Floats) -> None:
    """`target[:] = source` of one-dimensional arrays, for which numba compiles the text of an
    error for seconds.
    """
    for i in range(target.shape[0]):
        target[i] = source[i]


def jitable(function: Function) -> Function:
    """A function of numbers: Python runs it as it is written, and compiled code calls it.

    No branch may divide by zero, which Python refuses. If it consists of arithmetic alone, Python
    may give it arrays.
    """
    return register_jitable(error_model="numpy")(function)


def formula(function: Function) -> Function:
    """The same of a short one, which is inlined; records are NamedTuples."""
    return register_jitable(inline="always")(function)


class Listed:
    """A `formula` for a list whose members compiled code calls one after another, by
    `numba.literal_unroll`.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.compiled = numba.njit(error_model="numpy")(function)

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)


@typeof_impl.register(Listed)
def _typeof(listed: Listed, context: Any) -> Any:
    return typeof_impl(listed.compiled, context)


def select(condition: Any, chosen: Any, other: Any) -> Any:
    """`np.where`, which in compiled code is `chosen if condition else other` of numbers."""
    return np.where(condition, chosen, other)


@overload(select, strict=False)
def _select(condition: Any, chosen: Any, other: Any) -> Any:
    return lambda condition, chosen, other: chosen if condition else other
