"""The page of the study of formations: what was put into the record stands in its rows, and
nothing is made up.
"""

import re
from html import unescape
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
from reports.findings import Finding, Findings, record
from reports.page import Figures, Text, page_of
from tests.experiments.study.cells import cells_of

PLAN = plan_of(study_of("formation", {}))
CONDITIONS = {arm: PLAN.study.title("arm", arm) for arm in PLAN.arms}


def run_of(rms: float, *, lost: int = 0, turn: float = 3.0) -> list[Record]:
    """Rows of ten followers, the first `lost` of them lost; distances from 1 to 1.9 times `rms`."""
    return [
        {
            "station_rms_m": each,
            "station_p95_m": 2 * each,
            "station_max_m": 5 * each,
            "station_turn_max_m": turn,
            "station_leg_rms_m": each / 2,
            "track_error_end_m": 0.0,
            "lost": float(i < lost),
            "e_p_mean_m": 0.25,
            "closest_horizontal_m": 7.5 + rms,
            "closest_in_layer_m": 8.5 + rms,
            "touched": 0.0,
            "power_mean_w": 8.0,
        }
        for i, each in enumerate(rms * np.linspace(1.0, 1.9, 10))
    ]


@pytest.fixture(scope="module")
def findings() -> Findings:
    """Of each condition two runs alike; condition i has distances of i + 1 metres, the third
    lost followers.
    """
    found = {
        name: [run_of(i + 1.0, lost=3 if i == 2 else 0)] * 2 for i, name in enumerate(CONDITIONS)
    }
    found[[*CONDITIONS][4]] = [run_of(5.0, turn=0.0)] * 2
    outcomes: Any = SimpleNamespace(cells=cells_of(found))
    return record("formation", "laisn formation", (), findings_of({"study": outcomes}))


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch, findings: Findings) -> list[Any]:
    """Calls of the command: the plan and the options of each study that is flown."""
    calls: list[Any] = []

    def fly(plans: list[StudyPlan], folder: Path, **options: Any) -> list[StudyResults]:
        # the version of the plugins, of which there are none
        options.pop("plugins")
        calls.append((plans[0], options))
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
    return calls


def rows(html: str) -> dict[str, list[str]]:
    """Cells of the rows of a page's tables, by the first of them."""
    found = {}
    for row in re.findall(r"<tr>(.*?)</tr>", html, flags=re.DOTALL):
        cells = [
            unescape(re.sub(r"<.*?>", "", cell)).strip()
            for cell in re.findall(r"<td.*?</td>", row, re.DOTALL)
        ]
        if cells:
            found[cells[0]] = cells[1:]
    return found


@pytest.mark.system
def test_each_condition_has_a_row_of_its_numbers(
    findings: Findings, flown: list[Any], tmp_path: Path
) -> None:
    html = run("formation", {}, tmp_path).report().read_text(encoding="utf-8")
    found = rows(html)
    assert list(found) == [*CONDITIONS.values(), "80", "500", "5000", "0", "2", "5", "10"]
    # the last of three weaves of 5°, and the strongest: period, errors, what its way costs, 1 /
    # J₀(10°) − 1
    near, far = (f"{findings[f'weave 10 40 {behind}'].value:.2f}" for behind in (20, 40))
    assert found["10"] == ["40", near, far, "0.8"]
    assert (found["5"][0], found["0"][0]) == ("80", "–")
    # interrogations are in turn: five times as long for fifty as for ten
    message, interval, ten, fifty = (float(cell) for cell in found["80"])
    assert message < interval < ten
    assert fifty == pytest.approx(5.0 * ten, abs=0.3)
    # distances of 3 m: the median of ten from 3.0 to 5.7 m, the worst, twice and five times as
    # much, half as much
    median, worst, p95, largest, leg, turn, error, lost, share, closest, within, power = found[
        [*CONDITIONS.values()][2]
    ]
    assert median.startswith("4.35")
    assert (worst, p95, largest, leg, turn) == ("5.70", "8.70", "28.50", "2.17", "3.00")
    assert error.startswith("0.25")
    # six of twenty: Clopper and Pearson give 11.9 … 54.3 %
    assert (lost, share) == ("6 of 20", "30.0 (11.9 … 54.3)")
    assert (closest, within, power.split()[0]) == ("10.5", "11.5", "8.0")
    assert found[[*CONDITIONS.values()][4]][5] == "–", "no turn, no distance in it"


def test_rules_quote_the_conditions_that_they_name() -> None:
    """Every finding has a number of its own, and every phrase the number of its condition."""
    whats = ("run-median", "worst", "max", "closest", "within", "error", "lost")
    keys = [f"{what} {name}" for what in whats for name in CONDITIONS]
    weaves = [
        f"weave {weave}"
        for weave in ("5 40 40", "0 40 40", "5 40 20", "0 40 20", "2 40 40", "10 40 40")
    ]
    keys = [*weaves, "weave 5 40 way", *keys]
    values = {
        key: i + 0.25 if not key.startswith("lost") else (i - 87) / 100
        for i, key in enumerate(keys)
    }
    made = {key: Finding(value=value, low=0.0, high=1.0) for key, value in values.items()}
    findings = Findings(study="", command="", modules=(), version="", findings=made)
    given = {
        "quick": False,
        "stations": Figures(panels=[]),
        "conditions": {},
        "found": findings,
        "channel": SimpleNamespace(message_bits=1, reach_m=1.0),
    }
    none = {
        "RATES": (),
        "WEAVES": (),
        "BEHIND": (),
    }
    given |= {"limits": SimpleNamespace(**none), "interval": None, "share": None}
    page = page_of("experiments.studies.formation", [], given, findings)
    printed = " ".join(block.text for block in page.sections[-1].blocks if isinstance(block, Text))
    for phrase, key in (
        ("every second the median follower is {} off", "run-median calm"),
        ("every 5 s {}, every", "run-median 5 s"),
        ("every 10 s {};", "run-median 10 s"),
        ("a fifth of the messages lost {},", "run-median loss"),
        ("40 % lost in bursts {}. Shares", "run-median bursts"),
        ("worst follower was {} off with stations on it", "worst two"),
        ("on it, {} without", "worst two aside"),
        ("with three transmitters {}.", "worst calm"),
        ("to {}, and of one 20 m behind from", "weave 5 40 40"),
        ("follower 40 m behind from {} to", "weave 0 40 40"),
        ("to {}, for", "weave 5 40 20"),
        ("one 20 m behind from {} to", "weave 0 40 20"),
        ("hardly helps ({}), one", "weave 2 40 40"),
        ("does more ({}).", "weave 10 40 40"),
        ("It was {} in calm water", "max calm"),
        ("and {} in a current", "max current"),
        ("came within {} and", "closest calm"),
        (" and {} of each other horizontally", "closest current"),
        ("they came within {} with 40 %", "closest bursts"),
        ("modelled, cost {} in place of", "run-median drift"),
        ("formation along: {} off", "run-median ins"),
        ("though {} off in the world", "error ins"),
        ("four layers the median follower was {} off", "run-median fifty"),
        ("off, the worst {},", "worst fifty"),
        ("two of one layer came within {} of each other.", "within fifty"),
        ("sense each other kept {} apart", "within fifty near"),
        ("{} for the median follower that steers by the truth", "run-median truth"),
        ("truth, and {} at most", "max truth"),
    ):
        assert phrase.format(f"{values[key]:.2f} m") in printed
    shares = {
        name: f"{values[f'lost {name}']:.0%} (0 to 100 %)".replace("%", " %", 1)
        for name in (
            "calm",
            "5 s",
            "10 s",
            "loss",
            "bursts",
            "laisn-2",
            "laisn-3-1",
            "laisn-3-2",
            "5 s loss",
            "5 s loss back",
        )
    }
    assert (
        f"{shares['5 s loss']} were lost of stations that begin 5 m behind, "
        f"{shares['5 s loss back']} of" in printed
    )
    five = [shares[name] for name in ("calm", "5 s", "10 s", "loss", "bursts")]
    assert f"Shares of followers lost: {', '.join(five[:4])} and {five[4]}." in printed
    assert (
        f"lost were {shares['laisn-2']} of the followers with LAISN-2, {shares['laisn-3-1']} with "
        "LAISN-3(1), " in printed
    )
    assert (
        f"{shares['laisn-3-2']} with LAISN-3(2), and {shares['calm']} with the tightly coupled"
        in printed
    )


@pytest.mark.system
def test_a_trial_run_is_reported(flown: list[Any], tmp_path: Path) -> None:
    whole = run("formation", {}, tmp_path).report().read_text(encoding="utf-8")
    quick = run("formation", {}, tmp_path, quick=True).report().read_text(encoding="utf-8")
    assert "Trial run" in quick
    assert "laisn formation --quick" in quick
    assert "Trial run" not in whole
    assert "laisn formation" in whole


def test_the_figure_has_a_mark_for_each_condition_from_above(findings: Findings) -> None:
    (part,) = figures.picture(findings, CONDITIONS).parts
    marks = {line.marker: line for line in part.lines}
    assert len(marks) == 3
    # the first condition at the top, and the worst follower 1.9 times as far off as the nearest
    expected = 1.9 * np.arange(1.0, len(CONDITIONS) + 1)
    np.testing.assert_allclose(marks["D"].x, expected, rtol=1e-5)
    assert np.all(np.diff(marks["D"].y) == -1)
    names = dict(part.ticks)  # type: ignore[arg-type]
    assert names[len(CONDITIONS) - 1] == next(iter(CONDITIONS.values()))


@pytest.mark.system
@pytest.mark.parametrize("command", [["formation"], ["study", "formation"]])
def test_the_command_flies_its_arguments_and_prints_the_page(
    flown: list[Any], tmp_path: Path, command: list[str]
) -> None:
    usual = {"workers": None, "force": False, "cluster": None}
    for arguments, expected in (
        ([], (60, 1000.0, usual)),
        (["--quick", "--force"], (2, 100.0, usual | {"force": True})),
        (["--runs", "7", "--workers", "1"], (7, 1000.0, usual | {"workers": 1})),
    ):
        folder = tmp_path / str(len(flown))
        answer = CliRunner().invoke(app, [*command, *arguments, "--out", str(folder)])
        assert answer.exit_code == 0, answer.output
        plan, options = flown[-1]
        assert (plan.study.runs, plan.entries[0].scenario.duration_s, options) == expected
        assert (folder / "report.html").is_file()
        assert "report in" in answer.output
