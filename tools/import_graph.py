"""The import graph of the product, read from its sources: between modules and between packages."""

import ast
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from importlib.util import resolve_name
from pathlib import Path

PACKAGES = ("models", "laisn", "sim", "reports", "experiments", "laisn_sim")
ROOT = Path(__file__).resolve().parents[1]
"""Folder of the checkout."""

Imports = dict[str, set[str]]
"""The modules that each module imports."""


def modules(root: Path = ROOT, packages: Iterable[str] = PACKAGES) -> dict[str, Path]:
    """Source of every module of these packages, by its dotted name; a package goes by the name
    of its folder.
    """
    files = {}
    for package in packages:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


def statements(body: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """All statements, those within others too; expressions, of which there are ten times as
    many, hold none.
    """
    for node in body:
        yield node
        for inner in ("body", "handlers", "cases", "orelse", "finalbody"):
            yield from statements(getattr(node, inner, ()))


@cache
def import_statements(path: Path) -> tuple[tuple[ast.Import | ast.ImportFrom, bool], ...]:
    """All imports of a source, as it was at the first call, and whether each stands within a
    function.
    """
    tree = ast.parse(path.read_bytes()).body
    functions = [node for node in statements(tree) if isinstance(node, ast.FunctionDef)]
    in_functions = {id(node) for function in functions for node in statements(function.body)}
    nodes = (node for node in statements(tree) if isinstance(node, ast.Import | ast.ImportFrom))
    return tuple((node, id(node) in in_functions) for node in nodes)


def imported_names(path: Path, module: str) -> Iterator[str]:
    """Every name that a source imports anywhere, inside functions too: a module, or something
    within one.
    """
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node, _ in import_statements(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            base = (
                resolve_name("." * node.level + (node.module or ""), package)
                if node.level
                else node.module or ""
            )
            yield from (f"{base}.{alias.name}" for alias in node.names)


@cache
def imports(root: Path = ROOT, packages: tuple[str, ...] = PACKAGES) -> Imports:
    """Which modules of these packages each of them imports, at its top or within a function."""
    module_names = modules(root, packages)
    graph: Imports = {}
    for module, path in module_names.items():
        names = {
            name if name in module_names else name.rpartition(".")[0]
            for name in imported_names(path, module)
        }
        graph[module] = {name for name in names if name in module_names and name != module}
    return graph


def package_of(module: str) -> str:
    """The package of a module, at most two names deep; `laisn` and `models` are one each, and a
    module directly in another outermost package stands for itself.

    Such as "sim.water" of "sim.water.rays", "sim.flight" of "sim.flight", and "laisn" of
    "laisn.fix".
    """
    package, *rest = module.split(".")
    return package if package in ("laisn", "models") or not rest else f"{package}.{rest[0]}"


def package_imports(graph: Mapping[str, Iterable[str]]) -> Imports:
    """Which packages each package imports."""
    between_packages: Imports = {}
    for module, names in graph.items():
        imported = between_packages.setdefault(package_of(module), set())
        imported |= {package_of(name) for name in names} - {package_of(module)}
    return between_packages


def cycle(graph: Mapping[str, Iterable[str]]) -> list[str]:
    """Names that import each other in a cycle, the first of them again at the end; empty if
    there is none.
    """
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def _tier(package: str) -> int:
    """Number from below of the tier of a package: `reports`, `experiments` and `laisn_sim` have one
    each, above that of all others.
    """
    return {"reports": 1, "experiments": 2, "laisn_sim": 3}.get(package.partition(".")[0], 0)


def layers(graph: Mapping[str, Iterable[str]]) -> dict[str, int]:
    """The layer of each package, from 0: one above the highest that it imports; in `reports`,
    `experiments` and `laisn_sim` also above all packages of the tiers below.
    """
    layer: dict[str, int] = {}
    for package in sorted(TopologicalSorter(graph).static_order(), key=_tier):
        imported = {*graph.get(package, ())}
        if _tier(package) > 0:
            imported |= {name for name in layer if _tier(name) < _tier(package)}
        layer[package] = max((layer[name] + 1 for name in imported), default=0)
    return layer
