"""Fossen's published model of the REMUS 100, from its equations.

Switches replace its terms by those of this project.

Source: T. I. Fossen, Python Vehicle Simulator, `remus100.py` (MIT licence), and Handbook of Marine
Craft Hydrodynamics and Motion Control, 2nd ed. 2021, Section 8.4.2; coefficients from Allen, Vorus
and Prestero (2000). Frame: x forward, y starboard, z down; Euler angles. It shares no code with
`sim`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from laisn.arrays import Floats

# density of water [kg/m³], gravity [m/s²], and the hull's dimensions [m]
RHO, G = 1026.0, 9.81
LENGTH, DIAMETER = 1.6, 0.19
CG = 0.02  # of the centre of gravity below the origin [m]
# area of a fin [m²], lift slopes of rudder and stern plane [1/rad], angle of stall [rad]
FIN_AREA, RUDDER_LIFT, PLANE_LIFT, STALL = 0.00665, 0.5, 0.7, 0.44
# the hull as a spheroid: semi-axes [m], mass [kg], moments of inertia [kg m²]
A, B = LENGTH / 2, DIAMETER / 2
MASS = 4 / 3 * np.pi * RHO * A * B**2
IX, IY = 0.4 * MASS * B**2, 0.2 * MASS * (A**2 + B**2)
# reference area [m²], coefficient of drag without lift, aspect ratio and lift slope of the hull
AREA = 0.7 * LENGTH * DIAMETER
DRAG = 0.42 * np.pi * B**2 / AREA
ASPECT = DIAMETER**2 / AREA
LIFT = np.pi * ASPECT / (1 + np.sqrt(1 + (ASPECT / 2) ** 2))
HOERNER = 1.1977304
"""Cross-flow drag coefficient of Hoerner's curve, in Fossen's table at B/2T = 0.5."""
FITTED_RUDDER_LIFT, FITTED_PLANE_LIFT = 1.2, 0.81
"""Lift slopes [1/rad] with which fins in the local flow turn and pitch the hull as Fossen's do,
whose force depends on the deflection alone.
"""
# position, unit vector of a positive deflection, lift coefficient and fitted slope; positive rudder
# and plane push to port and up
FINS = (
    ((-A, 0.0, -0.12), (0.0, -1.0, 0.0), RUDDER_LIFT, FITTED_RUDDER_LIFT),
    ((-A, 0.0, 0.12), (0.0, -1.0, 0.0), RUDDER_LIFT, FITTED_RUDDER_LIFT),
    ((-A, -0.12, 0.0), (0.0, 0.0, -1.0), PLANE_LIFT, FITTED_PLANE_LIFT),
    ((-A, 0.12, 0.0), (0.0, 0.0, -1.0), PLANE_LIFT, FITTED_PLANE_LIFT),
)


@dataclass(frozen=True)
class Terms:
    """Which of the published terms are replaced by those of this project; False: as published."""

    hull_normal_force: bool = False
    """Hull: a normal force sin α cos α, no induced drag, in place of lift and drag linear and
    square in α.
    """
    axial_advance: bool = False
    """Propeller: advance from the speed along the axis in place of the whole speed."""
    fin_incidence: bool = False
    """Fins: force from the incidence of the local flow, in place of the deflection alone."""
    fitted_slope: bool = False
    """Such fins: with slopes fitted to the turning and pitching of Fossen's model, in place of its
    coefficients.
    """
    munk: bool = False
    """Keep the eight Coriolis terms of added mass that Fossen's model sets to zero."""
    steady_damping: bool = False
    """Linear damping in surge and sway that does not fade with the speed."""


OURS = Terms(hull_normal_force=True, axial_advance=True, fin_incidence=True, fitted_slope=True)


def _lamb() -> Floats:
    """Added mass of a spheroid by Lamb's factors, shape (6,), [kg] and [kg m²]."""
    e = np.sqrt(1 - (B / A) ** 2)
    log = np.log((1 + e) / (1 - e))
    alpha = 2 * (1 - e**2) / e**3 * (log / 2 - e)
    beta = 1 / e**2 - (1 - e**2) / (2 * e**3) * log
    k = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    sway = MASS * beta / (2 - beta)
    return np.array([MASS * alpha / (2 - alpha), sway, sway, 0.3 * IX, k * IY, k * IY])


ADDED = _lamb()


def _skew(a: Floats) -> Floats:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


CENTRE = np.array([0.0, 0.0, CG])
RIGID = np.block(
    [
        [MASS * np.eye(3), -MASS * _skew(CENTRE)],
        [MASS * _skew(CENTRE), np.diag([IX, IY, IY]) - MASS * _skew(CENTRE) @ _skew(CENTRE)],
    ]
)
INERTIA = RIGID + np.diag(ADDED)
_ROLL, _PITCH = np.sqrt(MASS * G * CG / INERTIA[3, 3]), np.sqrt(MASS * G * CG / INERTIA[4, 4])
LINEAR = np.diag(INERTIA) * [1 / 20, 1 / 20, 1 / 20, 0.6 * _ROLL, 1.6 * _PITCH, 1.0]


def _coriolis(matrix: Floats, nu: Floats) -> Floats:
    p = matrix @ nu
    return -np.block([[np.zeros((3, 3)), _skew(p[:3])], [_skew(p[:3]), _skew(p[3:])]])


def _propeller(rps: float, speed: float) -> tuple[float, float]:
    advance = 0.944 * speed / (0.14 * rps) if rps > 0 else 0.0
    thrust = 0.4566 + (0.1798 - 0.4566) * advance / 0.6632
    torque = 0.0700 + (0.0312 - 0.0700) * advance / 0.6632
    return RHO * 0.14**4 * abs(rps) * rps * thrust, RHO * 0.14**5 * abs(rps) * rps * torque


def _hull(nu: Floats, terms: Terms) -> Floats:
    u, _, w = nu[:3]
    alpha, square = np.arctan2(w, u), float(nu[:3] @ nu[:3])
    q = 0.5 * RHO * AREA * square
    if terms.hull_normal_force:
        along, across = (
            q * np.cos(alpha) ** 2 * DRAG,
            q * (DRAG + LIFT) * np.sin(alpha) * abs(np.cos(alpha)),
        )
        return np.array([-along * np.sign(u), 0, -across, 0, 0, 0])
    lift = LIFT * alpha
    drag = DRAG + lift**2 / (np.pi * 0.7 * ASPECT)
    return q * np.array(
        [
            -np.cos(alpha) * drag + np.sin(alpha) * lift,
            0.0,
            -np.sin(alpha) * drag - np.cos(alpha) * lift,
            0.0,
            0.0,
            0.0,
        ]
    )


def _cross_flow(nu: Floats) -> Floats:
    x = np.linspace(-A, A, 21)
    flow = nu[1] + x * nu[5]
    force = -0.5 * RHO * DIAMETER * HOERNER * np.abs(flow) * flow * (LENGTH / 20)
    return np.array([0, force.sum(), 0, 0, 0, x @ force])


def _fins(nu: Floats, rudder: float, plane: float, terms: Terms) -> Floats:
    if not terms.fin_incidence:
        u, v, w = nu[:3]
        side = 0.5 * RHO * (u * u + v * v) * 2 * FIN_AREA * RUDDER_LIFT
        up = 0.5 * RHO * (u * u + w * w) * 2 * FIN_AREA * PLANE_LIFT
        ahead = -side * rudder**2 - up * plane**2
        return np.array([ahead, -side * rudder, -up * plane, 0, -A * up * plane, A * side * rudder])
    total = np.zeros(6)
    deflections = rudder, rudder, plane, plane
    for (position, axis, published, fitted), deflection in zip(FINS, deflections, strict=True):
        slope = fitted if terms.fitted_slope else published
        local = nu[:3] + np.cross(nu[3:], position)
        across = float(local @ axis)
        incidence = np.clip(deflection - np.arctan2(across, local[0]), -STALL, STALL)
        square = local[0] ** 2 + across**2
        normal = 0.5 * RHO * FIN_AREA * slope * square * np.sin(incidence) * abs(np.cos(incidence))
        force = normal * (
            np.cos(deflection) * np.array(axis) - np.sin(deflection) * np.array([1.0, 0.0, 0.0])
        )
        total += np.concatenate([force, np.cross(position, force)])
    return total


def _rate(state: Floats, command: Floats, terms: Terms) -> Floats:
    angles, nu, (rudder, plane, rpm) = state[3:6], state[6:12], state[12:]
    roll, pitch, yaw = angles
    added = _coriolis(np.diag(ADDED), nu)
    if not terms.munk:
        for i, j in ((4, 0), (4, 2), (5, 0), (5, 1)):
            added[i, j] = added[j, i] = 0.0
    linear, speed = LINEAR.copy(), float(np.sqrt(nu[:3] @ nu[:3]))
    if not terms.steady_damping:
        linear[:2] *= np.exp(-3 * speed)
    thrust, torque = _propeller(rpm / 60, nu[0] if terms.axial_advance else speed)
    weight = MASS * G
    restoring = weight * CG * np.array([0, 0, 0, np.cos(pitch) * np.sin(roll), np.sin(pitch), 0])
    forces = np.array([0.9 * thrust, 0, 0, torque / 10, 0, 0])
    forces += _hull(nu, terms) + _cross_flow(nu) + _fins(nu, rudder, plane, terms)
    forces -= (_coriolis(RIGID, nu) + added) @ nu + linear * nu + restoring
    cr, sr, cp, sp, cy, sy = (
        np.cos(roll),
        np.sin(roll),
        np.cos(pitch),
        np.sin(pitch),
        np.cos(yaw),
        np.sin(yaw),
    )
    to_world = np.array(
        [
            [cy * cp, -sy * cr + cy * sp * sr, sy * sr + cy * cr * sp],
            [sy * cp, cy * cr + sr * sp * sy, -cy * sr + sp * sy * cr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    to_angle_rates = np.array(
        [[1, sr * sp / cp, cr * sp / cp], [0, cr, -sr], [0, sr / cp, cr / cp]]
    )
    lag = np.array([0.1, 0.1, 1.0])
    return np.concatenate(
        [
            to_world @ nu[:3],
            to_angle_rates @ nu[3:],
            np.linalg.solve(INERTIA, forces),
            (command - state[12:]) / lag,
        ]
    )


def fly(
    command: Callable[[float], tuple[float, float, float]],
    duration: float,
    terms: Terms,
    changes: tuple[float, ...] = (),
) -> tuple[Floats, Floats]:
    """Motion from rest, north and level.

    Args:
        command: rudder [rad], stern plane [rad], propeller [1/min] by time [s].
        duration: [s].
        terms: that are replaced.
        changes: times at which the command changes [s].

    Returns:
        Times each 0.1 s; north, east, down, roll, pitch, yaw, and velocities in the body, shape (n,
        12).
    """
    state, states, times = np.zeros(15), [np.zeros(15)], [np.zeros(1)]
    ends = [0.0, *changes, duration]
    for begin, end in pairwise(ends):
        grid = np.arange(round(begin * 10) + 1, round(end * 10) + 1) / 10
        held = np.array(command(0.5 * (begin + end)))
        actual = solve_ivp(
            lambda _, y, held=held: _rate(y, held, terms),
            (begin, end),
            state,
            t_eval=grid,
            rtol=1e-7,
            atol=1e-9,
        )
        state = actual.y[:, -1]
        states.append(actual.y.T)
        times.append(grid)
    return np.concatenate(times), np.vstack([states[0][None], *states[1:]])[:, :12]
