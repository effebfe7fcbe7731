"""What a closed loop of followers on stations costs, beside the bare solver of the same vehicles."""

from functools import partial

import mujoco

from experiments.benchmarks.row import Row, least_time
from experiments.flight.library import load
from experiments.flight.swarm import simulate_swarm, swarm_of
from sim.assembly import ocean_of, routes_of, setups_of
from sim.fleet import simulate_fleet
from sim.scenario.settings import Scenario
from sim.vehicle.mjcf import compose
from sim.vehicle.plant import NO_CONTACT, Plant

SWARMS = {10: 400.0, 50: 100.0}
"""Followers, and how long they are flown [s]."""
AIMS = {10: 1.0, 50: 2.0}
"""How many times cheaper than the bare solver a closed loop is to be."""
_WHOLE_S = 1000.0


def swarm(followers: int, duration: float) -> Scenario:
    """A grid of followers, each in its layer where there is room for that, in a current."""
    layer = 1.0 if followers <= 20 else 0.0
    shape = f'{{ kind = "grid", count = {followers}, spacing_m = 10.0, layer_m = {layer} }}'
    return load("swarm", ("followers=[]", f"formation.shape={shape}", f"duration_s={duration}",
                          "ocean.current_speed_m_s=0.3"))  # fmt: skip


def _bare(scenario: Scenario, steps: int) -> float:
    """Seconds of a step of the solver alone."""
    spec = compose(setups_of(scenario, routes_of(scenario)), scenario.ocean.floor_depth_m)
    spec.option.timestep = scenario.timing.physics_step_s
    spec.option.disableflags |= NO_CONTACT
    model = spec.compile()
    return least_time(partial(mujoco.mj_step, model, mujoco.MjData(model), steps), 3) / steps


def _closed(scenario: Scenario) -> float:
    """Seconds of the closed loop: sensing, navigation, guidance, autopilot, physics, recording."""
    routes, ocean = routes_of(scenario), ocean_of(scenario)
    plants = [Plant(setups_of(scenario, routes), ocean, scenario.timing.physics_step_s) for _ in range(4)]
    boarding = partial(swarm_of, scenario)
    return least_time(lambda: simulate_fleet(plants.pop(), routes, scenario.duration_s, boarding=boarding), 3)


def formation() -> list[Row]:
    """A physics step of a formation in closed loop beside the bare solver; a whole run of a study."""
    rows = []
    for followers, duration in SWARMS.items():
        scenario = swarm(followers, duration)
        steps = round(duration / scenario.timing.physics_step_s)
        bare, seconds = _bare(scenario, steps), _closed(scenario)
        closed = seconds / steps
        fleet = f"leader + {followers}"
        rows += [
            Row(f"{fleet}: mj_step alone", bare * 1e6, "µs/step"),
            Row(f"{fleet}: closed loop", closed * 1e6, "µs/step", bare / closed, "mj_step"),
            Row(f"{fleet}: solver over closed loop", bare / closed, "x", bare / closed / AIMS[followers], "aim"),
            Row(f"{fleet}: real-time factor", duration / seconds, "x"),
        ]
    whole = load("swarm", (f"duration_s={_WHOLE_S}",))
    rows.append(Row(f"leader + 10: a run of {_WHOLE_S:g} s, whole", least_time(partial(simulate_swarm, whole), 2), "s"))
    return rows
