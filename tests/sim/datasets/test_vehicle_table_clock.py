"""The clock of a vehicle's table: steps, gaps, order, and receptions that were written late.

A vehicle and its leader go east at 1 m/s, 20 m apart: where the leader is tells the true time.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from laisn.errors import LaisnError
from sim.datasets.field_map import read_map
from sim.datasets.log import write_vehicle_table
from sim.datasets.vehicle_table import VehicleTable, read_vehicle_table
from sim.log.reader import read_recording

HEADER = (
    "time [s],speed [m/s],heading_deg,depth,leader_timestamp [s],leader_east,leader_north,"
    "leader_heading_deg,leader_speed,leader_depth,range_rear"
)
TRAVEL_S = 20.0 / 1500.0
Clock = Callable[[float], float]


def true_time(time: float) -> float:
    return time


def table_lines(
    own_clock: Clock = true_time,
    leader_clock: Clock = true_time,
    *,
    left_out: tuple[int, int] = (0, 0),
) -> list[str]:
    """100 s at 10 Hz with a message a second, dated by two clocks, which are functions of the true
    time [s]; rows of a range of numbers are left out. The leader's east [m] is the true time [s].
    """
    lines = []
    for k in range(1, 1001):
        time = 0.1 * k
        message = f"{leader_clock(time):.3f},{time:.3f},20,90,1,8,20" if k % 10 == 0 else ",,,,,,"
        if not left_out[0] <= k < left_out[1]:
            lines.append(f"{own_clock(time):.3f},1,90,8,{message}")
    return lines


def read(folder: Path, lines: list[str], header: str = HEADER) -> VehicleTable:
    path = folder / "mine.csv"
    path.write_text("\n".join([header, *lines]), encoding="utf-8")
    return read_vehicle_table(path)


def reception_and_emission_times(table: VehicleTable) -> tuple[np.ndarray, np.ndarray]:
    """Time of each reception as read, the first row's being 0.1 s, and true time of its emission by
    the leader's east [s].
    """
    is_received = np.isfinite(table.columns["range_rear"])
    reception_time = (table.reception_ns[is_received] - table.time_ns[0]) / 1e9 + 0.1
    return reception_time, table.columns["leader_east"][is_received]


def stepped(step: float, step_time: float = 60.0) -> Clock:
    """A clock that is 40 s ahead, and steps by a number of seconds after a true time [s]."""
    return lambda time: 40.0 + time + (step if time > step_time + 0.05 else 0.0)


@pytest.mark.parametrize("step", [-30.03, -0.35])
@pytest.mark.parametrize("leader_too", [True, False])
def test_a_clock_that_steps_back_is_corrected(
    tmp_path: Path, step: float, leader_too: bool
) -> None:
    table = read(
        tmp_path, table_lines(stepped(step), stepped(step) if leader_too else stepped(0.0))
    )
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time, abs=1e-6)
    assert np.diff(table.time_ns) == pytest.approx(np.full(999, 1e8))
    clocks = "time [s] and the leader's clock step" if leader_too else "time [s] steps"
    start = f"{clocks} back by {-step:g} s after row 600, 59.9 s after the first; later rows"
    assert [remark for remark in table.remarks if remark.startswith(start)], table.remarks
    sent = table.columns["leader_timestamp"][np.isfinite(table.columns["range_rear"])]
    assert sent == pytest.approx(40.0 + emission_time)


def test_a_clock_that_steps_back_before_the_first_row_is_corrected(tmp_path: Path) -> None:
    """The clock steps 300 s back to before the first row: no time comes twice."""
    table = read(
        tmp_path, table_lines(lambda time: 500.0 + time - (300.0 if time > 60.05 else 0.0))
    )
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time, abs=1e-6)
    assert np.diff(table.time_ns) == pytest.approx(np.full(999, 1e8))


def test_an_outage_at_a_step_back_lasts_as_long_as_the_leaders_clock_says(tmp_path: Path) -> None:
    """12 s without rows, after which the clock is 50 s behind."""
    table = read(tmp_path, table_lines(stepped(-50.0), stepped(0.0), left_out=(601, 721)))
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time, abs=1e-6)
    assert any("so that 12.1 s lie between" in remark for remark in table.remarks)


@pytest.mark.parametrize("leader_too", [True, False])
def test_a_clock_that_steps_forward_is_corrected_by_the_leader(
    tmp_path: Path, leader_too: bool
) -> None:
    table = read(
        tmp_path, table_lines(stepped(25.0), stepped(25.0) if leader_too else stepped(0.0))
    )
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time, abs=1e-6)
    evidence = "way" if leader_too else "clock"
    words = f"time [s] steps forward by 25 s after row 600 by the leader's {evidence}; later rows"
    assert any(remark.startswith(words) for remark in table.remarks), table.remarks


def test_a_gap_is_reported_and_stays(tmp_path: Path) -> None:
    table = read(tmp_path, table_lines(left_out=(301, 751)))
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time, abs=1e-6)
    assert "time [s]: gaps without own measurements: 45.1 s after row 300" in table.remarks


def test_rows_out_of_order_that_fill_a_gap_are_sorted(tmp_path: Path) -> None:
    lines = table_lines()
    lines[200], lines[201] = lines[201], lines[200]
    # a packet of 30 rows that came late
    lines[500:560] = [*lines[530:560], *lines[500:530]]
    table = read(tmp_path, lines)
    assert np.diff(table.time_ns) == pytest.approx(np.full(999, 1e8))
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time)
    assert "time [s]: rows out of order in 2 places, sorted" in table.remarks


def test_two_streams_behind_each_other_are_merged(tmp_path: Path) -> None:
    own_lines = [f"{','.join(line.split(',')[:4])},,,,,,," for line in table_lines()]
    message_lines = [
        f"{line.split(',')[0]},,,,{line.split(',', 4)[4]}" for line in table_lines()[9::10]
    ]
    table = read(tmp_path, [*own_lines, *message_lines])
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time)
    assert not any("back" in remark or "order" in remark for remark in table.remarks)
    # messages whose clock steps back within their stream
    with pytest.raises(LaisnError, match="the time of receptions steps back after row 1060"):
        read(tmp_path, [*own_lines, *message_lines[:60], *message_lines[20:]])


def test_times_in_no_order_are_refused(tmp_path: Path) -> None:
    lines = table_lines()
    np.random.default_rng(1).shuffle(lines)
    with pytest.raises(LaisnError, match=r"steps back \d+ times, first after row \d+"):
        read(tmp_path, lines)


def test_receptions_that_were_written_late_are_dated_by_the_leaders_clock(tmp_path: Path) -> None:
    table = read(tmp_path, table_lines(lambda time: time + 10.0, lambda time: time + 8.0))
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time - 2.0 + TRAVEL_S, abs=1e-3)
    words = "100 of 100 receptions are older than sound needs, by 1.99 s (median)"
    assert any(remark.startswith(words) for remark in table.remarks), table.remarks
    write_vehicle_table(table, tmp_path / "late.mcap")
    measured = read_recording(tmp_path / "late.mcap").measurements
    # the first is older than the first step, and the second was received within it
    assert measured.message[:, 1] == pytest.approx(np.arange(2.0, 101.0))
    assert measured.message_step.tolist() == [1, *range(11, 982, 10)]


def test_receptions_that_are_older_than_sound_needs_between_slow_rows_are_remarked_on(
    tmp_path: Path,
) -> None:
    """Rows every 5 s, written up to 5 s after what they hold."""
    slow = table_lines(lambda time: time + 10.0, lambda time: time + 8.0)[49::50]
    table = read(tmp_path, slow)
    assert table.reception_ns.tolist() == table.time_ns.tolist()
    words = "receptions are older than sound needs by 1.99 s (median), less than rows lie apart"
    assert any(remark.startswith(words) for remark in table.remarks), table.remarks


@pytest.mark.parametrize("difference", [-3.0, 500.0, 1.7e9])
def test_another_clock_of_the_leader_is_reported_and_not_used(
    tmp_path: Path, difference: float
) -> None:
    table = read(tmp_path, table_lines(leader_clock=lambda time: time - difference))
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time)
    assert any("another clock; receptions have the times" in remark for remark in table.remarks)


def test_receptions_on_time_are_not_changed(tmp_path: Path) -> None:
    table = read(tmp_path, table_lines())
    assert table.reception_ns.tolist() == table.time_ns.tolist()
    assert len(table.remarks) == HEADER.count(",") + 1


def noisy_lines() -> list[str]:
    """As `table_lines`, with speeds that no two rows have in common."""
    return [line.replace(",1,", f",{1 + 1e-4 * k:.4f},", 1) for k, line in enumerate(table_lines())]


@pytest.mark.parametrize(
    ("recorded", "repeated"),
    [
        # the end of one recording is the beginning of the next
        (lambda lines: [*lines[:500], *lines[480:]], (501, 20)),
        # the first lost rows that the second has
        (lambda lines: [*lines[:485], *lines[490:500], *lines[480:]], (496, 15)),
        # all of it again, and each row twice
        (lambda lines: [*lines, *lines], (1001, 1000)),
        (lambda lines: [line for line in lines for _ in range(2)], (2, 1000)),
    ],
)
def test_repeated_rows_are_left_out(
    tmp_path: Path,
    recorded: Callable[[list[str]], list[str]],
    repeated: tuple[int, int],
) -> None:
    """What is read is what one recording without repetitions holds."""
    table = read(tmp_path, recorded(noisy_lines()))
    once = read(tmp_path, noisy_lines())
    np.testing.assert_array_equal(table.time_ns, once.time_ns)
    np.testing.assert_array_equal(table.reception_ns, once.reception_ns)
    for field, values in once.columns.items():
        np.testing.assert_array_equal(table.columns[field], values)
    (remark,) = (remark for remark in table.remarks if "repeat" in remark)
    first, count = repeated
    assert remark == f"{count} rows repeat earlier ones wholly, first row {first}: left out"
    assert not any("steps back" in remark for remark in table.remarks)


def test_rows_alike_after_a_step_back_are_no_repetition(tmp_path: Path) -> None:
    """Own motion is constant, and the clock is set back by 30 s to times that earlier rows have:
    messages tell that they are others.
    """
    table = read(tmp_path, table_lines(stepped(-30.0), stepped(-30.0)))
    reception_time, emission_time = reception_and_emission_times(table)
    assert reception_time == pytest.approx(emission_time, abs=1e-6)
    assert table.time_ns.size == 1000


def test_remarks_after_repeated_rows_count_all_rows(tmp_path: Path) -> None:
    """The gap is after row 620 of the file, which is the 600th without the repeated ones."""
    lines = noisy_lines()
    table = read(tmp_path, [*lines[:500], *lines[480:600], *lines[650:]])
    assert any("5.1 s after row 620" in remark for remark in table.remarks), table.remarks


def dated(seconds: str) -> str:
    """Seconds since a noon as a date, with an offset of an hour from UTC."""
    return f"2024-05-01T13:{float(seconds) // 60:02.0f}:{float(seconds) % 60:06.3f}+01:00"


MAP_OF_DATES = """
time = {column = "clock"}
speed = {column = "v", unit = "m/s"}
heading = {column = "h", unit = "deg"}
depth = {column = "d", unit = "m"}
leader_timestamp = {column = "sent"}
leader_east = {column = "e", unit = "m"}
leader_north = {column = "n", unit = "m"}
leader_heading = {column = "c", unit = "deg"}
leader_speed = {column = "s", unit = "m/s"}
leader_depth = {column = "b", unit = "m"}
range_rear = {column = "r", unit = "m"}
"""


@pytest.mark.parametrize("by_map", [False, True])
def test_the_leaders_clock_may_be_dates(tmp_path: Path, by_map: bool) -> None:
    """Messages are sent 1.5 s before they are written: both clocks are the same, so that they count
    from then and the travel time.
    """
    lines = []
    for line in table_lines(leader_clock=lambda time: time - 1.5):
        cells = line.split(",")
        cells[0] = dated(str(float(cells[0]) + 60.0))
        cells[4] = cells[4] and dated(str(float(cells[4]) + 60.0))
        lines.append(",".join(cells))
    header = HEADER.replace(" [s]", "")
    if by_map:
        header = "clock,v,h,d,sent,e,n,c,s,b,r"
        (tmp_path / "map.toml").write_text(MAP_OF_DATES, encoding="utf-8")
    path = tmp_path / "mine.csv"
    path.write_text("\n".join([header, *lines]), encoding="utf-8")
    table = read_vehicle_table(path, read_map(tmp_path / "map.toml") if by_map else None)
    is_received = np.isfinite(table.columns["range_rear"])
    # noon is 1714564800 s after 1970 began; the first message is written 61 s later
    sent = 1714564800.0 + 59.5 + np.arange(100)
    np.testing.assert_allclose(table.columns["leader_timestamp"][is_received], sent, atol=1e-5)
    received = table.reception_ns[is_received] / 1e9
    np.testing.assert_allclose(received, sent + TRAVEL_S, rtol=0, atol=1e-5)
    assert any("leader_timestamp in dates (UTC)" in remark for remark in table.remarks)


def test_a_leaders_clock_that_is_neither_number_nor_date_is_named(tmp_path: Path) -> None:
    lines = table_lines()
    lines[9] = lines[9].replace(",1.000,", ",noon,", 1)
    with pytest.raises(
        LaisnError, match=r"column leader_timestamp \[s\], row 10: .*; expected numbers or dates"
    ):
        read(tmp_path, lines)
