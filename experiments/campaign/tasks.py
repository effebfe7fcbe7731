"""Tasks: calls of a function whose rows are stored under a key of its sources and of its arguments."""

import sys
from collections.abc import Callable, Iterable
from functools import cache, partial
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter
from pydantic_core import to_jsonable_python

from experiments.campaign.missions import digest
from experiments.campaign.store import Record
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
