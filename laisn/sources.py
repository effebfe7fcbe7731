"""The files of this project that a module can reach: its own, those of what it imports, and of what that imports."""

import re
from collections.abc import Iterable, Iterator
from importlib.util import resolve_name
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""Folder of this project's packages."""
PACKAGES = ("models", "laisn", "sim", "experiments")
_IN_CHECKOUT = ("tools", "tests")

_HIDDEN = re.compile(rb"#[^\n]*|\\\n")
"""What may stand between the names of an import."""
_FROM = re.compile(rb"from\s*([.\w]+)\s+import\b(?=\s*(\([^)]*\)|[^\n;]*))")
_IMPORT = re.compile(rb"import\s+(?=(\w[^\n;]*))")


def _names(given: bytes) -> Iterator[str]:
    """Names of a list such as `a, b as c`, with or without parentheses."""
    return (words[0].decode() for part in given.strip(b"()").split(b",") if (words := part.split()))


def imports(module: str, text: bytes, *, package: bool = False) -> Iterator[str]:
    """Names that a module may import anywhere in its text; a name may be a module, something within one, or prose.

    Reading the text as Python would take ten times as long. A name too many does no harm: there is no such file.

    Args:
        module: its full name, from which relative imports start.
        text: its source.
        package: the text is the package's `__init__.py`.
    """
    within = module if package else module.rpartition(".")[0]
    plain = _HIDDEN.sub(b" ", text)
    for given in _IMPORT.findall(plain):
        yield from _names(given)
    for base, given in _FROM.findall(plain):
        try:
            source = resolve_name(base.decode(), within)
        except ImportError:
            # prose, such as an ellipsis
            continue
        yield source
        yield from (f"{source}.{name}" for name in _names(given))


class Sources:
    """The modules of this project's packages, each file read once."""

    def __init__(self, root: Path = ROOT) -> None:
        """Find the packages below a folder."""
        self._root = root
        self._texts: dict[Path, bytes] = {}
        self._imports: dict[str, tuple[str, ...]] = {}

    def text(self, path: Path) -> bytes:
        """Content of a file, as it was when it was first asked for."""
        if path not in self._texts:
            self._texts[path] = path.read_bytes()
        return self._texts[path]

    def file(self, module: str) -> Path | None:
        """Source of a module; None if these packages have none of that name."""
        if module.partition(".")[0] not in (*PACKAGES, *_IN_CHECKOUT):
            return None
        place = self._root.joinpath(*module.split("."))
        return next((p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file()), None)

    def _imports_of(self, module: str, path: Path) -> tuple[str, ...]:
        if module not in self._imports:
            found = imports(module, self.text(path), package=path.name == "__init__.py")
            # with a module, Python runs the packages around it
            self._imports[module] = (module.rpartition(".")[0], *found)
        return self._imports[module]

    def reached(self, modules: Iterable[str]) -> dict[str, Path]:
        """Files that these modules can reach, by module name; an import inside a function counts like one at the top.

        Raises:
            FileNotFoundError: one of the modules themselves is not there.
        """
        found: dict[str, Path] = {}
        seen: set[str] = set()
        names = list(modules)
        for name in names:
            if self.file(name) is None:
                raise FileNotFoundError(f"{self._root}: module {name} is not there")
        while names:
            name = names.pop()
            if name in seen:
                continue
            seen.add(name)
            path = self.file(name)
            if path is not None:
                found[name] = path
                names += self._imports_of(name, path)
        return found
