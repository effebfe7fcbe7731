"""Linear (Airy) waves, which ride on the current.

A wave's phase moves with the surface current U and with what is added to it in time, V: at a fixed
place it is k·(x − ∫V dt) − (ω + k·U(0)) t + φ (Phillips, The Dynamics of the Upper Ocean, 2nd ed.
1977, section 2.6). Above the still surface the waves' velocity stays what it is at z = 0.

Faltinsen, Sea Loads on Ships and Offshore Structures, 1990 (Airy); DNV-RP-C205, 2010, Section 3.5.5
(JONSWAP).
"""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Two, freeze_arrays
from laisn.compiled import compiled, method_by_type, select
from laisn.errors import LaisnError
from laisn.simd import like
from laisn.vector_math import MIN_EXPONENT, exp, sin_cos
from sim.attitude import Matrix, Vector
from sim.water.currents import CurrentFlow, Drift

method_by_type("flow_over")
method_by_type("velocity_over")
method_by_type("elevation_at")
method_by_type("room_for_orbits")

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
        freeze_arrays(self)

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


AMPLITUDE, KX, KY, OMEGA, FIXED_OMEGA, PHASE = range(6)
"""Rows of the components: amplitude [m]; wave number east and north [1/m]; ω and ω at a fixed
place [rad/s]; phase [rad].
"""
K, EAST, NORTH, ORBITAL, MIRROR = range(6, 11)
"""What follows from these and the depth h: k [1/m]; where the wave runs to, a unit vector; the
velocity scale a ω / (1 − exp(−2kh)) [m/s]; exp(−2kh), the share of the wave's mirror image in the
floor."""


class WaveTrain(NamedTuple):
    """Waves as compiled functions take them."""

    components: Floats  # a column for each, shape (11, n), rows as named above
    floor_depth: float  # that they feel [m]
    highest: float  # bound of the elevation [m]

    @classmethod
    def on(cls, waves: Waves, surface_current: Two, floor_depth_m: float) -> Self:
        """Waves on a current that has this steady velocity at the surface, east and north [m/s]."""
        amplitude = waves.amplitude_m
        omega = waves.omega_rad_s
        number = waves.wavenumber_1_m
        k = np.hypot(number[:, 0], number[:, 1])
        mirror_exponent = -2.0 * k * floor_depth_m
        rows = [
            amplitude,
            number,
            omega,
            omega + number @ np.array(surface_current),
            waves.phase_rad,
            k,
            number / k[:, None],
            amplitude * omega / -np.expm1(mirror_exponent),
            np.exp(mirror_exponent),
        ]
        components = np.ascontiguousarray(np.column_stack(rows).T)
        return cls(components, float(floor_depth_m), float(np.abs(amplitude).sum()))

    @compiled
    def flow_over(
        self, current: CurrentFlow, position: Vector, velocity: Vector, axis: Vector, time: float
    ) -> "Flow":
        """A current and these waves on it, as of `add_waves`."""
        if self.components.shape[1] > 0:
            return add_waves(self, current, position, velocity, axis, time)
        # most seas are calm, and need neither sums over waves nor room for them
        return flow_without_waves(current)

    @compiled
    def velocity_over(self, current: Vector, position: Vector, time: float) -> Vector:
        """The velocity of that flow alone."""
        if self.components.shape[1] > 0:
            return add_velocity_of_waves(self, current, position, time)
        return current

    @compiled
    def elevation_at(self, x: float, y: float, time: float, drift: Drift) -> float:
        """Height of the surface above z = 0 at one place [m], time [s]."""
        return wave_elevation(self, x, y, time, drift)

    @compiled
    def room_for_orbits(self) -> Floats:
        """Room for four numbers of each component, shape (4, n)."""
        return np.empty((4, self.components.shape[1]))


class LaneWaves(NamedTuple):
    """A `WaveTrain` of each of several missions side by side (`laisn.simd`), of which none is
    calm.
    """

    components: Floats
    floor_depth: float
    highest: float
    room: Floats  # for orbits, shape (4, n)

    @compiled
    def flow_over(
        self, current: CurrentFlow, position: Vector, velocity: Vector, axis: Vector, time: float
    ) -> "Flow":
        """As of `WaveTrain`."""
        return add_waves(self, current, position, velocity, axis, time)

    @compiled
    def velocity_over(self, current: Vector, position: Vector, time: float) -> Vector:
        """As of `WaveTrain`."""
        return add_velocity_of_waves(self, current, position, time)

    @compiled
    def elevation_at(self, x: float, y: float, time: float, drift: Drift) -> float:
        """As of `WaveTrain`."""
        return wave_elevation(self, x, y, time, drift)

    @compiled
    def room_for_orbits(self) -> Floats:
        """The same room for all."""
        return self.room


AnyWaves = WaveTrain | LaneWaves


class CalmSurface(NamedTuple):
    """No waves, and no code for any."""

    highest: float = 0.0  # bound of the elevation [m]

    @compiled
    def flow_over(
        self, current: CurrentFlow, position: Vector, velocity: Vector, axis: Vector, time: float
    ) -> "Flow":
        """A current alone."""
        return flow_without_waves(current)

    @compiled
    def velocity_over(self, current: Vector, position: Vector, time: float) -> Vector:
        """The velocity of that current."""
        return current

    @compiled
    def elevation_at(self, x: float, y: float, time: float, drift: Drift) -> float:
        """Height of the surface."""
        return 0.0


class Flow(NamedTuple):
    """The water about a point that moves, all in the world."""

    velocity: Vector  # u of the water [m/s]
    rate: Vector  # its rate of change along the point's path [m/s²]
    gradient: Matrix  # rows u, columns x [1/s]
    # along a hull's axis: the rate, along the path, of the gradient [1/s²], and the gradient of the
    # particles' (linear) acceleration [1/s²]
    axis_gradient_rate: Vector
    axis_acceleration_gradient: Vector


@compiled
def flow_without_waves(current: CurrentFlow) -> Flow:
    """A current alone."""
    zero = (0.0, 0.0, 0.0)
    return Flow(current.velocity, current.rate, current.gradient, zero, zero)


@compiled
def wave_elevation(waves: AnyWaves, x: float, y: float, time: float, drift: Drift) -> float:
    """Height of the surface above z = 0 at one place [m], time [s]."""
    rows = waves.components
    x = x - drift.displacement[0]
    y = y - drift.displacement[1]
    height = like(0.0, x)
    for i in range(rows.shape[1]):
        phase = rows[KX, i] * x + rows[KY, i] * y - rows[FIXED_OMEGA, i] * time + rows[PHASE, i]
        height += rows[AMPLITUDE, i] * sin_cos(phase)[1]
    return height


@compiled
def _orbits(waves: AnyWaves, x: float, y: float, z: float, time: float) -> Floats:
    """Horizontal velocity of each component, times cosine and times sine of its phase, and upward
    velocity, likewise, at a place [m] with z not above 0: shape (4, n), [m/s].
    """
    rows = waves.components
    out = waves.room_for_orbits()
    for i in range(rows.shape[1]):
        phase = rows[KX, i] * x + rows[KY, i] * y - rows[FIXED_OMEGA, i] * time + rows[PHASE, i]
        sin, cos = sin_cos(phase)
        # cosh(k(z+h))/sinh(kh) and sinh(k(z+h))/sinh(kh) without overflow in deep water
        decay = exp(max(rows[K, i] * z, MIN_EXPONENT))
        mirrored = rows[MIRROR, i] / decay
        horizontal = rows[ORBITAL, i] * (decay + mirrored)
        upward = rows[ORBITAL, i] * (decay - mirrored)
        out[0, i] = horizontal * cos
        out[1, i] = horizontal * sin
        out[2, i] = upward * cos
        out[3, i] = upward * sin
    return out


@compiled
def _height_in(waves: AnyWaves, z: float) -> float:
    """The height within the sea at which waves are what they are at z [m]."""
    return max(min(z, 0.0), -waves.floor_depth)


@compiled
def add_velocity_of_waves(
    waves: AnyWaves, current: Vector, position: Vector, time: float
) -> Vector:
    """Velocity of a current and the waves on it, as of `add_waves`."""
    rows = waves.components
    x, y, z = position
    ux, uy, uz = like(current[0], x), like(current[1], x), like(current[2], x)
    orbits = _orbits(waves, x, y, _height_in(waves, z), time)
    for i in range(rows.shape[1]):
        ux += orbits[0, i] * rows[EAST, i]
        uy += orbits[0, i] * rows[NORTH, i]
        uz += orbits[3, i]
    return ux, uy, uz


@compiled
def add_waves(
    waves: AnyWaves,
    current: CurrentFlow,
    position: Vector,
    velocity: Vector,
    axis: Vector,
    time: float,
) -> Flow:
    """A current and the waves on it, in the frame that they are carried in; arguments as of
    `sim.water.environment.flow`.
    """
    rows = waves.components
    x, y, z = position
    vx, vy, vz = velocity
    ax, ay, az = axis
    zero = like(0.0, x)
    # sums, each the fields of `Flow`: u velocity, d its rate, g gradient, b axis_gradient_rate, c
    # axis_acceleration_gradient
    ux, uy, uz = (
        like(current.velocity[0], x),
        like(current.velocity[1], x),
        like(current.velocity[2], x),
    )
    dx, dy, dz = like(current.rate[0], x), like(current.rate[1], x), like(current.rate[2], x)
    gxx = gxy = gyy = gxz = gyz = gzz = zero
    bx = by = bz = zero
    cx = cy = cz = zero
    height = _height_in(waves, z)
    # where waves do not change with height any more, neither does climbing count, nor what of an
    # axis points up
    varies = select(z == height, 1.0, 0.0)
    vz = varies * vz
    az = varies * az
    orbits = _orbits(waves, x, y, height, time)
    for i in range(rows.shape[1]):
        omega = rows[OMEGA, i]
        k = rows[K, i]
        ex = rows[EAST, i]
        ey = rows[NORTH, i]
        # horizontal velocity H and upward velocity W, times cosine and sine of the phase θ
        horizontal_cos = orbits[0, i]
        horizontal_sin = orbits[1, i]
        upward_cos = orbits[2, i]
        upward_sin = orbits[3, i]
        axis_along = ax * ex + ay * ey
        rise = k * vz
        # of θ along the point's path [rad/s]
        rate = rows[KX, i] * vx + rows[KY, i] * vy - rows[FIXED_OMEGA, i]

        ux += horizontal_cos * ex
        uy += horizontal_cos * ey
        uz += upward_sin
        change = upward_cos * rise - horizontal_sin * rate
        dx += change * ex
        dy += change * ey
        dz += upward_cos * rate + horizontal_sin * rise

        # potential flow: within the sea the gradient is symmetric and has no trace
        gh = -k * horizontal_sin
        gz = k * upward_cos
        gxx += gh * ex * ex
        gxy += gh * ex * ey
        gyy += gh * ey * ey
        gxz += gz * ex
        gyz += gz * ey
        gzz -= gh

        # along the axis, the gradient is k (−H sin θ·along + W cos θ·az) horizontally and k (W cos
        # θ·along + H sin θ·az) vertically; −p and −q are their derivatives with θ, −k q and k p
        # those with z
        p = k * (horizontal_cos * axis_along + upward_sin * az)
        q = k * (upward_sin * axis_along - horizontal_cos * az)
        bh = -p * rate - q * rise
        bx += bh * ex
        by += bh * ey
        bz += p * rise - q * rate
        cx += omega * p * ex
        cy += omega * p * ey
        cz += omega * q
    # j: gradient of the current
    (jxx, jxy, jxz), (jyx, jyy, jyz), (jzx, jzy, jzz) = current.gradient
    gradient = (
        (gxx + jxx, gxy + jxy, varies * gxz + jxz),
        (gxy + jyx, gyy + jyy, varies * gyz + jyz),
        (gxz + jzx, gyz + jzy, varies * gzz + jzz),
    )
    return Flow((ux, uy, uz), (dx, dy, dz), gradient, (bx, by, bz), (cx, cy, cz))
