"""`laisn doctor`: what works on this machine, and what to install for the rest."""

import platform
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from laisn.errors import LaisnError
from reports.version import PACKAGES


def _first_line(error: BaseException) -> str:
    kind = "" if isinstance(error, LaisnError) else f"{type(error).__name__}: "
    return kind + str(error).partition("\n")[0]


def _try_to_fly() -> tuple[str, str]:
    """Errors of a flight of two seconds, and of its film; empty if there is none."""
    small = ["duration_s=2", "video.width_px=320", "video.height_px=180", "video.speed_up=20"]
    try:
        from experiments.campaign.progress import compiling_shown
        from experiments.flight.library import load_scenario
        from laisn_sim.cli.fly import write_flight

        with TemporaryDirectory(prefix="laisn-") as folder, compiling_shown():
            *_, film_error = write_flight(
                load_scenario("T5", small, flyable=True),
                Path(folder),
                Console(quiet=True),
                with_video=True,
            )
    except Exception as error:
        # any failure of this machine
        return _first_line(error), "no flight"
    return "", _first_line(film_error) if film_error else ""


_MARKS = {True: "[green]ok[/]", False: "[red]no[/]", None: "--"}


def examine() -> int:
    """Print a table of what works; returns 0 if a mission can be simulated, even without a film,
    and 1 if not.
    """
    from laisn.compiled import FOLDER
    from sim.film import graphics

    table = Table("", "", "", box=None, show_header=False, pad_edge=False)

    def row(fine: bool | None, capability: str, detail: str) -> None:
        """A line for what works, does not work, or is not needed (None)."""
        table.add_row(_MARKS[fine], capability, escape(detail))

    row(True, "Python", platform.python_version())
    row(True, "packages", ", ".join(f"{name} {version(name)}" for name in ("laisn-sim", *PACKAGES)))
    writable = (
        "laisn-sim/compiled in XDG_CACHE_HOME or ~/.cache must be writable and have mode 0700"
    )
    missing = f"not stored, every command compiles: {writable}"
    row(bool(FOLDER) or None, "compiled code", f"stored in {FOLDER}" if FOLDER else missing)
    backends = graphics.probe()
    renders = any(backend.works for backend in backends)
    for backend in backends:
        is_needed = backend.works or not renders
        detail = backend.detail if is_needed else "not available, not needed"
        row(backend.works if is_needed else None, f"rendering with {backend.name}", detail)
    if not renders:
        table.add_row("", "", graphics.INSTALL)
    no_flight, no_film = _try_to_fly()
    row(not no_flight, "flight", no_flight or "2 s of T5 simulated, logged and reported")
    row(not no_film, "film", no_film or "rendered in H.264")
    Console().print(table)
    return 1 if no_flight else 0
