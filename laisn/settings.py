"""Settings of navigators: what all of them are given, the paper's constants, and sensor errors of
filters on ranges.

`Tuning` has the settings of LAISN as formulas take them: numbers alone, so that compiled code can.
"""

from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np

from laisn.arrays import Offset, require_numbers
from laisn.errors import LaisnError

Variant = Literal["laisn-2", "laisn-3-1", "laisn-3-2", "laisn-best", "laisn-main"]
GateRule = Literal["off", "v-max", "v-measured"]
SideRule = Literal["behind", "predicted"]

LAISN_VARIANTS: tuple[Variant, ...] = get_args(Variant)


def transmitters_of(variant: str) -> int:
    """N_T: how many of the leader's transmitters a variant uses, rear and front first (paper,
    Sections 2.2, 2.3).
    """
    return 2 if variant == "laisn-2" else 3


def setting(default: Any, unit: str, description: str) -> Any:
    """A field of settings, by its default in an SI unit, or rad; "" of a pure number.

    A key of a scenario file for it has the unit, with degrees in place of radians, and the
    description.
    """
    return field(default=default, metadata={"unit": unit, "description": description})


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What every navigator is given; the settings of a navigator derive from it.

    Raises LaisnError naming the field if a value is out of its range or not of its type.
    """

    POSITIVE: ClassVar[frozenset[str]] = frozenset({"dt", "baseline"})
    """Numbers that must not be zero."""
    SIGNED: ClassVar[frozenset[str]] = frozenset({"hydrophone_height", "middle_offset"})
    """Numbers that may be negative."""

    dt: float = setting(0.1, "s", "Filter step Δt")
    baseline: float = setting(2.0, "m", "L, distance between rear and front transmitter")
    middle_offset: float = setting(
        0.1,
        "m",
        "H_T, sideways offset of the middle transmitter, to port",
    )
    transmitter_offsets: tuple[Offset, ...] = setting(
        (),
        "m",
        "Offsets (forward, port, up) of rear, front and perhaps middle transmitter from the "
        "leader's position. They replace `baseline` and `middle_offset`, and may be as long "
        "as a harbour. Empty: on the leader's hull",
    )
    hydrophone_height: float = setting(
        0.0,
        "m",
        "Height of the follower's hydrophone above its depth sensor when level",
    )
    use_attitude: bool = setting(
        False,
        "",
        "Place the transmitters by the broadcast pitch and roll instead of assuming a level "
        "leader (not in the paper)",
    )
    ping_slot: float = setting(
        0.0,
        "s",
        "Time from the rear to the front ping of a message, and on to the middle one",
    )
    sound_slowness: float = setting(
        0.0,
        "s/m",
        "Time that sound takes for a metre; 0: pings arrive as they leave (paper)",
    )
    floor_depth: float = setting(0.0, "m", "Depth of the sea floor by the chart; 0: unknown")
    compensate_motion: bool = setting(
        False,
        "",
        "Move both vehicles to where they were when each ping left and arrived",
    )

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
        require_numbers(
            self, positive=self.POSITIVE, signed=self.SIGNED, chances={"outlier_probability"}
        )


@dataclass(frozen=True, kw_only=True)
class NavigationSettings(Settings):
    """Settings of LAISN (paper, Section 3.1, unless another source is named)."""

    POSITIVE = Settings.POSITIVE | {"leader_speed_max", "follower_speed_max"}

    variant: Variant = "laisn-2"
    threshold: float = setting(
        0.1,
        "m",
        "T: two intersections closer than this count as one, on the leader's axis",
    )
    beta: float = setting(0.1, "m²", "β: σp = β / distance between the intersections")
    sigma_floor: float = setting(0.0, "m", "Minimum σp; paper: none")
    alpha: float = setting(8.0, "m/s²", "α: process noise in manoeuvres")
    sigma_a0: float = setting(60.0, "m/s²", "σa0: process noise in steady motion")
    sigma_speed: float = setting(0.2, "m/s", "σV of the speed update")
    sigma_heading: float = setting(float(np.deg2rad(2.0)), "rad", "σθ of the speed update")
    position_sigma0: float = setting(
        0.0,
        "m",
        "p_pos_std: σ of the initial position along each axis",
    )
    velocity_sigma0: float = setting(0.0, "m/s", "p_vel_std: σ of the initial velocity")
    leader_speed_max: float = setting(3.0, "m/s", "v_max of the leader in γv")
    follower_speed_max: float = setting(3.0, "m/s", "v_max of the follower in γv and in the gate")
    gate: GateRule = setting(
        "v-max",
        "",
        "Gross-error gate (Section 2.4), by maximum or measured speed",
    )
    side_rule: SideRule = setting(
        "behind",
        "",
        "Side of a fix without two clear intersections: behind (paper) or at the predicted end",
    )
    expected_pitch: float = setting(
        0.0,
        "rad",
        "Pitch that adds Δz sin(…) to σp in quadrature (not in the paper)",
    )
    use_single_range: bool = setting(
        False,
        "",
        "Use a single received range along its line of sight; paper: dropped. Default in the "
        "replay of a vehicle's log: true",
    )
    compensate_motion: bool = setting(
        False,
        "",
        "Move both vehicles to where they were when each ping left and arrived; paper: not",
    )

    @property
    def transmitters(self) -> int:
        """N_T: how many of the leader's transmitters the variant uses, rear and front first
        (Sections 2.2, 2.3).
        """
        return transmitters_of(self.variant)


GATES: tuple[GateRule, ...] = get_args(GateRule)
GATE_OFF = GATES.index("off")
GATE_MEASURED = GATES.index("v-measured")
"""Gate rules as formulas hold them: indices in `GATES`."""


class Tuning(NamedTuple):
    """`NavigationSettings` as numbers, by their names, and what formulas make of them."""

    dt: float
    baseline: float
    middle_offset: float
    hydrophone_height: float
    use_attitude: bool
    ping_slot: float
    sound_slowness: float
    floor_depth: float
    compensate_motion: bool
    threshold: float
    beta: float
    sigma_floor: float
    alpha: float
    sigma_a0: float
    sigma_speed: float
    sigma_heading: float
    position_sigma0: float
    velocity_sigma0: float
    leader_speed_max: float
    follower_speed_max: float
    expected_pitch: float
    use_single_range: bool
    variant: int  # index in LAISN_VARIANTS
    gate: int  # index in GATES
    predicted_side: bool  # whether the rule of sides is "predicted"
    transmitters: int
    speed_variance: float  # [m²/s²]
    heading_variance: float  # [rad²]
    position_variance0: float  # [m²]
    velocity_variance0: float  # [m²/s²]
    sine_of_pitch: float  # of the expected pitch

    @classmethod
    def of(cls, settings: NavigationSettings) -> Self:
        """Settings as numbers."""
        names = {field.name for field in fields(NavigationSettings)}.intersection(cls._fields)
        shared_settings = {name: getattr(settings, name) for name in names - {"variant", "gate"}}
        return cls(
            **shared_settings,
            variant=LAISN_VARIANTS.index(settings.variant),
            gate=GATES.index(settings.gate),
            predicted_side=settings.side_rule == "predicted",
            transmitters=settings.transmitters,
            speed_variance=settings.sigma_speed**2,
            heading_variance=settings.sigma_heading**2,
            position_variance0=settings.position_sigma0**2,
            velocity_variance0=settings.velocity_sigma0**2,
            sine_of_pitch=float(np.sin(settings.expected_pitch)),
        )


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

    exact_leader: bool = setting(True, "", "No bias of the leader's compass; false: estimate it")
    drift: bool = setting(False, "", "Biases of log and compass drift")
    deviation: bool = setting(
        False,
        "",
        "Compass biases change in a turn, by a σ of 3 % of it; the leader's too, unless exact",
    )
    current: bool = setting(False, "", "Estimate a current common to leader and follower")
    offsets: bool = setting(False, "", "Estimate a constant range error of each transmitter")
    clock: bool = setting(False, "", "Estimate offset and drift of the follower's clock")
    steady_speed: bool = setting(
        False,
        "",
        "Estimate the speed through the water, which is steady but in manoeuvres",
    )

    def __post_init__(self) -> None:
        require_numbers(self)


@dataclass(frozen=True, kw_only=True)
class TightSettings(Settings):
    """Settings of the tightly coupled navigator: standard deviations of its sensors, without
    their signs.
    """

    POSITIVE = Settings.POSITIVE | {"start_sigma", "range_sigma", "outlier_span"}

    assume: Assume = field(default_factory=Assume)
    transmitters: int = setting(
        3,
        "",
        "How many of rear, front and middle transmitter are used: 2 or 3",
    )
    known_start: bool = setting(
        True,
        "",
        "The start is given; false: initialise from the first message with at least two ranges",
    )
    start_sigma: float = setting(0.01, "m", "σ of the initial position along each axis")
    speed_sigma: float = setting(0.2, "m/s", "Random σ of a speed log reading")
    speed_bias_sigma: float = setting(0.3, "m/s", "Prior σ of the speed log bias")
    heading_sigma: float = setting(float(np.deg2rad(1.2)), "rad", "Random σ of a compass reading")
    heading_bias_sigma: float = setting(
        float(np.deg2rad(8.0)),
        "rad",
        "Prior σ of the compass bias",
    )
    range_sigma: float = setting(0.003, "m", "Random σ of each range")
    range_scale_sigma: float = setting(
        0.05,
        "m",
        "Random σ common to the ranges of a message, proportional to range, at the longest",
    )
    range_scale_bias_sigma: float = setting(0.2, "m", "Prior σ of the mean of this common error")
    leader_heading_sigma: float = setting(
        float(np.deg2rad(1.2)),
        "rad",
        "Random σ of a broadcast heading, unless the leader is exact",
    )
    leader_heading_bias_sigma: float = setting(
        float(np.deg2rad(6.0)),
        "rad",
        "Prior σ of the broadcast heading bias, unless the leader is exact",
    )
    current_sigma: float = setting(0.4, "m/s", "Prior σ of the current along each axis")
    offset_sigma: float = setting(
        0.015,
        "m",
        "Prior σ of a transmitter's constant error, relative to the first",
    )
    clock_offset_sigma: float = setting(
        1.5,
        "m",
        "σ of the clocks' offset at the start, as a range: 1 ms, if there may be one",
    )
    clock_drift_sigma: float = setting(1.5e-3, "m/s", "σ of the rate at which it grows: 1 ppm")
    slip: float = setting(
        0.0,
        "m/√s",
        "Motion that the log does not see: leeway and turbulence, in a second",
    )
    outlier_probability: float = setting(0.05, "", "Chance that a range is an echo's")
    outlier_span: float = setting(
        4.5,
        "m",
        "Maximum excess of an echo's range over the direct range; of an echo common to all "
        "ranges of a message more, where depths and sea floor allow it",
    )
    leader_position_sigma: float = setting(
        0.0,
        "m",
        "Random σ of the broadcast position along each axis, unless the message states it",
    )
    leader_position_walk: float = setting(
        0.0,
        "m/√s",
        "Random walk of the broadcast position's error along each axis",
    )
    compensate_motion: bool = setting(
        True,
        "",
        "Move both vehicles to where they were when each ping left and arrived",
    )

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
        super().__post_init__()
        if self.transmitters not in (2, 3):
            raise LaisnError(f"transmitters is {self.transmitters}, expected 2 or 3")
        if self.transmitter_offsets and len(self.transmitter_offsets) < self.transmitters:
            raise LaisnError(
                f"transmitter_offsets has {len(self.transmitter_offsets)} places, expected one for "
                f"each of {self.transmitters} transmitters"
            )


@dataclass(frozen=True, kw_only=True)
class RivalSettings(TightSettings):
    """Standard deviations as of the tightly coupled navigator; of its model assumptions
    `current` alone applies.
    """

    POSITIVE = TightSettings.POSITIVE | {"lag", "azimuth_sigma", "elevation_sigma"}

    particles: int = setting(2000, "", "Particle filter: number of particles")
    lag: float = setting(20.0, "s", "Factor graph: time that its window reaches back")
    azimuth_sigma: float = setting(
        float(np.deg2rad(1.0)),
        "rad",
        "Inverted USBL: σ of the measured azimuth",
    )
    elevation_sigma: float = setting(
        float(np.deg2rad(1.0)),
        "rad",
        "Inverted USBL: σ of the measured elevation",
    )

    @property
    def estimated(self) -> frozenset[str]:
        """Constants that are states beside the biases of log, compass and ranges: the current,
        if assumed.
        """
        return super().estimated & {"current"}

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.known_start:
            raise LaisnError(
                "known_start is false, which only the tightly coupled navigator can begin with"
            )
        if not 10 <= self.particles <= 1_000_000:
            raise LaisnError(f"particles is {self.particles}, expected 10 to 1000000")


@dataclass(frozen=True, kw_only=True)
class BeaconSettings(Settings):
    """Standard deviations of the sensors, by default of a wheeled vehicle with radio ranges.

    Keys of replays are the fields, with their units.
    """

    POSITIVE = Settings.POSITIVE | {"start_sigma", "range_sigma", "outlier_span"}

    dt: float = setting(0.1, "s", "Filter step Δt; steps of other lengths may come between")
    hydrophone_height: float = setting(
        0.0,
        "m",
        "Height of the receiver above the depth sensor when level",
    )
    known_start: bool = setting(True, "", "The start is given. Otherwise the first ranges give it")
    start_sigma: float = setting(
        1.0,
        "m",
        "Standard deviation of the position at the start, along each axis",
    )
    heading_sigma: float = setting(
        float(np.deg2rad(5.0)),
        "rad",
        "Standard deviation of the heading's error at the start",
    )
    gyro_bias_sigma: float = setting(
        float(np.deg2rad(0.5)),
        "rad/s",
        "Standard deviation of the rate at which that error grows; 0 for a compass",
    )
    speed_scale_sigma: float = setting(
        0.03,
        "",
        "Standard deviation of the logarithm of true over measured speed",
    )
    slip: float = setting(
        0.05,
        "m/√s",
        "Motion that odometry does not see, in a second, along each axis",
    )
    heading_walk: float = setting(
        float(np.deg2rad(0.0573)),
        "rad/√s",
        "Random walk of the heading's error beside that rate, in a second",
    )
    current_sigma: float = setting(
        0.0,
        "m/s",
        "Standard deviation of a current that carries the vehicle, along each axis; 0 for none",
    )
    range_sigma: float = setting(
        0.5,
        "m",
        "Random error of each range; the estimate for each beacon stays between half and four "
        "times this",
    )
    range_scale_sigma: float = setting(
        0.1,
        "",
        "Standard deviation of the scale error that all ranges share: of radio. Sound under "
        "water has 0.003",
    )
    range_offset_sigma: float = setting(
        0.1,
        "m",
        "Standard deviation of each beacon's constant error of range",
    )
    survey_sigma: float = setting(
        0.1,
        "m",
        "Standard deviation of each beacon's place, along each axis",
    )
    track_slip: float = setting(
        0.0,
        "m/√s",
        "Random walk of the place of a beacon that moves by odometry of its own, along each axis; "
        "0 if its place does not drift",
    )
    track_heading_walk: float = setting(
        0.0,
        "rad/√s",
        "Random walk of the heading of a beacon that moves by odometry of its own",
    )
    outlier_probability: float = setting(0.05, "", "Chance that a range is wrong altogether")
    outlier_span: float = setting(
        20.0,
        "m",
        "Width of the span in which wrong ranges lie; the same for all `MEDIA`, so that their "
        "evidence compares",
    )


@dataclass(frozen=True, kw_only=True)
class WaterBeaconSettings(BeaconSettings):
    """The same for sound under water, where a vehicle has a compass and drifts."""

    start_sigma: float = setting(
        5.0,
        "m",
        "Standard deviation of the position at the start, along each axis",
    )
    gyro_bias_sigma: float = setting(
        0.0,
        "rad/s",
        "Standard deviation of the rate at which that error grows; 0 for a compass",
    )
    slip: float = setting(
        0.2,
        "m/√s",
        "Motion that the log does not see, in a second, along each axis",
    )
    current_sigma: float = setting(
        0.1,
        "m/s",
        "Standard deviation of a current that carries the vehicle, along each axis",
    )
    range_scale_sigma: float = setting(
        0.003,
        "",
        "Standard deviation of the scale error that all ranges share",
    )
    survey_sigma: float = setting(
        1.0,
        "m",
        "Standard deviation of each beacon's place, along each axis",
    )
