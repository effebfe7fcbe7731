"""Flown missions on disk: the truth of a mission is simulated once and serves all its cells."""

import hashlib
import json
import os
import warnings
from dataclasses import replace
from pathlib import Path
from zipfile import is_zipfile

import numpy as np

from experiments.campaign.failures import CampaignError, DamagedResult
from experiments.campaign.version import code_version
from sim.fleet import FleetError
from sim.motion import DivergedError, move
from sim.scenario.settings import Leader, Scenario
from sim.trajectory import Trajectory

_FREE = ("baseline_m", "middle_offset_m", "broadcast_attitude")
"""Of the leader: change what is heard, not how anything moves."""


def digest(content: object) -> str:
    """Hash of a JSON value."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]


def motion_key(scenario: Scenario) -> str:
    """Hash of everything that may change how the vehicles move, and of the code version."""
    leader = scenario.leader.model_dump(mode="json")
    for name in _FREE:
        leader.pop(name)
    return digest(
        {
            "version": code_version(),
            "motion": scenario.motion,
            "seed": scenario.seed,  # of the waves
            "duration_s": scenario.duration_s,
            "physics_step_s": scenario.timing.physics_step_s,
            "leader": leader,
            "followers": [f.model_dump(mode="json") for f in scenario.followers],
            "ocean": scenario.ocean.model_dump(mode="json"),
        }
    )


def sited(trajectory: Trajectory, leader: Leader) -> Trajectory:
    """The same motion with the transmitters where this leader has them."""
    offset = trajectory.site_offset.copy()
    places = {
        "leader/tx_rear": (0, -leader.baseline_m / 2),
        "leader/tx_front": (0, leader.baseline_m / 2),
        "leader/tx_middle": (1, leader.middle_offset_m),
    }
    for name, (axis, value) in places.items():
        offset[trajectory.site(name), axis] = value
    return replace(trajectory, site_offset=offset)


def read(folder: Path, scenario: Scenario) -> Trajectory | None:
    """The stored flight of a scenario's mission; None if it must be flown.

    A damaged file warns and counts as missing.
    """
    path = folder / f"{motion_key(scenario)}.npz"
    if not path.is_file():
        return None
    try:
        if not is_zipfile(path):
            raise ValueError("it is no .npz archive, or only a part of one")
        return Trajectory.load(path)
    except Exception as error:
        # foreign bytes make archives and arrays fail in many ways; here they are one
        reason = str(error).partition("\n")[0].removeprefix(f"{path} ") or type(error).__name__
        warnings.warn(f"{path} cannot be read and is flown again: {reason}", DamagedResult, stacklevel=2)
        return None


def store(folder: Path, scenario: Scenario, trajectory: Trajectory) -> None:
    """Write a flight under a temporary name and rename it."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{motion_key(scenario)}.npz"
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    trajectory.save(temporary)
    temporary.replace(path)


def fly(scenario: Scenario) -> Trajectory:
    """Fly a mission; CampaignError naming it if the simulation left finite numbers."""
    try:
        trajectory = move(scenario)
    except (DivergedError, FleetError) as error:
        # They carry the flight so far, which no process can hand to another: what they say is what counts.
        raise CampaignError(f"mission {scenario.name!r}: {error}") from None
    if not np.all(np.isfinite(trajectory.position)):
        raise CampaignError(f"mission {scenario.name!r}: the simulation left finite numbers")
    return trajectory
