"""What a follower senses of vehicles nearby: range and bearing of each, ten times a second at most.

The sensor looks all around in a level fan. It senses every vehicle within its range and its fan, whatever lies between,
and takes hulls for points at their middles. Errors of a range and a bearing are normal, and drawn for each look of one
follower at one vehicle: how many others there are changes none of them.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Record, Records
from laisn.compiled import compiled
from laisn.geometry import signed_angle
from sim.geometry.attitude import heading_of
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.noise import STREAMS, Stream, two_normals, two_units, words
from sim.trajectory import Trajectory

SIGHTING = np.dtype(
    [
        ("range", np.float64),  # [m]; NaN: nothing was sensed
        ("bearing", np.float64),  # to starboard of the own heading [rad]
    ]
)
"""What a look shows of one vehicle."""

_U = np.uint64
_NEARBY = int(Stream.NEARBY)


def look_interval(scenario: Scenario) -> int:
    """Ticks from one look of the followers to the next; 0: they have no sensor."""
    proximity = scenario.formation.proximity
    return round(proximity.period_s / CONTROL_STEP_S) if proximity else 0


@compiled
def look(address: tuple[np.uint64, np.uint64], p: Record, k: int, follower: int, poses: Floats, seen: Records) -> None:
    """Look around.

    Args:
        address: seed and run of the noise.
        p: record of `[formation.proximity]`.
        k: tick, from 1.
        follower: index of who looks; its vehicle is the one after.
        poses: of all vehicles, shape (v, 7) or more columns.
        seen: out: of every vehicle, of SIGHTING, shape (v,).
    """
    own, steepest = follower + 1, np.sin(0.5 * p.aperture)
    heading = heading_of(poses[own, 3], poses[own, 4], poses[own, 5], poses[own, 6])
    for j in range(poses.shape[0]):
        seen[j].range = seen[j].bearing = np.nan
        x, y, z = poses[j, 0] - poses[own, 0], poses[j, 1] - poses[own, 1], poses[j, 2] - poses[own, 2]
        distance = np.sqrt(x * x + y * y + z * z)
        if j == own or distance > p.range or abs(z) > steepest * distance:
            continue
        w0, w1, w2, w3 = words(address[0], address[1], _U(STREAMS * follower + _NEARBY + j), _U(k))
        first, second = two_units(w0, w1, w2, w3)
        long, aside = two_normals(first, second)
        seen[j].range = max(distance + p.range_sigma * long, 0.0)
        seen[j].bearing = signed_angle(np.arctan2(x, y) - heading + p.bearing_sigma * aside)


@compiled
def _sightings(
    address: tuple[np.uint64, np.uint64], p: Record, every: int, poses: Floats, first: Floats, looks: Floats
) -> None:
    """First tick at which each follower saw each vehicle, −1: never, shape (f, v), and looks that showed any, (f,)."""
    first[:], looks[:] = -1.0, 0.0
    seen = np.empty(poses.shape[1], SIGHTING)
    for k in range(every, poses.shape[0], every):
        for i in range(looks.size):
            look(address, p, k, i, poses[k], seen)
            showed = 0.0
            for j in range(seen.shape[0]):
                if seen[j].range == seen[j].range:
                    showed = 1.0
                    if first[i, j] < 0.0:
                        first[i, j] = k
            looks[i] += showed


class Sightings(NamedTuple):
    """What followers of a flight sensed nearby."""

    first_s: Floats
    """When each follower first saw each vehicle, shape (f, v), [s]; NaN: never."""
    spent_s: Floats
    """Time for which each follower detected a vehicle, shape (f,), [s]."""


def sightings(scenario: Scenario, trajectory: Trajectory) -> Sightings:
    """What the followers' sensors showed on the way, which they steered by; nothing where they have none."""
    proximity, f, every = scenario.formation.proximity, len(scenario.followers), look_interval(scenario)
    first, looks = np.full((f, f + 1), -1.0), np.zeros(f)
    if proximity:
        poses = np.concatenate([trajectory.position, trajectory.quaternion], axis=2)
        _sightings((_U(scenario.seed), _U(scenario.run)), proximity.record(), every, poses, first, looks)
    # followers on routes have no sensor
    on_route = [follower.station is None for follower in scenario.followers]
    first[on_route], looks[on_route] = -1.0, 0.0
    return Sightings(np.where(first < 0.0, np.nan, first * CONTROL_STEP_S), looks * every * CONTROL_STEP_S)
