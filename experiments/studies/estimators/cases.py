"""The cases of `cases.toml`: what the tightly coupled navigator assumes, and errors added to the paper's noise."""

import tomllib
from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from laisn.messages import Measurements
from laisn.tight.settings import Assume

SPEED_DRIFT, SPEED_PERIOD = 0.1, 300.0
"""Sinusoidal drift of the log's bias: amplitude [m/s] and period [s]."""
HEADING_DRIFT, HEADING_PERIOD = float(np.deg2rad(3.0)), 400.0
"""Sinusoidal drift of the compass's bias: amplitude [rad] and period [s]."""
DEVIATION = 0.03
"""Amplitude of a deviation that goes once round with the heading [rad]."""
LATE = 0.010
"""Error by which the front transmitter's range is too long [m]."""
ECHO_CHANCE = 0.05
"""Chance of each range that it is that of an echo."""
ECHO_EXCESS = (0.3, 4.8)
"""Least and largest excess of an echo's range, drawn evenly between them [m]."""
COMMON_CHANCE = 0.1
"""Chance of each message that all its ranges have the same excess, drawn likewise."""
CLOCK_OFFSET, CLOCK_DRIFT = 1.5, 1.5e-3
"""Clock offset of 1 ms at the start, as a range [m], and drift of 1 ppm [m/s]."""
LOSS_CHANCE = 0.2
"""Chance of each message that none of its pings is received."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Assumptions of the navigator, and errors beside the paper's noise."""

    name: str
    title: str = ""
    assume: Assume = field(default_factory=Assume)
    transmitters: int = 3
    leader_heading_deg: float = 0.0
    """Mean error of the leader's compass; its spread is that of the paper's Tables 8 and 9."""
    errors: tuple[str, ...] = ()
    """Of "drift", "deviation", "echoes", "losses", "late", "common" and "clock": see `with_errors`."""

    @property
    def has_bound(self) -> bool:
        """Whether the only errors are those that the bound models, given what is assumed."""
        return not (self.errors or self.leader_heading_deg)


_FILE = tomllib.loads((resources.files("experiments.studies.estimators") / "cases.toml").read_text(encoding="utf-8"))
_cases = TypeAdapter(tuple[Case, ...]).validate_python
CASES = _cases(_FILE["case"])
"""G1 to G7, from no error to all of them."""
WRONG = tuple(
    replace(case, name=f"{case.name} {who}", title=f"{case.title}; {words}", assume=assume)
    for case in _cases(_FILE["error"])
    for who, words, assume in (("unaware", "not assumed", Assume()), ("aware", "assumed", case.assume))
    if who == "aware" or case.assume != Assume()
)
"""One error at a time, and whether the navigator assumes it."""
SEAS: dict[str, dict[str, Any]] = _FILE["sea"]
"""Physical missions by name: `title` and `set`."""
SEED = 12
"""Seed of all noise: not the one on which the navigator was developed."""
INTERVALS = (1.0, 5.0)
BASELINED = CASES[:2]
"""Cases of which a plain extended Kalman filter has the states: constant biases, exact leader, 3 or 2 transmitters."""
ON_AXIS = ("T2", "T5")
"""Routes that spend most of their time within a few degrees of the leader's axis."""
SIGMAS = ("speed_sigma", "speed_bias_sigma", "heading_sigma", "heading_bias_sigma", "range_sigma", "range_scale_sigma",
          "range_scale_bias_sigma")  # fmt: skip
FACTORS = (0.5, 2.0)
"""By which each of them is scaled."""
OFFSETS_M = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
"""H_T."""


def with_errors(measurements: Measurements, case: Case, seed: int, run: int) -> Measurements:
    """Measurements with the errors of a case added; a function of the arguments alone."""
    rng = np.random.default_rng([seed, run])
    if "drift" in case.errors:
        time = measurements.dt * np.arange(1, measurements.speed.size + 1)
        phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        log = SPEED_DRIFT * np.sin(2.0 * np.pi * time / SPEED_PERIOD + phase[0])
        compass = HEADING_DRIFT * np.sin(2.0 * np.pi * time / HEADING_PERIOD + phase[1])
        measurements = replace(
            measurements, speed=np.maximum(measurements.speed + log, 0.0), heading=measurements.heading + compass
        )
    if "deviation" in case.errors:
        turned = np.random.default_rng([seed, run, 1]).uniform(0.0, 2.0 * np.pi)
        off = DEVIATION * np.sin(measurements.heading + turned)
        measurements = replace(measurements, heading=measurements.heading + off)
    ranges = measurements.ranges.copy()
    if "clock" in case.errors:
        ranges += CLOCK_OFFSET + CLOCK_DRIFT * measurements.dt * measurements.message_step[:, None]
    if "common" in case.errors:
        late = np.random.default_rng([seed, run, 2])
        excess = late.uniform(*ECHO_EXCESS, (ranges.shape[0], 1))
        ranges += np.where(late.random((ranges.shape[0], 1)) < COMMON_CHANCE, excess, 0.0)
    if "late" in case.errors:
        ranges[:, 1] += LATE
    # drawn in any case, so that an error alone is the same as among others
    echo = rng.random(ranges.shape) < ECHO_CHANCE
    excess = rng.uniform(*ECHO_EXCESS, ranges.shape)
    lost = rng.random(ranges.shape[0]) < LOSS_CHANCE
    if "echoes" in case.errors:
        ranges += np.where(echo, excess, 0.0)
    if "losses" in case.errors:
        ranges[lost] = np.nan
    return replace(measurements, ranges=ranges)
