"""Single runs of followers that steer by their estimates: each is a flight, with results as of a run of a cell."""

import numpy as np

from experiments.campaign.store import CampaignError, Record
from experiments.flight.fly import fly
from experiments.flight.summary import position_and_bearing_errors
from experiments.study.facts import facts_of
from laisn import metrics
from sim.flight import Flight, Outcome
from sim.scenario.settings import Scenario


def is_captured(flight: Flight, follower: int) -> bool:
    """Whether an estimate was at the mirror image of the truth for a message interval, as cells say it of runs."""
    steps = flight.step_index()
    leader, heading = flight.trajectory.position[steps, 0, :2], flight.trajectory.heading[steps, 0]
    estimate, truth = flight.estimates[follower].state[:, :2], flight.hydrophone(follower)[:, :2]
    captured = np.concatenate([[False], metrics.captured_steps(estimate, truth, leader, heading), [False]])
    first, after = np.flatnonzero(np.diff(captured.astype(np.int8))).reshape(-1, 2).T
    return bool(first.size and np.max(after - first) >= flight.scenario.message_every)


_OF_ENDED = ("run", "touched", "ended")


def records_of_run(scenario: Scenario, run: int) -> list[Record]:
    """Results of a run for each follower, by the names of a cell's lists and of `FACTS`.

    A run that contact ended has no other results than that: a mean over missions of unlike length would hide it.

    Raises CampaignError if the simulation left finite numbers.
    """
    one = scenario.model_copy(update={"run": run})
    flight, _ = fly(one)
    ended = flight.outcome is Outcome.CONTACT
    if not ended and flight.outcome is not Outcome.COMPLETED:
        raise CampaignError(f"run {run}: {flight.outcome.value}")
    facts, rows = facts_of(one, flight.trajectory), []
    for i, (position, bearing) in enumerate(position_and_bearing_errors(flight)):
        degrees = np.rad2deg(bearing)
        rows.append(
            {
                "run": run,
                "e_p_max_m": float(position.max()),
                "e_p_mean_m": float(position.mean()),
                "e_b_max_deg": float(degrees.max()),
                "e_b_mean_deg": float(degrees.mean()),
                "captured": is_captured(flight, i),
                "gated": int(metrics.fix_counts(flight.estimates[i]).get("gated", 0)),
                **facts[i],
                "ended": ended,
            }
        )
        if ended:
            rows[i] = {name: value if name in _OF_ENDED else None for name, value in rows[i].items()}
    return rows
