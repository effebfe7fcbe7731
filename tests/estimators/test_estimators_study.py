"""The study of the estimators: its figures of merit, its plan, its record and its page."""

import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

from experiments.campaign.store import key_of
from experiments.command.cli import app
from experiments.studies.estimators import findings, runs, study
from experiments.studies.estimators.cases import CASES, OFFSETS_M, SEAS, SIGMAS
from experiments.studies.estimators.runs import (
    WEAVE,
    at_sea,
    clock_cost,
    compare,
    mirror_locks,
    nees,
    plain_filter,
    scenario_of,
    share_inside,
)
from experiments.studies.estimators.study import QUICK, Size, tasks, write_page
from laisn.bound import TrueNoise
from laisn.rivals.kalman import RangeFilter
from laisn.tight.settings import Assume, TightSettings
from sim.scenario.routes import library_route
from sim.sensing.observation import measure

Row = dict[str, Any]


def made(rng: np.random.Generator, *, runs: int = 40, route: str = "T2", lost: int = 0) -> Row:
    """Figures of runs whose squared errors are those that their covariance predicts."""
    tight = rng.uniform(0.1, 0.3, runs)
    return {
        "route": route,
        "interval": 5.0,
        "laisn_means": 4.0 * tight,
        "laisn_squares": (5.0 * tight) ** 2,
        "tight_means": tight,
        "tight_squares": tight**2,
        "largest": 3.0 * tight,
        "normalised": rng.chisquare(2, (200, runs)).mean(axis=0),
        "residuals": np.ones(runs),
        "laisn_lost": np.ones(runs),
        "tight_lost": (np.arange(runs) < lost).astype(np.float64),
        "inside": 0.95,
        "bound_rms": 0.15,
    }


def test_a_right_covariance_is_within_its_interval_95_percent_of_the_time_and_a_wrong_one_is_not() -> None:
    rng = np.random.default_rng(0)
    for scale in (1.0, 0.7, 1.5):
        # of 40 runs, squares add up to χ² of 80 degrees of freedom times the scale
        limits = stats.chi2.ppf([0.025, 0.975], 80) / scale
        share = float(np.diff(stats.chi2.cdf(limits, 80))[0])
        found = share_inside(scale * rng.chisquare(80, 1000), 40)
        assert found == pytest.approx(share, abs=5 * np.sqrt(share * (1 - share) / 1000))


def test_figures_of_all_runs_are_means_roots_and_counts_over_them() -> None:
    one = made(np.random.default_rng(1), lost=3)
    found = findings.of_route(one)
    assert found["ratio"] == pytest.approx(0.25)
    assert found["rms"] == pytest.approx(np.sqrt(np.mean(one["tight_means"] ** 2)))
    assert found["over_bound"] == pytest.approx(found["rms"] / 0.15)
    assert found["bound_over_laisn"] == pytest.approx(0.15 / (5.0 * found["rms"]))
    assert (found["mirror_locked"], found["laisn_mirror_locked"]) == (3, 40)
    assert found["nees"] == pytest.approx(2.0, abs=0.15)
    assert findings.of_route(one | {"bound_rms": None})["over_bound"] is None


def test_a_ratio_over_missions_is_the_median_of_theirs() -> None:
    rng = np.random.default_rng(2)
    flown = [made(rng) for _ in range(3)]
    value, low, high = findings.median_ratio(flown)
    assert (value, low, high) == pytest.approx((0.25, 0.25, 0.25))
    mean = findings.mean_of(flown, "tight_means")
    every = np.concatenate([one["tight_means"] for one in flown])
    assert mean.value == pytest.approx(every.mean())
    # the interval of the mean is that of the normal law, nearly
    half = 1.96 * np.mean([one["tight_means"] for one in flown], axis=0).std() / np.sqrt(40)
    assert (mean.high - mean.low) / 2 == pytest.approx(half, rel=0.15)


def of_hand(route: str, error: float, laisn: float, lost: int, laisn_lost: int, runs: int = 20) -> Row:
    """A mission all of whose runs are alike, but for those that are mirror-locked."""
    each = np.ones(runs)
    return {
        "route": route, "interval": 5.0, "laisn_means": laisn * each,
        "laisn_squares": (1.25 * laisn) ** 2 * each, "tight_means": error * each,
        "tight_squares": (2.0 * error) ** 2 * each, "largest": np.linspace(0.0, 7.0 * error, runs),
        "normalised": 10.0 * error * each, "inside": error, "residuals": 3.0 * error * each,
        "laisn_lost": (np.arange(runs) < laisn_lost).astype(np.float64),
        "tight_lost": (np.arange(runs) < lost).astype(np.float64), "bound_rms": 0.5, "smoothing": error + 0.1,
    }  # fmt: skip


def test_missions_together_are_means_medians_and_extremes_of_theirs() -> None:
    flown = [of_hand("T2", 0.2, 1.0, 0, 5), of_hand("T3", 0.4, 1.0, 3, 6), of_hand("T4", 0.9, 1.5, 0, 1)]
    named = findings.of_missions("G", flown)
    values = {key.removesuffix(" G"): finding.value for key, finding in named.items()}
    assert values == pytest.approx(
        {
            "ratio": 0.4, "worst": 0.6, "error": 0.5, "laisn-2": 3.5 / 3, "largest": 6.3, "nees": 5.0,
            "nees-least": 2.0, "nees-most": 9.0, "inside": 0.5, "nis": 1.5, "mirror-locked": 3 / 60,
            "mirror-locked-runs": 3, "mirror-locked-laisn-2": 12 / 60, "bound": 1.6, "bound-worst": 3.6,
            # 0.5 m over 1.25, 1.25 and 1.875 m
            "least": 0.4, "smoothing": 0.5,
        },
        rel=1e-5,
    )  # fmt: skip
    exact = stats.binomtest(12, 60).proportion_ci(0.95, "exact")
    limits = named["mirror-locked-laisn-2 G"]
    assert (limits.low, limits.high) == pytest.approx((exact.low, exact.high), rel=1e-5)
    assert named["mirror-locked-runs G"].what == "runs locked on the mirror image of 60"
    even = findings.median_ratio(flown[:2])
    assert even.value == pytest.approx(0.3)


def test_captures_are_those_of_the_runs_that_are_compared() -> None:
    runs = 5
    for case in CASES[:2]:
        whole = compare(case, "T5", 5.0, runs=runs, seed=3)
        found = mirror_locks("T5", 5.0, case.transmitters, range(runs), 3)
        lost = {who: whole[f"{who}_lost"].sum() for who in ("laisn", "tight")}
        assert found == {"runs": runs, **lost}


def test_a_leader_that_weaves_keeps_to_its_legs_by_5_degrees_and_to_its_corners() -> None:
    route = library_route("L")
    points = np.array(runs.weaving(route))
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
    assert weaving["bound_rms"] < 0.8 * straight["bound_rms"]
    assert weaving["tight_squares"].mean() < 0.8**2 * straight["tight_squares"].mean()


def test_a_physical_mission_is_flown_by_both_and_the_sea_matters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "least_rms", lambda *_: np.array([3.0, 4.0]))
    one = at_sea("waves", "T6", runs=2, seed=12)
    assert 0.01 < one["tight_means"].mean() < one["laisn_means"].mean()
    # over all instants alike
    assert one["bound_rms"] == pytest.approx(np.sqrt(12.5))
    assert one["normalised"].mean() < 5.0


def test_the_bound_of_a_mission_is_that_of_its_transmitters_over_all_instants(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    lags: list[float] = []

    def least(geometry: Any, noise: Any, lag: float) -> Any:
        lags.append(lag)
        asked.append((geometry.arms.shape[1], noise))
        return np.array([3.0, 4.0])

    monkeypatch.setattr(runs, "least_rms", least)
    uncached, known = runs.bound.__wrapped__, Assume()
    assert runs.rms(uncached(scenario_of("T9", 5.0), 2, known)) == pytest.approx(np.sqrt(12.5))
    everything = Assume(exact_leader=False, drift=True, current=True, offsets=True)
    uncached(scenario_of("T9", 5.0), 3, everything)
    uncached(scenario_of("T9", 5.0), 3, known, 60.0)
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
    told, noise = TightSettings(), runs.noise_known(assume)
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
        assert getattr(study._scaled(sigma, 0.5), sigma) == 0.5 * getattr(usual, sigma) > 0.0
    assert study._scaled("range_sigma", 2.0) == replace(usual, range_sigma=2.0 * usual.range_sigma)


def test_the_plan_names_every_task_once_and_flies_every_case() -> None:
    names = [name for name, _ in tasks(Size())]
    assert len(set(names)) == len(names)
    assert len({key_of(task) for _, task in tasks(Size())}) == len(names)
    cases = [name for name in names if name[0] == "case"]
    assert len(cases) == 7 * 2 * 8
    assert sum(1 for name in names if name[0] == "mirror_locks") == 4 * -(-10_000 // 640)
    # a first look has few runs, and fewer where settings are varied
    assert QUICK.varied < QUICK.runs < Size().varied < Size().runs
    assert QUICK.varied > 1, "of one run there is no scatter"


def cost(route: str) -> Row:
    """Twice the error before the turn, and 1.2 or 1.6 times after it."""
    exact = np.array([[0.3, 0.3], [0.5, 0.5]])
    after = 1.2 if route == "T2" else 1.6
    return {"route": route, "exact": exact, "unknown": exact * [2.0, after], "bound": np.array([2.5, 1.1])}


def test_what_a_clock_costs_is_the_ratio_of_the_same_runs(found: dict[tuple[Any, ...], Any]) -> None:
    record = findings.findings_of(found)
    for name, value in (("clock before", 2.0), ("clock after", 1.4), ("clock-worst after", 1.6),
                        ("clock-bound before", 2.5), ("clock-bound-worst after", 1.1)):  # fmt: skip
        assert record[name].value == pytest.approx(value)


def test_an_unknown_clock_costs_more_before_the_first_turn_than_after_it() -> None:
    one = clock_cost("T3", 5.0, 3, runs=4, seed=3)
    before, after = one["unknown"].mean(axis=0) / one["exact"].mean(axis=0)
    assert 1.0 < one["bound"][1] < 1.5 < one["bound"][0]
    assert after < 2.0
    assert before > 1.3


@pytest.fixture(scope="module")
def found() -> dict[tuple[Any, ...], Any]:
    """What a study might have come to, without flying it."""
    rng = np.random.default_rng(7)
    kinds: dict[str, Any] = {
        "mirror_locks": lambda name: {"runs": QUICK.mirror_locks, "laisn": 7, "tight": 0},
        "clock": lambda name: cost(name[1]),
        "ekf": lambda name: plain(name[-1]),
        "case": lambda name: made(rng, runs=25) | {"smoothing": 0.6},
    }
    return {name: kinds.get(name[0], lambda _: made(rng, runs=25))(name) for name, _ in tasks(QUICK)}


def plain(route: str) -> Row:
    """Ten of 25 runs locked on the mirror image, with errors of 2 m and NEES of 6."""
    each = np.ones(25)
    return {"route": route, "means": 2.0 * each, "normalised": 6.0 * each, "lost": 1.0 * (np.arange(25) < 10)}


def test_a_plain_filter_is_held_against_the_tightly_coupled_navigator_route_by_route() -> None:
    tight, plains = (
        [of_hand("T2", 0.5, 1.0, 0, 0, 25), of_hand("T5", 1.5, 1.0, 0, 0, 25)],
        [plain("T2"), plain("T5")],
    )
    values = {key: finding.value for key, finding in findings.of_plain_filter("G", plains, tight).items()}
    assert values == pytest.approx(
        {"ekf G": 2.0, "over-ekf G": 0.5, "over-ekf G T2": 0.25, "over-ekf G T5": 0.75, "ekf G T2": 2.0,
         "ekf G T5": 2.0, "ekf-nees G": 6.0, "ekf-mirror-locked G": 0.4}
    )  # fmt: skip


def test_a_plain_filter_flies_the_noise_of_the_others() -> None:
    """Its runs are those of the measurements that `compare` takes."""
    found = plain_filter(CASES[1], "T3", 5.0, runs=2, seed=3)
    truth, errors = runs.mission("T3", 5.0)
    given = [measure(truth, errors, seed=3, run=run) for run in range(2)]
    flown = [RangeFilter(TightSettings(transmitters=2), truth.start).run(one) for one in given]
    error = np.linalg.norm(np.array([one.state[:, :2] for one in flown]) - truth.hydrophone, axis=-1)
    assert found["means"] == pytest.approx(error.mean(axis=1), rel=1e-12)
    away, spread = flown[0].state[-1, :2] - truth.hydrophone[-1], flown[0].covariance[-1, :2, :2]
    assert nees(away[None], spread[None, (0, 0, 1), (0, 1, 1)])[0] == pytest.approx(
        away @ np.linalg.solve(spread, away)
    )
    assert found["normalised"].shape == found["lost"].shape == (2,)
    assert not found["lost"].any()


def test_none_of_n_captured_has_the_interval_of_clopper_and_pearson(found: dict[tuple[Any, ...], Any]) -> None:
    record = findings.findings_of(found)
    none = record["many 3 T5"]
    assert (none.value, none.low) == (0.0, 0.0)
    exact = stats.binomtest(0, QUICK.mirror_locks).proportion_ci(0.95, "exact")
    assert none.high == pytest.approx(exact.high, rel=1e-4)
    assert record["many-laisn-2 3 T5"].value == pytest.approx(7 / QUICK.mirror_locks, rel=1e-4)
    assert record["ratio G1 5"].value == pytest.approx(0.25)
    for weave, how in ((False, "straight"), (True, "weaving")):
        one = found["weave", weave, "T5"]
        assert record[f"rms {how} T5"].value == pytest.approx(np.sqrt(np.mean(one["tight_means"] ** 2)), rel=1e-5)
        assert record[f"rms-bound {how} T5"].value == 0.15
    assert {f"nees sea {sea}" for sea in SEAS} <= set(record.findings)
    for offset in OFFSETS_M:
        flown = findings.chosen(found, "offset", offset)
        expected = np.mean([one["tight_means"] for one in flown])
        assert record[f"error offset {offset:g}"].value == pytest.approx(expected, rel=1e-5)


def test_the_page_tells_all_of_it(found: dict[tuple[Any, ...], Any], tmp_path: Path) -> None:
    page = write_page(findings.findings_of(found), found, tmp_path / "report.html", quick=True)
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
    least = np.median([0.03 / findings.of_route(one)["rms"] for one in findings.chosen(found, "case", "G7", 5.0)])
    assert f"In G7 the bound is {least:.2f} of" in text
    assert "0.60 and 0.60 in G5, 0.60 and 0.60 in G6." in text


def test_cells_of_the_page_are_findings_of_their_row(found: dict[tuple[Any, ...], Any], tmp_path: Path) -> None:
    record = findings.findings_of(found)
    page = write_page(record, found, tmp_path / "report.html", quick=True).read_text(encoding="utf-8")
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", line) for line in page.splitlines() if line.startswith("<tr><td")]
    (halved,) = (row for row in rows if row[:2] == ["range sigma", "halved"])
    assert halved[2] == format(record["error sigma range_sigma 0.5"], ".2f i")
    assert halved[3] == format(record["laisn-2 sigma range_sigma 0.5"], ".2f i")
    assert halved[-2:] == [format(record[f"{name} sigma range_sigma 0.5"], ".1% i")
                           for name in ("mirror-locked", "mirror-locked-laisn-2")]  # fmt: skip
    (case,) = (row for row in rows if row[:3] == ["G3", CASES[2].title, "5"] and len(row) == 18)
    assert case[-1] == "0.60"
    low, high = (100 * limit for limit in stats.binomtest(7, 64).proportion_ci(0.95, "exact"))
    most = 100 * stats.binomtest(0, 64).proportion_ci(0.95, "exact").high
    shares = [f"0.00 % (0.00 to {most:.2f} %)", f"10.9 % ({low:.1f} to {high:.1f} %)"]
    for transmitters, route in (("3", "T2"), ("3", "T5"), ("2", "T2"), ("2", "T5")):
        assert [transmitters, route, "64", "0", *shares] in rows


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
    monkeypatch.setattr(runs, "bound", lambda *given: np.array([0.3 if given[-1] == 60.0 else 0.5]))
    assert compare(CASES[4], "T2", 5.0, runs=1, seed=1, smoothing=True)["smoothing"] == pytest.approx(0.6)
