"""Links of beacons and of second leaders: ranges by closed forms, schedules, inboxes, and the
scenarios of docs/links.md by the commands of users.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.messages import LeaderMessage, Measurements
from laisn_sim.cli.main import app
from sim.flight import navigate

pytestmark = pytest.mark.usefixtures("no_plugins")

PAGE = Path(__file__).resolve().parents[3] / "docs" / "links.md"
TIME, EAST, NORTH, HEADING, SPEED, DEPTH = (
    LeaderMessage._fields.index(name)
    for name in ("timestamp", "east", "north", "heading", "speed", "depth")
)
SOUND_SPEED = 1500.0
NO_NOISE = {
    "range_tau_m": [0.0, 0.0, 0.0],
    "range_scale_mean_m": 0.0,
    "range_scale_sigma_m": 0.0,
}
BEACONS = [[-50.0, -50.0, 5.0], [150.0, -50.0, 25.0], [50.0, 120.0, 12.0]]
LINE_WAYPOINTS = [[0.0, 0.0, -20.0], [100.0, 80.0, 40.0]]
"""Time [s], east and north [m] of a straight route of 100 m in 100 s."""


def among_beacons(beacons: list[list[float]], **keys: Any) -> dict[str, Any]:
    """A mission on a straight line among beacons, without errors of ranges."""
    return {
        "duration_s": 20.0,
        "motion": "kinematic",
        "acoustics": {**NO_NOISE, "travel_time": True, "ping_slot_s": 0.2},
        "links": [{"name": "lbl", "beacons_m": beacons, "interval_s": 2.0, **keys}],
        "navigation": {"link": "lbl", "variant": "beacons"},
        "followers": [{"waypoints": LINE_WAYPOINTS, "depth_m": 8.0}],
    }


def measured_on(table: dict[str, Any], changes: dict[str, Any] | None = None) -> Measurements:
    """Measurements of the first follower of a flight."""
    (measured, *_) = laisn_sim.fly(table, changes).measurements
    return measured


def travel_time(hydrophone: Floats, velocity: Floats, beacon: Floats) -> float:
    """Time from a beacon to a hydrophone by its position when the ping leaves [s]: the positive
    solution of |d + v τ| = c τ.
    """
    d = hydrophone - beacon
    v_d = float(velocity @ d)
    c2_v2 = SOUND_SPEED**2 - float(velocity @ velocity)
    return (v_d + np.sqrt(v_d**2 + c2_v2 * float(d @ d))) / c2_v2


def test_ranges_to_beacons_are_those_of_a_moving_receiver() -> None:
    flight = laisn_sim.fly(among_beacons(BEACONS, offset_s=0.5))
    (measured,) = flight.measurements
    start = flight.trajectory.site_path("follower/hydrophone")[0]
    velocity = np.array([0.8, 0.6, 0.0])
    sent = 2.0 * np.arange(1, len(measured.message) + 1) + 0.5
    assert len(sent) == 9
    np.testing.assert_allclose(measured.message[:, TIME], sent, rtol=0, atol=1e-9)
    for i, message_time in enumerate(sent):
        for j, (east, north, depth) in enumerate(BEACONS):
            ping_time = message_time + 0.2 * j
            hydrophone = start + velocity * ping_time
            time = travel_time(hydrophone, velocity, np.array([east, north, -depth]))
            assert measured.ranges[i, j] == pytest.approx(SOUND_SPEED * time, abs=1e-6)
    # the last ping leaves 0.4 s later, and is available at the first filter step after its arrival
    last_arrival = sent + 0.4 + measured.ranges[:, 2] / SOUND_SPEED
    np.testing.assert_array_equal(measured.message_step, np.ceil(last_arrival / 0.1 - 1e-6))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_messages_of_beacons_hold_their_positions_and_nothing_else_of_a_leader(count: int) -> None:
    measured = measured_on(among_beacons(BEACONS[:count]), {"sensors.leader_heading_bias_deg": 5.0})
    assert measured.transmitters is not None
    expected = np.full((3, 3), np.nan)
    expected[:count] = BEACONS[:count]
    for positions in measured.transmitters:
        np.testing.assert_allclose(positions, expected, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(
        np.isfinite(measured.ranges), np.tile(np.arange(3) < count, (len(measured.ranges), 1))
    )
    mean_position = np.mean(BEACONS[:count], axis=0)
    np.testing.assert_allclose(
        measured.message[:, [EAST, NORTH, DEPTH]] - mean_position, 0.0, rtol=0, atol=1e-9
    )
    # beacons are at rest, and have no errors of a leader
    np.testing.assert_allclose(np.sin(measured.message[:, HEADING]), 0.0, rtol=0, atol=1e-9)
    assert not measured.message[:, SPEED].any()


def escort_mission(**keys: Any) -> dict[str, Any]:
    """A mission whose first follower navigates by the messages of an escort, the second one."""
    return {
        "duration_s": 20.0,
        "acoustics": NO_NOISE,
        "links": [
            {
                "name": "escort",
                "sender": "escort",
                "transmitters_m": [[-0.7, 0.0, 0.1], [0.9, 0.0, 0.0], [0.1, 0.3, 0.0]],
                "offset_s": 0.5,
            }
        ],
        "navigation": {"link": "escort", "variant": "laisn-2"},
        "followers": [
            {"name": "follower", "route": "T5"},
            {"name": "escort", "waypoints": LINE_WAYPOINTS, "depth_m": 6.0},
        ],
        **keys,
    }


@pytest.mark.parametrize("motion", ["kinematic", "physics"])
def test_a_second_leader_sends_from_its_own_transmitters_where_it_is(motion: str) -> None:
    flight = laisn_sim.fly(escort_mission(motion=motion))
    measured, of_escort = flight.measurements
    assert len(measured.message) == 19
    assert not len(of_escort.message)
    sent = np.round((np.arange(1, 20) + 0.5) / 0.1).astype(int)
    np.testing.assert_array_equal(measured.message_step, sent)
    truth = flight.trajectory
    position, heading = truth.position[sent, 2], truth.heading[sent, 2]
    np.testing.assert_allclose(measured.message[:, [EAST, NORTH]], position[:, :2], atol=1e-9)
    np.testing.assert_allclose(measured.message[:, DEPTH], -position[:, 2], atol=1e-9)
    np.testing.assert_allclose(measured.message[:, HEADING], heading, atol=1e-9)
    hydrophone = truth.site_path("follower/hydrophone", sent)
    w, x, y, z = truth.quaternion[sent, 2].T
    ahead = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    front = position + 0.9 * ahead
    expected = np.linalg.norm(hydrophone - front, axis=1)
    np.testing.assert_allclose(measured.ranges[:, 1], expected, rtol=0, atol=1e-9)


@pytest.mark.system
@pytest.mark.parametrize("steered", [False, True])
def test_a_link_whose_sender_is_the_leader_equals_its_broadcast(steered: bool) -> None:
    """To the bit, with all errors, echoes and losses of messages."""
    errors = {
        "duration_s": 20.0,
        "followers.0.guidance_position": "estimate" if steered else "truth",
        "leader.broadcast_attitude": True,
        "sensors.leader_heading_bias_deg": 2.0,
        "sensors.leader_position_sigma_m": 0.5,
        "sensors.leader_attitude_sigma_deg": 0.5,
        "acoustics.travel_time": True,
        "acoustics.ping_slot_s": 0.1,
        "acoustics.loss_probability": 0.2,
        "acoustics.surface_echo_probability": 0.1,
    }
    leader_as_sender = {"links": [{"name": "same", "sender": "leader"}], "navigation.link": "same"}
    broadcast = laisn_sim.fly("T5", errors)
    by_link = laisn_sim.fly("T5", errors | leader_as_sender)
    expected, actual = broadcast.measurements[0], by_link.measurements[0]
    assert len(expected.message) == 19
    assert np.isnan(expected.ranges).any()
    for name in ("speed", "heading", "message_step", "message", "ranges"):
        np.testing.assert_array_equal(getattr(expected, name), getattr(actual, name))
    np.testing.assert_array_equal(broadcast.estimates[0].state, by_link.estimates[0].state)


@pytest.mark.parametrize("kind", ["beacons", "escort"])
def test_a_closed_loop_receives_what_is_computed_after_the_mission(kind: str) -> None:
    table = among_beacons(BEACONS) if kind == "beacons" else escort_mission()
    table = {**table, "motion": "physics"}
    keys = {"followers.0.guidance_position": "estimate"}
    # lanes of LAISN, which steer all followers, take transmitters on the axis of a hull alone
    keys |= {"navigation.variant": "beacons" if kind == "beacons" else "ekf"}
    flight = laisn_sim.fly(table, keys)
    renavigated = navigate(flight.scenario, flight.trajectory)
    for in_flight, afterwards in zip(flight.measurements, renavigated.measurements, strict=True):
        np.testing.assert_array_equal(in_flight.message_step, afterwards.message_step)
        np.testing.assert_allclose(in_flight.ranges, afterwards.ranges, rtol=0, atol=1e-9)
        np.testing.assert_allclose(in_flight.message, afterwards.message, rtol=0, atol=1e-9)
        if kind == "beacons":
            np.testing.assert_allclose(
                in_flight.transmitters, afterwards.transmitters, rtol=0, atol=1e-9
            )
        else:
            assert in_flight.transmitters is None
    assert len(flight.measurements[0].message) > 8


def test_followers_on_stations_keep_them_by_the_leader_and_navigate_among_beacons() -> None:
    follower = {"station": {"behind_m": 20.0, "port_m": 5.0, "depth_m": 14.0}}
    table = {
        **among_beacons(BEACONS),
        "motion": "physics",
        "duration_s": 60.0,
        "followers": [follower],
    }
    sim = laisn_sim.Simulation(table)
    reception_count = 0
    while not sim.done:
        sim.step(2.0)
        reception_count += sim.receptions["follower"] is not None
    flight = sim.flight()
    position = flight.trajectory.position[-1]
    assert np.hypot(*(position[0, :2] - position[1, :2])) == pytest.approx(np.hypot(20, 5), abs=4.0)
    assert laisn_sim.errors(flight)["e_p_m"][-100:].mean() < 2.0
    assert flight.measurements[0].transmitters is not None
    assert len(flight.measurements[0].message) == 29


def scenarios_of_page() -> dict[str, str]:
    """Scenarios of the page by their file names."""
    text = PAGE.read_text("utf-8")
    return dict(re.findall(r"^```toml\n# (\w+\.toml)\n(.*?)^```", text, re.DOTALL | re.MULTILINE))


@pytest.mark.system
@pytest.mark.parametrize("name", ["lbl", "escort"])
def test_the_scenarios_of_the_page_fly_replay_and_study(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(f"{name}.toml").write_text(scenarios_of_page()[f"{name}.toml"], encoding="utf-8")
    command = f"fly {name}.toml --no-video --out out --set duration_s=60"
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 0, result.output
    flight = laisn_sim.read_log("out/flight.mcap")
    flown_again = laisn_sim.fly(f"{name}.toml", {"duration_s": 60.0})
    for in_log, of_flight in zip(flight.measurements, flown_again.measurements, strict=True):
        np.testing.assert_array_equal(in_log.ranges, of_flight.ranges)
        np.testing.assert_array_equal(in_log.transmitters, of_flight.transmitters)
    dead_reckoned = laisn_sim.navigate(
        laisn_sim.fly("T5", {"duration_s": 60.0, "motion": "kinematic"}),
        {"navigation.variant": "dead-reckoning"},
    )
    mean_error = [
        laisn_sim.errors(f)["e_p_m"][:600][-100:].mean() for f in (flown_again, dead_reckoned)
    ]
    assert mean_error[0] < 0.5 * mean_error[1]
    variant = {"lbl": "beacons", "escort": "tight"}[name]
    replay = f"replay out/flight.mcap --variant {variant} --out again.mcap"
    result = CliRunner().invoke(app, replay.split())
    assert result.exit_code == 0, result.output
    keys = {"duration_s": 20.0}
    table = laisn_sim.study(
        f"{name}.toml", set=keys, vary={"links.0.offset_s": [0.0, 0.5]}, runs=2, out="study"
    ).table
    errors_of_runs = [
        laisn_sim.errors(laisn_sim.fly(f"{name}.toml", {**keys, "links.0.offset_s": 0.5, "run": r}))
        for r in range(2)
    ]
    mean_errors_of_follower = [
        errors["e_p_m"][errors["follower"] == "follower"].mean() for errors in errors_of_runs
    ]
    mean_of_study = table["e_p_mean_m"][np.array(table["follower"]) == "follower"]
    assert mean_of_study[-1] == pytest.approx(np.mean(mean_errors_of_follower), rel=1e-9)


@pytest.mark.system
@pytest.mark.parametrize("name", ["transponders", "leader_on_lbl"])
def test_the_scenarios_of_answers_and_of_a_leader_that_navigates_fly(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(f"{name}.toml").write_text(scenarios_of_page()[f"{name}.toml"], encoding="utf-8")
    command = f"fly {name}.toml --no-video --out out --set duration_s=20"
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 0, result.output
    leader = laisn_sim.read_log("out/flight.mcap").leader
    assert leader is not None
    if name == "transponders":
        counts = [len(messages.message) for messages in leader.measurements.links.values()]
        # requests leave from 1 to 20 s, and the last one's answers come after the end
        assert counts == [19, 19]
    else:
        assert leader.estimates is not None
        assert len(leader.measurements.message) == 3


@pytest.mark.system
def test_a_navigator_plugin_listens_to_several_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text("utf-8")
    (plugin,) = re.findall(r"^```python\n# relay.py\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    Path("relay.py").write_text(plugin, encoding="utf-8")
    Path("lbl.toml").write_text(scenarios_of_page()["lbl.toml"], encoding="utf-8")
    relay = laisn_sim.load_plugin("relay.py").Relay
    changes = {
        "duration_s": 100.0,
        "navigation.link": "leader",
        "navigation.further_links": ["lbl"],
        "navigation.variant": "ekf",
    }
    flight = laisn_sim.fly("lbl.toml", changes)
    with_beacons = laisn_sim.navigate(flight, navigator=relay)
    without_beacons = laisn_sim.navigate(flight, {"navigation.further_links": []}, navigator=relay)
    error_with_beacons, error_without_beacons = (
        laisn_sim.errors(f)["e_p_m"][-200:].mean() for f in (with_beacons, without_beacons)
    )
    # without beacons it navigates by a log and a compass that err by 0.2 m/s and 5°
    assert error_without_beacons > 3.0 * error_with_beacons
    # runs of a study have the noise of flights
    keys = changes | {"duration_s": 20.0}
    study = laisn_sim.study(
        "lbl.toml", set=keys, vary={"links.0.interval_s": [2.0, 5.0]}, runs=2, out="study"
    )
    flights = [laisn_sim.fly("lbl.toml", keys | {"run": run}) for run in range(2)]
    means = [laisn_sim.errors(run_flight)["e_p_m"].mean() for run_flight in flights]
    assert study.table["e_p_mean_m"][0] == pytest.approx(np.mean(means), rel=1e-9)
    assert study.table["e_p_mean_m"][1] != study.table["e_p_mean_m"][0]


WRONG_LINKS = {
    "unknown": ({"navigation.link": "sonar"}, "expected one of leader, lbl"),
    "leader": ({"navigation.link": "leader"}, 'needs a navigation.link of beacons"?'),
    "variant": ({"navigation.variant": "tight"}, "has beacons, among which only variant"),
    "both": ({"links.0.sender": "leader"}, "either a sender or beacons_m"),
    "floor": ({"links.0.beacons_m": [[0.0, 0.0, 31.0]]}, "31 m is below the floor at 30 m"),
    "twice": ({"links.0.beacons_m": [[0.0, 0.0, 3.0]] * 2}, "has a place twice"),
    "four": ({"links.0.beacons_m": [[float(i), 0.0, 3.0] for i in range(4)]}, "at most 3"),
    "interval": ({"links.0.interval_s": 0.25}, "no multiple of filter_step_s"),
    "offset": ({"links.0.offset_s": 2.0}, "shorter than the interval of 2 s"),
    "name": ({"links.0.name": "leader"}, "is that of the leader's broadcast"),
}


@pytest.mark.parametrize(("changes", "message"), WRONG_LINKS.values(), ids=WRONG_LINKS)
def test_a_wrong_link_is_refused_with_the_reason(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(LaisnError, match=message):
        laisn_sim.load(among_beacons(BEACONS), changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"links.0.sender": "nobody"}, "is no vehicle: leader, follower, escort"),
        ({"navigation.variant": "beacons"}, "has no beacons"),
        (
            {
                "links.0.transmitters_m": [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
                "navigation.variant": "tight",
            },
            "has 2 transmitters, the navigator uses 3",
        ),
    ],
)
def test_a_wrong_sender_is_refused_with_the_reason(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(LaisnError, match=message):
        laisn_sim.load(escort_mission(), changes)
