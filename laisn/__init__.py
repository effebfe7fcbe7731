"""LAISN: Low-cost Acoustic In-Swarm Navigation, after Praczyk & Hożyń, Electronics 2026, 15, 3709.

The navigation of one follower from what it receives and measures; no simulator is imported here,
and no truth.

Frames:

    world    x east, y north, z up [m]; depth = −z. The filter is planar (x, y).
    body     x forward, y port, z up [m]; the origin is the centre of buoyancy.
    heading  θ, compass: clockwise from north [rad]. Pitch is positive nose up, roll positive
             starboard down.
    bearing  B, of the follower seen from the leader, from its bow clockwise: 0 ahead, 180° astern.

Symbols:

    P1, P2, P3  rear, front and middle transmitter; arrays over transmitters keep this order
    L, H_T      baseline P1P2, and sideways offset of P3 (to port) from its middle [m]
    R_i, D_i    slant and horizontal range from transmitter i [m]
    N, sep      number of circle intersections (0, 1, 2), and their distance [m]
    σp          confidence parameter of a fix [m]; T, β its threshold [m] and scale [m²]
    Δt, Δt_D    filter step and message interval [s]; step k is at time k Δt, step 0 is the known
                start
    E_P, E_B    error of position [m], and of the bearing from the leader's true pose [rad]

State:

    x = [x, y, vx, vy], and covariance (4, 4) in the same order; `POSITION` is a slice of it.

SI units and radians throughout; other units are in names.
"""

POSITION = slice(0, 2)

REAR = 0
FRONT = 1
MIDDLE = 2
"""Index of a transmitter in arrays over transmitters."""
