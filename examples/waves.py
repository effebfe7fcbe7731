"""A leader near the surface in an irregular sea: how far it pitches, and how much that adds to
its follower's position error.
"""

import numpy as np

import laisn_sim

sea = {"ocean.waves.kind": "jonswap", "ocean.waves.height_m": 0.8, "leader.depth_m": 3}
for name, changes in (("calm", {}), ("waves", sea)):
    flight = laisn_sim.fly("T4", {"duration_s": 100, "followers.0.depth_m": 12, **changes})
    pitch = np.degrees(flight.trajectory.pitch[:, 0])
    errors = laisn_sim.errors(flight)
    print(
        f"{name:6} pitch of the leader: σ {pitch.std():.2f}°, mean E_P "
        f"{errors['e_p_m'].mean():.2f} m"
    )
flight.draw("waves.png", "motion")
