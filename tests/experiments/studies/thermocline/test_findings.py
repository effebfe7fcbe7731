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
    # on the quarter, D δB = (e_rear − e_front) / (b sin B) · D and the mean of both along the range
    depths, reach, baseline = (8.0, 20.0), 100.0, 2.0
    half = 0.5 * baseline
    slope = 0.0
    error = 0.0
    near, far = (math.hypot(reach / math.sqrt(2), reach / math.sqrt(2) + s) for s in (-half, half))
    near_error, far_error = (range_error("strong", depths, r) for r in (near, far))
    flat = math.sqrt(reach**2 + 12.0**2) / reach  # horizontal by slant ranges
    slope = (far_error - near_error) * flat / baseline / math.sin(math.pi / 4)
    error = 0.5 * (near_error + far_error) * flat
    expected = math.hypot(slope * reach, error)
    shift = fix_error("strong", "laisn-2", QuarterGeometry(depths, reach, baseline))
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
    strong, moderate = (shortest_spoilt_range(s, "laisn-2", 2.0) for s in ("strong", "moderate"))
    assert strong is not None
    assert moderate is not None
    assert strong < moderate
    at = max(
        fix_error("strong", "laisn-2", QuarterGeometry(pair, strong, 2.0))
        for pair in ((8.0, 20.0), (16.0, 16.0), (20.0, 20.0))
    )
    assert at == pytest.approx(0.5, abs=0.05)


def cells_of(errors: dict[str, list[float]], metric: str, **columns: object) -> Cells:
    rows = [{"arm": arm, **columns} for arm in errors]
    lists = [{"run": [0] * len(runs), metric: runs} for runs in errors.values()]
    return Cells(rows, lists)


def test_what_bending_adds_is_paired_by_run() -> None:
    runs = 25
    noise = np.random.default_rng(3).normal(size=runs)
    known = 10.0 + noise
    added = 0.3 + 0.01 * np.random.default_rng(4).normal(size=runs)
    errors = {"tight profile": known.tolist(), "tight straight": (known + added).tolist()}
    errors["tight mean"] = (known + 1.0).tolist()
    place = {"scenario": "strong.toml", "case": "16-16 100"}
    findings = dict(leg_findings(cells_of(errors, "e_p_mean_m", **place, **{BASELINE: 2.0})))
    assert findings["known tight strong 16-16 100"].number == pytest.approx(known.mean(), abs=1e-3)
    single = findings["single tight strong 16-16 100"].number
    assert single == pytest.approx(known.mean() + 1.0, abs=1e-3)
    difference = findings["added tight strong 16-16 100"]
    assert difference.number == pytest.approx(added.mean(), abs=1e-3)
    assert difference.high is not None
    assert difference.low is not None
    # of the difference alone, a hundredth of what the runs scatter
    assert difference.high - difference.low < 0.02
    other = dict(leg_findings(cells_of(errors, "e_p_mean_m", **place, **{BASELINE: 1.0})))
    assert set(other) == {f"{name} 1" for name in findings}
    closed = {arm: values for arm, values in errors.items() if arm != "tight mean"}
    for season, name in (("strong", "off tight"), ("weak", "off tight weak")):
        cells = cells_of(closed, "track_error_rms_m", scenario=f"{season}.toml")
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
