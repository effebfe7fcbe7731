"""A physics step in compiled code: MuJoCo's own C functions with the water's forces in their middle.

From Python a call costs more than such a function's work on two hulls. Compiled code calls it by its address in the
library that the `mujoco` package ships, with the addresses of MuJoCo's own model and data.

MuJoCo's semi-implicit Euler is a leapfrog: its velocities belong to the middles of the steps. Forces need those of the
instant, which are half a step later; the acceleration of the step before brings them there. For the velocities this is
the rule of Adams and Bashforth, v += dt (3 a - a_before) / 2, at no further evaluation of a force.

`sim.vehicle.plant.Plant` owns what is stepped. Code that steers it, compiled or not, calls `advance`.
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

from laisn.arrays import Floats
from laisn.compiled import compiled, copy_values
from laisn.failure import LaisnError
from sim.vehicle import effectors, hydrodynamics
from sim.water import Water

TRIED = "4.0.0"  # the release of MuJoCo on which compiled and Python calls were found to give the same bits
STAGES = ("mj_kinematics", "mj_comPos", "mj_makeM", "mj_fwdVelocity", "mj_factorM", "mj_step2")
"""Functions of (model, data) that make up a physics step."""

Calls = tuple[tuple[int, int, int, int, int, int], int, int]  # addresses of STAGES, of the model and of the data

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
    """Addresses with which compiled code steps an MjModel and its MjData; they hold as long as these live.

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


Fault = tuple[int, int]  # what ended a step, one of FINE … WARNED, and the index of the vehicle, or of MuJoCo's warning
FINE, LOST, NOT_FINITE, WARNED = range(4)


@compiled
def _lost(pose: Floats, twist: Floats) -> int:
    """First vehicle whose state is not finite, or that is faster than any can be; -1 if there is none."""
    return max(hydrodynamics.beyond(pose, np.inf), hydrodynamics.beyond(twist, hydrodynamics.LOST))


@compiled
def load(
    coefficients: Any,
    state: tuple[Floats, Floats, Floats, Floats],
    clock: tuple[float, float],
    water: Water,
    solver: hydrodynamics.Solver,
    push: tuple[Floats, Floats],
    fitted: tuple[Any, Floats],
) -> int:
    """Bring velocities from the middle of the last step to now, then `effectors.turn` and `hydrodynamics.apply`.

    Args:
        state: pose and twist; acceleration of the last step and, overwritten, what it adds to the twist, shape (v, 6).
        clock: time and half a step [s].
        push: unit wrenches and moments of `turn`.
    """
    pose, twist, acceleration, gain = state
    for i in range(twist.shape[0]):
        for j in range(6):
            gain[i, j] = clock[1] * acceleration[i, j]
            twist[i, j] += gain[i, j]
    effectors.turn(push[0], pose, push[1])
    return hydrodynamics.apply(coefficients, pose, twist, clock[0], water, solver, fitted)


@compiled
def begin(body: Any, command: Floats, half_step: float) -> Fault:
    """Check state and command, give the command to MuJoCo, and take velocities to the middle of the step before."""
    (pose, twist, acceleration, _), control, _, _, layout = body
    lost = _lost(pose, twist)
    if lost >= 0:
        return LOST, lost
    bad = hydrodynamics.beyond(command, np.inf)
    if bad >= 0:
        return NOT_FINITE, bad
    for i in range(control.shape[0]):
        copy_values(command[i], control[i])
    effectors.lay_out(layout, control.shape[1])
    for i in range(twist.shape[0]):
        for j in range(6):
            twist[i, j] -= half_step * acceleration[i, j]
    return FINE, -1


@compiled
def end(body: Any, half_step: float) -> Fault:
    """Bring velocities to now, check the state, and store it as the last valid one."""
    (pose, twist, acceleration, _), _, good, warnings, _ = body
    for i in range(twist.shape[0]):
        for j in range(6):
            twist[i, j] += half_step * acceleration[i, j]
    lost = _lost(pose, twist)
    if lost >= 0:
        return LOST, lost
    for i in range(warnings.size):
        if warnings[i] > 0:
            return WARNED, i
    for i in range(twist.shape[0]):
        copy_values(pose[i], good[0][i])
        copy_values(twist[i], good[1][i])
    return FINE, -1


@compiled
def advance(handles: Any, command: Floats, n_substeps: int) -> Fault:
    """Advance a plant from compiled code, as `Plant.step` does.

    Args:
        handles: of `Plant.step_handles`, taken after the last step from Python.
        command: of each effector, shape (v, m), in the units of its state.
        n_substeps: number of physics steps.

    Returns:
        The argument of `Plant.finish_step`, to be called from Python.
    """
    (stages, model, data), clock, body, (records, water, solver, push, fitted) = handles
    kinematics, centres, inertia, velocity, factor, finish = stages
    state, dt = body[0], clock[1]
    twist, gain = state[1], state[3]
    fault = begin(body, command, 0.5 * dt)
    if fault[0] != FINE:
        return fault
    for _ in range(n_substeps):
        call(kinematics, model, data)
        call(centres, model, data)
        call(inertia, model, data)
        lost = load(records, state, (clock[0], 0.5 * dt), water, solver, push, fitted)
        if lost >= 0:
            return LOST, lost
        call(velocity, model, data)
        call(factor, model, data)
        for i in range(twist.shape[0]):
            for j in range(6):
                twist[i, j] -= gain[i, j]
        call(finish, model, data)
        clock[0] += dt
    return end(body, 0.5 * dt)
