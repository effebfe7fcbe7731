"""Vehicles that touch, and followers whose stations are nearer than they know their places."""

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.flight import Flight
from sim.geometry import attitude
from sim.log.events import Event
from sim.scenario.formation import LEAST_LAYER_M
from sim.station_keeping import true_stations

LEADER_HALF_M, FOLLOWER_HALF_M = 1.0, 0.7
"""Half the length of the straight part of a hull [m] …"""
HULL_RADIUS_M = 0.1
"""… and its radius [m]."""
SIGMAS = 3.0
"""Stations are to be farther apart than so many standard deviations of their followers' relative place."""


@compiled
def hull_gap(between: Floats, one: Floats, other: Floats, halves: tuple[float, float]) -> float:
    """Distance of two straight hulls' axes [m].

    Args:
        between: from the middle of the first to that of the second, shape (3,), [m].
        one: unit vector along the first hull, shape (3,).
        other: likewise of the second.
        halves: half their lengths [m].
    """
    along, ahead, across = 0.0, 0.0, 0.0
    for i in range(3):
        along += one[i] * other[i]
        ahead += one[i] * between[i]
        across += other[i] * between[i]
    # nearest points s and t along the axes, each within its hull (Ericson, Real-Time Collision Detection, 2005)
    bent = 1.0 - along * along
    s = (ahead - along * across) / bent if bent > 1e-9 else 0.0
    s = min(max(s, -halves[0]), halves[0])
    t = min(max(along * s - across, -halves[1]), halves[1])
    s = min(max(along * t + ahead, -halves[0]), halves[0])
    squared = 0.0
    for i in range(3):
        part = between[i] + t * other[i] - s * one[i]
        squared += part * part
    return float(np.sqrt(squared))


@compiled
def _first_contacts(position: Floats, axis: Floats, half: Floats, reach: float, first: Floats) -> None:
    """First instant at which the hulls of each pair touch, shape (v, v); −1 if they never do."""
    first[:] = -1.0
    for k in range(position.shape[0]):
        for i in range(position.shape[1]):
            for j in range(i):
                between = position[k, i] - position[k, j]
                limit, squared = half[i] + half[j] + reach, 0.0
                # not by np.dot, for which numba loads a library of linear algebra in an eighth of a second
                for part in between:
                    squared += part * part
                if first[i, j] >= 0.0 or squared > limit * limit:
                    continue
                if hull_gap(between, axis[k, j], axis[k, i], (half[j], half[i])) < reach:
                    first[i, j] = k


def contact_events(flight: Flight) -> list[Event]:
    """A line for the log where two hulls first touch; in the simulation they pass through each other."""
    trajectory = flight.trajectory
    axis = np.ascontiguousarray(np.stack(attitude.forward(trajectory.quaternion), axis=-1))
    half = np.full(len(trajectory.names), FOLLOWER_HALF_M)
    half[0] = LEADER_HALF_M
    first = np.empty((half.size, half.size))
    _first_contacts(np.ascontiguousarray(trajectory.position), axis, half, 2.0 * HULL_RADIUS_M, first)
    return [
        Event(
            float(trajectory.time[int(first[i, j])]),
            "warning",
            f"{trajectory.names[i]} and {trajectory.names[j]} touch",
            trajectory.names[i],
        )
        for i, j in np.argwhere(first >= 0.0)
    ]


def _spread(covariance: Floats) -> Floats:
    """Largest standard deviation of covariances of shape (n, 2, 2), shape (n,), [m]."""
    half = 0.5 * (covariance[:, 0, 0] + covariance[:, 1, 1])
    across = 0.5 * (covariance[:, 0, 0] - covariance[:, 1, 1])
    return np.sqrt(np.maximum(half + np.hypot(across, covariance[:, 0, 1]), 0.0))


def uncertainty_events(flight: Flight) -> list[Event]:
    """A line for the log where two stations of one layer are first nearer than three sigma of their relative error."""
    followers = flight.scenario.followers
    kept = [i for i, follower in enumerate(followers) if follower.station]
    if len(kept) < 2:
        return []
    steps, events = flight.step_index(), []
    places = true_stations(flight.scenario, flight.trajectory)[steps, :, :2]
    for a, i in enumerate(kept):
        for j in kept[:a]:
            if abs(followers[i].layer_m - followers[j].layer_m) >= LEAST_LAYER_M:
                continue
            apart = np.hypot(*(places[:, i] - places[:, j]).T)
            together = flight.estimates[i].covariance[:, :2, :2] + flight.estimates[j].covariance[:, :2, :2]
            near = apart < SIGMAS * _spread(together)
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
