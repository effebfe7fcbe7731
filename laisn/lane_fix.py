"""Ranges and prediction to a fix, for a block of runs side by side: `fix.py` for lanes.

Every lane takes every branch and selects; only what is the same for all runs (the variant) branches truly.
"""

import math

import numpy as np
import numpy.typing as npt

from laisn import lane_rows as row
from laisn.compiled import compiled_lanes, inlined
from laisn.elementary import sin_cos
from laisn.estimates import FixKind
from laisn.lane_rows import LANES, Tuning

Floats = npt.NDArray[np.float64]

_TWO_POINTS = float(FixKind.TWO_POINTS)
_TANGENT = float(FixKind.TANGENT)
_ASTERN = float(FixKind.ASTERN)
_FUSED = float(FixKind.FUSED)
_LOST = float(FixKind.LOST)

_FORWARD = -1.0
_BACKWARD = 1.0


@inlined
def _range_on_plane(slant: float, depth_difference: float) -> float:
    squared = slant * slant - depth_difference * depth_difference
    # The order of comparison lets NaN through: nothing was received.
    return math.sqrt(0.0 if squared < 0.0 else squared)


@compiled_lanes
def place_transmitters(block: Floats, t: Tuning) -> None:
    """Transmitters as the message places them, and the horizontal ranges to them."""
    half, offset = 0.5 * t.baseline, t.middle_offset
    for lane in range(LANES):
        own_depth = block[row.DEPTH + lane] - t.hydrophone_height
        sine, cosine = sin_cos(block[row.LEADER_HEADING + lane])
        east, north, depth = block[row.EAST + lane], block[row.NORTH + lane], block[row.LEADER_DEPTH + lane]
        depth_difference = depth - own_depth
        block[row.DZ + lane] = depth_difference
        forward_x, forward_y, forward_up = half * sine, half * cosine, 0.0
        port_x, port_y, port_up = -offset * cosine, offset * sine, 0.0
        if t.use_attitude:
            pitch, roll = block[row.PITCH + lane], block[row.ROLL + lane]
            known = pitch == pitch and roll == roll
            sin_pitch, cos_pitch = sin_cos(pitch if known else 0.0)
            sin_roll, cos_roll = sin_cos(roll if known else 0.0)
            forward_x, forward_y, forward_up = forward_x * cos_pitch, forward_y * cos_pitch, half * sin_pitch
            raised = offset * sin_roll
            ahead, aside = -raised * sin_pitch, offset * cos_roll
            port_x, port_y = ahead * sine - aside * cosine, ahead * cosine + aside * sine
            port_up = raised * cos_pitch
        block[row.X1 + lane], block[row.Y1 + lane] = east - forward_x, north - forward_y
        block[row.X2 + lane], block[row.Y2 + lane] = east + forward_x, north + forward_y
        block[row.X3 + lane], block[row.Y3 + lane] = east + port_x, north + port_y
        block[row.D1 + lane] = _range_on_plane(block[row.R1 + lane], depth_difference + forward_up)
        block[row.D2 + lane] = _range_on_plane(block[row.R2 + lane], depth_difference - forward_up)
        block[row.D3 + lane] = _range_on_plane(block[row.R3 + lane], depth_difference - port_up)


@inlined
def _fix_pair(
    block: Floats, t: Tuning, first: int, second: int, out: int, rearward: float
) -> None:
    """Fix of the pair (i, j) whose rows of x, y start at `first`, `second`; j lies to the rear of i for `rearward` 1."""
    for lane in range(LANES):
        xi, yi = block[first + lane], block[first + LANES + lane]
