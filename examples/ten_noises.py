"""One motion, ten draws of the noise: how much of an error is luck."""

import matplotlib.pyplot as plt
import numpy as np

import laisn_sim

runs = [
    laisn_sim.errors(laisn_sim.fly("T5", {"duration_s": 200, "run": run, "motion": "kinematic"}))
    for run in range(10)
]
table = np.array([errors["e_p_m"] for errors in runs])
means = table.mean(axis=1)
print(f"mean E_P of a run: {means.mean():.2f} m, σ {means.std(ddof=1):.2f} m over {len(runs)} runs")

figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
time = runs[0]["time_s"]
axes.plot(time, table.T, color="0.8", lw=0.5)
axes.plot(time, np.median(table, axis=0), label="median of ten")
axes.set(xlabel="time [s]", ylabel="E_P [m]")
axes.legend()
figure.savefig("ten_noises.png", dpi=150)
