"""Followers that steer by their own estimates: the controller of a closed loop.

At each instant `sense`, at filter steps the followers' navigators, a `laisn.swarm.Swarm`, then
`guide`. What is read, received and estimated is recorded as it was, and is what a flight shows.
Guidance and autopilot have nothing but readings, messages and estimates. A follower may have a
controller of the user's own, whose Python code computes its commands from these (`CustomControl`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import NamedTuple, cast

import numpy as np

from laisn.arrays import Bools, Floats, Ints, Record, Records, numbers_of, records
from laisn.compiled import compiled, compiled_apart, copy_values
from laisn.estimates import Estimates
from laisn.held import borrowed_values
from laisn.messages import LeaderMessage, LinkMessages, Reception
from laisn.navigators import find
from laisn.settings import Settings
from laisn.spilled import spillable_zeros
from laisn.swarm import (
    ESTIMATE,
    READING,
    SeparateNavigators,
    Swarm,
    SwarmFactory,
    SwarmRecord,
    reception_of,
    write_start,
)
from sim.assembly import routes_of
from sim.attitude import body_point_in_world
from sim.control import follower as steering
from sim.control.autopilot import control, true_motion
from sim.control.guidance import (
    REFERENCE,
    track_current,
)
from sim.control.station import PLANNED_INTERVAL, TRAIL, LeaderPlan, extend_as_planned, plan_of
from sim.custom_control import CustomControl, readings_of
from sim.custom_sensing import Carrier, CustomSensing
from sim.estimated_route import follow_route
from sim.flight import FlightRecord, Termination, navigation_settings
from sim.leader import LEADER, LeaderUnit, needs_unit
from sim.link_receiver import AnswerReceiver, Fleet, Hearing, Receiver, Sender
from sim.scenario.formation import Proximity
from sim.scenario.links import LEADER_LINK
from sim.scenario.parts import LinkSettings, MotionSettings, SensingSettings, sensing_of_each
from sim.scenario.settings import Leader, Navigation, Scenario
from sim.scenario.vehicles import Follower
from sim.sensing import (
    measurement_record,
    observation,
    own_sensors,
    proximity,
    reception,
    sensor_model,
)
from sim.sensing.acoustics import TRANSMITTERS, Motion, Sites
from sim.sensing.links import broadcast_offsets, links_of, navigated_link
from sim.sensing.sensors import custom_sensors, update_tilt_error
from sim.simulation import (
    TICK,
    Mission,
    RouteControl,
    fly_mission,
    new_mission,
    static_trajectory,
    steer_along_route,
)
from sim.tracking import formations_of, stations_of
from sim.trajectory import StateHistory, Trajectory, speed_through_water
from sim.vehicle.plant import Plant

# kinds of followers
ON_ROUTE, ON_ROUTE_BY_ESTIMATE, BY_OWN_CONTROL, ON_STATION_BY_TRUTH, ON_STATION = range(5)


class ClosedLoopState(NamedTuple):
    """All that control works on beside the truth and the navigators; f followers, v vehicles."""

    formations: Records  # settings of `[formation]`, as each follower's hull can do it, shape (f,)
    proximity: Record  # settings of `[formation.proximity]`
    sensors: sensor_model.SensorModel
    look_every: int  # ticks from one look around to the next; 0: there is none
    kinds: Ints  # ON_ROUTE … ON_STATION of each follower, shape (f,)
    estimates_current: Bools  # whether the navigator of each follower estimates a current, (f,)
    # whether each follower reads heel and rate of roll, shape (f,): to hold roll, or for Python
    reads_roll: Bools
    leader_on_route: bool  # whether the leader keeps to its route by the truth
    # what messages of the leader hold that left at each of n filter steps and at the start, where
    # that is its own estimate: numbers of `LeaderMessage`, shape (n + 1, 10). Else, where messages
    # hold its true state with errors, shape (0, 10)
    broadcast: Floats
    plan: LeaderPlan  # the leader's, as far as its messages carry it
    stations: Records  # of STATION, shape (f,)
    sites: Sites  # offsets of the transmitters and of the hydrophones of the followers [m]
    depth_sensors: Floats  # offsets of the followers' pressure sensors, shape (f, 3), [m]
    instrument_noise: own_sensors.InstrumentNoise  # of the followers' own sensors
    # control of the leader and of followers that steer by the truth; it holds all commands
    routes: RouteControl
    readings: Records  # readings of each follower's sensors, of `laisn.swarm.READING`, shape (f,)
    reading_values: Floats  # the same memory as numbers, shape (f, 8)
    inbox: reception.Inbox  # what each follower has received
    arrived: Bools  # whether a message is in at this filter step, shape (f,)
    # what accelerations add to the leader's measured pitch and roll at each instant, shape
    # (instants, 2), [rad]; NaN where its messages do not hold them
    tilts: Floats
    sightings: Records  # what each follower's last look around showed, of SIGHTING, shape (f, v)
    estimates: Records  # estimate of each navigator, records of `laisn.swarm.ESTIMATE`, shape (f,)
    # trail of the leader as each follower has received it, of TRAIL, shape (f, room)
    trails: Records
    trail_counts: Ints  # points of the trails, shape (f, 1)
    memory: Records  # memory of each follower, of FOLLOWER_MEMORY, shape (f,)
    # reference of the autopilot of one follower at a time, of REFERENCE, shape (1,)
    reference: Records
    measured: measurement_record.MeasurementRecord  # what each follower has read and received
    concluded: SwarmRecord  # what its navigator has made of it


def _kind(follower: Follower) -> int:
    if follower.controller:
        return BY_OWN_CONTROL
    if follower.station:
        return ON_STATION if follower.guided_by_estimate else ON_STATION_BY_TRUTH
    return ON_ROUTE_BY_ESTIMATE if follower.guided_by_estimate else ON_ROUTE


def init_closed_loop(
    motion: MotionSettings,
    sensing_of: Sequence[SensingSettings],
    leader: Leader,
    navigations: Sequence[Navigation],
    plant: Plant,
    routes: RouteControl,
    *,
    whole: bool = True,
) -> ClosedLoopState:
    """The state of a closed loop at its start; `whole` is as of `SwarmRecord.empty`."""
    followers = motion.plan.followers
    f = len(followers)
    n = routes.reference.shape[0]
    sensing = sensing_of[0]
    message_every = sensing.links.message_every
    sensors = sensor_model.sensor_model_of(sensing, sensing_of=sensing_of)
    steps = (n - 1) // sensors.stride
    tilts = spillable_zeros((n, 2))
    tilts[:] = 0.0 if leader.broadcast_attitude else np.nan
    link = navigated_link(sensing.links)
    messages = steps // (link.every if link else message_every) + 1
    by_estimate = leader.broadcast_position == "estimate"
    estimates_type = find(navigations[0].variant).estimates
    site_offsets = plant.sites
    names = [follower.name for follower in followers]
    memory = records(steering.FOLLOWER_MEMORY, f)
    readings = records(READING, f)
    kinds = np.zeros(f, dtype=np.int64)
    waypoints = leader.broadcast_waypoints
    plan = plan_of(routes.reference[:, 0], routes_of(motion.plan)[0].time, waypoints, TICK)
    planned_points = n // round(PLANNED_INTERVAL / TICK) if waypoints else 0
    trails = records(TRAIL, f, n // message_every + planned_points + 2)
    counts = np.zeros((f, 1), dtype=np.int64)
    water = plant.ocean.velocity(plant.pose[:, :3], plant.time)[0]
    # most followers navigate by one table, which is asked once
    tables = {id(navigation): navigation for navigation in navigations}
    estimating_current = {
        key for key, table in tables.items() if "current" in table.settings().estimated
    }
    first_message = reception.first_message(sensors, plant.pose[0], plant.twist[0], water)
    for i, follower in enumerate(followers):
        kinds[i] = _kind(follower)
        steering.init_memory(first_message, trails[i], counts[i], memory[i])
        memory[i].by_thrust = routes.autopilot_designs[i + 1]["by_pitch"] == 0.0
    return ClosedLoopState(
        formations=formations_of(motion),
        proximity=(motion.formation.proximity or Proximity()).record(),
        sensors=sensors,
        look_every=proximity.look_interval(motion.formation.proximity),
        kinds=kinds,
        estimates_current=np.array([id(table) in estimating_current for table in navigations]),
        reads_roll=routes.autopilot_designs["holds_roll"][1:].copy(),
        leader_on_route=not (leader.controller or leader.guidance_position == "estimate"),
        broadcast=np.full((steps + 1 if by_estimate else 0, len(LeaderMessage._fields)), np.nan),
        plan=plan,
        stations=stations_of(motion),
        sites=Sites(
            transmitters=np.array([site_offsets[name] for name in TRANSMITTERS]),
            hydrophones=np.array([site_offsets[f"{name}/hydrophone"] for name in names]),
        ),
        depth_sensors=np.array([site_offsets[f"{name}/depth_sensor"] for name in names]),
        instrument_noise=own_sensors.new_instrument_noise(f),
        routes=routes,
        readings=readings,
        reading_values=numbers_of(readings),
        inbox=reception.new_inbox(f, message_every),
        arrived=np.zeros(f, dtype=np.bool_),
        tilts=tilts,
        sightings=records(proximity.SIGHTING, f, f + 1),
        estimates=records(ESTIMATE, f),
        trails=trails,
        trail_counts=counts,
        memory=memory,
        reference=records(REFERENCE, 1),
        measured=measurement_record.MeasurementRecord.empty(f, steps, message_every),
        concluded=SwarmRecord.empty(f, steps, messages, estimates_type, whole=whole),
    )


@compiled_apart
def sense(k: int, truth: StateHistory, state: ClosedLoopState) -> bool:
    """All sensors at instant k, and messages that are in; whether navigators are due, else
    followers dead-reckon.

    To count references to all arrays would take a tenth of its time.
    """
    return _sense(k, borrowed_values(truth), borrowed_values(state))


@compiled
def _sense(k: int, truth: StateHistory, state: ClosedLoopState) -> bool:
    stride = state.sensors.stride
    if k > 0 and state.sensors.senses_acceleration:
        update_tilt_error(
            state.sensors.tilt_gain, k, truth.pose[:, 0], truth.twist[:, 0], state.tilts
        )
    if k % stride != 0:
        _dead_reckon(state)
        return False
    step = k // stride
    # loops of their own: what is due at each step would wait for all that a message needs at hand
    for i in range(state.kinds.size):
        body = truth.pose[k, i + 1], truth.twist[k, i + 1], truth.water[k, i + 1]
        own_sensors.read_instruments(
            state.sensors,
            step,
            i,
            body,
            state.depth_sensors[i],
            state.instrument_noise,
            state.reading_values[i],
        )
        if state.reads_roll[i]:
            own_sensors.read_roll(state.sensors, step, i, body, state.reading_values[i])
    if k > 0 and state.look_every > 0 and k % state.look_every == 0:
        _look_around(k, truth, state)
    for i in range(state.kinds.size):
        state.arrived[i] = False
        state.inbox.outcome[i] = reception.NO_MESSAGE
        # asked here and not in `receive`: the call costs more than the comparison
        if state.inbox.earliest_step[i] <= step:
            _receive(k, i, truth, state)
    if state.plan.known_until.size > 0:
        _extend_as_planned(k, state)
    if k > 0:
        for i in range(state.kinds.size):
            measurement_record.record_step(
                state.measured, state.inbox, step, i, state.reading_values[i]
            )
    return k > 0


@compiled
def _dead_reckon(state: ClosedLoopState) -> None:
    """Move all estimated positions by one instant."""
    for i in range(state.kinds.size):
        estimate = state.estimates[i]
        for j in range(2):
            estimate.position[j] += TICK * estimate.velocity[j]


@compiled
def _extend_as_planned(k: int, state: ClosedLoopState) -> None:
    """Add where the leader is by its plan to its trail, of all followers on stations."""
    for i in range(state.kinds.size):
        if state.kinds[i] >= ON_STATION_BY_TRUTH:
            received = state.memory[i].last_received, state.memory[i].received_points
            extend_as_planned(
                state.plan, state.trails[i], state.trail_counts[i], received, (k, TICK)
            )


@compiled
def _look_around(k: int, truth: StateHistory, state: ClosedLoopState) -> None:
    """Look at vehicles nearby from all followers on stations, at instant k."""
    for i in range(state.kinds.size):
        if state.kinds[i] >= ON_STATION_BY_TRUTH:
            proximity.sense_neighbours(
                (state.sensors.seed, state.sensors.run),
                state.proximity,
                k,
                i,
                truth.pose[k],
                state.sightings[i],
            )
            steering.update_avoidance(
                state.proximity, state.sightings[i], state.estimates[i], state.memory[i]
            )


@compiled
def _receive(k: int, i: int, truth: StateHistory, state: ClosedLoopState) -> None:
    """Take up the message that follower i has received by instant k, a filter step, if any."""
    step = k // state.sensors.stride
    motion = Motion(truth, 0.0, k)
    reception.receive(state.sensors, step, i, state.sites, motion, state.tilts, state.inbox)
    state.arrived[i] = state.inbox.outcome[i] != reception.NO_MESSAGE
    if state.arrived[i] and state.broadcast.shape[0] > 0:
        sent_message = state.broadcast[state.inbox.last_sent[i]]
        copy_values(sent_message, state.inbox.message_values[i])
    if state.inbox.outcome[i] == reception.RECEIVED and state.kinds[i] >= ON_STATION_BY_TRUTH:
        steering.extend_trail(
            state.formations[i],
            state.stations[i],
            state.inbox.message[i],
            state.trails[i],
            state.trail_counts[i],
            (k * TICK, TICK),
            state.memory[i],
        )


@compiled
def _true_estimate(
    body: tuple[Floats, Floats, Floats],
    hydrophone: Floats,
    guidance: Record,
    reading: Record,
    estimate: Record,
) -> None:
    """Write the truth in place of readings and estimate of a follower that steers by it.

    Args:
        body: its pose, twist and the velocity of the water, rows of StateHistory.
        hydrophone: its offset from the origin of the hull, shape (3,), [m].
        guidance: memory of its guidance, of GUIDANCE_MEMORY, which follows the current.
        reading: out: of READING.
        estimate: out: of ESTIMATE.
    """
    pose, twist, water = body
    motion = true_motion(pose, twist, water)
    reading.speed = speed_through_water(pose, twist, water)
    reading.heading = motion.heading
    reading.depth = motion.depth
    reading.pitch = motion.pitch
    reading.turning = motion.turning
    reading.pitching = motion.pitching
    reading.heel = motion.heel
    reading.rolling = motion.rolling
    track_current((water[0], water[1]), TICK, guidance)
    estimate.log_bias = estimate.compass_bias = estimate.position_sigma = 0.0
    estimate.position[0], estimate.position[1], _ = body_point_in_world(pose, hydrophone)
    for i in range(2):
        estimate.velocity[i] = estimate.offset_to_likelier[i] = 0.0
        estimate.current[i] = guidance.current[i]


@compiled_apart
def guide(k: int, truth: StateHistory, state: ClosedLoopState) -> None:
    """Find the commands of all vehicles that hold from instant k until k + 1.

    Of the truth until then only that of the leader and of followers that steer by the truth is
    read.
    """
    _guide(k, borrowed_values(truth), borrowed_values(state))


@compiled
def _guide(k: int, truth: StateHistory, state: ClosedLoopState) -> None:
    routes = state.routes
    if state.leader_on_route and not routes.commanded_from_outside[0]:
        steer_along_route(k, truth, 0, routes)
    for f in range(state.kinds.size):
        i = f + 1
        if routes.commanded_from_outside[i]:
            # it starts anew where it then is
            state.memory[f].log = np.nan
            continue
        senses = steering.Senses(state.readings[f], state.estimates[f])
        if state.kinds[f] == ON_ROUTE:
            steer_along_route(k, truth, i, routes)
        elif state.kinds[f] == ON_ROUTE_BY_ESTIMATE:
            stride = state.sensors.stride
            follow_route(k, i, senses, state.memory[f], routes, stride, state.estimates_current[f])
        if state.kinds[f] < ON_STATION_BY_TRUTH:
            continue
        if state.kinds[f] == ON_STATION_BY_TRUTH:
            body = (truth.pose[k, i], truth.twist[k, i], truth.water[k, i])
            guidance = routes.guidance[i]
            if k == 0:
                guidance.current[0] = body[2][0]
                guidance.current[1] = body[2][1]
            _true_estimate(
                body, state.sites.hydrophones[f], guidance, senses.reading, senses.estimate
            )
        trail = (state.trails[f], state.trail_counts[f, 0])
        clock = (k * TICK, TICK)
        memory = state.memory[f]
        station_command, motion = steering.keep_station(
            state.formations[f],
            state.stations[f],
            senses,
            trail,
            clock,
            memory,
            state.reference[0],
            state.plan,
        )
        control(
            routes.kinds,
            routes.autopilot_designs[i],
            station_command,
            state.reference[0],
            motion,
            TICK,
            routes.autopilot_memories[i],
            routes.command[i],
        )


class ClosedLoop(NamedTuple):
    """Controller of a leader on its route and followers that sense and navigate under way."""

    state: ClosedLoopState
    swarm: Swarm  # the followers' navigators, with a compiled `navigate`

    @property
    def gated(self) -> Ints:
        """As of `Swarm`, of all followers."""
        return self.swarm.gated

    @compiled
    def control(self, k: int, truth: StateHistory) -> int:
        """Sense, navigate and find the commands of all vehicles; see
        `sim.simulation.Controller.control`.
        """
        state = self.state
        failed = 0
        if sense(k, truth, state):
            step = k // state.sensors.stride
            inbox = state.inbox
            failed = self.swarm.navigate(
                step,
                state.readings,
                state.arrived,
                inbox.message,
                inbox.ranges,
                state.estimates,
                state.concluded,
            )
        guide(k, truth, state)
        return failed


@dataclass(frozen=True, kw_only=True)
class NavigatorGroup:
    """Consecutive followers that navigate alike, by one swarm."""

    followers: range
    swarm: Swarm
    link: str  # whose messages they navigate on
    further_links: tuple[str, ...]  # that their navigators get beside
    estimates: type[Estimates]
    record: SwarmRecord  # of these followers alone, in the memory of that of all but for fixes

    @property
    def rows(self) -> slice:
        """Of these followers in arrays of all."""
        return slice(self.followers.start, self.followers.stop)

    def estimates_of(self, follower: int, steps: range) -> Estimates:
        """What was estimated for a follower, by its index, as of `SwarmRecord.estimates`."""
        i = follower - self.followers.start
        if isinstance(self.swarm, SeparateNavigators):
            return self.swarm.estimates(self.record, i, steps)
        return self.record.estimates(i, steps, self.estimates)


@dataclass(frozen=True, kw_only=True)
class LoopParts:
    """What is called from Python in a closed loop."""

    groups: Sequence[NavigatorGroup]  # of all followers, in order
    custom_control: CustomControl
    custom_sensing: Sequence[CustomSensing]  # of further sensors, of each follower
    # what is received on links beside the leader's broadcast, by name
    receivers: Mapping[str, Receiver] = field(default_factory=dict)
    leader: LeaderUnit | None = None  # None: it keeps to its route by the truth
    # of the leader's transmitters, as of `laisn.messages.Reception`
    broadcast_offsets: Floats = field(default_factory=lambda: np.full((3, 3), np.nan))


class PythonClosedLoop:
    """The same controller with navigators, further sensors, links or controllers that Python
    calls, followers that navigate differently, and a leader that senses under way.
    """

    def __init__(self, state: ClosedLoopState, parts: LoopParts) -> None:
        """Begin a mission."""
        self.state = state
        # for controllers of the user's own
        state.reads_roll[:] = True
        self.groups = parts.groups
        self._group_of = [group for group in parts.groups for _ in group.followers]
        self._custom_control = parts.custom_control
        self.custom_sensing = parts.custom_sensing
        self.receivers = parts.receivers
        self.leader = parts.leader
        self._broadcast_offsets = parts.broadcast_offsets
        self.latest_custom: list[dict[str, Floats]] = [{} for _ in parts.custom_sensing]
        """Readings of further sensors at the last filter step, of each follower."""
        # how many filter steps have been navigated, and how many read, shapes (1,), as senders of
        # messages look them up
        self._steps = np.zeros(1, dtype=np.int64)
        self._read = np.zeros(1, dtype=np.int64)
        for receiver in self.receivers.values():
            self._set_content(receiver)

    @property
    def gated(self) -> Ints:
        """As of `Swarm`, of all followers."""
        return np.concatenate([group.swarm.gated for group in self.groups])

    def group_of(self, follower: int) -> NavigatorGroup:
        """The followers that navigate as one does, by its index."""
        return self._group_of[follower]

    def _set_content(self, receiver: Receiver) -> None:
        """Let the messages of a link hold what its sender knows, where they are to."""
        sender = receiver.link.sender
        if receiver.link.by_estimate and self.leader is not None and sender == LEADER:
            receiver.sender = self.leader.sender
        elif receiver.link.by_estimate:
            f = sender - 1
            covariance = self.state.concluded.covariance
            receiver.sender = Sender(
                readings=self.state.measured.own[f],
                state=self.state.concluded.state[f],
                covariance=covariance[f],
                start=self._start(f),
                hydrophone=self.state.sites.hydrophones[f],
                steps=self._steps,
                read=self._read,
            )
        if receiver.link.readings:
            receiver.readings_of = self._readings_at

    def _start(self, f: int) -> Floats:
        """Position [m] and velocity [m/s] that a follower is taken to start with, shape (4,)."""
        estimate = self.state.estimates[f]
        return np.concatenate([estimate.position, estimate.velocity])

    def _readings_at(self, vehicle: int, step: int) -> dict[str, Floats]:
        """Readings of a vehicle's further sensors at a filter step, or the last one before."""
        if vehicle != LEADER:
            return self.custom_sensing[vehicle - 1].readings_at(step)
        return {} if self.leader is None else self.leader.custom_sensing.readings_at(step)

    def _receive(self, k: int) -> None:
        """Receive further links at instant k, a filter step."""
        step = k // self.state.sensors.stride
        followers = range(self.state.kinds.size)
        for receiver in self.receivers.values():
            receiver.receive(k, followers)
            receiver.record_readings(step, self.state.reading_values)

    def _answer(self, k: int, truth: StateHistory) -> None:
        """Let vehicles answer what has come to them at instant k, a filter step."""
        for receiver in self.receivers.values():
            if isinstance(receiver, AnswerReceiver):
                receiver.take_request(k, self.hearing_on(receiver.link.answers, truth))

    def control(self, k: int, truth: StateHistory) -> int:
        """As `ClosedLoop.control`."""
        state = self.state
        failed = 0
        stride = state.sensors.stride
        for receiver in self.receivers.values():
            receiver.follow_motion(k, truth)
        if self.leader is not None:
            self.leader.advance(k, truth)
            if k % stride == 0 and state.broadcast.shape[0] > 0:
                dt = float(state.sensors.dt)
                state.broadcast[k // stride] = self.leader.sender.content(k // stride * dt, dt)
        is_due = sense(k, truth, state)
        if k % stride == 0:
            self._read[0] = k // stride
            self._receive(k)
            self._answer(k, truth)
        if is_due:
            self._read_custom(k, truth)
            # those of this step, which an acoustic sensor reads as its vehicle receives
            for receiver in self.receivers.values():
                receiver.take_readings(k, range(state.kinds.size))
            for group in self.groups:
                failed = failed or self._navigate(k // stride, group, truth)
            self._steps[0] = k // stride
        guide(k, truth, state)
        if self.leader is not None:
            self.leader.steer(k)
        for i in self._custom_control.self_commanded:
            f = i - 1
            received = self.receptions(f) if is_due else {}
            main = received.pop(self.group_of(f).link, None)
            custom = self.latest_custom[f]
            reading = state.readings[f]
            readings = readings_of(k * TICK, reading, main, custom, received)
            self._custom_control.command(
                k, i, readings, steering.Senses(reading, state.estimates[f]), state.memory[f]
            )
        return failed

    def _navigate(self, step: int, group: NavigatorGroup, truth: StateHistory) -> int:
        """Advance a group by one filter step; gives a failure as `Swarm.navigate` does."""
        state = self.state
        rows = group.rows
        hearing = self.hearing_on(group.link, truth)
        if isinstance(group.swarm, SeparateNavigators):
            self._hand_over(group, group.swarm, hearing)
        failed = group.swarm.navigate(
            step,
            state.readings[rows],
            hearing.arrived[rows],
            hearing.inbox.message[rows],
            hearing.inbox.ranges[rows],
            state.estimates[rows],
            group.record,
        )
        return group.followers.start + failed if failed else 0

    def _hand_over(
        self, group: NavigatorGroup, swarm: SeparateNavigators, hearing: Hearing
    ) -> None:
        """Hand to navigators in Python what `Swarm.navigate` has no argument for: further
        readings, places of beacons, content of messages and further links.
        """
        swarm.custom = self.latest_custom[group.rows]
        swarm.places = hearing.places
        if group.link in self.receivers:
            swarm.content = self.receivers[group.link].content[group.rows]
        if group.further_links:
            for i, f in enumerate(group.followers):
                received = self.receptions(f)
                swarm.receptions[i] = {
                    name: received[name] for name in group.further_links if name in received
                }

    def receptions(self, f: int) -> dict[str, Reception]:
        """What is in at this filter step of all links by name, of a follower."""
        custom = self.latest_custom[f]
        receptions = {}
        if self.state.arrived[f]:
            inbox = self.state.inbox
            broadcast = reception_of(inbox.message[f], inbox.ranges[f], custom)
            receptions[LEADER_LINK] = broadcast._replace(offsets=self._broadcast_offsets)
        for name, receiver in self.receivers.items():
            if f in receiver.receives:
                reception = receiver.reception(f, custom)
                if reception is not None:
                    receptions[name] = reception
        return receptions

    def link_messages(self, follower: int, steps: range) -> dict[str, LinkMessages]:
        """What a follower has received of further links in filter steps `steps.start` + 1 …
        `steps.stop` by name.
        """
        group = self.group_of(follower)
        messages = {
            name: receiver.messages(follower, steps.stop)
            for name, receiver in self.receivers.items()
            if name != group.link and follower in receiver.receives
        }
        if LEADER_LINK in group.further_links:
            messages[LEADER_LINK] = self.state.measured.messages_of(
                follower, steps.stop, self._broadcast_offsets
            )
        return {name: record.part(steps.start, steps.stop) for name, record in messages.items()}

    def _read_custom(self, k: int, truth: StateHistory) -> None:
        """Read the further sensors of all followers at instant k, a filter step, and record
        them.
        """
        for f, sensing in enumerate(self.custom_sensing):
            if sensing:
                hearing = self.hearing_on(self.group_of(f).link, truth)
                self.latest_custom[f] = sensing.read(k, truth, hearing)

    def hearing_on(self, link: str, truth: StateHistory | None = None) -> Hearing:
        """What followers receive on a link; `truth` is its motion where that is the leader's."""
        receiver = self.receivers.get(link)
        if receiver is not None:
            return receiver.hearing
        return broadcast_hearing(self.state, truth or StateHistory.empty(0, 0, 0))


AnyClosedLoop = ClosedLoop | PythonClosedLoop


def broadcast_hearing(state: ClosedLoopState, truth: StateHistory) -> Hearing:
    """What followers receive of the leader's broadcast; `truth` is the motion of all vehicles."""
    return Hearing(
        sensors=state.sensors,
        motion=truth,
        sites=state.sites,
        tilts=state.tilts,
        inbox=state.inbox,
        arrived=state.arrived,
        measured=state.measured,
        places=None,
    )


def _fleet_of(
    plant: Plant,
    state: ClosedLoopState,
    sensing_of: Sequence[SensingSettings],
    *,
    attitude_broadcast: bool,
) -> Fleet:
    """Vehicles as links find them."""
    site_offsets = plant.sites
    leader_hydrophone = site_offsets.get("leader/hydrophone", np.full(3, np.nan))
    return Fleet(
        followers=state.kinds.size,
        instants=len(state.tilts),
        hydrophones=np.array([*state.sites.hydrophones, leader_hydrophone]),
        attitude_broadcast=attitude_broadcast,
        navigated=sensing_of,
    )


def _receivers_of(sensing: SensingSettings, fleet: Fleet) -> dict[str, Receiver]:
    """What is received on links beside the leader's broadcast by name."""
    receivers: dict[str, Receiver] = {}
    links = {link.name: link for link in links_of(sensing.links)}
    for name, link in links.items():
        if link.answers:
            request = links.get(link.answers)
            requester = LEADER if request is None else request.sender
            receivers[name] = AnswerReceiver(sensing, link, fleet, requester)
        else:
            receivers[name] = Receiver(sensing, link, fleet)
    return receivers


class _NavigatorChoice(NamedTuple):
    """How a follower navigates."""

    variant: str
    settings: Settings
    link: str
    further_links: tuple[str, ...]


def _runs_of_equal_choices(choices: Sequence[_NavigatorChoice]) -> list[range]:
    """Consecutive followers that navigate alike."""
    begins = [i for i in range(len(choices)) if i == 0 or choices[i] != choices[i - 1]]
    return [range(first, end) for first, end in pairwise([*begins, len(choices)])]


def _record_of(
    links: LinkSettings, concluded: SwarmRecord, followers: range, estimates_type: type[Estimates]
) -> SwarmRecord:
    """The record of some followers that navigate on these links: states and covariances in that of
    all, and room for fixes.
    """
    rows = slice(followers.start, followers.stop)
    steps = concluded.state.shape[1]
    link = navigated_link(links)
    messages = steps // (link.every if link else links.message_every) + 1
    with_covariance = concluded.covariance.shape[1] > 0
    fixes_only = SwarmRecord.empty(
        len(followers), 0, messages, estimates_type, whole=with_covariance
    )
    return fixes_only._replace(state=concluded.state[rows], covariance=concluded.covariance[rows])


def _custom_sensing_of(
    sensing_of: Sequence[SensingSettings], plant: Plant, state: ClosedLoopState
) -> tuple[CustomSensing, ...]:
    """Further sensors of each follower."""
    environment = plant.ocean.environment._replace(rays=state.sensors.sound.rays)
    return tuple(
        CustomSensing(
            custom_sensors(sensing, f),
            Carrier(
                vehicle=f + 1,
                receiver=f,
                noise_number=f,
                hydrophone=state.sites.hydrophones[f],
                depth_sensor=state.depth_sensors[f],
            ),
            environment,
            state.sensors,
        )
        for f, sensing in enumerate(sensing_of)
    )


def _navigator_groups(
    choices: Sequence[_NavigatorChoice],
    starts: Floats,
    sensing_of: Sequence[SensingSettings],
    state: ClosedLoopState,
    make_swarm: SwarmFactory | None,
) -> list[NavigatorGroup]:
    """A group for consecutive followers that navigate alike, from their starts, shape (f, 4); their
    first estimates are written into the state.
    """
    spans = _runs_of_equal_choices(choices)
    groups = []
    for followers in spans:
        choice = choices[followers.start]
        spec = find(choice.variant)
        has_further_links = bool(choice.further_links)
        make = make_swarm or partial(spec.new_swarm, several_links=has_further_links)
        record = state.concluded
        if len(spans) > 1:
            links = sensing_of[followers.start].links
            record = _record_of(links, state.concluded, followers, spec.estimates)
        group = NavigatorGroup(
            followers=followers,
            swarm=make(choice.settings, starts[followers.start : followers.stop]),
            link=choice.link,
            further_links=choice.further_links,
            estimates=spec.estimates,
            record=record,
        )
        write_start(state.estimates[group.rows], starts[group.rows], choice.settings)
        groups.append(group)
    return groups


def closed_loop_of(
    scenario: Scenario,
    plant: Plant,
    routes: RouteControl,
    make_swarm: SwarmFactory | None = None,
    *,
    whole: bool = True,
) -> AnyClosedLoop:
    """The closed loop of a scenario at its start, with the navigators of swarms, by default its
    own: a swarm for consecutive followers that navigate alike.

    With `whole` all that navigators conclude is recorded, else their states alone.
    """
    sensing = SensingSettings.of(scenario)
    at_start = static_trajectory(plant)
    sensing_of = sensing_of_each(scenario)
    navigations = [scenario.navigation_of(i) for i in range(len(scenario.followers))]
    settings = [navigation_settings(scenario, plant.sites, i) for i in range(len(navigations))]
    choices = [
        _NavigatorChoice(
            navigation.variant, follower_settings, navigation.link, navigation.further_links
        )
        for navigation, follower_settings in zip(navigations, settings, strict=True)
    ]
    state = init_closed_loop(
        MotionSettings.of(scenario),
        sensing_of,
        scenario.leader,
        navigations,
        plant,
        routes,
        whole=whole,
    )
    starts = np.array([observation.start_of(at_start, i) for i in range(len(choices))])
    groups = _navigator_groups(choices, starts, sensing_of, state, make_swarm)
    controlled = {i: f for i, f in enumerate(scenario.followers, 1) if f.controller}
    custom_control = CustomControl(controlled, plant, routes)
    custom_sensing = _custom_sensing_of(sensing_of, plant, state)
    fleet = _fleet_of(plant, state, sensing_of, attitude_broadcast=sensing.broadcast_attitude)
    receivers = _receivers_of(sensing, fleet)
    leader = None
    if needs_unit(scenario.leader, sensing.links):
        leader = LeaderUnit(scenario.leader, sensing, plant, routes, receivers, fleet)
    needs_python = custom_control or any(custom_sensing) or receivers or leader or len(groups) > 1
    # compiled swarms are tuples
    if isinstance(groups[0].swarm, tuple) and not needs_python:
        return ClosedLoop(state, groups[0].swarm)
    parts = LoopParts(
        groups=groups,
        custom_control=custom_control,
        custom_sensing=custom_sensing,
        receivers=receivers,
        leader=leader,
        broadcast_offsets=broadcast_offsets(plant.sites),
    )
    return PythonClosedLoop(state, parts)


def closed_loop_mission(
    scenario: Scenario, make_swarm: SwarmFactory | None = None, *, whole: bool = True
) -> Mission:
    """A mission whose followers all navigate under way, also those that steer by the truth.

    Its controller is a closed loop; arguments and errors are as of `closed_loop_of` and
    `new_mission`.
    """
    return new_mission(
        scenario, partial(closed_loop_of, scenario, make_swarm=make_swarm, whole=whole)
    )


def simulate_closed_loop(
    scenario: Scenario, make_swarm: SwarmFactory | None = None
) -> tuple[Trajectory, AnyClosedLoop]:
    """Fly a mission of `closed_loop_mission` that records the states of estimates alone.

    Gives the motion, and the closed loop at its end: `state.concluded.state` holds the estimates,
    `gated` counts fixes. Errors are those of `simulate_motion`.
    """
    mission = closed_loop_mission(scenario, make_swarm, whole=False)
    trajectory = fly_mission(MotionSettings.of(scenario), mission)
    return trajectory, cast(AnyClosedLoop, mission.controller)


class ClosedLoopFlight:
    """The flight of a mission of `closed_loop_mission`, as it was: nothing is computed again."""

    navigates = True  # estimates are there as soon as the steps are over

    def __init__(self, scenario: Scenario, mission: Mission) -> None:
        """Of a mission under way."""
        self.scenario = scenario
        self._mission = mission
        self._loop = cast(AnyClosedLoop, mission.controller)

    @property
    def steps(self) -> int:
        """Filter steps that are over."""
        return (self._mission.instants - 1) // self._loop.state.sensors.stride

    def part(self, first: int) -> FlightRecord:
        """The flight from a filter step on until now."""
        trajectory = self._mission.motion_since(first * self._loop.state.sensors.stride)
        return self._flight(first, trajectory, Termination.INTERRUPTED)

    def flight(self, trajectory: Trajectory, outcome: Termination) -> FlightRecord:
        """The flight from the start until the end of `trajectory`, which may end before the mission
        did.
        """
        if outcome is not Termination.INTERRUPTED:
            concluded = self._loop.state.concluded
            for array in (concluded.state, concluded.covariance):
                # so that estimates need not copy them
                array.flags.writeable = False
        return self._flight(0, trajectory, outcome)

    def _flight(self, first: int, trajectory: Trajectory, outcome: Termination) -> FlightRecord:
        loop = self._loop
        concluded = loop.state.concluded
        steps = range(first, first + (trajectory.time.size - 1) // loop.state.sensors.stride)
        dt = self.scenario.timing.filter_step_s
        measurements = []
        estimates = []
        leader = None
        for i in range(len(self.scenario.followers)):
            if isinstance(loop, ClosedLoop):
                estimates_type = find(self.scenario.navigation_of(i).variant).estimates
                measurements.append(loop.state.measured.measurements(i, steps, dt, {}, {}))
                estimates.append(concluded.estimates(i, steps, estimates_type))
                continue
            leader = loop.leader
            group = loop.group_of(i)
            sensing = loop.custom_sensing[i]
            hearing = loop.hearing_on(group.link)
            measured = hearing.measured.measurements(
                i,
                steps,
                dt,
                sensing.readings(steps),
                sensing.headers,
                hearing.places,
                loop.link_messages(i, steps),
            )
            measurements.append(measured)
            estimates.append(group.estimates_of(i, steps))
        return FlightRecord(
            scenario=self.scenario,
            trajectory=trajectory,
            measurements=tuple(measurements),
            estimates=tuple(estimates),
            outcome=outcome,
            leader=leader.record(steps) if leader is not None else None,
        )
