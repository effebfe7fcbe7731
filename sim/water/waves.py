"""Linear (Airy) waves, which ride on the current.

A wave's phase moves with the surface current U and with what is added to it in time, V: at a fixed
place it is k·(x − ∫V dt) − (ω + k·U(0)) t + φ (Phillips, The Dynamics of the Upper Ocean, 2nd ed.
1977, section 2.6). Above the still surface the waves' velocity stays what it is at z = 0.

Faltinsen, Sea Loads on Ships and Offshore Structures, 1990 (Airy); DNV-RP-C205, 2010, Section 3.5.5
(JONSWAP).
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Four, Two, freeze_arrays
from laisn.compiled import compiled, compiled_apart, inlined, method_by_type, select
from laisn.errors import LaisnError
from laisn.simd import like
from laisn.vector_math import MIN_EXPONENT, fma, powers_of_two, sin_cos_of_right_angles
from sim.attitude import Matrix, Vector, matvec, plus
from sim.water.currents import CurrentFlow, Drift

Five = tuple[float, float, float, float, float]

method_by_type("flow_over")
method_by_type("velocity_over")
method_by_type("elevation_at")
method_by_type("room_for_orbits")
method_by_type("one_way_orbits")
method_by_type("orbit")

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
        _require_unbroken(height_m, omega[0], floor_depth_m)
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
        _require_unbroken(significant_height_m, peak, floor_depth_m)
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


def _require_unbroken(height_m: float, omega: float, floor_depth_m: float) -> None:
    """Miche's limit of steepness, 0.142 tanh(k h) (Miche 1944)."""
    k = float(wavenumber(omega, floor_depth_m))
    highest = 0.142 * np.tanh(k * floor_depth_m) * 2 * np.pi / k
    if not 0 <= height_m <= highest:
        # rounded down, so that the height that is named is one that may be given
        raise LaisnError(
            f"expected 0 to {math.floor(1e3 * highest) / 1e3:g} m, above which waves of a period "
            f"of {2 * np.pi / omega:.4g} s break on a floor {floor_depth_m:g} m deep "
            f"(given: {height_m:g})"
        )


AMPLITUDE, KX, KY, K, OMEGA, PHASE, ORBITAL, MIRRORED, EAST, NORTH = range(10)
"""Rows of the components: amplitude [m]; wave number east, north and as a whole [1/m]; ω [rad/s];
phase [right angles].

What follows from these and the depth h: the velocity scale a ω / (1 − exp(−2kh)) [m/s]; that of the
wave's mirror image in the floor, exp(−2kh) times as large; where the wave runs to, a unit vector.
"""
CARRIER_EAST, CARRIER_NORTH = range(10, 12)
"""Rows of what all have in common: the current that carries them, that at the surface [m/s]."""
_RIGHT_ANGLES = 2.0 / math.pi  # in a radian
_OCTAVES = 1.0 / math.log(2.0)  # in a factor e
_SAME_DIRECTION = 1e-15  # sine of an angle between directions that rounding may leave


class WaveTrain(NamedTuple):
    """Waves as compiled functions take them."""

    components: Floats  # a column for each, shape (12, n), rows as named above
    floor_depth: float  # that they feel [m]
    highest: float  # bound of the elevation [m]
    one_way: bool  # whether all run the same way: a long-crested sea

    @classmethod
    def on(cls, waves: Waves, surface_current: Two, floor_depth_m: float) -> Self:
        """Waves on a current that has this steady velocity at the surface, east and north [m/s]."""
        amplitude = waves.amplitude_m
        omega = waves.omega_rad_s
        number = waves.wavenumber_1_m
        k = np.hypot(number[:, 0], number[:, 1])
        direction = number / k[:, None]
        mirror_exponent = -2.0 * k * floor_depth_m
        orbital = amplitude * omega / -np.expm1(mirror_exponent)
        rows = [
            amplitude,
            number,
            k,
            omega,
            _RIGHT_ANGLES * waves.phase_rad,
            orbital,
            orbital * np.exp(mirror_exponent),
            direction,
            np.tile(np.array(surface_current), (k.size, 1)),
        ]
        first = direction[:1].T
        along = direction @ first
        across = direction @ (first[::-1] * [[1.0], [-1.0]])
        return cls(
            components=np.ascontiguousarray(np.column_stack(rows).T),
            floor_depth=float(floor_depth_m),
            highest=float(np.abs(amplitude).sum()),
            one_way=bool(np.all((np.abs(across) <= _SAME_DIRECTION) & (along > 0.0))),
        )

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
        return wave_elevation(self, x, y, time, drift) if self.components.shape[1] > 0 else 0.0

    @compiled
    def room_for_orbits(self) -> Floats:
        """Room for four numbers of each component, shape (4, n)."""
        return np.empty((4, self.components.shape[1]))

    @compiled
    def one_way_orbits(self, place: "Place") -> "StoredOrbits":
        """Orbits of waves that all run one way."""
        # a loop without sums is vectorised
        return StoredOrbits(_orbits_along(self.components, place))


class LaneWaves(NamedTuple):
    """A `WaveTrain` of each of several missions side by side (`laisn.simd`), of which none is
    calm.
    """

    components: Floats
    floor_depth: float
    highest: float
    one_way: bool
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

    @compiled
    def one_way_orbits(self, place: "Place") -> "OrbitsInTurn":
        """As of `WaveTrain`."""
        # lanes are vectors already, and the sums leave registers to compute orbits in between
        return OrbitsInTurn(self.components, place)


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


class Place(NamedTuple):
    """Where and when there are waves, carried along with them, scaled so that wave numbers and
    frequencies give right angles of phase, and powers of 2 for the decay with depth.
    """

    x: float
    y: float
    along: float  # the way that all waves run, if there is one
    z: float
    time: float


@compiled
def _place_of(waves: AnyWaves, x: float, y: float, z: float, time: float) -> Place:
    """The place of coordinates, as of `add_waves`, and z not above 0 [m], at a time [s]."""
    rows = waves.components
    x = _RIGHT_ANGLES * (x - rows[CARRIER_EAST, 0] * time)
    y = _RIGHT_ANGLES * (y - rows[CARRIER_NORTH, 0] * time)
    along = rows[EAST, 0] * x + rows[NORTH, 0] * y
    return Place(x, y, along, _OCTAVES * z, _RIGHT_ANGLES * time)


# numbers, not arrays, are handed over in loops: to count references would keep these from being
# vectorised


@inlined
def _phase(kx: float, ky: float, omega: float, start: float, place: Place) -> float:
    """Phase of a component [right angles]; arguments are of its rows."""
    return fma(kx, place.x, fma(ky, place.y, fma(-omega, place.time, start)))


@inlined
def _phase_along(k: float, omega: float, start: float, place: Place) -> float:
    """The same where all waves run one way."""
    return fma(k, place.along, fma(-omega, place.time, start))


@inlined
def _orbit(phase: float, k: float, orbital: float, mirrored: float, place: Place) -> Four:
    """Horizontal velocity of a component, times cosine and times sine of its phase, and upward
    velocity, likewise [m/s].
    """
    sin, cos = sin_cos_of_right_angles(phase)
    # cosh(k(z+h))/sinh(kh) and sinh(k(z+h))/sinh(kh) without overflow in deep water
    decay, growth = powers_of_two(max(k * place.z, _OCTAVES * MIN_EXPONENT))
    wave = orbital * decay
    image = mirrored * growth
    horizontal = wave + image
    upward = wave - image
    return horizontal * cos, horizontal * sin, upward * cos, upward * sin


@compiled
def _orbits(waves: AnyWaves, place: Place) -> Floats:
    """These of all components, shape (4, n)."""
    rows = waves.components
    out = waves.room_for_orbits()
    for i in range(rows.shape[1]):
        phase = _phase(rows[KX, i], rows[KY, i], rows[OMEGA, i], rows[PHASE, i], place)
        orbit = _orbit(phase, rows[K, i], rows[ORBITAL, i], rows[MIRRORED, i], place)
        out[0, i], out[1, i], out[2, i], out[3, i] = orbit
    return out


@compiled
def _orbits_along(rows: Floats, place: Place) -> Floats:
    """The same where all waves run one way."""
    out = np.empty((4, rows.shape[1]))
    for i in range(rows.shape[1]):
        phase = _phase_along(rows[K, i], rows[OMEGA, i], rows[PHASE, i], place)
        orbit = _orbit(phase, rows[K, i], rows[ORBITAL, i], rows[MIRRORED, i], place)
        out[0, i], out[1, i], out[2, i], out[3, i] = orbit
    return out


class StoredOrbits(NamedTuple):
    """Orbits that were computed together."""

    table: Floats  # shape (4, n)

    @compiled
    def orbit(self, i: int) -> Four:
        """That of a component, as of `_orbit`."""
        table = self.table
        return table[0, i], table[1, i], table[2, i], table[3, i]


class OrbitsInTurn(NamedTuple):
    """Orbits, of waves that all run one way, that are computed one after another."""

    components: Floats
    place: Place

    @compiled
    def orbit(self, i: int) -> Four:
        """That of a component, as of `_orbit`."""
        rows = self.components
        phase = _phase_along(rows[K, i], rows[OMEGA, i], rows[PHASE, i], self.place)
        return _orbit(phase, rows[K, i], rows[ORBITAL, i], rows[MIRRORED, i], self.place)


@compiled
def wave_elevation(waves: AnyWaves, x: float, y: float, time: float, drift: Drift) -> float:
    """Height of the surface above z = 0 at one place [m], time [s]."""
    rows = waves.components
    x = x - drift.displacement[0]
    y = y - drift.displacement[1]
    place = _place_of(waves, x, y, 0.0, time)
    height = like(0.0, x)
    for i in range(rows.shape[1]):
        phase = _phase(rows[KX, i], rows[KY, i], rows[OMEGA, i], rows[PHASE, i], place)
        height = fma(rows[AMPLITUDE, i], sin_cos_of_right_angles(phase)[1], height)
    return height


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
    place = _place_of(waves, x, y, _height_in(waves, z), time)
    ux = uy = uz = like(0.0, x)
    if waves.one_way:
        orbits = waves.one_way_orbits(place)
        along = ux
        for i in range(rows.shape[1]):
            hc, _, _, ws = orbits.orbit(i)
            along += hc
            uz += ws
        ux = along * rows[EAST, 0]
        uy = along * rows[NORTH, 0]
    else:
        table = _orbits(waves, place)
        for i in range(rows.shape[1]):
            ux += rows[EAST, i] * table[0, i]
            uy += rows[NORTH, i] * table[0, i]
            uz += table[3, i]
    return plus(current, (ux, uy, uz))


class Potential(NamedTuple):
    """Derivatives of the waves' velocity potential ϕ, whose gradient is the velocity, and of ∂ϕ/∂t
    where the waves are carried to. Second ones are those by xx, xy, yy, xz and yz; that by zz
    follows from ϕxx + ϕyy + ϕzz = 0.
    """

    first: Vector  # the velocity [m/s]
    second: Five  # [1/s]
    rate_first: Vector  # [m/s²]
    rate_second: Five  # [1/s²]
    second_along_path: Five  # change of the second ones, in the same time, along a path [1/s²]


@compiled
def _one_way_potential(waves: AnyWaves, place: Place, path: Vector) -> Potential:
    """Of waves that all run one way, for a point with a velocity [m/s]: sums in the vertical plane
    along it.
    """
    rows = waves.components
    orbits = waves.one_way_orbits(place)
    # derivatives of ϕ (p) and ∂ϕ/∂t (r) along (s) and upwards (z)
    ps = pz = pss = psz = psss = pssz = like(0.0, place.z)
    rs = rz = rss = rsz = like(0.0, place.z)
    for i in range(rows.shape[1]):
        k = rows[K, i]
        omega = rows[OMEGA, i]
        # H cos θ, H sin θ, W cos θ, W sin θ: of the phase θ, dθ/ds = k and dθ/dt = −ω, and of the
        # velocities dH/dz = k W, dW/dz = k H
        hc, hs, wc, ws = orbits.orbit(i)
        khc = k * hc
        kws = k * ws
        ps += hc
        pz += ws
        pss = fma(-k, hs, pss)
        psz = fma(k, wc, psz)
        psss = fma(-k, khc, psss)
        pssz = fma(-k, kws, pssz)
        rs = fma(omega, hs, rs)
        rz = fma(-omega, wc, rz)
        rss = fma(omega, khc, rss)
        rsz = fma(omega, kws, rsz)
    towards = rows[EAST, 0], rows[NORTH, 0]
    ex, ey = towards
    vx, vy, vz = path
    vs = ex * vx + ey * vy
    return Potential(
        first=(ps * ex, ps * ey, pz),
        second=_seen_from_above(towards, pss, psz),
        rate_first=(rs * ex, rs * ey, rz),
        rate_second=_seen_from_above(towards, rss, rsz),
        # ϕszz = −ϕsss
        second_along_path=_seen_from_above(towards, psss * vs + pssz * vz, pssz * vs - psss * vz),
    )


@compiled
def _seen_from_above(towards: Two, ss: float, sz: float) -> Five:
    """Second derivatives by those in the vertical plane of a direction."""
    ex, ey = towards
    ssx = ss * ex
    ssy = ss * ey
    return ssx * ex, ssx * ey, ssy * ey, sz * ex, sz * ey


# apart, as these sums within a step would slow down also steps that need none
@compiled_apart
def _potential(waves: AnyWaves, place: Place, path: Vector) -> Potential:
    """Of any waves, for a point with a velocity [m/s]."""
    rows = waves.components
    # stored for lanes, too: so many sums leave no registers to compute orbits in between
    table = _orbits(waves, place)
    zero = like(0.0, place.z)
    # derivatives of ϕ (p) and ∂ϕ/∂t (r)
    px = py = pz = zero
    pxx = pxy = pyy = pxz = pyz = zero
    pxxx = pxxy = pxyy = pyyy = pxxz = pxyz = pyyz = zero
    rx = ry = rz = zero
    rxx = rxy = ryy = rxz = ryz = zero
    for i in range(rows.shape[1]):
        kx = rows[KX, i]
        ky = rows[KY, i]
        omega = rows[OMEGA, i]
        ex = rows[EAST, i]
        ey = rows[NORTH, i]

        # as in `_one_way_potential`, along the component's own direction
        hc = table[0, i]
        hcx = ex * hc
        hcy = ey * hc
        hcxx = kx * hcx
        hcxy = kx * hcy
        hcyy = ky * hcy
        px += hcx
        py += hcy
        pxxx = fma(-kx, hcxx, pxxx)
        pxxy = fma(-ky, hcxx, pxxy)
        pxyy = fma(-ky, hcxy, pxyy)
        pyyy = fma(-ky, hcyy, pyyy)
        rxx = fma(omega, hcxx, rxx)
        rxy = fma(omega, hcxy, rxy)
        ryy = fma(omega, hcyy, ryy)

        hs = table[1, i]
        hsx = ex * hs
        hsy = ey * hs
        pxx = fma(-kx, hsx, pxx)
        pxy = fma(-kx, hsy, pxy)
        pyy = fma(-ky, hsy, pyy)
        rx = fma(omega, hsx, rx)
        ry = fma(omega, hsy, ry)

        wc = table[2, i]
        pxz = fma(kx, wc, pxz)
        pyz = fma(ky, wc, pyz)
        rz = fma(-omega, wc, rz)

        ws = table[3, i]
        wsx = kx * ws
        wsy = ky * ws
        pz += ws
        pxxz = fma(-kx, wsx, pxxz)
        pxyz = fma(-kx, wsy, pxyz)
        pyyz = fma(-ky, wsy, pyyz)
        rxz = fma(omega, wsx, rxz)
        ryz = fma(omega, wsy, ryz)
    vx, vy, vz = path
    return Potential(
        first=(px, py, pz),
        second=(pxx, pxy, pyy, pxz, pyz),
        rate_first=(rx, ry, rz),
        rate_second=(rxx, rxy, ryy, rxz, ryz),
        # ϕxzz = −ϕxxx − ϕxyy
        second_along_path=(
            pxxx * vx + pxxy * vy + pxxz * vz,
            pxxy * vx + pxyy * vy + pxyz * vz,
            pxyy * vx + pyyy * vy + pyyz * vz,
            pxxz * vx + pxyz * vy - (pxxx + pxyy) * vz,
            pxyz * vx + pyyz * vy - (pxxy + pyyy) * vz,
        ),
    )


@compiled
def _matrix(second: Five) -> Matrix:
    """All second derivatives."""
    xx, xy, yy, xz, yz = second
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, -xx - yy)


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
    height = _height_in(waves, z)
    # where waves do not change with height any more, neither does climbing count, nor what of an
    # axis points up
    varies = select(z == height, 1.0, 0.0)
    path = vx - rows[CARRIER_EAST, 0], vy - rows[CARRIER_NORTH, 0], varies * vz
    along = ax, ay, varies * az
    place = _place_of(waves, x, y, height, time)
    if waves.one_way:
        potential = _one_way_potential(waves, place, path)
    else:
        potential = _potential(waves, place, path)
    gradient = _matrix(potential.second)
    rate = plus(potential.rate_first, matvec(gradient, path))
    axis_acceleration_gradient = matvec(_matrix(potential.rate_second), along)
    gradient_along_path = matvec(_matrix(potential.second_along_path), along)
    (gxx, gxy, gxz), (gyx, gyy, gyz), (gzx, gzy, gzz) = gradient
    # j: gradient of the current
    (jxx, jxy, jxz), (jyx, jyy, jyz), (jzx, jzy, jzz) = current.gradient
    return Flow(
        plus(current.velocity, potential.first),
        plus(current.rate, rate),
        (
            (gxx + jxx, gxy + jxy, varies * gxz + jxz),
            (gyx + jyx, gyy + jyy, varies * gyz + jyz),
            (gzx + jzx, gzy + jzy, varies * gzz + jzz),
        ),
        plus(axis_acceleration_gradient, gradient_along_path),
        axis_acceleration_gradient,
    )
