"""Mixtures of Gaussians for `oracle`: a *component* is a Gaussian, a *side* is the
components of its modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg import expm

from laisn.arrays import Floats

N = 17
X, Y, LOG, COMPASS, SCALE, LEADER, EAST, NORTH = range(8)
CLOCK, RATE = 10, 11
SPEED = 16
NEW, WALKED = [12, 13], [14, 15]
"""Errors of the leader's broadcast position: new in a message, and walked until then."""
PLACE, BENT = [X, Y], [X, Y, LEADER]
"""States by which a range bends."""


@dataclass
class Component:
    """A Gaussian, its weight, and what the last message made of it."""

    x: Floats
    P: Floats
    weight: float
    mode: int = 0
    evidence: float = 0.0
    taken: int = 0
    squared: float = 0.0
    normalised_innovation: float = 0.0
    excess: float = 0.0
    shared: bool = False

    def copy(self) -> Component:
        return replace(self, x=self.x.copy(), P=self.P.copy())

    def update(self, residual: Floats, H: Floats, S: Floats) -> None:
        gain = np.linalg.solve(S, H @ self.P).T
        self.x, self.P = self.x + gain @ residual, self.P - gain @ S @ gain.T


Side = list[Component]


def moments(components: list[Component]) -> tuple[Floats, Floats]:
    """Mean and covariance of a mixture."""
    weight = np.array([c.weight for c in components])
    weight = (
        weight / weight.sum() if weight.sum() > 0.0 else np.full(weight.size, 1.0 / weight.size)
    )
    mean = weight @ np.array([c.x for c in components])
    off = np.array([c.x for c in components]) - mean
    return mean, np.einsum("k,kij->ij", weight, [c.P for c in components]) + np.einsum(
        "k,ki,kj->ij", weight, off, off
    )


def log_density(residual: Floats, S: Floats) -> tuple[float, float]:
    squared = float(residual @ np.linalg.solve(S, residual)) if residual.size else 0.0
    return -0.5 * (squared + np.linalg.slogdet(2.0 * np.pi * S)[1]), squared


def weight_of(side: Side) -> float:
    return sum(c.weight for c in side)


def heaviest(side: Side) -> Component:
    return max(side, key=lambda c: c.weight)


def normalise(sides: Sequence[Side]) -> None:
    total = sum(map(weight_of, sides))
    for side in sides:
        for c in side:
            c.weight /= total


def mix(side: Side, chance: Floats) -> None:
    """Before the next instant each mode becomes a blend of all, by chances to change from mode to
    mode, shape (modes, modes).
    """
    given = [c.copy() for c in side]
    for c in side:
        parts = [replace(g, weight=g.weight * chance[g.mode, c.mode]) for g in given]
        if sum(p.weight for p in parts) > 0.0:
            c.x, c.P = moments(parts)
            c.weight = sum(p.weight for p in parts)


def chances(modes: int, rate: float, time: float) -> Floats:
    """Of changing mode: exp(A t) of the chain's rates A [1/s], where there are two."""
    if modes == 1:
        return np.ones((1, 1))
    return _two_modes(rate * time)


@cache
def _two_modes(exponent: float) -> Floats:
    return np.asarray(expm(exponent * np.array([[-1.0, 1.0], [1.0, -1.0]])))


def outer(a: Floats, b: Floats) -> Floats:
    """a bᵀ; `np.outer` takes several times as long for vectors so short."""
    return a[:, None] * b


def prune_and_merge(sides: list[Side], near: float = 1.0) -> None:
    """No side lighter than 1e-5, none nearer to another than `near` in squared distance and in b_L,
    and eight at most.
    """

    def drop(h: int) -> None:
        last = sides.pop()
        if h < len(sides):
            sides[h] = last

    def same(one: Side, other: Side) -> bool:
        a, b = heaviest(one), heaviest(other)
        off = (a.x - b.x)[:2]
        turned, spread = a.x[LEADER] - b.x[LEADER], 0.5 * (a.P + b.P)[LEADER, LEADER]
        if turned**2 > spread:
            return False
        return bool(off @ np.linalg.solve(0.5 * (a.P + b.P)[:2, :2], off) < near)

    h = 0
    while h < len(sides):
        if len(sides) > 1 and weight_of(sides[h]) < 1e-5:
            drop(h)
        else:
            h += 1
    g = 0
    while g < len(sides):
        h = g + 1
        while h < len(sides):
            if same(sides[g], sides[h]):
                for one, other in zip(sides[g], sides[h], strict=True):
                    x, P = (
                        moments([one, other]) if one.weight + other.weight > 0.0 else (one.x, one.P)
                    )
                    top = heaviest([one, other])
                    one.x, one.P, one.weight = x, P, one.weight + other.weight
                    one.taken, one.squared, one.normalised_innovation = (
                        top.taken,
                        top.squared,
                        top.normalised_innovation,
                    )
                drop(h)
            else:
                h += 1
        g += 1
    while len(sides) > 8:
        drop(min(range(len(sides)), key=lambda h: weight_of(sides[h])))
    normalise(sides)
