"""Read the Parquet tables of a study with pyarrow alone and plot the error over a factor with
its quartiles.
"""

import matplotlib.pyplot as plt
import numpy as np
import pyarrow.parquet as pq

import laisn_sim

laisn_sim.study(
    "T3",
    set={"duration_s": 100, "motion": "kinematic"},
    vary={"sensors.heading_bias_deg": [0, 1, 2, 4]},
    runs=30,
    out="out/compass",
)
runs = pq.read_table("out/compass/runs.parquet").to_pydict()
bias, error = np.array(runs["sensors.heading_bias_deg"]), np.array(runs["e_p_mean_m"])
bias_levels = np.unique(bias)
low, middle, high = (
    np.array([np.quantile(error[bias == b], q) for b in bias_levels]) for q in (0.25, 0.5, 0.75)
)

figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
axes.fill_between(bias_levels, low, high, alpha=0.3, label="quartiles of 30 runs")
axes.plot(bias_levels, middle, "o-", label="median")
axes.set(xlabel="compass bias [°]", ylabel="mean position error E_P of a run [m]")
axes.legend()
figure.savefig("compass.png", dpi=120)
print(
    "figure in compass.png; medians [m]:",
    dict(zip(bias_levels.tolist(), middle.round(3).tolist(), strict=True)),
)
