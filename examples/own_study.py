"""A study: does broadcasting the leader's attitude help a follower deep below a leader that is
out of trim?
"""

import matplotlib.pyplot as plt
import numpy as np

import laisn_sim

results = laisn_sim.study(
    {
        "name": "trim",
        "question": "Does a broadcast attitude help a follower deep below a leader out of trim?",
        "scenario": "T3",
        "runs": 20,
        "set": {"duration_s": 200, "leader.excess_buoyancy_n": 12.0},
        "vary": {"followers.0.depth_m": [10, 15, 20]},
        "arm": [
            {"name": "level"},
            {
                "name": "attitude",
                "leader.broadcast_attitude": True,
                "navigation.use_attitude": True,
            },
        ],
    },
    out="out/trim",
)
for row in results.table.rows():
    print(
        f"depth {row['followers.0.depth_m']:4} m, {row['arm']:8}: mean E_P {row['e_p_mean_m']:.2f} "
        "m"
    )
for name, found in results.findings.items():
    print(f"{name}: {found.value:.3f} ({found.low:.3f} to {found.high:.3f}) {found.unit}")
print(f"report in {results.report()}")

figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
for arm in ("level", "attitude"):
    chosen = results.table["arm"] == arm
    depths = np.array(results.table["followers.0.depth_m"])[chosen]
    axes.plot(depths, results.table["e_p_mean_m"][chosen], "o-", label=arm)
axes.set(xlabel="depth of the follower [m]", ylabel="mean E_P [m]")
axes.legend()
figure.savefig("trim.png", dpi=150)
