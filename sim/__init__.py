"""The world: vehicles in water, what they sense, how it is logged and filmed.

From the ground up: `attitude`, `scenario`, `water`, `vehicle`, `control`, `trajectory`, `sensing`;
`assembly` makes sea and vehicles of a scenario, `simulation` the `Trajectory`, `closed_loop`
controls followers by their estimates, `flight` holds all of a mission; then `log` and `film`. Of
`laisn` only shared types are imported.

Imports: laisn models
"""
