"""Arms of a study that need a package which is not installed: named before the first run."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

import laisn_sim
from experiments.study import study as studies
from experiments.study.extras import arms_left_out, installed
from experiments.study.plan import StudyPlan
from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from reports.tables import Table

RIVALS, _ = studies.studies_of("rivals", {}, quick=True)


@pytest.fixture
def without_gtsam(monkeypatch: pytest.MonkeyPatch) -> None:
    """GTSAM cannot be imported."""
    monkeypatch.setitem(sys.modules, "gtsam", None)


@pytest.mark.usefixtures("without_gtsam")
def test_arms_without_their_package_are_left_out_and_named() -> None:
    (reason,) = arms_left_out(RIVALS).values()
    assert "needs GTSAM, which is not installed" in reason
    assert "pip install" in reason
    remaining = installed(RIVALS)
    assert {*RIVALS} - {*remaining} == {"slow"}
    for part, study in remaining.items():
        assert {*RIVALS[part].arms} - {*study.arms} == {"factor-graph"} & {*RIVALS[part].arms}


def test_nothing_is_left_out_where_everything_is_installed() -> None:
    pytest.importorskip("gtsam")
    assert arms_left_out(RIVALS) == {}
    assert installed(RIVALS) == RIVALS


@pytest.mark.system
@pytest.mark.usefixtures("without_gtsam")
def test_a_built_in_study_names_arms_left_out_before_its_first_run_and_flies_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(plans: list[StudyPlan], *_: object, **__: object) -> None:
        raise LaisnError(f"planned: {sorted({arm for plan in plans for arm in plan.arms})}")

    monkeypatch.setattr(studies, "fly_until_narrow", stop)
    monkeypatch.setenv("COLUMNS", "200")
    result = CliRunner().invoke(app, ["rivals", "--quick", "--out", str(tmp_path)])
    first, planned = result.stderr.splitlines()
    assert first.startswith("laisn: left out: factor graph, which needs GTSAM, which is not")
    assert planned.startswith("laisn: planned: ['dead-reckoning', 'ekf'")
    assert "factor-graph" not in planned


@pytest.mark.usefixtures("without_gtsam")
def test_a_scenario_that_needs_a_missing_package_is_refused_before_it_is_flown() -> None:
    result = CliRunner().invoke(app, ["check", "T5", "--set", "navigation.variant=factor-graph"])
    assert result.exit_code == 2
    assert "navigation.variant: 'factor-graph' needs GTSAM, which is not installed" in result.output
    with pytest.raises(LaisnError, match="needs GTSAM"):
        laisn_sim.study("T5", vary={"navigation.variant": ["ekf", "factor-graph"]}, runs=1)


def test_a_table_without_pandas_names_the_command_that_installs_it() -> None:
    def fail_without_pandas(*_: object) -> None:
        raise ModuleNotFoundError("No module named 'pandas'")

    table = Table(SimpleNamespace(to_pandas=fail_without_pandas))
    with pytest.raises(LaisnError, match="pip install pandas"):
        table.to_pandas()
