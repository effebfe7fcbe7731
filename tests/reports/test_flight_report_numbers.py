"""Numbers in the report of a flight: each cell and each curve against what was put into the
flight.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.estimates import FIX_WORDS, FixKind, TightEstimates
from reports import flight_figures, flight_report
from reports.figures import Subplot
from reports.flight_report import (
    _facts,
    final_states,
    follower_curves,
    mirror_locks,
    states_table,
)
from reports.page import Code, Page, PageTable
from reports.range_budget import Cause, RangeErrorBudget
from sim.flight import FlightRecord, excerpt
from tests.golden import require_golden
from tests.synthetic import make_flight


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return make_flight(20.0)


def texts(row: Any) -> list[str]:
    return [cell.text for cell in row]


def page_of_flight(
    flight: FlightRecord, rows: Sequence[dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> Page:
    """The page of a flight whose summary has these rows, without its versions and scenario."""
    pages: list[Page] = []
    monkeypatch.setattr(flight_report, "write", lambda page, _: pages.append(page))
    summary = {"followers": dict(zip(flight.trajectory.names[1:], rows, strict=True))}
    n = flight.step_index().size
    errors = [(np.zeros(n), np.zeros(n))] * len(rows)
    flight_report.flight_report(
        flight, errors, summary, Path("report.html"), None, [np.ones(n)] * len(rows)
    )
    (page,) = pages
    sections = [
        dataclasses.replace(section, blocks=[b for b in section.blocks if not isinstance(b, Code)])
        for section in page.sections
    ]
    return dataclasses.replace(page, facts=[], sections=sections)


ROUTE_FIGURES = {
    "e_p_max_m": 1.1,
    "e_p_mean_m": 1.2,
    "e_p_std_m": 1.3,
    "e_b_max_deg": 2.1,
    "e_b_mean_deg": 2.2,
    "e_b_std_deg": 2.3,
    "track_error_rms_m": 3.1,
    "fixes": {"gated": 4, "lost": 0, "two_points": 5},
}
"""A follower's figures, each of its own number."""
STATION_FIGURES = ROUTE_FIGURES | {
    "station_rms_m": 6.1,
    "station_p95_m": 6.2,
    "station_max_m": 6.3,
    "joined_s": 7.0,
    "lost": True,
    "fixes": {"gated": 0, "lost": 0, "two_points": 8},
}


def test_the_page_of_a_flight_is_the_golden_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three followers one keeps a station, one has no fixes; each figure has its number."""
    rows = (STATION_FIGURES, ROUTE_FIGURES | {"fixes": {}}, ROUTE_FIGURES)
    require_golden(page_of_flight(make_flight(20.0, 3), rows, monkeypatch), "flight")


def test_a_follower_on_station_has_no_column_of_its_track_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page = page_of_flight(make_flight(20.0), [STATION_FIGURES], monkeypatch)
    heads_of_tables = [
        b.heads for part in page.sections for b in part.blocks if isinstance(b, PageTable)
    ]
    (details,) = (heads for heads in heads_of_tables if "mean [°]" in heads)
    assert len(details) == 5


def test_a_page_lists_the_settings_of_its_flight(flight: FlightRecord) -> None:
    scenario = flight.scenario.model_copy(update={"seed": 5, "run": 7})
    facts = dict(_facts(dataclasses.replace(flight, scenario=scenario), {}))
    assert (facts["Seed, run"], facts["Flown"], facts["Motion"]) == ("5, 7", "20 s", "physics")
    assert facts["Filter step, message interval"] == "0.1 s, 1 s"


def test_a_mirror_lock_is_reported_with_its_share_of_the_mission(flight: FlightRecord) -> None:
    steps = flight.step_index()
    heading, leader = flight.trajectory.heading[steps, 0], flight.trajectory.position[steps, 0, :2]
    truth, (estimates,) = flight.hydrophone(0)[:, :2], flight.estimates
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    side = np.einsum("ni,ni->n", truth - leader, starboard)
    state = estimates.state.copy()
    # for 25 of 200 steps
    state[:, :2] = truth - np.where(np.arange(200) < 25, 2 * side, 0.0)[:, None] * starboard
    mirror_locked = dataclasses.replace(
        flight, estimates=(dataclasses.replace(estimates, state=state),)
    )
    assert mirror_locks(mirror_locked, ["follower"]) == {"follower": 12.5}


def test_causes_are_reported_in_centimetres_rms() -> None:
    """A lever arm of ±3 cm at the rear and ∓1 cm at the front in turns, an echo of 1 m once at
    the rear.
    """
    share = np.zeros((4, 3, len(Cause)))
    share[:, 0, Cause.LEVER_ARM] = [0.03, -0.03, 0.03, -0.03]
    share[:, 1, Cause.LEVER_ARM] = [-0.01, 0.01, -0.01, 0.01]
    share[1, 0, Cause.ECHO] = 1.0
    budget = RangeErrorBudget(
        time=np.arange(4.0), level_range=np.ones((4, 3)), used_range=np.ones((4, 3)), share=share
    )
    table = flight_report.share_table(budget, transmitters=2)
    assert [texts(row) for row in table.rows] == [
        ["lever arm", "3.0", "1.0", "4.0", "4.0"],
        ["echo", "50.0", "0.0", "50.0", "100.0"],
    ]
    assert table.heads == ("cause", "rear", "front", "rms", "largest")
    panel = flight_report.asymmetry_over_time(
        budget.time, {Cause.LEVER_ARM: budget.asymmetry[:, 1]}, ""
    )
    np.testing.assert_allclose(panel.parts[0].lines[0].y, [-4.0, 4.0, -4.0, 4.0])


def test_assumed_sensor_angles_are_reported_in_degrees(flight: FlightRecord) -> None:
    names = ("east_m", "north_m", "log_bias_m_s", "compass_bias_rad", "leader_compass_bias_rad")
    estimates = object.__new__(TightEstimates)
    fields: dict[str, Any] = {
        "names": names,
        "fix_step": np.array([1, 2]),
        "full_state": np.array([[9.0] * 5, [1.0, 2.0, 0.3, np.deg2rad(4.0), np.nan]]),
        "full_sigma": np.array([[9.0] * 5, [0.1, 0.2, 0.03, np.deg2rad(0.5), 1.0]]),
    }
    for name, value in fields.items():
        object.__setattr__(estimates, name, value)
    changed = dataclasses.replace(flight, estimates=(estimates,))
    states = final_states(changed)
    assert [texts(row) for row in states_table(states).rows] == [
        ["log bias [m/s]", "0.30", "0.03"],
        ["compass bias [°]", "4.00", "0.50"],
    ]
    # of several followers a column each
    states_of_other = {"compass bias [°]": states["follower"]["compass bias [°]"]}
    table = states_table({**states, "other": states_of_other})
    assert list(table.heads) == ["follower", "log bias [m/s]", "compass bias [°]"]
    assert [texts(row) for row in table.rows] == [
        ["follower", "0.30 ± 0.03", "4.00 ± 0.50"],
        ["other", "–", "4.00 ± 0.50"],
    ]


def test_every_colour_of_a_followers_curves_is_in_its_legend(flight: FlightRecord) -> None:
    """Kinds of fix and hypotheses have words or names of their own."""
    n = flight.step_index().size
    curves = follower_curves(flight, 0, (np.full(n, 2.0), np.zeros(n)), np.full(n, 0.5))
    legend = {colour for colour, _ in curves.legend}
    for panel in curves.panels:
        for subplot in panel.parts:
            assert subplot.y_label == "fixes" or {line.colour for line in subplot.lines} <= legend
    assert {panel.link for panel in curves.panels} == {"follower0"}


@pytest.mark.parametrize(("second_weight", "shown"), [(0.4, True), (0.0011, True), (0.0009, False)])
def test_weights_of_hypotheses_are_shown_where_there_ever_were_several(
    flight: FlightRecord, second_weight: float, shown: bool
) -> None:
    estimates = object.__new__(TightEstimates)
    weight = np.array([[1.0, 0.0], [1.0 - second_weight, second_weight], [1.0, 0.0]])
    fields = {
        "fix_step": np.array([10, 20, 30]),
        "weight": weight,
        "hypothesis": np.zeros((3, 2, 2)),
        "hypothesis_covariance": np.zeros((3, 2, 2, 2)),
    }
    for name, value in fields.items():
        object.__setattr__(estimates, name, value)
    subplot = flight_figures.weights_part(dataclasses.replace(flight, estimates=(estimates,)), 0)
    assert (subplot is not None) == shown
    if subplot is not None:
        for line, column in zip(points_of_lines(subplot), weight.T, strict=True):
            np.testing.assert_allclose(line, np.column_stack([[1.0, 2.0, 3.0], column]))
    assert flight_figures.weights_part(flight, 0) is None


def test_weights_of_an_excerpt_are_at_times_of_the_mission(flight: FlightRecord) -> None:
    estimates = object.__new__(TightEstimates)
    fields = {
        "fix_step": np.array([10, 20]),
        "weight": np.array([[0.5, 0.5], [0.4, 0.6]]),
        "hypothesis": np.zeros((2, 2, 2)),
        "hypothesis_covariance": np.zeros((2, 2, 2, 2)),
    }
    for name, value in fields.items():
        object.__setattr__(estimates, name, value)
    second_part = excerpt(flight, 5.0, 15.0)
    subplot = flight_figures.weights_part(
        dataclasses.replace(second_part, estimates=(estimates,)), 0
    )
    assert subplot is not None
    np.testing.assert_allclose(subplot.lines[0].x, [6.0, 7.0])


def points_of_lines(subplot: Subplot) -> list[Floats]:
    return [np.column_stack([line.x, line.y]) for line in subplot.lines]


def test_motion_ranges_and_tracks_are_drawn_as_flown(flight: FlightRecord) -> None:
    truth, (estimates,), (measured,) = flight.trajectory, flight.estimates, flight.measurements
    expected = {
        "depth [m]": -truth.position[..., 2],
        "pitch [°]": np.rad2deg(truth.pitch),
        "speed [m/s]": truth.forward_speed,
    }
    for subplot, (label, values) in zip(
        flight_figures.motion(flight).parts, expected.items(), strict=True
    ):
        assert subplot.y_label == label
        follower, leader = points_of_lines(subplot)
        np.testing.assert_allclose(follower[:, 1], values[:, 1])
        np.testing.assert_allclose(leader[:, 1], values[:, 0])
    *_, rear_range = points_of_lines(flight_figures.ranges_part(flight, 0))
    np.testing.assert_allclose(rear_range[:, 0], 1.0 * np.arange(1, 21))
    np.testing.assert_allclose(rear_range[:, 1], measured.ranges[:, 0])
    (subplot,) = flight_figures.track_map(flight, [0]).parts
    leader, true_track, estimated_track, *ends = points_of_lines(subplot)
    np.testing.assert_allclose(leader, truth.position[1:, 0, :2])
    np.testing.assert_allclose(true_track, flight.hydrophone(0)[:, :2])
    np.testing.assert_allclose(estimated_track, estimates.state[:, :2])
    np.testing.assert_allclose(
        np.concatenate(ends), [truth.position[-1, 0, :2], flight.hydrophone(0)[-1, :2]]
    )
    for line in subplot.lines[:3]:
        np.testing.assert_allclose(line.time, truth.time[1:])


def test_marks_of_fixes_stand_at_their_times_in_the_row_of_their_kind(flight: FlightRecord) -> None:
    """Every fourth of twenty fixes, a second apart, is rejected; the first row is that of the
    kind that comes first.
    """
    (estimates,) = flight.estimates
    assert estimates.fix_step.tolist() == list(range(10, 201, 10))
    kind = np.where(np.arange(20) % 4 == 3, int(FixKind.GATED), int(FixKind.TWO_POINTS))
    changed = dataclasses.replace(
        flight, estimates=(dataclasses.replace(estimates, fix_kind=kind),)
    )
    subplot = flight_figures.fixes_part(changed, 0)
    words = [*dict(subplot.ticks).values()]  # type: ignore[arg-type]
    for row, (mark, word) in enumerate(zip(points_of_lines(subplot), words, strict=True)):
        rejected = word == "rejected"
        assert mark[:, 0] == pytest.approx(
            [second for second in range(1, 21) if (second % 4 == 0) == rejected]
        )
        assert set(mark[:, 1].tolist()) == {float(row)}
    assert sorted(words) == ["rejected", "two points"]


def test_kinds_of_fix_have_words_of_their_own() -> None:
    assert set(FIX_WORDS) == set(FixKind)
    assert len(set(FIX_WORDS.values())) == len(FixKind)
