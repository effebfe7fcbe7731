"""Plaza 1 and 2: what the navigator among beacons reaches on ranges that were really measured."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest

from experiments.beacon_replay import (
    BeaconReplaySettings,
    Score,
    beacon_settings,
    navigate_among_beacons,
    score,
)
from laisn.beacons import MEDIA, BeaconSettings
from laisn.errors import LaisnError
from laisn.estimates import Estimates
from laisn.messages import Measurements
from tools.documents import markers
from tools.documents import real_ranges as study


@cache
def recorded_figures() -> dict[str, float]:
    return {
        name: float(finding.value or 0.0)
        for name, finding in markers.records()["real-ranges"].findings.items()
    }


@pytest.mark.parametrize("name", study.SETS)
def test_two_beacons_at_a_time_hold_the_robot_within_decimetres(name: str) -> None:
    figures = recorded_figures()
    assert figures[f"pairs tight {name}"] <= 0.40
    assert figures[f"worst-pair tight {name}"] <= 0.50
    assert figures[f"high tight {name}"] <= 1.0
    assert figures[f"nees-least tight {name}"] > 0.9
    assert figures[f"nees-most tight {name}"] < 3.5


@pytest.mark.parametrize("name", study.SETS)
def test_all_beacons_hold_the_robot_closer(name: str) -> None:
    figures = recorded_figures()
    assert figures[f"all tight {name}"] <= 0.28
    assert figures[f"all-high tight {name}"] <= 0.7
    assert 1.0 < figures[f"all-nees tight {name}"] < 3.5


@pytest.mark.parametrize("name", study.SETS)
def test_an_unknown_start_costs_nothing_after_a_minute(name: str) -> None:
    figures = recorded_figures()
    assert figures[f"pairs unknown-start {name}"] <= 0.45
    assert figures[f"worst-pair unknown-start {name}"] <= 0.50


@pytest.mark.system
def test_the_record_is_what_the_navigators_reach_now() -> None:
    """For the data set with fewer ranges and two navigators, as all of them take half a minute."""
    fresh = study.findings_of("Plaza2", study.scores("Plaza2", ("tight", "unknown-start")))
    assert len(fresh) == 16
    for name, finding in fresh.items():
        assert finding.value == pytest.approx(recorded_figures()[name], rel=0.03), (
            f"{name}: run make studies"
        )


def test_the_medium_of_a_recording_is_found() -> None:
    _, recording = next(study.recordings("Plaza2"))
    assert navigate_among_beacons(recording, BeaconReplaySettings())[1] == "air"


def test_errors_are_those_at_the_times_of_the_survey() -> None:
    """A vehicle that goes 1 m/s east, estimated 0.3 m ahead and 0.4 m aside with σ = 0.5 m: off
    0.5 m, NEES 1.
    """
    n = 10
    time = np.arange(1.0, n + 1)
    measured = Measurements(
        dt=1.0,
        speed=np.ones(n),
        heading=np.full(n, np.pi / 2),
        depth=np.zeros(n),
        message_step=np.array([5]),
        message=np.zeros((1, 10)),
        ranges=np.ones((1, 3)),
    )
    state = np.column_stack([time + 0.3, np.full(n, 0.4), np.ones(n), np.zeros(n)])
    state[:3] = np.nan
    estimates = Estimates(
        state=state,
        covariance=np.tile(0.25 * np.eye(4), (n, 1, 1)),
        fix_step=np.array([5]),
        fix_position=np.zeros((1, 2)),
        fix_sigma=np.zeros(1),
        fix_kind=np.array([7]),
        innovation=np.zeros((1, 2)),
        innovation_covariance=np.zeros((1, 2, 2)),
    )
    survey = np.arange(0.5, 12.0, 1.0)
    truth = np.column_stack([survey, survey, np.zeros(survey.size)])
    assert tuple(score(estimates, measured, truth)) == pytest.approx((0.5, 0.5, 0.5, 1.0))
    truth[truth[:, 0] < 6.0, 2] = 50.0
    assert score(estimates, measured, truth, since_s=6.0).mean == pytest.approx(0.5)
    assert np.isnan(score(estimates, measured, truth[:1]).mean)


def test_settings_are_those_of_the_medium_except_what_users_set() -> None:
    user_settings = beacon_settings(
        {
            "medium": "water",
            "heading_sigma_deg": 2,
            "gyro_bias_sigma_deg_s": 0.1,
            "slip_m_sqrt_s": 0.3,
        }
    )
    settings = user_settings.over(MEDIA["water"])
    assert settings.heading_sigma == pytest.approx(np.deg2rad(2))
    assert settings.gyro_bias_sigma == pytest.approx(np.deg2rad(0.1))
    assert settings.slip == 0.3
    assert settings.range_scale_sigma == MEDIA["water"].range_scale_sigma
    with pytest.raises(LaisnError) as caught:
        beacon_settings({"outlier_probability": 1.0, "start_sigma_m": 0})
    assert "beacons.outlier_probability: Input should be less than 1" in str(caught.value)
    assert "beacons.start_sigma_m: Input should be greater than 0" in str(caught.value)


def test_variants_among_beacons_lack_the_states_that_they_name() -> None:
    defaults = BeaconSettings()
    for name, replaced_settings in (
        ("steady-gyro", {"gyro_bias_sigma": 0.0}),
        ("exact-speed", {"speed_scale_sigma": 0.0}),
        ("exact-beacons", {"survey_sigma": 0.0, "range_offset_sigma": 0.0}),
        ("known-scale", {"range_scale_sigma": 0.003}),
        ("unknown-start", {"known_start": False}),
        ("tight", {}),
    ):
        assert study.BEACON_SETTINGS[name].over(defaults) == replace(
            defaults, **{"known_start": True} | replaced_settings
        )
    assert {
        settings.medium
        for name, settings in study.BEACON_SETTINGS.items()
        if name not in ("tight", "unknown-start")
    } == {"air"}
    assert len(study.BEACON_SETTINGS) == 6


def test_the_record_has_median_and_worst_of_pairs_and_the_score_of_all_beacons() -> None:
    """Six pairs whose errors are 1 to 6 m, 95 % of them within twice as much, NEES half as much;
    all four 0.5 m.
    """
    pairs = list(combinations("1234", 2))
    scores_of_pairs = {
        pair: Score(float(k), 1.5 * k, 2.0 * k, 0.5 * k)
        for k, pair in zip((3, 6, 1, 5, 2, 4), pairs, strict=True)
    }
    findings = study.findings_of(
        "Plaza1", {"tight": scores_of_pairs | {tuple("1234"): Score(0.5, 0.6, 0.7, 0.8)}}
    )
    assert {
        key.removesuffix(" tight Plaza1"): finding.value for key, finding in findings.items()
    } == {
        "pairs": 3.5,
        "worst-pair": 6.0,
        "high": 12.0,
        "nees-least": 0.5,
        "nees-most": 3.0,
        "all": 0.5,
        "all-high": 0.7,
        "all-nees": 0.8,
    }


def test_range_errors_are_reported_as_scale_and_residual(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every range 3 % too long, and in turns 0.5 m too long and too short; the robot drives 1
    m/s east.
    """
    time = np.arange(0.0, 100.0)
    truth = np.column_stack([time, time, np.zeros(100), np.zeros(100)])
    data = study.read_data_set(study.DATA / "Plaza1.mat")
    positions, beacon = np.array([[0.0, 3000.0], [50.0, -4000.0]]), np.arange(90) % 2
    range_time = np.arange(90) + 0.5
    true_ranges = np.hypot(range_time - positions[beacon, 0], positions[beacon, 1])
    residual = np.where(np.arange(90) // 2 % 2, 0.5, -0.5)
    altered = replace(
        data,
        truth=truth[:, : data.truth.shape[1]],
        places=positions,
        range_time=range_time,
        range_beacon=beacon,
        ranges=1.03 * true_ranges + residual,
    )
    monkeypatch.setattr(study, "read_data_set", lambda _: altered)
    findings = study.ranges_of("Plaza1")
    assert findings["ranges Plaza1"].value == 90
    assert findings["scale Plaza1"].value == pytest.approx(0.03, abs=1e-5)
    assert findings["sigma Plaza1"].value == pytest.approx(0.5, rel=1e-3)


def test_errors_have_a_mean_a_root_mean_square_and_a_95th_percentile() -> None:
    n = 101
    measured = Measurements(
        dt=1.0,
        speed=np.ones(n),
        heading=np.zeros(n),
        depth=np.zeros(n),
        message_step=np.array([5]),
        message=np.zeros((1, 10)),
        ranges=np.ones((1, 3)),
    )
    errors = np.linspace(0.0, 10.0, n)
    state = np.zeros((n, 4))
    state[:, 0] = errors
    covariance = np.tile(np.diag([4.0, 1.0, 1.0, 1.0]), (n, 1, 1))
    estimates = Estimates(
        state=state,
        covariance=covariance,
        fix_step=np.array([5]),
        fix_position=np.zeros((1, 2)),
        fix_sigma=np.zeros(1),
        fix_kind=np.array([7]),
        innovation=np.zeros((1, 2)),
        innovation_covariance=np.zeros((1, 2, 2)),
    )
    truth = np.column_stack([measured.time, np.zeros((n, 2))])
    # n errors evenly from 0 to a have the mean a/2 and the root mean square
    # a √((2 n − 1) / (6 (n − 1)))
    mean_square = 100.0 * (2 * n - 1) / (6 * (n - 1))
    assert tuple(score(estimates, measured, truth)) == pytest.approx(
        (5.0, np.sqrt(mean_square), 9.5, mean_square / 4.0)
    )
