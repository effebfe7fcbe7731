"""Flights and studies side by side: what differs is named, differences are paired."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.campaign.store import columns_of, read_table, write_table
from experiments.flight.library import load_scenario
from experiments.study import compare
from experiments.study.compare import differing, page_of, paired
from experiments.study.file import study_from_table
from experiments.study.study import RESULTS, RUNS, STUDY, run_studies
from laisn.errors import LaisnError
from laisn_sim.cli.fly import fly_and_write
from laisn_sim.cli.main import app
from sim.log.reader import read
from tests.golden import require_golden
from tests.synthetic import make_flight, write_log


@pytest.mark.system
def test_flights_are_compared_with_the_settings_that_differ(tmp_path):
    for name, bias in (("a", 0.1), ("b", 0.3)):
        scenario = load_scenario("T5", ["duration_s=20", f"sensors.speed_bias_m_s={bias}"])
        fly_and_write(scenario, tmp_path / name, with_video=False)
    flights = [read(tmp_path / name / "flight.mcap") for name in "ab"]
    assert differing(flights) == {"sensors.speed_bias_m_s": [0.1, 0.3]}
    errors_section, _ = page_of([str(tmp_path / "a"), str(tmp_path / "b")]).sections
    (panel,) = errors_section.blocks[0].panels
    assert [part.y_label for part in panel.parts] == ["E_P [m]", "E_B [°]"]
    rows = [[cell.text for cell in row] for row in errors_section.blocks[1].rows]
    errors_of_flights = []
    for name, flight, row in zip("ab", flights, rows, strict=True):
        truth, leader = (
            flight.hydrophone(0)[:, :2],
            flight.trajectory.position[flight.step_index(), 0, :2],
        )
        estimate = flight.estimates[0].state[:, :2]
        errors_of_flights.append(np.linalg.norm(estimate - truth, axis=1))
        estimated_direction, true_direction = (
            (position - leader) @ np.array([1j, 1.0]) for position in (estimate, truth)
        )
        bearing_error = np.abs(np.rad2deg(np.angle(estimated_direction / true_direction)))
        expected = (
            errors_of_flights[-1].mean(),
            errors_of_flights[-1].max(),
            bearing_error.mean(),
            bearing_error.max(),
            (errors_of_flights[-1] - errors_of_flights[0]).mean(),
        )
        lines = [part.lines[len(errors_of_flights) - 1].y for part in panel.parts]
        assert [line.mean() for line in lines] == pytest.approx(
            [errors_of_flights[-1].mean(), bearing_error.mean()]
        )
        assert row == [name, *(f"{value:.3f}".replace("-", "−") for value in expected)]
    nothing = "There is nothing to compare: the flights have the same settings and the same errors."
    assert nothing not in page_of([str(tmp_path / "a"), str(tmp_path / "b")]).summary
    assert page_of([str(tmp_path / "a")] * 2).summary.startswith(nothing)
    page = tmp_path / "page.html"
    result = CliRunner().invoke(
        app, ["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(page)]
    )
    assert result.exit_code == 0, result.output
    assert "sensors.speed_bias_m_s" in page.read_text(encoding="utf-8")


def test_studies_are_paired_where_they_share_points_runs_and_seeds(tmp_path):
    """A study against itself differs by nothing; against other runs or another seed it cannot be
    paired.
    """
    for name, runs, seed in (("a", 3, 1), ("b", 3, 1), ("c", 2, 1), ("d", 3, 2)):
        table = {
            "scenario": "T5",
            "runs": runs,
            "seed": seed,
            "set": {"duration_s": 20.0},
            "vary": {"leader.baseline_m": [1.0, 2.0]},
        }
        run_studies(
            {"study": study_from_table(table, name, name)}, tmp_path / name, workers=1, quiet=True
        )
    actual = paired([tmp_path / name for name in "abcd"], "e_p_mean_m")
    pages = {name: page_of([str(tmp_path / "a"), str(tmp_path / name)]).summary for name in "bcd"}
    assert "nothing to compare: the studies have the same settings" in pages["b"]
    assert "b against a: the same at 2 of 2 places" in pages["b"]
    assert "against" not in pages["c"]
    assert "nothing to compare: the studies share places, but neither seeds" in pages["c"]
    assert "nothing to compare: the studies share places, but neither seeds" in pages["d"]
    assert len(actual) == 2
    for _, against_same, against_fewer_runs, against_other_seed in actual.values():
        assert against_same is not None
        assert against_same.value == 0.0
        assert against_fewer_runs is None
        assert against_other_seed is None


def test_an_empty_table_is_no_setting_that_differs() -> None:
    actual = compare._differing([{"runs": 3, "set": {}}, {"runs": 3, "set.duration_s": 20.0}])
    assert actual == {"set.duration_s": [None, 20.0]}


def write_study(
    folder: Path, seeds: tuple[int, ...], added: float, added_by_seed: float = 0.0
) -> Path:
    """Write the tables of a study of two baselines: the error of run k of seed s is
    1 + 0.1 · (s + k) + `added` · (1 + k) + `added_by_seed` · s [m], 1 m more with the second
    baseline.
    """
    folder.mkdir()
    runs = [
        {
            "leader.baseline_m": baseline,
            "arm": "",
            "follower": "f",
            "point": point,
            "realization": realization,
            "run": run,
            "mirror_locked": False,
            "e_p_mean_m": 1.0
            + 0.1 * seed
            + 0.1 * run
            + point
            + added * (1 + run)
            + added_by_seed * seed,
        }
        for point, baseline in enumerate((1.0, 2.0))
        for realization, seed in enumerate(seeds)
        for run in range(30)
    ]
    write_table(folder / RUNS, columns_of(runs))
    write_table(
        folder / RESULTS,
        columns_of(
            [{"realization": realization, "seed": seed} for realization, seed in enumerate(seeds)]
        ),
    )
    return folder


def test_differences_are_taken_run_by_run_of_the_same_seeds(tmp_path):
    """The second study has the seeds in another order, and run k has 0.1 m · (1 + k) more."""
    first, second = (
        write_study(tmp_path / "a", (7, 8, 9), 0.0),
        write_study(tmp_path / "b", (9, 7, 8), 0.1),
    )
    actual = paired([first, second], "e_p_mean_m")
    assert [place[:1] for place in actual] == [
        ("leader.baseline_m = 1.0",),
        ("leader.baseline_m = 2.0",),
    ]
    # `write_study` does not write a study's file; differences that are equal to the bit have no
    # interval
    for folder in (first, second):
        (folder / "study.toml").write_text('scenario = "T5"\n', encoding="utf-8")
    assert page_of([str(first), str(second)]).summary.endswith(
        "b against a: higher at 1, undecided at 1 of 2 places."
    )
    for point, (mean, difference) in enumerate(actual.values()):
        # errors of seeds 7, 8 and 9 differ by 0.1 m: t(0.975, 2) s / √3; the mean of k is 14.5
        half_interval = 4.302653 * 0.1 / np.sqrt(3)
        expected_mean = 1.0 + 0.8 + 0.1 * 14.5 + point
        assert tuple(mean) == pytest.approx(
            (expected_mean, expected_mean - half_interval, expected_mean + half_interval)
        )
        assert difference.value == pytest.approx(0.1 * 15.5)
    assert (
        next(
            iter(
                paired([first, write_study(tmp_path / "c", (7, 8, 10), 0.1)], "e_p_mean_m").values()
            )
        )[1]
        is None
    )
    single_seed, more_of_single_seed = (
        write_study(tmp_path / "d", (7,), 0.0),
        write_study(tmp_path / "e", (7,), 0.1),
    )
    _, difference = next(iter(paired([single_seed, more_of_single_seed], "e_p_mean_m").values()))
    # 0.1 to 3 m of 30 runs: 1.96 σ / √30, nearly
    sigma = 0.1 * np.sqrt((30**2 - 1) / 12)
    assert difference.value == pytest.approx(1.55)
    assert (difference.high - difference.low) / 2 == pytest.approx(
        1.96 * sigma / np.sqrt(30), rel=0.1
    )


def test_differences_of_mirror_locks_have_the_limits_of_paired_shares(tmp_path):
    """Of 30 runs 3 more are mirror-locked: limits by Bonett & Price 2012, with one more run for
    either side. A single fraction has those of Clopper and Pearson.
    """
    folders = [write_study(tmp_path / name, (7,), 0.0) for name in "ab"]
    table = read_table(folders[1] / RUNS)
    write_table(
        folders[1] / RUNS, columns_of([row | {"mirror_locked": row["run"] < 3} for row in table])
    )
    first_fraction, difference = next(iter(paired(folders, "mirror_locked").values()))
    assert (first_fraction.value, first_fraction.low) == (0.0, 0.0)
    assert first_fraction.high == pytest.approx(1 - 0.025 ** (1 / 30))
    values = np.array([1.0] * 3 + [0.0] * 27 + [1.0, -1.0])
    half_interval = 1.959964 * values.std() / np.sqrt(32)
    assert tuple(difference) == pytest.approx(
        (0.1, values.mean() - half_interval, values.mean() + half_interval), rel=1e-6
    )


def test_flights_are_compared_where_both_have_estimates(tmp_path: Path) -> None:
    """Three flights of the same errors: one begins with an estimate after 5 s, one has none."""
    whole = make_flight(20.0)
    (estimates,) = whole.estimates
    for name, steps in (("whole", 0), ("late", 50), ("never", len(estimates.state))):
        state = estimates.state.copy()
        state[:steps] = np.nan
        (tmp_path / name).mkdir()
        log = write_log(
            replace(whole, estimates=(replace(estimates, state=state),)), tmp_path / name
        )
        log.rename(tmp_path / name / "flight.mcap")
    section, *_ = page_of([str(tmp_path / name) for name in ("whole", "late", "never")]).sections
    rows = [[cell.text for cell in row] for row in section.blocks[1].rows]
    errors = np.linalg.norm(estimates.state[:, :2] - whole.hydrophone(0)[:, :2], axis=1)
    assert rows[0][1:3] == [f"{errors.mean():.3f}", f"{errors.max():.3f}"]
    assert rows[1][1:3] == [f"{errors[50:].mean():.3f}", f"{errors[50:].max():.3f}"]
    assert rows[1][5] == "0.000"
    assert rows[2][1:] == ["–"] * 5


def test_the_page_of_flights_is_the_golden_one(tmp_path: Path) -> None:
    """A drift of 0.2 m/s lasts until the next message: 1 s in one flight, 5 s in the other."""
    for name, interval in (("a", 1.0), ("b", 5.0)):
        (tmp_path / name).mkdir()
        log = write_log(make_flight(20.0, message_interval=interval), tmp_path / name)
        log.rename(tmp_path / name / "flight.mcap")
    page = page_of([str(tmp_path / name) for name in "ab"])
    require_golden(replace(page, facts=[]), "compare-flights")


def test_the_page_of_studies_is_the_golden_one(tmp_path: Path) -> None:
    """The second study has the runs of the first with 0.4 m more, 0.05 m apart between seeds: with
    Student's t for two degrees of freedom to 4.302653 · 0.05 / √3 = 0.12 m. The third has another
    seed.
    """
    folders = [
        write_study(tmp_path / "a", (7, 8, 9), 0.0),
        write_study(tmp_path / "b", (7, 8, 9), 0.0, 0.05),
        write_study(tmp_path / "c", (7, 8, 10), 0.0),
    ]
    for folder, bias in zip(folders, (0.0, 0.1, 0.1), strict=True):
        text = f'scenario = "T5"\n[set]\n"sensors.speed_bias_m_s" = {bias}\n'
        (folder / STUDY).write_text(text, encoding="utf-8")
    page = page_of([str(folder) for folder in folders])
    require_golden(replace(page, facts=[]), "compare-studies")


def test_folders_that_are_neither_flights_nor_studies_and_a_single_one_are_refused(tmp_path):
    with pytest.raises(LaisnError, match="neither a flight"):
        page_of([str(tmp_path), str(tmp_path)])
    with pytest.raises(LaisnError, match="2 to 6"):
        page_of([str(tmp_path)])
