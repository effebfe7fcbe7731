"""One hull alone in calm water: what checks, stations and advice need to know of it before a
flight.
"""

from functools import lru_cache
from typing import Any, NamedTuple

from laisn.plugins import kept_with_plugins
from sim.control.autopilot import Autopilot, design, top_speed
from sim.control.stability import least_radius
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Follower, Vehicle
from sim.vehicle.effector_kinds import MIN_STEERAGE_SPEED
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.assembly import trim_density
from sim.water.ocean import Ocean

HULL_KEYS = (  # keys of a vehicle, beside its model, on which its motion depends
    "depth_control",
    "roll_control",
    "cg_offset_x_m",
    "cg_offset_z_m",
    "drag_scale",
    "added_mass_scale",
    "lift_scale",
    "thrust_scale",
    "trim",
    "excess_buoyancy_n",
)
# keys of HULL_KEYS that autopilots do not know: hulls with other values of them are designed alike
SCALE_KEYS = ("drag_scale", "added_mass_scale", "lift_scale", "thrust_scale")
_UNCHANGED = Vehicle.model_construct()  # a vehicle whose keys have their defaults
_NOMINAL_SCALES = {key: getattr(_UNCHANGED, key) for key in SCALE_KEYS}
# least speed through the water of followers on stations that `needs_way` [m/s]
MIN_STATION_SPEED = 1.2 * MIN_STEERAGE_SPEED


class Hull(NamedTuple):
    """What the motion of a vehicle alone depends on."""

    settings: Vehicle  # its model, and what is changed of that
    physics_step_s: float
    density_kg_m3: float  # in which its buoyancy holds

    @property
    def as_designed(self) -> "Hull":
        """The hull for which its autopilot is designed, without scales: all that follows from the
        design alone is the same for it.
        """
        return self._replace(settings=self.settings.model_copy(update=_NOMINAL_SCALES))


class HullLimits(NamedTuple):
    """What a hull can do, by its MJCF."""

    least_radius: float  # of its planned turns [m], as of `sim.control.stability.least_radius`
    top_speed: float  # [m/s]
    least_speed: float  # that its fins need on a station; 0: it can hover [m/s]


def hull_of(motion: MotionSettings, vehicle: Vehicle) -> Hull:
    """The hull of a vehicle of a mission."""
    model = vehicle.model or ("follower" if isinstance(vehicle, Follower) else "leader")
    values = {key: getattr(vehicle, key) for key in HULL_KEYS}
    settings = _UNCHANGED.model_copy(update={"model": model, **values})
    density = trim_density(motion.sea.ocean, vehicle)
    return Hull(settings, motion.physics_step_s, density)


@lru_cache(maxsize=8)
def _calm_sea(density_kg_m3: float) -> Ocean:
    return Ocean(density_kg_m3=density_kg_m3)


@kept_with_plugins(32)
def calm_plant(hull: Hull) -> tuple[Plant, Any]:
    """A vehicle alone in calm water, as a plant with the vehicle "hull" that cannot be
    stepped (`settled` of `Plant`), and the design of its autopilot, records of shape (1,).
    """
    settings = hull.settings
    setup = VehicleSetup(
        name="hull", model=str(settings.model), position_m=(0.0, 0.0, -10.0), settings=settings
    )
    plant = Plant([setup], _calm_sea(hull.density_kg_m3), hull.physics_step_s, settled=False)
    return plant, design(plant, (settings.depth_control,))


def needs_way(autopilot: Autopilot) -> bool:
    """Whether a vehicle needs steerage way, for it cannot hover: fins alone, at an angle to the
    flow, hold its depth.
    """
    return bool(not autopilot["has_heave"] and autopilot["effectors"]["lift_area"].any())


def top_speed_of(hull: Hull) -> float:
    """Greatest speed of a hull as it is designed [m/s]; errors as of `limits_of`."""
    return _designed_top_speed(hull.as_designed)


@kept_with_plugins(64)
def _designed_top_speed(hull: Hull) -> float:
    _, autopilots = calm_plant(hull)
    return top_speed(autopilots[0])


def limits_of(hull: Hull) -> HullLimits:
    """What a hull can do as it is designed; errors are those of `sim.control.autopilot.design`."""
    return _designed_limits(hull.as_designed)


@kept_with_plugins(64)
def _designed_limits(hull: Hull) -> HullLimits:
    plant, autopilots = calm_plant(hull)
    autopilot = autopilots[0]
    return HullLimits(
        least_radius(plant, 0, autopilot),
        _designed_top_speed(hull),
        MIN_STATION_SPEED if needs_way(autopilot) else 0.0,
    )
