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
"""Errors of the leader's broadcast position: that of the last message alone, and a random walk."""
POSITION, BENT = [X, Y], [X, Y, LEADER]
"""States in which a range is not linear: `POSITION`, and those with the leader's heading."""


@dataclass
class Component:
    """A Gaussian, its weight, and what the last message made of it."""

    x: Floats
    P: Floats
    weight: float
    mode: int = 0
    evidence: float = 0.0
    taken: int = 0
    """How many numbers of the ranges it was updated with."""
    squared: float = 0.0
    """Their squared residuals, normalised."""
    normalised_innovation: float = 0.0
    """The same a range; those left out count with what leaving them out costs."""
    excess: float = 0.0
    """By how much its estimate of the variance of the leader's heading exceeds the present one."""
    shared: bool = False
    """Whether it explains the ranges by an echo that is common to all."""

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
    offsets = np.array([c.x for c in components]) - mean
    return mean, np.einsum("k,kij->ij", weight, [c.P for c in components]) + np.einsum(
        "k,ki,kj->ij", weight, offsets, offsets
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
    before = [c.copy() for c in side]
    for c in side:
        transitions = [replace(g, weight=g.weight * chance[g.mode, c.mode]) for g in before]
        if sum(p.weight for p in transitions) > 0.0:
            c.x, c.P = moments(transitions)
            c.weight = sum(p.weight for p in transitions)


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


def prune_and_merge(sides: list[Side], merge_distance: float = 1.0) -> None:
    """Drop sides lighter than 1e-5, merge those whose squared distance in units of their mean
    covariance is below `merge_distance` and whose b_L agree, and keep the eight heaviest.
    """

    def drop(h: int) -> None:
        last = sides.pop()
        if h < len(sides):
            sides[h] = last

    def are_close(first: Side, second: Side) -> bool:
        a, b = heaviest(first), heaviest(second)
        offset = (a.x - b.x)[:2]
        heading_difference, variance = a.x[LEADER] - b.x[LEADER], 0.5 * (a.P + b.P)[LEADER, LEADER]
        if heading_difference**2 > variance:
            return False
        return bool(offset @ np.linalg.solve(0.5 * (a.P + b.P)[:2, :2], offset) < merge_distance)

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
            if are_close(sides[g], sides[h]):
                for first, second in zip(sides[g], sides[h], strict=True):
                    x, P = (
                        moments([first, second])
                        if first.weight + second.weight > 0.0
                        else (first.x, first.P)
                    )
                    heavier = heaviest([first, second])
                    first.x, first.P, first.weight = x, P, first.weight + second.weight
                    first.taken, first.squared, first.normalised_innovation = (
                        heavier.taken,
                        heavier.squared,
                        heavier.normalised_innovation,
                    )
                drop(h)
            else:
                h += 1
        g += 1
    while len(sides) > 8:
        drop(min(range(len(sides)), key=lambda h: weight_of(sides[h])))
    normalise(sides)
