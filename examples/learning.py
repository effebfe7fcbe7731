"""A Gymnasium environment around a mission: a follower learns to keep a place behind the leader,
by what a follower may see. Its reward comes from the truth. Needs `pip install gymnasium`; change
observation, action and reward to those of your own task.
"""

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
from gymnasium.utils.env_checker import check_env

import laisn_sim

BEHIND, PORT, DEPTH, LOST = 25.0, 10.0, 10.0, 150.0  # its place, and farthest from it [m]


def way(east, north, leader_heading, heading):
    """Ahead and to port [m], the way to the place, by where the leader is from here."""
    s, c, turn = np.sin(heading), np.cos(heading), leader_heading - heading
    ahead = east * s + north * c - BEHIND * np.cos(turn) + PORT * np.sin(turn)
    return ahead, north * s - east * c + BEHIND * np.sin(turn) + PORT * np.cos(turn)


class KeepPlace(gymnasium.Env):
    """Decides each second on turn and speed, by the way to its place [10 m], speed and headings."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    observation_space = gymnasium.spaces.Box(-50.0, 50.0, (5,), np.float32)

    def __init__(self, duration_s=200.0):
        settings = {"duration_s": duration_s, "navigation.variant": "tight"}
        self.sim = laisn_sim.Simulation("T5", settings)

    def _advance(self):
        self.sim.step(1.0)
        own, believed = self.sim.readings["follower"], self.sim.estimates["follower"]
        leader = self.sim.latest["follower"].message
        east, north = leader.east - believed.east, leader.north - believed.north
        ahead, port = way(east, north, leader.heading, own.heading)
        turn = leader.heading - own.heading
        seen = np.array([ahead / 10, port / 10, own.speed, np.sin(turn), np.cos(turn)], np.float32)
        return seen.clip(-50.0, 50.0)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.sim.reset(seed=int(self.np_random.integers(2**31)))
        return self._advance(), {}

    def step(self, action):
        heading = self.sim.readings["follower"].heading + float(action[0])
        command = laisn_sim.Command(heading, 1.0 + 0.6 * float(action[1]), DEPTH)
        self.sim.command("follower", command)
        seen = self._advance()
        leader, follower = self.sim.truth["leader"], self.sim.truth["follower"]
        east, north, _ = leader.position - follower.position
        off = float(np.hypot(*way(east, north, leader.heading, 0.0)))
        return seen, -off / 10, off > LOST, self.sim.done, {"distance_m": off}


env = KeepPlace()
seen, ended = env.reset(seed=1)[0], False
distances = []
while not ended:
    # by hand: towards a point 10 m beyond the place, the faster the further it is
    action = np.clip([np.arctan2(-seen[1], seen[0] + 1.0), seen[0]], -1.0, 1.0)
    seen, reward, lost, over, info = env.step(action)
    ended = lost or over
    distances.append(info["distance_m"])
print(f"{distances[-1]:.1f} m from its place after {env.sim.time:.0f} s")
check_env(KeepPlace(20.0), skip_render_check=True)
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(distances)
axes.set(xlabel="time [s]", ylabel="distance from its place [m]")
figure.savefig("distance.png", dpi=150)
