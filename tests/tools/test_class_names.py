"""Whoever searches for a class meets one definition of its name."""

import ast
import re
from collections import defaultdict
from pathlib import Path


def definitions_of_public_classes(paths: list[Path]) -> dict[str, list[str]]:
    """File and line of each definition of a class at the top of a module, by its name."""
    definitions = defaultdict[str, list[str]](list)
    for path in paths:
        source = path.read_text(encoding="utf-8")
        # to parse a source takes long
        if not re.search(r"^class ", source, re.MULTILINE):
            continue
        for node in ast.parse(source).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                definitions[node.name].append(f"{path}:{node.lineno}")
    return definitions


def test_classes_of_one_name_are_met_in_any_two_files(tmp_path: Path) -> None:
    first = tmp_path / "first.py"
    first.write_text("class Link:\n    class Part: ...\n\nclass _Row: ...\n", encoding="utf-8")
    second = tmp_path / "second.py"
    second.write_text("class _Row: ...\n\nclass Part: ...\n\nclass Link: ...\n", encoding="utf-8")
    definitions = definitions_of_public_classes([first, second])
    assert definitions == {"Link": [f"{first}:1", f"{second}:5"], "Part": [f"{second}:3"]}


def test_no_two_public_classes_share_a_name() -> None:
    packages = ("laisn", "sim", "reports", "experiments", "laisn_sim", "models", "tools")
    paths = [path for package in packages for path in sorted(Path(package).rglob("*.py"))]
    definitions = definitions_of_public_classes(paths)
    assert {"Simulation", "Scenario", "FlightRecord"} <= definitions.keys()
    shared = {name: lines for name, lines in definitions.items() if len(lines) > 1}
    assert not shared
