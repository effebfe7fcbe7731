"""The house: each room imports what its first page says, nothing imports in a circle, laisn knows no simulator."""

import ast
import re
from pathlib import Path

import pytest

from experiments.gallery import house

SOURCES = house.modules()
ROOMS = [name for name, path in SOURCES.items() if path.name == "__init__.py" and name not in ("laisn", "models")]
VOCABULARY = {"laisn", "laisn.arrays", "laisn.messages", "laisn.estimates", "laisn.settings", "laisn.geometry",
              "laisn.compiled", "laisn.elementary", "laisn.failure", "laisn.metrics", "laisn.navigating",
              "laisn.records", "laisn.tight.estimates", "laisn.tight.settings", "laisn.whole_files"}  # fmt: skip
"""What the simulator may know of navigation: words, not navigators."""


LATE = {
    "distributed": "optional, for clusters alone",
    "rerun": "optional, for recordings alone",
    "tests": "a checkout alone has it, and only documents are made of it",
    "OpenGL": "a library that is missing breaks the import",
    "mujoco": "so does a graphics library that MuJoCo lacks",
    "av": "codecs are needed by films alone",
    "scipy.io": "data sets in MATLAB's format alone need it",
    "scipy.ndimage": "a fifth of a second, and only children that render place cameras",
    "filterpy": "all of scipy.stats, two thirds of a second",
    "numba": "the compiler, which code from the cache does without",
    "rich": "tables on a terminal, which Python's users have no use for",
    "laisn.tight.navigator": "its code takes long to load, and few missions need it",
    "sim.vehicle.own_hull": "only scenarios with a hull of their own need MuJoCo to be looked at",
    "sim.station_plan": "only scenarios with stations need the plant to be looked at",
    "sim.flyable": "the sea and the hulls take half a second, and who reads or lists scenarios needs neither",
    "experiments.flight.swarm": "navigators of swarms take a tenth of a second, and few missions have stations",
    "experiments.study.page": "drawing takes a third of a second, and who reads a table draws nothing",
}
"""What may be imported within functions, and why; in the command and in `laisn_sim`, which answer at once, anything."""


def declared(room: str) -> set[str]:
    """What the first page of a room allows."""
    (last,) = re.findall(r"^Imports: ([^\"]*)", SOURCES[room].read_text(encoding="utf-8"), flags=re.MULTILINE)
    return set(last.split())


def within(module: str, room: str) -> bool:
    return module == room or module.startswith(f"{room}.")


def members(room: str) -> list[str]:
    """Modules that stand in a room itself, not in a room within it."""
    inner = [other for other in ROOMS if other != room and within(other, room)]
    return [m for m in house.imports() if within(m, room) and not any(within(m, other) for other in inner)]


@pytest.mark.parametrize("room", [room for room in ROOMS if "." in room])
def test_a_room_imports_what_its_first_page_says_and_no_more(room: str) -> None:
    used = {name for module in members(room) for name in house.imports()[module] if not within(name, room)}
    allowed = declared(room)
    assert not {name for name in used if not any(within(name, a) for a in allowed)}
    assert not {a for a in allowed if not any(within(name, a) for name in used)}, "declared, but not used"


@pytest.mark.parametrize("room", ROOMS)
def test_the_first_page_of_a_room_is_short(room: str) -> None:
    assert 1 <= len(SOURCES[room].read_text(encoding="utf-8").splitlines()) <= 11


def test_nothing_imports_in_a_circle() -> None:
    assert house.circle(house.imports()) == []
    assert house.circle(house.rooms(house.imports())) == []


def test_nothing_imports_the_command() -> None:
    imports = house.imports()
    outside = [module for module in imports if not within(module, "experiments.command")]
    assert not [m for m in outside for name in imports[m] if within(name, "experiments.command")]


def imported_by(package: str) -> set[tuple[str, str]]:
    """Pairs of a module of a package and a module of this project that it imports."""
    return {(module, name) for module, names in house.imports().items() if within(module, package) for name in names}


def knowing(library: str) -> list[str]:
    """Modules of `laisn` that import a library."""
    line = re.compile(rf"^\s*(import|from) {library}", flags=re.MULTILINE)
    return [m for m in SOURCES if within(m, "laisn") and line.search(SOURCES[m].read_text(encoding="utf-8"))]


def test_laisn_knows_no_simulator() -> None:
    assert {pair for pair in imported_by("laisn") if not within(pair[1], "laisn")} == set()
    assert knowing("mujoco") == []


def test_the_world_speaks_only_the_vocabulary_of_navigation() -> None:
    found = imported_by("sim")
    assert {pair for pair in found if within(pair[1], "experiments")} == set()
    assert {pair for pair in found if within(pair[1], "laisn") and pair[1] not in VOCABULARY} == set()


def test_one_module_knows_filterpy() -> None:
    assert knowing("filterpy") == ["laisn.filter"]


def late(path: Path) -> set[str]:
    """What a source imports within functions."""
    inside = [node for node, late in house.import_statements(path) if late]
    plain = {alias.name for node in inside if isinstance(node, ast.Import) for alias in node.names}
    modules = [(node.module or "", node.names) for node in inside if isinstance(node, ast.ImportFrom)]
    return plain | {f"{module}.{alias.name}" for module, names in modules for alias in names}


def test_an_import_within_a_function_has_its_reason() -> None:
    found = {m: late(path) for m, path in SOURCES.items() if not within(m, "experiments.command")}
    assert not {(m, name) for m, names in found.items() for name in names if not any(within(name, x) for x in LATE)}
    used = set().union(*found.values())
    assert not {name for name in LATE if not any(within(one, name) for one in used)}, "allowed, but not used"


def test_imports_are_seen_wherever_they_hide(tmp_path: Path) -> None:
    """The reader of imports itself: at the top, relative, of a name within a module, and inside a function."""
    for package in house.PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
    (tmp_path / "laisn" / "fix.py").write_text("def late():\n    from laisn.gate import REACH\n")
    (tmp_path / "laisn" / "gate.py").write_text("import numpy\nREACH = 1\n")
    (tmp_path / "sim" / "a.py").write_text("from . import b\nimport laisn.fix\n")
    (tmp_path / "sim" / "b.py").write_text("from sim import a\n")
    found = house.imports(tmp_path)
    assert found["laisn.fix"] == {"laisn.gate"}
    assert found["laisn.gate"] == set()
    assert found["sim.a"] == {"sim.b", "laisn.fix"}
    assert set(house.circle(found)) == {"sim.a", "sim.b"}
    assert house.floors(house.rooms({"sim.c": {"laisn.fix"}, "laisn.fix": set()})) == {"laisn": 0, "sim.c": 1}
