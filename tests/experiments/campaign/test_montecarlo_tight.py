"""Campaigns of the tightly coupled navigator: the bits of single flights, and the metrics of its
histories.
"""

import numpy as np
import pytest

from experiments.campaign.montecarlo import Cell, histories, simulate
from experiments.campaign.plans import CellPlan, compute
from experiments.flight.fly import fly
from experiments.flight.library import load_scenario
from laisn import metrics
from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.estimates import TightEstimates
from reports.bound import geometry_of, least_rms, noise_of
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Scenario
from sim.simulation import simulate_motion


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario(
        "T5",
        [
            "navigation.variant=tight",
            "navigation.assume.transmitters=2",
            "duration_s=30",
            "motion=kinematic",
            "acoustics.loss_probability=0.2",
            "acoustics.surface_echo_probability=0.1",
        ],
    )


RUNS = range(3, 70)


@pytest.fixture(scope="module")
def cell(scenario: Scenario) -> Cell:
    return Cell.of(scenario, runs=RUNS)


@pytest.fixture(scope="module")
def states(cell: Cell) -> Floats:
    """Estimated states, by step, component and run."""
    return histories(cell)


@pytest.mark.system
def test_a_run_of_a_cell_is_that_flight(scenario: Scenario, states: Floats) -> None:
    for run in (3, 66):
        flight, _ = fly(scenario.model_copy(update={"run": run}))
        assert states[:, :, run - RUNS.start].tobytes() == flight.estimates[0].state.tobytes()


def test_metrics_are_those_of_the_histories(scenario: Scenario, cell: Cell, states: Floats) -> None:
    result = simulate(cell)
    truth = cell.truth
    error = np.stack(
        [metrics.position_errors(states[:, :2, i], truth.hydrophone) for i in range(len(RUNS))]
    )
    bearing = np.stack(
        [
            metrics.bearing_errors(states[:, :2, i], truth.hydrophone, truth.leader_position)
            for i in range(len(RUNS))
        ]
    )
    expected = metrics.summarise(error, bearing)
    assert result.row["e_p_mean_m"] == pytest.approx(expected.e_p_mean_m)
    assert result.row["e_p_max_m"] == pytest.approx(expected.e_p_max_m)
    assert result.row["e_b_std_deg"] == pytest.approx(expected.e_b_std_deg)
    assert result.row["worst_run"] == RUNS.start + int(np.argmax(error.max(axis=1)))
    assert result.row["e_p_p95_m"] == pytest.approx(np.percentile(error, 95), rel=0.01)
    np.testing.assert_allclose(result.runs["e_p_mean_m"], error.mean(axis=1))


def test_messages_are_counted_as_in_single_flights(scenario: Scenario) -> None:
    cell = Cell.of(scenario, runs=range(3))
    nees, nis, used = list[Floats](), list[Floats](), list[Ints]()
    counts: dict[str, int] = {}
    for run in range(3):
        flight, _ = fly(scenario.model_copy(update={"run": run}))
        estimates = flight.estimates[0]
        assert isinstance(estimates, TightEstimates)
        nees.append(metrics.nees(estimates, flight.hydrophone(0)[:, :2]))
        nis.append(estimates.nis[estimates.used > 0])
        used.append(estimates.used)
        for kind, number in metrics.fix_counts(estimates).items():
            counts[kind] = counts.get(kind, 0) + number
    row = simulate(cell).row
    assert {kind: row[f"fixes_{kind}"] for kind in counts} == counts
    assert {"lost", "ranges", "partly"} <= {kind for kind, number in counts.items() if number}
    assert row["nees"] == pytest.approx(np.mean(nees))
    # a message has one degree of freedom for each range that is used, a fix of LAISN has two
    expected_nis = 2.0 * np.concatenate(nis).sum() / np.concatenate(used).sum()
    assert row["nis"] == pytest.approx(expected_nis)


def test_neither_threads_nor_blocks_change_a_bit(scenario: Scenario) -> None:
    cells = [Cell.of(scenario, runs=runs) for runs in (70, 5)]
    by_one_thread = [simulate(cell) for cell in cells]
    by_three_threads = [simulate(cell, threads=3) for cell in cells]
    for single, threaded in zip(by_one_thread, by_three_threads, strict=True):
        assert single.runs["e_p_mean_m"].tobytes() == threaded.runs["e_p_mean_m"].tobytes()
        assert single.row["nees"] == threaded.row["nees"]
    assert (
        by_three_threads[1].runs["e_p_mean_m"].tobytes()
        == by_one_thread[0].runs["e_p_mean_m"][:5].tobytes()
    )


def test_a_row_of_this_navigator_alone_has_the_ratio_to_the_bound(scenario: Scenario) -> None:
    trajectory = simulate_motion(scenario)
    (_, row, _), (_, _, steps) = compute(
        trajectory, [CellPlan(scenario=scenario, runs=4, keep_steps=True)]
    )
    assert steps["time_s"].size == row["steps"]
    sensing = SensingSettings.of(scenario)
    least = least_rms(geometry_of(trajectory, sensing), noise_of(sensing, scenario.navigation))
    assert row["bound_rms_m"] == pytest.approx(np.sqrt(np.mean(least**2)))
    rms = np.hypot(row["e_p_mean_m"], row["e_p_std_m"])
    assert row["rms_over_bound"] == pytest.approx(rms / row["bound_rms_m"])
    assert 0.5 < row["rms_over_bound"] < 3.0
    laisn_scenario = load_scenario("T5", ["duration_s=30", "motion=kinematic"])
    ((_, laisn_row, _),) = compute(trajectory, [CellPlan(scenario=laisn_scenario, runs=4)])
    assert laisn_row["bound_rms_m"] is None


def test_a_cell_with_an_unknown_start_is_refused() -> None:
    scenario = load_scenario(
        "T5",
        [
            "navigation.variant=tight",
            "navigation.assume.known_start=false",
            "duration_s=5",
            "motion=kinematic",
        ],
    )
    with pytest.raises(LaisnError, match="known_start = false is for single flights"):
        simulate(Cell.of(scenario, runs=1))
