"""Whether a message arrives, and which path of sound the receiver takes for the direct one.

Messages are lost one by one, or in bursts. Bursts follow the two-state chain of Gilbert (Bell System Technical Journal
39, 1960) and Elliott (ibid. 42, 1963): in its good state a channel loses few messages, in its bad state most of them.
"""

from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Ints
from laisn.compiled import formula
from sim.sensing import noise


class Channel(NamedTuple):
    """Chances of loss, each for one message."""

    loss_chance: float = 0.0
    """Chance to lose a message in the good state."""
    burst_chance: float = 0.0
    """Chance to enter the bad state."""
    burst_mean_messages: float = 5.0
    """Mean stay in the bad state: it is left with the inverse chance."""
    burst_loss_chance: float = 1.0
    """Chance to lose a message in the bad state."""

    @property
    def mean_loss(self) -> float:
        """Share of messages that a long mission loses."""
        leave = 1.0 / self.burst_mean_messages
        bad = self.burst_chance / (self.burst_chance + leave)
        return (1.0 - bad) * self.loss_chance + bad * self.burst_loss_chance


@formula
def loses(channel: Channel) -> bool:
    """Whether a message is ever lost."""
    return channel.loss_chance + channel.burst_chance > 0.0


@formula
def is_bad(bad: bool, uniform: float, channel: Channel) -> bool:
    """Whether the next message meets the bad state."""
    return uniform * channel.burst_mean_messages >= 1.0 if bad else uniform < channel.burst_chance


@formula
def is_lost(bad: bool, uniform: float, channel: Channel) -> bool:
    """Whether a message in that state is lost."""
    return uniform < (channel.burst_loss_chance if bad else channel.loss_chance)


def received(seed: int, run: int, follower: int, emission_step: Ints, channel: Channel) -> Bools:
    """Whether each message arrives, shape (m,).

    The chain starts in its good state before the first message; all transmitters share a message's fate.

    Args:
        seed: of the study.
        run: of the campaign.
        follower: 0, 1, …
        emission_step: filter step at which each message was sent, shape (m,), increasing, none left out.
        channel: the chances of loss.
    """
    drawn = noise.uniforms(seed, run, noise.Stream.LOSS.number(follower), emission_step)
    arrived, bad = np.empty(len(drawn), dtype=np.bool_), False
    for i, (change, fate) in enumerate(drawn[:, :2].tolist()):
        bad = is_bad(bad, change, channel)
        arrived[i] = not is_lost(bad, fate, channel)
    return arrived


@formula
def path_taken(uniform: Any, surface_chance: float, bottom_chance: float) -> Any:
    """`Path` that a draw in (0, 1) stands for; numbers or arrays."""
    surface, either = uniform < surface_chance, uniform < surface_chance + bottom_chance
    # 1 for the surface, 2 for the bottom: a draw below the first chance is below the sum of both
    return 2 * either - 1 * surface


def locked_path(
    seed: int, run: int, follower: int, emission_step: Ints, chances: tuple[float, float], common: bool = False
) -> Ints:
    """`Path` that the receiver takes, for each message and transmitter, shape (m, 3).

    Args:
        seed: of the study.
        run: of the campaign.
        follower: 0, 1, …
        emission_step: filter step at which each message was sent, shape (m,).
        chances: of a surface and of a bottom echo.
        common: one draw decides for all transmitters, that of the rear one; else each has its own.
    """
    drawn = noise.uniforms(seed, run, noise.Stream.ECHO.number(follower), emission_step)
    return np.asarray(path_taken(drawn[:, [0, 0, 0] if common else [0, 1, 2]], *chances))
