"""Records own their arrays: their source arrays stay writable, and the record is read-only."""

import ast
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from laisn.navigator import Navigator
from reports.range_budget import range_error_budget
from sim.assembly import routes_of
from sim.film.film_data import OtherEstimate, RayErrors
from sim.flight import navigate
from sim.scenario.parts import MissionPlan, SeaSettings, SensingSettings
from sim.scenario.settings import Acoustics, Follower, OceanTable, Scenario, WavesTable
from sim.sensing.acoustics import sound_of
from sim.sensing.observation import observe
from sim.simulation import simulate_motion
from sim.water.assembly import ocean_of

ROOT = Path(__file__).resolve().parents[2]
NOT_FROZEN = ("sim/log/", "sim/gazebo/", "sim/datasets/table_", "laisn/rivals/speed_modes.py")
"""Dataclasses of files, which grow while they are read, and the state of a filter."""


def dataclasses_of(package: str) -> Iterator[tuple[str, dict[str, bool]]]:
    """Every dataclass of a package, with the options that it is made with."""
    for path in sorted((ROOT / package).rglob("*.py")):
        source = path.read_bytes()
        # to parse a source takes long
        if b"dataclass" not in source:
            continue
        for node in ast.walk(ast.parse(source)):
            for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else ():
                call = decorator if isinstance(decorator, ast.Call) else ast.Call(decorator, [], [])
                if isinstance(call.func, ast.Name) and call.func.id == "dataclass":
                    options = {
                        k.arg or "": isinstance(k.value, ast.Constant) and bool(k.value.value)
                        for k in call.keywords
                    }
                    yield f"{path.relative_to(ROOT)}: {node.name}", options  # type: ignore[attr-defined]


@pytest.mark.parametrize("package", ["laisn", "sim", "experiments"])
def test_records_are_frozen_and_made_by_name(package: str) -> None:
    actual = dict(dataclasses_of(package))
    assert len(actual) > 5
    wrong = [
        name
        for name, options in actual.items()
        if not (options.get("frozen") and options.get("kw_only"))
    ]
    assert [name for name in wrong if not name.startswith(NOT_FROZEN)] == []


def new_records() -> dict[str, Any]:
    """One of each kind."""
    scenario = Scenario(
        name="T5",
        motion="kinematic",
        duration_s=4.0,
        followers=(Follower(route="T5"),),
        acoustics=Acoustics(surface_echo_probability=0.1, travel_time=True),
        ocean=OceanTable(waves=WavesTable(kind="jonswap", height_m=0.5, period_s=6.0)),
    )
    trajectory = simulate_motion(scenario)
    flight = navigate(scenario, trajectory, Navigator)
    route = routes_of(MissionPlan.of(scenario))[1]
    all_records = (
        trajectory,
        observe(trajectory, SensingSettings.of(scenario)),
        flight.measurements[0],
        flight.estimates[0],
        range_error_budget(flight),
        route,
        route.depth,
        ocean_of(SeaSettings.of(scenario)).waves,
        sound_of(SensingSettings.of(scenario)).rays.profile,
        OtherEstimate(label="other", colour=(0.0, 0.0, 0.0), position=np.zeros((4, 2))),
        RayErrors(label="error", value=np.zeros((4, 3)), limit=1.0),
    )
    return {type(record).__name__: record for record in all_records}


@pytest.fixture(scope="module")
def records_by_kind() -> dict[str, Any]:
    return new_records()


@pytest.mark.parametrize(
    "name",
    [
        "Trajectory",
        "IdealMeasurements",
        "Measurements",
        "Estimates",
        "RangeErrorBudget",
        "Route",
        "DepthProfile",
        "Waves",
        "OtherEstimate",
        "RayErrors",
    ],
)
def test_a_record_shares_no_array_with_its_caller(
    records_by_kind: dict[str, Any], name: str
) -> None:
    record = records_by_kind[name]
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    passed_arrays = {
        key: value.copy() for key, value in values.items() if isinstance(value, np.ndarray)
    }
    assert passed_arrays
    other = replace(record, **{key: value[...] for key, value in passed_arrays.items()})
    for key, value in passed_arrays.items():
        value[...] = 7
        stored = getattr(other, key)
        # of records as well, whose NaNs NumPy takes for unequal
        assert stored.tobytes() == values[key].tobytes()
        with pytest.raises(ValueError, match="read-only"):
            stored[...] = 7
        with pytest.raises(ValueError, match="cannot set WRITEABLE"):
            values[key][...].flags.writeable = True


def test_read_only_arrays_are_shared(records_by_kind: dict[str, Any]) -> None:
    record = records_by_kind["Measurements"]
    assert np.shares_memory(replace(record, dt=0.2).speed, record.speed)
    n = record.speed.size
    table = np.zeros((3, n))
    row_of_table, strided = table[0], np.zeros((n, 2))
    for array in (row_of_table, strided):
        array.flags.writeable = False
    # the owner of the whole array can write its rows
    other = replace(record, speed=row_of_table, depth=strided[:, 1])
    table[...] = 7
    assert not other.speed.any()
    # compiled code takes arrays in one piece
    assert other.depth.flags.forc
