"""The navigators of a follower or a swarm by their settings: LAISN's family, or the tightly coupled one.

Apart from `navigating`, which the simulator may know, and from both navigators, neither of which knows the other.
"""

from laisn.arrays import Floats
from laisn.navigating import AnyNavigator, AnySettings
from laisn.navigator import Navigator
from laisn.swarm import Swarm
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


def new_swarm(settings: AnySettings, starts: Floats) -> Swarm:
    """The navigators of a swarm that these settings are of, at their starts [x, y, vx, vy], shape (f, 4).

    Raises:
        LaisnError: there are more followers than such a swarm may have, or the settings are for single vehicles.
    """
    if isinstance(settings, TightSettings):
        from laisn.tight.swarm import new_tight_swarm

        return new_tight_swarm(settings, starts)
    from laisn.lane_swarm import new_lanes

    return new_lanes(settings, starts)
