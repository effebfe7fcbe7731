"""Two vehicles driven by hand: one by forces and moments on its hull, one by its effectors."""

import numpy as np

import laisn_sim

sim = laisn_sim.Simulation("T5", {"duration_s": 60})
idle = np.zeros_like(sim.truth["follower"].effectors)

# 6 N ahead and 0.4 N m to port; the follower lets go of all its effectors
sim.command("leader", laisn_sim.Wrench(surge=6.0, yaw=0.4))
sim.command("follower", idle)
for _ in range(4):
    sim.step(10.0)
    leader, follower = sim.truth["leader"], sim.truth["follower"]
    print(
        f"{sim.time:4.0f} s  leader: heading {np.degrees(leader.heading):5.1f}°, "
        f"{np.hypot(*leader.velocity[:2]):.2f} m/s;  "
        f"follower: {np.hypot(*follower.velocity[:2]):.2f} m/s"
    )

# both go on as the scenario has it
sim.command("leader", None)
sim.command("follower", None)
sim.step(20.0)
print(f"{sim.time:4.0f} s  follower again: {np.hypot(*sim.truth['follower'].velocity[:2]):.2f} m/s")
sim.flight().draw("by_hand.png", "motion")
