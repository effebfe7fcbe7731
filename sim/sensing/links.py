"""Links: who sends messages with pings, from which sites, and when.

The leader's broadcast is one link, a second leader another, and beacons at rest that ping in turn
are a third (long baseline). What is sensed of a link is computed by one set of functions
(`reception`), which find the sender as the first vehicle of a motion: `Link.motion_of` puts it
there. The noise of the main link is that of the leader's broadcast, so that links compare in pairs;
further links have noise of their own. An answer to messages of another link has no schedule
(`sim.link_receiver`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from laisn.arrays import Floats, freeze_arrays
from laisn.messages import LeaderMessage
from sim.attitude import from_euler
from sim.scenario.links import LEADER_LINK, LinkTable
from sim.scenario.parts import LinkSettings
from sim.sensing import noise
from sim.trajectory import StateHistory, Trajectory, history_of

AT_REST = -1
"""Sender of a link of beacons."""
_FIELDS = {
    "position": ("east", "north", "position_sigma"),
    "heading": ("heading", "heading_sigma"),
    "speed": ("speed",),
    "depth": ("depth",),
    "attitude": ("pitch", "roll"),
}
"""Fields of `LeaderMessage` by what a link may hold."""
CONTENT = tuple(_FIELDS)
"""What a link holds unless its table says otherwise."""
_SITES = ("leader/tx_rear", "leader/tx_front", "leader/tx_middle")


@dataclass(frozen=True, kw_only=True)
class Link:
    """Messages of a sender to the followers."""

    name: str
    sender: int  # index of the vehicle; AT_REST: beacons
    # offsets (forward, port, up) of rear, front and middle transmitter in the sender's hull, shape
    # (3, 3), [m]
    sites: Floats
    # of a sender at rest: position [m] and quaternion (w, x, y, z), shape (7,); else 0
    origin: Floats
    transmitters: int  # how many there are
    every: int  # filter steps from one message to the next
    offset: int  # filter steps by which all messages are later
    receivers: tuple[int, ...]  # indices of vehicles, 0 of the leader
    content: tuple[str, ...] = CONTENT
    readings: tuple[str, ...] = ()  # names of the sender's further sensors
    by_estimate: bool = False  # it holds what the sender's navigator and sensors say
    answers: str = ""  # link whose messages are answered; empty: there is a schedule
    delay: float = 0.0  # of an answer, from the arrival of the request [s]

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

    @cached_property
    def offsets(self) -> Floats | None:
        """As of `laisn.messages.Reception`; None of beacons."""
        if self.sender == AT_REST:
            return None
        offsets = self.sites.copy()
        offsets[self.transmitters :] = np.nan
        return offsets

    def hears(self, follower: int) -> bool:
        """Whether a follower, by its index, receives it: who sends does not."""
        return follower + 1 in self.receivers

    @cached_property
    def hidden(self) -> list[int]:
        """Columns of `LeaderMessage` that its messages do not hold."""
        hidden = [name for name in CONTENT if name not in self.content]
        return [LeaderMessage._fields.index(field) for name in hidden for field in _FIELDS[name]]

    def copy_instants(
        self, truth: StateHistory, first: int, last: int, target_history: StateHistory
    ) -> None:
        """Write instants `first` … `last` of a motion with the sender as its first vehicle, and the
        leader as the last one if there is room for one more.
        """
        span = slice(first, last + 1)
        names = ("pose", "twist", "water")
        for name in names:
            source = getattr(truth, name)[span]
            target = getattr(target_history, name)[span]
            vehicles = source.shape[1]
            target[:, 1:vehicles] = source[:, 1:]
            target[:, vehicles:] = source[:, :1]
            if self.sender != AT_REST:
                target[:, 0] = source[:, self.sender]
        if self.sender == AT_REST:
            target_history.pose[span, 0] = self.origin
            target_history.twist[span, 0] = 0.0
            target_history.water[span, 0] = 0.0

    def with_sites(self, sites: Mapping[str, Floats]) -> dict[str, Floats]:
        """Sites of vehicles by their names, offsets of shape (3,), [m], with those of the sender in
        the leader's place.
        """
        sender_sites = dict(zip(_SITES, self.sites, strict=True))
        return {**sites, **sender_sites, "leader/depth_sensor": np.zeros(3)}

    def motion_of(self, trajectory: Trajectory) -> Trajectory:
        """A motion with the sender in the leader's place, and with its transmitters."""
        truth = history_of(trajectory)
        pose = np.empty_like(trajectory.pose)
        twist = np.empty_like(trajectory.twist)
        water = np.empty_like(trajectory.water_velocity)
        history = StateHistory(pose, twist, water, trajectory.effector_states)
        self.copy_instants(truth, 0, trajectory.time.size - 1, history)
        offset = trajectory.site_offset.copy()
        offset[[trajectory.site(name) for name in _SITES]] = self.sites
        offset[trajectory.site("leader/depth_sensor")] = 0.0
        return replace(trajectory, pose=pose, twist=twist, water_velocity=water, site_offset=offset)


def _beacon_frame(places: Sequence[Sequence[float]]) -> tuple[Floats, Floats]:
    """Pose of the middle of beacons, shape (7,), and their offsets from it, shape (3, 3), [m];
    those that are not there are at the first.
    """
    east, north, depth = np.array(places, dtype=np.float64).T
    middle = np.array([east.mean(), north.mean(), -depth.mean()])
    offsets = np.column_stack([north - middle[1], middle[0] - east, -depth - middle[2]])
    missing = [offsets[0]] * (3 - len(offsets))
    return np.concatenate([middle, from_euler(0.0)]), np.array([*offsets, *missing])


def _interval_s(links: LinkSettings, table: LinkTable) -> float:
    """From one message of a link to the next; of answers that of what is answered [s]."""
    if table.answers and table.answers != LEADER_LINK:
        table = next(request for request in links.tables if request.name == table.answers)
    return table.interval_s or links.interval_s


def link_of(links: LinkSettings, table: LinkTable) -> Link:
    """The link of a table."""
    interval = _interval_s(links, table)
    names = links.vehicles
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
    vehicles = {names.index(name) for name in table.receivers} or set(range(1, len(names)))
    if not table.receivers and table.name in links.navigated_by_leader:
        vehicles.add(0)
    return Link(
        name=table.name,
        receivers=tuple(sorted(vehicles - {sender})),
        content=table.content,
        readings=table.readings,
        by_estimate=table.position == "estimate",
        answers=table.answers or "",
        delay=table.delay_s,
        sender=sender,
        sites=sites,
        origin=origin,
        transmitters=count,
        every=links.steps(interval),
        offset=links.steps(table.offset_s),
    )


def links_of(links: LinkSettings) -> tuple[Link, ...]:
    """All links beside the leader's broadcast."""
    return tuple(link_of(links, table) for table in links.tables)


def named_link(links: LinkSettings, name: str) -> Link | None:
    """A link by its name; None: the leader's broadcast."""
    if name == LEADER_LINK:
        return None
    return next(link_of(links, table) for table in links.tables if table.name == name)


def broadcast_offsets(sites: Mapping[str, Floats]) -> Floats:
    """The leader's transmitters, as of `laisn.messages.Reception.offsets`: its messages state the
    depth of its pressure sensor.
    """
    offsets = np.array([sites[name] for name in _SITES])
    offsets[:, 2] -= sites["leader/depth_sensor"][2]
    return offsets


def offsets_of_links(links: LinkSettings, sites: Mapping[str, Floats]) -> dict[str, Floats | None]:
    """Transmitters of all links by their names, as of `laisn.messages.Reception.offsets`, by the
    sites of all vehicles.
    """
    offsets: dict[str, Floats | None] = {LEADER_LINK: broadcast_offsets(sites)}
    for table in links.tables:
        offsets[table.name] = link_of(links, table).offsets
    return offsets


def noise_base(links: LinkSettings, name: str) -> int:
    """What is added to the number of a receiver in the noise on a link, so that links that are
    received together err independently; 0 on the main link, so that such links compare in pairs.
    """
    if name == links.main:
        return 0
    if name == LEADER_LINK and LEADER_LINK not in links.further:
        return 0
    names = [LEADER_LINK, *(table.name for table in links.tables)]
    return noise.RECEIVERS * (1 + names.index(name))


def navigated_link(links: LinkSettings) -> Link | None:
    """The link that followers navigate on; None: the leader's broadcast."""
    return named_link(links, links.main)


def navigated_motion(trajectory: Trajectory, links: LinkSettings) -> Trajectory:
    """A motion with the sender of the link that is navigated on in the leader's place."""
    link = navigated_link(links)
    return trajectory if link is None else link.motion_of(trajectory)
