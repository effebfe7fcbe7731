"""What plug-ins return that cannot be used is refused with class, file, what it was, and what is
expected.
"""

from pathlib import Path
from typing import Any

import pytest

import laisn_sim
from laisn.errors import LaisnError

PLUGIN = """
from dataclasses import dataclass, replace
from typing import Any, NamedTuple
import numpy as np
from laisn.compiled import compiled


class Nav:
    BIASES: Any = (0.0, 0.0)

    def __init__(self, settings, start):
        self.state, self.covariance, self.n = np.array(start), np.eye(4), 0

    def step(self, own, reception, dt):
        self.n += 1
        if self.n == 5:
            self.biases = self.BIASES


class NanBiases(Nav):
    BIASES = (np.nan, 0.0)


class ThreeBiases(Nav):
    BIASES = (0.1, 0.2, 0.3)


class TextBiases(Nav):
    BIASES = "none"


class Sensor:
    name, stream, channels = "odd", 21, {"v": "m/s", "w": "m/s"}
    TRUE = READ = 1.0

    def true(self, state, environment):
        return [0.0, self.TRUE if state.time > 0.75 else 0.0]

    def read(self, true, draws):
        return [0.0, self.READ if true[1] else 0.0]


class InfTrue(Sensor):
    TRUE = -np.inf


class InfRead(Sensor):
    READ = np.inf


class NoReading(Sensor):
    READ = np.nan


@dataclass(frozen=True)
class Drift:
    mode: str = ""

    def disturb(self, m, seed, run):
        if self.mode == "none":
            return None
        if self.mode == "speed":
            speed = m.speed.copy()
            speed[4] = np.nan
            return replace(m, speed=speed)
        if self.mode == "ranges":
            return replace(m, ranges=m.ranges * np.inf)
        if self.mode == "message":
            return replace(m, message=m.message * np.nan)
        if self.mode == "short":
            return m.part(0, 15)
        if self.mode == "lost":
            return replace(m, ranges=m.ranges * np.nan, depth=m.depth * np.nan)
        return m


class Everywhere:
    def __init__(self, plant, routes):
        self.routes = routes

    def control(self, k, truth):
        self.routes.control(k, truth)
        if k == 20:
            self.routes.command[1, 0] = np.nan
        return 0


class NoCode(NamedTuple):
    routes: Any

    @compiled
    def control(self, k: int, truth: Any) -> int:
        return self.routes.cammand[0, 0]
"""


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_plugins: None) -> Any:
    monkeypatch.chdir(tmp_path)
    Path("answers.py").write_text(PLUGIN, encoding="utf-8")
    return laisn_sim.load_plugin("answers.py")


CLOSED = {"duration_s": 3.0, "followers.0.guidance_position": "estimate"}


@pytest.mark.usefixtures("plugin")
@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        # the fifth step of 0.1 s
        ("NanBiases", r"its `biases` at 0\.5 s are \[nan, 0\.0\]; expected finite numbers, of log"),
        ("ThreeBiases", r"its `biases` is \(0\.1, 0\.2, 0\.3\); expected numbers of shape \(2,\)"),
        ("TextBiases", r"its `biases` is 'none'; expected numbers of shape \(2,\)"),
    ],
)
@pytest.mark.parametrize("changes", [{"duration_s": 3.0}, CLOSED])
def test_biases_are_two_finite_numbers(kind: str, expected: str, changes: dict[str, Any]) -> None:
    with pytest.raises(LaisnError, match=rf"navigator {kind} \(answers\.py\): {expected}"):
        laisn_sim.fly("T5", {**changes, "navigation.variant": f"answers:{kind}"})


@pytest.mark.usefixtures("plugin")
@pytest.mark.parametrize("changes", [{"duration_s": 3.0}, CLOSED])
def test_a_sensor_reads_finite_numbers_or_nothing(changes: dict[str, Any]) -> None:
    # from the eighth step of 0.1 s on
    for kind, answer in (("InfTrue", r"`true` gave \[0\.0, -inf\]"), ("InfRead", "`read` gave")):
        sensors = {"sensors.custom": [{"sensor": f"answers:{kind}"}]}
        with pytest.raises(
            LaisnError, match=rf"sensor {kind} \(answers\.py\): {answer}.* at 0\.8 s; expected"
        ):
            laisn_sim.fly("T5", {**changes, **sensors})
    sensors = {"sensors.custom": [{"sensor": "answers:NoReading"}]}
    (measured,) = laisn_sim.fly("T5", {**changes, **sensors}).measurements
    assert measured.custom["odd"][:7].tolist() == [[0.0, 0.0]] * 7
    assert (measured.custom["odd"][7:, 1] != measured.custom["odd"][7:, 1]).all()


@pytest.mark.usefixtures("plugin")
@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("none", "gave None in run 0; expected changed laisn.messages.Measurements"),
        ("speed", r"gave speed = nan at 0\.5 s in run 0; expected finite"),
        ("ranges", r"gave ranges = inf at \d.* s in run 0; expected finite"),
        ("message", r"gave message = nan at \d.* s in run 0; expected finite"),
        ("short", "gave 15 steps in run 0; expected 30"),
    ],
)
@pytest.mark.parametrize("variant", ["dead-reckoning", "laisn-2"])
def test_a_disturbance_gives_measurements_that_sensors_can_read(
    mode: str, expected: str, variant: str
) -> None:
    study = {
        "scenario": "T5",
        "set": {"duration_s": 3.0, "motion": "kinematic", "navigation": {"variant": variant}},
        "arm": [{"name": "drift", "disturb": {"use": "answers:Drift", "mode": mode}}],
        "runs": 2,
    }
    with pytest.raises(
        LaisnError,
        match=rf"disturbance Drift \(answers\.py\), .*mode='{mode}'.*: `disturb` {expected}",
    ):
        laisn_sim.study(study, out="study", workers=1)


@pytest.mark.usefixtures("plugin")
def test_a_disturbance_may_lose_ranges_and_depths() -> None:
    study = {
        "scenario": "T5",
        "set": {"duration_s": 3.0, "motion": "kinematic", "navigation": {"variant": "ekf"}},
        "arm": [{"name": "drift", "disturb": {"use": "answers:Drift", "mode": "lost"}}],
        "runs": 2,
    }
    assert laisn_sim.study(study, out="study", workers=1).table.rows()


def test_a_controller_of_all_vehicles_commands_finite_numbers(plugin: Any) -> None:
    with pytest.raises(
        LaisnError,
        match=r"controller Everywhere \(answers\.py\) commanded follower \[nan, .*\] at 2 s; "
        "expected finite numbers",
    ):
        laisn_sim.fly("T5", {"duration_s": 3.0}, controller=plugin.Everywhere)


def test_a_compiled_controller_that_cannot_be_compiled_says_where(plugin: Any) -> None:
    line = PLUGIN.splitlines().index("        return self.routes.cammand[0, 0]") + 1
    with pytest.raises(LaisnError) as error:
        laisn_sim.fly(
            "T5", {"duration_s": 3.0}, controller=lambda plant, routes: plugin.NoCode(routes)
        )
    text = str(error.value)
    assert text.startswith("controller NoCode (answers.py) cannot be compiled: ")
    assert f"{Path('answers.py').resolve()}:{line}: Unknown attribute 'cammand'" in text
    assert "\x1b" not in text
