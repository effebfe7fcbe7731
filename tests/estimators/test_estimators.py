"""The comparison of estimators: errors that cases add to measurements, and runs by both navigators."""

import numpy as np
import pytest
from scipy import stats

from experiments.studies.estimators.cases import (
    CASES,
    DEVIATION,
    ECHO_CHANCE,
    LOSS_CHANCE,
    WRONG,
    Case,
    with_errors,
)
from experiments.studies.estimators.runs import compare, fly_both, mission
from laisn import lanes
from laisn.settings import NavigationSettings
from laisn.tight.mission import run_mission
from laisn.tight.settings import TightSettings
from sim.sensing.observation import measure

BY_NAME = {case.name: case for case in CASES}


def test_every_case_has_errors_that_change_its_measurements() -> None:
    truth, errors = mission("T7", 5.0)
    clean = measure(truth, errors, seed=1, run=0)
    for name in {name for case in (*CASES, *WRONG) for name in case.errors}:
        found = with_errors(clean, Case(name=name, errors=(name,)), 1, 0)
        changed = [a.tobytes() != b.tobytes() for a, b in (
            (found.ranges, clean.ranges), (found.speed, clean.speed), (found.heading, clean.heading)
        )]  # fmt: skip
        assert any(changed), name
    assert [case.has_bound for case in CASES] == [True, True, False, False, False, False, True]
    assert len({case.name for case in WRONG}) == len(WRONG) == 14


def test_ranges_are_late_echoes_or_lost_as_often_as_said() -> None:
    truth, errors = mission("T7", 1.0)
    case = Case(name="wrong", errors=("echoes", "losses", "late"))
    lost, echoes, total = 0, 0, 0
    for run in range(3):
        clean = measure(truth, errors, seed=1, run=run)
        dirty = with_errors(clean, case, 1, run)
        excess = dirty.ranges - clean.ranges - np.array([0.0, 0.01, 0.0])
        gone = np.isnan(excess).all(axis=1)
        assert np.array_equal(np.isnan(excess).any(axis=1), gone)
        heard = excess[~gone]
        longer = heard > 1e-9
        assert np.all((np.abs(heard) < 1e-9) | ((heard > 0.3 - 1e-9) & (heard < 4.8 + 1e-9)))
        lost, echoes, total = lost + int(gone.sum()), echoes + int(longer.sum()), total + gone.size
        assert np.array_equal(dirty.speed, clean.speed)
    # within five standard deviations of a binomial
    assert lost / total == pytest.approx(LOSS_CHANCE, abs=5 * np.sqrt(0.16 / total))
    assert echoes / (3 * (total - lost)) == pytest.approx(ECHO_CHANCE, abs=5 * np.sqrt(0.0475 / (3 * total)))


def test_a_clock_and_common_echoes_move_all_ranges_of_a_message_alike() -> None:
    truth, errors = mission("T7", 1.0)
    clean = measure(truth, errors, seed=1, run=0)
    late = with_errors(clean, Case(name="clock", errors=("clock",)), 1, 0).ranges - clean.ranges
    # 1500 m/s times 1 ms, and 1 ppm of the time
    expected = 1500.0 * (1e-3 + 1e-6 * clean.dt * clean.message_step)
    np.testing.assert_allclose(late, np.repeat(expected[:, None], 3, axis=1), rtol=0, atol=1e-9)
    excess, n = [], clean.message_step.size
    for run in range(3):
        clean = measure(truth, errors, seed=1, run=run)
        longer = with_errors(clean, Case(name="common", errors=("common",)), 1, run).ranges - clean.ranges
        np.testing.assert_allclose(longer, np.repeat(longer[:, :1], 3, axis=1), rtol=0, atol=1e-9)
        excess.append(longer[longer[:, 0] > 1e-9, 0])
    heard = np.concatenate(excess)
    assert heard.min() > 0.3 - 1e-9
    assert heard.max() < 4.8 + 1e-9
    assert heard.size / (3 * n) == pytest.approx(0.1, abs=5 * np.sqrt(0.09 / (3 * n)))


def test_drift_is_the_same_for_the_same_run_and_leaves_ranges_alone() -> None:
    truth, errors = mission("T7", 5.0)
    clean = measure(truth, errors, seed=1, run=0)
    case = Case(name="drifting", errors=("drift",))
    once, again, other = (with_errors(clean, case, 1, run) for run in (0, 0, 1))
    assert once.heading.tobytes() == again.heading.tobytes() != other.heading.tobytes()
    assert np.array_equal(once.ranges, clean.ranges)
    time = clean.dt * np.arange(1, clean.speed.size + 1)
    # the log, which is never negative, drifts by 0.1 m/s in 300 s, the compass by 3° in 400 s
    moving = (once.speed > 0.0) & (clean.speed > 0.0)
    for drift, amplitude, period, read in (
        (once.speed - clean.speed, 0.1, 300.0, moving),
        (once.heading - clean.heading, np.deg2rad(3.0), 400.0, np.ones(time.size, dtype=bool)),
    ):
        angle = 2 * np.pi * time[read] / period
        waves = np.column_stack([np.sin(angle), np.cos(angle)])
        weight, *_ = np.linalg.lstsq(waves, drift[read], rcond=None)
        assert np.linalg.norm(weight) == pytest.approx(amplitude, rel=1e-9)
        assert np.abs(waves @ weight - drift[read]).max() < 1e-9

    # each has a phase of its own
    log, compass = np.random.default_rng([1, 0]).uniform(0.0, 2.0 * np.pi, 2)
    assert (once.speed - clean.speed)[moving] == pytest.approx(0.1 * np.sin(2 * np.pi * time / 300.0 + log)[moving])
    expected = np.deg2rad(3.0) * np.sin(2 * np.pi * time / 400.0 + compass)
    assert once.heading - clean.heading == pytest.approx(expected, abs=1e-12)


def test_a_compass_deviates_as_a_sine_of_the_heading_whose_phase_has_nothing_to_do_with_drift() -> None:
    truth, errors = mission("T7", 5.0)
    clean = measure(truth, errors, seed=1, run=0)
    phases = []
    for run in range(200):
        off = with_errors(clean, Case(name="turned", errors=("deviation",)), 1, run).heading - clean.heading
        waves = np.column_stack([np.sin(clean.heading), np.cos(clean.heading)])
        weight, *_ = np.linalg.lstsq(waves, off, rcond=None)
        assert np.hypot(*weight) == pytest.approx(DEVIATION, rel=1e-6)
        phases.append(np.arctan2(weight[1], weight[0]))
    drifts = [np.random.default_rng([1, run]).uniform(0.0, 2.0 * np.pi, 2) for run in range(200)]
    # spread all around, and apart from either drift: a mean of 200 unit vectors has a length of 0.07
    for apart in (phases, *(np.array(phases) - np.array(drift) for drift in zip(*drifts, strict=True))):
        assert abs(np.mean(np.exp(1j * np.asarray(apart)))) < 0.25


@pytest.mark.parametrize("name", ["G1", "G6"])
def test_the_tightly_coupled_navigator_is_nearer_on_the_same_noise(name: str) -> None:
    found = compare(BY_NAME[name], "T7", 5.0, runs=2, seed=1)
    again = compare(BY_NAME[name], "T7", 5.0, runs=2, seed=1)
    assert np.mean(found["tight_means"]) < 0.5 * np.mean(found["laisn_means"])
    for who in ("tight_means", "laisn_means"):
        assert found[who].tolist() == again[who].tolist()
    assert (found["bound_rms"] is None) == (name != "G1")


def test_runs_are_scored_against_the_truth_as_covariances_have_them() -> None:
    """Two runs by both navigators, each figure once more by loops over the states of each run alone."""
    truth, errors = mission("T7", 5.0)
    settings = TightSettings()
    measured = [measure(truth, errors, seed=2, run=run) for run in range(2)]
    found = fly_both(truth, measured, settings, 50)
    summed = np.zeros(truth.speed.size)
    for i, given in enumerate(measured):
        states, spread, outcome = run_mission(settings, given, truth.start)
        off = states[:, :2] - truth.hydrophone
        matrix = spread[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        squares = np.einsum("ni,ni->n", off, np.linalg.solve(matrix, off[..., None])[..., 0])
        summed += squares
        distance = np.linalg.norm(off, axis=1)
        alone = lanes.run([given], truth.start, NavigationSettings()).state[:, :2, 0] - truth.hydrophone
        used = outcome[np.isfinite(outcome.squared)]
        expected = {
            "laisn_means": np.linalg.norm(alone, axis=1).sum() / len(alone),
            "laisn_squares": np.sum(alone * alone) / len(alone),
            "tight_means": distance.sum() / distance.size,
            "tight_squares": (distance @ distance) / distance.size,
            "largest": max(distance),
            "normalised": squares.sum() / squares.size,
            "residuals": sum(used.squared) / sum(used.used),
        }
        assert {name: found[name][i] for name in expected} == pytest.approx(expected, rel=1e-9)
        # ranges of a filter that knows its sensors miss by their σ: 600 of them, half of them with a state
        assert found["residuals"][i] == pytest.approx(1.0, abs=0.25)
    low, high = stats.chi2.ppf([0.025, 0.975], 4)
    assert found["inside"] == np.mean((summed >= low) & (summed <= high))
    assert found["tight_lost"].tolist() == found["laisn_lost"].tolist() == [0.0, 0.0]
