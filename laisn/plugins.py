"""Code of the user's own: files that a command loads with `--plugin FILE`, and Python with
`load_plugin`.

Scenarios and logs name classes in them as "module:Class", but never make a program import a module.
The environment variable `LAISN_PLUGINS` lists the files; processes that this one starts inherit it.
"""

import importlib.util
import os
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from laisn.failure import LaisnError

VARIABLE = "LAISN_PLUGINS"
_REGISTERED: dict[str, Any] = {}
"""Classes and functions that Python code of this process has given, by the names that scenarios
have for them.
"""


def plugin_files() -> dict[str, Path]:
    """Files of the plugins by the names of their modules."""
    files = map(Path, filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)))
    return {file.stem: file for file in files}


def _import(file: Path) -> ModuleType:
    """The module of a plugin, which may import others from its folder."""
    name = file.stem
    known = sys.modules.get(name)
    if known is not None and getattr(known, "__file__", None) == str(file):
        return known
    found = importlib.util.find_spec(name) if known is None else known.__spec__
    if found is not None and found.origin != str(file):
        raise LaisnError(
            f"plugin {file}: there is another module {name!r} ({found.origin}); rename the file"
        )
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))
    try:
        return importlib.import_module(name)
    except Exception as error:
        raise LaisnError(
            f"plugin {file} cannot be imported: {type(error).__name__}: {error}"
        ) from error


def load_plugin(file: str | os.PathLike[str]) -> ModuleType:
    """Import a Python file, whose classes scenarios may then name as "module:Class"; LaisnError
    if that fails.
    """
    path = Path(file).resolve()
    if path.suffix != ".py" or not path.stem.isidentifier() or not path.is_file():
        raise LaisnError(f"plugin {file}: expected a Python file such as mine.py")
    module = _import(path)
    files = plugin_files() | {path.stem: path}
    os.environ[VARIABLE] = os.pathsep.join(map(str, files.values()))
    return module


def register(made: Any, *, importable: bool = False) -> str:
    """Name by which scenarios may use a class, or a function that makes objects of one, defined
    anywhere.

    If other processes need it (`importable`), it must be a class at the top of a file of its own,
    or LaisnError.
    """
    module = made.__module__
    attribute = re.sub(r"\W", "_", made.__qualname__)
    file = Path(getattr(sys.modules.get(module), "__file__", None) or "")
    named = isinstance(made, type) and attribute == made.__name__ and module != "__main__"
    if named and file.suffix == ".py" and file.stem == module:
        load_plugin(file)
    elif importable:
        raise LaisnError(
            f"{attribute}: other processes import it; define it as a class in a file of its own, "
            "mine.py"
        )
    name = f"{module.rpartition('.')[2]}:{attribute}"
    _REGISTERED[name] = made
    return name


def is_plugin_name(name: str) -> bool:
    """Whether a name is that of a class of the user's own, "module:Class", or of a loaded
    module.
    """
    module, colon, attribute = name.partition(":")
    return module.isidentifier() and attribute.isidentifier() if colon else name in plugin_files()


def find_class(kind: str, name: str, method: str = "") -> Any:
    """A class of a plugin: "module:Class", or "module" alone for the only class of it that has the
    method; LaisnError, with the `kind` that it should be, if there is none.
    """
    if name in _REGISTERED:
        return _REGISTERED[name]
    module, _, attribute = name.partition(":")
    file = plugin_files().get(module)
    if file is None:
        raise LaisnError(
            f"{kind} {name!r} is in a plugin that is not loaded: add --plugin {module}.py "
            f'(in Python: laisn_sim.load_plugin("{module}.py"))'
        )
    loaded = _import(file)
    classes = {
        key: c for key, c in vars(loaded).items() if isinstance(c, type) and c.__module__ == module
    }
    chosen = [
        key for key, c in classes.items() if (key == attribute if attribute else hasattr(c, method))
    ]
    if len(chosen) != 1:
        raise LaisnError(
            f"{kind} {name!r}: expected a class of {file}: {', '.join(classes) or 'it has none'}"
        )
    return classes[chosen[0]]


def takes_readings(made: Any) -> bool:
    """Whether this is a class of controllers with `control(readings, belief, dt)`, and not one
    of other controllers.
    """
    code = getattr(getattr(made, "control", None), "__code__", None)
    return isinstance(made, type) and code is not None and code.co_argcount == 4


def find_controller(name: str) -> Any:
    """The class of a follower's controller; LaisnError as of `find_class`, or if its `control`
    takes something else.
    """
    made = find_class("controller", name, "control")
    if not takes_readings(made):
        raise LaisnError(
            f"controller {name!r}: expected a class with `control(readings, belief, dt)`"
        )
    return made
