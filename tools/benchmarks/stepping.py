"""A mission stepped from Python beside the same one in a single compiled call."""

from collections.abc import Callable

from experiments.flight.library import load_scenario
from laisn_sim.simulation import Simulation
from sim.closed_loop import closed_loop_mission
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from tools.benchmarks.row import Goal, Row, least_times

MISSIONS = {"leader + 1": "T5", "leader + 10": "swarm"}
GOALS_US = {"leader + 1": 60.0, "leader + 10": 120.0}
"""What a step from Python is to cost at most beside its work [µs]."""
_DURATION_S = 100.0
_REPEATS = 5


def _stepped(scenario: Scenario) -> Callable[[], object]:
    missions = [Simulation(scenario) for _ in range(_REPEATS + 1)]

    def step_to_the_end() -> None:
        mission = missions.pop()
        while not mission.done:
            mission.step()

    return step_to_the_end


def _in_one_call(scenario: Scenario) -> Callable[[], object]:
    missions = [closed_loop_mission(scenario) for _ in range(_REPEATS + 1)]

    def fly() -> None:
        mission = missions.pop()
        mission.advance(mission.last)

    return fly


def stepping() -> list[Row]:
    """What a step from Python costs beside its work, for each control instant of 0.1 s."""
    rows = []
    for name, source in MISSIONS.items():
        scenario = load_scenario(source, (f"duration_s={_DURATION_S}",))
        instants = round(_DURATION_S / CONTROL_STEP_S)
        works = [_stepped(scenario), _in_one_call(scenario)]
        stepped, called = (seconds / instants * 1e6 for seconds in least_times(works, _REPEATS))
        rows += [
            Row(f"{name}: control instant in one call", called, "µs"),
            Row(f"{name}: stepped from Python", stepped, "µs", called / stepped, "one call"),
            Row(
                f"{name}: cost of a step from Python",
                stepped - called,
                "µs",
                goal=Goal(GOALS_US[name]),
            ),
        ]
    return rows
