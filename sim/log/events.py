"""Lines of `/log`: the kind of every fix, events of the caller, and the outcome of the mission."""

from collections.abc import Iterable
from typing import Literal, NamedTuple

from laisn.estimates import FixKind
from sim.flight import Flight, Outcome

Level = Literal["debug", "info", "warning", "error"]

FIX_LINES: dict[FixKind, tuple[Level, str]] = {
    FixKind.TWO_POINTS: ("debug", "fix: the nearer of two intersections"),
    FixKind.TANGENT: ("debug", "fix: one intersection"),
    FixKind.FUSED: ("debug", "fix: weighted mean of pairs"),
    FixKind.ASTERN: ("info", "fix: no two clear intersections, snapped onto the leader's axis"),
    FixKind.SINGULAR: ("info", "fix skipped: the filter was already exact"),
    FixKind.GATED: ("warning", "fix rejected as a gross error"),
    FixKind.ONE_RANGE: ("info", "fix: one range alone, the estimate moved along its line of sight"),
    FixKind.LOST: ("warning", "no fix: ranges are missing"),
    FixKind.RANGES: ("debug", "ranges used as they are"),
    FixKind.PARTLY: ("info", "ranges used but for those that looked like echoes"),
}
"""Level and text for every kind of fix."""
_OUTCOME_LEVELS: dict[Outcome, Level] = {Outcome.COMPLETED: "info", Outcome.CONTACT: "warning"}
"""Levels of outcomes that are no faults."""


class Event(NamedTuple):
    """A line that does not follow from the flight itself, such as a mirror capture."""

    time_s: float
    """Time since the start of the mission [s]."""
    level: Level
    text: str
    source: str = "laisn"
    """Name that the line stands under, such as a vehicle."""


def log_events(flight: Flight, events: Iterable[Event]) -> list[Event]:
    """All lines in order of time; the outcome comes last."""
    lines = list(events)
    for name, m, e in zip(flight.trajectory.names[1:], flight.measurements, flight.estimates, strict=True):
        for step, kind in zip(e.fix_step.tolist(), e.fix_kind.tolist(), strict=True):
            level, text = FIX_LINES[FixKind(kind)]
            lines.append(Event(step * m.dt, level, text, name))
    level = _OUTCOME_LEVELS.get(flight.outcome, "error")
    lines.append(Event(float(flight.trajectory.time[-1]), level, flight.outcome.value))
    return sorted(lines, key=lambda line: line.time_s)
