"""Surface and bottom echoes by image sources, and which of the paths a receiver locks to.

A flat, level boundary sends an echo that seems to come from the mirror image of its source (Medwin & Clay, Fundamentals
of Acoustical Oceanography, 1998). The echo's path is longer than the direct one; a receiver that misses the direct
arrival and takes the echo for it measures a range that is too long: the gross error of paper Section 2.4.
"""

from enum import IntEnum

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, inlined
from sim.sensing import noise
from sim.water.sound import SoundSpeed


class Path(IntEnum):
    """How the sound came; index into arrays over paths."""

    DIRECT = 0
    SURFACE = 1
    BOTTOM = 2


def image(source: Floats, path: Path, floor_depth: float) -> Floats:
    """Apparent position of a source on a path; `source` and the answer have shape (…, 3) in the world, [m]."""
    mirrored = source.copy()
    if path is Path.SURFACE:
        mirrored[..., 2] = -source[..., 2]
    elif path is Path.BOTTOM:
        mirrored[..., 2] = -2.0 * floor_depth - source[..., 2]
    return mirrored


def mean_slowness(sound: SoundSpeed, source: Floats, receiver: Floats, path: Path, floor_depth: float) -> Floats:
    """Mean of 1/c along a path that is straight but for its reflection, shape (…,), [s/m].

    Args:
        sound: speed of sound.
        source: shape (…, 3) in the world, [m].
        receiver: likewise.
        path: which way the sound goes.
        floor_depth: depth of the floor [m].
    """
    depth, other = -source[..., 2], -receiver[..., 2]
    if path is Path.DIRECT:
        return sound.mean_slowness(depth, other)
    turn = 0.0 if path is Path.SURFACE else floor_depth
    # Both legs have the same slope, so that they share the path in proportion to the depths they cross.
    first, second = np.abs(depth - turn), np.abs(other - turn)
    crossed = np.where(first + second > 0.0, first + second, 1.0)
    legs = first * sound.mean_slowness(depth, turn) + second * sound.mean_slowness(other, turn)
    return np.where(first + second > 0.0, legs / crossed, 1.0 / sound.at(turn))


def possible_paths(surface_chance: float, bottom_chance: float) -> tuple[Path, ...]:
    """Paths that have a chance to be taken, by the chances of echoes."""
    chances = (1.0, surface_chance, bottom_chance)
    return tuple(path for path, chance in zip(Path, chances, strict=True) if chance > 0)


@inlined
def path_taken(uniform: float, surface_chance: float, bottom_chance: float) -> int:
    """`Path` that a draw in (0, 1) stands for. Compiled code only."""
    return 1 if uniform < surface_chance else (2 if uniform < surface_chance + bottom_chance else 0)


@compiled
def _paths_taken(draw: Floats, surface_chance: float, bottom_chance: float, common: bool) -> Ints:
    path = np.empty((draw.shape[0], 3), dtype=np.int64)
    for i in range(draw.shape[0]):
        for j in range(3):
            path[i, j] = path_taken(draw[i, 0 if common else j], surface_chance, bottom_chance)
    return path


def locked_path(
    seed: int, run: int, follower: int, emission_step: Ints, chances: tuple[float, float], common: bool = False
) -> Ints:
    """`Path` that the receiver locks to, for each message and transmitter, shape (m, 3).

    Args:
        seed: of the study.
        run: of the campaign.
        follower: 0, 1, …
        emission_step: filter step at which each message was sent, shape (m,).
        chances: of a surface and of a bottom echo.
        common: one draw decides for all transmitters, that of the rear one; else each has its own.
    """
    return _paths_taken(noise.uniforms(seed, run, noise.Stream.ECHO.number(follower), emission_step), *chances, common)
