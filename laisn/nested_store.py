"""Functions that were compiled for their callers alone, kept for later processes: their code as it
was written down, before it is optimised with that of an outermost function.

Where parts are composed as they never were before, their outermost functions have to be compiled,
but not what the parts have in common with other compositions. The code taken from here is what
this process would write down, except for the numbers in the names of functions.
"""

# mypy: allow-untyped-calls

import os
import pickle
import secrets
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys

from laisn.nesting import NestedLibrary, stored_library

_COUNTING_REFERENCES = "counting of references"
"""In place of the name of numba's own library, which all processes have."""


class _StoredLibrary(NamedTuple):
    """Code of a function."""

    name: str
    bitcode: bytes
    is_nested: bool  # else it was compiled on its own, with all that it calls
    needed: tuple[str, ...]  # names in the store of the code that it calls, in the order of linking


def refers_to_memory(library: Any) -> bool:
    """Whether code, or what it calls, has addresses of this process in it, such as those of large
    constant arrays: it is of no use for others.
    """
    module = library._final_module
    if any(value.name.startswith("numba.dynamic.globals") for value in module.global_variables):
        return True
    return isinstance(library, NestedLibrary) and any(
        dependency is not rtsys.library and refers_to_memory(dependency)
        for dependency in library._linking_libraries
    )


class NestedStore:
    """Code of nested functions in a folder, a file each, which is written once and never changed.

    Errors of reading and writing are those of files and of pickle.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        # what this process has stored or loaded
        self._names = dict[Any, str]()
        self._libraries = dict[str, Any]()

    def reduce(self, result: Any) -> tuple[Any, ...]:
        """Store the code of numba's result of compiling a nested function; what `rebuild` needs of
        it, which can be pickled.
        """
        # as `CompileResult._reduce` does
        result.fndesc.typemap = result.fndesc.calltypes = None
        return (
            self._save(result.library),
            result.fndesc,
            result.environment,
            result.signature,
        )

    def rebuild(self, context: Any, reduced: tuple[Any, ...]) -> Any:
        """The result of compiling; see `CompileResult._rebuild`."""
        name, fndesc, environment, signature = reduced
        library = self._load(context.codegen(), name)
        result: Any = CompileResult
        return result(
            target_context=context,
            typing_context=context.typing_context,
            library=library,
            environment=environment,
            entry_point=context.get_executable(library, fndesc, environment),
            fndesc=fndesc,
            type_annotation="",
            signature=signature,
            objectmode=False,
            lifted=(),
            typing_error=None,
            call_helper=None,
            metadata=None,
            reload_init=[],
            referenced_envs=[],
        )

    def _save(self, library: Any) -> str:
        """Store code and what it calls, unless this process has done so; gives its name."""
        if library is rtsys.library:
            return _COUNTING_REFERENCES
        if library in self._names:
            return self._names[library]
        is_nested = isinstance(library, NestedLibrary)
        module = library._final_module if is_nested else library._get_module_for_linking()
        needed = tuple(map(self._save, library._linking_libraries)) if is_nested else ()
        stored = _StoredLibrary(library.name, module.as_bitcode(), is_nested, needed)
        name = secrets.token_hex(8)
        self._write(name, pickle.dumps(tuple(stored), protocol=pickle.HIGHEST_PROTOCOL))
        self._names[library] = name
        self._libraries[name] = library
        return name

    def _write(self, name: str, data: bytes) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        temporary = self._folder / f"{name}.tmp"
        try:
            temporary.write_bytes(data)
            os.replace(temporary, self._folder / name)
        finally:
            temporary.unlink(missing_ok=True)

    def _load(self, codegen: Any, name: str) -> Any:
        if name == _COUNTING_REFERENCES:
            return rtsys.library
        if name in self._libraries:
            return self._libraries[name]
        stored = _StoredLibrary(*pickle.loads((self._folder / name).read_bytes()))
        needed = [self._load(codegen, needed_name) for needed_name in stored.needed]
        module = llvm.parse_bitcode(stored.bitcode)
        library = stored_library(codegen, stored.name, module, needed, is_nested=stored.is_nested)
        self._names[library] = name
        self._libraries[name] = library
        return library
