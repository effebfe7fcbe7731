"""Range error budget: each range error split into its causes, exactly and additively.

The error D_i − D°_i of the horizontal range that a follower uses, D_i = √(R_i² − Δz_i²), against
that to the transmitter of a level sender, or to a beacon, is split by adding one cause after
another: a cause's share is the change of D when it is added, so that the sum of the shares is the
error. Interactions of two causes are part of the later one's share.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from laisn.arrays import Floats, Ints, freeze_arrays
from laisn.geometry import given_transmitters
from laisn.messages import Measurements
from laisn.settings import Settings
from sim import attitude
from sim.flight import FlightRecord, placement_settings
from sim.scenario.parts import SensingSettings
from sim.sensing.acoustics import TRANSMITTERS
from sim.sensing.links import navigated_motion
from sim.sensing.noise import Address, seed_and_run
from sim.sensing.observation import propagate
from sim.sensing.sensors import navigated_errors_of, paths_taken
from sim.trajectory import Trajectory
from sim.water.rays import Path


class Cause(IntEnum):
    """Causes of the error of a horizontal range, in the order in which they are added."""

    FORESHORTENING = 0  # pitch and roll move the transmitter horizontally
    LEVER_ARM = 1  # pitch and roll move it vertically, away from its depth on a level sender
    MOTION = 2  # leader and follower move between broadcast pose, ping, arrival and fix
    ECHO = 3
    SOUND_SPEED = 4
    CLOCK = 5
    RANDOM = 6  # random error of the range (paper, Eq. 28)
    # depths have errors, the hydrophone is not at the follower's depth sensor, and a transmitter is
    # not at the depth at which the navigator takes it to be
    DEPTH = 7


NO_BUDGET = "received no ping, or navigates on answers, of which there is no budget"
"""Of a follower without a finite range error."""
LABELS = {cause: cause.name.lower().replace("_", " ") for cause in Cause} | {
    Cause.MOTION: "travel time and motion",
    Cause.RANDOM: "random error",
    Cause.DEPTH: "depth measurement",
}


@dataclass(frozen=True, kw_only=True)
class RangeErrorBudget:
    """Range errors of m messages by cause; arrays over transmitters hold rear, front, middle."""

    time: Floats  # time of each fix, shape (m,), [s]
    level_range: Floats  # D°: the true horizontal range to a level sender, shape (m, 3), [m]
    used_range: Floats
    """D: the horizontal range that the follower uses, shape (m, 3), [m]; NaN where no ping was
    received.
    """
    share: Floats  # share of each cause in D − D°, shape (m, 3, causes), [m]

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @property
    def error(self) -> Floats:
        """D − D°, shape (m, 3), [m]."""
        return self.used_range - self.level_range

    @property
    def asymmetry(self) -> Floats:
        """Share of each cause in the error of D_front − D_rear, shape (m, causes), [m]."""
        return np.asarray(self.share[:, 1] - self.share[:, 0])


def _on_plane(slant: Floats, depth_difference: Floats) -> Floats:
    """Horizontal ranges, as the follower computes them, of slant ranges, shape (m, 3), and
    differences of depth, shape (m, 3), [m].
    """
    return np.asarray(np.sqrt(np.maximum(slant * slant - depth_difference * depth_difference, 0.0)))


def _assumed_depths(measurements: Measurements, settings: Settings, rows: Ints) -> Floats:
    """Depths at which a navigator takes the transmitters of m messages to be, shape (m, 3), [m];
    NaN of one that is not there. On a hull without given places it is the sender's depth.
    """
    depths = np.empty((rows.size, 3))
    for depth, row in zip(depths, rows.tolist(), strict=True):
        reception = measurements.reception(row)
        places = given_transmitters(reception, settings)
        depth[:] = reception.message.depth if places is None else places[:, 2]
    return depths


def _transmitters(trajectory: Trajectory, index: Ints, quaternion: Floats) -> Floats:
    """Transmitters at m instants if the leader has these attitudes, shape (m, 4), there; shape
    (m, 3, 3), [m].
    """
    pose = (*trajectory.position[index, 0].T, *quaternion.T)
    offsets = [trajectory.site_offset[trajectory.site(name)] for name in TRANSMITTERS]
    return np.stack(
        [np.column_stack(attitude.body_point_in_world(pose, offset)) for offset in offsets], axis=1
    )


def range_error_budget(flight: FlightRecord, follower: int = 0) -> RangeErrorBudget:
    """The range error budget of one follower, by its index."""
    scenario = flight.scenario
    sensing = SensingSettings.of(scenario.navigated_as(follower))
    trajectory = navigated_motion(flight.trajectory, sensing.links)
    measurements = flight.measurements[follower]
    sound = propagate(trajectory, sensing, follower)
    # sound counts steps from the start of the mission, a flight from its own
    first = round(float(trajectory.time[0]) / measurements.dt)
    _, sound_row, measured_row = np.intersect1d(
        sound.message_step - first, measurements.message_step, return_indices=True
    )
    emission = sound.emission_step[sound_row]
    # instants of the trajectory at which a message is sent, and at which the fix of it is made
    sent = (emission - first) * flight.stride
    fixed = measurements.message_step[measured_row] * flight.stride

    broadcast = _transmitters(trajectory, sent, trajectory.quaternion[sent, 0])
    level = _transmitters(trajectory, sent, attitude.from_euler(trajectory.heading[sent, 0]))
    hydrophone = trajectory.site_path(f"{trajectory.names[follower + 1]}/hydrophone", fixed)
    # how much deeper each transmitter is than the hydrophone, shape (m, 3), [m]
    depth_difference = hydrophone[:, None, 2] - level[..., 2]

    errors = navigated_errors_of(sensing, follower)
    origin = seed_and_run(scenario.seed, scenario.run)
    paths = [paths_taken(errors, Address(*origin, follower, step)) for step in emission.tolist()]
    # the `Path` of the ping of each transmitter that the follower takes, shape (m, 3)
    path = np.array(paths, dtype=np.int64).reshape(-1, 3)

    def of_received(values: Floats) -> Floats:
        """Values on the path taken, shape (m, 3), of those on all paths, shape (…, 3, 3)."""
        return np.asarray(np.take_along_axis(values[sound_row], path[:, :, None], axis=2)[:, :, 0])

    length = of_received(sound.arrival.length)
    settings = placement_settings(scenario.navigation_of(follower), trajectory.sites)
    own_depth = measurements.depth[measurements.message_step[measured_row] - 1]
    measured_difference = _assumed_depths(measurements, settings, measured_row) - (
        own_depth[:, None] - flight.assumed_hydrophone_height(follower + 1)
    )
    level_range = np.linalg.norm(level[..., :2] - hydrophone[:, None, :2], axis=2)
    # horizontal ranges with all causes up to this one, shapes (m, 3), [m]
    range_up_to = {
        Cause.FORESHORTENING: np.linalg.norm(broadcast[..., :2] - hydrophone[:, None, :2], axis=2),
        Cause.LEVER_ARM: _on_plane(
            np.linalg.norm(broadcast - hydrophone[:, None], axis=2), depth_difference
        ),
        Cause.MOTION: _on_plane(sound.arrival.length[sound_row, :, Path.DIRECT], depth_difference),
        Cause.ECHO: _on_plane(length, depth_difference),
        Cause.SOUND_SPEED: _on_plane(length * of_received(sound.arrival.ratio), depth_difference),
        Cause.CLOCK: _on_plane(of_received(sound.range), depth_difference),
        Cause.RANDOM: _on_plane(measurements.ranges[measured_row], depth_difference),
        Cause.DEPTH: _on_plane(measurements.ranges[measured_row], measured_difference),
    }
    ranges = np.stack([level_range, *(range_up_to[cause] for cause in Cause)], axis=2)
    return RangeErrorBudget(
        time=trajectory.time[fixed],
        level_range=level_range,
        used_range=ranges[..., -1],
        share=np.diff(ranges, axis=2),
    )
