"""Missions given another attitude of the leader: what a study changes while all else stays equal."""

from dataclasses import replace

import numpy.typing as npt

from sim.geometry import attitude
from sim.trajectory import Trajectory


def tilted(trajectory: Trajectory, pitch: npt.ArrayLike, roll: npt.ArrayLike = 0.0) -> Trajectory:
    """The trajectory with the leader's pitch and roll replaced; its track, depth and heading stay.

    Args:
        trajectory: to be copied; vehicle 0 is the leader.
        pitch: positive nose up, one for all instants or shape (n,), [rad].
        roll: positive starboard down, likewise.

    Returns:
        A trajectory whose leader's sites sit where that attitude puts them.
    """
    quaternion = trajectory.quaternion.copy()
    quaternion[:, 0] = attitude.from_euler(trajectory.heading[:, 0], pitch, roll)
    return replace(trajectory, quaternion=quaternion)


def leveled(trajectory: Trajectory) -> Trajectory:
    """The trajectory with a level leader: what the paper's follower assumes."""
    return tilted(trajectory, 0.0)
