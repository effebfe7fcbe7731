"""Scores of LAISN-Bench against errors that are known in advance."""

import math
from pathlib import Path

import numpy as np
import pytest

from experiments.benchmark import score as benchmark_score
from experiments.benchmark.score import (
    SEGMENTS_M,
    FollowerRun,
    Track,
    overall_score,
    score_all,
    score_mission,
    score_run,
)
from experiments.benchmark.tables import Truth
from laisn.arrays import Floats

RUN = FollowerRun("astern", 1, "follower")
STEPS = 2000
DT = 0.1


def straight_truth() -> Truth:
    """A follower that goes east at 1 m/s, 20 m south of its leader; the bound is 0.5 m."""
    time = DT * np.arange(1, STEPS + 1)
    position = np.column_stack([time, np.zeros(STEPS)])
    return Truth(time, position, position + np.array([0.0, 20.0]), np.full(STEPS, 0.5))


def offset_track(offset: Floats, covariance: tuple[float, float, float], stride: int = 1) -> Track:
    """Estimates at every so many steps that are off by a constant [m], with a constant covariance
    (xx, xy, yy) [m²].
    """
    truth = straight_truth()
    rows = slice(stride - 1, None, stride)
    position = (truth.position + offset)[rows]
    return Track(truth.time[rows], position, np.tile(covariance, (len(position), 1)))


def test_a_constant_error_has_the_scores_of_plane_geometry() -> None:
    score = score_run(RUN, straight_truth(), offset_track(np.array([3.0, 4.0]), (4.0, 0.0, 2.0)))
    assert score.covered == 1.0
    assert (score.mean_m, score.rms_m, score.largest_m) == pytest.approx((5.0, 5.0, 5.0))
    assert score.nees == pytest.approx(3.0**2 / 4.0 + 4.0**2 / 2.0)
    # seen from the leader, the follower lies south, and the estimate 3 m east of 16 m south
    assert score.bearing_deg == pytest.approx(math.degrees(math.atan2(3.0, 16.0)))
    assert score.relative_m == pytest.approx([0.0] * len(SEGMENTS_M), abs=1e-9)
    assert score.bound_m == pytest.approx(0.5)


def test_an_error_that_grows_is_a_relative_error() -> None:
    """An error of 1 % of the distance gone is 1 % of each segment; the last segments end with the
    run, and are a little shorter.
    """
    truth = straight_truth()
    position = truth.position * [1.01, 1.0]
    score = score_run(RUN, truth, Track(truth.time, position, np.full((STEPS, 3), np.nan)))
    assert score.relative_m == pytest.approx([0.01 * length for length in SEGMENTS_M], rel=0.01)
    assert math.isnan(score.nees)


def test_estimates_at_other_times_are_interpolated() -> None:
    """On a straight path, what lies between two estimates is on the line between them."""
    score = score_run(
        RUN, straight_truth(), offset_track(np.array([3.0, 4.0]), (1.0, 0.0, 1.0), 10)
    )
    assert score.largest_m == pytest.approx(5.0)
    assert score.nees == pytest.approx(25.0)
    # the first of them is at the tenth step
    assert score.covered == pytest.approx((STEPS - 9) / STEPS)


def test_a_long_gap_is_not_covered() -> None:
    whole = offset_track(np.zeros(2), (1.0, 0.0, 1.0))
    outside_gap = (whole.time < 50.05) | (whole.time > 70.05)
    with_gap = Track(
        whole.time[outside_gap], whole.position[outside_gap], whole.covariance[outside_gap]
    )
    score = score_run(RUN, straight_truth(), with_gap)
    # 20 s are 200 steps
    assert score.covered == pytest.approx(1.0 - 200 / STEPS)
    assert not score.complete
    mission = score_mission("astern", [score])
    assert mission.incomplete == 1
    assert math.isnan(overall_score([mission]))


def test_no_estimate_covers_nothing() -> None:
    score = score_run(RUN, straight_truth(), offset_track(np.full(2, np.nan), (1.0, 0.0, 1.0)))
    assert score.covered == 0.0
    assert math.isnan(score.mean_m)


def test_a_run_without_estimates_is_among_the_scores_and_covers_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    other = FollowerRun("drift", 1, "follower")
    monkeypatch.setattr(benchmark_score, "truth_of", lambda _, run: straight_truth())
    tracks = [(RUN, offset_track(np.zeros(2), (1.0, 0.0, 1.0)))]
    scores = score_all(tmp_path, tracks, [other, RUN])
    assert [score.run for score in scores] == [other, RUN]
    assert [score.covered for score in scores] == [0.0, 1.0]
    assert math.isnan(scores[0].mean_m)


def test_the_score_is_the_geometric_mean_of_ratios_to_the_bound() -> None:
    scores = [
        score_mission(
            name,
            [score_run(RUN, straight_truth(), offset_track(np.array([error_m, 0.0]), (1, 0, 1)))],
        )
        for name, error_m in (("astern", 1.0), ("drift", 4.0))
    ]
    # 1 m and 4 m over 0.5 m: the root of 2 · 8
    assert [score.times_bound for score in scores] == pytest.approx([2.0, 8.0])
    assert overall_score(scores) == pytest.approx(4.0)


def test_missions_that_do_not_count_are_left_out_of_the_score() -> None:
    scores = [
        score_mission(
            name,
            [score_run(RUN, straight_truth(), offset_track(np.array([error_m, 0.0]), (1, 0, 1)))],
        )
        for name, error_m in (("astern", 1.0), ("drift", 4.0), ("bottom-lock", 100.0))
    ]
    assert overall_score(scores) == pytest.approx(4.0)
    # where none counts, all do: 100 m over 0.5 m
    assert overall_score(scores[2:]) == pytest.approx(200.0)
