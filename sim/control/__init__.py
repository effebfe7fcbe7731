"""Control: guidance along a plan or to a station, control allocation, and the autopilot of any set
of effectors.

Takes the reference of a vehicle and its measured or true motion; gives thruster commands, ten times
a second. Pure functions of records, compiled. The caller decides whether a position is true or
estimated.

Imports: laisn sim.attitude sim.scenario sim.vehicle sim.water
"""
