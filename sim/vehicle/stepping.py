"""Physics steps of vehicles under constant commands, in compiled code.

Semi-implicit Euler is a leapfrog: its velocities belong to the middles of the steps.
Forces need those of the instant, half a step later, to which the acceleration of the step before
brings them: for the velocities the rule of Adams and Bashforth, v += dt (3 a - a_before) / 2, at no
further evaluation of a force.
"""

from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Records
from laisn.compiled import compiled, copy_values, method_by_type
from sim.vehicle import effectors, hydrodynamics
from sim.vehicle.effectors import Fitted
from sim.water.environment import Environment

method_by_type("run_steps")

# what ended a step, one of OK … MUJOCO_WARNING, and the index of the vehicle, or of the warning
Fault = tuple[int, int]
OK, DIVERGED, NONFINITE_COMMAND, MUJOCO_WARNING = range(4)


@compiled
def _shift(twist: Floats, acceleration: Floats, time: float) -> None:
    """Take velocities to another instant, by the acceleration of the last step."""
    for i in range(twist.shape[0]):
        for j in range(6):
            twist[i, j] += time * acceleration[i, j]


class StepHandles(NamedTuple):
    """What a step works on: the state, and all that loads and moves the hulls."""

    clock: Floats  # time and physics step [s], shape (2,)
    pose: Floats  # as of `PlantState`, in MuJoCo's memory, as the next, or in that of lanes
    twist: Floats
    acceleration: Floats  # rates of `twist` in the last step [m/s²], [rad/s²], shape (v, 6)
    response: Floats  # share of the way to its command that an effector goes in a step, (v, m)
    last_pose: Floats  # the last ones that were valid
    last_twist: Floats
    warnings: Ints  # how often MuJoCo has warned, by the kind of warning
    coefficients: Records  # of the hulls, as of `Plant`
    environment: Environment
    solver: Any  # as `sim.vehicle.solvers.MujocoSolver`
    fitted: Fitted

    @compiled
    def run_steps(self, command: Floats, n_substeps: int) -> Fault:
        """Advance as of `advance`."""
        return advance(self, command, n_substeps)


@compiled
def advance(handles: StepHandles, command: Floats, n_substeps: int) -> Fault:
    """Advance vehicles one after the other, as `Plant.step` does, after `Plant.set_clock`.

    Returns the argument of `Plant.finish_step`, to be called from Python.
    """
    h = handles
    pose = h.pose
    twist = h.twist
    acceleration = h.acceleration
    clock = h.clock
    half_step = 0.5 * clock[1]
    unusable = hydrodynamics.first_row_exceeding(command, np.inf)
    if unusable >= 0:
        return NONFINITE_COMMAND, unusable
    _shift(twist, acceleration, -half_step)
    for _ in range(n_substeps):
        h.solver.begin_solving()
        # forces are those of the instant, velocities those of the middle of the last step
        _shift(twist, acceleration, half_step)
        lost = hydrodynamics.apply_water_forces(
            h.coefficients, pose, twist, clock[0], h.environment, h.solver, h.fitted
        )
        if lost >= 0:
            return DIVERGED, lost
        h.solver.end_forces()
        _shift(twist, acceleration, -half_step)
        h.solver.move_bodies()
        effectors.update_states(h.fitted, command, h.response, clock[1])
        clock[0] += clock[1]
    _shift(twist, acceleration, half_step)
    lost = max(
        hydrodynamics.first_row_exceeding(pose, np.inf),
        hydrodynamics.first_row_exceeding(twist, hydrodynamics.DIVERGED),
    )
    if lost >= 0:
        return DIVERGED, lost
    for i in range(h.warnings.size):
        if h.warnings[i] > 0:
            return MUJOCO_WARNING, i
    for i in range(twist.shape[0]):
        copy_values(pose[i], h.last_pose[i])
        copy_values(twist[i], h.last_twist[i])
    return OK, -1


@compiled
def run_steps(handles: Any, command: Floats, n_substeps: int) -> Fault:
    """Advance by `StepHandles` or handles with the same method."""
    fault: Fault = handles.run_steps(command, n_substeps)
    return fault
