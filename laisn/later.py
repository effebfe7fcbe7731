"""Imports of other packages that come when what they import is used first.

filterpy imports parts of SciPy for filters that this project has no use for. They take half a
second of each command.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pkgutil import resolve_name
from types import ModuleType
from typing import Any


class _LaterModule(ModuleType):
    """Stands for a module while others import from it."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            # what the import itself looks for
            raise AttributeError(name)
        return _LaterName(self.__name__, name)


class _LaterName:
    """A function, class or object of a module that is imported when it is used."""

    def __init__(self, module: str, name: str) -> None:
        self._module = module
        self._name = name

    @property
    def _waits(self) -> bool:
        """Whether the block goes on that stands for the module."""
        return isinstance(sys.modules.get(self._module), _LaterModule)

    def _resolved(self) -> Any:
        return getattr(import_module(self._module), self._name)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        # packages that call something while they are imported only try whether they can
        return None if self._waits else self._resolved()(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            # what copies and pickles look for
            raise AttributeError(name)
        return self if self._waits else getattr(self._resolved(), name)

    def __reduce__(self) -> Any:
        return resolve_name, (f"{self._module}:{self._name}",)


@contextmanager
def later(*modules: str) -> Iterator[None]:
    """What the block imports of these modules, by their whole names, is loaded when it is called,
    or an attribute of it is taken, after the block; a call within it gives None.

    Modules that are loaded already stay as they are.
    """
    absent = [name for name in modules if name not in sys.modules]
    sys.modules.update({name: _LaterModule(name) for name in absent})
    try:
        yield
    finally:
        for name in absent:
            if isinstance(sys.modules.get(name), _LaterModule):
                del sys.modules[name]
