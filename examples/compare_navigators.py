"""Four navigators on exactly the same measurements of one flight."""

import matplotlib.pyplot as plt

import laisn_sim

flight = laisn_sim.fly("T5", {"duration_s": 300})
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
print("navigator    mean E_P [m]   largest [m]   share of time at the mirror image")
for variant in ("laisn-2", "laisn-3-1", "laisn-3-2", "tight"):
    errors = laisn_sim.errors(laisn_sim.navigate(flight, {"navigation.variant": variant}))
    mirrored = errors["mirror_locked"].mean()
    print(
        f"{variant:10} {errors['e_p_m'].mean():12.2f} {errors['e_p_m'].max():13.2f} "
        f"{mirrored:14.0%}"
    )
    axes.plot(errors["time_s"], errors["e_p_m"], lw=0.8, label=variant)
axes.set(xlabel="time [s]", ylabel="position error E_P [m]")
axes.legend()
figure.savefig("navigators.png", dpi=150)
