"""What became of a flight over time as a table, and the flight as a log, for use from Python."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa

from experiments.flight.separation import giving_way_events
from experiments.flight.summary import (
    capture_events,
    position_and_bearing_errors,
    stray_events,
    summarise,
    true_bearing,
)
from experiments.flight.table import Table
from laisn import metrics
from laisn.messages import Ranges
from sim.flight import Flight
from sim.log import writer


def errors_table(flight: Flight) -> Table:
    """Errors of every follower at its filter steps; `laisn_sim.errors` says what the columns are."""
    steps = flight.step_index()
    time, leader = flight.trajectory.time[steps], flight.trajectory.position[steps, 0, :2]
    heading = flight.trajectory.heading[steps, 0]
    parts = []
    for i, (position, bearing) in enumerate(position_and_bearing_errors(flight)):
        truth, estimate = flight.hydrophone(i), flight.estimates[i].state[:, :2]
        away = truth[:, :2] - leader
        columns = {
            "follower": [flight.trajectory.names[i + 1]] * time.size,
            "time_s": time,
            "e_p_m": position,
            "e_b_deg": np.rad2deg(bearing),
            "east_m": truth[:, 0],
            "north_m": truth[:, 1],
            "depth_m": -truth[:, 2],
            "estimate_east_m": estimate[:, 0],
            "estimate_north_m": estimate[:, 1],
            "bearing_deg": np.rad2deg(true_bearing(flight, i)),
            "distance_m": np.hypot(*away.T),
            "captured": metrics.captured_steps(estimate, truth[:, :2], leader, heading),
        }
        parts.append(pa.table(columns))
    return Table(pa.concat_tables(parts))


def truth_table(flight: Flight) -> Table:
    """True motion of every vehicle at its control steps; `laisn_sim.truth` says what the columns are."""
    t = flight.trajectory
    parts = []
    for v, name in enumerate(t.names):
        columns = {
            "vehicle": [name] * t.time.size,
            "time_s": t.time,
            "east_m": t.position[:, v, 0],
            "north_m": t.position[:, v, 1],
            "depth_m": -t.position[:, v, 2],
            "heading_deg": np.rad2deg(t.heading[:, v]) % 360.0,
            "pitch_deg": np.rad2deg(t.pitch[:, v]),
            "roll_deg": np.rad2deg(t.roll[:, v]),
            "surge_m_s": t.forward_speed[:, v],
        }
        for what, values in (("velocity", t.velocity), ("water", t.water_velocity)):
            columns |= {f"{what}_{axis}_m_s": values[:, v, j] for j, axis in enumerate(("east", "north", "up"))}
        parts.append(pa.table(columns))
    return Table(pa.concat_tables(parts))


_LEADER = ("time_s", "east_m", "north_m", "heading_deg", "speed_m_s", "depth_m", "pitch_deg", "roll_deg",
           "heading_sigma_deg")  # fmt: skip
"""Columns of the fields of `LeaderMessage`, in their order; angles in degrees."""


def measurements_table(flight: Flight) -> Table:
    """What every follower measured at its filter steps; `laisn_sim.measurements` says what the columns are."""
    parts = []
    for name, measured in zip(flight.trajectory.names[1:], flight.measurements, strict=True):
        n = measured.speed.size
        columns = {
            "follower": pa.array([name] * n),
            "time_s": pa.array(measured.time),
            "speed_m_s": pa.array(measured.speed),
            "heading_deg": pa.array(np.rad2deg(measured.heading) % 360.0),
            "depth_m": pa.array(measured.depth),
        }
        received = {f"leader_{column}": measured.message[:, i] for i, column in enumerate(_LEADER)}
        received |= {f"range_{which}_m": measured.ranges[:, i] for i, which in enumerate(Ranges._fields)}
        for column, values in received.items():
            whole = np.full(n, np.nan)
            whole[measured.message_step - 1] = np.rad2deg(values) if column.endswith("_deg") else values
            columns[column] = pa.array(whole, from_pandas=True)
        parts.append(pa.table(columns))
    return Table(pa.concat_tables(parts))


def log_flight(flight: Flight, path: str | Path) -> Path:
    """Write the log of a flight as `laisn fly` does, but for its film; LogError if it cannot be written."""
    errors = position_and_bearing_errors(flight)
    all_events = [*capture_events(flight), *giving_way_events(flight), *stray_events(flight)]
    events = sorted(all_events, key=lambda event: event.time_s)
    summary = json.dumps(summarise(flight, errors), indent=2, allow_nan=False) + "\n"
    writer.write(flight, Path(path), summary=summary, errors=errors, events=events)
    return Path(path)
