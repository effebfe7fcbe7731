"""Pictures of the studies in README and docs, computed when they are drawn: each a figure and
its legend.
"""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.beacon_replay import BeaconReplaySettings, dead_reckoning, navigate_among_beacons
from experiments.campaign.store import read_table
from experiments.flight.fly import fly
from experiments.flight.library import ROUTES
from experiments.studies.asymmetry.fix_map import MAP_GRID, sweep
from experiments.studies.reproduce.figures import agreement
from experiments.study.file import study_of
from experiments.study.plan import plan_of
from experiments.study.study import run
from laisn.settings import NavigationSettings
from reports.figures import Line
from reports.style import ESTIMATE, INK, MUTED, SERIES, Legend
from sim.datasets.log import read_data_set, read_data_set_log, write_data_set
from tools.documents.drawing import draw, draw_lines, heat_map
from tools.documents.real_ranges import DATA

Drawn = tuple[Figure, Legend]

_PITCH_DEG = 5.0
_BELOW_M = 5.0  # depth of the follower below the leader
_PLAZA_BEACONS = ("1", "6")  # names in the data set


def asymmetry() -> Drawn:
    """Error of a noiseless LAISN-2 fix around a pitched leader."""
    distance = np.array(MAP_GRID["range_m"])
    bearing = np.arange(0.0, 360.0, 2.0)
    # columns: pitch [rad], depth of the follower below the leader [m], horizontal distance [m],
    # bearing [rad]
    points = np.array(
        [[np.deg2rad(_PITCH_DEG), _BELOW_M, r, np.deg2rad(b)] for r in distance for b in bearing]
    )
    # east and north, shape (n, 2) [m]
    error = sweep(points, NavigationSettings(side_rule="predicted"))
    title = f"Error of a fix: pitch {_PITCH_DEG:g}°, follower {_BELOW_M:g} m below"
    figure = heat_map(
        bearing, distance, np.hypot(*error.T).reshape(distance.size, bearing.size), title
    )
    return figure, ()


def closed_loop() -> Drawn:
    """How a mirrored estimate leads a follower away: true and estimated distances from the
    leader's axis.
    """
    lines = []
    missions = {entry.arm: entry.scenario for entry in plan_of(study_of("closed-loop", {})).entries}
    for navigator, colour in (("laisn-2", SERIES[1]), ("laisn-3-2", SERIES[0])):
        mission = missions[f"{navigator} estimate"]
        # the study's followers fly ROUTES in their order
        followers = (mission.followers[ROUTES.index("T5")],)
        flight, _ = fly(mission.model_copy(update={"followers": followers, "duration_s": 140.0}))
        steps = flight.step_index()
        heading = flight.trajectory.heading[steps, 0]
        leader = flight.trajectory.position[steps, 0, :2]
        starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
        for position, dash in (
            (flight.hydrophone(0)[:, :2], "-"),
            (flight.estimates[0].state[:, :2], ":"),
        ):
            lateral = np.einsum("ni,ni->n", position - leader, starboard)
            lines.append(
                Line(
                    x=flight.trajectory.time[steps], y=lateral, colour=colour, dash=dash, width=1.4
                )
            )
    figure = draw_lines(
        lines, x_label="time [s]", y_label="to starboard of the leader's axis [m]", height=3.0
    )
    return figure, [
        (SERIES[1], "LAISN-2: steers by the dotted estimate, swims along the line"),
        (SERIES[0], "LAISN-3(2): both stay within a few metres of it"),
    ]


def real_ranges() -> Drawn:
    """Plaza 2 with two beacons: the gyro's drift bends dead reckoning; ranges hold the estimate
    on the path.
    """
    data = read_data_set(DATA / "Plaza2.mat").with_beacons(_PLAZA_BEACONS)
    with tempfile.TemporaryDirectory() as folder:
        write_data_set(data, Path(folder) / "plaza.mcap")
        recorded = read_data_set_log(Path(folder) / "plaza.mcap")
    dead_reckoned = dead_reckoning(recorded)
    estimated, _ = navigate_among_beacons(recorded, BeaconReplaySettings())
    # the first five minutes alone: the lines of the whole drive would cover each other
    steps = np.flatnonzero(recorded.measurements.time < 300.0)
    # columns: time [s], east and north [m]
    true = recorded.truth[recorded.truth[:, 0] < 300.0]
    lines = [
        Line(
            x=dead_reckoned.state[steps, 0],
            y=dead_reckoned.state[steps, 1],
            colour=MUTED,
            width=0.6,
        ),
        Line(x=true[:, 1], y=true[:, 2], colour=INK, width=1.6),
        Line(x=estimated.state[steps, 0], y=estimated.state[steps, 1], colour=ESTIMATE, width=0.8),
        Line(x=data.places[:, 0], y=data.places[:, 1], colour=SERIES[1], marker="^", size=7.0),
    ]
    figure = draw_lines(
        lines, x_label="east [m]", y_label="north [m]", equal_scales=True, height=4.0
    )
    return figure, [
        (SERIES[1], "▲ the two beacons"),
        (INK, "surveyed path"),
        (ESTIMATE, "estimate from odometry and ranges to both"),
        (MUTED, "odometry alone"),
    ]


def reproduction() -> Drawn:
    """Our mean E_P over the paper's, both on logarithmic axes; the diagonal is agreement, the
    band a factor of two.
    """
    with tempfile.TemporaryDirectory() as folder:
        run("reproduce", {}, folder, quiet=True)
        figure, legend = agreement(read_table(Path(folder) / "tables.parquet"))
        return draw(figure), legend
