"""What a film shows of a flight at any instant: a pure function of time, so that frames may be drawn in any order."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.estimates import FixKind
from sim import attitude
from sim.flight import Flight, position_and_bearing_errors
from sim.tracking import true_stations

RGB = tuple[float, float, float]  # red, green, blue, each in [0, 1]

TRANSMITTERS = ("tx_rear", "tx_front", "tx_middle")

_AFTERGLOW_S = 0.45
"""Time constant of a ray's fading, in seconds of film: pings closer together than that blend into a steady ray."""
_TRAIL_S, _TRAIL_POINT_S = 5.0, 0.04  # length of a trail, and spacing of its points, in seconds of film
_LEAST_WEIGHT = 0.01  # hypotheses of less weight are not shown

LEADER: RGB = (1.0, 0.68, 0.20)  # trail and label
TRUTH: RGB = (1.0, 0.95, 0.25)  # trail and position of a follower
ESTIMATE: RGB = (1.0, 0.25, 0.85)  # a follower's estimate of its own position
STATION: RGB = (0.45, 1.0, 1.0)  # of a follower in formation
TRANSMITTER_COLOURS: tuple[RGB, ...] = ((0.95, 0.97, 1.0), (0.35, 1.0, 0.55), (0.45, 0.70, 1.0))
"""Rear, front and middle transmitter and their rays; distinct from leader and follower, also to colour-blind eyes."""


class Hypothesis(NamedTuple):
    """One component of a follower's position estimate."""

    weight: float
    centre: Floats  # shape (3,), [m]; at the true depth
    covariance: Floats  # horizontal, shape (2, 2), [m²]


@dataclass(frozen=True, kw_only=True)
class FrameState:
    """Everything one frame shows; v vehicles, f followers. Positions in the world [m], angles [rad]."""

    time: float  # of the mission [s]
    position: Floats  # body origins, shape (v, 3)
    quaternion: Floats  # attitudes from body to world, (w, x, y, z), shape (v, 4)
    effectors: Floats  # states of the effectors, shape (v, m)
    heading: Floats  # shape (v,)
    pitch: Floats  # shape (v,)
    speed: Floats  # through the water, shape (v,), [m/s]
    transmitter: Floats  # rear, front and middle, shape (3, 3)
    hydrophone: Floats  # shape (f, 3)
    estimate: Floats  # estimated hydrophone, shape (f, 3); at the true depth, for the filter is planar
    covariance: Floats  # of the estimated position, shape (f, 2, 2), [m²]
    station: Floats  # true stations of the followers, shape (f, 3); NaN for a follower on a route
    hypotheses: tuple[tuple[Hypothesis, ...], ...]
    """Hypotheses of each follower's position; the estimate alone if there is only one."""
    ray: Floats  # strength of each range's ray, 1 at the ping, 0 where nothing was received, shape (f, 3)
    ranges: Floats  # last slant ranges measured, shape (f, 3), [m]; NaN if none
    fix_kind: tuple[FixKind | None, ...]  # outcome of the last message, per follower
    position_error: Floats  # shape (f,), [m]; NaN before the first step
    bearing_error: Floats  # shape (f,); likewise


class FilmData:
    """A flight, ready to be filmed; `speed_up` are seconds of mission in a second of film, `follower` is filmed."""

    def __init__(self, flight: Flight, speed_up: float, follower: int = 0) -> None:
        self.flight, self.speed_up, self.follower = flight, speed_up, follower
        self.position_error, self.bearing_error = np.stack(position_and_bearing_errors(flight), axis=1)
        truth = flight.trajectory
        self.start, self.end = float(truth.time[0]), float(truth.time[-1])
        self.dt = flight.measurements[0].dt
        self.steps = self.start + self.dt * np.arange(1, self.position_error.shape[1] + 1)
        """Times of the filter steps, shape (n,), [s]."""
        names = truth.names
        self._transmitters = [truth.site(f"{names[0]}/{t}") for t in TRANSMITTERS]
        self._hydrophones = [truth.site(f"{name}/hydrophone") for name in names[1:]]
        followers = flight.scenario.followers
        self.on_stations = any(one.station for one in followers)
        self._stations = np.full((truth.time.size, len(followers), 3), np.nan)
        if self.on_stations:
            places = true_stations(flight.scenario, truth)
            self._stations[..., 0], self._stations[..., 1] = places.east, places.north
            self._stations[..., 2] = [-one.station.depth_m if one.station else np.nan for one in followers]
            self._stations[:, [one.station is None for one in followers]] = np.nan

    def step(self, time: float) -> int:
        """Number k of the last filter step before a mission time [s]; 0 before the first."""
        return min(int((time - self.start) / self.dt + 1e-9), self.steps.size)

    def at(self, time: float) -> FrameState:
        """State at a mission time [s]; ValueError if it lies outside the mission."""
        truth = self.flight.trajectory
        positions, quaternions = truth.at(time)
        position, quaternion = positions[0], quaternions[0]
        sites = position[truth.site_vehicle] + attitude.rotate(quaternion[truth.site_vehicle], truth.site_offset)
        place = (time - self.start) / truth.dt
        i = min(round(place), truth.time.size - 1)
        j, u = min(int(place), truth.time.size - 1), place % 1.0
        k = self.step(time)
        hydrophone = sites[self._hydrophones]
        followers = range(len(hydrophone))
        estimate = np.array([[*self._estimate(f, [time])[0], hydrophone[f, 2]] for f in followers])
        ray, ranges, kinds = zip(*(self._reception(f, k, time) for f in followers), strict=True)
        before = k == 0
        return FrameState(
            time=time,
            position=position,
            quaternion=quaternion,
            effectors=truth.thrust[i],
            heading=attitude.heading(quaternion),
            pitch=attitude.pitch(quaternion),
            speed=truth.forward_speed[i],
            transmitter=sites[self._transmitters],
            hydrophone=hydrophone,
            estimate=estimate,
            station=(1 - u) * self._stations[j] + u * self._stations[min(j + 1, truth.time.size - 1)],
            hypotheses=tuple(self._hypotheses(f, max(k, 1), estimate[f]) for f in followers),
            covariance=np.stack([self.flight.estimates[f].covariance[max(k, 1) - 1, :2, :2] for f in followers]),
            ray=np.stack(ray),
            ranges=np.stack(ranges),
            fix_kind=kinds,
            position_error=np.full(len(followers), np.nan) if before else self.position_error[:, k - 1],
            bearing_error=np.full(len(followers), np.nan) if before else self.bearing_error[:, k - 1],
        )

    def station_error(self, follower: int) -> Floats | None:
        """Horizontal distance from its station at filter steps, shape (n,), [m]; None for a follower on a route."""
        if self.flight.scenario.followers[follower].station is None:
            return None
        off = self.flight.hydrophone(follower) - self._stations[self.flight.step_index(), follower]
        return np.asarray(np.hypot(off[:, 0], off[:, 1]))

    def interpolated(self, values: Floats, times: Floats | Sequence[float]) -> Floats:
        """Values at filter steps, shape (n, c), at p other times, shape (p, c); constant beyond the ends."""
        return np.column_stack([np.interp(times, self.steps, column) for column in values.T])

    def _estimate(self, follower: int, times: Floats | Sequence[float]) -> Floats:
        return self.interpolated(self.flight.estimates[follower].state[:, :2], times)

    def _hypotheses(self, follower: int, k: int, now: Floats) -> tuple[Hypothesis, ...]:
        """Hypotheses after the last message before step k, moved as the estimate has moved since, to `now`."""
        estimates = self.flight.estimates[follower]
        last = int(np.searchsorted(estimates.fix_step, k, side="right")) - 1
        if last >= 0:
            weight, position, covariance = (values[last] for values in estimates.hypotheses)
            centre = position + now[:2] - estimates.fix_position[last]
            shown = np.flatnonzero(weight > _LEAST_WEIGHT)
            if shown.size > 1:
                return tuple(Hypothesis(float(weight[h]), np.array([*centre[h], now[2]]), covariance[h]) for h in shown)
        return (Hypothesis(1.0, now, estimates.covariance[k - 1, :2, :2]),)

    def _reception(self, follower: int, k: int, time: float) -> tuple[Floats, Floats, FixKind | None]:
        measured = self.flight.measurements[follower]
        last = int(np.searchsorted(measured.message_step, k, side="right")) - 1
        if last < 0:
            return np.zeros(3), np.full(3, np.nan), None
        age = (time - self.start - measured.message_step[last] * self.dt) / self.speed_up
        ranges = measured.ranges[last]
        fixes = self.flight.estimates[follower]
        made = int(np.searchsorted(fixes.fix_step, k, side="right")) - 1
        kind = FixKind(int(fixes.fix_kind[made])) if made >= 0 else None
        return np.where(np.isnan(ranges), 0.0, np.exp(-max(age, 0.0) / _AFTERGLOW_S)), ranges, kind

    @cached_property
    def _trails(self) -> tuple[Floats, Floats]:
        """Instants, shape (g,), [s], and points, shape (1 + 2 f, g, 3), [m], of all trails; see `trails`."""
        truth = self.flight.trajectory
        grid = truth.time[:: max(1, round(_TRAIL_POINT_S * self.speed_up / truth.dt))]
        hydrophones = [truth.site_at(f"{name}/hydrophone", grid) for name in truth.names[1:]]
        estimates = [np.column_stack([self._estimate(f, grid), path[:, 2]]) for f, path in enumerate(hydrophones)]
        return grid, np.stack([truth.at(grid)[0][:, 0], *hydrophones, *estimates])

    def trails(self, state: FrameState) -> Floats:
        """Recent positions of leader, followers' hydrophones and estimates, oldest first, shape (1 + 2 f, p, 3), [m].

        Points lie on a grid that stays in place while time goes on, or the trails would seem to crawl.
        """
        grid, points = self._trails
        shown = (grid <= state.time) & (grid >= state.time - _TRAIL_S * self.speed_up)
        now = np.vstack([state.position[:1], state.hydrophone, state.estimate])
        return np.concatenate([points[:, shown], now[:, None]], axis=1)
