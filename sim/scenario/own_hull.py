"""A user's own hull in a scenario: the name of its MJCF file becomes the text of the file.

A scenario that holds the text is whole: its log replays and its folder flies again wherever the file has gone.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from laisn.failure import LaisnError
from sim.files import read_text
from sim.screen import plain, shortened

MODEL = "model"
LONGEST = 1_000_000
"""Length of such a text, and size of its file [bytes]."""
_KEY = re.compile(rf"(leader|followers\.\d+)\.{MODEL}")


def is_mjcf(model: object) -> bool:
    """Whether this is the text of a hull, and not the name of its file."""
    return isinstance(model, str) and model.lstrip().startswith("<")


def is_model_key(key: str) -> bool:
    """Whether a dotted key of a scenario is that of a hull."""
    return _KEY.fullmatch(key) is not None


def beside(model: Any, folder: Path) -> Any:
    """The name of a hull's file as seen from here, for one that is named as seen from a folder."""
    return str(folder / model) if isinstance(model, str) and not is_mjcf(model) else model


def _vehicles(table: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The vehicles of a scenario's table that name a hull, with their keys."""
    followers = table.get("followers")
    listed = followers if isinstance(followers, list) else []
    for key, vehicle in [("leader", table.get("leader")), *((f"followers[{i}]", f) for i, f in enumerate(listed))]:
        if isinstance(vehicle, dict) and isinstance(vehicle.get(MODEL), str):
            yield f"{key}.{MODEL}", vehicle


def seen_from(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The table of a scenario file in a folder; changed in place: the hulls that it names lie beside the file."""
    for _, vehicle in _vehicles(table):
        vehicle[MODEL] = beside(vehicle[MODEL], folder)
    return table


def embed(table: dict[str, Any]) -> list[str]:
    """Put texts of hulls into a table, in the places of the names of their files; changed in place.

    Returns:
        A line for each file that cannot be read; the vehicle then has no hull of its own.
    """
    lines = []
    for key, vehicle in _vehicles(table):
        name = vehicle[MODEL]
        if is_mjcf(name):
            continue
        try:
            text = read_text(Path(name), LONGEST)
            reason = "" if is_mjcf(text) else "it is no XML"
        except LaisnError as error:
            text, reason = "", str(error)
        if reason:
            lines.append(f"  {key}: {shortened(plain(name), 200)}: cannot be read: {reason}")
            del vehicle[MODEL]
        else:
            vehicle[MODEL] = text
    return lines
