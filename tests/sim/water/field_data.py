"""NetCDF files for tests, and the closed form that is in them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats

# the packages of the extra `fields`, without which files cannot be read
xarray = pytest.importorskip("xarray")
pytest.importorskip("h5netcdf")

START = "2026-07-01T00:00:00+00:00"
LATITUDE, LONGITUDE = 54.52, 18.55
# metres of a degree there, by the series in latitude (Snyder, Map Projections, 1987, of WGS 84)
_PHI = np.deg2rad(LATITUDE)
DEGREE_EAST = 111412.84 * np.cos(_PHI) - 93.5 * np.cos(3 * _PHI) + 0.118 * np.cos(5 * _PHI)
DEGREE_NORTH = 111132.954 - 559.822 * np.cos(2 * _PHI) + 1.175 * np.cos(4 * _PHI)
GYRE_SPEED = 0.2  # scale of the velocities of the gyre [m/s]
GYRE_WIDTH = 1000.0  # of one cell of the gyre [m]
GYRE_PERIOD = 400.0  # of its sway [s]

SCENARIO = """\
duration_s = {duration}
[ocean]
origin = {{ lat = {latitude}, lon = {longitude}, time = "{start}" }}
[ocean.current]
file = "{file}"
[[followers]]
route = "T5"
"""


def gyre_velocity(east: Floats, north: Floats, time: Floats | float) -> tuple[Floats, Floats]:
    """Velocity of a double gyre whose middle sways (Shadden, Lekien and Marsden, Physica D 212,
    2005, example 1), scaled to metres; its cells lie about (0, 0).
    """
    x = (east + GYRE_WIDTH) / GYRE_WIDTH
    y = (north + 0.5 * GYRE_WIDTH) / GYRE_WIDTH
    a = 0.25 * np.sin(2.0 * np.pi * time / GYRE_PERIOD)
    b = 1.0 - 2.0 * a
    f = a * x**2 + b * x
    slope = 2.0 * a * x + b
    u = -GYRE_SPEED * np.sin(np.pi * f) * np.cos(np.pi * y)
    v = GYRE_SPEED * np.cos(np.pi * f) * np.sin(np.pi * y) * slope
    return u, v


def metres_field(
    file: Path, spacing: float, interval: float, end_time: float = 200.0, **attributes: Any
) -> Path:
    """The gyre on a grid in metres, at two depths between which it falls to half."""
    east = np.arange(-1500.0, 1500.1, spacing)
    north = np.arange(-1500.0, 1500.1, spacing)
    time = np.arange(0.0, end_time + 0.1, interval)
    t, y, x = np.meshgrid(time, north, east, indexing="ij")
    components = np.stack(gyre_velocity(x, y, t))
    depth_factor = np.array([1.0, 0.5])[None, None, :, None, None]
    u, v = depth_factor * components[:, :, None]
    units = {"units": "m s-1", **attributes}
    dims = ("time", "depth", "y", "x")
    xarray.Dataset(
        {
            "u": (dims, u, {"standard_name": "eastward_sea_water_velocity", **units}),
            "v": (dims, v, {"standard_name": "northward_sea_water_velocity", **units}),
        },
        {
            "time": ("time", time, {"units": "s"}),
            "depth": ("depth", np.array([0.0, 40.0]), {"units": "m", "positive": "down"}),
            "y": ("y", north, {"units": "m"}),
            "x": ("x", east, {"units": "m"}),
        },
    ).to_netcdf(file, engine="h5netcdf")
    return file


def model_output() -> xarray.Dataset:
    """A field as CMEMS has it: linear in longitude, latitude, depth and time."""
    time = np.arange(0.0, 3.1)
    depth = np.array([0.5, 10.0, 30.0])
    latitude = LATITUDE + np.linspace(-0.03, 0.03, 13)
    longitude = LONGITUDE + np.linspace(-0.05, 0.05, 11)
    t, z, y, x = np.meshgrid(time, depth, latitude, longitude, indexing="ij")
    u = 0.1 + 2.0 * (x - LONGITUDE) - 0.002 * z
    v = -0.1 + 3.0 * (y - LATITUDE) + 0.01 * t
    dims = ("time", "depth", "latitude", "longitude")
    names = ("eastward_sea_water_velocity", "northward_sea_water_velocity")
    return xarray.Dataset(
        {
            "uo": (dims, u, {"standard_name": names[0], "units": "m s-1"}),
            "vo": (dims, v, {"standard_name": names[1], "units": "m s-1"}),
        },
        {
            "time": ("time", time, {"units": "hours since 2026-06-30 23:00:00"}),
            "depth": ("depth", depth, {"units": "m", "positive": "down"}),
            "latitude": ("latitude", latitude, {"units": "degrees_north"}),
            "longitude": ("longitude", longitude, {"units": "degrees_east"}),
        },
    )


def write(dataset: xarray.Dataset, file: Path, engine: Any = "h5netcdf") -> Path:
    """Write a dataset as it is."""
    dataset.to_netcdf(file, engine=engine)
    return file


def scenario_file(file: Path, duration: float = 20.0, origin: str = "") -> Path:
    """A mission in the current of a file beside it; `origin` is TOML before that table."""
    toml = file.parent / f"{file.stem}.toml"
    scenario_text = SCENARIO.format(
        duration=duration, latitude=LATITUDE, longitude=LONGITUDE, start=START, file=file.name
    )
    toml.write_text(scenario_text.replace("[ocean.current]", f"{origin}[ocean.current]"))
    return toml
