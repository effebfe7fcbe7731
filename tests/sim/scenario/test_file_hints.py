"""Messages of typical mistakes: what was meant, why, and in which line of the file."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim.scenario.file import assigned, key_lines


def refusal(*arguments: str) -> str:
    """What `laisn check` prints when it refuses these arguments."""
    result = CliRunner().invoke(app, ["check", *arguments], env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert "bug" not in result.output
    return result.output


@pytest.mark.parametrize(
    ("assignment", "expected"),
    [
        ("navigation.current=true", "did you mean navigation.assume.current?"),
        ("depth_m=3", "did you mean leader.depth_m or followers.*.depth_m"),
        ("sensors.speed_bais_m_s=1", "did you mean 'speed_bias_m_s'?"),
        ("speed_bias_m_s=1", "did you mean sensors.speed_bias_m_s or leader.sensors.speed"),
        ("navigation.variant=EKF", "did you mean 'ekf'?"),
        ("navigation.variant=laisn3-2", "did you mean 'laisn-3-2'?"),
        ("leader.model=remus_100", "did you mean 'remus100'? vehicles: leader, follower,"),
        ("leader.model=zzz", "vehicles: leader, follower,"),
        ("sensors.custom=[{sensor='inverted_usbl'}]", "did you mean 'inverted-usbl'?"),
        ("sensors.custom=[{sensor='DVL'}]", '"dvl", "inverted-usbl"'),
        ("sensors.custom=[{sensor='dvl',lok_m=3}]", "no key 'lok'; did you mean 'lock'? it has:"),
        ("followers.0.controller=a-b", "expected the class of a plugin, module:Class"),
        ("name='a b'", "expected 1 to 64 letters"),
        ("leader.baseline_m=3", "equal to 2.4 (given: 3); the transmitters are on the leader's"),
        ("followers.depth_m=12", "followers.0.depth_m of the first, or followers.*.depth_m of all"),
        ("followers.3.depth_m=12", "followers has 1, of which the last is followers.0"),
        ("leader.*.depth_m=12", "the scenario has no list leader"),
        ("followers={route='T5'}", "write [[followers]] with two brackets"),
        ("followers.0.waypoints=[[0,0,0],[1,2]]", "expected [[time_s, east_m, north_m], …]"),
        ("followers.0.waypoints=[[0,0,0],[1,2,3,4]]", "expected [[time_s, east_m, north_m], …]"),
    ],
)
def test_a_mistake_is_answered_with_what_was_meant(assignment: str, expected: str) -> None:
    assert expected in refusal("T5", "--set", assignment)


FILE = """\
# a mission
duration_s = 5
[leader]
baseline_m = 3.0

[[followers]]
route = "T5"

[[followers]]
waypoints = [
  [0.0, 1.0, 2.0],
  [3.0, 4.0],
]
model = "lauf"
station.behind = 3
[sensors]
speed_bais_m_s = 0.1
[[sensors.custom]]
sensor = "inverted_usbl"
"""


def test_each_error_of_a_file_has_its_line(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(FILE)
    lines = FILE.splitlines()
    text = refusal(str(tmp_path / "mine.toml"))
    expected = {
        "leader.baseline_m": "baseline_m = 3.0",
        "followers[1].waypoints[1][2]": "waypoints = [",
        "followers[1].model": 'model = "lauf"',
        "followers[1].station.behind": "station.behind = 3",
        "sensors.speed_bais_m_s": "speed_bais_m_s = 0.1",
        "sensors.custom[0].sensor": 'sensor = "inverted_usbl"',
    }
    for key, line in expected.items():
        assert f"  line {lines.index(line) + 1}: {key}: " in text
    # without a line of the file where the command sets another value
    text = refusal(str(tmp_path / "mine.toml"), "--set", "leader.baseline_m=4")
    assert "  leader.baseline_m: " in text


def test_lines_are_those_of_headers_and_keys() -> None:
    lines = key_lines(FILE)
    assert lines["followers", 0] == 6
    assert lines["followers", 1] == 9
    assert lines["followers", 1, "station", "behind"] == 15
    assert lines["sensors", "custom", 0, "sensor"] == 19
    assert key_lines('"a".b = 1 # d = 2') == {("a",): 1, ("a", "b"): 1}


def test_a_star_sets_all_members_of_a_list() -> None:
    table = {"followers": [{"sensors": [{}, {}]}, {"sensors": [{}]}]}
    changed = assigned(table, {"followers.*.sensors.*.sigma": 2})
    assert changed == {"followers": [{"sensors": [{"sigma": 2}] * 2}, {"sensors": [{"sigma": 2}]}]}
    loaded = laisn_sim.load("swarm", {"followers.*.drag_scale": 1.5})
    assert {follower.drag_scale for follower in loaded.followers} == {1.5}


DEEPLY_NESTED = "[" * 3000
HUGE_INTEGER = "9" * 5000


@pytest.mark.parametrize(
    "value",
    [
        DEEPLY_NESTED,
        "[" * 50 + "]" * 50,
        HUGE_INTEGER,
        f"0x{'f' * 5000}",
        "\udc80",
        f"[{HUGE_INTEGER}]",
    ],
)
@pytest.mark.parametrize("option", ["--set", "--vary", "--draw", "file"])
def test_a_value_that_no_scenario_can_hold_is_refused_in_three_lines_at_most(
    value: str, option: str, tmp_path: Path
) -> None:
    if option == "file":
        file = tmp_path / "mine.toml"
        file.write_bytes(f"seed = {value}\n".encode(errors="surrogateescape"))
        commands = [["check", str(file)], ["study", str(file)]]
    else:
        arguments = ["T5", option, f"seed={value}"]
        commands = [["study", *arguments]] + [["check", *arguments]] * (option == "--set")
    for command in commands:
        result = CliRunner().invoke(app, command, env={"COLUMNS": "200"})
        assert result.exit_code == 2, result.output
        assert "bug" not in result.output
        assert len(result.output.splitlines()) <= 3


def test_tables_from_python_are_held_to_the_same_bounds() -> None:
    self_containing: list[object] = []
    self_containing.append(self_containing)
    for table in ({"seed": self_containing}, {"seed": 10**5000}, {"name": "\udc80"}, {"\udc80": 1}):
        with pytest.raises(LaisnError):
            laisn_sim.load({"followers": [{"route": "T5"}], **table})


def test_the_folder_of_a_flight_is_answered_with_its_scenario(tmp_path: Path) -> None:
    folder = tmp_path / "flight"
    folder.mkdir()
    assert "it is a folder\n" in refusal(str(folder))
    (folder / "scenario.toml").write_text('name = "mine"\n', encoding="utf-8")
    expected = f"it is a folder; the scenario of its flight is {folder}/scenario.toml"
    assert expected in refusal(str(folder))
