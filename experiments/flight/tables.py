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


def log_flight(flight: Flight, path: str | Path) -> Path:
    """Write the log of a flight as `laisn fly` does, but for its film; LogError if it cannot be written."""
    errors = position_and_bearing_errors(flight)
    all_events = [*capture_events(flight), *giving_way_events(flight), *stray_events(flight)]
    events = sorted(all_events, key=lambda event: event.time_s)
    summary = json.dumps(summarise(flight, errors), indent=2, allow_nan=False) + "\n"
    writer.write(flight, Path(path), summary=summary, errors=errors, events=events)
    return Path(path)
