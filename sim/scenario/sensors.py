"""What a user may set of sensors and of sound: their true errors, no inputs of the navigator."""

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import ConfigDict, Field, create_model, model_validator

from sim.scenario.class_keys import ClassValue
from sim.scenario.section import (
    LIST_OR_TUPLE,
    MAX_POINTS,
    SENSOR_CLASS,
    Angle,
    Chance,
    Idle,
    NonNegative,
    PerRun,
    Positive,
    Section,
    increasing,
)

SoundSpeed = Annotated[float, Field(ge=1300, le=1700)]
SpeedAtDepth = Annotated[tuple[NonNegative, SoundSpeed], LIST_OR_TUPLE]
SpeedBias = Annotated[float, Field(ge=-10, le=10), PerRun]
HeadingBias = Annotated[float, Field(ge=-180, le=180), PerRun]
Sigma = Annotated[NonNegative, PerRun]
LossProbability = Annotated[Chance, PerRun]
_RangeError = Annotated[float, Field(ge=0, le=100)]
_OF_BURSTS = Idle(key="burst_probability")
_OF_LEVELS = Idle(key="source_level_db")


class OwnSensors(Section):
    """True errors of a follower's own sensors (paper, Eqs. 26 and 27)."""

    speed_bias_m_s: SpeedBias = 0.2
    speed_sigma_m_s: Sigma = 0.2
    heading_bias_deg: HeadingBias = 5.0
    heading_sigma_deg: Sigma = Field(
        2.0,
        description="σ of the error to starboard, the absolute value of a normal number (paper, "
        "Eq. 27)",
    )
    depth_sigma_m: Sigma = 0.0
    speed_drift_m_s: float = Field(
        0.0, ge=-10, le=10, description="amplitude of a sinusoidal drift of the speed bias"
    )
    heading_drift_deg: Annotated[float, Field(ge=-180, le=180)] = Field(
        0.0, description="amplitude of a sinusoidal drift of the heading bias"
    )
    drift_period_s: Positive = 400.0
    speed_drift_phase_deg: Annotated[Angle, Idle(key="speed_drift_m_s")] = Field(
        0.0, description="at the start; each further follower adds 137.5°"
    )
    heading_drift_phase_deg: Annotated[Angle, Idle(key="heading_drift_deg")] = Field(
        0.0, description="at the start; each further follower adds 137.5°"
    )
    gyro_sigma_deg_s: Sigma = Field(0.1, description="for followers on stations")
    tilt_sigma_deg: Sigma = Field(0.5, description="of the inclinometer, for followers on stations")


class CustomSensor(Section):
    """A further sensor. Other keys are fields of its class, with or without unit."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, ClassValue]

    sensor: str = Field(
        description="dvl, inverted-usbl, inclinometer, gyros, or class, as module:Class",
        pattern=SENSOR_CLASS,
    )


class Sensors(OwnSensors):
    """True errors of all sensors, not passed to navigators."""

    custom: Annotated[tuple[CustomSensor, ...], LIST_OR_TUPLE] = Field(
        (), description="further sensors of each follower, shipped or your own"
    )
    leader_speed_bias_m_s: SpeedBias = 0.0
    leader_speed_sigma_m_s: Sigma = 0.0
    leader_heading_bias_deg: HeadingBias = 0.0
    leader_heading_sigma_deg: Sigma = Field(0.0, description="one-sided, as heading_sigma_deg")
    leader_depth_sigma_m: Sigma = 0.0
    leader_position_drift_m_s: NonNegative = 0.0
    leader_position_drift_deg: Annotated[Angle, Idle(key="leader_position_drift_m_s")] = Field(
        0.0, description="its compass direction"
    )
    leader_position_sigma_m: Sigma = Field(
        0.0, description="of the broadcast position along each axis, anew in each message"
    )
    leader_position_walk_m_sqrt_s: Sigma = Field(
        0.0, description="random walk of the broadcast position along each axis, from 0"
    )
    leader_attitude_sigma_deg: Sigma = Field(0.0, description="of the inclinometer, pitch and roll")
    leader_attitude_offset_sigma_deg: Sigma = Field(
        0.0, description="σ of constant offsets of a run, as from mounting"
    )
    leader_attitude_senses_acceleration: bool = Field(
        False, description="of the hull, beside gravity"
    )
    leader_gyro_time_constant_s: Annotated[float, Field(ge=0, le=1000)] = Field(
        0.0, description="of the complementary filter of gyros and inclinometer; 0: no gyros"
    )
    leader_gyro_random_walk_deg_sqrt_h: Annotated[
        Sigma, Idle(key="leader_gyro_time_constant_s")
    ] = 0.3


LEADER_PREFIX = "leader_"
"""Prefix of the keys of `[sensors]` for the leader's own sensors and broadcasts."""

# for type checkers; at run time every key is optional: None means that `[sensors]` holds
if TYPE_CHECKING:

    class VehicleSensors(OwnSensors):
        custom: tuple[CustomSensor, ...] | None = None

else:
    VehicleSensors = create_model(
        "VehicleSensors",
        __base__=Section,
        __doc__="Errors of one vehicle's own sensors. Keys and defaults of a follower: `[sensors]` "
        "without `leader_…`; of the leader: `sensors.leader_…` where there is such a key, no drift "
        "and no `custom`.",
        custom=(
            Annotated[tuple[CustomSensor, ...], LIST_OR_TUPLE] | None,
            Field(None, description="further sensors of this vehicle"),
        ),
        **{
            name: (
                Annotated[field.annotation, *field.metadata] | None,
                Field(None, description=field.description),
            )
            for name, field in OwnSensors.model_fields.items()
        },
    )


class Acoustics(Section):
    """True errors of ranges (paper, Eq. 28), and physical acoustics (not in the paper, off by
    default).
    """

    range_tau_m: Annotated[tuple[_RangeError, _RangeError, _RangeError], LIST_OR_TUPLE, PerRun] = (
        Field(
            (0.01, 0.01, 0.01), description="τ, uniform error of rear, front and middle transmitter"
        )
    )
    range_error_centred: Annotated[bool, PerRun] = Field(
        False, description="uniform error in −τ/2 … τ/2; false: 0 … τ (paper)"
    )
    # mean and σ of ψ, one number for all ranges of a message: the longest range to a transmitter
    # errs by ψ, a shorter one in proportion
    range_scale_mean_m: Annotated[float, Field(ge=-100, le=100), PerRun] = Field(
        0.1,
        description="μD, mean of ψ: error of a message's longest range; shorter ones err in "
        "proportion",
    )
    range_scale_sigma_m: Annotated[_RangeError, PerRun] = Field(
        0.05, description="σD, standard deviation of ψ"
    )
    travel_time: bool = Field(
        False, description="vehicles move while sound is under way; false: it arrives at once"
    )
    ping_slot_s: Annotated[float, Field(ge=0, le=2)] = Field(
        0.0, description="between rear, front and middle ping"
    )
    sound_speed_m_s: SoundSpeed = Field(1500.0, description="true and assumed")
    sound_speed_bias_m_s: Annotated[float, Field(ge=-100, le=100)] = Field(
        0.0, description="assumed minus true speed"
    )
    sound_speed_profile: Annotated[
        tuple[SpeedAtDepth, ...], LIST_OR_TUPLE, increasing("point", "m")
    ] = Field(
        (),
        max_length=MAX_POINTS,
        description=("[[depth_m, speed_m_s], …], interpolated; replaces the true sound_speed_m_s"),
    )
    rays: Literal["straight", "refracted"] = Field(
        "straight",
        description="straight at the mean slowness, or refracted: bent by a smooth curve through "
        "the profile",
    )
    clock_offset_s: float = Field(
        0.0, ge=-1, le=1, description="follower's minus leader's clock at the start"
    )
    clock_drift_ppm: Annotated[float, Field(ge=-1000, le=1000)] = 0.0
    surface_echo_probability: Chance = Field(
        0.0, description="probability that a ping's surface echo is taken for it"
    )
    bottom_echo_probability: Chance = Field(
        0.0, description="probability that a ping's bottom echo is taken for it"
    )
    common_echoes: Annotated[bool, PerRun] = Field(
        False, description="all pings of a message take the same path"
    )
    loss_probability: LossProbability = Field(0.0, description="of a message, outside bursts")
    burst_probability: LossProbability = Field(
        0.0, description="per message, that a burst of losses starts"
    )
    burst_mean_messages: Annotated[float, Field(ge=1, le=10000), PerRun, _OF_BURSTS] = 5.0
    burst_loss_probability: Annotated[LossProbability, _OF_BURSTS] = Field(
        1.0, description="of a message within a burst"
    )
    max_range_m: NonNegative = Field(0.0, description="of reception; 0: no limit")
    message_length_s: Annotated[float, Field(ge=0, le=10)] = Field(
        0.0, description="duration of a message; it is received when its end has arrived"
    )
    ranging_pulse: Annotated[Literal["start", "end"], Idle(key="message_length_s")] = Field(
        "start", description="pings at the start of a message, or when it ends"
    )
    source_level_db: Annotated[float, Field(ge=0, le=250)] = Field(
        0.0,
        description="re 1 µPa at 1 m; with it the range decides on what is heard, beside "
        "loss_probability; 0: it does not",
    )
    frequency_khz: Annotated[float, Field(ge=1, le=200), _OF_LEVELS] = 25.0
    bandwidth_khz: Annotated[float, Field(gt=0, le=100), _OF_LEVELS] = 5.0
    spreading: Annotated[float, Field(ge=1, le=2), _OF_LEVELS] = Field(
        1.5, description="k of the loss k · 10 log r; 2: spherical, 1: cylindrical"
    )
    detection_threshold_db: Annotated[float, Field(ge=-50, le=50), _OF_LEVELS] = Field(
        10.0, description="level over the noise at which half of the messages are heard"
    )
    level_sigma_db: Annotated[float, Field(ge=0, le=20), _OF_LEVELS] = Field(
        3.0, description="scatter of levels from message to message"
    )
    wind_m_s: Annotated[float, Field(ge=0, le=40), _OF_LEVELS] = Field(
        5.0, description="for ambient noise"
    )
    shipping: Annotated[float, Field(ge=0, le=1), _OF_LEVELS] = Field(
        0.5, description="ships, from 0 (none) to 1 (heavy traffic), for ambient noise"
    )
    water_temperature_c: Annotated[float, Field(ge=-2, le=35), _OF_LEVELS] = Field(
        10.0, description="for absorption"
    )
    salinity: Annotated[float, Field(ge=0, le=42), _OF_LEVELS] = Field(
        35.0, description="for absorption [g/kg]"
    )

    @model_validator(mode="after")
    def _chances_add_up(self) -> Self:
        if self.surface_echo_probability + self.bottom_echo_probability > 1:
            raise ValueError(
                f"surface_echo_probability = {self.surface_echo_probability:g} and "
                f"bottom_echo_probability = {self.bottom_echo_probability:g} add up to more than 1"
            )
        return self
