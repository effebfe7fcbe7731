"""Layout of the numbers of a block of runs: rows of `LANES` doubles in one flat array, a lane for each run.

Passes over a block address `block[ROW + lane]`. Rows are constants of one array, so that a compiler sees that they do
not overlap, and turns each pass into vector instructions.
"""

from itertools import count
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled_lanes
from laisn.failure import LaisnError
from laisn.settings import NavigationSettings

Floats = npt.NDArray[np.float64]

LANES = 64
"""Runs of a block."""

_row = count(0, LANES)

# State and covariance: P are position, V velocity terms, C those between (CXY of x and vy).
X, Y, VX, VY = (next(_row) for _ in range(4))
PXX, PXY, PYY, CXX, CXY, CYX, CYY, VXX, VXY, VYY = (next(_row) for _ in range(10))
# Memory of the last accepted position and of the last measurements.
ACCEPTED_X, ACCEPTED_Y, ACCEPTED_STEP = (next(_row) for _ in range(3))
LAST_SPEED, LAST_HEADING, LAST_LEADER_SPEED, LAST_LEADER_HEADING = (next(_row) for _ in range(4))
# Own measurements of a step, and what follows from them; γ are those of the vehicle that changed most.
SPEED, HEADING, DEPTH, SIN, COS, GAMMA_V, GAMMA_THETA = (next(_row) for _ in range(7))
# A message and the ranges measured on it.
EAST, NORTH, LEADER_HEADING, LEADER_SPEED, LEADER_DEPTH, PITCH, ROLL = (next(_row) for _ in range(7))
R1, R2, R3 = (next(_row) for _ in range(3))
# Transmitters, the horizontal ranges to them (NaN where nothing was received), and the leader's depth below one's own.
X1, Y1, D1, X2, Y2, D2, X3, Y3, D3, DZ = (next(_row) for _ in range(10))
LEADER_SIN, LEADER_COS = (next(_row) for _ in range(2))
# The fix of each pair of transmitters and the fix chosen of them: position, σp, kind, separation of two intersections
# (−1 for fewer), and squared distance from the prediction in units of S (NaN where no update was made).
ZX12, ZY12, SIGMA12, KIND12, SEP12, NIS12 = (next(_row) for _ in range(6))
ZX13, ZY13, SIGMA13, KIND13, SEP13, NIS13 = (next(_row) for _ in range(6))
ZX23, ZY23, SIGMA23, KIND23, SEP23, NIS23 = (next(_row) for _ in range(6))
ZX, ZY, SIGMA, KIND, SEP, NIS = (next(_row) for _ in range(6))
# 1 where an update of this message passed the gate.
ANSWERED = next(_row)
SIZE = next(_row)
"""Numbers of a block."""

TWO, THREE_1, THREE_2, BEST, MAIN = range(5)
GATE_OFF, GATE_MAX, GATE_MEASURED = range(3)

_VARIANTS = {"laisn-2": TWO, "laisn-3-1": THREE_1, "laisn-3-2": THREE_2, "laisn-best": BEST, "laisn-main": MAIN}
_GATES = {"off": GATE_OFF, "v-max": GATE_MAX, "v-measured": GATE_MEASURED}
_SIDES = {"behind": False, "predicted": True}

Choice = TypeVar("Choice")


class Tuning(NamedTuple):
    """`NavigationSettings` as compiled code takes them; fields of the same name mean the same."""

    variant: int
    gate: int
    predicted_side: bool
    use_attitude: bool
    dt: float
    baseline: float
    middle_offset: float
    hydrophone_height: float
    threshold: float
    beta: float
    sigma_floor: float
    alpha: float
    sigma_a0: float
    speed_variance: float
    heading_variance: float
    position_variance0: float
    velocity_variance0: float
    leader_speed_max: float
    follower_speed_max: float
    sine_of_pitch: float


def _compiled(name: str, chosen: str, twins: dict[str, Choice]) -> Choice:
    """What compiled code knows a choice as."""
    if chosen not in twins:
        raise NotImplementedError(f"{name} {chosen!r} has no compiled twin; there are: {', '.join(twins)}")
    return twins[chosen]


def tuning(settings: NavigationSettings) -> Tuning:
    """Settings as compiled code takes them.

    Raises:
        NotImplementedError: naming a choice that it does not know.
        LaisnError: they are for one vehicle's navigator alone.
    """
    if settings.use_single_range or settings.transmitter_offsets:
        raise LaisnError(
            "use_single_range and transmitter offsets are for single vehicles and their logs; campaigns know "
            "transmitters on the leader's hull only, and drop a range that arrives alone"
        )
    return Tuning(
        variant=_compiled("variant", settings.variant, _VARIANTS),
        gate=_compiled("gate", settings.gate, _GATES),
        predicted_side=_compiled("side_rule", settings.side_rule, _SIDES),
        use_attitude=settings.use_attitude,
        dt=settings.dt,
        baseline=settings.baseline,
        middle_offset=settings.middle_offset,
        hydrophone_height=settings.hydrophone_height,
        threshold=settings.threshold,
        beta=settings.beta,
        sigma_floor=settings.sigma_floor,
        alpha=settings.alpha,
        sigma_a0=settings.sigma_a0,
        speed_variance=settings.sigma_speed**2,
        heading_variance=settings.sigma_heading**2,
        position_variance0=settings.position_sigma0**2,
        velocity_variance0=settings.velocity_sigma0**2,
        leader_speed_max=settings.leader_speed_max,
        follower_speed_max=settings.follower_speed_max,
        sine_of_pitch=float(np.sin(settings.expected_pitch)),
    )


@compiled_lanes
def new_block(start: Floats, t: Tuning) -> Floats:
    """A block before its first step: every lane at the start (x, y, vx, vy), with nothing measured yet."""
    block = np.zeros(SIZE)
    for lane in range(LANES):
        block[X + lane], block[Y + lane], block[VX + lane], block[VY + lane] = start
        block[PXX + lane] = block[PYY + lane] = t.position_variance0
        block[VXX + lane] = block[VYY + lane] = t.velocity_variance0
        block[ACCEPTED_X + lane], block[ACCEPTED_Y + lane] = start[0], start[1]
        block[LAST_SPEED + lane] = block[LAST_HEADING + lane] = np.nan
        block[LAST_LEADER_SPEED + lane] = block[LAST_LEADER_HEADING + lane] = np.nan
    return block


@compiled_lanes
def fill(block: Floats, first: int, values: Floats) -> None:
    """Copy values, shape (rows · LANES,), into the rows from `first` on."""
    for i in range(values.size):
        block[first + i] = values[i]
