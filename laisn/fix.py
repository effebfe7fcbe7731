"""The fix of a message from its ranges (paper, Sections 2.2 and 2.3).

A *pair* of transmitters gives two circles. Where they meet in two points well apart, the one
nearest to the prediction is taken; otherwise the follower is put onto the pair's axis behind the
leader. Each variant of `laisn.settings.Variant` is a function of the fixes of the pairs (1, 2), (1,
3) and (2, 3), and of the prediction. LAISN-3(1) has none: it updates the filter with one pair after
the other.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from laisn import geometry
from laisn.arrays import Floats
from laisn.compiled import formula
from laisn.delays import leader_way
from laisn.estimates import FixKind
from laisn.geometry import Arms, Point, SinCos, horizontal_range, sin_cos_of
from laisn.messages import Ranges, Reception
from laisn.settings import NavigationSettings, Tuning, Variant

# Kinds of fix as formulas hold them, among other numbers.
TWO_POINTS = float(FixKind.TWO_POINTS)
TANGENT = float(FixKind.TANGENT)
ASTERN = float(FixKind.ASTERN)
FUSED = float(FixKind.FUSED)
GATED = float(FixKind.GATED)
SINGULAR = float(FixKind.SINGULAR)
LOST = float(FixKind.LOST)


class Circle(NamedTuple):
    """Circle that a follower is on, by the range to one transmitter."""

    centre: Point  # the transmitter, where the message places it
    radius: float  # horizontal range D_i [m]; NaN where nothing was received


class Circles(NamedTuple):
    """Circles about the rear, front and middle transmitter."""

    rear: Circle
    front: Circle
    middle: Circle


class Pair(NamedTuple):
    """Circles of two transmitters, the rear one first."""

    rear: Circle
    front: Circle
    # P_D is measured from the front transmitter, else from the rear one (paper, Eq. 23)
    from_front: bool


class Fix(NamedTuple):
    """A position measurement for the filter, from one pair or several."""

    east: float  # z [m]; of no meaning where LOST
    north: float
    sigma: float
    kind: float  # `FixKind`
    separation: float  # distance of two intersections [m], −1 where there are fewer


@formula
def circles(origin: Point, arms: Arms, ranges: Ranges, depth_difference: float) -> Circles:
    """Circles about the transmitters of a leader at `origin`; the hydrophone is Δz deeper than
    the leader [m].
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
def pair_fix(pair: Pair, heading: SinCos, predicted: Point, t: Tuning) -> Fix:
    """Fix of a pair (paper, Section 2.2 and Eq. 23); LOST if one of its ranges is missing.

    Of two intersections equally near to the prediction the one to port is taken. Where the circles
    do not meet in two points as far apart as T, the fix is P_D: behind the leader on the pair's
    axis, with σp = 0. With the side rule "predicted" and a prediction ahead of the pair's middle,
    it lies ahead instead, at the front transmitter's range.
    """
    rear = pair.rear.radius
    front = pair.front.radius
    received = rear == rear and front == front
    chord = geometry.common_chord(pair.rear.centre, rear, pair.front.centre, front)
    distinct = chord.distinct
    d = chord.distance
    # one transmitter upon the other: the axis is the hull's
    east = chord.direction.east if distinct else heading.sine
    north = chord.direction.north if distinct else heading.cosine
    intersect = distinct and chord.half_squared > 0.0
    half_chord = math.sqrt(chord.half_squared if intersect else 0.0)
    separation = 2.0 * half_chord
    clear = intersect and separation >= t.threshold
    tangent = distinct and chord.half_squared == 0.0

    x, y = predicted.east - pair.rear.centre.east, predicted.north - pair.rear.centre.north
    side = half_chord if y * east >= x * north else -half_chord
    along_chord = d - front if pair.from_front else -rear
    ahead = t.predicted_side and x * east + y * north > 0.5 * d
    on_axis = d + front if ahead else along_chord
    axial = chord.offset if clear or tangent else on_axis
    side_offset = side if clear else 0.0
    kind = TANGENT if tangent else ASTERN
    kind = TWO_POINTS if clear else kind
    return Fix(
        pair.rear.centre.east + axial * east - side_offset * north,
        pair.rear.centre.north + axial * north + side_offset * east,
        t.beta / separation if clear else 0.0,
        kind if received else LOST,
        separation if intersect else -1.0,
    )


@formula
def fix_variance(sigma: float, depth_difference: float, t: Tuning) -> float:
    """Variance of a fix for the filter along each axis [m²]: of σp, at least its floor, and of
    Δz sin φ of the pitch that is expected.
    """
    vertical = depth_difference * t.sine_of_pitch
    floored = t.sigma_floor if sigma < t.sigma_floor else sigma
    return vertical * vertical + floored * floored


def _on_line(pair: Pair, kind: float) -> Fix:
    """The point of the line through two transmitters, apart from each other, that fits both
    ranges best.
    """
    rear, d_rear = pair.rear
    front, d_front = pair.front
    axis = front.east - rear.east, front.north - rear.north
    length = math.hypot(*axis)
    if d_rear + d_front < length:
        axial = 0.5 * (d_rear + length - d_front)
    elif d_rear - d_front > length:
        axial = 0.5 * (d_rear + length + d_front)
    elif d_front - d_rear > length:
        axial = 0.5 * (length - d_rear - d_front)
    else:
        axial = (length**2 + d_rear**2 - d_front**2) / (2.0 * length)
    share = axial / length
    return Fix(rear.east + share * axis[0], rear.north + share * axis[1], 0.0, kind, -1.0)


class RangeCircles(NamedTuple):
    """Circles about the transmitters that a reception gives for the follower's horizontal
    position.
    """

    circles: Circles
    heading: SinCos
    depth_difference: float  # Δz, depth of the hydrophone less that of the leader [m]
    # transmitters are on no leader's hull, so that the follower's side of them is unknown
    off_hull: bool = False

    def pairs(self) -> tuple[Pair, Pair, Pair]:
        """(1, 2), (1, 3) and (2, 3); the rear transmitter of the last one is the middle one."""
        rear, front, middle = self.circles
        return Pair(rear, front, False), Pair(rear, middle, False), Pair(middle, front, True)

    def fix(self, pair: Pair, predicted: Point, t: Tuning) -> Fix:
        """Fix of a pair by `pair_fix`; off a hull P_D is replaced by the point on the line
        through the pair.
        """
        fix = pair_fix(pair, self.heading, predicted, t)
        on_line = self.off_hull and fix.kind == ASTERN and pair.rear.centre != pair.front.centre
        return _on_line(pair, fix.kind) if on_line else fix


def to_circles(
    reception: Reception,
    own_depth: float,
    settings: NavigationSettings,
    way: Floats | None = None,
) -> RangeCircles:
    """Circles about the transmitters where message or settings place them, with the horizontal
    ranges to them.

    `way` is what the follower has moved since each ping arrived, east and north, shape (3, 2), [m],
    by which circles for its place now are moved; None: nothing.
    """
    message = reception.message
    places = geometry.given_transmitters(reception, settings)
    hydrophone = own_depth - settings.hydrophone_height
    heading = sin_cos_of(message.heading)
    depth_difference = hydrophone - message.depth
    if places is None:
        pitch, roll = map(sin_cos_of, geometry.broadcast_tilt(message, settings))
        arms = geometry.tilted_arms(settings.baseline, settings.middle_offset, heading, pitch, roll)
        circles_of_ranges = circles(
            Point(message.east, message.north), arms, reception.ranges, depth_difference
        )
    else:
        rows = zip(places.tolist(), reception.ranges, strict=True)
        circles_of_ranges = Circles(
            *(
                Circle(Point(east, north), horizontal_range(r, hydrophone - depth))
                for (east, north, depth), r in rows
            )
        )
    if way is not None:
        # transmitters that the settings place have gone on from ping to ping already
        displacement = way + (leader_way(message, settings) if places is None else 0.0)
        circles_of_ranges = Circles(*map(_moved, circles_of_ranges, displacement.tolist()))
    return RangeCircles(circles_of_ranges, heading, depth_difference, off_hull=places is not None)


def _moved(circle: Circle, displacement: list[float]) -> Circle:
    centre = Point(circle.centre.east + displacement[0], circle.centre.north + displacement[1])
    return circle._replace(centre=centre)


def one_range(circles: Circles, predicted: Point) -> tuple[Point, Point] | None:
    """The point nearest to the prediction on the circle of the first range that was received, and
    the unit vector from the transmitter to the prediction; None if none was received. The paper
    drops one range alone.
    """
    for centre, radius in circles:
        east, north = predicted.east - centre.east, predicted.north - centre.north
        distance = math.hypot(east, north)
        if radius == radius and distance > 0.0:
            axis = Point(east / distance, north / distance)
            return Point(centre.east + radius * axis.east, centre.north + radius * axis.north), axis
    return None


SEQUENTIAL: Variant = "laisn-3-1"
"""The variant that updates with one pair after the other (paper, Section 2.3.1)."""

Pairs = tuple[Fix, Fix, Fix]
"""The fix of each of the pairs (1, 2), (1, 3) and (2, 3)."""


@formula
def highest(pairs: Pairs, first: float, second: float, third: float) -> Fix:
    """The fix of the pair with the highest score of three, the earlier one among equals."""
    better = pairs[1] if second > first else pairs[0]
    score = second if second > first else first
    return pairs[2] if third > score else better


@formula
def laisn_2(pairs: Pairs, predicted: Point) -> Fix:
    """Two transmitters (paper, Section 2.2)."""
    return pairs[0]


@formula
def _weight(fix: Fix) -> float:
    """Weight of a pair whose circles meet; zero for others (paper, Eq. 25)."""
    return 1.0 / (1.0 + fix.sigma) if fix.separation >= 0.0 or fix.kind == TANGENT else 0.0


@formula
def _weighted(weight: float, value: float) -> float:
    """Weight times value; nothing for a weight of zero, even where the value is NaN."""
    return weight * value if weight > 0.0 else 0.0


@formula
def _kind_of_mean(pairs: Pairs, w_a: float, w_b: float, w_c: float) -> float:
    """FUSED where several pairs have a weight, the kind of a pair that alone has one, else LOST."""
    has_several = (w_a > 0.0 and w_b + w_c > 0.0) or (w_b > 0.0 and w_c > 0.0)
    kind = pairs[2].kind if w_c > 0.0 else LOST
    kind = pairs[1].kind if w_b > 0.0 else kind
    kind = pairs[0].kind if w_a > 0.0 else kind
    return FUSED if has_several else kind


@formula
def laisn_3_2(pairs: Pairs, predicted: Point) -> Fix:
    """Weighted mean of the pairs whose circles meet, w_i = 1 / (1 + σp,i) (paper, Eqs. 24 and 25).

    If no pair's circles meet, the fix is P_D of the first pair that was received, (1, 2) if
    possible. The factor 1/3 of Eq. 25 is kept when fewer than three pairs contribute.
    """
    a, b, c = pairs
    w_a = _weight(a)
    w_b = _weight(b)
    w_c = _weight(c)
    has_none = w_a + w_b + w_c == 0.0
    w_a = 1.0 if has_none and a.kind != LOST else w_a
    w_b = 1.0 if has_none and w_a == 0.0 and b.kind != LOST else w_b
    w_c = 1.0 if has_none and w_a + w_b == 0.0 and c.kind != LOST else w_c
    total = w_a + w_b + w_c
    per_total = 1.0 / (total if total > 0.0 else np.nan)
    return Fix(
        (_weighted(w_a, a.east) + _weighted(w_b, b.east) + _weighted(w_c, c.east)) * per_total,
        (_weighted(w_a, a.north) + _weighted(w_b, b.north) + _weighted(w_c, c.north)) * per_total,
        (a.sigma + b.sigma + c.sigma) * (1.0 / 3.0),
        _kind_of_mean(pairs, w_a, w_b, w_c),
        -1.0,
    )


@formula
def _baseline_score(fix: Fix) -> float:
    """One intersection before all; then the separation of two (−1 for none); lost ranges last."""
    score = -2.0 if fix.kind == LOST else fix.separation
    return np.inf if fix.kind == TANGENT else score


@formula
def laisn_best(pairs: Pairs, predicted: Point) -> Fix:
    """The most certain pair: N = 1, else the largest distance of intersections (Section 2.3.3),
    else the first P_D.
    """
    return highest(
        pairs, _baseline_score(pairs[0]), _baseline_score(pairs[1]), _baseline_score(pairs[2])
    )


@formula
def _usable_score(fix: Fix) -> float:
    """Clear intersections before none; lost ranges last."""
    score = 0.0 if fix.kind == ASTERN else 1.0
    return -2.0 if fix.kind == LOST else score


@formula
def laisn_main(pairs: Pairs, predicted: Point) -> Fix:
    """The main pair, or another where it is missing, does not meet, or meets too close (Section
    2.3.3).
    """
    return highest(pairs, _usable_score(pairs[0]), _usable_score(pairs[1]), _usable_score(pairs[2]))


CHOOSE_PAIR: dict[Variant, Callable[[Pairs, Point], Fix]] = {
    "laisn-2": laisn_2,
    "laisn-3-2": laisn_3_2,
    "laisn-best": laisn_best,
    "laisn-main": laisn_main,
}
