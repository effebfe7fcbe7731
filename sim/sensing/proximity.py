"""What a follower senses of vehicles nearby: range and bearing of each, ten times a second at most.

The sensor looks all around in a level fan. It hears every vehicle within its range and its fan, whatever lies between,
and takes hulls for points at their middles. Errors of a range and a bearing are normal, and drawn for each look of one
follower at one vehicle: how many others there are changes none of them.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.geometry import signed_angle
from sim.geometry.attitude import heading_of
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.noise import STREAMS, Stream, two_normals, two_units, words
from sim.trajectory import Trajectory

RANGE, BEARING = range(2)
"""Columns of what is seen of each vehicle: [m], and to starboard of the own heading [rad]; NaN: nothing."""
SEEN = 2

_U = np.uint64
_NEARBY = int(Stream.NEARBY)


class Lookout(NamedTuple):
    """The sensor as compiled code takes it."""

    seed: np.uint64
    run: np.uint64
    every: int
    """Ticks from one look to the next; 0: there is no sensor."""
    reach: float
    """[m]."""
    range_sigma: float
    """[m]."""
    bearing_sigma: float
    """[rad]."""
    steepest: float
    """Sine of the largest elevation that is within the fan."""


def lookout_of(scenario: Scenario) -> Lookout:
    """The sensor of a scenario's followers; one that never looks if they have none."""
    told = scenario.formation.proximity
    seed, run = _U(scenario.seed), _U(scenario.run)
    if told is None:
        return Lookout(seed, run, 0, 0.0, 0.0, 0.0, 0.0)
    return Lookout(
        seed=seed,
        run=run,
        every=round(told.period_s / CONTROL_STEP_S),
        reach=told.range_m,
        range_sigma=told.range_sigma_m,
        bearing_sigma=float(np.deg2rad(told.bearing_sigma_deg)),
        steepest=float(np.sin(0.5 * np.deg2rad(told.aperture_deg))),
    )


@compiled
def look(s: Lookout, k: int, follower: int, poses: Floats, seen: Floats) -> None:
    """Look around.

    Args:
        s: the sensor.
        k: tick, from 1.
        follower: index of who looks; its vehicle is the one after.
        poses: of all vehicles, shape (v, 7) or more columns.
        seen: out: columns RANGE and BEARING of every vehicle, shape (v, SEEN).
    """
    own = follower + 1
    heading = heading_of(poses[own, 3], poses[own, 4], poses[own, 5], poses[own, 6])
    for j in range(poses.shape[0]):
        seen[j, RANGE] = seen[j, BEARING] = np.nan
        x, y, z = poses[j, 0] - poses[own, 0], poses[j, 1] - poses[own, 1], poses[j, 2] - poses[own, 2]
        distance = np.sqrt(x * x + y * y + z * z)
        if j == own or distance > s.reach or abs(z) > s.steepest * distance:
            continue
        w0, w1, w2, w3 = words(s.seed, s.run, _U(STREAMS * follower + _NEARBY + j), _U(k))
        first, second = two_units(w0, w1, w2, w3)
        long, aside = two_normals(first, second)
        seen[j, RANGE] = max(distance + s.range_sigma * long, 0.0)
        seen[j, BEARING] = signed_angle(np.arctan2(x, y) - heading + s.bearing_sigma * aside)


@compiled
def _sightings(s: Lookout, poses: Floats, first: Floats, looks: Floats) -> None:
    """First tick at which each follower saw each vehicle, −1: never, shape (f, v), and looks that showed any, (f,)."""
    first[:], looks[:] = -1.0, 0.0
    seen = np.empty((poses.shape[1], SEEN))
    for k in range(s.every, poses.shape[0], s.every):
        for i in range(looks.size):
            look(s, k, i, poses[k], seen)
            showed = 0.0
            for j in range(seen.shape[0]):
                if seen[j, RANGE] == seen[j, RANGE]:
                    showed = 1.0
                    if first[i, j] < 0.0:
                        first[i, j] = k
            looks[i] += showed


class Sightings(NamedTuple):
    """What followers of a flight sensed nearby."""

    first_s: Floats
    """When each follower first saw each vehicle, shape (f, v), [s]; NaN: never."""
    spent_s: Floats
    """How long each follower saw anybody, shape (f,), [s]."""


def sightings(scenario: Scenario, trajectory: Trajectory) -> Sightings:
    """What the followers' sensors showed on the way, which they steered by; nothing where they have none."""
    s, f = lookout_of(scenario), len(scenario.followers)
    first, looks = np.full((f, f + 1), -1.0), np.zeros(f)
    if s.every > 0:
        _sightings(s, np.concatenate([trajectory.position, trajectory.quaternion], axis=2), first, looks)
    # followers on routes have no sensor
    first[[follower.station is None for follower in scenario.followers]] = -1.0
    looks[[follower.station is None for follower in scenario.followers]] = 0.0
    return Sightings(np.where(first < 0.0, np.nan, first * CONTROL_STEP_S), looks * s.every * CONTROL_STEP_S)
