"""Settings of all tests."""

import gc
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, Phase, settings

from tests.without_plugins import without_plugins

# Compiling on first use takes longer than any deadline. Every run tries the same examples, so that
# a test that passes today passes tomorrow; `make fuzz` looks for others, and what it finds becomes
# an explicit example.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile(
    "fuzz",
    deadline=None,
    max_examples=2000,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "mutants", deadline=None, derandomize=True, phases=[Phase.explicit, Phase.generate]
)
settings.register_profile("quick", deadline=None, derandomize=True, max_examples=25)
settings.load_profile("repeatable")

# Modules that are loaded are no garbage; to search them for some takes a tenth of the time in which
# they are loaded.
gc.disable()

# A shell that starts something in the background has it ignore Ctrl-C, and so would all that it
# starts; tests press it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


FLIGHT = """
from experiments.flight.fly import fly
from experiments.flight.library import load_scenario
fly(load_scenario("T5", ["duration_s=2"]))
"""
CAMPAIGN = """
from experiments.campaign.plans import CellPlan, compute
from sim.simulation import simulate_motion
from sim.scenario.settings import Follower, Scenario
scenario = Scenario(motion="kinematic", duration_s=2, followers=(Follower(route="T5"),))
compute(simulate_motion(scenario), [CellPlan(scenario=scenario, runs=1, keep_steps=True)])
"""
NAVIGATORS = """
from dataclasses import replace
import numpy as np
from laisn.beacons import BeaconNavigator, BeaconSettings
from laisn.messages import LeaderMessage, Measurements
from laisn.tight.navigator import TightNavigator
from laisn.settings import TightSettings
measurements = Measurements(
    dt=0.1,
    speed=np.ones(5),
    heading=np.zeros(5),
    depth=np.full(5, 8.0),
    message_step=np.array([5]),
    message=np.array([LeaderMessage(0.5, 20.0, 0.0, 0.0, 1.0, 4.0)]),
    ranges=np.array([[21.0, 20.0, 20.5]]),
)
start = np.array([0.0, 0.0, 0.0, 1.0])
TightNavigator(TightSettings(), start).run(measurements)
beacons = np.full((1, 3, 3), [20.0, 0.0, 4.0])
BeaconNavigator(BeaconSettings(), start).run(replace(measurements, transmitters=beacons))
"""
"""Each compiles what the others do not, the last one the most."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile once, on all cores, before several workers would each compile all of it."""
    if not config.getoption("numprocesses", None) or hasattr(config, "workerinput"):
        return
    # workers and single processes need not load the compiler here
    from laisn.compiled import FOLDER

    marker = FOLDER and FOLDER / "compiled-for-tests"
    if marker is None or marker.exists():
        return
    children = [
        subprocess.Popen([sys.executable, "-c", program])
        for program in (NAVIGATORS, FLIGHT, CAMPAIGN)
    ]
    if not [child.returncode for child in children if child.wait()]:
        marker.touch()


def pytest_collection_finish() -> None:
    """Search for garbage from here on, but not among what was loaded to collect the tests."""
    gc.freeze()
    gc.enable()


def pytest_unconfigure() -> None:
    """Take what is left out of pytest's last search for garbage.

    Its five rounds through all modules take a worker seconds on a busy machine, and xdist
    interrupts one that is not done in five.
    """
    gc.freeze()


@pytest.fixture
def no_plugins() -> Iterator[None]:
    """No plugin is loaded when a test starts; those that it loads are forgotten after it."""
    with without_plugins():
        yield
