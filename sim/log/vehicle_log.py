"""Measurements from the log of a real vehicle, whose samples come late, double or not at all."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.messages import Measurements
from sim.log.contents import Contents, Messages
from sim.log.file import LogError, faults
from sim.log.schema import OWN_MOTION, PLACES, RECEPTION

_MESSAGE, _RANGES = (group.fields for group in RECEPTION.groups)
_OPTIONAL = ("leader_pitch", "leader_roll", "leader_heading_sigma", "range_middle")
"""Fields of a reception that a vehicle's log may lack; they read as NaN, "not broadcast"."""
LONGEST_GAP_S = 10.0
"""Longer gaps between own measurements are not bridged unless the user says so [s]."""
_GAP = 2.0
"""From so many filter steps on, the time between own measurements is called a gap."""
_SHORTEST_NS, _LONGEST_NS = 10**5, 10**11
"""Filter steps beyond these are not believed of a vehicle [ns]."""
_NAMED = 5
_POSE = slice(0, 6)
"""Columns of a message that a navigator cannot do without."""


class Recording(NamedTuple):
    """Measurements of a follower, and what was not as expected."""

    measurements: Measurements
    remarks: tuple[str, ...]
    """A sentence each."""


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _optional(messages: Messages, names: Sequence[str]) -> Floats:
    """Numbers by the names of their fields, NaN for those that are not in a message, shape (n, len(names)).

    Where a type cannot tell zero from a number that is not there (protobuf 3 without `optional`), zero in a range, or
    in a quantity that need not be broadcast, stands for one that is not there.
    """
    there = [name for name in names if messages.has(name)]
    values = np.full((messages.sizes.size, len(names)), np.nan)
    values[:, [names.index(name) for name in there]] = messages.table(there)
    for name in {*_OPTIONAL, *_RANGES} & set(there):
        if not messages.message_class.DESCRIPTOR.fields_by_name[name].has_presence:
            column = values[:, names.index(name)]
            column[column == 0.0] = np.nan
    return values


def _gaps(path: Path, topic: str, time_ns: Ints, spacing: Ints, longest_gap_s: float) -> list[str]:
    """What to say of gaps; LogError if one is too long."""
    longest_step = _GAP * float(np.median(spacing))
    found = np.flatnonzero(spacing > longest_step)
    named = found[np.argsort(-spacing[found], kind="stable")][:_NAMED]
    begin = time_ns[named] - time_ns[0]
    places = ", ".join(f"{s / 1e9:.3g} s at {b / 1e9:.3f} s" for s, b in zip(spacing[named], begin, strict=True))
    more = f" and {found.size - named.size} shorter ones" if found.size > named.size else ""
    if spacing.max() / 1e9 > max(longest_gap_s, longest_step / 1e9):
        raise LogError(
            f"{path}: {topic} has {_count(found.size, 'gap')} ({places}{more}); gaps of up to {longest_gap_s:g} s are "
            "bridged. Cut the log there, or allow longer ones: --longest-gap SECONDS"
        )
    return [f"{_count(found.size, 'gap')} in {topic} bridged: {places}{more}"] if found.size else []


def _last_of_equals(values: Ints) -> Bools:
    """Which elements of an ordered array are the last of their value, shape (n,)."""
    return np.append(np.diff(values) > 0, True)[: values.size]


def recording(log: Contents, follower: str, longest_gap_s: float) -> Recording:
    """What one follower heard and sensed, each filter step as long as it took.

    Own measurements are the filter steps, Δt is the median of their spacing, and the first is taken to end a step of
    Δt. A reception belongs to the first step at or after it. Left out are own measurements and leader messages that
    are not finite numbers; of several in one step, all but the last; and receptions before the first step or after the
    last one. Ranges that are infinite, zero or negative count as not received.

    Args:
        log: what was read; its topics are gone afterwards.
        follower: its name.
        longest_gap_s: between own measurements [s].

    Raises:
        LogError: a channel or a field is missing, there are fewer than two own measurements, or a gap is too long.
    """
    topic, heard = f"/{follower}/motion", f"/{follower}/reception"
    with faults(log.path):
        motion = log.require(topic, OWN_MOTION.fields)
        reception = log.require(heard, [name for name in RECEPTION.fields if name not in _OPTIONAL])
        time_ns, own, heard_ns = motion.time_ns, motion.table(OWN_MOTION.fields).T, reception.time_ns
        message, ranges = _optional(reception, _MESSAGE), _optional(reception, _RANGES)
        places = _optional(reception, PLACES.fields).reshape(-1, *PLACES.shape)
    absurd = ~np.isnan(ranges) & ~((ranges > 0) & np.isfinite(ranges))
    ranges[absurd] = np.nan
    places[~np.all(np.isfinite(places), axis=2)] = np.nan
    # hours of messages would fill the memory beside their numbers
    log.topics.clear()
    del motion, reception
    finite = np.all(np.isfinite(own), axis=0)
    if not finite.all():
        time_ns, own = time_ns[finite], own[:, finite]
    last = _last_of_equals(time_ns)
    if not last.all():
        time_ns, own = time_ns[last], own[:, last]
    if time_ns.size < 2:
        raise LogError(
            f"{log.path}: {topic} holds {_count(time_ns.size, 'usable message')}; at least two are needed to know the "
            "filter step"
        )
    spacing = np.diff(time_ns)
    dt_ns = round(float(np.median(spacing)))
    remarks = _gaps(log.path, topic, time_ns, spacing, longest_gap_s)
    if not _SHORTEST_NS < dt_ns < _LONGEST_NS:
        remarks.append(f"{topic} comes every {dt_ns / 1e9:g} s: are the log times in nanoseconds?")
    durations = None if np.all(spacing == dt_ns) else np.append(float(dt_ns), spacing)
    if durations is not None:
        durations /= 1e9
        durations.flags.writeable = False
    del spacing

    step = np.searchsorted(time_ns, heard_ns).astype(np.int64) + 1
    within = (heard_ns > time_ns[0] - dt_ns) & (step <= time_ns.size)
    heeded = within & np.all(np.isfinite(message[:, _POSE]), axis=1)
    kept = np.flatnonzero(heeded)
    kept = kept[_last_of_equals(step[kept])]
    left_out = (
        (~finite, topic, "not finite"),
        (~last, topic, "at the very time of another"),
        (~within, heard, "before the first or after the last filter step"),
        (within & ~heeded, heard, "without a finite pose of the leader"),
        (~_last_of_equals(step[heeded]), heard, "followed by another in the same filter step"),
    )
    for which, where, why in left_out:
        number = int(np.count_nonzero(which))
        remarks += [f"{_count(number, 'message')} of {where} left out: {why}"] if number else []
    if absurd.any():
        remarks.append(f"{_count(int(absurd.sum()), 'range')} of {heard} taken as not received: no positive number")
    remarks += [f"{what}: no checksum, damage cannot be noticed" for what in log.unverified if "chunks" in what]
    measurements = Measurements(
        dt=dt_ns / 1e9,
        speed=own[0],
        heading=own[1],
        depth=own[2],
        message_step=step[kept],
        message=message[kept],
        ranges=ranges[kept],
        durations=durations,
        transmitters=None if np.all(np.isnan(places)) else places[kept],
    )
    return Recording(measurements, tuple(remarks))
