"""The built-in scenarios, and how a user's scenario is found."""

import json
import os
import re
import shlex
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from laisn.errors import printable, shortened
from laisn.navigators import NAVIGATORS
from sim.scenario.file import (
    LARGEST_BYTES,
    Location,
    ScenarioError,
    assigned,
    line_in,
    read,
    validate,
    values_of,
    with_file_paths,
)
from sim.scenario.settings import Navigation, Scenario
from sim.system import read_text

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


def scenario_names() -> tuple[str, ...]:
    return (*ROUTES, *sorted(path.stem for path in FOLDER.glob("*.toml")))


def name_of(path: Path) -> str:
    """A name for what a file holds, after the file; characters that are not allowed in names are
    replaced by hyphens.
    """
    name = re.sub(r"[^A-Za-z0-9_.-]", "-", path.stem)[:64]
    return name if re.match(r"[A-Za-z0-9]", name) else f"scenario{name}"[:64]


def table_of(source: str) -> dict[str, Any]:
    """The table of a built-in scenario or of a TOML file, not validated; ScenarioError if there
    is none.
    """
    if source in ROUTES:
        return {"name": source, "followers": [{"route": source}]}
    if source in scenario_names():
        return read(FOLDER / f"{source}.toml")
    path = Path(source)
    # os.path.exists is False, instead of raising, for names that no system allows
    if path.suffix != ".toml" and not os.path.exists(source):
        available = f"available: {', '.join(scenario_names())}, or a TOML file"
        raise ScenarioError(f"unknown scenario '{shortened(printable(source), 200)}'; {available}")
    return {"name": name_of(path)} | with_file_paths(read(path), path.parent)


def _line_of(source: str, changes: Iterable[str]) -> Callable[[Location], str]:
    """A function that gives the line of a user's file in which a key stands; "" for keys in
    `changes`.
    """

    # the file is read only if there is an error to place, and once
    @cache
    def of_file() -> Callable[[Location], str]:
        if source in scenario_names() or Path(source).suffix != ".toml":
            return lambda _: ""
        return line_in(read_text(Path(source), LARGEST_BYTES), changes)

    return lambda location: of_file()(location)


def missing_extras(navigations: Iterable[tuple[str, Navigation]]) -> list[str]:
    """A line for each navigator that needs a package that is not installed; `navigations` are pairs
    of a key of the scenario and the navigation there.
    """
    lines = []
    for key, navigation in navigations:
        variant = navigation.variant
        missing = NAVIGATORS[variant].missing if variant in NAVIGATORS else ""
        lines += [f"{key}.variant: {variant!r} {missing}"] if missing else []
    return lines


def _checked(
    table: Mapping[str, Any],
    changes: Mapping[str, Any],
    name: str,
    where: Callable[[Location], str] = lambda _: "",
) -> Scenario:
    """A scenario whose sea, routes, date and cost are checked too."""
    # sea and hulls take half a second to import, and commands that read or list scenarios need
    # neither
    from sim.feasibility import infeasibilities

    def further(scenario: Scenario) -> list[str]:
        return [*missing_extras(scenario.navigations()), *infeasibilities(scenario)]

    return validate(assigned(table, changes), name, further=further, where=where)


def load_scenario(source: str, assignments: Iterable[str], *, flyable: bool = False) -> Scenario:
    """A built-in scenario or a TOML file, with overrides "key=value"; ScenarioError: missing or
    invalid.

    With `flyable`, sea, routes, date and cost are checked too, so that it can be flown, filmed and
    logged.
    """
    table = table_of(source)
    texts = list(assignments)
    changes = values_of(texts)
    name = " ".join([source, *(f"--set {shortened(a, 200)}" for a in texts)])
    where = _line_of(source, changes)
    if flyable:
        return _checked(table, changes, name, where)
    return validate(assigned(table, changes), name, where=where)


def table_of_changes(changes: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Changes of a scenario, none for None; ScenarioError if they are no table."""
    if changes is None:
        return {}
    if not isinstance(changes, Mapping):
        raise ScenarioError(
            "changes: expected a table of values by dotted key (given: "
            f"{printable(repr(changes)):.80})"
        )
    return changes


def as_scenario(
    source: str | Path | Mapping[str, Any] | Scenario, changes: Mapping[str, Any] | None = None
) -> Scenario:
    """Load a mission and check that it can be flown, filmed and logged; ScenarioError names every
    error.

    `source` is a built-in name ("T5", "following-sea", …), a TOML file, the table that it would
    hold, or a scenario; `changes` are values by dotted key, such as {"followers.0.depth_m": 12.0,
    "navigation.variant": "laisn-3-2"}.
    """
    changes = table_of_changes(changes)
    if isinstance(source, Scenario):
        # what it does not set remains unset, for those who choose where nothing is named
        table = source.model_dump(mode="json", exclude_none=True, exclude_unset=True)
        name = f"scenario {source.name!r}"
    elif isinstance(source, Mapping):
        table = dict(source)
        name = "scenario"
    else:
        table = table_of(str(source))
        name = str(source)
        return _checked(table, changes, name, _line_of(name, changes))
    return _checked(table, changes, name)


def text_of(value: object) -> str:
    """A value as `--set` takes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        bare = re.fullmatch(r"[A-Za-z][\w-]*", value) and value not in (
            "true",
            "false",
            "inf",
            "nan",
        )
        return value if bare else json.dumps(value, ensure_ascii=False)
    if isinstance(value, list | tuple):
        return f"[{','.join(map(text_of, value))}]"
    if isinstance(value, dict):
        return f"{{{','.join(f'{k}={text_of(v)}' for k, v in value.items())}}}"
    return repr(value)


def fly_line(
    source: str, settings: Mapping[str, Any], run: int, options: Iterable[str] = ()
) -> str:
    """The command that flies one run of a scenario with other settings, alone and with the very
    same noise, with other options first.
    """
    changes = (
        word for key, value in settings.items() for word in ("--set", f"{key}={text_of(value)}")
    )
    return shlex.join(["laisn", "fly", source, *options, "--run", str(run), *changes])


def descriptions() -> dict[str, str]:
    """What happens in each built-in scenario, by name."""
    toml = {name: FOLDER / f"{name}.toml" for name in scenario_names() if name not in ROUTES}
    first_lines = {
        name: path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        for name, path in toml.items()
    }
    return _DESCRIPTIONS | first_lines


def vehicle_rows() -> list[tuple[str, str, str, str]]:
    """Name, size, mass and effectors with their limits, of every vehicle."""
    import mujoco
    import numpy as np

    import models
    from sim.vehicle.effectors import kind_of
    from sim.vehicle.mjcf import VehicleSetup
    from sim.vehicle.plant import Plant
    from sim.water.ocean import Ocean

    rows = []
    for name in models.VEHICLES:
        plant = Plant([VehicleSetup(name=name, model=name, position_m=(0.0, 0.0, -10.0))], Ocean())
        model = mujoco.MjModel.from_xml_path(str(models.path(name)))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        # boxes about the visible parts, turned into the hull's frame
        rotation = data.geom_xmat.reshape(-1, 3, 3)
        centre, half_size = np.moveaxis(model.geom_aabb.reshape(-1, 2, 3), 1, 0)
        middle = data.geom_xpos + np.einsum("gij,gj->gi", rotation, centre)
        reach = np.einsum("gij,gj->gi", abs(rotation), half_size)
        sides = np.max(middle + reach, axis=0) - np.min(middle - reach, axis=0)
        size = " × ".join(f"{side:.2f}" for side in sides) + " m"
        groups = Counter[str]()
        # rows of a fleet are padded to the vehicle with most effectors
        for effector in plant.effectors[0, : len(plant.effector_names[0])]:
            kind = kind_of(effector)
            low, high = kind.unit_scale * effector["limits"]
            groups[f"{kind.label} {low:.4g} … {high:.4g} {kind.unit}".rstrip()] += 1
        mass = float(plant.model.body(f"{name}/hull").mass[0])
        rows.append(
            (name, size, f"{mass:.4g} kg", ", ".join(f"{n} {text}" for text, n in groups.items()))
        )
    return rows
