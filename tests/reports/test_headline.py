"""The first screen of a report: two sentences and key figures, judged against what is expected."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from reports.headline import cause, figure_text, headline, tiles, tone_of
from reports.verdict import Loss, Verdict
from sim.flight import FlightRecord
from tests.reports.test_flight_report_stations import constant_offsets, flight_beside_stations
from tests.synthetic import make_flight

GOOD = Verdict(sentence="The mean position error is 1.00 m; the largest is 4.00 m.", lost=())


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return make_flight(20.0)


def accuracy_figures(**changes: float) -> dict[str, float]:
    """Figures of a follower's accuracy, as `flight_report.accuracy` gives them, some changed."""
    defaults = {
        "mean": 1.0,
        "high": 2.0,
        "largest": 4.0,
        "largest_s": 12.0,
        "outside": 0.14,
        "near_axis": 0.0,
        "mean_near": np.nan,
        "mean_elsewhere": 1.0,
        "wrong_side": 0.0,
    }
    return defaults | changes


def summary(**row: Any) -> dict[str, Any]:
    """Summary of a flight with one follower."""
    return {"followers": {"follower": {"nees": 2.0, "rms_over_bound": 1.0} | row}}


def test_two_sentences_name_the_mission_the_result_and_the_cause(flight: FlightRecord) -> None:
    near = accuracy_figures(near_axis=0.86, mean_near=1.44, mean_elsewhere=0.34)
    assert headline(flight, GOOD, summary(), {"follower": near}) == (
        "One follower swims with a leader for 20 s, navigating by LAISN-2 on 2 transmitters. The "
        "mean position error is 1.00 m; the largest is 4.00 m: 86\u00a0% of the time it is within "
        "15° of the leader's axis, where two transmitters cannot tell the side."
    )


@pytest.mark.parametrize(
    ("accuracy", "nees", "expected"),
    [
        (
            accuracy_figures(near_axis=0.5, mean_near=1.0, mean_elsewhere=1.0),
            2.0,
            "",
        ),  # no worse there
        (
            accuracy_figures(near_axis=1.0, mean_near=1.0, mean_elsewhere=np.nan),
            2.0,
            "100 % of the time",
        ),
        (accuracy_figures(near_axis=0.2, mean_near=9.0, mean_elsewhere=1.0), 2.0, ""),  # too seldom
        (accuracy_figures(wrong_side=0.2), 2.0, "20 % of the time it is on the wrong side"),
        (accuracy_figures(), 50.0, "surer than right (mean NEES 50.0, 2 expected)"),
        (accuracy_figures(), None, ""),
    ],
)
def test_a_cause_is_named_where_one_stands_out(
    accuracy: dict[str, float], nees: float | None, expected: str
) -> None:
    sentence = cause(2, accuracy, nees)
    assert expected in sentence
    assert bool(sentence) == bool(expected)


def test_the_leaders_axis_is_no_cause_where_another_link_is_navigated_on(
    flight: FlightRecord,
) -> None:
    near = accuracy_figures(near_axis=0.86, mean_near=1.44, mean_elsewhere=0.34, wrong_side=0.3)
    navigation = flight.scenario.navigation.model_copy(update={"link": "lbl"})
    scenario = flight.scenario.model_copy(update={"navigation": navigation})
    among_beacons = dataclasses.replace(flight, scenario=scenario)
    sentence = headline(among_beacons, GOOD, summary(), {"follower": near})
    assert sentence.endswith(GOOD.sentence)
    sentence = headline(among_beacons, GOOD, summary(nees=50.0), {"follower": near})
    assert "surer than right (mean NEES 50.0, 2 expected)" in sentence


def test_a_loss_is_told_before_all_else(flight: FlightRecord) -> None:
    loss = Loss(follower="follower", time_s=3.0, what="gone", cause="a test", silence_s=0.0)
    verdict = Verdict(sentence="follower was lost.", lost=(loss,))
    assert headline(flight, verdict, summary(), {}).endswith("transmitters. follower was lost.")


def test_a_formation_is_first_asked_whether_it_keeps_station() -> None:
    formation = flight_beside_stations(constant_offsets(0.3, 1.5))
    row = {"station_max_m": 0.5, "joined_s": 0.0, "lost": False}
    rows: dict[str, Any] = {
        "follower1": row | {"station_rms_m": 0.3},
        "follower2": row | {"station_rms_m": 0.4, "station_max_m": 2.5},
    }
    sentence = headline(formation, GOOD, {"followers": rows}, {})
    assert sentence.startswith("2 followers hold their stations on a leader for 60 s")
    assert sentence.endswith(
        "All keep station: 0.30 to 0.40 m off it (RMS), 2.50 m at most (follower2)."
    )
    # of followers of which some have routes
    mixed = headline(formation, GOOD, {"followers": {**rows, "scout": {}}}, {})
    assert "The 2 on stations keep station: 0.30 to 0.40 m" in mixed
    single = {"follower2": rows["follower2"], "scout": {}}
    assert "follower2 keeps station: 0.40 m" in headline(formation, GOOD, {"followers": single}, {})
    first, rms, farthest = tiles({"followers": rows}, {})
    assert (first.value, first.tone) == ("2 of 2", "good")
    assert rms.value == "0.35 m"  # the root of (0.09 + 0.16) / 2
    assert (farthest.value, farthest.remark) == ("2.50 m", "follower2")
    rows["follower1"] = row | {"station_rms_m": 9.0, "lost": True}
    rows["follower2"] = row | {"station_rms_m": 9.0, "joined_s": None}
    first, *_ = tiles({"followers": rows}, {})
    assert (first.value, first.tone) == ("0 of 2", "bad")


@pytest.mark.parametrize(
    ("name", "row", "accuracy", "tone"),
    [
        ("NEES", {"nees": 2.0}, {}, "good"),
        ("NEES", {"nees": 6.0}, {}, ""),
        ("NEES", {"nees": 6e4}, {}, "bad"),
        ("NEES", {"nees": 0.01}, {}, "bad"),
        ("outside its 2σ", {}, {"outside": 0.14}, "good"),
        ("outside its 2σ", {}, {"outside": 0.30}, ""),
        ("outside its 2σ", {}, {"outside": 1.00}, "bad"),
        ("× bound", {"rms_over_bound": 1.1}, {}, "good"),
        ("× bound", {"rms_over_bound": 5.0}, {}, "bad"),
    ],
)
def test_key_figures_are_judged_against_what_is_expected(
    name: str, row: dict[str, Any], accuracy: dict[str, float], tone: str
) -> None:
    shown = {
        tile.name: tile
        for tile in tiles(summary(**row), {"follower": accuracy_figures(**accuracy)})
    }
    assert shown[name].tone == tone


def test_the_tiles_of_several_followers_are_of_all_or_of_the_worst() -> None:
    rows = {"a": {"nees": 1.0, "rms_over_bound": 1.0}, "b": {"nees": 3.0, "rms_over_bound": 4.0}}
    accuracy = {
        "a": accuracy_figures(mean=1.0),
        "b": accuracy_figures(mean=2.0, largest=9.0, largest_s=7.0, high=5.0),
    }
    shown = {tile.name: tile for tile in tiles({"followers": rows}, accuracy)}
    assert shown["mean error"].value == "1.50 m"
    assert shown["mean error"].remark == "95 % below 5.00 m, worst follower"
    assert (shown["largest error"].value, shown["largest error"].remark) == (
        "9.00 m",
        "b, at 7 s",
    )
    assert shown["NEES"].value == "2.00"
    assert shown["× bound"].value == "4.00"


def test_what_is_not_known_is_not_judged() -> None:
    assert tone_of(None, (0.0, 1.0), (0.0, 2.0)) == ""
    assert tone_of(float("nan"), (0.0, 1.0), (0.0, 2.0)) == ""
    assert [
        tile.name
        for tile in tiles(summary(nees=None, rms_over_bound=None), {"f": accuracy_figures()})
    ][2:] == ["outside its 2σ"]


def test_figures_have_about_three_digits() -> None:
    assert [figure_text(value) for value in (0.052, 12.34, 123.4, 61387.0, 20.4071e6)] == [
        "0.05",
        "12.3",
        "123",
        "61 thousand",
        "20.4 million",
    ]


def test_an_unfinished_flight_says_so(flight: FlightRecord) -> None:
    stopped = dataclasses.replace(flight, outcome=type(flight.outcome).GROUNDED)
    sentence = headline(
        stopped, GOOD, summary(), {"follower": accuracy_figures(near_axis=1.0, mean_near=3.0)}
    )
    assert sentence.endswith(GOOD.sentence)
