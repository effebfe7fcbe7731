"""Single runs of followers that steer by their estimates: each is a flight, with results as of a run of a cell."""

import numpy as np

from experiments.campaign.store import CampaignError, Record
from experiments.study.facts import facts_of
from laisn import metrics
from laisn.arrays import Floats
from sim.closed_loop import simulate_closed_loop
from sim.flight import Outcome
from sim.motion import ContactError, DivergedError
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.trajectory import Trajectory


def _truth(trajectory: Trajectory, follower: int, n: int) -> tuple[Floats, Floats, Floats]:
    """A hydrophone's and the leader's positions, shape (n, 2), [m], and its heading [rad], at n filter steps."""
    stride = (trajectory.time.size - 1) // n
    steps = slice(stride, n * stride + 1, stride)
    hydrophone = trajectory.site_path(f"{trajectory.names[follower + 1]}/hydrophone")
    return hydrophone[steps, :2], trajectory.position[steps, 0, :2], trajectory.heading[steps, 0]


def _flown(scenario: Scenario) -> tuple[Trajectory, Outcome, list[Floats], list[int]]:
    """Motion of a run and its outcome, each follower's estimated positions, shape (n, 2), [m], and its gated fixes."""
    stride = round(scenario.timing.filter_step_s / CONTROL_STEP_S)
    try:
        trajectory, loop = simulate_closed_loop(scenario)
    except (ContactError, DivergedError) as error:
        outcome = Outcome.CONTACT if isinstance(error, ContactError) else Outcome.DIVERGED
        unknown = np.full(((error.trajectory.time.size - 1) // stride, 2), np.nan)
        followers = len(scenario.followers)
        return error.trajectory, outcome, [unknown] * followers, [0] * followers
    estimates = list(np.moveaxis(loop.state.history.position[stride::stride], 1, 0))
    return trajectory, Outcome.COMPLETED, estimates, loop.swarm.gated.tolist()


_OF_ENDED = ("run", "touched", "ended")


def records_of_run(scenario: Scenario, run: int) -> list[Record]:
    """Results of a run for each follower, by the names of a cell's lists and of `FACTS`.

    A run that contact ended has no other results than that: a mean over missions of unlike length would hide it.

    Raises CampaignError if the simulation left finite numbers.
    """
    one = scenario.model_copy(update={"run": run})
    trajectory, outcome, estimates, gated = _flown(one)
    ended = outcome is Outcome.CONTACT
    if not ended and outcome is not Outcome.COMPLETED:
        raise CampaignError(f"run {run}: {outcome.value}")
    facts, rows = facts_of(one, trajectory), []
    for i, estimate in enumerate(estimates):
        truth, leader, heading = _truth(trajectory, i, estimate.shape[0])
        position = metrics.position_errors(estimate, truth)
        degrees = np.rad2deg(metrics.bearing_errors(estimate, truth, leader))
        row: Record = {
            "run": run,
            "e_p_max_m": float(position.max()),
            "e_p_mean_m": float(position.mean()),
            "e_b_max_deg": float(degrees.max()),
            "e_b_mean_deg": float(degrees.mean()),
            "captured": metrics.was_captured(estimate, truth, leader, heading, one.message_every),
            "gated": gated[i],
            **facts[i],
            "ended": ended,
        }
        rows.append({name: value if not ended or name in _OF_ENDED else None for name, value in row.items()})
    return rows
