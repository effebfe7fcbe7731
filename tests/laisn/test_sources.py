"""Which files a module can reach: Python's own reading of the sources is the judge."""

import ast
from importlib.util import resolve_name

import pytest

from laisn import sources
from laisn.sources import PACKAGES, ROOT, Sources

FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def parsed(module: str, text: str, package: bool) -> set[str]:
    """Names that a module imports, as Python's parser finds them."""
    within = module if package else module.rpartition(".")[0]
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = resolve_name("." * node.level + (node.module or ""), within) if node.level else node.module or ""
            found |= {base} | {f"{base}.{alias.name}" for alias in node.names}
    return found


def test_no_import_of_this_project_is_overlooked():
    overlooked = {}
    for path in FILES:
        package = path.name == "__init__.py"
        place = path.parent if package else path.with_suffix("")
        module = ".".join(place.relative_to(ROOT).parts)
        text = path.read_text(encoding="utf-8")
        found = set(sources.imports(module, text.encode(), package=package))
        overlooked[module] = parsed(module, text, package) - found
    assert len(overlooked) > 300
    assert {module: names for module, names in overlooked.items() if names} == {}


@pytest.mark.parametrize(
    "text",
    [
        "import a\n", "import a.b as c, d\n", "from a import b as c, d\n", "from . import a\n", "from .a import b\n",
        "from .. import a\n", "from ..a.b import c\n", "from a import (b,\n    c,  # why (not)\n    d\n)\n",
        "from a import b, \\\n    c\n", "if True: import a; import b\n", "def late():\n    from a import b\n",
        '"""Import (as in: from here import ( there."""\nimport a\nfrom b import c\n', "from a import(b)\n",
        "from a import *\n", "try:\n\timport a\nexcept ImportError:\n\ta = None\n",
    ],
)  # fmt: skip
def test_every_way_to_write_an_import_is_known(text):
    assert parsed("one.two.three", text, False) <= set(sources.imports("one.two.three", text.encode()))


def test_packages_around_a_module_and_circles_are_reached_once(tmp_path):
    (tmp_path / "sim" / "deep").mkdir(parents=True)
    texts = {
        "sim/__init__.py": "import sim.first\n",
        "sim/first.py": "from sim.deep import second\n",
        "sim/deep/__init__.py": "",
        "sim/deep/second.py": "import sim.first, numpy, sim.absent\n",
        "sim/apart.py": "",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    reached = Sources(tmp_path).reached(["sim.deep.second"])
    assert set(reached) == {"sim", "sim.first", "sim.deep", "sim.deep.second"}
    assert reached["sim.deep"] == tmp_path / "sim" / "deep" / "__init__.py"
    with pytest.raises(FileNotFoundError, match=r"module sim\.absent is not there"):
        Sources(tmp_path).reached(["sim.absent"])
