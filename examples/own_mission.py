"""A mission in Python: load a scenario, fly it, compare two navigators on the same measurements, draw the errors."""

import matplotlib.pyplot as plt
import numpy as np

from experiments.flight.library import load
from experiments.flight.summary import position_and_bearing_errors
from laisn.navigator import Navigator
from sim.flight import navigate
from sim.motion import simulate_motion

# a built-in scenario or a TOML file, with changes as on the command line
mission = load("following-sea", ["duration_s=200", "leader.broadcast_attitude=true"])
truth = simulate_motion(mission)
pitch = np.degrees(truth.pitch[:, 0])
print(f"leader's pitch: σ {pitch.std():.1f}°, at most {np.abs(pitch).max():.1f}°")

figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
for use, label in ((False, "leader taken for level"), (True, "leader's attitude used")):
    navigation = mission.navigation.model_copy(update={"use_attitude": use})
    flight = navigate(mission.model_copy(update={"navigation": navigation}), truth, Navigator)
    position_error, bearing_error = position_and_bearing_errors(flight)[0]
    print(f"{label}: mean E_P {position_error.mean():.2f} m, mean E_B {np.degrees(bearing_error).mean():.2f}°")
    axes.plot(truth.time[flight.step_index()], position_error, lw=0.8, label=label)

axes.set(xlabel="time [s]", ylabel="position error E_P [m]")
axes.legend()
figure.savefig("own_mission.png", dpi=120)
print("figure in own_mission.png")
