"""Logs read back: the flight to the bit, or the measurements alone, of the simulator or of a
real vehicle.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.estimates import Estimates
from laisn.messages import LinkMessages, Measurements, SensorHeader
from laisn.navigators import NAVIGATORS
from sim.flight import FlightRecord, Termination, VehicleRecord
from sim.log.clock import TIMESTAMP, RecordedRows, correct_steps_back
from sim.log.contents import (
    FIRST_GAP,
    FLIGHT,
    SCENARIO,
    VEHICLES,
    Contents,
    LogError,
    Messages,
    log_errors,
)
from sim.log.order import steps_back
from sim.log.schema import (
    DETAILS,
    LINK,
    MEASURED,
    MEASURED_AMONG_BEACONS,
    PLACES,
    ROUND_TRIP,
    SENSOR,
    SENSORS,
    Clock,
    RecordType,
    content_fields,
    estimated,
    header_of_text,
    link_reception,
    vehicle_state,
)
from sim.scenario import file as scenario_file
from sim.scenario.navigation import Navigation
from sim.scenario.parts import LinkSettings, sensing_of_each
from sim.scenario.settings import CONTROL_STEP_S, Leader
from sim.sensing.links import navigated_link, offsets_of_links
from sim.trajectory import Trajectory

CORE = (vehicle_state(()), *MEASURED, *estimated(Estimates), *DETAILS.values())
"""Types of the channels that make up a flight."""
_OWN, _RECEIVED = MEASURED
LONGEST_GAP_S = 10.0  # longer gaps between own measurements are not bridged unless requested [s]
_MIN_GAP_STEPS = 2.0  # shortest gap [filter steps]
_MAX_NAMED_GAPS = 5  # most gaps that are named
_SOUND_M_S = 1500.0  # typical speed of sound
# ranges err: a ping that seems to arrive so much after its message was recorded does not [s]
_ARRIVAL_TOLERANCE_S = 1e-3
# ages of messages that are neither noise nor of another clock [s]
_MIN_DELAY_S = 0.1
_MAX_DELAY_S = 60.0
# limits of usual filter steps
_MIN_STEP_NS = 10**5
_MAX_STEP_NS = 10**11
_OPTIONAL = (
    "leader_pitch",
    "leader_roll",
    "leader_heading_sigma",
    "leader_position_sigma",
    "range_middle",
)
"""Fields of a reception that a vehicle's log may lack; they read as NaN, "not broadcast"."""
# columns of a message that a navigator cannot do without: the leader's timestamp (column 0), place,
# heading, speed and depth
_REQUIRED_COLUMNS = slice(0, 6)


class Recording(NamedTuple):
    """Measurements of a follower, and what was not as expected."""

    measurements: Measurements
    remarks: tuple[str, ...]
    # when each filter step ends, since the zero of the log that `Contents.start_ns` tells, for all
    # vehicles the same, shape (n,), [s]
    time_s: Floats


def _record(log: Contents, name: str, types: Sequence[RecordType], grid_ns: Ints) -> dict[str, Any]:
    """Arrays of channels of a vehicle in a flight by attribute; messages must have these times,
    shape (n,), [ns].
    """
    arrays = dict[str, Any]()
    for type_ in types:
        topic = f"/{name}/{type_.topic}"
        # a channel without a message is not in the file
        messages = log.require(topic, type_.fields, type_.schema if type_.steps else None)
        step = np.searchsorted(grid_ns, messages.time_ns).astype(np.int64)
        complete = step.size == grid_ns.size
        if type_.steps:
            # of channels with the same steps each has a message at all of them
            complete = np.array_equal(arrays.setdefault(type_.steps, step + 1), step + 1)
        if (
            not complete
            or np.any(step == grid_ns.size)
            or np.any(grid_ns[step] != messages.time_ns)
        ):
            raise LogError(
                f"{log.path}: the messages of {topic} are not at the times of a flight, without a "
                "gap"
            )
        for a in type_.columns:
            numbers = messages.table(a.names).astype(
                np.int64 if a.integer else np.float64, copy=False
            )
            arrays[a.attribute] = numbers.reshape(len(numbers), *a.shape)
        # hours of messages would fill the memory beside their numbers
        log.topics.pop(topic, None)
    return arrays


def _measured_types(links: LinkSettings) -> tuple[RecordType, ...]:
    """Types of the channels of a follower's measurements."""
    link = navigated_link(links)
    return MEASURED if link is None or link.places is None else MEASURED_AMONG_BEACONS


def _kind_of_estimates(facts: Mapping[str, str], name: str) -> type[Estimates]:
    """The kind of a follower's estimates, by what the log says of the flight."""
    # the fact that is called as the topic of the kind's details says who has it: names, or all
    for kind, type_ in DETAILS.items():
        fact = facts.get(type_.topic, "False")
        if fact == "True" or name in fact.split(", "):
            return kind
    return Estimates


def _sensor_headers(log: Contents) -> dict[str, SensorHeader]:
    """Channels and rates of further sensors by their names, as far as the log holds them."""
    texts = log.metadata.get(SENSORS, {})
    return {name: header_of_text(text) for name, text in texts.items()}


def _headers_of(
    custom: Mapping[str, Floats], headers: Mapping[str, SensorHeader]
) -> dict[str, SensorHeader]:
    """Channels and rates of the sensors that a vehicle carries, as far as the log holds them."""
    return {name: header for name, header in headers.items() if name in custom}


def _custom_tables(log: Contents, name: str) -> Iterator[tuple[str, Messages, Floats]]:
    """Further sensors of a vehicle: name, messages and their numbers, shape (m, c)."""
    beginning = f"/{name}/{SENSOR}"
    for topic in [topic for topic in log.topics if topic.startswith(beginning)]:
        messages = log.require(topic, ())
        fields = sorted(messages.message_class.DESCRIPTOR.fields, key=lambda field: field.number)
        yield topic.removeprefix(beginning), messages, messages.table([f.name for f in fields])


def _custom_readings(
    log: Contents, name: str, grid_ns: Ints, headers: Mapping[str, SensorHeader]
) -> dict[str, Floats]:
    """Readings of a follower's further sensors in a flight by their names, shape (n, c); NaN at
    steps without one.
    """
    readings = {}
    dt = 1e-9 * float(grid_ns[1] - grid_ns[0]) if grid_ns.size > 1 else 1.0
    for sensor, messages, numbers in _custom_tables(log, name):
        stride = headers.get(sensor, SensorHeader()).steps(dt)
        if not np.array_equal(grid_ns[stride - 1 :: stride], messages.time_ns):
            raise LogError(
                f"{log.path}: the messages of /{name}/{SENSOR}{sensor} are not at the times of a "
                "flight, without a gap"
            )
        rows = np.full((grid_ns.size, numbers.shape[1]), np.nan)
        rows[stride - 1 :: stride] = numbers
        readings[sensor] = rows
    return readings


def _link_fields(log: Contents, topic: str, headers: Mapping[str, SensorHeader]) -> RecordType:
    """The type of the messages of a further link, by the fields that they have."""
    messages = log.require(topic, ())
    names = {field.name for field in messages.message_class.DESCRIPTOR.fields}
    content = []
    for sensor, header in headers.items():
        channels = tuple(channel.name for channel in header.channels)
        if channels and names.issuperset(content_fields(sensor, channels)):
            content.append((sensor, channels))
    return link_reception(
        topic.rpartition(LINK)[2],
        with_position=names.issuperset(PLACES.names),
        with_round_trip=ROUND_TRIP in names,
        content=tuple(content),
    )


def _links(
    log: Contents,
    name: str,
    grid_ns: Ints,
    headers: Mapping[str, SensorHeader],
    offsets: Mapping[str, Floats | None],
) -> dict[str, LinkMessages]:
    """Messages of further links that a vehicle has received in a flight, by the link's name;
    `offsets` are as of `offsets_of_links`.
    """
    links = {}
    beginning = f"/{name}/{LINK}"
    for topic in [topic for topic in log.topics if topic.startswith(beginning)]:
        type_ = _link_fields(log, topic, headers)
        arrays = _record(log, name, [type_], grid_ns)
        places = arrays.pop(PLACES.attribute, None)
        received = {array: arrays.pop(array) for array in ("message_step", "message", "ranges")}
        round_trip = arrays.pop(ROUND_TRIP, None)
        link = topic.removeprefix(beginning)
        links[link] = LinkMessages(
            **received,
            offsets=offsets.get(link),
            places=None if places is None else places[0],
            round_trip=round_trip,
            content=arrays,
        )
    return links


def _kind_by_navigation(log: Contents, navigation: Navigation | None) -> type[Estimates]:
    """The kind of the leader's estimates: as its navigator has it, or as their channels show."""
    if navigation is not None and navigation.variant in NAVIGATORS:
        return NAVIGATORS[navigation.variant].estimates
    kinds = [kind for kind, type_ in DETAILS.items() if f"/leader/{type_.topic}" in log.topics]
    return kinds[0] if kinds else Estimates


def _leader_of(
    log: Contents,
    steps_ns: Ints,
    dt: float,
    headers: Mapping[str, SensorHeader],
    offsets: Mapping[str, Floats | None],
    leader: Leader,
) -> VehicleRecord | None:
    """What the leader of a scenario has measured and concluded; None: it has not sensed under
    way.
    """
    if f"/leader/{_OWN.topic}" not in log.topics:
        return None
    reception = log.topics.get(f"/leader/{_RECEIVED.topic}")
    has_positions = reception is not None and reception.field_path(PLACES.names[0])
    custom = _custom_readings(log, "leader", steps_ns, headers)
    measurements = Measurements(
        dt=dt,
        **_record(log, "leader", MEASURED_AMONG_BEACONS if has_positions else MEASURED, steps_ns),
        links=_links(log, "leader", steps_ns, headers, offsets),
        custom=custom,
        sensors=_headers_of(custom, headers),
    )
    estimates = None
    if f"/leader/{estimated(Estimates)[0].topic}" in log.topics:
        kind = _kind_by_navigation(log, leader.navigation)
        estimates = kind(**_record(log, "leader", estimated(kind), steps_ns))
    return VehicleRecord(measurements=measurements, estimates=estimates)


def _trajectory(log: Contents, grid_ns: Ints) -> Trajectory:
    """The truth at these times, shape (n,), [ns]."""
    table = json.loads(log.attachments[VEHICLES])
    vehicles = list[dict[str, Any]]()
    # as of `Trajectory`, shape (v, m, 3)
    force = np.reshape(table["effector_force"], (len(table["names"]), -1, 3))
    for name, effectors in zip(
        table["names"], table["effector_names"] or [()] * len(force), strict=True
    ):
        arrays = _record(log, name, [vehicle_state(tuple(effectors))], grid_ns)
        padding = ((0, 0), (0, force.shape[1] - len(effectors)))
        vehicles.append(arrays | {"effector_states": np.pad(arrays["effector_states"], padding)})
    state = {
        name: np.stack([arrays.pop(name) for arrays in vehicles], axis=1)
        for name in ("water_velocity", "effector_states")
    }
    for name, parts in (
        ("pose", ("position", "quaternion")),
        ("twist", ("velocity", "angular_velocity")),
    ):
        per_vehicle = (
            np.concatenate([arrays.pop(component) for component in parts], axis=1)
            for arrays in vehicles
        )
        state[name] = np.stack([*per_vehicle], axis=1)
    return Trajectory(
        names=tuple(table["names"]),
        time=vehicles[0]["time"],
        site_names=tuple(table["site_names"]),
        site_vehicle=np.array(table["site_vehicle"], dtype=np.int64),
        site_offset=np.array(table["site_offset"]).reshape(-1, 3),
        effector_names=tuple(map(tuple, table["effector_names"])),
        effector_force=force,
        **state,
    )


def _require_flight(log: Contents) -> None:
    """LogError if a log holds no flight."""
    missing = [f"attachment {name}" for name in (SCENARIO, VEHICLES) if name not in log.attachments]
    if FLIGHT not in log.metadata:
        missing.append(f"metadata {FLIGHT}")
    if missing:
        raise LogError(
            f"{log.path}: holds no flight: it lacks {', '.join(missing)}; available: "
            f"{', '.join(sorted(log.topics)) or 'no channels'}. Navigation alone needs "
            "/FOLLOWER/motion and /FOLLOWER/reception: laisn replay LOG --scenario FILE"
        )


def _require_fixes(
    path: Path,
    names: Sequence[str],
    measurements: Sequence[Measurements],
    estimates: Sequence[Estimates],
) -> None:
    """LogError unless each follower has a fix for each reception."""
    for name, m, e in zip(names, measurements, estimates, strict=True):
        if not np.array_equal(np.unique(e.fix_step), m.message_step):
            raise LogError(
                f"{path}: {name} has receptions without a fix, or fixes without a reception"
            )


def read(path: Path | str) -> FlightRecord:
    """The flight that `sim.log.writer.write` wrote, equal to the bit; LogError if it is damaged,
    or lacks something.
    """
    path = Path(path)
    suffixes = tuple(f"/{type_.topic}" for type_ in CORE)
    log = Contents(
        path,
        lambda topic, _: topic.endswith(suffixes) or f"/{SENSOR}" in topic or f"/{LINK}" in topic,
    )
    _require_flight(log)
    with log_errors(path):
        facts = log.metadata[FLIGHT]
        text = log.attachments[SCENARIO].decode()
        scenario = scenario_file.validate(
            scenario_file.parse(text, SCENARIO), f"{path}, {SCENARIO}", stored=True
        )
        clock = Clock(scenario.epoch)
        dt = scenario.timing.filter_step_s
        links = [sensing.links for sensing in sensing_of_each(scenario)]
        outcome = Termination[facts["outcome"]]
        if FIRST_GAP in facts:
            log.cut(int(facts[FIRST_GAP]))
        last_row = len(log.require("/leader/state", ()).times) - 1
        if last_row < 1:
            raise LogError(
                f"{path}: nothing of the flight stands before the first gap of this recovered log; "
                "its measurements can be replayed: laisn replay LOG --scenario FILE"
            )
        steps = last_row // round(dt / CONTROL_STEP_S)
        trajectory = _trajectory(log, clock.ns(CONTROL_STEP_S * np.arange(last_row + 1)))
        if outcome is Termination.COMPLETED and steps != scenario.filter_steps:
            raise LogError(
                f"{path}: a completed mission of {scenario.duration_s:g} s has "
                f"{scenario.filter_steps} filter steps, this log has {steps}"
            )
        steps_ns = clock.ns(dt * np.arange(1, steps + 1))
        names = trajectory.names[1:]
        kinds = [_kind_of_estimates(facts, name) for name in names]
        headers = _sensor_headers(log)
        offsets = offsets_of_links(links[0], trajectory.sites)
        custom = [_custom_readings(log, name, steps_ns, headers) for name in names]
        measurements = tuple(
            Measurements(
                dt=dt,
                **_record(log, name, _measured_types(links[i]), steps_ns),
                custom=custom[i],
                sensors=_headers_of(custom[i], headers),
                links=_links(log, name, steps_ns, headers, offsets),
            )
            for i, name in enumerate(names)
        )
        estimates = tuple(
            kind(**_record(log, name, estimated(kind), steps_ns))
            for name, kind in zip(names, kinds, strict=True)
        )
        _require_fixes(path, names, measurements, estimates)
        return FlightRecord(
            scenario=scenario,
            trajectory=trajectory,
            measurements=measurements,
            estimates=estimates,
            outcome=outcome,
            leader=_leader_of(log, steps_ns, dt, headers, offsets, scenario.leader),
        )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _optional(messages: Messages, names: Sequence[str]) -> Floats:
    """Numbers by the names of their fields, NaN for those that are not in a message, shape (n,
    len(names)).

    Where a type cannot distinguish zero from an absent number (protobuf 3 without `optional`), zero
    in a range, or in a quantity that need not be broadcast, stands for one that is not there.
    """
    present = [name for name in names if messages.field_path(name)]
    values = np.full((len(messages.data), len(names)), np.nan)
    values[:, [names.index(name) for name in present]] = messages.table(present)
    for name in {*_OPTIONAL, *_RECEIVED.columns[1].names} & set(present):
        if not messages.field_path(name)[-1].has_presence:
            column = values[:, names.index(name)]
            column[column == 0.0] = np.nan
    return values


def _rows_in_order(motion: Messages, reception: Messages, source: str, name: str) -> RecordedRows:
    """Own measurements and receptions in order of recording."""
    # place of each message in the order of recording
    ordinals = np.concatenate([motion.ordinals, reception.ordinals])
    order = np.argsort(ordinals)
    has_motion = order < len(motion.ordinals)
    names = (TIMESTAMP, "leader_east", "leader_north", "leader_heading", "leader_speed")
    table = np.full((order.size, len(names)), np.nan)
    table[~has_motion] = _optional(reception, names)[order[~has_motion] - len(motion.ordinals)]
    # no time is stated as zero
    table[table[:, 0] == 0.0, 0] = np.nan
    return RecordedRows(
        source=source,
        name=name,
        time=np.concatenate([motion.time_ns, reception.time_ns])[order],
        columns=dict(zip(names, table.T.copy(), strict=True)),
        has_motion=has_motion,
        received=~has_motion,
        remarks=[],
        item="message",
    )


class _ClockCorrection(NamedTuple):
    """What a clock that stepped back while it recorded has changed."""

    remarks: tuple[str, ...] = ()
    # what its steps add to the leader's clock in receptions, where that stepped too, shape (m,) [s]
    leader_shift_s: Floats | float = 0.0


def _correct_clock(
    log: Contents, topic: str, motion: Messages, reception: Messages
) -> _ClockCorrection:
    """Shift all messages after each step back of the clock that recorded own measurements.

    LaisnError if the steps are too many to be corrections of a clock.
    """
    if np.all(np.diff(motion.ordinals) > 0):
        return _ClockCorrection()
    rows = _rows_in_order(motion, reception, str(log.path), f"the clock of {topic}")
    if not steps_back(rows.time[rows.has_motion], rows.interval_ns):
        return _ClockCorrection()
    ordinals = np.sort(np.concatenate([motion.ordinals, reception.ordinals]))
    time_ns = rows.time.copy()
    leader_s = rows.columns[TIMESTAMP].copy()
    correct_steps_back(rows)
    shift_ns = rows.time - time_ns
    leader_shift_s = np.nan_to_num(rows.columns[TIMESTAMP] - leader_s)
    for messages in log.topics.values():
        if messages.ordinals:
            indices = np.searchsorted(ordinals, messages.ordinals, side="right") - 1
            messages.shift(shift_ns[np.maximum(indices, 0)])
    reception_rows = np.searchsorted(ordinals, reception.ordinals)
    return _ClockCorrection(tuple(rows.remarks), leader_shift_s[reception_rows])


class Pings(NamedTuple):
    """When pings of a message leave and how fast they travel, as the scenario of a replay tells."""

    slot_s: float = 0.0  # from each ping of a message to the next [s]
    sound_m_s: float = _SOUND_M_S

    def offsets(self, ranges: Floats) -> Floats:
        """How long after its first ping the last one of each message leaves, shape (m,), [s]."""
        is_heard = np.isfinite(ranges)
        return np.asarray((self.slot_s * np.arange(ranges.shape[1]) * is_heard).max(axis=1))

    def arrivals(self, stamps: Floats, ranges: Floats) -> Floats:
        """When the last ping of each message arrives, NaN where it is not known, shape (m,), [s];
        `stamps` are the times at which the first ones leave.
        """
        ways = self.slot_s * np.arange(ranges.shape[1]) + ranges / self.sound_m_s
        return np.asarray(stamps + np.max(np.nan_to_num(ways, nan=-np.inf), axis=1))


def _heard(heard_ns: Ints, stamps: Floats, ranges: Floats, pings: Pings) -> Ints:
    """When receptions are complete [ns]: where a log has them before their last ping arrives, as an
    import that did not know of slots, then.
    """
    arrival_ns = 1e9 * pings.arrivals(stamps, ranges)
    age_s = 1e-9 * (arrival_ns - heard_ns)
    is_early = (age_s > _ARRIVAL_TOLERANCE_S) & (age_s < _SAME_CLOCK_S)
    return np.where(is_early, np.rint(np.where(is_early, arrival_ns, 0.0)), heard_ns).astype(
        np.int64
    )


def _late_receptions(
    topic: str, heard_ns: Ints, message: Floats, ranges: Floats, dt_ns: int
) -> list[str]:
    """A remark on receptions that were recorded later than sound needs, by the leader's clock."""
    counts = np.isfinite(ranges).sum(axis=1)
    travel = np.nansum(ranges, axis=1) / np.maximum(counts, 1) / _SOUND_M_S
    delays = heard_ns / 1e9 - message[:, 0] - travel
    delays = delays[np.isfinite(delays) & (counts > 0)]
    delay = float(np.median(delays)) if delays.size else 0.0
    if not max(_MIN_DELAY_S, 1.5e-9 * dt_ns) < delay < _MAX_DELAY_S:
        return []
    return [
        f"messages of {topic} are {delay:.3g} s older than sound needs (median), by "
        "leader_timestamp: they are used as if the leader were there when they were recorded, but "
        "by navigators that compensate motion; where pings have slots, set acoustics.ping_slot_s"
    ]


def _gaps(
    path: Path, topic: str, time_s: Floats, spacing_ns: Ints, longest_gap_s: float
) -> list[str]:
    """Remarks on gaps between steps that end at times since the zero of the log; LogError if one
    is too long.
    """
    longest_step_ns = _MIN_GAP_STEPS * float(np.median(spacing_ns))
    gaps = np.flatnonzero(spacing_ns > longest_step_ns)
    largest_gaps = gaps[np.argsort(-spacing_ns[gaps], kind="stable")][:_MAX_NAMED_GAPS]
    number = _count(gaps.size, "gap")
    places = ", ".join(
        f"{s / 1e9:.3g} s at {begin_s:.3f} s"
        for s, begin_s in zip(spacing_ns[largest_gaps], time_s[largest_gaps], strict=True)
    )
    places += (
        f" and {gaps.size - largest_gaps.size} shorter ones"
        if gaps.size > largest_gaps.size
        else ""
    )
    if spacing_ns.max() / 1e9 > max(longest_gap_s, longest_step_ns / 1e9):
        raise LogError(
            f"{path}: {topic} has {number} ({places}); gaps of up to {longest_gap_s:g} s are "
            "bridged. Cut the log there, or allow longer ones: --longest-gap SECONDS"
        )
    return [f"{number} in {topic} bridged: {places}"] if gaps.size else []


# where log times less timestamps of messages differ among themselves by less than this, both clocks
# go alike; where they also are at most so long, they are delays by one and the same clock [s]
_SAME_CLOCK_S = 10.0


def _since_start(stamps: Floats, heard_ns: Ints, start_ns: int, offsets: Floats) -> Floats:
    """Timestamps of messages as times since the start, shape (m,), [s], as navigators count them.

    Those of another clock that goes as the log's does are moved by its offset, as if the message
    with the least delay had none but that of its pings' slots, shape (m,), [s]; those of any other
    clock, and zeros, stay as they are.
    """
    is_stated = np.isfinite(stamps) & (stamps != 0.0)
    log_minus_stamp = (1e-9 * (heard_ns - start_ns) - stamps)[is_stated]
    if not log_minus_stamp.size or np.ptp(log_minus_stamp) >= _SAME_CLOCK_S:
        return stamps
    delays = log_minus_stamp + 1e-9 * start_ns
    is_log_clock = np.all((delays > -1.0) & (delays < _SAME_CLOCK_S))
    offset = (
        -1e-9 * start_ns if is_log_clock else float((log_minus_stamp - offsets[is_stated]).min())
    )
    return np.where(is_stated, stamps + offset, stamps)


def _holds_numbers(messages: Messages) -> bool:
    """Whether the messages of a channel hold single numbers alone."""
    if not messages.is_protobuf:
        return False
    fields = messages.message_class.DESCRIPTOR.fields
    text = (fields[0].TYPE_STRING, fields[0].TYPE_BYTES) if fields else ()
    return bool(fields) and not any(
        field.is_repeated or field.message_type is not None or field.type in text
        for field in fields
    )


def _at_steps(steps_ns: Ints, message_ns: Ints, numbers: Floats) -> Floats:
    """Numbers of messages at the first filter steps that end at or after them, the last of several;
    NaN at steps without one.
    """
    rows = np.full((steps_ns.size, numbers.shape[1]), np.nan)
    step = np.searchsorted(steps_ns, message_ns)
    exists = step < steps_ns.size
    rows[step[exists]] = numbers[exists]
    return rows


def _last_of_equals(values: Ints) -> Bools:
    """Which of values in rising order are the last of those that are equal, shape (n,)."""
    return np.append(np.diff(values) > 0, True)[: values.size]


@dataclass(frozen=True, kw_only=True)
class _Channels:
    """What the channels of one follower hold, message by message."""

    time_ns: Ints  # of own measurements, shape (n,)
    readings: Floats  # speed, heading and depth, shape (3, n)
    heard_ns: Ints  # of receptions, shape (m,)
    message: Floats  # what the leader sent, shape (m, …)
    ranges: Floats  # NaN: not received, shape (m, transmitters)
    places: Floats  # of the transmitters, shape (m, transmitters, 3)
    absurd_ranges: int  # ranges that are no positive number
    custom: Mapping[str, tuple[Ints, Floats]]  # times and numbers of further sensors
    headers: Mapping[str, SensorHeader]  # of further sensors
    unread: Sequence[str]  # channels of further sensors that hold no numbers
    clock_remarks: Sequence[str]

    def heard_at(self, heard_ns: Ints) -> "_Channels":
        """The same with receptions at other times, in order of these, shape (m,), [ns]."""
        order = np.argsort(heard_ns, kind="stable")
        return replace(
            self,
            heard_ns=heard_ns[order],
            message=self.message[order],
            ranges=self.ranges[order],
            places=self.places[order],
        )


def _read_channels(log: Contents, motion_topic: str, reception_topic: str) -> _Channels:
    """Read the channels of a follower, whose messages are then let go: hours of them would fill the
    memory beside their numbers.
    """
    follower = motion_topic.split("/")[1]
    motion = log.require(motion_topic, _OWN.fields)
    required = [name for name in _RECEIVED.fields if name not in _OPTIONAL]
    reception = log.require(
        reception_topic, required, _RECEIVED.schema if FLIGHT in log.metadata else None
    )
    clock = _correct_clock(log, motion_topic, motion, reception)
    message, ranges = (_optional(reception, array.names) for array in _RECEIVED.columns)
    message[:, 0] += clock.leader_shift_s
    is_absurd = ~np.isnan(ranges) & ~((ranges > 0) & np.isfinite(ranges))
    ranges[is_absurd] = np.nan
    places = _optional(reception, PLACES.names).reshape(-1, *PLACES.shape)
    places[~np.all(np.isfinite(places), axis=2)] = np.nan
    sensors = [name for name in log.topics if name.startswith(f"/{follower}/{SENSOR}")]
    unread = [name for name in sensors if not _holds_numbers(log.topics[name])]
    for name in unread:
        del log.topics[name]
    channels = _Channels(
        time_ns=motion.time_ns,
        readings=motion.table(_OWN.fields).T,
        heard_ns=reception.time_ns,
        message=message,
        ranges=ranges,
        places=places,
        absurd_ranges=int(is_absurd.sum()),
        custom={
            sensor: (messages.time_ns, numbers)
            for sensor, messages, numbers in _custom_tables(log, follower)
        },
        headers=_sensor_headers(log),
        unread=unread,
        clock_remarks=clock.remarks,
    )
    log.topics.clear()
    return channels


class _Steps(NamedTuple):
    """Filter steps: own measurements that are finite, of several at one time the last. Depth may be
    absent, NaN.
    """

    time_ns: Ints  # of their ends, increasing, shape (n,)
    readings: Floats  # speed, heading and depth, shape (3, n)
    remarks: list[str]

    @property
    def spacing_ns(self) -> Ints:
        """From each to the next, shape (n − 1,)."""
        return np.diff(self.time_ns)

    @property
    def dt_ns(self) -> int:
        """Their median."""
        return round(float(np.median(self.spacing_ns)))

    @property
    def durations(self) -> Floats | None:
        """How long each took, the first Δt, shape (n,), [s]; None: Δt."""
        if np.all(self.spacing_ns == self.dt_ns):
            return None
        return np.append(float(self.dt_ns), self.spacing_ns) / 1e9


def _left_out(is_left_out: Bools, topic: str, reason: str) -> list[str]:
    """A remark on messages of a topic, if there are such."""
    number = int(np.count_nonzero(is_left_out))
    return [f"{_count(number, 'message')} of {topic} left out: {reason}"] if number else []


def _steps_of(channels: _Channels, path: Path, topic: str) -> _Steps:
    """Filter steps of own measurements; LogError if there are fewer than two."""
    # a depth that is absent is the last one to navigators; speed and heading they need
    finite = np.all(np.isfinite(channels.readings[:2]), axis=0) & ~np.isinf(channels.readings[2])
    last = _last_of_equals(channels.time_ns[finite])
    steps = _Steps(
        channels.time_ns[finite][last],
        channels.readings[:, finite][:, last],
        [
            *_left_out(~finite, topic, "not finite"),
            *_left_out(~last, topic, "at the very time of another"),
        ],
    )
    if steps.time_ns.size > 1 and np.all(np.isnan(steps.readings[2])):
        raise LogError(f"{path}: {topic} has no depth in any message")
    if steps.time_ns.size < 2:
        raise LogError(
            f"{path}: {topic} holds {_count(steps.time_ns.size, 'usable message')}; at least two "
            "are needed to determine the filter step"
        )
    return steps


class _Receptions(NamedTuple):
    """Receptions that belong to a filter step."""

    rows: Ints  # which they are, shape (m,)
    step: Ints  # their steps k = 1 … n, shape (m,)
    remarks: list[str]


def _receptions_of(channels: _Channels, steps: _Steps, topic: str) -> _Receptions:
    """The last reception of each filter step with a finite pose of the leader."""
    heard_ns = channels.heard_ns
    step = np.searchsorted(steps.time_ns, heard_ns).astype(np.int64) + 1
    in_time = (heard_ns > steps.time_ns[0] - steps.dt_ns) & (step <= steps.time_ns.size)
    usable = in_time & np.all(np.isfinite(channels.message[:, _REQUIRED_COLUMNS]), axis=1)
    rows = np.flatnonzero(usable)
    latest = _last_of_equals(step[rows])
    remarks = [
        *_left_out(~in_time, topic, "before the first or after the last filter step"),
        *_left_out(in_time & ~usable, topic, "without a finite pose of the leader"),
        *_left_out(~latest, topic, "followed by another in the same filter step"),
    ]
    if channels.absurd_ranges:
        remarks.append(
            f"{_count(channels.absurd_ranges, 'range')} of {topic} taken as not received: no "
            "positive number"
        )
    return _Receptions(rows[latest], step[rows[latest]], remarks)


def read_recording(
    path: Path | str,
    follower: str = "follower",
    longest_gap_s: float = LONGEST_GAP_S,
    pings: Pings = Pings(),  # noqa: B008 - it is never changed
) -> Recording:
    """What one follower of a flight, or a real vehicle, received and sensed in `/NAME/motion` and
    `/NAME/reception`.

    Own measurements are the filter steps, each as long as it took. Δt is the median, and the first
    ends a step of Δt. A reception belongs to the first step at or after it (`docs/log.md`), and
    none is there before its last ping has arrived, by the slots of `pings`.
    LogError if the log is damaged, lacks a channel or a field, has fewer than two own measurements,
    or a gap longer than `longest_gap_s`.
    """
    motion_topic = f"/{follower}/motion"
    reception_topic = f"/{follower}/reception"
    sensors = f"/{follower}/{SENSOR}"
    log = Contents(
        Path(path),
        lambda channel, _: (
            channel in (motion_topic, reception_topic) or channel.startswith(sensors)
        ),
    )
    with log_errors(log.path):
        start_ns = log.start_ns()
        mission_start_ns = log.mission_start_ns()
        channels = _read_channels(log, motion_topic, reception_topic)
    steps = _steps_of(channels, log.path, motion_topic)
    dt_ns = steps.dt_ns
    remarks = [f"{name} left out: its messages are no numbers" for name in channels.unread]
    remarks += channels.clock_remarks
    time_s = (steps.time_ns - start_ns) / 1e9
    remarks += _gaps(log.path, motion_topic, time_s, steps.spacing_ns, longest_gap_s)
    message = channels.message
    offsets = pings.offsets(channels.ranges)
    if mission_start_ns is None:
        if pings.slot_s:
            heard_ns = _heard(channels.heard_ns, message[:, 0], channels.ranges, pings)
            channels = channels.heard_at(heard_ns)
        remarks += _late_receptions(
            reception_topic,
            channels.heard_ns - np.rint(1e9 * offsets).astype(np.int64),
            message,
            channels.ranges,
            dt_ns,
        )
    begin_ns = int(steps.time_ns[0]) - dt_ns
    if mission_start_ns is None:
        message[:, 0] = _since_start(message[:, 0], channels.heard_ns, begin_ns, offsets)
    else:
        # both clocks count from the start of the mission
        message[:, 0] -= 1e-9 * (begin_ns - mission_start_ns)
    if not _MIN_STEP_NS < dt_ns < _MAX_STEP_NS:
        remarks.append(
            f"{motion_topic} comes every {dt_ns / 1e9:g} s: are the log times in nanoseconds?"
        )
    receptions = _receptions_of(channels, steps, reception_topic)
    remarks += steps.remarks
    remarks += receptions.remarks
    remarks += [
        f"{item}: no checksum, damage cannot be detected"
        for item in log.unverified
        if "chunks" in item
    ]
    rows = receptions.rows
    places = channels.places
    measurements = Measurements(
        dt=dt_ns / 1e9,
        speed=steps.readings[0],
        heading=steps.readings[1],
        depth=steps.readings[2],
        message_step=receptions.step,
        message=message[rows],
        ranges=channels.ranges[rows],
        durations=steps.durations,
        transmitters=None if np.all(np.isnan(places)) else places[rows],
        custom={
            name: _at_steps(steps.time_ns, *messages) for name, messages in channels.custom.items()
        },
        sensors={
            sensor: header
            for sensor, header in channels.headers.items()
            if sensor in channels.custom
        },
    )
    return Recording(measurements, tuple(remarks), time_s)
