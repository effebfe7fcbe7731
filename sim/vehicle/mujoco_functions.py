"""MuJoCo's C functions for compiled code: their addresses in the library that the `mujoco` package ships.

From Python a call costs more than such a function's work on two hulls. Compiled code calls it like any other function,
by its address, with the addresses of MuJoCo's own model and data.
"""

import ctypes
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
from numba import types
from numba.extending import intrinsic

from laisn.failure import LaisnError

TRIED = "4.0.0"
"""The release of MuJoCo on which compiled and Python calls were found to give the same bits."""
STAGES = ("mj_kinematics", "mj_comPos", "mj_makeM", "mj_fwdVelocity", "mj_factorM", "mj_step2")
"""Functions of (model, data) that make up a physics step."""

Calls = tuple[tuple[int, int, int, int, int, int], int, int]
"""Addresses of STAGES, of the model and of the data."""

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS.value


class UnavailableError(LaisnError):
    """Compiled code cannot call MuJoCo here; the message gives the reason."""


@cache
def library() -> ctypes.CDLL:
    """The shared library behind the Python package; UnavailableError if it is not there or not the release expected."""
    if mujoco.__version__ != TRIED:
        raise UnavailableError(f"MuJoCo is {mujoco.__version__}, compiled steps were tried with {TRIED} alone")
    folder = Path(mujoco.__file__).parent
    names = (f"libmujoco.so.{TRIED}", f"libmujoco.{TRIED}.dylib", "mujoco.dll")
    found = [folder / name for name in names if (folder / name).is_file()]
    if not found:
        raise UnavailableError(f"{folder} holds none of {', '.join(names)}")
    try:
        loaded = ctypes.CDLL(str(found[0]))
    except OSError as error:
        raise UnavailableError(f"{found[0]} cannot be loaded: {error}") from error
    return loaded


def find(model: Any, data: Any) -> Calls:
    """Addresses with which compiled code steps this model; they hold as long as model and data live.

    Args:
        model: MjModel.
        data: MjData of it.

    Raises:
        UnavailableError: this release of MuJoCo was not tried, its library is missing, or it sees another state behind
            the addresses than Python does.
    """
    shared = library()
    model_address, data_address = int(model._address), int(data._address)
    seen, expected = np.full((2, mujoco.mj_stateSize(model, _STATE)), np.nan)
    mujoco.mj_getState(model, data, expected, _STATE)
    pointers = (ctypes.c_void_p(address) for address in (model_address, data_address, seen.ctypes.data))
    shared.mj_getState(*pointers, ctypes.c_int(_STATE))
    if not np.array_equal(seen, expected):
        raise UnavailableError("MuJoCo's library sees another state than its Python package")
    stages = (cast(int, ctypes.cast(getattr(shared, name), ctypes.c_void_p).value) for name in STAGES)
    return cast(Calls, (tuple(stages), model_address, data_address))


def _emit_call(_: Any, function: Any, model: Any, data: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        function_type = types.FunctionType(types.void(types.intp, types.intp))
        pointer = context.get_value_type(function_type.ftype)
        builder.call(builder.inttoptr(args[0], pointer), args[1:])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp), generate


call: Callable[[int, int, int], None] = cast(Any, intrinsic(_emit_call))
"""Call one of STAGES: its address, the model's and the data's. To be called from compiled code only."""
