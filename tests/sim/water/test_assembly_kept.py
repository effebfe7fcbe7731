"""Seas are kept for later missions, by all keys that they follow from."""

import numpy as np

from sim.scenario.parts import SeaSettings
from sim.scenario.settings import OceanTable, Scenario, WavesTable
from sim.water import assembly
from sim.water.assembly import ocean_of, sea_of_keys

REGULAR = {"kind": "regular", "height_m": 0.6, "period_s": 5.0}
JONSWAP = REGULAR | {"kind": "jonswap"}


def water_of(ocean: dict[str, object], seed: int = 1) -> tuple[bytes, ...]:
    """Velocities of the water at some places and times, its density and its floor."""
    scenario = Scenario.model_validate(
        {"name": "s", "seed": seed, "followers": ({"name": "f", "route": "T5"},), "ocean": ocean}
    )
    sea = ocean_of(SeaSettings.of(scenario))
    places = np.array([[0.0, 0.0, -1.0], [3.0, -7.0, -2.0], [50.0, 9.0, -20.0]])
    velocities = [sea.velocity(places, time) for time in (0.0, 3.3, 70.0)]
    density = np.array([sea.environment.density(10.0)])
    floor = sea.floor.depths_at(np.zeros(1), np.zeros(1))
    return (*(array.tobytes() for array in velocities), density.tobytes(), floor.tobytes())


def test_each_key_of_the_water_makes_another_sea() -> None:
    """Whatever was asked before, a table gives the sea that it gives by itself."""
    tables = [
        {},
        {"density_kg_m3": 1000.0},
        {"floor_depth_m": 25.0},
        {"current_speed_m_s": 0.3},
        {"current_speed_m_s": 0.3, "current_direction_deg": 40.0},
        {"current_speed_m_s": 0.3, "current_shear_per_s": 0.01},
        {"current_profile": ((0.0, 0.1, 0.0), (60.0, 0.4, 90.0))},
        {"waves": REGULAR},
        {"waves": REGULAR | {"height_m": 0.7}},
        {"waves": REGULAR | {"period_s": 6.0}},
        {"waves": REGULAR | {"direction_deg": 10.0}},
        {"waves": JONSWAP},
        {"waves": JONSWAP | {"components": 50}},
        {"waves": JONSWAP | {"spreading_deg": 20.0}},
        {"waves": JONSWAP | {"peak_enhancement": 2.0}},
    ]
    alone = []
    for table in tables:
        assembly._sea_of_keys.cache_clear()
        assembly._sea_of_keys_alone.cache_clear()
        alone.append(water_of(table))
    assert len(set(alone)) == len(tables)
    for order in (1, -1):
        for table, expected in list(zip(tables, alone, strict=True))[::order]:
            assert water_of(table) == expected
            assert water_of(table) == expected


def test_irregular_waves_alone_depend_on_the_seed() -> None:
    first = water_of({"waves": JONSWAP}, seed=1)
    assert water_of({"waves": JONSWAP}, seed=2) != first
    assert water_of({"waves": JONSWAP}, seed=1) == first
    assert water_of({"waves": REGULAR}, seed=1) == water_of({"waves": REGULAR}, seed=2)
    calm = OceanTable()
    assert sea_of_keys(calm, 1) is sea_of_keys(calm, 2)
    irregular = OceanTable(waves=WavesTable(kind="jonswap"))
    assert sea_of_keys(irregular, 1) is not sea_of_keys(irregular, 2)
