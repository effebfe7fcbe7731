"""The stopwatch of a flight: wall clock and processor time of each phase."""

import subprocess
import sys
import time

import pytest

from experiments.flight.fly import Stopwatch


def test_waiting_takes_time_by_the_clock_and_none_of_the_processor() -> None:
    watch = Stopwatch()
    for _ in range(2):
        with watch.phase("wait"):
            time.sleep(0.1)
    assert set(watch) == {"wait_s", "wait_processor_s"}
    assert watch["wait_s"] >= 0.2
    assert watch["wait_processor_s"] < 0.1


def test_the_work_of_children_that_have_ended_counts() -> None:
    watch = Stopwatch()
    program = "import time\nwhile time.process_time() < 0.2: pass"
    with watch.phase("work"):
        subprocess.run([sys.executable, "-c", program], check=True)
    assert watch["work_processor_s"] >= 0.2


def test_a_phase_that_fails_is_counted() -> None:
    watch = Stopwatch()
    with pytest.raises(ValueError, match="over"), watch.phase("short"):
        raise ValueError("over")
    watch.add("short", 1.0, 2.0)
    assert watch["short_s"] >= 1.0
    assert watch["short_processor_s"] >= 2.0
