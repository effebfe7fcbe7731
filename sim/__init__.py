"""The world: vehicles in water, what they sense, how it is logged and filmed.

Rooms, from the ground up: `geometry`, `scenario`, `water`, `vehicle`, `control`, `sensing`; then `log` and `film`. The
files beside them join these: `assembly` makes sea and vehicles of a scenario, `simulation` makes the `Trajectory` of
rigid hulls, `motion` that of a scenario, `closed_loop` controls followers by their estimates, and `flight` holds all of
a mission. Of `laisn` only its vocabulary is known here, never a navigator.

Imports: laisn models
"""
