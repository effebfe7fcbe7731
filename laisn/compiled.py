"""How this project compiles: numba with one set of flags, and a folder in which later processes
find the machine code.

Compiled code contains constants of other modules, and numba compares only the function's own file.
The folder is therefore named by a hash of the versions and of `COMPILED_SOURCES`, the sources that
compiled code can reach. All processes share it.

What takes a type of a class outside of this project, as a user's controller, is stored in a folder
beside it that is also named by the contents of the class (`laisn.custom_types`): its methods may
change, and numba's index with such a class in it can be read by no process that cannot import it.
"""

import fcntl
import hashlib
import itertools
import os
import secrets
import shutil
import stat
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import errors, types
from numba.core import cgutils
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)
from numba.core.datamodel.models import OpaqueModel
from numba.core.imputils import lower_constant
from numba.extending import (
    intrinsic,
    overload,
    overload_method,
    register_jitable,
    register_model,
    typeof_impl,
)

from laisn.arrays import Bools, Floats
from laisn.custom_types import name_of_custom
from laisn.errors import LaisnWarning
from laisn.nested_store import NestedStore, refers_to_memory
from laisn.nesting import NestedLibrary, count_nested, has_callers, nest

Function = TypeVar("Function", bound=Callable[..., Any])

COMPILED_SOURCES = ("laisn/**/*.py", "sim/**/*.py", "experiments/campaign/lane_*.py")
"""Sources that compiled code reads: a compiled module imports from them alone."""
_EXCLUDED = ("sim/datasets", "sim/film", "sim/gazebo", "sim/log")
"""What begins like this is none of them: no compiled module imports it."""
_ROOT = Path(__file__).resolve().parents[1]
_NESTED = "-nested"
"""In the names of files of code for callers alone."""
_MAX_UNUSED_S = 7 * 86_400.0
"""Code of other versions is removed when it has not been used for so long."""


def reached_sources() -> list[Path]:
    """Files of this project that compiled code can reach."""
    paths = [path for pattern in COMPILED_SOURCES for path in sorted(_ROOT.glob(pattern))]
    return [path for path in paths if not path.relative_to(_ROOT).as_posix().startswith(_EXCLUDED)]


def _number_functions() -> None:
    """Let this process number what it compiles from a number on that no other process has.

    By it numba tells functions of one name apart, such as those that a factory makes, and it begins
    with 1 in each process. Code of several functions that different processes have stored may then
    have the same symbols for different ones, of which the linker takes those that it has met first.
    """
    FunctionIdentity._unique_ids = itertools.count(secrets.randbits(48) << 20)


_number_functions()
os.register_at_fork(after_in_child=_number_functions)


class UnstoredCode(LaisnWarning):
    """Compiled code cannot be stored; the text names folder, reason and what to do."""


def _warn_unstored(folder: Path, reason: str) -> None:
    warnings.warn(
        f"compiled code cannot be stored in {folder} ({reason}), and every command compiles for a "
        "minute or more; make room there, or set XDG_CACHE_HOME to a folder that only you enter",
        UnstoredCode,
        stacklevel=3,
    )


def find_folder() -> Path | None:
    """Folder for the code of these sources, below one that only this user can enter; None, with a
    warning, if there is none.
    """
    home = os.environ.get("XDG_CACHE_HOME", "")
    digest = hashlib.sha256(f"{sys.version} {numba.__version__} {np.__version__}".encode())
    for path in reached_sources():
        digest.update(f"{path.relative_to(_ROOT)} ".encode() + path.read_bytes())
    cache = Path(home if os.path.isabs(home) else "~/.cache") / "laisn-sim" / "compiled"
    try:
        cache = cache.expanduser()
        cache.mkdir(mode=0o700, parents=True, exist_ok=True)
        state = cache.lstat()
        version = cache / digest.hexdigest()[:16]
        if not stat.S_ISDIR(state.st_mode) or state.st_uid != os.geteuid() or state.st_mode & 0o077:
            _warn_unstored(cache, "it is not a folder that only this user can enter")
            return None
        version.mkdir(exist_ok=True)
        os.utime(version)
        for other in cache.iterdir():
            if other.stat().st_mtime < time.time() - _MAX_UNUSED_S:
                shutil.rmtree(other, ignore_errors=True)
    except (OSError, RuntimeError) as error:
        # the latter: this user has no home
        _warn_unstored(cache, getattr(error, "strerror", None) or str(error))
        return None
    return version


FOLDER = find_folder()
"""Where processes with these sources store machine code; None: nowhere."""


def _folders() -> list[Path]:
    """Folders of the code of these sources: that of the project, and those of the user's own
    classes.
    """
    return [] if FOLDER is None else [FOLDER, *FOLDER.parent.glob(f"{FOLDER.name}-*")]


def count_stored() -> int:
    """Number of compiled functions with machine code that this process and those beside it have
    stored.
    """
    paths = (path for folder in _folders() for path in folder.rglob("*.nbc"))
    return sum(1 for path in paths if _NESTED not in path.name)


def count_compiled() -> int:
    """The same, and those that this process and its forks have compiled for their callers alone."""
    return count_stored() + count_nested()


def remove_if_damaged(error: BaseException) -> bool:
    """Whether an error came from reading or writing stored code, as after a power failure;
    removes that code.
    """
    frames = traceback.extract_tb(error.__traceback__)
    if FOLDER is None or not any(
        Path(frame.filename).match("numba/core/caching.py") for frame in frames
    ):
        return False
    for folder in _folders():
        shutil.rmtree(folder, ignore_errors=True)
    return True


class _Folder(UserProvidedCacheLocator):
    """Numba's place of a function's code, which is made when something is stored there."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Any:
        """The place of a function; see `UserProvidedCacheLocator`."""
        return cls(py_func, py_file)


class _Implementation(CompileResultCacheImpl):
    """Numba's storing of code, in no other folder."""

    _locator_classes = [_Folder]  # noqa: RUF012


@cache
def _nested_store(folder: Path | None) -> NestedStore:
    """That of a folder for compiled code."""
    return NestedStore(cast(Path, folder) / "nested")


class _NestedImplementation(_Implementation):
    """Numba's storing of a function for its callers, in a folder for all such functions."""

    @property
    def filename_base(self) -> str:
        """Where the names of the function's index and data begin."""
        return f"{super().filename_base}{_NESTED}"

    def reduce(self, result: Any) -> Any:
        """See `CompileResultCacheImpl`."""
        return _nested_store(FOLDER).reduce(result)

    def rebuild(self, context: Any, reduced: Any) -> Any:
        """See `CompileResultCacheImpl`; None if another process has removed the code."""
        with suppress(FileNotFoundError):
            return _nested_store(FOLDER).rebuild(context, reduced)
        return None

    def check_cachable(self, result: Any) -> bool:
        """Whether other processes can use a result."""
        return not (result.lifted or refers_to_memory(result.library))


class _Files(IndexDataCacheFile):
    """Numba's index and data files of a function, which several processes write."""

    def save(self, key: object, data: object) -> None:
        """Store data under a name that no other process takes, then its entry of the index; nothing
        if another process has stored the same function meanwhile.
        """
        files: Any = super()
        index = files._load_index()
        if key in index and os.path.exists(files._data_path(index[key])):
            return
        name = files._data_name(secrets.randbits(48))
        files._save_data(name, data)
        files._save_index(index | {key: name})


def _load_without_scipy() -> None:
    """Let numba load what it knows of arrays without SciPy, before the first function is loaded.

    It looks for SciPy's BLAS then, for `np.convolve` and `np.correlate` alone, which work without
    it; that takes a fifth of a second of each command. Products of matrices look for it when they
    are compiled or called first.
    """
    package = "scipy.linalg"
    if package in sys.modules or "numba.np.arraymath" in sys.modules:
        return
    sys.modules[package] = cast(Any, None)  # an import of it fails
    try:
        import_module("numba.np.arraymath")
    finally:
        del sys.modules[package]


class _Cache(FunctionCache):
    """Numba's cache of a function, shared by all processes; types of the user's own are in caches
    beside it.
    """

    _impl_class = _Implementation

    def __init__(self, py_func: Callable[..., Any], folder: Path | None = None) -> None:
        super().__init__(py_func)
        files = self._cache_file
        self._folder = folder or Path(self.cache_path)
        self._cache_file = _Files(str(self._folder), self._impl.filename_base, files._source_stamp)
        self._custom_caches = dict[str, _Cache]()
        self._nested_cache: _NestedCache | None = None

    def _cache_of(self, sig: object) -> "_Cache | None":
        """Where the code of a signature is stored; None: nowhere."""
        custom = name_of_custom(sig)
        if not custom:
            return None if custom is None else self
        if custom not in self._custom_caches:
            project = cast(Path, FOLDER)
            folder = project.with_name(f"{project.name}-{custom}")
            with suppress(OSError):
                # so that it stays; it is not there before something is stored
                os.utime(folder)
            self._custom_caches[custom] = _Cache(self._py_func, folder / self._folder.name)
        return self._custom_caches[custom]

    def _nested_cache_of(self, sig: object) -> "_NestedCache | None":
        """Where the code of a signature is stored for callers; None: nowhere, as of types of the
        user's own.
        """
        if name_of_custom(sig) != "":
            return None
        if self._nested_cache is None:
            self._nested_cache = _NestedCache(self._py_func, self._folder)
        return self._nested_cache

    def load_overload(self, sig: object, target_context: object) -> Any:
        """The stored code of a signature: for callers if compiled code calls the function; None if
        there is none.
        """
        stored = self._nested_cache_of(sig) if has_callers() else self._cache_of(sig)
        if stored is None:
            return None
        if not has_callers():
            _load_without_scipy()
        return stored._load(sig, target_context)

    def _load(self, sig: object, target_context: object) -> Any:
        return super().load_overload(sig, target_context)

    def save_overload(self, sig: object, data: Any) -> None:
        """Store the code of a signature; a warning if the folder cannot be written."""
        if not self._enabled:
            return
        is_nested = isinstance(data.library, NestedLibrary)
        stored = self._nested_cache_of(sig) if is_nested else self._cache_of(sig)
        if stored is not None:
            stored._save(sig, data)

    def _save(self, sig: object, data: Any) -> None:
        try:
            with _one_writer():
                self._folder.mkdir(parents=True, exist_ok=True)
                super().save_overload(sig, data)
        except OSError as error:
            _warn_unstored(cast(Path, FOLDER), error.strerror or str(error))


class _NestedCache(_Cache):
    """Numba's cache of a function for its callers."""

    _impl_class = _NestedImplementation

    def _save_overload(self, sig: object, data: Any) -> None:
        # code that another process has stored meanwhile is not stored twice
        if self._index_key(sig, data.codegen) not in self._cache_file._load_index():
            super()._save_overload(sig, data)


@contextmanager
def _one_writer() -> Iterator[None]:
    """Keep other processes from writing an index, which would lose this one's entry; a file system
    without locks may lose one.
    """
    folder = cast(Path, FOLDER)
    folder.mkdir(exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


# numba warns of names of its own where formulas with branches are inlined into one another
warnings.filterwarnings("ignore", category=errors.NumbaIRAssumptionWarning)


def compiled(function: Function) -> Function:
    """Compile a function, which releases the interpreter's lock; division by zero gives inf or
    NaN as in NumPy.

    No flag lets the compiler reorder or fuse operations: a function that is compiled on its own and
    again within its caller would then round differently, and so would a process that compiles and
    one that loads what was stored.
    """
    return _compiled(function, apart=False)


def compiled_apart(function: Function) -> Function:
    """The same of a large function that several others call: it is compiled and stored on its own,
    for all of them.
    """
    return _compiled(function, apart=True)


def _compiled(function: Function, *, apart: bool) -> Function:
    njit: Any = numba.njit
    jit: Any = njit(error_model="numpy", nogil=True, no_cfunc_wrapper=True)(function)
    if jit is function:
        # numba is switched off
        return function
    nest(jit, apart=apart)
    # what other projects and closures refer to is not in the name of the folder
    in_project = function.__module__.startswith(("laisn.", "sim.", "experiments."))
    if FOLDER is not None and in_project and not function.__closure__:
        config: Any = numba.config
        config.CACHE_DIR = str(FOLDER)
        jit._cache = _Cache(function)
    return cast(Function, jit)


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


def _emit_copy_rows(_: Any, source: Any, target: Any) -> Any:
    for array in (source, target):
        if not (isinstance(array, types.Array) and array.layout == "C"):
            return None
    if source.dtype != target.dtype or source.ndim != target.ndim:
        return None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        arrays = [
            context.make_array(kind)(context, builder, value)
            for kind, value in zip(signature.args, args, strict=True)
        ]
        cgutils.raw_memcpy(
            builder, arrays[1].data, arrays[0].data, arrays[0].nitems, arrays[0].itemsize
        )
        return context.get_dummy_value()

    return types.void(source, target), generate


copy_rows: Callable[[Floats, Floats], None] = cast(Any, intrinsic(_emit_copy_rows))
"""`target[:] = source` of contiguous arrays of equal shape, which do not overlap: a loop for each
of many short rows takes longer. To be called from compiled code only.
"""


def jitable(function: Function) -> Function:
    """A function of numbers: Python runs it as it is written, and compiled code calls it.

    No branch may divide by zero, which Python refuses. If it consists of arithmetic alone, Python
    may give it arrays.
    """
    return register_jitable(error_model="numpy")(function)


def formula(function: Function) -> Function:
    """The same of a short one, which is inlined; structures that it takes or gives are
    NamedTuples.
    """
    return register_jitable(inline="always")(function)


def _emit_call(_: Any, function: Any, first: Any, second: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        function_type = types.FunctionType(types.void(types.intp, types.intp))
        pointer = context.get_value_type(function_type.ftype)
        builder.call(builder.inttoptr(args[0], pointer), args[1:])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp), generate


call_address: Callable[[int, int, int], None] = cast(Any, intrinsic(_emit_call))
"""Call a function by its address, with two addresses: of MuJoCo's model and data, or of nothing. To
be called from compiled code only.
"""


def method_by_type(name: str) -> None:
    """Let compiled code call the method `name` of NamedTuples, which their classes define as
    `compiled` or `jitable`: it is chosen by the type.
    """

    def choose(record, *arguments):  # type: ignore[no-untyped-def] # numba compares signatures
        method = getattr(record.instance_class, name, None)
        return method and (lambda record, *arguments: method(record, *arguments))

    overload_method(types.BaseNamedTuple, name)(choose)


class DispatchedFormula:
    """A `formula` for a list whose members compiled code calls one after another, by
    `numba.literal_unroll`.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.compiled = numba.njit(error_model="numpy")(function)

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)


class _DispatchedFormulaType(types.Dispatcher):
    """The type of a `DispatchedFormula` for the compiler, which finds the function by it."""


register_model(_DispatchedFormulaType)(OpaqueModel)


@lower_constant(_DispatchedFormulaType)
def _lower_listed(context: Any, *_: object) -> Any:
    # of a dispatcher numba takes the address in memory, with which no process stores code
    return context.get_dummy_value()


@typeof_impl.register(DispatchedFormula)
def _typeof(listed: DispatchedFormula, _: object) -> Any:
    return _DispatchedFormulaType(listed.compiled)


def select(condition: bool | Bools, chosen: float | Floats, other: float | Floats) -> Any:
    """`np.where`, which in compiled code is `chosen if condition else other` of numbers."""
    return np.where(condition, chosen, other)


@overload(select, strict=False)
def _select(condition: types.Type, chosen: types.Type, other: types.Type) -> Any:
    # `laisn.simd` has that of lanes
    if not isinstance(condition, types.Boolean):
        return None
    return lambda condition, chosen, other: chosen if condition else other
