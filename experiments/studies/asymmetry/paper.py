"""What the paper has in place of pitch, in calm water: larger range errors (Stage 4).

Stage 4 gives one transmitter a larger uniform error, τ_rear U(0, 1) of Eq. 28, and names a leader out of trim as a
reason. Here both are simulated over the same routes: a level leader with τ_rear raised, and a leader pitched by a
constant angle with τ left at 0.01 m. Two that raise the mean position error by the same amount are equivalent.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.campaign.cells import Cell
from experiments.campaign.montecarlo import simulate
from experiments.intervals import Interval, mean_over_missions
from experiments.studies.asymmetry.comparison import Missions
from experiments.studies.asymmetry.design import CALM, Plan
from experiments.studies.asymmetry.missions import pair
from laisn.arrays import Floats
from sim.motion import simulate_motion

TAU_M = (0.01, 0.03, 0.06, 0.1, 0.2, 0.4, 0.8, 1.6)
"""τ of the rear transmitter; the first is the paper's usual one, 0.03 and 0.06 are those of its Stage 4."""
PITCH_DEG = (0.0, -1.0, -2.0, -3.0, -5.0, -7.5, -10.0, -15.0)
"""Nose down, as excess buoyancy makes a leader swim; astern, where most followers are, the lever arm and foreshortening
then add up."""
INTERVALS_S = (1.0, 5.0)
"""Message intervals of the paper's Stages 1 and 4."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Mean position error of LAISN-2 on a route over τ_rear, or over pitch at a depth offset."""

    route: str
    interval_s: float
    depth_offset_m: float | None
    """None for τ, which does not depend on it."""
    value: Sequence[float]
    """τ_rear [m], or pitch [°]."""
    e_p_mean_m: Sequence[float]
    excess_half_m: Sequence[float]
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

    def equivalent(self, excess: float) -> float:
        """Size of the value at which the curve has that excess; NaN below zero and beyond the curve's end.

        Between the flown values the excess counts as linear; where noise makes a curve dip, its largest value so far.
        """
        grown = np.maximum.accumulate(self.excess)
        return float(np.interp(excess, grown, np.abs(self.value))) if 0.0 <= excess <= grown[-1] else math.nan


def curve_of(cells: Mapping[float, Cell], route: str, interval_s: float, depth_offset_m: float | None = None) -> Curve:
    """The curve of cells by their values; what runs of the same number share of noise drops out of the excess."""
    results = [simulate(cell) for cell in cells.values()]
    means = [result.runs["e_p_mean_m"] for result in results]
    intervals = [mean_over_missions([mean - means[0]]) for mean in means]
    return Curve(
        route=route,
        interval_s=interval_s,
        depth_offset_m=depth_offset_m,
        value=tuple(cells),
        e_p_mean_m=tuple(result.row["e_p_mean_m"] for result in results),
        excess_half_m=tuple(interval.high - interval.value for interval in intervals),
    )


def equivalents(curves: Sequence[Curve], tau: float, depth_offset: float) -> dict[str, Interval]:
    """Pitch that raises LAISN-2's mean error as a τ_rear does, and at the limits of its excess, by route, [°].

    Messages come every 5 s, as in the paper's Stage 4. NaN: there is no excess, or more than at any pitch flown.
    """
    over_tau = {c.route: c for c in curves if c.depth_offset_m is None and c.interval_s == INTERVALS_S[1]}
    over_pitch = {c.route: c for c in curves if c.depth_offset_m == depth_offset}
    found = {}
    for route in over_tau.keys() & over_pitch.keys():
        value, low, high = over_tau[route].excess_at(tau)
        found[route] = Interval(*(over_pitch[route].equivalent(e) for e in (value, max(low, 0.0), high)))
    return dict(sorted(found.items()))


def tau_equivalent(missions: Missions, curves: Sequence[Curve]) -> float:
    """τ_rear that raises the error as pitch does, mean over missions, messages every second [m]; NaN if none does."""
    over_tau = {c.route: c for c in curves if c.depth_offset_m is None and c.interval_s == INTERVALS_S[0]}
    taus = [over_tau[m.real["route"]].equivalent(m.added) for m in missions]
    known = [tau for tau in taus if not math.isnan(tau)]
    return float(np.mean(known)) if known else math.nan


def fly_curves(plan: Plan) -> list[Curve]:
    """Simulate all routes of a plan in a calm sea: over τ, and over pitch at each depth offset but zero."""
    offsets = [offset for offset in plan.offsets_m if offset > 0.0]
    curves = []
    for offset in offsets:
        fleet = simulate_motion(CALM.fleet(plan.routes, offset, plan.duration_s))
        for follower, route in enumerate(plan.routes):
            flown = pair(fleet, follower, CALM, route, offset)
            runs, level = flown.runs(0, plan.runs), flown.tilted(0.0)
            one = flown.scenario({"timing.message_interval_s": INTERVALS_S[1]})
            tilts = {degrees: Cell.of(one, 0, runs, mission=flown.tilted(degrees)) for degrees in PITCH_DEG}
            curves.append(curve_of(tilts, route, INTERVALS_S[1], offset))
            for interval in INTERVALS_S if offset == offsets[0] else ():
                settings = {"timing.message_interval_s": interval}
                wider = {tau: {"acoustics.range_tau_m": [tau, *one.acoustics.range_tau_m[1:]]} for tau in TAU_M}
                cells = {tau: Cell.of(flown.scenario(settings | w), 0, runs, mission=level) for tau, w in wider.items()}
                curves.append(curve_of(cells, route, interval))
    return curves
