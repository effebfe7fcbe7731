"""Data sets of others as logs: odometry and ranges to beacons, of vehicles that really drove or dived.

Takes factor graphs and the files of range data sets (`source`), gives `RangeData`, and writes it as a log from which
navigation can be replayed (`log`). It must not navigate or judge anything.

Imports: laisn sim.log
"""
