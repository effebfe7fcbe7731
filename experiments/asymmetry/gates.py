"""Echoes taken for pings, and what the gross-error gate makes of them (paper, Section 2.4)."""

from dataclasses import dataclass, replace

import numpy as np

from experiments.asymmetry.conditions import CALM, SEED, fleet
from experiments.asymmetry.missions import Plan, pair
from experiments.intervals import Interval, mean_interval, ratio_intervals
from laisn import lanes
from laisn.arrays import Bools, Floats
from laisn.estimates import FixKind
from laisn.settings import GateRule, NavigationSettings
from sim.flight import settings_as
from sim.motion import simulate_motion
from sim.sensing.echo import Path, locked_path
from sim.sensing.observation import errors_of
from sim.sensing.sensor_errors import measure

RULES: tuple[GateRule, ...] = ("off", "v-max", "v-measured")
INTERVALS_S = (1.0, 5.0)
ECHO_CHANCE = {"acoustics.surface_echo_chance": 0.05, "acoustics.bottom_echo_chance": 0.02}
"""Chances of a ping that its surface echo and its bottom echo is taken for it."""
_OFFSET_M = 2.0
_RUNS = 20


@dataclass(frozen=True, kw_only=True)
class GateRow:
    """One gate rule on one route."""

    route: str
    rule: str
    interval_s: float
    detected: Interval
    """Share of the messages with an echo in a range that counts (rear, front) that the gate rejects, and its limits."""
    false_alarms: Interval
    """Share of the other messages that it rejects, and its limits."""
    e_p_mean_m: Interval
    e_p_mean_without_echoes_m: Interval


def rates(rejected: Bools, echoed: Bools) -> tuple[Interval, Interval]:
    """Share of the messages with an echo that the gate rejects, and share of those without one.

    Messages of a run hang together, for a fix that is accepted moves the gate: limits are those over runs.

    Args:
        rejected: by message and run, shape (m, R).
        echoed: whether there is an echo in a range that counts, likewise.
    """
    of = np.column_stack([echoed.sum(axis=0), (~echoed).sum(axis=0)]).astype(np.float64)
    found = np.column_stack([(rejected & echoed).sum(axis=0), (rejected & ~echoed).sum(axis=0)]).astype(np.float64)
    detected, false_alarms = ratio_intervals(found, of)
    # a share lies between 0 and 1, which limits of few skewed runs may exceed
    detected, false_alarms = (Interval(*np.clip(interval, 0.0, 1.0).tolist()) for interval in (detected, false_alarms))
    return detected, false_alarms


def fly_gates(plan: Plan) -> list[GateRow]:
    """Fly all routes of a plan in a calm sea, LAISN-2 with each gate rule, with echoes and without."""
    trajectory = simulate_motion(fleet(CALM, plan.routes, (_OFFSET_M,), plan.duration_s))
    rows = []
    for follower, route in enumerate(plan.routes):
        flown = pair(trajectory, follower, CALM, route, _OFFSET_M)
        for interval in INTERVALS_S:
            one = flown.scenario({"timing.message_interval_s": interval, **ECHO_CHANCE})
            (motion, truth), errors = flown.real.seen(one, 0), errors_of(one)
            told = settings_as(NavigationSettings, one, motion, 0)
            runs, used = range(flown.first_run, flown.first_run + _RUNS), told.transmitters
            heard = [measure(truth, errors, seed=SEED, run=run, transmitters=used) for run in runs]
            silent = replace(errors, echo_chance=(0.0, 0.0))
            quiet = [measure(truth, silent, seed=SEED, run=run, transmitters=used) for run in runs]
            paths = np.stack([locked_path(SEED, run, 0, truth.emission_step, errors.echo_chance) for run in runs], -1)
            echoed = np.any(paths[:, :2] != int(Path.DIRECT), axis=1)
            for rule in RULES:
                settings = replace(told, gate=rule)
                result = lanes.run(heard, truth.start, settings)
                detected, false_alarms = rates(result.fix_kind[:, 0] == FixKind.GATED, echoed)

                def mean_error(state: Floats, hydrophone: Floats = truth.hydrophone) -> Interval:
                    errors = np.hypot(*(state[:, :2] - hydrophone[:, :, None]).swapaxes(0, 1))
                    return mean_interval(errors.mean(axis=0))

                rows.append(
                    GateRow(
                        route=route,
                        rule=rule,
                        interval_s=interval,
                        detected=detected,
                        false_alarms=false_alarms,
                        e_p_mean_m=mean_error(result.state),
                        e_p_mean_without_echoes_m=mean_error(lanes.run(quiet, truth.start, settings).state),
                    )
                )
    return rows
