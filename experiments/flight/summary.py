"""Errors of a flight's estimates, and the numbers of `summary.json`."""

from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.campaign.bound import flight_bound
from experiments.campaign.version import versions
from laisn import metrics
from laisn.arrays import Bools, Floats
from sim.contact import contacts
from sim.flight import Flight
from sim.sensing.proximity import sightings
from sim.station_keeping import closest_approaches, closest_in_a_layer, station_keeping, track_errors


def position_and_bearing_errors(flight: Flight) -> list[tuple[Floats, Floats]]:
    """E_P [m] and E_B [rad] of every follower at filter steps k = 1 … n, shapes (n,)."""
    steps = flight.step_index()
    leader = flight.trajectory.position[steps, 0, :2]
    result = []
    for i, estimates in enumerate(flight.estimates):
        position, truth = estimates.state[:, :2], flight.hydrophone(i)[:, :2]
        result.append(
            (
                metrics.position_errors(position, truth),
                metrics.bearing_errors(position, truth, leader),
            )
        )
    return result


def true_bearing(flight: Flight, follower: int) -> Floats:
    """B of a follower's hydrophone from the leader's true pose, in [0, 2π), shape (n,), [rad]."""
    steps = flight.step_index()
    away = flight.hydrophone(follower)[:, :2] - flight.trajectory.position[steps, 0, :2]
    return np.asarray(np.mod(np.arctan2(away[:, 0], away[:, 1]) - flight.trajectory.heading[steps, 0], 2 * np.pi))


def mirror_locked_steps(flight: Flight, follower: int) -> Bools:
    """Filter steps at which a follower's estimate is locked on the mirror image of the truth, shape (n,)."""
    steps, truth = flight.step_index(), flight.trajectory
    return metrics.mirror_locked_steps(
        flight.estimates[follower].state[:, :2],
        flight.hydrophone(follower)[:, :2],
        truth.position[steps, 0, :2],
        truth.heading[steps, 0],
    )


def _kept(flight: Flight, follower: int, off: Floats) -> dict[str, Any]:
    """How a follower kept its place, from its distances off it, shape (n,), [m]."""
    row: dict[str, Any] = {"track_error_rms_m": float(np.sqrt(np.mean(off**2)))}
    if flight.scenario.followers[follower].station:
        keeping = asdict(station_keeping(off, flight.trajectory.time))
        row |= {name: None if value != value else value for name, value in keeping.items()}
    return row


def _nearest(flight: Flight) -> dict[str, Any]:
    """Vehicles that came nearest to each other: in space, horizontally, horizontally of one layer; contacts."""
    space, level = closest_approaches(flight.trajectory)
    layer = closest_in_a_layer(flight.scenario, flight.trajectory)
    return {
        "closest_approach_m": space.distance_m,
        "closest_approach_pair": list(space.pair),
        "closest_approach_s": space.time_s,
        "closest_horizontal_m": level.distance_m,
        "closest_horizontal_pair": list(level.pair),
        "closest_horizontal_s": level.time_s,
        "closest_in_layer_m": None if layer is None else layer.distance_m,
        "closest_in_layer_pair": None if layer is None else list(layer.pair),
        "closest_in_layer_s": None if layer is None else layer.time_s,
        "contacts": [{"time_s": time, "pair": list(pair)} for time, pair in contacts(flight.trajectory)],
    }


def consistency(flight: Flight, follower: int, bound: Floats) -> dict[str, float | None]:
    """Consistency of a follower's errors with its covariance, and their bound.

    `nees` is the mean of eᵀ P⁻¹ e over the steps (2 if P is right), and `rms_over_bound` the RMS of E_P over that of
    the Cramér–Rao bound, both from the first estimate on; None where the covariance is singular, or the bound 0.
    """
    truth, estimates = flight.hydrophone(follower)[:, :2], flight.estimates[follower]
    squares = np.sum((estimates.state[:, :2] - truth) ** 2, axis=1)
    normalised, known = metrics.nees(estimates, truth), np.isfinite(squares)
    least = float(np.mean(bound[known] ** 2)) if known.any() else 0.0
    finite = np.isfinite(normalised)
    return {
        "nees": float(normalised[finite].mean()) if finite.any() else None,
        "bound_rms_m": least**0.5,
        "rms_over_bound": float(np.mean(squares[known]) / least) ** 0.5 if least > 0.0 else None,
    }


def flight_bounds(flight: Flight) -> list[Floats]:
    """Cramér–Rao bound of every follower, as of `flight_bound`."""
    return [flight_bound(flight, i) for i in range(len(flight.estimates))]


def summarise(
    flight: Flight, errors: list[tuple[Floats, Floats]], bounds: list[Floats] | None = None
) -> dict[str, Any]:
    """What `summary.json` holds: the same for the same scenario and version, whatever the machine.

    Args:
        flight: as flown.
        errors: E_P and E_B of every follower.
        bounds: `flight_bounds`, which take a while; None: they are computed here.
    """
    bounds = flight_bounds(flight) if bounds is None else bounds
    errors = [(p[e.unknown :], b[e.unknown :]) for (p, b), e in zip(errors, flight.estimates, strict=True)]
    pooled = metrics.summarise(np.concatenate([e for e, _ in errors]), np.concatenate([b for _, b in errors]))
    names, off = flight.trajectory.names[1:], track_errors(flight.scenario, flight.trajectory)
    sensing = flight.scenario.formation.proximity is not None
    spent = sightings(flight.scenario, flight.trajectory).spent_s
    return {
        "scenario": flight.scenario.name,
        "seed": flight.scenario.seed,
        "run": flight.scenario.run,
        "outcome": flight.outcome.value,
        "flown_s": float(flight.trajectory.time[-1]),
        "variant": flight.scenario.navigation.variant,
        **asdict(pooled),
        **_nearest(flight),
        "followers": {
            name: asdict(metrics.summarise(*errors[i]))
            | consistency(flight, i, bounds[i])
            | _kept(flight, i, off[:, i])
            | ({"gave_way_s": float(spent[i])} if sensing else {})
            | {"fixes": metrics.fix_counts(flight.estimates[i])}
            for i, name in enumerate(names)
        },
        "versions": versions(),
    }
