"""Flights as films and stills, offscreen and without a GPU.

Takes a `Flight`; gives frames and an H.264 file (`render`). Frames are drawn by child processes (`studio`), so that a
graphics library that is missing or broken breaks nothing else: no module here loads one when it is imported. Pictures
show what was flown and change nothing.

Imports: laisn sim.assembly sim.files sim.flight sim.geometry sim.scenario sim.vehicle sim.water
"""
