"""Which tests are run on a mutant of a source, and which mutants count as equivalent."""

import tomllib
from pathlib import Path

import pytest

from tools.mutants.cover import covering, distances

EQUIVALENT = Path("tools/mutants/equivalent.toml")


@pytest.mark.system
@pytest.mark.parametrize(
    ("file", "first"),
    [
        ("laisn/fix.py", "tests/laisn/test_fix.py"),
        ("laisn/beacons.py", "tests/laisn/test_beacons.py"),
        ("laisn/tight/estimator.py", "tests/laisn/tight/test_estimator_compass.py"),
        ("sim/vehicle/hydrodynamics.py", "tests/sim/vehicle/test_hydrodynamics.py"),
        ("reports/intervals.py", "tests/reports/test_intervals.py"),
        (
            "experiments/studies/asymmetry/findings.py",
            "tests/experiments/studies/asymmetry/test_findings.py",
        ),
    ],
)
def test_tests_that_cover_a_source_begin_with_those_of_its_name_and_folder(
    file: str, first: str
) -> None:
    home, elsewhere = covering(file)
    assert home[0] == first
    assert {test.rpartition("/")[0] for test in home} == {first.rpartition("/")[0]}
    assert not {*home} & {*elsewhere}


def test_a_source_without_a_test_of_its_name_has_those_that_import_it_through_others() -> None:
    assert distances()["tests/sim/scenario/test_file.py"]["sim.scenario.navigation"] > 1
    assert "tests/sim/scenario/test_file.py" in covering("sim/scenario/navigation.py").home


@pytest.mark.system
def test_what_is_tested_in_another_folder_is_covered_there() -> None:
    """What followers sensed nearby, by what the summary tells of it."""
    summary = "tests/reports/test_summary_events.py"
    assert summary in covering("sim/sensing/proximity.py").elsewhere
    assert covering("laisn/arrays.py").elsewhere == []


def test_imports_of_modules_that_tests_share_count_as_those_of_the_test() -> None:
    """The tank imports the plant, and the test of hydrodynamics the tank."""
    assert distances()["tests/sim/vehicle/test_hydrodynamics.py"]["sim.vehicle.plant"] == 1


def test_mutants_that_are_listed_as_equivalent_are_of_lines_that_exist() -> None:
    entries = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8"))["equivalent"]
    lines = {
        file: [line.strip() for line in Path(file).read_text(encoding="utf-8").splitlines()]
        for file in {entry["file"] for entry in entries}
    }
    missing = [
        entry
        for entry in entries
        if any(line not in lines[entry["file"]] for line in entry["was"].split("\n"))
    ]
    assert not missing
