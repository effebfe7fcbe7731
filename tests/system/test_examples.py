"""Every example runs in an empty folder, and what it prints agrees with closed forms or
invariants.
"""

import math
import re
from pathlib import Path

import pytest

from tools.documents import gallery

pytestmark = pytest.mark.system


def run(name: str, folder: Path) -> str:
    """What an example prints that is run in a folder. The pages of examples are built of what it
    leaves.
    """
    example = gallery.execute(gallery.EXAMPLES / f"{name}.py", folder)
    assert len(example.code.splitlines()) <= 90
    if example.pictures:
        gallery.keep(example)
    return example.output


def numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"-?\d+\.?\d*", text)]


FILES_LEFT = {
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
    "learning": {"distance.png"},
    "learning_side_by_side": {"distances.png"},
    "lost_messages": {"bursts.png"},
    "message_interval": {"intervals.png"},
    "observer": {"distance.png"},
    "own_mission": {"own_mission.png"},
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
"""Files that each example leaves in its folder."""


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


def check_pitch(text: str) -> None:
    lines = text.splitlines()
    # abeam the fix moves by Δz sin φ exactly to first order: 0.17, 0.87, 1.74 m
    for line, expected in zip(lines[1:4], (0.1745, 0.8716, 1.7365), strict=True):
        assert numbers(line)[3] == pytest.approx(expected, abs=0.006)
    # astern with the bow up no two circles meet: the follower is put onto the axis at the
    # horizontal range of the rear end, which is sin φ lower; with the bow down they meet
    bow_up, bow_down = lines[-2:]
    c, s = math.cos(math.radians(5.0)), math.sin(math.radians(5.0))
    rear_range = math.sqrt((60.0 - c) ** 2 - 20.0 * s + s**2)
    assert bow_up.endswith("on the axis")
    assert numbers(bow_up)[3] == pytest.approx(abs(rear_range - 59.0), abs=0.006)
    rear_squared, front_squared = (
        (60.0 - end * c) ** 2 + end * 20.0 * s + s**2 for end in (1.0, -1.0)
    )
    fix_ahead = (rear_squared - front_squared) / 4.0
    fix_error = math.hypot(fix_ahead + 60.0, math.sqrt(rear_squared - (fix_ahead + 1.0) ** 2))
    assert bow_down.endswith("two points")
    assert numbers(bow_down)[3] == pytest.approx(fix_error, abs=0.006)
    assert "e+" not in text


def check_heavier_vehicle(text: str) -> None:
    # at 1 m/s drag is ½ρ S C_D U²: twice the coefficient adds 6.1 N
    own, shipped = (numbers(line)[0] for line in text.splitlines())
    assert own - shipped == pytest.approx(0.5 * 1026 * 0.2128 * 0.05596, rel=0.03)


def check_stop(text: str) -> None:
    """The mission is stopped at an error of 3 m, and there is a message a second."""
    time, error = numbers(text.splitlines()[0])
    messages = numbers(text.splitlines()[1])[0]
    assert 3.0 <= error < 5.0
    assert messages == pytest.approx(time, abs=1.0)


def check_circles(text: str) -> None:
    """It begins some 60 m away, and circles about the goal within two turning radii."""
    assert numbers(text)[1] < 8.0


def check_learning(text: str) -> None:
    """It begins 50 m off its place, and keeps to it; Gymnasium has no objection."""
    distance, time = numbers(text)
    assert distance < 5.0
    assert time == 200.0


def check_learning_side_by_side(text: str) -> None:
    """They begin 50 m off their places, twice in some 400 s, and then keep to them."""
    distance, decisions = numbers(text)
    assert 5.0 < distance < 25.0
    assert decisions == 16 * 450


def check_two_by_hand(text: str) -> None:
    """The leader turns to port; the follower without effectors comes to rest, then goes on."""
    rows = [numbers(line) for line in text.splitlines()]
    assert rows[3][1] < rows[0][1]
    assert rows[3][3] < 0.5 * rows[0][3]
    assert rows[4][1] > 0.5


def check_replay(text: str) -> None:
    assert numbers(text.splitlines()[1])[-1] == pytest.approx(0.2, abs=0.1)


def check_own_mission(text: str) -> None:
    """The leader pitches with the waves, and a follower that knows its attitude errs less, most in
    bearing.
    """
    level, known = (numbers(line.partition("mean E_P")[2]) for line in text.splitlines()[1:3])
    assert known[0] < level[0]
    assert known[1] < 0.8 * level[1]


def check_own_study(text: str) -> None:
    """The error that pitch adds grows with depth; with the attitude broadcast it does not."""
    lines = text.splitlines()[:6]
    without_attitude = [numbers(line)[-1] for line in lines[::2]]
    with_attitude = [numbers(line)[-1] for line in lines[1::2]]
    assert without_attitude[0] < without_attitude[1] < without_attitude[2]
    assert max(with_attitude) - min(with_attitude) < 0.02


CHECKS = {
    "controller_by_hand": check_circles,
    "learning": check_learning,
    "learning_side_by_side": check_learning_side_by_side,
    "lost_messages": check_losses,
    "message_interval": check_intervals,
    "observer": check_instants,
    "own_mission": check_own_mission,
    "own_study": check_own_study,
    "own_vehicle": check_heavier_vehicle,
    "pitch_asymmetry": check_pitch,
    "replay_log": check_replay,
    "stop_button": check_stop,
    "third_transmitter": check_transmitters,
    "two_by_hand": check_two_by_hand,
    "waves": check_waves,
}
"""What the text of an example must satisfy; of the others only files are checked."""


@pytest.mark.parametrize("name", FILES_LEFT)
def test_examples_leave_their_files_and_print_what_is_expected(name, tmp_path):
    text = run(name, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == FILES_LEFT[name]
    if name in CHECKS:
        CHECKS[name](text)


def test_the_picture_is_of_the_largest_pitch(tmp_path):
    """`diving` dives at its start; a machine without graphics libraries prints why there is no
    picture.
    """
    text = run("film_of_a_moment", tmp_path)
    assert numbers(text)[0] < -5.0
    assert (tmp_path / "moment.png").is_file() != ("no picture: " in text)


def test_figures_for_a_paper_are_vectors(tmp_path):
    text = run("figures_for_a_paper", tmp_path)
    for name in ("routes.pdf", "errors.pdf"):
        assert (tmp_path / name).read_bytes().startswith(b"%PDF")
    assert (tmp_path / "leader.png").is_file() != ("no picture: " in text)


def test_every_example_is_tried():
    names = {path.stem for path in gallery.EXAMPLES.glob("*.py")}
    assert names == {*FILES_LEFT, "film_of_a_moment", "figures_for_a_paper"}
    assert len(names) >= 20


@pytest.mark.parametrize("name", FILES_LEFT)
def test_the_page_of_examples_has_a_picture_of_each(name):
    """It is built of what they leave, and fails without one."""
    assert any(file.endswith(".png") for file in FILES_LEFT[name])
