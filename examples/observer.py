"""An observer sees every instant as soon as it is over, here the distance of two vehicles."""

import matplotlib.pyplot as plt
import numpy as np

import laisn_sim

times, distances = [], []


def watch(block):
    """Keep the distance of follower and leader: `block.truth.pose` has an instant in each row, then
    a row for each vehicle, the leader first, of x, y, z [m] and a quaternion.
    """
    leader, follower = np.moveaxis(block.truth.pose[:, :2, :3], 1, 0)
    times.extend(block.time)
    distances.extend(np.linalg.norm(follower - leader, axis=1))


sim = laisn_sim.Simulation("T5", {"duration_s": 200}, observers=[watch])
while not sim.done:
    sim.step(20.0)
print(f"{len(times)} instants; nearest {min(distances):.1f} m, farthest {max(distances):.1f} m")
figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
axes.plot(times, distances)
axes.set(xlabel="time [s]", ylabel="distance [m]")
figure.savefig("distance.png", dpi=150)
