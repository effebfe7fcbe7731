"""What a user may set: one mission as validated, frozen data, its routes, and the TOML file that
holds it.

Takes a file or keyword arguments; gives a `Scenario` (`settings`; tables also stand in `vehicles`,
`sensors`, `navigation` and `formation`), routes of the library (`routes`), and the plan by which a
point with limits follows a route, also for routes drawn at random (`point_motion`). All errors of a
file are reported at once (`file`). It imports neither MuJoCo nor water nor sensors.

Imports: laisn models sim.system
"""
