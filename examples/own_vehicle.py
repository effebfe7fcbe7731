"""A vehicle of your own: the follower's MJCF with 2 kg of payload, as much foam, and twice the
hull drag.
"""

from pathlib import Path

import laisn_sim

text = laisn_sim.hull("follower")
for old, new in (
    ('mass="31.0294"', 'mass="33.0294"'),
    ('data="304.398414"', 'data="324.018414"'),  # buoyancy [N]: the weight
    # hull_lift: area [m²], drag coefficient, lift slope [1/rad]
    ('data="0.2128 0.05596 0.266"', 'data="0.2128 0.11192 0.266"'),
):
    assert old in text, old
    text = text.replace(old, new)
Path("heavier.xml").write_text(text, encoding="utf-8")

own = laisn_sim.fly("T5", {"duration_s": 100, "followers.0.model": "heavier.xml"})
usual = laisn_sim.fly("T5", {"duration_s": 100})
for name, flight in (("own vehicle", own), ("follower", usual)):
    # the last 20 s of vehicle 1, the follower; effector 0 is the main thruster
    main = flight.trajectory.effector_states[-200:, 1, 0]
    print(
        f"{name:12} mean main thrust {main.mean():5.2f} N, mean E_P "
        f"{laisn_sim.summary(flight)['e_p_mean_m']:.2f} m"
    )
own.draw("own_vehicle.png", "motion")
