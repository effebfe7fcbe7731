"""What tests of the film have in common: a flight's errors, another estimate, small pictures."""

import dataclasses

import numpy as np

from sim.scenario.settings import Video


def errors_of(flight):
    """E_P from its definition; E_B plays no role in what is tested."""
    return [
        (np.linalg.norm(e.state[:, :2] - flight.hydrophone(i)[:, :2], axis=1), np.zeros(len(e.state)))
        for i, e in enumerate(flight.estimates)
    ]


def small(**changes):
    return Video(**({"width_px": 320, "height_px": 180, "speed_up": 20.0} | changes))


def apart(flight, metres):
    """A flight whose estimate is moved east by so many metres."""
    estimates = tuple(
        dataclasses.replace(e, state=e.state + np.array([metres, 0, 0, 0]), covariance=e.covariance.copy())
        for e in flight.estimates
    )
    return dataclasses.replace(flight, estimates=estimates)
