"""Tasks: calls of a function whose rows are stored under a key of its sources and of its arguments."""

import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from functools import cache, partial
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter
from pydantic_core import to_jsonable_python

from experiments.campaign.missions import digest
from experiments.campaign.processes import Pool
from experiments.campaign.progress import progress
from experiments.campaign.store import CampaignError, Record, Store
from experiments.campaign.version import code_version, version_of

Task = partial[Any]
"""A function of a module with its arguments: data classes, scenarios, numbers and text.

It returns a list of rows, which are records or data classes, or a single row; it raises `CampaignError` if it cannot
compute them."""
Row = TypeVar("Row")


def typed(kind: type[Row], rows: Iterable[Record]) -> list[Row]:
    """Rows as the data classes that they were, if these hold no arrays."""
    adapter = TypeAdapter(kind)
    return [adapter.validate_python(row) for row in rows]


def with_arrays(row: Record) -> Record:
    """A row with arrays in place of lists."""
    return {name: np.array(value) if isinstance(value, list) else value for name, value in row.items()}


@cache
def _source(module: str) -> str:
    if module == "__main__":
        module = sys.modules[module].__spec__.name  # type: ignore[union-attr]
    return version_of((module,))


def _plain(value: object) -> object:
    """JSON value of an argument; TypeError if there is none."""
    if isinstance(value, range):
        return [value.start, value.stop, value.step]
    raise TypeError(f"a task is given {type(value).__name__}, of which no key can be made: {value!r:.60}")


def task_key(task: Task) -> str:
    """Key of a task's rows."""
    return key_of(task.func, task.args, task.keywords)


def key_of(function: Callable[..., object], *arguments: object) -> str:
    """Hash of a function's name, of every source that it can reach, and of its arguments."""
    given = to_jsonable_python(arguments, fallback=_plain)
    return digest([code_version(), _source(function.__module__), function.__qualname__, given])


def _rows(name: Any, task: Task) -> tuple[Any, list[Record] | str]:
    """Name of a task and its rows, or why it has none."""
    try:
        found = task()
    except CampaignError as error:
        return name, str(error).splitlines()[0]
    rows = found if isinstance(found, list) else [found]
    return name, [row if isinstance(row, dict) else asdict(row) for row in rows]


def compute_tasks(
    tasks: Mapping[Any, Task], store: Store, pool: Pool, *, what: str = "tasks", quiet: bool = False
) -> dict[Any, str]:
    """Compute tasks in parallel, and store the rows of each as it is done.

    Args:
        tasks: by name.
        store: for their rows.
        pool: entered.
        what: label of the progress display.
        quiet: show no progress.

    Returns:
        Why a task has no rows, by its name.
    """
    failed: dict[Any, str] = {}
    with progress(what, len(tasks), quiet=quiet) as advance:
        missing = store.still_missing(
            tasks.items(), lambda item: store.record(task_key(item[1])) is not None, lambda _: advance()
        )
        for name, found in pool.each(_rows, missing):
            if isinstance(found, str):
                failed[name] = found
            else:
                store.write_record(task_key(tasks[name]), found)
            advance()
    return failed
