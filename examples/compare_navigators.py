"""Four navigators on exactly the same measurements of one flight."""

import laisn_sim

flight = laisn_sim.fly("T5", {"duration_s": 300})
print("navigator    mean E_P [m]   largest [m]   share of time at the mirror image")
for variant in ("laisn-2", "laisn-3-1", "laisn-3-2", "tight"):
    errors = laisn_sim.errors(laisn_sim.navigate(flight, {"navigation.variant": variant}))
    mirrored = errors["mirror_locked"].mean()
    print(
        f"{variant:10} {errors['e_p_m'].mean():12.2f} {errors['e_p_m'].max():13.2f} "
        f"{mirrored:14.0%}"
    )
