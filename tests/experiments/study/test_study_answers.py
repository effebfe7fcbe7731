"""Report of a study: sentences, verdicts, record and the runs to inspect, for results made by
hand.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plotly.graph_objects import Figure

from experiments.study import charts
from experiments.study.estimate import Condition, Results, interval_text
from experiments.study.file import study_from_table
from experiments.study.measure import METRICS
from experiments.study.page import (
    StudyPage,
    answer,
    commands,
    page_of,
    worst_and_median_run,
    worst_run,
)
from experiments.study.plan import StudyPlan, idle_keys, plan_of
from experiments.study.run import _row_and_lists, largest_half_width
from experiments.study.study import findings_of
from reports.figures import Line, light
from reports.page import Figures, Notice, Page, PageTable, render
from reports.style import SERIES
from tests.golden import require_golden

MEANS = {
    (0, "plain"): 1.0,
    (0, "aware"): 0.5,
    (1, "plain"): 2.0,
    (1, "aware"): 3.5,
    (2, "plain"): 1.5,
    (2, "aware"): 1.499,
}
"""Mean E_P [m] by point and arm."""
RUNS = 40
UNCENTRED = np.cos(np.outer(np.arange(7), 1.0 + np.arange(RUNS)))
SCATTER = UNCENTRED - UNCENTRED.mean(axis=1, keepdims=True)
"""Seven rows of deviations of runs, each with the mean 0: one for each of `MEANS`, and one that
all share.
"""


@pytest.fixture(scope="module")
def plan() -> StudyPlan:
    """Three depths and two arms in one realization."""
    table = {
        "scenario": "T5",
        "runs": RUNS,
        "set": {"duration_s": 20.0},
        "vary": {"followers.0.depth_m": [10.0, 12.0, 14.0]},
        "arm": [{"name": "plain"}, {"name": "aware", "leader.broadcast_attitude": True}],
    }
    return plan_of(study_from_table(table, "mine.toml", "mine"))


@pytest.fixture(scope="module")
def results() -> Results:
    """Runs with the means of `MEANS`: they scatter alike, and a tenth as much on their own."""
    rows, runs = [], []
    for k, ((point, arm), mean) in enumerate(MEANS.items()):
        row = {
            "point": point,
            "arm": arm,
            "follower": "follower",
            "realization": 0,
            "seed": 1,
            "energy_j": 100.0 * k,
        }
        values = mean + 0.1 * SCATTER[6] + 0.01 * SCATTER[k]
        mirror_locked = np.arange(RUNS) < 10 * (arm == "plain")
        rows.append(row | {"e_p_mean_m": float(values.mean())})
        run_arrays = {
            "run": [*range(RUNS)],
            "e_p_mean_m": values.tolist(),
            "mirror_locked": mirror_locked.tolist(),
        }
        runs.append((row, run_arrays))
    return Results.of(rows, runs)


@pytest.fixture(scope="module")
def page(plan: StudyPlan, results: Results) -> Page:
    return page_of(plan, results, {})


def condition(point: int, arm: str) -> Condition:
    return Condition(point, arm, "follower")


def test_the_answer_names_the_best_the_worst_and_which_arm_wins_where(
    page: Page, results: Results
) -> None:
    printed = page.summary
    best, worst = (
        interval_text(results.estimate(condition(*point_and_arm), "e_p_mean_m"), "m")
        for point_and_arm in ((0, "aware"), (1, "aware"))
    )
    assert best.startswith("0.500 m (0.4")
    assert f"Mean E_P, with 95 % intervals: {best} at best (" in printed
    assert f", {worst} at most (" in printed
    assert page.question == (
        "How does the mean position error of the estimate depend on what is varied?"
    )
    html = render(page)
    assert html.index('class="question"') < html.index('class="summary"')
    assert "14" not in printed
    assert printed.endswith(
        "aware against plain: lower at 1, higher at 1, undecided at 1 of 3 places."
    )
    lowest, highest, arm = page.tiles
    assert (lowest.value, highest.value) == (best, worst)
    assert (lowest.name, arm.name) == ("lowest mean E_P", "aware")
    decided = "lower at 1, higher at 1, undecided at 1"
    assert (arm.value, arm.remark) == (decided, "of 3 places, against plain")


def test_the_terminal_has_the_answer_as_a_small_table(plan: StudyPlan, results: Results) -> None:
    table = answer(plan, results)
    assert table.heads == ("where", "mean E_P [m]", "less plain", "verdict")
    assert len(table.rows) == 6
    assert table.remark == ""
    where, value, difference, verdict = table.rows[1]
    assert where.endswith("arm aware")
    assert value == interval_text(results.estimate(condition(0, "aware"), "e_p_mean_m"))
    assert difference.startswith(("−0.500", "-0.500"))
    assert verdict == "lower"
    assert table.rows[0][2:] == ("–", "")


def test_the_page_is_the_golden_one(page: Page) -> None:
    """Means are those of `MEANS`, 10 of 40 runs of the plain arm are locked on the mirror image."""
    require_golden(replace(page, facts=[]), "study")


def test_the_record_has_estimates_and_paired_differences(plan: StudyPlan, results: Results) -> None:
    actual = findings_of(plan, results)
    assert len(actual) == 6 + 3
    for (point, arm), mean in MEANS.items():
        finding = actual[f"e_p_mean_m: point {point}, arm {arm}, follower"]
        errors = np.array(results.by_run(condition(point, arm), "e_p_mean_m"))[0]
        assert finding.value == pytest.approx(mean, rel=1e-5)
        assert finding.unit == "m"
        half_interval = 1.96 * errors.std() / np.sqrt(RUNS)
        assert (float(finding.high or 0) - float(finding.low or 0)) / 2 == pytest.approx(
            half_interval, rel=0.15
        )
    difference = actual["e_p_mean_m: point 1, arm aware, follower, less plain"]
    assert difference.value == pytest.approx(1.5, rel=1e-5)
    # what both arms scatter by drops out
    assert float(difference.high or 0) - float(difference.low or 0) < 0.02


def test_worst_and_median_runs_are_those_of_their_place(plan: StudyPlan, results: Results) -> None:
    for point, arm in itertools.product(range(3), ("plain", "aware")):
        (values,) = results.by_run(condition(point, arm), "e_p_mean_m") or []
        (realization, worst), (_, median) = worst_and_median_run(
            plan, results, condition(point, arm)
        )
        assert (realization, worst) == (0, int(values.argmax()))
        # of 40 the twentieth
        assert np.count_nonzero(values < values[median]) == 19
    worst = worst_run(plan, results)
    assert worst is not None
    entry, run, name, scenario = worst
    assert (entry.point, entry.arm, name) == (1, "aware", "follower")
    assert scenario == entry.scenario.model_copy(update={"run": run})
    assert run == int(np.argmax(np.array(results.by_run(condition(1, "aware"), "e_p_mean_m"))))
    assert commands(plan, results).count("--run") == 12


def test_a_run_that_contact_ended_is_the_first_to_look_at(
    plan: StudyPlan, results: Results
) -> None:
    """It has no error, and is named as the worst; the median is that of the other 39 runs, the
    twentieth.
    """
    plain = condition(0, "plain")
    (values,) = results.by_run(plain, "e_p_mean_m") or []
    with_ended_run = values.copy()
    with_ended_run[7] = np.nan
    run_arrays = [dict(results.runs[plain][0]) | {"e_p_mean_m": with_ended_run.tolist()}]
    actual = replace(results, runs={**results.runs, plain: run_arrays})
    (_, worst), (_, median) = worst_and_median_run(plan, actual, plain)
    assert worst == 7
    assert np.count_nonzero(with_ended_run < with_ended_run[median]) == 19
    assert actual.estimate(plain, "e_p_mean_m").value == pytest.approx(np.delete(values, 7).mean())
    difference = actual.difference(condition(0, "aware"), "plain", "e_p_mean_m")
    (aware_values,) = results.by_run(condition(0, "aware"), "e_p_mean_m") or []
    assert difference.value == pytest.approx(np.delete(aware_values - values, 7).mean())


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (np.arange(40.0), "interval"),
        (np.full(40, 2.0), "none"),
        (np.where(np.arange(40) < 10, np.arange(40.0), np.nan), "more"),
    ],
)
def test_the_widest_interval_suggests_more_runs_where_too_few_are_complete(
    results: Results, values: Any, expected: str
) -> None:
    """Runs that are all alike need no more; where contact ended all but ten, which differ, there is
    no interval yet, and its half-width counts as infinite.
    """
    plain = condition(0, "plain")
    runs = {plain: [{"e_p_mean_m": values.tolist()}]}
    changed = Results(rows={plain: results.rows[plain]}, runs=runs)
    interval = changed.estimate(plain, "e_p_mean_m")
    half_width = {"interval": (interval.high - interval.low) / 2, "none": 0.0, "more": math.inf}[
        expected
    ]
    assert largest_half_width(changed, "e_p_mean_m") == half_width


def test_commands_are_headed_by_the_runs_that_they_fly(plan: StudyPlan, results: Results) -> None:
    lines = commands(plan, results).splitlines()
    # run 0 is the default
    for head, line in zip(lines[::2], lines[1::2], strict=True):
        number = head.rpartition(" run, ")[2]
        assert (
            f"--run {number}" in line if number != "0" else "--run" not in line or "--run 0" in line
        )
    assert [head.split(": ")[1].split()[0] for head in lines[::2]] == ["worst", "median"] * 6


def test_a_condition_whose_interval_contains_zero_is_undecided(plan: StudyPlan) -> None:
    """Half of the runs are 1 m lower, the others 0.9 m higher: lower in the mean, and undecided."""
    rows, runs = [], []
    for point, arm in itertools.product(range(3), ("plain", "aware")):
        row = {"point": point, "arm": arm, "follower": "follower", "realization": 0, "seed": 1}
        values = 2.0 + (arm == "aware") * np.where(np.arange(RUNS) % 2, -1.0, 0.9)
        rows.append(row | {"e_p_mean_m": float(values.mean())})
        runs.append((row, {"run": [*range(values.size)], "e_p_mean_m": values.tolist()}))
    printed = page_of(plan, Results.of(rows, runs), {}).summary
    assert printed.endswith("aware against plain: undecided at 3 of 3 places.")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, {"ocean.waves.height_m": "ocean.waves.kind = 'none'"}),
        ({"set": {"ocean.waves.kind": "regular"}}, {}),
        ({"arm": [{"name": "calm"}, {"name": "waves", "ocean.waves.kind": "regular"}]}, {}),
        (
            {"set": {"followers.*.saw_tooth_period_s": 60.0, "ocean.waves.kind": "regular"}},
            {"followers.*.saw_tooth_period_s": "followers.*.saw_tooth_amplitude_m = 0"},
        ),
        ({"set": {"sensors.speed_bias_m_s": 0.1, "ocean.waves.kind": "jonswap"}}, {}),
        (
            {"set": {"navigation.assume.clock": True, "ocean.waves.kind": "jonswap"}},
            {"navigation.assume.clock": "navigation.variant = 'laisn-2'"},
        ),
        (
            {
                "set": {"navigation.assume.clock": True, "ocean.waves.kind": "jonswap"},
                "arm": [
                    {"name": name, "navigation.variant": name} for name in ("laisn-2", "tight")
                ],
            },
            {},
        ),
    ],
)
def test_keys_that_no_mission_of_a_study_feels_are_named(
    changes: dict[str, Any], expected: dict[str, str]
) -> None:
    """The height of waves is varied, once by the default that a scenario has without it."""
    table = {"scenario": "T5", "runs": RUNS, "vary": {"ocean.waves.height_m": [0.5, 0.4]}}
    plan = plan_of(study_from_table(table | changes, "waves.toml", "waves"))
    assert idle_keys(plan) == expected
    places = itertools.product(range(len(plan.points)), plan.arms)
    page = page_of(plan, results_of(dict.fromkeys(places, RUNS)), {})
    notices = [block for block in page.sections[0].blocks if isinstance(block, Notice)]
    lines = [f"without effect: {key}, as {reason}" for key, reason in expected.items()]
    assert [notice.text for notice in notices if "without" in notice.text] == lines


def results_of(runs_of: Mapping[tuple[int, str], int]) -> Results:
    """Numbers of runs by point and arm; those of an arm other than the first are 1 m longer."""
    rows, runs = [], []
    for (point, arm), count in runs_of.items():
        row = {"point": point, "arm": arm, "follower": "follower", "realization": 0, "seed": 1}
        values = 2.0 + 0.1 * SCATTER[6, :count] + (arm == "aware")
        rows.append(row | {"e_p_mean_m": float(values.mean())})
        runs.append((row, {"run": [*range(count)], "e_p_mean_m": values.tolist()}))
    return Results.of(rows, runs)


def test_of_a_single_place_the_verdict_alone_is_told() -> None:
    table = {"scenario": "T5", "runs": RUNS, "arm": [{"name": "plain"}, {"name": "aware"}]}
    one_place = plan_of(study_from_table(table, "one.toml", "one"))
    page = page_of(one_place, results_of({(0, "plain"): RUNS, (0, "aware"): RUNS}), {})
    assert page.summary.endswith("aware against plain: higher.")
    *_, arm = page.tiles
    assert (arm.value, arm.remark) == ("higher", "against plain")


@pytest.mark.parametrize(
    ("few", "count", "note"),
    [
        ([], 8, ""),
        ([(2, "aware")], 8, " at 1 of 6 places: they need 20 runs of a realization, there are 8"),
        ([*MEANS], 19, ": they need 20 runs of a realization, there are 19"),
    ],
)
def test_intervals_are_said_to_be_missing_where_too_few_runs_were_flown(
    few: list[tuple[int, str]], count: int, note: str
) -> None:
    """Whatever number the file asks for, as `further_runs` and `every` fly others."""
    table = {
        "scenario": "T5",
        "runs": 8,
        "vary": {"followers.0.depth_m": [10.0, 12.0, 14.0]},
        "arm": [{"name": "plain"}, {"name": "aware"}],
    }
    asks_for_few = plan_of(study_from_table(table, "mine.toml", "mine"))
    flown = results_of({place: count if place in few else RUNS for place in MEANS})
    page = StudyPage(plan=asks_for_few, results=flown, failures={})
    assert page.interval_notes == ([f"no intervals and no verdicts{note}"] if note else [])
    for place in MEANS:
        has_limits = not math.isnan(page.estimates[condition(*place)].low)
        assert has_limits == (place not in few)


def test_a_difference_that_no_shown_digit_has_is_not_marked(plan: StudyPlan) -> None:
    """All runs of one arm are 5 µm higher: decided by the interval, and of no account."""
    rows, runs = [], []
    for point, arm in itertools.product(range(3), ("plain", "aware")):
        row = {"point": point, "arm": arm, "follower": "follower", "realization": 0, "seed": 1}
        values = 2.0 + 0.1 * SCATTER[6] + (arm == "aware") * (5e-6 + 1e-7 * SCATTER[point])
        rows.append(row | {"e_p_mean_m": float(values.mean())})
        runs.append((row, {"run": [*range(values.size)], "e_p_mean_m": values.tolist()}))
    page = page_of(plan, Results.of(rows, runs), {})
    assert page.summary.endswith("aware against plain: the same at 3 of 3 places.")
    (table,) = (block for block in page.sections[0].blocks if isinstance(block, PageTable))
    assert [(row[-1].text, row[-1].tone) for row in table.rows] == [("", ""), ("same", "")] * 3


def test_three_factors_are_answered_by_shares_of_variance_and_many_places_by_extremes() -> None:
    """The error is the depth plus a tenth of the leader's depth, whatever the current: shares are
    as the squares, 1 to 0.01 to 0.
    """
    table = {
        "scenario": "T5", "runs": 1, "set": {"duration_s": 20.0},
        "vary": {"followers.0.depth_m": [10, 11, 12, 13], "leader.depth_m": [5, 6, 7, 8],
                 "ocean.current_speed_m_s": [0.1, 0.2, 0.3, 0.4, 0.5]},
    }  # fmt: skip
    plan = plan_of(study_from_table(table, "three.toml", "three"))
    rows = [
        {
            "point": i,
            "arm": plan.arms[0],
            "follower": "follower",
            "realization": 0,
            "seed": 1,
            "e_p_mean_m": point["followers.0.depth_m"] + 0.1 * point["leader.depth_m"],
        }
        for i, point in enumerate(plan.points)
    ]
    runs = [(row, {"run": [0], "e_p_mean_m": [row["e_p_mean_m"]]}) for row in rows]
    page = page_of(plan, Results.of(rows, runs), {})
    shares, maps, answer_table = page.sections[0].blocks[:3]
    assert isinstance(shares, Figures)
    assert isinstance(maps, Figures)
    (share_marks,) = shares.panels[0].parts[0].lines
    assert share_marks.x == pytest.approx([1 / 1.01, 0.01 / 1.01, 0.0, 0.0], abs=1e-6)
    assert (
        len(
            {
                (trace["zmin"], trace["zmax"])
                for panel in maps.panels
                for trace in panel.parts[0].traces
            }
        )
        == 1
    )
    assert isinstance(answer_table, PageTable)
    assert len(answer_table.rows) == 60
    assert "The 60 lowest and highest of 80 places" in answer_table.caption
    values = sorted(row["e_p_mean_m"] for row in rows)
    assert [float(row[-1].sort) for row in answer_table.rows] == pytest.approx(
        values[:30] + values[-30:]
    )


@pytest.mark.parametrize("depth_counts", [True, False])
def test_the_factor_that_decides_is_among_the_key_figures(depth_counts: bool) -> None:
    """The error is the depth, or noise alone, which decides nothing."""
    table = {
        "scenario": "T5", "runs": 8, "set": {"duration_s": 20.0},
        "vary": {"followers.0.depth_m": [10, 12], "leader.depth_m": [5, 6]},
    }  # fmt: skip
    plan = plan_of(study_from_table(table, "two.toml", "two"))
    noise = np.random.default_rng(3).normal(0.0, 0.1, (len(plan.points), 8))
    rows = []
    for i, point in enumerate(plan.points):
        values = noise[i] + depth_counts * point["followers.0.depth_m"]
        row = {"point": i, "arm": plan.arms[0], "follower": "follower"}
        row |= {"realization": 0, "seed": 1, "e_p_mean_m": float(values.mean())}
        rows.append((row, {"run": [*range(8)], "e_p_mean_m": values.tolist()}))
    page = page_of(plan, Results.of([row for row, _ in rows], rows), {})
    deciding = [tile for tile in page.tiles if tile.name == "what decides"]
    if not depth_counts:
        assert deciding == []
        return
    (tile,) = deciding
    assert tile.value == "follower 1's depth"
    assert tile.remark == "100 % of the variance between places"


def test_columns_have_the_units_of_their_names() -> None:
    units = {"m": "[m]", "deg": "[°]", "j": "[J]", "w": "[W]"}
    without_unit = {name for name in METRICS if name.rpartition("_")[2] not in units}
    assert all(not METRICS[name].label.endswith("]") for name in without_unit)
    assert len(without_unit) < len(METRICS) / 2
    for name in METRICS.keys() - without_unit:
        assert METRICS[name].label.endswith(f" {units[name.rpartition('_')[2]]}"), name
        for statistic, printed in (
            ("mean", "mean"),
            ("max", "largest"),
            ("std", "σ"),
            ("rms", "RMS"),
        ):
            if f"_{statistic}_" in name and not name.startswith(("energy", "bound")):
                assert printed in METRICS[name].label + METRICS[name].meaning, name
    assert METRICS["e_b_p95_deg"].label == "95th percentile of E_B [°]"


@pytest.fixture
def drawn_panels(monkeypatch: pytest.MonkeyPatch) -> list[tuple[list[Line], dict[str, Any]]]:
    """Lines and settings of the panels that charts draw."""
    actual: list[tuple[list[Line], dict[str, Any]]] = []

    monkeypatch.setattr(charts, "panel", lambda lines, **settings: actual.append((lines, settings)))
    return actual


def test_lines_of_the_main_figure_are_the_means_of_their_arms(
    plan: StudyPlan, results: Results, drawn_panels: Any
) -> None:
    figures = charts.over_factor(plan, results, charts.layout_of(plan))
    ((lines, settings),) = drawn_panels
    assert (settings["x_label"], settings["y_label"]) == ("follower 1's depth [m]", "mean E_P [m]")
    assert [name for _, name in figures.legend] == ["plain", "aware"]
    for i, arm in enumerate(("plain", "aware")):
        line, marks = (line for line in lines if line.colour is SERIES[i])
        assert (line.marker, marks.marker) == ("", "o")
        for drawn_line in (line, marks):
            assert drawn_line.x.tolist() == [10.0, 12.0, 14.0]
            assert drawn_line.y == pytest.approx([MEANS[point, arm] for point in range(3)])
        limits = [
            list(results.estimate(condition(point, arm), "e_p_mean_m")[1:]) for point in range(3)
        ]
        assert np.transpose(marks.interval).tolist() == limits
        assert marks.name == arm


def test_differences_are_drawn_with_a_line_at_zero(
    plan: StudyPlan, results: Results, drawn_panels: Any
) -> None:
    figures = charts.differences(plan, results)
    ((lines, settings),) = drawn_panels
    assert settings["y_label"] == "difference: mean E_P [m]"
    assert [name for _, name in figures.legend] == ["aware"]
    assert (lines[0].x.tolist(), lines[0].y.tolist()) == ([10.0, 14.0], [0.0, 0.0])
    (marks,) = (line for line in lines if line.marker)
    assert marks.y == pytest.approx([-0.5, 1.5, -0.001])


def reporting(plan: StudyPlan, metric: str, **changes: Any) -> StudyPlan:
    """The plan with another metric of its report, and other changes of its study."""
    file = plan.study.file
    file = file.model_copy(update={"report": file.report.model_copy(update={"metric": metric})})
    return replace(plan, study=replace(plan.study, file=file, **changes))


def test_each_point_has_a_panel_with_the_distribution_of_its_realizations(
    plan: StudyPlan, drawn_panels: Any
) -> None:
    rows = [
        {
            "point": point,
            "arm": arm,
            "follower": "follower",
            "realization": realization,
            "seed": realization,
            "e_p_p95_m": 10.0 * point + realization,
        }
        for point in range(3)
        for arm in ("plain", "aware")
        for realization in (2, 0, 1)
    ]
    results = Results(rows=Results.of(rows, [(row, {}) for row in rows]).rows, runs={})
    charts.over_realizations(reporting(plan, "e_p_p95_m"), results)
    assert [settings["title"] for _, settings in drawn_panels] == [
        f"follower 1's depth {d} m" for d in (10, 12, 14)
    ]
    for point, (lines, _) in enumerate(drawn_panels):
        for line in lines:
            assert line.x.tolist() == [
                10.0 * point + realization for realization in (0, 0, 1, 1, 2, 2)
            ]
            assert line.y == pytest.approx([0, 1 / 3, 1 / 3, 2 / 3, 2 / 3, 1])


def test_means_of_realizations_are_plotted_over_their_draws(
    plan: StudyPlan, drawn_panels: Any
) -> None:
    rows = [
        {
            "point": point,
            "arm": arm,
            "follower": "follower",
            "realization": realization,
            "seed": realization,
            "wind": 5.0 - realization,
            "e_p_p95_m": 10.0 * point + realization + (arm == "aware"),
        }
        for point in range(3)
        for arm in ("plain", "aware")
        for realization in range(3)
    ]
    results = Results(rows=Results.of(rows, [(row, {}) for row in rows]).rows, runs={})
    draw: Any = SimpleNamespace(key="wind")
    charts.over_draws(reporting(plan, "e_p_p95_m", draws=(draw,)), results, 1)
    ((lines, settings),) = drawn_panels
    assert (settings["x_label"], settings["y_label"]) == ("wind", "95th percentile of E_P [m]")
    assert [line.x.tolist() for line in lines] == [[5.0, 4.0, 3.0]] * 2
    assert [line.y.tolist() for line in lines] == [[10.0, 11.0, 12.0], [11.0, 12.0, 13.0]]


def test_rows_of_closed_loops_are_extremes_roots_and_means_of_their_runs(plan: StudyPlan) -> None:
    records = [
        [
            {
                "run": 0,
                "e_p_mean_m": 1.0,
                "e_p_max_m": 2.0,
                "e_b_max_deg": 9.0,
                "mirror_locked": False,
                "gated": 1,
                "ended": 0,
                "track_error_rms_m": 3.0,
                "closest_approach_m": 7.0,
                "power_mean_w": 10.0,
            }
        ],
        [
            {
                "run": 1,
                "e_p_mean_m": 3.0,
                "e_p_max_m": 5.0,
                "e_b_max_deg": 4.0,
                "mirror_locked": True,
                "gated": 2,
                "ended": 1,
                "track_error_rms_m": 4.0,
                "closest_approach_m": 6.0,
                "power_mean_w": 30.0,
            }
        ],
    ]
    row, run_arrays = _row_and_lists(plan.entries[0], 0, records)
    expected = {
        "runs": 2,
        "seed": 1,
        "variant": "laisn-2",
        "e_p_mean_m": 2.0,
        "e_p_max_m": 5.0,
        "e_b_max_deg": 9.0,
        "track_error_rms_m": np.sqrt(12.5),
        "closest_approach_m": 6.0,
        "power_mean_w": 20.0,
        "mirror_locked_runs": 1,
        "fixes_gated": 3,
        "ended_runs": 1,
        "worst_run": 1,
    }
    assert {name: row[name] for name in expected} == pytest.approx(expected)
    assert run_arrays["e_p_mean_m"] == [1.0, 3.0]


def test_numbers_without_limits_stand_alone() -> None:
    nan = float("nan")
    empty = Results.of([], []).estimate(Condition(0, "", ""), "e_p_mean_m")
    assert interval_text(empty) == "–"
    assert interval_text(type(empty)(-1.2345, nan, nan), "m") == "−1.23 m"
    assert interval_text(type(empty)(53124.6, nan, nan), "J") == "53,125 J"
    assert interval_text(type(empty)(1.2345, 0.5, 2.0), "m") == "1.23 m (0.500 to 2.00)"


def test_maps_of_arms_have_one_scale() -> None:
    """At the larger depth one arm has 10 and the other 5.5; elsewhere both have 1."""
    table = {"scenario": "T5", "vary": {"followers.0.depth_m": [10, 12], "leader.depth_m": [6, 8]}}
    plan = plan_of(
        study_from_table(table | {"arm": [{"name": "a"}, {"name": "b"}]}, "maps", "maps")
    )
    rows = [
        {
            "point": i,
            "arm": arm,
            "follower": "follower",
            "realization": 0,
            "e_p_mean_m": error_at_12_m if point["followers.0.depth_m"] == 12 else 1.0,
        }
        for i, point in enumerate(plan.points)
        for arm, error_at_12_m in (("a", 10.0), ("b", 5.5))
    ]
    names = ("followers.0.depth_m", "leader.depth_m")
    maps: Any = charts.heat_maps(plan, Results.of(rows, [(row, {}) for row in rows]), names).panels
    first, second = (panel.parts[0].traces[0] for panel in maps)
    assert [(trace["zmin"], trace["zmax"]) for trace in (first, second)] == [(1.0, 10.0)] * 2
    assert (first["z"], second["z"]) == ([[1.0, 10.0]] * 2, [[1.0, 5.5]] * 2)
    assert first["text"] == [["1.00", "10.0"]] * 2
    assert first["hovertext"][1][0] == "follower 1's depth [m] 10<br>leader's depth [m] 8<br>1.00"
    for panel in maps:
        Figure(light(panel.figure))


@pytest.mark.parametrize(
    ("columns", "value", "is_written"),
    [(10, 12.3, True), (11, 12.3, False), (5, 0.000674, True), (6, 0.000674, False)],
)
def test_maps_hold_numbers_where_all_of_a_row_fit(
    columns: int, value: float, is_written: bool
) -> None:
    """40 characters fit across a map: ten of 12.3, five of 0.000674."""
    depths = [10.0 + k for k in range(columns)]
    table = {"scenario": "T5", "vary": {"followers.0.depth_m": depths, "leader.depth_m": [6, 8]}}
    plan = plan_of(study_from_table(table, "maps", "maps"))
    rows = [
        {
            "point": i,
            "arm": plan.arms[0],
            "follower": "follower",
            "realization": 0,
            "e_p_mean_m": value if i == 0 else 1.0,
        }
        for i in range(len(plan.points))
    ]
    names = ("followers.0.depth_m", "leader.depth_m")
    (drawn,) = charts.heat_maps(plan, Results.of(rows, [(row, {}) for row in rows]), names).panels
    assert ("text" in drawn.parts[0].traces[0]) == is_written


def test_keys_have_titles_with_units() -> None:
    for key, label, setting in (
        (
            "leader.excess_buoyancy_n",
            "leader's excess buoyancy [N]",
            "leader's excess buoyancy 2.5 N",
        ),
        ("followers.1.depth_m", "follower 2's depth [m]", "follower 2's depth 2.5 m"),
        ("ocean.current_speed_m_s", "current speed [m/s]", "current speed 2.5 m/s"),
        ("sensors.heading_bias_deg", "heading bias [°]", "heading bias 2.5°"),
        ("ocean.waves.height_m", "waves height [m]", "waves height 2.5 m"),
        (
            "followers.0.station.behind_m",
            "follower 1's station behind [m]",
            "follower 1's station behind 2.5 m",
        ),
        (
            "sensors.custom.0.velocity_sigma_m_s",
            "sensor 1's velocity sigma [m/s]",
            "sensor 1's velocity sigma 2.5 m/s",
        ),
        ("arm", "arm", "arm 2.5"),
    ):
        assert (charts.label_of(key), charts.point_text({key: 2.5})) == (label, setting)


def test_panels_share_the_scale_that_holds_them_all(plan: StudyPlan, results: Results) -> None:
    layout = charts.ChartLayout("followers.0.depth_m", "", ("arm",))
    panels: Any = charts.over_factor(plan, results, layout).panels
    limits = [panel.parts[0].y_limits for panel in panels]
    assert len(panels) == 2
    assert limits[0] == limits[1]
    assert limits[0][0] == 0.0
    assert limits[0][1] > 3.5


def test_a_page_has_a_row_for_each_follower_and_names_what_could_not_be_flown() -> None:
    """Text of a study's file cannot break a table or begin a section: bars, lines and heads stay
    text.
    """
    table = {
        "scenario": "swarm",
        "question": "## One | two?\n\n## Three",
        "vary": {"sensors.speed_bias_m_s": [0.1, 0.3]},
        "set": {"duration_s": 20.0},
        "arm": [{"name": "x|y"}, {"name": "z"}],
    }
    plan = plan_of(study_from_table(table, "mine.toml", "mine"))
    assert len(plan.followers) > 1
    conditions = [*itertools.product((0, 1), plan.arms, plan.followers)]
    rows = [
        {"point": point, "arm": arm, "follower": name, "realization": 0, "seed": 1}
        for point, arm, name in conditions
    ]
    runs = [(row, {"run": [0, 1], "e_p_mean_m": [1.0 + i, 2.0 + i]}) for i, row in enumerate(rows)]
    page = page_of(plan, Results.of(rows, runs), {"lost\n\nat 3 s": plan.entries[:2]})
    assert [section.title for section in page.sections] == [
        "Answer",
        "Other metrics",
        "Differences of arms",
        "Design",
        "Runs to look at",
    ]
    assert page.question == "## One | two? ## Three"
    notice, _, answer_table, _ = page.sections[0].blocks
    assert isinstance(notice, Notice)
    first_scenario = f"speed bias 0.1 m/s, arm x|y, {plan.followers[0]}, realization 0"
    assert notice.text == f"lost at 3 s: 2 scenarios, the first at {first_scenario}"
    assert isinstance(answer_table, PageTable)
    assert [[cell.text for cell in row[:4]] for row in answer_table.rows] == [
        [str(point), ("0.1", "0.3")[point], arm, follower] for point, arm, follower in conditions
    ]
