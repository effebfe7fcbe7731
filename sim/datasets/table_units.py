"""The units of a vehicle's table, decided once for all columns of a quantity: by their headers, and
where these state none by physics.

A choice of units gives every bare column, one without a unit in its header, a unit. It is refuted
where the leader's course over ground, its way at its speed, its clock, or the vehicle's ranges
along its own course fit another choice far better. Steps of the clock and gaps, which would change
the way at a speed, are left out of what is compared. What then remains open is settled by the
header of another column of the quantity, or by what is usual; otherwise the table is refused with
the header that would settle it. So is a table that fits only if columns without a unit were in one
that was not considered: speeds in km/h, lengths in feet.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.messages import Ranges
from sim.datasets.range_data import LARGEST_NUMBER
from sim.datasets.table_columns import (
    ANGLE,
    LENGTH,
    QUANTITIES,
    SPEED,
    TIME,
    Column,
    Columns,
    Quantity,
)
from sim.log.clock import TIMESTAMP

_LARGEST_ANGLE = 4.0 * math.pi  # no angle in radians is larger [rad]
_SMALL_ANGLE = math.radians(1.0)
"""Angles below this as radians are below 1 degree either way, and the unit hardly matters [rad]."""
# times since 1970 of the years 2000 to 2100 [s]
_FIRST_DATE_S = 946_684_800.0
_LAST_DATE_S = 4_102_444_800.0
# intervals between rows that are usual [s]
_USUAL_MIN_INTERVAL_S = 2e-3
_USUAL_MAX_INTERVAL_S = 60.0
# intervals between rows that are possible [s]
_MIN_INTERVAL_S = 1e-5
_MAX_INTERVAL_S = 900.0
_SEGMENT_M = 2.0  # length of the way of the leader that gives a course
# a leader that went less, or was slower in the median, hardly moves
_MIN_DISTANCE_M = 5.0
_MIN_SPEED_M_S = 0.05
_MIN_OBSERVATIONS = 4  # fewest courses, or ranges beyond the two unknowns
_MAX_RANGES = 200  # that the start is fitted to
_ITERATIONS = 12  # of Gauss–Newton for the start
_TIMES_WORSE = 3.0  # an error that is so many times another, and a margin, is far worse
_SPEED_MARGIN = 0.3  # of the logarithm of `_distance_ratio`
# longer intervals between rows, of which so many at most, are steps of the clock or gaps [median
# intervals]
_MIN_STEP_INTERVALS = 10.0
_MAX_STEPS = 20
_MIN_FACTOR = 2.5
"""Between units that motion tells from each other; a current may double a speed."""

UnitChoice = dict[str, str]
"""The unit chosen for each quantity with bare columns, by the quantity's name."""


@dataclass(frozen=True)
class Trial:
    """A table in SI units, as one choice of units has it."""

    time: Floats  # since the first row, shape (n,), [s]
    stretch: Ints  # between which steps of the clock in each row, shape (n,), from 0 on
    columns: Mapping[str, Floats]  # by field, shape (n,)
    timestamp: Floats | None  # the leader's, where a header states its unit [s]


def _course_error(trial: Trial) -> float:
    """Upper quartile of differences between the leader's heading and its course over ground [rad];
    NaN if it hardly moves.
    """
    leader = np.column_stack(
        [trial.columns[f"leader_{name}"] for name in ("east", "north", "heading")]
    )
    leader = leader[np.isfinite(leader).all(axis=1)]
    errors = list[float]()
    last = 0
    for k in range(1, len(leader)):
        east, north = leader[k, :2] - leader[last, :2]
        if math.hypot(east, north) < _SEGMENT_M:
            continue
        headings = leader[last : k + 1, 2]
        heading = math.atan2(np.sin(headings).mean(), np.cos(headings).mean())
        errors.append(abs(math.remainder(math.atan2(east, north) - heading, 2.0 * math.pi)))
        last = k
    # on one of two courses, radians and degrees may look alike
    return float(np.quantile(errors, 0.75)) if len(errors) >= _MIN_OBSERVATIONS else math.nan


def _distance_ratio(trial: Trial) -> float:
    """Distance along the leader's positions over the integral of its speed, both within stretches;
    NaN if it hardly moves.
    """
    names = ("leader_east", "leader_north", "leader_speed")
    leader = np.column_stack([trial.time, *(trial.columns[name] for name in names)])
    valid = np.isfinite(leader).all(axis=1)
    leader = leader[valid]
    if len(leader) < 3:
        return math.nan
    is_within = np.diff(trial.stretch[valid]) == 0
    travelled = float(np.hypot(*np.diff(leader[:, 1:3], axis=0).T)[is_within].sum())
    # times out of order must not shorten the distance
    spans = np.maximum(np.diff(leader[:, 0]), 0.0)
    speed = np.abs(leader[:, 3])
    distance_at_speed = float(np.sum((0.5 * (speed[1:] + speed[:-1]) * spans)[is_within]))
    is_slow = np.median(speed) < _MIN_SPEED_M_S
    if travelled < _MIN_DISTANCE_M or is_slow or distance_at_speed <= 0.0:
        return math.nan
    return travelled / distance_at_speed


def _speed_error(trial: Trial) -> float:
    """Logarithm of `_distance_ratio`, absolute; NaN if the leader hardly moves."""
    return abs(math.log(_distance_ratio(trial)))


def _clock_error(trial: Trial) -> float:
    """Logarithm of the intervals of messages over those on the leader's clock, absolute; NaN
    without it.
    """
    if trial.timestamp is None:
        return math.nan
    ratio = tick_ratio(trial.timestamp, trial.time)
    return math.nan if ratio is None else abs(math.log(ratio))


def _horizontal_ranges(trial: Trial) -> tuple[Floats, Floats, Floats]:
    """Rows of the table, places of transmitters (east, north) and horizontal ranges to them, of at
    most `_MAX_RANGES` slant ranges, evenly chosen; shapes (m,), (m, 2), (m,), in order of rows.
    """
    leader = np.column_stack([trial.columns["leader_east"], trial.columns["leader_north"]])
    depth = trial.columns["depth"]
    valid = np.flatnonzero(np.isfinite(depth))
    rows = np.arange(depth.size)
    own_depth = np.interp(rows, valid, depth[valid]) if valid.size else np.zeros(depth.size)
    parts = list[Floats]()
    for name in Ranges._fields:
        ranges = trial.columns.get(f"range_{name}")
        if ranges is None:
            continue
        site = [trial.columns.get(f"{name}_{axis}") for axis in ("east", "north", "depth")]
        east, north, source_depth = (
            fallback if values is None else values
            for values, fallback in zip(
                site, (*leader.T, trial.columns["leader_depth"]), strict=True
            )
        )
        horizontal = np.sqrt(np.maximum(ranges**2 - (source_depth - own_depth) ** 2, 0.0))
        parts.append(np.column_stack([rows, east, north, horizontal]))
    table = np.concatenate(parts)
    table = table[np.isfinite(table).all(axis=1) & (table[:, 3] > 0.0)]
    table = table[np.argsort(table[:, 0], kind="stable")]
    table = table[:: max(1, math.ceil(len(table) / _MAX_RANGES))]
    return table[:, 0], table[:, 1:3], table[:, 3]


def _dead_reckoning(trial: Trial) -> Floats:
    """Way of the vehicle since the first row by its own speed and heading, shape (n, 2), [m]; it
    rests from stretch to stretch.
    """
    motion = np.column_stack([trial.columns["speed"], trial.columns["heading"]])
    rows = np.arange(len(motion))
    valid = np.flatnonzero(np.isfinite(motion).all(axis=1))
    if not valid.size:
        return np.zeros((len(motion), 2))
    speed, heading = motion[valid].T
    velocity = np.column_stack([speed * np.sin(heading), speed * np.cos(heading)])
    spans = np.maximum(np.diff(trial.time[valid], prepend=trial.time[valid[0]]), 0.0)
    spans[1:][np.diff(trial.stretch[valid]) != 0] = 0.0
    way = np.cumsum(velocity * spans[:, None], axis=0)
    return np.column_stack([np.interp(rows, valid, way[:, axis]) for axis in range(2)])


def _start_residuals(offsets: Floats, ranges: Floats) -> Floats:
    """Residuals, absolute, of horizontal ranges to transmitters from the start that fits them best;
    shape (m,), [m].

    `offsets`, shape (m, 2), [m]: places of transmitters less the vehicle's way since the start.
    """
    # the start lies on a circle about the first place; Gauss–Newton refines eight starts
    angles = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    starts = offsets[0] + ranges[0] * directions
    for _ in range(_ITERATIONS):
        arms = starts[:, None] - offsets
        lengths = np.maximum(np.linalg.norm(arms, axis=2), 1e-9)
        slopes = arms / lengths[..., None]
        residuals = ranges - lengths
        # residuals beyond three medians count as if they were three medians
        limit = 3.0 * np.median(np.abs(residuals), axis=1, keepdims=True) + 1e-9
        weights = np.minimum(1.0, limit / np.maximum(np.abs(residuals), 1e-12))
        # s: start, m: range, i, j: east, north
        normal = np.einsum("smi,sm,smj->sij", slopes, weights, slopes) + 1e-6 * np.eye(2)
        gradient = np.einsum("smi,sm,sm->si", slopes, weights, residuals)
        starts = starts + np.linalg.solve(normal, gradient[..., None])[..., 0]
    residuals = np.abs(ranges - np.linalg.norm(starts[:, None] - offsets, axis=2))
    return np.asarray(residuals[np.argmin(np.median(residuals, axis=1))])


def _range_error(trial: Trial) -> float:
    """Median residual of the ranges along the vehicle's own course, in each stretch from the start
    that fits them best [m]; NaN for few ranges.
    """
    rows, places, ranges = _horizontal_ranges(trial)
    indices = rows.astype(np.int64)
    offsets = places - _dead_reckoning(trial)[indices]
    stretch = trial.stretch[indices]
    residuals = [
        _start_residuals(offsets[stretch == number], ranges[stretch == number])
        for number, count in zip(*np.unique(stretch, return_counts=True), strict=True)
        if count >= _MIN_OBSERVATIONS + 2
    ]
    return float(np.median(np.concatenate(residuals))) if residuals else math.nan


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What a wrong unit contradicts."""

    subject: str  # what it is, for messages
    error: Callable[[Trial], float]  # how badly a trial fits; NaN: nothing tells
    margin: float  # differences below this may have other causes: current, sideslip, noise

    def fits(self, trial: Trial) -> bool:
        """Whether a trial fits; False where nothing tells."""
        return self.error(trial) <= self.margin

    def prefers(self, trial: Trial, other: Trial) -> bool:
        """Whether the other trial fits far worse, or nothing tells of it."""
        error = self.error(other)
        return math.isnan(error) or error > _TIMES_WORSE * self.error(trial) + self.margin


WAY_AT_SPEED = Evidence(
    subject="the leader's way at its speed", error=_speed_error, margin=_SPEED_MARGIN
)
EVIDENCE = (
    Evidence(
        subject="the leader's course over ground",
        error=_course_error,
        margin=math.radians(3.0),
    ),
    WAY_AT_SPEED,
    Evidence(subject="the leader's clock", error=_clock_error, margin=1.0),
    Evidence(subject="the ranges along the vehicle's course", error=_range_error, margin=1.0),
)


def tick_ratio(clock: Floats, time: Floats) -> float | None:
    """Interval on a clock over that of `time`, median over successive readings; None without two
    that increase. Both of shape (n,), NaN where there is no reading.
    """
    valid = np.isfinite(clock)
    ticks = np.diff(clock[valid])
    spans = np.diff(time[valid])
    rising = (ticks > 0.0) & (spans > 0.0)
    return float(np.median(ticks[rising] / spans[rising])) if rising.any() else None


def _bare(columns: Columns, quantity: Quantity) -> list[Column]:
    """Columns without a unit; the leader's clock is judged once the vehicle's is known."""
    fields = [c for c in columns.fields.values() if c.field != TIMESTAMP]
    return [c for c in (columns.time, *fields) if c.quantity is quantity and not c.unit]


def _stated(columns: Columns, quantity: Quantity) -> dict[float, Column]:
    """A column for each unit that headers of a quantity state, by the unit's size."""
    stated = dict[float, Column]()
    for column in columns.fields.values():
        if column.quantity is quantity and column.unit:
            stated.setdefault(quantity.units[column.unit], column)
    return stated


def _largest(bare: list[Column]) -> float:
    """Largest magnitude of numbers in columns, as they stand in the file."""
    return max(float(np.nanmax(np.abs(column.values), initial=0.0)) for column in bare)


def _candidates(columns: Columns, quantity: Quantity, bare: list[Column]) -> list[str]:
    """Units that bare columns of a quantity may have."""
    if quantity is TIME:
        return _time_candidates(bare[0].values)
    if quantity is ANGLE:
        return ["deg"] if _largest(bare) > _LARGEST_ANGLE else ["rad", "deg"]
    stated = [column.unit for column in _stated(columns, quantity).values()]
    return list(dict.fromkeys([quantity.si, *stated]))


def _interval(values: Floats) -> float:
    """Median interval between times, as they stand in the file."""
    steps = np.diff(np.unique(values))
    return float(np.median(steps)) if steps.size else 1.0


def _time_candidates(values: Floats) -> list[str]:
    """Units in which bare times are within the bound, at intervals that are possible."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    bounded = [unit for unit, scale in TIME.units.items() if largest * scale <= LARGEST_NUMBER]
    interval = _interval(values)
    possible = [
        unit
        for unit in bounded
        if _MIN_INTERVAL_S <= interval * TIME.units[unit] <= _MAX_INTERVAL_S
    ]
    return possible or bounded


def _date_unit(time: float) -> str | None:
    """The unit in which a time since 1970 is a date of this century; None if it is in none. Days
    are not considered: their numbers are as large as those of some hours in seconds.
    """
    for unit, scale in TIME.units.items():
        if scale <= 1.0 and _FIRST_DATE_S <= time * scale <= _LAST_DATE_S:
            return unit
    return None


def _usual_units(values: Floats, candidates: list[str]) -> list[str]:
    """Those of the units of time in which intervals between rows are usual."""
    interval = _interval(values)
    return [
        unit
        for unit in candidates
        if _USUAL_MIN_INTERVAL_S <= interval * TIME.units[unit] <= _USUAL_MAX_INTERVAL_S
    ]


def _usual_time_unit(values: Floats) -> str | None:
    """The unit of bare times by their size since 1970, or by the interval between rows; None if
    several are usual.
    """
    since_1970 = _date_unit(float(values.max()))
    if since_1970 is not None:
        return since_1970
    usual = _usual_units(values, list(TIME.units))
    return usual[0] if len(usual) == 1 else None


def _preferred(columns: Columns, quantity: Quantity, bare: list[Column]) -> str | None:
    """The unit of bare columns as far as headers and usage tell; None in doubt."""
    stated = _stated(columns, quantity)
    if quantity is TIME and not stated:
        return _usual_time_unit(bare[0].values)
    if len(stated) > 1:
        return None
    if quantity is TIME and stated:
        date_unit = _date_unit(float(bare[0].values.max()))
        (column,) = stated.values()
        usual = _usual_units(bare[0].values, list(TIME.units))
        is_other_date = date_unit not in (None, column.unit)
        is_unusual = bool(usual) and column.unit not in usual
        return None if is_other_date or is_unusual else column.unit
    if stated:
        (column,) = stated.values()
        # a depth in metres is common beside ranges in centimetres
        in_doubt = quantity is LENGTH and quantity.units[column.unit] != 1.0
        return None if in_doubt else column.unit
    if quantity is ANGLE:
        largest = _largest(bare)
        if largest > _LARGEST_ANGLE:
            return "deg"
        return "rad" if largest < _SMALL_ANGLE else None
    return quantity.si


def _stretches(times: Floats) -> Ints:
    """Number of the stretch between steps of the clock, or gaps, of each row, shape (n,), from 0
    on; the same in any unit of the times, shape (n,).
    """
    spans = np.abs(np.diff(times))
    # of more pauses, as between bursts of rows, the longest count
    longest = np.argsort(spans)[-_MAX_STEPS:]
    begins_stretch = np.zeros(times.size, dtype=np.int64)
    begins_stretch[longest + 1] = spans[longest] > _MIN_STEP_INTERVALS * _interval(times)
    return np.cumsum(begins_stretch)


def _trial(
    columns: Columns, choice: UnitChoice, others: Mapping[str, str] = MappingProxyType({})
) -> Trial:
    """A table by a choice of units, and by other units of single fields."""

    def si(column: Column) -> Floats:
        unit = others.get(column.field) or column.unit or choice[column.quantity.name]
        return column.values * column.quantity.units[unit]

    fields = {f: si(column) for f, column in columns.fields.items() if f != TIMESTAMP}
    timestamp = columns.fields.get(TIMESTAMP)
    leader_clock = None if timestamp is None or not timestamp.unit else si(timestamp)
    unit = others.get(TIME.name) or columns.time.unit or choice[TIME.name]
    time = columns.time.values * TIME.units[unit]
    return Trial(time - time[0], _stretches(columns.time.values), fields, leader_clock)


def _unrefuted(columns: Columns, choices: list[UnitChoice]) -> tuple[list[UnitChoice], list[str]]:
    """Choices of units that no evidence refutes, and what refuted the others."""
    refuted = [False] * len(choices)
    reasons = list[str]()
    trials = [_trial(columns, choice) for choice in choices]
    for evidence in EVIDENCE:
        errors = np.array([evidence.error(trial) for trial in trials])
        if np.isnan(errors).any():
            continue
        is_worse_than_best = errors > _TIMES_WORSE * errors.min() + evidence.margin
        if is_worse_than_best.any():
            reasons.append(evidence.subject)
        refuted = [
            was_refuted or bool(is_worse)
            for was_refuted, is_worse in zip(refuted, is_worse_than_best, strict=True)
        ]
    return [c for c, is_refuted in zip(choices, refuted, strict=True) if not is_refuted], reasons


def _suggested_headers(bare: list[Column], units: list[str]) -> str:
    """Headers that would settle the unit of the first bare column."""
    header = bare[0].header.strip()
    return " or ".join(f"'{header} [{unit}]'" for unit in units)


def _settled(
    columns: Columns,
    quantity: Quantity,
    candidates: list[str],
    remaining: list[UnitChoice],
    reason: str,
) -> str:
    """The unit of the bare columns of a quantity; LaisnError with the header that settles it."""
    bare = _bare(columns, quantity)
    headers = ", ".join(column.header.strip() for column in bare)
    preferred = _preferred(columns, quantity, bare)
    units = list(dict.fromkeys(choice[quantity.name] for choice in remaining))
    stated = _stated(columns, quantity)
    advice = f"name the header {_suggested_headers(bare, candidates)}"
    if len(units) == 1 and stated and units != [preferred]:
        others = " and ".join(
            f"{c.header.strip()} is in {c.unit}" for c in stated.values() if c.unit != units[0]
        )
        raise LaisnError(
            f"{columns.path}: {headers} without a unit fits {units[0]} by {reason}, but {others}; "
            f"{advice}"
        )
    if len(units) == 1:
        return units[0]
    if not units and len(candidates) > 1:
        raise LaisnError(
            f"{columns.path}: {headers} without a unit: in none of {', '.join(candidates)} they "
            f"fit {reason}; {advice}"
        )
    if preferred is not None and (preferred in units or not units):
        return preferred
    raise LaisnError(
        f"{columns.path}: {headers} without a unit may be in {' or '.join(candidates)}, and "
        f"nothing in the table tells which; {advice}"
    )


@dataclass(frozen=True)
class _Alternative:
    """Another unit that columns without one might be in, at a unit of time."""

    columns: list[Column]
    unit: str
    time_unit: str

    @property
    def evidence(self) -> tuple[Evidence, ...]:
        """What tells of it; residuals of ranges are small in any small unit of length."""
        is_length = self.columns[0].quantity is LENGTH
        return (WAY_AT_SPEED,) if is_length else EVIDENCE

    def trial(self, columns: Columns, choice: UnitChoice) -> Trial:
        units = {column.field: self.unit for column in self.columns}
        return _trial(columns, choice, {TIME.name: self.time_unit, **units})


def _alternatives(columns: Columns, choice: UnitChoice) -> list[_Alternative]:
    """Columns of a quantity without a unit in another one, together and each alone, at the unit of
    time that was taken; and all of them, at others that are usual.
    """
    taken_time = columns.time.unit or choice[TIME.name]
    times = [] if columns.time.unit else _time_candidates(columns.time.values)
    others = [u for u in _usual_units(columns.time.values, times) if u != taken_time]
    alternatives = list[_Alternative]()
    for quantity in (SPEED, ANGLE, LENGTH):
        bare = _bare(columns, quantity)
        if not bare:
            continue
        unit_size = quantity.units[choice[quantity.name]]
        # the first name of a size wins: m/s, not m_s
        sizes = {size: unit for unit, size in reversed(list(quantity.units.items()))}
        units = [
            unit
            for size, unit in sizes.items()
            if abs(math.log(size / unit_size)) > math.log(_MIN_FACTOR)
        ]
        groups = [bare]
        if len(bare) > 1 and quantity is not LENGTH:
            groups += [[column] for column in bare]
        alternatives += [
            _Alternative(group, unit, taken_time) for group in groups for unit in units
        ]
        alternatives += [_Alternative(bare, unit, time) for time in others for unit in units]
    return alternatives


@dataclass(frozen=True)
class _Doubt:
    """Another unit that fits far better, and by what."""

    other: _Alternative
    subject: str
    is_uncontradicted: bool  # by any evidence


def _require_fit(columns: Columns, choice: UnitChoice) -> None:
    """LaisnError, with the header that settles it, if the evidence contradicts a unit that no
    header states and fits another one, or if rows at usual intervals fit another one.
    """
    taken_time = columns.time.unit or choice[TIME.name]
    usual = _usual_units(columns.time.values, list(TIME.units))
    assumed = _trial(columns, choice)
    unusual = not columns.time.unit and taken_time not in usual
    if _is_uncontradicted(assumed) and math.isfinite(WAY_AT_SPEED.error(assumed)) and not unusual:
        return
    doubts = list[_Doubt]()
    for other in _alternatives(columns, choice):
        trial = other.trial(columns, choice)
        same_time = other.time_unit == taken_time
        subjects = [
            evidence.subject
            for evidence in other.evidence
            if evidence.fits(trial)
            and (evidence.prefers(trial, assumed) or (unusual and not same_time))
        ]
        if subjects and (same_time or _is_uncontradicted(trial)):
            doubts.append(_Doubt(other, subjects[0], _is_uncontradicted(trial)))
    if doubts:
        # the first that nothing contradicts, else the first
        doubt = max(doubts, key=lambda alternative: alternative.is_uncontradicted)
        raise LaisnError(_refusal(columns, choice, doubt.other, doubt.subject))


def _refusal(columns: Columns, choice: UnitChoice, other: _Alternative, subject: str) -> str:
    """Why a choice of units is in doubt, and the header that settles it."""
    headers = ", ".join(column.header.strip() for column in other.columns)
    unit = choice[other.columns[0].quantity.name]
    first = other.columns[0].header.strip()
    units = unit
    instead = other.unit
    if not columns.time.unit and other.time_unit != choice[TIME.name]:
        time = columns.time.header.strip()
        units = f"{unit} and {time} in {choice[TIME.name]}"
        instead = f"{other.unit} and {time} in {other.time_unit}"
    return (
        f"{columns.path}: {headers} without a unit would be in {units}, but in {instead} they fit "
        f"{subject}; name the header '{first} [{other.unit}]' or '{first} [{unit}]'"
    )


def _is_uncontradicted(trial: Trial) -> bool:
    """Whether no evidence contradicts; evidence that cannot be had does not."""
    return not any(evidence.error(trial) > evidence.margin for evidence in EVIDENCE)


def _way_remark(columns: Columns, choice: UnitChoice) -> list[str]:
    """That the leader's way is not that at its speed."""
    ratio = _distance_ratio(_trial(columns, choice))
    if not abs(math.log(ratio)) > _SPEED_MARGIN:
        return []
    return [
        f"the leader's way is {ratio:.2g} times that at leader_speed: a current, or another unit "
        "of speeds, lengths or times"
    ]


def decide_units(columns: Columns) -> tuple[UnitChoice, list[str]]:
    """A unit for each quantity that has columns without one, but for the leader's clock; remarks
    tell by what it was decided.

    LaisnError, with the header that settles it, if headers and physics leave it open or disagree.
    """
    bare = {q.name: _bare(columns, q) for q in QUANTITIES}
    candidates_by_quantity = {
        q: _candidates(columns, q, bare[q.name]) for q in QUANTITIES if bare[q.name]
    }
    names = [quantity.name for quantity in candidates_by_quantity]
    choices = [
        dict(zip(names, units, strict=True)) for units in product(*candidates_by_quantity.values())
    ]
    if len(choices) == 1:
        _require_fit(columns, choices[0])
        return choices[0], _way_remark(columns, choices[0])
    remaining, reasons = _unrefuted(columns, choices)
    reason = " and ".join(reasons)
    choice = {
        quantity.name: _settled(columns, quantity, candidates, remaining, reason)
        for quantity, candidates in candidates_by_quantity.items()
    }
    _require_fit(columns, choice)
    remarks = [
        f"{', '.join(c.header.strip() for c in bare[quantity.name])}: without a unit, in "
        f"{choice[quantity.name]} by {reason}"
        for quantity, candidates in candidates_by_quantity.items()
        if len(candidates) > 1 and reason and quantity in (TIME, ANGLE, SPEED)
    ]
    return choice, remarks + _way_remark(columns, choice)


def timestamp_unit(columns: Columns, time_s: Floats, time_unit: str) -> str:
    """The unit of the leader's clock, whose header may state none: that of the vehicle's times,
    unless the ticks or, where they tell nothing, the size of the numbers show another; LaisnError
    if the ticks contradict and both are possible.
    """
    column = columns.fields[TIMESTAMP]
    if column.unit:
        return column.unit
    expected = "s" if columns.has_dates else time_unit
    ratio = tick_ratio(column.values, time_s)
    tick_unit = next(
        (u for u, s in TIME.units.items() if ratio and abs(math.log10(ratio * s)) < 0.5), None
    )
    if tick_unit is None:
        largest = float(np.nanmax(np.abs(column.values), initial=0.0))
        return _date_unit(largest) or expected
    if tick_unit == expected:
        return expected
    if (
        columns.has_dates
        or np.nanmax(np.abs(column.values)) * TIME.units[expected] > LARGEST_NUMBER
    ):
        return tick_unit
    header = column.header.strip()
    raise LaisnError(
        f"{column.where}: counts {tick_unit} by the times of the rows, which are in {time_unit}; "
        f"name the header '{header} [{tick_unit}]' or '{header} [{expected}]'"
    )
