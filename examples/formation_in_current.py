"""Three followers keep formation in a current that none of them measures; the tight navigator
estimates it.
"""

import numpy as np

import laisn_sim

formation = laisn_sim.load(
    {
        "name": "formation",
        "duration_s": 150,
        # waypoints: [time_s, east_m, north_m]
        "leader": {"waypoints": [[0, 0, 0], [100, 100, 0], [150, 120, 45]]},
        # the current flows to the north
        "ocean": {"current_speed_m_s": 0.3, "current_direction_deg": 0.0},
        "navigation": {"variant": "tight", "assume": {"current": True}},
        "followers": [
            {"name": "port", "station": {"behind_m": 10.0, "port_m": 15.0, "depth_m": 10.0}},
            {"name": "starboard", "station": {"behind_m": 10.0, "port_m": -15.0, "depth_m": 11.0}},
            {"name": "astern", "station": {"behind_m": 25.0, "port_m": 3.0, "depth_m": 12.0}},
        ],
    }
)
flight = laisn_sim.fly(formation)
for name, row in laisn_sim.summary(flight)["followers"].items():
    print(
        f"{name:10} RMS distance from station {row['station_rms_m']:.2f} m, mean E_P "
        f"{row['e_p_mean_m']:.2f} m"
    )
truth = laisn_sim.truth(flight)
for name in flight.trajectory.names[1:]:
    is_own = truth["vehicle"] == name
    apart = np.hypot(
        truth["east_m"][is_own] - truth["east_m"][truth["vehicle"] == "leader"],
        truth["north_m"][is_own] - truth["north_m"][truth["vehicle"] == "leader"],
    )
    print(f"{name:10} {apart[-1]:.1f} m from the leader at the end")
flight.draw("formation.png", "routes")
