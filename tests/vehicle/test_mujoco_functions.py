"""Whether compiled code can call MuJoCo is checked at the start, and reported."""

from collections.abc import Iterator
from typing import Any

import mujoco
import pytest

from laisn.compiled import compiled
from laisn.failure import LaisnError
from sim.vehicle import plant
from sim.vehicle.plant import call, find


@pytest.fixture(autouse=True)
def forget() -> Iterator[None]:
    """Search the library again."""
    plant.library.cache_clear()
    yield
    plant.library.cache_clear()


def falling() -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    )
    return model, mujoco.MjData(model)


@compiled
def _in_turn(stages: tuple[int, ...], model: int, data: int, times: int) -> None:
    for _ in range(times):
        for stage in stages:
            call(stage, model, data)


def test_compiled_code_moves_the_data_of_python() -> None:
    """A ball falls by MuJoCo's semi-implicit Euler: after n steps it is g dt² n (n + 1) / 2
    lower.
    """
    model, data = falling()
    _in_turn(*find(model, data), 100)
    assert data.time == pytest.approx(100 * model.opt.timestep)
    assert data.qpos[2] == pytest.approx(-9.81 * model.opt.timestep**2 * 100 * 101 / 2, rel=1e-12)


def test_release_that_was_not_tried_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "4.1.0")
    with pytest.raises(
        LaisnError, match=r"MuJoCo is 4\.1\.0, compiled steps were tried with 4\.0\.0 alone"
    ):
        find(*falling())
