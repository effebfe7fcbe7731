"""The error of a fix from a leader's pitch, as `laisn pitch` prints it, by hand."""

import csv
import math
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.pitch import PitchGeometry, _scale, pitch_page, rows_by_bearing, summary
from laisn_sim.cli.main import app
from tests.golden import require_golden
from tests.reports.test_page import embedded_figures

BASELINE, PITCH, DISTANCE, BELOW = 3.0, 12.0, 30.0, 15.0
OPTIONS = ("--baseline", "3", "--pitch", "12", "--distance", "30", "--below", "15")


def error_by_hand(bearing_deg: float, pitch_deg: float = PITCH) -> tuple[float, bool]:
    """Error of the fix, and whether the rule for the axis decides, by the formulas of
    docs/asymmetry.md.

    `along_hull` is the follower's coordinate along the pitched hull.
    """
    pitch, bearing = math.radians(pitch_deg), math.radians(bearing_deg)
    ahead, aside = DISTANCE * math.cos(bearing), DISTANCE * math.sin(bearing)
    along_hull = ahead * math.cos(pitch) - BELOW * math.sin(pitch)
    mean_square = DISTANCE**2 + BASELINE**2 / 4
    rear_range = math.sqrt(mean_square + BASELINE * along_hull)
    # intersections closer than 0.1 m count as one
    if abs(along_hull) > math.sqrt(DISTANCE**2 - 0.05**2):
        return math.hypot(ahead + BASELINE / 2 + rear_range, aside), True
    return math.hypot(ahead - along_hull, aside - math.sqrt(DISTANCE**2 - along_hull**2)), False


@pytest.fixture(scope="module")
def printed_and_folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What the command prints, and the folder of what it writes."""
    folder = tmp_path_factory.mktemp("pitch")
    files = ("--out", str(folder / "page.html"), "--csv", str(folder / "map.csv"))
    result = CliRunner().invoke(app, ["pitch", *OPTIONS, *files])
    assert result.exit_code == 0, result.output
    return result.stdout, folder


def test_the_table_has_the_errors_and_where_the_axis_decides(
    printed_and_folder: tuple[str, Path],
) -> None:
    rows = re.findall(
        r"^(\d+)° +([\d.]+) m +(?:[\d.]+ m|–) +(two points|on the axis)$",
        printed_and_folder[0],
        re.M,
    )
    assert [int(row[0]) for row in rows] == [*range(0, 181, 15)]
    kinds = set()
    for bearing, error, kind in rows:
        expected, on_axis = error_by_hand(float(bearing))
        assert float(error) == pytest.approx(expected, abs=6e-4)
        assert (kind == "on the axis") == on_axis
        kinds.add(on_axis)
    assert kinds == {False, True}


def test_the_map_has_the_error_at_every_pitch_and_bearing(
    printed_and_folder: tuple[str, Path],
) -> None:
    stdout, folder = printed_and_folder
    with (folder / "map.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    pitches = {float(row["pitch_deg"]) for row in rows}
    assert min(pitches) <= -PITCH
    assert max(pitches) >= PITCH
    for row in rows[::17]:
        expected, on_axis = error_by_hand(float(row["bearing_deg"]), float(row["pitch_deg"]))
        assert float(row["error_m"]) == pytest.approx(expected, abs=1e-6)
        assert (row["on_axis"] == "True") == on_axis
    html = (folder / "page.html").read_text(encoding="utf-8")
    chart, view_from_above, curve = embedded_figures(html)
    (contours,) = (trace for trace in chart["data"] if trace["type"] == "contour")
    errors_drawn = np.array(contours["customdata"], dtype=float)
    errors_in_file = np.array([float(row["error_m"]) for row in rows]).reshape(errors_drawn.shape)
    np.testing.assert_allclose(errors_drawn, errors_in_file, rtol=1e-4)
    assert view_from_above["data"][0]["type"] == "scatter"
    worst = max(value for value in curve["data"][0]["y"])
    assert f"largest error is {worst:.2f} m" in stdout
    assert "laisn pitch --baseline 3 --pitch 12 --distance 30 --below 15" in html


def test_the_page_is_the_golden_one() -> None:
    """Its numbers are those of the table and of the map above."""
    geometry = PitchGeometry(baseline=BASELINE, pitch_deg=PITCH, distance=DISTANCE, below=BELOW)
    require_golden(pitch_page(geometry, []), "pitch")


def test_the_predicted_side_puts_a_follower_ahead() -> None:
    """Nose down the circles do not meet ahead: the rule `behind` puts the fix a diameter off."""
    behind, ahead = (
        PitchGeometry(
            baseline=3.0, pitch_deg=-12.0, distance=30.0, below=15.0, side_rule=rule
        ).fix_at(0.0)
        for rule in ("behind", "predicted")
    )
    assert behind.on_axis
    assert ahead.on_axis
    assert behind.error > 2 * DISTANCE
    assert ahead.error < 0.5


@pytest.mark.parametrize(("threshold", "on_axis"), [(59.9, False), (60.1, True)])
def test_intersections_closer_than_the_threshold_are_one(threshold: float, on_axis: bool) -> None:
    """Abeam of a level leader they are 2 · 30 m apart."""
    geometry = PitchGeometry(
        baseline=3.0, pitch_deg=0.0, distance=DISTANCE, below=15.0, threshold=threshold
    )
    assert geometry.fix_at(90.0).on_axis == on_axis


def test_circles_that_touch_have_one_point() -> None:
    """Straight ahead and astern of a level leader they touch where the follower is."""
    geometry = PitchGeometry(baseline=2.0, pitch_deg=0.0, distance=30.0, below=10.0)
    kinds = [fix.kind for _, fix, _ in rows_by_bearing(geometry)]
    assert kinds == ["one point", *["two points"] * 11, "one point"]


@pytest.mark.system
def test_the_largest_error_may_be_in_a_sector_of_a_tenth_of_a_degree() -> None:
    """A level leader: only where the intersections, 2 · 30 m · sin(0.05°) apart, are nearer to each
    other than 0.1 m is the follower, ahead, put astern, at least twice its distance off.
    """
    geometry = PitchGeometry(baseline=2.0, pitch_deg=0.0, distance=30.0, below=10.0)
    bearing, fix = geometry.worst()
    assert bearing == pytest.approx(0.05)
    assert 60.0 < fix.error < 64.0
    assert "The largest error is 62.00 m, at 0.05° off the bow" in summary(geometry)


def test_the_engine_of_campaigns_makes_the_same_fixes() -> None:
    """Errors of `laisn pitch` against those of the compiled fixes in campaigns."""
    from experiments.studies.asymmetry.fix_map import sweep
    from laisn.settings import NavigationSettings

    geometry = PitchGeometry(baseline=3.0, pitch_deg=12.0, distance=30.0, below=15.0)
    bearings = np.radians(np.arange(0.5, 180.0, 7.0))
    points = np.column_stack(
        [np.full_like(bearings, value) for value in (geometry.pitch, 15.0, 30.0)] + [bearings]
    )
    settings = NavigationSettings(baseline=3.0, hydrophone_height=0.0)
    of_campaigns = np.hypot(*sweep(points, settings).T)
    of_the_page = [geometry.fix(bearing, geometry.pitch).error for bearing in bearings.tolist()]
    np.testing.assert_allclose(of_the_page, of_campaigns, atol=1e-4)


@pytest.mark.parametrize(
    ("option", "value"), [("--baseline", "0"), ("--pitch", "90"), ("--distance", "nan")]
)
def test_an_impossible_geometry_is_refused(option: str, value: str, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    result = CliRunner().invoke(app, ["pitch", option, value, "--out", str(page)])
    assert result.exit_code != 0
    assert f"{option}: expected" in str(result.exception) + result.output
    assert not page.exists()


@pytest.mark.parametrize(
    ("error", "expected"),
    [(0.6, 0.5), (1.2, 1.0), (1.6, 2.0), (4.0, 5.0), (8.0, 10.0), (0.031, 0.02), (140.0, 100.0)],
)
def test_the_scale_is_the_round_number_nearest_to_the_error_abeam(
    monkeypatch: pytest.MonkeyPatch, error: float, expected: float
) -> None:
    fix = SimpleNamespace(error=error)
    monkeypatch.setattr(PitchGeometry, "fix_at", lambda *_: fix)
    assert _scale(object.__new__(PitchGeometry)) == pytest.approx(expected)
