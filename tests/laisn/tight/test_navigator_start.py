"""Starts that are unknown, and beliefs that are lost, of the tightly coupled navigator."""

from dataclasses import replace

import numpy as np
import pytest

from laisn.settings import Assume, TightSettings
from laisn.tight.navigator import TightNavigator, run_mission
from tests.laisn.passages import passage
from tests.laisn.tight.mission import EVERYTHING, Mission


@pytest.mark.parametrize("everything", [False, True])
def test_three_transmitters_find_an_unknown_start(everything: bool) -> None:
    """The first message gives the position, with the errors of its ranges and of the leader's
    compass.
    """
    mission = Mission(steps=600)
    setting = TightSettings(assume=EVERYTHING if everything else Assume())
    normalised = []
    for seed in range(20):
        measurements = mission.measured(
            np.random.default_rng(seed), log=0.2, compass=0.1, scale=0.1
        )
        result = TightNavigator(setting, None).run(measurements)
        assert np.all(np.isnan(result.state[:9]))
        assert np.all(np.isfinite(result.covariance[9:]))
        error = result.state[9:, :2] - mission.follower[10:]
        covariance = result.covariance[9:, :2, :2]
        normalised.append(
            np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
        )
        with_start = TightNavigator(setting, mission.start).run(measurements)
        assert np.hypot(*(result.state[-1, :2] - with_start.state[-1, :2])) < (
            3.0 if everything else 0.3
        )
    assert np.mean(normalised) < 3.0


def test_two_transmitters_leave_both_sides_of_an_unknown_start_open_until_motion_decides() -> None:
    mission = Mission(steps=3000)
    setting = TightSettings(transmitters=2, heading_bias_sigma=0.02)
    result = TightNavigator(setting, None).run(mission.measured(np.random.default_rng(1)))
    offset_from_truth = result.hypothesis[0, :2] - mission.follower[10]
    from_leader = mission.follower[10] - mission.leader[10]
    theta = mission.leader_heading[10]
    port = np.array([-np.cos(theta), np.sin(theta)])
    image = -2.0 * (from_leader @ port) * port
    assert result.weight[0, :2] == pytest.approx([0.5, 0.5], abs=0.01)
    nearest = sorted(
        np.hypot(
            *(offset_from_truth - np.array([[0.0, 0.0], image])[:, None]).transpose(2, 0, 1)
        ).min(axis=1)
    )
    assert nearest[1] < 1.0
    assert np.hypot(*(result.state[-1, :2] - mission.follower[-1])) < 1.0
    assert result.weight[-1, 0] > 0.99


def test_a_single_range_does_not_begin_a_belief() -> None:
    mission = Mission(steps=40)
    whole = mission.measured()
    ranges = whole.ranges.copy()
    ranges[:2, 1:] = np.nan
    result = TightNavigator(TightSettings(), None).run(replace(whole, ranges=ranges))
    assert np.all(np.isnan(result.state[:29]))
    assert np.hypot(*(result.state[29, :2] - mission.follower[30])) < 0.5
    assert result.weight[:2].max() == 0.0


@pytest.mark.parametrize("shift", [0.0, 300.0])
@pytest.mark.parametrize("transmitters", [2, 3])
def test_an_unknown_start_is_found_among_beacons_for_any_leader_position(
    transmitters: int, shift: float
) -> None:
    """Exact ranges of beacons 200 m apart: one position at once, or with two of them both sides
    until motion tells them apart.
    """
    measured, true_position = passage(None)
    message = measured.message.copy()
    message[:, 1:3] = shift
    settings = TightSettings(dt=0.5, transmitters=transmitters)
    result = TightNavigator(settings, None).run(replace(measured, message=message))
    count = 2 if transmitters == 2 else 1
    error, covariance = (
        result.hypothesis[0, :count] - true_position[4],
        result.hypothesis_covariance[0, :count],
    )
    assert (
        np.einsum("hi,hi->h", error, np.linalg.solve(covariance, error[..., None])[..., 0]).min()
        < 9.0
    )
    assert np.count_nonzero(result.weight[0] > 0.01) == count
    assert np.hypot(*(result.state[50:, :2] - true_position[51:]).T).max() < 0.1
    assert result.weight[-1, 0] > 0.999


@pytest.mark.parametrize("seed", range(5))
def test_a_belief_far_from_the_truth_returns_to_it(seed: int) -> None:
    """A start that is wrong by hundreds of standard deviations, and as sure of itself as a true
    one.
    """
    mission = Mission(steps=2000)
    measurements = mission.measured(np.random.default_rng(seed))
    wrong = mission.start + np.array([8.0, -5.0, 0.0, 0.0])
    state, covariance, _ = run_mission(TightSettings(), measurements, wrong)
    error = state[1000:, :2] - mission.follower[1001:]
    assert np.hypot(*error.T).max() < 2.0
    assert covariance[1000:, [0, 2]].max() < 1.0
