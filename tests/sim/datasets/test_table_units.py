"""Units of a vehicle's table: headers first, then physics, and otherwise a refusal."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim.datasets.vehicle_table import read_vehicle_table

HEADERS = {
    "time": "time [s]",
    "speed": "speed [m/s]",
    "heading": "heading_rad",
    "depth": "depth",
    "leader_timestamp": "leader_timestamp [s]",
    "leader_east": "leader_east",
    "leader_north": "leader_north",
    "leader_heading": "leader_heading_rad",
    "leader_speed": "leader_speed [m/s]",
    "leader_depth": "leader_depth",
    "range_rear": "range_rear",
}


def table(
    folder: Path,
    headers: Mapping[str, str],
    scales: Mapping[str, float],
    *,
    course_deg: float = 90.0,
    interval_s: float = 0.1,
    rows: int = 600,
    speed: float = 1.0,
    offset_s: float = 0.0,
) -> Path:
    """A vehicle and its leader on one course at one speed, 20 m apart at one depth; a message a
    second, or with each row where rows are further apart. `headers` replaces those of columns, by
    field; numbers are those of SI units times `scales`.
    """
    random = np.random.default_rng(2)
    course = math.radians(course_deg)
    names = {**HEADERS, **headers}
    lines = [",".join(names.values())]
    rows_per_message = max(1, round(1.0 / interval_s))
    for k in range(1, rows + 1):
        time = interval_s * k
        distance = speed * time
        cell_values = {
            "time": time + offset_s,
            "speed": speed * (1.0 + random.normal(0.0, 0.01)),
            "heading": course + random.normal(0.0, math.radians(0.3)),
            "depth": 8.0,
        }
        if k % rows_per_message == 0:
            cell_values |= {
                "leader_timestamp": time + offset_s,
                "leader_east": distance * math.sin(course) + 20.0 * math.cos(course),
                "leader_north": distance * math.cos(course) - 20.0 * math.sin(course),
                "leader_heading": course + random.normal(0.0, math.radians(0.3)),
                "leader_speed": speed,
                "leader_depth": 8.0,
                "range_rear": 20.0 + random.normal(0.0, 0.02),
            }
        cells = (
            f"{cell_values[name] * scales.get(name, 1.0):.10g}" if name in cell_values else ""
            for name in names
        )
        lines.append(",".join(cells))
    path = folder / "mine.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


DEGREES = 180.0 / math.pi
BARE_ANGLES = {"heading": "heading", "leader_heading": "leader_heading"}


@pytest.mark.parametrize(("course_deg", "unit"), [(2.0, "deg"), (8.0, "deg"), (8.0, "rad")])
def test_northern_courses_without_a_unit_are_those_that_the_leader_took(
    tmp_path: Path, course_deg: float, unit: str
) -> None:
    """A heading of 8 is 8° if the leader goes that way; a heading of 0.14 is then in radians."""
    scale = DEGREES if unit == "deg" else 1.0
    scales = {"heading": scale, "leader_heading": scale}
    read = read_vehicle_table(table(tmp_path, BARE_ANGLES, scales, course_deg=course_deg))
    assert f"heading: heading in {unit}" in read.remarks
    assert any(f"in {unit} by" in remark and "course" in remark for remark in read.remarks)
    for field in ("heading", "leader_heading"):
        mean = np.nanmean(read.columns[field])
        assert mean == pytest.approx(math.radians(course_deg), abs=math.radians(0.2))


def test_the_ranges_tell_the_unit_where_the_leader_heads_due_north(tmp_path: Path) -> None:
    """The leader's header states rad, and 3 of the vehicle may be either: read as radians, its
    heading of 3° ± 0.3° would scatter by 0.3 rad, which the ranges contradict.
    """
    headers = {"heading": "heading"}
    path = table(tmp_path, headers, {"heading": DEGREES}, course_deg=3.0)
    with pytest.raises(LaisnError, match=r"fits deg by .*leader_heading_rad is in rad.*\[deg\]"):
        read_vehicle_table(path)


@pytest.mark.parametrize("course_deg", [5.0, 90.0])
def test_a_column_takes_the_unit_that_another_states(tmp_path: Path, course_deg: float) -> None:
    headers = {"heading": "heading_deg", "leader_heading": "leader_heading"}
    scales = {"heading": DEGREES, "leader_heading": DEGREES}
    read = read_vehicle_table(table(tmp_path, headers, scales, course_deg=course_deg))
    leader = read.columns["leader_heading"]
    assert np.nanmean(leader) == pytest.approx(math.radians(course_deg), abs=0.01)


def test_a_header_that_the_course_contradicts_is_refused(tmp_path: Path) -> None:
    headers = {"heading": "heading_deg", "leader_heading": "leader_heading"}
    path = table(tmp_path, headers, {"heading": DEGREES}, course_deg=60.0)
    with pytest.raises(LaisnError, match=r"leader_heading .* fits rad .*heading_deg is in deg"):
        read_vehicle_table(path)


def test_knots_beside_a_bare_speed_in_metres_per_second_are_refused(tmp_path: Path) -> None:
    headers = {"speed": "speed [kn]", "leader_speed": "leader_speed"}
    path = table(tmp_path, headers, {"speed": 3600.0 / 1852.0})
    with pytest.raises(LaisnError, match=r"leader_speed .* fits m/s .*speed \[kn\] is in kn"):
        read_vehicle_table(path)


def test_angles_whose_unit_nothing_tells_are_refused_with_a_header_that_would(
    tmp_path: Path,
) -> None:
    """Nothing moves, and 3 may be radians or degrees."""
    scales = {"heading": DEGREES, "leader_heading": DEGREES}
    path = table(tmp_path, BARE_ANGLES, scales, course_deg=3.0, speed=0.0)
    with pytest.raises(LaisnError, match=r"heading, leader_heading .*'heading \[deg\]'"):
        read_vehicle_table(path)
    result = CliRunner().invoke(
        app, ["log", "import", str(path), "--out", str(tmp_path / "a.mcap")]
    )
    assert result.exit_code == 2
    assert not (tmp_path / "a.mcap").exists()


CLOCKS = {"time": "time", "leader_timestamp": "leader_timestamp"}


@pytest.mark.parametrize(
    ("interval_s", "scale", "unit"),
    [
        (6.0, 1.0, "s"),
        (0.1, 1e3, "ms"),
        (0.006, 1e3, "ms"),
        (2.0, 1e6, "us"),
        (0.1, 1e9, "ns"),
    ],
)
def test_bare_times_are_in_the_unit_that_speeds_fit(
    tmp_path: Path, interval_s: float, scale: float, unit: str
) -> None:
    scales = {"time": scale, "leader_timestamp": scale}
    rows = max(100, round(30.0 / interval_s))
    read = read_vehicle_table(table(tmp_path, CLOCKS, scales, interval_s=interval_s, rows=rows))
    assert read.remarks[0].startswith(f"time: time in {unit}, ")
    assert np.median(np.diff(read.time_ns)) == pytest.approx(1e9 * interval_s)
    received = np.isfinite(read.columns["range_rear"])
    sent = read.columns["leader_timestamp"][received]
    assert sent == pytest.approx(read.time_ns[received] / 1e9)


def stepped(path: Path, step: float, row: int) -> Path:
    """A table whose recorder's clock, the first column, steps before a row, counted from 1."""
    header, *lines = path.read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines]
    for cells in rows[row - 1 :]:
        cells[0] = f"{float(cells[0]) + step:.15g}"
    path.write_text("\n".join([header, *map(",".join, rows)]), encoding="utf-8")
    return path


@pytest.mark.parametrize("step_s", [600.0, 1800.0, 3600.0, 86_400.0, 31_536_000.0, -3600.0])
@pytest.mark.parametrize(("scale", "unit"), [(1.0, "s"), (1e3, "ms"), (1.0 / 86_400.0, "days")])
def test_the_unit_of_bare_times_does_not_follow_from_steps_of_the_clock(
    tmp_path: Path, step_s: float, scale: float, unit: str
) -> None:
    """The table is that without the step: 600 rows 0.1 s apart."""
    scales = dict.fromkeys(CLOCKS, scale)
    path = stepped(table(tmp_path, CLOCKS, scales), step_s * scale, row=303)
    read = read_vehicle_table(path)
    assert read.remarks[0] == f"time: time in {unit}, 59.9 s"
    assert np.diff(read.time_ns) / 1e9 == pytest.approx(0.1, abs=1e-3)
    assert not any("leader_speed: a current" in remark for remark in read.remarks)


def test_a_step_of_the_clock_is_no_current_where_headers_state_the_units(tmp_path: Path) -> None:
    read = read_vehicle_table(stepped(table(tmp_path, {}, {}), 3600.0, row=303))
    assert not any("leader_speed" in remark and "times that" in remark for remark in read.remarks)


def test_a_step_among_pauses_between_bursts_does_not_tell_the_unit(tmp_path: Path) -> None:
    """A pause of 2 s after every 20 rows, and an hour's step in one of them."""
    path = table(tmp_path, CLOCKS, {"time": 1.0}, rows=600)
    for row in range(21, 600, 20):
        stepped(path, 3600.0 if row == 301 else 2.0, row)
    assert read_vehicle_table(path).remarks[0].startswith("time: time in s, ")


def test_times_before_1970_are_refused_unless_a_step_explains_them(tmp_path: Path) -> None:
    path = stepped(table(tmp_path, {}, {}), -1000.0, row=1)
    with pytest.raises(LaisnError, match=r"column time \[s\], row 1: times before 1970"):
        read_vehicle_table(path)


def test_a_clock_since_the_start_of_a_computer_is_no_date(tmp_path: Path) -> None:
    """Three days in nanoseconds are as large a number as 1978 in microseconds."""
    scales = {"time": 1e9, "leader_timestamp": 1e9}
    path = table(tmp_path, CLOCKS, scales, offset_s=259_200.0, speed=0.0)
    assert np.ptp(read_vehicle_table(path).time_ns) == pytest.approx(59.9e9)


def test_a_date_in_another_unit_than_the_leaders_clock_is_refused(tmp_path: Path) -> None:
    headers = {"time": "time", "leader_timestamp": "leader_timestamp [ns]"}
    scales = {"time": 1e6, "leader_timestamp": 1e9}
    # 15 rows have one reception, which tells nothing of intervals
    path = table(tmp_path, headers, scales, offset_s=1.7e9, rows=15)
    with pytest.raises(LaisnError, match=r"time without a unit may be in .*us.*'time \[.*us\]'"):
        read_vehicle_table(path)


def test_unusual_intervals_in_the_unit_of_the_leaders_clock_are_refused(tmp_path: Path) -> None:
    """Rows every 0.2 s in microseconds would be 0.2 ms apart in the clock's nanoseconds."""
    headers = {"time": "time", "leader_timestamp": "leader_timestamp [ns]"}
    scales = {"time": 1e6, "leader_timestamp": 1e9}
    # 8 rows have one reception, which tells nothing of intervals
    path = table(tmp_path, headers, scales, interval_s=0.2, rows=8)
    with pytest.raises(LaisnError, match=r"time without a unit may be in .*us.*'time \[.*us\]'"):
        read_vehicle_table(path)
    scales["time"] = 1e9
    read = read_vehicle_table(table(tmp_path, headers, scales, interval_s=0.2, rows=40))
    assert np.median(np.diff(read.time_ns)) == pytest.approx(2e8)


def test_a_time_that_fits_in_no_unit_is_refused(tmp_path: Path) -> None:
    """The leader's way says seconds, its clock milliseconds."""
    headers = {"time": "time", "leader_timestamp": "leader_timestamp [ms]"}
    path = table(tmp_path, headers, {})
    with pytest.raises(LaisnError, match=r"time without a unit: in none of s, ms they fit .*clock"):
        read_vehicle_table(path)


BARE_SPEEDS = {"speed": "speed", "leader_speed": "leader_speed"}
LENGTHS = ("depth", "leader_east", "leader_north", "leader_depth", "range_rear")
# headers, factors of numbers, and words of the error
CONTRADICTED_UNITS = {
    "both speeds in km/h": (BARE_SPEEDS, dict.fromkeys(BARE_SPEEDS, 3.6), r"'speed \[km/h\]'"),
    "own speed in cm/s": (BARE_SPEEDS, {"speed": 100.0}, r"'speed \[cm/s\]' or 'speed \[m/s\]'"),
    "leader in m/s beside a vehicle in mm/s": (
        {"speed": "speed [mm/s]", "leader_speed": "leader_speed"},
        {"speed": 1000.0},
        r"'leader_speed \[m/s\]'",
    ),
    "lengths in feet": ({}, dict.fromkeys(LENGTHS, 1.0 / 0.3048), r"'depth \[ft\]'"),
    "lengths in millimetres beside bare milliseconds": (
        CLOCKS,
        dict.fromkeys(LENGTHS, 1e3) | dict.fromkeys(CLOCKS, 1e3),
        r"in m and time in s, but in mm and time in ms .*'depth \[mm\]'",
    ),
    "one heading in degrees, one in radians": (
        BARE_ANGLES,
        {"heading": DEGREES},
        r"'leader_heading \[rad\]'",
    ),
}


@pytest.mark.parametrize("case", CONTRADICTED_UNITS)
def test_other_units_than_headers_without_a_unit_stand_for_are_refused(
    tmp_path: Path, case: str
) -> None:
    """Headers without a unit stand for SI units here, which the leader's track or the ranges
    contradict.
    """
    headers, scales, words = CONTRADICTED_UNITS[case]
    with pytest.raises(LaisnError, match=words):
        read_vehicle_table(table(tmp_path, headers, scales, course_deg=40.0))


def test_knots_without_a_unit_are_remarked_on(tmp_path: Path) -> None:
    """A current explains them as well."""
    scales = dict.fromkeys(BARE_SPEEDS, 3600.0 / 1852.0)
    read = read_vehicle_table(table(tmp_path, BARE_SPEEDS, scales))
    assert any("way is 0.51 times that at leader_speed" in remark for remark in read.remarks)
    read = read_vehicle_table(table(tmp_path, BARE_SPEEDS, {}))
    assert not any("leader_speed: a current" in remark for remark in read.remarks)


def test_rows_every_six_seconds_of_a_vehicle_at_rest_are_refused(tmp_path: Path) -> None:
    path = table(tmp_path, CLOCKS, {}, interval_s=6.0, rows=50, speed=0.0)
    with pytest.raises(LaisnError, match=r"time without a unit .*'time \[s\]'"):
        read_vehicle_table(path)


@pytest.mark.parametrize("time", ["time [s]", "time"])
def test_a_leaders_clock_in_another_unit_than_the_rows_is_refused(
    tmp_path: Path, time: str
) -> None:
    headers = {"time": time, "leader_timestamp": "leader_timestamp"}
    path = table(tmp_path, headers, {"leader_timestamp": 1e3})
    with pytest.raises(LaisnError, match=r"leader_timestamp: counts ms .*stamp \[ms\]'"):
        read_vehicle_table(path)


@pytest.mark.parametrize("header", ["leader_timestamp", "leader_timestamp [ms]"])
def test_milliseconds_since_1970_of_the_leader_are_read(tmp_path: Path, header: str) -> None:
    """The bound on times holds in seconds: 1.7e12 ms are a date."""
    headers = {"leader_timestamp": header}
    scales = {"leader_timestamp": 1e3}
    read = read_vehicle_table(table(tmp_path, headers, scales, offset_s=1.7e9))
    sent = read.columns["leader_timestamp"]
    assert np.nanmin(sent) == pytest.approx(1.7e9 + 1.0)
    assert np.nanmax(np.diff(sent[np.isfinite(sent)])) == pytest.approx(1.0, abs=1e-3)


def test_a_time_beyond_the_bound_in_its_unit_is_refused(tmp_path: Path) -> None:
    headers = {"leader_timestamp": "leader_timestamp [s]"}
    path = table(tmp_path, headers, {"leader_timestamp": 1e3}, offset_s=1.7e9)
    with pytest.raises(LaisnError, match=r"leader_timestamp \[s\]: in s, values are not within"):
        read_vehicle_table(path)


def test_a_length_beyond_the_bound_in_its_unit_is_refused_with_the_bound_in_metres(
    tmp_path: Path,
) -> None:
    lengths = ("depth", "leader_east", "leader_north", "leader_depth")
    headers = {name: f"{name} [m]" for name in lengths} | {"range_rear": "range_rear [km]"}
    path = table(tmp_path, headers, {"range_rear": 1e6})
    message = r"range_rear \[km\]: in km, values are not within ±4e\+09 m$"
    with pytest.raises(LaisnError, match=message):
        read_vehicle_table(path)


def test_a_time_of_rows_beyond_the_bound_in_its_unit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LaisnError, match=r"time \[s\]: in s, times are not within ±4e\+09 s"):
        read_vehicle_table(table(tmp_path, {}, {"time": 1e3}, offset_s=1.7e9))


@pytest.mark.parametrize(
    ("headers", "words"),
    [
        ({"speed": "heading [deg]"}, r"columns 'heading \[deg\]' and 'heading_rad' both hold"),
        ({"speed": "timestamp"}, r"columns 'time \[s\]' and 'timestamp' both hold time"),
        ({"depth": "leader_depth_cm"}, "columns 'leader_depth_cm' and 'leader_depth' both hold"),
        ({"heading": "heading [grad]"}, r"unknown unit 'grad' .*expected rad, deg"),
        ({"range_rear": "range_rear [cm]"}, r"leader_east.* fits m by .*\[cm\] is in cm"),
    ],
)
def test_headers_in_doubt_are_refused(tmp_path: Path, headers: dict[str, str], words: str) -> None:
    with pytest.raises(LaisnError, match=words):
        read_vehicle_table(table(tmp_path, headers, {}))


@pytest.mark.parametrize("field", ["depth", "leader_depth"])
def test_heights_are_no_depths(tmp_path: Path, field: str) -> None:
    path = table(tmp_path, {}, {field: -1.0})
    with pytest.raises(LaisnError, match=rf"column {field}, row \d+: a depth of -8 m .*sign"):
        read_vehicle_table(path)


def test_cells_and_quotes_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    path = table(tmp_path, {}, {})
    lines = path.read_text(encoding="utf-8").splitlines()
    for number, broken_line, words in (
        (0, f'{lines[0]},"', r"mine\.csv: the header 'time.*quote not closed"),
        (7, f'"{lines[7]}', r"mine\.csv, row 7: .*quote not closed"),
        (7, f"{'9' * 140_000}{lines[7]}", r"mine\.csv, row 7: .*131072"),
    ):
        broken_lines = [*lines[:number], broken_line, *lines[number + 1 :]]
        path.write_text("\n".join(broken_lines), encoding="utf-8")
        with pytest.raises(LaisnError, match=words):
            read_vehicle_table(path)
