"""Plaza 1 and 2: what the navigator among beacons reaches on ranges that were really measured."""

from functools import cache

import numpy as np
import pytest

from experiments.real_ranges import study
from experiments.real_ranges.navigating import Score, among_beacons, score
from experiments.real_ranges.settings import Beacons, beacons_of
from laisn.beacons.settings import MEDIA
from laisn.estimates import Estimates
from laisn.failure import LaisnError
from laisn.messages import Measurements


@cache
def scores(name: str) -> dict[str, dict[tuple[str, ...], Score]]:
    return study.scores(name, ("tight", "unknown-start"))


@pytest.mark.parametrize("name", study.SETS)
def test_two_beacons_at_a_time_hold_the_robot_within_decimetres(name: str) -> None:
    pairs = np.array([s for beacons, s in scores(name)["tight"].items() if len(beacons) == 2])
    assert len(pairs) == 6
    mean, _, high, nees = pairs.T
    assert np.median(mean) <= 0.40
    assert mean.max() <= 0.50
    assert high.max() <= 1.0
    assert nees.min() > 0.9
    assert nees.max() < 3.5


@pytest.mark.parametrize("name", study.SETS)
def test_all_beacons_hold_it_closer(name: str) -> None:
    (found,) = (s for beacons, s in scores(name)["tight"].items() if len(beacons) == 4)
    assert found.mean <= 0.28
    assert found.high <= 0.7
    assert 1.0 < found.nees < 3.5


@pytest.mark.parametrize("name", study.SETS)
def test_an_unknown_start_costs_nothing_after_a_minute(name: str) -> None:
    each = scores(name)["unknown-start"]
    pairs = [s.mean for beacons, s in each.items() if len(beacons) == 2]
    assert np.median(pairs) <= 0.45
    assert max(pairs) <= 0.50


def test_the_medium_is_found() -> None:
    _, recorded = next(study.recordings("Plaza2"))
    assert among_beacons(recorded, Beacons())[1] == "air"


def test_errors_are_those_at_the_times_of_the_survey() -> None:
    """A vehicle that goes 1 m/s east, estimated 0.3 m ahead and 0.4 m aside with σ = 0.5 m: off 0.5 m, NEES 1."""
    n = 10
    time = np.arange(1.0, n + 1)
    measured = Measurements(
        dt=1.0, speed=np.ones(n), heading=np.full(n, np.pi / 2), depth=np.zeros(n),
        message_step=np.array([5]), message=np.zeros((1, 9)), ranges=np.ones((1, 3)),
    )  # fmt: skip
    state = np.column_stack([time + 0.3, np.full(n, 0.4), np.ones(n), np.zeros(n)])
    state[:3] = np.nan
    estimates = Estimates(
        state=state, covariance=np.tile(0.25 * np.eye(4), (n, 1, 1)), fix_step=np.array([5]),
        fix_position=np.zeros((1, 2)), fix_sigma=np.zeros(1), fix_kind=np.array([7]), innovation=np.zeros((1, 2)),
        innovation_covariance=np.zeros((1, 2, 2)),
    )  # fmt: skip
    survey = np.arange(0.5, 12.0, 1.0)
    truth = np.column_stack([survey, survey, np.zeros(survey.size)])
    assert tuple(score(estimates, measured, truth)) == pytest.approx((0.5, 0.5, 0.5, 1.0))
    truth[truth[:, 0] < 6.0, 2] = 50.0
    assert score(estimates, measured, truth, since_s=6.0).mean == pytest.approx(0.5)
    assert np.isnan(score(estimates, measured, truth[:1]).mean)


def test_settings_follow_the_medium_but_for_what_is_given() -> None:
    told = beacons_of({"medium": "water", "heading_sigma_deg": 2, "gyro_bias_sigma_deg_s": 0.1, "slip_m_sqrt_s": 0.3})
    made = told.over(MEDIA["water"])
    assert made.heading_sigma == pytest.approx(np.deg2rad(2))
    assert made.gyro_bias_sigma == pytest.approx(np.deg2rad(0.1))
    assert made.slip == 0.3
    assert made.range_scale_sigma == MEDIA["water"].range_scale_sigma
    with pytest.raises(LaisnError) as caught:
        beacons_of({"outlier_chance": 1.0, "start_sigma_m": 0})
    assert "beacons.outlier_chance: Input should be less than 1" in str(caught.value)
    assert "beacons.start_sigma_m: Input should be greater than 0" in str(caught.value)
