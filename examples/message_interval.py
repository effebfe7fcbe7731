"""How the error grows with the interval of messages, for LAISN-2 and for the tight navigator, whose
filter takes the ranges themselves.
"""

import matplotlib.pyplot as plt

import laisn_sim

intervals = (1, 2, 5, 10, 20)
errors = {"laisn-2": [], "tight": []}
for interval in intervals:
    flight = laisn_sim.fly("T4", {"duration_s": 300, "timing.message_interval_s": interval})
    for variant, means in errors.items():
        navigated = laisn_sim.navigate(flight, {"navigation.variant": variant})
        means.append(laisn_sim.errors(navigated)["e_p_m"].mean())

figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
for variant, means in errors.items():
    listed = (f"{i:2} s: {m:.2f} m" for i, m in zip(intervals, means, strict=True))
    print(f"{variant:8}", "  ".join(listed))
    axes.loglog(intervals, means, "o-", label=variant)
axes.set(xlabel="message interval [s]", ylabel="mean E_P [m]")
axes.legend()
figure.savefig("intervals.png", dpi=150)
