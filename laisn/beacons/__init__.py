"""A tightly coupled navigator among beacons at surveyed places: odometry and ranges, one at a time, as they come.

The sibling of `laisn.tight` for what a leader on whose hull the transmitters sit does not have: beacons hundreds of
metres apart, each with its own errors, odometry whose gyro drifts, ranges of unknown scale, and unknown
starts. Takes `Measurements` whose receptions place their transmitters; gives `Estimates` with consistent
covariances.

Imports: laisn.arrays laisn.compiled laisn.estimates laisn.failure laisn.messages
laisn.mixture laisn.navigators
"""
