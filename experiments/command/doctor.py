"""`laisn doctor`: what works on this machine, and what to install for the rest."""

import platform
import re
import shlex
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from experiments.campaign.version import PACKAGES
from laisn.failure import LaisnError

_PROJECT, _ABSENT = "laisn-sim", "is not installed"


def _name(requirement: str) -> str:
    return re.split(r"[^\w.-]", requirement, maxsplit=1)[0].lower()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _package_errors() -> dict[str, str]:
    """Errors of the packages that this project requires, by requirement ("av>=18")."""
    try:
        required = [entry for entry in requires(_PROJECT) or () if "extra ==" not in entry]
    except PackageNotFoundError:
        return {_PROJECT: _ABSENT}
    modules: dict[str, str] = {}
    for module, packages in packages_distributions().items():
        for package in map(str.lower, packages):
            # of several modules of a package, the one of the same name
            if package not in modules or module.lower() == package:
                modules[package] = module
    broken = {}
    for entry in required:
        name = _name(entry)
        try:
            if _version(name):
                import_module(modules.get(name, name.replace("-", "_")))
            else:
                broken[entry] = _ABSENT
        except Exception as error:
            # a broken package may raise any exception
            broken[entry] = f"cannot be imported: {str(error).partition(chr(10))[0] or type(error).__name__}"
    return broken


def _first_line(error: BaseException) -> str:
    kind = "" if isinstance(error, LaisnError) else f"{type(error).__name__}: "
    return kind + str(error).partition("\n")[0]


def _try_to_fly() -> tuple[str, str]:
    """Errors of a flight of two seconds, and of its film; empty if there is none."""
    small = ["duration_s=2", "video.width_px=320", "video.height_px=180", "video.speed_up=20"]
    try:
        from experiments.campaign.progress import compiling_shown
        from experiments.command.fly import write_flight
        from experiments.flight.library import load_flyable

        with TemporaryDirectory(prefix="laisn-") as folder, compiling_shown():
            *_, film_error = write_flight(load_flyable("T5", small), Path(folder), Console(quiet=True), with_video=True)
    except Exception as error:
        # any failure of this machine
        return _first_line(error), "no flight"
    return "", _first_line(film_error) if film_error else ""


def examine() -> int:
    """Print a table of what works; returns 0 if a mission can be simulated, even without a film, and 1 if not."""
    from sim.film import graphics

    table = Table("", "", "", box=None, show_header=False, pad_edge=False)

    def row(fine: bool | None, what: str, detail: str) -> None:
        """A line for what works, does not work, or is not needed (None)."""
        mark = "--" if fine is None else "[green]ok[/]" if fine else "[red]no[/]"
        table.add_row(mark, what, escape(detail))

    row(True, "Python", platform.python_version())
    number = _version("mujoco")
    right = number.startswith("4.")
    if number:
        row(right, "MuJoCo", f"{number}{'' if right else ', needs 4.0.0'}")
    broken = _package_errors()
    for entry, error in broken.items():
        row(False, _name(entry), error)
    if broken:
        again = "" if set(broken.values()) == {_ABSENT} else "--force-reinstall "
        install = f"rm -r .venv && make run; elsewhere: pip install {again}{shlex.join(broken)}"
        remedy = "pip install -e ." if _PROJECT in broken else install
        table.add_row("", "", escape(f"in the project's folder: {remedy}"))
    else:
        from laisn.compiled import FOLDER
        from sim.vehicle import plant

        try:
            plant.library()
            row(True, "compiled steps", "compiled code calls MuJoCo")
        except plant.UnavailableError as error:
            row(False, "compiled steps", str(error))
        writable = "laisn-sim/compiled in XDG_CACHE_HOME or ~/.cache must be writable and have mode 0700"
        missing = f"not stored, every command compiles: {writable}"
        row(bool(FOLDER) or None, "compiled code", f"stored in {FOLDER}" if FOLDER else missing)
    backends = graphics.probe()
    renders = any(backend.works for backend in backends)
    for backend in backends:
        needed = backend.works or not renders
        detail = backend.detail if needed else "not available, not needed"
        row(backend.works if needed else None, f"rendering with {backend.name}", detail)
    if not renders and not broken:
        table.add_row("", "", graphics.INSTALL)
    no_flight, no_film = ("a package is missing",) * 2 if broken else _try_to_fly()
    row(not no_flight, "flight", no_flight or "2 s of T5 simulated, logged and reported")
    row(not no_film, "film", no_film or "rendered in H.264")
    named = {_name(entry) for entry in broken}
    fine = (name for name in (_PROJECT, *PACKAGES) if name not in named)
    row(True, "packages", ", ".join(f"{name} {number}" for name in fine if (number := _version(name))))
    Console().print(table)
    return 0 if right and not no_flight else 1
