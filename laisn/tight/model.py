"""The model of the tightly coupled navigator: its state, and settings as compiled code takes them.

State, of n numbers; the last ten only where the settings have them unknown:

    x, y    position of the hydrophone, east and north [m] b_v     bias of the speed log [m/s] b_θ
    bias of the compass [rad] b_r     mean of the error that the ranges share in proportion [m at
    the largest range of the message] b_L     bias of the leader's compass [rad] c       current,
    east and north [m/s] d_i     constant error of the range to transmitter i beside that of the
    first one [m] τ, τ̇    clock offset of the follower from the leader, as a range [m], and its
    rate [m/s]
    e, w    error of the broadcast position, true less broadcast, east and north [m]: what is new
    in each message, and what walks

A belief is a mixture of Gaussians. With two transmitters both sides of the leader's axis are kept
until the data decide; each such side is a *hypothesis*. Where biases drift, each hypothesis has two
*modes*, slow and quick. One Gaussian, of one mode of one hypothesis, is a *component*.
"""

import math
from typing import Any, TypeAlias

import numpy as np

from laisn.compiled import compiled
from laisn.estimates import HYPOTHESES
from laisn.settings import COMPASS_WALK, CURRENT_WALK, LOG_WALK, TightSettings
from laisn.vector_math import sin_cos

X, Y, LOG, COMPASS, SCALE = range(5)
"""Indices of the states that are always there; `Model` has those of the others."""
_MOST_MODES = 4
ABSENT = -1  # of a state that is switched off

_DRIFTING_LOG = 2.5e-3  # [m/s/√s]
_DRIFTING_COMPASS = 1.7e-3  # [rad/√s]
_MODES = (0.25, 2.5)  # slow and quick drift, as multiples of these
_LEADER_COMPASS = 5e-5  # [rad/√s]
_CLOCK_WALK = 3e-6  # of τ̇ [m/s/√s]: 2 ppb/√s, as of a crystal oscillator whose temperature changes
_MODE_SWITCHES = 0.004
# of the speed through the water, held and in manoeuvres [m/s/√s], and the rate at which a vehicle
# changes between these [1/s]: it stays for a second with a chance of 0.97
_SPEED_WALKS = (0.005, 0.2)
_SPEED_SWITCHES = -0.5 * math.log(2.0 * 0.97 - 1.0)
# change of a compass's bias in a turn, as a share of the turn, where it has a deviation
_DEVIATION = 0.03

Model: TypeAlias = Any
"""`TightSettings` as compiled code takes them: a record with the fields of `model_of`, so that
calls pass a pointer.
"""

_OPTIONAL = {
    "leader": 5,
    "current": 6,
    "offset": 8,
    "clock": 10,
    "place": 12,
    "place_walk": 14,
    "speed": 16,
}
"""Optional states: field of `Model` with the index of the first one, and its place in
`TightEstimates.names`.
"""


def prior_sigmas(settings: TightSettings) -> dict[int, float]:
    """Prior standard deviation of each state, by its place in `TightEstimates.names`, in the
    order of the state.
    """
    s = settings
    assume = settings.assume
    always = (
        s.start_sigma,
        s.start_sigma,
        s.speed_bias_sigma,
        s.heading_bias_sigma,
        s.range_scale_bias_sigma,
    )
    sigmas = dict(enumerate(always))
    if not assume.exact_leader:
        sigmas[5] = s.leader_heading_bias_sigma
    if assume.current:
        sigmas[6] = sigmas[7] = s.current_sigma
    if assume.offsets:
        sigmas |= {8 + i: s.offset_sigma for i in range(s.transmitters - 1)}
    if assume.clock:
        sigmas[10] = s.clock_offset_sigma
        sigmas[11] = s.clock_drift_sigma
    if s.leader_position_sigma > 0.0:
        sigmas[12] = sigmas[13] = s.leader_position_sigma
    if s.leader_position_walk > 0.0:
        # it begins with the mission
        sigmas[14] = sigmas[15] = 0.0
    if assume.steady_speed:
        # as the first reading of the log shows it
        sigmas[16] = math.hypot(s.speed_sigma, s.speed_bias_sigma)
    return sigmas


def _of_modes(values: list[float]) -> tuple[float, ...]:
    """Values of each mode, filled up to `_MOST_MODES`."""
    return (*values, *[0.0] * (_MOST_MODES - len(values)))


def model_of(settings: TightSettings) -> Model:
    """Settings as compiled code takes them."""
    s = settings
    assume = settings.assume
    places = list(prior_sigmas(s))
    log_walk, compass_walk = (
        (_DRIFTING_LOG, _DRIFTING_COMPASS) if assume.drift else (LOG_WALK, COMPASS_WALK)
    )
    drifts = _MODES if assume.drift else (1.0,)
    speeds = _SPEED_WALKS if assume.steady_speed else (0.0,)
    # of each mode, drift · speed
    log_walks = _of_modes([(drift * log_walk) ** 2 for _ in speeds for drift in drifts])
    compass_walks = _of_modes([(drift * compass_walk) ** 2 for _ in speeds for drift in drifts])
    speed_walks = _of_modes([speed**2 for speed in speeds for _ in drifts])
    integers = {
        "states": len(places),  # n
        "modes": len(drifts) * len(speeds),
        "drift_modes": len(drifts),
        "speed_modes": len(speeds),
        # indices of b_L, of the current's east component (north comes next), of d_2, of τ (τ̇ comes
        # next), of the east components of e and w, and of the speed
        **{
            name: places.index(place) if place in places else ABSENT
            for name, place in _OPTIONAL.items()
        },
        "transmitters": s.transmitters,
        "use_attitude": s.use_attitude,
        "compensate_motion": s.compensate_motion,
    }
    same = (
        "dt",
        "floor_depth",
        "baseline",
        "middle_offset",
        "hydrophone_height",
        "range_sigma",
        "outlier_span",
    )
    numbers: dict[str, Any] = {
        **{name: getattr(s, name) for name in same},
        "speed_variance": s.speed_sigma**2,
        "heading_variance": s.heading_sigma**2,
        # variance of position that motion unseen by the log adds in a second [m²/s]
        "slip_rate": s.slip**2,
        # b_v gains in a second, by mode [m²/s³]
        "log_walk": log_walks,
        # b_θ likewise [rad²/s]
        "compass_walk": compass_walks,
        # the speed likewise [m²/s³]
        "speed_walk": speed_walks,
        "current_walk": CURRENT_WALK**2,
        "leader_walk": _LEADER_COMPASS**2,  # b_L likewise [rad²/s]
        "clock_walk": _CLOCK_WALK**2,  # τ̇ likewise [m²/s³]
        "speed_switches": _SPEED_SWITCHES,
        "mode_switches": _MODE_SWITCHES,  # rate of changes of the mode [1/s]
        "deviation": _DEVIATION**2 if assume.deviation else 0.0,
        "range_scale_variance": s.range_scale_sigma**2,
        # prior and upper limit [rad²]
        "leader_variance": 0.0 if assume.exact_leader else s.leader_heading_sigma**2,
        "place_variance": s.leader_position_sigma**2,  # of e along each axis [m²]
        "place_walk_rate": s.leader_position_walk**2,  # w gains in a second [m²/s]
        "ping_slot": s.ping_slot if s.compensate_motion else 0.0,
        "sound_slowness": s.sound_slowness if s.compensate_motion else 0.0,
        # logarithm of the chance that an echo is one
        "log_outlier": math.log(s.outlier_probability),
        # logarithm of the chance that a range is a direct one
        "log_accepted": math.log1p(-s.outlier_probability),
        # of an echo's density in [1/m]
        "log_rejected": math.log(s.outlier_probability / s.outlier_span),
    }
    types: list[Any] = [(name, np.int64) for name in integers]
    types += [(name, np.float64, np.shape(value)) for name, value in numbers.items()]
    record = np.dtype((np.record, np.dtype(types, align=True)))
    return np.array([(*integers.values(), *numbers.values())], dtype=record)[0]


CAPACITY = 2 * HYPOTHESES

# room for n: arrays of a belief have one shape for all settings, so that all share compiled code
MOST_STATES = 17
_COMPONENTS = _MOST_MODES * CAPACITY
# holds a copy or a trial while there are at most `HYPOTHESES` + 2 hypotheses
SPARE = _COMPONENTS - 1
_T = 3

# A belief is one record of fixed layout: compiled functions take a pointer to it, and it can be
# copied as a whole.

_MOTION = np.dtype(
    [
        (name, np.float64)
        for name in (
            # A = Σ v u Δt since the last message, with the measured speed v in the measured
            # direction u [m]
            "ax",
            "ay",
            "bx",
            "by",  # B = Σ u Δt [s]
            "nxx",
            "nxy",
            "nyy",  # covariance of A's random errors [m²]
            "time",  # since the last message [s]
            # the same where the speed is a state, and these sums begin anew in each step
            "elapsed",
            "unmixed",  # since the modes of speed were mixed [s]
            # the last reading of the log [m/s], NaN before the first, and the compass's direction
            "speed",
            "sin",
            "cos",
            "clock",  # time since the start [s]
            "mean_speed",  # of the log over the last seconds [m/s]
        )
    ]
)
_TURN = np.dtype(
    [
        (name, np.float64)
        for name in (
            "sin",
            "cos",  # the heading before it; zeros before the first one
            "angle",  # the largest between that heading and a later one [rad]
            "still",  # since it was last larger than before [s]
        )
    ]
)
_LEADER = np.dtype(
    [
        (name, np.float64)
        for name in (
            # where the window began; the time is NaN before the first message
            "window_time",
            "window_x",
            "window_y",
            "logged_x",
            "logged_y",  # Σ s_L u(θ_L) Δt since then [m]
            "velocity_x",
            "velocity_y",  # s_L u(θ_L) of the last message [m/s]
            "first_heading",  # at the window's beginning [rad]
            "first_time",
            "last_time",  # of the first message of all and of the last one [s]
            # place [m] at the last message, and direction of the way there [rad]
            "at_x",
            "at_y",
            "track",
            "leg",  # messages on the leg so far; 0: it turns, or that is unknown
            "steady",  # 1 where the leg's mean heading is used, else 0
            "leg_heading",  # mean heading of the leg, as it was at the last message [rad]
            # of readings on all legs from their means [rad²], and how many they are worth
            "squares",
            "compared",
            "scatter",  # variance of a reading about its leg's heading, as far as known [rad²]
            # `leader_variance` of steady legs while there is none, else of readings [rad²]
            "other_variance",
        )
    ]
)
_OUTPUT = np.dtype(
    # the mean over the mixture is (x, y) + C A − D B + v T, with C and D rotations times numbers
    [(name, np.float64) for name in ("x", "y", "c_cos", "c_sin", "d_cos", "d_sin", "v_x", "v_y")]
)
_WORK = np.dtype(
    [
        ("residual", np.float64, _T),  # z − ẑ [m]
        # derivatives of each range by the states
        ("row_x", np.float64, _T),
        ("row_y", np.float64, _T),
        ("row_scale", np.float64, _T),
        ("row_leader", np.float64, _T),
        ("row_log", np.float64, _T),
        ("row_compass", np.float64, _T),
        # covariance of the place beside the leader, east and north, with the states
        ("away", np.float64, (2, MOST_STATES)),
        # second derivatives of each range by (x, y, b_L), times their covariance
        ("curvature", np.float64, (_T, 3, 3)),
        ("spread", np.float64, (_T, _T)),  # S: covariance of the residuals [m²]
        ("direct_spread", np.float64, (_T, _T)),  # S of ranges without a common echo
        ("root", np.float64, (_T, _T)),  # Cholesky factor of S over the used ranges
        ("per_root", np.float64, _T),  # reciprocals of the diagonal of `root`
        # residuals, and `row_leader`, in units of `root`
        ("white", np.float64, _T),
        ("turned", np.float64, _T),
        ("gain", np.float64, (_T, MOST_STATES)),  # H P
        # where the ranges are linearised, from the mean of x, y [m], and the part of their
        # covariance xx, xy, yy that an update has taken away there [m²]
        ("shift", np.float64, 2),
        ("removed", np.float64, 3),
        ("white_gain", np.float64, (_T, MOST_STATES)),  # root⁻¹ H P over the ranges that are used
        ("received", np.int64, _T),  # indices of the ranges of the message
        ("used", np.int64, _T),  # indices of the ranges that are used
        ("mask", np.int64),  # bits of the used ranges, in the order of `received`
        ("shared", np.int64),  # 1 where the used ranges have an echo in common, else 0
        ("share", np.float64),  # square of its excess over a range
        ("common", np.float64, _T),  # its direction in units of the root, of length 1
    ]
)
_OUTCOME = np.dtype(
    [
        ("taken", np.int64),  # ranges that were used
        ("squared", np.float64),  # their squared residuals, in units of S
        # the same for each range received, an echo counting as what it costs
        ("normalised_innovation", np.float64),
    ]
)
_BELIEF = np.dtype(
    (
        np.record,
        np.dtype(
            [
                # mean of each component: `hypothesis · modes + mode`
                ("state", np.float64, (_COMPONENTS, MOST_STATES)),
                ("covariance", np.float64, (_COMPONENTS, MOST_STATES, MOST_STATES)),
                ("weight", np.float64, _COMPONENTS),  # sum 1 over those alive
                (
                    "evidence",
                    np.float64,
                    _COMPONENTS,
                ),  # log likelihood of the message for each component
                ("outcome", _OUTCOME, _COMPONENTS),  # of its last update
                # by how much `leader_variance` should be larger [rad²]
                ("turn_excess", np.float64, _COMPONENTS),
                ("alive", np.int64),  # hypotheses
                ("states", np.int64),  # as of `Model`
                ("received", np.int64),  # ranges of the last message
                ("smoothed_nis", np.float64),  # NIS over some messages
                ("missed_updates", np.float64),  # messages in a row without an accepted range
                # estimated, of the random error of the leader's heading [rad²]
                ("leader_variance", np.float64),
                # of e in the last message, along each axis [m²]
                ("place_variance", np.float64),
                ("turn", _TURN),
                ("leader_turn", _TURN),  # that either compass is in, or the last one
                ("motion", _MOTION),
                ("leader", _LEADER),
                ("output", _OUTPUT),
                ("work", _WORK),
                # x, y, vx, vy over the mixture, at the last step
                ("now", np.float64, 4),
                ("now_covariance", np.float64, (4, 4)),
                # their derivatives by a component's states, and room for one row
                ("rows", np.float64, (5, MOST_STATES)),
                ("fresh", np.float64, MOST_STATES),  # variances at the start
                ("gain", np.float64, MOST_STATES),  # P Hᵀ of an update with one number
            ],
            align=True,
        ),
    )
)

Belief: TypeAlias = Any
"""A mixture of Gaussians, and what was sensed since the last message: a record with the fields
of `_BELIEF`.
"""


@compiled
def refresh_output(b: Belief, m: Model) -> None:
    """Prepare the mean position for the steps until the next message; NaN if there is no
    hypothesis.
    """
    out = b.output
    out.x = out.y = out.c_cos = out.c_sin = out.d_cos = out.d_sin = out.v_x = out.v_y = 0.0
    if b.alive == 0:
        out.x = out.y = np.nan
    for k in range(b.alive * m.modes):
        w = b.weight[k]
        sine, cosine = sin_cos(b.state[k, COMPASS])
        out.x += w * b.state[k, X]
        out.y += w * b.state[k, Y]
        if m.speed == ABSENT:
            bias = b.state[k, LOG]
            out.c_cos += w * cosine
            out.c_sin += w * sine
        else:
            # the way is v B, not A − b_v B
            bias = -b.state[k, m.speed]
        out.d_cos += w * cosine * bias
        out.d_sin += w * sine * bias
        if m.current != ABSENT:
            out.v_x += w * b.state[k, m.current]
            out.v_y += w * b.state[k, m.current + 1]


def new_belief(settings: TightSettings, m: Model, start: tuple[float, float] | None) -> Belief:
    """One hypothesis: a known start [m], and biases of zero with the standard deviations of the
    settings.

    None: the start is unknown, and there is no hypothesis before the first message with two ranges.
    """
    # by key, as attributes of a record are slow outside of compiled code
    names = ["states", "modes", "leader_variance", "place_variance"]
    states, modes, leader_variance, place_variance = m[names].item()
    fresh = np.zeros(MOST_STATES)
    fresh[:states] = np.square(list(prior_sigmas(settings).values()))
    made = np.zeros(1, dtype=_BELIEF)
    made["states"] = states
    made["alive"] = start is not None
    made["smoothed_nis"] = 1.0
    made["leader_variance"] = leader_variance
    made["place_variance"] = place_variance
    made["fresh"] = fresh
    made["motion"]["speed"] = np.nan
    about = made["leader"]
    about["window_time"] = about["at_x"] = about["track"] = np.nan
    about["scatter"] = leader_variance
    about["other_variance"] = leader_variance / 16.0
    if start is not None:
        made["state"][0, :modes, :LOG] = start
        made["covariance"][0, :modes] = np.diag(fresh)
        made["weight"][0, :modes] = 1.0 / modes
    belief: Belief = made[0]
    refresh_output(belief, m)
    return belief
