"""`laisn` runs on a vehicle: without MuJoCo and the simulator, on the packages `NEEDED` alone."""

import json
import subprocess
import sys

import numpy as np
import pytest

from laisn.messages import LeaderMessage, Measurements
from laisn.navigators import find
from laisn.settings import NavigationSettings, Settings, TightSettings

NEEDED = ("numpy", "numba", "llvmlite", "scipy", "filterpy")
"""What docs/onboard.md says; llvmlite comes with numba."""

ONBOARD = f"""
import json, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package in {(*NEEDED, "laisn")!r} or package in sys.stdlib_module_names:
            return None
        raise ModuleNotFoundError(f"not on this vehicle: {{name}}")

sys.meta_path.insert(0, Blocked())
import numpy as np
from laisn.messages import LeaderMessage, OwnMotion, Ranges, Reception
from laisn.navigators import find
from laisn.settings import NavigationSettings, TightSettings

states = {{}}
for variant, settings in (("laisn-2", NavigationSettings()), ("tight", TightSettings())):
    navigator = find(variant).make(settings, np.array([0.0, 0.0, 0.0, 1.0]))
    for k in range(1, 51):
        reception = None
        if k % 10 == 0:
            message = LeaderMessage(0.1 * k, 20.0, 0.1 * k, 0.0, 1.0, 4.0)
            reception = Reception(message, Ranges(rear=21.0, front=20.5, middle=np.nan))
        navigator.step(OwnMotion(speed=1.0, heading=0.0, depth=8.0), reception)
    states[variant] = navigator.state.tolist()
print(json.dumps(states))
for package in ("mujoco", "pydantic", "sim"):
    try:
        __import__(package)
    except ModuleNotFoundError:
        continue
    raise SystemExit(f"{{package}} is not blocked")
"""


def measurements() -> Measurements:
    """The readings of `ONBOARD` as one mission."""
    steps = np.arange(10, 51, 10)
    unknown = [np.nan] * (len(LeaderMessage._fields) - 6)
    return Measurements(
        dt=0.1,
        speed=np.ones(50),
        heading=np.zeros(50),
        depth=np.full(50, 8.0),
        message_step=steps,
        message=np.array([[0.1 * k, 20.0, 0.1 * k, 0.0, 1.0, 4.0, *unknown] for k in steps]),
        ranges=np.array([[21.0, 20.5, np.nan]] * steps.size),
    )


@pytest.mark.system
def test_navigators_run_without_the_simulator_and_what_it_needs() -> None:
    process = subprocess.run(
        [sys.executable, "-c", ONBOARD], capture_output=True, text=True, timeout=300, check=False
    )
    assert process.returncode == 0, process.stderr
    states = json.loads(process.stdout)
    settings_of: dict[str, Settings] = {"laisn-2": NavigationSettings(), "tight": TightSettings()}
    for variant, settings in settings_of.items():
        navigator = find(variant).make(settings, np.array([0.0, 0.0, 0.0, 1.0]))
        estimates = navigator.run(measurements())
        assert states[variant] == estimates.state[-1].tolist()
