"""Which solver moves the missions of a study, and that figures do not depend on it."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import models
from experiments.study.file import StudyError, study_from_table
from experiments.study.plan import engines_of, plan_of
from experiments.study.study import RESULTS
from laisn_sim.cli.main import app


def engines(table: dict[str, Any], *, scenario: str = "T5") -> list[str]:
    """Names of the solvers of a study with the keys of this table."""
    study = study_from_table({"scenario": scenario, "runs": 1} | table, "mine.toml", "mine")
    return engines_of(plan_of(study))


def scenario_file(tmp_path: Path, engine: str) -> str:
    """Write the file of a scenario that names its engine; its path."""
    path = tmp_path / "mine.toml"
    path.write_text(f'[timing]\nengine = "{engine}"\n[[followers]]\nroute = "T5"\n', "utf-8")
    return str(path)


def test_missions_move_by_their_own_equations_unless_told_otherwise(tmp_path: Path) -> None:
    assert engines({}) == ["direct"]
    assert engines({"engine": "mujoco"}) == ["mujoco"]
    assert engines({"set": {"timing.engine": "mujoco"}}) == ["mujoco"]
    assert engines({"vary": {"timing.engine": ["mujoco", "direct"]}}) == ["direct", "mujoco"]
    assert engines({}, scenario=scenario_file(tmp_path, "mujoco")) == ["mujoco"]
    assert engines({"engine": "direct"}, scenario=scenario_file(tmp_path, "mujoco")) == ["direct"]
    assert engines({"set": {"motion": "kinematic"}}) == ["point motion"]


def test_a_hull_that_mujoco_alone_solves_is_moved_by_it(tmp_path: Path) -> None:
    text = models.path("follower").read_text("utf-8")
    hull = tmp_path / "floating.xml"
    hull.write_text(text.replace('<body name="hull"', '<body name="hull" gravcomp="0.01"', 1))
    table = {"vary": {"followers.0.model": ["follower", str(hull)]}}
    assert engines(table) == ["direct", "mujoco"]
    with pytest.raises(StudyError, match="gravcomp, which MuJoCo alone solves"):
        engines(table | {"engine": "direct"})


def test_figures_of_a_study_are_the_same_by_both_solvers(tmp_path: Path) -> None:
    """Six missions of waves and drawn coefficients, by the command: positions differ by 1e-9 m at
    most, so do errors of navigation; the record of each names its solver.
    """
    columns = {}
    for engine in ("direct", "mujoco"):
        folder = tmp_path / engine
        options = [
            *("--runs", "2", "--realizations", "6", "--set", "duration_s=60"),
            *("--set", "ocean.waves.kind=jonswap", "--workers", "1", "--out", str(folder)),
            *("--draw", "followers.0.drag_scale={uniform=[0.8,1.2]}"),
            *(("--engine", engine) if engine == "mujoco" else ()),
        ]
        result = CliRunner().invoke(app, ["study", "T5", *options])
        assert result.exit_code == 0, result.output
        table = pq.read_table(folder / RESULTS)
        columns[engine] = np.array(
            [table[name].to_numpy() for name in ("e_p_mean_m", "e_b_mean_deg", "e_p_max_m")]
        )
        page = (folder / "report.html").read_text("utf-8")
        assert f"<dt>engine</dt><dd>{engine}</dd>" in page
    assert columns["direct"].shape == (3, 6)
    np.testing.assert_allclose(columns["direct"], columns["mujoco"], rtol=1e-6)
    assert not np.array_equal(columns["direct"], columns["mujoco"])
