"""Compiled functions for their callers alone: their code is optimised, and made machine code of,
with that of the outermost function.

Numba does both for each function, with all that it calls, also where only its callers run it: what
stands at the end of five calls is optimised and emitted six times. Here a function that is compiled
for a caller keeps its code as it was written down (`laisn.nested_store` does so for later
processes). If Python calls it, too, it is compiled once more, on its own; callers never take that
code, or their speed would depend on what was compiled and stored before.
"""

# mypy: allow-untyped-calls

import ctypes
import mmap
import threading
from importlib import import_module
from typing import Any

import numpy as np
from numba.core import sigutils, typed_passes, types
from numba.core.codegen import JITCodeLibrary
from numba.core.cpu import CPUContext


class NestedLibrary(JITCodeLibrary):
    """Code of a function for its callers."""

    is_stored = False  # whether another process has compiled it

    def finalize(self) -> None:
        """Leave the code as it is; see `CodeLibrary.finalize`."""
        self._raise_if_finalized()
        self._finalized = True

    def get_pointer_to_function(self, _: str) -> int:
        """None of its functions has machine code."""
        return 0


class WholeLibrary(JITCodeLibrary):
    """Code of a function that another process has compiled on its own, for callers.

    It keeps its names and arguments, unlike that of a `NestedLibrary`: this process may load the
    machine code of the same function, and the linker knows one function of a name.
    """

    finalize = NestedLibrary.finalize
    get_pointer_to_function = NestedLibrary.get_pointer_to_function


def stored_library(
    codegen: Any, name: str, module: Any, needed: list[Any], *, is_nested: bool
) -> Any:
    """The library of a module of LLVM's that another process has compiled, and of the libraries
    that it needs, in the order in which they are linked.
    """
    library: Any = NestedLibrary(codegen, name) if is_nested else WholeLibrary(codegen, name)
    library._final_module = module
    library._linking_libraries = needed
    library._finalized = True
    library.is_stored = True
    return library


class _Compiling(threading.local):
    """The functions of this project that a thread compiles, the outermost first."""

    def __init__(self) -> None:
        self.stack: list[Any] = []


_compiling = _Compiling()
# number of functions compiled for their callers alone; processes that are forked share its memory
_nested_count = np.frombuffer(mmap.mmap(-1, 8), dtype=np.int64)


def has_callers() -> bool:
    """Whether the function that this thread begins to compile is called by another that it
    compiles.
    """
    return len(_compiling.stack) > 1


def count_nested() -> int:
    """Number of functions that this process, and those that it has forked, have compiled for their
    callers alone.
    """
    return int(_nested_count[0])


def _all_needed(libraries: list[Any]) -> list[Any]:
    """Libraries, and those that the nested ones among them need, each once and after all that need
    it: the linker leaves out a function that nothing before it has called.
    """
    visited = set[Any]()
    finished = list[Any]()

    def visit(library: Any) -> None:
        if library in visited:
            return
        visited.add(library)
        if isinstance(library, NestedLibrary):
            for dependency in reversed(library._linking_libraries):
                visit(dependency)
        finished.append(library)

    for library in reversed(libraries):
        visit(library)
    return finished[::-1]


_finalize = JITCodeLibrary.finalize


def _finalize_whole(self: Any) -> None:
    self._linking_libraries = _all_needed(self._linking_libraries)
    _finalize(self)


_optimize = JITCodeLibrary._optimize_final_module


def _optimize_whole(self: Any) -> None:
    """Let the optimiser fit the nested functions of a library to their callers, which are all in
    it: of functions that others might call it keeps all arguments, of large structures a hundred,
    and counts references to arrays that have none to count.
    """
    nested = {
        function.name
        for library in self._linking_libraries
        if isinstance(library, NestedLibrary)
        for function in library._final_module.functions
        if not function.is_declaration
    }
    for function in self._final_module.functions:
        if function.name in nested:
            function.linkage = "internal"
    _optimize(self)


_run_pass = typed_passes.BaseNativeLowering.run_pass


def _lower_nested(self: Any, state: Any) -> bool:
    """Give a function that has callers alone a nested library."""
    stack = _compiling.stack
    if state.library is None and stack:
        is_this = state.func_id.func is stack[-1].py_func
        if len(stack) > 1 if is_this else state.flags.no_cpython_wrapper:
            state.library = NestedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
            # what only Python needs
            state.flags.no_cpython_wrapper = True
            state.flags.no_cfunc_wrapper = True
    return bool(_run_pass(self, state))


def _refuse(*_: Any) -> Any:
    raise SystemError("a nested function of compiled code was called from Python")


_NO_CODE = ctypes.PYFUNCTYPE(*[ctypes.py_object] * 4)(_refuse)
_get_executable = CPUContext.get_executable
_dynfunc: Any = import_module("numba._dynfunc")


def _get_nested_executable(self: Any, library: Any, fndesc: Any, env: Any) -> Any:
    """An object by which callers know a nested function; see `CPUContext.get_executable`."""
    if not isinstance(library, NestedLibrary):
        return _get_executable(self, library, fndesc, env)
    name = fndesc.qualname.split(".")[-1]
    pointer = ctypes.cast(_NO_CODE, ctypes.c_void_p).value
    return _dynfunc.make_function(fndesc.lookup_module(), name, "", pointer, env, (library,))


JITCodeLibrary.finalize = _finalize_whole  # type: ignore[method-assign]
JITCodeLibrary._optimize_final_module = _optimize_whole  # type: ignore[method-assign]
typed_passes.BaseNativeLowering.run_pass = _lower_nested  # type: ignore[method-assign]
CPUContext.get_executable = _get_nested_executable  # type: ignore[method-assign]


def _type_of(argument: Any) -> Any:
    """The type of an argument, of a literal whole number that of all such numbers."""
    return types.unliteral(argument) if isinstance(argument, types.IntegerLiteral) else argument


def nest(jit: Any, *, apart: bool) -> None:
    """Compile a dispatcher's function for its callers alone where they need it, or else `apart`,
    always on its own.
    """
    compile_for = jit.compile
    compile_for_python = jit._compile_for_args
    add_overload = jit.add_overload
    template_of = jit.get_call_template
    for_callers = dict[Any, Any]()
    on_its_own = dict[Any, Any]()

    def template_without_literals(arguments: Any, keywords: Any) -> Any:
        """One code for calls with `0`, with `1` and with a variable."""
        return template_of(
            tuple(map(_type_of, arguments)),
            {name: _type_of(kind) for name, kind in keywords.items()},
        )

    def compile_on_stack(signature: Any) -> Any:
        """Compile while this function is on the stack of those that are being compiled, and let
        numba find what belongs there: code for callers, or that of its own.
        """
        stack = _compiling.stack
        kinds = tuple(sigutils.normalize_signature(signature)[0])
        results = for_callers if stack and not apart else on_its_own
        jit.overloads.pop(kinds, None)
        if kinds in results:
            jit.overloads[kinds] = results[kinds]
            return results[kinds].entry_point
        outer_stack = list(stack)
        stack[:] = [jit] if apart else [*stack, jit]
        try:
            return compile_for(signature)
        finally:
            stack[:] = outer_stack

    def compile_called(*arguments: Any, **keywords: Any) -> Any:
        """Python's call has no caller in compiled code, also where it happens while a function is
        compiled, as when the memory of a value is given back.
        """
        stack = _compiling.stack
        outer_stack = list(stack)
        stack.clear()
        try:
            return compile_for_python(*arguments, **keywords)
        finally:
            stack[:] = outer_stack

    def add(result: Any) -> None:
        kinds = tuple(result.signature.args)
        if isinstance(result.library, NestedLibrary):
            for_callers[kinds] = result
            jit.overloads[kinds] = result
            if not result.library.is_stored:
                _nested_count[0] += 1
        else:
            on_its_own[kinds] = result
            add_overload(result)

    jit.get_call_template = template_without_literals
    jit.compile = compile_on_stack
    jit._compile_for_args = compile_called
    jit.add_overload = add
