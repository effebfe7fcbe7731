"""The user's own source files that a plugin reaches: itself, what it imports, and data that it
names.

Not the user's are the standard library, installed packages and this project. Nothing is imported to
find them.
"""

import ast
import hashlib
import importlib.util
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import NamedTuple

PROJECT = ("experiments", "laisn", "laisn_sim", "models", "reports", "sim", "tools")
_ROOT = Path(__file__).resolve().parents[1]
_INSTALLED = {"site-packages", "dist-packages"}
# longer texts in a source name no file
_LONGEST_NAME = 255


class _Stamp(NamedTuple):
    """What changes when a file is written again."""

    path: Path
    modified_ns: int
    size: int
    inode: int


def _stamp(path: Path) -> _Stamp | None:
    """The stamp of a file; None if there is none."""
    try:
        state = path.stat()
    except OSError:
        return None
    return _Stamp(path, state.st_mtime_ns, state.st_size, state.st_ino)


@cache
def _libraries() -> tuple[Path, ...]:
    """Folders of the standard library and of this project's packages."""
    standard = (sysconfig.get_path(name) for name in ("stdlib", "platstdlib"))
    folders = [Path(folder).resolve() for folder in standard]
    return (*folders, *(_ROOT / package for package in PROJECT))


@lru_cache(maxsize=4096)
def is_custom(file: str | Path) -> bool:
    """Whether a source file is the user's own."""
    path = Path(file)
    return (
        path.is_absolute()
        and not _INSTALLED.intersection(path.parts)
        and not any(path.is_relative_to(folder) for folder in _libraries())
    )


@dataclass(frozen=True, kw_only=True)
class _Source:
    """What stands in a source file."""

    modules: frozenset[str]  # absolute names of what it may import
    texts: frozenset[str]  # short texts, which may name files of data


def _imported(node: ast.AST, package: str) -> Iterator[str]:
    """Absolute names of what a node imports, in a module of this package."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        parents = (
            package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
        )
        base = ".".join(filter(None, (*parents, node.module)))
        yield base
        yield from (f"{base}.{alias.name}" for alias in node.names)
    elif isinstance(node, ast.Call) and node.args:
        function = node.func
        name = getattr(function, "attr", getattr(function, "id", ""))
        first = node.args[0]
        if name in ("import_module", "__import__") and isinstance(first, ast.Constant):
            yield str(first.value)


@cache
def _parsed(content: bytes, package: str) -> _Source:
    """What stands in a source; nothing if it is no Python."""
    try:
        nodes = list(ast.walk(ast.parse(content)))
    except (SyntaxError, ValueError, RecursionError):
        nodes = []
    modules = {name for node in nodes for name in _imported(node, package) if name}
    constants = {node.value for node in nodes if isinstance(node, ast.Constant)}
    texts = {
        text
        for text in constants
        if isinstance(text, str) and 0 < len(text) <= _LONGEST_NAME and text.isprintable()
    }
    return _Source(modules=frozenset(modules), texts=frozenset(texts))


def _spec_of_top(name: str) -> ModuleSpec | None:
    """Where a module that is in no package would be imported from."""
    for finder in sys.meta_path:
        find = getattr(finder, "find_spec", None)
        spec: ModuleSpec | None = find(name, None) if find else None
        if spec is not None:
            return spec
    return None


class _Module(NamedTuple):
    """A module of the user's own: its source, None of a folder without one, and its folders."""

    source: Path | None
    folders: tuple[Path, ...]


def _module_in(folders: tuple[Path, ...], name: str) -> _Module | None:
    """A module by its last name in the folders of its package."""
    for folder in folders:
        inner = folder / name
        if (inner / "__init__.py").is_file():
            return _Module(inner / "__init__.py", (inner,))
        if inner.with_suffix(".py").is_file():
            return _Module(inner.with_suffix(".py"), ())
        if inner.is_dir():
            return _Module(None, (inner,))
    return None


def _top_module(name: str) -> _Module | None:
    """A module that is in no package, if it is the user's own."""
    if name in PROJECT or name in sys.stdlib_module_names:
        return None
    spec = _spec_of_top(name)
    if spec is None:
        return None
    folders = tuple(Path(folder) for folder in spec.submodule_search_locations or ())
    source = Path(spec.origin) if spec.origin and spec.origin.endswith(".py") else None
    places = [source] if source else [*folders]
    return _Module(source, folders) if places and all(map(is_custom, places)) else None


class _Walk:
    """Finds the user's own modules, each once."""

    def __init__(self) -> None:
        self.files: dict[Path, str] = {}
        """Name of a module, or of data, by file."""
        self._modules: dict[str, _Module | None] = {}

    def follow(self, name: str) -> _Module | None:
        """Add a module and all that it reaches; the module, None if it is not the user's own."""
        if name in self._modules:
            return self._modules[name]
        package, _, last = name.rpartition(".")
        if package:
            parent = self.follow(package)
            module = _module_in(parent.folders, last) if parent else None
        else:
            module = _top_module(name)
        self._modules[name] = module
        if module is not None and module.source is not None:
            self.add(name, module.source, is_package=bool(module.folders))
        return module

    def add(self, name: str, source: Path, *, is_package: bool = False) -> None:
        """Add a source and all that it reaches."""
        try:
            content = source.read_bytes()
        except OSError:
            return
        self.files[source] = name
        parsed = _parsed(content, name if is_package else name.rpartition(".")[0])
        for module in sorted(parsed.modules):
            self.follow(module)
        for text in sorted(parsed.texts):
            self._add_data(text, source.parent)

    def _add_data(self, text: str, folder: Path) -> None:
        """Add the file that a text of a source names, seen from its folder or from here."""
        for file in (folder / text, Path.cwd() / text):
            if file not in self.files and file.is_file() and is_custom(file):
                self.files[file] = f"data {text}"
                return


@dataclass(frozen=True, kw_only=True)
class Sources:
    """The user's own files that a plugin reaches, as they were read."""

    files: frozenset[Path]
    modules: dict[str, Path]  # files of modules by their names
    digest: str  # of names and contents
    contents: dict[Path, str]  # digest of each file
    stamps: tuple[_Stamp | None, ...]

    @classmethod
    def of(cls, file: Path) -> "Sources":
        """The sources of a plugin as they are now."""
        walk = _Walk()
        walk.add(file.stem, file)
        names = sorted((name, path) for path, name in walk.files.items())
        # before their contents, so that a later change is seen
        stamps = tuple(_stamp(path) for _, path in names)
        contents = {path: _digest(path) for _, path in names}
        digest = hashlib.sha256()
        for name, path in names:
            digest.update(f"{name} {contents[path]} ".encode())
        return cls(
            files=frozenset(contents),
            modules={name: path for name, path in names if path.suffix == ".py"},
            digest=digest.hexdigest()[:24],
            contents=contents,
            stamps=stamps,
        )

    @property
    def unchanged(self) -> bool:
        """Whether no file was written since."""
        return all(stamp is not None and _stamp(stamp.path) == stamp for stamp in self.stamps)


def _digest(path: Path) -> str:
    """Digest of a file; empty if it has gone."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def remove_bytecode(files: frozenset[Path]) -> None:
    """Remove stored bytecode: Python takes it for that of a source of the same size and second."""
    for file in files:
        if file.suffix == ".py":
            try:
                Path(importlib.util.cache_from_source(str(file))).unlink(missing_ok=True)
            except OSError:
                # of a folder that cannot be written
                continue
