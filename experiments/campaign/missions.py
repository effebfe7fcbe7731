"""Missions: the motion of a mission is simulated once and serves all its cells."""

from dataclasses import replace
from functools import cache, lru_cache, partial
from typing import Any, TypeVar

from pydantic import BaseModel

from experiments.campaign.store import CampaignError, key_of
from laisn.failure import LaisnError
from sim.scenario.section import keys_per_run
from sim.scenario.settings import Acoustics, Leader, Navigation, Scenario, Sensors
from sim.sensing.observation import MissionTruth, observe
from sim.sensing.sensors import own_tables
from sim.simulation import EndedError, simulate_motion
from sim.trajectory import Trajectory
from sim.vehicle.mjcf import transmitter_places
from sim.vehicle.plant import PlantError

Section = TypeVar("Section", bound=BaseModel)


@cache
def _default(kind: type[BaseModel], name: str) -> Any:
    return kind.model_fields[name].get_default(call_default_factory=True)


def _without(section: Section, *names: str, **changes: Any) -> Section:
    """A section of a scenario with these keys at their defaults, and others changed."""
    return section.model_copy(update={name: _default(type(section), name) for name in names} | changes)


def content_of(scenario: Scenario) -> Scenario:
    """The scenario with everything at its default that changes no number of a campaign, to compute and to make keys."""
    return _without(scenario, "run", "epoch", "origin_latitude_deg", "origin_longitude_deg", "video")


def nameless(scenario: Scenario) -> Scenario:
    return scenario.model_copy(update={"name": "mission"})


def motion_of(scenario: Scenario) -> Scenario:
    """The scenario with everything at its default that does not change how vehicles move, to be flown."""
    leader = _without(scenario.leader, "broadcast_attitude", baseline_m=None, middle_offset_m=None)
    timing = _without(scenario.timing, "filter_step_s", "message_interval_s")
    return _without(content_of(scenario), "sensors", "acoustics", "navigation", leader=leader, timing=timing)


def _observed_of(scenario: Scenario, follower: int) -> Scenario:
    """The scenario with everything at its default, such as random errors, that does not change what `observe` finds."""
    sensors, acoustics = scenario.sensors_of(follower), scenario.acoustics
    chances = ("surface_echo_probability", "bottom_echo_probability")
    echoes = {name: float(getattr(acoustics, name) > 0.0) / 2 for name in chances}
    own = {
        "seed": 1,
        "sensors": _without(sensors, *keys_per_run(Sensors), own=own_tables(scenario)),
        "followers": tuple(_without(one, "sensors", "name") for one in scenario.followers),
        "acoustics": _without(acoustics, *keys_per_run(Acoustics), **echoes),
        "navigation": Navigation(variant="tight", assume={"transmitters": scenario.navigation.transmitters}),
    }
    return nameless(content_of(scenario)).model_copy(update=own)


def motion_key(scenario: Scenario) -> str:
    """Key of everything that may change how the vehicles move."""
    return key_of(nameless(motion_of(scenario)))


def sited(trajectory: Trajectory, leader: Leader) -> Trajectory:
    """A trajectory with its motion unchanged and the transmitters where this leader's keys place them."""
    offset = trajectory.site_offset.copy()
    for name, (axis, value) in transmitter_places(leader).items():
        offset[trajectory.site(f"leader/{name}"), axis] = value
    return replace(trajectory, site_offset=offset)


def simulate_mission(scenario: Scenario) -> Trajectory:
    """Motion of a mission's vehicles; CampaignError naming it, and how it ended, if that was before its time."""
    try:
        return sited(simulate_motion(motion_of(scenario)), scenario.leader)
    except (EndedError, PlantError) as error:
        # they carry the motion so far, which no process can hand to another
        raise CampaignError(f"mission {scenario.name!r}: {error}") from None


class Mission:
    """The motion of a scenario, or of others that move alike; what its cells share is computed once."""

    def __init__(self, scenario: Scenario, trajectory: Trajectory) -> None:
        self._motion = nameless(motion_of(scenario))
        self._sited = cache(partial(sited, trajectory))
        self._observed = cache(self._observe)

    def _observe(self, scenario: Scenario, follower: int) -> MissionTruth:
        return observe(self._sited(scenario.leader), scenario, follower)

    def seen(self, scenario: Scenario, follower: int) -> tuple[Trajectory, MissionTruth]:
        """Motion with a scenario's transmitters, and what one follower sees; LaisnError if vehicles move otherwise."""
        if nameless(motion_of(scenario)) != self._motion:
            raise LaisnError(f"scenario {scenario.name!r} moves otherwise than the mission that was simulated")
        return self._sited(scenario.leader), self._observed(_observed_of(scenario, follower), follower)


@lru_cache(maxsize=4)
def mission_of(motion: Scenario) -> Mission:
    """A mission, simulated once for all scenarios of this motion; errors as of `simulate_mission`."""
    return Mission(motion, simulate_mission(motion))
