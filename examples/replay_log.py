"""Write a log, read it back as a measured log would be read, and navigate on it with other
settings.
"""

import laisn_sim

path = laisn_sim.write_log(laisn_sim.fly("T4", {"duration_s": 120}), "flight.mcap")
flight = laisn_sim.read_log(path)
print(f"{path}: {flight}")
for changes in (
    {},
    {"navigation.beta_m2": 1.0},
    {"navigation.gate": "off"},
    {"navigation.variant": "tight"},
):
    navigated = laisn_sim.navigate(flight, changes)
    errors = laisn_sim.errors(navigated)
    print(f"{changes or 'as flown'!s:35} mean E_P {errors['e_p_m'].mean():.3f} m")
navigated.draw("tight.png")
