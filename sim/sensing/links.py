"""Links: who sends messages with pings, from which sites, and when.

The leader's broadcast is one link, a second leader another, and beacons at rest that ping in turn
are a third (long baseline). What is sensed of a link is computed by one set of functions
(`observation`), which find the sender as the first vehicle of a motion: `Link.motion_of` puts it
there. A link's noise is that of the leader's broadcast, so that links compare in pairs; a follower
navigates on one of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from laisn.arrays import Bools, Floats, freeze_arrays
from sim.attitude import from_euler
from sim.scenario.links import LEADER_LINK
from sim.scenario.links import Link as LinkTable
from sim.scenario.settings import Scenario
from sim.trajectory import StateHistory, Trajectory

AT_REST = -1
"""Sender of a link of beacons."""
_SITES = ("leader/tx_rear", "leader/tx_front", "leader/tx_middle")


@dataclass(frozen=True, kw_only=True)
class Link:
    """Messages of a sender to the followers."""

    name: str
    sender: int  # index of the vehicle; AT_REST: beacons
    sites: Floats  # offsets of rear, front and middle transmitter in its hull, shape (3, 3), [m]
    origin: Floats  # of a sender at rest: position and quaternion, shape (7,)
    transmitters: int  # how many there are
    every: int  # filter steps from one message to the next
    offset: int  # filter steps by which all messages are later

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @cached_property
    def places(self) -> Floats | None:
        """East, north and depth of beacons, shape (3, 3), [m], NaN for one that is not there; None
        of a vehicle's.
        """
        if self.sender != AT_REST:
            return None
        forward, port, up = self.sites.T
        # the frame of beacons heads north
        east = self.origin[0] - port
        north = self.origin[1] + forward
        places = np.column_stack([east, north, -(self.origin[2] + up)])
        places[self.transmitters :] = np.nan
        return places

    def hears(self, follower: int) -> bool:
        """Whether a follower, by its index, receives it: who sends does not."""
        return follower + 1 != self.sender

    def receivers(self, followers: int) -> Bools:
        """Which of so many followers receive it, shape (f,)."""
        return np.array([self.hears(i) for i in range(followers)])

    def copy_instants(self, truth: StateHistory, first: int, last: int, to: StateHistory) -> None:
        """Write instants `first` … `last` of a motion with the sender as its first vehicle."""
        span = slice(first, last + 1)
        names = ("pose", "twist", "water")
        for name in names:
            source = getattr(truth, name)[span]
            target = getattr(to, name)[span]
            target[:, 1:] = source[:, 1:]
            if self.sender != AT_REST:
                target[:, 0] = source[:, self.sender]
        if self.sender == AT_REST:
            to.pose[span, 0] = self.origin
            to.twist[span, 0] = 0.0
            to.water[span, 0] = 0.0

    def motion_of(self, trajectory: Trajectory) -> Trajectory:
        """A motion with the sender in the leader's place, and with its transmitters."""
        truth = StateHistory(
            trajectory.pose, trajectory.twist, trajectory.water_velocity, trajectory.thrust
        )
        pose = np.empty_like(trajectory.pose)
        twist = np.empty_like(trajectory.twist)
        water = np.empty_like(trajectory.water_velocity)
        moved = StateHistory(pose, twist, water, trajectory.thrust)
        self.copy_instants(truth, 0, trajectory.time.size - 1, moved)
        offset = trajectory.site_offset.copy()
        offset[[trajectory.site(name) for name in _SITES]] = self.sites
        offset[trajectory.site("leader/depth_sensor")] = 0.0
        return replace(trajectory, pose=pose, twist=twist, water_velocity=water, site_offset=offset)


def _steps(time_s: float, scenario: Scenario) -> int:
    return round(time_s / scenario.timing.filter_step_s)


def _beacon_frame(places: Sequence[Sequence[float]]) -> tuple[Floats, Floats]:
    """Pose of the middle of beacons, shape (7,), and their offsets from it, shape (3, 3), [m];
    those that are not there are at the first.
    """
    east, north, depth = np.array(places, dtype=np.float64).T
    middle = np.array([east.mean(), north.mean(), -depth.mean()])
    offsets = np.column_stack([north - middle[1], middle[0] - east, -depth - middle[2]])
    missing = [offsets[0]] * (3 - len(offsets))
    return np.concatenate([middle, from_euler(0.0)]), np.array([*offsets, *missing])


def link_of(scenario: Scenario, table: LinkTable) -> Link:
    """A link of a scenario."""
    interval = table.interval_s or scenario.timing.message_interval_s
    names = ["leader", *(follower.name for follower in scenario.followers)]
    if table.beacons_m:
        origin, sites = _beacon_frame(table.beacons_m)
        sender = AT_REST
        count = len(table.beacons_m)
    else:
        origin = np.zeros(7)
        offsets = [list(offset) for offset in table.transmitters_m]
        count = len(offsets)
        sites = np.array([*offsets, *[offsets[0]] * (3 - count)])
        sender = names.index(str(table.sender))
    return Link(
        name=table.name,
        sender=sender,
        sites=sites,
        origin=origin,
        transmitters=count,
        every=_steps(interval, scenario),
        offset=_steps(table.offset_s, scenario),
    )


def navigated_link(scenario: Scenario) -> Link | None:
    """The link that a scenario's followers navigate on; None: the leader's broadcast."""
    name = scenario.navigation.link
    if name == LEADER_LINK:
        return None
    return next(link_of(scenario, table) for table in scenario.links if table.name == name)


def navigated_motion(trajectory: Trajectory, scenario: Scenario) -> Trajectory:
    """A motion with the sender of the link that is navigated on in the leader's place."""
    link = navigated_link(scenario)
    return trajectory if link is None else link.motion_of(trajectory)
