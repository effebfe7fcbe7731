"""What turns may have changed of compasses' biases."""

import numpy as np
import pytest

from laisn.settings import Assume, TightSettings
from laisn.tight.estimator import inflate_bias_covariance
from laisn.tight.model import COMPASS_BIAS, model_of, new_belief
from laisn.tight.motion import preintegrate, reset_preintegration
from laisn.tight.ranging import new_range_message
from tests.laisn.tight.mission import DT

DEVIATING = TightSettings(assume=Assume(exact_leader=False, deviation=True))


def variances(headings: dict[float, float], every: float) -> tuple[float, float]:
    """Variances that a compass and its leader's have gained in a minute with messages at an
    interval.

    Both vehicles head where `headings` has it, by time [s], straight lines between.
    """
    model, range_message = model_of(DEVIATING), new_range_message()
    belief = new_belief(DEVIATING, model, (0.0, 0.0))
    before = belief.covariance[0].diagonal().copy()
    for k in range(1, round(60.0 / DT) + 1):
        range_message.heading = np.interp(DT * k, list(headings), list(headings.values()))
        preintegrate(belief, model, 1.0, range_message.heading, DT)
        if k % round(every / DT) == 0:
            inflate_bias_covariance(belief, model, range_message)
            reset_preintegration(belief)
            belief.motion.elapsed = 0.0
    gained = belief.covariance[0].diagonal() - before
    return float(gained[COMPASS_BIAS]), float(gained[model.leader_bias])


@pytest.mark.parametrize("every", [0.5, 1.0, 5.0, 20.0])
def test_a_turn_counts_as_a_whole_however_many_messages_it_takes(every: float) -> None:
    """3 % of 1.2 rad, of a turn that takes 7 s."""
    gained = variances({0.0: 0.3, 22.0: 0.3, 29.0: 1.5, 60.0: 1.5}, every)
    assert gained == pytest.approx((0.036**2, 0.036**2), rel=1e-6)


def test_where_a_turn_began_is_known_to_the_angle_that_is_none() -> None:
    """Whenever a turn begins, it counts as its whole, or as less by the 0.1 rad or 0.15 rad that
    are no turn yet.
    """
    for begin in np.arange(15.0, 27.0):
        gained = variances({0.0: 0.3, begin: 0.3, begin + 9.0: 1.5, 60.0: 1.5}, 1.0)
        for value, least in zip(gained, (0.1, 0.15), strict=True):
            assert (0.03 * (1.2 - least)) ** 2 * (1.0 - 1e-9) <= value <= 0.036**2 * (1.0 + 1e-9)


def test_a_heading_that_is_kept_for_ten_seconds_is_where_the_next_turn_begins() -> None:
    apart = variances({0.0: 0.0, 5.0: 0.0, 6.0: 0.6, 25.0: 0.6, 26.0: 1.2}, 1.0)
    assert apart == pytest.approx((2 * 0.018**2, 2 * 0.018**2), rel=1e-6)
    together = variances({0.0: 0.0, 5.0: 0.0, 6.0: 0.6, 12.0: 0.6, 13.0: 1.2}, 1.0)
    assert together == pytest.approx((0.036**2, 0.036**2), rel=1e-6)


def test_what_readings_may_err_by_is_no_turn() -> None:
    assert variances({0.0: 0.0, 5.0: 0.0, 6.0: 0.12}, 1.0) == pytest.approx(
        (0.0036**2, 0.0), rel=1e-6, abs=1e-12
    )
    assert variances({0.0: 0.0, 5.0: 0.0, 6.0: 0.09}, 1.0) == pytest.approx((0.0, 0.0), abs=1e-12)
