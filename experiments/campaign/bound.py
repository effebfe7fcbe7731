"""The Cramér–Rao bound of a mission or a flight, for dead reckoning that takes log and compass as input."""

import math

import numpy as np

from laisn.arrays import Bools, Floats
from laisn.bound import Geometry, TrueNoise, position_bound
from laisn.settings import Assume, TightSettings
from laisn.tight.model import model_of
from laisn.tight.motion import CURRENT_SIGMA
from sim.flight import Flight
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.acoustics import propagate
from sim.trajectory import Trajectory

_ABOUT_MEAN = float(np.sqrt(1.0 - 2.0 / np.pi))
"""Standard deviation of |N(0, 1)|, as which compasses err (paper, Eq. 27)."""
_WALKS = model_of(TightSettings(assume=Assume(drift=True)))
"""How fast the tightly coupled navigator lets biases drift, in its slow mode."""
_UNIFORM = 1.0 / float(np.sqrt(12.0))


def noise_of(scenario: Scenario, follower: int = 0) -> TrueNoise:
    """What is truly random in a scenario; of biases, what `navigation.assume` states as known before the mission.

    Leader's compass, current, transmitters' offsets and the clock are unknown only where the scenario has such errors,
    or has them estimated: a bound for estimators with less prior information would be too high. Biases that
    are assumed to drift, an estimated current and the clock walk as the navigator assumes.
    """
    own, sensors, acoustics = scenario.sensors_of(follower), scenario.sensors, scenario.acoustics
    assume, estimated = scenario.navigation.assume, scenario.navigation.settings().estimated
    turned = sensors.leader_heading_bias_deg != 0.0 or "leader_heading_bias" in estimated
    moving = scenario.ocean.moves or "current" in estimated
    late, clock = "range_offset" in estimated, "clock" in estimated
    sound = acoustics.sound_speed_m_s + acoustics.sound_speed_bias_m_s
    return TrueNoise(
        speed_sigma=own.speed_sigma_m_s,
        heading_sigma=float(np.deg2rad(own.heading_sigma_deg)) * _ABOUT_MEAN,
        range_sigma=float(np.sqrt(np.mean(np.square(acoustics.range_tau_m)))) * _UNIFORM,
        range_scale_sigma=acoustics.range_scale_sigma_m,
        leader_heading_sigma=float(np.deg2rad(sensors.leader_heading_sigma_deg)) * _ABOUT_MEAN,
        speed_bias=assume.speed_bias_sigma_m_s,
        heading_bias=float(np.deg2rad(assume.heading_bias_sigma_deg)),
        range_scale_bias=assume.range_scale_bias_sigma_m,
        leader_heading_bias=float(np.deg2rad(assume.leader_heading_bias_sigma_deg)) if turned else 0.0,
        current=assume.current_sigma_m_s if moving else 0.0,
        range_offset=assume.offset_sigma_m if late else 0.0,
        clock_offset=sound * assume.clock_offset_sigma_s if clock else 0.0,
        clock_drift=1e-6 * sound * assume.clock_drift_sigma_ppm if clock else 0.0,
        speed_walk=math.sqrt(_WALKS.log_walk[0]) if assume.drift else 0.0,
        heading_walk=math.sqrt(_WALKS.compass_walk[0]) if assume.drift else 0.0,
        current_walk=math.sqrt(_WALKS.current_walk) if "current" in estimated else 0.0,
        clock_walk=math.sqrt(_WALKS.clock_walk) if clock else 0.0,
        leader_way_sigma=CURRENT_SIGMA if estimated & {"current", "leader_heading_bias"} else 0.0,
    )


def geometry_of(
    trajectory: Trajectory,
    scenario: Scenario,
    follower: int = 0,
    received: Bools | None = None,
) -> Geometry:
    """The true geometry of a mission as one follower's sensors meet it.

    Args:
        trajectory: of the mission.
        scenario: of the mission.
        follower: its index, 0 for the first.
        received: of which of the m messages each ping arrived, shape (m, 3); None: all did.
    """
    dt = scenario.timing.filter_step_s
    stride = round(dt / CONTROL_STEP_S)
    first, n = round(float(trajectory.time[0]) / dt), (trajectory.time.size - 1) // stride
    at = np.arange(1, n + 1) * stride
    sound = propagate(trajectory, scenario, follower)
    arrived, sent = (sound.message_step - first), (sound.emission_step - first) * stride
    hydrophone = trajectory.site_path(f"{trajectory.names[follower + 1]}/hydrophone", arrived * stride)
    leader, used = trajectory.position[sent, 0, :2], scenario.navigation.transmitters
    arms = sound.transmitter[:, :used].copy()
    arms[..., :2] -= leader[:, None]
    arms[..., 2] = hydrophone[:, None, 2] - arms[..., 2]
    if received is not None:
        arms[~received[:, :used]] = np.nan
    return Geometry(
        dt=dt,
        speed=trajectory.forward_speed[at, follower + 1],
        heading=trajectory.heading[at, follower + 1],
        message_step=arrived,
        from_leader=hydrophone[:, :2] - leader,
        arms=arms,
        leader_velocity=trajectory.velocity[sent, 0, :2] - trajectory.water_velocity[sent, 0, :2],
    )


def least_rms(geometry: Geometry, noise: TrueNoise, lag: float = 0.0) -> Floats:
    """Least RMS of the position error after each step, shape (n,), [m]; with messages of up to a lag later [s]."""
    return np.asarray(np.sqrt(np.trace(position_bound(geometry, noise, lag=lag), axis1=1, axis2=2)))


def flight_bound(flight: Flight, follower: int = 0, lag: float = 0.0) -> Floats:
    """Least RMS of one follower's position error after each step, shape (n,), [m], from the pings that it received.

    With a lag [s], messages of up to so much later are used too. Ranges, log and compass are those of this flight, with
    constant biases: sideslip, drift and echoes only raise what can be reached.
    """
    scenario, received = flight.scenario, np.isfinite(flight.measurements[follower].ranges)
    geometry = geometry_of(flight.trajectory, scenario, follower, received)
    return least_rms(geometry, noise_of(scenario, follower), lag)
