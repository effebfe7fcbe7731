"""How this project compiles: numba, with one set of flags, and code that is kept until a source of it changes."""

from collections.abc import Callable
from functools import update_wrapper
from typing import Any, TypeVar, cast

import numba
from numba.core.registry import CPUDispatcher

from laisn.compilation import TwoStageDispatcher

Function = TypeVar("Function", bound=Callable[..., Any])


def _kept(function: Function, **flags: Any) -> Function:
    options = {"nopython": True, "error_model": "numpy", **flags}
    return cast(Function, TwoStageDispatcher(function, options=options))


def compiled(function: Function) -> Function:
    """Compile a function of arrays and scalars; division by zero gives inf or NaN as in NumPy."""
    return _kept(function)


def inlined(function: Function) -> Function:
    """Compile a small helper into its callers, so that loops over lanes stay vectorised."""
    return cast(Function, numba.njit(inline="always", error_model="numpy")(function))


class _Formula(CPUDispatcher):
    """What compiled code takes for a function to inline, and Python calls as it is written."""

    def __call__(self, *args: Any, **named: Any) -> Any:
        return self.py_func(*args, **named)


def formula(function: Function) -> Function:
    """A formula of numbers: Python runs it as it is written, and compiled code has it inlined.

    So it stands once for an engine that is read and for one that is quick. Records are NamedTuples, and no branch may
    divide by zero, which Python refuses.
    """
    made = _Formula(function, targetoptions={"nopython": True, "inline": "always", "error_model": "numpy"})
    return cast(Function, update_wrapper(made, function))


def compiled_run(function: Function) -> Function:
    """Compile a long loop over one run, with the arithmetic of `compiled`; threads run side by side."""
    return _kept(function, nogil=True)


def compiled_lanes(function: Function) -> Function:
    """Compile a pass over lanes: fused multiply-adds are allowed, NaN keeps its meaning, threads run side by side."""
    return _kept(function, fastmath={"contract", "nsz"}, nogil=True)
