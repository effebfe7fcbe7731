"""Colours of a film, and what a study adds: other estimates beside the follower's own, errors that colour its rays."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, own_arrays

RGB = tuple[float, float, float]
"""Red, green, blue, each in [0, 1]."""

LEADER: RGB = (1.0, 0.68, 0.20)
"""Trail and label of the leader, after its hull."""
TRUTH: RGB = (1.0, 0.95, 0.25)
"""Trail and position of a follower, after its hull."""
ESTIMATE: RGB = (1.0, 0.25, 0.85)
"""A follower's estimate of its own position."""
STATION: RGB = (0.45, 1.0, 1.0)
"""Station of a follower in formation."""
TRANSMITTER_COLOURS: tuple[RGB, ...] = ((0.95, 0.97, 1.0), (0.35, 1.0, 0.55), (0.45, 0.70, 1.0))
"""Rear, front and middle transmitter and their rays; distinct from leader and follower, also to colour-blind eyes."""

_SHARES = (-1.0, 0.0, 1.0)
_COLOURS = np.array([[0.22, 0.56, 1.0], [0.97, 0.97, 0.95], [1.0, 0.26, 0.20]])
"""Blue for less, red for more; the middle is pale, so that it shows on a dark sea."""
_UNKNOWN: RGB = (0.45, 0.55, 0.60)


def diverging(shares: npt.ArrayLike) -> Floats:
    """Colours of values in [-1, 1], symmetric about 0 and constant beyond; shape (…) gives shape (…, 3)."""
    values = np.asarray(shares, dtype=np.float64)
    colours = np.stack([np.interp(values, _SHARES, channel) for channel in _COLOURS.T], axis=-1)
    return np.where(np.isnan(values)[..., None], _UNKNOWN, colours)


@dataclass(frozen=True, kw_only=True)
class OtherEstimate:
    """Another navigator's estimate from the filmed follower's measurements."""

    label: str
    colour: RGB
    position: Floats
    """Estimated position (x, y) at filter steps k = 1 … n, shape (n, 2), [m]."""

    def __post_init__(self) -> None:
        own_arrays(self)


@dataclass(frozen=True, kw_only=True)
class RayErrors:
    """Errors that colour the rays of the filmed follower.

    Raises ValueError if the limit is not positive.
    """

    label: str
    value: Floats
    """Error of each message's range from the rear, front, middle transmitter, shape (m, 3), [m]; NaN where unknown."""
    limit: float
    """Value at the ends of the colour bar [m]."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.limit) and self.limit > 0):
            raise ValueError(f"the colour bar ends at {self.limit:g} m, expected a positive number")
        own_arrays(self)

    def colours(self, message: int) -> tuple[RGB, ...]:
        """Colours of a message's rays, rear, front and middle; message -1 stands for none."""
        shares = self.value[message] / self.limit if message >= 0 else np.full(3, np.nan)
        return tuple((float(r), float(g), float(b)) for r, g, b in diverging(shares))


@dataclass(frozen=True, kw_only=True)
class Annotations:
    """Additions to a film; the default adds nothing."""

    caption: str = ""
    """What the film shows: a line at the upper edge, with a legend."""
    label: str = "estimate"
    """Name of the follower's own estimate in the legend."""
    others: tuple[OtherEstimate, ...] = ()
    rays: RayErrors | None = None

    def ray_colours(self, message: int) -> tuple[RGB, ...]:
        """Colours of the filmed follower's rays, rear, front and middle; message -1 stands for none."""
        return self.rays.colours(message) if self.rays else TRANSMITTER_COLOURS


NOTHING = Annotations()
"""Adds nothing."""
