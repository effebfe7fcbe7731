"""The model of the tightly coupled navigator: its state, and settings as compiled code takes them.

State, of n numbers, in this order; those from b_L on only where the settings have them unknown:

    x, y    position of the hydrophone, east and north [m]
    b_v     bias of the speed log [m/s]
    b_θ     bias of the compass [rad]
    b_r     mean of the error that the ranges share in proportion [m at the largest range of the
            message]
    b_L     bias of the leader's compass [rad]
    c       current, east and north [m/s]
    d_i     constant error of the range to transmitter i beside that of the first one [m]
    τ, τ̇    clock offset of the follower from the leader, as a range [m], and its rate [m/s]
    e, w    error of the broadcast position, true less broadcast, east and north [m]: what is new in
            each message, and what walks
    v       speed through the water [m/s]

A belief is a mixture of Gaussians. With two transmitters both sides of the leader's axis are kept
until the data decide; each such side is a *hypothesis*. Where biases drift, each hypothesis has two
*modes*, slow and quick. One Gaussian, of one mode of one hypothesis, is a *component*.
"""

import math
from typing import Any, cast

import numpy as np

from laisn.compiled import compiled
from laisn.settings import COMPASS_WALK, CURRENT_WALK, LOG_WALK, Assume, TightSettings
from laisn.tight.records import (
    ABSENT,
    BELIEF,
    MAX_MODES,
    MAX_STATES,
    MODEL,
    GaussianMixture,
    Model,
)
from laisn.vector_math import sin_cos

X, Y, LOG_BIAS, COMPASS_BIAS, RANGE_SCALE = range(5)
"""Indices of the states x, y, b_v, b_θ and b_r, which are always there; `Model` has those of the
others.
"""

# random walks of the biases of log and compass, where the settings assume that they drift
_DRIFTING_LOG_WALK = 2.5e-3  # [m/s/√s]
_DRIFTING_COMPASS_WALK = 1.7e-3  # [rad/√s]
_DRIFT_MODES = (0.25, 2.5)  # slow and quick drift, as multiples of these
_LEADER_COMPASS_WALK = 5e-5  # of b_L [rad/√s]
_CLOCK_WALK = 3e-6  # of τ̇ [m/s/√s]: 2 ppb/√s, as of a crystal oscillator whose temperature changes
_MODE_SWITCHES = 0.004  # rate of changes between slow and quick drift [1/s]
# of the speed through the water, held and in manoeuvres [m/s/√s], and the rate at which a vehicle
# changes between these [1/s]: it stays for a second with a chance of 0.97
_SPEED_WALKS = (0.005, 0.2)
_SPEED_SWITCHES = -0.5 * math.log(2.0 * 0.97 - 1.0)
# change of a compass's bias in a turn, as a share of the turn, where it has a deviation
_DEVIATION = 0.03

_OPTIONAL = {
    "leader_bias": 5,
    "current": 6,
    "offset": 8,
    "clock": 10,
    "leader_position": 12,
    "leader_position_walk": 14,
    "speed": 16,
}
"""Optional states: field of `Model` with the index of the first one, and its number in the table of
all states above, of which `TightEstimates.names` has the first 12.
"""


def prior_sigmas(settings: TightSettings) -> dict[int, float]:
    """Prior standard deviation of each state that the settings have, by its number in the table of
    all states above, in the order of the state.
    """
    s = settings
    assume = settings.assume
    sigmas_always = (
        s.start_sigma,
        s.start_sigma,
        s.speed_bias_sigma,
        s.heading_bias_sigma,
        s.range_scale_bias_sigma,
    )
    sigmas = dict(enumerate(sigmas_always))
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


def _per_mode(values: list[float]) -> tuple[float, ...]:
    """Values of each mode, filled up to `MAX_MODES`."""
    return (*values, *[0.0] * (MAX_MODES - len(values)))


def _modes_of(assume: Assume) -> dict[str, Any]:
    """Numbers of modes, and by mode the variances in a second that biases and speed gain."""
    log_walk, compass_walk = LOG_WALK, COMPASS_WALK
    drifts: tuple[float, ...] = (1.0,)
    if assume.drift:
        log_walk, compass_walk = _DRIFTING_LOG_WALK, _DRIFTING_COMPASS_WALK
        drifts = _DRIFT_MODES
    speeds = _SPEED_WALKS if assume.steady_speed else (0.0,)
    return {
        "modes": len(drifts) * len(speeds),
        "drift_modes": len(drifts),
        "speed_modes": len(speeds),
        # of each mode, drift · speed
        "log_walk": _per_mode([(drift * log_walk) ** 2 for _ in speeds for drift in drifts]),
        "compass_walk": _per_mode(
            [(drift * compass_walk) ** 2 for _ in speeds for drift in drifts]
        ),
        "speed_walk": _per_mode([speed**2 for speed in speeds for _ in drifts]),
    }


def model_of(settings: TightSettings) -> Model:
    """Settings as compiled code takes them."""
    s = settings
    assume = settings.assume
    layout = list(prior_sigmas(s))
    first_states = {
        name: layout.index(state) if state in layout else ABSENT
        for name, state in _OPTIONAL.items()
    }
    values = {
        "n_states": len(layout),
        **_modes_of(assume),
        **first_states,
        "transmitters": s.transmitters,
        "use_attitude": s.use_attitude,
        "compensate_motion": s.compensate_motion,
        "dt": s.dt,
        "floor_depth": s.floor_depth,
        "baseline": s.baseline,
        "middle_offset": s.middle_offset,
        "hydrophone_height": s.hydrophone_height,
        "range_sigma": s.range_sigma,
        "outlier_span": s.outlier_span,
        "speed_variance": s.speed_sigma**2,
        "heading_variance": s.heading_sigma**2,
        "slip_rate": s.slip**2,
        "current_walk": CURRENT_WALK**2,
        "leader_walk": _LEADER_COMPASS_WALK**2,
        "clock_walk": _CLOCK_WALK**2,
        "speed_switches": _SPEED_SWITCHES,
        "mode_switches": _MODE_SWITCHES,
        "deviation": _DEVIATION**2 if assume.deviation else 0.0,
        "range_scale_variance": s.range_scale_sigma**2,
        "leader_variance": 0.0 if assume.exact_leader else s.leader_heading_sigma**2,
        "leader_position_variance": s.leader_position_sigma**2,
        "leader_position_walk_rate": s.leader_position_walk**2,
        "ping_slot": s.ping_slot if s.compensate_motion else 0.0,
        "sound_slowness": s.sound_slowness if s.compensate_motion else 0.0,
        "log_p_outlier": math.log(s.outlier_probability),
        "log_p_inlier": math.log1p(-s.outlier_probability),
        "log_density_outlier": math.log(s.outlier_probability / s.outlier_span),
    }
    records = np.zeros(1, dtype=MODEL)
    for name in MODEL.fields or ():
        records[name] = values[name]
    return cast(Model, records[0])


def model_beside(m: Model) -> Model:
    """The model of the ranges of a further link: without the states and errors that only the
    leader's messages and transmitters have. The clock, and what errs anew in each message's
    position, are as of `m`.
    """
    records = np.array([m], dtype=MODEL)
    for state in ("leader_bias", "offset", "leader_position_walk"):
        records[state] = ABSENT
    records["leader_variance"] = 0.0
    records["transmitters"] = 3
    return cast(Model, records[0])


@compiled
def refresh_output(b: GaussianMixture, m: Model) -> None:
    """Prepare the mean position for the steps until the next message; NaN if there is no
    hypothesis.
    """
    out = b.output
    out.x = out.y = out.c_cos = out.c_sin = out.d_cos = out.d_sin = out.v_x = out.v_y = 0.0
    if b.n_hypotheses == 0:
        out.x = out.y = np.nan
    for k in range(b.n_hypotheses * m.modes):
        w = b.weight[k]
        sine, cosine = sin_cos(b.state[k, COMPASS_BIAS])
        out.x += w * b.state[k, X]
        out.y += w * b.state[k, Y]
        if m.speed == ABSENT:
            bias = b.state[k, LOG_BIAS]
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


def new_belief(
    settings: TightSettings, m: Model, start: tuple[float, float] | None
) -> GaussianMixture:
    """One hypothesis: a known start [m], and biases of zero with the standard deviations of the
    settings.

    None: the start is unknown, and there is no hypothesis before the first message with two ranges.
    """
    # by key, as attributes of a record are slow outside of compiled code
    names = ["n_states", "modes", "leader_variance", "leader_position_variance"]
    n_states, modes, leader_variance, leader_position_variance = m[names].item()
    prior_variance = np.zeros(MAX_STATES)
    prior_variance[:n_states] = np.square(list(prior_sigmas(settings).values()))
    record = np.zeros(1, dtype=BELIEF)
    record["n_states"] = n_states
    record["n_hypotheses"] = start is not None
    record["smoothed_nis"] = 1.0
    record["leader_variance"] = leader_variance
    record["leader_position_variance"] = leader_position_variance
    record["prior_variance"] = prior_variance
    record["motion"]["speed"] = np.nan
    track = record["leader"]
    track["window_time"] = track["at_x"] = track["track"] = np.nan
    track["scatter"] = leader_variance
    track["other_variance"] = leader_variance / 16.0
    if start is not None:
        record["state"][0, :modes, :LOG_BIAS] = start
        record["covariance"][0, :modes] = np.diag(prior_variance)
        record["weight"][0, :modes] = 1.0 / modes
    belief = cast(GaussianMixture, record[0])
    refresh_output(belief, m)
    return belief
