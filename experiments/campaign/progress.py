"""Progress of a command on a terminal or in a log, and literal text for both."""

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Column, Table
from rich.text import Text

from laisn.errors import printable

_LINE_EVERY_S = 10.0
_COMPILING = "compiling (once for each version, half a minute to two minutes)"
_REFRESH_HZ = 2.0

Advance = Callable[[int], None]  # reports that so many more items are finished
Update = Callable[[float], None]  # reports the share that is done, 0 … 1


def literal(text: object, style: str = "") -> Text:
    """Text of a file, a path or a user as it is: no markup, no emoji code, no control character
    of it takes effect.
    """
    return Text(printable(text), style=style)


def print_line(console: Console, text: object, label: str = "", style: str = "yellow") -> None:
    """Print a line of literal text, after a styled label if there is one."""
    console.print(
        Text.assemble((f"{label} ", style) if label else "", literal(text)), soft_wrap=True
    )


def show_table(
    console: Console,
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    title: str = "",
    caption: str = "",
    *,
    numbers: bool = True,
) -> None:
    """Print a table of literal text, left-aligned; with `numbers`, all columns but the first are
    right-aligned.
    """
    columns = (
        Column(literal(head), justify="right" if n and numbers else "left")
        for n, head in enumerate(heads)
    )
    table = Table(
        *columns,
        title=literal(title) if title else None,
        title_justify="left",
        caption=literal(caption) if caption else None,
        caption_justify="left",
        box=None,
        pad_edge=False,
    )
    for row in rows:
        table.add_row(*map(literal, row))
    console.print(table)


class _Bars(Progress):
    """Bars with names and the time left or taken, above the number of functions compiled.

    `count` is that of compiled functions, of this process and those beside it. A log, which has no
    bars, has a line every ten seconds in their place, and one when all is compiled.
    """

    def __init__(
        self, console: Console, *columns: ProgressColumn, count: Callable[[], int] = lambda: 0
    ) -> None:
        self._count = count
        self._before = count()
        self._began = time.monotonic()
        self._last_line_s = self._began  # when a log had its last line
        self._ended = threading.Event()
        super().__init__(
            TextColumn("{task.description:<9}"),
            BarColumn(),
            *columns,
            TimeRemainingColumn(elapsed_when_finished=True),
            console=console,
            disable=not console.is_terminal,
            get_time=lambda: time.monotonic(),
            speed_estimate_period=3600.0,
            refresh_per_second=_REFRESH_HZ,
        )

    def _compiled(self) -> str:
        """How much was compiled, and how long that took or takes; empty: nothing."""
        functions = self._count() - self._before
        if not functions:
            return ""
        return f"{functions} functions, {time.monotonic() - self._began:.0f} s"

    def get_renderables(self) -> Iterator[RenderableType]:
        yield from super().get_renderables()
        if compiled := self._compiled():
            yield f"{_COMPILING}: {compiled}"

    def start(self) -> None:
        super().start()
        if self.disable:
            threading.Thread(target=self._write_progress, daemon=True).start()

    def stop(self) -> None:
        self._ended.set()
        super().stop()
        if self.disable and (compiled := self._compiled()):
            self.tell(f"compiled (once): {compiled}")

    @property
    def silent_s(self) -> float:
        """How long a log had no line."""
        return time.monotonic() - self._last_line_s

    def tell(self, line: str) -> None:
        """Write a line into a log."""
        self._last_line_s = time.monotonic()
        self.console.print(line, highlight=False, soft_wrap=True)

    def _write_progress(self) -> None:
        """Write how far all is, where a log had nothing for ten seconds."""
        while not self._ended.wait(_LINE_EVERY_S / 4):
            if self.silent_s < _LINE_EVERY_S:
                continue
            running = [task for task in self.tasks if not task.finished]
            lines = [f"{task.description}: {task.percentage:.0f} %" for task in running]
            compiled = self._compiled()
            if compiled:
                lines.append(f"{_COMPILING}: {compiled}")
            self.tell("; ".join(lines) or f"preparing: {time.monotonic() - self._began:.0f} s")


def _compiling_bars(console: Console) -> _Bars:
    """Bars above the number of functions that are compiled."""
    # a process that only shows progress does not load the compiler
    from laisn import compiled

    return _Bars(console, count=compiled.count_compiled)


_is_compiling_shown = False


@contextmanager
def compiling_shown(console: Console | None = None) -> Iterator[None]:
    """Report, on standard error unless a console is given, how many functions the block compiles;
    a block within another is reported with it.
    """
    global _is_compiling_shown
    if _is_compiling_shown:
        yield
        return
    _is_compiling_shown = True
    try:
        with _compiling_bars(console or Console(stderr=True)):
            yield
    finally:
        _is_compiling_shown = False


@contextmanager
def phases(console: Console) -> Iterator[Callable[[str], AbstractContextManager[Update]]]:
    """A bar for each phase of a flight, and the number of functions that are compiled."""
    with _compiling_bars(console) as bars:

        @contextmanager
        def phase(name: str) -> Iterator[Update]:
            task = bars.add_task(name, total=1.0)
            yield lambda done: bars.update(task, completed=done)
            bars.update(task, completed=1.0)

        yield phase


@contextmanager
def progress(noun: str, total: int, *, quiet: bool = False) -> Iterator[Advance]:
    """A bar on a terminal, a line every ten seconds in a log; nothing if there is nothing to do, or
    `quiet`.

    `total` items are counted, which `noun` names; below is how many functions are compiled. Rate
    and time left do not count the first item, which waited for processes and compilers to start.
    """
    console = Console(stderr=True)
    if quiet or total == 0:
        yield lambda count: None
        return
    # processes that compute what is counted compile what was not compiled ahead
    compiler = sys.modules.get("laisn.compiled")
    count_compiled = compiler.count_compiled if compiler else lambda: 0
    with _Bars(console, MofNCompleteColumn(), count=count_compiled) as bars:
        task = bars.add_task(noun, total=total)

        def advance(count: int) -> None:
            bars.advance(task, count)
            state = bars.tasks[task]
            if bars.disable and (state.finished or bars.silent_s >= _LINE_EVERY_S):
                pace = (
                    f", {state.speed:.1f}/s, {state.time_remaining:.0f} s left"
                    if state.speed
                    else ""
                )
                bars.tell(f"{noun}: {state.completed:.0f}/{total}{pace}")

        yield advance
