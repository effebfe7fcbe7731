"""A mission in Python: load a scenario, fly it, compare two navigators on the same measurements,
draw the errors.
"""

import matplotlib.pyplot as plt
import numpy as np

import laisn_sim

# a built-in scenario or a TOML file, with changes as on the command line
mission = laisn_sim.load("following-sea", {"duration_s": 200, "leader.broadcast_attitude": True})
flight = laisn_sim.fly(mission)
pitch = np.degrees(flight.trajectory.pitch[:, 0])
print(f"leader's pitch: σ {pitch.std():.1f}°, at most {np.abs(pitch).max():.1f}°")

figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
for use, label in ((False, "leader taken for level"), (True, "leader's attitude used")):
    errors = laisn_sim.errors(laisn_sim.navigate(flight, {"navigation.use_attitude": use}))
    print(
        f"{label}: mean E_P {errors['e_p_m'].mean():.2f} m, mean E_B "
        f"{errors['e_b_deg'].mean():.2f}°"
    )
    axes.plot(errors["time_s"], errors["e_p_m"], lw=0.8, label=label)

axes.set(xlabel="time [s]", ylabel="position error E_P [m]")
axes.legend()
figure.savefig("own_mission.png", dpi=120)
print("figure in own_mission.png")
