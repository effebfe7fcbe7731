"""A mission with a stop button: it is stepped until the estimate is off by more than 3 m."""

import numpy as np

import laisn_sim

sim = laisn_sim.Simulation("T5", {"duration_s": 300})
error = 0.0
while error < 3.0 and not sim.done:
    sim.step()  # 0.1 s
    belief = sim.estimates["follower"]
    # the hull's origin and the hydrophone, whose place is estimated, are a few centimetres apart
    east, north, _ = sim.truth["follower"].position
    error = np.hypot(belief.east - east, belief.north - north)

flight = sim.flight()
print(f"stopped at {sim.time:.1f} s: the estimate is {error:.2f} m off")
print(f"messages until then: {flight.measurements[0].message_step.size}")
print(flight)
flight.draw("stopped.png")
