"""The picture of a drive among beacons: surveyed, dead reckoned, and estimated from two of its beacons."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.figure import Figure

from experiments.pages.figures import Line, panel
from experiments.pages.style import ESTIMATE, INK, MUTED, SERIES, Colour
from experiments.real_ranges.navigating import among_beacons, dead_reckoning
from experiments.real_ranges.settings import Beacons
from experiments.real_ranges.study import DATA
from sim.datasets.log import read_data_set, read_data_set_log, write_data_set

_BEACONS = ("1", "6")


def picture() -> tuple[Figure, list[tuple[Colour, str]]]:
    """Plaza 2 with two beacons: the gyro's drift bends dead reckoning; ranges hold the estimate on the path."""
    data = read_data_set(DATA / "Plaza2.mat").among(_BEACONS)
    with TemporaryDirectory() as folder:
        write_data_set(data, Path(folder) / "plaza.mcap")
        recorded = read_data_set_log(Path(folder) / "plaza.mcap")
    reckoned, (estimated, _) = dead_reckoning(recorded), among_beacons(recorded, Beacons())
    # what was driven in the first five minutes is crowded enough
    shown = np.flatnonzero(recorded.measurements.time < 300.0)
    true = recorded.truth[recorded.truth[:, 0] < 300.0]
    lines = [
        Line(x=reckoned.state[shown, 0], y=reckoned.state[shown, 1], colour=MUTED, width=0.6),
        Line(x=true[:, 1], y=true[:, 2], colour=INK, width=1.6),
        Line(x=estimated.state[shown, 0], y=estimated.state[shown, 1], colour=ESTIMATE, width=0.8),
        Line(x=data.places[:, 0], y=data.places[:, 1], colour=SERIES[1], marker="^", size=7.0),
    ]
    figure = panel(lines, x_label="east [m]", y_label="north [m]", equal=True, height=4.0)
    return figure, [
        (SERIES[1], "▲ the two beacons"),
        (INK, "surveyed path"),
        (ESTIMATE, "estimate from odometry and ranges to both"),
        (MUTED, "odometry alone"),
    ]
