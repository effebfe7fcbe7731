"""The state of the tightly coupled navigator, and the words for parts of its belief.

State, of n numbers; the last four only where `Assume` says that they are unknown:

    x, y    position of the hydrophone, east and north [m]
    b_v     bias of the speed log [m/s]
    b_θ     bias of the compass [rad]
    b_r     mean of the error that the ranges share in proportion [m at the largest range of the message]
    b_L     bias of the leader's compass [rad]
    c       current, east and north [m/s]
    d_i     constant error of the range to transmitter i beside that of the first one [m]

A belief is a mixture of Gaussians. With two transmitters both sides of the leader's axis are kept until the data
decide; each such side is a *hypothesis*. Where biases drift, each hypothesis has two *modes*, slow and quick. One
Gaussian, of one mode of one hypothesis, is a *component*.
"""

X, Y, LOG, COMPASS, SCALE = range(5)
"""Indices of the states that are always there; `Model` says where the others are."""
