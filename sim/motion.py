"""Truth of a scenario: how its vehicles move, by the physics or by the paper's point motion."""

from collections.abc import Callable

from laisn.failure import LaisnError
from laisn.navigating import NavigatorFactory
from sim import point_fleet
from sim.assembly import ocean_of, routes_of, setups_of, vehicle_names
from sim.closed_loop import Feedback
from sim.fleet import FleetError, simulate_fleet
from sim.point_fleet import Sites
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory
from sim.vehicle.plant import Plant


class DivergedError(LaisnError):
    """The simulation left finite numbers; `trajectory` holds what was flown before."""

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory


def _feedback(scenario: Scenario, navigator: NavigatorFactory | None) -> Feedback | None:
    steering = [i for i, follower in enumerate(scenario.followers) if follower.steers_by == "estimate"]
    if steering and navigator is None:
        raise LaisnError(
            f"scenario {scenario.name!r}: followers.{steering[0]}.steers_by = 'estimate': its path depends on the "
            "noise of the run, so that no campaign can fly it once for all runs; use `laisn fly --run N`"
        )
    return Feedback(scenario, navigator) if steering and navigator is not None else None


def simulate_motion(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    navigator: NavigatorFactory | None = None,
) -> Trajectory:
    """Fly a scenario's vehicles along their routes.

    Args:
        scenario: `motion` chooses rigid bodies in water, or point motion in still water with the same sites.
        progress: called now and then with the share that is done, 0 … 1.
        navigator: makes the navigators of followers that steer by their own estimates.

    Raises:
        LaisnError: a route cannot be flown, the sea is impossible, or a follower lacks its navigator.
        DivergedError: the simulation left finite numbers.
    """
    feedback = _feedback(scenario, navigator)
    routes = routes_of(scenario)
    plant = Plant(setups_of(scenario, routes), ocean_of(scenario), scenario.timing.physics_step_s)
    if scenario.motion == "kinematic":
        sites = Sites(plant.site_names, plant.site_vehicle, plant.site_offset)
        return point_fleet.simulate_points(vehicle_names(scenario), routes, scenario.duration_s, sites=sites)
    try:
        return simulate_fleet(
            plant,
            routes,
            scenario.duration_s,
            [vehicle.depth_control for vehicle in (scenario.leader, *scenario.followers)],
            believe=feedback,
            progress=None if progress is None else lambda time: progress(time / scenario.duration_s),
        )
    except FleetError as error:
        if error.trajectory is None:
            raise
        raise DivergedError(str(error), error.trajectory) from error
