"""The navigator of a follower by its settings: LAISN's family, or the tightly coupled one.

Apart from `navigating`, which the simulator may know, and from both navigators, neither of which knows the other.
"""

from laisn.arrays import Floats
from laisn.navigating import AnyNavigator, AnySettings
from laisn.navigator import Navigator
from laisn.tight.settings import TightSettings


def new_navigator(settings: AnySettings, start: Floats) -> AnyNavigator:
    """The navigator that these settings are of, at its start [x, y, vx, vy].

    Raises:
        ValueError: the start is not four finite numbers.
        NotImplementedError: naming a choice that no formula knows.
    """
    if isinstance(settings, TightSettings):
        # its compiled code takes long to import, and few missions use it
        from laisn.tight.navigator import TightNavigator

        return TightNavigator(settings, start)
    return Navigator(settings, start)
