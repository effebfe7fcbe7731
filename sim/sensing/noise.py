"""Counter-based random numbers: any draw from (seed, run, stream, step), alone and in any order.

Results depend neither on blocks, threads nor order, and a single flight has exactly the noise of
run k of a campaign.

The generator is Philox4x32-10 (Salmon, Moraes, Dror & Shaw, "Parallel random numbers: as easy as 1,
2, 3", SC 2011): counter (step, run, stream, block), key the 64-bit seed. Its four 32-bit words give
two normals or up to four uniforms; who needs more takes further blocks.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba.extending import overload

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, formula, inlined
from laisn.errors import LaisnError
from laisn.vector_math import fma, from_bits, integer, log, sin_cos_quarter, to_bits, turned

LEADER_STREAMS = 128  # streams from here on belong to the leader and are the same for all followers
STREAMS = 256  # room for streams of one follower; follower f uses streams f STREAMS + stream
RECEIVERS = 256
"""Room for receivers of one link: the noise number l RECEIVERS + f, in the place of a follower's
index, is of receiver f on further link l.
"""
LEADER_NUMBER = RECEIVERS - 1
"""The leader's place among the receivers of a link."""
MAX_LINKS = 16  # room for links
_VEHICLES_A_NUMBER = 64  # room for looks at vehicles among the streams of one noise number

_U = np.uint64
_MULTIPLIER_0 = _U(0xD2511F53)
_MULTIPLIER_1 = _U(0xCD9E8D57)
_WEYL_0 = _U(0x9E3779B9)
_WEYL_1 = _U(0xBB67AE85)
_WORD = _U(0xFFFFFFFF)
_HALF = _U(32)
_ONE = _U(0x3FF0000000000000)  # bits of 1.0
_UPPER_SHIFT = _U(20)
_LOWER_SHIFT = _U(12)
_HALF_PI = math.pi / 2
_WORD_UNIT = 2.0**-32


class Stream(IntEnum):
    """What a draw is for. A number never changes its meaning: results of a seed would change
    with it.
    """

    OWN_MOTION = 0  # normals at every step: speed log, compass
    DEPTH = 1  # normal at every step: the follower's pressure sensor
    RANGE_UNIFORM = 2  # uniforms at a reception: rear, front, middle transmitter
    RANGE_SCALE = 3  # normal at a reception: ψ, shared by the transmitters
    ECHO = 4  # uniforms and normals at a reception: multipath
    LOSS = 5  # uniforms at a reception: lost messages and ranges
    GYRO = 6  # normals at every step: rates of turn about the hull's up and port axes
    TILT = 7  # normals at every step: the follower's inclinometer along and across the hull
    DVL = 8  # normals at a reading: the follower's Doppler velocity log, where it has one
    ROLL_GYRO = 9  # normal at every step: rate of turn about the hull's forward axis
    # normals at a look at a vehicle, the leader being vehicle 0; see `number_of_look`
    NEARBY = 64
    LEADER_MOTION = LEADER_STREAMS  # normals at an emission: the leader's speed log, compass
    LEADER_DEPTH = LEADER_STREAMS + 1  # normal at an emission: the leader's pressure sensor
    LEADER_ATTITUDE = LEADER_STREAMS + 2  # normals at an emission: the leader's pitch, roll
    LEADER_POSITION = LEADER_STREAMS + 3  # normals at an emission: its position, east, north
    LEADER_POSITION_WALK = LEADER_STREAMS + 4  # normals at every step: the walk of these
    LEADER_GYRO = LEADER_STREAMS + 5  # normals at every step: the leader's own gyros, as GYRO
    LEADER_TILT = LEADER_STREAMS + 6  # normals at every step: its own inclinometer, as TILT
    LEADER_ROLL_GYRO = LEADER_STREAMS + 7  # normal at every step: its own gyro, as ROLL_GYRO

    def number(self, follower: int = 0) -> int:
        """Number of the stream for a follower (0, 1, …); the leader's streams have one for all."""
        return int(self) if self >= LEADER_STREAMS else int(self) + STREAMS * follower


_NEARBY = int(Stream.NEARBY)


@formula
def number_of_look(follower: int, vehicle: int) -> int:
    """Stream of what a follower sees of vehicle v: 64 + v among the follower's own, and for
    vehicles from 64 on of noise numbers that no receiver has.
    """
    owner = follower + vehicle // _VEHICLES_A_NUMBER * RECEIVERS * MAX_LINKS
    return STREAMS * owner + _NEARBY + vehicle % _VEHICLES_A_NUMBER


@inlined
def _round(
    c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64, k0: np.uint64, k1: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    p0 = c0 * _MULTIPLIER_0
    p1 = c2 * _MULTIPLIER_1
    return (p1 >> _HALF) ^ c1 ^ k0, p1 & _WORD, (p0 >> _HALF) ^ c3 ^ k1, p0 & _WORD


@inlined
def _two_rounds(
    c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64, k0: np.uint64, k1: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    d0, d1, d2, d3 = _round(c0, c1, c2, c3, k0, k1)
    return _round(d0, d1, d2, d3, (k0 + _WEYL_0) & _WORD, (k1 + _WEYL_1) & _WORD)


@inlined
def philox(
    c0: np.uint64, c1: np.uint64, c2: np.uint64, c3: np.uint64, k0: np.uint64, k1: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Four random 32-bit words (held in 64 bits) of a counter of four and a key of two. Compiled
    code only.
    """
    # Written out: a loop over the rounds would not be vectorised over lanes.
    c0, c1, c2, c3 = _two_rounds(c0, c1, c2, c3, k0, k1)
    k0 = (k0 + _U(2) * _WEYL_0) & _WORD
    k1 = (k1 + _U(2) * _WEYL_1) & _WORD
    c0, c1, c2, c3 = _two_rounds(c0, c1, c2, c3, k0, k1)
    k0 = (k0 + _U(2) * _WEYL_0) & _WORD
    k1 = (k1 + _U(2) * _WEYL_1) & _WORD
    c0, c1, c2, c3 = _two_rounds(c0, c1, c2, c3, k0, k1)
    k0 = (k0 + _U(2) * _WEYL_0) & _WORD
    k1 = (k1 + _U(2) * _WEYL_1) & _WORD
    c0, c1, c2, c3 = _two_rounds(c0, c1, c2, c3, k0, k1)
    k0 = (k0 + _U(2) * _WEYL_0) & _WORD
    k1 = (k1 + _U(2) * _WEYL_1) & _WORD
    return _two_rounds(c0, c1, c2, c3, k0, k1)


@inlined
def words(
    seed: np.uint64, run: np.uint64, stream: np.uint64, step: np.uint64
) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Four random words of an address. Compiled code only."""
    return philox(step, run, stream, _U(0), seed & _WORD, seed >> _HALF)


@inlined
def _one_to_two(upper: np.uint64, lower: np.uint64) -> float:
    """Uniform in [1, 2) on a grid of 2⁻⁵²."""
    return from_bits((upper << _UPPER_SHIFT) | (lower >> _LOWER_SHIFT) | _ONE)


@inlined
def two_uniforms(w0: np.uint64, w1: np.uint64, w2: np.uint64, w3: np.uint64) -> tuple[float, float]:
    """Two uniforms in [1, 2) of four random words. Compiled code only."""
    return _one_to_two(w0, w1), _one_to_two(w2, w3)


@inlined
def two_normals(first: float, second: float) -> tuple[float, float]:
    """Two independent standard normals of two uniforms in [1, 2) (Box & Muller, 1958). Compiled
    code only.
    """
    radius = math.sqrt(-2.0 * log(2.0 - first))
    # The angle within a quarter turn is uniform whatever its two lowest bits are; these choose the
    # quarter.
    s, c = sin_cos_quarter((second - 1.5) * _HALF_PI)
    s, c = turned(s, c, to_bits(second))
    return radius * c, radius * s


@inlined
def uniform(word: np.uint64) -> float:
    """Uniform in (0, 1) of a random word: the middle of one of 2³² cells. Compiled code only."""
    return fma(integer(word), _WORD_UNIT, 0.5 * _WORD_UNIT)


@compiled
def _draw(
    seed: np.uint64, run: np.uint64, stream: int, step: int, block: int
) -> tuple[float, float, float, float, float, float]:
    """Two normals and four uniforms of a block of an address, of the same words."""
    w0, w1, w2, w3 = philox(_U(step), run, _U(stream), _U(block), seed & _WORD, seed >> _HALF)
    first, second = two_uniforms(w0, w1, w2, w3)
    normal, second_normal = two_normals(first, second)
    return normal, second_normal, uniform(w0), uniform(w1), uniform(w2), uniform(w3)


@compiled
def _draws(seed: np.uint64, run: np.uint64, stream: int, steps: Ints, block: int) -> Floats:
    """The same of each step, shape (m, 6)."""
    draws = np.empty((steps.size, 6))
    for i in range(steps.size):
        for j, value in enumerate(_draw(seed, run, stream, steps[i], block)):
            draws[i, j] = value
    return draws


def seed_and_run(seed: int, run: int) -> tuple[np.uint64, np.uint64]:
    """As compiled code takes them; LaisnError if one is too large."""
    for name, value, bits in (("seed", seed, 64), ("run", run, 32)):
        if not 0 <= value < 2**bits:
            raise LaisnError(f"{name} is {value}, expected 0 … 2^{bits} − 1")
    return _U(seed), _U(run)


def _address(
    seed: int, run: int, stream: int, steps: npt.ArrayLike
) -> tuple[np.uint64, np.uint64, int, Ints]:
    """Checked address of an array of draws."""
    if not 0 <= stream < 2**32:
        raise LaisnError(f"stream is {stream}, expected 0 … 2^32 − 1")
    return *seed_and_run(seed, run), stream, np.atleast_1d(np.asarray(steps, dtype=np.int64))


def normals(seed: int, run: int, stream: int, steps: npt.ArrayLike, block: int = 0) -> Floats:
    """Standard normals, two for each step, shape (m, 2), independent over columns, steps, blocks,
    streams, runs and seeds.

    `stream` is `Stream.number(follower)`, `steps` are filter steps k, shape (m,); further blocks
    have further normals of the same steps. LaisnError if seed or run is too large.
    """
    return _draws(*_address(seed, run, stream, steps), block)[:, :2]


def uniforms(seed: int, run: int, stream: int, steps: npt.ArrayLike) -> Floats:
    """Uniforms in (0, 1), four for each step, shape (m, 4); arguments and errors as in
    `normals`.
    """
    return _draws(*_address(seed, run, stream, steps), 0)[:, 2:]


class Address(NamedTuple):
    """Where draws come from."""

    seed: np.uint64
    run: np.uint64
    # index of the follower, or noise number: that with RECEIVERS times the link's number added
    follower: int
    step: int  # filter step


@formula
def _number(address: Address, stream: int) -> int:
    """Number of a stream at an address; streams of the sender are the same for all receivers of a
    link.
    """
    link = address.follower // RECEIVERS * RECEIVERS
    return stream + STREAMS * (link if stream >= LEADER_STREAMS else address.follower)


STEPS_AHEAD = 16
"""Filter steps that `draw_ahead` draws for."""


@compiled
def draw_ahead(address: Address, stream: int, normals: Floats) -> None:
    """Two standard normals of a stream at each of STEPS_AHEAD steps from an address on: first all
    first ones, then all second ones, shape (2 STEPS_AHEAD,).
    """
    number = _U(_number(address, stream))
    # loops of their own, which are vectorised
    for i in range(STEPS_AHEAD):
        w0, w1, w2, w3 = words(address.seed, address.run, number, _U(address.step + i))
        normals[i], normals[STEPS_AHEAD + i] = two_uniforms(w0, w1, w2, w3)
    for i in range(STEPS_AHEAD):
        normals[i], normals[STEPS_AHEAD + i] = two_normals(normals[i], normals[STEPS_AHEAD + i])


def normals_at(address: Address, stream: int) -> tuple[float, float]:
    """Two standard normals of a stream at an address."""
    return _draw(address.seed, address.run, _number(address, stream), address.step, 0)[:2]


def uniforms_at(address: Address, stream: int) -> tuple[float, float, float]:
    """Three uniforms in (0, 1) of a stream at an address."""
    return _draw(address.seed, address.run, _number(address, stream), address.step, 0)[2:5]


@inlined
def _words_at(address: Address, stream: int) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    return words(address.seed, address.run, _U(_number(address, stream)), _U(address.step))


# numba compares the annotations of the outer functions, of types, and of the inner ones, of values
@overload(normals_at)
def _normals_at(address: Any, stream: Any) -> Any:
    def normals_at(address: Any, stream: Any) -> Any:
        w0, w1, w2, w3 = _words_at(address, stream)
        first, second = two_uniforms(w0, w1, w2, w3)
        return two_normals(first, second)

    return normals_at


@overload(uniforms_at)
def _uniforms_at(address: Any, stream: Any) -> Any:
    def uniforms_at(address: Any, stream: Any) -> Any:
        w0, w1, w2, _ = _words_at(address, stream)
        return uniform(w0), uniform(w1), uniform(w2)

    return uniforms_at
