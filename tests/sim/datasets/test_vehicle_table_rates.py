"""Tables whose sensors have rates of their own: the fastest of own motion gives the filter steps.

The vehicle's speed and heading change linearly, so that interpolation is exact.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from laisn.errors import LaisnError
from laisn.messages import Measurements
from sim.datasets.log import write_vehicle_table
from sim.datasets.vehicle_table import read_vehicle_table
from sim.log.reader import read_recording

ROWS = 400
HEADER = (
    "time [s],speed [m/s],heading_deg,depth [m],leader_east,leader_north,leader_heading_deg,"
    "leader_speed,leader_depth,range_rear"
)
Has = Callable[[int], bool]


def speed_at(time: float) -> float:
    return 1.0 + 0.01 * time


def heading_deg_at(time: float) -> float:
    """Passes north after 10 s."""
    return (355.0 + 0.5 * time) % 360.0


def depth_at(time: float) -> float:
    return 8.0 + 0.05 * time


def always(_: int) -> bool:
    return True


def measured(
    folder: Path, *, speed: Has = always, heading: Has = always, depth: Has = always
) -> tuple[Measurements, tuple[str, ...]]:
    """A table of 40 s at 10 Hz with a message a second, whose rows have what the functions of their
    number say; as a log that is read back, and remarks of the import.
    """
    lines = [HEADER]
    for k in range(1, ROWS + 1):
        time = k / 10
        cells = [
            f"{value:.6f}" if has(k) else ""
            for has, value in (
                (speed, speed_at(time)),
                (heading, heading_deg_at(time)),
                (depth, depth_at(time)),
            )
        ]
        message = f"{time:.1f},20,90,1,8,20" if k % 10 == 0 else ",,,,,"
        lines.append(f"{time:.1f},{','.join(cells)},{message}")
    path = folder / "mine.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    table = read_vehicle_table(path)
    write_vehicle_table(table, folder / "mine.mcap")
    return read_recording(folder / "mine.mcap").measurements, table.remarks


def test_a_depth_of_a_lower_rate_leaves_the_steps_of_the_others(tmp_path: Path) -> None:
    got, remarks = measured(tmp_path, depth=lambda k: k % 10 == 5)
    times = np.arange(1, ROWS + 1) / 10
    np.testing.assert_allclose(got.speed, speed_at(times), atol=1e-6)
    assert got.dt == 0.1
    assert got.durations is None
    assert got.message_step.tolist() == list(range(10, ROWS + 1, 10))
    has_depth = np.arange(1, ROWS + 1) % 10 == 5
    np.testing.assert_allclose(got.depth[has_depth], depth_at(times[has_depth]), atol=1e-6)
    assert np.isnan(got.depth[~has_depth]).all()
    assert "depth [m]: absent at 360 of 400 filter steps, the last one counts" in remarks


def test_ten_seconds_without_depth_are_no_gap(tmp_path: Path) -> None:
    got, remarks = measured(tmp_path, depth=lambda k: not 100 < k <= 250)
    assert got.durations is None
    assert got.speed.size == ROWS
    assert not any("gap" in remark for remark in remarks)
    np.testing.assert_allclose(got.last_depth[100:250], depth_at(10.0))


@pytest.mark.parametrize("slow", ["speed", "heading"])
def test_speed_and_heading_of_a_lower_rate_are_interpolated(tmp_path: Path, slow: str) -> None:
    """Those before the first reading, and after the last, are left out."""
    got, remarks = measured(tmp_path, **{slow: lambda k: k % 5 == 3})
    times = np.arange(3, 399) / 10
    np.testing.assert_allclose(got.speed, speed_at(times), atol=1e-6)
    np.testing.assert_allclose(np.degrees(got.heading), heading_deg_at(times), atol=1e-6)
    assert any(
        remark.endswith("absent at 316 of 400 filter steps, interpolated") for remark in remarks
    )
    assert any("at 4 of 400 filter steps, in gaps or at an end: left out" in r for r in remarks)


def test_sensors_with_rows_of_their_own_are_brought_together(tmp_path: Path) -> None:
    """Speed in even rows, heading and depth in every fourth, which are odd."""
    got, _ = measured(
        tmp_path,
        speed=lambda k: k % 2 == 0,
        heading=lambda k: k % 4 == 1,
        depth=lambda k: k % 4 == 3,
    )
    # the last heading is that of row 397
    times = np.arange(2, 397, 2) / 10
    np.testing.assert_allclose(got.speed, speed_at(times), atol=1e-6)
    np.testing.assert_allclose(np.degrees(got.heading), heading_deg_at(times), atol=1e-6)
    # a depth is that of the next step, 0.1 s later
    is_after = np.arange(2, 397, 2) % 4 == 0
    np.testing.assert_allclose(got.depth[is_after], depth_at(times[is_after] - 0.1), atol=1e-6)
    assert np.isnan(got.depth[~is_after]).all()


def test_a_silent_compass_is_a_gap(tmp_path: Path) -> None:
    """Nothing is interpolated over 8 s: a step that lasts as long bridges them."""
    got, remarks = measured(tmp_path, heading=lambda k: not 100 < k < 180)
    assert got.durations is not None
    assert got.durations.max() == pytest.approx(8.0)
    assert got.speed.size == ROWS - 79
    assert (
        "heading_deg: absent at 79 of 400 filter steps, in gaps or at an end: left out" in remarks
    )


def test_speed_and_heading_that_never_meet_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LaisnError, match=r"speed \[m/s\] and heading_deg are never known at the"):
        measured(tmp_path, speed=lambda k: k < 100, heading=lambda k: k > 200)
    with pytest.raises(LaisnError, match=r"mine\.csv: all cells of depth \[m\] are empty"):
        measured(tmp_path, depth=lambda k: False)
