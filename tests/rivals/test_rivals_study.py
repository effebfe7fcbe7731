"""The study of rival methods: its arms, its findings as functions of rows, and its page."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.findings import read, record
from experiments.studies.rivals import design, findings
from experiments.studies.rivals.study import COMMAND, MODULES, write_page
from experiments.study.file import study_of
from experiments.study.plan import plan_of
from laisn.navigators import NAVIGATORS

TABLES = (design.open_loop, design.slow, design.closed_loop, design.usbl_map)


def rows(error: float, runs: int, routes: int, **more: float) -> list[list[dict[str, Any]]]:
    """Records whose errors have this mean over runs and routes; runs add ± 0.01 m, route i adds i/10 less its mean."""
    shift = 0.1 * (np.arange(routes) - (routes - 1) / 2)
    return [
        [
            {"e_p_mean_m": error + shift[i] + 0.01 * (-1) ** r, "e_p_p95_m": 2 * error, "nees": 2.5, "e_p_max_m": 3.0,
             "mirror_locked": 0.0, "track_error_rms_m": 1.0, "track_error_end_m": 2.0, **more}
            for i in range(routes)
        ]
        for r in range(runs)
    ]  # fmt: skip


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    errors = dict(zip(design.NAVIGATORS, (0.9, 0.8, 0.7, 0.3, 9.0, 8.0, 7.0, 0.35, 0.5, 0.4, 0.2), strict=True))
    arms = {arm["name"]: rows(errors[arm["navigation.variant"]], 4, 8) for arm in design.open_loop(4, {})["arm"]}
    arms |= {arm["name"]: rows(errors[design.SLOW], 2, 8) for arm in design.slow(2, {})["arm"]}
    arms["owtt calm 5"] = rows(7.0, 4, 8, e_p_max_m=60.0)
    for interval, error in ((1.0, 0.1), (2.0, 0.2), (5.0, 0.4), (10.0, 0.8), (20.0, 1.6), (50.0, 4.0)):
        arms[f"ekf calm {interval:g}"] = rows(error, 4, 8)
    closed = {arm["name"]: rows(1.0, 2, 8) for arm in design.closed_loop(2, {})["arm"]}
    points = {arm["name"]: rows(0.5, 4, 1) for arm in design.usbl_map(4, {})["arm"]}
    points["map inverted-usbl 20 0 2"] = rows(0.4, 4, 1)
    points["map inverted-usbl 200 0 2"] = rows(0.6, 4, 1)
    return findings.findings_of(arms, closed, points, dict.fromkeys(design.NAVIGATORS, 12.5))


def test_every_arm_is_valid_and_every_navigator_is_flown() -> None:
    assert set(design.NAVIGATORS) == set(NAVIGATORS) - {"laisn-best", "laisn-main"}
    for table in TABLES:
        plan = plan_of(study_of(table(2, {}), {}))
        assert len({entry.arm for entry in plan.entries}) == len(plan.entries)
        assert all(entry.closed_loop == (table is design.closed_loop) for entry in plan.entries)
    names = [arm["name"] for table in TABLES[:2] for arm in table(2, {})["arm"]]
    expected = {design.arm_name(*case) for case in product(design.NAVIGATORS, design.CONDITIONS, design.INTERVALS)}
    missing = expected - set(names)
    assert missing == {f"factor-graph {condition} 1" for condition in ("current", "loss", "bias")}


def test_findings_are_the_means_shares_and_differences_of_the_rows(found: dict[str, Any]) -> None:
    error = found["error tight calm 5"]
    assert error.value == pytest.approx(0.3)
    # each route: variance 0.01² · 4/3 of four runs; of the mean of eight routes a 32nd
    assert error.high - error.value == pytest.approx(1.959964 * 0.01 * np.sqrt(4 / 3 / 32), rel=1e-3)
    apart = found["less tight inverted-usbl calm 5"]
    assert (apart.value, apart.low, apart.high) == pytest.approx((-0.1, -0.1, -0.1))
    assert found["better-than tight inverted-usbl"].value == found["cases tight inverted-usbl"].value == 12
    assert found["cases tight factor-graph"].value == 9
    # those of the inverted USBL, and the filter on ranges with messages every second
    assert found["better-than tight"].value == 13
    assert found["best-rival"].value == "inverted-usbl"
    lost = found["lost owtt calm 5"]
    assert lost.value == 1.0
    # Clopper and Pearson of 32 of 32
    assert lost.low == pytest.approx(0.025 ** (1 / 32), rel=1e-4)
    assert found["lost tight calm 5"].value == 0.0
    assert found["high ekf calm 5"].value == pytest.approx(0.8)


def test_the_maps_have_their_points_and_their_intervals(found: dict[str, Any]) -> None:
    assert (found["map-better"].value, found["map-points"].value) == (1, 36)
    assert found["map-less 200 0 2"].value == pytest.approx(0.1)
    # ten vehicles, 150 m: ten times 0.1 s and 300 m at 1500 m/s
    assert found["turn 10 150"].value == pytest.approx(3.0)
    # between 0.2 m at 2 s and 0.4 m at 5 s on logarithmic scales
    share = np.log(3.0 / 2.0) / np.log(5.0 / 2.0)
    assert found["shared ekf 10 150"].value == pytest.approx(0.2 * 2.0**share, rel=1e-5)
    assert found["shared ekf 1 50"].value == pytest.approx(0.1)


def test_the_page_is_made_of_the_record(found: dict[str, Any], tmp_path: Path) -> None:
    record("rivals", COMMAND, MODULES, found).write(tmp_path / "results.json")
    page = write_page(read(tmp_path / "results.json"), tmp_path / "report.html").read_text(encoding="utf-8")
    assert "the best rival, inverted USBL" in page
    assert "−0.10" in page
    for title in (*design.NAVIGATORS.values(), "Vehicles that share a channel", "better in 1 of 36 points"):
        assert title in page
