"""A mission as data: everything a user may set, validated, frozen. Degrees and units stand in the names."""

import math
from collections import Counter
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, Strict, ValidationInfo, field_validator, model_validator

from laisn.settings import AnyVariant, GateRule, SideRule, transmitters_of
from sim.scenario.formation import Formation, Station, conflicts
from sim.scenario.own_hull import LONGEST
from sim.scenario.routes import FOLLOWER_DEPTH, LEADER_DEPTH
from sim.scenario.section import Angle, Chance, Coordinate, NonNegative, Positive, Scale, Section

CONTROL_STEP_S = 0.1
"""Interval of the autopilot and of the recorded truth [s]."""

FASTEST_CURRENT_M_S = 3.0
"""Faster water would carry away what can swim at 3 m/s."""

SoundSpeed = Annotated[float, Field(ge=1300, le=1700)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
LISTED = Strict(False)
"""Lets a tuple be given as a list too, as a TOML file has it."""
Offset = Annotated[tuple[Coordinate, Coordinate, Coordinate], LISTED]
TimedPoint = Annotated[tuple[NonNegative, Coordinate, Coordinate], LISTED]
TimedDepth = Annotated[tuple[NonNegative, NonNegative], LISTED]
SpeedAtDepth = Annotated[tuple[NonNegative, SoundSpeed], LISTED]

MOST_POINTS = 100_000
"""Most points of a route or a profile: one a second for more than a day."""


def _multiple(whole: float, part: float) -> bool:
    ratio = whole / part
    return abs(ratio - round(ratio)) < 1e-9 and round(ratio) >= 1


class Misfit(NamedTuple):
    """What is wrong with a scenario though every key alone is right."""

    keys: tuple[str, ...]
    """Keys whose values do not fit together, such as `ocean.floor_depth_m`; a section stands for all of its keys."""
    text: str


APART = {"misfits": "allowed"}
"""Context of a validation that looks at every key alone; `Scenario.misfits` tells the rest."""


class Timing(Section):
    """Time steps."""

    physics_step_s: Annotated[float, Field(ge=1e-4, le=0.1)] = Field(
        0.02, description="step of the rigid-body solver; must divide 0.1 s"
    )
    filter_step_s: Positive = Field(0.1, description="filter step Δt; a multiple of 0.1 s")
    message_interval_s: Positive = Field(1.0, description="message interval Δt_D; a multiple of the filter step")

    @model_validator(mode="after")
    def _steps_fit(self) -> Self:
        if not _multiple(CONTROL_STEP_S, self.physics_step_s):
            raise ValueError(f"physics_step_s = {self.physics_step_s:g} does not divide {CONTROL_STEP_S:g} s")
        if not _multiple(self.filter_step_s, CONTROL_STEP_S):
            raise ValueError(f"filter_step_s = {self.filter_step_s:g} is no multiple of {CONTROL_STEP_S:g} s")
        if not _multiple(self.message_interval_s, self.filter_step_s):
            raise ValueError(
                f"message_interval_s = {self.message_interval_s:g} is no multiple of "
                f"filter_step_s = {self.filter_step_s:g}"
            )
        return self


class Vehicle(Section):
    """What leader and followers have in common."""

    route: Name | None = Field(None, description="a route of the library (L, T2 … T9)")
    waypoints: Annotated[tuple[TimedPoint, ...], LISTED] = Field(
        (),
        max_length=MOST_POINTS,
        description="replaces route: [[time_s, east_m, north_m], …], times increasing from 0",
    )
    model: Annotated[str, Field(max_length=LONGEST)] | None = Field(
        None,
        description="MJCF file of a hull of your own, named as seen from this file; its text once it is flown. "
        "Without it the project's leader or follower",
    )
    depth_m: NonNegative = Field(LEADER_DEPTH, description="depth that the autopilot holds")
    depth_profile: Annotated[tuple[TimedDepth, ...], LISTED] = Field(
        (), max_length=MOST_POINTS, description="[[time_s, depth_m], …], linear between; replaces depth_m"
    )
    saw_tooth_amplitude_m: NonNegative = Field(0.0, description="half height of a saw-tooth about the depth")
    saw_tooth_period_s: Positive = Field(120.0, description="period of that saw-tooth")
    excess_buoyancy_n: float = Field(0.0, ge=-100, le=100, description="buoyancy less weight; held by trim")
    cg_offset_x_m: float = Field(0.0, ge=-0.2, le=0.2, description="centre of gravity moved forward")
    cg_offset_z_m: float = Field(0.0, ge=-0.1, le=0.1, description="centre of gravity moved up")
    drag_scale: Scale = Field(1.0, description="true drag and damping over the model's, which autopilots go by")
    added_mass_scale: Scale = Field(1.0, description="true added mass over the model's, likewise")
    lift_scale: Scale = Field(1.0, description="true lift of hull and fins over the model's, likewise")
    thrust_scale: Scale = Field(1.0, description="thrust that comes of what is asked for, over that")
    depth_control: Literal["pitch", "thrust"] = Field(
        "pitch", description="depth held by pitching the hull, or level by the vertical thrusters"
    )

    @field_validator("waypoints")
    @classmethod
    def _waypoints_in_order(cls, points: tuple[TimedPoint, ...]) -> tuple[TimedPoint, ...]:
        if points and (len(points) < 2 or points[0][0] != 0):
            raise ValueError("needs at least two waypoints, the first at time 0")
        for number, (before, after) in enumerate(pairwise(points), start=2):
            if after[0] <= before[0]:
                raise ValueError(f"waypoint {number} at {after[0]:g} s is not later than the one before")
        return points

    @field_validator("depth_profile")
    @classmethod
    def _depths_in_order(cls, points: tuple[TimedDepth, ...]) -> tuple[TimedDepth, ...]:
        if points and points[0][0] != 0:
            raise ValueError("the first depth must stand at time 0")
        for number, (before, after) in enumerate(pairwise(points), start=2):
            if after[0] <= before[0]:
                raise ValueError(f"depth {number} at {after[0]:g} s is not later than the one before")
        return points

    @property
    def layer_m(self) -> float:
        """Depth that the vehicle holds where no profile says otherwise."""
        return self.depth_m

    @model_validator(mode="after")
    def _one_route(self) -> Self:
        if not self.route and not self.waypoints:
            raise ValueError("a vehicle needs a route of the library or waypoints of its own")
        return self


class Leader(Vehicle):
    """The vehicle with the transmitters."""

    route: Name | None = Field("L", description="a route of the library (L, T2 … T9)")
    baseline_m: Annotated[float, Field(ge=0.01, le=2.4)] = Field(2.0, description="L, rear to front transmitter")
    middle_offset_m: Annotated[float, Field(ge=0.001, le=0.5)] = Field(
        0.1, description="H_T, middle transmitter to port of the axis"
    )
    broadcast_attitude: bool = Field(False, description="messages carry the measured pitch and roll")


class Follower(Vehicle):
    """A vehicle with one hydrophone, on a route or on a station."""

    name: Name = "follower"
    depth_m: NonNegative = Field(FOLLOWER_DEPTH, description="depth that the autopilot holds")
    station: Station | None = Field(
        None, description="{behind_m, port_m, depth_m}: keeps its place in the leader's trail; replaces a route"
    )
    start_m: Annotated[tuple[Coordinate, Coordinate], LISTED] | None = Field(
        None, description="[east, north] from where it joins its station; default: the station itself"
    )
    steers_by: Literal["truth", "estimate"] | None = Field(
        None,
        description="position by which it keeps to its route or station: the true one (the default on a route), or "
        "what it believes itself (the default on a station)",
    )

    @property
    def believes(self) -> bool:
        """Whether it steers by its own estimate."""
        return self.steers_by == "estimate" or (self.steers_by is None and self.station is not None)

    @property
    def layer_m(self) -> float:
        """Depth that the vehicle holds where no profile says otherwise."""
        return self.station.depth_m if self.station else self.depth_m

    @model_validator(mode="after")
    def _one_route(self) -> Self:
        if not self.route and not self.waypoints and not self.station:
            raise ValueError("a follower needs a route of the library, waypoints of its own or a station")
        if self.station and (self.route or self.waypoints or self.depth_profile or self.saw_tooth_amplitude_m):
            raise ValueError("a follower on a station has no route, waypoints, depth_profile or saw-tooth beside it")
        if self.start_m and not self.station:
            raise ValueError("start_m is for followers on stations; a route begins at its first waypoint")
        return self


class Waves(Section):
    """Surface waves (linear)."""

    kind: Literal["none", "regular", "jonswap"] = "none"
    height_m: Annotated[float, Field(ge=0, le=20)] = Field(
        0.5, description="height H of regular waves, significant height Hs of a sea"
    )
    period_s: Annotated[float, Field(gt=0.5, le=30)] = Field(4.0, description="period T, or peak period Tp")
    direction_deg: Angle = Field(90.0, description="compass direction that the waves run towards")
    peak_enhancement: Annotated[float, Field(ge=1, le=10)] = Field(3.3, description="γ of JONSWAP")
    components: Annotated[int, Field(ge=1, le=200)] = Field(100, description="number of components of a sea")
    spreading_deg: Annotated[float, Field(ge=0, le=60)] = Field(
        0.0, description="standard deviation of the directions of a sea"
    )


class Ocean(Section):
    """Water and sea floor."""

    density_kg_m3: Annotated[float, Field(ge=950, le=1100)] = 1026.0
    floor_depth_m: Annotated[float, Field(ge=2, le=11000)] = Field(30.0, description="depth of the sea floor")
    current_speed_m_s: Annotated[float, Field(ge=0, le=3)] = Field(0.0, description="current at the surface")
    current_direction_deg: Angle = Field(0.0, description="compass direction that the current runs towards")
    current_shear_per_s: Annotated[float, Field(ge=-1, le=1)] = Field(
        0.0, description="decrease of the current with depth"
    )
    waves: Waves = Waves()


class Sensors(Section):
    """True errors of the sensors (paper, Eqs. 26 and 27); the filter does not know them."""

    speed_bias_m_s: Annotated[float, Field(ge=-10, le=10)] = 0.2
    speed_sigma_m_s: NonNegative = 0.2
    heading_bias_deg: NonNegative = 5.0
    heading_sigma_deg: NonNegative = 2.0
    depth_sigma_m: NonNegative = 0.0
    gyro_sigma_deg_s: NonNegative = Field(
        0.1, description="σ of each reading of a follower's gyros; followers on stations steer by them"
    )
    tilt_sigma_deg: NonNegative = Field(0.5, description="σ of each reading of its inclinometer, likewise")
    leader_heading_bias_deg: NonNegative = 0.0
    leader_heading_sigma_deg: NonNegative = 0.0
    leader_depth_sigma_m: NonNegative = 0.0
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


class Acoustics(Section):
    """True errors of the ranges (paper, Eq. 28), and what sound really does (not in the paper, off by default)."""

    range_tau_m: Annotated[tuple[NonNegative, NonNegative, NonNegative], LISTED] = Field(
        (0.01, 0.01, 0.01), description="τ: uniform error of rear, front and middle transmitter"
    )
    range_scale_mean_m: Annotated[float, Field(ge=-100, le=100)] = Field(
        0.1, description="μD: mean of the error that all transmitters share"
    )
    range_scale_sigma_m: NonNegative = Field(0.05, description="σD: its standard deviation")
    travel_time: bool = Field(False, description="sites move while the sound is under way; else it takes no time")
    ping_slot_s: Annotated[float, Field(ge=0, le=2)] = Field(
        0.0, description="rear, front and middle transmitter ping this long after each other; 0: at once"
    )
    sound_speed_m_s: SoundSpeed = Field(1500.0, description="speed of sound, and what the follower believes of it")
    sound_speed_bias_m_s: Annotated[float, Field(ge=-100, le=100)] = Field(
        0.0, description="what the follower believes in addition"
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
    loss_chance: Chance = Field(0.0, description="chance that a message outside bursts is lost")
    burst_chance: Chance = Field(0.0, description="chance that a burst of loss begins at a message")
    burst_mean_messages: Annotated[float, Field(ge=1, le=10000)] = Field(5.0, description="mean length of a burst")
    burst_loss_chance: Chance = Field(1.0, description="chance that a message within a burst is lost")
    max_range_m: NonNegative = Field(0.0, description="pings from farther away are not heard; 0: no limit")

    @field_validator("sound_speed_profile")
    @classmethod
    def _depths_increase(cls, points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for number, (before, after) in enumerate(pairwise(points), start=2):
            if after[0] <= before[0]:
                raise ValueError(f"point {number} at {after[0]:g} m is not deeper than the one before")
        return points

    @model_validator(mode="after")
    def _chances_add_up(self) -> Self:
        if self.surface_echo_chance + self.bottom_echo_chance > 1:
            raise ValueError(
                f"surface_echo_chance = {self.surface_echo_chance:g} and bottom_echo_chance = "
                f"{self.bottom_echo_chance:g} add up to more than 1"
            )
        return self


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


class Video(Section):
    """The film of the mission."""

    camera: Name = Field("chase", description="chase, pip, top, side, follower, leader, profile or orbit")
    width_px: Annotated[int, Field(ge=160, le=3840, multiple_of=2)] = 1280
    height_px: Annotated[int, Field(ge=120, le=2160, multiple_of=2)] = 720
    frame_rate_hz: Annotated[int, Field(ge=1, le=60)] = 30
    speed_up: Positive = Field(20.0, description="seconds of mission in a second of film")
    in_log: bool = Field(True, description="a rendered film also goes into the log, as channel /camera")


class Scenario(Section):
    """One mission, complete: with the same scenario and version the same bytes come out."""

    if TYPE_CHECKING:

        def __init__(self, **keys: Any) -> None:
            """Take what a file may hold: tables as dictionaries, lists as lists."""

    name: Name = Field("mission", description="of the results; unless it is given, a file's own")
    seed: Annotated[int, Field(ge=0, lt=2**63)] = Field(1, description="key of all random numbers")
    run: Annotated[int, Field(ge=0, lt=2**31)] = Field(0, description="run of a campaign whose noise is flown")
    duration_s: Annotated[float, Field(gt=0, le=86400)] = 1000.0
    motion: Literal["physics", "kinematic"] = Field(
        "physics", description="rigid bodies in water, or the paper's point motion"
    )
    epoch: str = Field("2026-01-01T00:00:00+00:00", description="date and time of the start, ISO 8601")
    origin_latitude_deg: Annotated[float, Field(ge=-89, le=89)] = Field(
        54.52, description="latitude of the world's origin"
    )
    origin_longitude_deg: Annotated[float, Field(ge=-180, le=180)] = Field(
        18.55, description="longitude of the world's origin"
    )
    timing: Timing = Timing()
    leader: Leader = Leader()
    followers: Annotated[tuple[Follower, ...], LISTED, Field(min_length=1, max_length=50)]
    formation: Formation = Formation()
    ocean: Ocean = Ocean()
    sensors: Sensors = Sensors()
    acoustics: Acoustics = Acoustics()
    navigation: Navigation = Navigation()
    video: Video = Video()

    @field_validator("epoch")
    @classmethod
    def _epoch_is_a_date(cls, text: str) -> str:
        try:
            aware = datetime.fromisoformat(text).tzinfo is not None
        except ValueError:
            aware = False
        if not aware:
            raise ValueError(f"{text!r} is no ISO 8601 time with zone, such as 2026-01-01T00:00:00+00:00")
        return text

    @field_validator("followers")
    @classmethod
    def _numbered(cls, followers: tuple[Follower, ...]) -> tuple[Follower, ...]:
        """Of several followers, those without a name are called follower-1 and so on, after their places."""
        if len(followers) == 1:
            return followers
        return tuple(
            follower if "name" in follower.model_fields_set else follower.model_copy(update={"name": f"follower-{i}"})
            for i, follower in enumerate(followers, 1)
        )

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> Self:
        told = [] if info.context == APART else self.misfits()
        if told:
            raise ValueError("; ".join(misfit.text for misfit in told))
        return self

    def misfits(self) -> list[Misfit]:
        """What does not fit together: names, steps, floor, current, what one setting needs of another."""
        found = []
        names = ["leader", *(f.name for f in self.followers)]
        counts = Counter(names)
        repeated = sorted(name for name, count in counts.items() if count > 1)
        if repeated:
            found.append(Misfit(("followers",), f"vehicle names must differ; repeated: {', '.join(repeated)}"))
        if not _multiple(self.duration_s, self.timing.filter_step_s):
            text = f"duration_s = {self.duration_s:g} is no multiple of filter_step_s = {self.timing.filter_step_s:g}"
            found.append(Misfit(("duration_s", "timing"), text))
        for key, vehicle in self.vehicles():
            found += self._out_of_water(key, vehicle)
        for key, follower in self.vehicles()[1:]:
            if not isinstance(follower, Follower) or self.motion == "physics":
                continue
            if follower.station:
                found.append(Misfit((f"{key}.station", "motion"), f"{key}.station needs motion = 'physics'"))
            elif follower.believes:
                text = (
                    f"{key}.steers_by = 'estimate' needs motion = 'physics'; the paper's point motion keeps to its "
                    "route whatever the follower believes"
                )
                found.append(Misfit((f"{key}.steers_by", "motion"), text))
        stations = [(f"followers[{i}]", f.station) for i, f in enumerate(self.followers) if f.station]
        found += [Misfit(keys, text) for keys, text in conflicts(stations)]
        found += self._unheard(bool(stations))
        if self.navigation.use_attitude and not self.leader.broadcast_attitude:
            keys = ("navigation.use_attitude", "leader.broadcast_attitude")
            found.append(Misfit(keys, "navigation.use_attitude needs leader.broadcast_attitude = true"))
        return found

    def _unheard(self, stations: bool) -> list[Misfit]:
        """What followers on stations cannot have, because they sense while they swim."""
        sound, sensors = self.acoustics, self.sensors
        asked = {
            "acoustics.travel_time": sound.travel_time,
            "acoustics.ping_slot_s": sound.ping_slot_s > 0.0,
            "acoustics.sound_speed_profile": bool(sound.sound_speed_profile),
            "sensors.leader_attitude_feels_acceleration": sensors.leader_attitude_feels_acceleration,
            "sensors.leader_gyro_time_constant_s": sensors.leader_gyro_time_constant_s > 0.0,
            "timing.filter_step_s": self.timing.filter_step_s != CONTROL_STEP_S,
        }
        told = [key for key, there in asked.items() if there and stations]
        return [
            Misfit((key, "followers"), f"{key} must keep its default where followers are on stations") for key in told
        ]

    def _out_of_water(self, key: str, vehicle: Vehicle) -> list[Misfit]:
        found = []
        deepest = max([d for _, d in vehicle.depth_profile] or [vehicle.layer_m]) + vehicle.saw_tooth_amplitude_m
        depth_keys = tuple(f"{key}.{what}" for what in ("depth_m", "station", "depth_profile", "saw_tooth_amplitude_m"))
        if vehicle.saw_tooth_amplitude_m > vehicle.layer_m and not vehicle.depth_profile:
            text = (
                f"{key}: saw_tooth_amplitude_m = {vehicle.saw_tooth_amplitude_m:g} about depth_m = "
                f"{vehicle.depth_m:g} would leave the water"
            )
            found.append(Misfit(depth_keys, text))
        if deepest > self.ocean.floor_depth_m - 1:
            text = (
                f"{key} would dive to {deepest:g} m, the floor lies at ocean.floor_depth_m = "
                f"{self.ocean.floor_depth_m:g} m (1 m is kept clear)"
            )
            found.append(Misfit((*depth_keys, "ocean.floor_depth_m"), text))
        drift = self.ocean.current_speed_m_s - self.ocean.current_shear_per_s * deepest
        if abs(drift) > FASTEST_CURRENT_M_S:
            text = (
                f"ocean: the current at {key}'s {deepest:g} m would run at {drift:.3g} m/s; current_speed_m_s and "
                f"current_shear_per_s must keep it within {FASTEST_CURRENT_M_S:g} m/s"
            )
            found.append(Misfit((*depth_keys, "ocean.current_speed_m_s", "ocean.current_shear_per_s"), text))
        return found

    def vehicles(self) -> list[tuple[str, Vehicle]]:
        """All vehicles with their keys, the leader first: leader, followers[0] and so on."""
        return [("leader", self.leader), *((f"followers[{i}]", f) for i, f in enumerate(self.followers))]

    @property
    def message_every(self) -> int:
        """Filter steps from one message to the next (n_D)."""
        return round(self.timing.message_interval_s / self.timing.filter_step_s)

    @property
    def filter_steps(self) -> int:
        """Number n of filter steps."""
        return math.floor(self.duration_s / self.timing.filter_step_s + 0.5)
