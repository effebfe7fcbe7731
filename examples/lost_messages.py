"""Messages that are lost alone, and as many in bursts: the follower dead-reckons meanwhile."""

import numpy as np

import laisn_sim

for name, changes in {
    "none lost": {},
    "alone": {"acoustics.loss_probability": 0.5},
    "in bursts": {"acoustics.burst_probability": 0.05, "acoustics.burst_mean_messages": 20},
}.items():
    flight = laisn_sim.fly("T4", {"duration_s": 300, **changes})
    # ranges: a row for each message, a column for each transmitter, NaN where it was not heard
    received = np.isfinite(flight.measurements[0].ranges).any(axis=1).mean()
    errors = laisn_sim.errors(flight)["e_p_m"]
    print(
        f"{name:10} {received:4.0%} received, mean E_P {errors.mean():.2f} m, largest "
        f"{errors.max():.2f} m"
    )
flight.draw("bursts.png")
