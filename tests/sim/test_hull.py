"""What is kept of hulls for later missions is used for the settings alone that it was made of."""

from itertools import count

import numpy as np
import pytest

from laisn.errors import LaisnError
from sim import feasibility
from sim.feasibility import SpeedRange
from sim.hull import (
    HULL_KEYS,
    SCALE_KEYS,
    Hull,
    calm_plant,
    hull_of,
    limits_of,
    top_speed_of,
)
from sim.scenario.parts import MotionSettings
from sim.scenario.routes import library_route
from sim.scenario.settings import OceanTable, Scenario, Vehicle
from sim.vehicle.effector_kinds import Thruster

CHANGED_KEYS = {
    "model": "leader",
    "depth_control": "thrust",
    "roll_control": "free",
    "cg_offset_x_m": 0.02,
    "cg_offset_z_m": -0.01,
    "drag_scale": 1.3,
    "added_mass_scale": 0.8,
    "lift_scale": 1.2,
    "thrust_scale": 0.9,
    "trim": "neutral",
    "excess_buoyancy_n": 60.0,
}
SPEEDS = SpeedRange(slowest=0.4, fastest=1.2, mean=0.8)


def hull_with(step_s: float = 0.02, density: float = 1000.0, **keys: object) -> Hull:
    # in fresh water a trim makes a difference
    values = {"model": "follower", "excess_buoyancy_n": 500.0} | keys
    return Hull(Vehicle.model_construct(**values), step_s, density)


def changed_hulls() -> list[Hull]:
    """A hull, and others of which each differs from it in one setting."""
    hulls = [hull_with(), hull_with(step_s=0.05), hull_with(density=1026.0)]
    return hulls + [hull_with(**{key: value}) for key, value in CHANGED_KEYS.items()]


def test_a_hull_has_all_keys_on_which_its_motion_depends() -> None:
    assert {*HULL_KEYS, "model"} == {*CHANGED_KEYS}
    defaults = {key: Vehicle.model_fields[key].default for key in HULL_KEYS}
    for key, value in CHANGED_KEYS.items():
        follower = {"name": "f", "route": "T5", key: value}
        scenario = Scenario.model_validate({"name": "s", "followers": (follower,)})
        hull = hull_of(MotionSettings.of(scenario), scenario.followers[0])
        values = {each: getattr(hull.settings, each) for each in CHANGED_KEYS}
        # a vehicle has the text of its model in place of the name
        changed = {key: getattr(scenario.followers[0], key)}
        assert values == {"model": "follower"} | defaults | changed


def test_a_design_depends_on_no_scale() -> None:
    """Nor does anything else that checks read of a hull as it is designed."""
    for hull in changed_hulls():
        plant, designs = calm_plant(hull)
        plant_as_designed, designs_as_designed = calm_plant(hull.as_designed)
        assert designs.tobytes() == designs_as_designed.tobytes()
        for name in ("coefficients", "effectors", "fixed_fins"):
            expected = getattr(plant, name).tobytes()
            assert getattr(plant_as_designed, name).tobytes() == expected
        for name in ("body_mass", "body_ipos", "body_inertia", "body_iquat"):
            expected = getattr(plant.model, name)
            np.testing.assert_array_equal(getattr(plant_as_designed.model, name), expected)
        np.testing.assert_array_equal(
            plant.true_coefficients["buoyancy"], plant_as_designed.coefficients["buoyancy"]
        )


def test_a_hull_as_it_is_designed_differs_in_its_scales_alone() -> None:
    nominal = {key: Vehicle.model_fields[key].default for key in SCALE_KEYS}
    for hull in changed_hulls():
        values = {key: getattr(hull.settings, key) for key in CHANGED_KEYS} | nominal
        expected = hull_with(hull.physics_step_s, hull.density_kg_m3, **values)
        assert hull.as_designed == expected


def test_scales_that_an_effector_refuses_are_an_error_of_the_vehicle(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As of a kind of the user's own, whose `scale` may raise."""

    def refuse(_kind: Thruster, _record: object, thrust_ratio: float, _lift_ratio: float) -> None:
        if thrust_ratio != 1.0:
            raise LaisnError(f"no thrust of {thrust_ratio:g}")

    monkeypatch.setattr(Thruster, "scale", refuse)
    # no other test has a plant with this scale, which would be kept
    follower = {"name": "f", "route": "T5", "thrust_scale": 0.8123}
    scenario = Scenario.model_validate({"name": "s", "followers": (follower,)})
    assert feasibility.infeasibilities(scenario) == ["followers[0]: no thrust of 0.8123"]


def refuse_with_numbers(plant, designs, max_speed, orbital_speed, *, min_speed, top_speeds):
    """In place of `require_stable`: an error that states all that it was given."""
    numbers = (plant.dt, max_speed, orbital_speed, min_speed, *top_speeds)
    records = (plant.true_coefficients, plant.true_effectors, designs)
    raise LaisnError(f"{numbers} {[hash(array.tobytes()) for array in records]}")


def test_kept_checks_are_those_of_their_hulls_and_speeds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feasibility, "require_stable", refuse_with_numbers)
    # a follower leaves roll free as it is
    own = [hull for hull in changed_hulls() if hull.settings.roll_control is None]
    lauv = {"model": "lauv", "excess_buoyancy_n": 0.0}
    own += [hull_with(**lauv, roll_control=control) for control in ("hold", "free")]
    cases = [(hull, SPEEDS, 0.0) for hull in own]
    cases += [
        (hull_with(), SPEEDS._replace(slowest=0.3), 0.0),
        (hull_with(), SPEEDS._replace(fastest=1.3), 0.0),
        (hull_with(), SPEEDS._replace(mean=0.7), 0.0),
        (hull_with(), SPEEDS, 0.5),
    ]

    def check(hull: Hull, speeds: SpeedRange, orbital_speed: float) -> tuple[object, ...]:
        return (
            top_speed_of(hull),
            limits_of(hull),
            tuple(feasibility._weight_errors_in(hull.as_designed, speeds, 1.0)),
            tuple(feasibility._weight_errors_in(hull.as_designed, speeds, 0.9)),
            tuple(feasibility._stability_errors(hull, speeds, orbital_speed)),
        )

    versions = count()
    # with other plugins at each call nothing counts that was kept before
    monkeypatch.setattr("laisn.plugins.plugins_version", lambda refresh: f"new {next(versions)}")
    computed_anew = [check(*case) for case in cases]
    assert len(set(computed_anew)) == len(cases)
    monkeypatch.setattr("laisn.plugins.plugins_version", lambda refresh: "the same")
    for _ in range(2):
        for case, expected in zip(cases, computed_anew, strict=True):
            assert check(*case) == expected


def test_speeds_through_the_water_are_kept_by_current_route_depths_and_time() -> None:
    steady = OceanTable(current_speed_m_s=0.3)
    turned = OceanTable(current_speed_m_s=0.3, current_direction_deg=70.0)
    sheared = OceanTable(current_speed_m_s=0.3, current_shear_per_s=0.01)
    changing = OceanTable(current_profile=((0.0, 0.1, 0.0), (200.0, 0.4, 90.0)))
    route = library_route("T5")
    cases = {
        "steady": (steady, 300.0, route, (10.0,)),
        "turned": (turned, 300.0, route, (10.0,)),
        "sheared": (sheared, 300.0, route, (10.0,)),
        "deeper": (sheared, 300.0, route, (12.0,)),
        "changing": (changing, 300.0, route, (10.0,)),
        "shorter": (changing, 150.0, route, (10.0,)),
        "another route": (steady, 300.0, library_route("T2"), (10.0,)),
    }
    computed_anew = {
        name: feasibility._speeds_by_keys.__wrapped__(*case) for name, case in cases.items()
    }
    assert len(set(computed_anew.values())) == len(cases)
    for _ in range(2):
        kept = {name: feasibility._speeds_by_keys(*case) for name, case in cases.items()}
        assert kept == computed_anew
