"""Records of studies, and the numbers that documents take from them."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from laisn.errors import LaisnError
from reports.findings import (
    SCHEMA,
    Finding,
    Findings,
    interval_finding,
    plain_finding,
    read_findings,
    version_of,
)
from reports.intervals import Interval
from reports.version import OWN_PACKAGES, ROOT
from tools.documents import markers
from tools.documents.hull_trials import PUBLISHED_SPEED
from tools.documents.tables import closed_loop, markdown, ratios, tracking

SHARE = interval_finding(Interval(0.98, 0.965, 0.9951), "share", "")
RECORD = Findings(
    study="dive",
    command="laisn dive",
    modules=("reports.intervals",),
    version="1",
    findings={
        "removed ahrs": SHARE,
        "error level": plain_finding(0.70449999, "mean", "m"),
        "runs": plain_finding(1_165_696, "runs"),
        "held": plain_finding("1 and 7", "claims"),
        "harm": interval_finding(Interval(-0.176, -0.189, float("nan")), "share"),
        "unknown": plain_finding(float("nan"), "nothing"),
    },
)


@pytest.mark.parametrize(
    ("key", "spec", "text"),
    [
        ("removed ahrs", ".0%", "98 %"),
        ("removed ahrs", ".1% i", "98.0 % (96.5 to 99.5 %)"),
        ("removed ahrs", "high .0%", "100 %"),
        ("removed ahrs", "low .2f", "0.96"),
        ("error level", ".2f", "0.70"),
        ("runs", ",d", "1,165,696"),
        ("held", "s", "1 and 7"),
        ("harm", ".0% i", "−18 % (−19 to –)"),
        ("unknown", ".2f", "–"),
    ],
)
def test_findings_are_printed_in_the_requested_form(key: str, spec: str, text: str) -> None:
    assert format(RECORD[key], spec) == text


def test_a_number_that_is_rounded_to_zero_has_no_sign() -> None:
    assert format(plain_finding(-0.001, ""), ".1f") == "0.0"


@pytest.mark.parametrize(("value", "text"), [(2.6, "3"), (-2.6, "−3"), (0.4, "0")])
def test_whole_numbers_are_rounded_and_not_cut_off(value: float, text: str) -> None:
    assert format(plain_finding(value, ""), "d") == text


def test_an_unknown_format_is_refused() -> None:
    with pytest.raises(ValueError, match="is no format of a finding"):
        format(SHARE, ".0% within brackets")


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    RECORD.write(path)
    assert read_findings(path) == RECORD
    written = json.loads(path.read_text(encoding="utf-8"))
    assert written["schema"] == SCHEMA
    assert written["command"] == "laisn dive"
    assert written["findings"]["error level"] == {"value": 0.7045, "unit": "m", "what": "mean"}
    bytes_before = path.read_bytes()
    RECORD.write(path)
    assert path.read_bytes() == bytes_before


HEADER = f'"schema": {SCHEMA}, "study": "dive", "command": "", "version": "1"'
NO_RECORDS = [
    "",
    "[]",
    '{"schema": 0}',
    '{"schema": 1',
    "[" * 100_000,
    f"{{{HEADER}}}",
    f'{{{HEADER}, "findings": {{}}}}',
    f'{{{HEADER}, "modules": [], "findings": {{"a": {{"valve": 1}}}}}}',
    f'{{{HEADER}, "modules": [], "findings": []}}',
]


@pytest.mark.parametrize("text", NO_RECORDS, ids=range(len(NO_RECORDS)))
def test_a_file_that_is_no_record_is_reported(tmp_path: Path, text: str) -> None:
    path = tmp_path / "results.json"
    path.write_text(text)
    with pytest.raises(LaisnError, match=r"results\.json: no record"):
        read_findings(path)
    with pytest.raises(LaisnError, match="no record"):
        read_findings(tmp_path / "none.json")


def test_an_unknown_finding_names_those_that_are_alike() -> None:
    with pytest.raises(
        LaisnError, match=r"'dive' found no 'removed exact'; it found removed ahrs$"
    ):
        RECORD["removed exact"]


@pytest.mark.system
def test_the_version_is_that_of_what_makes_the_numbers(tmp_path: Path) -> None:
    for package in OWN_PACKAGES:
        shutil.copytree(
            ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    modules = (
        "experiments.studies.asymmetry.findings",
        "experiments.study.run",
        "experiments.studies.reproduce.findings",
    )
    before = version_of(modules, tmp_path)
    for name, counts in (
        ("reports/intervals.py", True),
        ("experiments/studies/asymmetry/findings.py", True),
        ("sim/water/currents.py", True),
        ("experiments/studies/asymmetry/figures.py", False),
        ("reports/page.py", False),
        ("experiments/studies/reproduce/claims.toml", True),
        ("experiments/studies/reproduce/page.md.j2", False),
        ("experiments/studies/depth.toml", False),
    ):
        path = tmp_path / name
        original = path.read_bytes()
        path.write_bytes(original + b"\n# edited\n")
        assert (version_of(modules, tmp_path) != before) == counts, name
        path.write_bytes(original)


RECORDS = {"dive": RECORD}


def test_numbers_and_tables_are_filled_in_and_nothing_else_is_touched() -> None:
    text = (
        "It removes <!--= dive removed ahrs .0% i -->nothing<!--/--> of it, over <!--= dive runs "
        ",d --><!--/--> runs.\n"
        "<!-- a comment -->\n<!-- table one -->\nold\n<!-- /table -->\nThe end: 98 %.\n"
    )
    expected = (
        "It removes <!--= dive removed ahrs .0% i -->98 % (96 to 100 %)<!--/--> of it, over "
        "<!--= dive runs ,d -->1,165,696<!--/--> runs.\n"
        "<!-- a comment -->\n<!-- table one -->\n\n| a |\n\n<!-- /table -->\nThe end: 98 %.\n"
    )
    tables = {"one": lambda actual: f"| {'a' if actual is RECORDS else 'b'} |\n"}
    filled = markers.filled(text, RECORDS, tables)
    assert filled == expected
    assert markers.filled(filled, RECORDS, tables) == filled


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("a <!--= swim runs d --><!--/-->", "no record of 'swim'; there are dive"),
        ("a <!--= dive sums d --><!--/-->", "found no 'sums'"),
        (
            "a <!--= dive runs d -->12",
            "not closed or not understood, one of: <!--= dive runs d -->",
        ),
        ("a <!--= dive runs -->12<!--/-->", "not closed or not understood"),
        ("a <!--= dive runs\nd -->12<!--/-->", "not closed or not understood"),
        ("- <!--= dive runs d -->12<!--/-->", "may not begin with a number's marker"),
        ("<!-- table two -->\n<!-- /table -->", "no table 'two'; there are "),
        ("<!-- table two -->\n", "not closed or not understood"),
    ],
)
def test_markers_that_cannot_be_filled_are_named(text: str, fault: str) -> None:
    with pytest.raises(LaisnError) as raised:
        markers.filled(text, RECORDS)
    assert fault in str(raised.value)


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A document and its record."""
    (tmp_path / "results").mkdir()
    up_to_date = replace(RECORD, version=version_of(RECORD.modules))
    up_to_date.write(tmp_path / "results" / "dive.json")
    page = tmp_path / "page.md"
    page.write_text("a <!--= dive runs d -->1165696<!--/--> b\n", encoding="utf-8")
    monkeypatch.setattr(markers, "ROOT", tmp_path)
    monkeypatch.setattr(markers, "DOCUMENTS", (page,))
    monkeypatch.setattr(markers.records, "__defaults__", (tmp_path / "results",))
    return tmp_path


@pytest.mark.system
def test_a_number_that_differs_from_the_record_is_an_error(checkout: Path) -> None:
    assert markers.check() == ([], [])
    page = checkout / "page.md"
    page.write_text(
        page.read_text(encoding="utf-8").replace("1165696", "1165697"), encoding="utf-8"
    )
    assert markers.check() == (
        ["page.md has not the numbers of docs/results: run make figures"],
        [],
    )
    markers.write()
    assert markers.check() == ([], [])


@pytest.mark.system
def test_a_study_of_other_sources_is_an_error(checkout: Path) -> None:
    stale = (["docs/results of dive: the sources have changed since: run make studies figures"], [])
    RECORD.write(checkout / "results" / "dive.json")
    assert markers.check(strict=True) == stale
    replace(RECORD, modules=("laisn.no_such_module",)).write(checkout / "results" / "dive.json")
    assert markers.check(strict=True) == stale


@pytest.mark.system
def test_a_measurement_of_other_sources_is_a_notice(checkout: Path) -> None:
    for name in ("mutants", "benchmarks"):
        replace(RECORD, study=name).write(checkout / "results" / f"{name}.json")
    assert markers.check() == (
        [],
        ["notice: docs/results of benchmarks, mutants: measured before the sources changed"],
    )


def test_documents_print_the_version_of_a_record(checkout: Path) -> None:
    text = markers.filled("a <!--= dive version s -->x<!--/--> b", {"dive": RECORD})
    assert text == f"a <!--= dive version s -->{RECORD.version}<!--/--> b"


def test_the_records_of_measurements_name_their_modules() -> None:
    for name in markers.MEASURED:
        assert markers.records()[name].modules


def record_of(study: str, findings: Mapping[str, Finding]) -> Findings:
    return Findings(study=study, command="", modules=(), version="", findings=findings)


class EveryFinding(dict[str, Finding]):
    """A record that has every finding, each of the same value and interval."""

    def __missing__(self, key: str) -> Finding:
        return Finding(value=0.25, low=0.125, high=0.5)

    def __contains__(self, key: object) -> bool:
        return True


def test_tables_take_every_cell_from_its_finding() -> None:
    findings = {"ratio base laisn-2": Finding(value=0.912, low=0.5, high=1.249)}
    table = ratios({"reproduce-physics": record_of("reproduce-physics", findings)}).splitlines()
    assert table[2] == "| Table 1: messages every 1 s | 0.91 (0.50 … 1.25) |  |"
    assert table[6] == "| Table 6: H_T = 0.2 m |  |  |"

    class ClosedLoopFindings(EveryFinding):
        def __missing__(self, key: str) -> Finding:
            counts = {"missions": 40, "lost-runs laisn-2 T5": 4, "lost-runs laisn-2": 9}
            return (
                plain_finding(counts.get(key, 0), "")
                if "runs" in key or key in counts
                else {
                    "error laisn-2 T5": plain_finding(1.26, ""),
                    "off laisn-2 T5": plain_finding(466.2, ""),
                }.get(key, super().__missing__(key))
            )

    rows = closed_loop({"closed-loop": record_of("closed-loop", ClosedLoopFindings())}).splitlines()
    assert rows[5].startswith("| T5 | 1.26, 466.20, 4 | 0.25, 0.25, 0 |")
    assert rows[-1].startswith("| lost, of 40 | 9, 25 % (12 to 50 %) | 0, 25 % (12 to 50 %) |")
    rows = tracking({"route-keeping": record_of("route-keeping", EveryFinding())}).splitlines()
    assert rows[2] == "| leader, L | 0.25 | 0.25 | 0.2 | 0.250 | 0.250 | 0.2 | 0.25 | 0.2 |"
    assert len(rows) == 12


def test_a_table_is_markdown() -> None:
    assert markdown(["a", "b"], [["1", "2"]]) == "| a | b |\n| --- | --- |\n| 1 | 2 |\n"


def test_the_record_of_hull_trials_has_the_published_figures() -> None:
    record = read_findings(markers.RECORDS / "hull-trials.json")
    for rpm, speed in PUBLISHED_SPEED.items():
        assert record[f"speed {rpm}"].value == pytest.approx(speed, abs=1e-4)
    assert (record["rise slowest"].value, record["rise quickest"].value) == pytest.approx(
        (5.08, 2.06), abs=0.01
    )
    assert (record["radius largest"].value, record["radius least"].value) == pytest.approx(
        (45.7, 18.5), abs=0.05
    )
    assert (record["pitch 1000"].value, record["pitch 1525"].value) == pytest.approx(
        (8.80, 20.86), abs=0.01
    )
    assert record["righting"].value == pytest.approx(8.5907, rel=1e-4)
