"""What a user may set of the vehicles: routes, depths, hulls."""

import difflib
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, PlainSerializer, field_validator, model_validator

import models
from laisn.errors import LaisnError
from sim.scenario.formation import Station
from sim.scenario.navigation import FollowerNavigation, Navigation
from sim.scenario.routes import FOLLOWER_DEPTH, LEADER_DEPTH
from sim.scenario.section import (
    CUSTOM_CLASS,
    LIST_OR_TUPLE,
    MAX_POINTS,
    Because,
    Coordinate,
    Idle,
    Name,
    NonNegative,
    Positive,
    Section,
    increasing,
)
from sim.scenario.sensors import VehicleSensors
from sim.system import read_text

HIDDEN_ERRORS = ("sensors", "drag_scale", "added_mass_scale", "lift_scale", "thrust_scale")
"""Keys of a vehicle with the errors of its sensors and of its hull, which it cannot know."""
LONGEST_MODEL = 1_000_000  # length of the text of a hull, and size of its file [bytes]
Scale = Annotated[float, Field(ge=0.1, le=10)]
TimedPoint = Annotated[tuple[NonNegative, Coordinate, Coordinate], LIST_OR_TUPLE]
TimedDepth = Annotated[tuple[NonNegative, NonNegative], LIST_OR_TUPLE]


def is_mjcf(model: str) -> bool:
    """Whether this is the text of a hull, and not the name of its file."""
    return model.lstrip().startswith("<")


def _vehicle_hint(model: str) -> str:
    """The vehicles, for the name of a file that has no ending and cannot be read."""
    name = Path(model).name
    if Path(model).suffix:
        return ""
    close = difflib.get_close_matches(name.lower(), models.VEHICLES, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"; {hint}vehicles: {', '.join(models.VEHICLES)}, or the file of an own hull"


class Vehicle(Section):
    """Keys of leader and followers."""

    MOTION_INDEPENDENT: ClassVar[dict[str, Any]] = {"sensors": VehicleSensors()}
    """Keys on which the motion of a vehicle does not depend, and their values in `as_it_moves`."""

    route: Name | None = Field(None, description="library route: L, T2 … T9")
    waypoints: Annotated[tuple[TimedPoint, ...], LIST_OR_TUPLE, increasing("waypoint", "s")] = (
        Field(
            (),
            max_length=MAX_POINTS,
            description="[[time_s, east_m, north_m], …] from time 0, in place of route; a position "
            "given twice is a stop",
        )
    )
    start_speed_m_s: Annotated[float, Field(ge=0, le=3)] | None = Field(
        None,
        description="over ground, at the start; default: 1 m/s on a library route, the mean speed "
        "of the first leg on waypoints, the leader's on a station",
    )
    model: Annotated[str, Field(max_length=LONGEST_MODEL)] | None = Field(
        None,
        description="vehicle of `laisn vehicles`, or own MJCF hull, path relative to this file",
    )
    depth_m: NonNegative = LEADER_DEPTH
    depth_profile: Annotated[tuple[TimedDepth, ...], LIST_OR_TUPLE, increasing("depth", "s")] = (
        Field(
            (),
            max_length=MAX_POINTS,
            description="[[time_s, depth_m], …], interpolated; replaces depth_m",
        )
    )
    saw_tooth_amplitude_m: NonNegative = Field(0.0, description="about the depth")
    saw_tooth_period_s: Annotated[Positive, Idle(key="saw_tooth_amplitude_m")] = 120.0
    trim: Literal["file", "neutral"] = Field(
        "file",
        description="buoyancy of the hull's file in the density of the water, or equal to the "
        "weight there, as a vehicle is ballasted before a dive",
    )
    excess_buoyancy_n: float = Field(
        0.0, ge=-100, le=100, description="added to the buoyancy; held by the autopilot"
    )
    cg_offset_x_m: float = Field(
        0.0, ge=-0.2, le=0.2, description="forward shift of the centre of gravity"
    )
    cg_offset_z_m: float = Field(
        0.0, ge=-0.1, le=0.1, description="upward shift of the centre of gravity"
    )
    drag_scale: Scale = Field(
        1.0, description="simulated over nominal drag and damping; autopilots use nominal values"
    )
    added_mass_scale: Scale = Field(1.0, description="simulated over nominal")
    lift_scale: Scale = Field(1.0, description="of hull and fins")
    thrust_scale: Scale = Field(1.0, description="actual over commanded thrust")
    depth_control: Literal["pitch", "thrust"] | None = Field(
        None,
        description="by hull pitch, or level by vertical thrusters; default: by pitch if the hull "
        "lifts",
    )
    roll_control: Literal["hold", "free"] | None = Field(
        None,
        description="at zero by the effectors, or left to the hull; default: held if the effectors "
        "have the authority (docs/vehicles.md)",
    )
    controller: Annotated[str, Field(pattern=CUSTOM_CLASS)] | None = Field(
        None, description="own controller, module:Class; route or station give the start"
    )
    sensors: VehicleSensors = Field(
        VehicleSensors(),
        description="errors of this vehicle's own sensors, also in what it broadcasts; default: "
        "those of [sensors]",
    )
    hydrophone_m: Annotated[tuple[Coordinate, Coordinate, Coordinate], LIST_OR_TUPLE] | None = (
        Field(
            None, description="[forward, port, up] from the origin; default: where the hull has it"
        )
    )

    @property
    def as_it_moves(self) -> Self:
        """The vehicle as far as its motion depends on its keys: all others have the values of
        MOTION_INDEPENDENT.
        """
        return self.model_copy(update=self.MOTION_INDEPENDENT)

    @property
    def without_hidden_errors(self) -> Self:
        """The vehicle as its controller may know it: keys of HIDDEN_ERRORS have their defaults."""
        fields = type(self).model_fields
        return self.model_copy(update={key: fields[key].default for key in HIDDEN_ERRORS})

    @model_validator(mode="before")
    @classmethod
    def _waypoints_replace_route(cls, data: object) -> object:
        return {**data, "route": None} if isinstance(data, dict) and data.get("waypoints") else data

    @field_validator("model")
    @classmethod
    def _text_of_hull(cls, model: str | None) -> str | None:
        """The text of a hull that is given by the name of its file."""
        if model is None or is_mjcf(model):
            return model
        if model in models.VEHICLES:
            return models.path(model).read_text("utf-8")
        try:
            text = read_text(Path(model), LONGEST_MODEL)
        except LaisnError as error:
            raise ValueError(f"cannot be read: {error}{_vehicle_hint(model)}") from None
        if not is_mjcf(text):
            raise ValueError("cannot be read: it is no XML")
        return text

    @property
    def held_depth_m(self) -> float:
        """Depth that the vehicle holds where there is no profile."""
        return self.depth_m

    @model_validator(mode="after")
    def _one_route(self) -> Self:
        if not self.route and len(self.waypoints) < 2:
            raise ValueError(
                "a vehicle needs a route of the library or waypoints of its own, two at least"
            )
        return self


_TRANSMITTERS_NEAR = (
    "the transmitters are on the leader's hull of 2 m, or a little beyond its ends; an own hull "
    "(leader.model) has them anywhere"
)


class LeaderNavigation(Navigation):
    """Navigator of the leader itself: keys of `[navigation]`, where link "leader" is none."""


class Leader(Vehicle):
    """The vehicle with the transmitters."""

    MOTION_INDEPENDENT: ClassVar[dict[str, Any]] = {
        **Vehicle.MOTION_INDEPENDENT,
        # the transmitters are where the hull has them
        "baseline_m": None,
        "middle_offset_m": None,
        "broadcast_attitude": False,
        "broadcast_waypoints": 0,
        "broadcast_position": "truth",
        "navigation": None,
    }

    route: Name | None = Field("L", description="library route: L, T2 … T9")
    # the limits hold for a number; None takes the sites of the hull
    baseline_m: Annotated[
        Annotated[float, Field(ge=0.01, le=2.4)] | None, Because(text=_TRANSMITTERS_NEAR)
    ] = Field(2.0, description="L, rear to front transmitter; default on an own hull: its sites")
    middle_offset_m: Annotated[
        Annotated[float, Field(ge=0.001, le=0.5)] | None, Because(text=_TRANSMITTERS_NEAR)
    ] = Field(
        0.1,
        description="H_T, port offset of the middle transmitter; default on an own hull: its site",
    )
    broadcast_attitude: bool = Field(
        False, description="broadcast measured pitch and roll; default with stations: true"
    )
    broadcast_waypoints: Annotated[int, Field(ge=0, le=20)] = Field(
        0,
        description="next waypoints in each message, for followers on stations; default with "
        "stations: 2",
    )
    broadcast_position: Literal["truth", "estimate"] = Field(
        "truth",
        description="broadcast where it is, with the errors sensors.leader_…, or what its "
        "navigator and its sensors say",
    )
    guidance_position: Literal["truth", "estimate"] = Field(
        "truth", description="position used for guidance along its route"
    )
    navigation: LeaderNavigation | None = Field(
        None, description="its own navigator, by which it may steer and broadcast"
    )

    @model_validator(mode="before")
    @classmethod
    def _sites_of_own_hull(cls, data: Any) -> Any:
        """On a hull of the user's own transmitters stay where its MJCF has them, unless a key
        places them.
        """
        has_hull_file = isinstance(data, dict) and data.get("model")
        return {"baseline_m": None, "middle_offset_m": None, **data} if has_hull_file else data


def _explicit_keys(section: Section | None) -> dict[str, Any] | None:
    """The keys of a table that are set, as a file has them."""
    if section is None:
        return None
    return section.model_dump(mode="json", exclude_unset=True, exclude_none=True)


class Follower(Vehicle):
    """A vehicle with one hydrophone, on a route or on a station."""

    MOTION_INDEPENDENT: ClassVar[dict[str, Any]] = {
        **Vehicle.MOTION_INDEPENDENT,
        "navigation": None,
    }

    name: Name = "follower"
    depth_m: NonNegative = FOLLOWER_DEPTH
    station: Station | None = Field(
        None,
        description="{behind_m, port_m, depth_m}: keeps its place in the leader's trail; replaces "
        "a route",
    )
    start_m: Annotated[tuple[Coordinate, Coordinate], LIST_OR_TUPLE] | None = Field(
        None, description="[east, north] of the start; default: the station"
    )
    guidance_position: Literal["truth", "estimate"] | None = Field(
        None,
        description="position used for guidance; default: truth on a route, estimate on a station",
    )
    navigation: Annotated[FollowerNavigation | None, PlainSerializer(_explicit_keys)] = Field(
        None, description="its own navigator: keys of [navigation] that differ for it"
    )

    @property
    def guided_by_estimate(self) -> bool:
        """Whether it steers by its own estimate; a controller of the user's always does."""
        position = self.guidance_position or ("estimate" if self.station else "truth")
        return bool(self.controller) or position == "estimate"

    @property
    def held_depth_m(self) -> float:
        """Depth that the vehicle holds where there is no profile."""
        return self.station.depth_m if self.station else self.depth_m

    @model_validator(mode="after")
    def _one_route(self) -> Self:
        if not self.route and len(self.waypoints) < 2 and not self.station:
            expected = "a route of the library, waypoints of its own or a station"
            raise ValueError(f"a follower needs {expected}; waypoints are two at least")
        if self.station and (
            self.route or self.waypoints or self.depth_profile or self.saw_tooth_amplitude_m
        ):
            raise ValueError(
                "a follower on a station has no route, waypoints, depth_profile or saw-tooth "
                "beside it"
            )
        if self.start_m and not self.station:
            raise ValueError(
                "start_m is for followers on stations; a route begins at its first waypoint"
            )
        return self
