"""Forces of the water on rigid hulls, in Fossen's form, from the velocity relative to the water
(docs/physics.md).

Added mass and its Coriolis terms, damping, lift and cross-flow drag: Fossen, Handbook of Marine
Craft Hydrodynamics and Motion Control, 2nd ed. 2021, and Lamb, Hydrodynamics, 6th ed. 1932; lift
and drag over incidence: Beard and McLain, Small Unmanned Aircraft, 2012. Water that moves
differently from place to place: Taylor, Proc. R. Soc. A 120, 1928; Auton, Hunt and Prud'homme, J.
Fluid Mech. 197, 1988. The flow is taken as linear over the hull about the origin of the body frame,
which is the centre of buoyancy unless the MJCF has a `buoyancy_centre`.

`apply_water_forces` gives the wrench of each vehicle, and the share of its added mass, to the
solver of its motion (`sim.vehicle.solvers`).

Functions take `c`, the coefficients of a vehicle; `v` and `w`, velocity and rate of turn
relative to the water, in the body [m/s], [rad/s]; they give force [N] and moment about the origin
[N m].
"""

from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Records
from laisn.compiled import compiled, inlined, select
from laisn.simd import all_lanes, any_lane, like
from laisn.vector_math import MIN_EXPONENT, exp
from sim.attitude import (
    Matrix,
    Pose,
    Twist,
    Vector,
    cross,
    matvec,
    minus,
    plus,
    rotation,
    scaled,
    transposed,
)
from sim.vehicle.effector_kinds import HullFlow
from sim.vehicle.effectors import Fitted, effector_wrench
from sim.vehicle.mjcf import Coefficients
from sim.vehicle.solvers import Load, matrix_times
from sim.water.environment import Environment, SeaInstant, elevation_at, flow, sea_at
from sim.water.waves import Flow


@inlined
def linear_share(fade: float, speed: float) -> float:
    """Share of its linear damping that a hull has at a speed U [m/s], exp(−fade U); `fade` in
    [s/m].
    """
    return exp(max(-fade * speed, MIN_EXPONENT))


@inlined
def _damp(c: Coefficients, i: int, speed: float, rate: float, faded: float) -> tuple[float, float]:
    """Damping along or about axis i, and the factor exp(−fade U) of the linear one.

    `rate` is the velocity along the axis or the rate about it, `speed` U, `faded` the factor of the
    axis before.
    """
    fade = c.linear_damping_fade
    # the fade of an axis is mostly that of the axis before, or 0
    if i == 0 or any_lane(fade[i] != fade[i - 1]):
        faded = 1.0
        if any_lane(fade[i] != 0.0):
            faded = linear_share(fade[i], speed)
    return -(c.linear_damping[i] * faded + c.quadratic_damping[i] * abs(rate)) * rate, faded


@compiled
def damping(c: Coefficients, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Linear damping, which may fade as exp(−fade U), and quadratic damping −d |ν| ν, axis by
    axis.
    """
    speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    surge, faded = _damp(c, 0, speed, v[0], 1.0)
    sway, faded = _damp(c, 1, speed, v[1], faded)
    heave, faded = _damp(c, 2, speed, v[2], faded)
    roll, faded = _damp(c, 3, speed, w[0], faded)
    pitch, faded = _damp(c, 4, speed, w[1], faded)
    yaw, _ = _damp(c, 5, speed, w[2], faded)
    return (surge, sway, heave), (roll, pitch, yaw)


@compiled
def _coupled_term(c: Coefficients, i: int, j: int, rate: float) -> float:
    return float((c.linear_coupling[i, j] + c.quadratic_coupling[i, j] * abs(rate)) * rate)


@compiled
def _coupled(c: Coefficients, i: int, v: Vector, w: Vector) -> float:
    """f_i = −Σ_j (D_ij + D_q,ij |ν_j|) ν_j."""
    by_velocity = _coupled_term(c, i, 0, v[0]) + _coupled_term(c, i, 1, v[1])
    by_velocity += _coupled_term(c, i, 2, v[2])
    with_roll = by_velocity + _coupled_term(c, i, 3, w[0])
    return -(with_roll + _coupled_term(c, i, 4, w[1]) + _coupled_term(c, i, 5, w[2]))


@compiled
def coupled_damping(c: Coefficients, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Damping off the diagonals, −(D + D_q |ν_j|) ν_j, which does not fade."""
    force = _coupled(c, 0, v, w), _coupled(c, 1, v, w), _coupled(c, 2, v, w)
    return force, (_coupled(c, 3, v, w), _coupled(c, 4, v, w), _coupled(c, 5, v, w))


@compiled
def hull_lift(c: Coefficients, v: Vector) -> Vector:
    """Drag and lift of the hull at incidence α, as a force along its axis and one across it.

    Along the axis acts −½ρ S CD0 U² cos α |cos α|, across it −½ρ S (CD0 + a) U² sin α |cos α|.
    Towards 90° both fade and leave the hull to `cross_flow`. A round hull has no sharp edge to be
    sucked forward at, so its lift never pushes it along its axis. `hull_lift_planes` may leave one
    plane out.
    """
    area = c.hull_lift[0]
    drag = c.hull_lift[1]
    slope = c.hull_lift[2]
    side = c.hull_lift_planes[0] * v[1]
    up = c.hull_lift_planes[1] * v[2]
    in_plane = v[0] * v[0] + side * side + up * up
    total = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    # where nothing flows in these planes, nothing acts
    ratio = select(in_plane == 0.0, 0.0, total / select(in_plane == 0.0, 1.0, in_plane))
    scale = -0.5 * c.density * area * abs(v[0]) * ratio
    normal = scale * (drag + slope)
    return scale * drag * v[0], normal * side, normal * up


@compiled
def cross_flow(c: Coefficients, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """Drag of the hull's sections across the flow, strip by strip (Fossen 2021).

    With both coefficients C equal, a strip of side area A has −½ρ A C |U| U of its own cross-flow
    U; unequal ones scale each axis by the cube root of its C: C |U| U along either axis alone, and
    always against the motion.
    """
    root_y = c.cross_flow_root[0]
    root_z = c.cross_flow_root[1]
    # cross-flow of the strip at x, times the roots: side + x side_per_m, up - x up_per_m
    side = root_y * v[1]
    side_per_m = root_y * w[2]
    up = root_z * v[2]
    up_per_m = root_z * w[1]
    sum_side = sum_up = side_moment = up_moment = 0.0
    for i in range(c.n_strips):
        x = c.strip_x[i]
        strip_side = side + x * side_per_m
        strip_up = up - x * up_per_m
        speed = np.sqrt(strip_side * strip_side + strip_up * strip_up)
        area_speed = c.strip_area[i] * speed
        drag_side = area_speed * strip_side
        drag_up = area_speed * strip_up
        sum_side += drag_side
        sum_up += drag_up
        side_moment += x * drag_side
        up_moment += x * drag_up
    scale_y = -0.5 * c.density * root_y
    scale_z = -0.5 * c.density * root_z
    force = (0.0, scale_y * sum_side, scale_z * sum_up)
    return force, (0.0, -(scale_z * up_moment), scale_y * side_moment)


@compiled
def viscous(c: Coefficients, v: Vector, w: Vector) -> tuple[tuple[Vector, Vector], ...]:
    """All viscous forces and moments."""
    return damping(c, v, w), cross_flow(c, v, w), (hull_lift(c, v), (0.0, 0.0, 0.0))


DIVERGED = 1e3  # a speed [m/s] or rate [rad/s] that no vehicle has: the integration has failed


@compiled
def kirchhoff(
    munk_factor: float, v: Vector, spin: Vector, momentum: Vector, angular: Vector
) -> tuple[Vector, Vector]:
    """Coriolis and Munk force and moment of added mass (Fossen 2021; Lamb 1932), all in the body.

    `munk_factor` is the share of the terms with pitch and yaw rates and moments that is kept,
    `spin` the rate of the body frame [rad/s], `momentum` added mass times velocities relative to
    the water [kg m/s], `angular` its moment about the origin [kg m²/s].
    """
    # f = −ω × p and m = −ω × l − v × p with (p, l) = M_A (v, w)
    munk = cross(v, momentum)
    scaled_spin = (spin[0], munk_factor * spin[1], munk_factor * spin[2])
    force = scaled(-1.0, cross(scaled_spin, momentum))
    gyro = cross(spin, angular)
    return force, (
        -gyro[0] - munk[0],
        -gyro[1] - munk_factor * munk[1],
        -gyro[2] - munk_factor * munk[2],
    )


@compiled
def gradient_force(
    gradient: Matrix, axis: Vector, momentum: Vector, angular: Vector
) -> tuple[Vector, Vector]:
    """Force and moment on added mass in water that moves differently from place to place (Taylor
    1928).

    The energy of the disturbed water, ½ (v − u)·M_A (v − u), changes with the place of the hull,
    since u does: Lagrange's equations give −(∇u)ᵀ p, p = M_A (v − u). With the rate of u along the
    hull's path this makes M_A (Du/Dt + (u − v) × curl u) of a sphere's added mass (Auton, Hunt and
    Prud'homme 1988). Along a slender hull, strips at x have the relative velocity −x (∇u) e
    besides, with its own Munk moment, and an own momentum, subject to the force above.

    Args:
        gradient: of the water's velocity, rows u, columns x, [1/s]; all in one frame.
        axis: e, unit vector along the hull.
        momentum: p, of added mass relative to the water [kg m/s].
        angular: its moment about the origin [kg m²/s].
    """
    # f = −(∇u)ᵀ p and m = (∇u e) × s − e × (∇u)ᵀ s with s = l × e, the first moment of p
    to_momentum = transposed(gradient)
    first = cross(angular, axis)  # ∫ x dp along the hull
    turning = minus(cross(matvec(gradient, axis), first), cross(axis, matvec(to_momentum, first)))
    return scaled(-1.0, matvec(to_momentum, momentum)), turning


@inlined
def immersion(
    c: Coefficients, position: Vector, axis: Vector, sea: SeaInstant
) -> tuple[float, float]:
    """Share of a hull that is in the water, and Σ (dry share · x) of the strips, x being forward of
    their common middle [m].

    A strip's section leaves the water evenly from the moment the surface touches its top until it
    is a radius below its middle; strips count by their side area.
    """
    ends = max(abs(c.strip_x[0]), abs(c.strip_x[c.n_strips - 1]))
    top = position[2] + abs(axis[2]) * ends + c.hull_radius
    deep = all_lanes(top <= -sea.waves.highest)
    area = wet = first_moment = arm = 0.0
    for i in range(0 if deep else c.n_strips):
        p = plus(position, scaled(c.strip_x[i], axis))
        depth = elevation_at(sea, p[0], p[1]) - p[2]
        share = min(max(0.5 + 0.5 * depth / c.hull_radius, 0.0), 1.0)
        area += c.strip_area[i]
        wet += share * c.strip_area[i]
        first_moment += c.strip_area[i] * c.strip_x[i]
        arm += (1.0 - share) * c.strip_area[i] * c.strip_x[i]
    # the buoyancy of all strips acts at the hull's centre of buoyancy, and that of a strip as far
    # ahead of there as the strip is ahead of their common middle
    dry = area - wet
    return (1.0, 0.0) if deep else (wet / area, (arm - dry * (first_moment / area)) / area)


@inlined
def _size(v: Vector) -> float:
    return abs(v[0]) + abs(v[1]) + abs(v[2])


@inlined
def _varies(water: Flow) -> bool:
    """Whether water is not the same at all places and times about a hull."""
    gradient = water.gradient
    total = _size(water.rate) + _size(gradient[0]) + _size(gradient[1]) + _size(gradient[2])
    total += _size(water.axis_gradient_rate) + _size(water.axis_acceleration_gradient)
    return bool(any_lane(total != 0.0))


class WaterTurn(NamedTuple):
    """How water that varies along a hull acts as if it turned, in the body."""

    turning: Vector  # its rate of turn [rad/s]
    rate: Vector  # rate of change of the water's velocity along the hull's path [m/s²]
    turning_rate: Vector  # rate of change of `turning` in the body [rad/s²]


@inlined
def _no_turn(zero: float) -> WaterTurn:
    """That of water that does not vary."""
    none = (zero, zero, zero)
    return WaterTurn(none, none, none)


@compiled
def _turn_of(water: Flow, to_world: Matrix, axis: Vector, spin: Vector) -> WaterTurn:
    """That of other water; `axis` is the unit vector along the hull, in the world."""
    to_body = transposed(to_world)
    gradient = water.gradient
    axis_rate = cross(matvec(to_world, spin), axis)
    axis_gradient = matvec(gradient, axis)
    turning = matvec(to_body, cross(axis, axis_gradient))
    axis_gradient_rate = plus(water.axis_gradient_rate, matvec(gradient, axis_rate))
    turning_rate = plus(cross(axis_rate, axis_gradient), cross(axis, axis_gradient_rate))
    return WaterTurn(
        turning,
        matvec(to_body, water.rate),
        minus(matvec(to_body, turning_rate), cross(spin, turning)),
    )


@compiled
def wrench(
    c: Coefficients,
    pose: Pose,
    twist: Twist,
    sea: SeaInstant,
    fitted: Fitted,
    i: int,
) -> tuple[Vector, Vector, float]:
    """All that the water does to one vehicle, but for added mass times acceleration.

    Args:
        pose: position [m] and quaternion, seven numbers.
        twist: velocity of the origin in the world [m/s], angular velocity in the body [rad/s], six
            numbers.
        sea: current, waves and density at the time.
        fitted, i: effectors of all vehicles, and the number of this one.

    Returns:
        force in the world [N], moment about the origin in the body [N m], share of the hull that is
        immersed. All forces fade with that share, but those of effectors that do not.
    """
    to_world = rotation(pose[3:7])
    to_body = transposed(to_world)
    axis = (to_world[0][0], to_world[1][0], to_world[2][0])
    position = (pose[0], pose[1], pose[2])
    velocity = (twist[0], twist[1], twist[2])
    spin = (twist[3], twist[4], twist[5])

    water = flow(sea, position, velocity, axis)
    gradient = water.gradient
    # most seas are calm, with a current that is the same everywhere: there, much is left out
    varies = _varies(water)
    zero = like(0.0, pose[0])
    turn = _no_turn(zero)
    if varies:
        turn = _turn_of(water, to_world, axis, spin)
    # v = Rᵀ (ẋ − u), and w = ω − Rᵀ (e × ∇u e): water that changes along a slender hull acts as if
    # the hull turned the other way round
    v = matvec(to_body, minus(velocity, water.velocity))
    w = minus(spin, turn.turning)
    relative_rate = plus(turn.rate, cross(spin, v)), turn.turning_rate

    momentum, angular = matrix_times(c.added_mass, v, w)
    force, moment = kirchhoff(c.munk_factor, v, spin, momentum, angular)
    if varies:
        terms = gradient_force(
            gradient, axis, matvec(to_world, momentum), matvec(to_world, angular)
        )
        force = plus(force, matvec(to_body, terms[0]))
        moment = plus(moment, matvec(to_body, terms[1]))
    damped = damping(c, v, w)
    across = cross_flow(c, v, w)
    force = plus(plus(plus(force, damped[0]), across[0]), hull_lift(c, v))
    moment = plus(plus(moment, damped[1]), across[1])
    if c.coupled:
        terms = coupled_damping(c, v, w)
        force = plus(force, terms[0])
        moment = plus(moment, terms[1])
    up = (to_world[2][0], to_world[2][1], to_world[2][2])
    thrust, torque, effector_force, effector_moment = effector_wrench(
        fitted, i, HullFlow(c.density, c.gravity, v, w, up)
    )
    force = plus(force, effector_force)
    moment = plus(moment, effector_moment)

    # M_A d/dt (Rᵀ u, Rᵀ (e × ∇u e)): the solver applies added mass to the body's own acceleration;
    # what the water brings of it is added here
    terms = matrix_times(c.added_mass, relative_rate[0], relative_rate[1])
    force = plus(force, terms[0])
    moment = plus(moment, terms[1])
    # B ρ(z)/ρ_0: a hull that dives into denser water becomes lighter there
    buoyancy = c.buoyancy * sea.density_model.relative_density_at(-position[2], c.density)
    displaced = (zero, zero, zero)
    # Froude-Krylov, ρ V Du/Dt with Du/Dt = du/dt − ∇u (ẋ − u): the pressure that accelerates the
    # water particles acts on the hull in their place, along their own path, not along the hull's
    if varies:
        particle_acceleration = minus(water.rate, matvec(gradient, minus(velocity, water.velocity)))
        displaced = scaled(buoyancy / c.gravity, matvec(to_body, particle_acceleration))
        force = plus(force, displaced)
        # likewise its moment: the water along the hull is accelerated as if it turned with this
        # rate
        turning_acceleration = cross(axis, water.axis_acceleration_gradient)
        moment = plus(moment, scaled(c.displaced_inertia, matvec(to_body, turning_acceleration)))

    # f = R (s f + thrust) + s B z, and m less the moment of the buoyancy that dry strips lack
    share, dry_arm = immersion(c, position, axis, sea)
    lift = (0.0, 0.0, share * buoyancy)
    lost_buoyancy_moment = cross((dry_arm, 0.0, 0.0), matvec(to_body, (0.0, 0.0, -buoyancy)))
    if c.off_centre:
        centre = (c.buoyancy_centre[0], c.buoyancy_centre[1], c.buoyancy_centre[2])
        moment = plus(moment, cross(centre, displaced))
        lost_buoyancy_moment = plus(lost_buoyancy_moment, cross(centre, matvec(to_body, lift)))
    # what holds the hull up does not turn with it
    total = plus(matvec(to_world, plus(scaled(share, force), thrust)), lift)
    return total, plus(plus(scaled(share, moment), torque), lost_buoyancy_moment), share


@compiled
def first_row_exceeding(values: Floats, bound: float) -> int:
    """First row of a matrix with a value that is NaN or whose size is not below `bound`; -1 if
    there is none.
    """
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            if not all_lanes(abs(values[i, j]) < bound):
                return i
    return -1


@compiled
def apply_water_forces(
    coefficients: Records,
    pose: Floats,
    twist: Floats,
    time: float,
    environment: Environment,
    solver: Any,
    fitted: Fitted,
) -> int:
    """Give the loads of all vehicles to a solver; the index of the first that is lost (not finite,
    > DIVERGED), or -1.
    """
    sea = sea_at(environment, time)
    diverged = first_row_exceeding(twist, DIVERGED)
    # one way out, and numbers in place of rows: compiled code would count references to arrays for
    # each vehicle
    for i in range(0 if diverged >= 0 else pose.shape[0]):
        vehicle_pose = (
            pose[i, 0],
            pose[i, 1],
            pose[i, 2],
            pose[i, 3],
            pose[i, 4],
            pose[i, 5],
            pose[i, 6],
        )
        motion = (twist[i, 0], twist[i, 1], twist[i, 2], twist[i, 3], twist[i, 4], twist[i, 5])
        c = coefficients[i]
        force, moment, share = wrench(c, vehicle_pose, motion, sea, fitted, i)
        total = abs(force[0]) + abs(force[1]) + abs(force[2])
        total = total + abs(moment[0]) + abs(moment[1]) + abs(moment[2])
        if diverged < 0 and not all_lanes(total < np.inf):
            diverged = i
        solver.take_load(i, c, vehicle_pose, motion, Load(force, moment, share))
    return diverged
