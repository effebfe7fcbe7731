"""Accepted scenarios can be flown; others are refused at once with every error, on one screen."""

import json
import math
import os
import re
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from experiments.flight import library
from laisn.errors import ROWS, printable
from laisn_sim.cli.fly import fly_and_write
from sim import feasibility
from sim.assembly import routes_of, setups_of
from sim.scenario import file as scenario_file
from sim.scenario.file import ScenarioError
from sim.scenario.parts import MissionPlan, SeaSettings
from sim.scenario.settings import Scenario
from sim.vehicle.plant import Plant
from sim.water.assembly import ocean_of
from tests import absurd

SEEDS = st.integers(0, 2**64)


def scenario_if_accepted(table: dict[str, Any]) -> Scenario | None:
    """The scenario, or None if it is refused, with printable errors that fit on a screen."""
    try:
        return scenario_file.validate(table, "absurd.toml", feasibility.infeasibilities)
    except ScenarioError as error:
        message = str(error)
    head, *lines = message.split("\n")
    assert head.startswith("absurd.toml: ")
    assert 0 < len(lines) <= ROWS
    assert all(printable(line) == line for line in lines)
    return None


@settings(max_examples=200, deadline=None)
@given(SEEDS, st.sampled_from((0.0, 0.01, 0.3)))
def test_every_accepted_scenario_builds_a_plant(seed: int, wild: float) -> None:
    scenario = scenario_if_accepted(absurd.table(seed, wild))
    if scenario is not None:
        Plant(
            setups_of(MissionPlan.of(scenario), routes_of(MissionPlan.of(scenario))),
            ocean_of(SeaSettings.of(scenario)),
            scenario.timing.physics_step_s,
        )


@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(SEEDS)
def test_an_accepted_scenario_can_be_flown_logged_and_reported(seed: int) -> None:
    scenario = scenario_if_accepted(absurd.table(seed, 0.0))
    if scenario is None or scenario.duration_s / scenario.timing.physics_step_s > 2000:
        return
    with tempfile.TemporaryDirectory() as folder:
        fly_and_write(scenario, Path(folder), with_video=False)
        json.loads((Path(folder) / "summary.json").read_text(), parse_constant=pytest.fail)
    assert scenario_if_accepted(scenario.model_dump(mode="json", exclude_none=True)) == scenario


@pytest.mark.parametrize(
    "change", [{"duration_s": 0.1}, {"duration_s": 0.3}, {"timing": {"message_interval_s": 50.0}}]
)
def test_a_flight_that_ends_before_the_first_message_is_flown(
    change: dict[str, Any], tmp_path: Path
) -> None:
    table = {"name": "short", "duration_s": 1.0, "followers": [{"route": "T5"}], **change}
    scenario = scenario_if_accepted(table)
    assert scenario is not None
    fly_and_write(scenario, tmp_path, with_video=False)


@pytest.mark.system
def test_absurd_scenarios_are_neither_all_refused_nor_all_accepted() -> None:
    """Otherwise the property tests above would test nothing."""
    count = sum(scenario_if_accepted(absurd.table(seed, 0.0)) is not None for seed in range(400))
    assert 10 < count < 390


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        (
            "leader.middle_offset_m=0",
            "leader.middle_offset_m: Input should be greater than or equal to 0.001",
        ),
        (
            "leader.middle_offset_m=-0.1",
            "leader.middle_offset_m: Input should be greater than or equal to 0.001",
        ),
        (
            "timing.physics_step_s=1e-300",
            "timing.physics_step_s: Input should be greater than or equal to 0.0001",
        ),
        (
            "timing.physics_step_s=1e-7",
            "timing.physics_step_s: Input should be greater than or equal to 0.0001",
        ),
        (
            "video.speed_up=1e-12",
            "video: a film of 1000 s at speed_up = 1e-12 and 30 Hz has 3e+16 frames",
        ),
        (
            "followers.0.waypoints=[[0,0,0],[1e308,1e308,0]]",
            "followers[0].waypoints[1][0]: Input should be less",
        ),
        ("followers.0=1", "followers[0]: expected a table; its keys: route, waypoints, "),
        ("followers=1", "followers: expected a list of tables: write [[followers]]"),
    ],
)
def test_an_override_that_cannot_be_flown_is_refused(assignment: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        library.load_scenario("T5", [assignment], flyable=True)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 80 * 24


FOLLOWER_HEADER = b"duration_s=2\n[[followers]]\n"
COUNT = 4_000


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "followers: missing: at least one table [[followers]] is required"),
        (b"name = '\xe9'", "cannot be read: not UTF-8 text"),
        (b"name = 'a\x00b'", "not valid TOML: Found invalid character"),
        (
            b"name = 'x'\nseed = " + b"9" * 5000,
            "value has 5000 digits",
        ),
        (b"epoch = 2026-13-45", "not valid TOML"),
        (b"[leader]\nspeed = 0,5 # m/s", "line 2, column 10); decimals have a point: 0.5"),
        (b"[leader]\nwaypoints = [0, 0, 20]", "leader.waypoints[0]: expected [[time_s, east_m"),
        (b"[ocean]\ncurrent = 0.1", "ocean.current: expected a table; its keys: file, "),
        (b"k" * 100_000 + b" = 1\n", "unknown key; known here: name, seed"),
        (b"\n".join(b"k%d = 1" % i for i in range(COUNT)), f"{COUNT + 1} errors"),
        (FOLLOWER_HEADER + b"waypoints = [" + b"['a', 1, 2]," * COUNT + b"]", f"{COUNT} errors"),
        (
            FOLLOWER_HEADER + b"waypoints = [" + b"[0, 0, 0]," * COUNT + b"]",
            "waypoint 2 at 0 s is not later",
        ),
        (FOLLOWER_HEADER + b"[[followers]]\n" * COUNT, f"{COUNT + 1} errors"),
        (b"#" * (scenario_file.LARGEST_BYTES + 1), "it has 16000001 bytes, there may be 16000000"),
    ],
    ids=range(14),
)
def test_errors_of_a_nonsense_file_fit_on_a_screen(
    content: bytes, message: str, tmp_path: Path
) -> None:
    path = tmp_path / "own.toml"
    path.write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        library.load_scenario(str(path), (), flyable=True)
    assert message in str(caught.value)
    assert len(str(caught.value).replace(str(tmp_path), "")) < 80 * 24


def test_a_byte_order_mark_and_line_ends_of_windows_are_accepted(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_bytes(
        b"\xef\xbb\xbf" + FOLLOWER_HEADER.replace(b"\n", b"\r\n") + b"route = 'T5'\r\n"
    )
    assert library.load_scenario(str(path), (), flyable=True).duration_s == 2


def test_a_source_that_is_no_plain_file_is_refused_within_a_second(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "link.toml").symlink_to("/dev/zero")
    start = time.monotonic()
    for name, message in (
        ("pipe", "no plain file"),
        ("folder", "a folder"),
        ("link", "no plain file"),
        ("none", "No such"),
    ):
        with pytest.raises(ScenarioError, match=f"cannot be read: .*{message}"):
            library.load_scenario(str(tmp_path / f"{name}.toml"), (), flyable=True)
    for source in (
        "a" * 5000,
        "a\x00b",
        "../scenarios/swarm",
        "a" * 5000 + ".toml",
        "a\x00.toml",
        "\x1b[2J",
    ):
        with pytest.raises(ScenarioError) as caught:
            library.load_scenario(source, (), flyable=True)
        assert len(str(caught.value)) < 80 * 24 + len(source)
    assert time.monotonic() - start < 1


def errors_of(table: dict[str, Any]) -> list[str]:
    """Lines of the errors for which a table is refused."""
    with pytest.raises(ScenarioError) as caught:
        scenario_file.validate(table, "mine.toml", feasibility.infeasibilities)
    head, *lines = str(caught.value).splitlines()
    assert head == f"mine.toml: {len(lines)} error{'s' if len(lines) > 1 else ''}"
    return [line.strip() for line in lines]


def mismatches(lines: list[str], expected: list[str]) -> list[str]:
    """Expected beginnings that no line has, and lines without an expected beginning."""
    return [
        *(text for text in expected if not any(line.startswith(text) for line in lines)),
        *(line for line in lines if not any(line.startswith(text) for text in expected)),
    ]


def test_all_invalid_keys_are_reported_at_once() -> None:
    table = {
        "name": "mine",
        "senors": {},
        "ocean": {"current_speed_m_s": "fast", "waves": {"kind": "regular", "height_m": 19.0}},
        "timing": {"physics_step_s": 0.03},
        "video": {"camera": "drone"},
        "followers": [{"route": "T1"}, {"waypoints": [[0, 0, "x"], [10, 9, 0]]}],
    }
    expected = [
        "senors: unknown key; did you mean 'sensors'?",
        "timing: physics_step_s = 0.03 does not divide 0.1 s",
        "ocean.current_speed_m_s: Input should be a valid number",
        "video.camera: unknown camera 'drone'",
        "followers[1].waypoints[0][2]: Input should be a valid number",
    ]
    assert mismatches(errors_of(table), expected) == []


def test_all_contradictions_and_infeasible_settings_are_reported_at_once() -> None:
    table = {
        "name": "mine",
        "epoch": "1960-01-01T00:00:00+00:00",
        "duration_s": 1000.05,
        "leader": {"depth_m": 40.0, "saw_tooth_amplitude_m": 50.0},
        "ocean": {"waves": {"kind": "regular", "height_m": 19.0}},
        "navigation": {
            "use_attitude": True,
            "variant": "tight",
            "transmitters_m": [[-1, 0, 0], [1, 0, 0]],
        },
        "followers": [{"route": "T1"}, {"waypoints": [[0, 0, 0], [10, 52.2, 0]], "depth_m": 35.0}],
    }
    expected = [
        "duration_s = 1000.05 is no multiple of filter_step_s",
        "leader: saw_tooth_amplitude_m = 50",
        "leader would dive to 90 m",
        "followers[1] would dive to 35 m",
        "navigation.use_attitude needs leader.broadcast_attitude",
        "navigation.transmitters_m has 2 places, the navigator uses 3 transmitters",
        "epoch 1960",
        "ocean.waves.height_m: expected 0 to ",
        "followers[0].route: unknown route 'T1'",
        "followers[1].waypoints: route 'follower-2', waypoint 2: 5.22 m/s",
    ]
    assert mismatches(errors_of(table), expected) == []


def test_an_invalid_key_causes_no_further_errors() -> None:
    """Where the leader's depth is no number, its default of 8 m below the floor is not reported."""
    table = {"name": "a", "leader": {"depth_m": "x"}, "ocean": {"floor_depth_m": 5.0}}
    followers = [{"route": "T5", "depth_m": 3.0}]
    with pytest.raises(ScenarioError, match=r"mine.toml: 1 error\n  leader.depth_m: "):
        scenario_file.validate(
            {**table, "followers": followers}, "mine.toml", feasibility.infeasibilities
        )


def test_a_route_that_cannot_be_flown_causes_no_further_errors() -> None:
    """That the leader is too fast for its followers is reported once it has a route."""
    followers = [{"station": {"behind_m": 20.0, "depth_m": 10.0}}]
    formation = {"max_speed_m_s": 0.9, "outer_max_speed_m_s": 0.9}
    table = {"name": "a", "duration_s": 900.0, "formation": formation, "followers": followers}
    (too_fast,) = errors_of(table)
    assert too_fast.startswith(
        "leader: on the way to waypoint 2 followers at 10 m would need 1 m/s"
    )
    floor, route = errors_of(table | {"leader": {"route": "T1"}, "ocean": {"floor_depth_m": 9.0}})
    assert floor.startswith("followers[0] would dive to 10 m")
    assert route.startswith("leader.route: unknown route 'T1'")


def test_followers_without_names_are_numbered() -> None:
    def names(*followers: dict[str, Any]) -> list[str]:
        table = {"name": "a", "followers": list(followers)}
        return [f.name for f in scenario_file.validate(table, "a.toml").followers]

    assert names({"route": "T5"}) == ["follower"]
    assert names({"route": "T5"}, {"route": "T6"}) == ["follower-1", "follower-2"]
    assert names({"route": "T5"}, {"route": "T6", "name": "b"}, {"route": "T7"}) == [
        "follower-1",
        "b",
        "follower-3",
    ]


@pytest.mark.parametrize(
    ("assignments", "message"),
    [
        (
            ["duration_s=86400", "timing.physics_step_s=0.0005"],
            "timing.physics_step_s: 86400 s of 2 vehicles",
        ),
        (
            ["video.speed_up=0.01", "video.width_px=3840"],
            "video: a film of 1000 s at speed_up = 0.01",
        ),
    ],
)
def test_a_flight_or_film_that_takes_too_long_is_refused_with_its_cost(
    assignments: list[str], message: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        library.load_scenario("T5", assignments, flyable=True)
    assert message in str(caught.value)


def test_a_day_of_one_follower_is_accepted_and_of_fifty_is_not() -> None:
    table: dict[str, Any] = {"name": "a", "duration_s": 86400.0, "followers": [{"route": "T5"}]}
    assert scenario_file.validate(table, "a.toml", feasibility.infeasibilities)
    swarm = {**table, "followers": [{"route": "T5"} for _ in range(50)]}
    # 864 000 instants of 51 vehicles at 1.1 kB; 2 100 000 instants are 4118 s of 51
    with pytest.raises(
        ScenarioError, match=r"would take 48.5 GB of memory; so many vehicles may fly 4118 s"
    ):
        scenario_file.validate(swarm, "a.toml", feasibility.infeasibilities)


@pytest.mark.parametrize("kind", ["regular", "jonswap"])
def test_waves_that_would_break_are_refused_by_their_key(kind: str) -> None:
    """Miche's limit in deep water is 0.142 g T² / 2π; what is named as the highest may be given."""
    highest = 0.142 * 9.81 * 3.0**2 / (2.0 * math.pi)

    def waves_of(height: float) -> dict[str, Any]:
        waves = {"kind": kind, "period_s": 3.0, "height_m": height}
        return {"followers": [{"route": "T5"}], "ocean": {"waves": waves}}

    with pytest.raises(ScenarioError) as raised:
        scenario_file.validate(waves_of(4.0), "waves.toml", feasibility.infeasibilities)
    (line,) = str(raised.value).split("\n")[1:]
    named = re.search(r"ocean\.waves\.height_m: expected 0 to (\S+) m", line)
    assert named is not None
    assert highest - 0.001 <= float(named[1]) <= highest
    assert line.endswith("(given: 4)")
    scenario_file.validate(waves_of(float(named[1])), "waves.toml", feasibility.infeasibilities)
