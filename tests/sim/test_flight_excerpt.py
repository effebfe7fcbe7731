"""An excerpt of a flight is a flight of its own."""

from dataclasses import replace

import numpy as np

from sim.flight import excerpt
from tests.synthetic import make_flight


def test_an_excerpt_keeps_the_durations_of_steps_and_the_positions_of_transmitters() -> None:
    flight = make_flight(30.0)
    measured = flight.measurements[0]
    durations = np.linspace(0.09, 0.11, measured.speed.size)
    positions = np.arange(measured.message_step.size * 9.0).reshape(-1, 3, 3)
    with_durations = replace(measured, durations=durations, transmitters=positions)
    in_excerpt = excerpt(replace(flight, measurements=(with_durations,)), 10.0, 20.0).measurements[
        0
    ]
    assert in_excerpt.durations is not None
    assert in_excerpt.transmitters is not None
    # steps of 0.1 s, the first at 0.1 s; messages every second, the first within the excerpt at 11
    # s
    assert in_excerpt.durations.tolist() == durations[100:200].tolist()
    assert (
        in_excerpt.transmitters[:, 0, 0].tolist()
        == positions[with_durations.message_step > 100, 0, 0][:10].tolist()
    )
    assert in_excerpt.message_step.tolist() == list(range(10, 101, 10))
    assert excerpt(flight, 10.0, 20.0).measurements[0].durations is None
