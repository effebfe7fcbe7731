"""Errors of the command: one message on one screen, and one exit code for each kind."""

import os
import platform
import shlex
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any, TypeVar, cast

import typer

from experiments.command.endings import received
from laisn.failure import LaisnError, LaisnWarning
from sim.screen import plain, screenful

Command = TypeVar("Command", bound=Callable[..., Any])

USER_ERROR, INTERNAL_ERROR, INTERRUPTED = 2, 1, 130
"""Exit codes: an error that the user can correct, a bug, Ctrl-C."""


def _print(lines: Iterable[str], colour: str) -> None:
    typer.secho("\n".join(screenful(lines)), fg=colour, err=True)


def _show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a warning of this project; those of libraries are for developers."""
    if issubclass(category, LaisnWarning):
        _print([f"laisn: {plain(message)}"], "yellow")


def _version() -> str:
    """Version of the code; a failure here must not prevent the report."""
    from experiments.campaign.version import code_version

    try:
        return code_version()
    except Exception as error:
        return f"of unknown version ({error})"


def _report(error: BaseException) -> str:
    """Write the traceback into a file that only this user can read; its path, or why there is none."""
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


def _outcome(error: BaseException) -> tuple[int, list[str]]:
    """Exit code and message for an exception, with the notes that were added to it."""
    notes = list(getattr(error, "__notes__", ()))
    signalled = received()
    if signalled is not None or isinstance(error, KeyboardInterrupt):
        kept = notes or ["finished files are kept, none is half-written"]
        return signalled.code if signalled else INTERRUPTED, ["; ".join(["interrupted", *kept])]
    if isinstance(error, LaisnError):
        return USER_ERROR, [*(str(error).splitlines() or [type(error).__name__]), *notes]
    if isinstance(error, OSError) and error.errno is not None:
        # from the system: a full disk, a folder without permission
        return USER_ERROR, [f"{error.filename or 'output'}: {error.strerror}", *notes]
    what = f"{type(error).__name__}: {plain(error)}" if str(error) else type(error).__name__
    return INTERNAL_ERROR, [f"this is a bug in the program ({what[:200]}); {_report(error)}", *notes]


def report_errors(command: Command) -> Command:
    """Make a command print its errors as one message and exit with their code.

    The traceback of a bug goes into a file that the message names. LAISN_DEBUG=1 shows tracebacks and all warnings
    instead.
    """

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> Any:
        debug = bool(os.environ.get("LAISN_DEBUG"))
        with warnings.catch_warnings():
            if not debug:
                warnings.showwarning = _show_warning
            try:
                return command(*args, **kwargs)
            except (typer.Exit, typer.Abort, BrokenPipeError):
                raise
            except (Exception, KeyboardInterrupt) as error:
                if debug and not isinstance(error, KeyboardInterrupt):
                    raise
                code, lines = _outcome(error)
        _print([f"laisn: {lines[0]}", *lines[1:]], "red" if code in (USER_ERROR, INTERNAL_ERROR) else "yellow")
        raise typer.Exit(code)

    return cast(Command, wrapped)
