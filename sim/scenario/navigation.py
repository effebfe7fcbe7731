"""What a user may set of a follower's navigation: what it believes, and how it decides."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from laisn.settings import AnyVariant, GateRule, SideRule, transmitters_of
from sim.scenario.section import LISTED, Coordinate, NonNegative, Positive, Section

Offset = Annotated[tuple[Coordinate, Coordinate, Coordinate], LISTED]


class Assume(Section):
    """What the tightly coupled navigator takes as given, and how good it takes its sensors to be; LAISN ignores it."""

    transmitters: Literal[2, 3] = Field(3, description="how many it uses: rear and front, or the middle one too")
    known_start: bool = Field(True, description="the start is given; else the first message gives it")
    exact_leader: bool = Field(True, description="the leader's compass has no bias; else that is estimated")
    drift: bool = Field(False, description="biases of log and compass drift; the compass has a deviation")
    current: bool = Field(False, description="the water moves; the current is estimated")
    offsets: bool = Field(False, description="a transmitter may be early or late by a constant time")
    start_sigma_m: Positive = Field(0.01, description="σ of the start along each axis")
    speed_sigma_m_s: NonNegative = Field(0.2, description="σ of each reading of the speed log")
    speed_bias_sigma_m_s: NonNegative = Field(0.3, description="σ of the log's bias before the mission")
    heading_sigma_deg: NonNegative = Field(1.2, description="σ of each reading of the compass")
    heading_bias_sigma_deg: NonNegative = Field(8.0, description="σ of the compass's bias before the mission")
    range_sigma_m: Positive = Field(0.003, description="σ of each range's own error")
    range_scale_sigma_m: NonNegative = Field(
        0.05, description="σ of the error that the ranges of a message share in proportion, at the longest"
    )
    range_scale_bias_sigma_m: NonNegative = Field(0.2, description="σ of that error's mean before the mission")
    leader_heading_sigma_deg: NonNegative = Field(1.2, description="σ of each heading of the leader, if not exact")
    leader_heading_bias_sigma_deg: NonNegative = Field(6.0, description="σ of its bias, if not exact")
    current_sigma_m_s: NonNegative = Field(0.4, description="σ of the current along each axis, if there may be one")
    offset_sigma_m: NonNegative = Field(0.015, description="σ of a transmitter's offset, if there may be one")
    slip_m_sqrt_s: NonNegative | None = Field(
        None, description="motion that the log does not see, in a second; default: that of the vehicles, 0 of points"
    )
    outlier_chance: Annotated[float, Field(gt=0, lt=1)] = Field(0.05, description="chance that a range is an echo's")
    outlier_span_m: Positive = Field(4.5, description="largest excess of an echo's range")


class Navigation(Section):
    """What the follower believes, and how it decides."""

    variant: AnyVariant = Field("laisn-2", description="which LAISN, or the tightly coupled navigator")
    assume: Assume = Assume()
    threshold_m: NonNegative = Field(0.1, description="T: intersections closer than this are one")
    beta_m2: NonNegative = Field(0.1, description="β: σp = β / distance of the intersections")
    sigma_floor_m: NonNegative = Field(0.0, description="smallest σp that the filter is given")
    alpha_m_s2: NonNegative = Field(8.0, description="α: process noise of manoeuvres")
    sigma_a0_m_s2: Positive = Field(60.0, description="σa0: process noise of steady motion")
    sigma_speed_m_s: Positive = Field(0.2, description="σV of the speed update")
    sigma_heading_deg: Positive = Field(2.0, description="σθ of the speed update")
    position_sigma0_m: NonNegative = Field(0.0, description="uncertainty of the start")
    velocity_sigma0_m_s: NonNegative = Field(0.0, description="uncertainty of the start")
    leader_speed_max_m_s: Positive = Field(3.0, description="v_max of the leader in γv")
    follower_speed_max_m_s: Positive = Field(3.0, description="v_max of the follower in γv and in the gate")
    gate: GateRule = Field("v-max", description="gross-error gate")
    side_rule: SideRule = Field("behind", description="where a fix without clear intersections goes")
    use_attitude: bool = Field(False, description="place the transmitters by the broadcast pitch and roll")
    expected_pitch_deg: NonNegative = Field(0.0, description="pitch that inflates σp")
    use_single_range: bool = Field(
        False,
        description="where one range alone arrived, move the estimate along its line of sight; unless it stands here "
        "as false, a replay of a vehicle's log does so",
    )
    transmitters_m: Annotated[tuple[Offset, ...], LISTED, Field(max_length=3)] = Field(
        (),
        description="[[forward, port, up], …] of rear, front and perhaps middle transmitter from the leader's "
        "position, as the follower believes; replaces leader.baseline_m and leader.middle_offset_m",
    )

    hydrophone_height_m: Annotated[float, Field(ge=-1000, le=1000)] | None = Field(
        None,
        description="height of the hydrophone above the depth sensor, as the follower believes; default: the hull's",
    )

    @property
    def transmitters(self) -> int:
        """How many of the leader's transmitters the follower listens to, rear and front first."""
        return self.assume.transmitters if self.variant == "tight" else transmitters_of(self.variant)

    @field_validator("transmitters_m")
    @classmethod
    def _two_places(cls, offsets: tuple[Offset, ...]) -> tuple[Offset, ...]:
        if offsets and (len(offsets) < 2 or offsets[0][:2] == offsets[1][:2]):
            raise ValueError("needs a rear and a front transmitter, one before, behind or beside the other")
        return offsets
