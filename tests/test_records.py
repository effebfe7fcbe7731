"""Records own their arrays: whoever made one can go on writing what it was made of, and nobody can write the record."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from experiments.campaign.cells import Cell
from experiments.campaign.montecarlo import simulate
from experiments.flight.anatomy import dissect
from laisn.navigator import Navigator
from sim.assembly import ocean_of, routes_of
from sim.film.annotations import OtherEstimate, RayErrors
from sim.flight import navigate
from sim.motion import simulate_motion
from sim.scenario.settings import Acoustics, Follower, Ocean, Scenario, Waves
from sim.sensing.acoustics import propagate, sound_speed
from sim.sensing.hearing import Hearing
from sim.sensing.observation import observe


def records() -> dict[str, Any]:
    """One of each kind."""
    scenario = Scenario(
        name="T5", motion="kinematic", duration_s=4.0, followers=(Follower(route="T5"),),
        acoustics=Acoustics(surface_echo_chance=0.1, travel_time=True),
        ocean=Ocean(waves=Waves(kind="jonswap", height_m=0.5, period_s=6.0)),
    )  # fmt: skip
    trajectory, hearing = simulate_motion(scenario), Hearing.of(scenario)
    flight = navigate(scenario, trajectory, Navigator)
    route = routes_of(scenario)[1]
    made = (
        trajectory, propagate(trajectory, hearing), observe(trajectory, hearing), flight.measurements[0],
        flight.estimates[0], dissect(flight), simulate(Cell.of(scenario, runs=2), keep_runs=True).table, route,
        route.depth, ocean_of(scenario).waves, sound_speed(hearing),
        OtherEstimate(label="other", colour=(0.0, 0.0, 0.0), position=np.zeros((4, 2))),
        RayErrors(label="error", value=np.zeros((4, 3)), limit=1.0),
    )  # fmt: skip
    return {type(record).__name__: record for record in made}


@pytest.fixture(scope="module")
def made() -> dict[str, Any]:
    return records()


@pytest.mark.parametrize(
    "name",
    ["Trajectory", "Propagation", "MissionTruth", "Measurements", "Estimates", "Anatomy", "RunTable", "Route",
     "DepthProfile", "Waves", "SoundSpeed", "OtherEstimate", "RayErrors"],
)  # fmt: skip
def test_a_record_shares_no_array_with_whoever_made_it(made: dict[str, Any], name: str) -> None:
    record = made[name]
    held = {f.name: getattr(record, f.name) for f in fields(record)}
    given = {key: value.copy() for key, value in held.items() if isinstance(value, np.ndarray)}
    assert given
    other = replace(record, **{key: value[...] for key, value in given.items()})
    for key, value in given.items():
        value[...] = 7
        kept = getattr(other, key)
        np.testing.assert_array_equal(kept, held[key])
        with pytest.raises(ValueError, match="read-only"):
            kept[...] = 7
        with pytest.raises(ValueError, match="cannot set WRITEABLE"):
            held[key][...].flags.writeable = True
