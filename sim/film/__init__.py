"""Flights as films and stills, offscreen and without a GPU.

Takes a `Flight`; gives frames and an H.264 file (`render`). Frames are drawn by child processes, so
that a missing or broken graphics library breaks nothing else: no module here loads one when it is
imported.

Imports: laisn sim.attitude sim.flight sim.scenario sim.system sim.tracking sim.vehicle
sim.water
"""
