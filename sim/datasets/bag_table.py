"""A bag and its map as the table of a vehicle's measurements.

The messages of one topic are the filter steps. Own measurements of other topics are interpolated
to them, angles the short way, but not over gaps; depth is absent there. Ranges of different
transmitters that come within a window are one reception, at the last of them. What the leader
broadcasts is of the same message, or of another topic, whose values are interpolated to that time,
or held.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from sim.datasets.bag import Request, Series, series_of
from sim.datasets.field_map import (
    LATITUDE,
    LONGITUDE,
    QUATERNION,
    FieldEntry,
    FieldMap,
    GeodeticOrigin,
    require_complete,
)
from sim.datasets.interpolation import interpolated
from sim.datasets.table_columns import ANGLE, quantity_of, require_depths
from sim.datasets.vehicle_table import VehicleTable
from sim.log.clock import TIMESTAMP
from sim.log.schema import OWN_MOTION


@dataclass(frozen=True, kw_only=True)
class _Mapped:
    """Values of all fields of a map, in SI units."""

    path: Path
    map_path: Path
    entries: Mapping[str, FieldEntry]
    series: Mapping[str, Series]  # of fields with a topic
    constants: Mapping[str, float]  # of fields with a value

    def values_at(self, field: str, time_ns: Ints) -> Floats:
        """Values of a field at times, shape (n,); NaN where there is none."""
        entry = self.entries[field]
        if field in self.constants:
            return np.full(time_ns.size, self.constants[field])
        series = self.series[field]
        if entry.hold:
            return _last_value(series, time_ns)
        is_angle = quantity_of(field) is ANGLE
        values = _interpolated(series, time_ns, is_angle=is_angle)
        if is_angle and not field.endswith("heading"):
            # pitch and roll have signs; only headings count to a whole turn
            values = np.where(values > np.pi, values - 2.0 * np.pi, values)
        return values


def _last_value(series: Series, time_ns: Ints) -> Floats:
    """The last value at or before each time."""
    index = np.searchsorted(series.time_ns, time_ns, side="right") - 1
    values = np.full(time_ns.size, np.nan)
    has_value = index >= 0
    values[has_value] = series.values[index[has_value]]
    return values


def _leader_times(mapped: _Mapped, heard_ns: Ints) -> Floats:
    """Times at which the leader was where a reception says it was [ns], for maps without its
    clock: of the held message, or of the reception itself.
    """
    series = mapped.series.get("leader_east")
    if series is None or not mapped.entries["leader_east"].hold:
        return heard_ns.astype(np.float64)
    times = Series(time_ns=series.time_ns, values=series.time_ns.astype(np.float64))
    return _last_value(times, heard_ns)


def _interpolated(series: Series, time_ns: Ints, *, is_angle: bool) -> Floats:
    """Values between messages; NaN outside of them and within gaps."""
    return interpolated(series.time_ns, series.values, time_ns, is_angle=is_angle)


def _origin(
    field_map: FieldMap, raw_series: Mapping[str, Series]
) -> tuple[GeodeticOrigin | None, list[str]]:
    """The map's origin, or else the first place of the leader, which a remark names."""
    if field_map.settings.origin is not None:
        return field_map.settings.origin, []
    first = dict[str, float]()
    for field, entry in field_map.entries.items():
        if entry.unit not in (LATITUDE, LONGITUDE):
            continue
        values = np.array([entry.value]) if field not in raw_series else raw_series[field].values
        finite = values[np.isfinite(values)]
        if finite.size:
            first.setdefault(entry.unit, float(finite[0]))
    if len(first) < 2:
        return None, []
    origin = GeodeticOrigin(latitude_deg=first[LATITUDE], longitude_deg=first[LONGITUDE])
    return origin, [
        f"east and north count from the first place, {origin.latitude_deg:.7f}°, "
        f"{origin.longitude_deg:.7f}°; [origin] of the map sets another"
    ]


def _read(path: Path, field_map: FieldMap) -> tuple[_Mapped, list[str]]:
    """Values of all fields of a map from a bag, and remarks; LaisnError if a topic, field or unit
    does not fit.
    """
    requests = dict[str, Request]()
    for field, entry in field_map.entries.items():
        if entry.column is not None:
            raise LaisnError(
                f"{field_map.path}: {field}: names a column, and {path} is a bag; expected topic "
                "and field"
            )
        if entry.topic is not None and entry.field is not None:
            where = tuple(sorted(entry.where.items()))
            requests[field] = Request(entry.topic, entry.field, where)
    contents = series_of(path, [*dict.fromkeys(requests.values())], field_map.settings.stamps)
    raw_series = {field: contents.series[request] for field, request in requests.items()}
    origin, remarks = _origin(field_map, raw_series)
    remarks = [*contents.remarks, *remarks]
    series = dict[str, Series]()
    for field, raw in raw_series.items():
        entry = field_map.entries[field]
        if not raw.time_ns.size:
            raise LaisnError(
                f"{field_map.path}: {field}: no message of {entry.topic} in {path}"
                f"{' has these values' if entry.where else ''}"
            )
        if (raw.values.ndim == 2) != (entry.unit == QUATERNION):
            raise LaisnError(
                f"{field_map.path}: {field}: unit {entry.unit!r} does not fit the field "
                f"{entry.field} of {entry.topic}; an orientation has the unit 'quaternion', and "
                "only that"
            )
        try:
            values = entry.in_si(raw.values, field, origin)
        except ValueError as error:
            raise LaisnError(f"{field_map.path}: {field}: {error}") from None
        remarks += _remarks_of_missing(field_map.path, field, entry, values)
        series[field] = Series(time_ns=raw.time_ns, values=values)
        unit = entry.unit or "SI units"
        remarks.append(f"{field}: {entry.topic} {entry.field} in {unit}, {raw.time_ns.size} times")
        remarks += _order_remarks(str(entry.topic), raw)
    constants = dict[str, float]()
    for field, entry in field_map.entries.items():
        if entry.value is None:
            continue
        try:
            constants[field] = entry.constant(field, origin)
        except ValueError as error:
            raise LaisnError(f"{field_map.path}: {field}: {error}") from None
    series |= _derived(field_map, series)
    remarks = list(dict.fromkeys(remarks))
    return _Mapped(
        path=path,
        map_path=field_map.path,
        entries=field_map.entries,
        series=series,
        constants=constants,
    ), remarks


def _remarks_of_missing(map_path: Path, field: str, entry: FieldEntry, values: Floats) -> list[str]:
    """How many messages have no value where each should have one; LaisnError if none has an
    orientation or a position.
    """
    missing = int(np.count_nonzero(np.isnan(values)))
    if missing == 0:
        return []
    if entry.unit == QUATERNION:
        thing = "an orientation"
        reason = "its numbers are 0, or its covariance begins with -1"
    elif entry.unit in (LATITUDE, LONGITUDE):
        thing = "a position"
        reason = "it is NaN, or its status says that there was no fix"
    elif field.startswith("range_"):
        return [f"{missing} messages of {entry.topic} without a range within its limits left out"]
    else:
        # of other fields NaN says that they are not broadcast
        return []
    if missing == values.size:
        others = (
            "topic or value, or derive = true" if field == "leader_heading" else "topic or value"
        )
        raise LaisnError(
            f"{map_path}: {field}: {entry.field} of {entry.topic} is {thing} in none of its "
            f"{missing} messages: {reason}; expected another {others}"
        )
    return [f"{missing} messages of {entry.topic} without {thing} left out"]


def _order_remarks(topic: str, series: Series) -> list[str]:
    """What is not as expected of the times of a topic."""
    remarks = [f"{topic}: {remark}" for remark in series.remarks]
    if series.steps_back:
        remarks.append(
            f"{topic}: {series.steps_back} messages later than others with later times, sorted; "
            'stamps = "log" takes the times of recording'
        )
    if series.repeated:
        remarks.append(f"{topic}: {series.repeated} messages at the time of another left out")
    return remarks


def _derived(field_map: FieldMap, series: Mapping[str, Series]) -> dict[str, Series]:
    """Heading and speed of the leader from its positions, for fields with `derive`."""
    fields = [field for field, entry in field_map.entries.items() if entry.derive]
    if not fields:
        return {}
    east = series.get("leader_east")
    north = series.get("leader_north")
    if east is None or north is None or east.time_ns.size < 2:
        raise LaisnError(
            f"{field_map.path}: {fields[0]}.derive: leader_east and leader_north need topics with "
            "two messages at least"
        )
    northward = _interpolated(north, east.time_ns, is_angle=False)
    is_known = np.isfinite(east.values) & np.isfinite(northward)
    if np.count_nonzero(is_known) < 2:
        raise LaisnError(
            f"{field_map.path}: {fields[0]}.derive: leader_east and leader_north are known at the "
            "same time at less than two messages"
        )
    time_ns = east.time_ns[is_known]
    positions = np.column_stack([east.values, northward])[is_known]
    velocity = np.gradient(positions, (time_ns - time_ns[0]) / 1e9, axis=0)
    values = {
        "leader_heading": np.mod(np.arctan2(velocity[:, 0], velocity[:, 1]), 2.0 * np.pi),
        "leader_speed": np.hypot(velocity[:, 0], velocity[:, 1]),
    }
    return {field: Series(time_ns=time_ns, values=values[field]) for field in fields}


def _receptions(mapped: _Mapped, fields: list[str], window_s: float) -> tuple[Ints, Floats]:
    """Times of receptions [ns] and their ranges in the order of the fields, one for each
    transmitter, NaN where there is none, shapes (m,) and (m, r).
    """
    ranges_received = list[tuple[int, int, float]]()
    for field_index, field in enumerate(fields):
        series = mapped.series.get(field)
        if series is None:
            raise LaisnError(f"{mapped.map_path}: {field}: expected topic and field, no constant")
        positive = np.isfinite(series.values) & (series.values > 0.0)
        times = series.time_ns[positive].tolist()
        ranges_received += [
            (time_ns, field_index, value)
            for time_ns, value in zip(times, series.values[positive], strict=True)
        ]
    ranges_received.sort(key=lambda entry: entry[:2])
    times_ns = list[int]()
    rows = list[list[float]]()
    first_range_ns = 0
    for reception_ns, field_index, value in ranges_received:
        is_new = (
            not rows
            or reception_ns - first_range_ns > 1e9 * window_s
            or np.isfinite(rows[-1][field_index])
        )
        if is_new:
            first_range_ns = reception_ns
            times_ns.append(reception_ns)
            rows.append([np.nan] * len(fields))
        rows[-1][field_index] = value
        times_ns[-1] = reception_ns
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(fields))
    return np.array(times_ns, dtype=np.int64), table


def _step_times(mapped: _Mapped, step_topic: str | None) -> tuple[Ints, str]:
    """Times of the filter steps [ns], and their topic."""
    times_by_topic = dict[str, Ints]()
    for field in OWN_MOTION.fields:
        source = mapped.entries[field].topic
        if source is not None:
            times_by_topic.setdefault(source, mapped.series[field].time_ns)
    if not times_by_topic:
        raise LaisnError(
            f"{mapped.map_path}: speed, heading and depth are constants; one of them needs a topic"
        )
    topic = step_topic or next(iter(times_by_topic))
    if topic not in times_by_topic:
        topics = ", ".join(map(str, times_by_topic))
        raise LaisnError(
            f"{mapped.map_path}: steps: expected the topic of speed, heading or depth: {topics} "
            f"(given: {topic!r})"
        )
    return times_by_topic[topic], topic


def read_bag_table(path: Path, field_map: FieldMap) -> VehicleTable:
    """Measurements in a bag, as a map tells.

    LaisnError: the bag cannot be read, the map lacks a field that the navigator needs, or names a
    topic, field or unit that is not there.
    """
    require_complete(field_map)
    mapped, remarks = _read(path, field_map)
    steps_ns, step_topic = _step_times(mapped, field_map.settings.steps)
    own_motion = {field: mapped.values_at(field, steps_ns) for field in OWN_MOTION.fields}
    range_fields = [field for field in field_map.entries if field.startswith("range_")]
    heard_ns, ranges = _receptions(mapped, range_fields, field_map.settings.ping_window_s)
    others = [
        field
        for field in field_map.entries
        if field not in (*OWN_MOTION.fields, *range_fields, "time")
    ]
    received = {field: mapped.values_at(field, heard_ns) for field in others}
    received |= {field: ranges[:, i] for i, field in enumerate(range_fields)}
    received.setdefault(TIMESTAMP, _leader_times(mapped, heard_ns) / 1e9)
    # depth may be silent for a while: navigators take the last reading
    is_complete = np.isfinite(own_motion["speed"]) & np.isfinite(own_motion["heading"])
    if not np.any(is_complete & np.isfinite(own_motion["depth"])):
        raise LaisnError(
            f"{path}: at no message of {step_topic} there are speed, heading and depth at once; do "
            'the topics overlap in time? stamps = "log" takes the times of recording'
        )
    for name, values in (own_motion | received).items():
        if "depth" in name:
            require_depths(f"{path}, {name}", values)
    own_depth = own_motion["depth"][is_complete]
    silent = int(np.count_nonzero(np.isnan(own_depth)))
    left_out = int(np.count_nonzero(~is_complete))
    if left_out:
        remarks.append(f"{left_out} messages of {step_topic} outside of the other topics left out")
    if silent:
        remarks.append(f"{silent} filter steps without depth: the last one counts")
    remarks.append(f"filter steps: {int(is_complete.sum())} messages of {step_topic}")
    remarks.append(f"receptions: {heard_ns.size}, of {np.isfinite(ranges).sum()} ranges")
    time_ns = np.concatenate([steps_ns[is_complete], heard_ns])
    no_own_motion = np.full(heard_ns.size, np.nan)
    no_reception = np.full(int(is_complete.sum()), np.nan)
    columns = {
        field: np.concatenate([values[is_complete], no_own_motion])
        for field, values in own_motion.items()
    }
    columns |= {field: np.concatenate([no_reception, values]) for field, values in received.items()}
    order = np.argsort(time_ns, kind="stable")
    return VehicleTable(
        time_ns=time_ns[order],
        reception_ns=time_ns[order],
        columns={field: values[order] for field, values in columns.items()},
        remarks=tuple(remarks),
    )
