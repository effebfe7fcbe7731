"""The water: current, waves and their gradients, density, and the speed of sound over depth.

Takes places and times; gives velocities, accelerations and travel times there. Nothing here depends on a vehicle or a
scenario: `sim.assembly` makes an `Ocean` from a user's settings.

Imports: laisn sim.geometry
"""
