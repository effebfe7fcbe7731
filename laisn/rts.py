"""Fixed-lag smoothing of a chain of Gaussians, from message to message.

What later messages add is carried back along the chain by regression of each estimate on the next one (Rauch, Tung &
Striebel 1965; Särkkä, Bayesian Filtering and Smoothing, 2013), written as a sum over the links of a window.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints

_SINGULAR = 1e-13
"""Eigenvalues of a correlation matrix below this are rounding errors: such directions are known exactly."""


class Chain(NamedTuple):
    """Estimates x of s states after each of m messages, or at a known start, each predicted by the one before it.

    The prediction of the first, and how the last one varies with a next, is never read.
    """

    mean: Floats
    """After the message, shape (m, s)."""
    covariance: Floats
    """Covariance after the message, shape (m, s, s)."""
    predicted: Floats
    """Mean just before the message, shape (m, s)."""
    predicted_covariance: Floats
    """Covariance just before the message, shape (m, s, s)."""
    onward: Floats
    """Covariance of x after this message with x just before the next one, shape (m, s, s)."""


class Smoothed(NamedTuple):
    """Quantities given messages before and after them."""

    mean: Floats
    covariance: Floats


def _inverse(covariance: Floats) -> Floats:
    """Inverses of covariances, shape (m, s, s); zero in directions that are known exactly."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    per_sigma = np.divide(1.0, sigma, out=np.zeros_like(sigma), where=sigma > 0.0)
    scale = per_sigma[:, :, None] * per_sigma[:, None, :]
    return np.asarray(scale * np.linalg.pinv(scale * covariance, rcond=_SINGULAR, hermitian=True))


def smooth(chain: Chain, latest: Ints, last: Ints, filtered: tuple[Floats, Floats], onward: Floats) -> Smoothed:
    """Smooth n quantities y, each of r numbers, with later messages.

    Args:
        chain: beliefs, of m messages.
        latest: index of the last message at or before y, shape (n,).
        last: index of the last message to use, shape (n,); y stays as it is where that is no later one.
        filtered: mean and covariance of y given the messages so far, shapes (n, r) and (n, r, r).
        onward: covariance of y with x just before the next message, shape (n, r, s); read only where that is used.

    Returns:
        Mean and covariance, in the shapes of `filtered`.
    """
    mean, covariance = filtered[0].copy(), filtered[1].copy()
    inverse = _inverse(chain.predicted_covariance)
    gain = chain.onward[:-1] @ inverse[1:]
    shift, change = chain.mean - chain.predicted, chain.covariance - chain.predicted_covariance
    which = np.flatnonzero(last > latest)
    message = latest[which] + 1
    back = onward[which] @ inverse[message]
    while which.size:
        mean[which] += np.einsum("nrs,ns->nr", back, shift[message])
        covariance[which] += back @ change[message] @ back.swapaxes(1, 2)
        more = last[which] > message
        which, message, back = which[more], message[more], back[more]
        back = back @ gain[message]
        message = message + 1
    return Smoothed(mean, covariance)
