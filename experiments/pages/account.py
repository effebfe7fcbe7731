"""A flight in a few sentences, each computed from the flight, one figure in each; the first stands above all else."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from experiments.flight.range_budget import LABELS, Cause, RangeErrorBudget, range_error_budget
from experiments.flight.separation import approach_events, route_events
from experiments.flight.summary import true_bearing
from experiments.pages.flight_figures import ON_AXIS_DEG, SIGMAS
from laisn.arrays import Bools, Floats
from laisn.estimates import FixKind
from laisn.metrics import longest_capture, nees
from sim.flight import Flight
from sim.sensing.proximity import sightings
from sim.station_keeping import closest_approaches, off_station, station_keeping

SIDE_M = 1.0
"""A side is wrong where estimate and truth are at least so far from the leader's axis, on opposite sides of it [m]."""
RIGHT_SHARE = float(np.exp(-(SIGMAS**2) / 2))
"""Share of errors outside the 2σ ellipse of a filter that knows its errors (Rayleigh distribution)."""
_RARE = 0.02
"""A share of the time that is too small to speak of what happened then."""
_FIXES = {
    FixKind.TWO_POINTS: "chose between two points",
    FixKind.TANGENT: "lay where the circles touch",
    FixKind.ASTERN: "were put on the leader's axis",
    FixKind.FUSED: "were weighted means",
    FixKind.GATED: "were rejected",
    FixKind.SINGULAR: "were skipped",
    FixKind.LOST: "failed because ranges were lost",
    FixKind.ONE_RANGE: "used one range alone",
    FixKind.RANGES: "used all ranges themselves",
    FixKind.PARTLY: "left out ranges that looked like echoes",
}


class Seen(NamedTuple):
    """What became of one follower's estimate at the n filter steps at which it had one; arrays of shape (n,)."""

    time: Floats
    """[s]."""
    error: Floats
    """E_P [m]."""
    bearing: Floats
    """B, in [0, 2π) [rad]."""
    distance: Floats
    """From the leader, horizontally [m]."""
    wrong_side: Bools
    """Whether the estimate was on the wrong side of the leader's axis."""
    outside: Bools
    """Whether the truth was outside the filter's own 2σ ellipse."""
    kind: Floats
    """Kind of each fix, shape (f,)."""

    @property
    def on_axis(self) -> Bools:
        """Whether the follower was near the leader's axis, ahead or astern."""
        folded = np.mod(self.bearing, np.pi)
        return np.asarray(np.minimum(folded, np.pi - folded) < np.radians(ON_AXIS_DEG))


def seen(flight: Flight, follower: int) -> Seen:
    """How a follower was seen by the leader's transmitters, and what it made of that."""
    steps, found = flight.step_index(), flight.estimates[follower]
    truth, leader = flight.hydrophone(follower)[:, :2], flight.trajectory.position[steps, 0, :2]
    heading = flight.trajectory.heading[steps, 0]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    belief = found.state[:, :2]
    side, believed_side = (np.einsum("ni,ni->n", point - leader, starboard) for point in (truth, belief))
    clear = np.minimum(np.abs(side), np.abs(believed_side)) >= SIDE_M
    square, error = nees(found, truth), np.hypot(*(belief - truth).T)
    # who does not know its start has no estimate before the first messages
    known = np.isfinite(error)
    return Seen(
        time=flight.trajectory.time[steps][known],
        error=error[known],
        bearing=true_bearing(flight, follower)[known],
        distance=np.hypot(*(truth - leader).T)[known],
        wrong_side=(clear & (side * believed_side < 0))[known],
        # a filter that is certain is wrong wherever it is off at all
        outside=np.where(np.isnan(square), np.any(belief != truth, axis=1), square > SIGMAS**2)[known],
        kind=found.fix_kind.astype(np.float64),
    )


def percent(share: float) -> str:
    """A share in per cent: whole ones from 10 % on, and never 0 % or 100 % of what is not."""
    if 0 < share < 0.001:
        return "less than 0.1\N{NO-BREAK SPACE}%"
    if 0.999 < share < 1:
        return "more than 99.9\N{NO-BREAK SPACE}%"
    return f"{100 * share:.{0 if share >= 0.0995 else 1}f}\N{NO-BREAK SPACE}%"


def _metres(value: float) -> str:
    return f"{value:.{2 if value < 9.995 else 1}f}\N{NO-BREAK SPACE}m"


def _joined(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _size(all_seen: Mapping[str, Seen]) -> str:
    """How well each follower's position was estimated, and the largest error with its time."""
    worst, one = max(all_seen.items(), key=lambda item: float(item[1].error.max()))
    k = int(one.error.argmax())
    largest, when = _metres(float(one.error[k])), f"{one.time[k]:.0f} s"
    if len(all_seen) > 1:
        means = {name: float(other.error.mean()) for name, other in all_seen.items()}
        low, high = min(means, key=means.__getitem__), max(means, key=means.__getitem__)
        return (
            f"The mean position errors of {len(all_seen)} followers lie between {_metres(means[low])} ({low}) and "
            f"{_metres(means[high])} ({high}); the largest error was {largest} ({worst}, at {when})."
        )
    return (
        f"The estimated position was off by {_metres(float(one.error.mean()))} on average and by {largest} "
        f"at most, at {when}, with the follower {one.distance[k]:.0f} m from the leader at a bearing of "
        f"{np.degrees(one.bearing[k]):.0f}°."
    )


def _geometry(one: Seen, several: bool) -> str:
    who, spent = ("The followers", "their") if several else ("The follower", "its")
    near, axis = one.on_axis, f"within {ON_AXIS_DEG:g}° of the leader's axis"
    share = float(near.mean())
    if share > 1 - _RARE:
        return f"{who} spent {percent(share)} of {spent} time {axis}, where ranges say little about the direction."
    if share < _RARE:
        return f"{who} spent {percent(share)} of {spent} time {axis}; farther from it, ranges tell the direction well."
    inside, outside = float(one.error[near].mean()), float(one.error[~near].mean())
    return (
        f"{who} spent {percent(share)} of {spent} time {axis}, where ranges say little about the direction: E_P had a "
        f"mean of {_metres(inside)} there, and of {_metres(outside)} elsewhere."
    )


def _fixes(one: Seen) -> str:
    if not one.kind.size:
        return "No message came, so that there was no fix."
    kinds, counts = np.unique(one.kind, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    parts = [f"{percent(float(counts[i]) / one.kind.size)} {_FIXES[FixKind(int(kinds[i]))]}" for i in order]
    return f"Of {one.kind.size} fixes {_joined(parts)}."


def _side(one: Seen, several: bool) -> str:
    whose = "an estimate" if several else "the estimate"
    wrong = f"{whose} was on the wrong side of the leader's axis by more than {SIDE_M:g} m"
    share = float(one.wrong_side.mean())
    if not share:
        return f"At no time {wrong}."
    if several:
        return f"For {percent(share)} of the followers' time {wrong}."
    first = one.time[int(one.wrong_side.argmax())]
    longest = longest_capture(one.wrong_side) * float(one.time[1] - one.time[0] if one.time.size > 1 else one.time[0])
    return f"For {percent(share)} of the time {wrong}, first at {first:.0f} s and at most for {longest:.3g} s on end."


def _trust(one: Seen) -> str:
    """Without a verdict: errors of one flight hang together, so that its share says little of the filter's."""
    return (
        f"The truth was outside the filter's 2σ ellipse for {percent(float(one.outside.mean()))} of the time; a "
        f"consistent filter would be outside for {percent(RIGHT_SHARE)} of it, over many flights."
    )


def _gave_way(flight: Flight) -> list[str]:
    """Who gave way to others, and for how long; nothing where nobody had to."""
    spent = sightings(flight.scenario, flight.trajectory).spent_s
    number, most = int(np.count_nonzero(spent)), int(spent.argmax())
    if not number:
        return []
    who = "One follower" if number == 1 else f"{number} followers"
    return [f"{who} gave way to others, {flight.trajectory.names[most + 1]} for longest, {spent[most]:.0f} s."]


def _unusual(flight: Flight) -> list[str]:
    """Vehicles far off their routes, and those that pass close to each other; nothing where there are none."""
    found = [f"at {e.time_s:.0f} s {e.text}" for e in (*route_events(flight), *approach_events(flight))]
    return [f"A{'; '.join(found)[1:]}."] if found else []


def _stations(flight: Flight) -> list[str]:
    """How stations were kept, and how near vehicles came to each other; nothing where followers keep to routes."""
    truth = flight.trajectory
    off = off_station(flight.scenario, truth)
    kept = {
        truth.names[i + 1]: station_keeping(off[:, i], truth.time)
        for i, follower in enumerate(flight.scenario.followers)
        if follower.station
    }
    if not kept:
        return []
    rms = {name: keeping.station_rms_m for name, keeping in kept.items()}
    best, worst = min(rms, key=rms.__getitem__), max(rms, key=rms.__getitem__)
    lost = [name for name, keeping in kept.items() if keeping.lost]
    if len(kept) > 1:
        size = (
            f"Of {len(kept)} followers {best} kept its station best, {_metres(rms[best])} off (RMS), and {worst} "
            f"worst, {_metres(rms[worst])} off; {_joined(lost) if lost else 'none'} got lost."
        )
    else:
        size = f"{best} was {_metres(rms[best])} off its station (RMS), and {'got' if lost else 'did not get'} lost."
        size = size[0].upper() + size[1:]
    space, level = closest_approaches(truth)
    return [
        size,
        f"Of all vehicles {_joined(space.pair)} came nearest to each other, to {_metres(space.distance_m)} at "
        f"{space.time_s:.0f} s.",
        f"Horizontally {_joined(level.pair)} did, to {_metres(level.distance_m)} at {level.time_s:.0f} s.",
        *_gave_way(flight),
    ]


def _cause(budgets: Sequence[RangeErrorBudget]) -> list[str]:
    apart = np.concatenate([budget.asymmetry for budget in budgets])
    there = apart[np.isfinite(apart).all(axis=1)]
    if not there.size:
        return []
    rms = np.sqrt(np.mean(there**2, axis=0))
    most = Cause(int(rms.argmax()))
    if not rms[most]:
        return []
    whole = float(np.sqrt(np.mean(there.sum(axis=1) ** 2)))
    return [
        f"The difference of front and rear range, which tells the direction, was {100 * whole:.2g} cm RMS off, most of "
        f"all by {LABELS[most]} ({100 * rms[most]:.2g} cm)."
    ]


def sentences(flight: Flight) -> list[str]:
    """Size of the errors, then stations, geometry, fixes, side, consistency, and the main cause of range errors.

    Several followers are treated together. There are none for a flight whose estimates are not finite.
    """
    followers = range(len(flight.estimates))
    if not all(np.isfinite(e.state[e.unknown :]).all() for e in flight.estimates):
        return []
    all_seen = {flight.trajectory.names[i + 1]: seen(flight, i) for i in followers}
    together = Seen(*(np.concatenate(parts) for parts in zip(*all_seen.values(), strict=True)))
    several = len(all_seen) > 1
    told = [
        _size(all_seen),
        *_unusual(flight),
        *_stations(flight),
        _geometry(together, several),
        _fixes(together),
        _side(together, several),
        _trust(together),
    ]
    return [*told, *_cause([range_error_budget(flight, i) for i in followers])]
