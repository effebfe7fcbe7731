"""Clocks of bags that step: of the recorder, of a sensor."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from laisn.arrays import Floats
from sim.datasets.bag_clock import corrected_stamps
from sim.log.reader import read_recording
from tests.sim.datasets.bags import Message, write_ros1, write_ros2
from tests.sim.datasets.test_bag_import import (
    LEADER,
    MAP,
    RANGE,
    START_NS,
    in_order,
    leader_messages,
    own_messages,
    printed_text,
    range_messages,
    run,
)

STEP_NS = START_NS + 8 * 10**9 + 50_000_000  # clocks step after messages until this time
MAP_TEXT = (MAP + LEADER + RANGE).replace('stamps = "log"', "")


def set_back(message: Message, back_s: int, *, recorder: bool, stamps: bool) -> Message:
    """A message whose time of recording, time stamp or both are of clocks that were set back."""
    topic, kind, time_ns, fields = message
    header = fields.get("header")
    if stamps and header:
        seconds = header["stamp"]["sec"] - back_s
        header = {**header, "stamp": {**header["stamp"], "sec": seconds}}
        fields = {**fields, "header": header}
    return topic, kind, time_ns - 10**9 * back_s * recorder, fields


def imported(messages: list[Message], folder: Path, write: Any = write_ros2) -> tuple[Any, str]:
    """Measurements of a bag by the map, and what the command printed."""
    folder.mkdir()
    (folder / "map.toml").write_text(MAP_TEXT)
    bag = write(folder / ("dive.bag" if write is write_ros1 else "dive"), messages)
    out = folder / "dive.mcap"
    result = run("import", bag, "--map", folder / "map.toml", "--out", out)
    assert result.exit_code == 0, result.output
    return read_recording(out).measurements, printed_text(result)


def dive_messages() -> list[Message]:
    return in_order(own_messages(), leader_messages(), range_messages())


def assert_same_but_for_one_step(measured: Any, expected: Any) -> None:
    """The time across the step of a clock is known to an interval between messages only: receptions
    may fall into the control step before or after, and the leader 0.2 m from where it was.
    """
    assert measured.speed.size == expected.speed.size
    np.testing.assert_allclose(measured.speed, expected.speed, atol=1e-3)
    assert measured.ranges.shape == expected.ranges.shape
    np.testing.assert_allclose(measured.ranges, expected.ranges, atol=1e-6)
    assert np.abs(measured.message_step - expected.message_step).max() <= 1
    difference: Floats = measured.message[:, 1:3] - expected.message[:, 1:3]
    assert np.abs(difference).max() < 0.2


def sqlite(path: Path, messages: list[Message]) -> Path:
    return write_ros2(path, messages, StoragePlugin.SQLITE3)


@pytest.mark.parametrize("write", [write_ros2, sqlite, write_ros1])
@pytest.mark.parametrize(("stamps", "back_s"), [(True, 30), (True, 3), (False, 3)])
def test_a_recorder_whose_clock_is_set_back_is_corrected(
    tmp_path: Path, write: Any, stamps: bool, back_s: int
) -> None:
    """Readers give messages sorted by time: those before and after the step would be mixed, or
    after a longer step in the wrong order.
    """
    messages = dive_messages()
    expected, _ = imported(messages, tmp_path / "steady", write)
    stepped_messages = [
        set_back(message, back_s, recorder=True, stamps=stamps) if message[2] > STEP_NS else message
        for message in messages
    ]
    measured, printed = imported(stepped_messages, tmp_path / "back", write)
    reported_step_s = re.search(
        r"the recorder.s clock steps back by (\S+) s after message", printed
    )
    assert reported_step_s
    assert float(reported_step_s[1]) == pytest.approx(back_s, abs=0.05)
    assert_same_but_for_one_step(measured, expected)


@pytest.mark.parametrize("back_s", [30, 3])
def test_a_sensor_whose_clock_is_set_back_is_corrected_by_the_recorder_s(
    tmp_path: Path, back_s: int
) -> None:
    messages = dive_messages()
    expected, _ = imported(messages, tmp_path / "steady")
    stepped_messages = [
        set_back(message, back_s, recorder=False, stamps=True)
        if message[0] == "/auv/dvl" and message[2] > STEP_NS
        else message
        for message in messages
    ]
    measured, printed = imported(stepped_messages, tmp_path / "back")
    assert f"/auv/dvl: stamps step back by {back_s} s after message" in printed
    assert_same_but_for_one_step(measured, expected)


def test_stamps_that_step_forward_are_corrected_by_the_recorder_s_clock() -> None:
    true_ns = np.arange(200) * 10**8
    recorded_ns = true_ns + np.random.default_rng(1).integers(0, 5 * 10**7, 200)
    stamps_ns = true_ns + np.where(true_ns > 8 * 10**9, 5 * 10**9, 0)
    corrected = corrected_stamps(stamps_ns, recorded_ns)
    reported_step_s = re.search(r"step forward by (\S+) s after message 81", corrected.remarks[0])
    assert reported_step_s
    assert float(reported_step_s[1]) == pytest.approx(5.0, abs=0.03)
    # the median of twenty delays between 0 and 50 ms on either side
    np.testing.assert_allclose(corrected.time_ns, true_ns, rtol=0, atol=3e7)
    assert np.all(np.diff(corrected.time_ns) > 0)


def test_a_gap_in_a_bag_that_was_converted_is_no_step() -> None:
    """All its messages were recorded within a second."""
    stamps_ns = np.arange(100) * 10**8
    stamps_ns[50:] += 60 * 10**9
    recorded_ns = np.arange(100) * 10**6
    corrected = corrected_stamps(stamps_ns, recorded_ns)
    np.testing.assert_array_equal(corrected.time_ns, stamps_ns)
    assert corrected.remarks == []


def test_a_stalled_recorder_is_no_step_of_the_sensor_s_clock() -> None:
    stamps_ns = np.delete(np.arange(200) * 10**8, slice(100, 150))
    recorded_ns = stamps_ns + 2 * 10**7
    # the last message before the stall was written at its end
    recorded_ns[99] = recorded_ns[100] - 10**6
    corrected = corrected_stamps(stamps_ns, recorded_ns)
    np.testing.assert_array_equal(corrected.time_ns, stamps_ns)
