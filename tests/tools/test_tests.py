"""Whoever looks for the tests of a module finds them: folders as in the packages, one way to import
what tests share, and a first line that says what a file requires.
"""

import ast
from pathlib import Path

import pytest

TESTS = Path("tests")
WITHOUT_PACKAGE = {"system", "data"}
OF_SEVERAL_MODULES = {
    "experiments/studies/asymmetry/test_conditions.py",
    "experiments/studies/test_template_findings.py",
    "experiments/test_plugin_answers.py",
    "laisn/test_extending.py",
    "laisn/test_missing_depth.py",
    "laisn/test_on_a_vehicle.py",
    "laisn_sim/cli/test_times_of_estimates.py",
    "reports/test_conclusions.py",
    "sim/control/test_roll.py",
    "sim/scenario/test_start_and_hover.py",
    "sim/sensing/test_hidden_truth.py",
    "sim/test_different_navigators.py",
    "sim/test_formation.py",
    "sim/test_mission_end.py",
    "sim/test_roles.py",
    "sim/test_station_plan.py",
    "sim/vehicle/test_attitudes.py",
    "sim/vehicle/test_buoyancy.py",
    "sim/vehicle/test_fossen.py",
    "sim/vehicle/test_moving_water.py",
    "sim/vehicle/test_remus.py",
    "sim/vehicle/test_scales.py",
    "tools/test_class_names.py",
    "tools/test_docstring_tables.py",
    "tools/test_records.py",
    "tools/test_scenario_scope.py",
    "tools/test_statements.py",
    "tools/test_tests.py",
    "tools/test_workflows.py",
}
"""Tests that are named after what they require."""


def folder_errors(files: list[Path]) -> list[str]:
    """Test files whose folder is that of no package."""
    errors = []
    for path in files:
        folder = path.relative_to(TESTS).parent
        if folder.parts and folder.parts[0] in WITHOUT_PACKAGE:
            continue
        if folder.parts and not any(folder.glob("*.py")):
            errors.append(f"{path}: there is no package {folder}")
    return errors


def is_named_after_a_module(path: Path) -> bool:
    """Whether a test file has the name of a module or package of its folder, perhaps with what of
    it.
    """
    folder = path.relative_to(TESTS).parent
    # the package itself, its modules, and packages within it
    names = {
        folder.name,
        *(inner.stem for inner in folder.iterdir() if inner.suffix in ("", ".py")),
    }
    name = path.stem.removeprefix("test_")
    return any(name == module or name.startswith(f"{module}_") for module in names)


def import_errors(path: Path, source: str) -> list[str]:
    """Imports of modules of tests by another path than `tests.…`, and files that do not say what
    they require.
    """
    tree = ast.parse(source)
    shared = {module.stem for module in path.parent.glob("*.py")} - {"conftest", "__init__"}
    errors = []
    if not ast.get_docstring(tree):
        errors.append(f"{path}: no first line that says what it requires")
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = ["." * node.level + (node.module or "")]
        else:
            continue
        errors += [
            f"{path}:{node.lineno}: import {name!r} as tests.…"
            for name in names
            if name.startswith(".") or name.partition(".")[0] in shared
        ]
    return errors


@pytest.fixture(scope="module")
def files() -> list[Path]:
    return sorted(TESTS.rglob("*.py"))


def test_each_folder_is_that_of_a_package(files: list[Path]) -> None:
    assert len(files) > 200
    assert folder_errors(files) == []
    without_package_folder = TESTS / "sim" / "boats" / "test_sail.py"
    assert folder_errors([without_package_folder]) == [
        f"{without_package_folder}: there is no package sim/boats"
    ]


def test_files_are_named_after_modules_unless_several_meet(files: list[Path]) -> None:
    named_otherwise = {
        path.relative_to(TESTS).as_posix()
        for path in files
        if path.name.startswith("test_")
        and path.relative_to(TESTS).parts[0] not in WITHOUT_PACKAGE
        and not is_named_after_a_module(path)
    }
    assert named_otherwise == OF_SEVERAL_MODULES
    assert is_named_after_a_module(TESTS / "sim" / "test_tracking_contact.py")
    assert is_named_after_a_module(TESTS / "laisn_sim" / "test_laisn_sim.py")
    assert not is_named_after_a_module(TESTS / "sim" / "test_trackings.py")


def test_what_tests_share_is_imported_by_one_path(files: list[Path]) -> None:
    assert [error for path in files for error in import_errors(path, path.read_text("utf-8"))] == []
    path = TESTS / "test_other.py"
    source = '"""It holds."""\n\nimport synthetic\nfrom .absurd import tables\n'
    assert import_errors(path, source) == [
        f"{path}:3: import 'synthetic' as tests.…",
        f"{path}:4: import '.absurd' as tests.…",
    ]
    assert import_errors(path, "import os\n") == [
        f"{path}: no first line that says what it requires"
    ]
