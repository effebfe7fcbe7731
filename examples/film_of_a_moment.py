"""Fly a diving leader, find the instant of its largest pitch, and render a picture of it
offscreen.
"""

import numpy as np

import laisn_sim

flight = laisn_sim.fly("diving", {"duration_s": 120})
# a row for each instant of 0.1 s, a column for each vehicle, the leader first
pitch = np.degrees(flight.trajectory.pitch[:, 0])
moment = float(flight.trajectory.time[np.argmax(np.abs(pitch))])
print(f"largest pitch of the leader: {pitch[np.argmax(np.abs(pitch))]:.1f}° at {moment:.1f} s")
try:
    print("picture in", laisn_sim.render(flight, "moment.png", time_s=moment, camera="leader"))
except laisn_sim.LaisnError as error:
    # a machine without graphics libraries; `laisn doctor` names what is missing
    print(f"no picture: {error}")
