"""Tables of the pitch study: what stands in their cells, for runs made by hand."""

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from experiments.asymmetry import question_page
from experiments.asymmetry.added_error import paired
from experiments.asymmetry.conditions import QUICK_CONDITIONS
from experiments.asymmetry.gates import GateRow
from experiments.asymmetry.missions import Plan, Row
from experiments.asymmetry.remedies import CROOKED, EXACT, LEVEL, READINGS, REAL, STEADIED
from experiments.asymmetry.remedies_page import (
    _capture_table,
    _inflated,
    _remedy_table,
    _route_table,
    _split_table,
    in_words,
    shortfalls,
)
from experiments.asymmetry.tables import between, gate_table, mean_cell, mission_table, planner_table, stage_4_table
from experiments.asymmetry.tau import Curve, Curves
from experiments.intervals import Interval
from experiments.pages.page import Notice, Table
from tests.asymmetry.test_added_error import row
from tests.asymmetry.test_asymmetry_pages import page, text_of

ROUTES, RUNS = ("T3", "T4"), 64
WOBBLE = np.tile([1.0, -1.0], RUNS // 2)
"""Errors of standard deviation 1; over 64 runs their mean has half a 95 % interval of 1.96 / √63."""


def texts(table: Table, place: int) -> list[str]:
    """The cells of a row of a table."""
    return [cell.text for cell in table.rows[place]]


def half(sigma: float) -> float:
    """Half of the 95 % interval of the mean over two missions of values that wobble by sigma."""
    return 1.959964 * sigma / np.sqrt(2 * (RUNS - 1))


def curve(route: str, value: tuple[float, ...], interval: float, offset: float = float("nan")) -> Curve:
    """One whose error grows by 1 m from value to value."""
    means = tuple(0.5 + i for i in range(len(value)))
    halves = tuple(0.0 if i == 0 else 0.5 for i in range(len(value)))
    return Curve(route=route, variant="laisn-2", interval_s=interval, depth_offset_m=offset, value=value,
                 e_p_mean_m=means, excess_half_m=halves)  # fmt: skip


CURVES = Curves(
    tau=tuple(curve(route, (0.01, 0.03, 0.06, 0.1), interval) for route in ROUTES for interval in (1.0, 5.0)),
    pitch=tuple(curve(route, (0.0, -1.0, -3.0, -6.0), 5.0, 10.0) for route in ROUTES),
)


def rows(condition: str, cause: str = "trim") -> list[Row]:
    """On T3 pitch adds 1 m and 4 captures, on T4 3 m and none; of it sensors leave what is written here."""
    made = []
    for route, added, lost in (("T3", 1.0, 4), ("T4", 3.0, 0)):
        where = {"route": route, "depth_offset_m": 10.0, "condition": condition, "cause": cause, "variant": "laisn-2"}
        made += [
            row("level", 0.5 + 0.1 * WOBBLE, **where),
            row("real", 0.5 + added + 0.3 * WOBBLE, np.arange(RUNS) < lost, **where),
            row("level-0.5", 0.6 + 0.1 * WOBBLE, **where),
            row("attitude-0", 0.5 + 0.01 * added + 0.1 * WOBBLE, **where),
            row("ahrs-0.5", 0.5 + 0.05 * added + 0.2 * WOBBLE, **where),
            row("attitude-0.5", 0.5 + 0.3 * added + 0.1 * WOBBLE, **where),
            row("offset-0.5", 0.5 + 0.4 * added + 0.1 * WOBBLE, **where),
        ]
    return made


def test_means_carry_half_of_their_interval() -> None:
    assert mean_cell(Interval(1.234, 1.034, 1.434)).text == "1.23 ± 0.20"
    assert mean_cell(Interval(-0.012, -0.112, 0.088), 1, 100.0).text == "−1.2 ± 10.0"
    assert between(Interval(1.234, 1.1, 1.5)).text == "1.23 (1.10 … 1.50)"


def test_a_condition_is_told_by_its_means_over_routes() -> None:
    condition = QUICK_CONDITIONS[0]
    missions = paired(rows(condition.key))
    table, lines = mission_table(missions, [condition], [10.0], CURVES)
    found = texts(table, 0)
    # pitch as of `row`
    assert found[1:4] == ["10", "5.0", "6.0"]
    assert found[4] == f"0.50 ± {half(0.1):.2f}"
    assert found[5] == f"2.50 ± {half(0.3):.2f}"
    assert found[6] == f"2.00 ± {half(0.2):.2f}"
    assert found[7] == "–"
    # excesses of 1 and 3 m are τ of 0.03 and 0.1 m; beyond 3 m the curve ends, and the upper limit is unknown
    spread = 1.959964 * 0.2 / np.sqrt(RUNS - 1)
    assert found[8] == "0.065 ± –"
    longer = Curves(tau=tuple(curve(r, (0.01, 0.03, 0.06, 0.1, 0.3), 1.0) for r in ROUTES), pitch=())
    # 0.02 m a metre below 1 m and 0.03 above; 0.04 below 3 m and 0.2 above
    tau = np.hypot(0.025, 0.12) * spread / 2
    assert texts(mission_table(missions, [condition], [10.0], longer)[0], 0)[8] == f"0.065 ± {tau:.3f}"
    # 4 of 64 on one route and none on the other: 4 ± 1.96 √(64 · 64/63 · p (1 − p)), p = 1/16
    most = 1.959964 * np.sqrt(RUNS * RUNS / (RUNS - 1) / 16 * 15 / 16)
    assert found[9] == f"4 ({4 - most:.0f} … {4 + most:.0f})".replace("-0", "0")
    assert found[10] == "T4"
    assert found[11] == f"3.00 ± {1.959964 * 0.2 / np.sqrt(RUNS - 1):.2f}"
    assert "laisn fly T4" in lines
    assert "T3" not in lines


def test_three_transmitters_have_a_column_of_their_own() -> None:
    """What pitch adds to them is half of what it adds to two."""
    condition = QUICK_CONDITIONS[0]
    two = rows(condition.key)
    three = [replace(r, variant="laisn-3-2", e_p_run_mean_m=tuple(0.5 * e for e in r.e_p_run_mean_m)) for r in two]
    found = texts(mission_table(paired([*two, *three]), [condition], [10.0], CURVES)[0], 0)
    assert found[6:8] == [f"2.00 ± {half(0.2):.2f}", f"1.00 ± {half(0.1):.2f}"]


def test_routes_and_what_sensors_leave() -> None:
    missions = paired([r for cause in ("trim", "dive", "waves") for r in rows(cause, cause)])
    table = _route_table(missions, ROUTES)
    assert texts(table, 0)[1] == f"1.00 ± {1.959964 * 0.2 / np.sqrt(RUNS - 1):.2f}"
    assert texts(table, 1)[2].startswith("99.0 (")
    assert texts(table, 1)[3].startswith("95.0 (")
    assert texts(table, 1)[4].startswith("70.0 (")
    split = texts(_split_table(missions, [10.0]), 0)
    assert split[3] == f"200.0 ± {100 * half(0.2):.1f}"
    # 0.5 + 0.3 · 2 − 0.6 by pitch, and 0.6 − 0.5 by the sensor
    assert split[4] == "50.0 ± 0.0"
    assert split[5] == "10.0 ± 0.0"
    assert split[8] == f"10.0 ± {100 * half(0.1):.1f}"
    assert split[9] == "80.0 ± 0.0"


def test_stage_4_reads_tau_as_pitch() -> None:
    """1 ± 0.5 m at 0.03 m: 1° is 1 m, and half a metre 0.5° below, 2° a metre above."""
    found = texts(stage_4_table(CURVES, [10.0]), 0)
    assert found == ["T3", "1.00 ± 0.50", "1.0 (0.5 … 2.0)", "2.00 ± 0.50", "3.0 (2.0 … 4.5)"]
    steep = Curves(tau=CURVES.tau, pitch=tuple(curve(r, (0.0, -15.0), 5.0, 10.0) for r in ROUTES))
    assert texts(stage_4_table(steep, [10.0]), 0)[2] == "15.0 (7.5 … > 15)"


def test_gates_are_told_with_their_intervals() -> None:
    share, rare = Interval(0.5, 0.25, 0.75), Interval(0.01, 0.005, 0.02)
    mean, without = Interval(2.0, 1.5, 2.5), Interval(0.5, 0.4, 0.6)
    gate = GateRow(route="T5", rule="v-max", interval_s=5.0, detected=share, false_alarms=rare, e_p_mean_m=mean,
                   e_p_mean_without_echoes_m=without)  # fmt: skip
    assert texts(gate_table([gate]), 0) == [
        "T5", "5", "v-max", "50.0 (25.0 … 75.0)", "1.00 (0.50 … 2.00)", "2.00 (1.50 … 2.50)", "0.50 (0.40 … 0.60)",
    ]  # fmt: skip


def test_planner_abeam_divides_the_bound_by_the_sine_of_pitch() -> None:
    table = planner_table(40.0, 0.5)
    abeam = list(table.heads).index("90°")
    for place, cells in enumerate(table.rows):
        pitch = float(cells[0].text)
        assert float(texts(table, place)[abeam]) == pytest.approx(min(0.5 / np.sin(np.deg2rad(pitch)), 50.0), abs=0.06)


def test_levels_and_reals_are_those_of_their_arms() -> None:
    (one, _) = paired(rows("trim-12N")).values()
    assert one.errors(LEVEL).mean() == pytest.approx(0.5)
    assert one.errors(REAL).mean() == pytest.approx(1.5)


def verdicts(error: str, capture: str, **changes: Any) -> list[Row]:
    """The rows of `rows`, with these verdicts on every remedy."""
    made = [replace(r, **changes) for r in rows("trim-12N")]
    return [
        replace(r, error_verdict=error, capture_verdict=capture) if r.arm not in ("level", "real") else r for r in made
    ]


def test_remedies_are_told_with_their_share_of_the_sum_and_their_verdicts() -> None:
    """Pitch adds 1 m and 3 m; the AHRS leaves a twentieth of it, readings 0.5° off three tenths, no pitch 1 %."""
    mixed = [r for r in verdicts("met", "open") if r.route == "T3"] + [
        r for r in verdicts("missed", "no harm shown") if r.route == "T4"
    ]
    shown = {row[0].text: row for row in _remedy_table(paired(mixed), ["laisn-2"]).rows}
    assert list(shown) == [EXACT.label, STEADIED.label, READINGS.label, CROOKED.label]
    assert [cell.text for cell in shown[STEADIED.label]][1:5] == ["laisn-2", "trim", "2", "90 %"]
    assert [shown[arm.label][5].text.partition(" ")[0] for arm in (EXACT, STEADIED, READINGS, CROOKED)] == [
        "99.0", "95.0", "70.0", "60.0",
    ]  # fmt: skip
    # 95 % is beyond the aim of 90 %, with 0.06 m · 1.96 / √63 or so to spare; 99 % are at the aim itself
    assert [shown[arm.label][5].tone for arm in (EXACT, STEADIED, READINGS, CROOKED)] == ["", "yes", "no", "no"]
    for told in shown.values():
        # met, open, missed, no harm shown: of errors, and of captures
        assert [cell.text for cell in told][6:] == ["1", "0", "1", "0", "0", "1", "0", "1"]
        assert told[8].tone == "maybe"


def test_captures_are_told_arm_by_arm() -> None:
    """4 of 64 runs on one of two routes behind the real leader, which any remedy avoids."""
    shown = {row[2].text: row for row in _capture_table(paired(rows("trim-12N")), ["laisn-2"]).rows}
    exact = stats.binomtest(4, 128).proportion_ci(0.95, "exact")
    real = [cell.text for cell in shown[REAL.label]]
    assert real[:2] == ["laisn-2", "trim"]
    assert real[3:] == ["128", f"3.12 ({100 * exact.low:.2f} … {100 * exact.high:.2f})", "–"]
    steadied = [cell.text for cell in shown[STEADIED.label]]
    none = stats.binomtest(0, 128).proportion_ci(0.95, "exact")
    assert steadied[4] == f"0.00 (0.00 … {100 * none.high:.2f})"
    assert steadied[5].startswith("100.0 (")


def test_shortfalls_are_told_with_their_number_and_largest_rest() -> None:
    plan = Plan(looks=(RUNS,))
    missed = verdicts("missed", "open")
    told = [block.text for block in shortfalls(paired(missed), plan)["shortfalls"] if isinstance(block, Notice)]
    assert told[1] == (
        "AHRS of 0.5°, trim: on 2 of 2 missions (LAISN-2) the runs show that more than 10 % of the pitch-driven error "
        "without captures stays; the largest such rest is 0.15 m."
    )
    assert told[0].startswith("attitude, exact, trim: on 2 of 2 missions (LAISN-2) the runs show that more than 1 % of")
    assert told[2].endswith("the largest such rest is 0.90 m.")
    paired_too = text_of(page(judged=2, **shortfalls(paired(missed), plan)))
    # against a level leader with the same sensor 0.2 of 1 m and 0.8 of 3 m stay
    assert "the aim is missed on 2 of 2 missions (0 open)" in paired_too
    assert shortfalls(paired(verdicts("met", "open")), plan)["shortfalls"] == []


def test_what_distrust_does_is_told_cause_by_cause() -> None:
    """It leaves 1.2 times what pitch adds by trim, half of it in waves."""
    made = []
    for cause, left in (("trim", 1.2), ("waves", 0.5)):
        where = {"condition": cause, "cause": cause}
        made += [
            row("level", 0.5, **where),
            row("real", 1.5 + 0.01 * WOBBLE, **where),
            row("expected", 0.5 + left, **where),
        ]
    said = _inflated([*paired(made).values()])
    assert said.replace("-", "−").startswith("−20 % (")
    assert " with trim, 50 % (" in said
    assert in_words(Interval(0.5, 0.25, 0.75)) == "50 % (25 to 75 %)"


def test_the_map_says_how_far_closed_form_and_engine_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """A map made by hand whose engine is 3 mm off the closed form at one point, and 0.876 m abeam at 5° and 10 m."""
    points = [
        (p, dz, d, b) for p in (0.0, 5.0) for dz in (0.0, 2.0, 5.0, 10.0) for d in (20.0, 50.0) for b in (90.0, 135.0)
    ]
    columns = dict(zip(("pitch_deg", "depth_offset_m", "range_m", "bearing_deg"), np.array(points).T, strict=True))
    form = 0.1 * (1.0 + columns["depth_offset_m"])
    engine = form.copy()
    engine[points.index((5.0, 10.0, 20.0, 90.0))] = form[points.index((5.0, 10.0, 20.0, 90.0))] = 0.876
    engine[points.index((5.0, 2.0, 50.0, 135.0))] -= 0.003
    form[0] = np.nan
    third = np.where(np.arange(len(points)) % 8 == 0, -0.003, 0.001)
    columns |= {"error_laisn-2_m": engine, "error_closed_form_m": form, "error_laisn-3-2_m": engine + third}
    monkeypatch.setattr(question_page, "drawing", Mock())
    monkeypatch.setattr(question_page, "svg", lambda *_: "")
    said = text_of(page(**question_page.on_map(pa.table(columns))))
    assert "At 5° and 10 m the error abeam is 0.876 to 1.100 m, whatever the range" in said
    assert "differ from those of LAISN-2 by 0.001 m in the median, and by less than 0.003 m at 95 %" in said
    assert "Over all 32 points of the map, closed form and simulation differ by at most 0.003 m" in said
