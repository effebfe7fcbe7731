"""A mission as data: everything a user may set, validated, frozen. Degrees and units stand in
the names.
"""

from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
import tomli_w
from pydantic import (
    AfterValidator,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from laisn.arrays import Floats
from laisn.navigators import BEACON_VARIANT, NAVIGATORS
from laisn.settings import LAISN_VARIANTS
from sim.scenario.formation import (
    MAX_FOLLOWERS,
    Formation,
    ShapeTable,
    Station,
    followers_of,
    station_inconsistencies,
)
from sim.scenario.links import LEADER_LINK, LinkTable
from sim.scenario.navigation import AssumeTable, Navigation, navigation_with
from sim.scenario.sea_files import (
    CurrentSource,
    DensitySource,
    FloorSource,
    MapOrigin,
    SoundSource,
)
from sim.scenario.section import (
    CONTROL_STEP_S,
    LIST_OR_TUPLE,
    MAX_POINTS,
    Angle,
    Idle,
    Name,
    NonNegative,
    Positive,
    Section,
    Timing,
    increasing,
    is_multiple,
)
from sim.scenario.sensors import Acoustics, Sensors
from sim.scenario.vehicles import Follower, Leader, Vehicle
from sim.system import atomic_write

SEA_WATER_KG_M3 = 1026.0
FASTEST_CURRENT_M_S = 3.0  # faster water would carry away vehicles with 3 m/s
CurrentSpeed = Annotated[float, Field(ge=0, le=FASTEST_CURRENT_M_S)]
TimedCurrent = Annotated[tuple[NonNegative, CurrentSpeed, Angle], LIST_OR_TUPLE]


_OF_WAVES = Idle(key="kind", at=("none",))
_OF_JONSWAP = Idle(key="kind", at=("none", "regular"))


class WavesTable(Section):
    """Surface waves (linear)."""

    kind: Literal["none", "regular", "jonswap"] = "none"
    height_m: Annotated[float, Field(ge=0, le=20), _OF_WAVES] = Field(
        0.5, description="height H of regular waves, significant height Hs of JONSWAP"
    )
    period_s: Annotated[float, Field(gt=0.5, le=30), _OF_WAVES] = Field(
        4.0, description="period T, or peak period Tp"
    )
    direction_deg: Annotated[Angle, _OF_WAVES] = Field(
        90.0, description="compass direction towards which they run"
    )
    peak_enhancement: Annotated[float, Field(ge=1, le=10), _OF_JONSWAP] = Field(
        3.3, description="γ of JONSWAP"
    )
    components: Annotated[int, Field(ge=1, le=200), _OF_JONSWAP] = Field(
        100, description="of JONSWAP"
    )
    spreading_deg: Annotated[float, Field(ge=0, le=60), _OF_JONSWAP] = Field(
        0.0, description="σ of JONSWAP directions"
    )


class OceanTable(Section):
    """Water and sea floor."""

    density_kg_m3: Annotated[float, Field(ge=950, le=1100)] = SEA_WATER_KG_M3
    floor_depth_m: Annotated[float, Field(ge=2, le=11000)] = Field(
        30.0, description="of a level floor; with a floor from a file, what waves feel of it"
    )
    current_speed_m_s: CurrentSpeed = Field(0.0, description="current at the surface")
    current_direction_deg: Angle = Field(
        0.0, description="compass direction towards which it flows"
    )
    current_shear_per_s: float = Field(
        0.0, ge=-1, le=1, description="decrease of the current with depth"
    )
    current_profile: Annotated[
        tuple[TimedCurrent, ...], LIST_OR_TUPLE, increasing("current", "s")
    ] = Field(
        (),
        max_length=MAX_POINTS,
        description="[[time_s, speed_m_s, direction_deg], …] of the surface current, "
        "components interpolated; "
        "replaces current_speed_m_s and the direction, except that of shear",
    )
    waves: WavesTable = WavesTable()
    origin: MapOrigin | None = None
    current: CurrentSource | None = None
    floor: FloorSource | None = None
    sound_speed: SoundSource | None = None
    density: DensitySource | None = None

    @model_validator(mode="after")
    def _one_density(self) -> Self:
        if self.density is not None and self.density_kg_m3 != SEA_WATER_KG_M3:
            raise ValueError("the table `density` replaces density_kg_m3; give one of them")
        return self

    @model_validator(mode="after")
    def _one_current(self) -> Self:
        keys = ("current_speed_m_s", "current_shear_per_s", "current_profile")
        others = [key for key in keys if getattr(self, key)]
        if self.current is not None and others:
            raise ValueError(f"the table `current` replaces {', '.join(others)}; give one of them")
        if self.current_profile and self.current_speed_m_s:
            raise ValueError("current_profile replaces current_speed_m_s; give one of them")
        return self

    @property
    def reads_files(self) -> bool:
        """Whether a part of it is read from a file."""
        tables = (self.current, self.floor, self.sound_speed, self.density)
        return any(table is not None and table.file is not None for table in tables)

    @property
    def has_current(self) -> bool:
        """Whether there is a current at the surface."""
        return self.current is not None or any(
            speed for _, speed, _ in self.current_profile or [(0.0, self.current_speed_m_s, 0.0)]
        )

    def surface_current(self) -> Floats:
        """The surface current over time, points of `current_profile`: time [s], east and north
        [m/s], shape (n, 3).
        """
        points = np.reshape(self.current_profile, (-1, 3))
        towards = np.deg2rad(points[:, 2])
        return np.column_stack(
            [points[:, 0], points[:, 1] * np.sin(towards), points[:, 1] * np.cos(towards)]
        )

    def current_at(self, depth: Floats | float, time: Floats | float) -> Floats:
        """Current, east and north; depth [m] and time [s] broadcast to the leading shape of the
        answer, [m/s].
        """
        towards = np.deg2rad(self.current_direction_deg)
        speed = 0.0 if self.current_profile else self.current_speed_m_s
        speed_at_depth = np.asarray(speed - self.current_shear_per_s * np.asarray(depth))
        steady = speed_at_depth[..., None] * np.array([np.sin(towards), np.cos(towards)])
        if not self.current_profile:
            return np.asarray(steady)
        instants, *velocity = self.surface_current().T
        over_time = [np.interp(time, instants, values) for values in velocity]
        return np.asarray(steady + np.stack(over_time, axis=-1))


__all__ = [
    "CAMERAS",
    "CONTROL_STEP_S",
    "KEYS_ALONE",
    "Acoustics",
    "AssumeTable",
    "Follower",
    "Formation",
    "Leader",
    "Name",
    "Navigation",
    "OceanTable",
    "Scenario",
    "Sensors",
    "Station",
    "Timing",
    "Vehicle",
    "Video",
    "WavesTable",
]


CAMERAS = {  # names of the cameras and what they show
    "chase": "behind the follower, looking towards the leader; inset: the leader close by",
    "pip": "from above, both vehicles in one picture; insets: leader and follower close by",
    "top": "from above, all vehicles in one picture, north up",
    "side": "from the side at their depth, between surface and floor; inset: the follower close by",
    "follower": "what the follower would see, along its hull; inset: the leader close by",
    "leader": "the leader close by; inset: the follower close by",
    "profile": (
        "the leader in profile, the follower beyond; inset: follower and estimate from above"
    ),
    "orbit": "around all vehicles, once in forty seconds of film",
}


def _known_camera(name: str) -> str:
    if name not in CAMERAS:
        raise ValueError(f"unknown camera {name!r}; available: {', '.join(CAMERAS)}")
    return name


class Video(Section):
    """The film of the mission."""

    camera: Annotated[Name, AfterValidator(_known_camera)] = Field(
        "chase", description=" or ".join(", ".join(CAMERAS).rsplit(", ", 1))
    )
    width_px: Annotated[int, Field(ge=160, le=3840, multiple_of=2)] = 1280
    height_px: Annotated[int, Field(ge=120, le=2160, multiple_of=2)] = 720
    frame_rate_hz: Annotated[int, Field(ge=1, le=60)] = 30
    speed_up: Positive = Field(30.0, description="mission seconds per film second")
    in_log: bool = Field(
        False, description="store the film in the log, too, at most 640 pixels wide"
    )


# context of a validation without `Scenario.inconsistencies`
KEYS_ALONE = {"inconsistencies": "ignored"}

# keys of the leader in formations, unless they are set
_BROADCAST_IN_FORMATIONS = {"broadcast_attitude": True, "broadcast_waypoints": 2}

_ORIGIN = {
    "origin_latitude_deg": "latitude_deg",
    "origin_longitude_deg": "longitude_deg",
    "epoch": "time",
}
"""Keys of a scenario by those of `ocean.origin`."""

_NEEDED_CONTENT = {"position", "heading", "speed", "depth"}
"""Content of messages that navigators of this project cannot do without."""

# a follower in place of those of an invalid shape
_STAND_IN = {"station": {"behind_m": 10.0, "depth_m": 10.0}}


class Scenario(Section):
    """One mission. The same scenario and version give the same bytes."""

    if TYPE_CHECKING:

        def __init__(self, **keys: Any) -> None:
            """Take what a file may hold: tables as dictionaries, lists as lists."""

    name: Name = Field("mission", description="name of the results; default: that of the file")
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1
    run: Annotated[int, Field(ge=0, lt=2**31)] = Field(0, description="run whose noise is used")
    duration_s: Annotated[float, Field(gt=0, le=86400)] = 1000.0
    motion: Literal["physics", "kinematic"] = Field(
        "physics", description="rigid bodies in water, or the paper's point motion"
    )
    contact: Literal["mark", "end"] = Field(
        "mark", description="on contact of hulls record it, or end the mission"
    )
    epoch: str = Field("2026-01-01T00:00:00+00:00", description="start date and time, ISO 8601")
    origin_latitude_deg: Annotated[float, Field(ge=-89, le=89)] = 54.52
    origin_longitude_deg: Annotated[float, Field(ge=-180, le=180)] = 18.55
    timing: Timing = Timing()
    leader: Leader = Leader()
    followers: Annotated[
        tuple[Follower, ...], LIST_OR_TUPLE, Field(min_length=1, max_length=MAX_FOLLOWERS)
    ]
    formation: Formation = Formation()
    ocean: OceanTable = OceanTable()
    sensors: Sensors = Sensors()
    acoustics: Acoustics = Acoustics()
    navigation: Navigation = Navigation()
    links: Annotated[tuple[LinkTable, ...], LIST_OR_TUPLE] = Field(
        (), max_length=8, description="who sends messages beside the leader"
    )
    video: Video = Video()

    @model_validator(mode="before")
    @classmethod
    def _followers_of_a_shape(cls, data: Any) -> Any:
        """Followers in place of the shape that makes them; errors of a shape are reported with
        its key.
        """
        formation = data.get("formation") if isinstance(data, dict) else None
        if (
            not isinstance(formation, dict)
            or not isinstance(formation.get("shape"), dict)
            or data.get("followers")
        ):
            return data
        try:
            followers = followers_of(ShapeTable.model_validate(formation["shape"], strict=False))
        except ValidationError:
            # the shape is reported; that it has made no followers is no further error
            return {**data, "followers": [_STAND_IN]}
        return {**data, "followers": followers, "formation": {**formation, "shape": None}}

    @field_validator("epoch")
    @classmethod
    def _epoch_is_a_date(cls, text: str) -> str:
        if datetime.fromisoformat(text).tzinfo is None:
            raise ValueError(
                f"{text!r} is no ISO 8601 time with zone, such as 2026-01-01T00:00:00+00:00"
            )
        return text

    @field_validator("followers")
    @classmethod
    def _numbered(cls, followers: tuple[Follower, ...]) -> tuple[Follower, ...]:
        """Followers with names: of several, those without one are called follower-1 and so on,
        in order.
        """
        if len(followers) == 1:
            return followers
        return tuple(
            follower
            if "name" in follower.model_fields_set
            else follower.model_copy(update={"name": f"follower-{i}"})
            for i, follower in enumerate(followers, 1)
        )

    @model_validator(mode="after")
    def _broadcasts_in_formations(self) -> Self:
        """Leaders of formations broadcast pitch and roll, which followers use, and their next
        waypoints, unless a key sets it.
        """
        if any(follower.station for follower in self.followers):
            defaults = {
                key: value
                for key, value in _BROADCAST_IN_FORMATIONS.items()
                if key not in self.leader.model_fields_set
            }
            self.__dict__["leader"] = self.leader.model_copy(update=defaults)
            if "use_attitude" not in self.navigation.model_fields_set:
                attitude_default = {"use_attitude": self.leader.broadcast_attitude}
                self.__dict__["navigation"] = self.navigation.model_copy(update=attitude_default)
        return self

    @model_validator(mode="after")
    def _on_the_map(self) -> Self:
        """Place and time of the origin are those of `ocean.origin`, which holds them all where
        fields are read, as what is read depends on them.
        """
        origin = self.ocean.origin or MapOrigin()
        for key, name in _ORIGIN.items():
            value = getattr(origin, name)
            if value is None:
                continue
            if key in self.model_fields_set and getattr(self, key) != value:
                raise ValueError(
                    f"ocean.origin.{name} = {value} and {key} = {getattr(self, key)} contradict "
                    "each other"
                )
            self.__dict__[key] = value
        if self.ocean.reads_files:
            map_origin = MapOrigin(**{name: getattr(self, key) for key, name in _ORIGIN.items()})
            self.__dict__["ocean"] = self.ocean.model_copy(update={"origin": map_origin})
        return self

    @model_validator(mode="after")
    def _is_consistent(self, info: ValidationInfo) -> Self:
        errors = (
            [] if KEYS_ALONE.items() <= (info.context or {}).items() else self.inconsistencies()
        )
        if errors:
            raise ValueError("; ".join(errors))
        return self

    def inconsistencies(self) -> list[str]:
        """Keys that contradict each other: names, steps, floor, current, what one setting needs
        of another.
        """
        errors = []
        names = Counter(["leader", *(follower.name for follower in self.followers)])
        repeated = sorted(name for name, count in names.items() if count > 1)
        if repeated:
            errors.append(f"vehicle names must differ; repeated: {', '.join(repeated)}")
        if not is_multiple(self.duration_s, self.timing.filter_step_s):
            step = self.timing.filter_step_s
            errors.append(
                f"duration_s = {self.duration_s:g} is no multiple of filter_step_s = {step:g}"
            )
        for key, vehicle in self.vehicles():
            errors += self._depth_errors(key, vehicle)
        errors += self._motion_errors()
        if self.formation.shape:
            errors.append("formation.shape makes the followers; there are [[followers]] beside it")
        errors += self._station_errors()
        errors += self._navigation_errors()
        errors += self._link_errors()
        errors += self._leader_errors()
        return errors

    def _motion_errors(self) -> list[str]:
        """What vehicles on the paper's point motion cannot do."""
        errors = []
        if self.motion != "physics":
            errors += [
                f"{key} needs motion = 'physics'; the paper's point motion is planned whole before "
                "anything is sensed"
                for key in self._feedback_keys()
            ]
        for i, follower in enumerate(self.followers if self.motion != "physics" else ()):
            if follower.station or follower.controller:
                key = "station" if follower.station else "controller"
                errors.append(f"followers[{i}].{key} needs motion = 'physics'")
            elif follower.guided_by_estimate:
                errors.append(
                    f"followers[{i}].guidance_position = 'estimate' needs motion = 'physics'; the "
                    "paper's point motion keeps to its route whatever the follower estimates"
                )
        return errors

    def _station_errors(self) -> list[str]:
        """What contradicts stations, and steering by estimates."""
        stations = [
            (f"followers[{i}]", f.station) for i, f in enumerate(self.followers) if f.station
        ]
        errors = list(station_inconsistencies(self.formation.proximity, stations))
        if stations and self.timing.filter_step_s != CONTROL_STEP_S:
            errors.append(
                "timing.filter_step_s must keep its default where followers are on stations"
            )
        if stations or any(follower.guided_by_estimate for follower in self.followers):
            advice = (
                "must keep its default where followers are on stations or steer by their estimates"
            )
            for key, navigation in self.navigations():
                if navigation.use_single_range and navigation.variant in LAISN_VARIANTS:
                    errors.append(f"{key}.use_single_range {advice}")
                if navigation.transmitters_m:
                    errors.append(f"{key}.transmitters_m {advice}")
        return errors

    def _navigation_errors(self) -> list[str]:
        errors = []
        if self.ocean.sound_speed is not None and self.acoustics.sound_speed_profile:
            errors.append("ocean.sound_speed replaces acoustics.sound_speed_profile; give one")
        for key, navigation in self.navigations():
            if navigation.use_attitude and not self.leader.broadcast_attitude:
                errors.append(f"{key}.use_attitude needs leader.broadcast_attitude = true")
            places = len(navigation.transmitters_m)
            transmitters = navigation.transmitters
            if 0 < places < transmitters:
                errors.append(
                    f"{key}.transmitters_m has {places} places, the navigator uses {transmitters} "
                    "transmitters"
                )
        return errors

    def _link_errors(self) -> list[str]:
        """What contradicts vehicles, times and the sea in links, and the navigated one."""
        errors = []
        vehicles = ["leader", *(follower.name for follower in self.followers)]
        names = [link.name for link in self.links]
        for i, link in enumerate(self.links):
            key = f"links[{i}]"
            if names.index(link.name) < i:
                errors.append(f"{key}.name = {link.name!r} is that of another link")
            if link.sender is not None and link.sender not in vehicles:
                errors.append(
                    f"{key}.sender = {link.sender!r} is no vehicle: {', '.join(vehicles)}"
                )
            errors += self._receiver_errors(key, link)
            errors += self._answer_errors(key, link)
            errors += self._schedule_errors(key, link)
            beacons_below_floor = [
                beacon[2] for beacon in link.beacons_m if beacon[2] > self.ocean.floor_depth_m
            ]
            # a floor from a file is read when the mission is checked
            if self.ocean.floor is None and beacons_below_floor:
                errors.append(
                    f"{key}.beacons_m: {beacons_below_floor[0]:g} m is below the floor at "
                    f"{self.ocean.floor_depth_m:g} m"
                )
        for key, navigation in self.navigations():
            errors += self._navigated_link_errors(key, navigation)
        if self.leader.navigation is not None:
            errors += self._navigated_link_errors("leader.navigation", self.leader.navigation)
        return errors

    def _schedule_errors(self, key: str, link: LinkTable) -> list[str]:
        """What contradicts the filter's steps in the times of a link."""
        errors = []
        step = self.timing.filter_step_s
        interval = link.interval_s or self.timing.message_interval_s
        if not is_multiple(interval, step):
            errors.append(f"{key}.interval_s is no multiple of filter_step_s = {step:g}")
        delayed = link.offset_s > 0.0 and not is_multiple(link.offset_s, step)
        if delayed or link.offset_s >= interval:
            errors.append(
                f"{key}.offset_s must be shorter than the interval of {interval:g} s, and a "
                f"multiple of filter_step_s = {step:g}"
            )
        return errors

    def _receiver_errors(self, key: str, link: LinkTable) -> list[str]:
        """What contradicts the vehicles in the receivers of a link, and in what it holds."""
        errors = []
        vehicles = ["leader", *(follower.name for follower in self.followers)]
        unknown = [name for name in link.receivers if name not in vehicles]
        if unknown:
            errors.append(f"{key}.receivers: {unknown[0]!r} is no vehicle: {', '.join(vehicles)}")
        if link.sender in link.receivers:
            errors.append(f"{key}.receivers: {link.sender!r} is the sender")
        if link.position == "estimate" and link.sender == "leader" and not self.leader.navigation:
            errors.append(f"{key}.position = 'estimate' needs a table leader.navigation")
        if link.readings and link.sender == "leader" and not self.leader.sensors.custom:
            errors.append(f"{key}.readings needs a table leader.sensors.custom")
        return errors

    def _answer_errors(self, key: str, link: LinkTable) -> list[str]:
        """What keeps a link's sender from answering the messages of another one."""
        if link.answers is None:
            return []
        requests = {request.name: request for request in self.links if not request.answers}
        if link.answers != LEADER_LINK and link.answers not in requests:
            links = ", ".join([LEADER_LINK, *requests])
            return [
                f"{key}.answers = {link.answers!r}: expected a link with a schedule, of {links}"
            ]
        errors = []
        request = requests.get(link.answers)
        receivers = [follower.name for follower in self.followers]
        if request is not None:
            sender = request.sender
            receivers = [*request.receivers] or [name for name in receivers if name != sender]
        if link.sender not in receivers:
            errors.append(
                f"{key}.answers = {link.answers!r}: {link.sender} does not receive that link, "
                f"which {', '.join(receivers)} do"
            )
        if not self.acoustics.travel_time:
            errors.append(f"{key}.answers needs acoustics.travel_time = true")
        return errors

    def _leader_errors(self) -> list[str]:
        """What the leader cannot do without a hydrophone, or a navigator of its own."""
        navigation = self.leader.navigation
        receives = any("leader" in link.receivers for link in self.links)
        if navigation is not None:
            receives = receives or {navigation.link, *navigation.further_links} != {LEADER_LINK}
        if receives and self.leader.model is None and self.leader.hydrophone_m is None:
            return ["the leader's hull has no hydrophone to receive with; give leader.hydrophone_m"]
        if navigation is not None:
            return []
        keys = ("broadcast_position", "guidance_position")
        return [
            f"leader.{key} = 'estimate' needs a table leader.navigation"
            for key in keys
            if getattr(self.leader, key) == "estimate"
        ]

    def _feedback_keys(self) -> list[str]:
        """Keys that are set, and by which what vehicles send, receive or do depends on what they
        have read and received until then; those of the followers' control are not among them.
        """
        keys = [
            f"leader.{key}" for key in ("controller", "navigation") if getattr(self.leader, key)
        ]
        if self.leader.sensors.custom:
            keys.append("leader.sensors.custom")
        for i, link in enumerate(self.links):
            if link.answers:
                keys.append(f"links[{i}].answers")
            if link.position == "estimate":
                keys.append(f"links[{i}].position = 'estimate'")
            if link.readings:
                keys.append(f"links[{i}].readings")
            if "leader" in link.receivers:
                keys.append(f"links[{i}].receivers")
        return keys

    def keys_needing_closed_loop(self) -> list[str]:
        """Keys that are set, and by which what vehicles do or send depends on what they have read
        and received: stations, steering by estimates, controllers, a leader that navigates,
        answers.
        """
        followers = list(enumerate(self.followers))
        keys = [f"followers.{i}.station" for i, follower in followers if follower.station]
        keys += [f"followers.{i}.controller" for i, follower in followers if follower.controller]
        keys += self._feedback_keys()
        return keys + [
            f"followers.{i}.guidance_position = 'estimate'"
            for i, f in followers
            if f.guided_by_estimate
        ]

    def _further_link_errors(self, key: str, navigation: Navigation) -> list[str]:
        further_links = navigation.further_links
        links = [LEADER_LINK, *(link.name for link in self.links)]
        errors = [
            f"{key}.further_links: {name!r} is no link: {', '.join(links)}"
            for name in further_links
            if name not in links
        ]
        if navigation.link in further_links:
            errors.append(f"{key}.further_links: {navigation.link!r} is {key}.link already")
        for link in self.links:
            if link.name in further_links:
                errors += self._lacking_content(f"{key}.further_links", navigation, link)
        shipped = NAVIGATORS.get(navigation.variant)
        if further_links and shipped is not None and not shipped.takes_links:
            names_with_links = ", ".join(
                name for name, spec in NAVIGATORS.items() if spec.takes_links
            )
            errors.append(
                f"{key}.further_links: variant = {navigation.variant!r} takes the messages of one "
                f"link; expected {names_with_links} or an own class"
            )
        return errors

    def _navigated_link_errors(self, key: str, navigation: Navigation) -> list[str]:
        errors = self._further_link_errors(key, navigation)
        names = [link.name for link in self.links]
        link_name = navigation.link
        by_beacons = navigation.variant == BEACON_VARIANT
        if link_name == LEADER_LINK:
            if by_beacons:
                errors.append(f'{key}.variant = "beacons" needs a {key}.link of beacons')
            return errors
        if link_name not in names:
            links = ", ".join([LEADER_LINK, *names])
            return [*errors, f"{key}.link = {link_name!r}: expected one of {links}"]
        link = self.links[names.index(link_name)]
        errors += self._content_errors(key, navigation, link)
        if link.beacons_m:
            return errors + self._beacon_errors(key, navigation)
        return errors + self._transmitter_errors(key, navigation, link)

    def _lacking_content(self, key: str, navigation: Navigation, link: LinkTable) -> list[str]:
        """What a navigator lacks of the messages of a link."""
        lacking = ", ".join(sorted(_NEEDED_CONTENT.difference(link.content)))
        if not lacking or navigation.variant not in NAVIGATORS:
            return []
        return [
            f"{key}: {link.name!r} has messages without {lacking}, which variant = "
            f"{navigation.variant!r} needs"
        ]

    def _content_errors(self, key: str, navigation: Navigation, link: LinkTable) -> list[str]:
        """What keeps a navigator from the messages of its link."""
        errors = self._lacking_content(f"{key}.link", navigation, link)
        if key == "leader.navigation" and (
            link.sender == "leader" or (link.receivers and "leader" not in link.receivers)
        ):
            errors.append(f"{key}.link = {link.name!r}: the leader does not receive it")
        if navigation.transmitters_m:
            errors.append(f"{key}.transmitters_m is of the leader; a link has transmitters_m")
        return errors

    def _beacon_errors(self, key: str, navigation: Navigation) -> list[str]:
        """What keeps a navigator from a link of beacons."""
        if navigation.variant not in NAVIGATORS or navigation.variant == BEACON_VARIANT:
            return []
        return [
            f"{key}.link = {navigation.link!r} has beacons, among which only variant = "
            '"beacons" or an own class navigates'
        ]

    def _transmitter_errors(self, key: str, navigation: Navigation, link: LinkTable) -> list[str]:
        """What keeps a navigator from a link of a vehicle."""
        errors = []
        sites = len(link.transmitters_m)
        if navigation.variant == BEACON_VARIANT:
            errors.append(f"{key}.link = {link.name!r} has no beacons")
        if sites < navigation.transmitters:
            errors.append(
                f"{key}.link = {link.name!r} has {sites} transmitters, the navigator uses "
                f"{navigation.transmitters}"
            )
        return errors

    def _depth_errors(self, key: str, vehicle: Vehicle) -> list[str]:
        errors = []
        # a profile replaces depth and saw-tooth
        deepest = max(
            [depth for _, depth in vehicle.depth_profile]
            or [vehicle.held_depth_m + vehicle.saw_tooth_amplitude_m]
        )
        if vehicle.saw_tooth_amplitude_m > vehicle.held_depth_m and not vehicle.depth_profile:
            errors.append(
                f"{key}: saw_tooth_amplitude_m = {vehicle.saw_tooth_amplitude_m:g} about depth_m = "
                f"{vehicle.depth_m:g} would leave the water"
            )
        if self.ocean.floor is None and deepest > self.ocean.floor_depth_m - 1:
            errors.append(
                f"{key} would dive to {deepest:g} m, the floor lies at ocean.floor_depth_m = "
                f"{self.ocean.floor_depth_m:g} m (1 m is kept clear)"
            )
        times = np.array([time for time, *_ in self.ocean.current_profile] or [0.0])
        drift = float(np.hypot(*self.ocean.current_at(deepest, times).T).max())
        if drift > FASTEST_CURRENT_M_S:
            errors.append(
                f"ocean: the current at {key}'s {deepest:g} m would run at {drift:.3g} m/s; its "
                "speed at the surface "
                f"and current_shear_per_s must keep it within {FASTEST_CURRENT_M_S:g} m/s"
            )
        return errors

    def toml(self) -> str:
        """The whole scenario as TOML, every default written out; reading it back gives an equal
        scenario.
        """
        return tomli_w.dumps(
            self.model_dump(mode="json", exclude_none=True), multiline_strings=True
        )

    def save(self, path: str | Path) -> None:
        """Write the scenario as a TOML file that loads to an equal one; OSError if it cannot be
        written.
        """
        with atomic_write(Path(path)) as temporary:
            temporary.write_text(self.toml(), encoding="utf-8")

    def vehicles(self) -> list[tuple[str, Vehicle]]:
        """All vehicles with their keys, the leader first: leader, followers[0] and so on."""
        return [
            ("leader", self.leader),
            *((f"followers[{i}]", f) for i, f in enumerate(self.followers)),
        ]

    def navigation_of(self, follower: int) -> Navigation:
        """`[navigation]` with the keys that a follower, by its index, sets for its own navigator in
        place of those there.
        """
        changes = self.followers[follower].navigation
        return self.navigation if changes is None else navigation_with(self.navigation, changes)

    def navigated_as(self, follower: int) -> "Scenario":
        """The scenario in which all followers navigate as this one, by its index, does."""
        if all(member.navigation is None for member in self.followers):
            return self
        members = tuple(
            member if member.navigation is None else member.model_copy(update={"navigation": None})
            for member in self.followers
        )
        changes = {"navigation": self.navigation_of(follower), "followers": members}
        return self.model_copy(update=changes)

    def with_navigation(self, **keys: Any) -> "Scenario":
        """The scenario in which these keys of navigation are those of all followers."""
        members = []
        for member in self.followers:
            own_navigation = member.navigation
            changed = None if own_navigation is None else own_navigation.model_copy(update=keys)
            members.append(member.model_copy(update={"navigation": changed}))
        navigation = self.navigation.model_copy(update=keys)
        changes = {"navigation": navigation, "followers": tuple(members)}
        return self.model_copy(update=changes)

    @property
    def variants(self) -> str:
        """Variants of navigation of the followers, each once, in words."""
        names = [self.navigation_of(i).variant for i in range(len(self.followers))]
        return ", ".join(dict.fromkeys(names))

    def navigations(self) -> list[tuple[str, Navigation]]:
        """Navigations of the followers with their keys, each once: that of all, where a follower
        has no own one, and own ones.
        """
        followers = list(enumerate(self.followers))
        own_navigations = [
            (f"followers[{i}].navigation", self.navigation_of(i))
            for i, follower in followers
            if follower.navigation is not None
        ]
        is_used = len(own_navigations) < len(followers)
        return [("navigation", self.navigation), *own_navigations] if is_used else own_navigations

    @property
    def message_every(self) -> int:
        """Filter steps from one message to the next (n_D)."""
        return round(self.timing.message_interval_s / self.timing.filter_step_s)

    @property
    def first_messages(self) -> "Scenario":
        """The scenario as far as its second message: to fly that takes no time but for
        compiling.
        """
        two = min(2 * self.timing.message_interval_s, self.duration_s)
        return self.model_copy(update={"duration_s": two})

    @property
    def filter_steps(self) -> int:
        """Number n of filter steps."""
        return round(self.duration_s / self.timing.filter_step_s)
