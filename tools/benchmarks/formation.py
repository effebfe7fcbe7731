"""What a closed loop of followers on stations costs, beside the bare solver of the same
vehicles.
"""

from collections.abc import Callable
from functools import partial

import mujoco

from experiments.flight.library import load_scenario
from sim.assembly import routes_of, setups_of
from sim.closed_loop import closed_loop_of, simulate_closed_loop
from sim.scenario.parts import MissionPlan, SeaSettings
from sim.scenario.settings import Scenario
from sim.simulation import simulate
from sim.vehicle.mjcf import compose
from sim.vehicle.mujoco_calls import NO_CONTACT
from sim.vehicle.plant import Plant
from sim.water.assembly import ocean_of
from tools.benchmarks.row import Goal, Row, least_time, least_times

SWARMS = {10: 400.0, 50: 100.0}
"""Followers, and how long they are flown [s]."""
GOALS = {10: 1.0, 50: 2.0}
"""How many times cheaper than the bare solver a closed loop is to be."""
MAX_FOLLOWERS = 200
"""Followers of the largest formation."""
LARGEST_GOAL = 60.0
"""Least real-time factor that its closed loop is to reach."""
DIRECT_GOAL = 5.0
"""How many times as many runs of a formation as MuJoCo the direct engine is to fly."""
_WHOLE_S = 1000.0  # length of the mission that is flown by each engine
_LARGEST_S = 30.0  # of that of the largest formation
_REPEATS = 4  # how often the time of each is taken


def swarm(followers: int, duration: float, *settings: str) -> Scenario:
    """A grid of followers in a current: up to 20 of them each 1 m deeper than the one before, more
    than that all at one depth.
    """
    layer_m = 1.0 if followers <= 20 else 0.0
    shape = f'{{ kind = "grid", count = {followers}, spacing_m = 10.0, layer_m = {layer_m} }}'
    return load_scenario(
        "swarm",
        (
            "followers=[]",
            f"formation.shape={shape}",
            f"duration_s={duration}",
            "ocean.current_speed_m_s=0.3",
            *settings,
        ),
    )


def _bare(scenario: Scenario) -> Callable[[], object]:
    """Steps of the solver alone."""
    spec = compose(
        setups_of(MissionPlan.of(scenario), routes_of(MissionPlan.of(scenario))),
        scenario.ocean.floor_depth_m,
    )
    spec.option.timestep = scenario.timing.physics_step_s
    spec.option.disableflags |= NO_CONTACT
    model = spec.compile()
    steps = round(scenario.duration_s / scenario.timing.physics_step_s)
    return partial(mujoco.mj_step, model, mujoco.MjData(model), steps)


def _closed(scenario: Scenario) -> Callable[[], object]:
    """The closed loop: sensing, navigation, guidance, autopilot, physics, recording."""
    routes = routes_of(MissionPlan.of(scenario))
    ocean = ocean_of(SeaSettings.of(scenario))
    plants = [
        Plant(setups_of(MissionPlan.of(scenario), routes), ocean, scenario.timing.physics_step_s)
        for _ in range(_REPEATS + 1)
    ]
    make_controller = partial(closed_loop_of, scenario, whole=False)
    return lambda: simulate(
        plants.pop(), routes, scenario.duration_s, make_controller=make_controller
    )


def formation() -> list[Row]:
    """A physics step of a formation in closed loop beside the bare solver; a whole run of a
    study.
    """
    rows = []
    for followers, duration in SWARMS.items():
        without_proximity = swarm(followers, duration)
        with_proximity = swarm(followers, duration, "formation.proximity.range_m=8")
        steps = round(duration / without_proximity.timing.physics_step_s)
        bare_s, closed_s, proximity_s = least_times(
            [_bare(without_proximity), _closed(without_proximity), _closed(with_proximity)],
            _REPEATS,
        )
        fleet = f"leader + {followers}"
        rows += [
            Row(f"{fleet}: mj_step alone", bare_s / steps * 1e6, "µs/step"),
            Row(
                f"{fleet}: closed loop",
                closed_s / steps * 1e6,
                "µs/step",
                bare_s / closed_s,
                "mj_step",
            ),
            Row(
                f"{fleet}: followers sense each other",
                proximity_s / steps * 1e6,
                "µs/step",
                bare_s / proximity_s,
                "mj_step",
            ),
            Row(
                f"{fleet}: solver over closed loop",
                bare_s / closed_s,
                "x",
                goal=Goal(GOALS[followers], at_least=True),
            ),
            Row(f"{fleet}: real-time factor", duration / closed_s, "x"),
        ]
    largest = swarm(MAX_FOLLOWERS, _LARGEST_S)
    rows.append(
        Row(
            f"leader + {MAX_FOLLOWERS}: real-time factor",
            _LARGEST_S / least_time(_closed(largest), 1),
            "x",
            goal=Goal(LARGEST_GOAL, at_least=True),
        )
    )
    return [*rows, *_whole_runs()]


def _whole_runs() -> list[Row]:
    """A run of the scenario of a leader and ten followers, by each engine (MuJoCo, and the direct
    solver in its place), as studies fly it.
    """
    by_engine = [
        partial(
            simulate_closed_loop,
            load_scenario("swarm", (f"duration_s={_WHOLE_S}", f"timing.engine={engine}")),
        )
        for engine in ("mujoco", "direct")
    ]
    mujoco, direct = least_times(by_engine, 2)
    name = f"leader + 10: a run of {_WHOLE_S:g} s"
    return [
        Row(f"{name}, whole", mujoco, "s"),
        Row(f"{name}, whole, by direct", direct, "s"),
        Row(
            "leader + 10: runs by direct over mujoco",
            mujoco / direct,
            "x",
            goal=Goal(DIRECT_GOAL, at_least=True),
        ),
    ]
