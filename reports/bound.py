"""The Cramér–Rao bound of a mission or a flight, for dead reckoning that takes log and compass
as input.
"""

import math

import numpy as np

from laisn.arrays import Bools, Floats
from laisn.bound import BoundGeometry, TrueNoise, position_bound
from laisn.settings import Assume, TightSettings
from laisn.tight.model import model_of
from laisn.tight.motion import CURRENT_SIGMA
from sim.flight import FlightRecord
from sim.scenario.parts import SensingSettings
from sim.scenario.section import in_si
from sim.scenario.settings import CONTROL_STEP_S, Navigation
from sim.sensing.links import navigated_motion
from sim.sensing.observation import propagate
from sim.sensing.sensors import navigated_errors_of
from sim.trajectory import Trajectory

# standard deviation of |N(0, 1)|, as which compasses err (Eq. 27)
_ABOUT_MEAN = float(np.sqrt(1.0 - 2.0 / np.pi))
# drift of the tightly coupled navigator's biases
_WALKS = model_of(TightSettings(assume=Assume(drift=True)))
_UNIFORM = 1.0 / float(np.sqrt(12.0))
# from so many instants of all followers on, compiled code follows the sound: it takes ten seconds
# to compile once, Python 6 µs an instant
_MANY_INSTANTS = 300_000


def noise_of(sensing: SensingSettings, navigation: Navigation, follower: int = 0) -> TrueNoise:
    """What is truly random in a mission; of biases, what `navigation.assume` states as known
    before it.

    Leader's compass, current, transmitters' offsets and the clock are unknown only where the
    mission has such errors, or has them estimated: a bound for estimators with less prior
    information would be too high. Biases that are assumed to drift, an estimated current and the
    clock walk as the navigator assumes.
    """
    errors = navigated_errors_of(sensing, follower)
    assumed = in_si(dict(navigation.assume))
    estimated = navigation.settings().estimated
    drift = navigation.assume.drift
    moves = sensing.sound.sea.ocean.moves
    has_heading_bias = (
        sensing.sensors.leader_heading_bias_deg != 0.0 or "leader_heading_bias" in estimated
    )
    clock = "clock" in estimated
    acoustics = sensing.acoustics
    sound = (acoustics.sound_speed_m_s + acoustics.sound_speed_bias_m_s) * clock
    return TrueNoise(
        speed_sigma=errors.speed_sigma,
        heading_sigma=errors.heading_sigma * _ABOUT_MEAN,
        range_sigma=float(np.sqrt(np.mean(np.square(errors.range_tau)))) * _UNIFORM,
        range_scale_sigma=errors.range_scale_sigma,
        leader_heading_sigma=errors.leader_heading_sigma * _ABOUT_MEAN,
        leader_position_sigma=errors.leader_position_sigma,
        **{
            name: assumed[f"{name}_sigma"]
            for name in ("speed_bias", "heading_bias", "range_scale_bias")
        },
        leader_heading_bias=assumed["leader_heading_bias_sigma"] if has_heading_bias else 0.0,
        current=assumed["current_sigma"] if moves or "current" in estimated else 0.0,
        range_offset=assumed["offset_sigma"] if "range_offset" in estimated else 0.0,
        clock_offset=sound * assumed["clock_offset_sigma"],
        clock_drift=sound * assumed["clock_drift_sigma"],
        speed_walk=math.sqrt(_WALKS.log_walk[0]) if drift else 0.0,
        heading_walk=math.sqrt(_WALKS.compass_walk[0]) if drift else 0.0,
        current_walk=math.sqrt(_WALKS.current_walk) if "current" in estimated else 0.0,
        clock_walk=math.sqrt(_WALKS.clock_walk) if clock else 0.0,
        leader_way_sigma=CURRENT_SIGMA if estimated & {"current", "leader_heading_bias"} else 0.0,
    )


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
    trajectory = navigated_motion(trajectory, sensing.links)
    dt = sensing.links.filter_step_s
    stride = round(dt / CONTROL_STEP_S)
    first = round(float(trajectory.time[0]) / dt)
    n = (trajectory.time.size - 1) // stride
    instants = np.arange(1, n + 1) * stride
    is_large = (len(trajectory.names) - 1) * trajectory.time.size >= _MANY_INSTANTS
    sound = propagate(trajectory, sensing, follower, use_compiled=is_large or None)
    arrived = sound.message_step - first
    sent = (sound.emission_step - first) * stride
    hydrophone = trajectory.site_path(
        f"{trajectory.names[follower + 1]}/hydrophone", arrived * stride
    )
    leader = trajectory.position[sent, 0, :2]
    used = sensing.transmitters
    arms = sound.transmitter[:, :used].copy()
    arms[..., :2] -= leader[:, None]
    arms[..., 2] = hydrophone[:, None, 2] - arms[..., 2]
    if received is not None:
        arms[~received[:, :used]] = np.nan
    return BoundGeometry(
        dt=dt,
        speed=trajectory.forward_speed[instants, follower + 1],
        heading=trajectory.heading[instants, follower + 1],
        message_step=arrived,
        from_leader=hydrophone[:, :2] - leader,
        arms=arms,
        leader_velocity=trajectory.velocity[sent, 0, :2] - trajectory.water_velocity[sent, 0, :2],
    )


def least_rms(geometry: BoundGeometry, noise: TrueNoise, lag: float = 0.0) -> Floats:
    """Least RMS of the position error after each step, shape (n,), [m]; with messages of up to a
    lag later [s].
    """
    return np.asarray(np.sqrt(np.trace(position_bound(geometry, noise, lag=lag), axis1=1, axis2=2)))


def flight_bound(flight: FlightRecord, follower: int = 0, lag: float = 0.0) -> Floats:
    """Least RMS of one follower's position error after each step, shape (n,), [m], from the pings
    that it received.

    With a lag [s], messages of up to so much later are used too. Ranges, log and compass are those
    of this flight, with constant biases: sideslip, drift and echoes only raise what can be reached.
    """
    scenario = flight.scenario.navigated_as(follower)
    sensing = SensingSettings.of(scenario)
    received = np.isfinite(flight.measurements[follower].ranges)
    geometry = geometry_of(flight.trajectory, sensing, follower, received)
    noise = noise_of(sensing, scenario.navigation, follower)
    return least_rms(geometry, noise, lag)
