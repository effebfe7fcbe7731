"""Errors of a flight's estimates, the numbers of `summary.json`, and events for its log and
report.
"""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from laisn import metrics
from laisn.arrays import Bools, Floats
from reports.bound import flight_bounds
from reports.verdict import verdict
from reports.version import versions
from sim import tracking
from sim.assembly import routes_of
from sim.flight import FlightRecord, leader_errors, position_and_bearing_errors
from sim.log.writer import Event
from sim.scenario.formation import MIN_LAYER_SPACING_M
from sim.scenario.parts import MissionPlan, MotionSettings, SeaSettings
from sim.scenario.routes import Route
from sim.sensing.proximity import sightings
from sim.water.assembly import floor_of

_ALL = slice(None)


def true_bearing(flight: FlightRecord, follower: int, part: slice = _ALL) -> Floats:
    """B of a follower's hydrophone from the leader's true pose, in [0, 2π), at filter steps or a
    part of them, shape (n,), [rad].
    """
    steps = flight.step_index()[part]
    truth = flight.trajectory
    hydrophone = truth.site_path(f"{truth.names[follower + 1]}/hydrophone", steps)
    separation = hydrophone[:, :2] - truth.position[steps, 0, :2]
    bearing = np.arctan2(separation[:, 0], separation[:, 1])
    return np.asarray(np.mod(bearing - truth.heading[steps, 0], 2 * np.pi))


def mirror_locked_steps(flight: FlightRecord, follower: int) -> Bools:
    """Filter steps at which a follower's estimate is locked on the mirror image of the truth,
    shape (n,).
    """
    steps = flight.step_index()
    truth = flight.trajectory
    estimate = flight.estimates[follower].state[:, :2]
    leader = truth.position[steps, 0, :2]
    return metrics.mirror_locked_steps(
        estimate, flight.hydrophone(follower)[:, :2], leader, truth.heading[steps, 0]
    )


def _route_summary(
    flight: FlightRecord, follower: int, route: Route, track_errors: Floats
) -> dict[str, Any]:
    """How a follower kept its place and depth by its route, from its distances off it, shape (n,),
    [m].
    """
    truth = flight.trajectory
    vehicle = follower + 1
    planned = route.depth.at(truth.time)[0]
    depth_error = -truth.position[:, vehicle, 2] - planned
    row: dict[str, Any] = {
        "track_error_rms_m": float(np.sqrt(np.mean(track_errors**2))),
        "depth_error_rms_m": float(np.sqrt(np.mean(depth_error**2))),
    }
    keeping = flight.scenario.followers[follower].station and asdict(
        tracking.station_keeping(track_errors, flight.trajectory.time)
    )
    return row | {
        name: None if value != value else value for name, value in (keeping or {}).items()
    }


def _nearest(flight: FlightRecord) -> dict[str, Any]:
    """Vehicles that came nearest to each other: in space, horizontally, and horizontally of those
    in one depth layer; contacts.
    """
    space, level = tracking.closest_approaches(flight.trajectory)
    row = dict[str, Any]()
    layer = tracking.closest_in_a_layer(MissionPlan.of(flight.scenario), flight.trajectory)
    for name, approach in (("approach", space), ("horizontal", level), ("in_layer", layer)):
        row[f"closest_{name}_m"] = approach and approach.distance_m
        row[f"closest_{name}_pair"] = approach and list(approach.pair)
        row[f"closest_{name}_s"] = approach and approach.time_s
    return row | {
        "contacts": [
            {"time_s": time, "pair": list(pair)}
            for time, pair in tracking.contacts(flight.trajectory)
        ]
    }


def consistency(flight: FlightRecord, follower: int, bound: Floats) -> dict[str, float | None]:
    """Consistency of a follower's errors with its covariance, and their bound, shape (n,), [m],
    from the first estimate on.

    `nees` is the mean of eᵀ P⁻¹ e (2 if P is right; None: singular), `rms_over_bound` the RMS of
    E_P over the bound's, `bound_rms_m`; with a bound of NaN both are None.
    """
    truth = flight.hydrophone(follower)[:, :2]
    estimates = flight.estimates[follower]
    squares = np.sum((estimates.state[:, :2] - truth) ** 2, axis=1)
    normalised = metrics.nees(estimates, truth)
    is_finite = np.isfinite(squares)
    mean_bound_square = float(np.mean(bound[is_finite] ** 2)) if is_finite.any() else 0.0
    finite = np.isfinite(normalised)
    return {
        "nees": float(normalised[finite].mean()) if finite.any() else None,
        "bound_rms_m": mean_bound_square**0.5 if np.isfinite(mean_bound_square) else None,
        "rms_over_bound": float(np.mean(squares[is_finite]) / mean_bound_square) ** 0.5
        if mean_bound_square > 0.0
        else None,
    }


SEGMENTS_M = (10.0, 20.0, 50.0, 100.0, 200.0)
"""Lengths of the true path over which relative errors are stated [m]."""


def relative_error(flight: FlightRecord, follower: int) -> list[dict[str, float]]:
    """Errors of a follower's displacement over segments of each length of `SEGMENTS_M` that its
    true path holds: RMS, median, 95th percentile [m] and number of segments.
    """
    truth = flight.hydrophone(follower)[:, :2]
    estimates = flight.estimates[follower]
    estimated = slice(estimates.steps_without_estimate, None)
    rows = []
    for length in SEGMENTS_M:
        errors = metrics.relative_errors(estimates.state[estimated, :2], truth[estimated], length)
        errors = errors[np.isfinite(errors)]
        if errors.size:
            median, high = np.quantile(errors, [0.5, 0.95])
            rows.append(
                {
                    "length_m": length,
                    "rms_m": float(np.sqrt(np.mean(errors**2))),
                    "median_m": float(median),
                    "p95_m": float(high),
                    "segments": errors.size,
                }
            )
    return rows


def _own_variant(flight: FlightRecord, follower: int) -> dict[str, str]:
    """The navigator of a follower, where followers have different ones."""
    scenario = flight.scenario
    if all(member.navigation is None for member in scenario.followers):
        return {}
    return {"variant": scenario.navigation_of(follower).variant}


def leader_row(flight: FlightRecord) -> dict[str, Any]:
    """Errors of the leader's own estimate from the first one on; empty if it has no navigator."""
    position = leader_errors(flight)
    if flight.leader is None or flight.leader.estimates is None or position is None:
        return {}
    navigation = flight.scenario.leader.navigation
    estimates = flight.leader.estimates
    time = flight.trajectory.time[flight.step_index()]
    has_estimate = np.isfinite(position)
    errors = position[has_estimate]
    normalised = metrics.nees(estimates, flight.leader_position()[:, :2])
    normalised = normalised[np.isfinite(normalised)]
    return {
        "variant": None if navigation is None else navigation.variant,
        "e_p_mean_m": float(errors.mean()) if errors.size else None,
        "e_p_std_m": float(errors.std()) if errors.size else None,
        "e_p_max_m": float(errors.max()) if errors.size else None,
        "e_p_max_s": float(time[has_estimate][errors.argmax()]) if errors.size else None,
        "nees": float(normalised.mean()) if normalised.size else None,
        "fixes": metrics.fix_counts(estimates),
    }


def _error_figures(position: Floats, bearing: Floats) -> dict[str, float | None]:
    """Figures of errors at n steps, by the names of `metrics.Summary`; None where n is 0."""
    if not position.size:
        return dict.fromkeys(metrics.Summary._fields)
    return metrics.summarise(position, bearing)._asdict()


def summarise(flight: FlightRecord, bounds: list[Floats] | None = None) -> dict[str, Any]:
    """Mean, largest and σ of a flight's errors, of all followers and of each, and what else
    `summary.json` holds.

    `bounds` are the `flight_bounds`, computed here if None. Errors of a follower that has no
    estimate in the whole mission are None.
    """
    bounds = flight_bounds(flight) if bounds is None else bounds
    errors_of_followers = position_and_bearing_errors(flight)
    errors = [
        (p[e.steps_without_estimate :], b[e.steps_without_estimate :])
        for (p, b), e in zip(errors_of_followers, flight.estimates, strict=True)
    ]
    names = flight.trajectory.names[1:]
    pooled = _error_figures(
        np.concatenate([e for e, _ in errors]), np.concatenate([b for _, b in errors])
    )
    track_errors = tracking.track_errors(MotionSettings.of(flight.scenario), flight.trajectory)
    routes = routes_of(MissionPlan.of(flight.scenario))
    has_proximity_sensor = flight.scenario.formation.proximity is not None
    gave_way_s = sightings(MotionSettings.of(flight.scenario), flight.trajectory).detected_s
    leader = leader_row(flight)
    return {
        "scenario": flight.scenario.name,
        "seed": flight.scenario.seed,
        "run": flight.scenario.run,
        "outcome": flight.outcome.value,
        "flown_s": float(flight.trajectory.time[-1]),
        "variant": flight.scenario.variants,
        "verdict": verdict(flight, track_errors).table(),
        **pooled,
        **_nearest(flight),
        **({"leader": leader} if leader else {}),
        "followers": {
            name: _error_figures(*errors[i])
            | consistency(flight, i, bounds[i])
            | _route_summary(flight, i, routes[i + 1], track_errors[:, i])
            | ({"gave_way_s": float(gave_way_s[i])} if has_proximity_sensor else {})
            | {"relative_errors": relative_error(flight, i)}
            | {"fixes": metrics.fix_counts(flight.estimates[i])}
            | _own_variant(flight, i)
            for i, name in enumerate(names)
        },
        "versions": versions(),
    }


# least distance of two stations, in standard deviations of their followers' relative position error
STATION_GAP_SIGMAS = 3.0
OFF_ROUTE_M = 10.0  # largest distance from the route without a warning
NEAR_M = 1.0  # least distance of two vehicles' origins without a warning
_ROUNDING = 1.0 + 1e-9  # more than the rounding of a squared distance, as a factor


def route_events(flight: FlightRecord) -> list[Event]:
    """An event where a vehicle is farthest from where its route has it, if that is more than
    `OFF_ROUTE_M`.
    """
    truth = flight.trajectory
    events = []
    for v, route in enumerate(routes_of(MissionPlan.of(flight.scenario))):
        # stations have no route, and a controller of the user's own need not keep to it
        _, vehicle = flight.scenario.vehicles()[v]
        if getattr(vehicle, "station", None) is not None or vehicle.controller:
            continue
        track_error = tracking.track_error(route, truth.time, truth.position[:, v, :2])
        k = int(np.argmax(track_error))
        if track_error[k] > OFF_ROUTE_M:
            text = (
                f"{truth.names[v]} is {track_error[k]:.0f} m off its route (maximum), and "
                f"{track_error[-1]:.0f} m at the end"
            )
            events.append(Event(float(truth.time[k]), "warning", text, truth.names[v]))
    return events


def approach_events(flight: FlightRecord) -> list[Event]:
    """An event where the two nearest vehicles pass each other within `NEAR_M` and do not touch."""
    nearest, _ = tracking.closest_approaches(flight.trajectory)
    if nearest.distance_m >= NEAR_M or tracking.contacts(flight.trajectory):
        return []
    text = f"{' and '.join(nearest.pair)} pass within {nearest.distance_m:.2f} m"
    return [Event(nearest.time_s, "warning", text, nearest.pair[1])]


def contact_events(flight: FlightRecord) -> list[Event]:
    """An event where two hulls first touch; unless that ends the mission, they pass through each
    other.
    """
    return [
        Event(t, "warning", f"{other} and {first} touch", other)
        for t, (first, other) in tracking.contacts(flight.trajectory)
    ]


def giving_way_events(flight: FlightRecord) -> list[Event]:
    """An event where a follower first gives way to a vehicle that its sensor shows."""
    names = flight.trajectory.names
    first = sightings(MotionSettings.of(flight.scenario), flight.trajectory).first_s
    return [
        Event(float(first[i, j]), "info", f"{names[i + 1]} gives way to {names[j]}", names[i + 1])
        for i, j in np.argwhere(np.isfinite(first))
    ]


def largest_sigma(covariance: Floats) -> Floats:
    """σ along the larger axis of the ellipses of covariances of shape (n, 2, 2) or larger, shape
    (n,), [m].
    """
    xx = covariance[:, 0, 0]
    xy = covariance[:, 0, 1]
    yy = covariance[:, 1, 1]
    largest = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
    return np.asarray(np.sqrt(np.maximum(largest, 0.0)))


def uncertainty_events(flight: FlightRecord) -> list[Event]:
    """An event where two stations of one layer are first nearer than `STATION_GAP_SIGMAS` σ of
    their followers' relative error.
    """
    followers = flight.scenario.followers
    steps = flight.step_index()
    events = []
    pairs = [
        (i, j)
        for i, follower in enumerate(followers)
        for j, other in enumerate(followers[:i])
        if follower.station
        and other.station
        and abs(follower.held_depth_m - other.held_depth_m) < MIN_LAYER_SPACING_M
    ]
    if not pairs:
        return []
    places = tracking.true_stations(MotionSettings.of(flight.scenario), flight.trajectory)[steps]
    east = np.ascontiguousarray(places.east.T)
    north = np.ascontiguousarray(places.north.T)
    squared_reach = np.square(
        [STATION_GAP_SIGMAS * largest_sigma(estimates.covariance) for estimates in flight.estimates]
    )
    for i, j in pairs:
        # the largest variance of a sum is at most the sum of the largest ones, which are at hand;
        # NaN is not excluded
        squared = (east[i] - east[j]) ** 2 + (north[i] - north[j]) ** 2
        if np.all(squared > _ROUNDING * (squared_reach[i] + squared_reach[j])):
            continue
        distance = np.hypot(east[i] - east[j], north[i] - north[j])
        is_near = distance < STATION_GAP_SIGMAS * largest_sigma(
            flight.estimates[i].covariance + flight.estimates[j].covariance
        )
        if is_near.any():
            k = int(np.argmax(is_near))
            text = (
                f"stations of {followers[i].name} and {followers[j].name}, {distance[k]:.1f} m "
                "apart, are nearer"
            )
            text += f" than {STATION_GAP_SIGMAS:g} sigma of their relative position error"
            events.append(
                Event(float(flight.trajectory.time[steps[k]]), "warning", text, followers[i].name)
            )
    return events


def mirror_lock_events(flight: FlightRecord) -> list[Event]:
    """An event where an estimate is locked on the mirror image of the truth, and where it is
    released.
    """
    time = flight.trajectory.time[flight.step_index()]
    events = []
    for i, name in enumerate(flight.trajectory.names[1:]):
        mirror_locked = mirror_locked_steps(flight, i)
        for k in np.flatnonzero(np.diff(mirror_locked.astype(np.int64), prepend=0)):
            caught = bool(mirror_locked[k])
            text = (
                "mirror lock: the estimate is at the truth's mirror image"
                if caught
                else "mirror lock ends"
            )
            events.append(Event(float(time[k]), "warning" if caught else "info", text, name))
    return sorted(events, key=lambda event: event.time_s)


def safety_warnings(flight: FlightRecord) -> list[Event]:
    """Warnings: a vehicle leaves the water or its route, touches or nearly touches another, or two
    stations are close for the uncertainty of their followers.
    """
    events = [
        *route_events(flight),
        *approach_events(flight),
        *contact_events(flight),
        *uncertainty_events(flight),
    ]
    floor = floor_of(SeaSettings.of(flight.scenario))
    time = flight.trajectory.time
    planned = (flight.scenario.leader, *flight.scenario.followers)
    for vehicle, (name, plan) in enumerate(zip(flight.trajectory.names, planned, strict=True)):
        depth = -flight.trajectory.position[:, vehicle, 2]
        floor_depth = floor.depths_at(*flight.trajectory.position[:, vehicle, :2].T)
        surfaced = (depth < 0) & (plan.held_depth_m > 1)
        for outside, text in (
            (depth > floor_depth, "goes below the sea floor"),
            (surfaced, "breaks the surface"),
        ):
            if outside.any():
                events.append(
                    Event(float(time[np.argmax(outside)]), "warning", f"{name} {text}", name)
                )
    return sorted(events, key=lambda event: event.time_s)


def flight_events(flight: FlightRecord, warnings: Sequence[Event] | None = None) -> list[Event]:
    """All events of a flight, in order of time; `warnings` are its `safety_warnings`, computed here
    if None.
    """
    warnings = safety_warnings(flight) if warnings is None else warnings
    events = [*mirror_lock_events(flight), *giving_way_events(flight), *warnings]
    return sorted(events, key=lambda event: event.time_s)
