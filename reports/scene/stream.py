"""The scene of a mission that is under way: its beginning, and what has happened since, part by
part; `src/live.js` reads them.
"""

import json
from collections.abc import Sequence
from typing import Any

from laisn.arrays import Bools
from reports.scene.mission import (
    Scene,
    SentCounts,
    events_of,
    hulls_of,
    known_from,
    meta_of,
    part_of,
)
from sim.flight import FlightRecord
from sim.log.writer import Event
from sim.scenario.parts import MissionPlan


def text_of(message: dict[str, Any]) -> str:
    """A message for the page as JSON, on one line."""
    return json.dumps(message, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


class SceneStream:
    """What is sent to the page of a mission under way; the flights given are of one mission, each
    longer than the last.
    """

    def __init__(self, plan: MissionPlan) -> None:
        self._duration = plan.duration_s
        self._hulls = hulls_of(plan.models)
        self._sent = SentCounts()

    def beginning(self, flight: FlightRecord) -> Scene:
        """The scene until now."""
        update = part_of(flight, self._hulls, self._duration, SentCounts())
        self._sent = update.sent
        meta = meta_of(flight, self._hulls, self._duration, update)
        meta["planned"] = meta["start"] + self._duration
        return Scene(meta=meta, data=update.packer.text())

    def next_part(self, flight: FlightRecord) -> str:
        """What was added since."""
        update = part_of(flight, self._hulls, self._duration, self._sent)
        self._sent = update.sent
        return text_of(
            {
                "arrays": update.packer.table(),
                "data": update.packer.text(),
                "end": float(flight.trajectory.time[-1]),
                "known": known_from(flight),
                "refused": update.refused,
            }
        )


def ending(flight: FlightRecord, events: Sequence[Event], mirror_locked: Sequence[Bools]) -> str:
    """What is known at the end alone: events, mirror locks, and how the mission ended."""
    ending_events = events_of(flight, events, mirror_locked)
    del ending_events["opening"]
    return text_of({"over": flight.outcome.value, **ending_events})
