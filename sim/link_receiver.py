"""What vehicles receive on further links, one instant after the other.

A link's messages are received as the leader's broadcast is (`sim.sensing.reception`); here its
receivers may be the leader too, its messages may hold what the sender's navigator and sensors say,
and they may be answers, which have no schedule.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.messages import LeaderMessage, LinkMessages, Reception
from laisn.swarm import reception_of
from sim.scenario.parts import SensingSettings
from sim.sensing import measurement_record, reception, sensor_model
from sim.sensing.acoustics import (
    Motion,
    Ping,
    Sites,
    Sound,
    follow,
    reception_step,
    site_at,
    sound_of,
)
from sim.sensing.links import AT_REST, Link
from sim.sensing.noise import Address
from sim.sensing.reception import listener_of
from sim.sensing.sensors import update_tilt_error
from sim.trajectory import StateHistory
from sim.water.rays import Path

TIME, EAST, NORTH, DEPTH, POSITION_SIGMA = (
    LeaderMessage._fields.index(name)
    for name in ("timestamp", "east", "north", "depth", "position_sigma")
)
"""Columns of a message as a row of numbers."""


class Hearing(NamedTuple):
    """What receivers receive on one link, and have received: f followers, perhaps the leader after
    them.
    """

    sensors: sensor_model.SensorModel
    motion: StateHistory  # of all vehicles, the sender first
    sites: Sites
    # what accelerations add to the sender's measured pitch and roll, shape (n + 1, 2), [rad]
    tilts: Floats
    inbox: reception.Inbox
    arrived: Bools  # whether a message is in at this filter step, shape (f,)
    measured: measurement_record.MeasurementRecord
    places: Floats | None  # of beacons, as of `Link`


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Vehicles as links find them."""

    followers: int
    instants: int  # that there is room for
    hydrophones: Floats  # of the followers, then of the leader; NaN if it has none, (f + 1, 3) [m]
    attitude_broadcast: bool
    # settings by the navigation of each follower; none: all navigate alike
    navigated: Sequence[SensingSettings] = ()


class Sender(NamedTuple):
    """What a vehicle has read and concluded until now, as messages hold it."""

    readings: Floats  # speed [m/s], heading [rad] and depth [m] at filter steps, shape (n, 3)
    state: Floats  # x, y [m], vx, vy [m/s] of its hydrophone at filter steps, shape (n, 4)
    covariance: Floats  # of the state, shape (n, 4, 4), or (0, 4, 4): not recorded
    start: Floats  # of the state, shape (4,)
    hydrophone: Floats  # from the origin of its hull, shape (3,), [m]
    steps: Ints  # how many filter steps are navigated until now, shape (1,)
    read: Ints  # how many of them are read, shape (1,)

    def content(self, time: float, dt: float) -> Floats:
        """What a message holds that leaves at a time [s], shape (10,): its last readings, and its
        estimate at the last filter step, brought forward by the velocity.
        """
        begun = math.floor(time / dt + 1e-6)
        step = min(begun, int(self.steps[0]))
        row = np.full(len(LeaderMessage._fields), np.nan)
        state = self.state[step - 1] if step > 0 else self.start
        speed, heading, depth = self.readings[max(min(begun, int(self.read[0])) - 1, 0)]
        forward, port, _ = self.hydrophone
        sine = math.sin(heading)
        cosine = math.cos(heading)
        message = LeaderMessage(
            timestamp=time,
            east=state[0] + (time - step * dt) * state[2] - forward * sine + port * cosine,
            north=state[1] + (time - step * dt) * state[3] - forward * cosine - port * sine,
            heading=heading,
            speed=speed,
            depth=depth,
        )
        row[:] = message
        if step > 0 and self.covariance.shape[0] > 0:
            variance = 0.5 * float(np.trace(self.covariance[step - 1, :2, :2]))
            row[POSITION_SIGMA] = math.sqrt(max(variance, 0.0))
        return row


def _sound_of_leader(sensing: SensingSettings, sound: Sound, link: Link) -> Sound:
    """How sound gets to the leader, whose clock is that of beacons; a follower's is ahead of it."""
    ahead = 0.0 if link.sender == AT_REST else 1.0
    clocks = sound_of(sensing)
    return sound._replace(
        clock_offset=-ahead * clocks.clock_offset, clock_drift=-ahead * clocks.clock_drift
    )


class ReadingsSource(Protocol):
    """Readings of the further sensors of a vehicle at filter steps by their names."""

    def __call__(self, vehicle: int, step: int) -> Mapping[str, Floats]: ...


class Receiver:
    """What one link's receivers have received, whatever its schedule is."""

    def __init__(self, sensing: SensingSettings, link: Link, fleet: Fleet) -> None:
        """Nothing is received yet."""
        leader = 0 in link.receivers
        receivers = fleet.followers + leader
        vehicles = fleet.followers + 1 + leader
        sensors = sensor_model.sensor_model_of(
            sensing, link, leader_receives=leader, sensing_of=fleet.navigated
        )
        steps = (fleet.instants - 1) // sensors.stride
        # NaN makes pitch and roll of messages NaN: not broadcast
        tilt = 0.0 if fleet.attitude_broadcast else np.nan
        self.link = link
        self.receives = [receiver_number(v, fleet.followers) for v in link.receivers]
        """Numbers of those that receive it, among followers and the leader after them."""
        self.hearing = Hearing(
            sensors=sensors,
            motion=StateHistory.empty(fleet.instants, vehicles, 0),
            sites=Sites(link.sites, fleet.hydrophones[:receivers]),
            tilts=np.full((fleet.instants, 2), tilt),
            inbox=reception.new_inbox(receivers, link.every),
            arrived=np.zeros(receivers, dtype=np.bool_),
            measured=measurement_record.MeasurementRecord.empty(receivers, steps, link.every),
            places=link.places,
        )
        self._sensor_models = [sensors] * receivers
        if leader:
            self._sensor_models[-1] = sensors._replace(
                sound=_sound_of_leader(sensing, sensors.sound, link)
            )
        self.sender: Sender | None = None
        """Whose estimate and readings messages hold; None: its true state, with errors."""
        self.readings_of: ReadingsSource | None = None
        """Of the sender's further sensors, where messages hold any."""
        self.content: list[dict[str, Floats]] = [{} for _ in range(receivers)]
        """Readings of further sensors in the last message of each receiver."""
        # the same of all messages of each receiver, in order
        self._contents: list[list[dict[str, Floats]]] = [[] for _ in range(receivers)]
        self.round_trip: Floats = np.full(receivers, np.nan)
        """As of `Reception`, of the last message of each receiver [s]."""

    @property
    def name(self) -> str:
        """Of the link."""
        return self.link.name

    def follow_motion(self, k: int, truth: StateHistory) -> None:
        """Take instant k of the motion of all vehicles."""
        hearing = self.hearing
        s = hearing.sensors
        self.link.copy_instants(truth, k, k, hearing.motion)
        if k > 0 and s.senses_acceleration:
            pose = hearing.motion.pose[:, 0]
            update_tilt_error(s.tilt_gain, k, pose, hearing.motion.twist[:, 0], hearing.tilts)
        hearing.arrived[:] = False
        hearing.inbox.outcome[:] = reception.NO_MESSAGE

    def receive(self, k: int, receivers: Sequence[int]) -> None:
        """Receive what is in at instant k, a filter step, by the numbers of receivers."""
        step = k // self.hearing.sensors.stride
        for i in receivers:
            if i in self.receives and self._poll(step, k, i):
                self._complete(step, i)

    def _poll(self, step: int, k: int, i: int) -> bool:
        """Take up a message that is in; whether there is one."""
        hearing = self.hearing
        inbox = hearing.inbox
        if inbox.earliest_step[i] > step:
            return False
        motion_so_far = Motion(hearing.motion, 0.0, k)
        reception.receive(
            self._sensor_models[i], step, i, hearing.sites, motion_so_far, hearing.tilts, inbox
        )
        return bool(inbox.outcome[i] != reception.NO_MESSAGE)

    def sent_time(self, i: int) -> float:
        """When the last message of a receiver left [s]."""
        return float(self.hearing.inbox.last_sent[i] * self.hearing.sensors.dt)

    def _complete(self, step: int, i: int) -> None:
        """Put into a message what its sender knows, and leave out what it does not hold; its
        readings follow by `take_readings`.
        """
        hearing = self.hearing
        inbox = hearing.inbox
        dt = hearing.sensors.dt
        values = inbox.message_values[i]
        sent_time = self.sent_time(i)
        if self.sender is not None:
            values[:] = self.sender.content(sent_time, dt)
        values[self.link.hidden] = np.nan
        inbox.ranges[i, self.link.transmitters :] = np.nan
        hearing.arrived[i] = True
        if step > 0:
            m = hearing.measured.messages[i]
            hearing.measured.messages[i] += 1
            hearing.measured.message_step[i, m] = step
            hearing.measured.message[i, m] = values
            hearing.measured.ranges[i, m] = inbox.ranges[i]

    def take_readings(self, k: int, receivers: Sequence[int]) -> None:
        """Put readings of the sender's further sensors into the messages that have come at instant
        k, a filter step.
        """
        dt = self.hearing.sensors.dt
        for i in receivers:
            if i not in self.receives or not self.hearing.arrived[i]:
                continue
            self.content[i] = {}
            if self.readings_of is not None:
                emission_step = math.floor(self.sent_time(i) / dt + 1e-6)
                readings = self.readings_of(self.link.sender, emission_step)
                nothing_received = np.full(0, np.nan)
                self.content[i] = {
                    name: readings.get(name, nothing_received) for name in self.link.readings
                }
            if k > 0:
                self._contents[i].append(self.content[i])

    def record_readings(self, step: int, readings: Floats) -> None:
        """Record the followers' own readings at a filter step, shape (f, 6)."""
        if step > 0:
            self.hearing.measured.own[: len(readings), step - 1] = readings[:, :3]

    def reception(self, i: int, custom: Mapping[str, Floats]) -> Reception | None:
        """What a receiver has received at this filter step; None: nothing."""
        hearing = self.hearing
        if not hearing.arrived[i]:
            return None
        received = reception_of(
            hearing.inbox.message[i], hearing.inbox.ranges[i], custom, hearing.places
        )
        return received._replace(
            content=self.content[i],
            round_trip=float(self.round_trip[i]),
            offsets=self.link.offsets,
        )

    def _round_trips(self, i: int, messages: int) -> Floats | None:
        return None

    def messages(self, i: int, steps: int) -> LinkMessages:
        """What a receiver has received in the first steps."""
        record = self.hearing.measured
        arrived = record.message_step[i, : record.messages[i]]
        m = int(np.searchsorted(arrived, steps, side="right"))
        names = self.link.readings if self.readings_of is not None else ()
        return LinkMessages(
            message_step=record.message_step[i, :m].copy(),
            message=record.message[i, :m].copy(),
            ranges=record.ranges[i, :m].copy(),
            places=self.hearing.places,
            round_trip=self._round_trips(i, m),
            offsets=self.link.offsets,
            content={
                name: np.array([row[name] for row in self._contents[i][:m]]) for name in names
            },
        )


def receiver_number(vehicle: int, followers: int) -> int:
    """Number of a vehicle among receivers: followers, and the leader after them."""
    return vehicle - 1 if vehicle else followers


class _Request(NamedTuple):
    """A message that is to be answered."""

    sent_time: float  # when it left [s]
    arrival: float  # of its rear ping by the direct path [s]
    detection_error: float  # error of that arrival as it is measured [s]


def _request_arrival(requests: Hearing, i: int, k: int) -> _Request | None:
    """The request that a receiver has taken up at instant k; None: there is none, or its rear ping
    is lost.
    """
    inbox = requests.inbox
    if inbox.outcome[i] != reception.RECEIVED or math.isnan(inbox.ranges[i, 0]):
        return None
    s = requests.sensors
    sent_time = float(inbox.last_sent[i] * s.dt)
    listener = listener_of(s, i, requests.sites.hydrophones[i].tolist())
    motion = Motion(requests.motion, 0.0, k)
    _, pings = follow(s.sound, motion, requests.sites.transmitters.tolist(), listener, sent_time)
    direct = pings[0][1][Path.DIRECT]
    true_range = direct.length * direct.ratio + direct.clock_range
    return _Request(
        sent_time, direct.time, (inbox.ranges[i, 0] - true_range) / s.sound.assumed_speed
    )


class _Answer(NamedTuple):
    """An answer under way."""

    sent_time: float  # when it leaves [s]
    request_sent_time: float  # when the message left that is answered [s]
    detection_error: float  # as of `_Request`


class AnswerReceiver(Receiver):
    """What receivers have received of a vehicle that answers the messages of another link.

    The answer leaves a constant time after the request's rear ping has come by the direct path. The
    vehicle that has sent the request measures the round trip, with the error of a range in each of
    the two detections of a ping.
    """

    def __init__(self, sensing: SensingSettings, link: Link, fleet: Fleet, requester: int) -> None:
        """Nothing is answered yet; `requester` is the vehicle that sends the requests."""
        super().__init__(sensing, link, fleet)
        self._requester = receiver_number(requester, fleet.followers)
        self._responder = receiver_number(link.sender, fleet.followers)
        # a round trip is measured by one clock: what clocks add to ranges is added to these alone
        self._clocks = [(m.sound.clock_offset, m.sound.clock_drift) for m in self._sensor_models]
        self._sensor_models = [
            m._replace(sound=m.sound._replace(clock_offset=0.0, clock_drift=0.0))
            for m in self._sensor_models
        ]
        self._under_way: list[_Answer] = []
        # by receiver: which of these it receives next, when the last one left, and all round trips
        self._next_answer: Ints = np.zeros(len(self.content), dtype=np.int64)
        self._sent_times: Floats = np.zeros(len(self.content))
        self._measured_round_trips: list[list[float]] = [[] for _ in self.content]

    def sent_time(self, i: int) -> float:
        """When the last answer to a receiver left [s]."""
        return float(self._sent_times[i])

    def take_request(self, k: int, requests: Hearing) -> None:
        """Answer a request that has come to the sender of the answers at instant k, a filter step;
        `requests` is what is received on the link of the requests.
        """
        request = _request_arrival(requests, self._responder, k)
        if request is None:
            return
        sent_time = request.arrival + self.link.delay
        self._under_way.append(_Answer(sent_time, request.sent_time, request.detection_error))

    def _poll(self, step: int, k: int, i: int) -> bool:
        waiting = int(self._next_answer[i])
        if waiting >= len(self._under_way):
            return False
        answer = self._under_way[waiting]
        hearing = self.hearing
        s = hearing.sensors
        motion = Motion(hearing.motion, 0.0, k)
        if answer.sent_time > step * s.dt:
            return False
        listener = listener_of(s, i, hearing.sites.hydrophones[i].tolist())
        sound = self._sensor_models[i].sound
        complete, pings = follow(
            sound, motion, hearing.sites.transmitters.tolist(), listener, answer.sent_time
        )
        if reception_step(complete, s.dt) > step:
            return False
        self._next_answer[i] += 1
        self._take(answer, pings, step, k, i)
        return True

    def _take(
        self, answer: _Answer, pings: tuple[Ping, Ping, Ping], step: int, k: int, i: int
    ) -> None:
        hearing = self.hearing
        s = self._sensor_models[i]
        motion = Motion(hearing.motion, 0.0, k)
        emission_step = math.floor(answer.sent_time / s.dt + 1e-6)
        content = np.empty(len(LeaderMessage._fields))
        true = np.empty((3, 3))  # ranges by transmitter and `Path` [m]
        sender = reception.sender_at(
            s, emission_step, emission_step * s.stride, hearing.motion, hearing.tilts
        )
        e = s.errors[i]
        reception.true_reception(s, e, sender, step, pings, content, true)
        east, north, _ = site_at(s.sound.on_grid, motion, 0, (0.0, 0.0, 0.0), answer.sent_time)
        content[TIME] = answer.sent_time
        content[EAST] = east
        content[NORTH] = north
        address = Address(s.seed, s.run, int(s.noise_numbers[i]), emission_step)
        inbox = hearing.inbox
        reception.read_reception(
            e,
            (int(s.transmitters[i]), s.dt),
            (address, address._replace(step=step)),
            (content.tolist(), true.tolist()),
            inbox,
            i,
        )
        self._sent_times[i] = answer.sent_time
        self.round_trip[i] = np.nan
        ranges = inbox.ranges[i]
        if i == self._requester:
            arrival = pings[0][1][Path.DIRECT].time
            detection_error = (ranges[0] - true[0, Path.DIRECT]) / s.sound.assumed_speed
            # both pings may leave at the end of their messages
            waits = self.link.delay + 2.0 * s.sound.lead
            measured = arrival - answer.request_sent_time - waits
            self.round_trip[i] = measured + answer.detection_error + detection_error
        offset, drift = self._clocks[i]
        for j, (_, arrivals) in enumerate(pings):
            time = arrivals[Path.DIRECT].time
            ranges[j] += s.sound.assumed_speed * (offset + drift * time)
        ranges[ranges <= 0.0] = np.nan
        self._measured_round_trips[i].append(float(self.round_trip[i]))

    def _round_trips(self, i: int, messages: int) -> Floats | None:
        return np.array(self._measured_round_trips[i][:messages])
