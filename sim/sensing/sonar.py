"""Whether a message is heard: the sonar equation in decibels.

    excess = source level − k · 10 log₁₀ r − α r − noise in the band − detection threshold

(Urick, Principles of Underwater Sound, 1983). Absorption α is by Francois & Garrison (J. Acoust.
Soc. Am. 72, 1982, part II), ambient noise by Wenz (J. Acoust. Soc. Am. 34, 1962) in the formulas of
Coates (Underwater Acoustic Systems, 1990). The excess scatters from message to message as a normal
number; a message is heard if it is positive.
"""

import math
from typing import Any, NamedTuple

from laisn.compiled import formula
from sim.scenario.sensors import Acoustics

_ZERO_CELSIUS_K = 273.0  # as the authors have it


def absorption_db_km(
    frequency_khz: float,
    temperature_c: float,
    salinity: float,
    depth_m: float = 0.0,
    acidity_ph: float = 8.0,
) -> float:
    """Absorption of sound in sea water [dB/km] by boric acid, magnesium sulphate and water."""
    f, t, s, z = frequency_khz, temperature_c, salinity, depth_m
    kelvin = _ZERO_CELSIUS_K + t
    speed = 1412.0 + 3.21 * t + 1.19 * s + 0.0167 * z
    boric = 8.86 / speed * 10.0 ** (0.78 * acidity_ph - 5.0)
    boric_khz = 2.8 * math.sqrt(s / 35.0) * 10.0 ** (4.0 - 1245.0 / kelvin)
    sulphate = 21.44 * s / speed * (1.0 + 0.025 * t)
    sulphate_pressure = 1.0 - 1.37e-4 * z + 6.2e-9 * z**2
    sulphate_khz = 8.17 * 10.0 ** (8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (s - 35.0))
    if t <= 20.0:
        water = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.50e-8 * t**3
    else:
        water = 3.964e-4 - 1.146e-5 * t + 1.45e-7 * t**2 - 6.5e-10 * t**3
    water_pressure = 1.0 - 3.83e-5 * z + 4.9e-10 * z**2
    # a = f² (A_1 f_1 / (f² + f_1²) + A_2 P_2 f_2 / (f² + f_2²) + A_3 P_3)
    per_square = (
        boric * boric_khz / (f**2 + boric_khz**2)
        + sulphate * sulphate_pressure * sulphate_khz / (f**2 + sulphate_khz**2)
        + water * water_pressure
    )
    return float(f**2 * per_square)


def noise_level_db(frequency_khz: float, wind_m_s: float, shipping: float) -> float:
    """Spectral level of ambient noise [dB re 1 µPa²/Hz] from turbulence, ships (0: none, 1: heavy
    traffic), wind and heat.
    """
    log = math.log10(frequency_khz)
    levels = (
        17.0 - 30.0 * log,
        40.0 + 20.0 * (shipping - 0.5) + 26.0 * log - 60.0 * math.log10(frequency_khz + 0.03),
        50.0 + 7.5 * math.sqrt(wind_m_s) + 20.0 * log - 40.0 * math.log10(frequency_khz + 0.4),
        -15.0 + 20.0 * log,
    )
    return 10.0 * math.log10(sum(10.0 ** (level / 10.0) for level in levels))


class Sonar(NamedTuple):
    """The sonar equation in numbers that do not depend on range."""

    detects: bool  # it decides on what is heard
    margin: float  # source level less noise and threshold [dB]
    spreading: float  # loss for each factor of ten in range [dB]
    absorption: float  # [dB/m]
    scatter: float  # standard deviation of the excess [dB]


def sonar_of(acoustics: Acoustics) -> Sonar:
    """The sonar equation of a scenario; zeros where it decides on nothing."""
    a = acoustics
    if a.source_level_db == 0.0:
        return Sonar(False, 0.0, 0.0, 0.0, 0.0)
    noise = noise_level_db(a.frequency_khz, a.wind_m_s, a.shipping)
    in_band = noise + 10.0 * math.log10(1e3 * a.bandwidth_khz)
    absorbed = absorption_db_km(a.frequency_khz, a.water_temperature_c, a.salinity)
    return Sonar(
        detects=True,
        margin=a.source_level_db - in_band - a.detection_threshold_db,
        spreading=10.0 * a.spreading,
        absorption=absorbed / 1e3,
        scatter=float(a.level_sigma_db),
    )


def half_heard_m(sonar: Sonar) -> float:
    """Range at which half of the messages are heard, where the mean excess is zero [m]; 0 if that
    is below a metre.
    """

    def excess(distance: float) -> float:
        return sonar.margin - sonar.spreading * math.log10(distance) - sonar.absorption * distance

    low, high = 1.0, 1e6
    if excess(low) < 0.0:
        return 0.0
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return low


@formula
def hearing_probability(s: Any, distance: float) -> float:
    """Probability that a message is heard over a range [m]; `s` has the fields of `Sonar`, with
    `sonar_` before their names.
    """
    transmission_loss = (
        s.sonar_spreading * math.log10(max(distance, 1.0)) + s.sonar_absorption * distance
    )
    excess = s.sonar_margin - transmission_loss
    if s.sonar_scatter == 0.0:
        return 1.0 if excess >= 0.0 else 0.0
    return 0.5 * math.erfc(-excess / (s.sonar_scatter * math.sqrt(2.0)))
