"""Where the stations of a flight truly are at any instant."""

import numpy as np

from laisn.arrays import Floats
from sim.flight import Flight
from sim.station_keeping import true_stations


class Stations:
    """The stations of a flight of f followers.

    Args:
        flight: whose followers may keep stations, or routes.
    """

    def __init__(self, flight: Flight) -> None:
        followers, truth = flight.scenario.followers, flight.trajectory
        self._flight = flight
        self._kept = np.array([follower.station is not None for follower in followers])
        self._places = np.full((truth.time.size, len(followers), 3), np.nan)
        if self:
            self._places[..., :2] = true_stations(flight.scenario, truth)[..., :2]
            self._places[..., 2] = [-f.station.depth_m if f.station else np.nan for f in followers]
            self._places[:, ~self._kept] = np.nan

    def __bool__(self) -> bool:
        """Whether any follower keeps a station."""
        return bool(self._kept.any())

    def at(self, time: float) -> Floats:
        """Where each follower should be at a time [s] of the mission, shape (f, 3), [m]; NaN for one on a route."""
        truth = self._flight.trajectory
        place = (time - float(truth.time[0])) / truth.dt
        i = min(max(int(place), 0), truth.time.size - 1)
        before, after = self._places[i], self._places[min(i + 1, truth.time.size - 1)]
        return np.asarray(before + (place - i) * (after - before))

    def off(self, follower: int) -> Floats | None:
        """Horizontal distance from its station at filter steps, shape (n,), [m]; None for a follower on a route."""
        if not self._kept[follower]:
            return None
        steps = self._flight.step_index()
        away = self._flight.hydrophone(follower)[:, :2] - self._places[steps, follower, :2]
        return np.asarray(np.hypot(away[:, 0], away[:, 1]))
