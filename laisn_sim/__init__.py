"""LAISN-Sim from Python: fly missions, navigate again, film, read logs, and run studies.

>>> import laisn_sim
>>> flight = laisn_sim.fly("T5", {"duration_s": 60, "navigation.variant": "laisn-3-2"})
>>> laisn_sim.errors(flight).to_pandas()

Settings go by the names that they have in the files: `Scenario(followers=[{"route": "T5", "depth_m": 12}])` takes what
a scenario file may hold, and `study("T5", vary={"followers.0.depth_m": [10, 15]})` what a study file may. Numbers and
arrays of NumPy, tuples and ranges are values too. An error in the input is raised as a `LaisnError`, which is a
`ValueError`; `Scenario(...)` alone raises pydantic's `ValidationError`, another `ValueError`. Importing this module
costs nothing; what a function needs is imported when it is called.

Classes: `Flight`, `Scenario`, `StudyFolder`, `Table`, `Navigator`, `LaisnError`; see `help(laisn_sim.Flight)`.

`main` is the entry point of the `laisn` command.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any

    from experiments.flight.files import log_flight as write_log
    from experiments.flight.fly import navigate_again as navigate
    from experiments.flight.library import loaded as load
    from experiments.flight.tables import Table as Table
    from experiments.flight.tables import errors_table as errors
    from experiments.flight.tables import measurements_table as measurements
    from experiments.flight.tables import truth_table as truth
    from experiments.study.study import StudyFolder as StudyFolder
    from laisn.failure import LaisnError as LaisnError
    from laisn.navigator import Navigator as Navigator
    from sim.flight import Flight as Flight
    from sim.log.reader import read as read_log
    from sim.scenario.settings import Scenario as Scenario
    from sim.simulation import ControllerFactory

__all__ = [
    "errors",
    "fly",
    "hull",
    "load",
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
_PACKAGES = ("models", "laisn", "sim", "experiments")
_INTERRUPTED = b"laisn: interrupted\n"
_HOMES = {
    "Flight": "sim.flight:Flight",
    "LaisnError": "laisn.failure:LaisnError",
    "Navigator": "laisn.navigator:Navigator",
    "StudyFolder": "experiments.study.study:StudyFolder",
    "Scenario": "sim.scenario.settings:Scenario",
    "Table": "experiments.flight.tables:Table",
    "errors": "experiments.flight.tables:errors_table",
    "load": "experiments.flight.library:loaded",
    "measurements": "experiments.flight.tables:measurements_table",
    "navigate": "experiments.flight.fly:navigate_again",
    "read_log": "sim.log.reader:read",
    "truth": "experiments.flight.tables:truth_table",
    "write_log": "experiments.flight.files:log_flight",
}
"""Where the classes of this module, and functions that are taken as they are, stand."""


def _leave(*_: object) -> None:
    """End at once, as a command does that Ctrl-C interrupts."""
    os.write(2, _INTERRUPTED)
    os._exit(130)


def main() -> None:
    """Run the command with this project's packages, also where PYTHONPATH leads to others of the same names."""
    try:
        import signal

        # until the command obeys signals itself, there is nothing to tidy up; an exception could be lost or mistaken
        # within an import, and come with a traceback
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _leave)
        sys.path.insert(0, _ROOT)
        from experiments.command.cli import main as command

        command()
    except KeyboardInterrupt:
        # outside of a command that would say what is kept
        sys.stderr.write(_INTERRUPTED.decode())
        sys.exit(130)


def _require_own_packages() -> None:
    """ImportError if Python would import somebody else's package of the same name, such as a folder `models`."""
    from importlib.util import find_spec

    for name in _PACKAGES:
        spec = find_spec(name)
        place = os.path.realpath(spec.origin) if spec is not None and spec.origin else "nothing"
        if place != os.path.join(_ROOT, name, "__init__.py"):
            raise ImportError(
                f"`import {name}` finds {place} and not the package of laisn_sim in {_ROOT}: rename that one, or keep "
                "it off sys.path (the folder of the script that runs stands first on it)"
            )


def __getattr__(name: str) -> object:
    """Classes and functions that stand elsewhere, imported when they are first asked for."""
    if name not in _HOMES:
        raise AttributeError(
            f"module 'laisn_sim' has no attribute {name!r}; available: {', '.join(sorted((*__all__, *_HOMES)))}"
        )
    from importlib import import_module

    _require_own_packages()
    module, _, attribute = _HOMES[name].partition(":")
    found = globals()[name] = getattr(import_module(module), attribute)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_HOMES})


def fly(
    source: str | Path | Mapping[str, Any] | Scenario,
    changes: Mapping[str, Any] | None = None,
    *,
    controller: ControllerFactory | None = None,
) -> Flight:
    """Fly a mission: its vehicles move, sense and navigate.

    The same scenario gives the same flight, to the bit; {"run": 7} among the changes has the noise of run 7.

    Args:
        source: as of `load`.
        changes: as of `load`.
        controller: makes a controller of your own from the plant and the control of routes; see docs/extending.md.
            None: vehicles are controlled as the scenario says.

    Raises:
        LaisnError: as of `load`.
    """
    _require_own_packages()
    from experiments.flight.fly import fly as flown
    from experiments.flight.library import loaded

    return flown(loaded(source, changes), make_controller=controller)[0]


def summary(flight: Flight) -> dict[str, Any]:
    """Mean, largest and σ of a flight's errors, of all followers and of each, as in `summary.json`."""
    _require_own_packages()
    from experiments.flight.summary import position_and_bearing_errors, summarise

    return summarise(flight, position_and_bearing_errors(flight))


def render(
    flight: Flight, path: str | Path, *, time_s: float | None = None, follower: int = 0, **video: object
) -> Path:
    """Film a flight, or take a picture of it; gives the path of the file.

    Args:
        flight: as flown, or as read from a log.
        path: ends in .mp4 for a film, in .png for a picture.
        time_s: mission time of the picture [s]; None: film the whole mission.
        follower: index of the follower to keep to.
        video: settings of the film by their names in a scenario's [video]: camera, width_px, height_px, speed_up, …

    Raises:
        LaisnError: a setting is impossible, or nothing renders here (`laisn doctor` says why).
    """
    _require_own_packages()
    from experiments.flight.files import picture

    return picture(flight, path, time_s, follower, video)


def hull(role: str) -> str:
    """The MJCF of the project's own "leader" or "follower", to begin a hull of one's own with.

    A scenario flies the file that it names: `{"route": "T5", "model": "mine.xml"}`.

    Raises:
        LaisnError: there is no such model.
    """
    _require_own_packages()
    import models
    from laisn.failure import LaisnError

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
    **keys: Any,
) -> StudyFolder:
    """Fly a study, or what is missing of it, and write its tables and its page.

    Args:
        source: study file, one that ships ("depth"), the table that such a file would hold, or a scenario to vary.
        out: folder of the results; None: out/NAME.
        workers: local processes; None: one for each core.
        cluster: address of a Dask scheduler (tcp://…) to fly on.
        force: compute everything again.
        keys: of a study file: `runs`, `seas`, `seed`, `vary`, `draw`, `set`, `arm`, `design`, `points`, `report`; they
            replace what the source says, but `vary`, `draw` and `set` key by key.

    Raises:
        LaisnError: a line for each fault, before anything is flown; or a folder or cluster that cannot be used.
    """
    _require_own_packages()
    from experiments.study.study import run

    return run(source, keys, out, workers=workers, cluster=cluster, force=force)
