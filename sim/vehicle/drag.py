"""Viscous forces of the water on a hull, from the velocity relative to the water.

Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021 (damping, lift and cross-flow
drag of a slender hull); Beard and McLain, Small Unmanned Aircraft, 2012 (lift and drag over incidence).
"""

from typing import Any

import numpy as np

from laisn.compiled import compiled
from sim.geometry.attitude import Vector


@compiled
def _faded(fade: float, speed: float, fade_before: float, left_before: float) -> float:
    """Share of an axis's linear damping that is left: mostly all, or that of the axis before, which is known."""
    if fade == 0.0:
        return 1.0
    if fade == fade_before:
        return left_before
    return float(np.exp(-fade * speed))


@compiled
def damping(c: Any, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Linear damping, which may fade as exp(−fade U), and quadratic damping −d |ν| ν, axis by axis."""
    speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    lin, fade, quad = c.linear_damping, c.linear_damping_fade, c.quadratic_damping
    left_x = _faded(fade[0], speed, np.nan, 1.0)
    left_y = _faded(fade[1], speed, fade[0], left_x)
    left_z = _faded(fade[2], speed, fade[1], left_y)
    left_roll = _faded(fade[3], speed, fade[2], left_z)
    left_pitch = _faded(fade[4], speed, fade[3], left_roll)
    left_yaw = _faded(fade[5], speed, fade[4], left_pitch)
    force = (
        -(lin[0] * left_x + quad[0] * abs(v[0])) * v[0],
        -(lin[1] * left_y + quad[1] * abs(v[1])) * v[1],
        -(lin[2] * left_z + quad[2] * abs(v[2])) * v[2],
    )
    moment = (
        -(lin[3] * left_roll + quad[3] * abs(w[0])) * w[0],
        -(lin[4] * left_pitch + quad[4] * abs(w[1])) * w[1],
        -(lin[5] * left_yaw + quad[5] * abs(w[2])) * w[2],
    )
    return force, moment


@compiled
def coupled_damping(c: Any, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Damping off the diagonals, −(D + D_q |ν_j|) ν_j, which does not fade."""
    nu = (v[0], v[1], v[2], w[0], w[1], w[2])
    out = np.zeros(6)
    for i in range(6):
        for j in range(6):
            out[i] -= (c.linear_coupling[i, j] + c.quadratic_coupling[i, j] * abs(nu[j])) * nu[j]
    return (out[0], out[1], out[2]), (out[3], out[4], out[5])


@compiled
def hull_lift(c: Any, v: Vector) -> Vector:
    """Drag and lift of the hull at incidence α, as a force along its axis and one across it.

    Along the axis acts −½ρ S CD0 U² cos α |cos α|, across it −½ρ S (CD0 + a) U² sin α |cos α|. At small incidence this
    is the drag CD0 against the flow and the lift a α across it (slope a of a wing of the hull's plan: Beard and McLain
    2012; Fossen 2021). Towards 90° both fade and leave the hull to `cross_flow`. A round hull has no sharp edge to be
    sucked forward at, so its lift never pushes it along its axis. Both planes add to one incidence; `hull_lift_planes`
    may leave one of them out.
    """
    area, drag, slope = c.hull_lift[0], c.hull_lift[1], c.hull_lift[2]
    side, up = c.hull_lift_planes[0] * v[1], c.hull_lift_planes[1] * v[2]
    in_plane = v[0] * v[0] + side * side + up * up
    if in_plane == 0.0:
        return 0.0, 0.0, 0.0
    total = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    scale = -0.5 * c.density * area * abs(v[0]) * (total / in_plane)
    normal = scale * (drag + slope)
    return scale * drag * v[0], normal * side, normal * up


@compiled
def cross_flow(c: Any, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Drag of the hull's sections across the flow, strip by strip (Fossen 2021).

    With both coefficients C equal, a strip of side area A has −½ρ A C |U| U of its own cross-flow U; unequal ones
    scale each axis by the cube root of its C: C |U| U along either axis alone, and always against the motion.
    """
    root_y, root_z = c.cross_flow_root[0], c.cross_flow_root[1]
    fy = fz = my = mz = 0.0
    for i in range(c.n_strips):
        x = c.strip_x[i]
        side, up = root_y * (v[1] + x * w[2]), root_z * (v[2] - x * w[1])
        scale = -0.5 * c.density * c.strip_area[i] * np.sqrt(side * side + up * up)
        dy, dz = scale * root_y * side, scale * root_z * up
        fy += dy
        fz += dz
        my -= x * dz
        mz += x * dy
    return (0.0, fy, fz), (0.0, my, mz)


@compiled
def viscous(c: Any, v: Vector, w: Vector) -> tuple[tuple[Vector, Vector], ...]:
    """All viscous forces [N] and moments [N m] in the body, by the velocity relative to the water.

    Args:
        c: record of `sim.vehicle.coefficients.RECORD`.
        v: velocity relative to the water [m/s].
        w: rate of turn relative to the water [rad/s].
    """
    return damping(c, v, w), cross_flow(c, v, w), (hull_lift(c, v), (0.0, 0.0, 0.0))
