"""Tasks: calls of a function whose rows are kept, under a key of the function's sources and of all that it is given."""

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
from experiments.campaign.progress import compiling_shown, progress
from experiments.campaign.store import CampaignError, Record, Store
from experiments.campaign.version import code_version, version_of

Task = partial[Any]
"""A function of a module, and what it is given: data classes, scenarios, numbers and text.

It gives a list of rows, which are records or data classes, or a single row; it raises `CampaignError` if what it was to
do cannot be done."""
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
    """What JSON can hold in place of what a task is given; TypeError if it is not known how."""
    if isinstance(value, range):
        return [value.start, value.stop, value.step]
    raise TypeError(f"a task is given {type(value).__name__}, of which no key can be made: {value!r:.60}")


def key_of(function: Callable[..., object], *arguments: object) -> str:
    """Hash of a function's name, of every source that it can reach, and of what it is given."""
    given = to_jsonable_python(arguments, fallback=_plain)
    return digest([code_version(), _source(function.__module__), function.__qualname__, given])


def _key(task: Task) -> str:
    return key_of(task.func, task.args, task.keywords)


def _done(name: Any, task: Task) -> tuple[Any, list[Record] | str]:
    """Name of a task and its rows, or why it has none."""
    try:
        found = task()
    except CampaignError as error:
        return name, str(error).splitlines()[0]
    rows = found if isinstance(found, list) else [found]
    return name, [row if isinstance(row, dict) else asdict(row) for row in rows]


def compute_tasks(
    tasks: Mapping[Any, Task],
    store: Store,
    pool: Pool,
    *,
    what: str = "tasks",
    quiet: bool = False,
    ahead: Callable[[], object] | None = None,
) -> tuple[dict[Any, list[Record]], dict[Any, str]]:
    """Compute tasks in parallel, and store each as it is done; those that are stored are read.

    Args:
        tasks: by name.
        store: for their rows.
        pool: entered.
        what: they are called while they are waited for.
        quiet: show no progress.
        ahead: compiles here what each process would else compile for itself.

    Returns:
        Rows by name, in the order of the tasks, and what happened to those that have none.
    """
    keys = {name: _key(task) for name, task in tasks.items()}
    missing = [name for name, key in keys.items() if store.rows(key) is None]
    failed: dict[Any, str] = {}
    if missing and ahead:
        with compiling_shown():
            ahead()
    with progress(what, len(missing), quiet=quiet) as advance:
        for name, found in pool.each(_done, ((name, tasks[name]) for name in missing)):
            if isinstance(found, str):
                failed[name] = found
            else:
                store.write_rows(keys[name], found)
            advance()
    rows = {name: store.rows(key) for name, key in keys.items()}
    return {name: found for name, found in rows.items() if found is not None}, failed
