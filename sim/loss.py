"""Messages that do not arrive: lost one by one, or in bursts.

Bursts follow the two-state chain of Gilbert (Bell System Technical Journal 39, 1960) and Elliott (ibid. 42, 1963): in
its good state a channel loses few messages, in its bad state most of them.
"""

import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled
from sim import noise
from sim.scenario import Acoustics

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


@compiled
def _walk(draw: Floats, enter: float, leave: float, loss_good: float, loss_bad: float) -> Bools:
    received = np.empty(draw.shape[0], dtype=np.bool_)
    bad = False
    for i in range(draw.shape[0]):
        bad = draw[i, 0] >= leave if bad else draw[i, 0] < enter
        received[i] = draw[i, 1] >= (loss_bad if bad else loss_good)
    return received


def received(seed: int, run: int, follower: int, emission_step: Ints, acoustics: Acoustics) -> Bools:
    """Whether each message arrives, shape (m,).

    The chain starts in its good state before the first message; all transmitters share a message's fate.

    Args:
        seed: of the study.
        run: of the campaign.
        follower: 0, 1, …
        emission_step: filter step at which each message was sent, shape (m,), increasing, none left out.
        acoustics: the chances of loss.
    """
    draw = noise.uniforms(seed, run, noise.Stream.LOSS.number(follower), emission_step)
    return _walk(
        draw,
        acoustics.burst_chance,
        1.0 / acoustics.burst_mean_messages,
        acoustics.loss_chance,
        acoustics.burst_loss_chance,
    )


def mean_loss(acoustics: Acoustics) -> float:
    """Share of messages that a long mission loses."""
    enter, leave = acoustics.burst_chance, 1.0 / acoustics.burst_mean_messages
    bad = enter / (enter + leave)
    return (1.0 - bad) * acoustics.loss_chance + bad * acoustics.burst_loss_chance
