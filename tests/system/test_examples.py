"""Every example runs in an empty folder, and what it prints agrees with closed forms or
invariants.
"""

import math
import re
import runpy
from pathlib import Path

import pytest

pytestmark = pytest.mark.system

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))


def run(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str], patch: pytest.MonkeyPatch
) -> str:
    """What an example prints."""
    patch.chdir(folder)
    patch.setenv("MPLBACKEND", "agg")
    (path,) = (path for path in EXAMPLES if path.stem == name)
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 62
    runpy.run_path(str(path), run_name="__main__")
    return capsys.readouterr().out


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.?\d*", text)]


WROTE = {
    "compare_navigators": {"navigators.png"},
    "controller_by_hand": {"circles.png"},
    "export_tables": {
        "errors.png",
        *(
            f"{name}.{end}"
            for name in ("truth", "measurements", "errors")
            for end in ("csv", "parquet")
        ),
    },
    "formation_in_current": {"formation.png"},
    "lost_messages": {"bursts.png"},
    "message_interval": {"intervals.png"},
    "observer": {"distance.png"},
    "own_study": {"out", "trim.png"},
    "own_vehicle": {"heavier.xml", "own_vehicle.png"},
    "pitch_asymmetry": {"pitch.png"},
    "plot_from_parquet": {"out", "compass.png"},
    "replay_log": {"flight.mcap", "tight.png"},
    "stop_button": {"stopped.png"},
    "ten_noises": {"ten_noises.png"},
    "third_transmitter": {"2_transmitters.png", "3_transmitters.png"},
    "two_by_hand": {"by_hand.png"},
    "waves": {"waves.png"},
}
"""Files that an example leaves."""


def check_losses(text: str) -> None:
    """All messages, then about a half, alone and in bursts of 20 of 40."""
    received = [numbers(line)[0] for line in text.splitlines()]
    assert received[0] == 100
    assert min(received[1:]) > 35
    assert max(received[1:]) < 65


def check_intervals(text: str) -> None:
    """Rarer messages, larger errors."""
    for line in text.splitlines():
        means = numbers(line.partition(" ")[2])[1::2]
        assert means == sorted(means)


def check_transmitters(text: str) -> None:
    two, three = (numbers(line.partition(":")[2])[0] for line in text.splitlines())
    assert three < two


def check_instants(text: str) -> None:
    """One each 0.1 s, with the first one."""
    assert numbers(text)[0] == 2001


def check_waves(text: str) -> None:
    calm, rough = (numbers(line)[0] for line in text.splitlines())
    assert calm < 0.05
    assert rough > 0.3


CHECKS = {
    "lost_messages": check_losses,
    "message_interval": check_intervals,
    "third_transmitter": check_transmitters,
    "observer": check_instants,
    "waves": check_waves,
}


@pytest.mark.parametrize("name", WROTE)
def test_examples_run(name, tmp_path, capsys, monkeypatch):
    text = run(name, tmp_path, capsys, monkeypatch)
    assert {path.name for path in tmp_path.iterdir()} == WROTE[name]
    if name == "pitch_asymmetry":
        # abeam the fix moves by Δz sin φ exactly to first order: 0.17, 0.87, 1.74 m
        for line, expected in zip(text.splitlines()[1:4], (0.1745, 0.8716, 1.7365), strict=True):
            assert numbers(line)[3] == pytest.approx(expected, abs=0.006)
        # astern with the bow up no two circles meet: the follower is put onto the axis at the
        # horizontal range of the rear end, which is sin φ lower; with the bow down they meet
        up, down = text.splitlines()[-2:]
        c, s = math.cos(math.radians(5.0)), math.sin(math.radians(5.0))
        rear = math.sqrt((60.0 - c) ** 2 - 20.0 * s + s**2)
        assert up.endswith("on the axis")
        assert numbers(up)[3] == pytest.approx(abs(rear - 59.0), abs=0.006)
        rear_2, front_2 = ((60.0 - k * c) ** 2 + k * 20.0 * s + s**2 for k in (1.0, -1.0))
        ahead = (rear_2 - front_2) / 4.0
        moved = math.hypot(ahead + 60.0, math.sqrt(rear_2 - (ahead + 1.0) ** 2))
        assert down.endswith("two points")
        assert numbers(down)[3] == pytest.approx(moved, abs=0.006)
        assert "e+" not in text
    if name == "own_vehicle":
        # at 1 m/s drag is ½ρ S C_D U²: twice the coefficient adds 6.1 N
        own, usual = (numbers(line)[0] for line in text.splitlines())
        assert own - usual == pytest.approx(0.5 * 1026 * 0.2128 * 0.05596, rel=0.03)
    if name == "stop_button":
        time, error = numbers(text.splitlines()[0])
        messages = numbers(text.splitlines()[1])[0]
        assert 3.0 <= error < 5.0
        # a message a second
        assert messages == pytest.approx(time, abs=1.0)
    if name == "controller_by_hand":
        # it begins some 60 m away, and circles about the goal within two turning radii
        assert numbers(text)[1] < 8.0
    if name == "two_by_hand":
        rows = [numbers(line) for line in text.splitlines()]
        # the leader turns to port, the follower without effectors comes to rest, then goes on
        assert rows[3][1] < rows[0][1]
        assert rows[3][3] < 0.5 * rows[0][3]
        assert rows[4][1] > 0.5
    if name == "replay_log":
        assert numbers(text.splitlines()[1])[-1] == pytest.approx(0.2, abs=0.1)
    CHECKS.get(name, str)(text)
    if name == "own_study":
        # the error that pitch adds grows with depth; with the attitude broadcast it does not
        level = [numbers(line)[-1] for line in text.splitlines()[:6:2]]
        used = [numbers(line)[-1] for line in text.splitlines()[1:6:2]]
        assert level[0] < level[1] < level[2]
        assert max(used) - min(used) < 0.02


def test_the_picture_is_of_the_largest_pitch(tmp_path, capsys, monkeypatch):
    """`diving` dives at its start; a machine without graphics libraries prints why there is no
    picture.
    """
    text = run("film_of_a_moment", tmp_path, capsys, monkeypatch)
    assert numbers(text)[0] < -5.0
    assert (tmp_path / "moment.png").is_file() != ("no picture: " in text)


def test_figures_for_a_paper_are_vectors(tmp_path, capsys, monkeypatch):
    text = run("figures_for_a_paper", tmp_path, capsys, monkeypatch)
    for name in ("routes.pdf", "errors.pdf"):
        assert (tmp_path / name).read_bytes().startswith(b"%PDF")
    assert (tmp_path / "leader.png").is_file() != ("no picture: " in text)


def test_every_example_is_tried():
    """The tutorial's own test runs `own_mission`."""
    alone = {"own_mission", "film_of_a_moment", "figures_for_a_paper"}
    assert {path.stem for path in EXAMPLES} == {*WROTE, *alone}
    assert len(EXAMPLES) >= 20
