"""What a film shows of a flight at any instant: a pure function of time, so that frames may be
drawn in any order.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Ints, freeze_arrays
from laisn.estimates import FixKind
from laisn.messages import Ranges
from sim import attitude
from sim.flight import FlightRecord, position_and_bearing_errors
from sim.scenario.parts import MotionSettings
from sim.tracking import true_stations

RGB = tuple[float, float, float]  # red, green, blue, each in [0, 1]

_AFTERGLOW_S = 0.45
"""Time constant of a ray's fading, in seconds of film: pings closer together than that blend
into a steady ray.
"""
_TRAIL_S = 5.0  # length of a trail, in seconds of film
_TRAIL_POINT_S = 0.04  # spacing of its points, in seconds of film
_MIN_WEIGHT = 0.01  # hypotheses of less weight are not shown

LEADER: RGB = (1.0, 0.68, 0.20)  # trail and label of the leader, after its hull
TRUTH: RGB = (1.0, 0.95, 0.25)  # trail and position of a follower, after its hull
ESTIMATE: RGB = (1.0, 0.25, 0.85)  # a follower's estimate of its own position
STATION: RGB = (0.45, 1.0, 1.0)  # station of a follower in formation
TRANSMITTER_COLOURS: tuple[RGB, ...] = ((0.95, 0.97, 1.0), (0.35, 1.0, 0.55), (0.45, 0.70, 1.0))
"""Rear, front and middle transmitter and their rays; distinct from leader and follower, also to
colour-blind eyes.
"""

_SHARES = (-1.0, 0.0, 1.0)
_COLOURS = np.array([[0.22, 0.56, 1.0], [0.97, 0.97, 0.95], [1.0, 0.26, 0.20]])
"""Blue for less, red for more; the middle is pale, so that it shows on a dark sea."""
_UNKNOWN: RGB = (0.45, 0.55, 0.60)


def diverging(shares: npt.ArrayLike) -> Floats:
    """Colours of values in [-1, 1], symmetric about 0 and constant beyond; shape (…) gives shape
    (…, 3); a grey for NaN.
    """
    values = np.asarray(shares, dtype=np.float64)
    colours = np.stack([np.interp(values, _SHARES, channel) for channel in _COLOURS.T], axis=-1)
    return np.where(np.isnan(values)[..., None], _UNKNOWN, colours)


@dataclass(frozen=True, kw_only=True)
class OtherEstimate:
    """Another navigator's estimate from the filmed follower's measurements."""

    label: str
    colour: RGB
    position: Floats  # estimated position (x, y) at filter steps k = 1 … n, shape (n, 2), [m]

    def __post_init__(self) -> None:
        freeze_arrays(self)


@dataclass(frozen=True, kw_only=True)
class RayErrors:
    """Errors that colour the rays of the filmed follower; ValueError if the limit is not
    positive.
    """

    label: str
    value: Floats
    """Error of each message's range from the rear, front, middle transmitter, shape (m, 3), [m];
    NaN where unknown.
    """
    limit: float  # value at the ends of the colour bar [m]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.limit) and self.limit > 0):
            raise ValueError(f"the colour bar ends at {self.limit:g} m, expected a positive number")
        freeze_arrays(self)


@dataclass(frozen=True, kw_only=True)
class Annotations:
    """What a study adds to a film: other estimates, errors that colour the rays; the default
    adds nothing.
    """

    caption: str = ""  # what the film shows: a line at the upper edge, with a legend
    label: str = "estimate"  # name of the follower's own estimate in the legend
    others: tuple[OtherEstimate, ...] = ()
    rays: RayErrors | None = None

    def ray_colours(self, message: int) -> tuple[RGB, ...]:
        """Colours of the filmed follower's rays, rear, front and middle; message -1 stands for
        none.
        """
        if self.rays is None:
            return TRANSMITTER_COLOURS
        shares = self.rays.value[message] / self.rays.limit if message >= 0 else np.full(3, np.nan)
        return tuple((float(r), float(g), float(b)) for r, g, b in diverging(shares))


NOTHING = Annotations()


class Hypothesis(NamedTuple):
    """One component of a follower's position estimate."""

    weight: float
    centre: Floats  # shape (3,), [m]; at the true depth
    covariance: Floats  # horizontal covariance, shape (2, 2), [m²]


@dataclass(frozen=True, kw_only=True)
class FilmFrame:
    """Everything one frame shows; v vehicles, f followers. Angles in [rad]."""

    time: float  # of the mission [s]
    film_time: float  # since the film began [s]
    position: Floats  # body origins in the world, shape (v, 3), [m]
    quaternion: Floats  # attitudes from body to world, (w, x, y, z), shape (v, 4)
    # states of the effectors, shape (v, m); units and padding as of `Trajectory.effector_states`
    effectors: Floats
    heading: Floats
    pitch: Floats  # shape (v,), as `heading`
    speed: Floats  # speed through the water, shape (v,), [m/s]
    transmitter: Floats  # transmitters in the world, rear, front and middle, shape (3, 3), [m]
    hydrophone: Floats  # hydrophones in the world, shape (f, 3), [m]
    # estimated hydrophone, shape (f, 3), [m]; drawn at the true depth, for the filter is planar
    estimate: Floats
    # other estimates of the filmed follower's hydrophone, shape (o, 3), [m]; likewise
    others: Floats
    covariance: Floats  # covariance of the estimated position, shape (f, 2, 2), [m²]
    # true stations of the followers, shape (f, 3), [m]; NaN for a follower on a route
    station: Floats
    hypotheses: tuple[tuple[Hypothesis, ...], ...]
    """Hypotheses of each follower's position; the estimate alone if there is only one."""
    # strength of each range's ray, 1 at the ping, 0 where nothing was received, shape (f, 3)
    ray: Floats
    ranges: Floats  # last slant ranges measured, shape (f, 3), [m]; NaN if none
    message: Ints  # index of the last message, shape (f,); -1 before the first
    fix_kind: tuple[FixKind | None, ...]  # outcome of the last message, per follower
    position_error: Floats  # E_P, shape (f,), [m]; NaN before the first step
    bearing_error: Floats  # E_B, shape (f,), [rad]; likewise


class FilmData:
    """A flight, ready to be filmed; see `FilmJob`. `speed_up` are seconds of mission in a second of
    film.
    """

    def __init__(
        self,
        flight: FlightRecord,
        speed_up: float,
        follower: int = 0,
        annotations: Annotations = NOTHING,
    ) -> None:
        self.flight = flight
        self.speed_up = speed_up
        self.follower = follower
        self.annotations = annotations
        self.position_error, self.bearing_error = np.stack(
            position_and_bearing_errors(flight), axis=1
        )
        truth = flight.trajectory
        self.start = float(truth.time[0])
        self.end = float(truth.time[-1])
        self.dt = flight.measurements[0].dt
        self.step_times = self.start + self.dt * np.arange(1, self.position_error.shape[1] + 1)
        """Times of the filter steps, shape (n,), [s]."""
        names = truth.names
        # indices of sites of the trajectory
        self._transmitters = [
            truth.site(f"{names[0]}/tx_{transmitter}") for transmitter in Ranges._fields
        ]
        self._hydrophones = [truth.site(f"{name}/hydrophone") for name in names[1:]]
        followers = flight.scenario.followers
        self.on_stations = any(follower_setup.station for follower_setup in followers)
        # true stations at the times of the trajectory, shape (times, f, 3), [m]
        self._stations = np.full((truth.time.size, len(followers), 3), np.nan)
        if self.on_stations:
            places = true_stations(MotionSettings.of(flight.scenario), truth)
            self._stations[..., 0] = places.east
            self._stations[..., 1] = places.north
            self._stations[..., 2] = [
                -follower_setup.station.depth_m if follower_setup.station else np.nan
                for follower_setup in followers
            ]
            self._stations[:, [follower_setup.station is None for follower_setup in followers]] = (
                np.nan
            )
        # followers, and their estimated positions at filter steps, shape (n, 2), [m]: their own
        # estimates, then the other ones of the filmed follower
        self._estimates = [
            *((f, estimates.state[:, :2]) for f, estimates in enumerate(flight.estimates)),
            *((follower, other.position) for other in annotations.others),
        ]

    def step(self, time: float) -> int:
        """Number k of the last filter step before a mission time [s]; 0 before the first."""
        return min(int((time - self.start) / self.dt + 1e-9), self.step_times.size)

    def at(self, time: float) -> FilmFrame:
        """State at a mission time [s]; ValueError if it lies outside the mission."""
        truth = self.flight.trajectory
        positions, quaternions = truth.at(time)
        position = positions[0]
        quaternion = quaternions[0]
        sites = position[truth.site_vehicle] + attitude.rotate(
            quaternion[truth.site_vehicle], truth.site_offset
        )
        index = (time - self.start) / truth.dt
        nearest = min(round(index), truth.time.size - 1)
        before = min(int(index), truth.time.size - 1)
        fraction = index % 1.0
        k = self.step(time)
        hydrophone = sites[self._hydrophones]
        followers = range(len(hydrophone))
        estimates = np.array(
            [[*self.interpolated(p, [time])[0], hydrophone[f, 2]] for f, p in self._estimates]
        )
        estimate = estimates[: len(hydrophone)]
        others = estimates[len(hydrophone) :]
        ray, ranges, message, kinds = zip(
            *(self._reception(f, k, time) for f in followers), strict=True
        )
        unknown = np.full(len(followers), np.nan)
        heading, pitch, _ = attitude.heading_pitch_roll(quaternion)
        return FilmFrame(
            time=time,
            film_time=(time - self.start) / self.speed_up,
            position=position,
            quaternion=quaternion,
            effectors=truth.effector_states[nearest],
            heading=heading,
            pitch=pitch,
            speed=truth.forward_speed[nearest],
            transmitter=sites[self._transmitters],
            hydrophone=hydrophone,
            estimate=estimate,
            others=others,
            station=(1 - fraction) * self._stations[before]
            + fraction * self._stations[min(before + 1, truth.time.size - 1)],
            hypotheses=tuple(self._hypotheses(f, max(k, 1), estimate[f]) for f in followers),
            covariance=np.stack(
                [self.flight.estimates[f].covariance[max(k, 1) - 1, :2, :2] for f in followers]
            ),
            ray=np.stack(ray),
            ranges=np.stack(ranges),
            message=np.array(message),
            fix_kind=kinds,
            position_error=self.position_error[:, k - 1] if k else unknown,
            bearing_error=self.bearing_error[:, k - 1] if k else unknown,
        )

    def station_error(self, follower: int) -> Floats | None:
        """Horizontal distance from its station at filter steps, shape (n,), [m]; None for a
        follower on a route.
        """
        if self.flight.scenario.followers[follower].station is None:
            return None
        offsets = (
            self.flight.hydrophone(follower) - self._stations[self.flight.step_index(), follower]
        )
        return np.asarray(np.hypot(offsets[:, 0], offsets[:, 1]))

    def interpolated(self, values: Floats, times: Floats | Sequence[float]) -> Floats:
        """Values at filter steps, shape (n, c), at p other times, shape (p, c); constant beyond
        the ends.
        """
        return np.column_stack([np.interp(times, self.step_times, column) for column in values.T])

    def _hypotheses(self, follower: int, k: int, state: Floats) -> tuple[Hypothesis, ...]:
        """Hypotheses after the last message before step k, moved as the estimate has moved
        since, to `state`.
        """
        estimates = self.flight.estimates[follower]
        last = int(np.searchsorted(estimates.fix_step, k, side="right")) - 1
        if last >= 0:
            weight, position, covariance = (values[last] for values in estimates.hypotheses)
            centre = position + state[:2] - estimates.fix_position[last]
            visible = np.flatnonzero(weight > _MIN_WEIGHT)
            if visible.size > 1:
                return tuple(
                    Hypothesis(float(weight[h]), np.array([*centre[h], state[2]]), covariance[h])
                    for h in visible
                )
        return (Hypothesis(1.0, state, estimates.covariance[k - 1, :2, :2]),)

    def _reception(
        self, follower: int, k: int, time: float
    ) -> tuple[Floats, Floats, int, FixKind | None]:
        """`FilmFrame.ray`, `ranges`, `message` and `fix_kind` of a follower at step k."""
        measured = self.flight.measurements[follower]
        last = int(np.searchsorted(measured.message_step, k, side="right")) - 1
        if last < 0:
            return np.zeros(3), np.full(3, np.nan), -1, None
        age = (time - self.start - measured.message_step[last] * self.dt) / self.speed_up
        ranges = measured.ranges[last]
        estimates = self.flight.estimates[follower]
        latest = int(np.searchsorted(estimates.fix_step, k, side="right")) - 1
        kind = FixKind(int(estimates.fix_kind[latest])) if latest >= 0 else None
        return (
            np.where(np.isnan(ranges), 0.0, np.exp(-max(age, 0.0) / _AFTERGLOW_S)),
            ranges,
            last,
            kind,
        )

    @cached_property
    def _trails(self) -> tuple[Floats, Floats]:
        """Instants, shape (g,), [s], and points, shape (v + f + o, g, 3), [m], of all trails;
        see `trails`.
        """
        truth = self.flight.trajectory
        grid = truth.time[:: max(1, round(_TRAIL_POINT_S * self.speed_up / truth.dt))]
        hydrophones = [truth.site_at(f"{name}/hydrophone", grid) for name in truth.names[1:]]
        estimates = [
            np.column_stack([self.interpolated(positions, grid), hydrophones[f][:, 2]])
            for f, positions in self._estimates
        ]
        return grid, np.stack([truth.at(grid)[0][:, 0], *hydrophones, *estimates])

    def trails(self, state: FilmFrame) -> Floats:
        """Recent positions, oldest first, shape (v + f + o, p, 3), [m].

        The leader's body origin, the followers' hydrophones, their estimates, the other estimates.
        Points lie on a grid that stays in place while time goes on, or the trails would seem to
        crawl.
        """
        grid, points = self._trails
        recent = (grid <= state.time) & (grid >= state.time - _TRAIL_S * self.speed_up)
        latest = np.vstack([state.position[:1], state.hydrophone, state.estimate, state.others])
        return np.concatenate([points[:, recent], latest[:, None]], axis=1)
