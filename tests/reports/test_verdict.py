"""The first sentence of a flight's page: who was lost, when, and why, in flights made so."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from laisn.arrays import Floats
from laisn_sim.cli.main import app
from reports.flight_report import flight_report
from reports.summary import route_events, summarise
from reports.verdict import Loss, _lost_text, longest_silence, verdict
from sim.flight import FlightRecord, Termination, excerpt, position_and_bearing_errors
from sim.scenario.formation import Station
from sim.scenario.links import LinkTable
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Navigation
from sim.tracking import track_errors
from tests.synthetic import make_flight

NO_TRACK_ERROR = np.zeros((6001, 3))
"""Distance of each follower from its route or station at each instant [m]."""


def with_errors(
    flight: FlightRecord, follower: int, offsets: Floats, sigma: float = 1.0
) -> FlightRecord:
    """The flight with an estimate that is off by `offsets`, shape (n, 2), [m], and states the
    standard deviation `sigma` [m].
    """
    estimates = list(flight.estimates)
    old = estimates[follower]
    state = old.state.copy()
    state[:, :2] = flight.hydrophone(follower)[:, :2] + offsets
    covariance = np.tile(sigma**2 * np.eye(4), (len(state), 1, 1))
    estimates[follower] = dataclasses.replace(old, state=state, covariance=covariance)
    return dataclasses.replace(flight, estimates=tuple(estimates))


def without_messages(
    flight: FlightRecord, follower: int, begin_s: float, end_s: float
) -> FlightRecord:
    """The flight without the messages of a follower in a part of the mission."""
    measurements = list(flight.measurements)
    old = measurements[follower]
    received = old.time[old.message_step - 1]
    ranges = old.ranges.copy()
    ranges[(received > begin_s) & (received < end_s)] = np.nan
    measurements[follower] = dataclasses.replace(old, ranges=ranges)
    return dataclasses.replace(flight, measurements=tuple(measurements))


def with_jump_at(
    flight: FlightRecord, follower: int, time_s: float, sigma: float = 1.0
) -> FlightRecord:
    """The flight with an error that jumps from 1 m to 11 m at a time, along the leader's axis."""
    steps = flight.step_index()
    heading = flight.trajectory.heading[steps, 0]
    ahead = np.column_stack([np.sin(heading), np.cos(heading)])
    time = flight.trajectory.time[steps]
    size = np.where(time > time_s - 0.01, 11.0, 1.0)
    return with_errors(flight, follower, size[:, None] * ahead, sigma)


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    """Three followers, whose leader turns by 1 rad a minute."""
    calm = make_flight(600.0, 3)
    for follower in range(3):
        calm = with_errors(calm, follower, np.tile([0.5, 0.0], (6000, 1)))
    return calm


def test_a_flight_in_which_none_is_lost_begins_with_its_errors(flight: FlightRecord) -> None:
    actual = verdict(flight, NO_TRACK_ERROR)
    assert actual.lost == ()
    assert actual.sentence.startswith("The mean position errors of 3 followers lie between 0.50 m")


def test_a_silence_in_an_excerpt_has_the_times_of_the_mission(flight: FlightRecord) -> None:
    part = excerpt(without_messages(flight, 1, 340.0, 401.0), 300.0, 500.0)
    actual = longest_silence(part, 1, 320.0, 480.0)
    assert (actual.begin_s, actual.end_s) == pytest.approx((340.0, 401.0))


def test_a_silence_before_a_loss_is_its_cause_with_the_leaders_turn(flight: FlightRecord) -> None:
    """The leader goes round a circle of 60 m at 1 m/s: 57.3° in a minute."""
    changed = without_messages(with_jump_at(flight, 1, 400.0), 1, 340.0, 401.0)
    actual = verdict(changed, NO_TRACK_ERROR)
    (loss,) = actual.lost
    assert (loss.follower, loss.time_s) == ("follower2", pytest.approx(400.0))
    assert loss.silence_s == pytest.approx(60.0, abs=1.1)
    turn = np.degrees(loss.silence_s / 60.0)
    assert actual.sentence == (
        "1 of 3 followers was lost: follower2 at 400 s; likeliest cause of the first (its estimate "
        f"more than 10 m off): no message for 60 s (340 s to 400 s), in which the leader turned by "
        f"{turn:.0f}°."
    )


def test_several_losses_are_in_order_of_time(flight: FlightRecord) -> None:
    changed = with_jump_at(with_jump_at(flight, 0, 500.0), 2, 300.0)
    actual = verdict(without_messages(changed, 2, 280.0, 301.0), NO_TRACK_ERROR)
    assert [loss.follower for loss in actual.lost] == ["follower3", "follower1"]
    words = "2 of 3 followers were lost: follower3 at 300 s, follower1 at 500 s; likeliest cause"
    assert actual.sentence.startswith(words)
    assert "no message for 20 s (280 s to 300 s)." in actual.sentence
    # 11 m with σ = 1 m
    assert "the record shows no single cause" in actual.lost[1].cause


def test_of_many_losses_four_are_named() -> None:
    lost = [
        Loss(follower=f"f{i}", time_s=10.0 * i, what="adrift", cause="silence", silence_s=0.0)
        for i in range(1, 7)
    ]
    assert "f4 at 40 s, 2 more; " in _lost_text(lost, 9)
    assert "f4 at 40 s; " in _lost_text(lost[:4], 9)


def test_an_error_that_is_set_and_not_assumed_is_a_cause(flight: FlightRecord) -> None:
    acoustics = flight.scenario.acoustics.model_copy(update={"clock_offset_s": 0.01})
    scenario = flight.scenario.model_copy(update={"acoustics": acoustics})
    changed = dataclasses.replace(with_jump_at(flight, 0, 200.0), scenario=scenario)
    (loss,) = verdict(changed, NO_TRACK_ERROR).lost
    assert loss.cause.startswith("an assumption that does not hold: the clocks differ by up to 10")


def test_an_assumption_is_that_of_the_lost_followers_own_navigation(flight: FlightRecord) -> None:
    """All but the second one estimate their clocks."""
    acoustics = flight.scenario.acoustics.model_copy(update={"clock_offset_s": 0.01})
    told = Navigation(variant="tight", assume={"clock": True})
    paper = Navigation(variant="laisn-2")
    followers = tuple(
        follower.model_copy(update={"navigation": paper if i == 1 else told})
        for i, follower in enumerate(flight.scenario.followers)
    )
    changes = {"acoustics": acoustics, "followers": followers}
    scenario = flight.scenario.model_copy(update=changes)
    lost = with_jump_at(with_jump_at(flight, 0, 200.0), 1, 300.0)
    first, second = verdict(dataclasses.replace(lost, scenario=scenario), NO_TRACK_ERROR).lost
    assert "clocks" not in first.cause
    assert second.cause.endswith("navigator 'laisn-2' assumes equal clocks")


def test_a_filter_surer_than_right_is_a_cause(flight: FlightRecord) -> None:
    """An error of 1 m with σ = 0.1 m before: NEES 100."""
    (loss,) = verdict(with_jump_at(flight, 0, 300.0, 0.1), NO_TRACK_ERROR).lost
    assert "surer than right (mean NEES 10" in loss.cause


def test_a_mirror_lock_is_a_cause(flight: FlightRecord) -> None:
    steps = flight.step_index()
    heading = flight.trajectory.heading[steps, 0]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    from_leader = flight.hydrophone(2)[:, :2] - flight.trajectory.position[steps, 0, :2]
    side = np.einsum("ni,ni->n", from_leader, starboard)
    assert np.abs(side).min() > 5.1
    locked = flight.trajectory.time[steps] > 250.0
    offsets = np.where(locked, -2.0 * side, 0.0)[:, None] * starboard
    (loss,) = verdict(with_errors(flight, 2, offsets), NO_TRACK_ERROR).lost
    assert loss.time_s == pytest.approx(250.1)
    assert "locked on the mirror image" in loss.cause


def test_no_one_is_locked_on_the_leaders_axis_who_navigates_on_another_link(
    flight: FlightRecord,
) -> None:
    steps = flight.step_index()
    heading = flight.trajectory.heading[steps, 0]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    from_leader = flight.hydrophone(2)[:, :2] - flight.trajectory.position[steps, 0, :2]
    side = np.einsum("ni,ni->n", from_leader, starboard)
    locked = flight.trajectory.time[steps] > 250.0
    changed = with_errors(flight, 2, np.where(locked, -2.0 * side, 0.0)[:, None] * starboard)
    links = (LinkTable(name="second", sender="follower1"),)
    navigation = flight.scenario.navigation.model_copy(update={"link": "second"})
    scenario = flight.scenario.model_copy(update={"links": links, "navigation": navigation})
    (loss,) = verdict(dataclasses.replace(changed, scenario=scenario), NO_TRACK_ERROR).lost
    assert "mirror" not in loss.cause


def test_a_vehicle_off_its_route_with_a_right_estimate_could_not_move_there(
    flight: FlightRecord,
) -> None:
    plan = flight.scenario.followers[0].model_copy(update={"guidance_position": "estimate"})
    followers = (plan, *flight.scenario.followers[1:])
    scenario = flight.scenario.model_copy(update={"followers": followers})
    track_errors = NO_TRACK_ERROR.copy()
    track_errors[2000:, 0] = 12.0
    (loss,) = verdict(dataclasses.replace(flight, scenario=scenario), track_errors).lost
    assert loss.time_s == pytest.approx(200.0)
    assert loss.what == "more than 10 m off its route"
    assert loss.cause.startswith("not its estimate, which was 0.5 m off, but its motion, at ")


def test_a_follower_on_its_way_to_its_station_is_not_lost(flight: FlightRecord) -> None:
    station = Station(behind_m=20.0, port_m=0.0, depth_m=10.0)
    plan = flight.scenario.followers[0].model_copy(update={"station": station})
    scenario = flight.scenario.model_copy(
        update={"followers": (plan, *flight.scenario.followers[1:])}
    )
    on_station = dataclasses.replace(flight, scenario=scenario)
    track_errors = NO_TRACK_ERROR.copy()
    track_errors[:1000, 0] = 30.0
    assert verdict(on_station, track_errors).lost == ()
    track_errors[4000:, 0] = 12.0
    (loss,) = verdict(on_station, track_errors).lost
    assert (loss.time_s, loss.what) == (pytest.approx(400.0), "more than 10 m off its station")
    track_errors[:, 0] = 30.0
    (loss,) = verdict(on_station, track_errors).lost
    assert (loss.time_s, loss.what) == (pytest.approx(600.0), "never reached its station")


def test_a_controller_of_ones_own_is_not_lost_off_the_route(flight: FlightRecord) -> None:
    """What it aims at is not known; the route of a simulated follower is."""
    assert any(event.source == "follower1" for event in route_events(flight))
    plan = flight.scenario.followers[0].model_copy(update={"controller": "mine:Steer"})
    followers = (plan, *flight.scenario.followers[1:])
    scenario = flight.scenario.model_copy(update={"followers": followers})
    changed = dataclasses.replace(flight, scenario=scenario)
    assert verdict(changed, NO_TRACK_ERROR + 12.0).lost == ()
    assert not any(event.source == "follower1" for event in route_events(changed))


def test_an_outcome_comes_first(flight: FlightRecord) -> None:
    changed = dataclasses.replace(with_jump_at(flight, 0, 300.0), outcome=Termination.DIVERGED)
    sentence = verdict(changed, NO_TRACK_ERROR).sentence
    assert sentence.startswith("The simulation left finite numbers; ")
    assert "1 of 3 followers was lost: follower1 at 300 s" in sentence


@pytest.mark.system
def test_page_and_summary_begin_with_the_verdict(flight: FlightRecord, tmp_path: Path) -> None:
    changed = without_messages(with_jump_at(flight, 1, 400.0), 1, 340.0, 401.0)
    summary = summarise(changed)
    expected = verdict(
        changed, track_errors(MotionSettings.of(changed.scenario), changed.trajectory)
    )
    assert summary["verdict"]["sentence"] == expected.sentence
    assert json.loads(json.dumps(summary["verdict"]))["lost"][0]["follower"] == "follower2"
    page = tmp_path / "report.html"
    flight_report(changed, position_and_bearing_errors(changed), summary, page, None)
    text = re.sub(r"<[^>]*>|\s+", " ", page.read_text(encoding="utf-8"))
    assert expected.sentence in " ".join(text.split())
    assert text.index("was lost: follower2") < text.index("outside 2σ")


@pytest.mark.system
def test_a_follower_without_messages_is_lost_by_its_logs_bias(tmp_path: Path) -> None:
    """Dead reckoning with a bias of 0.4 m/s is 10 m off after 25 s."""
    out = tmp_path / "lost"
    words = "fly T5 --no-video --set motion=kinematic --set duration_s=60 --set sensors.speed_"
    words += "bias_m_s=0.4 --set sensors.speed_sigma_m_s=0 --set sensors.heading_bias_deg=0 "
    words += "--set sensors.heading_sigma_deg=0 --set acoustics.loss_probability=1 "
    words += "--set acoustics.clock_offset_s=0.001"
    result = CliRunner().invoke(app, [*words.split(), "--out", str(out)])
    assert result.exit_code == 0, result.output
    (loss,) = json.loads((out / "summary.json").read_text())["verdict"]["lost"]
    assert loss["time_s"] == pytest.approx(25.0, abs=3.0)
    assert loss["cause"].startswith("no message for 2")
    output = " ".join(result.output.split())
    assert "lost: follower was lost at 2" in output
    assert "no message for 2" in output
    assert output.index("warning: the clocks differ by up to 1 ms") < output.index("E_P: max")
    assert "(replaces" not in output
    again = CliRunner().invoke(app, [*words.split(), "--out", str(out)])
    assert "(replaces the earlier flight)" in " ".join(again.output.split())
