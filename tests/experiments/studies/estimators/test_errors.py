"""Errors that the study of the estimators adds to measurements, and its runs."""

import numpy as np
import pytest
from scipy import stats

from experiments.campaign.montecarlo import Cell, simulate, single_runs
from experiments.studies.estimators.errors import (
    DEVIATION,
    ECHO_CHANCE,
    ERRORS,
    LOSS_CHANCE,
    Errors,
)
from experiments.study.file import built_in_files, study_of
from experiments.study.plan import PlanEntry, plan_of
from laisn.messages import Measurements
from sim.sensing.observation import IdealMeasurements, measure
from sim.sensing.sensors import SensorErrors


def entry_of(route: str, interval: float, case: str, arm: str) -> PlanEntry:
    """The entry of the seven cases that a route, an interval, a case and an arm have."""
    keys = {"scenario": route, "vary": {"timing.message_interval_s": [interval]}}
    plan = plan_of(study_of(str(built_in_files("estimators")["cases"]), keys))
    return next(e for e in plan.entries if e.arm == arm and plan.points[e.point]["case"] == case)


def mission(route: str, interval: float) -> tuple[IdealMeasurements, SensorErrors]:
    """What the sensors of a follower measure, and their errors."""
    cell = Cell.of(entry_of(route, interval, "G1", "laisn-2").scenario)
    return cell.truth, cell.errors


def disturbed(clean: Measurements, run: int, *errors: str) -> Measurements:
    return Errors(errors).disturb(clean, 1, run)


def test_every_error_changes_measurements() -> None:
    truth, errors = mission("T7", 5.0)
    clean = measure(truth, errors, seed=1, run=0)
    for name in ERRORS:
        actual = disturbed(clean, 0, name)
        fields = ("ranges", "speed", "heading")
        assert any(
            getattr(actual, field).tobytes() != getattr(clean, field).tobytes() for field in fields
        ), name
    with pytest.raises(ValueError, match="there is no error 'eco'; available: drift, "):
        Errors(["eco"])


def test_ranges_are_echoes_or_lost_at_the_set_rates() -> None:
    truth, errors = mission("T7", 1.0)
    lost, echoes, total = 0, 0, 0
    for run in range(3):
        clean = measure(truth, errors, seed=1, run=run)
        disturbed_run = disturbed(clean, run, "echoes", "losses", "late")
        # "late": pings of the front transmitter leave late, by 1 cm
        excess = disturbed_run.ranges - clean.ranges - np.array([0.0, 0.01, 0.0])
        is_lost = np.isnan(excess).all(axis=1)
        assert np.array_equal(np.isnan(excess).any(axis=1), is_lost)
        received = excess[~is_lost]
        is_echo = received > 1e-9
        assert np.all(
            (np.abs(received) < 1e-9) | ((received > 0.3 - 1e-9) & (received < 4.8 + 1e-9))
        )
        lost, echoes, total = (
            lost + int(is_lost.sum()),
            echoes + int(is_echo.sum()),
            total + is_lost.size,
        )
        assert np.array_equal(disturbed_run.speed, clean.speed)
    # within five standard deviations of a binomial, whose variances are 0.2 · 0.8 and 0.05 · 0.95
    assert lost / total == pytest.approx(LOSS_CHANCE, abs=5 * np.sqrt(0.16 / total))
    assert echoes / (3 * (total - lost)) == pytest.approx(
        ECHO_CHANCE, abs=5 * np.sqrt(0.0475 / (3 * total))
    )


def test_a_clock_and_common_echoes_move_all_ranges_of_a_message_alike() -> None:
    truth, errors = mission("T7", 1.0)
    clean = measure(truth, errors, seed=1, run=0)
    clock_error = disturbed(clean, 0, "clock").ranges - clean.ranges
    # 1500 m/s times 1 ms, and 1 ppm of the time
    expected = 1500.0 * (1e-3 + 1e-6 * clean.dt * clean.message_step)
    np.testing.assert_allclose(
        clock_error, np.repeat(expected[:, None], 3, axis=1), rtol=0, atol=1e-9
    )
    echo_of_run, messages = [], clean.message_step.size
    for run in range(3):
        clean = measure(truth, errors, seed=1, run=run)
        echo = disturbed(clean, run, "common").ranges - clean.ranges
        np.testing.assert_allclose(echo, np.repeat(echo[:, :1], 3, axis=1), rtol=0, atol=1e-9)
        echo_of_run.append(echo[echo[:, 0] > 1e-9, 0])
    echoes = np.concatenate(echo_of_run)
    # an echo of 0.3 to 4.8 m in one message of ten
    assert echoes.min() > 0.3 - 1e-9
    assert echoes.max() < 4.8 + 1e-9
    assert echoes.size / (3 * messages) == pytest.approx(
        0.1, abs=5 * np.sqrt(0.09 / (3 * messages))
    )


def test_drift_is_the_same_for_the_same_run_and_leaves_ranges_alone() -> None:
    truth, errors = mission("T7", 5.0)
    clean = measure(truth, errors, seed=1, run=0)
    drifting, same_run, other_run = (disturbed(clean, run, "drift") for run in (0, 0, 1))
    assert drifting.heading.tobytes() == same_run.heading.tobytes() != other_run.heading.tobytes()
    assert np.array_equal(drifting.ranges, clean.ranges)
    time = clean.dt * np.arange(1, clean.speed.size + 1)
    # the log, which is never negative, drifts by 0.1 m/s in 300 s, the compass by 3° in 400 s
    moving = (drifting.speed > 0.0) & (clean.speed > 0.0)
    for drift, amplitude, period, valid in (
        (drifting.speed - clean.speed, 0.1, 300.0, moving),
        (drifting.heading - clean.heading, np.deg2rad(3.0), 400.0, np.ones(time.size, dtype=bool)),
    ):
        angle = 2 * np.pi * time[valid] / period
        waves = np.column_stack([np.sin(angle), np.cos(angle)])
        coefficients, *_ = np.linalg.lstsq(waves, drift[valid], rcond=None)
        assert np.linalg.norm(coefficients) == pytest.approx(amplitude, rel=1e-9)
        assert np.abs(waves @ coefficients - drift[valid]).max() < 1e-9

    # each has a phase of its own
    log_phase, compass_phase = np.random.default_rng([1, 0]).uniform(0.0, 2.0 * np.pi, 2)
    assert (drifting.speed - clean.speed)[moving] == pytest.approx(
        0.1 * np.sin(2 * np.pi * time / 300.0 + log_phase)[moving]
    )
    expected = np.deg2rad(3.0) * np.sin(2 * np.pi * time / 400.0 + compass_phase)
    assert drifting.heading - clean.heading == pytest.approx(expected, abs=1e-12)


def test_a_compass_deviates_as_a_sine_of_the_heading_whose_phase_has_nothing_to_do_with_drift() -> (
    None
):
    truth, errors = mission("T7", 5.0)
    clean = measure(truth, errors, seed=1, run=0)
    phases = []
    for run in range(200):
        deviation = disturbed(clean, run, "deviation").heading - clean.heading
        waves = np.column_stack([np.sin(clean.heading), np.cos(clean.heading)])
        coefficients, *_ = np.linalg.lstsq(waves, deviation, rcond=None)
        assert np.hypot(*coefficients) == pytest.approx(DEVIATION, rel=1e-6)
        phases.append(np.arctan2(coefficients[1], coefficients[0]))
    drift_phases = [
        np.random.default_rng([1, run]).uniform(0.0, 2.0 * np.pi, 2) for run in range(200)
    ]
    # the phases, and how far they are from the phase of either drift, are spread all around: a mean
    # of 200 random unit vectors has a length of 0.07
    for angles in (
        phases,
        *(np.array(phases) - np.array(drift) for drift in zip(*drift_phases, strict=True)),
    ):
        assert abs(np.mean(np.exp(1j * np.asarray(angles)))) < 0.25


@pytest.mark.system
def test_runs_with_errors_are_navigated_alike_alone_and_in_cells() -> None:
    """Metrics of a cell whose measurements are disturbed are computed once more, from the states of
    each run that is navigated alone.
    """
    errors = Errors(["drift", "losses"])
    for arm in ("laisn-2", "tight"):
        cell = Cell.of(entry_of("T7", 5.0, "G3", arm).scenario, 0, range(2), disturbance=errors)
        result, nees_sum = simulate(cell), np.zeros(cell.truth.speed.size)
        for i in cell.runs:
            measurements = measure(cell.truth, cell.errors, seed=12, run=i)
            (alone,) = single_runs(cell, [i])
            navigated = cell.spec.make(cell.settings, cell.truth.start).run(
                errors.disturb(measurements, 12, i)
            )
            np.testing.assert_allclose(alone.state, navigated.state, rtol=1e-9, atol=1e-9)
            error = navigated.state[:, :2] - cell.truth.hydrophone
            distance = np.linalg.norm(error, axis=1)
            runs = {name: values[i] for name, values in result.runs.items()}
            assert runs["e_p_mean_m"] == pytest.approx(distance.mean(), rel=1e-9)
            assert runs["e_p_rms_m"] == pytest.approx(np.sqrt(np.mean(distance**2)), rel=1e-9)
            xx, xy, yy = (
                navigated.covariance[:, 0, 0],
                navigated.covariance[:, 0, 1],
                navigated.covariance[:, 1, 1],
            )
            # LAISN's certain fixes leave a covariance without an inverse
            invertible = (xx + yy > 2e-12) & (xx * yy - xy * xy > 1e-8 * xx * yy)
            nees = np.full(len(error), np.nan)
            covariance = navigated.covariance[invertible, :2, :2]
            nees[invertible] = np.einsum(
                "ni,ni->n",
                error[invertible],
                np.linalg.solve(covariance, error[invertible, :, None])[..., 0],
            )
            nees_sum += nees
            assert runs["nees"] == pytest.approx(
                np.nanmean(nees), rel=1e-9 if arm == "tight" else 1e-6
            )
            assert runs["nis"] == pytest.approx(2.0 * alone.nis_sum / alone.nis_dof, rel=1e-6)
        # the sum over two runs has the χ² distribution with 2 · 2 degrees of freedom
        low, high = stats.chi2.ppf([0.025, 0.975], 4)
        nees_sum = nees_sum[np.isfinite(nees_sum)]
        inside = np.mean((nees_sum >= low) & (nees_sum <= high))
        assert result.row["nees_inside"] == inside
