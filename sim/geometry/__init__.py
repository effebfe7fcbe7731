"""Space: rotations of hulls, algebra of 3-vectors in registers, and the map.

Takes numbers and gives numbers; compiled where forces need it. It depends on no vehicle, no water and no
time: everything that moves, floats or measures stands above it.

Imports: laisn.arrays laisn.compiled
"""
