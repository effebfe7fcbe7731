"""A block of runs in one compiled loop: measurements, made where they are used, navigation and
metrics.

Sensing is `sim.sensing.observation.measure`, and metrics are `laisn.metrics`, for lanes, with the
same formulas and noise, in memory that does not grow with the runs. No other module of campaigns is
compiled.
"""

import math
from functools import lru_cache
from itertools import count
from typing import NamedTuple

import numpy as np

from laisn import lanes
from laisn.arrays import Bools, Floats, Ints
from laisn.compiled import compiled, copy_values, inlined
from laisn.estimates import FixKind
from laisn.geometry import Point, SinCos
from laisn.held import borrowed_values
from laisn.lanes import LANES
from laisn.metrics import bearing_error, is_mirror_locked, normalised_square, squared_error
from laisn.settings import Tuning
from laisn.vector_math import sin_cos, to_bits
from sim.sensing import sensors
from sim.sensing.noise import (
    LEADER_STREAMS,
    STREAMS,
    Stream,
    two_normals,
    two_uniforms,
    uniform,
    words,
)
from sim.sensing.observation import IdealMeasurements
from sim.sensing.sensors import SensorErrors

_LOST = int(FixKind.LOST)

_row = count(0, LANES)
# Rows of a tally, a flat array with a number for each lane in each row, as a block of `laisn.lanes`
# is: sums, sums of squares and maxima over steps of the errors of position P [m] and bearing B
# [rad].
SUM_P, SQUARES_P, MAX_P, SUM_B, SQUARES_B, MAX_B = (next(_row) for _ in range(6))
# Sums and counts of NEES, over steps, and NIS, over fixes.
SUM_NEES, COUNT_NEES, SUM_NIS, COUNT_NIS = (next(_row) for _ in range(4))
# Steps that the estimate has been at the mirror image without a break, and the most of them.
MIRROR_LOCK, LONGEST_MIRROR_LOCK = (next(_row) for _ in range(2))
NEES = next(_row)  # of the last step; NaN where the covariance is singular
KINDS = next(_row)  # counts of fixes: the first of a row for each `FixKind`
SIZE = KINDS + len(FixKind) * LANES  # numbers of a tally

# Histograms have 2⁷ bins an octave: percentiles read from them are right to a share of 2⁻⁷,
# wherever they lie.
_BINS_PER_OCTAVE_BITS = 7
_BITS_SHIFT = np.uint64(52 - _BINS_PER_OCTAVE_BITS)
_OCTAVES = 20
# errors of position [m] and bearing [rad] below these share one bin
LOWEST_P = 2.0**-10
LOWEST_B = 2.0**-18
BINS = (_OCTAVES << _BINS_PER_OCTAVE_BITS) + 2
# the leading bits of the lowest errors as doubles (exponents have an offset of 1023), less 1, so
# that `_bin` numbers their bins 1
_FIRST_P = (1023 - 10 << _BINS_PER_OCTAVE_BITS) - 1
_FIRST_B = (1023 - 18 << _BINS_PER_OCTAVE_BITS) - 1


@lru_cache(maxsize=2)
def bin_edges(lowest: float) -> Floats:
    """Edges of a histogram's bins, shape (BINS + 1,); the last bin takes all that is larger."""
    shares = 1.0 + np.arange(1 << _BINS_PER_OCTAVE_BITS) / (1 << _BINS_PER_OCTAVE_BITS)
    edges = (lowest * 2.0 ** np.arange(_OCTAVES)[:, None] * shares).ravel()
    top = lowest * 2.0**_OCTAVES
    edges = np.concatenate([[0.0], edges, [top, np.inf]])
    edges.flags.writeable = False
    return edges


@inlined
def _bin(value: float, first: int) -> np.int64:
    """Number of a value's bin, from its exponent and the first bits of its mantissa; `first` is
    `_FIRST_P` or `_FIRST_B`.
    """
    number = np.int64(to_bits(value) >> _BITS_SHIFT) - first
    number = number if number > 0 else np.int64(0)
    return number if number < BINS - 1 else np.int64(BINS - 1)


class Judged(NamedTuple):
    """How far an estimate of one step is off."""

    squared: float  # squared error of position [m²]
    error: float  # error of position [m]
    bearing: float  # error of bearing [rad]
    is_mirror_locked: bool
    nees: float  # NaN where the covariance is singular


@inlined
def _judge(
    estimate: Point,
    covariance: tuple[float, float, float],
    truth: Point,
    leader: Point,
    axis: SinCos,
) -> Judged:
    """Judge an estimate by its covariance xx, xy, yy and the true places of hydrophone and leader,
    whose heading is `axis`.
    """
    squared = squared_error(estimate, truth)
    pxx, pxy, pyy = covariance
    return Judged(
        squared,
        math.sqrt(squared),
        bearing_error(estimate, truth, leader),
        is_mirror_locked(estimate, truth, leader, axis),
        normalised_square(estimate.east - truth.east, estimate.north - truth.north, pxx, pxy, pyy),
    )


@inlined
def _add_judged(judged: Judged, lane: int, tally: Floats) -> None:
    """Add an estimate of the next step of a lane's run to a tally."""
    error = judged.error
    bearing = judged.bearing
    tally[SUM_P + lane] += error
    tally[SQUARES_P + lane] += judged.squared
    tally[MAX_P + lane] = error if error > tally[MAX_P + lane] else tally[MAX_P + lane]
    tally[SUM_B + lane] += bearing
    tally[SQUARES_B + lane] += bearing * bearing
    tally[MAX_B + lane] = bearing if bearing > tally[MAX_B + lane] else tally[MAX_B + lane]
    mirror_lock = tally[MIRROR_LOCK + lane] + 1.0 if judged.is_mirror_locked else 0.0
    tally[MIRROR_LOCK + lane] = mirror_lock
    longest = tally[LONGEST_MIRROR_LOCK + lane]
    tally[LONGEST_MIRROR_LOCK + lane] = mirror_lock if mirror_lock > longest else longest
    nees = judged.nees
    has_nees = nees == nees
    tally[NEES + lane] = nees
    tally[SUM_NEES + lane] += nees if has_nees else 0.0
    tally[COUNT_NEES + lane] += 1.0 if has_nees else 0.0


@compiled
def tally_step(
    block: Floats,
    tally: Floats,
    bins: Ints,
    hydrophone: tuple[float, float],
    leader: tuple[float, float, float],
) -> None:
    """Add the errors of a step of estimates to a tally, and write the numbers of their histogram
    bins into `bins`, a row for position and one for bearing.

    `block` holds the estimates, `hydrophone` is the follower's x and y [m], `leader` the leader's x
    and y [m] and heading [rad].
    """
    truth = Point(hydrophone[0], hydrophone[1])
    origin = Point(leader[0], leader[1])
    axis = SinCos(*sin_cos(leader[2]))
    for lane in range(lanes.in_use(block)):
        estimate = lanes.point_at(block, lanes.X, lane)
        covariance = block[lanes.PXX + lane], block[lanes.PXY + lane], block[lanes.PYY + lane]
        judged = _judge(estimate, covariance, truth, origin, axis)
        bins[lane] = _bin(judged.error, _FIRST_P)
        bins[LANES + lane] = _bin(judged.bearing, _FIRST_B)
        _add_judged(judged, lane, tally)


# What is judged of an estimate: rows of a block.
_JUDGED_ROWS = (lanes.X, lanes.Y, lanes.PXX, lanes.PXY, lanes.PYY)


@compiled
def _tally_alone(
    states: Floats, own: Floats, tally: Floats, histograms: Ints, nees: Floats
) -> None:
    """The same as `tally_step` and `fill_histograms` do for each step, of a run that is alone in
    its block: its steps are judged side by side, as runs are else, and then added up in order.

    `states` are x, y and covariance xx, xy, yy of each step, shape (5, n), and `own` is as of
    `TruthRecord`; out: tally, histograms, and the NEES of each step, shape (n,).
    """
    n = own.shape[0]
    squared = np.empty(n)
    bearing = np.empty(n)
    mirrored = np.empty(n)
    for k in range(n):
        judged = _judge(
            Point(states[0, k], states[1, k]),
            (states[2, k], states[3, k], states[4, k]),
            Point(own[k, 3], own[k, 4]),
            Point(own[k, 5], own[k, 6]),
            SinCos(*sin_cos(own[k, 7])),
        )
        squared[k] = judged.squared
        bearing[k] = judged.bearing
        mirrored[k] = 1.0 if judged.is_mirror_locked else 0.0
        nees[k] = judged.nees
    for k in range(n):
        error = math.sqrt(squared[k])
        histograms[0, _bin(error, _FIRST_P)] += 1
        histograms[1, _bin(bearing[k], _FIRST_B)] += 1
        judged = Judged(squared[k], error, bearing[k], mirrored[k] > 0.0, nees[k])
        _add_judged(judged, 0, tally)


@compiled
def tally_fixes(block: Floats, tally: Floats, fixes: tuple[int, int, int]) -> None:
    """Add the fixes of a message, whose rows begin at `fixes` (−1: none).

    A pair of which nothing was received is no fix; a message without any fix counts as one LOST.
    """
    for lane in range(lanes.in_use(block)):
        received = False
        for fix in fixes:
            if fix >= 0:
                kind = int(block[fix + 3 * LANES + lane])
                nis = block[fix + 5 * LANES + lane]
                if kind != _LOST:
                    received = True
                    tally[KINDS + kind * LANES + lane] += 1.0
                if nis == nis:
                    tally[SUM_NIS + lane] += nis
                    tally[COUNT_NIS + lane] += 1.0
        if not received:
            tally[KINDS + _LOST * LANES + lane] += 1.0


@compiled
def sum_nees(tally: Floats, used: int) -> float:
    """Sum over the first `used` lanes of the NEES of the last step; NaN where one is unknown."""
    total = 0.0
    for lane in range(used):
        total += tally[NEES + lane]
    return total


@compiled
def fill_histograms(bins: Ints, histograms: Ints, used: int) -> None:
    """Count the errors of a step in the first `used` lanes; histograms of position and bearing,
    shape (2, BINS).
    """
    for lane in range(used):
        histograms[0, bins[lane]] += 1
        histograms[1, bins[LANES + lane]] += 1


def percentile(histogram: Ints, lowest: float, share: float, largest: float) -> float:
    """Value below which a share of the counted ones lie, by linear interpolation within a bin;
    `largest` at most.
    """
    total = np.cumsum(histogram)
    target = share * total[-1]
    i = int(np.searchsorted(total, target))
    edges = bin_edges(lowest)
    lower, upper = edges[i], min(edges[i + 1], largest)
    bin_share = (target - (total[i] - histogram[i])) / histogram[i]
    return float(min(lower + bin_share * (upper - lower), largest))


# Rows of draws, `Noise.draws`.
_FIRST = 0
_SECOND = LANES
_THIRD = 2 * LANES

# Streams of noise, as numbers that compiled code takes.
_OWN_MOTION, _DEPTH, _ECHO, _LOSS = map(
    int, (Stream.OWN_MOTION, Stream.DEPTH, Stream.ECHO, Stream.LOSS)
)
_RANGE_UNIFORM = int(Stream.RANGE_UNIFORM)
_RANGE_SCALE = int(Stream.RANGE_SCALE)
_LEADER_MOTION = int(Stream.LEADER_MOTION)
_LEADER_DEPTH = int(Stream.LEADER_DEPTH)
_LEADER_ATTITUDE = int(Stream.LEADER_ATTITUDE)
_LEADER_POSITION = int(Stream.LEADER_POSITION)
_LEADER_POSITION_WALK = int(Stream.LEADER_POSITION_WALK)

# First column of the echoes' ranges in `TruthRecord.sent`; the three before it are the true ranges.
_ECHOES = 10


Address = tuple[np.uint64, np.uint64, np.uint64]
"""Seed, first run, and index of the follower."""


class Noise(NamedTuple):
    """Draws of a block, and where they come from."""

    draws: Floats  # three rows of uniforms, or two of normals
    address: Address
    burst: Bools  # whether a lane is within a burst of loss
    # two rows: Gauss–Markov part of the leader's pitch and roll errors, of unit variance
    fluctuation: Floats
    offset: Floats  # two rows: what stays of them throughout a run, likewise
    # two rows: random walk of the error of the leader's position, in steps of unit variance
    walk: Floats
    dt: float  # filter step [s]
    lanes: int  # how many are computed


@inlined
def _number(stream: int, follower: np.uint64) -> np.uint64:
    """Number of a stream of noise in the generator: the leader's are the same of all followers, all
    others are each follower's own. To be called outside of loops over lanes, which are vectorised.
    """
    return np.uint64(stream) + (
        np.uint64(0) if stream >= LEADER_STREAMS else np.uint64(STREAMS) * follower
    )


@compiled
def _draw_uniforms(noise: Noise, stream: int, step: int) -> None:
    """Three uniforms in (0, 1) for each lane."""
    draws = noise.draws
    seed, first_run, follower = noise.address
    number = _number(stream, follower)
    for lane in range(noise.lanes):
        w0, w1, w2, _ = words(seed, first_run + np.uint64(lane), number, np.uint64(step))
        draws[_FIRST + lane] = uniform(w0)
        draws[_SECOND + lane] = uniform(w1)
        draws[_THIRD + lane] = uniform(w2)


@compiled
def _draw_normals(noise: Noise, stream: int, step: int) -> None:
    """Two normals for each lane."""
    draws = noise.draws
    seed, first_run, follower = noise.address
    number = _number(stream, follower)
    for lane in range(noise.lanes):
        w0, w1, w2, w3 = words(seed, first_run + np.uint64(lane), number, np.uint64(step))
        draws[_FIRST + lane], draws[_SECOND + lane] = two_uniforms(w0, w1, w2, w3)
    for lane in range(noise.lanes):
        draws[_FIRST + lane], draws[_SECOND + lane] = two_normals(
            draws[_FIRST + lane], draws[_SECOND + lane]
        )


@compiled
def new_noise(address: Address, dt: float, used: int) -> Noise:
    """Room for the draws of a block, and the errors that its runs keep."""
    pair = 2 * LANES
    noise = Noise(
        np.zeros(3 * LANES),
        address,
        np.zeros(LANES, dtype=np.bool_),
        np.zeros(pair),
        np.empty(pair),
        np.zeros(pair),
        dt,
        used,
    )
    _draw_normals(noise, _LEADER_ATTITUDE, 0)
    copy_values(noise.draws, noise.offset)
    return noise


@compiled
def _draw_if(is_needed: bool, noise: Noise, stream: int, step: int) -> None:
    """Draw normals as `_draw_normals` does, or set them to zero where the errors make no use of
    them.
    """
    if is_needed:
        _draw_normals(noise, stream, step)
    else:
        noise.draws[:] = 0.0


@compiled
def sense_own(
    block: Floats, noise: Noise, errors: SensorErrors, speed: float, heading: float, k: int
) -> None:
    """Read speed log and compass at step k."""
    draws = noise.draws
    _draw_normals(noise, _OWN_MOTION, k)
    for lane in range(noise.lanes):
        normals = draws[_FIRST + lane], draws[_SECOND + lane]
        block[lanes.SPEED + lane] = sensors.read_speed(errors, speed, normals)
        block[lanes.HEADING + lane] = sensors.read_heading(errors, heading, normals)


@compiled
def _lose(
    block: Floats, noise: Noise, errors: SensorErrors, direct: float, steps: tuple[int, int]
) -> None:
    """Ranges of lost messages become NaN; `direct` is the range to the rear transmitter [m],
    `steps` are those of reception and of emission.
    """
    received, emitted = steps
    draws = noise.draws
    burst = noise.burst
    _draw_uniforms(noise, _LOSS, emitted)
    for lane in range(noise.lanes):
        burst[lane] = sensors.is_bad(burst[lane], draws[_FIRST + lane], errors)
        is_heard = sensors.is_heard(draws[_THIRD + lane], errors, direct, received * noise.dt)
        if sensors.is_lost(burst[lane], draws[_SECOND + lane], errors) or not is_heard:
            block[lanes.R1 + lane] = block[lanes.R2 + lane] = block[lanes.R3 + lane] = np.nan


@compiled
def _read_position(
    block: Floats, noise: Noise, errors: SensorErrors, sent: Floats, emitted: int, last: int
) -> None:
    """Read the leader's position, `last` being the step of the emission before this one."""
    draws = noise.draws
    walk = noise.walk
    for k in range(last + 1, emitted + 1):
        _draw_if(errors.leader_position_walk > 0.0, noise, _LEADER_POSITION_WALK, k)
        for i in range(2 * LANES):
            walk[i] += draws[i]
    _draw_if(errors.leader_position_sigma > 0.0, noise, _LEADER_POSITION, emitted)
    root = math.sqrt(noise.dt)
    for lane in range(noise.lanes):
        i = _FIRST + lane
        j = _SECOND + lane
        block[lanes.EAST + lane] = sensors.read_leader_position(
            errors, sent[0], draws[i], root * walk[i]
        )
        block[lanes.NORTH + lane] = sensors.read_leader_position(
            errors, sent[1], draws[j], root * walk[j]
        )


@compiled
def _read_attitude(
    block: Floats, noise: Noise, errors: SensorErrors, sent: Floats, emitted: int, steps_since: int
) -> None:
    """Read the leader's pitch and roll."""
    draws = noise.draws
    fluctuation = noise.fluctuation
    offset = noise.offset
    weight, spread_weight = sensors.gauss_markov_weights(
        steps_since, noise.dt, errors.leader_tilt_time
    )
    _draw_if(errors.leader_tilt_sigma > 0.0, noise, _LEADER_ATTITUDE, emitted)
    for i in range(2 * LANES):
        fluctuation[i] = sensors.gauss_markov_step(fluctuation[i], weight, spread_weight, draws[i])
    for lane in range(noise.lanes):
        i = _FIRST + lane
        j = _SECOND + lane
        block[lanes.PITCH + lane] = sensors.read_leader_attitude(
            errors, sent[5], (offset[i], fluctuation[i])
        )
        block[lanes.ROLL + lane] = sensors.read_leader_attitude(
            errors, sent[6], (offset[j], fluctuation[j])
        )


@compiled
def _read_ranges(
    block: Floats,
    noise: Noise,
    errors: SensorErrors,
    transmitters: int,
    sent: Floats,
    steps: tuple[int, int],
) -> None:
    """Measure ranges on pings, or on echoes taken for them; arguments as of `sense_message`."""
    draws = noise.draws
    received, emitted = steps
    true = np.empty(3 * LANES)
    normal = np.empty(LANES)
    if errors.surface_echo_probability + errors.bottom_echo_probability > 0.0:
        _draw_uniforms(noise, _ECHO, emitted)
    else:
        # above any chance
        draws[:] = 1.0
    for j in range(3):
        for lane in range(noise.lanes):
            i = j * LANES + lane
            # 0 direct, 1 by the surface, 2 by the bottom
            path = sensors.path_taken(draws[lane if errors.common_echoes else i], errors)
            true[i] = sent[_ECHOES - 3 + j + 3 * path]
    _draw_normals(noise, _RANGE_SCALE, received)
    copy_values(draws[:LANES], normal)
    _draw_uniforms(noise, _RANGE_UNIFORM, received)
    for lane in range(noise.lanes):
        i = _FIRST + lane
        j = _SECOND + lane
        k = _THIRD + lane
        ranges = (true[i], true[j], true[k])
        rear, front, middle = errors.range_tau
        longest_used = sensors.longest_range(ranges, transmitters)
        longest = sensors.longest_range(ranges, 3)
        block[lanes.R1 + lane] = sensors.range_reading(
            errors, rear, (ranges[0], longest_used), (draws[i], normal[lane])
        )
        block[lanes.R2 + lane] = sensors.range_reading(
            errors, front, (ranges[1], longest_used), (draws[j], normal[lane])
        )
        block[lanes.R3 + lane] = sensors.range_reading(
            errors, middle, (ranges[2], longest), (draws[k], normal[lane])
        )
    if sensors.loses(errors):
        _lose(block, noise, errors, sent[_ECHOES - 3], steps)


@compiled
def sense_message(
    block: Floats,
    noise: Noise,
    receiver: tuple[SensorErrors, int],
    sent: Floats,
    depth: float,
    steps: tuple[int, int, int],
) -> None:
    """Receive a message, measure its ranges and read one's depth: the block's rows DEPTH and EAST …
    R3 are filled.

    `receiver` are errors of sensors and how many transmitters are used, `sent` is a row of
    `TruthRecord.sent`; `steps` are those of reception and of emission, and how many passed since
    the emission before it (0: there is none).
    """
    draws = noise.draws
    errors, transmitters = receiver
    received, emitted, steps_since = steps
    east = sent[0]
    north = sent[1]
    heading = sent[2]
    speed = sent[3]
    leader_depth = sent[4]
    _draw_if(errors.depth_sigma > 0.0, noise, _DEPTH, received)
    for lane in range(noise.lanes):
        block[lanes.DEPTH + lane] = sensors.read_depth(errors, depth, (draws[_FIRST + lane], 0.0))
        block[lanes.EAST + lane] = east
        block[lanes.NORTH + lane] = north
    motion_errs = errors.leader_heading_sigma + errors.leader_speed_sigma > 0.0
    _draw_if(motion_errs, noise, _LEADER_MOTION, emitted)
    for lane in range(noise.lanes):
        normals = draws[_FIRST + lane], draws[_SECOND + lane]
        block[lanes.LEADER_SPEED + lane] = sensors.read_leader_speed(errors, speed, normals)
        block[lanes.LEADER_HEADING + lane] = sensors.read_leader_heading(errors, heading, normals)
    _draw_if(errors.leader_depth_sigma > 0.0, noise, _LEADER_DEPTH, emitted)
    for lane in range(noise.lanes):
        block[lanes.LEADER_DEPTH + lane] = sensors.read_leader_depth(
            errors, leader_depth, (draws[_FIRST + lane], 0.0)
        )
    if sensors.position_errs(errors):
        _read_position(
            block, noise, errors, sent, emitted, emitted - steps_since if steps_since else 0
        )
    _read_attitude(block, noise, errors, sent, emitted, steps_since)
    _read_ranges(block, noise, errors, transmitters, sent, (received, emitted))


class TruthRecord(NamedTuple):
    """`IdealMeasurements` as compiled code takes it."""

    start: Floats  # state x, y [m], vx, vy [m/s], shape (1, 4)
    # speed, heading, depth and hydrophone x, y of the follower; x, y, heading of the leader; shape
    # (n, 8)
    own: Floats
    message_step: Ints  # filter step of each reception, shape (m,)
    emission_step: Ints  # filter step of each emission, shape (m,)
    # true messages and ranges to the transmitters in the order of a block's rows from EAST to R3;
    # then ranges by way of the surface and of the bottom, NaN if the truth has none; shape (m, 16)
    sent: Floats


def truth_record(truth: IdealMeasurements) -> TruthRecord:
    """What a follower's sensors measure, with the echoes of its pings."""
    sent = truth.sent
    m = truth.message_step.size
    positions = truth.hydrophone, truth.leader_position, truth.leader_heading
    echoes = np.full((2, m, 3), np.nan) if truth.echo_range is None else truth.echo_range
    pose = (sent.east, sent.north, sent.heading, sent.speed, sent.depth, sent.pitch, sent.roll)
    return TruthRecord(
        truth.start.astype(np.float64)[None],
        np.column_stack([truth.speed, truth.heading, truth.depth, *positions]),
        truth.message_step.astype(np.int64),
        truth.emission_step.astype(np.int64),
        np.column_stack([*pose, truth.slant_range, *echoes]),
    )


class Prepared(NamedTuple):
    """Measurements or estimates that runs of a block use in place of those that are simulated in
    the loop; empty where they are simulated.
    """

    own: Floats = np.empty((0, 3 * LANES))  # own readings, as of `laisn.lanes.stacked`
    messages: Floats = np.empty((0, 10 * LANES))  # likewise
    # x, y and covariance xx, xy, yy of each step, shape (n, 5, LANES)
    states: Floats = np.empty((0, 5, LANES))


class _Memory(NamedTuple):
    """What a block works on."""

    block: Floats  # as of `laisn.lanes`
    tally: Floats
    bins: Ints  # of the histograms, of a step: a row for position and one for bearing
    histograms: Ints  # of position and bearing, shape (2, BINS)
    nees: Floats  # sum over the runs at each step, shape (n,)
    states: Floats  # of a run that is alone, as of `_tally_alone`; else of shape (5, 0)


@compiled
def _measure_step(
    k: int,
    i: int,
    received: bool,
    truth: TruthRecord,
    receiver: tuple[SensorErrors, int],
    noise: Noise,
    prepared: Prepared,
    block: Floats,
) -> None:
    """Fill the rows of measurements of step k, and of message i where it is received; `receiver` is
    as of `sense_message`.
    """
    if prepared.own.shape[0] > 0:
        copy_values(prepared.own[k - 1], block[lanes.SPEED : lanes.SIN])
        if received:
            copy_values(prepared.messages[i], block[lanes.EAST : lanes.X1])
        return
    readings = truth.own[k - 1]
    sense_own(block, noise, receiver[0], readings[0], readings[1], k)
    if received:
        emitted = truth.emission_step[i]
        steps = k, emitted, emitted - truth.emission_step[i - 1] if i > 0 else 0
        sense_message(block, noise, receiver, truth.sent[i], readings[2], steps)


@compiled
def _fly_steps(
    truth: TruthRecord,
    errors: SensorErrors,
    t: Tuning,
    noise: Noise,
    used: int,
    prepared: Prepared,
    memory: _Memory,
    history: Floats,
) -> None:
    """Fly a block as of `fly_block`, with its results in `memory`."""
    block = memory.block
    tally = memory.tally
    m = truth.message_step.size
    is_alone = memory.states.shape[1] > 0
    receiver = errors, int(t.transmitters)
    fixes = lanes.fix_rows(t.variant)
    prior = lanes.no_prior()
    i = 0
    for k in range(1, truth.own.shape[0] + 1):
        received = i < m and truth.message_step[i] == k
        if prepared.states.shape[0] > 0:
            for j, first in enumerate(_JUDGED_ROWS):
                copy_values(prepared.states[k - 1, j], block[first : first + LANES])
        else:
            _measure_step(k, i, received, truth, receiver, noise, prepared, block)
            lanes.advance(block, t, k, received, prior)
            if received:
                tally_fixes(block, tally, fixes)
        i += received
        if is_alone:
            for j, first in enumerate(_JUDGED_ROWS):
                memory.states[j, k - 1] = block[first]
        else:
            true = truth.own[k - 1]
            tally_step(block, tally, memory.bins, (true[3], true[4]), (true[5], true[6], true[7]))
            memory.nees[k - 1] = sum_nees(tally, used)
            fill_histograms(memory.bins, memory.histograms, used)
        if history.size > 0:
            copy_values(block[lanes.X : lanes.X + 4 * LANES], history[k - 1])
    if is_alone:
        _tally_alone(memory.states, truth.own, tally, memory.histograms, memory.nees)


@compiled
def fly_block(
    truth: TruthRecord,
    errors: SensorErrors,
    t: Tuning,
    address: Address,
    used: int,
    prepared: Prepared,
    history: Floats,
) -> tuple[Floats, Ints, Floats]:
    """Fly a block of runs: tally, histograms, and the sum over the first `used` lanes of the NEES
    of each step, shape (n,). States go to `history`, shape (n, 4 LANES), unless it is empty.

    `address` is that of the first run; `used` lanes hold runs, the others are not counted.
    """
    n = truth.own.shape[0]
    computed = lanes.lanes_for(used)
    noise = new_noise(address, t.dt, computed)
    memory = _Memory(
        lanes.new_block(truth.start, t),
        np.zeros(SIZE),
        np.zeros(2 * LANES, dtype=np.int64),
        np.zeros((2, BINS), dtype=np.int64),
        np.empty(n),
        np.empty((len(_JUDGED_ROWS), n if computed == 1 else 0)),
    )
    memory.block[lanes.IDLE] = LANES - computed
    # to count references to all arrays at each step would take a tenth of the time
    _fly_steps(
        borrowed_values(truth),
        errors,
        t,
        borrowed_values(noise),
        used,
        borrowed_values(prepared),
        borrowed_values(memory),
        borrowed_values(history),
    )
    return memory.tally, memory.histograms, memory.nees
