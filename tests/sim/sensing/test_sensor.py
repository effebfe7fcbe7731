"""Sensors by plugins: the DVL of docs/extending.md reads the truth with its errors in open and
closed loops, reaches `step`, and is in logs, tables and replays; wrong declarations are refused.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from typer.testing import CliRunner

import laisn_sim
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.messages import Measurements
from laisn.plugins import register
from laisn_sim.cli.main import app
from sim.attitude import rotate
from sim.flight import FlightRecord, navigate
from sim.scenario.parts import sensing_of_each
from sim.sensing.noise import STREAMS, normals
from sim.sensing.sensor import Sensor
from sim.sensing.sensors import InvertedUsblSensor, custom_sensors
from sim.trajectory import Trajectory

PAGE = Path(__file__).resolve().parents[3] / "docs" / "extending.md"
CURRENT = {"ocean.current_speed_m_s": 0.3, "ocean.current_direction_deg": 40.0}
NO_ERRORS = {"velocity_sigma_m_s": 0.0, "altitude_sigma_m": 0.0, "dropout": 0.0}
STEPS = 200


def files_of_page() -> dict[str, str]:
    """Texts of the page's plugins and scenarios by their file names."""
    text = PAGE.read_text("utf-8")
    pattern = r"^```\w+\n# (\w+\.\w+)\n(.*?)^```"
    return dict(re.findall(pattern, text, flags=re.DOTALL | re.MULTILINE))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_plugins: None) -> Path:
    """A working directory with the files of the page, whose modules are loaded."""
    for name in ("dvl.py", "by_dvl.py", "dvl.toml"):
        (tmp_path / name).write_text(files_of_page()[name], encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for file in ("dvl.py", "by_dvl.py"):
        laisn_sim.load_plugin(file)
    return tmp_path


def fly(changes: dict[str, Any], **keys: Any) -> FlightRecord:
    """The page's mission for STEPS filter steps, with these settings of its DVL."""
    sensor = {"sensor": "dvl:Dvl", **keys}
    flight: FlightRecord = laisn_sim.fly(
        "dvl.toml", {"duration_s": 0.1 * STEPS, "sensors.custom": [sensor], **changes}
    )
    return flight


def truth_of(trajectory: Trajectory, floor: float = 30.0) -> Floats:
    """Velocity over the ground in the hull's axes and height above the floor, shape (n, 4)."""
    w, x, y, z = trajectory.quaternion[1:, 1].T
    to_world = Rotation.from_quat(np.column_stack([x, y, z, w]))
    velocity = to_world.inv().apply(trajectory.velocity[1:, 1].copy())
    return np.column_stack([velocity, floor + trajectory.position[1:, 1, 2]])


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "changes",
    [
        {"motion": "kinematic", "followers.0.guidance_position": "truth"},
        {"followers.0.guidance_position": "truth", **CURRENT},
        {"followers.0.guidance_position": "estimate", **CURRENT},
    ],
    ids=["kinematic", "open loop", "closed loop"],
)
def test_a_dvl_reads_the_velocity_over_ground_and_the_altitude_at_its_own_rate(
    changes: dict[str, Any],
) -> None:
    flight = fly(changes, **NO_ERRORS)
    readings = flight.measurements[0].custom["dvl"]
    expected = truth_of(flight.trajectory)
    assert np.isnan(readings[0::2]).all()
    np.testing.assert_allclose(readings[1::2], expected[1::2], rtol=0, atol=1e-9)
    assert np.ptp(expected[1::2, 0]) > 1e-3 or "motion" in changes


@pytest.mark.usefixtures("folder")
def test_its_errors_and_dropouts_are_draws_of_its_stream() -> None:
    """Each reading takes five normals, of three blocks of two, by run, stream 20 and step."""
    changes = {"followers.0.guidance_position": "truth", "run": 3, "seed": 7}
    with_errors = fly(changes, velocity_sigma_m_s=0.02, altitude_sigma_m=0.1, dropout=0.3)
    without_errors = fly(changes, **NO_ERRORS)
    steps = np.arange(2, STEPS + 1, 2)
    draws = np.hstack([normals(7, 3, 20, steps, block) for block in range(3)])[:, :5]
    error = (
        with_errors.measurements[0].custom["dvl"] - without_errors.measurements[0].custom["dvl"]
    )[1::2]
    lost = norm.cdf(draws[:, 4]) < 0.3
    assert 10 < lost.sum() < 50
    np.testing.assert_array_equal(np.isnan(error).all(axis=1), lost)
    expected = draws[:, :4] * (0.02, 0.02, 0.02, 0.1)
    np.testing.assert_allclose(error[~lost], expected[~lost], rtol=0, atol=1e-12)


@pytest.mark.usefixtures("folder")
def test_it_loses_the_floor_beyond_its_range() -> None:
    kinematic = {"followers.0.guidance_position": "truth", "motion": "kinematic"}
    # the follower is at a depth of 10 m, 20 m above the floor
    assert np.isfinite(fly(kinematic, lock=20.5, **NO_ERRORS).measurements[0].custom["dvl"]).any()
    lost = fly(kinematic, lock=19.5, **NO_ERRORS)
    assert np.isnan(lost.measurements[0].custom["dvl"]).all()
    # without a reading the navigator keeps the velocity of the start
    assert np.ptp(lost.estimates[0].state[:, 2:], axis=0) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.usefixtures("folder")
def test_a_closed_loop_steers_by_it_and_reads_what_is_computed_after_the_mission() -> None:
    flight = fly({"run": 2})
    measured = flight.measurements[0]
    (renavigated,) = navigate(flight.scenario, flight.trajectory).measurements
    np.testing.assert_allclose(renavigated.custom["dvl"], measured.custom["dvl"], rtol=0, atol=1e-9)
    # the estimated eastward velocity is that of the last reading, turned by its heading
    state = flight.estimates[0].state
    forward, port = measured.custom["dvl"][:, :2].T
    has_reading = np.isfinite(forward)
    sine, cosine = np.sin(measured.heading), np.cos(measured.heading)
    east = (forward * sine - port * cosine)[has_reading]
    reading_count = np.cumsum(has_reading)
    np.testing.assert_allclose(
        state[reading_count > 0, 2], east[reading_count[reading_count > 0] - 1], rtol=0, atol=1e-12
    )


@pytest.mark.usefixtures("folder")
def test_a_stepped_mission_returns_its_readings() -> None:
    changes = {"duration_s": 2.0, "sensors.custom": [{"sensor": "dvl:Dvl", "dropout": 0.0}]}
    sim = laisn_sim.Simulation("dvl.toml", changes)
    readings = []
    while not sim.done:
        sim.step()
        readings.append(sim.readings["follower"].custom["dvl"])
    np.testing.assert_array_equal(readings, sim.flight().measurements[0].custom["dvl"])


@pytest.mark.usefixtures("folder")
def test_logs_tables_and_replays_follow_from_its_declaration() -> None:
    command = "fly dvl.toml --plugin dvl.py --plugin by_dvl.py --no-video --out out"
    result = CliRunner().invoke(app, [*command.split(), "--set", "duration_s=20"])
    assert result.exit_code == 0, result.output
    flight = laisn_sim.read_log("out/flight.mcap")
    (measured,) = flight.measurements
    assert [*measured.sensors["dvl"].channels] == [
        ("forward", "m/s"),
        ("port", "m/s"),
        ("up", "m/s"),
        ("altitude", "m"),
    ]
    assert measured.sensors["dvl"].period == 0.2
    dvl = measured.custom["dvl"]
    assert dvl.shape == (200, 4)
    assert np.isnan(dvl[0::2]).all()
    assert 50 < np.isfinite(dvl[1::2, 3]).sum() < 100
    table = laisn_sim.measurements(flight)
    for i, column in enumerate(("forward_m_s", "port_m_s", "up_m_s", "altitude_m")):
        np.testing.assert_array_equal(table[f"dvl_{column}"], dvl[:, i])
    result = CliRunner().invoke(app, ["log", "export", "out/flight.mcap", "csv", "--format", "csv"])
    assert result.exit_code == 0, result.output
    (file,) = Path("csv").rglob("*dvl*")
    lines = file.read_text("utf-8").splitlines()
    assert lines[0].replace('"', "").endswith("forward,port,up,altitude")
    # at 5 Hz, also where it has no lock
    assert len(lines) == 101
    replay = "replay out/flight.mcap --plugin by_dvl.py --variant by_dvl:ByDvl --out again.mcap"
    result = CliRunner().invoke(app, replay.split())
    assert result.exit_code == 0, result.output
    renavigated = laisn_sim.navigate(flight)
    np.testing.assert_allclose(
        renavigated.estimates[0].state, flight.estimates[0].state, rtol=0, atol=1e-12
    )


@pytest.mark.usefixtures("folder")
def test_a_navigator_names_the_readings_that_it_needs() -> None:
    with pytest.raises(
        LaisnError, match=r"ByDvl needs readings 'dvl'; sensors.custom gives 'gyros'"
    ):
        laisn_sim.fly("dvl.toml", {"duration_s": 1.0, "sensors.custom": [{"sensor": "gyros"}]})


@pytest.mark.usefixtures("folder")
def test_a_recording_of_a_vehicle_may_hold_readings_of_custom_sensors() -> None:
    from sim.log.reader import read_recording

    flight = fly({"followers.0.guidance_position": "truth", "motion": "kinematic"})
    laisn_sim.write_log(flight, "flight.mcap")
    recorded = read_recording("flight.mcap").measurements
    np.testing.assert_array_equal(recorded.custom["dvl"], flight.measurements[0].custom["dvl"])
    assert recorded.sensors == flight.measurements[0].sensors


@pytest.mark.system
@pytest.mark.usefixtures("folder")
def test_a_second_follower_has_other_errors_and_a_study_those_of_its_flights() -> None:
    followers = [{"route": "T5", "name": "one"}, {"route": "T3", "name": "other"}]
    changes = {"followers": followers, "motion": "kinematic"}
    flight = fly(changes, velocity_sigma_m_s=0.02, dropout=0.0)
    without_errors = fly(changes, **NO_ERRORS)
    for follower in range(2):
        error = (
            flight.measurements[follower].custom["dvl"]
            - without_errors.measurements[follower].custom["dvl"]
        )
        steps = np.arange(2, STEPS + 1, 2)
        draws = normals(1, 0, STREAMS * follower + 20, steps)
        np.testing.assert_allclose(error[1::2, :2], 0.02 * draws, rtol=0, atol=1e-12)
    keys = {"duration_s": 20.0, "motion": "kinematic", "followers.0.guidance_position": "truth"}
    table = laisn_sim.study(
        "dvl.toml",
        set=keys,
        vary={"sensors.custom.0.dropout": [0.0, 0.9]},
        runs=2,
        out="study",
    ).table
    sensor = [{"sensor": "dvl:Dvl", "dropout": 0.9}]
    errors_of_runs = [
        laisn_sim.errors(laisn_sim.fly("dvl.toml", keys | {"sensors.custom": sensor, "run": run}))
        for run in range(2)
    ]
    mean = np.mean([errors["e_p_m"].mean() for errors in errors_of_runs])
    assert table["e_p_mean_m"][-1] == pytest.approx(mean)


STEERING = {
    "duration_s": 2.0,
    "followers.0.guidance_position": "estimate",
    "sensors.custom": [{"sensor": "gyros"}, {"sensor": "inclinometer"}],
}


def test_listed_instruments_are_those_by_which_a_follower_steers() -> None:
    sim = laisn_sim.Simulation("T5", STEERING)
    while not sim.done:
        sim.step()
        readings = sim.readings["follower"]
        rates = (readings.yaw_rate, readings.pitch_rate)
        assert readings.custom["gyros"] == pytest.approx(rates, abs=1e-12)
        assert readings.custom["inclinometer"] == pytest.approx([readings.pitch], abs=1e-12)
        assert readings.pitch != 0.0


@dataclass(frozen=True, kw_only=True)
class ByRows:
    """The inverted USBL with the interface of earlier versions: arrays with a row for each filter
    step.
    """

    name = "bearing"
    stream = 45
    acoustic = True

    sigma: float = float(np.deg2rad(1.0))

    def true(self, state: Any) -> Floats:
        to_hull = state.quaternion * np.array([1.0, -1.0, -1.0, -1.0])
        forward, port, up = rotate(to_hull, state.source[:, 1] - state.hydrophone).T
        return np.column_stack(
            [np.arctan2(-port, forward), np.arctan2(up, np.hypot(forward, port))]
        )

    def read(self, true: Floats, normals: Floats) -> Floats:
        return np.asarray(true + self.sigma * normals)


class ByReception:
    """A navigator of earlier versions, which finds the direction in the reception."""

    azimuths: list[float] = []  # noqa: RUF012

    def __init__(self, settings: Any, start: Floats) -> None:
        self.state, self.covariance = np.array(start), np.eye(4)

    def step(self, own: Any, reception: Any, dt: float) -> None:
        if reception is not None:
            self.azimuths.append(reception.bearing.azimuth)


@pytest.mark.parametrize("position", ["truth", "estimate"])
def test_sensors_of_earlier_versions_read_as_before(
    position: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the same noise for both, so that their readings can be compared
    monkeypatch.setattr(InvertedUsblSensor, "stream", ByRows.stream)
    keys = {"duration_s": 10.0, "followers.0.guidance_position": position}
    ByReception.azimuths.clear()
    by_old_interface = laisn_sim.fly(
        "T5", {**keys, "sensors.custom": [{"sensor": register(ByRows)}]}, navigator=ByReception
    )
    by_new_interface = navigate(
        laisn_sim.load("T5", {**keys, "sensors.custom": [{"sensor": "inverted-usbl"}]}),
        by_old_interface.trajectory,
    )
    measured: Measurements = by_old_interface.measurements[0]
    np.testing.assert_allclose(
        measured.custom["bearing"],
        by_new_interface.measurements[0].custom["bearing"],
        rtol=0,
        atol=1e-12,
    )
    received = measured.custom["bearing"][measured.message_step - 1, 0]
    np.testing.assert_array_equal(ByReception.azimuths, received)
    # it also takes the place of the sensor of that name that a navigator needs
    usbl = {"navigation.variant": "inverted-usbl", "sensors.custom": [{"sensor": register(ByRows)}]}
    flight = laisn_sim.fly("T5", {**keys, **usbl})
    assert np.isfinite(flight.estimates[0].state).all()
    assert not flight.measurements[0].sensors["bearing"].channels


class Probe:
    """A valid sensor, of which each test changes one attribute."""

    name = "probe"
    stream = 30
    channels = MappingProxyType({"value": "m"})

    def true(self, state: Any, environment: Any) -> Any:
        return (1.0,)

    def read(self, true: Any, draws: Any) -> Any:
        return true


WRONG_DECLARATIONS = {
    "channels": ({"channels": {}}, "has no channels"),
    "names": ({"channels": {"a-b": "m"}}, "channel 'a-b'; expected letters"),
    "name": ({"name": "my probe"}, "name = 'my probe'"),
    "units": ({"channels": ["value"]}, "expected names and their units"),
    "period": ({"period": 0.25}, "no multiple of filter_step_s = 0.1"),
    "negative": ({"period": -1.0}, "expected seconds, 0 or more"),
    "name of a number": ({"name": 5}, "name = 5; expected letters"),
    "period of a truth value": ({"period": True}, "`period` is True; expected seconds"),
    "normals of a text": ({"normals": "3"}, "`normals` is '3'; expected how many normals"),
    "broken normals": ({"normals": 2.5}, "`normals` is 2.5; expected how many normals"),
    "negative normals": ({"normals": -1}, "`normals` is -1; expected how many normals"),
    "normals of a truth value": ({"normals": True}, "`normals` is True; expected how many"),
    "acoustic": ({"acoustic": "no"}, "`acoustic` is 'no'; expected True or False"),
    "stream": ({"stream": 64}, "stream = 64; expected 16 … 63"),
    # the noise of the speed log, and of the last of the project's own sensors
    "stream of the log": ({"stream": 0}, "stream = 0; expected 16 … 63"),
    "stream of a shipped sensor": ({"stream": 15}, "stream = 15; expected 16 … 63"),
    "shape": ({"read": lambda self, true, draws: (1.0, 2.0)}, "for each of its channels .value."),
    "text": ({"true": lambda self, state, environment: "deep"}, "`true` gave 'deep'"),
    "scalar": ({"true": lambda self, state, environment: 1.0}, "`true` gave 1.0"),
}


@pytest.mark.parametrize(
    ("attributes", "message"), WRONG_DECLARATIONS.values(), ids=WRONG_DECLARATIONS
)
@pytest.mark.parametrize("position", ["truth", "estimate"])
def test_a_wrong_sensor_is_refused_with_what_is_expected(
    attributes: dict[str, Any], message: str, position: str
) -> None:
    sensor = type("Probe", (Probe,), attributes)
    keys = {"duration_s": 1.0, "followers.0.guidance_position": position}
    with pytest.raises(LaisnError, match=message):
        laisn_sim.fly("T5", {**keys, "sensors.custom": [{"sensor": register(sensor)}]})


@pytest.mark.parametrize(
    ("attributes", "message"),
    [({"stream": 31}, "both named 'probe'"), ({"name": "other"}, "both have stream = 30")],
)
def test_two_sensors_with_one_name_or_one_stream_of_noise_are_refused(
    attributes: dict[str, Any], message: str
) -> None:
    other = type("Other", (Probe,), attributes)
    listed = [{"sensor": register(Probe)}, {"sensor": register(other)}]
    with pytest.raises(LaisnError, match=message):
        laisn_sim.fly("T5", {"duration_s": 1.0, "sensors.custom": listed})


@pytest.mark.parametrize("key", ["sensors.custom", "leader.sensors.custom"])
def test_names_that_are_one_in_the_fields_of_logs_are_refused(key: str) -> None:
    """On one vehicle and on two: a link with readings of both would log those of one."""
    hyphen = register(type("Hyphen", (Probe,), {"name": "a-b"}))
    underscore = register(type("Underscore", (Probe,), {"name": "a_b", "stream": 31}))
    changes = {"sensors.custom": [{"sensor": hyphen}]}
    changes[key] = [*changes.get(key, []), {"sensor": underscore}]
    expected = r"'a-b' \(Hyphen\) and 'a_b' \(Underscore\) are both 'a_b' in the fields of logs"
    if key.startswith("leader"):
        # the leader's come first
        expected = r"'a_b' \(Underscore\) and 'a-b' \(Hyphen\) are both 'a_b' in the fields of logs"
    with pytest.raises(LaisnError, match=expected):
        laisn_sim.load("T5", changes)


@dataclass(frozen=True, kw_only=True)
class TravelTime(Sensor):
    """Time of the direct ray from 20 m below the surface above the vehicle's start."""

    name = "travel"
    channels: ClassVar = {"time": "s"}
    stream = 44

    def true(self, state: Any, environment: Any) -> tuple[float]:
        direct, _, _ = environment.arrivals((0.0, 0.0, -20.0), tuple(state.hydrophone.tolist()))
        return (direct.time,)

    def read(self, true: Any, draws: Any) -> Any:
        return true


def test_a_sensor_is_given_the_speed_of_sound_of_the_scenario_in_open_and_closed_loops(
    no_plugins: None,
) -> None:
    """Of 1400 to 1401 m/s. A stepped mission, which is a closed loop, reads the same as a finished
    one; on the leader the sensor reads the travel time too.
    """
    profile = [[0.0, 1400.0], [60.0, 1401.0]]
    table = {
        "duration_s": 3.0,
        "acoustics": {"sound_speed_m_s": 1400.0, "sound_speed_profile": profile},
        "sensors": {"custom": [{"sensor": register(TravelTime)}]},
        "leader": {"sensors": {"custom": [{"sensor": register(TravelTime)}]}},
        "followers": [{"route": "T5"}],
    }
    stepped = laisn_sim.Simulation(table).step(3.0).flight()
    open_loop = {key: value for key, value in table.items() if key != "leader"}
    finished = laisn_sim.fly(open_loop)
    of_follower = stepped.measurements[0].custom["travel"]
    np.testing.assert_array_equal(of_follower, finished.measurements[0].custom["travel"])
    assert stepped.leader is not None
    for times, name in (
        (of_follower, "follower/hydrophone"),
        (stepped.leader.measurements.custom["travel"], "leader"),
    ):
        truth = stepped.trajectory
        ticks = stepped.step_index()
        position = truth.site_path(name, ticks) if "/" in name else truth.position[ticks, 0]
        distance = np.linalg.norm(position - (0.0, 0.0, -20.0), axis=1)
        # the mean speed over depths of a few metres is known to 0.5 m/s
        np.testing.assert_allclose(times[:, 0] * 1400.5 / distance, 1.0, rtol=0, atol=4e-4)


@pytest.mark.parametrize(
    ("variant", "sensors", "expected"),
    [
        ("laisn-2", [], []),
        ("laisn-2", ["dvl"], ["dvl"]),
        ("inverted-usbl", [], ["bearing"]),
        ("inverted-usbl", ["dvl"], ["bearing", "dvl"]),
        ("inverted-usbl", ["inverted-usbl"], ["bearing"]),
        ("inverted-usbl", ["dvl", "inverted-usbl"], ["dvl", "bearing"]),
    ],
)
def test_a_follower_has_the_sensor_that_its_navigator_needs_once(
    variant: str, sensors: list[str], expected: list[str]
) -> None:
    custom = [{"sensor": name} for name in sensors]
    scenario = laisn_sim.load("T5", {"navigation.variant": variant, "sensors.custom": custom})
    sensing = sensing_of_each(scenario)[0]
    assert [sensor.name for sensor in custom_sensors(sensing, 0)] == expected
