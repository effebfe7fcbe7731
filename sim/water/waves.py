"""Linear (Airy) wave components: regular waves and an irregular JONSWAP sea.

Source of the formulas: Faltinsen, Sea Loads on Ships and Offshore Structures, 1990 (Airy waves) and
DNV-RP-C205, 2010, Section 3.5.5 (JONSWAP).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, own_arrays, require_shapes
from laisn.failure import LaisnError

GRAVITY = 9.81
"""Gravity, which pulls on the surface here as it pulls on bodies in models/ocean.xml [m/s²]."""


FLOOR_DEPTH_M = 40.0
"""Depth of the floor of a sea unless it is given [m]."""


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
    """Components η = Σ a cos(k·x − ω t + φ), ω being what someone drifting with the current sees.

    Raises ValueError if the shapes disagree.
    """

    amplitude_m: Floats
    """Amplitudes a, shape (n,)."""
    wavenumber_1_m: Floats
    """Wave numbers east and north, towards where the wave runs, shape (n, 2)."""
    omega_rad_s: Floats
    """Angular frequencies ω, shape (n,)."""
    phase_rad: Floats
    """Phases φ, shape (n,)."""
    floor_depth_m: float = FLOOR_DEPTH_M
    """Depth for which the wavenumbers hold; an `Ocean` sets its own."""

    def __post_init__(self) -> None:
        n = self.amplitude_m.size
        shapes = {"amplitude_m": (n,), "wavenumber_1_m": (n, 2), "omega_rad_s": (n,), "phase_rad": (n,)}
        require_shapes(self, shapes)
        own_arrays(self)

    @classmethod
    def none(cls) -> Self:
        """A flat sea."""
        empty = np.zeros(0)
        return cls(amplitude_m=empty, wavenumber_1_m=np.zeros((0, 2)), omega_rad_s=empty, phase_rad=empty)

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
        """One component; height crest to trough, `direction_rad` is the compass direction it runs towards.

        Raises:
            LaisnError: the height is more than such a wave can have.
        """
        omega = np.array([2 * np.pi / period_s])
        k = wavenumber(omega, floor_depth_m)
        _require_unbroken("height_m", height_m, float(k[0]), floor_depth_m)
        towards = np.array([[np.sin(direction_rad), np.cos(direction_rad)]])
        return cls(
            amplitude_m=np.array([height_m / 2]),
            wavenumber_1_m=k[:, None] * towards,
            omega_rad_s=omega,
            phase_rad=np.array([float(phase_rad)]),
            floor_depth_m=floor_depth_m,
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
        """An irregular sea: JONSWAP spectrum, phases and places within the frequency bins drawn from `rng`.

        Each component has the energy of its bin, so that 4 √(Σ a²/2) is the significant height exactly. `spread_rad`
        is the standard deviation of the components' directions (0: long-crested).

        Raises:
            LaisnError: the height is more than a regular wave of the peak's length could have.
        """
        peak = 2 * np.pi / peak_period_s
        k_peak = float(wavenumber(peak, floor_depth_m))
        _require_unbroken("significant_height_m", significant_height_m, k_peak, floor_depth_m)
        edges, energy = _jonswap_bins(peakedness, n_components)
        omega = peak * rng.uniform(edges[:-1], edges[1:])
        amplitude = significant_height_m / 4 * np.sqrt(2 * energy)
        phase = rng.uniform(0.0, 2 * np.pi, n_components)
        direction = direction_rad + spread_rad * rng.standard_normal(n_components)
        towards = np.stack([np.sin(direction), np.cos(direction)], axis=1)
        return cls(
            amplitude_m=amplitude,
            wavenumber_1_m=wavenumber(omega, floor_depth_m)[:, None] * towards,
            omega_rad_s=omega,
            phase_rad=phase,
            floor_depth_m=floor_depth_m,
        )


def _jonswap_bins(peakedness: float, n: int) -> tuple[Floats, Floats]:
    """Edges of n bins in multiples of the peak's frequency, shape (n + 1,), and the share of energy in each, (n,).

    Bins are narrow in frequency and in energy alike: their edges divide the mean of both shares evenly, so that no
    bin holds more than 2/n of the energy, however sharp the peak, nor of the range, however thin the tail.
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


def _require_unbroken(name: str, height_m: float, wavenumber_1_m: float, floor_depth_m: float) -> None:
    """Miche's limit of steepness, 0.142 tanh(k h) (Miche 1944)."""
    highest = 0.142 * np.tanh(wavenumber_1_m * floor_depth_m) * 2 * np.pi / wavenumber_1_m
    if not 0 <= height_m <= highest:
        raise LaisnError(f"{name}={height_m} must lie between 0 and {highest:.3g} m, where waves of this length break")
