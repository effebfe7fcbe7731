"""The current of the built-in study `front`: `python -m tools.documents.front_field`.

It flows towards east. From south to north its speed grows from 0 to 0.4 m/s across a line 60 m
north of the start, as 1 + tanh, within some 20 m; it is the same at all depths and times.
"""

from pathlib import Path

import numpy as np
import xarray

from experiments.study.file import FOLDER

FILE = FOLDER / "front" / "front.nc"
SPEED = 0.4  # north of the front [m/s]
LINE_M = 60.0  # northing of the front
WIDTH_M = 10.0  # length scale of the tanh
_SPACING_M = 2.0  # of the grid, about the front
_FAR_M = 2000.0  # from the front to the edges of the grid


def write(file: Path) -> None:
    """Write the field as a classic NetCDF file."""
    front_north = np.arange(LINE_M - 50.0, LINE_M + 50.1, _SPACING_M)
    north = np.concatenate([[LINE_M - _FAR_M], front_north, [LINE_M + _FAR_M]])
    east = np.array([-_FAR_M, _FAR_M])
    eastward = 0.5 * SPEED * (1.0 + np.tanh((north - LINE_M) / WIDTH_M))
    components = {"u": np.outer(eastward, [1.0, 1.0]), "v": np.zeros((north.size, 2))}
    names = {"u": "eastward_sea_water_velocity", "v": "northward_sea_water_velocity"}
    variables = {
        key: (("y", "x"), values, {"standard_name": names[key], "units": "m s-1"})
        for key, values in components.items()
    }
    axes = {"y": ("y", north, {"units": "m"}), "x": ("x", east, {"units": "m"})}
    xarray.Dataset(variables, axes).to_netcdf(file, engine="scipy")


if __name__ == "__main__":
    write(FILE)
