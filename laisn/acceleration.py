"""Process noise: the acceleration that the filter must expect, more where a vehicle manoeuvres (paper, Section 2.1)."""

import math

from laisn.compiled import formula
from laisn.geometry import angle_between
from laisn.tuning import Tuning

_PER_PI = 1.0 / math.pi


@formula
def speed_share(before: float, now: float, speed_max: float) -> float:
    """γv: change of speed as a share of the top speed; 0 if the first is NaN."""
    share = abs(now - before) * (1.0 / speed_max)
    return share if share > 0.0 else 0.0


@formula
def turn_share(before: float, now: float) -> float:
    """γθ: smallest angle between two headings as a share of π; 0 if the first is NaN."""
    share = angle_between(now, before) * _PER_PI
    return share if share > 0.0 else 0.0


@formula
def larger(a: float, b: float) -> float:
    """Larger of two shares, which is that of the vehicle that changed more."""
    return a if a > b else b


@formula
def expected_acceleration(speed_change: float, turn: float, t: Tuning) -> float:
    """σa = α (γv + γθ) + σa0 [m/s²]."""
    return t.alpha * (speed_change + turn) + t.sigma_a0
