"""What a sea from files costs: a current on a grid beside one that is the same everywhere, and rays
that bend beside straight ones.
"""

from collections.abc import Callable, Sequence
from functools import partial

from experiments.flight.library import load_scenario
from sim.assembly import routes_of, setups_of
from sim.closed_loop import closed_loop_of
from sim.scenario.parts import MissionPlan, SeaSettings
from sim.scenario.settings import Scenario
from sim.simulation import simulate
from sim.vehicle.plant import Plant
from sim.water.assembly import ocean_of
from tools.benchmarks.formation import swarm
from tools.benchmarks.mission import FRONT
from tools.benchmarks.row import Goal, Row, least_times

FIELD_GOAL = 1.2
"""How many times as long a step in a current from a file may take as in a uniform one."""
REFRACTION_GOAL = 1.02
"""How many times as long a closed loop of ten may take with bent rays as with straight ones."""
DURATION_S = 400.0
_REPEATS = 6
# depth [m] and speed of sound [m/s]: a thermocline of 20 m/s about the followers
_PROFILE = [[0.0, 1480.0], [10.0, 1480.0], [20.0, 1460.0], [40.0, 1460.0]]


def _flight(scenario: Scenario, *, closed: bool) -> Callable[[], object]:
    """A mission of its own for each call: the motion, and in closed loop all else, too."""
    mission = MissionPlan.of(scenario)
    routes = routes_of(mission)
    ocean = ocean_of(SeaSettings.of(scenario))
    step_s = scenario.timing.physics_step_s
    plants = [Plant(setups_of(mission, routes), ocean, step_s) for _ in range(_REPEATS + 1)]
    if not closed:
        return lambda: simulate(plants.pop(), routes, scenario.duration_s)
    make_controller = partial(closed_loop_of, scenario, whole=False)
    return lambda: simulate(
        plants.pop(), routes, scenario.duration_s, make_controller=make_controller
    )


def _pair(
    scenarios: Sequence[Scenario], names: Sequence[str], ratio: tuple[str, float], *, closed: bool
) -> list[Row]:
    """Steps of two missions, and how many times as long the second one's take; `ratio` has the name
    and the goal of that row.
    """
    first, second = scenarios
    steps = round(first.duration_s / first.timing.physics_step_s)
    times = least_times([_flight(each, closed=closed) for each in (first, second)], _REPEATS)
    name, goal = ratio
    return [
        *(
            Row(title, seconds / steps * 1e6, "µs/step")
            for title, seconds in zip(names, times, strict=True)
        ),
        Row(name, times[1] / times[0], "x", goal=Goal(goal)),
    ]


def sea() -> list[Row]:
    """Steps in a current from a file and in a uniform one; of a formation that hears by rays
    that bend and by straight ones.
    """
    currents = [
        load_scenario("T5", (f"duration_s={DURATION_S}", setting))
        for setting in ("ocean.current_speed_m_s=0.4", f'ocean.current.file="{FRONT}"')
    ]
    profile = f"acoustics.sound_speed_profile={_PROFILE}"
    rays = [
        swarm(10, DURATION_S, profile, f'acoustics.rays="{kind}"')
        for kind in ("straight", "refracted")
    ]
    return [
        *_pair(
            currents,
            ("leader + 1, a uniform current", "leader + 1, a current from a file"),
            ("a current from a file, over a uniform one", FIELD_GOAL),
            closed=False,
        ),
        *_pair(
            rays,
            ("leader + 10: closed loop, straight rays", "leader + 10: closed loop, refracted rays"),
            ("refracted rays, over straight ones", REFRACTION_GOAL),
            closed=True,
        ),
    ]
