"""Flights and studies side by side: what differs is named, differences are paired."""

import pytest
from typer.testing import CliRunner

from experiments.command.cli import app
from experiments.command.fly import fly_and_write
from experiments.flight.library import load
from experiments.study.compare import differing, page_of, paired
from experiments.study.file import of_table
from experiments.study.study import run_study
from laisn.failure import LaisnError
from sim.log.reader import read


def test_flights_are_compared_with_the_settings_that_differ(tmp_path):
    for name, bias in (("a", 0.1), ("b", 0.3)):
        scenario = load("T5", ["duration_s=20", f"sensors.speed_bias_m_s={bias}"])
        fly_and_write(scenario, tmp_path / name, with_video=False)
    flights = [read(tmp_path / name / "flight.mcap") for name in "ab"]
    assert differing(flights) == {"sensors.speed_bias_m_s": [0.1, 0.3]}
    out = tmp_path / "page.html"
    result = CliRunner().invoke(app, ["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "sensors.speed_bias_m_s" in out.read_text(encoding="utf-8")


def test_studies_are_paired_where_they_share_places_and_runs(tmp_path):
    """A study against itself differs by nothing; against other runs or another seed it cannot be paired."""
    for name, runs, seed in (("a", 3, 1), ("b", 3, 1), ("c", 2, 1), ("d", 3, 2)):
        table = {
            "scenario": "T5",
            "runs": runs,
            "seed": seed,
            "set": {"duration_s": 20.0},
            "vary": {"leader.baseline_m": [1.0, 2.0]},
        }
        run_study(of_table(table, name, name), tmp_path / name, workers=1, quiet=True)
    found = paired([tmp_path / name for name in "abcd"], "e_p_mean_m")
    assert len(found) == 2
    for _, same, fewer, other in found.values():
        assert same is not None
        assert same.value == 0.0
        assert fewer is None
        assert other is None
    differences, settings = page_of([str(tmp_path / n) for n in "ac"]).sections
    assert differences.title == "Paired differences"
    ((key, here, there),) = [[cell.text for cell in row] for row in settings.blocks[0].rows]
    assert (key, here, there) == ("runs", "3", "2")


def test_what_is_neither_is_refused(tmp_path):
    with pytest.raises(LaisnError, match="neither a flight"):
        page_of([str(tmp_path), str(tmp_path)])
    with pytest.raises(LaisnError, match="2 to 6"):
        page_of([str(tmp_path)])
