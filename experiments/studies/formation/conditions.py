"""What the formation is flown through: sea, sound, sensors and navigators, as `conditions.toml` lists them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from experiments.flight.library import table_of
from sim.scenario.file import assigned, read, validate
from sim.scenario.section import Section
from sim.scenario.settings import Scenario

_GOLDEN_DEG = 137.508
"""Directions of the current from run to run: spread evenly, however many runs there are."""
_PAIR_DEG = (271.756, 205.1425)
"""Phases of log and compass from run to run, spread evenly as pairs: 360° by the plastic number and by its square."""


class Condition(Section):
    """What differs from the built-in swarm."""

    name: str
    title: str
    settings: Mapping[str, Any] = {}
    """Values of the scenario by key."""
    current_m_s: float = 0.0
    """Greatest speed of a current from any direction, of which every run has another share."""
    drift: bool = False
    """The position that the leader broadcasts drifts by 1 cm/s, in another direction in every run."""
    swing: bool = False
    """The biases of log and compass begin their drift at other phases in every run."""
    share: int = 1
    """One of so many runs is flown."""
    truth: bool = False
    """Followers steer by the truth."""

    def scenario(self, run: int, duration_s: float = 1000.0) -> Scenario:
        """The mission of one run."""
        table = assigned(table_of("swarm"), self.settings)
        changed: dict[str, Any] = {"run": run, "duration_s": duration_s}
        if self.current_m_s:
            changed["ocean.current_speed_m_s"] = self.current_m_s * (1 + run % 5) / 5
            changed["ocean.current_direction_deg"] = run * _GOLDEN_DEG % 360
        if self.drift:
            changed["sensors.leader_position_drift_m_s"] = 0.01
            changed["sensors.leader_position_drift_deg"] = run * _GOLDEN_DEG % 360
        if self.swing:
            for name, step in zip(("speed", "heading"), _PAIR_DEG, strict=True):
                changed[f"sensors.{name}_drift_phase_deg"] = run * step % 360
        if self.truth:
            changed |= {f"followers.{i}.guidance_position": "truth" for i in range(len(table["followers"]))}
        return validate(assigned(table, changed), f"condition {self.name!r}")


CONDITIONS = TypeAdapter(tuple[Condition, ...]).validate_python(
    read(Path(__file__).with_name("conditions.toml"))["arm"]
)
"""Where a title does not say otherwise: the tightly coupled navigator, 3 transmitters, messages every second."""
