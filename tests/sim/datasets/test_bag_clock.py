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
    range_messages,
    run,
    told,
)

STEP_NS = START_NS + 8 * 10**9 + 50_000_000
TEXT = (MAP + LEADER + RANGE).replace('stamps = "log"', "")


def shifted(message: Message, back_s: int, *, recorder: bool, stamps: bool) -> Message:
    """A message by clocks that are set back."""
    topic, kind, at, values = message
    header = values.get("header")
    if stamps and header:
        seconds = header["stamp"]["sec"] - back_s
        header = {**header, "stamp": {**header["stamp"], "sec": seconds}}
        values = {**values, "header": header}
    return topic, kind, at - 10**9 * back_s * recorder, values


def imported(messages: list[Message], folder: Path, write: Any = write_ros2) -> tuple[Any, str]:
    """Measurements of a bag, and what the command told."""
    folder.mkdir()
    (folder / "map.toml").write_text(TEXT)
    bag = write(folder / ("dive.bag" if write is write_ros1 else "dive"), messages)
    out = folder / "dive.mcap"
    result = run("import", bag, "--map", folder / "map.toml", "--out", out)
    assert result.exit_code == 0, result.output
    return read_recording(out).measurements, told(result)


def whole() -> list[Message]:
    return in_order(own_messages(), leader_messages(), range_messages())


def assert_same_but_one_step(measured: Any, expected: Any) -> None:
    """The time across the step is only known to an interval."""
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
    messages = whole()
    expected, _ = imported(messages, tmp_path / "steady", write)
    back = [
        shifted(message, back_s, recorder=True, stamps=stamps) if message[2] > STEP_NS else message
        for message in messages
    ]
    measured, text = imported(back, tmp_path / "back", write)
    told_s = re.search(r"the recorder.s clock steps back by (\S+) s after message", text)
    assert told_s
    assert float(told_s[1]) == pytest.approx(back_s, abs=0.05)
    assert_same_but_one_step(measured, expected)


@pytest.mark.parametrize("back_s", [30, 3])
def test_a_sensor_whose_clock_is_set_back_is_corrected_by_the_recorder_s(
    tmp_path: Path, back_s: int
) -> None:
    messages = whole()
    expected, _ = imported(messages, tmp_path / "steady")
    back = [
        shifted(message, back_s, recorder=False, stamps=True)
        if message[0] == "/auv/dvl" and message[2] > STEP_NS
        else message
        for message in messages
    ]
    measured, text = imported(back, tmp_path / "back")
    assert f"/auv/dvl: stamps step back by {back_s} s after message" in text
    assert_same_but_one_step(measured, expected)


def test_stamps_that_step_forward_are_corrected_by_the_recorder_s_clock() -> None:
    true = np.arange(200) * 10**8
    recorded = true + np.random.default_rng(1).integers(0, 5 * 10**7, 200)
    stamps = true + np.where(true > 8 * 10**9, 5 * 10**9, 0)
    corrected = corrected_stamps(stamps, recorded)
    told_s = re.search(r"step forward by (\S+) s after message 81", corrected.remarks[0])
    assert told_s
    assert float(told_s[1]) == pytest.approx(5.0, abs=0.03)
    # the median of twenty delays between 0 and 50 ms on either side
    np.testing.assert_allclose(corrected.time_ns, true, rtol=0, atol=3e7)
    assert np.all(np.diff(corrected.time_ns) > 0)


def test_a_gap_in_a_bag_that_was_converted_is_no_step() -> None:
    """All its messages were recorded within a second."""
    stamps = np.arange(100) * 10**8
    stamps[50:] += 60 * 10**9
    recorded = np.arange(100) * 10**6
    corrected = corrected_stamps(stamps, recorded)
    np.testing.assert_array_equal(corrected.time_ns, stamps)
    assert corrected.remarks == []


def test_a_stalled_recorder_is_no_step_of_the_sensor_s_clock() -> None:
    stamps = np.delete(np.arange(200) * 10**8, slice(100, 150))
    recorded = stamps + 2 * 10**7
    # the last message before the stall was written at its end
    recorded[99] = recorded[100] - 10**6
    corrected = corrected_stamps(stamps, recorded)
    np.testing.assert_array_equal(corrected.time_ns, stamps)
