"""What attributes of NetCDF files say of their values, and what contradicts them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats
from sim.water.casts import read_cast
from sim.water.field_files import (
    CurrentField,
    FieldError,
    FieldOrigin,
    FloorField,
    Source,
    read_current,
    read_floor,
)
from sim.water.region import Region
from tests.sim.water.field_data import LATITUDE, LONGITUDE, START, model_output, write, xarray

ORIGIN = FieldOrigin(LATITUDE, LONGITUDE, START)
REGION = Region(-500.0, 500.0, -500.0, 500.0, 100.0)
# of the field at (0, 0): east [m/s] at the surface, and its fall with depth [m/s a metre]
EAST_AT_SURFACE, EAST_SLOPE = 0.1, -0.002


def read(dataset: Any, folder: Path) -> CurrentField:
    return read_current(Source("current", write(dataset, folder / "a.nc")), ORIGIN, REGION)


def east_at(field: CurrentField, depth: float) -> float:
    """Eastward velocity at (0, 0) and a depth, linear between the levels that were read."""
    grid = field.current.grid
    i = int(np.argmin(np.abs(grid.east)))
    j = int(np.argmin(np.abs(grid.north)))
    return float(np.interp(depth, grid.depth, grid.velocity[0, :, j, i, 0]))


def with_depths(depths: list[float], **attributes: str) -> Any:
    dataset = model_output()
    return dataset.assign_coords(depth=("depth", depths, {"units": "m", **attributes}))


@pytest.mark.parametrize(
    ("sign", "positive", "is_remarked_on"),
    [(1, "down", False), (-1, "up", False), (-1, "down", True), (1, "up", True), (-1, "", False)],
)
def test_depths_of_one_sign_lie_below_the_surface(
    tmp_path: Path, sign: int, positive: str, *, is_remarked_on: bool
) -> None:
    """The field falls linearly with depth, and is known at 20 m."""
    attributes = {"positive": positive} if positive else {}
    field = read(with_depths([sign * 0.5, sign * 10.0, sign * 30.0], **attributes), tmp_path)
    assert east_at(field, 20.0) == pytest.approx(EAST_AT_SURFACE + 20.0 * EAST_SLOPE)
    assert ("taken as depths below the surface" in field.report) == is_remarked_on


@pytest.mark.parametrize(
    ("depths", "attributes", "deepest"),
    [
        ([-0.2, 10.0, 30.0], {"positive": "down"}, 30.0),
        ([0.2, -10.0, -30.0], {"standard_name": "height"}, 30.0),
        ([0.2, -10.0, -30.0], {}, 30.0),
    ],
)
def test_depths_of_both_signs_count_as_positive_says(
    tmp_path: Path, depths: list[float], attributes: dict[str, str], deepest: float
) -> None:
    depth = read(with_depths(depths, **attributes), tmp_path).current.grid.depth
    assert depth[[0, -1]] == pytest.approx([-0.2, deepest])


def test_most_of_the_water_above_the_surface_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FieldError, match=r"expected positive = 'up'"):
        read(with_depths([0.2, -10.0, -30.0], positive="down"), tmp_path)


def test_a_surface_of_heights_is_no_negative_zero(tmp_path: Path) -> None:
    report = read(with_depths([0.0, -10.0, -30.0], positive="up"), tmp_path).report
    assert "3 depths, 0 to 30 m" in report


@pytest.mark.parametrize(
    ("names", "refused"),
    [
        (("eastward_wind", "northward_wind"), "uo has the standard_name 'eastward_wind'"),
        (("surface_downward_eastward_stress", "northward_wind"), "eastward_stress'"),
        (("northward_sea_water_velocity", "eastward_wind"), "it has no eastward velocity"),
    ],
)
def test_other_quantities_are_no_current(
    tmp_path: Path, names: tuple[str, str], refused: str
) -> None:
    dataset = model_output()
    for variable, name in zip(("uo", "vo"), names, strict=True):
        dataset[variable].attrs["standard_name"] = name
    with pytest.raises(FieldError, match=refused):
        read(dataset, tmp_path)


def test_a_part_of_the_current_is_taken_by_its_name(tmp_path: Path) -> None:
    dataset = model_output()
    for variable, axis in (("uo", "eastward"), ("vo", "northward")):
        name = f"{axis}_sea_water_velocity_assuming_no_tide"
        dataset[variable].attrs["standard_name"] = name
    assert east_at(read(dataset, tmp_path), 20.0) == pytest.approx(0.06)


PACKED = {"dtype": "int16", "scale_factor": 0.001, "add_offset": 0.05, "_FillValue": -30000}


@pytest.mark.parametrize(
    ("bounds", "encoding"),
    [
        ({"valid_min": 0.07}, {}),
        ({"valid_range": [0.07, 0.2]}, {}),
        ({"valid_min": 0.07}, PACKED),
        # of the packed numbers: (0.07 - 0.05) / 0.001
        ({"valid_min": np.int16(20)}, PACKED),
        ({"valid_range": np.array([20, 100], dtype=np.int16)}, PACKED),
    ],
)
def test_values_outside_of_the_valid_range_are_missing(
    tmp_path: Path, bounds: dict[str, Any], encoding: dict[str, Any]
) -> None:
    """The field is 0.1, 0.08 and 0.04 m/s at 0, 10 and 30 m; the last becomes that of the level
    above.
    """
    dataset = with_depths([0.0, 10.0, 30.0], positive="down")
    u = np.broadcast_to(np.array([0.1, 0.08, 0.04])[:, None, None], dataset["uo"].shape)
    dataset["uo"] = (dataset["uo"].dims, u, {**dataset["uo"].attrs, **bounds})
    file = tmp_path / "a.nc"
    dataset.to_netcdf(file, engine="h5netcdf", encoding={"uo": encoding} if encoding else {})
    field = read_current(Source("current", file), ORIGIN, REGION)
    assert [east_at(field, depth) for depth in (0.0, 10.0, 30.0)] == pytest.approx(
        [0.1, 0.08, 0.08], abs=1e-6
    )
    assert "0.33 of uo outside of its valid range (at least 0.07" in field.report


def test_rounded_bounds_keep_the_values_at_them(tmp_path: Path) -> None:
    dataset = model_output()
    u = np.float32(0.1) * np.ones(dataset["uo"].shape, dtype=np.float32)
    dataset["uo"] = (dataset["uo"].dims, u, {**dataset["uo"].attrs, "valid_max": 0.1})
    field = read(dataset, tmp_path)
    assert east_at(field, 10.0) == pytest.approx(0.1)
    assert "outside" not in field.report


def test_a_range_that_leaves_nothing_is_refused_with_its_bounds(tmp_path: Path) -> None:
    dataset = model_output()
    dataset["uo"].attrs["valid_min"] = 5.0
    with pytest.raises(FieldError, match=r"no values about the mission.*1 of uo outside of its"):
        read(dataset, tmp_path)


@pytest.mark.parametrize("bounds", [{"valid_min": "low"}, {"valid_range": [1.0, 2.0, 3.0]}])
def test_bounds_that_are_none_are_refused(tmp_path: Path, bounds: dict[str, Any]) -> None:
    dataset = model_output()
    dataset["uo"].attrs.update(bounds)
    with pytest.raises(FieldError, match="expected"):
        read(dataset, tmp_path)


def test_units_that_are_not_stated_are_told(tmp_path: Path) -> None:
    dataset = model_output()
    del dataset["uo"].attrs["units"]
    del dataset["depth"].attrs["units"]
    report = read(dataset, tmp_path).report
    assert "uo without units, taken as m/s" in report
    assert "depth without units, taken as m" in report
    assert "vo without" not in report


def floor_of(folder: Path, values: Floats, **attributes: Any) -> FloorField:
    axis = np.linspace(-1000.0, 1000.0, values.shape[0])
    dataset = xarray.Dataset(
        {"depth": (("y", "x"), values, attributes)},
        {"y": ("y", axis, {"units": "m"}), "x": ("x", axis, {"units": "m"})},
    )
    file = write(dataset, folder / "floor.nc")
    return read_floor(Source("floor", file), ORIGIN, REGION)


def test_floors_mind_their_attributes(tmp_path: Path) -> None:
    values = np.full((5, 5), 20.0)
    assert "depth without units, taken as m" in floor_of(tmp_path, values).report
    with pytest.raises(FieldError, match=r"outside of its valid range .at most 10., missing"):
        floor_of(tmp_path, values, units="m", valid_max=10.0)
    with pytest.raises(FieldError, match="standard_name 'model_level_number_at_sea_floor'"):
        floor_of(tmp_path, values, units="m", standard_name="model_level_number_at_sea_floor")


def cast_of(folder: Path, depth: list[float], **temperature: Any) -> Any:
    """A cast of 10 °C and 35 psu."""
    dataset = xarray.Dataset(
        {
            "temp": ("depth", np.array([10.0, 10.0, 99.0]), {"units": "degC", **temperature}),
            "salinity": ("depth", np.full(3, 35.0), {"units": "1"}),
        },
        {"depth": ("depth", depth, {"units": "m", "positive": "down"})},
    )
    return read_cast(Source("sound_speed", write(dataset, folder / "cast.nc")), ORIGIN)


def test_casts_mind_their_attributes(tmp_path: Path) -> None:
    cast = cast_of(tmp_path, [0.0, -10.0, -20.0], valid_max=40.0)
    # the last level is missing; of the others the lower one is faster by 0.0163 m/s a metre
    assert cast.points[:, 0] == pytest.approx([0.0, 10.0])
    assert np.diff(cast.points[:, 1]) == pytest.approx([0.163], abs=0.01)
    assert "taken as depths below the surface" in cast.report
    assert "temp outside of its valid" in cast.report
    with pytest.raises(FieldError, match="temp has the standard_name 'air_temperature'"):
        cast_of(tmp_path, [0.0, 10.0, 20.0], standard_name="air_temperature")


def test_a_temperature_is_the_one_that_its_standard_name_says(tmp_path: Path) -> None:
    """At 1000 dbar a potential temperature of 10 °C is one of 10.12 °C in situ, whose sound is
    faster by 0.4 m/s.
    """
    names = ("sea_water_temperature", "sea_water_potential_temperature")
    in_situ, potential = (
        cast_of(tmp_path, [0.0, 990.0, 1000.0], standard_name=name, valid_max=40.0).points[1, 1]
        for name in names
    )
    assert potential - in_situ == pytest.approx(0.43, abs=0.1)
