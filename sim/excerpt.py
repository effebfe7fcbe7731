"""A stretch of a flight as a flight of its own."""

from dataclasses import replace

import numpy as np

from laisn.messages import Measurements
from sim.flight import Flight


def excerpt(flight: Flight, start: float, end: float) -> Flight:
    """The part of a flight from `start` to `end`, widened to whole filter steps; the mission's clock goes on.

    Args:
        flight: the whole mission; its scenario is kept as it is.
        start: first instant [s].
        end: last instant [s].

    Raises:
        ValueError: that stretch is empty or leaves the mission.
    """
    truth, dt = flight.trajectory, flight.measurements[0].dt
    begin = float(truth.time[0])
    first, last = int(np.floor((start - begin) / dt + 1e-6)), int(np.ceil((end - begin) / dt - 1e-6))
    if not 0 <= first < last <= flight.measurements[0].speed.size:
        raise ValueError(
            f"an excerpt from {start:g} to {end:g} s of a mission from {begin:g} to {float(truth.time[-1]):g} s"
        )
    points = slice(first * flight.stride, last * flight.stride + 1)
    timed = ("time", "position", "quaternion", "velocity", "angular_velocity", "water_velocity", "thrust")

    def within(m: Measurements) -> Measurements:
        kept = (m.message_step > first) & (m.message_step <= last)
        return Measurements(
            dt=m.dt,
            speed=m.speed[first:last],
            heading=m.heading[first:last],
            depth=m.depth[first:last],
            message_step=m.message_step[kept] - first,
            message=m.message[kept],
            ranges=m.ranges[kept],
            durations=None if m.durations is None else m.durations[first:last],
            transmitters=None if m.transmitters is None else m.transmitters[kept],
        )

    return replace(
        flight,
        trajectory=replace(truth, **{name: getattr(truth, name)[points] for name in timed}),
        measurements=tuple(within(m) for m in flight.measurements),
        estimates=tuple(e.part(first, last) for e in flight.estimates),
    )
