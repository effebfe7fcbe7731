"""How well a fleet kept to its routes, and how its hulls rolled and pitched on the way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats
from sim.scenario.point_motion import plan
from sim.scenario.routes import Route
from sim.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class TrackingReport:
    """One vehicle on its route, from the start to the last waypoint (or the end of the trajectory)."""

    name: str
    cross_track_rms: float
    """Distance to the straight legs between waypoints [m]; cut corners count as they are."""
    cross_track_max: float
    arrival_error_max: float
    """Largest difference between the time at which a waypoint is nearest and its time on the route [s]."""
    speed_error_rms: float
    """Error of the speed over ground against the point motion along the same route [m/s]."""
    depth_error_rms: float
    """Error of the depth against that of the route or profile [m]."""
    depth_error_max: float
    pitch_max: float
    """Largest size of the pitch [rad]."""
    pitch_std: float
    roll_max: float
    roll_std: float


def cross_track(route: Route, time: Floats, position: Floats) -> Floats:
    """Distance to the leg that is due, the one before or the one after, whichever is nearest.

    Args:
        route: its waypoints.
        time: shape (n,), [s].
        position: east and north, shape (n, 2), [m].

    Returns:
        Shape (n,), [m].
    """
    last = route.time.size - 2
    due = np.clip(np.searchsorted(route.time, time, side="right") - 1, 0, last)
    start, along = route.waypoint[:-1], np.diff(route.waypoint, axis=0)
    nearest = np.full(time.size, np.inf)
    for shift in (-1, 0, 1):
        leg = np.clip(due + shift, 0, last)
        offset = position - start[leg]
        squared = np.einsum("ni,ni->n", along[leg], along[leg])
        # where the vehicle stops, the leg is a point
        share = np.einsum("ni,ni->n", offset, along[leg]) / np.where(squared > 0.0, squared, 1.0)
        off_leg = offset - np.clip(share, 0.0, 1.0)[:, None] * along[leg]
        nearest = np.minimum(nearest, np.hypot(*off_leg.T))
    return nearest


def track_error(route: Route, time: Floats, position: Floats) -> Floats:
    """Distance to where the point motion along the route is, shape (n,), [m]; arguments as of `cross_track`."""
    place = plan(route).at(time)
    return np.hypot(position[:, 0] - place.east, position[:, 1] - place.north)


def arrival_errors(route: Route, time: Floats, position: Floats) -> Floats:
    """When each waypoint is nearest, less its time on the route; arguments as of `cross_track`.

    A waypoint is looked for until half a leg before and after it; those where the vehicle stops, and those later than
    the last instant, are left out.

    Returns:
        Shape (number of waypoints passed,), [s].
    """
    middle = 0.5 * (route.time[:-1] + route.time[1:])
    begin, end = np.concatenate([route.time[:1], middle]), np.concatenate([middle, [np.inf]])
    errors = []
    rests = route.leg_length == 0
    stops = np.append(rests, False) | np.append(False, rests)
    for due, waypoint, first, until, is_stop in zip(route.time, route.waypoint, begin, end, stops, strict=True):
        if due > time[-1] + 1e-9:
            break
        if is_stop:
            continue
        window = np.flatnonzero((time >= first) & (time <= until))
        errors.append(time[window[np.hypot(*(position[window] - waypoint).T).argmin()]] - due)
    return np.array(errors)


def tracking(trajectory: Trajectory, routes: Sequence[Route]) -> tuple[TrackingReport, ...]:
    """How each vehicle of a trajectory kept to its route."""
    reports = []
    for i, (name, route) in enumerate(zip(trajectory.names, routes, strict=True)):
        n = int(np.searchsorted(trajectory.time, route.time[-1] + 1e-9, side="right"))
        time, position = trajectory.time[:n], trajectory.position[:n, i, :2]
        off = cross_track(route, time, position)
        late = arrival_errors(route, trajectory.time, trajectory.position[:, i, :2])
        intended = plan(route).at(time)
        speed_error = np.hypot(*trajectory.velocity[:n, i, :2].T) - intended.speed
        depth_error = trajectory.depth[:n, i] - route.depth.at(time)[0]
        pitch, roll = trajectory.pitch[:n, i], trajectory.roll[:n, i]
        reports.append(
            TrackingReport(
                name=name,
                cross_track_rms=float(np.sqrt(np.mean(off**2))),
                cross_track_max=float(off.max()),
                arrival_error_max=float(np.abs(late).max(initial=0.0)),
                speed_error_rms=float(np.sqrt(np.mean(speed_error**2))),
                depth_error_rms=float(np.sqrt(np.mean(depth_error**2))),
                depth_error_max=float(np.abs(depth_error).max()),
                pitch_max=float(np.abs(pitch).max()),
                pitch_std=float(pitch.std()),
                roll_max=float(np.abs(roll).max()),
                roll_std=float(roll.std()),
            )
        )
    return tuple(reports)
