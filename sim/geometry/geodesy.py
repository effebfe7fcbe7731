"""The flat world on the map: east and north about the scenario's origin to latitude and longitude (WGS 84)."""

import numpy as np

from laisn.arrays import Floats

SEMI_MAJOR_AXIS = 6378137.0
"""Semi-major axis of the WGS 84 ellipsoid [m]."""
FLATTENING = 1 / 298.257223563
"""Flattening of the WGS 84 ellipsoid."""


def geodetic(position: Floats, latitude_deg: float, longitude_deg: float) -> Floats:
    """Latitude, longitude [deg] and height [m] of world positions.

    East and north are arcs along the parallel and the meridian of the origin, with the radii of curvature there
    (NIMA TR8350.2); heights are kept, as the simulated sea is flat. A kilometre from the origin at 60° N
    this is off by 0.16 m.

    Args:
        position: in the world, shape (n, 3), [m].
        latitude_deg: of the world's origin.
        longitude_deg: of the world's origin.

    Returns:
        Shape (n, 3).
    """
    eccentricity_squared = FLATTENING * (2 - FLATTENING)
    latitude = np.deg2rad(latitude_deg)
    w = np.sqrt(1 - eccentricity_squared * np.sin(latitude) ** 2)
    meridian = SEMI_MAJOR_AXIS * (1 - eccentricity_squared) / w**3
    parallel = SEMI_MAJOR_AXIS / w * np.cos(latitude)
    east, north, up = position.T
    longitude = longitude_deg + np.rad2deg(east / parallel)
    return np.column_stack([latitude_deg + np.rad2deg(north / meridian), (longitude + 180) % 360 - 180, up])
