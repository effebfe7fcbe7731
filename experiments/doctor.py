"""What this machine can do, and what to install for the rest."""

import platform
import sys
from importlib.metadata import version

from rich.console import Console
from rich.table import Table

PACKAGES = ("mujoco", "numpy", "scipy", "filterpy", "numba", "mcap", "av", "pyarrow")


def versions() -> dict[str, str]:
    """Versions of this project and of the packages that shape its results."""
    return {name: version(name) for name in ("laisn-sim", *PACKAGES)} | {"python": platform.python_version()}


def _encodes_h264() -> bool:
    import av
    from av.error import FFmpegError

    try:
        return bool(av.codec.Codec("libx264", "w").is_encoder)
    except (FFmpegError, ValueError):
        return False


def examine() -> int:
    """Print a table of abilities; 0 if a mission can be flown, 1 if not. Film alone may be missing."""
    from sim import graphics

    table = Table("", "", "", box=None, show_header=False, pad_edge=False)

    def row(fine: bool, what: str, detail: str) -> None:
        table.add_row("[green]ok[/]" if fine else "[red]no[/]", what, detail)

    able = sys.version_info >= (3, 11)
    row(able, "Python", f"{platform.python_version()}{'' if able else ', needs 3.11 or newer'}")
    found = versions()
    right = found["mujoco"].startswith("4.")
    row(right, "MuJoCo", f"{found['mujoco']}{'' if right else ', needs 4.0.0'}")
    backends = graphics.probe()
    renders = any(backend.works for backend in backends)
    for backend in backends:
        if backend.works or not renders:
            row(backend.works, f"rendering with {backend.name}", backend.detail)
        else:
            table.add_row("--", f"rendering with {backend.name}", "not there, and not needed")
    if not renders:
        table.add_row("", "", graphics.INSTALL)
    row(_encodes_h264(), "H.264", "film and camera channel")
    row(True, "packages", ", ".join(f"{name} {number}" for name, number in found.items()))
    Console().print(table)
    return 0 if able and right else 1
