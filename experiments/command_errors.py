"""How the command tells what went wrong: one message, not a traceback."""

import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, TextIO, TypeVar, cast

import typer

from experiments.failures import DamagedResult, is_own

Command = TypeVar("Command", bound=Callable[..., Any])


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Show a damaged result as one line; other warnings as Python does."""
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
            if issubclass(category, DamagedResult):
                typer.secho(f"laisn: {message}", fg="yellow", err=True)
            else:
                usual(message, category, filename, lineno, file, line)

        warnings.showwarning = show
        yield


def _notes(error: BaseException) -> list[str]:
    """What was added to an exception on its way, such as what is kept of a flight that failed."""
    return list(getattr(error, "__notes__", ()))


def plain_errors(command: Command) -> Command:
    """Show an error as one message: exit code 2 for what the user can mend in the input, 1 for failures of our own.

    LAISN_DEBUG=1 shows the traceback; so does every exception that nobody here has foreseen.
    """

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> Any:
        try:
            with _plain_warnings():
                return command(*args, **kwargs)
        except KeyboardInterrupt as error:
            kept = _notes(error) or ["finished files are kept, none is half-written"]
            typer.secho("; ".join(["laisn: interrupted", *kept]), fg="yellow", err=True)
            raise typer.Exit(130) from None
        except Exception as error:
            mendable = isinstance(error, (ValueError, OSError))
            if os.environ.get("LAISN_DEBUG") or not (mendable or is_own(error)):
                raise
            text = str(error)
            if isinstance(error, OSError) and error.strerror:
                text = f"{error.filename or 'output'}: {error.strerror}"
            typer.secho("\n".join([f"laisn: {text}", *_notes(error)]), fg="red", err=True)
            raise typer.Exit(2 if mendable else 1) from None

    return cast(Command, wrapped)
