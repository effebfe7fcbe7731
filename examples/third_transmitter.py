"""Near the leader's axis two transmitters cannot tell port from starboard; a third one can."""

import laisn_sim

flight = laisn_sim.fly("T7", {"duration_s": 400})
for variant, transmitters in (("laisn-2", 2), ("laisn-3-2", 3)):
    navigated = laisn_sim.navigate(flight, {"navigation.variant": variant})
    errors = laisn_sim.errors(navigated)
    print(
        f"{transmitters} transmitters: {errors['mirror_locked'].mean():.0%} of the time at the "
        f"mirror image, mean E_P {errors['e_p_m'].mean():.2f} m"
    )
    navigated.draw(f"{transmitters}_transmitters.png", "routes")
