"""A whole mission in one compiled loop: what campaigns run, and what `TightNavigator.run` must equal."""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, compiled_run, copy_values
from laisn.elementary import sin_cos
from laisn.failure import LaisnError
from laisn.messages import Measurements
from laisn.navigators import MissionResult
from laisn.tight.belief import Belief, new_belief
from laisn.tight.estimates import kind_of
from laisn.tight.estimator import count_received, place_arms, receive
from laisn.tight.model import Model, model_of
from laisn.tight.own_motion import moments, position, reckon
from laisn.tight.ranging import Heard, new_heard
from laisn.tight.settings import TightSettings
from laisn.tight.sides import heaviest, hypothesis_weight

_AHEAD = 64
"""Headings whose sines and cosines are taken together."""


class Found(NamedTuple):
    """What comes of a mission of n steps and m messages."""

    state: Floats
    """Mean x, y [m], vx, vy [m/s] after each step, shape (n, 4); shape (n, 2) without covariances."""
    covariance: Floats
    """Covariance of the position: xx, xy, yy, shape (n, 3), [m²]; of shape (0, 3), it is left out."""
    outcome: Floats
    """For each message: ranges received, ranges that the heaviest hypothesis used, and their squared residuals in units
    of S (NaN if none was used), shape (m, 3); of shape (0, 3), it is left out."""


@compiled
def record_outcome(b: Belief, m: Model, heard: Heard, used: int, outcome: Floats) -> None:
    """Note what became of a message: a row of `Found.outcome`, shape (3,); `used` is what `receive` gave."""
    outcome[0] = count_received(m, heard)
    outcome[1], outcome[2] = 0, np.nan
    if used > 0 and b.alive > 0:
        top = 0
        for h in range(1, b.alive):
            if hypothesis_weight(b, m, h) > hypothesis_weight(b, m, top):
                top = h
        k = heaviest(b, m, top)
        outcome[1] = b.taken[k]
        outcome[2] = b.squared[k] if b.taken[k] > 0 else np.nan


@compiled
def look_ahead(own: Floats, first: int, turns: Floats) -> None:
    """Sines and cosines of the next headings, in SIMD, shape (2, `_AHEAD`): they hang on nothing that is estimated."""
    for k in range(min(own.shape[0] - first, _AHEAD)):
        turns[0, k], turns[1, k] = sin_cos(own[first + k, 1])


@compiled_run
def filter_mission(
    b: Belief, m: Model, heard: Heard, own: Floats, message_step: Ints, messages: Floats, found: Found
) -> int:
    """Estimate a whole mission.

    Args:
        b: a new belief.
        m: settings.
        heard: room for a message.
        own: speed [m/s], heading [rad] and depth [m] after each step, shape (n, 3).
        message_step: shape (m,), from 1.
        messages: columns of `LeaderMessage` from timestamp to roll, then the three ranges; shape (m, 11).
        found: overwritten.

    Returns:
        The step at which a covariance was not positive definite; 0 if none was.
    """
    i, states, covariances, outcome = 0, found.state, found.covariance, found.outcome
    turns = np.empty((2, _AHEAD))
    for k in range(own.shape[0]):
        ahead = k % _AHEAD
        if ahead == 0:
            look_ahead(own, k, turns)
        reckon(b, m, own[k, 0], turns[0, ahead], turns[1, ahead], m.dt)
        if i < message_step.size and message_step[i] == k + 1:
            row = messages[i]
            heard.time, heard.east, heard.north, heard.heading, heard.speed = row[0], row[1], row[2], row[3], row[4]
            heard.ranges[0], heard.ranges[1], heard.ranges[2] = row[8], row[9], row[10]
            place_arms(heard, m, row[6], row[7], row[5] - (own[k, 2] - m.hydrophone_height))
            used = receive(b, m, heard)
            if used < 0:
                return k + 1
            if outcome.shape[0] > 0:
                record_outcome(b, m, heard, used, outcome[i])
            i += 1
        if covariances.shape[0] > 0:
            moments(b, m)
            copy_values(b.now, states[k])
            covariances[k, 0], covariances[k, 1] = b.now_covariance[0, 0], b.now_covariance[0, 1]
            covariances[k, 2] = b.now_covariance[1, 1]
        else:
            states[k, 0], states[k, 1] = position(b)
    return 0


def run_mission(
    settings: TightSettings, measurements: Measurements, start: Floats | None, *, covariance: bool = True
) -> Found:
    """States and covariances of a mission, to the bit those of `TightNavigator`, without the rest that it tells.

    Args:
        settings: of the navigator.
        measurements: of the mission, n steps.
        start: x, y at step 0, shape (2,) or more, [m]; None, or settings that say so: unknown.
        covariance: compute velocities, covariances and what became of messages too, which takes most of the time.

    Returns:
        What was found; NaN before a start is.

    Raises:
        ArithmeticError: a covariance is not positive definite.
        LaisnError: steps differ in length, or transmitters are on no leader's hull; `TightNavigator` takes these.
    """
    if measurements.durations is not None or measurements.transmitters is not None or settings.transmitter_offsets:
        raise LaisnError("campaigns know steps of equal length, and transmitters on the leader's hull only")
    model, n = model_of(settings), measurements.speed.size
    messages_told = len(measurements.message) if covariance else 0
    found = Found(np.empty((n, 4 if covariance else 2)), np.empty((n if covariance else 0, 3)),
                  np.empty((messages_told, 3)))  # fmt: skip
    own = np.column_stack([measurements.speed, measurements.heading, measurements.last_depth])
    messages = np.column_stack([measurements.message[:, :8], measurements.ranges])
    known = None if start is None or not settings.known_start else (float(start[0]), float(start[1]))
    belief = new_belief(settings, model, known)
    failed = filter_mission(belief, model, new_heard(), own, measurements.message_step, messages, found)
    if failed:
        raise ArithmeticError(f"step {failed}: a covariance is not positive definite")
    return found


def fly(settings: TightSettings, measurements: Measurements, start: Floats) -> MissionResult:
    """One run of a campaign; errors as of `run_mission`. The mean of an update's squared residuals is its ranges."""
    found = run_mission(settings, measurements, start)
    received, used, squared = found.outcome.T
    known = np.isfinite(squared)
    kinds = [kind_of(int(r), int(u)) for r, u in zip(received, used, strict=True)]
    return MissionResult(found.state, found.covariance, kinds, squared[known].sum(), used[known].sum())
