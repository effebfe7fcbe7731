"""What the estimators are compared on: assumptions of the tightly coupled navigator, and what goes wrong in truth."""

from dataclasses import dataclass, field, replace

import numpy as np

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
"""Chance of each message that none of its pings is heard."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Assumptions, and what is wrong in truth beside the paper's noise."""

    name: str
    title: str
    assume: Assume = field(default_factory=Assume)
    transmitters: int = 3
    leader_heading_deg: float = 0.0
    """Mean error of the leader's compass; its spread is that of the paper's Tables 8 and 9."""
    drift: bool = False
    deviation: bool = False
    """The compass's bias changes with the heading, as a sine."""
    echoes: bool = False
    losses: bool = False
    late: bool = False
    """A transmitter that is late by a constant time."""
    common: bool = False
    """Echoes that all ranges of a message have in common."""
    clock: bool = False
    """The follower's clock is off and drifts."""

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong, so that there is a bound: on who takes as given what is assumed."""
        wrong = (self.drift, self.deviation, self.echoes, self.losses, self.late, self.common, self.clock)
        return not (any(wrong) or self.leader_heading_deg)


_WARY = Assume(exact_leader=False, drift=True, offsets=True)

CASES = (
    Case(name="G1", title="constant biases, exact leader, 3 transmitters"),
    Case(name="G2", title="the same, 2 transmitters", transmitters=2),
    Case(name="G3", title="biases that drift, 3 transmitters", assume=Assume(drift=True), drift=True),
    Case(name="G4", title="leader's compass 5° off, 3 transmitters", assume=Assume(exact_leader=False),
         leader_heading_deg=5.0),
    Case(name="G5", title="drift, 5°, echoes, losses, a late transmitter; 3 transmitters", assume=_WARY,
         leader_heading_deg=5.0, drift=True, echoes=True, losses=True, late=True),
    Case(name="G6", title="the same, 2 transmitters", assume=_WARY, transmitters=2, leader_heading_deg=5.0, drift=True,
         echoes=True, losses=True, late=True),
    Case(name="G7", title="all states switched on and nothing wrong, 3 transmitters",
         assume=Assume(exact_leader=False, drift=True, offsets=True, current=True)),
)  # fmt: skip
"""What is assumed and what is wrong, from nothing to everything."""

WRONG = tuple(
    Case(name=f"{name} {who}", title=f"{title}; {words}", assume=assume, **truth)
    for name, title, truth, aware in (
        ("leader", "leader's compass 5° off", {"leader_heading_deg": 5.0}, Assume(exact_leader=False)),
        ("drift", "biases that drift", {"drift": True}, Assume(drift=True)),
        ("deviation", "a compass with a deviation of 1.7°", {"deviation": True}, Assume(deviation=True)),
        ("late", "a transmitter 10 mm late", {"late": True}, Assume(offsets=True)),
        ("echoes", "5 % echoes", {"echoes": True}, Assume()),
        ("common", "10 % echoes common to all ranges of a message", {"common": True}, Assume()),
        ("common-2", "the same, 2 transmitters", {"common": True, "transmitters": 2}, Assume()),
        ("clock", "a clock 1 ms off that drifts by 1 ppm", {"clock": True}, Assume(clock=True)),
        ("losses", "20 % of messages lost", {"losses": True}, Assume()),
    )
    for who, words, assume in (("unaware", "not assumed", Assume()), ("aware", "assumed", aware))
    if who == "aware" or aware != Assume()
)
"""One thing at a time that goes wrong, and whether the navigator reckons with it."""


def spoiled(measurements: Measurements, case: Case, seed: int, run: int) -> Measurements:
    """Measurements with what a case adds to the paper's noise; a function of the arguments alone."""
    rng = np.random.default_rng([seed, run])
    if case.drift:
        time = measurements.dt * np.arange(1, measurements.speed.size + 1)
        phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        log = SPEED_DRIFT * np.sin(2.0 * np.pi * time / SPEED_PERIOD + phase[0])
        compass = HEADING_DRIFT * np.sin(2.0 * np.pi * time / HEADING_PERIOD + phase[1])
        measurements = replace(
            measurements, speed=np.maximum(measurements.speed + log, 0.0), heading=measurements.heading + compass
        )
    if case.deviation:
        turned = np.random.default_rng([seed, run, 1]).uniform(0.0, 2.0 * np.pi)
        off = DEVIATION * np.sin(measurements.heading + turned)
        measurements = replace(measurements, heading=measurements.heading + off)
    if not (case.late or case.echoes or case.losses or case.common or case.clock):
        return measurements
    ranges = measurements.ranges.copy()
    if case.clock:
        ranges += CLOCK_OFFSET + CLOCK_DRIFT * measurements.dt * measurements.message_step[:, None]
    if case.common:
        late = np.random.default_rng([seed, run, 2])
        excess = late.uniform(*ECHO_EXCESS, (ranges.shape[0], 1))
        ranges += np.where(late.random((ranges.shape[0], 1)) < COMMON_CHANCE, excess, 0.0)
    ranges[:, 1] += LATE if case.late else 0.0
    # drawn in any case, so that what is wrong alone is wrong alike among others
    echo = rng.random(ranges.shape) < ECHO_CHANCE
    excess = rng.uniform(*ECHO_EXCESS, ranges.shape)
    lost = rng.random(ranges.shape[0]) < LOSS_CHANCE
    if case.echoes:
        ranges += np.where(echo, excess, 0.0)
    if case.losses:
        ranges[lost] = np.nan
    return replace(measurements, ranges=ranges)
