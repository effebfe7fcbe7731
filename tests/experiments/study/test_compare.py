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
    errors, _ = page_of([str(tmp_path / "a"), str(tmp_path / "b")]).sections
    (drawn,) = errors.blocks[0].panels
    assert [part.y_label for part in drawn.parts] == ["E_P [m]", "E_B [°]"]
    rows = [[cell.text for cell in row] for row in errors.blocks[1].rows]
    off = []
    for name, flight, row in zip("ab", flights, rows, strict=True):
        truth, leader = (
            flight.hydrophone(0)[:, :2],
            flight.trajectory.position[flight.step_index(), 0, :2],
        )
        actual = flight.estimates[0].state[:, :2]
        off.append(np.linalg.norm(actual - truth, axis=1))
        seen, true = ((at - leader) @ np.array([1j, 1.0]) for at in (actual, truth))
        turned = np.abs(np.rad2deg(np.angle(seen / true)))
        expected = (
            off[-1].mean(),
            off[-1].max(),
            turned.mean(),
            turned.max(),
            (off[-1] - off[0]).mean(),
        )
        lines = [part.lines[len(off) - 1].y for part in drawn.parts]
        assert [line.mean() for line in lines] == pytest.approx([off[-1].mean(), turned.mean()])
        assert row == [name, *(f"{value:.3f}".replace("-", "−") for value in expected)]
    nothing = "There is nothing to compare: the flights have the same settings and the same errors."
    assert nothing not in page_of([str(tmp_path / "a"), str(tmp_path / "b")]).summary
    assert page_of([str(tmp_path / "a")] * 2).summary.startswith(nothing)
    out = tmp_path / "page.html"
    result = CliRunner().invoke(
        app, ["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(out)]
    )
    assert result.exit_code == 0, result.output
    assert "sensors.speed_bias_m_s" in out.read_text(encoding="utf-8")


def test_studies_are_paired_where_they_share_places_and_runs(tmp_path):
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
    pages = {b: page_of([str(tmp_path / "a"), str(tmp_path / b)]).summary for b in "bcd"}
    assert "nothing to compare: the studies have the same settings" in pages["b"]
    assert "b against a: lower at 0, higher at 0, undecided at 0, the same at 2 of 2" in pages["b"]
    assert "against" not in pages["c"]
    assert "nothing to compare: the studies share places, but neither seeds" in pages["c"]
    assert "nothing to compare: the studies share places, but neither seeds" in pages["d"]
    assert len(actual) == 2
    for _, same, fewer, other in actual.values():
        assert same is not None
        assert same.value == 0.0
        assert fewer is None
        assert other is None


def test_a_table_that_holds_nothing_is_no_setting() -> None:
    actual = compare._differing([{"runs": 3, "set": {}}, {"runs": 3, "set.duration_s": 20.0}])
    assert actual == {"set.duration_s": [None, 20.0]}


def kept(folder: Path, seeds: tuple[int, ...], added: float, added_by_seed: float = 0.0) -> Path:
    """A study of two baselines, each run with 1 m and a tenth of seed and number; the second 1 m
    more; and what is added, by number and by seed [m].
    """
    folder.mkdir()
    runs = [
        {
            "leader.baseline_m": base,
            "arm": "",
            "follower": "f",
            "point": p,
            "realization": realization,
            "run": run,
            "mirror_locked": False,
            "e_p_mean_m": 1.0
            + 0.1 * seed
            + 0.1 * run
            + p
            + added * (1 + run)
            + added_by_seed * seed,
        }
        for p, base in enumerate((1.0, 2.0))
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
    """Every run is off by a tenth of its number more: Student's t over three equal differences."""
    first, more = kept(tmp_path / "a", (7, 8, 9), 0.0), kept(tmp_path / "b", (9, 7, 8), 0.1)
    actual = paired([first, more], "e_p_mean_m")
    assert [place[:1] for place in actual] == [
        ("leader.baseline_m = 1.0",),
        ("leader.baseline_m = 2.0",),
    ]
    # the file of a study, which `kept` does not write; differences that are equal to the bit have
    # no interval
    for folder in (first, more):
        (folder / "study.toml").write_text('scenario = "T5"\n', encoding="utf-8")
    assert page_of([str(first), str(more)]).summary.endswith(
        "b against a: lower at 0, higher at 1, undecided at 1 of 2 places."
    )
    for p, (mean, apart) in enumerate(actual.values()):
        # realizations differ by 0.1 m: t(0.975, 2) s / √3
        half = 4.302653 * 0.1 / np.sqrt(3)
        middle = 1.0 + 0.8 + 0.1 * 14.5 + p
        assert tuple(mean) == pytest.approx((middle, middle - half, middle + half))
        assert apart.value == pytest.approx(0.1 * 15.5)
    assert (
        next(iter(paired([first, kept(tmp_path / "c", (7, 8, 10), 0.1)], "e_p_mean_m").values()))[1]
        is None
    )
    one, other = kept(tmp_path / "d", (7,), 0.0), kept(tmp_path / "e", (7,), 0.1)
    _, apart = next(iter(paired([one, other], "e_p_mean_m").values()))
    # 0.1 to 3 m of 30 runs: 1.96 σ / √30, nearly
    sigma = 0.1 * np.sqrt((30**2 - 1) / 12)
    assert apart.value == pytest.approx(1.55)
    assert (apart.high - apart.low) / 2 == pytest.approx(1.96 * sigma / np.sqrt(30), rel=0.1)


def test_differences_of_mirror_locks_have_the_limits_of_paired_shares(tmp_path):
    """Of 30 runs 3 more are mirror-locked: Bonett & Price 2012 add a run for either side; a
    share has other limits.
    """
    folders = [kept(tmp_path / name, (7,), 0.0) for name in "ab"]
    table = read_table(folders[1] / RUNS)
    write_table(
        folders[1] / RUNS, columns_of([row | {"mirror_locked": row["run"] < 3} for row in table])
    )
    none, apart = next(iter(paired(folders, "mirror_locked").values()))
    assert (none.value, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(1 - 0.025 ** (1 / 30))
    values = np.array([1.0] * 3 + [0.0] * 27 + [1.0, -1.0])
    half = 1.959964 * values.std() / np.sqrt(32)
    assert tuple(apart) == pytest.approx(
        (0.1, values.mean() - half, values.mean() + half), rel=1e-6
    )


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
        kept(tmp_path / "a", (7, 8, 9), 0.0),
        kept(tmp_path / "b", (7, 8, 9), 0.0, 0.05),
        kept(tmp_path / "c", (7, 8, 10), 0.0),
    ]
    for folder, bias in zip(folders, (0.0, 0.1, 0.1), strict=True):
        text = f'scenario = "T5"\n[set]\n"sensors.speed_bias_m_s" = {bias}\n'
        (folder / STUDY).write_text(text, encoding="utf-8")
    page = page_of([str(folder) for folder in folders])
    require_golden(replace(page, facts=[]), "compare-studies")


def test_what_is_neither_is_refused(tmp_path):
    with pytest.raises(LaisnError, match="neither a flight"):
        page_of([str(tmp_path), str(tmp_path)])
    with pytest.raises(LaisnError, match="2 to 6"):
        page_of([str(tmp_path)])
