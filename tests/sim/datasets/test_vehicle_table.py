"""A vehicle's table of measurements: what is taken for what, and that the log holds it."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim.datasets.log import write_vehicle_table
from sim.datasets.vehicle_table import read_vehicle_table
from sim.log.reader import read_recording

LEADER = (
    "leader_east,leader_north,leader_heading_deg,leader_speed,leader_depth,range_rear,range_front"
)


def table(
    folder: Path, *, delimiter: str = ",", start: float = 5.0, unit: str = "", scale: float = 1.0
) -> Path:
    """20 s at 10 Hz with jitter, heading 90°; a reception every second; with a byte order mark.
    Times in the table are those in s times `scale`, under the header time and `unit`.
    """
    random = np.random.default_rng(3)
    lines = [f"time{unit},speed [kn],heading_deg,depth,note,{LEADER}"]
    for k in range(200):
        time_s = start + 0.1 * k + random.uniform(-0.02, 0.02)
        reception_cells = f"{k},20.0,45,1.5,8.0,30.5,31.5" if k % 10 == 9 else ",,,,,,"
        lines.append(
            f"{time_s * scale:.9g},2,90.0,5.0,x,{reception_cells}"
            if scale == 1.0
            else f"{time_s * scale:.0f},2,90.0,5.0,x,{reception_cells}"
        )
    path = folder / "mine.csv"
    path.write_text("\n".join(lines).replace(",", delimiter), encoding="utf-8-sig")
    return path


@pytest.mark.parametrize(
    ("options", "clock_unit"),
    [
        ({}, "s"),
        ({"delimiter": ";"}, "s"),
        ({"delimiter": "\t"}, "s"),
        ({"delimiter": "|"}, "s"),
        ({"unit": "_ms", "scale": 1e3}, "ms"),
        ({"scale": 1e3}, "ms"),
        ({"start": 1.7e9, "scale": 1e3}, "ms"),
        ({"start": 1.7e9, "scale": 1e9}, "ns"),
    ],
)
def test_a_table_is_read_with_any_delimiter_and_clock(
    tmp_path: Path, options: dict[str, Any], clock_unit: str
) -> None:
    actual = read_vehicle_table(table(tmp_path, **options))
    assert actual.remarks[0].startswith(f"time{options.get('unit', '')}: time in {clock_unit}, ")
    assert "speed [kn]: speed in kn" in actual.remarks
    assert actual.remarks[-1] == "not used: note"
    write_vehicle_table(actual, tmp_path / "a.mcap")
    measured, remarks, _ = read_recording(tmp_path / "a.mcap")
    assert remarks == ()
    assert measured.dt == pytest.approx(0.1, abs=0.01)
    assert measured.speed == pytest.approx(np.full(200, 2 * 1852 / 3600))
    assert measured.heading == pytest.approx(np.full(200, math.pi / 2))
    assert measured.message_step.tolist() == list(range(10, 201, 10))
    assert measured.message[:, 1].tolist() == list(range(9, 200, 10))
    assert measured.message[:, 3] == pytest.approx(np.full(20, math.pi / 4))
    assert np.isnan(measured.message[:, 6:]).all()
    assert measured.ranges[0, :2].tolist() == [30.5, 31.5]
    assert np.isnan(measured.ranges[:, 2]).all()


def test_dates_and_degrees_without_a_unit_are_recognised(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    rows = [f"2026-05-01T12:00:{k:02}.500Z,1.0,270,5.0,0,0,90,0,5,40" for k in range(10)]
    header = (
        "time,speed,heading,depth,"
        "leader_east,leader_north,leader_heading,leader_speed,leader_depth,range_rear"
    )
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    actual = read_vehicle_table(path)
    assert np.diff(actual.time_ns).tolist() == [10**9] * 9
    assert actual.columns["heading"] == pytest.approx(np.full(10, 1.5 * math.pi))
    assert actual.remarks[0] == "time: time in dates (UTC), 9 s"
    assert "heading: heading in deg" in actual.remarks


def test_decimal_commas_are_read_in_all_columns(tmp_path: Path) -> None:
    path = table(tmp_path, delimiter=";")
    expected = read_vehicle_table(path)
    path.write_text(path.read_text(encoding="utf-8-sig").replace(".", ","), encoding="utf-8")
    actual = read_vehicle_table(path)
    assert actual.time_ns.tolist() == expected.time_ns.tolist()
    np.testing.assert_array_equal(actual.columns["range_rear"], expected.columns["range_rear"])


def test_angles_without_a_unit_have_one_unit(tmp_path: Path) -> None:
    """A pitch of 3 could be in radians; beside a heading of 270 it is in degrees."""
    path = tmp_path / "mine.csv"
    header = (
        "t,speed,heading,depth,"
        "leader_east,leader_north,leader_heading,leader_speed,leader_depth,leader_pitch"
    )
    rows = [f"{k},1.0,270,5.0,0,0,10,0,5,3,40" for k in range(10)]
    path.write_text("\n".join([f"{header},range_rear", *rows]), encoding="utf-8")
    columns = read_vehicle_table(path).columns
    assert columns["leader_pitch"] == pytest.approx(np.full(10, math.radians(3)))
    assert columns["leader_heading"] == pytest.approx(np.full(10, math.radians(10)))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("depth,note", "dpth,note", "lacks columns depth; its columns: time"),
        ("range_rear,range_front", "a,b", "lacks columns range_rear"),
        (",2,90.0,5.0,x,", ",2,north,5.0,x,", "column heading_deg, row 1: 'north' is no number"),
        ("9,20.0", "N/A,20.0", "column leader_east, row 10: 'N/A' is no number"),
        ("30.5", "1e300", r"column range_rear, row 10: 1e\+300 is not within"),
        ("30.5", "-1", "column range_rear, row 10: -1 m, expected 0 … 100000 m"),
        ("30.5", "1e6", r"column range_rear, row 10: 1e\+06 m, expected"),
        (
            ",2,90.0,5.0,x,",
            ",200,90.0,5.0,x,",
            r"column speed \[kn\], row 1: 102.889 m/s, expected",
        ),
        (",2,90.0,5.0,x,,,,,,,", ",2,90.0", "row 1: 3 cells, the header has 12"),
    ],
)
def test_errors_of_a_table_are_reported(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = table(tmp_path)
    path.write_text(path.read_text(encoding="utf-8-sig").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(LaisnError, match=rf"mine\.csv.*{words}"):
        read_vehicle_table(path)


@pytest.mark.parametrize("cell", ["", "nan", "inf"])
def test_a_row_without_a_time_is_named(tmp_path: Path, cell: str) -> None:
    path = table(tmp_path)
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    lines[7] = cell + lines[7][lines[7].index(",") :]
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(LaisnError, match=r"mine\.csv, column time, row 7: "):
        read_vehicle_table(path)


def test_a_table_without_own_motion_is_refused_with_the_empty_column(tmp_path: Path) -> None:
    path = table(tmp_path)
    path.write_text(path.read_text(encoding="utf-8-sig").replace(",2,90.0", ",,90.0"), "utf-8")
    with pytest.raises(LaisnError, match=r"mine\.csv: all cells of speed \[kn\] are empty"):
        read_vehicle_table(path)


def test_what_a_navigator_refuses_of_a_log_is_named_with_file_and_time(tmp_path: Path) -> None:
    """The 50th of rows 0.1 s apart, which end steps, by its time in the table."""
    measured = read_vehicle_table(table(tmp_path))
    measured.columns["speed"][49] = 99.0
    write_vehicle_table(measured, tmp_path / "a.mcap")
    answer = CliRunner().invoke(
        app, ["replay", str(tmp_path / "a.mcap"), "--scenario", "T5", "--variant", "tight"]
    )
    text = answer.output
    assert "a.mcap: follower: " in text
    time_s = float(text.split("follower: at ")[1].split(" s, step")[0])
    # the table begins at 5 s
    assert time_s == pytest.approx(5.0 + 4.9, abs=0.03)
    assert "step 50: the speed is 99 m/s" in text


def test_a_table_without_a_range_is_refused(tmp_path: Path) -> None:
    path = table(tmp_path)
    header, *rows = path.read_text(encoding="utf-8-sig").splitlines()
    is_range_column = [name.startswith("range_") for name in header.split(",")]
    rows_without_ranges = [
        ",".join(
            "" if is_range else cell
            for cell, is_range in zip(row.split(","), is_range_column, strict=True)
        )
        for row in rows
    ]
    path.write_text("\n".join([header, *rows_without_ranges]), encoding="utf-8")
    with pytest.raises(
        LaisnError, match=r"no row has a range, all cells of range_rear.* are empty"
    ):
        read_vehicle_table(path)


def test_the_command_imports_a_table_and_prints_what_it_took(tmp_path: Path) -> None:
    words = ["log", "import", str(table(tmp_path)), "--out", str(tmp_path / "a.mcap")]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "heading_deg: heading in deg" in result.output
    assert read_recording(tmp_path / "a.mcap").measurements.speed.size == 200
