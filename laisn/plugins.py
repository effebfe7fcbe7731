"""Code of the user's own: files that a command loads with `--plugin FILE`, and Python with
`load_plugin`.

Scenarios and logs name classes in them as "module:Class", but never make a program import a module.
The environment variable `LAISN_PLUGINS` lists the files; processes that this one starts inherit it.

A plugin is imported anew when one of its sources (`laisn.custom_sources`) has changed. Its digest
is that of the sources that were imported, so that no result of other code is stored under it.
"""

import hashlib
import importlib
import importlib.util
import linecache
import os
import re
import secrets
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, wraps
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeGuard, TypeVar, TypeVarTuple

from laisn.custom_sources import Sources, is_custom, remove_bytecode
from laisn.errors import LaisnError

Arguments = TypeVarTuple("Arguments")
Result = TypeVar("Result")

PLUGINS_VARIABLE = "LAISN_PLUGINS"
"""Environment variable with the files of plugins."""
# of the user's own code in the message of an error
_MAX_FRAMES = 5
# imports of a plugin whose files change meanwhile
_MAX_IMPORTS = 5


class PluginError(LaisnError):
    """An exception of the user's own code; the text names file, line and exception."""


class _Registered(NamedTuple):
    """A class or function that Python code of this process has given."""

    factory: Any
    token: str  # in keys of results, so that no other process finds them


@dataclass(frozen=True, kw_only=True)
class _Loaded:
    """A plugin that this process has imported."""

    module: ModuleType
    file: Path
    sources: Sources


_REGISTERED: dict[str, _Registered] = {}
"""By the names that scenarios have for them."""
_LOADED: dict[str, _Loaded] = {}
"""By the names of modules."""
_IMPORTED: dict[Path, str] = {}
"""Digests of the user's own sources as they were imported."""


def plugin_files() -> dict[str, Path]:
    """Files of the plugins by the names of their modules."""
    files = map(Path, filter(None, os.environ.get(PLUGINS_VARIABLE, "").split(os.pathsep)))
    return {file.stem: file for file in files}


def plugin_options(text: str) -> list[str]:
    """Options of a command that load the plugins whose classes a text names; files below the
    current folder from there.
    """
    here = Path.cwd()
    files = [
        file for name, file in plugin_files().items() if re.search(rf"\b{re.escape(name)}:", text)
    ]
    paths = [file.relative_to(here) if file.is_relative_to(here) else file for file in files]
    return [word for path in paths for word in ("--plugin", str(path))]


def _is_as_read(name: str, sources: Sources) -> bool:
    """Whether Python has not imported a module of a plugin yet, or from the same source."""
    if name not in sys.modules:
        return True
    file = Path(str(getattr(sys.modules[name], "__file__", None)))
    return file == sources.modules[name] and _IMPORTED.get(file) == sources.contents[file]


def _forget_changed(sources: Sources, before: _Loaded | None) -> None:
    """Make Python import all modules of a plugin anew if one of them is not as it was imported."""
    changed = before is not None and before.sources.digest != sources.digest
    if not changed and all(_is_as_read(name, sources) for name in sources.modules):
        return
    names = set(sources.modules)
    if before is not None:
        names |= set(before.sources.modules)
    for name in names - {"__main__"}:
        sys.modules.pop(name, None)
    remove_bytecode(sources.files)


def _import_once(file: Path, sources: Sources) -> ModuleType:
    """Import a plugin whose sources are known; PluginError if that fails."""
    importlib.invalidate_caches()
    linecache.checkcache()
    writes_bytecode = sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    try:
        return importlib.import_module(file.stem)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        reason = "\n".join(_lines_of(error, {*map(str, sources.files)}))
        raise PluginError(f"plugin {file} cannot be imported: {reason}") from error
    finally:
        sys.dont_write_bytecode = writes_bytecode


def _require_free_name(file: Path) -> None:
    """LaisnError if Python would import another module by the name of a plugin."""
    name = file.stem
    module = sys.modules.get(name)
    spec = importlib.util.find_spec(name) if module is None else getattr(module, "__spec__", None)
    if spec is not None and spec.origin != str(file):
        raise LaisnError(
            f"plugin {file}: there is another module {name!r} ({spec.origin}); rename the file"
        )


def _load(file: Path) -> _Loaded:
    """The plugin of a file as its sources are now, imported anew if they changed; PluginError if
    that fails.
    """
    name = file.stem
    before = _LOADED.get(name)
    if before is not None and before.file == file and before.sources.unchanged:
        return before
    _require_free_name(file)
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))
    for _ in range(_MAX_IMPORTS):
        sources = Sources.of(file)
        _forget_changed(sources, before)
        # without them if the import fails
        _LOADED.pop(name, None)
        for registered in [key for key in _REGISTERED if key.partition(":")[0] == name]:
            del _REGISTERED[registered]
        module = _import_once(file, sources)
        _IMPORTED.update(sources.contents)
        loaded = _Loaded(module=module, file=file, sources=sources)
        _LOADED[name] = loaded
        if sources.unchanged:
            return loaded
        before = loaded
    raise LaisnError(f"plugin {file}: it changes while it is imported")


def load_plugin(file: str | os.PathLike[str]) -> ModuleType:
    """Import a Python file, whose classes scenarios may then name as "module:Class"; LaisnError
    if that fails.

    After an edit of the file, or of a file of the user's own that it imports, this gives the new
    module.
    """
    path = Path(file).resolve()
    if path.suffix != ".py" or not path.stem.isidentifier():
        raise LaisnError(f"plugin {file}: expected a Python file such as mine.py")
    if not path.is_file():
        raise LaisnError(
            f"plugin {file}: {'it is no file' if path.exists() else 'there is no such file'}"
        )
    module = _load(path).module
    files = plugin_files() | {path.stem: path}
    os.environ[PLUGINS_VARIABLE] = os.pathsep.join(map(str, files.values()))
    return module


def plugin_digest(name: str) -> str:
    """Digest of the sources of a plugin, by the name of its module, which is imported anew if they
    changed.
    """
    return _load(plugin_files()[name]).sources.digest


def plugins_version(*, refresh: bool) -> str:
    """Digest of all plugins as this process has imported them; `refresh`: those that changed are
    imported anew.
    """
    digest = hashlib.sha256()
    for name, file in sorted(plugin_files().items()):
        loaded = _LOADED.get(name)
        if loaded is None or refresh:
            loaded = _load(file)
        digest.update(f"{name} {loaded.sources.digest} ".encode())
    return digest.hexdigest()[:24]


def kept_with_plugins(
    most: int,
) -> Callable[[Callable[[*Arguments], Result]], Callable[[*Arguments], Result]]:
    """`functools.lru_cache` of a size, for functions that may use classes of plugins: what was made
    with other sources of plugins does not count.
    """

    def decorate(function: Callable[[*Arguments], Result]) -> Callable[[*Arguments], Result]:
        @lru_cache(maxsize=most)
        def kept(_plugins: str, *args: *Arguments) -> Result:
            return function(*args)

        @wraps(function)
        def called(*args: *Arguments) -> Result:
            return kept(plugins_version(refresh=False), *args)

        return called

    return decorate


def registered_tokens(text: str) -> list[str]:
    """Tokens of what Python code of this process has given, of those whose names are in a text of
    JSON.
    """
    return [
        registered.token for name, registered in sorted(_REGISTERED.items()) if f'"{name}"' in text
    ]


def require_factory(argument: str, factory: object) -> None:
    """LaisnError unless an argument of this name is a class, or a function that makes objects of
    one.
    """
    if not callable(factory):
        raise LaisnError(
            f"{argument}: expected a class, or a function that makes its objects (given: "
            f"{factory!r:.80}); names are values of keys, as navigation.variant"
        )


def register(factory: Callable[..., Any], *, importable: bool = False) -> str:
    """Name by which scenarios may use a class, or a function that makes objects of one, defined
    anywhere.

    If other processes need it (`importable`), it must be a class at the top of a file of its own,
    or LaisnError; they import the file as it is now.
    """
    # an object that can be called, as of functools.partial, has the name of its class
    named = factory if hasattr(factory, "__qualname__") else type(factory)
    module = named.__module__
    attribute = re.sub(r"\W", "_", named.__qualname__)
    file = Path(getattr(sys.modules.get(module), "__file__", None) or "")
    has_name = isinstance(factory, type) and attribute == named.__name__ and module != "__main__"
    in_a_file = has_name and file.suffix == ".py" and file.stem == module
    name = f"{module.rpartition('.')[2]}:{attribute}"
    if importable and not in_a_file:
        raise LaisnError(
            f"{attribute}: other processes import it; define it as a class in a file of its own, "
            "mine.py"
        )
    if importable:
        load_plugin(file)
        return name
    loaded = _LOADED.get(module)
    if loaded is None or getattr(loaded.module, attribute, None) is not factory:
        _REGISTERED[name] = _Registered(factory, secrets.token_hex(12))
    return name


def is_plugin_name(name: str) -> bool:
    """Whether a name is that of a class of the user's own, "module:Class", or of a loaded
    module.
    """
    module, colon, attribute = name.partition(":")
    return module.isidentifier() and attribute.isidentifier() if colon else name in plugin_files()


def is_loaded(name: str) -> bool:
    """Whether `find_class` may look a name up: its plugin is loaded, or this process has registered
    it.
    """
    return name in _REGISTERED or name.partition(":")[0] in plugin_files()


def find_class(kind: str, name: str, method: str = "") -> Any:
    """A class of a plugin: "module:Class", or "module" alone for the only class of it that has the
    method; LaisnError, with the `kind` that it should be, if there is none.
    """
    if name in _REGISTERED:
        return _REGISTERED[name].factory
    module, _, attribute = name.partition(":")
    file = plugin_files().get(module)
    if file is None:
        raise LaisnError(
            f"{kind} {name!r} is in a plugin that is not loaded: add --plugin {module}.py "
            f'(in Python: laisn_sim.load_plugin("{module}.py"))'
        )
    # not as the file is now: a mission is flown by one version
    loaded = _LOADED.get(module) or _load(file)
    classes = {
        key: c
        for key, c in vars(loaded.module).items()
        if isinstance(c, type) and c.__module__ == module
    }
    matches = [
        key for key, c in classes.items() if (key == attribute if attribute else hasattr(c, method))
    ]
    if len(matches) != 1:
        raise LaisnError(
            f"{kind} {name!r}: expected a class of {file}: {', '.join(classes) or 'it has none'}"
        )
    return classes[matches[0]]


def takes_readings(factory: object) -> TypeGuard[type]:
    """Whether this is a class of controllers with `control(readings, belief, dt)`, and not one
    of other controllers.
    """
    code = getattr(getattr(factory, "control", None), "__code__", None)
    return isinstance(factory, type) and code is not None and code.co_argcount == 4


def find_controller(name: str) -> Any:
    """The class of a follower's controller; LaisnError as of `find_class`, or if its `control`
    takes something else.
    """
    controller = find_class("controller", name, "control")
    if not takes_readings(controller):
        raise LaisnError(
            f"controller {name!r}: expected a class with `control(readings, belief, dt)`"
        )
    return controller


def class_and_file(made: object) -> str:
    """What messages call a class, or that of an object: `Class (mine.py)`, with its file if it is
    the user's own.
    """
    kind = made if isinstance(made, type) else type(made)
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return f"{kind.__name__} ({Path(file).name})" if file and is_custom(file) else kind.__name__


def _custom_frames(error: BaseException, sources: set[str]) -> list[traceback.FrameSummary]:
    """Calls of the user's own code that led to an exception; none if none is in these sources."""
    frames = traceback.extract_tb(error.__traceback__)
    if not any(frame.filename in sources for frame in frames):
        return []
    return [f for f in frames if f.filename in sources or is_custom(f.filename)]


def _first_line(error: BaseException) -> str:
    """Of an exception's text, which code of the user's own may make."""
    try:
        return str(error).partition("\n")[0]
    except Exception as other:
        return f"its text cannot be made: {type(other).__name__}"


def _lines_of(error: BaseException, sources: set[str]) -> list[str]:
    """The exception, and where in the user's own code it was raised, the last call last."""
    kind = type(error).__name__
    text = _first_line(error)
    head = f"{kind}: {text}" if text else kind
    if isinstance(error, SystemExit):
        head = f"it ends the program (SystemExit: {error.code})"
    frames = _custom_frames(error, sources)
    if isinstance(error, SyntaxError) and error.filename:
        source = (error.text or "").strip()
        return [f"{kind}: {error.msg}", f'  File "{error.filename}", line {error.lineno}: {source}']
    if not frames:
        return [head]
    lines = []
    if len(frames) > _MAX_FRAMES:
        lines.append(f"  … {len(frames) - _MAX_FRAMES} calls before")
    for frame in frames[-_MAX_FRAMES:]:
        lines.append(f'  File "{frame.filename}", line {frame.lineno}, in {frame.name}')
        if frame.line:
            lines.append(f"    {frame.line}")
    return [head, *lines]


def plugin_error(error: BaseException) -> PluginError | None:
    """What is told of an exception that came through the code of a plugin; None of others."""
    for loaded in _LOADED.values():
        sources = {*map(str, loaded.sources.files)}
        if _custom_frames(error, sources):
            head, *frames = _lines_of(error, sources)
            return PluginError("\n".join([f"plugin {loaded.file}: {head}", *frames]))
    return None


def _is_raised_by_plugin(error: BaseException) -> bool:
    """Whether a line of a plugin itself raised an exception, and no function that it calls."""
    frames = traceback.extract_tb(error.__traceback__)
    if not frames:
        return False
    sources = {str(file) for loaded in _LOADED.values() for file in loaded.sources.files}
    return frames[-1].filename in sources


@contextmanager
def calling(description: str) -> Iterator[None]:
    """A call of the user's own code in the block: PluginError if it takes other arguments."""
    try:
        yield
    except TypeError as error:
        # the block's frame alone is below that of this function: nothing was called
        frames = list(traceback.walk_tb(error.__traceback__))
        if len(frames) > 2:
            raise
        raise PluginError(f"{description}: {error}") from error


@contextmanager
def plugin_errors() -> Iterator[None]:
    """Exceptions of plugins in the block, also those that would end the program, become
    PluginError, which other processes can be sent.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if isinstance(error, LaisnError) and not _is_raised_by_plugin(error):
            raise
        known_error = plugin_error(error)
        if known_error is None:
            raise
        for note in getattr(error, "__notes__", ()):
            known_error.add_note(note)
        raise known_error from error
