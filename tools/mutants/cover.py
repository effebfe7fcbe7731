"""The tests that cover a source, chosen by their imports and by folders, which tests share with
sources.
"""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tools import import_graph
from tools.import_graph import ROOT

SOURCES = (*import_graph.PACKAGES, "tools")
"""Packages whose sources are changed."""


def names_imported_by(test: Path) -> Iterator[str]:
    """Names that a test imports, and those imported by modules that tests share and by
    `laisn_sim`.
    """
    for name in set(import_graph.named(test, "tests")):
        shared = ROOT / f"{name.rpartition('.')[0].replace('.', '/')}.py"
        if name.startswith("tests.") and shared.is_file():
            yield from names_imported_by(shared)
        if name == "laisn_sim":
            yield from import_graph.named(ROOT / "laisn_sim" / "__init__.py", name)
        yield name


@cache
def distances() -> dict[str, dict[str, int]]:
    """Modules that each test file reaches, with the number of imports on the shortest path."""
    imports = import_graph.imports(packages=SOURCES)
    distance_of = {}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        names = set(names_imported_by(path))
        front = {
            name if name in imports else name.rpartition(".")[0] for name in names
        } & imports.keys()
        reached: dict[str, int] = {}
        distance = 1
        while front:
            reached |= dict.fromkeys(front, distance)
            front = {imported for name in front for imported in imports[name]} - reached.keys()
            distance += 1
        distance_of[str(path.relative_to(ROOT))] = reached
    return distance_of


def covering(file: str) -> list[str]:
    """The test files that cover a source, the one of its name and the nearest first.

    They are those of its own folder, or else of its package, that have its name, or import it
    themselves or by one module more than the nearest of them does; where there are none, those of
    any folder that are as near as any.
    """
    module = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    homes = Path(file).parent.name, import_graph.package_of(module).rpartition(".")[2]
    reach = {test: reached[module] for test, reached in distances().items() if module in reached}
    at_home = (
        {
            t: n
            for t, n in reach.items()
            if Path(t).parent.name == home or Path(t).stem == f"test_{home}"
        }
        for home in homes
    )
    tests_at_home = next(filter(None, at_home), {})
    smallest = min((tests_at_home or reach).values(), default=0)
    name = f"test_{Path(file).stem}"
    # at home one import more than the nearest test's is allowed
    nearest = {
        test: n
        for test, n in (tests_at_home or reach).items()
        if n <= smallest + bool(tests_at_home) or Path(test).stem == name
    }
    return sorted(nearest, key=lambda test: (Path(test).stem != name, nearest[test], test))
