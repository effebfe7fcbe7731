"""When a leader should weave: what followers on its axis could know of their place at best, by how it weaves.

Two transmitters on the axis tell a follower there neither port from starboard nor much of how far it is aside. A leader
that weaves turns its axis away from them. How far that helps is told by the Cramér–Rao bound, without a flight: the
leader's heading swings as a sine, the follower goes where the leader went.
"""

from functools import cache

import numpy as np

from experiments.findings import Finding, plain
from laisn.bound import Geometry, TrueNoise, position_bound

WEAVES = ((0.0, 40.0), (2.0, 40.0), (5.0, 20.0), (5.0, 40.0), (5.0, 80.0), (10.0, 40.0))
"""Amplitudes [°] and periods [s] of the leader's heading."""
BEHIND = (20, 40)
"""How far behind the follower is, in the leader's trail [m]."""
_SPEED, _DEEPER, _HALF, _STEP = 1.0, 10.0, 1.0, 0.1
"""Of both vehicles [m/s]; the follower below the leader [m]; half the transmitters' distance [m]; filter step [s]."""
_SECONDS = 300


def geometry(amplitude_deg: float, period_s: float, behind: float) -> Geometry:
    """The mission of a follower so far behind a leader that weaves [m], a message each second."""
    late = round(behind / _SPEED / _STEP)
    time = _STEP * np.arange(-late, round(_SECONDS / _STEP) + 1)
    heading = np.deg2rad(amplitude_deg) * np.sin(2.0 * np.pi * time / period_s)
    ahead = np.stack([np.sin(heading), np.cos(heading)], axis=1)
    way = np.concatenate([np.zeros((1, 2)), np.cumsum(_SPEED * _STEP * ahead[1:], axis=0)])
    n = time.size - late - 1
    step = np.arange(10, n + 1, 10)
    # whoever is at the last instant where the leader was `late` steps before
    leader, follower = way[late:], way[: n + 1]
    axis = _HALF * ahead[late + step]
    arms = np.stack([np.column_stack([end * axis, np.full(step.size, -_DEEPER)]) for end in (-1.0, 1.0)], axis=1)
    return Geometry(
        dt=_STEP,
        speed=np.full(n, _SPEED),
        heading=heading[1 : n + 1],
        message_step=step,
        from_leader=follower[step] - leader[step],
        arms=arms,
    )


def longer(amplitude_deg: float) -> float:
    """Way that a weave costs, as a share of the way made good: 1 / mean cos θ − 1."""
    swing = np.deg2rad(amplitude_deg) * np.sin(2.0 * np.pi * (np.arange(720) + 0.5) / 720)
    return float(1.0 / np.mean(np.cos(swing)) - 1.0)


@cache
def least_error(amplitude_deg: float, period_s: float, behind: float) -> float:
    """Root of the mean square error that no estimator of these ranges can undercut, over a mission [m]."""
    bound = position_bound(geometry(amplitude_deg, period_s, behind), TrueNoise(start=0.01))
    return float(np.sqrt(np.mean(np.trace(bound, axis1=1, axis2=2))))


def findings() -> dict[str, Finding]:
    """Least errors by weave and station, and what each weave costs of way."""
    named = {}
    for amplitude, period in WEAVES:
        name = f"weave {amplitude:g} {period:g}"
        for behind in BEHIND:
            what = f"least RMS error {behind} m behind, leader's heading swings by {amplitude:g}° each {period:g} s"
            named[f"{name} {behind}"] = plain(least_error(amplitude, period, float(behind)), what, "m")
        named[f"{name} way"] = plain(longer(amplitude), "way that this weave costs, as a share of the way made good")
    return named
