"""A tightly coupled navigator: it uses the ranges themselves, estimates the sensors' biases, and is
consistent.

Takes `Measurements`, as a whole or step by step (`navigator`), gives `TightEstimates`. Between is
compiled code (`estimator`), the same whether one follower navigates online or a campaign runs.

Imports: laisn.arrays laisn.compiled laisn.delays laisn.vector_math laisn.estimates laisn.errors
laisn.geometry laisn.held laisn.messages laisn.mixture laisn.navigators laisn.settings laisn.swarm
"""
