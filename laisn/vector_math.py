"""Elementary functions that vectorise over lanes and give the same bits wherever they are compiled.

The C library's cost five times as much in a loop and stop it from being vectorised. Every
multiplication that is followed by an addition is an explicit fused one, so that a compiler's
freedom to contract expressions changes nothing. Series are those of any handbook (Abramowitz &
Stegun 4.1.27, 4.2.1, 4.3.65, 4.3.66); absolute errors are below 1e-14 for the magnitudes that occur
here. To be called from compiled code only.
"""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numba import types
from numba.extending import intrinsic

from laisn.arrays import Floats
from laisn.compiled import inlined, select
from laisn.simd import BitsType, LaneType, bitcast_of_lanes, bits, fma_of_lanes, lane

if TYPE_CHECKING:
    from llvmlite.ir import IRBuilder, Value
    from numba.core.base import BaseContext
    from numba.core.typing.templates import Signature

_U = np.uint64
_ONE_BIT = _U(1)
_TWO_BIT = _U(2)
_EXPONENT_SHIFT = _U(52)
_SIGN_SHIFT = _U(62)
_MANTISSA = _U(0x000FFFFFFFFFFFFF)
_ONE = _U(0x3FF0000000000000)  # bits of 1.0
_SQRT_HALF = _U(0x3FE6A09E667F3BCD)  # bits of √½
_INTEGER = _U(0x4330000000000000)  # bits of 2⁵²: or-ing an integer below 2⁵² into them adds it
_TWO_52 = 4503599627370496.0
_ROUNDING = 1.5 * _TWO_52  # adding it leaves the nearest integer in the low bits
_BIAS = _U(1023)
_ALL_BITS = _U(0xFFFFFFFFFFFFFFFF)
MIN_EXPONENT = -700.0
"""An exponent whose `exp` is a normal number, for bounds of what decays."""
_LN2 = math.log(2.0)
_LN2_HIGH = 0.6931471803691238  # ln 2 to 32 bits, so that its products with exponents are exact
_LN2_LOW = 1.9082149292705877e-10
_TWO_OVER_PI = 2.0 / math.pi
_HALF_PI = math.pi / 2
# π/2 beyond double precision, for the reduction of the argument
_HALF_PI_LOW = 6.123233995736766e-17
_QUARTER_PI = math.pi / 4
_TAN_PI_8 = math.sqrt(2.0) - 1.0

_S1, _S2, _S3, _S4, _S5, _S6, _S7 = ((-1) ** n / math.factorial(2 * n + 1) for n in range(1, 8))
_C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8 = ((-1) ** n / math.factorial(2 * n) for n in range(1, 9))
_E2, _E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (
    1.0 / math.factorial(n) for n in range(2, 14)
)
_L1, _L2, _L3, _L4, _L5, _L6, _L7, _L8, _L9 = (2.0 / (2 * n + 1) for n in range(1, 10))


# arctan(t)/t in powers of t² on |t| ≤ tan π/8, by Chebyshev interpolation
_FIT = np.polynomial.Chebyshev.interpolate(
    lambda q: np.arctan(np.sqrt(q)) / np.sqrt(q), 10, domain=[0.0, _TAN_PI_8**2]
)
_A0, _A1, _A2, _A3, _A4, _A5, _A6, _A7, _A8, _A9, _A10 = _FIT.convert(
    kind=np.polynomial.Polynomial
).coef.tolist()


def _fit_to_half(function: Callable[[Floats], Floats], degree: int) -> list[float]:
    """Coefficients of a polynomial in t² for |t| ≤ ½, by Chebyshev interpolation of a function of
    t, positive.
    """
    fit = np.polynomial.Chebyshev.interpolate(
        lambda q: function(np.sqrt(q)), degree, domain=[0.0, 0.25]
    )
    coefficients: list[float] = fit.convert(kind=np.polynomial.Polynomial).coef.tolist()
    return coefficients


# sin(π/2 t)/t and (cos(π/2 t) − 1)/t²
_T0, _T1, _T2, _T3, _T4, _T5, _T6 = _fit_to_half(lambda t: np.sin(_HALF_PI * t) / t, 6)
_U0, _U1, _U2, _U3, _U4, _U5 = _fit_to_half(lambda t: -2.0 * (np.sin(_QUARTER_PI * t) / t) ** 2, 5)
# sinh(t ln 2)/t and (cosh(t ln 2) − 1)/t²
_G0, _G1, _G2, _G3, _G4 = _fit_to_half(lambda t: np.sinh(_LN2 * t) / t, 4)
_H0, _H1, _H2, _H3, _H4 = _fit_to_half(lambda t: 2.0 * (np.sinh(0.5 * _LN2 * t) / t) ** 2, 4)


def _emit_fma(_: object, a: types.Type, b: types.Type, c: types.Type) -> Any:
    if any(isinstance(kind, LaneType) for kind in (a, b, c)):
        return fma_of_lanes(a, b, c)

    def generate(
        context: "BaseContext",
        builder: "IRBuilder",
        signature: "Signature",
        args: Sequence["Value"],
    ) -> "Value":
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), generate


def _bitcast(source: types.Type, target: types.Type) -> Any:
    def emit(_: object, value: types.Type) -> Any:
        if isinstance(value, LaneType | BitsType):
            return bitcast_of_lanes(value, bits if isinstance(value, LaneType) else lane)
        signature = target(source)
        return signature, lambda context, builder, _, args: builder.bitcast(
            args[0], context.get_value_type(target)
        )

    return intrinsic(emit)


fma: Callable[[float, float, float], float] = cast(Any, intrinsic(_emit_fma))
"""a·b + c, rounded once."""
to_bits: Callable[[float], np.uint64] = _bitcast(types.float64, types.uint64)
"""Bits of a double as an unsigned integer."""
from_bits: Callable[[np.uint64], float] = _bitcast(types.uint64, types.float64)
"""Double of the given bits."""


@inlined
def integer(bits: np.uint64) -> float:
    """Double of an unsigned integer below 2⁵², without the slow general conversion."""
    return from_bits(bits | _INTEGER) - _TWO_52


@inlined
def log(x: float) -> float:
    """Natural logarithm of a positive, normal double."""
    # x = m 2ᵉ with m in [√½, √2)
    shifted = to_bits(x) - _SQRT_HALF + _ONE
    e = integer(shifted >> _EXPONENT_SHIFT) - 1023.0
    m = from_bits((shifted & _MANTISSA) + _SQRT_HALF)
    s = (m - 1.0) / (m + 1.0)
    q = s * s
    p = fma(
        fma(
            fma(fma(fma(fma(fma(fma(_L9, q, _L8), q, _L7), q, _L6), q, _L5), q, _L4), q, _L3),
            q,
            _L2,
        ),
        q,
        _L1,
    )
    return fma(fma(p, q, 2.0), s, e * _LN2)


@inlined
def exp(x: float) -> float:
    """Exponential of a number between −708 and 709."""
    # x = r + k ln 2 with |r| ≤ ½ ln 2
    count = fma(x, 1.0 / _LN2, _ROUNDING)
    k = count - _ROUNDING
    r = fma(-k, _LN2_LOW, fma(-k, _LN2_HIGH, x))
    p = fma(fma(fma(fma(fma(fma(_E13, r, _E12), r, _E11), r, _E10), r, _E9), r, _E8), r, _E7)
    p = fma(fma(fma(fma(fma(p, r, _E6), r, _E5), r, _E4), r, _E3), r, _E2)
    return (fma(p, r * r, r) + 1.0) * from_bits((to_bits(count) + _BIAS) << _EXPONENT_SHIFT)


@inlined
def sin_cos_quarter(r: float) -> tuple[float, float]:
    """Sine and cosine of an angle within ±π/4."""
    q = r * r
    s = fma(fma(fma(fma(fma(fma(_S7, q, _S6), q, _S5), q, _S4), q, _S3), q, _S2), q, _S1)
    c = fma(
        fma(fma(fma(fma(fma(fma(_C8, q, _C7), q, _C6), q, _C5), q, _C4), q, _C3), q, _C2), q, _C1
    )
    return fma(s, q, 1.0) * r, fma(c, q, 1.0)


@inlined
def turned(s: float, c: float, quadrant: np.uint64) -> tuple[float, float]:
    """Sine and cosine of an angle that lies `quadrant` right angles further; its low two bits
    count.
    """
    odd = (quadrant & _ONE_BIT) != _U(0)
    swapped_s = select(odd, c, s)
    swapped_c = select(odd, s, c)
    sine_sign = (quadrant & _TWO_BIT) << _SIGN_SHIFT
    cosine_sign = ((quadrant + _ONE_BIT) & _TWO_BIT) << _SIGN_SHIFT
    return from_bits(to_bits(swapped_s) ^ sine_sign), from_bits(to_bits(swapped_c) ^ cosine_sign)


@inlined
def sin_cos(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle of at most some thousand turns [rad]."""
    count = fma(angle, _TWO_OVER_PI, _ROUNDING)
    k = count - _ROUNDING
    s, c = sin_cos_quarter(fma(-k, _HALF_PI_LOW, fma(-k, _HALF_PI, angle)))
    return turned(s, c, to_bits(count))


@inlined
def sin_cos_of_right_angles(x: float) -> tuple[float, float]:
    """Sine and cosine of x right angles, at most some thousand: to reduce such an angle takes no
    multiplication.
    """
    count = x + _ROUNDING
    r = x - (count - _ROUNDING)
    q = r * r
    s = fma(fma(fma(fma(fma(fma(_T6, q, _T5), q, _T4), q, _T3), q, _T2), q, _T1), q, _T0)
    c = fma(fma(fma(fma(fma(_U5, q, _U4), q, _U3), q, _U2), q, _U1), q, _U0)
    return turned(s * r, fma(c, q, 1.0), to_bits(count))


@inlined
def powers_of_two(x: float) -> tuple[float, float]:
    """2ˣ and 2⁻ˣ, |x| at most 1020, for less than two exponentials."""
    # 2ˣ = 2ⁿ (cosh(r ln 2) + sinh(r ln 2)) with |r| ≤ ½
    count = x + _ROUNDING
    r = x - (count - _ROUNDING)
    q = r * r
    even = fma(fma(fma(fma(fma(_H4, q, _H3), q, _H2), q, _H1), q, _H0), q, 1.0)
    odd = fma(fma(fma(fma(_G4, q, _G3), q, _G2), q, _G1), q, _G0)
    # what adds n to the exponent of a number; all bits of n turned over are −n − 1
    n = to_bits(count)
    up = n << _EXPONENT_SHIFT
    down = ((n ^ _ALL_BITS) + _ONE_BIT) << _EXPONENT_SHIFT
    return (
        from_bits(to_bits(fma(odd, r, even)) + up),
        from_bits(to_bits(fma(odd, -r, even)) + down),
    )


@inlined
def half_turn_angle(cross: float, dot: float) -> float:
    """Angle between two vectors from their cross and dot product, atan2(|cross|, dot) in [0, π];
    0 for two zeros.
    """
    a = abs(cross)
    b = abs(dot)
    shallow = a <= _TAN_PI_8 * b
    steep = b <= _TAN_PI_8 * a
    # tangent above / below of the angle from `start`: 0, π/2, or else π/4
    above = select(shallow, a, select(steep, -b, a - b))
    below = select(shallow, b, select(steep, a, a + b))
    start = select(shallow, 0.0, select(steep, _HALF_PI, _QUARTER_PI))
    t = above / select(below > 0.0, below, 1.0)
    q = t * t
    p = fma(fma(fma(fma(fma(fma(_A10, q, _A9), q, _A8), q, _A7), q, _A6), q, _A5), q, _A4)
    angle = fma(fma(fma(fma(fma(p, q, _A3), q, _A2), q, _A1), q, _A0), t, start)
    return float(select(dot < 0.0, math.pi - angle, angle))


@inlined
def arctan2(y: float, x: float) -> float:
    """Angle of the vector (x, y) from the first axis, in [−π, π] [rad]; a zero for two zeros."""
    return float(np.copysign(half_turn_angle(y, x), y))


@inlined
def arctan(tangent: float) -> float:
    """Angle of a tangent, in [−π/2, π/2] [rad]."""
    return arctan2(tangent, 1.0)


@inlined
def arcsin(sine: float) -> float:
    """Angle of a sine, which is in [−1, 1], in [−π/2, π/2] [rad]."""
    return arctan2(sine, math.sqrt((1.0 - sine) * (1.0 + sine)))
