"""Floors out of files: grounding, echoes and what is refused."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn.arrays import Floats
from laisn_sim.cli.errors import MISSION_FAILED
from laisn_sim.cli.main import app
from reports.flight_report import scene_of_flight
from sim.film.cameras import CameraRig
from sim.film.film_data import FilmData
from sim.film.scene import Sea, build
from sim.flight import FlightRecord, Termination
from sim.scenario.parts import SeaSettings, SoundSettings
from sim.water.assembly import floor_of, rays_of, sea_of_keys
from sim.water.grids import GriddedFloor
from tests.reports.test_scene import arrays_of
from tests.sim.water.field_data import DEGREE_EAST, DEGREE_NORTH, LATITUDE, LONGITUDE, write, xarray
from tests.synthetic import make_flight

SCENARIO = f"""\
duration_s = {{duration}}
[ocean]
origin = {{{{ lat = {LATITUDE}, lon = {LONGITUDE} }}}}
[ocean.floor]
file = "floor.nc"
[[followers]]
route = "T5"
"""
# too heavy for its fins and thrusters to hold its depth
SINKING_LEADER = "[leader]\nexcess_buoyancy_n = -100.0\ncg_offset_x_m = 0.2\n"


def slope_depth(east: Floats | float, north: Floats | float) -> Floats:
    return np.asarray(15.0 + 0.02 * np.asarray(east) - 0.01 * np.asarray(north))


def metres_floor(depth: Floats, east: Floats, north: Floats) -> xarray.Dataset:
    return xarray.Dataset(
        {"depth": (("y", "x"), depth, {"units": "m"})},
        {"y": ("y", north, {"units": "m"}), "x": ("x", east, {"units": "m"})},
    )


def slope() -> xarray.Dataset:
    axis = np.arange(-1200.0, 1200.1, 100.0)
    y, x = np.meshgrid(axis, axis, indexing="ij")
    return metres_floor(np.maximum(slope_depth(x, y), 0.5), axis, axis)


def gebco() -> xarray.Dataset:
    """Elevations, positive up, on the map, from the north, as GEBCO has them."""
    latitude = LATITUDE + np.linspace(0.02, -0.02, 41)
    longitude = LONGITUDE + np.linspace(-0.03, 0.03, 61)
    y, x = np.meshgrid(latitude, longitude, indexing="ij")
    depth = slope_depth((x - LONGITUDE) * DEGREE_EAST, (y - LATITUDE) * DEGREE_NORTH)
    standard = {"standard_name": "height_above_reference_ellipsoid", "units": "m"}
    return xarray.Dataset(
        {"elevation": (("lat", "lon"), -np.maximum(depth, 0.5), standard)},
        {
            "lat": ("lat", latitude, {"units": "degrees_north"}),
            "lon": ("lon", longitude, {"units": "degrees_east"}),
        },
    )


def scenario(
    folder: Path, dataset: xarray.Dataset, duration: float = 20.0, more_toml: str = ""
) -> Path:
    write(dataset, folder / "floor.nc")
    toml = folder / "mission.toml"
    toml.write_text(SCENARIO.format(duration=duration) + more_toml)
    return toml


@pytest.mark.parametrize("dataset", [slope(), gebco()], ids=["metres", "GEBCO"])
def test_depths_of_a_sloping_floor_are_those_of_the_file(
    tmp_path: Path, dataset: xarray.Dataset
) -> None:
    toml = scenario(tmp_path, dataset)
    floor = floor_of(SeaSettings.of(laisn_sim.load(toml)))
    points = np.random.default_rng(1).uniform(-300.0, 300.0, (50, 2))
    np.testing.assert_allclose(floor.depths_at(*points.T), slope_depth(*points.T), atol=1e-4)
    assert floor.depth_at(*points[0]) == floor.depths_at(*points[0])
    result = CliRunner().invoke(app, ["check", str(toml)])
    assert "ocean.floor: floor.nc: " in result.stdout


@pytest.mark.system
def test_a_vehicle_grounds_on_the_slope(tmp_path: Path) -> None:
    toml = scenario(tmp_path, slope(), 300.0, SINKING_LEADER)
    arguments = ["fly", str(toml), "--no-video", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == MISSION_FAILED, result.output
    assert "leader goes below the sea floor" in result.stdout
    flight = laisn_sim.read_log(tmp_path / "out" / "flight.mcap")
    assert flight.outcome is Termination.GROUNDED
    east, north, up = flight.trajectory.position[:, 0].T
    height_above_floor = slope_depth(east, north) + up
    assert height_above_floor[-1] < 0.0
    assert (height_above_floor[:-1] >= 0.0).all()


def test_a_level_floor_of_a_file_is_that_of_the_key(tmp_path: Path) -> None:
    axis = np.array([-2000.0, 2000.0])
    acoustics = "[acoustics]\nbottom_echo_probability = 0.5\ntravel_time = true\n"
    by_file = laisn_sim.fly(
        scenario(tmp_path, metres_floor(np.full((2, 2), 25.0), axis, axis), 20.0, acoustics)
    )
    keys = {"ocean.floor_depth_m": 25.0, "acoustics.travel_time": True}
    by_key = laisn_sim.fly(
        "T5", {"duration_s": 20, "acoustics.bottom_echo_probability": 0.5} | keys
    )
    np.testing.assert_array_equal(by_file.trajectory.pose, by_key.trajectory.pose)
    np.testing.assert_allclose(
        by_file.measurements[0].ranges, by_key.measurements[0].ranges, atol=1e-9
    )


def test_echoes_come_from_where_the_floor_reflects_them(tmp_path: Path) -> None:
    """From the image of the source in the plane of the slope, whose normal is (0.02, −0.01, 1)."""
    rays = rays_of(SoundSettings.of(laisn_sim.load(scenario(tmp_path, slope()))))
    source, receiver = np.array([10.0, -40.0, -3.0]), np.array([150.0, 60.0, -9.0])
    normal = np.array([0.02, -0.01, 1.0])
    image = source - 2.0 * (normal @ source + 15.0) / (normal @ normal) * normal
    expected = float(np.linalg.norm(receiver - image))
    ray = rays.ray(2, tuple(source), tuple(receiver))
    assert ray.length == pytest.approx(expected, abs=1e-9)
    assert ray.time == pytest.approx(expected / 1500.0, abs=1e-12)
    assert ray.elevation < 0.0


def test_a_plan_into_the_floor_is_refused(tmp_path: Path) -> None:
    axis = np.array([-2000.0, 2000.0])
    toml = scenario(tmp_path, metres_floor(np.full((2, 2), 10.5), axis, axis))
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == 2
    assert "followers[0] would ground at 0 s" in result.output
    assert "the floor lies at 10.5 m there" in result.output


@pytest.mark.parametrize(("depth", "below"), [(39.0, False), (41.0, True)])
def test_beacons_lie_above_the_floor_of_a_file(tmp_path: Path, depth: float, below: bool) -> None:
    """The key `floor_depth_m`, by default 30 m, says nothing of a floor from a file."""
    axis = np.array([-2000.0, 2000.0])
    beacon_link = f'[[links]]\nname = "lbl"\nbeacons_m = [[100.0, 50.0, {depth}]]\n'
    toml = scenario(
        tmp_path, metres_floor(np.full((2, 2), 40.0), axis, axis), more_toml=beacon_link
    )
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == (2 if below else 0), result.output
    assert ("below the floor of ocean.floor.file, which lies at 40 m" in result.output) == below


@pytest.mark.parametrize(("depth", "below"), [(59.0, False), (61.0, True)])
def test_beyond_what_was_read_of_a_floor_beacons_lie_above_that_of_its_edge(
    tmp_path: Path, depth: float, below: bool
) -> None:
    """As sound has it there: 40 m in the west, 60 m in the east."""
    axis = np.array([-200.0, 200.0])
    beacon_link = f'[[links]]\nname = "lbl"\nbeacons_m = [[900.0, 50.0, {depth}]]\n'
    toml = scenario(
        tmp_path, metres_floor(np.array([[40.0, 60.0]] * 2), axis, axis), more_toml=beacon_link
    )
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == (2 if below else 0), result.output
    assert (
        "below the floor of ocean.floor.file, which lies at 60 m there; that is the depth of its "
        "edge, as -200 to 200 m east and -200 to 200 m north of the origin were read of it"
        in result.output
    ) == below


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: d.rename(depth="salinity"), "it has no elevation or depth of the floor"),
        (lambda d: d.assign(depth=-d.depth), "lies above the water everywhere"),
        (lambda d: d.assign(depth=d.depth.where(d.x < 0.0)), "has no value at"),
        (lambda d: d.isel(y=[12]).squeeze("y"), "has no axis of latitude or north"),
        (lambda d: d.assign_coords(x=d.x + 9e4), "and none of the mission"),
        (
            lambda d: d.assign(
                depth=d.depth.assign_attrs(grid_mapping="utm"),
                utm=((), 0, {"grid_mapping_name": "transverse_mercator"}),
            ),
            "depth is on the grid of a projection (transverse_mercator)",
        ),
    ],
)
def test_unusable_floors_are_refused_with_the_reason(tmp_path: Path, change, expected: str) -> None:  # type: ignore[no-untyped-def]
    toml = scenario(tmp_path, change(slope()))
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert "ocean.floor.file: " in result.output
    assert expected in result.output


def hills() -> xarray.Dataset:
    axis = np.arange(-2000.0, 2000.1, 50.0)
    y, x = np.meshgrid(axis, axis, indexing="ij")
    return metres_floor(60.0 + 10.0 * np.sin(x / 150.0) - 8.0 * np.cos(y / 120.0), axis, axis)


def flight_over_hills(folder: Path) -> FlightRecord:
    return laisn_sim.fly(scenario(folder, hills()), {"motion": "kinematic"})


def test_the_page_in_3d_holds_the_floor_as_read(tmp_path: Path) -> None:
    flight = flight_over_hills(tmp_path)
    scene = scene_of_flight(flight)
    seabed = scene.meta["seabed"]
    heights = arrays_of(scene)["seabed"]
    n = seabed["points"]
    east = np.linspace(seabed["west"], seabed["east"], n)
    north = np.linspace(seabed["south"], seabed["north"], n)
    assert east[0] < flight.trajectory.position[..., 0].min() - 100.0
    assert north[-1] > flight.trajectory.position[..., 1].max() + 100.0
    for row, column in ((0, 0), (10, 40), (n - 1, 3)):
        # linear between the points of the file, 50 m apart
        expected = 60.0 + 10.0 * np.sin(east[column] / 150.0) - 8.0 * np.cos(north[row] / 120.0)
        assert heights[row, column] == pytest.approx(-expected, abs=0.3)
    assert scene_of_flight(make_flight(20.0)).meta["seabed"] is None


def test_the_film_shows_the_floor_as_read(tmp_path: Path) -> None:
    flight = flight_over_hills(tmp_path)
    floor = floor_of(SeaSettings.of(flight.scenario))
    assert isinstance(floor, GriddedFloor)
    model = build(flight, 64, 48)
    sea = Sea(model, sea_of_keys(flight.scenario.ocean, flight.scenario.seed), floor)
    x, y = sea.grid(np.array([130.0, -70.0]), 100.0)
    field = sea.place_floor(floor, x, y)
    assert field == model.geom_dataid[model.geom("seabed").id]
    model.geom_pos[model.geom("seabed").id, :2] = x.mean(), y.mean()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for east, north in ((x[10], y[30]), (x[20], y[5]), (x[40], y[40])):
        geom = np.zeros(1, np.int32)
        start = np.array([east + 1e-3, north + 1e-3, -30.0])
        down = np.array([0.0, 0.0, -1.0])
        ray_length = mujoco.mj_ray(model, data, start, down, None, 1, -1, geom)
        assert geom[0] == model.geom("seabed").id
        assert 30.0 + ray_length == pytest.approx(floor.depth_at(east, north), abs=0.05)


def test_a_camera_stays_within_3_m_above_the_floor(tmp_path: Path) -> None:
    """Also where it is put far below the floor, at a valley and at a hilltop."""
    flight = flight_over_hills(tmp_path)
    rig = CameraRig(FilmData(flight, 20.0), 16 / 9)
    for point in ((235.0, 377.0), (-235.0, 0.0)):
        position = rig._in_water(np.array([*point, -200.0]))
        depth = floor_of(SeaSettings.of(flight.scenario)).depth_at(*point)
        assert -depth < position[2] < -depth + 3.0
