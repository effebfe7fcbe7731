"""The results of a flight in sentences: numbers computed here, prose in `flight_text.md.j2`."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.flight.events import approach_events, route_events
from experiments.flight.range_budget import LABELS, Cause, RangeErrorBudget, range_error_budget
from experiments.flight.summary import true_bearing
from experiments.pages.flight_figures import ON_AXIS_DEG, SIGMAS
from experiments.pages.template import paragraphs
from laisn.arrays import Bools, Floats
from laisn.estimates import FixKind
from laisn.metrics import longest_mirror_lock, nees
from sim.flight import Flight
from sim.sensing.proximity import sightings
from sim.station_keeping import closest_approaches, off_station, station_keeping

SIDE_M = 1.0
"""Least distance of estimate and truth from the leader's axis, on opposite sides, at which the side is wrong [m]."""
CONSISTENT_SHARE = float(np.exp(-(SIGMAS**2) / 2))
"""Share of errors outside the 2σ ellipse of a consistent filter (Rayleigh distribution)."""
_RARE = 0.02
"""Mean errors are reported of shares of the time from this on."""
_FIXES = {
    FixKind.TWO_POINTS: "chose between two points",
    FixKind.TANGENT: "lay where the circles touch",
    FixKind.ASTERN: "were put on the leader's axis",
    FixKind.FUSED: "were weighted means",
    FixKind.GATED: "were rejected",
    FixKind.SINGULAR: "were skipped",
    FixKind.LOST: "failed because ranges were lost",
    FixKind.ONE_RANGE: "used one range alone",
    FixKind.RANGES: "used all ranges directly",
    FixKind.PARTLY: "excluded ranges identified as echoes",
}


class EstimateErrors(NamedTuple):
    """One follower's estimate compared with the truth, at the n filter steps with an estimate; arrays of shape (n,).

    Attributes:
        time: [s].
        error: E_P [m].
        bearing: B, in [0, 2π) [rad].
        distance: horizontal distance from the leader [m].
        wrong_side: whether the estimate is on the wrong side of the leader's axis.
        outside: whether the truth is outside the filter's own 2σ ellipse.
        kind: kind of each fix, shape (f,).
    """

    time: Floats
    error: Floats
    bearing: Floats
    distance: Floats
    wrong_side: Bools
    outside: Bools
    kind: Floats

    @property
    def on_axis(self) -> Bools:
        """Whether the follower is near the leader's axis, ahead or astern."""
        folded = np.mod(self.bearing, np.pi)
        return np.asarray(np.minimum(folded, np.pi - folded) < np.radians(ON_AXIS_DEG))


def estimate_errors(flight: Flight, follower: int) -> EstimateErrors:
    """Errors of a follower's estimate, and its true place relative to the leader."""
    steps, found = flight.step_index(), flight.estimates[follower]
    truth, leader = flight.hydrophone(follower)[:, :2], flight.trajectory.position[steps, 0, :2]
    heading = flight.trajectory.heading[steps, 0]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    estimate = found.state[:, :2]
    side, estimated_side = (np.einsum("ni,ni->n", point - leader, starboard) for point in (truth, estimate))
    clear = np.minimum(np.abs(side), np.abs(estimated_side)) >= SIDE_M
    square, error = nees(found, truth), np.hypot(*(estimate - truth).T)
    # with an unknown start there is no estimate before the first messages
    known = np.isfinite(error)
    return EstimateErrors(
        time=flight.trajectory.time[steps][known],
        error=error[known],
        bearing=true_bearing(flight, follower)[known],
        distance=np.hypot(*(truth - leader).T)[known],
        wrong_side=(clear & (side * estimated_side < 0))[known],
        # with a singular covariance any error is outside
        outside=np.where(np.isnan(square), np.any(estimate != truth, axis=1), square > SIGMAS**2)[known],
        kind=found.fix_kind.astype(np.float64),
    )


def errors_by_name(flight: Flight) -> dict[str, EstimateErrors]:
    """Errors of all followers; none if an estimate is not finite."""
    if not all(np.isfinite(e.state[e.unknown :]).all() for e in flight.estimates):
        return {}
    return {name: estimate_errors(flight, i) for i, name in enumerate(flight.trajectory.names[1:])}


def percent(share: float) -> str:
    """A share in per cent, without decimals from 10 % on; only exact shares are 0 % or 100 %."""
    if 0 < share < 0.001:
        return "less than 0.1\N{NO-BREAK SPACE}%"
    if 0.999 < share < 1:
        return "more than 99.9\N{NO-BREAK SPACE}%"
    return f"{100 * share:.{0 if share >= 0.0995 else 1}f}\N{NO-BREAK SPACE}%"


def _metres(value: float) -> str:
    return f"{value:.{2 if value < 9.995 else 1}f}\N{NO-BREAK SPACE}m"


def size_numbers(errors: Mapping[str, EstimateErrors]) -> dict[str, Any]:
    """Mean errors of the best and the worst follower, and the largest error with its time and place."""
    means = {name: float(one.error.mean()) for name, one in errors.items()}
    best, worst = min(means, key=means.__getitem__), max(means, key=means.__getitem__)
    name, one = max(errors.items(), key=lambda item: float(item[1].error.max()))
    k = int(one.error.argmax())
    return {
        "followers": len(errors), "several": len(errors) > 1, "best": best, "worst": worst,
        "least_mean": means[best], "greatest_mean": means[worst], "largest": float(one.error[k]), "largest_of": name,
        "largest_s": float(one.time[k]), "largest_distance": float(one.distance[k]),
        "largest_bearing_deg": float(np.degrees(one.bearing[k])),
    }  # fmt: skip


def error_numbers(one: EstimateErrors) -> dict[str, Any]:
    """Time near the leader's axis, kinds of fix, time on the wrong side, and time outside the 2σ ellipse."""
    near, on_axis = one.on_axis, float(one.on_axis.mean())
    split = _RARE <= on_axis <= 1 - _RARE
    kinds, counts = np.unique(one.kind, return_counts=True)
    order, wrong = np.argsort(-counts, kind="stable"), bool(one.wrong_side.any())
    step = float(one.time[1] - one.time[0] if one.time.size > 1 else one.time[0])
    return {
        "axis_deg": f"{ON_AXIS_DEG:g}", "on_axis": on_axis,
        "error_on_axis": float(one.error[near].mean()) if split else None,
        "error_off_axis": float(one.error[~near].mean()) if split else None,
        "fixes": one.kind.size,
        "kinds": [f"{percent(float(counts[i]) / one.kind.size)} {_FIXES[FixKind(int(kinds[i]))]}" for i in order],
        "side_m": f"{SIDE_M:g}", "wrong_side": float(one.wrong_side.mean()),
        "wrong_first_s": float(one.time[int(one.wrong_side.argmax())]) if wrong else None,
        "wrong_longest_s": longest_mirror_lock(one.wrong_side) * step if wrong else None,
        "outside": float(one.outside.mean()), "consistent_outside": CONSISTENT_SHARE,
    }  # fmt: skip


def motion_numbers(flight: Flight) -> dict[str, Any]:
    """Unusual events, station errors from the smallest, closest approaches, and followers that gave way."""
    truth = flight.trajectory
    off, spent = off_station(flight.scenario, truth), sightings(flight.scenario, truth).spent_s
    kept = {
        truth.names[i + 1]: station_keeping(off[:, i], truth.time)
        for i, follower in enumerate(flight.scenario.followers)
        if follower.station
    }
    nearest, level = closest_approaches(truth)
    found = [*route_events(flight), *approach_events(flight)]
    return {
        "events": [f"at {event.time_s:.0f} s {event.text}" for event in found],
        "stations": sorted(({"name": n, "rms": k.station_rms_m} for n, k in kept.items()), key=lambda s: s["rms"]),
        "lost": [name for name, keeping in kept.items() if keeping.lost],
        "nearest": nearest, "nearest_level": level, "giving_way": int(np.count_nonzero(spent)) if kept else 0,
        "gave_way_longest": truth.names[int(spent.argmax()) + 1], "gave_way_s": float(spent.max()),
    }  # fmt: skip


def cause_numbers(budgets: Sequence[RangeErrorBudget]) -> dict[str, Any]:
    """RMS error of D_front − D_rear, and its largest cause; None where there is no error."""
    apart = np.concatenate([budget.asymmetry for budget in budgets])
    there = apart[np.isfinite(apart).all(axis=1)]
    rms = np.sqrt(np.mean(there**2, axis=0)) if there.size else np.zeros(len(Cause))
    most = Cause(int(rms.argmax()))
    if not rms[most]:
        return {"asymmetry_cm": None}
    whole = float(np.sqrt(np.mean(there.sum(axis=1) ** 2)))
    return {"asymmetry_cm": 100 * whole, "cause": LABELS[most], "cause_cm": 100 * float(rms[most])}


def sentences(flight: Flight, errors: Mapping[str, EstimateErrors] | None = None) -> list[str]:
    """Paragraphs on errors, events, stations, geometry, fixes, side, consistency and range errors of all followers.

    Args:
        flight: as flown.
        errors: as of `errors_by_name`; None: they are computed here. Without errors there is no paragraph.
    """
    errors = errors_by_name(flight) if errors is None else errors
    if not errors:
        return []
    together = EstimateErrors(*(np.concatenate(parts) for parts in zip(*errors.values(), strict=True)))
    budgets = [range_error_budget(flight, i) for i in range(len(errors))]
    numbers = size_numbers(errors) | motion_numbers(flight) | error_numbers(together) | cause_numbers(budgets)
    return paragraphs("experiments.pages", "flight_text.md.j2", numbers, {"m": _metres, "percent": percent})
