"""Speeds of sound out of casts, against values of TEOS-10 and Mackenzie's equation."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn_sim.cli.main import app
from sim.scenario.parts import SoundSettings
from sim.water.assembly import rays_of, sound_cast
from sim.water.rays import speed_at
from tests.sim.water.field_data import write, xarray

pytest.importorskip("gsw")

# check values of gsw_sound_speed, https://www.teos-10.org/pubs/gsw/html/gsw_sound_speed.html
SALINITY = [34.7118, 34.8915, 35.0256]  # absolute [g/kg]
TEMPERATURE = [28.7856, 28.4329, 22.8103]  # conservative [°C]
PRESSURE = [10.0, 50.0, 125.0]  # [dbar]
SPEED = [1542.426412426373, 1542.558891663385, 1530.801535436184]


def scenario(file: Path, latitude: float = 4.0, longitude: float = -172.0) -> Path:
    toml = file.parent / "cast.toml"
    toml.write_text(
        "duration_s = 20\n"
        f"[ocean]\norigin = {{ lat = {latitude}, lon = {longitude} }}\n"
        f'[ocean.sound_speed]\nfile = "{file.name}"\n[[followers]]\nroute = "T5"\n'
    )
    return toml


def table(file: Path, header: str, *columns: list[float], separator: str = ",") -> Path:
    rows = [separator.join(map(str, row)) for row in zip(*columns, strict=True)]
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


def test_speeds_are_the_check_values_of_teos_10(tmp_path: Path) -> None:
    header = "pressure_dbar,conservative_temperature_degC,absolute_salinity [g/kg]"
    toml = scenario(table(tmp_path / "a.csv", header, PRESSURE, TEMPERATURE, SALINITY))
    cast = sound_cast(laisn_sim.load(toml).ocean)
    assert cast is not None
    np.testing.assert_allclose(cast.points[:, 1], SPEED, atol=1e-9)
    # depths at 4° N of a pressure (gsw_z_from_p, the same source)
    np.testing.assert_allclose(cast.points[:, 0], [9.9445834, 49.718036, 124.272615], atol=1e-3)
    result = CliRunner().invoke(app, ["check", str(toml)])
    assert "ocean.sound_speed: a.csv: pressure_dbar, conservative_temperature_degC" in result.stdout
    assert "1530.8 to 1542.6 m/s" in result.stdout


def mackenzie(temperature: float, salinity: float, depth: float) -> float:
    """Speed of sound within 0.1 m/s (Mackenzie, J. Acoust. Soc. Am. 70, 1981)."""
    t, s, d = temperature, salinity - 35.0, depth
    shallow = 1448.96 + 4.591 * t - 5.304e-2 * t**2 + 2.374e-4 * t**3 + 1.340 * s
    return shallow + 1.630e-2 * d + 1.675e-7 * d**2 - 1.025e-2 * t * s - 7.139e-13 * t * d**3


@pytest.mark.parametrize(
    ("units", "unit_offset"),
    [("degrees_C", 0.0), ("degree_Celsius", 0.0), ("Celsius", 0.0), ("degrees_K", 273.15)],
)
def test_temperatures_have_the_spellings_of_cf(
    units: str, unit_offset: float, tmp_path: Path
) -> None:
    """As ocean models write them (`thetao` of CMEMS: degrees_C); at 10 m potential and in-situ
    temperatures are within 0.002 K, which Mackenzie's equation does not tell apart.
    """
    depth, temperature = np.array([0.5, 5.0, 10.0]), np.array([18.0, 15.0, 8.0])
    dataset = xarray.Dataset(
        {
            "thetao": ("depth", temperature + unit_offset, {"units": units}),
            "so": ("depth", np.full(3, 35.0), {"units": "1e-3"}),
        },
        {"depth": ("depth", depth, {"units": "m"})},
    )
    cast = sound_cast(laisn_sim.load(scenario(write(dataset, tmp_path / "cf.nc"))).ocean)
    assert cast is not None
    expected = [mackenzie(t, 35.0, z) for t, z in zip(temperature, depth, strict=True)]
    np.testing.assert_allclose(cast.points[:, 1], expected, atol=0.15)


@pytest.mark.parametrize(
    ("header", "unit_offset", "separator"),
    [
        ("Depth [m],Temperature [°C],Salinity", 0.0, ","),
        ("depth_m;temp_K;psal", 273.15, ";"),
        ("z\tt\ts", 0.0, "\t"),
        ("Depth (m),Temp (deg C),Sal (PSU)", 0.0, ","),
        ("Depth (m),Temp (degrees_C),Sal (PSU)", 0.0, ","),
        ("Depth (m),Temp (degrees_kelvin),Sal (PSU)", 273.15, ","),
    ],
)
def test_columns_are_recognised_by_their_usual_names(
    tmp_path: Path, header: str, unit_offset: float, separator: str
) -> None:
    depth, temperature, salinity = [1.0, 12.0, 40.0, 90.0], [18.0, 15.0, 8.0, 6.0], [35.0] * 4
    file_temperature = [celsius + unit_offset for celsius in temperature]
    file = table(tmp_path / "b.csv", header, depth, file_temperature, salinity, separator=separator)
    cast = sound_cast(laisn_sim.load(scenario(file, 45.0, 0.0)).ocean)
    assert cast is not None
    expected = [mackenzie(*row) for row in zip(temperature, salinity, depth, strict=True)]
    np.testing.assert_allclose(cast.points[:, 1], expected, atol=0.15)
    np.testing.assert_allclose(cast.points[:, 0], depth, atol=1e-9)


def test_a_cast_of_the_speed_is_the_profile_of_the_key(tmp_path: Path) -> None:
    profile = [[0.0, 1490.0], [8.0, 1480.0], [30.0, 1450.0]]
    file = table(tmp_path / "c.csv", "depth,sound_speed", *np.transpose(profile).tolist())
    toml = scenario(file)
    by_file = laisn_sim.fly(toml)
    by_key = laisn_sim.fly("T5", {"duration_s": 20, "acoustics.sound_speed_profile": profile})
    np.testing.assert_array_equal(by_file.measurements[0].ranges, by_key.measurements[0].ranges)
    without_profile = laisn_sim.fly("T5", {"duration_s": 20})
    assert (
        np.nanmax(np.abs(by_file.measurements[0].ranges - without_profile.measurements[0].ranges))
        > 0.1
    )


def test_the_nearest_column_with_values_of_a_model_is_taken(tmp_path: Path) -> None:
    """Potential temperatures in kelvin, longitudes from 0 to 360°, as atlas files have them."""
    depth, latitude, longitude = [5.0, 50.0], [40.0, 45.0, 50.0], [300.0, 330.0, 359.0]
    shape = ("time", "depth", "latitude", "longitude")
    temperature = np.full((1, 2, 3, 3), np.nan)
    temperature[0, :, 1, 2] = 288.15, 281.15
    names = ("sea_water_potential_temperature", "sea_water_practical_salinity")
    dataset = xarray.Dataset(
        {
            names[0]: (shape, temperature, {"standard_name": names[0], "units": "K"}),
            names[1]: (shape, 0 * temperature + 35.0, {"standard_name": names[1], "units": "1"}),
        },
        {
            "time": ("time", [0.0], {"units": "days since 2000-01-01"}),
            "depth": ("depth", depth, {"units": "m", "positive": "down"}),
            "latitude": ("latitude", latitude, {"units": "degrees_north"}),
            "longitude": ("longitude", longitude, {"units": "degrees_east"}),
        },
    )
    scene = laisn_sim.load(scenario(write(dataset, tmp_path / "d.nc"), 44.0, -2.0))
    rays = rays_of(SoundSettings.of(scene))
    # potential and in-situ temperature differ by some mK at 50 m
    assert speed_at(rays.profile, 5.0) == pytest.approx(mackenzie(15.0, 35.0, 5.0), abs=0.15)
    assert speed_at(rays.profile, 50.0) == pytest.approx(mackenzie(8.0, 35.0, 50.0), abs=0.15)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "it has no rows below a header"),
        ('depth,"sound_speed\n1,1500\n2,1500\n', "its header, in which a quote is open"),
        (f"depth,sound_speed\n1,{'9' * 200_000}\n", "it is no table: field larger"),
        ("depth,temperature\n1,10\n", "it has no salinity, and no speed of sound"),
        ("temperature,salinity\n10,35\n", "it has neither depth nor pressure"),
        ("a,b\n1,2\n", "has none of the columns"),
        ("depth,sound_speed\n1,fast\n", "row 2 has 'fast' in column 2; expected a number"),
        ("depth,sound_speed\n1,\n", "none of its rows has all numbers"),
        ("depth,sound_speed\n1,340\n", "its speeds of sound are 340 to 340 m/s; expected 1300"),
        ("depth,sound_speed\n-5,1500\n", "depths count downwards"),
        ("depth,temperature [F],salinity\n1,50,35\n", "has units 'f'"),
    ],
)
def test_a_malformed_cast_is_refused_with_its_file_and_fault(
    tmp_path: Path, text: str, expected: str
) -> None:
    file = tmp_path / "e.csv"
    file.write_text(text)
    result = CliRunner().invoke(app, ["check", str(scenario(file))], env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert "ocean.sound_speed.file: " in result.output
    assert "e.csv: " in result.output
    assert expected in result.output


def atlas() -> xarray.Dataset:
    """Columns of an ocean atlas: longitudes from 0 to 360° that begin within the region, latitudes
    in "degrees", kelvin, salinity in "1e-3", a scalar time.
    """
    depth = np.array([5.0, 15.0, 100.0, 3000.0], dtype=np.float32)
    latitude = np.array([-9.83, -8.17, -6.5, -4.83, -3.17, -1.5], dtype=np.float32)
    longitude = np.array([0.5, 325.5, 330.5, 335.5, 340.5, 345.5, 350.5, 355.5], dtype=np.float32)
    z, y, x = np.meshgrid(depth, latitude, longitude, indexing="ij")
    # a function of depth, latitude and longitude, so that the temperature identifies the column
    theta = 273.15 + 24.0 - 0.004 * z + 0.1 * y + 0.01 * ((x + 180.0) % 360.0 - 180.0)
    salinity = np.full(theta.shape, 35.0)
    axes = ("depth", "lat", "lon")
    names = ("sea_water_practical_salinity", "sea_water_potential_temperature")
    since = "days since 1800-01-01 00:00:0.0"
    return xarray.Dataset(
        {
            "salinity": (axes, salinity, {"standard_name": names[0], "units": "1e-3"}),
            "theta": (axes, theta, {"standard_name": names[1], "units": "K"}),
        },
        {
            "depth": ("depth", depth, {"axis": "Z", "units": "m", "positive": "down"}),
            "lat": ("lat", latitude, {"standard_name": "latitude", "units": "degrees"}),
            "lon": ("lon", longitude, {"standard_name": "longitude", "units": "degrees"}),
            "time": ((), 67539.0, {"standard_name": "time", "units": since}),
        },
    )


def surface_temperature(latitude: float, longitude: float) -> float:
    """Temperature [°C] of the atlas at its least depth, 5 m."""
    return 24.0 - 0.02 + 0.1 * latitude + 0.01 * longitude


def uppermost_speed(
    file: Path, latitude_longitude: tuple[float, float], sound_speed_keys: str = ""
) -> float:
    """Speed of sound at the least depth of the cast that a mission takes [m/s]."""
    toml = scenario(file, *latitude_longitude)
    text = toml.read_text().replace(f'"{file.name}"', f'"{file.name}"\n{sound_speed_keys}')
    toml.write_text(text)
    cast = sound_cast(laisn_sim.load(toml).ocean)
    assert cast is not None
    return float(cast.points[0, 1])


def test_the_nearest_column_of_an_atlas_is_taken_and_check_prints_it(tmp_path: Path) -> None:
    file = write(atlas(), tmp_path / "atlas.nc")
    expected = mackenzie(surface_temperature(-4.83, -19.5), 35.0, 5.0)
    assert uppermost_speed(file, (-5.0, -20.0)) == pytest.approx(expected, abs=0.1)
    expected = mackenzie(surface_temperature(-1.5, 0.5), 35.0, 5.0)
    assert uppermost_speed(file, (-1.0, 1.0)) == pytest.approx(expected, abs=0.1)
    toml = scenario(file, -5.0, -20.0)
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert "cast 29 of 48, 58.5 km from the origin, the nearest with values" in result.stdout


def test_a_column_on_land_gives_way_to_the_next_one(tmp_path: Path) -> None:
    dataset = atlas()
    dataset["theta"][:, 3, 4] = np.nan
    file = write(dataset, tmp_path / "land.nc")
    # the next latitude is nearer than the next longitude
    expected = mackenzie(surface_temperature(-6.5, -19.5), 35.0, 5.0)
    assert uppermost_speed(file, (-5.0, -20.0)) == pytest.approx(expected, abs=0.1)


def test_an_atlas_without_values_is_refused(tmp_path: Path) -> None:
    dataset = atlas()
    dataset["theta"][:] = np.nan
    toml = scenario(write(dataset, tmp_path / "empty.nc"), -5.0, -20.0)
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert "none of the 48 casts nearest to the origin has values" in result.output


@pytest.mark.parametrize("numbered", [True, False])
def test_of_a_curvilinear_grid_the_column_at_the_nearest_place_is_taken(
    tmp_path: Path, *, numbered: bool
) -> None:
    """A grid turned by 40°, whose axes count points or have no coordinates."""
    axes = ("deptht", "y", "x")
    y, x = np.meshgrid(np.arange(12.0), np.arange(9.0), indexing="ij")
    turn = np.deg2rad(40.0)
    latitude = 3.0 + 0.2 * (y * np.cos(turn) + x * np.sin(turn))
    longitude = 1.0 + 0.2 * (x * np.cos(turn) - y * np.sin(turn))
    temperature = 10.0 + 0.1 * y + x
    depths = np.broadcast_to(temperature, (2, *temperature.shape))
    dataset = xarray.Dataset(
        {
            "temperature": (axes, depths, {"units": "degC"}),
            "salinity": (axes, 0.0 * depths + 35.0),
        },
        {
            "deptht": ("deptht", [5.0, 50.0], {"units": "m"}),
            "nav_lat": (("y", "x"), latitude, {"units": "degrees_north"}),
            "nav_lon": (("x", "y"), longitude.T, {"units": "degrees_east"}),
        },
    )
    if numbered:
        dataset = dataset.assign_coords(y=y[:, 0], x=x[0])
    file = write(dataset, tmp_path / "nemo.nc")
    for place in ((4.0, 1.3), (3.9, 2.0), (4.8, 0.2)):
        # a degree of longitude is as long as one of latitude there, to 0.4 %
        nearest = np.argmin(np.hypot(latitude - place[0], longitude - place[1]))
        expected = mackenzie(temperature.ravel()[nearest], 35.0, 5.0)
        # from column to column it is 0.4 m/s at least
        assert uppermost_speed(file, place) == pytest.approx(expected, abs=0.15)


def float_profiles() -> xarray.Dataset:
    """Profiles as profiling floats send them: each at a position and with pressures of its own."""
    pressure = np.array([[5.0, 50.0, np.nan], [4.0, 40.0, 90.0], [6.0, 60.0, 95.0]])
    temperature = np.array([[8.0, 6.0, np.nan], [12.0, 9.0, 7.0], [16.0, 10.0, 8.0]])
    axes = ("N_PROF", "N_LEVELS")
    return xarray.Dataset(
        {
            "PRES": (axes, pressure, {"standard_name": "sea_water_pressure", "units": "decibar"}),
            "TEMP": (
                axes,
                temperature,
                {"standard_name": "sea_water_temperature", "units": "degree_Celsius"},
            ),
            "PSAL": (
                axes,
                0.0 * temperature + 35.0,
                {"standard_name": "sea_water_salinity", "units": "psu"},
            ),
            "LATITUDE": ("N_PROF", [60.0, 61.0, 62.0], {"units": "degree_north", "axis": "Y"}),
            "LONGITUDE": ("N_PROF", [2.0, 3.0, 4.0], {"units": "degree_east", "axis": "X"}),
        }
    )


@pytest.mark.parametrize(
    ("latitude_longitude", "sound_speed_keys", "temperature"),
    [
        ((60.9, 3.1), "", 12.0),
        ((62.5, 4.0), "", 16.0),
        ((60.9, 3.1), "profile = 1", 8.0),
        ((60.9, 3.1), "profile = 3", 16.0),
    ],
)
def test_the_nearest_profile_or_the_one_of_the_key_is_taken(
    tmp_path: Path,
    latitude_longitude: tuple[float, float],
    sound_speed_keys: str,
    temperature: float,
) -> None:
    file = write(float_profiles(), tmp_path / "floats.nc")
    speed = uppermost_speed(file, latitude_longitude, sound_speed_keys)
    assert speed == pytest.approx(mackenzie(temperature, 35.0, 5.0), abs=0.15)


STATIONS = """\
station,lat,lon,depth,sound_speed
A,54.0,18.0,0,1450
A,54.0,18.0,10,1449
B,54.6,18.6,0,1460
B,54.6,18.6,10,1459
"""
WITHOUT_POSITIONS = "\n".join(
    ",".join(row.split(",")[i] for i in (0, 3, 4)) for row in STATIONS.splitlines()
)


def test_the_nearest_station_of_a_table_or_the_one_of_the_key_is_taken(tmp_path: Path) -> None:
    file = tmp_path / "stations.csv"
    file.write_text(STATIONS)
    assert uppermost_speed(file, (54.5, 18.5)) == 1460.0
    assert uppermost_speed(file, (54.1, 18.0)) == 1450.0
    assert uppermost_speed(file, (54.5, 18.5), "profile = 1") == 1450.0
    # without names of stations, by their places
    file.write_text("\n".join(row.partition(",")[2] for row in STATIONS.splitlines()))
    assert uppermost_speed(file, (54.5, 18.5)) == 1460.0


@pytest.mark.parametrize(
    ("sound_speed_keys", "expected"),
    [
        ("", "it has 2 casts, and does not say where they were taken; choose one with profile"),
        ("profile = 3", "profile = 3; it has 2 casts"),
    ],
)
def test_several_casts_without_positions_need_a_valid_key_profile(
    tmp_path: Path, sound_speed_keys: str, expected: str
) -> None:
    file = tmp_path / "stations.csv"
    file.write_text(WITHOUT_POSITIONS)
    toml = scenario(file)
    toml.write_text(toml.read_text().replace('.csv"', f'.csv"\n{sound_speed_keys}'))
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert expected in result.output


def test_check_prints_the_cast_that_the_key_chooses(tmp_path: Path) -> None:
    file = tmp_path / "stations.csv"
    file.write_text(WITHOUT_POSITIONS)
    assert uppermost_speed(file, (54.5, 18.5), "profile = 2") == 1460.0
    result = CliRunner().invoke(app, ["check", str(tmp_path / "cast.toml")])
    assert "cast 2 of 2" in result.stdout


def test_the_profile_of_the_time_nearest_to_the_start_is_taken(tmp_path: Path) -> None:
    depth, time = [5.0, 50.0], [0.0, 10.0, 20.0]
    speed = 1450.0 + np.array([[0.0, 1.0], [10.0, 11.0], [20.0, 21.0]])
    dataset = xarray.Dataset(
        {"speed": (("time", "depth"), speed, {"standard_name": "speed_of_sound_in_sea_water"})},
        {
            "time": ("time", time, {"units": "days since 2025-12-20"}),
            "depth": ("depth", depth, {"units": "m", "positive": "down"}),
        },
    )
    # missions begin on 1 January unless a key says otherwise
    assert uppermost_speed(write(dataset, tmp_path / "t.nc"), (54.0, 18.0)) == 1460.0
