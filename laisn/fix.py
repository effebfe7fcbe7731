"""The fix of a pair of transmitters from the ranges to them: formulas for all engines (paper, Sections 2.2 and 2.3).

A *pair* of transmitters gives two circles. Where they meet in two points well apart, the one nearest to the
prediction is taken; otherwise the follower is put onto the pair's axis behind the leader. How pairs are combined is the
matter of `variants`.
"""

import math
from typing import NamedTuple

from laisn.compiled import formula
from laisn.estimates import FixKind
from laisn.geometry import Arms, Point, Turn, common_chord, horizontal_range
from laisn.messages import Ranges
from laisn.settings import Tuning

TWO_POINTS = float(FixKind.TWO_POINTS)
TANGENT = float(FixKind.TANGENT)
ASTERN = float(FixKind.ASTERN)
FUSED = float(FixKind.FUSED)
LOST = float(FixKind.LOST)
"""Kinds of fix as formulas hold them, among other numbers."""


class Circle(NamedTuple):
    """Circle that a follower is on, by the range to one transmitter."""

    centre: Point
    """The transmitter, where the message places it."""
    radius: float
    """Horizontal range D_i [m]; NaN where nothing was received."""


class Circles(NamedTuple):
    """Circles about the rear, front and middle transmitter."""

    rear: Circle
    front: Circle
    middle: Circle


class Pair(NamedTuple):
    """Circles of two transmitters, the rear one first."""

    rear: Circle
    front: Circle
    from_front: bool
    """P_D is measured from the front transmitter, else from the rear one (paper, Eq. 23)."""


class Fix(NamedTuple):
    """A position measurement for the filter, from one pair or several."""

    east: float
    """z [m]; of no meaning where LOST."""
    north: float
    sigma: float
    """σp [m]."""
    kind: float
    """`FixKind` as a float."""
    separation: float
    """Distance of two intersections [m], −1 where there are fewer."""


@formula
def circles(origin: Point, arms: Arms, ranges: Ranges, depth_difference: float) -> Circles:
    """Circles about the transmitters of a leader.

    A slant range shorter than the depth difference counts as a horizontal range of 0.

    Args:
        origin: the leader's.
        arms: of its transmitters.
        ranges: measured.
        depth_difference: Δz, depth of the hydrophone less that of the leader [m].
    """
    east, north, up = arms.front
    middle_east, middle_north, middle_up = arms.middle
    rear = Point(origin.east - east, origin.north - north)
    front = Point(origin.east + east, origin.north + north)
    middle = Point(origin.east + middle_east, origin.north + middle_north)
    return Circles(
        Circle(rear, horizontal_range(ranges.rear, depth_difference - up)),
        Circle(front, horizontal_range(ranges.front, depth_difference + up)),
        Circle(middle, horizontal_range(ranges.middle, depth_difference + middle_up)),
    )


@formula
def rear_front(heard: Circles) -> Pair:
    """The main pair (1, 2)."""
    return Pair(heard.rear, heard.front, False)


@formula
def rear_middle(heard: Circles) -> Pair:
    """The pair (1, 3)."""
    return Pair(heard.rear, heard.middle, False)


@formula
def middle_front(heard: Circles) -> Pair:
    """The pair (2, 3), whose rear transmitter is the middle one."""
    return Pair(heard.middle, heard.front, True)


@formula
def pair_fix(pair: Pair, heading: Turn, predicted: Point, t: Tuning) -> Fix:
    """Fix of a pair (paper, Section 2.2 and Eq. 23); LOST if one of its ranges is missing.

    Of two intersections equally near to the prediction the one to port is taken. Where the circles do not meet in two
    points as far apart as T, the fix is P_D: behind the leader on the pair's axis, with σp = 0. With the side rule
    "predicted" and a prediction ahead of the pair's middle, it lies ahead instead, at the front transmitter's range.
    """
    rear, front = pair.rear.radius, pair.front.radius
    received = rear == rear and front == front
    chord = common_chord(pair.rear.centre, rear, pair.front.centre, front)
    apart, d = chord.apart, chord.distance
    # one transmitter upon the other: the axis is the hull's
    east = chord.way.east if apart else heading.sine
    north = chord.way.north if apart else heading.cosine
    two = apart and chord.half_squared > 0.0
    half = math.sqrt(chord.half_squared if two else 0.0)
    separation = 2.0 * half
    clear = two and separation >= t.threshold
    tangent = apart and chord.half_squared == 0.0

    x, y = predicted.east - pair.rear.centre.east, predicted.north - pair.rear.centre.north
    side = half if y * east >= x * north else -half
    behind = d - front if pair.from_front else -rear
    ahead = t.predicted_side and x * east + y * north > 0.5 * d
    along = chord.along if clear or tangent else (d + front if ahead else behind)
    aside = side if clear else 0.0
    kind = TWO_POINTS if clear else (TANGENT if tangent else ASTERN)
    return Fix(
        pair.rear.centre.east + along * east - aside * north,
        pair.rear.centre.north + along * north + aside * east,
        t.beta / separation if clear else 0.0,
        kind if received else LOST,
        separation if two else -1.0,
    )


@formula
def fix_variance(sigma: float, depth_difference: float, t: Tuning) -> float:
    """Variance of a fix as the filter is given it [m²]: σp not below the floor, and a share for the expected pitch.

    An unknown pitch φ of the leader shifts a fix abeam by Δz sin φ whatever the range.
    """
    vertical = depth_difference * t.sine_of_pitch
    least = t.sigma_floor if sigma < t.sigma_floor else sigma
    return vertical * vertical + least * least
