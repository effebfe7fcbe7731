"""What a follower gets of the truth: ranges through the water, sensors, their errors, echoes and
losses.

`sensor` says what a sensor is, `sensors` has those of this project. From a `Trajectory`
`observation` makes `IdealMeasurements` (what one follower's sensors see without errors), and from
that the `Measurements` of a run; under way it calls the same sensors. Noise is counter-based
(`noise`): a draw is a function of seed, run, stream and step. No navigator and no estimate is used.

Imports: laisn sim.attitude sim.scenario sim.trajectory sim.water
"""
