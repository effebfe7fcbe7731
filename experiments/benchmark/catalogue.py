"""The missions of LAISN-Bench, and what a navigator may know of each before it starts."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from experiments.flight.library import as_scenario, table_of
from laisn.errors import LaisnError
from sim.scenario.file import assigned, read
from sim.scenario.settings import Scenario

VERSION = 1
"""Version of the benchmark: another one has other missions, or files of another layout."""
SEEDS = 20
"""Seeds of each mission, counted from 1."""
_FILE = Path(__file__).with_name("missions.toml")


@dataclass(frozen=True, kw_only=True)
class BenchmarkMission:
    """One of the benchmark's missions, flown with several seeds."""

    name: str
    title: str
    transmitters: int  # 2: the middle transmitter's ranges are not among the measurements
    assume: dict[str, Any]  # what navigators are told, as `navigation.assume` has it
    table: dict[str, Any]  # of the scenario, without seed
    scored: bool = True  # whether it counts in the score of a navigator

    def scenario(self, seed: int) -> Scenario:
        """The scenario that is flown with a seed, from which sea and noise follow."""
        return as_scenario({**self.table, "name": self.name, "seed": seed})


def _mission(entry: dict[str, Any]) -> BenchmarkMission:
    table = dict(table_of(entry["base"]))
    if "formation" in entry:
        del table["followers"]
        table["formation"] = {"shape": entry["formation"]}
    assume = {"transmitters": entry["transmitters"], **entry.get("assume", {})}
    assumptions = {f"navigation.assume.{key}": value for key, value in assume.items()}
    return BenchmarkMission(
        name=entry["name"],
        title=entry["title"],
        transmitters=entry["transmitters"],
        assume=assume,
        table=assigned(table, entry.get("set", {}) | assumptions),
        scored=entry.get("scored", True),
    )


@cache
def missions() -> dict[str, BenchmarkMission]:
    """All missions by their names."""
    entries = (_mission(entry) for entry in read(_FILE)["missions"])
    return {mission.name: mission for mission in entries}


def chosen_missions(names: Sequence[str]) -> list[BenchmarkMission]:
    """Missions of these names, all of them if there is none; LaisnError for an unknown name."""
    catalogue = missions()
    for name in names:
        if name not in catalogue:
            raise LaisnError(
                f"mission {name!r} is none of the benchmark; expected one of {', '.join(catalogue)}"
            )
    return [catalogue[name] for name in dict.fromkeys(names)] if names else list(catalogue.values())
