"""Imported hulls beside an independent integration of Gazebo's equations.

The reference has the numbers of the three files by hand, in the axes of the hull. It integrates the
momentum of body and water with forces by the formulas of gz-sim's plugins, each fin as a link that
its joint turns; the Coriolis terms are those of Fossen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from laisn.arrays import Floats
from tests.sim.gazebo.imported import DATA, import_file

GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True)
class Foil:
    """A fin of LiftDrag, in the hull's axes."""

    position: tuple[float, float, float]  # of the link [m]
    centre_of_pressure: tuple[float, float, float] = (0.0, 0.0, 0.0)  # from the link [m]
    upward: tuple[float, float, float]
    hinge: tuple[float, float, float]  # axis of the joint
    area: float  # [m²]
    lift_slope: float  # of the coefficient [1/rad]
    stalled_lift_slope: float  # beyond the stall angle
    drag_slope: float  # of the coefficient [1/rad]
    stalled_drag_slope: float  # beyond the stall angle
    stall_angle: float  # [rad]

    def force(
        self, density: float, angle: float, velocity: Floats, angular_velocity: Floats
    ) -> tuple[Floats, Floats]:
        """Force and its moment about the hull's origin, at an angle of the joint."""
        rotation = Rotation.from_rotvec(angle * np.array(self.hinge)).as_matrix()
        forward = rotation @ np.array([1.0, 0.0, 0.0])
        upward = rotation @ np.array(self.upward)
        arm = np.array(self.position) + rotation @ np.array(self.centre_of_pressure)
        flow = velocity + np.cross(angular_velocity, arm)
        speed = np.linalg.norm(flow)
        if speed <= 0.01 or forward @ flow <= 0.0:
            return np.zeros(3), np.zeros(3)
        span = np.cross(forward, upward)
        squared_cosine_of_sweep = 1.0 - (span @ flow / speed) ** 2
        flow_across_span = flow - (flow @ span) * span
        flow_direction = flow_across_span / np.linalg.norm(flow_across_span)
        lift_direction = np.cross(span, flow_direction)
        alpha = np.arccos(np.clip(lift_direction @ upward, -1.0, 1.0))
        if lift_direction @ forward < 0.0:
            alpha = -alpha
        if abs(alpha) > self.stall_angle:
            excess = abs(alpha) - self.stall_angle
            lift = np.sign(alpha) * max(
                self.lift_slope * self.stall_angle + self.stalled_lift_slope * excess, 0.0
            )
            drag = self.drag_slope * self.stall_angle + self.stalled_drag_slope * excess
        else:
            lift = self.lift_slope * alpha
            drag = self.drag_slope * alpha
        pressure = (
            0.5
            * density
            * (flow_across_span @ flow_across_span)
            * self.area
            * squared_cosine_of_sweep
        )
        force = pressure * (lift * lift_direction - abs(drag) * flow_direction)
        return force, np.cross(arm, force)


@dataclass(frozen=True, kw_only=True)
class Reference:
    """A vehicle by hand: parts of (mass [kg], position [m], principal moments [kg m²]), matrices
    about the origin.
    """

    parts: Sequence[tuple[float, Sequence[float], float | Sequence[float]]]
    volume_centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density: float
    added: Floats
    has_coriolis: bool = True
    linear: Floats
    quadratic: Floats
    thrusters: Sequence[tuple[Sequence[float], Sequence[float]]]  # position [m], axis
    foils: Sequence[Foil] = field(default_factory=list)

    def rigid(self) -> Floats:
        """6×6 inertia of the links about the origin."""
        inertia = np.zeros((6, 6))
        for mass, position, moments in self.parts:
            x, y, z = position
            arm = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            inertia[:3, :3] += mass * np.eye(3)
            inertia[:3, 3:] -= mass * arm
            inertia[3:, :3] += mass * arm
            inertia[3:, 3:] += np.diag(np.broadcast_to(moments, 3)) - mass * arm @ arm
        return inertia

    def fly(self, commands: Sequence[float], start: Floats, seconds: float) -> Floats:
        """State (position, attitude as a matrix, velocity and angular velocity in the hull's axes)
        after so many seconds of commands: thrusts [N], then angles of fins [rad].
        """
        rigid = self.rigid()
        mass = rigid[0, 0]
        centre = (
            np.sum(
                [part_mass * np.array(position) for part_mass, position, _ in self.parts], axis=0
            )
            / mass
        )
        inverse_inertia = np.linalg.inv(rigid + self.added)
        momentum_of = rigid + self.added * self.has_coriolis

        def rate(_: float, state: Floats) -> Floats:
            to_world = state[3:12].reshape(3, 3)
            nu = state[12:]
            v, w = nu[:3], nu[3:]
            down = to_world.T @ np.array([0.0, 0.0, -mass * GRAVITY])
            wrench = -self.linear @ nu - self.quadratic @ (np.abs(nu) * nu)
            # mass and displaced water are equal
            wrench[3:] += np.cross(centre - np.array(self.volume_centre), down)
            for thrust, (position, axis) in zip(commands, self.thrusters, strict=False):
                wrench[:3] += thrust * np.array(axis)
                wrench[3:] += thrust * np.cross(position, axis)
            for angle, foil in zip(commands[len(self.thrusters) :], self.foils, strict=True):
                force, moment = foil.force(self.density, angle, v, w)
                wrench[:3] += force
                wrench[3:] += moment
            momentum = momentum_of @ nu
            wrench[:3] -= np.cross(w, momentum[:3])
            wrench[3:] -= np.cross(w, momentum[3:]) + np.cross(v, momentum[:3])
            spin = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
            return np.concatenate(
                [to_world @ v, (to_world @ spin).ravel(), inverse_inertia @ wrench]
            )

        solution = solve_ivp(rate, (0.0, seconds), start, rtol=1e-8, atol=1e-9)
        assert solution.success
        return np.asarray(solution.y[:, -1])


def diagonal(*values: float) -> Floats:
    return np.diag(np.array(values))


TORPEDO_ADDED = diagonal(4, 38, 38, 0.05, 6, 6)
TORPEDO_ADDED[1, 5] = TORPEDO_ADDED[5, 1] = 0.8
TORPEDO_ADDED[2, 4] = TORPEDO_ADDED[4, 2] = -0.8
TORPEDO_LINEAR = diagonal(1, 5, 5, 2, 8, 8)
TORPEDO_LINEAR[1, 5] = -1.0
TORPEDO_FIN = {
    "area": 0.02,
    "lift_slope": 4.0,
    "stalled_lift_slope": -1.0,
    "drag_slope": 0.2,
    "stalled_drag_slope": 0.1,
    "stall_angle": 0.3,
    "position": (-0.85, 0.0, 0.0),
    "centre_of_pressure": (-0.02, 0.0, 0.0),
}
TORPEDO = Reference(
    parts=[
        (39.2, (0.7 / 39.2, 0.0, -0.02), (0.3, 7.0, 7.0)),
        (0.6, (-0.85, 0.0, 0.0), 5e-4 * 2),
        (0.2, (-0.95, 0.0, 0.0), 5e-4),
    ],
    density=1000.0,
    added=TORPEDO_ADDED,
    linear=TORPEDO_LINEAR,
    quadratic=diagonal(4, 90, 90, 0.1, 60, 60),
    thrusters=[((-0.95, 0.0, 0.0), (1.0, 0.0, 0.0))],
    foils=[
        Foil(upward=(0.0, 1.0, 0.0), hinge=(0.0, 0.0, 1.0), **TORPEDO_FIN),  # type: ignore[arg-type]
        Foil(upward=(0.0, 0.0, 1.0), hinge=(0.0, 1.0, 0.0), **TORPEDO_FIN),  # type: ignore[arg-type]
    ],
)
COS_45 = np.sqrt(0.5)
HOVERING = Reference(
    parts=[
        (11.3, (0.0, 0.0, -0.012), (0.18, 0.22, 0.26)),
        *[(0.05, (x, y, 0.0), 1e-4) for x in (0.15, -0.15) for y in (0.11, -0.11)],
        *[(0.0, (0.0, y, 0.03), 1e-4) for y in (0.12, -0.12)],
    ],
    volume_centre=(0.0, 0.0, 0.05),
    density=1025.0,
    added=diagonal(5.5, 12.7, 14.6, 0.12, 0.12, 0.12),
    linear=diagonal(4, 6.2, 5.2, 1.5, 1.5, 0.4),
    quadratic=diagonal(18.2, 21.7, 37, 1.55, 1.55, 1.55),
    thrusters=[
        ((0.15, 0.11, 0.0), (COS_45, -COS_45, 0.0)),
        ((0.15, -0.11, 0.0), (COS_45, COS_45, 0.0)),
        ((-0.15, 0.11, 0.0), (COS_45, COS_45, 0.0)),
        ((-0.15, -0.11, 0.0), (COS_45, -COS_45, 0.0)),
        ((0.0, 0.12, 0.03), (0.0, 0.0, 1.0)),
        ((0.0, -0.12, 0.03), (0.0, 0.0, 1.0)),
    ],
)
# the nose is at −x of the file: x and y change their signs
TAIL_FIN = {
    "area": 0.025,
    "lift_slope": 4.1,
    "stalled_lift_slope": -1.1,
    "drag_slope": 0.2,
    "stalled_drag_slope": 0.03,
    "stall_angle": 0.17,
    "position": (-1.05, 0.0, 0.0),
}
LONG_RANGE = Reference(
    parts=[
        (120.0, (0.003625, 0.0, 0.0), (2.0, 36.0, 36.0)),
        (0.3, (-1.05, 0.0, 0.0), 16e-4),
        (0.1, (-1.2, 0.0, 0.0), 1e-4),
    ],
    volume_centre=(0.0, 0.0, 0.007),
    density=1000.0,
    added=diagonal(4.9, 126, 126, 0, 33, 33),
    has_coriolis=False,
    linear=diagonal(0, 0, 0, 2, 0, 0),
    quadratic=diagonal(6.2, 600, 600, 0.2, 630, 630),
    thrusters=[((-1.2, 0.0, 0.0), (1.0, 0.0, 0.0))],
    foils=[
        # the pose of the joint turns its axis down
        Foil(upward=(0.0, -1.0, 0.0), hinge=(0.0, 0.0, -1.0), **TAIL_FIN),  # type: ignore[arg-type]
        Foil(upward=(0.0, 0.0, 1.0), hinge=(0.0, -1.0, 0.0), **TAIL_FIN),  # type: ignore[arg-type]
    ],
)
STRAIGHT_AHEAD = (10.0, 0.0, 0.0)
# a vehicle, and commands that follow each other: thrusts [N], then angles of fins [rad]
SCHEDULES = {
    "torpedo": (
        TORPEDO,
        [STRAIGHT_AHEAD, (10.0, 0.1, 0.0), (10.0, -0.15, 0.03), (10.0, 0.0, -0.08)],
    ),
    "hovering": (
        HOVERING,
        [
            (3.5,) * 4 + (0.0, 0.0),
            (2.0, 4.0, 2.0, 4.0, 2.0, 2.0),
            (-3.0, 3.0, 3.0, -3.0, 0.0, 0.0),
            (0.0,) * 4 + (-3.0, -6.0),
        ],
    ),
    # Gazebo's flag leaves no Coriolis term, `munk_factor` 0 those of the roll rate: flat turns
    "long_range": (
        LONG_RANGE,
        [STRAIGHT_AHEAD, (10.0, 0.1, 0.0), (10.0, 0.25, 0.0), (10.0, 0.0, 0.05)],
    ),
}


@pytest.mark.system
@pytest.mark.parametrize("name", SCHEDULES)
def test_an_imported_hull_moves_as_in_gazebo(name: str) -> None:
    """Velocity, angular velocity, roll and pitch within 1 % at the end of each minute of constant
    thrust and fins.
    """
    reference, schedule = SCHEDULES[name]
    hull = import_file(DATA / f"{name}.sdf", reference.density)
    plant = hull.plant
    state = np.concatenate([np.zeros(3), np.eye(3).ravel(), np.zeros(6)])
    seconds = 60.0
    for commands in schedule:
        state = reference.fly(commands, state, seconds)
        plant.step(np.array([commands]), round(seconds / plant.dt))
        expected_attitude = state[3:12].reshape(3, 3)
        attitude = Rotation.from_quat(plant.pose[0, [4, 5, 6, 3]]).as_matrix()
        velocity = attitude.T @ plant.twist[0, :3]
        speed = float(np.linalg.norm(state[12:15]))
        step = f"after {commands}"
        np.testing.assert_allclose(np.linalg.norm(velocity), speed, rtol=0.01, err_msg=step)
        np.testing.assert_allclose(
            velocity, state[12:15], rtol=0.01, atol=1e-3 * speed, err_msg=step
        )
        np.testing.assert_allclose(
            plant.twist[0, 3:], state[15:], rtol=0.01, atol=2e-4, err_msg=step
        )
        # roll and pitch, by the vertical in the body
        np.testing.assert_allclose(
            attitude[2], expected_attitude[2], rtol=0.01, atol=5e-4, err_msg=step
        )
