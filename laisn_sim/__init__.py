"""LAISN-Sim from Python: fly missions, navigate again, film, read logs, and run studies.

>>> import laisn_sim
>>> flight = laisn_sim.fly("T5", {"duration_s": 60, "navigation.variant": "laisn-3-2"})
>>> laisn_sim.errors(flight).to_pandas()
>>> flight.plot().show()
>>> flight.report("t5.html")

Settings have the names of the files: `Scenario(followers=[{"route": "T5", "depth_m": 12}])` takes
the keys of a scenario file, and `study("T5", vary={"followers.0.depth_m": [10, 15]})` those of a
study file. Numbers and arrays of NumPy, tuples and ranges are values too. Invalid input raises
`LaisnError`, a `ValueError`; `Scenario(...)` alone raises pydantic's `ValidationError`, another
`ValueError`. A function imports what it needs at its first use.

Classes: `Simulation`, `Simulations`, `Flight`, `Scenario`, `StudyFolder`, `Table`, `Navigator`,
`Command`, `Wrench`, `VehicleTruth`, `EffectorKind`, `LaisnError`.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any

    from experiments.flight.library import as_scenario as load
    from experiments.flight.results import Flight as Flight
    from experiments.flight.results import fly, navigate, read_log, render
    from experiments.flight.results import log_flight as write_log
    from experiments.study.study import StudyFolder as StudyFolder
    from laisn.errors import LaisnError as LaisnError
    from laisn.navigator import Navigator as Navigator
    from laisn.plugins import load_plugin
    from laisn_sim.simulation import Simulation as Simulation
    from laisn_sim.simulation import VehicleTruth as VehicleTruth
    from laisn_sim.simulations import Simulations as Simulations
    from reports.summary import summarise as summary
    from reports.tables import Table as Table
    from reports.tables import errors_table as errors
    from reports.tables import measurements_table as measurements
    from reports.tables import truth_table as truth
    from sim.custom_control import Command as Command
    from sim.custom_control import Wrench as Wrench
    from sim.scenario.settings import Scenario as Scenario
    from sim.vehicle.effector_kinds import EffectorKind as EffectorKind

__all__ = [
    "errors",
    "fly",
    "hull",
    "load",
    "load_plugin",
    "measurements",
    "navigate",
    "read_log",
    "render",
    "study",
    "summary",
    "truth",
    "write_log",
]

_ROOT = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
_PACKAGES = ("models", "laisn", "sim", "reports", "experiments")
_INTERRUPTED = b"laisn: interrupted\n"
_HOMES = {
    "Command": "sim.custom_control:Command",
    "Wrench": "sim.custom_control:Wrench",
    "EffectorKind": "sim.vehicle.effector_kinds:EffectorKind",
    "LaisnError": "laisn.errors:LaisnError",
    "Navigator": "laisn.navigator:Navigator",
    "Scenario": "sim.scenario.settings:Scenario",
    "Simulation": "laisn_sim.simulation:Simulation",
    "Simulations": "laisn_sim.simulations:Simulations",
    "VehicleTruth": "laisn_sim.simulation:VehicleTruth",
    "StudyFolder": "experiments.study.study:StudyFolder",
    "load": "experiments.flight.library:as_scenario",
    "load_plugin": "laisn.plugins:load_plugin",
    "Table": "reports.tables:Table",
    "errors": "reports.tables:errors_table",
    "measurements": "reports.tables:measurements_table",
    "truth": "reports.tables:truth_table",
    "Flight": "experiments.flight.results:Flight",
    "fly": "experiments.flight.results:fly",
    "navigate": "experiments.flight.results:navigate",
    "read_log": "experiments.flight.results:read_log",
    "render": "experiments.flight.results:render",
    "summary": "reports.summary:summarise",
    "write_log": "experiments.flight.results:log_flight",
}


def _exit_interrupted(*_: object) -> None:
    os.write(2, _INTERRUPTED)
    os._exit(130)


def main() -> None:
    """Run the command with this project's packages, even if PYTHONPATH has others of the same
    names.
    """
    try:
        import signal

        # until the command handles signals, there is nothing to clean up; an exception within an
        # import could be lost or end in a traceback
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _exit_interrupted)
        sys.path.insert(0, _ROOT)
        from laisn_sim.cli.main import main as command

        command()
    except KeyboardInterrupt:
        # outside of a command, which would report what is kept
        sys.stderr.write(_INTERRUPTED.decode())
        sys.exit(130)


def _require_own_packages() -> None:
    """ImportError if Python would import another package of the same name, such as a folder
    `models`.
    """
    from importlib.util import find_spec

    for name in _PACKAGES:
        spec = find_spec(name)
        location = os.path.realpath(spec.origin) if spec is not None and spec.origin else "nothing"
        if location != os.path.join(_ROOT, name, "__init__.py"):
            raise ImportError(
                f"`import {name}` finds {location}, expected the package of laisn_sim in {_ROOT}: "
                "rename the former, or remove its folder from sys.path (the folder of the running "
                "script is its first entry)"
            )


def __getattr__(name: str) -> object:
    """Import a class or function at its first use."""
    if name not in _HOMES:
        raise AttributeError(
            f"module 'laisn_sim' has no attribute {name!r}; available: "
            f"{', '.join(sorted({*__all__, *_HOMES}))}"
        )
    from pkgutil import resolve_name

    _require_own_packages()
    member = globals()[name] = resolve_name(_HOMES[name])
    return member


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_HOMES})


def hull(role: str) -> str:
    """The MJCF of the project's "leader" or "follower", a start for a hull of one's own; LaisnError
    if there is none.

    A scenario names the file of a hull: `{"route": "T5", "model": "mine.xml"}`.
    """
    _require_own_packages()
    import models
    from laisn.errors import LaisnError

    try:
        return models.path(role).read_text(encoding="utf-8")
    except ValueError as error:
        raise LaisnError(str(error)) from None


def study(
    source: str | Path | Mapping[str, Any],
    *,
    out: str | Path | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    force: bool = False,
    navigators: Mapping[str, str | type] | None = None,
    **keys: Any,
) -> StudyFolder:
    """Run a study, or what is missing of its results, and write its tables and its page.

    Args:
        source: study file, a built-in one ("depth"), the table of such a file, or a scenario to
            vary.
        out: folder of the results; None: out/NAME.
        workers: local processes; None: one for each core.
        cluster: address of a Dask scheduler (tcp://…) to compute on.
        force: compute everything again.
        navigators: arms by name: a navigator's name, or a class of one's own, at the top of a file
            of its own.
        keys: of a study file: `runs`, `realizations`, `seed`, `vary`, `draw`, `set`, `arm`,
            `design`, `points`, `report`; they replace those of the source; `vary`, `draw` and `set`
            do so key by key.

    Raises:
        LaisnError: a line for each invalid key, before the first simulation; or the folder or
            cluster cannot be used.
    """
    _require_own_packages()
    from experiments.study.study import run
    from laisn.plugins import register, require_factory

    if navigators is not None:
        for name, navigator in navigators.items():
            if not isinstance(navigator, str):
                require_factory(f"navigators: {name}", navigator)
        names = {
            k: v if isinstance(v, str) else register(v, importable=True)
            for k, v in navigators.items()
        }
        keys["arm"] = [
            {"name": name, "navigation.variant": variant} for name, variant in names.items()
        ]
    return run(source, keys, out, workers=workers, cluster=cluster, force=force, quiet=True)
