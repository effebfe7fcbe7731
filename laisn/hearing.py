"""What one reception tells a follower: circles about transmitters on a hull or anywhere, and their fixes."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from laisn import fix
from laisn.estimates import FixKind
from laisn.fix import Circle, Circles, Fix, Pair
from laisn.geometry import Arms, Point, Turn, horizontal_range, level_arms, place_on_body, tilted_arms, turn
from laisn.messages import LeaderMessage, Ranges, Reception
from laisn.settings import NavigationSettings, Tuning


class RangeCircles(NamedTuple):
    """What a reception tells about the follower's horizontal position."""

    circles: Circles
    heading: Turn
    """The leader's."""
    depth_difference: float
    """Δz, depth of the hydrophone less that of the leader [m]."""
    off_hull: bool = False
    """The transmitters sit on no leader's hull, so that nothing is known of the side that the follower is on."""

    def pairs(self) -> tuple[Pair, Pair, Pair]:
        """(1, 2), (1, 3) and (2, 3)."""
        return fix.rear_front(self.circles), fix.rear_middle(self.circles), fix.middle_front(self.circles)


def _arms(attitude: tuple[float, float, float] | None, heading: Turn, t: Tuning) -> Arms:
    if attitude is None:
        return level_arms(t.baseline, t.middle_offset, heading)
    return tilted_arms(t.baseline, t.middle_offset, heading, turn(attitude[1]), turn(attitude[2]))


def _about(transmitters: Iterable[Iterable[float]], ranges: Ranges, hydrophone: float) -> Circles:
    """Circles about transmitters of any place: rows of east, north and depth."""
    rows = zip(transmitters, ranges, strict=True)
    return Circles(
        *(Circle(Point(east, north), horizontal_range(r, hydrophone - depth)) for (east, north, depth), r in rows)
    )


def _attitude(message: LeaderMessage, settings: NavigationSettings) -> tuple[float, float, float] | None:
    """Heading, pitch and roll, if they are broadcast and used."""
    known = settings.use_attitude and not math.isnan(message.pitch) and not math.isnan(message.roll)
    return (message.heading, message.pitch, message.roll) if known else None


def to_circles(reception: Reception, own_depth: float, settings: NavigationSettings) -> RangeCircles:
    """Transmitters where the follower believes them to be, and horizontal ranges to them.

    They are where the message says; if it does not, on the leader, which is taken as level unless its attitude is
    broadcast and used. A slant range shorter than the depth difference counts as a horizontal range of 0, and one to a
    transmitter whose place is unknown as not received.
    """
    message, told, t = reception.message, reception.transmitters, Tuning.of(settings)
    hydrophone = own_depth - settings.hydrophone_height
    heading, attitude = turn(message.heading), _attitude(message, settings)
    depth_difference = hydrophone - message.depth
    if told is None and not settings.transmitter_offsets:
        origin, arms = Point(message.east, message.north), _arms(attitude, heading, t)
        return RangeCircles(fix.circles(origin, arms, reception.ranges, depth_difference), heading, depth_difference)
    if told is None:
        offsets = np.full((3, 3), np.nan)
        offsets[: len(settings.transmitter_offsets)] = settings.transmitter_offsets
        origin_3 = (message.east, message.north, message.depth)
        told = place_on_body(origin_3, attitude or (message.heading, 0.0, 0.0), offsets)
    return RangeCircles(_about(told.tolist(), reception.ranges, hydrophone), heading, depth_difference, off_hull=True)


def _on_line(pair: Pair, kind: float) -> Fix:
    """The point of the line through two transmitters, apart from each other, that fits both ranges best.

    Where the circles lie apart or within each other, it is midway between them; where they meet in two points close
    together, between these. The rule that the follower is behind the leader has no meaning for beacons, and would be
    wrong by up to twice the range between them.
    """
    (rear, d_rear), (front, d_front) = pair.rear, pair.front
    way = front.east - rear.east, front.north - rear.north
    length = math.hypot(*way)
    if d_rear + d_front < length:
        along = 0.5 * (d_rear + length - d_front)
    elif d_rear - d_front > length:
        along = 0.5 * (d_rear + length + d_front)
    elif d_front - d_rear > length:
        along = 0.5 * (length - d_rear - d_front)
    else:
        along = (length**2 + d_rear**2 - d_front**2) / (2.0 * length)
    share = along / length
    return Fix(rear.east + share * way[0], rear.north + share * way[1], 0.0, kind, -1.0)


def pair_fix(pair: Pair, heard: RangeCircles, predicted: Point, t: Tuning) -> Fix:
    """Fix of a pair by `fix.pair_fix`; transmitters on no hull have no side behind them, but a line they are on."""
    found = fix.pair_fix(pair, heard.heading, predicted, t)
    beacons = heard.off_hull and found.kind == FixKind.ASTERN and pair.rear.centre != pair.front.centre
    return _on_line(pair, found.kind) if beacons else found


class OneRange(NamedTuple):
    """What one range alone tells: where the follower is along one line."""

    place: Point
    axis: Point
    """Unit vector from the transmitter to the prediction."""


def one_range(circles: Circles, predicted: Point) -> OneRange | None:
    """The point nearest to the prediction on the circle of the first range that was received; None if none was.

    The paper has no use for one range alone. Its P_D for the rear transmitter, dead astern of the leader, would be one,
    but is wrong by up to twice the range for a follower that is elsewhere. Here the range corrects what it measures,
    the distance, and leaves the direction to the prediction.
    """
    for centre, radius in circles:
        east, north = predicted.east - centre.east, predicted.north - centre.north
        distance = math.hypot(east, north)
        if math.isnan(radius) or math.isnan(distance) or distance == 0.0:
            continue
        axis = Point(east / distance, north / distance)
        return OneRange(Point(centre.east + radius * axis.east, centre.north + radius * axis.north), axis)
    return None
