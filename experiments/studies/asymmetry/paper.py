"""What the paper has in place of pitch, in calm water: larger range errors (Stage 4) and gross errors (Section 2.4).

Stage 4 gives one transmitter a larger uniform error, τ_rear U(0, 1) of Eq. 28, and names a leader out of trim as a
reason. Here both are flown over the same routes: a level leader with τ_rear raised, and a leader pitched by a constant
angle with τ left at 0.01 m. Two that raise the mean position error by the same amount are equivalent. Gross errors are
echoes taken for pings, which a gate is to reject.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from experiments.campaign.cells import Cell
from experiments.campaign.montecarlo import simulate
from experiments.intervals import Interval, mean_interval, mean_over_missions, ratio_intervals
from experiments.studies.asymmetry.conditions import CALM, SEED, Plan
from experiments.studies.asymmetry.missions import pair
from laisn import lanes
from laisn.arrays import Bools, Floats
from laisn.estimates import FixKind
from laisn.settings import GateRule, NavigationSettings, Variant
from sim.flight import settings_as
from sim.motion import simulate_motion
from sim.sensing.acoustics import Path
from sim.sensing.errors import errors_of
from sim.sensing.observation import locked_path, measure

TAU_M = (0.01, 0.03, 0.06, 0.1, 0.2, 0.4, 0.8, 1.6)
"""τ of the rear transmitter; the first is the paper's usual one, 0.03 and 0.06 are those of its Stage 4."""
PITCH_DEG = (0.0, -1.0, -2.0, -3.0, -5.0, -7.5, -10.0, -15.0)
"""Nose down, as excess buoyancy makes a leader swim; astern, where most followers are, the lever arm and foreshortening
then add up."""
OFFSETS_M = (2.0, 5.0, 10.0)
INTERVALS_S = (1.0, 5.0)
"""Message intervals of the paper's Stages 1 and 4."""
RULES: tuple[GateRule, ...] = ("off", "v-max", "v-measured")
ECHO_CHANCE = {"acoustics.surface_echo_probability": 0.05, "acoustics.bottom_echo_probability": 0.02}
"""Chances of a ping that its surface echo and its bottom echo is taken for it."""
_GATE_RUNS, _GATE_OFFSET_M = 20, 2.0
"""Runs and depth offset with echoes."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Mean position error of a route over τ_rear, or over pitch at a depth offset."""

    route: str
    variant: str
    interval_s: float
    depth_offset_m: float
    """NaN for τ, which does not depend on it."""
    value: tuple[float, ...]
    """τ_rear [m], or pitch [°]."""
    e_p_mean_m: tuple[float, ...]
    excess_half_m: tuple[float, ...]
    """Half of the 95 % interval, over runs, of the excess at each value [m]."""

    @property
    def excess(self) -> Floats:
        """Mean error above that of the first value, [m]."""
        return np.asarray(self.e_p_mean_m) - self.e_p_mean_m[0]

    def excess_at(self, value: float) -> Interval:
        """The excess at one of the values that were flown, with its interval [m]."""
        place = self.value.index(value)
        excess, half = float(self.excess[place]), self.excess_half_m[place]
        return Interval(excess, excess - half, excess + half)


def curves_of(
    curves: Sequence[Curve], interval_s: float, route: str | None = None, depth_offset: float = float("nan")
) -> list[Curve]:
    """Curves of LAISN-2 over pitch at a depth offset, or over τ without one, of one route or of all."""
    return [
        c
        for c in curves
        if (c.variant, c.interval_s) == ("laisn-2", interval_s)
        and route in (None, c.route)
        and np.array_equal(c.depth_offset_m, depth_offset, equal_nan=True)
    ]


def equivalent(excess: float, curve: Curve) -> float:
    """Size of the value at which a curve has that excess; NaN below zero and beyond the curve's end.

    Between the flown values the excess counts as linear; where noise makes a curve dip, its largest value so far.
    """
    grown = np.maximum.accumulate(curve.excess)
    if not 0.0 <= excess <= grown[-1]:
        return float("nan")
    return float(np.interp(excess, grown, np.abs(curve.value)))


def equivalents(curves: Sequence[Curve], tau: float, depth_offset: float) -> dict[str, Interval]:
    """Pitch that raises LAISN-2's mean error as a τ_rear does, and at the limits of its excess, by route, [°].

    Messages come every 5 s, as in the paper's Stage 4. NaN: there is no excess, or more than at any pitch flown.
    """
    found = {}
    for curve in curves_of(curves, 5.0):
        for over_pitch in curves_of(curves, 5.0, curve.route, depth_offset):
            value, low, high = curve.excess_at(tau)
            found[curve.route] = Interval(*(equivalent(e, over_pitch) for e in (value, max(low, 0.0), high)))
    return found


def _curve(cells: Sequence[Cell], **key: Any) -> Curve:
    """The curve of cells of the same runs; what they share of noise drops out of the excess."""
    results = [simulate(cell) for cell in cells]
    means = [result.runs["e_p_mean_m"] for result in results]
    intervals = [mean_over_missions([mean - means[0]]) for mean in means]
    return Curve(
        **key,
        e_p_mean_m=tuple(result.row["e_p_mean_m"] for result in results),
        excess_half_m=tuple(interval.high - interval.value for interval in intervals),
    )


def fly_curves(plan: Plan, variants: Sequence[Variant] = ("laisn-2", "laisn-3-2")) -> list[Curve]:
    """Fly all routes of a plan in a calm sea, over τ and over pitch."""
    offsets = tuple(o for o in OFFSETS_M if o in plan.offsets_m)
    fleets = {offset: simulate_motion(CALM.fleet(plan.routes, offset, plan.duration_s)) for offset in offsets}
    over_tau, over_pitch = [], []
    for (follower, route), offset in product(enumerate(plan.routes), offsets):
        flown = pair(fleets[offset], follower, CALM, route, offset)
        runs, tilts = flown.runs(0, plan.runs), [flown.tilted(degrees) for degrees in PITCH_DEG]
        for interval, variant in product(INTERVALS_S, variants):
            key = {"route": route, "variant": variant, "interval_s": interval}
            settings = {"timing.message_interval_s": interval, "navigation.variant": variant}
            one = flown.scenario(settings)
            cells = [Cell.of(one, 0, runs, mission=tilt) for tilt in tilts]
            over_pitch.append(_curve(cells, **key, depth_offset_m=offset, value=PITCH_DEG))
            if offset == offsets[0]:
                widths = [[value, *one.acoustics.range_tau_m[1:]] for value in TAU_M]
                wider = [flown.scenario({**settings, "acoustics.range_tau_m": width}) for width in widths]
                cells = [Cell.of(scenario, 0, runs, mission=tilts[0]) for scenario in wider]
                over_tau.append(_curve(cells, **key, depth_offset_m=float("nan"), value=TAU_M))
    return [*over_tau, *over_pitch]


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


def rates(rejected: Bools, echoed: Bools) -> list[Interval]:
    """Share of the messages with an echo that the gate rejects, and share of those without one.

    Messages of a run hang together, for a fix that is accepted moves the gate: limits are those over runs.

    Args:
        rejected: by message and run, shape (m, R).
        echoed: whether there is an echo in a range that counts, likewise.
    """
    of = np.column_stack([echoed.sum(axis=0), (~echoed).sum(axis=0)]).astype(np.float64)
    found = np.column_stack([(rejected & echoed).sum(axis=0), (rejected & ~echoed).sum(axis=0)]).astype(np.float64)
    # a share lies between 0 and 1, which limits of few skewed runs may exceed
    return [Interval(*np.clip(interval, 0.0, 1.0).tolist()) for interval in ratio_intervals(found, of)]


def fly_gates(plan: Plan) -> list[GateRow]:
    """Fly all routes of a plan in a calm sea, LAISN-2 with each gate rule, with echoes and without."""
    trajectory = simulate_motion(CALM.fleet(plan.routes, _GATE_OFFSET_M, plan.duration_s))
    rows = []
    for (follower, route), interval in product(enumerate(plan.routes), INTERVALS_S):
        flown = pair(trajectory, follower, CALM, route, _GATE_OFFSET_M)
        one = flown.scenario({"timing.message_interval_s": interval, **ECHO_CHANCE})
        (motion, truth), errors = flown.real.seen(one, 0), errors_of(one)
        settings = settings_as(NavigationSettings, one, motion, 0)
        runs, used = flown.runs(0, _GATE_RUNS), settings.transmitters
        silent = errors._replace(surface_echo_probability=0.0, bottom_echo_probability=0.0)
        received, quiet = (
            [measure(truth, these, seed=SEED, run=run, transmitters=used) for run in runs] for these in (errors, silent)
        )
        paths = np.stack([locked_path(SEED, run, 0, truth.emission_step, errors) for run in runs], -1)
        echoed = np.any(paths[:, :2] != int(Path.DIRECT), axis=1)

        def mean_error(state: Floats, hydrophone: Floats = truth.hydrophone) -> Interval:
            return mean_interval(np.hypot(*(state[:, :2] - hydrophone[:, :, None]).swapaxes(0, 1)).mean(axis=0))

        for rule in RULES:
            ruled = replace(settings, gate=rule)
            result = lanes.run(received, truth.start, ruled)
            detected, false_alarms = rates(result.fix_kind[:, 0] == FixKind.GATED, echoed)
            rows.append(
                GateRow(
                    route=route,
                    rule=rule,
                    interval_s=interval,
                    detected=detected,
                    false_alarms=false_alarms,
                    e_p_mean_m=mean_error(result.state),
                    e_p_mean_without_echoes_m=mean_error(lanes.run(quiet, truth.start, ruled).state),
                )
            )
    return rows
