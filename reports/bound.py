"""The Cramér–Rao bound of a mission or a flight, for dead reckoning that takes log and compass
as input.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.bound import BoundGeometry, TrueNoise, position_bound, position_bounds
from laisn.messages import LeaderMessage, Measurements
from laisn.settings import Assume, TightSettings
from laisn.tight.model import model_of
from laisn.tight.motion import LEADER_WAY_SIGMA
from sim.flight import FlightRecord
from sim.scenario.parts import SensingSettings, sensing_of_each
from sim.scenario.section import in_si
from sim.scenario.settings import CONTROL_STEP_S, Navigation
from sim.sensing import acoustics
from sim.sensing.links import navigated_motion
from sim.sensing.observation import propagate
from sim.sensing.sensors import navigated_errors_of
from sim.trajectory import Trajectory

# standard deviation of |N(0, 1)|, as which compasses err (Eq. 27)
_FOLDED_NORMAL_SIGMA = float(np.sqrt(1.0 - 2.0 / np.pi))
# the tight navigator's model with drifting biases; its walks are variances a second, those of log
# and compass for each of its modes of drift
_DRIFTING_MODEL = model_of(TightSettings(assume=Assume(drift=True)))
_TIMESTAMP = LeaderMessage._fields.index("timestamp")
_UNIFORM_SIGMA = 1.0 / float(np.sqrt(12.0))  # of a uniform distribution of width 1
# from so many instants of all followers on, compiled code follows the sound: it takes ten seconds
# to compile once, Python 6 µs an instant
_MANY_INSTANTS = 300_000


def noise_of(sensing: SensingSettings, navigation: Navigation, follower: int = 0) -> TrueNoise:
    """What is truly random in a mission; of biases, what `navigation.assume` states as known
    before it.

    Leader's compass and current are unknown only where the mission has such errors, or has them
    estimated, transmitters' offsets and the clock only where they are estimated: a bound for
    estimators with less prior information would be too high. Biases that are assumed to drift, an
    estimated current and the clock walk as the navigator assumes.
    """
    errors = navigated_errors_of(sensing, follower)
    assumed = in_si(dict(navigation.assume))
    estimated = navigation.estimated
    drift = navigation.assume.drift
    moves = sensing.has_current
    # of the sender of the link that is navigated on; beacons have no compass
    has_leader_heading_bias = errors.leader_heading_bias != 0.0 or (
        "leader_heading_bias" in estimated
    )
    clock = "clock" in estimated
    acoustic_settings = sensing.acoustics
    # metres that a second of the clock makes in a range; a clock that is not estimated is right
    assumed_speed = acoustic_settings.sound_speed_m_s + acoustic_settings.sound_speed_bias_m_s
    metres_per_s = assumed_speed if clock else 0.0
    return TrueNoise(
        speed_sigma=errors.speed_sigma,
        heading_sigma=errors.heading_sigma * _FOLDED_NORMAL_SIGMA,
        # τ is the width in which a range's error is uniform, one for each transmitter
        range_sigma=float(np.sqrt(np.mean(np.square(errors.range_tau)))) * _UNIFORM_SIGMA,
        range_scale_sigma=errors.range_scale_sigma,
        leader_heading_sigma=errors.leader_heading_sigma * _FOLDED_NORMAL_SIGMA,
        leader_position_sigma=errors.leader_position_sigma,
        **{
            name: assumed[f"{name}_sigma"]
            for name in ("speed_bias", "heading_bias", "range_scale_bias")
        },
        leader_heading_bias=assumed["leader_heading_bias_sigma"]
        if has_leader_heading_bias
        else 0.0,
        current=assumed["current_sigma"] if moves or "current" in estimated else 0.0,
        range_offset=assumed["offset_sigma"] if "range_offset" in estimated else 0.0,
        clock_offset=metres_per_s * assumed["clock_offset_sigma"],
        clock_drift=metres_per_s * assumed["clock_drift_sigma"],
        speed_walk=math.sqrt(_DRIFTING_MODEL.log_walk[0]) if drift else 0.0,
        heading_walk=math.sqrt(_DRIFTING_MODEL.compass_walk[0]) if drift else 0.0,
        current_walk=math.sqrt(_DRIFTING_MODEL.current_walk) if "current" in estimated else 0.0,
        clock_walk=math.sqrt(_DRIFTING_MODEL.clock_walk) if clock else 0.0,
        leader_way_sigma=LEADER_WAY_SIGMA
        if estimated & {"current", "leader_heading_bias"}
        else 0.0,
    )


class _Messages(NamedTuple):
    """m messages that one follower received, by filter steps since the begin of a motion."""

    arrived_step: Ints  # shape (m,)
    sent_step: Ints  # shape (m,)
    # where the rear, front and middle ping left, shape (m, 3, 3), the last axis in the world, [m]
    transmitter: Floats


def geometry_of(
    trajectory: Trajectory,
    sensing: SensingSettings,
    follower: int = 0,
    received: Bools | None = None,
) -> BoundGeometry:
    """The true geometry of a mission as one follower's sensors meet it.

    Args:
        trajectory: of the mission.
        sensing: of the mission.
        follower: its index, 0 for the first.
        received: of which of the m messages each ping arrived, shape (m, 3); None: all did.
    """
    motion = navigated_motion(trajectory, sensing.links)
    first = round(float(motion.time[0]) / sensing.links.filter_step_s)
    is_large = (len(motion.names) - 1) * motion.time.size >= _MANY_INSTANTS
    # None leaves the choice to `propagate`
    receptions = propagate(trajectory, sensing, follower, use_compiled=is_large or None)
    messages = _Messages(
        receptions.message_step - first, receptions.emission_step - first, receptions.transmitter
    )
    return _geometry(motion, sensing, follower, messages, received)


def _geometry(
    motion: Trajectory,
    sensing: SensingSettings,
    follower: int,
    messages: _Messages,
    ping_received: Bools | None,
) -> BoundGeometry:
    """As `geometry_of`, in a motion of `navigated_motion`, from the messages of a follower."""
    dt = sensing.links.filter_step_s
    stride = round(dt / CONTROL_STEP_S)
    n = (motion.time.size - 1) // stride
    instants = np.arange(1, n + 1) * stride
    sent = messages.sent_step * stride
    hydrophone = motion.site_path(
        f"{motion.names[follower + 1]}/hydrophone", messages.arrived_step * stride
    )
    leader = motion.position[sent, 0, :2]
    count = sensing.transmitters
    # transmitters from the leader's origin: east, north, and how much deeper than the hydrophone
    arms = messages.transmitter[:, :count].copy()
    arms[..., :2] -= leader[:, None]
    arms[..., 2] = hydrophone[:, None, 2] - arms[..., 2]
    if ping_received is not None:
        arms[~ping_received[:, :count]] = np.nan
    return BoundGeometry(
        dt=dt,
        speed=motion.forward_speed[instants, follower + 1],
        heading=motion.heading[instants, follower + 1],
        message_step=messages.arrived_step,
        from_leader=hydrophone[:, :2] - leader,
        arms=arms,
        leader_velocity=motion.velocity[sent, 0, :2] - motion.water_velocity[sent, 0, :2],
    )


class _Broadcasts:
    """The messages of one link that the followers of a flight navigate on."""

    def __init__(self, flight: FlightRecord, sensing: SensingSettings) -> None:
        """`sensing` is that of any of these followers."""
        self._dt = sensing.links.filter_step_s
        self._sound = acoustics.sound_of(sensing)
        self._pings = dict[int, Floats]()
        self.motion = navigated_motion(flight.trajectory, sensing.links)
        """With the sender in the leader's place."""
        self._vehicle_motion = acoustics.motion_of(self.motion)
        sites = [self.motion.site(name) for name in acoustics.TRANSMITTERS]
        self._offsets = self.motion.site_offset[sites].tolist()

    def _transmitters(self, step: int) -> Floats:
        """Where the pings of the message of a filter step of the mission left, shape (3, 3),
        [m].
        """
        if step not in self._pings:
            first_ping_s = step * self._dt + self._sound.lead
            self._pings[step] = np.array(
                [
                    acoustics.site_at(
                        self._sound.on_grid,
                        self._vehicle_motion,
                        0,
                        offset,
                        first_ping_s + i * self._sound.slot,
                    )
                    for i, offset in enumerate(self._offsets)
                ]
            )
        return self._pings[step]

    def received(self, measurements: Measurements) -> _Messages:
        """What a follower's measurements have of them."""
        first = round(float(self.motion.time[0]) / self._dt)
        sent = np.rint(measurements.message[:, _TIMESTAMP] / self._dt).astype(np.int64)
        transmitter = np.empty((sent.size, 3, 3))
        for i, step in enumerate(sent.tolist()):
            transmitter[i] = self._transmitters(step)
        # an excerpt of a flight may begin while a message is on its way
        return _Messages(measurements.message_step, np.maximum(sent - first, 0), transmitter)


def mission_bound(
    trajectory: Trajectory, sensing: SensingSettings, navigation: Navigation, follower: int = 0
) -> Floats:
    """Least RMS of a follower's position error after each step, shape (n,), [m], in a mission of
    which it receives all pings, by its own navigation. NaN, which is no bound, if it takes the
    messages of several links, or where ranges have no random errors.
    """
    if navigation.further_links:
        stride = round(sensing.links.filter_step_s / CONTROL_STEP_S)
        return np.full((trajectory.time.size - 1) // stride, np.nan)
    geometry = geometry_of(trajectory, sensing, follower)
    return least_rms(geometry, noise_of(sensing, navigation, follower))


def least_rms(geometry: BoundGeometry, noise: TrueNoise, lag: float = 0.0) -> Floats:
    """Least RMS of the position error after each step, shape (n,), [m]; with messages of up to a
    lag later [s]. NaN, which is no bound, where ranges have no random errors.
    """
    return _rms(position_bound(geometry, noise, lag=lag))


def _rms(covariance: Floats) -> Floats:
    """RMS of positions with covariances of shape (n, 2, 2), shape (n,), [m]."""
    return np.asarray(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))


def flight_bounds(
    flight: FlightRecord, followers: Sequence[int] | None = None, lag: float = 0.0
) -> list[Floats]:
    """Least RMS of followers' position errors after each step, of each follower's shape (n,), [m],
    from the pings that it received; None: of all. NaN, which is no bound, of one that takes the
    messages of several links, or whose ranges have no random errors.

    With a lag [s], messages of up to so much later are used too. Ranges, log and compass are those
    of this flight, with constant biases: sideslip, drift and echoes only raise what can be reached.
    """
    sensing_of = sensing_of_each(flight.scenario)
    links = dict[str, _Broadcasts]()
    geometries = []
    noises = []
    chosen = [*range(len(sensing_of))] if followers is None else [*followers]
    # what further links tell is not in the geometry
    bounded = [i for i in chosen if not flight.scenario.navigation_of(i).further_links]
    for i in bounded:
        sensing = sensing_of[i]
        link = sensing.links.main
        if link not in links:
            links[link] = _Broadcasts(flight, sensing)
        messages = links[link].received(flight.measurements[i])
        ping_received = np.isfinite(flight.measurements[i].ranges)
        geometries.append(_geometry(links[link].motion, sensing, i, messages, ping_received))
        noises.append(noise_of(sensing, flight.scenario.navigation_of(i), i))
    bounds = {i: np.full(flight.measurements[i].speed.size, np.nan) for i in chosen}
    if bounded:
        covariances = position_bounds(geometries, noises, lag=lag)
        bounds |= {i: _rms(covariance) for i, covariance in zip(bounded, covariances, strict=True)}
    return [bounds[i] for i in chosen]


def flight_bound(flight: FlightRecord, follower: int, lag: float = 0.0) -> Floats:
    """`flight_bounds` of one follower."""
    return flight_bounds(flight, [follower], lag)[0]
