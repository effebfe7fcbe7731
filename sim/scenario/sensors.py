"""What a user may set of sensors and of sound: their true errors, no inputs of the navigator."""

from typing import TYPE_CHECKING, Annotated, Self

from pydantic import ConfigDict, Field, create_model, field_validator, model_validator

from sim.scenario.section import LISTED, MOST_POINTS, Chance, NonNegative, Positive, Section, require_increasing

SoundSpeed = Annotated[float, Field(ge=1300, le=1700)]
SpeedAtDepth = Annotated[tuple[NonNegative, SoundSpeed], LISTED]


SpeedBias = Annotated[float, Field(ge=-10, le=10)]
HeadingBias = Annotated[float, Field(ge=-180, le=180)]


class OwnSensors(Section):
    """True errors of a follower's own sensors (paper, Eqs. 26 and 27)."""

    speed_bias_m_s: SpeedBias = 0.2
    speed_sigma_m_s: NonNegative = 0.2
    heading_bias_deg: HeadingBias = 5.0
    heading_sigma_deg: NonNegative = Field(
        2.0, description="each reading errs to starboard by |N(0, σ²)|: one-sided, with mean 0.8 σ (paper, Eq. 27)"
    )
    depth_sigma_m: NonNegative = 0.0
    speed_drift_m_s: Annotated[float, Field(ge=-10, le=10)] = Field(
        0.0, description="the log's bias swings by so much about its mean, as a sine"
    )
    heading_drift_deg: Annotated[float, Field(ge=-180, le=180)] = Field(
        0.0, description="the compass's bias swings likewise"
    )
    drift_period_s: Positive = Field(400.0, description="period of both swings")
    speed_drift_phase_deg: Annotated[float, Field(ge=-360, le=360)] = Field(
        0.0, description="phase of the log's swing at the start; each further follower's is 137.5° ahead"
    )
    heading_drift_phase_deg: Annotated[float, Field(ge=-360, le=360)] = Field(
        0.0, description="phase of the compass's swing likewise"
    )
    gyro_sigma_deg_s: NonNegative = Field(
        0.1, description="σ of each reading of a follower's gyros; followers on stations steer by them"
    )
    tilt_sigma_deg: NonNegative = Field(0.5, description="σ of each reading of its inclinometer, likewise")


class OwnSensor(Section):
    """A sensor of your own; other keys are fields of its class, units may be added."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, bool | int | float | str]

    sensor: str = Field(description="its class, as module:Class", pattern=r"^[\w.]+:[\w.]+$")


class Sensors(OwnSensors):
    """True errors of the sensors of followers and leader; no navigator has access to them."""

    own: Annotated[tuple[OwnSensor, ...], LISTED] = Field((), description="sensors of your own, of each follower")

    leader_speed_bias_m_s: SpeedBias = Field(0.0, description="bias of the speed that the leader broadcasts")
    leader_heading_bias_deg: HeadingBias = 0.0
    leader_heading_sigma_deg: NonNegative = Field(0.0, description="one-sided, as heading_sigma_deg")
    leader_depth_sigma_m: NonNegative = 0.0
    leader_position_drift_m_s: NonNegative = Field(
        0.0, description="the place that the leader broadcasts walks off at this rate, as an inertial navigation does"
    )
    leader_position_drift_deg: Annotated[float, Field(ge=-360, le=360)] = Field(0.0, description="in this direction")
    leader_attitude_sigma_deg: NonNegative = Field(
        0.0, description="σ of each reading of the leader's inclinometer, in pitch and in roll"
    )
    leader_attitude_offset_sigma_deg: NonNegative = Field(
        0.0, description="σ of an error of pitch, and of one of roll, that a run keeps, such as a crooked mounting"
    )
    leader_attitude_feels_acceleration: bool = Field(
        False, description="the inclinometer takes the hull's accelerations for tilt"
    )
    leader_gyro_time_constant_s: Annotated[float, Field(ge=0, le=1000)] = Field(
        0.0, description="time constant of the filter that follows gyros at once, the inclinometer slowly; 0: no gyros"
    )
    leader_gyro_random_walk_deg_sqrt_h: NonNegative = Field(0.3, description="angle random walk of these gyros, per √h")


if TYPE_CHECKING:
    FollowerSensors = OwnSensors
else:
    FollowerSensors = create_model(
        "FollowerSensors",
        __base__=Section,
        __doc__="Errors of one follower's sensors that differ from `[sensors]`; an absent key has the value there.",
        **{
            name: (Annotated[field.annotation, *field.metadata] | None, Field(None, description=field.description))
            for name, field in OwnSensors.model_fields.items()
        },
    )


class Acoustics(Section):
    """True errors of the ranges (paper, Eq. 28), and what sound really does (not in the paper, off by default)."""

    range_tau_m: Annotated[tuple[NonNegative, NonNegative, NonNegative], LISTED] = Field(
        (0.01, 0.01, 0.01), description="τ: uniform error of rear, front and middle transmitter"
    )
    range_error_centred: bool = Field(
        False, description="the uniform error lies in −τ/2 … τ/2; else in 0 … τ, as in the paper"
    )
    range_scale_mean_m: Annotated[float, Field(ge=-100, le=100)] = Field(
        0.1, description="μD: mean of the error that all transmitters share"
    )
    range_scale_sigma_m: NonNegative = Field(0.05, description="σD: its standard deviation")
    travel_time: bool = Field(False, description="sites move while the sound is under way; else it takes no time")
    ping_slot_s: Annotated[float, Field(ge=0, le=2)] = Field(
        0.0, description="rear, front and middle transmitter ping this long after each other; 0: at once"
    )
    sound_speed_m_s: SoundSpeed = Field(1500.0, description="speed of sound, true and as the navigator assumes it")
    sound_speed_bias_m_s: Annotated[float, Field(ge=-100, le=100)] = Field(
        0.0, description="what the navigator's assumption adds to it"
    )
    sound_speed_profile: Annotated[tuple[SpeedAtDepth, ...], LISTED] = Field(
        (),
        max_length=MOST_POINTS,
        description="[[depth_m, speed_m_s], …], linear between; the true speed of sound instead of sound_speed_m_s",
    )
    clock_offset_s: Annotated[float, Field(ge=-1, le=1)] = Field(
        0.0, description="the follower's clock less the leader's, at the start"
    )
    clock_drift_ppm: Annotated[float, Field(ge=-1000, le=1000)] = Field(
        0.0, description="how much faster the follower's clock runs"
    )
    surface_echo_chance: Chance = Field(0.0, description="chance that the surface echo of a ping is taken for it")
    bottom_echo_chance: Chance = Field(0.0, description="chance that the bottom echo of a ping is taken for it")
    common_echoes: bool = Field(
        False, description="all pings of a message take the same path; else each has its own chance of an echo"
    )
    loss_chance: Chance = Field(0.0, description="chance that a message outside bursts is lost")
    burst_chance: Chance = Field(0.0, description="chance that a burst of loss begins at a message")
    burst_mean_messages: Annotated[float, Field(ge=1, le=10000)] = Field(5.0, description="mean length of a burst")
    burst_loss_chance: Chance = Field(1.0, description="chance that a message within a burst is lost")
    max_range_m: NonNegative = Field(0.0, description="pings from farther away are not received; 0: no limit")

    @field_validator("sound_speed_profile")
    @classmethod
    def _depths_increase(cls, points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        require_increasing(points, "point", "m", begins_at_zero=False)
        return points

    @model_validator(mode="after")
    def _chances_add_up(self) -> Self:
        if self.surface_echo_chance + self.bottom_echo_chance > 1:
            raise ValueError(
                f"surface_echo_chance = {self.surface_echo_chance:g} and bottom_echo_chance = "
                f"{self.bottom_echo_chance:g} add up to more than 1"
            )
        return self
