"""What a user may set: one mission as validated, frozen data, its routes, and the TOML file that holds it.

Takes a file or keyword arguments; gives a `Scenario` (`settings`; its tables stand in `vehicles`, `sea`, `sensors`,
`navigation` and `formation`), routes of the library or drawn at random (`routes`, `random_routes`), and the
plan by which a point with limits swims a route (`point_motion`). All errors of a file are reported at once (`file`). It
imports neither MuJoCo nor water nor sensors.

Imports: laisn models sim.system
"""
