"""Pictures of the studies in README and docs, computed when they are drawn: each a figure and its legend."""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.beacon_replay import Beacons, among_beacons, dead_reckoning
from experiments.campaign.store import read_table
from experiments.flight.fly import fly
from experiments.flight.library import ROUTES
from experiments.pages.figures import Line
from experiments.pages.style import ESTIMATE, FRAME, INK, MUTED, SERIES, Colour, Legend
from experiments.studies.asymmetry.fix_map import FULL, sweep
from experiments.studies.closed_loop import scenario_of
from experiments.studies.real_ranges import DATA
from experiments.studies.reproduction.study import reproduce
from laisn.settings import NavigationSettings
from sim.datasets.log import read_data_set, read_data_set_log, write_data_set
from tools.documents.drawing import heat, panel

Drawn = tuple[Figure, Legend]

_PITCH_DEG, _OFFSET_M = 5.0, 5.0
_PLAZA_BEACONS = ("1", "6")
_ROW_GROUPS: tuple[tuple[str, Colour, str], ...] = (
    ("messages every 1 and 5 s, stages 1 to 3", SERIES[0], "o"),
    ("unequal range errors, stage 4", SERIES[2], "D"),
    ("leader's compass off, stage 5", SERIES[3], "s"),
    ("messages every 10 s", SERIES[1], "^"),
)
"""Name, colour and mark of the kinds of rows."""


def asymmetry() -> Drawn:
    """Error of a noiseless LAISN-2 fix around a pitched leader."""
    reach, bearing = np.array(FULL["range_m"]), np.arange(0.0, 360.0, 2.0)
    points = np.array([[np.deg2rad(_PITCH_DEG), _OFFSET_M, r, np.deg2rad(b)] for r in reach for b in bearing])
    error = sweep(points, NavigationSettings(side_rule="predicted"))
    title = f"Error of a fix: pitch {_PITCH_DEG:g}°, follower {_OFFSET_M:g} m below"
    figure = heat(bearing, reach, np.hypot(*error.T).reshape(reach.size, bearing.size), title)
    return figure, ()


def closed_loop() -> Drawn:
    """How a mirrored estimate leads a follower away: true and believed distances from the leader's axis."""
    lines = []
    for navigator, colour in (("laisn-2", SERIES[1]), ("laisn-3-2", SERIES[0])):
        mission = scenario_of(f"{navigator} estimate")
        chosen = (mission.followers[ROUTES.index("T5")],)
        flight, _ = fly(mission.model_copy(update={"followers": chosen, "duration_s": 140.0}))
        steps = flight.step_index()
        heading, leader = flight.trajectory.heading[steps, 0], flight.trajectory.position[steps, 0, :2]
        starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
        for position, dash in ((flight.hydrophone(0)[:, :2], "-"), (flight.estimates[0].state[:, :2], ":")):
            aside = np.einsum("ni,ni->n", position - leader, starboard)
            lines.append(Line(x=flight.trajectory.time[steps], y=aside, colour=colour, dash=dash, width=1.4))
    figure = panel(lines, x_label="time [s]", y_label="to starboard of the leader's axis [m]", height=3.0)
    return figure, [
        (SERIES[1], "LAISN-2: steers by the dotted estimate, swims along the line"),
        (SERIES[0], "LAISN-3(2): both stay within a few metres of it"),
    ]


def real_ranges() -> Drawn:
    """Plaza 2 with two beacons: the gyro's drift bends dead reckoning; ranges hold the estimate on the path."""
    data = read_data_set(DATA / "Plaza2.mat").among(_PLAZA_BEACONS)
    with tempfile.TemporaryDirectory() as folder:
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


def _row_group(row: dict[str, float]) -> int:
    if row["dt_range_s"] == 10:
        return 3
    if row["tau_rear_m"] != row["tau_other_m"]:
        return 1
    return 2 if row["mu_heading_leader_deg"] > 0 else 0


def _means(folder: Path) -> list[tuple[int, float, float]]:
    """Group, published and own mean E_P [m] of every published row of a reproduction in `folder`."""
    rows = read_table(folder / "tables.parquet")
    kept = [row for row in rows if row["published_e_p_mean_m"] is not None]
    return [(_row_group(row), row["published_e_p_mean_m"], row["ours_e_p_mean_m"]) for row in kept]


def reproduction() -> Drawn:
    """Our mean E_P over the paper's, both on logarithmic axes; the diagonal is agreement, the band a factor of two."""
    with tempfile.TemporaryDirectory() as folder:
        reproduce(out=Path(folder), quiet=True)
        points = _means(Path(folder))
    span = np.array([0.15, 40.0])
    lines = [
        Line(x=span, y=factor * span, colour=FRAME, width=width, dash=dash)
        for factor, width, dash in ((1.0, 1.2, "-"), (2.0, 0.8, "--"), (0.5, 0.8, "--"))
    ]
    for number, (_, colour, mark) in enumerate(_ROW_GROUPS):
        pairs = np.array([(theirs, ours) for group, theirs, ours in points if group == number])
        lines.append(Line(x=pairs[:, 0], y=pairs[:, 1], colour=colour, marker=mark))
    figure = panel(lines, x_label="the paper's mean E_P [m]", y_label="our mean E_P [m]", height=3.6)
    axes = figure.axes[0]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(*span)
    axes.set_ylim(*span)
    return figure, [(colour, f"{mark} {name}") for (name, colour, _), mark in zip(_ROW_GROUPS, "●◆■▲", strict=True)]
