"""Solvers of the rigid bodies of a plant: MuJoCo, or the equations of motion of each body alone.

A solver is a NamedTuple with four methods, which compiled code chooses by its type. In a step they
are called in this order:

    begin_solving         before the forces of the water are computed
    take_load             the water's load on each vehicle, at the velocities of the instant
    end_forces            still at these velocities
    move_bodies           at those of the middle of the last step: semi-implicit Euler

The bodies of a plant are free: each moves by its own six equations (Fossen, Handbook of Marine
Craft Hydrodynamics and Motion Control, 2nd ed. 2021, chapter 3), which `DirectSolver` solves in the
frame of the body. There the matrix of inertia, added mass included, is constant, and so is its
inverse, as long as the hull is whole in the water. MuJoCo assembles, factorises and solves that of
all bodies at every step. Both give the same motion but for rounding; MuJoCo is the reference.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, RecordFields, Records, row_dtype
from laisn.compiled import call_address, compiled, inlined, method_by_type, select
from laisn.errors import LaisnError
from laisn.simd import all_lanes
from laisn.vector_math import sin_cos_quarter
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
from sim.vehicle.mjcf import Coefficients, inertia_tensor, spec_of
from sim.vehicle.mujoco_calls import Calls

Engine = Literal["mujoco", "direct"]
"""Name of a solver, as scenarios have it."""

method_by_type("begin_solving")
method_by_type("take_load")
method_by_type("end_forces")
method_by_type("move_bodies")


class Load(NamedTuple):
    """What the water does to a vehicle, but for added mass times acceleration."""

    force: Vector  # in the world [N]
    moment: Vector  # about the origin, in the body [N m]
    share: float  # of the hull that is immersed, and of its added mass


@compiled
def _row_times(a: Floats, i: int, v: Vector, w: Vector) -> float:
    return float(
        a[i, 0] * v[0]
        + a[i, 1] * v[1]
        + a[i, 2] * v[2]
        + a[i, 3] * w[0]
        + a[i, 4] * w[1]
        + a[i, 5] * w[2]
    )


@compiled
def matrix_times(a: Floats, v: Vector, w: Vector) -> tuple[Vector, Vector]:
    """6×6 matrix times (v, w)."""
    force = _row_times(a, 0, v, w), _row_times(a, 1, v, w), _row_times(a, 2, v, w)
    return force, (_row_times(a, 3, v, w), _row_times(a, 4, v, w), _row_times(a, 5, v, w))


@compiled
def _add_to_inertia(mass: Floats, vehicle: int, added: Floats, share: float, r: Matrix) -> None:
    """Add rotated added mass to the lower triangle of a body's block of `M`: R A R', B R', C of
    [[A, B'], [B, C]].
    """
    m = added
    a = (m[0, 0], m[0, 1], m[0, 2]), (m[1, 0], m[1, 1], m[1, 2]), (m[2, 0], m[2, 1], m[2, 2])
    b = (m[3, 0], m[3, 1], m[3, 2]), (m[4, 0], m[4, 1], m[4, 2]), (m[5, 0], m[5, 1], m[5, 2])
    for j in range(3):
        carried = matvec(r, matvec(a, r[j]))
        coupled = matvec(b, r[j])
        for i in range(3):
            lower = (i + 3) * (i + 4) // 2  # start of row i + 3
            mass[vehicle, lower + j] += share * coupled[i]
            if i >= j:
                mass[vehicle, i * (i + 1) // 2 + j] += share * carried[i]
                mass[vehicle, lower + 3 + j] += share * added[i + 3, j + 3]


class MujocoSolver(NamedTuple):
    """MuJoCo, which gets the water's load in `qfrc_applied`, and added mass in `M` before that is
    factorised, so that it acts on accelerations that are yet to be solved for.
    """

    calls: Calls
    mass: Floats  # lower triangles of the vehicles' blocks of `M`, row by row, shape (v, 21)
    applied: Floats  # `qfrc_applied`, shape (v, 6)

    @compiled
    def begin_solving(self) -> None:
        """Compute places and inertia of the bodies."""
        kinematics, centres, inertia, _, _, _ = self.calls.stages
        call_address(kinematics, self.calls.model, self.calls.data)
        call_address(centres, self.calls.model, self.calls.data)
        call_address(inertia, self.calls.model, self.calls.data)

    @compiled
    def take_load(self, i: int, c: Coefficients, pose: Pose, twist: Twist, load: Load) -> None:
        """Write the load of vehicle i, and add its added mass."""
        for j in range(3):
            self.applied[i, j] = load.force[j]
            self.applied[i, 3 + j] = load.moment[j]
        _add_to_inertia(self.mass, i, c.added_mass, load.share, rotation(pose[3:7]))

    @compiled
    def end_forces(self) -> None:
        """Compute what depends on velocities, and factorise the inertia."""
        _, _, _, velocity, factor, _ = self.calls.stages
        call_address(velocity, self.calls.model, self.calls.data)
        call_address(factor, self.calls.model, self.calls.data)

    @compiled
    def move_bodies(self) -> None:
        """Solve for the accelerations and integrate."""
        call_address(self.calls.stages[5], self.calls.model, self.calls.data)


class Body(RecordFields):
    """Inertia of a rigid body, on the axes of the body frame."""

    mass: float  # [kg]
    gravity: float  # [m/s²]
    centre: Annotated[Floats, (3,)]  # of gravity [m]
    inertia: Annotated[Floats, (3, 3)]  # about the origin [kg m²]
    rigid: Annotated[Floats, (6, 6)]  # matrix of inertia about the origin, without added mass
    inverse: Annotated[Floats, (6, 6)]  # of the same with all of the added mass


BODY = row_dtype(Body)
_SMALL_ANGLE = 0.785  # below a quarter of π [rad]


class Room(NamedTuple):
    """Scratch memory of `_solve_partly_immersed`."""

    lower: Floats  # triangle L of Cholesky's factors, shape (6, 6)
    load: Floats  # force and moment, then the accelerations, shape (6,)


@compiled
def _solve_partly_immersed(body: Body, c: Coefficients, share: float, room: Room) -> None:
    """Replace force and moment in `room.load` by the accelerations that they give, with a share of
    the added mass: by the factors L Lᵀ of a positive definite matrix (Cholesky).
    """
    lower = room.lower
    load = room.load
    for i in range(6):
        for j in range(i + 1):
            rest = body.rigid[i, j] + share * c.added_mass[i, j]
            for k in range(j):
                rest = rest - lower[i, k] * lower[j, k]
            if i == j:
                lower[i, i] = np.sqrt(rest)
            else:
                lower[i, j] = rest / lower[j, j]
    for i in range(6):
        for k in range(i):
            load[i] -= lower[i, k] * load[k]
        load[i] /= lower[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            load[i] -= lower[k, i] * load[k]
        load[i] /= lower[i, i]


@inlined
def _selected(condition: bool, chosen: Vector, other: Vector) -> Vector:
    return (
        select(condition, chosen[0], other[0]),
        select(condition, chosen[1], other[1]),
        select(condition, chosen[2], other[2]),
    )


@compiled
def body_acceleration(
    body: Body, c: Coefficients, pose: Pose, spin: Vector, load: Load, room: Room
) -> tuple[Vector, Vector]:
    """Acceleration of the origin in the world [m/s²] and of the rate of turn in the body [rad/s²],
    by weight, load and inertia.
    """
    # M (a, α) = (f − m ω × (ω × r), n − ω × I ω) about the origin, which accelerates by a: the
    # velocity of the origin itself, kept in the world, brings no further terms
    to_world = rotation(pose[3:7])
    to_body = transposed(to_world)
    centre = (body.centre[0], body.centre[1], body.centre[2])
    weight = (0.0, 0.0, -body.mass * body.gravity)
    force = matvec(to_body, plus(load.force, weight))
    moment = plus(load.moment, cross(centre, matvec(to_body, weight)))
    force = minus(force, scaled(body.mass, cross(spin, cross(spin, centre))))
    m = body.inertia
    angular_momentum = (
        m[0, 0] * spin[0] + m[0, 1] * spin[1] + m[0, 2] * spin[2],
        m[1, 0] * spin[0] + m[1, 1] * spin[1] + m[1, 2] * spin[2],
        m[2, 0] * spin[0] + m[2, 1] * spin[1] + m[2, 2] * spin[2],
    )
    moment = minus(moment, cross(spin, angular_momentum))
    linear, angular = matrix_times(body.inverse, force, moment)
    whole = load.share == 1.0
    if not all_lanes(whole):
        a = room.load
        for j in range(3):
            a[j] = force[j]
            a[3 + j] = moment[j]
        _solve_partly_immersed(body, c, load.share, room)
        linear = _selected(whole, linear, (a[0], a[1], a[2]))
        angular = _selected(whole, angular, (a[3], a[4], a[5]))
    return matvec(to_world, linear), angular


@compiled
def _turn(pose: Floats, spin: Vector, dt: float) -> None:
    """Turn an attitude for a time by a rate in the body [rad/s]: q exp(½ ω dt), of length 1."""
    rate = np.sqrt(spin[0] * spin[0] + spin[1] * spin[1] + spin[2] * spin[2])
    half = 0.5 * rate * dt
    small = half <= _SMALL_ANGLE
    sine, cosine = sin_cos_quarter(half)
    if not all_lanes(small):
        sine = select(small, sine, np.sin(half))
        cosine = select(small, cosine, np.cos(half))
    # (a, b, d, e) is the attitude, (cosine, x, y, z) the turn
    scale = select(rate > 0.0, sine / select(rate > 0.0, rate, 1.0), 0.0)
    x = scale * spin[0]
    y = scale * spin[1]
    z = scale * spin[2]
    a = pose[3]
    b = pose[4]
    d = pose[5]
    e = pose[6]
    qw = a * cosine - b * x - d * y - e * z
    qx = a * x + b * cosine + d * z - e * y
    qy = a * y - b * z + d * cosine + e * x
    qz = a * z + b * y - d * x + e * cosine
    size = np.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    pose[3] = qw / size
    pose[4] = qx / size
    pose[5] = qy / size
    pose[6] = qz / size


class DirectSolver(NamedTuple):
    """Each body's equations alone, in its own frame."""

    bodies: Records  # of BODY, shape (v,)
    pose: Floats  # as of `Plant`, as is the next
    twist: Floats
    acceleration: Floats  # rates of `twist` [m/s²] and [rad/s²] in the last step, shape (v, 6)
    solved: Floats  # of this step, likewise
    room: Room
    dt: float  # step [s]

    @compiled
    def begin_solving(self) -> None:
        """Nothing comes before the forces."""

    @compiled
    def take_load(self, i: int, c: Coefficients, pose: Pose, twist: Twist, load: Load) -> None:
        """Solve for the accelerations of vehicle i."""
        spin = (twist[3], twist[4], twist[5])
        linear, angular = body_acceleration(self.bodies[i], c, pose, spin, load, self.room)
        for j in range(3):
            self.solved[i, j] = linear[j]
            self.solved[i, 3 + j] = angular[j]

    @compiled
    def end_forces(self) -> None:
        """All is solved for."""

    @compiled
    def move_bodies(self) -> None:
        """Integrate velocities, and with these places and attitudes."""
        for i in range(self.pose.shape[0]):
            for j in range(6):
                self.acceleration[i, j] = self.solved[i, j]
                self.twist[i, j] += self.dt * self.solved[i, j]
            for j in range(3):
                self.pose[i, j] += self.dt * self.twist[i, j]
            spin = (self.twist[i, 3], self.twist[i, 4], self.twist[i, 5])
            _turn(self.pose[i], spin, self.dt)


def _rigid_inertia(mass: float, centre: Floats, inertia: Floats) -> Floats:
    """Matrix of inertia about the origin by that about the centre of gravity, shape (6, 6)."""
    # [[m, −m r×], [m r×, I − m r× r×]]
    x, y, z = centre
    arm = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[mass * np.eye(3), -mass * arm], [mass * arm, inertia - mass * arm @ arm]])


def bodies_of(
    model: mujoco.MjModel, names: Sequence[str], coefficients: npt.NDArray[np.void]
) -> npt.NDArray[np.void]:
    """Records of BODY of the vehicles of a compiled model, shape (v,), read-only.

    LaisnError naming the vehicle if MuJoCo moves it by more than its mass and inertia
    (`direct_solver_error`).
    """
    bodies = np.zeros(len(names), BODY)
    for record, name, c in zip(bodies, names, coefficients, strict=True):
        body = model.body(f"{name}/hull")
        first_dof = int(model.body_dofadr[body.id])
        armature = model.dof_armature[first_dof : first_dof + 6]
        reason = _unsolved(float(model.body_gravcomp[body.id]), float(np.abs(armature).max()))
        if reason:
            raise LaisnError(f"{name}: timing.engine = 'direct': {reason}")
        mass = float(body.mass[0])
        rigid = _rigid_inertia(mass, body.ipos, inertia_tensor(model, body.id))
        record["mass"] = mass
        record["gravity"] = -model.opt.gravity[2]
        record["centre"] = body.ipos
        record["inertia"] = rigid[3:, 3:]
        record["rigid"] = rigid
        record["inverse"] = np.linalg.inv(rigid + c["added_mass"])
    bodies.flags.writeable = False
    return bodies


@lru_cache(maxsize=64)
def direct_solver_error(model: str) -> str:
    """Why a hull, of a name or the text of an MJCF, needs MuJoCo's solver; empty: it does not."""
    spec = spec_of(model)
    armature = max((abs(float(joint.armature)) for joint in spec.joints), default=0.0)
    return _unsolved(float(spec.body("hull").gravcomp), armature)


def _unsolved(gravity_compensation: float, armature: float) -> str:
    """What of a hull MuJoCo alone takes into account, as the reason of an error; empty: nothing."""
    if gravity_compensation != 0.0:
        return "its hull has gravcomp, which MuJoCo alone solves; use 'mujoco'"
    if armature != 0.0:
        return "its joint has armature, which MuJoCo alone solves; use 'mujoco'"
    return ""
