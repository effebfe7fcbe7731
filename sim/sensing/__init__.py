"""What a follower gets of the truth: ranges through the water, sensors, their errors, echoes and
losses.

Takes a `Trajectory`; gives `MissionTruth` (what one follower's sensors see without errors), and
from that the `Measurements` of a run (`observation`). `instant` calls the same `sensors` under way.
Noise is counter-based (`noise`): a draw is a function of seed, run, stream and step. No navigator
and no estimate is used.

Imports: laisn sim.attitude sim.scenario sim.trajectory sim.water
"""
