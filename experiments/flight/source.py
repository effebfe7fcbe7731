"""A flight, from whatever a user names: a scenario is flown, a log is read."""

from collections.abc import Iterable
from pathlib import Path

from experiments.campaign.progress import compiling_shown
from experiments.flight.fly import fly
from experiments.flight.library import load_flyable
from laisn.failure import LaisnError
from sim.flight import Flight
from sim.log import reader


def flight_of(source: str, assignments: Iterable[str] = ()) -> Flight:
    """Fly a scenario, or read the log of a flight.

    Args:
        source: scenario name, TOML file or `.mcap` log.
        assignments: overrides of a scenario, "key=value".

    Raises:
        LaisnError: overrides were given for a log.
        LogError, ScenarioError: the source is at fault.
    """
    path = Path(source)
    if path.suffix != ".mcap":
        scenario = load_flyable(source, assignments)
        with compiling_shown():
            return fly(scenario)[0]
    if list(assignments):
        raise LaisnError(f"{path}: --set changes a scenario; a log was flown already")
    return reader.read(path)
