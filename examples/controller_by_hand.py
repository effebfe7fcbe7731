"""A controller written where it is used, as in a notebook: a follower swims to a place and circles.

It sees what a follower may see: its readings and what its navigator believes. A hull that is
steered by fins or one thruster cannot stand still, so that it circles about its goal.
"""

import numpy as np

import laisn_sim

GOAL = np.array([30.0, 40.0])  # east, north [m]

sim = laisn_sim.Simulation(
    "T5", {"duration_s": 120, "navigation.variant": "tight", "followers.0.depth_m": 8}
)
while not sim.done:
    belief = sim.estimates["follower"]
    to_east, to_north = GOAL - (belief.east, belief.north)
    distance = np.hypot(to_east, to_north)
    # slower the nearer it is
    speed = np.clip(0.2 * distance, 0.3, 1.2)
    command = laisn_sim.Command(heading=np.arctan2(to_east, to_north), speed=speed, depth=8.0)
    sim.command("follower", command)
    sim.step(1.0)

place = sim.truth["follower"].position[:2]
print(f"after {sim.time:.0f} s the follower is {np.hypot(*(place - GOAL)):.1f} m from its goal")
flight = sim.flight()
errors = laisn_sim.errors(flight)
print(f"its estimate was off by {errors['e_p_m'].mean():.2f} m on average")
flight.draw("circles.png", "routes")
