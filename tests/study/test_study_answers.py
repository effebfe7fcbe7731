"""What a study says of its results: sentences, verdicts, record and the runs to look at, for results made by hand."""

import itertools

import numpy as np
import pytest

from experiments.intervals import Interval
from experiments.pages.page import Table
from experiments.study import charts
from experiments.study.estimate import Results
from experiments.study.file import of_table
from experiments.study.notable import commands, notable, worst_entry
from experiments.study.page import _cell, _differences, _shown, _table, summary_of
from experiments.study.plan import Plan, plan_of
from experiments.study.record import record_of

MEANS = {
    (0, "plain"): 1.0,
    (0, "aware"): 0.5,
    (1, "plain"): 2.0,
    (1, "aware"): 3.5,
    (2, "plain"): 1.5,
    (2, "aware"): 1.5,
}
"""Mean E_P [m] by point and arm."""
RUNS = 40
WAVES = np.cos(np.outer(np.arange(7), 1.0 + np.arange(RUNS)))
OFF = WAVES - WAVES.mean(axis=1, keepdims=True)
"""What runs scatter by, the last row in all arms alike."""


@pytest.fixture(scope="module")
def plan() -> Plan:
    """Three depths and two arms in one sea."""
    table = {
        "scenario": "T5", "runs": RUNS, "set": {"duration_s": 20.0},
        "vary": {"followers.0.depth_m": [10.0, 12.0, 14.0]},
        "arm": [{"name": "plain"}, {"name": "aware", "leader.broadcast_attitude": True}],
    }  # fmt: skip
    return plan_of(of_table(table, "mine.toml", "mine"))


@pytest.fixture(scope="module")
def results() -> Results:
    rows, runs = [], []
    for k, ((point, arm), mean) in enumerate(MEANS.items()):
        row = {"point": point, "arm": arm, "follower": "follower", "sea": 0, "seed": 1, "energy_j": 100.0 * k}
        values = mean + 0.1 * OFF[6] + 0.01 * OFF[k]
        captured = np.arange(RUNS) < 10 * (arm == "plain")
        rows.append(row | {"e_p_mean_m": float(values.mean())})
        runs.append((row, {"e_p_mean_m": values.tolist(), "captured": captured.tolist()}))
    return Results.of(rows, runs)


def place(point: int, arm: str) -> tuple[int, str, str]:
    return point, arm, "follower"


def test_the_answer_names_the_best_the_worst_and_which_arm_wins_where(plan: Plan, results: Results) -> None:
    said = summary_of(plan, results)
    best, worst = (_shown(results.estimate(place(*at), "e_p_mean_m"), "m") for at in ((0, "aware"), (1, "aware")))
    assert best.startswith("0.5 m (0.4")
    assert f"Mean E_P, with 95 % intervals: {best} at best (" in said
    assert f", {worst} at most (" in said
    assert "14" not in said
    assert said.endswith("aware against plain: lower at 1, higher at 1, undecided at 1 places.")


def test_differences_are_told_with_their_verdicts(plan: Plan, results: Results) -> None:
    (table,) = (block for block in _differences(plan, results) if isinstance(block, Table))
    assert [[cell.text for cell in row][:3] for row in table.rows] == [
        ["0", "10", "aware"], ["1", "12", "aware"], ["2", "14", "aware"],
    ]  # fmt: skip
    assert [row[-1].text for row in table.rows] == ["lower", "higher", "open"]
    assert [row[-1].tone for row in table.rows] == ["yes", "no", "maybe"]
    for row, apart in zip(table.rows, (-0.5, 1.5, 0.0), strict=True):
        assert float(row[-2].sort) == pytest.approx(apart, abs=1e-9)


def test_the_table_has_every_place_with_its_means(plan: Plan, results: Results) -> None:
    table = _table(plan, results)
    heads = list(table.heads)
    for row, (at, mean) in zip(table.rows, MEANS.items(), strict=True):
        cells = dict(zip(heads, row, strict=True))
        assert cells["arm"].text == at[1]
        assert float(cells["mean E_P [m]"].sort) == pytest.approx(mean, abs=1e-9)
        assert float(cells["share of runs captured"].sort) == (0.25 if at[1] == "plain" else 0.0)
    energy = [float(dict(zip(heads, row, strict=True))[heads[-1]].sort) for row in table.rows]
    assert energy == [100.0 * k for k in range(6)]


def test_the_record_has_estimates_and_paired_differences(plan: Plan, results: Results) -> None:
    found = record_of(plan, results).findings
    assert len(found) == 6 + 3
    for (point, arm), mean in MEANS.items():
        finding = found[f"e_p_mean_m: point {point}, arm {arm}, follower"]
        own = np.array(results.by_run(place(point, arm), "e_p_mean_m"))[0]
        assert finding.value == pytest.approx(mean, rel=1e-5)
        assert finding.unit == "m"
        half = 1.96 * own.std() / np.sqrt(RUNS)
        assert (float(finding.high or 0) - float(finding.low or 0)) / 2 == pytest.approx(half, rel=0.15)
    apart = found["e_p_mean_m: point 1, arm aware, follower, less plain"]
    assert apart.value == pytest.approx(1.5, rel=1e-5)
    # what both arms scatter by drops out
    assert float(apart.high or 0) - float(apart.low or 0) < 0.02


def test_worst_and_median_runs_are_those_of_their_place(plan: Plan, results: Results) -> None:
    for point, arm in itertools.product(range(3), ("plain", "aware")):
        (values,) = results.by_run(place(point, arm), "e_p_mean_m") or []
        (sea, worst), (_, median) = notable(plan, results, place(point, arm))
        assert (sea, worst) == (0, int(values.argmax()))
        # of 40 the twentieth
        assert np.count_nonzero(values < values[median]) == 19
    entry, run, name = worst_entry(plan, results)
    assert (entry.point, entry.arm, name) == (1, "aware", "follower")
    assert run == int(np.argmax(np.array(results.by_run(place(1, "aware"), "e_p_mean_m"))))
    assert commands(plan, results).count("--run") == 12


def test_numbers_without_limits_stand_alone() -> None:
    nan = float("nan")
    given = Results.of([], []).estimate((0, "", ""), "e_p_mean_m")
    assert _shown(given) == _cell(given).text == "–"
    assert _shown(type(given)(-1.2345, nan, nan), "m") == "−1.23 m"
    assert _shown(type(given)(1.2345, 0.5, 2.0), "m") == "1.23 m (0.5 to 2)"


def test_maps_of_arms_are_shaded_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """One arm has 10 where the depth is largest, the other half as much above 1, which both have elsewhere."""
    table = {"scenario": "T5", "vary": {"followers.0.depth_m": [10, 12], "leader.depth_m": [6, 8]}}
    plan = plan_of(of_table(table | {"arm": [{"name": "a"}, {"name": "b"}]}, "maps", "maps"))

    def valued(place: dict[str, object]) -> Interval:
        most = 10.0 if place["arm"] == "a" else 5.5
        return Interval(most if place["followers.0.depth_m"] == 12 else 1.0, 0.0, 0.0)

    monkeypatch.setattr(charts, "svg", lambda figure, *_: figure)
    names = ("followers.0.depth_m", "leader.depth_m")
    maps = charts.heat_maps(plan, valued, names, [{"arm": "a"}, {"arm": "b"}])
    shades = [[patch.get_alpha() for patch in figure.axes[0].patches] for figure in maps]  # type: ignore[attr-defined]
    low, high = shades[0][0], shades[0][1]
    assert high > low
    assert shades == [[low, high] * 2, [low, pytest.approx((low + high) / 2)] * 2]
    assert [text.get_text() for text in maps[0].axes[0].texts] == ["1.00", "10.0"] * 2  # type: ignore[attr-defined]
