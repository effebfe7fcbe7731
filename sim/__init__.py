"""The world: vehicles in water, what they sense, how it is logged and filmed.

From the ground up: `attitude`, `scenario`, `water`, `vehicle`, `control`, `trajectory`, `sensing`;
`assembly` makes routes and vehicles of a scenario, `simulation` flies them and gives the
`Trajectory`, `closed_loop` controls followers by their estimates, `flight` holds all of a mission;
then `log` and `film`.

Imports: laisn models
"""
