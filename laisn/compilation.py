"""Compilation in two stages: a part of each function, and machine code of those alone that Python calls.

Numba optimises each function with all that it calls, and makes machine code of it, before it does the same with what
calls it. Most functions here are called by compiled code alone and inlined there; leaving that out for them halves the
time that a first flight takes to compile. What is computed stays the same to the bit: no optimisation may reorder
arithmetic, except in passes over lanes, and these are optimised one by one as numba does it.
"""

import os
from collections.abc import Callable
from copy import copy
from functools import cache
from itertools import count
from typing import Any, NamedTuple

from llvmlite import binding
from numba.core import event, sigutils, typing
from numba.core.bytecode import FunctionIdentity
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import Environment
from numba.core.registry import CPUDispatcher
from numba.core.runtime.nrt import rtsys
from numba.core.typed_passes import NativeLowering
from numba.core.types import unliteral

from laisn.code_cache import CodeCache
from laisn.counting import CountIfNeeded

# Numba tells functions of one name and type apart by numbers, and counts in each process from one. Parts that several
# processes kept meet in one: there, two functions must never have the same name.
FunctionIdentity._unique_ids = count(int.from_bytes(os.urandom(6)))


class Part(NamedTuple):
    """A function for some types of arguments, ready to be linked into others."""

    library: Any
    """Its code and that of all it calls, for LLVM; also the key under which lowering finds it."""
    description: Any
    environment: Any
    signature: Any


class _PartLibrary(JITCodeLibrary):
    """Code to be linked into that of callers, which has no address of its own."""

    optimised = False

    def finalize(self) -> None:
        """Link what is called."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        if self.optimised:
            self._optimize_final_module()
        self._finalize_dynamic_globals()
        self._finalized = True


class _PartCompiler(Compiler):
    """Numba's compiler, with another library to compile into."""

    def __init__(self, typing_context: Any, target_context: Any, _: None, args: Any, result: Any, flags: Flags,
                 names: Any) -> None:  # fmt: skip
        library = _PartLibrary(target_context.codegen(), "part")
        # the vectoriser sees one pass over lanes at a time, and multiplications and additions fuse within it
        library.optimised = bool(flags.fastmath)
        super().__init__(typing_context, target_context, library, args, result, flags, names)

    def define_pipelines(self) -> list[Any]:
        """Numba's own, with one step more before code is made."""
        pipelines: list[Any] = super().define_pipelines()
        for pipeline in pipelines:
            steps = [step for step, _ in pipeline.passes]
            pipeline.add_pass_after(CountIfNeeded, steps[steps.index(NativeLowering) - 1])
            pipeline.finalize()
        return pipelines


def _refuse_shapes(source: Any, target: Any) -> None:
    raise NotImplementedError("for compiled code only")


@cache
def _keep_shapes_out_of_messages() -> None:
    """Have numba say that an assigned array has another shape, and not which.

    The code that puts numbers into that text takes seconds to compile, in each process that compiles at all. To be
    called before something is compiled, as the compiler takes a while to import.
    """
    from numba.extending import overload
    from numba.np import arrayobj

    @overload(_refuse_shapes)
    def refuse(source: Any, target: Any) -> Callable[[Any, Any], None]:
        def raise_error(source: Any, target: Any) -> None:
            raise ValueError("cannot assign an array to part of another that has a different shape")

        return raise_error

    arrayobj.raise_with_shape_context = _refuse_shapes


def _machine_code(part: Part, target_context: Any, *, without_gil: bool) -> CompileResult:
    """A function that Python can call.

    It has an environment of its own, where its wrapper keeps Python's objects: in a process that takes part and machine
    code from the cache, another process may have made either.
    """
    # a part from the cache needed nothing of what numba can compile; its wrapper does
    target_context.refresh()
    context, description = target_context.subtarget(enable_nrt=True), copy(part.description)
    description.env_name += "_called"
    environment = Environment.from_fndesc(description)
    library = context.codegen().create_library(part.library.name)
    library.enable_object_caching()
    library.add_linking_library(part.library)
    library.add_linking_library(rtsys.library)
    context.create_cpython_wrapper(library, description, environment, None, release_gil=without_gil)
    made = CompileResult(
        typing_context=context.typing_context, target_context=context, type_annotation="", typing_error=None,
        entry_point=context.get_executable(library, description, environment), signature=part.signature,
        library=library, lifted=(), fndesc=description, call_helper=None, environment=environment, objectmode=False,
        metadata=None, reload_init=list(part.library._reload_init), referenced_envs=(),
    )  # fmt: skip
    for referenced in made._find_referenced_environments():
        library.codegen.set_env(referenced.env_name, referenced)
    return made


class TwoStageDispatcher(CPUDispatcher):
    """Chooses the code for types of arguments, and compiles it if it is not there or in the cache.

    Types alone count: numba would compile again for each constant that a caller passes, and for the constant at which
    the variable of a loop begins, which costs a first flight a third more time and gains nothing. LLVM knows constants
    where it inlines.
    """

    def __init__(self, function: Callable[..., Any], names: Any = None, options: Any = None) -> None:
        """Prepare for a function; `options` are numba's."""
        super().__init__(function, locals=names, targetoptions=options)
        self._parts: dict[tuple[Any, ...], Part] = {}
        # numba's own cache knows the file of the function alone, not what it imports
        self._cache = CodeCache(function)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """What a call by compiled code with these types gives."""
        plain: Callable[[Any], Any] = unliteral
        signature, folded = self._compiler.fold_argument_types(
            tuple(map(plain, args)), {name: plain(kind) for name, kind in kws.items()}
        )
        part, name = self._part(tuple(folded), keep=True), self.py_func.__name__
        template = typing.make_concrete_template(f"CallTemplate({name})", key=name, signatures=[part.signature])
        return template, signature, folded, {}

    def get_overload(self, sig: Any) -> Any:
        """Key of what compiled code calls."""
        args, _ = sigutils.normalize_signature(sig)
        return self._parts[tuple(args)].library

    def _part(self, args: tuple[Any, ...], *, keep: bool) -> Part:
        """The part for these types; `keep` it from one process to the next, or not."""
        with global_compiler_lock, self._compiling_counter:
            if args not in self._parts:
                part = self._kept_part(args) or self._new_part(args, keep=keep)
                self.targetctx.insert_user_function(part.library, part.description, [part.library])
                self._parts[args] = part
            return self._parts[args]

    def _kept_part(self, args: tuple[Any, ...]) -> Part | None:
        kept = self._cache.load_part(args, self.targetctx)
        if kept is None:
            return None
        bitcode, description, environment, signature, _ = kept
        library = _PartLibrary(self.targetctx.codegen(), "part")
        library._final_module = binding.parse_bitcode(bitcode)
        library._finalize_dynamic_globals()
        library._finalized = True
        return Part(library, description, environment, signature)

    def _new_part(self, args: tuple[Any, ...], *, keep: bool) -> Part:
        _keep_shapes_out_of_messages()
        flags = Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        with self._event(args):
            made = compile_extra(
                self.typingctx, self.targetctx, self.py_func, args, None, flags, self.locals,
                pipeline_class=_PartCompiler,
            )  # fmt: skip
        part = Part(made.library, made.fndesc, made.environment, made.signature)
        made.library.finalize()
        if keep and not made.library.has_dynamic_globals and not made.library._reload_init:
            made.fndesc.typemap = made.fndesc.calltypes = None
            bitcode, others = made.library._get_module_for_linking().as_bitcode(), made._find_referenced_environments()
            self._cache.save_part(args, self.targetctx, (bitcode, *part[1:], tuple(others)))
        return part

    def _event(self, args: tuple[Any, ...]) -> Any:
        """What those listen to who tell that something is compiled."""
        return event.trigger_event("numba:compile", data={"dispatcher": self, "args": args, "return_type": None})

    def compile(self, sig: Any) -> Any:
        """Machine code for these types of arguments, which Python can call."""
        with global_compiler_lock, self._compiling_counter:
            args, _ = sigutils.normalize_signature(sig)
            code = self.overloads.get(tuple(args))
            if code is None:
                code = self._cache.load_overload(sig, self.targetctx)
                (self._cache_misses if code is None else self._cache_hits)[sig] += 1
                if code is None:
                    code = self._new_code(tuple(args))
                    self._cache.save_overload(sig, code)
                self.add_overload(code)
            return code.entry_point

    def _new_code(self, args: tuple[Any, ...]) -> CompileResult:
        with self._event(args):
            part = self._part(args, keep=False)
            return _machine_code(part, self.targetctx, without_gil=bool(self.targetoptions.get("nogil")))
