"""Records of the tightly coupled navigator, which compiled code takes by a pointer and copies as a
whole.

Each class declares the fields of a record with their types, units and shapes; `laisn.arrays.
record_dtype` lays it out. Arrays have one shape for all settings, so that all share compiled code.
"""

import math
from typing import Annotated, TypeAlias

from laisn.arrays import Floats, Ints, RecordFields, record_dtype
from laisn.delays import LONGEST_DELAY
from laisn.estimates import HYPOTHESES

ABSENT = -1
"""Index of a state that is switched off."""
MAX_MODES = 4
CAPACITY = 2 * HYPOTHESES
"""Hypotheses for which a belief has room."""
MAX_STATES = 17
COMPONENTS = MAX_MODES * CAPACITY
SPARE = COMPONENTS - 1
"""Component that holds a copy or a trial while there are at most `HYPOTHESES` + 2 hypotheses."""
INSTANT_SPACING = 0.1
"""Least time between the instants of `WaySums` [s]."""
INSTANTS = math.ceil(LONGEST_DELAY / INSTANT_SPACING) + 2
"""Instants for which a `WaySums` has room, two of them for the one before the longest delay and
for rounding.
"""
WAY_SUMS = 8
WAY_PATH, WAY_XX, WAY_XY, WAY_YY = 4, 5, 6, 7
"""Indices of `WaySums.sums` after A and B."""
_T = 3  # transmitters

ByMode: TypeAlias = Annotated[Floats, (MAX_MODES,)]
ByState: TypeAlias = Annotated[Floats, (MAX_STATES,)]
ByRange: TypeAlias = Annotated[Floats, (_T,)]
ByComponent: TypeAlias = Annotated[Floats, (COMPONENTS,)]


class Model(RecordFields):
    """`TightSettings` as compiled code takes them; of `laisn.tight.model.model_of`."""

    n_states: int  # n
    modes: int  # drift_modes · speed_modes
    drift_modes: int
    speed_modes: int
    # where an optional state stands in the state, its first number for several, or ABSENT: indices,
    # and not the quantities themselves
    leader_bias: int  # b_L, bias of the leader's compass
    current: int  # its east component; north comes next
    offset: int  # d_2; d_3 comes next
    clock: int  # τ; τ̇ comes next
    leader_position: int  # error of the broadcast one, e, its east component; north comes next
    leader_position_walk: int  # w, likewise
    speed: int  # v, through the water
    transmitters: int
    use_attitude: int
    compensate_motion: int
    dt: float
    floor_depth: float
    baseline: float
    middle_offset: float
    hydrophone_height: float
    range_sigma: float
    outlier_span: float
    speed_variance: float
    heading_variance: float
    slip_rate: float  # variance of position that motion unseen by the log adds [m²/s]
    log_walk: ByMode  # b_v gains in a second [m²/s³]
    compass_walk: ByMode  # b_θ likewise [rad²/s]
    speed_walk: ByMode  # the speed likewise [m²/s³]
    current_walk: float  # each component of the current likewise [m²/s³]
    leader_walk: float  # b_L likewise [rad²/s]
    clock_walk: float  # τ̇ likewise [m²/s³]
    speed_switches: float  # rate of changes between the modes of speed [1/s]
    mode_switches: float  # rate of changes between the modes of drift [1/s]
    # square of the change of a compass's bias in a turn, as a share of the turn; 0: it has none
    deviation: float
    range_scale_variance: float
    leader_variance: float  # prior, and upper limit, of the random error of its heading [rad²]
    leader_position_variance: float  # of e along each axis [m²]
    leader_position_walk_rate: float  # w gains in a second [m²/s]
    ping_slot: float
    sound_slowness: float
    log_p_outlier: float  # logarithm of the chance that a range is an echo
    log_p_inlier: float  # logarithm of the chance that a range is a direct one
    log_density_outlier: float  # logarithm of an echo's density in [1/m]


class RangeMessage(RecordFields):
    """A message and its ranges."""

    time: float  # of emission, on the leader's clock [s]
    east: float
    north: float  # of the leader's origin [m]
    heading: float  # of the leader [rad]
    speed: float  # of the leader through the water [m/s]
    depth: float  # of the leader's origin [m]
    leader_position_variance: float  # of the origin's new error, e [m²]
    # from the origin to each transmitter: east, north, how much deeper than the hydrophone [m]
    arms: Annotated[Floats, (_T, 3)]
    ranges: ByRange  # slant ranges [m]; NaN where nothing was received
    shift: float  # what b_L grows by at this message [rad]
    added_variance: float  # what the variance of b_L grows by [rad²]
    late: int  # 1 if the way since the pings and `drift_time` count
    # how long the current has carried both vehicles since the message, less the way of each ping
    # [s]
    drift_time: ByRange
    way: Annotated[Floats, (_T, WAY_SUMS)]  # sums of `WaySums` since each ping arrived
    # as of `laisn.delays.Ways`, east and north [m]
    way_by_mean_speed: Annotated[Floats, (_T, 2)]
    last_to_arrive: int  # the ping that arrived last
    echo_span: float  # most by which the range of an echo exceeds the direct one [m]


class Preintegration(RecordFields):
    """Readings since the last message, or since the last step where the speed is a state."""

    # A = Σ v u Δt, with the measured speed v in the measured direction u [m]
    ax: float
    ay: float
    # B = Σ u Δt [s]
    bx: float
    by: float
    # covariance of A's random errors [m²]
    nxx: float
    nxy: float
    nyy: float
    time: float  # of these sums [s]
    elapsed: float  # since the last message [s]
    unmixed: float  # since the modes of speed were mixed [s]
    # the last reading of the log [m/s], NaN before the first, and the compass's direction
    speed: float
    sin: float
    cos: float
    clock: float  # time since the start [s]


class WaySums(RecordFields):
    """A and B, as of `Preintegration`, and the covariance of their random errors since the start:
    now, and at instants of the last seconds, the oldest of which makes room for the next one.
    """

    # A, B, Σ v Δt, and xx, xy, yy of the covariance
    sums: Annotated[Floats, (WAY_SUMS,)]
    last: int  # index of the last instant
    instant: Annotated[Floats, (INSTANTS,)]  # time since the start [s]
    instant_sums: Annotated[Floats, (INSTANTS, WAY_SUMS)]


class CompassTurn(RecordFields):
    """The turn that a compass is in, or the last one."""

    sin: float
    cos: float  # the heading before it; zeros before the first one
    angle: float  # the largest between that heading and a later one [rad]
    still_time: float  # since it was last larger than before [s]


class LeaderMotion(RecordFields):
    """The leader's way as its messages show it: the window of the current, and the straight leg."""

    # where the window began; the time is NaN before the first message
    window_time: float
    window_x: float
    window_y: float
    logged_x: float
    logged_y: float  # Σ s_L u(θ_L) Δt since then [m]
    velocity_x: float
    velocity_y: float  # s_L u(θ_L) of the last message [m/s]
    first_heading: float  # at the window's beginning [rad]
    first_time: float
    last_time: float  # of the first message of all and of the last one [s]
    at_x: float
    at_y: float  # position at the last message [m]
    track: float  # direction of the way there [rad]
    leg: float  # messages on the leg so far; 0: it turns, or that is unknown
    steady: float  # 1 where the leg's mean heading is used, else 0
    leg_heading: float  # mean heading of the leg, as it was at the last message [rad]
    # of readings on all legs from their means [rad²], and how many they are worth
    squares: float
    compared: float
    scatter: float  # variance of a reading about its leg's heading, as far as known [rad²]
    # `leader_variance` of steady legs while there is none, else of readings [rad²]
    other_variance: float


class MeanPosition(RecordFields):
    """The mean position over the mixture between messages: (x, y) + C A − D B + v T, with C and D
    rotations times numbers.
    """

    x: float
    y: float
    c_cos: float
    c_sin: float
    d_cos: float
    d_sin: float
    v_x: float
    v_y: float


class RangeUpdate(RecordFields):
    """Working memory of the update of a component with the ranges of a message."""

    residual: ByRange  # z − ẑ [m]
    # derivatives of each range by the states
    row_x: ByRange
    row_y: ByRange
    row_scale: ByRange
    row_leader: ByRange
    row_log: ByRange
    row_compass: ByRange
    # covariance of the position relative to the leader, east and north, with the states
    relative_covariance: Annotated[Floats, (2, MAX_STATES)]
    # second derivatives of each range by (x, y, b_L), times their covariance
    curvature: Annotated[Floats, (_T, 3, 3)]
    innovation_covariance: Annotated[Floats, (_T, _T)]  # S: covariance of the residuals [m²]
    # z − ẑ and S of ranges without a common echo
    direct_residual: ByRange
    direct_covariance: Annotated[Floats, (_T, _T)]
    root: Annotated[Floats, (_T, _T)]  # L: Cholesky factor of S over the used ranges
    per_root: ByRange  # reciprocals of the diagonal of `root`
    white: ByRange  # whitened residuals, L⁻¹ (z − ẑ)
    turned: ByRange  # L⁻¹ `row_leader`
    ph: Annotated[Floats, (_T, MAX_STATES)]  # P Hᵀ, a row for each range
    # where the ranges are linearised, from the mean of x, y [m]
    shift: Annotated[Floats, (2,)]
    # the part of their covariance xx, xy, yy that an update has taken away there [m²]
    removed: Annotated[Floats, (3,)]
    white_ph: Annotated[Floats, (_T, MAX_STATES)]  # L⁻¹ H P over the ranges that are used
    received: Annotated[Ints, (_T,)]  # indices of the ranges of the message
    used: Annotated[Ints, (_T,)]  # indices of the ranges that are used
    mask: int  # bits of the used ranges, in the order of `received`
    shared: int  # 1 where the used ranges have an echo in common, else 0
    tilt: float  # by what share of themselves it has made differences of ranges smaller
    tilt_variance: float
    common: ByRange  # u = L⁻¹ 1, by which it adds to whitened residuals, scaled to length 1


class UpdateOutcome(RecordFields):
    """Result of the last update of a component."""

    # ranges that were used, less one where they have an echo in common: the degrees of freedom of
    # `nis_sum`
    n_used: int
    shared: int  # 1 where they were taken for echoes of one common excess, else 0
    nis_sum: float  # their squared residuals, in units of S
    # the same for each range received, an echo counting as what it costs
    normalised_innovation: float


class GaussianMixture(RecordFields):
    """A mixture of Gaussians, and what was sensed since the last message."""

    # of each component: `hypothesis · modes + mode`
    state: Annotated[Floats, (COMPONENTS, MAX_STATES)]  # mean
    covariance: Annotated[Floats, (COMPONENTS, MAX_STATES, MAX_STATES)]
    weight: ByComponent  # sum 1 over those alive
    evidence: ByComponent  # log likelihood of the message
    outcome: Annotated[list[UpdateOutcome], (COMPONENTS,)]
    turn_excess: ByComponent  # by how much `leader_variance` should be larger [rad²]
    n_hypotheses: int
    n_states: int  # as of `Model`
    received: int  # ranges of the last message
    smoothed_nis: float  # NIS over some messages
    missed_updates: float  # messages in a row without an accepted range
    common_echoes: int  # messages in a row of which all ranges were taken for echoes
    leader_variance: float  # estimated, of the random error of the leader's heading [rad²]
    leader_position_variance: float  # of e in the last message, along each axis [m²]
    turn: CompassTurn
    leader_turn: CompassTurn
    motion: Preintegration
    recent: WaySums
    window: Annotated[Floats, (WAY_SUMS,)]  # working memory, of its sums
    leader: LeaderMotion
    output: MeanPosition
    work: RangeUpdate
    # x, y, vx, vy over the mixture, at the last step
    mixture_mean: Annotated[Floats, (4,)]
    mixture_covariance: Annotated[Floats, (4, 4)]
    # their derivatives by a component's states, and room for one row
    rows: Annotated[Floats, (5, MAX_STATES)]
    prior_variance: ByState  # variances at the start
    ph: ByState  # P Hᵀ of an update with one number, not yet divided by S


MODEL = record_dtype(Model)
RANGE_MESSAGE = record_dtype(RangeMessage)
BELIEF = record_dtype(GaussianMixture)
