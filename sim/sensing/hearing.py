"""What decides, beside the motion, what a follower sees and hears before random errors."""

from dataclasses import dataclass
from typing import Self

from sim.scenario.settings import Scenario
from sim.sensing.drift import BiasDrift, position_drift
from sim.sensing.echo import Path, possible_paths


@dataclass(frozen=True, kw_only=True)
class Hearing:
    """All of a scenario that reaches `observe` and `propagate`; fields of a scenario's name mean the same.

    These functions are given no scenario. Two missions of equal motion and equal hearing therefore share one truth, and
    a setting that they come to need must be added here before they can read it.
    """

    filter_step_s: float
    message_every: int
    """Filter steps from one message to the next."""
    transmitters: int
    """Number of transmitters that the follower listens to, rear and front first: it waits for no others."""
    broadcast_attitude: bool
    leader_attitude_feels_acceleration: bool
    leader_gyro_time_constant_s: float
    floor_depth_m: float
    paths: tuple[Path, ...]
    """Paths of sound that have a chance to be taken."""
    travel_time: bool
    ping_slot_s: float
    sound_speed_m_s: float
    sound_speed_bias_m_s: float
    sound_speed_profile: tuple[tuple[float, float], ...]
    clock_offset_s: float
    clock_drift_ppm: float
    max_range_m: float
    bias_drift: BiasDrift
    """Of the follower's log and compass."""
    leader_drift: tuple[float, float]
    """Of `position_drift`, [m/s]."""

    @classmethod
    def of(cls, scenario: Scenario, follower: int = 0) -> Self:
        """That of a follower, by its index."""
        sensors, acoustics = scenario.sensors, scenario.acoustics
        return cls(
            filter_step_s=scenario.timing.filter_step_s,
            message_every=scenario.message_every,
            transmitters=scenario.navigation.transmitters,
            broadcast_attitude=scenario.leader.broadcast_attitude,
            leader_attitude_feels_acceleration=sensors.leader_attitude_feels_acceleration,
            leader_gyro_time_constant_s=sensors.leader_gyro_time_constant_s,
            floor_depth_m=scenario.ocean.floor_depth_m,
            paths=possible_paths(acoustics.surface_echo_chance, acoustics.bottom_echo_chance),
            travel_time=acoustics.travel_time,
            ping_slot_s=acoustics.ping_slot_s,
            sound_speed_m_s=acoustics.sound_speed_m_s,
            sound_speed_bias_m_s=acoustics.sound_speed_bias_m_s,
            sound_speed_profile=acoustics.sound_speed_profile,
            clock_offset_s=acoustics.clock_offset_s,
            clock_drift_ppm=acoustics.clock_drift_ppm,
            max_range_m=acoustics.max_range_m,
            bias_drift=BiasDrift.of(scenario.sensors_of(follower), follower),
            leader_drift=position_drift(sensors),
        )
