"""What a pitch of the leader does to one noiseless fix, over pitch, depth offset, range and
bearing.

Every point is one message to a follower whose fix decides, computed by `laisn.lanes`, as campaigns
are; and the closed form of LAISN-2 (docs/asymmetry.md) with range D, bearing B, the follower Δz
deeper and a leader pitched up by φ,

    cos B̂ = cos B cos φ − (Δz / D) sin φ,   error = 2 D sin(|B̂ − B| / 2) ≈ Δz sin φ / |sin B|.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.optimize import bisect

from laisn import lanes
from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.geometry import fix_bearing_cosine, pitch_fix_error
from laisn.lanes import LANES
from laisn.settings import LAISN_VARIANTS, NavigationSettings, Tuning

Grid = Mapping[str, Sequence[float]]  # values of each coordinate of a map, by name
Chart = Mapping[str, Floats]  # columns of a map by name, a row for each point of its grid
MAP_GRID: Grid = {
    "pitch_deg": range(21), "depth_offset_m": (0.0, 1.0, 2.0, 5.0, 7.5, 10.0, 15.0),
    "range_m": (5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0),
    "bearing_deg": range(0, 360, 5),
}  # fmt: skip
"""Pitch of the leader, nose up; depth of the follower below it, horizontal distance, and bearing
off the bow.
"""
# far above the confidence parameter σp of every fix, so that the fix decides
_PREDICTION_SIGMA_M = 1000.0
_MAX_DEPTH_OFFSET_M = 50.0


def slant_ranges(points: Floats, hull: tuple[float, float]) -> Floats:
    """True slant ranges to the transmitters of a leader at the origin that heads north, shape (n,
    3), [m].

    `points`: pitch [rad], depth offset [m], range [m], bearing [rad], shape (n, 4); `hull`:
    baseline, offset of the middle transmitter to port [m].
    """
    pitch, depth_offset, distance, bearing = points.T
    zero = np.zeros_like(pitch)
    half_length = 0.5 * hull[0]
    # east, north, depth
    front = np.stack([zero, half_length * np.cos(pitch), -half_length * np.sin(pitch)], axis=1)
    middle = np.stack([zero - hull[1], zero, zero], axis=1)
    follower = np.stack(
        [distance * np.sin(bearing), distance * np.cos(bearing), depth_offset], axis=1
    )
    return np.asarray(
        np.linalg.norm(np.stack([-front, front, middle], axis=1) - follower[:, None], axis=2)
    )


@compiled
def _sweep(points: Floats, ranges: Floats, t: Tuning, error: Floats) -> None:
    """Write to `error` what `sweep` gives: each lane of a block starts at the origin, at rest, and
    gets the message of one point at step 1.
    """
    for first in range(0, points.shape[0], LANES):
        block = lanes.new_block(np.zeros((1, 4)), t)
        for lane in range(LANES):
            k = min(first + lane, points.shape[0] - 1)
            pitch, depth_offset, distance, bearing = points[k]
            # the follower is the origin: what it estimates is its error
            block[lanes.EAST + lane] = -distance * np.sin(bearing)
            block[lanes.NORTH + lane] = -distance * np.cos(bearing)
            block[lanes.DEPTH + lane] = depth_offset
            block[lanes.PITCH + lane] = pitch
            block[lanes.R1 + lane], block[lanes.R2 + lane], block[lanes.R3 + lane] = ranges[k]
        lanes.position_update(block, t, 1, lanes.no_prior())
        for lane in range(min(LANES, points.shape[0] - first)):
            error[first + lane, 0] = block[lanes.X + lane]
            error[first + lane, 1] = block[lanes.Y + lane]


def sweep(points: Floats, settings: NavigationSettings) -> Floats:
    """Position errors of noiseless fixes east and north, shape (n, 2), [m]; the leader heads
    north.

    Rows of `points`: pitch [rad], depth of the follower below the leader [m], horizontal distance
    [m], bearing [rad].
    """
    ungated = replace(settings, gate="off", position_sigma0=_PREDICTION_SIGMA_M)
    error = np.empty((points.shape[0], 2))
    _sweep(
        points,
        slant_ranges(points, (ungated.baseline, ungated.middle_offset)),
        lanes.tuning(ungated),
        error,
    )
    return error


def closed_form_error(*point: npt.ArrayLike) -> Floats:
    """As `pitch_fix_error`, but NaN where the circles do not meet."""
    return np.where(np.abs(fix_bearing_cosine(*point)) <= 1.0, pitch_fix_error(*point), np.nan)


def measure_map(grid: Grid, settings: NavigationSettings) -> Chart:
    """The map as columns with a row per point: position errors of each variant, range errors and
    closed forms.
    """
    table = np.array(list(product(*grid.values())), dtype=np.float64)
    columns = dict(zip(grid, table.T, strict=True))
    points = np.column_stack(
        [np.deg2rad(v) if name.endswith("deg") else v for name, v in columns.items()]
    )
    for variant in LAISN_VARIANTS:
        columns[f"error_{variant}_m"] = np.hypot(
            *sweep(points, replace(settings, variant=variant)).T
        )
    hull = settings.baseline, settings.middle_offset
    excess = slant_ranges(points, hull) - slant_ranges(points * [0.0, 1.0, 1.0, 1.0], hull)
    columns |= {
        f"range_error_{name}_m": excess[:, i] for i, name in enumerate(("rear", "front", "middle"))
    }
    columns["error_closed_form_m"] = closed_form_error(*points.T)
    return columns


def worst_error(pitch: float, depth_offset: float, off_axis: float, greatest_range: float) -> float:
    """Largest error of a noiseless LAISN-2 fix, nose up or down, ahead or astern at the angle
    `off_axis` from the leader's axis, from 5 m to the range `greatest_range`, [m].

    Infinite where the circles do not meet, so that the follower is put on the leader's axis. Angles
    in [rad].
    """
    distance = np.geomspace(5.0, greatest_range, 40)
    # the error of nose down ahead is that of nose up astern: cos B̂ changes its sign with (−φ, π −
    # B)
    cases = [
        closed_form_error(pitch, depth_offset, distance, bearing)
        for bearing in (off_axis, np.pi - off_axis)
    ]
    return float(np.nan_to_num(np.stack(cases), nan=np.inf).max())


def deepest_offset(pitch: float, off_axis: float, greatest_range: float, bound: float) -> float:
    """Largest depth offset, up to 50 m, that keeps the error under a bound, [m]; NaN if none
    does. Angles in [rad].
    """

    def excess(offset: float) -> float:
        return worst_error(pitch, offset, off_axis, greatest_range) - bound

    if excess(0.0) > 0.0:
        return float("nan")
    return (
        _MAX_DEPTH_OFFSET_M
        if excess(_MAX_DEPTH_OFFSET_M) <= 0.0
        else float(bisect(excess, 0.0, _MAX_DEPTH_OFFSET_M, xtol=1e-9))
    )
