"""A stretch of a flight, as a flight of its own."""

from dataclasses import replace

import numpy as np

from sim.flight import excerpt
from tests.synthetic import make_flight


def test_an_excerpt_keeps_the_lengths_of_steps_and_the_places_of_transmitters() -> None:
    whole = make_flight(30.0)
    given = whole.measurements[0]
    durations = np.linspace(0.09, 0.11, given.speed.size)
    places = np.arange(given.message_step.size * 9.0).reshape(-1, 3, 3)
    timed = replace(given, durations=durations, transmitters=places)
    kept = excerpt(replace(whole, measurements=(timed,)), 10.0, 20.0).measurements[0]
    assert kept.durations is not None
    assert kept.transmitters is not None
    # steps of 0.1 s, the first at 0.1 s; messages every second, the first within the excerpt at 11
    # s
    assert kept.durations.tolist() == durations[100:200].tolist()
    assert (
        kept.transmitters[:, 0, 0].tolist() == places[timed.message_step > 100, 0, 0][:10].tolist()
    )
    assert kept.message_step.tolist() == list(range(10, 101, 10))
    assert excerpt(whole, 10.0, 20.0).measurements[0].durations is None
