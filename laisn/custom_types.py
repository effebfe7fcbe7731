"""Classes of the user's own in the signatures of compiled functions, and a name for what stands in
them.

Machine code of such a signature holds the methods of the classes and the constants that these read.
It may be stored where the name says all of that: as it is in memory, whatever stands in the files
by now, and in the files, of which numba's overloads may read more.
"""

# mypy: allow-untyped-calls

import dataclasses
import hashlib
import io
import sys
from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path
from types import (
    BuiltinFunctionType,
    CodeType,
    FunctionType,
    GenericAlias,
    GetSetDescriptorType,
    MemberDescriptorType,
    ModuleType,
)
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import types
from numba.core.serialize import NumbaPickler

from laisn.custom_sources import Sources, is_custom

_SHARED = frozenset(
    ("experiments", "laisn", "laisn_sim", "reports", "sim", "numba", "numpy", "llvmlite")
)
"""Packages whose versions or contents are in the name of the folder of compiled code already, as
those of the standard library are.
"""
_SIMPLE_TYPES = (bool, int, float, complex, str, bytes, type(None), type(...), range)
_MAX_DEPTH = 60


class _UndescribedError(Exception):
    """A value of which no text can be made that is the same in all processes."""


def _package(module: str) -> str:
    return module.partition(".")[0]


def _is_shared(module: str) -> bool:
    """Whether the contents of a module are those of the versions that name the folder."""
    package = _package(module)
    return package in _SHARED or package in sys.stdlib_module_names


class _CustomCollector(NumbaPickler):
    """Collects the user's own classes and functions in a signature, as numba's index names them."""

    def __init__(self) -> None:
        super().__init__(io.BytesIO())
        self.classes: set[type] = set()
        self.has_functions = False

    def reducer_override(self, obj: object) -> Any:
        """Note an object; see `pickle.Pickler.reducer_override`."""
        if isinstance(obj, type | FunctionType) and not _is_shared(obj.__module__):
            if isinstance(obj, type):
                self.classes.add(obj)
            else:
                self.has_functions = True
        return super().reducer_override(obj)


class _Description:
    """A text of what compiled code may read of a value."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        # index of the line at which the description of an object begins, by the object's id
        self._first_lines: dict[int, int] = {}
        # kept alive, so that no other object gets the id of one of them
        self._objects: list[object] = []

    def add(self, value: object, depth: int = 0) -> None:
        """Describe a value; _UndescribedError if that cannot be done."""
        if depth > _MAX_DEPTH:
            raise _UndescribedError
        if isinstance(value, _SIMPLE_TYPES):
            self.lines.append(f"{type(value).__name__} {value!r}")
        elif id(value) in self._first_lines:
            self.lines.append(f"as {self._first_lines[id(value)]}")
        else:
            self._first_lines[id(value)] = len(self.lines)
            self._objects.append(value)
            self.lines.append(type(value).__qualname__)
            self._add_object(value, depth + 1)

    def _add_all(self, values: Iterable[object], depth: int) -> None:
        for value in values:
            self.add(value, depth)
        self.lines.append("end")

    def _add_object(self, value: object, depth: int) -> None:
        # a dispatcher of numba's
        value = getattr(value, "py_func", value)
        if isinstance(value, type):
            self._add_class(value, depth)
        elif isinstance(value, FunctionType):
            self._add_function(value, depth)
        elif isinstance(value, property):
            self.add(value.fget, depth)
        elif isinstance(value, staticmethod | classmethod):
            self.add(value.__func__, depth)
        elif isinstance(value, ModuleType):
            self._add_module(value)
        elif isinstance(value, tuple | list):
            self._add_all(value, depth)
        elif isinstance(value, set | frozenset):
            self._add_all(sorted(value, key=repr), depth)
        elif isinstance(value, Mapping):
            self._add_all((entry for item in value.items() for entry in item), depth)
        elif isinstance(value, np.ndarray | np.generic | np.dtype):
            self._add_array(np.asarray(value) if not isinstance(value, np.dtype) else value)
        else:
            self._add_other(value, depth)

    def _add_array(self, value: npt.NDArray[Any] | np.dtype[Any]) -> None:
        dtype = value if isinstance(value, np.dtype) else value.dtype
        if dtype.hasobject:
            raise _UndescribedError
        self.lines.append(str(dtype.descr))
        if isinstance(value, np.ndarray):
            self.lines.append(f"{value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}")

    def _add_other(self, value: object, depth: int) -> None:
        kind = type(value)
        if isinstance(value, Enum):
            self._add_all([kind, value.name, value.value], depth)
        elif dataclasses.is_dataclass(value):
            names = [field.name for field in dataclasses.fields(value)]
            self._add_all([kind, *(getattr(value, name) for name in names)], depth)
        elif isinstance(value, BuiltinFunctionType | MemberDescriptorType | GetSetDescriptorType):
            self.lines.append(str(value.__qualname__))
        elif isinstance(value, np.ufunc) or kind.__name__ == "_tuplegetter":
            # fields of a NamedTuple are in its `_fields`
            self.lines.append(getattr(value, "__name__", kind.__name__))
        elif isinstance(value, types.Type | GenericAlias) or kind.__module__ == "typing":
            self.lines.append(str(value))
        else:
            raise _UndescribedError

    def _add_class(self, value: type, depth: int) -> None:
        self.lines.append(f"{value.__module__}:{value.__qualname__}")
        if _is_shared(value.__module__):
            return
        self._add_version(value.__module__)
        self._add_all(value.__bases__, depth)
        contents = vars(value)
        names = [name for name in sorted(contents) if not name.startswith("__")]
        self._add_all((entry for name in names for entry in (name, contents[name])), depth)

    def _add_function(self, function: FunctionType, depth: int) -> None:
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        defaults = [function.__defaults__, function.__kwdefaults__]
        self._add_all([function.__qualname__, *defaults, *cells], depth)
        if _is_shared(function.__module__ or ""):
            self.lines.append(str(function.__module__))
            return
        self._add_version(function.__module__ or "")
        names = self._add_code(function.__code__, depth)
        module_globals = function.__globals__
        for name in sorted(names & module_globals.keys()):
            value = module_globals[name]
            self.lines.append(name)
            self.add(value, depth)
            if isinstance(value, ModuleType) and not _is_shared(value.__name__):
                contents = vars(value)
                inner = sorted(names & contents.keys())
                self._add_all((entry for key in inner for entry in (key, contents[key])), depth)

    def _add_code(self, code: CodeType, depth: int) -> set[str]:
        """Describe code; the names that it and the code within read."""
        self.lines += [code.co_code.hex(), " ".join((*code.co_names, *code.co_varnames))]
        names = set(code.co_names)
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                names |= self._add_code(constant, depth)
            else:
                self.add(constant, depth)
        return names

    def _add_module(self, module: ModuleType) -> None:
        self.lines.append(module.__name__)
        if not _is_shared(module.__name__):
            self._add_version(module.__name__)

    def _add_version(self, module: str) -> None:
        """Add the version of a module's package: of an installed one, whose files are not among the
        user's sources.
        """
        package = sys.modules.get(_package(module))
        self.lines.append(str(getattr(package, "__version__", "")))


_SOURCES: dict[Path, Sources] = {}
"""Sources as they were last read, by the file that reaches them."""


def _digest_of_files(file: Path) -> str:
    """Digest of the user's sources that a file reaches."""
    sources = _SOURCES.get(file)
    if sources is None or not sources.unchanged:
        sources = Sources.of(file)
        _SOURCES[file] = sources
    return sources.digest


def _named_object(kind: type) -> object:
    """What another process gets by the name of a class."""
    value: Any = sys.modules.get(kind.__module__)
    for name in kind.__qualname__.split("."):
        value = getattr(value, name, None)
    return value


def _describe_class(description: _Description, kind: type) -> None:
    """Describe a class that other processes can import; _UndescribedError of others."""
    module = sys.modules.get(kind.__module__)
    file = getattr(module, "__file__", None)
    if kind.__module__ == "__main__" or not file or _named_object(kind) is not kind:
        raise _UndescribedError
    description.add(kind)
    if is_custom(file):
        description.lines.append(_digest_of_files(Path(file)))


def name_of_custom(signature: object) -> str | None:
    """A name for what stands in the user's own classes in a signature of numba's: "" where it has
    none; None where no name tells that, as of classes of a notebook.
    """
    collector = _CustomCollector()
    collector.dump(signature)
    if collector.has_functions:
        return None
    if not collector.classes:
        return ""
    description = _Description()
    classes = sorted(collector.classes, key=lambda kind: f"{kind.__module__}:{kind.__qualname__}")
    try:
        for kind in classes:
            _describe_class(description, kind)
    except (_UndescribedError, ValueError):
        # the latter: a cell of a closure is empty
        return None
    return hashlib.sha256("\n".join(description.lines).encode()).hexdigest()[:16]
