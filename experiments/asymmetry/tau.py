"""The paper's range errors read as pitch: which τ of Eq. 28 does the same harm.

Stage 4 of the paper gives one transmitter a larger uniform error, τ_rear U(0, 1), and names a leader out of trim as a
reason. Here both are flown over the same routes: a level leader with τ_rear raised, and a leader pitched by a constant
angle with τ left at 0.01 m. Two that raise the mean position error by the same amount are equivalent.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from experiments.asymmetry.conditions import CALM, fleet
from experiments.asymmetry.missions import Plan, pair
from experiments.campaign.cells import Cell
from experiments.campaign.montecarlo import simulate
from experiments.intervals import Interval, mean_over_missions
from laisn.arrays import Floats
from laisn.settings import Variant
from sim.motion import simulate_motion

TAU_M = (0.01, 0.03, 0.06, 0.1, 0.2, 0.4, 0.8, 1.6)
"""τ of the rear transmitter; the first is the paper's usual one, 0.03 and 0.06 are those of its Stage 4."""
PITCH_DEG = (0.0, -1.0, -2.0, -3.0, -5.0, -7.5, -10.0, -15.0)
"""Nose down, as excess buoyancy makes a leader swim; astern, where most followers are, the lever arm and foreshortening
then add up."""
OFFSETS_M = (2.0, 5.0, 10.0)
INTERVALS_S = (1.0, 5.0)
"""Message intervals of the paper's Stages 1 and 4."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Mean position error of a route over one quantity."""

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


@dataclass(frozen=True, kw_only=True)
class Curves:
    """All curves of the study."""

    tau: tuple[Curve, ...]
    pitch: tuple[Curve, ...]

    def tau_of(self, route: str, variant: str, interval_s: float = 1.0) -> Curve:
        """The curve over τ of a route; StopIteration if it was not flown."""
        return next(c for c in self.tau if (c.route, c.variant, c.interval_s) == (route, variant, interval_s))

    def pitch_of(self, tau: Curve, depth_offset: float) -> Curve | None:
        """The curve over pitch of the route, variant and interval of one over τ; None if it was not flown."""
        where = (tau.route, tau.variant, tau.interval_s, depth_offset)
        return next((c for c in self.pitch if (c.route, c.variant, c.interval_s, c.depth_offset_m) == where), None)

    def stage_4(self) -> list[Curve]:
        """Curves over τ of LAISN-2 with messages every 5 s, as in the paper's Stage 4."""
        return [c for c in self.tau if (c.variant, c.interval_s) == ("laisn-2", 5.0)]


def equivalent(excess: float, curve: Curve) -> float:
    """Size of the value at which a curve has that excess; NaN below zero and beyond the curve's end.

    Between the flown values the excess counts as linear; where noise makes a curve dip, its largest value so far.
    """
    grown = np.maximum.accumulate(curve.excess)
    if not 0.0 <= excess <= grown[-1]:
        return float("nan")
    return float(np.interp(excess, grown, np.abs(curve.value)))


def equivalents(curves: Curves, tau: float, depth_offset: float) -> list[float]:
    """Pitch that raises LAISN-2's mean error as a τ_rear does, messages every 5 s, route by route, [°].

    NaN where the larger τ does no harm, or more than any pitch that was flown.
    """
    pairs = [(curve, curves.pitch_of(curve, depth_offset)) for curve in curves.stage_4()]
    return [equivalent(curve.excess_at(tau).value, over) for curve, over in pairs if over]


def _curve(cells: Sequence[Cell], **key: Any) -> Curve:
    """The curve of cells of the same runs; what they share of noise drops out of the excess."""
    results = [simulate(cell, keep_runs=True) for cell in cells]
    each = [result.table.e_p_mean_m for result in results if result.table is not None]
    halves = [interval.high - interval.value for interval in (mean_over_missions([e - each[0]]) for e in each)]
    means = tuple(result.errors.e_p_mean_m for result in results)
    return Curve(**key, e_p_mean_m=means, excess_half_m=tuple(halves))


def fly_curves(plan: Plan, variants: Sequence[Variant] = ("laisn-2", "laisn-3-2")) -> Curves:
    """Fly all routes of a plan in a calm sea, over τ and over pitch."""
    offsets = tuple(o for o in OFFSETS_M if o in plan.offsets_m)
    fleets = {offset: simulate_motion(fleet(CALM, plan.routes, (offset,), plan.duration_s)) for offset in offsets}
    tau, pitch = [], []
    missions = [(follower, route, offset) for follower, route in enumerate(plan.routes) for offset in offsets]
    for follower, route, offset in missions:
        flown = pair(fleets[offset], follower, CALM, route, offset)
        runs = range(flown.first_run, flown.first_run + plan.runs)
        tilts = [flown.tilted(degrees) for degrees in PITCH_DEG]
        for interval, variant in product(INTERVALS_S, variants):
            key = {"route": route, "variant": variant, "interval_s": interval}
            told = {"timing.message_interval_s": interval, "navigation.variant": variant}
            one = flown.scenario(told)
            cells = [Cell.of(one, 0, runs, mission=tilt) for tilt in tilts]
            pitch.append(_curve(cells, **key, depth_offset_m=offset, value=PITCH_DEG))
            if offset == offsets[0]:
                widths = [[value, *one.acoustics.range_tau_m[1:]] for value in TAU_M]
                wider = [flown.scenario({**told, "acoustics.range_tau_m": width}) for width in widths]
                cells = [Cell.of(scenario, 0, runs, mission=tilts[0]) for scenario in wider]
                tau.append(_curve(cells, **key, depth_offset_m=float("nan"), value=TAU_M))
    return Curves(tau=tuple(tau), pitch=tuple(pitch))
