"""A block of runs in one compiled loop: measurements, made where they are used, navigation and metrics.

Sensing is `sim.sensing.observation.measure` for lanes, with the same formulas and noise. Beside this module and
`lane_metrics` no module of campaigns is compiled.
"""

from typing import NamedTuple

import numpy as np

from experiments.campaign import lane_metrics as metric
from laisn import lane_passes as row
from laisn import lanes
from laisn.arrays import Bools, Floats, Ints
from laisn.compiled import compiled_lanes, copy_values
from laisn.failure import LaisnError
from laisn.lane_passes import LANES
from laisn.settings import Tuning
from sim.sensing.noise import Stream, two_normals, two_units, uniform, words
from sim.sensing.observation import MissionTruth, fluctuation_weights
from sim.sensing.sensors import (
    SensorErrors,
    advanced,
    heading_reading,
    is_bad,
    is_lost,
    loses,
    path_taken,
    plain_reading,
    range_readings,
    speed_reading,
)

# Rows of draws.
_FIRST, _SECOND, _THIRD = 0, LANES, 2 * LANES


class LaneSensors(NamedTuple):
    """Sensors of the followers of a block, which use so many of the leader's transmitters."""

    errors: SensorErrors
    transmitters: int


class Address(NamedTuple):
    """Address of the noise of a block: seed, first run, and the number of each stream."""

    seed: np.uint64
    first_run: np.uint64
    own_motion: np.uint64
    depth: np.uint64
    range_uniform: np.uint64
    range_scale: np.uint64
    leader_motion: np.uint64
    leader_depth: np.uint64
    leader_attitude: np.uint64
    echo: np.uint64
    loss: np.uint64


# Columns of `sent_rows` behind those of a block's rows.
_ECHOES, _KEPT, _FRESH = 10, 16, 17


def sent_rows(truth: MissionTruth, errors: SensorErrors) -> Floats:
    """True content of the messages and true ranges to them, in the order of a block's rows from EAST to R3.

    Ranges by way of the surface and of the bottom follow, NaN if the truth has none, then the weights of the leader's
    fluctuating attitude error.
    """
    sent = truth.sent
    echoes = np.full((2, *truth.slant_range.shape), np.nan) if truth.echo_range is None else truth.echo_range
    return np.column_stack(
        [
            sent.east, sent.north, sent.heading, sent.speed, sent.depth, sent.pitch, sent.roll,
            truth.slant_range, *echoes,
            fluctuation_weights(truth, errors),
        ]
    )  # fmt: skip


def address(seed: int, first_run: int, follower: int) -> Address:
    """Address of the noise of a block of one follower; LaisnError if seed or run is out of range."""
    if not 0 <= seed < 2**64:
        raise LaisnError(f"seed is {seed}, expected 0 … 2^64 − 1")
    if not 0 <= first_run < 2**32 - LANES:
        raise LaisnError(f"run is {first_run}, expected 0 … 2^32 − {LANES + 1}")
    streams = (np.uint64(Stream[name.upper()].number(follower)) for name in Address._fields[2:])
    return Address(np.uint64(seed), np.uint64(first_run), *streams)


class Noise(NamedTuple):
    """Draws of a block, and where they come from."""

    draws: Floats
    """Three rows of uniforms, or two of normals."""
    address: Address
    burst: Bools
    """Whether a lane is within a burst of loss."""
    fluctuation: Floats
    """Two rows: Gauss–Markov part of the leader's pitch and roll errors, of unit variance."""
    offset: Floats
    """Two rows: what stays of them throughout a run, likewise."""


@compiled_lanes
def _draw_uniforms(noise: Noise, stream: np.uint64, step: int) -> None:
    """Three uniforms in (0, 1) for each lane."""
    draws, address = noise.draws, noise.address
    for lane in range(LANES):
        w0, w1, w2, _ = words(address.seed, address.first_run + np.uint64(lane), stream, np.uint64(step))
        draws[_FIRST + lane], draws[_SECOND + lane], draws[_THIRD + lane] = uniform(w0), uniform(w1), uniform(w2)


@compiled_lanes
def _draw_normals(noise: Noise, stream: np.uint64, step: int) -> None:
    """Two normals for each lane."""
    draws, address = noise.draws, noise.address
    for lane in range(LANES):
        w0, w1, w2, w3 = words(address.seed, address.first_run + np.uint64(lane), stream, np.uint64(step))
        draws[_FIRST + lane], draws[_SECOND + lane] = two_units(w0, w1, w2, w3)
    for lane in range(LANES):
        draws[_FIRST + lane], draws[_SECOND + lane] = two_normals(draws[_FIRST + lane], draws[_SECOND + lane])


@compiled_lanes
def new_noise(address: Address) -> Noise:
    """Room for the draws of a block, and the errors that its runs keep."""
    pair = 2 * LANES
    noise = Noise(np.zeros(3 * LANES), address, np.zeros(LANES, dtype=np.bool_), np.zeros(pair), np.empty(pair))
    _draw_normals(noise, address.leader_attitude, 0)
    copy_values(noise.draws, noise.offset)
    return noise


@compiled_lanes
def _draw_if(needed: bool, noise: Noise, stream: np.uint64, step: int) -> None:
    """Draw normals as `_draw_normals` does, or set them to zero where the errors make no use of them."""
    if needed:
        _draw_normals(noise, stream, step)
    else:
        noise.draws[:] = 0.0


@compiled_lanes
def sense_own(block: Floats, noise: Noise, errors: SensorErrors, speed: float, heading: float, k: int) -> None:
    """Read speed log and compass at step k."""
    draws = noise.draws
    _draw_normals(noise, noise.address.own_motion, k)
    for lane in range(LANES):
        block[row.SPEED + lane] = speed_reading(speed, errors.speed_bias, errors.speed_sigma, draws[_FIRST + lane])
        block[row.HEADING + lane] = heading_reading(
            heading, errors.heading_bias, errors.heading_sigma, draws[_SECOND + lane]
        )


@compiled_lanes
def _lose(block: Floats, noise: Noise, errors: SensorErrors, emitted: int) -> None:
    """Ranges of lost messages become NaN."""
    draws, burst = noise.draws, noise.burst
    _draw_uniforms(noise, noise.address.loss, emitted)
    for lane in range(LANES):
        burst[lane] = is_bad(burst[lane], draws[_FIRST + lane], errors)
        if is_lost(burst[lane], draws[_SECOND + lane], errors):
            block[row.R1 + lane] = block[row.R2 + lane] = block[row.R3 + lane] = np.nan


@compiled_lanes
def _read_attitude(block: Floats, noise: Noise, errors: SensorErrors, sent: Floats, emitted: int) -> None:
    """Read the leader's pitch and roll."""
    draws, fluctuation, offset = noise.draws, noise.fluctuation, noise.offset
    kept, fresh, constant = sent[_KEPT], sent[_FRESH], errors.leader_attitude_offset_sigma
    _draw_if(errors.leader_tilt_sigma > 0.0, noise, noise.address.leader_attitude, emitted)
    for i in range(2 * LANES):
        fluctuation[i] = advanced(fluctuation[i], kept, fresh, draws[i])
    for lane in range(LANES):
        i, j = _FIRST + lane, _SECOND + lane
        pitch, roll = plain_reading(sent[5], 0.0, constant, offset[i]), plain_reading(sent[6], 0.0, constant, offset[j])
        block[row.PITCH + lane] = plain_reading(pitch, 0.0, errors.leader_tilt_sigma, fluctuation[i])
        block[row.ROLL + lane] = plain_reading(roll, 0.0, errors.leader_tilt_sigma, fluctuation[j])


@compiled_lanes
def _read_ranges(block: Floats, noise: Noise, sensors: LaneSensors, sent: Floats, steps: tuple[int, int]) -> None:
    """Measure ranges on pings, or on echoes taken for them."""
    draws, address, errors = noise.draws, noise.address, sensors.errors
    received, emitted = steps
    true, normal = np.empty(3 * LANES), np.empty(LANES)
    if errors.surface_echo_probability + errors.bottom_echo_probability > 0.0:
        _draw_uniforms(noise, address.echo, emitted)
    else:
        # above any chance
        draws[:] = 1.0
    for j in range(3):
        for lane in range(LANES):
            i = j * LANES + lane
            path = path_taken(draws[lane if errors.common_echoes else i], errors)
            true[i] = sent[_ECHOES - 3 + j + 3 * path]
    _draw_normals(noise, address.range_scale, received)
    copy_values(draws[:LANES], normal)
    _draw_uniforms(noise, address.range_uniform, received)
    for lane in range(LANES):
        i, j, k = _FIRST + lane, _SECOND + lane, _THIRD + lane
        block[row.R1 + lane], block[row.R2 + lane], block[row.R3 + lane] = range_readings(
            errors,
            sensors.transmitters,
            (true[i], true[j], true[k]),
            (draws[i], draws[j], draws[k]),
            normal[lane],
        )
    if loses(errors):
        _lose(block, noise, errors, emitted)


@compiled_lanes
def sense_message(
    block: Floats, noise: Noise, sensors: LaneSensors, sent: Floats, depth: float, steps: tuple[int, int]
) -> None:
    """Receive a message, measure its ranges and read one's depth: the block's rows DEPTH and EAST … R3 are filled.

    `sent` is a row of `sent_rows`, `depth` true [m], `steps` those of reception and of emission.
    """
    draws, address, errors = noise.draws, noise.address, sensors.errors
    east, north, heading, speed, leader_depth = sent[0], sent[1], sent[2], sent[3], sent[4]
    received, emitted = steps
    _draw_if(errors.depth_sigma > 0.0, noise, address.depth, received)
    for lane in range(LANES):
        block[row.DEPTH + lane] = plain_reading(depth, 0.0, errors.depth_sigma, draws[_FIRST + lane])
        block[row.EAST + lane], block[row.NORTH + lane] = east, north
    _draw_if(errors.leader_heading_sigma > 0.0, noise, address.leader_motion, emitted)
    for lane in range(LANES):
        block[row.LEADER_SPEED + lane] = speed_reading(speed, errors.leader_speed_bias, 0.0, 0.0)
        block[row.LEADER_HEADING + lane] = heading_reading(
            heading, errors.leader_heading_bias, errors.leader_heading_sigma, draws[_SECOND + lane]
        )
    _draw_if(errors.leader_depth_sigma > 0.0, noise, address.leader_depth, emitted)
    for lane in range(LANES):
        block[row.LEADER_DEPTH + lane] = plain_reading(
            leader_depth, 0.0, errors.leader_depth_sigma, draws[_FIRST + lane]
        )
    _read_attitude(block, noise, errors, sent, emitted)
    _read_ranges(block, noise, sensors, sent, steps)


class TruthRecord(NamedTuple):
    """`MissionTruth` as compiled code takes it."""

    start: Floats
    own: Floats
    """Speed, heading, depth and hydrophone x, y of the follower; x, y and heading of the leader; shape (n, 8)."""
    message_step: Ints
    emission_step: Ints
    sent: Floats


def truth_record(truth: MissionTruth, errors: SensorErrors) -> TruthRecord:
    """What a follower's sensors measure, with the echoes of its pings."""
    own = np.column_stack(
        [truth.speed, truth.heading, truth.depth, truth.hydrophone, truth.leader_position, truth.leader_heading]
    )
    received, emitted = truth.message_step.astype(np.int64), truth.emission_step.astype(np.int64)
    return TruthRecord(truth.start.astype(np.float64), own, received, emitted, sent_rows(truth, errors))


@compiled_lanes
def fly_block(
    truth: TruthRecord, sensors: LaneSensors, t: Tuning, address: Address, lanes_used: int, history: Floats
) -> tuple[Floats, Ints, Floats]:
    """Tally, histograms, and the sum over the runs of the NEES of each step, shape (n,).

    States go to `history`, shape (n, 4 LANES), unless it is empty.
    """
    n, m = truth.own.shape[0], truth.message_step.size
    noise = new_noise(address)
    block = row.new_block(truth.start, t)
    tally = np.zeros(metric.SIZE)
    bins = np.zeros(2 * LANES, dtype=np.int64)
    histograms, nees = np.zeros((2, metric.BINS), dtype=np.int64), np.empty(n)
    fixes = lanes.fix_rows(t.variant)
    i = 0
    for k in range(1, n + 1):
        now = truth.own[k - 1]
        sense_own(block, noise, sensors.errors, now[0], now[1], k)
        received = i < m and truth.message_step[i] == k
        if received:
            sense_message(block, noise, sensors, truth.sent[i], now[2], (k, truth.emission_step[i]))
            i += 1
        lanes.advance(block, t, k, received)
        if received:
            metric.tally_fixes(block, tally, fixes)
        metric.tally_step(block, tally, bins, (now[3], now[4]), (now[5], now[6], now[7]))
        nees[k - 1] = metric.sum_nees(tally, lanes_used)
        metric.fill_histograms(bins, histograms, lanes_used)
        if history.size > 0:
            copy_values(block[row.X : row.X + 4 * LANES], history[k - 1])
    return tally, histograms, nees
