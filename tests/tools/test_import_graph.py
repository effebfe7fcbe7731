"""The import graph: a package imports what its `__init__.py` lists, without cycles; `laisn`
imports no simulator.
"""

import ast
import re
from pathlib import Path

import pytest

from tools import import_graph

SOURCES = import_graph.modules()
PACKAGES = [
    name
    for name, path in SOURCES.items()
    if path.name == "__init__.py" and name not in ("laisn", "laisn_sim", "models")
]
SHARED_TYPES = {
    "laisn",
    "laisn.arrays",
    "laisn.messages",
    "laisn.estimates",
    "laisn.held",
    "laisn.settings",
    "laisn.spilled",
    "laisn.geometry",
    "laisn.compile_errors",
    "laisn.compiled",
    "laisn.simd",
    "laisn.vector_math",
    "laisn.errors",
    "laisn.metrics",
    "laisn.navigators",
    "laisn.plugins",
    "laisn.swarm",
}
"""What the simulator may import of navigation: shared types, not navigators."""


ALLOWED_LATE = {
    "distributed": "optional, for clusters alone",
    "rerun": "optional, for recordings alone",
    "gtsam": "optional, for one navigator alone",
    "rosbags": "optional, for bags of ROS alone",
    "OpenGL": "a library that is missing breaks the import",
    "mujoco": "so does a graphics library that MuJoCo lacks",
    "av": "codecs are needed by films alone",
    "scipy.io": "data sets in MATLAB's format alone need it",
    "scipy.stats": "45 MB and two thirds of a second, and only draws of studies need it",
    "scipy.special": "a fifth of a second, and no flight needs it",
    "scipy.optimize": "half a second, and only hulls with fins need it",
    "filterpy": "only the readable navigator needs it",
    "scipy.ndimage": "a fifth of a second, and only children that render place cameras",
    "laisn.compiled": "the compiler takes half a second to load, and only showing progress needs "
    "none",
    "sim.film": "drawing takes half a second to load, and tables of ranges need none",
    "sim.closed_loop": "control of formations takes long to load, and few missions need it",
    "sim.vehicle": "only the list of vehicles needs it, of what lists scenarios",
    "sim.water": "as sim.vehicle",
    "models": "only the list of vehicles needs it",
    "xarray": "optional, for fields from files alone",
    "h5netcdf": "as xarray",
    "gsw": "optional, for casts alone",
    "numpy": "only the list of vehicles needs it, of what lists scenarios",
    "sim.feasibility": "the sea and the hulls take half a second, and reading or listing scenarios "
    "needs neither",
    "plotly.graph_objects": "it takes a second to import, and pages need text alone",
    "experiments.study.charts": "as experiments.study.page",
    "reports.flight_report": "a figure needs no templates",
    "reports.vector": "matplotlib takes half a second, and only figures for a paper need it",
    "experiments.flight.results": "few studies are filmed",
    "experiments.study.page": "drawing takes a third of a second, and reading a table needs none "
    "of it",
}
"""What may be imported within functions, and why; in the command and in `laisn_sim`, which
answer at once, anything.
"""


def declared_imports(package: str) -> set[str]:
    """What the docstring of a package allows."""
    (last,) = re.findall(
        r"^Imports:([^\"]*)", SOURCES[package].read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    return set(last.split())


def within(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


def members(package: str) -> list[str]:
    """Modules of a package itself, not of a package within it."""
    inner = [other for other in PACKAGES if other != package and within(other, package)]
    return [
        module
        for module in import_graph.imports()
        if within(module, package) and not any(within(module, other) for other in inner)
    ]


@pytest.mark.parametrize("package", [package for package in PACKAGES if "." in package])
def test_a_package_imports_what_its_docstring_lists_and_no_more(package: str) -> None:
    imports = import_graph.imports()
    used = {
        name for module in members(package) for name in imports[module] if not within(name, package)
    }
    allowed = declared_imports(package)
    assert not {name for name in used if not any(within(name, entry) for entry in allowed)}
    assert not {entry for entry in allowed if not any(within(name, entry) for name in used)}, (
        "declared, but not used"
    )


@pytest.mark.parametrize("package", PACKAGES)
def test_the_init_file_of_a_package_is_short(package: str) -> None:
    assert 1 <= len(SOURCES[package].read_text(encoding="utf-8").splitlines()) <= 11


def test_nothing_imports_in_a_cycle() -> None:
    assert import_graph.cycle(import_graph.imports()) == []
    assert import_graph.cycle(import_graph.package_imports(import_graph.imports())) == []


def test_the_product_imports_neither_tools_nor_tests() -> None:
    """The wheel has neither."""
    named = {
        (module, name)
        for module, path in SOURCES.items()
        for name in import_graph.imported_names(path, module)
    }
    assert ("laisn_sim", "laisn.errors.LaisnError") in named
    assert not {pair for pair in named if within(pair[1], "tools") or within(pair[1], "tests")}


TOP_DOWN = ("laisn_sim", "experiments", "reports", "sim", "laisn", "models")
"""Packages from top to bottom; the last two know nothing of each other."""


def test_a_package_imports_only_those_below_it() -> None:
    assert set(TOP_DOWN) == set(import_graph.PACKAGES)
    upwards = {
        (module, name)
        for number, package in enumerate(TOP_DOWN)
        for module, name in imported_by(package)
        if any(within(name, above) for above in TOP_DOWN[:number])
    }
    assert upwards == set()
    assert {pair for pair in imported_by("laisn") if within(pair[1], "models")} == set()


def test_nothing_imports_the_command() -> None:
    imports = import_graph.imports()
    outside = [module for module in imports if not within(module, "laisn_sim")]
    assert not [
        module for module in outside for name in imports[module] if within(name, "laisn_sim")
    ]


def imported_by(package: str) -> set[tuple[str, str]]:
    """Pairs of a module of a package and a module of this project that it imports."""
    return {
        (module, name)
        for module, names in import_graph.imports().items()
        if within(module, package)
        for name in names
    }


def importers_of(library: str) -> list[str]:
    """Modules of `laisn` that import a library."""
    import_line = re.compile(rf"^\s*(import|from) {library}", flags=re.MULTILINE)
    return [
        module
        for module in SOURCES
        if within(module, "laisn")
        and import_line.search(SOURCES[module].read_text(encoding="utf-8"))
    ]


def test_laisn_imports_no_simulator() -> None:
    assert {pair for pair in imported_by("laisn") if not within(pair[1], "laisn")} == set()
    assert importers_of("mujoco") == []


def test_sim_imports_from_laisn_only_the_shared_types() -> None:
    actual = imported_by("sim")
    assert {pair for pair in actual if within(pair[1], "experiments")} == set()
    assert {
        pair for pair in actual if within(pair[1], "laisn") and pair[1] not in SHARED_TYPES
    } == set()


def test_one_module_imports_filterpy() -> None:
    assert importers_of("filterpy") == ["laisn.navigator"]


def late_imports(path: Path) -> set[str]:
    """What a source imports within functions."""
    statements = [node for node, is_late in import_graph.import_statements(path) if is_late]
    names = {
        alias.name for node in statements if isinstance(node, ast.Import) for alias in node.names
    }
    from_imports = [
        (node.module or "", node.names) for node in statements if isinstance(node, ast.ImportFrom)
    ]
    return names | {f"{module}.{alias.name}" for module, names in from_imports for alias in names}


def test_an_import_within_a_function_has_its_reason() -> None:
    late_by_module = {
        module: late_imports(path)
        for module, path in SOURCES.items()
        if not within(module, "laisn_sim")
    }
    assert not {
        (module, name)
        for module, names in late_by_module.items()
        for name in names
        if not any(within(name, allowed) for allowed in ALLOWED_LATE)
    }
    used = set().union(*late_by_module.values())
    assert not {
        name for name in ALLOWED_LATE if not any(within(imported, name) for imported in used)
    }, "allowed, but not used"


def test_imports_inside_functions_and_branches_are_found(tmp_path: Path) -> None:
    """The reader of imports itself: at the top, relative, of a name within a module, and inside
    a function.
    """
    for package in import_graph.PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
    (tmp_path / "laisn" / "fix.py").write_text("def late():\n    from laisn.gate import REACH\n")
    (tmp_path / "laisn" / "gate.py").write_text("import numpy\nREACH = 1\n")
    (tmp_path / "sim" / "a.py").write_text("from . import b\nimport laisn.fix\n")
    (tmp_path / "sim" / "b.py").write_text("from sim import a\n")
    actual = import_graph.imports(tmp_path)
    assert actual["laisn.fix"] == {"laisn.gate"}
    assert actual["laisn.gate"] == set()
    assert actual["sim.a"] == {"sim.b", "laisn.fix"}
    assert set(import_graph.cycle(actual)) == {"sim.a", "sim.b"}
    assert import_graph.layers(
        import_graph.package_imports({"sim.c": {"laisn.fix"}, "laisn.fix": set()})
    ) == {
        "laisn": 0,
        "sim.c": 1,
    }
    above: dict[str, set[str]] = {"laisn": set(), "sim.c": {"laisn"}, "experiments.d": {"laisn"}}
    assert import_graph.layers(above) == {"laisn": 0, "sim.c": 1, "experiments.d": 2}
