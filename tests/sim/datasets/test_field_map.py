"""Maps of text tables: proposed from headers, edited, and used again."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from laisn.messages import LeaderMessage
from laisn_sim.cli.main import app
from sim.attitude import geodetic
from sim.datasets.field_map import FieldEntry, GeodeticOrigin
from sim.datasets.map_proposal import match
from sim.log.reader import read_recording


def printed_text(result: Any) -> str:
    """What a command printed, with one space for each line break."""
    return " ".join(result.output.split())


def run(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["log", "import", *map(str, arguments)])


# the unit is "" where the header names none
FIELD_AND_UNIT_OF_HEADER = {
    "HDG": ("heading", ""),
    "hdg_deg": ("heading", "deg"),
    "Compass [deg]": ("heading", "deg"),
    "STW": ("speed", ""),
    "speed_kn": ("speed", "kn"),
    "Spd (kts)": ("speed", "kn"),
    "DEP": ("depth", ""),
    "depth_ft": ("depth", "ft"),
    "pressure [dbar]": ("depth", "dbar"),
    "ldr_E": ("leader_east", ""),
    "LdrN": ("leader_north", ""),
    "leader x": ("leader_east", ""),
    "ship_lat": ("leader_north", "latitude"),
    "Ship Longitude": ("leader_east", "longitude"),
    "ldr_hdg_rad": ("leader_heading", "rad"),
    "mother.speed [m/s]": ("leader_speed", "m/s"),
    "leader_t": ("leader_timestamp", ""),
    "leaderPitch": ("leader_pitch", ""),
    "R1": ("range_rear", ""),
    "R2_m": ("range_front", "m"),
    "r1_mm": ("range_rear", "mm"),
    "STW [mm/s]": ("speed", "mm/s"),
    "speed_m_s": ("speed", "m/s"),
    "speed_cm_s": ("speed", "cm/s"),
    "rng_aft": ("range_rear", ""),
    "range bow [cm]": ("range_front", "cm"),
    "dist_to_tx3": ("range_middle", ""),
    "slant_range": ("range_rear", ""),
    "tx1_e": ("rear_east", ""),
    "beacon 2 north": ("front_north", ""),
    "t": ("time", ""),
    "Timestamp [ms]": ("time", "ms"),
    "speed_through_water_kn": ("speed", "kn"),
    "forward_speed": ("speed", ""),
    "compass_hdg": ("heading", ""),
    "mag heading (deg)": ("heading", "deg"),
    "acoustic_range_1": ("range_rear", ""),
    "depth [fathom]": ("depth", ""),
    "datetime": ("time", ""),
}


@pytest.mark.parametrize("name", FIELD_AND_UNIT_OF_HEADER)
def test_headers_of_other_spellings_are_matched(name: str) -> None:
    matched = match(name)
    assert matched is not None
    assert (matched.field, matched.unit) == FIELD_AND_UNIT_OF_HEADER[name]


@pytest.mark.parametrize(
    "name",
    [
        "volts",
        "current_speed",
        "speed_over_ground",
        "E",
        "easting",
        "roll",
        "gps_sats",
        "",
        "%",
        "temp_1",
    ],
)
def test_headers_of_no_input_are_not_matched(name: str) -> None:
    """Own position, tilt, and speed over ground are no inputs of a navigator."""
    assert match(name) is None


@pytest.mark.parametrize("name", ["R1", "yaw", "u", "slant_range", "tx1_e", "depth [fathom]"])
def test_doubtful_matches_carry_a_note(name: str) -> None:
    matched = match(name)
    assert matched is not None
    assert matched.note


HEADERS = (
    *("Zeit", "HDG", "STW", "pressure", "R1", "R2"),
    *("ldr_E", "ldr_N", "ldr_hdg", "ldr_spd", "ldr_dep", "volts"),
)


def write_table(path: Path) -> Path:
    """A vehicle on course 090 at 2 kn, 8 m deep, 20 m south of its leader, with foreign headers."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADERS)
        for k in range(1, 401):
            east = 1.028889 * 0.1 * k
            own_cells: list[object] = [round(1000 + 100 * k), 90.0, 2.0, 10.06506 + 8.05]
            own_cells += [round(20.0 + 0.01 * math.sin(k), 4), "", round(east, 4), 20.0]
            writer.writerow(
                [*own_cells, 90.0, 2.0, 8.0, 12.1] if k % 10 == 0 else [*own_cells[:4], *[""] * 8]
            )
    return path


def test_a_table_is_imported_by_an_edited_map(tmp_path: Path) -> None:
    table = write_table(tmp_path / "mine.csv")
    refused = run(table, "--out", tmp_path / "mine.mcap")
    assert refused.exit_code == 2
    assert "laisn log import" in printed_text(refused)
    assert "--propose map.toml" in printed_text(refused)
    proposed = run(table, "--propose", tmp_path / "map.toml")
    assert proposed.exit_code == 0, proposed.output
    assert "nothing was found for time" in printed_text(proposed)
    text = (tmp_path / "map.toml").read_text()
    assert "#   volts" in text
    # as its user edits it: the column of times, the unit of the pressure, speeds in knots
    text = text.replace("# [time]\n# value = 0.0", '[time]\ncolumn = "Zeit"\nunit = "ms"')
    text = text.replace('column = "pressure"', 'column = "pressure"\nunit = "dbar"')
    for name in ("STW", "ldr_spd"):
        text = text.replace(f'column = "{name}"', f'column = "{name}"\nunit = "kn"')
    (tmp_path / "map.toml").write_text(text)
    for name in ("mine.mcap", "again.mcap"):
        result = run(table, "--map", tmp_path / "map.toml", "--out", tmp_path / name)
        assert result.exit_code == 0, result.output
    measured = read_recording(tmp_path / "mine.mcap").measurements
    assert measured.dt == pytest.approx(0.1)
    assert np.allclose(measured.speed, 2.0 * 1852.0 / 3600.0)
    assert np.allclose(measured.heading, 0.5 * math.pi)
    # 18.11506 dbar absolute are 181,150.6 Pa, 79,825.6 Pa above the atmosphere
    assert np.allclose(measured.depth, 79825.6 / (1026.0 * 9.81), atol=1e-6)
    assert measured.ranges[:, 0] == pytest.approx(20.0, abs=0.011)
    assert measured.message_step.size == 40
    assert (tmp_path / "mine.mcap").read_bytes() == (tmp_path / "again.mcap").read_bytes()


def test_a_table_with_a_row_for_each_range(tmp_path: Path) -> None:
    """Ranges of two transmitters stand in one column, and another tells of which."""
    with (tmp_path / "long.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "hdg", "stw", "dep", "src", "rng", "E", "N"])
        for k in range(1, 101):
            own_cells = [k / 10, 90.0, 1.0, 8.0]
            writer.writerow([*own_cells, "", "", "", ""])
            if k % 10 == 0:
                writer.writerow([k / 10, "", "", "", "aft", 20.0 + k, k / 10, 20.0])
                writer.writerow([k / 10, "", "", "", "bow", 21.0 + k, k / 10, 20.0])
    (tmp_path / "map.toml").write_text(
        '[time]\ncolumn = "t"\n[heading]\ncolumn = "hdg"\nunit = "deg"\n'
        '[speed]\ncolumn = "stw"\n[depth]\ncolumn = "dep"\n'
        '[leader_east]\ncolumn = "E"\n[leader_north]\ncolumn = "N"\n'
        "[leader_heading]\nvalue = 1.5707963\n[leader_speed]\nvalue = 1.0\n"
        "[leader_depth]\nvalue = 0.0\n"
        '[range_rear]\ncolumn = "rng"\nwhere = { src = "aft" }\n'
        '[range_front]\ncolumn = "rng"\nwhere = { src = "bow" }\n'
    )
    arguments = ["--map", tmp_path / "map.toml", "--out", tmp_path / "long.mcap"]
    result = run(tmp_path / "long.csv", *arguments)
    assert result.exit_code == 0, result.output
    measured = read_recording(tmp_path / "long.mcap").measurements
    assert measured.speed.size == 100
    assert measured.ranges[:, 0].tolist() == [20.0 + k for k in range(10, 101, 10)]
    assert measured.ranges[:, 1].tolist() == [21.0 + k for k in range(10, 101, 10)]


def test_a_proposed_map_of_known_headers_changes_nothing(tmp_path: Path) -> None:
    """The log of a table is the same to the byte, with and without its proposed map."""
    table = tmp_path / "mine.csv"
    with table.open("w", newline="") as file:
        writer = csv.writer(file)
        own_headers = ["time [s]", "speed [m/s]", "heading_deg", "depth"]
        leader_headers = ["leader_timestamp", "leader_east", "leader_north", "leader_heading_deg"]
        writer.writerow(
            [
                *own_headers,
                *leader_headers,
                "leader_speed",
                "leader_depth",
                "range_rear",
                "range_front",
            ]
        )
        for k in range(1, 201):
            time = round(0.1 * k, 2)
            own_cells: list[object] = [time, 1.0 + 0.01 * (k % 3), 90.5, 8.0]
            message_cells = [time, time, 20.0, 90.0, 1.0, 8.0, 20.05, 20.02]
            writer.writerow([*own_cells, *(message_cells if k % 10 == 0 else [""] * 8)])
    assert run(table, "--out", tmp_path / "a.mcap").exit_code == 0
    assert run(table, "--propose", tmp_path / "map.toml").exit_code == 0
    arguments = ["--map", tmp_path / "map.toml", "--out", tmp_path / "b.mcap"]
    assert run(table, *arguments).exit_code == 0
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


# text of a map, and words of the error
BROKEN_MAPS = {
    "column": ('[heading]\ncolumn = "CRS"', "column 'CRS' is not in"),
    "topic": ('[heading]\ntopic = "/imu"\nfield = "a"', "is a table"),
    "unit": ('[heading]\ncolumn = "HDG"\nunit = "m"', "heading.unit: expected rad, deg"),
    "yaw": ('[heading]\ncolumn = "HDG"\nangle = "yaw"', "a yaw needs its unit"),
    "angle": ('[heading]\ncolumn = "HDG"\nangle = "north"', "heading.angle"),
    "yaw of a spread": (
        '[heading]\ncolumn = "HDG"\n[leader_heading_sigma]\nvalue = 0.1\nangle = "yaw"',
        "leader_heading_sigma.angle: leader_heading_sigma is no heading",
    ),
    "factor of a quaternion": (
        '[heading]\ntopic = "/imu"\nfield = "a"\nunit = "quaternion"\nfactor = -1.0',
        "heading.factor: no factor of a quaternion",
    ),
    "yaw of a quaternion": (
        '[heading]\ntopic = "/imu"\nfield = "a"\nunit = "quaternion"\nangle = "yaw"',
        "heading.angle: a quaternion is from forward, port, up to east, north, up",
    ),
    "constant quaternion": (
        '[heading]\nvalue = 1.0\nunit = "quaternion"',
        "heading.value: a quaternion has four numbers",
    ),
    "unit of a constant": ('[heading]\nvalue = 1.0\nunit = "m"', "heading.unit: expected rad, deg"),
    "lacking": ('[heading]\ncolumn = "HDG"', "lacks time, speed, depth"),
}


@pytest.mark.parametrize("case", BROKEN_MAPS)
def test_errors_of_a_map_of_a_table(case: str, tmp_path: Path) -> None:
    text, expected = BROKEN_MAPS[case]
    table = write_table(tmp_path / "mine.csv")
    if case != "lacking":
        constant_fields = (
            "speed",
            "depth",
            *(f"leader_{name}" for name in ("east", "north", "speed")),
        )
        constants = "".join(f"[{name}]\nvalue = 0.0\n" for name in constant_fields)
        constants += "[leader_heading]\nvalue = 0.0\n[leader_depth]\nvalue = 0.0\n"
        text += f'\n[time]\ncolumn = "Zeit"\n[range_rear]\ncolumn = "R1"\n{constants}'
    (tmp_path / "map.toml").write_text(text)
    result = run(table, "--map", tmp_path / "map.toml", "--out", tmp_path / "mine.mcap")
    assert result.exit_code == 2, result.output
    assert expected in printed_text(result)
    assert not (tmp_path / "mine.mcap").exists()


def test_a_yaw_becomes_a_heading(tmp_path: Path) -> None:
    """Anticlockwise from east 120° is 30° west of north: 330° by the compass."""
    entry = FieldEntry(column="yaw", unit="deg", angle="yaw")
    heading = entry.in_si(np.array([0.0, 90.0, 120.0]), "heading", None)
    assert np.allclose(np.degrees(heading) % 360.0, [90.0, 0.0, 330.0])


def test_a_declination_adds_to_the_heading_of_a_quaternion() -> None:
    """A yaw of 120° is a compass heading of 330°; 45° of declination make it 15°. Pitch, nose up,
    is a rotation of the other sign about the port axis.
    """
    half = np.deg2rad([60.0, 0.0])
    yaw = np.array([[0.0, 0.0, np.sin(half[0]), np.cos(half[0])]])
    entry = FieldEntry(topic="/imu", field="orientation", unit="quaternion", offset=math.pi / 4)
    assert np.degrees(entry.in_si(yaw, "heading", None)) == pytest.approx([15.0])
    nose_up = np.array([[0.0, -math.sin(0.05), 0.0, math.cos(0.05)]])
    mounting = FieldEntry(topic="/imu", field="orientation", unit="quaternion", offset=-0.02)
    assert mounting.in_si(nose_up, "leader_pitch", None) == pytest.approx([0.1 - 0.02])


def test_constants_have_the_units_that_are_stated(tmp_path: Path) -> None:
    """A moored leader: its heading in degrees, its depth in feet of 0.3048 m, its place on the
    map, 0.001° from the origin.
    """
    table = write_table(tmp_path / "mine.csv")
    (tmp_path / "map.toml").write_text(
        "origin = { latitude_deg = 54.0, longitude_deg = 18.0 }\n"
        '[time]\ncolumn = "Zeit"\nunit = "ms"\n[range_rear]\ncolumn = "R1"\n'
        "[speed]\nvalue = 0.0\n[depth]\nvalue = 0.0\n[heading]\nvalue = 0.0\n"
        '[leader_east]\nvalue = 18.001\nunit = "longitude"\n'
        '[leader_north]\nvalue = 54.001\nunit = "latitude"\n'
        '[leader_heading]\nvalue = 0.0\nunit = "deg"\nangle = "yaw"\n'
        '[leader_speed]\nvalue = 0.0\n[leader_depth]\nvalue = 10.0\nunit = "ft"\n'
    )
    result = run(table, "--map", tmp_path / "map.toml", "--out", tmp_path / "mine.mcap")
    assert result.exit_code == 0, result.output
    rows = read_recording(tmp_path / "mine.mcap").measurements.message
    message = LeaderMessage(*rows[0])
    # metres of a degree there, by the series in latitude (Snyder, Map Projections, 1987, of WGS 84)
    phi = np.deg2rad(54.0)
    degree_east = 111412.84 * np.cos(phi) - 93.5 * np.cos(3 * phi) + 0.118 * np.cos(5 * phi)
    degree_north = 111132.954 - 559.822 * np.cos(2 * phi) + 1.175 * np.cos(4 * phi)
    assert message.east == pytest.approx(1e-3 * degree_east, abs=1e-3)
    assert message.north == pytest.approx(1e-3 * degree_north, abs=1e-3)
    assert message.heading == pytest.approx(math.pi / 2)
    assert message.depth == pytest.approx(3.048)


def test_altitudes_become_depths() -> None:
    entry = FieldEntry(column="z", unit="m", factor=-1.0, offset=0.5)
    assert entry.in_si(np.array([-8.0, 0.0]), "depth", None).tolist() == [8.5, 0.5]


@given(st.floats(-80, 80), st.floats(-180, 180), st.floats(-2e4, 2e4), st.floats(-2e4, 2e4))
def test_places_on_the_map_and_back(
    latitude: float, longitude: float, east: float, north: float
) -> None:

    position = geodetic(np.array([[east, north, 0.0]]), latitude, longitude)
    origin = GeodeticOrigin(latitude_deg=latitude, longitude_deg=longitude)
    assert origin.metres(position[:, 1], "longitude")[0] == pytest.approx(east, abs=1e-4)
    assert origin.metres(position[:, 0], "latitude")[0] == pytest.approx(north, abs=1e-4)


def test_a_missing_map_is_refused_with_the_command_that_proposes_one(tmp_path: Path) -> None:
    table = write_table(tmp_path / "mine.csv")
    result = run(table, "--map", tmp_path / "map.toml", "--out", tmp_path / "mine.mcap")
    assert result.exit_code == 2
    assert "no such file; a proposal: laisn log import" in printed_text(result)


def test_an_import_without_a_log_to_write_is_refused(tmp_path: Path) -> None:
    table = write_table(tmp_path / "mine.csv")
    result = run(table)
    assert result.exit_code == 2
    assert "--propose" in printed_text(result)
