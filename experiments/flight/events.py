"""Events of a flight, for its log and report: mirror captures, vehicles off their routes, approaches and contacts."""

import numpy as np

from experiments.flight.summary import captured_steps
from laisn.arrays import Floats
from sim.assembly import routes_of
from sim.contact import contacts
from sim.flight import Flight
from sim.log.channels import Event
from sim.scenario.formation import LEAST_LAYER_M
from sim.sensing.proximity import sightings
from sim.station_keeping import closest_approaches, true_stations
from sim.tracking import off_place

SIGMAS = 3.0
"""Stations are to be farther apart than so many standard deviations of their followers' relative place."""


OFF_ROUTE_M, NEAR_M = 10.0, 1.0
"""A distance from the route, and one between two vehicles' origins, from which on a flight is reported as unusual."""


def route_events(flight: Flight) -> list[Event]:
    """An event where a vehicle is farthest from where its route has it, if that is more than `OFF_ROUTE_M`."""
    truth, events = flight.trajectory, []
    for v, route in enumerate(routes_of(flight.scenario)):
        if v and flight.scenario.followers[v - 1].station is not None:
            continue
        off = off_place(route, truth.time, truth.position[:, v, :2])
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
    one, other = nearest.pair
    text = f"{one} and {other} pass within {nearest.distance_m:.2f} m"
    return [Event(nearest.time_s, "warning", text, other)]


def contact_events(flight: Flight) -> list[Event]:
    """A line for the log where two hulls first touch; unless that ends the mission, they pass through each other."""
    return [
        Event(contact.time_s, "warning", f"{contact.pair[1]} and {contact.pair[0]} touch", contact.pair[1])
        for contact in contacts(flight.trajectory)
    ]


def giving_way_events(flight: Flight) -> list[Event]:
    """A line for the log where a follower first gives way to a vehicle that its sensor shows."""
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
    """A line for the log where two stations of one layer are first nearer than three sigma of their relative error."""
    followers = flight.scenario.followers
    kept = [i for i, follower in enumerate(followers) if follower.station]
    if len(kept) < 2:
        return []
    steps, events = flight.step_index(), []
    places = true_stations(flight.scenario, flight.trajectory)[steps]
    for a, i in enumerate(kept):
        for j in kept[:a]:
            if abs(followers[i].layer_m - followers[j].layer_m) >= LEAST_LAYER_M:
                continue
            apart = np.hypot(places.east[:, i] - places.east[:, j], places.north[:, i] - places.north[:, j])
            together = flight.estimates[i].covariance[:, :2, :2] + flight.estimates[j].covariance[:, :2, :2]
            near = apart < SIGMAS * largest_sigma(together)
            if near.any():
                k = int(np.argmax(near))
                text = f"stations of {followers[i].name} and {followers[j].name}, {apart[k]:.1f} m apart, are nearer"
                events.append(
                    Event(
                        float(flight.trajectory.time[steps[k]]),
                        "warning",
                        f"{text} than {SIGMAS:g} sigma of their relative place",
                        followers[i].name,
                    )
                )
    return events


def capture_events(flight: Flight) -> list[Event]:
    """A line for the log where an estimate is captured at the mirror image of the truth, and where it is released."""
    time, events = flight.trajectory.time[flight.step_index()], []
    for i, name in enumerate(flight.trajectory.names[1:]):
        captured = captured_steps(flight, i)
        for k in np.flatnonzero(np.diff(captured.astype(np.int64), prepend=0)):
            caught = bool(captured[k])
            text = "mirror capture: the estimate is at the truth's mirror image" if caught else "mirror capture ends"
            events.append(Event(float(time[k]), "warning" if caught else "info", text, name))
    return sorted(events, key=lambda event: event.time_s)


def stray_events(flight: Flight) -> list[Event]:
    """Events for the log: a vehicle leaves the water or its route, touches or nearly touches another, or its station is
    too near another one."""
    events = [*route_events(flight), *approach_events(flight), *contact_events(flight), *uncertainty_events(flight)]
    floor = flight.scenario.ocean.floor_depth_m
    planned = (flight.scenario.leader, *flight.scenario.followers)
    for v, name in enumerate(flight.trajectory.names):
        depth = flight.trajectory.depth[:, v]
        surfaced = depth < 0 if planned[v].layer_m > 1 else np.zeros(depth.size, dtype=bool)
        for strayed, text in ((depth > floor, "goes below the sea floor"), (surfaced, "breaks the surface")):
            if strayed.any():
                first = float(flight.trajectory.time[np.argmax(strayed)])
                events.append(Event(first, "warning", f"{name} {text}", name))
    return sorted(events, key=lambda event: event.time_s)


def flight_events(flight: Flight) -> list[Event]:
    """All events of a flight, in order of time."""
    events = [*capture_events(flight), *giving_way_events(flight), *stray_events(flight)]
    return sorted(events, key=lambda event: event.time_s)
