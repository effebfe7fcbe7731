"""The page of a study shows its worst run in 3D."""

from pathlib import Path

import pytest

from experiments.campaign.store import read_table
from experiments.study.file import study_from_table
from experiments.study.study import RUNS, run_studies
from reports.flight_report import scene_of_flight
from reports.scene.mission import Scene
from sim.flight import FlightRecord


def test_a_page_shows_the_worst_run_in_3d(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two biases of the log with three runs each, the run with the largest mean error."""
    table = {
        "scenario": "T5",
        "runs": 3,
        "set": {"duration_s": 20.0, "motion": "kinematic"},
        "vary": {"sensors.speed_bias_m_s": [0.0, 0.5]},
    }
    shown: list[FlightRecord] = []

    def recorded_scene(flight: FlightRecord) -> Scene:
        shown.append(flight)
        return scene_of_flight(flight)

    monkeypatch.setattr("reports.flight_report.scene_of_flight", recorded_scene)
    study = study_from_table(table, "mine.toml", "mine")
    run_studies({"study": study}, tmp_path, workers=1, quiet=True, scene=True)
    (flight,) = shown
    runs = read_table(tmp_path / RUNS)
    worst = max(runs, key=lambda row: float(row["e_p_mean_m"]))
    assert worst["sensors.speed_bias_m_s"] == 0.5
    assert flight.scenario.sensors.speed_bias_m_s == 0.5
    assert flight.scenario.run == worst["run"]
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert html.count('id="scene-view"') == 1
    assert "The worst run of the worst place." in html
    assert len(html) < 1_000_000
