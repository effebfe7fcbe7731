"""Single flights of which README and docs quote a number."""

from pathlib import Path

import numpy as np

from experiments.campaign.montecarlo import CampaignMission, CellSettings
from experiments.flight.fly import fly
from experiments.flight.library import load_scenario
from reports.findings import RESULTS_FILE, Finding, Findings, plain_finding, record
from sim.flight import FlightRecord, position_and_bearing_errors
from sim.scenario.sensors import Sensors
from sim.sensing.observation import IdealMeasurements
from sim.sensing.sensors import tilt_errors

COMMAND = "python -m tools.documents.studies flights"
MODULES = ("tools.documents.flights",)

ASTERN_FROM_S = 650.0
"""Time from which T5's follower is astern [s]."""
OFF_AXIS_S = (470.0, 590.0)
"""Stretch of T5 in which the follower is well off the leader's axis [s]."""
SEAS = {
    "following-sea": (),
    "following-sea-ahrs": (),
    "following-sea-inclinometer": ("sensors.leader_gyro_time_constant_s=0",),
}
"""Flights of one sea: settings by name; the last is the scenario `following-sea-ahrs` without
gyros.
"""


def slip(truth: IdealMeasurements) -> float:
    """Way over ground in a second that a follower's log and compass do not see, RMS along one
    axis [m].
    """
    velocity = truth.speed[:, None] * np.column_stack(
        [np.sin(truth.heading), np.cos(truth.heading)]
    )
    dead_reckoned = np.cumsum(truth.dt * (velocity[1:] + velocity[:-1]) / 2, axis=0)
    unseen = truth.hydrophone[1:, :2] - dead_reckoned
    second = round(1.0 / truth.dt)
    return float(np.sqrt(np.mean((unseen[second:] - unseen[:-second]) ** 2)))


def _tilt(flight: FlightRecord) -> dict[str, Finding]:
    """How much the leader of a flight pitches, and how wrong an ideal inclinometer is about
    that.
    """
    pitch = flight.trajectory.pitch[:, 0]
    ideal = Sensors(leader_attitude_senses_acceleration=True)
    wrong = tilt_errors(flight.trajectory, ideal)[:, 0]
    rms = [float(np.rad2deg(np.sqrt(np.mean(angle**2)))) for angle in (pitch, wrong)]
    return {
        "pitch following-sea": plain_finding(rms[0], "pitch of the leader, RMS", "°"),
        "inclinometer following-sea": plain_finding(
            rms[1], "error of pitch that accelerations make, RMS", "°"
        ),
    }


def _slips(flight: FlightRecord) -> Finding:
    """`slip` of the follower of a flight."""
    settings = CellSettings.of(flight.scenario)
    _, truth = CampaignMission(settings.motion, flight.trajectory).motion_and_measurements(
        settings, 0
    )
    return plain_finding(
        1e3 * slip(truth),
        "way in a second that log and compass do not see, RMS along one axis",
        "mm",
    )


def findings() -> Findings:
    """Fly them."""
    flight, _ = fly(load_scenario("T5", ()))
    time = flight.trajectory.time[flight.step_index()]
    error = position_and_bearing_errors(flight)[0][0]
    off_axis = (time >= OFF_AXIS_S[0]) & (time <= OFF_AXIS_S[1])
    index = int(np.searchsorted(flight.trajectory.time, ASTERN_FROM_S))
    east, north = (flight.trajectory.position[index, 1] - flight.trajectory.position[index, 0])[:2]
    heading = float(flight.trajectory.heading[index, 0])
    findings: dict[str, Finding] = {
        "T5 off-axis": plain_finding(
            float(error[off_axis].max()), "largest E_P, 470 … 590 s, run 0", "m"
        ),
        "T5 behind": plain_finding(
            float(-east * np.sin(heading) - north * np.cos(heading)), "at 650 s", "m"
        ),
        "T5 beside": plain_finding(
            float(abs(east * np.cos(heading) - north * np.sin(heading))), "at 650 s", "m"
        ),
        "slip T5": _slips(flight),
    }
    for name, settings in SEAS.items():
        sea, _ = fly(load_scenario(name.replace("inclinometer", "ahrs"), settings))
        mean = float(position_and_bearing_errors(sea)[0][0].mean())
        findings[f"error {name}"] = plain_finding(mean, "mean E_P, run 0", "m")
        if name == "following-sea":
            findings |= {"slip following-sea": _slips(sea)} | _tilt(sea)
    return record("flights", COMMAND, MODULES, findings)


def run(folder: Path) -> None:
    """Fly them and write the record into a folder."""
    findings().write(folder / RESULTS_FILE)
