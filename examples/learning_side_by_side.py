"""The task of `learning.py` in sixteen missions that are stepped together: an environment for
Gymnasium's vectorised training loops. Each episode has noise and a current of its own. Needs
`pip install gymnasium`.
"""

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

import laisn_sim

BEHIND, PORT, DEPTH, LOST = 25.0, 10.0, 10.0, 150.0  # its place, and farthest from it [m]


def way(east, north, leader_heading, heading):
    """Ahead and to port [m], the way to the place, by where the leader is from here."""
    s, c, turn = np.sin(heading), np.cos(heading), leader_heading - heading
    ahead = east * s + north * c - BEHIND * np.cos(turn) + PORT * np.sin(turn)
    return ahead, north * s - east * c + BEHIND * np.sin(turn) + PORT * np.cos(turn)


class KeepPlaces(VectorEnv):
    """Decides each second on turn and speed, by the way to its place [10 m], speed and headings."""

    single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    single_observation_space = gymnasium.spaces.Box(-50.0, 50.0, (5,), np.float32)

    def __init__(self, num_envs, duration_s=200.0):
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
        self.num_envs = num_envs
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        settings = {"duration_s": duration_s, "navigation.variant": "tight"}
        self.sims = laisn_sim.Simulations("T5", settings, count=num_envs)
        self.ended = np.zeros(num_envs, bool)

    def _set_out(self, which):
        seeds = self.np_random.integers(2**31, size=which.sum())
        currents = self.np_random.uniform(0.0, 0.2, which.sum())
        each = [{"ocean.current_speed_m_s": float(current)} for current in currents]
        self.sims.reset(which, seed=seeds, each=each)

    def _seen(self):
        own, leader = self.sims.readings["follower"], self.sims.latest["follower"].message
        believed = self.sims.estimates["follower"]
        east, north = leader.east - believed.east, leader.north - believed.north
        ahead, port = way(east, north, leader.heading, own.heading)
        turn = leader.heading - own.heading
        seen = np.stack([ahead / 10, port / 10, own.speed, np.sin(turn), np.cos(turn)], axis=1)
        return np.nan_to_num(seen).clip(-50.0, 50.0).astype(np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.ended[:] = False
        self._set_out(~self.ended)
        self.sims.step(1.0)  # with the first message
        return self._seen(), {}

    def step(self, actions):
        began = self.ended
        if began.any():
            self._set_out(began)
        goes_on = ~began
        turned = self.sims.readings["follower"].heading + actions[:, 0]
        command = laisn_sim.Command(turned[goes_on], 1.0 + 0.6 * actions[goes_on, 1], DEPTH)
        self.sims.command("follower", command, goes_on)
        self.sims.step(1.0)
        leader, follower = self.sims.truth["leader"], self.sims.truth["follower"]
        east, north, _ = (leader.position - follower.position).T
        off = np.hypot(*way(east, north, leader.heading, 0.0))
        lost, over = (off > LOST) & goes_on, self.sims.done & goes_on
        self.ended = lost | over
        reward = np.where(goes_on, -off / 10, 0.0)
        return self._seen(), reward, lost, over & ~lost, {"distance_m": off}


envs = KeepPlaces(16)
seen, distances = envs.reset(seed=1)[0], []
for _ in range(450):
    # by hand: towards a point 10 m beyond the place, the faster the further it is
    actions = np.stack([np.arctan2(-seen[:, 1], seen[:, 0] + 1.0), seen[:, 0]], axis=1)
    seen, rewards, lost, over, info = envs.step(actions.clip(-1.0, 1.0))
    distances.append(info["distance_m"])
print(f"{np.mean(distances):.1f} m from their places over {np.size(distances)} decisions")
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(distances, color="tab:blue", linewidth=0.5)
axes.set(xlabel="decisions", ylabel="distance from its place [m]")
figure.savefig("distances.png", dpi=150)
