"""The leader's heading on a straight leg: mean of the readings, arms turned with it, and what
b_L, the bias of the leader's compass, gains by it.
"""

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.settings import Assume, TightSettings
from laisn.tight.estimator import inflate_bias_covariance, prune_and_merge, update_leader_variance
from laisn.tight.model import GaussianMixture, Model, model_of, new_belief
from laisn.tight.motion import average_leader_heading
from laisn.tight.ranging import RangeMessage, new_range_message

SETTINGS = TightSettings(assume=Assume(exact_leader=False))
ERRORS = np.deg2rad([0.5, -1.2, 2.0, 0.3, -0.8, 1.5, 0.1, -0.4, 0.9, -1.1])
"""Of the heading that the leader broadcasts, one a message [rad]."""
COURSE = 0.7
"""Direction in which the leader goes, clockwise from north [rad]."""
ARMS = np.array([[-0.9, -0.4, 1.5], [0.9, 0.4, 2.0], [-0.04, 0.1, 1.7]])
"""Transmitters from the leader: east, north, and depth below the hydrophone [m]."""


def make_belief(bias_sigma: float = 0.1) -> tuple[GaussianMixture, Model]:
    """A belief in which the leader's compass bias b_L has this standard deviation [rad]."""
    model = model_of(SETTINGS)
    belief = new_belief(SETTINGS, model, (0.0, 0.0))
    belief.covariance[0, model.leader_bias, model.leader_bias] = bias_sigma**2
    return belief, model


def leader_message(
    number: int, heading: float, course: float = COURSE, way_per_message: float = 1.0
) -> RangeMessage:
    """Message of this number from a leader that goes straight on from the origin, by
    `way_per_message` [m].
    """
    range_message = new_range_message()
    range_message.east, range_message.north = (
        way_per_message * number * np.sin(course),
        way_per_message * number * np.cos(course),
    )
    range_message.heading, range_message.arms = heading, ARMS
    return range_message


def clockwise(points: Floats, angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, -s], [s, c]]))


def scatter(*legs: Floats) -> float:
    """Variance of readings about the means of their legs, and of one reading as large as the
    settings say.
    """
    prior = SETTINGS.leader_heading_sigma**2
    within = sum(float(np.sum((leg - leg.mean()) ** 2)) for leg in legs)
    return min(prior, (prior + within) / (1 + sum(leg.size - 1 for leg in legs)))


def test_the_heading_of_a_leg_is_the_mean_of_its_readings_and_b_l_goes_with_it() -> None:
    belief, model = make_belief()
    used_heading, bias = [], []
    for step, error in enumerate(ERRORS):
        range_message = leader_message(step, COURSE + error)
        average_leader_heading(belief, model, range_message)
        inflate_bias_covariance(belief, model, range_message)
        used_heading.append(float(range_message.heading))
        bias.append(float(belief.state[0, model.leader_bias]))
        np.testing.assert_allclose(
            range_message.arms[:, :2],
            clockwise(ARMS[:, :2], used_heading[-1] - COURSE - error),
            atol=1e-12,
        )
        np.testing.assert_array_equal(range_message.arms[:, 2], ARMS[:, 2])
    # a direction needs two messages and a straight way three; b_L is wide here, so that the mean is
    # used at once
    assert used_heading[:2] == pytest.approx(COURSE + ERRORS[:2])
    means = [COURSE + ERRORS[2 : n + 1].mean() for n in range(2, ERRORS.size)]
    assert used_heading[2:] == pytest.approx(means, abs=1e-12)
    # heading less b_L is the true heading, whatever replaces the broadcast one
    np.testing.assert_allclose(np.diff(bias[2:]), np.diff(means), atol=1e-12)
    # b_L gains the first reading's random error, and no more
    added_variance = belief.covariance[0, model.leader_bias, model.leader_bias] - 0.1**2
    assert added_variance == pytest.approx(SETTINGS.leader_heading_sigma**2, rel=1e-9)


def test_a_mean_of_few_readings_is_not_used_where_b_l_is_known_better() -> None:
    belief, model = make_belief(bias_sigma=1e-3)
    used_heading = []
    for step, error in enumerate(ERRORS):
        range_message = leader_message(step, COURSE + error)
        average_leader_heading(belief, model, range_message)
        used_heading.append(float(range_message.heading))
    assert used_heading[:5] == pytest.approx(COURSE + ERRORS[:5])
    assert used_heading[5] == pytest.approx(COURSE + ERRORS[2:6].mean(), abs=1e-12)


@pytest.mark.parametrize(
    ("heading", "course", "way_per_message"),
    [
        (COURSE + 0.02, COURSE + 0.1, 1.0),  # the way bends
        (COURSE + 0.3, COURSE, 1.0),  # the heading is another one
        (COURSE + 0.02, COURSE, 0.01),  # it stops
    ],
)
def test_a_leg_ends_where_the_leader_turns_and_b_l_loses_the_means_error(
    heading: float, course: float, way_per_message: float
) -> None:
    belief, model = make_belief()
    for step, error in enumerate(ERRORS):
        average_leader_heading(belief, model, leader_message(step, COURSE + error))
    last = leader_message(ERRORS.size - 1, 0.0)
    after_leg = leader_message(1, heading, course, way_per_message)
    after_leg.east += last.east
    after_leg.north += last.north
    average_leader_heading(belief, model, after_leg)
    assert float(after_leg.heading) == heading
    np.testing.assert_array_equal(after_leg.arms, ARMS)
    assert float(after_leg.shift) == 0.0
    # variance of the mean of the eight readings of the leg, which scatter as they do
    assert float(after_leg.added_variance) == pytest.approx(scatter(ERRORS[2:]) / 8.0, rel=1e-12)


def test_hypotheses_in_one_place_that_differ_in_b_l_stay_two() -> None:
    for bias_difference, remaining in ((0.0, 1), (0.01, 1), (0.2, 2)):
        belief, model = make_belief()
        belief.n_hypotheses = 2
        belief.weight[:2] = 0.6, 0.4
        belief.state[1], belief.covariance[1] = belief.state[0], belief.covariance[0]
        belief.state[1, model.leader_bias] += bias_difference
        prune_and_merge(belief, model)
        assert belief.n_hypotheses == remaining


def test_compass_scatter_is_estimated_from_all_legs_and_limited_by_the_settings() -> None:
    belief, model = make_belief()
    for step, error in enumerate(0.1 * ERRORS):
        average_leader_heading(belief, model, leader_message(step, COURSE + error))
    assert belief.leader.scatter == pytest.approx(scatter(0.1 * ERRORS[2:]), rel=1e-9)
    corner = leader_message(ERRORS.size - 1, 0.0)
    for step, error in enumerate(0.2 * ERRORS):
        range_message = leader_message(step + 1, COURSE + 1.0 + error, COURSE + 1.0)
        range_message.east += corner.east
        range_message.north += corner.north
        average_leader_heading(belief, model, range_message)
    # the first message after the turn has no leg
    assert belief.leader.scatter == pytest.approx(
        scatter(0.1 * ERRORS[2:], 0.2 * ERRORS[1:]), rel=1e-9
    )
    scattered, _ = make_belief()
    for step, error in enumerate(2.0 * ERRORS):
        average_leader_heading(scattered, model, leader_message(step, COURSE + error))
    assert scattered.leader.scatter == SETTINGS.leader_heading_sigma**2
    # the estimate from ranges of the same errors cannot be larger
    scattered.leader.scatter = np.deg2rad(0.5) ** 2
    scattered.turn_excess[0] = 1.0
    update_leader_variance(scattered, model)
    assert float(scattered.leader_variance) == np.deg2rad(0.5) ** 2
