"""Commands on the log of a flight with a navigator of the user's own, whose plugin a later process
has not loaded.
"""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from laisn.navigators import find, title_of
from laisn.plugins import load_plugin
from laisn_sim.cli.main import app
from sim.log.reader import read
from tests.without_plugins import without_plugins

PLUGIN = '''
import dataclasses
import numpy as np
from laisn.settings import Settings

class Drifting:
    """Dead reckoning whose hydrophone is 2 m above its depth sensor, as it thinks."""

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Settings(Settings):
        current_east: float = 0.0

    def __init__(self, settings, start):
        self.settings = settings
        self.state = start.copy()
        self.covariance = np.eye(4)

    def step(self, own, reception, dt):
        self.state[0] += dt * (own.speed * np.sin(own.heading) + self.settings.current_east)
        self.state[1] += dt * own.speed * np.cos(own.heading)
'''
SCENARIO = """
duration_s = 20
motion = "kinematic"
[navigation]
variant = "VARIANT"
custom = { current_east_m_s = 0.1, hydrophone_height = 2.0 }
[[followers]]
route = "T5"
"""


def output_of(line: str) -> str:
    """What a command prints, in a process without plugins but those that it loads."""
    with without_plugins():
        result = CliRunner().invoke(app, line.split())
    assert result.exit_code == 0, f"{line}\n{result.output}"
    return result.output


@pytest.fixture(scope="module", params=["drifting:Drifting", "drifting"])
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a flight by a plugin's class, which the scenario names with or without the
    class.
    """
    folder = tmp_path_factory.mktemp("plugin")
    plugin = folder / "drifting.py"
    plugin.write_text(PLUGIN, encoding="utf-8")
    scenario = folder / "mine.toml"
    scenario.write_text(SCENARIO.replace("VARIANT", request.param), encoding="utf-8")
    output_of(f"fly {scenario} --plugin {plugin} --no-video --out {folder}/out")
    return folder


def test_a_page_and_the_error_budget_need_no_plugin(
    flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(flown)
    log = "out/flight.mcap"
    output_of(f"view {log} --no-open --out without.html")
    output_of(f"view {log} --no-open --plugin drifting.py --out with.html")
    budget = output_of(f"range-budget {log}")
    assert budget == output_of(f"range-budget {log} --plugin drifting.py")
    assert "depth measurement" in budget


@pytest.mark.parametrize("format_", ["--tum", "--ros2", "--pyfg", "--gltf", "--format csv"])
def test_an_export_needs_no_plugin(
    flown: Path, format_: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if format_ == "--ros2":
        pytest.importorskip("rosbags")
    monkeypatch.chdir(flown)
    folder = format_.strip("-").replace(" ", "-")
    output_of(f"log export out/flight.mcap without/{folder} {format_}")
    output_of(f"log export out/flight.mcap with/{folder} {format_} --plugin drifting.py")
    files = [file for file in (flown / "without" / folder).iterdir() if file.suffix != ".yaml"]
    assert files
    for file in files:
        other = flown / "with" / folder / file.name
        assert file.read_bytes() == other.read_bytes()


def test_exported_places_have_the_height_that_the_class_was_given(
    flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(flown)
    output_of("log export out/flight.mcap tum --tum")
    lines = (flown / "tum" / "follower_estimate.tum").read_text("utf-8").splitlines()[1:]
    with without_plugins():
        measured_depth = read(flown / "out" / "flight.mcap").measurements[0].depth
    ups = [float(line.split()[3]) for line in lines]
    assert ups == pytest.approx((2.0 - measured_depth).tolist(), abs=1e-8)


def test_a_replay_by_another_navigator_needs_no_plugin(
    flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(flown)
    output = output_of("replay out/flight.mcap --variant laisn-3-2")
    assert "as flown, drifting" in output
    assert "replayed, laisn-3-2" in output


def test_the_plugin_is_asked_for_where_its_class_is_to_navigate(flown: Path) -> None:
    log = flown / "out" / "flight.mcap"
    with without_plugins():
        result = CliRunner().invoke(
            app, ["replay", str(log), "--variant", "drifting:Drifting"], env={"COLUMNS": "200"}
        )
    assert result.exit_code == 2
    assert "--plugin drifting.py" in result.output


def test_titles_of_classes_are_the_same_with_and_without_their_plugin(flown: Path) -> None:
    with without_plugins():
        assert title_of("drifting:Drifting") == "Drifting"
        # which of its classes navigates is not known yet
        assert title_of("drifting") == "drifting"
        load_plugin(flown / "drifting.py")
        assert title_of("drifting:Drifting") == title_of("drifting") == "Drifting"
    assert title_of("tight") == find("tight").title


def test_the_bound_of_a_scenario_takes_a_plugin(
    flown: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(flown)
    assert "follower" in output_of("bound mine.toml --plugin drifting.py")
