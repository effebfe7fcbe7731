"""Followers of one mission that navigate differently: each as in a mission in which all navigate
like it.
"""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn.errors import LaisnError
from laisn.estimates import Estimates, TightEstimates
from laisn_sim import Simulation
from laisn_sim.cli.main import app
from reports.bound import flight_bounds, geometry_of, least_rms, noise_of
from sim.closed_loop import PythonClosedLoop
from sim.flight import position_and_bearing_errors
from sim.scenario.parts import SensingSettings

pytestmark = pytest.mark.usefixtures("no_plugins")

PAGE = Path(__file__).resolve().parents[2] / "docs" / "links.md"
BEACONS = [[-50.0, -50.0, 5.0], [150.0, -50.0, 25.0], [50.0, 120.0, 12.0]]
LINE_WAYPOINTS = [[0.0, 0.0, -20.0], [100.0, 80.0, 40.0]]
OWN_NAVIGATION: dict[str, dict[str, Any]] = {
    "sure": {},
    "surer": {},
    "two": {"assume": {"transmitters": 2}, "sound_speed": "straight"},
    "paper": {"variant": "laisn-2", "gate": "off"},
    "surveyed": {"variant": "beacons", "link": "lbl"},
    "usbl": {"variant": "inverted-usbl", "further_links": []},
}
"""Keys of each follower's own navigation by its name."""
COMMON_NAVIGATION: dict[str, Any] = {"variant": "tight", "assume": {"range_scale_sigma_m": 0.07}}
"""Keys of `[navigation]`, which hold where a follower sets none."""


def mission(**changes: Any) -> dict[str, Any]:
    """Followers that differ in how they navigate, behind a leader, among beacons."""
    followers = []
    for i, (name, navigation) in enumerate(OWN_NAVIGATION.items()):
        follower: dict[str, Any] = {
            "name": name,
            "waypoints": LINE_WAYPOINTS,
            "depth_m": 8.0 + 2.0 * i,
        }
        followers.append({**follower, "navigation": navigation} if navigation else follower)
    return {
        "duration_s": 20.0,
        "motion": "kinematic",
        "ocean": {"floor_depth_m": 60.0},
        "acoustics": {
            "travel_time": True,
            "ping_slot_s": 0.2,
            "sound_speed_profile": [[0.0, 1490.0], [30.0, 1510.0]],
        },
        "links": [{"name": "lbl", "beacons_m": BEACONS, "interval_s": 2.0}],
        "navigation": COMMON_NAVIGATION,
        "followers": followers,
        **changes,
    }


def mission_of_one_kind(table: dict[str, Any], name: str) -> dict[str, Any]:
    """The mission in which all followers navigate as this one."""
    navigation = {**COMMON_NAVIGATION, **OWN_NAVIGATION[name]}
    navigation["assume"] = {**COMMON_NAVIGATION["assume"], **OWN_NAVIGATION[name].get("assume", {})}
    followers = [
        {key: value for key, value in follower.items() if key != "navigation"}
        for follower in table["followers"]
    ]
    return {**table, "navigation": navigation, "followers": followers}


def require_same(mixed: laisn_sim.Flight, alone: laisn_sim.Flight, follower: int) -> None:
    """Requires that a follower has the same measurements and estimates in two flights, to the
    bit.
    """
    measured = mixed.measurements[follower]
    measured_alone = alone.measurements[follower]
    for name in ("speed", "heading", "depth", "message_step", "message", "ranges"):
        np.testing.assert_array_equal(getattr(measured, name), getattr(measured_alone, name))
    assert list(measured.custom) == list(measured_alone.custom)
    for sensor, readings in measured.custom.items():
        np.testing.assert_array_equal(readings, measured_alone.custom[sensor])
    expected = mixed.estimates[follower]
    actual = alone.estimates[follower]
    assert type(expected) is type(actual)
    for name, array in vars(expected).items():
        np.testing.assert_array_equal(array, getattr(actual, name), err_msg=name)


def test_followers_navigate_as_in_missions_of_their_kinds() -> None:
    mixed = laisn_sim.fly(mission())
    for i, name in enumerate(OWN_NAVIGATION):
        require_same(mixed, laisn_sim.fly(mission_of_one_kind(mission(), name)), i)
    kinds = [type(estimates) for estimates in mixed.estimates]
    assert kinds[:4] == [TightEstimates, TightEstimates, TightEstimates, Estimates]
    # the follower among beacons receives a message every 2 s, the first one every second
    received = [len(measured.message) for measured in mixed.measurements]
    assert received[4] < 0.6 * received[0]
    assert list(mixed.measurements[5].custom) == ["bearing"]
    assert not mixed.measurements[0].custom


def test_bounds_follow_from_the_sound_that_each_follower_receives() -> None:
    """Bounds of a flight take the positions of transmitters from its messages; the expected ones
    take them from sound that is propagated once more along the trajectory.
    """
    table = mission()
    table["acoustics"] |= {"loss_probability": 0.3}
    flight = laisn_sim.fly(table)
    bounds = flight_bounds(flight)
    for i, bound in enumerate(bounds):
        scenario = flight.scenario.navigated_as(i)
        sensing = SensingSettings.of(scenario)
        received = np.isfinite(flight.measurements[i].ranges)
        geometry = geometry_of(flight.trajectory, sensing, i, received)
        expected = least_rms(geometry, noise_of(sensing, scenario.navigation, i))
        np.testing.assert_allclose(bound, expected, rtol=1e-12)
    lost = np.concatenate([np.isnan(m.ranges).all(axis=1) for m in flight.measurements])
    assert 0 < np.count_nonzero(lost) < lost.size


def test_the_command_prints_the_bound_of_each_followers_own_navigation(tmp_path: Path) -> None:
    """Where nothing is lost it is that of a flight, whose transmitters are those of its messages;
    there is none of several links.
    """
    table = mission()
    table["followers"][1]["navigation"] = {"variant": "ekf", "further_links": ["lbl"]}
    flight = laisn_sim.fly(table)
    assert all(np.isfinite(m.ranges[:, 0]).all() for m in flight.measurements)
    file = tmp_path / "mixed.toml"
    file.write_text(flight.scenario.toml(), encoding="utf-8")
    written = tmp_path / "bound.csv"
    result = CliRunner().invoke(
        app, ["bound", str(file), "--runs", "2", "--out", str(written)], env={"COLUMNS": "200"}
    )
    assert result.exit_code == 0, result.output
    rows = [line.split(",") for line in written.read_text(encoding="utf-8").splitlines()[1:]]
    for name, expected in zip(OWN_NAVIGATION, flight_bounds(flight), strict=True):
        actual = [float(bound) for follower, _, bound in rows if follower == name]
        np.testing.assert_allclose(actual, expected, rtol=1e-6)
    assert np.isnan(flight_bounds(flight, [1])[0]).all()
    (line,) = (line for line in result.output.splitlines() if line.startswith("surer"))
    assert line.split()[1:6] == ["–"] * 5
    assert "of several links" in result.output
    assert f"{flight.scenario.variants}, 2 runs" in result.output


@pytest.mark.system
def test_followers_steer_by_their_own_navigators_in_a_closed_loop() -> None:
    in_closed_loop = {"motion": "physics", "duration_s": 8.0}
    table = mission(**in_closed_loop)
    for follower in table["followers"]:
        follower["guidance_position"] = "estimate"
    sim = Simulation(table)
    loop = sim._loop
    assert isinstance(loop, PythonClosedLoop)
    groups = [[*group.followers] for group in loop.groups]
    assert groups == [[0, 1], [2], [3], [4], [5]]
    sim.step(8.0)
    mixed = sim.flight()
    for name in ("surer", "two", "paper", "surveyed"):
        i = [*OWN_NAVIGATION].index(name)
        alone = laisn_sim.fly(mission_of_one_kind(table, name))
        require_same(mixed, alone, i)
        np.testing.assert_array_equal(
            mixed.trajectory.pose[:, i + 1], alone.trajectory.pose[:, i + 1]
        )


def test_a_scenario_with_own_navigations_is_read_back_equal(tmp_path: Path) -> None:
    scenario = laisn_sim.load(mission())
    scenario.save(tmp_path / "mission.toml")
    read_back = laisn_sim.load(tmp_path / "mission.toml", {"name": scenario.name})
    assert read_back == scenario
    # keys that a follower does not set are those of [navigation], also after a change of these
    changed = laisn_sim.load(scenario, {"navigation.assume.range_scale_sigma_m": 0.2})
    assert [changed.navigation_of(i).assume.range_scale_sigma_m for i in (0, 2)] == [0.2, 0.2]
    assert [changed.navigation_of(i).transmitters for i in (0, 2)] == [3, 2]


@pytest.mark.parametrize(
    ("navigation", "expected"),
    [
        ({"variant": "kalman"}, "followers[3].navigation.variant"),
        ({"link": "sonar"}, "followers[3].navigation.link = 'sonar': expected one of leader, lbl"),
        ({"variant": "beacons"}, 'followers[3].navigation.variant = "beacons" needs a'),
        ({"assume": {"sigma": 1.0}}, "followers[3].navigation.assume.sigma"),
    ],
)
def test_invalid_navigations_of_a_follower_are_refused_by_their_keys(
    navigation: dict[str, Any], expected: str
) -> None:
    table = mission()
    table["followers"][3]["navigation"] = navigation
    with pytest.raises(LaisnError) as error:
        laisn_sim.load(table)
    assert expected in str(error.value).replace("followers.3", "followers[3]")


def scenario_of_page(folder: Path) -> Path:
    """Writes the page's scenario into a folder."""
    (text,) = re.findall(r"```toml\n(# rivals\.toml\n.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    path = folder / "rivals.toml"
    path.write_text(text)
    return path


@pytest.mark.system
def test_the_page_flies_followers_that_navigate_differently(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = scenario_of_page(tmp_path)
    command = f"fly {path} --no-video --out out/rivals --set duration_s=20"
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 0, result.output
    output = " ".join(result.output.split())
    assert "navigators: tight (sure, two), laisn-2 (paper), beacons (surveyed)" in output
    summary = json.loads((tmp_path / "out/rivals/summary.json").read_text())
    assert summary["variant"] == "tight, laisn-2, beacons"
    assert [
        summary_of_follower["variant"] for summary_of_follower in summary["followers"].values()
    ] == [
        *["tight"] * 2,
        "laisn-2",
        "beacons",
    ]
    page = (tmp_path / "out/rivals/report.html").read_text()
    assert "tightly coupled navigator on 2 transmitters" in page
    log = tmp_path / "out/rivals/flight.mcap"
    flight = laisn_sim.read_log(log)
    assert [type(estimates).__name__ for estimates in flight.estimates[:3]] == [
        "TightEstimates",
        "TightEstimates",
        "Estimates",
    ]
    # a replay with the same navigators gives the same estimates
    renavigated = laisn_sim.navigate(flight, {})
    for recorded, replayed in zip(flight.estimates, renavigated.estimates, strict=True):
        np.testing.assert_allclose(replayed.state, recorded.state, rtol=0, atol=1e-9)
    replay = f"replay {log} --variant ekf --set followers.3.navigation.variant=beacons"
    result = CliRunner().invoke(app, replay.split())
    assert result.exit_code == 0, result.output
    assert "as flown, tight, laisn-2, beacons" in result.output
    replayed = laisn_sim.navigate(
        flight, {"navigation.variant": "ekf", "followers.3.navigation.variant": "beacons"}
    )
    assert replayed.scenario.variants == "ekf, beacons"


PAIR = """
duration_s = 40
motion = "kinematic"

[navigation]
variant = "laisn-2"

[[followers]]
name = "first"
route = "T5"

[followers.navigation]
variant = "tight"

[[followers]]
name = "second"
route = "T5"
depth_m = 14.0
"""


@pytest.mark.system
def test_a_study_varies_how_one_follower_navigates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Results are those of flights, for each follower; those of the other one do not change."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair.toml").write_text(PAIR, encoding="utf-8")
    key = "followers.0.navigation.variant"
    command = f"study pair.toml --vary {key}=ekf,dead-reckoning --runs 2 --workers 1 --out out"
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 0, result.output
    table = laisn_sim.StudyFolder("out").table
    results = {
        (variant, name): (mean, navigator)
        for variant, name, mean, navigator in zip(
            table[key], table["follower"], table["e_p_mean_m"], table["variant"], strict=True
        )
    }
    assert len(results) == 4
    for variant in ("ekf", "dead-reckoning"):
        flights = [laisn_sim.fly("pair.toml", {key: variant, "run": run}) for run in range(2)]
        for i, name in enumerate(("first", "second")):
            errors = [position_and_bearing_errors(flight)[i][0] for flight in flights]
            mean, navigator = results[variant, name]
            assert mean == pytest.approx(np.mean(errors), rel=1e-6)
            assert navigator == (variant if i == 0 else "laisn-2")
    assert results["ekf", "second"] == results["dead-reckoning", "second"]
    assert results["ekf", "first"][0] < results["dead-reckoning", "first"][0]
    page = Path("out/report.html").read_text("utf-8")
    assert "first" in page
    assert "second" in page
