"""The page of the study of formations: its rows show the numbers of the record."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.campaign.store import Record
from experiments.studies.formation import figures
from experiments.studies.formation.findings import findings_of
from experiments.study import study as studies
from experiments.study.file import study_of
from experiments.study.plan import StudyPlan, plan_of
from experiments.study.run import StudyResults
from experiments.study.study import run
from laisn_sim.cli.main import app
from reports.findings import Findings, plain_finding, record
from reports.page import PageTable, page_of
from tests.experiments.study.cells import cells_of
from tests.golden import numbered_record, require_golden

STUDY = study_of("formation", {})
CONDITIONS = {arm: STUDY.title("arm", arm) for arm in STUDY.arms}


@pytest.fixture(scope="module")
def plan() -> StudyPlan:
    return plan_of(STUDY)


def run_of(rms: float, *, lost: int = 0, turn: float = 3.0) -> list[Record]:
    """Rows of ten followers, the first `lost` of them lost.

    Their distances from stations are 1 to 1.9 times `rms` [m], in turns at most `turn` [m].
    """
    return [
        {
            "station_rms_m": station_rms_m,
            "station_p95_m": 2 * station_rms_m,
            "station_max_m": 5 * station_rms_m,
            "station_turn_max_m": turn,
            "station_leg_rms_m": station_rms_m / 2,
            "track_error_end_m": 0.0,
            "lost": float(i < lost),
            "e_p_mean_m": 0.25,
            "closest_horizontal_m": 7.5 + rms,
            "closest_in_layer_m": 8.5 + rms,
            "touched": 0.0,
            "power_mean_w": 8.0,
        }
        for i, station_rms_m in enumerate(rms * np.linspace(1.0, 1.9, 10))
    ]


@pytest.fixture(scope="module")
def findings() -> Findings:
    """Of two equal runs of each condition; condition i has distances from i + 1 metres on, and the
    third has lost followers.
    """
    rows = {
        name: [run_of(i + 1.0, lost=3 if i == 2 else 0)] * 2 for i, name in enumerate(CONDITIONS)
    }
    outcomes: Any = SimpleNamespace(cells=cells_of(rows))
    return record("formation", "laisn formation", (), findings_of({"study": outcomes}))


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, findings: Findings) -> list[Any]:
    """The plan and the options of each study that the command flies; no mission is simulated."""
    flown: list[Any] = []

    def fly(plans: list[StudyPlan], folder: Path, **options: Any) -> list[StudyResults]:
        # the version of the plugins, of which there are none
        options.pop("plugins")
        flown.append((plans[0], options))
        row = {"point": 0, "arm": "calm", "realization": 0, "follower": "f"}
        return [
            StudyResults(
                plan=plans[0], rows=[row], runs=[(row, {"run": [0]})], steps=[], store=None
            )
        ]

    monkeypatch.setattr(studies, "fly_until_narrow", fly)
    monkeypatch.setattr(
        "experiments.studies.formation.findings.findings_of", lambda _: findings.findings
    )
    return flown


def test_the_page_is_the_golden_one(findings: Findings, plan: StudyPlan) -> None:
    """Each finding has a number of its own, so that rows, columns and phrases show theirs."""
    actual = numbered_record("formation", findings.findings)
    outcomes: Any = {"study": SimpleNamespace(plan=plan)}
    values = {"quick": False, "found": actual} | figures.values(actual, outcomes)
    require_golden(page_of("experiments.studies.formation", [], values, actual), "formation")


def test_of_a_formation_without_a_turn_no_distance_in_turns_is_shown(
    findings: Findings, plan: StudyPlan
) -> None:
    record = replace(
        findings, findings=findings.findings | {"turn calm": plain_finding(0.0, "", "m")}
    )
    outcomes: Any = {"study": SimpleNamespace(plan=plan)}
    values = {"quick": False, "found": record} | figures.values(record, outcomes)
    page = page_of("experiments.studies.formation", [], values, record)
    (table,) = (block for block in page.sections[0].blocks if isinstance(block, PageTable))
    assert table.rows[0][6].text == "–"


@pytest.mark.system
@pytest.mark.usefixtures("calls")
def test_a_trial_run_is_reported(tmp_path: Path) -> None:
    full = run("formation", {}, tmp_path).report().read_text(encoding="utf-8")
    quick = run("formation", {}, tmp_path, quick=True).report().read_text(encoding="utf-8")
    assert "Trial run" in quick
    assert "laisn formation --quick" in quick
    assert "Trial run" not in full
    assert "laisn formation" in full


def test_the_figure_has_a_mark_for_each_condition_from_top_to_bottom(findings: Findings) -> None:
    (part,) = figures.picture(findings, CONDITIONS).parts
    marks = {line.marker: line for line in part.lines}
    assert len(marks) == 3
    # the first condition is at the top; "D" marks the worst follower, which is 1.9 times as far off
    # as the nearest
    expected = 1.9 * np.arange(1.0, len(CONDITIONS) + 1)
    np.testing.assert_allclose(marks["D"].x, expected, rtol=1e-5)
    assert np.all(np.diff(marks["D"].y) == -1)
    names = dict(part.ticks)  # type: ignore[arg-type]
    assert names[len(CONDITIONS) - 1] == next(iter(CONDITIONS.values()))


@pytest.mark.system
@pytest.mark.parametrize("command", [["formation"], ["study", "formation"]])
def test_the_command_flies_its_arguments_and_prints_the_page(
    calls: list[Any], tmp_path: Path, command: list[str]
) -> None:
    defaults = {"workers": None, "force": False, "cluster": None}
    for arguments, expected in (
        ([], (60, 1000.0, defaults)),
        (["--quick", "--force"], (2, 100.0, defaults | {"force": True})),
        (["--runs", "7", "--workers", "1"], (7, 1000.0, defaults | {"workers": 1})),
    ):
        folder = tmp_path / str(len(calls))
        result = CliRunner().invoke(app, [*command, *arguments, "--out", str(folder)])
        assert result.exit_code == 0, result.output
        plan, options = calls[-1]
        assert (plan.study.runs, plan.entries[0].scenario.duration_s, options) == expected
        assert (folder / "report.html").is_file()
        assert "report in" in result.output
