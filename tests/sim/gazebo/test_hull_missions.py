"""Imported hulls in missions: they have all that one needs, are flyable and keep their way."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn_sim.cli.main import app
from sim.vehicle.own_hull import hull_errors
from tests.sim.gazebo.imported import DATA, changed, import_file, import_text

LINEAR_DAMPING_TAGS = (
    "<xU>-4</xU><yV>-6.2</yV><zW>-5.2</zW>",
    "<kP>-1.5</kP><mQ>-1.5</mQ><nR>-0.4</nR>",
)


@pytest.mark.parametrize("name", ["torpedo", "hovering", "long_range", "probe"])
@pytest.mark.parametrize("role", ["leader", "follower"])
def test_imported_hulls_lack_nothing(name: str, role: str) -> None:
    assert hull_errors(import_file(DATA / f"{name}.sdf").text, role) == []


def scenario(folder: Path, hull: str, seconds: int) -> Path:
    """A follower of an imported hull at 0.5 m/s with a right-angled turn, in a file."""
    (folder / "hull.xml").write_text(hull, encoding="utf-8")
    path = folder / "mission.toml"
    east = seconds / 4
    path.write_text(
        f"duration_s = {seconds}\n[[followers]]\nmodel = 'hull.xml'\n"
        f"waypoints = [[0, 0, 0], [{seconds // 2}, {east}, 0], [{seconds}, {east}, {east}]]\n",
        encoding="utf-8",
    )
    return path


def test_a_hovering_hull_without_linear_damping_is_flyable(tmp_path: Path) -> None:
    """As public models of the BlueROV2 with the added mass of Wu (2018): quadratic drag alone."""
    text = (DATA / "hovering.sdf").read_text(encoding="utf-8")
    hull = import_text(
        tmp_path, changed(text, *[(tags, "") for tags in LINEAR_DAMPING_TAGS]), 1025.0
    )
    path = scenario(tmp_path, hull.text, 120)
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0, result.output
    assert "valid: 120 s, 1 follower" in result.output


def test_an_imported_hull_keeps_its_route(tmp_path: Path) -> None:
    """Within a length of the vehicle of the end of a leg of 15 m, after a turn of 90°."""
    hull = import_file(DATA / "hovering.sdf", 1025.0)
    path = scenario(tmp_path, hull.text, 60)
    flight = laisn_sim.fly(path)
    end_position = flight.trajectory.position[-1, 1]
    np.testing.assert_allclose(end_position[:2], (15.0, 15.0), atol=0.5)
    assert flight.trajectory.position[-1, 1, 2] == pytest.approx(
        flight.trajectory.position[0, 1, 2], abs=0.3
    )
