"""Ten REMUS 100 in a V behind a REMUS 100 on a route with bends that are wide enough for it."""

from typing import Any

import numpy as np

from laisn.arrays import Floats
from sim.flight import FlightRecord
from sim.scenario.parts import MotionSettings
from sim.tracking import StationKeeping, off_station, station_keeping

SPEED, RADIUS, CORNER = 1.2, 120.0, np.pi / 18.0
"""Speed on the route [m/s], radius of the circle about which its corners lie [m], and their
angle [rad].
"""


def waypoints(corners: int) -> Floats:
    """100 m straight on, and a bend of this number of corners: time [s], east and north [m], shape
    (corners + 2, 3).
    """
    heading = np.pi / 2 - CORNER * np.arange(corners + 1)
    leg = np.full(corners + 1, 2.0 * RADIUS * np.tan(0.5 * CORNER))
    leg[0] = 100.0
    path = np.cumsum([leg / SPEED, leg * np.sin(heading), leg * np.cos(heading)], axis=1)
    return np.vstack([np.zeros(3), path.T])


def table(corners: int) -> dict[str, Any]:
    """The scenario. Of the formation's settings least speeds alone are changed, as fins need
    0.5 m/s.
    """
    route = waypoints(corners)
    return {
        "name": "remus-formation",
        "duration_s": float(int(route[-1, 0])),
        "leader": {"model": "remus100", "waypoints": route.tolist()},
        "formation": {
            "shape": {"kind": "v", "count": 10, "behind_m": 15.0, "model": "remus100"},
            "min_along_track_speed_m_s": 0.6,
            "min_speed_m_s": 0.6,
            "timeout_speed_m_s": 0.6,
            "inner_min_speed_m_s": 0.7,
        },
        "navigation": {"variant": "tight"},
    }


def keeping(flight: FlightRecord) -> list[StationKeeping]:
    """Measures of each follower's station keeping."""
    distance = off_station(MotionSettings.of(flight.scenario), flight.trajectory)
    return [
        station_keeping(distance_of_follower, flight.trajectory.time)
        for distance_of_follower in distance.T
    ]


def depth_rms(flight: FlightRecord) -> float:
    """Error of the followers' depths after the first 30 s, root mean square [m]."""
    depths = np.array([follower.held_depth_m for follower in flight.scenario.followers])
    return float(np.sqrt(np.mean((flight.trajectory.depth[300:, 1:] - depths) ** 2)))
