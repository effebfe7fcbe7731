"""Figures for a paper: vector graphics as wide as a column, and a picture in 3D without panels on a
white background.
"""

import laisn_sim

flight = laisn_sim.fly("T6", {"duration_s": 200})
# widths in inches
for name in ("routes", "errors"):
    print("figure in", flight.draw(f"{name}.pdf", name, width=3.5))
flight.draw("routes.png", "routes", width=3.5)
try:
    # seen from 5 m west, 6 m south of the leader and 3 m above it
    settings = {"view": "leader:-5,-6,3", "plain": True, "background": "white"}
    print("picture in", laisn_sim.render(flight, "leader.png", time_s=100.0, **settings))
except laisn_sim.LaisnError as error:
    # a machine without graphics libraries; `laisn doctor` names what is missing
    print(f"no picture: {error}")
