"""A map proposed from names and types: "HDG" is a heading, "ldr_E" the leader's position east, "R1"
the range to the first transmitter; so are topics, by their names, types and fields.

A name is split into words. Words of the leader, of a transmitter and of a unit are taken out, and
what is left must be a word for a quantity. What remains in doubt is noted in the map.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from laisn.errors import LaisnError
from laisn.messages import Ranges
from sim.datasets.bag import BagTopic, topics_of
from sim.datasets.field_map import (
    LATITUDE,
    LONGITUDE,
    PRESSURES,
    QUATERNION,
    Proposal,
    missing_fields,
    units_of,
)
from sim.datasets.table_columns import FIELDS, TIME_NAMES, cells_of, quantity_of
from sim.log.ros2_encoding import LINK_RECEPTION_TYPE
from sim.log.schema import PLACES, RECEPTION

_LEADER_WORDS = {
    *("leader", "ldr", "lead", "mother", "mothership", "ship", "boat", "vessel", "asv", "usv"),
    *("master", "surface", "broadcast"),
}
_FILLER_WORDS = {
    *("own", "auv", "uuv", "follower", "vehicle", "self", "robot", "rov", "meas", "measured"),
    *("value", "data", "sensor", "msg", "message", "raw", "filtered", "acoustic"),
    *("true", "mag", "magnetic", "gyro", "dvl", "ctd", "modem", "through", "water", "to"),
}
"""Words that say nothing of the quantity."""
_RANGE_WORDS = {"range", "rng", "ranges", "r", "dist", "distance", "slant"}
_WORDS_OF_TRANSMITTERS: dict[str, tuple[str, ...]] = {
    "rear": ("rear", "aft", "stern", "back", "tail", "1", "a"),
    "front": ("front", "fore", "bow", "fwd", "forward", "nose", "2", "b"),
    "middle": ("middle", "mid", "center", "centre", "3", "c"),
}
"""Words for each transmitter; only those of `_CERTAIN_WORDS` need no check."""
_TRANSMITTER_WORDS = {"tx", "transmitter", "beacon", "transponder", "pinger", "source", "anchor"}
_CERTAIN_WORDS = {"rear", "aft", "stern", "front", "fore", "bow", "fwd", "middle", "mid"}
_QUANTITY_WORDS: dict[str, set[str]] = {
    "heading": {"heading", "hdg", "head", "compass", "psi", "yaw", "hding"},
    "speed": {"speed", "spd", "stw", "vel", "velocity", "surge", "u", "log"},
    "depth": {"depth", "dep", "dpth", "dpt", "d", "pressure", "press", "p"},
    "east": {"east", "e", "x", "easting", "lon", "longitude", "long"},
    "north": {"north", "n", "y", "northing", "lat", "latitude"},
    "pitch": {"pitch", "pit", "theta"},
    "roll": {"roll", "heel", "phi"},
    "timestamp": {"timestamp", "time", "t", "stamp", "clock", "sent", "toe", "utc", "datetime"},
}
# measurements of the own vehicle
_OWN_FIELDS = ("speed", "heading", "depth")
_ONLY_LEADER = ("east", "north", "pitch", "roll", "timestamp")
"""Quantities that the log has of the leader alone."""
_IN_DOUBT = {"yaw", "u", "vel", "velocity", "x", "y", "d", "p", "psi", "log", "pressure", "press"}
"""Words with several meanings."""
# question about a word in doubt; about others "is this right?"
_NOTES = {
    "yaw": 'is this a compass heading, or a yaw from east (angle = "yaw")?',
    "psi": 'is this a compass heading, or a yaw from east (angle = "yaw")?',
    "x": "is this east?",
    "y": "is this north?",
    "d": "is this the depth?",
}
_UNIT_WORDS: dict[str, tuple[str, ...]] = {
    "m/s": ("mps", "ms1"),
    "deg": ("deg", "degs", "degree", "degrees"),
    "rad": ("rad", "radians"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "cm": ("cm",),
    "mm": ("mm",),
    "cm/s": ("cmps", "cm_s"),
    "mm/s": ("mmps", "mm_s"),
    "km": ("km",),
    "ft": ("ft", "feet"),
    "kn": ("kn", "kts", "kt", "knots", "knot"),
    "km/h": ("kmh", "kph"),
    "s": ("s", "sec", "secs", "seconds"),
    "ms": ("ms", "msec", "millis"),
    "us": ("us", "usec"),
    "ns": ("ns", "nsec", "nanos"),
    **{unit: (unit.lower(),) for unit in PRESSURES},
}
_FLUID = "sensor_msgs/msg/FluidPressure"
_FIELDS_BY_TYPE: dict[str, tuple[tuple[str, str, str], ...]] = {
    "sensor_msgs/msg/Imu": (("heading", "orientation", QUATERNION),),
    _FLUID: (("depth", "fluid_pressure", "Pa"),),
    "geometry_msgs/msg/TwistStamped": (("speed", "twist.linear.x", "m/s"),),
    "geometry_msgs/msg/TwistWithCovarianceStamped": (("speed", "twist.twist.linear.x", "m/s"),),
    "sensor_msgs/msg/Range": (("range", "range", "m"),),
    "sensor_msgs/msg/NavSatFix": (
        ("leader_east", "longitude", LONGITUDE),
        ("leader_north", "latitude", LATITUDE),
    ),
}
"""Quantities of types: what they hold, in which field, in which unit."""
_ODOMETRY = "nav_msgs/msg/Odometry"
# types with a pose, and the field that holds it
_POSES = {
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
    _ODOMETRY: "pose.pose",
}
# topics of every bag that hold none
_NO_MEASUREMENTS = ("/tf", "/tf_static", "/clock", "/rosout", "/parameter_events")
_CONCLUSION_WORDS = {"truth", "ground", "groundtruth", "gt", "estimate", "estimated", "filtered"}
"""Words of topics that hold no measurements: estimates and ground truth."""
# words of fields that many types have beside their measurement
_BOILERPLATE_WORDS = {"header", "stamp", "sec", "nanosec", "covariance", "seq"}


_OWN_RECEPTION_RANK = -2  # of fields of receptions as this project writes them


class Match(NamedTuple):
    """What a name stands for."""

    field: str  # of the log, or "time"
    unit: str  # that the name states; "" for none
    note: str  # what its user should check; "" for nothing


def _words(name: str) -> list[str]:
    """Words of a name: "LdrE", "ldr_E" and "ldr.e" are two; digits are a word of their own."""
    split = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    split = re.sub(r"([A-Za-z])(\d)", r"\1 \2", split)
    return [word for word in re.split(r"[^a-z0-9]+", split.lower()) if word]


def _unit_of(text: str) -> str:
    """The unit that a text stands for; "" for none."""
    normalized = text.strip().lower().replace(" ", "")
    for unit, words in _UNIT_WORDS.items():
        if normalized == unit.lower() or normalized in words:
            return unit
    return {"°": "deg", "m_s": "m/s", "m·s-1": "m/s", "m*s-1": "m/s"}.get(normalized, "")


class _NameAndUnit(NamedTuple):
    """A name split into what is left without its unit, and the unit."""

    bare: str
    unit: str  # "" for none, or one that is not known
    note: str  # on brackets that hold no known unit


def _split_unit(name: str) -> _NameAndUnit:
    """A name and its unit, in brackets or at its end."""
    bracketed = re.fullmatch(r"(.*?)\s*[\[(]([^\])]*)[\])]\s*", name)
    if bracketed is not None:
        unit = _unit_of(bracketed[2])
        note = "" if unit else f"what unit is {bracketed[2]!r}?"
        return _NameAndUnit(bracketed[1], unit, note)
    for ending in (r"(.+)[_ ]([cm]?m_s)", r"(.+)[_ ]([A-Za-z]+)"):
        suffixed = re.fullmatch(ending, name)
        if suffixed is not None and _unit_of(suffixed[2]):
            return _NameAndUnit(suffixed[1], _unit_of(suffixed[2]), "")
    return _NameAndUnit(name, "", "")


def _transmitter_of(words: Sequence[str]) -> tuple[str, str]:
    """The transmitter that the first word for one stands for, and this word; "" for none."""
    for word in words:
        for transmitter, names in _WORDS_OF_TRANSMITTERS.items():
            if word in names:
                return transmitter, word
    return "", ""


def _quantity_of_word(word: str) -> str:
    """The quantity that a word stands for; "" for none."""
    return next((quantity for quantity, names in _QUANTITY_WORDS.items() if word in names), "")


def _range_match(words: Sequence[str], unit: str) -> Match | None:
    """The range to a transmitter; None if the words are not of one."""
    other_words = [
        word
        for word in words
        if word not in (_RANGE_WORDS | _FILLER_WORDS | _LEADER_WORDS | _TRANSMITTER_WORDS | {"to"})
    ]
    transmitter, word = _transmitter_of(other_words)
    others = [other for other in other_words if other != word]
    if others or len(other_words) > 1 or not _RANGE_WORDS & set(words):
        return None
    if not transmitter:
        return Match("range_rear", unit, "of which transmitter is this range?")
    note = "" if word in _CERTAIN_WORDS else f"is {word!r} the {transmitter} transmitter?"
    return Match(f"range_{transmitter}", unit, note)


def match(name: str, *, in_leader_topic: bool = False) -> Match | None:
    """What a name stands for; None if for nothing. `in_leader_topic`: the name is within a
    topic of the leader's.
    """
    bare, unit, note = _split_unit(name)
    words = _words(bare)
    if not words:
        return None
    leader = in_leader_topic or bool(_LEADER_WORDS & set(words))
    matched = _range_match(words, unit) or _quantity_match(words, unit, leader=leader)
    if matched is None or not note:
        return matched
    return matched._replace(note=" ".join(filter(None, [matched.note, note])))


def _quantity_match(words: Sequence[str], unit: str, *, leader: bool) -> Match | None:
    """A quantity of the own vehicle, of the leader, or a place of a transmitter."""
    other_words = [
        word for word in words if word not in (_LEADER_WORDS | _FILLER_WORDS | _TRANSMITTER_WORDS)
    ]
    transmitter, transmitter_word = _transmitter_of(other_words[:-1])
    other_words = [word for word in other_words if word != transmitter_word]
    # "compass heading" says one thing twice
    quantities = {_quantity_of_word(word) for word in other_words}
    if len(quantities) != 1:
        return None
    (quantity,) = quantities
    note = _doubt(other_words)
    unit = unit or _implied_unit(other_words[-1])
    if quantity == "speed" and transmitter_word in ("forward", "fwd"):
        transmitter = ""
    if transmitter:
        note = note or f"is {transmitter_word!r} the {transmitter} transmitter?"
        is_place = quantity in ("east", "north", "depth")
        return Match(f"{transmitter}_{quantity}", unit, note) if is_place else None
    field = f"leader_{quantity}" if leader and quantity else _own_field(quantity, other_words[-1])
    return Match(field, unit, note) if field else None


def _own_field(quantity: str, word: str) -> str:
    """The field of the own vehicle's quantity, whose last word is given; "" for none."""
    if quantity == "timestamp":
        return "time" if word in TIME_NAMES else ""
    return "" if quantity in _ONLY_LEADER else quantity


def _doubt(words: Sequence[str]) -> str:
    """A question about words that may have other meanings; "" if any of them has not."""
    if any(word not in _IN_DOUBT for word in words):
        return ""
    return _NOTES.get(words[-1], "is this right?")


def _implied_unit(word: str) -> str:
    if word in ("lon", "longitude", "long"):
        return LONGITUDE
    if word in ("lat", "latitude"):
        return LATITUDE
    return ""


def _order_of_field(field: str) -> int:
    return ("time", *FIELDS).index(field)


def propose_for_table(path: Path) -> Proposal:
    """A map of a text table; LaisnError if it cannot be read."""
    headers, rows = cells_of(path)
    entries: dict[str, dict[str, Any]] = {}
    notes = dict[str, str]()
    unused = list[str]()
    for i, header in enumerate(headers):
        matched = match(header)
        has_numbers = any(_is_number(row[i]) for row in rows[:100])
        if matched is None or not (has_numbers or matched.field == "time"):
            unused.append(header)
            continue
        if matched.field in entries:
            first = entries[matched.field]["column"]
            notes[matched.field] = f"{first!r} or {header!r}?"
            unused.append(header)
            continue
        entries[matched.field] = {"column": header}
        if matched.unit in units_of(matched.field):
            entries[matched.field]["unit"] = matched.unit
        if matched.note:
            notes[matched.field] = f"{header!r}: {matched.note}"
    ordered = dict(sorted(entries.items(), key=lambda item: _order_of_field(item[0])))
    return Proposal(
        source=str(path),
        settings={},
        entries=ordered,
        notes=notes,
        missing=missing_fields(entries, ["time"]),
        unused=tuple(unused),
    )


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


class _Candidate(NamedTuple):
    """A field of a topic that may hold a field of the log."""

    field: str  # of the log
    rank: int  # the lower, the better
    entry: dict[str, Any]  # table of the map
    note: str  # what its user should check; "" for nothing


def _is_of_leader(topic: BagTopic, own: str) -> bool:
    """Whether a topic is the leader's by its name; none is that begins with `own`, the namespace of
    the vehicle that navigates, if that is known.
    """
    is_own = bool(own) and topic.name.startswith(own)
    return not is_own and bool(_LEADER_WORDS & set(_words(topic.name)))


def _candidates_by_type(topic: BagTopic, *, leader: bool) -> Iterator[_Candidate]:
    """What a topic of a standard type holds."""
    for quantity, field, unit in _FIELDS_BY_TYPE.get(topic.type_name, ()):
        entry: dict[str, Any] = {"topic": topic.name, "field": field, "unit": unit}
        if quantity == "range":
            yield from _range_candidates(topic, entry)
        elif quantity.startswith("leader_"):
            note = "" if leader else "is this topic the leader's?"
            # `hold`: a reception takes the last position before it, and interpolates none
            yield _Candidate(quantity, 1, entry | {"hold": True}, note)
        else:
            field_of_log = f"leader_{quantity}" if leader else quantity
            yield _Candidate(field_of_log, 0, entry, "")
    if topic.type_name in _POSES:
        yield from _pose_candidates(topic, _POSES[topic.type_name], leader=leader)


def _pose_candidates(topic: BagTopic, pose: str, *, leader: bool) -> Iterator[_Candidate]:
    """Position, attitude and speed of a vehicle; those of the own vehicle are no measurements, but
    for its heading and speed where nothing else has them.
    """
    base = {"topic": topic.name}
    orientation = base | {"field": f"{pose}.orientation", "unit": QUATERNION}
    speed = base | {"field": "twist.twist.linear.x", "unit": "m/s"}
    if not leader:
        note = "this topic may hold an estimate in place of a measurement"
        yield _Candidate("heading", 3, orientation, note)
        if topic.type_name == _ODOMETRY:
            yield _Candidate("speed", 3, speed, note)
        return
    yield _Candidate("leader_east", 0, _position_entry(topic, "x", 1.0), "")
    yield _Candidate("leader_north", 0, _position_entry(topic, "y", 1.0), "")
    yield _Candidate("leader_depth", 0, _position_entry(topic, "z", -1.0), "")
    yield _Candidate("leader_heading", 0, orientation, "")
    if topic.type_name == _ODOMETRY:
        yield _Candidate("leader_speed", 0, speed, "")


def _range_candidates(topic: BagTopic, entry: dict[str, Any]) -> Iterator[_Candidate]:
    """Ranges by the name of the topic, or by frames where one topic has those of several."""
    frames = topic.texts.get("header.frame_id", ())
    if len(frames) > 1:
        transmitters = dict.fromkeys(Ranges._fields, "")
        for frame in frames:
            named, word = _transmitter_of(_words(frame))
            is_free = bool(named) and not transmitters[named]
            transmitter = (
                named if is_free else next((s for s in transmitters if not transmitters[s]), "")
            )
            if transmitter:
                transmitters[transmitter] = frame
                is_certain = is_free and word in _CERTAIN_WORDS
                note = "" if is_certain else f"is {frame!r} the {transmitter} transmitter?"
                where = {"where": {"header.frame_id": frame}}
                yield _Candidate(f"range_{transmitter}", 0, entry | where, note)
        return
    transmitter, word = _transmitter_of(_words(topic.name)[::-1])
    note = "" if word in _CERTAIN_WORDS else f"of which transmitter is {topic.name}?"
    yield _Candidate(f"range_{transmitter or 'rear'}", 0 if transmitter else 2, entry, note)


def _candidates_by_name(topic: BagTopic, *, leader: bool) -> Iterator[_Candidate]:
    """What fields of a topic of another type hold, by their names and that of the topic."""
    has_several_fields = sum(match(field) is not None for field in topic.fields) > 2
    for field in topic.fields:
        words = _words(field)
        if _BOILERPLATE_WORDS & set(words):
            continue
        # a message with many fields names them; one with a number alone is named by its topic
        name = field if words[-1:] != ["data"] else topic.name.rpartition("/")[2]
        matched = match(name.rpartition(".")[2], in_leader_topic=leader)
        if matched is None or matched.field == "time":
            continue
        entry: dict[str, Any] = {"topic": topic.name, "field": field}
        if matched.unit in units_of(matched.field):
            entry["unit"] = matched.unit
        note = matched.note
        if not matched.unit and matched.field.endswith(("heading", "pitch", "roll")):
            note = note or 'is this in radians? unit = "deg" otherwise'
        yield _Candidate(matched.field, -1 if has_several_fields else 1, entry, note)


def _own_reception_candidates(topic: BagTopic) -> Iterator[_Candidate]:
    """Fields of a reception as this project writes it, which need no check."""
    for field in (*RECEPTION.fields, *(name for name in PLACES.names if name in topic.fields)):
        entry = {"topic": topic.name, "field": field, "unit": quantity_of(field).si}
        yield _Candidate(field, _OWN_RECEPTION_RANK, entry, "")


def _is_own_reception(topic: BagTopic) -> bool:
    """Whether a topic has receptions as this project writes them."""
    return set(RECEPTION.fields) <= set(topic.fields)


def _heard_on_navigated_links(topics: Sequence[BagTopic], own: str) -> list[BagTopic]:
    """Topics without receptions of further links, as this project writes them, and without those
    of the leader, if another vehicle has some, too.
    """
    kept = [topic for topic in topics if topic.type_name != LINK_RECEPTION_TYPE]
    by_leader = [topic for topic in kept if _is_own_reception(topic) and _is_of_leader(topic, own)]
    if not any(_is_own_reception(topic) for topic in kept if topic not in by_leader):
        return kept
    return [topic for topic in kept if topic not in by_leader]


def _candidates_of(topic: BagTopic, own: str) -> Iterator[_Candidate]:
    if _is_own_reception(topic):
        return _own_reception_candidates(topic)
    leader = _is_of_leader(topic, own)
    is_typed = topic.type_name in _FIELDS_BY_TYPE or topic.type_name in _POSES
    candidates = _candidates_by_type if is_typed else _candidates_by_name
    return candidates(topic, leader=leader)


def _candidates(topics: Sequence[BagTopic], own: str) -> Iterator[_Candidate]:
    for topic in topics:
        if topic.name in _NO_MEASUREMENTS or not topic.messages:
            continue
        is_conclusion = bool(_CONCLUSION_WORDS & set(_words(topic.name)))
        for candidate in _candidates_of(topic, own):
            # the leader's estimate of itself is what it broadcasts
            rank = candidate.rank + (10 if is_conclusion else 0)
            if is_conclusion and not candidate.field.startswith("leader_"):
                continue
            yield candidate._replace(rank=rank)


def _other_robots(
    topics: Sequence[BagTopic], entries: Mapping[str, Mapping[str, Any]]
) -> Iterator[_Candidate]:
    """Places of other robots to which there are ranges: the pose that is in the namespace of a
    robot whose name is in the range's frame or topic.
    """
    own_namespaces = {
        str(entries[name]["topic"]).split("/")[1] for name in _OWN_FIELDS if name in entries
    }
    poses = {
        topic.name.split("/")[1].lower(): topic
        for topic in topics
        if topic.type_name in _POSES and topic.name.count("/") > 1 and topic.messages
    }
    poses_of_others = list[BagTopic]()
    for transmitter in Ranges._fields:
        entry = entries.get(f"range_{transmitter}")
        if entry is None:
            continue
        name_parts = [*entry.get("where", {}).values(), *str(entry["topic"]).split("/")[2:]]
        names = (str(word).lower() for word in name_parts)
        name = next((name for name in names if name in poses), None)
        if name is None or name in own_namespaces:
            continue
        topic = poses[name]
        poses_of_others.append(topic)
        note = f"is {topic.name} where the {transmitter} transmitter is?"
        for axis, letter, factor in (("east", "x", 1.0), ("north", "y", 1.0), ("depth", "z", -1.0)):
            yield _Candidate(
                f"{transmitter}_{axis}", 0, _position_entry(topic, letter, factor), note
            )
    if poses_of_others:
        yield from _pose_candidates(
            poses_of_others[0], _POSES[poses_of_others[0].type_name], leader=True
        )


def _position_entry(topic: BagTopic, letter: str, factor: float) -> dict[str, Any]:
    field = f"{_POSES[topic.type_name]}.position.{letter}"
    entry: dict[str, Any] = {"topic": topic.name, "field": field, "unit": "m"}
    return entry if factor == 1.0 else entry | {"factor": factor}


def _namespace(vehicle: str | None) -> str:
    """How the topics of a vehicle begin; "" if none is named."""
    return "" if vehicle is None else f"/{vehicle.strip('/')}/"


def _topics_of_vehicle(topics: Sequence[BagTopic], vehicle: str | None) -> list[BagTopic]:
    """Topics of a vehicle and of the leader; LaisnError if the bag has none of this vehicle."""
    if vehicle is None:
        return [*topics]
    prefix = _namespace(vehicle)
    vehicle_topics = [topic for topic in topics if topic.name.startswith(prefix)]
    if not vehicle_topics:
        namespaces = sorted(
            {topic.name.split("/")[1] for topic in topics if topic.name.count("/") > 1}
        )
        raise LaisnError(
            f"--vehicle {vehicle}: the bag has no topic {prefix}…; it has those of "
            f"{', '.join(namespaces) or 'no vehicle'}"
        )
    return vehicle_topics + [
        topic
        for topic in topics
        if topic not in vehicle_topics and _LEADER_WORDS & set(_words(topic.name))
    ]


def _rivals_note(candidates: Sequence[_Candidate]) -> str:
    """A question that names other topics that may hold the same field equally well; "" for none."""
    best = candidates[0]
    equals = [c for c in candidates[1:] if c.rank == best.rank]
    if not equals:
        return ""
    names = ", ".join(f"{c.entry['topic']} {c.entry['field']}" for c in equals[:3])
    return f"or is it {names}?"


def _of_one_reception(by_field: dict[str, list[_Candidate]]) -> dict[str, list[_Candidate]]:
    """Candidates without places of transmitters that another vehicle's reception holds than that
    with the ranges.
    """
    ranges = by_field.get(f"range_{Ranges._fields[0]}", [])
    chosen = min(ranges, key=lambda candidate: candidate.rank, default=None)
    if chosen is None or chosen.rank != _OWN_RECEPTION_RANK:
        return by_field
    kept = {}
    for field, candidates in by_field.items():
        here = [c for c in candidates if c.entry["topic"] == chosen.entry["topic"]]
        kept[field] = here if field in PLACES.names else candidates
    return {field: candidates for field, candidates in kept.items() if candidates}


def propose_for_bag(path: Path, vehicle: str | None = None) -> Proposal:
    """A map of a bag; `vehicle` is the beginning of the topics of the vehicle that navigates.

    LaisnError if the bag cannot be read, or has no topics of the vehicle.
    """
    topics = _topics_of_vehicle(topics_of(path), vehicle)
    by_field: dict[str, list[_Candidate]] = {}
    own = _namespace(vehicle)
    for candidate in _candidates(_heard_on_navigated_links(topics, own), own):
        by_field.setdefault(candidate.field, []).append(candidate)
    by_field = _of_one_reception(by_field)
    chosen = {
        field: sorted(by_field[field], key=lambda candidate: candidate.rank)
        for field in sorted(by_field, key=_order_of_field)
    }
    for candidate in _other_robots(topics, {field: c[0].entry for field, c in chosen.items()}):
        chosen.setdefault(candidate.field, [candidate])
    entries: dict[str, Mapping[str, Any]] = {}
    notes = dict[str, str]()
    for field in sorted(chosen, key=_order_of_field):
        candidates = chosen[field]
        entries[field] = candidates[0].entry
        note = " ".join(filter(None, [candidates[0].note, _rivals_note(candidates)]))
        if note:
            notes[field] = note
    used_topics = {entry["topic"] for entry in entries.values()}
    return Proposal(
        source=str(path),
        settings={},
        entries=entries,
        notes=notes,
        missing=missing_fields(entries),
        unused=tuple(f"{t.name} ({t.type_name})" for t in topics if t.name not in used_topics),
    )
