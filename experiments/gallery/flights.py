"""Single flights of which README and docs quote a number."""

from pathlib import Path

import numpy as np

from experiments.findings import FILE, Finding, Findings, plain, version_of
from experiments.flight.fly import fly
from experiments.flight.library import load
from experiments.flight.summary import position_and_bearing_errors

COMMAND = "python -m experiments.gallery.studies flights"
MODULES = ("experiments.gallery.flights",)

ASTERN_FROM_S = 650.0
"""Time from which T5's follower is astern [s]."""
OFF_AXIS_S = (470.0, 590.0)
"""Stretch of T5 in which the follower is well off the leader's axis [s]."""
SEAS = {
    "following-sea": (),
    "following-sea-ahrs": (),
    "following-sea-inclinometer": ("sensors.leader_gyro_time_constant_s=0",),
}
"""Flights of one sea: settings by name; the last is the second without gyros."""


def findings() -> Findings:
    """Fly them."""
    flight, _ = fly(load("T5", ()))
    time = flight.trajectory.time[flight.step_index()]
    error = position_and_bearing_errors(flight)[0][0]
    off_axis = (time >= OFF_AXIS_S[0]) & (time <= OFF_AXIS_S[1])
    at = int(np.searchsorted(flight.trajectory.time, ASTERN_FROM_S))
    east, north = (flight.trajectory.position[at, 1] - flight.trajectory.position[at, 0])[:2]
    heading = float(flight.trajectory.heading[at, 0])
    named: dict[str, Finding] = {
        "T5 off-axis": plain(float(error[off_axis].max()), "largest E_P, 470 … 590 s, run 0", "m"),
        "T5 behind": plain(float(-east * np.sin(heading) - north * np.cos(heading)), "at 650 s", "m"),
        "T5 beside": plain(float(abs(east * np.cos(heading) - north * np.sin(heading))), "at 650 s", "m"),
    }
    for name, settings in SEAS.items():
        sea, _ = fly(load(name.replace("inclinometer", "ahrs"), settings))
        mean = float(position_and_bearing_errors(sea)[0][0].mean())
        named[f"error {name}"] = plain(mean, "mean E_P, run 0", "m")
    return Findings(study="flights", command=COMMAND, modules=MODULES, version=version_of(MODULES), findings=named)


def run(folder: Path) -> None:
    """Fly them and write the record into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    findings().write(folder / FILE)
