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

    place: tuple[float, float, float]  # of the link
    cp: tuple[float, float, float] = (0.0, 0.0, 0.0)
    upward: tuple[float, float, float]
    hinge: tuple[float, float, float]  # axis of the joint
    area: float
    slope: float
    slope_beyond: float
    drag: float
    drag_beyond: float
    stall: float

    def force(self, density: float, angle: float, v: Floats, w: Floats) -> tuple[Floats, Floats]:
        """Force and its moment about the hull's origin, at an angle of the joint."""
        rotation = Rotation.from_rotvec(angle * np.array(self.hinge)).as_matrix()
        forward = rotation @ np.array([1.0, 0.0, 0.0])
        upward = rotation @ np.array(self.upward)
        place = np.array(self.place) + rotation @ np.array(self.cp)
        flow = v + np.cross(w, place)
        speed = np.linalg.norm(flow)
        if speed <= 0.01 or forward @ flow <= 0.0:
            return np.zeros(3), np.zeros(3)
        span = np.cross(forward, upward)
        sweep = 1.0 - (span @ flow / speed) ** 2
        plane = flow - (flow @ span) * span
        along = plane / np.linalg.norm(plane)
        lift_direction = np.cross(span, along)
        alpha = np.arccos(np.clip(lift_direction @ upward, -1.0, 1.0))
        if lift_direction @ forward < 0.0:
            alpha = -alpha
        if abs(alpha) > self.stall:
            beyond = abs(alpha) - self.stall
            lift = np.sign(alpha) * max(self.slope * self.stall + self.slope_beyond * beyond, 0.0)
            drag = self.drag * self.stall + self.drag_beyond * beyond
        else:
            lift = self.slope * alpha
            drag = self.drag * alpha
        pressure = 0.5 * density * (plane @ plane) * self.area * sweep
        force = pressure * (lift * lift_direction - abs(drag) * along)
        return force, np.cross(place, force)


@dataclass(frozen=True, kw_only=True)
class Reference:
    """A vehicle by hand: parts of (mass, place, principal moments), matrices about the origin."""

    parts: Sequence[tuple[float, Sequence[float], float | Sequence[float]]]
    volume_centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density: float
    added: Floats
    has_coriolis: bool = True
    linear: Floats
    quadratic: Floats
    thrusters: Sequence[tuple[Sequence[float], Sequence[float]]]  # place, axis
    foils: Sequence[Foil] = field(default_factory=list)

    def rigid(self) -> Floats:
        """6×6 inertia of the links about the origin."""
        inertia = np.zeros((6, 6))
        for mass, place, moments in self.parts:
            x, y, z = place
            arm = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            inertia[:3, :3] += mass * np.eye(3)
            inertia[:3, 3:] -= mass * arm
            inertia[3:, :3] += mass * arm
            inertia[3:, 3:] += np.diag(np.broadcast_to(moments, 3)) - mass * arm @ arm
        return inertia

    def fly(self, commands: Sequence[float], start: Floats, seconds: float) -> Floats:
        """State (place, attitude as a matrix, velocities) after so many seconds of thrusts [N],
        then angles [rad].
        """
        rigid = self.rigid()
        mass = rigid[0, 0]
        centre = np.sum([m * np.array(place) for m, place, _ in self.parts], axis=0) / mass
        whole = np.linalg.inv(rigid + self.added)
        momentum_of = rigid + self.added * self.has_coriolis

        def rate(_: float, state: Floats) -> Floats:
            to_world = state[3:12].reshape(3, 3)
            nu = state[12:]
            v, w = nu[:3], nu[3:]
            down = to_world.T @ np.array([0.0, 0.0, -mass * GRAVITY])
            load = -self.linear @ nu - self.quadratic @ (np.abs(nu) * nu)
            # mass and displaced water are equal
            load[3:] += np.cross(centre - np.array(self.volume_centre), down)
            for thrust, (place, axis) in zip(commands, self.thrusters, strict=False):
                load[:3] += thrust * np.array(axis)
                load[3:] += thrust * np.cross(place, axis)
            for angle, foil in zip(commands[len(self.thrusters) :], self.foils, strict=True):
                force, moment = foil.force(self.density, angle, v, w)
                load[:3] += force
                load[3:] += moment
            momentum = momentum_of @ nu
            load[:3] -= np.cross(w, momentum[:3])
            load[3:] -= np.cross(w, momentum[3:]) + np.cross(v, momentum[:3])
            spin = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
            return np.concatenate([to_world @ v, (to_world @ spin).ravel(), whole @ load])

        actual = solve_ivp(rate, (0.0, seconds), start, rtol=1e-8, atol=1e-9)
        assert actual.success
        return np.asarray(actual.y[:, -1])


def diagonal(*values: float) -> Floats:
    return np.diag(np.array(values))


TORPEDO_ADDED = diagonal(4, 38, 38, 0.05, 6, 6)
TORPEDO_ADDED[1, 5] = TORPEDO_ADDED[5, 1] = 0.8
TORPEDO_ADDED[2, 4] = TORPEDO_ADDED[4, 2] = -0.8
TORPEDO_LINEAR = diagonal(1, 5, 5, 2, 8, 8)
TORPEDO_LINEAR[1, 5] = -1.0
FIN = {
    "area": 0.02,
    "slope": 4.0,
    "slope_beyond": -1.0,
    "drag": 0.2,
    "drag_beyond": 0.1,
    "stall": 0.3,
    "place": (-0.85, 0.0, 0.0),
    "cp": (-0.02, 0.0, 0.0),
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
        Foil(upward=(0.0, 1.0, 0.0), hinge=(0.0, 0.0, 1.0), **FIN),  # type: ignore[arg-type]
        Foil(upward=(0.0, 0.0, 1.0), hinge=(0.0, 1.0, 0.0), **FIN),  # type: ignore[arg-type]
    ],
)
C = np.sqrt(0.5)
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
        ((0.15, 0.11, 0.0), (C, -C, 0.0)),
        ((0.15, -0.11, 0.0), (C, C, 0.0)),
        ((-0.15, 0.11, 0.0), (C, C, 0.0)),
        ((-0.15, -0.11, 0.0), (C, -C, 0.0)),
        ((0.0, 0.12, 0.03), (0.0, 0.0, 1.0)),
        ((0.0, -0.12, 0.03), (0.0, 0.0, 1.0)),
    ],
)
# the nose is at −x of the file: x and y change their signs
TAIL = {
    "area": 0.025,
    "slope": 4.1,
    "slope_beyond": -1.1,
    "drag": 0.2,
    "drag_beyond": 0.03,
    "stall": 0.17,
    "place": (-1.05, 0.0, 0.0),
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
        Foil(upward=(0.0, -1.0, 0.0), hinge=(0.0, 0.0, -1.0), **TAIL),  # type: ignore[arg-type]
        Foil(upward=(0.0, 0.0, 1.0), hinge=(0.0, -1.0, 0.0), **TAIL),  # type: ignore[arg-type]
    ],
)
AHEAD = (10.0, 0.0, 0.0)
SCHEDULES = {
    "torpedo": (TORPEDO, [AHEAD, (10.0, 0.1, 0.0), (10.0, -0.15, 0.03), (10.0, 0.0, -0.08)]),
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
    "long_range": (LONG_RANGE, [AHEAD, (10.0, 0.1, 0.0), (10.0, 0.25, 0.0), (10.0, 0.0, 0.05)]),
}


@pytest.mark.system
@pytest.mark.parametrize("name", SCHEDULES)
def test_an_imported_hull_moves_as_in_gazebo(name: str) -> None:
    """Speed, turn rate and attitude within 1 % after each step of thrust and fins."""
    reference, schedule = SCHEDULES[name]
    hull = import_file(DATA / f"{name}.sdf", reference.density)
    plant = hull.plant
    state = np.concatenate([np.zeros(3), np.eye(3).ravel(), np.zeros(6)])
    seconds = 60.0
    for commands in schedule:
        state = reference.fly(commands, state, seconds)
        plant.step(np.array([commands]), round(seconds / plant.dt))
        expected = state[3:12].reshape(3, 3)
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
        np.testing.assert_allclose(attitude[2], expected[2], rtol=0.01, atol=5e-4, err_msg=step)
