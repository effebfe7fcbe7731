"""Data sets of others as logs: odometry and ranges to beacons, of vehicles that really drove or
dived.

Takes factor graphs (`factor_graph`) and tables of ranges (`range_data`), gives `RangeData`, and
writes it as a log from which navigation can be replayed (`log`). Measurements of a vehicle come
from text tables (`vehicle_table`) and bags of ROS (`bag_table`), by a map (`field_map`) that is
proposed from names and types (`map_proposal`). It must not navigate or judge
anything.

Imports: laisn sim.attitude sim.log sim.system
"""
