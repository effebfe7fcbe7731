"""Currents out of files against closed forms and against the keys of a scenario, through the
commands that read them.
"""

import math
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from experiments.campaign.store import key_of
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn_sim.cli.errors import MISSION_FAILED
from laisn_sim.cli.main import app
from reports import flight_figures
from sim.attitude import FLATTENING, SEMI_MAJOR_AXIS
from sim.flight import Termination
from sim.scenario.parts import MotionSettings, SeaSettings
from sim.simulation import simulate_open_loop
from sim.water.assembly import current_field, ocean_of
from sim.water.environment import flow, sea_at
from tests.sim.water.field_data import (
    DEGREE_EAST,
    DEGREE_NORTH,
    LATITUDE,
    LONGITUDE,
    gyre_velocity,
    metres_field,
    model_output,
    scenario_file,
    write,
    xarray,
)

h5netcdf = pytest.importorskip("h5netcdf")


def velocity_of(file: Path, points: Floats, time: float, duration: float = 20.0) -> Floats:
    """Velocity that a mission meets in the current of a file, shape (n, 3), [m/s]."""
    scenario = laisn_sim.load(scenario_file(file, duration))
    return ocean_of(SeaSettings.of(scenario)).velocity(points, time)


@pytest.mark.system
def test_the_interpolation_error_falls_with_the_square_of_the_spacing(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(-300, 300, (400, 2)), np.zeros(400)])
    errors = []
    for halvings in range(3):
        file = metres_field(tmp_path / f"{halvings}.nc", 100.0 / 2**halvings, 40.0 / 2**halvings)
        actual = velocity_of(file, points, 13.0)
        u, v = gyre_velocity(*points.T[:2], 13.0)
        errors.append(np.sqrt(np.mean((actual[:, :2] - np.column_stack([u, v])) ** 2)))
        np.testing.assert_array_equal(actual[:, 2], 0.0)
    ratios = np.divide(errors[:-1], errors[1:])
    assert ratios == pytest.approx([4.0, 4.0], rel=0.1), errors


def test_rate_and_gradient_are_those_of_the_field_between_the_points(tmp_path: Path) -> None:
    """Central differences of the interpolated velocity itself: added mass feels what drag feels."""
    file = metres_field(tmp_path / "gyre.nc", 50.0, 20.0)
    environment = ocean_of(SeaSettings.of(laisn_sim.load(scenario_file(file, 60.0)))).environment
    rng = np.random.default_rng(4)
    step = 1e-3
    for _ in range(20):
        # well within a cell, where the field has a derivative
        position = 50.0 * rng.integers(-5, 5, 3) + rng.uniform(5, 45, 3)
        position[2] = -rng.uniform(1.0, 35.0)
        time = float(20.0 * rng.integers(0, 2) + rng.uniform(1, 19))
        motion = rng.normal(size=3)

        def velocity_near(
            offset: Floats, later: float, position: Floats = position, time: float = time
        ) -> Floats:
            return np.array(environment.flow(tuple(position + offset), time + later))

        water = flow(sea_at(environment, time), tuple(position), tuple(motion), (1.0, 0.0, 0.0))
        differences = [
            (velocity_near(step * axis, 0.0) - velocity_near(-step * axis, 0.0)) / (2 * step)
            for axis in np.eye(3)
        ]
        np.testing.assert_allclose(water.gradient, np.array(differences).T, atol=1e-9)
        rate_along_motion = (
            velocity_near(step * motion, step) - velocity_near(-step * motion, -step)
        ) / (2 * step)
        np.testing.assert_allclose(water.rate, rate_along_motion, atol=1e-9)
        np.testing.assert_allclose(water.velocity, velocity_near(np.zeros(3), 0.0), atol=1e-15)


def east_north_of(latitude_deg: float, longitude_deg: float, origin: tuple[float, float]) -> Floats:
    """East and north on the tangent plane at an origin, through earth-centred coordinates [m]."""

    def earth_centred(latitude: float, longitude: float) -> Floats:
        e2 = FLATTENING * (2.0 - FLATTENING)
        n = SEMI_MAJOR_AXIS / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
        distance_from_axis = n * np.cos(latitude)
        z = n * (1.0 - e2) * np.sin(latitude)
        return np.array(
            [distance_from_axis * np.cos(longitude), distance_from_axis * np.sin(longitude), z]
        )

    phi, lam = np.deg2rad(origin)
    offset = earth_centred(*np.deg2rad([latitude_deg, longitude_deg])) - earth_centred(phi, lam)
    east = np.array([-np.sin(lam), np.cos(lam), 0.0])
    north = [-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)]
    return np.array([east @ offset, np.array(north) @ offset])


def test_degrees_are_metres_of_the_ellipsoid_at_60_degrees_north(tmp_path: Path) -> None:
    """The velocities of this file are the longitudes and latitudes of its points, from the origin:
    so they say where a point in metres was looked up.
    """
    axis = np.linspace(-0.05, 0.05, 11)
    y, x = np.meshgrid(axis, axis, indexing="ij")
    dataset = xarray.Dataset(
        {"u": (("lat", "lon"), x, {"units": "m s-1"}), "v": (("lat", "lon"), y, {"units": "m/s"})},
        {"lat": 60.0 + axis, "lon": 5.0 + axis},
    )
    file = write(dataset, tmp_path / "map.nc")
    toml = tmp_path / "map.toml"
    toml.write_text(
        "duration_s = 20\n[ocean]\norigin = { latitude_deg = 60.0, longitude_deg = 5.0 }\n"
        f'[ocean.current]\nfile = "{file.name}"\n[[followers]]\nroute = "T5"\n'
    )
    scenario = laisn_sim.load(toml)
    # the origin of the table is that of the scenario
    assert (scenario.origin_latitude_deg, scenario.origin_longitude_deg) == (60.0, 5.0)
    points = np.array([[1000.0, 0.0, 0.0], [0.0, 1000.0, 0.0], [-700.0, 700.0, 0.0]])
    for point, (x_deg, y_deg, _) in zip(
        points, ocean_of(SeaSettings.of(scenario)).velocity(points, 0.0), strict=True
    ):
        actual = east_north_of(60.0 + y_deg, 5.0 + x_deg, (60.0, 5.0))
        assert np.hypot(*(actual - point[:2])) < 0.3


def as_of_hycom(dataset: xarray.Dataset) -> xarray.Dataset:
    """Names of HYCOM, longitudes from 0 to 360° that begin within the region, latitudes from the
    north.
    """
    names = {"uo": "water_u", "vo": "water_v", "latitude": "lat", "longitude": "lon"}
    dataset = dataset.rename(names).isel(lat=slice(None, None, -1)).roll(lon=4, roll_coords=True)
    dataset["lon"] = dataset.lon % 360.0
    for name in ("water_u", "water_v"):
        del dataset[name].attrs["standard_name"]
    return dataset


def in_centimetres(dataset: xarray.Dataset) -> xarray.Dataset:
    for name in ("uo", "vo"):
        dataset[name] = (100.0 * dataset[name]).assign_attrs(dataset[name].attrs, units="cm/s")
    return dataset


def with_heights(dataset: xarray.Dataset) -> xarray.Dataset:
    """Heights from the deepest level on."""
    attributes = {"units": "m", "positive": "up"}
    return dataset.assign_coords(depth=("depth", -dataset.depth.values, attributes)).isel(
        depth=slice(None, None, -1)
    )


def days_of_the_year(dataset: xarray.Dataset) -> xarray.Dataset:
    days = (dataset.time.values - 1.0) / 24.0 + 181.0
    units = {"units": "days since 2026-01-01", "calendar": "proleptic_gregorian"}
    return dataset.assign_coords(time=("time", days, units))


@pytest.mark.parametrize(
    "reference",
    [
        "2026-06-30 23:00:00",
        "2026-06-30T23:00:00.000Z",
        "2026-7-1 1:0:0 +02:00",
        "2026-06-30 16:00 -0700",
        "2026-06-30 22:59:60.0 UTC",
    ],
)
def test_reference_dates_with_time_zones_are_understood(tmp_path: Path, reference: str) -> None:
    """All are the same instant, an hour before the mission; from it on, the field grows by 0.01 m/s
    an hour.
    """
    dataset = model_output()
    dataset.time.attrs["units"] = f"hours since {reference}"
    file = write(dataset, tmp_path / "a.nc")
    actual = velocity_of(file, np.array([[0.0, 0.0, -0.5]]), 18.0)
    assert actual[0, 1] == pytest.approx(-0.1 + 0.01 * (1.0 + 18.0 / 3600.0), abs=1e-9)


@pytest.mark.parametrize(
    "change", [as_of_hycom, in_centimetres, with_heights, days_of_the_year, lambda same: same]
)
@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_conventions_of_files_make_no_difference(
    tmp_path: Path, change: Callable[[xarray.Dataset], xarray.Dataset], engine: str
) -> None:
    file = write(change(model_output()), tmp_path / "a.nc", engine)
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-500, 500, (50, 2)), -rng.uniform(0.5, 30.0, 50)])
    degrees = points[:, :2] / [DEGREE_EAST, DEGREE_NORTH]
    u = 0.1 + 2.0 * degrees[:, 0] + 0.002 * points[:, 2]
    v = -0.1 + 3.0 * degrees[:, 1] + 0.01 * (1.0 + 15.0 / 3600.0)
    actual = velocity_of(file, points, 15.0)
    np.testing.assert_allclose(actual[:, :2], np.column_stack([u, v]), atol=1e-7)


def test_packed_numbers_land_and_points_below_the_floor_are_read(tmp_path: Path) -> None:
    dataset = model_output()
    masked = dataset.uo.copy()
    masked[:, 2] = np.nan  # the floor lies above 30 m
    masked[:, :, :, 7:] = np.nan
    dataset["uo"] = masked
    encoding: Any = {"dtype": "i2", "scale_factor": 1e-4, "_FillValue": -32768}
    file = tmp_path / "packed.nc"
    dataset.to_netcdf(file, engine="h5netcdf", encoding={"uo": encoding})
    scenario = laisn_sim.load(scenario_file(file))
    ocean = ocean_of(SeaSettings.of(scenario))
    below = ocean.velocity(np.array([[0.0, 0.0, -30.0], [0.0, 0.0, -10.0]]), 0.0)
    assert below[0, 0] == below[1, 0] == pytest.approx(0.08, abs=1e-4)
    field = current_field(SeaSettings.of(scenario))
    assert field is not None
    # land begins at 0.02° east
    assert field.on_land(np.array([[0.018 * DEGREE_EAST, 0.0], [0.0, 0.0]])).tolist() == [
        True,
        False,
    ]


def late(depth: float, time: float) -> float:
    """The mean depth whose velocity is met, of levels of which the upper one is missing an hour
    after the start.
    """
    share = time / 3600.0
    return (1.0 - share) * max(depth, 0.5) + share * max(depth, 10.0)


# what is missing of times and levels, which are 0.5, 10 and 30 m deep, and the depth whose velocity
# is met; the mission begins at the second time
GAPS: dict[str, tuple[Any, Callable[[float, float], float]]] = {
    "first level": (np.s_[:, 0], lambda depth, _: max(depth, 10.0)),
    "middle level": (np.s_[:, 1], lambda depth, _: max(depth, 0.5)),
    "last level": (np.s_[:, 2], lambda depth, _: min(max(depth, 0.5), 10.0)),
    "a time of a level": (np.s_[2, 0], late),
}


@pytest.mark.parametrize("gap", GAPS)
@pytest.mark.parametrize("component", ["uo", "vo"])
def test_missing_levels_and_times_are_filled(gap: str, component: str, tmp_path: Path) -> None:
    """The velocity is linear in depth and time, so that a gap between others has it exactly; above
    the first level with values it is that of this level.
    """
    missing, depth_met = GAPS[gap]
    dataset = model_output()
    dataset[component][missing] = np.nan
    file = write(dataset, tmp_path / "gaps.nc")
    for depth in (0.0, 5.0, 10.0, 20.0):
        for time in (0.0, 15.0):
            actual = velocity_of(file, np.array([[0.0, 0.0, -depth]]), time)[0]
            u = 0.1 - 0.002 * depth_met(depth, time)
            v = -0.1 + 0.01 * (1.0 + time / 3600.0)
            np.testing.assert_allclose(actual[:2], [u, v], atol=1e-9, rtol=0.0)


def test_times_are_read_as_xarray_writes_them_closer_than_a_second(tmp_path: Path) -> None:
    """Half seconds become milliseconds since a date there."""
    dataset = model_output()
    start = np.datetime64("2026-07-01T00:00:00", "ns")
    time = start + np.arange(0, 60_000, 20_000).astype("timedelta64[ms]")
    time[1] += np.timedelta64(500, "ms")
    dataset = dataset.isel(time=slice(0, 3)).assign_coords(time=time)
    dataset["vo"][:] = np.array([0.0, 0.205, 0.4])[:, None, None, None]
    file = write(dataset, tmp_path / "fine.nc")
    with xarray.open_dataset(file, decode_times=False) as written:
        assert written.time.attrs["units"].startswith("milliseconds since")
    for moment, expected in ((10.25, 0.1025), (20.0, 0.2)):
        actual = velocity_of(file, np.zeros((1, 3)), moment)[0, 1]
        assert actual == pytest.approx(expected, abs=1e-9)


def test_columns_that_lack_a_time_are_told_and_are_no_land(tmp_path: Path) -> None:
    """The mission lies between the second and the fourth time; the third one is missing."""
    dataset = model_output().assign_coords(
        time=("time", [0.0, 1.0, 1.001, 3.0], {"units": "hours since 2026-06-30 23:00:00"})
    )
    dataset["vo"][:] = 0.1 * dataset.time.values[:, None, None, None]
    dataset["vo"][2] = np.nan
    file = write(dataset, tmp_path / "gaps.nc")
    field = current_field(SeaSettings.of(laisn_sim.load(scenario_file(file))))
    assert field is not None
    assert not field.land.any()
    # of the three times that are read
    assert "0.33 of the columns of water lack values at a time" in field.report
    for time in (0.0, 3.6, 20.0):
        actual = velocity_of(file, np.zeros((1, 3)), time)[0]
        assert actual[1] == pytest.approx(0.1 * (1.0 + time / 3600.0), abs=1e-9)


def test_a_current_without_its_upward_part_is_a_current(tmp_path: Path) -> None:
    """An upward velocity that is missing at the surface, as of levels between those of the others,
    leaves the horizontal one.
    """
    dataset = model_output()
    upward = np.full(dataset.uo.shape, 0.01)
    upward[:, 0] = np.nan
    attributes = {"standard_name": "upward_sea_water_velocity", "units": "m s-1"}
    dataset["wo"] = (dataset.uo.dims, upward, attributes)
    file = write(dataset, tmp_path / "upward.nc")
    actual = velocity_of(file, np.array([[0.0, 0.0, -0.5]]), 0.0)[0]
    np.testing.assert_allclose(actual, [0.1 - 0.002 * 0.5, -0.09, 0.01], atol=1e-9)


@pytest.mark.parametrize("first", [-180.0, 0.0])
def test_a_grid_of_the_globe_may_be_closed_by_its_first_column(
    first: float, tmp_path: Path
) -> None:
    """At the points of the grid the velocity is what the file has there."""
    longitude = np.arange(first, first + 360.1, 0.25)
    latitude = np.arange(-89.0, 89.1, 0.25)
    y, x = np.meshgrid(latitude, longitude, indexing="ij")
    dims = ("latitude", "longitude")
    units = {"units": "m s-1"}
    dataset = xarray.Dataset(
        {"uo": (dims, np.sin(np.deg2rad(x)), units), "vo": (dims, np.cos(np.deg2rad(y)), units)},
        {
            "latitude": ("latitude", latitude, {"units": "degrees_north"}),
            "longitude": ("longitude", longitude, {"units": "degrees_east"}),
        },
    )
    file = write(dataset, tmp_path / "globe.nc")
    east = (18.5 - LONGITUDE) * DEGREE_EAST
    north = (54.5 - LATITUDE) * DEGREE_NORTH
    actual = velocity_of(file, np.array([[east, north, 0.0]]), 0.0)[0]
    expected = [np.sin(np.deg2rad(18.5)), np.cos(np.deg2rad(54.5))]
    np.testing.assert_allclose(actual[:2], expected, atol=1e-7)


def test_only_what_a_mission_needs_is_read(tmp_path: Path) -> None:
    file = write(model_output(), tmp_path / "a.nc")
    field = current_field(SeaSettings.of(laisn_sim.load(scenario_file(file))))
    assert field is not None
    # of 4 times the two about the mission, of 0.1° of longitude the routes and a kilometre beside
    # them
    times, depths, _, columns, _ = field.current.grid.velocity.shape
    assert (times, depths) == (2, 3)
    assert columns < 11
    assert field.region.west < -1000.0


@pytest.mark.system
def test_a_uniform_field_moves_vehicles_as_the_keys_do(tmp_path: Path) -> None:
    """A current with shear, which is linear in depth, is met exactly; its mission is the same."""
    dataset = model_output()
    dataset = dataset.assign_coords(depth=("depth", [0.0, 10.0, 30.0], {"units": "m"}))
    dataset["uo"][:] = 0.3 - 0.004 * dataset.depth.values[:, None, None]
    dataset["vo"][:] = 0.0
    file = write(dataset, tmp_path / "shear.nc")
    by_file = laisn_sim.fly(scenario_file(file))
    keys = {"current_speed_m_s": 0.3, "current_direction_deg": 90.0, "current_shear_per_s": 0.004}
    by_keys = laisn_sim.fly(
        "T5", {"duration_s": 20} | {f"ocean.{key}": value for key, value in keys.items()}
    )
    np.testing.assert_allclose(by_file.trajectory.pose, by_keys.trajectory.pose, atol=1e-9)
    np.testing.assert_allclose(
        by_file.trajectory.water_velocity, by_keys.trajectory.water_velocity, atol=1e-12
    )


def test_an_upward_component_is_read_with_its_gradient(tmp_path: Path) -> None:
    """A third component, here along the map and the depth, with its gradient."""
    dataset = model_output()
    x, z = dataset.longitude.values - LONGITUDE, dataset.depth.values
    upward_velocity = 0.01 + 0.5 * x[None, None, None, :] - 0.001 * z[None, :, None, None]
    shape = dataset.uo.shape
    dataset["wo"] = (
        dataset.uo.dims,
        np.broadcast_to(upward_velocity, shape).copy(),
        {"units": "m s-1"},
    )
    environment = ocean_of(
        SeaSettings.of(laisn_sim.load(scenario_file(write(dataset, tmp_path / "a.nc"))))
    ).environment
    position, motion = (200.0, -90.0, -15.0), (0.3, 0.2, 0.1)
    water = flow(sea_at(environment, 3.0), position, motion, (1.0, 0.0, 0.0))
    gradient_east = 0.5 / DEGREE_EAST
    assert water.velocity[2] == pytest.approx(0.01 + 200.0 * gradient_east - 0.015, abs=1e-7)
    assert water.gradient[2] == pytest.approx((gradient_east, 0.0, 0.001), abs=1e-9)
    assert water.rate[2] == pytest.approx(0.3 * gradient_east + 0.1 * 0.001, abs=1e-9)


def test_campaigns_fly_in_the_field_where_it_lies(tmp_path: Path) -> None:
    """Campaigns leave the origin on the map out of a motion, except where it has a field."""
    file = write(
        model_output().assign_coords(latitude=lambda d: d.latitude + 5.0), tmp_path / "a.nc"
    )
    toml = scenario_file(file)
    toml.write_text(toml.read_text().replace(f"lat = {LATITUDE}", f"lat = {LATITUDE + 5.0}"))
    scenario = laisn_sim.load(toml)
    trajectory = laisn_sim.fly(scenario).trajectory
    motion = MotionSettings.of(scenario)
    np.testing.assert_array_equal(simulate_open_loop(motion).pose, trajectory.pose)
    elsewhere = laisn_sim.load(toml, {"ocean.origin.longitude_deg": LONGITUDE + 0.01})
    assert key_of(MotionSettings.of(elsewhere)) != key_of(motion)


def test_a_flight_in_the_gyre_says_what_was_read_and_meets_it(tmp_path: Path) -> None:
    toml = scenario_file(metres_field(tmp_path / "gyre.nc", 25.0, 10.0))
    result = CliRunner().invoke(app, ["check", str(toml)])
    assert result.exit_code == 0, result.output
    assert "ocean.current: gyre.nc: u, v on" in result.stdout
    assert "2 depths, 0 to 40 m" in result.stdout
    assert "0 to 20 s from the start" in result.stdout
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["fly", str(toml), "--no-video", "--out", str(out)])
    assert result.exit_code == 0, result.output
    flight = laisn_sim.read_log(out / "flight.mcap")
    truth = flight.trajectory
    for vehicle in range(2):
        east, north, up = truth.position[:, vehicle].T
        u, v = gyre_velocity(east, north, truth.time)
        depth_factor = 1.0 + up / 80.0
        expected = np.column_stack([depth_factor * u, depth_factor * v])
        # linear interpolation over 25 m: within 2.5 % of the scale of velocities
        assert np.abs(truth.water_velocity[:, vehicle, :2] - expected).max() < 0.025 * 0.2
    # the scenario that is saved beside it flies the same mission, from anywhere
    flown_again = laisn_sim.fly(out / "scenario.toml")
    np.testing.assert_array_equal(flown_again.trajectory.pose, truth.pose)
    # a scenario that has been saved refuses a file of other content
    metres_field(tmp_path / "gyre.nc", 50.0, 10.0)
    with pytest.raises(LaisnError, match="its content is not that with which the scenario was"):
        laisn_sim.load(out / "scenario.toml")


@pytest.mark.system
def test_a_vehicle_that_leaves_a_field_ends_the_mission(tmp_path: Path) -> None:
    toml = scenario_file(metres_field(tmp_path / "small.nc", 50.0, 100.0), 400.0)
    # the leader is carried away while it tries to keep to its route in the east
    text = toml.read_text().replace("[[followers]]", "[leader]\nthrust_scale = 0.1\n[[followers]]")
    field = xarray.load_dataset(tmp_path / "small.nc", engine="h5netcdf", decode_times=False)
    field = field.isel(time=[0]).sel(y=slice(-300.0, 50.0))
    field["u"][:] = 0.0
    field["v"][:] = 2.0
    write(field, tmp_path / "narrow.nc")
    toml.write_text(text.replace("small.nc", "narrow.nc"))
    arguments = ["fly", str(toml), "--no-video", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == MISSION_FAILED, result.output
    flight = laisn_sim.read_log(tmp_path / "out" / "flight.mcap")
    assert flight.outcome is Termination.LEFT_FIELD
    assert flight.trajectory.position[-1, :, 1].max() > 50.0
    assert flight.trajectory.position[-2, :, 1].max() <= 50.0


def _with_content(content: bytes) -> Callable[[Path], None]:
    return lambda file: file.write_bytes(content) and None


def _changed(change: Callable[[xarray.Dataset], xarray.Dataset]) -> Callable[[Path], None]:
    return lambda file: write(change(model_output()), file) and None


def _with_attributes(name: str, **attributes: str) -> Callable[[Path], None]:
    def change(dataset: xarray.Dataset) -> xarray.Dataset:
        dataset[name].attrs.update(attributes)
        return dataset

    return _changed(change)


def _in_groups(file: Path) -> None:
    """Velocities in groups, as of some satellite products; none at the top."""
    model_output().to_netcdf(file, engine="h5netcdf", group="surface")
    model_output().to_netcdf(file, engine="h5netcdf", group="deep", mode="a")


def _truncated(file: Path) -> None:
    write(model_output(), file)
    file.write_bytes(file.read_bytes()[:3000])


def _roms(dataset: xarray.Dataset) -> xarray.Dataset:
    attributes = {"standard_name": "ocean_s_coordinate_g2"}
    return dataset.rename(depth="s_rho").assign_coords(
        s_rho=("s_rho", [-0.9, -0.5, -0.1], attributes)
    )


def _curvilinear(dataset: xarray.Dataset) -> xarray.Dataset:
    y, x = np.meshgrid(dataset.latitude, dataset.longitude, indexing="ij")
    dataset = dataset.rename(latitude="y", longitude="x").drop_vars(["x", "y"])
    return dataset.assign_coords(nav_lat=(("y", "x"), y), nav_lon=(("y", "x"), x))


def _numbered(dataset: xarray.Dataset) -> xarray.Dataset:
    """Axes that count points, about the number of degrees of the origin."""
    x = LONGITUDE - 5 + np.arange(dataset.longitude.size)
    y = LATITUDE - 6 + np.arange(dataset.latitude.size)
    return dataset.rename(latitude="y", longitude="x").assign_coords(x=x, y=y)


def _curvilinear_and_numbered(dataset: xarray.Dataset) -> xarray.Dataset:
    numbers = _numbered(dataset)
    return _curvilinear(dataset).assign_coords(x=numbers.x, y=numbers.y)


def _rotated(dataset: xarray.Dataset) -> xarray.Dataset:
    dataset = dataset.rename(latitude="rlat", longitude="rlon")
    dataset.rlat.attrs = {"standard_name": "grid_latitude", "units": "degrees", "axis": "Y"}
    dataset.rlon.attrs = {"standard_name": "grid_longitude", "units": "degrees", "axis": "X"}
    return dataset


def _projected(dataset: xarray.Dataset) -> xarray.Dataset:
    """In metres of a polar stereographic map whose corner is the mission's (0, 0)."""
    dataset = dataset.rename(latitude="y", longitude="x")
    metres = {"units": "m", "standard_name": "projection_x_coordinate"}
    dataset = dataset.assign_coords(
        x=("x", 800.0 * np.arange(-5.0, dataset.x.size - 5.0), metres),
        y=("y", 800.0 * np.arange(-5.0, dataset.y.size - 5.0), {"units": "m"}),
        polar=((), 0, {"grid_mapping_name": "polar_stereographic"}),
    )
    for name in ("uo", "vo"):
        dataset[name].attrs["grid_mapping"] = "polar: x y"
    return dataset


def _projected_without_its_name(dataset: xarray.Dataset) -> xarray.Dataset:
    dataset = _projected(dataset).drop_vars("polar")
    y, x = np.meshgrid(0.007 * dataset.y / 800.0, 0.012 * dataset.x / 800.0, indexing="ij")
    return dataset.assign_coords(
        lon=(("y", "x"), LONGITUDE + x - 0.3 * y, {"units": "degrees_east"}),
        lat=(("y", "x"), LATITUDE + y + 0.3 * x, {"units": "degrees_north"}),
    )


def _sigma(dataset: xarray.Dataset) -> xarray.Dataset:
    attributes = {"standard_name": "ocean_sigma_coordinate", "axis": "Z"}
    return dataset.rename(depth="sigma").assign_coords(
        sigma=("sigma", [-0.1, -0.5, -0.9], attributes)
    )


def _elsewhere(dataset: xarray.Dataset) -> xarray.Dataset:
    return dataset.assign_coords(longitude=dataset.longitude + 40.0)


def _without_values(dataset: xarray.Dataset) -> xarray.Dataset:
    dataset["uo"][:] = np.nan
    return dataset


def _of_7_m_s(dataset: xarray.Dataset) -> xarray.Dataset:
    dataset["uo"][:] = 7.0
    return dataset


def _with_a_depth_twice(dataset: xarray.Dataset) -> xarray.Dataset:
    depth = ("depth", [0.0, 5.0, 5.0], {"units": "m"})
    return dataset.assign_coords(depth=depth)


MALFORMED: dict[str, tuple[Callable[[Path], None], str]] = {
    "missing": (lambda file: None, "cannot be read: No such file"),
    "text": (_with_content(b"u v\n1 2\n"), "it is no NetCDF file"),
    "truncated": (_truncated, "it cannot be opened as NetCDF"),
    "groups": (
        _in_groups,
        "its variables: none; variables in groups are not read: 'surface', 'deep'",
    ),
    "one component": (_changed(lambda d: d.drop_vars("vo")), "it has no northward velocity"),
    "unit of velocity": (
        _with_attributes("uo", units="knots"),
        "uo has units 'knots'; expected m s-1",
    ),
    "unit of depth": (
        _with_attributes("depth", units="dbar"),
        "depth has units 'dbar'; expected metres",
    ),
    "unit of place": (_with_attributes("longitude", units="radian"), "expected degrees_east and"),
    "no date": (_with_attributes("time", units="hours since the flood"), "is no date such as"),
    "unit of time": (_with_attributes("time", units="fortnights"), "time has units 'fortnights'"),
    "calendar": (_with_attributes("time", calendar="360_day"), "time has the calendar '360_day'"),
    "other days": (
        _with_attributes("time", units="hours since 2020-01-01"),
        "which lasts from 0 to 20 s",
    ),
    "roms": (_changed(_roms), "follow the floor, s_rho (s- or σ-coordinates"),
    "sigma": (_changed(_sigma), "follow the floor, sigma (s- or σ-coordinates"),
    "curvilinear": (_changed(_curvilinear), "its dimension 'y' has no coordinate"),
    "curvilinear, numbered": (
        _changed(_curvilinear_and_numbered),
        "on a curvilinear grid, whose points have their longitudes in nav_lon",
    ),
    "numbered": (_changed(_numbered), "x and y have units '' and ''; expected degrees_east"),
    "rotated": (_changed(_rotated), "rlon has the standard_name 'grid_longitude'; expected axes"),
    "projected": (_changed(_projected), "on the grid of a projection (polar_stereographic)"),
    "projected, unnamed": (
        _changed(_projected_without_its_name),
        "on a curvilinear grid, whose points have their longitudes in lon",
    ),
    "elsewhere": (_changed(_elsewhere), "and none of the mission; set ocean.origin"),
    "dry": (_changed(_without_values), "uo has no values about the mission"),
    "fast": (_changed(_of_7_m_s), "leader meets 7 m/s at 0 s"),
    "twice": (_changed(_with_a_depth_twice), "depth has the same value twice"),
    "small": (
        _changed(lambda d: d.isel(longitude=slice(5, 7))),
        "leaves it at",
    ),
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_malformed_file_is_refused_with_its_fault(tmp_path: Path, name: str) -> None:
    write_file, expected = MALFORMED[name]
    file = tmp_path / "field.nc"
    write_file(file)
    toml = scenario_file(file)
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert expected in result.output
    assert "ocean.current" in result.output
    assert "1 error" in result.output
    # leaving the field, or meeting too fast a current, is a fault of the plan and not of the file
    assert ("field.nc: " in result.output) == (name not in ("fast", "small"))


def test_variables_are_recognised_by_their_standard_names_alone(tmp_path: Path) -> None:
    file = write(model_output().rename(uo="a", vo="b"), tmp_path / "a.nc")
    actual = velocity_of(file, np.array([[0.0, 0.0, -0.5]]), 0.0)
    assert actual[0] == pytest.approx([0.099, -0.09, 0.0], abs=1e-6)


def test_keys_that_contradict_one_another_are_refused(tmp_path: Path) -> None:
    toml = scenario_file(write(model_output(), tmp_path / "a.nc"))
    refused = {
        "ocean.current_speed_m_s=0.1": "the table `current` replaces current_speed_m_s",
        "ocean.current.model=eddy": "needs `file` or `model`, and not both",
        "ocean.current.fiel=3": "did you mean 'file'?",
        "origin_latitude_deg=10": "ocean.origin.latitude_deg = 54.52 and origin_latitude_deg = 10",
    }
    for assignment, expected in refused.items():
        result = CliRunner().invoke(
            app, ["check", str(toml), "--set", assignment], env={"COLUMNS": "300"}
        )
        assert result.exit_code == 2, result.output
        assert expected in result.output
    assert (LATITUDE, LONGITUDE) == (54.52, 18.55)


def test_a_field_of_gigabytes_is_read_as_far_as_it_is_needed(tmp_path: Path) -> None:
    """Nine gigabytes of numbers, of which the file on disk holds those about the mission alone."""
    shape = (24, 40, 800, 1500)
    file = tmp_path / "ocean.nc"
    latitude = LATITUDE + np.linspace(-4.0, 4.0, shape[2])
    longitude = LONGITUDE + np.linspace(-8.0, 8.0, shape[3])
    with h5netcdf.File(file, "w") as whole:
        whole.dimensions = dict(zip(("time", "depth", "lat", "lon"), shape, strict=True))
        axes = {
            "time": (np.arange(24.0), "hours since 2026-07-01"),
            "depth": (np.linspace(0.0, 100.0, shape[1]), "m"),
            "lat": (latitude, "degrees_north"),
            "lon": (longitude, "degrees_east"),
        }
        for name, (values, units) in axes.items():
            axis = whole.create_variable(name, (name,), data=values)
            axis.attrs["units"] = units
        for name in ("uo", "vo"):
            field = whole.create_variable(
                name, tuple(axes), "f8", chunks=(1, 40, 40, 40), fillvalue=np.nan
            )
            field.attrs["units"] = "m s-1"
            rows = slice(shape[2] // 2 - 40, shape[2] // 2 + 40)
            columns = slice(shape[3] // 2 - 40, shape[3] // 2 + 40)
            field[0:2, :, rows, columns] = 0.1
    assert 2 * 8 * math.prod(shape) > 9e9
    assert file.stat().st_size < 50e6
    scenario = laisn_sim.load(scenario_file(file))
    tracemalloc.start()
    field = current_field(SeaSettings.of(scenario))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert field is not None
    assert field.current.grid.velocity.shape[:2] == (2, 40)
    assert peak < 60e6


@pytest.mark.system
def test_the_page_of_a_flight_shows_the_current_along_the_tracks(tmp_path: Path) -> None:
    file = metres_field(tmp_path / "gyre.nc", 25.0, 10.0)
    flight = laisn_sim.fly(scenario_file(file, 60.0))
    speed, direction = flight_figures.current(flight, [0, 1]).parts
    truth = flight.trajectory
    for line, vehicle in zip((speed.lines[1], speed.lines[0]), (0, 1), strict=True):
        east, north, up = truth.position[:, vehicle].T
        u, v = gyre_velocity(east, north, truth.time)
        # it falls to half at 40 m
        expected = np.hypot(u, v) * (1.0 + up / 80.0)
        np.testing.assert_allclose(line.y, expected, atol=0.01)
        assert line.name == truth.names[vehicle]
    east, north, _ = truth.position[0, 0]
    u, v = gyre_velocity(east, north, 0.0)
    assert direction.lines[1].y[0] == pytest.approx(np.rad2deg(np.arctan2(u, v)) % 360.0, abs=3.0)
    arrows = flight_figures.track_map(flight, [0]).parts[0].lines[-1]
    assert arrows.name == "current"
    page = flight.report(tmp_path / "gyre.html").read_text(encoding="utf-8")
    assert "Speed of the water at each vehicle" in page
    uniform = laisn_sim.fly("T5", {"duration_s": 10.0, "ocean.current_speed_m_s": 0.2})
    page = uniform.report(tmp_path / "uniform.html").read_text(encoding="utf-8")
    assert "Speed of the water at each vehicle" not in page
