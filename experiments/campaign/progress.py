"""How far a campaign is, how fast it goes, and how long it will take."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.text import Text

_LINE_EVERY_S = 10.0


class Advance(Protocol):
    """Told how much more is done."""

    def __call__(self, count: int = 1) -> None:
        """`count` more are done."""


class _Rate(ProgressColumn):
    """Items a second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text(f"{speed:.1f}/s" if speed else "–/s", style="progress.data.speed")


@contextmanager
def progress(what: str, total: int, *, quiet: bool = False) -> Iterator[Advance]:
    """A bar on a terminal, a line every ten seconds in a log; nothing where there is nothing to do.

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
    done, start = 0, time.monotonic()
    shown = start

    def advance(count: int = 1) -> None:
        nonlocal done, shown
        done += count
        now = time.monotonic()
        if done == total or now - shown >= _LINE_EVERY_S:
            rate = done / max(now - start, 1e-9)
            console.print(f"{what}: {done}/{total}, {rate:.1f}/s, {(total - done) / rate:.0f} s left", highlight=False)
            shown = now

    yield advance
