"""`laisn doctor`: what works on this machine, and what to install for the rest."""

import platform
import re
import shlex
import sys
from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from experiments.campaign.version import PACKAGES

_PROJECT, _ABSENT = "laisn-sim", "is not installed"


def _name(requirement: str) -> str:
    return re.split(r"[^\w.-]", requirement, maxsplit=1)[0].lower()


def _version(name: str) -> str:
    """Version of an installed package; nothing if it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _fault(name: str, modules: Mapping[str, str]) -> str:
    """Why a package cannot be used; empty if it can."""
    if not _version(name):
        return _ABSENT
    try:
        import_module(modules.get(name, name.replace("-", "_")))
    except Exception as error:
        # a broken package may raise anything
        return f"cannot be imported: {str(error).partition(chr(10))[0] or type(error).__name__}"
    return ""


def _modules() -> dict[str, str]:
    """The module to import by the package's name; where a package has several, the one of its own name."""
    found: dict[str, str] = {}
    for module, packages in packages_distributions().items():
        for package in packages:
            name = package.lower()
            if name not in found or module.lower() == name:
                found[name] = module
    return found


def faults() -> dict[str, str]:
    """Errors of the packages that this project requires, by requirement ("av>=18")."""
    try:
        required = [entry for entry in requires(_PROJECT) or () if "extra ==" not in entry]
    except PackageNotFoundError:
        return {_PROJECT: _ABSENT}
    modules = _modules()
    return {entry: fault for entry in required if (fault := _fault(_name(entry), modules))}


def _remedy(broken: Mapping[str, str]) -> str:
    if _PROJECT in broken:
        return "in the project's folder: pip install -e ."
    again = "" if set(broken.values()) == {_ABSENT} else "--force-reinstall "
    return f"in the project's folder: rm -r .venv && make run; elsewhere: pip install {again}{shlex.join(broken)}"


def _add_compiled_steps(table: Table) -> None:
    from sim.vehicle import mujoco_functions

    try:
        mujoco_functions.library()
    except mujoco_functions.UnavailableError as error:
        table.add_row("[red]no[/]", "compiled steps", escape(str(error)))
    else:
        table.add_row("[green]ok[/]", "compiled steps", "compiled code calls MuJoCo")


def _add_compiled_code(table: Table) -> None:
    from laisn.compiled import FOLDER

    if FOLDER is None:
        lacking = "not stored, every command compiles for 20 s: laisn-sim/compiled in XDG_CACHE_HOME or ~/.cache must "
        table.add_row("--", "compiled code", escape(lacking + "be writable and have mode 0700"))
    else:
        table.add_row("[green]ok[/]", "compiled code", escape(f"stored in {FOLDER}"))


def _first_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"


def _try_to_fly() -> tuple[str, str]:
    """Simulate, log, report and film two seconds of a mission.

    Returns:
        Why the flight failed, and why the film did; empty where they did not.
    """
    small = ["duration_s=2", "video.width_px=320", "video.height_px=180", "video.speed_up=20"]
    try:
        from experiments.campaign.progress import compiling_shown
        from experiments.command.fly import write_flight
        from experiments.flight.library import load_flyable

        with TemporaryDirectory(prefix="laisn-") as folder, compiling_shown():
            written = write_flight(load_flyable("T5", small), Path(folder), Console(quiet=True), with_video=True)
    except Exception as error:
        # a machine may fail in any way
        return _first_line(error), "no flight, no film"
    return "", _first_line(written.fault) if written.fault else written.no_film


def examine() -> int:
    """Print a table of what works; returns 0 if a mission can be simulated, even without a film, and 1 if not."""
    from sim.film import graphics

    table = Table("", "", "", box=None, show_header=False, pad_edge=False)

    def row(fine: bool, what: str, detail: str) -> None:
        table.add_row("[green]ok[/]" if fine else "[red]no[/]", what, escape(detail))

    able = sys.version_info >= (3, 11)
    row(able, "Python", f"{platform.python_version()}{'' if able else ', needs 3.11 or newer'}")
    number = _version("mujoco")
    right = number.startswith("4.")
    if number:
        row(right, "MuJoCo", f"{number}{'' if right else ', needs 4.0.0'}")
    broken = faults()
    for entry, fault in broken.items():
        row(False, _name(entry), fault)
    if broken:
        table.add_row("", "", escape(_remedy(broken)))
    else:
        _add_compiled_steps(table)
        _add_compiled_code(table)
    backends = graphics.probe()
    renders = any(backend.works for backend in backends)
    for backend in backends:
        if backend.works or not renders:
            row(backend.works, f"rendering with {backend.name}", backend.detail)
        else:
            table.add_row("--", f"rendering with {backend.name}", "not there, and not needed")
    if not renders and not broken:
        table.add_row("", "", graphics.INSTALL)
    no_flight, no_film = ("a package is missing",) * 2 if broken else _try_to_fly()
    row(not no_flight, "flight", no_flight or "flown, logged and reported: 2 s of T5")
    row(not no_film, "film", no_film or "of it: H.264")
    named = {_name(entry) for entry in broken}
    fine = (name for name in (_PROJECT, *PACKAGES) if name not in named)
    row(True, "packages", ", ".join(f"{name} {number}" for name in fine if (number := _version(name))))
    Console().print(table)
    return 0 if able and right and not no_flight else 1
