"""How the command ends: errors as one message on one screen, an exit code for each kind, signals
like Ctrl-C.
"""

import errno
import gc
import io
import os
import platform
import re
import shlex
import signal
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from types import FrameType
from typing import Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

from laisn.errors import LaisnError, LaisnWarning, printable, screenful
from laisn.plugins import PluginError, plugin_errors

# exit codes
USER_ERROR = 2  # an error that the user can correct
INTERNAL_ERROR = 1  # a bug
MISSION_FAILED = 3  # a mission that was not flown to its end; its results are written
INTERRUPTED = 130  # Ctrl-C

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_NO_PERMISSION = (errno.EACCES, errno.EPERM, errno.EROFS)


def _print(lines: Iterable[str], colour: str) -> None:
    typer.secho("\n".join(screenful(lines)), fg=colour, err=True)


def _show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a warning of this project; those of libraries are for developers."""
    if issubclass(category, LaisnWarning):
        _print([f"laisn: {printable(message)}"], "yellow")


def _write_traceback(error: BaseException) -> str:
    """Write the traceback into a file that only this user can read; returns a sentence that says
    where it is, or why there is none.
    """
    system = (
        f"laisn-sim {version('laisn-sim')}, Python {platform.python_version()} on "
        f"{platform.platform()}"
    )
    text = f"{system}\n{shlex.join(sys.argv)}\n\n{''.join(traceback.format_exception(error))}"
    try:
        handle, path = tempfile.mkstemp(prefix="laisn-failure-", suffix=".txt")
        with open(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError as reason:
        return f"the traceback could not be written ({reason.strerror}); LAISN_DEBUG=1 shows it"
    return f"the traceback is in {path}"


def _system_error(error: OSError) -> str:
    """What the system refuses, where, and what to do about it."""
    text = f"{error.filename or 'output'}: {error.strerror}"
    if error.errno in _NO_ROOM:
        return f"{text}; make room there, or choose another folder"
    if error.errno in _NO_PERMISSION:
        return f"{text}; choose a folder that you can write to"
    return text


def _outcome(error: BaseException) -> tuple[int, list[str]]:
    """Exit code and message for an exception, with the notes that were added to it."""
    notes = list(getattr(error, "__notes__", ()))
    # libraries in C and Rust may replace the exception of a signal by an error of their own
    if _signals or isinstance(error, KeyboardInterrupt):
        remarks = notes or ["finished files are kept, none is half-written"]
        return 128 + _signals[-1] if _signals else INTERRUPTED, [
            "; ".join(["interrupted", *remarks])
        ]
    if isinstance(error, LaisnError):
        if isinstance(error, PluginError):
            notes.append("LAISN_DEBUG=1 shows all calls")
        return USER_ERROR, [*(str(error).splitlines() or [type(error).__name__]), *notes]
    if isinstance(error, OSError) and error.errno is not None:
        return USER_ERROR, [_system_error(error), *notes]
    text = (f"{type(error).__name__}: {printable(error)}" if str(error) else type(error).__name__)[
        :200
    ]
    compiled = sys.modules.get("laisn.compiled")
    if compiled is not None and compiled.remove_if_damaged(error):
        return USER_ERROR, [
            f"compiled code could not be read and is removed ({text}); run the command again"
        ]
    return INTERNAL_ERROR, [
        f"this is a bug in the program ({text}); {_write_traceback(error)}",
        *notes,
    ]


@contextmanager
def report_errors() -> Iterator[None]:
    """Print an error of the block as one message and exit with its code; LAISN_DEBUG=1 shows
    tracebacks.
    """
    debug = bool(os.environ.get("LAISN_DEBUG"))
    with warnings.catch_warnings():
        if not debug:
            warnings.showwarning = _show_warning
        try:
            with plugin_errors():
                yield
            return
        except (typer.Exit, typer.Abort, TyperException, BrokenPipeError):
            raise
        except (Exception, KeyboardInterrupt) as error:
            if debug and not isinstance(error, KeyboardInterrupt):
                raise
            code, lines = _outcome(error)
    _print(
        [f"laisn: {lines[0]}", *lines[1:]],
        "red" if code in (USER_ERROR, INTERNAL_ERROR) else "yellow",
    )
    raise typer.Exit(code)


_MARKUP = re.compile(r"(\\*)(\[[a-z#/@][^\[]*?\])")
"""What Rich takes for a style, and leaves out: a unit such as [m]."""
_MIN_COLUMNS = 20  # of the terminal, for help texts


def _escape_markup(command: Any) -> None:
    """Escape what Rich would take for markup in the help texts of a command and its
    subcommands.
    """
    for option in command.params:
        if getattr(option, "help", None):
            option.help = _MARKUP.sub(r"\1\1\\\2", option.help)
    for inner in getattr(command, "commands", {}).values():
        _escape_markup(inner)


class Commands(TyperGroup):
    """Subcommands whose errors are reported by `report_errors`."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        # shells show help as it is
        if not any(name.endswith("_COMPLETE") for name in os.environ):
            _escape_markup(self)

    def main(self, *arguments: Any, **options: Any) -> Any:
        """Run the command; a width in the environment variable `COLUMNS` below `_MIN_COLUMNS`, or
        one that is no number, is ignored.
        """
        columns = os.environ.get("COLUMNS", "")
        if columns and not (columns.isdecimal() and int(columns) >= _MIN_COLUMNS):
            del os.environ["COLUMNS"]
        return super().main(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        with report_errors():
            return super().invoke(ctx)


def echo(text: object) -> None:
    """Print a line of text from a file or a user without control characters."""
    typer.echo(printable(text))


_signals: list[int] = []  # numbers of the signals that interrupted this process, in their order


def _interrupt(number: int, _: FrameType | None) -> None:
    if number != signal.SIGINT:
        # once, so that only a second Ctrl-C can interrupt the clean-up
        signal.signal(number, signal.SIG_IGN)
    _signals.append(number)
    raise KeyboardInterrupt(signal.Signals(number).name)


def handle_signals() -> None:
    """Raise `KeyboardInterrupt` for SIGINT, SIGTERM and SIGHUP, unless the process was started
    to ignore them.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def run(app: typer.Typer) -> None:
    """Run the command; exit code 1 if standard output is closed, 2 if it cannot be written."""
    handle_signals()
    if not os.environ.get("LAISN_DEBUG"):
        # warnings of libraries in child processes
        os.environ.setdefault("PYTHONWARNINGS", "ignore")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        app()
    finally:
        ended = sys.exc_info()[1]
        # what is left goes with the process; Python would search all of it for garbage, several
        # times
        gc.freeze()
        if signal.getsignal(signal.SIGINT) is _interrupt:
            # Python's own finalisation has nothing to clean up
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        try:
            if sys.stdout is not None:
                sys.stdout.flush()
        except OSError as error:
            # Python would flush again at its end, and print a traceback
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            if isinstance(error, BrokenPipeError):
                sys.exit(1)
            # the buffer may still hold what has failed, and was reported, before
            if not (isinstance(ended, SystemExit) and ended.code):
                sys.stderr.write(f"laisn: output: {error.strerror}\n")
                sys.exit(USER_ERROR)
