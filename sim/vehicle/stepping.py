"""A physics step in compiled code: MuJoCo's own functions with the water's forces in their middle.

MuJoCo's semi-implicit Euler is a leapfrog: its velocities belong to the middles of the steps. Forces need those of the
instant, which are half a step later; the acceleration of the step before brings them there. For the velocities this is
the rule of Adams and Bashforth, v += dt (3 a - a_before) / 2, at no further evaluation of a force.

`sim.vehicle.plant.Plant` owns what is stepped. Code that steers it, compiled or not, calls `advance`.
"""

from typing import Any

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, copy_values
from sim.vehicle import effectors, hydrodynamics
from sim.vehicle.mujoco_functions import call
from sim.water.ocean import Water

Fault = tuple[int, int]
"""What ended a step, one of FINE … WARNED, and the index of the vehicle, or of MuJoCo's warning."""
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

    All in one call: to get into compiled code costs as much as a hull's forces. Other arguments are those of `apply`.

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
    """Advance a plant from compiled code, as `Plant.step` does; a controller in compiled code calls this.

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
