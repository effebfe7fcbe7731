"""The study of the estimators: its figures of merit, its plan, its record and its page."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

from experiments.campaign.tasks import key_of
from experiments.command.cli import app
from experiments.estimators import missions, paired, plan, report, study
from experiments.estimators.cases import CASES
from experiments.estimators.clock import ClockCost, clock_cost
from experiments.estimators.missions import WEAVE
from experiments.estimators.paired import Captured, Paired, Plain, captures, compare, nees, plain_filter
from experiments.estimators.plan import OFFSETS_M, QUICK, SEAS, SIGMAS, Size, at_sea, tasks
from experiments.estimators.report import write_page
from experiments.findings import Findings
from laisn.bound import TrueNoise
from laisn.ekf import filter_runs
from laisn.tight.settings import Assume, TightSettings
from sim.scenario.routes import library_route
from sim.sensing.sensor_errors import measure


def made(rng: np.random.Generator, *, scale: float = 1.0, runs: int = 40, route: str = "T2", lost: int = 0) -> Paired:
    """Figures of runs whose squared errors are `scale` times what their covariance says."""
    tight = rng.uniform(0.1, 0.3, runs)
    return paired.paired(
        route,
        5.0,
        {
            "laisn_means": 4.0 * tight,
            "laisn_squares": (5.0 * tight) ** 2,
            "tight_means": tight,
            "tight_squares": tight**2,
            "largest": 3.0 * tight,
            "normalised": scale * rng.chisquare(2, (200, runs)).mean(axis=0),
            "residuals": np.ones(runs),
            "laisn_lost": np.ones(runs),
            "tight_lost": (np.arange(runs) < lost).astype(np.float64),
            "instants": scale * rng.chisquare(2 * runs, 1000),
        },
        0.15,
    )


def test_a_right_covariance_is_within_its_interval_95_percent_of_the_time_and_a_wrong_one_is_not() -> None:
    rng = np.random.default_rng(0)
    for scale in (1.0, 0.7, 1.5):
        # of 40 runs, squares add up to χ² of 80 degrees of freedom times the scale
        limits = stats.chi2.ppf([0.025, 0.975], 80) / scale
        share = float(np.diff(stats.chi2.cdf(limits, 80))[0])
        assert made(rng, scale=scale).inside == pytest.approx(share, abs=5 * np.sqrt(share * (1 - share) / 1000))
    assert made(rng).nees == pytest.approx(2.0, abs=0.15)


def test_figures_of_all_runs_are_means_roots_and_counts_over_them() -> None:
    one = made(np.random.default_rng(1), lost=3)
    assert one.ratio == pytest.approx(0.25)
    assert one.tight_rms == pytest.approx(np.sqrt(np.mean(one.tight_means**2)))
    assert one.laisn_rms == pytest.approx(5.0 * one.tight_rms)
    assert (one.tight_captured, one.laisn_captured, one.runs) == (3, 40, 40)


def test_a_ratio_over_missions_is_the_median_of_theirs() -> None:
    rng = np.random.default_rng(2)
    flown = [made(rng) for _ in range(3)]
    value, low, high = study.ratio(flown)
    assert (value, low, high) == pytest.approx((0.25, 0.25, 0.25))
    assert study.over_bound(flown) == pytest.approx([one.tight_rms / 0.15 for one in flown])
    mean = study.mean_of(flown, "tight_means")
    every = np.concatenate([one.tight_means for one in flown])
    assert mean.value == pytest.approx(every.mean())
    # the interval of the mean is that of the normal law, nearly
    half = 1.96 * np.mean([one.tight_means for one in flown], axis=0).std() / np.sqrt(40)
    assert (mean.high - mean.low) / 2 == pytest.approx(half, rel=0.15)


def of_hand(route: str, error: float, laisn: float, lost: int, laisn_lost: int, runs: int = 20) -> Paired:
    """A mission all of whose runs are alike, but for those that are captured."""
    each = np.ones(runs)
    return Paired(
        route=route, interval=5.0, laisn_means=laisn * each,
        laisn_squares=(1.25 * laisn) ** 2 * each, tight_means=error * each,
        tight_squares=(2.0 * error) ** 2 * each, tight_max=7.0 * error, normalised=10.0 * error * each,
        inside=error, residuals=3.0 * error * each, laisn_lost=np.arange(runs) < laisn_lost,
        tight_lost=np.arange(runs) < lost, bound_rms=0.5, smoothing=error + 0.1,
    )  # fmt: skip


def test_missions_together_are_means_medians_and_extremes_of_theirs() -> None:
    flown = [of_hand("T2", 0.2, 1.0, 0, 5), of_hand("T3", 0.4, 1.0, 3, 6), of_hand("T4", 0.9, 1.5, 0, 1)]
    named: dict[str, Any] = {}
    study._of_missions("G", flown, named)
    values = {key.removesuffix(" G"): finding.value for key, finding in named.items()}
    assert values == pytest.approx(
        {
            "ratio": 0.4, "worst": 0.6, "error": 0.5, "laisn-2": 3.5 / 3, "largest": 6.3, "nees": 5.0,
            "nees-least": 2.0, "nees-most": 9.0, "inside": 0.5, "nis": 1.5, "captured": 3 / 60, "captured-runs": 3,
            "captured-laisn-2": 12 / 60, "bound": 1.6, "bound-worst": 3.6,
            # 0.5 m over 1.25, 1.25 and 1.875 m
            "least": 0.4, "smoothing": 0.5,
        },
        rel=1e-5,
    )  # fmt: skip
    exact = stats.binomtest(12, 60).proportion_ci(0.95, "exact")
    limits = named["captured-laisn-2 G"]
    assert (limits.low, limits.high) == pytest.approx((exact.low, exact.high), rel=1e-5)
    assert named["captured-runs G"].what == "runs captured of 60"
    even = study.ratio(flown[:2])
    assert even.value == pytest.approx(0.3)


def test_cells_of_the_page_are_the_figures_of_its_heads() -> None:
    flown = [of_hand("T2", 0.2, 1.0, 0, 5), of_hand("T3", 0.4, 1.0, 3, 6), of_hand("T4", 0.9, 1.5, 0, 1)]
    named: dict[str, Any] = {}
    study._of_missions("G", flown, named)
    cells = report._row(Findings(study="", command="", modules=(), version="", findings=named), "G")
    assert len(cells) == len(report._HEADS)
    assert [cell.text.partition(" (")[0] for cell in cells] == [
        "0.50", "1.17", "0.40", "0.60", "1.60", "3.60", "0.40", "5.00", "2.00", "9.00", "50", "1.50", "5.0", "20.0",
    ]  # fmt: skip
    (row,) = report._routes({("case", "G1", 5.0, "T3"): flown[1], ("sea", "calm", "T3"): flown[0]}).rows
    assert [cell.text for cell in row] == [
        "G1", "5", "T3", "0.400", "1.000", "0.400", "0.800", "1.60", "2.8", "4.00", "3", "6",
    ]  # fmt: skip


def test_rows_of_settings_are_those_that_they_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "_HEADS", ["finding"])
    monkeypatch.setattr(report, "_row", lambda _, key, *first: [*first, report.words(key)])
    rows = report._varied(Findings(study="", command="", modules=(), version=""))["sigma"].rows
    told = [[cell.text for cell in row] for row in rows]
    assert told[:2] == [
        [SIGMAS[0].replace("_", " "), "halved", f"sigma {SIGMAS[0]} 0.5"],
        [SIGMAS[0].replace("_", " "), "doubled", f"sigma {SIGMAS[0]} 2"],
    ]
    assert len(told) == 2 * len(SIGMAS)


def test_captures_of_many_runs_are_told_with_their_limits(found: dict[tuple[Any, ...], Any]) -> None:
    """Of 64 runs 7 of LAISN-2 and none of the other, wherever they were flown."""
    rows = [[cell.text for cell in row] for row in report._many(study.findings_of(found)).rows]
    low, high = (100 * limit for limit in stats.binomtest(7, 64).proportion_ci(0.95, "exact"))
    most = 100 * stats.binomtest(0, 64).proportion_ci(0.95, "exact").high
    assert [row[:2] for row in rows] == [["3", "T2"], ["3", "T5"], ["2", "T2"], ["2", "T5"]]
    for row in rows:
        assert row[2:] == ["64", "0", f"0.0 (0.0 … {most:.1f})", f"10.9 ({low:.1f} … {high:.1f})"]


def test_captures_are_those_of_the_runs_that_are_compared() -> None:
    runs = 5
    for case in CASES[:2]:
        whole = compare(case, "T5", 5.0, runs=runs, seed=3)
        found = captures("T5", 5.0, case.transmitters, range(runs), 3)
        assert (found.runs, found.laisn, found.tight) == (runs, whole.laisn_captured, whole.tight_captured)


def test_a_leader_that_weaves_keeps_to_its_legs_by_5_degrees_and_to_its_corners() -> None:
    route = library_route("L")
    points = np.array(missions._weaving(route))
    corners = points[np.isin(points[:, 0], route.time)]
    np.testing.assert_allclose(corners[:, 1:], route.waypoint)
    way = np.diff(points[:, 1:], axis=0)
    heading = np.arctan2(*way.T)
    for k in range(len(route.time) - 1):
        leg = np.arctan2(*(route.waypoint[k + 1] - route.waypoint[k]))
        # but for the legs to and from a corner
        inner = (points[:-1, 0] > route.time[k] + 1) & (points[1:, 0] < route.time[k + 1] - 1)
        off = np.angle(np.exp(1j * (heading[inner] - leg)))
        np.testing.assert_allclose(np.abs(off), WEAVE, rtol=1e-9)
        assert np.all(off[1:] * off[:-1] < 0.0)


def test_a_weaving_leader_tells_two_transmitters_the_side() -> None:
    straight, weaving = (compare(CASES[1], "T5", 5.0, runs=6, seed=5, weave=weave) for weave in (False, True))
    assert weaving.bound_rms < 0.8 * straight.bound_rms
    assert weaving.tight_rms < 0.8 * straight.tight_rms


def test_a_physical_mission_is_flown_by_both_and_the_sea_matters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "least_rms", lambda *_: np.array([3.0, 4.0]))
    one = at_sea("waves", "T6", 2)
    assert 0.01 < one.tight_mean < one.laisn_mean
    # over all instants alike
    assert one.bound_rms == pytest.approx(np.sqrt(12.5))
    assert one.nees < 5.0


def test_the_bound_of_a_mission_is_that_of_its_transmitters_over_all_instants(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    lags: list[float] = []

    def least(geometry: Any, noise: Any, lag: float) -> Any:
        lags.append(lag)
        asked.append((geometry.arms.shape[1], noise))
        return np.array([3.0, 4.0])

    monkeypatch.setattr(missions, "least_rms", least)
    assert missions.bound_rms.__wrapped__("T9", 5.0, 2) == pytest.approx(np.sqrt(12.5))
    everything = Assume(exact_leader=False, drift=True, current=True, offsets=True)
    missions.bound_rms.__wrapped__("T9", 5.0, 3, assume=everything)
    assert missions.bound_rms.__wrapped__("T9", 5.0, 3, lag=60.0) == pytest.approx(np.sqrt(12.5))
    assert lags == [0.0, 0.0, 60.0]
    # drift at a quarter of 2.5 mm/s and 1.7 mrad in a second is the slower of its two modes
    walks = {"speed_walk": 6.25e-4, "heading_walk": 4.25e-4, "current_walk": 1e-3}
    unknown = TrueNoise(
        leader_heading_bias=float(np.deg2rad(6.0)), current=0.4, range_offset=0.015, leader_way_sigma=0.05
    )
    assert asked[0] == (2, TrueNoise())
    assert asked[1][0] == 3
    assert asdict(asked[1][1]) == pytest.approx(asdict(unknown) | walks, rel=1e-12)


@pytest.mark.parametrize("state", ["leader_heading_bias", "current", "range_offset", "clock_offset", "clock_drift"])
def test_a_bound_leaves_open_what_is_not_assumed_to_be_known(state: str) -> None:
    """Each alone beside what is open in any case; a current and a leader's compass show in the leader's way."""
    assume = {"leader_heading_bias": Assume(exact_leader=False), "current": Assume(current=True),
              "range_offset": Assume(offsets=True), "clock_offset": Assume(clock=True),
              "clock_drift": Assume(clock=True)}[state]  # fmt: skip
    told, noise = TightSettings(), missions.noise_known(assume)
    usual = {"leader_heading_bias": told.leader_heading_bias_sigma, "current": told.current_sigma,
             "range_offset": told.offset_sigma, "clock_offset": told.clock_offset_sigma,
             "clock_drift": told.clock_drift_sigma}  # fmt: skip
    for name, sigma in usual.items():
        both = name.startswith("clock") and state.startswith("clock")
        assert getattr(noise, name) == (sigma if name == state or both else 0.0)
    assert (noise.clock_walk > 0.0) == state.startswith("clock")
    assert (noise.leader_way_sigma > 0.0) == (state in ("leader_heading_bias", "current"))
    assert (noise.current_walk > 0.0) == (state == "current")
    assert noise.speed_walk == noise.heading_walk == 0.0


def test_settings_are_varied_by_their_factor() -> None:
    usual = TightSettings()
    for sigma in SIGMAS:
        assert getattr(plan._scaled(sigma, 0.5), sigma) == 0.5 * getattr(usual, sigma) > 0.0
    assert plan._scaled("range_sigma", 2.0) == replace(usual, range_sigma=2.0 * usual.range_sigma)


def test_the_plan_names_every_task_once_and_flies_every_case() -> None:
    names = [name for name, _ in tasks(Size())]
    assert len(set(names)) == len(names)
    assert len({key_of(task.func, task.args, task.keywords) for _, task in tasks(Size())}) == len(names)
    cases = [name for name in names if name[0] == "case"]
    assert len(cases) == 7 * 2 * 8
    assert sum(1 for name in names if name[0] == "captures") == 4 * -(-10_000 // 640)
    # a first look has few runs, and fewer where settings are varied
    assert QUICK.varied < QUICK.runs < Size().varied < Size().runs
    assert QUICK.varied > 1, "of one run there is no scatter"


def cost(route: str) -> ClockCost:
    """Twice the error before the turn, and 1.2 or 1.6 times after it."""
    exact, after = np.array([0.3, 0.5]), 1.2 if route == "T2" else 1.6
    return ClockCost(
        route=route, before_exact=exact, before_unknown=2.0 * exact, after_exact=exact, after_unknown=after * exact,
        before_bound=2.5, after_bound=1.1,
    )  # fmt: skip


def test_what_a_clock_costs_is_the_ratio_of_the_same_runs(found: dict[tuple[Any, ...], Any]) -> None:
    findings = study.findings_of(found)
    for name, value in (("clock before", 2.0), ("clock after", 1.4), ("clock-worst after", 1.6),
                        ("clock-bound before", 2.5), ("clock-bound-worst after", 1.1)):  # fmt: skip
        assert findings[name].value == pytest.approx(value)


def test_an_unknown_clock_costs_more_before_the_first_turn_than_after_it() -> None:
    one = clock_cost("T3", 5.0, 3, runs=4, seed=3)
    assert 1.0 < one.after_bound < 1.5 < one.before_bound
    assert one.after_unknown.mean() < 2.0 * one.after_exact.mean()
    assert one.before_unknown.mean() > 1.3 * one.before_exact.mean()


@pytest.fixture(scope="module")
def found() -> dict[tuple[Any, ...], Any]:
    """What a study might have come to, without flying it."""
    rng = np.random.default_rng(7)
    return {
        name: Captured(runs=QUICK.captures, laisn=7, tight=0)
        if name[0] == "captures"
        else cost(name[1])
        if name[0] == "clock"
        else plain(name[-1], name[-2])
        if name[0] == "ekf"
        else replace(made(rng, runs=25), smoothing=0.6 if name[0] == "case" else float("nan"))
        for name, _ in tasks(QUICK)
    }


def plain(route: str, interval: float) -> Plain:
    """Ten of 25 runs captured, with errors of 2 m and NEES of 6."""
    each = np.ones(25)
    return Plain(route=route, interval=interval, means=2.0 * each, squares=5.0 * each, normalised=6.0 * each,
                 lost=np.arange(25) < 10)  # fmt: skip


def test_a_plain_filter_is_held_against_the_tightly_coupled_navigator_route_by_route() -> None:
    tight, plains = (
        [of_hand("T2", 0.5, 1.0, 0, 0, 25), of_hand("T5", 1.5, 1.0, 0, 0, 25)],
        [plain("T2", 1.0), plain("T5", 1.0)],
    )
    named: dict[str, Any] = {}
    study._of_plain("G", plains, tight, named)
    values = {key: finding.value for key, finding in named.items()}
    assert values == pytest.approx(
        {"ekf G": 2.0, "over-ekf G": 0.5, "over-ekf G T2": 0.25, "over-ekf G T5": 0.75, "ekf G T2": 2.0,
         "ekf G T5": 2.0, "ekf-nees G": 6.0, "ekf-captured G": 0.4}
    )  # fmt: skip


def test_a_plain_filter_flies_the_noise_of_the_others() -> None:
    """Its runs are those that `filter_runs` makes of the measurements that `compare` takes."""
    found = plain_filter(CASES[1], "T3", 5.0, runs=2, seed=3)
    truth, errors = missions.mission("T3", 5.0, 0.0)
    given = [measure(truth, errors, seed=3, run=run) for run in range(2)]
    flown = filter_runs(TightSettings(transmitters=2), given, truth.start)
    error = np.linalg.norm(flown.position - truth.hydrophone, axis=-1)
    assert found.means == pytest.approx(error.mean(axis=1), rel=1e-12)
    assert found.squares == pytest.approx(np.mean(error**2, axis=1), rel=1e-12)
    away = flown.position[0, -1] - truth.hydrophone[-1]
    xx, xy, yy = flown.covariance[0, -1]
    spread = np.array([[xx, xy], [xy, yy]])
    assert nees(away[None], flown.covariance[0, -1:])[0] == pytest.approx(away @ np.linalg.solve(spread, away))
    assert found.normalised.shape == found.lost.shape == (2,)
    assert not found.lost.any()


def test_none_of_n_captured_has_the_interval_of_clopper_and_pearson(found: dict[tuple[Any, ...], Any]) -> None:
    findings = study.findings_of(found)
    none = findings["many 3 T5"]
    assert (none.value, none.low) == (0.0, 0.0)
    exact = stats.binomtest(0, QUICK.captures).proportion_ci(0.95, "exact")
    assert none.high == pytest.approx(exact.high, rel=1e-4)
    assert findings["many-laisn-2 3 T5"].value == pytest.approx(7 / QUICK.captures, rel=1e-4)
    assert findings["ratio G1 5"].value == pytest.approx(0.25)
    for weave, how in ((False, "straight"), (True, "weaving")):
        one = found["weave", weave, "T5"]
        assert findings[f"rms {how} T5"].value == pytest.approx(np.sqrt(np.mean(one.tight_means**2)), rel=1e-5)
        assert findings[f"rms-bound {how} T5"].value == 0.15
    assert {f"nees sea {sea}" for sea in SEAS} <= set(findings.findings)
    for offset in OFFSETS_M:
        flown = study.chosen(found, "offset", offset)
        expected = np.mean([one.tight_means for one in flown])
        assert findings[f"error offset {offset:g}"].value == pytest.approx(expected, rel=1e-5)


def test_the_page_tells_all_of_it(found: dict[tuple[Any, ...], Any], tmp_path: Path) -> None:
    page = write_page(study.findings_of(found), found, tmp_path / "report.html", quick=True)
    text = page.read_text(encoding="utf-8")
    for words in (
        "At sea",
        "Model errors",
        "An unknown clock",
        "Wrong settings",
        "A leader that weaves",
        "Route by route",
        "Trial run",
    ):
        assert words in text
    for case in CASES:
        assert case.title.replace("'", "&#39;") in text
    # 0.15 m over five times the navigator's own RMS error
    least = np.median([0.15 / (5.0 * one.tight_rms) for one in study.chosen(found, "case", "G7", 5.0)])
    assert f"In G7 the bound is {least:.2f} of" in text
    assert "0.60 and 0.60 in G5, 0.60 and 0.60 in G6." in text


def test_the_bound_of_a_mission_is_printed_and_written(tmp_path: Path) -> None:
    short = ["--set", "duration_s=30", "--set", "motion=kinematic"]
    out = tmp_path / "bound.csv"
    result = CliRunner().invoke(app, ["bound", "T5", *short, "--runs", "3", "--out", str(out)], env={"COLUMNS": "160"})
    assert result.exit_code == 0, result.output
    assert "laisn-2, 3 runs" in result.output
    lines = out.read_text().splitlines()
    assert lines[0] == "follower,time_s,bound_m"
    assert len(lines) == 301
    wrong = CliRunner().invoke(app, ["bound", "T5", *short, "--out", "bound.txt"])
    assert wrong.exit_code != 0


def test_what_smoothing_could_leave_is_one_bound_over_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paired, "bound_rms", lambda *given: 0.3 if given[-1] == 60.0 else 0.5)
    assert paired.smoothing(CASES[4], "T2", 5.0) == pytest.approx(0.6)
