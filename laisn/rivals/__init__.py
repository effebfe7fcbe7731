"""Rival methods of navigation, each one entry of the registry: what reviewers name beside LAISN.

All of them dead-reckon on log and compass between messages and differ in what they do with a
message: nothing, a Kalman update or particles (`filters`), or a factor graph (`factor_graph`).
One takes the log as a measurement of a speed that it estimates (`speed_modes`). All take the
current that the leader's way shows (`leader_track`), if they estimate one.

Imports: laisn.arrays laisn.compiled laisn.delays laisn.estimates laisn.errors laisn.geometry
laisn.messages laisn.navigator laisn.navigators laisn.settings
"""
