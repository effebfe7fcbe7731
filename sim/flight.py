"""A mission that was flown: scenario, truth, measurements and estimates together."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.estimates import Estimates
from laisn.messages import Measurements
from laisn.metrics import bearing_errors, position_errors
from laisn.navigators import NAVIGATORS, NavigatorFactory, find
from laisn.settings import Settings
from sim.assembly import are_at_baseline_and_offset
from sim.scenario.navigation import Navigation
from sim.scenario.parts import SensingSettings, sensing_of_each
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.acoustics import TRANSMITTERS
from sim.sensing.links import navigated_link
from sim.sensing.observation import measure, observe, start_of
from sim.sensing.sensors import further_errors_of, navigated_errors_of
from sim.trajectory import Trajectory
from sim.water.assembly import floor_of

SLIP_M_SQRT_S = 0.007
"""Random walk of the true position beside what speed log and compass tell, as navigators of
scenarios with physics assume it unless the scenario states another [m/√s]: as far as the waves of
the built-in scenario `following-sea` move the hydrophone in 1 s. In calm water estimates are hardly
worse for it."""

Kind = TypeVar("Kind", bound=Settings)


class Termination(Enum):
    """How a mission ended."""

    COMPLETED = "the mission was flown to its end"
    CONTACT = "vehicles touched, which ended the mission"
    GROUNDED = "a vehicle went below the floor, which ended the mission"
    OFF_ROUTE = "a vehicle was more than 100 m off its route, which ended the mission"
    LEFT_FIELD = "a vehicle left the area of a field of the sea, which ended the mission"
    DIVERGED = "the simulation left finite numbers; everything up to that step is kept"
    INTERRUPTED = "the mission was interrupted; everything up to that step is kept"


@dataclass(frozen=True, kw_only=True)
class VehicleRecord:
    """What a vehicle has measured and concluded in a mission."""

    measurements: Measurements
    estimates: Estimates | None  # None: it has no navigator

    def part(self, first: int, last: int) -> Self:
        """Steps `first` + 1 … `last`, which become 1 … `last` − `first`."""
        estimates = None if self.estimates is None else self.estimates.part(first, last)
        return replace(self, measurements=self.measurements.part(first, last), estimates=estimates)


@dataclass(frozen=True, kw_only=True, repr=False)
class FlightRecord:
    """One mission, whole. Follower i is vehicle i + 1 of the trajectory.

    What users get is an `experiments.flight.results.Flight`, which also draws and reports it.
    """

    scenario: Scenario
    trajectory: Trajectory
    measurements: tuple[Measurements, ...]  # one for each follower
    estimates: tuple[Estimates, ...]  # one for each follower
    outcome: Termination = Termination.COMPLETED
    leader: VehicleRecord | None = None  # None: it has not sensed under way

    def __post_init__(self) -> None:
        for i, estimates in enumerate(self.estimates):
            if not isinstance(estimates, Estimates):
                raise LaisnError(
                    f"the navigator of {self.scenario.followers[i].name} returned "
                    f"{type(estimates).__name__} from `run`; expected laisn.estimates.Estimates"
                )

    @property
    def stride(self) -> int:
        """Points of the trajectory from one filter step to the next."""
        return round(self.scenario.timing.filter_step_s / CONTROL_STEP_S)

    def step_index(self) -> Ints:
        """Index into the trajectory of filter steps k = 1 … n, shape (n,)."""
        n = self.measurements[0].speed.size
        return np.arange(1, n + 1, dtype=np.int64) * self.stride

    @property
    def without_estimate(self) -> list[str]:
        """Names of the followers that have no estimate in the whole mission."""
        return [
            name
            for name, estimates in zip(self.trajectory.names[1:], self.estimates, strict=True)
            if estimates.steps_without_estimate == len(estimates.state)
        ]

    def __repr__(self) -> str:
        followers = len(self.scenario.followers)
        duration = self.trajectory.time[-1]
        navigator = self.scenario.variants
        outcome = self.outcome.name.lower()
        return (
            f"<Flight {self.scenario.name!r}: {duration:g} s, followers: {followers}, "
            f"{navigator}, {outcome}>"
        )

    def hydrophone(self, follower: int) -> Floats:
        """True position of a follower's hydrophone, which it estimates, at filter steps, shape
        (n, 3), [m].
        """
        name = self.trajectory.names[follower + 1]
        return self.trajectory.site_path(f"{name}/hydrophone", self.step_index())

    def assumed_hydrophone_height(self, vehicle: int) -> float:
        """How much higher the navigator of a vehicle, 0 for the leader, assumes the hydrophone than
        the depth sensor [m]. Its code is not imported: it may be in a plugin that is not loaded.
        """
        of_hull = _hydrophone_height(self.trajectory.sites, self.trajectory.names[vehicle])
        own = self.scenario.leader.navigation
        navigation = self.scenario.navigation_of(vehicle - 1) if vehicle else own
        return of_hull if navigation is None else navigation.hydrophone_height(of_hull)

    def leader_position(self) -> Floats:
        """True position of what a leader estimates that navigates at filter steps: its hydrophone,
        or the origin of its hull if it has none; shape (n, 3), [m].
        """
        steps = self.step_index()
        if "leader/hydrophone" in self.trajectory.site_names:
            return self.trajectory.site_path("leader/hydrophone", steps)
        return np.asarray(self.trajectory.position[steps, 0])


class FlightUnderWay(Protocol):
    """A mission that goes on, as it is recorded until now."""

    scenario: Scenario

    @property
    def navigates(self) -> bool:
        """Whether estimates are there as soon as filter steps are over."""

    @property
    def steps(self) -> int:
        """Filter steps that are over."""

    def part(self, first: int) -> FlightRecord:
        """The flight from a filter step on until now, with the fixes that hold there."""


def navigation_settings(scenario: Scenario, sites: Mapping[str, Floats], follower: int) -> Settings:
    """Settings of a follower's navigator, by the scenario and the sites of all vehicles, as of
    `Trajectory.sites`; LaisnError if there is no such navigator, or it has no such settings.
    """
    sensing = SensingSettings.of(scenario.navigated_as(follower))
    link = navigated_link(sensing.links)
    if link is not None:
        sites = link.with_sites(sites)
    navigation = scenario.navigation_of(follower)
    return settings_of(sensing, navigation, sites, scenario.followers[follower].name)


def _hydrophone_height(sites: Mapping[str, Floats], name: str) -> float:
    """How much higher a vehicle's hydrophone is than its pressure sensor [m]; of a leader without a
    hydrophone, which receives nothing, 0.
    """
    if name == "leader" and f"{name}/hydrophone" not in sites:
        return 0.0
    return float(sites[f"{name}/hydrophone"][2] - sites[f"{name}/depth_sensor"][2])


def _placement(navigation: Navigation, sites: Mapping[str, Floats]) -> dict[str, Any]:
    """Settings of where a navigator takes transmitters to be, by the sites of all vehicles."""
    positions = np.array([sites[transmitter] for transmitter in TRANSMITTERS])
    # in the leader's hull, with heights from its pressure sensor, by which its depth is broadcast
    above_sensor = positions - np.array([0.0, 0.0, sites["leader/depth_sensor"][2]])
    # the leader's transmitters are those on its hull, unless the scenario has others
    values: dict[str, Any] = {
        "transmitter_offsets": navigation.transmitters_m,
        "use_attitude": navigation.use_attitude,
    }
    if are_at_baseline_and_offset(above_sensor):
        values |= {
            "baseline": 2.0 * float(above_sensor[1, 0]),
            "middle_offset": float(above_sensor[2, 1]),
        }
    elif not values["transmitter_offsets"]:
        values["transmitter_offsets"] = tuple(tuple(site) for site in above_sensor.tolist())
    return values


def placement_settings(navigation: Navigation, sites: Mapping[str, Floats]) -> Settings:
    """What every navigator is given of where transmitters are, by the sites of all vehicles, with
    those of the sender of its link in the leader's place. Code of navigators is not imported.
    """
    return Settings(**_placement(navigation, sites))


def settings_of(
    sensing: SensingSettings, navigation: Navigation, sites: Mapping[str, Floats], name: str
) -> Settings:
    """Settings of the navigator of a vehicle by its name, by a table of `navigation` and the sites
    of all vehicles, with those of the sender of its link in the leader's place; errors are as of
    `navigation_settings`.
    """
    sound = sensing.acoustics
    height = navigation.hydrophone_height(_hydrophone_height(sites, name))
    assumed_sound_speed = sound.sound_speed_m_s + sound.sound_speed_bias_m_s
    values: dict[str, Any] = {
        **_placement(navigation, sites),
        "dt": sensing.links.filter_step_s,
        "hydrophone_height": height,
        "ping_slot": sound.ping_slot_s,
        "sound_slowness": 1.0 / assumed_sound_speed if sound.travel_time else 0.0,
        "floor_depth": floor_of(sensing.sound.sea).deepest,
        "slip": SLIP_M_SQRT_S if sensing.kind == "physics" else 0.0,
    }
    return navigation.settings(values, assumed_sound_speed)


def settings_as(
    kind: type[Kind], scenario: Scenario, sites: Mapping[str, Floats], follower: int
) -> Kind:
    """`navigation_settings` of one kind; LaisnError if the scenario navigates by something else."""
    settings = navigation_settings(scenario, sites, follower)
    if not isinstance(settings, kind):
        expected = ", ".join(name for name, spec in NAVIGATORS.items() if spec.settings is kind)
        raise LaisnError(
            f"scenario {scenario.name!r}: {scenario.followers[follower].name} navigates by "
            f"{scenario.navigation_of(follower).variant!r}; expected one of {expected}"
        )
    return settings


def navigate(
    scenario: Scenario,
    trajectory: Trajectory,
    navigator: NavigatorFactory | None = None,
    outcome: Termination = Termination.COMPLETED,
) -> FlightRecord:
    """Sense a trajectory, or the part that was flown, with the scenario's noise, and let every
    follower navigate on it.

    `navigator` makes one navigator for each follower; None: the scenario's own. `outcome` is that
    of the motion.
    """
    measurements = []
    estimates = []
    sensing_of = sensing_of_each(scenario)
    for follower in range(len(scenario.followers)):
        make = navigator or find(scenario.navigation_of(follower).variant).make
        sensing = sensing_of[follower]
        settings = navigation_settings(scenario, trajectory.sites, follower)
        follower_measurements = measure(
            observe(trajectory, sensing, follower),
            navigated_errors_of(sensing, follower),
            seed=sensing.seed,
            run=sensing.run,
            follower=follower,
            transmitters=settings.transmitters,
            further=further_errors_of(sensing, follower),
        )
        measurements.append(follower_measurements)
        estimates.append(make(settings, start_of(trajectory, follower)).run(follower_measurements))
    return FlightRecord(
        scenario=scenario,
        trajectory=trajectory,
        measurements=tuple(measurements),
        estimates=tuple(estimates),
        outcome=outcome,
    )


def excerpt(flight: FlightRecord, start: float, end: float) -> FlightRecord:
    """The part of a flight from `start` to `end`, widened to filter steps; ValueError if it
    leaves the mission.
    """
    truth = flight.trajectory
    dt = flight.measurements[0].dt
    begin = float(truth.time[0])
    first = int(np.floor((start - begin) / dt + 1e-6))
    last = int(np.ceil((end - begin) / dt - 1e-6))
    if not 0 <= first < last <= flight.measurements[0].speed.size:
        raise ValueError(
            f"an excerpt from {start:g} to {end:g} s of a mission from {begin:g} to "
            f"{float(truth.time[-1]):g} s"
        )
    return replace(
        flight,
        trajectory=truth.part(first * flight.stride, last * flight.stride),
        measurements=tuple(m.part(first, last) for m in flight.measurements),
        estimates=tuple(e.part(first, last) for e in flight.estimates),
        leader=None if flight.leader is None else flight.leader.part(first, last),
    )


def position_and_bearing_errors(flight: FlightRecord) -> list[tuple[Floats, Floats]]:
    """E_P [m] and E_B [rad] of every follower at filter steps k = 1 … n, shapes (n,)."""
    leader = flight.trajectory.position[flight.step_index(), 0, :2]
    result = []
    for i, estimates in enumerate(flight.estimates):
        position = estimates.state[:, :2]
        truth = flight.hydrophone(i)[:, :2]
        result.append((position_errors(position, truth), bearing_errors(position, truth, leader)))
    return result


def leader_errors(flight: FlightRecord) -> Floats | None:
    """E_P [m] of the leader's own estimate at filter steps k = 1 … n, shape (n,); None: it has no
    navigator.
    """
    if flight.leader is None or flight.leader.estimates is None:
        return None
    truth = flight.leader_position()[:, :2]
    return position_errors(flight.leader.estimates.state[:, :2], truth)
