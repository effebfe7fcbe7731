"""A scenario made into a sea."""

import numpy as np

from sim.scenario.settings import Scenario
from sim.water.floors import LevelFloor
from sim.water.ocean import Ocean
from sim.water.rays import SoundProfile, StraightRays
from sim.water.waves import Waves

# keeps the sea's random numbers apart from all others that come from the same seed
_WAVES_KEY = 0x5EA


def rays_of(scenario: Scenario) -> StraightRays:
    """How sound gets through a scenario's sea."""
    acoustics = scenario.acoustics
    points = acoustics.sound_speed_profile or ((0.0, acoustics.sound_speed_m_s),)
    return StraightRays(
        profile=SoundProfile.through(points),
        varies=bool(acoustics.sound_speed_profile),
        floor=LevelFloor(float(scenario.ocean.floor_depth_m)),
    )


def ocean_of(scenario: Scenario) -> Ocean:
    """The sea; its waves depend on the seed and not on the run. ValueError if they would break."""
    water = scenario.ocean
    waves = scenario.ocean.waves
    towards = {
        "direction_rad": float(np.deg2rad(waves.direction_deg)),
        "floor_depth_m": water.floor_depth_m,
    }
    components = Waves.none()
    if waves.kind == "regular":
        components = Waves.regular(height_m=waves.height_m, period_s=waves.period_s, **towards)
    elif waves.kind == "jonswap":
        components = Waves.jonswap(
            np.random.default_rng([_WAVES_KEY, scenario.seed]),
            significant_height_m=waves.height_m,
            peak_period_s=waves.period_s,
            spread_rad=float(np.deg2rad(waves.spreading_deg)),
            peakedness=waves.peak_enhancement,
            n_components=waves.components,
            **towards,
        )
    return Ocean(
        current_speed_m_s=0.0 if water.current_profile else water.current_speed_m_s,
        current_direction_rad=float(np.deg2rad(water.current_direction_deg)),
        current_shear_1_s=water.current_shear_per_s,
        current_change=water.current_change(),
        density_kg_m3=water.density_kg_m3,
        floor_depth_m=water.floor_depth_m,
        waves=components,
        rays=rays_of(scenario),
    )
