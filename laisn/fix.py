"""Fixes, which turn ranges into a position: every variant of LAISN (paper, Sections 2.2 and 2.3).

A *pair* of transmitters gives two circles. Where they meet in two points well apart, the one nearest to the
prediction is taken; otherwise the follower is put onto the pair's axis behind the leader. The variants differ in how
they combine the pairs (1, 2), (1, 3) and (2, 3).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from laisn import FRONT, MIDDLE, REAR
from laisn.estimates import FixKind
from laisn.geometry import horizontal_range, intersections, place_on_body, transmitter_positions
from laisn.messages import LeaderMessage, Reception
from laisn.settings import NavigationSettings

Floats = npt.NDArray[np.float64]
Point = tuple[float, float]


class Pair(NamedTuple):
    """Two transmitters, the rear one first, and the one that P_D is measured from (paper, Eq. 23)."""

    rear: int
    front: int
    anchor: int


PAIRS = (Pair(REAR, FRONT, REAR), Pair(REAR, MIDDLE, REAR), Pair(MIDDLE, FRONT, FRONT))
"""The pairs (1, 2), (1, 3) and (2, 3) of the paper."""
MAIN = PAIRS[0]


class Circles(NamedTuple):
    """What a reception tells about the follower's horizontal position."""

    centre: Floats
    """Horizontal positions of the transmitters, shape (3, 2), [m]."""
    radius: tuple[float, float, float]
    """Horizontal ranges D_i [m]; NaN where nothing was received."""
    heading: float
    """Leader's heading [rad]."""
    depth_difference: float
    """Δz, depth of the hydrophone less that of the leader [m]."""
    free: bool = False
    """The transmitters sit on no leader's hull, so that nothing is known of the side that the follower is on."""


class Fix(NamedTuple):
    """A position measurement for the filter."""

    position: Point
    """z [m]; NaN if LOST."""
    sigma: float
    """σp [m]."""
    kind: FixKind
    axis: Point | None = None
    """Unit vector (east, north) of the only direction that z is known in; None: all."""


class PairFix(NamedTuple):
    """A fix from one pair, with what the combination of pairs needs to know."""

    n_points: int
    """N."""
    separation: float
    """Distance of two intersections [m], else 0."""
    fix: Fix

    @property
    def clear(self) -> bool:
        """The circles meet, and not in two points closer than T."""
        return self.fix.kind in (FixKind.TWO_POINTS, FixKind.TANGENT)


LOST = Fix((np.nan, np.nan), np.nan, FixKind.LOST)


def _transmitters(message: LeaderMessage, settings: NavigationSettings) -> Floats:
    """Rows of (east, north, depth), shape (3, 3), [m]; NaN for a middle one that is not there."""
    known = settings.use_attitude and not np.isnan(message.pitch) and not np.isnan(message.roll)
    attitude = (message.heading, message.pitch if known else 0.0, message.roll if known else 0.0)
    origin = (message.east, message.north, message.depth)
    if not settings.transmitter_offsets:
        return transmitter_positions(origin, attitude, settings.baseline, settings.middle_offset)
    offsets = np.full((3, 3), np.nan)
    offsets[: len(settings.transmitter_offsets)] = settings.transmitter_offsets
    return place_on_body(origin, attitude, offsets)


def circles(reception: Reception, own_depth: float, settings: NavigationSettings) -> Circles:
    """Transmitters where the follower believes them to be, and horizontal ranges to them.

    They are where the message says; if it does not, on the leader, which is taken as level unless its attitude is
    broadcast and used. A slant range shorter than the depth difference counts as a horizontal range of 0, and one to a
    transmitter whose place is unknown as not received.
    """
    message, told = reception.message, reception.transmitters
    transmitters = _transmitters(message, settings) if told is None else told
    hydrophone = own_depth - settings.hydrophone_height
    rear, front, middle = (horizontal_range(r, hydrophone - transmitters[i, 2]) for i, r in enumerate(reception.ranges))
    free = told is not None or bool(settings.transmitter_offsets)
    return Circles(transmitters[:, :2], (rear, front, middle), message.heading, hydrophone - message.depth, free)


def _on_line(rear: Floats, front: Floats, d_rear: float, d_front: float) -> Fix:
    """The point of the line through two transmitters, apart from each other, that fits both ranges best.

    Where the circles lie apart or within each other, it is midway between them; where they meet in two points close
    together, between these. The rule that the follower is behind the leader has no meaning for beacons, and would be
    wrong by up to twice the range between them.
    """
    length = float(np.hypot(*(front - rear)))
    if d_rear + d_front < length:
        along = 0.5 * (d_rear + length - d_front)
    elif d_rear - d_front > length:
        along = 0.5 * (d_rear + length + d_front)
    elif d_front - d_rear > length:
        along = 0.5 * (length - d_rear - d_front)
    else:
        along = (length**2 + d_rear**2 - d_front**2) / (2.0 * length)
    east, north = rear + along / length * (front - rear)
    return Fix((float(east), float(north)), 0.0, FixKind.ASTERN)


def one_range(heard: Circles, predicted: Point) -> Fix:
    """The point nearest to the prediction on the circle of the first range that was received; LOST if none was.

    The paper has no use for one range alone. Its P_D for the rear transmitter, dead astern of the leader, would be one,
    but is wrong by up to twice the range for a follower that is elsewhere. Here the range corrects what it measures,
    the distance, and leaves the direction to the prediction.
    """
    for centre, radius in zip(heard.centre, heard.radius, strict=True):
        away = np.array(predicted) - centre
        distance = float(np.hypot(away[0], away[1]))
        if np.isnan(radius) or distance == 0.0:
            continue
        east, north = away / distance
        x, y = centre + radius / distance * away
        return Fix((float(x), float(y)), 0.0, FixKind.ONE_RANGE, (float(east), float(north)))
    return LOST


def _on_axis(pair: Pair, heard: Circles, predicted: Point, settings: NavigationSettings) -> Fix:
    """P_D: on the pair's axis behind the leader (paper, Section 2.2 and Eq. 23), σp = 0.

    With the side rule "predicted" and a prediction ahead of the pair's middle, the point lies ahead instead, at the
    front transmitter's range from it. Transmitters on no hull have neither: see `_on_line`.
    """
    rear, front = heard.centre[pair.rear], heard.centre[pair.front]
    axis = front - rear
    length = float(np.hypot(axis[0], axis[1]))
    if heard.free and length > 0:
        return _on_line(rear, front, heard.radius[pair.rear], heard.radius[pair.front])
    heading = heard.heading
    unit = axis / length if length > 0 else np.array([np.sin(heading), np.cos(heading)])
    ahead = settings.side_rule == "predicted" and float(np.dot(predicted - 0.5 * (rear + front), unit)) > 0
    if ahead:
        east, north = front + heard.radius[pair.front] * unit
    else:
        east, north = heard.centre[pair.anchor] - heard.radius[pair.anchor] * unit
    return Fix((float(east), float(north)), 0.0, FixKind.ASTERN)


def pair_fix(pair: Pair, heard: Circles, predicted: Point, settings: NavigationSettings) -> PairFix | None:
    """Fix of one pair (paper, Section 2.2); None if one of its ranges is missing.

    Of two intersections at the same distance from the prediction the one to port is taken.
    """
    i, j = pair.rear, pair.front
    if np.isnan(heard.radius[i]) or np.isnan(heard.radius[j]):
        return None
    (xi, yi), (xj, yj) = heard.centre[i].tolist(), heard.centre[j].tolist()
    meet = intersections(xi, yi, heard.radius[i], xj, yj, heard.radius[j])
    if meet.n_points == 1:
        return PairFix(1, 0.0, Fix(meet.left, 0.0, FixKind.TANGENT))
    if meet.n_points == 0 or meet.separation < settings.threshold:
        return PairFix(meet.n_points, meet.separation, _on_axis(pair, heard, predicted, settings))
    x, y = predicted
    to_left = (x - meet.left[0]) ** 2 + (y - meet.left[1]) ** 2
    to_right = (x - meet.right[0]) ** 2 + (y - meet.right[1]) ** 2
    nearest = meet.left if to_left <= to_right else meet.right
    fix = Fix(nearest, settings.beta / meet.separation, FixKind.TWO_POINTS)
    return PairFix(2, meet.separation, fix)


def laisn_2(heard: Circles, predicted: Point, settings: NavigationSettings) -> Fix:
    """Two transmitters (paper, Section 2.2)."""
    main = pair_fix(MAIN, heard, predicted, settings)
    return LOST if main is None else main.fix


def _available(heard: Circles, predicted: Point, settings: NavigationSettings) -> list[PairFix]:
    candidates = (pair_fix(pair, heard, predicted, settings) for pair in PAIRS)
    return [candidate for candidate in candidates if candidate is not None]


def laisn_3_2(heard: Circles, predicted: Point, settings: NavigationSettings) -> Fix:
    """Weighted mean of the pairs whose circles meet, w_i = 1 / (1 + σp,i) (paper, Eqs. 24 and 25).

    If no pair's circles meet, the fix is P_D of the first pair that was received, (1, 2) if possible. The factor 1/3 of
    Eq. 25 is kept when fewer than three pairs contribute.
    """
    pairs = _available(heard, predicted, settings)
    if not pairs:
        return LOST
    met = [pair.fix for pair in pairs if pair.n_points > 0]
    if not met:
        return pairs[0].fix
    weights = np.array([1.0 / (1.0 + fix.sigma) for fix in met])
    points = np.array([fix.position for fix in met])
    east, north = weights @ points / weights.sum()
    sigma = sum(fix.sigma for fix in met) / 3.0
    return Fix((float(east), float(north)), sigma, met[0].kind if len(met) == 1 else FixKind.FUSED)


def laisn_best(heard: Circles, predicted: Point, settings: NavigationSettings) -> Fix:
    """The most certain pair alone: N = 1, else the largest distance of intersections (paper, Section 2.3.3).

    If no pair's circles meet, the fix is P_D of the first pair that was received.
    """
    pairs = _available(heard, predicted, settings)
    if not pairs:
        return LOST
    met = [pair for pair in pairs if pair.n_points > 0]
    if not met:
        return pairs[0].fix
    # max keeps the first of equals, which is the order of the pairs
    return max(met, key=lambda pair: np.inf if pair.n_points == 1 else pair.separation).fix


def laisn_main(heard: Circles, predicted: Point, settings: NavigationSettings) -> Fix:
    """The main pair; the others only where it is missing, does not meet, or meets too close (Section 2.3.3).

    If no pair is clear, the fix is P_D of the first pair that was received.
    """
    pairs = _available(heard, predicted, settings)
    if not pairs:
        return LOST
    return next((pair for pair in pairs if pair.clear), pairs[0]).fix


SINGLE = {"laisn-2": laisn_2, "laisn-3-2": laisn_3_2, "laisn-best": laisn_best, "laisn-main": laisn_main}
"""The variants with one fix a message; LAISN-3(1) updates with one pair after the other."""


def effective_sigma(fix: Fix, heard: Circles, settings: NavigationSettings) -> float:
    """σp as the filter is given it: not below the floor, and inflated by the pitch that must be expected [m].

    An unknown pitch φ of the leader shifts a fix abeam by Δz sin φ whatever the range.
    """
    shift = heard.depth_difference * np.sin(settings.expected_pitch)
    return float(np.hypot(max(fix.sigma, settings.sigma_floor), shift))
