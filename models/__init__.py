"""Vehicles and ocean in MuJoCo's XML (MJCF), and the paths of their files."""

from pathlib import Path

VEHICLES = ("leader", "follower", "remus100", "lauv", "bluerov2_heavy")
"""Names of the vehicles."""

_FOLDER = Path(__file__).resolve().parent


def path(name: str) -> Path:
    """File of the model `name`, one of VEHICLES or "ocean".

    Raises:
        ValueError: there is no such model; the message lists what exists.
    """
    available = {file.stem: file for file in sorted(_FOLDER.glob("*.xml"))}
    if name not in available:
        raise ValueError(f"unknown model {name!r:.100}; available: {', '.join(available)}")
    return available[name]
