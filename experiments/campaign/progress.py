"""What a terminal shows while a command works: how far it is, how long that will take, what is compiled on first use.

Words of ours may be styled; what files, paths and users say stands as it is.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import timedelta
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bars
from rich.text import Text

from sim.screen import plain

_LINE_EVERY_S = 10.0
_COMPILING = "compiling (once)"


class Advance(Protocol):
    """Told how much more is done."""

    def __call__(self, count: int = 1) -> None:
        """`count` more are done."""


Update = Callable[[float], None]
"""Told the share that is done, 0 … 1."""
Phase = Callable[[str], AbstractContextManager[Update]]
"""Shows a named phase for as long as its context lasts."""


def literal(text: object, style: str = "") -> Text:
    """Text of a file, a path or a user as it is: no markup, no emoji code, no control character of it takes effect."""
    return Text(plain(text), style=style)


def tell(console: Console, text: object, label: str = "", style: str = "yellow") -> None:
    """Print a line of literal text, behind a styled label of ours if there is one."""
    console.print(Text.assemble((f"{label} ", style) if label else "", literal(text)), soft_wrap=True)


class _Rate(ProgressColumn):
    """Items a second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text(f"{speed:.1f}/s" if speed else "–/s", style="progress.data.speed")


class _Left(ProgressColumn):
    """Time left, where it can be told."""

    def render(self, task: Task) -> Text:
        left = task.time_remaining
        told = "" if left is None or task.finished else f"{timedelta(seconds=round(left))} left"
        return Text(told, style="progress.remaining")


def _compiling(functions: int) -> str:
    return f"{_COMPILING}: {functions} function{'s' if functions > 1 else ''}"


@contextmanager
def compiling_shown() -> Iterator[None]:
    """Print on standard error that code is compiled, and count the functions on a terminal while it is."""
    # a process that only shows progress does not load the compiler
    from laisn.compiled import compiling

    console = Console(stderr=True)
    status = console.status(_COMPILING)
    told = False

    def tell(functions: int) -> None:
        nonlocal told
        if functions and console.is_terminal:
            status.update(_compiling(functions))
            status.start()
        elif functions and not told:
            console.print(_COMPILING)
        elif not functions:
            status.stop()
        told = told or functions > 0

    with compiling(tell):
        try:
            yield
        finally:
            status.stop()


@contextmanager
def phases(console: Console) -> Iterator[Phase]:
    """A bar for each phase of a flight, with its time, what is left of it, and whether it is compiling.

    On a terminal the bars stay; in a log there is only a line where code is compiled.
    """
    from laisn.compiled import compiling

    width = len(_compiling(100))
    columns = (TextColumn(f"{{task.description:<{width}}}"), BarColumn(), TimeElapsedColumn(), _Left())
    told = False
    with Bars(*columns, console=console, disable=not console.is_terminal) as bars:

        @contextmanager
        def phase(name: str) -> Iterator[Update]:
            task = bars.add_task(name, total=1.0)

            def tell(functions: int) -> None:
                nonlocal told
                bars.update(task, description=_compiling(functions) if functions else name, refresh=True)
                if functions and not (console.is_terminal or told):
                    console.print(_COMPILING)
                told = told or functions > 0

            with compiling(tell):
                yield lambda done: bars.update(task, completed=done)
            bars.update(task, completed=1.0)

        yield phase


@contextmanager
def progress(what: str, total: int, *, quiet: bool = False) -> Iterator[Advance]:
    """A bar on a terminal, a line every ten seconds in a log; nothing where there is nothing to do.

    Rate and time left are those since the first item was done, which has waited for processes and compilers to start.

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
        columns = (TextColumn(f"{what:<8}"), BarColumn(), MofNCompleteColumn(), _Rate(), TimeRemainingColumn())
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
