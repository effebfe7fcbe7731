"""How the command tells what went wrong: one message on one screen, and the traceback of a fault of ours in a file."""

import os
import platform
import shlex
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, TextIO, TypeVar, cast

import typer

from experiments.command.endings import told
from laisn.failure import LaisnError
from sim.screen import plain, screenful

Command = TypeVar("Command", bound=Callable[..., Any])

MENDABLE, OURS, INTERRUPTED = 2, 1, 130
"""Exit codes: what the user can do something about, a bug, Ctrl-C."""


def _tell(lines: Iterable[str], colour: str) -> None:
    typer.secho("\n".join(screenful(lines)), fg=colour, err=True)


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Show a damaged result as one line; other warnings as Python does."""

    def damaged(category: type[Warning]) -> bool:
        # what reads results takes long to import; where none was read, none is damaged
        store = sys.modules.get("experiments.campaign.store")
        return store is not None and issubclass(category, store.DamagedResult)

    with warnings.catch_warnings():
        usual = warnings.showwarning

        def show(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if damaged(category):
                _tell([f"laisn: {plain(message)}"], "yellow")
            else:
                usual(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        yield


def _notes(error: BaseException) -> list[str]:
    """What was added to an exception on its way, such as what is kept of a flight that failed."""
    return list(getattr(error, "__notes__", ()))


def _mendable(error: Exception) -> list[str] | None:
    """What a user is told who can do something about it; None if nobody but us can.

    An `OSError` with a number comes from the system: a full disk, a folder that is not theirs.
    """
    if isinstance(error, LaisnError):
        return str(error).splitlines()
    if isinstance(error, OSError) and error.errno is not None:
        return [f"{error.filename or 'output'}: {error.strerror}"]
    return None


def _version() -> str:
    """Version of the code; whatever is broken, this must not keep the report from being written."""
    from experiments.campaign.version import code_version

    try:
        return code_version()
    except Exception as error:
        return f"of unknown version ({error})"


def _report(error: Exception) -> str:
    """Write what a developer needs into a file that only this user can read; its path, or why there is none."""
    text = (
        f"laisn {_version()}, Python {platform.python_version()} on {platform.platform()}\n"
        f"{shlex.join(sys.argv)}\n\n{''.join(traceback.format_exception(error))}"
    )
    try:
        handle, path = tempfile.mkstemp(prefix="laisn-failure-", suffix=".txt")
        with open(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError as reason:
        return f"the traceback could not be written ({reason.strerror}); LAISN_DEBUG=1 shows it"
    return f"the traceback is in {path}"


def plain_errors(command: Command) -> Command:
    """Show an error as one message: exit code 2 for what a user can do something about, 1 for a bug.

    The traceback of such a fault goes into a file that the message names. LAISN_DEBUG=1 shows tracebacks instead.
    """

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> Any:
        try:
            with _plain_warnings():
                return command(*args, **kwargs)
        except (typer.Exit, typer.Abort, BrokenPipeError):
            raise
        except (Exception, KeyboardInterrupt) as error:
            ending = told()
            if ending is not None or isinstance(error, KeyboardInterrupt):
                kept = _notes(error) or ["finished files are kept, none is half-written"]
                _tell(["; ".join(["laisn: interrupted", *kept])], "yellow")
                if ending is not None:
                    ending.acknowledged = True
                raise typer.Exit(ending.code if ending else INTERRUPTED) from None
            if os.environ.get("LAISN_DEBUG"):
                raise
            words = _mendable(error)
            if words is not None:
                _tell([f"laisn: {words[0] if words else type(error).__name__}", *words[1:], *_notes(error)], "red")
                raise typer.Exit(MENDABLE) from None
            what = f"{type(error).__name__}: {plain(error)}" if str(error) else type(error).__name__
            _tell([f"laisn: this is a bug in the program ({what[:200]}); {_report(error)}", *_notes(error)], "red")
            raise typer.Exit(OURS) from None

    return cast(Command, wrapped)
