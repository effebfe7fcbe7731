"""Events of a flight, for its log and report: mirror locks, vehicles off their routes, approaches and contacts."""

import numpy as np

from experiments.flight.summary import mirror_locked_steps
from laisn.arrays import Floats
from sim.assembly import routes_of
from sim.contact import contacts
from sim.flight import Flight
from sim.log.channels import Event
from sim.scenario.formation import LEAST_LAYER_M
from sim.sensing.proximity import sightings
from sim.station_keeping import closest_approaches, true_stations
from sim.tracking import track_error

SIGMAS = 3.0
"""Least distance of two stations, in standard deviations of their followers' relative position error."""
OFF_ROUTE_M, NEAR_M = 10.0, 1.0
"""Largest usual distance from the route, and least usual one between two vehicles' origins [m]."""


def route_events(flight: Flight) -> list[Event]:
    """An event where a vehicle is farthest from where its route has it, if that is more than `OFF_ROUTE_M`."""
    truth, events = flight.trajectory, []
    for v, route in enumerate(routes_of(flight.scenario)):
        if v and flight.scenario.followers[v - 1].station is not None:
            continue
        off = track_error(route, truth.time, truth.position[:, v, :2])
        k = int(np.argmax(off))
        if off[k] > OFF_ROUTE_M:
            text = f"{truth.names[v]} is {off[k]:.0f} m off its route (maximum), and {off[-1]:.0f} m at the end"
            events.append(Event(float(truth.time[k]), "warning", text, truth.names[v]))
    return events


def approach_events(flight: Flight) -> list[Event]:
    """An event where the two nearest vehicles pass each other within `NEAR_M` and do not touch."""
    nearest, _ = closest_approaches(flight.trajectory)
    if nearest.distance_m >= NEAR_M or contacts(flight.trajectory):
        return []
    text = f"{' and '.join(nearest.pair)} pass within {nearest.distance_m:.2f} m"
    return [Event(nearest.time_s, "warning", text, nearest.pair[1])]


def contact_events(flight: Flight) -> list[Event]:
    """An event where two hulls first touch; unless that ends the mission, they pass through each other."""
    found = contacts(flight.trajectory)
    return [Event(time, "warning", f"{other} and {one} touch", other) for time, (one, other) in found]


def giving_way_events(flight: Flight) -> list[Event]:
    """An event where a follower first gives way to a vehicle that its sensor shows."""
    names, first = flight.trajectory.names, sightings(flight.scenario, flight.trajectory).first_s
    return [
        Event(float(first[i, j]), "info", f"{names[i + 1]} gives way to {names[j]}", names[i + 1])
        for i, j in np.argwhere(np.isfinite(first))
    ]


def largest_sigma(covariance: Floats) -> Floats:
    """Standard deviation along the larger axis of position ellipses, [m].

    Covariances of shape (n, 2, 2) or larger, east and north first, give shape (n,).
    """
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    largest = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
    return np.asarray(np.sqrt(np.maximum(largest, 0.0)))


def uncertainty_events(flight: Flight) -> list[Event]:
    """An event where two stations of one layer are first nearer than `SIGMAS` σ of their followers' relative error."""
    followers, steps, events = flight.scenario.followers, flight.step_index(), []
    kept = [i for i, follower in enumerate(followers) if follower.station]
    layered = [
        (i, j) for a, i in enumerate(kept) for j in kept[:a]
        if abs(followers[i].layer_m - followers[j].layer_m) < LEAST_LAYER_M
    ]  # fmt: skip
    if not layered:
        return []
    places = true_stations(flight.scenario, flight.trajectory)[steps]
    for i, j in layered:
        apart = np.hypot(places.east[:, i] - places.east[:, j], places.north[:, i] - places.north[:, j])
        relative = flight.estimates[i].covariance + flight.estimates[j].covariance
        near = apart < SIGMAS * largest_sigma(relative)
        if near.any():
            k = int(np.argmax(near))
            one, other = followers[i].name, followers[j].name
            text = f"stations of {one} and {other}, {apart[k]:.1f} m apart, are nearer"
            text += f" than {SIGMAS:g} sigma of their relative position error"
            events.append(Event(float(flight.trajectory.time[steps[k]]), "warning", text, one))
    return events


def mirror_lock_events(flight: Flight) -> list[Event]:
    """An event where an estimate is locked on the mirror image of the truth, and where it is released."""
    time, events = flight.trajectory.time[flight.step_index()], []
    for i, name in enumerate(flight.trajectory.names[1:]):
        mirror_locked = mirror_locked_steps(flight, i)
        for k in np.flatnonzero(np.diff(mirror_locked.astype(np.int64), prepend=0)):
            caught = bool(mirror_locked[k])
            text = "mirror lock: the estimate is at the truth's mirror image" if caught else "mirror lock ends"
            events.append(Event(float(time[k]), "warning" if caught else "info", text, name))
    return sorted(events, key=lambda event: event.time_s)


def stray_events(flight: Flight) -> list[Event]:
    """Warnings: a vehicle leaves the water or its route, touches or nearly touches another, or stations are close."""
    events = [*route_events(flight), *approach_events(flight), *contact_events(flight), *uncertainty_events(flight)]
    floor, time = flight.scenario.ocean.floor_depth_m, flight.trajectory.time
    planned = (flight.scenario.leader, *flight.scenario.followers)
    for name, depth, plan in zip(flight.trajectory.names, flight.trajectory.depth.T, planned, strict=True):
        surfaced = (depth < 0) & (plan.layer_m > 1)
        for outside, text in ((depth > floor, "goes below the sea floor"), (surfaced, "breaks the surface")):
            if outside.any():
                events.append(Event(float(time[np.argmax(outside)]), "warning", f"{name} {text}", name))
    return sorted(events, key=lambda event: event.time_s)


def flight_events(flight: Flight) -> list[Event]:
    """All events of a flight, in order of time."""
    events = [*mirror_lock_events(flight), *giving_way_events(flight), *stray_events(flight)]
    return sorted(events, key=lambda event: event.time_s)
