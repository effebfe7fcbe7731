"""Progress of a command on a terminal or in a log, and literal text for both."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.table import Column, Table
from rich.text import Text

from sim.screen import plain

_LINE_EVERY_S = 10.0
_COMPILING = "compiling (once)"


class Advance(Protocol):
    """Reports finished items."""

    def __call__(self, count: int = 1) -> None:
        """`count` more are finished."""


Update = Callable[[float], None]
"""Reports the share that is done, 0 … 1."""
Phase = Callable[[str], AbstractContextManager[Update]]
"""Shows a named phase for as long as its context lasts."""


def literal(text: object, style: str = "") -> Text:
    """Text of a file, a path or a user as it is: no markup, no emoji code, no control character of it takes effect."""
    return Text(plain(text), style=style)


def tell(console: Console, text: object, label: str = "", style: str = "yellow") -> None:
    """Print a line of literal text, after a styled label if there is one."""
    console.print(Text.assemble((f"{label} ", style) if label else "", literal(text)), soft_wrap=True)


def show_table(
    console: Console, heads: Sequence[str], rows: Iterable[Sequence[str]], title: str = "", caption: str = ""
) -> None:
    """Print a table of literal text: names in the first column, at the left, and values at the right of the others."""
    columns = (Column(literal(head), justify="right" if n else "left") for n, head in enumerate(heads))
    table = Table(*columns, box=None, pad_edge=False)
    if title:
        table.title, table.title_justify = literal(title), "left"
    if caption:
        table.caption, table.caption_justify = literal(caption), "left"
    for row in rows:
        table.add_row(*map(literal, row))
    console.print(table)


def _count(functions: int) -> str:
    return f"{_COMPILING}: {functions} function{'s' if functions > 1 else ''}"


@contextmanager
def _compiling(console: Console, show: Callable[[int], None]) -> Iterator[None]:
    """Report compilation: `show` gets the number of functions on a terminal, 0 at the end; a log has one line."""
    # a process that only shows progress does not load the compiler
    from laisn.compiled import compiling

    printed = False

    def listener(functions: int) -> None:
        nonlocal printed
        if console.is_terminal:
            show(functions)
        elif functions and not printed:
            console.print(_COMPILING)
            printed = True

    with compiling(listener):
        yield


@contextmanager
def compiling_shown() -> Iterator[None]:
    """Print on standard error that code is compiled, and count the functions on a terminal while it is."""
    console = Console(stderr=True)
    status = console.status(_COMPILING)

    def show(functions: int) -> None:
        status.update(_count(functions))
        (status.start if functions else status.stop)()

    try:
        with _compiling(console, show):
            yield
    finally:
        status.stop()


@contextmanager
def phases(console: Console) -> Iterator[Phase]:
    """A bar for each phase of a flight, with the time left or taken, and whether it is compiling; none in a log."""
    columns = (
        TextColumn(f"{{task.description:<{len(_count(100))}}}"),
        BarColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    current: list[tuple[TaskID, str]] = []
    with Bars(*columns, console=console, disable=not console.is_terminal) as bars:

        def show(functions: int) -> None:
            for task, name in current[-1:]:
                bars.update(task, description=_count(functions) if functions else name, refresh=True)

        @contextmanager
        def phase(name: str) -> Iterator[Update]:
            task = bars.add_task(name, total=1.0)
            current.append((task, name))
            yield lambda done: bars.update(task, completed=done)
            current.pop()
            bars.update(task, completed=1.0)

        with _compiling(console, show):
            yield phase


@contextmanager
def progress(what: str, total: int, *, quiet: bool = False) -> Iterator[Advance]:
    """A bar on a terminal, a line every ten seconds in a log; nothing if there is nothing to do.

    In a log, rate and time left do not count the first item, which waited for processes and compilers to start.

    Args:
        what: is counted, such as "cells".
        total: number of them.
        quiet: show nothing.
    """
    console = Console(stderr=True)
    if quiet or total == 0:
        yield lambda count=1: None
        return
    if console.is_terminal:
        columns = (TextColumn(f"{what:<8}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Bars(*columns, console=console) as bars:
            task = bars.add_task(what, total=total)
            yield lambda count=1: bars.advance(task, count)
        return
    done, early = 0, 0
    start = shown = time.monotonic()

    def advance(count: int = 1) -> None:
        nonlocal done, early, start, shown
        now = time.monotonic()
        if done == 0:
            start, early = now, count
        done += count
        if done == total or now - shown >= _LINE_EVERY_S:
            rate = (done - early) / (now - start) if done > early and now > start else 0.0
            pace = f", {rate:.1f}/s, {(total - done) / rate:.0f} s left" if rate else ""
            console.print(f"{what}: {done}/{total}{pace}", highlight=False)
            shown = now

    yield advance
