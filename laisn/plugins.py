"""Code of the user's own: files that a command loads with `--plugin FILE`, and Python with `load_plugin`.

Scenarios and logs name classes in them as "module:Class", but never make a program import a module. The environment
variable `LAISN_PLUGINS` lists the files; processes that this one starts inherit it.
"""

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from laisn.failure import LaisnError

VARIABLE = "LAISN_PLUGINS"


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
        raise LaisnError(f"plugin {file}: there is another module {name!r} ({found.origin}); rename the file")
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))
    try:
        return importlib.import_module(name)
    except Exception as error:
        raise LaisnError(f"plugin {file} cannot be imported: {type(error).__name__}: {error}") from error


def load_plugin(file: str | os.PathLike[str]) -> ModuleType:
    """Import a Python file, whose classes scenarios may then name as "module:Class".

    Raises:
        LaisnError: there is no such file, its name is that of another module, or it cannot be imported.
    """
    path = Path(file).resolve()
    if path.suffix != ".py" or not path.stem.isidentifier() or not path.is_file():
        raise LaisnError(f"plugin {file}: expected a Python file such as mine.py")
    module = _import(path)
    files = plugin_files() | {path.stem: path}
    os.environ[VARIABLE] = os.pathsep.join(map(str, files.values()))
    return module


def is_plugin_name(name: str) -> bool:
    """Whether a name is that of a class of the user's own, "module:Class", or of a loaded module."""
    module, colon, attribute = name.partition(":")
    return module.isidentifier() and attribute.isidentifier() if colon else name in plugin_files()


def find_class(kind: str, name: str, method: str = "") -> Any:
    """A class of a plugin.

    Args:
        kind: what it is, for messages: "navigator", "sensor".
        name: "module:Class"; "module" alone for the only class of it that has the method.
        method: see `name`.

    Raises:
        LaisnError: no plugin of this name is loaded, or it has no such class.
    """
    module, _, attribute = name.partition(":")
    file = plugin_files().get(module)
    if file is None:
        raise LaisnError(
            f"{kind} {name!r} is in a plugin that is not loaded: add --plugin {module}.py "
            f'(in Python: laisn_sim.load_plugin("{module}.py"))'
        )
    loaded = _import(file)
    classes = {key: c for key, c in vars(loaded).items() if isinstance(c, type) and c.__module__ == module}
    chosen = [key for key, c in classes.items() if (key == attribute if attribute else hasattr(c, method))]
    if len(chosen) != 1:
        raise LaisnError(f"{kind} {name!r}: expected a class of {file}: {', '.join(classes) or 'it has none'}")
    return classes[chosen[0]]


def plugin_source(name: str) -> bytes:
    """Source of the plugin that a name is in; empty for a class of this project."""
    file = plugin_files().get(name.partition(":")[0])
    return file.read_bytes() if file else b""
