"""Settings of navigators: what all of them are given, the paper's constants, and sensor errors of
filters on ranges.

`Tuning` has the settings of LAISN as formulas take them: numbers alone, so that compiled code can.
"""

from collections import namedtuple
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, get_args

import numpy as np

from laisn.arrays import Offset, require_numbers, require_probability
from laisn.errors import LaisnError

Variant = Literal["laisn-2", "laisn-3-1", "laisn-3-2", "laisn-best", "laisn-main"]
GateRule = Literal["off", "v-max", "v-measured"]
SideRule = Literal["behind", "predicted"]

VARIANTS: tuple[Variant, ...] = get_args(Variant)


def transmitters_of(variant: str) -> int:
    """N_T: how many of the leader's transmitters a variant uses, rear and front first (paper,
    Sections 2.2, 2.3).
    """
    return 2 if variant == "laisn-2" else 3


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What every navigator is given; the settings of a navigator derive from it.

    Raises ValueError naming the field if a value is out of its range.
    """

    POSITIVE: ClassVar[frozenset[str]] = frozenset({"dt", "baseline"})
    """Numbers that must not be zero."""
    SIGNED: ClassVar[frozenset[str]] = frozenset({"hydrophone_height", "middle_offset"})
    """Numbers that may be negative."""

    dt: float = 0.1
    """Filter step Δt [s]."""
    baseline: float = 2.0
    """L, distance between rear and front transmitter [m]."""
    middle_offset: float = 0.1
    """H_T, sideways offset of the middle transmitter, to port [m]."""
    transmitter_offsets: tuple[Offset, ...] = ()
    """Offsets (forward, port, up) of rear, front and perhaps middle transmitter from the leader's
    position [m].

    They replace `baseline` and `middle_offset`, and may be as long as a harbour. Empty: on the
    leader's hull.
    """
    hydrophone_height: float = 0.0
    """Height of the follower's hydrophone above its depth sensor when level [m]."""
    use_attitude: bool = False
    """Place the transmitters by the broadcast pitch and roll instead of assuming a level leader
    (not in the paper).
    """
    ping_slot: float = 0.0
    """Time from the rear to the front ping of a message, and on to the middle one [s]."""
    sound_slowness: float = 0.0
    """Time that sound takes for a metre [s/m]; 0: pings arrive as they leave (paper)."""
    floor_depth: float = 0.0
    """Depth of the sea floor by the chart [m]; 0: unknown."""
    compensate_motion: bool = False
    """Move both vehicles to where they were when each ping left and arrived."""

    @property
    def transmitters(self) -> int:
        """How many of the leader's transmitters are used, rear and front first."""
        return 3

    @property
    def known_start(self) -> bool:
        """Whether the start is given; otherwise the first messages give it."""
        return True

    @property
    def estimated(self) -> frozenset[str]:
        """Constants that are states beside the biases of the navigator's own sensors, named as
        in `TrueNoise`.
        """
        return frozenset()

    def __post_init__(self) -> None:
        require_numbers(self, positive=self.POSITIVE, signed=self.SIGNED)


@dataclass(frozen=True, kw_only=True)
class NavigationSettings(Settings):
    """Settings of LAISN (paper, Section 3.1, unless another source is named)."""

    POSITIVE = Settings.POSITIVE | {"leader_speed_max", "follower_speed_max"}

    variant: Variant = "laisn-2"
    threshold: float = 0.1
    """T: two intersections closer than this count as one, on the leader's axis [m]."""
    beta: float = 0.1
    """β: σp = β / distance between the intersections [m²]."""
    sigma_floor: float = 0.0
    """Minimum σp [m]; paper: none."""
    alpha: float = 8.0
    """α: process noise in manoeuvres [m/s²]."""
    sigma_a0: float = 60.0
    """σa0: process noise in steady motion [m/s²]."""
    sigma_speed: float = 0.2
    """σV of the speed update [m/s]."""
    sigma_heading: float = float(np.deg2rad(2.0))
    """σθ of the speed update [rad]."""
    position_sigma0: float = 0.0
    """p_pos_std: σ of the initial position along each axis [m]."""
    velocity_sigma0: float = 0.0
    """p_vel_std: σ of the initial velocity [m/s]."""
    leader_speed_max: float = 3.0
    """v_max of the leader in γv [m/s]."""
    follower_speed_max: float = 3.0
    """v_max of the follower in γv and in the gate [m/s]."""
    gate: GateRule = "v-max"
    """Gross-error gate (Section 2.4), by maximum or measured speed."""
    side_rule: SideRule = "behind"
    """Side of a fix without two clear intersections: behind (paper) or at the predicted end."""
    expected_pitch: float = 0.0
    """Pitch that adds Δz sin(…) to σp in quadrature [rad] (not in the paper)."""
    use_single_range: bool = False
    """Use a single received range along its line of sight; paper: dropped. Default in the replay of
    a vehicle's log: true."""
    compensate_motion: bool = False
    """Move both vehicles to where they were when each ping left and arrived; paper: not."""

    @property
    def transmitters(self) -> int:
        """N_T: how many of the leader's transmitters the variant uses, rear and front first
        (Sections 2.2, 2.3).
        """
        return transmitters_of(self.variant)

    def __post_init__(self) -> None:
        choices = {"variant": VARIANTS, "gate": get_args(GateRule), "side_rule": get_args(SideRule)}
        for name, allowed in choices.items():
            value = getattr(self, name)
            if value not in allowed:
                raise ValueError(f"{name} is {value!r}; available: {', '.join(allowed)}")
        super().__post_init__()


GATES: tuple[GateRule, ...] = get_args(GateRule)
GATE_OFF = GATES.index("off")
GATE_MEASURED = GATES.index("v-measured")
"""Gate rules as formulas hold them."""


def _numbers(settings: NavigationSettings) -> dict[str, Any]:
    """Settings as numbers: those that are, by their names, and what formulas make of them."""
    values = {field.name: getattr(settings, field.name) for field in fields(settings)}
    return {
        name: value for name, value in values.items() if isinstance(value, bool | int | float)
    } | {
        "variant": VARIANTS.index(settings.variant),
        "gate": GATES.index(settings.gate),
        "predicted_side": settings.side_rule == "predicted",
        "transmitters": settings.transmitters,
        "speed_variance": settings.sigma_speed**2,
        "heading_variance": settings.sigma_heading**2,
        "position_variance0": settings.position_sigma0**2,
        "velocity_variance0": settings.velocity_sigma0**2,
        "sine_of_pitch": float(np.sin(settings.expected_pitch)),
    }


_Numbers: Any = namedtuple("_Numbers", [*_numbers(NavigationSettings())])  # type: ignore[misc]


class Tuning(_Numbers):
    """`NavigationSettings` as numbers, by the names of `_numbers`."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> float: ...

    @classmethod
    def of(cls, settings: NavigationSettings) -> Self:
        """Settings as numbers."""
        return cls(**_numbers(settings))


# Biases of real sensors are never quite constant: a filter that takes them as constant loses them
# for good.
LOG_WALK = 2e-4
COMPASS_WALK = 1.5e-4
CURRENT_WALK = 1e-3
"""Random walks that filters on ranges assume of constant biases and currents [m/s/√s], [rad/√s],
[m/s/√s].
"""


@dataclass(frozen=True, kw_only=True)
class Assume:
    """Model assumptions: what is given, and what is estimated."""

    exact_leader: bool = True
    """No bias of the leader's compass; false: estimate it."""
    drift: bool = False
    """Biases of log and compass drift."""
    deviation: bool = False
    """Compass biases depend on heading, by 3 % of a turn; the leader's too, unless exact."""
    current: bool = False
    """Estimate a current common to leader and follower."""
    offsets: bool = False
    """Estimate a constant range error of each transmitter."""
    clock: bool = False
    """Estimate offset and drift of the follower's clock."""
    steady_speed: bool = False
    """Estimate the speed through the water, which is steady but in manoeuvres."""


@dataclass(frozen=True, kw_only=True)
class TightSettings(Settings):
    """Settings of the tightly coupled navigator: standard deviations of its sensors, without
    their signs.
    """

    POSITIVE = Settings.POSITIVE | {"start_sigma", "range_sigma", "outlier_span"}

    assume: Assume = field(default_factory=Assume)
    transmitters: int = 3
    """How many of rear, front and middle transmitter are used: 2 or 3."""
    known_start: bool = True
    """The start is given; false: initialise from the first message with at least two ranges."""
    start_sigma: float = 0.01
    """σ of the initial position along each axis [m]."""
    speed_sigma: float = 0.2
    """Random σ of a speed log reading [m/s]."""
    speed_bias_sigma: float = 0.3
    """Prior σ of the speed log bias [m/s]."""
    heading_sigma: float = float(np.deg2rad(1.2))
    """Random σ of a compass reading [rad]."""
    heading_bias_sigma: float = float(np.deg2rad(8.0))
    """Prior σ of the compass bias [rad]."""
    range_sigma: float = 0.003
    """Random σ of each range [m]."""
    range_scale_sigma: float = 0.05
    """Random σ common to the ranges of a message, proportional to range, at the longest [m]."""
    range_scale_bias_sigma: float = 0.2
    """Prior σ of the mean of this common error [m]."""
    leader_heading_sigma: float = float(np.deg2rad(1.2))
    """Random σ of a broadcast heading, unless the leader is exact [rad]."""
    leader_heading_bias_sigma: float = float(np.deg2rad(6.0))
    """Prior σ of the broadcast heading bias, unless the leader is exact [rad]."""
    current_sigma: float = 0.4
    """Prior σ of the current along each axis [m/s]."""
    offset_sigma: float = 0.015
    """Prior σ of a transmitter's constant error, relative to the first [m]."""
    clock_offset_sigma: float = 1.5
    """σ of the clocks' offset at the start, as a range [m]: 1 ms, if there may be one."""
    clock_drift_sigma: float = 1.5e-3
    """σ of the rate at which it grows [m/s]: 1 ppm."""
    slip: float = 0.0
    """Motion that the log does not see: leeway and turbulence, in a second [m/√s]."""
    outlier_probability: float = 0.05
    """Chance that a range is an echo's."""
    outlier_span: float = 4.5
    """Maximum excess of an echo's range over the direct range [m]; of an echo common to all ranges
    of a message more, where depths and sea floor allow it."""
    leader_position_sigma: float = 0.0
    """Random σ of the broadcast position along each axis, unless the message states it [m]."""
    leader_position_walk: float = 0.0
    """Random walk of the broadcast position's error along each axis [m/√s]."""
    compensate_motion: bool = True
    """Move both vehicles to where they were when each ping left and arrived."""

    @property
    def estimated(self) -> frozenset[str]:
        """Constants that are states beside the biases of log, compass and ranges, named as in
        `TrueNoise`.
        """
        assume = self.assume
        states = {
            "leader_heading_bias": not assume.exact_leader,
            "current": assume.current,
            "range_offset": assume.offsets,
            "clock": assume.clock,
        }
        return frozenset(name for name, is_state in states.items() if is_state)

    def __post_init__(self) -> None:
        if self.transmitters not in (2, 3):
            raise ValueError(f"transmitters is {self.transmitters}, expected 2 or 3")
        if self.transmitter_offsets and len(self.transmitter_offsets) < self.transmitters:
            raise ValueError(
                f"transmitter_offsets has {len(self.transmitter_offsets)} places, expected one for "
                f"each of {self.transmitters} transmitters"
            )
        require_probability("outlier_probability", self.outlier_probability)
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class RivalSettings(TightSettings):
    """Standard deviations as of the tightly coupled navigator; of its model assumptions
    `current` alone applies.
    """

    POSITIVE = TightSettings.POSITIVE | {"lag", "azimuth_sigma", "elevation_sigma"}

    particles: int = 2000
    """Particle filter: number of particles."""
    lag: float = 20.0
    """Factor graph: time that its window reaches back [s]."""
    azimuth_sigma: float = float(np.deg2rad(1.0))
    """Inverted USBL: σ of the measured azimuth [rad]."""
    elevation_sigma: float = float(np.deg2rad(1.0))
    """Inverted USBL: σ of the measured elevation [rad]."""

    @property
    def estimated(self) -> frozenset[str]:
        """Constants that are states beside the biases of log, compass and ranges: the current,
        if assumed.
        """
        return super().estimated & {"current"}

    def __post_init__(self) -> None:
        if not self.known_start:
            raise LaisnError(
                "known_start is false, which only the tightly coupled navigator can begin with"
            )
        if not 10 <= self.particles <= 1_000_000:
            raise LaisnError(f"particles is {self.particles}, expected 10 to 1000000")
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class BeaconSettings(Settings):
    """Standard deviations of the sensors, by default of a wheeled vehicle with radio ranges.

    Keys of replays are the fields, with the units that end their docstrings.
    """

    POSITIVE = Settings.POSITIVE | {"start_sigma", "range_sigma", "outlier_span"}

    dt: float = 0.1
    """Filter step Δt [s]; steps of other lengths may come between."""
    hydrophone_height: float = 0.0
    """Height of the receiver above the depth sensor when level [m]."""
    known_start: bool = True
    """The start is given. Otherwise the first ranges give it."""
    start_sigma: float = 1.0
    """Standard deviation of the position at the start, along each axis [m]."""
    heading_sigma: float = float(np.deg2rad(5.0))
    """Standard deviation of the heading's error at the start [rad]."""
    gyro_bias_sigma: float = float(np.deg2rad(0.5))
    """Standard deviation of the rate at which that error grows [rad/s]; 0 for a compass."""
    speed_scale_sigma: float = 0.03
    """Standard deviation of the logarithm of true over measured speed."""
    slip: float = 0.05
    """Motion that odometry does not see, in a second, along each axis [m/√s]."""
    heading_walk: float = float(np.deg2rad(0.0573))
    """Random walk of the heading's error beside that rate, in a second [rad/√s]."""
    current_sigma: float = 0.0
    """Standard deviation of a current that carries the vehicle, along each axis [m/s]; 0 for
    none.
    """
    range_sigma: float = 0.5
    """Random error of each range [m]; the estimate for each beacon stays between half and four
    times this.
    """
    range_scale_sigma: float = 0.1
    """Standard deviation of the scale error that all ranges share: of radio. Sound under water
    has 0.003.
    """
    range_offset_sigma: float = 0.1
    """Standard deviation of each beacon's constant error of range [m]."""
    survey_sigma: float = 0.1
    """Standard deviation of each beacon's place, along each axis [m]."""
    track_slip: float = 0.0
    """Random walk of the place of a beacon that moves by odometry of its own, along each axis
    [m/√s]; 0 if its place does not drift.
    """
    track_heading_walk: float = 0.0
    """Random walk of the heading of a beacon that moves by odometry of its own [rad/√s]."""
    outlier_probability: float = 0.05
    """Chance that a range is wrong altogether."""
    outlier_span: float = 20.0
    """Width of the span in which wrong ranges lie [m]; the same for all `MEDIA`, so that their
    evidence compares.
    """

    def __post_init__(self) -> None:
        require_probability("outlier_probability", self.outlier_probability)
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class WaterBeaconSettings(BeaconSettings):
    """The same for sound under water, where a vehicle has a compass and drifts."""

    start_sigma: float = 5.0
    """Standard deviation of the position at the start, along each axis [m]."""
    gyro_bias_sigma: float = 0.0
    """Standard deviation of the rate at which that error grows [rad/s]; 0 for a compass."""
    slip: float = 0.2
    """Motion that the log does not see, in a second, along each axis [m/√s]."""
    current_sigma: float = 0.1
    """Standard deviation of a current that carries the vehicle, along each axis [m/s]."""
    range_scale_sigma: float = 0.003
    """Standard deviation of the scale error that all ranges share."""
    survey_sigma: float = 1.0
    """Standard deviation of each beacon's place, along each axis [m]."""
