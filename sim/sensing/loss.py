"""Messages that do not arrive: lost one by one, or in bursts.

Bursts follow the two-state chain of Gilbert (Bell System Technical Journal 39, 1960) and Elliott (ibid. 42, 1963): in
its good state a channel loses few messages, in its bad state most of them.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.compiled import compiled, inlined
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
    def chances(self) -> tuple[float, float, float]:
        """The three chances, which must lie within 0 … 1."""
        return self.loss_chance, self.burst_chance, self.burst_loss_chance

    @property
    def loses(self) -> bool:
        """Whether a message is ever lost."""
        return self.loss_chance + self.burst_chance > 0.0

    @property
    def mean_loss(self) -> float:
        """Share of messages that a long mission loses."""
        leave = 1.0 / self.burst_mean_messages
        bad = self.burst_chance / (self.burst_chance + leave)
        return (1.0 - bad) * self.loss_chance + bad * self.burst_loss_chance


NO_LOSS = Channel()


@inlined
def is_bad(bad: bool, uniform: float, channel: Channel) -> bool:
    """Whether the next message meets the bad state. Compiled code only."""
    return uniform * channel.burst_mean_messages >= 1.0 if bad else uniform < channel.burst_chance


@inlined
def is_lost(bad: bool, uniform: float, channel: Channel) -> bool:
    """Whether a message in that state is lost. Compiled code only."""
    return uniform < (channel.burst_loss_chance if bad else channel.loss_chance)


@compiled
def _walk(draw: Floats, channel: Channel) -> Bools:
    arrived = np.empty(draw.shape[0], dtype=np.bool_)
    bad = False
    for i in range(draw.shape[0]):
        bad = is_bad(bad, draw[i, 0], channel)
        arrived[i] = not is_lost(bad, draw[i, 1], channel)
    return arrived


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
    return _walk(noise.uniforms(seed, run, noise.Stream.LOSS.number(follower), emission_step), channel)
