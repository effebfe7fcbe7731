"""The picture of the pitch study for README and docs, computed on the spot."""

import numpy as np
from matplotlib.figure import Figure

from experiments.asymmetry.figures import heat
from experiments.asymmetry.map import full_grid, sweep
from laisn.settings import NavigationSettings

PITCH_DEG, OFFSET_M = 5.0, 5.0


def map_picture() -> Figure:
    """Error of a noiseless LAISN-2 fix around a pitched leader."""
    reach, bearing = np.array(full_grid().range_m), np.arange(0.0, 360.0, 2.0)
    points = np.array([[np.deg2rad(PITCH_DEG), OFFSET_M, r, np.deg2rad(b)] for r in reach for b in bearing])
    _, error = sweep(points, NavigationSettings(side_rule="predicted"))
    title = f"Error of a fix: pitch {PITCH_DEG:g}°, follower {OFFSET_M:g} m below"
    return heat(bearing, reach, np.hypot(*error.T).reshape(reach.size, bearing.size), title)
