"""A scenario taken apart: what each stage of a mission follows from.

Commands, checks and assemblies take a whole `Scenario`, and hand on these parts, or one of its
tables. What is stored of a stage has a key of exactly the parts that it is computed from.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal, Self, TypeVar

from laisn.navigators import NAVIGATORS
from sim.scenario.formation import Formation
from sim.scenario.links import LEADER_LINK, LinkTable, Place
from sim.scenario.section import Section, keys_per_run
from sim.scenario.sensors import (
    LEADER_PREFIX,
    Acoustics,
    Sensors,
    VehicleSensors,
)
from sim.scenario.settings import OceanTable, Scenario
from sim.scenario.vehicles import Follower, Leader, Vehicle

SectionType = TypeVar("SectionType", bound=Section)


@dataclass(frozen=True, kw_only=True)
class MissionPlan:
    """Hulls of vehicles, where they are to go, and for how long; keys on which their motion does
    not depend have their defaults.
    """

    duration_s: float
    leader: Leader
    followers: tuple[Follower, ...]

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """The plan of a scenario."""
        return cls(
            duration_s=scenario.duration_s,
            leader=scenario.leader.as_it_moves,
            followers=tuple(follower.as_it_moves for follower in scenario.followers),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all vehicles, the leader's first."""
        return ("leader", *(follower.name for follower in self.followers))

    @property
    def models(self) -> tuple[str, ...]:
        """Models of all vehicles as `VehicleSetup` takes them, the leader's first."""
        return (self.leader.model or "leader", *(f.model or "follower" for f in self.followers))

    def vehicles(self) -> list[tuple[str, Vehicle]]:
        """All vehicles with their keys in a scenario, the leader first."""
        followers = enumerate(self.followers)
        return [("leader", self.leader), *((f"followers[{i}]", f) for i, f in followers)]


@dataclass(frozen=True, kw_only=True)
class SeaSettings:
    """What current, waves and floor follow from."""

    ocean: OceanTable
    seed: int  # of irregular waves
    plan: MissionPlan  # where fields are needed that are read from files

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """The sea of a scenario."""
        return cls(ocean=scenario.ocean, seed=scenario.seed, plan=MissionPlan.of(scenario))


@dataclass(frozen=True, kw_only=True)
class SoundSettings:
    """What paths of sound follow from."""

    acoustics: Acoustics
    sea: SeaSettings
    beacons_m: tuple[Place, ...] = ()  # places of all beacons

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """The sound in a scenario's sea."""
        beacons = tuple(beacon for link in scenario.links for beacon in link.beacons_m)
        return cls(acoustics=scenario.acoustics, sea=SeaSettings.of(scenario), beacons_m=beacons)


@dataclass(frozen=True, kw_only=True)
class MotionSettings:
    """What the motion of a mission follows from, unless estimates or controllers steer it."""

    kind: Literal["physics", "kinematic"]
    sea: SeaSettings
    formation: Formation
    physics_step_s: float
    engine: Literal["mujoco", "direct"]
    contact: Literal["mark", "end"]

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """The motion of a scenario."""
        return cls(
            kind=scenario.motion,
            sea=SeaSettings.of(scenario),
            formation=scenario.formation,
            physics_step_s=scenario.timing.physics_step_s,
            engine=scenario.timing.engine,
            contact=scenario.contact,
        )

    @property
    def plan(self) -> MissionPlan:
        """Vehicles and their ways."""
        return self.sea.plan


@dataclass(frozen=True, kw_only=True)
class LinkSettings:
    """Who sends messages and when, who receives them, and who navigates on them."""

    vehicles: tuple[str, ...]  # names, the leader's first
    tables: tuple[LinkTable, ...]
    interval_s: float  # between messages of the leader, and of links that do not state it
    filter_step_s: float
    navigated: tuple[str, ...]  # links that followers navigate on, the main one first
    navigated_by_leader: tuple[str, ...] = ()  # the same of the leader, in any order
    main_of_leader: str = ""  # link that its navigator takes for its main one; "": none

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """The links of a scenario."""
        followers = scenario.followers
        leader_navigation = scenario.leader.navigation
        by_leader: tuple[str, ...] = ()
        main_of_leader = ""
        if leader_navigation is not None:
            by_leader = (leader_navigation.link, *leader_navigation.further_links)
            main_of_leader = leader_navigation.link if leader_navigation.link != LEADER_LINK else ""
        return cls(
            vehicles=("leader", *(follower.name for follower in followers)),
            tables=scenario.links,
            interval_s=scenario.timing.message_interval_s,
            filter_step_s=scenario.timing.filter_step_s,
            navigated=(scenario.navigation.link, *scenario.navigation.further_links),
            navigated_by_leader=tuple(name for name in by_leader if name != LEADER_LINK),
            main_of_leader=main_of_leader,
        )

    @property
    def main(self) -> str:
        """Name of the link that followers navigate on."""
        return self.navigated[0]

    @property
    def further(self) -> tuple[str, ...]:
        """Names of further links that followers navigate on."""
        return self.navigated[1:]

    def steps(self, time_s: float) -> int:
        """Number of filter steps in a time [s]."""
        return round(time_s / self.filter_step_s)

    @property
    def message_every(self) -> int:
        """Filter steps from one message of the leader to the next (n_D)."""
        return self.steps(self.interval_s)


PER_RUN = frozenset((*keys_per_run(Sensors), *keys_per_run(Acoustics)))
"""Keys of random errors, and of biases, which readings of a run have beside what is observed."""


def _errors_set_by(vehicle: VehicleSensors) -> dict[str, float]:
    """Errors that the table of a vehicle's own sensors sets."""
    return {name: value for name, value in vehicle if value is not None}


def _without_random_errors(section: SectionType) -> SectionType:
    """A table with keys of PER_RUN at their defaults."""
    fields = type(section).model_fields
    return section.model_copy(update={key: fields[key].default for key in PER_RUN & fields.keys()})


def _needed_sensor(variant: str) -> str:
    """The further sensor that a navigator needs; empty if it needs none."""
    shipped = NAVIGATORS.get(variant)
    return "" if shipped is None else shipped.sensor


@dataclass(frozen=True, kw_only=True)
class SensingSettings:
    """What all that vehicles measure and receive of a motion follows from."""

    seed: int
    run: int
    sensors: Sensors
    needed_sensor: str  # a further sensor that navigators need, as `sensors.custom` lists it; or ""
    needed_by_leader: str  # the same of the leader's navigator
    of_vehicles: tuple[VehicleSensors, ...]  # errors that each sets for its own, the leader first
    broadcast_attitude: bool
    sound: SoundSettings
    links: LinkSettings
    transmitters: int  # how many transmitters of a message navigators use
    sound_speed: Literal["mean", "straight", "profile"]  # that navigators assume
    kind: Literal["physics", "kinematic"]  # of the motion

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """The sensing of a scenario."""
        navigation = scenario.navigation
        leader_navigation = scenario.leader.navigation
        vehicles = (scenario.leader, *scenario.followers)
        return cls(
            seed=scenario.seed,
            run=scenario.run,
            sensors=scenario.sensors,
            needed_sensor=_needed_sensor(navigation.variant),
            needed_by_leader=""
            if leader_navigation is None
            else _needed_sensor(leader_navigation.variant),
            of_vehicles=tuple(vehicle.sensors for vehicle in vehicles),
            broadcast_attitude=scenario.leader.broadcast_attitude,
            sound=SoundSettings.of(scenario),
            links=LinkSettings.of(scenario),
            transmitters=navigation.transmitters,
            sound_speed=navigation.sound_speed,
            kind=scenario.motion,
        )

    @property
    def acoustics(self) -> Acoustics:
        """Errors of ranges, and how messages are received."""
        return self.sound.acoustics

    @property
    def has_current(self) -> bool:
        """Whether a current carries the vehicles: not those of the paper's point motion."""
        return self.kind == "physics" and self.sound.sea.ocean.has_current

    @property
    def without_random_errors(self) -> Self:
        """What is observed without the errors of a run follows from: alike for all settings that
        differ in these errors alone. An echo has a chance of a half, or none.
        """
        chances = ("surface_echo_probability", "bottom_echo_probability")
        echoes = {name: float(getattr(self.acoustics, name) > 0.0) / 2 for name in chances}
        acoustics = _without_random_errors(self.acoustics).model_copy(update=echoes)
        return replace(
            self,
            seed=0,
            run=0,
            sensors=_without_random_errors(self.sensors),
            of_vehicles=tuple(_without_random_errors(table) for table in self.of_vehicles),
            sound=replace(self.sound, acoustics=acoustics),
        )

    def sensors_of(self, follower: int, sender: int = 0) -> Sensors:
        """`[sensors]` with the errors that a follower, by its index, and the vehicle that sends
        set for their own sensors in place of those there.
        """
        overrides = _errors_set_by(self.of_vehicles[follower + 1])
        for name, value in _errors_set_by(self.of_vehicles[sender]).items():
            broadcast = f"{LEADER_PREFIX}{name}"
            if broadcast in Sensors.model_fields:
                overrides[broadcast] = value
        return self.sensors.model_copy(update=overrides)

    def sensors_of_leader(self) -> Sensors:
        """`[sensors]` with the errors of the leader's own sensors in place of a follower's."""
        leader_errors = _errors_set_by(self.of_vehicles[0])
        values: dict[str, Any] = {"speed_drift_m_s": 0.0, "heading_drift_deg": 0.0, "custom": ()}
        for name in VehicleSensors.model_fields:
            broadcast = f"{LEADER_PREFIX}{name}"
            if name in leader_errors:
                values[name] = leader_errors[name]
            elif broadcast in Sensors.model_fields:
                values[name] = getattr(self.sensors, broadcast)
        return self.sensors.model_copy(update=values)


def sensing_of_each(scenario: Scenario) -> tuple[SensingSettings, ...]:
    """The sensing of a scenario by the navigation of each follower."""
    followers = scenario.followers
    if all(follower.navigation is None for follower in followers):
        return (SensingSettings.of(scenario),) * len(followers)
    return tuple(SensingSettings.of(scenario.navigated_as(i)) for i in range(len(followers)))
