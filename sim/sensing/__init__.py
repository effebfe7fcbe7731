"""What a follower gets of the truth: ranges through the water, sensors, their errors, echoes and
losses.

`sensor` says what a sensor is, `sensors` has those of this project. At an instant `own_sensors`
reads those of a follower, and `reception` takes up a message with its ranges. By both `observation`
makes of a `Trajectory` `IdealMeasurements` (what one follower's sensors see without errors), and
from that the `Measurements` of a run. Noise is counter-based (`noise`): a draw is a function of
seed, run, stream and step. No navigator and no estimate is used.

Imports: laisn sim.attitude sim.scenario sim.trajectory sim.water
"""
