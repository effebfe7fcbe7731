"""What steers: guidance along a plan, thrust allocation, and the autopilot of five thrusters.

Takes where a vehicle should be and where it takes itself to be; gives thruster commands, ten times a second. Pure
functions over small arrays, compiled. It must not know what a sensor or a message is, nor call for the truth: whoever
calls decides whether a position is true or believed.

Imports: laisn sim.geometry sim.scenario sim.vehicle
"""
