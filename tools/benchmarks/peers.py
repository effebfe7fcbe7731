"""Other programs that do comparable work, where they are installed."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from tools.benchmarks.row import Row, least_time

FOSSEN = "pip install git+https://github.com/cybergalactic/PythonVehicleSimulator"
_STEP_S = 0.02
_STEPS = 500


def _fossen_loop(vehicle: Any, attitude_euler: Callable[..., Any]) -> Callable[[], object]:
    """Autopilot, dynamics and attitude of the simulator's own loop, without its growing table."""

    def steps() -> None:
        pose = np.zeros(6)
        velocity = vehicle.nu
        actuators = vehicle.u_actual
        for _ in range(_STEPS):
            command = vehicle.depthHeadingAutopilot(pose, velocity, _STEP_S)
            velocity, actuators = vehicle.dynamics(pose, velocity, actuators, command, _STEP_S)
            pose = attitude_euler(pose, velocity, _STEP_S)

    return steps


def peers() -> list[Row]:
    """A step of the REMUS 100 of T. I. Fossen's Python Vehicle Simulator, with its autopilots."""
    try:
        vehicles = import_module("python_vehicle_simulator.vehicles.remus100")
        kinematics = import_module("python_vehicle_simulator.lib.gnc")
    except ImportError:
        return [Row(f"not measured: {FOSSEN}", np.nan, "")]
    # to 10 m and 30° by a propeller at 1200 /min, in a current of 0.3 m/s towards 30°
    vehicle = vehicles.remus100("depthHeadingAutopilot", 10.0, 30.0, 1200.0, 0.3, 30.0)
    seconds = least_time(_fossen_loop(vehicle, kinematics.attitudeEuler), 5)
    return [Row("Python Vehicle Simulator, one REMUS 100", seconds / _STEPS * 1e6, "µs/step")]
