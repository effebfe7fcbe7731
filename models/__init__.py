"""Vehicles and ocean in MuJoCo's XML (MJCF), and the paths of their files."""

from functools import cache
from pathlib import Path

VEHICLES = ("leader", "follower", "remus100", "lauv", "bluerov2_heavy")
"""Names of the vehicles."""

_FOLDER = Path(__file__).resolve().parent


def path(name: str) -> Path:
    """File of the model `name`, one of VEHICLES or "ocean".

    Raises:
        ValueError: there is no such model; the message lists what exists.
    """
    if name not in _files():
        raise ValueError(f"unknown model {name!r:.100}; available: {', '.join(_files())}")
    return _files()[name]


@cache
def _files() -> dict[str, Path]:
    """Files of all models by their names."""
    return {file.stem: file for file in sorted(_FOLDER.glob("*.xml"))}
