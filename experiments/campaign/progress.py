"""Progress of a command on a terminal or in a log, and literal text for both."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.table import Column, Table
from rich.text import Text

from laisn.failure import plain

_LINE_EVERY_S = 10.0
_COMPILING = "compiling (once)"
_COUNT_EVERY_S = 0.5

Advance = Callable[[int], None]
"""Reports that so many more items are finished."""
Update = Callable[[float], None]
"""Reports the share that is done, 0 … 1."""
Phase = Callable[[str], AbstractContextManager[Update]]
"""Shows a named phase for as long as its context lasts."""


def literal(text: object, style: str = "") -> Text:
    """Text of a file, a path or a user as it is: no markup, no emoji code, no control character of it takes effect."""
    return Text(plain(text), style=style)


def print_line(console: Console, text: object, label: str = "", style: str = "yellow") -> None:
    """Print a line of literal text, after a styled label if there is one."""
    console.print(Text.assemble((f"{label} ", style) if label else "", literal(text)), soft_wrap=True)


def show_table(
    console: Console, heads: Sequence[str], rows: Iterable[Sequence[str]], title: str = "", caption: str = ""
) -> None:
    """Print a table of literal text: names in the first column, at the left, and values at the right of the others."""
    columns = (Column(literal(head), justify="right" if n else "left") for n, head in enumerate(heads))
    table = Table(
        *columns, title=literal(title) if title else None, title_justify="left",
        caption=literal(caption) if caption else None, caption_justify="left", box=None, pad_edge=False,
    )  # fmt: skip
    for row in rows:
        table.add_row(*map(literal, row))
    console.print(table)


def _bars(console: Console, *columns: ProgressColumn) -> Bars:
    """Bars with names and the time left or taken, which on anything but a terminal show nothing."""
    left = TimeRemainingColumn(elapsed_when_finished=True)
    return Bars(
        TextColumn("{task.description:<9}"), BarColumn(), *columns, left, console=console,
        disable=not console.is_terminal, get_time=lambda: time.monotonic(), speed_estimate_period=3600.0,
    )  # fmt: skip


@contextmanager
def compiling_shown(bars: Bars | None = None) -> Iterator[None]:
    """Report that code is compiled: on a terminal with the number of functions, and in a log with one line.

    Counts what this process and those beside it store. Without bars, the report is on standard error.
    """
    # a process that only shows progress does not load the compiler
    from laisn.compiled import count_stored

    shown = bars or _bars(Console(stderr=True))
    ended, before = threading.Event(), count_stored()

    def watch() -> None:
        done = False
        while not (functions := count_stored() - before) and not done:
            done = ended.wait(_COUNT_EVERY_S)
        if functions and shown.disable:
            shown.console.print(_COMPILING)
        elif functions:
            with nullcontext() if bars else shown:
                task = shown.add_task(_COMPILING, total=None)
                while not ended.wait(_COUNT_EVERY_S):
                    shown.update(task, description=f"{_COMPILING}: {count_stored() - before} functions")
                shown.update(task, total=1.0, completed=1)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()


@contextmanager
def phases(console: Console) -> Iterator[Phase]:
    """A bar for each phase of a flight, with the time left or taken; none in a log."""
    with _bars(console) as bars, compiling_shown(bars):

        @contextmanager
        def phase(name: str) -> Iterator[Update]:
            task = bars.add_task(name, total=1.0)
            yield lambda done: bars.update(task, completed=done)
            bars.update(task, completed=1.0)

        yield phase


@contextmanager
def progress(what: str, total: int, *, quiet: bool = False) -> Iterator[Advance]:
    """A bar on a terminal, a line every ten seconds in a log; nothing if there is nothing to do, or `quiet`.

    `total` items are counted, which `what` names. In a log, rate and time left do not count the first item, which
    waited for processes and compilers to start.
    """
    console = Console(stderr=True)
    if quiet or total == 0:
        yield lambda count: None
        return
    with _bars(console, MofNCompleteColumn()) as bars:
        task, shown = bars.add_task(what, total=total), time.monotonic()

        def advance(count: int) -> None:
            nonlocal shown
            bars.advance(task, count)
            state, now = bars.tasks[task], time.monotonic()
            if bars.disable and (state.finished or now - shown >= _LINE_EVERY_S):
                pace = f", {state.speed:.1f}/s, {state.time_remaining:.0f} s left" if state.speed else ""
                console.print(f"{what}: {state.completed:.0f}/{total}{pace}", highlight=False)
                shown = now

        yield advance
