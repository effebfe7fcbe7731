"""Vehicles and ocean in MuJoCo's XML (MJCF), and the one place that knows where they lie."""

from pathlib import Path

_FOLDER = Path(__file__).resolve().parent


def path(name: str) -> Path:
    """File of the model `name` ("leader", "follower", "ocean").

    Raises:
        ValueError: there is no such model; the message lists what exists.
    """
    file = _FOLDER / f"{name}.xml"
    if not file.is_file():
        available = ", ".join(sorted(p.stem for p in _FOLDER.glob("*.xml")))
        raise ValueError(f"unknown model {name!r}; available: {available}")
    return file
