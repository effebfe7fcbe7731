"""What every navigator is to those who use it: settings and a start go in, then measurements; estimates come out."""

from collections.abc import Callable
from typing import Protocol

from laisn.arrays import Floats
from laisn.estimates import Estimates
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.settings import NavigationSettings
from laisn.tight.settings import TightSettings

AnySettings = NavigationSettings | TightSettings
"""Settings of LAISN or of the tightly coupled navigator; their type says whose."""


class AnyNavigator(Protocol):
    """Whatever turns measurements into estimates, step by step or as a whole."""

    @property
    def state(self) -> Floats:
        """x, y, vx, vy after the last step, shape (4,)."""

    @property
    def covariance(self) -> Floats:
        """Covariance of `state`, shape (4, 4)."""

    def step(self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None) -> object:
        """Advance by one filter step."""

    def run(self, measurements: Measurements) -> Estimates:
        """Estimates of a whole mission from the start."""


NavigatorFactory = Callable[[AnySettings, Floats], AnyNavigator]
"""Makes the navigator of one follower from its settings and its known start [x, y, vx, vy]."""
