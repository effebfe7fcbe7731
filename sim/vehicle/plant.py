"""The plant: vehicles in the ocean, stepped by MuJoCo with the water's forces. Users see vehicles, not qpos."""

from collections.abc import Sequence
from typing import Any, NoReturn

import mujoco
import numpy as np

from laisn.arrays import Floats, Ints
from laisn.failure import LaisnError
from sim import attitude
from sim.vehicle import coefficients, effectors, hydrodynamics, stepping
from sim.vehicle.mjcf import VehicleSetup, compose, resolve
from sim.vehicle.stepping import LOST, Fault
from sim.water import Ocean, water_velocity

NO_CONTACT = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT.value | mujoco.mjtDisableBit.mjDSBL_CONTACT.value
"""Hulls pass through one another and through the floor, whatever their geoms are."""


_NO_JOINT_FORCES = mujoco.mjtDisableBit.mjDSBL_SPRING.value | mujoco.mjtDisableBit.mjDSBL_DAMPER.value
"""Free bodies have neither springs nor dampers, and MuJoCo need not look for them; damping is the water's."""


class PlantError(LaisnError):
    """A simulation that cannot continue; the text has vehicle, time and the last valid state."""


class Plant:
    """Owns the compiled model and its state, and steps it to second order; see `sim.vehicle.stepping`.

    Attributes:
        setups: as given.
        names: of the vehicles, shape (v,).
        pose: position [m] and quaternion (w, x, y, z), shape (v, 7); a view that follows the state.
        twist: velocity of the origin in the world [m/s] and angular velocity in the body [rad/s], shape (v, 6); a view.
        effectors: records of `sim.vehicle.effectors.EFFECTOR` in the order of the MJCF, shape (v, m), read-only; m is
            the largest number of any vehicle, and records beyond a vehicle's own are zero.
        fixed_fins: likewise, of `sim.vehicle.effectors.read_fixed`, shape (v, q).
        true_coefficients: records of `sim.vehicle.coefficients.RECORD` with the setups' scales, shape (v,), read-only.
        true_effectors: effectors and fixed fins with the setups' scales, shape (v, m + q), read-only.
        effector_names: names of each vehicle's own.
        thrust: states of the effectors, shape (v, m): thrust [N], revolutions per second, deflection [rad], or what a
            thruster's curve is of; a view.
        state: pose, twist and thrust, for compiled code that reads them.
        site_names: "vehicle/site" of all sites, shape (s,).
        site_vehicle: index of the vehicle that carries a site, shape (s,).
        site_offset: of the sites in their vehicle's body frame, shape (s, 3), [m].
        site_positions: of the sites in the world, shape (s, 3), [m]; a view, up to date after `step`.
        model, data: MuJoCo's own, without what is only seen of the vehicles.
    """

    def __init__(self, setups: Sequence[VehicleSetup], ocean: Ocean, dt: float = 0.02) -> None:
        """Compose and compile the model, vehicles as `setups` place them.

        Raises:
            LaisnError: the setups or the models' coefficients are invalid.
        """
        spec = compose(setups, ocean.floor_depth_m, looks=False)
        spec.option.timestep = dt
        spec.option.disableflags |= NO_CONTACT | _NO_JOINT_FORCES
        self.ocean = ocean
        self.dt = dt
        self.setups = tuple(setups)
        self.names = tuple(s.name for s in setups)
        self.model = model = spec.compile()
        self.data = data = mujoco.MjData(model)

        n = len(setups)
        vehicles = [resolve(model, name) for name in self.names]
        m = len(vehicles[0].actuators)
        actuators = sum((v.actuators for v in vehicles), ())
        if [v.qpos for v in vehicles] != list(range(0, 7 * n, 7)) or actuators != tuple(range(m * n)):
            raise ValueError(f"the state of the model is not {n} free bodies with {m} actuators each")
        self.pose: Floats = data.qpos.reshape(n, 7)
        self.twist: Floats = data.qvel.reshape(n, 6)
        self.thrust: Floats = data.act.reshape(n, m)
        self.state = self.pose, self.twist, self.thrust
        self.effectors, self.fixed_fins = effectors.read(model, vehicles), effectors.read_fixed(model, vehicles)
        self.effectors.flags.writeable = self.fixed_fins.flags.writeable = False
        prefixes = [f"{v.name}/" for v in vehicles]
        self.effector_names = tuple(
            tuple(model.actuator(i).name.removeprefix(prefix) for i in v.actuators[: v.effectors])
            for v, prefix in zip(vehicles, prefixes, strict=True)
        )
        rows = model.M_rowadr.astype(np.int64).reshape(n, 6)
        solver: hydrodynamics.Solver = (rows, data.M, data.qfrc_applied.reshape(n, 6))
        self._acceleration: Floats = data.qacc.reshape(n, 6)
        self._gain = np.empty((n, 6))
        self._last_pose, self._last_twist = np.empty((n, 7)), np.empty((n, 6))
        self._half_step = dt / 2
        nominal = coefficients.read(model, self.names, ocean.density_kg_m3)
        self.true_coefficients = coefficients.scaled(nominal, setups)
        self.true_effectors = effectors.scaled_records(
            np.concatenate([self.effectors, self.fixed_fins], axis=1), setups
        )
        wrenches = effectors.unit_wrenches(self.true_effectors[:, :m])
        # MuJoCo applies no force of the others, whatever the gain of their actuators is
        wrenches[self.effectors["kind"] != effectors.THRUSTER] = 0.0
        push = wrenches, data.actuator_moment.reshape(wrenches.shape)
        self._layout: effectors.Layout = (data.moment_rownnz, data.moment_rowadr, data.moment_colind)
        self._loads: Any = self.true_coefficients, ocean.water, solver, push, (self.true_effectors, self.thrust)
        self._body = (
            (self.pose, self.twist, self._acceleration, self._gain),
            data.ctrl.reshape(n, m),
            (self._last_pose, self._last_twist),
            data.warning.number,
            self._layout,
        )
        self._clock = np.array([0.0, dt])

        self.site_names = tuple(model.site(i).name for i in range(model.nsite))
        bodies = [v.body for v in vehicles]
        self.site_vehicle: Ints = np.array([bodies.index(b) for b in model.site_bodyid], dtype=np.int64)
        self.site_offset: Floats = model.site_pos.copy()
        self.site_positions: Floats = data.site_xpos

        for i, setup in enumerate(setups):
            forward = attitude.rotate(self.pose[i, 3:], np.array([1.0, 0.0, 0.0]))
            self.twist[i, :3] = setup.speed_m_s * forward
        mujoco.mj_forward(model, data)
        self._last_pose[:], self._last_twist[:] = self.pose, self.twist
        self._find_accelerations()
        self._calls = stepping.find(model, data)

    def _find_accelerations(self) -> None:
        """Find the accelerations of the start, which the first step takes for those of a step before."""
        model, data = self.model, self.data
        self._acceleration[:] = 0.0
        effectors.lay_out(self._layout, self.thrust.shape[1])
        # what `mj_step1` does, less what free hulls do not have (contacts, tendons, sensors), what is not used
        # (cameras, lights) and what `effectors` does for less
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        records, *loads = self._loads
        lost = stepping.load(records, self._body[0], (data.time, self._half_step), *loads)
        if lost >= 0:
            self.finish_step((LOST, lost))
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_factorM(model, data)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)

    @property
    def time(self) -> float:
        """Time of the simulation [s]."""
        return float(self.data.time)

    def water_velocity(self) -> Floats:
        """Velocity of the water at the vehicles' origins, in the world, shape (v, 3), [m/s]."""
        out = np.empty((len(self.names), 3))
        water_velocity(self.pose[:, :3], self.time, self.ocean.water, out)
        return out

    def step(self, command: Floats, n_substeps: int = 1) -> None:
        """Advance by `n_substeps` physics steps under constant commands, shape (v, m), in the units of the states.

        Raises:
            ValueError: the command has the wrong shape.
            PlantError: the state or a command is not finite, a vehicle is faster than any can be, or MuJoCo warns.
        """
        if command.shape != self.thrust.shape:
            raise ValueError(f"command has shape {command.shape}, expected {self.thrust.shape}")
        given = np.ascontiguousarray(command, dtype=np.float64)
        self.finish_step(stepping.advance(self.step_handles(), given, n_substeps))

    def step_handles(self) -> Any:
        """Arguments of `stepping.advance`, at the present time."""
        self._clock[0] = self.data.time
        return self._calls, self._clock, self._body, self._loads

    def finish_step(self, fault: Fault) -> None:
        """Bring the sites to where the vehicles are after `stepping.advance`; PlantError if an error ended it."""
        what, which = fault
        if what == stepping.WARNED:
            self._fail(f"MuJoCo warns: {mujoco.mjtWarning(which).name}")
        if what == stepping.NOT_FINITE:
            self._fail(f"the command of {self.names[which]} is not finite")
        if what == stepping.LOST:
            self._fail(f"the state of {self.names[which]} is lost")
        mujoco.mj_kinematics(self.model, self.data)

    def _fail(self, what: str) -> NoReturn:
        message = f"t = {self.time:.3f} s: {what}; last good pose and twist by vehicle:"
        for name, pose, twist in zip(self.names, self._last_pose, self._last_twist, strict=True):
            message += f"\n  {name}: {np.array2string(pose, precision=4)} {np.array2string(twist, precision=4)}"
        raise PlantError(message)
