"""One message: predict, split, update, prune and merge; online in `TightNavigator`, and in a loop
in campaigns.

Two transmitters cannot distinguish port from starboard. A hypothesis that reaches across the axis
is split there into its two halves, so that each is one-sided and its ranges nearly linear;
unsupported ones are pruned, coinciding ones merged. For an unknown start, and for a mixture that is
inconsistent with the ranges, the prior is a ring about the nearest transmitter: a sum of Gaussians,
one for each bearing, each updated with the ranges and merged on either side of the axis.
"""

import math

import numpy as np

from laisn import mixture
from laisn.compiled import compiled
from laisn.delays import LONGEST_DELAY, NEGLIGIBLE_DELAY
from laisn.estimates import HYPOTHESES
from laisn.geometry import SinCos, sin_cos_of, tilted_arms
from laisn.tight import motion
from laisn.tight.model import COMPASS_BIAS, LOG_BIAS, X, Y, refresh_output
from laisn.tight.ranging import relative_covariance, relative_position, update, way_since_ping
from laisn.tight.records import (
    ABSENT,
    CAPACITY,
    SPARE,
    WAY_XX,
    WAY_XY,
    WAY_YY,
    CompassTurn,
    GaussianMixture,
    Model,
    RangeMessage,
)
from laisn.vector_math import half_turn_angle, sin_cos

# least lateral standard deviation of a split, as a share of the distance ℓ_c at which the axis
# matters, and at most [m]: far away halves that wide still drift to the wrong side
_SPLIT = 0.2
_MAX_SPLIT_SIGMA = 1.0
# a hypothesis reaches across the axis that is within so many of its lateral standard deviations
_REACH = 3.5
_MIN_WEIGHT = 1e-5
# squared Mahalanobis distance below which two hypotheses are one
_MERGE_DISTANCE = 1.0
# squared Mahalanobis distance of one position, where the leader's position errs anew in each
# message: its sides, which each message splits, would soon be more than can be kept
_MERGE_DISTANCE_BESIDE_ERRORS = 2.0


@compiled
def _lateral_offset(
    b: GaussianMixture, m: Model, k: int, message: RangeMessage
) -> tuple[float, float, float]:
    """Distance ℓ of component k to the left of the line from transmitter 1 to 2, with P ∇ℓ in
    `b.ph`; its variance; and the distance ℓ_c at which the axis matters: where the difference of
    both ranges has bent by 1.4 of their errors.
    """
    # vectors, east and north: e from transmitter 1 to 2 at the broadcast heading, t that direction
    # turned by b_L; q from the leader and o from transmitter 1 to the follower; r what the way of
    # the follower between both pings adds to the axis
    x = b.state
    P = b.covariance
    arms = message.arms
    ph = b.ph
    has_leader_bias = m.leader_bias != ABSENT
    s, c = sin_cos(x[k, m.leader_bias] if has_leader_bias else 0.0)
    ex, ey = arms[1, 0] - arms[0, 0], arms[1, 1] - arms[0, 1]
    qx, qy = relative_position(b, m, k, message)
    if message.late:
        way_x, way_y, _, _ = way_since_ping(b, k, message, 0)
        front_way_x, front_way_y, _, _ = way_since_ping(b, k, message, 1)
        # the axis of the places from which the pings seem to come
        rx, ry = front_way_x - way_x, front_way_y - way_y
        ex += c * rx + s * ry
        ey += c * ry - s * rx
        qx -= way_x
        qy -= way_y
    length = math.sqrt(ex * ex + ey * ey)
    tx, ty = (c * ex - s * ey) / length, (s * ex + c * ey) / length
    relative_cov_x, relative_cov_y = relative_covariance(b, m, k)
    ox, oy = qx - (c * arms[0, 0] - s * arms[0, 1]), qy - (s * arms[0, 0] + c * arms[0, 1])
    # ∇ℓ by x, y and b_L
    gx = -ty
    gy = tx
    gl = -(tx * qx + ty * qy)
    # P ∇ℓ, and its variance ∇ℓᵀ P ∇ℓ
    for i in range(m.n_states):
        ph[i] = relative_cov_x[i] * gx + relative_cov_y[i] * gy
        if has_leader_bias:
            ph[i] += P[k, i, m.leader_bias] * gl
    variance = ph[X] * gx + ph[Y] * gy
    if m.leader_position != ABSENT:
        variance -= ph[m.leader_position] * gx + ph[m.leader_position + 1] * gy
    if m.leader_position_walk != ABSENT:
        variance -= ph[m.leader_position_walk] * gx + ph[m.leader_position_walk + 1] * gy
    if has_leader_bias:
        variance += ph[m.leader_bias] * gl
    critical = math.sqrt(qx * qx + qy * qy) * math.sqrt(2.8 * m.range_sigma / length)
    return tx * oy - ty * ox, variance, critical


@compiled
def _truncate_to_side(
    b: GaussianMixture, m: Model, k: int, message: RangeMessage, side: float
) -> None:
    """Replace component k by its part on one side of the axis: left for +1, right for −1; with
    its exact moments.
    """
    x = b.state
    P = b.covariance
    g = b.ph
    lateral, variance, _ = _lateral_offset(b, m, k, message)
    sigma = math.sqrt(variance)
    mass, shift, narrowing = mixture.half_moments(side * lateral / sigma)
    b.weight[k] *= mass
    # of the half of a normal variable u = (ℓ − ℓ̄) / σ: x += ± λ g, P −= λ (λ + z) g gᵀ with
    # g = P ∇ℓ / σ, as of `half_moments`
    for i in range(m.n_states):
        g[i] /= sigma
        x[k, i] += side * shift * g[i]
        for j in range(i + 1):
            P[k, i, j] -= narrowing * g[i] * g[j]
            P[k, j, i] = P[k, i, j]


@compiled
def split(b: GaussianMixture, m: Model, message: RangeMessage) -> None:
    """Split every hypothesis that is wide enough at the leader's axis for both of its sides to
    matter.
    """
    for h in range(b.n_hypotheses):
        lateral, variance, critical = _lateral_offset(
            b, m, mixture.heaviest(b, m.modes, h), message
        )
        threshold = min(_SPLIT * critical, _MAX_SPLIT_SIGMA)
        is_wide = variance > threshold * threshold and abs(lateral) < _REACH * math.sqrt(variance)
        if b.n_hypotheses < CAPACITY and is_wide:
            other = b.n_hypotheses
            b.n_hypotheses += 1
            mixture.copy_hypothesis(b, m.modes, h, other)
            for mode in range(m.modes):
                _truncate_to_side(b, m, h * m.modes + mode, message, 1.0)
                _truncate_to_side(b, m, other * m.modes + mode, message, -1.0)


@compiled
def prune_and_merge(b: GaussianMixture, m: Model) -> None:
    """Prune and merge hypotheses, and keep the heaviest few; those with different leader
    headings are not merged.
    """
    merge_distance = (
        _MERGE_DISTANCE if m.leader_position == ABSENT else _MERGE_DISTANCE_BESIDE_ERRORS
    )
    b.n_hypotheses = mixture.prune_and_merge(
        b, m.modes, b.n_hypotheses, _MIN_WEIGHT, HYPOTHESES, m.leader_bias, merge_distance
    )
    mixture.normalise(b.weight, b.n_hypotheses * m.modes)


_BEARINGS = 96
# of a hypothesis's distance before the update [m²]: wide beside all errors of a range
_RADIAL_VARIANCE = 25.0
# smoothed NIS, of which 1 is expected, above which the mixture is inconsistent
_INCONSISTENT_NIS = 3.0
# that the hypotheses of a ring are given together, where the mixture is inconsistent
_RING_WEIGHT = 0.002
_POSITION_SIGMA = 10.0  # of the ring's weight around the belief so far, along each axis [m]
_FAR_WEIGHT = 0.01  # of the ring far from the belief so far, where that at the belief is 1


@compiled
def _rotate_to_bias(b: GaussianMixture, m: Model, k: int) -> None:
    """Turn a component about the leader, which is at the origin, by the error of its heading,
    with b_L.
    """
    P = b.covariance
    by_bias_x = -b.state[k, Y]
    by_bias_y = b.state[k, X]
    bias_variance = b.prior_variance[m.leader_bias]
    heading_variance = bias_variance + b.leader_variance
    # P += (v + σ_b²) g gᵀ of the position, with g = ∂(x, y)/∂b_L, and σ_b² g with b_L
    P[k, X, X] += heading_variance * by_bias_x * by_bias_x
    P[k, Y, Y] += heading_variance * by_bias_y * by_bias_y
    P[k, X, Y] += heading_variance * by_bias_x * by_bias_y
    P[k, Y, X] = P[k, X, Y]
    P[k, X, m.leader_bias] = P[k, m.leader_bias, X] = bias_variance * by_bias_x
    P[k, Y, m.leader_bias] = P[k, m.leader_bias, Y] = bias_variance * by_bias_y
    P[k, m.leader_bias, m.leader_bias] = bias_variance


@compiled
def _merge_ring(
    b: GaussianMixture, m: Model, message: RangeMessage, first: int, mean: tuple[float, float]
) -> bool:
    """Update a Gaussian at each bearing, and merge those left and right of the axis into `first`
    and `first` + modes.

    The leader is at the origin with an exact heading; `mean` is the mean so far [m], or NaN. False
    if an update failed.
    """
    nearest = 0
    shortest = math.inf
    for i in range(m.transmitters):
        if message.ranges[i] < shortest:
            nearest = i
            shortest = message.ranges[i]
    centre = (message.arms[nearest, 0], message.arms[nearest, 1])
    depth_difference = message.arms[nearest, 2]
    distance = math.sqrt(max(shortest * shortest - depth_difference * depth_difference, 1.0))
    best = -math.inf
    for h in range(2):
        mixture.reset_component(b, first + h * m.modes, b.prior_variance)
    for merging in (False, True):
        for j in range(_BEARINGS):
            direction = sin_cos(2.0 * math.pi * (j + 0.5) / _BEARINGS)
            mixture.reset_component(b, SPARE, b.prior_variance)
            motion.start_speed(b, m, SPARE)
            if m.leader_bias != ABSENT:
                b.covariance[SPARE, m.leader_bias, m.leader_bias] = 0.0
            ring = (_RADIAL_VARIANCE, _BEARINGS)
            mixture.place_on_ring(b, SPARE, centre, distance, direction, ring)
            if update(b, m, SPARE, message) < 0:
                return False
            evidence = b.evidence[SPARE]
            dx, dy = b.state[SPARE, X] - mean[0], b.state[SPARE, Y] - mean[1]
            if dx == dx:
                square = (dx * dx + dy * dy) / (_POSITION_SIGMA * _POSITION_SIGMA)
                evidence += math.log(_FAR_WEIGHT + math.exp(-0.5 * square))
            if merging:
                left = _lateral_offset(b, m, SPARE, message)[0] > 0.0
                b.weight[SPARE] = math.exp(evidence - best)
                mixture.merge_components(b, first if left else first + m.modes, SPARE)
            else:
                best = max(best, evidence)
    return True


@compiled
def add_ring(b: GaussianMixture, m: Model, message: RangeMessage, weight: float) -> bool:
    """Add two hypotheses, of `weight` together, of a message with two ranges or more; there must be
    room, and `SPARE`.

    False if a covariance was not positive definite.
    """
    first = b.n_hypotheses * m.modes
    mean = (b.output.x - message.east, b.output.y - message.north)
    east = message.east
    north = message.north
    variance = b.leader_variance
    # about the leader, and with its heading as broadcast
    message.east = message.north = b.leader_variance = 0.0
    healthy = _merge_ring(b, m, message, first, mean)
    message.east = east
    message.north = north
    b.leader_variance = variance
    total = b.weight[first] + b.weight[first + m.modes]
    if not healthy or not total > 0.0:
        return False
    for k in range(first):
        b.weight[k] *= 1.0 - weight
    for h in range(2):
        k = b.n_hypotheses * m.modes
        if h == 1 and k == first:
            # nothing was left on the other side
            mixture.copy_component(b, first + m.modes, first)
        if b.weight[k] > 0.0:
            if m.leader_bias != ABSENT:
                _rotate_to_bias(b, m, k)
            b.state[k, X] += message.east
            b.state[k, Y] += message.north
            b.weight[k] *= weight / (total * m.modes)
            for mode in range(1, m.modes):
                mixture.copy_component(b, k, k + mode)
            b.n_hypotheses += 1
    mixture.normalise(b.weight, b.n_hypotheses * m.modes)
    prune_and_merge(b, m)
    return True


# a compass bias so uncertain that it bends the way by more is taken from the message first [m]
_MAX_WAY_BEND = 0.003
_SMOOTHING = 0.15  # of the NIS
# of the estimated variance of the leader's heading, which never exceeds that of the settings
_VARIANCE_GAIN = 0.1
_MIN_LEADER_VARIANCE = math.radians(0.1) ** 2
# messages in a row of which the ranges may be echoes of one excess, before they count as direct
_MAX_COMMON_ECHOES = 10
# messages in a row without an accepted range, after which covariances are inflated
_MAX_MISSED = 3
# what they are inflated by: along each axis [m²], and of b_θ [rad²]
_ADDED_POSITION = 1.0
_ADDED_COMPASS = math.radians(2.0) ** 2

# turns up to these change nothing, as readings err by a part of them [rad]
_NEGLIGIBLE_TURN = 0.1
_NEGLIGIBLE_LEADER_TURN = 0.15
_TURN_OVER_AFTER = 10.0  # a turn is over where it has not gone on for so long [s]


@compiled
def largest_echo_excess(m: Model, message: RangeMessage, leader_below: float) -> float:
    """By how much the range of an echo may exceed the direct one, at most [m]; the leader's origin
    is `leader_below` the hydrophone [m].

    With d and d' the distances of both vehicles from the surface or the floor, an echo's way is
    √(r² + 4 d d'); of a range that is an echo's itself r is shorter, but not by more than d − d'.
    """
    leader_depth = message.depth
    receiver_depth = message.depth - leader_below
    product = leader_depth * receiver_depth
    if m.floor_depth > 0.0:
        product = max(product, (m.floor_depth - leader_depth) * (m.floor_depth - receiver_depth))
    largest = 0.0
    for i in range(m.transmitters):
        echo = message.ranges[i]
        if product > 0.0 and echo == echo:
            direct = math.sqrt(max(echo * echo - 4.0 * product, leader_below * leader_below))
            largest = max(largest, echo - direct)
    return largest + _ECHO_MARGIN


_ECHO_MARGIN = 1.0  # errors of depths and ranges [m]


@compiled
def place_arms(
    message: RangeMessage, m: Model, pitch: float, roll: float, leader_below: float
) -> None:
    """Fill in the arms of the transmitters at the broadcast heading, pitch and roll [rad] (level
    where either is NaN).

    The leader's origin is `leader_below` the hydrophone [m]; NaN: unknown, so that no range counts
    as received.
    """
    if leader_below != leader_below:
        for i in range(3):
            message.ranges[i] = np.nan
    message.echo_span = largest_echo_excess(m, message, leader_below)
    heading = SinCos(*sin_cos(message.heading))
    pitched = SinCos(0.0, 1.0)
    rolled = SinCos(0.0, 1.0)
    if m.use_attitude and pitch == pitch and roll == roll:
        pitched = sin_cos_of(pitch)
        rolled = sin_cos_of(roll)
    placed = tilted_arms(m.baseline, m.middle_offset, heading, pitched, rolled)
    east, north, up = placed.front
    middle_east, middle_north, middle_up = placed.middle
    arms = message.arms
    arms[0, 0] = -east
    arms[0, 1] = -north
    arms[0, 2] = leader_below + up
    arms[1, 0] = east
    arms[1, 1] = north
    arms[1, 2] = leader_below - up
    arms[2, 0] = middle_east
    arms[2, 1] = middle_north
    arms[2, 2] = leader_below - middle_up
    # the leader goes on from ping to ping
    distance = m.ping_slot * message.speed
    for i in range(1, 3):
        arms[i, 0] += i * distance * heading.sine
        arms[i, 1] += i * distance * heading.cosine


@compiled
def mix_modes(b: GaussianMixture, m: Model) -> None:
    """Blend the modes of drift of each hypothesis, by the time since the last message; nothing
    where there is one.
    """
    if m.drift_modes == 1:
        return
    for h in range(b.n_hypotheses):
        for speed_mode in range(m.speed_modes):
            slow_drift = h * m.modes + 2 * speed_mode
            motion.mix_pair(b, m, slow_drift, slow_drift + 1, m.mode_switches * b.motion.elapsed)


@compiled
def _turn_growth(
    turn: CompassTurn, direction: tuple[float, float], min_angle: float, time: float
) -> float:
    """Growth of the squared angle [rad²] of a turn of at least `min_angle` [rad], `time` seconds
    after the last call. `direction` is sine and cosine of the heading now.
    """
    sine, cosine = direction
    is_turning = turn.sin != 0.0 or turn.cos != 0.0
    angle = half_turn_angle(
        sine * turn.cos - cosine * turn.sin, sine * turn.sin + cosine * turn.cos
    )
    turn.still_time += time
    if is_turning and angle > max(turn.angle, min_angle):
        gained: float = angle * angle - turn.angle * turn.angle
        turn.angle = angle
        turn.still_time = 0.0
        return gained
    if not is_turning or turn.still_time >= _TURN_OVER_AFTER - 1e-6:
        turn.sin = sine
        turn.cos = cosine
        turn.angle = 0.0
        turn.still_time = 0.0
    return 0.0


@compiled
def inflate_bias_covariance(b: GaussianMixture, m: Model, message: RangeMessage) -> None:
    """Inflate bias covariances before an update: by a share of the whole turns since the last
    message, where compasses have a deviation, and by the error of the leg's heading. Takes the
    variance of the message's position for the belief too.
    """
    o = b.motion
    has_leader_bias = m.leader_bias != ABSENT
    compass_growth = 0.0
    leader_growth = 0.0
    b.leader_position_variance = message.leader_position_variance
    if m.deviation > 0.0:
        compass_growth = m.deviation * _turn_growth(
            b.turn, (o.sin, o.cos), _NEGLIGIBLE_TURN, o.elapsed
        )
        if has_leader_bias:
            leader_growth = m.deviation * _turn_growth(
                b.leader_turn, sin_cos(message.heading), _NEGLIGIBLE_LEADER_TURN, o.elapsed
            )
    for k in range(b.n_hypotheses * m.modes):
        b.covariance[k, COMPASS_BIAS, COMPASS_BIAS] += compass_growth
        if has_leader_bias:
            b.state[k, m.leader_bias] += message.shift
            b.covariance[k, m.leader_bias, m.leader_bias] += leader_growth
            b.covariance[k, m.leader_bias, m.leader_bias] += message.added_variance


@compiled
def _propagate_iterated(
    b: GaussianMixture, m: Model, k: int, message: RangeMessage, range_model: Model
) -> bool:
    """Predict component k; where its compass bias bends the way too much, at the biases of a
    first update.

    `range_model` is the model of the link that the ranges came by: `m` itself for the main link.
    """
    x = b.state
    distance = math.sqrt(b.motion.ax**2 + b.motion.ay**2)
    log_bias = x[k, LOG_BIAS]
    compass_bias = x[k, COMPASS_BIAS]
    healthy = True
    if m.speed != ABSENT:
        # predicted step by step
        if m.leader_position != ABSENT:
            motion.reset_position_error(b, m, k)
        return True
    if 0.5 * b.covariance[k, COMPASS_BIAS, COMPASS_BIAS] * distance >= _MAX_WAY_BEND:
        mixture.copy_component(b, k, SPARE)
        motion.predict_component(b, m, k, log_bias, compass_bias)
        healthy = update(b, range_model, k, message) >= 0
        log_bias = x[k, LOG_BIAS]
        compass_bias = x[k, COMPASS_BIAS]
        mixture.copy_component(b, SPARE, k)
    motion.predict_component(b, m, k, log_bias, compass_bias)
    return healthy


@compiled
def update_leader_variance(b: GaussianMixture, m: Model) -> None:
    """Estimate the variance of the leader's heading error per message: at most the scatter of
    readings on legs.
    """
    excess = 0.0
    for k in range(b.n_hypotheses * m.modes):
        excess += b.weight[k] * b.turn_excess[k]
    variance = min(b.leader_variance + _VARIANCE_GAIN * excess, b.leader.scatter)
    b.leader_variance = min(max(variance, _MIN_LEADER_VARIANCE), m.leader_variance)


@compiled
def _check_consistency(
    b: GaussianMixture, m: Model, message: RangeMessage, received: int, used: int
) -> bool:
    """Smooth the NIS, and reinitialise or inflate a belief that the ranges do not fit; False if
    that failed.
    """
    normalised_innovation = 0.0
    for k in range(b.n_hypotheses * m.modes):
        normalised_innovation += b.weight[k] * b.outcome[k].normalised_innovation
    b.smoothed_nis += _SMOOTHING * (normalised_innovation - b.smoothed_nis)
    likeliest = mixture.heaviest(
        b, m.modes, mixture.heaviest_hypothesis(b, m.modes, b.n_hypotheses)
    )
    b.common_echoes = b.common_echoes + 1 if b.outcome[likeliest].shared else 0
    # a ring of echoes would be where no vehicle is; too many in a row are none
    from_echoes = 0 < b.common_echoes < _MAX_COMMON_ECHOES
    if received > 1 and not from_echoes and not b.smoothed_nis < _INCONSISTENT_NIS:
        b.smoothed_nis = 1.0
        refresh_output(b, m)
        if not add_ring(b, m, message, _RING_WEIGHT):
            return False
    b.missed_updates = 0.0 if used > 0 else b.missed_updates + 1.0
    if b.missed_updates >= _MAX_MISSED:
        for k in range(b.n_hypotheses * m.modes):
            b.covariance[k, X, X] += _ADDED_POSITION
            b.covariance[k, Y, Y] += _ADDED_POSITION
            b.covariance[k, COMPASS_BIAS, COMPASS_BIAS] += _ADDED_COMPASS
    return True


@compiled
def _time_pings(b: GaussianMixture, m: Model, message: RangeMessage) -> None:
    """Write into `message` what the follower has gone since each ping arrived, and for how long the
    current has carried both vehicles, `drift_time`; `late` is 1 if any of them counts, else 0.
    """
    message.late = 0
    if not m.compensate_motion:
        return
    last = 0.0
    for i in range(m.transmitters):
        if message.ranges[i] == message.ranges[i]:
            last = max(last, i * m.ping_slot + m.sound_slowness * message.ranges[i])
    elapsed = b.motion.clock - message.time
    # zero states no time
    if message.time == 0.0 or not last <= elapsed <= LONGEST_DELAY:
        elapsed = last
    shortest_lag = math.inf
    for i in range(m.transmitters):
        message.drift_time[i] = 0.0
        message.way_by_mean_speed[i, 0] = message.way_by_mean_speed[i, 1] = 0.0
        if message.ranges[i] == message.ranges[i]:
            travel_time = m.sound_slowness * message.ranges[i]
            # since the ping arrived the follower has gone on; since the message began, and not this
            # ping, the current has carried both vehicles
            lag = max(elapsed - i * m.ping_slot - travel_time, 0.0)
            motion.write_way_since(b, lag, message.way[i])
            message.drift_time[i] = max(elapsed - travel_time, 0.0)
            if message.drift_time[i] > NEGLIGIBLE_DELAY:
                message.late = 1
            if lag < shortest_lag:
                shortest_lag = lag
                message.last_to_arrive = i
    if not message.late:
        return
    for i in range(m.transmitters):
        if message.ranges[i] == message.ranges[i] and i != message.last_to_arrive:
            lag = max(elapsed - i * m.ping_slot - m.sound_slowness * message.ranges[i], 0.0)
            motion.take_mean_speed(b, m, message, i, (lag, shortest_lag))


@compiled
def _begin(b: GaussianMixture, m: Model, message: RangeMessage) -> int:
    """Make the belief from a first message; see `receive`."""
    if m.leader_position != ABSENT:
        b.prior_variance[m.leader_position] = b.prior_variance[m.leader_position + 1] = (
            message.leader_position_variance
        )
    if m.leader_position_walk != ABSENT:
        walk_variance = m.leader_position_walk_rate * b.motion.clock
        b.prior_variance[m.leader_position_walk] = b.prior_variance[m.leader_position_walk + 1] = (
            walk_variance
        )
    if not add_ring(b, m, message, 1.0):
        return -1
    # all ranges were used, but nothing had been expected of them that they could have missed
    for k in range(b.n_hypotheses * m.modes):
        b.outcome[k].n_used = b.received
        b.outcome[k].nis_sum = np.nan
    motion.reset_preintegration(b)
    b.motion.elapsed = 0.0
    refresh_output(b, m)
    return int(b.received)


@compiled
def _update_components(b: GaussianMixture, m: Model, message: RangeMessage) -> int:
    """Update all components; the most ranges that one used, −1 if a covariance was not positive
    definite.
    """
    most_ranges = 0
    for k in range(b.n_hypotheses * m.modes):
        used = update(b, m, k, message)
        if used < 0:
            return -1
        if used > 0 and message.late and m.speed == ABSENT:
            # what dead reckoning errs since then no range shows
            way = message.way[message.last_to_arrive]
            b.covariance[k, X, X] += way[WAY_XX]
            b.covariance[k, X, Y] += way[WAY_XY]
            b.covariance[k, Y, X] += way[WAY_XY]
            b.covariance[k, Y, Y] += way[WAY_YY]
        most_ranges = max(most_ranges, used)
    return most_ranges


@compiled
def _use_ranges(b: GaussianMixture, m: Model, range_model: Model, message: RangeMessage) -> int:
    """Predict all components to a message, and update, weigh and merge them; returns as of
    `receive`.

    `range_model` is the model of the link that the message came by: `m` itself for the main link.
    """
    for k in range(b.n_hypotheses * m.modes):
        if not _propagate_iterated(b, m, k, message, range_model):
            return -1
    if not math.isnan(message.ranges[0] + message.ranges[1]):
        split(b, range_model, message)
    most_ranges = _update_components(b, range_model, message)
    if most_ranges < 0:
        return -1
    if b.n_hypotheses * m.modes > 1 and not motion.update_weights(b, m):
        return -1
    if range_model.leader_bias != ABSENT:
        update_leader_variance(b, m)
    if b.n_hypotheses > 1:
        prune_and_merge(b, m)
    if not _check_consistency(b, range_model, message, b.received, most_ranges):
        return -1
    return int(most_ranges)


@compiled
def receive(b: GaussianMixture, m: Model, message: RangeMessage) -> int:
    """Take a message: predict all components to its instant and update them with its ranges.

    A message without ranges changes nothing. With an unknown start the first message with two
    ranges makes the belief. Returns the most ranges that a hypothesis used; −1 if a covariance was
    not positive definite.
    """
    received = 0
    for i in range(m.transmitters):
        received += message.ranges[i] == message.ranges[i]
    b.received = received
    _time_pings(b, m, message)
    if received == 0:
        return 0
    if b.n_hypotheses == 0:
        return _begin(b, m, message) if received >= 2 else 0
    mix_modes(b, m)
    if m.leader_bias != ABSENT:
        motion.average_leader_heading(b, m, message)
    inflate_bias_covariance(b, m, message)
    most_ranges = _use_ranges(b, m, m, message)
    if most_ranges < 0:
        return -1
    if m.current != ABSENT or m.leader_bias != ABSENT:
        motion.update_current_from_leader_track(b, m, message)
    motion.reset_preintegration(b)
    b.motion.elapsed = 0.0
    refresh_output(b, m)
    return most_ranges


@compiled
def receive_beside(b: GaussianMixture, m: Model, link_model: Model, message: RangeMessage) -> int:
    """Take a message of a further link, whose model is `link_model`, of `model_beside`: as
    `receive`, but for what only the main link's messages show, which are a start, the current and
    the leader's errors.
    """
    received = 0
    for i in range(link_model.transmitters):
        received += message.ranges[i] == message.ranges[i]
    _time_pings(b, link_model, message)
    if received == 0 or b.n_hypotheses == 0:
        return 0
    b.received = received
    mix_modes(b, m)
    # the leader's compass has turned meanwhile
    b.leader_turn.still_time += b.motion.elapsed
    inflate_bias_covariance(b, link_model, message)
    most_ranges = _use_ranges(b, m, link_model, message)
    if most_ranges < 0:
        return -1
    motion.reset_preintegration(b)
    b.motion.elapsed = 0.0
    refresh_output(b, m)
    return most_ranges
