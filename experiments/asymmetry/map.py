"""What a pitch of the leader does to one noiseless fix, over pitch, depth offset, range and bearing.

Every point is one message to a follower that predicts its own place perfectly and hardly trusts that prediction, so
that the fix decides; it runs through the campaign engine itself. Beside it stands the closed form of LAISN-2. With the
follower at (x, y) = D (cos B, −sin B) along the hull and to port, Δz deeper, and a leader pitched up by φ:

    D_rear² − D_front² = 2 L (x cos φ − Δz sin φ),   D_rear² + D_front² = 2 D² + L²/2,

so that the fix keeps its range D and lies at x̂ = x cos φ − Δz sin φ: **pitch turns the fix about the leader**,

    cos B̂ = cos B cos φ − (Δz / D) sin φ,   error = 2 D sin(|B̂ − B| / 2) ≈ Δz sin φ / |sin B|.

Where the right side leaves [−1, 1] the circles do not meet (N = 0), and the follower is put on the leader's axis.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from laisn import lane_rows as row
from laisn import lanes
from laisn.arrays import Floats
from laisn.compiled import compiled_lanes
from laisn.geometry import transmitter_positions
from laisn.lane_rows import LANES
from laisn.settings import VARIANTS, NavigationSettings
from laisn.tuning import Tuning

PREDICTION_SIGMA_M = 1000.0
"""Far above every σp, so that the fix decides."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Points at which the map is computed, in degrees and metres because they end up in a table."""

    pitch_deg: tuple[float, ...]
    """Pitch of the leader, positive nose up."""
    depth_offset_m: tuple[float, ...]
    """Depth of the follower below the leader."""
    range_m: tuple[float, ...]
    """Horizontal distance of the follower."""
    bearing_deg: tuple[float, ...]
    """B, clockwise from the leader's bow."""

    def points(self) -> Floats:
        """All combinations, shape (n, 4), in the order of the fields; [rad] and [m]."""
        rows = product(np.deg2rad(self.pitch_deg), self.depth_offset_m, self.range_m, np.deg2rad(self.bearing_deg))
        return np.array(list(rows), dtype=np.float64)


def full_grid() -> Grid:
    """0–20° of pitch, 0–15 m of depth offset, 5–100 m, all around."""
    return Grid(
        pitch_deg=tuple(float(p) for p in range(21)),
        depth_offset_m=(0.0, 1.0, 2.0, 5.0, 7.5, 10.0, 15.0),
        range_m=(5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0),
        bearing_deg=tuple(float(b) for b in range(0, 360, 5)),
    )


def quick_grid() -> Grid:
    """A first look."""
    return Grid(
        pitch_deg=(0.0, 2.0, 5.0, 10.0, 15.0, 20.0),
        depth_offset_m=(0.0, 2.0, 5.0, 10.0, 15.0),
        range_m=(5.0, 10.0, 20.0, 40.0, 60.0, 80.0, 100.0),
        bearing_deg=tuple(float(b) for b in range(0, 360, 15)),
    )


@compiled_lanes
def slant_ranges(pitch: float, depth_offset: float, reach: float, bearing: float, hull: tuple[float, float]) -> Floats:
    """True slant ranges to the rear, front and middle transmitter of a leader at the origin heading north, [m].

    `hull` is (baseline, middle offset) [m].
    """
    sites = transmitter_positions((0.0, 0.0, 0.0), (0.0, pitch, 0.0), hull[0], hull[1])
    east, north = reach * np.sin(bearing), reach * np.cos(bearing)
    ranges = np.empty(3)
    for i in range(3):
        d_east, d_north, d_depth = sites[i, 0] - east, sites[i, 1] - north, sites[i, 2] - depth_offset
        ranges[i] = np.sqrt(d_east * d_east + d_north * d_north + d_depth * d_depth)
    return ranges


@compiled_lanes
def _sweep(points: Floats, t: Tuning, heard: Floats, error: Floats) -> None:
    for b in range((points.shape[0] + LANES - 1) // LANES):
        first = b * LANES
        block = row.new_block(np.zeros(4), t)
        for lane in range(LANES):
            p = points[min(first + lane, points.shape[0] - 1)]
            ranges = slant_ranges(p[0], p[1], p[2], p[3], (t.baseline, t.middle_offset))
            # the follower is the origin: what it estimates is its error
            block[row.EAST + lane], block[row.NORTH + lane] = -p[2] * np.sin(p[3]), -p[2] * np.cos(p[3])
            block[row.DEPTH + lane] = p[1]
            block[row.PITCH + lane] = p[0]
            block[row.R1 + lane], block[row.R2 + lane], block[row.R3 + lane] = ranges
        lanes.position_update(block, t, 1)
        for lane in range(min(LANES, points.shape[0] - first)):
            for i in range(3):
                heard[first + lane, i] = block[row.R1 + i * LANES + lane]
            error[first + lane, 0], error[first + lane, 1] = block[row.X + lane], block[row.Y + lane]


def sweep(points: Floats, settings: NavigationSettings) -> tuple[Floats, Floats]:
    """Ranges and fixes of noiseless messages.

    Args:
        points: pitch [rad], depth offset [m], horizontal range [m], bearing [rad], shape (n, 4).
        settings: of the follower; gate and prior are replaced.

    Returns:
        Slant ranges, shape (n, 3), and position errors east and north (the leader heads north), shape (n, 2), [m].
    """
    alone = replace(settings, gate="off", position_sigma0=PREDICTION_SIGMA_M)
    heard, error = np.empty((points.shape[0], 3)), np.empty((points.shape[0], 2))
    _sweep(points, row.tuning(alone), heard, error)
    return heard, error


def level_ranges(points: Floats, settings: NavigationSettings) -> Floats:
    """Slant ranges that a level leader would give, shape (n, 3), [m]."""
    hull = settings.baseline, settings.middle_offset
    return np.array([slant_ranges(0.0, dz, reach, bearing, hull) for _, dz, reach, bearing in points.tolist()])


def _turned_cosine(
    pitch: npt.ArrayLike, depth_offset: npt.ArrayLike, reach: npt.ArrayLike, bearing: npt.ArrayLike
) -> Floats:
    """cos B̂; beyond ±1 where the circles do not meet."""
    lever = np.asarray(depth_offset) / np.asarray(reach) * np.sin(pitch)
    return np.asarray(np.cos(bearing) * np.cos(pitch) - lever)


def closed_form_error(
    pitch: npt.ArrayLike, depth_offset: npt.ArrayLike, reach: npt.ArrayLike, bearing: npt.ArrayLike
) -> Floats:
    """Position error of LAISN-2 [m], NaN where the circles do not meet; arguments broadcast, [rad] and [m]."""
    met = np.abs(_turned_cosine(pitch, depth_offset, reach, bearing)) <= 1.0
    return np.where(met, fix_error(pitch, depth_offset, reach, bearing), np.nan)


def fix_error(
    pitch: npt.ArrayLike, depth_offset: npt.ArrayLike, reach: npt.ArrayLike, bearing: npt.ArrayLike
) -> Floats:
    """Error of a fix, `closed_form_error` where the circles meet and that of a fix on the leader's axis elsewhere, [m].

    The end of the axis is the nearer one, so that the error is the least that the pitch can do.
    """
    turned = np.arccos(np.clip(_turned_cosine(pitch, depth_offset, reach, bearing), -1.0, 1.0))
    return np.asarray(2.0 * np.asarray(reach) * np.sin(np.abs(turned - np.arccos(np.cos(bearing))) / 2.0))


def first_order_error(pitch: npt.ArrayLike, depth_offset: npt.ArrayLike, bearing: npt.ArrayLike) -> Floats:
    """Δz sin φ / |sin B|, the lever arm's share for small angles, [m]; infinite or NaN on the axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.abs(np.asarray(depth_offset) * np.sin(pitch) / np.sin(bearing)))


def measure_map(grid: Grid, settings: NavigationSettings) -> pa.Table:
    """The whole map as a table: a row per point, with range errors and the position error of each variant.

    Args:
        grid: where to measure.
        settings: of the follower; the variant is replaced.
    """
    points = grid.points()
    level = level_ranges(points[points[:, 0] == points[0, 0]], settings)
    # the level leader's ranges repeat for each pitch: pitch is the slowest index
    level = np.tile(level, (len(grid.pitch_deg), 1))
    columns: dict[str, Floats] = {
        "pitch_deg": np.rad2deg(points[:, 0]),
        "depth_offset_m": points[:, 1],
        "range_m": points[:, 2],
        "bearing_deg": np.rad2deg(points[:, 3]),
    }
    for variant in VARIANTS:
        heard, error = sweep(points, replace(settings, variant=variant))
        columns[f"error_{variant}_m"] = np.hypot(*error.T)
    for i, name in enumerate(("rear", "front", "middle")):
        columns[f"range_error_{name}_m"] = heard[:, i] - level[:, i]
    columns["error_closed_form_m"] = closed_form_error(*points.T)
    columns["error_first_order_m"] = first_order_error(points[:, 0], points[:, 1], points[:, 3])
    return pa.table({name: values.astype(np.float32) for name, values in columns.items()})
