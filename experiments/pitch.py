"""What a leader's pitch does to one noiseless fix of LAISN-2, for any geometry: over all
bearings and pitches, with the rule for the leader's axis.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.campaign.store import Record
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.estimates import FixKind
from laisn.fix import Pair, circles, pair_fix
from laisn.geometry import Arms, Point, fix_bearing_cosine, fore_offset, pitch_fix_error, sin_cos_of
from laisn.messages import Ranges
from laisn.settings import NavigationSettings, SideRule, Tuning
from reports.figures import Line, Panel, error_bands, panel
from reports.page import Figures, Page, page_of, write
from reports.style import ERROR_LEVELS_M, ESTIMATE, FOLLOWER, FULL, INK, LEADER, SERIES, Legend

BEARINGS_DEG = tuple(float(value) for value in range(0, 181, 15))
"""Bearings of the table."""
_MIN_SPAN_DEG = 15.0  # of pitches on the map, up and down
_STEEPEST_DEG = 85.0
_MAP_PITCHES = 61
_MAP_BEARINGS = 181
_FINE_BEARINGS = 3601  # of sums and sectors: each twentieth of a degree
_CURVE_BEARINGS = 721
_RING_BEARINGS = 36  # true places in the view from above
_OFF_AXIS_DEG = 30.0  # bearings nearer to the leader's axis are left out of "off the axis"
_PITCHES_DEG = (1.0, 2.0, 5.0, 10.0, 20.0)
_ORIGIN = Point(0.0, 0.0)
_LEVEL = sin_cos_of(0.0)
_MIN_ERROR_M = 1e-3  # smallest error of the figures' scales


_KINDS = {
    FixKind.TWO_POINTS: "two points",
    FixKind.TANGENT: "one point",
    FixKind.ASTERN: "on the axis",
}


class PitchedFix(NamedTuple):
    """Where a follower is put whose true place is known; the leader is at the origin and heads
    north.
    """

    east: float  # [m]
    north: float  # [m]
    error: float  # horizontal distance from the true place [m]
    found_as: FixKind

    @property
    def on_axis(self) -> bool:
        """Whether it is there by the rule for the leader's axis."""
        return self.found_as == FixKind.ASTERN

    @property
    def kind(self) -> str:
        return _KINDS[self.found_as]


@dataclass(frozen=True, kw_only=True)
class PitchGeometry:
    """A leader's baseline and pitch, a follower's place; LaisnError if a number is impossible."""

    baseline: float  # rear to front transmitter [m]
    pitch_deg: float  # nose up
    distance: float  # horizontal [m]
    below: float  # how much deeper the follower is [m]; negative: above the leader
    side_rule: SideRule = "behind"
    threshold: float = 0.1  # two intersections closer than this count as one [m]

    def __post_init__(self) -> None:
        limits = {
            "baseline": (self.baseline, 0.01, 1000.0),
            "pitch": (self.pitch_deg, -_STEEPEST_DEG, _STEEPEST_DEG),
            "distance": (self.distance, 0.1, 1e5),
            "below": (self.below, -1e4, 1e4),
            "threshold": (self.threshold, 0.0, 1000.0),
        }
        for name, (value, low, high) in limits.items():
            if not low <= value <= high:
                raise LaisnError(f"--{name}: expected {low:g} to {high:g} (given: {value:g})")

    @property
    def pitch(self) -> float:
        return math.radians(self.pitch_deg)

    @cached_property
    def _tuning(self) -> Tuning:
        return Tuning.of(NavigationSettings(side_rule=self.side_rule, threshold=self.threshold))

    def fix(self, bearing: float, pitch: float) -> PitchedFix:
        """The fix of a follower at a bearing off the bow, to starboard, by the ranges from a
        leader that is pitched nose up; angles in [rad].

        The prediction is the true place, so that the fix is on the right side.
        """
        position = Point(self.distance * math.sin(bearing), self.distance * math.cos(bearing))
        front = fore_offset(0.5 * self.baseline, _LEVEL, sin_cos_of(pitch))
        ranges = Ranges(
            self._range(position, front, -1.0), self._range(position, front, 1.0), float("nan")
        )
        # the follower takes the leader for level
        level = Arms(fore_offset(0.5 * self.baseline, _LEVEL, _LEVEL), (0.0, 0.0, 0.0))
        fixes = circles(_ORIGIN, level, ranges, self.below)
        pair = Pair(fixes.rear, fixes.front, False)
        fix = pair_fix(pair, _LEVEL, position, self._tuning)
        error = math.hypot(fix.east - position.east, fix.north - position.north)
        return PitchedFix(fix.east, fix.north, error, FixKind(int(fix.kind)))

    def _range(self, position: Point, front: tuple[float, float, float], sign: float) -> float:
        """Slant range from the front transmitter (1) or the rear one (−1) [m]."""
        east, north, up = (sign * component for component in front)
        return math.hypot(position.east - east, position.north - north, -self.below - up)

    def fix_at(self, bearing_deg: float) -> PitchedFix:
        """The fix at the leader's pitch."""
        return self.fix(math.radians(bearing_deg), self.pitch)

    def closed_form(self, bearing_deg: Floats, pitch_deg: float | None = None) -> Floats:
        """Errors where the circles meet [m], NaN elsewhere (docs/asymmetry.md)."""
        pitch = math.radians(self.pitch_deg if pitch_deg is None else pitch_deg)
        point = (pitch, self.below, self.distance, np.radians(bearing_deg))
        meets = np.abs(fix_bearing_cosine(*point)) <= 1.0
        return np.where(meets, pitch_fix_error(*point), np.nan)

    def on_axis_deg(self) -> list[tuple[float, float]]:
        """Sectors of bearings, 0 … 180°, in which the rule for the axis decides."""
        grid = np.linspace(0.0, 180.0, _FINE_BEARINGS)
        decides = np.array([self.fix_at(bearing).on_axis for bearing in grid.tolist()])
        edges = np.flatnonzero(np.diff(decides.astype(int), prepend=0, append=0)).tolist()
        return [
            (float(grid[begin]), float(grid[end - 1]))
            for begin, end in zip(edges[::2], edges[1::2], strict=True)
        ]

    def worst(
        self, off_axis_deg: float = 0.0, pitch_deg: float | None = None
    ) -> tuple[float, PitchedFix]:
        """Bearing [°] and fix of the largest error at bearings `off_axis_deg` or more off the axis,
        ahead and astern, at a pitch, by default the leader's.
        """
        pitch = math.radians(self.pitch_deg if pitch_deg is None else pitch_deg)
        # as fine as `on_axis_deg`, whose sectors of a tenth of a degree may hold the largest
        bearings = np.linspace(off_axis_deg, 180.0 - off_axis_deg, _FINE_BEARINGS).tolist()
        fixes = [(bearing, self.fix(math.radians(bearing), pitch)) for bearing in bearings]
        return max(fixes, key=lambda entry: entry[1].error)

    @property
    def pitches(self) -> Floats:
        """Pitches of the map, nose down to nose up [°]."""
        span = min(max(_MIN_SPAN_DEG, 1.5 * abs(self.pitch_deg)), _STEEPEST_DEG)
        return np.linspace(-span, span, _MAP_PITCHES)

    @property
    def bearings(self) -> Floats:
        """Bearings of the map [°]."""
        return np.linspace(0.0, 180.0, _MAP_BEARINGS)

    @cached_property
    def grid(self) -> Floats:
        """Errors over pitches and bearings of the map, shape (pitches, bearings), [m]."""
        return np.array(
            [
                [self.fix(bearing, pitch).error for bearing in np.radians(self.bearings).tolist()]
                for pitch in np.radians(self.pitches).tolist()
            ]
        )

    def records(self) -> Iterator[Record]:
        """The map, a record for each point."""
        for pitch in self.pitches.tolist():
            forms = self.closed_form(self.bearings, pitch).tolist()
            for bearing, form in zip(self.bearings.tolist(), forms, strict=True):
                fix = self.fix(math.radians(bearing), math.radians(pitch))
                yield {
                    "pitch_deg": pitch,
                    "bearing_deg": bearing,
                    "error_m": fix.error,
                    "on_axis": fix.on_axis,
                    "closed_form_m": form,
                }


def rows_by_bearing(geometry: PitchGeometry) -> list[tuple[float, PitchedFix, float]]:
    """Bearing [°], fix, and error by the closed form of each row of the table."""
    forms = geometry.closed_form(np.array(BEARINGS_DEG)).tolist()
    return [(b, geometry.fix_at(b), form) for b, form in zip(BEARINGS_DEG, forms, strict=True)]


def summary(geometry: PitchGeometry) -> str:
    """The answer in three sentences."""
    worst_at, worst = geometry.worst()
    _, worst_off_axis = geometry.worst(_OFF_AXIS_DEG)
    abeam = geometry.fix_at(90.0)
    sectors = geometry.on_axis_deg()
    if sectors:
        texts = " and ".join(
            f"{low:.5g}°" if low == high else f"{low:.5g}° to {high:.5g}°" for low, high in sectors
        )
        axis = (
            f"At bearings of {texts} the circles do not meet clearly: the follower is put on the "
            f"leader's axis, {_SIDES[geometry.side_rule]}."
        )
    else:
        axis = "The circles meet at all bearings."
    return (
        f"Abeam the fix is {abeam.error:.2f} m off, and at most {worst_off_axis.error:.2f} m where "
        f"the follower is {_OFF_AXIS_DEG:g}° or more off the leader's axis. "
        f"The largest error is {worst.error:.2f} m, at {worst_at:.5g}° off the bow. {axis}"
    )


_SIDES = {"behind": "behind it", "predicted": "on the side where it is predicted"}


def _scale(geometry: PitchGeometry) -> float:
    """Factor of the map's error levels, near to the error abeam [m]: 1, 2 or 5 times a power of
    ten.
    """
    error = max(geometry.fix_at(90.0).error, _MIN_ERROR_M)
    power = 10.0 ** math.floor(math.log10(error))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(step - error / power))


def map_of_errors(geometry: PitchGeometry) -> Panel:
    """The error over bearing and pitch, with a line at the leader's pitch."""
    levels = [_scale(geometry) * level for level in ERROR_LEVELS_M]
    hover = "%{x}°, %{y}°: %{customdata:.2f} m"
    contours = error_bands(geometry.bearings, geometry.pitches, geometry.grid, levels, hover)
    ends = np.array([0.0, 180.0])
    pitch_line = Line(
        x=ends, y=np.full(2, geometry.pitch_deg), colour=INK, dash="--", name="this pitch"
    )
    return panel(
        [pitch_line],
        x_label="bearing off the bow, to either side [°]",
        y_label="pitch, nose up [°]",
        title="Error of the fix",
        traces=[contours],
        x_limits=(0.0, 180.0),
        x_ticks=range(0, 181, 30),
        y_limits=(float(geometry.pitches[0]), float(geometry.pitches[-1])),
        width=FULL / 2,
        height=4.0,
    )


def plan_view(geometry: PitchGeometry) -> Panel:
    """True places around the leader, and where the fixes put them."""
    bearings = np.linspace(0.0, 2.0 * np.pi, _RING_BEARINGS, endpoint=False)
    truth = geometry.distance * np.column_stack([np.sin(bearings), np.cos(bearings)])
    fixes = np.array([geometry.fix(b, geometry.pitch)[:2] for b in bearings.tolist()])
    gap = np.full_like(truth, np.nan)
    polyline = np.stack([truth, fixes, gap], axis=1).reshape(-1, 2)
    half_baseline = 0.5 * geometry.baseline
    return panel(
        [
            Line(x=polyline[:, 0], y=polyline[:, 1], colour=ESTIMATE, width=1.2),
            Line(x=truth[:, 0], y=truth[:, 1], colour=FOLLOWER, marker="o", size=4.0, name="truth"),
            Line(x=fixes[:, 0], y=fixes[:, 1], colour=ESTIMATE, marker="D", size=4.0, name="fix"),
            Line(
                x=np.zeros(2),
                y=np.array([-half_baseline, half_baseline]),
                colour=LEADER,
                width=3.0,
                name="leader",
            ),
        ],
        x_label="to starboard [m]",
        y_label="ahead [m]",
        title=f"From above, at a pitch of {geometry.pitch_deg:g}°",
        equal_scales=True,
        width=FULL / 2,
        height=4.0,
    )


def curves(geometry: PitchGeometry) -> Panel:
    """The error over bearing at the leader's pitch, with its closed form."""
    bearings = np.linspace(0.0, 180.0, _CURVE_BEARINGS)
    errors = np.array([geometry.fix_at(bearing).error for bearing in bearings.tolist()])
    lines = [
        Line(x=bearings, y=errors, colour=SERIES[0], width=1.6, name="fix"),
        Line(
            x=bearings, y=geometry.closed_form(bearings), colour=SERIES[1], dash="--", name="form"
        ),
    ]
    return panel(
        lines,
        x_label="bearing off the bow, to either side [°]",
        y_label="error [m]",
        y_log=True,
        y_limits=(max(0.5 * float(errors.min()), _MIN_ERROR_M), 1.5 * float(errors.max())),
        x_limits=(0.0, 180.0),
        x_ticks=range(0, 181, 30),
        width=FULL,
        height=2.8,
    )


def _by_pitch(geometry: PitchGeometry) -> list[tuple[float, float, float, float]]:
    """Pitch [°], and errors abeam, at most off the axis, and at most anywhere [m]."""
    pitches = sorted({*_PITCHES_DEG, abs(geometry.pitch_deg)})
    sign = math.copysign(1.0, geometry.pitch_deg)
    return [
        (
            sign * pitch,
            geometry.fix(math.pi / 2, math.radians(sign * pitch)).error,
            geometry.worst(_OFF_AXIS_DEG, sign * pitch)[1].error,
            geometry.worst(0.0, sign * pitch)[1].error,
        )
        for pitch in pitches
    ]


def pitch_page(geometry: PitchGeometry, facts: Sequence[tuple[str, str]]) -> Page:
    """The page of a geometry."""
    legend: Legend = [(LEADER, "leader's baseline"), (FOLLOWER, "true place"), (ESTIMATE, "fix")]
    values = {
        "g": geometry,
        "summary": summary(geometry),
        "figures": Figures(panels=[map_of_errors(geometry), plan_view(geometry)], legend=legend),
        "curves": Figures(
            panels=[curves(geometry)],
            legend=[(SERIES[0], "fix, with the rule for the axis"), (SERIES[1], "closed form")],
        ),
        "bearings": rows_by_bearing(geometry),
        "pitches": _by_pitch(geometry),
        "off_axis": f"{_OFF_AXIS_DEG:g}",
        "side": _SIDES[geometry.side_rule],
    }
    return page_of("experiments", facts, values, name="pitch.md.j2")


def write_pitch_page(geometry: PitchGeometry, path: Path, facts: Sequence[tuple[str, str]]) -> None:
    """Write the page of a geometry; OSError if that fails."""
    write(pitch_page(geometry, facts), path)
