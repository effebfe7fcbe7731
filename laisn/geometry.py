"""Plane and hull geometry: angles, bearings, transmitters, circles. Pure, and shared by all
engines.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import formula
from laisn.delays import leader_way
from laisn.messages import LeaderMessage, Reception
from laisn.settings import Settings

Triple = tuple[float, float, float]
Angle = TypeVar("Angle", float, Floats)

SINGULAR_VARIANCE = 1e-12
"""A position variance below this is zero [m²].

It stands for a micrometre: far below any sensor, and far above the 1e-30 m² that rounding leaves
where an update with σp = 0 should leave nothing. A second update with σp = 0 would divide one
rounding error by another.
"""


_TURN = 2.0 * math.pi
_PER_TURN = 1.0 / _TURN
_ROUNDING = 1.5 * 2.0**52  # added and subtracted, it rounds to the nearest integer


class Point(NamedTuple):
    """A horizontal position [m]."""

    east: float
    north: float


class SinCos(NamedTuple):
    """Sine and cosine of an angle; of a heading, its unit vector east and north."""

    sine: float
    cosine: float


class Arms(NamedTuple):
    """Offsets (east, north, up) of transmitters from the leader's origin [m]; the rear one is
    opposite to the front.
    """

    front: Triple
    middle: Triple


class Chord(NamedTuple):
    """Common chord of two circles, seen from the first centre on the way to the second."""

    distinct: bool  # the centres do not coincide
    distance: float  # of the centres [m]
    direction: Point  # unit vector from the first centre to the second; (0, 0) if they coincide
    offset: float  # of the common chord from the first centre, along that direction, a [m]
    # half its length, squared, h² [m²]: negative where circles do not meet, 0 where they touch
    half_squared: float


@formula
def signed_angle(angle: Angle) -> Angle:
    """Angle or angles brought into [−π, π) [rad]."""
    return (angle + math.pi) % _TURN - math.pi


@formula
def wrap_angle(angle: float) -> float:
    """Angle brought into [−π, π] [rad], both ends of which are one direction; loops over lanes
    stay vectorised.
    """
    turns = (angle * _PER_TURN + _ROUNDING) - _ROUNDING
    return angle - turns * _TURN


@formula
def angle_between(a: float, b: float) -> float:
    """Smallest angle between two directions, in [0, π] [rad] (paper, γθ in Section 2.1)."""
    return abs(wrap_angle(a - b))


@formula
def sin_cos_of(angle: float) -> SinCos:
    """Sine and cosine."""
    return SinCos(math.sin(angle), math.cos(angle))


@formula
def fore_offset(length: float, heading: SinCos, pitch: SinCos) -> Triple:
    """Offset (east, north, up) of a point so far forward on a hull's axis [m]."""
    return (
        length * heading.sine * pitch.cosine,
        length * heading.cosine * pitch.cosine,
        length * pitch.sine,
    )


@formula
def side_offset(width: float, heading: SinCos, pitch: SinCos, roll: SinCos) -> Triple:
    """Offset (east, north, up) of a point so far to port of a hull's origin [m]."""
    raised = width * roll.sine
    ahead = -raised * pitch.sine
    lateral = width * roll.cosine
    east = ahead * heading.sine - lateral * heading.cosine
    north = ahead * heading.cosine + lateral * heading.sine
    return east, north, raised * pitch.cosine


@formula
def tilted_arms(
    baseline: float, middle_offset: float, heading: SinCos, pitch: SinCos, roll: SinCos
) -> Arms:
    """Transmitters of a leader (paper, Section 2.3 and Figure 1): half a baseline ahead, an
    offset to port.
    """
    return Arms(
        fore_offset(0.5 * baseline, heading, pitch),
        side_offset(middle_offset, heading, pitch, roll),
    )


def place_on_body(origin: Triple, attitude: Triple, offsets: Floats) -> Floats:
    """Rows of (east, north, depth) of points anywhere on a body, shape (n, 3), [m].

    `origin` is its (east, north, depth), `offsets` has rows of (forward, port, up), `attitude` is
    (heading, pitch, roll) [rad]: turned to its heading, then pitched nose up, then rolled starboard
    down, about its own axes.
    """
    heading, pitch, roll = map(sin_cos_of, attitude)
    forward = np.array(fore_offset(1.0, heading, pitch))
    port = np.array(side_offset(1.0, heading, pitch, roll))
    rotated = offsets @ np.stack([forward, port, np.cross(forward, port)])
    return np.asarray(np.array(origin) + rotated * [1.0, 1.0, -1.0])


def broadcast_tilt(message: LeaderMessage, settings: Settings) -> tuple[float, float]:
    """The leader's pitch and roll, if they are broadcast and used; otherwise (0, 0) of a level
    leader [rad].
    """
    used = settings.use_attitude and not math.isnan(message.pitch + message.roll)
    return (message.pitch, message.roll) if used else (0.0, 0.0)


def _placed(
    message: LeaderMessage, settings: Settings, offsets: Sequence[Triple] | Floats
) -> Floats:
    attitude = message.heading, *broadcast_tilt(message, settings)
    places = np.full((3, 3), np.nan)
    places[: len(offsets)] = place_on_body(
        (message.east, message.north, message.depth), attitude, np.array(offsets)
    )
    if settings.compensate_motion and settings.ping_slot > 0.0:
        places[:, :2] += leader_way(message, settings)
    return places


def given_transmitters(reception: Reception, settings: Settings) -> Floats | None:
    """Transmitters (east, north, depth) that the reception or the settings place, shape (3, 3),
    [m], NaN for one that is not there; None: they are on the leader's hull.
    """
    if reception.transmitters is not None:
        return reception.transmitters
    if reception.offsets is not None:
        return _placed(reception.message, settings, reception.offsets)
    if settings.transmitter_offsets:
        return _placed(reception.message, settings, settings.transmitter_offsets)
    return None


def place_transmitters(reception: Reception, settings: Settings) -> Floats:
    """Transmitters (east, north, depth) of a message, given or on the hull, shape (3, 3), [m];
    NaN for none.
    """
    places = given_transmitters(reception, settings)
    half_baseline = 0.5 * settings.baseline
    on_hull = (
        (-half_baseline, 0.0, 0.0),
        (half_baseline, 0.0, 0.0),
        (0.0, settings.middle_offset, 0.0),
    )
    return _placed(reception.message, settings, on_hull) if places is None else places


@formula
def horizontal_range(slant_range: float, depth_difference: float) -> float:
    """Horizontal range D = √(R² − Δz²) [m]; 0 where a range error makes R < |Δz|, NaN where R is
    NaN.
    """
    squared = slant_range * slant_range - depth_difference * depth_difference
    # the order of comparison lets NaN through: nothing was received
    return math.sqrt(0.0 if squared < 0.0 else squared)


@formula
def common_chord(first: Point, first_radius: float, second: Point, second_radius: float) -> Chord:
    """Chord of the circle about one point and the one about another; all in [m].

    With d the distance of the centres, a = (d² + D_i² − D_j²) / 2d is how far along the way from i
    to j the chord lies, and h² = D_i² − a² its half-length squared. Here h² is the product of
    Heron's formula (height of the triangle with sides d, D_i, D_j), for the difference of squares
    loses a short chord to rounding.
    """
    east, north = second.east - first.east, second.north - first.north
    d = math.sqrt(east * east + north * north)
    distinct = d > 0.0
    per_d = 1.0 / (d if distinct else 1.0)
    offset = (d * d + first_radius * first_radius - second_radius * second_radius) * (0.5 * per_d)
    overlap = (
        (first_radius + second_radius - d)
        * (d + first_radius - second_radius)
        * (d - first_radius + second_radius)
    )
    half_squared = (d + first_radius + second_radius) * overlap * (0.25 * per_d * per_d)
    return Chord(distinct, d, Point(east * per_d, north * per_d), offset, half_squared)


@formula
def is_singular(variance_x: float | Floats, variance_y: float | Floats) -> Any:
    """Whether a position of these variances is known exactly, but for rounding [m²]."""
    return 0.5 * (variance_x + variance_y) < SINGULAR_VARIANCE


def fix_bearing_cosine(
    pitch: npt.ArrayLike,
    depth_offset: npt.ArrayLike,
    distance: npt.ArrayLike,
    bearing: npt.ArrayLike,
) -> Floats:
    """Cosine of the bearing B̂ of the fix that is made where a pitched leader is taken for level;
    beyond ±1 where the circles do not meet. Arguments as of `pitch_fix_error`.
    """
    lever = np.divide(depth_offset, distance) * np.sin(pitch)
    return np.asarray(np.cos(bearing) * np.cos(pitch) - lever)


def pitch_fix_error(
    pitch: npt.ArrayLike,
    depth_offset: npt.ArrayLike,
    distance: npt.ArrayLike,
    bearing: npt.ArrayLike,
) -> Floats:
    """Position error [m] of a noiseless fix of LAISN-2 by the leader's `pitch` [rad]
    (docs/asymmetry.md).

    The follower is `depth_offset` below the leader and at a horizontal `distance` from it [m], at
    the `bearing` [rad] from its bow.
    """
    fix_bearing = np.arccos(
        np.clip(fix_bearing_cosine(pitch, depth_offset, distance, bearing), -1.0, 1.0)
    )
    return np.asarray(
        2.0 * np.asarray(distance) * np.sin(np.abs(fix_bearing - np.arccos(np.cos(bearing))) / 2.0)
    )
