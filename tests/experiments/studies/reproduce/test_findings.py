"""Ratios, distances, claims and mirror locks of the reproduction: on figures made by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from experiments.studies.reproduce import figures as page_figures
from experiments.studies.reproduce.figures import TableCells
from experiments.studies.reproduce.findings import (
    CLAIMS,
    METRICS,
    ClaimJudgement,
    JudgedCriterion,
    Key,
    Verdict,
    findings_of_rows,
    listed,
    mean_distance,
    ratios,
)
from reports.intervals import Interval
from tests.experiments.studies.reproduce.cells import SETTINGS
from tests.experiments.studies.reproduce.test_figures import page_with
from tests.synthetic import make_scenario, make_trajectory

BASE, GATE = (
    next(s for s in SETTINGS if s.name == name)._replace(variants=("laisn-2",))
    for name in ("base", "measured-gate")
)
# mean errors of three missions, here and in the paper [m]
OURS = {"T2": 3.0, "T3": 1.0, "T4": 0.9}
THEIRS = {"T2": 1.0, "T3": 2.0, "T4": 1.0}


def figures(mean: float) -> dict[str, Any]:
    """A row of which all figures that the paper prints are `mean`."""
    return dict.fromkeys(METRICS, mean) | {
        "runs": 60,
        "mirror_locked_runs": 3,
        "e_p_mean_unlocked_m": 0.5,
        "e_p_p50_m": 1.0,
        "e_p_p95_m": 1.0,
        "e_b_p95_deg": 1.0,
        "nees": 4000.0,
        "nis": 2.0,
        "fixes_gated": 0,
        "worst_run": 0,
        "version": "v",
    }


ROWS = {
    (setting.name, mission, "laisn-2"): figures(mean) | {"like": setting.like}
    for setting in (BASE, GATE)
    for mission, mean in OURS.items()
}
PUBLISHED: dict[Key, dict[str, float]] = {
    ("base", mission, "laisn-2"): dict.fromkeys(METRICS, mean) for mission, mean in THEIRS.items()
}


def judged(*verdicts: Verdict) -> list[tuple[Any, ClaimJudgement, ClaimJudgement]]:
    """The first claims with these verdicts of ours; on the paper's own figures each holds."""
    on_paper = ClaimJudgement(verdict="holds")
    return [
        (claim, ClaimJudgement(verdict=verdict), on_paper)
        for claim, verdict in zip(CLAIMS, verdicts, strict=False)
    ]


def test_ratios_are_ours_over_the_papers() -> None:
    assert ratios(ROWS, PUBLISHED, BASE.name, "laisn-2", "e_p_mean_m").tolist() == [3.0, 0.5, 0.9]
    assert ratios(ROWS, PUBLISHED, GATE.name, "laisn-2", "e_p_mean_m").tolist() == [3.0, 0.5, 0.9]
    assert ratios(ROWS, PUBLISHED, BASE.name, "laisn-3-2", "e_p_mean_m").size == 0


def test_a_cell_of_medians_shows_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_figures, "ratio_tone", str)
    cell = TableCells(ROWS, PUBLISHED).median("base", "laisn-2", "e_p_mean_m")
    assert (cell.text, cell.title, cell.tone) == ("0.90", "0.50 … 3.00", "0.9")


def test_the_record_has_median_ratios_mirror_locks_and_verdicts_on_claims() -> None:
    judgements = judged("holds", "depends", "does not hold", "no data", "holds", "undecided")
    criterion = JudgedCriterion(
        quantity="median", interval=Interval(1.5, 1.4, 1.6), relation="≤", bound=2.0
    )
    judgements[1] = (
        judgements[1][0],
        replace(judgements[1][1], criteria=[criterion]),
        judgements[1][2],
    )
    actual = findings_of_rows(ROWS, PUBLISHED, judgements)
    ratio = actual["ratio base laisn-2"]
    assert (ratio.value, ratio.low, ratio.high) == (0.9, 0.5, 3.0)
    assert actual["mirror-locked base laisn-2"].value == pytest.approx(9 / 180)
    assert format(actual["mirror-locked base laisn-2"], ".0% i") == "5 % (2 to 9 %)"
    expected = {
        "holds": (2, "1 and 5"),
        "depends": (1, "2"),
        "does not hold": (1, "3"),
        "no data": (1, "4"),
        "undecided": (1, "6"),
    }
    for verdict, (number, claim_numbers) in expected.items():
        assert (actual[f"our {verdict} number"].value, actual[f"our {verdict}"].value) == (
            number,
            claim_numbers,
        )
    assert format(actual["criterion 2.1"], ".1f i") == "1.5 (1.4 to 1.6)"
    assert actual["criterion 2.1"].what == "median, ≤ 2: met; 99.8%"
    assert actual["the paper's holds number"].value == 6
    assert actual["the paper's depends"].value == "none"
    assert actual["error measured-gate laisn-2 T2"].value == 3.0
    assert actual["printed measured-gate laisn-2 T2"].value == 1.0
    assert actual["apart measured-gate laisn-2 T4"].value == pytest.approx(0.1)
    assert (actual["cells"].value, actual["runs"].value) == (6, 60)


def test_claims_without_data_do_not_count_against_the_others() -> None:
    page = page_with(
        (BASE, GATE), ROWS, PUBLISHED, judged("holds", "depends", "does not hold", "no data")
    )
    assert page.summary.startswith(
        "Verdicts on the 3 claims of the paper that these runs test: 1 holds (1), 1 depend on the "
        "mission,"
    )
    caption = page.sections[1].blocks[0].caption  # type: ignore[union-attr]
    assert "set so that its own tables pass" in caption


def test_runs_that_test_no_claim_say_so() -> None:
    page = page_with((BASE, GATE), ROWS, PUBLISHED, judged("no data", "no data"))
    assert page.summary.startswith("These runs test none of the paper's claims, ")


def test_a_claim_has_our_verdict_and_figures_before_the_papers() -> None:
    criteria = [
        JudgedCriterion(
            quantity="median", interval=Interval(1.5, 1.4, 1.6), relation="≤", bound=2.0
        )
    ]
    claim, ours = CLAIMS[2], ClaimJudgement(verdict="depends", criteria=criteria)
    page = page_with(
        (BASE, GATE), ROWS, PUBLISHED, [(claim, ours, ClaimJudgement(verdict="holds"))]
    )
    (summary_row,), (detail_row,) = (page.sections[i].blocks[0].rows for i in (0, 1))  # type: ignore[union-attr]
    assert [cell.text for cell in summary_row][:4] == [
        "3",
        claim.text,
        "depends on the mission",
        "holds",
    ]
    assert [cell.tone for cell in summary_row[2:4]] == ["maybe", "yes"]
    assert [cell.text for cell in detail_row] == [
        "3",
        "depends on the mission",
        "median: 1.50 (1.40 to 1.60) ≤ 2: met",
        claim.criterion,
    ]


def test_numbers_of_claims_are_listed_in_words() -> None:
    assert [listed(n) for n in ([], [3], [1, 7], [1, 2, 9])] == [
        "none",
        "3",
        "1 and 7",
        "1, 2 and 9",
    ]


def test_the_mean_distance_is_that_of_hydrophone_and_leader() -> None:
    flight = make_trajectory(make_scenario(30.0))
    site = flight.site_names.index(f"{flight.names[1]}/hydrophone")
    distances = [
        np.linalg.norm(flight.site_position[i, site, :2] - flight.position[i, 0, :2])
        for i in range(flight.time.size)
    ]
    assert mean_distance(flight) == pytest.approx(sum(distances) / len(distances), rel=1e-12)
    assert mean_distance(flight) > 1.0
