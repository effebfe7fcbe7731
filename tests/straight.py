"""Straight, steady motion with a fixed attitude: truth whose sound has a closed form."""

import numpy as np
import numpy.typing as npt

from sim import attitude
from sim.scenario.settings import Acoustics, Follower, Leader, OceanTable, Scenario, Timing
from sim.trajectory import Trajectory

SITES = {
    "leader": {
        "tx_rear": (-1.0, 0.0, 0.0),
        "tx_front": (1.0, 0.0, 0.0),
        "tx_middle": (0.0, 0.1, 0.0),
        "depth_sensor": (0.0, 0.0, 0.0),
    },
    "follower": {"hydrophone": (0.0, 0.0, 0.0), "depth_sensor": (0.0, 0.0, 0.0)},
}
"""Body positions of the sites [m]; the hydrophone sits where depth is measured."""


def make_scenario(
    acoustics: Acoustics | None = None,
    *,
    filter_step: float = 0.1,
    floor: float = 30.0,
    **other_settings: object,
) -> Scenario:
    """20 s with a message each second."""
    return Scenario(
        name="straight",
        duration_s=20.0,
        timing=Timing(filter_step_s=filter_step, message_interval_s=1.0),
        leader=Leader(),
        followers=(Follower(route="T5"),),
        ocean=OceanTable(floor_depth_m=floor),
        acoustics=acoustics or Acoustics(),
        **other_settings,  # type: ignore[arg-type]
    )


def make_trajectory(
    follower: npt.ArrayLike,
    *,
    leader: npt.ArrayLike = (0.0, 0.0, -8.0),
    leader_velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
    follower_velocity: npt.ArrayLike = (0.0, 0.0, 0.0),
    heading_pitch_roll: tuple[float, float, float] = (np.pi / 2, 0.0, 0.0),
) -> Trajectory:
    """Leader and follower from their starts in the world [m]; the leader's attitude in [rad]."""
    time = 0.1 * np.arange(201)
    start = np.array([leader, follower], dtype=np.float64)
    velocity = np.array([leader_velocity, follower_velocity], dtype=np.float64)
    n, v = time.size, 2
    attitudes = np.stack([attitude.from_euler(*heading_pitch_roll), attitude.from_euler(np.pi / 2)])
    sites = [
        (f"{name}/{site}", vehicle, offset)
        for vehicle, name in enumerate(SITES)
        for site, offset in SITES[name].items()
    ]
    return Trajectory(
        names=("leader", "follower"),
        time=time,
        pose=np.concatenate(
            [start + time[:, None, None] * velocity, np.broadcast_to(attitudes, (n, v, 4))], axis=2
        ),
        twist=np.broadcast_to(np.hstack([velocity, np.zeros((v, 3))]), (n, v, 6)).copy(),
        water_velocity=np.zeros((n, v, 3)),
        effector_states=np.zeros((n, v, 0)),
        effector_force=np.zeros((v, 0, 3)),
        site_names=tuple(name for name, _, _ in sites),
        site_vehicle=np.array([vehicle for _, vehicle, _ in sites]),
        site_offset=np.array([offset for _, _, offset in sites]),
    )
