"""A navigator and a sensor of the user's own: the examples of docs/extending.md are flown and
studied as they stand.
"""

import re
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from experiments.campaign.montecarlo import Cell, simulate, simulate_mission
from experiments.campaign.store import key_of
from laisn.errors import LaisnError
from laisn.estimates import Estimates, FixKind
from laisn.messages import Measurements
from laisn.navigators import NAVIGATORS, NavigatorSpec, code_of_navigators, find
from laisn.settings import NavigationSettings
from laisn_sim.cli.main import app
from sim.flight import excerpt
from sim.sensing.noise import normals

PAGE = Path(__file__).resolve().parents[2] / "docs" / "extending.md"
NAME = "dead_reckoning:DeadReckoning"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_plugins: None) -> Path:
    """A working directory with the files of the page, whose modules are loaded."""
    blocks = re.findall(
        r"^```\w+\n# (\w+\.(?:py|toml))\n(.*?)^```",
        PAGE.read_text("utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    for name, text in blocks:
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    for file in ("dead_reckoning", "inverted_usbl", "bearing_navigator", "odometry", "homing"):
        laisn_sim.load_plugin(f"{file}.py")
    return tmp_path


def run(line: str) -> str:
    result = CliRunner().invoke(app, line.split())
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.usefixtures("folder")
def test_a_navigator_of_a_plugin_flies_and_replays_by_its_name() -> None:
    run(
        "fly reckoned.toml --plugin dead_reckoning.py --no-video --out out --set "
        "navigation.custom.current_east_m_s=0.25"
    )
    flight = laisn_sim.read_log("out/flight.mcap")
    (estimates,), (measured,) = flight.estimates, flight.measurements
    # log and compass alone, by hand
    east = measured.dt * (measured.speed * np.sin(measured.heading) + 0.25).sum()
    scenario = laisn_sim.load("reckoned.toml")
    start_position = laisn_sim.fly(scenario, {"duration_s": 0.2}).hydrophone(0)[0]
    assert estimates.state[-1, 0] - estimates.state[0, 0] == pytest.approx(
        east - measured.dt * (measured.speed[0] * np.sin(measured.heading[0]) + 0.25)
    )
    np.testing.assert_allclose(estimates.state[0, :2], start_position[:2], atol=0.5)
    without_current = laisn_sim.navigate(flight, {"navigation.custom.current_east_m_s": 0.0})
    shift = estimates.state[:, 0] - without_current.estimates[0].state[:, 0]
    np.testing.assert_allclose(shift, 0.25 * measured.time, atol=1e-9)
    assert f"replayed, {NAME}" in run(f"replay out/flight.mcap --variant {NAME}")


@pytest.mark.system
@pytest.mark.usefixtures("folder")
def test_a_study_compares_a_navigator_of_a_plugin_with_others() -> None:
    results = laisn_sim.study(
        "reckoned.toml", vary={"navigation.variant": [NAME, "laisn-2"]}, runs=3, out="study"
    )
    rows = {row["variant"]: row for row in results.table.rows()}
    mean_errors = [
        laisn_sim.errors(laisn_sim.fly("reckoned.toml", {"run": run}))["e_p_m"].mean()
        for run in range(3)
    ]
    assert rows[NAME]["e_p_mean_m"] == pytest.approx(np.mean(mean_errors), rel=1e-12)
    assert rows[NAME]["e_p_mean_m"] != rows["laisn-2"]["e_p_mean_m"]


def test_the_key_of_a_result_holds_the_source_of_its_navigator(folder: Path) -> None:
    (folder / "another.py").write_text((folder / "dead_reckoning.py").read_text())
    laisn_sim.load_plugin("another.py")
    scenario = laisn_sim.load("reckoned.toml", {"navigation.variant": "another:DeadReckoning"})
    # keys of a scenario, and of a task with the scenario as argument
    before = key_of(scenario), key_of(partial(simulate_mission, scenario))
    assert key_of(scenario) == before[0]
    (folder / "another.py").write_text((folder / "dead_reckoning.py").read_text() + "# another\n")
    after = key_of(scenario), key_of(partial(simulate_mission, scenario))
    assert all(new != old for new, old in zip(after, before, strict=True))


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"navigation.variant": "dead_reckoning:Reckoning"}, "dead_reckoning.py: DeadReckoning"),
        ({"navigation.variant": "mine:Filter"}, "not loaded: add --plugin mine.py"),
        ({"navigation.variant": "math:pi"}, "not loaded: add --plugin math.py"),
        ({"navigation.variant": "dead_reckoning:FixKind"}, "dead_reckoning.py: DeadReckoning"),
        ({"navigation.variant": "inverted_usbl:InvertedUsbl"}, "expected a class with `step("),
        ({"navigation.variant": "laisn-4"}, "'beacons' or 'module:Class' of a plugin"),
        (
            {"navigation.custom.current_east_m_s": "fast"},
            "navigation.custom.current_east_m_s: Input should be a valid number (given: 'fast'",
        ),
        (
            {"navigation.custom.curent_east_m_s": 1.0},
            "has no key 'curent_east'; did you mean 'current_east'? it has: current_east,",
        ),
    ],
)
def test_a_navigator_that_cannot_be_used_is_reported(
    changes: dict[str, object], expected: str
) -> None:
    with pytest.raises(LaisnError) as error:
        laisn_sim.load("reckoned.toml", changes)
    assert expected in str(error.value)


@pytest.mark.usefixtures("folder")
def test_a_class_with_a_step_runs_over_missions_and_in_closed_loops() -> None:
    settings = {"navigation.variant": "odometry", "duration_s": 20.0}
    flight = laisn_sim.fly("T5", settings)
    (estimates,), (measured,) = flight.estimates, flight.measurements
    navigator = sys.modules["odometry"].Odometry(
        flight.scenario.navigation.settings(), estimates.state[0]
    )
    for motion, reception in list(measured.steps())[1:]:
        navigator.step(motion, reception, 0.1)
    np.testing.assert_allclose(estimates.state[-1, :2], navigator.state[:2], atol=1e-9)
    closed = laisn_sim.fly("T5", settings | {"followers.0.guidance_position": "estimate"})
    assert np.isfinite(closed.estimates[0].state).all()


@pytest.mark.system
@pytest.mark.usefixtures("folder")
def test_a_study_takes_classes_as_arms() -> None:
    odometry = sys.modules["odometry"].Odometry
    changes = {"duration_s": 20.0, "motion": "kinematic"}
    results = laisn_sim.study(
        "T3", set=changes, navigators={"mine": odometry, "EKF": "ekf"}, runs=2, out="arms"
    )
    rows = {row["arm"]: row["e_p_mean_m"] for row in results.table.rows()}
    flights = [laisn_sim.fly("T3", changes | {"run": run}, navigator=odometry) for run in range(2)]
    assert rows["mine"] == pytest.approx(
        np.mean([laisn_sim.errors(flight)["e_p_m"].mean() for flight in flights]), rel=1e-12
    )
    assert set(rows) == {"mine", "EKF"}
    local = type("Local", (odometry,), {"__module__": "__main__"})
    with pytest.raises(LaisnError, match="in a file of its own"):
        laisn_sim.study("T3", navigators={"mine": local})


@pytest.mark.usefixtures("folder")
def test_a_controller_of_the_page_follows_the_leader() -> None:
    settings = {
        "followers.0.controller": "homing",
        "navigation.variant": "ekf",
        "duration_s": 120.0,
    }
    flight = laisn_sim.fly("T5", settings)
    leader, follower = flight.trajectory.position[:, 0, :2], flight.trajectory.position[:, 1, :2]
    distance = np.hypot(*(leader - follower).T)
    assert abs(distance[-1] - 30.0) < min(abs(distance[0] - 30.0), 8.0)


def test_a_scenario_or_a_log_loads_no_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_plugins: None
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "open('ran', 'w').close()\nclass Filter:\n    run = step = print\n"
    )
    for name in ("mine:Filter", "mine"):
        with pytest.raises(LaisnError, match=r"--plugin mine.py|'module:Class' of a plugin"):
            laisn_sim.load("T5", {"navigation.variant": name})
    with pytest.raises(LaisnError, match=r"--plugin mine.py"):
        laisn_sim.load("T5", {"sensors.custom": [{"sensor": "mine:Filter"}]})
    assert not (tmp_path / "ran").exists()
    laisn_sim.load_plugin("mine.py")
    assert (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("mine.txt", "", "expected a Python file such as mine.py"),
        ("json.py", "", "there is another module 'json'"),
        ("mine.py", "1 / 0", "ZeroDivisionError: division by zero"),
        ("mine.py", "def", "SyntaxError"),
    ],
)
def test_a_plugin_that_cannot_be_loaded_is_named(
    name: str, text: str, expected: str, tmp_path: Path, no_plugins: None
) -> None:
    (tmp_path / name).write_text(text)
    result = CliRunner().invoke(
        app, ["check", "T5", "--plugin", str(tmp_path / name)], env={"COLUMNS": "300"}
    )
    assert result.exit_code == 2
    assert expected in result.output


@pytest.mark.usefixtures("folder")
def test_followers_that_steer_by_estimates_need_a_navigator_with_a_step() -> None:
    steering = {"motion": "physics", "followers.0.guidance_position": "estimate", "duration_s": 2}
    with pytest.raises(LaisnError, match="has no `step`"):
        laisn_sim.fly("reckoned.toml", steering)


WITHOUT_ERRORS = {
    "duration_s": 20.0,
    "sensors.custom": [{"sensor": "inverted_usbl:InvertedUsbl", "angle_sigma_deg": 0.0}],
}


@pytest.mark.usefixtures("folder")
def test_a_sensor_reads_the_direction_of_a_ping_in_the_hull() -> None:
    """Heading plus azimuth is the compass direction of the transmitter; point motion is level
    but for dives.
    """
    flight = laisn_sim.fly("usbl.toml", WITHOUT_ERRORS)
    (measured,), truth = flight.measurements, flight.trajectory
    message_step = measured.message_step
    to_transmitter = (
        truth.site_path("leader/tx_front")[message_step]
        - truth.site_path("follower/hydrophone")[message_step]
    )
    azimuth, elevation = measured.custom["bearing"][message_step - 1].T
    assert np.cos(
        truth.heading[message_step, 1] + azimuth - np.arctan2(*to_transmitter[:, :2].T)
    ) == pytest.approx(1.0, abs=1e-9)
    assert elevation == pytest.approx(
        np.arctan2(to_transmitter[:, 2], np.hypot(*to_transmitter[:, :2].T)), abs=1e-9
    )
    assert np.isfinite(measured.custom["bearing"]).all(axis=1).sum() == message_step.size
    cut = excerpt(flight, 5.0, 15.0)
    np.testing.assert_array_equal(
        cut.measurements[0].custom["bearing"], measured.custom["bearing"][50:150]
    )


@pytest.mark.usefixtures("folder")
def test_a_sensors_errors_are_those_of_its_stream_and_lost_with_the_message() -> None:
    lossy = {"acoustics.loss_probability": 0.4, "run": 3}
    exact = laisn_sim.fly("usbl.toml", WITHOUT_ERRORS | lossy).measurements[0]
    noisy = laisn_sim.fly("usbl.toml", {"duration_s": 20.0, **lossy}).measurements[0]
    message_rows = exact.message_step - 1
    received = np.isfinite(exact.ranges).any(axis=1)
    assert 0 < received.sum() < message_rows.size
    np.testing.assert_array_equal(np.isfinite(noisy.custom["bearing"][message_rows, 0]), received)
    drawn = normals(1, 3, 16, np.arange(1, 201))[message_rows[received]]
    actual = (noisy.custom["bearing"] - exact.custom["bearing"])[message_rows[received]]
    np.testing.assert_allclose(actual, np.deg2rad(1.0) * drawn, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(noisy.speed, exact.speed)


@pytest.mark.usefixtures("folder")
def test_a_navigator_uses_a_custom_sensor_in_flights_and_studies() -> None:
    flight = laisn_sim.fly("usbl.toml")
    dead_reckoned = laisn_sim.navigate(flight, {"navigation.variant": NAME})
    with_sensor, without_sensor = (
        laisn_sim.errors(estimated)["e_p_m"].mean() for estimated in (flight, dead_reckoned)
    )
    assert with_sensor < 0.2 * without_sensor
    cell = Cell.of(flight.scenario, runs=2)
    assert simulate(cell).row["e_p_mean_m"] == pytest.approx(
        np.mean(
            [
                laisn_sim.errors(laisn_sim.fly("usbl.toml", {"run": run}))["e_p_m"].mean()
                for run in range(2)
            ]
        )
    )


def test_the_key_of_a_result_holds_the_source_of_its_sensors(folder: Path) -> None:
    (folder / "another_usbl.py").write_text((folder / "inverted_usbl.py").read_text())
    laisn_sim.load_plugin("another_usbl.py")
    scenario = laisn_sim.load(
        "usbl.toml", {"sensors.custom": [{"sensor": "another_usbl:InvertedUsbl"}]}
    )
    before = key_of(scenario)
    (folder / "another_usbl.py").write_text(
        (folder / "inverted_usbl.py").read_text() + "# another\n"
    )
    assert key_of(scenario) != before


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        (
            {"sensor": "inverted_usbl:Usbl"},
            "'inverted_usbl:Usbl': expected a class of .*inverted_usbl.py: InvertedUsbl",
        ),
        (
            {"sensor": "inverted_usbl:InvertedUsbl", "range_sigma_m": 1.0},
            "has no key 'range_sigma'; did you mean 'angle_sigma'",
        ),
        ({"sensor": "inverted_usbl"}, r"sensors.custom\[0\].sensor"),
    ],
)
def test_a_sensor_that_cannot_be_used_is_reported(sensor: dict[str, object], expected: str) -> None:
    with pytest.raises(LaisnError, match=expected):
        laisn_sim.load("usbl.toml", {"sensors.custom": [sensor]})


def test_all_code_that_the_registry_names_exists() -> None:
    from pkgutil import resolve_name

    for spec in NAVIGATORS.values():
        for name in (spec.factory, spec.mission, spec.swarm, spec.smoother, spec.beacons):
            assert not name or callable(resolve_name(name))
    assert {"laisn.navigator", "laisn.tight.navigator"} <= set(code_of_navigators())
    with pytest.raises(LaisnError, match="available: laisn-2"):
        find("kalman")


class _Exact:
    """A navigator that takes the first of three innovations to be exact."""

    def __init__(self, settings: Any, start: Any) -> None:
        self.start = start

    def run(self, measurements: Measurements) -> Estimates:
        """The innovations (3, 4), with S = 0, diag(9, 4) and diag(1, 16)."""
        steps = measurements.speed.size
        return Estimates(
            state=np.zeros((steps, 4)),
            covariance=np.zeros((steps, 4, 4)),
            fix_step=np.array([1, 2, 3]),
            fix_position=np.zeros((3, 2)),
            fix_sigma=np.zeros(3),
            fix_kind=np.full(3, FixKind.RANGES),
            innovation=np.tile([3.0, 4.0], (3, 1)),
            innovation_covariance=np.array([np.zeros((2, 2)), np.diag([9, 4]), np.diag([1, 16])]),
        )


def test_an_innovation_without_variance_does_not_count_in_a_campaign() -> None:
    flight = laisn_sim.fly("T5", {"duration_s": 1.0, "motion": "kinematic"}, navigator=_Exact)
    spec = NavigatorSpec(factory=_Exact)
    result = spec.fly(NavigationSettings(), flight.measurements[0], np.zeros(4))
    # 9/9 + 16/4 and 9/1 + 16/16
    assert (result.nis_sum, result.nis_dof) == (5.0 + 10.0, 4.0)
    # a covariance of 0 has no NEES
    [row] = laisn_sim.summary(flight)["followers"].values()
    assert row["nees"] is None
