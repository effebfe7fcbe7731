"""What a user may set of further links: who sends messages with pings beside the leader."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sim.scenario.section import LIST_OR_TUPLE, Coordinate, Name, NonNegative, Positive, Section

LEADER_LINK = "leader"
"""Name of the leader's broadcast."""
Place = Annotated[tuple[Coordinate, Coordinate, NonNegative], LIST_OR_TUPLE]
"""East, north and depth [m]."""
Offset = Annotated[tuple[Coordinate, Coordinate, Coordinate], LIST_OR_TUPLE]
"""Forward, port and up in a vehicle's hull [m]."""
Quantity = Literal["position", "heading", "speed", "depth", "attitude"]
_DEFAULT_TRANSMITTERS = ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.1, 0.0))
"""Offsets of the rear, front and middle transmitter: those of the leader's hull."""


class LinkTable(Section):
    """Messages of a vehicle, or of beacons at rest, to `receivers`."""

    name: Name = Field(description='what navigation.link calls it; not "leader"')
    sender: Name | None = Field(None, description="name of the vehicle that sends")
    transmitters_m: Annotated[
        tuple[Offset, ...], LIST_OR_TUPLE, Field(min_length=1, max_length=3)
    ] = Field(
        _DEFAULT_TRANSMITTERS,
        description="[[forward, port, up], …] of the sender's rear, front and middle "
        "transmitter from its origin",
    )
    beacons_m: Annotated[tuple[Place, ...], LIST_OR_TUPLE, Field(max_length=3)] = Field(
        (), description="[[east, north, depth], …] of beacons at rest, in place of a sender"
    )
    interval_s: Positive | None = Field(
        None, description="between messages; default: timing.message_interval_s"
    )
    offset_s: NonNegative = Field(
        0.0, description="by which all messages are later than multiples of the interval"
    )
    answers: Name | None = Field(
        None,
        description="link whose messages the sender answers, in place of a schedule",
    )
    delay_s: Annotated[float, Field(ge=0, le=60)] = Field(
        0.5, description="of an answer, from the arrival of the request's rear ping to its own"
    )
    receivers: Annotated[tuple[Name, ...], LIST_OR_TUPLE] = Field(
        (),
        description='names of followers, or "leader"; default: all followers but the sender',
    )
    position: Literal["truth", "estimate"] = Field(
        "truth",
        description="in its messages: where the sender is, with the errors sensors.leader_…, or "
        "what its navigator and its sensors say",
    )
    content: Annotated[tuple[Quantity, ...], LIST_OR_TUPLE] = Field(
        ("position", "heading", "speed", "depth", "attitude"),
        description="what its messages hold, beside the time; pitch and roll if "
        "leader.broadcast_attitude",
    )
    readings: Annotated[tuple[Name, ...], LIST_OR_TUPLE] = Field(
        (), description="names of further sensors of the sender whose readings they hold"
    )

    @model_validator(mode="after")
    def _one_sender(self) -> Self:
        if (self.sender is None) == (not self.beacons_m):
            raise ValueError("a link has either a sender or beacons_m")
        if self.beacons_m and (self.answers or self.position == "estimate" or self.readings):
            raise ValueError("answers, position and readings are of a link with a sender")
        if self.answers and (self.interval_s or self.offset_s):
            raise ValueError("answers replaces interval_s and offset_s")
        if self.name == LEADER_LINK:
            raise ValueError('name "leader" is that of the leader\'s broadcast')
        if len(set(self.beacons_m)) < len(self.beacons_m):
            raise ValueError("beacons_m has a place twice")
        return self
