"""The water: a current that shears with depth and changes in time, and linear (Airy) waves that
ride on it.

Velocity of the water at depth −z and time t: u = U(z) + V(t) + Σ waves, U(z) = (speed + shear z)
along one compass direction, V(t) linear between points in time. A wave's phase moves with the
surface current: at a fixed place it is k·(x − ∫V dt) − (ω + k·U(0)) t + φ (Phillips, The Dynamics
of the Upper Ocean, 2nd ed. 1977, section 2.6). Above the still surface the waves' velocity stays
what it is at z = 0.

Waves: Faltinsen, Sea Loads on Ships and Offshore Structures, 1990 (Airy); DNV-RP-C205, 2010,
Section 3.5.5 (JONSWAP).
"""

from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Two, own_arrays
from laisn.compiled import compiled, inlined
from laisn.errors import LaisnError
from laisn.vector_math import exp, sin_cos
from sim.attitude import Matrix, Vector

# gravity, which pulls on the surface here as it pulls on bodies in models/ocean.xml [m/s²]
GRAVITY = 9.81
FLOOR_DEPTH_M = 40.0  # depth of the floor of a sea unless it is given [m]


def wavenumber(omega: npt.ArrayLike, depth_m: float) -> Floats:
    """Solve ω² = g k tanh(k h) for k [1/m] by Newton's method; ω > 0 [rad/s], h [m]."""
    omega = np.asarray(omega, dtype=np.float64)
    k0h = omega**2 * depth_m / GRAVITY
    # start of Guo (2002), within 0.75 % everywhere, so that a few steps reach machine precision
    kh = k0h * (1.0 - np.exp(-(k0h**1.25))) ** -0.4
    for _ in range(6):
        tanh = np.tanh(kh)
        kh = kh - (kh * tanh - k0h) / (tanh + kh * (1.0 - tanh**2))
    return np.asarray(kh / depth_m)


@dataclass(frozen=True, kw_only=True)
class Waves:
    """Components η = Σ a cos(k·x − ω t + φ), ω being what someone drifting with the current
    sees.
    """

    amplitude_m: Floats  # amplitudes a, shape (n,)
    wavenumber_1_m: Floats  # wave numbers east and north, towards where the wave runs, shape (n, 2)
    omega_rad_s: Floats  # angular frequencies ω, shape (n,)
    phase_rad: Floats  # phases φ, shape (n,)

    def __post_init__(self) -> None:
        own_arrays(self)

    @classmethod
    def none(cls) -> Self:
        """A flat sea."""
        empty = np.zeros(0)
        return cls(
            amplitude_m=empty, wavenumber_1_m=np.zeros((0, 2)), omega_rad_s=empty, phase_rad=empty
        )

    @classmethod
    def _of(
        cls,
        amplitude: Floats,
        omega: Floats,
        direction: Floats,
        phase: Floats,
        floor_depth_m: float,
    ) -> Self:
        towards = np.stack([np.sin(direction), np.cos(direction)], axis=1)
        k = wavenumber(omega, floor_depth_m)[:, None] * towards
        return cls(amplitude_m=amplitude, wavenumber_1_m=k, omega_rad_s=omega, phase_rad=phase)

    @classmethod
    def regular(
        cls,
        *,
        height_m: float,
        period_s: float,
        direction_rad: float = 0.0,
        phase_rad: float = 0.0,
        floor_depth_m: float = FLOOR_DEPTH_M,
    ) -> Self:
        """One component; height crest to trough, running towards a compass direction; LaisnError
        if it would break.
        """
        omega = np.array([2 * np.pi / period_s])
        direction = np.array([direction_rad])
        _require_unbroken("height_m", height_m, omega[0], floor_depth_m)
        return cls._of(
            np.array([height_m / 2]), omega, direction, np.array([float(phase_rad)]), floor_depth_m
        )

    @classmethod
    def jonswap(
        cls,
        rng: np.random.Generator,
        *,
        significant_height_m: float,
        peak_period_s: float,
        direction_rad: float = 0.0,
        spread_rad: float = 0.0,
        floor_depth_m: float = FLOOR_DEPTH_M,
        peakedness: float = 3.3,
        n_components: int = 100,
    ) -> Self:
        """An irregular sea: JONSWAP spectrum, phases and places within the frequency bins drawn
        from `rng`.

        Each component has the energy of its bin, so that 4 √(Σ a²/2) is the significant height
        exactly. `spread_rad` is the standard deviation of directions. LaisnError if a regular wave
        of the peak's length and this height would break.
        """
        peak = 2 * np.pi / peak_period_s
        _require_unbroken("significant_height_m", significant_height_m, peak, floor_depth_m)
        edges, energy = _jonswap_bins(peakedness, n_components)
        omega = peak * rng.uniform(edges[:-1], edges[1:])
        amplitude = significant_height_m / 4 * np.sqrt(2 * energy)
        phase = rng.uniform(0.0, 2 * np.pi, n_components)
        direction = direction_rad + spread_rad * rng.standard_normal(n_components)
        return cls._of(amplitude, omega, direction, phase, floor_depth_m)


@cache
def _jonswap_bins(peakedness: float, n: int) -> tuple[Floats, Floats]:
    """Edges of n bins in multiples of the peak's frequency, (n + 1,), and shares of energy,
    (n,), at most 2/n each.
    """
    # 99 % of the energy of the spectrum lies between these frequencies
    grid = np.linspace(0.6, 3.0, 24_001)
    bell = np.exp(-((grid - 1) ** 2) / (2 * np.where(grid <= 1, 0.07, 0.09) ** 2))
    density = grid**-5.0 * np.exp(-1.25 * grid**-4.0) * peakedness**bell
    energy = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    energy /= energy[-1]
    share = (energy + np.linspace(0.0, 1.0, grid.size)) / 2
    edges = np.interp(np.linspace(0.0, 1.0, n + 1), share, grid)
    return edges, np.diff(np.interp(edges, grid, energy))


def _require_unbroken(name: str, height_m: float, omega: float, floor_depth_m: float) -> None:
    """Miche's limit of steepness, 0.142 tanh(k h) (Miche 1944)."""
    k = float(wavenumber(omega, floor_depth_m))
    highest = 0.142 * np.tanh(k * floor_depth_m) * 2 * np.pi / k
    if not 0 <= height_m <= highest:
        raise LaisnError(
            f"{name}={height_m} must lie between 0 and {highest:.3g} m, where waves of this length "
            "break"
        )


Current = tuple[Two, Two, Two]
"""The steady part at the surface [m/s], its change with z [1/s], east and north; depth of floor,
bound of waves [m].
"""
Water = tuple[Current, Floats, Floats]
"""An ocean as compiled functions take it (a plain tuple: numba takes four times as long to open a
named one).

waves: one column for each component, shape (11, n), rows as named below. change: points between
which the current changes linearly, shape (m, 7), columns as named below; m = 0: it is steady.
"""
Instant = tuple[float, Current, tuple[float, float, float, float, float, float]]
"""Time [s], the current, and its change at this time as of `change_at`: numbers, as references
to arrays cost time.
"""

AMPLITUDE, KX, KY, OMEGA, FIXED_OMEGA, PHASE = range(6)
"""Rows of the waves: amplitude [m]; wave number east and north [1/m]; ω and ω at a fixed place
[rad/s]; phase [rad].
"""
K, EAST, NORTH, ORBITAL, MIRROR = range(6, 11)
"""What follows from these and the depth h: k [1/m]; where the wave runs to, a unit vector; the
velocity scale a ω / (1 − exp(−2kh)) [m/s]; exp(−2kh), the share of the wave's mirror image in the
floor."""
START = 0
SET = slice(1, 3)
ACCELERATION = slice(3, 5)
RUN = slice(5, 7)
"""Columns of a changing current: time [s]; velocity then [m/s], its rate of change from then on
[m/s²] and the way of the water since the first point [m], each east and north."""
_LEAST_EXPONENT = -700.0  # keeps exp(kz) above zero


@dataclass(frozen=True, kw_only=True)
class Ocean:
    """Current, waves, density and depth of a sea."""

    current_speed_m_s: float = 0.0  # speed of the current at the surface
    current_direction_rad: float = 0.0  # compass direction that the current runs towards
    current_shear_1_s: float = 0.0  # loss of speed per metre of depth
    current_change: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    """Velocity V that is added at all depths: time [s], east and north [m/s], shape (m, 3), times
    increasing from 0; linear between the points, constant after the last."""
    density_kg_m3: float = 1026.0
    floor_depth_m: float = FLOOR_DEPTH_M
    waves: Waves = field(default_factory=Waves.none)  # made for the same depth

    def __post_init__(self) -> None:
        own_arrays(self)

    @cached_property
    def water(self) -> Water:
        """Current, waves and change of the current as compiled functions take them."""
        w = self.waves
        east = np.sin(self.current_direction_rad)
        north = np.cos(self.current_direction_rad)
        surface = self.current_speed_m_s * east, self.current_speed_m_s * north
        shear = self.current_shear_1_s * east, self.current_shear_1_s * north
        bounds = float(self.floor_depth_m), np.abs(w.amplitude_m).sum()
        fixed = w.omega_rad_s + w.wavenumber_1_m @ np.array(surface)
        k = np.hypot(w.wavenumber_1_m[:, 0], w.wavenumber_1_m[:, 1])
        twice_depth = -2.0 * k * self.floor_depth_m
        orbital = w.amplitude_m * w.omega_rad_s / -np.expm1(twice_depth)
        given = [w.amplitude_m, w.wavenumber_1_m, w.omega_rad_s, fixed, w.phase_rad]
        derived = [k, w.wavenumber_1_m / k[:, None], orbital, np.exp(twice_depth)]
        time = self.current_change[:, 0]
        velocity = self.current_change[:, 1:]
        change = np.zeros((time.size, 7))
        dt = np.diff(time)[:, None]
        change[:, START] = time
        change[:, SET] = velocity
        change[:-1, ACCELERATION] = np.diff(velocity, axis=0) / dt
        change[1:, RUN] = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt, axis=0)
        return (
            (surface, shear, bounds),
            np.ascontiguousarray(np.column_stack([*given, *derived]).T),
            change,
        )

    def velocity(self, position: Floats, time: float) -> Floats:
        """Velocity of the water in the world at points of shape (n, 3), [m]; the answer
        likewise, [m/s].
        """
        out = np.empty(position.shape)
        water_velocity(position, time, self.water, out)
        return out


@compiled
def change_at(time: float, change: Floats) -> tuple[float, float, float, float, float, float]:
    """Velocity [m/s] of the changing part of the current, its rate [m/s²], way since the first
    point [m], in pairs.
    """
    m = change.shape[0]
    if m == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    low, high = 0, m
    while high - low > 1:
        middle = (low + high) // 2
        if change[middle, 0] <= time:
            low = middle
        else:
            high = middle
    _, ux, uy, ax, ay, dx, dy = change[low]
    dt = time - change[low, 0]
    run = dx + (ux + 0.5 * ax * dt) * dt, dy + (uy + 0.5 * ay * dt) * dt
    return ux + ax * dt, uy + ay * dt, ax, ay, run[0], run[1]


@compiled
def instant_of(time: float, water: Water) -> tuple[Instant, Floats]:
    """An ocean at an instant, and its waves: the last arguments of `flow` and `elevation_at`."""
    return (time, water[0], change_at(time, water[2])), water[1]


@compiled
def elevation_at(x: float, y: float, now: Instant, waves: Floats) -> float:
    """Height of the surface above z = 0 at one place [m]."""
    time, _, change = now
    x = x - change[4]
    y = y - change[5]
    height = 0.0
    for i in range(waves.shape[1]):
        phase = waves[KX, i] * x + waves[KY, i] * y - waves[FIXED_OMEGA, i] * time + waves[PHASE, i]
        height += waves[AMPLITUDE, i] * sin_cos(phase)[1]
    return height


@compiled
def _orbits(waves: Floats, x: float, y: float, below: float, time: float) -> Floats:
    """Level velocity of each component times cosine and sine of its phase, upward velocity
    likewise, shape (4, n).
    """
    out = np.empty((4, waves.shape[1]))
    for i in range(waves.shape[1]):
        phase = waves[KX, i] * x + waves[KY, i] * y - waves[FIXED_OMEGA, i] * time + waves[PHASE, i]
        sin, cos = sin_cos(phase)
        # cosh(k(z+h))/sinh(kh) and sinh(k(z+h))/sinh(kh) without overflow in deep water
        decay = exp(max(waves[K, i] * below, _LEAST_EXPONENT))
        mirrored = waves[MIRROR, i] / decay
        level = waves[ORBITAL, i] * (decay + mirrored)
        upward = waves[ORBITAL, i] * (decay - mirrored)
        out[0, i] = level * cos
        out[1, i] = level * sin
        out[2, i] = upward * cos
        out[3, i] = upward * sin
    return out


@inlined
def flow(
    position: Vector, velocity: Vector, axis: Vector, now: Instant, waves: Floats
) -> tuple[Vector, Vector, Matrix, Vector, Vector]:
    """The water at a point that moves with `velocity`, all in the world; `axis` is the unit vector
    of a hull.

    Gives the velocity u of the water [m/s]; its rate of change along the point's path [m/s²]; its
    gradient, rows u, columns x [1/s]; the rate, along the path, of the gradient along `axis`
    [1/s²]; and the gradient along `axis` of the particles' (linear) acceleration [1/s²].
    """
    _, (surface, (sx, sy), _), (vx, vy, ax, ay, run_x, run_y) = now
    if waves.shape[1] > 0:
        # waves are carried along with the changing current
        place = position[0] - run_x, position[1] - run_y, position[2]
        relative = velocity[0] - vx, velocity[1] - vy, velocity[2]
        stream, rate, gradient, turning, squeeze = _flow_in_waves(place, relative, axis, now, waves)
    else:
        # most seas are calm, and need neither sums over waves nor room for them
        z = position[2]
        vz = velocity[2]
        none = (0.0, 0.0, 0.0)
        stream = (surface[0] + sx * z, surface[1] + sy * z, 0.0)
        rate = (sx * vz, sy * vz, 0.0)
        gradient = ((0.0, 0.0, sx), (0.0, 0.0, sy), none)
        turning = none
        squeeze = none
    stream = (stream[0] + vx, stream[1] + vy, stream[2])
    rate = (rate[0] + ax, rate[1] + ay, rate[2])
    return stream, rate, gradient, turning, squeeze


@compiled
def _flow_in_waves(
    position: Vector, velocity: Vector, axis: Vector, now: Instant, waves: Floats
) -> tuple[Vector, Vector, Matrix, Vector, Vector]:
    """What `flow` returns in waves and a steady current."""
    x, y, z = position
    vx, vy, vz = velocity
    ax, ay, az = axis
    time, (surface, (sx, sy), (depth, _)), _ = now
    ux, uy, uz = surface[0] + sx * z, surface[1] + sy * z, 0.0
    dx, dy, dz = sx * vz, sy * vz, 0.0
    gxx = gxy = gyy = gxz = gyz = gzz = 0.0
    bx = by = bz = 0.0
    cx = cy = cz = 0.0
    below = max(min(z, 0.0), -depth)
    # where waves do not change with height any more, neither does climbing count, nor what of an
    # axis points up
    varies = 1.0 if z == below else 0.0
    vz = varies * vz
    az = varies * az
    orbits = _orbits(waves, x, y, below, time)
    for i in range(waves.shape[1]):
        omega = waves[OMEGA, i]
        k = waves[K, i]
        ex = waves[EAST, i]
        ey = waves[NORTH, i]
        c_cos = orbits[0, i]
        c_sin = orbits[1, i]
        s_cos = orbits[2, i]
        s_sin = orbits[3, i]
        along = ax * ex + ay * ey
        rise = k * vz
        rate = waves[KX, i] * vx + waves[KY, i] * vy - waves[FIXED_OMEGA, i]

        ux += c_cos * ex
        uy += c_cos * ey
        uz += s_sin
        change = s_cos * rise - c_sin * rate
        dx += change * ex
        dy += change * ey
        dz += s_cos * rate + c_sin * rise

        # potential flow: within the sea the gradient is symmetric and has no trace
        gh = -k * c_sin
        gz = k * s_cos
        gxx += gh * ex * ex
        gxy += gh * ex * ey
        gyy += gh * ey * ey
        gxz += gz * ex
        gyz += gz * ey
        gzz -= gh

        # along the axis, the gradient is k (−c sin θ·along + s cos θ·az) horizontally and k (s cos
        # θ·along + c sin θ·az) vertically; −p and −q are their derivatives with θ, −k q and k p
        # those with z
        p = k * (c_cos * along + s_sin * az)
        q = k * (s_sin * along - c_cos * az)
        bh = -p * rate - q * rise
        bx += bh * ex
        by += bh * ey
        bz += p * rise - q * rate
        cx += omega * p * ex
        cy += omega * p * ey
        cz += omega * q
    gradient = (
        (gxx, gxy, varies * gxz + sx),
        (gxy, gyy, varies * gyz + sy),
        (gxz, gyz, varies * gzz),
    )
    return (ux, uy, uz), (dx, dy, dz), gradient, (bx, by, bz), (cx, cy, cz)


@compiled
def water_velocity(position: Floats, time: float, water: Water, out: Floats) -> None:
    """Write the velocity of the water at points of shape (n, 3) to `out`, likewise."""
    now, waves = instant_of(time, water)
    for i in range(position.shape[0]):
        place = position[i, 0], position[i, 1], position[i, 2]
        out[i, 0], out[i, 1], out[i, 2] = flow(place, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), now, waves)[
            0
        ]
