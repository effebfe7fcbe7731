"""Truth of a scenario: how its vehicles move, by the physics or by the paper's point motion."""

from collections.abc import Callable

from laisn.failure import LaisnError
from sim import point_fleet
from sim.assembly import ocean_of, routes_of, setups_of, vehicle_names
from sim.contact import contacts, first_touch
from sim.point_fleet import Sites
from sim.scenario.settings import Scenario
from sim.simulation import ControllerFactory, SimulationError, simulate
from sim.trajectory import Trajectory
from sim.vehicle.plant import Plant


class EndedError(LaisnError):
    """A mission that ended before its time; `trajectory` holds what was flown until then."""

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory


class DivergedError(EndedError):
    """The simulation left finite numbers."""


class ContactError(EndedError):
    """Vehicles touched, in a scenario whose missions end with that."""


def listeners(scenario: Scenario) -> list[str]:
    """Keys by which followers need what they hear to swim at all: their stations, or that they steer by estimates."""
    kept = [f"followers.{i}.station" for i, follower in enumerate(scenario.followers) if follower.station]
    return kept + [f"followers.{i}.steers_by = 'estimate'" for i, f in enumerate(scenario.followers) if f.believes]


def simulate_motion(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    make_controller: ControllerFactory | None = None,
) -> Trajectory:
    """Simulate a scenario's vehicles.

    Args:
        scenario: `motion` chooses rigid bodies in water, or point motion in still water with the same sites.
        progress: called now and then with the share that is done, 0 … 1.
        make_controller: makes another controller than that of routes; that of `sim.closed_loop` is needed if there are
            `listeners`. None: there is none.

    Raises:
        LaisnError: a route cannot be flown, the sea is impossible, or the controller that is needed is missing.
        DivergedError: the simulation left finite numbers.
        ContactError: vehicles touched, and that ends the scenario's mission.
    """
    trajectory = _simulated(scenario, progress, make_controller)
    met = contacts(trajectory) if scenario.contact == "end" else []
    if not met:
        return trajectory
    time, (one, other) = met[0]
    touched = f"at {time:g} s {one} and {other} touched, which ended the mission"
    raise ContactError(touched, trajectory.until(max(round(time / trajectory.dt), 1)))


def _simulated(
    scenario: Scenario,
    progress: Callable[[float], None] | None,
    make_controller: ControllerFactory | None,
) -> Trajectory:
    """The motion of a scenario; where contact ends its mission, it may stop soon after the first."""
    keys = listeners(scenario)
    if keys and make_controller is None:
        raise LaisnError(
            f"scenario {scenario.name!r}: {keys[0]}: its path depends on the noise of the run, so that no campaign can "
            "fly it once for all runs; use `laisn fly --run N`"
        )
    routes = routes_of(scenario)
    plant = Plant(setups_of(scenario, routes), ocean_of(scenario), scenario.timing.physics_step_s)
    if scenario.motion == "kinematic":
        sites = Sites(plant.site_names, plant.site_vehicle, plant.site_offset)
        return point_fleet.simulate_points(vehicle_names(scenario), routes, scenario.duration_s, sites=sites)
    try:
        return simulate(
            plant,
            routes,
            scenario.duration_s,
            [vehicle.depth_control for vehicle in (scenario.leader, *scenario.followers)],
            make_controller=make_controller,
            ending=first_touch if scenario.contact == "end" else None,
            progress=None if progress is None else lambda time: progress(time / scenario.duration_s),
        )
    except SimulationError as error:
        if error.trajectory is None:
            raise
        raise DivergedError(str(error), error.trajectory) from error
