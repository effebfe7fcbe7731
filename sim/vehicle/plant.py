"""The plant: vehicles in the ocean, stepped by MuJoCo with the water's forces. It speaks of vehicles, not of qpos."""

from collections.abc import Sequence
from typing import Any, NoReturn

import mujoco
import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled
from laisn.failure import LaisnError
from sim.geometry import attitude
from sim.vehicle import coefficients, hydrodynamics, thrusters
from sim.vehicle.mjcf import THRUSTERS, VehicleSetup, compose, resolve
from sim.water.ocean import Ocean, Water, water_velocity

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


_NO_CONTACT = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT.value | mujoco.mjtDisableBit.mjDSBL_CONTACT.value
"""Hulls pass through one another and through the floor, whatever their geoms say."""


class PlantError(LaisnError):
    """A simulation that cannot go on: which vehicle, when, and its last good state.

    Attributes:
        vehicle: name of the vehicle; "" if MuJoCo warned without naming one.
        time: of the physics step at fault [s].
        last_pose: position and quaternion of all vehicles after the last good `Plant.step`, shape (v, 7).
        last_twist: their velocities then, shape (v, 6).
    """

    def __init__(self, message: str, vehicle: str, time: float, last_pose: Floats, last_twist: Floats) -> None:
        super().__init__(message)
        self.vehicle = vehicle
        self.time = time
        self.last_pose = last_pose
        self.last_twist = last_twist


@compiled
def _load(
    coefficients: Any,
    state: tuple[Floats, Floats, Floats, Floats],
    clock: tuple[float, float],
    water: Water,
    solver: hydrodynamics.Solver,
    push: tuple[Floats, Floats],
) -> int:
    """Bring velocities from the middle of the last step to now, then `thrusters.turn` and `hydrodynamics.apply`.

    All in one call: to get into compiled code costs as much as a hull's forces.

    Args:
        coefficients: as of `apply`.
        state: pose and twist; acceleration of the last step and, overwritten, what it adds to the twist, shape (v, 6).
        clock: time and half a step [s].
        water: as of `apply`.
        solver: as of `apply`.
        push: unit wrenches and moments of `turn`.
    """
    pose, twist, acceleration, gain = state
    for i in range(twist.shape[0]):
        for j in range(6):
            gain[i, j] = clock[1] * acceleration[i, j]
            twist[i, j] += gain[i, j]
    thrusters.turn(push[0], pose, push[1])
    return hydrodynamics.apply(coefficients, pose, twist, clock[0], water, solver)


class Plant:
    """Owns the compiled model and its state, and steps it to second order.

    MuJoCo's semi-implicit Euler is a leapfrog: its velocities belong to the middles of the steps. Forces want those of
    the instant, which are half a step later; the acceleration of the step before brings them there. For the velocities
    this is the rule of Adams and Bashforth, v += dt (3 a - a_before) / 2, at no further evaluation of a force.

    Attributes:
        names: of the vehicles, shape (v,).
        pose: position [m] and quaternion (w, x, y, z), shape (v, 7); a view that follows the state.
        twist: velocity of the origin in the world [m/s] and angular velocity in the body [rad/s], shape (v, 6); a view.
        thrust: of the thrusters as they are, in the order of `sim.vehicle.mjcf.THRUSTERS`, shape (v, 5), [N]; a view.
        thrust_limits: lowest and highest command, shape (v, 5, 2), [N].
        site_names: "vehicle/site" of all sites, shape (s,).
        site_vehicle: index of the vehicle that carries a site, shape (s,).
        site_offset: of the sites in their vehicle's body frame, shape (s, 3), [m].
        site_positions: of the sites in the world, shape (s, 3), [m]; a view, up to date after `step`.
        model, data: MuJoCo's own, for rendering and for tests.
    """

    def __init__(self, setups: Sequence[VehicleSetup], ocean: Ocean, dt: float = 0.02) -> None:
        """Compose and compile the model, vehicles as `setups` place them.

        Raises:
            ValueError: dt is not positive, or the setups or the models' coefficients are at fault.
        """
        if not 0 < dt < np.inf:
            raise ValueError(f"dt={dt} must be positive")
        spec = compose(setups, ocean.floor_depth_m)
        spec.option.timestep = dt
        spec.option.disableflags |= _NO_CONTACT
        self.ocean = ocean
        self.dt = dt
        self.names = tuple(s.name for s in setups)
        self.model = model = spec.compile()
        self.data = data = mujoco.MjData(model)
        self._coefficients = coefficients.read(model, self.names, ocean.density_kg_m3)
        self._water = ocean.water

        n = len(setups)
        vehicles = [resolve(model, name) for name in self.names]
        actuators = [v.actuators for v in vehicles]
        if [v.qpos for v in vehicles] != list(range(0, 7 * n, 7)) or sum(actuators, ()) != tuple(range(5 * n)):
            raise ValueError(f"the state of the model is not {n} free bodies with {len(THRUSTERS)} thrusters each")
        self.pose: Floats = data.qpos.reshape(n, 7)
        self.twist: Floats = data.qvel.reshape(n, 6)
        self.thrust: Floats = data.act.reshape(n, len(THRUSTERS))
        self.thrust_limits: Floats = model.actuator_ctrlrange.reshape(n, len(THRUSTERS), 2).copy()
        self._command: Floats = data.ctrl.reshape(n, len(THRUSTERS))
        rows = model.M_rowadr.astype(np.int64).reshape(n, 6)
        self._solver: hydrodynamics.Solver = (rows, data.M, data.qfrc_applied.reshape(n, 6))
        self._acceleration: Floats = data.qacc.reshape(n, 6)
        self._gain = np.empty((n, 6))
        self._state = self.pose, self.twist, self._acceleration, self._gain
        self._half_step = dt / 2
        wrenches = thrusters.unit_wrenches(model, vehicles)
        self._thrusters: tuple[Floats, Floats] = wrenches, data.actuator_moment.reshape(wrenches.shape)
        # MuJoCo's sparse matrix of moments is to hold all six of each thruster; `mj_forward` leaves out those of zero
        columns = np.repeat(np.arange(6 * n).reshape(n, 1, 6), len(THRUSTERS), axis=1)
        self._layout = [
            (sparse, full.astype(sparse.dtype))
            for sparse, full in (
                (data.moment_rownnz, np.full(model.nu, 6)),
                (data.moment_rowadr, 6 * np.arange(model.nu)),
                (data.moment_colind, columns.ravel()),
            )
        ]

        self.site_names = tuple(model.site(i).name for i in range(model.nsite))
        bodies = [v.body for v in vehicles]
        self.site_vehicle: Ints = np.array([bodies.index(b) for b in model.site_bodyid], dtype=np.int64)
        self.site_offset: Floats = model.site_pos.copy()
        self.site_positions: Floats = data.site_xpos

        for i, setup in enumerate(setups):
            forward = attitude.rotate(self.pose[i, 3:], np.array([1.0, 0.0, 0.0]))
            self.twist[i, :3] = setup.speed_m_s * forward
        mujoco.mj_forward(model, data)
        self._last_pose, self._last_twist = self.pose.copy(), self.twist.copy()
        self._begin()

    def _prepare(self) -> None:
        """All of a step but its end; twists are those of the middle of the last step before, and of now after."""
        model, data = self.model, self.data
        # what `mj_step1` does, less what free hulls do not have (contacts, tendons, sensors), what nobody looks at
        # (cameras, lights) and what `thrusters` does for less
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        clock = data.time, self._half_step
        bad = _load(self._coefficients, self._state, clock, self._water, self._solver, self._thrusters)
        if bad >= 0:
            self._fail(f"the state of {self.names[bad]} is lost", self.names[bad])
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_factorM(model, data)

    def _begin(self) -> None:
        """Find the accelerations of the start, which the first step takes for those of a step before."""
        self._acceleration[:] = 0.0
        self._lay_out()
        self._prepare()
        mujoco.mj_fwdActuation(self.model, self.data)
        mujoco.mj_fwdAcceleration(self.model, self.data)
        mujoco.mj_fwdConstraint(self.model, self.data)

    def _lay_out(self) -> None:
        for sparse, full in self._layout:
            sparse[:] = full

    @property
    def time(self) -> float:
        """[s]."""
        return float(self.data.time)

    def water_velocity(self) -> Floats:
        """Of the water at the vehicles' origins, in the world, shape (v, 3), [m/s]."""
        out = np.empty((len(self.names), 3))
        water_velocity(self.pose[:, :3], self.time, self._water, out)
        return out

    def step(self, command: Floats, n_substeps: int = 1) -> None:
        """Advance by `n_substeps` physics steps under constant commands.

        Args:
            command: thrust asked of each thruster, shape (v, 5), [N]; limited to `thrust_limits`.
            n_substeps: number of steps of `dt`.

        Raises:
            ValueError: the command has the wrong shape.
            PlantError: the state or a command is not finite, a vehicle is faster than any can be, or MuJoCo warns.
        """
        if command.shape != self._command.shape:
            raise ValueError(f"command has shape {command.shape}, expected {self._command.shape}")
        model, data = self.model, self.data
        self._check_state()
        bad = hydrodynamics.beyond(command, np.inf)
        if bad >= 0:
            self._fail(f"the command of {self.names[bad]} is not finite", self.names[bad])
        self._command[:] = command
        self._lay_out()
        prepare, step2, subtract, twist, gain = self._prepare, mujoco.mj_step2, np.subtract, self.twist, self._gain
        twist -= self._half_step * self._acceleration
        for _ in range(n_substeps):
            prepare()
            subtract(twist, gain, twist)
            step2(model, data)
        twist += self._half_step * self._acceleration
        mujoco.mj_kinematics(model, data)
        self._check_state()
        if data.warning.number.any():
            self._fail(f"MuJoCo warns: {mujoco.mjtWarning(int(data.warning.number.argmax())).name}", "")
        self._last_pose[:] = self.pose
        self._last_twist[:] = self.twist

    def _check_state(self) -> None:
        bad = max(hydrodynamics.beyond(self.pose, np.inf), hydrodynamics.beyond(self.twist, hydrodynamics.LOST))
        if bad >= 0:
            self._fail(f"the state of {self.names[bad]} is lost", self.names[bad])

    def _fail(self, what: str, vehicle: str) -> NoReturn:
        message = f"t = {self.time:.3f} s: {what}; last good pose and twist by vehicle:"
        for name, pose, twist in zip(self.names, self._last_pose, self._last_twist, strict=True):
            message += f"\n  {name}: {np.array2string(pose, precision=4)} {np.array2string(twist, precision=4)}"
        raise PlantError(message, vehicle, self.time, self._last_pose.copy(), self._last_twist.copy())
