"""The proximity sensor of followers in formation: range and bearing of every vehicle nearby.

It looks all around in a level fan. It senses every vehicle within its range and its fan, whatever
lies between, and takes hulls for points at their middles; its errors are drawn for each look at one
vehicle.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Record, Records
from laisn.compiled import compiled
from laisn.geometry import signed_angle
from sim.attitude import heading_of
from sim.scenario.formation import Proximity
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing.noise import number_of_look, two_normals, two_uniforms, words
from sim.trajectory import Trajectory

SIGHTING = np.dtype(  # what a look shows of one vehicle
    [
        ("range", np.float64),  # [m]; NaN: nothing was sensed
        ("bearing", np.float64),  # to starboard of the own heading [rad]
    ]
)

_U = np.uint64


def look_interval(proximity: Proximity | None) -> int:
    """Ticks, which are control steps, from one look of the followers to the next; 0: they have no
    sensor.
    """
    return round(proximity.period_s / CONTROL_STEP_S) if proximity else 0


@compiled
def sense_neighbours(
    address: tuple[np.uint64, np.uint64],
    p: Record,
    k: int,
    follower: int,
    poses: Floats,
    sightings: Records,
) -> None:
    """Look around at tick k, from 1, by seed and run of the noise and the record of
    `[formation.proximity]`.

    `poses` are of all vehicles, shape (v, 7); `sightings`, out, is what is sensed of each, of
    SIGHTING, shape (v,).
    """
    observer = follower + 1
    max_sine = np.sin(0.5 * p.aperture)  # of the elevation of what is sensed
    heading = heading_of(poses[observer, 3:])
    for j in range(poses.shape[0]):
        sightings[j].range = sightings[j].bearing = np.nan
        x, y, z = (
            poses[j, 0] - poses[observer, 0],
            poses[j, 1] - poses[observer, 1],
            poses[j, 2] - poses[observer, 2],
        )
        distance = np.sqrt(x * x + y * y + z * z)
        if j == observer or distance > p.range or abs(z) > max_sine * distance:
            continue
        stream = _U(number_of_look(follower, j))
        w0, w1, w2, w3 = words(address[0], address[1], stream, _U(k))
        first, second = two_uniforms(w0, w1, w2, w3)
        range_normal, bearing_normal = two_normals(first, second)
        sightings[j].range = max(distance + p.range_sigma * range_normal, 0.0)
        sightings[j].bearing = signed_angle(
            np.arctan2(x, y) - heading + p.bearing_sigma * bearing_normal
        )


class Sightings(NamedTuple):
    """What followers of a flight sensed nearby."""

    first_s: Floats  # when each follower first saw each vehicle, shape (f, v), [s]; NaN: never
    detected_s: Floats  # time for which each follower detected any vehicle, shape (f,), [s]


def sightings(motion: MotionSettings, trajectory: Trajectory) -> Sightings:
    """What the followers' sensors showed on the way, which they steered by; nothing where they
    have none.
    """
    proximity = motion.formation.proximity
    followers = motion.plan.followers
    f = len(followers)
    ticks_per_look = look_interval(proximity)
    first = np.full((f, f + 1), np.nan)
    detected_s = np.zeros(f)
    for i, follower in enumerate(followers):
        # followers on routes have no sensor
        if proximity is None or follower.station is None:
            continue
        offset = (
            trajectory.position[ticks_per_look::ticks_per_look]
            - trajectory.position[ticks_per_look::ticks_per_look, [i + 1]]
        )
        distance = np.sqrt(offset[..., 0] ** 2 + offset[..., 1] ** 2 + offset[..., 2] ** 2)
        max_sine = np.sin(0.5 * np.deg2rad(proximity.aperture_deg))
        is_sensed = (distance <= proximity.range_m) & (
            np.abs(offset[..., 2]) <= max_sine * distance
        )
        is_sensed[:, i + 1] = False
        first[i, is_sensed.any(axis=0)] = (
            (is_sensed.argmax(axis=0)[is_sensed.any(axis=0)] + 1) * ticks_per_look * CONTROL_STEP_S
        )
        detected_s[i] = np.count_nonzero(is_sensed.any(axis=1)) * ticks_per_look * CONTROL_STEP_S
    return Sightings(first, detected_s)
