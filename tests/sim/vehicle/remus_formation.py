"""Ten REMUS 100 in a V behind a REMUS 100 that turns as wide as it can turn without leaving its
route.
"""

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
    """100 m straight on, and a bend of so many corners: time [s], east and north [m], shape (n,
    3).
    """
    heading = np.pi / 2 - CORNER * np.arange(corners + 1)
    leg = np.full(corners + 1, 2.0 * RADIUS * np.tan(0.5 * CORNER))
    leg[0] = 100.0
    way = np.cumsum([leg / SPEED, leg * np.sin(heading), leg * np.cos(heading)], axis=1)
    return np.vstack([np.zeros(3), way.T])


def table(corners: int) -> dict[str, Any]:
    """The scenario; nothing of a formation's settings is changed but speeds, for fins need 0.5
    m/s of way.
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
    """How each follower kept its station."""
    off = off_station(MotionSettings.of(flight.scenario), flight.trajectory)
    return [station_keeping(one, flight.trajectory.time) for one in off.T]


def depth_rms(flight: FlightRecord) -> float:
    """Error of the followers' depths after the first 30 s, root mean square [m]."""
    depths = np.array([follower.held_depth_m for follower in flight.scenario.followers])
    return float(np.sqrt(np.mean((flight.trajectory.depth[300:, 1:] - depths) ** 2)))
