"""The world: vehicles in water, what they sense, how it is logged and filmed.

Rooms, from the ground up: `geometry`, `scenario`, `water`, `vehicle`, `control`, `sensing`; then `log` and `film`. The
files beside them join these: `assembly` makes sea and vehicles of a scenario, `simulation` (rigid hulls) and
`point_fleet` make their `Trajectory`, `motion` chooses between the two, `closed_loop` controls followers by their
estimates, and `flight` holds all that became of a mission. Of `laisn` only its vocabulary is known here, never a
navigator.

Imports: laisn models
"""
