"""Vehicles of one plant side by side: each moves as it does alone, to the bit."""

from dataclasses import replace

import numpy as np
import pytest

from laisn.simd import LANES
from sim.scenario.vehicles import Vehicle
from sim.vehicle import lanes
from sim.vehicle.lanes import FleetHandles
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant, PlantError
from sim.vehicle.solvers import Engine
from sim.water.densities import DensityProfile
from sim.water.grids import CurrentGrid, GriddedCurrent
from sim.water.ocean import Ocean
from sim.water.waves import Waves

CALM = Ocean(current_speed_m_s=0.3, current_direction_rad=1.0, current_shear_1_s=0.01)
MIXED = ("remus100", *["follower"] * 4, "leader", *["follower"] * 6, "remus100")
"""Eleven hulls with thrusters, in two rows of eight lanes of which the second is not full, and two
hulls with propeller and fins, too few for lanes.
"""


def rough_sea() -> Ocean:
    waves = Waves.jonswap(np.random.default_rng(1), significant_height_m=0.5, peak_period_s=4.0)
    return Ocean(current_speed_m_s=0.2, current_direction_rad=2.0, waves=waves)


def stratified_field() -> Ocean:
    """A current on a grid that changes in space and time, with an upward part, in water whose
    density grows with depth, under waves. Some of the hulls are beyond the grid.
    """
    rng = np.random.default_rng(2)
    axes = (
        np.array([0.0, 5.0, 12.0]),
        np.array([0.0, 6.0, 15.0]),
        np.linspace(-20.0, 40.0, 7),
        np.linspace(-20.0, 160.0, 10),
    )
    velocity = 0.3 * rng.standard_normal((*(axis.size for axis in axes), 3))
    return replace(
        rough_sea(),
        current=GriddedCurrent(CurrentGrid(*axes, velocity)),
        density=DensityProfile.through([[0.0, 1004.0], [10.0, 1005.0], [30.0, 1011.0]]),
    )


def fleet(models: tuple[str, ...] = MIXED, ocean: Ocean = CALM, engine: Engine = "direct") -> Plant:
    """Hulls with different scales, headings and buoyancy, each deeper than the one before."""
    setups = [
        VehicleSetup(
            name=f"hull{i}",
            model=model,
            position_m=(20.0 * i, 5.0 * i, -0.1 - 2.0 * i),
            heading_rad=0.4 * i,
            speed_m_s=1.0,
            settings=Vehicle.model_construct(
                added_mass_scale=1.0 + 0.02 * i,
                drag_scale=1.0 - 0.03 * i,
                thrust_scale=1.0 + 0.01 * i,
                excess_buoyancy_n=0.5 * i,
            ),
        )
        for i, model in enumerate(models)
    ]
    return Plant(setups, ocean, 0.02, engine)


def steer(plant: Plant, steps: int) -> None:
    """Commands that change every five steps, as those of a mission."""
    rng = np.random.default_rng(3)
    limits = plant.effectors["limits"][..., 1]
    for _ in range(steps):
        plant.step(rng.uniform(-0.3, 0.6, limits.shape) * limits, 5)


def fleets_in_lanes_and_one_by_one(
    monkeypatch: pytest.MonkeyPatch, ocean: Ocean = CALM
) -> tuple[Plant, Plant]:
    """A fleet whose vehicles move side by side in lanes, and the same fleet one after the other."""
    in_lanes = fleet(ocean=ocean)
    # no row has more vehicles than lanes, so that none is moved in lanes
    monkeypatch.setattr(lanes, "MAX_ALONE", LANES)
    one_by_one = fleet(ocean=ocean)
    assert isinstance(in_lanes.step_handles(), FleetHandles)
    assert not isinstance(one_by_one.step_handles(), FleetHandles)
    return in_lanes, one_by_one


def require_same_state(first: Plant, second: Plant) -> None:
    assert first.time == second.time
    for name in ("pose", "twist", "effector_states"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)


def test_hulls_that_differ_in_numbers_alone_lie_in_rows_of_lanes() -> None:
    """Eight to a row, the rest of the last row filled with its first vehicle."""
    handles = fleet().step_handles()
    assert isinstance(handles, FleetHandles)
    assert handles.vehicles.tolist() == [[1, 2, 3, 4, 5, 6, 7, 8], [9, 10, 11, 9, 9, 9, 9, 9]]
    assert handles.rest.vehicles.tolist() == [0, 12]


def test_few_vehicles_and_those_of_mujoco_move_alone() -> None:
    for plant in (fleet(("leader", "follower")), fleet(engine="mujoco")):
        assert not isinstance(plant.step_handles(), FleetHandles)


@pytest.mark.system
@pytest.mark.parametrize(
    "ocean", [CALM, rough_sea(), stratified_field()], ids=["calm", "waves", "field and profile"]
)
def test_vehicles_of_one_plant_move_as_each_does_alone(
    ocean: Ocean, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_lanes, one_by_one = fleets_in_lanes_and_one_by_one(monkeypatch, ocean)
    for plant in (in_lanes, one_by_one):
        steer(plant, 200)
    require_same_state(in_lanes, one_by_one)


@pytest.mark.system
def test_propellers_astern_move_in_lanes_as_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hulls that are braked, go astern, and are braked again: all quadrants of a propeller."""
    plants = []
    for max_alone in (lanes.MAX_ALONE, 2 * LANES):
        monkeypatch.setattr(lanes, "MAX_ALONE", max_alone)
        plants.append(fleet(("remus100",) * 9))
    in_lanes, one_by_one = plants
    assert isinstance(in_lanes.step_handles(), FleetHandles)
    assert not isinstance(one_by_one.step_handles(), FleetHandles)
    command = np.zeros((9, 5))
    signs = set()
    for share in (-1.0, 0.8):
        command[:, 0] = share * np.linspace(5.0, 20.0, 9)
        for _ in range(300):
            for plant in plants:
                plant.step(command, 5)
            rates = np.sign(in_lanes.effector_states[:, 0])
            headings = 0.4 * np.arange(9)
            along = (
                np.cos(headings) * in_lanes.twist[:, 1] + np.sin(headings) * in_lanes.twist[:, 0]
            )
            signs.update(zip(rates, np.sign(along), strict=True))
    require_same_state(in_lanes, one_by_one)
    assert len(signs) >= 4


def message_of_failed_step(plant: Plant, command: np.ndarray) -> str:
    with pytest.raises(PlantError) as failure:
        plant.step(command, 100)
    return str(failure.value)


@pytest.mark.system
@pytest.mark.parametrize("hull", [0, 3, 10])
def test_failures_are_reported_as_of_vehicles_alone(
    hull: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command that is NaN, and a speed beyond all bounds, of a vehicle in no row, in the first
    and in the second.
    """
    plants = fleets_in_lanes_and_one_by_one(monkeypatch)
    for plant in plants:
        steer(plant, 2)
    command = np.zeros(plants[0].effector_states.shape)
    command[hull, 0] = np.nan
    messages = [message_of_failed_step(plant, command) for plant in plants]
    assert messages[0] == messages[1]
    assert messages[0].startswith(f"t = 0.200 s: the command of hull{hull} is not finite")
    for plant in plants:
        plant.twist[hull, 3] = 900.0
    messages = [message_of_failed_step(plant, np.zeros(command.shape)) for plant in plants]
    assert messages[0] == messages[1]
    assert f"the state of hull{hull} is lost" in messages[0]
    require_same_state(*plants)
