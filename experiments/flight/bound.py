"""The Cramér–Rao bound of a flight, with the messages that were received."""

import numpy as np

from experiments.campaign.bound import geometry_of, least_rms, noise_of
from laisn.arrays import Floats
from sim.flight import Flight
from sim.sensing.hearing import Hearing


def flight_bound(flight: Flight, follower: int = 0) -> Floats:
    """Least RMS of one follower's position error after each step, from the pings that it received, shape (n,), [m].

    That of the ranges, log and compass of this flight, with constant biases: sideslip, drift and echoes only raise what
    can be reached.
    """
    scenario, received = flight.scenario, np.isfinite(flight.measurements[follower].ranges)
    return least_rms(geometry_of(flight.trajectory, Hearing.of(scenario), follower, received), noise_of(scenario))
