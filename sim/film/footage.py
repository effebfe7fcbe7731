"""What a film shows of a flight at any instant: a pure function of time, so that frames may be made in any order."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.estimates import FixKind
from laisn.tight.estimates import TightEstimates
from sim.flight import Flight
from sim.geometry import attitude

TRANSMITTERS = ("tx_rear", "tx_front", "tx_middle")

_AFTERGLOW_S = 0.45
"""Time constant of a ray's fading, in seconds of film: pings closer together than that blend into a steady ray."""
_TRAIL_POINT_S = 0.04
"""Spacing of the points of a trail, in seconds of film."""
_LEAST_WEIGHT = 0.01
"""Hypotheses of less weight are not shown."""
_SPIN_RAD_S_N = 1.6
"""Turning rate of a drawn propeller, in film time, for one √N of thrust; slow enough for the eye."""


class Side(NamedTuple):
    """One of the places where a follower believes that it may be."""

    weight: float
    centre: Floats
    """Shape (3,), [m]; at the true depth."""
    covariance: Floats
    """Horizontal covariance, shape (2, 2), [m²]."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """Everything one frame shows; v vehicles, f followers. Angles in [rad]."""

    time: float
    """Time of the mission [s]."""
    film_time: float
    """Time since the film began [s]."""
    position: Floats
    """Body origins in the world, shape (v, 3), [m]."""
    quaternion: Floats
    """Attitudes from body to world, (w, x, y, z), shape (v, 4)."""
    heading: Floats
    """Shape (v,)."""
    pitch: Floats
    """Shape (v,)."""
    speed: Floats
    """Speed through the water, shape (v,), [m/s]."""
    thrust: Floats
    """Thrust of each thruster, shape (v, 5), [N]."""
    spin: Floats
    """Angle of the drawn propellers, shape (v,)."""
    transmitter: Floats
    """Transmitters in the world, rear, front and middle, shape (3, 3), [m]."""
    hydrophone: Floats
    """Hydrophones in the world, shape (f, 3), [m]."""
    estimate: Floats
    """Estimated hydrophone, shape (f, 3), [m]; drawn at the true depth, for the filter is planar."""
    covariance: Floats
    """Covariance of the estimated position, shape (f, 2, 2), [m²]."""
    sides: tuple[tuple[Side, ...], ...]
    """Where else the follower may be, as it believes, per follower; its one estimate if it believes in one place."""
    ray: Floats
    """Strength of each range's ray, 1 at the ping, 0 where nothing was received, shape (f, 3)."""
    ranges: Floats
    """Last slant ranges measured, shape (f, 3), [m]; NaN if none."""
    message: Ints
    """Index of the last message, shape (f,); -1 before the first."""
    fix_kind: tuple[FixKind | None, ...]
    """What became of the last message, per follower."""
    position_error: Floats
    """E_P, shape (f,), [m]; NaN before the first step."""
    bearing_error: Floats
    """E_B, shape (f,); NaN before the first step."""


class Footage:
    """A flight, ready to be filmed.

    Args:
        flight: the mission.
        errors: E_P [m] and E_B [rad] of each follower at steps k = 1 … n, each of shape (n,).
        speed_up: seconds of mission in a second of film.

    Raises:
        ValueError: the errors do not fit the flight.
    """

    def __init__(self, flight: Flight, errors: Sequence[tuple[Floats, Floats]], speed_up: float) -> None:
        n = flight.measurements[0].speed.size
        if len(errors) != len(flight.measurements) or any(e.shape != (n,) for pair in errors for e in pair):
            raise ValueError(
                f"a film of {len(flight.measurements)} followers and {n} steps needs a pair of errors for each "
                f"follower, of shape ({n},); got shapes {[tuple(e.shape for e in pair) for pair in errors]}"
            )
        self.flight = flight
        self.speed_up = speed_up
        self.position_error = np.stack([e for e, _ in errors])
        self.bearing_error = np.stack([e for _, e in errors])
        truth = flight.trajectory
        self.start, self.end = float(truth.time[0]), float(truth.time[-1])
        self._dt = flight.measurements[0].dt
        names = truth.names
        self._transmitters = [truth.site(f"{names[0]}/{t}") for t in TRANSMITTERS]
        self._hydrophones = [truth.site(f"{name}/hydrophone") for name in names[1:]]
        main = truth.thrust[..., 0]
        rate = _SPIN_RAD_S_N * np.sign(main) * np.sqrt(np.abs(main))
        self._spin = np.cumsum(rate, axis=0) * truth.dt / speed_up
        self._believed: dict[int, Floats] = {}
        self._trail_every = max(1, round(_TRAIL_POINT_S * speed_up / truth.dt))

    def at(self, time: float) -> Moment:
        """The moment `time` [s] of the mission.

        Raises:
            ValueError: the time lies outside the mission.
        """
        truth = self.flight.trajectory
        positions, quaternions = truth.at(time)
        position, quaternion = positions[0], quaternions[0]
        sites = position[truth.site_vehicle] + attitude.rotate(quaternion[truth.site_vehicle], truth.site_offset)
        place = (time - self.start) / truth.dt
        i = min(round(place), truth.time.size - 1)
        k = min(int((time - self.start) / self._dt + 1e-9), self.position_error.shape[1])
        followers = range(len(self._hydrophones))
        hydrophone = sites[self._hydrophones]
        ray, ranges, message, kinds = zip(*(self._reception(f, k, time) for f in followers), strict=True)
        before = k == 0
        return Moment(
            time=time,
            film_time=(time - self.start) / self.speed_up,
            position=position,
            quaternion=quaternion,
            heading=attitude.heading(quaternion),
            pitch=attitude.pitch(quaternion),
            speed=truth.forward_speed[i],
            thrust=truth.thrust[i],
            spin=np.array([np.interp(place, np.arange(s.size), s) for s in self._spin.T]),
            transmitter=sites[self._transmitters],
            hydrophone=hydrophone,
            estimate=np.stack([self._estimate(f, time, float(hydrophone[f, 2])) for f in followers]),
            sides=tuple(self._sides(f, max(k, 1), time, float(hydrophone[f, 2])) for f in followers),
            covariance=np.stack([self.flight.estimates[f].covariance[max(k, 1) - 1, :2, :2] for f in followers]),
            ray=np.stack(ray),
            ranges=np.stack(ranges),
            message=np.array(message),
            fix_kind=kinds,
            position_error=np.full(len(followers), np.nan) if before else self.position_error[:, k - 1],
            bearing_error=np.full(len(followers), np.nan) if before else self.bearing_error[:, k - 1],
        )

    def _estimate(self, follower: int, time: float, z: float) -> Floats:
        """Estimated position, carried on by the estimated velocity from the last step to `time`."""
        state = self.flight.estimates[follower].state
        k = min(max(int((time - self.start) / self._dt + 1e-9), 1), state.shape[0])
        x, y, vx, vy = state[k - 1]
        late = time - self.start - k * self._dt
        return np.array([x + vx * late, y + vy * late, z])

    def _sides(self, follower: int, k: int, time: float, z: float) -> tuple[Side, ...]:
        """Hypotheses after the last message before step k, moved as the estimate has moved since."""
        estimates, now = self.flight.estimates[follower], self._estimate(follower, time, z)
        one = (Side(1.0, now, estimates.covariance[k - 1, :2, :2]),)
        made = int(np.searchsorted(estimates.fix_step, k, side="right")) - 1
        if not isinstance(estimates, TightEstimates) or made < 0:
            return one
        believed = np.flatnonzero(estimates.weight[made] > _LEAST_WEIGHT)
        if believed.size < 2:
            return one
        moved = now - [*estimates.full_state[made, :2], z]
        places = np.column_stack([estimates.hypothesis[made], np.full(len(estimates.weight[made]), z)]) + moved
        spread = estimates.hypothesis_covariance[made]
        return tuple(Side(float(estimates.weight[made, h]), places[h], spread[h]) for h in believed.tolist())

    def _reception(self, follower: int, k: int, time: float) -> tuple[Floats, Floats, int, FixKind | None]:
        measured = self.flight.measurements[follower]
        last = int(np.searchsorted(measured.message_step, k, side="right")) - 1
        if last < 0:
            return np.zeros(3), np.full(3, np.nan), -1, None
        step = int(measured.message_step[last])
        age = (time - self.start - step * self._dt) / self.speed_up
        ranges = measured.ranges[last]
        fixes = self.flight.estimates[follower]
        made = int(np.searchsorted(fixes.fix_step, k, side="right")) - 1
        kind = FixKind(int(fixes.fix_kind[made])) if made >= 0 else None
        return np.where(np.isnan(ranges), 0.0, np.exp(-max(age, 0.0) / _AFTERGLOW_S)), ranges, last, kind

    def _trail_part(self, time: float, film_seconds: float) -> slice:
        """Points of a trail on their grid; they stay put while time goes on, or the trail would seem to crawl."""
        every, dt = self._trail_every, self.flight.trajectory.dt
        now = int((time - self.start) / dt)
        first = max(0, int(now - film_seconds * self.speed_up / dt))
        return slice(-(-first // every), now // every + 1)

    @cached_property
    def _trail_grid(self) -> Floats:
        """Instants of the points of all trails, shape (g,), [s]."""
        return self.flight.trajectory.time[:: self._trail_every]

    def _places(self, vehicle: int, times: Floats) -> Floats:
        """Where a trail runs: the leader's body origin, or a follower's hydrophone; shape (n, 3), [m]."""
        truth = self.flight.trajectory
        if vehicle:
            return truth.site_at(f"{truth.names[vehicle]}/hydrophone", times)
        return np.asarray(truth.at(times)[0][:, 0])

    @cached_property
    def _trails(self) -> list[Floats]:
        """All points of each vehicle's trail, shapes (g, 3), [m]."""
        return [self._places(v, self._trail_grid) for v in range(len(self.flight.trajectory.names))]

    def _estimates(self, follower: int) -> Floats:
        """All points of the trail of a follower's estimate, at the true depth, shape (g, 3), [m]."""
        if follower not in self._believed:
            points = zip(self._trail_grid.tolist(), self._trails[follower + 1][:, 2].tolist(), strict=True)
            self._believed[follower] = np.array([self._estimate(follower, t, z) for t, z in points])
        return self._believed[follower]

    def trail(self, vehicle: int, time: float, film_seconds: float) -> Floats:
        """Positions of a vehicle in the last `film_seconds` of film, oldest first, shape (p, 3), [m].

        They are those of the leader's body origin, but of a follower's hydrophone, for that is what it estimates.
        """
        past = self._trails[vehicle][self._trail_part(time, film_seconds)]
        return np.vstack([past, self._places(vehicle, np.array([time]))])

    def estimate_trail(self, follower: int, time: float, film_seconds: float) -> Floats:
        """Estimated positions in the last `film_seconds` of film, at the true depth, shape (p, 3), [m]."""
        past = self._estimates(follower)[self._trail_part(time, film_seconds)]
        depth = float(self._places(follower + 1, np.array([time]))[0, 2])
        return np.vstack([past, self._estimate(follower, time, depth)])

    def on_plane(self, follower: int, positions: Floats, times: Floats) -> Floats:
        """Positions known at filter steps, at other times and at the hydrophone's depth; shapes (n, 2) to (p, 3), [m].

        Linear between the steps, constant before the first and after the last.
        """
        steps = self.start + self._dt * np.arange(1, len(positions) + 1)
        x, y = (np.interp(times, steps, values) for values in positions.T)
        truth = self.flight.trajectory
        return np.stack([x, y, truth.site_at(f"{truth.names[follower + 1]}/hydrophone", times)[:, 2]], axis=1)

    def trail_times(self, time: float, film_seconds: float) -> Floats:
        """Instants of the points of a trail, oldest first, shape (p,), [s]."""
        return np.append(self._trail_grid[self._trail_part(time, film_seconds)], time)
