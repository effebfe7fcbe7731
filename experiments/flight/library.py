"""The built-in scenarios, and how a user's scenario is found."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sim.scenario.file import ScenarioError, override, read, validate
from sim.scenario.settings import Scenario

FOLDER = Path(__file__).parents[1] / "scenarios"
ROUTES = tuple(f"T{i}" for i in range(2, 10))

_DESCRIPTIONS = {
    "T2": "straight astern of the leader for the whole mission",
    "T3": "abeam to port, gentle turns",
    "T4": "far abeam, gentle turns",
    "T5": "astern, with one excursion at the leader's turn",
    "T6": "on the quarter, many small turns",
    "T7": "zigzag across the leader's wake",
    "T8": "zigzag, with a burst to 3 m/s close to the leader",
    "T9": "wide zigzag far astern",
}


def _built_in(name: str) -> Mapping[str, Any] | None:
    if name in ROUTES:
        return {"name": name, "followers": [{"route": name}]}
    path = FOLDER / f"{name}.toml"
    return read(path) if path.is_file() else None


def names() -> tuple[str, ...]:
    """All built-in scenarios."""
    return (*ROUTES, *sorted(path.stem for path in FOLDER.glob("*.toml")))


def name_of(path: Path) -> str:
    """A name for what a file holds, after the file; letters that no name may have become hyphens."""
    name = re.sub(r"[^A-Za-z0-9_.-]", "-", path.stem)[:64]
    return name if re.match(r"[A-Za-z0-9]", name) else f"scenario{name}"[:64]


def load(source: str, assignments: Iterable[str]) -> Scenario:
    """A built-in scenario or a TOML file, with overrides applied.

    Args:
        source: built-in name, or path of a TOML file.
        assignments: `key=value` overrides.

    Raises:
        ScenarioError: there is no such scenario, or it is not valid.
    """
    table = _built_in(source)
    if table is None:
        path = Path(source)
        if path.suffix != ".toml" and not path.exists():
            raise ScenarioError(f"unknown scenario {source!r}; available: {', '.join(names())}, or a TOML file")
        table = read(path)
        table.setdefault("name", name_of(path))
    given = list(assignments)
    return validate(override(table, given), " ".join([source, *(f"--set {a}" for a in given)]))


def load_flyable(source: str, assignments: Iterable[str]) -> Scenario:
    """As `load`, with sea and routes tried too.

    Raises:
        ScenarioError: names file, key, waypoint and limit if a route is unknown or cannot be flown, if the waves
            would break, if there is no such camera or if a log cannot hold the date.
    """
    from sim.assembly import ocean_of, route_of, vehicle_names
    from sim.film.cameras import CAMERAS
    from sim.log.clock import Clock
    from sim.scenario.point_motion import plan

    scenario = load(source, assignments)
    try:
        Clock(scenario.epoch)
    except ValueError as error:
        raise ScenarioError(f"{source}: {error}") from None
    if scenario.video.camera not in CAMERAS:
        raise ScenarioError(
            f"{source}: video.camera: unknown camera {scenario.video.camera!r}; available: {', '.join(CAMERAS)}"
        )
    try:
        ocean_of(scenario)
    except ValueError as error:
        raise ScenarioError(f"{source}: ocean.waves: {error}") from None
    keys = ("leader", *(f"followers[{i}]" for i in range(len(scenario.followers))))
    vehicles = (scenario.leader, *scenario.followers)
    for key, vehicle, name in zip(keys, vehicles, vehicle_names(scenario), strict=True):
        try:
            plan(route_of(vehicle, name))
        except ValueError as error:
            where = f"{key}.{'waypoints' if vehicle.waypoints else 'route'}"
            raise ScenarioError(f"{source}: {where}: {error}") from None
    return scenario


def show() -> None:
    """Print the built-in scenarios with a line each."""
    from rich.console import Console
    from rich.table import Table

    table = Table("scenario", "what happens", box=None, pad_edge=False)
    for name in names():
        path = FOLDER / f"{name}.toml"
        about = _DESCRIPTIONS.get(name) or path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        table.add_row(name, about)
    Console().print(table)
