"""The tests that cover a source, chosen by their imports and by folders, which tests share with
sources.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tools import import_graph
from tools.import_graph import ROOT

SOURCES = (*import_graph.PACKAGES, "tools")
"""Packages whose sources are changed."""
_MOST_ELSEWHERE = 20  # test files; more of them are left out


def names_imported_by(test: Path) -> Iterator[str]:
    """Names that a test imports, and those imported by modules that tests share and by
    `laisn_sim`.
    """
    for name in set(import_graph.imported_names(test, "tests")):
        shared = ROOT / f"{name.rpartition('.')[0].replace('.', '/')}.py"
        if name.startswith("tests.") and shared.is_file():
            yield from names_imported_by(shared)
        if name == "laisn_sim":
            yield from import_graph.imported_names(ROOT / "laisn_sim" / "__init__.py", name)
        yield name


@cache
def distances() -> dict[str, dict[str, int]]:
    """Modules that each test file reaches, with the number of imports on the shortest path."""
    imports = import_graph.imports(packages=SOURCES)
    distance_of = {}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        names = set(names_imported_by(path))
        frontier = {
            name if name in imports else name.rpartition(".")[0] for name in names
        } & imports.keys()
        reached: dict[str, int] = {}
        distance = 1
        while frontier:
            reached |= dict.fromkeys(frontier, distance)
            frontier = {
                imported for name in frontier for imported in imports[name]
            } - reached.keys()
            distance += 1
        distance_of[str(path.relative_to(ROOT))] = reached
    return distance_of


class Covering(NamedTuple):
    """The test files that cover a source."""

    home: list[str]
    """Those of its own folder, or else of its package, that have its name, or import it themselves
    or by one module more than the nearest of them does.
    """
    elsewhere: list[str]
    """Those of other folders that are as near as any of them; none if these are many, since the
    tests of what everything imports take an hour.
    """


def covering(file: str) -> Covering:
    """The test files that cover a source, in each list the one of its name and the nearest
    first.
    """
    module = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    name = f"test_{Path(file).stem}"
    # number of imports from each test file to the source
    reach = {test: reached[module] for test, reached in distances().items() if module in reached}
    tests_of_folder = _of_folder(reach, Path(file).parent.name)
    at_home = tests_of_folder or _of_folder(
        reach, import_graph.package_of(module).rpartition(".")[2]
    )
    # one import more is allowed at home
    most_at_home = min(at_home.values(), default=0) + 1
    home = {test for test, n in at_home.items() if n <= most_at_home or Path(test).stem == name}
    others = {test: n for test, n in reach.items() if test not in home}
    most_elsewhere = min(others.values(), default=0)
    elsewhere = {test for test, n in others.items() if n <= most_elsewhere}
    if home and len(elsewhere) > _MOST_ELSEWHERE:
        elsewhere = set()

    def rank(test: str) -> tuple[bool, int, str]:
        return Path(test).stem != name, reach[test], test

    return Covering(sorted(home, key=rank), sorted(elsewhere, key=rank))


def _of_folder(reach: Mapping[str, int], folder: str) -> dict[str, int]:
    """Tests in a folder of this name, or with its name."""
    return {
        test: n
        for test, n in reach.items()
        if Path(test).parent.name == folder or Path(test).stem == f"test_{folder}"
    }
