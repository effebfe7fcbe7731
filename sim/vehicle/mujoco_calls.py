"""MuJoCo's C functions for compiled code: their addresses, the call, and a test of two steps
against `mj_step`.

Compiled code calls the stages of a step one by one, since the water's forces belong in their
middle. Which stages make up a step is MuJoCo's own affair and may change with a release. So a
release is tested when it is used first: two steps of a tumbling body must be those of `mj_step` to
the bit.
"""

import ctypes
import platform
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, SupportsIndex, cast

import mujoco
import numpy as np

from laisn.compiled import FOLDER, call_address, compiled
from laisn.errors import LaisnError
from laisn.held import refuse_copy

STAGES = ("mj_kinematics", "mj_comPos", "mj_makeM", "mj_fwdVelocity", "mj_factorM", "mj_step2")
"""Functions of (model, data) that make up a physics step."""

NO_CONTACT = (
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT.value | mujoco.mjtDisableBit.mjDSBL_CONTACT.value
)
"""Hulls pass through one another and through the floor, whatever their geoms are."""
_UNUSED = ("mjDSBL_SPRING", "mjDSBL_DAMPER", "mjDSBL_ACTUATION")
NO_FORCES = sum(getattr(mujoco.mjtDisableBit, name).value for name in _UNUSED)
"""Free bodies have neither springs nor dampers; effectors are those of `sim.vehicle.effectors`."""

_TUMBLING = """<mujoco><option timestep="0.01"/><worldbody><body name="hull"><freejoint/>
<inertial pos="0.1 -0.02 -0.03" mass="30" fullinertia="0.3 4 4.2 0.05 -0.1 0.02"/>
</body></worldbody></mujoco>"""


class Calls(NamedTuple):
    """Addresses with which compiled code steps a model and its data; they hold as long as these
    live.
    """

    stages: tuple[int, int, int, int, int, int]  # of STAGES
    model: int
    data: int

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """See `laisn.held.refuse_copy`."""
        refuse_copy(self)


@cache
def _library() -> ctypes.CDLL:
    """The shared library of the Python package; LaisnError if it is not there, or lacks a stage."""
    release = mujoco.__version__
    names = (f"libmujoco.so.{release}", f"libmujoco.{release}.dylib", "mujoco.dll")
    folder = Path(mujoco.__file__).parent
    paths = [folder / name for name in names if (folder / name).exists()]
    if not paths:
        raise LaisnError(f"MuJoCo {release}: {folder} holds none of {', '.join(names)}")
    library = ctypes.CDLL(str(paths[0]))
    missing = [name for name in STAGES if not hasattr(library, name)]
    if missing:
        raise LaisnError(f"MuJoCo {release} has no function {missing[0]}; {_advice()}")
    # MuJoCo's timers (mjData.timer) stand still: without a clock to read, a step of two hulls takes
    # a seventh less
    ctypes.c_void_p.in_dll(library, "mjcb_time").value = None
    return library


def _advice() -> str:
    return "install a release that passes: pip install 'mujoco==4.0.0'"


def _calls_of(model: mujoco.MjModel, data: mujoco.MjData) -> Calls:
    library = _library()
    addresses = [ctypes.cast(getattr(library, name), ctypes.c_void_p).value for name in STAGES]
    return Calls(cast(Any, tuple(addresses)), int(model._address), int(data._address))


@compiled
def _step(calls: Calls) -> None:
    """One step of MuJoCo by its stages, without further forces."""
    for stage in calls.stages:
        call_address(stage, calls.model, calls.data)


def largest_step_difference() -> float:
    """Largest difference of positions and velocities after two steps by stages and by `mj_step`.

    A body with products of inertia and an offset centre of gravity tumbles under a constant load,
    with the flags of the plant. 0 if the stages are those of a step.
    """
    model = mujoco.MjModel.from_xml_string(_TUMBLING)
    model.opt.disableflags |= NO_CONTACT | NO_FORCES
    states = []
    for by_stages in (True, False):
        data = mujoco.MjData(model)
        data.qvel[:] = (1.0, -0.2, 0.1, 0.3, -0.4, 0.5)
        data.qfrc_applied[:] = (20.0, -5.0, 290.0, 1.0, -2.0, 3.0)
        for _ in range(2):
            if by_stages:
                _step(_calls_of(model, data))
            else:
                mujoco.mj_step(model, data)
        states.append(np.concatenate([data.qpos, data.qvel, data.qacc]))
    return float(np.max(np.abs(states[0] - states[1])))


def _verdict_file() -> Path | None:
    """Where it is noted that this release has passed; None: nowhere."""
    if FOLDER is None:
        return None
    return FOLDER.parent / f"mujoco-{mujoco.__version__}-{platform.machine()}-passed"


@cache
def _require_tested() -> None:
    """Test the release of MuJoCo, once a machine and version of the sources; LaisnError if it
    fails.
    """
    verdict = _verdict_file()
    if verdict is not None and verdict.exists():
        return
    difference = largest_step_difference()
    if not difference == 0.0:
        raise LaisnError(
            f"MuJoCo {mujoco.__version__}: a step by its stages differs from mj_step "
            f"by {difference:.3g}; {_advice()}"
        )
    if verdict is not None:
        try:
            verdict.touch()
        except OSError:
            # tested again by the next process
            return


def calls_of(model: mujoco.MjModel, data: mujoco.MjData) -> Calls:
    """Addresses for compiled steps of an MjModel and its MjData.

    LaisnError if this release of MuJoCo does not step as `mj_step` does by these stages.
    """
    _require_tested()
    return _calls_of(model, data)
