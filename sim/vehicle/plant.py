"""The plant: vehicles in the ocean, stepped by MuJoCo, or by another solver of their equations of
motion, with the water's forces. Users see vehicles, not qpos.

A physics step is compiled code, which calls MuJoCo's C functions by their addresses in the library
of the `mujoco` package, with the water's forces in their middle; from Python a call costs more than
its work on two hulls. `sim.vehicle.solvers` has these calls, and the solver in their place.

A step itself is in `sim.vehicle.stepping`. With the solver "direct" vehicles that differ in numbers
alone move side by side (`sim.vehicle.lanes`).
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple, NoReturn, Self, SupportsIndex, TypeVar

import mujoco
import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.held import refuse_copy
from laisn.plugins import PluginError, plugins_version
from sim import attitude
from sim.vehicle import effectors, mjcf
from sim.vehicle.effector_kinds import BUILT_IN, HullFlow
from sim.vehicle.effectors import Fitted
from sim.vehicle.lanes import FleetHandles, fleet_handles
from sim.vehicle.mjcf import VehicleIds, VehicleSetup, compose, resolve, text_of
from sim.vehicle.mujoco_calls import NO_CONTACT, NO_FORCES, calls_of
from sim.vehicle.solvers import DirectSolver, Engine, MujocoSolver, Room, bodies_of
from sim.vehicle.stepping import (
    DIVERGED,
    MUJOCO_WARNING,
    NONFINITE_COMMAND,
    OK,
    Fault,
    StepHandles,
    run_steps,
)
from sim.water.ocean import Ocean


class PlantState(NamedTuple):
    """State of v vehicles."""

    pose: Floats  # position [m] and quaternion (w, x, y, z), shape (v, 7)
    # velocity in the world [m/s] and angular velocity in the body [rad/s], shape (v, 6)
    twist: Floats
    effector_states: Floats  # states of the effectors, shape (v, m)


@dataclass(frozen=True, kw_only=True)
class _Hull:
    """A hull at the origin, and all that its MJCF takes of its setup."""

    values: tuple[object, ...]
    setup: VehicleSetup = field(compare=False)

    @classmethod
    def of(cls, setup: VehicleSetup) -> Self:
        settings = setup.settings
        values = (
            setup.name,
            text_of(setup.model),
            settings.cg_offset_x_m,
            settings.cg_offset_z_m,
            settings.excess_buoyancy_n,
            settings.trim,
            settings.hydrophone_m,
            tuple(setup.transmitters.items()),
        )
        at_origin = replace(setup, position_m=(0.0, 0.0, 0.0), heading_rad=0.0)
        return cls(values=values, setup=at_origin)


class _Sites(NamedTuple):
    """All sites of a model, as of `Plant`; arrays are read-only."""

    names: tuple[str, ...]
    vehicle: Ints
    offset: Floats


class _Fleet(NamedTuple):
    """Vehicles as MuJoCo has compiled them, all at the origin, and what is read of them."""

    model: mujoco.MjModel
    vehicles: list[VehicleIds]
    effectors: npt.NDArray[np.void]  # read-only, as of `Plant`
    fixed_fins: npt.NDArray[np.void]
    sites: _Sites
    coefficients: dict[tuple[float, ...], npt.NDArray[np.void]]
    """Those of the MJCF by the densities in which buoyancies hold [kg/m³], as far as they were
    read.
    """
    designs: dict[Any, npt.NDArray[np.void]]  # as of `Plant.kept_design`
    true_effectors: dict[tuple[tuple[float, float], ...], npt.NDArray[np.void]]
    """As of `Plant`, by the scales of thrust and lift of each vehicle."""
    bodies: dict[bytes, npt.NDArray[np.void]]  # as of `Plant`, by the vehicles' added masses
    placed: dict[Any, mujoco.MjModel]
    """Models with the vehicles at their starts, for plants that are not settled; these only read
    them.
    """

    def coefficients_in(
        self, names: Sequence[str], densities: tuple[float, ...]
    ) -> npt.NDArray[np.void]:
        """Coefficients of the MJCF, records of `mjcf.COEFFICIENTS`, shape (v,)."""
        return _kept(
            self.coefficients,
            densities,
            lambda: mjcf.read_coefficients(self.model, names, densities),
        )

    def true_effectors_of(self, setups: Sequence[VehicleSetup]) -> npt.NDArray[np.void]:
        """Effectors and fixed fins with the setups' scales of thrust and lift, as of `Plant`."""
        settings = [setup.settings for setup in setups]
        scales = tuple((each.thrust_scale, each.lift_scale) for each in settings)
        nominal = np.concatenate([self.effectors, self.fixed_fins], axis=1)
        return _kept(self.true_effectors, scales, lambda: effectors.scaled_records(nominal, setups))

    def bodies_with(
        self, names: Sequence[str], true_coefficients: npt.NDArray[np.void]
    ) -> npt.NDArray[np.void]:
        """Inertia of the vehicles, as of `Plant.bodies`."""
        added_mass = true_coefficients["added_mass"].tobytes()
        return _kept(
            self.bodies, added_mass, lambda: bodies_of(self.model, names, true_coefficients)
        )

    def placed_at(self, setups: Sequence[VehicleSetup]) -> mujoco.MjModel:
        """The model of `_at_start` that plants which are not settled share."""
        starts = tuple((setup.position_m, setup.heading_rad) for setup in setups)
        return _kept(self.placed, starts, lambda: _at_start(self.model, setups), _MOST_MODELS)


_MOST_KEPT = 64  # largest number of entries that each of the dictionaries of a fleet has
_MOST_MODELS = 8  # the same of `placed`


Made = TypeVar("Made")


def _kept(
    values: dict[Any, Made], key: Any, make: Callable[[], Made], most: int = _MOST_KEPT
) -> Made:
    """The value of a key; one that is new is made and kept, beside fewer than `most` others."""
    if key not in values:
        if len(values) >= most:
            values.clear()
        values[key] = make()
    return values[key]


# of a study's missions, most differ in places and scales alone; to compile takes most of the time
@lru_cache(maxsize=8)
def _compiled_fleet(
    hulls: tuple[_Hull, ...], floor_depth_m: float | None, dt: float, _plugins: str
) -> _Fleet:
    """See `_fleet_of`; `_plugins`, the version of plugins, is only a key of the cache."""
    spec = compose([hull.setup for hull in hulls], floor_depth_m, with_geoms=False)
    spec.option.timestep = dt
    spec.option.disableflags |= NO_CONTACT | NO_FORCES
    model = spec.compile()
    vehicles = resolve(model, [hull.setup.name for hull in hulls])
    actuated = effectors.read(model, vehicles)
    fixed_fins = effectors.read_fixed(model, vehicles)
    actuated.flags.writeable = fixed_fins.flags.writeable = False
    return _Fleet(
        model=model,
        vehicles=vehicles,
        effectors=actuated,
        fixed_fins=fixed_fins,
        sites=_sites_of(model, vehicles),
        coefficients={},
        designs={},
        true_effectors={},
        bodies={},
        placed={},
    )


def _sites_of(model: mujoco.MjModel, vehicles: Sequence[VehicleIds]) -> _Sites:
    bodies = [vehicle.body for vehicle in vehicles]
    carriers = np.array([bodies.index(body) for body in model.site_bodyid], dtype=np.int64)
    offsets = model.site_pos.copy()
    carriers.flags.writeable = offsets.flags.writeable = False
    return _Sites(tuple(model.site(i).name for i in range(model.nsite)), carriers, offsets)


def _fleet_of(setups: Sequence[VehicleSetup], floor_depth_m: float | None, dt: float) -> _Fleet:
    """The vehicles of setups; their effectors may be of plugins, which may change."""
    hulls = tuple(_Hull.of(setup) for setup in setups)
    return _compiled_fleet(hulls, floor_depth_m, dt, plugins_version(refresh=False))


def _at_start(model: mujoco.MjModel, setups: Sequence[VehicleSetup]) -> mujoco.MjModel:
    """A copy of a model in which the vehicles are where their setups have them."""
    placed = copy(model)
    starts = placed.qpos0.reshape(len(setups), 7)
    for start, setup in zip(starts, setups, strict=True):
        # no zero has a minus, as where MuJoCo's compiler adds the place of a frame
        start[:3] = np.add(setup.position_m, 0.0)
        start[3:] = attitude.from_euler(setup.heading_rad) + 0.0
        body = placed.body(f"{setup.name}/hull").id
        placed.body_pos[body] = start[:3]
        placed.body_quat[body] = start[3:]
    placed.qpos_spring[:] = placed.qpos0
    return placed


class _Start:
    """The state of a plant that is never stepped, in place of MuJoCo's data, which take longer to
    make than all else of such a plant.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.qpos: Floats = model.qpos0.copy()
        self.qvel: Floats = np.zeros(model.nv)
        self.qacc: Floats = np.zeros(model.nv)
        self.warning = SimpleNamespace(number=np.zeros(0, dtype=np.int64))
        self.time = 0.0


class PlantError(LaisnError):
    """A simulation that cannot continue; the text has vehicle, time and the last valid state."""


class Plant:
    """Owns the compiled model and its state, and steps it to second order.

    Attributes:
        dt: physics step [s].
        names: of the vehicles, shape (v,).
        pose: position [m] and quaternion (w, x, y, z), shape (v, 7); a view that follows the state,
            as the next.
        twist: velocity of the origin in the world [m/s] and angular velocity in the body [rad/s],
            shape (v, 6).
        effector_states: of all vehicles, shape (v, m): thrust [N], revolutions per second,
            deflection [rad], …
        state: pose, twist and states of the effectors, for compiled code.
        effectors, fixed_fins: records of `sim.vehicle.effector_kinds.EFFECTOR`, shapes (v, m) and
            (v, q), zero beyond a vehicle's own; `true_effectors` has both, with the setups' scales.
        kinds: of the effectors, for compiled code.
        coefficients: hydrodynamic coefficients of the MJCF, records of COEFFICIENTS, shape (v,);
            `true_coefficients` are these with the setups' scales.
        effector_names: names of each vehicle's own.
        site_names, site_vehicle, site_offset: "vehicle/site" of all sites, shape (s,), index of the
            vehicle that carries it, and place in its body frame, shape (s, 3), [m]; read-only.
        response: share of the effectors' lags that passes in a step, shape (v, m).
        model, data: MuJoCo's own, without geoms of the vehicles; `data` of a plant that is not
            settled is its state alone.
    """

    def __init__(
        self,
        setups: Sequence[VehicleSetup],
        ocean: Ocean,
        dt: float = 0.02,
        engine: Engine = "mujoco",
        *,
        settled: bool = True,
    ) -> None:
        """Compose and compile the model; LaisnError if the setups or the models' coefficients
        are invalid, or the engine "direct" cannot solve for their motion.

        A plant that is not `settled` lacks the accelerations of its start, and cannot be stepped.
        """
        fleet = _fleet_of(setups, ocean.floor_depth_m, dt)
        self.ocean = ocean
        self.dt = dt
        self.setups = tuple(setups)
        self.names = tuple(s.name for s in setups)
        model = _at_start(fleet.model, setups) if settled else fleet.placed_at(setups)
        self.model = model
        self.data: Any = mujoco.MjData(model) if settled else _Start(model)
        data = self.data

        n = len(setups)
        vehicles = fleet.vehicles
        self.pose: Floats = data.qpos.reshape(n, 7)
        self.twist: Floats = data.qvel.reshape(n, 6)
        self.effectors = fleet.effectors
        self.fixed_fins = fleet.fixed_fins
        self.effector_names = tuple(v.effectors for v in vehicles)
        self.effector_states: Floats = np.zeros(self.effectors.shape)
        self.state = PlantState(self.pose, self.twist, self.effector_states)
        self._acceleration: Floats = data.qacc.reshape(n, 6)
        self._last_pose = np.empty((n, 7))
        self._last_twist = np.empty((n, 6))
        self._fleet = fleet
        self._densities = tuple(ocean.trim_density(-setup.position_m[2]) for setup in setups)
        self.coefficients = fleet.coefficients_in(self.names, self._densities)
        self.true_coefficients = mjcf.scaled_coefficients(self.coefficients, setups)
        self.true_effectors = fleet.true_effectors_of(setups)
        self.kinds = effectors.kinds_of(self.true_effectors)
        # records that pad a vehicle have no lag
        response = -np.expm1(-dt / np.maximum(self.effectors["lag"], 1e-9))
        self.response: Floats = response
        self._clock = np.array([0.0, dt])

        self.site_names = fleet.sites.names
        self.site_vehicle = fleet.sites.vehicle
        self.site_offset = fleet.sites.offset

        forward = np.array(attitude.rotated(self.pose[:, 3:].T, (1.0, 0.0, 0.0)))
        self.twist[:, :3] = (forward * [setup.speed_m_s for setup in setups]).T
        self._solver = self._solver_of(engine) if settled or engine == "direct" else None
        if not settled:
            self._handles: StepHandles | FleetHandles = self.handles_alone
            return
        mujoco.mj_forward(model, data)
        # the first step takes the accelerations of the start for those of a step before
        self._acceleration[:] = 0.0
        start = data.qpos.copy(), data.qvel.copy()
        self._last_pose[:], self._last_twist[:] = self.pose, self.twist
        self._handles = fleet_handles(self.handles_alone)
        self.step(np.zeros(self.effector_states.shape))
        data.qpos[:], data.qvel[:] = start
        data.time = self.effector_states[:] = 0.0
        self._last_pose[:], self._last_twist[:] = self.pose, self.twist

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """See `laisn.held.refuse_copy`."""
        refuse_copy(self)

    def _solver_of(self, engine: Engine) -> MujocoSolver | DirectSolver:
        n = len(self.names)
        if engine == "direct":
            return DirectSolver(
                bodies=self.bodies,
                pose=self.pose,
                twist=self.twist,
                acceleration=self._acceleration,
                solved=np.zeros((n, 6)),
                room=Room(np.zeros((6, 6)), np.zeros(6)),
                dt=self.dt,
            )
        return MujocoSolver(
            calls=calls_of(self.model, self.data),
            mass=self.data.M.reshape(n, 21),
            applied=self.data.qfrc_applied.reshape(n, 6),
        )

    @property
    def bodies(self) -> npt.NDArray[np.void]:
        """Inertia of the vehicles as the solver "direct" takes it, records of
        `sim.vehicle.solvers.BODY`, shape (v,).
        """
        return self._fleet.bodies_with(self.names, self.true_coefficients)

    def kept_design(
        self, settings: tuple[object, ...], make: Callable[[], npt.NDArray[np.void]]
    ) -> npt.NDArray[np.void]:
        """A controller's gains and limits, read-only records that `make` designs by these settings
        for the hulls as their MJCF has them; they are made once for plants that differ in places,
        speeds and scales alone.
        """
        return _kept(self._fleet.designs, (self._densities, settings), make)

    @property
    def sites(self) -> dict[str, Floats]:
        """Sites by their names: offsets from the origin of their hull, shape (3,), [m]."""
        return dict(zip(self.site_names, self.site_offset, strict=True))

    @property
    def time(self) -> float:
        """Time of the simulation [s]."""
        return float(self.data.time)

    def step(self, command: Floats, n_substeps: int = 1) -> None:
        """Advance by `n_substeps` physics steps under constant commands, shape (v, m), in the units
        of the states.

        PlantError if the state or a command is not finite, a vehicle is faster than any can be, or
        MuJoCo warns.
        """
        if command.shape != self.effector_states.shape:
            raise ValueError(
                f"command has shape {command.shape}, expected {self.effector_states.shape}"
            )
        commands = np.ascontiguousarray(command, dtype=np.float64)
        self.set_clock()
        fault = run_steps(self.step_handles(), commands, n_substeps)
        self.ocean.raise_custom_error()
        self.finish_step(fault)

    def set_clock(self) -> None:
        """Let steps go on from the present time."""
        self._clock[0] = self.data.time

    def step_handles(self) -> StepHandles | FleetHandles:
        """What steps work on."""
        return self._handles

    @property
    def handles_alone(self) -> StepHandles:
        """The same where each vehicle moves after the other."""
        return StepHandles(
            clock=self._clock,
            pose=self.pose,
            twist=self.twist,
            acceleration=self._acceleration,
            response=self.response,
            last_pose=self._last_pose,
            last_twist=self._last_twist,
            warnings=self.data.warning.number,
            coefficients=self.true_coefficients,
            environment=self.ocean.environment,
            solver=self._solver,
            fitted=Fitted(self.kinds, self.true_effectors, self.effector_states),
        )

    def _own_effectors_lost(self, vehicle: int) -> str:
        """The effectors of plugins of a vehicle that give no finite numbers in its present state,
        after a comma; "" if there are none.
        """
        if len(self.kinds) == len(BUILT_IN):
            return ""
        pose, twist = self.pose[vehicle], self.twist[vehicle]
        if not np.isfinite([*pose, *twist]).all():
            pose, twist = self._last_pose[vehicle], self._last_twist[vehicle]
        w, x, y, z = pose[3:].tolist()
        to_hull = (w, -x, -y, -z)
        coefficients = self.true_coefficients[vehicle]
        through_water = twist[:3] - self.ocean.velocity(pose[None, :3], self.time)[0]
        water = HullFlow(
            density=float(coefficients["density"]),
            gravity=float(coefficients["gravity"]),
            velocity=attitude.rotated(to_hull, tuple(through_water.tolist())),
            spin=tuple(twist[3:].tolist()),
            up=attitude.rotated(to_hull, (0.0, 0.0, 1.0)),
        )
        fitted = Fitted(self.kinds, self.true_effectors, self.effector_states)
        names = self.effector_names[vehicle]
        return "".join(
            f", by effector {names[j] if j < len(names) else 'of a fixed fin'} of class {text}"
            for j, text in effectors.not_finite(fitted, vehicle, water)
        )

    def finish_step(self, fault: Fault) -> None:
        """Take over the time that steps have reached; PlantError if an error ended it, PluginError
        if that was an effector of the user's own.
        """
        self.data.time = self._clock[0]
        kind, index = fault
        if kind == OK:
            return
        if kind == MUJOCO_WARNING:
            reason = f"MuJoCo warns: {mujoco.mjtWarning(index).name}"
        elif kind == NONFINITE_COMMAND:
            reason = f"the command of {self.names[index]} is not finite"
        else:
            reason = f"the state of {self.names[index]} is lost"
        by_plugins = self._own_effectors_lost(index) if kind == DIVERGED else ""
        message = (
            f"t = {self.time:.3f} s: {reason}{by_plugins}; last good pose and twist by vehicle:"
        )
        for name, pose, twist in zip(self.names, self._last_pose, self._last_twist, strict=True):
            message += (
                f"\n  {name}: {np.array2string(pose, precision=4)} "
                f"{np.array2string(twist, precision=4)}"
            )
        raise PluginError(message) if by_plugins else PlantError(message)
