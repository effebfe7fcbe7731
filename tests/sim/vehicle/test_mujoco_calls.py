"""Compiled code calls MuJoCo's stages; a release whose stages are not those of `mj_step` is
refused.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import pytest

from laisn.compiled import call_address, compiled
from laisn.errors import LaisnError
from sim.vehicle import mujoco_calls
from sim.vehicle.mujoco_calls import STAGES, calls_of, largest_step_difference


@pytest.fixture(autouse=True)
def verdict_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    """The file that records that a release has passed, absent as where none has been tested yet."""
    path = tmp_path / "passed"
    monkeypatch.setattr(mujoco_calls, "_verdict_file", lambda: path)
    mujoco_calls._require_tested.cache_clear()
    yield path
    mujoco_calls._require_tested.cache_clear()
    mujoco_calls._library.cache_clear()


def falling_ball() -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    )
    return model, mujoco.MjData(model)


@compiled
def _call_stages(stages: tuple[int, ...], model: int, data: int, times: int) -> None:
    for _ in range(times):
        for stage in stages:
            call_address(stage, model, data)


def test_compiled_code_moves_the_data_of_python() -> None:
    """A ball falls by MuJoCo's semi-implicit Euler: after n steps it is g dt² n (n + 1) / 2
    lower.
    """
    model, data = falling_ball()
    _call_stages(*calls_of(model, data), 100)
    assert data.time == pytest.approx(100 * model.opt.timestep)
    assert data.qpos[2] == pytest.approx(-9.81 * model.opt.timestep**2 * 100 * 101 / 2, rel=1e-12)


def test_steps_by_stages_are_those_of_mujoco_to_the_bit(verdict_file: Path) -> None:
    assert largest_step_difference() == 0.0
    assert not verdict_file.exists()
    calls_of(*falling_ball())
    assert verdict_file.exists()


@pytest.mark.parametrize("left_out", ["mj_comPos", "mj_makeM", "mj_fwdVelocity", "mj_factorM"])
def test_release_whose_step_has_another_stage_is_refused(
    monkeypatch: pytest.MonkeyPatch, verdict_file: Path, left_out: str
) -> None:
    """As if a release had moved what a stage does into another function."""
    changed_stages = tuple("mj_kinematics" if name == left_out else name for name in STAGES)
    monkeypatch.setattr(mujoco_calls, "STAGES", changed_stages)
    with pytest.raises(LaisnError, match=r"differs from mj_step by .*; install a release that"):
        calls_of(*falling_ball())
    assert not verdict_file.exists()


def test_release_without_a_stage_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    mujoco_calls._library.cache_clear()
    monkeypatch.setattr(mujoco_calls, "STAGES", ("mj_kinetics", *STAGES[1:]))
    with pytest.raises(LaisnError, match="has no function mj_kinetics; install a release that"):
        calls_of(*falling_ball())


def test_package_without_a_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    mujoco_calls._library.cache_clear()
    monkeypatch.setattr(mujoco, "__version__", "4.9.0")
    with pytest.raises(
        LaisnError, match=r"MuJoCo 4\.9\.0: .* holds none of libmujoco\.so\.4\.9\.0"
    ):
        calls_of(*falling_ball())


def test_release_that_passed_is_not_tested_again(
    monkeypatch: pytest.MonkeyPatch, verdict_file: Path
) -> None:
    verdict_file.touch()

    def fail_if_tested() -> float:
        raise AssertionError("tested again")

    monkeypatch.setattr(mujoco_calls, "largest_step_difference", fail_if_tested)
    calls_of(*falling_ball())
