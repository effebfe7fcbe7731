"""Data sets of others as logs: odometry and ranges to beacons, of vehicles that really drove or
dived.

Takes factor graphs (`factor_graph`) and tables of ranges (`range_data`), gives `RangeData`, and
writes it as a log from which navigation can be replayed (`log`). It must not navigate or judge
anything.

Imports: laisn sim.log sim.system
"""
