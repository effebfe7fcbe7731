"""The page of a sea, as `laisn sea` writes it, against the fields that are in its files."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from laisn_sim.cli.main import app
from tests.reports.test_page import embedded_figures
from tests.sim.water.field_data import gyre_velocity, metres_field, scenario_file


def curves(figure, name):
    """Points of the lines of a name, shape (n, 2), NaN between them."""
    lines = [line for line in figure["data"] if f">{name}<" in line.get("hovertemplate", "")]
    assert lines, name
    points = [
        np.array([line["x"], line["y"]], dtype=float).T  # None becomes NaN
        for line in lines
    ]
    return np.vstack(points)


def test_arrows_are_the_current_and_curves_the_plans(tmp_path: Path) -> None:
    toml = scenario_file(metres_field(tmp_path / "gyre.nc", 25.0, 20.0), 60.0)
    out = tmp_path / "sea.html"
    result = CliRunner().invoke(app, ["sea", str(toml), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert f"page in {out}" in result.stdout
    html = out.read_text(encoding="utf-8")
    assert "gyre.nc: u, v on" in html
    chart, section, current_over_time, profile, sound = embedded_figures(html)
    # start, tip, barb, tip, barb, gap
    arrows = curves(chart, "current").reshape(-1, 6, 2)
    start, arrow = arrows[:, 0], arrows[:, 1] - arrows[:, 0]
    u, v = gyre_velocity(*start.T, 0.0)
    # at the leader's 8 m, of 40 m in which it falls to half
    expected = 0.9 * np.column_stack([u, v])
    scale = np.hypot(*arrow.T).max() / np.hypot(*expected.T).max()
    np.testing.assert_allclose(arrow, scale * expected, atol=0.02 * np.hypot(*arrow.T).max())
    np.testing.assert_array_equal(curves(chart, "leader")[0], [0.0, 0.0])
    np.testing.assert_allclose(curves(section, "leader")[:, 1], -8.0)
    np.testing.assert_allclose(curves(section, "floor below leader")[:, 1], -30.0)
    times, speeds = curves(current_over_time, "leader").T
    assert times[-1] == 60.0
    u, v = gyre_velocity(np.zeros(1), np.zeros(1), 0.0)
    assert speeds[0] == pytest.approx(0.9 * float(np.hypot(u, v)[0]), abs=5e-4)
    assert curves(profile, "towards north")[0, 0] == pytest.approx(float(v[0]), abs=5e-4)
    np.testing.assert_array_equal(curves(sound, "sound")[:, 0], 1500.0)


def test_a_sea_without_files_has_a_page(tmp_path: Path) -> None:
    out = tmp_path / "sea.html"
    result = CliRunner().invoke(app, ["sea", "swarm", "--out", str(out)])
    assert result.exit_code == 0, result.output
    html = out.read_text(encoding="utf-8")
    assert "above the floor" in html
    assert "<h2>Files" not in html


def test_a_tide_that_is_slack_at_the_start_is_shown(tmp_path: Path) -> None:
    """It grows with time alone, to 0.6 m/s after a minute."""
    out = tmp_path / "sea.html"
    tide = "ocean.current_profile=[[0,0,90],[60,0.6,90]]"
    options = ["--set", tide, "--set", "duration_s=60"]
    result = CliRunner().invoke(app, ["sea", "T5", *options, "--out", str(out)])
    assert result.exit_code == 0, result.output
    html = out.read_text(encoding="utf-8")
    assert "Along the plans the current runs at up to 0.6 m/s" in html
    assert "an arrow of" not in html
    _, _, current_over_time, *_ = embedded_figures(html)
    for name in ("leader", "followers[0]"):
        times, speeds = curves(current_over_time, name).T
        np.testing.assert_allclose(speeds, 0.01 * times, atol=1e-4)
