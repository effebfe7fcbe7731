"""Turns add to the variances of compasses' biases: 3 % of the angle, squared."""

import numpy as np
import pytest

from laisn.settings import Assume, TightSettings
from laisn.tight.estimator import inflate_bias_covariance
from laisn.tight.model import COMPASS_BIAS, model_of, new_belief
from laisn.tight.motion import preintegrate, reset_preintegration
from laisn.tight.ranging import new_range_message
from tests.laisn.tight.mission import DT

DEVIATING = TightSettings(assume=Assume(exact_leader=False, deviation=True))


def gained_variances(headings: dict[float, float], interval: float) -> tuple[float, float]:
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
        if k % round(interval / DT) == 0:
            inflate_bias_covariance(belief, model, range_message)
            reset_preintegration(belief)
            belief.motion.elapsed = 0.0
    gained = belief.covariance[0].diagonal() - before
    return float(gained[COMPASS_BIAS]), float(gained[model.leader_bias])


@pytest.mark.parametrize("interval", [0.5, 1.0, 5.0, 20.0])
def test_a_turn_counts_as_a_whole_however_many_messages_it_takes(interval: float) -> None:
    """3 % of 1.2 rad, of a turn that takes 7 s."""
    gained = gained_variances({0.0: 0.3, 22.0: 0.3, 29.0: 1.5, 60.0: 1.5}, interval)
    assert gained == pytest.approx((0.036**2, 0.036**2), rel=1e-6)


def test_the_start_of_a_turn_is_uncertain_by_the_smallest_angle_that_counts() -> None:
    """Whenever a turn begins, it counts as its whole, or as less by the 0.1 rad or 0.15 rad that
    are no turn yet.
    """
    for start in np.arange(15.0, 27.0):
        gained = gained_variances({0.0: 0.3, start: 0.3, start + 9.0: 1.5, 60.0: 1.5}, 1.0)
        for variance, min_turn in zip(gained, (0.1, 0.15), strict=True):
            assert (
                (0.03 * (1.2 - min_turn)) ** 2 * (1.0 - 1e-9) <= variance <= 0.036**2 * (1.0 + 1e-9)
            )


def test_a_heading_that_is_kept_for_ten_seconds_is_where_the_next_turn_begins() -> None:
    of_two_turns = gained_variances({0.0: 0.0, 5.0: 0.0, 6.0: 0.6, 25.0: 0.6, 26.0: 1.2}, 1.0)
    assert of_two_turns == pytest.approx((2 * 0.018**2, 2 * 0.018**2), rel=1e-6)
    of_one_turn = gained_variances({0.0: 0.0, 5.0: 0.0, 6.0: 0.6, 12.0: 0.6, 13.0: 1.2}, 1.0)
    assert of_one_turn == pytest.approx((0.036**2, 0.036**2), rel=1e-6)


def test_angles_as_small_as_errors_of_readings_are_no_turn() -> None:
    assert gained_variances({0.0: 0.0, 5.0: 0.0, 6.0: 0.12}, 1.0) == pytest.approx(
        (0.0036**2, 0.0), rel=1e-6, abs=1e-12
    )
    assert gained_variances({0.0: 0.0, 5.0: 0.0, 6.0: 0.09}, 1.0) == pytest.approx(
        (0.0, 0.0), abs=1e-12
    )
