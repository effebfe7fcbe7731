"""The study of thermoclines: fixes that bending shifts, and the command."""

import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.studies.thermocline import figures
from experiments.studies.thermocline.findings import (
    QuarterGeometry,
    closed_findings,
    fix_error,
    fix_findings,
    leg_findings,
    range_error,
    shortest_spoilt_range,
)
from experiments.study.run import Cells
from laisn_sim.cli.main import app
from reports.figures import panel
from reports.findings import read_findings
from reports.page import page_of
from tests.golden import numbered_record, require_golden
from tools.documents.markers import RECORDS

BASELINE = "leader.baseline_m"


def test_nothing_shifts_a_fix_in_mixed_water() -> None:
    for variant in ("laisn-2", "laisn-3-2"):
        assert fix_error("mixed", variant, QuarterGeometry((8.0, 20.0), 100.0, 2.0)) < 1e-6


def test_a_fix_of_two_transmitters_shifts_as_the_difference_of_its_ranges() -> None:
    # on the quarter, B = 45°, with range errors e and the baseline b, the shift across the range is
    # D δB = (e_rear − e_front) / (b sin B) · D, and along it the mean of both errors
    depths, distance, baseline = (8.0, 20.0), 100.0, 2.0
    half_baseline = 0.5 * baseline
    near, far = (
        math.hypot(distance / math.sqrt(2), distance / math.sqrt(2) + offset)
        for offset in (-half_baseline, half_baseline)
    )
    near_error, far_error = (
        range_error("strong", depths, slant_range) for slant_range in (near, far)
    )
    slant_over_horizontal = math.sqrt(distance**2 + 12.0**2) / distance
    bearing_error = (
        (far_error - near_error) * slant_over_horizontal / baseline / math.sin(math.pi / 4)
    )
    mean_error = 0.5 * (near_error + far_error) * slant_over_horizontal
    expected = math.hypot(bearing_error * distance, mean_error)
    shift = fix_error("strong", "laisn-2", QuarterGeometry(depths, distance, baseline))
    assert shift == pytest.approx(expected, rel=0.05)
    # bearing errors of 0.4 to 1.5 m at 100 m, computed beside this project
    assert 0.3 < shift < 1.6


@pytest.mark.system
def test_fixes_of_the_record_are_those_of_this_code() -> None:
    recorded = read_findings(RECORDS / "thermocline.json")
    fixes = dict(fix_findings())
    kinds = ("range ", "fix ", "range-worst ", "from ")
    assert {*fixes} == {name for name in recorded.findings if name.startswith(kinds)}
    for name, finding in fixes.items():
        assert finding.value == pytest.approx(recorded[name].value, rel=1e-6, abs=1e-9), name


def test_bending_matters_from_nearer_on_the_stronger_the_thermocline() -> None:
    strong, moderate = (
        shortest_spoilt_range(profile, "laisn-2", 2.0) for profile in ("strong", "moderate")
    )
    assert strong is not None
    assert moderate is not None
    assert strong < moderate
    largest_error = max(
        fix_error("strong", "laisn-2", QuarterGeometry(pair, strong, 2.0))
        for pair in ((8.0, 20.0), (16.0, 16.0), (20.0, 20.0))
    )
    # a fix is spoilt from half a metre on
    assert largest_error == pytest.approx(0.5, abs=0.05)


def cells_of(errors: dict[str, list[float]], metric: str, **columns: object) -> Cells:
    """Cells with these columns, and the errors of the runs of each arm as a metric."""
    rows = [{"arm": arm, **columns} for arm in errors]
    run_arrays = [{"run": [0] * len(runs), metric: runs} for runs in errors.values()]
    return Cells(rows, run_arrays)


def test_what_bending_adds_is_paired_by_run() -> None:
    runs = 25
    noise = np.random.default_rng(3).normal(size=runs)
    with_profile = 10.0 + noise
    added = 0.3 + 0.01 * np.random.default_rng(4).normal(size=runs)
    errors = {
        "tight profile": with_profile.tolist(),
        "tight straight": (with_profile + added).tolist(),
    }
    errors["tight mean"] = (with_profile + 1.0).tolist()
    labels = {"scenario": "strong.toml", "case": "16-16 100"}
    findings = dict(leg_findings(cells_of(errors, "e_p_mean_m", **labels, **{BASELINE: 2.0})))
    assert findings["known tight strong 16-16 100"].number == pytest.approx(
        with_profile.mean(), abs=1e-3
    )
    single = findings["single tight strong 16-16 100"].number
    assert single == pytest.approx(with_profile.mean() + 1.0, abs=1e-3)
    difference = findings["added tight strong 16-16 100"]
    assert difference.number == pytest.approx(added.mean(), abs=1e-3)
    assert difference.high is not None
    assert difference.low is not None
    # the scatter of the difference alone, which is a hundredth of that of the runs
    assert difference.high - difference.low < 0.02
    with_other_baseline = dict(
        leg_findings(cells_of(errors, "e_p_mean_m", **labels, **{BASELINE: 1.0}))
    )
    assert set(with_other_baseline) == {f"{name} 1" for name in findings}
    closed_loop_errors = {arm: values for arm, values in errors.items() if arm != "tight mean"}
    for season, name in (("strong", "off tight"), ("weak", "off tight weak")):
        cells = cells_of(closed_loop_errors, "track_error_rms_m", scenario=f"{season}.toml")
        finding = dict(closed_findings(cells))[f"{name} added"]
        assert finding.number == pytest.approx(added.mean(), abs=1e-3)


def test_the_page_is_the_golden_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The findings of the recorded study, each with a number of its own."""
    for name in ("ray_picture", "profile_picture"):
        monkeypatch.setattr(figures, name, lambda *_: panel([], x_label="", y_label=""))
    recorded = read_findings(RECORDS / "thermocline.json")
    actual = numbered_record("thermocline", recorded.findings)
    values = {"quick": False, "found": actual, **figures.values(actual, {})}
    require_golden(page_of("experiments.studies.thermocline", [], values, actual), "thermocline")


@pytest.mark.typed
def test_the_command_writes_a_page_that_begins_with_the_answer(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["thermocline", "--quick", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "shift a fix of LAISN-2 by more than half a metre from" in page
