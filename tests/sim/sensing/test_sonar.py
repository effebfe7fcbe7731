"""Probability of hearing a message by range, against published figures, and pings at the end of
messages.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Acoustics
from sim.sensing.observation import observe, propagate
from sim.sensing.sensors import errors_of
from sim.sensing.sonar import (
    absorption_db_km,
    half_heard_m,
    hearing_probability,
    noise_level_db,
    sonar_of,
)
from tests.straight import make_scenario, make_trajectory


@pytest.mark.parametrize(
    ("salinity", "expected", "tolerance"),
    [(35.0, (0.96, 4.99, 15.4), 0.005), (7.5, (0.25, 1.22, 3.9), 0.03)],
)
def test_absorption_at_ten_degrees(
    salinity: float, expected: tuple[float, ...], tolerance: float
) -> None:
    # at 10, 25 and 50 kHz, from another implementation of Francois and Garrison
    absorption = [absorption_db_km(f, 10.0, salinity) for f in (10.0, 25.0, 50.0)]
    assert_allclose(absorption, expected, rtol=tolerance)


def test_absorption_is_that_of_pure_water_without_salt_and_lessens_with_depth() -> None:
    # at 100 kHz water alone absorbs A3 f²; the authors' curve for 10 °C
    assert absorption_db_km(100.0, 10.0, 1e-9) == pytest.approx(3.108, rel=0.005)
    assert absorption_db_km(25.0, 10.0, 35.0, 1000.0) < absorption_db_km(25.0, 10.0, 35.0)
    # both formulas of water meet at 20 °C
    assert absorption_db_km(100.0, 20.0, 1e-9) == pytest.approx(
        absorption_db_km(100.0, 20.0 + 1e-9, 1e-9), rel=0.01
    )


def test_ambient_noise_falls_with_frequency_and_rises_with_wind() -> None:
    # Knudsen's sea states fall by some 17 dB in a decade
    decade = noise_level_db(1.0, 10.0, 0.0) - noise_level_db(10.0, 10.0, 0.0)
    assert decade == pytest.approx(17.0, abs=3.0)
    # wind alone at 10 kHz: 50 + 7.5 sqrt(w) + 20 - 40 log(10.4)
    expected = 50.0 + 7.5 * math.sqrt(10.0) + 20.0 - 40.0 * math.log10(10.4)
    assert noise_level_db(10.0, 10.0, 0.0) == pytest.approx(expected, abs=0.1)
    # thermal noise prevails at 200 kHz in calm water
    thermal_noise = -15.0 + 20.0 * math.log10(200.0)
    assert noise_level_db(200.0, 0.0, 0.0) == pytest.approx(thermal_noise, abs=0.3)


def test_half_of_the_messages_are_heard_where_the_mean_level_meets_the_threshold() -> None:
    acoustics = Acoustics(source_level_db=140.0, level_sigma_db=4.0)
    # errors of sensors, and the numbers of the sonar equation
    errors = errors_of(SensingSettings.of(make_scenario(acoustics)))
    half_heard = half_heard_m(sonar_of(acoustics))
    assert hearing_probability(errors, half_heard) == pytest.approx(0.5, abs=1e-9)
    # at 100 m by the sonar equation, for a normal distribution of levels about their mean
    noise = noise_level_db(25.0, 5.0, 0.5) + 10.0 * math.log10(5000.0)
    received_level = 140.0 - 15.0 * math.log10(100.0) - 0.1 * absorption_db_km(25.0, 10.0, 35.0)
    probability = 0.5 * math.erfc(-(received_level - noise - 10.0) / (4.0 * math.sqrt(2.0)))
    assert hearing_probability(errors, 100.0) == pytest.approx(probability, abs=1e-12)
    assert hearing_probability(errors, 0.0) > 0.999


def test_pings_at_the_end_of_a_message_measure_ranges_at_its_end() -> None:
    # the leader comes nearer by 1 m/s: at the end of a message of 0.3 s ranges are 0.3 m shorter
    trajectory = make_trajectory((0.0, 60.0, -8.0), leader_velocity=(0.0, 1.0, 0.0))
    ranges = {}
    for pulse in ("start", "end"):
        acoustics = Acoustics(travel_time=True, message_length_s=0.3, ranging_pulse=pulse)
        ranges[pulse] = observe(
            trajectory, SensingSettings.of(make_scenario(acoustics))
        ).slant_range
        sound = propagate(trajectory, SensingSettings.of(make_scenario(acoustics)))
        # received is a message at the first step after its end has come
        end_of_reception = sound.arrival.time[:, :, 0].max(axis=1) + (
            0.3 if pulse == "start" else 0.0
        )
        assert (sound.message_step * 0.1 >= end_of_reception - 1e-6).all()
        assert (sound.message_step * 0.1 < end_of_reception + 0.1).all()
    n = min(len(ranges["start"]), len(ranges["end"]))
    assert n > 3
    difference = (ranges["end"][:n] - ranges["start"][:n])[:, 0]
    assert_allclose(difference, -0.3, atol=2e-3)
    assert np.isfinite(ranges["end"]).all()


def test_without_scatter_all_messages_are_heard_up_to_the_range_of_no_excess_and_none_beyond() -> (
    None
):
    """A spreading loss of 10 log10(100) = 20 dB and 0.25 dB/m use up 45 dB at 100 m, exactly."""
    sonar = SimpleNamespace(
        sonar_margin=45.0, sonar_spreading=10.0, sonar_absorption=0.25, sonar_scatter=0.0
    )
    probabilities = [hearing_probability(sonar, distance) for distance in (99.9, 100.0, 100.1)]
    assert probabilities == [1.0, 1.0, 0.0]
