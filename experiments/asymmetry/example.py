"""One flight of the study, looked at message by message: what the report and the film show."""

from dataclasses import dataclass

import numpy as np

from experiments.asymmetry.conditions import Condition, scenario
from experiments.flight.range_budget import RangeErrorBudget, range_error_budget
from sim.flight import Flight, navigate
from sim.motion import simulate_motion

ROUTE, OFFSET_M = "T6", 10.0
"""Close by on the quarter and far below: where pitch does much and is easy to see."""
EVERYTHING = {
    "acoustics.travel_time": True,
    "acoustics.ping_slot_s": 0.1,
    "acoustics.sound_speed_bias_m_s": 3.0,
    "acoustics.clock_offset_s": 1e-4,
    "sensors.depth_sigma_m": 0.05,
    "sensors.leader_depth_sigma_m": 0.05,
}
"""Settings of the error budget: all causes at work at once. 0.1 ms is 15 cm."""


@dataclass(frozen=True, kw_only=True)
class Example:
    """A flight with the paper's acoustics, and the range errors of the same motion with every cause at work."""

    condition: Condition
    flight: Flight
    budget: RangeErrorBudget
    telling: int
    """Recorded point of a message that shows the matter well: a large pitch at a short range."""


def fly_example(condition: Condition, duration: float) -> Example:
    """Fly a condition with one follower, and take its range errors apart."""
    one = scenario(condition, ROUTE, OFFSET_M, duration)
    trajectory = simulate_motion(one)
    flight = navigate(one, trajectory)
    everything = scenario(condition, ROUTE, OFFSET_M, duration, EVERYTHING)
    away = trajectory.position[:, 1, :2] - trajectory.position[:, 0, :2]
    pings = flight.measurements[0].message_step * flight.stride
    return Example(
        condition=condition,
        flight=flight,
        budget=range_error_budget(navigate(everything, trajectory)),
        telling=int(pings[np.argmax(np.abs(trajectory.pitch[pings, 0]) / np.hypot(*away[pings].T))]),
    )
