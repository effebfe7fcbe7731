"""What a message concluded, as `TightEstimates` records it: mean, hypotheses and their outcome."""

import math

import numpy as np

from laisn.arrays import Ints, Record
from laisn.compiled import compiled
from laisn.estimates import HYPOTHESES, FixKind, TightEstimates
from laisn.mixture import heaviest, hypothesis_weight
from laisn.tight.records import GaussianMixture, Model

FIX = TightEstimates.fix_dtype()

_GATED = int(FixKind.GATED)
_LOST = int(FixKind.LOST)
_ONE_RANGE = int(FixKind.ONE_RANGE)
_RANGES = int(FixKind.RANGES)
_PARTLY = int(FixKind.PARTLY)


@compiled
def kind_of_message(received: int, used: int) -> int:
    """`FixKind` of a message by its ranges received with an estimate to test them, and used."""
    if received == 0:
        return _LOST
    if used == 0:
        return _GATED
    if used < received:
        return _PARTLY
    return _ONE_RANGE if used == 1 else _RANGES


@compiled
def _clear(fix: Record) -> None:
    """NaN where there are numbers, and no ranges used."""
    fix.fix_kind = _LOST
    fix.fix_sigma = np.nan
    fix.nis = np.nan
    fix.used = 0
    for i in range(2):
        fix.fix_position[i] = np.nan
        fix.innovation[i] = np.nan
        for j in range(2):
            fix.innovation_covariance[i, j] = np.nan
    for i in range(fix.full_state.shape[0]):
        fix.full_state[i] = np.nan
        fix.full_sigma[i] = np.nan
    for h in range(HYPOTHESES):
        fix.weight[h] = 0.0
        for i in range(2):
            fix.hypothesis[h, i] = np.nan
            for j in range(2):
                fix.hypothesis_covariance[h, i, j] = np.nan


@compiled
def _write_states(b: GaussianMixture, m: Model, indices: Ints, fix: Record) -> None:
    """Mean and standard deviation of each state over the mixture: x̄ = Σ w x, σ² = Σ w (P + (x −
    x̄)²).
    """
    for i in range(indices.shape[0]):
        mean = 0.0
        for k in range(b.n_hypotheses * m.modes):
            mean += b.weight[k] * b.state[k, i]
        variance = 0.0
        for k in range(b.n_hypotheses * m.modes):
            deviation = b.state[k, i] - mean
            variance += b.weight[k] * (b.covariance[k, i, i] + deviation * deviation)
        fix.full_state[indices[i]] = mean
        fix.full_sigma[indices[i]] = math.sqrt(variance)


@compiled
def _write_hypothesis(b: GaussianMixture, m: Model, h: int, rank: int, fix: Record) -> None:
    """Weight, place and covariance of hypothesis h over its modes, into the row of its rank."""
    total = hypothesis_weight(b, m.modes, h)
    fix.weight[rank] = total
    for i in range(2):
        mean = 0.0
        for k in range(h * m.modes, (h + 1) * m.modes):
            mean += b.weight[k] / total * b.state[k, i]
        fix.hypothesis[rank, i] = mean
    for i in range(2):
        for j in range(2):
            covariance = 0.0
            for k in range(h * m.modes, (h + 1) * m.modes):
                off_i = b.state[k, i] - fix.hypothesis[rank, i]
                off_j = b.state[k, j] - fix.hypothesis[rank, j]
                covariance += b.weight[k] / total * (b.covariance[k, i, j] + off_i * off_j)
            fix.hypothesis_covariance[rank, i, j] = covariance


@compiled
def _heaviest_below(b: GaussianMixture, m: Model, heavier: int) -> int:
    """The hypothesis that comes next after the one `heavier` by weight, the earlier one among
    equals; the heaviest of all after −1.
    """
    bound = np.inf if heavier < 0 else hypothesis_weight(b, m.modes, heavier)
    best = -1
    largest = -np.inf
    for h in range(b.n_hypotheses):
        weight = hypothesis_weight(b, m.modes, h)
        follows = weight < bound or (weight == bound and h > heavier)
        if follows and weight > largest:
            best = h
            largest = weight
    return best


@compiled
def write_fix(b: GaussianMixture, m: Model, indices: Ints, used: int, fix: Record) -> None:
    """Write the result of a message into a record of FIX; its step is the caller's.

    Args:
        b: the belief after the message.
        m: its model.
        indices: of the states in `TightEstimates.names`, shape (n,).
        used: what `receive` gave: how many of its ranges a hypothesis used at most.
        fix: out.
    """
    _clear(fix)
    if b.n_hypotheses == 0:
        return
    _write_states(b, m, indices, fix)
    likeliest = _heaviest_below(b, m, -1)
    h = likeliest
    for rank in range(b.n_hypotheses):
        _write_hypothesis(b, m, h, rank, fix)
        h = _heaviest_below(b, m, h)
    if used > 0:
        outcome = b.outcome[heaviest(b, m.modes, likeliest)]
        fix.used = outcome.n_used
        if outcome.n_used > 0:
            fix.nis = outcome.nis_sum
    fix.fix_kind = kind_of_message(b.received, fix.used)
    # of the place: the root of half the trace of its covariance
    fix.fix_sigma = math.sqrt(0.5 * (fix.full_sigma[0] ** 2 + fix.full_sigma[1] ** 2))
    for i in range(2):
        fix.fix_position[i] = fix.full_state[i]
