"""The study of rival methods: its design, its findings as functions of rows, and its page."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.flight.library import load_scenario
from experiments.studies.rivals import figures, findings
from experiments.study.file import built_in_files, study_of
from experiments.study.plan import StudyPlan, plan_of
from experiments.study.run import Cells
from laisn.navigators import NAVIGATORS, find
from reports.findings import read_findings, record
from reports.page import page_of, render
from sim.scenario.settings import Scenario
from tests.experiments.study.cells import cells_of
from tests.golden import require_golden

PARTS = built_in_files("rivals")
ROUTE_CASES = [*product(findings.NAVIGATORS, findings.CONDITIONS, findings.INTERVALS)]
SLOW_CASES = [case for case in ROUTE_CASES if case[0] == findings.SLOW]


@pytest.fixture(scope="module")
def plans() -> dict[str, StudyPlan]:
    return {part: plan_of(study_of(str(file), {})) for part, file in PARTS.items()}


def cells_with(
    error: float, runs: int, routes: int, *, by_route: float = 0.1, **others: float
) -> Cells:
    """Cells whose errors have this mean over runs and routes; runs add ± 0.01 m, route i adds
    i times `by_route` less its mean.
    """
    shift = by_route * (np.arange(routes) - (routes - 1) / 2)
    records = [
        [
            {
                "e_p_mean_m": error + shift[route] + 0.01 * (-1) ** run,
                "e_p_p95_m": 2 * error,
                "nees": 2.5,
                "e_p_max_m": 3.0,
                "mirror_locked": 0.0,
                "track_error_rms_m": 1.0,
                "track_error_end_m": 2.0,
                **others,
            }
            for route in range(routes)
        ]
        for run in range(runs)
    ]
    return cells_of({"": records})


def findings_without(navigator: str = "") -> dict[str, Any]:
    """All findings of made-up cells, but for those of a navigator that was left out."""
    errors = dict(
        zip(
            findings.NAVIGATORS,
            (0.9, 0.8, 0.7, 0.3, 0.25, 9.0, 8.0, 7.0, 0.35, 0.33, 0.5, 0.4, 0.2),
            strict=True,
        )
    )
    shared_cases = [*product(findings.SHARING, ["calm"], findings.SHARED_INTERVALS)]
    arms = {
        findings.case_name(*case): cells_with(errors[case[0]], 4, 8)
        for case in (*ROUTE_CASES, *shared_cases)
        if case[0] != findings.SLOW
    }
    arms |= {
        findings.case_name(*case): cells_with(errors[findings.SLOW], 2, 8) for case in SLOW_CASES
    }
    arms["owtt calm 5"] = cells_with(7.0, 4, 8, e_p_max_m=60.0)
    for interval, error in (
        (1.0, 0.1),
        (2.0, 0.2),
        (5.0, 0.4),
        (10.0, 0.8),
        (20.0, 1.6),
        (50.0, 4.0),
    ):
        arms[f"ekf calm {interval:g}"] = cells_with(error, 4, 8)
    two_transmitters = product(findings.WITH_TWO, [findings.TWO], findings.INTERVALS)
    arms |= {
        findings.case_name(*case): cells_with(errors[case[0]], 4, 8) for case in two_transmitters
    }
    arms["imm two 5"] = cells_with(0.25, 4, 8)
    arms["tight-steady two 5"] = cells_with(0.28, 4, 8, by_route=0.12)
    closed = {
        f"{name} {condition}": cells_with(1.0, 2, 8)
        for name, condition in product(findings.NAVIGATORS, findings.CONDITIONS)
    }
    factors = product(findings.MAPPED, findings.RANGES_M, findings.BIASES_DEG, findings.BASELINES_M)
    points = {
        f"map {name} {distance} {bias:g} {baseline:g}": cells_with(0.5, 4, 1)
        for name, distance, bias, baseline in factors
    }
    points["map inverted-usbl 20 0 2"] = cells_with(0.4, 4, 1)
    points["map inverted-usbl 200 0 2"] = cells_with(0.6, 4, 1)
    times = dict.fromkeys(findings.NAVIGATORS, 12.5)
    if navigator:
        arms = {case: cells for case, cells in arms.items() if case.split()[0] != navigator}
        closed = {case: cells for case, cells in closed.items() if case.split()[0] != navigator}
        del times[navigator]
    return findings.findings_of_rows(arms, closed, points, times)


@pytest.fixture(scope="module")
def actual() -> dict[str, Any]:
    return findings_without()


@pytest.mark.system
def test_every_case_is_valid_and_every_navigator_is_simulated(plans: dict[str, StudyPlan]) -> None:
    simulated = set(findings.NAVIGATORS) - {findings.STEADY}
    assert simulated == set(NAVIGATORS) - {"laisn-best", "laisn-main", "beacons"}
    for part, plan in plans.items():
        assert all(entry.closed_loop == (part == "closed") for entry in plan.entries)
        for entry in plan.entries:
            steady = entry.arm == findings.STEADY
            assert entry.scenario.navigation.variant == ("tight" if steady else entry.arm)
            assert entry.scenario.navigation.assume.steady_speed == steady
    cases = [
        (
            entry.arm,
            plan.points[entry.point]["case"],
            plan.points[entry.point][findings.MESSAGE_INTERVAL],
        )
        for plan in (plans[part] for part in ("routes", "slow"))
        for entry in plan.entries
    ]
    assert len(set(cases)) == len(cases)
    assert set(ROUTE_CASES) == set(cases)
    closed = plans["closed"]
    closed_cases = {(entry.arm, closed.points[entry.point]["case"]) for entry in closed.entries}
    assert closed_cases == set(product(findings.NAVIGATORS, findings.CONDITIONS))
    runs = {part: plan.study.runs for part, plan in plans.items()}
    assert runs == {"routes": 20, "two": 20, "shared": 3, "slow": 6, "closed": 2, "map": 4}
    two = plans["two"]
    assert {entry.arm for entry in two.entries} == set(findings.WITH_TWO)
    assert {entry.scenario.navigation.transmitters for entry in two.entries} == {2}


def test_the_follower_of_the_map_stays_at_its_distance_on_the_quarter(
    plans: dict[str, StudyPlan],
) -> None:
    plan = plans["map"]
    for entry in plan.entries:
        (_, east, north), (end_time, last_east, last_north) = entry.scenario.followers[0].waypoints
        assert np.hypot(east, north) == pytest.approx(
            float(plan.points[entry.point]["case"]), rel=1e-12
        )
        assert (east, last_east, end_time) == (-north, east, 300.0)
        assert last_north == pytest.approx(north + 300.0, rel=1e-12)


def test_findings_are_the_means_fractions_and_differences_of_the_cells(
    actual: dict[str, Any],
) -> None:
    error = actual["error tight calm 5"]
    assert error.value == pytest.approx(0.3)
    # each route: variance 0.01² · 4/3 of four runs; of the mean of eight routes a 32nd
    assert error.high - error.value == pytest.approx(
        1.959964 * 0.01 * np.sqrt(4 / 3 / 32), rel=1e-3
    )
    difference = actual["less tight inverted-usbl calm 5"]
    assert (difference.value, difference.low, difference.high) == pytest.approx((-0.1, -0.1, -0.1))
    assert (
        actual["better-than tight inverted-usbl"].value
        == actual["cases tight inverted-usbl"].value
        == 12
    )
    assert actual["cases tight factor-graph"].value == 12
    # the 12 against the inverted USBL, that against the filter on ranges with a message each second
    # and one with two transmitters
    assert actual["better-than tight"].value == 14
    assert actual["cases tight imm"].value == 15
    assert actual["less tight imm two 5"].value == pytest.approx(-0.05)
    assert "less laisn-3-2 imm two 5" not in actual
    # the last of eight routes is 0.35 m above the mean
    assert actual["worst tight calm 5"].value == pytest.approx(0.65)
    assert actual["best-rival"].value == "inverted-usbl"
    lost = actual["lost owtt calm 5"]
    assert lost.value == 1.0
    # Clopper and Pearson of 32 of 32
    assert lost.low == pytest.approx(0.025 ** (1 / 32), rel=1e-4)
    assert actual["lost tight calm 5"].value == 0.0
    assert actual["high ekf calm 5"].value == pytest.approx(0.8)


def test_the_steady_speed_is_compared_over_all_routes_and_on_its_best_and_worst(
    actual: dict[str, Any],
) -> None:
    assert actual["less tight tight-steady calm 5"].value == pytest.approx(-0.05)
    # 0.02 m a route about the mean difference of −0.02 m: seven steps from the first to the last
    assert actual["less tight tight-steady two 5"].value == pytest.approx(-0.02)
    assert actual["least tight tight-steady two 5"].value == pytest.approx(-0.02 - 3.5 * 0.02)
    assert actual["most tight tight-steady two 5"].value == pytest.approx(-0.02 + 3.5 * 0.02)
    # a setting of the same navigator is no rival
    assert "better-than tight tight-steady" not in actual


def test_the_maps_have_their_points_and_their_intervals(actual: dict[str, Any]) -> None:
    assert (actual["map-better"].value, actual["map-points"].value) == (1, 36)
    assert actual["map-less 200 0 2"].value == pytest.approx(0.1)
    # ten vehicles, 150 m: ten times 0.1 s and 300 m at 1500 m/s
    assert actual["turn 10 150"].value == pytest.approx(3.0)
    # between 0.2 m at 2 s and 0.4 m at 5 s on logarithmic scales
    fraction = np.log(3.0 / 2.0) / np.log(5.0 / 2.0)
    assert actual["shared ekf 10 150"].value == pytest.approx(0.2 * 2.0**fraction, rel=1e-5)
    assert actual["shared ekf 1 50"].value == pytest.approx(0.1)


def test_the_page_is_the_golden_one(actual: dict[str, Any]) -> None:
    """The record of made-up cells, whose errors `findings_without` states."""
    findings_record = record(
        "rivals", "laisn rivals", ("experiments.studies.rivals.findings",), actual
    )
    values = {"quick": False, "found": findings_record, **figures.values(findings_record, {})}
    require_golden(page_of("experiments.studies.rivals", [], values, findings_record), "rivals")


def test_the_page_is_made_without_a_navigator_that_was_left_out(tmp_path: Path) -> None:
    all_findings = findings_without()
    actual = findings_without(findings.SLOW)
    assert {key for key in all_findings if key not in actual} == {
        key for key in all_findings if findings.SLOW in key
    } | {"slow-runs"}
    record("rivals", "laisn rivals", ("experiments.studies.rivals.findings",), actual).write(
        tmp_path / "results.json"
    )
    findings_record = read_findings(tmp_path / "results.json")
    values = {"quick": True, "found": findings_record, **figures.values(findings_record, {})}
    facts = [("left out", "factor graph, which needs GTSAM")]
    page = render(page_of("experiments.studies.rivals", facts, values, findings_record))
    assert page.count("factor graph") == 1
    assert "the best rival, inverted USBL" in page


@pytest.mark.system
def test_every_navigator_that_is_installed_has_a_time_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is measured on a kinematic mission of the given duration, with the arm's navigator."""
    flown = []

    def load(name: str, assignments: list[str]) -> Scenario:
        scenario = load_scenario(name, assignments)
        flown.append((scenario.motion, scenario.duration_s, scenario.navigation.variant))
        return scenario

    monkeypatch.setattr(findings, "load_scenario", load)
    arms = [arm for arm in findings._CLOSED["arm"] if not find(arm["navigation.variant"]).missing]
    times = findings.step_times_us(2.0, 1)
    assert [*times] == [arm["name"] for arm in arms]
    assert flown == [("kinematic", 2.0, arm["navigation.variant"]) for arm in arms]
    assert min(times.values()) > 0.0
