"""A current of the user's own, in Python, as `--plugin` loads it."""

import copy
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim.water.custom import CustomCaller

pytestmark = pytest.mark.usefixtures("no_plugins")

EDDY = '''
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Eddy:
    centre_east: float = 100.0
    speed: float = 0.3
    radius: float = 80.0

    def velocity(self, position, time):
        east, north, _ = position - (self.centre_east, 0.0, 0.0)
        turn = self.speed / self.radius * np.exp(0.5 - 0.5 * (east**2 + north**2) / self.radius**2)
        return -turn * north, turn * east


class Keys:
    """What the keys of a scenario may have: shear, and a change in time."""

    def velocity(self, position, time):
        return 0.3 + 0.004 * position[2] + 0.002 * time, 0.0, 0.0
'''
SHORT = ["--no-video", "--set", "duration_s=20"]


@pytest.fixture
def plugin(tmp_path: Path) -> Path:
    # a name that no other test has, as a process knows a plugin by its name
    file = tmp_path / f"{tmp_path.name}.py"
    file.write_text(EDDY)
    return file


def fly(plugin: Path, *settings: str) -> tuple[int, str, Path]:
    out = plugin.parent / "out"
    words = ["fly", "T5", "--plugin", str(plugin), *SHORT, "--out", str(out)]
    words += [word for setting in settings for word in ("--set", setting)]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "300"})
    return result.exit_code, result.output, out


@pytest.mark.system
def test_an_eddy_carries_the_vehicles(plugin: Path) -> None:
    keys = [f"model={plugin.stem}:Eddy", "own.speed_m_s=0.2", "own.centre_east_m=30"]
    code, output, out = fly(plugin, *(f"ocean.current.{key}" for key in keys))
    assert code == 0, output
    truth = laisn_sim.read_log(out / "flight.mcap").trajectory
    for vehicle in range(2):
        east, north, _ = (truth.position[:, vehicle] - (30.0, 0.0, 0.0)).T
        turn = 0.2 / 80.0 * np.exp(0.5 - 0.5 * (east**2 + north**2) / 80.0**2)
        expected = np.column_stack([-turn * north, turn * east, np.zeros(east.size)])
        np.testing.assert_allclose(truth.water_velocity[:, vehicle], expected, atol=1e-12)
    assert np.abs(truth.water_velocity).max() > 0.05


def test_it_moves_vehicles_as_the_same_current_of_keys_does(plugin: Path) -> None:
    """Gradient and rate, which added mass feels, are differences of its velocity."""
    laisn_sim.load_plugin(plugin)
    mine = laisn_sim.fly("T5", {"duration_s": 20, "ocean.current.model": f"{plugin.stem}:Keys"})
    keys = {
        "current_shear_per_s": 0.004,
        "current_direction_deg": 90.0,
        "current_profile": [[0.0, 0.3, 90.0], [100.0, 0.5, 90.0]],
    }
    other = laisn_sim.fly(
        "T5", {"duration_s": 20} | {f"ocean.{key}": value for key, value in keys.items()}
    )
    np.testing.assert_allclose(mine.trajectory.pose, other.trajectory.pose, atol=1e-9)


BROKEN = """
class Broken:
    def velocity(self, position, time):
        {body}


class Wordless:
    pass
"""


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("return 1.0 / 0.0", "ZeroDivisionError"),
        ("return 1.0 / 0.0 if time > 5.0 else (0.0, 0.0)", "return 1.0 / 0.0 if time > 5.0"),
        ("return (float('nan'), 0.0)", "expected two or three finite numbers"),
        ("return 0.0", "expected two or three finite numbers"),
        ("return (4.0, 0.0)", "meets 4 m/s"),
    ],
)
def test_errors_of_the_class_are_told_as_the_user_s(
    tmp_path: Path, body: str, expected: str
) -> None:
    # a name that no other test has, as a process knows a plugin by its name
    file = tmp_path / f"{tmp_path.name}.py"
    file.write_text(BROKEN.format(body=body))
    code, output, _ = fly(file, f"ocean.current.model={file.stem}:Broken")
    assert code == 2, output
    assert expected in output
    assert "bug" not in output


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (["model=MINE:Wordless"], "has no `velocity(position, time)`"),
        (["model=MINE:Nobody"], "expected a class of"),
        (["model=MINE:Broken", "custom.depth_m=3"], "Broken has no key 'depth'; it has: none"),
        (["model=other:Broken"], "is in a plugin that is not loaded"),
    ],
)
def test_a_class_that_is_none_is_refused(
    tmp_path: Path, settings: list[str], expected: str
) -> None:
    file = tmp_path / f"{tmp_path.name}.py"
    file.write_text(BROKEN.format(body="return 0.0, 0.0"))
    named = [f"ocean.current.{setting}".replace("MINE", file.stem) for setting in settings]
    code, output, _ = fly(file, *named)
    assert code == 2, output
    assert expected in output


class Still:
    def velocity(self, position: object, time: float) -> tuple[float, float]:
        return 0.0, 0.0


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, pickle.dumps])
def test_the_address_of_a_current_is_neither_copied_nor_pickled(
    duplicate: Callable[[object], object],
) -> None:
    caller = CustomCaller(Still())
    for holder in (caller, caller.compiled_current, caller.compiled_current.at_time(1.0)):
        with pytest.raises(LaisnError, match="neither copied nor pickled"):
            duplicate(holder)
