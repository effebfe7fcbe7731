"""The model of the tightly coupled navigator: its state, and settings as compiled code takes them.

State, of n numbers; the last six only where `Assume` says that they are unknown:

    x, y    position of the hydrophone, east and north [m]
    b_v     bias of the speed log [m/s]
    b_θ     bias of the compass [rad]
    b_r     mean of the error that the ranges share in proportion [m at the largest range of the message]
    b_L     bias of the leader's compass [rad]
    c       current, east and north [m/s]
    d_i     constant error of the range to transmitter i beside that of the first one [m]
    τ, τ̇    clock offset of the follower from the leader, as a range [m], and its rate [m/s]

A belief is a mixture of Gaussians. With two transmitters both sides of the leader's axis are kept until the data
decide; each such side is a *hypothesis*. Where biases drift, each hypothesis has two *modes*, slow and quick. One
Gaussian, of one mode of one hypothesis, is a *component*.
"""

import math
from typing import Any, TypeAlias

import numpy as np

from laisn.arrays import Ints
from laisn.tight.settings import TightSettings

X, Y, LOG, COMPASS, SCALE = range(5)
"""Indices of the states that are always there; `Model` says where the others are."""
ABSENT = -1
"""Index of a state that is switched off."""

# How fast what is called constant may wander, in a second. Biases of real sensors are never quite constant, and a
# filter that believes them to be loses track of them for good.
_STEADY_LOG, _STEADY_COMPASS = 2e-4, 1.5e-4  # [m/s/√s], [rad/√s]
_DRIFTING_LOG, _DRIFTING_COMPASS = 2.5e-3, 1.7e-3
_MODES = (0.25, 2.5)
"""Slow and quick drift, as multiples of these."""
_LEADER_COMPASS = 5e-5  # [rad/√s]
_CURRENT_WALK = 1e-3  # [m/s/√s]
_CLOCK_WALK = 3e-6  # of τ̇ [m/s/√s]: 2 ppb/√s, as of a crystal oscillator whose temperature changes
_MODE_SWITCHES = 0.004
"""How often drift changes its mode, slow or quick [1/s]."""
_DEVIATION = 0.03
"""Change of a compass's bias in a turn, as a share of the turn, where it has a deviation."""


_MODEL = np.dtype((np.record, np.dtype([
    ("states", np.int64),  # n, how many there are
    ("modes", np.int64),
    ("leader", np.int64),  # index of b_L, bias of the leader's heading, in the state, or `ABSENT`
    ("current", np.int64),  # index of the current's east component, or `ABSENT`; its north component comes next
    ("offset", np.int64),  # index of d_2, the second transmitter's constant error, or `ABSENT`
    ("clock", np.int64),  # index of τ, the clocks' offset, or `ABSENT`; τ̇ comes next
    ("transmitters", np.int64),
    ("use_attitude", np.bool_),
    ("dt", np.float64),
    ("baseline", np.float64), ("middle_offset", np.float64), ("hydrophone_height", np.float64),
    ("speed_variance", np.float64), ("heading_variance", np.float64),
    ("slip_rate", np.float64),  # variance of position that motion unseen by the log adds in a second [m²/s]
    ("log_walk", np.float64, 2),  # variance that b_v gains in a second, by mode [m²/s³]
    ("compass_walk", np.float64, 2),  # variance that b_θ gains in a second, by mode [rad²/s]
    ("current_walk", np.float64),
    ("leader_walk", np.float64),  # variance that b_L gains in a second [rad²/s]
    ("clock_walk", np.float64),  # variance that τ̇ gains in a second [m²/s³]
    ("mode_switches", np.float64),  # rate of changes of the mode [1/s]
    ("deviation", np.float64),
    ("range_sigma", np.float64), ("range_scale_variance", np.float64),
    ("leader_variance", np.float64),  # of the heading in a message [rad²]: the learnt one starts here and is never more
    ("log_accepted", np.float64),  # logarithm of the chance that a range is a direct one
    ("outlier_span", np.float64),  # largest excess of an echo [m]
    ("log_rejected", np.float64),  # logarithm of the probability density of an echo's excess, in [1/m]
], align=True)))  # fmt: skip

Model: TypeAlias = Any
"""`TightSettings` as compiled code takes them: a record with the fields of `_MODEL`, so that calls pass a pointer."""


def model_of(settings: TightSettings) -> Model:
    """Settings as compiled code takes them."""
    assume = settings.assume
    size, leader, current, offset, clock = 5, ABSENT, ABSENT, ABSENT, ABSENT
    if not assume.exact_leader:
        leader, size = size, size + 1
    if assume.current:
        current, size = size, size + 2
    if assume.offsets:
        offset, size = size, size + settings.transmitters - 1
    if assume.clock:
        clock, size = size, size + 2
    log_walk, compass_walk = (_DRIFTING_LOG, _DRIFTING_COMPASS) if assume.drift else (_STEADY_LOG, _STEADY_COMPASS)
    slow, quick = _MODES if assume.drift else (1.0, 1.0)
    fields = {
        "states": size,
        "modes": 2 if assume.drift else 1,
        "leader": leader,
        "current": current,
        "offset": offset,
        "clock": clock,
        "transmitters": settings.transmitters,
        "use_attitude": settings.use_attitude,
        "dt": settings.dt,
        "baseline": settings.baseline,
        "middle_offset": settings.middle_offset,
        "hydrophone_height": settings.hydrophone_height,
        "speed_variance": settings.speed_sigma**2,
        "heading_variance": settings.heading_sigma**2,
        "slip_rate": settings.slip**2,
        "log_walk": ((slow * log_walk) ** 2, (quick * log_walk) ** 2),
        "compass_walk": ((slow * compass_walk) ** 2, (quick * compass_walk) ** 2),
        "current_walk": _CURRENT_WALK**2,
        "leader_walk": _LEADER_COMPASS**2,
        "clock_walk": _CLOCK_WALK**2,
        "mode_switches": _MODE_SWITCHES,
        "deviation": _DEVIATION**2 if assume.deviation else 0.0,
        "range_sigma": settings.range_sigma,
        "range_scale_variance": settings.range_scale_sigma**2,
        "leader_variance": 0.0 if assume.exact_leader else settings.leader_heading_sigma**2,
        "log_accepted": math.log1p(-settings.outlier_chance),
        "outlier_span": settings.outlier_span,
        "log_rejected": math.log(settings.outlier_chance / settings.outlier_span),
    }
    return np.array([tuple(fields[name] for name in _MODEL.names or ())], dtype=_MODEL)[0]


def canonical(model: Model) -> Ints:
    """Where each state of a model stands among all that there can be (`TightEstimates.names`), shape (size,)."""
    places = [X, Y, LOG, COMPASS, SCALE]
    if model.leader != ABSENT:
        places.append(5)
    if model.current != ABSENT:
        places += [6, 7]
    if model.offset != ABSENT:
        places += [8, 9][: model.transmitters - 1]
    if model.clock != ABSENT:
        places += [10, 11]
    return np.array(places, dtype=np.int64)
