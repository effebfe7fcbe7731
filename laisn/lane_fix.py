"""Ranges and prediction to a fix, for a block of runs side by side: the formulas of `fix` and `variants` in lanes.

Every lane takes every branch and selects; only what is the same for all runs (the variant) branches truly.
"""

from collections.abc import Callable

from laisn import lane_rows as row
from laisn.arrays import Floats
from laisn.compiled import compiled_lanes, inlined
from laisn.elementary import sin_cos
from laisn.fix import Circle, Fix, Pair, circles, pair_fix
from laisn.geometry import Point, Turn, level_arms, tilted_arms
from laisn.lane_rows import LANES
from laisn.messages import Ranges
from laisn.settings import VARIANTS
from laisn.tuning import Tuning
from laisn.variants import SINGLE, Pairs

Choose = Callable[[Floats, Tuning], None]
"""A pass that makes one fix of three."""


@inlined
def _turn(angle: float) -> Turn:
    sine, cosine = sin_cos(angle)
    return Turn(sine, cosine)


@inlined
def _put_circle(block: Floats, first: int, lane: int, circle: Circle) -> None:
    block[first + lane], block[first + LANES + lane] = circle.centre.east, circle.centre.north
    block[first + 2 * LANES + lane] = circle.radius


@inlined
def _circle_at(block: Floats, first: int, lane: int) -> Circle:
    return Circle(row.point_at(block, first, lane), block[first + 2 * LANES + lane])


@compiled_lanes
def place_transmitters(block: Floats, t: Tuning) -> None:
    """Transmitters as the message places them, and the horizontal ranges to them."""
    for lane in range(LANES):
        heading = _turn(block[row.LEADER_HEADING + lane])
        block[row.LEADER_SIN + lane], block[row.LEADER_COS + lane] = heading.sine, heading.cosine
        depth_difference = (block[row.DEPTH + lane] - t.hydrophone_height) - block[row.LEADER_DEPTH + lane]
        block[row.DZ + lane] = depth_difference
        arms = level_arms(t.baseline, t.middle_offset, heading)
        if t.use_attitude:
            pitch, roll = block[row.PITCH + lane], block[row.ROLL + lane]
            known = pitch == pitch and roll == roll
            pitched, rolled = _turn(pitch if known else 0.0), _turn(roll if known else 0.0)
            arms = tilted_arms(t.baseline, t.middle_offset, heading, pitched, rolled)
        ranges = Ranges(block[row.R1 + lane], block[row.R2 + lane], block[row.R3 + lane])
        heard = circles(row.point_at(block, row.EAST, lane), arms, ranges, depth_difference)
        _put_circle(block, row.X1, lane, heard.rear)
        _put_circle(block, row.X2, lane, heard.front)
        _put_circle(block, row.X3, lane, heard.middle)


@inlined
def _fix_pair(block: Floats, t: Tuning, rows: tuple[int, int, int], from_front: bool) -> None:
    """Fix of a pair, from the state as it is; `rows` are those where its circles and the fix begin."""
    rear, front, out = rows
    for lane in range(LANES):
        pair = Pair(_circle_at(block, rear, lane), _circle_at(block, front, lane), from_front)
        heading = Turn(block[row.LEADER_SIN + lane], block[row.LEADER_COS + lane])
        row.put_fix(block, out, lane, pair_fix(pair, heading, row.point_at(block, row.X, lane), t))


@compiled_lanes
def fix_rear_front(block: Floats, t: Tuning) -> None:
    """Fix of the pair (1, 2)."""
    _fix_pair(block, t, (row.X1, row.X2, row.ZX12), False)


@compiled_lanes
def fix_rear_middle(block: Floats, t: Tuning) -> None:
    """Fix of the pair (1, 3)."""
    _fix_pair(block, t, (row.X1, row.X3, row.ZX13), False)


@compiled_lanes
def fix_middle_front(block: Floats, t: Tuning) -> None:
    """Fix of the pair (2, 3), whose rear transmitter is the middle one."""
    _fix_pair(block, t, (row.X3, row.X2, row.ZX23), True)


@compiled_lanes
def take(block: Floats, fix: int) -> None:
    """Choose the fix whose rows begin at `fix`."""
    for i in range(6 * LANES):
        block[row.ZX + i] = block[fix + i]


@compiled_lanes
def give_back(block: Floats, fix: int) -> None:
    """What became of the chosen fix goes where it was taken from."""
    for i in range(6 * LANES):
        block[fix + i] = block[row.ZX + i]


def _pass(single: Callable[[Pairs, Point], Fix]) -> Choose:
    """A variant's formula over the lanes."""

    @compiled_lanes
    def choose(block: Floats, t: Tuning) -> None:
        for lane in range(LANES):
            pairs = (
                row.fix_at(block, row.ZX12, lane),
                row.fix_at(block, row.ZX13, lane),
                row.fix_at(block, row.ZX23, lane),
            )
            row.put_fix(block, row.ZX, lane, single(pairs, row.point_at(block, row.X, lane)))

    return choose


def _branch(number: int, chosen: Choose, otherwise: Choose) -> Choose:
    @compiled_lanes
    def choose(block: Floats, t: Tuning) -> None:
        if t.variant == number:
            chosen(block, t)
        else:
            otherwise(block, t)

    return choose


@compiled_lanes
def _none(block: Floats, t: Tuning) -> None:
    raise NotImplementedError("no formula knows this variant")


def _by_variant() -> Choose:
    """One pass for all variants: compiled code branches by their numbers, as it cannot look up functions."""
    choose: Choose = _none
    for variant, single in SINGLE.items():
        choose = _branch(VARIANTS.index(variant), _pass(single), choose)
    return choose


choose = _by_variant()
"""Make one fix of those of the three pairs, as the variant does."""
